//! Voxels that are not cubes, and dims that fit nothing.

use super::Bound::{AtMost, Fails};
use super::lab::{Expected, Lab, centre, cubes, error, every, exit, homogeneous, linear, project, settings, three};
use crate::engine::Medium;
use crate::error::Result;
use crate::scene::grid::glam::{DAffine3, DMat3, DVec3};
use crate::scene::visibility::Method;
use crate::scene::{Camera, Grid, ImageSettings, Light, Samples, Visibility, Volume};
use crate::stages::directions::fibonacci;

/// erf by Abramowitz & Stegun 7.1.26, within 1.5e-7.
fn erf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs());
    let p = t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    (1.0 - p * (-x * x).exp()).copysign(x)
}

/// Two Gaussian clouds about the box's middle, integrated in closed form.
pub(super) fn spacing(lab: &mut Lab) -> Result<()> {
    let radius = 10.0;
    let clouds = |middle: DVec3| [middle + DVec3::new(8.0, -4.0, 3.0), middle + DVec3::new(-7.0, 5.0, -4.0)];
    let top = 0.12;
    let oblique = DMat3::from_cols(DVec3::new(1.9, 0.3, -0.1), DVec3::new(-0.5, 2.1, 0.4), DVec3::new(0.2, -0.7, 2.2));
    for (name, grid) in [
        ("1:1:1", Grid::axis_aligned([40; 3], [2.0; 3])?),
        ("1:1:5", Grid::axis_aligned([80, 80, 16], [1.0, 1.0, 5.0])?),
        ("oblique", Grid::new([40; 3], DAffine3 { matrix3: oblique, translation: DVec3::new(5.0, -90.0, 300.0) })?),
    ] {
        let at = clouds(grid.centre_world());
        let map = grid.voxel_to_world();
        let volume = Volume::from_fn(grid, |p| {
            let w = map.transform_point3(DVec3::from(p));
            at.iter().map(|c| (-(w - *c).length_squared() / (radius * radius)).exp()).sum::<f64>() as f32
        })?;
        // Sums of two clouds stay below 1.3; the ramp goes on to 2.
        let mut matter = linear(0.0)?;
        matter.transfer = crate::scene::Transfer::from_points(
            &[[0.0, 1.0, 1.0, 1.0, 0.0], [2.0, 1.0, 1.0, 1.0, 2.0 * top]],
            crate::scene::transfer::Kind::Extinction,
            crate::scene::transfer::Reference::World,
        )?;
        let medium = lab.medium(&volume, &matter)?;
        let dims = grid.field_dims(4);
        let cells: Vec<u32> = every(dims)
            .into_iter()
            .filter(|&c| (map.transform_point3(centre(&grid, dims, c)) - grid.centre_world()).length() < 22.0)
            .step_by(5)
            .collect();
        let set = fibonacci(2048);
        let exact: Vec<[f32; 16]> = cells
            .iter()
            .map(|&c| {
                let x = map.transform_point3(centre(&grid, dims, c));
                project(&set, |w| {
                    let depth: f64 = at
                        .iter()
                        .map(|c| {
                            let o = *c - x;
                            let along = o.dot(w);
                            let aside = o.length_squared() - along * along;
                            top * (-aside / (radius * radius)).exp() * radius * 0.5 * std::f64::consts::PI.sqrt() * (1.0 + erf(along / radius))
                        })
                        .sum();
                    (-depth).exp()
                })
            })
            .collect();
        let long = name == "1:1:5";
        let expected = Expected {
            march: (AtMost(0.02), "256 directions; clouds interpolated between their samples"),
            filters: [if long { Fails(0.08, 0.18) } else { AtMost(0.03) }; 4],
            hierarchical: "a level is 2^k voxels: 2^k voxel lengths one way, 5 times that the other",
            sweep: (AtMost(if long { 0.25 } else { 0.05 }), "T interpolated between cells of 4 voxels: 20 of a cloud's 10 at 1:1:5"),
        };
        for m in &three(4, 256) {
            let v = lab.estimate(&medium, &m.settings, &cells)?;
            lab.hold(m, format!("{name}: field error"), error(&v, &exact), &expected);
        }
    }
    Ok(())
}

