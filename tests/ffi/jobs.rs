//! Jobs: progress, cancelling, results before the end, edits, estimates.

use crate::scenes::*;
use crate::{Engine, init};
use halflight::ffi::*;
use std::ffi::{CStr, c_char, c_void};
use std::sync::Mutex;
use std::sync::atomic::{AtomicPtr, AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// What a callback was told, and what it does.
#[derive(Default)]
pub struct Told {
    pub all: Mutex<Vec<(String, f32)>>,
    /// Answer with "stop" from this call on; 0: never.
    pub stop_at: AtomicU32,
}

pub unsafe extern "C-unwind" fn progress(user: *mut c_void, stage: *const c_char, fraction: f32) -> i32 {
    // SAFETY: each test hands over its own, which outlives its jobs; stages are C strings.
    let (told, stage) = unsafe { (&*user.cast::<Told>(), CStr::from_ptr(stage)) };
    let mut all = told.all.lock().unwrap();
    all.push((stage.to_str().unwrap().to_owned(), fraction));
    let stop = told.stop_at.load(Ordering::SeqCst);
    i32::from(stop > 0 && all.len() >= stop as usize)
}

pub fn user(told: &Told) -> *mut c_void {
    std::ptr::from_ref(told).cast_mut().cast()
}

pub fn monotonic(told: &Told) -> Vec<(String, f32)> {
    let all = told.all.lock().unwrap().clone();
    assert!(all.windows(2).all(|w| w[0].1 <= w[1].1), "{all:?}");
    assert_eq!(all[0].1, 0.0);
    all
}

pub fn poll(job: *mut hl_job) -> hl_job_state {
    let mut state: hl_job_state = init();
    ok!(hl_job_poll(job, &mut state));
    state
}

/// Long: some hundred dispatches.
pub fn long(volume: *mut hl_volume) -> hl_precompute_info {
    hl_precompute_info { volume, method: HL_METHOD_MARCH, directions: 100_000, ratio: 1, step: 0.1, all_cells: 1, ..init() }
}

#[test]
fn progress_goes_from_nought_to_one() {
    let engine = Engine::new();
    let told = Told::default();
    let volume = volume(engine.0, 24);
    let info = hl_precompute_info { progress: Some(progress), user: user(&told), directions: 256, progressive: 1, ..quick(volume) };
    let mut job = std::ptr::null_mut();
    ok!(hl_precompute_start(engine.0, &info, &mut job));
    ok!(hl_job_wait(job, -1.0));
    let all = monotonic(&told);
    assert!(all.last().unwrap() == &("sweep".into(), 1.0) && all.iter().filter(|t| t.1 == 1.0).count() == 1, "{all:?}");
    let state = poll(job);
    assert_eq!((state.status, state.fraction, state.passes, state.directions), (HL_OK, 1.0, 4, 256));
    assert!(state.device_seconds > 0.0 && state.seconds >= state.device_seconds && state.error < 0.0);
    let kernels = kernels(job);
    assert!(kernels.iter().any(|k| k == "sweep") && !kernels.iter().any(|k| k == "raymarch"), "{kernels:?}");

    // A blocking call tells as well, and a picture.
    let told = Told::default();
    let mut field = std::ptr::null_mut();
    ok!(hl_job_get_field(job, &mut field));
    let info = hl_render_info { progress: Some(progress), user: user(&told), ..small(field) };
    pixels(image(engine.0, &info));
    assert_eq!(monotonic(&told).last().unwrap(), &("render".into(), 1.0));

    // Passes change nothing of the result.
    let whole = self::field(engine.0, &hl_precompute_info { directions: 256, ..quick(volume) });
    assert_eq!(pixels(image(engine.0, &small(whole))), pixels(image(engine.0, &small(field))));
}

#[test]
fn finished_passes_are_there_before_the_end_and_after_a_cancel() {
    let engine = Engine::new();
    let info = hl_precompute_info { directions: 4096, progressive: 1, near_slices: 8, ratio: 1, ..quick(volume(engine.0, 32)) };
    let mut job = std::ptr::null_mut();
    ok!(hl_precompute_start(engine.0, &info, &mut job));
    let begun = Instant::now();
    while poll(job).passes == 0 {
        assert!(poll(job).status == HL_NOT_READY && begun.elapsed() < Duration::from_secs(100), "{:?}", crate::last(engine.0));
        std::thread::sleep(Duration::from_millis(2));
    }
    let mut early = std::ptr::null_mut();
    ok!(hl_job_get_field(job, &mut early));
    // While the job goes on: its own device time is booked apart.
    let before = pixels(image(engine.0, &small(early)));
    assert_eq!(poll(job).status, HL_NOT_READY);
    assert!(!kernels(job).iter().any(|k| k == "raymarch"));
    ok!(hl_job_cancel(job));
    refused!(HL_ERROR_CANCELLED, "cancelled", hl_job_wait(job, -1.0));
    let mut late = std::ptr::null_mut();
    ok!(hl_job_get_field(job, &mut late));
    ok!(hl_job_destroy(job));
    assert_eq!(pixels(image(engine.0, &small(early))), before);
    // It is what it is: of fewer directions, and not taken for the field that was asked for.
    let mut found: hl_field_info = init();
    ok!(hl_field_get_info(early, &mut found));
    assert!((512..4096).contains(&found.directions), "{}", found.directions);
    ok!(hl_precompute_start(engine.0, &hl_precompute_info { previous: early, ..info }, &mut job));
    let begun = Instant::now();
    while !kernels(job).iter().any(|k| k == "sweep") {
        assert!(poll(job).status == HL_NOT_READY && begun.elapsed() < Duration::from_secs(100), "{:?}", crate::last(engine.0));
        std::thread::sleep(Duration::from_millis(2));
    }
    ok!(hl_job_cancel(job));
    refused!(HL_ERROR_CANCELLED, "cancelled", hl_job_wait(job, -1.0));
    ok!(hl_job_destroy(job));
    assert!(before.iter().any(|&v| v > 0.1) && pixels(image(engine.0, &small(late))).iter().all(|v| v.is_finite()));
}

#[test]
fn a_callback_can_cancel() {
    let engine = Engine::new();
    let told = Told { stop_at: AtomicU32::new(3), ..Told::default() };
    let info = hl_precompute_info { progress: Some(progress), user: user(&told), ..long(volume(engine.0, 16)) };
    let mut field = std::ptr::null_mut();
    refused!(HL_ERROR_CANCELLED, "cancelled", hl_precompute(engine.0, &info, &mut field));
    assert!(field.is_null() && monotonic(&told).len() == 3);
}

#[test]
fn inputs_of_a_job_cannot_be_changed() {
    let engine = Engine::new();
    let (volume, points) = (volume(engine.0, 16), points(true, 0.8));
    let transfer = transfer(engine.0, &points);
    let mut job = std::ptr::null_mut();
    ok!(hl_precompute_start(engine.0, &hl_precompute_info { transfer, ..long(volume) }, &mut job));
    refused!(HL_ERROR_BUSY, "running job", hl_transfer_set(transfer, &transfer_info(&points)));
    // Destroyed, yes.
    ok!(hl_transfer_destroy(transfer));
    ok!(hl_job_destroy(job));

    let mut light = std::ptr::null_mut();
    ok!(hl_light_create(engine.0, std::ptr::null(), &mut light));
    let field = field(engine.0, &quick(volume));
    let told = Told::default();
    let info = hl_render_info { light, width: 2000, height: 2000, step: 0.1, progress: Some(progress), user: user(&told), ..small(field) };
    ok!(hl_render_start(engine.0, &info, &mut job));
    refused!(HL_ERROR_BUSY, "running job", hl_light_rotate(light, [0.0, 0.0, 1.0].as_ptr(), 3.0));
    refused!(HL_ERROR_BUSY, "running job", hl_light_set(light, &init()));
    ok!(hl_job_destroy(job));
    ok!(hl_light_rotate(light, [0.0, 0.0, 1.0].as_ptr(), 3.0));
}

#[test]
fn edits_redo_what_depends_on_them() {
    let engine = Engine::new();
    let volume = volume(engine.0, 16);
    let transfer = transfer(engine.0, &points(true, 0.8));
    let run = |info: &hl_precompute_info| {
        let mut job = std::ptr::null_mut();
        ok!(hl_precompute_start(engine.0, info, &mut job));
        ok!(hl_job_wait(job, -1.0));
        let (mut field, kernels) = (std::ptr::null_mut(), kernels(job));
        ok!(hl_job_get_field(job, &mut field));
        ok!(hl_job_destroy(job));
        (field, kernels.join(" "))
    };
    let shown = |info: &hl_render_info| {
        let mut job = std::ptr::null_mut();
        ok!(hl_render_start(engine.0, info, &mut job));
        ok!(hl_job_wait(job, -1.0));
        let (mut image, kernels) = (std::ptr::null_mut(), kernels(job));
        ok!(hl_job_get_image(job, &mut image));
        ok!(hl_job_destroy(job));
        (pixels(image), kernels.join(" "))
    };
    let info = hl_precompute_info { transfer, ..quick(volume) };
    let (first, kernels) = run(&info);
    assert!(kernels.contains("sweep"), "{kernels}");
    // Colours alone: no visibility; and the picture is that of a field computed anew.
    ok!(hl_transfer_set(transfer, &transfer_info(&points(false, 0.8))));
    let (blue, kernels) = run(&hl_precompute_info { previous: first, ..info });
    assert!(!kernels.contains("sweep") && !kernels.contains("pack"), "{kernels}");
    assert_eq!(shown(&small(blue)).0, shown(&small(run(&info).0)).0);
    assert_ne!(shown(&small(blue)).0, shown(&small(first)).0);
    // Opacity, settings, volume, surface: anew.
    ok!(hl_transfer_set(transfer, &transfer_info(&points(false, 0.7))));
    assert!(run(&hl_precompute_info { previous: first, ..info }).1.contains("sweep"));
    ok!(hl_transfer_set(transfer, &transfer_info(&points(true, 0.8))));
    assert!(run(&hl_precompute_info { previous: first, directions: 33, ..info }).1.contains("sweep"));
    assert!(run(&hl_precompute_info { previous: first, volume: self::volume(engine.0, 16), ..info }).1.contains("sweep"));
    let surface = hl_surface { iso: 100.0, ..init() };
    assert!(run(&hl_precompute_info { previous: first, surface: &surface, ..info }).1.contains("sweep"));

    // Light: relit, nothing else; camera: rendered, nothing else.
    let mut light = std::ptr::null_mut();
    let toward = hl_light_info { kind: HL_LIGHT_CONE, radiance: [3.0; 3], toward: [1.0, 0.0, 0.2], half_angle: 30.0, ..init() };
    ok!(hl_light_create(engine.0, &toward, &mut light));
    let view = hl_render_info { light, ..small(first) };
    let (one, kernels) = shown(&view);
    assert_eq!(kernels, "relight raymarch resolve");
    assert_eq!(shown(&hl_render_info { width: 50, ..view }).1, "raymarch resolve");
    ok!(hl_light_rotate(light, [0.0, 0.0, 1.0].as_ptr(), 90.0));
    let (turned, kernels) = shown(&view);
    assert!(kernels == "relight raymarch resolve" && turned != one);
    // A full turn later it is as before, but for rounding.
    ok!(hl_light_rotate(light, [0.0, 0.0, 1.0].as_ptr(), 360.0));
    let worst = shown(&view).0.iter().zip(&one).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 2e-3, "{worst}");
}

