//! sweep: short characteristics. For a direction ω with major axis a, slices across a are swept from the side that ω
//! leaves by: T(x) = exp(−τ(x → the slice `near` further on)) · bilinear(T of that slice). τ is marched densely through the
//! volume with classification after interpolation. The cost per cell and direction does not grow with the volume; the
//! error is that of interpolating T, which diffuses a little every `near` slices.

use super::cells::MARGIN;
use super::directions::{fibonacci, safe_voxel, spread};
use super::{MediumView, cell_size, dims_f32, dims_u32, twin};
use crate::error::Result;
use crate::kernels::constants::{TILE_COLUMN, TILE_ROW};
use crate::kernels::{gather, sweep as kernel};
use crate::scene::transfer::Table;
use crate::scene::{Grid, Volume, sh};
use crate::vk::{Buffer, Image, Recorder};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// One direction, as the kernel reads it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Ray {
    /// xyz: direction in voxel space, of world length 1; no component is 0.
    pub voxel: [f32; 4],
    /// xyz: the same in the world.
    pub world: [f32; 4],
}

/// `n` well-spread directions (spherical Fibonacci) in an order whose every beginning is well spread too.
pub fn rays(n: u32, grid: &Grid) -> Vec<Ray> {
    let to_voxel = grid.world_to_voxel().matrix3;
    let ray = |w: DVec3| Ray { voxel: safe_voxel(to_voxel * w), world: [w.x as f32, w.y as f32, w.z as f32, 0.0] };
    spread(&fibonacci(n)).into_iter().map(ray).collect()
}

/// What makes least squares of sums over a direction set: the inverse of the Gram matrix (4π/N)ΣY_i·Y_j of the `kept` first
/// harmonics, rows of 16, coefficients beyond them untouched. A beginning of a set is less even than the whole; with this
/// a visibility of four bands is recovered exactly from it. `None` where the set is too small to tell them apart.
pub fn correction(rays: &[Ray], kept: usize) -> Option<Vec<f32>> {
    // [Gram | identity], brought to [identity | inverse].
    let mut m = [[0f64; 32]; 16];
    for (i, row) in m.iter_mut().enumerate() {
        row[16 + i] = 1.0;
        row[i] = if i < kept { 0.0 } else { 1.0 };
    }
    for ray in rays {
        let y = sh::basis(DVec3::new(ray.world[0].into(), ray.world[1].into(), ray.world[2].into()));
        for i in 0..kept {
            for j in 0..kept {
                m[i][j] += 4.0 * std::f64::consts::PI / rays.len() as f64 * y[i] * y[j];
            }
        }
    }
    for k in 0..16 {
        let best = (k..16).max_by(|&a, &b| f64::total_cmp(&m[a][k].abs(), &m[b][k].abs()))?;
        m.swap(k, best);
        // Worse conditioned than this, it would amplify what lies between the directions.
        if m[k][k].abs() < 0.05 {
            return None;
        }
        let pivot = m[k];
        for (i, row) in m.iter_mut().enumerate() {
            let factor = if i == k { 1.0 - 1.0 / pivot[k] } else { row[k] / pivot[k] };
            for (a, p) in row.iter_mut().zip(pivot) {
                *a -= factor * p;
            }
        }
    }
    Some(m.iter().flat_map(|row| row[16..].iter().map(|v| *v as f32)).collect())
}

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

impl Group {
    /// The slice that is swept after `order` others, of `slices`.
    pub fn slice(&self, order: usize, slices: usize) -> usize {
        if self.rising { slices - 1 - order } else { order }
    }
}

impl Ray {
    /// Its harmonics.
    pub fn basis(&self) -> [f32; 16] {
        sh::basis(DVec3::new(self.world[0].into(), self.world[1].into(), self.world[2].into())).map(|y| y as f32)
    }
}

/// Sorts directions by major axis and sign, measured in cells, and says where each group stands.
pub fn groups(rays: &mut [Ray], cell_size: [f32; 3]) -> Vec<Group> {
    let key = |d: &Ray| -> (usize, bool) {
        let cells: [f32; 3] = std::array::from_fn(|a| (d.voxel[a] / cell_size[a]).abs());
        let axis = if cells[0] >= cells[1] && cells[0] >= cells[2] { 0 } else { 1 + usize::from(cells[2] > cells[1]) };
        (axis, d.voxel[axis] > 0.0)
    };
    rays.sort_by_key(key);
    let mut groups: Vec<Group> = Vec::new();
    for (i, d) in rays.iter().enumerate() {
        let (axis, rising) = key(d);
        match groups.last_mut() {
            Some(g) if (g.axis, g.rising) == (axis, rising) => g.count += 1,
            _ => groups.push(Group { axis, rising, first: i as u32, count: 1 }),
        }
    }
    groups
}

