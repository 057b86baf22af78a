//! `hl_volume_*`: samples in host memory, copied or borrowed, and on the device.

use super::abi::*;
use super::call::{alone, choice, enter, fill, finite, put, read, switch, words};
use super::fault::{Fault, Result};
use super::handle::Object;
use super::host::Host;
use super::log::{Borrowed, Release};
use super::vulkan;
use crate::engine::host::SampleType as Stored;
use crate::engine::{DeviceVolume, Engine};
use crate::io::info::BINS;
use crate::io::{self, ReadOptions, SampleType, VolumeInfo};
use crate::scene::{Grid, Samples, Volume};
use glam::{DAffine3, DMat3, DVec3};
use std::ffi::c_char;
use std::sync::Arc;

/// Numbers at a voxel that are taken seriously.
const MAX_COMPONENTS: u32 = 1 << 16;

/// What a volume's handle stands for.
pub(super) struct VolumeCell {
    host: Arc<Host>,
    pub device: DeviceVolume,
    source: Source,
}

/// Where the samples are in main memory.
enum Source {
    Own(Arc<Volume>),
    Borrowed(Layout, Borrowed),
    /// Only on the device: it came from an image or a buffer of the host's.
    Device,
}

impl Object for VolumeCell {
    type Handle = hl_volume;
    const NAME: &'static str = "volume";

    fn host(&self) -> &Arc<Host> {
        &self.host
    }
}

impl VolumeCell {
    /// The samples in main memory; of those that are borrowed or only on the device a passing copy.
    pub fn volume(&self, engine: &Engine) -> Result<Arc<Volume>> {
        match &self.source {
            Source::Own(volume) => Ok(volume.clone()),
            Source::Borrowed(layout, memory) => layout.volume(memory.data.cast()).map(Arc::new),
            Source::Device => Ok(Arc::new(engine.read_volume(&self.device)?)),
        }
    }

    /// What the samples are like.
    pub fn described(&self) -> Result<VolumeInfo> {
        let volume = match &self.source {
            // No reason to wait for the device.
            Source::Own(volume) => volume.clone(),
            _ => self.volume(self.host.turn()?.engine())?,
        };
        Ok(io::describe(&volume))
    }

    fn new(host: &Arc<Host>, volume: Arc<Volume>, source: Source) -> Result<Arc<Self>> {
        let turn = host.turn()?;
        let device = host.log.during(host.id, || turn.engine().upload(&volume))?;
        Ok(Arc::new(Self { host: host.clone(), device, source }))
    }
}

/// How samples lie in memory.
#[derive(Clone, Copy)]
struct Layout {
    grid: Grid,
    kind: SampleType,
    /// Bytes from the first number to the first sample.
    offset: usize,
    strides: [i64; 3],
    slope: f32,
    intercept: f32,
    nan_as: Option<f32>,
}

