//! Image error against frame time, its floor, and pictures side by side.

use super::candidates;
use super::judge::{Truth, difference};
use super::{Clock, FieldPoint, FramePoint, Options, Shown, Subject, SubjectReport, median, pareto, seconds, timed};
use crate::engine::{Engine, Field, Lit, Medium};
use crate::error::Result;
use crate::scene::visibility::{Filter, Method, Sampling};
use crate::scene::{ImageSettings, Picture, Visibility};

/// Shares of a subject's time: until when the dense field, the points, and the pairs of pictures may run.
const UNTIL: [f64; 3] = [0.6, 0.75, 0.82];

/// Share of a subject's time that its reference picture gets even when late.
const SURE: f64 = 0.1;

/// Fields that are rendered even when late.
const FIRST: usize = 1;

/// Step of viewing rays that counts as exact, voxels.
const EXACT_STEP: f64 = 0.5;

/// One subject's frames.
pub struct Frames<'a> {
    /// Where they are rendered.
    pub engine: &'a Engine,
    /// Of what.
    pub subject: &'a Subject,
    /// With which matter.
    pub medium: &'a Medium,
    /// Their size and step.
    pub image: ImageSettings,
}

impl<'a> Frames<'a> {
    /// Pictures of the subject, of at most so many pixels.
    pub fn new(engine: &'a Engine, subject: &'a Subject, medium: &'a Medium, options: &Options) -> Self {
        let full = subject.image;
        let shrink = (options.pixels as f64 / (full.width * full.height) as f64).sqrt().min(1.0);
        let side = |n: usize| ((n as f64 * shrink).round() as usize).max(1);
        Self { engine, subject, medium, image: ImageSettings { width: side(full.width), height: side(full.height), ..full } }
    }

    /// A field of some settings, and the device seconds that it took.
    pub fn field(&self, v: &Visibility, clock: &mut Clock) -> Result<(Field, f64)> {
        let (field, times) = timed(self.engine, || self.engine.precompute(self.medium, v, &mut |_, _| clock.tick()))?;
        Ok((field, seconds(&times)))
    }

    /// A picture under the subject's light with so many of its bands.
    pub fn lit(&self, field: &Field, bands: usize) -> Result<Lit> {
        self.engine.relight(field, &self.subject.light.bands(bands))
    }

    /// The picture, and its device seconds.
    pub fn picture(&self, lit: &Lit, image: &ImageSettings, clock: &mut Clock) -> Result<(Picture, f64)> {
        let (picture, times) =
            timed(self.engine, || self.engine.render(self.medium, lit, &self.subject.camera, image, &mut |_, _| clock.tick()))?;
        Ok((picture, seconds(&times)))
    }

    /// The picture and the seconds of three frames, after one that warms up.
    pub fn frame(&self, lit: &Lit, image: &ImageSettings, clock: &mut Clock) -> Result<(Picture, Vec<f64>)> {
        let (picture, _) = self.picture(lit, image, clock)?;
        let mut times = Vec::new();
        for _ in 0..3 {
            times.push(self.picture(lit, image, clock)?.1);
        }
        Ok((picture, times))
    }

    /// Pictures whose viewing rays count as exact.
    pub fn exact(&self) -> ImageSettings {
        ImageSettings { step: EXACT_STEP, ..self.image }
    }
}

/// Fields whose frames are charted.
fn fields(own: u32) -> Vec<Visibility> {
    let sweep = |ratio, near, directions| Visibility { method: Method::Sweep, ratio, near, directions, step: 2.0, ..Visibility::default() };
    let pyramid = |ratio, directions| Visibility { ratio, directions, ..Visibility::default() };
    let march = |ratio, directions| Visibility { method: Method::March, ratio, directions, ..Visibility::default() };
    let (finer, coarser) = ((own / 2).max(1), (own * 2).min(8));
    let mut list = vec![sweep(own, 2, 128), sweep(finer, 2, 128), pyramid(own, 64), march(own, 64), sweep(coarser, 2, 128)];
    list.extend([pyramid(coarser, 64), pyramid(finer, 64), sweep(finer, 4, 256), pyramid(own, 400), march(coarser, 400)]);
    if finer > 1 {
        list.push(sweep(1, 2, 128));
    }
    let mut unique: Vec<Visibility> = Vec::new();
    list.into_iter().for_each(|v| {
        if !unique.contains(&v) {
            unique.push(v)
        }
    });
    unique
}

