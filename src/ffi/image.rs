//! `hl_image_*`: pixels in host memory.

use super::abi::*;
use super::call::{alone, choice, enter, fill, finite, put, read, switch};
use super::fault::{Fault, Result};
use super::handle::Object;
use super::host::{Host, lock};
use super::layers::{self, Layers};
use super::log::{Borrowed, Release};
use super::pixels::{self, Layout};
use crate::io::{self, ExrCompression, ExrOptions};
use crate::measure::{self, flip::Flip};
use crate::scene::Picture;
use std::ffi::{c_char, c_void};
use std::path::Path;
use std::sync::{Arc, Mutex};

/// What an image's handle stands for.
pub(super) struct ImageCell {
    host: Arc<Host>,
    data: Data,
    pub layers: Option<Layers>,
    pub mapped: Mutex<Mapped>,
}

/// How often an image is mapped, and what of it.
#[derive(Default)]
pub(super) struct Mapped {
    pub count: u32,
    picture: Option<Arc<Picture>>,
    pub layers: [Option<Arc<Vec<f32>>>; layers::COUNT],
}

enum Data {
    Own(Arc<Picture>),
    Borrowed(Layout, Borrowed),
}

impl Object for ImageCell {
    type Handle = hl_image;
    const NAME: &'static str = "image";

    fn host(&self) -> &Arc<Host> {
        &self.host
    }
}

impl ImageCell {
    pub fn new(host: Arc<Host>, picture: Picture, layers: Option<Layers>) -> Arc<Self> {
        Self::of(host, Data::Own(Arc::new(picture)), layers)
    }

    fn of(host: Arc<Host>, data: Data, layers: Option<Layers>) -> Arc<Self> {
        Arc::new(Self { host, data, layers, mapped: Mutex::default() })
    }

    /// The pixels; of borrowed ones a passing copy.
    pub fn picture(&self) -> Result<Arc<Picture>> {
        match &self.data {
            Data::Own(picture) => Ok(picture.clone()),
            Data::Borrowed(layout, memory) => layout.picture(memory.data.cast()).map(Arc::new),
        }
    }

