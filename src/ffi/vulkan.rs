//! `hl_vulkan_*`: the host's own device, its images and buffers.

use super::abi::*;
use super::abi_vulkan::*;
use super::call::{alone, choice, copy_text, enter, fill, look, numbers, put, read_as, text, unreserved};
use super::fault::{Fault, Result};
use super::host::call_back;
use crate::engine::host::{
    Features, GetInstanceProcAddr, HostBuffer, HostBufferParts, HostDevice, HostDeviceParts, HostImage, HostImageParts, HostQueue,
    QueueLock, SampleType, Timeline, lacking, requirements,
};
use crate::engine::{DeviceVolume, Engine, Options};
use crate::scene::Grid;
use std::ffi::{c_char, c_void};

/// Entries of a list that are taken seriously.
const MAX_LIST: u32 = 4096;

/// A queue's guard with the engine that it belongs to, so that calls from within are found out.
pub(super) struct Guard {
    engine: usize,
    lock: unsafe extern "C" fn(*mut c_void, u32, u32),
    unlock: unsafe extern "C" fn(*mut c_void, u32, u32),
    user: *mut c_void,
}

// SAFETY: the header says that both functions may be called on any thread with this pointer.
unsafe impl Send for Guard {}
// SAFETY: as above.
unsafe impl Sync for Guard {}

unsafe extern "C" fn lock(guard: *mut c_void, family: u32, index: u32) {
    // SAFETY: `open` hands this function over with its own guard, which outlives the device.
    let guard = unsafe { &*guard.cast::<Guard>() };
    // SAFETY: the host's own function and pointer.
    call_back(guard.engine, || unsafe { (guard.lock)(guard.user, family, index) });
}

unsafe extern "C" fn unlock(guard: *mut c_void, family: u32, index: u32) {
    // SAFETY: as above.
    let guard = unsafe { &*guard.cast::<Guard>() };
    // SAFETY: as above.
    call_back(guard.engine, || unsafe { (guard.unlock)(guard.user, family, index) });
}

/// An engine on the device that `next` describes, and what must outlive it.
pub(super) fn open(id: usize, next: *const c_void, options: &Options) -> Result<(Engine, Option<Box<Guard>>)> {
    const ITEM: &str = "hl_vulkan_device";
    let info: hl_vulkan_device = read_as(ITEM, next.cast(), HL_STRUCT_VULKAN_DEVICE)?;
    alone(ITEM, info.next)?;
    let loader = loader(info.loader)?;
    if info.queue_count == 0 || info.queue_count > MAX_LIST || info.extension_count > MAX_LIST {
        let what = format!("lists {} queues and {} extensions", info.queue_count, info.extension_count);
        return Err(Fault::invalid(ITEM, what, "at least one queue, and at most 4096 of each, are taken"));
    }
    let queues = numbers("hl_vulkan_device.queues", info.queues, info.queue_count as usize)?;
    let extensions = match info.extension_count {
        0 => Vec::new(),
        n => numbers("hl_vulkan_device.extensions", info.extensions, n as usize)?,
    };
    let extensions = extensions.iter().filter_map(|&e| text(e)).map(|e| e.to_string_lossy().into_owned()).collect();
    let guard = match (info.lock_queue, info.unlock_queue) {
        (Some(lock), Some(unlock)) => Some(Box::new(Guard { engine: id, lock, unlock, user: info.lock_user })),
        (None, None) => None,
        _ => {
            return Err(Fault::invalid(
                "hl_vulkan_device.lock_queue",
                "stands without unlock_queue, or that without it",
                "give both or none",
            ));
        }
    };
    let user = |guard: &Guard| std::ptr::from_ref(guard).cast_mut().cast();
    let parts = HostDeviceParts {
        get_instance_proc_addr: loader,
        instance: info.instance.addr() as u64,
        physical_device: info.physical_device.addr() as u64,
        device: info.device.addr() as u64,
        api_version: info.api_version,
        extensions,
        // SAFETY: the header says that this is the chain that the device was made with.
        features: unsafe { Features::of_chain(info.features) },
        queues: queues.iter().map(|q| HostQueue { family: q.family, index: q.index, flags: q.flags }).collect(),
        lock: guard.as_deref().map(|g| QueueLock { lock, unlock, user: user(g) }),
    };
    // SAFETY: the header asks the host for all that this asks for.
    let host = unsafe { HostDevice::new(parts) };
    Ok((Engine::on_host(&host, options)?, guard))
}

