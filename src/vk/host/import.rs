//! Function tables and the bottom of the pile, on a device that we did not make and do not destroy.

use super::requirements::dotted;
use super::{GetInstanceProcAddr, HostDevice, HostQueue, Requirements};
use crate::error::{Error, Result};
use crate::vk::memory;
use crate::vk::raw::{Parts, Queue, Raw};
use crate::vk::select::{self, Options};
use ash::vk::{self, Handle};
use std::ffi::{CStr, c_char};

/// Device functions that we call and that an old or incomplete loader may lack; the others are of Vulkan 1.0.
const LATE: [&CStr; 4] = [c"vkQueueSubmit2", c"vkCmdPipelineBarrier2", c"vkCmdWriteTimestamp2", c"vkGetDeviceImageMemoryRequirements"];
const NAMES: [&CStr; 3] = [c"vkSetDebugUtilsObjectNameEXT", c"vkCmdBeginDebugUtilsLabelEXT", c"vkCmdEndDebugUtilsLabelEXT"];

pub(super) fn null(what: &str) -> Error {
    Error::Invalid { item: "host device", what: format!("its {what} is null"), right: String::from("hand over the host's own") }
}

/// The instance's functions.
///
/// # Safety
/// `instance` is null, or alive and from this entry point, made for `api_version`.
pub(super) unsafe fn instance(get: GetInstanceProcAddr, instance: u64, api_version: u32) -> Result<ash::Instance> {
    let handle = vk::Instance::from_raw(instance);
    if handle.is_null() {
        return Err(null("VkInstance"));
    }
    if api_version < vk::API_VERSION_1_3 {
        return Err(Error::DeviceLacks {
            device: String::from("the host's instance"),
            lacks: format!("Vulkan 1.3: it was made for {}, see VkApplicationInfo::apiVersion", dotted(api_version)),
        });
    }
    // SAFETY: both are `PFN_vkGetInstanceProcAddr`; a dispatchable handle is a pointer.
    let get = unsafe {
        std::mem::transmute::<GetInstanceProcAddr, unsafe extern "system" fn(vk::Instance, *const c_char) -> vk::PFN_vkVoidFunction>(get)
    };
    for name in [c"vkGetPhysicalDeviceFeatures2", c"vkGetDeviceProcAddr"] {
        // SAFETY: the instance is alive and the name a C string.
        if unsafe { get(handle, name.as_ptr()) }.is_none() {
            return Err(Error::Invalid {
                item: "vkGetInstanceProcAddr",
                what: format!("it knows no {} for the host's instance", name.to_string_lossy()),
                right: String::from("hand over the one that made this instance, of a loader of Vulkan 1.3"),
            });
        }
    }
    // SAFETY: as above.
    Ok(unsafe { ash::Instance::load(&ash::StaticFn { get_instance_proc_addr: get }, handle) })
}

