//! Pictures of either kind, told apart by their first bytes.

use super::limits::{bad, io, open};
use super::{exr, exr_layers, png};
use crate::error::Result;
use crate::scene::Picture;
use std::io::{Read, Seek};
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

/// What a picture's file says that the volume covers of each pixel, in the channel `opacity.Y`: over a background its alpha is 1
/// everywhere. `None` where it does not say so.
///
/// # Errors
/// As [`read_picture`].
pub fn read_coverage(path: &Path) -> Result<Option<Vec<f32>>> {
    let mut magic = Vec::new();
    open(path)?.0.take(4).read_to_end(&mut magic).map_err(|e| io(path, "read", e))?;
    if magic == exr::MAGIC { exr::read_coverage(path) } else { Ok(None) }
}

/// A picture as this crate wrote it, by its header.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureInfo {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Its channels' names, each with the type of its numbers: "half", "float", "uint" or "8-bit".
    pub channels: Vec<(String, &'static str)>,
    /// What wrote it: "halflight 0.1.0".
    pub software: String,
    /// Its own entries: key, value.
    pub meta: Vec<(String, String)>,
}

/// Describes a picture that this crate wrote with entries of its own; `None` for all other files, and for one whose header is
/// damaged.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) when the file cannot be read, [`Error::Format`](crate::Error::Format) for what is no regular
/// file.
pub fn describe_picture(path: &Path) -> Result<Option<PictureInfo>> {
    let (mut file, _) = open(path)?;
    let mut magic = Vec::new();
    file.by_ref().take(8).read_to_end(&mut magic).map_err(|e| io(path, "read", e))?;
    file.rewind().map_err(|e| io(path, "read", e))?;
    let info = match magic {
        magic if magic.starts_with(&exr::MAGIC) => exr_layers::describe(file),
        magic if magic == png::MAGIC => png::describe(file),
        _ => None,
    };
    Ok(info.filter(|info| info.software.starts_with("halflight ") && !info.meta.is_empty()))
}
