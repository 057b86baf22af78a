//! VTK's legacy files, `.vtk`, with DATASET STRUCTURED_POINTS, ASCII or BINARY (big-endian). Format: "VTK File Formats",
//! <https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html>.
//!
//! ORIGIN is the first point. Values at points become voxels with their centres there; values of cells become voxels that
//! are those cells, one fewer along each axis, with ORIGIN as the corner of the first.

use super::ReadOptions;
use super::limits::{Source, bad, quote};
use super::samples::{self, Layout, SampleType};
use super::vtk_array::{Array, choose_array, image_grid};
use super::vtk_text::Text;
use crate::error::Result;
use crate::scene::{Samples, Volume};
use glam::{DMat3, DVec3};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Most arrays that are listed.
const MAX_ARRAYS: usize = 4096;

/// Where an array stands.
struct Place {
    array: Array,
    at: u64,
    /// Bytes written as shares of 255.
    shares: bool,
}

/// What the header says, as far as it was read.
#[derive(Default)]
struct Image {
    dims: Option<[usize; 3]>,
    origin: [f64; 3],
    /// The first point, which ORIGIN counts from 0.
    first: [i64; 3],
    spacing: Option<[f64; 3]>,
    /// Whether arrays that come are of cells; none before POINT_DATA or CELL_DATA.
    cells: Option<bool>,
    arrays: Vec<Place>,
}

/// Reads the volume in an opened legacy file of `length` bytes.
pub(super) fn read(path: &Path, file: BufReader<File>, length: u64, options: &ReadOptions) -> Result<Volume> {
    let mut text = Text { path, file, length, at: 0 };
    text.line()?;
    text.line()?;
    let binary = match text.word("ASCII or BINARY")?.to_ascii_uppercase().as_str() {
        "ASCII" => false,
        "BINARY" => true,
        other => return Err(bad(path, format!("line 3 is '{}'", quote(other)), "it must be ASCII or BINARY")),
    };
    let mut image = Image::default();
    while let Some((word, ended)) = text.word_and_end()? {
        if !keyword(&mut text, &word.to_ascii_uppercase(), ended, binary, &mut image)? {
            break;
        }
    }
    let points = image.dims.ok_or_else(|| bad(path, "DIMENSIONS are missing", "DIMENSIONS nx ny nz are needed"))?;
    let arrays: Vec<&Array> = image.arrays.iter().map(|p| &p.array).collect();
    let (chosen, pick) = choose_array(path, &arrays, None, options)?;
    let Place { array, at, shares } = &image.arrays[chosen];
    let axes = DMat3::from_diagonal(DVec3::from(image.spacing.unwrap_or([1.0; 3])));
    let low = DVec3::from(image.origin) + axes * DVec3::from(image.first.map(|n| n as f64));
    let grid = image_grid(path, points, axes, low, array.cells)?;
    let layout = Layout {
        components: array.components,
        pick: Some(pick),
        more: true,
        big_endian: true,
        text: !binary,
        replace: options.nan_as,
        ..Layout::scalar(grid.dims(), array.kind)
    };
    let source = Source::new(path, text.file, length, *at, false)?;
    let samples = match samples::read(path, source, &layout, options)? {
        // As vtkDataReader brings them back.
        Samples::F32(shares_of) if *shares => Samples::U8(shares_of.into_iter().map(|v| (255.0 * v + 0.5) as u8).collect()),
        samples => samples,
    };
    Volume::new(grid, samples, 1.0, 0.0)
}

