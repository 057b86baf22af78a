//! Constants and structs of `include/halflight.h`, as C lays them out. `tests/ffi_header.rs` compares the two.
#![allow(missing_docs, non_camel_case_types)]

use std::ffi::{c_char, c_void};

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
            // SAFETY: declared below with the header's members first; its members are numbers, raw pointers and optional
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
pub(super) use reserving;

reserving!(hl_engine_info, hl_volume_info, hl_transfer_info, hl_transfer_file_info, hl_save_info, hl_surface);

sized!(
    hl_header,
    hl_device_info,
    hl_load_info,
    hl_light_info,
    hl_image_info,
    hl_difference,
    hl_job_state,
    hl_timing,
    hl_estimate,
    hl_clip,
    hl_precompute_info,
    hl_field_info,
    hl_render_info,
);

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_header {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_engine_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub device: *const c_char,
    pub pipeline_cache: *const c_char,
    pub memory: u64,
    pub log: hl_log_fn,
    pub log_user: *mut c_void,
    pub log_level: i32,
    pub validate: i32,
    pub threads: u32,
    pub reserved: i32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_device_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub name: [c_char; 256],
    pub driver: [c_char; 256],
    pub uuid: [c_char; 40],
    pub kind: i32,
    pub vulkan_major: u32,
    pub vulkan_minor: u32,
    pub validation_errors: u32,
    pub memory_used: u64,
    pub memory_peak: u64,
    pub memory_budget: u64,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_volume_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub data: *const c_void,
    pub dims: [u32; 3],
    pub r#type: i32,
    pub strides: [i64; 3],
    pub spacing: [f64; 3],
    pub axes: [f64; 9],
    pub origin: [f64; 3],
    pub slope: f32,
    pub intercept: f32,
    pub replace_nan: i32,
    pub nan_as: f32,
    pub memory: i32,
    pub reserved: i32,
    pub release: hl_release_fn,
    pub release_user: *mut c_void,
    pub components: u32,
    pub component: u32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_load_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub component: *const c_char,
    pub series: *const c_char,
    pub spacing: [f64; 3],
    pub replace_nan: i32,
    pub nan_as: f32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_transfer_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub points: *const f64,
    pub count: u32,
    pub kind: i32,
    pub reference: i32,
    pub reserved: i32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_transfer_file_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub name: *const c_char,
    pub range: [f64; 2],
    pub reference: i32,
    pub reserved: i32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_light_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub kind: i32,
    pub bands: i32,
    pub window: i32,
    pub radiance: [f32; 3],
    pub toward: [f64; 3],
    pub half_angle: f64,
    pub probe: *mut hl_image,
    pub coefficients: *const f64,
    pub scale: f64,
    pub axis: [f64; 3],
    pub degrees: f64,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_image_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub data: *const c_void,
    pub width: u32,
    pub height: u32,
    pub format: i32,
    pub memory: i32,
    pub column_stride: i64,
    pub row_stride: i64,
    pub release: hl_release_fn,
    pub release_user: *mut c_void,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_save_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub exposure: f64,
    pub layers: u32,
    pub half: i32,
    pub compression: i32,
    pub reserved: i32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_difference {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub relative_rmse: f64,
    pub mean_ratio: f64,
    pub largest: f64,
    pub flip_mean: f64,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_job_state {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub status: i32,
    pub fraction: f32,
    pub stage: [c_char; 32],
    pub passes: u32,
    pub directions: u32,
    pub seconds: f64,
    pub device_seconds: f64,
    pub error: f64,
    pub error_low: f64,
    pub error_high: f64,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_timing {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub kernel: [c_char; 40],
    pub calls: u32,
    pub timed: i32,
    pub seconds: f64,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_estimate {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub peak: u64,
    pub result: u64,
    pub free: u64,
    pub seconds: f64,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_surface {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub iso: f64,
    pub shading: i32,
    pub own_albedo: i32,
    pub albedo: [f32; 3],
    pub reserved: i32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_clip {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub low: [f64; 3],
    pub high: [f64; 3],
    pub planes: *const f64,
    pub plane_count: u32,
    pub space: i32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_precompute_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub volume: *mut hl_volume,
    pub transfer: *mut hl_transfer,
    pub surface: *const hl_surface,
    pub previous: *mut hl_field,
    pub method: i32,
    pub ratio: i32,
    pub directions: u32,
    pub bands: i32,
    pub bits: i32,
    pub filter: i32,
    pub jittered: i32,
    pub near_slices: i32,
    pub all_cells: i32,
    pub progressive: i32,
    pub growth: f32,
    pub step: f32,
    pub tolerance: f64,
    pub quality: i32,
    pub measure: i32,
    pub measure_seconds: f64,
    pub progress: hl_progress_fn,
    pub user: *mut c_void,
    pub clip: *const hl_clip,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_field_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub dims: [u32; 3],
    pub coefficients: i32,
    pub method: i32,
    pub ratio: i32,
    pub bits: i32,
    pub near_slices: i32,
    pub directions: u32,
    pub step: f32,
    pub bytes: u64,
    pub error: f64,
    pub error_low: f64,
    pub error_high: f64,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_camera {
    pub position: [f64; 3],
    pub target: [f64; 3],
    pub up: [f64; 3],
    pub fov: f64,
    pub orbit: [f64; 4],
    pub centre: [f64; 3],
    pub distance: f64,
    pub space: i32,
    pub own_centre: i32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_render_info {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub field: *mut hl_field,
    pub light: *mut hl_light,
    pub camera: hl_camera,
    pub width: u32,
    pub height: u32,
    pub step: f64,
    pub background: i32,
    pub background_color: [f32; 3],
    pub reference: f64,
    pub reference_seconds: f64,
    pub reference_samples: u32,
    pub seed: u32,
    pub progress: hl_progress_fn,
    pub user: *mut c_void,
    pub clip: *const hl_clip,
    pub layers: u32,
    pub every_block: i32,
}
