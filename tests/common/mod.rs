//! What the tests of the device share.
#![allow(dead_code)]

#[cfg(feature = "cli")]
pub mod sequence;

use halflight::engine::{DeviceVolume, Engine, Medium, Options};
use halflight::scene::transfer::{Kind, Reference};
use halflight::scene::{Camera, Grid, Matter, Surface, Transfer, Volume};
use std::ops::{ControlFlow, Deref};

/// An engine with validation on; dropping it fails the test if the layers (core and synchronization) said anything.
pub struct Checked(Engine);

impl Deref for Checked {
    type Target = Engine;
    fn deref(&self) -> &Engine {
        &self.0
    }
}

impl Drop for Checked {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            assert_eq!(self.0.validation_errors(), Vec::<String>::new(), "validation must be clean");
        }
    }
}

pub fn engine() -> Checked {
    on(false)
}

/// The same, and one that works as on a separate card.
pub fn both_ways() -> [Checked; 2] {
    [false, true].map(on)
}

fn on(as_card: bool) -> Checked {
    Checked(
        Engine::new(&Options { validation: true, as_card, ..Options::default() })
            .expect("a Vulkan device (on Debian: mesa-vulkan-drivers)"),
    )
}

pub fn quiet(_: &'static str, _: f32) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Uniform numbers in 0..1 from a seed.
pub struct Random(pub u64);

impl Random {
    pub fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((self.0 >> 40) as f32) / (1u64 << 24) as f32
    }
}

/// Smooth random blobs in 0..1: neither symmetric nor empty.
pub fn blobs(grid: Grid, seed: u64) -> Volume {
    let mut random = Random(seed);
    let n = grid.dims().map(|n| n as f64);
    let centres: Vec<([f64; 3], f64)> = (0..6)
        .map(|_| {
            (std::array::from_fn(|a| f64::from(random.unit()) * n[a]), (0.1 + 0.2 * f64::from(random.unit())) * n[0].max(n[1]).max(n[2]))
        })
        .collect();
    Volume::from_fn(grid, |p| {
        let sum: f64 = centres
            .iter()
            .map(|(c, r)| {
                let d2: f64 = (0..3).map(|a| (p[a] - c[a]).powi(2)).sum();
                (-d2 / (r * r)).exp()
            })
            .sum();
        sum.min(1.0) as f32
    })
    .expect("a valid volume")
}

/// σ_t rises linearly from 0 at scalar 0 to `top` per world unit at scalar 1; albedo varies with the scalar.
pub fn linear(top: f64) -> Matter {
    let points = [[0.0, 0.9, 0.2, 0.4, 0.0], [1.0, 0.3, 0.8, 0.6, top]];
    Matter {
        transfer: Transfer::from_points(&points, Kind::Extinction, Reference::World).expect("a valid transfer function"),
        surface: None,
    }
}

/// The same σ_t per world unit for every scalar, albedo 1.
pub fn homogeneous(sigma: f64) -> Matter {
    let points = [[0.0, 1.0, 1.0, 1.0, sigma]];
    Matter {
        transfer: Transfer::from_points(&points, Kind::Extinction, Reference::World).expect("a valid transfer function"),
        surface: None,
    }
}

pub fn surface(surface: Surface) -> Matter {
    Matter { surface: Some(surface), ..homogeneous(0.0) }
}

pub fn load(engine: &Engine, volume: &Volume, matter: &Matter) -> (DeviceVolume, Medium) {
    let uploaded = engine.upload(volume).expect("upload");
    let medium = engine.classify(&uploaded, matter).expect("classify");
    (uploaded, medium)
}

/// A camera that looks at the middle of a grid from so many of its longest sides away.
pub fn camera(grid: &Grid, offset: [f64; 3], fov: f64) -> Camera {
    use halflight::scene::grid::glam::DVec3;
    let centre = grid.centre_world();
    Camera { position: centre + DVec3::from(offset) * grid.longest_side(), target: centre, up: DVec3::Z, fov_degrees: fov }
}

/// An oblique, anisotropic frame.
pub fn oblique(dims: [usize; 3]) -> Grid {
    use halflight::scene::grid::glam::{DAffine3, DVec3};
    let map = DAffine3 {
        matrix3: halflight::scene::grid::glam::DMat3::from_cols(
            DVec3::new(0.9, 0.1, -0.05),
            DVec3::new(-0.2, 1.1, 0.3),
            DVec3::new(0.1, -0.4, 1.7),
        ),
        translation: DVec3::new(-3.0, 7.0, 11.0),
    };
    Grid::new(dims, map).expect("a valid grid")
}

/// A plain grid, and those that fit nothing: anisotropic primes, a dim of 1, an oblique frame.
pub fn awkward_grids(plain: [usize; 3]) -> [Grid; 4] {
    [
        Grid::axis_aligned(plain, [1.0; 3]).expect("grid"),
        Grid::axis_aligned([17, 13, 11], [1.0, 1.0, 5.0]).expect("grid"),
        Grid::axis_aligned([19, 1, 6], [0.7, 2.0, 1.0]).expect("grid"),
        oblique([9, 14, 7]),
    ]
}

/// Largest absolute difference, with where.
pub fn worst(a: &[f32], b: &[f32]) -> (f32, usize) {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).enumerate().map(|(i, (a, b))| ((a - b).abs(), i)).fold((0.0, 0), |m, d| if d.0 > m.0 || d.0.is_nan() { d } else { m })
}

/// Real data, if it lies beside the repository.
pub fn data(path: &str) -> Option<std::path::PathBuf> {
    let file = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")).join(path);
    if file.exists() {
        return Some(file);
    }
    println!("skipped: {path} is not here (real data lies beside the repository, never in it)");
    None
}

/// Runs the command in a folder: exit code, stdout, stderr.
#[cfg(feature = "cli")]
pub fn run(folder: &std::path::Path, arguments: &[&str]) -> (i32, String, String) {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_halflight"));
    let out = command.current_dir(folder).args(arguments).env_remove("RUST_LOG").output().expect("the command runs");
    let text = |b: Vec<u8>| String::from_utf8(b).expect("UTF-8");
    (out.status.code().unwrap_or(-1), text(out.stdout), text(out.stderr))
}
