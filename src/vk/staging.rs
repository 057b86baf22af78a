//! Staging: a small buffer that host and device both see, in two halves. While the device empties one, the host fills the other.

use super::buffer::BufferInner;
use super::foreign::Semaphores;
use super::raw::Raw;
use super::slot::Slot;
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::ptr::NonNull;
use std::sync::Arc;

/// Bytes of one half: few, for the host copies one while the device copies the other, and they stay in a processor's cache; enough
/// to hide a submission.
pub(super) const HALF: usize = 4 << 20;

/// The staging buffers, made when first needed.
#[derive(Default)]
pub(super) struct Staging {
    pub up: Option<Ring>,
    pub down: Option<Ring>,
}

/// A host-visible buffer of two halves, each with its command buffer.
pub(super) struct Ring {
    // First, so that pending work is waited for before the memory goes.
    slots: [Slot; 2],
    next: usize,
    pub buffer: BufferInner,
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
    pub(super) fn begin(&mut self) -> Result<(usize, vk::CommandBuffer)> {
        let half = self.next;
        self.next = 1 - half;
        self.slots[half].begin()?;
        Ok((half * HALF, self.slots[half].commands))
    }

    /// Hands over the half at `offset`.
    pub(super) fn submit(&mut self, offset: usize) -> Result<()> {
        self.slots[offset / HALF].submit("a copy", &Semaphores::default())
    }

    /// Waits for what was handed over with the half at `offset`, and takes what it brought.
    pub(super) fn take(&mut self, offset: usize, out: &mut [u8]) -> Result<()> {
        self.slots[offset / HALF].wait("a copy")?;
        out.copy_from_slice(self.bytes(offset, out.len()));
        Ok(())
    }

    /// The bytes of a half that [`Ring::begin`] gave.
    pub(super) fn bytes(&mut self, offset: usize, len: usize) -> &mut [u8] {
        debug_assert!(offset + len <= 2 * HALF);
        // SAFETY: inside the mapped buffer; the device does not use this half after `begin`, or after the wait that followed a
        // copy; `&mut self` keeps other views away. The memory is the system's, hence initialised.
        unsafe { std::slice::from_raw_parts_mut(self.mapped.as_ptr().add(offset), len.min(HALF)) }
    }

    pub(super) fn wait(&mut self) -> Result<()> {
        self.slots.iter_mut().try_for_each(|slot| slot.wait("a copy"))
    }
}

/// A ring in use. However the copy ends, what was submitted is waited for before anybody can drop its target.
pub(super) struct InUse<'a>(&'a mut Ring);

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

/// The ring of a place, made when first needed.
pub(super) fn ring<'a>(place: &'a mut Option<Ring>, raw: &Arc<Raw>, name: &str, up: bool) -> Result<InUse<'a>> {
    if place.is_none() {
        *place = Some(Ring::new(raw, name, up)?);
    }
    place.as_mut().map(InUse).ok_or(Error::Vulkan { call: "staging memory", result: String::from("none") })
}
