//! Reference pictures: their own error, and their passes.

use crate::jobs::poll;
use crate::scenes::*;
use crate::{Engine, init};
use halflight::ffi::*;
use std::ffi::{c_char, c_void};
use std::time::{Duration, Instant};

#[test]
fn a_reference_picture_knows_its_own_error() {
    let engine = Engine::new();
    // A cell a voxel: coarser ones would be seen.
    let fine = hl_precompute_info { ratio: 1, directions: 256, near_slices: 2, ..quick(volume(engine.0, 16)) };
    let field = field(engine.0, &fine);
    let mut job = std::ptr::null_mut();
    let info = hl_render_info { reference: 0.05, ..small(field) };
    ok!(hl_render_start(engine.0, &info, &mut job));
    ok!(hl_job_wait(job, -1.0));
    let state = poll(job);
    assert!(state.error > 0.0 && state.error <= 0.05 && state.directions >= 32, "{} {}", state.error, state.directions);
    let mut truth = std::ptr::null_mut();
    ok!(hl_job_get_image(job, &mut truth));
    let mut difference: hl_difference = init();
    ok!(hl_image_compare(image(engine.0, &small(field)), truth, &mut difference));
    println!("against the reference: relative RMSE {:.3}, mean {:.3}", difference.relative_rmse, difference.mean_ratio);
    assert!(difference.relative_rmse < 0.25 && (difference.mean_ratio - 1.0).abs() < 0.1);
}

#[test]
fn a_cancelled_reference_picture_is_no_success_and_keeps_its_passes() {
    let engine = Engine::new();
    let field = field(engine.0, &quick(volume(engine.0, 16)));
    let (mut job, mut kept) = (std::ptr::null_mut(), std::ptr::null_mut());
    let info = hl_render_info { reference: 1e-6, reference_samples: 1 << 24, width: 8, height: 6, ..small(field) };
    ok!(hl_render_start(engine.0, &info, &mut job));
    // Its first pass takes some milliseconds, all of them hours.
    // SAFETY: a job of ours.
    assert_eq!(unsafe { hl_job_wait(job, 3.0) }, HL_TIMEOUT);
    ok!(hl_job_cancel(job));
    refused!(HL_ERROR_CANCELLED, "cancelled", hl_job_wait(job, -1.0));
    let state = poll(job);
    assert!(state.status == HL_ERROR_CANCELLED && state.passes >= 2 && state.directions >= 64 && state.error > 0.0, "{}", state.error);
    ok!(hl_job_get_image(job, &mut kept));
    assert!(pixels(kept).iter().any(|&v| v > 0.1));

    // A blocking call gives no picture.
    let until = Until(Instant::now() + Duration::from_secs(3));
    let info = hl_render_info { progress: Some(stop_then), user: std::ptr::from_ref(&until).cast_mut().cast(), ..info };
    let mut none = kept;
    refused!(HL_ERROR_CANCELLED, "cancelled", hl_render(engine.0, &info, &mut none));
    assert!(none.is_null());
}

struct Until(Instant);

unsafe extern "C-unwind" fn stop_then(user: *mut c_void, _: *const c_char, _: f32) -> i32 {
    // SAFETY: the test's own, which outlives the call.
    i32::from(Instant::now() > unsafe { &*user.cast::<Until>() }.0)
}

/// The standard error of a reference picture's pixels.
fn noise(image: *const hl_image, pixels: usize) -> Vec<f32> {
    let mut noise = vec![0f32; 3 * pixels];
    ok!(hl_image_read_layer(image, HL_LAYER_NOISE, noise.as_mut_ptr(), noise.len() as u64));
    noise
}

