//! Every function with NULL, with handles that are stale, foreign or of another kind, and with structs of wrong sizes: a
//! status, never more.

use crate::scenes::*;
use crate::{Engine, init};
use halflight::ffi::*;
use std::collections::BTreeSet;
use std::ffi::c_void;
use std::ptr::{null, null_mut};

/// Exported functions, one a line.
pub const SYMBOLS: &str = include_str!("symbols.txt");

/// Each function that takes a handle, called with `h` for it and, beside it, what is right.
fn with_handle(engine: *mut hl_engine, h: *mut c_void) -> Vec<(&'static str, i32)> {
    let (mut v, mut t, mut l, mut f, mut i, mut j) = (null_mut(), null_mut(), null_mut(), null_mut(), null_mut(), null_mut());
    let data = ball(4);
    let mut device: hl_device_info = init();
    let (mut number, mut w, mut numbers) = (0u64, 0u32, [0f64; 48]);
    let (mut map, mut state, mut timing) = (null(), init::<hl_job_state>(), init::<hl_timing>());
    let (mut estimate, mut field_info, mut difference) = (init::<hl_estimate>(), init::<hl_field_info>(), init::<hl_difference>());
    let (mut described, mut bins, mut layer) = (init::<hl_volume_info>(), [0u64; 64], [0f32; 4]);
    let pixels = [0f32; 4];
    let image_info = hl_image_info { data: pixels.as_ptr().cast(), width: 1, height: 1, ..init() };
    let axis = [0.0, 0.0, 1.0];
    let precompute = quick(h.cast());
    let render = small(h.cast());
    // SAFETY: the handles are wrong, which the library promises to find out; all else is right.
    unsafe {
        vec![
            ("hl_engine_get_device", hl_engine_get_device(h.cast(), &mut device)),
            ("hl_vulkan_get_family", hl_vulkan_get_family(h.cast(), &mut w)),
            ("hl_volume_create", hl_volume_create(h.cast(), &volume_info(&data, 4), &mut v)),
            ("hl_volume_load", hl_volume_load(h.cast(), c"none.nrrd".as_ptr(), null(), &mut v)),
            ("hl_volume_get_info", hl_volume_get_info(h.cast(), &mut described)),
            ("hl_volume_get_histogram", hl_volume_get_histogram(h.cast(), bins.as_mut_ptr(), numbers.as_mut_ptr())),
            ("hl_transfer_load", hl_transfer_load(h.cast(), c"none.json".as_ptr(), null(), &mut t)),
            ("hl_transfer_guess", hl_transfer_guess(h.cast(), &mut t)),
            ("hl_volume_get_range", hl_volume_get_range(h.cast(), &mut w, numbers.as_mut_ptr())),
            ("hl_transfer_create", hl_transfer_create(h.cast(), null(), &mut t)),
            ("hl_transfer_set", hl_transfer_set(h.cast(), &init())),
            ("hl_light_create", hl_light_create(h.cast(), null(), &mut l)),
            ("hl_light_set", hl_light_set(h.cast(), &init())),
            ("hl_light_rotate", hl_light_rotate(h.cast(), axis.as_ptr(), 1.0)),
            ("hl_light_get_coefficients", hl_light_get_coefficients(h.cast(), numbers.as_mut_ptr())),
            ("hl_image_create", hl_image_create(h.cast(), &image_info, &mut i)),
            ("hl_image_load", hl_image_load(h.cast(), c"none.png".as_ptr(), &mut i)),
            ("hl_image_get_size", hl_image_get_size(h.cast(), &mut w, &mut w)),
            ("hl_image_read", hl_image_read(h.cast(), HL_RGBA32F, 0.0, numbers.as_mut_ptr().cast(), 0, 16)),
            ("hl_image_map", hl_image_map(h.cast(), &mut map, &mut number)),
            ("hl_image_unmap", hl_image_unmap(h.cast())),
            ("hl_image_save", hl_image_save(h.cast(), c"/nowhere/a.png".as_ptr(), null())),
            ("hl_image_read_layer", hl_image_read_layer(h.cast(), HL_LAYER_OPACITY, layer.as_mut_ptr(), 1)),
            ("hl_image_map_layer", hl_image_map_layer(h.cast(), HL_LAYER_OPACITY, &mut map, &mut number)),
            ("hl_image_difference", hl_image_difference(h.cast(), h.cast(), HL_DIFFERENCE_FLIP, &mut i)),
            ("hl_image_compare", hl_image_compare(h.cast(), h.cast(), &mut difference)),
            ("hl_job_poll", hl_job_poll(h.cast(), &mut state)),
            ("hl_job_wait", hl_job_wait(h.cast(), 0.0)),
            ("hl_job_cancel", hl_job_cancel(h.cast())),
            ("hl_job_timing", hl_job_timing(h.cast(), 0, &mut timing)),
            ("hl_job_get_field", hl_job_get_field(h.cast(), &mut f)),
            ("hl_job_get_image", hl_job_get_image(h.cast(), &mut i)),
            ("hl_job_get_estimate", hl_job_get_estimate(h.cast(), &mut estimate)),
            ("hl_precompute", hl_precompute(h.cast(), &precompute, &mut f)),
            ("hl_precompute", hl_precompute(engine, &precompute, &mut f)),
            ("hl_precompute_start", hl_precompute_start(engine, &precompute, &mut j)),
            ("hl_precompute_estimate", hl_precompute_estimate(engine, &precompute, &mut estimate)),
            ("hl_precompute_estimate_start", hl_precompute_estimate_start(engine, &precompute, &mut j)),
            ("hl_field_get_info", hl_field_get_info(h.cast(), &mut field_info)),
            ("hl_field_read", hl_field_read(h.cast(), numbers.as_mut_ptr().cast(), 1)),
            ("hl_field_map", hl_field_map(h.cast(), &mut map, &mut number)),
            ("hl_field_unmap", hl_field_unmap(h.cast())),
            ("hl_field_save", hl_field_save(h.cast(), c"/nowhere/f.nrrd".as_ptr())),
            ("hl_field_load", hl_field_load(engine, c"none.nrrd".as_ptr(), &precompute, &mut f)),
            ("hl_render", hl_render(h.cast(), &render, &mut i)),
            ("hl_render", hl_render(engine, &render, &mut i)),
            ("hl_render_start", hl_render_start(engine, &render, &mut j)),
            ("hl_render_estimate", hl_render_estimate(engine, &render, &mut estimate)),
        ]
    }
}

