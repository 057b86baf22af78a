//! Estimates: what work will cost, said before it starts, against what it then takes.

use crate::jobs::{Told, poll, progress, user};
use crate::scenes::*;
use crate::{Engine, init};
use halflight::ffi::*;
use std::ptr::null_mut;
use std::sync::atomic::AtomicU32;

/// Whatever else runs on the machine makes a try slower, none faster.
const TRIES: u32 = 3;

pub fn device(engine: *mut hl_engine) -> hl_device_info {
    let mut info: hl_device_info = init();
    ok!(hl_engine_get_device(engine, &mut info));
    info
}

/// Estimates on one engine, works on another, so that what pilots hold is not taken for what the work holds: the least seconds of
/// some tries, and the memory, of both.
fn said_and_took(
    name: &str,
    begin: &dyn Fn(*mut hl_engine) -> *mut std::ffi::c_void,
    estimate: &dyn Fn(*mut hl_engine, *mut std::ffi::c_void, &mut hl_estimate),
    work: &dyn Fn(*mut hl_engine, *mut std::ffi::c_void, &mut *mut hl_job),
) -> hl_estimate {
    let (asked, worked) = (Engine::new(), Engine::new());
    let [input, other] = [&asked, &worked].map(|e| begin(e.0));
    let (mut said, mut least) = (init::<hl_estimate>(), f64::INFINITY);
    let (mut took, mut before, mut peak) = (f64::INFINITY, 0, 0);
    for try_ in 0..TRIES {
        estimate(asked.0, input, &mut said);
        least = least.min(said.seconds);
        let mut job = null_mut();
        if try_ == 0 {
            before = device(worked.0).memory_used;
        }
        work(worked.0, other, &mut job);
        ok!(hl_job_wait(job, -1.0));
        if try_ == 0 {
            peak = device(worked.0).memory_peak;
        }
        took = took.min(poll(job).device_seconds);
        ok!(hl_job_destroy(job));
    }
    println!("{name}: said {least:.4} s and {} bytes, took {took:.4} s and {peak}; {before} before, {} stay", said.peak, said.result);
    said.seconds = least;
    // A shared machine stretches either side: only what is wrong by its unit or leaves a stage out by orders is told. The figures
    // are printed above.
    assert!((0.05..20.0).contains(&(took / least)), "{name}: took {took} s, said {least}");
    // Never less than what is held; of what comes on top not much more.
    assert!(peak <= said.peak, "{name}: {peak} bytes held, {} said", said.peak);
    assert!(said.peak - before < 3 * (peak - before) + (1 << 20), "{name}: {peak} bytes held, {} said, {before} before", said.peak);
    assert!(said.result > 0 && said.free > said.peak);
    said
}

fn fields(name: &str, n: usize, info: &hl_precompute_info) -> hl_estimate {
    let of = |volume: *mut std::ffi::c_void| hl_precompute_info { volume: volume.cast(), ..*info };
    said_and_took(name, &|e| volume(e, n).cast(), &|e, v, said| ok!(hl_precompute_estimate(e, &of(v), said)), &|e, v, job| {
        ok!(hl_precompute_start(e, &of(v), job))
    })
}

fn pictures(name: &str, surface: bool, view: &hl_render_info) -> hl_estimate {
    let of = |field: *mut std::ffi::c_void| hl_render_info { field: field.cast(), ..*view };
    let opaque = hl_surface { iso: 100.0, ..init() };
    let surface = if surface { &raw const opaque } else { std::ptr::null() };
    said_and_took(
        name,
        &|e| field(e, &hl_precompute_info { surface, ..quick(volume(e, 48)) }).cast(),
        &|e, f, said| ok!(hl_render_estimate(e, &of(f), said)),
        &|e, f, job| ok!(hl_render_start(e, &of(f), job)),
    )
}

#[test]
fn fields_cost_what_was_said() {
    // As many directions as take some tenths of a second: less is the clock's noise.
    let methods = [("sweep", HL_METHOD_SWEEP, 2048), ("march", HL_METHOD_MARCH, 512), ("hierarchical", HL_METHOD_HIERARCHICAL, 512)];
    for (name, method, directions) in methods {
        let info = hl_precompute_info { method, directions, measure_seconds: 1.0, ..quick(null_mut()) };
        let plain = fields(name, 48, &info);
        let measured = fields(&format!("{name}, measured"), 48, &hl_precompute_info { measure: 1, ..info });
        // Sabotage: what is measured is not what is not. A card (kind 3 is a CPU) has seen all its probes before the second is over.
        let more = if device(Engine::new().0).kind == 3 { 0.3 } else { plain.seconds };
        assert!(measured.seconds > plain.seconds + more && measured.result == plain.result, "{}", measured.seconds);
    }
    let info = hl_precompute_info { directions: 2048, ..quick(null_mut()) };
    let [whole, passes] =
        [0, 1].map(|progressive| fields(&format!("sweep, progressive {progressive}"), 48, &hl_precompute_info { progressive, ..info }));
    assert_eq!(passes.peak - whole.peak, whole.result);
}

