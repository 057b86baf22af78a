//! What one recording needs of the device: a command buffer, a fence, descriptor and query pools. Reused from one to the next.

use super::failed;
use super::foreign::{Semaphores, submit_infos};
use super::raw::Raw;
use crate::error::{Error, Result};
use ash::vk;
use std::sync::Arc;

/// Descriptor sets, and descriptors of each kind, of one pool.
const SETS: u32 = 64;
const DESCRIPTORS: u32 = 512;
/// Timestamps of one pool.
const QUERIES: u32 = 512;

pub(super) struct Slot {
    raw: Arc<Raw>,
    pool: vk::CommandPool,
    pub commands: vk::CommandBuffer,
    fence: vk::Fence,
    /// Submitted and not yet waited for.
    pending: bool,
    sets: Vec<vk::DescriptorPool>,
    /// Pools before this one are full.
    current: usize,
    queries: Vec<vk::QueryPool>,
    asked: u32,
}

impl Drop for Slot {
    fn drop(&mut self) {
        // SAFETY: pending work is waited for (on a lost device the wait fails at once, and destruction is allowed); then nothing
        // uses these objects any more. Nulls are allowed.
        unsafe {
            let device = &self.raw.device;
            if self.pending {
                let _ = device.wait_for_fences(&[self.fence], true, u64::MAX);
            }
            for pool in &self.sets {
                device.destroy_descriptor_pool(*pool, None);
            }
            for pool in &self.queries {
                device.destroy_query_pool(*pool, None);
            }
            device.destroy_fence(self.fence, None);
            device.destroy_command_pool(self.pool, None);
        }
    }
}

impl Slot {
    pub(super) fn new(raw: &Arc<Raw>) -> Result<Self> {
        let mut made = Self {
            raw: raw.clone(),
            pool: vk::CommandPool::null(),
            commands: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
            pending: false,
            sets: Vec::new(),
            current: 0,
            queries: Vec::new(),
            asked: 0,
        };
        let create = vk::CommandPoolCreateInfo::default().queue_family_index(raw.family).flags(vk::CommandPoolCreateFlags::TRANSIENT);
        // SAFETY: the device is alive and the structures point at living things; the same holds below.
        made.pool = unsafe { raw.device.create_command_pool(&create, None) }.map_err(failed("vkCreateCommandPool"))?;
        let create =
            vk::CommandBufferAllocateInfo::default().command_pool(made.pool).level(vk::CommandBufferLevel::PRIMARY).command_buffer_count(1);
        // SAFETY: see above.
        let buffers = unsafe { raw.device.allocate_command_buffers(&create) }.map_err(failed("vkAllocateCommandBuffers"))?;
        made.commands = buffers.first().copied().unwrap_or_default();
        // SAFETY: see above.
        made.fence = unsafe { raw.device.create_fence(&vk::FenceCreateInfo::default(), None) }.map_err(failed("vkCreateFence"))?;
        Ok(made)
    }