impl Layout {
    fn of(info: &hl_volume_info) -> Result<Self> {
        let kinds = [
            (HL_UINT8, SampleType::U8),
            (HL_INT8, SampleType::I8),
            (HL_UINT16, SampleType::U16),
            (HL_INT16, SampleType::I16),
            (HL_UINT32, SampleType::U32),
            (HL_INT32, SampleType::I32),
            (HL_UINT64, SampleType::U64),
            (HL_INT64, SampleType::I64),
            (HL_FLOAT32, SampleType::F32),
            (HL_FLOAT64, SampleType::F64),
        ];
        let kind = choice("hl_volume_info.type", info.r#type, &kinds)?;
        let grid = grid(info)?;
        let nan_as = switch("hl_volume_info.replace_nan", info.replace_nan)?.then_some(info.nan_as);
        if let Some(v) = nan_as {
            finite("hl_volume_info.nan_as", &[f64::from(v)])?;
        }
        let slope = if info.slope == 0.0 { 1.0 } else { info.slope };
        let components = info.components.max(1);
        if info.component >= components || components > MAX_COMPONENTS {
            let what = format!("is {} of {}", info.component, info.components);
            return Err(Fault::invalid("hl_volume_info.component", what, "components are counted from 0, and 65536 are taken at most"));
        }
        let offset = info.component as usize * kind.bytes() as usize;
        let strides = strides(info, kind, components)?;
        Ok(Self { grid, kind, offset, strides, slope, intercept: info.intercept, nan_as })
    }

    /// The samples at `data`, where the first voxel is.
    fn volume(&self, data: *const u8) -> Result<Volume> {
        let data = data.wrapping_add(self.offset);
        let samples = match self.kind {
            SampleType::U8 => Samples::U8(self.gather(data, |b: [u8; 1]| b[0])?),
            SampleType::I8 => Samples::I16(self.gather(data, |b| i16::from(i8::from_ne_bytes(b)))?),
            SampleType::U16 => Samples::U16(self.gather(data, u16::from_ne_bytes)?),
            SampleType::I16 => Samples::I16(self.gather(data, i16::from_ne_bytes)?),
            SampleType::U32 => Samples::F32(self.gather(data, |b| u32::from_ne_bytes(b) as f32)?),
            SampleType::I32 => Samples::F32(self.gather(data, |b| i32::from_ne_bytes(b) as f32)?),
            SampleType::U64 => Samples::F32(self.gather(data, |b| u64::from_ne_bytes(b) as f32)?),
            SampleType::I64 => Samples::F32(self.gather(data, |b| i64::from_ne_bytes(b) as f32)?),
            SampleType::F32 => Samples::F32(self.gather(data, |b| self.number(f32::from_ne_bytes(b)))?),
            SampleType::F64 => Samples::F32(self.gather(data, |b| self.number(f64::from_ne_bytes(b) as f32))?),
        };
        if let Samples::F32(s) = &samples
            && let Some(i) = s.iter().position(|v| !v.is_finite())
        {
            let [nx, ny, _] = self.grid.dims();
            let what = format!("sample ({}, {}, {}) is {}", i % nx, i / nx % ny, i / nx / ny, s[i]);
            return Err(Fault::invalid(
                "hl_volume_info.data",
                what,
                "all must be finite; replace_nan = 1 puts nan_as in the place of others",
            ));
        }
        Ok(Volume::new(self.grid, samples, self.slope, self.intercept)?)
    }

    fn number(&self, v: f32) -> f32 {
        if v.is_finite() { v } else { self.nan_as.unwrap_or(v) }
    }

    /// All samples, x fastest.
    fn gather<const N: usize, T>(&self, data: *const u8, convert: impl Fn([u8; N]) -> T) -> Result<Vec<T>> {
        let [nx, ny, nz] = self.grid.dims();
        let [sx, sy, sz] = self.strides;
        let mut all = Vec::new();
        let count = usize::try_from(self.grid.voxels()).ok().filter(|&n| all.try_reserve_exact(n).is_ok());
        if count.is_none() {
            return Err(Fault::memory("a copy of the volume"));
        }
        for z in 0..nz as i64 {
            for y in 0..ny as i64 {
                // No overflow: `strides` checked the farthest sample.
                let row = data.wrapping_offset((y * sy + z * sz) as isize);
                // SAFETY: the caller says that a sample lies at every place that dims and strides name; bytes need no
                // alignment.
                all.extend((0..nx as i64).map(|x| convert(unsafe { row.wrapping_offset((x * sx) as isize).cast::<[u8; N]>().read() })));
            }
        }
        Ok(all)
    }
}

fn grid(info: &hl_volume_info) -> Result<Grid> {
    let or = |values: &[f64], default: &[f64]| if values.iter().all(|&v| v == 0.0) { default.to_vec() } else { values.to_vec() };
    let spacing = or(&info.spacing, &[1.0; 3]);
    let axes = or(&info.axes, &DMat3::IDENTITY.to_cols_array());
    finite("hl_volume_info.spacing, axes and origin", &[&spacing[..], &axes[..], &info.origin[..]].concat())?;
    let axis = |a: usize| DVec3::from_slice(&axes[3 * a..]) * spacing[a];
    let map = DAffine3 { matrix3: DMat3::from_cols(axis(0), axis(1), axis(2)), translation: DVec3::from(info.origin) };
    Ok(Grid::new(info.dims.map(|n| n as usize), map)?)
}

/// Bytes between samples; the farthest sample can be addressed.
fn strides(info: &hl_volume_info, kind: SampleType, components: u32) -> Result<[i64; 3]> {
    let each = kind.bytes() as i64 * i64::from(components);
    let [nx, ny, _] = info.dims.map(i64::from);
    let wrong =
        || Fault::invalid("hl_volume_info.strides", format_args!("{:?} reach beyond any memory", info.strides), "count them in bytes");
    let strides = match info.strides {
        [0, 0, 0] => {
            let slice = (each * nx).checked_mul(ny).ok_or_else(wrong)?;
            [each, each * nx, slice]
        }
        given => given,
    };
    let reach = (0..3).try_fold(0i64, |sum, a| sum.checked_add((i64::from(info.dims[a]) - 1).checked_mul(strides[a].checked_abs()?)?));
    let most = isize::MAX as i64 - each;
    if reach.is_some_and(|r| r <= most) { Ok(strides) } else { Err(wrong()) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_volume_create(engine: *mut hl_engine, info: *const hl_volume_info, volume: *mut *mut hl_volume) -> hl_status {
    enter(|scope| {
        let made = scope.making("volume", volume, |s| s.engine(engine));
        let info = read("hl_volume_info", info);
        // Tells that the host's image or buffer is not touched, whatever is refused.
        let source = info.as_ref().map_or(Ok(None), source);
        let ((host, out), info) = (made?, info?);
        if let Some(source) = source? {
            return out.give(from_device(&host, &info, &source)?);
        }
        if info.data.is_null() {
            return Err(Fault::invalid("hl_volume_info.data", "is NULL", "samples are needed"));
        }
        let layout = Layout::of(&info)?;
        let borrowed = choice("hl_volume_info.memory", info.memory, &[(HL_COPY, false), (HL_BORROW, true)])?;
        let read = Arc::new(layout.volume(info.data.cast())?);
        if !borrowed {
            return out.give(VolumeCell::new(&host, read.clone(), Source::Own(read))?);
        }
        // The memory stays the caller's if this fails: only what succeeded lets go of it later.
        let mut cell = VolumeCell::new(&host, read.clone(), Source::Own(read))?;
        let release = Release { engine: host.id, release: info.release, user: info.release_user, data: info.data };
        if let Some(cell) = Arc::get_mut(&mut cell) {
            cell.source = Source::Borrowed(layout, Arc::new(release));
        }
        out.give(cell)
    })
}

/// What lies on the host's device, if anything does.
fn source(info: &hl_volume_info) -> Result<Option<vulkan::Source>> {
    if info.next.is_null() { Ok(None) } else { vulkan::Source::of(info.next).map(Some) }
}

/// A volume from an image or a buffer of the host's device.
fn from_device(host: &Arc<Host>, info: &hl_volume_info, source: &vulkan::Source) -> Result<Arc<VolumeCell>> {
    if !info.data.is_null() {
        return Err(Fault::invalid("hl_volume_info.data", "stands beside an image or buffer", "set it to NULL"));
    }
    if info.components > 1 || info.component > 0 {
        let right = "an image or a buffer of the host's holds one number a voxel: set both to 0";
        return Err(Fault::invalid("hl_volume_info.components and component", "are set", right));
    }
    if info.strides != [0; 3] {
        let right = "an image has none, and a hl_vulkan_buffer its own row_bytes and slice_bytes: set them to 0";
        return Err(Fault::invalid("hl_volume_info.strides", "are set", right));
    }
    if info.memory != HL_COPY || info.release.is_some() || !info.release_user.is_null() {
        let right = "an image or a buffer of the host's is copied, and handed back as its semaphores say: set them to 0";
        return Err(Fault::invalid("hl_volume_info.memory, release and release_user", "are set", right));
    }
    if info.replace_nan != 0 || info.nan_as != 0.0 {
        let right = "samples on the device that are not finite are an error: set both to 0";
        return Err(Fault::invalid("hl_volume_info.replace_nan and nan_as", "are set", right));
    }
    if matches!(source, vulkan::Source::Image(_)) && info.r#type != 0 {
        let right = "an image's samples are of its VkFormat: set it to 0";
        return Err(Fault::invalid("hl_volume_info.type", format_args!("is {}", info.r#type), right));
    }
    let (grid, slope) = (grid(info)?, if info.slope == 0.0 { 1.0 } else { info.slope });
    let turn = host.turn()?;
    let rescale = (slope, info.intercept);
    let device = host.log.during(host.id, || source.upload(turn.engine(), info.r#type, &grid, rescale))?;
    Ok(Arc::new(VolumeCell { host: host.clone(), device, source: Source::Device }))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_volume_load(
    engine: *mut hl_engine,
    path: *const c_char,
    info: *const hl_load_info,
    volume: *mut *mut hl_volume,
) -> hl_status {
    enter(|scope| {
        let (host, out) = scope.making("volume", volume, |s| s.engine(engine))?;
        let path = super::call::path(path)?;
        let options = if info.is_null() { ReadOptions::default() } else { options(&read("hl_load_info", info)?)? };
        let read = Arc::new(host.log.during(host.id, || io::read_volume(&path, &options))?);
        out.give(VolumeCell::new(&host, read.clone(), Source::Own(read))?)
    })
}

fn options(info: &hl_load_info) -> Result<ReadOptions<'static>> {
    alone("hl_load_info", info.next)?;
    finite("hl_load_info.spacing", &info.spacing)?;
    let nan_as = switch("hl_load_info.replace_nan", info.replace_nan)?.then_some(info.nan_as);
    finite("hl_load_info.nan_as", &[f64::from(nan_as.unwrap_or(0.0))])?;
    Ok(ReadOptions {
        component: words("hl_load_info.component", info.component)?,
        series: words("hl_load_info.series", info.series)?,
        spacing: (info.spacing != [0.0; 3]).then_some(info.spacing),
        nan_as,
        ..ReadOptions::default()
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_volume_destroy(volume: *mut hl_volume) -> hl_status {
    enter(|scope| {
        scope.take::<VolumeCell>(volume)?;
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_volume_get_range(volume: *const hl_volume, dims: *mut u32, range: *mut f64) -> hl_status {
    enter(|scope| {
        let volume = scope.get::<VolumeCell>(volume)?;
        put(dims.cast::<[u32; 3]>(), volume.device.grid().dims().map(|n| n as u32));
        put(range.cast::<[f64; 2]>(), volume.device.range().map(f64::from));
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_volume_get_info(volume: *const hl_volume, info: *mut hl_volume_info) -> hl_status {
    enter(|scope| {
        let device = &scope.get::<VolumeCell>(volume)?.device;
        let map = device.grid().voxel_to_world();
        fill("hl_volume_info", info, |out| {
            out.dims = device.grid().dims().map(|n| n as u32);
            out.r#type = match device.samples() {
                Stored::U8 => HL_UINT8,
                Stored::U16 => HL_UINT16,
                Stored::I8 | Stored::I16 => HL_INT16,
                Stored::F16 | Stored::F32 => HL_FLOAT32,
            };
            out.spacing = device.grid().spacing();
            let axes = [map.matrix3.x_axis, map.matrix3.y_axis, map.matrix3.z_axis].map(|v| v.normalize_or_zero().to_array());
            out.axes.copy_from_slice(axes.as_flattened());
            out.origin = map.translation.to_array();
            (out.slope, out.intercept) = device.rescale();
        })
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_volume_get_histogram(volume: *const hl_volume, bins: *mut u64, mean: *mut f64) -> hl_status {
    enter(|scope| {
        let volume = scope.get::<VolumeCell>(volume)?;
        if bins.is_null() {
            return Err(Fault::invalid("bins", "is NULL", "room for 64 numbers is needed"));
        }
        let info = volume.described()?;
        let mut all = [0u64; BINS];
        all.copy_from_slice(&info.histogram);
        put(bins.cast::<[u64; BINS]>(), all);
        put(mean, info.mean);
        Ok(HL_OK)
    })
}
