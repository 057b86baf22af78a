//! Visibility: from a medium to its packed field, tile by tile, in dispatches of bounded time.

use super::sweep::Sweeper;
use super::{Engine, Field, FieldData, Medium, Pacer, Progress};
use crate::error::{Error, Result};
use crate::scene::visibility::{Cells, Method, Sampling};
use crate::scene::{Grid, Visibility};
use crate::stages::cells::{self, CellMap};
use crate::stages::directions::{Direction, Directions, PATTERNS};
use crate::stages::estimate::Run;
use crate::stages::sweep::{self, Ray};
use crate::stages::{classify, hierarchical, march, minify, pack};
use crate::vk::{Access, Buffer, Format, Image, ImageDesc};
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

/// Bytes of device memory that `precompute` allocates, at most: (kept for the field, freed at the end).
pub fn precompute_memory(grid: &Grid, settings: &Visibility) -> (u64, u64) {
    let cells: u64 = grid.field_dims(settings.ratio as usize).iter().map(|&n| n as u64).product();
    memory(grid, settings, cells)
}

/// The same, where `wanted` cells are computed.
fn memory(grid: &Grid, settings: &Visibility, wanted: u64) -> (u64, u64) {
    let cells: u64 = grid.field_dims(settings.ratio as usize).iter().map(|&n| n as u64).product();
    let cell = pack::groups(settings.bands) as u64 * u64::from(pack::formats(settings.bands, settings.bits).0.bytes());
    let tile = cells.min(TILE as u64);
    let table = |size: usize| u64::from(settings.directions) * size as u64;
    let scratch = match settings.method {
        Method::March => table(size_of::<Direction>()),
        Method::Sweep => super::sweep::memory(grid, settings, wanted) + table(size_of::<Ray>()),
        Method::Hierarchical => {
            let dims = grid.dims().map(|n| n as u32);
            let level = |k| minify::level_dims(dims, k).iter().map(|&n| u64::from(n)).product::<u64>() * 2;
            (0..minify::levels(dims)).map(level).sum::<u64>() + table(size_of::<Direction>())
        }
    };
    let patterns = match settings.sampling {
        Sampling::Stratified => 0,
        Sampling::Jittered => u64::from(PATTERNS - 1) * table(size_of::<Direction>()),
    };
    (cells * cell, scratch + patterns + tile * 68)
}

/// What an estimator has prepared before cells are estimated.
enum Estimator<'a> {
    March,
    /// The opacity pyramid.
    Hierarchical(Image),
    /// The sums of the wanted cells, and what corrects those of a beginning of the set.
    Sweep(&'a Sweeper<'a>, Option<Buffer>),
}

/// A finished pass of [`Engine::refine`].
pub struct Pass<'a> {
    /// A valid estimate, which stays as it is while later passes are computed.
    pub field: &'a Field,
    /// Directions that it holds.
    pub directions: u32,
}

/// Progress of the method's stage; its refusal cancels.
fn telling<'a>(settings: &Visibility, progress: &'a mut Progress) -> impl FnMut(f64) -> Result<()> + 'a {
    let stage = match settings.method {
        Method::March => "march",
        Method::Hierarchical => "hierarchical",
        Method::Sweep => "sweep",
    };
    move |fraction| match progress(stage, fraction as f32) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(Error::Cancelled),
    }
}

impl Engine {
    /// Computes the visibility field.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a setting out of its range, [`Error::OutOfMemory`] before anything is allocated,
    /// [`Error::Cancelled`].
    pub fn precompute(&self, medium: &Medium, settings: &Visibility, progress: &mut Progress) -> Result<Field> {
        self.passes(medium, settings, &[settings.directions], progress, &mut |_| ControlFlow::Continue(()))
    }

    /// Computes the visibility field in passes, each of which adds as many directions as those before it: `finished` is
    /// given every pass's field and may stop there, which returns that field. Only a sweep refines; other methods make
    /// one pass.
    ///
    /// # Errors
    /// As [`Engine::precompute`].
    pub fn refine(
        &self,
        medium: &Medium,
        settings: &Visibility,
        progress: &mut Progress,
        finished: &mut dyn FnMut(&Pass) -> ControlFlow<()>,
    ) -> Result<Field> {
        let n = settings.directions;
        // Fewer than 32 directions do not tell 16 harmonics apart.
        let mut ends: Vec<u32> = (1..=3).rev().map(|k| n >> k).filter(|&n| settings.method == Method::Sweep && n >= 32).collect();
        ends.push(n);
        self.passes(medium, settings, &ends, progress, finished)
    }

