//! OpenEXR pictures with more channels than colour, and whether a picture's file is whole.

use super::exr::{MAX_CHANNELS, MAX_SIDE, attributes, check, trouble};
use super::limits::{bad, open};
use super::picture::PictureInfo;
use super::{png, write_aside};
use crate::error::{Error, Result};
use crate::scene::{Picture, scene};
use exr::block::reader::ChunksReader;
use exr::compression::Compression;
use exr::image::{AnyChannel, AnyChannels, FlatSamples};
use exr::meta::MetaData;
use exr::meta::header::Header;
use exr::prelude::{AttributeValue, Encoding, Image, Layer, LineOrder, SampleType, SmallVec, Text, Vec2, WritableImage};
use half::f16;
use std::io::{BufRead, Seek, Write};
use std::path::Path;

/// How an OpenEXR file stores its numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExrOptions {
    /// 16-bit floats, but for channels that are always full; otherwise 32-bit.
    pub half: bool,
    /// Lossless compression.
    pub compression: ExrCompression,
}

/// Lossless compressions of OpenEXR.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExrCompression {
    /// None.
    None,
    /// Runs of equal bytes.
    Rle,
    /// Deflate, row by row.
    Zips,
    /// Deflate, sixteen rows at a time.
    #[default]
    Zip,
    /// Wavelets: smaller where pictures are grainy.
    Piz,
}

/// A channel beside R, G, B and A: `layer.channel` is how programs name channels of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct ExrChannel {
    /// Its name.
    pub name: String,
    /// A value per pixel, row by row from the top.
    pub values: Vec<f32>,
    /// Whether it is 32-bit also where the others are 16.
    pub full: bool,
}

/// As [`super::write_exr`], with more channels.
///
/// # Errors
/// As [`super::write_exr`], and [`Error::Invalid`] where a channel has not one value per pixel.
pub fn write_exr_layers(path: &Path, picture: &Picture, more: &[ExrChannel], options: ExrOptions, meta: &[(String, String)]) -> Result<()> {
    check(picture)?;
    if let Some(channel) = more.iter().find(|c| c.values.len() != picture.rgba.len()) {
        return Err(Error::Invalid {
            item: "picture channel",
            what: format!("{} values of {} for {} pixels", channel.values.len(), channel.name, picture.rgba.len()),
            right: "there must be one per pixel".into(),
        });
    }
    let samples = |values: &mut dyn Iterator<Item = f32>, full: bool| match options.half && !full {
        true => FlatSamples::F16(values.map(half).collect()),
        false => FlatSamples::F32(values.collect()),
    };
    let mut list: SmallVec<[AnyChannel<FlatSamples>; 4]> = SmallVec::new();
    for (i, name) in ["R", "G", "B", "A"].into_iter().enumerate() {
        list.push(AnyChannel::new(name, samples(&mut picture.rgba.iter().map(|p| p[i]), false)));
    }
    for channel in more {
        list.push(AnyChannel::new(channel.name.as_str(), samples(&mut channel.values.iter().copied(), channel.full)));
    }
    let compression = match options.compression {
        ExrCompression::None => Compression::Uncompressed,
        ExrCompression::Rle => Compression::RLE,
        ExrCompression::Zips => Compression::ZIP1,
        ExrCompression::Zip => Compression::ZIP16,
        ExrCompression::Piz => Compression::PIZ,
    };
    let encoding = Encoding { compression, blocks: exr::image::Blocks::ScanLines, line_order: LineOrder::Increasing };
    let layer = Layer::new((picture.width, picture.height), attributes(meta)?, encoding, AnyChannels::sort(list));
    let mut file = std::io::Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut file).map_err(|e| trouble(path, "write", e))?;
    let mut bytes = file.into_inner();
    sort_attributes(&mut bytes);
    write_aside(path, |out| out.write_all(&bytes).map_err(|source| Error::Io { path: path.to_owned(), action: "write", source }))
}

/// Rounded to half; what is finite stays so: an infinite pixel would spoil every blur that meets it.
fn half(v: f32) -> f16 {
    let half = f16::from_f32(v);
    if half.is_infinite() && v.is_finite() { f16::MAX.copysign(half) } else { half }
}

/// Brings the header's attributes into the order of their names: the writer hashes them, and the same picture must be the
/// same bytes. Nothing changes its length, so that no offset does.
fn sort_attributes(file: &mut [u8]) {
    // Magic and version; then per attribute name, type (both end with a zero), length, value; then a zero.
    let begin = 8;
    let mut attributes: Vec<Vec<u8>> = Vec::new();
    let mut at = begin;
    while file.get(at).is_some_and(|&b| b != 0) {
        let text = |from: usize| file[from..].iter().position(|&b| b == 0).map(|n| from + n + 1);
        let Some(length_at) = text(at).and_then(text) else { return };
        let Some(length) = file.get(length_at..length_at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes) else { return };
        let end = length_at + 4 + length as usize;
        let Some(attribute) = file.get(at..end) else { return };
        attributes.push(attribute.to_vec());
        at = end;
    }
    attributes.sort();
    file[begin..at].copy_from_slice(&attributes.concat());
}

