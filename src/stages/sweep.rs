//! sweep: short characteristics. For a direction ω with major axis a, slices across a are swept from the side that ω
//! leaves by: T(x) = exp(−τ(x → next slice)) · bilinear(T of the next slice), τ marched densely through the volume with
//! classification after interpolation. V(x, ω) takes `near` such segments before it trusts the swept T. The cost per cell
//! and direction does not grow with the volume; the error is that of interpolating T from slice to slice.

use super::directions::{Direction, Directions};
use super::{MediumView, cell_size, dims_f32, dims_u32, twin};
use crate::error::Result;
use crate::kernels::{gather, sweep as kernel};
use crate::scene::Volume;
use crate::scene::transfer::Table;
use crate::vk::{Buffer, Image, Recorder};

/// Directions of one major axis and sign, a run of the sorted table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// Major axis: 0, 1, 2.
    pub axis: usize,
    /// Whether ω rises along the axis.
    pub rising: bool,
    /// First direction.
    pub first: u32,
    /// Directions.
    pub count: u32,
}

/// Sorts a table of directions by major axis and sign, measured in cells, and says where each group stands.
pub fn groups(directions: &mut [Direction], cell_size: [f32; 3]) -> Vec<Group> {
    let key = |d: &Direction| -> (usize, bool) {
        let cells: [f32; 3] = std::array::from_fn(|a| (d.voxel[a] / cell_size[a]).abs());
        let axis = if cells[0] >= cells[1] && cells[0] >= cells[2] { 0 } else { 1 + usize::from(cells[2] > cells[1]) };
        (axis, d.voxel[axis] > 0.0)
    };
    directions.sort_by_key(key);
    let mut groups: Vec<Group> = Vec::new();
    for (i, d) in directions.iter().enumerate() {
        let (axis, rising) = key(d);
        match groups.last_mut() {
            Some(g) if (g.axis, g.rising) == (axis, rising) => g.count += 1,
            _ => groups.push(Group { axis, rising, first: i as u32, count: 1 }),
        }
    }
    groups
}

/// Cells of a slice across `axis`.
pub fn slice_cells(field_dims: [usize; 3], axis: usize) -> usize {
    field_dims.iter().product::<usize>() / field_dims[axis]
}

/// What a sweep reads and writes.
pub struct Sweep<'a> {
    /// Cells of the field along x, y, z.
    pub field_dims: [usize; 3],
    /// Sorted table of [`Direction`].
    pub directions: &'a Buffer,
    /// (near + 1) slices × directions of a batch × cells of a slice, f32; read and written.
    pub transmittance: &'a Buffer,
    /// Four rgba32f images of the field's dims; read and written.
    pub sums: [&'a Image; 4],
    /// SH bands to sum.
    pub bands: u32,
    /// Slices marched densely before the swept value.
    pub near: u32,
}

/// One slice of one batch.
#[derive(Clone, Copy, Debug)]
pub struct Slice {
    /// Major axis.
    pub axis: usize,
    /// Index of the slice along the axis.
    pub index: u32,
    /// How many slices of this batch were swept before: 0 is where the rays leave.
    pub order: u32,
    /// First direction of the batch.
    pub first_direction: u32,
    /// Directions of the batch.
    pub direction_count: u32,
    /// Whether the sums are fresh.
    pub begin: bool,
}

/// Records one slice; the caller puts barriers on `transmittance` and `sums`.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, medium: &MediumView, sweep: &Sweep, slice: Slice, step_length: f64) -> Result<()> {
    rec.dispatch(
        &kernel::Bindings {
            directions: sweep.directions,
            volume: medium.volume.sampled(),
            sigma: medium.sigma,
            transmittance: sweep.transmittance,
            sums0: sweep.sums[0].storage(0),
            sums1: sweep.sums[1].storage(0),
            sums2: sweep.sums[2].storage(0),
            sums3: sweep.sums[3].storage(0),
        },
        &kernel::Spec { bands: sweep.bands, near: sweep.near },
        &kernel::Params {
            cell_size: cell_size(medium.grid, sweep.field_dims),
            step_length: step_length as f32,
            volume_dims: dims_f32(medium.grid.dims()),
            map_scale: medium.map.0,
            field_dims: dims_u32(sweep.field_dims),
            map_bias: medium.map.1,
            axis: slice.axis as u32,
            slice: slice.index,
            ring_slot: slice.order % (sweep.near + 1),
            first_direction: slice.first_direction,
            direction_count: slice.direction_count,
            begin: u32::from(slice.begin),
        },
        [slice_cells(sweep.field_dims, slice.axis) as u32, 1, 1],
    )
}

