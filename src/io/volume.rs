//! Volumes from files: which reader, and under which limits.

use super::limits::{bad, open, quote};
use super::samples::SampleType;
use super::{nifti, nrrd, raw, vdb};
use crate::error::{Error, Result};
use crate::scene::Volume;
use flate2::bufread::GzDecoder;
use std::cell::Cell;
use std::io::Seek;
use std::path::Path;

/// What a headerless file holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawLayout {
    /// Voxels along x, y, z (x fastest in the file).
    pub dims: [usize; 3],
    /// Type of a sample.
    pub kind: SampleType,
    /// Most significant byte first.
    pub big_endian: bool,
    /// Edges of a voxel, world units.
    pub spacing: [f64; 3],
    /// Byte of the first sample.
    pub offset: u64,
}

/// How to read a volume.
#[derive(Clone)]
pub struct ReadOptions<'a> {
    /// Take the file as headerless samples of this layout, whatever it looks like.
    pub raw: Option<RawLayout>,
    /// Value that stands in for NaN and infinite samples, in the data's unit (after a NIfTI file's slope and
    /// intercept). Without it they are an error.
    pub nan_as: Option<f32>,
    /// Largest size of the samples in memory, bytes.
    pub max_bytes: u64,
    /// Lets a header name a data file outside its own folder.
    pub allow_outside: bool,
    /// Counts NaN and infinite samples where they would be an error; the smallest finite sample stands for them (0 where
    /// there is none).
    pub count_not_finite: Option<&'a Cell<u64>>,
    /// Which of a file's several volumes or channels: of OpenVDB a grid's name, with ".x", ".y" or ".z" for a vector's
    /// component. Without it, the only one.
    pub component: Option<&'a str>,
    /// Called with the fraction read, ascending to 1.
    pub progress: Option<&'a dyn Fn(f64)>,
}

impl Default for ReadOptions<'_> {
    fn default() -> Self {
        Self { raw: None, nan_as: None, max_bytes: 16 << 30, allow_outside: false, count_not_finite: None, component: None, progress: None }
    }
}

impl ReadOptions<'_> {
    pub(super) fn report(&self, fraction: f64) {
        if let Some(progress) = self.progress {
            progress(fraction);
        }
    }
}

/// Reads a scalar volume: NRRD (`.nrrd`, `.nhdr`), NIfTI-1 (`.nii`, `.nii.gz`, `.hdr` with `.img`), each known by its
/// content, or headerless samples when [`ReadOptions::raw`] says what they are.
///
/// World coordinates are the file's own: NIfTI's are RAS+ (usually mm), an NRRD's those of its `space` field. Files give
/// the centre of the first voxel; in voxel coordinates that is (½, ½, ½).
///
/// # Errors
/// [`Error::Io`] from the system, [`Error::Format`] for a damaged, unsupported, too large or non-finite file, and
/// [`Error::Invalid`] for a `nan_as` that is not finite.
pub fn read_volume(path: &Path, options: &ReadOptions) -> Result<Volume> {
    if let Some(v) = options.nan_as
        && !v.is_finite()
    {
        return Err(Error::Invalid { item: "nan_as", what: format!("{v}"), right: "it must be finite".into() });
    }
    if let Some(layout) = &options.raw {
        return raw::read(path, layout, options);
    }
    let (mut file, length) = open(path)?;
    let mut head = [0; 348];
    let n = peek(&mut file, path, &mut head)?;
    let gzip = head[..n].starts_with(&[0x1f, 0x8b]);
    let start = head;
    if gzip {
        head = [0; 348];
        file.rewind().map_err(|e| super::limits::io(path, "read", e))?;
        // A damaged stream still shows what it began as.
        super::limits::fill(&mut GzDecoder::new(&mut file), &mut head);
    }
    file.rewind().map_err(|e| super::limits::io(path, "read", e))?;
    if head.starts_with(b"NRRD") {
        if gzip {
            return Err(bad(path, "it is a gzipped NRRD file", "NRRD compresses inside, with `encoding: gzip`; gunzip the file first"));
        }
        return nrrd::read(path, file, length, options);
    }
    if vdb::is_vdb(&head) {
        return vdb::read(path, file, length, options.component, options);
    }
    // A .nii that is cut short in its header has nothing else to be known by.
    let name = path.to_string_lossy().to_ascii_lowercase();
    if nifti::is_header(&head) || (n > 0 && (name.ends_with(".nii") || name.ends_with(".nii.gz"))) {
        return nifti::read(path, file, length, gzip, options);
    }
    // The data half of a pair has no mark of its own.
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if extension == "img" && path.with_extension("hdr").is_file() {
        return read_volume(&path.with_extension("hdr"), options);
    }
    Err(unknown(path, &start[..n.min(16)], &extension))
}

fn peek(file: &mut impl std::io::Read, path: &Path, head: &mut [u8]) -> Result<usize> {
    match super::limits::fill(file, head) {
        (n, None) => Ok(n),
        (_, Some(e)) => Err(super::limits::io(path, "read", e)),
    }
}

/// A file of no known kind, or of one that is known but not read.
fn unknown(path: &Path, head: &[u8], extension: &str) -> Error {
    let known = match extension {
        "mha" | "mhd" => Some("a MetaImage"),
        "vti" | "vtk" | "vtr" => Some("a VTK file"),
        "dcm" => Some("a DICOM file"),
        "tif" | "tiff" => Some("a TIFF stack"),
        "h5" | "hdf5" | "nc" | "mnc" => Some("an HDF5, NetCDF or MINC file"),
        _ => None,
    };
    let what = match known {
        Some(kind) => format!("it looks like {kind}, which is not read"),
        None if head.is_empty() => "it is empty".into(),
        None => format!("it is no volume file known here; it begins with '{}'", quote(&String::from_utf8_lossy(head))),
    };
    bad(
        path,
        what,
        "NRRD (.nrrd, .nhdr) and NIfTI-1 (.nii, .nii.gz, .hdr) are read, headerless samples where --volume.dims and --volume.type say what they are",
    )
}
