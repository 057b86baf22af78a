//! The engine: upload, classify, precompute, relight, render. Each call is one arrow of the straight line; long ones are
//! split into dispatches of bounded time, report progress and can be cancelled between dispatches.

use crate::error::{Error, Result};
use crate::scene::transfer::Table;
use crate::scene::visibility::Method;
use crate::scene::{Camera, Grid, ImageSettings, Light, Matter, Picture, Samples, Visibility, Volume};
use crate::stages::directions::{Direction, Directions};
use crate::stages::estimate::Run;
use crate::stages::raymarch::{Part, View};
use crate::stages::{Encoding, MediumView, classify, hierarchical, isosurface, march, minify, pack, raymarch, relight};
use crate::vk::{self, Access, Buffer, Format, Image, ImageDesc};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

pub use crate::vk::{DeviceInfo, Memory, Options, Span, devices};

/// Told the stage's name and the fraction 0..1 of the whole call that is done, before the first dispatch and after each;
/// `Break` cancels ([`Error::Cancelled`]) before the next.
pub type Progress<'a> = dyn FnMut(&'static str, f32) -> ControlFlow<()> + 'a;

/// Cells that are estimated together; bounds the memory of the sums to 4 MiB.
const TILE: usize = 1 << 16;

/// Pixels that are rendered together; bounds the memory of their state to 16 MiB.
const STRIP: usize = 1 << 20;

/// Seconds that a dispatch should take: short enough to cancel promptly and for a GPU's watchdog, long enough to hide a
/// submit.
const DISPATCH_SECONDS: f64 = 0.08;

/// Optical depth of one voxel length of an isosurface's inside.
const SURFACE_DEPTH: f64 = 64.0;

/// A Vulkan device with the kernels on it.
pub struct Engine {
    device: vk::Device,
}

/// A volume on the device. Clones share it.
#[derive(Clone)]
pub struct DeviceVolume(Arc<VolumeData>);

struct VolumeData {
    grid: Grid,
    range: [f32; 2],
    encoding: Encoding,
    image: Image,
}

/// A volume with its matter: what estimators and renderers see.
pub struct Medium {
    volume: DeviceVolume,
    matter: Matter,
    table: Table,
    sigma: Buffer,
    albedo: Buffer,
}

/// A visibility field on the device: 16 (or fewer) SH coefficients per cell, packed. Clones share it.
#[derive(Clone)]
pub struct Field(Arc<FieldData>);

struct FieldData {
    dims: [usize; 3],
    settings: Visibility,
    images: [Image; pack::GROUPS],
}

/// A field under a light: what a picture needs.
pub struct Lit {
    field: Field,
    light: Light,
    irradiance: Image,
}

impl DeviceVolume {
    /// Dims and place.
    pub fn grid(&self) -> &Grid {
        &self.0.grid
    }

    /// Smallest and largest value.
    pub fn range(&self) -> [f32; 2] {
        self.0.range
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        self.0.image.bytes()
    }
}

impl Medium {
    /// Dims and place.
    pub fn grid(&self) -> &Grid {
        self.volume.grid()
    }

    /// The tables that the kernels look up.
    pub fn table(&self) -> &Table {
        &self.table
    }

    fn view(&self) -> MediumView<'_> {
        MediumView {
            grid: self.grid(),
            volume: &self.volume.0.image,
            sigma: &self.sigma,
            albedo: &self.albedo,
            map: self.volume.0.encoding.table_map(self.table.lo, self.table.hi),
        }
    }
}

impl Field {
    /// Cells along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.0.dims
    }

    /// Bytes of the packed coefficients.
    pub fn bytes(&self) -> u64 {
        let s = &self.0.settings;
        let cell = pack::groups(s.bands) as u64 * u64::from(pack::formats(s.bands, s.bits).0.bytes());
        self.0.dims.iter().map(|&n| n as u64).product::<u64>() * cell
    }

    /// The settings that it was computed with.
    pub fn settings(&self) -> &Visibility {
        &self.0.settings
    }

    fn images(&self) -> [&Image; pack::GROUPS] {
        self.0.images.each_ref()
    }

    fn sampled_format(&self) -> Format {
        pack::formats(self.0.settings.bands, self.0.settings.bits).1
    }
}

