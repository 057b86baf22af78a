//! Picture files: what is written is what is read, by our own reader and by the format crates; damaged files are errors.

#[path = "io_common/logs.rs"]
mod logs;

use exr::prelude::*;
use halflight::Error;
use halflight::io::{describe_picture, read_picture_exr, read_probe, whole_picture, write_exr, write_png};
use halflight::scene::Picture;
use std::path::{Path, PathBuf};

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn picture() -> Picture {
    let pixel = |i: usize| {
        let a = (i % 7) as f32 / 6.0;
        [a * 0.5, a * (i as f32 * 0.37).sin().abs() * 1e4, a * 1e-6, a]
    };
    Picture { width: 33, height: 21, rgba: (0..33 * 21).map(pixel).collect() }
}

fn meta(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
    pairs.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect()
}

#[test]
fn exr_there_and_back() {
    let dir = folder();
    let path = dir.path().join("a.exr");
    let pairs = meta(&[
        ("light", "uffizi, 40° about z"),
        ("exposure", "1.5"),
        ("channels", "not the standard attribute"),
        ("a key that is longer than thirty-one bytes", ""),
    ]);
    write_exr(&path, &picture(), &pairs).unwrap();
    assert_eq!(read_picture_exr(&path).unwrap(), picture(), "float for float");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "nothing is left beside it");
    // What the header says, through the format crate.
    let headers = MetaData::read_from_file(&path, true).unwrap().headers;
    assert_eq!(headers.len(), 1);
    assert_eq!(headers[0].compression, Compression::ZIP16);
    assert!(headers[0].channels.list.iter().all(|c| c.sample_type == SampleType::F32));
    assert!(headers[0].own_attributes.software_name.as_ref().unwrap().to_string().starts_with("halflight "));
    for (key, value) in &pairs {
        let name = Text::from_slice_unchecked(format!("halflight/{key}").as_bytes());
        let Some(AttributeValue::Text(text)) = headers[0].own_attributes.other.get(&name) else { panic!("{key} is lost") };
        assert_eq!(text.as_slice(), value.as_bytes());
    }
    // One changed float is another picture: the comparison above can fail.
    let mut other = picture();
    other.rgba[17][1] += 1.0;
    write_exr(&path, &other, &[]).unwrap();
    assert_ne!(read_picture_exr(&path).unwrap(), picture());
}

#[test]
fn a_cut_exr_is_an_error_not_a_darker_picture() {
    let dir = folder();
    let (whole, cut) = (dir.path().join("a.exr"), dir.path().join("b.exr"));
    write_exr(&whole, &picture(), &[]).unwrap();
    let bytes = std::fs::read(&whole).unwrap();
    for n in [0, 3, 4, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&cut, &bytes[..n]).unwrap();
        assert!(matches!(read_picture_exr(&cut), Err(Error::Format { .. })), "the first {n} of {} bytes", bytes.len());
    }
}

#[test]
fn whole_is_what_decodes_to_the_last_pixel() {
    let dir = folder();
    let path = dir.path().join("a.exr");
    write_exr(&path, &picture(), &meta(&[("k", "v")])).unwrap();
    assert!(whole_picture(&path, &|m| m == [("k".to_owned(), "v".to_owned())]).unwrap());
    assert!(!whole_picture(&path, &|m| m.is_empty()).unwrap());
    let good = std::fs::read(&path).unwrap();
    for cut in [good.len() - 1, good.len() / 2, 100] {
        std::fs::write(&path, &good[..cut]).unwrap();
        assert!(whole_picture(&path, &|_| true).is_err(), "cut at {cut}");
    }
    // One byte of the pixels: their checksum is deflate's.
    let mut damaged = good.clone();
    let last = damaged.len() - 30;
    damaged[last] ^= 0x10;
    std::fs::write(&path, &damaged).unwrap();
    assert!(whole_picture(&path, &|_| true).is_err());
    // A window of more pixels than memory holds is refused before any is asked for.
    let window = good.windows(17).position(|w| w == b"dataWindow\0box2i\0").unwrap() + 17 + 4;
    let mut wide = good;
    wide[window + 8..window + 12].copy_from_slice(&0x0700_0000i32.to_le_bytes());
    std::fs::write(&path, &wide).unwrap();
    let said = whole_picture(&path, &|_| true).unwrap_err().to_string();
    assert!(said.contains("pixels") || said.contains("OpenEXR"), "{said}");
    println!("{said}");
}