#[test]
fn errors_are_measured_and_tolerances_kept() {
    let engine = Engine::new();
    let volume = volume(engine.0, 24);
    let run = |info: &hl_precompute_info| {
        let mut job = std::ptr::null_mut();
        ok!(hl_precompute_start(engine.0, info, &mut job));
        ok!(hl_job_wait(job, -1.0));
        let (state, mut field, mut found) = (poll(job), std::ptr::null_mut(), init::<hl_field_info>());
        ok!(hl_job_get_field(job, &mut field));
        ok!(hl_field_get_info(field, &mut found));
        assert!(state.error == found.error && state.error_low <= state.error && state.error <= state.error_high);
        (state, found)
    };
    let (few, _) = run(&hl_precompute_info { measure: 1, ..quick(volume) });
    let (many, _) = run(&hl_precompute_info { measure: 1, directions: 256, near_slices: 2, ..quick(volume) });
    assert!(many.error > 0.0 && many.error < few.error, "{} {}", many.error, few.error);
    // Measuring is no pass.
    assert_eq!((few.passes, many.passes), (1, 1));
    let (passes, _) = run(&hl_precompute_info { measure: 1, directions: 256, progressive: 1, ..quick(volume) });
    assert_eq!((passes.passes, passes.directions), (4, 256));
    // A field that is there is measured, where it was not.
    let plain = field(engine.0, &quick(volume));
    let (again, _) = run(&hl_precompute_info { measure: 1, previous: plain, ..quick(volume) });
    assert!(again.error == few.error && again.passes == 1, "{} {}", again.error, few.error);
    let (planned, found) = run(&hl_precompute_info { volume, tolerance: 0.1, ..init() });
    assert!(planned.error_high <= 0.1 && planned.passes == 1, "{} {}", planned.error_high, planned.passes);
    println!("tolerance 0.1: method {}, {} directions, error {:.4}", found.method, found.directions, planned.error);
}

