//! Small files of each format, written by hand, so that a reader is not judged by a writer of its own.

use super::{DIMS, bytes};
use flate2::{Compression, write::ZlibEncoder};
use halflight::io::SampleType;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut out = ZlibEncoder::new(Vec::new(), Compression::fast());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

/// Base64 with padding.
pub fn base64(bytes: &[u8]) -> Vec<u8> {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let group = |c: &[u8]| {
        let value = c.iter().fold(0u32, |v, &b| v << 8 | u32::from(b)) << (8 * (3 - c.len()));
        (0..4).map(move |i| if i <= c.len() { DIGITS[(value >> (18 - 6 * i)) as usize & 63] } else { b'=' }).collect::<Vec<u8>>()
    };
    bytes.chunks(3).flat_map(group).collect()
}

/// A MetaImage header of [`DIMS`]; `more` are further lines.
pub fn meta_header(kind: &str, more: &str, data: &str) -> Vec<u8> {
    let [x, y, z] = DIMS;
    format!("ObjectType = Image\nNDims = 3\nDimSize = {x} {y} {z}\nElementType = {kind}\n{more}ElementDataFile = {data}\n").into_bytes()
}

/// How a `.vti` holds its arrays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Vti {
    Ascii,
    Inline,
    AppendedRaw,
    AppendedBase64,
}

/// An array: name, type, components, values.
pub type Array<'a> = (&'a str, SampleType, usize, Vec<f64>);

/// A `.vti` of `extent` with arrays at points (and, `cells`, at cells), zlib in blocks of `block` bytes where that is above 0.
#[allow(clippy::too_many_arguments)]
pub fn vti(form: Vti, image: &str, extent: &str, points: &[Array], cells: &[Array], big: bool, wide: bool, block: usize) -> Vec<u8> {
    vti_packed(form, image, extent, points, cells, big, wide, block, "ZLib")
}

/// A block as one of VTK's compressors writes it.
fn pack(compressor: &str, bytes: &[u8]) -> Vec<u8> {
    match compressor {
        "ZLib" => zlib(bytes),
        "LZ4" => lz4_flex::block::compress(bytes),
        "LZMA" => {
            let mut out = lzma_rust2::XzWriter::new(Vec::new(), lzma_rust2::XzOptions::with_preset(5)).unwrap();
            out.write_all(bytes).unwrap();
            out.finish().unwrap()
        }
        other => panic!("no compressor {other}"),
    }
}

/// The same with one of VTK's compressors.
#[allow(clippy::too_many_arguments)]
pub fn vti_packed(
    form: Vti,
    image: &str,
    extent: &str,
    points: &[Array],
    cells: &[Array],
    big: bool,
    wide: bool,
    block: usize,
    compressor: &str,
) -> Vec<u8> {
    let size = |n: usize| {
        let mut raw = if wide { (n as u64).to_le_bytes().to_vec() } else { (n as u32).to_le_bytes().to_vec() };
        if big {
            raw.reverse();
        }
        raw
    };
    // The coded bytes of an array: in base64, sizes of blocks are coded apart from the blocks.
    let coded = |raw: &[u8], text: bool| -> Vec<u8> {
        let code = |b: &[u8]| if text { base64(b) } else { b.to_vec() };
        if block == 0 {
            return code(&[size(raw.len()), raw.to_vec()].concat());
        }
        let blocks: Vec<Vec<u8>> = raw.chunks(block).map(|b| pack(compressor, b)).collect();
        let mut head = [size(blocks.len()), size(block), size(raw.len() % block)].concat();
        blocks.iter().for_each(|b| head.extend(size(b.len())));
        [code(&head), code(&blocks.concat())].concat()
    };
    let mut appended = Vec::new();
    let mut section = |tag: &str, arrays: &[Array]| {
        let mut text = format!("<{tag} Scalars=\"{}\">\n", arrays.first().map_or("", |a| a.0)).into_bytes();
        for (name, kind, components, values) in arrays {
            let vtk = match kind.name() {
                "float32" => "Float32".to_owned(),
                "float64" => "Float64".to_owned(),
                n => n.replace("uint", "U_").replace("int", "Int").replace("U_", "UInt"),
            };
            let raw: Vec<u8> = values.iter().flat_map(|&v| super::encode(*kind, v, big)).collect();
            let (format, body) = match form {
                Vti::Ascii => ("ascii".to_owned(), values.iter().flat_map(|v| format!(" {v}").into_bytes()).collect()),
                Vti::Inline => ("binary".to_owned(), coded(&raw, true)),
                _ => {
                    let offset = appended.len();
                    appended.extend(coded(&raw, form == Vti::AppendedBase64));
                    (format!("appended\" offset=\"{offset}"), Vec::new())
                }
            };
            let open = format!("<DataArray type=\"{vtk}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"{format}\">\n");
            text.extend([open.into_bytes(), body, b"\n</DataArray>\n".to_vec()].concat());
        }
        text.extend(format!("</{tag}>\n").into_bytes());
        text
    };
    let (points, cells) = (section("PointData", points), section("CellData", cells));
    let order = if big { "BigEndian" } else { "LittleEndian" };
    let header = if wide { "UInt64" } else { "UInt32" };
    let compressor = if block > 0 { format!(" compressor=\"vtk{compressor}DataCompressor\"") } else { String::new() };
    let head = format!(
        "<?xml version=\"1.0\"?>\n<!-- made by a test -->\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"{order}\" \
         header_type=\"{header}\"{compressor}>\n<ImageData WholeExtent=\"{extent}\" {image}>\n<Piece Extent=\"{extent}\">\n"
    );
    let mut out = [head.into_bytes(), points, cells, b"</Piece>\n</ImageData>\n".to_vec()].concat();
    if matches!(form, Vti::AppendedRaw | Vti::AppendedBase64) {
        let encoding = if form == Vti::AppendedRaw { "raw" } else { "base64" };
        out.extend(format!("<AppendedData encoding=\"{encoding}\">\n _").into_bytes());
        out.extend(appended);
        out.extend(b"\n</AppendedData>\n");
    }
    out.extend(b"</VTKFile>\n");
    out
}