    /// The field after each of the numbers of directions `ends`, the last of them all.
    fn passes(
        &self,
        medium: &Medium,
        settings: &Visibility,
        ends: &[u32],
        progress: &mut Progress,
        finished: &mut dyn FnMut(&Pass) -> ControlFlow<()>,
    ) -> Result<Field> {
        let map = self.cell_map(medium, settings, &[])?;
        let (kept, scratch) = memory(medium.grid(), settings, map.wanted as u64);
        // A pass's field may be kept while the next is made.
        let fields = ends.len().min(2) as u64;
        self.ask(&format!("the visibility field at 1:{}", settings.ratio), fields * kept + scratch, |free| {
            let fits = [2, 4, 8].into_iter().find(|&ratio| {
                let (a, b) = precompute_memory(medium.grid(), &Visibility { ratio, ..settings.clone() });
                ratio > settings.ratio && fields * a + b <= free
            });
            match fits {
                Some(ratio) => format!("1:{ratio} would fit"),
                None => "no coarser ratio would fit; resample the volume or allow more memory".into(),
            }
        })?;
        let wanted = map.cells(true);
        let mut tell = telling(settings, progress);
        tell(0.0)?;
        if settings.method != Method::Sweep {
            let estimator = match settings.method {
                Method::Hierarchical => Estimator::Hierarchical(self.pyramid(medium, settings)?),
                _ => Estimator::March,
            };
            let field = self.packed(medium, settings, &map, &wanted, &estimator, settings.directions, &mut tell)?;
            let _ = finished(&Pass { field: &field, directions: settings.directions });
            return Ok(field);
        }
        let rays = sweep::rays(settings.directions, medium.grid());
        let mut sweeper = Sweeper::new(self, medium, settings, &map)?;
        let mut from = 0;
        loop {
            let to = ends.iter().copied().find(|&n| n > from).unwrap_or(settings.directions);
            let part = |n: u32| f64::from(n) / f64::from(settings.directions);
            sweeper.pass(&rays[from as usize..to as usize], &mut |f| tell(part(from) + f * part(to - from)))?;
            let correction = match to < settings.directions {
                true => sweep::correction(&rays[..to as usize], settings.coefficients()),
                false => None,
            };
            let correction = correction.map(|c| self.device.buffer_from("correction", &c)).transpose()?;
            let estimator = Estimator::Sweep(&sweeper, correction);
            let field = self.packed(medium, settings, &map, &wanted, &estimator, to, &mut |_| Ok(()))?;
            if finished(&Pass { field: &field, directions: to }).is_break() || to == settings.directions {
                return Ok(field);
            }
            from = to;
        }
    }

    /// Linear indices of the cells that a field of these settings holds, ascending; the others are zero
    /// ([`Cells`]).
    ///
    /// # Errors
    /// [`Error::Invalid`] for a setting out of its range.
    pub fn wanted_cells(&self, medium: &Medium, settings: &Visibility) -> Result<Vec<u32>> {
        Ok(self.cell_map(medium, settings, &[])?.cells(true))
    }

    /// Which cells a field of these settings holds; `also` are wanted besides.
    fn cell_map(&self, medium: &Medium, settings: &Visibility, also: &[u32]) -> Result<CellMap> {
        settings.check()?;
        let dims = medium.grid().field_dims(settings.ratio as usize);
        let cells = dims.iter().map(|&n| n as u64).product::<u64>();
        if cells >= cells::MOST {
            return Err(Error::Invalid {
                item: "visibility.ratio",
                what: format!("1:{} makes {cells} cells", settings.ratio),
                right: format!("a field holds fewer than {}; take a coarser ratio", cells::MOST),
            });
        }
        let matter = cells::matter(medium.occupancy.filled(), medium.occupancy.dims(), medium.grid().dims(), dims);
        Ok(CellMap::new(dims, &matter, also, settings.cells == Cells::All))
    }

    /// A field of the estimator's cells; the others are zero.
    #[allow(clippy::too_many_arguments)]
    fn packed(
        &self,
        medium: &Medium,
        settings: &Visibility,
        map: &CellMap,
        wanted: &[u32],
        estimator: &Estimator,
        directions: u32,
        tell: &mut dyn FnMut(f64) -> Result<()>,
    ) -> Result<Field> {
        let dims = medium.grid().field_dims(settings.ratio as usize);
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
        let mut store = |run: &Run| {
            let mut rec = self.device.record()?;
            pack::record(&mut rec, run, settings.bits, field.images())?;
            // Tiles store disjoint cells; levels are tracked whole.
            rec.barrier(&field.images().map(|i| i.mip(0).from(Access::ComputeWrite).to(Access::ComputeWrite)));
            rec.submit()
        };
        self.blank(medium.grid(), settings, &map.cells(false), &mut store)?;
        self.estimate_tiles(medium, settings, (wanted, directions), estimator, tell, &mut store)?;
        let mut rec = self.device.record()?;
        // The finished field is only read from here on.
        rec.barrier(&field.images().map(|i| i.mip(0).from(Access::ComputeWrite).to(Access::ComputeRead)));
        rec.submit()?;
        Ok(field)
    }

