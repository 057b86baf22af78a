//! `hl_precompute*`: from a volume and its matter to a field.

use super::abi::*;
use super::call::{Scope, alone, choice, enter, read, switch};
use super::fault::{Fault, Result};
use super::field::{Asked, FieldCell};
use super::host::{Host, InUse};
use super::job::{Body, Job, Progress, Work};
use super::matter::{TransferCell, clip, matter};
use super::volume::VolumeCell;
use crate::engine::{Engine, Field, Medium};
use crate::measure::{self, Budget};
use crate::plan;
use crate::scene::visibility::{Cells, Filter, Method, Quality, Sampling, Wanted};
use crate::scene::{Matter, Visibility};
use std::ops::ControlFlow;
use std::sync::Arc;

/// Device seconds that measuring may take where the host says nothing.
const MEASURE_SECONDS: f64 = 60.0;

/// The part of the progress that classification is.
pub(super) const CLASSIFIED: f32 = 0.03;

/// A whole request. It holds what it reads.
pub(super) struct Request {
    pub host: Arc<Host>,
    pub volume: Arc<VolumeCell>,
    /// Cannot be changed while this lives.
    _transfer: Option<InUse<TransferCell>>,
    matter: Matter,
    previous: Option<Arc<FieldCell>>,
    pub asked: Asked,
    pub progressive: bool,
    pub measure: Option<f64>,
    pub progress: Progress,
}

impl Request {
    pub fn of(scope: &mut Scope, engine: *mut hl_engine, info: *const hl_precompute_info) -> Result<Self> {
        let host = scope.engine(engine)?;
        let info = read("hl_precompute_info", info)?;
        alone("hl_precompute_info", info.next)?;
        let volume = scope.get::<VolumeCell>(info.volume)?;
        let transfer = scope.optional::<TransferCell>(info.transfer)?.map(InUse::new);
        let previous = scope.optional::<FieldCell>(info.previous)?;
        let matter = matter(transfer.as_ref().map(|t| &*t.0), info.surface, volume.device.range())?;
        let settings = settings(&info)?;
        let wanted = wanted(&info)?;
        let measure = switch("hl_precompute_info.measure", info.measure)?;
        let seconds = if info.measure_seconds == 0.0 { MEASURE_SECONDS } else { info.measure_seconds };
        if !(seconds.is_finite() && seconds > 0.0) {
            return Err(Fault::invalid("hl_precompute_info.measure_seconds", format_args!("is {seconds}"), "it must be above 0"));
        }
        Ok(Self {
            asked: Asked {
                volume: Arc::downgrade(&volume),
                clip: clip(info.clip)?,
                settings,
                wanted,
                free: [info.ratio == 0, info.bits == 0],
            },
            host,
            volume,
            _transfer: transfer,
            matter,
            previous,
            progressive: switch("hl_precompute_info.progressive", info.progressive)?,
            measure: measure.then_some(seconds),
            progress: Progress { callback: info.progress, user: info.user },
        })
    }

    pub fn medium(&self, engine: &Engine, progress: &mut crate::engine::Progress) -> Result<Arc<Medium>> {
        Ok(Arc::new(engine.classify_watched(&self.volume.device, &self.matter, &self.asked.clip, progress)?))
    }

    /// The medium, and the field of it that is there already, if one is.
    pub fn begin(&self, work: &mut Work, engine: &Engine) -> Result<(Arc<Medium>, Option<Arc<FieldCell>>)> {
        work.step("classify", 0.0)?;
        work.part(0.0, CLASSIFIED);
        let medium = self.medium(engine, &mut |stage, f| work.tell(stage, f))?;
        let same = self.previous.as_ref().and_then(|p| p.recoloured(&medium, &self.asked));
        Ok((medium, same))
    }

    /// How an error is measured in so much time. The sweep's own error before packing is left out: nobody is told.
    pub fn budget(seconds: f64) -> Budget {
        Budget { seconds, field_seconds: Some(f64::INFINITY) }
    }

    /// What a plan is asked for, if one is.
    pub fn plan(&self) -> Option<plan::Request> {
        let v = &self.asked.settings;
        self.asked.wanted.map(|wanted| plan::Request {
            wanted,
            ratio: (!self.asked.free[0]).then_some(v.ratio),
            bits: (!self.asked.free[1]).then_some(v.bits),
            bands: v.bands,
            cells: v.cells,
            pixels: None,
        })
    }