fn loader(loader: hl_vulkan_loader) -> Result<GetInstanceProcAddr> {
    let Some(loader) = loader else { return Err(Fault::invalid("loader", "is NULL", "vkGetInstanceProcAddr is needed")) };
    // SAFETY: both are pointers to vkGetInstanceProcAddr; its calling convention is the platform's own, which on the
    // platforms of this interface is C's.
    Ok(unsafe {
        std::mem::transmute::<unsafe extern "C" fn(*mut c_void, *const c_char) -> hl_vulkan_function, GetInstanceProcAddr>(loader)
    })
}

/// What a volume may come from.
pub(super) enum Source {
    Image(hl_vulkan_image),
    Buffer(hl_vulkan_buffer),
}

impl Source {
    /// The source that `next` describes.
    pub fn of(next: *const c_void) -> Result<Self> {
        const ITEM: &str = "hl_volume_info.next";
        // SAFETY: every extension begins with the header.
        let header = unsafe { next.cast::<hl_header>().read_unaligned() };
        match header.struct_type {
            HL_STRUCT_VULKAN_BUFFER => {
                let buffer: hl_vulkan_buffer = look(ITEM, next.cast(), HL_STRUCT_VULKAN_BUFFER)?;
                // Whatever is refused from here on.
                tell(buffer.handed_back, false);
                unreserved(ITEM, &buffer)?;
                alone("hl_vulkan_buffer", buffer.next)?;
                Ok(Self::Buffer(buffer))
            }
            _ => image(ITEM, next).map(Self::Image),
        }
    }

    /// Brings the volume to the engine's memory.
    pub fn upload(&self, engine: &Engine, kind: i32, grid: &Grid, rescale: (f32, f32)) -> Result<DeviceVolume> {
        match self {
            Self::Image(info) => {
                let mut image = host_image(info);
                let made = engine.upload_image(&mut image, grid, rescale);
                tell(info.handed_back, image.handed_back());
                Ok(made?)
            }
            Self::Buffer(info) => {
                let kinds = [
                    (HL_UINT8, SampleType::U8),
                    (HL_INT8, SampleType::I8),
                    (HL_UINT16, SampleType::U16),
                    (HL_INT16, SampleType::I16),
                    (HL_FLOAT32, SampleType::F32),
                ];
                let samples = choice("hl_volume_info.type of a buffer", kind, &kinds)?;
                let parts = HostBufferParts {
                    buffer: info.buffer,
                    size: info.size,
                    offset: info.offset,
                    row_bytes: info.row_bytes,
                    slice_bytes: info.slice_bytes,
                    queue_family: info.queue_family,
                    wait: timeline(info.wait_semaphore, info.wait_value),
                    signal: timeline(info.signal_semaphore, info.signal_value),
                };
                // SAFETY: the header asks the host for all that this asks for.
                let mut buffer = unsafe { HostBuffer::new(parts) };
                let made = engine.upload_buffer(&mut buffer, samples, grid, rescale);
                tell(info.handed_back, buffer.handed_back());
                Ok(made?)
            }
        }
    }
}

/// The image that an extension describes.
pub(super) fn image(item: &str, next: *const c_void) -> Result<hl_vulkan_image> {
    let image: hl_vulkan_image = read_as(item, next.cast(), HL_STRUCT_VULKAN_IMAGE)?;
    // Whatever is refused from here on.
    tell(image.handed_back, false);
    alone("hl_vulkan_image", image.next)?;
    if image.image == 0 {
        return Err(Fault::invalid("hl_vulkan_image.image", "is 0", "a VkImage is needed"));
    }
    Ok(image)
}

