//! Memory, said beforehand: what a scene needs on the device, and what would fit where that is too much.

use super::{Engine, Medium, estimate, fit, sweep};
use crate::error::{self, Error, Result};
use crate::scene::visibility::{Method, Sampling};
use crate::scene::{Grid, Samples, Visibility, Volume};
use crate::stages::bricks::{self, Bricks};
use crate::stages::cells::{self, CellMap, Tiles};
use crate::stages::directions::{Direction, PATTERNS};
use crate::stages::sweep::Ray;
use crate::stages::{minify, pack, relight};
use crate::vk::{Device, Format, ImageDesc};

/// Bytes that small buffers and alignment add to the sum of the large parts.
pub(super) const SLACK: u64 = 64 << 10;

/// Bytes of a cell while it is estimated: its index and 16 sums.
const SUMS: u64 = 68;

/// Cells that are always estimated together, where there are as many.
const LEAST_TILE: u64 = 1024;

/// Device memory of a scene, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Need {
    /// What the volume and its matter take already.
    pub volume: u64,
    /// The packed field.
    pub field: u64,
    /// While the field is computed, freed afterwards: as much as it would take now.
    pub scratch: u64,
    /// The least of that which it can do with, more slowly.
    pub least_scratch: u64,
    /// Irradiance and pixels in flight, once the field stands.
    pub picture: u64,
}

impl Need {
    /// The most that is held at one time.
    pub fn peak(&self) -> u64 {
        self.volume + self.field + self.scratch.max(self.picture)
    }

    /// Without what the volume takes already: the least that must be free.
    pub fn least(&self) -> u64 {
        self.field + self.least_scratch.max(self.picture)
    }
}

/// Bytes of an image of `dims` texels, rows as lavapipe pads them: for what is said without a device.
fn image_bytes(dims: [u32; 3], texel: u64) -> u64 {
    let [x, y, z] = dims.map(u64::from);
    (x * texel).next_multiple_of(64) * y.next_multiple_of(4) * z
}

/// What images take: by the formula, or with this device's padding, which may be much where images are small.
#[derive(Clone, Copy)]
pub(super) struct Padding<'a>(Option<&'a Device>);

impl Padding<'_> {
    /// Bytes of an image of `dims` texels with levels.
    fn levels(self, dims: [u32; 3], levels: u32, texel: u64) -> u64 {
        // Devices pad by the size of a texel, whatever its format.
        let format = match texel {
            2 => Format::R16Sfloat,
            4 => Format::R32Uint,
            8 => Format::Rgba16Sfloat,
            16 => Format::Rgba32Sfloat,
            _ => Format::R8Uint,
        };
        let desc = ImageDesc { name: "planned", dims, levels, format, views: &[], storage: true };
        let formula = || (0..levels).map(|k| image_bytes(minify::level_dims(dims, k), texel)).sum();
        self.0.and_then(|device| device.image3_bytes(&desc)).unwrap_or_else(formula)
    }

    /// Bytes of an image of `dims` texels.
    pub fn image(self, dims: [u32; 3], texel: u64) -> u64 {
        self.levels(dims, 1, texel)
    }
}

/// Bytes of a voxel in a volume's image: integers take 16 bits, floats 32 (see `stages::Encoding`).
pub(super) fn voxel_bytes(volume: &Volume) -> u64 {
    if matches!(volume.samples(), Samples::F32(_)) { 4 } else { 2 }
}

/// Device memory of a field and its making.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cost {
    /// The field.
    pub kept: u64,
    /// What is freed at the end and cannot be less.
    pub fixed: u64,
    /// Swept transmittance: the least, and what it takes where memory is plenty.
    pub ring: [u64; 2],
    /// Cells that are estimated together.
    pub tile: [u64; 2],
}

/// What a job may take of what is free.
pub(super) struct Share {
    /// Bytes of swept transmittance.
    pub ring: u64,
    /// Cells that are estimated together.
    pub tile: usize,
}