/// Takes a keyword and what belongs to it; false where nothing behind it can be read.
fn keyword(text: &mut Text, word: &str, ended: bool, binary: bool, image: &mut Image) -> Result<bool> {
    let path = text.path;
    match word {
        "DATASET" => {
            let kind = text.word("the kind of dataset")?;
            if !kind.eq_ignore_ascii_case("STRUCTURED_POINTS") {
                let right = "DATASET STRUCTURED_POINTS is read: a volume with even spacing (ParaView: Resample To Image)";
                return Err(bad(path, format!("its dataset is '{}'", quote(&kind)), right));
            }
        }
        "DIMENSIONS" => {
            let mut dims = [0; 3];
            for n in &mut dims {
                *n = text.number("a number of DIMENSIONS")?;
                if !(1..=1usize << 20).contains(n) {
                    return Err(bad(path, format!("its DIMENSIONS have {n}"), "1 to 1048576 are read"));
                }
            }
            (image.dims, image.first) = (Some(dims), [0; 3]);
        }
        // As vtkStructuredPointsWriter's WriteExtent puts it, in place of DIMENSIONS.
        "EXTENT" => {
            let mut dims = [0; 3];
            for (n, first) in dims.iter_mut().zip(&mut image.first) {
                *first = text.number("a number of EXTENT")?;
                let last: i64 = text.number("a number of EXTENT")?;
                *n = last.checked_sub(*first).and_then(|d| usize::try_from(d).ok()).filter(|d| *d < 1 << 20).map(|d| d + 1).ok_or_else(
                    || {
                        let right = "1 to 1048576 points, the last not before the first";
                        bad(path, format!("its EXTENT runs from {first} to {last} along an axis"), right)
                    },
                )?;
            }
            image.dims = Some(dims);
        }
        "ORIGIN" => {
            for v in &mut image.origin {
                *v = text.number("a number of ORIGIN")?;
            }
        }
        "SPACING" | "ASPECT_RATIO" => {
            let mut spacing = [1.0; 3];
            for v in &mut spacing {
                *v = text.number("a number of SPACING")?;
            }
            image.spacing = Some(spacing);
        }
        "POINT_DATA" | "CELL_DATA" => {
            let count: u64 = text.number("a number of points or cells")?;
            let cells = word == "CELL_DATA";
            let dims = image.dims.ok_or_else(|| bad(path, format!("{word} stands before DIMENSIONS"), "DIMENSIONS come first"))?;
            let expected: u64 = dims.iter().map(|&n| if cells { n as u64 - 1 } else { n as u64 }.max(1)).product();
            if count != expected {
                let what = format!("{word} has {count} tuples for {}x{}x{} points", dims[0], dims[1], dims[2]);
                return Err(bad(path, what, format!("{expected} are needed")));
            }
            image.cells = Some(cells);
        }
        "METADATA" => {
            // It ends with an empty line.
            if !ended {
                text.line()?;
            }
            while !text.line()?.is_empty() {}
        }
        "LOOKUP_TABLE" => {
            text.word("the name of a lookup table")?;
            let size = text.last("the size of a lookup table")?;
            let size: u64 = text.parse(&size, "the size of a lookup table")?;
            return text.skip(size.saturating_mul(4), SampleType::U8, binary);
        }
        "FIELD" => {
            text.word("the name of a field")?;
            let count: usize = text.number("the number of a field's arrays")?;
            for _ in 0..count {
                if !field_array(text, binary, image)? {
                    return Ok(false);
                }
            }
        }
        _ => return attribute(text, word, binary, image),
    }
    Ok(true)
}

/// SCALARS, VECTORS and their like: a name, a type, and a tuple per point or cell.
fn attribute(text: &mut Text, word: &str, binary: bool, image: &mut Image) -> Result<bool> {
    let path = text.path;
    let known =
        ["SCALARS", "COLOR_SCALARS", "VECTORS", "NORMALS", "TEXTURE_COORDINATES", "TENSORS", "TENSORS6", "GLOBAL_IDS", "PEDIGREE_IDS"];
    if !known.contains(&word) {
        let at = text.at.saturating_sub(word.len() as u64 + 1);
        return Err(bad(
            path,
            format!("'{}' stands at byte {at} where a keyword is due", quote(word)),
            "the file is damaged, or not of this kind",
        ));
    }
    let name = text.word("the name of an array")?;
    let colors = || if binary { "unsigned_char".to_owned() } else { "float".to_owned() };
    let (kind, components) = match word {
        "COLOR_SCALARS" => {
            let components = text.last("a number of components")?;
            (colors(), text.parse(&components, "a number of components")?)
        }
        "TEXTURE_COORDINATES" => {
            let components = text.number("a number of components")?;
            (text.last("the type of an array")?, components)
        }
        "SCALARS" => {
            let kind = text.word("the type of an array")?;
            // The type and, maybe, the number of components are one line; a lookup table is another.
            let mut next = text.word("LOOKUP_TABLE")?;
            let mut components = 1;
            if !next.eq_ignore_ascii_case("LOOKUP_TABLE") {
                components = next.parse().map_err(|_| {
                    bad(path, format!("'{}' stands behind SCALARS {}", quote(&next), quote(&name)), "LOOKUP_TABLE default is due there")
                })?;
                next = text.word("LOOKUP_TABLE")?;
            }
            if !next.eq_ignore_ascii_case("LOOKUP_TABLE") {
                let what = format!("'{}' stands behind SCALARS {}", quote(&next), quote(&name));
                return Err(bad(path, what, "LOOKUP_TABLE default is due there"));
            }
            text.line()?;
            (kind, components)
        }
        "VECTORS" | "NORMALS" => (text.last("the type of an array")?, 3),
        "TENSORS" => (text.last("the type of an array")?, 9),
        "TENSORS6" => (text.last("the type of an array")?, 6),
        _ => (text.last("the type of an array")?, 1),
    };
    let tuples =
        tuples(image).ok_or_else(|| bad(path, format!("{word} stands before POINT_DATA"), "POINT_DATA or CELL_DATA come first"))?;
    let known = image.arrays.len();
    let more = array(text, &name, &kind, components, tuples, binary, image)?;
    // What VTK's writers make of every image of unsigned char.
    image.arrays.iter_mut().skip(known).for_each(|place| place.shares = word == "COLOR_SCALARS" && !binary);
    Ok(more)
}

