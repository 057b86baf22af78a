//! `hl_precompute*`: from a volume and its matter to a field.

use super::abi::*;
use super::call::{Scope, alone, choice, enter, fill, out, read, switch};
use super::fault::{Fault, Result};
use super::field::{Asked, FieldCell};
use super::host::{Host, InUse};
use super::job::{Body, Job, Progress, Work};
use super::matter::{TransferCell, clip, matter};
use super::volume::VolumeCell;
use crate::engine::{Engine, Field, Medium};
use crate::io::{self, ReadOptions};
use crate::measure::{self, Budget};
use crate::plan;
use crate::scene::visibility::{Cells, Filter, Method, Quality, Sampling, Wanted};
use crate::scene::{Matter, Scene, Visibility};
use std::ffi::c_char;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::{Arc, Weak};

/// Device seconds that measuring may take where the host says nothing.
const MEASURE_SECONDS: f64 = 60.0;

/// A whole request. It holds what it reads.
struct Request {
    host: Arc<Host>,
    volume: Arc<VolumeCell>,
    /// Cannot be changed while this lives.
    _transfer: Option<InUse<TransferCell>>,
    matter: Matter,
    previous: Option<Arc<FieldCell>>,
    asked: Asked,
    progressive: bool,
    measure: Option<f64>,
    progress: Progress,
}

impl Request {
    fn of(scope: &mut Scope, engine: *mut hl_engine, info: *const hl_precompute_info) -> Result<Self> {
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

    fn medium(&self, engine: &Engine) -> Result<Medium> {
        Ok(engine.classify_clipped(&self.volume.device, &self.matter, &self.asked.clip)?)
    }

    /// What a plan is asked for, if one is.
    fn plan(&self) -> Option<plan::Request> {
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
        work.step("classify", 0.0)?;
        let medium = Arc::new(self.medium(&engine)?);
        if let Some(same) = self.previous.as_ref().and_then(|p| p.recoloured(&medium, &self.asked)) {
            let directions = same.field.settings().directions;
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
                work.part(0.0, end);
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
            work.borrow().field(FieldCell::new(&self.host, medium, pass.field.clone(), &self.asked, None), pass.directions);
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
        work.part(0.0, 0.4 * end);
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
                work.borrow().field(FieldCell::new(&self.host, medium, pass.field.clone(), &self.asked, None), pass.directions);
            })?,
        };
        let [low, high] = made.error.interval;
        Ok((made.field, Some([made.error.relative_l2, low, high])))
    }

    fn measured(&self, work: &mut Work, engine: &Engine, medium: &Medium, field: &Field, seconds: f64) -> Result<[f64; 3]> {
        let volume = self.volume.volume(engine)?;
        let budget = Budget { seconds, field_seconds: Some(f64::INFINITY) };
        let plan = measure::Plan::new(engine, &volume, medium, field.settings(), &budget)?;
        let kept = engine.read_field(field)?;
        let report = measure::Report::measure(engine, medium, field, &kept, &plan, &mut |_, f| work.tell("measure", f))?;
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
        fit: default.fit,
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
        let out = out("field", field);
        let request = Request::of(scope, engine, info)?;
        let out = out?;
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
        let out = out("job", job);
        let request = Request::of(scope, engine, info)?;
        let out = out?;
        let (host, progress) = (request.host.clone(), request.progress);
        out.give(Job::start(&host, progress, request.body())?)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_precompute_estimate(
    engine: *mut hl_engine,
    info: *const hl_precompute_info,
    estimate: *mut hl_estimate,
) -> hl_status {
    enter(|scope| {
        let request = Request::of(scope, engine, info)?;
        let turn = request.host.turn()?;
        let engine = turn.engine();
        let medium = request.medium(engine)?;
        let (settings, seconds) = match request.plan() {
            None => (request.asked.settings.clone(), None),
            Some(asked) => {
                let volume = request.volume.volume(engine)?;
                let mut quiet = |_: &'static str, _: f32| ControlFlow::Continue(());
                let plan = request.host.log.during(request.host.id, || plan::choose(engine, &volume, &medium, &asked, &mut quiet))?;
                (plan.settings, Some(plan.seconds))
            }
        };
        let cost = engine.field_cost(&medium, &settings)?;
        // The last pass stays while the next is made.
        let fields = if request.progressive && settings.method == Method::Sweep { 2 } else { 1 };
        let memory = engine.memory();
        fill("hl_estimate", estimate, |out| {
            out.peak = memory.used.saturating_add(fields * cost.kept).saturating_add(cost.passing);
            (out.result, out.free, out.seconds) = (cost.kept, memory.budget.saturating_sub(memory.used), seconds.unwrap_or(cost.seconds));
        })
    })
}

/// What a field file says of its settings: a scene, as the command writes it.
pub(super) fn meta(settings: &Visibility) -> Vec<(String, String)> {
    let scene = Scene { visibility: settings.clone(), ..Scene::of_volume("volume".into()) };
    vec![("scene".into(), io::scene_text(&scene))]
}

/// The settings that a field file tells, or what its shape lets guess.
fn told(path: &Path, file: &io::NrrdField, dims: [usize; 3]) -> Result<Visibility> {
    let bands = file.coefficients.isqrt() as u32;
    let scene = file.meta.iter().find(|(key, _)| key == "scene").map(|(_, text)| text);
    let settings = match scene {
        Some(text) => io::parse_scene(text, &crate::error::shown(path), Path::new(""), &[])?.visibility,
        None => {
            let fits = |ratio: &u32| dims.map(|n| n.div_ceil(*ratio as usize)) == file.grid.dims();
            let ratio = [1, 2, 4, 8].into_iter().find(fits).unwrap_or(1);
            Visibility { ratio, bands, bits: 32, ..Visibility::default() }
        }
    };
    if settings.bands != bands || dims.map(|n| n.div_ceil(settings.ratio as usize)) != file.grid.dims() {
        let ([x, y, z], [a, b, c]) = (file.grid.dims(), dims);
        let what = format!("{} coefficients of {x}x{y}x{z} cells do not belong to {a}x{b}x{c} voxels", file.coefficients);
        return Err(Fault::new(
            HL_ERROR_FORMAT,
            format!("{}: {what}; load it with the volume that it was computed for", crate::error::shown(path)),
        ));
    }
    Ok(settings)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_field_load(
    engine: *mut hl_engine,
    path: *const c_char,
    info: *const hl_precompute_info,
    field: *mut *mut hl_field,
) -> hl_status {
    enter(|scope| {
        let out = out("field", field);
        let request = Request::of(scope, engine, info)?;
        let out = out?;
        let path = super::call::path(path)?;
        let grid = *request.volume.device.grid();
        let file = io::read_nrrd_field(&path, &ReadOptions::default())?;
        let settings = told(&path, &file, grid.dims())?;
        let turn = request.host.turn()?;
        let medium = Arc::new(request.medium(turn.engine())?);
        let loaded = turn.engine().load_field(&grid, &settings, &file.data)?;
        // Not what a precompute was asked for, so that none takes it for its own.
        let asked = Asked { volume: Weak::new(), ..request.asked.clone() };
        out.give(FieldCell::new(&request.host, &medium, loaded, &asked, None))
    })
}
