//! Three-dimensional images with levels, and the views of them that kernels bind.

use super::access::{State, Target};
use super::foreign::Foreign;
use super::raw::Raw;
use super::{Access, Format, Resource, failed, lock};
use crate::error::{Error, Result};
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationScheme};
use std::collections::HashMap;
use std::sync::{Arc, Mutex};

/// What an image is to be.
#[derive(Clone, Copy, Debug)]
pub struct ImageDesc<'a> {
    /// Its name in messages.
    pub name: &'a str,
    /// Texels along x, y, z.
    pub dims: [u32; 3],
    /// Levels; each halves the one before, rounding down, to 1 at least.
    pub levels: u32,
    /// Its own format.
    pub format: Format,
    /// Other formats of the same size that it will be viewed in.
    pub views: &'a [Format],
    /// Whether kernels write it (or load from it without a sampler).
    pub storage: bool,
}

/// An image in device memory. Clones are the same image.
#[derive(Clone)]
pub struct Image {
    pub(super) inner: Arc<ImageInner>,
}

pub(super) struct ImageInner {
    pub raw: Arc<Raw>,
    pub handle: vk::Image,
    // Nothing only while being dropped, and in an image that is not ours.
    allocation: Option<Allocation>,
    /// How it came and goes back, where it is not ours.
    pub foreign: Option<Foreign>,
    pub name: String,
    dims: [u32; 3],
    levels: u32,
    pub format: Format,
    formats: Vec<Format>,
    pub storage: bool,
    views: Mutex<HashMap<ViewKey, vk::ImageView>>,
    /// One per level.
    pub states: Vec<Mutex<State>>,
}

/// What a view shows.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct ViewKey {
    pub base: u32,
    pub count: u32,
    pub format: Format,
    pub storage: bool,
}

impl Drop for ImageInner {
    fn drop(&mut self) {
        // SAFETY: recorders hold an `Arc` of this until their work is done; views go before the image, the image before its memory.
        unsafe {
            for view in lock(&self.views).values() {
                self.raw.device.destroy_image_view(*view, None);
            }
            if self.foreign.is_none() {
                self.raw.device.destroy_image(self.handle, None);
            }
            if let Some(allocation) = self.allocation.take() {
                self.raw.free(allocation, true);
            }
        }
    }
}

impl ImageInner {
    pub(super) fn view(&self, key: ViewKey) -> Result<vk::ImageView> {
        if !self.formats.contains(&key.format) {
            return Err(self.invalid(
                "image view",
                format!("has no view as {:?}", key.format),
                format!("formats named when it was made: {:?}", self.formats),
            ));
        }
        if key.count == 0 || key.base.saturating_add(key.count) > self.levels {
            return Err(self.invalid("image level", format!("has no level {}", key.base), format!("it has {} levels", self.levels)));
        }
        if key.storage && !self.storage {
            return Err(self.invalid("storage image", String::from("was made without `storage`"), String::from("ask for it in ImageDesc")));
        }
        let mut views = lock(&self.views);
        if let Some(view) = views.get(&key) {
            return Ok(*view);
        }
        let usage = if key.storage { vk::ImageUsageFlags::STORAGE } else { vk::ImageUsageFlags::SAMPLED };
        let mut usage = vk::ImageViewUsageCreateInfo::default().usage(usage);
        let create = vk::ImageViewCreateInfo::default()
            .image(self.handle)
            .view_type(vk::ImageViewType::TYPE_3D)
            .format(key.format.raw())
            .subresource_range(range(key.base, key.count))
            .push_next(&mut usage);
        // SAFETY: the image is alive and bound; levels and format were checked above.
        let view = unsafe { self.raw.device.create_image_view(&create, None) }.map_err(failed("vkCreateImageView"))?;
        self.raw.name(view, &self.name);
        views.insert(key, view);
        Ok(view)
    }

