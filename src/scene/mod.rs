//! Plain data, no device: what a scene is made of.

pub mod grid;
pub mod transfer;
pub mod volume;

pub use grid::Grid;
pub use transfer::Transfer;
pub use volume::{Samples, Volume};
