//! What work will cost, by a pilot on this device: said before it starts.

use super::{Behind, Engine, Lit, Medium, Progress, ReferenceSettings, Span, aov, quiet};
use crate::error::Result;
use crate::scene::visibility::Method;
use crate::scene::{Camera, ImageSettings, Sky, Visibility};
use crate::stages::trace::BLOCK;
use std::time::Instant;

/// Cells of a field's pilot, at most.
const CELLS: usize = 4096;

/// Directions of a field's pilot.
const DIRECTIONS: u32 = 16;

/// Each side of a picture's pilot is this part of the picture's.
const PART: usize = 8;

/// A picture's pilot of fewer seconds may have taken a dispatch's time and not its pixels': a second of twice the side tells.
const LATENT: f64 = 0.01;

/// How often each of these is tried.
const LATENT_TRIES: u32 = 3;

/// Pixels of a reference picture's pilot, if it has as many: its sampling takes longer than its dispatches.
const TRACED: f64 = 4096.0;

/// Memory and time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Bytes of the result: of a field on the device, of a picture in main memory.
    pub kept: u64,
    /// Bytes of device memory that are held meanwhile, besides.
    pub passing: u64,
    /// Seconds of device time, as a short pilot tells; of wall clock where the device keeps no time.
    pub seconds: f64,
}

impl Engine {
    /// What a field would cost. Its pilot estimates some cells in few directions, a sweep all cells; it takes the engine's
    /// timings. `progress` can cancel it.
    ///
    /// # Errors
    /// As [`Engine::estimate`].
    pub fn field_cost(&self, medium: &Medium, settings: &Visibility, progress: &mut Progress) -> Result<Cost> {
        let (kept, passing) = self.precompute_memory(medium, settings)?;
        let wanted = self.wanted_cells(medium, settings)?;
        let stride = wanted.len().div_ceil(CELLS).max(1);
        let some: Vec<u32> = wanted.iter().copied().step_by(stride).collect();
        let mut seconds = 0.0;
        if !some.is_empty() {
            // The second pilot takes twice the first's.
            let mut run = |directions: u32, cells: &[u32]| {
                let settings = Visibility { directions, ..settings.clone() };
                let [from, to] = if directions > DIRECTIONS { [0.33, 1.0] } else { [0.0, 0.33] };
                let mut part = |_: &'static str, f: f32| progress("pilot", from + f * (to - from));
                self.timed(|| self.estimate(medium, &settings, cells, &mut part).map(|_| ()))
            };
            // Whatever a kernel's first dispatch costs is not the pilot's.
            run(1, &some[..1])?;
            let n = settings.directions;
            let cells = if settings.method == Method::Sweep { 1.0 } else { wanted.len() as f64 / some.len() as f64 };
            let first = run(n.min(DIRECTIONS), &some)?;
            seconds = first * cells * f64::from(n) / f64::from(n.min(DIRECTIONS));
            if n > 2 * DIRECTIONS {
                // What is done once, and what each direction takes.
                let twice = run(2 * DIRECTIONS, &some)?;
                let all = twice / f64::from(2 * DIRECTIONS);
                // The clock's noise must not make one of them all or nothing.
                let each = ((twice - first) / f64::from(DIRECTIONS)).clamp(0.4 * all, all);
                let once = (twice - each * f64::from(2 * DIRECTIONS)).max(0.0);
                seconds = once + each * f64::from(n) * cells;
            }
        }
        Ok(Cost { kept, passing, seconds })
    }

    /// What a picture would cost, with what lies behind its pixels if that is wanted too ([`Engine::aovs`]): its pilot renders it
    /// small. It takes the engine's timings. `progress` can cancel it.
    ///
    /// # Errors
    /// As [`Engine::render`].
    pub fn picture_cost(
        &self,
        medium: &Medium,
        lit: &Lit,
        (camera, image): (&Camera, &ImageSettings),
        layers: bool,
        progress: &mut Progress,
    ) -> Result<Cost> {
        let part = |n: usize| ImageSettings { width: image.width.div_ceil(n), height: image.height.div_ceil(n), ..*image };
        let small = part(PART);
        let one = ImageSettings { width: 1, height: 1, ..*image };
        let mut run = |image: &ImageSettings| {
            self.timed(|| {
                let mut part = |_: &'static str, f: f32| progress("pilot", f);
                let (_, hits) = self.render_with_distance(medium, lit, camera, image, &mut part)?;
                if layers {
                    self.aovs(medium, lit, camera, image, &hits, &mut part)?;
                }
                Ok(())
            })
        };
        // Whatever a kernel's first dispatch costs is not the pilot's.
        run(&one)?;
        let taken = run(&small)?;
        let mut seconds = taken * pixels(image) / pixels(&small);
        if taken < LATENT {
            let larger = part(PART / 2);
            // Whatever else runs makes a try longer, none shorter.
            let mut least = |image: &ImageSettings| (0..LATENT_TRIES).try_fold(f64::INFINITY, |t, _| Ok(t.min(run(image)?)));
            seconds = extrapolated([(pixels(&small), least(&small)?), (pixels(&larger), least(&larger)?)], pixels(image));
        }
        let need = self.need(medium, lit.field().settings(), Some((image.width, image.height)))?;
        let (pixel, behind) = if layers { (16 + size_of::<Behind>(), aov::bytes(image)) } else { (16, 0) };
        Ok(Cost { kept: pixels(image) as u64 * pixel as u64, passing: need.picture.max(behind), seconds })
    }

