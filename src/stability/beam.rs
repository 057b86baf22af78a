//! One direction alone: N = 1 looks along world +x, and a grid that is turned makes any voxel direction of it.

use super::Bound::{AtMost, Fails, Within};
use super::lab::{Lab, Tested, every, linear, opaque, seen, settings, sweeps};
use crate::error::Result;
use crate::scene::grid::glam::{DAffine3, DMat3, DQuat, DVec3};
use crate::scene::visibility::Method;
use crate::scene::{Grid, Visibility, Volume};

/// Unit voxels, turned so that world +x is the voxel direction `along`.
fn turned(dims: [usize; 3], along: DVec3) -> Result<Grid> {
    let turn = DMat3::from_quat(DQuat::from_rotation_arc(along.normalize(), DVec3::X));
    Grid::new(dims, DAffine3 { matrix3: turn, translation: DVec3::ZERO })
}

/// V along that direction from each cell.
fn transmittance(lab: &mut Lab, volume: &Volume, matter: &crate::scene::Matter, s: &Visibility) -> Result<Vec<f64>> {
    let medium = lab.medium(volume, matter)?;
    let cells = every(volume.grid().field_dims(s.ratio as usize));
    let s = Visibility { directions: 1, ..s.clone() };
    Ok(lab.estimate(&medium, &s, &cells)?.iter().map(seen).collect())
}

/// Light through a hole of 3x3 voxels, 24 voxels behind it: a beam as wide as the hole, unless T is blurred on the way.
pub(super) fn pinhole(lab: &mut Lab) -> Result<()> {
    let along = DVec3::new(0.31, 0.17, 1.0);
    let n = [32usize, 32, 32];
    let grid = turned(n, along)?;
    let wall = Volume::from_fn(grid, |p| {
        let open = (p[0] - 16.5).abs() < 1.6 && (p[1] - 14.5).abs() < 1.6;
        f32::from(u8::from(p[2] > 26.0 && p[2] < 28.0 && !open))
    })?;
    let mut tested = vec![Tested { name: "march".into(), settings: settings(Method::March, 1, 1) }];
    tested.push(Tested { name: "hierarchical axis".into(), settings: settings(Method::Hierarchical, 1, 1) });
    tested.extend(sweeps(1, 1));
    tested.extend(sweeps(4, 1).into_iter().skip(1).map(|m| Tested { name: format!("{}, 1:4", m.name), ..m }));
    // What of the hole a slanting ray gets through; the wall is two voxels thick.
    let open = (3.0 - 2.0 * along.x) * (3.0 - 2.0 * along.y);
    for m in tested {
        let dims = grid.field_dims(m.settings.ratio as usize);
        let h = f64::from(m.settings.ratio);
        let v = transmittance(lab, &wall, &opaque()?, &m.settings)?;
        // The slice whose centre lies 24 voxels in front of the wall's middle.
        let slice = ((27.0 - 24.0) / h) as usize;
        let (mut sum, mut first, mut second) = (0.0, DVec3::ZERO, DVec3::ZERO);
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                let (p, t) = (DVec3::new(i as f64 + 0.5, j as f64 + 0.5, 0.0) * h, v[i + dims[0] * (j + dims[1] * slice)]);
                // Only what looks at the wall near the hole: past the wall's rim the sky is open.
                let through = p + along * (27.0 - (slice as f64 + 0.5) * h);
                if (through.x - 16.5).abs() < 8.0 && (through.y - 14.5).abs() < 8.0 {
                    (sum, first, second) = (sum + t, first + t * p, second + t * p * p);
                }
            }
        }
        let variance = second / sum.max(1e-30) - (first / sum.max(1e-30)).powf(2.0);
        let width = (0.5 * (variance.x + variance.y)).max(0.0).sqrt();
        let area = sum * h * h / open;
        // Slices that hand on, each over `near` marched ones.
        let taps = 26.0 / (h * f64::from(m.settings.near.max(1)));
        let (areas, widths, why) = match (m.settings.method, m.settings.ratio) {
            (Method::March, _) => (Within(0.6, 1.5), Within(0.5, 1.0), "2 or 3 cells of 1 along each side"),
            (Method::Hierarchical, _) => (Fails(11.0, 25.0), Fails(3.5, 6.0), "far up, the wall is averaged with vacuum and leaks"),
            (_, 1) => (
                Within(0.7, 1.5),
                Within(0.5, (0.6 + taps / 4.0).sqrt()),
                "2 or 3 cells of 1 a side, as marched; a bilinear tap gains no light, blurs by 1/4 cell^2",
            ),
            _ => (
                Fails(0.0, 16.001 / open),
                Fails(0.0, h * (0.6 + taps / 4.0).sqrt()),
                "the hole is smaller than a cell: nothing, or up to one cell's face",
            ),
        };
        lab.row(&m.name, "beam's area, of the true one", area, areas, why);
        lab.row(&m.name, "beam's rms half width, voxels (true: 0.7)", width, widths, why);
    }
    Ok(())
}

/// V while the direction turns through 45 degrees between two axes.
pub(super) fn axis_switch(lab: &mut Lab) -> Result<()> {
    let n = [20usize; 3];
    let along = |degrees: f64| {
        let (s, c) = degrees.to_radians().sin_cos();
        DVec3::new(c, s, 0.23)
    };
    let cloud = |p: [f64; 3]| {
        let d = |c: [f64; 3], r: f64| (-(0..3).map(|a| (p[a] - c[a]).powi(2)).sum::<f64>() / (r * r)).exp();
        (d([12.0, 8.0, 9.0], 4.0) + d([6.0, 14.0, 12.0], 3.0)).min(1.0) as f32
    };
    let block = |p: [f64; 3]| f32::from(u8::from((p[0] - 11.0).abs() < 3.0 && (p[1] - 9.0).abs() < 4.0 && (p[2] - 10.0).abs() < 5.0));
    let jump = |a: &[f64], b: &[f64]| (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt();
    for (name, soft) in [("soft", true), ("hard", false)] {
        let mut tested = sweeps(1, 1);
        tested.push(Tested { name: "sweep near 2, 1:2".into(), settings: Visibility { near: 2, ..settings(Method::Sweep, 2, 1) } });
        for m in tested {
            let mut at = |degrees: f64| -> Result<Vec<f64>> {
                let grid = turned(n, along(degrees))?;
                let (volume, matter) =
                    if soft { (Volume::from_fn(grid, cloud)?, linear(0.4)?) } else { (Volume::from_fn(grid, block)?, opaque()?) };
                transmittance(lab, &volume, &matter, &m.settings)
            };
            let across = jump(&at(44.95)?, &at(45.05)?);
            let beside = jump(&at(44.85)?, &at(44.95)?).max(jump(&at(45.05)?, &at(45.15)?));
            let what = format!("{name}: change of V across 45, of that beside");
            lab.row(&m.name, what, across / beside, AtMost(2.0), "the slices of both axes see the same T");
        }
    }
    Ok(())
}
