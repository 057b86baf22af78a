//! Barriers: what they mean to Vulkan, and what they do to the ledger.

use super::access::{Meaning, State, Target};
use super::image::range;
use super::recorder::Kept;
use super::{Access, Barrier, Recorder};
use crate::error::Error;
use ash::vk;

impl Recorder {
    /// Makes what was done before visible to what comes next. A `from` that is not the last access on record is told as
    /// [`Error::Hazard`] by the next dispatch or by the submission.
    pub fn barrier(&mut self, barriers: &[Barrier<'_>]) {
        let mut buffers = Vec::new();
        let mut images = Vec::new();
        // Borrowed images change owner and layout one after the other.
        let mut second = Vec::new();
        let ours = self.device.0.raw.family;
        for barrier in barriers {
            if barrier.to == Access::None || (barrier.from == Access::Foreign && barrier.to == Access::Foreign) {
                self.wrong.get_or_insert_with(|| Error::Invalid {
                    item: "barrier",
                    what: String::from("leads to no access of ours"),
                    right: String::from("name the access that comes next"),
                });
                continue;
            }
            match barrier.resource.target {
                Target::Buffer(buffer) => {
                    self.pass(&Kept::Buffer(buffer.inner.clone()), barrier);
                    if let Some(foreign) = buffer.inner.foreign.as_ref().filter(|_| barrier.changes_hands()) {
                        buffers.push(foreign.of_buffer(buffer.inner.handle, ours, barrier.from, barrier.to));
                        continue;
                    }
                    buffers.push(buffer_barrier(buffer.inner.handle, barrier.from.meaning(false), barrier.to.meaning(false)));
                }
                Target::Image { image, base, count } => {
                    if base.saturating_add(count) > image.levels() {
                        self.wrong.get_or_insert_with(|| Error::Invalid {
                            item: "image level",
                            what: format!("a barrier names level {base} of image '{}'", image.name()),
                            right: format!("it has {} levels", image.levels()),
                        });
                        continue;
                    }
                    for level in base..base + count {
                        self.pass(&Kept::Image(image.inner.clone(), level), barrier);
                    }
                    if let Some(foreign) = image.inner.foreign.as_ref().filter(|_| barrier.changes_hands()) {
                        let mut both = foreign.of_image(image.inner.handle, ours, barrier.from, barrier.to).into_iter();
                        images.extend(both.next());
                        second.extend(both);
                        continue;
                    }
                    images.push(image_barrier(image.inner.handle, base, count, barrier.from.meaning(true), barrier.to.meaning(true)));
                }
            }
        }
        let first = vk::DependencyInfo::default().buffer_memory_barriers(&buffers).image_memory_barriers(&images);
        let then = vk::DependencyInfo::default().image_memory_barriers(&second);
        for info in [first].into_iter().chain((!second.is_empty()).then_some(then)) {
            // A recording with a wrong barrier is never submitted.
            if self.wrong.is_none() {
                // SAFETY: the command buffer is in recording; the resources are kept alive by the ledger.
                unsafe { self.device.0.raw.device.cmd_pipeline_barrier2(self.slot.commands, &info) };
            }
        }
    }

    /// A barrier passes over one resource.
    fn pass(&mut self, kept: &Kept, barrier: &Barrier<'_>) {
        if let Err(error) = self.made_here("barrier", kept) {
            self.wrong.get_or_insert(error);
            return;
        }
        self.change_hands(kept, barrier);
        let entry = self.entry(kept);
        let had = entry.now;
        entry.now = State::ready(barrier.to);
        if had.access != barrier.from {
            self.wrong.get_or_insert_with(|| Error::Hazard {
                kernel: "barrier",
                binding: "from",
                had: format!("{} of {}", had.describe(), kept.describe()),
                needs: format!("{:?}, as this barrier says", barrier.from),
            });
        }
    }

    /// What is lent is taken once and given back once, and nothing else is.
    fn change_hands(&mut self, kept: &Kept, barrier: &Barrier<'_>) {
        if !barrier.changes_hands() {
            return;
        }
        let known = self.ledger.get(&kept.key()).is_some_and(|e| e.given_back);
        match kept.foreign() {
            Some(foreign) if !known && !foreign.given_back() => {
                foreign.semaphores(barrier.to, &mut self.semaphores);
                self.entry(kept).given_back = barrier.to == Access::Foreign;
            }
            lent => {
                let what = if lent.is_some() { "has been given back" } else { "is not borrowed" };
                self.wrong.get_or_insert_with(|| Error::Invalid {
                    item: "barrier",
                    what: format!("{} {what}", kept.describe()),
                    right: String::from("take what is lent once, and give it back once"),
                });
            }
        }
    }
}

pub(super) fn buffer_barrier(handle: vk::Buffer, from: Meaning, to: Meaning) -> vk::BufferMemoryBarrier2<'static> {
    vk::BufferMemoryBarrier2::default()
        .src_stage_mask(from.stage)
        .src_access_mask(from.mask)
        .dst_stage_mask(to.stage)
        .dst_access_mask(to.mask)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .buffer(handle)
        .size(vk::WHOLE_SIZE)
}

pub(super) fn image_barrier(handle: vk::Image, base: u32, count: u32, from: Meaning, to: Meaning) -> vk::ImageMemoryBarrier2<'static> {
    vk::ImageMemoryBarrier2::default()
        .src_stage_mask(from.stage)
        .src_access_mask(from.mask)
        .dst_stage_mask(to.stage)
        .dst_access_mask(to.mask)
        .old_layout(from.layout)
        .new_layout(to.layout)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .image(handle)
        .subresource_range(range(base, count))
}
