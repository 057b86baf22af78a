//! Opaque matter that is thin, small, far or long.

use super::Bound::{AtMost, Fails, Within};
use super::lab::{Expected, Lab, cell, centre, cubes, error, exit, linear, methods, opaque, seen, settings, solid, sweeps, truth};
use crate::error::Result;
use crate::scene::grid::glam::DVec3;
use crate::scene::visibility::{Method, Sampling};
use crate::scene::{Visibility, sh};

/// An opaque sheet of one voxel above a column of cells.
pub(super) fn sheet(lab: &mut Lab) -> Result<()> {
    let (n, plane) = ([24usize, 24, 30], 26.0);
    let grid = cubes(n)?;
    let medium = lab.medium(&solid(grid, |p| p[2] > plane && p[2] < plane + 1.0)?, &opaque()?)?;
    let below = [24usize, 22, 18, 10, 1];
    let cells: Vec<u32> = below.map(|z| cell(n, [12, 12, z])).into();
    let truths: Vec<[f32; 16]> = cells
        .iter()
        .map(|&c| {
            let x = centre(&grid, n, c);
            truth(|w| {
                let p = x + w * ((plane - x.z) / w.z);
                let hit = w.z > 0.0 && p.x > 0.0 && p.x < 24.0 && p.y > 0.0 && p.y < 24.0;
                f64::from(u8::from(!hit))
            })
        })
        .collect();
    let blurred = "far steps read a sheet averaged with vacuum";
    let errors = Expected {
        march: (AtMost(0.04), "256 directions beside an edge: N^-3/4 is 0.016"),
        filters: [Fails(0.15, 0.3), Fails(0.09, 0.17), Fails(0.1, 0.19), AtMost(0.08)],
        hierarchical: blurred,
        sweep: (AtMost(0.05), "as march, and the shadow's edge blurred by a few cells"),
    };
    // About a third around what was measured: worst 7.5 to 15.5 voxels off, for near by steps are short, and far off it is small.
    let apart = [
        [Fails(0.05, 0.12), Fails(0.05, 0.11), Fails(0.05, 0.11), AtMost(0.1)],
        [Fails(0.12, 0.24), Fails(0.06, 0.13), Fails(0.07, 0.16), AtMost(0.08)],
        [Fails(0.2, 0.4), Fails(0.1, 0.22), Fails(0.12, 0.26), AtMost(0.08)],
        [Fails(0.18, 0.36), Fails(0.11, 0.22), Fails(0.12, 0.25), AtMost(0.04)],
        [Fails(0.12, 0.24), Fails(0.07, 0.14), Fails(0.08, 0.16), AtMost(0.03)],
    ];
    let shadows = Expected {
        march: (Within(0.85, 1.15), "16 of 256 directions, give or take 2"),
        filters: [Fails(0.08, 0.25), Fails(0.4, 0.66), Fails(0.34, 0.58), Within(0.9, 1.3)],
        hierarchical: blurred,
        sweep: (Within(0.75, 1.25), "as march, and the shadow's edge blurred by a few cells"),
    };
    for m in methods(1, 256) {
        let v = lab.estimate(&medium, &m.settings, &cells)?;
        lab.hold(&m, "field error, 1.5 to 24.5 voxels off", error(&v, &truths), &errors);
        for (k, (z, filters)) in below.into_iter().zip(apart).enumerate() {
            let off = error(&v[k..=k], &truths[k..=k]);
            lab.hold(&m, format!("field error {} voxels off", 26.0 - z as f64 - 0.5), off, &Expected { filters, ..errors });
        }
        let last = (1.0 - seen(&v[4])) / (1.0 - seen(&truths[4]));
        lab.hold(&m, "its shadow 24.5 voxels off, of the true one", last, &shadows);
    }
    Ok(())
}