    fn invalid(&self, item: &'static str, what: String, right: String) -> Error {
        Error::Invalid { item, what: format!("'{}' {what}", self.name), right }
    }

    pub(super) fn level_dims(&self, level: u32) -> [u32; 3] {
        self.dims.map(|n| n.checked_shr(level).unwrap_or(0).max(1))
    }
}

/// Levels of a colour image.
pub(super) fn range(base: u32, count: u32) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange {
        aspect_mask: vk::ImageAspectFlags::COLOR,
        base_mip_level: base,
        level_count: count,
        base_array_layer: 0,
        layer_count: 1,
    }
}

impl Image {
    /// An image of somebody else, for copies only: it has no views.
    pub(super) fn lent(raw: &Arc<Raw>, handle: vk::Image, name: &str, dims: [u32; 3], format: Format, foreign: Foreign) -> Self {
        let inner = ImageInner {
            raw: raw.clone(),
            handle,
            allocation: None,
            foreign: Some(foreign),
            name: name.to_owned(),
            dims,
            levels: 1,
            format,
            formats: Vec::new(),
            storage: false,
            views: Mutex::default(),
            states: vec![Mutex::new(State::ready(Access::Foreign))],
        };
        Self { inner: Arc::new(inner) }
    }

    pub(super) fn new(raw: &Arc<Raw>, desc: &ImageDesc<'_>) -> Result<Self> {
        let largest = desc.dims.iter().copied().max().unwrap_or(0);
        let deepest = u32::BITS - largest.leading_zeros();
        let invalid = |item, what: String, right: String| Error::Invalid { item, what: format!("'{}' {what}", desc.name), right };
        if desc.dims.contains(&0) || largest > raw.info.max_image_3d {
            return Err(invalid(
                "image size",
                format!("has {:?} texels", desc.dims),
                format!("1 to {} along each edge on this device (maxImageDimension3D)", raw.info.max_image_3d),
            ));
        }
        if desc.levels == 0 || desc.levels > deepest {
            return Err(invalid(
                "image levels",
                format!("would have {}", desc.levels),
                format!("1 to {deepest} for {:?} texels", desc.dims),
            ));
        }
        if let Some(other) = desc.views.iter().find(|v| v.bytes() != desc.format.bytes()) {
            return Err(invalid(
                "image view",
                format!("as {other:?}"),
                format!("a view has texels of {} bytes like its image", desc.format.bytes()),
            ));
        }
        // Asked of the driver only when it can be true: some drivers fail at bind only, or overflow before.
        let texels: u64 = (0..desc.levels).map(|k| desc.dims.map(|n| u64::from((n >> k).max(1))).iter().product::<u64>()).sum();
        let bytes = texels.saturating_mul(u64::from(desc.format.bytes()));
        if bytes > raw.info.max_allocation {
            return Err(Error::OutOfMemory {
                what: format!("image '{}'", desc.name),
                needs: bytes,
                free: raw.info.max_allocation,
                budget: raw.info.max_allocation,
                right: String::from(
                    "the device allows no larger image (maxMemoryAllocationSize): lower the resolution or use a smaller format",
                ),
            });
        }

        let formats = formats(desc);
        let list: Vec<_> = formats.iter().map(|f| f.raw()).collect();
        let mut list = vk::ImageFormatListCreateInfo::default().view_formats(&list);
        let create = create_info(desc, formats.len()).push_next(&mut list);
        check_format(raw, desc, create.usage, create.flags)?;
        // SAFETY: all pointers of the structure live until the call returns; size, levels and format were checked.
        let handle = unsafe { raw.device.create_image(&create, None) }.map_err(failed("vkCreateImage"))?;
        let mut made = ImageInner {
            raw: raw.clone(),
            handle,
            allocation: None,
            foreign: None,
            name: desc.name.to_owned(),
            dims: desc.dims,
            levels: desc.levels,
            format: desc.format,
            formats,
            storage: desc.storage,
            views: Mutex::default(),
            states: (0..desc.levels).map(|_| Mutex::new(State::FRESH)).collect(),
        };
        // SAFETY: the image is alive.
        let requirements = unsafe { raw.device.get_image_memory_requirements(handle) };
        let scheme = AllocationScheme::DedicatedImage(handle);
        let allocation = raw.allocate(desc.name, requirements, MemoryLocation::GpuOnly, false, scheme, true)?;
        let allocation = made.allocation.insert(allocation);
        // SAFETY: the memory was allocated for this image and is bound to nothing else.
        unsafe { raw.device.bind_image_memory(handle, allocation.memory(), allocation.offset()) }.map_err(failed("vkBindImageMemory"))?;
        raw.name(handle, desc.name);
        Ok(Self { inner: Arc::new(made) })
    }

