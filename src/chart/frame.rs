//! Image error against frame time, its floor, and pictures side by side.

use super::candidates;
use super::judge::{Truth, difference};
use super::{Clock, FieldPoint, FramePoint, Options, Shown, Subject, SubjectReport, median, pareto, seconds, timed};
use crate::engine::{Engine, Field, Lit, Medium};
use crate::error::Result;
use crate::scene::visibility::{Filter, Method, Sampling};
use crate::scene::{ImageSettings, Picture, Visibility};
use std::fmt::Write as _;

/// Shares of a subject's time: until when the points, and the pairs of pictures may run.
const UNTIL: [f64; 2] = [0.55, 0.61];

/// Share of a subject's time that a pair of pictures gets even when late.
const SURE: f64 = 0.03;

/// Frames that are timed.
const FRAMES: usize = 5;

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
    /// Their size and step where they are timed.
    pub image: ImageSettings,
    /// The same where their errors are judged.
    pub judged: ImageSettings,
}

impl<'a> Frames<'a> {
    /// Pictures of the subject, of at most so many pixels.
    pub fn new(engine: &'a Engine, subject: &'a Subject, medium: &'a Medium, options: &Options) -> Self {
        let full = subject.image;
        let of = |pixels: usize| {
            let shrink = (pixels as f64 / (full.width * full.height) as f64).sqrt().min(1.0);
            let side = |n: usize| ((n as f64 * shrink).round() as usize).max(1);
            ImageSettings { width: side(full.width), height: side(full.height), ..full }
        };
        Self { engine, subject, medium, image: of(options.pixels), judged: of(options.judged) }
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

    /// The picture to judge and the seconds of [`FRAMES`] frames of full size, after it.
    pub fn frame(&self, lit: &Lit, step: f64, clock: &mut Clock) -> Result<(Picture, Vec<f64>)> {
        let (picture, _) = self.picture(lit, &ImageSettings { step, ..self.judged }, clock)?;
        let mut times = Vec::new();
        for _ in 0..FRAMES {
            times.push(self.picture(lit, &ImageSettings { step, ..self.image }, clock)?.1);
        }
        Ok((picture, times))
    }

    /// Pictures whose viewing rays count as exact.
    pub fn exact(&self) -> ImageSettings {
        ImageSettings { step: EXACT_STEP, ..self.judged }
    }
}

/// Points per cell of fitted fields.
const FITTED: u32 = 8;

/// Fields whose frames are charted, those of a medium also fitted to what pictures read.
fn fields(own: u32, medium: bool) -> Vec<Visibility> {
    let sweep = |ratio, near, directions| Visibility { method: Method::Sweep, ratio, near, directions, step: 2.0, ..Visibility::default() };
    let pyramid = |ratio, directions| Visibility { method: Method::Hierarchical, ratio, directions, ..Visibility::default() };
    let march = |ratio, directions| Visibility { method: Method::March, ratio, directions, ..Visibility::default() };
    let (finer, coarser) = ((own / 2).max(1), (own * 2).min(8));
    let fitted = |ratio| Visibility { fit: FITTED, ..sweep(ratio, 1, 128) };
    let mut list = vec![sweep(own, 2, 128)];
    list.extend(medium.then(|| fitted(own)));
    list.extend([sweep(finer, 2, 128), pyramid(own, 64), march(own, 64), sweep(coarser, 2, 128)]);
    list.extend([coarser, finer].into_iter().filter(|_| medium).map(fitted));
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

/// Fills `report` with the times of a subject's frames, and returns their pictures, which [`judge`] will judge; `cost` predicts
/// a field's wall seconds.
pub fn measure(frames: &Frames, cost: &dyn Fn(&Visibility) -> f64, clock: &mut Clock, report: &mut SubjectReport) -> Result<Vec<Picture>> {
    report.pixels = [frames.image.width, frames.image.height];
    report.judged = [frames.judged.width, frames.judged.height];
    let (mut pictures, mut late) = (Vec::new(), Vec::new());
    for (i, v) in fields(frames.subject.ratio, !frames.medium.has_surface()).into_iter().enumerate() {
        if i >= FIRST && cost(&v) > clock.left(UNTIL[0]) {
            late.push(format!("{} at 1:{}", candidates::name(&v), v.ratio));
            continue;
        }
        clock.check()?;
        let (field, field_seconds) = frames.field(&v, clock)?;
        let (lit, relight) = timed(frames.engine, || frames.lit(&field, 4))?;
        let steps: &[f64] = if i == 0 { &[1.0, 0.5, 2.0, 4.0] } else { &[1.0] };
        for &step in steps {
            let (picture, runs) = frames.frame(&lit, step, clock)?;
            let (frame, spread) = median(runs);
            pictures.push(picture);
            report.frames.push(FramePoint {
                name: format!("{} at 1:{}", candidates::name(&v), v.ratio),
                ratio: v.ratio,
                step,
                field_seconds,
                relight_seconds: seconds(&relight),
                seconds: frame,
                spread,
                rmse: f64::NAN,
                interval: [f64::NAN; 2],
                flip: f64::NAN,
                front: false,
                visibility: v.clone(),
            });
        }
    }
    if !late.is_empty() {
        report.left_out.push(format!("frames: {}", late.join("; ")));
    }
    Ok(pictures)
}

/// Judges the frames of `report`, whose pictures are given in their order, and those side by side, against the truth.
pub fn judge(frames: &Frames, pictures: &[Picture], truth: Truth, report: &mut SubjectReport) {
    for (point, picture) in report.frames.iter_mut().zip(pictures) {
        (point.rmse, point.interval) = truth.rmse(picture).unwrap_or((f64::NAN, [f64::NAN; 2]));
        point.flip = frames.flip(picture, &truth.picture);
    }
    // Where nothing is covered there is no error, of any frame.
    report.frames.retain(|p| p.rmse.is_finite());
    let ranges: Vec<_> = report.frames.iter().map(|p| [p.spread.unwrap_or([p.seconds; 2]), p.interval]).collect();
    report.frames.iter_mut().zip(pareto::front(&ranges)).for_each(|(p, front)| p.front = front);
    for shown in &mut report.shown {
        let (rmse, _) = truth.rmse(&shown.picture).unwrap_or_default();
        let _ = write!(shown.title, ", image relative RMSE {rmse:.4}");
        shown.difference = Some(difference(&shown.picture, &truth.picture));
    }
    if let Some(pair) = finer(frames.subject.ratio, &report.frames, pictures) {
        for (point, picture) in pair {
            let title = format!("{}: field {:.2} s, image relative RMSE {:.4}", point.name, point.field_seconds, point.rmse);
            let (picture, difference) = (picture.clone(), Some(difference(picture, &truth.picture)));
            report.shown.push(Shown {
                group: "For the pyramid's time, the sweep fitted or at a finer ratio".into(),
                title,
                picture,
                difference,
            });
        }
    }
    report.image_reference.clone_from(&truth.how);
    report.image_reference_error = truth.error;
    let title = format!("the reference: {}", truth.how);
    report.shown.insert(0, Shown { group: "Reference".into(), title, picture: truth.picture, difference: None });
}

/// The pyramid's best picture at a ratio, and the best one of a sweep, fitted or at a finer ratio, whose field took no longer.
fn finer<'a>(ratio: u32, frames: &'a [FramePoint], pictures: &'a [Picture]) -> Option<[(&'a FramePoint, &'a Picture); 2]> {
    let of = |method| frames.iter().zip(pictures).filter(move |(p, _)| p.visibility.method == method && p.step == 1.0);
    let least = |a: &(&FramePoint, &Picture), b: &(&FramePoint, &Picture)| a.0.rmse.total_cmp(&b.0.rmse);
    let pyramid = of(Method::Hierarchical).filter(|(p, _)| p.ratio == ratio).min_by(least)?;
    let sweep = of(Method::Sweep)
        .filter(|(p, _)| (p.ratio < ratio || p.visibility.fit > 0) && p.field_seconds <= pyramid.0.field_seconds)
        .min_by(least)?;
    Some([pyramid, sweep])
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

/// Fills `report` with pictures of the pyramid and the sweep at about equal time and at about equal error, not yet judged.
pub fn pairs(frames: &Frames, clock: &mut Clock, report: &mut SubjectReport) -> Result<()> {
    for (group, by_time) in [("At about equal time", true), ("At about equal error", false)] {
        let most = (0.4 * clock.left(UNTIL[1])).max(SURE * clock.share);
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
            let title = format!("{}: field {seconds:.2} s, field error {:.3}", point.name, point.error);
            report.shown.push(Shown { group: group.into(), title, difference: None, picture });
        }
    }
    Ok(())
}