/// Axes that span a slice across `axis`: along a row, and from row to row.
pub fn plane(axis: usize) -> [usize; 2] {
    [usize::from(axis == 0), if axis == 2 { 1 } else { 2 }]
}

/// Cells of a slice across `axis`.
pub fn slice_cells(field_dims: [usize; 3], axis: usize) -> usize {
    plane(axis).iter().map(|&a| field_dims[a]).product()
}

/// What a sweep reads and writes.
pub struct Sweep<'a> {
    /// Cells of the field along x, y, z.
    pub field_dims: [usize; 3],
    /// Sorted table of [`Ray`].
    pub directions: &'a Buffer,
    /// (near + 1) slices × directions of a batch × cells of a slice, f32; read and written.
    pub transmittance: &'a Buffer,
    /// Which cells are wanted and which are clear of matter ([`super::cells::CellMap`]).
    pub cell_map: &'a Image,
    /// Tiles of all slices ([`super::cells::Tiles`]).
    pub tiles: &'a Buffer,
    /// Four rgba32f images of the wanted cells' slots; read and written.
    pub sums: [&'a Image; 4],
    /// SH bands to sum.
    pub bands: u32,
    /// Slices marched densely before the swept value.
    pub near: u32,
    /// Invocations that share a batch's directions, of the sweep and of the fit's points ([`crate::vk::Device::lanes`]).
    pub lanes: [u32; 2],
}

/// Cells of a row that an invocation sweeps, times those of a work group that stand beside it: of a tile.
pub const GROUP: u32 = (TILE_ROW * TILE_COLUMN / 4) as u32;

/// One slice of one batch.
#[derive(Clone, Copy, Debug)]
pub struct Slice {
    /// Major axis.
    pub axis: usize,
    /// Index of the slice along the axis.
    pub index: u32,
    /// How many slices of this batch were swept before: 0 is where the rays leave.
    pub order: u32,
    /// First tile, and tiles.
    pub tiles: [u32; 2],
    /// Whether these tiles are worked on, or transmittance is only carried through them.
    pub dense: bool,
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
            cell_map: sweep.cell_map.sampled().as_nearest(),
            tiles: sweep.tiles,
            sums0: sweep.sums[0].storage(0),
            sums1: sweep.sums[1].storage(0),
            sums2: sweep.sums[2].storage(0),
            sums3: sweep.sums[3].storage(0),
        },
        &kernel::Spec {
            bands: sweep.bands,
            // Carried tiles are at least two slices from matter: nothing is to be marched there.
            near: if slice.dense { sweep.near } else { sweep.near.min(u32::from(MARGIN)) },
            ring: sweep.near + 1,
            axis: slice.axis as u32,
            dense: slice.dense,
            clips: medium.clips,
            lanes: sweep.lanes[0],
        },
        &kernel::Params {
            cell_size: cell_size(medium.grid, sweep.field_dims),
            step_length: step_length as f32,
            volume_dims: dims_f32(medium.grid.dims()),
            map_scale: medium.map.0,
            field_dims: dims_u32(sweep.field_dims),
            map_bias: medium.map.1,
            slice: slice.index,
            ring_slot: slice.order % (sweep.near + 1),
            first_direction: slice.first_direction,
            direction_count: slice.direction_count,
            begin: u32::from(slice.begin),
            first_tile: slice.tiles[0],
        },
        // A workgroup takes a tile.
        [slice.tiles[1] * GROUP, 1, 1],
    )
}

/// Records the gathering of some cells' sums into the estimators' common buffer; `images` must be readable.
///
/// # Errors
/// What the recorder refuses.
pub fn record_gather(
    rec: &mut Recorder,
    run: &super::estimate::Run,
    cell_map: &Image,
    images: [&Image; 4],
    correction: Option<&Buffer>,
) -> Result<()> {
    rec.dispatch(
        &gather::Bindings {
            cells: run.cells,
            cell_map: cell_map.sampled().as_nearest(),
            sums0: images[0].sampled(),
            sums1: images[1].sampled(),
            sums2: images[2].sampled(),
            sums3: images[3].sampled(),
            correction: correction.unwrap_or(run.cells),
            sums: run.sums,
        },
        &gather::Spec { bands: run.bands, correct: correction.is_some() },
        &gather::Params { field_dims: dims_u32(run.field_dims), cell_count: run.cell_count, capacity: run.capacity },
        [run.cell_count, 1, 1],
    )
}

/// Settings of the twin: as in [`Sweep`], and the longest step in world units.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Slices marched densely.
    pub near: u32,
    /// Longest step, world units.
    pub step_length: f64,
}

/// The twin: coefficients of every cell, x fastest.
pub fn reference(volume: &Volume, table: &Table, field_dims: [usize; 3], rays: &[Ray], settings: Settings) -> Vec<[f32; 16]> {
    reference_clipped(volume, table, field_dims, rays, settings, &[])
}

