//! The features of a device that concern us, as a set.

use ash::vk;
use std::ffi::c_void;

/// A set of device features, of those that we use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Features(u32);

impl Features {
    /// `VkPhysicalDeviceFeatures::shaderStorageImageExtendedFormats`
    pub const SHADER_STORAGE_IMAGE_EXTENDED_FORMATS: Self = Self(1);
    /// `VkPhysicalDeviceFeatures::shaderStorageImageWriteWithoutFormat`
    pub const SHADER_STORAGE_IMAGE_WRITE_WITHOUT_FORMAT: Self = Self(2);
    /// `VkPhysicalDeviceVulkan13Features::synchronization2`
    pub const SYNCHRONIZATION2: Self = Self(4);
    /// `VkPhysicalDeviceVulkan13Features::maintenance4`
    pub const MAINTENANCE4: Self = Self(8);
    /// `VkPhysicalDeviceVulkan12Features::timelineSemaphore`; only needed where images or buffers come with semaphores.
    pub const TIMELINE_SEMAPHORE: Self = Self(16);

    /// Those without which nothing runs.
    pub const REQUIRED: Self = Self::SHADER_STORAGE_IMAGE_EXTENDED_FORMATS
        .with(Self::SHADER_STORAGE_IMAGE_WRITE_WITHOUT_FORMAT)
        .with(Self::SYNCHRONIZATION2)
        .with(Self::MAINTENANCE4);

    /// None.
    pub const fn none() -> Self {
        Self(0)
    }

    /// Bits that are no feature of ours are left out.
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits & 31)
    }

    /// As bits, in the order of the constants above.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Both sets.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether all of `other` are in it.
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    fn set(&mut self, feature: Self, there: vk::Bool32) {
        if there != vk::FALSE {
            *self = self.with(feature);
        }
    }

    /// As `VkPhysicalDeviceFeatures`.
    pub(in crate::vk) fn basic(self) -> vk::PhysicalDeviceFeatures {
        vk::PhysicalDeviceFeatures::default()
            .shader_storage_image_extended_formats(self.has(Self::SHADER_STORAGE_IMAGE_EXTENDED_FORMATS))
            .shader_storage_image_write_without_format(self.has(Self::SHADER_STORAGE_IMAGE_WRITE_WITHOUT_FORMAT))
    }

    /// As `VkPhysicalDeviceVulkan13Features`.
    pub(in crate::vk) fn thirteen(self) -> vk::PhysicalDeviceVulkan13Features<'static> {
        vk::PhysicalDeviceVulkan13Features::default()
            .synchronization2(self.has(Self::SYNCHRONIZATION2))
            .maintenance4(self.has(Self::MAINTENANCE4))
    }

    /// What a device of Vulkan 1.3 could enable.
    pub(in crate::vk) fn supported(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Self {
        let mut twelve = vk::PhysicalDeviceVulkan12Features::default();
        let mut thirteen = vk::PhysicalDeviceVulkan13Features::default();
        let mut all = vk::PhysicalDeviceFeatures2::default().push_next(&mut twelve).push_next(&mut thirteen);
        // SAFETY: the handle comes from this instance, and the device is of Vulkan 1.3.
        unsafe { instance.get_physical_device_features2(physical, &mut all) };
        let basic = all.features;
        let mut found = Self::none();
        found.add_basic(&basic);
        found.add_later(&twelve, &thirteen);
        found
    }

    fn add_basic(&mut self, basic: &vk::PhysicalDeviceFeatures) {
        self.set(Self::SHADER_STORAGE_IMAGE_EXTENDED_FORMATS, basic.shader_storage_image_extended_formats);
        self.set(Self::SHADER_STORAGE_IMAGE_WRITE_WITHOUT_FORMAT, basic.shader_storage_image_write_without_format);
    }

    fn add_later(&mut self, twelve: &vk::PhysicalDeviceVulkan12Features<'_>, thirteen: &vk::PhysicalDeviceVulkan13Features<'_>) {
        self.set(Self::TIMELINE_SEMAPHORE, twelve.timeline_semaphore);
        self.set(Self::SYNCHRONIZATION2, thirteen.synchronization2);
        self.set(Self::MAINTENANCE4, thirteen.maintenance4);
    }

    /// The features that a chain of structures enables: `VkPhysicalDeviceFeatures2`, `…Vulkan12Features`, `…Vulkan13Features`,
    /// `…Synchronization2Features`, `…Maintenance4Features`, `…TimelineSemaphoreFeatures`, in any order; others are passed over.
    /// It is what `VkDeviceCreateInfo::pNext` points to. A null pointer is the empty set.
    ///
    /// # Safety
    /// `chain` is null, or begins a valid `pNext` chain.
    pub unsafe fn of_chain(chain: *const c_void) -> Self {
        let mut found = Self::none();
        let mut next = chain.cast::<vk::BaseInStructure<'_>>();
        // SAFETY: every element of a valid chain begins with type and next, and is what its type says.
        unsafe {
            while let Some(head) = next.as_ref() {
                match head.s_type {
                    vk::StructureType::PHYSICAL_DEVICE_FEATURES_2 => {
                        found.add_basic(&(*next.cast::<vk::PhysicalDeviceFeatures2<'_>>()).features);
                    }
                    vk::StructureType::PHYSICAL_DEVICE_VULKAN_1_2_FEATURES => {
                        found.add_later(&*next.cast(), &vk::PhysicalDeviceVulkan13Features::default());
                    }
                    vk::StructureType::PHYSICAL_DEVICE_VULKAN_1_3_FEATURES => {
                        found.add_later(&vk::PhysicalDeviceVulkan12Features::default(), &*next.cast());
                    }
                    vk::StructureType::PHYSICAL_DEVICE_SYNCHRONIZATION_2_FEATURES => {
                        let it: &vk::PhysicalDeviceSynchronization2Features<'_> = &*next.cast();
                        found.set(Self::SYNCHRONIZATION2, it.synchronization2);
                    }
                    vk::StructureType::PHYSICAL_DEVICE_MAINTENANCE_4_FEATURES => {
                        let it: &vk::PhysicalDeviceMaintenance4Features<'_> = &*next.cast();
                        found.set(Self::MAINTENANCE4, it.maintenance4);
                    }
                    vk::StructureType::PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES => {
                        let it: &vk::PhysicalDeviceTimelineSemaphoreFeatures<'_> = &*next.cast();
                        found.set(Self::TIMELINE_SEMAPHORE, it.timeline_semaphore);
                    }
                    _ => {}
                }
                next = head.p_next;
            }
        }
        found
    }
}
