//! The planned field, verified.

use super::choose::unreachable;
use super::{Candidate, Plan};
use crate::engine::{Engine, Field, Medium, Pass, Progress, Span};
use crate::error::Result;
use crate::measure::{FieldError, errors};
use crate::scene::Visibility;
use crate::scene::visibility::Method;
use std::ops::ControlFlow;
use std::time::Instant;

/// Fields that are computed before the plan gives up.
const ATTEMPTS: usize = 3;

/// A field that keeps the plan's promise.
pub struct Made {
    /// The field.
    pub field: Field,
    /// Its coefficients as the renderers see them ([`Engine::read_field`]).
    pub data: Vec<f32>,
    /// Its measured error at the plan's cells, with its 95 % interval. Its upper end is within the tolerance, except where
    /// a last attempt's error is, and only its interval reaches beyond, which was told.
    pub error: FieldError,
    /// Device seconds of this field.
    pub seconds: f64,
    /// Fields that missed the tolerance and were computed anew.
    pub missed: Vec<Candidate>,
}

impl Plan {
    /// Computes the chosen field, and measures it at the plan's cells; where it misses the tolerance, corrects the plan by
    /// what was seen and computes it again, which `tell` is told before it begins. The plan's settings are then those of
    /// the field. Takes the engine's timings and leaves those of the field.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] on the tolerance where no field met it; otherwise as [`Engine::precompute`].
    pub fn compute(&mut self, engine: &Engine, medium: &Medium, tell: &mut dyn FnMut(&str), progress: &mut Progress) -> Result<Made> {
        self.made(engine, medium, tell, progress, None)
    }

    /// The same in passes ([`Engine::refine`]), each of which `finished` is given; none of them is measured but the last. A
    /// field that is computed anew begins with its first pass again.
    ///
    /// # Errors
    /// As [`Plan::compute`].
    pub fn refine(
        &mut self,
        engine: &Engine,
        medium: &Medium,
        tell: &mut dyn FnMut(&str),
        progress: &mut Progress,
        finished: &mut dyn FnMut(&Pass),
    ) -> Result<Made> {
        self.made(engine, medium, tell, progress, Some(finished))
    }

    fn made(
        &mut self,
        engine: &Engine,
        medium: &Medium,
        tell: &mut dyn FnMut(&str),
        progress: &mut Progress,
        mut finished: Option<&mut dyn FnMut(&Pass)>,
    ) -> Result<Made> {
        let mut missed = Vec::new();
        let mut closest = f64::INFINITY;
        for attempt in 1..=ATTEMPTS {
            let start = Instant::now();
            engine.take_timings();
            let field = match &mut finished {
                None => engine.precompute(medium, &self.settings, progress)?,
                Some(finished) => engine.refine(medium, &self.settings, progress, &mut |pass| {
                    finished(pass);
                    ControlFlow::Continue(())
                })?,
            };
            let spans = engine.take_timings();
            let seconds = Span::seconds(&spans, start);
            let data = engine.read_field(&field)?;
            let mut error = self.verify(&data);
            while error.relative_l2 <= self.tolerance && error.interval[1] > self.tolerance && self.widen(engine, medium, progress)? {
                let before = error;
                error = self.verify(&data);
                tell(&format!(
                    "the interval of {} reached {:.4}: at {} cells the error is {} ",
                    figure(&before),
                    before.interval[1],
                    self.cells.len(),
                    figure(&error)
                ));
            }
            let [_, upper] = error.interval;
            let last = attempt == ATTEMPTS && error.relative_l2 <= self.tolerance;
            if upper <= self.tolerance || last {
                if upper > self.tolerance {
                    tell(&format!(
                        "{} is within {}, its interval is not: taken all the same, after {ATTEMPTS} fields",
                        figure(&error),
                        self.tolerance
                    ));
                }
                engine.take_timings();
                engine.put_timings(spans);
                return Ok(Made { field, data, error, seconds, missed });
            }
            closest = closest.min(upper);
            missed.push(Candidate { settings: self.settings.clone(), error, against: "the reference", seconds });
            if attempt < ATTEMPTS {
                self.learn(&error)?;
                tell(&format!(
                    "{} missed {}; once more with {}, about {:.1} s",
                    figure(&error),
                    self.tolerance,
                    self.chosen(),
                    self.seconds
                ));
            }
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

    /// Takes as many cells again where the reference there costs less than half of another field; whether it did.
    fn widen(&mut self, engine: &Engine, medium: &Medium, progress: &mut Progress) -> Result<bool> {
        let count = self.cells.len().min(self.more.len());
        if count == 0 || count as f64 * self.dense_seconds > 0.5 * self.seconds {
            return Ok(false);
        }
        let cells: Vec<u32> = self.more.drain(..count).collect();
        self.truth.extend(engine.estimate(medium, &self.dense, &cells, progress)?);
        self.cells.extend(cells);
        Ok(true)
    }

    /// Corrects the laws by a field that missed, and picks anew.
    fn learn(&mut self, seen: &FieldError) -> Result<()> {
        let Visibility { method, near, step, directions, .. } = self.settings;
        let e = seen.relative_l2;
        let own = (e * e - self.packing * self.packing).max(0.0);
        if method == Method::Sweep {
            self.sweeps.learn((near, step), directions, own.sqrt());
        } else {
            for m in self.marches.iter_mut().filter(|m| m.step == step) {
                m.own[0] = m.own[0].max((own - self.law.error(directions).powi(2)).max(0.0).sqrt());
            }
        }
        // The interval of what was seen, and a little more, so that every attempt asks for more than the one before.
        let wide = seen.interval[1] / e.max(1e-12) - 1.0;
        self.margin = self.margin.max(wide) + 0.04;
        self.pick()
    }
}

/// "0.0481 [0.0452, 0.0511]".
fn figure(e: &FieldError) -> String {
    format!("{:.4} [{:.4}, {:.4}]", e.relative_l2, e.interval[0], e.interval[1])
}
