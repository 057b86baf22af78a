//! The host's own Vulkan: its device under the engine, its images and buffers as volumes, its image as the picture. Nothing
//! crosses through host memory.

use super::{DeviceVolume, Engine, Lit, Medium, Progress};
use crate::error::{Error, Result};
use crate::scene::{Camera, Grid, ImageSettings};
use crate::vk::{self, Format};

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

/// Types of a sample in a host's buffer, little-endian as the device reads them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleType {
    /// 8-bit unsigned.
    U8,
    /// 8-bit signed.
    I8,
    /// 16-bit unsigned.
    U16,
    /// 16-bit signed.
    I16,
    /// 16-bit float.
    F16,
    /// 32-bit float.
    F32,
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
        let _ = (image, grid, rescale);
        Err(Error::Invalid { item: "host image", what: "not yet".into(), right: "not yet".into() })
    }

    /// As [`Engine::upload_image`], from a buffer of samples, x fastest.
    ///
    /// # Errors
    /// As there; [`Error::Invalid`] for a buffer that is too short.
    pub fn upload_buffer(&self, buffer: &mut HostBuffer, samples: SampleType, grid: &Grid, rescale: (f32, f32)) -> Result<DeviceVolume> {
        let _ = (buffer, samples, grid, rescale);
        Err(Error::Invalid { item: "host buffer", what: "not yet".into(), right: "not yet".into() })
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
        let _ = (medium, lit, camera, image, target, progress);
        Err(Error::Invalid { item: "host image", what: "not yet".into(), right: "not yet".into() })
    }
}
