//! The sweep: all cells at once, slice by slice, in batches of directions, in passes that refine.

use super::fit::Fit;
use super::{Engine, Medium, Pacer};
use crate::error::{Error, Result};
use crate::scene::{Grid, Visibility};
use crate::stages::cell_size;
use crate::stages::cells::{self, CellMap, Tiles};
use crate::stages::fit;
use crate::stages::pack::groups as coefficient_groups;
use crate::stages::sweep::{self, Group, Ray, Slice, Sweep};
use crate::vk::{Access, Buffer, Format, Image, ImageDesc};
use std::time::Instant;

/// Most bytes of swept transmittance that a batch of directions keeps: half of what one storage buffer may hold
/// everywhere.
const RING: u64 = 64 << 20;

/// Share of a fitted pass's time that its sweep takes, the points' sight included.
const SWEPT: f64 = 0.85;

/// Bytes of the ring per direction, for the largest slice: the least that a sweep can do with.
pub(super) fn ring_bytes(dims: [usize; 3], near: u32) -> u64 {
    (0..3).map(|a| sweep::slice_cells(dims, a) as u64).max().unwrap_or(1) * 4 * (u64::from(near) + 1)
}

/// Bytes of the ring that a sweep takes where memory is plenty.
pub(super) fn most_ring(grid: &Grid, settings: &Visibility, loop_limit: u32) -> Result<u64> {
    let dims = grid.field_dims(settings.ratio as usize);
    let mut rays = sweep::rays(settings.directions, grid);
    let groups = sweep::groups(&mut rays, cell_size(grid, dims));
    let batch = batch(grid, settings, &rays, &groups, (loop_limit, RING))?;
    Ok(ring_bytes(dims, settings.near) * u64::from(batch.min(groups.iter().map(|g| g.count).max().unwrap_or(1))))
}

/// Directions of a batch: as many as `ring` bytes hold and one dispatch may loop over; four cells march one after another.
fn batch(grid: &Grid, settings: &Visibility, rays: &[Ray], groups: &[Group], (loop_limit, ring): (u32, u64)) -> Result<u32> {
    let dims = grid.field_dims(settings.ratio as usize);
    let size = cell_size(grid, dims);
    let step_length = (f64::from(settings.step) * grid.voxel_length()) as f32;
    let taps = groups.iter().flat_map(|g| {
        let run = &rays[g.first as usize..(g.first + g.count) as usize];
        run.iter().map(|d| size[g.axis] / d.voxel[g.axis].abs() / step_length)
    });
    let taps = (taps.fold(0f32, f32::max).ceil() as u64).saturating_add(2);
    let loops = u64::from(loop_limit) / taps.saturating_mul(4 * u64::from(settings.near)).saturating_add(8);
    if loops == 0 {
        return Err(Error::Invalid {
            item: "visibility.step",
            what: format!("{} voxels make {taps} steps from slice to slice", settings.step),
            right: format!("this device runs at most {loop_limit} in one dispatch; take a longer step"),
        });
    }
    Ok((ring / ring_bytes(dims, settings.near)).min(loops).clamp(1, 1 << 16) as u32)
}

/// A run (first, count) in parts of at most `most`: what one dispatch takes.
fn parts([first, count]: [u32; 2], most: u32) -> impl Iterator<Item = [u32; 2]> {
    (0..count).step_by(most as usize).map(move |from| [first + from, most.min(count - from)])
}

/// A sweep under way: the sums of the directions swept so far.
pub(super) struct Sweeper<'a> {
    engine: &'a Engine,
    medium: &'a Medium,
    settings: &'a Visibility,
    dims: [usize; 3],
    step_length: f64,
    tiles: Tiles,
    tile_list: Buffer,
    ring: Option<Buffer>,
    /// Bytes that the ring may take.
    most_ring: u64,
    pacer: Pacer,
    /// Whether any cell is wanted.
    wanted: bool,
    /// Whether nothing was added yet.
    begin: bool,
    /// Which cells are wanted, and their slots.
    pub cell_map: Image,
    /// Sums of V·Y of the wanted cells; readable between passes.
    pub sums: [Image; 4],
    /// The points that the cells are fitted to, if they are.
    pub fit: Option<Fit>,
    /// Linear indices of the wanted cells, for the fit.
    wanted_cells: Vec<u32>,
    /// Directions swept so far.
    directions: u32,
}

