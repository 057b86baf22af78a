//! What the estimators share: which cells and directions a dispatch takes, and the twin of `estimate.glsl`.

use super::directions::{Directions, pcg_hash};
use super::twin;
use crate::scene::Grid;
use crate::vk::Buffer;

/// Cells, directions and sums on the device, and the run of directions that one dispatch adds.
pub struct Run<'a> {
    /// The volume's grid.
    pub grid: &'a Grid,
    /// Cells of the field along x, y, z.
    pub field_dims: [usize; 3],
    /// Linear field indices, u32.
    pub cells: &'a Buffer,
    /// How many of them to estimate.
    pub cell_count: u32,
    /// Stride between coefficients in `sums`.
    pub capacity: u32,
    /// Table of [`super::directions::Direction`].
    pub directions: &'a Buffer,
    /// 16 coefficients × capacity, f32; read and written.
    pub sums: &'a Buffer,
    /// Directions in a pattern.
    pub pattern_size: u32,
    /// Patterns in the table.
    pub patterns: u32,
    /// SH bands to sum.
    pub bands: u32,
    /// First direction of this dispatch; 0 begins new sums.
    pub first_direction: u32,
    /// Directions of this dispatch.
    pub direction_count: u32,
}

impl Run<'_> {
    /// Voxels per field cell along each axis.
    pub fn cell_size(&self) -> [f32; 3] {
        super::cell_size(self.grid, self.field_dims)
    }
}

/// The twin of the estimators' main: (4π/N) Σ V Y for each cell, 16 coefficients each. `visibility(x, d)` is V from voxel
/// position x along voxel-space direction d.
pub fn reference(
    grid: &Grid,
    field_dims: [usize; 3],
    cells: &[u32],
    directions: &Directions,
    visibility: impl Fn([f32; 3], [f32; 3]) -> f32,
) -> Vec<[f32; 16]> {
    let n = directions.pattern_size;
    cells
        .iter()
        .map(|&cell| {
            let x = twin::cell_centre(grid, field_dims, cell);
            let pattern = if directions.patterns > 1 { pcg_hash(cell) % directions.patterns } else { 0 };
            let first = (pattern * n) as usize;
            let mut sums = [0f32; 16];
            for d in &directions.table[first..first + n as usize] {
                let v = visibility(x, [d.voxel[0], d.voxel[1], d.voxel[2]]);
                for (s, y) in sums.iter_mut().zip(d.basis) {
                    *s += v * y;
                }
            }
            sums.map(|s| s * (4.0 * std::f32::consts::PI / n as f32))
        })
        .collect()
}
