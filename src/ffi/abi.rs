//! Constants, handles and callbacks of `include/halflight.h`; the structs stand in `abi_structs`. `tests/ffi_header.rs` compares
//! header and Rust.
#![allow(missing_docs, non_camel_case_types)]

use std::ffi::{c_char, c_void};

pub use super::abi_structs::*;

pub type hl_status = i32;

pub const HL_VERSION_MAJOR: u32 = 0;
pub const HL_VERSION_MINOR: u32 = 1;
pub const HL_VERSION_PATCH: u32 = 0;
pub const HL_ABI: u32 = 0;

pub const HL_OK: i32 = 0;
pub const HL_NOT_READY: i32 = 1;
pub const HL_TIMEOUT: i32 = 2;
pub const HL_END: i32 = 3;
pub const HL_ERROR_INVALID: i32 = -1;
pub const HL_ERROR_HANDLE: i32 = -2;
pub const HL_ERROR_BUSY: i32 = -3;
pub const HL_ERROR_REENTRANT: i32 = -4;
pub const HL_ERROR_CANCELLED: i32 = -5;
pub const HL_ERROR_NO_DEVICE: i32 = -6;
pub const HL_ERROR_DEVICE_LACKS: i32 = -7;
pub const HL_ERROR_DEVICE_LOST: i32 = -8;
pub const HL_ERROR_MEMORY: i32 = -9;
pub const HL_ERROR_IO: i32 = -10;
pub const HL_ERROR_FORMAT: i32 = -11;
pub const HL_ERROR_POISONED: i32 = -12;
pub const HL_ERROR_INTERNAL: i32 = -13;

pub const HL_LOG_ERROR: i32 = 1;
pub const HL_LOG_WARNING: i32 = 2;
pub const HL_LOG_INFO: i32 = 3;
pub const HL_LOG_DEBUG: i32 = 4;

pub const HL_UINT8: i32 = 1;
pub const HL_INT8: i32 = 2;
pub const HL_UINT16: i32 = 3;
pub const HL_INT16: i32 = 4;
pub const HL_UINT32: i32 = 5;
pub const HL_INT32: i32 = 6;
pub const HL_UINT64: i32 = 7;
pub const HL_INT64: i32 = 8;
pub const HL_FLOAT32: i32 = 9;
pub const HL_FLOAT64: i32 = 10;

pub const HL_COPY: i32 = 0;
pub const HL_BORROW: i32 = 1;

pub const HL_OPACITY: i32 = 0;
pub const HL_EXTINCTION: i32 = 1;

pub const HL_PER_VOXEL: i32 = 0;
pub const HL_PER_WORLD: i32 = 1;
pub const HL_PER_SIDE: i32 = 2;

pub const HL_LIGHT_WHITE: i32 = 0;
pub const HL_LIGHT_CONSTANT: i32 = 1;
pub const HL_LIGHT_DIRECTIONAL: i32 = 2;
pub const HL_LIGHT_CONE: i32 = 3;
pub const HL_LIGHT_PROBE: i32 = 4;
pub const HL_LIGHT_SH: i32 = 5;

pub const HL_WINDOW_NONE: i32 = 0;
pub const HL_WINDOW_HANNING: i32 = 1;
pub const HL_WINDOW_LANCZOS: i32 = 2;
pub const HL_WINDOW_GAUSS: i32 = 3;

pub const HL_RGBA32F: i32 = 0;
pub const HL_RGB32F: i32 = 1;
pub const HL_RGBA8: i32 = 2;

pub const HL_LAYER_DEPTH: u32 = 1;
pub const HL_LAYER_NORMAL: u32 = 2;
pub const HL_LAYER_ALBEDO: u32 = 4;
pub const HL_LAYER_IRRADIANCE: u32 = 8;
pub const HL_LAYER_VISIBILITY: u32 = 16;
pub const HL_LAYER_OPACITY: u32 = 32;
pub const HL_LAYER_NOISE: u32 = 64;

