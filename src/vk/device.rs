//! The device: what makes buffers, images and recorders.

use super::host::{HostDevice, Requirements};
use super::kernel::Pipeline;
use super::raw::Raw;
use super::slot::Slot;
use super::staging::Staging;
use super::timing::{Clock, Span};
use super::{
    Buffer, DeviceInfo, DeviceKind, Filtering, Format, Image, ImageDesc, KernelInfo, Memory, Options, Recorder, cache, canary, failed,
    filtering, lock,
};
use crate::error::{Error, Result};
use crate::kernels::constants::MOST_LANES;
use ash::vk;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock};

/// Kernel and specialization words.
type PipelineKey = (&'static str, Vec<u32>);

/// A Vulkan device with one compute queue. Clones are the same device; buffers, images and recorders keep it alive.
#[derive(Clone)]
pub struct Device(pub(super) Arc<Shared>);

pub(super) struct Shared {
    pub raw: Arc<Raw>,
    pub clock: Clock,
    pub linear: vk::Sampler,
    pub nearest: vk::Sampler,
    pub timings: Mutex<Vec<Span>>,
    pub slots: Mutex<Vec<Slot>>,
    pub staging: Mutex<Staging>,
    /// Held from where the ledger's states are read to where they are set, over the work in between. Taken before `staging`.
    pub turn: Mutex<()>,
    pipelines: Mutex<HashMap<PipelineKey, Arc<Pipeline>>>,
    cache: vk::PipelineCache,
    cache_path: Option<PathBuf>,
    loop_limit: OnceLock<u32>,
    filtering: OnceLock<Option<Filtering>>,
}

impl Drop for Shared {
    fn drop(&mut self) {
        if let Some(path) = &self.cache_path
            && self.cache != vk::PipelineCache::null()
        {
            cache::save(&self.raw.device, self.cache, path);
        }
        // SAFETY: recorders hold this alive until their work is done; nobody else uses these objects. Nulls are allowed.
        unsafe {
            self.raw.device.destroy_pipeline_cache(self.cache, None);
            self.raw.device.destroy_sampler(self.linear, None);
            self.raw.device.destroy_sampler(self.nearest, None);
        }
    }
}

/// Names everything that is missing at once.
pub(super) fn check_features(instance: &ash::Instance, physical: vk::PhysicalDevice, info: &DeviceInfo) -> Result<()> {
    let lacks = Requirements::with_formats(&[]).lacks(instance, physical);
    if lacks.is_empty() { Ok(()) } else { Err(Error::DeviceLacks { device: info.name.clone(), lacks: lacks.join(", ") }) }
}

impl Device {
    /// Opens a device. Runs one small kernel to learn [`Device::loop_limit`].
    ///
    /// # Errors
    /// [`Error::NoDevice`] without loader, driver or device of the wanted name; [`Error::DeviceLacks`] naming every missing feature;
    /// [`Error::Invalid`] where the wanted threads cannot be set soundly.
    pub fn new(options: &Options) -> Result<Self> {
        if let Some(threads) = options.threads {
            set_threads(threads)?;
        }
        Self::on(Raw::new(options)?, options)
    }

    /// Works on a device of the host, which it neither destroys nor waits for as a whole: of the host's it uses one queue, under
    /// the host's lock. Runs one small kernel, as [`Device::new`] does.
    ///
    /// # Errors
    /// [`Error::DeviceLacks`] naming what is missing or not enabled; [`Error::Invalid`] for handles and queues that cannot be, and
    /// for [`Options::device`], `validation` and `threads`, which are the host's business.
    pub fn import(host: &HostDevice, options: &Options) -> Result<Self> {
        Self::on(Raw::import(host, options)?, options)
    }

    fn on(raw: Raw, options: &Options) -> Result<Self> {
        let raw = Arc::new(raw);
        let cache_path = cache::path(options.pipeline_cache.as_deref(), &raw.info);
        let clock = Clock { period: f64::from(raw.limits.timestamp_period), bits: raw.timestamp_bits };
        // Filled step by step, so that a failure on the way drops what was made.
        let mut shared = Shared {
            clock,
            linear: vk::Sampler::null(),
            nearest: vk::Sampler::null(),
            timings: Mutex::default(),
            slots: Mutex::default(),
            staging: Mutex::default(),
            turn: Mutex::default(),
            pipelines: Mutex::default(),
            cache: vk::PipelineCache::null(),
            cache_path,
            loop_limit: OnceLock::new(),
            filtering: OnceLock::new(),
            raw,
        };
        shared.linear = sampler(&shared.raw, vk::Filter::LINEAR, vk::SamplerMipmapMode::LINEAR)?;
        shared.nearest = sampler(&shared.raw, vk::Filter::NEAREST, vk::SamplerMipmapMode::NEAREST)?;
        shared.cache = cache::open(&shared.raw.device, shared.cache_path.as_deref())?;
        let device = Self(Arc::new(shared));
        let limit = canary::loop_limit(&device)?;
        let _ = device.0.loop_limit.set(limit);
        Ok(device)
    }

    /// What the device says of itself.
    pub fn info(&self) -> &DeviceInfo {
        &self.0.raw.info
    }

    /// Iterations that one invocation may make, over all its loops: some drivers leave longer loops without a word.
    pub fn loop_limit(&self) -> u32 {
        self.0.loop_limit.get().copied().unwrap_or(u32::from(u16::MAX))
    }

    /// Invocations that share a loop in kernels whose invocations are too few for a card; `each` is how many there are along x
    /// of a work group. One on a CPU, which has no idle lanes.
    ///
    /// At least four otherwise, for as many cells' sums are added up side by side.
    pub fn lanes(&self, each: u32) -> u32 {
        let fit = (self.0.raw.limits.max_compute_work_group_invocations / each.max(1)).min(MOST_LANES as u32);
        if self.is_card() && fit >= 4 { fit } else { 1 }
    }

    /// Most work groups of a dispatch along x.
    pub(crate) fn max_groups(&self) -> u32 {
        self.0.raw.limits.max_compute_work_group_count[0]
    }

    /// Whether its work wants to be wide and its dispatches few.
    pub(crate) fn is_card(&self) -> bool {
        self.0.raw.info.kind != DeviceKind::Cpu || self.0.raw.as_card
    }

    /// The queue family that all work is submitted to.
    pub fn queue_family(&self) -> u32 {
        self.0.raw.family
    }

    /// Device memory of buffers and images.
    pub fn memory(&self) -> Memory {
        self.0.raw.memory()
    }

    /// Errors that the validation layers have reported so far; always empty without [`Options::validation`].
    pub fn validation_errors(&self) -> Vec<String> {
        lock(&self.0.raw.messages).clone()
    }

    /// Whether images of this format are interpolated when sampled.
    pub fn supports_filtering(&self, format: Format) -> bool {
        let raw = &self.0.raw;
        // SAFETY: the device belongs to the instance.
        let found = unsafe { raw.instance.get_physical_device_format_properties(raw.physical, format.raw()) };
        found.optimal_tiling_features.contains(vk::FormatFeatureFlags::SAMPLED_IMAGE_FILTER_LINEAR)
    }

    /// In what steps images are interpolated; nothing where they are finer than 1/2048 of a texel. The first call runs one small
    /// kernel.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`], [`Error::DeviceLost`] and the driver's own failures.
    pub fn filtering(&self) -> Result<Option<Filtering>> {
        if let Some(known) = self.0.filtering.get() {
            return Ok(*known);
        }
        let found = filtering::measure(self, 0)?;
        Ok(*self.0.filtering.get_or_init(|| found))
    }

    /// What it lacks of these requirements, in words that follow "lacks".
    pub fn lacking(&self, requirements: &Requirements) -> Option<String> {
        let lacks = requirements.lacks(&self.0.raw.instance, self.0.raw.physical);
        (!lacks.is_empty()).then(|| lacks.join(", "))
    }

    /// A buffer of `len` elements, contents undefined.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] over the budget or over what the device can bind (which of them, the text says).
    pub fn buffer<T: bytemuck::Pod>(&self, name: &str, len: usize) -> Result<Buffer> {
        let bytes = (len as u64).saturating_mul(size_of::<T>() as u64);
        Buffer::storage(&self.0.raw, name, bytes)
    }

    /// A buffer with these contents, ready to be read by kernels.
    ///
    /// # Errors
    /// As [`Device::buffer`] and [`Device::write`].
    pub fn buffer_from<T: bytemuck::Pod>(&self, name: &str, data: &[T]) -> Result<Buffer> {
        let buffer = self.buffer::<T>(name, data.len())?;
        self.write(&buffer, data)?;
        Ok(buffer)
    }

    /// An image, contents undefined, in memory of its own.
    ///
    /// # Errors
    /// [`Error::Invalid`] for sizes that the device does not make, [`Error::OutOfMemory`] over the budget or the device's largest
    /// allocation, [`Error::DeviceLacks`] for a format that it does not know in that use.
    pub fn image3(&self, desc: &ImageDesc<'_>) -> Result<Image> {
        Image::new(&self.0.raw, desc)
    }

    /// Bytes that such an image would take, as this device pads it; nothing for one that it does not make.
    pub fn image3_bytes(&self, desc: &ImageDesc<'_>) -> Option<u64> {
        super::image::bytes(&self.0.raw, desc)
    }

    /// Starts to record dispatches.
    ///
    /// # Errors
    /// [`Error::DeviceLost`] and the driver's own failures.
    pub fn record(&self) -> Result<Recorder> {
        Recorder::new(self)
    }

    /// Time per kernel since the last call, in order of first dispatch.
    pub fn take_timings(&self) -> Vec<Span> {
        std::mem::take(&mut lock(&self.0.timings))
    }

    /// The pipeline of a kernel with these specialization words, made once.
    pub(super) fn pipeline(&self, kernel: &KernelInfo, spec: &[u32]) -> Result<Arc<Pipeline>> {
        let mut known = lock(&self.0.pipelines);
        let key = (kernel.name, spec.to_vec());
        if let Some(pipeline) = known.get(&key) {
            return Ok(pipeline.clone());
        }
        let made = Arc::new(Pipeline::new(&self.0.raw, self.0.cache, kernel, spec)?);
        known.insert(key, made.clone());
        Ok(made)
    }

    /// A slot in recording.
    pub(super) fn slot(&self) -> Result<Slot> {
        let idle = lock(&self.0.slots).pop();
        let mut slot = match idle {
            Some(slot) => slot,
            None => Slot::new(&self.0.raw)?,
        };
        slot.begin()?;
        Ok(slot)
    }
}

fn sampler(raw: &Raw, filter: vk::Filter, mipmap: vk::SamplerMipmapMode) -> Result<vk::Sampler> {
    let edge = vk::SamplerAddressMode::CLAMP_TO_EDGE;
    let create = vk::SamplerCreateInfo::default()
        .mag_filter(filter)
        .min_filter(filter)
        .mipmap_mode(mipmap)
        .address_mode_u(edge)
        .address_mode_v(edge)
        .address_mode_w(edge)
        .max_lod(vk::LOD_CLAMP_NONE);
    // SAFETY: the structure points at nothing else.
    unsafe { raw.device.create_sampler(&create, None) }.map_err(failed("vkCreateSampler"))
}

/// Hands the number of threads to lavapipe, which reads it from the environment when its device is opened.
fn set_threads(threads: usize) -> Result<()> {
    const NAME: &str = "LP_NUM_THREADS";
    let wanted = threads.to_string();
    if std::env::var(NAME).is_ok_and(|now| now == wanted) {
        return Ok(());
    }
    if !alone() {
        return Err(Error::Invalid {
            item: "threads",
            what: format!("{threads} cannot be set any more: the process already has other threads, which may be reading the environment"),
            right: format!("open the device before starting threads, or set {NAME}={threads} when starting the process"),
        });
    }
    // SAFETY: the environment may be changed while no other thread reads it, and there is no other thread: only this one could
    // start one, and it is here. (On Windows the system itself makes this call safe.)
    unsafe { std::env::set_var(NAME, wanted) };
    Ok(())
}

/// Whether nobody else can be reading the environment.
fn alone() -> bool {
    cfg!(windows)
        || std::fs::read_to_string("/proc/self/status")
            .is_ok_and(|status| status.lines().any(|l| l.strip_prefix("Threads:").is_some_and(|n| n.trim() == "1")))
}
