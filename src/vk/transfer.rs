//! Data in and out: directly where the host sees the device's memory, else through two small staging halves in turn.

use super::access::{Meaning, State, Used};
use super::buffer::BufferInner;
use super::image::ImageInner;
use super::raw::Raw;
use super::recorder::{buffer_barrier, image_barrier};
use super::slot::Slot;
use super::{Access, Buffer, Device, Image, lock};
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::ptr::NonNull;
use std::sync::Arc;

/// Bytes of one half. While the device empties one, the host fills the other.
const HALF: usize = 16 << 20;

/// The staging buffers, made when first needed.
#[derive(Default)]
pub(super) struct Staging {
    up: Option<Ring>,
    down: Option<Ring>,
}

/// A host-visible buffer of two halves, each with its command buffer.
struct Ring {
    // First, so that pending work is waited for before the memory goes.
    slots: [Slot; 2],
    next: usize,
    buffer: BufferInner,
    mapped: NonNull<u8>,
}

// SAFETY: `mapped` points into the buffer's memory, which lives and moves with it; access needs `&mut`.
unsafe impl Send for Ring {}

impl Ring {
    fn new(raw: &Arc<Raw>, name: &str, up: bool) -> Result<Self> {
        let (usage, location) = if up {
            (vk::BufferUsageFlags::TRANSFER_SRC, MemoryLocation::CpuToGpu)
        } else {
            (vk::BufferUsageFlags::TRANSFER_DST, MemoryLocation::GpuToCpu)
        };
        let buffer = BufferInner::new(raw, name, 2 * HALF as u64, usage, location, false)?;
        let mapped = buffer.mapped(false).ok_or(Error::Vulkan { call: "staging memory", result: String::from("it is not mapped") })?;
        Ok(Self { slots: [Slot::new(raw)?, Slot::new(raw)?], next: 0, buffer, mapped })
    }

    /// The next half, free of earlier work: its offset and a command buffer in recording.
    fn begin(&mut self) -> Result<(usize, vk::CommandBuffer)> {
        let half = self.next;
        self.next = 1 - half;
        self.slots[half].begin()?;
        Ok((half * HALF, self.slots[half].commands))
    }

    /// Hands over the half at `offset`.
    fn submit(&mut self, offset: usize) -> Result<()> {
        self.slots[offset / HALF].submit("a copy")
    }

    /// The bytes of a half that [`Ring::begin`] gave.
    fn bytes(&mut self, offset: usize, len: usize) -> &mut [u8] {
        debug_assert!(offset + len <= 2 * HALF);
        // SAFETY: inside the mapped buffer; the device does not use this half after `begin`, or after the wait that followed a
        // copy; `&mut self` keeps other views away. The memory is the system's, hence initialised.
        unsafe { std::slice::from_raw_parts_mut(self.mapped.as_ptr().add(offset), len.min(HALF)) }
    }

    fn wait(&mut self) -> Result<()> {
        self.slots.iter_mut().try_for_each(|slot| slot.wait("a copy"))
    }
}

impl Device {
    /// Writes the first elements of a buffer (all of them, or fewer), which kernels may then read.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the data is longer than the buffer; failures of the driver.
    pub fn write<T: bytemuck::Pod>(&self, buffer: &Buffer, data: &[T]) -> Result<()> {
        let data: &[u8] = bytemuck::cast_slice(data);
        let inner = &buffer.inner;
        check_range(inner, data.len() as u64)?;
        if data.is_empty() {
            return Ok(());
        }
        let state = *lock(&inner.state);
        if let Some(mapped) = inner.mapped(false) {
            // What kernels wrote before must not land on top of this.
            if state.used == Used::Written || state.access.writes() {
                self.fence(inner, state, &[Access::HostWrite])?;
            }
            let _device_idle = lock(&self.0.raw.queue);
            // SAFETY: the memory is mapped, coherent and long enough; submissions wait for the lock, and earlier ones on this
            // buffer are done.
            unsafe { std::ptr::copy_nonoverlapping(data.as_ptr(), mapped.as_ptr(), data.len()) };
        } else {
            self.upload_buffer(inner, state, data)?;
        }
        // Host writes are visible to all that is submitted later.
        *lock(&inner.state) = State::ready(Access::ComputeRead);
        Ok(())
    }

