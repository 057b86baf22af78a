//! The reference picture: unbiased Monte Carlo single scattering, in passes, until its own standard error is small enough.

use super::budget::SLACK;
use super::{Engine, Medium, Pacer, Progress, in_parts};
use crate::error::{Error, Result};
use crate::room::zeroed;
use crate::scene::sky::Sky;
use crate::scene::{Camera, ImageSettings, Picture};
use crate::stages::majorant;
use crate::stages::raymarch::View;
use crate::stages::trace::{self, BLOCK, Inputs, Opaque, Part, STATE, Setting};
use crate::vk::{Access, Buffer, Format, Image, ImageDesc};
use std::ops::ControlFlow;
use std::time::Instant;

/// Bytes of a pixel's state.
const PIXEL: u64 = 16 * STATE as u64;

/// Pixels whose state one buffer holds: 48 MiB, below what any device binds.
const BAND: usize = 1 << 20;

/// Samples of a pass's first dispatch, at most (but one row): tens of milliseconds on a CPU device.
const FIRST_SAMPLES: u32 = 1 << 15;

/// Invocations that a device with bounded loops runs in lockstep.
const LANES: f64 = 8.0;

/// When a reference picture is good enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceSettings {
    /// Most samples of a pixel; taken in blocks of 16, at least two, so rounded up to those.
    pub samples: u32,
    /// Relative standard error ([`Reference::relative_error`]) at which to stop; 0 takes all samples.
    pub error: f64,
    /// Samples of the first pass, in whole blocks, two at least; each further pass doubles them.
    pub first: u32,
    /// Seconds after which no further pass begins.
    pub seconds: Option<f64>,
    /// Another seed is another, independent picture.
    pub seed: u32,
}

impl Default for ReferenceSettings {
    fn default() -> Self {
        Self { samples: 65_536, error: 0.01, first: 2 * BLOCK, seconds: None, seed: 0 }
    }
}

/// A reference picture and how sure it is.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The mean of all samples.
    pub picture: Picture,
    /// Standard error of each pixel's R, G, B: of the mean of block means.
    pub standard_error: Vec<[f32; 3]>,
    /// √mean(standard error²)/mean over R, G, B of the pixels that the volume covers (coverage above 0); 0 where none is, and
    /// where neither light nor albedo leaves anything to be seen; infinite while no sample was lit, though some may be.
    pub relative_error: f64,
    /// Samples of each pixel.
    pub samples: u32,
    /// Whether `progress` asked to stop before samples, error or seconds said so.
    pub cancelled: bool,
}

impl Engine {
    /// Renders the medium, or its isosurface, under the exact light: what [`Engine::render`] tends to with finer fields,
    /// more bands and shorter steps. Rays pass through the pixels' centres, as there. A medium's picture has no bias; a
    /// surface is found by steps of `image.step`, and its shadow rays step [`trace::SHADOW_STEP`] voxels.
    ///
    /// Passes double the samples. `progress` may stop it: the passes finished before are returned.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an unusable camera, picture or setting, [`Error::OutOfMemory`], [`Error::Cancelled`] before
    /// the first pass was finished.
    pub fn render_reference(
        &self,
        medium: &Medium,
        sky: &Sky,
        camera: &Camera,
        image: &ImageSettings,
        settings: &ReferenceSettings,
        progress: &mut Progress,
    ) -> Result<Reference> {
        self.refine_reference(medium, sky, (camera, image), settings, progress, &mut |_| ())
    }

