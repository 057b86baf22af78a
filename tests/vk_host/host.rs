//! A host that made its own Vulkan: instance with the validation layers, device, one queue under a lock; and what it sees of us
//! through the functions that it hands over.

use ash::vk::{self, Handle};
use halflight::engine::host::{Features, GetInstanceProcAddr, HostDevice, HostDeviceParts, HostQueue, QueueLock};
use std::cell::Cell;
use std::ffi::{CStr, c_char, c_void};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Condvar, Mutex, RwLock};

/// What the hooks below saw; one process, one host at a time (see `ALONE`).
#[derive(Default)]
pub struct Seen {
    pub submits: AtomicU32,
    /// Submissions by a thread that did not hold the lock.
    pub unguarded: AtomicU32,
    /// Other calls of Vulkan by a thread that held it.
    pub others: AtomicU32,
    /// `vkDestroyDevice`, `vkDestroyInstance`, `vkDeviceWaitIdle`, `vkQueueWaitIdle` through our table.
    pub never: AtomicU32,
    pub locks: AtomicU32,
    pub unlocks: AtomicU32,
}

pub static SEEN: Seen = Seen {
    submits: AtomicU32::new(0),
    unguarded: AtomicU32::new(0),
    others: AtomicU32::new(0),
    never: AtomicU32::new(0),
    locks: AtomicU32::new(0),
    unlocks: AtomicU32::new(0),
};

thread_local! {
    static HOLDS: Cell<bool> = const { Cell::new(false) };
}

/// Of the host at hand: layers are unloaded with their instance.
#[derive(Clone, Copy)]
struct Table {
    instance_proc: vk::PFN_vkGetInstanceProcAddr,
    device_proc: vk::PFN_vkGetDeviceProcAddr,
    submit: vk::PFN_vkQueueSubmit2,
    wait: vk::PFN_vkWaitForFences,
    end: vk::PFN_vkEndCommandBuffer,
}

static TABLE: RwLock<Option<Table>> = RwLock::new(None);

fn table() -> Table {
    TABLE.read().unwrap().expect("the host was made")
}

unsafe extern "system" fn hooked_instance_proc(instance: *mut c_void, name: *const c_char) -> Option<unsafe extern "system" fn()> {
    // SAFETY: the library hands over C strings, and hears the functions that it asks for.
    unsafe {
        if CStr::from_ptr(name) == c"vkGetDeviceProcAddr" {
            let hook: vk::PFN_vkGetDeviceProcAddr = hooked_device_proc;
            return std::mem::transmute::<vk::PFN_vkGetDeviceProcAddr, vk::PFN_vkVoidFunction>(hook);
        }
        (table().instance_proc)(vk::Instance::from_raw(instance as u64), name)
    }
}

unsafe extern "system" fn hooked_device_proc(device: vk::Device, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: as above; each hook is of the type of the function that it stands for.
    unsafe {
        match CStr::from_ptr(name).to_bytes() {
            b"vkQueueSubmit2" => std::mem::transmute::<vk::PFN_vkQueueSubmit2, vk::PFN_vkVoidFunction>(submit),
            b"vkWaitForFences" => std::mem::transmute::<vk::PFN_vkWaitForFences, vk::PFN_vkVoidFunction>(wait),
            b"vkEndCommandBuffer" => std::mem::transmute::<vk::PFN_vkEndCommandBuffer, vk::PFN_vkVoidFunction>(end),
            b"vkDeviceWaitIdle" | b"vkQueueWaitIdle" | b"vkDestroyDevice" | b"vkQueueSubmit" => {
                std::mem::transmute::<unsafe extern "system" fn() -> i32, vk::PFN_vkVoidFunction>(never)
            }
            _ => (table().device_proc)(device, name),
        }
    }
}

unsafe extern "system" fn submit(queue: vk::Queue, n: u32, infos: *const vk::SubmitInfo2<'_>, fence: vk::Fence) -> vk::Result {
    SEEN.submits.fetch_add(1, Ordering::SeqCst);
    SEEN.unguarded.fetch_add(u32::from(!HOLDS.get()), Ordering::SeqCst);
    // SAFETY: handed through.
    unsafe { (table().submit)(queue, n, infos, fence) }
}

