//! Plain data, no device: what a scene is made of.

pub mod animation;
pub mod camera;
pub mod clip;
pub mod frames;
pub mod grid;
pub mod keys;
pub mod light;
pub mod picture;
#[expect(clippy::module_inception, reason = "the scene's own data, beside its parts")]
pub mod scene;
pub mod sh;
pub mod sky;
pub mod transfer;
pub mod visibility;
pub mod volume;

pub use animation::{Animation, scene_at};
pub use camera::Camera;
pub use clip::Clip;
pub use grid::Grid;
pub use light::{Light, Probe};
pub use picture::Picture;
pub use scene::{Background, ImageSettings, Matter, Scene, Shading, Surface};
pub use sky::Sky;
pub use transfer::Transfer;
pub use visibility::Visibility;
pub use volume::{Samples, Volume};
