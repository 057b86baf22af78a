//! Field error against time: the candidates of one subject, as many as its time allows.

use super::candidates::{self, taps};
use super::{Clock, FieldPoint, Options, Reference, Subject, SubjectReport, Timing, median, pareto, seconds, timed};
use crate::engine::{Engine, Medium};
use crate::error::Result;
use crate::measure;
use crate::scene::visibility::Method;
use crate::scene::{Grid, Scene, Visibility};
use crate::stages::directions::SplitMix;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Shares of a subject's time: until when its reference, its own ratio's candidates, and the other ratios may run.
const UNTIL: [f64; 3] = [0.13, 0.4, 0.75];

/// Candidates that are measured even when late: without them there is no chart.
const FIRST: usize = 4;

/// Fewest probes that an error is quoted from.
const LEAST_PROBES: usize = 64;

/// Cells that a first guess of costs is made from.
const PILOT: usize = 128;

/// Cells whose time stands for the whole field's.
const TIMED_CELLS: usize = 2048;

/// Share of a subject's time up to which a field is computed whole, although some cells would do.
const CHEAP: f64 = 0.02;

/// Cells in a row of those: a kernel's neighbours work on neighbours.
const RUN: usize = 64;

/// What fields cost, learned from those that were computed: wall seconds by method, once and per (cell, direction, tap).
#[derive(Clone, Default)]
pub struct Costs(BTreeMap<&'static str, (f64, f64)>);

impl Costs {
    fn key(method: Method) -> &'static str {
        match method {
            Method::March => "march",
            Method::Hierarchical => "hierarchical",
            Method::Sweep => "sweep",
        }
    }

    /// Seconds of `cells` cells.
    fn of(&self, v: &Visibility, grid: &Grid, cells: usize) -> f64 {
        let (once, each) = self.0.get(Self::key(v.method)).copied().unwrap_or_default();
        once + each * cells as f64 * f64::from(v.directions) * taps(v, grid)
    }

    /// Seconds of a whole field.
    pub fn whole(&self, v: &Visibility, grid: &Grid) -> f64 {
        self.of(v, grid, grid.field_dims(v.ratio as usize).iter().product())
    }

    fn learn(&mut self, v: &Visibility, grid: &Grid, cells: usize, times: &[(&'static str, f64)]) {
        let (once, each) = once_and_each(times);
        let work = cells as f64 * f64::from(v.directions) * taps(v, grid);
        self.0.insert(Self::key(v.method), (once, each / work.max(1.0)));
    }
}

/// Seconds that do not grow with the number of cells (the pyramid), and those that do.
fn once_and_each(times: &[(&'static str, f64)]) -> (f64, f64) {
    let (once, each): (Vec<_>, Vec<_>) = times.iter().copied().partition(|t| ["classify", "minify"].contains(&t.0));
    (seconds(&once), seconds(&each))
}

/// Coefficients of cells, and seconds per kernel.
type Estimate = (Vec<[f32; 16]>, Vec<(&'static str, f64)>);

/// One ratio's measuring.
struct At<'a> {
    engine: &'a Engine,
    medium: &'a Medium,
    ratio: u32,
    probes: Vec<u32>,
    reference: Vec<[f32; 16]>,
    /// The cells that the field holds.
    cells: Vec<u32>,
    /// Wall seconds up to which a field is computed whole.
    cheap: f64,
    costs: Costs,
}

/// Where and with what fields are measured.
pub struct Fields<'a> {
    /// The device.
    pub engine: &'a Engine,
    /// Whose fields.
    pub subject: &'a Subject,
    /// Its matter.
    pub medium: &'a Medium,
    /// How much.
    pub options: &'a Options,
}

/// Fills `report` with the fields of a subject at its own ratio, and returns what they cost.
pub fn own(f: &Fields, clock: &mut Clock, report: &mut SubjectReport) -> Result<Costs> {
    let ratio = f.subject.ratio;
    let mut at = f.at(ratio, f.options.probes, Costs::default(), clock)?;
    at.pilot(clock)?;
    let most = at.affordable(clock.left(UNTIL[0]), f.options.probes).max(LEAST_PROBES);
    at.begin(f, ratio, most, clock, report)?;
    at.list(candidates::of_estimators(ratio), FIRST, UNTIL[1], clock, report)?;
    Ok(at.costs)
}

/// The same at the ratios beside it, one coarser and one finer, with what time is left.
pub fn others(f: &Fields, costs: &Costs, clock: &mut Clock, report: &mut SubjectReport) -> Result<()> {
    let own = f.subject.ratio;
    for (ratio, share) in [(own * 2, 0.2), (own / 2, 0.35)].into_iter().filter(|(r, _)| [1, 2, 4, 8].contains(r)) {
        let most = f.options.probes / 4;
        let mut at = f.at(ratio, most, costs.clone(), clock)?;
        let count = at.affordable(share * clock.left(UNTIL[2]), most);
        if count < LEAST_PROBES.min(at.probes.len()) {
            report.left_out.push(format!("1:{ratio}: no time for its reference"));
            continue;
        }
        at.begin(f, ratio, count, clock, report)?;
        at.list(candidates::of_ratio(ratio), 0, UNTIL[2], clock, report)?;
    }
    Ok(())
}

impl<'a> Fields<'a> {
    fn at(&self, ratio: u32, probes: usize, costs: Costs, clock: &Clock) -> Result<At<'a>> {
        let (engine, medium) = (self.engine, self.medium);
        let cells = engine.wanted_cells(medium, &Visibility { ratio, ..Visibility::default() })?;
        let probes = measure::probes(engine, &self.subject.volume, medium, ratio, probes.max(LEAST_PROBES))?;
        Ok(At { engine, medium, ratio, probes, reference: Vec::new(), cells, cheap: CHEAP * clock.share, costs })
    }
}

impl At<'_> {
    /// Each method once, for drivers compile at a kernel's first dispatch, and then once more for what it costs.
    fn pilot(&mut self, clock: &mut Clock) -> Result<()> {
        let cells: Vec<u32> = self.probes.iter().copied().step_by(self.probes.len().div_ceil(PILOT).max(1)).collect();
        for method in [Method::March, Method::Hierarchical, Method::Sweep] {
            for directions in [8, 16] {
                let v = Visibility { method, directions, ratio: self.ratio, bits: 32, ..Visibility::default() };
                self.estimate(&v, &cells, clock)?;
            }
        }
        Ok(())
    }

    /// Probes, up to `most`, whose reference `allowed` seconds are predicted to pay.
    fn affordable(&self, allowed: f64, most: usize) -> usize {
        let each = self.costs.of(&dense(self.ratio), self.medium.grid(), 1);
        if each > 0.0 { ((allowed / each) as usize).min(most) } else { most }
    }

    /// The reference at up to `most` probes.
    fn begin(&mut self, f: &Fields, ratio: u32, most: usize, clock: &mut Clock, report: &mut SubjectReport) -> Result<()> {
        self.probes = measure::probes(self.engine, &f.subject.volume, self.medium, ratio, most)?;
        let (reference, times) =
            timed(self.engine, || measure::reference(self.engine, self.medium, ratio, &self.probes, &mut |_, _| clock.tick()))?;
        self.reference = reference;
        let v = dense(ratio);
        let (probes, seconds) = (self.probes.len(), seconds(&times));
        report.references.push(Reference { ratio, probes, directions: v.directions, step: v.step, seconds });
        Ok(())
    }

    /// The settings of a list that `until` allows, the first few in any case, and the front of all of them.
    fn list(&mut self, list: Vec<Visibility>, first: usize, until: f64, clock: &mut Clock, report: &mut SubjectReport) -> Result<()> {
        let (from, mut late) = (report.fields.len(), Vec::new());
        for (i, v) in list.into_iter().enumerate() {
            let (predicted, whole) = self.predicted(&v);
            if i >= first && predicted > clock.left(until) {
                late.push(format!("{} (about {} s)", candidates::name(&v), super::axis::number(predicted)));
                continue;
            }
            report.fields.push(self.point(&v, whole, clock)?);
        }
        if !late.is_empty() {
            report.left_out.push(format!("1:{}: {}", self.ratio, late.join("; ")));
        }
        // A time that was measured once has no bar.
        let ranges: Vec<_> = report.fields[from..].iter().map(|p| [p.spread.unwrap_or([p.seconds; 2]), p.interval]).collect();
        report.fields[from..].iter_mut().zip(pareto::front(&ranges)).for_each(|(p, front)| p.front = front);
        Ok(())
    }

    /// Wall seconds that a setting will take, and whether its whole field is computed: where that is cheap.
    fn predicted(&self, v: &Visibility) -> (f64, bool) {
        let part = self.probes.len() + TIMED_CELLS;
        let all = self.costs.of(v, self.medium.grid(), self.cells.len());
        match v.method == Method::Sweep || all <= self.cheap || self.cells.len() <= part {
            true => (all, true),
            false => (self.costs.of(v, self.medium.grid(), part), false),
        }
    }

    /// Coefficients of some cells, and the seconds of each kernel. Learns what the method costs.
    fn estimate(&mut self, v: &Visibility, cells: &[u32], clock: &mut Clock) -> Result<Estimate> {
        let done = timed(self.engine, || self.engine.estimate(self.medium, v, cells, &mut |_, _| clock.tick()))?;
        let worked = if v.method == Method::Sweep { self.cells.len() } else { cells.len() };
        self.costs.learn(v, self.medium.grid(), worked, &done.1);
        Ok(done)
    }

    /// Measures one setting.
    fn point(&mut self, v: &Visibility, whole: bool, clock: &mut Clock) -> Result<FieldPoint> {
        clock.check()?;
        // A sweep visits every cell whichever are asked for.
        let asked: Vec<u32> = match whole && v.method != Method::Sweep {
            true => self.cells.clone(),
            false => self.probes.clone(),
        };
        let (mut values, times) = self.estimate(v, &asked, clock)?;
        if asked.len() > self.probes.len() {
            let place = |p: &u32| asked.binary_search(p).ok().map(|i| values[i]);
            values = self.probes.iter().filter_map(place).collect();
        }
        let mut runs = Vec::new();
        if whole {
            runs.push(seconds(&times));
            // What is cheap is measured three times.
            while runs.len() < 3 && 3.0 * runs[0] < self.cheap {
                runs.push(seconds(&self.estimate(v, &asked, clock)?.1));
            }
        } else {
            let drawn: Vec<u32> = drawn_cells(self.cells.len(), TIMED_CELLS).into_iter().map(|i| self.cells[i as usize]).collect();
            let (once, each) = once_and_each(&self.estimate(v, &drawn, clock)?.1);
            runs.push(once + each * self.cells.len() as f64 / drawn.len() as f64);
        }
        let (seconds, spread) = median(runs);
        let error = measure::field_error(&values, &self.reference);
        let packed = [16, 8].map(|bits| measure::field_error(&measure::packed(&values, v.bands, bits), &self.reference).relative_l2);
        Ok(FieldPoint {
            name: candidates::name(v),
            ratio: v.ratio,
            settings: settings(v),
            seconds,
            spread,
            timing: if whole { Timing::Whole } else { Timing::Extrapolated },
            error: error.relative_l2,
            interval: error.interval,
            packed,
            front: false,
            visibility: v.clone(),
        })
    }
}

/// The reference's settings.
fn dense(ratio: u32) -> Visibility {
    let (directions, step) = (measure::REFERENCE_DIRECTIONS, measure::REFERENCE_STEP);
    Visibility { method: Method::March, directions, step, ratio, ..Visibility::default() }
}

/// About `count` cells of `cells`, in runs of neighbours at random places, ascending, from a fixed seed.
fn drawn_cells(cells: usize, count: usize) -> Vec<u32> {
    let runs = cells.div_ceil(RUN);
    let wanted = (count / RUN).clamp(1, runs);
    let mut random = SplitMix(0x0074_696d_6564);
    // One run in each of `wanted` equal parts.
    (0..wanted)
        .flat_map(|i| {
            let (from, to) = (i * runs / wanted, (i + 1) * runs / wanted);
            let run = from + (random.next() % (to - from).max(1) as u64) as usize;
            (run * RUN..((run + 1) * RUN).min(cells)).map(|c| c as u32)
        })
        .collect()
}

/// Every key of `[visibility]` with its value.
pub fn settings(v: &Visibility) -> BTreeMap<String, serde_json::Value> {
    let scene = Scene { visibility: v.clone(), ..Scene::of_volume(PathBuf::new()) };
    let table = toml::from_str::<BTreeMap<String, BTreeMap<String, serde_json::Value>>>(&crate::io::scene_text(&scene));
    table.ok().and_then(|mut t| t.remove("visibility")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_hold_every_key() {
        let map = settings(&Visibility { step: 0.1, ..Visibility::default() });
        // Tolerance and quality are wishes: what came of them is in the others.
        let chosen = crate::scene::keys::keys_of("visibility").into_iter().filter(|k| !["tolerance", "quality"].contains(k));
        for key in chosen {
            assert!(map.contains_key(key), "{key} is missing in {map:?}");
        }
        assert_eq!((&map["method"], &map["step"]), (&"sweep".into(), &0.1.into()));
    }

    #[test]
    fn drawn_cells_are_runs_all_over() {
        for (cells, count) in [(1, 64), (63, 64), (1000, 128), (100_000, 2048), (130, 4096)] {
            let drawn = drawn_cells(cells, count);
            assert!(!drawn.is_empty() && drawn.windows(2).all(|w| w[0] < w[1]), "{cells}");
            assert!(drawn.iter().all(|&c| (c as usize) < cells) && drawn.len() <= count.max(RUN).min(cells.max(RUN)));
        }
        let drawn = drawn_cells(100_000, 2048);
        assert!(drawn[0] < 10_000 && drawn[drawn.len() - 1] > 90_000 && drawn.len() > 1900);
    }
}