fn destroyers(h: *mut c_void) -> Vec<(&'static str, i32)> {
    // SAFETY: as above.
    unsafe {
        vec![
            ("hl_engine_destroy", hl_engine_destroy(h.cast())),
            ("hl_volume_destroy", hl_volume_destroy(h.cast())),
            ("hl_transfer_destroy", hl_transfer_destroy(h.cast())),
            ("hl_light_destroy", hl_light_destroy(h.cast())),
            ("hl_image_destroy", hl_image_destroy(h.cast())),
            ("hl_field_destroy", hl_field_destroy(h.cast())),
            ("hl_job_destroy", hl_job_destroy(h.cast())),
        ]
    }
}

fn all_are(answers: &[(&str, i32)], status: i32) {
    assert!(answers.iter().all(|a| a.1 == status), "{answers:?}");
}

#[test]
fn wrong_handles_are_found_out() {
    let engine = Engine::new();
    let mut gone = null_mut();
    ok!(hl_light_create(engine.0, null(), &mut gone));
    ok!(hl_light_destroy(gone));
    let local = 5u64;
    // NULL, destroyed, small and large numbers, somebody else's memory.
    for h in [null_mut(), gone.cast(), std::ptr::without_provenance_mut(3), std::ptr::without_provenance_mut(usize::MAX)] {
        all_are(&with_handle(engine.0, h), HL_ERROR_HANDLE);
    }
    all_are(&with_handle(engine.0, std::ptr::from_ref(&local).cast_mut().cast()), HL_ERROR_HANDLE);
    all_are(&destroyers(gone.cast()), HL_ERROR_HANDLE);
    // Only NULL is nothing to destroy.
    all_are(&destroyers(null_mut()), HL_OK);

    // A whole handle of another kind: a transfer function serves nothing but itself.
    let other = transfer(engine.0, &points(true, 0.5));
    let answers: Vec<_> = with_handle(engine.0, other.cast()).into_iter().filter(|a| a.0 != "hl_transfer_set").collect();
    all_are(&answers, HL_ERROR_HANDLE);
    let mut volume = null_mut();
    refused!(HL_ERROR_HANDLE, "another thing, transfer function", hl_volume_create(other.cast(), null(), &mut volume));
    ok!(hl_transfer_destroy(other));
    refused!(HL_ERROR_HANDLE, "it was destroyed", hl_transfer_destroy(other));

    // No function is left out.
    let free = [
        "hl_device_get",
        "hl_version",
        "hl_status_name",
        "hl_last_error",
        "hl_engine_create",
        "hl_vulkan_get_requirement",
        "hl_vulkan_check",
    ];
    let covered: BTreeSet<&str> =
        with_handle(engine.0, null_mut()).iter().chain(&destroyers(null_mut())).map(|a| a.0).chain(free).collect();
    assert_eq!(covered, SYMBOLS.lines().collect());
}

