//! Extinction over twelve decades, and surfaces where the data is flat or at its ends.

use super::Bound::{AtMost, Fails, Within};
use super::lab::{Lab, cubes, every, linear, methods, seen, settings, three};
use crate::error::Result;
use crate::scene::grid::glam::DVec3;
use crate::scene::visibility::Method;
use crate::scene::{Camera, Grid, ImageSettings, Light, Matter, Samples, Shading, Surface, Visibility, Volume};

/// Why a plateau at the iso value may come out empty.
const STEP_ROUNDING: &str = "the step of the surface's table is 41 entries off in single precision";

/// Two clouds in a haze, within 0.001..1.
fn clouds(grid: Grid) -> Result<Volume> {
    let n = grid.dims().map(|n| n as f64);
    Volume::from_fn(grid, |p| {
        let d = |c: [f64; 3], r: f64| (-(0..3).map(|a| (p[a] / n[a] - c[a]).powi(2)).sum::<f64>() / (r * r)).exp();
        (d([0.6, 0.4, 0.45], 0.2) + d([0.3, 0.7, 0.6], 0.15)).clamp(1e-3, 1.0) as f32
    })
}

/// The whole line to a picture.
fn picture(lab: &mut Lab, volume: &Volume, matter: &Matter, s: &Visibility) -> Result<crate::scene::Picture> {
    let medium = lab.medium(volume, matter)?;
    let field = lab.engine.precompute(&medium, s, lab.progress)?;
    let lit = lab.engine.relight(&field, &Light::constant([1.0; 3]))?;
    let image = ImageSettings { width: 16, height: 12, step: 0.5, ..ImageSettings::default() };
    lab.engine.render(&medium, &lit, &Camera::framing(volume.grid()), &image, lab.progress)
}

pub(super) fn extinction(lab: &mut Lab) -> Result<()> {
    let grid = cubes([16; 3])?;
    let volume = clouds(grid)?;
    let cells = every(grid.field_dims(2));
    for m in methods(2, 48) {
        let mut brighter: f64 = 0.0;
        let mut before: Option<Vec<f64>> = None;
        let mut ends = [0.0; 2];
        for decade in -6..=6 {
            let medium = lab.medium(&volume, &linear(10f64.powi(decade))?)?;
            let v: Vec<f64> = lab.estimate(&medium, &m.settings, &cells)?.iter().map(seen).collect();
            if let Some(before) = &before {
                brighter = v.iter().zip(before).map(|(v, b)| v - b).fold(brighter, f64::max);
            }
            let mean = v.iter().sum::<f64>() / v.len() as f64;
            ends[usize::from(decade > 0)] = if decade == -6 || decade == 6 { mean } else { ends[usize::from(decade > 0)] };
            before = Some(v);
        }
        lab.row(&m.name, "most that 10 times the matter brightens a cell", brighter, AtMost(1e-4), "a ray ends at a transmittance of 1e-4");
        let thin = (1.0 - ends[0]).abs();
        lab.row(&m.name, "mean opacity at 1e-6 per voxel", thin, AtMost(3e-5), "the longest way holds 28e-6");
        lab.row(&m.name, "mean visibility at 1e6 per voxel", ends[1], AtMost(1e-4), "half a voxel of the thinnest haze holds 500");
    }
    for m in three(4, 32) {
        let mut worst: f64 = 0.0;
        let mut before = vec![0.0; 16 * 12];
        for decade in -6..=6 {
            let p = picture(lab, &volume, &linear(10f64.powi(decade))?, &m.settings)?;
            for (pixel, before) in p.rgba.iter().zip(&mut before) {
                let finite = pixel.iter().all(|c| c.is_finite() && *c >= 0.0);
                worst = worst.max(if finite { *before - f64::from(pixel[3]) } else { f64::INFINITY });
                worst = worst.max(f64::from(pixel[0]) - 1.06 * f64::from(pixel[3]));
                *before = f64::from(pixel[3]);
            }
        }
        lab.row(
            format!("{}, picture", m.name),
            "coverage lost with more matter, radiance over it",
            worst,
            AtMost(1e-3),
            "a pixel's ray ends at a transmittance of 1e-3",
        );
    }
    Ok(())
}

