//! Charts of speed against accuracy: what each estimator with each of its settings costs, and how wrong it is.
//!
//! [`run`] measures within a budget of time: fields against the dense reference of [`crate::measure`], pictures against a
//! reference picture. Cheap fields are computed whole; of dear ones only cells drawn at random are, and their time is
//! extrapolated, which every output says. What the budget did not reach is listed.

pub mod candidates;
mod csv;
mod field;
mod figures;
mod frame;
mod histogram;
mod html;
pub mod pareto;
pub mod plot;
mod raster;
mod savings;
mod series;
mod svg;

use crate::engine::{Engine, Progress};
use crate::error::{Error, Result};
use crate::scene::{Camera, ImageSettings, Light, Matter, Picture, Sky, Visibility, Volume};
use crate::stability::Bound;
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::Instant;

pub use csv::points_csv;
pub use figures::record;
pub use histogram::histogram_svg;
pub use html::report_html;
pub use raster::png;
pub use savings::savings_svg;
pub use series::{field_error_svg, frame_error_svg};

/// What is measured on: one scene, in host memory.
pub struct Subject {
    /// Its name in titles and tables.
    pub name: String,
    /// The volume.
    pub volume: Volume,
    /// Its matter.
    pub matter: Matter,
    /// Its light, as it meets visibility.
    pub light: Light,
    /// The same light without harmonics: what the reference picture is lit by.
    pub sky: Sky,
    /// Its camera.
    pub camera: Camera,
    /// Size and step of its pictures.
    pub image: ImageSettings,
    /// Ratio of its field.
    pub ratio: u32,
}

/// How much is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Wall seconds for everything, shared evenly among the subjects.
    pub seconds: f64,
    /// Field cells that errors are measured at, if time allows.
    pub probes: usize,
    /// Pixels of a picture, at most.
    pub pixels: usize,
}

impl Options {
    /// Under ten minutes on two cores.
    pub const FULL: Self = Self { seconds: 540.0, probes: 1024, pixels: 320 * 240 };

    /// Under one minute on two cores.
    pub const QUICK: Self = Self { seconds: 48.0, probes: 192, pixels: 160 * 120 };
}

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
    /// Device seconds of the frame, median of three.
    pub seconds: f64,
    /// Least and most of the three.
    pub spread: Option<[f64; 2]>,
    /// Relative RMSE over the pixels that the volume covers, the reference's own noise taken off in quadrature.
    pub rmse: f64,
    /// Mean FLIP of the pictures as they are shown, exposed and clamped.
    pub flip: f64,
    /// On the Pareto front of time and error.
    pub front: bool,
    /// The field's settings.
    #[serde(skip)]
    pub visibility: Visibility,
}

/// The error that no finer field of so many bands removes: that of the dense field.
#[derive(Clone, Debug, Serialize)]
pub struct Level {
    /// Bands of the light.
    pub bands: u32,
    /// Relative RMSE against the reference picture, as a frame's.
    pub rmse: f64,
}

