//! Pictures: direct volume rendering and isosurfaces, strip by strip, in dispatches of bounded time.

use super::{Engine, Lit, Medium, Pacer, Progress};
use crate::error::{Error, Result};
use crate::room::reserved;
use crate::scene::scene::Background;
use crate::scene::{Camera, Grid, ImageSettings, Picture, Surface};
use crate::stages::occupancy::Leap;
use crate::stages::raymarch::{Part, View};
use crate::stages::resolve::Form;
use crate::stages::{isosurface, raymarch, resolve};
use crate::vk::{Access, Buffer};
use std::ops::ControlFlow;
use std::time::Instant;

/// Pixels that are rendered together; bounds the memory of their state to 16 MiB.
pub(super) const STRIP: usize = 1 << 20;

/// Samples of one row in a dispatch, at most: tens of milliseconds on a CPU device.
const ROW_SAMPLES: u32 = 1 << 22;

/// Samples of a dispatch, at most (but one row).
pub(super) const MOST_SAMPLES: u64 = 1 << 26;

/// A picture about to be rendered: what was checked and made for it.
pub(super) struct Shot<'a> {
    medium: &'a Medium,
    lit: &'a Lit,
    view: View,
    step_length: f64,
    backed: bool,
    /// Of the longest ray.
    steps: u64,
    /// Steps of a dispatch.
    segment: u32,
    /// Width and height.
    size: [u32; 2],
    /// Rows of a strip.
    most: u32,
    form: Form,
    state: Buffer,
    pixels: Buffer,
    surface: Option<(Surface, Buffer, Buffer)>,
    leap: Leap<'a>,
}

/// Some rows that are done.
pub(super) struct Strip<'a> {
    pub first_row: u32,
    pub rows: u32,
    /// As the picture's form says.
    pub pixels: &'a Buffer,
    /// World distance of each hit, of an isosurface.
    pub depth: Option<&'a Buffer>,
}

impl Engine {
    /// Renders a picture: direct volume rendering, or the isosurface if the matter has one. The background is left
    /// transparent. The field under the light must be of this medium, or hold all cells
    /// ([`Cells::All`](crate::scene::visibility::Cells)): cells far from the matter that it was computed for hold no light
    /// that means anything.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an unusable camera or picture, [`Error::Cancelled`].
    pub fn render(&self, medium: &Medium, lit: &Lit, camera: &Camera, image: &ImageSettings, progress: &mut Progress) -> Result<Picture> {
        self.render_with_distance(medium, lit, camera, image, progress).map(|(picture, _)| picture)
    }

    /// Renders the isosurface and says how far it lies: world distance from the camera to the hit per pixel, −1 where
    /// there is none.
    ///
    /// # Errors
    /// As [`Engine::render`].
    pub fn render_with_distance(
        &self,
        medium: &Medium,
        lit: &Lit,
        camera: &Camera,
        image: &ImageSettings,
        progress: &mut Progress,
    ) -> Result<(Picture, Vec<f32>)> {
        let shot = self.shot(medium, lit, camera, image, false)?;
        let mut picture = Picture::asked(image.width, image.height)?;
        let hits = if shot.surface.is_some() { picture.rgba.len() } else { 0 };
        let mut distances = reserved("a picture's distances", hits)?;
        self.strips(&shot, progress, &mut |strip| {
            let first = strip.first_row as usize * image.width;
            let count = strip.rows as usize * image.width;
            self.device.read_into(strip.pixels, &mut picture.rgba[first..first + count])?;
            if let Some(depth) = strip.depth {
                distances.extend(self.device.read::<f32>(depth, count)?);
            }
            Ok(())
        })?;
        Ok((picture, distances))
    }

