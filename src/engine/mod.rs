//! The engine: upload, classify, precompute, relight, render. Each call is one arrow of the straight line; long ones are
//! split into dispatches of bounded time, report progress and can be cancelled between dispatches.

mod aov;
mod budget;
mod buried;
mod cost;
mod estimate;
mod field;
mod fit;
pub mod host;
mod occupancy;
mod precompute;
mod reference;
mod relight;
mod render;
mod sweep;

use crate::error::{Error, Result};
use crate::room::reserved;
use crate::scene::transfer::Table;
use crate::scene::{Clip, Grid, Matter, Samples, Surface, Volume};
use crate::stages::widen::SampleType;
use crate::stages::{self, Encoding, MediumView};
use crate::vk::{self, Buffer, Format, Image, ImageDesc, Recorder};
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

pub use aov::{Behind, LAYERS, layer_channels, surface_layers};
pub use budget::{Need, precompute_memory};
pub use cost::Cost;
pub use field::Field;
pub use fit::Points as FitPoints;
pub use occupancy::Occupancy;
pub use precompute::Pass;
pub use reference::{Reference, ReferenceSettings};
pub use relight::Lit;

#[cfg(feature = "capi")]
pub(crate) use crate::vk::HEARD;
pub use crate::vk::{DeviceInfo, DeviceKind, Memory, Options, Span, devices};

/// Told the stage's name and the fraction 0..1 of the whole call that is done, before the first dispatch and after each;
/// `Break` cancels ([`Error::Cancelled`]) before the next.
pub type Progress<'a> = dyn FnMut(&'static str, f32) -> ControlFlow<()> + 'a;

/// Seconds that a dispatch should take: short enough to cancel promptly and for a GPU's watchdog, long enough to hide a
/// submit.
const DISPATCH_SECONDS: f64 = 0.08;

/// Optical depth of one voxel length of an isosurface's inside.
const SURFACE_DEPTH: f64 = 64.0;

/// A Vulkan device with the kernels on it.
pub struct Engine {
    device: vk::Device,
    account: Mutex<Account>,
}

/// Device time that was seen.
#[derive(Default)]
struct Account {
    /// Since it was last taken.
    kept: Vec<Span>,
    total: Vec<Span>,
}

/// A volume on the device. Clones share it.
#[derive(Clone)]
pub struct DeviceVolume(Arc<VolumeData>);

struct VolumeData {
    grid: Grid,
    range: [f32; 2],
    samples: SampleType,
    /// What the image stores them as.
    stored: SampleType,
    /// Value = slope·sample + intercept.
    rescale: (f32, f32),
    encoding: Encoding,
    image: Image,
    /// Smallest and largest sample of each block; see `stages::occupancy`.
    ranges: Image,
}

/// A volume with its matter: what estimators and renderers see.
pub struct Medium {
    volume: DeviceVolume,
    matter: Matter,
    table: Table,
    sigma: Buffer,
    albedo: Buffer,
    occupancy: Occupancy,
    flat_albedo: Option<[f32; 3]>,
    /// Kept half spaces, voxel space.
    clip: Vec<[f32; 4]>,
    /// Cells inside the surface, by the field's dims.
    buried: buried::Known,
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

    /// What its samples are.
    pub fn samples(&self) -> SampleType {
        self.0.samples
    }

    /// Slope and intercept.
    pub fn rescale(&self) -> (f32, f32) {
        self.0.rescale
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        self.0.image.bytes() + self.0.ranges.bytes()
    }
}

impl Medium {
    /// Dims and place.
    pub fn grid(&self) -> &Grid {
        self.volume.grid()
    }

    /// Its volume.
    pub fn volume(&self) -> &DeviceVolume {
        &self.volume
    }

    /// What fills it.
    pub fn matter(&self) -> &Matter {
        &self.matter
    }

    /// Half spaces that clipping keeps, voxel coordinates.
    pub fn clip(&self) -> &[[f32; 4]] {
        &self.clip
    }

    /// The tables that the kernels look up.
    pub fn table(&self) -> &Table {
        &self.table
    }

    /// Whether it is an opaque surface.
    pub fn has_surface(&self) -> bool {
        self.matter.surface.is_some()
    }

    /// Linear RGB albedo of the surface, if it is one.
    pub fn surface_albedo(&self) -> Option<[f32; 3]> {
        self.matter.surface_albedo()
    }

    /// Whether clipping leaves a place, voxel coordinates.
    pub(crate) fn keeps(&self, p: [f32; 3]) -> bool {
        self.clip.iter().all(|n| n[0] * p[0] + n[1] * p[1] + n[2] * p[2] + n[3] >= 0.0)
    }

