//! How errors fall with more directions, shorter steps, finer fields.

use super::Bound::{AtMost, Fails, Within};
use super::lab::{Lab, cubes, error, every, linear, opaque, settings, slope, solid};
use crate::demo;
use crate::error::Result;
use crate::scene::visibility::{Method, Sampling};
use crate::scene::{Camera, ImageSettings, Light, Visibility, Volume};

/// More directions beside hard shadows.
pub(super) fn directions(lab: &mut Lab) -> Result<()> {
    let n = [20usize; 3];
    let volume = solid(cubes(n)?, |p| {
        let block = (p[0] - 7.0).abs() < 3.0 && (p[1] - 12.0).abs() < 3.0 && (p[2] - 8.0).abs() < 4.0;
        block || (p[0] - 15.0).abs() < 1.1 && p[1] < 14.0
    })?;
    let medium = lab.medium(&volume, &opaque()?)?;
    let cells: Vec<u32> = every(n).into_iter().filter(|&c| volume.value(c as usize) == 0.0).step_by(163).collect();
    let base = Visibility { step: 1.0, ..settings(Method::March, 1, 1) };
    let reference = lab.estimate(&medium, &Visibility { directions: 1 << 16, ..base.clone() }, &cells)?;
    for (name, sampling, most) in [
        ("march jittered", Sampling::Jittered, AtMost(0.015)),
        ("march stratified", Sampling::Stratified, AtMost(0.006)),
    ] {
        let mut points = Vec::new();
        for power in 0..=12 {
            let s = Visibility { directions: 1 << power, sampling, ..base.clone() };
            let v = lab.estimate(&medium, &s, &cells)?;
            points.push((f64::from(s.directions), error(&v, &reference)));
        }
        lab.row(name, "N = 1: field error", points[0].1, AtMost(4.0), "one ray: at most |Y| of all the sky, 4 times v00");
        lab.row(name, "N = 4096: field error", points[12].1, most, "N^-3/4 = 0.002 times the edges' length");
        lab.row(name, "order: slope of log error from N = 64 on", slope(&points[6..]), Within(-0.95, -0.65), "edges give N^-3/4, what is smooth N^-1");
    }
    Ok(())
}

/// Shorter steps through smooth matter.
pub(super) fn step(lab: &mut Lab) -> Result<()> {
    let n = [24usize; 3];
    let volume = Volume::from_fn(cubes(n)?, |p| {
        let d = |c: [f64; 3], r: f64| (-(0..3).map(|a| (p[a] - c[a]).powi(2)).sum::<f64>() / (r * r)).exp();
        (d([13.0, 10.0, 11.0], 6.0) + d([7.0, 16.0, 14.0], 4.0)).min(1.0) as f32
    })?;
    let medium = lab.medium(&volume, &linear(0.25)?)?;
    let cells: Vec<u32> = every(n).into_iter().step_by(331).collect();
    let at = |step: f32| Visibility { step, ..settings(Method::March, 1, 64) };
    let reference = lab.estimate(&medium, &at(0.02), &cells)?;
    let mut points = Vec::new();
    for step in [4.0f32, 2.0, 1.0, 0.5] {
        points.push((f64::from(step), error(&lab.estimate(&medium, &at(step), &cells)?, &reference)));
    }
    lab.row("march", "error at a step of 1 voxel", points[2].1, AtMost(1e-3), "sigma'' h^2/24 of the depth");
    lab.row("march", "order of the step", slope(&points), Within(1.8, 2.2), "midpoint rule");

    let field = lab.engine.precompute(&medium, &Visibility { bits: 32, ..settings(Method::March, 2, 64) }, lab.progress)?;
    let lit = lab.engine.relight(&field, &Light::constant([1.0; 3]))?;
    let camera = Camera::framing(volume.grid());
    let mut picture = |step: f64| {
        let image = ImageSettings { width: 24, height: 18, step, ..ImageSettings::default() };
        lab.engine.render(&medium, &lit, &camera, &image, lab.progress)
    };
    let exact = picture(0.02)?;
    let mut points = Vec::new();
    for step in [4.0, 2.0, 1.0, 0.5] {
        let p = picture(step)?;
        let (d, s) = p.rgba.iter().zip(&exact.rgba).fold((0.0, 0.0), |(d, s), (a, b)| {
            (d + f64::from(a[0] - b[0]).powi(2), s + f64::from(b[0]).powi(2))
        });
        points.push((step, (d / s).sqrt()));
    }
    lab.row("raymarch", "error at a step of 1 voxel", points[2].1, AtMost(2e-3), "as march, and the product with the light");
    lab.row("raymarch", "order of the step", slope(&points), Within(1.6, 2.2), "midpoint rule; half floats of the light below 1e-4");
    Ok(())
}

/// The paper's bias: a coarse field is a little too bright.
pub(super) fn coarse_field(lab: &mut Lab) -> Result<()> {
    let volume = demo::volume(40)?;
    for (name, matter, bounds) in [
        ("haze", demo::dvr()?, [Fails(0.05, 0.17), Fails(0.15, 0.34), Fails(0.25, 0.55)]),
        ("surface", demo::iso()?, [Within(-0.06, 0.06), Within(-0.1, 0.1), Fails(-0.35, -0.1)]),
    ] {
        let medium = lab.medium(&volume, &matter)?;
        let mean = |lab: &mut Lab, ratio: u32| -> Result<f64> {
            let s = Visibility { step: 1.0, ..settings(Method::March, ratio, 64) };
            let field = lab.engine.precompute(&medium, &s, lab.progress)?;
            let lit = lab.engine.relight(&field, &Light::constant([1.0; 3]))?;
            let image = ImageSettings { width: 64, height: 48, step: 0.5, ..ImageSettings::default() };
            let p = lab.engine.render(&medium, &lit, &demo::camera(volume.grid()), &image, lab.progress)?;
            Ok(p.rgba.iter().map(|p| f64::from(p[0])).sum::<f64>())
        };
        let fine = mean(lab, 1)?;
        for (ratio, bound) in [2, 4, 8].into_iter().zip(bounds) {
            let bias = mean(lab, ratio)? / fine - 1.0;
            lab.row(format!("march 1:{ratio}"), format!("{name}: brightness against 1:1"), bias, bound, "walls of 2 voxels are thinner than a cell");
        }
    }
    Ok(())
}