    /// Hands tiles of cells with sums of zero to `store`.
    fn blank(&self, grid: &Grid, settings: &Visibility, cells: &[u32], store: &mut dyn FnMut(&Run) -> Result<()>) -> Result<()> {
        if cells.is_empty() {
            return Ok(());
        }
        let capacity = cells.len().min(TILE);
        let cell_buffer = self.device.buffer::<u32>("cells", capacity)?;
        let sums = self.device.buffer::<f32>("sums", 16 * capacity)?;
        let mut rec = self.device.record()?;
        rec.fill(&sums, 0)?;
        // Packing reads the zeros.
        rec.barrier(&[sums.all().from(Access::TransferWrite).to(Access::ComputeRead)]);
        rec.submit()?;
        for tile in cells.chunks(capacity) {
            self.device.write(&cell_buffer, tile)?;
            store(&Run {
                grid,
                field_dims: grid.field_dims(settings.ratio as usize),
                cells: &cell_buffer,
                cell_count: tile.len() as u32,
                capacity: capacity as u32,
                directions: &cell_buffer,
                sums: &sums,
                pattern_size: settings.directions,
                patterns: 1,
                bands: settings.bands,
                first_direction: 0,
                direction_count: 0,
            })?;
        }
        Ok(())
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
        let (_, scratch) = precompute_memory(medium.grid(), settings);
        self.ask("the estimate", scratch, |_| "take a coarser ratio, or allow more memory".into())?;
        let mut tell = telling(settings, progress);
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
        let all = (cells, settings.directions);
        match settings.method {
            Method::March => self.estimate_tiles(medium, settings, all, &Estimator::March, &mut tell, &mut keep)?,
            Method::Hierarchical => {
                let estimator = Estimator::Hierarchical(self.pyramid(medium, settings)?);
                self.estimate_tiles(medium, settings, all, &estimator, &mut tell, &mut keep)?;
            }
            Method::Sweep => {
                let map = self.cell_map(medium, settings, cells)?;
                let mut sweeper = Sweeper::new(self, medium, settings, &map)?;
                sweeper.pass(&sweep::rays(settings.directions, medium.grid()), &mut tell)?;
                self.estimate_tiles(medium, settings, all, &Estimator::Sweep(&sweeper, None), &mut |_| Ok(()), &mut keep)?;
            }
        }
        Ok(out)
    }

    /// Runs the estimator over `cells`, each with `directions`, tile by tile, and hands each tile's finished, readable sums
    /// to `finish`.
    fn estimate_tiles(
        &self,
        medium: &Medium,
        settings: &Visibility,
        (cells, directions): (&[u32], u32),
        estimator: &Estimator,
        tell: &mut dyn FnMut(f64) -> Result<()>,
        finish: &mut dyn FnMut(&Run) -> Result<()>,
    ) -> Result<()> {
        let grid = medium.grid();
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
        let n = directions;
        // A sweep has been through its directions already.
        let table = match estimator {
            Estimator::Sweep(..) => 1,
            _ => n,
        };
        let set = Directions::new(table, settings.sampling, grid);
        let directions = self.device.buffer_from("directions", &set.table)?;
        let capacity = cells.len().min(tile(steps));
        let cell_buffer = self.device.buffer::<u32>("cells", capacity)?;
        let sums = self.device.buffer::<f32>("sums", 16 * capacity)?;
        let mut rec = self.device.record()?;
        // Fresh sums: the first dispatch writes without reading, the later ones add.
        rec.barrier(&[sums.all().from(Access::None).to(Access::ComputeReadWrite)]);
        rec.submit()?;
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
                match estimator {
                    Estimator::March => march::record(&mut rec, &medium.view(), &run, step_length)?,
                    Estimator::Hierarchical(pyramid) => hierarchical::record(&mut rec, pyramid, &run, settings.growth)?,
                    Estimator::Sweep(swept, correction) => {
                        // All directions were swept for all cells: only collect them.
                        run.direction_count = n;
                        sweep::record_gather(&mut rec, &run, &swept.cell_map, swept.sums.each_ref(), correction.as_ref())?;
                    }
                }
                // The next run of directions adds to the same sums.
                rec.barrier(&[sums.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                rec.submit()?;
                pacer.took(run.direction_count, start.elapsed().as_secs_f64());
                run.first_direction += run.direction_count;
                tell((index as f64 + f64::from(run.first_direction) / f64::from(n)) / tiles as f64)?;
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