impl Raw {
    /// On the device of a host.
    pub(in crate::vk) fn import(host: &HostDevice, options: &Options) -> Result<Self> {
        let parts = &host.parts;
        check_options(options)?;
        // SAFETY: promised to `HostDevice::new`.
        let instance = unsafe { instance(parts.get_instance_proc_addr, parts.instance, parts.api_version) }?;
        let physical = vk::PhysicalDevice::from_raw(parts.physical_device);
        let device = vk::Device::from_raw(parts.device);
        if physical.is_null() || device.is_null() {
            return Err(null(if device.is_null() { "VkDevice" } else { "VkPhysicalDevice" }));
        }
        // SAFETY: as above.
        let index = unsafe { instance.enumerate_physical_devices() }.ok().and_then(|all| all.iter().position(|p| *p == physical));
        let info = select::describe(&instance, physical, index.unwrap_or(0));
        let lacks = |lacks: String| Error::DeviceLacks { device: info.name.clone(), lacks };
        let missing = Requirements::with_formats(&[]).lacks(&instance, physical);
        if !missing.is_empty() {
            return Err(lacks(missing.join(", ")));
        }
        let off: Vec<_> = Requirements::missing(parts.features).collect();
        if !off.is_empty() {
            return Err(lacks(format!("{}, which the host has not enabled: do so in vkCreateDevice", off.join(", "))));
        }
        // SAFETY: as above.
        let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
        let taken = choose(&parts.queues, &families).map_err(|refusal| match refusal {
            Some(queue) => Error::Invalid {
                item: "host device",
                what: format!("it lists queue {} of family {}", queue.index, queue.family),
                right: format!("'{}' has no such queue", info.name),
            },
            None => lacks(String::from("a queue of a family that computes among those that the host hands over")),
        })?;
        // SAFETY: as above.
        let limits = unsafe { instance.get_physical_device_properties(physical) }.limits;
        // SAFETY: as above.
        let device = unsafe { ash::Device::load(instance.fp_v1_0(), device) };
        // SAFETY: as above.
        let knows = |name: &CStr| unsafe { instance.get_device_proc_addr(device.handle(), name.as_ptr()) }.is_some();
        if let Some(name) = LATE.iter().find(|name| !knows(name)) {
            return Err(lacks(format!("the function {}", name.to_string_lossy())));
        }
        let named =
            parts.extensions.iter().any(|e| e.as_bytes() == ash::ext::debug_utils::NAME.to_bytes()) && NAMES.iter().all(|n| knows(n));
        let names = named.then(|| ash::ext::debug_utils::Device::new(&instance, &device));
        let queue = vk::DeviceQueueInfo2::default()
            .flags(vk::DeviceQueueCreateFlags::from_raw(taken.flags))
            .queue_family_index(taken.family)
            .queue_index(taken.index);
        // SAFETY: the host made the device with this queue, as promised to `HostDevice::new`.
        let queue = unsafe { device.get_device_queue2(&queue) };
        if queue.is_null() {
            return Err(Error::Invalid {
                item: "host device",
                what: format!("queue {} of family {} is not one of the device's", taken.index, taken.family),
                right: String::from("list the queues that the device was made with, with their flags"),
            });
        }
        let allocator = memory::allocator(&instance, &device, physical)?;
        let timestamp_bits = families.get(taken.family as usize).map_or(0, |f| f.timestamp_valid_bits);
        let made = Parts {
            physical,
            device,
            family: taken.family,
            timestamp_bits,
            queue: Queue { handle: queue, index: taken.index, guard: parts.lock },
            names,
            messenger: None,
            allocator,
            budget: options.memory_budget.unwrap_or_else(|| memory::default_budget(&info)),
            info,
            limits,
            features: parts.features,
            families: families.len() as u32,
        };
        Ok(Self::of_parts(instance, made, false, options.as_card, Box::default()))
    }
}

/// Wishes that only the maker of a device can fulfil.
fn check_options(options: &Options) -> Result<()> {
    let wish = if options.device.is_some() {
        "device"
    } else if options.validation {
        "validation"
    } else if options.threads.is_some() {
        "threads"
    } else {
        return Ok(());
    };
    Err(Error::Invalid {
        item: "options of a host's device",
        what: format!("'{wish}' is set"),
        right: String::from("the device is the host's: what it is, its layers and its threads are settled where the host makes it"),
    })
}

/// The first queue that computes; the wrong queue, if one is not there at all.
fn choose(queues: &[HostQueue], families: &[vk::QueueFamilyProperties]) -> std::result::Result<HostQueue, Option<HostQueue>> {
    let there = |q: &HostQueue| families.get(q.family as usize).is_some_and(|f| q.index < f.queue_count);
    if let Some(wrong) = queues.iter().find(|q| !there(q)) {
        return Err(Some(*wrong));
    }
    let computes = |q: &&HostQueue| families.get(q.family as usize).is_some_and(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE));
    queues.iter().find(computes).copied().ok_or(None)
}