/// Homogeneous boxes of awkward dims against chords, every cell.
pub(super) fn dims(lab: &mut Lab) -> Result<()> {
    let (sigma, unit) = (0.1, DVec3::new(1.0, 1.3, 0.7));
    let set = fibonacci(64);
    let expected = Expected {
        march: (AtMost(1e-5), "constant matter is integrated exactly, edge cells too"),
        filters: [AtMost(0.04); 4],
        hierarchical: "opacity is blended linearly between levels: 0.7 % of a step",
        sweep: (AtMost(0.13), "a chord has a kink where the wall changes: sigma cell/4 of T at each, 64 directions"),
    };
    for ratio in [1u32, 4] {
        let tested = three(ratio, 64);
        let mut worst = vec![(0.0, [0; 3]); tested.len()];
        let mut bad = 0;
        for n in [[1usize, 1, 1], [1, 37, 1], [64, 1, 1], [1, 2, 61], [7, 5, 3], [13, 17, 19], [31, 2, 23]] {
            let grid = Grid::axis_aligned(n, unit.to_array())?;
            let volume = Volume::new(grid, Samples::U8(vec![7; n.iter().product()]), 1.0, 0.0)?;
            let medium = lab.medium(&volume, &homogeneous(sigma)?)?;
            let dims = grid.field_dims(ratio as usize);
            let cells = every(dims);
            let size = DVec3::from(n.map(|n| n as f64)) * unit;
            let exact: Vec<[f32; 16]> =
                cells.iter().map(|&c| project(&set, |w| (-sigma * exit(centre(&grid, dims, c) * unit, w, size)).exp())).collect();
            for (m, worst) in tested.iter().zip(&mut worst) {
                let v = lab.estimate(&medium, &m.settings, &cells)?;
                for (v, e) in v.iter().zip(&exact) {
                    let e = error(&[*v], &[*e]);
                    *worst = if e > worst.0 { (e, n) } else { *worst };
                }
            }
            bad += picture(lab, &medium, &Visibility { bits: 8, ..settings(Method::March, ratio, 16) })?;
        }
        for (m, (e, [x, y, z])) in tested.iter().zip(worst) {
            lab.hold(m, format!("1:{ratio}: worst cell of 7 boxes, {x}x{y}x{z}"), e, &expected);
        }
        lab.row("picture", format!("1:{ratio}: values outside 0..1"), bad as f64, AtMost(0.0), "albedo and light are 1");
    }
    Ok(())
}

/// Packs, relights and renders; how many values of the picture lie outside 0..1.
fn picture(lab: &mut Lab, medium: &Medium, s: &Visibility) -> Result<usize> {
    let field = lab.engine.precompute(medium, s, lab.progress)?;
    let lit = lab.engine.relight(&field, &Light::constant([1.0; 3]))?;
    let image = ImageSettings { width: 9, height: 7, ..ImageSettings::default() };
    let p = lab.engine.render(medium, &lit, &Camera::framing(medium.grid()), &image, lab.progress)?;
    // Eight bits and half floats may put v00 of an open sky a thousandth above it.
    Ok(p.rgba.iter().flatten().filter(|c| !(0.0..=1.002).contains(*c)).count())
}

/// Every stage at an odd size.
pub(super) fn odd_size(lab: &mut Lab) -> Result<()> {
    let n = [197usize, 233, 189];
    let grid = cubes(n)?;
    let sigma = 0.01;
    let volume = Volume::new(grid, Samples::U8(vec![3; n.iter().product()]), 1.0, 0.0)?;
    let medium = lab.medium(&volume, &homogeneous(sigma)?)?;
    let dims = grid.field_dims(8);
    let corners: Vec<u32> = (0..8usize).map(|i| super::lab::cell(dims, std::array::from_fn(|a| (i >> a & 1) * (dims[a] - 1)))).collect();
    let set = fibonacci(12);
    let size = DVec3::new(197.0, 233.0, 189.0);
    let exact: Vec<[f32; 16]> =
        corners.iter().map(|&c| project(&set, |w| (-sigma * exit(centre(&grid, dims, c), w, size)).exp())).collect();
    let packing = "8 bits leave 0.005";
    let expected = Expected {
        march: (AtMost(0.012), packing),
        filters: [AtMost(0.02); 4],
        hierarchical: "8 bits leave 0.005, levels blended linearly 0.007 of a step",
        sweep: (AtMost(0.06), "8 bits leave 0.005, the chord's kinks sigma cell/4 = 0.02 of T"),
    };
    for m in three(8, 12) {
        let s = Visibility { step: 4.0, bits: 8, ..m.settings.clone() };
        let field = lab.engine.precompute(&medium, &s, lab.progress)?;
        let read = lab.engine.read_field(&field)?;
        let v: Vec<[f32; 16]> = corners.iter().map(|&c| std::array::from_fn(|i| read[c as usize * 16 + i])).collect();
        let worst = v.iter().zip(&exact).map(|(v, e)| error(&[*v], &[*e])).fold(0.0, f64::max);
        lab.hold(&m, "worst of the 8 corner cells, 8 bits", worst, &expected);
        if m.is(Method::Sweep) {
            let bad = picture(lab, &medium, &s)?;
            lab.row("picture", "values outside 0..1", bad as f64, AtMost(0.0), "albedo and light are 1");
        }
    }
    Ok(())
}
