//! classify: volume → O₀, the expected opacity of each voxel (Ritschel 2007, section 3.1).
//!
//! O₀ = 1 − ⅓ Σ_axis exp(−h · mean σ_t across the voxel along the axis), h the voxel length; classification inside the
//! integral, which the midpoint rule takes with two points in each half voxel.

use super::{MediumView, Parts, dims_u32, slab, twin};
use crate::error::Result;
use crate::kernels::classify as kernel;
use crate::scene::Volume;
use crate::scene::transfer::Table;
use crate::vk::{Access, Image, Recorder};

/// Voxels per dispatch: tens of milliseconds on a CPU device.
const VOXELS: u64 = 1 << 20;

/// Records O₀ of `medium` into level 0 of a fresh `pyramid` (r16f, same dims), which is left as just written, slab by slab.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, medium: &MediumView, pyramid: &Image, parts: &mut Parts) -> Result<()> {
    let dims = dims_u32(medium.grid.dims());
    let slices = slab(dims, VOXELS);
    // A fresh image takes the layout for stores.
    rec.barrier(&[pyramid.mip(0).from(Access::None).to(Access::ComputeWrite)]);
    for first_slice in (0..dims[2]).step_by(slices as usize) {
        if first_slice > 0 {
            // Slabs do not overlap; levels are tracked whole, so say that the writes may follow each other.
            rec.barrier(&[pyramid.mip(0).from(Access::ComputeWrite).to(Access::ComputeWrite)]);
        }
        rec.dispatch(
            &kernel::Bindings { volume: medium.volume.sampled(), sigma: medium.sigma, opacity: pyramid.storage(0) },
            &kernel::Spec { clips: medium.clips },
            &kernel::Params {
                map_scale: medium.map.0,
                map_bias: medium.map.1,
                voxel_length: medium.grid.voxel_length() as f32,
                first_slice,
            },
            [dims[0], dims[1], slices.min(dims[2] - first_slice)],
        )?;
        parts(rec, f64::from((first_slice + slices).min(dims[2])) / f64::from(dims[2]))?;
    }
    Ok(())
}

/// The twin: O₀ of every voxel, x fastest.
pub fn reference(volume: &Volume, table: &Table) -> Vec<f32> {
    reference_clipped(volume, table, &[])
}

/// The twin under clip planes: points that are clipped away count as vacuum.
pub fn reference_clipped(volume: &Volume, table: &Table, clip: &[[f32; 4]]) -> Vec<f32> {
    let [nx, ny, nz] = volume.grid().dims().map(|n| n as i64);
    let h = volume.grid().voxel_length() as f32;
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let mut out = Vec::with_capacity((nx * ny * nz) as usize);
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let here = twin::fetch(volume, [x, y, z]);
                let mut sum = 0.0;
                for axis in 0..3 {
                    let mut step = [0, 0, 0];
                    step[axis] = 1;
                    let before = twin::fetch(volume, [x - step[0], y - step[1], z - step[2]]);
                    let after = twin::fetch(volume, [x + step[0], y + step[1], z + step[2]]);
                    let kept = |along: f32| {
                        let p: [f32; 3] = std::array::from_fn(|a| [x, y, z][a] as f32 + 0.5 + along * step[a] as f32);
                        clip.iter().all(|n| n[0] * p[0] + n[1] * p[1] + n[2] * p[2] + n[3] >= 0.0)
                    };
                    let mean = [(before, -0.375), (before, -0.125), (after, 0.125), (after, 0.375)]
                        .iter()
                        .filter(|(_, along)| kept(*along))
                        .map(|&(next, along): &(f32, f32)| twin::extinction(table, mix(here, next, along.abs())))
                        .sum::<f32>()
                        * 0.25;
                    sum -= (-mean * h).exp_m1();
                }
                out.push(sum / 3.0);
            }
        }
    }
    out
}