    /// Its name in messages.
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Texels along x, y, z of level 0.
    pub fn dims(&self) -> [u32; 3] {
        self.inner.dims
    }

    /// Texels along x, y, z of a level.
    pub fn level_dims(&self, level: u32) -> [u32; 3] {
        self.inner.level_dims(level)
    }

    /// Levels.
    pub fn levels(&self) -> u32 {
        self.inner.levels
    }

    /// Its own format.
    pub fn format(&self) -> Format {
        self.inner.format
    }

    /// Bytes of device memory that it holds.
    pub fn bytes(&self) -> u64 {
        self.inner.allocation.as_ref().map_or(0, Allocation::size)
    }

    /// One level as a storage image, in the image's own format.
    pub fn storage(&self, level: u32) -> Storage<'_> {
        Storage { image: self, level, format: self.inner.format }
    }

    /// All levels through a sampler in the image's own format: linear (also between levels) where the device filters the format,
    /// else nearest; clamped to the edge; normalised coordinates.
    pub fn sampled(&self) -> Sampled<'_> {
        self.sampled_as(self.inner.format)
    }

    /// As [`Image::sampled`], the memory read as another of the formats named when the image was made.
    pub fn sampled_as(&self, format: Format) -> Sampled<'_> {
        Sampled { image: self, base: 0, count: self.inner.levels, format, nearest: false }
    }

    /// One level alone through a sampler.
    pub fn level(&self, level: u32) -> Sampled<'_> {
        Sampled { image: self, base: level, count: 1, format: self.inner.format, nearest: false }
    }

    /// All levels, for a barrier.
    pub fn all(&self) -> Resource<'_> {
        Resource { target: Target::Image { image: self, base: 0, count: self.inner.levels } }
    }

    /// One level, for a barrier.
    pub fn mip(&self, level: u32) -> Resource<'_> {
        Resource { target: Target::Image { image: self, base: level, count: 1 } }
    }

    /// The last access of a level on record, of submitted work.
    pub fn last_access(&self, level: u32) -> Access {
        self.inner.states.get(level as usize).map_or(Access::None, |state| lock(state).access)
    }
}

/// One level of an image that a kernel loads from or stores to.
#[derive(Clone, Copy)]
pub struct Storage<'a> {
    pub(super) image: &'a Image,
    pub(super) level: u32,
    pub(super) format: Format,
}

/// Levels of an image that a kernel samples.
#[derive(Clone, Copy)]
pub struct Sampled<'a> {
    pub(super) image: &'a Image,
    pub(super) base: u32,
    pub(super) count: u32,
    pub(super) format: Format,
    pub(super) nearest: bool,
}

impl Sampled<'_> {
    /// Without filtering, neither inside a level nor between levels.
    #[must_use]
    pub fn as_nearest(self) -> Self {
        Self { nearest: true, ..self }
    }
}

impl Storage<'_> {
    pub(super) fn key(&self) -> ViewKey {
        ViewKey { base: self.level, count: 1, format: self.format, storage: true }
    }
}

impl Sampled<'_> {
    pub(super) fn key(&self) -> ViewKey {
        ViewKey { base: self.base, count: self.count, format: self.format, storage: false }
    }
}

