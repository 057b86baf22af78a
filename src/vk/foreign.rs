//! Images and buffers that the maker of the device lends: how they come, how they go back.

use super::access::Access;
use super::barrier::{buffer_barrier, image_barrier};
use super::host::{Features, HostBuffer, HostImage, QUEUE_FAMILY_IGNORED, Timeline};
use super::raw::Raw;
use super::{Buffer, Device, Format, Image};
use crate::error::{Error, Result};
use ash::vk::{self, Handle};
use std::sync::atomic::{AtomicBool, Ordering};

/// What is agreed about something lent. It is taken once and given back once.
pub(super) struct Foreign {
    layout: vk::ImageLayout,
    layout_after: vk::ImageLayout,
    /// The owner's queue family, if it is another than ours.
    family: Option<u32>,
    wait: Option<Timeline>,
    signal: Option<Timeline>,
    given_back: AtomicBool,
}

/// Semaphores of one submission.
#[derive(Default)]
pub(super) struct Semaphores {
    pub waits: Vec<Timeline>,
    pub signals: Vec<Timeline>,
}

impl Foreign {
    pub(super) fn given_back(&self) -> bool {
        self.given_back.load(Ordering::Acquire)
    }

    pub(super) fn note_given_back(&self) {
        self.given_back.store(true, Ordering::Release);
    }

    pub(super) fn semaphores(&self, to: Access, all: &mut Semaphores) {
        if to == Access::Foreign { all.signals.extend(self.signal) } else { all.waits.extend(self.wait) }
    }

    /// The barriers, in order, that take an image or give it back: one changes the owner and nothing else, one the layout. An
    /// image whose contents do not matter is simply taken.
    pub(super) fn of_image(&self, image: vk::Image, ours: u32, from: Access, to: Access) -> Vec<vk::ImageMemoryBarrier2<'static>> {
        let mut change = image_barrier(image, 0, 1, from.meaning(true), to.meaning(true));
        let mut owner = image_barrier(image, 0, 1, Access::Foreign.meaning(true), Access::Foreign.meaning(true));
        if to == Access::Foreign {
            change = change.new_layout(self.layout_after);
            owner = owner.old_layout(self.layout_after).new_layout(self.layout_after);
            let owner = self.family.map(|family| owner.src_queue_family_index(ours).dst_queue_family_index(family));
            return [Some(change), owner].into_iter().flatten().collect();
        }
        change = change.old_layout(self.layout);
        owner = owner.old_layout(self.layout).new_layout(self.layout);
        let family = self.family.filter(|_| self.layout != vk::ImageLayout::UNDEFINED);
        let owner = family.map(|family| owner.src_queue_family_index(family).dst_queue_family_index(ours));
        [owner, Some(change)].into_iter().flatten().collect()
    }

    /// As [`Foreign::of_image`]; a buffer has no layout.
    pub(super) fn of_buffer(&self, buffer: vk::Buffer, ours: u32, from: Access, to: Access) -> vk::BufferMemoryBarrier2<'static> {
        let barrier = buffer_barrier(buffer, from.meaning(false), to.meaning(false));
        match self.family {
            Some(family) if to == Access::Foreign => barrier.src_queue_family_index(ours).dst_queue_family_index(family),
            Some(family) => barrier.src_queue_family_index(family).dst_queue_family_index(ours),
            None => barrier,
        }
    }
}

fn invalid(item: &'static str, what: String, right: &str) -> Error {
    Error::Invalid { item, what, right: String::from(right) }
}

/// Nobody can lend to a device of the engine's own: a handle of another device would be followed into nowhere.
fn lendable(raw: &Raw, item: &'static str) -> Result<()> {
    if raw.owned {
        let what = String::from("is of another device than the engine, which has one of its own");
        return Err(invalid(item, what, "make the engine on the device that it belongs to"));
    }
    Ok(())
}

