//! Buffers in and out: directly where the host sees the device's memory, else through staging.

use super::access::{State, Used};
use super::barrier::buffer_barrier;
use super::buffer::BufferInner;
use super::foreign::{Semaphores, ours};
use super::raw::Raw;
use super::staging::{HALF, ring};
use super::{Access, Buffer, Device, lock};
use crate::error::{Error, Result};
use crate::room::zeroed;
use ash::vk;
use std::sync::{Arc, MutexGuard};

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
        let _turn = self.turn(&inner.raw, &inner.name)?;
        let state = *lock(&inner.state);
        if let Some(mapped) = inner.direct(false) {
            // What kernels wrote before must not land on top of this.
            if state.used == Used::Written || state.access.writes() {
                self.fence(inner, state, &[Access::HostWrite])?;
            }
            // SAFETY: the memory is mapped, coherent and long enough; a submission holds the turn until it is done, and so does
            // this.
            unsafe { std::ptr::copy_nonoverlapping(data.as_ptr(), mapped.as_ptr(), data.len()) };
        } else {
            self.upload_buffer(inner, state, data)?;
        }
        // Host writes are visible to all that is submitted later.
        *lock(&inner.state) = State::ready(Access::ComputeRead);
        Ok(())
    }

    /// The ledger, for one copy from where a state is read to where it is set; what is of another device is refused.
    pub(super) fn turn(&self, raw: &Arc<Raw>, name: &str) -> Result<MutexGuard<'_, ()>> {
        if !Arc::ptr_eq(raw, &self.0.raw) {
            return Err(another_device("copy", &format!("'{name}'")));
        }
        Ok(lock(&self.0.turn))
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
                    &[buffer_barrier(inner.handle, state.access.meaning(false), Access::TransferWrite.meaning(false))],
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
        check_range(&buffer.inner, (len as u64).saturating_mul(size_of::<T>() as u64))?;
        let mut data = zeroed::<T>("a copy", len)?;
        self.read_into(buffer, &mut data)?;
        Ok(data)
    }

    /// The same into memory that is there.
    ///
    /// # Errors
    /// As [`Device::read`].
    pub fn read_into<T: bytemuck::Pod>(&self, buffer: &Buffer, data: &mut [T]) -> Result<()> {
        let inner = &buffer.inner;
        let out: &mut [u8] = bytemuck::cast_slice_mut(data);
        check_range(inner, out.len() as u64)?;
        if out.is_empty() {
            return Ok(());
        }
        let _turn = self.turn(&inner.raw, &inner.name)?;
        let state = *lock(&inner.state);
        written(state, &inner.name)?;
        if let Some(mapped) = inner.direct(true) {
            self.fence(inner, state, &[Access::HostRead, Access::ComputeRead])?;
            // SAFETY: the memory is mapped, coherent and long enough; a submission holds the turn until it is done, and the
            // barrier has made its writes visible.
            unsafe { std::ptr::copy_nonoverlapping(mapped.as_ptr(), out.as_mut_ptr(), out.len()) };
        } else {
            self.download_buffer(inner, state, out)?;
        }
        *lock(&inner.state) = State::ready(Access::ComputeRead);
        Ok(())
    }

    fn download_buffer(&self, inner: &BufferInner, state: State, out: &mut [u8]) -> Result<()> {
        let raw = &self.0.raw;
        let mut staging = lock(&self.0.staging);
        let mut ring = ring(&mut staging.down, raw, "staging down", false)?;
        let chunks = out.len().div_ceil(HALF);
        // The chunk before, which the host copies while the device copies this one.
        let mut before: Option<(usize, &mut [u8])> = None;
        for (i, chunk) in out.chunks_mut(HALF).enumerate() {
            let (offset, commands) = ring.begin()?;
            if i == 0 {
                pipeline_barrier(
                    raw,
                    commands,
                    &[buffer_barrier(inner.handle, state.access.meaning(false), Access::TransferRead.meaning(false))],
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
            if let Some((offset, chunk)) = before.replace((offset, chunk)) {
                ring.take(offset, chunk)?;
            }
        }
        before.map_or(Ok(()), |(offset, chunk)| ring.take(offset, chunk))
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
        pipeline_barrier(&self.0.raw, slot.commands, &[buffer_barrier(inner.handle, state.access.meaning(false), far)], &[]);
        slot.submit("a barrier", &Semaphores::default())?;
        slot.wait("a barrier")?;
        lock(&self.0.slots).push(slot);
        Ok(())
    }
}

pub(super) fn pipeline_barrier(
    raw: &Raw,
    commands: vk::CommandBuffer,
    buffers: &[vk::BufferMemoryBarrier2<'_>],
    images: &[vk::ImageMemoryBarrier2<'_>],
) {
    let info = vk::DependencyInfo::default().buffer_memory_barriers(buffers).image_memory_barriers(images);
    // SAFETY: the command buffer is in recording; the resources are alive and stay so until it was waited for.
    unsafe { raw.device.cmd_pipeline_barrier2(commands, &info) };
}

pub(super) fn another_device(item: &'static str, what: &str) -> Error {
    Error::Invalid { item, what: format!("{what} belongs to another device"), right: String::from("make it on this one") }
}

fn check_range(inner: &BufferInner, bytes: u64) -> Result<()> {
    ours(inner.foreign.as_ref(), &inner.name)?;
    if bytes <= inner.bytes {
        return Ok(());
    }
    Err(Error::Invalid {
        item: "copy length",
        what: format!("{bytes} bytes of buffer '{}'", inner.name),
        right: format!("it holds {}", inner.bytes),
    })
}

pub(super) fn written(state: State, name: &str) -> Result<()> {
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
