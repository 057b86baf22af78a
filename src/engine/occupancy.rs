//! Occupancy: the blocks' ranges at upload, their distances to matter at every classification.

use super::{DeviceVolume, Engine, Medium, in_parts};
use crate::error::Result;
use crate::scene::Volume;
use crate::scene::transfer::Table;
use crate::stages::occupancy;
use crate::vk::{Format, Image, ImageDesc};

/// Where a medium holds matter, per block of 4³ voxels: what rays leap by.
pub struct Occupancy {
    pub(super) distances: Image,
    blocks: [usize; 3],
    bounds: Option<[[usize; 3]; 2]>,
    filled: Vec<bool>,
}

impl Occupancy {
    /// Blocks along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.blocks
    }

    /// The box around all blocks that hold matter, voxels: first, and one past the last, along each axis. `None` for a
    /// vacuum.
    pub fn bounds(&self) -> Option<[[usize; 3]; 2]> {
        self.bounds
    }

    /// Blocks that hold matter.
    pub fn occupied(&self) -> usize {
        self.filled.iter().filter(|f| **f).count()
    }

    /// Which blocks hold matter, x fastest.
    pub fn filled(&self) -> &[bool] {
        &self.filled
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        self.distances.bytes()
    }
}

impl Engine {
    /// Distance of each block of a medium to the nearest block that holds matter, in blocks (0: it does itself; 15: that
    /// far or further), x fastest: for tests and charts.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn read_occupancy(&self, medium: &Medium) -> Result<Vec<u8>> {
        self.device.read_image(&medium.occupancy.distances, 0)
    }

    pub(super) fn upload_ranges(&self, volume: &Volume) -> Result<Image> {
        let dims = occupancy::block_dims(volume.grid().dims()).map(|n| n as u32);
        let format = occupancy::format(volume.samples());
        let image = self.device.image3(&ImageDesc { name: "ranges of blocks", dims, levels: 1, format, views: &[], storage: false })?;
        let texels = occupancy::ranges(volume);
        let slice = dims[0] as usize * dims[1] as usize * format.bytes() as usize;
        self.device.write_image(&image, 0, &mut |first_z, bytes| {
            let start = first_z as usize * slice;
            bytes.copy_from_slice(&texels[start..start + bytes.len()]);
        })?;
        Ok(image)
    }

    pub(super) fn occupancy_of(
        &self,
        volume: &DeviceVolume,
        table: &Table,
        surface: bool,
        tell: &mut dyn FnMut(f64) -> Result<()>,
    ) -> Result<Occupancy> {
        let ranges = &volume.0.ranges;
        let desc = ImageDesc { name: "occupancy", dims: ranges.dims(), levels: 1, format: Format::R8Unorm, views: &[], storage: true };
        let (distances, scratch) = (self.device.image3(&desc)?, self.device.image3(&ImageDesc { name: "occupancy, pass", ..desc })?);
        let filled = self.device.buffer_from("filled entries", &occupancy::filled(table))?;
        let mut rec = self.device.record()?;
        let map = volume.0.encoding.table_map(table.lo, table.hi);
        occupancy::record(&mut rec, ranges, (&filled, map, surface), (&distances, &scratch), &mut in_parts(tell))?;
        rec.submit()?;
        let read = self.device.read_image(&distances, 0)?;
        let dims = volume.grid().dims();
        Ok(Occupancy {
            blocks: occupancy::block_dims(dims),
            bounds: occupancy::bounds(&read, dims),
            filled: read.iter().map(|&d| d == 0).collect(),
            distances,
        })
    }
}