#[test]
fn a_planned_field_gets_better_pass_by_pass() {
    let engine = Engine::new();
    // Tight enough for a sweep of more directions than a first pass has.
    let info = hl_precompute_info { tolerance: 0.02, ratio: 4, progressive: 1, ..init() };
    let info = hl_precompute_info { volume: volume(engine.0, 48), ..info };
    let mut said: hl_estimate = init();
    ok!(hl_precompute_estimate(engine.0, &info, &mut said));
    let mut job = std::ptr::null_mut();
    ok!(hl_precompute_start(engine.0, &info, &mut job));
    ok!(hl_job_wait(job, -1.0));
    let (state, mut field, mut found) = (poll(job), std::ptr::null_mut(), init::<hl_field_info>());
    ok!(hl_job_get_field(job, &mut field));
    ok!(hl_field_get_info(field, &mut found));
    println!(
        "planned: said {:.2} s and {} bytes; {} passes, method {}, {} directions, error {:.4} of 0.02",
        said.seconds, said.peak, state.passes, found.method, found.directions, found.error
    );
    assert!(said.seconds > 0.0 && said.peak > said.result);
    assert!(found.error_high <= 0.02 && found.error == state.error && found.directions == state.directions);
    assert!(found.method == HL_METHOD_SWEEP && found.directions >= 64 && state.passes >= 2, "{} passes", state.passes);
    // The whole at once is the same field.
    let settled = hl_precompute_info {
        tolerance: 0.0,
        method: found.method,
        ratio: found.ratio,
        bits: found.bits,
        directions: found.directions,
        near_slices: found.near_slices,
        step: found.step,
        progressive: 0,
        ..info
    };
    let whole = self::field(engine.0, &settled);
    assert_eq!(pixels(image(engine.0, &small(whole))), pixels(image(engine.0, &small(field))));

    // Cancelled after its first pass: that stays, and is not called measured.
    let told = Told { stop_at: AtomicU32::new(u32::MAX), ..Told::default() };
    let info = hl_precompute_info { progress: Some(progress), user: user(&told), ratio: 1, ..info };
    ok!(hl_precompute_start(engine.0, &info, &mut job));
    let begun = Instant::now();
    while poll(job).passes == 0 && poll(job).status == HL_NOT_READY {
        assert!(begun.elapsed() < Duration::from_secs(200));
        std::thread::sleep(Duration::from_millis(2));
    }
    ok!(hl_job_cancel(job));
    // SAFETY: a job of ours.
    let ended = unsafe { hl_job_wait(job, -1.0) };
    monotonic(&told);
    if ended == HL_ERROR_CANCELLED {
        ok!(hl_job_get_field(job, &mut field));
        ok!(hl_field_get_info(field, &mut found));
        assert!(found.error < 0.0 && pixels(image(engine.0, &small(field))).iter().any(|&v| v > 0.1));
    } else {
        assert_eq!(ended, HL_OK);
    }
}

