//! What a measurement may cost, and at which cells a field is measured for that.

use super::{REFERENCE_DIRECTIONS, REFERENCE_STEP, dense, draw, near, reading};
use crate::engine::{Engine, Medium, Progress, Span};
use crate::error::Result;
use crate::scene::visibility::Method;
use crate::scene::{Visibility, Volume};
use std::ops::ControlFlow;
use std::time::Instant;

/// Probes, if time allows, and the fewest.
const PROBES: [usize; 2] = [1024, 64];

/// The share of the budget that a second sweep may take.
const AGAIN: f64 = 0.5;

/// Directions of the pilot: all probes, so that the device is as busy as in the whole.
const PILOT_DIRECTIONS: u32 = 16;

/// What a measurement may cost. It only decides how many cells are measured, at least 64, and whether before packing too: for
/// a given number of them the result is the same every time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Seconds of device time, all that is measured together.
    pub seconds: f64,
    /// Seconds of device time that the field took, if known: a swept field is swept again for its coefficients before
    /// packing, which is left out where that takes longer than half of `seconds`.
    pub field_seconds: Option<f64>,
}

impl Default for Budget {
    fn default() -> Self {
        Self { seconds: 60.0, field_seconds: None }
    }
}

impl Budget {
    /// The fewest seconds that pay for a second sweep of so many.
    pub fn for_sweep(field_seconds: f64) -> f64 {
        field_seconds / AGAIN
    }

    /// Seconds of the second sweep that would take `again`, if they are paid for, and those that are left to the reference.
    fn shared(&self, again: Option<f64>) -> (Option<f64>, f64) {
        let paid = again.filter(|&s| Self::for_sweep(s) <= self.seconds);
        (paid, self.seconds - paid.unwrap_or(0.0))
    }
}

/// What is going to be measured, and about how long it takes.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Cells to measure, ascending; none where there is no matter, and none of a fitted field.
    pub cells: Vec<u32>,
    /// Voxels of matter at which it is measured as pictures read it, ascending; none of an isosurface.
    pub voxels: Vec<u32>,
    /// The voxels' opacities, 0..1.
    pub opacities: Vec<f32>,
    /// Seconds of device time that the reference will take, by a pilot; with what else is marched at the cells.
    pub seconds: f64,
    /// Bytes of device memory that the reference takes.
    pub bytes: u64,
    /// Whether the error before packing is measured too.
    pub before: bool,
    /// Seconds of device time that the second sweep will take, where there is one.
    pub again: Option<f64>,
}

impl Plan {
    /// Chooses the cells by a pilot of few directions: 1,024 of those near matter or, where the reference at so many would
    /// take longer than `budget`, fewer, but 64. A second sweep is paid for first, if half of the budget pays for it. Takes the engine's
    /// timings.
    ///
    /// # Errors
    /// As [`Engine::estimate`].
    pub fn new(engine: &Engine, volume: &Volume, medium: &Medium, settings: &Visibility, budget: &Budget) -> Result<Self> {
        Self::watched(engine, volume, medium, settings, budget, &mut |_, _| ControlFlow::Continue(()))
    }

