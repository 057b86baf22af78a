//! From what is asked for to settings, by measuring.

use super::law::{Law, Shape, shapes, spread};
use super::{Candidate, Plan, Request, method as name};
use crate::engine::{Engine, Medium, Progress};
use crate::error::{Error, Result};
use crate::measure::{self, FieldError, REFERENCE_DIRECTIONS, REFERENCE_STEP, errors};
use crate::scene::visibility::{Cells, Method, Quality, Sampling, Wanted};
use crate::scene::{Grid, Visibility, Volume};
use std::time::Instant;

/// Cells that candidates are measured at, and the fewest.
const PROBES: [usize; 2] = [256, 64];

/// Seconds of device time that the reference should take at most.
const REFERENCE_SECONDS: f64 = 20.0;

/// Directions of the two marches that give the law of quadrature.
const FEW: u32 = 64;
const MANY: u32 = 256;

/// Directions with which shapes of the sweep are measured, at least and at most; a sweep of half of them goes before.
const PILOT: [u32; 2] = [96, 256];

/// What quadrature is taken for before it is known: q(N) = 1.2·N^−¾.
const PRIOR: f64 = 1.2;

/// Most directions of a march that a plan takes.
const MOST_MARCHED: u32 = 2 * REFERENCE_DIRECTIONS;

/// Fewer directions do not tell 16 harmonics apart.
const LEAST: u32 = 32;

/// Cells of a field that a plan makes finer than it would, because the volume is thin.
const MOST_THIN: usize = 1 << 20;

