//! From what is asked for to settings, by measuring within a budget.

use super::bench::{Bench, FLOOR_SECONDS, Pace, Run, SHARE};
use super::law::{DOUBTS, LEAST, Law, STEPPED, Sweeps};
use super::ratio::{Ratio, ratio};
use super::truth::{CELLS, March, half_width, truth};
use super::{Plan, Request, method as name};
use crate::engine::{Engine, Medium, Progress};
use crate::error::{Error, Result};
use crate::measure::{self, FieldError, REFERENCE_DIRECTIONS, errors};
use crate::scene::visibility::{Method, Sampling, Wanted};
use crate::scene::{Visibility, Volume};

/// Most directions of a march that a plan takes.
const MOST_MARCHED: u32 = 2 * REFERENCE_DIRECTIONS;

/// Cells that may be measured altogether.
const MOST_CELLS: usize = 4096;

/// Directions of the pilots that tell what a march and a sweep cost. Fewer would not do for the sweep: its dispatches cost
/// something however few directions they hold.
const PILOT: [u32; 2] = [16, 32];

/// A sweep's directions for a tolerance, and its seconds against those in the longest steps, before anything is known:
/// what the budget of planning is taken from.
const USUAL: [f64; 2] = [5.0, 1.45];

/// Directions that the sweep is measured with after its pilot: the more, the surer.
const SECOND: [u32; 3] = [128, 96, 64];

/// Sweeps take a step that is off by at most this share of the tolerance.
const SMALL: f64 = 0.3;

/// The least and most that an interval is allowed for.
const MARGIN: [f64; 2] = [0.05, 0.2];

/// The share of the margin that is aimed for: where the interval is a little too wide, more cells make it narrower.
const AIM: f64 = 0.75;

/// The seed of the plan's own cells: others than `--measure` draws.
const SEED: u64 = 0x70_6c61_6e00;

/// Finds the cheapest settings that meet `request`, in [`FLOOR_SECONDS`] of device time or [`SHARE`] of what the field
/// should take, about: the ratio, which is sought first, takes some tenths of a second; then nothing is begun that does not
/// fit but the coarsest reference that the tolerance can be judged by, at the fewest cells, and what was not measured by then is
/// extrapolated; the plan's reasons say both. Takes the engine's timings.
///
/// # Errors
/// [`Error::Invalid`] on `visibility.tolerance` (or `.quality`) for what is out of reach, [`Error::OutOfMemory`], and as
/// [`Engine::estimate`].
pub fn choose(engine: &Engine, volume: &Volume, medium: &Medium, request: &Request, progress: &mut Progress) -> Result<Plan> {
    choose_at(engine, volume, medium, request, None, progress)
}

