//! march: the dense estimator. v_lm = (4π/N) Σ_i V(x, ω_i) Y_lm(ω_i), V = exp(−∫σ_t ds) by the midpoint rule with
//! classification after interpolation. With steps ≤ ¼ voxel and N large it is the ground truth.

use super::directions::Directions;
use super::estimate::{self, Run};
use super::{MediumView, dims_f32, dims_u32, twin};
use crate::error::Result;
use crate::kernels::march as kernel;
use crate::scene::Volume;
use crate::scene::transfer::Table;
use crate::vk::Recorder;

/// Steps of the longest ray.
pub fn max_steps(diagonal: f64, step_length: f64) -> u64 {
    ((diagonal / step_length).ceil() as u64).saturating_add(1)
}

/// Records one run of directions; the caller puts barriers on `run.sums`.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, medium: &MediumView, run: &Run, step_length: f64) -> Result<()> {
    rec.dispatch(
        &kernel::Bindings {
            cells: run.cells,
            directions: run.directions,
            sums: run.sums,
            volume: medium.volume.sampled(),
            sigma: medium.sigma,
        },
        &kernel::Spec { bands: run.bands, clips: medium.clips },
        &kernel::Params {
            cell_size: run.cell_size(),
            step_length: step_length as f32,
            volume_dims: dims_f32(medium.grid.dims()),
            map_scale: medium.map.0,
            field_dims: dims_u32(run.field_dims),
            map_bias: medium.map.1,
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

/// The twin: coefficients of `cells`.
pub fn reference(
    volume: &Volume,
    table: &Table,
    field_dims: [usize; 3],
    cells: &[u32],
    directions: &Directions,
    step_length: f64,
) -> Vec<[f32; 16]> {
    reference_clipped(volume, table, field_dims, cells, directions, step_length, &[])
}

/// The twin under clip planes ([`crate::scene::Clip::half_spaces`]).
pub fn reference_clipped(
    volume: &Volume,
    table: &Table,
    field_dims: [usize; 3],
    cells: &[u32],
    directions: &Directions,
    step_length: f64,
    clip: &[[f32; 4]],
) -> Vec<[f32; 16]> {
    let dims = volume.grid().dims();
    let step = step_length as f32;
    estimate::reference(volume.grid(), field_dims, cells, directions, |x, d| {
        let (begin, end) = twin::clip_span(clip, x, d, (0.0, twin::exit_distance(x, d, dims)));
        let end = (end - begin).max(0.0);
        let mut depth = 0.0;
        for i in 0..(end / step).ceil() as u32 {
            let t = i as f32 * step;
            let s = step.min(end - t);
            depth += s * twin::extinction(table, twin::sample(volume, twin::along(x, d, begin + t + 0.5 * s)));
            if depth > 10.0 {
                break;
            }
        }
        (-depth).exp()
    })
}
