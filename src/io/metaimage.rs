//! MetaImage volumes: `.mha`, and `.mhd` with its samples beside it. Format:
//! <https://itk.org/Wiki/ITK/MetaIO/Documentation>, and metaImage.cxx where that is silent.
//!
//! World coordinates are the file's, unchanged (ITK writes LPS). `Offset` is the centre of the first voxel; row i of
//! `TransformMatrix` is the direction of axis i.

use super::ReadOptions;
use super::choose;
use super::limits::{Source, bad, fill, grid, io, open, quote};
use super::metaimage_header::{Header, split};
use super::nifti::{as_stored, rescaled};
use super::nrrd::beside;
use super::parts::parts;
use super::samples::{self, Layout, SampleType};
use crate::error::Result;
use crate::scene::{Grid, Volume};
use glam::{DAffine3, DMat3, DVec3};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Keys that begin a MetaImage file.
const FIRST: [&str; 6] = ["ObjectType", "Comment", "NDims", "ObjectSubType", "Name", "ID"];

/// Whether these bytes begin a MetaImage header. It has no mark of its own; `NDims` is what none lacks.
pub(super) fn is_header(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let mut lines = text.lines();
    let first = lines.next().and_then(split).map(|(k, _)| k);
    first.is_some_and(|k| FIRST.contains(&k)) && text.lines().any(|l| split(l).is_some_and(|(k, _)| k == "NDims"))
}

/// Reads the volume in an opened MetaImage file of `length` bytes.
pub(super) fn read(path: &Path, mut file: BufReader<File>, length: u64, options: &ReadOptions) -> Result<Volume> {
    let mut header = Header::read(path, &mut file)?;
    if let Some(kind) = header.get(&["ObjectType"])
        && kind != "Image"
    {
        return Err(bad(path, format!("it describes a MetaIO object of type '{}'", quote(kind)), "ObjectType = Image is read"));
    }
    let sizes = sizes(&header)?;
    let dims: [usize; 3] = std::array::from_fn(|a| sizes.get(a).copied().unwrap_or(1));
    let grid = place(&header, sizes.len(), dims)?;
    let kind = kind(&header)?;
    let text = header.flag(&["BinaryData"])? == Some(false);
    let order = ["BinaryDataByteOrderMSB", "ElementByteOrderMSB"];
    let big_endian = header.flag(&order)?.unwrap_or(false);
    let slope = header.numbers(&["ElementToIntensityFunctionSlope"], 1)?.map_or(1.0, |v| v[0] as f32);
    let intercept = header.numbers(&["ElementToIntensityFunctionOffset"], 1)?.map_or(0.0, |v| v[0] as f32);
    if !slope.is_finite() || !intercept.is_finite() || slope == 0.0 {
        return Err(header.wrong(
            &["ElementToIntensityFunctionSlope", "ElementToIntensityFunctionOffset"],
            "slope and offset must be finite, the slope not 0",
        ));
    }
    let replace = as_stored(path, options.nan_as, slope, intercept)?;
    let mut layout = Layout { big_endian, text, replace, ..Layout::scalar(dims, kind) };
    let before = components(&header, &sizes, &mut layout, options)?;
    let volumes = sizes.get(3).copied().unwrap_or(1) as u64;
    let (data, mut source) = samples_of(&mut header, file, length, &layout, volumes, options)?;
    source.skip(&data, before)?;
    let samples = samples::read(&data, source, &layout, options)?;
    rescaled(&data, grid, samples, slope, intercept)
}

/// Voxels along each axis: 2, 3 or, for a series, 4.
fn sizes(header: &Header) -> Result<Vec<usize>> {
    let axes = header.whole(&["NDims"])?.ok_or_else(|| header.wrong(&["NDims"], "it counts the axes, 2 to 4"))?;
    let axes = usize::try_from(axes).ok().filter(|n| (2..=4).contains(n)).ok_or_else(|| header.wrong(&["NDims"], "2 to 4 are read"))?;
    let numbers = header.numbers(&["DimSize"], axes)?.ok_or_else(|| header.wrong(&["DimSize"], "it gives the voxels along each axis"))?;
    if numbers.iter().any(|n| n.fract() != 0.0 || !(1.0..=1048576.0).contains(n)) {
        return Err(header.wrong(&["DimSize"], "whole numbers, 1 to 1048576, are needed"));
    }
    Ok(numbers.into_iter().map(|n| n as usize).collect())
}

