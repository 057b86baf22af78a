//! A rendered picture in host memory.

use crate::error::Result;
use crate::room::zeroed;

/// Linear, premultiplied RGBA; row 0 is the top row.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width`·`height` pixels: scene-linear RGB radiance times coverage, and coverage (1 − transmittance of the ray).
    pub rgba: Vec<[f32; 4]>,
}

impl Picture {
    /// A transparent black picture.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, rgba: vec![[0.0; 4]; width * height] }
    }

    /// The same, where there is room.
    pub(crate) fn asked(width: usize, height: usize) -> Result<Self> {
        Ok(Self { width, height, rgba: zeroed("a picture", width * height)? })
    }
}
