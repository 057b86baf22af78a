//! Plain data, no device: what a scene is made of.

pub mod grid;
pub mod light;
pub mod picture;
pub mod sh;
pub mod transfer;
pub mod visibility;
pub mod volume;

pub use grid::Grid;
pub use light::{Light, Probe};
pub use picture::Picture;
pub use transfer::Transfer;
pub use visibility::Visibility;
pub use volume::{Samples, Volume};
