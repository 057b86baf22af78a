//! Every function from within a callback, and with structs of wrong sizes.

use crate::scenes::*;
use crate::{Engine, init};
use halflight::ffi::*;
use std::collections::BTreeSet;
use std::ffi::{c_char, c_void};
use std::ptr::{null, null_mut};
use std::sync::Mutex;

/// One of each, of one engine; the job has ended.
#[derive(Clone, Copy)]
struct Handles {
    engine: *mut hl_engine,
    volume: *mut hl_volume,
    transfer: *mut hl_transfer,
    light: *mut hl_light,
    image: *mut hl_image,
    field: *mut hl_field,
    job: *mut hl_job,
}

// SAFETY: handles may be used on any thread.
unsafe impl Send for Handles {}

impl Handles {
    fn new(engine: &Engine) -> Self {
        let engine = engine.0;
        let (volume, mut light, mut job) = (volume(engine, 8), null_mut(), null_mut());
        ok!(hl_light_create(engine, null(), &mut light));
        let field = field(engine, &quick(volume));
        let view = hl_render_info { layers: HL_LAYER_OPACITY, ..small(field) };
        let image = image(engine, &view);
        ok!(hl_render_start(engine, &view, &mut job));
        ok!(hl_job_wait(job, -1.0));
        Self { engine, volume, transfer: transfer(engine, &points(true, 0.5)), light, image, field, job }
    }
}

/// Each function that takes a handle, rightly called but for where it stands; those that end things last.
fn all_calls(h: &Handles) -> Vec<(&'static str, i32)> {
    let (mut v, mut t, mut l, mut f, mut i, mut j) = (null_mut(), null_mut(), null_mut(), null_mut(), null_mut(), null_mut());
    let data = ball(4);
    let (mut device, mut described) = (init::<hl_device_info>(), init::<hl_volume_info>());
    let (mut n, mut m, mut bins, mut numbers, mut pixels) = (0u64, 0u32, [0u64; 64], [0f64; 48], vec![0f32; 4800]);
    let (mut map, mut state, mut timing) = (null(), init::<hl_job_state>(), init::<hl_timing>());
    let (mut estimate, mut found, mut difference) = (init::<hl_estimate>(), init::<hl_field_info>(), init::<hl_difference>());
    let image_info = hl_image_info { data: pixels.as_ptr().cast(), width: 1, height: 1, ..init() };
    let (axis, path) = ([0.0, 0.0, 1.0], c"/nowhere/a.png".as_ptr());
    let (precompute, render) = (quick(h.volume), small(h.field));
    // SAFETY: what is wrong with these calls is where they are made, which the library promises to find out.
    unsafe {
        vec![
            ("hl_engine_get_device", hl_engine_get_device(h.engine, &mut device)),
            ("hl_vulkan_get_family", hl_vulkan_get_family(h.engine, &mut m)),
            ("hl_volume_create", hl_volume_create(h.engine, &volume_info(&data, 4), &mut v)),
            ("hl_volume_load", hl_volume_load(h.engine, path, null(), &mut v)),
            ("hl_volume_get_range", hl_volume_get_range(h.volume, null_mut(), null_mut())),
            ("hl_volume_get_info", hl_volume_get_info(h.volume, &mut described)),
            ("hl_volume_get_histogram", hl_volume_get_histogram(h.volume, bins.as_mut_ptr(), null_mut())),
            ("hl_transfer_create", hl_transfer_create(h.engine, null(), &mut t)),
            ("hl_transfer_load", hl_transfer_load(h.engine, path, null(), &mut t)),
            ("hl_transfer_guess", hl_transfer_guess(h.volume, &mut t)),
            ("hl_transfer_set", hl_transfer_set(h.transfer, &init())),
            ("hl_light_create", hl_light_create(h.engine, null(), &mut l)),
            ("hl_light_set", hl_light_set(h.light, &init())),
            ("hl_light_rotate", hl_light_rotate(h.light, axis.as_ptr(), 1.0)),
            ("hl_light_get_coefficients", hl_light_get_coefficients(h.light, numbers.as_mut_ptr())),
            ("hl_image_create", hl_image_create(h.engine, &image_info, &mut i)),
            ("hl_image_load", hl_image_load(h.engine, path, &mut i)),
            ("hl_image_get_size", hl_image_get_size(h.image, &mut m, &mut m)),
            ("hl_image_read", hl_image_read(h.image, HL_RGBA32F, 0.0, pixels.as_mut_ptr().cast(), 0, 19200)),
            ("hl_image_map", hl_image_map(h.image, &mut map, &mut n)),
            ("hl_image_unmap", hl_image_unmap(h.image)),
            ("hl_image_read_layer", hl_image_read_layer(h.image, HL_LAYER_OPACITY, pixels.as_mut_ptr(), 1200)),
            ("hl_image_map_layer", hl_image_map_layer(h.image, HL_LAYER_OPACITY, &mut map, &mut n)),
            ("hl_image_save", hl_image_save(h.image, path, null())),
            ("hl_image_compare", hl_image_compare(h.image, h.image, &mut difference)),
            ("hl_image_difference", hl_image_difference(h.image, h.image, HL_DIFFERENCE_SIGNED, &mut i)),
            ("hl_job_wait", hl_job_wait(h.job, 1.0)),
            ("hl_precompute", hl_precompute(h.engine, &precompute, &mut f)),
            ("hl_precompute_start", hl_precompute_start(h.engine, &precompute, &mut j)),
            ("hl_precompute_estimate", hl_precompute_estimate(h.engine, &precompute, &mut estimate)),
            ("hl_precompute_estimate_start", hl_precompute_estimate_start(h.engine, &precompute, &mut j)),
            ("hl_field_get_info", hl_field_get_info(h.field, &mut found)),
            ("hl_field_read", hl_field_read(h.field, pixels.as_mut_ptr(), 128)),
            ("hl_field_map", hl_field_map(h.field, &mut map, &mut n)),
            ("hl_field_unmap", hl_field_unmap(h.field)),
            ("hl_field_save", hl_field_save(h.field, path)),
            ("hl_field_load", hl_field_load(h.engine, path, &precompute, &mut f)),
            ("hl_render", hl_render(h.engine, &render, &mut i)),
            ("hl_render_start", hl_render_start(h.engine, &render, &mut j)),
            ("hl_render_estimate", hl_render_estimate(h.engine, &render, &mut estimate)),
            ("hl_volume_destroy", hl_volume_destroy(h.volume)),
            ("hl_transfer_destroy", hl_transfer_destroy(h.transfer)),
            ("hl_light_destroy", hl_light_destroy(h.light)),
            ("hl_image_destroy", hl_image_destroy(h.image)),
            ("hl_field_destroy", hl_field_destroy(h.field)),
            ("hl_job_destroy", hl_job_destroy(h.job)),
            ("hl_engine_destroy", hl_engine_destroy(h.engine)),
            // These work.
            ("hl_job_poll", hl_job_poll(h.job, &mut state)),
            ("hl_job_cancel", hl_job_cancel(h.job)),
            ("hl_job_timing", hl_job_timing(h.job, 0, &mut timing)),
            ("hl_job_get_image", hl_job_get_image(h.job, &mut i)),
            ("hl_job_get_field", hl_job_get_field(h.job, &mut f)),
            ("hl_job_get_estimate", hl_job_get_estimate(h.job, &mut estimate)),
        ]
    }
}