/// Bytes of device memory that `precompute` allocates: (kept for the field, freed at the end).
pub fn precompute_memory(grid: &Grid, settings: &Visibility) -> (u64, u64) {
    let cells: u64 = grid.field_dims(settings.ratio as usize).iter().map(|&n| n as u64).product();
    let cell = pack::groups(settings.bands) as u64 * u64::from(pack::formats(settings.bands, settings.bits).0.bytes());
    let tile = cells.min(TILE as u64);
    let pyramid = match settings.method {
        Method::March => 0,
        Method::Hierarchical => {
            let dims = grid.dims().map(|n| n as u32);
            (0..minify::levels(dims)).map(|k| minify::level_dims(dims, k).iter().map(|&n| u64::from(n)).product::<u64>() * 2).sum()
        }
    };
    let patterns = match settings.sampling {
        crate::scene::visibility::Sampling::Stratified => 1,
        crate::scene::visibility::Sampling::Jittered => u64::from(crate::stages::directions::PATTERNS),
    };
    let table = patterns * u64::from(settings.directions) * size_of::<Direction>() as u64;
    (cells * cell, pyramid + tile * 68 + table)
}

/// How much one dispatch takes on, so that it lasts about [`DISPATCH_SECONDS`].
struct Pacer {
    size: u32,
    max: u32,
}

impl Pacer {
    fn new(first: u32, max: u32) -> Self {
        Self { size: first.clamp(1, max.max(1)), max: max.max(1) }
    }

    fn took(&mut self, done: u32, seconds: f64) {
        let ideal = f64::from(done) * DISPATCH_SECONDS / seconds.max(1e-6);
        // Never more than doubled: the next part may be slower.
        self.size = (ideal.min(2.0 * f64::from(self.size)) as u32).clamp(1, self.max);
    }
}

impl Engine {
    /// Opens a device.
    ///
    /// # Errors
    /// [`Error::NoDevice`], [`Error::DeviceLacks`].
    pub fn new(options: &Options) -> Result<Self> {
        let device = vk::Device::new(options)?;
        for format in [Format::R16Unorm, Format::R32Sfloat, Format::R16Sfloat, Format::Rgba16Sfloat] {
            if !device.supports_filtering(format) {
                return Err(Error::DeviceLacks {
                    device: device.info().name.clone(),
                    lacks: format!("linear filtering of {format:?} images"),
                });
            }
        }
        Ok(Self { device })
    }

    /// The device.
    pub fn device(&self) -> &DeviceInfo {
        self.device.info()
    }

    /// Memory in use, at most used, and allowed.
    pub fn memory(&self) -> Memory {
        self.device.memory()
    }

    /// Device time per kernel since the last call.
    pub fn take_timings(&self) -> Vec<Span> {
        self.device.take_timings()
    }

    /// What the validation layers complained of (with [`Options::validation`]).
    pub fn validation_errors(&self) -> Vec<String> {
        self.device.validation_errors()
    }

    /// Brings a volume to the device.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`], and what the device refuses.
    pub fn upload(&self, volume: &Volume) -> Result<DeviceVolume> {
        let grid = *volume.grid();
        let format = match volume.samples() {
            Samples::F32(_) => Format::R32Sfloat,
            _ => Format::R16Unorm,
        };
        let dims = grid.dims().map(|n| n as u32);
        let needs = grid.voxels() * u64::from(format.bytes());
        self.ask(&format!("the volume of {}x{}x{} voxels", dims[0], dims[1], dims[2]), needs, |free| {
            let side = ((free / u64::from(format.bytes())) as f64).cbrt() as u64;
            format!(
                "{} voxels ({side}x{side}x{side}) would fit; resample the volume or allow more memory",
                free / u64::from(format.bytes())
            )
        })?;
        let image = self.device.image3(&ImageDesc { name: "volume", dims, levels: 1, format, views: &[], storage: false })?;
        let row = dims[0] as usize * dims[1] as usize;
        self.device.write_image(&image, 0, &mut |first_z, bytes| encode(volume.samples(), first_z as usize * row, bytes))?;
        Ok(DeviceVolume(Arc::new(VolumeData { grid, range: volume.range(), encoding: Encoding::of(volume), image })))
    }