/// A text of a header: UTF-8 as written here. The crate's own conversion takes each byte for a letter.
fn said(text: &Text) -> String {
    String::from_utf8_lossy(text.bytes()).into_owned()
}

/// A layer's entries as [`super::write_exr`] writes them.
pub(super) fn entries(header: &Header) -> Vec<(String, String)> {
    let own = |(name, value): (&Text, &AttributeValue)| match value {
        AttributeValue::Text(text) => Some((said(name).strip_prefix("halflight/")?.to_owned(), said(text))),
        _ => None,
    };
    let mut entries: Vec<_> = header.own_attributes.other.iter().filter_map(own).collect();
    entries.sort();
    entries
}

/// What a file's first layer says of itself; nothing is asked of its pixels.
pub(super) fn describe(mut file: impl BufRead + Seek) -> Option<PictureInfo> {
    let headers = MetaData::read_from_buffered(&mut file, false).ok()?.headers;
    headers.first().map(|header| PictureInfo {
        width: header.layer_size.x(),
        height: header.layer_size.y(),
        channels: header.channels.list.iter().map(|c| (said(&c.name), number(c.sample_type))).collect(),
        software: header.own_attributes.software_name.as_ref().map_or_else(String::new, said),
        meta: entries(header),
    })
}

fn number(kind: SampleType) -> &'static str {
    match kind {
        SampleType::F16 => "half",
        SampleType::F32 => "float",
        SampleType::U32 => "uint",
    }
}

/// Most pixels of a picture that is looked through block by block: the largest that a scene may ask for.
const MOST: usize = scene::MAX_SIDE * scene::MAX_SIDE;

/// Says whether a picture's own entries (key, value) are those that are looked for.
pub type MetaFilter<'a> = dyn Fn(&[(String, String)]) -> bool + 'a;

/// Whether `path` is a picture whose own entries `wanted` accepts (as [`super::write_exr`] and [`super::write_png`] wrote
/// them) and whose pixels decode to the last. What is not wanted is not decoded.
///
/// # Errors
/// As [`super::read_picture`]: also of a file that is cut off.
pub fn whole_picture(path: &Path, wanted: &MetaFilter) -> Result<bool> {
    let (mut file, _) = open(path)?;
    let mut magic = [0u8; 8];
    let io = |source| Error::Io { path: path.to_owned(), action: "read", source };
    std::io::Read::read_exact(&mut file, &mut magic).map_err(io)?;
    if magic == png::MAGIC {
        return png::whole(path, wanted);
    }
    file.rewind().map_err(io)?;
    let headers = MetaData::read_from_buffered(&mut file, true).map_err(|e| trouble(path, "read", e))?.headers;
    file.rewind().map_err(io)?;
    let Some(header) = headers.first() else { return Err(bad(path, "it has no layers", "a picture has one")) };
    if !wanted(&entries(header)) {
        return Ok(false);
    }
    for h in &headers {
        let (Vec2(width, height), channels) = (h.layer_size, h.channels.list.len());
        if h.deep || width > MAX_SIDE || height > MAX_SIDE || width * height > MOST || channels > MAX_CHANNELS {
            let what = format!("a layer has {width}x{height} pixels and {channels} channels{}", if h.deep { ", deep" } else { "" });
            return Err(bad(path, what, format!("at most {MAX_SIDE} a side, {MOST} pixels and {MAX_CHANNELS} flat channels are read")));
        }
    }
    // Block by block: all at once would take the memory that the header claims, before the first pixel is there.
    let chunks = exr::block::read(file, true).and_then(|r| r.all_chunks(true)).map_err(|e| trouble(path, "read", e))?;
    for block in chunks.sequential_decompressor(true) {
        block.map_err(|e| trouble(path, "read", e))?;
    }
    Ok(true)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use exr::prelude::{ReadChannels, ReadLayers, read};

    #[test]
    fn what_is_finite_stays_so_in_half() {
        assert_eq!((half(1e9), half(-70000.0), half(65504.0)), (f16::MAX, -f16::MAX, f16::MAX));
        assert_eq!((half(0.5).to_f32(), half(f32::INFINITY)), (0.5, f16::INFINITY));
        // A file, as others read it: the sun is the largest half, the depth of nothing is infinite.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sun.exr");
        let picture = Picture { width: 2, height: 1, rgba: vec![[1e6, 1.0, 0.0, 1.0], [0.25, 0.0, 0.0, 0.0]] };
        let depth = ExrChannel { name: "depth.Z".into(), values: vec![2.5, f32::INFINITY], full: true };
        write_exr_layers(&path, &picture, &[depth], ExrOptions { half: true, ..ExrOptions::default() }, &[]).unwrap();
        let image =
            read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes().from_file(&path).unwrap();
        let values = |name: &str| {
            let channel = image.layer_data.channel_data.list.iter().find(|c| c.name.eq(name)).unwrap();
            channel.sample_data.values_as_f32().collect::<Vec<_>>()
        };
        assert_eq!((values("R"), values("depth.Z")), (vec![65504.0, 0.25], vec![2.5, f32::INFINITY]));
    }
}