pub const HL_COMPRESSION_ZIP: i32 = 0;
pub const HL_COMPRESSION_NONE: i32 = 1;
pub const HL_COMPRESSION_RLE: i32 = 2;
pub const HL_COMPRESSION_ZIPS: i32 = 3;
pub const HL_COMPRESSION_PIZ: i32 = 4;

pub const HL_DIFFERENCE_SIGNED: i32 = 0;
pub const HL_DIFFERENCE_FLIP: i32 = 1;

pub const HL_CLIP_SIDE: i32 = 0;
pub const HL_CLIP_WORLD: i32 = 1;

pub const HL_LAMBERT: i32 = 0;
pub const HL_ISOTROPIC: i32 = 1;

pub const HL_METHOD_MARCH: i32 = 1;
pub const HL_METHOD_HIERARCHICAL: i32 = 2;
pub const HL_METHOD_SWEEP: i32 = 3;

pub const HL_FILTER_BOX: i32 = 1;
pub const HL_FILTER_PRODUCT: i32 = 2;
pub const HL_FILTER_AXIS: i32 = 3;
pub const HL_FILTER_EXTINCTION: i32 = 4;

pub const HL_QUALITY_DRAFT: i32 = 1;
pub const HL_QUALITY_NORMAL: i32 = 2;
pub const HL_QUALITY_FINE: i32 = 3;

pub const HL_CAMERA_FRAME: i32 = 0;
pub const HL_CAMERA_SIDE: i32 = 1;
pub const HL_CAMERA_WORLD: i32 = 2;

pub const HL_BACKGROUND_NONE: i32 = 0;
pub const HL_BACKGROUND_COLOR: i32 = 1;
pub const HL_BACKGROUND_LIGHT: i32 = 2;

// What handles point to: nothing. They are numbers that the registry knows (see `handle`).
#[repr(C)]
pub struct hl_engine {
    _private: [u8; 0],
}
#[repr(C)]
pub struct hl_volume {
    _private: [u8; 0],
}
#[repr(C)]
pub struct hl_transfer {
    _private: [u8; 0],
}
#[repr(C)]
pub struct hl_light {
    _private: [u8; 0],
}
#[repr(C)]
pub struct hl_field {
    _private: [u8; 0],
}
#[repr(C)]
pub struct hl_image {
    _private: [u8; 0],
}
#[repr(C)]
pub struct hl_job {
    _private: [u8; 0],
}

// Panics of callbacks in Rust are caught by the entry that called them. Exceptions of other languages would end the process:
// the header forbids them.
pub type hl_log_fn = Option<unsafe extern "C-unwind" fn(user: *mut c_void, severity: i32, text: *const c_char)>;
pub type hl_release_fn = Option<unsafe extern "C-unwind" fn(user: *mut c_void, data: *const c_void)>;
pub type hl_progress_fn = Option<unsafe extern "C-unwind" fn(user: *mut c_void, stage: *const c_char, fraction: f32) -> i32>;

/// A struct that begins as `hl_header` does.
///
/// # Safety
/// `#[repr(C)]`, the header's three members first, and any bytes are a value of it: numbers, raw pointers, optional
/// function pointers.
pub unsafe trait Sized_: Copy {
    /// Its member `reserved`, which must be 0: a later version may give it a meaning.
    fn reserved(&self) -> bool {
        false
    }
}

macro_rules! sized {
    ($($name:ident),* $(,)?) => {
        $(
            // SAFETY: declared with the header's members first; its members are numbers, raw pointers and optional
            // function pointers.
            unsafe impl Sized_ for $name {}
        )*
    };
}

macro_rules! reserving {
    ($($name:ident),* $(,)?) => {
        $(
            // SAFETY: as above.
            unsafe impl Sized_ for $name {
                fn reserved(&self) -> bool {
                    self.reserved != 0
                }
            }
        )*
    };
}
pub(super) use {reserving, sized};
