//! Pictures of either kind, told apart by their first bytes.

use super::limits::{bad, io, open};
use super::{exr, png};
use crate::error::Result;
use crate::scene::Picture;
use std::io::Read;
use std::path::Path;

/// What a picture's numbers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureKind {
    /// Linear radiance, of any size (OpenEXR).
    Radiance,
    /// Meant for display: 0..1 (PNG).
    Display,
}

/// Reads an OpenEXR or PNG picture: linear, premultiplied; coverage 1 where the file has no alpha.
///
/// # Errors
/// As [`read_picture_exr`](exr::read_picture_exr) and [`read_picture_png`](png::read_picture_png);
/// [`Error::Format`](crate::Error::Format) for a file that is neither.
pub fn read_picture(path: &Path) -> Result<(PictureKind, Picture)> {
    let mut magic = Vec::new();
    open(path)?.0.take(8).read_to_end(&mut magic).map_err(|e| io(path, "read", e))?;
    if magic.starts_with(&exr::MAGIC) {
        Ok((PictureKind::Radiance, exr::read_picture_exr(path)?))
    } else if magic == png::MAGIC {
        Ok((PictureKind::Display, png::read_picture_png(path)?))
    } else {
        Err(bad(path, "its first bytes are neither OpenEXR's nor PNG's", "a picture is an .exr or .png"))
    }
}
