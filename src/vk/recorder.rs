//! Records dispatches and the barriers between them, and keeps the ledger.

use super::access::{Need, State};
use super::buffer::BufferInner;
use super::foreign::{Foreign, Semaphores, ours};
use super::image::ImageInner;
use super::kernel::BindingInfo;
use super::raw::Raw;
use super::slot::Slot;
use super::transfer::another_device;
use super::{Bindings, Bound, Buffer, Device, KernelInfo, Specialization, lock, timing};
use crate::error::{Error, Result};
use ash::vk;
use std::collections::HashMap;
use std::ffi::CString;
use std::sync::{Arc, Mutex};

/// Work for the device, in order.
///
/// **The ledger.** The recorder knows the last access of every buffer and image level. A dispatch is refused with [`Error::Hazard`]
/// if a binding's access was not announced by a barrier (or by [`Device::write`] and its kin, which leave a resource readable), if
/// the resource was written since the last barrier, or if it would be written after a read. It never inserts a barrier by itself.
pub struct Recorder {
    // Dropped in this order: pending work is waited for, then what it used may go.
    pub(super) slot: Slot,
    pub(super) ledger: HashMap<(usize, u32), Entry>,
    pub(super) device: Device,
    /// The first wrong barrier; told at the next call that can fail.
    pub(super) wrong: Option<Error>,
    /// Kernel of each pair of timestamps.
    dispatched: Vec<&'static str>,
    /// What comes with borrowed resources that are taken or given back here.
    pub(super) semaphores: Semaphores,
}

/// One buffer or image level that this recorder touched.
pub(super) struct Entry {
    // Keeps the resource alive until the work is done.
    kept: Kept,
    before: State,
    pub now: State,
    /// Whether it went back to its owner in this recording.
    pub given_back: bool,
}

#[derive(Clone)]
pub(super) enum Kept {
    Buffer(Arc<BufferInner>),
    Image(Arc<ImageInner>, u32),
}

impl Kept {
    pub(super) fn key(&self) -> (usize, u32) {
        match self {
            Self::Buffer(b) => (Arc::as_ptr(b) as usize, 0),
            Self::Image(i, level) => (Arc::as_ptr(i) as usize, *level),
        }
    }

    fn state(&self) -> &Mutex<State> {
        match self {
            Self::Buffer(b) => &b.state,
            // Levels are checked before a `Kept` is made.
            Self::Image(i, level) => &i.states[*level as usize],
        }
    }

    pub(super) fn foreign(&self) -> Option<&Foreign> {
        match self {
            Self::Buffer(b) => b.foreign.as_ref(),
            Self::Image(i, _) => i.foreign.as_ref(),
        }
    }

    fn raw(&self) -> &Arc<Raw> {
        match self {
            Self::Buffer(b) => &b.raw,
            Self::Image(i, _) => &i.raw,
        }
    }

    pub(super) fn describe(&self) -> String {
        match self {
            Self::Buffer(b) => format!("buffer '{}'", b.name),
            Self::Image(i, level) => format!("image '{}' level {level}", i.name),
        }
    }
}

impl Recorder {
    pub(super) fn new(device: &Device) -> Result<Self> {
        let slot = device.slot()?;
        Ok(Self {
            device: device.clone(),
            slot,
            ledger: HashMap::new(),
            wrong: None,
            dispatched: Vec::new(),
            semaphores: Semaphores::default(),
        })
    }

