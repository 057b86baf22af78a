//! `hl_image_*`: pixels in host memory.

use super::abi::*;
use super::call::{alone, choice, enter, fill, finite, out, put, read};
use super::fault::{Fault, Result};
use super::handle::Object;
use super::host::{Host, lock};
use super::log::{Borrowed, Release};
use super::pixels::{self, Layout};
use crate::io::{self, PictureKind};
use crate::measure;
use crate::scene::Picture;
use std::ffi::{c_char, c_void};
use std::path::Path;
use std::sync::{Arc, Mutex};

/// What an image's handle stands for.
pub(super) struct ImageCell {
    host: Arc<Host>,
    data: Data,
    /// How often it is mapped, and what.
    mapped: Mutex<(u32, Option<Arc<Picture>>)>,
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
    pub fn new(host: Arc<Host>, picture: Picture) -> Arc<Self> {
        Self::of(host, Data::Own(Arc::new(picture)))
    }

    fn of(host: Arc<Host>, data: Data) -> Arc<Self> {
        Arc::new(Self { host, data, mapped: Mutex::default() })
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
        let out = out("image", image)?;
        let host = scope.engine(engine)?;
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
        out.give(ImageCell::of(host, data))
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_load(engine: *mut hl_engine, path: *const c_char, image: *mut *mut hl_image) -> hl_status {
    enter(|scope| {
        let out = out("image", image)?;
        let host = scope.engine(engine)?;
        let path = super::call::path(path)?;
        let picture = host.log.during(host.id, || load(&path))?;
        out.give(ImageCell::new(host, picture))
    })
}

/// Radiance HDR is known as a probe only.
fn load(path: &Path) -> std::result::Result<Picture, crate::Error> {
    match io::is_probe(path)? {
        true => match io::read_probe(path) {
            Ok(probe) => {
                let rgba = probe.pixels().iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
                Ok(Picture { width: probe.width(), height: probe.height(), rgba })
            }
            // Not 2:1, or with coverage: an ordinary OpenEXR picture.
            Err(probe) => io::read_picture(path).map(|(_, picture)| picture).map_err(|_| probe),
        },
        false => io::read_picture(path).map(|(_, picture)| picture),
    }
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
        let picture = match &mapped.1 {
            Some(picture) => picture.clone(),
            None => image.picture()?,
        };
        put(pixels, picture.rgba.as_ptr().cast());
        put(count, 4 * picture.rgba.len() as u64);
        *mapped = (mapped.0.saturating_add(1), Some(picture));
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_unmap(image: *mut hl_image) -> hl_status {
    enter(|scope| {
        let image = scope.get::<ImageCell>(image)?;
        let mut mapped = lock(&image.mapped);
        match mapped.0 {
            0 => return Err(Fault::invalid("image", "is not mapped", "unmap once for each map")),
            1 => *mapped = (0, None),
            _ => mapped.0 -= 1,
        }
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_save(image: *const hl_image, path: *const c_char, exposure: f64) -> hl_status {
    enter(|scope| {
        let picture = scope.get::<ImageCell>(image)?.picture()?;
        let path = super::call::path(path)?;
        finite("exposure", &[exposure])?;
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        match extension.as_str() {
            "png" => io::write_png(&path, &picture, exposure as f32, &[])?,
            "exr" => io::write_exr(&path, &picture, &[])?,
            other => return Err(Fault::invalid("path", format_args!("ends in {other:?}"), "a picture is an .exr or .png")),
        }
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_image_compare(a: *const hl_image, b: *const hl_image, difference: *mut hl_difference) -> hl_status {
    enter(|scope| {
        let (a, b) = (scope.get::<ImageCell>(a)?.picture()?, scope.get::<ImageCell>(b)?.picture()?);
        let found = measure::compare(&a, &b)?;
        let flip = match radiance(&b) {
            PictureKind::Radiance => measure::flip::radiance(&a, &b)?,
            PictureKind::Display => measure::flip::display(&a, &b)?,
        };
        fill("hl_difference", difference, |out| {
            out.relative_rmse = found.relative_rmse.unwrap_or(-1.0);
            out.mean_ratio = found.mean_ratio.unwrap_or(-1.0);
            out.largest = found.max;
            out.flip_mean = flip.mean;
        })
    })
}

/// What the numbers of a picture are: beyond 1 they are radiance.
fn radiance(picture: &Picture) -> PictureKind {
    let bright = picture.rgba.iter().any(|p| p[..3].iter().any(|&v| v > 1.0));
    if bright { PictureKind::Radiance } else { PictureKind::Display }
}