/// The same at another pace than the device's: for tests, that what time decides is decided the same way again.
///
/// # Errors
/// As [`choose`].
#[doc(hidden)]
pub fn choose_at(
    engine: &Engine,
    volume: &Volume,
    medium: &Medium,
    request: &Request,
    pace: Option<&Pace>,
    progress: &mut Progress,
) -> Result<Plan> {
    let key = match request.wanted {
        Wanted::Tolerance(_) => "visibility.tolerance",
        Wanted::Quality(_) => "visibility.quality",
    };
    let tolerance = request.wanted.tolerance();
    if !(0.001..=1.0).contains(&tolerance) {
        return Err(Error::Invalid { item: key, what: format!("{tolerance}"), right: "it must lie in 0.001..1, such as 0.05".into() });
    }
    let Ratio { ratio, between, reason, seconds: searching } = ratio(engine, volume, medium, request, progress)?;
    let mut reasons = vec![reason];
    let base = Visibility {
        method: Method::March,
        sampling: Sampling::Stratified,
        ratio,
        bands: request.bands,
        bits: 32,
        cells: request.cells,
        ..Visibility::default()
    };
    // Cells apart from those of `measure`: its verdict is not on what was tuned.
    let drawn = measure::draw(measure::near(engine, volume, medium, ratio, &mut |_, _| progress("plan", 0.0))?, MOST_CELLS, SEED);
    let wanted = engine.wanted_cells(medium, &base)?.len() as f64;
    let cells = drawn[..drawn.len().min(CELLS[1])].to_vec();
    let mut bench = Bench {
        engine,
        medium,
        cells,
        bands: request.bands,
        tried: Vec::new(),
        limit: FLOOR_SECONDS,
        seconds: if pace.is_some() { 0.0 } else { searching },
        pace,
        progress,
    };
    let mut plan = Plan {
        need: engine.need(medium, &base, request.pixels)?,
        settings: Visibility { method: Method::Sweep, directions: LEAST, bits: request.bits.unwrap_or(8), ..base.clone() },
        tolerance,
        between,
        predicted: FieldError { relative_l2: 0.0, interval: [0.0; 2] },
        seconds: 0.0,
        reasons: Vec::new(),
        tried: Vec::new(),
        planning_seconds: 0.0,
        planning_limit: FLOOR_SECONDS,
        cells: Vec::new(),
        more: Vec::new(),
        truth: Vec::new(),
        dense: base.clone(),
        dense_seconds: 0.0,
        wanted,
        law: Law { a: 0.0, p: 1.0 },
        sweeps: Sweeps::new(Law { a: 0.0, p: 1.0 }, vec![(1.0, 0.0)], ratio, ((1, 1.0), 1.0), 0.0),
        marches: Vec::new(),
        packing: 0.0,
        margin: MARGIN[0],
        key,
    };
    if drawn.is_empty() {
        reasons.push("nothing to see: no cell lies near matter, so anything is exact".into());
        plan.need = engine.need(medium, &plan.settings, request.pixels)?;
        plan.reasons = reasons;
        return Ok(plan);
    }

    // Pilots, and by them the budget.
    let step = f32::min(2.0, ratio as f32);
    let sweep = |directions, (near, step)| Visibility { method: Method::Sweep, directions, near, step, ..base.clone() };
    let march = Visibility { directions: PILOT[0], step: 0.5, ..base.clone() };
    bench.warm(&march)?;
    let (_, marched) = bench.run(&march)?;
    let marched = marched / (f64::from(PILOT[0]) * bench.cells.len() as f64);
    bench.warm(&sweep(1, (1, step)))?;
    // The first of the sweeps that are measured, too: all cells that may be taken are kept.
    let shape = (1, step);
    let mut first = bench.run_at(&sweep(PILOT[1], shape), &drawn[..drawn.len().min(CELLS[5])])?;
    let swept = first.1 / f64::from(PILOT[1]);
    // A march in long steps takes a third of one in short ones.
    let usual = f64::min(USUAL[1] * swept, wanted * marched / 3.0) * (USUAL[0] / tolerance).max(f64::from(LEAST));
    bench.limit = f64::max(FLOOR_SECONDS, SHARE * usual);

    bench.cells.clone_from(&drawn);
    let known = truth(&mut bench, &base, key, tolerance, marched)?;
    plan.pack(request, &known.v, &mut reasons)?;
    plan.law = known.law;
    plan.margin = known.margin.clamp(MARGIN[0], MARGIN[1]);
    let steps: Vec<(f32, f64)> = known.marches.iter().map(|m| (m.step, m.own[0])).collect();
    // Sweeps in the longest step that costs little, not in steps that thin walls fall through.
    let small = |s: &&(f32, f64)| s.0 <= step && STEPPED * s.1 <= SMALL * tolerance;
    let longest = steps.iter().find(small).or(steps.last()).map_or(step, |s| s.0);
    plan.sweeps = Sweeps::new(known.law, steps, ratio, (shape, longest), swept);
    // The pilot and one of more directions, then one of what is chosen, as far as there is time.
    let mut cut = known.cut;
    first.0.truncate(known.v.len());
    let mut runs = Vec::new();
    let mut note = |bench: &mut Bench, margin: &mut f64, n: u32, run: &Run| {
        let error = bench.judge(&sweep(n, shape), run, &known.v, "the reference");
        *margin = margin.max(half_width(&error)).clamp(MARGIN[0], MARGIN[1]);
        runs.push((n, error.relative_l2, run.1));
    };
    note(&mut bench, &mut plan.margin, PILOT[1], &first);
    let most = plan.sweeps.directions(shape, tolerance * tolerance).unwrap_or(SECOND[0]).max(SECOND[2]);
    let left = bench.left();
    let fits = |n: &u32| *n <= most && f64::from(*n) * swept <= if *n == SECOND[2] { left } else { 0.6 * left };
    match SECOND.into_iter().find(fits) {
        Some(n) => {
            let run = bench.run(&sweep(n, shape))?;
            note(&mut bench, &mut plan.margin, n, &run);
        }
        None => {
            let of = format!("one sweep of {} directions", PILOT[1]);
            cut = Some(cut.map_or(of.clone(), |c| format!("{c}, {of}")));
        }
    }
    plan.sweeps.measured(&runs);
    let mut best = plan.best();
    if let Some(b) = best.filter(|b| b.method == Method::Sweep && (b.near, b.step) != shape) {
        let each = plan.sweeps.each((b.near, b.step));
        let n = ((0.8 * bench.left() / each) as u32 / 8 * 8).min(b.directions);
        if n >= LEAST {
            let settings = sweep(n, (b.near, b.step));
            bench.warm(&settings)?;
            let run = bench.run(&settings)?;
            let error = bench.judge(&settings, &run, &known.v, "the reference");
            plan.sweeps.learn((b.near, b.step), n, error.relative_l2);
            plan.margin = plan.margin.max(half_width(&error)).clamp(MARGIN[0], MARGIN[1]);
            best = plan.best();
        }
    }
    log::debug!("{:?}; {best:?}", plan.sweeps);
    if let Some(cut) = cut {
        reasons.push(format!(
            "planning stopped after {:.1} s with {cut} for want of time: the predicted error is extrapolated",
            bench.seconds
        ));
    }
    if let Some(longer) = known.longer {
        reasons.push(format!("planning took longer than it should: to judge {tolerance} takes {longer}"));
    }
    plan.reasons = reasons;
    plan.pick()?;
    if bench.finished().is_break() {
        return Err(Error::Cancelled);
    }
    (plan.tried, plan.planning_seconds, plan.planning_limit) = (bench.tried, bench.seconds, bench.limit);
    plan.more = drawn[bench.cells.len()..].to_vec();
    plan.dense_seconds = plan.marches.last().map_or(0.0, |m: &March| m.seconds * f64::from(known.settings.directions));
    (plan.cells, plan.truth, plan.dense) = (bench.cells, known.v, known.settings);
    plan.need = engine.need(medium, &plan.settings, request.pixels)?;
    // Planning has swept already.
    plan.need.scratch = plan.need.scratch.max(engine.need(medium, &sweep(PILOT[1], shape), request.pixels)?.scratch);
    Ok(plan)
}