unsafe extern "system" fn wait(device: vk::Device, n: u32, fences: *const vk::Fence, all: vk::Bool32, time: u64) -> vk::Result {
    SEEN.others.fetch_add(u32::from(HOLDS.get()), Ordering::SeqCst);
    // SAFETY: handed through.
    unsafe { (table().wait)(device, n, fences, all, time) }
}

unsafe extern "system" fn end(commands: vk::CommandBuffer) -> vk::Result {
    SEEN.others.fetch_add(u32::from(HOLDS.get()), Ordering::SeqCst);
    // SAFETY: handed through.
    unsafe { (table().end)(commands) }
}

unsafe extern "system" fn never() -> i32 {
    SEEN.never.fetch_add(1, Ordering::SeqCst);
    0
}

/// The host's lock of its queue: not recursive, and not tied to a thread.
pub struct QueueMutex {
    taken: Mutex<bool>,
    free: Condvar,
}

impl QueueMutex {
    pub fn lock(&self) {
        let mut taken = self.taken.lock().unwrap();
        while *taken {
            taken = self.free.wait(taken).unwrap();
        }
        *taken = true;
    }

    pub fn unlock(&self) {
        let mut taken = self.taken.lock().unwrap();
        assert!(*taken);
        *taken = false;
        self.free.notify_one();
    }
}

unsafe extern "C" fn lock(user: *mut c_void, family: u32, index: u32) {
    assert!((family, index) == (0, 0) && !HOLDS.get(), "one lock at a time");
    // SAFETY: the pointer that the host gave.
    unsafe { &*user.cast::<QueueMutex>() }.lock();
    HOLDS.set(true);
    SEEN.locks.fetch_add(1, Ordering::SeqCst);
}

unsafe extern "C" fn unlock(user: *mut c_void, _: u32, _: u32) {
    assert!(HOLDS.replace(false));
    SEEN.unlocks.fetch_add(1, Ordering::SeqCst);
    // SAFETY: the pointer that the host gave.
    unsafe { &*user.cast::<QueueMutex>() }.unlock();
}

unsafe extern "system" fn heard(
    severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    if severity.contains(vk::DebugUtilsMessageSeverityFlagsEXT::ERROR) {
        // SAFETY: the layers hand over valid pointers, and the list that the messenger was made with.
        unsafe {
            let text = (*data).message_as_c_str().map(|t| t.to_string_lossy().into_owned()).unwrap_or_default();
            (*user.cast::<Mutex<Vec<String>>>()).lock().unwrap().push(text);
        }
    }
    vk::FALSE
}

/// Tests of this file run one after the other: the hooks count for all.
static ALONE: Mutex<()> = Mutex::new(());

pub struct Host {
    pub device: ash::Device,
    pub instance: ash::Instance,
    pub physical: vk::PhysicalDevice,
    pub queue: vk::Queue,
    pub guard: Box<QueueMutex>,
    messages: Box<Mutex<Vec<String>>>,
    messenger: (ash::ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT),
    _entry: ash::Entry,
    _alone: std::sync::MutexGuard<'static, ()>,
}

impl Host {
    pub fn new() -> Self {
        Self::with_layers(true)
    }

