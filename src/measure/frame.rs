//! The measured error of a picture: against unbiased Monte Carlo without harmonics, at fewer of the same camera's pixels.

use super::flip;
use crate::engine::{Engine, Lit, Medium, Progress, ReferenceSettings};
use crate::error::Result;
use crate::scene::{Camera, ImageSettings, Picture, Sky};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Pixels that are measured, at most: their scatter is a hundredth of the error.
const PIXELS: f64 = 96.0 * 72.0;

/// Share of the noise's square that is itself in doubt: few samples meet what is bright and rare.
const DOUBT: f64 = 0.1;

/// Relative standard error at which the reference is sure enough.
const SURE: f64 = 0.01;

/// How far a picture is from light without harmonics, fields or long steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PictureError {
    /// Pixels per row, and rows, at which it was measured.
    pub size: [usize; 2],
    /// √mean((a − b)²)/mean(b) over R, G, B of the covered pixels, the reference's own noise taken off in quadrature.
    pub relative_rmse: f64,
    /// 95 % confidence interval, by the spread of the pixels; begins at 0 where the noise hides the error.
    pub interval: [f64; 2],
    /// mean(a)/mean(b) over the covered pixels: 1.04 is 4 % too bright.
    pub mean_ratio: f64,
    /// Mean of LDR-FLIP at the image's exposure, of all pixels, covered or not; the reference's noise is left in.
    pub flip: f64,
    /// Relative standard error of the reference: taken off the RMSE alone.
    pub noise: f64,
    /// Samples of a pixel of the reference.
    pub samples: u32,
    /// Seconds that measuring took.
    pub seconds: f64,
}

/// A picture, and what its reference needs besides.
pub struct Pictured<'a> {
    /// The scene's matter.
    pub medium: &'a Medium,
    /// Its field under the light.
    pub lit: &'a Lit,
    /// The same light without harmonics.
    pub sky: &'a Sky,
    /// Its camera.
    pub camera: &'a Camera,
    /// Size, step and exposure.
    pub image: &'a ImageSettings,
}

impl PictureError {
    /// Renders the picture and its reference with the camera's own frame at some thousand pixels, and compares them, in about
    /// `seconds`. `None` where nothing is covered, or all is black. Takes the engine's timings.
    ///
    /// # Errors
    /// As [`Engine::render`] and [`Engine::render_reference`].
    pub fn measure(engine: &Engine, of: &Pictured, seconds: f64, progress: &mut Progress) -> Result<Option<Self>> {
        let Pictured { medium, lit, sky, camera, image } = *of;
        let start = Instant::now();
        let shrink = (PIXELS / (image.width * image.height) as f64).sqrt().min(1.0);
        let side = |n: usize| ((n as f64 * shrink).round() as usize).max(1);
        let image = ImageSettings { width: side(image.width), height: side(image.height), ..*image };
        let picture = engine.render(medium, lit, camera, &image, &mut |_, f| progress("measure", 0.05 * f))?;
        // Shorter steps than the picture's: what its own cost is part of the error.
        let exact = ImageSettings { step: image.step.min(0.5), ..image };
        let settings = ReferenceSettings { error: SURE, seconds: Some(seconds), ..ReferenceSettings::default() };
        let r = engine.render_reference(medium, sky, camera, &exact, &settings, &mut |_, f| progress("measure", 0.05 + 0.95 * f))?;
        engine.take_timings();
        let Some((relative_rmse, interval)) = judged(&picture, &r.picture, r.relative_error) else { return Ok(None) };
        let covered: Vec<_> = picture.rgba.iter().zip(&r.picture.rgba).filter(|(_, b)| b[3] > 0.0).collect();
        let sum = |p: &[f32; 4]| f64::from(p[0]) + f64::from(p[1]) + f64::from(p[2]);
        let (a, b) = covered.iter().fold((0.0, 0.0), |(x, y), (a, b)| (x + sum(a), y + sum(b)));
        Ok(Some(Self {
            size: [image.width, image.height],
            relative_rmse,
            interval,
            mean_ratio: a / b,
            flip: flip::display(&exposed(&picture, image.exposure), &exposed(&r.picture, image.exposure))?.mean,
            noise: r.relative_error,
            samples: r.samples,
            seconds: start.elapsed().as_secs_f64(),
        }))
    }

    /// The keys of [`PictureError::meta`]: one line for people, one object for programs.
    pub const KEYS: [&str; 2] = ["picture_error", "picture_error_json"];