#[test]
fn exr_keeps_what_only_floats_hold() {
    let dir = folder();
    let path = dir.path().join("a.exr");
    write_exr(&path, &picture(), &meta(&[("Titel", "Größe 40°")])).unwrap();
    assert_eq!(describe_picture(&path).unwrap().unwrap().meta, meta(&[("Titel", "Größe 40°")]));
    assert!(whole_picture(&path, &|m| m == meta(&[("Titel", "Größe 40°")])).unwrap());
    let odd = Picture { width: 2, height: 1, rgba: vec![[f32::NAN, f32::INFINITY, -1.0, 0.0], [f32::MIN_POSITIVE, 1e-42, 3e38, 1.0]] };
    write_exr(&path, &odd, &[]).unwrap();
    let back = read_picture_exr(&path).unwrap();
    let bits = |p: &Picture| p.rgba.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&back), bits(&odd));
}

fn decode_png(path: &Path) -> (png::OutputInfo, Vec<u8>, Vec<(String, String)>) {
    let mut reader = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let latin = reader.info().uncompressed_latin1_text.iter().map(|t| (t.keyword.clone(), t.text.clone()));
    let utf8 = reader.info().utf8_text.iter().map(|t| (t.keyword.clone(), t.get_text().unwrap()));
    let text = latin.chain(utf8).collect();
    (info, bytes, text)
}

#[test]
fn png_is_exposed_unpremultiplied_srgb() {
    let dir = folder();
    let path = dir.path().join("a.png");
    // Premultiplied radiance ½ at coverage ½ is radiance 1 seen through half: white at alpha ½.
    let rgba = vec![
        [0.5, 0.25, 0.0, 0.5],
        [0.18, 0.0031308, 0.001, 1.0],
        [9.0, -1.0, f32::NAN, 1.0],
        [0.3, 0.3, 0.3, 0.0],
        [f32::INFINITY, 0.0, 0.0, f32::NAN],
        [1.0, 1.0, 1.0, 7.0],
    ];
    let shot = Picture { width: 3, height: 2, rgba };
    write_png(&path, &shot, 0.0, &meta(&[("Scene", "engine"), ("Title", "Größe 40°")])).unwrap();
    let (info, bytes, text) = decode_png(&path);
    assert_eq!((info.width, info.height, info.color_type, info.bit_depth), (3, 2, png::ColorType::Rgba, png::BitDepth::Eight));
    // Linear ½ is sRGB 187.5, 0.18 is 117.6 (mid grey), the branch point 0.0031308 is 10.3, 0.001 is 3.3.
    #[rustfmt::skip]
    assert_eq!(bytes, [255, 188, 0, 128,   118, 10, 3, 255,   255, 0, 0, 255,
                       0, 0, 0, 0,         0, 0, 0, 0,        255, 255, 255, 255]);
    assert!(text.contains(&("Scene".into(), "engine".into())) && text.contains(&("Title".into(), "Größe 40°".into())), "{text:?}");
    assert!(text.iter().any(|(k, v)| k == "Software" && v.starts_with("halflight ")));
    // Exposure: one stop doubles radiance and leaves coverage.
    write_png(&path, &shot, 1.0, &[]).unwrap();
    let (_, brighter, _) = decode_png(&path);
    assert_eq!((brighter[1], brighter[3]), (255, 128));
    assert_eq!(brighter[4], (255.0 * (1.055 * 0.36f64.powf(1.0 / 2.4) - 0.055)).round() as u8);
}