    fn size(&self) -> (usize, usize) {
        match &self.data {
            Data::Own(picture) => (picture.width, picture.height),
            Data::Borrowed(layout, _) => (layout.width, layout.height),
        }
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_create(engine: *mut hl_engine, info: *const hl_image_info, image: *mut *mut hl_image) -> hl_status {
    enter(|scope| {
        let (host, out) = scope.making("image", image, |s| s.engine(engine))?;
        let info = read("hl_image_info", info)?;
        alone("hl_image_info", info.next)?;
        if info.data.is_null() {
            return Err(Fault::invalid("hl_image_info.data", "is NULL", "pixels are needed"));
        }
        let layout = Layout::of(&info)?;
        let data = match choice("hl_image_info.memory", info.memory, &[(HL_COPY, false), (HL_BORROW, true)])? {
            false => Data::Own(Arc::new(layout.picture(info.data.cast())?)),
            true => {
                let release = Release { engine: host.id, release: info.release, user: info.release_user, data: info.data };
                Data::Borrowed(layout, Arc::new(release))
            }
        };
        out.give(ImageCell::of(host, data, None))
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_load(engine: *mut hl_engine, path: *const c_char, image: *mut *mut hl_image) -> hl_status {
    enter(|scope| {
        let (host, out) = scope.making("image", image, |s| s.engine(engine))?;
        let path = super::call::path(path)?;
        let picture = host.log.during(host.id, || load(&path))?;
        out.give(ImageCell::new(host, picture, None))
    })
}

/// Radiance HDR is known as a probe only, and so is luminance alone.
fn load(path: &Path) -> std::result::Result<Picture, crate::Error> {
    let picture = io::read_picture(path).map(|(_, picture)| picture);
    if picture.is_ok() || !io::is_probe(path)? {
        return picture;
    }
    let probe = io::read_probe(path)?;
    let rgba = probe.pixels().iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    Ok(Picture { width: probe.width(), height: probe.height(), rgba })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_destroy(image: *mut hl_image) -> hl_status {
    enter(|scope| {
        scope.take::<ImageCell>(image)?;
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_get_size(image: *const hl_image, width: *mut u32, height: *mut u32) -> hl_status {
    enter(|scope| {
        let (w, h) = scope.get::<ImageCell>(image)?.size();
        put(width, w as u32);
        put(height, h as u32);
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_read(
    image: *const hl_image,
    format: i32,
    exposure: f64,
    data: *mut c_void,
    row_stride: i64,
    size: u64,
) -> hl_status {
    enter(|scope| {
        let picture = scope.get::<ImageCell>(image)?.picture()?;
        pixels::write(&picture, format, exposure, data.cast(), row_stride, size)?;
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_map(image: *mut hl_image, pixels: *mut *const f32, count: *mut u64) -> hl_status {
    enter(|scope| {
        let image = scope.get::<ImageCell>(image)?;
        if pixels.is_null() {
            return Err(Fault::invalid("pixels", "is NULL", "a place for the pointer is needed"));
        }
        let mut mapped = lock(&image.mapped);
        let picture = match &mapped.picture {
            Some(picture) => picture.clone(),
            None => image.picture()?,
        };
        put(pixels, picture.rgba.as_ptr().cast());
        put(count, 4 * picture.rgba.len() as u64);
        mapped.picture = Some(picture);
        mapped.count = mapped.count.saturating_add(1);
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_unmap(image: *mut hl_image) -> hl_status {
    enter(|scope| {
        let image = scope.get::<ImageCell>(image)?;
        let mut mapped = lock(&image.mapped);
        match mapped.count {
            0 => return Err(Fault::invalid("image", "is not mapped", "unmap once for each map")),
            1 => *mapped = Mapped::default(),
            _ => mapped.count -= 1,
        }
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_save(image: *const hl_image, path: *const c_char, info: *const hl_save_info) -> hl_status {
    enter(|scope| {
        let image = scope.get::<ImageCell>(image)?;
        let (picture, path) = (image.picture()?, super::call::path(path)?);
        let how = if info.is_null() { Saved::default() } else { Saved::of(&read("hl_save_info", info)?)? };
        let layers = if how.layers == 0 { Vec::new() } else { layers::channels(layers::of(&image, how.layers)?, how.layers) };
        match super::call::extension(&path).as_str() {
            "png" if how.layers != 0 => return Err(Fault::invalid("hl_save_info.layers", "is set", "only an .exr holds layers")),
            "png" => io::write_png(&path, &picture, how.exposure as f32, &[])?,
            "exr" => io::write_exr_layers(&path, &picture, &layers, how.options, &[])?,
            other => return Err(Fault::invalid("path", format_args!("ends in {other:?}"), "a picture is an .exr or .png")),
        }
        Ok(HL_OK)
    })
}

/// How a picture is saved.
#[derive(Default)]
struct Saved {
    exposure: f64,
    layers: u32,
    options: ExrOptions,
}

impl Saved {
    fn of(info: &hl_save_info) -> Result<Self> {
        alone("hl_save_info", info.next)?;
        finite("hl_save_info.exposure", &[info.exposure])?;
        let compressions = [
            (HL_COMPRESSION_ZIP, ExrCompression::Zip),
            (HL_COMPRESSION_NONE, ExrCompression::None),
            (HL_COMPRESSION_RLE, ExrCompression::Rle),
            (HL_COMPRESSION_ZIPS, ExrCompression::Zips),
            (HL_COMPRESSION_PIZ, ExrCompression::Piz),
        ];
        Ok(Self {
            exposure: info.exposure,
            layers: layers::bits("hl_save_info.layers", info.layers)?,
            options: ExrOptions {
                half: switch("hl_save_info.half", info.half)?,
                compression: choice("hl_save_info.compression", info.compression, &compressions)?,
            },
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_compare(a: *const hl_image, b: *const hl_image, difference: *mut hl_difference) -> hl_status {
    enter(|scope| {
        let (a, b) = (scope.get::<ImageCell>(a)?.picture()?, scope.get::<ImageCell>(b)?.picture()?);
        let (found, flip) = (measure::compare(&a, &b)?, flip(&a, &b)?);
        fill("hl_difference", difference, |out| {
            out.relative_rmse = found.relative_rmse.unwrap_or(-1.0);
            out.mean_ratio = found.mean_ratio.unwrap_or(-1.0);
            out.largest = found.max;
            out.flip_mean = flip.mean;
        })
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_difference(a: *const hl_image, b: *const hl_image, kind: i32, image: *mut *mut hl_image) -> hl_status {
    enter(|scope| {
        let (cell, out) = scope.making("image", image, |s| s.get::<ImageCell>(a))?;
        let (a, b) = (cell.picture()?, scope.get::<ImageCell>(b)?.picture()?);
        let flipped = choice("kind", kind, &[(HL_DIFFERENCE_SIGNED, false), (HL_DIFFERENCE_FLIP, true)])?;
        let drawn = if flipped { flip(&a, &b)?.drawn(b.width, b.height) } else { measure::signed(&a, &b)? };
        out.give(ImageCell::new(cell.host.clone(), drawn, None))
    })
}

/// The perceived difference; numbers beyond 1 are radiance.
fn flip(a: &Picture, b: &Picture) -> Result<Flip> {
    let bright = b.rgba.iter().any(|p| p[..3].iter().any(|&v| v > 1.0));
    Ok(if bright { measure::flip::radiance(a, b)? } else { measure::flip::display(a, b)? })
}
