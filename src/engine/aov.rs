//! What lies behind each pixel of a picture: strip by strip, as [`Engine::render`].

use super::budget::SLACK;
use super::render::MOST_SAMPLES;
use super::{Engine, Lit, Medium, Pacer, Progress};
use crate::error::{Error, Result};
use crate::room::reserved;
use crate::scene::{Camera, ImageSettings, Picture};
use crate::stages::aov::{self, Frame, Inputs, STATE};
use crate::stages::occupancy::Leap;
use crate::stages::raymarch::{Part, View};
use crate::vk::Access;
use std::ops::ControlFlow;
use std::time::Instant;

pub use crate::stages::aov::{Behind, LAYERS};

/// Gives what lies behind a surface's pixels its albedo, and the irradiance that made the picture of it: the picture is
/// their product.
pub fn surface_layers(behind: &mut [Behind], picture: &Picture, albedo: [f32; 3]) {
    for (b, p) in behind.iter_mut().zip(&picture.rgba).filter(|(b, _)| b.opacity > 0.0) {
        b.albedo = albedo;
        b.irradiance = [0, 1, 2].map(|c| if albedo[c] > 0.0 { p[c] / albedo[c] } else { 0.0 });
    }
}

/// The channels of a layer, by its place in [`LAYERS`]: name, and a number per pixel.
pub fn layer_channels(layer: usize, behind: &[Behind]) -> impl Iterator<Item = (&'static str, Vec<f32>)> + '_ {
    let channels = LAYERS.get(layer).map_or(&[][..], |l| l.1);
    channels.iter().enumerate().map(move |(c, name)| (*name, behind.iter().map(|b| b.channel(layer, c)).collect()))
}

/// Pixels that are gathered together.
fn slots(image: &ImageSettings) -> usize {
    (aov::MOST as usize / image.width).min(image.height).max(1) * image.width
}

/// Bytes of device memory that gathering takes.
pub(super) fn bytes(image: &ImageSettings) -> u64 {
    aov::BYTES * slots(image) as u64 + SLACK
}

/// Samples of one row in a dispatch, at most: each asks for a normal too.
const ROW_SAMPLES: u32 = 1 << 21;

impl Engine {
    /// What lies behind each pixel of the picture that [`Engine::render`] makes of the same scene, row by row from the top.
    /// `hits` are the distances of [`Engine::render_with_distance`], which a surface needs. Albedo and irradiance of a
    /// surface are left zero: [`surface_layers`] gives them.
    ///
    /// # Errors
    /// As [`Engine::render`], and [`Error::Invalid`] where a surface's distances are missing.
    pub fn aovs(
        &self,
        medium: &Medium,
        lit: &Lit,
        camera: &Camera,
        image: &ImageSettings,
        hits: &[f32],
        progress: &mut Progress,
    ) -> Result<Vec<Behind>> {
        let grid = medium.grid();
        let view = View::new(grid, &camera.rays(grid, image.width, image.height)?);
        let (width, height) = (image.width as u32, image.height as u32);
        let surface = medium.matter.surface;
        let pixels = image.width * image.height;
        if surface.is_some() && hits.len() != pixels {
            return Err(Error::Invalid {
                item: "hits",
                what: format!("{} distances for {pixels} pixels", hits.len()),
                right: "a surface needs one for each".into(),
            });
        }
        let (step_length, steps) = super::render::steps(grid, image)?;
        let steps = if surface.is_some() { 1 } else { steps };
        let segment = (self.device.loop_limit() / 3).min((ROW_SAMPLES / width).max(64));
        let most = ((aov::MOST as usize / image.width) as u32).min(height).max(1);
        let slots = slots(image);
        self.ask("the picture's layers", aov::BYTES * slots as u64, |_| "render fewer pixels, or allow more memory".into())?;
        let (irradiance, window, light_scale) = lit.irradiance();
        let encoding = medium.volume.0.encoding;
        let iso = surface.map(|s| (encoding.sample_of(s.iso as f32), encoding.scale > 0.0));
        let frame = self.device.buffer_from("frame", &[Frame::new(grid, iso, light_scale)])?;
        let state = self.device.buffer::<[f32; 4]>("state", STATE * slots)?;
        let found = self.device.buffer::<f32>("hit distance", if surface.is_some() { slots } else { 1 })?;
        if surface.is_none() {
            self.device.write(&found, &[-1f32])?;
        }
        let mut rec = self.device.record()?;
        // A fresh buffer: the first dispatch writes without reading.
        rec.barrier(&[state.all().from(Access::None).to(Access::ComputeReadWrite)]);
        rec.submit()?;
        let leap = Leap {
            distances: &medium.occupancy.distances,
            bounds: if image.skip { medium.occupancy.bounds().unwrap_or_default() } else { [[0; 3], grid.dims()] },
            skip: image.skip,
        };
        let mut tell = |fraction: f64| match progress("layers", fraction as f32) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Error::Cancelled),
        };
        tell(0.0)?;
        let mut out = reserved("a picture's layers", pixels)?;
        // As for the picture.
        let first = u64::from(ROW_SAMPLES) / (steps * u64::from(width)).max(1);
        let most = (MOST_SAMPLES / 8 / (u64::from(width) * steps.min(u64::from(segment)))).clamp(1, u64::from(most));
        let mut pacer = Pacer::new(first.clamp(1, 8) as u32, most as u32);
        let mut row = 0;
        while row < height {
            let rows = pacer.size.min(height - row);
            let count = (rows * width) as usize;
            let start = Instant::now();
            if surface.is_some() {
                self.device.write(&found, &hits[(row * width) as usize..][..count])?;
            }
            for first_step in (0..steps).step_by(segment as usize) {
                let part =
                    Part { width, first_row: row, rows, first_step: first_step as u32, step_count: segment, step_length, backed: false };
                let inputs = Inputs { irradiance, window, frame: &frame, hits: &found, surface: surface.is_some(), leap };
                let mut rec = self.device.record()?;
                aov::record(&mut rec, &medium.view(), &inputs, &view, part, &state)?;
                // The next part of the rays continues from this state.
                rec.barrier(&[state.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                rec.submit()?;
                let done = first_step + u64::from(segment);
                if done < steps {
                    tell((f64::from(row) + f64::from(rows) * done as f64 / steps as f64) / f64::from(height))?;
                }
            }
            pacer.took(rows, start.elapsed().as_secs_f64());
            let sums: Vec<[[f32; 4]; STATE]> = self.device.read(&state, count)?;
            out.extend(sums.iter().map(Behind::of));
            let mut rec = self.device.record()?;
            // The next strip writes over what the host has read.
            rec.barrier(&[state.all().from(Access::ComputeRead).to(Access::ComputeReadWrite)]);
            rec.submit()?;
            row += rows;
            tell(f64::from(row) / f64::from(height))?;
        }
        Ok(out)
    }
}