/// As the engine takes it.
pub(super) fn host_image(info: &hl_vulkan_image) -> HostImage {
    let parts = HostImageParts {
        image: info.image,
        format: info.format,
        extent: info.extent,
        usage: info.usage,
        layout: info.layout,
        layout_after: info.layout_after,
        queue_family: info.queue_family,
        wait: timeline(info.wait_semaphore, info.wait_value),
        signal: timeline(info.signal_semaphore, info.signal_value),
    };
    // SAFETY: the header asks the host for all that this asks for.
    unsafe { HostImage::new(parts) }
}

fn timeline(semaphore: u64, value: u64) -> Option<Timeline> {
    (semaphore != 0).then_some(Timeline { semaphore, value })
}

/// Tells the host whether its thing was handed back.
pub(super) fn tell(at: *mut i32, handed_back: bool) {
    put(at, i32::from(handed_back));
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_vulkan_get_requirement(index: u32, requirement: *mut hl_vulkan_requirement) -> hl_status {
    enter(|_| {
        let needs = requirements();
        let entry = |kind, required, value, format, name: &str, structure: &str| {
            (kind, i32::from(required), value, format, name.to_owned(), structure.to_owned())
        };
        let mut all = vec![
            entry(HL_VULKAN_API_VERSION, true, needs.api_version, 0, "apiVersion", "VkApplicationInfo"),
            entry(HL_VULKAN_QUEUE, true, needs.queue_flags, 0, "queueFlags", "VkQueueFamilyProperties"),
        ];
        all.extend(needs.features.iter().map(|f| entry(HL_VULKAN_FEATURE, f.required, 0, 0, f.name, f.structure)));
        all.extend(needs.formats.iter().map(|f| {
            let name = format!("{:?}", f.format);
            entry(HL_VULKAN_FORMAT, true, f.features, f.format.vulkan(), &name, "VkFormatProperties")
        }));
        all.extend(needs.instance_extensions.iter().map(|e| entry(HL_VULKAN_INSTANCE_EXTENSION, true, 0, 0, e, "VkInstanceCreateInfo")));
        all.extend(needs.device_extensions.iter().map(|e| entry(HL_VULKAN_DEVICE_EXTENSION, true, 0, 0, e, "VkDeviceCreateInfo")));
        all.extend(needs.optional_extensions.iter().map(|e| entry(HL_VULKAN_INSTANCE_EXTENSION, false, 0, 0, e, "VkInstanceCreateInfo")));
        let Some((kind, required, value, format, name, structure)) = all.get(index as usize) else { return Ok(HL_END) };
        fill("hl_vulkan_requirement", requirement, |out| {
            (out.kind, out.required, out.value, out.format) = (*kind, *required, *value, *format);
            copy_text(&mut out.name, name);
            copy_text(&mut out.structure, structure);
        })
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_vulkan_check(
    loader: hl_vulkan_loader,
    instance: *mut c_void,
    api_version: u32,
    physical_device: *mut c_void,
) -> hl_status {
    enter(|_| {
        let loader = self::loader(loader)?;
        let (instance, physical) = (instance.addr() as u64, physical_device.addr() as u64);
        // SAFETY: the caller says that they are alive and belong together.
        match unsafe { lacking(loader, instance, physical, api_version, &requirements()) }? {
            None => Ok(HL_OK),
            Some(lacks) => Err(Fault::new(HL_ERROR_DEVICE_LACKS, lacks)),
        }
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_vulkan_get_family(engine: *const hl_engine, family: *mut u32) -> hl_status {
    enter(|scope| {
        let engine = scope.engine(engine)?.engine()?;
        put(family, engine.queue_family());
        Ok(HL_OK)
    })
}
