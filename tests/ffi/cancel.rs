//! How soon a job ends once it was cancelled.

use crate::jobs::{long, poll};
use crate::scenes::*;
use crate::{Engine, init};
use halflight::ffi::*;
use std::time::{Duration, Instant};

type Start<'a> = Box<dyn Fn(*mut *mut hl_job) -> i32 + 'a>;

/// Starts a job and cancels it after each of some times: seconds from cancel to end, ascending. Jobs that ended before are not
/// counted.
fn cancelled(start: &Start, after: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut latencies = Vec::new();
    for seconds in after {
        let mut job = std::ptr::null_mut();
        assert_eq!(start(&mut job), HL_OK, "{}", crate::last(std::ptr::null()).1);
        std::thread::sleep(Duration::from_secs_f64(seconds));
        let start = Instant::now();
        ok!(hl_job_cancel(job));
        // SAFETY: a job of ours.
        let ended = unsafe { hl_job_wait(job, -1.0) };
        let latency = start.elapsed().as_secs_f64();
        if ended == HL_ERROR_CANCELLED {
            assert!(crate::last(std::ptr::null()).1.contains("cancelled"));
            latencies.push(latency);
        } else {
            assert_eq!(ended, HL_OK);
        }
        assert_eq!(poll(job).status, ended);
        ok!(hl_job_destroy(job));
    }
    latencies.sort_by(f64::total_cmp);
    latencies
}

fn say(name: &str, latencies: &[f64]) {
    let median = latencies[latencies.len() / 2];
    println!("cancel latency of a {name}: median {median:.3} s, largest {:.3} s of {}", latencies[latencies.len() - 1], latencies.len());
}

#[test]
fn cancel_is_prompt_and_leaves_the_engine_whole() {
    let engine = Engine::new();
    let volume = volume(engine.0, 32);
    let seen = field(engine.0, &quick(volume));
    let large = hl_render_info { width: 3000, height: 2000, step: 0.02, ..small(seen) };
    let long = long(volume);
    // SAFETY: what the header asks for.
    let precompute = |info: hl_precompute_info| -> Start { Box::new(move |job| unsafe { hl_precompute_start(engine.0, &info, job) }) };
    // SAFETY: as above.
    let render = |info: hl_render_info| -> Start { Box::new(move |job| unsafe { hl_render_start(engine.0, &info, job) }) };
    let works = [
        ("march", precompute(long)),
        ("hierarchical", precompute(hl_precompute_info { method: HL_METHOD_HIERARCHICAL, ..long })),
        ("sweep", precompute(hl_precompute_info { method: HL_METHOD_SWEEP, near_slices: 8, directions: 4096, ..long })),
        ("measured field", precompute(hl_precompute_info { measure: 1, ratio: 1, ..quick(volume) })),
        ("picture", render(large)),
        ("picture with layers", render(hl_render_info { layers: HL_LAYER_NORMAL, ..large })),
        ("reference", render(hl_render_info { reference: 1e-6, width: 640, height: 480, ..small(seen) })),
    ];
    for (name, start) in works {
        let latencies = cancelled(&start, (0..5).map(|i| 0.1 + 0.07 * f64::from(i)));
        say(name, &latencies);
        // One dispatch of 0.08 s; ten times that where the machine is shared.
        assert!(latencies.len() == 5 && latencies[2] < 0.8, "{name}: {latencies:?}");
    }
    let field = field(engine.0, &quick(volume));
    assert!(pixels(image(engine.0, &small(field))).iter().any(|&v| v > 0.1));
}

/// Voxels along a side of the larger volume.
fn side() -> usize {
    std::env::var("HALFLIGHT_CANCEL_SIDE").ok().and_then(|n| n.parse().ok()).unwrap_or(256)
}

#[test]
fn cancel_is_prompt_in_a_large_volume() {
    let n = side();
    let engine = Engine::new();
    let volume = volume(engine.0, n);
    let seen = field(engine.0, &quick(volume));
    let mut light = std::ptr::null_mut();
    let cone = hl_light_info { kind: HL_LIGHT_CONE, radiance: [3.0; 3], toward: [1.0, 0.0, 0.2], half_angle: 30.0, ..init() };
    ok!(hl_light_create(engine.0, &cone, &mut light));
    let clip = hl_clip { high: [0.5, 1.0, 1.0], ..init() };
    let surface = hl_surface { iso: 100.0, ..init() };
    // SAFETY: what the header asks for.
    let precompute = |info: hl_precompute_info| -> Start { Box::new(move |job| unsafe { hl_precompute_start(engine.0, &info, job) }) };
    // SAFETY: as above.
    let estimate =
        |info: hl_precompute_info| -> Start { Box::new(move |job| unsafe { hl_precompute_estimate_start(engine.0, &info, job) }) };
    // SAFETY: as above.
    let render = |info: hl_render_info| -> Start { Box::new(move |job| unsafe { hl_render_start(engine.0, &info, job) }) };
    let fine = hl_precompute_info { volume, ratio: 2, ..init() };
    let works = [
        ("hierarchical field", precompute(hl_precompute_info { method: HL_METHOD_HIERARCHICAL, ..fine })),
        ("swept field", precompute(hl_precompute_info { method: HL_METHOD_SWEEP, progressive: 1, ..fine })),
        ("marched field of all cells", precompute(hl_precompute_info { method: HL_METHOD_MARCH, all_cells: 1, ..fine })),
        ("swept field of a surface", precompute(hl_precompute_info { method: HL_METHOD_SWEEP, surface: &surface, ..fine })),
        ("measured field", precompute(hl_precompute_info { measure: 1, ..quick(volume) })),
        ("planned field", precompute(hl_precompute_info { tolerance: 0.05, ..fine })),
        ("plan's estimate", estimate(hl_precompute_info { tolerance: 0.05, ..fine })),
        ("picture, cut and lit anew", render(hl_render_info { light, clip: &clip, width: 1024, height: 768, ..small(seen) })),
        ("reference picture", render(hl_render_info { reference: 1e-6, width: 640, height: 480, ..small(seen) })),
    ];
    let mut all = Vec::new();
    for (name, start) in works {
        // Close together at first: that is where a volume is looked at whole.
        let latencies = cancelled(&start, (0..12).map(|i| 0.005 * 1.6f64.powi(i)));
        say(&format!("{name}, {n}x{n}x{n} voxels"), &latencies);
        all.extend(latencies);
    }
    all.sort_by(f64::total_cmp);
    say("job of any kind", &all);
    assert!(all.len() > 60);
    // Bounded by one dispatch of 0.08 s, or by one look at all voxels on the host; ten times that where the machine is shared.
    assert!(all[all.len() / 2] < 0.4 && all[all.len() - 1] < 2.0, "{all:?}");
    assert!(pixels(image(engine.0, &small(seen))).iter().any(|&v| v > 0.1));
}