impl Plan {
    /// Bits: 8 where their share of the error is small.
    fn pack(&mut self, request: &Request, truth: &[[f32; 16]], reasons: &mut Vec<String>) -> Result<()> {
        let tolerance = self.tolerance;
        let of = |bits: u32| errors(&measure::packed(truth, request.bands, bits), truth, request.bands).kept.relative_l2;
        let eight = of(8);
        let bits = request.bits.unwrap_or(if eight * eight <= 0.1 * tolerance * tolerance { 8 } else { 16 });
        self.packing = if bits == 8 { eight } else { of(bits) };
        self.settings.bits = bits;
        reasons.push(match request.bits {
            Some(_) => format!("{bits} bits as asked: they add {:.4}, in quadrature", self.packing),
            None if bits == 8 => format!("8 bits: they add {eight:.4}, in quadrature"),
            None => format!("16 bits: 8 would add {eight:.4}, a large part of {tolerance}"),
        });
        if self.packing * (1.0 + self.margin) >= tolerance {
            let why = format!("{bits} bits alone cost as much; take visibility.bits 16");
            return Err(unreachable(self.key, tolerance, self.packing * (1.0 + self.margin), &why));
        }
        Ok(())
    }

    /// The cheapest settings whose predicted error, with its interval and what the prediction may be off by, is within the
    /// tolerance.
    fn best(&self) -> Option<Choice> {
        let packing2 = self.packing * self.packing;
        let budget = |doubt: f64| (self.tolerance / ((1.0 + AIM * self.margin) * (1.0 + doubt))).powi(2) - packing2;
        let swept = self.sweeps.shapes().filter_map(|shape| {
            // What is in doubt depends on the number of directions.
            let (directions, doubt) = DOUBTS.into_iter().find_map(|doubt| {
                let n = self.sweeps.directions(shape, budget(doubt))?;
                (self.sweeps.doubt(shape, n) <= doubt).then_some((n, doubt))
            })?;
            let (error, own) = (self.sweeps.error(shape, directions), self.sweeps.own(shape));
            let seconds = self.sweeps.seconds(shape, directions);
            Some(Choice { method: Method::Sweep, directions, near: shape.0, step: shape.1, error, own, doubt, seconds })
        });
        let marched = self.marches.iter().filter_map(|m| {
            let error2 = |n: u32| self.law.error(n).powi(2) + m.own2(n);
            let doubt = DOUBTS[0];
            let directions = (LEAST / 8..=MOST_MARCHED / 8).map(|n| 8 * n).find(|&n| error2(n) <= budget(doubt))?;
            let seconds = m.seconds * self.wanted * f64::from(directions);
            let (error, own) = (error2(directions).sqrt(), m.own2(directions).sqrt());
            Some(Choice { method: Method::March, directions, near: 1, step: m.step, error, own, doubt, seconds })
        });
        swept.chain(marched).min_by(|a, b| f64::total_cmp(&a.seconds, &b.seconds))
    }

