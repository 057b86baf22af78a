//! Estimates of visibility: tile by tile, in dispatches of bounded time.

use super::budget::Cost;
use super::precompute::{PYRAMID, stage};
use super::sweep::Sweeper;
use super::{Engine, Medium, Pacer, Progress, in_parts, telling};
use crate::error::{Error, Result};
use crate::scene::visibility::Method;
use crate::scene::{Grid, Visibility};
use crate::stages::cells::CellMap;
use crate::stages::directions::Directions;
use crate::stages::estimate::Run;
use crate::stages::sweep;
use crate::stages::{classify, hierarchical, march, minify};
use crate::vk::{Access, Buffer, Format, Image, ImageDesc};
use std::time::Instant;

/// Cells that are estimated together at most; bounds the memory of the sums to 4 MiB.
pub(super) const TILE: usize = 1 << 16;

/// Steps of all rays of one direction in a dispatch, at most: tens of milliseconds on a CPU device.
const TILE_STEPS: u64 = 1 << 23;

/// Steps of the longest ray that an estimator marches, for bounding dispatches.
fn steps(grid: &Grid, settings: &Visibility) -> u64 {
    match settings.method {
        Method::March => march::max_steps(grid.diagonal(), f64::from(settings.step) * grid.voxel_length()),
        Method::Hierarchical => hierarchical::max_steps(grid.diagonal() / grid.voxel_length(), f64::from(settings.growth)),
        Method::Sweep => 1,
    }
}

/// Cells that are estimated together, at most.
pub(super) fn tile(grid: &Grid, settings: &Visibility) -> usize {
    (TILE_STEPS / steps(grid, settings).max(1)).clamp(64, TILE as u64) as usize
}

/// What an estimator is to do.
pub(super) struct Work<'a> {
    /// Linear indices of cells.
    pub cells: &'a [u32],
    /// Directions of each.
    pub directions: u32,
    /// Cells that are estimated together.
    pub tile: usize,
}

/// What an estimator has prepared before cells are estimated.
pub(super) enum Estimator<'a> {
    March,
    /// The opacity pyramid.
    Hierarchical(Image),
    /// The sums of the wanted cells, and what corrects those of a beginning of the set.
    Sweep(&'a Sweeper<'a>, Option<Buffer>),
}