impl<'a> Sweeper<'a> {
    pub fn new(engine: &'a Engine, medium: &'a Medium, settings: &'a Visibility, map: &CellMap, most_ring: u64) -> Result<Self> {
        let grid = medium.grid();
        let dims = grid.field_dims(settings.ratio as usize);
        let device = &engine.device;
        let cell_map = device.image3(&ImageDesc {
            name: "cell map",
            dims: dims.map(|n| n as u32),
            levels: 1,
            format: Format::R32Uint,
            views: &[],
            storage: false,
        })?;
        let area = dims[0] * dims[1];
        device.write_image(&cell_map, 0, &mut |z, bytes| {
            for (out, texel) in bytes.chunks_exact_mut(4).zip(&map.texels[z as usize * area..]) {
                out.copy_from_slice(&texel.to_ne_bytes());
            }
        })?;
        let kept = coefficient_groups(settings.bands);
        let image = |g: usize| {
            device.image3(&ImageDesc {
                name: ["sums 0", "sums 1", "sums 2", "sums 3"][g],
                // Coefficients beyond the bands are bound and never touched.
                dims: if g < kept { cells::slot_dims(map.wanted as u64) } else { [1; 3] },
                levels: 1,
                format: Format::Rgba32Sfloat,
                views: &[],
                storage: true,
            })
        };
        let sums = [image(0)?, image(1)?, image(2)?, image(3)?];
        let mut rec = device.record()?;
        // Fresh sums: the first batch stores without loading.
        rec.barrier(&sums.each_ref().map(|i| i.mip(0).from(Access::None).to(Access::ComputeRead)));
        rec.submit()?;
        let tiles = Tiles::new(dims, map);
        let tile_list = device.buffer_from("tiles", &tiles.list)?;
        let step_length = f64::from(settings.step) * grid.voxel_length();
        let pacer = Pacer::new(4, 1 << 16);
        let fit = Fit::new(engine, medium, settings, dims, map.wanted as u64)?;
        let wanted_cells = if fit.is_some() { map.cells() } else { Vec::new() };
        Ok(Self {
            engine,
            medium,
            settings,
            dims,
            step_length,
            tiles,
            tile_list,
            ring: None,
            most_ring,
            pacer,
            wanted: map.wanted > 0,
            begin: true,
            cell_map,
            sums,
            fit,
            wanted_cells,
            directions: 0,
        })
    }