/// Surfaces at the minimum (all is opaque), on plateaus (they count as inside) and at the maximum.
pub(super) fn iso_value(lab: &mut Lab) -> Result<()> {
    let grid = cubes([16; 3])?;
    let depth = |c: usize| [c % 16, c / 16 % 16, c / 256].iter().map(|&x| x.min(15 - x)).min().unwrap_or(0);
    // Shells: 0 outside, a plateau, and 255 in the middle.
    let shells = |level: u8| {
        let samples = (0..16usize.pow(3)).map(|c| if depth(c) < 3 { 0 } else if depth(c) < 6 { level } else { 255 }).collect();
        Volume::new(grid, Samples::U8(samples), 1.0, 0.0)
    };
    let haze = linear(0.0)?;
    let surface = |iso: f64| Matter {
        surface: Some(Surface { iso, shading: Shading::Isotropic, albedo: Some([1.0; 3]) }),
        ..haze.clone()
    };
    let cells = every([16; 3]);
    let mean = |v: &[[f32; 16]], of: &dyn Fn(usize) -> bool| {
        let (count, sum) = cells.iter().filter(|&&c| of(c as usize)).fold((0.0, 0.0), |(n, s), &c| (n + 1.0, s + seen(&v[c as usize])));
        sum / count
    };
    for m in three(1, 24) {
        let mut open_plateaus = 0;
        for level in (1..255u8).step_by(6) {
            let medium = lab.medium(&shells(level)?, &surface(f64::from(level)))?;
            let v = lab.estimate(&medium, &m.settings, &cells)?;
            // The plateau's own middle layer, a voxel inside its surface.
            open_plateaus += usize::from(mean(&v, &|c| depth(c) == 4) > 0.05);
        }
        lab.row(&m.name, "plateaus of 43 at the iso value not opaque", open_plateaus as f64, Fails(0.0, 12.0), STEP_ROUNDING);
        let medium = lab.medium(&shells(100)?, &surface(0.0))?;
        let v = lab.estimate(&medium, &m.settings, &cells)?;
        lab.row(&m.name, "iso at the minimum: mean visibility", mean(&v, &|_| true), AtMost(1e-3), "all is opaque");
        let medium = lab.medium(&shells(100)?, &surface(255.0))?;
        let v = lab.estimate(&medium, &m.settings, &cells)?;
        lab.row(&m.name, "iso at the maximum: visibility of its voxels", mean(&v, &|c| depth(c) > 6), AtMost(1e-3), "they are opaque");
        lab.row(&m.name, "iso at the maximum: visibility at the edge", mean(&v, &|c| depth(c) == 0), Within(0.9, 1.0), "a block of 3 voxels, 7 off");
    }
    // Pictures of all three: covered where the box or the block is, and nothing else but numbers.
    let volume = shells(100)?;
    for (what, iso, expected) in [("minimum", 0.0, 16.0), ("plateau", 100.0, 9.0), ("maximum", 255.0, 3.0)] {
        let medium = lab.medium(&volume, &surface(iso))?;
        let field = lab.engine.precompute(&medium, &settings(Method::March, 1, 24), lab.progress)?;
        let lit = lab.engine.relight(&field, &Light::constant([1.0; 3]))?;
        let image = ImageSettings { width: 64, height: 64, step: 0.25, ..ImageSettings::default() };
        let middle = DVec3::splat(8.0);
        let camera = Camera { position: middle + DVec3::X * 400.0, target: middle, up: DVec3::Z, fov_degrees: 2.6 };
        let p = lab.engine.render(&medium, &lit, &camera, &image, lab.progress)?;
        let finite = p.rgba.iter().flatten().all(|c| c.is_finite());
        // Side of the covered square, voxels: the picture is 2·tan(1.3°) of the distance wide.
        let covered = p.rgba.iter().filter(|p| p[3] > 0.0).count() as f64;
        let side = if finite { covered.sqrt() / 64.0 * 2.0 * 1.3f64.to_radians().tan() * (400.0 - 0.5 * expected) } else { f64::NAN };
        lab.row("isosurface", format!("iso at the {what}: side of the block, voxels"), side, Within(expected - 0.3, expected + 0.3), "from voxel centre to voxel centre; the box at the minimum");
    }
    Ok(())
}