/// Records the gathering of some cells' sums into the estimators' common buffer; `images` must be readable.
///
/// # Errors
/// What the recorder refuses.
pub fn record_gather(rec: &mut Recorder, run: &super::estimate::Run, images: [&Image; 4]) -> Result<()> {
    rec.dispatch(
        &gather::Bindings {
            cells: run.cells,
            sums0: images[0].sampled(),
            sums1: images[1].sampled(),
            sums2: images[2].sampled(),
            sums3: images[3].sampled(),
            sums: run.sums,
        },
        &gather::Spec { bands: run.bands },
        &gather::Params { field_dims: dims_u32(run.field_dims), cell_count: run.cell_count, capacity: run.capacity },
        [run.cell_count, 1, 1],
    )
}

/// The twin: coefficients of every cell, x fastest.
pub fn reference(
    volume: &Volume,
    table: &Table,
    field_dims: [usize; 3],
    directions: &Directions,
    near: u32,
    step_length: f64,
) -> Vec<[f32; 16]> {
    let grid = volume.grid();
    let size = cell_size(grid, field_dims);
    let mut set = directions.table.clone();
    let mut out = vec![[0f32; 16]; field_dims.iter().product()];
    for group in groups(&mut set, size) {
        let (a, b, c) = (group.axis, usize::from(group.axis == 0), if group.axis == 2 { 1 } else { 2 });
        for d in &set[group.first as usize..(group.first + group.count) as usize] {
            let dir = [d.voxel[0], d.voxel[1], d.voxel[2]];
            let ds = size[a] / dir[a].abs();
            let shift = [dir[b] / size[b] * ds, dir[c] / size[c] * ds];
            let plane = [field_dims[b], field_dims[c]];
            // Swept slices, the one where the rays leave first.
            let mut swept: Vec<Vec<f32>> = Vec::new();
            for order in 0..field_dims[a] {
                let index = if group.rising { field_dims[a] - 1 - order } else { order };
                let mut slice = Vec::with_capacity(plane[0] * plane[1]);
                for j in 0..plane[1] {
                    for i in 0..plane[0] {
                        let mut cell = [0; 3];
                        (cell[a], cell[b], cell[c]) = (index, i, j);
                        let x: [f32; 3] = std::array::from_fn(|k| (cell[k] as f32 + 0.5) * size[k]);
                        let end = twin::exit_distance(x, dir, grid.dims());
                        let (mut depth, mut v) = (0f32, 0f32);
                        for m in 1..=near as usize {
                            let (from, to) = ((m - 1) as f32 * ds, (m as f32 * ds).min(end));
                            let n = ((to - from) / step_length as f32 - 1e-3).ceil().max(0.0);
                            let s = (to - from) / n.max(1.0);
                            for k in 0..n as u32 {
                                let p = twin::along(x, dir, from + (k as f32 + 0.5) * s);
                                depth += s * twin::extinction(table, twin::sample(volume, p));
                            }
                            let mut beyond = 1.0;
                            if m as f32 * ds < end {
                                let q = [i as f32 + m as f32 * shift[0] + 0.5, j as f32 + m as f32 * shift[1] + 0.5, 0.5];
                                let swept = twin::trilinear([plane[0], plane[1], 1], q, |p| swept[order - m][p[0] + plane[0] * p[1]]);
                                // Beyond the last cell centre T rises to 1 at the wall, half a cell off.
                                let inside = |k: usize| 1.0 - (2.0 * (0.5 - q[k]).max(q[k] + 0.5 - plane[k] as f32)).clamp(0.0, 1.0);
                                beyond = 1.0 + (swept - 1.0) * inside(0) * inside(1);
                            }
                            v = (-depth).exp() * beyond;
                            if m == 1 {
                                slice.push(v);
                            }
                        }
                        let sums = &mut out[cell[0] + field_dims[0] * (cell[1] + field_dims[1] * cell[2])];
                        for (s, y) in sums.iter_mut().zip(d.basis) {
                            *s += v * y;
                        }
                    }
                }
                swept.push(slice);
            }
        }
    }
    let weight = 4.0 * std::f32::consts::PI / directions.pattern_size as f32;
    out.iter().map(|s| s.map(|s| s * weight)).collect()
}