fn family(raw: &Raw, item: &'static str, family: u32) -> Result<Option<u32>> {
    if family == QUEUE_FAMILY_IGNORED || family == raw.family {
        return Ok(None);
    }
    // Families of other interfaces count from the top (VK_QUEUE_FAMILY_EXTERNAL and its kin).
    if family >= raw.families && family < vk::QUEUE_FAMILY_FOREIGN_EXT {
        return Err(invalid(item, format!("belongs to queue family {family}"), "name a family of this device, or QUEUE_FAMILY_IGNORED"));
    }
    Ok(Some(family))
}

fn semaphores(raw: &Raw, item: &'static str, wait: Option<Timeline>, signal: Option<Timeline>) -> Result<()> {
    let given: Vec<_> = wait.iter().chain(&signal).collect();
    if given.iter().any(|t| t.semaphore == 0) {
        return Err(invalid(item, String::from("comes with a null semaphore"), "give a timeline semaphore, or none"));
    }
    if !given.is_empty() && !raw.features.has(Features::TIMELINE_SEMAPHORE) {
        return Err(Error::DeviceLacks {
            device: raw.info.name.clone(),
            lacks: format!("timelineSemaphore, which the host has not enabled, but its {item} comes with semaphores"),
        });
    }
    if let (Some(wait), Some(signal)) = (wait, signal)
        && wait.semaphore == signal.semaphore
        && wait.value >= signal.value
    {
        let what = format!("waits for {} of a semaphore and signals {}", wait.value, signal.value);
        return Err(invalid(item, what, "a timeline rises: signal a greater value"));
    }
    Ok(())
}

impl Device {
    /// Takes an image of the host into the ledger, to be read or written by copies. It starts as [`Access::Foreign`].
    ///
    /// # Errors
    /// [`Error::Invalid`] for what cannot be: a device that is not the host's, a null handle, no texels, a format that is not one of `formats`, missing usage, a
    /// layout that has no contents to read or cannot be gone back to, a value that is not after the one waited for;
    /// [`Error::DeviceLacks`] for semaphores without the feature.
    pub fn borrow_image(&self, host: &HostImage, name: &str, formats: &[Format], write: bool) -> Result<Image> {
        const ITEM: &str = "host image";
        let (raw, parts) = (&self.0.raw, &host.parts);
        lendable(raw, ITEM)?;
        let image = vk::Image::from_raw(parts.image);
        if image.is_null() || parts.extent.contains(&0) {
            return Err(invalid(ITEM, String::from("is null or has no texels"), "hand over a VkImage and its extent"));
        }
        let Some(format) = Format::of_vulkan(parts.format).filter(|f| formats.contains(f)) else {
            let what = format!("is of VkFormat {} ({:?})", parts.format, vk::Format::from_raw(parts.format));
            let right = formats.iter().map(|f| format!("{:?}", vk::Format::from_raw(f.vulkan()))).collect::<Vec<_>>().join(", ");
            return Err(Error::Invalid { item: ITEM, what, right: format!("make it one of {right}") });
        };
        let (usage, usage_name) = if write {
            (vk::ImageUsageFlags::TRANSFER_DST, "VK_IMAGE_USAGE_TRANSFER_DST_BIT")
        } else {
            (vk::ImageUsageFlags::TRANSFER_SRC, "VK_IMAGE_USAGE_TRANSFER_SRC_BIT")
        };
        if !vk::ImageUsageFlags::from_raw(parts.usage).contains(usage) {
            return Err(invalid(ITEM, format!("was made without {usage_name}"), "make it with that usage"));
        }
        let layout = vk::ImageLayout::from_raw(parts.layout);
        if !write && layout == vk::ImageLayout::UNDEFINED {
            return Err(invalid(ITEM, String::from("is in layout UNDEFINED, which has no contents"), "name the layout that it is in"));
        }
        let layout_after = match (vk::ImageLayout::from_raw(parts.layout_after), layout) {
            (vk::ImageLayout::UNDEFINED, vk::ImageLayout::UNDEFINED | vk::ImageLayout::PREINITIALIZED) => vk::ImageLayout::GENERAL,
            (vk::ImageLayout::UNDEFINED, as_it_came) => as_it_came,
            (vk::ImageLayout::PREINITIALIZED, _) => {
                let what = String::from("is to go back to layout PREINITIALIZED, which nothing can go back to");
                return Err(invalid(ITEM, what, "name another layout"));
            }
            (wish, _) => wish,
        };
        semaphores(raw, ITEM, parts.wait, parts.signal)?;
        let foreign = Foreign {
            layout,
            layout_after,
            family: family(raw, ITEM, parts.queue_family)?,
            wait: parts.wait,
            signal: parts.signal,
            given_back: AtomicBool::new(false),
        };
        Ok(Image::lent(raw, image, name, parts.extent, format, foreign))
    }

