//! The plan: what is asked for → which estimator, directions, near field, ratio, bands and bits, found by measuring a few
//! candidates at some cells of the very scene, and said beforehand with its cost.
//!
//! Error is relative L2 over the kept coefficients after packing, against a dense march at the same cells (see
//! [`crate::measure`]); a field at 1:8 is judged at its own cells. What is measured, at up to 256 cells near matter drawn
//! apart from those that [`crate::measure::Plan`] draws:
//!
//! - the reference: `march`, 1,024 directions in steps of ½ voxel (4,096 where matter is thin and scattered); 4,096 in ¼
//!   voxel for tolerances below 0.03;
//! - quadrature: `march` with two smaller numbers of directions, which gives q(N) = a·N^−p;
//! - the sweep, whole: one shape (near, step) with two numbers of directions, which gives its own q(N) and error b, then
//!   dearer shapes as far as they are needed, each with its time: a fixed part and one per direction.
//!
//! Then error² = q(N)² + b² + packing², and the cheapest N and shape that stay within the tolerance are taken, with a
//! margin for the 95 % interval; `march` where that is cheaper or no sweep is close enough. The computed field is measured
//! at the same cells before it is handed out; one that missed is replaced by a better one ([`Plan::compute`]).

mod bands;
mod choose;
mod compute;
mod law;

pub use bands::{NEGLIGIBLE, needed as needed_bands};
pub use choose::choose;
pub use compute::Made;

use crate::engine::Need;
use crate::measure::FieldError;
use crate::scene::Visibility;
use crate::scene::visibility::{Cells, Method, Wanted};
use law::{Law, Shape};
use serde_json::{Value, json};

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
    /// Measured cells, ascending, and the reference there.
    cells: Vec<u32>,
    truth: Vec<[f32; 16]>,
    law: Law,
    shapes: Vec<Shape>,
    /// Seconds of a marched direction over the whole field, per step length in voxels: (step, its error, seconds).
    marches: Vec<(f32, f64, f64)>,
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
            "tolerance": self.tolerance, "chosen": s(&self.settings), "predicted": self.predicted, "seconds": self.seconds,
            "memory": self.need.peak(), "probes": self.cells.len(), "reasons": self.reasons, "tried": tried,
            "planning_seconds": self.planning_seconds,
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