    /// Starts a new recording; what was recorded or submitted before is waited for and forgotten.
    pub(super) fn begin(&mut self) -> Result<()> {
        self.wait("an earlier submission")?;
        let device = &self.raw.device;
        // SAFETY: nothing of this slot is in use after the wait.
        unsafe {
            device.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty()).map_err(failed("vkResetCommandPool"))?;
            for pool in &self.sets {
                device.reset_descriptor_pool(*pool, vk::DescriptorPoolResetFlags::empty()).map_err(failed("vkResetDescriptorPool"))?;
            }
            let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
            device.begin_command_buffer(self.commands, &begin).map_err(failed("vkBeginCommandBuffer"))?;
        }
        self.current = 0;
        self.asked = 0;
        Ok(())
    }

    /// Ends the recording and hands it to the queue.
    pub(super) fn submit(&mut self, during: &str, semaphores: &Semaphores) -> Result<()> {
        let device = &self.raw.device;
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(self.commands)];
        let (waits, signals) = (submit_infos(&semaphores.waits), submit_infos(&semaphores.signals));
        let submit = vk::SubmitInfo2::default().command_buffer_infos(&commands);
        let submits = [submit.wait_semaphore_infos(&waits).signal_semaphore_infos(&signals)];
        // SAFETY: the command buffer is in recording.
        unsafe { device.end_command_buffer(self.commands) }.map_err(failed("vkEndCommandBuffer"))?;
        self.raw.submit(&submits, self.fence).map_err(|e| lost(during, "vkQueueSubmit2", e))?;
        self.pending = true;
        Ok(())
    }

    /// Waits until the submitted work is done.
    pub(super) fn wait(&mut self, during: &str) -> Result<()> {
        if self.pending {
            // SAFETY: the fence was submitted and belongs to this slot.
            unsafe {
                self.raw.device.wait_for_fences(&[self.fence], true, u64::MAX).map_err(|e| lost(during, "vkWaitForFences", e))?;
                self.raw.device.reset_fences(&[self.fence]).map_err(failed("vkResetFences"))?;
            }
            self.pending = false;
        }
        Ok(())
    }

    /// A fresh descriptor set; it lives until the next [`Slot::begin`].
    pub(super) fn descriptor_set(&mut self, layout: vk::DescriptorSetLayout) -> Result<vk::DescriptorSet> {
        loop {
            let fresh = self.current == self.sets.len();
            if fresh {
                self.sets.push(self.descriptor_pool()?);
            }
            let layouts = [layout];
            let wanted = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.sets[self.current]).set_layouts(&layouts);
            // SAFETY: pool and layout are alive, and nobody else uses this pool.
            match unsafe { self.raw.device.allocate_descriptor_sets(&wanted) } {
                Ok(sets) => return Ok(sets.first().copied().unwrap_or_default()),
                Err(vk::Result::ERROR_OUT_OF_POOL_MEMORY | vk::Result::ERROR_FRAGMENTED_POOL) if !fresh => self.current += 1,
                Err(e) => return Err(failed("vkAllocateDescriptorSets")(e)),
            }
        }
    }

    fn descriptor_pool(&self) -> Result<vk::DescriptorPool> {
        let sizes = [
            vk::DescriptorType::STORAGE_BUFFER,
            vk::DescriptorType::STORAGE_IMAGE,
            vk::DescriptorType::COMBINED_IMAGE_SAMPLER,
            vk::DescriptorType::UNIFORM_BUFFER,
        ]
        .map(|ty| vk::DescriptorPoolSize { ty, descriptor_count: DESCRIPTORS });
        let create = vk::DescriptorPoolCreateInfo::default().max_sets(SETS).pool_sizes(&sizes);
        // SAFETY: the structures live until the call returns.
        unsafe { self.raw.device.create_descriptor_pool(&create, None) }.map_err(failed("vkCreateDescriptorPool"))
    }

    /// Writes a timestamp when all dispatches recorded so far are done.
    pub(super) fn timestamp(&mut self) -> Result<()> {
        let (pool, query) = ((self.asked / QUERIES) as usize, self.asked % QUERIES);
        if pool == self.queries.len() {
            let create = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(QUERIES);
            // SAFETY: the structure points at nothing else.
            self.queries.push(unsafe { self.raw.device.create_query_pool(&create, None) }.map_err(failed("vkCreateQueryPool"))?);
        }
        // SAFETY: the command buffer is in recording; each query is reset before it is written, both in this recording.
        unsafe {
            if query == 0 {
                self.raw.device.cmd_reset_query_pool(self.commands, self.queries[pool], 0, QUERIES);
            }
            self.raw.device.cmd_write_timestamp2(self.commands, vk::PipelineStageFlags2::COMPUTE_SHADER, self.queries[pool], query);
        }
        self.asked += 1;
        Ok(())
    }

    /// The timestamps of the last recording, which was waited for.
    pub(super) fn timestamps(&self) -> Result<Vec<u64>> {
        let mut ticks = vec![0; self.asked as usize];
        for (pool, part) in self.queries.iter().zip(ticks.chunks_mut(QUERIES as usize)) {
            // SAFETY: these queries were written by work that is done.
            unsafe { self.raw.device.get_query_pool_results(*pool, 0, part, vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT) }
                .map_err(failed("vkGetQueryPoolResults"))?;
        }
        Ok(ticks)
    }
}

fn lost(during: &str, call: &'static str, result: vk::Result) -> Error {
    match result {
        vk::Result::ERROR_DEVICE_LOST => Error::DeviceLost { during: during.to_owned() },
        other => failed(call)(other),
    }
}
