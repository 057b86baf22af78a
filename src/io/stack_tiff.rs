//! TIFF files: their pages, and the samples of a page.

use super::limits::{bad, io, open, quote};
use super::samples::SampleType;
use super::stack_axes::{self, Behind, Resolution};
use super::stack_picture::{Contents, Form, MAX_RATIO, MAX_SLICE, WHITE_FIRST, check_size, room};
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufReader, ErrorKind, Seek, SeekFrom};
use std::path::Path;
use tiff::decoder::ifd::Value;
use tiff::decoder::{ChunkType, Decoder, DecodingSampleType, Limits};
use tiff::tags::{ByteOrder, Tag};
use tiff::{ColorType, TiffError, TiffUnsupportedError};

const MAX_PAGES: usize = 1 << 16;

/// Slices that a page holds, of the TIFF that volumes once were given.
const IMAGE_DEPTH: Tag = Tag::Unknown(32997);

/// A way of compression, by its number.
const LZW: u16 = 5;

/// Opens a file of `length` bytes within limits.
pub(super) fn open_tiff(path: &Path, length: u64) -> Result<Decoder<BufReader<File>>> {
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

/// The form of the first page, all pages that are no thumbnails, and what is said of them.
pub(super) fn contents(path: &Path, length: u64) -> Result<Contents> {
    let mut decoder = open_tiff(path, length)?;
    let mut first = None;
    let mut pages = Vec::new();
    for page_number in 0.. {
        let reduced: Option<u32> = decoder.find_tag_unsigned(Tag::NewSubfileType).map_err(|e| trouble(path, e))?;
        if reduced.unwrap_or(0) & 1 == 0 {
            if first.is_none() {
                let form = page(path, &mut decoder, length)?;
                first = Some((form, description(&mut decoder), start(&mut decoder), resolution(&mut decoder)));
            }
            pages.push(page_number);
        }
        if !decoder.more_images() {
            break;
        }
        if page_number == MAX_PAGES {
            return Err(bad(path, format!("it has more than {MAX_PAGES} pages"), "fewer are read"));
        }
        decoder.next_image().map_err(|e| trouble(path, e))?;
    }
    let Some((form, description, start, resolution)) = first else {
        return Err(bad(path, "all of its pages are thumbnails", "a page of full resolution is needed"));
    };
    let behind = Behind { start, length, big_endian: decoder.byte_order() == ByteOrder::BigEndian };
    let axes = stack_axes::axes(path, &description, &form, &pages, &behind)?;
    let said = stack_axes::said(path, &description, &form, &resolution, pages.len());
    Ok(Contents { form, pages, axes, said })
}

/// The present page's description; empty where it has none, or none that can be read.
fn description(decoder: &mut Decoder<BufReader<File>>) -> Vec<u8> {
    let mut text = vec![0; stack_axes::MOST];
    let found = decoder.image_ifd().find_tag_bytes(Tag::ImageDescription, &mut text, 0);
    text.truncate(found.ok().flatten().unwrap_or(0));
    text
}

/// How many pixels there are per unit.
fn resolution(decoder: &mut Decoder<BufReader<File>>) -> Resolution {
    let centimetres = matches!(decoder.find_tag_unsigned::<u16>(Tag::ResolutionUnit), Ok(Some(3)));
    let rates = [Tag::XResolution, Tag::YResolution].map(|tag| {
        let rate = match decoder.find_tag(tag).ok()?? {
            Value::Rational(n, d) => f64::from(n) / f64::from(d),
            Value::Float(v) => f64::from(v),
            Value::Double(v) => v,
            _ => return None,
        };
        Some(rate).filter(|r| r.is_finite() && *r > 0.0)
    });
    Resolution { rates, centimetres }
}

/// Where the present page's uncompressed samples begin.
fn start(decoder: &mut Decoder<BufReader<File>>) -> Option<u64> {
    let plain = decoder.find_tag_unsigned::<u16>(Tag::Compression).ok()?.is_none_or(|c| c == 1);
    let strips = decoder.find_tag_unsigned_vec::<u64>(Tag::StripOffsets).ok()??;
    strips.first().copied().filter(|_| plain)
}

/// What the present page holds.
pub(super) fn page(path: &Path, decoder: &mut Decoder<BufReader<File>>, length: u64) -> Result<Form> {
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
    let depth: Option<u32> = decoder.find_tag_unsigned(IMAGE_DEPTH).map_err(|e| trouble(path, e))?;
    if let Some(depth) = depth.filter(|d| *d > 1) {
        let what = format!("its pages hold {depth} slices each (ImageDepth)");
        return Err(bad(path, what, "a page per slice is read: save it without volumetric tiles or strips"));
    }
    let channels = usize::from(color.num_samples());
    let white = decoder.find_tag_unsigned(Tag::PhotometricInterpretation).map_err(|e| trouble(path, e))? == Some(0u16);
    // The decoder turns values round so that white is the largest; of others than unsigned integers that is not exact.
    if white && !(channels == 1 && matches!(kind, SampleType::U8 | SampleType::U16 | SampleType::U32 | SampleType::U64)) {
        let what = format!("of its {} samples the smallest is white (PhotometricInterpretation 0)", kind.name());
        return Err(bad(path, what, "unsigned integers of one channel are read so: save it with black as the smallest (1)"));
    }
    let color = match color {
        ColorType::Gray(_) if white => WHITE_FIRST,
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

/// The present page's samples, as they are stored.
pub(super) fn bytes(path: &Path, decoder: &mut Decoder<BufReader<File>>, form: &Form, bytes: &mut Vec<u8>) -> Result<()> {
    let size = form.bytes();
    if !form.half {
        room(path, bytes, size)?;
        decode(path, decoder, bytes)?;
        if form.color == WHITE_FIRST {
            // Back to what is stored.
            bytes.iter_mut().for_each(|b| *b = !*b);
        }
        return Ok(());
    }
    let mut raw = Vec::new();
    room(path, &mut raw, size / 2)?;
    decode(path, decoder, &mut raw)?;
    room(path, bytes, size)?;
    for (out, half) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(raw.as_chunks::<2>().0) {
        *out = half::f16::from_ne_bytes(*half).to_f32().to_ne_bytes();
    }
    Ok(())
}

fn decode(path: &Path, decoder: &mut Decoder<BufReader<File>>, bytes: &mut [u8]) -> Result<()> {
    let Err(e) = decoder.read_image_bytes(bytes) else { return Ok(()) };
    let ended = matches!(&e, TiffError::IoError(source) if source.kind() == ErrorKind::UnexpectedEof);
    let lzw = matches!(decoder.find_tag_unsigned::<u16>(Tag::Compression), Ok(Some(LZW)));
    if ended && lzw && decoder.get_chunk_type() == ChunkType::Tile {
        // image-tiff issue 395: mended there, in no release yet.
        let right = "some valid tiles in LZW cannot be decoded here: save it in strips, or with Deflate; else the file is cut short";
        return Err(bad(path, format!("TIFF: {}", quote(&e.to_string())), right));
    }
    Err(trouble(path, e))
}

pub(super) fn trouble(path: &Path, e: TiffError) -> Error {
    use TiffUnsupportedError as No;
    let right = match &e {
        TiffError::IoError(source) if source.kind() != ErrorKind::UnexpectedEof => {
            let TiffError::IoError(source) = e else { unreachable!() };
            return io(path, "read", source);
        }
        TiffError::UnsupportedError(No::UnknownCompressionMethod | No::UnsupportedCompressionMethod(_)) => {
            "uncompressed, PackBits, LZW and Deflate are read: save it again so"
        }
        TiffError::UnsupportedError(
            No::UnknownInterpretation | No::InterpretationWithBits(..) | No::UnsupportedInterpretation(_) | No::UnsupportedColorType(_),
        ) => "grey and colours are read, palettes are not: save it as grey, with its values (in Fiji by Image > Lookup Tables > Grays)",
        TiffError::UnsupportedError(_) => "integers and floats of one size, without subsampling, are read: save it again so",
        _ => "a whole, undamaged file is needed",
    };
    bad(path, format!("TIFF: {}", quote(&e.to_string())), right)
}