    /// The error as pairs for a picture's header.
    pub fn meta(&self) -> Vec<(String, String)> {
        let json = serde_json::to_string(self).unwrap_or_default();
        vec![(Self::KEYS[0].into(), self.sentence()), (Self::KEYS[1].into(), json)]
    }

    /// One line.
    pub fn sentence(&self) -> String {
        let [lo, hi] = self.interval;
        let [w, h] = self.size;
        format!(
            "relative RMSE {:.3} [{lo:.3}, {hi:.3}], {:+.1} % of brightness, FLIP {:.3}; {w}x{h} pixels against Monte Carlo of {} samples, \
             whose noise of {:.3} is taken off the RMSE, not off FLIP, which is of all pixels",
            self.relative_rmse,
            100.0 * (self.mean_ratio - 1.0),
            self.flip,
            self.samples,
            self.noise
        )
    }
}

/// A picture as a viewer sees it at an exposure, linear.
pub(crate) fn exposed(p: &Picture, exposure: f64) -> Picture {
    let gain = exposure.exp2() as f32;
    Picture { rgba: p.rgba.iter().map(|&[r, g, b, a]| [r * gain, g * gain, b * gain, a]).collect(), ..*p }
}

/// √(mean square difference − noise²) over the mean of `b`, R, G, B of the pixels that `b` covers; and its 95 % interval, by
/// the spread of those pixels. `None` where nothing is covered.
pub(crate) fn judged(a: &Picture, b: &Picture, noise: f64) -> Option<(f64, [f64; 2])> {
    let pairs = a.rgba.iter().zip(&b.rgba).filter(|(_, b)| b[3] > 0.0);
    let squares: Vec<f64> = pairs.map(|(a, b)| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>() / 3.0).collect();
    let (n, scale) = (squares.len() as f64, covered_mean(b).powi(2));
    if n < 2.0 || scale <= 0.0 {
        return None;
    }
    let square = squares.iter().sum::<f64>() / n;
    let variance = squares.iter().map(|s| (s - square).powi(2)).sum::<f64>() / (n - 1.0);
    let spread = (variance / n).sqrt();
    let at = |k: f64, doubt: f64| ((square + k * spread) / scale - (1.0 - doubt) * noise * noise).max(0.0).sqrt();
    let [least, value, most] = [at(-1.96, -DOUBT), at(0.0, 0.0), at(1.96, DOUBT)];
    Some((value, [least, most]))
}

/// Mean of R, G, B over the covered pixels.
pub(crate) fn covered_mean(picture: &Picture) -> f64 {
    let covered = || picture.rgba.iter().filter(|p| p[3] > 0.0);
    let sum: f64 = covered().map(|p| f64::from(p[0]) + f64::from(p[1]) + f64::from(p[2])).sum();
    sum / (3 * covered().count().max(1)) as f64
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_taken_off_and_the_interval_holds_the_error() {
        let mut random = crate::stages::directions::SplitMix(7);
        let mut normal = || (0..12).map(|_| (random.next() >> 11) as f64 / (1u64 << 53) as f64).sum::<f64>() - 6.0;
        let mut picture = |off: f64, noise: f64| Picture {
            width: 64,
            height: 64,
            rgba: (0..64 * 64).map(|_| [0, 1, 2, 3].map(|c| if c < 3 { (2.0 + off + noise * normal()) as f32 } else { 1.0 })).collect(),
        };
        // Off by 0.3 of a mean of 2, seen through noise of 0.4 of that mean.
        let (exact, noisy) = (picture(0.3, 0.0), picture(0.0, 0.8));
        let (rmse, [least, most]) = judged(&exact, &noisy, 0.4).unwrap();
        assert!((rmse - 0.15).abs() < 0.02, "{rmse}");
        // A tenth of the noise's square, and the pixels' scatter of about 0.003: √(0.0225 ± 0.019).
        assert!((0.04..0.10).contains(&least) && (0.18..0.22).contains(&most), "[{least}, {most}]");
        // Sabotage: with its noise left in, the error is another.
        assert!(judged(&exact, &noisy, 0.0).unwrap().0 > 0.4);
        // Noise alone is no error, and nothing covered is none either.
        let [none, some] = judged(&picture(0.0, 0.0), &noisy, 0.4).unwrap().1;
        assert!(none == 0.0 && some > 0.3 * 0.4, "what noise hides may be a third of it: {some}");
        assert!(judged(&exact, &Picture::new(64, 64), 0.0).is_none());
    }
}
