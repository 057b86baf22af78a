//! The same through the C interface: volumes from the host's image and buffer are planned, measured, cut and shown as those
//! from main memory.

use crate::host::Host;
use crate::work::{Bytes, Clock, Commands, Texels};
use ash::vk::{self, Handle};
use halflight::ffi::*;
use std::ffi::{CStr, c_char, c_void};
use std::ptr::{from_ref, null, null_mut, without_provenance_mut};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

fn init<T: abi::Sized_>(kind: i32) -> T {
    // SAFETY: any bytes are a value of such a struct, and each begins with its size and type.
    unsafe {
        let mut value: T = std::mem::MaybeUninit::zeroed().assume_init();
        std::ptr::from_mut(&mut value).cast::<u32>().write(size_of::<T>() as u32);
        std::ptr::from_mut(&mut value).cast::<i32>().add(1).write(kind);
        value
    }
}

/// The sentence to this thread's last fault.
fn last() -> String {
    let mut text = [0 as c_char; 1024];
    // SAFETY: there is room for so many bytes.
    unsafe {
        hl_last_error(null(), text.as_mut_ptr(), text.len() as u64);
        CStr::from_ptr(text.as_ptr()).to_string_lossy().into_owned()
    }
}

macro_rules! ok {
    ($call:expr) => {{
        // SAFETY: the test hands over what the headers ask for.
        let status = unsafe { $call };
        assert_eq!(status, HL_OK, "{}: {}", stringify!($call), last());
    }};
}

/// An engine of the C interface on the host's device.
fn engine(host: &Host) -> *mut hl_engine {
    let parts = host.parts();
    let basic =
        vk::PhysicalDeviceFeatures::default().shader_storage_image_extended_formats(true).shader_storage_image_write_without_format(true);
    let mut twelve = vk::PhysicalDeviceVulkan12Features::default().timeline_semaphore(true);
    let mut thirteen = vk::PhysicalDeviceVulkan13Features::default().synchronization2(true).maintenance4(true);
    let features = vk::PhysicalDeviceFeatures2::default().features(basic).push_next(&mut twelve).push_next(&mut thirteen);
    let extensions = [c"VK_EXT_debug_utils".as_ptr()];
    let queue = hl_vulkan_queue { family: 0, index: 0, flags: 0 };
    let lock = parts.lock.as_ref().expect("a lock");
    let pointer = |handle: u64| without_provenance_mut::<c_void>(handle as usize);
    let lent = hl_vulkan_device {
        // SAFETY: both are pointers to vkGetInstanceProcAddr.
        loader: unsafe { std::mem::transmute::<*const (), hl_vulkan_loader>(parts.get_instance_proc_addr as *const ()) },
        instance: pointer(parts.instance),
        physical_device: pointer(parts.physical_device),
        device: pointer(parts.device),
        features: from_ref(&features).cast(),
        extensions: extensions.as_ptr(),
        extension_count: 1,
        queues: &queue,
        queue_count: 1,
        lock_queue: Some(lock.lock),
        unlock_queue: Some(lock.unlock),
        lock_user: lock.user,
        api_version: parts.api_version,
        ..init(HL_STRUCT_VULKAN_DEVICE)
    };
    let mut engine = null_mut();
    let info = hl_engine_info { next: from_ref(&lent).cast(), ..init(0) };
    ok!(hl_engine_create(&info, &mut engine));
    engine
}

const N: usize = 16;

fn blob() -> Vec<u8> {
    let at = |i: usize| (i as f64 + 0.5) / N as f64 - 0.5;
    let value = |x: usize, y: usize, z: usize| (255.0 * (1.0 - (at(x).powi(2) + at(y).powi(2) + at(z).powi(2)).sqrt() / 0.45)) as u8;
    (0..N * N * N).map(|i| value(i % N, i / N % N, i / N / N)).collect()
}