    fn upload_buffer(&self, inner: &BufferInner, state: State, data: &[u8]) -> Result<()> {
        let raw = &self.0.raw;
        let mut staging = lock(&self.0.staging);
        let mut ring = ring(&mut staging.up, raw, "staging up", true)?;
        let chunks = data.len().div_ceil(HALF);
        for (i, chunk) in data.chunks(HALF).enumerate() {
            let (offset, commands) = ring.begin()?;
            if i == 0 {
                pipeline_barrier(
                    raw,
                    commands,
                    &[buffer_barrier(inner.handle, settled(state, false), Access::TransferWrite.meaning(false))],
                    &[],
                );
            }
            let region = [vk::BufferCopy { src_offset: offset as u64, dst_offset: (i * HALF) as u64, size: chunk.len() as u64 }];
            // SAFETY: both ranges lie inside their buffers, which outlive the wait below.
            unsafe { raw.device.cmd_copy_buffer(commands, ring.buffer.handle, inner.handle, &region) };
            if i + 1 == chunks {
                let to = Access::ComputeRead.meaning(false);
                pipeline_barrier(raw, commands, &[buffer_barrier(inner.handle, Access::TransferWrite.meaning(false), to)], &[]);
            }
            ring.bytes(offset, chunk.len()).copy_from_slice(chunk);
            ring.submit(offset)?;
        }
        ring.wait()
    }

    /// Reads the first `len` elements of a buffer, which kernels may still read.
    ///
    /// # Errors
    /// [`Error::Invalid`] if the buffer is shorter; [`Error::Hazard`] if nobody ever wrote it; failures of the driver.
    pub fn read<T: bytemuck::Pod>(&self, buffer: &Buffer, len: usize) -> Result<Vec<T>> {
        let inner = &buffer.inner;
        let bytes = (len as u64).saturating_mul(size_of::<T>() as u64);
        check_range(inner, bytes)?;
        let mut data = zeroed::<T>(len)?;
        let out: &mut [u8] = bytemuck::cast_slice_mut(&mut data);
        if out.is_empty() {
            return Ok(data);
        }
        let state = *lock(&inner.state);
        written(state, &inner.name)?;
        if let Some(mapped) = inner.mapped(true) {
            self.fence(inner, state, &[Access::HostRead, Access::ComputeRead])?;
            let _device_idle = lock(&self.0.raw.queue);
            // SAFETY: the memory is mapped, coherent and long enough; no submission runs while the lock is held that was not
            // waited for, and the barrier has made earlier writes visible.
            unsafe { std::ptr::copy_nonoverlapping(mapped.as_ptr(), out.as_mut_ptr(), out.len()) };
        } else {
            self.download_buffer(inner, state, out)?;
        }
        *lock(&inner.state) = State::ready(Access::ComputeRead);
        Ok(data)
    }

    fn download_buffer(&self, inner: &BufferInner, state: State, out: &mut [u8]) -> Result<()> {
        let raw = &self.0.raw;
        let mut staging = lock(&self.0.staging);
        let mut ring = ring(&mut staging.down, raw, "staging down", false)?;
        let chunks = out.len().div_ceil(HALF);
        for (i, chunk) in out.chunks_mut(HALF).enumerate() {
            let (offset, commands) = ring.begin()?;
            if i == 0 {
                pipeline_barrier(
                    raw,
                    commands,
                    &[buffer_barrier(inner.handle, settled(state, false), Access::TransferRead.meaning(false))],
                    &[],
                );
            }
            let region = [vk::BufferCopy { src_offset: (i * HALF) as u64, dst_offset: offset as u64, size: chunk.len() as u64 }];
            // SAFETY: both ranges lie inside their buffers, which outlive the wait below.
            unsafe { raw.device.cmd_copy_buffer(commands, inner.handle, ring.buffer.handle, &region) };
            let mut barriers =
                vec![buffer_barrier(ring.buffer.handle, Access::TransferWrite.meaning(false), Access::HostRead.meaning(false))];
            if i + 1 == chunks {
                let to = Access::ComputeRead.meaning(false);
                barriers.push(buffer_barrier(inner.handle, Access::TransferRead.meaning(false), to));
            }
            pipeline_barrier(raw, commands, &barriers, &[]);
            ring.submit(offset)?;
            ring.wait()?;
            chunk.copy_from_slice(ring.bytes(offset, chunk.len()));
        }
        Ok(())
    }

