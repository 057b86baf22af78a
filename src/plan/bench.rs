//! Runs candidates within a budget and keeps what they showed.

use super::Candidate;
use crate::engine::{Engine, Medium, Progress, Span};
use crate::error::Result;
use crate::measure::{FieldError, errors};
use crate::scene::Visibility;
use std::ops::ControlFlow;
use std::time::Instant;

/// Seconds of device time that planning may always take.
pub const FLOOR_SECONDS: f64 = 2.0;

/// The share of what the planned field should take that planning may take, where that is more.
pub const SHARE: f64 = 0.5;

/// Coefficients of cells, and the device seconds that they took.
pub(super) type Run = (Vec<[f32; 16]>, f64);

/// Seconds of settings at so many cells, in place of the device's.
#[doc(hidden)]
pub type Pace = dyn Fn(&Visibility, usize) -> f64;

/// The candidates of a plan.
pub(super) struct Bench<'a, 'p> {
    pub engine: &'a Engine,
    pub medium: &'a Medium,
    /// Cells that are measured, in the order drawn.
    pub cells: Vec<u32>,
    pub bands: u32,
    pub tried: Vec<Candidate>,
    /// Seconds of device time that planning may take, and has taken.
    pub limit: f64,
    pub seconds: f64,
    pub pace: Option<&'a Pace>,
    pub progress: &'a mut Progress<'p>,
}

impl Bench<'_, '_> {
    /// Seconds that are left.
    pub fn left(&self) -> f64 {
        (self.limit - self.seconds).max(0.0)
    }

    /// Coefficients at the cells, and the seconds that they took.
    pub fn run(&mut self, settings: &Visibility) -> Result<Run> {
        let cells = std::mem::take(&mut self.cells);
        let run = self.run_at(settings, &cells);
        self.cells = cells;
        run
    }

    /// The same at other cells.
    pub fn run_at(&mut self, settings: &Visibility, cells: &[u32]) -> Result<Run> {
        let start = Instant::now();
        self.engine.take_timings();
        // What is spent, against what may be.
        let share = |spent: f64| (spent / self.limit).min(1.0) as f32;
        let v = self.engine.estimate(self.medium, settings, cells, &mut |_, _| {
            (self.progress)("plan", share(self.seconds + start.elapsed().as_secs_f64()))
        })?;
        let seconds = self.pace.map_or_else(|| Span::seconds(&self.engine.take_timings(), start), |pace| pace(settings, cells.len()));
        self.seconds += seconds;
        Ok((v, seconds))
    }

    /// Runs what has to be compiled first, once per process and machine: that is nobody's cost.
    pub fn warm(&mut self, settings: &Visibility) -> Result<()> {
        let before = self.seconds;
        let one = self.cells.first().copied();
        self.run_at(&Visibility { directions: 1, ..settings.clone() }, one.as_slice())?;
        self.seconds = before;
        Ok(())
    }

    /// The error of a run against `truth`, kept among what was tried.
    pub fn judge(&mut self, settings: &Visibility, run: &Run, truth: &[[f32; 16]], against: &'static str) -> FieldError {
        let error = errors(&run.0, truth, self.bands).kept;
        self.tried.push(Candidate { settings: settings.clone(), error, against, seconds: run.1 });
        error
    }

    /// The job's end.
    pub fn finished(&mut self) -> ControlFlow<()> {
        (self.progress)("plan", 1.0)
    }
}

/// The part of an estimator's error that more directions do not remove, and what remains of the rest, both relative:
/// of two pairs of runs, each with its own directions, one as it is to be judged, the other as the truth. What both
/// pairs agree on is systematic, for the rest depends on the directions.
pub(super) fn systematic(pairs: [[&Run; 2]; 2], kept: usize) -> [f64; 2] {
    let [[a, a_true], [b, b_true]] = pairs.map(|p| p.map(|r| r.0.iter().flat_map(|v| &v[..kept]).map(|&c| f64::from(c))));
    let (mut both, mut whole, mut power) = (0.0, 0.0, 0.0);
    for (((a, at), b), bt) in a.zip(a_true).zip(b).zip(b_true) {
        both += (a - at) * (b - bt);
        whole += 0.5 * ((a - at).powi(2) + (b - bt).powi(2));
        power += 0.5 * (at * at + bt * bt);
    }
    if power <= 0.0 {
        return [0.0; 2];
    }
    let both = both.max(0.0);
    [(both / power).sqrt(), ((whole - both).max(0.0) / power).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_two_direction_sets_agree_on_is_systematic() {
        let run = |f: &dyn Fn(usize) -> f32| -> Run { ((0..500).map(|i| std::array::from_fn(|c| f(16 * i + c))).collect(), 0.0) };
        // Two unrelated sequences of signs.
        let sign =
            |k: usize, salt: u64| if crate::stages::directions::SplitMix(k as u64 ^ salt << 32).next() & 1 == 0 { 1.0f32 } else { -1.0 };
        let truth = run(&|_| 1.0);
        let off = |salt: u64| run(&move |k| 1.0 + 0.03 + 0.04 * sign(k, salt));
        let (a, b) = (off(1), off(2));
        let [both, rest] = systematic([[&a, &truth], [&b, &truth]], 16);
        assert!((both - 0.03).abs() < 2e-3 && (rest - 0.04).abs() < 2e-3, "{both} {rest}");
        // Sabotage: with the same directions twice nothing is told apart.
        let [same, _] = systematic([[&a, &truth], [&a, &truth]], 16);
        assert!((same - 0.05).abs() < 2e-3);
        assert_eq!(systematic([[&truth, &truth], [&truth, &truth]], 16), [0.0; 2]);
    }
}
