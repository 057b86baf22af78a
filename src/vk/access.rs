//! Who touches a resource how: the one table from access to stage, mask and layout, and the ledger's rules.

use super::{Buffer, Image};
use ash::vk;

/// How a resource is used. Stage, access mask and image layout are functions of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Access {
    /// Not at all: contents undefined.
    None,
    /// Written by a kernel (`writeonly`).
    ComputeWrite,
    /// Read by a kernel: a `readonly` or uniform buffer, or an image through a sampler.
    ComputeRead,
    /// Read and written by a kernel. Also what a storage image needs that a kernel only loads from (`readonly image3D`).
    ComputeReadWrite,
    /// Source of a copy.
    TransferRead,
    /// Target of a copy.
    TransferWrite,
    /// Read by the host.
    HostRead,
    /// Written by the host.
    HostWrite,
    /// In the hands of its owner, who is not us: of an image or buffer that the maker of the device lends. A barrier from here
    /// takes it (and waits for the owner), a barrier to here gives it back (and tells the owner), once each.
    Foreign,
}

/// Stage, access mask and image layout.
#[derive(Clone, Copy)]
pub(super) struct Meaning {
    pub stage: vk::PipelineStageFlags2,
    pub mask: vk::AccessFlags2,
    pub layout: vk::ImageLayout,
}

impl Access {
    pub(super) fn meaning(self, of_image: bool) -> Meaning {
        use vk::{AccessFlags2 as A, ImageLayout as L, PipelineStageFlags2 as S};
        let (stage, mask, layout) = match self {
            Self::None => (S::NONE, A::NONE, L::UNDEFINED),
            Self::ComputeWrite => (S::COMPUTE_SHADER, A::SHADER_STORAGE_WRITE, L::GENERAL),
            Self::ComputeRead if of_image => (S::COMPUTE_SHADER, A::SHADER_SAMPLED_READ, L::SHADER_READ_ONLY_OPTIMAL),
            Self::ComputeRead => (S::COMPUTE_SHADER, A::SHADER_STORAGE_READ | A::UNIFORM_READ, L::UNDEFINED),
            Self::ComputeReadWrite => (S::COMPUTE_SHADER, A::SHADER_STORAGE_READ | A::SHADER_STORAGE_WRITE, L::GENERAL),
            Self::TransferRead => (S::ALL_TRANSFER, A::TRANSFER_READ, L::TRANSFER_SRC_OPTIMAL),
            Self::TransferWrite => (S::ALL_TRANSFER, A::TRANSFER_WRITE, L::TRANSFER_DST_OPTIMAL),
            Self::HostRead => (S::HOST, A::HOST_READ, L::GENERAL),
            Self::HostWrite => (S::HOST, A::HOST_WRITE, L::GENERAL),
            // Anything may have been done, or follow; the layout is the owner's.
            Self::Foreign => (S::ALL_COMMANDS, A::MEMORY_READ | A::MEMORY_WRITE, L::UNDEFINED),
        };
        Meaning { stage, mask, layout }
    }

    /// Whether the device may write.
    pub(super) fn writes(self) -> bool {
        matches!(self, Self::ComputeWrite | Self::ComputeReadWrite | Self::TransferWrite | Self::HostWrite)
    }
}

/// What a binding does with its resource, as far as hazards and layouts go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Need {
    /// `readonly` or uniform buffer.
    BufferRead,
    /// `writeonly` buffer.
    BufferWrite,
    /// Buffer that the kernel reads and writes.
    BufferReadWrite,
    /// Image through a sampler.
    Sample,
    /// `readonly` storage image.
    ImageLoad,
    /// `writeonly` storage image.
    ImageStore,
    /// Storage image that the kernel reads and writes.
    ImageLoadStore,
    /// Buffer set by a transfer.
    Fill,
    /// Source of a copy.
    CopyFrom,
    /// Image that a copy writes.
    CopyTo,
}

impl Need {
    fn writes(self) -> bool {
        !matches!(self, Self::BufferRead | Self::Sample | Self::ImageLoad | Self::CopyFrom)
    }

    /// The access that a barrier must have announced.
    pub(super) fn access(self) -> Access {
        match self {
            Self::BufferRead | Self::Sample => Access::ComputeRead,
            Self::BufferWrite | Self::ImageStore => Access::ComputeWrite,
            Self::BufferReadWrite | Self::ImageLoad | Self::ImageLoadStore => Access::ComputeReadWrite,
            Self::Fill | Self::CopyTo => Access::TransferWrite,
            Self::CopyFrom => Access::TransferRead,
        }
    }

    fn served_by(self, access: Access) -> bool {
        use Access::{ComputeRead, ComputeReadWrite, ComputeWrite};
        match self {
            Self::BufferRead => matches!(access, ComputeRead | ComputeReadWrite),
            Self::BufferWrite => matches!(access, ComputeWrite | ComputeReadWrite),
            Self::Sample => access == ComputeRead,
            Self::ImageStore => matches!(access, ComputeWrite | ComputeReadWrite),
            Self::BufferReadWrite | Self::ImageLoad | Self::ImageLoadStore => access == ComputeReadWrite,
            Self::Fill | Self::CopyTo => access == Access::TransferWrite,
            Self::CopyFrom => access == Access::TransferRead,
        }
    }
}