#[test]
fn missing_places_and_structs_are_found_out() {
    let engine = Engine::new();
    let e = engine.0;
    let volume = volume(e, 8);
    let field = field(e, &quick(volume));
    let image = image(e, &small(field));
    let mut job = null_mut();
    ok!(hl_render_start(e, &small(field), &mut job));
    let mut light = null_mut();
    ok!(hl_light_create(e, null(), &mut light));
    let data = ball(4);
    let mut w = 0u32;
    // The engine that a call was about keeps its fault, too, in the place of another.
    let other = || refused!(HL_ERROR_HANDLE, "volume", hl_precompute(e, &quick(null_mut()), &mut null_mut()));
    let asked = |status: i32| {
        let kept = crate::last(e);
        assert!(kept.0 == HL_ERROR_HANDLE || kept == crate::last(null()), "{kept:?}");
        other();
        (status, kept.0)
    };
    let mut done = null_mut();
    ok!(hl_precompute_estimate_start(e, &quick(volume), &mut done));
    ok!(hl_job_wait(done, -1.0));
    other();
    // SAFETY: what is NULL is what the library promises to find out.
    let answers = unsafe {
        vec![
            ("create", asked(hl_engine_create(null(), null_mut()))),
            ("name", asked(hl_status_name(0, null_mut()))),
            ("unknown status", asked(hl_status_name(77, &mut null()))),
            ("device", asked(hl_engine_get_device(e, null_mut()))),
            ("volume", asked(hl_volume_create(e, &volume_info(&data, 4), null_mut()))),
            ("volume info", asked(hl_volume_create(e, null(), &mut null_mut()))),
            ("volume data", asked(hl_volume_create(e, &hl_volume_info { data: null(), ..volume_info(&data, 4) }, &mut null_mut()))),
            ("volume path", asked(hl_volume_load(e, null(), null(), &mut null_mut()))),
            ("loaded volume", asked(hl_volume_load(e, c"v.nrrd".as_ptr(), null(), null_mut()))),
            ("volume description", asked(hl_volume_get_info(volume, null_mut()))),
            ("histogram", asked(hl_volume_get_histogram(volume, null_mut(), null_mut()))),
            ("transfer path", asked(hl_transfer_load(e, null(), null(), &mut null_mut()))),
            ("loaded transfer", asked(hl_transfer_load(e, c"t.json".as_ptr(), null(), null_mut()))),
            ("guess", asked(hl_transfer_guess(volume, null_mut()))),
            ("listed device", asked(hl_device_get(0, null_mut()))),
            ("layer", asked(hl_image_read_layer(image, HL_LAYER_OPACITY, null_mut(), 1))),
            ("layer map", asked(hl_image_map_layer(image, HL_LAYER_OPACITY, null_mut(), null_mut()))),
            ("difference", asked(hl_image_difference(image, image, HL_DIFFERENCE_FLIP, null_mut()))),
            ("transfer", asked(hl_transfer_create(e, null(), null_mut()))),
            ("points", asked(hl_transfer_create(e, &hl_transfer_info { count: 2, ..init() }, &mut null_mut()))),
            ("light", asked(hl_light_create(e, null(), null_mut()))),
            ("light info", asked(hl_light_set(light, null()))),
            ("probe", asked(hl_light_set(light, &hl_light_info { kind: HL_LIGHT_PROBE, ..init() }))),
            ("SH", asked(hl_light_set(light, &hl_light_info { kind: HL_LIGHT_SH, ..init() }))),
            ("toward", asked(hl_light_set(light, &hl_light_info { kind: HL_LIGHT_DIRECTIONAL, ..init() }))),
            ("axis", asked(hl_light_rotate(light, null(), 1.0))),
            ("coefficients", asked(hl_light_get_coefficients(light, null_mut()))),
            ("image", asked(hl_image_create(e, null(), null_mut()))),
            ("image info", asked(hl_image_create(e, null(), &mut null_mut()))),
            ("image path", asked(hl_image_load(e, null(), &mut null_mut()))),
            ("pixels", asked(hl_image_read(image, HL_RGBA32F, 0.0, null_mut(), 0, 1 << 20))),
            ("map", asked(hl_image_map(image, null_mut(), null_mut()))),
            ("save", asked(hl_image_save(image, null(), null()))),
            ("compare", asked(hl_image_compare(image, image, null_mut()))),
            ("poll", asked(hl_job_poll(job, null_mut()))),
            ("job's field", asked(hl_job_get_field(job, null_mut()))),
            ("job's image", asked(hl_job_get_image(job, null_mut()))),
            ("precompute", asked(hl_precompute(e, &quick(volume), null_mut()))),
            ("precompute info", asked(hl_precompute(e, null(), &mut null_mut()))),
            ("precompute job", asked(hl_precompute_start(e, &quick(volume), null_mut()))),
            ("precompute estimate", asked(hl_precompute_estimate(e, &quick(volume), null_mut()))),
            ("estimate job", asked(hl_precompute_estimate_start(e, &quick(volume), null_mut()))),
            ("job estimate", asked(hl_job_get_estimate(done, null_mut()))),
            ("field info", asked(hl_field_get_info(field, null_mut()))),
            ("field numbers", asked(hl_field_read(field, null_mut(), 128))),
            ("field map", asked(hl_field_map(field, null_mut(), null_mut()))),
            ("field path", asked(hl_field_save(field, null()))),
            ("render", asked(hl_render(e, &small(field), null_mut()))),
            ("render info", asked(hl_render(e, null(), &mut null_mut()))),
            ("render job", asked(hl_render_start(e, null(), null_mut()))),
            ("render estimate", asked(hl_render_estimate(e, &small(field), null_mut()))),
            ("requirement", asked(hl_vulkan_get_requirement(0, null_mut()))),
            ("check", asked(hl_vulkan_check(None, null_mut(), 0, null_mut()))),
        ]
    };
    let free = ["create", "name", "unknown status", "listed device", "requirement", "check"];
    for (name, (_, kept)) in &answers {
        assert_eq!(*kept, if free.contains(name) { HL_ERROR_HANDLE } else { HL_ERROR_INVALID }, "{name}");
    }
    let answers: Vec<_> = answers.into_iter().map(|(name, (status, _))| (name, status)).collect();
    all_are(&answers, HL_ERROR_INVALID);
    ok!(hl_job_wait(job, -1.0));
    // Places that need not be.
    ok!(hl_image_get_size(image, &mut w, null_mut()));
    ok!(hl_volume_get_range(volume, null_mut(), null_mut()));
    // SAFETY: the index is beyond the list.
    assert_eq!(unsafe { hl_job_timing(job, 99, null_mut()) }, HL_END);
    assert_eq!(unsafe { hl_last_error(null(), null_mut(), 0) }, HL_ERROR_HANDLE);
}