    /// `layers`: with validation.
    pub fn with_layers(layers: bool) -> Self {
        let alone = ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        for count in [&SEEN.submits, &SEEN.unguarded, &SEEN.others, &SEEN.never, &SEEN.locks, &SEEN.unlocks] {
            count.store(0, Ordering::SeqCst);
        }
        // SAFETY: plain Vulkan, in order; everything is destroyed in `drop`.
        unsafe {
            let entry = ash::Entry::load().unwrap();
            let app = vk::ApplicationInfo::default().application_name(c"a host").api_version(vk::API_VERSION_1_3);
            let layers = if layers { vec![c"VK_LAYER_KHRONOS_validation".as_ptr()] } else { Vec::new() };
            let mut extensions = vec![ash::ext::debug_utils::NAME.as_ptr()];
            if !layers.is_empty() {
                extensions.push(ash::ext::validation_features::NAME.as_ptr());
            }
            let on = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
            let mut validation = vk::ValidationFeaturesEXT::default().enabled_validation_features(&on);
            let create =
                vk::InstanceCreateInfo::default().application_info(&app).enabled_layer_names(&layers).enabled_extension_names(&extensions);
            let create = if layers.is_empty() { create } else { create.push_next(&mut validation) };
            let instance = entry.create_instance(&create, None).unwrap();
            let messages: Box<Mutex<Vec<String>>> = Box::default();
            let debug = ash::ext::debug_utils::Instance::new(&entry, &instance);
            let create = vk::DebugUtilsMessengerCreateInfoEXT::default()
                .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::ERROR)
                .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
                .pfn_user_callback(Some(heard))
                .user_data(std::ptr::from_ref(&*messages).cast_mut().cast());
            let messenger = debug.create_debug_utils_messenger(&create, None).unwrap();
            let physical = instance.enumerate_physical_devices().unwrap()[0];
            let priorities = [1.0];
            let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(0).queue_priorities(&priorities)];
            let basic = vk::PhysicalDeviceFeatures::default()
                .shader_storage_image_extended_formats(true)
                .shader_storage_image_write_without_format(true);
            let mut twelve = vk::PhysicalDeviceVulkan12Features::default().timeline_semaphore(true);
            let mut thirteen = vk::PhysicalDeviceVulkan13Features::default().synchronization2(true).maintenance4(true);
            let mut features = vk::PhysicalDeviceFeatures2::default().features(basic).push_next(&mut twelve).push_next(&mut thirteen);
            let create = vk::DeviceCreateInfo::default().queue_create_infos(&queues).push_next(&mut features);
            assert_eq!(Features::of_chain(create.p_next), all_features(), "the chain says what is enabled");
            let device = instance.create_device(physical, &create, None).unwrap();
            let queue = device.get_device_queue(0, 0);
            *TABLE.write().unwrap() = Some(Table {
                instance_proc: entry.static_fn().get_instance_proc_addr,
                device_proc: instance.fp_v1_0().get_device_proc_addr,
                submit: device.fp_v1_3().queue_submit2,
                wait: device.fp_v1_0().wait_for_fences,
                end: device.fp_v1_0().end_command_buffer,
            });
            Self {
                device,
                instance,
                physical,
                queue,
                guard: Box::new(QueueMutex { taken: Mutex::new(false), free: Condvar::new() }),
                messages,
                messenger: (debug, messenger),
                _entry: entry,
                _alone: alone,
            }
        }
    }

    pub fn parts(&self) -> HostDeviceParts {
        let get: GetInstanceProcAddr = hooked_instance_proc;
        HostDeviceParts {
            get_instance_proc_addr: get,
            instance: self.instance.handle().as_raw(),
            physical_device: self.physical.as_raw(),
            device: self.device.handle().as_raw(),
            api_version: vk::API_VERSION_1_3,
            extensions: vec![String::from("VK_EXT_debug_utils")],
            features: all_features(),
            queues: vec![HostQueue { family: 0, index: 0, flags: 0 }],
            lock: Some(QueueLock { lock, unlock, user: std::ptr::from_ref(&*self.guard).cast_mut().cast() }),
        }
    }

    pub fn handed_over(&self) -> HostDevice {
        // SAFETY: the host outlives its engines in these tests, and its parts are true.
        unsafe { HostDevice::new(self.parts()) }
    }

    pub fn messages(&self) -> Vec<String> {
        self.messages.lock().unwrap().clone()
    }
}

pub fn all_features() -> Features {
    Features::REQUIRED.with(Features::TIMELINE_SEMAPHORE)
}

impl Drop for Host {
    fn drop(&mut self) {
        // SAFETY: made here; the engines on it are gone.
        unsafe {
            self.device.device_wait_idle().unwrap();
            self.device.destroy_device(None);
            self.messenger.0.destroy_debug_utils_messenger(self.messenger.1, None);
            self.instance.destroy_instance(None);
        }
        if !std::thread::panicking() {
            assert_eq!(self.messages(), Vec::<String>::new(), "validation must be clean");
            assert_eq!(SEEN.never.load(Ordering::SeqCst), 0, "whole-device calls are the host's");
        }
    }
}
