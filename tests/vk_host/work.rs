//! The host's own work: buffers, images, submissions under its lock, semaphores.

use crate::host::Host;
use ash::vk::{self, Handle};
use halflight::engine::host::{HostBuffer, HostBufferParts, HostImage, HostImageParts, QUEUE_FAMILY_IGNORED, Timeline};

/// A buffer in memory that the host of the device sees.
pub struct Bytes<'a> {
    host: &'a Host,
    pub buffer: vk::Buffer,
    memory: vk::DeviceMemory,
    pub size: u64,
}

impl<'a> Bytes<'a> {
    pub fn new(host: &'a Host, size: u64) -> Self {
        // SAFETY: plain Vulkan, in order.
        unsafe {
            let usage = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
            let buffer = host.device.create_buffer(&vk::BufferCreateInfo::default().size(size).usage(usage), None).unwrap();
            let memory = allocate(host, host.device.get_buffer_memory_requirements(buffer), SEEN);
            host.device.bind_buffer_memory(buffer, memory, 0).unwrap();
            Self { host, buffer, memory, size }
        }
    }

    pub fn of(host: &'a Host, data: &[u8]) -> Self {
        let made = Self::new(host, data.len() as u64);
        // SAFETY: mapped, long enough, not in use.
        unsafe {
            let to = host.device.map_memory(made.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()).unwrap();
            std::ptr::copy_nonoverlapping(data.as_ptr(), to.cast::<u8>(), data.len());
            host.device.unmap_memory(made.memory);
        }
        made
    }

    pub fn read(&self) -> Vec<u8> {
        let mut data = vec![0; self.size as usize];
        // SAFETY: as above.
        unsafe {
            let from = self.host.device.map_memory(self.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()).unwrap();
            std::ptr::copy_nonoverlapping(from.cast::<u8>(), data.as_mut_ptr(), data.len());
            self.host.device.unmap_memory(self.memory);
        }
        data
    }

    pub fn lent(&self, change: impl FnOnce(&mut HostBufferParts)) -> HostBuffer {
        let mut parts = HostBufferParts {
            buffer: self.buffer.as_raw(),
            size: self.size,
            offset: 0,
            row_bytes: 0,
            slice_bytes: 0,
            queue_family: QUEUE_FAMILY_IGNORED,
            wait: None,
            signal: None,
        };
        change(&mut parts);
        // SAFETY: it is so, save for what a test changes to be refused.
        unsafe { HostBuffer::new(parts) }
    }
}

impl Drop for Bytes<'_> {
    fn drop(&mut self) {
        // SAFETY: work on it was waited for.
        unsafe {
            self.host.device.destroy_buffer(self.buffer, None);
            self.host.device.free_memory(self.memory, None);
        }
    }
}

/// What the host of the device writes and reads in place.
const SEEN: vk::MemoryPropertyFlags =
    vk::MemoryPropertyFlags::from_raw(vk::MemoryPropertyFlags::HOST_VISIBLE.as_raw() | vk::MemoryPropertyFlags::HOST_COHERENT.as_raw());

unsafe fn allocate(host: &Host, needs: vk::MemoryRequirements, wanted: vk::MemoryPropertyFlags) -> vk::DeviceMemory {
    // SAFETY: plain Vulkan, in order.
    unsafe {
        let all = host.instance.get_physical_device_memory_properties(host.physical);
        let index = (0..all.memory_type_count)
            .find(|&i| needs.memory_type_bits & (1 << i) != 0 && all.memory_types[i as usize].property_flags.contains(wanted))
            .expect("memory of this kind");
        let create = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(index);
        host.device.allocate_memory(&create, None).unwrap()
    }
}

/// An image of the host, 3-D where it is deep.
pub struct Texels<'a> {
    host: &'a Host,
    pub image: vk::Image,
    memory: vk::DeviceMemory,
    pub format: vk::Format,
    pub extent: [u32; 3],
    pub usage: vk::ImageUsageFlags,
}

