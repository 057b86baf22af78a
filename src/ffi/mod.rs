//! The C interface: the functions that `include/halflight.h` declares and explains. Not for Rust hosts, which have
//! [`Engine`](crate::Engine).
//!
//! | file | what |
//! |---|---|
//! | `abi`, `abi_structs`, `abi_vulkan` | constants and structs, as the headers have them |
//! | `handle` | the registry of handles: what is stale or foreign is found out |
//! | `call`, `defect` | the way in: panics are caught, faults kept, structs read by their size |
//! | `host` | an engine among threads: turns, callbacks, closing |
//! | `log` | the host's log and the release of borrowed memory |
//! | `engine`, `volume`, `matter`, `light`, `image`, `layers`, `field`, `field_file`, `precompute`, `render`, `estimate`, `job`, `vulkan` | the functions |
#![allow(unsafe_code)]
#![deny(clippy::undocumented_unsafe_blocks)]
// What callers must keep to stands in the header, function by function.
#![allow(clippy::missing_safety_doc, missing_docs)]

pub mod abi;
pub mod abi_structs;
pub mod abi_vulkan;
mod call;
mod defect;
pub mod engine;
pub mod estimate;
mod fault;
pub mod field;
pub mod field_file;
mod handle;
mod host;
pub mod image;
pub mod job;
pub mod layers;
pub mod light;
mod log;
pub mod matter;
mod pixels;
pub mod precompute;
pub mod render;
pub mod volume;
pub mod vulkan;

pub use abi::*;
pub use abi_vulkan::*;
pub use engine::*;
pub use estimate::*;
pub use field::*;
pub use field_file::*;
pub use image::*;
pub use job::*;
pub use layers::*;
pub use light::*;
pub use matter::*;
pub use precompute::*;
pub use render::*;
pub use volume::*;
pub use vulkan::*;