/// An image's own format, and the others that it is viewed in.
fn formats(desc: &ImageDesc<'_>) -> Vec<Format> {
    let mut formats = vec![desc.format];
    formats.extend(desc.views.iter().copied().filter(|f| *f != desc.format));
    formats
}

/// All but the list of its formats, of which there are so many.
fn create_info(desc: &ImageDesc<'_>, formats: usize) -> vk::ImageCreateInfo<'static> {
    let mut usage = vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_SRC | vk::ImageUsageFlags::TRANSFER_DST;
    if desc.storage {
        usage |= vk::ImageUsageFlags::STORAGE;
    }
    vk::ImageCreateInfo::default()
        .flags(if formats > 1 { vk::ImageCreateFlags::MUTABLE_FORMAT } else { vk::ImageCreateFlags::empty() })
        .image_type(vk::ImageType::TYPE_3D)
        .format(desc.format.raw())
        .extent(vk::Extent3D { width: desc.dims[0], height: desc.dims[1], depth: desc.dims[2] })
        .mip_levels(desc.levels)
        .array_layers(1)
        .samples(vk::SampleCountFlags::TYPE_1)
        .tiling(vk::ImageTiling::OPTIMAL)
        .usage(usage)
}

/// Bytes that such an image takes with this device's padding, without making it; nothing for one that it does not make.
pub(super) fn bytes(raw: &Raw, desc: &ImageDesc<'_>) -> Option<u64> {
    let formats = formats(desc);
    let list: Vec<_> = formats.iter().map(|f| f.raw()).collect();
    let mut list = vk::ImageFormatListCreateInfo::default().view_formats(&list);
    let create = create_info(desc, formats.len()).push_next(&mut list);
    if desc.dims.contains(&0) || desc.levels == 0 || check_format(raw, desc, create.usage, create.flags).is_err() {
        return None;
    }
    let mut found = vk::MemoryRequirements2::default();
    let info = vk::DeviceImageMemoryRequirements::default().create_info(&create);
    // SAFETY: all pointers of the structures live until the call returns; size, levels and format were checked; maintenance4 is
    // enabled on every device that is taken.
    unsafe { raw.device.get_device_image_memory_requirements(&info, &mut found) };
    Some(found.memory_requirements.size)
}

/// Asks the driver whether it makes such images.
fn check_format(raw: &Raw, desc: &ImageDesc<'_>, usage: vk::ImageUsageFlags, flags: vk::ImageCreateFlags) -> Result<()> {
    let info = vk::PhysicalDeviceImageFormatInfo2::default()
        .format(desc.format.raw())
        .ty(vk::ImageType::TYPE_3D)
        .tiling(vk::ImageTiling::OPTIMAL)
        .usage(usage)
        .flags(flags);
    let mut found = vk::ImageFormatProperties2::default();
    let lacks = |what: String| Error::DeviceLacks { device: raw.info.name.clone(), lacks: format!("{what} (image '{}')", desc.name) };
    // SAFETY: the device belongs to the instance; the structures point at nothing else.
    let answer = unsafe { raw.instance.get_physical_device_image_format_properties2(raw.physical, &info, &mut found) };
    match answer {
        Err(vk::Result::ERROR_FORMAT_NOT_SUPPORTED) => {
            return Err(lacks(format!("3-D images of {:?}{}", desc.format, if desc.storage { " that kernels write" } else { "" })));
        }
        other => other.map_err(failed("vkGetPhysicalDeviceImageFormatProperties2"))?,
    }
    let most = found.image_format_properties;
    let [x, y, z] = desc.dims;
    if x > most.max_extent.width || y > most.max_extent.height || z > most.max_extent.depth || desc.levels > most.max_mip_levels {
        return Err(lacks(format!("images of {x}×{y}×{z} texels of {:?} with {} levels", desc.format, desc.levels)));
    }
    Ok(())
}