/// A DICOM element in explicit (or, `implicit`, without) VR, little-endian.
pub fn element(tag: u32, vr: &str, value: &[u8], implicit: bool) -> Vec<u8> {
    let mut value = value.to_vec();
    if value.len() % 2 == 1 {
        value.push(if vr == "UI" || vr == "OB" { 0 } else { b' ' });
    }
    let mut out = [(tag >> 16) as u16, tag as u16].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    if implicit {
        out.extend((value.len() as u32).to_le_bytes());
    } else if ["OB", "OW", "OF", "SQ", "UN"].contains(&vr) {
        out.extend([vr.as_bytes(), &[0, 0], &(value.len() as u32).to_le_bytes()].concat());
    } else {
        out.extend([vr.as_bytes(), &(value.len() as u16).to_le_bytes()].concat());
    }
    out.extend(value);
    out
}

pub const EXPLICIT: &str = "1.2.840.10008.1.2.1";
pub const IMPLICIT: &str = "1.2.840.10008.1.2";
pub const RLE: &str = "1.2.840.10008.1.2.5";

/// One slice of a series, to be changed before it is written.
#[derive(Clone)]
pub struct Dicom {
    pub syntax: String,
    pub series: String,
    pub instance: i32,
    pub position: Option<[f64; 3]>,
    pub orientation: [f64; 6],
    pub spacing: [f64; 2],
    pub columns: u16,
    pub rows: u16,
    pub bits: [u16; 3],
    pub signed: bool,
    pub samples: u16,
    pub planar: u16,
    pub photometric: String,
    pub rescale: Option<[f64; 2]>,
    /// SpacingBetweenSlices.
    pub between: Option<f64>,
    /// Elements in ascending order between (0028,1053) and the pixels.
    pub more: Vec<u8>,
    pub frames: Option<usize>,
    pub pixels: Vec<u8>,
}