    /// Takes a buffer of the host into the ledger, to be read by copies. It starts as [`Access::Foreign`].
    ///
    /// # Errors
    /// As [`Device::borrow_image`].
    pub fn borrow_buffer(&self, host: &HostBuffer, name: &str) -> Result<Buffer> {
        const ITEM: &str = "host buffer";
        let (raw, parts) = (&self.0.raw, &host.parts);
        lendable(raw, ITEM)?;
        let buffer = vk::Buffer::from_raw(parts.buffer);
        if buffer.is_null() || parts.size == 0 {
            return Err(invalid(ITEM, String::from("is null or empty"), "hand over a VkBuffer and its size"));
        }
        semaphores(raw, ITEM, parts.wait, parts.signal)?;
        let foreign = Foreign {
            layout: vk::ImageLayout::UNDEFINED,
            layout_after: vk::ImageLayout::UNDEFINED,
            family: family(raw, ITEM, parts.queue_family)?,
            wait: parts.wait,
            signal: parts.signal,
            given_back: AtomicBool::new(false),
        };
        Ok(Buffer::lent(raw, buffer, name, parts.size, foreign))
    }

    /// Gives a borrowed image back, whatever came between, and notes in `host` that it was.
    ///
    /// # Errors
    /// Failures of the driver; then it stays where it is.
    pub fn return_image(&self, image: &Image, host: &mut HostImage, write: bool) -> Result<()> {
        let Some(foreign) = &image.inner.foreign else { return Ok(()) };
        if !foreign.given_back() {
            let way = if write { Access::TransferWrite } else { Access::TransferRead };
            let mut rec = self.record()?;
            if image.last_access(0) == Access::Foreign {
                // Nobody has taken it: its owner waits for the signal all the same.
                rec.barrier(&[image.all().from(Access::Foreign).to(way)]);
            }
            // It is not touched any more.
            rec.barrier(&[image.all().from(way).to(Access::Foreign)]);
            rec.submit()?;
        }
        host.parts.layout = foreign.layout_after.as_raw();
        host.handed_back = true;
        Ok(())
    }

    /// As [`Device::return_image`].
    ///
    /// # Errors
    /// As there.
    pub fn return_buffer(&self, buffer: &Buffer, host: &mut HostBuffer) -> Result<()> {
        let Some(foreign) = &buffer.inner.foreign else { return Ok(()) };
        if !foreign.given_back() {
            let mut rec = self.record()?;
            if buffer.last_access() == Access::Foreign {
                // As for an image.
                rec.barrier(&[buffer.all().from(Access::Foreign).to(Access::TransferRead)]);
            }
            // It is not touched any more.
            rec.barrier(&[buffer.all().from(Access::TransferRead).to(Access::Foreign)]);
            rec.submit()?;
        }
        host.handed_back = true;
        Ok(())
    }
}