/// One saving: the same with and without it.
#[derive(Clone, Debug, Serialize)]
pub struct Saving {
    /// What is saved at.
    pub name: String,
    /// "field", "relight" or "frame": what the seconds are of.
    pub of: &'static str,
    /// Device seconds without it.
    pub before: f64,
    /// Device seconds with it.
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
    /// The densest field that was affordable.
    pub dense_field: String,
    /// Width and height of the pictures.
    pub pixels: [usize; 2],
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

/// Measures every subject within the budget.
///
/// # Errors
/// What the engine refuses, and [`Error::Cancelled`].
pub fn run(engine: &Engine, subjects: &[Subject], options: &Options, progress: &mut Progress) -> Result<Report> {
    let start = Instant::now();
    let mut reports = Vec::new();
    for (i, subject) in subjects.iter().enumerate() {
        // An even share of what is left: what one subject saves the next may use.
        let left = options.seconds - start.elapsed().as_secs_f64();
        let share = left / (subjects.len() - i) as f64;
        let mut clock = Clock { start, total: options.seconds, from: start.elapsed().as_secs_f64(), share, tell: progress };
        reports.push(measure_subject(engine, subject, options, &mut clock)?);
    }
    Ok(Report { budget: options.seconds, seconds: start.elapsed().as_secs_f64(), subjects: reports, stability: Vec::new() })
}

fn measure_subject(engine: &Engine, subject: &Subject, options: &Options, clock: &mut Clock) -> Result<SubjectReport> {
    let uploaded = engine.upload(&subject.volume)?;
    let medium = engine.classify(&uploaded, &subject.matter)?;
    let mut report = SubjectReport {
        name: subject.name.clone(),
        dims: subject.volume.grid().dims(),
        ratio: subject.ratio,
        references: Vec::new(),
        fields: Vec::new(),
        image_reference: String::new(),
        image_reference_error: 0.0,
        dense_field: String::new(),
        pixels: [0; 2],
        frames: Vec::new(),
        levels: Vec::new(),
        savings: Vec::new(),
        shown: Vec::new(),
        exposure: subject.image.exposure,
        left_out: Vec::new(),
    };
    let fields = field::Fields { engine, subject, medium: &medium, options };
    let costs = field::own(&fields, clock, &mut report)?;
    let frames = frame::Frames::new(engine, subject, &medium, options);
    let cost = |v: &Visibility| costs.whole(v, medium.grid());
    let truth = frame::measure(&frames, &cost, clock, &mut report)?;
    report.shown = frame::pairs(&frames, &truth, clock, &mut report)?;
    savings::measure(&frames, &cost, clock, &mut report)?;
    field::others(&fields, &costs, clock, &mut report)?;
    Ok(report)
}

/// The table of scenes that are made to break estimators ([`crate::stability`]); about a minute on two cores.
///
/// # Errors
/// As [`crate::stability::run`].
pub fn stability(engine: &Engine, progress: &mut Progress) -> Result<Vec<StabilityRow>> {
    let verdict = |row: &crate::stability::Row| match (row.holds(), row.bound) {
        (true, Bound::Fails(..)) => format!("documented failure ({})", row.why),
        (true, bound) => format!("holds {bound} ({})", row.why),
        (false, bound) => format!("BREAKS {bound} ({})", row.why),
    };
    let row = |row: &crate::stability::Row| StabilityRow {
        method: row.method.clone(),
        case: row.case.into(),
        error: format!("{}: {:.3e}", row.what, row.value),
        verdict: verdict(row),
    };
    Ok(crate::stability::run(engine, progress)?.iter().map(row).collect())
}

/// A subject's share of the time. Shares of the share end one after the other, as fractions of it.
pub(crate) struct Clock<'a, 'b> {
    start: Instant,
    total: f64,
    from: f64,
    share: f64,
    tell: &'a mut Progress<'b>,
}

impl Clock<'_, '_> {
    /// Seconds until `fraction` of the share is used up; negative afterwards.
    fn left(&self, fraction: f64) -> f64 {
        self.from + fraction * self.share - self.start.elapsed().as_secs_f64()
    }

    /// Shows how much of all the time is used; for the engine's jobs.
    fn tick(&mut self) -> ControlFlow<()> {
        let done = (self.start.elapsed().as_secs_f64() / self.total.max(1e-3)).min(1.0);
        (self.tell)("measure", done as f32)
    }

    /// The same between jobs.
    fn check(&mut self) -> Result<()> {
        match self.tick() {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Error::Cancelled),
        }
    }
}

/// What `call` took on the device since the timings were last taken: seconds per kernel name, or of the whole call where
/// the device keeps no time.
pub(crate) fn timed<T>(engine: &Engine, call: impl FnOnce() -> Result<T>) -> Result<(T, Vec<(&'static str, f64)>)> {
    engine.take_timings();
    let start = Instant::now();
    let value = call()?;
    let wall = start.elapsed().as_secs_f64();
    let spans = engine.take_timings();
    let times = match spans.iter().all(|s| s.timed) && !spans.is_empty() {
        true => spans.iter().map(|s| (s.kernel, s.seconds)).collect(),
        false => vec![("call", wall)],
    };
    Ok((value, times))
}

/// The sum of [`timed`]'s seconds.
pub(crate) fn seconds(times: &[(&'static str, f64)]) -> f64 {
    times.iter().map(|t| t.1).sum()
}

/// Median of several runs, and the least and most of them where there are several.
pub(crate) fn median(mut runs: Vec<f64>) -> (f64, Option<[f64; 2]>) {
    runs.sort_by(f64::total_cmp);
    match (runs.first(), runs.last()) {
        (Some(&lo), Some(&hi)) => {
            let middle = 0.5 * (runs[(runs.len() - 1) / 2] + runs[runs.len() / 2]);
            (middle, (runs.len() > 1).then_some([lo, hi]))
        }
        _ => (f64::NAN, None),
    }
}
