//! How many voxels a cell takes.

use super::Request;
use crate::engine::{Engine, Medium};
use crate::error::Result;
use crate::scene::Visibility;
use crate::scene::visibility::{Method, Quality, Wanted};

/// Cells of a field that a plan makes finer than it would, because the volume is thin.
const MOST_THIN: usize = 1 << 20;

/// Voxels per cell, and why.
pub(super) fn ratio(engine: &Engine, medium: &Medium, request: &Request) -> Result<(u32, String)> {
    if let Some(ratio) = request.ratio {
        return Ok((ratio, format!("1:{ratio} as asked")));
    }
    let grid = medium.grid();
    let least = Visibility {
        method: Method::Sweep,
        bits: request.bits.unwrap_or(8),
        bands: request.bands,
        directions: 512,
        ..Visibility::default()
    };
    let peak = |ratio| engine.need(medium, &Visibility { ratio, ..least.clone() }, request.pixels).map(|need| need.least());
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
    while ratio < 8 && peak(ratio)? > free {
        ratio *= 2;
        reason = format!("1:{ratio}: finer does not fit the memory");
    }
    Ok((ratio, reason))
}
