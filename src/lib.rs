//! Natural light for scalar volumes.
#![deny(unsafe_code, clippy::unwrap_used)]
#![warn(missing_docs)]

pub mod error;
pub mod io;
pub mod kernels;
pub mod scene;
pub mod vk;

pub use error::{Error, Result};