/// Finds the cheapest settings that meet `request`. Takes the engine's timings.
///
/// # Errors
/// [`Error::Invalid`] on `visibility.tolerance` (or `.quality`) for what is out of reach, [`Error::OutOfMemory`], and as
/// [`Engine::estimate`].
pub fn choose(engine: &Engine, volume: &Volume, medium: &Medium, request: &Request, progress: &mut Progress) -> Result<Plan> {
    let key = match request.wanted {
        Wanted::Tolerance(_) => "visibility.tolerance",
        Wanted::Quality(_) => "visibility.quality",
    };
    let tolerance = request.wanted.tolerance();
    if !(0.001..=1.0).contains(&tolerance) {
        return Err(Error::Invalid { item: key, what: format!("{tolerance}"), right: "it must lie in 0.001..1, such as 0.05".into() });
    }
    let mut reasons = Vec::new();
    let ratio = ratio(engine, medium, request, &mut reasons)?;
    let base = Visibility {
        method: Method::March,
        sampling: Sampling::Stratified,
        ratio,
        bands: request.bands,
        bits: 32,
        cells: request.cells,
        ..Visibility::default()
    };
    let mut bench = Bench { engine, medium, cells: Vec::new(), bands: request.bands, tried: Vec::new(), seconds: 0.0, progress };

    // Probes apart from those of `measure`: its verdict is not on what was tuned.
    let near = measure::near_matter(volume, medium, ratio);
    let all = match request.cells {
        Cells::All => medium.grid().field_dims(ratio as usize).iter().product(),
        Cells::Matter => near.len(),
    };
    bench.cells = measure::draw(near, PROBES[0], SEED);
    if bench.cells.is_empty() {
        let settings = Visibility { method: Method::Sweep, directions: LEAST, bits: request.bits.unwrap_or(8), ..base };
        let none = FieldError { relative_l2: 0.0, interval: [0.0; 2] };
        reasons.push("nothing to see: no cell lies near matter, so anything is exact".into());
        let shape =
            Shape { near: settings.near, step: settings.step, law: Law { a: 0.0, p: 1.0 }, error: 0.0, seen: None, seconds: [0.0; 2] };
        return Ok(Plan {
            need: engine.need(medium, &settings, request.pixels)?,
            settings,
            tolerance,
            predicted: none,
            seconds: 0.0,
            reasons,
            tried: Vec::new(),
            planning_seconds: 0.0,
            cells: Vec::new(),
            truth: Vec::new(),
            law: Law { a: 0.0, p: 1.0 },
            shapes: vec![shape],
            marches: Vec::new(),
            packing: 0.0,
            margin: 0.0,
            key,
        });
    }

    // The reference.
    let (mut directions, step) = if tolerance < 0.03 { (REFERENCE_DIRECTIONS, REFERENCE_STEP) } else { (REFERENCE_DIRECTIONS / 4, 0.5) };
    let dense = |directions| Visibility { directions, step, ..base.clone() };
    // Whatever a kernel's first dispatch costs is not the pilot's.
    let first = vec![bench.cells[0]];
    bench.run(&dense(1), Some(&first), 0.02)?;
    let (_, pilot) = bench.run(&dense(16), None, 0.04)?;
    let predicted = pilot * f64::from(directions) / 16.0;
    if predicted > REFERENCE_SECONDS {
        let count = (bench.cells.len() as f64 * REFERENCE_SECONDS / predicted) as usize;
        bench.cells.truncate(count.max(PROBES[1]));
    }
    bench.cells.sort_unstable();
    let (mut truth, _) = bench.run(&dense(directions), None, 0.3)?;

    // Quadrature.
    let (few, few_seconds) = bench.run(&dense(FEW), None, 0.32)?;
    let (many, many_seconds) = bench.run(&dense(MANY), None, 0.38)?;
    let against = "the reference";
    let runs = [(FEW, (&few[..], few_seconds)), (MANY, (&many[..], many_seconds))];
    let mut q = runs.map(|(n, v)| bench.judge(dense(n), v, &truth, against));
    let mut law = Law::through((FEW, q[0].relative_l2), (MANY, q[1].relative_l2));
    if law.error(directions) > 0.25 * tolerance && directions < REFERENCE_DIRECTIONS {
        // Thin, scattered matter: few directions meet it, so the reference takes more.
        directions = REFERENCE_DIRECTIONS;
        truth = bench.run(&dense(directions), None, 0.4)?.0;
        q = runs.map(|(n, v)| bench.judge(dense(n), v, &truth, against));
        law = Law::through((FEW, q[0].relative_l2), (MANY, q[1].relative_l2));
    }
    let margin = half_width(&q[0]).max(half_width(&q[1])).max(0.05);
    if law.error(directions) > 0.5 * tolerance {
        return Err(unreachable(key, tolerance, 2.0 * law.error(directions), "the reference itself is no surer than half of it"));
    }

    // Packing: 8 bits where their share of the error is small.
    let packing_of = |bits: u32| errors(&measure::packed(&truth, request.bands, bits), &truth, request.bands).kept.relative_l2;
    let eight = packing_of(8);
    let bits = request.bits.unwrap_or(if eight * eight <= 0.1 * tolerance * tolerance { 8 } else { 16 });
    let packing = if bits == 8 { eight } else { packing_of(bits) };
    match request.bits {
        Some(_) => reasons.push(format!("{bits} bits as asked: they add {packing:.4}, in quadrature")),
        None if bits == 8 => reasons.push(format!("8 bits: they add {eight:.4}, in quadrature")),
        None => reasons.push(format!("16 bits: 8 would add {eight:.4}, a large part of {tolerance}")),
    }
    let budget = (tolerance / (1.0 + margin)).powi(2) - packing * packing;
    if budget <= 0.0 {
        return Err(unreachable(
            key,
            tolerance,
            packing * (1.0 + margin),
            &format!("{bits} bits alone cost as much; take visibility.bits 16"),
        ));
    }

    // Shapes of the sweep, cheapest first, until one takes little of the budget or costs less than the next one's look.
    let sweep = |directions, (near, step)| Visibility { method: Method::Sweep, directions, near, step, ..base.clone() };
    let list = shapes(ratio);
    bench.run(&sweep(1, list[0]), None, 0.4)?;
    let most = ((PRIOR / tolerance).powf(4.0 / 3.0) as u32).clamp(PILOT[0], PILOT[1]);
    let least = most / 2;
    let (v, fixed) = bench.run(&sweep(least, list[0]), None, 0.45)?;
    let coarse = bench.judge(sweep(least, list[0]), (&v, fixed), &truth, against).relative_l2;
    let mut found: Vec<Shape> = Vec::new();
    let (mut at, mut a2, mut once) = (0, 0.0, 0.0);
    while let Some(&shape) = list.get(at) {
        let (v, seconds) = bench.run(&sweep(most, shape), None, 0.5 + 0.08 * at as f32)?;
        let error = bench.judge(sweep(most, shape), (&v, seconds), &truth, against).relative_l2;
        if at == 0 {
            a2 = spread((least, coarse), (most, error));
            let each = ((seconds - fixed) / f64::from(most - least)).max(0.0);
            once = (fixed - each * f64::from(least)).max(0.0);
        }
        let each = (seconds - once).max(0.0) / f64::from(most);
        let one = Shape::through(shape, (most, error), a2, [once, each]);
        found.push(one);
        if one.error * one.error <= 0.25 * budget || one.within(budget, LEAST).is_some_and(|(_, s)| s <= seconds) {
            break;
        }
        // Far off, the next shape would be too.
        at += if one.error * one.error > 4.0 * budget { 2 } else { 1 };
    }

    // The dearer ones are guessed; cheaper ones that were passed over were too far off.
    if let Some(&last) = found.last() {
        let from = list.iter().position(|&s| s == (last.near, last.step)).unwrap_or(list.len());
        found.extend(list.iter().skip(from + 1).map(|&shape| last.guess(shape)));
    }

    // What a march would cost, and what its steps cost in error.
    let scale = all as f64 / bench.cells.len() as f64;
    let mut marches = vec![(step, 0.0, many_seconds / f64::from(MANY) * scale)];
    for longer in [1.0f32, 2.0].into_iter().filter(|&s| s > step && s <= 2.0) {
        let settings = Visibility { step: longer, ..dense(FEW) };
        let (v, seconds) = bench.run(&settings, None, 0.95)?;
        let error = bench.judge(settings, (&v, seconds), &few, "a march in shorter steps").relative_l2;
        marches.push((longer, error, seconds / f64::from(FEW) * scale));
    }

    let (tried, planning_seconds, cells) = (std::mem::take(&mut bench.tried), bench.seconds, std::mem::take(&mut bench.cells));
    let mut plan = Plan {
        need: engine.need(medium, &base, request.pixels)?,
        settings: Visibility { bits, ..base },
        tolerance,
        predicted: q[0],
        seconds: 0.0,
        reasons,
        tried,
        planning_seconds,
        cells,
        truth,
        law,
        shapes: found,
        marches,
        packing,
        margin,
        key,
    };
    plan.pick(tolerance / (1.0 + margin))?;
    plan.need = engine.need(medium, &plan.settings, request.pixels)?;
    if (bench.progress)("plan", 1.0).is_break() {
        return Err(Error::Cancelled);
    }
    Ok(plan)
}