    /// Fills one level of an image, which kernels may then sample. `fill` gets the first slice and the bytes of some whole slices,
    /// tightly packed, x fastest, in ascending order; it must write all of them and must not use the device.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a level that is not there; failures of the driver.
    pub fn write_image(&self, image: &Image, level: u32, fill: &mut dyn FnMut(u32, &mut [u8])) -> Result<()> {
        let walk = Walk::new(image, level)?;
        let inner = &image.inner;
        let raw = &self.0.raw;
        let state = *lock(&inner.states[level as usize]);
        let mut staging = lock(&self.0.staging);
        let mut ring = ring(&mut staging.up, raw, "staging up", true)?;
        // A slice that does not fit a half is filled aside and copied by rows.
        let mut aside = if walk.slice > HALF { zeroed::<u8>(walk.slice)? } else { Vec::new() };
        let parts = walk.parts();
        let last = parts.len().saturating_sub(1);
        for (i, part) in parts.iter().enumerate() {
            let (offset, commands) = ring.begin()?;
            if i == 0 {
                let barrier = image_barrier(inner.handle, level, 1, settled(state, true), Access::TransferWrite.meaning(true));
                pipeline_barrier(raw, commands, &[], &[barrier]);
            }
            // SAFETY: the region lies inside the level and the half; both outlive the wait below.
            unsafe {
                let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
                let region = [walk.region(part, level, offset)];
                raw.device.cmd_copy_buffer_to_image(commands, ring.buffer.handle, inner.handle, layout, &region);
            }
            if i == last {
                let barrier = image_barrier(inner.handle, level, 1, Access::TransferWrite.meaning(true), Access::ComputeRead.meaning(true));
                pipeline_barrier(raw, commands, &[], &[barrier]);
            }
            let len = walk.bytes(part);
            if aside.is_empty() {
                fill(part.z, ring.bytes(offset, len));
            } else {
                if part.y == 0 {
                    fill(part.z, &mut aside);
                }
                let start = part.y as usize * walk.row;
                ring.bytes(offset, len).copy_from_slice(&aside[start..start + len]);
            }
            ring.submit(offset)?;
        }
        ring.wait()?;
        *lock(&inner.states[level as usize]) = State::ready(Access::ComputeRead);
        Ok(())
    }

    /// The texels of one level, tightly packed, x fastest; kernels may then sample it.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a level that is not there; [`Error::Hazard`] if nobody ever wrote it; failures of the driver.
    pub fn read_image(&self, image: &Image, level: u32) -> Result<Vec<u8>> {
        let walk = Walk::new(image, level)?;
        let inner = &image.inner;
        let raw = &self.0.raw;
        let state = *lock(&inner.states[level as usize]);
        written(state, &inner.name)?;
        let mut data = zeroed::<u8>(walk.slice * walk.dims[2] as usize)?;
        let mut staging = lock(&self.0.staging);
        let mut ring = ring(&mut staging.down, raw, "staging down", false)?;
        let parts = walk.parts();
        let last = parts.len().saturating_sub(1);
        for (i, part) in parts.iter().enumerate() {
            let (offset, commands) = ring.begin()?;
            if i == 0 {
                let barrier = image_barrier(inner.handle, level, 1, settled(state, true), Access::TransferRead.meaning(true));
                pipeline_barrier(raw, commands, &[], &[barrier]);
            }
            // SAFETY: the region lies inside the level and the half; both outlive the wait below.
            unsafe {
                let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
                let region = [walk.region(part, level, offset)];
                raw.device.cmd_copy_image_to_buffer(commands, inner.handle, layout, ring.buffer.handle, &region);
            }
            let host = buffer_barrier(ring.buffer.handle, Access::TransferWrite.meaning(false), Access::HostRead.meaning(false));
            let back = image_barrier(inner.handle, level, 1, Access::TransferRead.meaning(true), Access::ComputeRead.meaning(true));
            pipeline_barrier(raw, commands, &[host], if i == last { std::slice::from_ref(&back) } else { &[] });
            ring.submit(offset)?;
            ring.wait()?;
            let start = part.z as usize * walk.slice + part.y as usize * walk.row;
            let len = walk.bytes(part);
            data[start..start + len].copy_from_slice(ring.bytes(offset, len));
        }
        *lock(&inner.states[level as usize]) = State::ready(Access::ComputeRead);
        Ok(data)
    }

    /// A submission that holds one barrier only, towards all of `to`.
    fn fence(&self, inner: &BufferInner, state: State, to: &[Access]) -> Result<()> {
        let mut far = Access::None.meaning(false);
        for access in to {
            let meaning = access.meaning(false);
            far.stage |= meaning.stage;
            far.mask |= meaning.mask;
        }
        let mut slot = self.slot()?;
        pipeline_barrier(&self.0.raw, slot.commands, &[buffer_barrier(inner.handle, settled(state, false), far)], &[]);
        slot.submit("a barrier")?;
        slot.wait("a barrier")?;
        lock(&self.0.slots).push(slot);
        Ok(())
    }
}

/// A ring in use. However the copy ends, what was submitted is waited for before anybody can drop its target.
struct InUse<'a>(&'a mut Ring);

impl Drop for InUse<'_> {
    fn drop(&mut self) {
        let _ = self.0.wait();
    }
}

