//! The plan: what is asked for → which estimator, directions, near field, ratio, bands and bits, found by measuring a few
//! candidates at some cells of the very scene, and said beforehand with its cost.
//!
//! Error is relative L2 over the kept coefficients after packing, against a dense march at the same cells (see
//! [`crate::measure`]). What is measured, at 96 to 512 cells near matter drawn apart from those that
//! [`crate::measure::Plan`] draws:
//!
//! - first, where a tolerance and no ratio is given, what fields at 1:8, 1:4 and 1:2 that are exact at their cells miss between
//!   them: at 128 voxels of matter (beside a surface) the trilinear sum of the cells around against a march from there, each voxel by
//!   its opacity and the light that reaches it, what is systematic of two sets of directions. The
//!   coarsest that misses no more than the tolerance is taken, 1:2 where none does;
//! - the march: what its step is off by (from two pairs of small direction sets), and q(N) = a·N^−p, its quadrature;
//! - the reference: a march of 384 to 4,096 directions, as many as make its own error a third of the tolerance, half if time
//!   is short, in steps of ½ voxel, or of ¼ where ½ shows;
//! - the sweep, whole: one slice dense, with two numbers of directions, which gives its quadrature and what its handing on of
//!   transmittance costs; then, if time is left, the shape (slices, step) that these make the cheapest.
//!
//! Then error² = quadrature² + own² + packing² by laws ([`law`](self)) whose exponents were fitted to ten scenes, and the
//! cheapest shape and N that stay within the tolerance are taken, with a margin for the 95 % interval and for what the laws
//! may be off by; `march` where that is cheaper.
//!
//! Planning is bounded: about [`FLOOR_SECONDS`] of device time or [`SHARE`] of what the field should take, whichever is more. Where
//! that is short the cells get fewer, then the reference coarser, then the sweeps fewer, and the plan says so. Only
//! the coarsest reference that the tolerance can be judged by, at the fewest cells, is marched whatever is left, which is said too.
//!
//! The computed field is measured at the plan's cells before it is handed out: the upper end of its 95 % interval must be
//! within the tolerance. Where only the interval is too wide, more cells are measured if that is cheaper than another field;
//! a field that missed is replaced by a better one ([`Plan::compute`]).

mod bands;
mod bench;
mod between;
mod choose;
mod compute;
mod law;
mod ratio;
mod truth;

pub use bands::{NEGLIGIBLE, needed as needed_bands};
pub use bench::{FLOOR_SECONDS, Pace, SHARE};
pub use choose::{choose, choose_at};
pub use compute::Made;

use crate::engine::Need;
use crate::measure::FieldError;
use crate::scene::Visibility;
use crate::scene::visibility::{Cells, Method, Wanted};
use law::{Law, Sweeps};
use serde_json::{Value, json};
use truth::March;

/// What is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// The tolerance or the quality.
    pub wanted: Wanted,
    /// Voxels per cell, if that is settled: 1, 2, 4 or 8.
    pub ratio: Option<u32>,
    /// Bits per coefficient, if that is settled: 8, 16 or 32.
    pub bits: Option<u32>,
    /// SH bands that the field keeps.
    pub bands: u32,
    /// Which cells are computed.
    pub cells: Cells,
    /// The picture (width, height) that memory must hold besides.
    pub pixels: Option<(usize, usize)>,
}

/// A measured candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// What was run.
    pub settings: Visibility,
    /// Its error at the plan's cells.
    pub error: FieldError,
    /// What [`Candidate::error`] is an error of, in words.
    pub against: &'static str,
    /// Device seconds that it took.
    pub seconds: f64,
}

/// What was chosen, and why.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The chosen settings.
    pub settings: Visibility,
    /// The error that the field must not exceed: relative L2 over the kept coefficients.
    pub tolerance: f64,
    /// What a field of this ratio that is exact at its cells misses between them, where that was measured: relative L2 at voxels of
    /// matter.
    pub between: Option<f64>,
    /// The predicted error, with the interval that the measured one should lie in.
    pub predicted: FieldError,
    /// Predicted device seconds of the field.
    pub seconds: f64,
    /// Device memory of the scene.
    pub need: Need,
    /// One sentence per choice.
    pub reasons: Vec<String>,
    /// What was measured.
    pub tried: Vec<Candidate>,
    /// Device seconds that planning took.
    pub planning_seconds: f64,
    /// Device seconds that it was to take at most, about.
    pub planning_limit: f64,
    /// Measured cells, others that could be, and the reference at the former.
    cells: Vec<u32>,
    more: Vec<u32>,
    truth: Vec<[f32; 16]>,
    /// The reference's settings, and its seconds per cell.
    dense: Visibility,
    dense_seconds: f64,
    /// Cells of the whole field.
    wanted: f64,
    law: Law,
    sweeps: Sweeps,
    marches: Vec<March>,
    /// Error of packing alone.
    packing: f64,
    /// Relative half-width of the intervals.
    margin: f64,
    /// The key of a scene that asked.
    key: &'static str,
}

impl Plan {
    /// Number of cells that candidates were measured at.
    pub fn probes(&self) -> usize {
        self.cells.len()
    }

    /// The march that candidates were measured against; slow machines take one of fewer directions.
    pub fn reference(&self) -> &Visibility {
        &self.dense
    }

    /// "sweep, 112 directions, 2 slices dense in steps of 2 voxels, 1:4, 16 coefficients of 8 bits".
    pub fn chosen(&self) -> String {
        described(&self.settings)
    }

    /// For programs.
    pub fn json(&self) -> Value {
        let s = |v: &Visibility| {
            json!({
                "method": method(v.method), "ratio": v.ratio, "directions": v.directions, "near": v.near, "step": v.step,
                "bands": v.bands, "bits": v.bits,
            })
        };
        let tried: Vec<Value> = self
            .tried
            .iter()
            .map(|c| json!({ "settings": s(&c.settings), "error": c.error, "against": c.against, "seconds": c.seconds }))
            .collect();
        json!({
            "tolerance": self.tolerance, "between_cells": self.between, "chosen": s(&self.settings), "predicted": self.predicted, "seconds": self.seconds,
            "memory": self.need.peak(), "probes": self.cells.len(), "reasons": self.reasons, "tried": tried,
            "planning_seconds": self.planning_seconds, "planning_limit": self.planning_limit,
        })
    }
}

fn method(m: Method) -> &'static str {
    match m {
        Method::March => "march",
        Method::Hierarchical => "hierarchical",
        Method::Sweep => "sweep",
    }
}

/// Settings in a line.
fn described(v: &Visibility) -> String {
    let how = match v.method {
        Method::Sweep => format!("{} slice{} dense in steps of {} voxel", v.near, if v.near == 1 { "" } else { "s" }, v.step),
        _ => format!("steps of {} voxel", v.step),
    };
    let packing = if v.bits == 32 { "32-bit float".into() } else { format!("{} bits", v.bits) };
    let c = v.coefficients();
    let s = if c == 1 { "" } else { "s" };
    format!("{}, {} directions, {how}, 1:{}, {c} coefficient{s} of {packing}", method(v.method), v.directions, v.ratio)
}