    /// What a reference picture would cost: its pilot takes the fewest samples of a smaller one, whose standard error says how
    /// many samples the asked one needs. It takes the engine's timings. `progress` can cancel it.
    ///
    /// # Errors
    /// As [`Engine::render_reference`].
    pub fn reference_cost(
        &self,
        medium: &Medium,
        sky: &Sky,
        (camera, image): (&Camera, &ImageSettings),
        settings: &ReferenceSettings,
        progress: &mut Progress,
    ) -> Result<Cost> {
        let shrink = f64::max(1.0 / (PART * PART) as f64, TRACED / pixels(image)).min(1.0).sqrt();
        let side = |n: usize| ((n as f64 * shrink).ceil() as usize).max(1);
        let small = ImageSettings { width: side(image.width), height: side(image.height), ..*image };
        let one = ImageSettings { width: 1, height: 1, ..*image };
        let few = ReferenceSettings { samples: 2 * BLOCK, error: 0.0, first: 2 * BLOCK, seconds: None, ..*settings };
        // Whatever a kernel's first dispatch costs is not the pilot's.
        self.timed(|| self.render_reference(medium, sky, camera, &one, &few, &mut quiet).map(|_| ()))?;
        let mut found = None;
        let taken = self.timed(|| {
            found = Some(self.render_reference(medium, sky, camera, &small, &few, &mut |_, f| progress("pilot", f))?);
            Ok(())
        })?;
        let error = found.map_or(0.0, |r| r.relative_error);
        let first = f64::from(few.samples);
        let needed = if settings.error > 0.0 { 1.05 * first * (error / settings.error).powi(2) } else { f64::INFINITY };
        let each = taken * pixels(image) / (pixels(&small) * first);
        let seconds = each * needed.clamp(first, f64::from(settings.samples).max(first));
        Ok(Cost {
            kept: pixels(image) as u64 * 28,
            passing: self.reference_bytes(medium, sky, image),
            // No pass begins beyond the bound, but the first.
            seconds: seconds.min(settings.seconds.map_or(f64::INFINITY, |s| s.max(each * first))),
        })
    }

    /// Device seconds of some work; of wall clock where the device keeps no time.
    fn timed(&self, work: impl FnOnce() -> Result<()>) -> Result<f64> {
        self.take_timings();
        let start = Instant::now();
        work()?;
        Ok(Span::seconds(&self.take_timings(), start))
    }
}

/// Seconds of so many pixels after two smaller pictures of (pixels, seconds): what is done once, and what each pixel takes.
fn extrapolated([(few, first), (more, second)]: [(f64, f64); 2], all: f64) -> f64 {
    if more <= few {
        return second * all / more;
    }
    // The clock's noise must make none of them negative, nor pixels free.
    let all_each = second / more;
    let each = ((second - first) / (more - few)).clamp(0.1 * all_each, all_each);
    second + each * (all - more).max(0.0)
}

fn pixels(image: &ImageSettings) -> f64 {
    image.width as f64 * image.height as f64
}

#[cfg(test)]
mod tests {
    use super::extrapolated;

    #[test]
    fn what_is_done_once_is_not_multiplied() {
        let off = |a: f64, b: f64| (a - b).abs() < 1e-12;
        // Proportional to pixels; all latency; both; and noise.
        assert!(off(extrapolated([(100.0, 0.1), (400.0, 0.4)], 6400.0), 6.4));
        assert!(off(extrapolated([(100.0, 7e-5), (400.0, 7e-5)], 6400.0), 2.5 * 7e-5));
        assert!(off(extrapolated([(100.0, 0.2), (400.0, 0.5)], 6400.0), 6.5));
        assert!(off(extrapolated([(100.0, 8e-5), (400.0, 7e-5)], 6400.0), 2.5 * 7e-5));
        assert!(off(extrapolated([(100.0, 0.0), (400.0, 0.5)], 6400.0), 8.0));
        // A picture of one pixel is its own pilot.
        assert!(off(extrapolated([(1.0, 0.1), (1.0, 0.1)], 1.0), 0.1));
    }
}
