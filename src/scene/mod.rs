//! Plain data, no device: what a scene is made of.

pub mod camera;
pub mod grid;
pub mod picture;
pub mod transfer;
pub mod visibility;
pub mod volume;

pub use camera::Camera;
pub use grid::Grid;
pub use picture::Picture;
pub use transfer::Transfer;
pub use visibility::Visibility;
pub use volume::{Samples, Volume};
