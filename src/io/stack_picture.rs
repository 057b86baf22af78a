//! TIFF and PNG pictures as slices: what a file holds, and its samples, as they are stored.

use super::limits::{bad, io, open, quote};
use super::samples::SampleType;
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufReader, ErrorKind, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use tiff::decoder::{Decoder, DecodingSampleType, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

/// Largest slice, bytes, and most pages.
const MAX_SLICE: usize = 1 << 31;
const MAX_PAGES: usize = 1 << 16;

/// No coding that is read here yields more than this many bytes from one (LZW: 4 KiB from 12 bits).
const MAX_RATIO: u64 = 4096;

/// What a slice holds.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Form {
    pub width: usize,
    pub height: usize,
    /// Samples per pixel, beside each other.
    pub channels: usize,
    pub kind: SampleType,
    /// "grey", "RGB", …
    pub color: &'static str,
    /// Stored as 16-bit floats, handed on as 32-bit ones.
    half: bool,
}

impl Form {
    /// "64x48 uint8, grey".
    pub fn says(&self, pages: usize) -> String {
        let pages = if pages == 1 { String::new() } else { format!(", {pages} pages") };
        format!("{}x{} {}, {}{pages}", self.width, self.height, self.kind.name(), self.color)
    }

    /// Labels of the channels, where they have some.
    pub fn labels(&self) -> Vec<String> {
        let labels: &[&str] = match self.color {
            "grey and alpha" => &["grey", "A"],
            "RGB" => &["R", "G", "B"],
            "RGBA" => &["R", "G", "B", "A"],
            "CMYK" => &["C", "M", "Y", "K"],
            "YCbCr" => &["Y", "Cb", "Cr"],
            "Lab" => &["L", "a", "b"],
            _ => &[],
        };
        labels.iter().map(|l| (*l).to_owned()).collect()
    }

    fn bytes(&self) -> usize {
        self.width * self.height * self.channels * self.kind.bytes() as usize
    }
}

/// Whether these bytes begin a TIFF or PNG file.
pub(in crate::io) fn is_picture(head: &[u8]) -> bool {
    is_png(head) || [&b"II*\0"[..], b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|m| head.starts_with(m))
}

fn is_png(head: &[u8]) -> bool {
    head.starts_with(&super::png::MAGIC)
}

/// What a file holds, and which of its pages are slices.
pub(super) fn form(path: &Path) -> Result<(Form, Vec<usize>)> {
    let (mut file, length) = open(path)?;
    let mut head = [0; 8];
    let (n, error) = super::limits::fill(&mut file, &mut head);
    if let Some(e) = error {
        return Err(io(path, "read", e));
    }
    if is_png(&head[..n]) {
        return Ok((png_reader(path)?.1, vec![0]));
    }
    if !is_picture(&head[..n]) {
        return Err(bad(path, format!("it begins with '{}'", quote(&String::from_utf8_lossy(&head[..n]))), "a TIFF or PNG file is needed"));
    }
    tiff_form(path, length)
}

/// Loads the pages of a file, which must be asked for in ascending order.
pub(super) fn pages(path: PathBuf, form: Form, pages: Vec<usize>) -> Result<impl FnMut(usize, &mut Vec<u8>) -> Result<()> + 'static> {
    let (mut file, length) = open(&path)?;
    let mut head = [0; 8];
    super::limits::fill(&mut file, &mut head);
    let mut decoder = if is_png(&head) { None } else { Some(tiff(&path, length)?) };
    let mut at = 0;
    Ok(move |i: usize, bytes: &mut Vec<u8>| {
        let Some(decoder) = &mut decoder else { return png_bytes(&path, &form, bytes) };
        while at < pages[i] {
            decoder.next_image().map_err(|e| trouble(&path, e))?;
            at += 1;
        }
        let found = tiff_page(&path, decoder, length)?;
        if found != form {
            let what = format!("page {} is {}, page {} is {}", pages[i], found.says(1), pages[0], form.says(1));
            return Err(bad(&path, what, "all slices must have the same size and type"));
        }
        tiff_bytes(&path, decoder, &form, bytes)
    })
}

/// Room for `count` bytes, or an error.
fn room(path: &Path, bytes: &mut Vec<u8>, count: usize) -> Result<()> {
    bytes.try_reserve_exact(count).map_err(|_| {
        let what = format!("{} of host memory for a slice are not to be had", crate::error::bytes(count as u64));
        io(path, "read", std::io::Error::new(ErrorKind::OutOfMemory, what))
    })?;
    bytes.resize(count, 0);
    Ok(())
}

fn png_trouble(path: &Path, e: png::DecodingError) -> Error {
    match e {
        png::DecodingError::IoError(source) if source.kind() != ErrorKind::UnexpectedEof => io(path, "read", source),
        other => bad(path, format!("PNG: {}", quote(&other.to_string())), "a whole, undamaged picture is needed"),
    }
}