    fn body(self) -> Body {
        Box::new(move |work| self.work(work))
    }

    fn work(self, work: &mut Work) -> Result<()> {
        let engine = work.engine();
        let (medium, same) = self.begin(work, &engine)?;
        if let Some(same) = same {
            let directions = same.field.settings().directions;
            let same = match self.measure.filter(|_| same.error.is_none()) {
                None => same,
                Some(seconds) => {
                    work.part(CLASSIFIED, 1.0);
                    let error = self.measured(work, &engine, &medium, &same.field, seconds)?;
                    FieldCell::new(&self.host, &medium, same.field.clone(), &self.asked, Some(error))
                }
            };
            if let Some(error) = same.error {
                work.error(error);
            }
            work.field(same, directions);
            return Ok(());
        }
        let end = if self.measure.is_some() { 0.7 } else { 1.0 };
        let (field, mut error) = match self.plan() {
            Some(request) => self.planned(work, &engine, &medium, &request, end)?,
            None => {
                work.part(CLASSIFIED, end);
                (self.computed(work, &engine, &medium)?, None)
            }
        };
        let directions = field.settings().directions;
        if let Some(seconds) = self.measure {
            // The field can be had while it is measured.
            work.last_field(FieldCell::new(&self.host, &medium, field.clone(), &self.asked, error), directions);
            work.part(end, 1.0);
            error = Some(self.measured(work, &engine, &medium, &field, seconds)?);
        }
        if let Some(error) = error {
            work.error(error);
        }
        if self.measure.is_some() || self.asked.wanted.is_some() {
            work.last_field(FieldCell::new(&self.host, &medium, field, &self.asked, error), directions);
        }
        Ok(())
    }

    /// The field of the settings, pass by pass if the host wants that.
    fn computed(&self, work: &mut Work, engine: &Engine, medium: &Arc<Medium>) -> Result<Field> {
        let settings = &self.asked.settings;
        let work = std::cell::RefCell::new(work);
        let mut progress = |stage, fraction| work.borrow_mut().tell(stage, fraction);
        if !self.progressive {
            let field = engine.precompute(medium, settings, &mut progress)?;
            work.borrow().field(FieldCell::new(&self.host, medium, field.clone(), &self.asked, None), settings.directions);
            return Ok(field);
        }
        let mut finished = |pass: &crate::engine::Pass<'_>| {
            let cell = match pass.directions < settings.directions {
                true => FieldCell::pass(&self.host, medium, pass, &self.asked),
                false => FieldCell::new(&self.host, medium, pass.field.clone(), &self.asked, None),
            };
            work.borrow().field(cell, pass.directions);
            ControlFlow::Continue(())
        };
        Ok(engine.refine(medium, settings, &mut progress, &mut finished)?)
    }

    /// The cheapest field that keeps a tolerance, pass by pass if the host wants that.
    fn planned(
        &self,
        work: &mut Work,
        engine: &Engine,
        medium: &Arc<Medium>,
        request: &plan::Request,
        end: f32,
    ) -> Result<(Field, Option<[f64; 3]>)> {
        let volume = self.volume.volume(engine)?;
        work.part(CLASSIFIED, 0.4 * end);
        let mut plan = plan::choose(engine, &volume, medium, request, &mut |_, f| work.tell("plan", f))?;
        for reason in &plan.reasons {
            log::info!("{reason}");
        }
        log::info!("plan: {}", plan.chosen());
        work.part(0.4 * end, end);
        let work = std::cell::RefCell::new(work);
        let mut say = |line: &str| log::info!("{line}");
        let mut progress = |stage, fraction| work.borrow_mut().tell(stage, fraction);
        let made = match self.progressive {
            false => plan.compute(engine, medium, &mut say, &mut progress)?,
            true => plan.refine(engine, medium, &mut say, &mut progress, &mut |pass| {
                // Not yet known to keep the tolerance.
                work.borrow().field(FieldCell::pass(&self.host, medium, pass, &self.asked), pass.directions);
            })?,
        };
        let [low, high] = made.error.interval;
        Ok((made.field, Some([made.error.relative_l2, low, high])))
    }

    fn measured(&self, work: &mut Work, engine: &Engine, medium: &Medium, field: &Field, seconds: f64) -> Result<[f64; 3]> {
        let volume = self.volume.volume(engine)?;
        let mut pilot = |_: &'static str, f: f32| work.tell("measure", 0.1 * f);
        let plan = measure::Plan::watched(engine, &volume, medium, field.settings(), &Self::budget(seconds), &mut pilot)?;
        let kept = engine.read_field(field)?;
        let report = measure::Report::measure(engine, medium, field, &kept, &plan, &mut |_, f| work.tell("measure", 0.1 + 0.9 * f))?;
        let error = report.after.kept;
        Ok([error.relative_l2, error.interval[0], error.interval[1]])
    }
}

