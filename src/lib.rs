//! Natural light for scalar volumes.
#![deny(unsafe_code, clippy::unwrap_used)]
#![warn(missing_docs)]

pub mod demo;
pub mod error;
pub mod io;
pub mod scene;

pub use error::{Error, Result};
