//! What work will cost, by a pilot on this device: said before it starts.

use super::{Engine, Lit, Medium};
use crate::error::Result;
use crate::scene::visibility::Method;
use crate::scene::{Camera, ImageSettings, Visibility};
use std::ops::ControlFlow;
use std::time::Instant;

/// Cells of a field's pilot, at most.
const CELLS: usize = 4096;

/// Directions of a field's pilot.
const DIRECTIONS: u32 = 16;

/// Each side of a picture's pilot is this part of the picture's.
const PART: usize = 8;

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
    /// timings.
    ///
    /// # Errors
    /// As [`Engine::estimate`].
    pub fn field_cost(&self, medium: &Medium, settings: &Visibility) -> Result<Cost> {
        let (kept, passing) = self.precompute_memory(medium, settings)?;
        let wanted = self.wanted_cells(medium, settings)?;
        let stride = wanted.len().div_ceil(CELLS).max(1);
        let some: Vec<u32> = wanted.iter().copied().step_by(stride).collect();
        let mut seconds = 0.0;
        if !some.is_empty() {
            let run = |directions: u32, cells: &[u32]| {
                let settings = Visibility { directions, ..settings.clone() };
                self.timed(|| self.estimate(medium, &settings, cells, &mut quiet).map(|_| ()))
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

    /// What a picture would cost: its pilot renders it small. It takes the engine's timings.
    ///
    /// # Errors
    /// As [`Engine::render`].
    pub fn picture_cost(&self, medium: &Medium, lit: &Lit, camera: &Camera, image: &ImageSettings) -> Result<Cost> {
        let small = ImageSettings { width: image.width.div_ceil(PART), height: image.height.div_ceil(PART), ..*image };
        let one = ImageSettings { width: 1, height: 1, ..*image };
        self.timed(|| self.render(medium, lit, camera, &one, &mut quiet).map(|_| ()))?;
        let taken = self.timed(|| self.render(medium, lit, camera, &small, &mut quiet).map(|_| ()))?;
        let pixels = |i: &ImageSettings| i.width as f64 * i.height as f64;
        let need = self.need(medium, lit.field().settings(), Some((image.width, image.height)))?;
        Ok(Cost { kept: pixels(image) as u64 * 16, passing: need.picture, seconds: taken * pixels(image) / pixels(&small) })
    }

    /// Device seconds of some work; of wall clock where the device keeps no time.
    fn timed(&self, work: impl FnOnce() -> Result<()>) -> Result<f64> {
        self.take_timings();
        let start = Instant::now();
        work()?;
        let spans = self.take_timings();
        Ok(if spans.iter().all(|s| s.timed) { spans.iter().map(|s| s.seconds).sum() } else { start.elapsed().as_secs_f64() })
    }
}

fn quiet(_: &'static str, _: f32) -> ControlFlow<()> {
    ControlFlow::Continue(())
}
