//! Cameras in the matter and along its faces.

use super::Bound::AtMost;
use super::lab::{Lab, homogeneous, settings};
use crate::error::Result;
use crate::scene::grid::glam::DVec3;
use crate::scene::visibility::Method;
use crate::scene::{Camera, Grid, ImageSettings, Light, Matter, Samples, Shading, Surface, Volume};

/// Coverage must be that of the chord, from wherever the camera stands.
pub(super) fn camera(lab: &mut Lab) -> Result<()> {
    let (n, unit, sigma) = ([12usize, 10, 8], DVec3::new(1.0, 1.5, 0.8), 0.05);
    let grid = Grid::axis_aligned(n, unit.to_array())?;
    let size = DVec3::new(12.0, 10.0, 8.0) * unit;
    let volume = Volume::new(grid, Samples::U8(vec![1; n.iter().product()]), 1.0, 0.0)?;
    let fog = lab.medium(&volume, &homogeneous(sigma)?)?;
    let solid = Matter { surface: Some(Surface { iso: 1.0, shading: Shading::Lambert, albedo: Some([1.0; 3]) }), ..homogeneous(sigma)? };
    let solid = lab.medium(&volume, &solid)?;
    let field = lab.engine.precompute(&fog, &settings(Method::March, 2, 16), lab.progress)?;
    let lit = lab.engine.relight(&field, &Light::constant([1.0; 3]))?;
    let half = 0.5 * size;
    let views = [
        ("inside", half + DVec3::new(0.7, -1.1, 0.4), DVec3::new(30.0, 4.0, 5.0)),
        ("at the centre, along x", half, half + DVec3::X),
        ("at a voxel's corner, along y", DVec3::new(6.0, 4.5, 3.2), DVec3::new(6.0, 40.0, 3.2)),
        ("on a face, looking in", DVec3::new(0.0, half.y, half.z), half),
        ("on a face, looking away", DVec3::new(0.0, half.y, half.z), DVec3::new(-9.0, half.y, half.z)),
        ("in a face's plane, along it", DVec3::new(-8.0, half.y, 0.0), DVec3::new(9.0, half.y, 0.0)),
        ("along an edge", DVec3::new(-8.0, 0.0, 0.0), DVec3::new(9.0, 0.0, 0.0)),
        ("at a corner, looking in", DVec3::ZERO, half),
        ("far off", half + DVec3::new(4e4, 3e4, 2e4), half),
    ];
    let mut worst = [(0.0f64, ""); 2];
    let mut bad = 0;
    for (name, position, target) in views {
        let fov_degrees = if name == "far off" { 1.0 } else { 70.0 };
        let camera = Camera { position, target, up: DVec3::new(0.1, 0.2, 1.0), fov_degrees };
        // An odd number of pixels: the middle one looks exactly along the axis.
        let image = ImageSettings { width: 9, height: 7, step: 0.5, ..ImageSettings::default() };
        let rays = camera.rays(&grid, 9, 7)?;
        let p = lab.engine.render(&fog, &lit, &camera, &image, lab.progress)?;
        let far = usize::from(name == "far off");
        for (k, pixel) in p.rgba.iter().enumerate() {
            let w = rays.direction_world((k % 9) as f64, (k / 9) as f64);
            // A ray within a face or edge may count as inside or outside: the chord from either side.
            let chord = |shift: f64| {
                let o = position + DVec3::splat(shift);
                let (mut enter, mut leave) = (0f64, f64::INFINITY);
                for a in 0..3 {
                    let d = if w[a].abs() < 1e-12 { 1e-12 } else { w[a] };
                    let (t0, t1) = (-o[a] / d, (size[a] - o[a]) / d);
                    enter = enter.max(t0.min(t1));
                    leave = leave.min(t0.max(t1));
                }
                1.0 - (-sigma * (leave - enter).max(0.0)).exp()
            };
            let either = [chord(1e-6), chord(-1e-6), chord(0.0)];
            let got = f64::from(pixel[3]);
            let off = either.iter().map(|e| (e - got).abs()).fold(f64::INFINITY, f64::min);
            let off = if pixel.iter().all(|c| c.is_finite()) { off } else { f64::INFINITY };
            worst[far] = if off > worst[far].0 { (off, name) } else { worst[far] };
        }
        let p = lab.engine.render(&solid, &lit, &camera, &image, lab.progress)?;
        bad += p.rgba.iter().flatten().filter(|c| !(0.0..=1.2).contains(*c)).count();
    }
    lab.row("raymarch", format!("worst coverage of 8 views: {}", worst[0].1), worst[0].0, AtMost(1e-5), "1 - exp(-sigma chord) in single precision");
    lab.row("raymarch", "worst coverage from 5,000 sides away", worst[1].0, AtMost(1e-3), "5e4 in single precision: 0.004 of a chord of 10");
    lab.row("isosurface", "values of 9 views outside 0..1.2", bad as f64, AtMost(0.0), "albedo and light are 1; four bands ring by a tenth");
    Ok(())
}