#[test]
fn structs_of_other_versions_are_read_by_their_size() {
    let engine = Engine::new();
    let volume = volume(engine.0, 8);
    let mut field = null_mut();
    // Longer, as of a later version: taken while the rest is zero.
    #[repr(C)]
    struct Later {
        now: hl_precompute_info,
        more: [u64; 3],
    }
    let mut later = Later { now: quick(volume), more: [0; 3] };
    later.now.struct_size = size_of::<Later>() as u32;
    ok!(hl_precompute(engine.0, std::ptr::from_ref(&later).cast(), &mut field));
    later.more[2] = 1;
    refused!(HL_ERROR_INVALID, "beyond the 152 bytes", hl_precompute(engine.0, std::ptr::from_ref(&later).cast(), &mut field));
    assert!(field.is_null());
    // Shorter, as of an earlier one: the rest is zero, whatever stands there.
    for size in [88, 96] {
        let earlier = hl_precompute_info { struct_size: size, tolerance: f64::NAN, ..quick(volume) };
        ok!(hl_precompute(engine.0, &earlier, &mut field));
    }
    // Half a pointer is none.
    let clip = hl_clip { high: [1.0; 3], ..init() };
    for size in [92, 140, 143] {
        let info = hl_precompute_info { struct_size: size, clip: &raw const clip, ..quick(volume) };
        refused!(HL_ERROR_INVALID, &format!("struct_size is {size}"), hl_precompute(engine.0, &info, &mut field));
    }
    let mut none = std::ptr::null_mut();
    let info = hl_engine_info { struct_size: 20, device: c"llvmpipe".as_ptr(), ..init() };
    refused!(HL_ERROR_INVALID, "hl_engine_info: struct_size is 20", hl_engine_create(&info, &mut none));
    assert!(none.is_null());
    let mut cut = hl_device_info { struct_size: 20, ..init() };
    refused!(HL_ERROR_INVALID, "hl_device_info: struct_size is 20", hl_engine_get_device(engine.0, &mut cut));
    // No size, no sense.
    for (size, words) in [(0, "struct_size is 0"), (8, "struct_size is 8"), (u32::MAX, "struct_size is 4294967295")] {
        let info = hl_precompute_info { struct_size: size, ..quick(volume) };
        refused!(HL_ERROR_INVALID, words, hl_precompute(engine.0, &info, &mut field));
    }
    let info = hl_precompute_info { struct_type: 3, ..quick(volume) };
    refused!(HL_ERROR_INVALID, "struct_type is 3", hl_precompute(engine.0, &info, &mut field));
    let info = hl_precompute_info { next: std::ptr::from_ref(&later).cast(), ..quick(volume) };
    refused!(HL_ERROR_INVALID, "no extension", hl_precompute(engine.0, &info, &mut field));
    // What is reserved stays free for later versions.
    let path = c"/nowhere/a.png".as_ptr();
    let (mut made, mut transfer) = (null_mut(), null_mut());
    let picture = image(engine.0, &small(self::field(engine.0, &quick(volume))));
    let data = ball(4);
    refused!(HL_ERROR_INVALID, "reserved", hl_engine_create(&hl_engine_info { reserved: 1, ..init() }, &mut none));
    refused!(HL_ERROR_INVALID, "reserved", hl_volume_create(engine.0, &hl_volume_info { reserved: 1, ..volume_info(&data, 4) }, &mut made));
    refused!(HL_ERROR_INVALID, "reserved", hl_transfer_create(engine.0, &hl_transfer_info { reserved: 1, ..init() }, &mut transfer));
    let preset = hl_transfer_file_info { reserved: -1, ..init() };
    refused!(HL_ERROR_INVALID, "reserved", hl_transfer_load(engine.0, path, &preset, &mut transfer));
    refused!(HL_ERROR_INVALID, "reserved", hl_image_save(picture, path, &hl_save_info { reserved: 1, ..init() }));
    let surface = hl_surface { iso: 100.0, reserved: 1, ..init() };
    let info = hl_precompute_info { surface: &surface, ..quick(volume) };
    refused!(HL_ERROR_INVALID, "reserved", hl_precompute(engine.0, &info, &mut field));
    // What is filled ends where the caller's struct does.
    let mut short = [0xabu8; size_of::<hl_device_info>()];
    short[..16].fill(0);
    short[0] = 40;
    ok!(hl_engine_get_device(engine.0, short.as_mut_ptr().cast()));
    assert!(short[16..40].starts_with(b"llvmpipe") || short[16] != 0xab);
    assert!(short[40..].iter().all(|&b| b == 0xab));
}