    /// Gives a volume its matter: transfer function, or opaque surface.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an iso value outside the data.
    pub fn classify(&self, volume: &DeviceVolume, matter: &Matter) -> Result<Medium> {
        let grid = volume.grid();
        let mut table = matter.transfer.table(volume.range(), grid);
        if let Some(surface) = matter.surface {
            let [lo, hi] = volume.range().map(f64::from);
            if !(surface.iso >= lo && surface.iso <= hi) {
                return Err(Error::Invalid {
                    item: "surface.iso",
                    what: format!("{} lies outside the data", surface.iso),
                    right: format!("the data's range is {lo} to {hi}"),
                });
            }
            let last = (table.sigma.len() - 1) as f64;
            for (i, sigma) in table.sigma.iter_mut().enumerate() {
                let value = lo + (hi - lo) * i as f64 / last;
                *sigma = if value >= surface.iso { (SURFACE_DEPTH / grid.voxel_length()) as f32 } else { 0.0 };
            }
        }
        let sigma = self.device.buffer_from("sigma", &table.sigma)?;
        let albedo = self.device.buffer_from("albedo", &table.albedo)?;
        Ok(Medium { volume: volume.clone(), matter: matter.clone(), table, sigma, albedo })
    }

    /// Computes the visibility field.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a setting out of its range, [`Error::OutOfMemory`] before anything is allocated,
    /// [`Error::Cancelled`].
    pub fn precompute(&self, medium: &Medium, settings: &Visibility, progress: &mut Progress) -> Result<Field> {
        settings.check()?;
        let (kept, scratch) = precompute_memory(medium.grid(), settings);
        self.ask(&format!("the visibility field at 1:{}", settings.ratio), kept + scratch, |free| {
            let fits = [2, 4, 8].into_iter().find(|&ratio| {
                let (a, b) = precompute_memory(medium.grid(), &Visibility { ratio, ..settings.clone() });
                ratio > settings.ratio && a + b <= free
            });
            match fits {
                Some(ratio) => format!("1:{ratio} would fit"),
                None => "no coarser ratio would fit; resample the volume or allow more memory".into(),
            }
        })?;
        let dims = medium.grid().field_dims(settings.ratio as usize);
        let cells = dims.iter().product::<usize>();
        let groups = pack::groups(settings.bands);
        let (store, sample) = pack::formats(settings.bands, settings.bits);
        let image = |g: usize| {
            self.device.image3(&ImageDesc {
                name: ["field 0", "field 1", "field 2", "field 3"][g],
                // A group that the bands leave empty is one texel, bound and never read.
                dims: if g < groups { dims.map(|n| n as u32) } else { [1; 3] },
                levels: 1,
                format: store,
                views: &[sample],
                storage: true,
            })
        };
        let images = [image(0)?, image(1)?, image(2)?, image(3)?];
        let field = Field(Arc::new(FieldData { dims, settings: settings.clone(), images }));

        let mut rec = self.device.record()?;
        // Fresh images take the layout for stores.
        rec.barrier(&field.images().map(|i| i.mip(0).from(Access::None).to(Access::ComputeWrite)));
        rec.submit()?;
        let all: Vec<u32> = (0..cells as u32).collect();
        let mut first = true;
        self.estimate_tiles(medium, settings, &all, progress, &mut |run| {
            let mut rec = self.device.record()?;
            if !first {
                // Tiles store disjoint cells; levels are tracked whole.
                rec.barrier(&field.images().map(|i| i.mip(0).from(Access::ComputeWrite).to(Access::ComputeWrite)));
            }
            first = false;
            pack::record(&mut rec, run, settings.bits, field.images())?;
            rec.submit()
        })?;
        let mut rec = self.device.record()?;
        // The finished field is only read from here on.
        rec.barrier(&field.images().map(|i| i.mip(0).from(Access::ComputeWrite).to(Access::ComputeRead)));
        rec.submit()?;
        Ok(field)
    }

