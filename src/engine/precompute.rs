//! Visibility: from a medium to its packed field, tile by tile, in dispatches of bounded time.

use super::{Engine, Field, FieldData, Medium, Pacer, Progress};
use crate::error::{Error, Result};
use crate::scene::visibility::{Method, Sampling};
use crate::scene::{Grid, Visibility};
use crate::stages::directions::{Direction, Directions, PATTERNS};
use crate::stages::estimate::Run;
use crate::stages::{classify, hierarchical, march, minify, pack, sweep};
use crate::vk::{Access, Format, Image, ImageDesc};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

/// Cells that are estimated together at most; bounds the memory of the sums to 4 MiB.
const TILE: usize = 1 << 16;

/// Steps of all rays of one direction in a dispatch, at most: tens of milliseconds on a CPU device.
const TILE_STEPS: u64 = 1 << 23;

/// Cells that are estimated together when a ray takes `steps`.
fn tile(steps: u64) -> usize {
    (TILE_STEPS / steps.max(1)).clamp(64, TILE as u64) as usize
}

/// Bytes of device memory that `precompute` allocates: (kept for the field, freed at the end).
pub fn precompute_memory(grid: &Grid, settings: &Visibility) -> (u64, u64) {
    let cells: u64 = grid.field_dims(settings.ratio as usize).iter().map(|&n| n as u64).product();
    let cell = pack::groups(settings.bands) as u64 * u64::from(pack::formats(settings.bands, settings.bits).0.bytes());
    let tile = cells.min(TILE as u64);
    let pyramid = match settings.method {
        Method::March => 0,
        Method::Sweep => super::sweep::memory(grid, settings),
        Method::Hierarchical => {
            let dims = grid.dims().map(|n| n as u32);
            (0..minify::levels(dims)).map(|k| minify::level_dims(dims, k).iter().map(|&n| u64::from(n)).product::<u64>() * 2).sum()
        }
    };
    let patterns = match settings.sampling {
        Sampling::Stratified => 1,
        Sampling::Jittered => u64::from(PATTERNS),
    };
    let table = patterns * u64::from(settings.directions) * size_of::<Direction>() as u64;
    (cells * cell, pyramid + tile * 68 + table)
}

/// What an estimator has prepared before cells are estimated.
enum Estimator {
    March,
    /// The opacity pyramid.
    Hierarchical(Image),
    /// The sums of every cell.
    Sweep(super::sweep::Swept),
}

impl Engine {
    /// Computes the visibility field.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a setting out of its range, [`Error::OutOfMemory`] before anything is allocated,
    /// [`Error::Cancelled`].
    pub fn precompute(&self, medium: &Medium, settings: &Visibility, progress: &mut Progress) -> Result<Field> {
        settings.check()?;
        let (kept, scratch) = precompute_memory(medium.grid(), settings);
        self.ask(&format!("the visibility field at 1:{}", settings.ratio), kept + scratch, |free| {
            let fits = [2, 4, 8].into_iter().find(|&ratio| {
                let (a, b) = precompute_memory(medium.grid(), &Visibility { ratio, ..settings.clone() });
                ratio > settings.ratio && a + b <= free
            });
            match fits {
                Some(ratio) => format!("1:{ratio} would fit"),
                None => "no coarser ratio would fit; resample the volume or allow more memory".into(),
            }
        })?;
        let dims = medium.grid().field_dims(settings.ratio as usize);
        let cells = dims.iter().product::<usize>();
        if u32::try_from(cells).is_err() {
            return Err(Error::Invalid {
                item: "visibility.ratio",
                what: format!("1:{} makes {cells} cells", settings.ratio),
                right: format!("a field holds at most {}; take a coarser ratio", u32::MAX),
            });
        }
        let groups = pack::groups(settings.bands);
        let (store, sample) = pack::formats(settings.bands, settings.bits);
        let image = |g: usize| {
            self.device.image3(&ImageDesc {
                name: ["field 0", "field 1", "field 2", "field 3"][g],
                // A group that the bands leave empty is one texel, bound and never read.
                dims: if g < groups { dims.map(|n| n as u32) } else { [1; 3] },
                levels: 1,
                format: store,
                views: &[sample],
                storage: true,
            })
        };
        let images = [image(0)?, image(1)?, image(2)?, image(3)?];
        let field = Field(Arc::new(FieldData { dims, settings: settings.clone(), images }));

        let mut rec = self.device.record()?;
        // Fresh images take the layout for stores.
        rec.barrier(&field.images().map(|i| i.mip(0).from(Access::None).to(Access::ComputeWrite)));
        rec.submit()?;
        let all: Vec<u32> = (0..cells as u32).collect();
        let mut first = true;
        self.estimate_tiles(medium, settings, &all, progress, &mut |run| {
            let mut rec = self.device.record()?;
            if !first {
                // Tiles store disjoint cells; levels are tracked whole.
                rec.barrier(&field.images().map(|i| i.mip(0).from(Access::ComputeWrite).to(Access::ComputeWrite)));
            }
            first = false;
            pack::record(&mut rec, run, settings.bits, field.images())?;
            rec.submit()
        })?;
        let mut rec = self.device.record()?;
        // The finished field is only read from here on.
        rec.barrier(&field.images().map(|i| i.mip(0).from(Access::ComputeWrite).to(Access::ComputeRead)));
        rec.submit()?;
        Ok(field)
    }