#[test]
fn wrong_pictures_and_keys_are_refused_before_anything_is_written() {
    let dir = folder();
    let path = dir.path().join("a.out");
    let torn = Picture { width: 4, height: 4, rgba: vec![[0.0; 4]; 15] };
    let empty = Picture { width: 0, height: 0, rgba: vec![] };
    for bad in [&torn, &empty] {
        assert!(matches!(write_exr(&path, bad, &[]), Err(Error::Invalid { .. })));
        assert!(matches!(write_png(&path, bad, 0.0, &[]), Err(Error::Invalid { .. })));
    }
    for key in ["", "a\0b"] {
        assert!(matches!(write_exr(&path, &picture(), &meta(&[(key, "")])), Err(Error::Invalid { .. })));
        assert!(matches!(write_png(&path, &picture(), 0.0, &meta(&[(key, "")])), Err(Error::Invalid { .. })));
    }
    assert!(matches!(write_png(&path, &picture(), f32::NAN, &[]), Err(Error::Invalid { .. })));
    assert!(write_png(&path, &picture(), 0.0, &meta(&[(&"k".repeat(80), "")])).is_err());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    let nowhere = dir.path().join("none/a.exr");
    assert!(matches!(write_exr(&nowhere, &picture(), &[]), Err(Error::Io { .. })));
    assert!(matches!(read_picture_exr(&nowhere), Err(Error::Io { action: "open", .. })));
}

/// What the pixels of the probes below are: exact in half floats.
fn value(x: usize, y: usize) -> [f32; 3] {
    [x as f32, y as f32 * 0.25, ((x * y) % 5) as f32]
}

fn assert_is_the_probe(path: &Path, gray: bool) {
    let probe = read_probe(path).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((probe.width(), probe.height()), (16, 8));
    for (i, pixel) in probe.pixels().iter().enumerate() {
        let [r, g, b] = value(i % 16, i / 16);
        assert_eq!(*pixel, if gray { [r; 3] } else { [r, g, b] });
    }
}

fn flat(path: &Path, channels: Vec<(&str, FlatSamples)>, encoding: Encoding) {
    let list = channels.into_iter().map(|(name, samples)| AnyChannel::new(name, samples)).collect();
    let layer = Layer::new((16, 8), LayerAttributes::named("main"), encoding, AnyChannels::sort(list));
    Image::from_layer(layer).write().to_file(path).unwrap();
}

fn samples(c: usize) -> Vec<f32> {
    (0..16 * 8).map(|i| value(i % 16, i / 16)[c]).collect()
}

