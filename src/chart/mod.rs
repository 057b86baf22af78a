//! Charts of speed against accuracy: what each estimator with each of its settings costs, and how wrong it is.
//!
//! [`run`] measures within a budget of time: fields against the dense reference of [`crate::measure`], pictures against a
//! reference picture. Cheap fields are computed whole; of dear ones only cells drawn at random are, and their time is
//! extrapolated, which every output says. What the budget did not reach is listed.

pub mod candidates;
mod csv;
mod field;
pub mod pareto;
pub mod plot;
mod raster;
mod series;
mod svg;

use crate::engine::{Engine, Progress};
use crate::error::{Error, Result};
use crate::scene::{Camera, ImageSettings, Light, Matter, Visibility, Volume};
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::time::Instant;

pub use csv::points_csv;
pub use raster::png;
pub use series::field_error_svg;

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
}

impl Options {
    /// Under ten minutes on two cores.
    pub const FULL: Self = Self { seconds: 540.0, probes: 1024 };

    /// Under one minute on two cores.
    pub const QUICK: Self = Self { seconds: 48.0, probes: 256 };
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

/// All that was measured on one subject.
#[derive(Clone, Debug, Serialize)]
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
    /// What the budget did not reach: in words, with why.
    pub left_out: Vec<String>,
}

/// A whole run.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Wall seconds that were allowed.
    pub budget: f64,
    /// Wall seconds that it took.
    pub seconds: f64,
    /// One per subject.
    pub subjects: Vec<SubjectReport>,
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
    Ok(Report { budget: options.seconds, seconds: start.elapsed().as_secs_f64(), subjects: reports })
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
        left_out: Vec::new(),
    };
    field::measure(engine, subject, &medium, options, clock, &mut report)?;
    Ok(report)
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
