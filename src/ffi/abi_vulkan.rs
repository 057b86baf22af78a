//! Constants and structs of `include/halflight_vulkan.h`.
#![allow(missing_docs, non_camel_case_types)]

use super::abi::{Sized_, reserving};
use std::ffi::{c_char, c_void};

pub const HL_STRUCT_VULKAN_DEVICE: i32 = 1;
pub const HL_STRUCT_VULKAN_IMAGE: i32 = 2;
pub const HL_STRUCT_VULKAN_BUFFER: i32 = 3;

pub const HL_VULKAN_API_VERSION: i32 = 0;
pub const HL_VULKAN_QUEUE: i32 = 1;
pub const HL_VULKAN_FEATURE: i32 = 2;
pub const HL_VULKAN_FORMAT: i32 = 3;
pub const HL_VULKAN_INSTANCE_EXTENSION: i32 = 4;
pub const HL_VULKAN_DEVICE_EXTENSION: i32 = 5;

pub const HL_VULKAN_NO_FAMILY: u32 = u32::MAX;

pub type hl_vulkan_function = Option<unsafe extern "C" fn()>;
pub type hl_vulkan_loader = Option<unsafe extern "C" fn(instance: *mut c_void, name: *const c_char) -> hl_vulkan_function>;
pub type hl_queue_fn = Option<unsafe extern "C" fn(user: *mut c_void, family: u32, index: u32)>;

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_vulkan_requirement {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub kind: i32,
    pub required: i32,
    pub value: u32,
    pub format: i32,
    pub name: [c_char; 64],
    pub structure: [c_char; 64],
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_vulkan_queue {
    pub family: u32,
    pub index: u32,
    pub flags: u32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_vulkan_device {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub loader: hl_vulkan_loader,
    pub instance: *mut c_void,
    pub physical_device: *mut c_void,
    pub device: *mut c_void,
    pub features: *const c_void,
    pub extensions: *const *const c_char,
    pub queues: *const hl_vulkan_queue,
    pub extension_count: u32,
    pub queue_count: u32,
    pub lock_queue: hl_queue_fn,
    pub unlock_queue: hl_queue_fn,
    pub lock_user: *mut c_void,
    pub api_version: u32,
    pub reserved: u32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_vulkan_image {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub image: u64,
    pub format: i32,
    pub extent: [u32; 3],
    pub usage: u32,
    pub layout: i32,
    pub layout_after: i32,
    pub queue_family: u32,
    pub wait_semaphore: u64,
    pub wait_value: u64,
    pub signal_semaphore: u64,
    pub signal_value: u64,
    pub handed_back: *mut i32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub struct hl_vulkan_buffer {
    pub struct_size: u32,
    pub struct_type: i32,
    pub next: *const c_void,
    pub buffer: u64,
    pub size: u64,
    pub offset: u64,
    pub row_bytes: u64,
    pub slice_bytes: u64,
    pub wait_semaphore: u64,
    pub wait_value: u64,
    pub signal_semaphore: u64,
    pub signal_value: u64,
    pub handed_back: *mut i32,
    pub queue_family: u32,
    pub reserved: u32,
}

// SAFETY: the header's members first; numbers, raw pointers and optional function pointers after them.
unsafe impl Sized_ for hl_vulkan_requirement {}
// SAFETY: as above.
unsafe impl Sized_ for hl_vulkan_image {}
reserving!(hl_vulkan_device, hl_vulkan_buffer);