    /// Whether clipping leaves some of the voxel that is centred there: each plane alone does.
    pub(crate) fn keeps_part(&self, p: [f32; 3]) -> bool {
        let furthest = |n: &[f32; 4]| 0.5 * (n[0].abs() + n[1].abs() + n[2].abs());
        self.clip.iter().all(|n| n[0] * p[0] + n[1] * p[1] + n[2] * p[2] + n[3] + furthest(n) > 0.0)
    }

    /// Which blocks hold matter.
    pub fn occupancy(&self) -> &Occupancy {
        &self.occupancy
    }

    fn view(&self) -> MediumView<'_> {
        MediumView {
            grid: self.grid(),
            volume: &self.volume.0.image,
            sigma: &self.sigma,
            clips: self.clip.len() as u32,
            albedo: &self.albedo,
            map: self.volume.0.encoding.table_map(self.table.lo, self.table.hi),
            occupancy: &self.occupancy.distances,
            flat_albedo: self.flat_albedo,
        }
    }
}

/// Progress of a stage; its refusal cancels.
fn telling<'a>(stage: &'static str, progress: &'a mut Progress) -> impl FnMut(f64) -> Result<()> + 'a {
    move |fraction| match progress(stage, fraction as f32) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(Error::Cancelled),
    }
}

