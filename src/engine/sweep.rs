//! The sweep: all cells at once, slice by slice, in batches of directions.

use super::{Engine, Medium, Pacer};
use crate::error::Result;
use crate::scene::{Grid, Visibility};
use crate::stages::cell_size;
use crate::stages::cells::{self, CellMap};
use crate::stages::pack::groups as coefficient_groups;
use crate::stages::sweep::{self, Group, Slice, Sweep};
use crate::vk::{Access, Format, Image, ImageDesc};
use std::time::Instant;

/// Most bytes of swept transmittance that a batch of directions keeps: half of what one storage buffer may hold
/// everywhere.
const RING: u64 = 64 << 20;

/// Bytes of the sums and of the swept transmittance.
pub fn memory(grid: &Grid, settings: &Visibility) -> u64 {
    let dims = grid.field_dims(settings.ratio as usize);
    let cells: u64 = dims.iter().map(|&n| n as u64).product();
    cells * 4 + cells::slot_dims(cells as usize).iter().map(|&n| u64::from(n)).product::<u64>() * 16 * coefficient_groups(settings.bands) as u64 + RING.min(ring_bytes(dims, settings.near) * u64::from(settings.directions))
}

/// Bytes of the ring per direction, for the largest slice.
fn ring_bytes(dims: [usize; 3], near: u32) -> u64 {
    (0..3).map(|a| sweep::slice_cells(dims, a) as u64).max().unwrap_or(1) * 4 * (u64::from(near) + 1)
}

/// The sums of a sweep, readable, and where each cell's stand.
pub(super) struct Swept {
    pub cell_map: Image,
    pub sums: [Image; 4],
}

/// Difference of neighbouring T that is interpolated.
const SMOOTHNESS: f32 = 0.1;

impl Engine {
    /// Sums of V·Y of every cell, one image per four coefficients, readable. `tell` is given the fraction done.
    pub(super) fn sweep(&self, medium: &Medium, settings: &Visibility, tell: &mut dyn FnMut(f64) -> Result<()>) -> Result<Swept> {
        let grid = medium.grid();
        let dims = grid.field_dims(settings.ratio as usize);
        let size = cell_size(grid, dims);
        let step_length = f64::from(settings.step) * grid.voxel_length();
        let mut rays = sweep::rays(settings.directions, grid);
        let groups = sweep::groups(&mut rays, size);
        let directions = self.device.buffer_from("directions", &rays)?;
        let map = CellMap::everywhere(dims);
        let cell_map = self.device.image3(&ImageDesc {
            name: "cell map",
            dims: dims.map(|n| n as u32),
            levels: 1,
            format: Format::R32Uint,
            views: &[],
            storage: false,
        })?;
        let area = dims[0] * dims[1];
        self.device.write_image(&cell_map, 0, &mut |z, bytes| {
            let first = z as usize * area;
            bytes.copy_from_slice(bytemuck::cast_slice(&map.texels[first..first + bytes.len() / 4]));
        })?;

        let kept = coefficient_groups(settings.bands);
        let image = |g: usize| {
            self.device.image3(&ImageDesc {
                name: ["sums 0", "sums 1", "sums 2", "sums 3"][g],
                // Coefficients beyond the bands are bound and never touched.
                dims: if g < kept { cells::slot_dims(map.wanted) } else { [1; 3] },
                levels: 1,
                format: Format::Rgba32Sfloat,
                views: &[],
                storage: true,
            })
        };
        let sums = [image(0)?, image(1)?, image(2)?, image(3)?];

        // Directions of a batch: as many as the ring holds and one dispatch may loop over.
        let taps = (0..3).map(|a| size[a]).fold(0f32, f32::max) * 2.0 / settings.step + 2.0;
        let loops = u64::from(self.device.loop_limit()) / (taps.ceil() as u64 * u64::from(settings.near) + 8);
        let most = (RING / ring_bytes(dims, settings.near)).min(loops).clamp(1, 1 << 16) as u32;
        let batch = groups.iter().map(|g| g.count).max().unwrap_or(1).min(most);
        let ring = self.device.buffer::<f32>("transmittance", (ring_bytes(dims, settings.near) / 4 * u64::from(batch)) as usize)?;
        let job = Sweep {
            field_dims: dims,
            directions: &directions,
            transmittance: &ring,
            cell_map: &cell_map,
            sums: sums.each_ref(),
            bands: settings.bands,
            near: settings.near,
            smoothness: SMOOTHNESS,
        };

        let mut rec = self.device.record()?;
        // Fresh sums and ring: the first batch stores without loading, a batch's first slices load nothing.
        rec.barrier(&sums.each_ref().map(|i| i.mip(0).from(Access::None).to(Access::ComputeReadWrite)));
        rec.barrier(&[ring.all().from(Access::None).to(Access::ComputeReadWrite)]);
        rec.submit()?;

        let batches: Vec<Group> = groups
            .iter()
            .flat_map(|g| {
                (0..g.count).step_by(most as usize).map(|from| Group { first: g.first + from, count: most.min(g.count - from), ..*g })
            })
            .collect();
        let total: u64 = batches.iter().map(|b| u64::from(b.count) * dims[b.axis] as u64 * sweep::slice_cells(dims, b.axis) as u64).sum();
        let mut done = 0;
        let mut begin = true;
        let mut pacer = Pacer::new(4, 1 << 16);
        for b in batches {
            let slices = dims[b.axis] as u32;
            let mut order = 0;
            while order < slices {
                let count = pacer.size.min(slices - order);
                let start = Instant::now();
                let mut rec = self.device.record()?;
                for order in order..order + count {
                    let index = if b.rising { slices - 1 - order } else { order };
                    let slice = Slice { axis: b.axis, index, order, first_direction: b.first, direction_count: b.count, begin };
                    sweep::record(&mut rec, &medium.view(), &job, slice, step_length)?;
                    // The next slice reads what this one swept, and another batch adds to the same sums.
                    rec.barrier(&[ring.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                    rec.barrier(&sums.each_ref().map(|i| i.mip(0).from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)));
                }
                rec.submit()?;
                pacer.took(count, start.elapsed().as_secs_f64());
                order += count;
                done += u64::from(count) * u64::from(b.count) * sweep::slice_cells(dims, b.axis) as u64;
                tell(done as f64 / total as f64)?;
            }
            begin = false;
        }
        let mut rec = self.device.record()?;
        // The finished sums are only read from here on.
        rec.barrier(&sums.each_ref().map(|i| i.mip(0).from(Access::ComputeReadWrite).to(Access::ComputeRead)));
        rec.submit()?;
        Ok(Swept { cell_map, sums })
    }
}
