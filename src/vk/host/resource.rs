//! Images and buffers of the host, as they cross the line and come back.

/// `VK_QUEUE_FAMILY_IGNORED`: the object changes no owner (it is shared, or was made for the family that we use).
pub const QUEUE_FAMILY_IGNORED: u32 = u32::MAX;

/// A value of a timeline semaphore.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timeline {
    /// `VkSemaphore`, of type timeline.
    pub semaphore: u64,
    /// Its value.
    pub value: u64,
}

/// An image of the host, part by part; see [`HostImage::new`].
#[derive(Clone, Copy, Debug)]
pub struct HostImageParts {
    /// `VkImage`, of one sample a texel, 2-D or 3-D; level 0 of layer 0 is used.
    pub image: u64,
    /// `VkFormat`.
    pub format: i32,
    /// Texels along x, y, z; z is 1 for a 2-D image.
    pub extent: [u32; 3],
    /// `VkImageUsageFlags`: `TRANSFER_SRC` to be read, `TRANSFER_DST` to be written.
    pub usage: u32,
    /// `VkImageLayout` that it is in now. `UNDEFINED` for an image to be written whose contents do not matter.
    pub layout: i32,
    /// `VkImageLayout` in which it is to be handed back. `UNDEFINED` (0): as it came, and `GENERAL` if it came undefined.
    pub layout_after: i32,
    /// Queue family that owns it now and gets it back; [`QUEUE_FAMILY_IGNORED`] where no owner changes. From another family than
    /// ours, the host must have released it to ours (see [`crate::vk::Device::queue_family`]), and acquires it after, each with a
    /// barrier whose old and new layout are both `layout`, respectively `layout_after`.
    pub queue_family: u32,
    /// What is waited for before it is touched. Nothing: the host has made its own writes visible, or made them in submissions
    /// that came earlier to the queue that we use.
    pub wait: Option<Timeline>,
    /// What is signalled when it is handed back. Nothing: the call into the engine returns when that is done.
    pub signal: Option<Timeline>,
}

/// An image of the host for one call into the engine, promised to be as described. After the call it tells how it was handed back.
#[derive(Clone, Copy, Debug)]
pub struct HostImage {
    pub(in crate::vk) parts: HostImageParts,
    pub(in crate::vk) handed_back: bool,
}

impl HostImage {
    /// Takes the host's word for its image.
    ///
    /// # Safety
    /// - The image belongs to the device of the engine that it is handed to, is bound to memory, and is as described.
    /// - From the call into the engine until it returns, nobody else touches it, except as `wait` and `signal` order it.
    /// - The semaphores belong to the same device; the value of `wait` will be reached without this call returning, and not by
    ///   work that comes later to the queue that we use; that of `signal` is not reached before.
    pub unsafe fn new(parts: HostImageParts) -> Self {
        Self { parts, handed_back: false }
    }

    /// The image as it is now: after a call into the engine, `layout` is that in which it was handed back.
    pub fn parts(&self) -> &HostImageParts {
        &self.parts
    }

    /// Whether the last call handed it back: `layout` is `layout_after`, the owner is the old one again, and `signal`, if any, is
    /// signalled. Not so when the call refused its arguments and never touched it, and when the device was lost.
    pub fn handed_back(&self) -> bool {
        self.handed_back
    }
}

/// A buffer of the host, part by part; see [`HostBuffer::new`].
#[derive(Clone, Copy, Debug)]
pub struct HostBufferParts {
    /// `VkBuffer`, made with `TRANSFER_SRC`.
    pub buffer: u64,
    /// Bytes of the whole buffer.
    pub size: u64,
    /// Byte of the first sample.
    pub offset: u64,
    /// Bytes from one row to the next; 0: rows follow each other without a gap.
    pub row_bytes: u64,
    /// Bytes from one slice to the next; 0: slices follow each other without a gap.
    pub slice_bytes: u64,
    /// As [`HostImageParts::queue_family`].
    pub queue_family: u32,
    /// As [`HostImageParts::wait`].
    pub wait: Option<Timeline>,
    /// As [`HostImageParts::signal`].
    pub signal: Option<Timeline>,
}

/// A buffer of the host for one call into the engine, promised to be as described.
#[derive(Clone, Copy, Debug)]
pub struct HostBuffer {
    pub(in crate::vk) parts: HostBufferParts,
    pub(in crate::vk) handed_back: bool,
}

impl HostBuffer {
    /// Takes the host's word for its buffer.
    ///
    /// # Safety
    /// As for [`HostImage::new`].
    pub unsafe fn new(parts: HostBufferParts) -> Self {
        Self { parts, handed_back: false }
    }

    /// What was handed over.
    pub fn parts(&self) -> &HostBufferParts {
        &self.parts
    }

    /// As [`HostImage::handed_back`].
    pub fn handed_back(&self) -> bool {
        self.handed_back
    }
}
