//! What pictures are judged against, and the error that no better field takes away.

use super::frame::Frames;
use super::{Clock, Level, SubjectReport, candidates};
use crate::engine::{Field, Reference, ReferenceSettings};
use crate::error::Result;
use crate::measure::{covered_mean as mean, exposed, flip, judged};
use crate::scene::visibility::Method;
use crate::scene::{Matter, Picture, Probe, Shading, Sky, Visibility};

/// Of the least error that is judged, what the reference picture's own may be.
const TENTH: f64 = 0.1;

/// Shares of the time that is left: for a first reference, which says how good the second must be, and for what so many bands
/// leave.
const SHARES: [f64; 2] = [0.1, 0.3];

/// Relative standard error at which the pictures under a cut light are good enough, for it is taken off.
const CUT_ERROR: f64 = 0.01;

/// Share of a subject's time that all this gets even when late.
const SURE: f64 = 0.1;

/// What pictures are judged against.
pub struct Truth {
    /// The picture.
    pub picture: Picture,
    /// How it was made.
    pub how: String,
    /// Its relative standard error.
    pub error: f64,
}

impl Truth {
    /// Of a picture that was path-traced.
    fn of(r: Reference) -> Self {
        let how = format!("path-traced single scattering, {} samples a pixel, its own noise {:.4}", r.samples, r.relative_error);
        Self { picture: r.picture, how, error: r.relative_error }
    }

    /// Relative RMSE against the truth, whose own noise, independent of any picture's error, is taken off in quadrature; and
    /// its 95 % interval over pixels.
    pub fn rmse(&self, picture: &Picture) -> Option<(f64, [f64; 2])> {
        judged(picture, &self.picture, self.error)
    }
}

/// What so many bands leave, as a picture.
struct Cut {
    bands: u32,
    picture: Picture,
    /// Its standard error.
    error: f64,
}

impl Cut {
    /// How far it is from the truth; the noise of both is taken off.
    fn level(&self, truth: &Truth) -> Level {
        let noise = truth.error.hypot(self.error / mean(&truth.picture).max(1e-12));
        let (rmse, interval) = judged(&self.picture, &truth.picture, noise).unwrap_or_default();
        Level { bands: self.bands, rmse, interval }
    }
}

/// The mean of all samples of two independent pictures.
fn merged(a: Reference, b: &Reference) -> Reference {
    let samples = a.samples + b.samples;
    let [x, y] = [a.samples, b.samples].map(|n| f64::from(n) / f64::from(samples));
    let mean = |a: f32, b: f32| (x * f64::from(a) + y * f64::from(b)) as f32;
    let mut picture = a.picture;
    for (a, b) in picture.rgba.iter_mut().zip(&b.picture.rgba) {
        *a = std::array::from_fn(|c| mean(a[c], b[c]));
    }
    let relative_error = (x * a.relative_error).hypot(y * b.relative_error);
    Reference { picture, samples, relative_error, standard_error: Vec::new(), cancelled: a.cancelled || b.cancelled }
}

