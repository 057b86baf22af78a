//! TIFF and PNG pictures as slices: what a file holds, and its samples, as they are stored.

use super::limits::{bad, io, open, quote};
use super::samples::SampleType;
use super::stack_axes::{Axes, Said};
use super::stack_tiff as tiff;
use crate::error::{Error, Result, shown};
use crate::room::more;
use std::fs::File;
use std::io::{BufReader, ErrorKind};
use std::path::{Path, PathBuf};

/// Largest slice, bytes.
pub(super) const MAX_SLICE: usize = 1 << 31;

/// No coding that is read here yields more than this many bytes from one (LZW: 4 KiB from 12 bits).
pub(super) const MAX_RATIO: u64 = 4096;

/// Grey whose smallest value stands for white.
pub(super) const WHITE_FIRST: &str = "grey from white to black";

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
    pub half: bool,
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

    pub fn bytes(&self) -> usize {
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

/// What a file holds.
pub(super) struct Contents {
    pub form: Form,
    /// Those of its pages that are slices.
    pub pages: Vec<usize>,
    /// Of which axes they are, where they are of several.
    pub axes: Option<Axes>,
    pub said: Said,
}

pub(super) fn contents(path: &Path) -> Result<Contents> {
    let (mut file, length) = open(path)?;
    let mut head = [0; 8];
    let (n, error) = super::limits::fill(&mut file, &mut head);
    if let Some(e) = error {
        return Err(io(path, "read", e));
    }
    if is_png(&head[..n]) {
        return Ok(Contents { form: png_reader(path)?.1, pages: vec![0], axes: None, said: Said::default() });
    }
    if !is_picture(&head[..n]) {
        return Err(bad(path, format!("it begins with '{}'", quote(&String::from_utf8_lossy(&head[..n]))), "a TIFF or PNG file is needed"));
    }
    tiff::contents(path, length)
}

/// Loads the pages of a file, which must be asked for in ascending order.
pub(super) fn pages(path: PathBuf, form: Form, pages: Vec<usize>) -> Result<impl FnMut(usize, &mut Vec<u8>) -> Result<()> + 'static> {
    let (mut file, length) = open(&path)?;
    let mut head = [0; 8];
    super::limits::fill(&mut file, &mut head);
    let mut decoder = if is_png(&head) { None } else { Some(tiff::open_tiff(&path, length)?) };
    let mut at = 0;
    Ok(move |i: usize, bytes: &mut Vec<u8>| {
        let Some(decoder) = &mut decoder else { return png_bytes(&path, &form, bytes) };
        while at < pages[i] {
            decoder.next_image().map_err(|e| tiff::trouble(&path, e))?;
            at += 1;
        }
        let found = tiff::page(&path, decoder, length)?;
        if found != form {
            let what = format!("page {} is {}, page {} is {}", pages[i], found.says(1), pages[0], form.says(1));
            return Err(bad(&path, what, "all slices must have the same size and type"));
        }
        tiff::bytes(&path, decoder, &form, bytes)
    })
}

/// Room for `count` bytes, or an error.
pub(super) fn room(path: &Path, bytes: &mut Vec<u8>, count: usize) -> Result<()> {
    more(|| format!("{}: a slice", shown(path)), bytes, count)?;
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
pub(super) fn check_size(path: &Path, form: &Form, size: Option<usize>, length: u64) -> Result<()> {
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
