//! What pictures are judged against, and the error that no better field takes away.

use super::frame::Frames;
use super::{Clock, Level, SubjectReport, candidates};
use crate::engine::{Field, ReferenceSettings};
use crate::error::Result;
use crate::measure::{covered_mean as mean, exposed, flip, judged};
use crate::scene::visibility::Method;
use crate::scene::{Matter, Picture, Probe, Shading, Sky, Visibility};

/// Relative standard error at which the reference picture is good enough: a tenth of what good frames are off by.
const REFERENCE_ERROR: f64 = 0.005;

/// What pictures are judged against.
pub struct Truth {
    /// The picture.
    pub picture: Picture,
    /// How it was made.
    pub how: String,
    /// Its relative standard error.
    pub error: f64,
}

impl Frames<'_> {
    /// Fills `report` with the errors that so many bands leave, and left-out floors that noise hides.
    pub fn floors(
        &self,
        truth: &Truth,
        allowed: f64,
        cost: &dyn Fn(&Visibility) -> f64,
        clock: &mut Clock,
        report: &mut SubjectReport,
    ) -> Result<()> {
        if matches!(&self.subject.matter, Matter { surface: Some(s), .. } if s.shading == Shading::Lambert) {
            let (levels, name) = self.dense_levels(truth, allowed, cost, clock)?;
            (report.levels, report.floor) = (levels, format!("of {name}"));
        } else {
            report.floor = "SH-exact".into();
            for bands in 1..=4 {
                clock.check()?;
                report.levels.push(self.floor(truth, bands, 0.25 * allowed, clock)?);
            }
        }
        for Level { bands, interval, .. } in report.levels.iter().filter(|l| l.interval[0] == 0.0) {
            report.left_out.push(format!("floor of {bands} bands: below {:.3}, no closer told from the pictures' noise", interval[1]));
        }
        report.levels.retain(|l| l.interval[0] > 0.0);
        Ok(())
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

    /// What so many bands leave of the error when nothing else does: how far the path-traced picture under the light cut to
    /// them is from the truth. For ∫ V L' is Σ v L', a cut light meets the exact field cut likewise. Radiance that rings
    /// below zero is traced apart and taken off. The noise of all is taken off in quadrature.
    fn floor(&self, truth: &Truth, bands: usize, allowed: f64, clock: &mut Clock) -> Result<Level> {
        let (light, s, image) = (self.subject.light.bands(bands), self.subject, self.exact());
        let mut sum = Picture::new(image.width, image.height);
        let mut variance = (truth.error * mean(&truth.picture)).powi(2);
        for (sign, share, seed) in [(1.0, 0.75, 1), (-1.0, 0.25, 2)] {
            let probe = Probe::from_fn(128, 64, |dir| light.radiance(dir).map(|v| (sign * v).max(0.0) as f32))?;
            if probe.mean() == [0.0; 3] {
                continue;
            }
            let seconds = Some((share * allowed).max(0.1));
            let settings = ReferenceSettings { error: REFERENCE_ERROR, seconds, seed: 8 * bands as u32 + seed, ..Default::default() };
            let r = self
                .engine
                .render_reference(self.medium, &Sky::from_probe(&probe), &s.camera, &image, &settings, &mut |_, _| clock.tick())?;
            variance += (r.relative_error * mean(&r.picture)).powi(2);
            for (to, from) in sum.rgba.iter_mut().zip(&r.picture.rgba) {
                *to = [0, 1, 2, 3].map(|c| if c < 3 { to[c] + sign as f32 * from[c] } else { from[c] });
            }
        }
        let noise = variance.sqrt() / mean(&truth.picture).max(1e-12);
        let (rmse, interval) = judged(&sum, &truth.picture, noise).unwrap_or_default();
        Ok(Level { bands: bands as u32, rmse, interval })
    }

    /// The same for a surface that a lobe about its normal lights, where no cut light stands for a cut field: the dense
    /// field's pictures.
    fn dense_levels(
        &self,
        truth: &Truth,
        allowed: f64,
        cost: &dyn Fn(&Visibility) -> f64,
        clock: &mut Clock,
    ) -> Result<(Vec<Level>, String)> {
        let (dense, name) = self.dense(allowed, cost, clock)?;
        let mut levels = Vec::new();
        for bands in 1..=4 {
            let (picture, _) = self.picture(&self.lit(&dense, bands)?, &self.exact(), clock)?;
            let (rmse, interval) = self.rmse(&picture, truth).unwrap_or_default();
            levels.push(Level { bands: bands as u32, rmse, interval });
        }
        Ok((levels, name))
    }

    /// The picture that others are judged against: single scattering without harmonics, in about `allowed` seconds.
    pub fn judge(&self, allowed: f64, clock: &mut Clock) -> Result<(Picture, String, f64)> {
        let settings = ReferenceSettings { error: REFERENCE_ERROR, seconds: Some(allowed.max(1.0)), ..ReferenceSettings::default() };
        let s = self.subject;
        let r = self.engine.render_reference(self.medium, &s.sky, &s.camera, &self.exact(), &settings, &mut |_, _| clock.tick())?;
        let error = r.relative_error;
        Ok((r.picture, format!("path-traced single scattering, {} samples a pixel, its own error {error:.4}", r.samples), error))
    }

    /// Relative RMSE against the truth, whose own noise, independent of any picture's error, is taken off in quadrature; and
    /// its 95 % interval over pixels.
    pub fn rmse(&self, picture: &Picture, truth: &Truth) -> Option<(f64, [f64; 2])> {
        judged(picture, &truth.picture, truth.error)
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