impl Plan {
    /// Takes the cheapest settings whose predicted error is `target`; says why.
    pub(super) fn pick(&mut self, target: f64) -> Result<()> {
        let packing = self.packing;
        let budget = target * target - packing * packing;
        let swept = self.shapes.iter().filter_map(|s| {
            let (n, seconds) = s.within(budget, LEAST)?;
            Some((Method::Sweep, n, s.near, s.step, s.law, s.error, seconds))
        });
        let marched = self.marches.iter().filter_map(|&(step, own, each)| {
            let n = self.law.directions(budget - own * own, LEAST).filter(|&n| n <= MOST_MARCHED)?;
            Some((Method::March, n, 1, step, self.law, own, each * f64::from(n)))
        });
        let best = swept.chain(marched).min_by(|a, b| f64::total_cmp(&a.6, &b.6));
        let Some((method, directions, near, step, law, own, seconds)) = best else {
            let least = self.marches.iter().map(|m| m.1 * m.1).fold(f64::INFINITY, f64::min);
            let reach = (self.law.error(MOST_MARCHED).powi(2) + least + packing * packing).sqrt() * (1.0 + self.margin);
            return Err(unreachable(self.key, self.tolerance, reach, "no estimator comes closer here"));
        };
        self.settings = Visibility { method, directions, near, step, ..self.settings.clone() };
        self.seconds = seconds;
        let error = (law.error(directions).powi(2) + own * own + packing * packing).sqrt();
        self.predicted = FieldError { relative_l2: error, interval: [error / (1.0 + self.margin), error * (1.0 + self.margin)] };
        let why = match method {
            Method::Sweep => "the cheapest that meets it",
            _ if self.shapes.iter().any(|s| s.within(budget, LEAST).is_some()) => "a march is cheaper than any sweep here",
            _ => "no sweep comes close enough",
        };
        let steps = if method == Method::Sweep { "slices and steps" } else { "steps" };
        let q = law.error(directions);
        self.reasons.push(format!("{}: {why}; {directions} directions leave about {q:.4}, its {steps} {own:.4}", name(method)));
        Ok(())
    }
}