    /// Coefficients of some cells of the field that `settings` describe (linear indices), before packing: what errors are
    /// measured with.
    ///
    /// # Errors
    /// As [`Engine::precompute`].
    pub fn estimate(&self, medium: &Medium, settings: &Visibility, cells: &[u32], progress: &mut Progress) -> Result<Vec<[f32; 16]>> {
        settings.check()?;
        let count: u64 = medium.grid().field_dims(settings.ratio as usize).iter().map(|&n| n as u64).product();
        if let Some(&cell) = cells.iter().find(|&&c| u64::from(c) >= count) {
            return Err(Error::Invalid {
                item: "field cell",
                what: format!("index {cell}"),
                right: format!("the field has {count} cells"),
            });
        }
        let mut out = Vec::with_capacity(cells.len());
        let weight = 4.0 * std::f32::consts::PI / settings.directions as f32;
        let kept = settings.coefficients();
        self.estimate_tiles(medium, settings, cells, progress, &mut |run| {
            let sums: Vec<f32> = self.device.read(run.sums, 16 * run.capacity as usize)?;
            for i in 0..run.cell_count as usize {
                out.push(std::array::from_fn(|c| if c < kept { weight * sums[c * run.capacity as usize + i] } else { 0.0 }));
            }
            Ok(())
        })?;
        Ok(out)
    }