    /// The same, told of its progress.
    ///
    /// # Errors
    /// As [`Plan::new`], and [`Error::Cancelled`].
    pub fn watched(
        engine: &Engine,
        volume: &Volume,
        medium: &Medium,
        settings: &Visibility,
        budget: &Budget,
        progress: &mut Progress,
    ) -> Result<Self> {
        let fitted = settings.fit > 0;
        let mut voxels = if medium.has_surface() { Vec::new() } else { reading::points(volume, medium, PROBES[0]) };
        voxels = draw(voxels, PROBES[0], super::probes::SEED);
        let mut cells = match fitted {
            true => voxels.clone(),
            false => {
                let near = near(engine, volume, medium, settings.ratio, &mut |_, f| progress("probes", 0.5 * f))?;
                draw(near, PROBES[0], super::probes::SEED)
            }
        };
        let ratio = if fitted { 1 } else { settings.ratio };
        let mut pilot = |directions, cells: &[u32]| {
            let start = Instant::now();
            engine.take_timings();
            engine.estimate(medium, &dense(ratio, directions), cells, &mut |_, f| progress("probes", 0.5 + 0.5 * f))?;
            Ok(Span::seconds(&engine.take_timings(), start))
        };
        let mut seconds = 0.0;
        if let Some(first) = cells.first() {
            // Whatever a kernel's first dispatch costs is not the pilot's.
            pilot(1, &[*first])?;
            seconds = pilot(PILOT_DIRECTIONS, &cells)? * f64::from(REFERENCE_DIRECTIONS / PILOT_DIRECTIONS);
        }
        // Beside cells, a quarter as many voxels.
        voxels.truncate(if fitted { voxels.len() } else { cells.len() / 4 });
        seconds *= if fitted { 1.0 } else { 1.0 + voxels.len() as f64 / cells.len().max(1) as f64 + own(settings) };
        // Floats are stored as they are: there is nothing to run again.
        let again = if settings.method == Method::Sweep && settings.bits != 32 && !fitted { budget.field_seconds } else { None };
        let (paid, left) = budget.shared(again);
        let count = affordable(cells.len(), seconds, left);
        if count < cells.len() {
            seconds *= count as f64 / cells.len() as f64;
            cells.truncate(count);
            voxels.truncate(if fitted { count } else { count / 4 });
        }
        cells.sort_unstable();
        voxels.sort_unstable();
        if fitted {
            cells.clear();
        }
        // Between cells only the whole field, as it is stored, can be read.
        let before = again == paid && !(fitted && settings.bits != 32);
        let opacities = reading::opacities(volume, medium, &voxels);
        let bytes = engine.marching_memory(medium, &dense(ratio, REFERENCE_DIRECTIONS), cells.len().max(voxels.len()))?;
        Ok(Self { cells, voxels, opacities, seconds, bytes, before, again: paid })
    }
}

/// How many of `count` probes, which would take `predicted` seconds together, to measure in `seconds`.
fn affordable(count: usize, predicted: f64, seconds: f64) -> usize {
    if predicted <= seconds { count } else { ((count as f64 * seconds / predicted) as usize).max(PROBES[1]).min(count) }
}

/// What estimating the field once more at the cells costs, against the reference there, where that is a march or cheaper.
fn own(settings: &Visibility) -> f64 {
    match (settings.method, settings.bits) {
        (Method::Sweep, _) | (_, 32) => 0.0,
        _ => f64::from(settings.directions) / f64::from(REFERENCE_DIRECTIONS) * f64::from(REFERENCE_STEP / settings.step),
    }
}

#[cfg(test)]
mod tests {
    use super::{Budget, affordable, own};
    use crate::scene::Visibility;
    use crate::scene::visibility::Method;

    #[test]
    fn reference_and_second_sweep_share_the_budget() {
        let shared = |again| Budget { seconds: 60.0, field_seconds: None }.shared(again);
        assert_eq!([None, Some(20.0), Some(30.0)].map(shared), [(None, 60.0), (Some(20.0), 40.0), (Some(30.0), 30.0)]);
        assert_eq!(shared(Some(30.1)), (None, 60.0), "dearer than half of it: left out");
        // A march for the error before packing costs what the reference does; floats are not run again.
        let s = Visibility { method: Method::March, directions: 4096, step: 0.25, bits: 8, ..Visibility::default() };
        assert_eq!((own(&s), own(&Visibility { step: 1.0, directions: 2048, ..s.clone() })), (1.0, 0.125));
        assert_eq!((own(&Visibility { bits: 32, ..s.clone() }), own(&Visibility { method: Method::Sweep, ..s })), (0.0, 0.0));
    }

    #[test]
    fn what_is_affordable_follows_the_prediction() {
        assert_eq!(affordable(1024, 30.0, 60.0), 1024);
        assert_eq!(affordable(1024, 120.0, 60.0), 512);
        assert_eq!(affordable(1024, 1e9, 60.0), 64, "the fewest");
        assert_eq!(affordable(20, 1e9, 60.0), 20, "there are no more");
        assert_eq!(affordable(0, 0.0, 60.0), 0);
        // A device that keeps no time, and predicts nonsense.
        assert_eq!((affordable(1024, f64::INFINITY, 60.0), affordable(1024, f64::NAN, 60.0)), (64, 64));
    }
}
