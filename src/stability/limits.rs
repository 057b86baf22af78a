//! Rays of more steps than one invocation may loop, and runs that repeat.

use super::Bound::{AtMost, Fails};
use super::lab::{Lab, centre, error, every, exit, homogeneous, project, settings, three};
use crate::error::{Error, Result};
use crate::scene::grid::glam::DVec3;
use crate::scene::visibility::{Method, Sampling};
use crate::scene::{Camera, Grid, ImageSettings, Light, Samples, Visibility, Volume};
use crate::stages::directions::fibonacci;

/// Why a slice that is long in voxel lengths may lose matter.
const LOST_TAPS: &str = "the batch counts the taps of a cube: loops beyond 65,535 are lost on lavapipe 22.3.6";

/// Where loops end after 65,535 iterations (lavapipe 22.3.6), work must be split.
pub(super) fn long_rays(lab: &mut Lab) -> Result<()> {
    let sigma = 0.004;
    let fog = |n: [usize; 3], spacing: [f64; 3]| -> Result<Volume> {
        Volume::new(Grid::axis_aligned(n, spacing)?, Samples::U8(vec![1; n.iter().product()]), 1.0, 0.0)
    };
    // Directions times steps of one invocation, where the march, the hierarchy or a slice of the sweep must be split.
    for (name, what, n, unit, s) in [
        ("march", "64 directions of 13,600 steps", [128usize, 32, 32], [1.0, 1.0, 1.0], Visibility { step: 0.01, ..settings(Method::March, 8, 64) }),
        (
            "hierarchical axis",
            "4096 directions of 50 steps",
            [256, 8, 8],
            [1.0, 1.0, 1.0],
            Visibility { growth: 0.05, ..settings(Method::Hierarchical, 8, 4096) },
        ),
    ] {
        let volume = fog(n, unit)?;
        let grid = *volume.grid();
        let medium = lab.medium(&volume, &homogeneous(sigma)?)?;
        let dims = grid.field_dims(8);
        let cells = vec![0, every(dims).len() as u32 / 2];
        let set = fibonacci(s.directions);
        let size = DVec3::from(n.map(|n| n as f64));
        let exact: Vec<[f32; 16]> =
            cells.iter().map(|&c| project(&set, |w| (-sigma * exit(centre(&grid, dims, c), w, size)).exp())).collect();
        let v = lab.estimate(&medium, &s, &cells)?;
        lab.row(name, what, error(&v, &exact), AtMost(1e-3), "as the chord's formula; half floats in the pyramid");
    }
    // A slice as thick as 160 voxel lengths: homogeneous matter does not care about the step.
    let medium = lab.medium(&fog([32, 16, 16], [1.0, 20.0, 20.0])?, &homogeneous(sigma)?)?;
    let s = Visibility { near: 1, ..settings(Method::Sweep, 8, 4096) };
    let cells = every([4, 2, 2]);
    let coarse = lab.estimate(&medium, &s, &cells)?;
    let fine = lab.estimate(&medium, &Visibility { step: 0.02, ..s }, &cells)?;
    lab.row("sweep near 1", "1:20:20, 50 x 8,000 steps: change by the step", error(&fine, &coarse), Fails(0.0, 0.5), LOST_TAPS);
    // One ray of 102,400 steps: refused with a sentence where it cannot run, right where it can.
    let volume = fog([1024, 1, 1], [1.0; 3])?;
    let medium = lab.medium(&volume, &homogeneous(sigma)?)?;
    let s = Visibility { step: 0.01, ..settings(Method::March, 8, 4) };
    let off = match lab.estimate(&medium, &s, &[0]) {
        Ok(v) => {
            let exact = project(&fibonacci(4), |w| (-sigma * exit(DVec3::new(4.0, 0.5, 0.5), w, DVec3::new(1024.0, 1.0, 1.0))).exp());
            error(&v, &[exact])
        }
        Err(Error::Invalid { item: "visibility.step", .. }) => 0.0,
        Err(other) => return Err(other),
    };
    lab.row("march", "a ray of 102,400 steps: right, or refused", off, AtMost(1e-3), "one direction is the least that a dispatch takes");
    // A pixel's ray of 204,800 steps, split over dispatches.
    let field = lab.engine.precompute(&medium, &settings(Method::March, 8, 4), lab.progress)?;
    let lit = lab.engine.relight(&field, &Light::constant([1.0; 3]))?;
    let camera = Camera { position: DVec3::new(-100.0, 0.5, 0.5), target: DVec3::new(0.0, 0.5, 0.5), up: DVec3::Z, fov_degrees: 1.0 };
    for step in [1.0, 0.005] {
        let image = ImageSettings { width: 1, height: 1, step, ..ImageSettings::default() };
        let p = lab.engine.render(&medium, &lit, &camera, &image, lab.progress)?;
        let expected = 1.0 - (-sigma * 1024.0f64).exp();
        let off = (f64::from(p.rgba[0][3]) - expected).abs();
        lab.row("raymarch", format!("a ray of {} steps: coverage", 1024.0 / step), off, AtMost(1e-3), "1 - exp(-sigma 1024); 200,000 additions in single precision");
    }
    Ok(())
}

/// The same twice.
pub(super) fn repeat(lab: &mut Lab) -> Result<()> {
    let grid = Grid::axis_aligned([19, 17, 13], [1.0, 1.2, 0.9])?;
    let volume = Volume::from_fn(grid, |p| ((p[0] * 0.7).sin() * (p[1] * 0.5).cos() + (p[2] * 0.9).sin()).max(0.0) as f32)?;
    let medium = lab.medium(&volume, &super::lab::linear(0.6)?)?;
    let mut tested = three(2, 100);
    tested.push(super::lab::Tested {
        name: "march jittered".into(),
        settings: Visibility { sampling: Sampling::Jittered, ..settings(Method::March, 2, 100) },
    });
    for m in tested {
        let mut run = || -> Result<(Vec<f32>, crate::scene::Picture)> {
            let s = Visibility { bits: 8, ..m.settings.clone() };
            let field = lab.engine.precompute(&medium, &s, lab.progress)?;
            let lit = lab.engine.relight(&field, &Light::cone(DVec3::new(0.3, 0.2, 0.9), 40.0, [2.0, 1.0, 0.5]))?;
            let image = ImageSettings { width: 32, height: 24, ..ImageSettings::default() };
            Ok((lab.engine.read_field(&field)?, lab.engine.render(&medium, &lit, &Camera::framing(&grid), &image, lab.progress)?))
        };
        let (a, b) = (run()?, run()?);
        let other = a.0.iter().zip(&b.0).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        let pixels = a.1.rgba.iter().flatten().zip(b.1.rgba.iter().flatten()).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        lab.row(&m.name, "coefficients and pixels that differ", (other + pixels) as f64, AtMost(0.0), "one order of additions");
    }
    Ok(())
}
