//! The same scene on two devices, or on one whose compiler works otherwise: lavapipe with vectors of 4 and of 8 lanes, with
//! one thread and with two, or another driver that is named in `HALFLIGHT_OTHER_DRIVER`. Each runs in a child process, for
//! a driver reads its environment once.

use crate::common::{blobs, engine, linear, load, oblique, quiet, surface};
use halflight::engine::{Engine, Options, devices};
use halflight::scene::visibility::{Filter, Method, Sampling};
use halflight::scene::{Camera, ImageSettings, Light, Matter, Shading, Surface, Visibility};
use halflight::vk::DeviceKind;
use std::process::Command;

/// Names the file that a child writes its numbers to.
const CHILD: &str = "HALFLIGHT_STABILITY_CHILD";

/// Fields of every method in smooth and in opaque matter, and a picture of each.
fn numbers(engine: &Engine) -> Vec<Vec<f32>> {
    let mut out = Vec::new();
    let grid = oblique([19, 14, 11]);
    let volume = blobs(grid, 23);
    let opaque = surface(Surface { iso: 0.5, shading: Shading::Lambert, albedo: Some([0.8; 3]) });
    for matter in [linear(0.7), opaque] {
        let matter: Matter = matter;
        let (_, medium) = load(engine, &volume, &matter);
        for (method, sampling) in [
            (Method::March, Sampling::Stratified),
            (Method::March, Sampling::Jittered),
            (Method::Hierarchical, Sampling::Stratified),
            (Method::Sweep, Sampling::Stratified),
        ] {
            let s = Visibility {
                method,
                sampling,
                ratio: 2,
                directions: 96,
                bits: 32,
                step: 0.5,
                filter: Filter::Axis,
                ..Visibility::default()
            };
            let field = engine.precompute(&medium, &s, &mut quiet).expect("field");
            out.push(engine.read_field(&field).expect("read"));
            let lit = engine.relight(&field, &Light::constant([1.0, 0.5, 2.0])).expect("light");
            let image = ImageSettings { width: 24, height: 18, step: 0.5, ..ImageSettings::default() };
            let picture = engine.render(&medium, &lit, &Camera::framing(&grid), &image, &mut quiet).expect("picture");
            out.push(picture.rgba.into_iter().flatten().collect());
        }
    }
    out
}

#[test]
fn child_writes_its_numbers() {
    let Some(path) = std::env::var_os(CHILD) else { return };
    let engine = engine();
    println!("{DRIVER}{}\n{STEPS}{}", engine.device().driver, steps(&engine).unwrap_or(0));
    let bytes: Vec<u8> = numbers(&engine).iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(path, bytes).expect("written");
}

/// What a child prints before its driver's name, and before the steps that it interpolates in.
const DRIVER: &str = "driver: ";
const STEPS: &str = "steps: ";

fn steps(engine: &Engine) -> Option<u32> {
    engine.filtering().expect("filtering").map(|f| f.steps)
}

/// The numbers of a child with these variables set, its driver, and the steps that it interpolates in.
fn child(variables: &[(&str, &str)]) -> (Vec<f32>, String, Option<u32>) {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("numbers");
    let output = Command::new(std::env::current_exe().expect("this test"))
        .args(["--exact", "devices::child_writes_its_numbers", "--nocapture"])
        .env(CHILD, &path)
        .envs(variables.iter().copied())
        .output()
        .expect("the child starts");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{variables:?}: {said}");
    let line = |after: &str| said.split_once(after).and_then(|(_, rest)| rest.lines().next()).expect("the child's driver").to_owned();
    let steps = line(STEPS).parse().expect("a number");
    let bytes = std::fs::read(path).expect("the child wrote");
    let numbers = bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    (numbers, line(DRIVER), (steps > 0).then_some(steps))
}

/// √(Σ(a − b)²/Σb²) and the largest difference.
fn differences(a: &[f32], b: &[f32]) -> (f64, f64) {
    let (d, s) = a.iter().zip(b).fold((0.0, 0.0), |(d, s), (a, b)| (d + f64::from(a - b).powi(2), s + f64::from(*b).powi(2)));
    ((d / s).sqrt(), a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max))
}