fn png_reader(path: &Path) -> Result<(png::Reader<BufReader<File>>, Form)> {
    let (file, length) = open(path)?;
    let mut decoder = png::Decoder::new(file);
    // Palettes become colours, and samples of 1 to 4 bits 8 bits, spread over 0..255.
    decoder.set_transformations(png::Transformations::EXPAND);
    let reader = decoder.read_info().map_err(|e| png_trouble(path, e))?;
    let (color, depth) = reader.output_color_type();
    let kind = if depth == png::BitDepth::Sixteen { SampleType::U16 } else { SampleType::U8 };
    let color = match color {
        png::ColorType::Grayscale => "grey",
        png::ColorType::GrayscaleAlpha => "grey and alpha",
        png::ColorType::Rgb => "RGB",
        _ => "RGBA",
    };
    let channels = reader.output_color_type().0.samples();
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let form = Form { width, height, channels, kind, color, half: false };
    let size = width.checked_mul(height).and_then(|n| n.checked_mul(channels * kind.bytes() as usize));
    check_size(path, &form, size, length)?;
    Ok((reader, form))
}

/// Refuses a slice that is too large, or that its file cannot hold.
fn check_size(path: &Path, form: &Form, size: Option<usize>, length: u64) -> Result<()> {
    match size.filter(|n| *n <= MAX_SLICE) {
        None => Err(bad(path, format!("it is {}", form.says(1)), "slices of at most 2 GiB are read")),
        Some(n) if n as u64 / MAX_RATIO > length => {
            Err(bad(path, format!("it is {}, more than its {length} bytes can hold", form.says(1)), "the file is cut short or damaged"))
        }
        Some(_) => Ok(()),
    }
}

fn png_bytes(path: &Path, form: &Form, bytes: &mut Vec<u8>) -> Result<()> {
    let (mut reader, found) = png_reader(path)?;
    let size = reader.output_buffer_size().filter(|n| found == *form && *n == form.bytes());
    let Some(size) = size else { return Err(bad(path, format!("it is {}", found.says(1)), "all slices must have the same size and type")) };
    room(path, bytes, size)?;
    reader.next_frame(bytes).map_err(|e| png_trouble(path, e))?;
    if form.kind == SampleType::U16 && cfg!(target_endian = "little") {
        bytes.as_chunks_mut::<2>().0.iter_mut().for_each(|c| c.swap(0, 1));
    }
    Ok(())
}

fn tiff(path: &Path, length: u64) -> Result<Decoder<BufReader<File>>> {
    let (mut file, _) = open(path)?;
    check_directory(path, &mut file, length)?;
    file.rewind().map_err(|e| io(path, "read", e))?;
    let mut limits = Limits::default();
    let whole = usize::try_from(length).unwrap_or(usize::MAX);
    // A table of strips is no longer than its file, though its numbers are held in more bytes; pixels go to our own room.
    limits.ifd_value_size = whole.min(64 << 20);
    limits.decoding_buffer_size = whole.saturating_mul(32).min(MAX_SLICE);
    limits.intermediate_buffer_size = whole.saturating_mul(MAX_RATIO as usize).min(MAX_SLICE);
    Ok(Decoder::new(file).map_err(|e| trouble(path, e))?.with_limits(limits))
}

/// Refuses a first directory whose tags claim more values than the file has bytes: the decoder reads it before it takes
/// limits.
fn check_directory(path: &Path, file: &mut BufReader<File>, length: u64) -> Result<()> {
    let cut = || bad(path, "TIFF: it ends within its first directory", "the file is cut short or damaged");
    let mut read = |at: Option<u64>, size: usize, big: bool| -> Result<u64> {
        if let Some(at) = at.filter(|at| *at <= length) {
            file.seek(SeekFrom::Start(at)).map_err(|e| io(path, "read", e))?;
        } else if at.is_some() {
            return Err(cut());
        }
        let mut raw = [0; 8];
        if super::limits::fill(file, &mut raw[..size]).0 < size {
            return Err(cut());
        }
        if big {
            raw[..size].reverse();
        }
        Ok(u64::from_le_bytes(raw))
    };
    let big = read(Some(0), 1, false)? == u64::from(b'M');
    let wide = read(Some(2), 2, big)? == 43;
    let first = if wide { read(Some(8), 8, big)? } else { read(Some(4), 4, big)? };
    let tags = read(Some(first), if wide { 8 } else { 2 }, big)?;
    for _ in 0..tags.min(1 << 16) {
        let tag = read(None, 2, big)?;
        read(None, 2, big)?;
        let count = read(None, if wide { 8 } else { 4 }, big)?;
        if count > length {
            return Err(bad(
                path,
                format!("TIFF: tag {tag} claims {count} values, the file has {length} bytes"),
                "an undamaged file is needed",
            ));
        }
        read(None, if wide { 8 } else { 4 }, big)?;
    }
    Ok(())
}