impl Engine {
    /// Coefficients of some cells of the field that `settings` describe (linear indices), before packing: what errors are
    /// measured with. Zero where a cell is centred inside an opaque surface, by every method.
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
        let buried = self.buried(medium, medium.grid().field_dims(settings.ratio as usize))?;
        let sees = |&cell: &u32| !buried.get(cell as usize).is_some_and(|b| *b);
        if !cells.iter().all(sees) {
            let some: Vec<u32> = cells.iter().copied().filter(sees).collect();
            let mut found = self.estimate(medium, settings, &some, progress)?.into_iter();
            return Ok(cells.iter().map(|cell| if sees(cell) { found.next().unwrap_or_default() } else { [0.0; 16] }).collect());
        }
        let map = match settings.method {
            Method::Sweep => self.cell_map(medium, settings, cells)?,
            _ => CellMap { texels: Vec::new(), wanted: cells.len(), matter: 0 },
        };
        let cost = Cost { kept: 0, ..self.cost(medium.grid(), settings, &map)? };
        let share = self.admitted("the estimate", 0, &cost, |_| "take a coarser ratio, or allow more memory".into())?;
        let mut tell = telling(stage(settings), progress);
        tell(0.0)?;
        let mut out = Vec::with_capacity(cells.len());
        if cells.is_empty() {
            return Ok(out);
        }
        let weight = 4.0 * std::f32::consts::PI / settings.directions as f32;
        let kept = settings.coefficients();
        let mut keep = |run: &Run| {
            let sums: Vec<f32> = self.device.read(run.sums, 16 * run.capacity as usize)?;
            for i in 0..run.cell_count as usize {
                out.push(std::array::from_fn(|c| if c < kept { weight * sums[c * run.capacity as usize + i] } else { 0.0 }));
            }
            Ok(())
        };
        let all = &Work { cells, directions: settings.directions, tile: share.tile };
        match settings.method {
            Method::March => self.estimate_tiles(medium, settings, all, &Estimator::March, &mut tell, &mut keep)?,
            Method::Hierarchical => {
                let estimator = Estimator::Hierarchical(self.pyramid(medium, settings, &mut |f| tell(PYRAMID * f))?);
                let mut tell = |f| tell(PYRAMID + (1.0 - PYRAMID) * f);
                self.estimate_tiles(medium, settings, all, &estimator, &mut tell, &mut keep)?;
            }
            Method::Sweep => {
                let mut sweeper = Sweeper::new(self, medium, settings, &map, share.ring)?;
                sweeper.pass(&sweep::rays(settings.directions, medium.grid()), &mut tell)?;
                self.estimate_tiles(medium, settings, all, &Estimator::Sweep(&sweeper, None), &mut |_| tell(1.0), &mut keep)?;
            }
        }
        Ok(out)
    }

    /// Runs the estimator over `cells`, each with `directions`, tile by tile, and hands each tile's finished, readable sums
    /// to `finish`.
    pub(super) fn estimate_tiles(
        &self,
        medium: &Medium,
        settings: &Visibility,
        &Work { cells, directions, tile }: &Work,
        estimator: &Estimator,
        tell: &mut dyn FnMut(f64) -> Result<()>,
        finish: &mut dyn FnMut(&Run) -> Result<()>,
    ) -> Result<()> {
        let grid = medium.grid();
        if cells.is_empty() {
            return Ok(());
        }
        let step_length = f64::from(settings.step) * grid.voxel_length();
        let steps = steps(grid, settings);
        let most = u64::from(self.device.loop_limit()) / steps.saturating_add(2);
        if most == 0 {
            return Err(Error::Invalid {
                item: "visibility.step",
                what: format!("{} voxels make {steps} steps of the longest ray", settings.step),
                right: format!("this device runs at most {} in one dispatch; take a longer step", self.device.loop_limit()),
            });
        }
        let n = directions;
        // A sweep has been through its directions already.
        let table = match estimator {
            Estimator::Sweep(..) => 1,
            _ => n,
        };
        let set = Directions::new(table, settings.sampling, grid);
        let directions = self.device.buffer_from("directions", &set.table)?;
        let capacity = cells.len().min(tile.min(self::tile(grid, settings)).max(1));
        let cell_buffer = self.device.buffer::<u32>("cells", capacity)?;
        let sums = self.device.buffer::<f32>("sums", 16 * capacity)?;
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
                if run.first_direction == 0 {
                    // Fresh sums, or those of a tile that is finished: the first dispatch writes without reading, later ones add.
                    rec.barrier(&[sums.all().from(sums.last_access()).to(Access::ComputeReadWrite)]);
                }
                match estimator {
                    Estimator::March => march::record(&mut rec, &medium.view(), &run, step_length)?,
                    Estimator::Hierarchical(pyramid) => hierarchical::record(&mut rec, pyramid, &run, settings.growth)?,
                    Estimator::Sweep(swept, correction) => {
                        // All directions were swept for all cells: only collect them.
                        run.direction_count = n;
                        sweep::record_gather(&mut rec, &run, &swept.cell_map, swept.result(), correction.as_ref())?;
                    }
                }
                // The next run of directions adds to the same sums; after the last, whoever finishes the tile reads them.
                let last = run.first_direction + run.direction_count == n;
                rec.barrier(&[sums.all().from(Access::ComputeReadWrite).to(if last {
                    Access::ComputeRead
                } else {
                    Access::ComputeReadWrite
                })]);
                rec.submit()?;
                pacer.took(run.direction_count, start.elapsed().as_secs_f64());
                run.first_direction += run.direction_count;
                tell((index as f64 + f64::from(run.first_direction) / f64::from(n)) / tiles as f64)?;
            }
            finish(&run)?;
        }
        Ok(())
    }

    /// The opacity pyramid of a medium, readable.
    pub(super) fn pyramid(&self, medium: &Medium, settings: &Visibility, tell: &mut dyn FnMut(f64) -> Result<()>) -> Result<Image> {
        let dims = medium.grid().dims().map(|n| n as u32);
        let levels = minify::levels(dims);
        let pyramid =
            self.device.image3(&ImageDesc { name: "opacity", dims, levels, format: Format::R16Sfloat, views: &[], storage: true })?;
        let mut rec = self.device.record()?;
        // Level 0 is seven eighths of the work.
        classify::record(&mut rec, &medium.view(), &pyramid, &mut in_parts(&mut |f| tell(0.875 * f)))?;
        minify::record(&mut rec, &pyramid, settings.filter, &mut in_parts(&mut |f| tell(0.875 + 0.125 * f)))?;
        rec.submit()?;
        Ok(pyramid)
    }

    /// The levels of the opacity pyramid, finest first, x fastest: for tests and charts.
    ///
    /// # Errors
    /// As [`Engine::precompute`].
    pub fn read_pyramid(&self, medium: &Medium, settings: &Visibility) -> Result<Vec<Vec<f32>>> {
        let pyramid = self.pyramid(medium, settings, &mut |_| Ok(()))?;
        (0..pyramid.levels())
            .map(|k| {
                let bytes = self.device.read_image(&pyramid, k)?;
                Ok(bytes.chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32()).collect())
            })
            .collect()
    }
}