/// "name components tuples type" and its values.
fn field_array(text: &mut Text, binary: bool, image: &mut Image) -> Result<bool> {
    let mut name = text.word("the name of a field's array")?;
    if name == "METADATA" {
        text.line()?;
        while !text.line()?.is_empty() {}
        name = text.word("the name of a field's array")?;
    }
    let components: usize = text.number("a number of components")?;
    let tuples: u64 = text.number("a number of tuples")?;
    let kind = text.last("the type of an array")?;
    array(text, &name, &kind, components, tuples, binary, image)
}

/// Tuples that an array has.
fn tuples(image: &Image) -> Option<u64> {
    let (dims, cells) = (image.dims?, image.cells?);
    Some(dims.iter().map(|&n| if cells { n as u64 - 1 } else { n as u64 }.max(1)).product())
}

/// Notes an array and goes beyond its values.
fn array(text: &mut Text, name: &str, kind: &str, components: usize, count: u64, binary: bool, image: &mut Image) -> Result<bool> {
    let path = text.path;
    let name = decoded(name);
    let Some(kind) = sample_type(kind) else {
        // How long it is cannot be known: what was found before it still can be read.
        log::warn!("{}: array '{}' is of type {}; it and what follows is left out", crate::error::shown(path), quote(&name), quote(kind));
        return Ok(false);
    };
    if components == 0 || components > samples::MAX_COMPONENTS || image.arrays.len() == MAX_ARRAYS {
        let what = format!("array '{}' has {components} components, {} arrays stand before it", quote(&name), image.arrays.len());
        return Err(bad(path, what, format!("1 to {} components and {MAX_ARRAYS} arrays are read", samples::MAX_COMPONENTS)));
    }
    let at = text.at;
    if let Some(cells) = image.cells.filter(|_| tuples(image) == Some(count)) {
        image.arrays.push(Place { array: Array { name, kind, components, cells }, at, shares: false });
    }
    text.skip(count.saturating_mul(components as u64), kind, binary)
}

fn sample_type(name: &str) -> Option<SampleType> {
    Some(match name.to_ascii_lowercase().as_str() {
        "char" | "signed_char" => SampleType::I8,
        "unsigned_char" => SampleType::U8,
        "short" => SampleType::I16,
        "unsigned_short" => SampleType::U16,
        // Ids are written as 32 bits.
        "int" | "vtkidtype" => SampleType::I32,
        "unsigned_int" => SampleType::U32,
        "long" | "long_long" | "vtktypeint64" => SampleType::I64,
        "unsigned_long" | "unsigned_long_long" | "vtktypeuint64" => SampleType::U64,
        "float" => SampleType::F32,
        "double" => SampleType::F64,
        _ => return None,
    })
}

/// A name with its %20 resolved.
fn decoded(name: &str) -> String {
    let bytes = name.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let code = bytes.get(i + 1..i + 3).and_then(|h| std::str::from_utf8(h).ok()).and_then(|h| u8::from_str_radix(h, 16).ok());
        match code.filter(|_| bytes[i] == b'%') {
            Some(code) => {
                out.push(code);
                i += 3;
            }
            None => {
                out.push(bytes[i]);
                i += 1;
            }
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}