    /// Takes [`Plan::best`]; says why.
    pub(super) fn pick(&mut self) -> Result<()> {
        let packing = self.packing;
        let Some(best) = self.best() else {
            let shapes = self.sweeps.shapes().map(|s| self.sweeps.error(s, crate::scene::visibility::MAX_SWEPT));
            let marches = self.marches.iter().map(|m| self.law.error(MOST_MARCHED).hypot(m.own2(MOST_MARCHED).sqrt()));
            let reach = shapes.chain(marches).fold(f64::INFINITY, f64::min).hypot(packing) * (1.0 + self.margin) * (1.0 + DOUBTS[2]);
            return Err(unreachable(self.key, self.tolerance, reach, "no estimator comes closer here"));
        };
        let Choice { method, directions, near, step, error, own, doubt, seconds } = best;
        self.settings = Visibility { method, directions, near, step, ..self.settings.clone() };
        self.seconds = seconds;
        let error = error.hypot(packing);
        let wide = (1.0 + self.margin) * (1.0 + doubt);
        self.predicted = FieldError { relative_l2: error, interval: [error / wide, error * wide] };
        let why = if method == Method::Sweep { "the cheapest that meets it" } else { "a march is cheaper than any sweep here" };
        let parts = if method == Method::Sweep { "slices and steps" } else { "steps" };
        let (rest, doubt) = (self.predicted.relative_l2.powi(2) - own * own - packing * packing, 100.0 * doubt);
        self.reasons.push(format!(
            "{}: {why}; {directions} directions leave about {:.4}, its {parts} {own:.4}, give or take {doubt:.0} %",
            name(method),
            rest.max(0.0).sqrt()
        ));
        Ok(())
    }
}

/// Settings with what is predicted of them.
#[derive(Clone, Copy, Debug)]
struct Choice {
    method: Method,
    directions: u32,
    near: u32,
    step: f32,
    /// Before packing, and the part of it that directions do not change.
    error: f64,
    own: f64,
    /// What the prediction may be off by, relative.
    doubt: f64,
    /// Device seconds.
    seconds: f64,
}

/// The sentence for what cannot be had.
pub(super) fn unreachable(key: &'static str, tolerance: f64, least: f64, why: &str) -> Error {
    // Two digits, upwards.
    let unit = 10f64.powf(least.max(1e-6).log10().floor() - 1.0);
    let least = (least / unit).ceil() * unit;
    let digits = (1.0 - least.log10().floor()).max(2.0) as usize;
    Error::Invalid { item: key, what: format!("{tolerance} is out of reach"), right: format!("{why}; ask for {least:.digits$} or more") }
}
