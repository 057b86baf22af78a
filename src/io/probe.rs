//! Light probes: lat-long pictures in Radiance (.hdr) or OpenEXR (.exr), told apart by their first bytes.

use super::limits::open;
use super::{exr, hdr};
use crate::error::{Error, Result};
use crate::scene::Probe;
use crate::scene::light::{bad_pixels, bad_shape};
use std::io::{Read, Seek};
use std::path::Path;

/// The first two bytes of a Radiance picture.
const RADIANCE: &[u8] = b"#?";

/// Whether a file is a picture that [`read_probe`] knows, by its first bytes: `.hdr` is also the extension of old volume
/// headers.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Format`] when it is no regular file.
pub fn is_probe(path: &Path) -> Result<bool> {
    let mut magic = Vec::new();
    open(path)?.0.take(4).read_to_end(&mut magic).map_err(|source| Error::Io { path: path.to_owned(), action: "read", source })?;
    Ok(magic == exr::MAGIC || magic.starts_with(RADIANCE))
}

/// Reads a lat-long probe of linear RGB radiance. OpenEXR: the first layer with R, G and B (half, float or uint), else the
/// first with Y alone, as grey; alpha is ignored.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read; [`Error::Format`] when it is damaged, of another kind, not 2:1, too large,
/// or has a NaN or infinite pixel, or negative ones of more than a ten-thousandth of all: less, as conversions of colours and resampling
/// leave it, counts as 0 (with a warning).
pub fn read_probe(path: &Path) -> Result<Probe> {
    let failed = |action| move |source| Error::Io { path: path.to_owned(), action, source };
    let wrong = |what: String, right: String| Error::Format { path: path.to_owned(), what, right };
    let (mut file, _) = open(path)?;
    let mut magic = Vec::new();
    file.by_ref().take(4).read_to_end(&mut magic).map_err(failed("read"))?;
    file.rewind().map_err(failed("read"))?;
    let (width, height, mut pixels) = if magic == exr::MAGIC {
        exr::read_rgb(path, file, bad_shape)?
    } else if magic.starts_with(RADIANCE) {
        hdr::decode(file, bad_shape).map_err(|trouble| match trouble {
            hdr::Trouble::Io(source) => failed("read")(source),
            hdr::Trouble::Format(what, right) => wrong(what, right),
        })?
    } else {
        return Err(wrong("its first bytes are neither Radiance's nor OpenEXR's".into(), "a probe is a lat-long .hdr or .exr".into()));
    };
    clamp(path, &mut pixels);
    if let Some((what, right)) = bad_pixels(width, &pixels) {
        return Err(wrong(what, right.into()));
    }
    Probe::new(width, height, pixels)
}

/// Takes a little below 0 for 0.
fn clamp(path: &Path, pixels: &mut [[f32; 3]]) {
    let (mut count, mut lost, mut all) = (0u64, 0.0, 0.0);
    for &c in pixels.iter().flatten() {
        if c < 0.0 {
            (count, lost) = (count + 1, lost - f64::from(c));
        } else {
            // NaN, too.
            all += f64::from(c);
        }
    }
    if count == 0 || !f64::is_finite(all) || lost > 1e-4 * all {
        return;
    }
    log::warn!("{}: {count} of its numbers are below 0; they count as 0", crate::error::shown(path));
    pixels.iter_mut().flatten().filter(|c| **c < 0.0).for_each(|c| *c = 0.0);
}
