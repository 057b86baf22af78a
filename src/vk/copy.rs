//! Copies on the device, recorded like dispatches and under the same ledger.

use super::access::Need;
use super::recorder::Kept;
use super::transfer_image::Piece;
use super::{Buffer, Image, Recorder};
use crate::error::{Error, Result};
use ash::vk;

/// Bytes of one buffer that go to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CopySpan {
    /// First byte of the source.
    pub from: u64,
    /// First byte of the target.
    pub to: u64,
    /// Bytes.
    pub bytes: u64,
}

impl Recorder {
    /// Copies parts of one buffer into another.
    ///
    /// # Errors
    /// [`Error::Hazard`] where a barrier is missing; [`Error::Invalid`] beyond the end of either.
    pub fn copy_buffer(&mut self, from: &Buffer, to: &Buffer, spans: &[CopySpan]) -> Result<()> {
        let inside = |start: u64, bytes: u64, buffer: &Buffer| start.checked_add(bytes).is_some_and(|end| end <= buffer.inner.bytes);
        if let Some(span) = spans.iter().find(|s| s.bytes == 0 || !inside(s.from, s.bytes, from) || !inside(s.to, s.bytes, to)) {
            return Err(Error::Invalid {
                item: "copy",
                what: format!("{span:?} of buffers of {} and {} bytes", from.inner.bytes, to.inner.bytes),
                right: String::from("copy what lies inside both"),
            });
        }
        self.enter_copy(&Kept::Buffer(from.inner.clone()), Need::CopyFrom, &Kept::Buffer(to.inner.clone()), Need::Fill)?;
        let regions: Vec<_> = spans.iter().map(|s| vk::BufferCopy { src_offset: s.from, dst_offset: s.to, size: s.bytes }).collect();
        let (device, commands) = self.commands();
        // SAFETY: the command buffer is in recording, the ranges lie inside both, which the ledger keeps alive.
        unsafe { device.cmd_copy_buffer(commands, from.inner.handle, to.inner.handle, &regions) };
        Ok(())
    }

    /// Copies a piece of an image to the beginning of a buffer, tightly packed, x fastest.
    ///
    /// # Errors
    /// [`Error::Hazard`] where a barrier is missing; [`Error::Invalid`] beyond the end of either.
    pub fn copy_image_to_buffer(&mut self, from: &Image, piece: &Piece, to: &Buffer) -> Result<()> {
        let region = piece.region(from, to)?;
        self.enter_copy(&Kept::Image(from.inner.clone(), 0), Need::CopyFrom, &Kept::Buffer(to.inner.clone()), Need::Fill)?;
        let (device, commands) = self.commands();
        let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
        // SAFETY: as above.
        unsafe { device.cmd_copy_image_to_buffer(commands, from.inner.handle, layout, to.inner.handle, &[region]) };
        Ok(())
    }

    /// Copies the beginning of a buffer, tightly packed, x fastest, to a piece of an image.
    ///
    /// # Errors
    /// [`Error::Hazard`] where a barrier is missing; [`Error::Invalid`] beyond the end of either.
    pub fn copy_buffer_to_image(&mut self, from: &Buffer, to: &Image, piece: &Piece) -> Result<()> {
        let region = piece.region(to, from)?;
        self.enter_copy(&Kept::Buffer(from.inner.clone()), Need::CopyFrom, &Kept::Image(to.inner.clone(), 0), Need::CopyTo)?;
        let (device, commands) = self.commands();
        let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        // SAFETY: as above.
        unsafe { device.cmd_copy_buffer_to_image(commands, from.inner.handle, to.inner.handle, layout, &[region]) };
        Ok(())
    }
}

impl Piece {
    /// The region of level 0, checked against image and buffer.
    fn region(&self, image: &Image, buffer: &Buffer) -> Result<vk::BufferImageCopy> {
        let [x, y, z] = image.dims();
        let ends = self.x > 0
            && self.x <= x
            && self.rows > 0
            && self.slices > 0
            && self.y.checked_add(self.rows).is_some_and(|end| end <= y)
            && self.z.checked_add(self.slices).is_some_and(|end| end <= z);
        let bytes = self.texels() * u64::from(image.format().bytes());
        if !ends || bytes > buffer.inner.bytes {
            return Err(Error::Invalid {
                item: "copy",
                what: format!("{self:?} of image '{}' and a buffer of {} bytes", image.name(), buffer.inner.bytes),
                right: format!("the image has {x}×{y}×{z} texels of {} bytes", image.format().bytes()),
            });
        }
        Ok(self.copy(0, 0))
    }
}