#[test]
fn values_out_of_range_are_refused_with_a_sentence() {
    let engine = Engine::new();
    let volume = volume(engine.0, 8);
    let good = field(engine.0, &quick(volume));
    let (mut field, mut image, mut made, mut light) = (null_mut(), null_mut(), null_mut(), null_mut());
    let base = quick(volume);
    let zeros = [0f64; 4];
    let upside_down = hl_clip { low: [0.5; 3], high: [0.25; 3], ..init() };
    let no_box = hl_clip { high: [f64::NAN, 1.0, 1.0], ..init() };
    let flat = hl_clip { planes: zeros.as_ptr(), plane_count: 1, ..init() };
    let no_planes = hl_clip { plane_count: 1, ..init() };
    let many = hl_clip { plane_count: 11, ..init() };
    let nowhere = hl_clip { space: 2, ..init() };
    let sizeless = hl_clip { struct_size: 0, ..init() };
    let cases: Vec<(&str, hl_precompute_info)> = vec![
        ("visibility.ratio", hl_precompute_info { ratio: 3, ..base }),
        ("hl_precompute_info.ratio: is -4", hl_precompute_info { ratio: -4, ..base }),
        ("visibility.bits", hl_precompute_info { bits: 9, ..base }),
        ("visibility.bands", hl_precompute_info { bands: 5, ..base }),
        ("hl_precompute_info.method", hl_precompute_info { method: 9, ..base }),
        ("hl_precompute_info.filter", hl_precompute_info { filter: -1, ..base }),
        ("visibility.step", hl_precompute_info { step: f32::NAN, ..base }),
        ("visibility.growth", hl_precompute_info { growth: -1.0, ..base }),
        ("visibility.directions", hl_precompute_info { directions: u32::MAX, ..base }),
        ("visibility.fit", hl_precompute_info { fit: 65, ..base }),
        ("visibility.fit", hl_precompute_info { fit: 8, method: HL_METHOD_MARCH, ..base }),
        ("hl_precompute_info: its member reserved", hl_precompute_info { reserved: 1, ..base }),
        ("hl_precompute_info.tolerance", hl_precompute_info { tolerance: f64::NAN, ..base }),
        ("hl_precompute_info.tolerance: stands beside", hl_precompute_info { tolerance: 0.1, quality: HL_QUALITY_FINE, ..base }),
        ("hl_precompute_info.quality", hl_precompute_info { quality: 4, ..base }),
        ("hl_precompute_info.jittered: is 2", hl_precompute_info { jittered: 2, ..base }),
        ("hl_precompute_info.measure_seconds", hl_precompute_info { measure: 1, measure_seconds: f64::INFINITY, ..base }),
        ("clip.box", hl_precompute_info { clip: &raw const upside_down, ..base }),
        ("clip.box", hl_precompute_info { clip: &raw const no_box, ..base }),
        ("clip.planes", hl_precompute_info { clip: &raw const flat, ..base }),
        ("hl_clip.planes: is NULL", hl_precompute_info { clip: &raw const no_planes, ..base }),
        ("hl_clip.plane_count: is 11", hl_precompute_info { clip: &raw const many, ..base }),
        ("hl_clip.space: is 2", hl_precompute_info { clip: &raw const nowhere, ..base }),
        ("hl_clip: struct_size is 0", hl_precompute_info { clip: &raw const sizeless, ..base }),
    ];
    for (words, info) in cases {
        refused!(HL_ERROR_INVALID, words, hl_precompute(engine.0, &info, &mut field));
    }
    let surface = hl_surface { iso: 1e9, ..init() };
    refused!(HL_ERROR_INVALID, "surface.iso", hl_precompute(engine.0, &hl_precompute_info { surface: &surface, ..base }, &mut field));

    let base = small(good);
    let zero: hl_camera = init();
    // Each kept until the calls are made.
    let kept = std::cell::RefCell::new(Vec::new());
    let camera = |camera: hl_camera| {
        kept.borrow_mut().push(Box::new(camera));
        hl_render_info { camera: kept.borrow().last().map_or(null(), |c| &raw const **c), ..base }
    };
    let further: hl_header = init();
    let cases: Vec<(&str, hl_render_info)> = vec![
        ("at most 16384", hl_render_info { width: 1 << 20, ..base }),
        ("image.step", hl_render_info { step: f64::NAN, ..base }),
        ("image.step", hl_render_info { step: 1e-12, ..base }),
        ("image.step", hl_render_info { step: 1e-18, ..base }),
        ("image.step", hl_render_info { step: 1e-19, ..base }),
        ("image.step", hl_render_info { step: f64::from_bits(1), ..base }),
        ("camera.fov", camera(hl_camera { fov: f64::NAN, ..zero })),
        ("camera.position", camera(hl_camera { space: HL_CAMERA_WORLD, ..zero })),
        ("camera.up", camera(hl_camera { space: HL_CAMERA_SIDE, position: [0.0, 0.0, 3.0], ..zero })),
        ("camera.position", camera(hl_camera { space: HL_CAMERA_SIDE, position: [f64::NAN, 0.0, 3.0], ..zero })),
        ("hl_camera.space", camera(hl_camera { space: 3, ..zero })),
        ("hl_camera: struct_size is 0", camera(hl_camera { struct_size: 0, ..zero })),
        ("hl_camera: struct_type is 1", camera(hl_camera { struct_type: 1, ..zero })),
        ("hl_camera: next is not NULL", camera(hl_camera { next: (&raw const further).cast(), ..zero })),
        ("hl_render_info.background", hl_render_info { background: 3, ..base }),
        ("background_color", hl_render_info { background: HL_BACKGROUND_COLOR, background_color: [f32::NAN; 3], ..base }),
        ("hl_render_info.reference", hl_render_info { reference: -1.0, ..base }),
        ("hl_camera.orbit", camera(hl_camera { orbit: [0.0, 0.0, 0.0, 30.0], ..zero })),
        ("hl_camera.orbit", camera(hl_camera { orbit: [0.0, 0.0, 1.0, f64::NAN], ..zero })),
        ("hl_camera.own_centre: is 3", camera(hl_camera { own_centre: 3, ..zero })),
        ("hl_camera.distance: is -1", camera(hl_camera { distance: -1.0, ..zero })),
        ("camera.position", camera(hl_camera { own_centre: 1, centre: [f64::NAN; 3], orbit: [0.0, 0.0, 1.0, 9.0], ..zero })),
        ("hl_render_info.every_block: is 2", hl_render_info { every_block: 2, ..base }),
        ("hl_render_info.layers: is 128", hl_render_info { layers: 128, ..base }),
        ("hl_render_info.layers: asks for HL_LAYER_NOISE", hl_render_info { layers: HL_LAYER_NOISE | HL_LAYER_DEPTH, ..base }),
        ("beside reference", hl_render_info { layers: HL_LAYER_DEPTH, reference: 0.1, ..base }),
        ("beside reference", hl_render_info { clip: &raw const nowhere, reference: 0.1, ..base }),
        ("hl_clip.space: is 2", hl_render_info { clip: &raw const nowhere, ..base }),
    ];
    for (words, info) in cases {
        refused!(HL_ERROR_INVALID, words, hl_render(engine.0, &info, &mut image));
    }

    let data = ball(8);
    let base = volume_info(&data, 8);
    // Voxels so long that the steps of their shortest edge cannot be counted.
    ok!(hl_volume_create(engine.0, &hl_volume_info { spacing: [1.0, 1.0, 1e19], ..base }, &mut made));
    let long = hl_precompute_info { method: HL_METHOD_HIERARCHICAL, growth: 1.0, ..quick(made) };
    ok!(hl_precompute(engine.0, &long, &mut field));
    refused!(HL_ERROR_INVALID, "image.step", hl_render(engine.0, &small(field), &mut image));
    refused!(
        HL_ERROR_INVALID,
        "visibility.step",
        hl_precompute(engine.0, &hl_precompute_info { method: HL_METHOD_MARCH, ..long }, &mut field)
    );
    let cases: Vec<(&str, hl_volume_info)> = vec![
        ("grid dims", hl_volume_info { dims: [0, 8, 8], ..base }),
        ("grid dims", hl_volume_info { dims: [u32::MAX; 3], ..base }),
        ("reach beyond any memory", hl_volume_info { dims: [1 << 20; 3], strides: [i64::MAX, i64::MIN, 1], ..base }),
        ("hl_volume_info.type", hl_volume_info { r#type: 0, ..base }),
        ("hl_volume_info.memory", hl_volume_info { memory: 2, ..base }),
        ("must be finite", hl_volume_info { spacing: [f64::NAN, 1.0, 1.0], ..base }),
        ("span no volume", hl_volume_info { axes: [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0], ..base }),
        ("slope", hl_volume_info { slope: f32::INFINITY, ..base }),
        ("hl_volume_info.component: is 3 of 3", hl_volume_info { components: 3, component: 3, ..base }),
        ("hl_volume_info.component: is 1 of 0", hl_volume_info { component: 1, ..base }),
        ("hl_volume_info.component", hl_volume_info { components: u32::MAX, ..base }),
    ];
    for (words, info) in cases {
        refused!(HL_ERROR_INVALID, words, hl_volume_create(engine.0, &info, &mut made));
    }
    // Too much, said before it is touched: the samples are not there.
    let huge = hl_volume_info { dims: [1 << 20, 1 << 20, 1 << 10], strides: [0, 0, 1], ..base };
    refused!(HL_ERROR_MEMORY, "main memory", hl_volume_create(engine.0, &huge, &mut made));

    ok!(hl_light_create(engine.0, null(), &mut light));
    let axis = [0.0; 3];
    refused!(HL_ERROR_INVALID, "axis: is zero", hl_light_rotate(light, axis.as_ptr(), 10.0));
    refused!(HL_ERROR_INVALID, "must be finite", hl_light_rotate(light, axis.as_ptr(), f64::NAN));
    let cases: Vec<(&str, hl_light_info)> = vec![
        ("hl_light_info.kind", hl_light_info { kind: 6, ..init() }),
        ("hl_light_info.bands", hl_light_info { bands: 5, ..init() }),
        ("hl_light_info.window", hl_light_info { window: 4, ..init() }),
        ("half_angle", hl_light_info { kind: HL_LIGHT_CONE, toward: [1.0; 3], half_angle: 181.0, ..init() }),
        ("must be finite", hl_light_info { scale: f64::NAN, ..init() }),
    ];
    for (words, info) in cases {
        refused!(HL_ERROR_INVALID, words, hl_light_set(light, &info));
    }
    let (mut bad, mut transfer) = (points(true, 0.5), null_mut());
    bad[1][0] = -1.0;
    refused!(HL_ERROR_INVALID, "ascending", hl_transfer_create(engine.0, &transfer_info(&bad), &mut transfer));
    // Wishes that no device fulfils.
    let mut none = null_mut();
    refused!(HL_ERROR_NO_DEVICE, "none is called", hl_engine_create(&hl_engine_info { device: c"no such".as_ptr(), ..init() }, &mut none));
    refused!(
        HL_ERROR_INVALID,
        "struct_type is 0",
        hl_engine_create(&hl_engine_info { next: std::ptr::from_ref(&base).cast(), ..init() }, &mut none)
    );
    assert!(none.is_null());
    let tight = hl_engine_info { memory: 1 << 16, ..init() };
    ok!(hl_engine_create(&tight, &mut none));
    refused!(
        HL_ERROR_MEMORY,
        "device memory",
        hl_volume_create(none, &hl_volume_info { r#type: HL_UINT8, ..volume_info(&ball(64), 64) }, &mut made)
    );
    ok!(hl_engine_destroy(none));
}