/// The form of the first page, and all pages that are no thumbnails.
fn tiff_form(path: &Path, length: u64) -> Result<(Form, Vec<usize>)> {
    let mut decoder = tiff(path, length)?;
    let mut form = None;
    let mut pages = Vec::new();
    for page in 0.. {
        let reduced: Option<u32> = decoder.find_tag_unsigned(Tag::NewSubfileType).map_err(|e| trouble(path, e))?;
        if reduced.unwrap_or(0) & 1 == 0 {
            if form.is_none() {
                form = Some(tiff_page(path, &mut decoder, length)?);
            }
            pages.push(page);
        }
        if !decoder.more_images() {
            break;
        }
        if page == MAX_PAGES {
            return Err(bad(path, format!("it has more than {MAX_PAGES} pages"), "fewer are read"));
        }
        decoder.next_image().map_err(|e| trouble(path, e))?;
    }
    match form {
        Some(form) => Ok((form, pages)),
        None => Err(bad(path, "all of its pages are thumbnails", "a page of full resolution is needed")),
    }
}

/// What the present page holds.
fn tiff_page(path: &Path, decoder: &mut Decoder<BufReader<File>>, length: u64) -> Result<Form> {
    let (width, height) = decoder.dimensions().map_err(|e| trouble(path, e))?;
    let color = decoder.colortype().map_err(|e| trouble(path, e))?;
    let layout = decoder.image_buffer_layout().map_err(|e| trouble(path, e))?;
    let (kind, half) = match layout.sample_type {
        Some(DecodingSampleType::U8) => (SampleType::U8, false),
        Some(DecodingSampleType::I8) => (SampleType::I8, false),
        Some(DecodingSampleType::U16) => (SampleType::U16, false),
        Some(DecodingSampleType::I16) => (SampleType::I16, false),
        Some(DecodingSampleType::U32) => (SampleType::U32, false),
        Some(DecodingSampleType::I32) => (SampleType::I32, false),
        Some(DecodingSampleType::U64) => (SampleType::U64, false),
        Some(DecodingSampleType::I64) => (SampleType::I64, false),
        Some(DecodingSampleType::F16) => (SampleType::F32, true),
        Some(DecodingSampleType::F32) => (SampleType::F32, false),
        Some(DecodingSampleType::F64) => (SampleType::F64, false),
        None => return Err(bad(path, format!("its samples have {} bits", color.bit_depth()), "8, 16, 32 and 64 bits are read")),
    };
    let stored = if half { 2 } else { kind.bytes() };
    if u64::from(color.bit_depth()) != 8 * stored {
        return Err(bad(
            path,
            format!("its samples have {} bits", color.bit_depth()),
            "8, 16, 32 and 64 bits are read: save it with 8 or 16",
        ));
    }
    if layout.planes > 1 {
        return Err(bad(
            path,
            format!("its {} channels lie in planes of their own", layout.planes),
            "channels beside each other are read (PlanarConfiguration 1)",
        ));
    }
    let channels = usize::from(color.num_samples());
    let color = match color {
        ColorType::Gray(_) => "grey",
        ColorType::GrayA(_) => "grey and alpha",
        ColorType::Palette(_) => "an index of a palette",
        ColorType::RGB(_) => "RGB",
        ColorType::RGBA(_) => "RGBA",
        ColorType::CMYK(_) => "CMYK",
        ColorType::YCbCr(_) => "YCbCr",
        ColorType::Lab(_) => "Lab",
        _ if channels == 1 => "grey",
        _ => "several bands",
    };
    let form = Form { width: width as usize, height: height as usize, channels, kind, color, half };
    let size = form.width.checked_mul(form.height).and_then(|n| n.checked_mul(channels * kind.bytes() as usize));
    check_size(path, &form, size, length)?;
    if size != layout.complete_len.checked_mul(if half { 2 } else { 1 }) {
        let what = format!("it is {}, and its layout has {} bytes", form.says(1), layout.complete_len);
        return Err(bad(path, what, "whole, evenly sampled pixels are read"));
    }
    Ok(form)
}

fn tiff_bytes(path: &Path, decoder: &mut Decoder<BufReader<File>>, form: &Form, bytes: &mut Vec<u8>) -> Result<()> {
    let size = form.bytes();
    if !form.half {
        room(path, bytes, size)?;
        return decoder.read_image_bytes(bytes).map_err(|e| trouble(path, e));
    }
    let mut raw = Vec::new();
    room(path, &mut raw, size / 2)?;
    decoder.read_image_bytes(&mut raw).map_err(|e| trouble(path, e))?;
    room(path, bytes, size)?;
    for (out, half) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(raw.as_chunks::<2>().0) {
        *out = half::f16::from_ne_bytes(*half).to_f32().to_ne_bytes();
    }
    Ok(())
}

fn trouble(path: &Path, e: TiffError) -> Error {
    match e {
        TiffError::IoError(source) if source.kind() != ErrorKind::UnexpectedEof => io(path, "read", source),
        TiffError::UnsupportedError(what) => {
            let right = "uncompressed, PackBits, LZW and Deflate are read: save it again so";
            bad(path, format!("TIFF: {}", quote(&what.to_string())), right)
        }
        other => bad(path, format!("TIFF: {}", quote(&other.to_string())), "a whole, undamaged file is needed"),
    }
}