/// Refuses to treat something lent as our own.
pub(super) fn ours(foreign: Option<&Foreign>, name: &str) -> Result<()> {
    match foreign {
        None => Ok(()),
        Some(_) => Err(invalid("borrowed resource", format!("'{name}' is the host's"), "it can be copied by a recorder, nothing else")),
    }
}

/// A semaphore as a submission names it.
pub(super) fn submit_infos(all: &[Timeline]) -> Vec<vk::SemaphoreSubmitInfo<'static>> {
    let info = |t: &Timeline| {
        vk::SemaphoreSubmitInfo::default()
            .semaphore(vk::Semaphore::from_raw(t.semaphore))
            .value(t.value)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
    };
    all.iter().map(info).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use vk::ImageLayout as L;

    fn lent(family: Option<u32>, layout: L) -> Foreign {
        let given_back = AtomicBool::new(false);
        Foreign { layout, layout_after: L::PRESENT_SRC_KHR, family, wait: None, signal: None, given_back }
    }

    type Change = (L, L, u32, u32);

    fn changes(barriers: &[vk::ImageMemoryBarrier2<'_>]) -> Vec<Change> {
        barriers.iter().map(|b| (b.old_layout, b.new_layout, b.src_queue_family_index, b.dst_queue_family_index)).collect()
    }

    #[test]
    fn owner_and_layout_change_one_after_the_other() {
        const NONE: u32 = vk::QUEUE_FAMILY_IGNORED;
        let image = vk::Image::null();
        let (take, give) = ((Access::Foreign, Access::TransferWrite), (Access::TransferWrite, Access::Foreign));
        let of = |foreign: &Foreign, (from, to)| changes(&foreign.of_image(image, 2, from, to));
        let write = L::TRANSFER_DST_OPTIMAL;
        let other = lent(Some(5), L::GENERAL);
        assert_eq!(of(&other, take), [(L::GENERAL, L::GENERAL, 5, 2), (L::GENERAL, write, NONE, NONE)]);
        let back = [(write, L::PRESENT_SRC_KHR, NONE, NONE), (L::PRESENT_SRC_KHR, L::PRESENT_SRC_KHR, 2, 5)];
        assert_eq!(of(&other, give), back);
        // The same family, or a shared image: layouts only.
        let same = lent(None, L::GENERAL);
        assert_eq!(of(&same, take), [(L::GENERAL, write, NONE, NONE)]);
        assert_eq!(of(&same, give), back[..1]);
        // No contents, no owner to take them from; but one to give them to.
        let empty = lent(Some(5), L::UNDEFINED);
        assert_eq!(of(&empty, take), [(L::UNDEFINED, write, NONE, NONE)]);
        assert_eq!(of(&empty, give), back);
        let buffer = |from, to| {
            let b = other.of_buffer(vk::Buffer::null(), 2, from, to);
            (b.src_queue_family_index, b.dst_queue_family_index)
        };
        assert_eq!(buffer(Access::Foreign, Access::TransferRead), (5, 2));
        assert_eq!(buffer(Access::TransferRead, Access::Foreign), (2, 5));
    }

    type Barriers = Vec<vk::ImageMemoryBarrier2<'static>>;

    /// What the specification asks of the barriers between another family and ours (Vulkan 1.3, 7.7.4, and 7.3 of chains):
    /// the first rule that they break.
    fn broken(barriers: &[vk::ImageMemoryBarrier2<'_>], taking: bool) -> Option<&'static str> {
        use vk::AccessFlags2 as A;
        let (stages, memory) = (vk::PipelineStageFlags2::ALL_COMMANDS, A::MEMORY_READ | A::MEMORY_WRITE);
        let moves = |b: &vk::ImageMemoryBarrier2<'_>| b.src_queue_family_index != b.dst_queue_family_index;
        let [first, second] = barriers else { return Some("one barrier for the owner and one for the layout") };
        let (owner, layout) = if taking { (first, second) } else { (second, first) };
        if !moves(owner) || moves(layout) {
            return Some("the owner changes first when it is taken, and last when it is given");
        }
        if (owner.src_queue_family_index, owner.dst_queue_family_index) != (if taking { (5, 2) } else { (2, 5) }) {
            return Some("both halves name the same two families");
        }
        if owner.old_layout != owner.new_layout {
            return Some("both halves name the same layouts");
        }
        if first.new_layout != second.old_layout {
            return Some("each begins with the layout that the one before left");
        }
        // What the second waits for is what the first has done before.
        if !(first.dst_stage_mask.contains(second.src_stage_mask) && first.dst_access_mask.contains(second.src_access_mask)) {
            return Some("one goes on where the other ends");
        }
        let outer = if taking { (first.src_stage_mask, first.src_access_mask) } else { (second.dst_stage_mask, second.dst_access_mask) };
        if outer != (stages, memory) {
            return Some("whatever the host did is waited for, and whatever it does waits");
        }
        let inner = if taking { second.dst_access_mask } else { first.src_access_mask };
        (inner != A::TRANSFER_WRITE || second.image != first.image).then_some("the copy between them is ours")
    }

    #[test]
    fn barriers_to_and_from_another_family_keep_the_rules() {
        let image = vk::Image::from_raw(7);
        let other = lent(Some(5), L::GENERAL);
        for taking in [true, false] {
            let (from, to) = (Access::Foreign, Access::TransferWrite);
            let (from, to) = if taking { (from, to) } else { (to, from) };
            let right = other.of_image(image, 2, from, to);
            assert_eq!(broken(&right, taking), None);
            // Sabotage: every single thing that could be wrong is seen.
            let wrong = |change: &dyn Fn(&mut Barriers)| {
                let mut all = right.clone();
                change(&mut all);
                broken(&all, taking)
            };
            let owner = usize::from(!taking);
            let changes: [&dyn Fn(&mut Barriers); 9] = [
                &|b| b.swap(0, 1),
                &|b| b.truncate(1),
                &|b| b[owner].src_queue_family_index = 3,
                &|b| b[owner].dst_queue_family_index = vk::QUEUE_FAMILY_IGNORED,
                &|b| b[owner].new_layout = L::TRANSFER_SRC_OPTIMAL,
                &|b| b[1].old_layout = L::UNDEFINED,
                &|b| b[0].dst_stage_mask = vk::PipelineStageFlags2::COMPUTE_SHADER,
                &|b| b[0].dst_access_mask = vk::AccessFlags2::NONE,
                &|b| if taking { b[0].src_access_mask = vk::AccessFlags2::NONE } else { b[1].dst_access_mask = vk::AccessFlags2::NONE },
            ];
            for (i, change) in changes.into_iter().enumerate() {
                assert!(wrong(change).is_some(), "change {i}, taking {taking}");
            }
        }
        // A buffer: families, and everything waits for everything of the other side.
        let buffer = vk::Buffer::from_raw(9);
        let all = (vk::PipelineStageFlags2::ALL_COMMANDS, vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE);
        let take = other.of_buffer(buffer, 2, Access::Foreign, Access::TransferRead);
        assert_eq!((take.src_stage_mask, take.src_access_mask), all);
        assert_eq!(
            (take.buffer, take.offset, take.size, take.dst_access_mask),
            (buffer, 0, vk::WHOLE_SIZE, vk::AccessFlags2::TRANSFER_READ)
        );
        let give = other.of_buffer(buffer, 2, Access::TransferRead, Access::Foreign);
        assert_eq!((give.dst_stage_mask, give.dst_access_mask), all);
        let same = lent(None, L::UNDEFINED).of_buffer(buffer, 2, Access::Foreign, Access::TransferRead);
        assert_eq!((same.src_queue_family_index, same.dst_queue_family_index), (vk::QUEUE_FAMILY_IGNORED, vk::QUEUE_FAMILY_IGNORED));
    }
}