/// Asserts that each part of `other` is that of `reference`. Where one of the devices interpolates in so many `steps`, and not
/// exactly, samples differ by a part of a step: an NVIDIA H200's fields in 256 steps from lavapipe's by at most 2.2e-4 in smooth
/// matter, and by 7.6e-3 beside an opaque edge.
fn agree(name: &str, other: &[f32], reference: &[Vec<f32>], steps: Option<u32>) {
    assert_eq!(other.len(), reference.iter().map(Vec::len).sum::<usize>());
    let mut at = 0;
    for (k, part) in reference.iter().enumerate() {
        let (relative, worst) = differences(&other[at..at + part.len()], part);
        at += part.len();
        println!("{name}, part {k}: relative {relative:.1e}, worst {worst:.1e}");
        // exp and division differ by a few ulp over some 50 steps; beside an opaque edge single rays of 96 may flip.
        let step = steps.map_or(0.0, |s| 1.0 / f64::from(s));
        let most = if k < reference.len() / 2 { SMOOTH + 0.1 * step } else { OPAQUE + 2.0 * step };
        assert!(relative < most, "{name}, part {k}: {relative}");
    }
}

const SMOOTH: f64 = 1e-5;
const OPAQUE: f64 = 3e-3;

#[test]
fn other_vectors_and_threads_give_the_same_numbers() {
    let here = engine();
    if here.device().kind != DeviceKind::Cpu {
        println!("skipped: {} is no CPU device, so its vectors cannot be chosen", here.device().name);
        return;
    }
    let reference = numbers(&here);
    let flat: Vec<f32> = reference.iter().flatten().copied().collect();
    assert!(flat.iter().all(|v| v.is_finite()));
    assert!(child(&[("LP_NUM_THREADS", "1")]).0.iter().zip(&flat).all(|(a, b)| a.to_bits() == b.to_bits()), "one thread gives other bits");
    for width in ["128", "256"] {
        agree(&format!("vectors of {width} bits"), &child(&[("LP_NATIVE_VECTOR_WIDTH", width)]).0, &reference, None);
    }
    // Sabotage: a tenth more extinction is not within it.
    let (_, denser) = load(&here, &blobs(oblique([19, 14, 11]), 23), &linear(0.77));
    let s = Visibility { method: Method::March, ratio: 2, directions: 96, bits: 32, step: 0.5, ..Visibility::default() };
    let field = here.precompute(&denser, &s, &mut quiet).expect("field");
    assert!(differences(&here.read_field(&field).expect("read"), &reference[0]).0 > OPAQUE);
}

/// Names the manifest (`*_icd.json`) of a second driver; `HALFLIGHT_OTHER_LIBRARIES`, where set, is the folder of the
/// libraries that it needs.
const OTHER: &str = "HALFLIGHT_OTHER_DRIVER";

#[test]
fn another_driver_gives_the_same_numbers() {
    let Ok(manifest) = std::env::var(OTHER) else {
        println!("skipped: {OTHER} names no second driver's manifest");
        return;
    };
    let libraries = std::env::var("HALFLIGHT_OTHER_LIBRARIES").or_else(|_| std::env::var("LD_LIBRARY_PATH")).unwrap_or_default();
    let here = engine();
    let reference = numbers(&here);
    // Each name is read by some loaders only.
    let variables = [("VK_DRIVER_FILES", &*manifest), ("VK_ICD_FILENAMES", &manifest), ("LD_LIBRARY_PATH", &libraries)];
    let (other, driver, others) = child(&variables);
    assert_ne!(driver, here.device().driver, "{manifest} is the driver that the tests run on");
    agree(&driver, &other, &reference, steps(&here).or(others));
}

#[test]
fn every_device_of_this_machine_gives_the_same_numbers() {
    let all = devices().expect("devices");
    if all.len() < 2 {
        println!("skipped: {} is the only device", all[0].name);
        return;
    }
    let here = engine();
    let reference = numbers(&here);
    for info in &all {
        let options = Options { device: Some(info.index.to_string()), ..Options::default() };
        match Engine::new(&options) {
            Ok(other) => agree(&info.name, &numbers(&other).concat(), &reference, steps(&here).or(steps(&other))),
            Err(error) => println!("skipped: {error}"),
        }
    }
}