fn settings(info: &hl_precompute_info) -> Result<Visibility> {
    let default = Visibility::default();
    let or = |item, value: i32, default: u32| match value {
        0 => Ok(default),
        1.. => Ok(value.unsigned_abs()),
        _ => Err(Fault::invalid(item, format_args!("is {value}"), "it must not be negative")),
    };
    let methods = [
        (0, default.method),
        (HL_METHOD_MARCH, Method::March),
        (HL_METHOD_HIERARCHICAL, Method::Hierarchical),
        (HL_METHOD_SWEEP, Method::Sweep),
    ];
    let filters = [
        (0, default.filter),
        (HL_FILTER_BOX, Filter::Box),
        (HL_FILTER_PRODUCT, Filter::Product),
        (HL_FILTER_AXIS, Filter::Axis),
        (HL_FILTER_EXTINCTION, Filter::Extinction),
    ];
    let settings = Visibility {
        method: choice("hl_precompute_info.method", info.method, &methods)?,
        ratio: or("hl_precompute_info.ratio", info.ratio, default.ratio)?,
        directions: if info.directions == 0 { default.directions } else { info.directions },
        bands: or("hl_precompute_info.bands", info.bands, default.bands)?,
        bits: or("hl_precompute_info.bits", info.bits, default.bits)?,
        filter: choice("hl_precompute_info.filter", info.filter, &filters)?,
        sampling: if switch("hl_precompute_info.jittered", info.jittered)? { Sampling::Jittered } else { Sampling::Stratified },
        growth: if info.growth == 0.0 { default.growth } else { info.growth },
        step: if info.step == 0.0 { default.step } else { info.step },
        near: or("hl_precompute_info.near_slices", info.near_slices, default.near)?,
        fit: info.fit,
        cells: if switch("hl_precompute_info.all_cells", info.all_cells)? { Cells::All } else { Cells::Matter },
    };
    settings.check()?;
    Ok(settings)
}

fn wanted(info: &hl_precompute_info) -> Result<Option<Wanted>> {
    let qualities = [
        (0, None),
        (HL_QUALITY_DRAFT, Some(Quality::Draft)),
        (HL_QUALITY_NORMAL, Some(Quality::Normal)),
        (HL_QUALITY_FINE, Some(Quality::Fine)),
    ];
    let quality = choice("hl_precompute_info.quality", info.quality, &qualities)?;
    match (info.tolerance, quality) {
        (0.0, quality) => Ok(quality.map(Wanted::Quality)),
        (tolerance, None) if tolerance > 0.0 && tolerance.is_finite() => Ok(Some(Wanted::Tolerance(tolerance))),
        (_, Some(_)) => Err(Fault::invalid("hl_precompute_info.tolerance", "stands beside quality", "give one of them")),
        (tolerance, None) => Err(Fault::invalid("hl_precompute_info.tolerance", format_args!("is {tolerance}"), "it must be above 0")),
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_precompute(engine: *mut hl_engine, info: *const hl_precompute_info, field: *mut *mut hl_field) -> hl_status {
    enter(|scope| {
        let (request, out) = scope.making("field", field, |s| Request::of(s, engine, info))?;
        let (host, progress) = (request.host.clone(), request.progress);
        let job = Job::run(&host, progress, request.body())?;
        match job.field() {
            Some(field) => out.give(field),
            None => Err(Fault::new(HL_ERROR_INTERNAL, "precompute: it made no field")),
        }
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_precompute_start(engine: *mut hl_engine, info: *const hl_precompute_info, job: *mut *mut hl_job) -> hl_status {
    enter(|scope| {
        let (request, out) = scope.making("job", job, |s| Request::of(s, engine, info))?;
        let (host, progress) = (request.host.clone(), request.progress);
        out.give(Job::start(&host, progress, request.body())?)
    })
}
