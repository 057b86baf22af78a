//! The Vulkan runtime: device, buffers, images, kernels, recorder, timing. It knows "image" and "kernel" and no word of rendering.
//!
//! The only place that uses ash. Everything it hands out is safe to use: objects keep their device alive, a recorder keeps what it
//! binds alive until it has run, and the ledger (see [`Recorder`]) refuses a dispatch whose inputs no barrier has made visible.
#![allow(unsafe_code)]
#![deny(clippy::undocumented_unsafe_blocks)]

mod access;
mod barrier;
mod buffer;
mod cache;
mod canary;
mod copy;
mod device;
mod filtering;
mod foreign;
mod format;
pub mod host;
mod image;
mod kernel;
mod memory;
mod raw;
mod recorder;
mod select;
mod slot;
mod staging;
mod timing;
mod transfer;
mod transfer_image;

pub use access::{Access, Barrier, Half, Resource};
pub use buffer::Buffer;
pub use copy::CopySpan;
pub use device::Device;
pub use filtering::Filtering;
pub use format::Format;
pub use image::{Image, ImageDesc, Sampled, Storage};
pub use kernel::{BindingInfo, BindingKind, Bindings, Bound, KernelInfo, Specialization};
pub use memory::Memory;
pub use recorder::Recorder;
pub use select::{DeviceInfo, DeviceKind, Options, devices};
pub use timing::Span;
pub use transfer_image::Piece;

use crate::error::Error;
use ash::vk;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Turns Vulkan's result of `call` into the crate's error.
fn failed(call: &'static str) -> impl Fn(vk::Result) -> Error {
    move |result| match result {
        vk::Result::ERROR_DEVICE_LOST => Error::DeviceLost { during: call.to_owned() },
        vk::Result::ERROR_OUT_OF_HOST_MEMORY | vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_POOL_MEMORY => {
            Error::NoMemory {
                what: call.to_owned(),
                needs: 0,
                right: String::from("the driver itself ran out of memory: free some, or ask for less"),
            }
        }
        other => Error::Vulkan { call, result: format!("{other:?}") },
    }
}

/// The log target of validation errors: the device's list holds them, too.
pub(crate) const HEARD: &str = "halflight::validation";

/// Locks, also after another thread panicked inside: what the mutexes here guard is valid between any two statements.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
