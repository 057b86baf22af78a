//! Natural light for scalar volumes.
#![deny(unsafe_code, clippy::unwrap_used)]
#![warn(missing_docs)]

pub mod demo;
pub mod engine;
pub mod error;
pub mod io;
pub mod kernels;
pub mod measure;
pub mod scene;
pub mod stages;
pub mod vk;

pub use engine::Engine;
pub use error::{Error, Result};
