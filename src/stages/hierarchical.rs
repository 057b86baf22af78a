//! hierarchical: the paper's estimator (Ritschel 2007, section 3.1). A ray starts in O₀ with steps of one voxel; the step
//! grows with distance, step = max(1, growth·distance), and the level of the pyramid follows it, log₂(step); two levels are
//! blended by length, and a step longer than the coarsest level states takes the power of it.

use super::directions::Directions;
use super::estimate::{self, Run};
use super::minify::level_dims;
use super::{dims_f32, dims_u32, twin};
use crate::error::Result;
use crate::kernels::hierarchical as kernel;
use crate::scene::Grid;
use crate::vk::{Image, Recorder};

/// Steps of the longest ray, for bounding dispatches.
pub fn max_steps(diagonal_voxels: f64, growth: f64) -> u64 {
    let mut t = 0.0;
    let mut steps = 0;
    while t < diagonal_voxels {
        t += f64::max(1.0, growth * t);
        steps += 1;
    }
    steps
}

/// Records one run of directions; the caller puts barriers on `run.sums`.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, pyramid: &Image, run: &Run, growth: f32) -> Result<()> {
    rec.dispatch(
        &kernel::Bindings { cells: run.cells, directions: run.directions, sums: run.sums, pyramid: pyramid.sampled() },
        &kernel::Spec { bands: run.bands },
        &kernel::Params {
            cell_size: run.cell_size(),
            voxel_length: run.grid.voxel_length() as f32,
            volume_dims: dims_f32(run.grid.dims()),
            growth,
            field_dims: dims_u32(run.field_dims),
            cell_count: run.cell_count,
            capacity: run.capacity,
            first_direction: run.first_direction,
            direction_count: run.direction_count,
            pattern_size: run.pattern_size,
            patterns: run.patterns,
        },
        [run.cell_count, 1, 1],
    )
}

/// The twin: coefficients of `cells`; `pyramid` holds the levels, finest first.
pub fn reference(
    grid: &Grid,
    pyramid: &[Vec<f32>],
    field_dims: [usize; 3],
    cells: &[u32],
    directions: &Directions,
    growth: f32,
) -> Vec<[f32; 16]> {
    let dims = grid.dims();
    let h = grid.voxel_length() as f32;
    // One level at normalised coordinates.
    let tap = |k: usize, p: [f32; 3]| -> f32 {
        let d = level_dims(dims_u32(dims), k as u32).map(|n| n as usize);
        let q = std::array::from_fn(|a| p[a] / dims[a] as f32 * d[a] as f32);
        twin::texture(d, q, |i| pyramid[k][i[0] + d[0] * (i[1] + d[1] * i[2])])
    };
    estimate::reference(grid, field_dims, cells, directions, |x, d| {
        let end = twin::exit_distance(x, d, dims);
        let (mut t, mut transmittance) = (0f32, 1f32);
        while t < end {
            let s = h.max(growth * t);
            let part = ((end - t) / s).min(1.0);
            let (level, top) = ((s / h).log2(), (pyramid.len() - 1) as f32);
            let power = if level > top { part * (level - top).exp2() } else { part };
            let p = twin::along(x, d, t + 0.5 * part * s);
            let k = level.min(top) as usize;
            // 2^level lies so far between the two lengths 2^k and 2^(k+1).
            let f = (level.min(top) - k as f32).exp2() - 1.0;
            let mut o = tap(k, p);
            if f > 0.0 {
                o += (tap(k + 1, p) - o) * f;
            }
            let clear = 1.0 - o;
            transmittance *= if power == 1.0 {
                clear
            } else if clear > 0.0 {
                clear.powf(power)
            } else {
                0.0
            };
            if transmittance < 1e-4 {
                break;
            }
            t += s;
        }
        transmittance
    })
}