fn place(header: &Header, axes: usize, dims: [usize; 3]) -> Result<Grid> {
    let wanted = axes.min(3);
    let mut spacing = header.numbers(&["ElementSpacing"], axes)?;
    if spacing.is_none() {
        spacing = header.numbers(&["ElementSize"], axes)?;
    }
    let spacing = spacing.unwrap_or_else(|| vec![1.0; axes]);
    let origin = header.numbers(&["Offset", "Origin", "Position"], axes)?.unwrap_or_else(|| vec![0.0; axes]);
    let turn = header.numbers(&["TransformMatrix", "Orientation", "Rotation"], axes * axes)?;
    let mut columns = [DVec3::X, DVec3::Y, DVec3::Z];
    for (i, column) in columns.iter_mut().enumerate().take(wanted) {
        if let Some(turn) = &turn {
            *column = DVec3::from_array(std::array::from_fn(|j| if j < wanted { turn[i * axes + j] } else { 0.0 }));
        }
        *column *= spacing[i];
    }
    if wanted == 2 {
        // One slice, as thick as the shorter of its spacings.
        columns[2] *= columns[0].length().min(columns[1].length());
    }
    let matrix = DMat3::from_cols(columns[0], columns[1], columns[2]);
    let centre = DVec3::new(origin[0], origin[1], if wanted == 3 { origin[2] } else { 0.0 });
    grid(header.path, dims, DAffine3 { matrix3: matrix, translation: centre - matrix * DVec3::splat(0.5) })
}

fn kind(header: &Header) -> Result<SampleType> {
    let text = header.get(&["ElementType"]).ok_or_else(|| header.wrong(&["ElementType"], "such as ElementType = MET_SHORT"))?;
    // An array type says what `ElementNumberOfChannels` says, too. MetaIO's longs have 4 bytes.
    Ok(match text.strip_suffix("_ARRAY").unwrap_or(text) {
        "MET_CHAR" | "MET_ASCII_CHAR" => SampleType::I8,
        "MET_UCHAR" => SampleType::U8,
        "MET_SHORT" => SampleType::I16,
        "MET_USHORT" => SampleType::U16,
        "MET_INT" | "MET_LONG" => SampleType::I32,
        "MET_UINT" | "MET_ULONG" => SampleType::U32,
        "MET_LONG_LONG" => SampleType::I64,
        "MET_ULONG_LONG" => SampleType::U64,
        "MET_FLOAT" => SampleType::F32,
        "MET_DOUBLE" => SampleType::F64,
        _ => return Err(header.wrong(&["ElementType"], "MET_CHAR to MET_DOUBLE, integers and floats, are read")),
    })
}

/// Sets the layout's components; returns the bytes to skip before the wanted volume of a series.
fn components(header: &Header, sizes: &[usize], layout: &mut Layout, options: &ReadOptions) -> Result<u64> {
    let channels = header.whole(&["ElementNumberOfChannels"])?.unwrap_or(1);
    let channels = usize::try_from(channels).ok().filter(|n| (1..=samples::MAX_COMPONENTS).contains(n));
    let channels = channels.ok_or_else(|| header.wrong(&["ElementNumberOfChannels"], "1 to 65536 are read"))?;
    let volumes = sizes.get(3).copied().unwrap_or(1);
    if channels > 1 {
        if volumes > 1 {
            return Err(
                header.wrong(&["DimSize"], format!("a series of voxels with {channels} channels each is not read: cut one volume out"))
            );
        }
        let what = format!("each voxel has {channels} channels");
        let pick = choose::component(header.path, &what, channels, &[], None, options)?;
        (layout.components, layout.pick) = (channels, Some(pick));
        return Ok(0);
    }
    let pick = choose::component(header.path, &format!("it is a series of {volumes} volumes"), volumes, &[], None, options)?;
    if pick > 0 && layout.text {
        return Err(header.wrong(&["BinaryData"], "of a series in text, component 0 is read: cut the volume out"));
    }
    layout.more = pick + 1 < volumes;
    Ok(layout.stored_bytes().and_then(|n| n.checked_mul(pick as u64)).unwrap_or(u64::MAX))
}

