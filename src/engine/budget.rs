//! Memory, said beforehand: what a scene needs on the device, and what would fit where that is too much.

use super::{Engine, precompute_memory};
use crate::error::{Error, Result};
use crate::scene::transfer::TABLE_SIZE;
use crate::scene::{Samples, Visibility, Volume};
use crate::stages::occupancy;

/// Bytes that small buffers and alignment add to the sum of the large parts.
const SLACK: u64 = 1 << 20;

/// Device memory of a scene, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Need {
    /// The volume's image, its occupancy and its tables.
    pub volume: u64,
    /// The packed field.
    pub field: u64,
    /// While the field is computed, freed afterwards.
    pub scratch: u64,
    /// Irradiance and pixels in flight, once the field stands.
    pub picture: u64,
}

impl Need {
    /// What a volume, a field of `settings`, and a picture of `pixels` (width, height) need.
    pub fn of(volume: &Volume, settings: &Visibility, pixels: Option<(usize, usize)>) -> Self {
        let grid = volume.grid();
        let (field, scratch) = precompute_memory(grid, settings);
        let cells: u64 = grid.field_dims(settings.ratio as usize).iter().map(|&n| n as u64).product();
        let picture = pixels.map_or(0, |(w, h)| 8 * cells + 36 * (w as u64).saturating_mul(h as u64).min(super::render::STRIP as u64));
        // While the occupancy is computed it takes some more, which is free again before the field is begun.
        let (occupancy, passing) = occupancy::bytes(volume);
        Self { volume: volume_bytes(volume) + occupancy + 20 * TABLE_SIZE as u64, field, scratch: scratch.max(passing), picture }
    }

    /// The most that is held at one time.
    pub fn peak(&self) -> u64 {
        self.volume + self.field + self.scratch.max(self.picture) + SLACK
    }
}

/// Bytes of a volume's image: integers take 16 bits a voxel, floats 32 (see `stages::Encoding`).
pub(super) fn volume_bytes(volume: &Volume) -> u64 {
    volume.grid().voxels() * if matches!(volume.samples(), Samples::F32(_)) { 4 } else { 2 }
}

impl Engine {
    /// Checks, before anything is allocated, that a whole scene fits; see [`Need::of`].
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] with the figure and the finest field that would fit.
    pub fn admit(&self, volume: &Volume, settings: &Visibility, pixels: Option<(usize, usize)>) -> Result<Need> {
        settings.check()?;
        let need = Need::of(volume, settings, pixels);
        self.ask("the scene", need.peak(), |free| {
            let at = |ratio| Need::of(volume, &Visibility { ratio, ..settings.clone() }, pixels).peak();
            match [2, 4, 8].into_iter().find(|&ratio| ratio > settings.ratio && at(ratio) <= free) {
                Some(ratio) => format!("a field at 1:{ratio} would fit"),
                None => format!(
                    "the volume takes {}, its field at 1:8 and the picture {} more; resample the volume or allow more memory",
                    crate::error::bytes(need.volume),
                    crate::error::bytes(at(8) - need.volume)
                ),
            }
        })?;
        Ok(need)
    }

    /// Refuses what the memory budget cannot hold, before anything is allocated.
    pub(super) fn ask(&self, what: &str, needs: u64, right: impl FnOnce(u64) -> String) -> Result<()> {
        let memory = self.device.memory();
        let free = memory.budget.saturating_sub(memory.used);
        if needs <= free {
            return Ok(());
        }
        Err(Error::OutOfMemory { what: what.into(), needs, free, budget: memory.budget, right: right(free) })
    }
}
