//! A sun beside a sky, and light that turns.

use super::Bound::{AtMost, Fails, Within};
use super::lab::{Lab, centre, cubes, error, every, linear, opaque, settings, truth};
use crate::error::Result;
use crate::kernels::constants::PACK_RANGE;
use crate::measure::packed;
use crate::scene::grid::glam::{DAffine3, DMat3, DQuat, DVec3};
use crate::scene::sh::{Rotation, Window};
use crate::scene::visibility::Method;
use crate::scene::{Grid, Light, Matter, Shading, Surface, Volume};
use std::f64::consts::PI;

/// Σ v L / 4π of the first channel.
fn source(v: &[f32; 16], light: &Light) -> f64 {
    v.iter().zip(light.coefficients).map(|(v, l)| f64::from(*v) * l[0]).sum::<f64>() / (4.0 * PI)
}

/// A disc of half a degree, 100,000 times as bright as the sky, beside an opaque ball.
pub(super) fn sun(lab: &mut Lab) -> Result<()> {
    let (n, radius) = ([24usize; 3], 6.0);
    let grid = cubes(n)?;
    let middle = DVec3::splat(12.0);
    let volume = Volume::from_fn(grid, |p| (radius - (DVec3::from(p) - middle).length()) as f32)?;
    let matter = Matter { surface: Some(Surface { iso: 0.0, shading: Shading::Isotropic, albedo: Some([1.0; 3]) }), ..linear(0.0)? };
    let medium = lab.medium(&volume, &matter)?;
    let toward = DVec3::new(0.3, -0.5, 0.8).normalize();
    let cells: Vec<u32> =
        every(n).into_iter().filter(|c| c % 11 == 0 && (1.0..4.0).contains(&((centre(&grid, n, *c) - middle).length() - radius))).collect();
    let hit = |x: DVec3, w: DVec3| {
        let o = x - middle;
        let b = o.dot(w);
        b < 0.0 && b * b - (o.length_squared() - radius * radius) > 0.0
    };
    let v = lab.estimate(&medium, &settings(Method::March, 1, 400), &cells)?;
    let exact: Vec<[f32; 16]> = cells
        .iter()
        .map(|&c| {
            let x = centre(&grid, n, c);
            truth(|w| f64::from(u8::from(!hit(x, w))))
        })
        .collect();
    lab.row(
        "march",
        "field error against the ball's geometry",
        error(&v, &exact),
        AtMost(0.03),
        "400 directions; a ball of 12 interpolated voxels",
    );
    let disc = Light::cone(toward, 0.265, [1e5; 3]);
    // Irradiance over 4π: the in-scattered radiance of an unshadowed sun.
    let open = disc.coefficients[0][0] * (4.0 * PI).sqrt() / (4.0 * PI);
    // Below zero; above the open sun; error of lit or shadowed.
    for (name, window, below, above, wrong) in [
        ("no window", Window::None, Fails(0.2, 0.5), Fails(0.08, 0.2), Within(0.1, 0.22)),
        ("hanning 4", Window::Hanning(4.0), AtMost(0.01), AtMost(0.05), Within(0.15, 0.27)),
        ("lanczos 4", Window::Lanczos(4.0), AtMost(0.04), AtMost(0.05), Within(0.14, 0.25)),
        ("gauss 4", Window::Gauss(4.0), Fails(0.05, 0.17), AtMost(0.09), Within(0.12, 0.23)),
    ] {
        let light = disc.windowed(window);
        let s: Vec<f64> = v.iter().map(|v| source(v, &light) / open).collect();
        let least = s.iter().map(|s| -s).fold(0.0, f64::max);
        let most = (s.iter().copied().fold(0.0, f64::max) - 1.0).max(0.0);
        let off = cells.iter().zip(&s).map(|(&c, s)| {
            let lit = f64::from(u8::from(!hit(centre(&grid, n, c), toward)));
            (lit - s).powi(2)
        });
        let rms = (off.sum::<f64>() / s.len() as f64).sqrt();
        let eight = packed(&v, 4, 8);
        let amplified = v.iter().zip(&eight).map(|(a, b)| (source(a, &light) - source(b, &light)).abs() / open).fold(0.0, f64::max);
        // Half a code of each coefficient times the light's, at worst.
        let half_codes = light
            .coefficients
            .iter()
            .zip(PACK_RANGE)
            .enumerate()
            .map(|(i, (l, range))| l[0].abs() * f64::from(range) * if i == 0 { 0.5 / 255.0 } else { 0.5 / 127.0 })
            .sum::<f64>()
            / (4.0 * PI * open);
        let sky = light.plus(&Light::constant([1.0; 3]));
        let dark = v.iter().filter(|v| source(v, &sky) < 0.0).count() as f64;
        lab.row(name, "sun: most below 0, of the open sun", least, below, "four bands of a sun ring; a window gives them up");
        lab.row(name, "sun: most above, of the open sun", most, above, "as below 0");
        lab.row(name, "sun: rms error of lit or shadowed", rms, wrong, "no edge sharper than four bands; a window blurs it further");
        lab.row(
            name,
            "sun: most that 8-bit packing changes",
            amplified,
            AtMost(half_codes),
            "half a code of each coefficient, all of one sign",
        );
        lab.row(name, "sun and sky: cells below 0", dark, AtMost(0.0), "half a degree at 1e5 adds half of what the sky does");
    }
    Ok(())
}

