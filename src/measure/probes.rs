//! Where a field is measured: cells near matter, drawn at random from a fixed seed.

use crate::engine::{Engine, Medium, Progress};
use crate::error::{Error, Result};
use crate::scene::{Grid, Volume};
use crate::stages::directions::SplitMix;
use crate::stages::twin;
use std::ops::ControlFlow;

/// Field cells within two cells of matter (σ_t > 0 at a voxel that clipping leaves some of), up to `count` of them, drawn at random without
/// repetition from a fixed seed, ascending.
///
/// # Errors
/// What the device refuses.
pub fn probes(engine: &Engine, volume: &Volume, medium: &Medium, ratio: u32, count: usize) -> Result<Vec<u32>> {
    let mut cells = draw(near_matter(engine, volume, medium, ratio)?, count, SEED);
    cells.sort_unstable();
    Ok(cells)
}

/// All field cells at `ratio` voxels per cell within two cells of matter (σ_t > 0 at a voxel that clipping leaves some of),
/// ascending, but those centred inside an opaque surface, which are zero by definition. Looks at each voxel at most once.
///
/// # Errors
/// What the device refuses.
pub fn near_matter(engine: &Engine, volume: &Volume, medium: &Medium, ratio: u32) -> Result<Vec<u32>> {
    near(engine, volume, medium, ratio, &mut |_, _| ControlFlow::Continue(()))
}

/// The same, told of its progress, which may cancel.
pub(crate) fn near(engine: &Engine, volume: &Volume, medium: &Medium, ratio: u32, progress: &mut Progress) -> Result<Vec<u32>> {
    let grid: &Grid = volume.grid();
    let n = grid.dims();
    let dims = grid.field_dims(ratio as usize);
    let cell_of: [Vec<usize>; 3] = std::array::from_fn(|a| (0..n[a]).map(|i| (i * dims[a] / n[a]).min(dims[a] - 1)).collect());
    // Cells that hold a voxel of matter.
    let mut near = vec![false; dims.iter().product()];
    for z in 0..n[2] {
        if progress("probes", z as f32 / n[2] as f32).is_break() {
            return Err(Error::Cancelled);
        }
        for y in 0..n[1] {
            let row = dims[0] * (cell_of[1][y] + dims[1] * cell_of[2][z]);
            let first = n[0] * (y + n[1] * z);
            for x in 0..n[0] {
                let cell = &mut near[row + cell_of[0][x]];
                // Most voxels of matter lie in cells that are known already. What was cut away is seen by nobody; a slab thinner
                // than a voxel still is.
                let matter = || twin::extinction(medium.table(), volume.value(first + x)) > 0.0;
                *cell = *cell || (matter() && medium.keeps_part([x, y, z].map(|c| c as f32 + 0.5)));
            }
        }
    }
    // Grown by two cells along each axis in turn.
    let strides = [1, dims[0], dims[0] * dims[1]];
    for a in 0..3 {
        let source = near.clone();
        for (i, out) in near.iter_mut().enumerate() {
            let at = i / strides[a] % dims[a];
            let (lo, hi) = (at.saturating_sub(2), (at + 2).min(dims[a] - 1));
            *out = (lo..=hi).any(|k| source[i + k * strides[a] - at * strides[a]]);
        }
    }
    let buried = engine.buried(medium, dims)?;
    let sees = |i: usize| !buried.get(i).is_some_and(|b| *b);
    Ok((0..near.len()).filter(|&i| near[i] && sees(i)).map(|i| i as u32).collect())
}

/// The seed of the probes.
pub(crate) const SEED: u64 = 0x70_726f_6265;

/// Up to `count` of `cells`, at random without repetition from `seed`, in the order drawn: the first of many are the
/// few that a smaller count would draw.
pub(crate) fn draw(mut cells: Vec<u32>, count: usize, seed: u64) -> Vec<u32> {
    // Fisher-Yates, as far as needed.
    let mut random = SplitMix(seed);
    let count = count.min(cells.len());
    for i in 0..count {
        let j = i + (random.next() % (cells.len() - i) as u64) as usize;
        cells.swap(i, j);
    }
    cells.truncate(count);
    cells.shrink_to_fit();
    cells
}
