//! Relative L2 error of coefficients, whole and by band.

use crate::stages::directions::SplitMix;
use serde::{Deserialize, Serialize};

/// Resamples of the bootstrap, and which of them, in order, bound the middle 95 %.
const RESAMPLES: usize = 1000;
const BOUNDS: [usize; 2] = [25, 974];

/// SH bands of the reference.
const BANDS: usize = 4;

/// Relative L2 error over cells and coefficients, with a 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldError {
    /// √(Σ|v − v_ref|² / Σ|v_ref|²). 0 where both sums are, infinite where only the second is.
    pub relative_l2: f64,
    /// 95 % confidence interval: bootstrap over cells, 1,000 resamples, fixed seed.
    pub interval: [f64; 2],
}

/// The errors of a field that keeps the first `kept_bands` bands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Over all 16 coefficients: what the field does not keep counts as 0, that is as wrong altogether.
    pub all: FieldError,
    /// Over the coefficients that the field keeps; the same as `all` where it keeps 16.
    pub kept: FieldError,
    /// Over band l = 0..3, each against its own Σ|v_ref|² within the band. 1 for a band that is not kept.
    pub bands: [FieldError; BANDS],
}

/// (Σ|v − v_ref|², Σ|v_ref|²) by band.
type Sums = [(f64, f64); BANDS];

/// The error of `v` against `reference`, cell by cell in the same order, over 16 coefficients.
pub fn field_error(v: &[[f32; 16]], reference: &[[f32; 16]]) -> FieldError {
    let [error] = bootstrap(&parts(v, reference), |sums| [ratio(sums)]);
    error
}

/// The errors of `v`, which keeps `kept_bands` bands, against `reference`, cell by cell in the same order.
pub fn errors(v: &[[f32; 16]], reference: &[[f32; 16]], kept_bands: u32) -> Errors {
    let kept = (kept_bands as usize).clamp(1, BANDS);
    let [all, kept, a, b, c, d] = bootstrap(&parts(v, reference), |sums| {
        let band = |l: usize| ratio(&sums[l..=l]);
        [ratio(sums), ratio(&sums[..kept]), band(0), band(1), band(2), band(3)]
    });
    Errors { all, kept, bands: [a, b, c, d] }
}

/// Each cell's sums.
fn parts(v: &[[f32; 16]], reference: &[[f32; 16]]) -> Vec<Sums> {
    let cell = |v: &[f32; 16], r: &[f32; 16]| {
        let mut sums = Sums::default();
        for (l, (d, n)) in sums.iter_mut().enumerate() {
            for i in l * l..(l + 1) * (l + 1) {
                let (v, r) = (f64::from(v[i]), f64::from(r[i]));
                *d += (v - r) * (v - r);
                *n += r * r;
            }
        }
        sums
    };
    v.iter().zip(reference).map(|(v, r)| cell(v, r)).collect()
}

fn ratio(sums: &[(f64, f64)]) -> f64 {
    let (d, n) = sums.iter().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    match (d > 0.0, n > 0.0) {
        (_, true) => (d / n).sqrt(),
        (true, false) => f64::INFINITY,
        (false, false) => 0.0,
    }
}

/// Several `figures` of the same cells, and of the same resamples of them: percentile bootstrap.
fn bootstrap<const N: usize>(parts: &[Sums], figures: impl Fn(&Sums) -> [f64; N]) -> [FieldError; N] {
    let add = |mut a: Sums, b: &Sums| {
        for (a, b) in a.iter_mut().zip(b) {
            *a = (a.0 + b.0, a.1 + b.1);
        }
        a
    };
    let whole = figures(&parts.iter().fold(Sums::default(), add));
    let mut random = SplitMix(0x626f_6f74);
    let mut resampled: [Vec<f64>; N] = std::array::from_fn(|_| Vec::with_capacity(RESAMPLES));
    if !parts.is_empty() {
        for _ in 0..RESAMPLES {
            let pick = |a, _| add(a, &parts[(random.next() % parts.len() as u64) as usize]);
            let sums = (0..parts.len()).fold(Sums::default(), pick);
            for (list, figure) in resampled.iter_mut().zip(figures(&sums)) {
                list.push(figure);
            }
        }
    }
    std::array::from_fn(|i| {
        let list = &mut resampled[i];
        list.sort_by(f64::total_cmp);
        let bound = |at: usize| list.get(at).copied().unwrap_or(0.0);
        FieldError { relative_l2: whole[i], interval: BOUNDS.map(bound) }
    })
}