/// The bytes of the samples, and the file that errors about them name.
fn samples_of(
    header: &mut Header,
    mut file: BufReader<File>,
    length: u64,
    layout: &Layout,
    volumes: u64,
    options: &ReadOptions,
) -> Result<(PathBuf, Source)> {
    let path = header.path;
    let name = header.get(&["ElementDataFile"]).unwrap_or_default().to_owned();
    let skip = header.whole(&["HeaderSize"])?.unwrap_or(0);
    if skip < -1 {
        return Err(header.wrong(&["HeaderSize"], "it is the number of bytes before the samples, or -1"));
    }
    let compressed = header.flag(&["CompressedData"])?.unwrap_or(false);
    let first = name.split_whitespace().next().unwrap_or_default();
    if first.eq_ignore_ascii_case("LIST") || name.contains('%') {
        if compressed || layout.text || skip != 0 || layout.more {
            return Err(header.wrong(&["ElementDataFile"], "of several files, uncompressed binary ones without header are read"));
        }
        let names = if name.contains('%') { pattern(header, &name, layout.dims[2])? } else { list(header, &mut file)? };
        return Ok((path.to_owned(), slabs(header, &names, layout, options)?));
    }
    let (data, mut file, length, at) = match name.as_str() {
        "" => return Err(header.wrong(&["ElementDataFile"], "LOCAL, or the name of the file with the samples, is needed")),
        "LOCAL" | "Local" | "local" => (path.to_owned(), file, length, header.end),
        _ => {
            let data = beside(path, &name, options.allow_outside)?;
            let (file, length) = open(&data)?;
            (data, file, length, 0)
        }
    };
    let start = match skip {
        // The samples are the last bytes of the file.
        -1 if !compressed && !layout.text => {
            let needs = layout.stored_bytes().and_then(|n| n.checked_mul(volumes)).unwrap_or(u64::MAX);
            length.checked_sub(needs).filter(|s| *s >= at).ok_or_else(|| {
                let what = format!("{} need {needs} bytes, the file holds {} there", layout.what(), length.saturating_sub(at));
                bad(&data, what, "the file is cut short or its header is wrong")
            })?
        }
        -1 => return Err(header.wrong(&["HeaderSize"], "-1 is possible with uncompressed binary data only")),
        0 => at,
        // Counted from the first byte of the file, also where the header is in it.
        n if n as u64 >= at => n as u64,
        _ => return Err(header.wrong(&["HeaderSize"], format!("it counts from the file's first byte, and the header ends at byte {at}"))),
    };
    if !compressed {
        return Ok((data.clone(), Source::new(&data, file, length, start, false)?));
    }
    let left = length.saturating_sub(start);
    let claimed = header.whole(&["CompressedDataSize"])?.and_then(|n| u64::try_from(n).ok()).filter(|n| *n > 0).unwrap_or(left);
    if claimed > left {
        let right = format!("the file holds {left} bytes there: it is cut short or its header is wrong");
        return Err(header.wrong(&["CompressedDataSize"], right));
    }
    // MetaIO reads both kinds of stream.
    file.seek(SeekFrom::Start(start)).map_err(|e| io(&data, "read", e))?;
    let mut mark = [0; 2];
    let gzip = matches!(fill(&mut file, &mut mark), (2, None)) && mark == [0x1f, 0x8b];
    let source = if gzip {
        Source::new(&data, file, start + claimed, start, true)?
    } else {
        file.seek(SeekFrom::Start(start)).map_err(|e| io(&data, "read", e))?;
        Source::zlib(file, claimed)
    };
    Ok((data, source))
}

/// The file names below "ElementDataFile = LIST".
fn list(header: &mut Header, file: &mut BufReader<File>) -> Result<Vec<String>> {
    let mut names = Vec::new();
    let mut line = Vec::new();
    while let Some(text) = header.line(file, &mut line)? {
        if !text.trim().is_empty() {
            names.push(text.trim().to_owned());
        }
    }
    Ok(names)
}

/// The file names of "slice%03d.raw 1 40 1": pattern, first, last, step. Without a last there is one per slice, from 1 without a
/// first, as MetaIO has it.
fn pattern(header: &Header, text: &str, slices: usize) -> Result<Vec<String>> {
    let right = "a pattern is such as 'slice%03d.raw 1 40 1': first, last and step";
    let wrong = || header.wrong(&["ElementDataFile"], right);
    let mut words: Vec<&str> = text.split_whitespace().collect();
    let numbers: Option<Vec<i64>> = words.split_off(1).iter().map(|w| w.parse().ok()).collect();
    let (first, last, step) = match numbers.ok_or_else(wrong)?[..] {
        [] => (1, slices as i64, 1),
        [first] => (first, first.saturating_add(slices as i64 - 1), 1),
        [first, last] => (first, last, 1),
        [first, last, step] => (first, last, step),
        _ => return Err(wrong()),
    };
    let (head, tail) = words[0].split_once('%').ok_or_else(wrong)?;
    let (width, tail) = tail.split_once('d').ok_or_else(wrong)?;
    let digits: usize = if width.is_empty() { 0 } else { width.parse().map_err(|_| wrong())? };
    if first < 0 || last < first || step < 1 || digits > 20 || (last - first) / step >= 1 << 16 {
        return Err(wrong());
    }
    let zeros = width.starts_with('0');
    let name = |n: i64| if zeros { format!("{head}{n:0digits$}{tail}") } else { format!("{head}{n:digits$}{tail}") };
    Ok((first..=last).step_by(step as usize).map(name).collect())
}

/// Files that each hold the same part of the samples, in order.
fn slabs(header: &Header, names: &[String], layout: &Layout, options: &ReadOptions) -> Result<Source> {
    let total = layout.stored_bytes().unwrap_or(u64::MAX);
    let count = names.len() as u64;
    if count == 0 || !(layout.dims[2] as u64).is_multiple_of(count) {
        let right = format!("{} slices must be spread evenly over them", layout.dims[2]);
        return Err(bad(header.path, format!("its samples lie in {count} files"), right));
    }
    let each = total / count;
    let mut files = Vec::new();
    for name in names {
        let path = beside(header.path, name, options.allow_outside)?;
        let (_, length) = open(&path)?;
        if length != each {
            let right = format!("each of its {count} files must hold {each}: {}", layout.what());
            return Err(bad(&path, format!("it holds {length} bytes"), right));
        }
        files.push(path);
    }
    Ok(parts(files.len(), each, move |i, bytes| {
        let (file, _) = open(&files[i])?;
        file.take(each).read_to_end(bytes).map(|_| ()).map_err(|e| io(&files[i], "read", e))
    }))
}
