//! VTK ImageData, `.vti`: ascii, base64 or appended, plain or compressed (zlib, LZ4, LZMA). Format: "VTK XML Formats",
//! <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>. The XML is read tag by tag; the samples are
//! never held as text.
//!
//! `Origin` is the point (0, 0, 0) of the extent, also where the piece begins elsewhere. Values at points become voxels
//! with their centres there; values of cells become voxels that are those cells.

use super::ReadOptions;
use super::limits::{Source, bad, quote};
use super::samples::{self, Layout, SampleType};
use super::vti_blocks::Packing;
use super::vti_data::{Coding, Place, data};
use super::vtk_array::{Array, choose_array, image_grid};
use super::xml::{Form, Tag, Tags};
use crate::error::Result;
use crate::scene::Volume;
use glam::{DMat3, DVec3};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Most arrays, and most tags, that are looked at.
const MAX_ARRAYS: usize = 4096;
const MAX_TAGS: usize = 1 << 18;

/// Whether these bytes begin a VTK XML file.
pub(super) fn is_header(head: &[u8]) -> bool {
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head).trim_ascii_start();
    head.starts_with(b"<VTKFile") || (head.starts_with(b"<?xml") && head.windows(8).any(|w| w == b"<VTKFile"))
}

/// What the XML says.
#[derive(Default)]
struct Image {
    coding: Coding,
    whole: Option<[i64; 6]>,
    piece: Option<[i64; 6]>,
    origin: DVec3,
    spacing: Option<DVec3>,
    direction: Option<DMat3>,
    /// Name of the array that PointData calls its scalars.
    scalars: Option<String>,
    arrays: Vec<(Array, Place)>,
    /// Where appended data begin, and whether as base64.
    appended: Option<(u64, bool)>,
}

/// Reads the volume in an opened `.vti` file of `length` bytes.
pub(super) fn read(path: &Path, file: BufReader<File>, length: u64, options: &ReadOptions) -> Result<Volume> {
    let mut tags = Tags::new(path, file);
    let image = header(path, &mut tags)?;
    let extent = image.piece.or(image.whole).ok_or_else(|| bad(path, "it has no piece of ImageData", "<Piece Extent=\"…\"> is needed"))?;
    if image.whole.is_some_and(|whole| whole != extent) {
        log::warn!("{}: its piece is a part of the whole extent; the volume is that part", crate::error::shown(path));
    }
    let points = points(path, extent)?;
    let axes = image.direction.unwrap_or(DMat3::IDENTITY) * DMat3::from_diagonal(image.spacing.unwrap_or(DVec3::ONE));
    let low = DVec3::new(extent[0] as f64, extent[2] as f64, extent[4] as f64);
    let arrays: Vec<&Array> = image.arrays.iter().map(|(a, _)| a).collect();
    let default = arrays.iter().position(|a| !a.cells && Some(&a.name) == image.scalars.as_ref());
    let (chosen, pick) = choose_array(path, &arrays, default, options)?;
    let (array, place) = &image.arrays[chosen];
    let grid = image_grid(path, points, axes, image.origin + axes * low, array.cells)?;
    let layout = Layout {
        components: array.components,
        pick: Some(pick),
        big_endian: image.coding.big_endian,
        text: matches!(place, Place::Text(_)),
        replace: options.nan_as,
        ..Layout::scalar(grid.dims(), array.kind)
    };
    let source: Source = data(path, tags.file, length, place, image.appended, &image.coding, &layout)?;
    Volume::new(grid, samples::read(path, source, &layout, options)?, 1.0, 0.0)
}

