//! What candidates are judged by: a dense march at some cells, no denser than the tolerance asks for.

use super::bench::{Bench, Run, systematic};
use super::choose::unreachable;
use super::law::Law;
use crate::error::Result;
use crate::measure::{FieldError, REFERENCE_DIRECTIONS};
use crate::scene::Visibility;

/// Cells, and directions of the reference, that a plan takes: from these, for time decides.
pub(super) const CELLS: [usize; 6] = [96, 128, 192, 256, 384, 512];
const DIRECTIONS: [u32; 8] = [384, 512, 768, 1024, 1536, 2048, 3072, REFERENCE_DIRECTIONS];

/// Directions of the two small sets, far enough apart that they share none, and of the larger one that gives the law of
/// quadrature with the second.
const FEW: [u32; 2] = [28, 37];
const MANY: u32 = 104;

/// Steps in voxels, longest first.
const STEPS: [f32; 4] = [2.0, 1.0, 0.5, 0.25];

/// The reference's own error should be at most this share of the tolerance; it must be at most half of it.
const SURE: f64 = 0.35;

/// The share of planning that the reference may take.
const PART: f64 = 0.62;

/// A march in some step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct March {
    /// Step, voxels.
    pub step: f32,
    /// What its step is off by: always, and with [`FEW`] directions.
    pub own: [f64; 2],
    /// Seconds per direction and cell.
    pub seconds: f64,
}

impl March {
    /// Error squared that the step adds with `n` directions.
    pub fn own2(&self, n: u32) -> f64 {
        self.own[0].powi(2) + self.own[1].powi(2) * 0.5 * f64::from(FEW[0] + FEW[1]) / f64::from(n)
    }
}

/// The reference, and what was learnt on the way to it.
pub(super) struct Truth {
    /// At the bench's cells.
    pub v: Vec<[f32; 16]>,
    /// How it was marched.
    pub settings: Visibility,
    /// Quadrature of marches.
    pub law: Law,
    /// Marches that were tried, longest step first; the last is the reference's.
    pub marches: Vec<March>,
    /// The larger relative half of an interval.
    pub margin: f64,
    /// What was cut short for want of time.
    pub cut: Option<String>,
    /// What there was no time for, and was needed all the same.
    pub longer: Option<String>,
}