    /// Adds directions to the sums. `tell` is given the fraction of the pass that is done.
    pub fn pass(&mut self, rays: &[Ray], tell: &mut dyn FnMut(f64) -> Result<()>) -> Result<()> {
        if !self.wanted {
            return tell(1.0);
        }
        let device = &self.engine.device;
        let (dims, near) = (self.dims, self.settings.near);
        let size = cell_size(self.medium.grid(), dims);
        let mut rays = rays.to_vec();
        let groups = sweep::groups(&mut rays, size);
        let directions = device.buffer_from("directions", &rays)?;

        let most = batch(self.medium.grid(), self.settings, &rays, &groups, (device.loop_limit(), self.most_ring))?;
        let batch = groups.iter().map(|g| g.count).max().unwrap_or(1).min(most);
        let ring_bytes = ring_bytes(dims, near) * u64::from(batch);
        // A ring that is too small goes before the larger one comes.
        let ring = match self.ring.take().filter(|ring| ring.len_bytes() >= ring_bytes) {
            Some(ring) => ring,
            None => {
                let ring = device.buffer::<f32>("transmittance", (ring_bytes / 4) as usize)?;
                let mut rec = device.record()?;
                // A batch's first slices load nothing from it.
                rec.barrier(&[ring.all().from(Access::None).to(Access::ComputeReadWrite)]);
                rec.submit()?;
                ring
            }
        };
        let job = Sweep {
            field_dims: dims,
            directions: &directions,
            transmittance: &ring,
            cell_map: &self.cell_map,
            tiles: &self.tile_list,
            sums: self.sums.each_ref(),
            bands: self.settings.bands,
            near,
            lanes: [device.lanes(sweep::GROUP), device.lanes(fit::GROUP)],
        };
        let mut rec = device.record()?;
        // What read the sums of the pass before is done.
        rec.barrier(&self.sums.each_ref().map(|i| i.mip(0).from(Access::ComputeRead).to(Access::ComputeReadWrite)));
        rec.submit()?;

        let batches: Vec<Group> = groups
            .iter()
            .flat_map(|g| {
                (0..g.count).step_by(most as usize).map(|from| Group { first: g.first + from, count: most.min(g.count - from), ..*g })
            })
            .collect();
        let work = |b: &Group, slices: u32| u64::from(slices) * u64::from(b.count) * sweep::slice_cells(dims, b.axis) as u64;
        let total: u64 = batches.iter().map(|b| work(b, dims[b.axis] as u32)).sum();
        let mut done = 0;
        // What is only carried needs no dispatch of its own where dispatches cost more than branches.
        let most_groups = device.max_groups();
        let most_boxes = (most_groups.saturating_mul(fit::GROUP) / self.settings.fit.max(1)).max(1);
        let whole = job.lanes[0] > 1 && near <= u32::from(cells::MARGIN);
        let share = if self.fit.is_some() { SWEPT } else { 1.0 };
        for b in batches {
            let slices = dims[b.axis] as u32;
            let mut order = 0;
            while order < slices {
                let count = self.pacer.size.min(slices - order);
                let start = Instant::now();
                let mut rec = device.record()?;
                for order in order..order + count {
                    let index = if b.rising { slices - 1 - order } else { order };
                    let runs = self.tiles.of(b.axis, index as usize, whole);
                    // A tile is a work group.
                    for (tiles, dense) in runs.flat_map(|(run, dense)| parts(run, most_groups).map(move |part| (part, dense))) {
                        let slice = Slice {
                            axis: b.axis,
                            index,
                            order,
                            tiles,
                            dense,
                            first_direction: b.first,
                            direction_count: b.count,
                            begin: self.begin,
                        };
                        sweep::record(&mut rec, &self.medium.view(), &job, slice, self.step_length)?;
                        // The next slice reads what this one swept, and another batch adds to the same sums.
                        rec.barrier(&[ring.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                        rec.barrier(&self.sums.each_ref().map(|i| i.mip(0).from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)));
                    }
                    let Some(points) = &self.fit else { continue };
                    for run in parts(points.run(b.axis, index as usize), most_boxes) {
                        let slice = Slice {
                            axis: b.axis,
                            index,
                            order,
                            tiles: [0; 2],
                            dense: true,
                            first_direction: b.first,
                            direction_count: b.count,
                            begin: self.begin,
                        };
                        let seen = points.seen();
                        fit::record_see(&mut rec, &self.medium.view(), &job, slice, b.rising, self.step_length, (&seen, run))?;
                        // Another batch adds to the same sums, and the next slice writes over what was read.
                        rec.barrier(&[seen.sums.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                        rec.barrier(&[ring.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                    }
                }
                rec.submit()?;
                self.pacer.took(count, start.elapsed().as_secs_f64());
                order += count;
                done += work(&b, count);
                tell(share * done as f64 / total as f64)?;
            }
            self.begin = false;
        }
        let mut rec = device.record()?;
        // The sums are read next.
        rec.barrier(&self.sums.each_ref().map(|i| i.mip(0).from(Access::ComputeReadWrite).to(Access::ComputeRead)));
        rec.submit()?;
        self.ring = Some(ring);
        self.directions += rays.len() as u32;
        if let Some(points) = &mut self.fit {
            let sums = self.sums.each_ref();
            let cells = (&self.wanted_cells[..], &self.cell_map);
            points.solve(self.engine, self.medium, dims, cells, (sums, self.directions), &mut || tell(share))?;
            tell(1.0)?;
        }
        Ok(())
    }

    /// What the swept cells are: fitted to what is read between them, or their own sums; readable.
    pub fn result(&self) -> [&Image; 4] {
        self.fit.as_ref().map_or(self.sums.each_ref(), |fit| fit.fitted.each_ref())
    }
}
