//! Which devices there are, and which one is taken.

use super::{failed, lock};
use crate::error::{Error, Result};
use ash::vk;
use std::ffi::{CStr, c_char};
use std::path::PathBuf;
use std::sync::Mutex;

/// What a caller may wish of a device.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Its index in [`devices`], its uuid (32 hexadecimal digits) or a part of its name. Nothing: the fastest kind there is.
    pub device: Option<String>,
    /// Switch the Khronos validation layer on, with synchronization validation.
    pub validation: bool,
    /// Bytes of device memory for buffers and images. Nothing: 80 % of the device's own memory; on a CPU 60 % of what is available.
    pub memory_budget: Option<u64>,
    /// Threads of a CPU device (lavapipe). It is handed over in the environment, which is sound only while the process has one
    /// thread: later, the request is refused and `LP_NUM_THREADS` must be set from outside.
    pub threads: Option<usize>,
    /// Folder of the pipeline cache. Nothing: `$XDG_CACHE_HOME/halflight` or `~/.cache/halflight`. Empty: no cache.
    pub pipeline_cache: Option<PathBuf>,
    /// Work as on a separate card where the device is none: copy through staging although the host sees the device's memory, and
    /// spread over many invocations what a CPU does in few. For tests.
    pub as_card: bool,
}

/// Kind of a device, the preferred first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A card of its own.
    Discrete,
    /// Part of the processor, sharing its memory.
    Integrated,
    /// Handed through by a virtual machine.
    Virtual,
    /// Software on the processor.
    Cpu,
    /// None of these.
    Other,
}

/// What a device says of itself.
#[derive(Clone, Debug)]
pub struct DeviceInfo {
    /// Place in the list of [`devices`].
    pub index: usize,
    /// "llvmpipe (LLVM 15.0.6, 256 bits)"
    pub name: String,
    /// Kind of device.
    pub kind: DeviceKind,
    /// Driver and version: "llvmpipe Mesa 22.3.6 (LLVM 15.0.6)".
    pub driver: String,
    /// Vulkan version: major, minor, patch.
    pub api_version: (u32, u32, u32),
    /// Identity, 32 hexadecimal digits.
    pub uuid: String,
    /// Most texels along an edge of a 3-D image.
    pub max_image_3d: u32,
    /// Most bytes of one storage buffer.
    pub max_storage_range: u64,
    /// Most bytes of one allocation.
    pub max_allocation: u64,
    /// Bytes of the largest heap that the device calls its own.
    pub heap_bytes: u64,
    /// The driver's own version number.
    pub driver_version: u32,
}

/// Lists the devices of this machine, in the loader's order.
///
/// # Errors
/// [`Error::NoDevice`] where there is no Vulkan loader; an empty list is no error.
pub fn devices() -> Result<Vec<DeviceInfo>> {
    let entry = load()?;
    let instance = super::raw::bare_instance(&entry)?;
    let list = physical(&instance).map(|all| all.into_iter().map(|(_, info)| info).collect());
    // SAFETY: nothing was made from this instance that outlives this call.
    unsafe { instance.destroy_instance(None) };
    list
}

/// The loader, and an instance that keeps the drivers loaded: without either, both come and go with every engine, and some
/// drivers (NVIDIA's) do not load any more after some hundred times.
static LOADED: Mutex<Option<(ash::Entry, ash::Instance)>> = Mutex::new(None);

/// Loads the Vulkan loader and its drivers, for the life of the process. Only success is kept: where something is missing, it can
/// still be installed; each instance looks for drivers anew.
pub(super) fn load() -> Result<ash::Entry> {
    let mut loaded = lock(&LOADED);
    if let Some((entry, _)) = &*loaded {
        return Ok(entry.clone());
    }
    // SAFETY: the loader is the system's own library; running its initialisers is what using Vulkan means.
    let entry = unsafe { ash::Entry::load() }.map_err(|e| Error::NoDevice {
        what: format!("the Vulkan loader does not load ({e})"),
        right: String::from(
            "install it (Debian: `apt-get install libvulkan1`) together with a driver (mesa-vulkan-drivers runs on any processor)",
        ),
    })?;
    let instance = super::raw::bare_instance(&entry)?;
    Ok(loaded.insert((entry, instance)).0.clone())
}