/// Alternating voxels of thin matter, and alternating opaque blocks in a sheet.
pub(super) fn checkerboard(lab: &mut Lab) -> Result<()> {
    let n = [20usize; 3];
    let grid = cubes(n)?;
    let odd = |p: [f64; 3], size: f64| p.iter().map(|x| (x / size) as i64).sum::<i64>() % 2 == 1;
    let thin = lab.medium(&solid(grid, |p| odd(p, 1.0))?, &linear(0.1)?)?;
    let blocks = lab.medium(&solid(grid, |p| p[2] > 14.0 && p[2] < 16.0 && odd([p[0], p[1], 0.0], 4.0))?, &opaque()?)?;
    let cells: Vec<u32> = [[10, 10, 10], [3, 17, 8], [9, 2, 18], [0, 0, 0]].map(|c| cell(n, c)).into();
    let below: Vec<u32> = [[10, 10, 12], [8, 11, 8], [11, 7, 4], [10, 9, 1]].map(|c| cell(n, c)).into();
    let dense = Visibility { step: 0.125, ..settings(Method::March, 1, 4096) };
    let homogeneous_truth: Vec<[f32; 16]> =
        cells.iter().map(|&c| truth(|w| (-0.05 * exit(centre(&grid, n, c), w, DVec3::splat(20.0))).exp())).collect();
    let block_truth = lab.estimate(&blocks, &dense, &below)?;
    let thin_bounds = Expected {
        march: (AtMost(0.03), "256 directions, and the contrast of the nearest voxels"),
        filters: [Fails(0.1, 0.26), AtMost(0.03), AtMost(0.03), AtMost(0.03)],
        hierarchical: "box keeps one voxel's opacity for a long step, the others do not",
        sweep: (AtMost(0.05), "as march, and the kinks at the box's edges"),
    };
    let opaque_bounds = Expected {
        march: (AtMost(0.06), "256 directions between many edges"),
        filters: [Fails(0.06, 0.13), AtMost(0.09), AtMost(0.1), AtMost(0.06)],
        hierarchical: "blocks are averaged with the gaps between them",
        sweep: (AtMost(0.06), "256 directions between many edges"),
    };
    for m in methods(1, 256) {
        let v = lab.estimate(&thin, &m.settings, &cells)?;
        lab.hold(&m, "1 voxel, thin: error against the mean medium", error(&v, &homogeneous_truth), &thin_bounds);
        let v = lab.estimate(&blocks, &m.settings, &below)?;
        lab.hold(&m, "4 voxels, opaque: field error", error(&v, &block_truth), &opaque_bounds);
    }
    Ok(())
}

/// One opaque voxel and cells on a shell around it.
pub(super) fn far_voxel(lab: &mut Lab) -> Result<()> {
    let n = [24usize; 3];
    let grid = cubes(n)?;
    let medium = lab.medium(&solid(grid, |p| p.iter().all(|&x| x > 12.0 && x < 13.0))?, &opaque()?)?;
    let at = DVec3::splat(12.5);
    let shell: Vec<u32> = (0..n.iter().product::<usize>() as u32)
        .filter(|c| c % 5 == 0 && (7.0..11.0).contains(&(centre(&grid, n, *c) - at).length()))
        .collect();
    let blocked = |v: &[[f32; 16]]| v.iter().map(|v| 1.0 - seen(v)).sum::<f64>() / v.len() as f64;
    // Patterns that differ from cell to cell: no bias, and 400 hits in all.
    let dense = Visibility { step: 0.125, sampling: Sampling::Jittered, ..settings(Method::March, 1, 512) };
    let true_mean = blocked(&lab.estimate(&medium, &dense, &shell)?);
    let means = Expected {
        march: (Within(0.7, 1.3), "one direction in eight cells hits it, the same for all cells"),
        filters: [Within(0.7, 1.3), Fails(1.3, 2.5), Fails(1.4, 2.6), Fails(6.0, 12.0)],
        hierarchical: "a level states its mean over the whole step",
        sweep: (Within(0.3, 2.5), "a cell centred in it blocks with its whole face, 1 against about 0.6"),
    };
    for m in methods(1, 256) {
        let s = Visibility { step: 0.25, ..m.settings.clone() };
        let v = lab.estimate(&medium, &s, &shell)?;
        lab.hold(&m, "mean solid angle, of the true one", blocked(&v) / true_mean, &means);
        let most = v.iter().map(|v| 1.0 - seen(v)).fold(0.0, f64::max);
        lab.row(
            &m.name,
            "most that one cell loses, in directions",
            most * 256.0,
            AtMost(2.01),
            "no two directions lie within 4 degrees but at the poles",
        );
    }
    Ok(())
}