    /// Runs a kernel over `threads` invocations, rounded up to whole work groups: the kernel checks its bounds.
    ///
    /// # Errors
    /// [`Error::Hazard`] where a barrier is missing; [`Error::Invalid`] for more work groups than the device takes, or resources of
    /// another device; failures of the driver.
    pub fn dispatch<B: Bindings>(&mut self, bindings: &B, spec: &B::Spec, params: &B::Params, threads: [u32; 3]) -> Result<()> {
        if let Some(error) = self.wrong.take() {
            return Err(error);
        }
        let kernel = B::KERNEL;
        let groups = self.groups(&kernel, threads)?;
        let push = bytemuck::bytes_of(params);
        let bound = bindings.bound();
        if bound.len() != kernel.bindings.len() || push.len() != kernel.push_bytes as usize {
            return Err(invalid(
                &kernel,
                String::from("bindings or push constants differ from its declaration"),
                String::from("use the generated types"),
            ));
        }
        self.enter(&kernel, &bound)?;
        let pipeline = self.device.pipeline(&kernel, &spec.words())?;
        let set = self.descriptors(&kernel, &bound, pipeline.set_layout)?;

        let raw = self.device.0.raw.clone();
        let commands = self.slot.commands;
        let label = CString::new(kernel.name).unwrap_or_default();
        let timed = self.device.0.clock.timed();
        if let Some(names) = &raw.names {
            // SAFETY: the command buffer is in recording; the label lives until the call returns.
            unsafe { names.cmd_begin_debug_utils_label(commands, &vk::DebugUtilsLabelEXT::default().label_name(&label)) };
        }
        if timed {
            self.slot.timestamp()?;
        }
        // SAFETY: the command buffer is in recording; pipeline, set and what the set names are kept alive by the device's list of
        // pipelines, the slot and the ledger until the work is done; kinds, counts and sizes were checked against the kernel.
        unsafe {
            let device = &raw.device;
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, pipeline.pipeline);
            device.cmd_bind_descriptor_sets(commands, vk::PipelineBindPoint::COMPUTE, pipeline.layout, 0, &[set], &[]);
            if !push.is_empty() {
                device.cmd_push_constants(commands, pipeline.layout, vk::ShaderStageFlags::COMPUTE, 0, push);
            }
            device.cmd_dispatch(commands, groups[0], groups[1], groups[2]);
        }
        if timed {
            self.slot.timestamp()?;
        }
        if let Some(names) = &raw.names {
            // SAFETY: as above; the label was begun above.
            unsafe { names.cmd_end_debug_utils_label(commands) };
        }
        self.dispatched.push(kernel.name);
        Ok(())
    }

    /// Sets all words of a buffer. Its last access must be announced as [`Access::TransferWrite`], or it must be new.
    ///
    /// # Errors
    /// [`Error::Hazard`] where the barrier is missing.
    pub fn fill(&mut self, buffer: &Buffer, word: u32) -> Result<()> {
        if let Some(error) = self.wrong.take() {
            return Err(error);
        }
        ours(buffer.inner.foreign.as_ref(), &buffer.inner.name)?;
        let kept = Kept::Buffer(buffer.inner.clone());
        self.made_here("fill", &kept)?;
        let entry = self.entry(&kept);
        let had = entry.now;
        let Some(after) = had.after(Need::Fill) else {
            return Err(Error::Hazard {
                kernel: "fill",
                binding: "buffer",
                had: format!("{} of {}", had.describe(), kept.describe()),
                needs: format!("{:?}", Need::Fill.access()),
            });
        };
        entry.now = after;
        // SAFETY: the command buffer is in recording; the buffer's size is a multiple of 4, and the ledger keeps it alive.
        unsafe { self.device.0.raw.device.cmd_fill_buffer(self.slot.commands, buffer.inner.handle, 0, vk::WHOLE_SIZE, word) };
        Ok(())
    }

    /// Runs what was recorded and waits until it is done; its time goes to [`Device::take_timings`].
    ///
    /// # Errors
    /// [`Error::Hazard`] for a wrong barrier, or if another recorder used the same resources meanwhile; [`Error::DeviceLost`].
    pub fn submit(mut self) -> Result<()> {
        if let Some(error) = self.wrong.take() {
            return Err(error);
        }
        let shared = self.device.0.clone();
        let turn = lock(&shared.turn);
        for entry in self.ledger.values() {
            let found = *lock(entry.kept.state());
            if !entry.before.still_holds(found, entry.now) {
                return Err(Error::Hazard {
                    kernel: "submit",
                    binding: "resource",
                    had: format!("{} of {}, since it was recorded", found.describe(), entry.kept.describe()),
                    needs: format!("{}, as then", entry.before.describe()),
                });
            }
        }
        let during = self.dispatched.last().map_or_else(|| String::from("barriers"), |k| format!("kernel '{k}'"));
        self.slot.submit(&during, &self.semaphores)?;
        self.slot.wait(&during)?;
        for entry in self.ledger.values() {
            *lock(entry.kept.state()) = entry.now;
            if let Some(foreign) = entry.kept.foreign().filter(|_| entry.given_back) {
                foreign.note_given_back();
            }
        }
        drop(turn);
        let clock = self.device.0.clock;
        let ticks = if clock.timed() { self.slot.timestamps()? } else { Vec::new() };
        let mut timings = lock(&self.device.0.timings);
        for (i, kernel) in self.dispatched.iter().enumerate() {
            let pair = ticks.get(2 * i).zip(ticks.get(2 * i + 1));
            timing::add(&mut timings, kernel, pair.map(|(begin, end)| clock.seconds(*begin, *end)));
        }
        drop(timings);
        let Self { device, slot, .. } = self;
        lock(&device.0.slots).push(slot);
        Ok(())
    }

    /// The same of what was recorded so far; what is recorded next goes to another submission.
    ///
    /// # Errors
    /// As [`Recorder::submit`].
    pub fn submit_part(&mut self) -> Result<()> {
        let next = self.device.record()?;
        std::mem::replace(self, next).submit()
    }

    /// Work groups for so many invocations.
    fn groups(&self, kernel: &KernelInfo, threads: [u32; 3]) -> Result<[u32; 3]> {
        let most = self.device.0.raw.limits.max_compute_work_group_count;
        let groups: [u32; 3] = std::array::from_fn(|i| threads[i].div_ceil(kernel.local_size[i].max(1)));
        if threads.contains(&0) || (0..3).any(|i| groups[i] > most[i]) {
            return Err(invalid(
                kernel,
                format!("{threads:?} invocations ({groups:?} work groups) asked for"),
                format!("1 to {most:?} work groups of {:?} on this device", kernel.local_size),
            ));
        }
        Ok(groups)
    }

    /// The ledger's entry of a resource, as this recorder sees it.
    pub(super) fn entry(&mut self, kept: &Kept) -> &mut Entry {
        self.ledger.entry(kept.key()).or_insert_with(|| {
            let state = *lock(kept.state());
            Entry { kept: kept.clone(), before: state, now: state, given_back: false }
        })
    }

    /// Enters a copy, both ends or none.
    pub(super) fn enter_copy(&mut self, from: &Kept, reads: Need, to: &Kept, writes: Need) -> Result<()> {
        if let Some(error) = self.wrong.take() {
            return Err(error);
        }
        let mut entered: Option<(&Kept, State)> = None;
        for (kept, need, binding) in [(from, reads, "from"), (to, writes, "to")] {
            self.made_here("copy", kept)?;
            let had = self.entry(kept).now;
            let Some(after) = had.after(need) else {
                if let Some((kept, had)) = entered {
                    self.entry(kept).now = had;
                }
                return Err(Error::Hazard {
                    kernel: "copy",
                    binding,
                    had: format!("{} of {}", had.describe(), kept.describe()),
                    needs: format!("{:?}", need.access()),
                });
            };
            self.entry(kept).now = after;
            entered = Some((kept, had));
        }
        Ok(())
    }

    /// Refuses what another device made.
    pub(super) fn made_here(&self, item: &'static str, kept: &Kept) -> Result<()> {
        if Arc::ptr_eq(kept.raw(), &self.device.0.raw) { Ok(()) } else { Err(another_device(item, &kept.describe())) }
    }

    /// Where commands are recorded.
    pub(super) fn commands(&self) -> (&ash::Device, vk::CommandBuffer) {
        (&self.device.0.raw.device, self.slot.commands)
    }

    /// Enters a dispatch's accesses, all or none.
    fn enter(&mut self, kernel: &KernelInfo, bound: &[Bound<'_>]) -> Result<()> {
        let mut entered = Vec::new();
        let outcome = kernel.bindings.iter().zip(bound).try_for_each(|(info, bound)| {
            for kept in self.kept(kernel, info, bound)? {
                let entry = self.entry(&kept);
                let had = entry.now;
                let need: Need = info.need();
                let Some(after) = had.after(need) else {
                    return Err(Error::Hazard {
                        kernel: kernel.name,
                        binding: info.name,
                        had: format!("{} of {}", had.describe(), kept.describe()),
                        needs: format!("{:?}", need.access()),
                    });
                };
                entry.now = after;
                entered.push((kept.key(), had));
            }
            Ok(())
        });
        if outcome.is_err() {
            for (key, had) in entered.into_iter().rev() {
                if let Some(entry) = self.ledger.get_mut(&key) {
                    entry.now = had;
                }
            }
        }
        outcome
    }

    /// The resources behind one binding, checked against its declaration.
    fn kept(&self, kernel: &KernelInfo, info: &BindingInfo, bound: &Bound<'_>) -> Result<Vec<Kept>> {
        use super::BindingKind::{SampledImage, StorageBuffer, StorageImage, UniformBuffer};
        let (raw, kept) = match (info.kind, bound) {
            (StorageBuffer | UniformBuffer, Bound::Buffer(b)) => {
                ours(b.inner.foreign.as_ref(), &b.inner.name)?;
                let most = u64::from(self.device.0.raw.limits.max_uniform_buffer_range);
                if info.kind == UniformBuffer && b.inner.bytes > most {
                    return Err(invalid(
                        kernel,
                        format!("'{}' has {} bytes", info.name, b.inner.bytes),
                        format!("at most {most} for a uniform block"),
                    ));
                }
                (&b.inner.raw, vec![Kept::Buffer(b.inner.clone())])
            }
            (StorageImage, Bound::Storage(s)) => {
                s.image.inner.view(s.key())?;
                (&s.image.inner.raw, vec![Kept::Image(s.image.inner.clone(), s.level)])
            }
            (SampledImage, Bound::Sampled(s)) => {
                s.image.inner.view(s.key())?;
                let levels = s.base..s.base + s.count;
                (&s.image.inner.raw, levels.map(|level| Kept::Image(s.image.inner.clone(), level)).collect())
            }
            _ => return Err(invalid(kernel, format!("'{}' is bound to another kind", info.name), format!("bind a {:?}", info.kind))),
        };
        if !Arc::ptr_eq(raw, &self.device.0.raw) {
            return Err(invalid(
                kernel,
                format!("'{}' belongs to another device", info.name),
                String::from("make it on this recorder's device"),
            ));
        }
        Ok(kept)
    }

    fn descriptors(&mut self, kernel: &KernelInfo, bound: &[Bound<'_>], layout: vk::DescriptorSetLayout) -> Result<vk::DescriptorSet> {
        let set = self.slot.descriptor_set(layout)?;
        let shared = &self.device.0;
        let mut buffers = vec![[vk::DescriptorBufferInfo::default()]; bound.len()];
        let mut images = vec![[vk::DescriptorImageInfo::default()]; bound.len()];
        for (i, bound) in bound.iter().enumerate() {
            match bound {
                Bound::Buffer(b) => buffers[i] = [vk::DescriptorBufferInfo { buffer: b.inner.handle, offset: 0, range: vk::WHOLE_SIZE }],
                Bound::Storage(s) => {
                    let view = s.image.inner.view(s.key())?;
                    images[i] = [vk::DescriptorImageInfo::default().image_view(view).image_layout(vk::ImageLayout::GENERAL)];
                }
                Bound::Sampled(s) => {
                    let linear = !s.nearest && self.device.supports_filtering(s.format);
                    images[i] = [vk::DescriptorImageInfo {
                        sampler: if linear { shared.linear } else { shared.nearest },
                        image_view: s.image.inner.view(s.key())?,
                        image_layout: vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
                    }];
                }
            }
        }
        let writes: Vec<_> = kernel
            .bindings
            .iter()
            .enumerate()
            .map(|(i, info)| {
                let write = vk::WriteDescriptorSet::default().dst_set(set).dst_binding(info.number).descriptor_type(info.descriptor_type());
                if matches!(bound[i], Bound::Buffer(_)) { write.buffer_info(&buffers[i]) } else { write.image_info(&images[i]) }
            })
            .collect();
        // SAFETY: the set is fresh and not in use; views and buffers are alive.
        unsafe { shared.raw.device.update_descriptor_sets(&writes, &[]) };
        Ok(set)
    }
}

fn invalid(kernel: &KernelInfo, what: String, right: String) -> Error {
    Error::Invalid { item: "dispatch", what: format!("kernel '{}': {what}", kernel.name), right }
}
