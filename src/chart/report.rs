//! What was measured: plain data, as `report.json` holds it.

use crate::scene::{Picture, Visibility};
use serde::Serialize;
use std::collections::BTreeMap;

/// Where a time comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Timing {
    /// The whole field was computed.
    Whole,
    /// Cells drawn at random were; their time was multiplied.
    Extrapolated,
}

impl Timing {
    /// In a table.
    pub fn word(self) -> &'static str {
        match self {
            Self::Whole => "whole",
            Self::Extrapolated => "extrapolated",
        }
    }
}

/// An estimator's settings at one ratio: what its field costs and how wrong it is.
#[derive(Clone, Debug, Serialize)]
pub struct FieldPoint {
    /// Settings in words.
    pub name: String,
    /// Voxels per field cell along each axis.
    pub ratio: u32,
    /// All settings, by their names in a scene.
    pub settings: BTreeMap<String, serde_json::Value>,
    /// Device seconds of the whole field (wall seconds where the device keeps no time).
    pub seconds: f64,
    /// Least and most of three runs, where there was time for three; `seconds` is then their median.
    pub spread: Option<[f64; 2]>,
    /// Whether they were measured whole.
    pub timing: Timing,
    /// Relative L2 over probes and 16 coefficients, before packing.
    pub error: f64,
    /// Its 95 % interval.
    pub interval: [f64; 2],
    /// The same after packing to 16 and to 8 bits a coefficient.
    pub packed: [f64; 2],
    /// On the Pareto front of its ratio.
    pub front: bool,
    /// The settings themselves.
    #[serde(skip)]
    pub visibility: Visibility,
}

/// The dense reference at one ratio.
#[derive(Clone, Debug, Serialize)]
pub struct Reference {
    /// Voxels per field cell along each axis.
    pub ratio: u32,
    /// Cells that errors are measured at.
    pub probes: usize,
    /// Directions per cell.
    pub directions: u32,
    /// Step, voxels.
    pub step: f32,
    /// Device seconds at these cells.
    pub seconds: f64,
}

/// A picture: what it costs and how far it is from the reference picture.
#[derive(Clone, Debug, Serialize)]
pub struct FramePoint {
    /// Its field in words.
    pub name: String,
    /// Voxels per field cell along each axis.
    pub ratio: u32,
    /// Step of the viewing rays, voxels.
    pub step: f64,
    /// Device seconds of its field.
    pub field_seconds: f64,
    /// Device seconds of putting the field under the light.
    pub relight_seconds: f64,
    /// Device seconds of the frame, median of five.
    pub seconds: f64,
    /// Least and most of the five.
    pub spread: Option<[f64; 2]>,
    /// Relative RMSE over the pixels that the volume covers, the reference's own noise taken off in quadrature.
    pub rmse: f64,
    /// Its 95 % interval over pixels.
    pub interval: [f64; 2],
    /// Mean FLIP of the pictures as they are shown, exposed and clamped.
    pub flip: f64,
    /// On the Pareto front of time and error.
    pub front: bool,
    /// The field's settings.
    #[serde(skip)]
    pub visibility: Visibility,
}

/// The error that no better field of so many bands removes.
#[derive(Clone, Debug, Serialize)]
pub struct Level {
    /// Bands of the light.
    pub bands: u32,
    /// Relative RMSE against the reference picture, as a frame's.
    pub rmse: f64,
    /// Its 95 % interval over pixels.
    pub interval: [f64; 2],
}

/// One saving: the same with and without it.
#[derive(Clone, Debug, Serialize)]
pub struct Saving {
    /// What is saved at.
    pub name: String,
    /// "field", "relight" or "frame": what the seconds are of; "memory": bytes of the packed field.
    pub of: &'static str,
    /// Device seconds, or bytes, without it.
    pub before: f64,
    /// The same with it.
    pub after: f64,
    /// Runs of each, in turns; the seconds are medians.
    pub rounds: usize,
    /// Relative RMSE of the picture with it against the picture without it.
    pub rmse: f64,
}

/// A picture of the report.
pub struct Shown {
    /// Pictures of one group stand side by side.
    pub group: String,
    /// Below it.
    pub title: String,
    /// The picture.
    pub picture: Picture,
    /// Per pixel, |difference from the reference| over its mean.
    pub difference: Option<Vec<f32>>,
}

/// All that was measured on one subject.
#[derive(Serialize)]
pub struct SubjectReport {
    /// The subject's name.
    pub name: String,
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
    /// Its ratio.
    pub ratio: u32,
    /// What errors are against.
    pub references: Vec<Reference>,
    /// Fields.
    pub fields: Vec<FieldPoint>,
    /// What pictures are judged against.
    pub image_reference: String,
    /// Its own relative standard error.
    pub image_reference_error: f64,
    /// What that should be at most: a tenth of the least error that is judged by it.
    pub image_reference_wanted: f64,
    /// What [`levels`](Self::levels) are the error of: "SH-exact", the reference picture under the light cut to so many bands,
    /// or, for shaded surfaces, the densest field that was affordable.
    pub floor: String,
    /// Width and height of the frames that were timed.
    pub pixels: [usize; 2],
    /// Of the pictures whose errors were judged, by the same camera.
    pub judged: [usize; 2],
    /// Frames.
    pub frames: Vec<FramePoint>,
    /// What more bands would bring.
    pub levels: Vec<Level>,
    /// Before and after.
    pub savings: Vec<Saving>,
    /// Pictures side by side.
    #[serde(skip)]
    pub shown: Vec<Shown>,
    /// Exposure of its pictures, stops.
    pub exposure: f64,
    /// What the budget did not reach: in words, with why.
    pub left_out: Vec<String>,
}

/// A whole run.
#[derive(Serialize)]
pub struct Report {
    /// Wall seconds that were allowed.
    pub budget: f64,
    /// Wall seconds that it took.
    pub seconds: f64,
    /// One per subject.
    pub subjects: Vec<SubjectReport>,
    /// Scenes made to break estimators, where somebody ran them.
    pub stability: Vec<StabilityRow>,
}

/// What a method does in a scene that is made to break it.
#[derive(Clone, Debug, Serialize)]
pub struct StabilityRow {
    /// Estimator and settings.
    pub method: String,
    /// The scene.
    pub case: String,
    /// What was measured, and the figure.
    pub error: String,
    /// Within its bound, or how it fails.
    pub verdict: String,
}