#[test]
fn exr_probes_of_every_sample_type_and_encoding() {
    let dir = folder();
    let path = dir.path().join("p.exr");
    let float = |c| FlatSamples::F32(samples(c));
    let half = |c| FlatSamples::F16(samples(c).into_iter().map(f16::from_f32).collect());
    for encoding in [Encoding::SMALL_LOSSLESS, Encoding::FAST_LOSSLESS, Encoding::UNCOMPRESSED, Encoding::SMALL_FAST_LOSSLESS] {
        flat(&path, vec![("R", float(0)), ("G", float(1)), ("B", float(2))], encoding);
        assert_is_the_probe(&path, false);
        flat(&path, vec![("R", half(0)), ("G", half(1)), ("B", half(2)), ("A", half(0)), ("Z", float(1))], encoding);
        assert_is_the_probe(&path, false);
        flat(&path, vec![("Y", half(0))], encoding);
        assert_is_the_probe(&path, true);
        flat(&path, vec![("Y", FlatSamples::U32(samples(0).into_iter().map(|x| x as u32).collect()))], encoding);
        assert_is_the_probe(&path, true);
    }
    // The first layer that has colour, although another one stands before it.
    let layer = |name: &str, channels: Vec<(&str, FlatSamples)>| {
        let list = channels.into_iter().map(|(n, s)| AnyChannel::new(n, s)).collect();
        Layer::new((16, 8), LayerAttributes::named(name), Encoding::SMALL_LOSSLESS, AnyChannels::sort(list))
    };
    let layers = vec![layer("depth", vec![("Z", float(0))]), layer("light", vec![("R", float(0)), ("G", float(1)), ("B", float(2))])];
    Image::from_layers(ImageAttributes::new(IntegerBounds::from_dimensions((16, 8))), layers).write().to_file(&path).unwrap();
    assert_is_the_probe(&path, false);
    // No colour at all: the error names what there is.
    flat(&path, vec![("diffuse.R", float(0)), ("Z", float(1))], Encoding::UNCOMPRESSED);
    let text = read_probe(&path).unwrap_err().to_string();
    assert!(text.contains("diffuse.R") && text.contains("R, G and B"), "{text}");
    flat(&path, vec![("Y", float(0)), ("RY", float(0)), ("BY", float(0))], Encoding::UNCOMPRESSED);
    assert!(read_probe(&path).is_err());
}

/// A Radiance file with these header lines and pixel bytes.
fn radiance(path: &Path, header: &str, body: &[u8]) {
    std::fs::write(path, [header.as_bytes(), body].concat()).unwrap();
}

fn message(path: &Path) -> String {
    match read_probe(path).unwrap_err() {
        e @ Error::Format { .. } => e.to_string(),
        other => panic!("{other}"),
    }
}

const HEADER: &str = "#?RADIANCE\n# made here\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n";

/// 16x8 pixels run-length coded by component, with literal and repeated runs: red = column, green 64 (twice: ¼ and ½),
/// blue 1, exponent 136 (factor 1).
fn new_rle() -> Vec<u8> {
    let mut out = Vec::new();
    for _ in 0..8 {
        out.extend([2, 2, 0, 16, 16]);
        out.extend(0..16u8);
        out.extend([128 + 10, 64, 6, 32, 32, 32, 32, 32, 32]);
        out.extend([128 + 16, 1, 128 + 16, 136]);
    }
    out
}