/// All up to the appended data, or to the end.
fn header(path: &Path, tags: &mut Tags<BufReader<File>>) -> Result<Image> {
    let mut image = Image::default();
    // In which of PointData and CellData tags stand.
    let mut cells = None;
    for count in 0.. {
        if count == MAX_TAGS {
            return Err(bad(path, format!("it has more than {MAX_TAGS} tags"), "an image has some dozens"));
        }
        let Some(tag) = tags.next()? else { break };
        match (tag.name.as_str(), tag.form) {
            ("VTKFile", Form::Open) => image.coding = coding(path, &tag)?,
            ("ImageData", Form::Open | Form::Empty) => {
                image.whole = extent(path, &tag, "WholeExtent")?;
                image.origin = numbers::<3>(path, &tag, "Origin")?.map_or(DVec3::ZERO, DVec3::from);
                image.spacing = numbers::<3>(path, &tag, "Spacing")?.map(DVec3::from);
                // Row by row in the file.
                image.direction = numbers::<9>(path, &tag, "Direction")?.map(|d| DMat3::from_cols_array(&d).transpose());
            }
            ("Piece", Form::Open) => {
                if image.piece.is_some() {
                    return Err(bad(
                        path,
                        "it has several pieces",
                        "one piece is read: vtkXMLImageDataWriter writes one where NumberOfPieces is 1",
                    ));
                }
                image.piece = extent(path, &tag, "Extent")?.or(image.whole);
            }
            ("PointData" | "CellData", Form::Open) => {
                cells = Some(tag.name == "CellData");
                if tag.name == "PointData" {
                    image.scalars = tag.get("Scalars").map(str::to_owned);
                }
            }
            ("PointData" | "CellData", Form::Close) => cells = None,
            ("DataArray", Form::Open | Form::Empty) => {
                let place = place(path, tags, &tag)?;
                if let (Some(cells), Some(place)) = (cells, place) {
                    take(path, &tag, cells, place, &mut image)?;
                }
            }
            ("AppendedData", Form::Open) => {
                let base64 = match tag.get("encoding") {
                    Some("raw") => false,
                    Some("base64") | None => true,
                    Some(other) => return Err(bad(path, format!("its appended data are '{}'", quote(other)), "raw and base64 are read")),
                };
                image.appended = Some((tag.end, base64));
                break;
            }
            _ => {}
        }
    }
    Ok(image)
}

fn coding(path: &Path, tag: &Tag) -> Result<Coding> {
    let kind = tag.get("type").unwrap_or_default();
    if kind != "ImageData" {
        let right = "type=\"ImageData\" is read (of a parallel file, .pvti, its pieces are)";
        return Err(bad(path, format!("it is a VTK file of type '{}'", quote(kind)), right));
    }
    let big_endian = match tag.get("byte_order") {
        Some("LittleEndian") | None => false,
        Some("BigEndian") => true,
        Some(other) => return Err(bad(path, format!("its byte order is '{}'", quote(other)), "LittleEndian or BigEndian")),
    };
    let wide = match tag.get("header_type") {
        Some("UInt32") | None => false,
        Some("UInt64") => true,
        Some(other) => return Err(bad(path, format!("its header_type is '{}'", quote(other)), "UInt32 and UInt64 are read")),
    };
    let packing = match tag.get("compressor") {
        None | Some("") => None,
        Some(name) => Some(Packing::of_compressor(name).ok_or_else(|| {
            let right = "VTK's ZLib, LZ4 and LZMA compressors, or none, are read: save it again with one of them";
            bad(path, format!("it is compressed with {}", quote(name)), right)
        })?),
    };
    Ok(Coding { big_endian, wide, packing })
}

