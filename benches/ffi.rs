//! What a frame costs through the C interface, over the same call in Rust: both in turns, in one process, on the same scene.
//!
//! `cargo bench --bench ffi`

use halflight::engine::{Engine, Options};
use halflight::ffi::*;
use halflight::record::Record;
use halflight::scene::{ImageSettings, Light, Samples, Visibility};
use halflight::{Result, demo};
use std::ops::ControlFlow;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

/// Frames of each kind.
const FRAMES: usize = 60;

fn init<T: abi::Sized_>() -> T {
    // SAFETY: any bytes are a value of such a struct.
    let mut value: T = unsafe { std::mem::MaybeUninit::zeroed().assume_init() };
    // SAFETY: every such struct begins with its size.
    unsafe { std::ptr::from_mut(&mut value).cast::<u32>().write(size_of::<T>() as u32) };
    value
}

fn ok(status: hl_status) {
    assert_eq!(status, HL_OK);
}

fn main() -> ExitCode {
    let bench = std::env::args().any(|a| a == "--bench");
    match run(if bench { FRAMES } else { 2 }) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::FAILURE
        }
    }
}

fn run(frames: usize) -> Result<()> {
    let (width, height) = (320, 240);
    let volume = demo::volume(64)?;
    let Samples::U8(data) = volume.samples() else { return Ok(()) };
    let camera = demo::camera(volume.grid());
    let points: Vec<[f64; 5]> = vec![[50.0, 0.55, 0.62, 0.72, 0.0], [130.0, 0.55, 0.62, 0.72, 0.05], [210.0, 0.92, 0.9, 0.86, 0.6]];
    let mut quiet = |_: &'static str, _: f32| ControlFlow::Continue(());

    let engine = Engine::new(&Options::default())?;
    let matter = halflight::scene::Matter {
        transfer: halflight::scene::Transfer::from_points(&points, Default::default(), Default::default())?,
        surface: None,
    };
    let medium = engine.classify(&engine.upload(&volume)?, &matter)?;
    let settings = Visibility { directions: 64, ..Visibility::default() };
    let field = engine.precompute(&medium, &settings, &mut quiet)?;
    let lit = engine.relight(&field, &Light::constant([1.0; 3]))?;
    let image = ImageSettings { width, height, ..ImageSettings::default() };

    let grid = volume.grid();
    let mut c_engine = std::ptr::null_mut();
    let mut c_volume = std::ptr::null_mut();
    let mut transfer = std::ptr::null_mut();
    let mut c_field = std::ptr::null_mut();
    let info = hl_volume_info {
        data: data.as_ptr().cast(),
        dims: grid.dims().map(|n| n as u32),
        r#type: HL_UINT8,
        spacing: grid.spacing(),
        ..init()
    };
    // SAFETY: what the header asks for.
    unsafe {
        ok(hl_engine_create(std::ptr::null(), &mut c_engine));
        ok(hl_volume_create(c_engine, &info, &mut c_volume));
        let info = hl_transfer_info { points: points.as_ptr().cast(), count: points.len() as u32, ..init() };
        ok(hl_transfer_create(c_engine, &info, &mut transfer));
        let info = hl_precompute_info { volume: c_volume, transfer, directions: 64, ..init() };
        ok(hl_precompute(c_engine, &info, &mut c_field));
    }
    let c_camera = hl_camera {
        position: camera.position.to_array(),
        target: camera.target.to_array(),
        up: camera.up.to_array(),
        fov: camera.fov_degrees,
        space: HL_CAMERA_WORLD,
        ..init()
    };
    let view = hl_render_info { field: c_field, camera: &c_camera, width: width as u32, height: height as u32, ..init() };
    let mut into = vec![[0f32; 4]; width * height];
    let mut frame = || {
        let (mut made, start) = (std::ptr::null_mut(), Instant::now());
        // SAFETY: as above.
        unsafe {
            ok(hl_render(c_engine, &view, &mut made));
            ok(hl_image_read(made, HL_RGBA32F, 0.0, into.as_mut_ptr().cast(), 0, 16 * into.len() as u64));
            ok(hl_image_destroy(made));
        }
        start.elapsed().as_secs_f64()
    };
    let (mut rust, mut c) = (Vec::new(), Vec::new());
    let mut picture = engine.render(&medium, &lit, &camera, &image, &mut quiet)?;
    frame();
    for _ in 0..frames {
        let start = Instant::now();
        picture = engine.render(&medium, &lit, &camera, &image, &mut quiet)?;
        rust.push(start.elapsed().as_secs_f64());
        c.push(frame());
    }
    assert!(picture.rgba == into, "both make the same picture");
    let median = |v: &mut Vec<f64>| {
        v.sort_by(f64::total_cmp);
        v[v.len() / 2]
    };
    let least = |v: &[f64]| v.iter().copied().fold(f64::INFINITY, f64::min);
    let (r, m) = (median(&mut rust), median(&mut c));
    println!("a frame of {width}x{height}, {frames} of each in turns:");
    println!("  Rust             {:.2} ms median, {:.2} ms least", 1e3 * r, 1e3 * least(&rust));
    println!("  C, with its copy {:.2} ms median, {:.2} ms least", 1e3 * m, 1e3 * least(&c));
    println!("  C over Rust      {:+.2} % of medians, {:+.2} % of least", 100.0 * (m / r - 1.0), 100.0 * (least(&c) / least(&rust) - 1.0));
    // SAFETY: as above.
    unsafe { ok(hl_engine_destroy(c_engine)) };
    // A run that only tests is none to record.
    if frames == FRAMES {
        let mut record = Record::new("ffi", engine.device());
        record.add(format!("a frame of {width}x{height} through Rust"), "s", rust);
        record.add(format!("a frame of {width}x{height} through C, with its copy"), "s", c);
        println!("wrote {}", record.write(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/benches/records")))?.display());
    }
    Ok(())
}
