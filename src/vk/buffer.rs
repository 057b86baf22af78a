//! Buffers: typed at the edge, bytes inside.

use super::access::{State, Target};
use super::foreign::Foreign;
use super::raw::Raw;
use super::{Access, Resource, failed, lock};
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationScheme};
use std::ptr::NonNull;
use std::sync::{Arc, Mutex};

/// Above this a buffer gets memory of its own, which goes back to the system when the buffer does. What a picture takes stays below:
/// it comes and goes with every frame.
const DEDICATED: u64 = 16 << 20;

/// A storage buffer in device memory. Clones are the same buffer.
#[derive(Clone)]
pub struct Buffer {
    pub(super) inner: Arc<BufferInner>,
}

pub(super) struct BufferInner {
    pub raw: Arc<Raw>,
    pub handle: vk::Buffer,
    // Nothing only while being dropped, and in a buffer that is not ours.
    allocation: Option<Allocation>,
    /// How it came and goes back, where it is not ours.
    pub foreign: Option<Foreign>,
    counted: bool,
    pub name: String,
    pub bytes: u64,
    pub state: Mutex<State>,
}

impl Drop for BufferInner {
    fn drop(&mut self) {
        // SAFETY: recorders hold an `Arc` of this until their work is done; the buffer goes before its memory.
        unsafe {
            if self.foreign.is_none() {
                self.raw.device.destroy_buffer(self.handle, None);
            }
            if let Some(allocation) = self.allocation.take() {
                self.raw.free(allocation, self.counted);
            }
        }
    }
}

impl BufferInner {
    /// `counted`: inside the memory budget.
    pub(super) fn new(
        raw: &Arc<Raw>,
        name: &str,
        bytes: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
        counted: bool,
    ) -> Result<Self> {
        let create = vk::BufferCreateInfo::default().size(bytes.next_multiple_of(4)).usage(usage);
        // SAFETY: the structure points at nothing else.
        let handle = unsafe { raw.device.create_buffer(&create, None) }.map_err(failed("vkCreateBuffer"))?;
        let mut made = Self {
            raw: raw.clone(),
            handle,
            allocation: None,
            foreign: None,
            counted,
            name: name.to_owned(),
            bytes,
            state: Mutex::new(State::FRESH),
        };
        // SAFETY: the buffer is alive.
        let requirements = unsafe { raw.device.get_buffer_memory_requirements(handle) };
        let scheme = if bytes > DEDICATED { AllocationScheme::DedicatedBuffer(handle) } else { AllocationScheme::GpuAllocatorManaged };
        let allocation = made.allocation.insert(raw.allocate(name, requirements, location, true, scheme, counted)?);
        // SAFETY: the memory fits the buffer's requirements and is bound to nothing else.
        unsafe { raw.device.bind_buffer_memory(handle, allocation.memory(), allocation.offset()) }.map_err(failed("vkBindBufferMemory"))?;
        raw.name(handle, name);
        Ok(made)
    }

    /// The buffer's bytes as the host sees them, where it does, coherently; for reading also cached.
    pub(super) fn mapped(&self, cached: bool) -> Option<NonNull<u8>> {
        let wanted = vk::MemoryPropertyFlags::HOST_COHERENT
            | if cached { vk::MemoryPropertyFlags::HOST_CACHED } else { vk::MemoryPropertyFlags::empty() };
        let allocation = self.allocation.as_ref().filter(|a| a.memory_properties().contains(wanted))?;
        allocation.mapped_ptr().map(NonNull::cast)
    }
}

impl BufferInner {
    /// As [`BufferInner::mapped`], unless copies are to be staged.
    pub(super) fn direct(&self, cached: bool) -> Option<NonNull<u8>> {
        if self.raw.as_card { None } else { self.mapped(cached) }
    }
}

impl Buffer {
    /// A buffer of somebody else, for copies only.
    pub(super) fn lent(raw: &Arc<Raw>, handle: vk::Buffer, name: &str, bytes: u64, foreign: Foreign) -> Self {
        let inner = BufferInner {
            raw: raw.clone(),
            handle,
            allocation: None,
            foreign: Some(foreign),
            counted: false,
            name: name.to_owned(),
            bytes,
            state: Mutex::new(State::ready(Access::Foreign)),
        };
        Self { inner: Arc::new(inner) }
    }

    pub(super) fn storage(raw: &Arc<Raw>, name: &str, bytes: u64) -> Result<Self> {
        if bytes == 0 {
            return Err(Error::Invalid {
                item: "buffer length",
                what: format!("'{name}' would be empty"),
                right: String::from("ask for one element or more"),
            });
        }
        let most = raw.info.max_storage_range;
        if bytes > most {
            return Err(Error::OutOfMemory {
                what: format!("buffer '{name}'"),
                needs: bytes,
                free: most,
                budget: most,
                right: String::from("no larger buffer can be bound on this device (maxStorageBufferRange): split it or use an image"),
            });
        }
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::UNIFORM_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        Ok(Self { inner: Arc::new(BufferInner::new(raw, name, bytes, usage, MemoryLocation::GpuOnly, true)?) })
    }

    /// Bytes that were asked for.
    pub fn len_bytes(&self) -> u64 {
        self.inner.bytes
    }

    /// Its name in messages.
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// The whole buffer, for a barrier.
    pub fn all(&self) -> Resource<'_> {
        Resource { target: Target::Buffer(self) }
    }

    /// The last access on record, of submitted work.
    pub fn last_access(&self) -> Access {
        lock(&self.inner.state).access
    }
}