/// All physical devices with their descriptions.
pub(super) fn physical(instance: &ash::Instance) -> Result<Vec<(vk::PhysicalDevice, DeviceInfo)>> {
    // SAFETY: the instance is alive.
    let handles = match unsafe { instance.enumerate_physical_devices() } {
        Ok(handles) => handles,
        // What the loader says when no driver is installed.
        Err(vk::Result::ERROR_INITIALIZATION_FAILED) => Vec::new(),
        Err(e) => return Err(failed("vkEnumeratePhysicalDevices")(e)),
    };
    Ok(handles.into_iter().enumerate().map(|(index, handle)| (handle, describe(instance, handle, index))).collect())
}

pub(super) fn describe(instance: &ash::Instance, handle: vk::PhysicalDevice, index: usize) -> DeviceInfo {
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut id = vk::PhysicalDeviceIDProperties::default();
    let mut maintenance = vk::PhysicalDeviceMaintenance3Properties::default();
    // SAFETY: the handle comes from this instance.
    let basic = unsafe { instance.get_physical_device_properties(handle) };
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut id).push_next(&mut maintenance);
    if basic.api_version >= vk::API_VERSION_1_2 {
        all = all.push_next(&mut driver);
    }
    if basic.api_version >= vk::API_VERSION_1_1 {
        // SAFETY: as above; the chained structures are of the device's Vulkan version.
        unsafe { instance.get_physical_device_properties2(handle, &mut all) };
    }
    // SAFETY: as above.
    let memory = unsafe { instance.get_physical_device_memory_properties(handle) };
    let heap_bytes = memory
        .memory_heaps_as_slice()
        .iter()
        .filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
        .map(|heap| heap.size)
        .max()
        .unwrap_or(0);
    let version = basic.api_version;
    DeviceInfo {
        index,
        name: text(&basic.device_name),
        kind: match basic.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
            vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
            vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
            vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
            _ => DeviceKind::Other,
        },
        driver: format!("{} {}", text(&driver.driver_name), text(&driver.driver_info)).trim().to_owned(),
        api_version: (vk::api_version_major(version), vk::api_version_minor(version), vk::api_version_patch(version)),
        uuid: id.device_uuid.iter().map(|byte| format!("{byte:02x}")).collect(),
        max_image_3d: basic.limits.max_image_dimension3_d,
        max_storage_range: u64::from(basic.limits.max_storage_buffer_range),
        max_allocation: maintenance.max_memory_allocation_size,
        heap_bytes,
        driver_version: basic.driver_version,
    }
}

fn text(chars: &[c_char]) -> String {
    let bytes: Vec<u8> = chars.iter().map(|&c| c.cast_unsigned()).collect();
    CStr::from_bytes_until_nul(&bytes).map(|c| c.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The device of the wanted index, uuid or name; without a wish the fastest kind.
pub(super) fn choose(all: Vec<(vk::PhysicalDevice, DeviceInfo)>, wanted: Option<&str>) -> Result<(vk::PhysicalDevice, DeviceInfo)> {
    if all.is_empty() {
        return Err(no_driver());
    }
    let Some(wanted) = wanted else {
        // Ties go to the loader's order.
        return all.into_iter().min_by_key(|(_, info)| (info.kind, info.index)).ok_or_else(no_driver);
    };
    let lower = wanted.to_lowercase();
    let names: Vec<String> = all.iter().map(|(_, info)| format!("{}: {} [{}]", info.index, info.name, info.uuid)).collect();
    all.into_iter()
        .find(|(_, info)| match wanted.parse::<usize>() {
            Ok(index) if wanted.len() < 4 => info.index == index,
            _ => !lower.is_empty() && (info.uuid == lower.replace('-', "") || info.name.to_lowercase().contains(&lower)),
        })
        .ok_or_else(|| Error::NoDevice {
            what: format!("none is called '{wanted}'"),
            right: format!("choose by index, part of the name, or uuid: {}", names.join("; ")),
        })
}

pub(super) fn no_driver() -> Error {
    Error::NoDevice {
        what: String::from("the Vulkan loader finds no driver that works"),
        right: String::from(
            "install one (Debian: `apt-get install mesa-vulkan-drivers` runs on any processor), and see that VK_DRIVER_FILES and \
             VK_ICD_FILENAMES, where set, name existing files",
        ),
    }
}