static INNER: AtomicPtr<hl_engine> = AtomicPtr::new(std::ptr::null_mut());
static ANSWERS: Mutex<Vec<(&str, i32)>> = Mutex::new(Vec::new());

/// Calls back into everything.
unsafe extern "C-unwind" fn meddle(user: *mut c_void, _: *const c_char, _: f32) -> i32 {
    let engine = INNER.load(Ordering::SeqCst);
    let field: *mut hl_field = user.cast();
    let (mut image, mut light, mut device) = (std::ptr::null_mut(), std::ptr::null_mut(), init::<hl_device_info>());
    // SAFETY: what is wrong with these calls is where they are made, which the library promises to find out.
    let answers = unsafe {
        vec![
            ("render", hl_render(engine, &small(field), &mut image)),
            ("light", hl_light_create(engine, std::ptr::null(), &mut light)),
            ("read", hl_field_read(field, std::ptr::null_mut(), 0)),
            ("device", hl_engine_get_device(engine, &mut device)),
            ("destroy field", hl_field_destroy(field)),
            ("destroy engine", hl_engine_destroy(engine)),
            ("last error", hl_last_error(engine, std::ptr::null_mut(), 0)),
        ]
    };
    let mut kept = ANSWERS.lock().unwrap();
    if kept.is_empty() {
        *kept = answers;
    }
    0
}

#[test]
fn calls_from_within_a_callback_are_refused() {
    let (engine, other) = (Engine::new(), Engine::new());
    INNER.store(engine.0, Ordering::SeqCst);
    let field = field(engine.0, &quick(volume(engine.0, 16)));
    let info = hl_render_info { progress: Some(meddle), user: field.cast(), ..small(field) };
    assert!(pixels(image(engine.0, &info)).iter().any(|&v| v > 0.1));
    let answers = std::mem::take(&mut *ANSWERS.lock().unwrap());
    assert_eq!(answers.len(), 7);
    assert!(answers.iter().all(|a| a.1 == HL_ERROR_REENTRANT), "{answers:?}");
    // Another engine may be used there.
    let far = self::field(other.0, &quick(volume(other.0, 16)));
    let info = hl_render_info { progress: Some(meddle), user: field.cast(), ..small(far) };
    pixels(image(other.0, &info));
    let answers = ANSWERS.lock().unwrap().clone();
    assert_eq!(answers[0], ("render", HL_OK), "{answers:?}");
    // Among the calls was the end of the first engine: its handles are known to be gone.
    assert_eq!(answers[5], ("destroy engine", HL_OK));
    let mut info: hl_device_info = init();
    refused!(HL_ERROR_HANDLE, "not known", hl_engine_get_device(engine.0, &mut info));
}