/// A bore in opaque matter, seen from its bottom: what is left of the sky is its opening.
pub(super) fn tube(lab: &mut Lab) -> Result<()> {
    let n = [16usize, 16, 40];
    let grid = cubes(n)?;
    let bore = |p: [f64; 3]| (p[0] - 8.0).abs() < 3.0 && (p[1] - 8.0).abs() < 3.0 && p[2] > 1.0;
    let medium = lab.medium(&solid(grid, |p| !bore(p))?, &opaque()?)?;
    // Solid angle of the opening's rectangle, corner by corner.
    let opening = |x: DVec3| {
        let d = 40.0 - x.z;
        let corner = |a: f64, b: f64| (a * b / (d * (a * a + b * b + d * d).sqrt())).atan();
        let (l, r, f, b) = (x.x - 5.0, 11.0 - x.x, x.y - 5.0, 11.0 - x.y);
        (corner(l, f) + corner(l, b) + corner(r, f) + corner(r, b)) / (4.0 * std::f64::consts::PI)
    };
    let bounds = |up: usize| Expected {
        march: (Within(0.85, 1.15), "at least 60 of 24,576 rays get out"),
        filters: match up {
            9 => [Within(0.75, 1.1), Fails(0.55, 0.85), Fails(0.6, 0.92), Fails(0.4, 0.7)],
            17 => [Fails(0.4, 0.8), Fails(0.08, 0.2), Fails(0.12, 0.28), Fails(0.02, 0.09)],
            _ => [Fails(4.5, 9.5), Fails(2.2, 5.0), Fails(2.6, 6.0), Fails(0.3, 0.8)],
        },
        hierarchical: "bore and wall share a cell of the pyramid; far up the wall's outside, too",
        // A bilinear tap has a variance of at most 1/4 cell: an edge is blurred by √k/2 on either side, as much out as in.
        sweep: (Within(0.75, 1.5), "k taps blur the opening's edges by sqrt(k)/2 voxels; what goes in comes out, about"),
    };
    let heights = [31usize, 23, 7];
    let cells: Vec<u32> = heights.iter().flat_map(|&z| [[7, 7], [8, 8], [6, 8]].map(|[x, y]| cell(n, [x, y, z]))).collect();
    let mut tested = methods(1, 8192);
    tested.truncate(5);
    tested.extend(sweeps(1, 256));
    for m in tested {
        let all = lab.estimate(&medium, &m.settings, &cells)?;
        for ((z, v), cells) in heights.iter().zip(all.chunks(3)).zip(cells.chunks(3)) {
            let true_opening: f64 = cells.iter().map(|&c| opening(centre(&grid, n, c))).sum();
            let ratio = v.iter().map(seen).sum::<f64>() / true_opening;
            let up = 40 - z;
            let expected = bounds(up);
            lab.hold(&m, format!("opening {up} voxels up, of the true one"), ratio, &expected);
        }
    }
    Ok(())
}

/// Half a voxel above an opaque plane.
pub(super) fn half_space(lab: &mut Lab) -> Result<()> {
    let n = [40usize, 40, 6];
    let grid = cubes(n)?;
    let medium = lab.medium(&solid(grid, |p| p[2] < 4.0)?, &opaque()?)?;
    let cells = vec![cell(n, [20, 20, 4])];
    let zonal: [f64; 4] = std::array::from_fn(sh::zonal_half_space);
    let exact = truth(|w| {
        let p = DVec3::new(20.5, 20.5, 0.0) + w * (0.5 / -w.z);
        f64::from(u8::from(!(w.z < 0.0 && p.x > 0.0 && p.x < 40.0 && p.y > 0.0 && p.y < 40.0)))
    });
    // What the four bands of a step reach above 1 and below 0.
    let ring = |z: &dyn Fn(usize) -> f64| {
        (0..=200)
            .map(|i| {
                let t = f64::from(i) / 100.0 - 1.0;
                (0..4).map(|l| z(l) * ((2 * l + 1) as f64 / (4.0 * std::f64::consts::PI)).sqrt() * sh::legendre(l, t)).sum::<f64>()
            })
            .fold(0.0, |m: f64, v| m.max(v - 1.0).max(-v))
    };
    lab.row("4 bands of a step", "ringing of V beyond 0..1", ring(&|l| zonal[l]), Within(0.1, 0.13), "P1 and P3 of a step, in closed form");
    let errors = Expected {
        march: (AtMost(0.03), "256 directions beside an edge: N^-3/4 is 0.016"),
        filters: [Fails(0.09, 0.2); 4],
        hierarchical: "a tap half a voxel off the plane reads it: too dark at the horizon",
        sweep: (AtMost(0.05), "as march, and one interpolation beside the plane"),
    };
    let rings = Expected {
        march: (Within(0.1, 0.14), "as the step's own"),
        filters: [Within(0.1, 0.16); 4],
        hierarchical: "about the step's own",
        sweep: (Within(0.1, 0.14), "as the step's own"),
    };
    for m in methods(1, 256) {
        let v = lab.estimate(&medium, &m.settings, &cells)?;
        lab.hold(&m, "field error", error(&v, &[exact]), &errors);
        lab.hold(&m, "ringing of V beyond 0..1", ring(&|l| f64::from(v[0][sh::index(l, 0)])), &rings);
    }
    Ok(())
}
