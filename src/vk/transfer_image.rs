//! Texels in and out, in pieces of one staging half.

use super::access::{Access, State};
use super::barrier::{buffer_barrier, image_barrier};
use super::foreign::ours;
use super::image::ImageInner;
use super::staging::{HALF, ring};
use super::transfer::{pipeline_barrier, written};
use super::{Device, Image, lock};
use crate::error::{Error, Result};
use crate::room::zeroed;
use ash::vk;

impl Device {
    /// Fills one level of an image, which kernels may then sample. `fill` gets the first slice and the bytes of some whole slices,
    /// tightly packed, x fastest, in ascending order; it must write all of them and must not use the device.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a level that is not there; failures of the driver.
    pub fn write_image(&self, image: &Image, level: u32, fill: &mut dyn FnMut(u32, &mut [u8])) -> Result<()> {
        let walk = Walk::new(image, level)?;
        let inner = &image.inner;
        let raw = &self.0.raw;
        let _turn = self.turn(&inner.raw, &inner.name)?;
        let state = *lock(&inner.states[level as usize]);
        let mut staging = lock(&self.0.staging);
        let mut ring = ring(&mut staging.up, raw, "staging up", true)?;
        // A slice that does not fit a half is filled aside and copied by rows.
        let mut aside = if walk.slice > HALF { zeroed::<u8>("a slice", walk.slice)? } else { Vec::new() };
        let parts = walk.parts();
        let last = parts.len().saturating_sub(1);
        for (i, part) in parts.iter().enumerate() {
            let (offset, commands) = ring.begin()?;
            if i == 0 {
                let barrier = image_barrier(inner.handle, level, 1, state.access.meaning(true), Access::TransferWrite.meaning(true));
                pipeline_barrier(raw, commands, &[], &[barrier]);
            }
            // SAFETY: the region lies inside the level and the half; both outlive the wait below.
            unsafe {
                let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
                let region = [part.copy(level, offset)];
                raw.device.cmd_copy_buffer_to_image(commands, ring.buffer.handle, inner.handle, layout, &region);
            }
            if i == last {
                let barrier = image_barrier(inner.handle, level, 1, Access::TransferWrite.meaning(true), Access::ComputeRead.meaning(true));
                pipeline_barrier(raw, commands, &[], &[barrier]);
            }
            let len = walk.bytes(part);
            if aside.is_empty() {
                fill(part.z, ring.bytes(offset, len));
            } else {
                if part.y == 0 {
                    fill(part.z, &mut aside);
                }
                let start = part.y as usize * walk.row;
                ring.bytes(offset, len).copy_from_slice(&aside[start..start + len]);
            }
            ring.submit(offset)?;
        }
        ring.wait()?;
        *lock(&inner.states[level as usize]) = State::ready(Access::ComputeRead);
        Ok(())
    }

    /// The texels of one level, tightly packed, x fastest; kernels may then sample it.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a level that is not there; [`Error::Hazard`] if nobody ever wrote it; failures of the driver.
    pub fn read_image(&self, image: &Image, level: u32) -> Result<Vec<u8>> {
        let walk = Walk::new(image, level)?;
        let inner = &image.inner;
        let raw = &self.0.raw;
        let _turn = self.turn(&inner.raw, &inner.name)?;
        let state = *lock(&inner.states[level as usize]);
        written(state, &inner.name)?;
        let mut data = zeroed::<u8>("a copy", walk.slice * walk.dims[2] as usize)?;
        let mut staging = lock(&self.0.staging);
        let mut ring = ring(&mut staging.down, raw, "staging down", false)?;
        let parts = walk.parts();
        let last = parts.len().saturating_sub(1);
        let mut rest = &mut data[..];
        // The part before, which the host copies while the device copies this one.
        let mut before: Option<(usize, &mut [u8])> = None;
        for (i, part) in parts.iter().enumerate() {
            let (offset, commands) = ring.begin()?;
            if i == 0 {
                let barrier = image_barrier(inner.handle, level, 1, state.access.meaning(true), Access::TransferRead.meaning(true));
                pipeline_barrier(raw, commands, &[], &[barrier]);
            }
            // SAFETY: the region lies inside the level and the half; both outlive the wait below.
            unsafe {
                let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
                let region = [part.copy(level, offset)];
                raw.device.cmd_copy_image_to_buffer(commands, inner.handle, layout, ring.buffer.handle, &region);
            }
            let host = buffer_barrier(ring.buffer.handle, Access::TransferWrite.meaning(false), Access::HostRead.meaning(false));
            let back = image_barrier(inner.handle, level, 1, Access::TransferRead.meaning(true), Access::ComputeRead.meaning(true));
            pipeline_barrier(raw, commands, &[host], if i == last { std::slice::from_ref(&back) } else { &[] });
            ring.submit(offset)?;
            // Parts stand one after another.
            let out;
            (out, rest) = rest.split_at_mut(walk.bytes(part));
            if let Some((offset, out)) = before.replace((offset, out)) {
                ring.take(offset, out)?;
            }
        }
        before.map_or(Ok(()), |(offset, out)| ring.take(offset, out))?;
        *lock(&inner.states[level as usize]) = State::ready(Access::ComputeRead);
        Ok(data)
    }
}