impl Dicom {
    /// A slice of a uint8 image, 5x4.
    pub fn new(instance: i32, z: f64, pixels: Vec<u8>) -> Self {
        Self {
            syntax: EXPLICIT.into(),
            series: "1.2.3".into(),
            instance,
            position: Some([10.0, 20.0, z]),
            orientation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            spacing: [0.5, 0.75],
            columns: 5,
            rows: 4,
            bits: [8, 8, 7],
            signed: false,
            samples: 1,
            planar: 0,
            photometric: "MONOCHROME2".into(),
            rescale: None,
            between: None,
            more: Vec::new(),
            frames: None,
            pixels,
        }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let implicit = self.syntax == IMPLICIT;
        let list = |v: &[f64]| v.iter().map(f64::to_string).collect::<Vec<_>>().join("\\").into_bytes();
        let head = element(0x0002_0010, "UI", self.syntax.as_bytes(), false);
        let e = |tag, vr: &str, value: &[u8]| element(tag, vr, value, implicit);
        let us = |tag, v: u16| e(tag, "US", &v.to_le_bytes());
        let mut out = vec![0; 128];
        out.extend(b"DICM");
        out.extend(element(0x0002_0000, "UL", &(head.len() as u32).to_le_bytes(), false));
        out.extend(head);
        out.extend(e(0x0008_103e, "LO", b"made by a test"));
        // A sequence that speaks of another series, to be passed over.
        let other = [e(0x0020_000e, "UI", b"9.9.9")].concat();
        let item = [&[0xfe, 0xff, 0, 0xe0][..], &(other.len() as u32).to_le_bytes(), &other].concat();
        out.extend(e(0x0008_1115, "SQ", &item));
        out.extend(e(0x0018_0050, "DS", b"2.5"));
        if let Some(d) = self.between {
            out.extend(e(0x0018_0088, "DS", d.to_string().as_bytes()));
        }
        out.extend(e(0x0020_000e, "UI", self.series.as_bytes()));
        out.extend(e(0x0020_0013, "IS", self.instance.to_string().as_bytes()));
        if let Some(p) = self.position {
            out.extend(e(0x0020_0032, "DS", &list(&p)));
            out.extend(e(0x0020_0037, "DS", &list(&self.orientation)));
        }
        out.extend(us(0x0028_0002, self.samples));
        out.extend(e(0x0028_0004, "CS", self.photometric.as_bytes()));
        if self.samples > 1 {
            out.extend(us(0x0028_0006, self.planar));
        }
        if let Some(n) = self.frames {
            out.extend(e(0x0028_0008, "IS", n.to_string().as_bytes()));
        }
        out.extend([us(0x0028_0010, self.rows), us(0x0028_0011, self.columns)].concat());
        out.extend(e(0x0028_0030, "DS", &list(&self.spacing)));
        out.extend([us(0x0028_0100, self.bits[0]), us(0x0028_0101, self.bits[1]), us(0x0028_0102, self.bits[2])].concat());
        out.extend(us(0x0028_0103, u16::from(self.signed)));
        if let Some([slope, intercept]) = self.rescale {
            out.extend(e(0x0028_1052, "DS", intercept.to_string().as_bytes()));
            out.extend(e(0x0028_1053, "DS", slope.to_string().as_bytes()));
        }
        out.extend(&self.more);
        if self.syntax == RLE || self.syntax.starts_with("1.2.840.10008.1.2.4") {
            // Encapsulated: a table of offsets, one fragment, an end.
            out.extend([&[0xe0, 0x7f, 0x10, 0][..], b"OB\0\0", &[0xff; 4]].concat());
            out.extend([0xfe, 0xff, 0, 0xe0, 0, 0, 0, 0]);
            out.extend([&[0xfe, 0xff, 0, 0xe0][..], &(self.pixels.len() as u32).to_le_bytes(), &self.pixels].concat());
            out.extend([0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0]);
        } else {
            out.extend(e(0x7fe0_0010, if self.bits[0] > 8 { "OW" } else { "OB" }, &self.pixels));
        }
        out
    }
}

/// RLE of 16-bit little-endian pixels: the high bytes, then the low ones, each as one literal run per 100 bytes.
pub fn rle16(pixels: &[u8]) -> Vec<u8> {
    let plane = |k: usize| {
        let bytes: Vec<u8> = pixels.chunks(2).map(|c| c[k]).collect();
        let mut out: Vec<u8> = bytes.chunks(100).flat_map(|c| [&[c.len() as u8 - 1][..], c].concat()).collect();
        if out.len() % 2 == 1 {
            out.push(128);
        }
        out
    };
    let (high, low) = (plane(1), plane(0));
    let mut head = [0u32; 16];
    (head[0], head[1], head[2]) = (2, 64, 64 + high.len() as u32);
    [head.iter().flat_map(|v| v.to_le_bytes()).collect(), high, low].concat()
}

/// Slice `z` of the formula's volume as bytes.
pub fn slice(kind: SampleType, z: usize) -> Vec<u8> {
    let each = DIMS[0] * DIMS[1] * kind.bytes() as usize;
    bytes(kind, false)[z * each..(z + 1) * each].to_vec()
}

/// A folder of three DICOM slices, 2.5 apart, in an order that is not theirs.
pub fn dicom_series(folder: &Path, change: impl Fn(usize, &mut Dicom)) -> PathBuf {
    std::fs::create_dir_all(folder).unwrap();
    for z in 0..DIMS[2] {
        let mut d = Dicom::new(1 + z as i32, -4.0 + 2.5 * z as f64, slice(SampleType::U8, z));
        change(z, &mut d);
        std::fs::write(folder.join(["b", "c", "a"][z]), d.bytes()).unwrap();
    }
    folder.to_owned()
}

/// A grey PNG of 8 or 16 bits from little-endian samples.
pub fn png_grey(width: u32, height: u32, wide: bool, samples: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(if wide { png::BitDepth::Sixteen } else { png::BitDepth::Eight });
    let mut data = samples.to_vec();
    if wide {
        data.chunks_mut(2).for_each(<[u8]>::reverse);
    }
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&data).unwrap();
    writer.finish().unwrap();
    out
}

/// A TIFF with a page per element of `pages`.
pub fn tiff_pages<C: tiff::encoder::colortype::ColorType>(width: u32, height: u32, pages: &[Vec<C::Inner>], zipped: bool) -> Vec<u8>
where
    [C::Inner]: tiff::encoder::TiffValue,
{
    let mut out = Cursor::new(Vec::new());
    {
        let mut encoder = tiff::encoder::TiffEncoder::new(&mut out).unwrap();
        if zipped {
            encoder = encoder.with_compression(tiff::encoder::Compression::Deflate(Default::default()));
        }
        for page in pages {
            encoder.write_image::<C>(width, height, page).unwrap();
        }
    }
    out.into_inner()
}
