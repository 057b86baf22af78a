//! What a device must have and do, said before it is made.

use super::super::select::describe;
use super::{Features, GetInstanceProcAddr};
use crate::error::{Error, Result};
use crate::vk::Format;
use ash::vk::{self, Handle};

/// One feature of a device.
#[derive(Clone, Copy, Debug)]
pub struct FeatureNeed {
    /// Its name in Vulkan: "synchronization2".
    pub name: &'static str,
    /// The structure that holds it: "VkPhysicalDeviceVulkan13Features".
    pub structure: &'static str,
    /// Its place in the set.
    pub feature: Features,
    /// Whether nothing runs without it; the others are used where the host says that they are enabled.
    pub required: bool,
    /// What it is used for.
    pub reason: &'static str,
}

/// One image format, in optimal tiling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FormatNeed {
    /// The format.
    pub format: Format,
    /// `VkFormatFeatureFlags` of optimal tiling that it must have.
    pub features: u32,
}

impl FormatNeed {
    /// Images that are sampled with linear interpolation.
    pub const fn filtered(format: Format) -> Self {
        Self { format, features: vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR.as_raw() }
    }

    /// Images that kernels sample and store to.
    pub const fn stored(format: Format) -> Self {
        Self { format, features: vk::FormatFeatureFlags::SAMPLED_IMAGE.as_raw() | vk::FormatFeatureFlags::STORAGE_IMAGE.as_raw() }
    }

    /// Both.
    pub const fn stored_and_filtered(format: Format) -> Self {
        Self { format, features: Self::filtered(format).features | Self::stored(format).features }
    }
}

/// What we need of a device: for a host that has yet to make one.
#[derive(Clone, Debug)]
pub struct Requirements {
    /// Vulkan version of instance and device, at least, as Vulkan encodes it.
    pub api_version: u32,
    /// Extensions of the instance: none.
    pub instance_extensions: &'static [&'static str],
    /// Extensions of the device: none.
    pub device_extensions: &'static [&'static str],
    /// Extensions that are used where the host says that they are enabled: names of objects in captures and messages.
    pub optional_extensions: &'static [&'static str],
    /// Features, required and optional.
    pub features: &'static [FeatureNeed],
    /// `VkQueueFlags` of one queue.
    pub queue_flags: u32,
    /// Image formats.
    pub formats: &'static [FormatNeed],
}

const FEATURES: [FeatureNeed; 5] = [
    FeatureNeed {
        name: "shaderStorageImageExtendedFormats",
        structure: "VkPhysicalDeviceFeatures",
        feature: Features::SHADER_STORAGE_IMAGE_EXTENDED_FORMATS,
        required: true,
        reason: "kernels store to images of one and two channels and of 16 bits",
    },
    FeatureNeed {
        name: "shaderStorageImageWriteWithoutFormat",
        structure: "VkPhysicalDeviceFeatures",
        feature: Features::SHADER_STORAGE_IMAGE_WRITE_WITHOUT_FORMAT,
        required: true,
        reason: "one kernel stores to images of several formats",
    },
    FeatureNeed {
        name: "synchronization2",
        structure: "VkPhysicalDeviceVulkan13Features",
        feature: Features::SYNCHRONIZATION2,
        required: true,
        reason: "barriers and submissions",
    },
    FeatureNeed {
        name: "maintenance4",
        structure: "VkPhysicalDeviceVulkan13Features",
        feature: Features::MAINTENANCE4,
        required: true,
        reason: "kernels say their size of work groups as SPIR-V 1.6 does (LocalSizeId)",
    },
    FeatureNeed {
        name: "timelineSemaphore",
        structure: "VkPhysicalDeviceVulkan12Features",
        feature: Features::TIMELINE_SEMAPHORE,
        required: false,
        reason: "images and buffers of the host that come with semaphores",
    },
];

impl Requirements {
    /// What this runtime needs for itself, and these formats.
    pub const fn with_formats(formats: &'static [FormatNeed]) -> Self {
        Self {
            api_version: vk::API_VERSION_1_3,
            instance_extensions: &[],
            device_extensions: &[],
            optional_extensions: &["VK_EXT_debug_utils"],
            features: &FEATURES,
            queue_flags: vk::QueueFlags::COMPUTE.as_raw(),
            formats,
        }
    }

    /// Names of the required features that are not in a set.
    pub(in crate::vk) fn missing(have: Features) -> impl Iterator<Item = &'static str> {
        FEATURES.iter().filter(move |f| f.required && !have.has(f.feature)).map(|f| f.name)
    }

    /// What a physical device lacks, all of it, in words that follow "lacks".
    pub(in crate::vk) fn lacks(&self, instance: &ash::Instance, physical: vk::PhysicalDevice) -> Vec<String> {
        // SAFETY: the handle comes from this instance. The same holds for the calls below.
        let version = unsafe { instance.get_physical_device_properties(physical) }.api_version;
        let mut lacks = Vec::new();
        if version < self.api_version {
            lacks.push(format!("Vulkan {} (it has {})", dotted(self.api_version), dotted(version)));
        } else {
            lacks.extend(Self::missing(Features::supported(instance, physical)).map(String::from));
        }
        // SAFETY: see above.
        let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
        if !families.iter().any(|f| f.queue_flags.as_raw() & self.queue_flags == self.queue_flags) {
            lacks.push(String::from("a compute queue"));
        }
        for need in self.formats {
            // SAFETY: see above.
            let found = unsafe { instance.get_physical_device_format_properties(physical, need.format.raw()) };
            let missing = vk::FormatFeatureFlags::from_raw(need.features) & !found.optimal_tiling_features;
            if missing.contains(vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR) {
                lacks.push(format!("linear filtering of {:?} images", need.format));
            } else if !missing.is_empty() {
                lacks.push(format!("{missing:?} of {:?} images", need.format));
            }
        }
        lacks
    }
}

/// "1.3".
pub(in crate::vk) fn dotted(version: u32) -> String {
    format!("{}.{}", vk::api_version_major(version), vk::api_version_minor(version))
}

/// What a physical device of the host lacks, in one sentence; nothing where it lacks nothing. Asked before a device is made of it.
/// `api_version` is that of the instance's `VkApplicationInfo`.
///
/// # Errors
/// [`Error::Invalid`] for null handles, and for an entry point that does not know Vulkan 1.3.
///
/// # Safety
/// `instance` and `physical_device` are alive, belong together and come from `get_instance_proc_addr`; the instance was made for
/// `api_version`.
pub unsafe fn lacking(
    get_instance_proc_addr: GetInstanceProcAddr,
    instance: u64,
    physical_device: u64,
    api_version: u32,
    requirements: &Requirements,
) -> Result<Option<String>> {
    // SAFETY: as the caller promises.
    let instance = unsafe { super::import::instance(get_instance_proc_addr, instance, api_version) }?;
    let physical = vk::PhysicalDevice::from_raw(physical_device);
    if physical.is_null() {
        return Err(super::import::null("VkPhysicalDevice"));
    }
    let lacks = requirements.lacks(&instance, physical);
    let name = describe(&instance, physical, 0).name;
    Ok((!lacks.is_empty()).then(|| Error::DeviceLacks { device: name, lacks: lacks.join(", ") }.to_string()))
}
