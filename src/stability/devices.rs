//! The same scene elsewhere: on this processor by the kernels' twins, and on every other device of the machine.

use super::Bound::AtMost;
use super::lab::{Lab, error, every, linear, settings};
use crate::engine::{Engine, Options, devices};
use crate::error::Result;
use crate::scene::grid::glam::{DAffine3, DMat3, DVec3};
use crate::scene::visibility::{Method, Sampling};
use crate::scene::{Grid, Visibility, Volume};
use crate::stages::directions::Directions;
use crate::stages::{classify, hierarchical, march, minify, sweep};

/// What two devices may differ by: exp and division by a few ulp, weights of filters by 1/256 on some.
const TOLERANCE: f64 = 1e-3;

/// Two clouds on an oblique grid.
fn clouds() -> Result<Volume> {
    let axes = DMat3::from_cols(DVec3::new(1.1, 0.2, 0.0), DVec3::new(-0.3, 1.0, 0.1), DVec3::new(0.1, -0.2, 1.3));
    let grid = Grid::new([19, 14, 11], DAffine3 { matrix3: axes, translation: DVec3::new(3.0, -2.0, 1.0) })?;
    Volume::from_fn(grid, |p| {
        let d = |c: [f64; 3], r: f64| (-(0..3).map(|a| (p[a] - c[a]).powi(2)).sum::<f64>() / (r * r)).exp();
        (d([11.0, 6.0, 5.0], 4.0) + d([5.0, 9.0, 7.0], 2.5)).min(1.0) as f32
    })
}

/// The coefficients of every cell of a method on this processor.
fn twin(volume: &Volume, s: &Visibility) -> Result<Vec<[f32; 16]>> {
    let (grid, table) = (volume.grid(), linear(0.7)?.transfer.table(volume.range(), volume.grid()));
    let dims = grid.field_dims(s.ratio as usize);
    let step_length = f64::from(s.step) * grid.voxel_length();
    let set = Directions::new(s.directions, Sampling::Stratified, grid);
    Ok(match s.method {
        Method::March => march::reference(volume, &table, dims, &every(dims), &set, step_length),
        Method::Hierarchical => {
            let (mut pyramid, mut level) = (vec![classify::reference(volume, &table)], grid.dims().map(|n| n as u32));
            while level != [1; 3] {
                let (coarser, dims) = minify::reference(&pyramid[pyramid.len() - 1], level, s.filter);
                pyramid.push(coarser);
                level = dims;
            }
            hierarchical::reference(grid, &pyramid, dims, &every(dims), &set, s.growth)
        }
        Method::Sweep => {
            sweep::reference(volume, &table, dims, &sweep::rays(s.directions, grid), sweep::Settings { near: s.near, step_length })
        }
    })
}

/// Each method here, by its twin, and on every other device.
pub(super) fn elsewhere(lab: &mut Lab) -> Result<()> {
    let volume = clouds()?;
    let tested = [("march", Method::March), ("hierarchical axis", Method::Hierarchical), ("sweep near 2", Method::Sweep)]
        .map(|(name, method)| (name, Visibility { near: 2, ..settings(method, 2, 48) }));
    let cells = every(volume.grid().field_dims(2));
    let medium = lab.medium(&volume, &linear(0.7)?)?;
    let mut here = Vec::new();
    for (name, s) in &tested {
        let v = lab.estimate(&medium, s, &cells)?;
        let off = error(&v, &twin(&volume, s)?);
        lab.row(*name, "change from device to this processor's twin", off, AtMost(TOLERANCE), "single precision, exp by a few ulp");
        here.push(v);
    }
    let (mut compared, own) = (0, lab.engine.device().index);
    for info in devices()?.into_iter().filter(|d| d.index != own) {
        // What cannot run the kernels is no device to compare with.
        let Ok(other) = Engine::new(&Options { device: Some(info.index.to_string()), ..Options::default() }) else { continue };
        let medium = other.classify(&other.upload(&volume)?, &linear(0.7)?)?;
        compared += 1;
        for ((name, s), here) in tested.iter().zip(&here) {
            let off = error(&other.estimate(&medium, s, &cells, lab.progress)?, here);
            let why = "single precision, exp by a few ulp, weights of filters";
            lab.row(*name, format!("change to {}", info.name), off, AtMost(TOLERANCE), why);
        }
    }
    if compared == 0 {
        let why = "this machine has no other; tests/stability compares code of 128 and 256 bits, and a driver that is named to it";
        lab.row("all", "other Vulkan devices that were compared", 0.0, AtMost(0.0), why);
    }
    Ok(())
}