    /// Runs the estimator over `cells` tile by tile and hands each tile's finished, readable sums to `finish`.
    fn estimate_tiles(
        &self,
        medium: &Medium,
        settings: &Visibility,
        cells: &[u32],
        progress: &mut Progress,
        finish: &mut dyn FnMut(&Run) -> Result<()>,
    ) -> Result<()> {
        let grid = medium.grid();
        let stage = match settings.method {
            Method::March => "march",
            Method::Hierarchical => "hierarchical",
        };
        let mut tell = |fraction: f64| match progress(stage, fraction as f32) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Error::Cancelled),
        };
        tell(0.0)?;
        if cells.is_empty() {
            return Ok(());
        }
        let step_length = f64::from(settings.step) * grid.voxel_length();
        let steps = match settings.method {
            Method::March => march::max_steps(grid.diagonal(), step_length),
            Method::Hierarchical => hierarchical::max_steps(grid.diagonal() / grid.voxel_length(), f64::from(settings.growth)),
        };
        let most = u64::from(self.device.loop_limit()) / (steps + 2);
        if most == 0 {
            return Err(Error::Invalid {
                item: "visibility.step",
                what: format!("{} voxels make {steps} steps of the longest ray", settings.step),
                right: format!("this device runs at most {} in one dispatch; take a longer step", self.device.loop_limit()),
            });
        }
        let pyramid = match settings.method {
            Method::March => None,
            Method::Hierarchical => Some(self.pyramid(medium, settings)?),
        };
        let set = Directions::new(settings.directions, settings.sampling, grid);
        let directions = self.device.buffer_from("directions", &set.table)?;
        let capacity = cells.len().min(TILE);
        let cell_buffer = self.device.buffer::<u32>("cells", capacity)?;
        let sums = self.device.buffer::<f32>("sums", 16 * capacity)?;
        let mut rec = self.device.record()?;
        // Fresh sums: the first dispatch writes without reading, the later ones add.
        rec.barrier(&[sums.all().from(Access::None).to(Access::ComputeReadWrite)]);
        rec.submit()?;
        let n = settings.directions;
        let mut pacer = Pacer::new(2, most.min(u64::from(n)) as u32);
        let tiles = cells.len().div_ceil(capacity);
        for (index, tile) in cells.chunks(capacity).enumerate() {
            self.device.write(&cell_buffer, tile)?;
            let mut run = Run {
                grid,
                field_dims: grid.field_dims(settings.ratio as usize),
                cells: &cell_buffer,
                cell_count: tile.len() as u32,
                capacity: capacity as u32,
                directions: &directions,
                sums: &sums,
                pattern_size: n,
                patterns: set.patterns,
                bands: settings.bands,
                first_direction: 0,
                direction_count: 0,
            };
            while run.first_direction < n {
                run.direction_count = pacer.size.min(n - run.first_direction);
                let start = Instant::now();
                let mut rec = self.device.record()?;
                match &pyramid {
                    None => march::record(&mut rec, &medium.view(), &run, step_length)?,
                    Some(pyramid) => hierarchical::record(&mut rec, pyramid, &run, settings.growth)?,
                }
                // The next run of directions adds to the same sums.
                rec.barrier(&[sums.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                rec.submit()?;
                pacer.took(run.direction_count, start.elapsed().as_secs_f64());
                run.first_direction += run.direction_count;
                tell((index as f64 + f64::from(run.first_direction) / f64::from(n)) / tiles as f64)?;
            }
            let mut rec = self.device.record()?;
            // Whoever finishes the tile reads the sums.
            rec.barrier(&[sums.all().from(Access::ComputeReadWrite).to(Access::ComputeRead)]);
            rec.submit()?;
            finish(&run)?;
            let mut rec = self.device.record()?;
            // The next tile writes over them.
            rec.barrier(&[sums.all().from(Access::ComputeRead).to(Access::ComputeReadWrite)]);
            rec.submit()?;
        }
        Ok(())
    }

    /// The opacity pyramid of a medium, readable.
    fn pyramid(&self, medium: &Medium, settings: &Visibility) -> Result<Image> {
        let dims = medium.grid().dims().map(|n| n as u32);
        let levels = minify::levels(dims);
        let pyramid =
            self.device.image3(&ImageDesc { name: "opacity", dims, levels, format: Format::R16Sfloat, views: &[], storage: true })?;
        let mut rec = self.device.record()?;
        classify::record(&mut rec, &medium.view(), &pyramid)?;
        minify::record(&mut rec, &pyramid, settings.filter)?;
        rec.submit()?;
        Ok(pyramid)
    }

    /// The levels of the opacity pyramid, finest first, x fastest: for tests and charts.
    ///
    /// # Errors
    /// As [`Engine::precompute`].
    pub fn read_pyramid(&self, medium: &Medium, settings: &Visibility) -> Result<Vec<Vec<f32>>> {
        let pyramid = self.pyramid(medium, settings)?;
        (0..pyramid.levels())
            .map(|k| {
                let bytes = self.device.read_image(&pyramid, k)?;
                Ok(bytes.chunks_exact(2).map(|b| half::f16::from_le_bytes([b[0], b[1]]).to_f32()).collect())
            })
            .collect()
    }

    /// The field's coefficients as the renderers see them (after packing): bands² per cell, coefficient fastest, then x,
    /// y, z.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn read_field(&self, field: &Field) -> Result<Vec<f32>> {
        let s = field.settings();
        let kept = s.coefficients();
        let cells: usize = field.dims().iter().product();
        let mut out = vec![0f32; kept * cells];
        for g in 0..pack::groups(s.bands) {
            let bytes = self.device.read_image(field.images()[g], 0)?;
            for (cell, codes) in pack::unpack_image(&bytes, s.bands, s.bits).iter().enumerate() {
                let mut all = [0u32; 16];
                all[4 * g..4 * g + 4].copy_from_slice(codes);
                let v = pack::decode(&all, s.bits);
                for i in 4 * g..(4 * g + 4).min(kept) {
                    out[cell * kept + i] = v[i];
                }
            }
        }
        Ok(out)
    }

    /// Puts a field under a light; no visibility is computed.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`], and what the device refuses.
    pub fn relight(&self, field: &Field, light: &Light) -> Result<Lit> {
        let dims = field.dims().map(|n| n as u32);
        let desc = ImageDesc { name: "irradiance", dims, levels: 1, format: Format::Rgba16Sfloat, views: &[], storage: true };
        let irradiance = self.device.image3(&desc)?;
        let coefficients: Vec<[f32; 4]> = light.to_f32().iter().map(|l| [l[0], l[1], l[2], 0.0]).collect();
        let light_buffer = self.device.buffer_from("light", &coefficients)?;
        let mut rec = self.device.record()?;
        // A fresh image takes the layout for stores.
        rec.barrier(&[irradiance.mip(0).from(Access::None).to(Access::ComputeWrite)]);
        let s = field.settings();
        relight::record(&mut rec, field.images(), field.sampled_format(), &light_buffer, &irradiance, s.bands, s.bits)?;
        // The renderers only read it.
        rec.barrier(&[irradiance.mip(0).from(Access::ComputeWrite).to(Access::ComputeRead)]);
        rec.submit()?;
        Ok(Lit { field: field.clone(), light: *light, irradiance })
    }

    /// (S/ϖ per channel, mean visibility) of every cell, x fastest: for tests and charts.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn read_irradiance(&self, lit: &Lit) -> Result<Vec<[f32; 4]>> {
        let bytes = self.device.read_image(&lit.irradiance, 0)?;
        let value = |b: &[u8]| half::f16::from_le_bytes([b[0], b[1]]).to_f32();
        Ok(bytes.chunks_exact(8).map(|t| std::array::from_fn(|c| value(&t[2 * c..2 * c + 2]))).collect())
    }

    /// Renders a picture: direct volume rendering, or the isosurface if the matter has one. The background is left
    /// transparent.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an unusable camera or picture, [`Error::Cancelled`].
    pub fn render(&self, medium: &Medium, lit: &Lit, camera: &Camera, image: &ImageSettings, progress: &mut Progress) -> Result<Picture> {
        self.render_parts(medium, lit, camera, image, progress).map(|(picture, _)| picture)
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
        self.render_parts(medium, lit, camera, image, progress)
    }

    fn render_parts(
        &self,
        medium: &Medium,
        lit: &Lit,
        camera: &Camera,
        image: &ImageSettings,
        progress: &mut Progress,
    ) -> Result<(Picture, Vec<f32>)> {
        let grid = medium.grid();
        let rays = camera.rays(grid, image.width, image.height)?;
        let view = View::new(grid, &rays);
        let mut tell = |fraction: f64| match progress("render", fraction as f32) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Error::Cancelled),
        };
        if !(image.step.is_finite() && image.step > 0.0) {
            return Err(Error::Invalid {
                item: "image.step",
                what: format!("is {} voxels", image.step),
                right: "it must be above 0".into(),
            });
        }
        if image.width > STRIP {
            return Err(Error::Invalid {
                item: "image.width",
                what: format!("{} pixels", image.width),
                right: format!("at most {STRIP} can be rendered in a row"),
            });
        }
        let step_length = image.step * grid.voxel_length();
        let steps = (grid.diagonal() / step_length).ceil() as u64 + 1;
        if steps > 1 << 24 {
            return Err(Error::Invalid {
                item: "image.step",
                what: format!("{} voxels make {steps} steps of the longest ray", image.step),
                right: "take a step that makes at most 16777216".into(),
            });
        }
        // Loops besides the march: bisection, cells, harmonics.
        let segment = self.device.loop_limit().saturating_sub(4096).max(1);
        let (width, height) = (image.width as u32, image.height as u32);
        let most = ((STRIP / image.width) as u32).min(height).max(1);
        let slots = (most * width) as usize;
        let state = self.device.buffer::<[f32; 4]>("state", slots)?;
        let surface = match (medium.matter.surface, medium.matter.surface_albedo()) {
            (Some(surface), Some(albedo)) => {
                let shade = isosurface::Shade::new(grid, lit.field.dims(), albedo, &lit.light, surface.shading);
                Some((surface, self.device.buffer_from("view", &[shade])?, self.device.buffer::<f32>("hit distance", slots)?))
            }
            _ => None,
        };
        let encoding = medium.volume.0.encoding;
        let settings = lit.field.settings();
        let mut rec = self.device.record()?;
        // Fresh buffers: the first dispatch of a strip writes without reading.
        rec.barrier(&[state.all().from(Access::None).to(Access::ComputeReadWrite)]);
        if let Some((_, _, depth)) = &surface {
            rec.barrier(&[depth.all().from(Access::None).to(Access::ComputeWrite)]);
        }
        rec.submit()?;

        let mut picture = Picture::new(image.width, image.height);
        let mut distances = Vec::new();
        let mut pacer = Pacer::new(8, most);
        let mut row = 0;
        tell(0.0)?;
        while row < height {
            let rows = pacer.size.min(height - row);
            let start = Instant::now();
            for first_step in (0..steps).step_by(segment as usize) {
                let part = Part { width, first_row: row, rows, first_step: first_step as u32, step_count: segment };
                let mut rec = self.device.record()?;
                match &surface {
                    None => raymarch::record(&mut rec, &medium.view(), &lit.irradiance, &view, part, step_length, &state)?,
                    Some((surface, shade, depth)) => {
                        let inputs = isosurface::Surface {
                            volume: &medium.volume.0.image,
                            field: lit.field.images(),
                            field_view: lit.field.sampled_format(),
                            shade,
                            iso: encoding.sample_of(surface.iso as f32),
                            rising: encoding.scale > 0.0,
                            bands: settings.bands,
                            bits: settings.bits,
                            shading: surface.shading,
                        };
                        isosurface::record(&mut rec, &inputs, &view, part, step_length, &state, depth)?;
                        // The next part of the rays stores the hits that it finds.
                        rec.barrier(&[depth.all().from(Access::ComputeWrite).to(Access::ComputeWrite)]);
                    }
                }
                // The next part of the rays continues from this state.
                rec.barrier(&[state.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                rec.submit()?;
            }
            pacer.took(rows, start.elapsed().as_secs_f64());
            let count = (rows * width) as usize;
            let pixels: Vec<[f32; 4]> = self.device.read(&state, count)?;
            let first = (row * width) as usize;
            for (out, p) in picture.rgba[first..first + count].iter_mut().zip(&pixels) {
                *out = [p[0], p[1], p[2], if surface.is_some() { p[3] } else { 1.0 - p[3] }];
            }
            let mut rec = self.device.record()?;
            // The next strip writes over what the host has read.
            rec.barrier(&[state.all().from(Access::ComputeRead).to(Access::ComputeReadWrite)]);
            if let Some((_, _, depth)) = &surface {
                distances.extend(self.device.read::<f32>(depth, count)?);
                rec.barrier(&[depth.all().from(Access::ComputeRead).to(Access::ComputeWrite)]);
            }
            rec.submit()?;
            row += rows;
            tell(f64::from(row) / f64::from(height))?;
        }
        Ok((picture, distances))
    }

    /// Refuses what the memory budget cannot hold, before anything is allocated.
    fn ask(&self, what: &str, needs: u64, right: impl FnOnce(u64) -> String) -> Result<()> {
        let memory = self.device.memory();
        let free = memory.budget.saturating_sub(memory.used);
        if needs <= free {
            return Ok(());
        }
        Err(Error::OutOfMemory { what: what.into(), needs, free, budget: memory.budget, right: right(free) })
    }
}

/// Samples from index `first` on as the volume's image stores them.
fn encode(samples: &Samples, first: usize, bytes: &mut [u8]) {
    fn put<const N: usize>(bytes: &mut [u8], values: impl Iterator<Item = [u8; N]>) {
        for (out, value) in bytes.chunks_exact_mut(N).zip(values) {
            out.copy_from_slice(&value);
        }
    }
    match samples {
        // v·257/65535 = v/255 exactly.
        Samples::U8(s) => put(bytes, s[first..].iter().map(|&v| (u16::from(v) * 257).to_ne_bytes())),
        Samples::U16(s) => put(bytes, s[first..].iter().map(|&v| v.to_ne_bytes())),
        Samples::I16(s) => put(bytes, s[first..].iter().map(|&v| (v as u16 ^ 0x8000).to_ne_bytes())),
        Samples::F32(s) => put(bytes, s[first..].iter().map(|&v| v.to_ne_bytes())),
    }
}