impl Cost {
    /// Of a field of `held` bricks, in which `wanted` cells are computed and `matter` cells hold matter.
    fn new(grid: &Grid, settings: &Visibility, held: u64, (wanted, matter): (u64, u64), loop_limit: u32, padding: Padding) -> Result<Self> {
        let image_bytes = |dims, texel| padding.image(dims, texel);
        let dims = grid.field_dims(settings.ratio as usize);
        let texel = u64::from(pack::formats(settings.bands, settings.bits).0.bytes());
        let groups = pack::groups(settings.bands) as u64;
        let directory = image_bytes(bricks::directory_dims(dims).map(|n| n as u32), 4);
        let kept = groups * image_bytes(bricks::image_dims(dims, held, texel), texel) + directory;
        let patterns = if settings.sampling == Sampling::Jittered { u64::from(PATTERNS) } else { 1 };
        let table = |entry: usize| u64::from(settings.directions) * patterns * entry as u64;
        let (mut fixed, mut ring) = (SLACK, [0; 2]);
        match settings.method {
            Method::March => fixed += table(size_of::<Direction>()),
            Method::Hierarchical => {
                let dims = grid.dims().map(|n| n as u32);
                fixed += padding.levels(dims, minify::levels(dims), 2);
                fixed += table(size_of::<Direction>());
            }
            Method::Sweep => {
                let sums = groups * image_bytes(cells::slot_dims(wanted), 16);
                fixed += sums + image_bytes(dims.map(|n| n as u32), 4);
                fixed += Tiles::bytes(dims) + table(size_of::<Ray>());
                fixed += fit::bytes(settings, (matter, wanted, dims.iter().map(|&n| n as u64).product()), sums);
                if wanted > 0 {
                    ring = [sweep::ring_bytes(dims, settings.near), sweep::most_ring(grid, settings, loop_limit)?];
                }
            }
        }
        // Cells of bricks that nobody wants are filled as tiles, too.
        let spare = (held * 64).saturating_sub(wanted);
        let most = wanted.min(estimate::tile(grid, settings) as u64).max(spare.min(estimate::TILE as u64)).max(1);
        Ok(Self { kept, fixed, ring, tile: [most.min(LEAST_TILE), most] })
    }

    /// The least scratch.
    pub fn least(&self) -> u64 {
        self.fixed + self.ring[0] + self.tile[0] * SUMS
    }

    /// What to take where `room` bytes are free for scratch: all that it is faster with, or as much as fits, the ring first.
    pub fn share(&self, room: u64) -> Share {
        let left = room.saturating_sub(self.least());
        let ring = self.ring[0] + left.min(self.ring[1].saturating_sub(self.ring[0]));
        let left = left - (ring - self.ring[0]);
        Share { ring, tile: (self.tile[0] + (left / SUMS).min(self.tile[1] - self.tile[0])) as usize }
    }

    /// Scratch of a share.
    fn scratch(&self, share: &Share) -> u64 {
        self.fixed + share.ring + share.tile as u64 * SUMS
    }
}

/// Bytes of device memory that computing a field takes at most, whatever the matter: (kept for the field, freed at the
/// end). [`Engine::precompute_memory`] knows the medium and says less; it also knows the device, of which some pad images by
/// more than is counted here.
pub fn precompute_memory(grid: &Grid, settings: &Visibility) -> (u64, u64) {
    let dims = grid.field_dims(settings.ratio as usize);
    let cells = dims.iter().map(|&n| n as u64).product();
    let held = bricks::directory_dims(dims).iter().map(|&n| n as u64).product();
    // A device without bounded loops refuses no step.
    let cost = Cost::new(grid, settings, held, (cells, cells), u32::MAX, Padding(None));
    cost.map_or((u64::MAX, u64::MAX), |c| (c.kept, c.scratch(&c.share(u64::MAX))))
}

impl Engine {
    /// Bytes of device memory that [`Engine::precompute`] allocates for this medium: (kept for the field, freed at the
    /// end). Where less is free, scratch is as small as it can be made.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a setting out of its range.
    pub fn precompute_memory(&self, medium: &Medium, settings: &Visibility) -> Result<(u64, u64)> {
        let cost = self.cost(medium.grid(), settings, &self.cell_map(medium, settings, &[])?)?;
        Ok((cost.kept, cost.scratch(&cost.share(self.free().saturating_sub(cost.kept)))))
    }

    /// Bytes of device memory that [`Engine::estimate`] takes to march `cells` cells, freed at the end.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a setting out of its range.
    pub(crate) fn marching_memory(&self, medium: &Medium, settings: &Visibility, cells: usize) -> Result<u64> {
        let cost = self.cost(medium.grid(), settings, &CellMap { texels: Vec::new(), wanted: cells, matter: 0 })?;
        Ok(cost.scratch(&cost.share(self.free())))
    }