/// Fills `report` with the frames of a subject; `cost` predicts a field's wall seconds.
pub fn measure(frames: &Frames, cost: &dyn Fn(&Visibility) -> f64, clock: &mut Clock, report: &mut SubjectReport) -> Result<Truth> {
    let (picture, how, error) = frames.judge((0.5 * clock.left(UNTIL[0])).max(SURE * clock.share), clock)?;
    let truth = Truth { picture, how, error };
    report.image_reference.clone_from(&truth.how);
    report.image_reference_error = truth.error;
    report.pixels = [frames.image.width, frames.image.height];
    let allowed = clock.left(UNTIL[0]).max(0.5 * SURE * clock.share);
    frames.floors(&truth, allowed, cost, clock, report)?;
    let mut late = Vec::new();
    for (i, v) in fields(frames.subject.ratio).into_iter().enumerate() {
        if i >= FIRST && cost(&v) > clock.left(UNTIL[1]) {
            late.push(format!("{} at 1:{}", candidates::name(&v), v.ratio));
            continue;
        }
        clock.check()?;
        let (field, field_seconds) = frames.field(&v, clock)?;
        let (lit, relight) = timed(frames.engine, || frames.lit(&field, 4))?;
        let steps: &[f64] = if i == 0 { &[1.0, 0.5, 2.0, 4.0] } else { &[1.0] };
        for &step in steps {
            let image = ImageSettings { step, ..frames.image };
            let (picture, runs) = frames.frame(&lit, &image, clock)?;
            let (frame, spread) = median(runs);
            let Some((rmse, interval)) = frames.rmse(&picture, &truth) else { continue };
            report.frames.push(FramePoint {
                name: format!("{} at 1:{}", candidates::name(&v), v.ratio),
                ratio: v.ratio,
                step,
                field_seconds,
                relight_seconds: seconds(&relight),
                seconds: frame,
                spread,
                rmse,
                interval,
                flip: frames.flip(&picture, &truth.picture),
                front: false,
                visibility: v.clone(),
            });
        }
    }
    if !late.is_empty() {
        report.left_out.push(format!("frames: {}", late.join("; ")));
    }
    let pairs: Vec<(f64, f64)> = report.frames.iter().map(|p| (p.seconds, p.rmse)).collect();
    report.frames.iter_mut().zip(pareto::front(&pairs)).for_each(|(p, front)| p.front = front);
    Ok(truth)
}

/// The two measured fields, one of the pyramid and one swept, that are nearest in `key` and whose pictures are still
/// affordable.
fn nearest(points: &[FieldPoint], ratio: u32, most: f64, key: impl Fn(&FieldPoint) -> f64) -> Option<[&FieldPoint; 2]> {
    let of = |method| {
        points.iter().filter(move |p| {
            let v = &p.visibility;
            v.method == method && v.ratio == ratio && v.bands == 4 && v.sampling == Sampling::Stratified && p.seconds <= most
        })
    };
    let pyramids = of(Method::Hierarchical).filter(|p| p.visibility.filter == Filter::Axis);
    let far = |h: &FieldPoint, s: &FieldPoint| (key(h) / key(s)).ln().abs();
    pyramids
        .flat_map(|h| of(Method::Sweep).map(move |s| [h, s]))
        // Pairs that are about as near: the one with the most directions shows most.
        .min_by(|a, b| {
            let rank = |[h, s]: &[&FieldPoint; 2]| {
                ((far(h, s) / 0.1).floor() as i64, -i64::from(h.visibility.directions), -i64::from(s.visibility.directions))
            };
            rank(a).cmp(&rank(b))
        })
}

/// Pictures of the pyramid and the sweep at about equal time and at about equal error, with the reference.
pub fn pairs(frames: &Frames, truth: &Truth, clock: &mut Clock, report: &mut SubjectReport) -> Result<Vec<Shown>> {
    let mut shown = vec![Shown { group: "Reference".into(), title: truth.how.clone(), picture: truth.picture.clone(), difference: None }];
    for (group, by_time) in [("At about equal time", true), ("At about equal error", false)] {
        let most = (0.4 * clock.left(UNTIL[2])).max(0.3 * SURE * clock.share);
        let found = nearest(&report.fields, frames.subject.ratio, most, |p| if by_time { p.seconds } else { p.error });
        let Some(pair) = found else {
            report.left_out.push(format!("pictures: {}", group.to_lowercase()));
            continue;
        };
        for point in pair.map(Clone::clone) {
            clock.check()?;
            let v = Visibility { bits: 8, ..point.visibility.clone() };
            let (field, seconds) = frames.field(&v, clock)?;
            let (picture, _) = frames.picture(&frames.lit(&field, 4)?, &frames.exact(), clock)?;
            let (rmse, _) = frames.rmse(&picture, truth).unwrap_or_default();
            let title = format!("{}: field {seconds:.2} s, field error {:.3}, image relative RMSE {rmse:.4}", point.name, point.error);
            shown.push(Shown { group: group.into(), title, difference: Some(difference(&picture, &truth.picture)), picture });
        }
    }
    Ok(shown)
}