/// The sentence for what cannot be had.
pub(super) fn unreachable(key: &'static str, tolerance: f64, least: f64, why: &str) -> Error {
    // Two digits, upwards.
    let unit = 10f64.powf(least.max(1e-6).log10().floor() - 1.0);
    let least = (least / unit).ceil() * unit;
    let digits = (1.0 - least.log10().floor()).max(2.0) as usize;
    Error::Invalid { item: key, what: format!("{tolerance} is out of reach"), right: format!("{why}; ask for {least:.digits$} or more") }
}

/// Voxels per cell.
fn ratio(engine: &Engine, medium: &Medium, request: &Request, reasons: &mut Vec<String>) -> Result<u32> {
    let grid: &Grid = medium.grid();
    let least = Visibility {
        method: Method::Sweep,
        bits: request.bits.unwrap_or(8),
        bands: request.bands,
        directions: 512,
        ..Visibility::default()
    };
    let peak = |ratio| engine.need(medium, &Visibility { ratio, ..least.clone() }, request.pixels).map(|need| need.least());
    if let Some(ratio) = request.ratio {
        reasons.push(format!("1:{ratio} as asked"));
        return Ok(ratio);
    }
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
    reasons.push(reason);
    Ok(ratio)
}

/// The larger relative half of an interval.
fn half_width(e: &FieldError) -> f64 {
    if e.relative_l2 > 0.0 { (e.interval[1] / e.relative_l2 - 1.0).max(0.0) } else { 0.0 }
}

/// The seed of the plan's own cells: others than `--measure` draws.
const SEED: u64 = 0x70_6c61_6e00;

/// Runs candidates and keeps what they showed.
struct Bench<'a, 'p> {
    engine: &'a Engine,
    medium: &'a Medium,
    cells: Vec<u32>,
    bands: u32,
    tried: Vec<Candidate>,
    seconds: f64,
    progress: &'a mut Progress<'p>,
}

impl Bench<'_, '_> {
    /// Coefficients at the cells (or at `cells`), and the seconds that they took. `done` is the share of planning that is
    /// done afterwards.
    fn run(&mut self, settings: &Visibility, cells: Option<&[u32]>, done: f32) -> Result<(Vec<[f32; 16]>, f64)> {
        let start = Instant::now();
        self.engine.take_timings();
        let cells = cells.unwrap_or(&self.cells);
        let v = self.engine.estimate(self.medium, settings, cells, &mut |_, _| (self.progress)("plan", done.min(1.0)))?;
        let seconds = super::compute::seconds(self.engine, start);
        self.seconds += seconds;
        Ok((v, seconds))
    }

    /// The error of `v` against `truth`, kept among what was tried.
    fn judge(&mut self, settings: Visibility, (v, seconds): (&[[f32; 16]], f64), truth: &[[f32; 16]], against: &'static str) -> FieldError {
        let error = errors(v, truth, self.bands).kept;
        self.tried.push(Candidate { settings, error, against, seconds });
        error
    }
}