#[test]
fn radiance_in_its_three_codings() {
    let dir = folder();
    let path = dir.path().join("p.hdr");
    let expected = |i: usize| [(i % 16) as f32, if i % 16 < 10 { 64.0 } else { 32.0 }, 1.0];
    let same = |path: &Path, factor: f32| {
        let probe = read_probe(path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((probe.width(), probe.height()), (16, 8));
        probe.pixels().iter().enumerate().all(|(i, p)| *p == expected(i).map(|x| x * factor))
    };
    radiance(&path, HEADER, &new_rle());
    assert!(same(&path, 1.0));
    radiance(&path, &HEADER.replace("RADIANCE", "RGBE").replace('\n', "\r\n").replace("+X 16\r\n", "+X 16\n"), &new_rle());
    assert!(same(&path, 1.0), "the other signature, the other line ends");
    let flat: Vec<u8> = (0..128).flat_map(|i| expected(i).map(|x| x as u8).into_iter().chain([136])).collect();
    radiance(&path, HEADER, &flat);
    assert!(same(&path, 1.0));
    // EXPOSURE lines multiply, and are divided out.
    radiance(&path, &HEADER.replace("\n\n", "\nEXPOSURE=8\nEXPOSURE= 0.5\n\n"), &flat);
    assert!(same(&path, 0.25) && !same(&path, 1.0));
    // Old runs: one pixel, then 1 1 1 n; a second marker counts 256-fold. 8 rows of 16.
    let rows: Vec<u8> = (0..8u8).flat_map(|r| [r, 5, 6, 137, 1, 1, 1, 15]).collect();
    radiance(&path, HEADER, &rows);
    let probe = read_probe(&path).unwrap();
    assert!(probe.pixels().iter().enumerate().all(|(i, p)| *p == [(i / 16) as f32 * 2.0, 10.0, 12.0]));
    let wide: Vec<u8> = [9, 9, 9, 136, 1, 1, 1, 255, 1, 1, 1, 1].into_iter().cycle().take(12 * 256).collect();
    radiance(&path, &HEADER.replace("8 +X 16", "256 +X 512"), &wide);
    assert_eq!(read_probe(&path).unwrap().pixels(), vec![[9.0; 3]; 512 * 256]);
    // Exponent 0 is black, whatever the mantissa.
    radiance(&path, HEADER, &[7, 7, 7, 0].repeat(128));
    assert_eq!(read_probe(&path).unwrap().pixels(), vec![[0.0; 3]; 128]);
}

#[test]
fn wrong_radiance_files_say_what_is_wrong() {
    let dir = folder();
    let path = dir.path().join("p.hdr");
    let flat = [1, 2, 3, 136].repeat(128);
    for (header, body, says) in [
        ("", flat.clone(), "neither"),
        ("#?RADIANCE\n", vec![], "the header has no end"),
        (&HEADER.replace("rgbe", "xyze"), flat.clone(), "xyze"),
        (&HEADER.replace("-Y 8 +X 16", "+Y 8 +X 16"), flat.clone(), "top left"),
        (&HEADER.replace("-Y 8 +X 16", "-Y eight +X 16"), flat.clone(), "whole numbers"),
        (&HEADER.replace("+X 16", "+X 15"), flat.clone(), "2:1"),
        (&HEADER.replace("8 +X 16", "18446744073709551615 +X 18446744073709551614"), flat.clone(), "2:1"),
        (&HEADER.replace("8 +X 16", "9223372036854775808 +X 0"), flat.clone(), "2:1"),
        (&HEADER.replace("8 +X 16", "2000000000 +X 4000000000"), flat.clone(), "at most 16384"),
        (&HEADER.replace("\n\n", "\nEXPOSURE=-1\n\n"), flat.clone(), "above 0"),
        (&HEADER.replace("\n\n", &"\nEXPOSURE=1e-20".repeat(3)).replace("-Y", "\n\n-Y"), flat.clone(), "EXPOSURE"),
        (HEADER, flat[..400].to_vec(), "scanline 6 of 8: the file ends"),
        (HEADER, [1, 1, 1, 4].repeat(128), "a run of 4 begins at pixel 0"),
        (HEADER, [9, 9, 9, 136, 1, 1, 1, 16].repeat(64), "a run of 16 begins at pixel 1"),
        (HEADER, [vec![9, 9, 9, 136], [1, 1, 1, 0].repeat(20)].concat().repeat(8), "runs follow"),
        (HEADER, [2, 2, 0, 17].repeat(128), "it says 17 pixels"),
        (HEADER, [2, 2, 0, 16, 0].repeat(128), "a run of 0"),
        (HEADER, [2, 2, 0, 16, 255].repeat(128), "a run of 127"),
    ] {
        radiance(&path, header, &body);
        let text = message(&path);
        assert!(text.contains(says) && text.contains("p.hdr"), "{says}: {text}");
    }
    radiance(&path, &format!("#?RADIANCE\n{}", "#".repeat(1 << 20)), &[]);
    assert!(message(&path).contains("no end"), "a header without end is not read without end");
    assert!(matches!(read_probe(&dir.path().join("none.hdr")), Err(Error::Io { action: "open", .. })));
    assert!(read_probe(dir.path()).is_err(), "a folder");
}

#[test]
fn bad_pixels_are_named_and_counted() {
    let dir = folder();
    let path = dir.path().join("p.exr");
    for bad in [f32::NAN, f32::INFINITY, -0.5] {
        let mut red = samples(0);
        red[35] = bad;
        red[36] = bad;
        flat(
            &path,
            vec![("R", FlatSamples::F32(red)), ("G", FlatSamples::F32(samples(1))), ("B", FlatSamples::F32(samples(2)))],
            Encoding::SMALL_LOSSLESS,
        );
        let text = message(&path);
        assert!(text.contains("pixel (3, 2)") && text.contains("1 more"), "{text}");
    }
    write_exr(&path, &picture(), &[]).unwrap();
    assert!(message(&path).contains("33x21 pixels; a lat-long probe is 2:1"), "{}", message(&path));
}

#[test]
fn a_little_below_zero_counts_as_zero() {
    let dir = folder();
    let path = dir.path().join("p.exr");
    let mut red = samples(0);
    (red[35], red[36]) = (-1e-3, -0.0);
    let channels =
        |red: &[f32]| vec![("R", FlatSamples::F32(red.to_vec())), ("G", FlatSamples::F32(samples(1))), ("B", FlatSamples::F32(samples(2)))];
    flat(&path, channels(&red), Encoding::SMALL_LOSSLESS);
    let probe = read_probe(&path).unwrap();
    assert_eq!((probe.pixels()[35][0], probe.pixels()[37][0]), (0.0, 5.0));
    // NaN stays an error, and is not made 0 beside it.
    red[40] = f32::NAN;
    flat(&path, channels(&red), Encoding::SMALL_LOSSLESS);
    assert!(message(&path).contains("pixel (3, 2)"), "{}", message(&path));
}

/// The picture is what the display window shows of the data.
#[test]
fn exr_windows_are_honoured() {
    let dir = folder();
    let path = dir.path().join("w.exr");
    let write = |size: (usize, usize), at: (i32, i32), display: IntegerBounds, alpha: bool| {
        let value = |i: usize, c: usize| {
            let (x, y) = ((i % size.0) as i32 + at.0 - display.position.0, (i / size.0) as i32 + at.1 - display.position.1);
            if x < 0 || y < 0 || x > 15 || y > 7 { 99.0 } else { value(x as usize, y as usize)[c] }
        };
        let channel = |name: &str, c: usize| AnyChannel::new(name, FlatSamples::F32((0..size.0 * size.1).map(|i| value(i, c)).collect()));
        let mut list = vec![channel("R", 0), channel("G", 1), channel("B", 2)];
        if alpha {
            list.push(AnyChannel::new("A", FlatSamples::F32(vec![1.0; size.0 * size.1])));
        }
        let mut attributes = LayerAttributes::named("main");
        attributes.layer_position = Vec2(at.0, at.1);
        let layer = Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, AnyChannels::sort(list.into_iter().collect()));
        Image::from_layers(ImageAttributes::new(display), vec![layer]).write().to_file(&path).unwrap();
    };
    let display = |x, y| IntegerBounds::new((x, y), (16, 8));
    // Overscan all around, and the windows anywhere.
    for (x, y) in [(0, 0), (-5, 7)] {
        write((20, 11), (x - 1, y - 2), display(x, y), false);
        assert_is_the_probe(&path, false);
    }
    // A crop: nothing elsewhere.
    write((5, 3), (4, 2), display(0, 0), true);
    let crop = read_picture_exr(&path).unwrap();
    assert_eq!((crop.width, crop.height), (16, 8));
    for (i, pixel) in crop.rgba.iter().enumerate() {
        let within = (4..9).contains(&(i % 16)) && (2..5).contains(&(i / 16));
        let [r, g, b] = value(i % 16, i / 16);
        assert_eq!(*pixel, if within { [r, g, b, 1.0] } else { [0.0; 4] }, "{i}");
    }
    // Of a large picture a small part, as renderers crop.
    write((300, 200), (400, 300), IntegerBounds::new((0, 0), (1920, 1080)), true);
    let small = read_picture_exr(&path).unwrap();
    assert!((small.width, small.height) == (1920, 1080) && small.rgba[300 * 1920 + 400][3] == 1.0 && small.rgba[0][3] == 0.0);
    // A little of very much would take memory for nothing.
    write((5, 3), (4, 2), IntegerBounds::new((0, 0), (8192, 4096)), false);
    assert!(message(&path).contains("5x3 pixels lie in a picture of 8192x4096"), "{}", message(&path));
}

