//! Volumes from files: which reader, and under which limits.

use super::limits::{bad, open, quote};
use super::samples::SampleType;
use super::{dicom, metaimage, nifti, nrrd, raw, stack, vdb, vti, vtk_legacy};
use crate::error::{Error, Result, shown};
use crate::scene::Volume;
use crate::scene::frames::Pattern;
use flate2::bufread::GzDecoder;
use std::cell::Cell;
use std::fs::File;
use std::io::{BufReader, Seek};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

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
    /// Which component, channel or array is the scalar, where a file holds several: its name, or its number from 0.
    pub component: Option<String>,
    /// Which DICOM series of a folder that holds several: its SeriesInstanceUID.
    pub series: Option<String>,
    /// Voxel edges of an image stack, world units (default: as its files say, else 1); other files say their own.
    pub spacing: Option<[f64; 3]>,
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
    /// Called with the fraction read, ascending to 1; where it breaks off, reading ends with [`Error::Cancelled`].
    pub progress: Option<&'a dyn Fn(f64) -> ControlFlow<()>>,
}

impl Default for ReadOptions<'_> {
    fn default() -> Self {
        Self {
            raw: None,
            component: None,
            series: None,
            spacing: None,
            nan_as: None,
            max_bytes: 16 << 30,
            allow_outside: false,
            count_not_finite: None,
            progress: None,
        }
    }
}

impl ReadOptions<'_> {
    pub(super) fn report(&self, fraction: f64) -> Result<()> {
        match self.progress.map(|progress| progress(fraction)) {
            Some(ControlFlow::Break(())) => Err(Error::Cancelled),
            _ => Ok(()),
        }
    }
}

/// Reads a scalar volume, each kind of file known by its content:
///
/// | format | files |
/// |---|---|
/// | NRRD | `.nrrd`, `.nhdr` |
/// | NIfTI-1 | `.nii`, `.nii.gz`, `.hdr` with `.img`, each gzipped or not |
/// | MetaImage | `.mha`, `.mhd` with its samples beside it |
/// | VTK | ImageData `.vti`, legacy `.vtk` with STRUCTURED_POINTS |
/// | DICOM | the folder of a series, or one file |
/// | OpenVDB | `.vdb`, one grid over the box of its active voxels |
/// | TIFF, PNG | a folder, a pattern `slice_####.tif`, a TIFF of several pages, or one picture |
/// | headerless | when [`ReadOptions::raw`] says what it holds |
///
/// World coordinates are the file's own, unchanged: NIfTI's are RAS+ (usually mm), an NRRD's those of its `space` field,
/// a MetaImage's and DICOM's LPS. Files give the centre of the first voxel; in voxel coordinates that is (½, ½, ½).
///
/// # Errors
/// [`Error::Io`] from the system, [`Error::Format`] for a damaged, unsupported, too large or non-finite file, and
/// [`Error::Invalid`] for a `nan_as` that is not finite; [`Error::Cancelled`].
pub fn read_volume(path: &Path, options: &ReadOptions) -> Result<Volume> {
    if let Some(v) = options.nan_as
        && !v.is_finite()
    {
        return Err(Error::Invalid { item: "nan_as", what: format!("{v}"), right: "it must be finite".into() });
    }
    let kind = match kind_of(path) {
        Kind::Series => return Err(series(path)),
        kind => {
            if options.raw.is_some() {
                Kind::File
            } else {
                kind
            }
        }
    };
    refuse_idle(path, options, kind)?;
    if let Some(layout) = &options.raw {
        return raw::read(path, layout, options);
    }
    match kind {
        Kind::File | Kind::Series => {}
        Kind::Folder => return folder(path, options),
        Kind::Pattern => return stack::read_pattern(path, options),
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
    if !gzip {
        if vdb::is_vdb(&head) {
            return vdb::read(path, file, length, options);
        }
        if &head[128..132] == b"DICM" || extension(path) == "dcm" {
            return dicom::read_file(path, options);
        }
        if stack::is_picture(&head[..n]) {
            return stack::read_file(path, options);
        }
    }
    if let Some(read) = text_kind(&head, path) {
        if gzip {
            return Err(bad(path, "it is a gzipped text header with its samples", "these files compress inside: gunzip the file first"));
        }
        return read(path, file, length, options);
    }
    // A .nii that is cut short in its header has nothing else to be known by.
    let name = path.to_string_lossy().to_ascii_lowercase();
    if nifti::is_header(&head) || (n > 0 && (name.ends_with(".nii") || name.ends_with(".nii.gz"))) {
        return nifti::read(path, file, length, gzip, options);
    }
    // The data half of a pair has no mark of its own.
    if let Some(header) = nifti::header_beside(path) {
        return read_volume(&header, options);
    }
    Err(unknown(path, &start[..n.min(16)], &extension(path)))
}

/// What a path names.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    File,
    Folder,
    /// `slice_####.tif`
    Pattern,
    /// `step_####.vti`
    Series,
}

