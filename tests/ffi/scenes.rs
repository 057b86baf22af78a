//! A small scene for the tests.

use crate::init;
use halflight::ffi::*;

/// Samples of a ball with a bite, 0..255.
pub fn ball(n: usize) -> Vec<u8> {
    let at = |i: usize| (i as f64 + 0.5) / n as f64 - 0.5;
    let mut all = Vec::with_capacity(n * n * n);
    for z in 0..n {
        for y in 0..n {
            for x in 0..n {
                let (r, bite) = ((at(x).powi(2) + at(y).powi(2) + at(z).powi(2)).sqrt(), at(x) > 0.0 && at(y) < 0.0);
                all.push(if bite { 0 } else { (255.0 * (1.0 - r / 0.45).clamp(0.0, 1.0)) as u8 });
            }
        }
    }
    all
}

pub fn volume_info(data: &[u8], n: usize) -> hl_volume_info {
    hl_volume_info { data: data.as_ptr().cast(), dims: [n as u32; 3], r#type: HL_UINT8, ..init() }
}

pub fn volume(engine: *mut hl_engine, n: usize) -> *mut hl_volume {
    let data = ball(n);
    let mut volume = std::ptr::null_mut();
    ok!(hl_volume_create(engine, &volume_info(&data, n), &mut volume));
    volume
}

/// Fast to precompute.
pub fn quick(volume: *mut hl_volume) -> hl_precompute_info {
    hl_precompute_info { volume, method: HL_METHOD_SWEEP, directions: 32, ..init() }
}

pub fn field(engine: *mut hl_engine, info: &hl_precompute_info) -> *mut hl_field {
    let mut field = std::ptr::null_mut();
    ok!(hl_precompute(engine, info, &mut field));
    field
}

pub fn small(field: *mut hl_field) -> hl_render_info {
    hl_render_info { field, width: 40, height: 30, ..init() }
}

pub fn image(engine: *mut hl_engine, info: &hl_render_info) -> *mut hl_image {
    let mut image = std::ptr::null_mut();
    ok!(hl_render(engine, info, &mut image));
    image
}

/// All pixels.
pub fn pixels(image: *const hl_image) -> Vec<f32> {
    let (mut w, mut h) = (0, 0);
    ok!(hl_image_get_size(image, &mut w, &mut h));
    let mut all = vec![0f32; 4 * (w * h) as usize];
    ok!(hl_image_read(image, HL_RGBA32F, 0.0, all.as_mut_ptr().cast(), 0, 4 * all.len() as u64));
    all
}

/// A transfer function of points.
pub fn transfer(engine: *mut hl_engine, points: &[[f64; 5]]) -> *mut hl_transfer {
    let mut transfer = std::ptr::null_mut();
    ok!(hl_transfer_create(engine, &transfer_info(points), &mut transfer));
    transfer
}

pub fn transfer_info(points: &[[f64; 5]]) -> hl_transfer_info {
    hl_transfer_info { points: points.as_ptr().cast(), count: points.len() as u32, ..init() }
}

/// Red or blue, transparent to opaque.
pub fn points(red: bool, top: f64) -> [[f64; 5]; 2] {
    let (r, b) = if red { (0.9, 0.1) } else { (0.1, 0.9) };
    [[0.0, r, 0.3, b, 0.0], [255.0, r, 0.3, b, top]]
}

/// What a job's kernels were.
pub fn kernels(job: *const hl_job) -> Vec<String> {
    let mut all = Vec::new();
    for i in 0.. {
        let mut timing: hl_timing = init();
        // SAFETY: a job and a struct of ours.
        match unsafe { hl_job_timing(job, i, &mut timing) } {
            HL_OK => all.push(text(&timing.kernel)),
            HL_END => return all,
            other => panic!("{other}"),
        }
    }
    all
}

pub fn text(chars: &[std::ffi::c_char]) -> String {
    chars.iter().take_while(|&&c| c != 0).map(|&c| c as u8 as char).collect()
}