/// Where the values of an array lie; reads up to its closing tag.
fn place(path: &Path, tags: &mut Tags<BufReader<File>>, open: &Tag) -> Result<Option<Place>> {
    let mut text = None;
    if open.form == Form::Open {
        loop {
            let Some(tag) = tags.next()? else {
                return Err(bad(path, format!("the DataArray at byte {} does not end", open.start), "the file is cut short"));
            };
            if let Some(at) = tag.text {
                text.get_or_insert((at, tag.start));
            }
            if tag.name == "DataArray" && tag.form == Form::Close {
                break;
            }
        }
    }
    Ok(match open.get("format").unwrap_or("ascii") {
        "appended" => match open.get("offset").map(str::parse::<u64>) {
            Some(Ok(offset)) => Some(Place::Appended(offset)),
            _ => return Err(bad(path, format!("the DataArray at byte {} has no usable offset", open.start), "appended data need one")),
        },
        "ascii" => text.map(Place::Text),
        "binary" => text.map(Place::Inline),
        other => return Err(bad(path, format!("a DataArray has the format '{}'", quote(other)), "ascii, binary and appended are read")),
    })
}

/// Notes an array of numbers.
fn take(path: &Path, tag: &Tag, cells: bool, place: Place, image: &mut Image) -> Result<()> {
    let name = tag.get("Name").unwrap_or("unnamed").to_owned();
    let kind = tag.get("type").unwrap_or_default();
    // Strings and bits are no samples.
    let Some(kind) = SampleType::from_name(kind) else {
        log::debug!("{}: array '{}' is of type '{}', and left out", crate::error::shown(path), quote(&name), quote(kind));
        return Ok(());
    };
    let components = match tag.get("NumberOfComponents").map(str::parse::<usize>) {
        None => 1,
        Some(Ok(n)) if (1..=samples::MAX_COMPONENTS).contains(&n) => n,
        _ => return Err(bad(path, format!("array '{}' has an unusable NumberOfComponents", quote(&name)), "1 to 65536 are read")),
    };
    let labels: usize = image.arrays.iter().map(|(a, _)| a.components).sum();
    if image.arrays.len() == MAX_ARRAYS || labels + components > 2 * samples::MAX_COMPONENTS {
        return Err(bad(path, "it has too many arrays or components", format!("at most {MAX_ARRAYS} arrays are read")));
    }
    image.arrays.push((Array { name, kind, components, cells }, place));
    Ok(())
}

/// The numbers of an attribute.
fn numbers<const N: usize>(path: &Path, tag: &Tag, name: &str) -> Result<Option<[f64; N]>> {
    let Some(text) = tag.get(name) else { return Ok(None) };
    let numbers: Option<Vec<f64>> = text.split_whitespace().take(N + 1).map(|w| w.parse().ok()).collect();
    match numbers.and_then(|v| <[f64; N]>::try_from(v).ok()) {
        Some(v) => Ok(Some(v)),
        None => Err(bad(path, format!("{} {name}=\"{}\"", tag.name, quote(text)), format!("{N} numbers are needed"))),
    }
}

fn extent(path: &Path, tag: &Tag, name: &str) -> Result<Option<[i64; 6]>> {
    let Some(text) = tag.get(name) else { return Ok(None) };
    let numbers: Option<Vec<i64>> = text.split_whitespace().take(7).map(|w| w.parse().ok()).collect();
    match numbers.and_then(|v| <[i64; 6]>::try_from(v).ok()) {
        Some(v) => Ok(Some(v)),
        None => Err(bad(path, format!("{} {name}=\"{}\"", tag.name, quote(text)), "six whole numbers are needed: first and last per axis")),
    }
}

/// Points along each axis.
fn points(path: &Path, extent: [i64; 6]) -> Result<[usize; 3]> {
    let mut points = [0; 3];
    for (a, n) in points.iter_mut().enumerate() {
        let (first, last) = (extent[2 * a], extent[2 * a + 1]);
        *n = last
            .checked_sub(first)
            .and_then(|d| usize::try_from(d).ok())
            .and_then(|d| d.checked_add(1))
            .filter(|n| *n <= 1 << 20)
            .ok_or_else(|| {
                bad(
                    path,
                    format!("its extent runs from {first} to {last} along an axis"),
                    "1 to 1048576 points, the last not before the first",
                )
            })?;
    }
    Ok(points)
}
