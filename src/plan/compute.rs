//! The planned field, verified.

use super::choose::unreachable;
use super::{Candidate, Plan};
use crate::engine::{Engine, Field, Medium, Progress};
use crate::error::Result;
use crate::measure::{FieldError, errors};
use crate::scene::Visibility;
use crate::scene::visibility::Method;
use std::time::Instant;

/// Fields that are computed before the plan gives up.
const ATTEMPTS: usize = 4;

/// A field that keeps the plan's promise.
pub struct Made {
    /// The field.
    pub field: Field,
    /// Its coefficients as the renderers see them ([`Engine::read_field`]).
    pub data: Vec<f32>,
    /// Its measured error at the plan's cells, with its 95 % interval, whose upper end is within the tolerance.
    pub error: FieldError,
    /// Device seconds of this field.
    pub seconds: f64,
    /// Fields that missed the tolerance and were computed anew.
    pub missed: Vec<Candidate>,
}

impl Plan {
    /// Computes the chosen field, and measures it at the plan's cells; where it misses the tolerance, corrects the plan by
    /// what was seen and computes it again, which `tell` is told. The plan's settings are then those of the field. Takes
    /// the engine's timings.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] on the tolerance where no field met it; otherwise as [`Engine::precompute`].
    pub fn compute(&mut self, engine: &Engine, medium: &Medium, tell: &mut dyn FnMut(&str), progress: &mut Progress) -> Result<Made> {
        let mut missed = Vec::new();
        let mut closest = f64::INFINITY;
        for _ in 0..ATTEMPTS {
            let start = Instant::now();
            engine.take_timings();
            let field = engine.precompute(medium, &self.settings, progress)?;
            let seconds = seconds(engine, start);
            let data = engine.read_field(&field)?;
            let error = self.verify(&data);
            if error.interval[1] <= self.tolerance {
                return Ok(Made { field, data, error, seconds, missed });
            }
            closest = closest.min(error.interval[1]);
            missed.push(Candidate { settings: self.settings.clone(), error, against: "the reference", seconds });
            self.learn(&error)?;
            tell(&format!(
                "{:.4} [{:.4}, {:.4}] missed {}; once more with {}, about {:.1} s",
                error.relative_l2,
                error.interval[0],
                error.interval[1],
                self.tolerance,
                self.chosen(),
                self.seconds
            ));
        }
        Err(unreachable(self.key, self.tolerance, closest, &format!("{ATTEMPTS} fields missed it")))
    }

    /// The error at the plan's cells of a field's coefficients.
    fn verify(&self, data: &[f32]) -> FieldError {
        let kept = self.settings.coefficients();
        let at = |&cell: &u32| std::array::from_fn(|i| if i < kept { data[cell as usize * kept + i] } else { 0.0 });
        let v: Vec<[f32; 16]> = self.cells.iter().map(at).collect();
        errors(&v, &self.truth, self.settings.bands).kept
    }

    /// Corrects the laws by a field that missed, and picks anew.
    fn learn(&mut self, seen: &FieldError) -> Result<()> {
        let Visibility { method, near, step, directions, .. } = self.settings;
        let e = seen.relative_l2;
        let own = (e * e - self.packing * self.packing).max(0.0);
        if method == Method::Sweep {
            let mut learnt = None;
            for s in self.shapes.iter_mut().filter(|s| s.near == near && s.step == step) {
                s.learn(directions, own.sqrt());
                learnt = Some(*s);
            }
            // What is only guessed is guessed by what was seen last.
            if let Some(learnt) = learnt {
                self.shapes.iter_mut().filter(|s| s.seen.is_none()).for_each(|s| *s = learnt.guess((s.near, s.step)));
            }
        } else {
            for m in self.marches.iter_mut().filter(|m| m.0 == step) {
                m.1 = m.1.max((own - self.law.error(directions).powi(2)).max(0.0).sqrt());
            }
        }
        // The interval of what was seen, and a little more, so that every attempt asks for more than the one before.
        let wide = seen.interval[1] / e.max(1e-12) - 1.0;
        self.margin = (self.margin + 0.03).max(wide + 0.02);
        let before = self.predicted.relative_l2;
        self.pick((self.tolerance / (1.0 + self.margin)).min(0.97 * before))
    }
}

/// Device seconds since the timings were last taken; where the device keeps no time, those of the clock.
pub(super) fn seconds(engine: &Engine, start: Instant) -> f64 {
    let spans = engine.take_timings();
    match spans.iter().all(|s| s.timed) {
        true => spans.iter().map(|s| s.seconds).sum(),
        false => start.elapsed().as_secs_f64(),
    }
}