impl std::ops::Deref for InUse<'_> {
    type Target = Ring;
    fn deref(&self) -> &Ring {
        self.0
    }
}

impl std::ops::DerefMut for InUse<'_> {
    fn deref_mut(&mut self) -> &mut Ring {
        self.0
    }
}

fn ring<'a>(place: &'a mut Option<Ring>, raw: &Arc<Raw>, name: &str, up: bool) -> Result<InUse<'a>> {
    if place.is_none() {
        *place = Some(Ring::new(raw, name, up)?);
    }
    place.as_mut().map(InUse).ok_or(Error::Vulkan { call: "staging memory", result: String::from("none") })
}

/// The near side of a barrier after `state`.
fn settled(state: State, of_image: bool) -> Meaning {
    state.access.meaning(of_image)
}

fn pipeline_barrier(
    raw: &Raw,
    commands: vk::CommandBuffer,
    buffers: &[vk::BufferMemoryBarrier2<'_>],
    images: &[vk::ImageMemoryBarrier2<'_>],
) {
    let info = vk::DependencyInfo::default().buffer_memory_barriers(buffers).image_memory_barriers(images);
    // SAFETY: the command buffer is in recording; the resources are alive and stay so until it was waited for.
    unsafe { raw.device.cmd_pipeline_barrier2(commands, &info) };
}

fn check_range(inner: &BufferInner, bytes: u64) -> Result<()> {
    if bytes <= inner.bytes {
        return Ok(());
    }
    Err(Error::Invalid {
        item: "copy length",
        what: format!("{bytes} bytes of buffer '{}'", inner.name),
        right: format!("it holds {}", inner.bytes),
    })
}

fn written(state: State, name: &str) -> Result<()> {
    if state.access != Access::None {
        return Ok(());
    }
    Err(Error::Hazard {
        kernel: "read",
        binding: "source",
        had: format!("None: '{name}' was never written"),
        needs: format!("{:?}", Access::HostRead),
    })
}

/// Room for `len` elements, without aborting where there is none.
fn zeroed<T: bytemuck::Pod>(len: usize) -> Result<Vec<T>> {
    let mut data = Vec::new();
    data.try_reserve_exact(len).map_err(|_| Error::OutOfMemory {
        what: String::from("a copy in main memory"),
        needs: (len as u64).saturating_mul(size_of::<T>() as u64),
        free: 0,
        budget: 0,
        right: String::from("read less at a time"),
    })?;
    data.resize(len, T::zeroed());
    Ok(data)
}

/// How a level is cut into pieces of one staging half.
struct Walk {
    dims: [u32; 3],
    /// Bytes of a row and of a slice.
    row: usize,
    slice: usize,
}

/// Whole slices, or rows of one slice.
struct Part {
    y: u32,
    z: u32,
    rows: u32,
    slices: u32,
}

impl Walk {
    fn new(image: &Image, level: u32) -> Result<Self> {
        let inner: &ImageInner = &image.inner;
        if level >= image.levels() {
            return Err(Error::Invalid {
                item: "image level",
                what: format!("'{}' has no level {level}", inner.name),
                right: format!("it has {} levels", image.levels()),
            });
        }
        let dims = inner.level_dims(level);
        let row = dims[0] as usize * inner.format.bytes() as usize;
        Ok(Self { dims, row, slice: row * dims[1] as usize })
    }

    fn parts(&self) -> Vec<Part> {
        let [_, height, depth] = self.dims;
        if self.slice <= HALF {
            let step = (HALF / self.slice) as u32;
            return (0..depth).step_by(step as usize).map(|z| Part { y: 0, z, rows: height, slices: step.min(depth - z) }).collect();
        }
        let step = ((HALF / self.row) as u32).max(1);
        (0..depth)
            .flat_map(|z| (0..height).step_by(step as usize).map(move |y| Part { y, z, rows: step.min(height - y), slices: 1 }))
            .collect()
    }

    fn bytes(&self, part: &Part) -> usize {
        self.row * part.rows as usize * part.slices as usize
    }

    fn region(&self, part: &Part, level: u32, offset: usize) -> vk::BufferImageCopy {
        vk::BufferImageCopy {
            buffer_offset: offset as u64,
            buffer_row_length: 0,
            buffer_image_height: 0,
            image_subresource: vk::ImageSubresourceLayers {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                mip_level: level,
                base_array_layer: 0,
                layer_count: 1,
            },
            // An image edge has 2^31 texels at most.
            image_offset: vk::Offset3D { x: 0, y: part.y as i32, z: part.z as i32 },
            image_extent: vk::Extent3D { width: self.dims[0], height: part.rows, depth: part.slices },
        }
    }
}
