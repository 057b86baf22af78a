//! The host's own Vulkan: its device under the engine, its images and buffers as volumes, its image as the picture. Nothing
//! crosses through host memory.

use super::{DeviceVolume, Engine, Lit, Medium, Progress, VolumeData};
use crate::error::{Error, Result};
use crate::scene::{Camera, Grid, ImageSettings};
use crate::stages::block_ranges::{self, Found};
use crate::stages::resolve::Form;
use crate::stages::{occupancy, widen};
use crate::vk::{self, Access, Buffer, CopySpan, Format, Image, ImageDesc, Piece};
use std::sync::Arc;

pub use crate::stages::widen::SampleType;

pub use crate::vk::host::{
    FeatureNeed, Features, FormatNeed, GetInstanceProcAddr, HostBuffer, HostBufferParts, HostDevice, HostDeviceParts, HostImage,
    HostImageParts, HostQueue, QUEUE_FAMILY_IGNORED, QueueCallback, QueueLock, Requirements, Timeline, lacking,
};

/// The formats that the kernels cannot do without; the others depend on the settings of the field.
const FORMATS: [FormatNeed; 5] = [
    FormatNeed::filtered(Format::R16Unorm),
    FormatNeed::filtered(Format::R32Sfloat),
    FormatNeed::stored_and_filtered(Format::R16Sfloat),
    FormatNeed::stored_and_filtered(Format::Rg16Sfloat),
    FormatNeed::stored_and_filtered(Format::Rgba16Sfloat),
];

/// What the engine needs of a device, for a host that has yet to make one; [`lacking`] asks a physical device.
pub const fn requirements() -> Requirements {
    Requirements::with_formats(&FORMATS)
}

/// Bytes of the largest piece of a volume that is copied at once.
const PIECE: u64 = 16 << 20;

/// Where a volume's samples come from.
enum Source<'a> {
    Image(&'a Image),
    Buffer(&'a Buffer, &'a HostBufferParts),
}

impl Engine {
    /// Works on the host's own device.
    ///
    /// # Errors
    /// [`Error::DeviceLacks`] naming what the device lacks or the host has not enabled; [`Error::Invalid`] for what cannot be, and
    /// for [`Options::device`](super::Options::device), `validation` and `threads`, which are the host's business.
    pub fn on_host(host: &HostDevice, options: &super::Options) -> Result<Self> {
        Self::on(vk::Device::import(host, options)?)
    }

    /// The queue family that the engine works on: a host releases its images to it, where it uses another family.
    pub fn queue_family(&self) -> u32 {
        self.device.queue_family()
    }

    /// Copies a volume from a 3-D image of the host (`R8_UNORM`, `R8_UINT`, `R8_SINT`, `R16_UNORM`, `R16_UINT`, `R16_SINT`,
    /// `R16_SFLOAT` or `R32_SFLOAT`) on the device. Samples count as the stored integers or floats, and value = slope·sample +
    /// intercept with `rescale` = (slope, intercept), as for a [`Volume`](crate::scene::Volume) of these samples: pictures are the
    /// same bit for bit. When the call returns, the image has been handed back.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an extent that is not `grid`'s, another format, missing usage, or samples that are not finite;
    /// [`Error::OutOfMemory`].
    pub fn upload_image(&self, image: &mut HostImage, grid: &Grid, rescale: (f32, f32)) -> Result<DeviceVolume> {
        let borrowed = self.device.borrow_image(image, "host image", &widen::FORMATS.map(|(format, _)| format), false)?;
        let samples = SampleType::of(borrowed.format()).unwrap_or(SampleType::F32);
        let dims = grid.dims().map(|n| n as u32);
        if borrowed.dims() != dims {
            return Err(Error::Invalid {
                item: "host image",
                what: format!("has {:?} texels", borrowed.dims()),
                right: format!("the grid has {dims:?} voxels"),
            });
        }
        let prepared = self.prepare(samples, grid, rescale)?;
        let done = self.bring(prepared, &Source::Image(&borrowed));
        let back = self.device.return_image(&borrowed, image, false);
        done.and_then(|volume| back.map(|()| volume))
    }

