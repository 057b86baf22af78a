//! minify: O_{k−1} → O_k, the expected opacity over twice the length (Ritschel 2007, section 3.1).
//!
//! A ray crosses two successive cells, so transmittances of pairs are multiplied and then averaged, never opacities.
//! O_k is stated over 2^k voxel lengths. Level dims are halved and rounded down (Vulkan's mip chain); where dims are odd
//! a coarse cell is cut into 2×2×2 halves that average the fine cells they cover.

use super::{Parts, slab};
use crate::error::Result;
use crate::kernels::minify as kernel;
use crate::scene::visibility::Filter;
use crate::vk::{Access, Image, Recorder};

/// Cells per dispatch.
const CELLS: u64 = 1 << 20;

/// Number of levels down to one cell.
pub fn levels(dims: [u32; 3]) -> u32 {
    let largest = dims.iter().copied().max().unwrap_or(1).max(1);
    32 - largest.leading_zeros()
}

/// Dims of level `k`.
pub fn level_dims(dims: [u32; 3], k: u32) -> [u32; 3] {
    dims.map(|n| (n >> k).max(1))
}

/// Records levels 1.. of `pyramid` from level 0, which must have just been written, slab by slab; all levels are left readable.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, pyramid: &Image, filter: Filter, parts: &mut Parts) -> Result<()> {
    // Level 0 was written by `classify` and is read by level 1.
    rec.barrier(&[pyramid.mip(0).from(Access::ComputeWrite).to(Access::ComputeRead)]);
    let spec = kernel::Spec { filter: filter_id(filter) };
    let cells = |k: u32| level_dims(pyramid.dims(), k).iter().map(|&n| f64::from(n)).product::<f64>();
    let (all, mut done) = ((1..pyramid.levels()).map(cells).sum::<f64>(), 0.0);
    for k in 1..pyramid.levels() {
        let dims = level_dims(pyramid.dims(), k);
        // A fresh level takes the layout for stores.
        rec.barrier(&[pyramid.mip(k).from(Access::None).to(Access::ComputeWrite)]);
        let slices = slab(dims, CELLS);
        for first_slice in (0..dims[2]).step_by(slices as usize) {
            if first_slice > 0 {
                // Slabs do not overlap; levels are tracked whole.
                rec.barrier(&[pyramid.mip(k).from(Access::ComputeWrite).to(Access::ComputeWrite)]);
            }
            rec.dispatch(
                &kernel::Bindings { finer: pyramid.level(k - 1), coarser: pyramid.storage(k) },
                &spec,
                &kernel::Params { coarse_dims: dims, first_slice },
                [dims[0], dims[1], slices.min(dims[2] - first_slice)],
            )?;
            done += cells(k) * f64::from(slices.min(dims[2] - first_slice)) / f64::from(dims[2]);
            parts(rec, done / all)?;
        }
        // Each level is read by the next; nothing else runs between them.
        rec.barrier(&[pyramid.mip(k).from(Access::ComputeWrite).to(Access::ComputeRead)]);
    }
    Ok(())
}

fn filter_id(filter: Filter) -> u32 {
    match filter {
        Filter::Box => 0,
        Filter::Product => 1,
        Filter::Axis => 2,
        Filter::Extinction => 3,
    }
}

/// The twin: one level from the next finer one (x fastest), with its dims.
pub fn reference(finer: &[f32], fine_dims: [u32; 3], filter: Filter) -> (Vec<f32>, [u32; 3]) {
    let coarse = level_dims(fine_dims, 1);
    let width: [f32; 3] = std::array::from_fn(|a| fine_dims[a] as f32 / (2 * coarse[a]) as f32);
    let get = |p: [usize; 3]| finer[p[0] + fine_dims[0] as usize * (p[1] + fine_dims[1] as usize * p[2])];
    // Fine cells covered along one axis by half `h` of coarse cell `c`, with the covered lengths.
    let covered = |axis: usize, c: u32, h: u32| -> Vec<(usize, f32)> {
        let start = (2 * c + h) as f32 * width[axis];
        let end = start + width[axis];
        let first = (start + 1e-4).floor() as usize;
        let last = ((end - 1e-4).ceil() as usize).min(fine_dims[axis] as usize);
        (first..last).map(|i| (i, end.min((i + 1) as f32) - start.max(i as f32))).collect()
    };
    let mut out = Vec::with_capacity(coarse.iter().map(|&n| n as usize).product());
    for z in 0..coarse[2] {
        for y in 0..coarse[1] {
            for x in 0..coarse[0] {
                let m: [f32; 8] = std::array::from_fn(|i| {
                    let h = [i as u32 & 1, i as u32 >> 1 & 1, i as u32 >> 2];
                    let (mut sum, mut weights) = (0.0, 0.0);
                    for &(k, wz) in &covered(2, z, h[2]) {
                        for &(j, wy) in &covered(1, y, h[1]) {
                            for &(i, wx) in &covered(0, x, h[0]) {
                                let o = get([i, j, k]);
                                let o = if filter == Filter::Extinction { -(1.0 - o).max(1e-7).ln() } else { o };
                                sum += wx * wy * wz * o;
                                weights += wx * wy * wz;
                            }
                        }
                    }
                    sum / weights
                });
                let mean = m.iter().sum::<f32>() / 8.0;
                out.push(match filter {
                    Filter::Box => mean,
                    Filter::Product => mean * (2.0 - mean),
                    Filter::Extinction => 1.0 - (-2.0 * mean).exp(),
                    Filter::Axis => {
                        let pair = |a: f32, b: f32| a + b - a * b;
                        let along_x = pair(m[0], m[1]) + pair(m[2], m[3]) + pair(m[4], m[5]) + pair(m[6], m[7]);
                        let along_y = pair(m[0], m[2]) + pair(m[1], m[3]) + pair(m[4], m[6]) + pair(m[5], m[7]);
                        let along_z = pair(m[0], m[4]) + pair(m[1], m[5]) + pair(m[2], m[6]) + pair(m[3], m[7]);
                        (along_x + along_y + along_z) / 12.0
                    }
                });
            }
        }
    }
    (out, coarse)
}