/// What happened since the last barrier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Used {
    No,
    Read,
    Written,
}

/// The ledger's entry of one buffer or image level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct State {
    pub access: Access,
    pub used: Used,
}

impl State {
    pub(super) const FRESH: Self = Self { access: Access::None, used: Used::No };

    /// Announced by a barrier, not yet used.
    pub(super) fn ready(access: Access) -> Self {
        Self { access, used: Used::No }
    }

    /// The state after a use, or nothing where a barrier is missing.
    pub(super) fn after(self, need: Need) -> Option<Self> {
        let free = if need.writes() { self.used == Used::No } else { self.used != Used::Written };
        // A buffer that nobody touched yet has no layout to change and nothing to wait for.
        let fresh = self.access == Access::None && matches!(need, Need::BufferWrite | Need::Fill);
        let access = if fresh { need.access() } else { self.access };
        (need.served_by(access) && free).then_some(Self { access, used: if need.writes() { Used::Written } else { Used::Read } })
    }

    /// Whether a recording that began in `self` and ended in `now` may still run after others left `found`. Reads in between
    /// matter only to one that writes.
    pub(super) fn still_holds(self, found: Self, now: Self) -> bool {
        let only_reads = now.access == self.access && now.used != Used::Written;
        found == self || (only_reads && found.access == self.access && found.used != Used::Written)
    }

    pub(super) fn describe(self) -> String {
        match self.used {
            Used::No => format!("{:?} (announced, unused)", self.access),
            Used::Read => format!("{:?} (read since)", self.access),
            Used::Written => format!("{:?} (written since)", self.access),
        }
    }
}

/// A buffer, or some levels of an image, as a barrier names it.
#[derive(Clone, Copy)]
pub struct Resource<'a> {
    pub(super) target: Target<'a>,
}

#[derive(Clone, Copy)]
pub(super) enum Target<'a> {
    Buffer(&'a Buffer),
    Image { image: &'a Image, base: u32, count: u32 },
}

/// A barrier whose far side is not said yet.
#[derive(Clone, Copy)]
pub struct Half<'a> {
    resource: Resource<'a>,
    from: Access,
}

/// What was done to a resource before, and what will be done after.
#[derive(Clone, Copy)]
pub struct Barrier<'a> {
    pub(super) resource: Resource<'a>,
    pub(super) from: Access,
    pub(super) to: Access,
}

impl<'a> Resource<'a> {
    /// The last access, which must be the one on record.
    pub fn from(self, access: Access) -> Half<'a> {
        Half { resource: self, from: access }
    }
}

impl Barrier<'_> {
    /// Whether it takes what is lent, or gives it back.
    pub(super) fn changes_hands(&self) -> bool {
        (self.from == Access::Foreign) != (self.to == Access::Foreign)
    }
}

impl<'a> Half<'a> {
    /// The access that comes next.
    pub fn to(self, access: Access) -> Barrier<'a> {
        Barrier { resource: self.resource, from: self.from, to: access }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use Access::{ComputeRead, ComputeReadWrite, ComputeWrite, TransferWrite};

    #[test]
    fn a_use_needs_its_announcement() {
        let served = |access, need| State::ready(access).after(need).is_some();
        for (need, right) in [
            (Need::BufferRead, &[ComputeRead, ComputeReadWrite][..]),
            (Need::BufferWrite, &[ComputeWrite, ComputeReadWrite, Access::None]),
            (Need::BufferReadWrite, &[ComputeReadWrite]),
            (Need::Sample, &[ComputeRead]),
            (Need::ImageLoad, &[ComputeReadWrite]),
            (Need::ImageStore, &[ComputeWrite, ComputeReadWrite]),
            (Need::ImageLoadStore, &[ComputeReadWrite]),
            (Need::Fill, &[TransferWrite, Access::None]),
            (Need::CopyFrom, &[Access::TransferRead]),
            (Need::CopyTo, &[TransferWrite]),
        ] {
            for access in [
                Access::None,
                ComputeWrite,
                ComputeRead,
                ComputeReadWrite,
                Access::TransferRead,
                TransferWrite,
                Access::HostRead,
                Access::HostWrite,
                Access::Foreign,
            ] {
                assert_eq!(served(access, need), right.contains(&access), "{need:?} after {access:?}");
            }
        }
    }

    #[test]
    fn reads_repeat_and_writes_do_not() {
        let read = State::ready(ComputeReadWrite).after(Need::BufferRead).unwrap();
        assert_eq!(read.after(Need::BufferRead), Some(read));
        assert_eq!(read.after(Need::BufferWrite), Option::None, "write after read");
        let written = State::ready(ComputeReadWrite).after(Need::BufferReadWrite).unwrap();
        assert_eq!(written.after(Need::BufferReadWrite), Option::None, "write after write");
        assert_eq!(written.after(Need::BufferRead), Option::None, "read after write");
    }

    #[test]
    fn a_recording_outlives_the_reads_of_others_only() {
        let before = State::ready(ComputeRead);
        let read = State { access: ComputeRead, used: Used::Read };
        let written = State { access: ComputeWrite, used: Used::Written };
        assert!(before.still_holds(before, written));
        assert!(before.still_holds(read, read));
        assert!(!before.still_holds(read, written));
        assert!(!before.still_holds(written, read));
    }
}