/// Nobody listens.
fn quiet(_: &'static str, _: f32) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Submits each part of a stage but its last, and tells: places to stop.
fn in_parts<'a>(tell: &'a mut dyn FnMut(f64) -> Result<()>) -> impl FnMut(&mut Recorder, f64) -> Result<()> + 'a {
    move |rec, done| {
        if done < 1.0 {
            rec.submit_part()?;
            tell(done)?;
        }
        Ok(())
    }
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
        Self::on(vk::Device::new(options)?)
    }

    fn on(device: vk::Device) -> Result<Self> {
        match device.lacking(&host::requirements()) {
            Some(lacks) => Err(Error::DeviceLacks { device: device.info().name.clone(), lacks }),
            None => Ok(Self { device, account: Mutex::default() }),
        }
    }

    /// The device.
    pub fn device(&self) -> &DeviceInfo {
        self.device.info()
    }

    /// In what steps the device interpolates, if that is coarser than single precision: what twins are to be told
    /// ([`stages::twin::filtered`]).
    ///
    /// # Errors
    /// As [`crate::vk::Device::filtering`].
    pub fn filtering(&self) -> Result<Option<crate::vk::Filtering>> {
        self.device.filtering()
    }

    /// Memory in use, at most used, and allowed.
    pub fn memory(&self) -> Memory {
        self.device.memory()
    }

    /// Device time per kernel since the last call.
    pub fn take_timings(&self) -> Vec<Span> {
        std::mem::take(&mut self.settled().kept)
    }

    /// Gives back what was taken, for others to take.
    pub fn put_timings(&self, spans: Vec<Span>) {
        Self::merge_timings(&mut self.settled().kept, spans);
    }

    /// Device time per kernel since the engine was made.
    pub fn total_timings(&self) -> Vec<Span> {
        self.settled().total.clone()
    }

    /// Adds up spans by kernel.
    pub fn merge_timings(into: &mut Vec<Span>, spans: impl IntoIterator<Item = Span>) {
        for span in spans {
            match into.iter_mut().find(|s| s.kernel == span.kernel) {
                Some(sum) => {
                    sum.calls += span.calls;
                    sum.seconds += span.seconds;
                }
                None => into.push(span),
            }
        }
    }

    fn settled(&self) -> MutexGuard<'_, Account> {
        let mut account = self.account.lock().unwrap_or_else(PoisonError::into_inner);
        let new = self.device.take_timings();
        Self::merge_timings(&mut account.kept, new.iter().cloned());
        Self::merge_timings(&mut account.total, new);
        account
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
        let voxel = 8 * format.bytes();
        let what = format!("the volume of {}x{}x{} voxels ({voxel} bits each on the device)", dims[0], dims[1], dims[2]);
        let padding = self.padding();
        let (ranges, passing) = stages::occupancy::bytes(volume, |dims, texel| padding.image(dims, texel));
        let needed = padding.image(dims, budget::voxel_bytes(volume)) + ranges + passing;
        self.ask(&what, needed, |free| {
            // In proportion, with all that comes with a voxel.
            let side = (volume.samples().len() as f64 * (free as f64 / needed as f64)).cbrt() as u64;
            format!("about {side}x{side}x{side} voxels would fit; resample the volume or allow more memory")
        })?;
        let image = self.device.image3(&ImageDesc { name: "volume", dims, levels: 1, format, views: &[], storage: false })?;
        let (row, stored) = (dims[0] as usize * dims[1] as usize, SampleType::stored_as(volume));
        self.device.write_image(&image, 0, &mut |first_z, bytes| encode(volume.samples(), stored, first_z as usize * row, bytes))?;
        let ranges = self.upload_ranges(volume)?;
        let samples = match volume.samples() {
            Samples::U8(_) => SampleType::U8,
            Samples::U16(_) => SampleType::U16,
            Samples::I16(_) => SampleType::I16,
            Samples::F32(_) => SampleType::F32,
        };
        let (rescale, encoding) = (volume.rescale(), Encoding::of(volume));
        Ok(DeviceVolume(Arc::new(VolumeData { grid, range: volume.range(), samples, stored, rescale, encoding, image, ranges })))
    }

    /// Brings a volume back to main memory, sample by sample as it was (8-bit signed as 16-bit, 16-bit floats as 32-bit).
    ///
    /// # Errors
    /// [`Error::OutOfMemory`], and what the device refuses.
    pub fn read_volume(&self, volume: &DeviceVolume) -> Result<Volume> {
        let data = &volume.0;
        let bytes = self.device.read_image(&data.image, 0)?;
        let (factor, offset) = data.stored.spread();
        let integers = || bytes.chunks_exact(2).map(|b| i32::from(u16::from_ne_bytes([b[0], b[1]])) / factor - offset);
        fn gathered<T>(samples: impl ExactSizeIterator<Item = T>) -> Result<Vec<T>> {
            let mut all = reserved("a volume", samples.len())?;
            all.extend(samples);
            Ok(all)
        }
        let samples = match data.samples {
            SampleType::U8 => Samples::U8(gathered(integers().map(|v| v as u8))?),
            SampleType::U16 => Samples::U16(gathered(integers().map(|v| v as u16))?),
            SampleType::I8 | SampleType::I16 => Samples::I16(gathered(integers().map(|v| v as i16))?),
            SampleType::F16 | SampleType::F32 => {
                Samples::F32(gathered(bytes.chunks_exact(4).map(|b| f32::from_ne_bytes([b[0], b[1], b[2], b[3]])))?)
            }
        };
        Volume::new(data.grid, samples, data.rescale.0, data.rescale.1)
    }

    /// Gives a volume its matter: transfer function, or opaque surface.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an iso value outside the data.
    pub fn classify(&self, volume: &DeviceVolume, matter: &Matter) -> Result<Medium> {
        self.classify_clipped(volume, matter, &Clip::default())
    }

    /// As [`Engine::classify`]; what `clip` cuts away is vacuum, for viewing rays and for shadows.
    ///
    /// # Errors
    /// As [`Engine::classify`], and as [`Clip::check`].
    pub fn classify_clipped(&self, volume: &DeviceVolume, matter: &Matter, clip: &Clip) -> Result<Medium> {
        self.classify_watched(volume, matter, clip, &mut quiet)
    }

    /// The same, told of its progress.
    ///
    /// # Errors
    /// As [`Engine::classify_clipped`], and [`Error::Cancelled`].
    pub fn classify_watched(&self, volume: &DeviceVolume, matter: &Matter, clip: &Clip, progress: &mut Progress) -> Result<Medium> {
        matter.check_surface(volume.range())?;
        clip.check()?;
        self.classify_within(volume, matter, clip.half_spaces(volume.grid()), progress)
    }

    /// As [`Engine::classify_clipped`], of a frame of an animation, where a surface's value may lie beyond the data: above them
    /// all is vacuum, below them the whole box is solid.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an iso value that is not a number, and as [`Clip::check`].
    pub fn classify_frame(&self, volume: &DeviceVolume, matter: &Matter, clip: &Clip) -> Result<Medium> {
        clip.check()?;
        self.classify_within(volume, matter, clip.half_spaces(volume.grid()), &mut quiet)
    }

    /// The same medium, of which `clip` cuts away more: to be looked into, in a light that was computed for the whole. Where
    /// shadows are to be cut too, [`Engine::classify_clipped`] is what a field must be computed of.
    ///
    /// # Errors
    /// As [`Clip::check`], [`Error::Invalid`] where the planes are too many together, and [`Error::Cancelled`].
    pub fn cut(&self, medium: &Medium, clip: &Clip, progress: &mut Progress) -> Result<Medium> {
        clip.check()?;
        let planes = [&medium.clip[..], &clip.half_spaces(medium.grid())].concat();
        if planes.len() > stages::isosurface::MAX_CLIPS {
            return Err(Error::Invalid {
                item: "clip.planes",
                what: format!("{} planes and faces, with those of the medium", planes.len()),
                right: format!("at most {} are cut by together", stages::isosurface::MAX_CLIPS),
            });
        }
        self.classify_within(&medium.volume, &medium.matter, planes, progress)
    }

    fn classify_within(&self, volume: &DeviceVolume, matter: &Matter, clip: Vec<[f32; 4]>, progress: &mut Progress) -> Result<Medium> {
        let mut tell = telling("classify", progress);
        tell(0.0)?;
        let grid = volume.grid();
        let mut matter = matter.clone();
        let mut table = matter.transfer.table(volume.range(), grid);
        if let (Some(surface), Some(albedo)) = (matter.surface, matter.surface_albedo()) {
            if surface.iso.is_nan() {
                let right = "it must be a number, in the data's unit".into();
                return Err(Error::Invalid { item: "surface.iso", what: "is NaN".into(), right });
            }
            let iso = within_reach(surface.iso, volume.range());
            matter.surface = Some(Surface { iso, albedo: Some(albedo), ..surface });
            table = Table::surface(iso, SURFACE_DEPTH / grid.voxel_length(), albedo);
        }
        self.ask("the transfer function", 20 * table.sigma.len() as u64, |_| "free what this engine holds, or allow more memory".into())?;
        let sigma = self.device.buffer_from("sigma", &[&table.sigma[..], clip.as_flattened(), &[(1.0 / grid.unit()) as f32]].concat())?;
        let albedo = self.device.buffer_from("albedo", &table.albedo)?;
        let occupancy = self.occupancy_of(volume, &table, matter.surface.is_some(), &mut tell)?;
        let flat_albedo = table.albedo.windows(2).all(|w| w[0] == w[1]).then(|| [0, 1, 2].map(|c| table.albedo[0][c]));
        Ok(Medium { volume: volume.clone(), matter, table, sigma, albedo, occupancy, flat_albedo, clip, buried: Default::default() })
    }
}