/// The twin under clip planes.
pub fn reference_clipped(
    volume: &Volume,
    table: &Table,
    field_dims: [usize; 3],
    rays: &[Ray],
    settings: Settings,
    clip: &[[f32; 4]],
) -> Vec<[f32; 16]> {
    let mut out = vec![[0f32; 16]; field_dims.iter().product()];
    each_slice(volume, table, field_dims, rays, settings, clip, &mut |ray, group, swept| {
        let basis = ray.basis();
        let (a, [b, c]) = (group.axis, plane(group.axis));
        for (k, v) in swept.last().into_iter().flatten().enumerate() {
            let mut cell = [0; 3];
            (cell[a], cell[b], cell[c]) = (group.slice(swept.len() - 1, field_dims[a]), k % field_dims[b], k / field_dims[b]);
            let sums = &mut out[cell[0] + field_dims[0] * (cell[1] + field_dims[1] * cell[2])];
            for (s, y) in sums.iter_mut().zip(basis) {
                *s += v * y;
            }
        }
    });
    let weight = 4.0 * std::f32::consts::PI / rays.len() as f32;
    out.iter().map(|s| s.map(|s| s * weight)).collect()
}

/// What is given the slices of a direction swept so far, the one where the rays leave first.
type Visit<'a> = dyn FnMut(&Ray, &Group, &[Vec<f32>]) + 'a;

/// The twin's slices: `visit` is called after each.
pub fn each_slice(
    volume: &Volume,
    table: &Table,
    field_dims: [usize; 3],
    rays: &[Ray],
    settings: Settings,
    clip: &[[f32; 4]],
    visit: &mut Visit,
) {
    let size = cell_size(volume.grid(), field_dims);
    let mut set = rays.to_vec();
    for group in groups(&mut set, size) {
        let (a, [b, c]) = (group.axis, plane(group.axis));
        let [width, height] = [field_dims[b], field_dims[c]];
        for ray in &set[group.first as usize..(group.first + group.count) as usize] {
            let dir = [ray.voxel[0], ray.voxel[1], ray.voxel[2]];
            let reach = settings.near as f32 * size[a] / dir[a].abs();
            let mut swept: Vec<Vec<f32>> = Vec::new();
            for order in 0..field_dims[a] {
                let mut slice = vec![0f32; width * height];
                for (i, j) in (0..height).flat_map(|j| (0..width).map(move |i| (i, j))) {
                    let mut cell = [0; 3];
                    (cell[a], cell[b], cell[c]) = (group.slice(order, field_dims[a]), i, j);
                    let x: [f32; 3] = std::array::from_fn(|k| (cell[k] as f32 + 0.5) * size[k]);
                    let end = twin::exit_distance(x, dir, volume.grid().dims());
                    let depth = depth(volume, table, clip, (x, dir), reach.min(end), reach, settings.step_length);
                    let mut beyond = 1.0;
                    if reach < end {
                        let at = [dir[b] / size[b], dir[c] / size[c]].map(|d| d * reach);
                        beyond = read(&swept[order - settings.near as usize], [width, height], [i as f32 + at[0], j as f32 + at[1]]);
                    }
                    slice[i + width * j] = (-depth).exp() * beyond;
                }
                swept.push(slice);
                visit(ray, &group, &swept);
            }
        }
    }
}

/// Optical depth from x along d up to distance b, in even steps, as many as a way of `reach` takes.
pub(super) fn depth(
    volume: &Volume,
    table: &Table,
    clip: &[[f32; 4]],
    (x, d): ([f32; 3], [f32; 3]),
    b: f32,
    reach: f32,
    step_length: f64,
) -> f32 {
    let n = (reach / step_length as f32 - 1e-3).ceil().max(1.0);
    let (from, to) = twin::clip_span(clip, x, d, (0.0, b));
    let s = (to - from).max(0.0) / n;
    (0..n as u32).map(|k| s * twin::extinction(table, twin::sample(volume, twin::along(x, d, from + (k as f32 + 0.5) * s)))).sum()
}

/// T of a slice at a place counted in cells from the first's centre; beyond the last cell centre it rises to 1 at the wall,
/// half a cell off.
pub(super) fn read(slice: &[f32], [width, height]: [usize; 2], p: [f32; 2]) -> f32 {
    let value = twin::trilinear([width, height, 1], [p[0] + 0.5, p[1] + 0.5, 0.5], |q| slice[q[0] + width * q[1]]);
    let inside = |p: f32, n: usize| 1.0 - (2.0 * (-p).max(p - (n - 1) as f32)).clamp(0.0, 1.0);
    1.0 + (value - 1.0) * inside(p[0], width) * inside(p[1], height)
}
