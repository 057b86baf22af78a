//! How many voxels a cell takes.

use super::Request;
use crate::engine::{Engine, Need};
use crate::error::Result;
use crate::scene::visibility::{Method, Quality, Wanted};
use crate::scene::{Visibility, Volume};

/// Cells of a field that a plan makes finer than it would, because the volume is thin.
const MOST_THIN: usize = 1 << 20;

/// Voxels per cell, and why.
pub(super) fn ratio(engine: &Engine, volume: &Volume, request: &Request) -> Result<(u32, String)> {
    if let Some(ratio) = request.ratio {
        return Ok((ratio, format!("1:{ratio} as asked")));
    }
    let grid = volume.grid();
    let least = Visibility {
        method: Method::Sweep,
        bits: request.bits.unwrap_or(8),
        bands: request.bands,
        directions: 512,
        ..Visibility::default()
    };
    let peak = |ratio| {
        let need = Need::of(volume, &Visibility { ratio, ..least.clone() }, request.pixels);
        // The volume is there already.
        need.peak() - need.volume
    };
    let (mut ratio, why) = match request.wanted {
        Wanted::Quality(Quality::Draft) => (8, "draft"),
        Wanted::Quality(Quality::Fine) => (2, "fine"),
        Wanted::Quality(Quality::Normal) => (4, "normal"),
        Wanted::Tolerance(_) => (4, "unless asked otherwise"),
    };
    let mut reason = format!("1:{ratio}, {why}");
    let side = |ratio: u32| grid.field_dims(ratio as usize).into_iter().min().unwrap_or(1);
    while ratio > 1 && side(ratio) < 16 && grid.field_dims(ratio as usize / 2).iter().product::<usize>() <= MOST_THIN {
        ratio /= 2;
        reason = format!("1:{ratio}: coarser, the field's short side would have {} cells", side(2 * ratio));
    }
    let memory = engine.memory();
    let free = memory.budget.saturating_sub(memory.used);
    while ratio < 8 && peak(ratio) > free {
        ratio *= 2;
        reason = format!("1:{ratio}: finer does not fit the memory");
    }
    Ok((ratio, reason))
}