/// Colours of other primaries are not converted; that is said.
#[test]
fn other_primaries_are_said() {
    let dir = folder();
    let path = dir.path().join("c.exr");
    let rec709 = [(0.64, 0.33), (0.3, 0.6), (0.15, 0.06), (0.3127, 0.329)];
    let ap1 = [(0.713, 0.293), (0.165, 0.83), (0.128, 0.044), (0.32168, 0.33767)];
    for (of, warned) in [(None, false), (Some(rec709), false), (Some(ap1), true)] {
        let list = (0..3).map(|c| AnyChannel::new(["R", "G", "B"][c], FlatSamples::F32(samples(c)))).collect();
        let layer = Layer::new((16, 8), LayerAttributes::named("main"), Encoding::SMALL_LOSSLESS, AnyChannels::sort(list));
        let mut attributes = ImageAttributes::new(IntegerBounds::from_dimensions((16, 8)));
        attributes.chromaticities = of.map(|of| {
            let [red, green, blue, white] = of.map(|(x, y)| Vec2(x, y));
            exr::meta::attribute::Chromaticities { red, green, blue, white }
        });
        Image::from_layers(attributes, vec![layer]).write().to_file(&path).unwrap();
        let (probe, said) = logs::warnings(|| read_probe(&path).unwrap());
        assert_eq!((probe.pixels()[5], said.len()), (value(5, 0), usize::from(warned)), "{said:?}");
        assert!(said.iter().all(|s| s.contains("c.exr: its chromaticities are not those of Rec. 709")), "{said:?}");
    }
}

