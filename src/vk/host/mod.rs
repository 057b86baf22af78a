//! Somebody else's Vulkan device: what we need of it, how it is handed over, and the images and buffers that cross the line.
//!
//! Raw handles are numbers here (`u64`: the pointer of a dispatchable handle, the handle itself otherwise), enumerations and flags
//! are Vulkan's own values, so that a C header maps onto it word by word. The constructors are `unsafe` and say what must hold;
//! from there on everything is safe to use.

mod features;
mod import;
mod requirements;
mod resource;

pub use features::Features;
pub use requirements::{FeatureNeed, FormatNeed, Requirements, lacking};
pub use resource::{HostBuffer, HostBufferParts, HostImage, HostImageParts, QUEUE_FAMILY_IGNORED, Timeline};

use std::ffi::{c_char, c_void};

/// `PFN_vkGetInstanceProcAddr`.
pub type GetInstanceProcAddr = unsafe extern "system" fn(instance: *mut c_void, name: *const c_char) -> Option<unsafe extern "system" fn()>;

/// Called before and after each submission to a queue, with the user pointer and the queue's family and index.
pub type QueueCallback = unsafe extern "C" fn(user: *mut c_void, family: u32, index: u32);

/// A queue that the host made with its device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostQueue {
    /// Its family.
    pub family: u32,
    /// Its index in the family.
    pub index: u32,
    /// The `VkDeviceQueueCreateFlags` that it was made with, mostly 0.
    pub flags: u32,
}

/// How the host guards its queues. `lock` and `unlock` are called in pairs, on whichever thread uses the engine, around
/// `vkQueueSubmit2` and around nothing else; no other call of Vulkan is made in between, and none is made to another queue.
#[derive(Clone, Copy, Debug)]
pub struct QueueLock {
    /// Waits until nobody else uses the queue, and takes it.
    pub lock: QueueCallback,
    /// Gives it back.
    pub unlock: QueueCallback,
    /// Handed to both.
    pub user: *mut c_void,
}

// SAFETY: whoever makes a `HostDevice` of it promises that both callbacks may be called on any thread with this pointer.
unsafe impl Send for QueueLock {}
// SAFETY: as above.
unsafe impl Sync for QueueLock {}

/// A device that the host has made, part by part; see [`HostDevice::new`].
#[derive(Clone, Debug)]
pub struct HostDeviceParts {
    /// The loader's entry point that the host itself uses.
    pub get_instance_proc_addr: GetInstanceProcAddr,
    /// `VkInstance`.
    pub instance: u64,
    /// `VkPhysicalDevice`.
    pub physical_device: u64,
    /// `VkDevice`.
    pub device: u64,
    /// `VkApplicationInfo::apiVersion` of the instance, as Vulkan encodes it.
    pub api_version: u32,
    /// Instance and device extensions that are enabled, in any order. `VK_EXT_debug_utils` gets our objects their names.
    pub extensions: Vec<String>,
    /// Features that are enabled on the device.
    pub features: Features,
    /// Queues that we may use; the first of a family that computes is taken.
    pub queues: Vec<HostQueue>,
    /// How the queues are guarded. Without it nobody else may use the taken queue while a call into the engine runs.
    pub lock: Option<QueueLock>,
}

/// A device of the host, promised to be as described.
#[derive(Clone, Debug)]
pub struct HostDevice {
    pub(super) parts: HostDeviceParts,
}

impl HostDevice {
    /// Takes the host's word for its device.
    ///
    /// # Safety
    /// - `instance`, `physical_device` and `device` are alive, belong together and come from `get_instance_proc_addr`; instance and
    ///   device outlive the engine that is made on them and every object made from it. Neither is destroyed by us.
    /// - The instance was made for `api_version`; extensions and features listed are enabled; the queues were made with the device,
    ///   with those flags.
    /// - `lock` and `unlock` may be called on any thread for as long; between them nobody else uses the queue; they do not unwind,
    ///   and the host does not call into the engine while it holds the lock.
    /// - Without `lock`, nobody else uses the taken queue (also for `vkDeviceWaitIdle`) while a call into the engine runs.
    pub unsafe fn new(parts: HostDeviceParts) -> Self {
        Self { parts }
    }

    /// What was handed over.
    pub fn parts(&self) -> &HostDeviceParts {
        &self.parts
    }
}