impl<'a> Texels<'a> {
    pub fn new(host: &'a Host, format: vk::Format, extent: [u32; 3]) -> Self {
        let usage = vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
        let ty = if extent[2] > 1 { vk::ImageType::TYPE_3D } else { vk::ImageType::TYPE_2D };
        let create = vk::ImageCreateInfo::default()
            .image_type(ty)
            .format(format)
            .extent(vk::Extent3D { width: extent[0], height: extent[1], depth: extent[2] })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(usage);
        // SAFETY: plain Vulkan, in order.
        unsafe {
            let image = host.device.create_image(&create, None).unwrap();
            // A separate card has no image in memory that its host sees.
            let memory = allocate(host, host.device.get_image_memory_requirements(image), vk::MemoryPropertyFlags::DEVICE_LOCAL);
            host.device.bind_image_memory(image, memory, 0).unwrap();
            Self { host, image, memory, format, extent, usage }
        }
    }

    pub fn lent(&self, layout: vk::ImageLayout, change: impl FnOnce(&mut HostImageParts)) -> HostImage {
        let mut parts = HostImageParts {
            image: self.image.as_raw(),
            format: self.format.as_raw(),
            extent: self.extent,
            usage: self.usage.as_raw(),
            layout: layout.as_raw(),
            layout_after: 0,
            queue_family: QUEUE_FAMILY_IGNORED,
            wait: None,
            signal: None,
        };
        change(&mut parts);
        // SAFETY: it is so, save for what a test changes to be refused.
        unsafe { HostImage::new(parts) }
    }

    fn region(&self) -> vk::BufferImageCopy {
        let layers = vk::ImageSubresourceLayers { aspect_mask: vk::ImageAspectFlags::COLOR, layer_count: 1, ..Default::default() };
        let [width, height, depth] = self.extent;
        vk::BufferImageCopy::default().image_subresource(layers).image_extent(vk::Extent3D { width, height, depth })
    }

    /// Fills it and leaves it in `layout`.
    pub fn fill(&self, commands: &Commands, from: &Bytes, layout: vk::ImageLayout) {
        self.turn(commands, vk::ImageLayout::UNDEFINED, vk::ImageLayout::TRANSFER_DST_OPTIMAL);
        // SAFETY: in recording; buffer and image live until the work is done.
        unsafe {
            let to = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
            commands.host.device.cmd_copy_buffer_to_image(commands.buffer, from.buffer, self.image, to, &[self.region()]);
        }
        self.turn(commands, vk::ImageLayout::TRANSFER_DST_OPTIMAL, layout);
    }

    /// Reads it out of `layout`.
    pub fn drain(&self, commands: &Commands, layout: vk::ImageLayout, to: &Bytes) {
        self.turn(commands, layout, vk::ImageLayout::TRANSFER_SRC_OPTIMAL);
        // SAFETY: as above.
        unsafe {
            let from = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
            commands.host.device.cmd_copy_image_to_buffer(commands.buffer, self.image, from, to.buffer, &[self.region()]);
        }
        let seen = [vk::BufferMemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER)
            .src_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags2::HOST)
            .dst_access_mask(vk::AccessFlags2::HOST_READ)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .buffer(to.buffer)
            .size(vk::WHOLE_SIZE)];
        // SAFETY: as above.
        unsafe {
            commands.host.device.cmd_pipeline_barrier2(commands.buffer, &vk::DependencyInfo::default().buffer_memory_barriers(&seen));
        }
    }

    fn turn(&self, commands: &Commands, from: vk::ImageLayout, to: vk::ImageLayout) {
        let all = vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE;
        let range =
            vk::ImageSubresourceRange { aspect_mask: vk::ImageAspectFlags::COLOR, level_count: 1, layer_count: 1, ..Default::default() };
        let barriers = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .src_access_mask(all)
            .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .dst_access_mask(all)
            .old_layout(from)
            .new_layout(to)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(self.image)
            .subresource_range(range)];
        // SAFETY: as above.
        unsafe {
            commands.host.device.cmd_pipeline_barrier2(commands.buffer, &vk::DependencyInfo::default().image_memory_barriers(&barriers));
        }
    }
}