    /// Coefficients of some cells of the field that `settings` describe (linear indices), before packing: what errors are
    /// measured with.
    ///
    /// # Errors
    /// As [`Engine::precompute`].
    pub fn estimate(&self, medium: &Medium, settings: &Visibility, cells: &[u32], progress: &mut Progress) -> Result<Vec<[f32; 16]>> {
        settings.check()?;
        let count: u64 = medium.grid().field_dims(settings.ratio as usize).iter().map(|&n| n as u64).product();
        if let Some(&cell) = cells.iter().find(|&&c| u64::from(c) >= count) {
            return Err(Error::Invalid {
                item: "field cell",
                what: format!("index {cell}"),
                right: format!("the field has {count} cells"),
            });
        }
        let mut out = Vec::with_capacity(cells.len());
        let weight = 4.0 * std::f32::consts::PI / settings.directions as f32;
        let kept = settings.coefficients();
        self.estimate_tiles(medium, settings, cells, progress, &mut |run| {
            let sums: Vec<f32> = self.device.read(run.sums, 16 * run.capacity as usize)?;
            for i in 0..run.cell_count as usize {
                out.push(std::array::from_fn(|c| if c < kept { weight * sums[c * run.capacity as usize + i] } else { 0.0 }));
            }
            Ok(())
        })?;
        Ok(out)
    }

