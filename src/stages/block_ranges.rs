//! block_ranges: what [`occupancy::ranges`](super::occupancy::ranges) finds on the host, found on the device, for volumes that
//! the host memory never sees: smallest and largest sample of each block of 4³ voxels and one voxel around it, and over all.
//! That function is the twin.

use super::{occupancy, slab};
use crate::error::Result;
use crate::kernels::block_ranges as kernel;
use crate::kernels::constants::BLOCK;
use crate::vk::{Access, Buffer, Format, Image, Recorder};

/// Voxels per dispatch: tens of milliseconds on a CPU device.
const VOXELS: u64 = 1 << 22;

/// The format of the ranges over a volume's image of `volume`.
pub fn format(volume: Format) -> Format {
    if volume == Format::R32Sfloat { Format::Rg32Sfloat } else { Format::Rg16Unorm }
}

/// What is found over all samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Smallest and largest sample, as the image returns them.
    pub range: [f32; 2],
    /// Samples that are NaN or infinite; where there are any, the range means nothing.
    pub odd: u32,
}

impl Found {
    /// The words of the buffer before anything is found.
    pub const NOTHING: [u32; 3] = [u32::MAX, 0, 0];

    /// From the words of the buffer.
    pub fn of([least, most, odd]: [u32; 3]) -> Self {
        let value = |key: u32| f32::from_bits(key ^ if key >> 31 != 0 { 0x8000_0000 } else { u32::MAX });
        Self { range: [value(least), value(most)], odd }
    }
}

/// First slices of blocks of the dispatches over a volume, and how many slices each takes on.
pub fn slabs(volume: &Image) -> (impl Iterator<Item = u32>, u32) {
    let blocks = blocks(volume);
    let slices = slab(blocks, VOXELS / (BLOCK * BLOCK * BLOCK) as u64);
    ((0..blocks[2]).step_by(slices as usize), slices)
}

fn blocks(volume: &Image) -> [u32; 3] {
    occupancy::block_dims(volume.dims().map(|n| n as usize)).map(|n| n as u32)
}

/// Records one dispatch: `slices` slices of blocks from `first_slice` on, of `volume` into `bounds` ([`format`],
/// [`occupancy::block_dims`]) and `found` (3 words, begun with [`Found::NOTHING`]), both of which are announced for it here.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, volume: &Image, bounds: &Image, found: &Buffer, first_slice: u32, slices: u32) -> Result<()> {
    let [x, y, z] = blocks(volume);
    let slices = slices.min(z.saturating_sub(first_slice));
    // Fresh at first; then slabs do not overlap, levels are tracked whole.
    rec.barrier(&[
        bounds.mip(0).from(bounds.last_access(0)).to(Access::ComputeWrite),
        // Minima and maxima go on from the dispatch before.
        found.all().from(found.last_access()).to(Access::ComputeReadWrite),
    ]);
    rec.dispatch(
        &kernel::Bindings { volume: volume.sampled(), bounds: bounds.storage(0), found },
        &kernel::Spec::default(),
        &kernel::Params { first_slice, slices },
        [x, y, slices],
    )
}