impl Drop for Texels<'_> {
    fn drop(&mut self) {
        // SAFETY: work on it was waited for.
        unsafe {
            self.host.device.destroy_image(self.image, None);
            self.host.device.free_memory(self.memory, None);
        }
    }
}

/// One submission of the host.
pub struct Commands<'a> {
    host: &'a Host,
    pool: vk::CommandPool,
    pub buffer: vk::CommandBuffer,
    fence: vk::Fence,
}

impl<'a> Commands<'a> {
    pub fn begin(host: &'a Host) -> Self {
        // SAFETY: plain Vulkan, in order.
        unsafe {
            let pool = host.device.create_command_pool(&vk::CommandPoolCreateInfo::default(), None).unwrap();
            let create = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            let buffer = host.device.allocate_command_buffers(&create).unwrap()[0];
            let fence = host.device.create_fence(&vk::FenceCreateInfo::default(), None).unwrap();
            host.device.begin_command_buffer(buffer, &vk::CommandBufferBeginInfo::default()).unwrap();
            Self { host, pool, buffer, fence }
        }
    }

    /// Submits under the host's lock; the work is waited for when this is dropped.
    pub fn submit(&self, wait: Option<Timeline>, signal: Option<Timeline>) {
        let info = |t: Timeline| {
            vk::SemaphoreSubmitInfo::default()
                .semaphore(vk::Semaphore::from_raw(t.semaphore))
                .value(t.value)
                .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        };
        let waits: Vec<_> = wait.into_iter().map(info).collect();
        let signals: Vec<_> = signal.into_iter().map(info).collect();
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(self.buffer)];
        let submit =
            vk::SubmitInfo2::default().wait_semaphore_infos(&waits).command_buffer_infos(&commands).signal_semaphore_infos(&signals);
        // SAFETY: recorded; the queue is locked.
        unsafe {
            self.host.device.end_command_buffer(self.buffer).unwrap();
            self.host.guard.lock();
            self.host.device.queue_submit2(self.host.queue, &[submit], self.fence).unwrap();
            self.host.guard.unlock();
        }
    }
}

impl Drop for Commands<'_> {
    fn drop(&mut self) {
        // SAFETY: waited for before it goes.
        unsafe {
            let _ = self.host.device.wait_for_fences(&[self.fence], true, u64::MAX);
            self.host.device.destroy_fence(self.fence, None);
            self.host.device.destroy_command_pool(self.pool, None);
        }
    }
}

/// A timeline.
pub struct Clock<'a> {
    host: &'a Host,
    semaphore: vk::Semaphore,
}

impl<'a> Clock<'a> {
    pub fn new(host: &'a Host) -> Self {
        let mut ty = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        // SAFETY: plain Vulkan.
        let semaphore = unsafe { host.device.create_semaphore(&vk::SemaphoreCreateInfo::default().push_next(&mut ty), None) };
        Self { host, semaphore: semaphore.unwrap() }
    }

    pub fn at(&self, value: u64) -> Option<Timeline> {
        Some(Timeline { semaphore: self.semaphore.as_raw(), value })
    }

    pub fn value(&self) -> u64 {
        // SAFETY: alive.
        unsafe { self.host.device.get_semaphore_counter_value(self.semaphore) }.unwrap()
    }

    /// Whether it comes to stand at `value`, in a moment: some drivers signal a fence before the semaphores of the same submission.
    pub fn reaches(&self, value: u64) -> bool {
        let (semaphores, values) = ([self.semaphore], [value]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: alive.
        unsafe { self.host.device.wait_semaphores(&info, 10_000_000_000) }.is_ok() && self.value() == value
    }

    /// Reached by the processor.
    pub fn set(&self, value: u64) {
        let info = vk::SemaphoreSignalInfo::default().semaphore(self.semaphore).value(value);
        // SAFETY: alive, and the value rises.
        unsafe { self.host.device.signal_semaphore(&info) }.unwrap();
    }
}

impl Drop for Clock<'_> {
    fn drop(&mut self) {
        // SAFETY: nobody waits for it any more.
        unsafe { self.host.device.destroy_semaphore(self.semaphore, None) };
    }
}