/// What is seen of a volume, and what was measured.
fn seen(engine: *mut hl_engine, volume: *mut hl_volume) -> (Vec<f32>, [f64; 3], Vec<u64>) {
    let (mut field, mut image, mut found) = (null_mut(), null_mut(), init::<hl_field_info>(0));
    let clip = hl_clip { high: [0.7, 1.0, 1.0], ..init(0) };
    let info = hl_precompute_info { volume, clip: &clip, method: HL_METHOD_SWEEP, directions: 32, measure: 1, ..init(0) };
    ok!(hl_precompute(engine, &info, &mut field));
    ok!(hl_field_get_info(field, &mut found));
    ok!(hl_render(engine, &hl_render_info { field, width: 24, height: 18, ..init(0) }, &mut image));
    let mut pixels = vec![0f32; 24 * 18 * 4];
    ok!(hl_image_read(image, HL_RGBA32F, 0.0, pixels.as_mut_ptr().cast(), 0, 4 * pixels.len() as u64));
    let mut bins = vec![0u64; 64];
    ok!(hl_volume_get_histogram(volume, bins.as_mut_ptr(), null_mut()));
    (pixels, [found.error, found.error_low, found.error_high], bins)
}

unsafe extern "C-unwind" fn stop(_: *mut c_void, _: *const c_char, _: f32) -> i32 {
    1
}

unsafe extern "C-unwind" fn never(_: *mut c_void, _: *const c_void) {
    panic!("nothing was borrowed");
}