    /// The same; `finished` is given the picture after each pass, the last among them.
    ///
    /// # Errors
    /// As [`Engine::render_reference`].
    pub fn refine_reference(
        &self,
        medium: &Medium,
        sky: &Sky,
        (camera, image): (&Camera, &ImageSettings),
        settings: &ReferenceSettings,
        progress: &mut Progress,
        finished: &mut dyn FnMut(&Reference),
    ) -> Result<Reference> {
        let begun = Instant::now();
        check(settings)?;
        let most = settings.samples.max(1).div_ceil(BLOCK).max(2).saturating_mul(BLOCK);
        let mut job = Job { progress, told: 0.0, rows: image.height as f64 };
        job.tell(0.0)?;
        let tracer = self.tracer(medium, sky, (camera, image), settings.seed, &mut |_| job.tell(0.0))?;
        let mut last: Option<Reference> = None;
        let (mut done, mut goal) = (0, most.min(settings.first.div_ceil(BLOCK).max(2).saturating_mul(BLOCK)));
        // What is likely to be needed in all: the scale of the progress.
        let mut expected = most;
        loop {
            match tracer.pass(self, done, goal, expected, &mut job) {
                // What was finished before is kept.
                Err(Error::Cancelled) => {
                    return last.map(|reference| Reference { cancelled: true, ..reference }).ok_or(Error::Cancelled);
                }
                other => other?,
            }
            done = goal;
            let reference = tracer.finish(self, done, image)?;
            finished(&reference);
            let enough = settings.error > 0.0 && reference.relative_error <= settings.error;
            let seconds = begun.elapsed().as_secs_f64();
            let left = settings.seconds.map_or(f64::INFINITY, |s| s - seconds);
            // Error falls with the square root of the samples; one in twenty more, for the error is itself an estimate.
            let needed = match settings.error > 0.0 {
                true => 1.05 * f64::from(done) * (reference.relative_error / settings.error).powi(2),
                false => f64::from(most),
            };
            let affordable = f64::from(done) * (1.0 + left / seconds.max(1e-6));
            let blocks = |samples: f64| (samples / f64::from(BLOCK)).min(f64::from(u32::MAX / BLOCK)) as u32;
            expected = most.min(blocks(needed).saturating_add(1).saturating_mul(BLOCK)).max(done);
            let next = expected.min(2 * done).min(blocks(affordable) * BLOCK);
            if enough || done >= most || next <= done {
                let _ = (job.progress)("reference", 1.0);
                return Ok(reference);
            }
            last = Some(reference);
            goal = next;
        }
    }

    /// Bytes of device memory that a reference picture takes.
    pub(super) fn reference_bytes(&self, medium: &Medium, sky: &Sky, image: &ImageSettings) -> u64 {
        let tables = sky.tables();
        let sky_bytes = (4 * tables.cumulative.len() + 16 * tables.weights.len()) as u64;
        let majorants = self.padding().image(majorant::cells(medium.grid().dims()), 4);
        PIXEL * (image.width * image.height) as u64 + sky_bytes + majorants + SLACK
    }