impl Frames<'_> {
    /// What `pictures` are judged against: single scattering without harmonics, in the time that is left, or until its noise is
    /// a tenth of the least error that it judges. Fills `report` with the errors that so many bands leave, and with what noise
    /// hides.
    pub fn truth(
        &self,
        pictures: &[Picture],
        cost: &dyn Fn(&Visibility) -> f64,
        clock: &mut Clock,
        report: &mut SubjectReport,
    ) -> Result<Truth> {
        let left = clock.left(1.0).max(SURE * clock.share);
        let sky = &self.subject.sky;
        let first = self.trace(sky, 0, SHARES[0] * left, ReferenceSettings { error: CUT_ERROR, ..Default::default() }, clock)?;
        let cuts = if matches!(&self.subject.matter, Matter { surface: Some(s), .. } if s.shading == Shading::Lambert) {
            let (cuts, name) = self.dense_cuts(SHARES[1] * left, cost, clock)?;
            report.floor = format!("of {name}");
            cuts
        } else {
            report.floor = "SH-exact".into();
            (1..=4).map(|bands| self.cut(bands, 0.25 * SHARES[1] * left, clock)).collect::<Result<Vec<_>>>()?
        };
        let rough = Truth::of(first.clone());
        let levels = cuts.iter().map(|c| c.level(&rough).rmse);
        let judged = levels.chain(pictures.iter().filter_map(|p| rough.rmse(p)).map(|(rmse, _)| rmse));
        // What lies below the rough reference's noise may be anything; then a tenth of that noise is wanted.
        let wanted = TENTH * judged.map(|rmse| rmse.max(rough.error)).fold(f64::INFINITY, f64::min);
        let more = f64::from(first.samples) * ((first.relative_error / wanted).powi(2) - 1.0);
        let truth = match more.is_finite() && more >= 1.0 {
            true => {
                let settings = ReferenceSettings { samples: more.min(f64::from(u32::MAX / 2)) as u32, error: 0.0, ..Default::default() };
                let left = clock.left(1.0).max(0.5 * SURE * clock.share);
                Truth::of(merged(first, &self.trace(sky, 1, left, settings, clock)?))
            }
            false => rough,
        };
        report.image_reference_wanted = if wanted.is_finite() { wanted } else { 0.0 };
        if truth.error > 1.05 * wanted {
            report.left_out.push(format!(
                "reference picture: its noise of {:.4} is taken off; a tenth of the least error that it judges were {wanted:.4}",
                truth.error
            ));
        }
        report.levels = cuts.iter().map(|c| c.level(&truth)).collect();
        for Level { bands, interval, .. } in report.levels.iter().filter(|l| l.interval[0] == 0.0) {
            report.left_out.push(format!("floor of {bands} bands: below {:.3}, no closer told from the pictures' noise", interval[1]));
        }
        report.levels.retain(|l| l.interval[0] > 0.0);
        Ok(truth)
    }

    /// A path-traced picture in about `seconds`.
    fn trace(&self, sky: &Sky, seed: u32, seconds: f64, settings: ReferenceSettings, clock: &mut Clock) -> Result<Reference> {
        let settings = ReferenceSettings { seconds: Some(seconds.max(0.1)), seed, ..settings };
        self.engine.render_reference(self.medium, sky, &self.subject.camera, &self.exact(), &settings, &mut |_, _| clock.tick())
    }

    /// The densest field that `allowed` seconds are predicted to allow, and what it is.
    fn dense(&self, allowed: f64, cost: &dyn Fn(&Visibility) -> f64, clock: &mut Clock) -> Result<(Field, String)> {
        let own = self.subject.ratio;
        let at = |method, ratio: u32, directions, step: f32| Visibility {
            method,
            ratio,
            directions,
            step,
            near: 4,
            bits: 32,
            ..Visibility::default()
        };
        let finer = (own / 2).max(1);
        // A finer grid before more directions: beside thin matter the grid is what shows.
        let list = [
            at(Method::March, 1, 400, 1.0),
            at(Method::Sweep, 1, 256, 1.0),
            at(Method::March, finer, 400, 1.0),
            at(Method::Sweep, finer, 256, 1.0),
            at(Method::Sweep, own, 256, 1.0),
        ];
        let fits = |v: &&Visibility| cost(v) <= allowed && self.engine.precompute_memory(self.medium, v).is_ok_and(|m| m.0 <= 1 << 29);
        let v = list.iter().find(fits).unwrap_or(&list[4]);
        let (dense, _) = self.field(v, clock)?;
        Ok((dense, format!("{} at 1:{}", candidates::name(v), v.ratio)))
    }

    /// What so many bands leave of the error when nothing else does: the path-traced picture under the light cut to them. For
    /// ∫ V L' is Σ v L', a cut light meets the exact field cut likewise. Radiance that rings below zero is traced apart and
    /// taken off.
    fn cut(&self, bands: u32, seconds: f64, clock: &mut Clock) -> Result<Cut> {
        clock.check()?;
        let (light, image) = (self.subject.light.bands(bands as usize), self.exact());
        let mut sum = Picture::new(image.width, image.height);
        let mut error: f64 = 0.0;
        for (sign, share, seed) in [(1.0, 0.75, 1), (-1.0, 0.25, 2)] {
            let probe = Probe::from_fn(128, 64, |dir| light.radiance(dir).map(|v| (sign * v).max(0.0) as f32))?;
            if probe.mean() == [0.0; 3] {
                continue;
            }
            let settings = ReferenceSettings { error: CUT_ERROR, ..Default::default() };
            let r = self.trace(&Sky::from_probe(&probe), 8 * bands + seed, share * seconds, settings, clock)?;
            // Of what was never lit no noise is known.
            if r.relative_error.is_finite() {
                error = error.hypot(r.relative_error * mean(&r.picture));
            }
            for (to, from) in sum.rgba.iter_mut().zip(&r.picture.rgba) {
                *to = [0, 1, 2, 3].map(|c| if c < 3 { to[c] + sign as f32 * from[c] } else { from[c] });
            }
        }
        Ok(Cut { bands, picture: sum, error })
    }

    /// The same for a surface that a lobe about its normal lights, where no cut light stands for a cut field: the dense
    /// field's pictures.
    fn dense_cuts(&self, allowed: f64, cost: &dyn Fn(&Visibility) -> f64, clock: &mut Clock) -> Result<(Vec<Cut>, String)> {
        let (dense, name) = self.dense(allowed, cost, clock)?;
        let mut cuts = Vec::new();
        for bands in 1..=4 {
            let (picture, _) = self.picture(&self.lit(&dense, bands as usize)?, &self.exact(), clock)?;
            cuts.push(Cut { bands, picture, error: 0.0 });
        }
        Ok((cuts, name))
    }

    /// FLIP of what a viewer would see.
    pub fn flip(&self, a: &Picture, b: &Picture) -> f64 {
        let shown = |p: &Picture| exposed(p, self.image.exposure);
        flip::display(&shown(a), &shown(b)).map_or(f64::NAN, |f| f.mean)
    }
}

/// |a − b| of the mean of R, G, B, in units of the mean of `b` where it covers.
pub fn difference(a: &Picture, b: &Picture) -> Vec<f32> {
    let grey = |p: &[f32; 4]| (p[0] + p[1] + p[2]) / 3.0;
    let mean = mean(b).max(1e-9) as f32;
    a.rgba.iter().zip(&b.rgba).map(|(a, b)| (grey(a) - grey(b)).abs() / mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_pictures_merge_by_their_samples() {
        let of = |value: f32, samples, relative_error| Reference {
            picture: Picture { width: 1, height: 1, rgba: vec![[value, 0.0, 0.0, 1.0]] },
            standard_error: Vec::new(),
            relative_error,
            samples,
            cancelled: false,
        };
        let both = merged(of(1.0, 100, 0.03), &of(2.0, 300, 0.03 / 3f64.sqrt()));
        assert_eq!((both.picture.rgba[0], both.samples), ([1.75, 0.0, 0.0, 1.0], 400));
        // The noise of four times the samples is half.
        assert!((both.relative_error - 0.015).abs() < 1e-12);
    }
}