/// How a level is cut into pieces of one staging half.
struct Walk {
    dims: [u32; 3],
    /// Bytes of a texel, a row and a slice.
    texel: usize,
    row: usize,
    slice: usize,
}

/// Whole slices, or rows of one slice, of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Piece {
    /// Texels of each row, from the first on.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// First slice.
    pub z: u32,
    /// Rows.
    pub rows: u32,
    /// Slices.
    pub slices: u32,
}

impl Piece {
    /// Cuts `dims` texels into pieces of at most `texels`, or of one row where that is more.
    pub fn cut(dims: [u32; 3], texels: u64) -> Vec<Self> {
        let [x, height, depth] = dims;
        let slice = u64::from(x) * u64::from(height);
        let step = |unit: u64, most: u32| (texels / unit.max(1)).clamp(1, u64::from(most.max(1))) as u32;
        if slice <= texels {
            let step = step(slice, depth);
            return (0..depth).step_by(step as usize).map(|z| Self { x, y: 0, z, rows: height, slices: step.min(depth - z) }).collect();
        }
        let step = step(u64::from(x), height);
        (0..depth)
            .flat_map(|z| (0..height).step_by(step as usize).map(move |y| Self { x, y, z, rows: step.min(height - y), slices: 1 }))
            .collect()
    }

    /// Texels.
    pub fn texels(&self) -> u64 {
        u64::from(self.x) * u64::from(self.rows) * u64::from(self.slices)
    }

    /// The copy between a level and a buffer from `offset` on.
    pub(super) fn copy(&self, level: u32, offset: usize) -> vk::BufferImageCopy {
        vk::BufferImageCopy {
            buffer_offset: offset as u64,
            buffer_row_length: 0,
            buffer_image_height: 0,
            image_subresource: vk::ImageSubresourceLayers {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                mip_level: level,
                base_array_layer: 0,
                layer_count: 1,
            },
            // An image edge has 2^31 texels at most.
            image_offset: vk::Offset3D { x: 0, y: self.y as i32, z: self.z as i32 },
            image_extent: vk::Extent3D { width: self.x, height: self.rows, depth: self.slices },
        }
    }
}

impl Walk {
    fn new(image: &Image, level: u32) -> Result<Self> {
        let inner: &ImageInner = &image.inner;
        ours(inner.foreign.as_ref(), &inner.name)?;
        if level >= image.levels() {
            return Err(Error::Invalid {
                item: "image level",
                what: format!("'{}' has no level {level}", inner.name),
                right: format!("it has {} levels", image.levels()),
            });
        }
        let dims = inner.level_dims(level);
        let texel = inner.format.bytes() as usize;
        let row = dims[0] as usize * texel;
        Ok(Self { dims, texel, row, slice: row * dims[1] as usize })
    }

    fn parts(&self) -> Vec<Piece> {
        Piece::cut(self.dims, (HALF / self.texel) as u64)
    }

    fn bytes(&self, part: &Piece) -> usize {
        self.row * part.rows as usize * part.slices as usize
    }
}