/// Light turned against volume turned.
pub(super) fn turned(lab: &mut Lab) -> Result<()> {
    // Harmonics there and back.
    let mut worst: f64 = 0.0;
    for k in 0..24 {
        let axis = DVec3::new((f64::from(k) * 1.7).sin(), (f64::from(k) * 2.3).cos(), 0.4).normalize();
        let turn = DMat3::from_quat(DQuat::from_axis_angle(axis, 0.37 * f64::from(k)));
        let (there, back) = (Rotation::new(turn), Rotation::new(turn.transpose()));
        for i in 0..16 {
            let unit: [f64; 16] = std::array::from_fn(|j| f64::from(u8::from(i == j)));
            let same = back.apply(&there.apply(&unit));
            worst = same.iter().zip(unit).map(|(a, b)| (a - b).abs()).fold(worst, f64::max);
        }
    }
    lab.row("rotation", "harmonics turned there and back", worst, AtMost(1e-13), "exact quadrature in double precision");

    let n = [20usize, 16, 12];
    let shape = |p: DVec3| {
        let block = (p - DVec3::new(12.0, 7.0, 5.0)).abs().cmplt(DVec3::new(3.0, 2.0, 4.0)).all();
        let ball = (p - DVec3::new(5.0, 11.0, 8.0)).length() < 2.6;
        f32::from(u8::from(block || ball))
    };
    let plain = Volume::from_fn(cubes(n)?, |p| shape(DVec3::from(p)))?;
    // A device that rounds weights moves edges by half of its step, to either side.
    let rounded = lab.engine.filtering()?.map_or(0.0, |f| 0.5 / f64::from(f.steps));
    let light = Light::cone(DVec3::new(0.4, 0.2, 0.9), 30.0, [3.0; 3]).plus(&Light::constant([0.5; 3]));
    let cells: Vec<u32> = every(n).into_iter().step_by(37).collect();
    for m in super::lab::three(1, 256) {
        // A quarter turn about z: the box moved by index permutation, (x, y, z) to (16 − y, x, z), on an upright grid; and
        // the plain box on a grid whose axes are turned. The world is the same.
        let quarter = DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z);
        let moved = [n[1], n[0], n[2]];
        let permuted = Volume::from_fn(cubes(moved)?, |p| shape(DVec3::new(p[1], n[1] as f64 - p[0], p[2])))?;
        let turned_grid = Grid::new(n, DAffine3 { matrix3: quarter, translation: DVec3::new(n[1] as f64, 0.0, 0.0) })?;
        let on_turned = Volume::new(turned_grid, plain.samples().clone(), 1.0, 0.0)?;
        let counterpart: Vec<u32> = cells
            .iter()
            .map(|&c| {
                let p = [c as usize % n[0], c as usize / n[0] % n[1], c as usize / n[0] / n[1]];
                super::lab::cell(moved, [n[1] - 1 - p[1], p[0], p[2]])
            })
            .collect();
        let a = lab.medium(&permuted, &opaque()?)?;
        let a = lab.estimate(&a, &m.settings, &counterpart)?;
        let b = lab.medium(&on_turned, &opaque()?)?;
        let b = lab.estimate(&b, &m.settings, &cells)?;
        lab.row(
            &m.name,
            "quarter turn: permuted voxels, turned axes",
            error(&b, &a),
            AtMost(1e-3 + rounded),
            "the same rays, but for rounding at edges",
        );
        // A turn of 33 degrees about an oblique axis: light turned with the volume leaves S as it was.
        let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 33f64.to_radians()));
        let still = lab.medium(&plain, &opaque()?)?;
        let oblique = Volume::new(Grid::new(n, DAffine3 { matrix3: turn, translation: DVec3::ZERO })?, plain.samples().clone(), 1.0, 0.0)?;
        let oblique = lab.medium(&oblique, &opaque()?)?;
        let v = lab.estimate(&still, &m.settings, &cells)?;
        let w = lab.estimate(&oblique, &m.settings, &cells)?;
        let carried = light.transformed(turn);
        let (d, s) = v.iter().zip(&w).fold((0.0, 0.0), |(d, s), (v, w)| {
            let (a, b) = (source(v, &light), source(w, &carried));
            (d + (a - b).powi(2), s + a * a)
        });
        lab.row(&m.name, "33 degrees, light and volume: change of S", (d / s).sqrt(), AtMost(0.03), "256 other directions beside edges");
        // Sabotage of the comparison itself: the light left where it was.
        let (d, s) = v.iter().zip(&w).fold((0.0, 0.0), |(d, s), (v, w)| {
            let (a, b) = (source(v, &light), source(w, &light));
            (d + (a - b).powi(2), s + a * a)
        });
        lab.row(&m.name, "the same with the light left behind", (d / s).sqrt(), Within(0.035, 0.1), "what the comparison above must see");
    }
    Ok(())
}