fn kind_of(path: &Path) -> Kind {
    if path.is_dir() {
        Kind::Folder
    } else if path.exists() {
        Kind::File
    } else if stack::is_pattern(path) {
        Kind::Pattern
    } else if Pattern::find(path).is_some() {
        Kind::Series
    } else {
        Kind::File
    }
}

/// Whether `path` is a volume in several files: a folder, or a pattern such as `slice_####.tif` or `step_####.vti`.
pub fn is_volume_set(path: &Path) -> bool {
    kind_of(path) != Kind::File
}

/// The files that reading `path` reads: those of a folder or of a pattern of pictures, else the file itself. Parts that a
/// header names (`.raw`, `.img`) are not among them.
pub fn volume_files(path: &Path) -> Vec<PathBuf> {
    let several = match kind_of(path) {
        Kind::Folder => stack::files_of(path).and_then(|files| {
            let found = dicom::files_among(&files)?;
            Ok(if found.is_empty() { files.into_iter().filter(|f| stack::is_slice(f)).collect() } else { found })
        }),
        Kind::Pattern => stack::slices(path).map(|slices| slices.into_iter().map(|s| s.1).collect()),
        Kind::File | Kind::Series => return vec![path.to_owned()],
    };
    // What cannot be listed cannot be read: reading says why.
    several.unwrap_or_default()
}

fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// Refuses options that would change nothing.
fn refuse_idle(path: &Path, options: &ReadOptions, kind: Kind) -> Result<()> {
    let stack = kind != Kind::File || matches!(extension(path).as_str(), "tif" | "tiff" | "png");
    if options.spacing.is_some() && !stack {
        let what = format!("changes nothing for {}, which is no stack of pictures", shown(path));
        return Err(Error::Invalid { item: "volume.spacing", what, right: "drop it: the file says its own".into() });
    }
    if options.series.is_some() && kind != Kind::Folder {
        let what = format!("changes nothing for {}, which is no folder", shown(path));
        return Err(Error::Invalid { item: "volume.series", what, right: "drop it, or name the folder of a DICOM series".into() });
    }
    Ok(())
}

/// A folder: of DICOM files if it has any, else of pictures.
fn folder(path: &Path, options: &ReadOptions) -> Result<Volume> {
    let files = stack::files_of(path)?;
    let found = dicom::files_among(&files)?;
    if !found.is_empty() {
        if options.spacing.is_some() {
            let what = format!("changes nothing for {}, a DICOM series", shown(path));
            return Err(Error::Invalid { item: "volume.spacing", what, right: "drop it: the files say their own".into() });
        }
        return dicom::read_files(path, found, options);
    }
    if let Some(series) = &options.series {
        let what = format!("is '{}', and {} has no DICOM file", quote(series), shown(path));
        return Err(Error::Invalid { item: "volume.series", what, right: "drop it".into() });
    }
    stack::read_folder(path, files, options)
}

/// Reads the volume in an opened file.
type Reader = fn(&Path, BufReader<File>, u64, &ReadOptions) -> Result<Volume>;

/// Formats whose headers are text, by their first bytes; a MetaImage's may begin with anything.
fn text_kind(head: &[u8], path: &Path) -> Option<Reader> {
    if head.starts_with(b"# vtk DataFile") {
        return Some(vtk_legacy::read);
    }
    if vti::is_header(head) {
        return Some(vti::read);
    }
    (metaimage::is_header(head) || matches!(extension(path).as_str(), "mha" | "mhd")).then_some(metaimage::read)
}

fn peek(file: &mut impl std::io::Read, path: &Path, head: &mut [u8]) -> Result<usize> {
    match super::limits::fill(file, head) {
        (n, None) => Ok(n),
        (_, Some(e)) => Err(super::limits::io(path, "read", e)),
    }
}

/// The files of a time series where one volume is wanted.
fn series(path: &Path) -> Error {
    let right = "name one of them, or say which with --volume.number; a scene's volume.file shows them over its [animation]";
    bad(path, "no such file; as a pattern it stands for the files of a time series", right)
}

/// A file of no known kind, or of one that is known but not read.
fn unknown(path: &Path, head: &[u8], extension: &str) -> Error {
    let known = match extension {
        "vti" | "vtk" | "vtr" | "vts" | "vtu" | "vtp" | "pvti" => Some("a VTK file of another kind"),
        "jpg" | "jpeg" | "bmp" | "gif" | "jp2" => Some("a picture"),
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
        "NRRD, NIfTI-1, MetaImage, VTK (.vti, .vtk), OpenVDB, DICOM, TIFF and PNG are read, headerless samples where --volume.dims and --volume.type say what they are",
    )
}