    /// As [`Engine::upload_image`], from a buffer of samples, x fastest.
    ///
    /// # Errors
    /// As there; [`Error::Invalid`] for a buffer that is too short.
    pub fn upload_buffer(&self, buffer: &mut HostBuffer, samples: SampleType, grid: &Grid, rescale: (f32, f32)) -> Result<DeviceVolume> {
        let parts = *buffer.parts();
        let [x, y, z] = grid.dims().map(|n| n as u64);
        let row = x * u64::from(samples.bytes());
        let parts = HostBufferParts { row_bytes: if parts.row_bytes == 0 { row } else { parts.row_bytes }, ..parts };
        let slice = (y - 1).saturating_mul(parts.row_bytes).saturating_add(row);
        let tight = y.saturating_mul(parts.row_bytes);
        let parts = HostBufferParts { slice_bytes: if parts.slice_bytes == 0 { tight } else { parts.slice_bytes }, ..parts };
        let needs = (z - 1).saturating_mul(parts.slice_bytes).saturating_add(slice).saturating_add(parts.offset);
        if parts.row_bytes < row || parts.slice_bytes < slice || needs > parts.size {
            return Err(Error::Invalid {
                item: "host buffer",
                what: format!(
                    "has {} bytes, samples from byte {} on, rows {} and slices {} bytes apart",
                    parts.size, parts.offset, parts.row_bytes, parts.slice_bytes
                ),
                right: format!("{x}x{y}x{z} voxels of {} bytes need rows of {row}, slices of {slice} and {needs} in all", samples.bytes()),
            });
        }
        let borrowed = self.device.borrow_buffer(buffer, "host buffer")?;
        let prepared = self.prepare(samples, grid, rescale)?;
        let done = self.bring(prepared, &Source::Buffer(&borrowed, &parts));
        let back = self.device.return_buffer(&borrowed, buffer);
        done.and_then(|volume| back.map(|()| volume))
    }