    /// Uploads what stays the same for all passes.
    fn tracer<'a>(
        &self,
        medium: &'a Medium,
        sky: &Sky,
        (camera, image): (&Camera, &ImageSettings),
        seed: u32,
        tell: &mut dyn FnMut(f64) -> Result<()>,
    ) -> Result<Tracer<'a>> {
        let grid = medium.grid();
        let view = View::new(grid, &camera.rays(grid, image.width, image.height)?);
        let step_length = image.step * grid.voxel_length();
        let surface = match (medium.matter.surface, medium.matter.surface_albedo()) {
            (Some(surface), Some(albedo)) => {
                let encoding = medium.volume.0.encoding;
                let (iso, rising) = (encoding.sample_of(surface.iso as f32), encoding.scale > 0.0);
                Some(Opaque { iso, rising, albedo, shading: surface.shading })
            }
            _ => None,
        };
        // Loops that the kernel does not count: a surface's search, and a search of the sky's tables for each sample.
        let search = if surface.is_some() { (grid.diagonal() / step_length).ceil() + 64.0 } else { 64.0 };
        // A device that runs LANES rays side by side counts an iteration of any of them for all.
        let events = (f64::from(self.device.loop_limit()) - search) / LANES;
        if !(image.step.is_finite() && image.step > 0.0 && events >= 1024.0) {
            return Err(Error::Invalid {
                item: "image.step",
                what: format!("is {} voxels", image.step),
                right: "it must be above 0, and so long that a ray makes some ten thousand steps at most".into(),
            });
        }
        if image.width > BAND {
            return Err(Error::Invalid {
                item: "image.width",
                what: format!("{} pixels", image.width),
                right: format!("at most {BAND} can be rendered in a row"),
            });
        }
        // As many samples of a pixel at once as an invocation's loops surely allow: tentative collisions along both rays.
        let dense = match surface {
            None => f64::from(medium.table.sigma.iter().fold(0.0, |m, &s| f32::max(m, s))) * grid.diagonal(),
            Some(_) => grid.diagonal() / (trace::SHADOW_STEP * grid.voxel_length()),
        };
        let crossed: f64 = majorant::cells(grid.dims()).iter().map(|&c| f64::from(c)).sum();
        let chunk = ((events - 2.0 * crossed) / (96.0 + 2.0 * crossed + 2.5 * dense)).clamp(1.0, 64.0) as u32;

        let tables = sky.tables();
        let cells = majorant::cells(grid.dims());
        let needs = self.reference_bytes(medium, sky, image);
        self.ask("the reference picture", needs, |_| "render fewer pixels, take a smaller probe, or allow more memory".into())?;
        let desc = ImageDesc { name: "majorants", dims: cells, levels: 1, format: Format::R32Sfloat, views: &[], storage: true };
        let majorants = self.device.image3(&desc)?;
        let band_rows = (BAND / image.width).clamp(1, image.height);
        let bands = (0..image.height).step_by(band_rows).map(|row| {
            let rows = band_rows.min(image.height - row);
            Ok(Band { row: row as u32, rows: rows as u32, state: self.device.buffer::<[f32; 4]>("state", STATE * image.width * rows)? })
        });
        let bands: Vec<Band> = bands.collect::<Result<_>>()?;
        let mut rec = self.device.record()?;
        // A fresh image takes the layout for stores; fresh sums are written before they are read.
        rec.barrier(&[majorants.mip(0).from(Access::None).to(Access::ComputeWrite)]);
        majorant::record(&mut rec, &medium.view(), &majorants, &mut in_parts(tell))?;
        // From here on it is only read.
        rec.barrier(&[majorants.mip(0).from(Access::ComputeWrite).to(Access::ComputeRead)]);
        for band in &bands {
            rec.barrier(&[band.state.all().from(Access::None).to(Access::ComputeReadWrite)]);
        }
        rec.submit()?;
        Ok(Tracer {
            medium,
            cumulative: self.device.buffer_from("cumulative", &tables.cumulative)?,
            weights: self.device.buffer_from("sky", &tables.weights)?,
            setting: self.device.buffer_from("setting", &[Setting::new(grid, sky, surface.as_ref())])?,
            surface,
            view,
            majorants,
            bands,
            chunk,
            most_events: events as u32 - 8 * chunk,
            width: image.width as u32,
            step_length,
            seed,
            lit: sky.scale() > 0.0 && tables.probe.mean() != [0.0; 3] && medium.table.albedo.iter().any(|a| a[..3] != [0.0; 3]),
        })
    }

    /// Majorants of a medium's cells ([`majorant::CELL`] voxels a side), x fastest: for tests and charts.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn read_majorants(&self, medium: &Medium) -> Result<Vec<f32>> {
        let cells = majorant::cells(medium.grid().dims());
        let desc = ImageDesc { name: "majorants", dims: cells, levels: 1, format: Format::R32Sfloat, views: &[], storage: true };
        let majorants = self.device.image3(&desc)?;
        let mut rec = self.device.record()?;
        // A fresh image takes the layout for stores.
        rec.barrier(&[majorants.mip(0).from(Access::None).to(Access::ComputeWrite)]);
        majorant::record(&mut rec, &medium.view(), &majorants, &mut |_, _| Ok(()))?;
        rec.submit()?;
        let bytes = self.device.read_image(&majorants, 0)?;
        Ok(bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }
}

/// Progress that never falls.
struct Job<'a, 'b> {
    progress: &'a mut Progress<'b>,
    told: f64,
    rows: f64,
}

impl Job<'_, '_> {
    fn tell(&mut self, fraction: f64) -> Result<()> {
        self.told = self.told.max(fraction.min(1.0));
        match (self.progress)("reference", self.told as f32) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Error::Cancelled),
        }
    }
}

/// Rows whose state lies in one buffer.
struct Band {
    row: u32,
    rows: u32,
    state: Buffer,
}

struct Tracer<'a> {
    medium: &'a Medium,
    cumulative: Buffer,
    weights: Buffer,
    setting: Buffer,
    surface: Option<Opaque>,
    view: View,
    majorants: Image,
    bands: Vec<Band>,
    /// Samples of a pixel in a dispatch, at most.
    chunk: u32,
    most_events: u32,
    width: u32,
    step_length: f64,
    seed: u32,
    /// Whether there is light, and matter that scatters it.
    lit: bool,
}