#[test]
fn volumes_of_the_hosts_device_are_planned_and_measured() {
    let host = Host::new();
    let engine = engine(&host);
    let data = blob();
    let (mut plain, mut buffered, mut imaged) = (null_mut(), null_mut(), null_mut());
    let info = hl_volume_info { data: data.as_ptr().cast(), dims: [N as u32; 3], r#type: HL_UINT8, ..init(0) };
    ok!(hl_volume_create(engine, &info, &mut plain));
    let expected = seen(engine, plain);
    assert!(expected.0.iter().any(|&v| v > 0.1) && expected.1[0] > 0.0, "{:?}", expected.1);

    let (source, clock) = (Bytes::of(&host, &data), Clock::new(&host));
    let mut back = 0;
    let end = clock.at(2).expect("a time");
    let lent = hl_vulkan_buffer {
        buffer: source.buffer.as_raw(),
        size: source.size,
        queue_family: HL_VULKAN_NO_FAMILY,
        signal_semaphore: end.semaphore,
        signal_value: end.value,
        handed_back: &mut back,
        ..init(HL_STRUCT_VULKAN_BUFFER)
    };
    let info = hl_volume_info { data: null(), next: from_ref(&lent).cast(), ..info };
    ok!(hl_volume_create(engine, &info, &mut buffered));
    assert!(back == 1 && clock.reaches(2));
    assert_eq!(seen(engine, buffered), expected);
    // One number a voxel, and not both places.
    let two = hl_volume_info { components: 2, component: 1, ..info };
    // SAFETY: what is wrong is found out.
    assert_eq!(unsafe { hl_volume_create(engine, &two, &mut imaged) }, HL_ERROR_INVALID);
    assert!(last().contains("one number a voxel"), "{}", last());
    // A refusal says that the thing was not touched.
    assert_eq!(back, 0);
    for wrong in [
        hl_volume_info { dims: [0; 3], ..info },
        hl_volume_info { r#type: HL_INT64, ..info },
        hl_volume_info { data: data.as_ptr().cast(), ..info },
        // What holds for samples in main memory alone is refused, not passed over.
        hl_volume_info { strides: [1, N as i64, (N * N) as i64], ..info },
        hl_volume_info { memory: HL_BORROW, ..info },
        hl_volume_info { release: Some(never), ..info },
        hl_volume_info { release_user: std::ptr::without_provenance_mut(7), ..info },
        hl_volume_info { replace_nan: 1, ..info },
        hl_volume_info { nan_as: 1.0, ..info },
    ] {
        back = 1;
        // SAFETY: as above.
        assert_eq!(unsafe { hl_volume_create(engine, &wrong, &mut imaged) }, HL_ERROR_INVALID);
        assert_eq!(back, 0, "{}", last());
        assert!(last().contains(';'), "{}", last());
    }
    back = 1;
    let spare = hl_vulkan_buffer { reserved: 1, ..lent };
    let wrong = hl_volume_info { next: from_ref(&spare).cast(), ..info };
    // SAFETY: as above.
    assert_eq!(unsafe { hl_volume_create(engine, &wrong, &mut imaged) }, HL_ERROR_INVALID);
    assert!(last().contains("reserved") && back == 0, "{back} {}", last());

    let texels = Texels::new(&host, vk::Format::R8_UNORM, [N as u32; 3]);
    let commands = Commands::begin(&host);
    texels.fill(&commands, &source, vk::ImageLayout::GENERAL);
    commands.submit(None, clock.at(3));
    let start = clock.at(3).expect("a time");
    let lent = hl_vulkan_image {
        image: texels.image.as_raw(),
        format: texels.format.as_raw(),
        extent: texels.extent,
        usage: texels.usage.as_raw(),
        layout: vk::ImageLayout::GENERAL.as_raw(),
        queue_family: HL_VULKAN_NO_FAMILY,
        wait_semaphore: start.semaphore,
        wait_value: start.value,
        ..init(HL_STRUCT_VULKAN_IMAGE)
    };
    let typed = hl_volume_info { next: from_ref(&lent).cast(), ..info };
    // SAFETY: as above.
    assert_eq!(unsafe { hl_volume_create(engine, &typed, &mut imaged) }, HL_ERROR_INVALID);
    assert!(last().contains("hl_volume_info.type"), "{}", last());
    let info = hl_volume_info { r#type: 0, ..typed };
    ok!(hl_volume_create(engine, &info, &mut imaged));
    assert_eq!(seen(engine, imaged), expected);
    // A picture that is cancelled before, or refused, leaves the image alone and says so.
    let (mut field, mut none) = (null_mut(), null_mut());
    ok!(hl_precompute(engine, &hl_precompute_info { volume: plain, directions: 8, ..init(0) }, &mut field));
    let target = hl_vulkan_image { handed_back: &mut back, ..lent };
    let picture = hl_render_info { field, next: from_ref(&target).cast(), width: 8, height: 8, ..init(0) };
    let cancelled = hl_render_info { progress: Some(stop), ..picture };
    for (wrong, status) in [(cancelled, HL_ERROR_CANCELLED), (hl_render_info { field: null_mut(), ..picture }, HL_ERROR_HANDLE)] {
        back = 1;
        // SAFETY: as above.
        assert_eq!(unsafe { hl_render(engine, &wrong, &mut none) }, status, "{}", last());
        assert_eq!(back, 0, "{}", last());
    }

    back = 1;
    // SAFETY: as above.
    assert_eq!(unsafe { hl_render(null_mut(), &picture, &mut none) }, HL_ERROR_HANDLE);
    assert_eq!(back, 0);
    for (of, at) in [(null_mut(), &raw mut imaged), (engine, null_mut())] {
        back = 1;
        let info = hl_volume_info { next: from_ref(&target).cast(), ..info };
        // SAFETY: as above.
        assert_ne!(unsafe { hl_volume_create(of, &info, at) }, HL_OK);
        assert_eq!(back, 0, "{}", last());
    }

    // A plan keeps its word there, and may be asked what it costs.
    let info = hl_precompute_info { volume: buffered, tolerance: 0.15, progressive: 1, ..init(0) };
    let (mut cost, mut job, mut state) = (init::<hl_estimate>(0), null_mut(), init::<hl_job_state>(0));
    ok!(hl_precompute_estimate(engine, &info, &mut cost));
    assert!(cost.seconds > 0.0 && cost.peak > cost.result && cost.result > 0);
    ok!(hl_precompute_start(engine, &info, &mut job));
    ok!(hl_job_wait(job, -1.0));
    ok!(hl_job_poll(job, &mut state));
    assert!(state.error > 0.0 && state.error_high <= 0.15 && state.passes >= 1, "{} {}", state.error, state.error_high);
    // Sabotage: a volume that differs in one slice is told apart.
    let mut other = data.clone();
    other[N * N * N / 2..N * N * N / 2 + N * N].fill(0);
    let info = hl_volume_info { data: other.as_ptr().cast(), dims: [N as u32; 3], r#type: HL_UINT8, ..init(0) };
    let mut wrong = null_mut();
    ok!(hl_volume_create(engine, &info, &mut wrong));
    assert_ne!(seen(engine, wrong), expected);
    ok!(hl_engine_destroy(engine));
}

#[test]
fn a_device_of_our_own_takes_nothing_of_the_hosts() {
    let host = Host::new();
    let theirs = engine(&host);
    let mut ours = null_mut();
    ok!(hl_engine_create(null(), &mut ours));
    let (source, mut back, mut made) = (Bytes::of(&host, &blob()), 1, null_mut());
    let buffer = hl_vulkan_buffer {
        buffer: source.buffer.as_raw(),
        size: source.size,
        queue_family: HL_VULKAN_NO_FAMILY,
        handed_back: &mut back,
        ..init(HL_STRUCT_VULKAN_BUFFER)
    };
    let buffer = hl_volume_info { next: from_ref(&buffer).cast(), dims: [N as u32; 3], r#type: HL_UINT8, ..init(0) };
    let lent = |texels: &Texels| hl_vulkan_image {
        image: texels.image.as_raw(),
        format: texels.format.as_raw(),
        extent: texels.extent,
        usage: texels.usage.as_raw(),
        layout: vk::ImageLayout::GENERAL.as_raw(),
        queue_family: HL_VULKAN_NO_FAMILY,
        ..init(HL_STRUCT_VULKAN_IMAGE)
    };
    let texels = Texels::new(&host, vk::Format::R8_UNORM, [N as u32; 3]);
    let image = lent(&texels);
    let image = hl_volume_info { next: from_ref(&image).cast(), r#type: 0, ..buffer };
    for info in [buffer, image] {
        // SAFETY: what is wrong is found out.
        assert_eq!(unsafe { hl_volume_create(ours, &info, &mut made) }, HL_ERROR_INVALID);
        assert!(made.is_null() && last().contains("of another device"), "{}", last());
    }
    assert_eq!(back, 0);
    // The same buffer is a volume where it belongs.
    ok!(hl_volume_create(theirs, &buffer, &mut made));
    assert_eq!(back, 1);
    let (mut volume, mut field, data) = (null_mut(), null_mut(), blob());
    let info = hl_volume_info { data: data.as_ptr().cast(), next: null(), ..buffer };
    ok!(hl_volume_create(ours, &info, &mut volume));
    ok!(hl_precompute(ours, &hl_precompute_info { volume, directions: 8, ..init(0) }, &mut field));
    let texels = Texels::new(&host, vk::Format::R32G32B32A32_SFLOAT, [8, 8, 1]);
    let target = lent(&texels);
    let picture = hl_render_info { field, next: from_ref(&target).cast(), width: 8, height: 8, ..init(0) };
    // SAFETY: as above.
    assert_eq!(unsafe { hl_render(ours, &picture, null_mut()) }, HL_ERROR_INVALID);
    assert!(last().contains("of another device"), "{}", last());
    ok!(hl_engine_destroy(ours));
    ok!(hl_engine_destroy(theirs));
}

#[test]
fn an_engine_ends_after_those_who_wait_for_its_jobs() {
    let host = Host::new();
    let engine = engine(&host);
    let data = blob();
    let mut volume = null_mut();
    let info = hl_volume_info { data: data.as_ptr().cast(), dims: [N as u32; 3], r#type: HL_UINT8, ..init(0) };
    ok!(hl_volume_create(engine, &info, &mut volume));
    let long = hl_precompute_info { method: HL_METHOD_SWEEP, directions: 4096, ratio: 1, near_slices: 8, progressive: 1, ..init(0) };
    let mut job = null_mut();
    ok!(hl_precompute_start(engine, &hl_precompute_info { volume, ..long }, &mut job));
    let mut state: hl_job_state = init(0);
    while state.passes == 0 {
        ok!(hl_job_poll(job, &mut state));
        assert_eq!(state.status, HL_NOT_READY);
        std::thread::sleep(Duration::from_millis(1));
    }
    let (job, begun) = (job.addr(), AtomicUsize::new(0));
    std::thread::scope(|scope| {
        for _ in 0..200 {
            scope.spawn(|| {
                begun.fetch_add(1, Ordering::SeqCst);
                // SAFETY: a job of ours, which may be gone by now.
                let status = unsafe { hl_job_wait(without_provenance_mut(job), -1.0) };
                assert_eq!(status, HL_ERROR_CANCELLED, "{}", last());
            });
        }
        // Whoever asks for the field has it before the end, or hears that there is none.
        scope.spawn(|| {
            begun.fetch_add(1, Ordering::SeqCst);
            loop {
                let mut field = null_mut();
                // SAFETY: as above.
                match unsafe { hl_job_get_field(without_provenance_mut(job), &mut field) } {
                    HL_OK => assert!(!field.is_null()),
                    gone => break assert!(gone == HL_ERROR_HANDLE && field.is_null(), "{gone}"),
                }
                std::thread::sleep(Duration::from_millis(1));
            }
        });
        while begun.load(Ordering::SeqCst) < 201 {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_millis(20));
        ok!(hl_engine_destroy(engine));
        // Whatever were still on the device, the layers would name, and the host complains of that.
        drop(host);
    });
}
