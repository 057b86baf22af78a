//! Structs of `include/halflight.h`, as C lays them out.
#![allow(missing_docs, non_camel_case_types)]

use super::abi::*;
use std::ffi::{c_char, c_void};

reserving!(hl_engine_info, hl_volume_info, hl_transfer_info, hl_transfer_file_info, hl_save_info, hl_surface, hl_precompute_info);

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
    hl_field_info,
    hl_camera,
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
    pub fit: u32,
    pub reserved: i32,
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
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
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
    pub camera: *const hl_camera,
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
