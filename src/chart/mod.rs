//! Charts of speed against accuracy: what each estimator with each of its settings costs, and how wrong it is.
//!
//! [`run`] measures within a budget of time: fields against the dense reference of [`crate::measure`], pictures against a
//! reference picture. Cheap fields are computed whole; of dear ones only cells drawn at random are, and their time is
//! extrapolated, which every output says. What the budget did not reach is listed.

mod axis;
mod bars;
pub mod candidates;
mod canvas;
mod csv;
mod field;
mod figures;
mod frame;
mod histogram;
mod html;
mod judge;
mod labels;
mod markdown;
pub mod pareto;
mod plot;
mod raster;
mod report;
mod savings;
mod series;

use crate::engine::{Engine, Progress};
use crate::error::{Error, Result};
use crate::scene::{Camera, ImageSettings, Light, Matter, Sky, Visibility, Volume};
use crate::stability::Bound;
use std::ops::ControlFlow;
use std::time::Instant;

pub use csv::points_csv;
pub use figures::record;
pub use histogram::{histogram_png, histogram_svg};
pub use html::report_html;
pub use markdown::tables_md;
pub use report::{FieldPoint, FramePoint, Level, Reference, Report, Saving, Shown, StabilityRow, SubjectReport, Timing};

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
    /// Pixels of a frame that is timed, at most.
    pub pixels: usize,
    /// Pixels of its picture whose error is judged, at most: the fewer, the less noise the reference of them has.
    pub judged: usize,
}

impl Options {
    /// Under ten minutes on two cores.
    pub const FULL: Self = Self { seconds: 540.0, probes: 1024, pixels: 240 * 180, judged: 160 * 120 };

    /// Under one minute on two cores.
    pub const QUICK: Self = Self { seconds: 48.0, probes: 192, pixels: 160 * 120, judged: 96 * 72 };
}

/// A chart of a report.
pub struct Figure<'a> {
    /// Its file's stem.
    pub name: &'static str,
    drawing: Drawing<'a>,
}

enum Drawing<'a> {
    Scatter(plot::Chart),
    Bars(bars::Bars<'a>),
}

impl Figure<'_> {
    /// As an SVG document.
    ///
    /// # Errors
    /// [`Error::Invalid`] with what the drawing library says.
    pub fn svg(&self) -> Result<String> {
        match &self.drawing {
            Drawing::Scatter(chart) => canvas::svg(chart),
            Drawing::Bars(bars) => canvas::svg(bars),
        }
    }

    /// The same as a PNG file.
    ///
    /// # Errors
    /// [`Error::Invalid`] with what the drawing library says.
    pub fn png(&self) -> Result<Vec<u8>> {
        match &self.drawing {
            Drawing::Scatter(chart) => canvas::png(chart),
            Drawing::Bars(bars) => canvas::png(bars),
        }
    }
}

/// All charts of a report: `field_error`, `other_ratios`, `packing`, `frame_error`, `savings`.
pub fn figures(report: &Report) -> [Figure<'_>; 5] {
    [
        Figure { name: "field_error", drawing: Drawing::Scatter(series::field_error(report)) },
        Figure { name: "other_ratios", drawing: Drawing::Scatter(series::other_ratios(report)) },
        Figure { name: "packing", drawing: Drawing::Scatter(series::packing(report)) },
        Figure { name: "frame_error", drawing: Drawing::Scatter(series::frame_error(report)) },
        Figure { name: "savings", drawing: Drawing::Bars(bars::Bars::of(report)) },
    ]
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
        image_reference_wanted: 0.0,
        floor: String::new(),
        pixels: [0; 2],
        judged: [0; 2],
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
    let pictures = frame::measure(&frames, &cost, clock, &mut report)?;
    frame::pairs(&frames, clock, &mut report)?;
    savings::measure(&frames, &cost, clock, &mut report)?;
    field::others(&fields, &costs, clock, &mut report)?;
    // All time that is left goes to what pictures are judged against.
    let truth = frames.truth(&pictures, &cost, clock, &mut report)?;
    frame::judge(&frames, &pictures, truth, &mut report);
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
        error: match row.value.abs() {
            v if v == 0.0 || (1e-4..1e5).contains(&v) => format!("{}: {}", row.what, axis::number(row.value)),
            _ => format!("{}: {:.2e}", row.what, row.value),
        },
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