    /// What a field of `settings` for this medium, and a picture of `pixels` (width, height) under a coloured light, need.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a setting out of its range.
    pub fn need(&self, medium: &Medium, settings: &Visibility, pixels: Option<(usize, usize)>) -> Result<Need> {
        let map = self.cell_map(medium, settings, &[])?;
        let cost = self.cost(medium.grid(), settings, &map)?;
        let dims = relight::dims(&self.bricks(medium.grid(), settings, &map));
        // Radiance and coverage of a pixel, and what becomes of it; of a surface also how far it lies.
        let pixel = if medium.matter.surface.is_some() { 36 } else { 32 };
        let strip = |(w, h): (usize, usize)| pixel * (w as u64).saturating_mul(h as u64).min(super::render::STRIP as u64);
        Ok(Need {
            volume: medium.volume.bytes() + medium.occupancy.bytes() + medium.sigma.len_bytes() + medium.albedo.len_bytes(),
            field: cost.kept,
            scratch: cost.scratch(&cost.share(self.free().saturating_sub(cost.kept))),
            least_scratch: cost.least(),
            picture: pixels.map_or(0, |p| self.padding().image(dims, 8) + strip(p) + SLACK),
        })
    }

    /// Checks, before the field is begun, that it fits, and with it a picture; see [`Engine::need`].
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] with the figure and the finest field that would fit.
    pub fn admit(&self, medium: &Medium, settings: &Visibility, pixels: Option<(usize, usize)>) -> Result<Need> {
        let need = self.need(medium, settings, pixels)?;
        let what = if pixels.is_some() { "the field with its picture" } else { "the field" };
        self.ask(what, need.least(), |free| {
            let at = |ratio| self.need(medium, &Visibility { ratio, ..settings.clone() }, pixels);
            match [2, 4, 8].into_iter().find(|&ratio| ratio > settings.ratio && at(ratio).is_ok_and(|n| n.least() <= free)) {
                Some(ratio) => format!("a field at 1:{ratio} would fit"),
                None => "no coarser field would fit either; resample the volume, render fewer pixels or allow more memory".into(),
            }
        })?;
        Ok(need)
    }

    /// What the cells of `map` cost.
    pub(super) fn cost(&self, grid: &Grid, settings: &Visibility, map: &CellMap) -> Result<Cost> {
        let held = self.bricks(grid, settings, map).count();
        let cost = Cost::new(grid, settings, held, (map.wanted as u64, map.matter as u64), self.device.loop_limit(), self.padding())?;
        let most = self.device.info().max_storage_range;
        if cost.ring[0] > most {
            return Err(Error::Invalid {
                item: "visibility.ratio",
                what: format!("1:{} makes slices that take {} to sweep", settings.ratio, error::bytes(cost.ring[0])),
                right: format!("this device binds at most {} as one buffer; take a coarser ratio or fewer slices near", error::bytes(most)),
            });
        }
        Ok(cost)
    }

    /// What bringing a field back costs.
    pub(super) fn cost_of_loading(&self, grid: &Grid, settings: &Visibility, map: &CellMap) -> Result<Cost> {
        // As a march of one direction.
        let settings = Visibility { method: Method::March, sampling: Sampling::Stratified, directions: 1, ..settings.clone() };
        self.cost(grid, &settings, map)
    }

    fn bricks(&self, grid: &Grid, settings: &Visibility, map: &CellMap) -> Bricks {
        let texel = pack::formats(settings.bands, settings.bits).0.bytes();
        Bricks::new(grid.field_dims(settings.ratio as usize), map, texel.into())
    }

    /// What images take on this device.
    pub(super) fn padding(&self) -> Padding<'_> {
        Padding(Some(&self.device))
    }

    fn free(&self) -> u64 {
        let memory = self.device.memory();
        memory.budget.saturating_sub(memory.used)
    }

    /// What a job that keeps `fields` fields may take, unless even the least is too much.
    pub(super) fn admitted(&self, what: &str, fields: u64, cost: &Cost, right: impl FnOnce(u64) -> String) -> Result<Share> {
        self.ask(what, fields * cost.kept + cost.least(), right)?;
        Ok(cost.share(self.free().saturating_sub(fields * cost.kept)))
    }

    /// Refuses what the memory budget cannot hold, before anything is allocated.
    pub(super) fn ask(&self, what: &str, needs: u64, right: impl FnOnce(u64) -> String) -> Result<()> {
        let free = self.free();
        if needs <= free {
            return Ok(());
        }
        Err(Error::OutOfMemory { what: what.into(), needs, free, budget: self.device.memory().budget, right: right(free) })
    }
}
