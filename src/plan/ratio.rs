//! How many voxels a cell takes.

use super::Request;
use super::between::Points;
use crate::engine::{Engine, Medium, Progress, Span};
use crate::error::{Error, Result};
use crate::scene::visibility::{Method, Quality, Wanted};
use crate::scene::{Visibility, Volume};
use std::time::Instant;

/// Cells of a field that a plan makes finer than it would, because the volume is thin.
const MOST_THIN: usize = 1 << 20;

/// Ratios that a tolerance may choose. A field at 1:1 takes eight times the cells of 1:2, and about six times as
/// long: nobody waits for it unasked.
const FINER: [u32; 3] = [8, 4, 2];

/// Cells of the finest field that is taken unasked: 1:2 of 512³ voxels.
const MOST: usize = 1 << 24;

/// Points that are compared with what is read there.
const POINTS: usize = 128;

/// Voxels per cell.
pub(super) struct Ratio {
    pub ratio: u32,
    /// What a field that is exact at its cells misses between them, where it was measured: relative L2.
    pub between: Option<f64>,
    /// Why.
    pub reason: String,
    /// Device seconds that finding it took.
    pub seconds: f64,
}

/// Finds voxels per cell: for a tolerance the coarsest field that, exact at its cells, is off by no more between them, if one of
/// [`FINER`] is.
pub(super) fn ratio(engine: &Engine, volume: &Volume, medium: &Medium, request: &Request, progress: &mut Progress) -> Result<Ratio> {
    if let Some(ratio) = request.ratio {
        return Ok(Ratio { ratio, between: None, reason: format!("1:{ratio} as asked"), seconds: 0.0 });
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
    let cells = |ratio: u32| grid.field_dims(ratio as usize).iter().product::<usize>();
    let mut seconds = 0.0;
    let (mut ratio, mut missed, mut reason) = match request.wanted {
        Wanted::Quality(Quality::Draft) => (8, None, "1:8, draft".into()),
        Wanted::Quality(Quality::Fine) => (2, None, "1:2, fine".into()),
        Wanted::Quality(Quality::Normal) => (4, None, "1:4, normal".into()),
        Wanted::Tolerance(tolerance) => {
            let start = Instant::now();
            // What has to be compiled first is nobody's cost.
            let one = Visibility { method: Method::March, directions: 1, step: 1.0, bands: request.bands, ..Visibility::default() };
            engine.estimate(medium, &one, &[0], &mut |_, _| progress("plan", 0.0))?;
            engine.take_timings();
            let found = between(engine, volume, medium, request.bands, tolerance, &cells, progress)?;
            seconds = Span::seconds(&engine.take_timings(), start);
            found
        }
    };
    let side = |ratio: u32| grid.field_dims(ratio as usize).into_iter().min().unwrap_or(1);
    while ratio > 1 && side(ratio) < 16 && cells(ratio / 2) <= MOST_THIN {
        ratio /= 2;
        missed = None;
        reason = format!("1:{ratio}: coarser, the field's short side would have {} cells ({reason})", side(2 * ratio));
    }
    let memory = engine.memory();
    let free = memory.budget.saturating_sub(memory.used);
    // Slices that no buffer of the device holds do not fit either.
    let fits = |ratio: u32| match peak(ratio) {
        Err(Error::Invalid { item: "visibility.ratio", .. }) => Ok(false),
        needed => needed.map(|bytes| bytes <= free),
    };
    while ratio < 8 && !fits(ratio)? {
        ratio *= 2;
        missed = None;
        reason = format!("1:{ratio}: finer does not fit the memory ({reason})");
    }
    Ok(Ratio { ratio, between: missed, reason, seconds })
}

/// The coarsest ratio whose cells are close enough, what is missed between them, and why it was taken.
fn between(
    engine: &Engine,
    volume: &Volume,
    medium: &Medium,
    bands: u32,
    tolerance: f64,
    cells: &dyn Fn(u32) -> usize,
    progress: &mut Progress,
) -> Result<(u32, Option<f64>, String)> {
    let mut quiet = |_: &'static str, _: f32| progress("plan", 0.0);
    let points = Points::draw(engine, volume, medium, bands, POINTS, &mut quiet)?;
    if points.is_empty() {
        return Ok((4, None, "1:4: no matter was met".into()));
    }
    let mut seen = Vec::new();
    let mut found = (8, f64::NAN);
    for ratio in FINER.into_iter().filter(|&r| r == FINER[0] || cells(r) <= MOST) {
        found = (ratio, points.error(engine, volume, medium, ratio, &mut quiet)?);
        seen.push(format!("{:.2} at 1:{ratio}", found.1));
        if found.1 <= tolerance {
            break;
        }
    }
    let (ratio, error) = found;
    let limit = if error <= tolerance { "" } else { "; finer ones, and their time, are to be asked for" };
    Ok((ratio, Some(error), format!("1:{ratio}, for between its cells a field is off by {}{limit}", seen.join(", "))))
}
