//! Instance, logical device, queue and memory: what every other object keeps alive.

use super::host::{Features, QueueLock};
use super::memory::{Memory, allocator, default_budget};
use super::select::{self, DeviceInfo, Options};
use super::{HEARD, failed, lock};
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::vulkan::Allocator;
use std::ffi::{CStr, CString};
use std::mem::ManuallyDrop;
use std::sync::Mutex;

const VALIDATION: &CStr = c"VK_LAYER_KHRONOS_validation";

/// What the validation layers said.
pub(super) type Messages = Mutex<Vec<String>>;

/// The bottom of the pile. Dropped last, by whatever object goes last.
pub(super) struct Raw {
    pub instance: ash::Instance,
    pub physical: vk::PhysicalDevice,
    pub device: ash::Device,
    pub info: DeviceInfo,
    pub limits: vk::PhysicalDeviceLimits,
    pub family: u32,
    pub timestamp_bits: u32,
    /// One at a time may submit: all device work is serialised here.
    pub queue: Mutex<Queue>,
    /// Whether instance and device are ours to destroy.
    pub owned: bool,
    /// What is enabled.
    pub features: Features,
    /// Queue families that there are.
    pub families: u32,
    pub names: Option<ash::ext::debug_utils::Device>,
    pub as_card: bool,
    messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    // Boxed: the messenger holds its address.
    pub messages: Box<Messages>,
    pub allocator: Mutex<ManuallyDrop<Allocator>>,
    pub memory: Mutex<Memory>,
}

/// A queue, and who else wants it.
#[derive(Clone, Copy)]
pub(super) struct Queue {
    pub handle: vk::Queue,
    pub index: u32,
    pub guard: Option<QueueLock>,
}