/// Flips bytes, cuts and grows the file; every outcome but a panic is right.
fn mutate(path: &Path, original: &[u8], rounds: usize, mut read: impl FnMut(&Path) -> bool) -> usize {
    let mut state = 0x1234_5678_9abc_def1_u64;
    let mut random = |n: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % n as u64) as usize
    };
    let mut errors = 0;
    for round in 0..rounds {
        let mut bytes = original.to_vec();
        for _ in 0..1 + random(4) {
            // Mostly in the header, where sizes, counts and offsets stand.
            let at = if random(4) > 0 { random(bytes.len().min(600)) } else { random(bytes.len()) };
            bytes[at] = [0, 1, 0x7f, 0x80, 0xff, random(256) as u8][random(6)];
        }
        if round % 5 == 0 {
            bytes.truncate(random(original.len()));
        }
        // A new file each time: writing over an old one waits for the disk.
        std::fs::remove_file(path).unwrap();
        std::fs::write(path, &bytes).unwrap();
        errors += usize::from(!read(path));
    }
    errors
}

#[test]
fn damaged_files_never_panic() {
    let dir = folder();
    let path: PathBuf = dir.path().join("p.any");
    radiance(&path, HEADER, &new_rle());
    let original = std::fs::read(&path).unwrap();
    assert!(mutate(&path, &original, 1500, |p| read_probe(p).is_ok()) > 500);
    let float = |c| FlatSamples::F32(samples(c));
    for encoding in [Encoding::SMALL_LOSSLESS, Encoding::FAST_LOSSLESS, Encoding::SMALL_FAST_LOSSLESS] {
        flat(&path, vec![("R", float(0)), ("G", float(1)), ("B", float(2))], encoding);
        let original = std::fs::read(&path).unwrap();
        let errors = mutate(&path, &original, 1000, |p| read_probe(p).is_ok() & read_picture_exr(p).is_ok());
        assert!(errors > 200, "{errors}");
    }
}