impl Tracer<'_> {
    /// Takes every pixel from `done` samples to `goal`.
    fn pass(&self, engine: &Engine, done: u32, goal: u32, expected: u32, job: &mut Job) -> Result<()> {
        let inputs = Inputs {
            majorants: &self.majorants,
            cumulative: &self.cumulative,
            weights: &self.weights,
            setting: &self.setting,
            surface: self.surface.map(|s| s.shading),
        };
        for band in &self.bands {
            // Nothing is known yet of how long a row takes: fewer to begin with where there are many samples.
            let samples = self.width.saturating_mul(self.chunk.min(goal - done)).max(1);
            let mut pacer = Pacer::new((FIRST_SAMPLES / samples).clamp(1, 8), band.rows);
            let mut row = 0;
            while row < band.rows {
                let rows = pacer.size.min(band.rows - row);
                let mut first_sample = done;
                while first_sample < goal {
                    let part = Part {
                        width: self.width,
                        band_row: band.row,
                        first_row: band.row + row,
                        rows,
                        first_sample,
                        sample_count: self.chunk.min(goal - first_sample),
                        most_events: self.most_events,
                        seed: self.seed,
                    };
                    let start = Instant::now();
                    let mut rec = engine.device.record()?;
                    trace::record(&mut rec, &self.medium.view(), &inputs, &self.view, part, self.step_length, &band.state)?;
                    // The next samples, or the next rows, add to the same state.
                    rec.barrier(&[band.state.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                    rec.submit()?;
                    pacer.took(rows, start.elapsed().as_secs_f64());
                    first_sample += part.sample_count;
                    let rows_done = f64::from(band.row + row) * f64::from(goal - done) + f64::from(rows) * f64::from(first_sample - done);
                    job.tell((f64::from(done) + rows_done / job.rows) / f64::from(expected.max(goal)))?;
                }
                row += rows;
            }
        }
        Ok(())
    }

    /// Reads the sums after `samples` of every pixel.
    fn finish(&self, engine: &Engine, samples: u32, image: &ImageSettings) -> Result<Reference> {
        let mut picture = Picture::asked(image.width, image.height)?;
        let mut standard_error: Vec<[f32; 3]> = zeroed("a picture's standard error", picture.rgba.len())?;
        let blocks = f64::from(samples / BLOCK);
        let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
        for band in &self.bands {
            let first = band.row as usize * image.width;
            let pixels = band.rows as usize * image.width;
            let state: Vec<[f32; 4]> = engine.device.read(&band.state, STATE * pixels)?;
            let mut rec = engine.device.record()?;
            // The next pass adds to what the host has read.
            rec.barrier(&[band.state.all().from(Access::ComputeRead).to(Access::ComputeReadWrite)]);
            rec.submit()?;
            for (i, state) in state.chunks_exact(STATE).enumerate() {
                let (mean, deviation) = (state[1], state[2]);
                if deviation[3] > 0.0 {
                    return Err(Error::Invalid {
                        item: "transfer function",
                        what: "matter is so dense that a ray needs more steps than this device makes in one dispatch".into(),
                        right: "lower its extinction (opaque is 16 per voxel, more shows no difference)".into(),
                    });
                }
                picture.rgba[first + i] = mean;
                let error = [0, 1, 2].map(|c| (f64::from(deviation[c]) / (blocks * (blocks - 1.0))).max(0.0).sqrt());
                standard_error[first + i] = error.map(|e| e as f32);
                if mean[3] > 0.0 {
                    sum += (0..3).map(|c| f64::from(mean[c])).sum::<f64>();
                    squares += error.iter().map(|e| e * e).sum::<f64>();
                    count += 3.0;
                }
            }
        }
        let relative_error = match sum > 0.0 {
            true => (squares / count).sqrt() / (sum / count),
            // Dim is not dark: that no light was found yet says nothing of how little there is.
            false if count > 0.0 && self.lit => f64::INFINITY,
            false => 0.0,
        };
        Ok(Reference { picture, standard_error, relative_error, samples, cancelled: false })
    }
}

fn check(settings: &ReferenceSettings) -> Result<()> {
    let bad = |item, what: String, right: &str| Err(Error::Invalid { item, what, right: right.into() });
    if !(settings.error.is_finite() && settings.error >= 0.0) {
        return bad("reference error", format!("is {}", settings.error), "it must be 0 or above, such as 0.01");
    }
    if settings.samples == 0 || settings.samples > 1 << 24 {
        return bad("reference samples", format!("is {}", settings.samples), "it must lie in 1..16777216");
    }
    if settings.seconds.is_some_and(|s| s.is_nan() || s <= 0.0) {
        return bad("reference seconds", format!("is {:?}", settings.seconds), "it must be above 0");
    }
    Ok(())
}