impl Drop for Raw {
    fn drop(&mut self) {
        // SAFETY: this is the last owner: every object made from the device held an `Arc` of this and is gone, and all submitted
        // work was waited for by its fence (to wait for the whole device would need all queues of a host). The order is the
        // reverse of creation. The allocator is not used after it is taken.
        unsafe {
            let allocator = self.allocator.get_mut().unwrap_or_else(std::sync::PoisonError::into_inner);
            ManuallyDrop::drop(allocator);
            if !self.owned {
                return;
            }
            self.device.destroy_device(None);
            if let Some((ext, messenger)) = self.messenger.take() {
                ext.destroy_debug_utils_messenger(messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

/// An instance without layers and extensions.
pub(super) fn bare_instance(entry: &ash::Entry) -> Result<ash::Instance> {
    create_instance(entry, &[], &[], &mut vk::ValidationFeaturesEXT::default())
}

fn create_instance(
    entry: &ash::Entry,
    layers: &[&CStr],
    extensions: &[&CStr],
    validation: &mut vk::ValidationFeaturesEXT<'_>,
) -> Result<ash::Instance> {
    let app = vk::ApplicationInfo::default().application_name(c"halflight").api_version(vk::API_VERSION_1_3);
    let layers: Vec<_> = layers.iter().map(|l| l.as_ptr()).collect();
    let extensions: Vec<_> = extensions.iter().map(|e| e.as_ptr()).collect();
    let info = vk::InstanceCreateInfo::default().application_info(&app).enabled_layer_names(&layers).enabled_extension_names(&extensions);
    let info = if layers.is_empty() { info } else { info.push_next(validation) };
    // SAFETY: all pointers of `info` live until the call returns.
    unsafe { entry.create_instance(&info, None) }.map_err(|e| match e {
        vk::Result::ERROR_INCOMPATIBLE_DRIVER => select::no_driver(),
        other => failed("vkCreateInstance")(other),
    })
}

impl Raw {
    pub(super) fn new(options: &Options) -> Result<Self> {
        let entry = select::load()?;
        // SAFETY: the entry is loaded.
        let known =
            unsafe { entry.enumerate_instance_extension_properties(None) }.map_err(failed("vkEnumerateInstanceExtensionProperties"))?;
        let debug = known.iter().any(|e| e.extension_name_as_c_str() == Ok(ash::ext::debug_utils::NAME));
        let mut extensions = Vec::new();
        if debug {
            extensions.push(ash::ext::debug_utils::NAME);
        }
        let mut layers = Vec::new();
        if options.validation {
            // SAFETY: as above.
            let known = unsafe { entry.enumerate_instance_layer_properties() }.map_err(failed("vkEnumerateInstanceLayerProperties"))?;
            if !debug || !known.iter().any(|l| l.layer_name_as_c_str() == Ok(VALIDATION)) {
                return Err(Error::DeviceLacks {
                    device: String::from("Vulkan loader"),
                    lacks: String::from(
                        "VK_LAYER_KHRONOS_validation (Debian: `apt-get install vulkan-validationlayers`); or do without validation",
                    ),
                });
            }
            layers.push(VALIDATION);
            extensions.push(ash::ext::validation_features::NAME);
        }
        let enabled = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut validation = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enabled);
        let instance = create_instance(&entry, &layers, &extensions, &mut validation)?;

        let messages: Box<Messages> = Box::default();
        let made = Self::on_instance(&entry, &instance, options, debug, &messages);
        match made {
            Ok(parts) => Ok(Self::of_parts(instance, parts, true, options.as_card, messages)),
            Err(error) => {
                // SAFETY: `on_instance` has undone what it made.
                unsafe { instance.destroy_instance(None) };
                Err(error)
            }
        }
    }

    fn on_instance(entry: &ash::Entry, instance: &ash::Instance, options: &Options, debug: bool, messages: &Messages) -> Result<Parts> {
        let (physical, info) = select::choose(select::physical(instance)?, options.device.as_deref())?;
        // SAFETY: the handle comes from this instance.
        let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
        super::device::check_features(instance, physical, &info)?;
        let family = compute_family(&families)
            .ok_or_else(|| Error::DeviceLacks { device: info.name.clone(), lacks: String::from("a compute queue") })?;
        // SAFETY: as above.
        let limits = unsafe { instance.get_physical_device_properties(physical) }.limits;

        let messenger = if options.validation {
            let ext = ash::ext::debug_utils::Instance::new(entry, instance);
            let create = vk::DebugUtilsMessengerCreateInfoEXT::default()
                .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::ERROR | vk::DebugUtilsMessageSeverityFlagsEXT::WARNING)
                .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE)
                .pfn_user_callback(Some(heard))
                .user_data(std::ptr::from_ref(messages).cast_mut().cast());
            // SAFETY: `messages` is boxed and outlives the messenger, which is destroyed before it, below or in `Drop`.
            let messenger = unsafe { ext.create_debug_utils_messenger(&create, None) }.map_err(failed("vkCreateDebugUtilsMessengerEXT"))?;
            Some((ext, messenger))
        } else {
            None
        };
        let undo = |error: Error| {
            if let Some((ext, messenger)) = &messenger {
                // SAFETY: made above, not handed on.
                unsafe { ext.destroy_debug_utils_messenger(*messenger, None) };
            }
            error
        };

        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
        let features = Features::REQUIRED.basic();
        let mut thirteen = Features::REQUIRED.thirteen();
        let create = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_features(&features).push_next(&mut thirteen);
        // SAFETY: all pointers of `create` live until the call returns; the features were checked to exist.
        let device = unsafe { instance.create_device(physical, &create, None) }.map_err(|e| undo(failed("vkCreateDevice")(e)))?;
        let allocator = allocator(instance, &device, physical).map_err(|e| {
            // SAFETY: made above, nothing was made from it.
            unsafe { device.destroy_device(None) };
            undo(e)
        })?;
        // SAFETY: the queue was asked for above.
        let queue = Queue { handle: unsafe { device.get_device_queue(family, 0) }, index: 0, guard: None };
        let names = debug.then(|| ash::ext::debug_utils::Device::new(instance, &device));
        let budget = options.memory_budget.unwrap_or_else(|| default_budget(&info));
        let timestamp_bits = families.get(family as usize).map_or(0, |f| f.timestamp_valid_bits);
        let features = Features::REQUIRED;
        let families = families.len() as u32;
        Ok(Parts { physical, device, info, limits, family, timestamp_bits, queue, names, messenger, allocator, budget, features, families })
    }

    pub(super) fn of_parts(instance: ash::Instance, parts: Parts, owned: bool, as_card: bool, messages: Box<Messages>) -> Self {
        Self {
            instance,
            physical: parts.physical,
            device: parts.device,
            info: parts.info,
            limits: parts.limits,
            family: parts.family,
            timestamp_bits: parts.timestamp_bits,
            queue: Mutex::new(parts.queue),
            owned,
            features: parts.features,
            families: parts.families,
            names: parts.names,
            as_card,
            messenger: parts.messenger,
            messages,
            allocator: Mutex::new(ManuallyDrop::new(parts.allocator)),
            memory: Mutex::new(Memory { used: 0, peak: 0, budget: parts.budget }),
        }
    }

    /// Hands work to the queue; a host's lock is held around this alone.
    pub(super) fn submit(&self, submits: &[vk::SubmitInfo2<'_>], fence: vk::Fence) -> ash::prelude::VkResult<()> {
        let queue = lock(&self.queue);
        if let Some(guard) = &queue.guard {
            // SAFETY: promised to `HostDevice::new`.
            unsafe { (guard.lock)(guard.user, self.family, queue.index) };
        }
        // SAFETY: the queue is ours while the lock is held; the slot that calls answers for commands and fence.
        let result = unsafe { self.device.queue_submit2(queue.handle, submits, fence) };
        if let Some(guard) = &queue.guard {
            // SAFETY: as above.
            unsafe { (guard.unlock)(guard.user, self.family, queue.index) };
        }
        result
    }

    /// Gives an object its name in validation messages and captures.
    pub(super) fn name<H: vk::Handle>(&self, handle: H, name: &str) {
        if let (Some(ext), Ok(name)) = (&self.names, CString::new(name)) {
            let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
            // SAFETY: the handle is alive; a refused name does no harm.
            let _ = unsafe { ext.set_debug_utils_object_name(&info) };
        }
    }
}

/// What differs between a device of ours and a host's.
pub(super) struct Parts {
    pub physical: vk::PhysicalDevice,
    pub device: ash::Device,
    pub info: DeviceInfo,
    pub limits: vk::PhysicalDeviceLimits,
    pub family: u32,
    pub timestamp_bits: u32,
    pub queue: Queue,
    pub names: Option<ash::ext::debug_utils::Device>,
    pub messenger: Option<(ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub allocator: Allocator,
    pub budget: u64,
    pub features: Features,
    pub families: u32,
}

/// A family of compute queues; one without graphics is preferred: it keeps a desktop's own work apart.
fn compute_family(families: &[vk::QueueFamilyProperties]) -> Option<u32> {
    let compute = |f: &&(usize, &vk::QueueFamilyProperties)| f.1.queue_flags.contains(vk::QueueFlags::COMPUTE);
    let all: Vec<_> = families.iter().enumerate().collect();
    let alone = all.iter().filter(compute).find(|f| !f.1.queue_flags.contains(vk::QueueFlags::GRAPHICS));
    alone.or_else(|| all.iter().find(compute)).and_then(|f| u32::try_from(f.0).ok())
}

/// Keeps what a validation layer says.
///
/// # Safety
/// Called by the layers only, with the pointer that the messenger was made with.
unsafe extern "system" fn heard(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut std::ffi::c_void,
) -> vk::Bool32 {
    // SAFETY: the layers hand over valid pointers for the time of the call; `user` is the boxed list, which outlives the messenger.
    let (text, messages) = unsafe {
        let message = data.as_ref().and_then(|d| d.message_as_c_str());
        (message.map(|m| m.to_string_lossy().into_owned()).unwrap_or_default(), user.cast::<Messages>().as_ref())
    };
    if severity.contains(vk::DebugUtilsMessageSeverityFlagsEXT::ERROR) {
        log::error!(target: HEARD, "validation: {text}");
        if let Some(messages) = messages {
            lock(messages).push(text);
        }
    } else {
        log::warn!("validation: {text}");
    }
    vk::FALSE
}