    /// Runs the estimator over `cells` tile by tile and hands each tile's finished, readable sums to `finish`.
    fn estimate_tiles(
        &self,
        medium: &Medium,
        settings: &Visibility,
        cells: &[u32],
        progress: &mut Progress,
        finish: &mut dyn FnMut(&Run) -> Result<()>,
    ) -> Result<()> {
        let grid = medium.grid();
        let stage = match settings.method {
            Method::March => "march",
            Method::Hierarchical => "hierarchical",
            Method::Sweep => "sweep",
        };
        let mut tell = |fraction: f64| match progress(stage, fraction as f32) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Error::Cancelled),
        };
        tell(0.0)?;
        if cells.is_empty() {
            return Ok(());
        }
        let step_length = f64::from(settings.step) * grid.voxel_length();
        let steps = match settings.method {
            Method::March => march::max_steps(grid.diagonal(), step_length),
            Method::Hierarchical => hierarchical::max_steps(grid.diagonal() / grid.voxel_length(), f64::from(settings.growth)),
            Method::Sweep => 1,
        };
        let most = u64::from(self.device.loop_limit()) / (steps + 2);
        if most == 0 {
            return Err(Error::Invalid {
                item: "visibility.step",
                what: format!("{} voxels make {steps} steps of the longest ray", settings.step),
                right: format!("this device runs at most {} in one dispatch; take a longer step", self.device.loop_limit()),
            });
        }
        let estimator = match settings.method {
            Method::March => Estimator::March,
            Method::Hierarchical => Estimator::Hierarchical(self.pyramid(medium, settings)?),
            Method::Sweep => Estimator::Sweep(self.sweep(medium, settings, &mut tell)?),
        };
        let set = Directions::new(settings.directions, settings.sampling, grid);
        let directions = self.device.buffer_from("directions", &set.table)?;
        let capacity = cells.len().min(tile(steps));
        let cell_buffer = self.device.buffer::<u32>("cells", capacity)?;
        let sums = self.device.buffer::<f32>("sums", 16 * capacity)?;
        let mut rec = self.device.record()?;
        // Fresh sums: the first dispatch writes without reading, the later ones add.
        rec.barrier(&[sums.all().from(Access::None).to(Access::ComputeReadWrite)]);
        rec.submit()?;
        let n = settings.directions;
        let mut pacer = Pacer::new(1, most.min(u64::from(n)) as u32);
        let tiles = cells.len().div_ceil(capacity);
        for (index, tile) in cells.chunks(capacity).enumerate() {
            self.device.write(&cell_buffer, tile)?;
            let mut run = Run {
                grid,
                field_dims: grid.field_dims(settings.ratio as usize),
                cells: &cell_buffer,
                cell_count: tile.len() as u32,
                capacity: capacity as u32,
                directions: &directions,
                sums: &sums,
                pattern_size: n,
                patterns: set.patterns,
                bands: settings.bands,
                first_direction: 0,
                direction_count: 0,
            };
            while run.first_direction < n {
                run.direction_count = pacer.size.min(n - run.first_direction);
                let start = Instant::now();
                let mut rec = self.device.record()?;
                match &estimator {
                    Estimator::March => march::record(&mut rec, &medium.view(), &run, step_length)?,
                    Estimator::Hierarchical(pyramid) => hierarchical::record(&mut rec, pyramid, &run, settings.growth)?,
                    Estimator::Sweep(swept) => {
                        // All directions were swept for all cells: only collect them.
                        run.direction_count = n;
                        sweep::record_gather(&mut rec, &run, &swept.cell_map, swept.sums.each_ref())?;
                    }
                }
                // The next run of directions adds to the same sums.
                rec.barrier(&[sums.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                rec.submit()?;
                pacer.took(run.direction_count, start.elapsed().as_secs_f64());
                run.first_direction += run.direction_count;
                if !matches!(estimator, Estimator::Sweep(_)) {
                    tell((index as f64 + f64::from(run.first_direction) / f64::from(n)) / tiles as f64)?;
                }
            }
            let mut rec = self.device.record()?;
            // Whoever finishes the tile reads the sums.
            rec.barrier(&[sums.all().from(Access::ComputeReadWrite).to(Access::ComputeRead)]);
            rec.submit()?;
            finish(&run)?;
            let mut rec = self.device.record()?;
            // The next tile writes over them.
            rec.barrier(&[sums.all().from(Access::ComputeRead).to(Access::ComputeReadWrite)]);
            rec.submit()?;
        }
        Ok(())
    }

    /// The opacity pyramid of a medium, readable.
    fn pyramid(&self, medium: &Medium, settings: &Visibility) -> Result<Image> {
        let dims = medium.grid().dims().map(|n| n as u32);
        let levels = minify::levels(dims);
        let pyramid =
            self.device.image3(&ImageDesc { name: "opacity", dims, levels, format: Format::R16Sfloat, views: &[], storage: true })?;
        let mut rec = self.device.record()?;
        classify::record(&mut rec, &medium.view(), &pyramid)?;
        minify::record(&mut rec, &pyramid, settings.filter)?;
        rec.submit()?;
        Ok(pyramid)
    }

    /// The levels of the opacity pyramid, finest first, x fastest: for tests and charts.
    ///
    /// # Errors
    /// As [`Engine::precompute`].
    pub fn read_pyramid(&self, medium: &Medium, settings: &Visibility) -> Result<Vec<Vec<f32>>> {
        let pyramid = self.pyramid(medium, settings)?;
        (0..pyramid.levels())
            .map(|k| {
                let bytes = self.device.read_image(&pyramid, k)?;
                Ok(bytes.chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32()).collect())
            })
            .collect()
    }
}