    /// Checks a picture and makes what it needs.
    pub(super) fn shot<'a>(
        &self,
        medium: &'a Medium,
        lit: &'a Lit,
        camera: &Camera,
        image: &ImageSettings,
        half: bool,
    ) -> Result<Shot<'a>> {
        let grid = medium.grid();
        let rays = camera.rays(grid, image.width, image.height)?;
        let view = View::new(grid, &rays);
        let (step_length, steps) = steps(grid, image)?;
        if image.width > STRIP {
            return Err(Error::Invalid {
                item: "image.width",
                what: format!("{} pixels", image.width),
                right: format!("at most {STRIP} can be rendered in a row"),
            });
        }
        // Loops besides the march: bisection, cells, harmonics.
        let (width, height) = (image.width as u32, image.height as u32);
        // One row must not take long either.
        let backed = image.background != Background::Transparent;
        // A step may cost three iterations: a leap, the loop around it, a sample; and as many again behind what is dark, where
        // only the depth is marched on.
        let per_step = if backed { 6 } else { 3 };
        let segment = (self.device.loop_limit() / per_step).saturating_sub(4096).min((ROW_SAMPLES / width).max(256));
        let most = ((STRIP / image.width) as u32).min(height).max(1);
        let slots = (most * width) as usize;
        let form = Form { depth: medium.matter.surface.is_none(), half };
        self.ask("the picture", (20 + form.bytes()) * slots as u64, |_| "render fewer pixels, or allow more memory".into())?;
        let state = self.device.buffer::<[f32; 4]>("state", slots)?;
        let pixels = self.device.buffer::<u8>("pixels", slots * form.bytes() as usize)?;
        let surface = match (medium.matter.surface, medium.matter.surface_albedo()) {
            (Some(surface), Some(albedo)) => {
                let shade = isosurface::Shade::new(grid, lit.field().dims(), albedo, lit.light(), surface.shading).clipped(&medium.clip);
                Some((surface, self.device.buffer_from("view", &[shade])?, self.device.buffer::<f32>("hit distance", slots)?))
            }
            _ => None,
        };
        let leap = Leap {
            distances: &medium.occupancy.distances,
            bounds: if image.skip { medium.occupancy.bounds().unwrap_or_default() } else { [[0; 3], grid.dims()] },
            skip: image.skip,
        };
        Ok(Shot { medium, lit, view, step_length, backed, steps, segment, size: [width, height], most, form, state, pixels, surface, leap })
    }

    /// Renders strip by strip. `each` gets the pixels of a finished strip, last accessed as [`Access::ComputeWrite`], and may leave
    /// them in any other.
    pub(super) fn strips(&self, shot: &Shot, progress: &mut Progress, each: &mut dyn FnMut(Strip) -> Result<()>) -> Result<()> {
        let Shot {
            medium, lit, view, step_length, backed, steps, segment, size: [width, height], form, state, pixels, surface, leap, ..
        } = shot;
        let (steps, segment, width, height) = (*steps, *segment, *width, *height);
        let mut tell = |fraction: f64| match progress("render", fraction as f32) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Error::Cancelled),
        };
        let encoding = medium.volume.0.encoding;
        let settings = lit.field().settings();

        let row_samples = u64::from(width) * steps.min(u64::from(segment));
        // Rows that miss the volume take no time: those behind them must not come all at once.
        let most = (MOST_SAMPLES / row_samples).clamp(1, u64::from(shot.most));
        // Nothing is known yet of how long a row takes: fewer to begin with where rays are long. Cards take the most in
        // milliseconds, and wait between dispatches for longer.
        let few = u64::from(ROW_SAMPLES) / (steps * u64::from(width)).max(1);
        let first = if self.device.is_card() { most } else { few.clamp(1, 8) };
        let mut pacer = Pacer::new(first.min(most) as u32, most as u32);
        let mut row = 0;
        tell(0.0)?;
        while row < height {
            let rows = pacer.size.min(height - row);
            let start = Instant::now();
            let mut rec = self.device.record()?;
            // Fresh buffers, or the strip before has been taken from them: the first dispatch writes without reading.
            rec.barrier(&[state.all().from(state.last_access()).to(Access::ComputeReadWrite)]);
            if let Some((_, _, depth)) = surface {
                rec.barrier(&[depth.all().from(depth.last_access()).to(Access::ComputeWrite)]);
            }
            for first_step in (0..steps).step_by(segment as usize) {
                let part = Part {
                    width,
                    first_row: row,
                    rows,
                    first_step: first_step as u32,
                    step_count: segment,
                    step_length: *step_length,
                    backed: *backed,
                };
                match surface {
                    None => raymarch::record(&mut rec, &medium.view(), lit.irradiance(), view, part, *leap, state)?,
                    Some((surface, shade, depth)) => {
                        let inputs = isosurface::Surface {
                            volume: &medium.volume.0.image,
                            field: lit.field().packed(),
                            shade,
                            iso: encoding.sample_of(surface.iso as f32),
                            rising: encoding.scale > 0.0,
                            bands: settings.bands,
                            shading: surface.shading,
                            clips: medium.clip.len() as u32,
                            leap: *leap,
                        };
                        isosurface::record(&mut rec, &inputs, view, part, state, depth)?;
                        // The next part of the rays stores the hits that it finds.
                        rec.barrier(&[depth.all().from(Access::ComputeWrite).to(Access::ComputeWrite)]);
                    }
                }
                let done = first_step + u64::from(segment);
                if done < steps {
                    // The next part of the rays continues from this state.
                    rec.barrier(&[state.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                    rec.submit_part()?;
                    // A row may take many dispatches; each is a place to stop.
                    tell((f64::from(row) + f64::from(rows) * done as f64 / steps as f64) / f64::from(height))?;
                }
            }
            // The rays have ended.
            rec.barrier(&[state.all().from(Access::ComputeReadWrite).to(Access::ComputeRead)]);
            if row > 0 {
                // The strip before has been taken away.
                rec.barrier(&[pixels.all().from(pixels.last_access()).to(Access::ComputeWrite)]);
            }
            resolve::record(&mut rec, *form, state, pixels, rows * width)?;
            rec.submit()?;
            pacer.took(rows, start.elapsed().as_secs_f64());
            let depth = surface.as_ref().map(|(_, _, depth)| depth);
            each(Strip { first_row: row, rows, pixels, depth })?;
            row += rows;
            tell(f64::from(row) / f64::from(height))?;
        }
        Ok(())
    }
}

/// Length of a step, world, and most steps of a ray.
pub(super) fn steps(grid: &Grid, image: &ImageSettings) -> Result<(f64, u64)> {
    if !(image.step.is_finite() && image.step > 0.0) {
        return Err(Error::Invalid { item: "image.step", what: format!("is {} voxels", image.step), right: "it must be above 0".into() });
    }
    let length = image.step * grid.voxel_length();
    let steps = (grid.diagonal() / length).ceil() + 1.0;
    // Compared as they come: as integers the largest would wrap.
    if steps <= f64::from(1 << 24) {
        return Ok((length, steps as u64));
    }
    Err(Error::Invalid {
        item: "image.step",
        what: format!("{} voxels make {steps:.3e} steps of the longest ray", image.step),
        right: "take a step that makes at most 16777216".into(),
    })
}