/// What works in a callback, with what it answers there.
const ALLOWED: [(&str, i32); 6] = [
    ("hl_job_poll", HL_OK),
    ("hl_job_cancel", HL_OK),
    ("hl_job_timing", HL_OK),
    ("hl_job_get_image", HL_OK),
    // A picture's job has none.
    ("hl_job_get_field", HL_NOT_READY),
    ("hl_job_get_estimate", HL_NOT_READY),
];

/// Functions of no engine.
const FREE: [&str; 7] =
    ["hl_version", "hl_status_name", "hl_last_error", "hl_engine_create", "hl_device_get", "hl_vulkan_get_requirement", "hl_vulkan_check"];

type Answers = Vec<(&'static str, i32)>;

static HANDLES: Mutex<Option<Handles>> = Mutex::new(None);
static ANSWERS: Mutex<Answers> = Mutex::new(Vec::new());

fn meddle() {
    let handles = *HANDLES.lock().unwrap();
    let first = ANSWERS.lock().unwrap().is_empty();
    if let Some(handles) = handles.filter(|_| first) {
        let answers = all_calls(&handles);
        *ANSWERS.lock().unwrap() = answers;
    }
}

unsafe extern "C-unwind" fn in_progress(_: *mut c_void, _: *const c_char, _: f32) -> i32 {
    meddle();
    0
}

unsafe extern "C-unwind" fn in_log(_: *mut c_void, _: i32, _: *const c_char) {
    meddle();
}

unsafe extern "C-unwind" fn in_release(_: *mut c_void, _: *const c_void) {
    meddle();
}

#[test]
fn no_callback_lets_anything_else_in() {
    let info = hl_engine_info { log: Some(in_log), log_level: HL_LOG_INFO, ..init() };
    let mut engine = null_mut();
    ok!(hl_engine_create(&info, &mut engine));
    let engine = Engine(engine);
    let handles = Handles::new(&engine);
    let data = ball(8);
    let begin = || {
        ANSWERS.lock().unwrap().clear();
        *HANDLES.lock().unwrap() = Some(handles);
    };
    let end = |place: &str| {
        *HANDLES.lock().unwrap() = None;
        let answers = std::mem::take(&mut *ANSWERS.lock().unwrap());
        let (refused, allowed): (Answers, Answers) = answers.iter().copied().partition(|a| !ALLOWED.iter().any(|b| b.0 == a.0));
        assert!(!refused.is_empty() && refused.iter().all(|a| a.1 == HL_ERROR_REENTRANT), "{place}: {refused:?}");
        assert_eq!(allowed, ALLOWED, "{place}");
        // No function is left out.
        let named: BTreeSet<&str> = answers.iter().map(|a| a.0).chain(FREE).collect();
        assert_eq!(named, crate::misuse::SYMBOLS.lines().collect(), "{place}");
    };
    for blocking in [true, false] {
        begin();
        let view = hl_render_info { progress: Some(in_progress), ..small(handles.field) };
        let (mut image, mut job) = (null_mut(), null_mut());
        if blocking {
            ok!(hl_render(engine.0, &view, &mut image));
        } else {
            ok!(hl_render_start(engine.0, &view, &mut job));
            ok!(hl_job_wait(job, -1.0));
        }
        end("progress");
    }
    // A plan gives its reasons to the log.
    begin();
    field(engine.0, &hl_precompute_info { volume: handles.volume, tolerance: 0.3, ..init() });
    end("log");
    let lent = hl_volume_info { memory: HL_BORROW, release: Some(in_release), ..volume_info(&data, 8) };
    let mut volume = null_mut();
    ok!(hl_volume_create(engine.0, &lent, &mut volume));
    begin();
    ok!(hl_volume_destroy(volume));
    end("release");
    // Outside, the very same calls do what they do: none is refused for where it stands.
    let answers = all_calls(&handles);
    assert!(answers.iter().all(|a| a.1 != HL_ERROR_REENTRANT), "{answers:?}");
}

/// Each function that takes a struct, with one of this size.
fn with_size(h: &Handles, size: u32) -> Vec<(&'static str, i32)> {
    let (mut v, mut t, mut l, mut f, mut i, mut j, mut e) =
        (null_mut(), null_mut(), null_mut(), null_mut(), null_mut(), null_mut(), null_mut());
    macro_rules! of {
        ($type:ident $($member:ident: $value:expr),*) => {
            $type { struct_size: size, $($member: $value,)* ..init() }
        };
    }
    let data = ball(4);
    let file = c"v.nrrd".as_ptr();
    let (surface, clip, camera) = (of!(hl_surface), of!(hl_clip), of!(hl_camera));
    let (device, buffer) =
        (of!(hl_vulkan_device struct_type: HL_STRUCT_VULKAN_DEVICE), of!(hl_vulkan_buffer struct_type: HL_STRUCT_VULKAN_BUFFER));
    let image = of!(hl_vulkan_image struct_type: HL_STRUCT_VULKAN_IMAGE);
    let lent = |next: *const c_void| hl_volume_info { data: null(), next, ..volume_info(&data, 4) };
    let good = quick(h.volume);
    // SAFETY: what is wrong is what the library promises to find out.
    unsafe {
        vec![
            ("hl_engine_create", hl_engine_create(&of!(hl_engine_info), &mut e)),
            ("hl_engine_create", hl_engine_create(&hl_engine_info { next: (&raw const device).cast(), ..init() }, &mut e)),
            ("hl_device_get", hl_device_get(0, &mut of!(hl_device_info))),
            ("hl_engine_get_device", hl_engine_get_device(h.engine, &mut of!(hl_device_info))),
            ("hl_volume_create", hl_volume_create(h.engine, &of!(hl_volume_info), &mut v)),
            ("hl_volume_create", hl_volume_create(h.engine, &lent((&raw const image).cast()), &mut v)),
            ("hl_volume_create", hl_volume_create(h.engine, &lent((&raw const buffer).cast()), &mut v)),
            ("hl_volume_load", hl_volume_load(h.engine, file, &of!(hl_load_info), &mut v)),
            ("hl_volume_get_info", hl_volume_get_info(h.volume, &mut of!(hl_volume_info))),
            ("hl_transfer_create", hl_transfer_create(h.engine, &of!(hl_transfer_info), &mut t)),
            ("hl_transfer_load", hl_transfer_load(h.engine, file, &of!(hl_transfer_file_info), &mut t)),
            ("hl_transfer_set", hl_transfer_set(h.transfer, &of!(hl_transfer_info))),
            ("hl_light_create", hl_light_create(h.engine, &of!(hl_light_info), &mut l)),
            ("hl_light_set", hl_light_set(h.light, &of!(hl_light_info))),
            ("hl_image_create", hl_image_create(h.engine, &of!(hl_image_info), &mut i)),
            ("hl_image_save", hl_image_save(h.image, c"/nowhere/a.png".as_ptr(), &of!(hl_save_info))),
            ("hl_image_compare", hl_image_compare(h.image, h.image, &mut of!(hl_difference))),
            ("hl_job_poll", hl_job_poll(h.job, &mut of!(hl_job_state))),
            ("hl_job_timing", hl_job_timing(h.job, 0, &mut of!(hl_timing))),
            ("hl_precompute", hl_precompute(h.engine, &of!(hl_precompute_info), &mut f)),
            ("hl_precompute", hl_precompute(h.engine, &hl_precompute_info { surface: &surface, ..good }, &mut f)),
            ("hl_precompute", hl_precompute(h.engine, &hl_precompute_info { clip: &clip, ..good }, &mut f)),
            ("hl_precompute_start", hl_precompute_start(h.engine, &of!(hl_precompute_info), &mut j)),
            ("hl_precompute_estimate", hl_precompute_estimate(h.engine, &of!(hl_precompute_info), &mut init())),
            ("hl_precompute_estimate", hl_precompute_estimate(h.engine, &good, &mut of!(hl_estimate))),
            ("hl_precompute_estimate_start", hl_precompute_estimate_start(h.engine, &of!(hl_precompute_info), &mut j)),
            ("hl_job_get_estimate", hl_job_get_estimate(h.job, &mut of!(hl_estimate))),
            ("hl_field_get_info", hl_field_get_info(h.field, &mut of!(hl_field_info))),
            ("hl_field_load", hl_field_load(h.engine, file, &of!(hl_precompute_info), &mut f)),
            ("hl_render", hl_render(h.engine, &of!(hl_render_info), &mut i)),
            ("hl_render", hl_render(h.engine, &hl_render_info { clip: &clip, ..small(h.field) }, &mut i)),
            ("hl_render", hl_render(h.engine, &hl_render_info { next: (&raw const image).cast(), ..small(h.field) }, &mut i)),
            ("hl_render", hl_render(h.engine, &hl_render_info { camera: &camera, ..small(h.field) }, &mut i)),
            ("hl_render_start", hl_render_start(h.engine, &of!(hl_render_info), &mut j)),
            ("hl_render_estimate", hl_render_estimate(h.engine, &of!(hl_render_info), &mut init())),
            ("hl_render_estimate", hl_render_estimate(h.engine, &small(h.field), &mut of!(hl_estimate))),
            ("hl_vulkan_get_requirement", hl_vulkan_get_requirement(0, &mut of!(hl_vulkan_requirement))),
        ]
    }
}

#[test]
fn no_struct_of_a_wrong_size_is_read() {
    let engine = Engine::new();
    let handles = Handles::new(&engine);
    // Nothing, half of what every struct begins with, far more than any, an address taken for a number.
    for size in [0, 8, 15, 1 << 20, u32::MAX] {
        let answers = with_size(&handles, size);
        assert!(answers.iter().all(|a| a.1 == HL_ERROR_INVALID), "{size}: {answers:?}");
        let (_, text) = crate::last(null());
        assert!(text.contains(&format!("struct_size is {size}")), "{text}");
    }
    // No function that takes a struct is left out: the header says which.
    let header = concat!(include_str!("../../include/halflight.h"), include_str!("../../include/halflight_vulkan.h"));
    let sized: Vec<&str> = header.split("} hl_").skip(1).filter_map(|t| t.split(';').next()).collect();
    let calls = header.split("\nhl_status ").skip(1).filter_map(|t| t.split_once(';')).map(|(t, _)| t.split_once('(').unwrap());
    let takes = |arguments: &str| sized.iter().any(|s| arguments.contains(&format!("hl_{s} *")));
    let needed: BTreeSet<&str> = calls.filter(|(_, a)| takes(a)).map(|(name, _)| name).collect();
    assert_eq!(with_size(&handles, 0).iter().map(|a| a.0).collect::<BTreeSet<_>>(), needed);
}