    /// The smallest and largest sample of each block of a volume, as its image holds them: for tests.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn read_ranges(&self, volume: &DeviceVolume) -> Result<Vec<u8>> {
        self.device.read_image(&volume.0.ranges, 0)
    }

    /// Renders into an image of the host (`R32G32B32A32_SFLOAT` or `R16G16B16A16_SFLOAT`): premultiplied linear RGBA, row 0 on
    /// top, the pixels that [`Engine::render`] returns, rounded to the image's format. Only the `width`×`height` pixels from the
    /// corner are written. Whatever the outcome, also after a cancel, the image is handed back, unless the arguments are refused:
    /// [`HostImage::handed_back`] tells.
    ///
    /// # Errors
    /// As [`Engine::render`]; [`Error::Invalid`] for an image that is smaller than the picture, of another format or usage.
    pub fn render_to(
        &self,
        medium: &Medium,
        lit: &Lit,
        camera: &Camera,
        image: &ImageSettings,
        target: &mut HostImage,
        progress: &mut Progress,
    ) -> Result<()> {
        let borrowed = self.device.borrow_image(target, "host image", &Form::FORMATS.map(|(format, _)| format), true)?;
        let [w, h, _] = borrowed.dims().map(|n| n as usize);
        if image.width > w || image.height > h {
            return Err(Error::Invalid {
                item: "host image",
                what: format!("has {w}x{h} pixels"),
                right: format!("the picture has {}x{}", image.width, image.height),
            });
        }
        let half = Form::FORMATS.contains(&(borrowed.format(), true));
        let shot = self.shot(medium, lit, camera, image, half)?;
        let mut first = true;
        let done = self.strips(&shot, progress, &mut |strip| {
            let mut rec = self.device.record()?;
            // The host's image is taken with the first strip; strips do not overlap, images are tracked whole.
            let had = if first { Access::Foreign } else { Access::TransferWrite };
            rec.barrier(&[
                borrowed.all().from(had).to(Access::TransferWrite),
                // The pixels are copied as the kernel has left them.
                strip.pixels.all().from(Access::ComputeWrite).to(Access::TransferRead),
            ]);
            let piece = Piece { x: image.width as u32, y: strip.first_row, z: 0, rows: strip.rows, slices: 1 };
            rec.copy_buffer_to_image(strip.pixels, &borrowed, &piece)?;
            first = false;
            rec.submit()
        });
        let back = self.device.return_image(&borrowed, target, true);
        done.and(back)
    }

    /// Refuses what cannot be brought, and makes room for the rest.
    fn prepare(&self, samples: SampleType, grid: &Grid, rescale: (f32, f32)) -> Result<Prepared> {
        let (slope, intercept) = rescale;
        if !slope.is_finite() || !intercept.is_finite() || slope == 0.0 {
            return Err(Error::Invalid {
                item: "volume slope and intercept",
                what: format!("slope {slope}, intercept {intercept}"),
                right: "both must be finite and the slope not 0".into(),
            });
        }
        let dims = grid.dims().map(|n| n as u32);
        let format = samples.format();
        let blocks = occupancy::block_dims(grid.dims()).map(|n| n as u32);
        let bounds = block_ranges::format(format);
        let pieces = Piece::cut(dims, PIECE / u64::from(format.bytes()));
        let largest = pieces.iter().map(Piece::texels).max().unwrap_or(0);
        let (narrow, wide) = samples.buffers(largest);
        let bytes = |dims, format: Format| self.padding().image(dims, format.bytes().into());
        let needs = bytes(dims, format) + bytes(blocks, bounds) + narrow + wide;
        let what = format!("the volume of {}x{}x{} voxels ({} bits each on the device)", dims[0], dims[1], dims[2], 8 * format.bytes());
        self.ask(&what, needs, |_| "hand over a smaller volume or allow more memory".into())?;
        let desc = ImageDesc { name: "volume", dims, levels: 1, format, views: &[], storage: false };
        Ok(Prepared {
            samples,
            grid: *grid,
            rescale,
            image: self.device.image3(&desc)?,
            ranges: self.device.image3(&ImageDesc { name: "ranges of blocks", dims: blocks, format: bounds, storage: true, ..desc })?,
            narrow: self.device.buffer::<u8>("samples", narrow as usize)?,
            wide: if samples.widens() { Some(self.device.buffer::<u8>("wide samples", wide as usize)?) } else { None },
            found: self.device.buffer_from("found", &Found::NOTHING)?,
            pieces,
        })
    }

    /// Copies piece by piece, then finds the ranges.
    fn bring(&self, to: Prepared, source: &Source) -> Result<DeviceVolume> {
        let last = to.pieces.len().saturating_sub(1);
        for (i, piece) in to.pieces.iter().enumerate() {
            let mut rec = self.device.record()?;
            let lent = match source {
                Source::Image(image) => image.all(),
                Source::Buffer(buffer, _) => buffer.all(),
            };
            if i == 0 {
                // The host's is taken; a fresh image takes the layout for copies.
                rec.barrier(&[
                    lent.from(Access::Foreign).to(Access::TransferRead),
                    to.image.all().from(Access::None).to(Access::TransferWrite),
                ]);
            } else {
                // Pieces do not overlap, images are tracked whole; the buffer held the piece before.
                rec.barrier(&[
                    to.image.all().from(Access::TransferWrite).to(Access::TransferWrite),
                    to.narrow.all().from(to.narrow.last_access()).to(Access::TransferWrite),
                ]);
            }
            match source {
                Source::Image(image) => rec.copy_image_to_buffer(image, piece, &to.narrow)?,
                Source::Buffer(buffer, parts) => rec.copy_buffer(buffer, &to.narrow, &spans(piece, to.samples, parts))?,
            }
            if let Some(wide) = &to.wide {
                // The kernel reads what was copied; the wide samples of the piece before have been copied on.
                rec.barrier(&[to.narrow.all().from(Access::TransferWrite).to(Access::ComputeRead)]);
                if i > 0 {
                    rec.barrier(&[wide.all().from(Access::TransferRead).to(Access::ComputeWrite)]);
                }
                widen::record(&mut rec, to.samples, &to.narrow, wide, piece.texels())?;
                // And its samples are copied.
                rec.barrier(&[wide.all().from(Access::ComputeWrite).to(Access::TransferRead)]);
                rec.copy_buffer_to_image(wide, &to.image, piece)?;
            } else {
                // What was copied is copied on.
                rec.barrier(&[to.narrow.all().from(Access::TransferWrite).to(Access::TransferRead)]);
                rec.copy_buffer_to_image(&to.narrow, &to.image, piece)?;
            }
            if i == last {
                // The host may have it back; kernels sample the copy.
                rec.barrier(&[
                    lent.from(Access::TransferRead).to(Access::Foreign),
                    to.image.all().from(Access::TransferWrite).to(Access::ComputeRead),
                ]);
            }
            rec.submit()?;
        }
        self.finish(to)
    }

    fn finish(&self, to: Prepared) -> Result<DeviceVolume> {
        let (slabs, slices) = block_ranges::slabs(&to.image);
        for first_slice in slabs {
            let mut rec = self.device.record()?;
            block_ranges::record(&mut rec, &to.image, &to.ranges, &to.found, first_slice, slices)?;
            rec.submit()?;
        }
        let mut rec = self.device.record()?;
        // The occupancy samples them at every classification.
        rec.barrier(&[to.ranges.all().from(Access::ComputeWrite).to(Access::ComputeRead)]);
        rec.submit()?;
        let words = self.device.read::<u32>(&to.found, 3)?;
        let found = Found::of(std::array::from_fn(|i| words.get(i).copied().unwrap_or(0)));
        if found.odd > 0 {
            return Err(Error::Invalid {
                item: "volume samples",
                what: format!("{} of them are NaN or infinite", found.odd),
                right: "all must be finite".into(),
            });
        }
        let (slope, intercept) = to.rescale;
        let [a, b] = found.range.map(|x| slope * to.samples.stored(x) + intercept);
        Ok(DeviceVolume(Arc::new(VolumeData {
            grid: to.grid,
            range: [a.min(b), a.max(b)],
            samples: to.samples,
            stored: to.samples,
            rescale: to.rescale,
            encoding: to.samples.encoding(to.rescale),
            image: to.image,
            ranges: to.ranges,
        })))
    }
}

/// What a volume of the host's is copied to and through.
struct Prepared {
    samples: SampleType,
    grid: Grid,
    rescale: (f32, f32),
    image: Image,
    ranges: Image,
    narrow: Buffer,
    /// Where samples have to be widened.
    wide: Option<Buffer>,
    found: Buffer,
    pieces: Vec<Piece>,
}

/// Where the rows of a piece stand in a host's buffer; what follows without a gap is one span.
fn spans(piece: &Piece, samples: SampleType, parts: &HostBufferParts) -> Vec<CopySpan> {
    let row = u64::from(piece.x) * u64::from(samples.bytes());
    let mut spans: Vec<CopySpan> = Vec::new();
    let mut to = 0;
    for z in piece.z..piece.z + piece.slices {
        for y in piece.y..piece.y + piece.rows {
            let from = parts.offset + u64::from(z) * parts.slice_bytes + u64::from(y) * parts.row_bytes;
            match spans.last_mut() {
                Some(s) if s.from + s.bytes == from => s.bytes += row,
                _ => spans.push(CopySpan { from, to, bytes: row }),
            }
            to += row;
        }
    }
    spans
}
