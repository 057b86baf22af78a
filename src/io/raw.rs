//! Headerless samples: the caller says what they are.

use super::limits::{Source, bad, grid, open, shape};
use super::samples::{self, Layout, SampleType};
use super::{RawLayout, ReadOptions};
use crate::error::Result;
use crate::scene::Volume;
use glam::{DAffine3, DVec3};
use std::path::Path;

impl RawLayout {
    /// Little-endian samples from byte 0 on, spacing 1.
    pub fn new(dims: [usize; 3], kind: SampleType) -> Self {
        Self { dims, kind, big_endian: false, spacing: [1.0; 3], offset: 0 }
    }
}

/// Reads a headerless file. Its box begins at the world origin. Dims that do not account for every byte are wrong dims.
pub(super) fn read(path: &Path, raw: &RawLayout, options: &ReadOptions) -> Result<Volume> {
    let grid = grid(path, raw.dims, DAffine3::from_scale(DVec3::from(raw.spacing)))?;
    super::choose::component(path, "it is read as one scalar volume", 1, &[], None, options)?;
    let (file, length) = open(path)?;
    let layout = Layout { big_endian: raw.big_endian, replace: options.nan_as, ..Layout::scalar(raw.dims, raw.kind) };
    let needs = u128::from(grid.voxels()) * u128::from(raw.kind.bytes());
    let there = length.saturating_sub(raw.offset);
    if u128::from(there) != needs {
        return Err(bad(
            path,
            format!(
                "{} {} samples need {needs} bytes, the file holds {there} from byte {} on",
                shape(raw.dims),
                raw.kind.name(),
                raw.offset
            ),
            "dims, type and offset must account for every byte",
        ));
    }
    let source = Source::new(path, file, length, raw.offset, false)?;
    Volume::new(grid, samples::read(path, source, &layout, options)?, 1.0, 0.0)
}
