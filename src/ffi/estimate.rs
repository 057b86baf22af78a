//! `hl_*_estimate*`: what work will cost, before it starts.

use super::abi::*;
use super::call::{enter, fill};
use super::fault::{Fault, Result};
use super::job::{Body, Job, Work};
use super::precompute::{self, CLASSIFIED};
use super::render::{self, PREPARED};
use crate::engine::{Cost, Engine, Medium};
use crate::measure;
use crate::plan;
use crate::scene::Visibility;
use crate::scene::visibility::Method;
use std::sync::Arc;

/// What was found.
#[derive(Clone, Copy)]
pub(super) struct Estimate {
    peak: u64,
    result: u64,
    free: u64,
    seconds: f64,
}

impl Estimate {
    /// Of work that holds so much beside what the engine holds already.
    fn new(engine: &Engine, besides: u64, result: u64, seconds: f64) -> Self {
        let memory = engine.memory();
        Self { peak: memory.used.saturating_add(besides), result, free: memory.budget.saturating_sub(memory.used), seconds }
    }

    /// Tells the host.
    pub fn tell(&self, estimate: *mut hl_estimate) -> Result<hl_status> {
        fill("hl_estimate", estimate, |out| {
            (out.peak, out.result, out.free, out.seconds) = (self.peak, self.result, self.free, self.seconds);
        })
    }

    /// That of a job which has ended well.
    fn of(job: Arc<Job>) -> Result<Self> {
        job.estimate().ok_or_else(|| Fault::new(HL_ERROR_INTERNAL, "estimate: the job found none"))
    }
}

impl precompute::Request {
    fn estimate(self) -> Body {
        Box::new(move |work| {
            let engine = work.engine();
            let (medium, same) = self.begin(work, &engine)?;
            if let Some(same) = same {
                let settings = same.field.settings();
                let (besides, seconds) = match self.measure.filter(|_| same.error.is_none()) {
                    None => (0, 0.0),
                    Some(budget) => {
                        let cost = engine.field_cost(&medium, settings, &mut |stage, f| work.tell(stage, f))?;
                        self.measuring(work, &engine, &medium, settings, &cost, budget)?
                    }
                };
                work.estimate(Estimate::new(&engine, besides, same.field.bytes(), seconds));
                return Ok(());
            }
            let wanted = &self.asked.settings;
            let (settings, cost, planning) = match self.plan() {
                None => {
                    work.part(CLASSIFIED, 0.9);
                    let cost = engine.field_cost(&medium, wanted, &mut |stage, f| work.tell(stage, f))?;
                    (wanted.clone(), cost, 0)
                }
                Some(asked) => {
                    let volume = self.volume.volume(&engine)?;
                    work.part(CLASSIFIED, 0.9);
                    let plan = plan::choose(&engine, &volume, &medium, &asked, &mut |_, f| work.tell("plan", f))?;
                    let (kept, passing) = engine.precompute_memory(&medium, &plan.settings)?;
                    // The work plans anew.
                    let cost = Cost { kept, passing, seconds: plan.planning_seconds + plan.seconds };
                    (plan.settings, cost, plan.need.scratch)
                }
            };
            // The last pass stays while the next is made.
            let fields = if self.progressive && settings.method == Method::Sweep { 2 } else { 1 };
            let (mut besides, mut seconds) = (planning.max(fields * cost.kept + cost.passing), cost.seconds);
            if let Some(budget) = self.measure {
                let (bytes, more) = self.measuring(work, &engine, &medium, &settings, &cost, budget)?;
                (besides, seconds) = (besides.max(cost.kept + bytes), seconds + more);
            }
            work.estimate(Estimate::new(&engine, besides, cost.kept, seconds));
            Ok(())
        })
    }

    /// Bytes beside the field, and seconds, that measuring its error takes.
    fn measuring(
        &self,
        work: &mut Work,
        engine: &Engine,
        medium: &Medium,
        settings: &Visibility,
        cost: &Cost,
        budget: f64,
    ) -> Result<(u64, f64)> {
        let volume = self.volume.volume(engine)?;
        work.part(0.9, 1.0);
        let plan = measure::Plan::watched(engine, &volume, medium, settings, &Self::budget(budget), &mut |stage, f| work.tell(stage, f))?;
        if !plan.before || settings.bits == 32 {
            return Ok((plan.bytes, plan.seconds));
        }
        // The estimator runs again at the measured cells.
        let all = engine.wanted_cells(medium, settings)?.len().max(1);
        let again = cost.seconds * (plan.cells.len() as f64 / all as f64).min(1.0);
        Ok((plan.bytes.max(cost.passing), plan.seconds + again))
    }
}

impl render::Request {
    fn estimate(self) -> Body {
        Box::new(move |work| {
            let engine = work.engine();
            work.step("relight", 0.0)?;
            let medium = self.seen(work, &engine)?;
            let view = (&self.camera, &self.image);
            let cost = match &self.reference {
                Some(settings) => {
                    let sky = self.light.sky()?;
                    work.part(PREPARED, 1.0);
                    engine.reference_cost(&medium, &sky, view, settings, &mut |stage, f| work.tell(stage, f))?
                }
                None => {
                    let lit = self.lit(work, &engine)?;
                    work.part(PREPARED, 1.0);
                    engine.picture_cost(&medium, &lit, view, self.layers != 0, &mut |stage, f| work.tell(stage, f))?
                }
            };
            work.estimate(Estimate::new(&engine, cost.passing, cost.kept, cost.seconds));
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_precompute_estimate(
    engine: *mut hl_engine,
    info: *const hl_precompute_info,
    estimate: *mut hl_estimate,
) -> hl_status {
    enter(|scope| {
        let request = precompute::Request::of(scope, engine, info)?;
        // A place that is none is found before the work.
        fill("hl_estimate", estimate, |_| ())?;
        let (host, progress) = (request.host.clone(), request.progress);
        Estimate::of(Job::run(&host, progress, request.estimate())?)?.tell(estimate)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_precompute_estimate_start(
    engine: *mut hl_engine,
    info: *const hl_precompute_info,
    job: *mut *mut hl_job,
) -> hl_status {
    enter(|scope| {
        let (request, out) = scope.making("job", job, |s| precompute::Request::of(s, engine, info))?;
        let (host, progress) = (request.host.clone(), request.progress);
        out.give(Job::start(&host, progress, request.estimate())?)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_render_estimate(engine: *mut hl_engine, info: *const hl_render_info, estimate: *mut hl_estimate) -> hl_status {
    enter(|scope| {
        let request = render::Request::of(scope, engine, info)?;
        fill("hl_estimate", estimate, |_| ())?;
        let (host, progress) = (request.host.clone(), request.progress);
        Estimate::of(Job::run(&host, progress, request.estimate())?)?.tell(estimate)
    })
}