#[test]
fn a_reference_picture_is_there_pass_by_pass() {
    let engine = Engine::new();
    let field = field(engine.0, &quick(volume(engine.0, 16)));
    let mut job = std::ptr::null_mut();
    let view = hl_render_info { reference: 1e-6, reference_samples: 1 << 24, ..small(field) };
    ok!(hl_render_start(engine.0, &view, &mut job));
    let begun = Instant::now();
    // Each pass: samples, error that the job says, picture.
    let mut seen: Vec<(u32, f64, *mut hl_image)> = Vec::new();
    while seen.len() < 3 {
        assert!(begun.elapsed() < Duration::from_secs(100));
        let before = poll(job);
        // While it goes on.
        assert_eq!(before.status, HL_NOT_READY);
        let mut image = std::ptr::null_mut();
        // SAFETY: a job and a place of ours.
        let status = unsafe { hl_job_get_image(job, &mut image) };
        if before.passes == 0 || before.passes != poll(job).passes || seen.last().is_some_and(|s| s.0 == before.directions) {
            std::thread::sleep(Duration::from_millis(1));
            continue;
        }
        assert_eq!(status, HL_OK);
        seen.push((before.directions, before.error, image));
    }
    ok!(hl_job_cancel(job));
    refused!(HL_ERROR_CANCELLED, "cancelled", hl_job_wait(job, -1.0));
    let mut last = std::ptr::null_mut();
    let state = poll(job);
    ok!(hl_job_get_image(job, &mut last));
    ok!(hl_job_destroy(job));
    seen.push((state.directions, state.error, last));
    for (samples, error, image) in &seen {
        // The job's error is that of the image's own noise, over what is covered.
        let (rgba, noise) = (pixels(*image), noise(*image, 40 * 30));
        let covered = |i: &usize| rgba[4 * i + 3] > 0.0;
        let count = 3.0 * (0..1200).filter(covered).count() as f64;
        let squares: f64 = (0..1200).filter(covered).flat_map(|i| &noise[3 * i..3 * i + 3]).map(|&n| f64::from(n).powi(2)).sum();
        let sum: f64 = (0..1200).filter(covered).flat_map(|i| &rgba[4 * i..4 * i + 3]).map(|&v| f64::from(v)).sum();
        let found = (squares / count).sqrt() / (sum / count);
        assert!((found / error - 1.0).abs() < 1e-4, "{samples} samples: {found} in the image, {error} in the job");
        // It is the picture that so many samples make, bit for bit.
        let whole = crate::scenes::image(engine.0, &hl_render_info { reference_samples: *samples, ..view });
        assert!(pixels(whole) == rgba, "{samples} samples");
    }
    // Error falls with the root of the samples; sabotage: no pass is the one before.
    for w in seen.windows(2).filter(|w| w[1].0 > w[0].0) {
        let expected = (f64::from(w[0].0) / f64::from(w[1].0)).sqrt();
        println!("{} samples: error {:.4}; {}: {:.4}", w[0].0, w[0].1, w[1].0, w[1].1);
        assert!((w[1].1 / w[0].1 / expected - 1.0).abs() < 0.3 && pixels(w[0].2) != pixels(w[1].2));
    }
    // Saved beside the colours; a background is behind every pass; a picture without noise has none.
    let folder = tempfile::tempdir().unwrap();
    let path = std::ffi::CString::new(folder.path().join("r.exr").to_str().unwrap()).unwrap();
    ok!(hl_image_save(last, path.as_ptr(), &hl_save_info { layers: HL_LAYER_NOISE, ..init() }));
    let lit = hl_render_info { reference_samples: 32, background: HL_BACKGROUND_COLOR, background_color: [0.5; 3], ..view };
    assert!(pixels(image(engine.0, &lit)).iter().skip(3).step_by(4).all(|&a| a == 1.0));
    let (plain, mut numbers) = (image(engine.0, &small(field)), [0f32; 3600]);
    refused!(HL_ERROR_INVALID, "no layer noise", hl_image_read_layer(plain, HL_LAYER_NOISE, numbers.as_mut_ptr(), 3600));
    refused!(HL_ERROR_INVALID, "no layer depth", hl_image_read_layer(last, HL_LAYER_DEPTH, numbers.as_mut_ptr(), 2400));
}