/// An iso value beyond the data's range, near enough to be stored as the data are, and too far off for rounding to take it
/// for theirs.
fn within_reach(iso: f64, range: [f32; 2]) -> f64 {
    let [lo, hi] = range.map(f64::from);
    let margin = (hi - lo).max(0.01 * lo.abs().max(hi.abs())).max(1e-6);
    // Finite as a 32-bit float, with what surrounds it.
    match iso {
        iso if iso > hi => (hi + margin).min(3.4e38),
        iso if iso < lo => (lo - margin).max(-3.4e38),
        iso => iso,
    }
}

/// Samples from index `first` on as the volume's image stores them.
fn encode(samples: &Samples, stored: SampleType, first: usize, bytes: &mut [u8]) {
    fn put<const N: usize>(bytes: &mut [u8], values: impl Iterator<Item = [u8; N]>) {
        for (out, value) in bytes.chunks_exact_mut(N).zip(values) {
            out.copy_from_slice(&value);
        }
    }
    // v·257/65535 = v/255 exactly.
    let (factor, offset) = stored.spread();
    let word = |v: i32| ((v + offset) * factor) as u16;
    match samples {
        Samples::U8(s) => put(bytes, s[first..].iter().map(|&v| word(v.into()).to_ne_bytes())),
        Samples::U16(s) => put(bytes, s[first..].iter().map(|&v| word(v.into()).to_ne_bytes())),
        Samples::I16(s) => put(bytes, s[first..].iter().map(|&v| word(v.into()).to_ne_bytes())),
        Samples::F32(s) => put(bytes, s[first..].iter().map(|&v| v.to_ne_bytes())),
    }
}

#[cfg(test)]
mod tests {
    use super::within_reach;

    #[test]
    fn an_iso_value_beyond_the_data_stays_beyond_them_and_finite() {
        for range in [[0.0f32, 255.0], [-1.0, 1.0], [5.0, 5.0], [-3e38, 3e38], [-1e-30, 1e-30]] {
            let [lo, hi] = range.map(f64::from);
            for far in [3.3e38, 3.4e38] {
                let (above, below) = (within_reach(far, range), within_reach(-far, range));
                assert!(above > hi && below < lo && (above as f32).is_finite() && (below as f32).is_finite(), "{range:?}: {below} {above}");
                assert!((above as f32) > range[1] && (below as f32) < range[0], "{range:?}");
            }
            assert_eq!(within_reach(0.5 * (lo + hi), range), 0.5 * (lo + hi));
        }
    }
}
