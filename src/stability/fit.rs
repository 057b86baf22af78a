//! Where fitting cells to what pictures read between them helps, and where it cannot.

use super::Bound::{AtMost, Fails, Within};
use super::lab::{Lab, OPEN, cubes, linear, settings};
use crate::error::Result;
use crate::measure::{field_error, reading};
use crate::scene::visibility::Method;
use crate::scene::{Visibility, Volume};

/// Voxels of a cell.
const RATIO: u32 = 4;

/// Directions of the truth at voxels.
const TRUTH: u32 = 1024;

/// Hollow balls of walls of 1 to 8 voxels, 1 per voxel of extinction, under cells of four.
pub(super) fn walls(lab: &mut Lab) -> Result<()> {
    let n = 48;
    let grid = cubes([n; 3])?;
    let matter = linear(1.0)?;
    let (thin, thick) = ("a wall within a cell is lit from both sides at once", "light falls within a voxel, and a cell is four");
    // About a third around what was measured.
    let bounds = [
        (1.0, Fails(0.1, 0.2), 0.45, thin),
        (2.0, Fails(0.13, 0.27), 0.6, thin),
        (4.0, Fails(0.14, 0.28), 0.65, thick),
        (8.0, Fails(0.14, 0.29), 0.65, thick),
    ];
    for (wall, fitted, part, why) in bounds {
        let volume = Volume::from_fn(grid, |p| {
            let r = p.iter().map(|c| (c - n as f64 / 2.0).powi(2)).sum::<f64>().sqrt();
            (0.5 + wall / 2.0 - (r - 19.0 + wall / 2.0).abs()).clamp(0.0, 1.0) as f32
        })?;
        let medium = lab.medium(&volume, &matter)?;
        let voxels = reading::points(&volume, &medium, 400);
        let truth = lab.engine.estimate(&medium, &settings(Method::March, 1, TRUTH), &voxels, lab.progress)?;
        let roots: Vec<f32> = reading::weights(&volume, &medium, &voxels, &truth).into_iter().map(f32::sqrt).collect();
        let weighted = |v: &[[f32; 16]]| v.iter().zip(&roots).map(|(v, w)| v.map(|c| w * c)).collect::<Vec<_>>();
        let dims = grid.field_dims(RATIO as usize);
        let cells: Vec<u32> = (0..dims.iter().product::<usize>() as u32).collect();
        let mut errors = [0.0; 2];
        for (k, fit) in [0, 8].into_iter().enumerate() {
            let swept = Visibility { fit, ..settings(Method::Sweep, RATIO, 256) };
            // A fitted cell lies beyond the sky on purpose: it is no estimate of what is seen anywhere.
            let mut v = match fit {
                0 => lab.estimate(&medium, &swept, &cells)?,
                _ => lab.engine.estimate(&medium, &swept, &cells, lab.progress)?,
            };
            v.iter_mut().flatten().for_each(|c| *c *= if fit > 0 { lab.tamper() } else { 1.0 });
            let read: Vec<_> = voxels.iter().map(|&p| reading::read(p, [n; 3], dims, |c| v[c as usize])).collect();
            errors[k] = field_error(&weighted(&read), &weighted(&truth)).relative_l2;
            if fit > 0 {
                let most = v.iter().map(|v| f64::from(v[0])).fold(0.0, f64::max) / OPEN;
                let least = v.iter().map(|v| f64::from(v[0])).fold(0.0, f64::min) / OPEN;
                let why = "beyond what is seen, to make light's fall; what packs ends half a sky off";
                lab.row("sweep, fitted", format!("wall of {wall}: v00 of an open sky, most"), most, Within(1.0, 1.5001), why);
                lab.row("sweep, fitted", format!("wall of {wall}: v00 of an open sky, least"), least, Within(-0.5001, 0.0), why);
            }
        }
        lab.row(
            "sweep",
            format!("wall of {wall}: error as pictures read"),
            errors[0],
            Fails(0.29, 0.6),
            "centres lie before the wall or in it",
        );
        lab.row("sweep, fitted", format!("wall of {wall}: error as pictures read"), errors[1], fitted, why);
        lab.row(
            "sweep, fitted",
            format!("wall of {wall}: of the error at centres"),
            errors[1] / errors[0],
            AtMost(part),
            "least squares of what is read",
        );
    }
    Ok(())
}