/// Marches until candidates at `tolerance` can be told from the reference's own error; leaves the bench with the cells that
/// time allows. `seconds` is that of a direction at a cell in steps of ½ voxel, about.
pub(super) fn truth(bench: &mut Bench, base: &Visibility, key: &'static str, tolerance: f64, seconds: f64) -> Result<Truth> {
    let march = |directions, step| Visibility { directions, step, ..base.clone() };
    let kept = base.coefficients();
    let all = bench.cells.clone();
    let take = |bench: &mut Bench, count: usize| bench.cells = all[..count.min(all.len())].to_vec();
    // As many cells as there is time for with a usual reference.
    let ahead = f64::from(1024 + MANY + 2 * (FEW[0] + FEW[1]));
    let allowed = bench.seconds + PART * bench.left();
    let fits = |count: &&usize| **count as f64 * ahead * seconds <= PART * bench.left();
    let mut count = CELLS.iter().rev().find(fits).copied().unwrap_or(CELLS[0]).min(all.len());
    take(bench, count);

    // Steps: the longest one whose like, half as long, shows no more than a part of the tolerance.
    let mut runs: Vec<(f32, [Run; 2])> = Vec::new();
    for step in STEPS {
        runs.push((step, [bench.run(&march(FEW[0], step))?, bench.run(&march(FEW[1], step))?]));
        if let [.., (_, a), (_, b)] = &runs[..]
            && step <= 0.5
            && systematic([[&a[0], &b[0]], [&a[1], &b[1]]], kept)[0] <= 0.3 * tolerance
        {
            break;
        }
    }
    let Some((step, finest)) = runs.last().cloned() else { return Err(unreachable(key, tolerance, tolerance, "no step was tried")) };
    let marches: Vec<March> = runs
        .iter()
        .map(|(step, [a, b])| March {
            step: *step,
            own: systematic([[a, &finest[0]], [b, &finest[1]]], kept),
            seconds: (a.1 + b.1) / (f64::from(FEW[0] + FEW[1]) * count as f64),
        })
        .collect();
    let each = marches.last().map_or(seconds, |m| m.seconds);

    // Quadrature, first from the difference of two sets; then as many directions as make the reference sure enough.
    let [fewer, few] = finest;
    let many = bench.run(&march(MANY, step))?;
    let apart = |a: &Run, b: &Run| crate::measure::errors(&a.0, &b.0, bench.bands).kept.relative_l2;
    let guess = Law::between((FEW[0], FEW[1], apart(&fewer, &few)), (FEW[1], MANY, apart(&few, &many)));
    let needed = |law: &Law, share: f64| DIRECTIONS.into_iter().find(|&n| law.error(n) <= share * tolerance);
    let mut directions = needed(&guess, SURE).unwrap_or(REFERENCE_DIRECTIONS);
    let cost = |count: usize, n: u32| count as f64 * f64::from(n) * each;
    let allowed = (allowed - bench.seconds).max(0.0);
    while count > CELLS[0] && cost(count, directions) > allowed {
        count = CELLS.iter().rev().find(|c| **c < count).copied().unwrap_or(CELLS[0]);
    }
    while let Some(&more) = CELLS.iter().find(|c| **c > count && **c <= all.len() && 2.0 * cost(**c, directions) <= allowed) {
        count = more;
    }
    let mut cut = None;
    let least = needed(&guess, 0.5).unwrap_or(REFERENCE_DIRECTIONS);
    while directions > least && cost(count, directions) > allowed {
        directions = DIRECTIONS.into_iter().rev().find(|&n| n < directions).unwrap_or(least);
        cut = Some(format!("a reference of {directions} directions"));
    }
    // Coarser it would tell nothing, and is marched whatever is left.
    let beyond = |bench: &Bench, count: usize, n: u32| {
        (cost(count, n) > bench.left()).then(|| format!("a reference of {n} directions, at {count} cells"))
    };
    let mut longer = beyond(bench, count, directions);
    let mut v = parts(bench, &march(directions, step), &all[..count], allowed)?;
    take(bench, v.len());
    let against = "the reference";
    let judged = |bench: &mut Bench, v: &[[f32; 16]]| {
        let shared = few.0.len().min(v.len());
        [(FEW[1], &few), (MANY, &many)]
            .map(|(n, run)| bench.judge(&march(n, step), &(run.0[..shared].to_vec(), run.1), &v[..shared], against))
    };
    let mut q = judged(bench, &v);
    let mut law = Law::through((FEW[1], q[0].relative_l2), (MANY, q[1].relative_l2));
    if law.error(directions) > 0.5 * tolerance && directions < REFERENCE_DIRECTIONS {
        // Thin, scattered matter: few directions meet it, and more than was thought are needed; at fewer cells, if time is short.
        directions = needed(&law, 0.5).unwrap_or(REFERENCE_DIRECTIONS);
        let allowed = PART * bench.left();
        count = affordable(v.len(), cost(1, directions), allowed);
        (cut, longer) = (None, beyond(bench, count, directions).or(longer));
        v = parts(bench, &march(directions, step), &all[..count], allowed)?;
        take(bench, v.len());
        q = judged(bench, &v);
        law = Law::through((FEW[1], q[0].relative_l2), (MANY, q[1].relative_l2));
    }
    if law.error(directions) > 0.5 * tolerance {
        return Err(unreachable(key, tolerance, 2.0 * law.error(directions), "the reference itself is no surer than half of it"));
    }
    let margin = half_width(&q[0]).max(half_width(&q[1]));
    Ok(Truth { v, settings: march(directions, step), law, marches, margin, cut, longer })
}

/// Marches cells part after part, for a machine may become slower meanwhile: no further part once most of `allowed` is spent.
fn parts(bench: &mut Bench, settings: &Visibility, cells: &[u32], allowed: f64) -> Result<Vec<[f32; 16]>> {
    let (start, mut v) = (bench.seconds, Vec::new());
    for part in CELLS.into_iter().filter(|c| *c < cells.len()).chain([cells.len()]) {
        let from = v.len();
        v.extend(bench.run_at(settings, &cells[from..part])?.0);
        if bench.seconds - start > 0.8 * allowed {
            break;
        }
    }
    Ok(v)
}

/// How many of `have` cells that take `each` seconds fit into `allowed`, but the fewest that tell something.
fn affordable(have: usize, each: f64, allowed: f64) -> usize {
    let fits = |count: &usize| *count as f64 * each <= allowed;
    if fits(&have) { have } else { CELLS.into_iter().rev().find(|c| *c < have && fits(c)).unwrap_or(CELLS[0].min(have)) }
}

/// The larger relative half of an interval.
pub(super) fn half_width(e: &FieldError) -> f64 {
    if e.relative_l2 > 0.0 { (e.interval[1] / e.relative_l2 - 1.0).max(0.0) } else { 0.0 }
}