#[test]
fn planned_fields_cost_what_was_said() {
    let info = hl_precompute_info { tolerance: 0.1, ratio: 2, measure_seconds: 1.0, ..init() };
    let plain = fields("planned", 48, &info);
    let measured = fields("planned, measured", 48, &hl_precompute_info { measure: 1, ..info });
    assert!(measured.seconds > plain.seconds);
}

#[test]
fn a_field_that_is_there_costs_nothing() {
    let engine = Engine::new();
    let volume = volume(engine.0, 16);
    let transfer = transfer(engine.0, &points(true, 0.8));
    let info = hl_precompute_info { transfer, ..quick(volume) };
    let first = field(engine.0, &info);
    let mut said: hl_estimate = init();
    ok!(hl_transfer_set(transfer, &transfer_info(&points(false, 0.8))));
    ok!(hl_precompute_estimate(engine.0, &hl_precompute_info { previous: first, ..info }, &mut said));
    assert!(said.seconds == 0.0 && said.result > 0 && said.peak > said.result);
    // Unless it is to be measured first.
    ok!(hl_precompute_estimate(engine.0, &hl_precompute_info { previous: first, measure: 1, ..info }, &mut said));
    assert!(said.seconds > 0.0);
    ok!(hl_transfer_set(transfer, &transfer_info(&points(false, 0.7))));
    ok!(hl_precompute_estimate(engine.0, &hl_precompute_info { previous: first, ..info }, &mut said));
    assert!(said.seconds > 0.0);
}

#[test]
fn pictures_cost_what_was_said() {
    let view = hl_render_info { width: 320, height: 240, ..init() };
    let all = HL_LAYER_DEPTH | HL_LAYER_NORMAL | HL_LAYER_ALBEDO | HL_LAYER_IRRADIANCE | HL_LAYER_VISIBILITY | HL_LAYER_OPACITY;
    for (name, surface) in [("picture", false), ("surface", true)] {
        let plain = pictures(name, surface, &view);
        let layers = pictures(&format!("{name} with layers"), surface, &hl_render_info { layers: all, ..view });
        assert_eq!(plain.result, 320 * 240 * 16);
        assert!(layers.result >= 320 * 240 * (16 + 4 * 13) && layers.peak >= plain.peak, "{}", layers.result);
    }
    for surface in [false, true] {
        let view = hl_render_info { reference: 0.08, width: 160, height: 120, ..view };
        let traced = pictures(&format!("reference picture, surface {surface}"), surface, &view);
        assert_eq!(traced.result, 160 * 120 * 28);
        // Its bounds count.
        let few = pictures("the same of 32 samples", surface, &hl_render_info { reference_samples: 32, ..view });
        assert!(few.seconds < traced.seconds, "{} {}", few.seconds, traced.seconds);
    }
}

#[test]
fn an_estimate_is_a_job_as_others() {
    let engine = Engine::new();
    let volume = volume(engine.0, 64);
    let seen = field(engine.0, &quick(volume));
    let told = Told::default();
    let plan = hl_precompute_info { volume, tolerance: 0.02, ratio: 1, progress: Some(progress), user: user(&told), ..init() };
    let (mut job, mut said) = (null_mut(), init::<hl_estimate>());
    ok!(hl_precompute_estimate_start(engine.0, &plan, &mut job));
    // Others have the device meanwhile.
    assert!(pixels(image(engine.0, &small(seen))).iter().any(|&v| v > 0.1));
    assert_eq!(poll(job).status, HL_NOT_READY);
    // SAFETY: a job and a struct of ours.
    assert_eq!(unsafe { hl_job_get_estimate(job, &mut said) }, HL_NOT_READY);
    ok!(hl_job_wait(job, -1.0));
    ok!(hl_job_get_estimate(job, &mut said));
    assert!(said.seconds > 0.0 && said.peak > said.result && said.result > 0);
    let all = crate::jobs::monotonic(&told);
    assert!(all.last().unwrap().1 == 1.0 && all.iter().any(|t| t.0 == "plan"), "{all:?}");
    // Neither field nor picture come of it.
    let (mut field, mut picture) = (null_mut(), null_mut());
    // SAFETY: as above.
    assert_eq!(unsafe { [hl_job_get_field(job, &mut field), hl_job_get_image(job, &mut picture)] }, [HL_NOT_READY; 2]);
    // Cancelled, from outside and from the callback, also of a call that waits.
    ok!(hl_precompute_estimate_start(engine.0, &plan, &mut job));
    ok!(hl_job_cancel(job));
    refused!(HL_ERROR_CANCELLED, "cancelled", hl_job_wait(job, -1.0));
    // SAFETY: as above.
    assert_eq!(unsafe { hl_job_get_estimate(job, &mut said) }, HL_NOT_READY);
    for stop_at in [1, 4] {
        let told = Told { stop_at: AtomicU32::new(stop_at), ..Told::default() };
        let info = hl_precompute_info { user: user(&told), ..plan };
        refused!(HL_ERROR_CANCELLED, "cancelled", hl_precompute_estimate(engine.0, &info, &mut said));
        let told = Told { stop_at: AtomicU32::new(stop_at), ..Told::default() };
        let view = hl_render_info { reference: 0.01, width: 640, height: 480, progress: Some(progress), user: user(&told), ..small(seen) };
        refused!(HL_ERROR_CANCELLED, "cancelled", hl_render_estimate(engine.0, &view, &mut said));
    }
}
