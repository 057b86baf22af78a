//! DICOM series written by a formula read back exactly; odd ones are said, bad ones say what is wrong.

mod io_common;
use glam::DVec3;
use halflight::Result;
use halflight::io::{ReadOptions, SampleType, describe, read_volume};
use halflight::scene::Volume;
use io_common::{DIMS, Dicom, Folder, IMPLICIT, RLE, bytes, dicom_series, element, rle16, says, slice, values};
use std::path::Path;

fn holds(volume: &Volume, kind: SampleType) -> bool {
    let expected = values(kind);
    volume.grid().dims() == DIMS && (0..expected.len()).all(|i| volume.value(i) == expected[i] as f32)
}

fn read(path: &Path) -> Result<Volume> {
    read_volume(path, &ReadOptions::default())
}

fn sixteen(d: &mut Dicom, z: usize, kind: SampleType) {
    d.bits = [16, 16, 15];
    d.signed = kind == SampleType::I16;
    d.pixels = slice(kind, z);
}

#[test]
fn a_series_is_sorted_and_placed() {
    let dir = Folder::new();
    let folder = dicom_series(&dir.path("s"), |_, _| {});
    std::fs::write(folder.join("notes.txt"), "no image").unwrap();
    let volume = read(&folder).unwrap();
    assert!(holds(&volume, SampleType::U8));
    let info = describe(&volume);
    // PixelSpacing gives the distance of rows first.
    assert_eq!((info.spacing, info.first_centre), ([0.75, 0.5, 2.5], [10.0, 20.0, -4.0]));
    // One file is one slice.
    assert_eq!(read(&folder.join("b")).unwrap().grid().dims(), [5, 4, 1]);
    // Sorted along the normal, wherever that points: rows along +y, columns along +z, so slices ascend along +x.
    let turned = dicom_series(&dir.path("t"), |z, d| {
        d.orientation = [0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        d.position = Some([3.0 * z as f64, 0.1 * z as f64, 5.0]);
    });
    let volume = read(&turned).unwrap();
    assert!(holds(&volume, SampleType::U8));
    // A tilted gantry: the third axis is not the normal.
    let at = volume.grid().voxel_to_world().transform_point3(DVec3::new(2.5, 0.5, 2.5));
    assert!((at - DVec3::new(6.0, 0.2 + 1.5, 5.0)).length() < 1e-9, "{at}");
}

#[test]
fn types_syntaxes_and_rescaling() {
    let dir = Folder::new();
    for (i, kind) in [SampleType::U16, SampleType::I16].into_iter().enumerate() {
        let name = |s: &str| dir.path(&format!("{s}{i}"));
        assert!(holds(&read(&dicom_series(&name("e"), |z, d| sixteen(d, z, kind))).unwrap(), kind));
        let implicit = dicom_series(&name("i"), |z, d| {
            sixteen(d, z, kind);
            d.syntax = IMPLICIT.into();
        });
        assert!(holds(&read(&implicit).unwrap(), kind));
        let rle = dicom_series(&name("r"), |z, d| {
            sixteen(d, z, kind);
            d.pixels = rle16(&d.pixels);
            d.syntax = RLE.into();
        });
        assert!(holds(&read(&rle).unwrap(), kind));
    }
    let hounsfield = dicom_series(&dir.path("h"), |z, d| {
        sixteen(d, z, SampleType::U16);
        d.rescale = Some([2.0, -1024.0]);
    });
    let volume = read(&hounsfield).unwrap();
    assert_eq!((volume.rescale(), volume.value(7)), ((2.0, -1024.0), 2.0 * values(SampleType::U16)[7] as f32 - 1024.0));
    // As PET has it: a slope per slice.
    let pet = dicom_series(&dir.path("p"), |z, d| {
        sixteen(d, z, SampleType::U16);
        d.rescale = Some([1.0 + z as f64, 0.5]);
    });
    let volume = read(&pet).unwrap();
    let expected = values(SampleType::U16);
    assert!((0..60).all(|i| volume.value(i) == (1 + i / 20) as f32 * expected[i] as f32 + 0.5));
    // 12 of 16 bits, signed, with an overlay in the highest bits.
    let twelve = dicom_series(&dir.path("12"), |z, d| {
        sixteen(d, z, SampleType::I16);
        d.bits = [16, 12, 11];
        let small = |i: usize| (i as i16 - 10) * 200;
        d.pixels = (0..20).flat_map(|i| ((small(i) as u16 & 0xfff) | 0xb000).to_le_bytes()).collect();
    });
    let volume = read(&twelve).unwrap();
    assert!((0..20).all(|i| volume.value(i) == (i as f32 - 10.0) * 200.0));
    // Colours, in planes.
    let rgb = dicom_series(&dir.path("rgb"), |_, d| {
        (d.samples, d.planar, d.photometric) = (3, 1, "RGB".into());
        d.pixels = [d.pixels.clone(), vec![1; 20], vec![2; 20]].concat();
    });
    says(read(&rgb), &["its pixels have 3 samples (RGB)", "volume.component: R, G, B"]);
    let pick = |c: &str| read_volume(&rgb, &ReadOptions { component: Some(c.into()), ..Default::default() }).unwrap();
    assert!(holds(&pick("R"), SampleType::U8) && pick("B").range() == [2.0, 2.0]);
}

/// Big-endian words hold two samples of a byte, the second first; two frames of 15 share a word.
#[test]
fn bytes_in_big_endian_words() {
    let e = |tag: u32, vr: &str, value: &[u8]| {
        let length = match vr {
            "OW" | "OB" => [&[0, 0][..], &(value.len() as u32).to_be_bytes()].concat(),
            _ => (value.len() as u16).to_be_bytes().to_vec(),
        };
        [&tag.to_be_bytes()[..], vr.as_bytes(), &length, value].concat()
    };
    let us = |tag, v: u16| e(tag, "US", &v.to_be_bytes());
    let file = |vr: &str, pixels: &[u8]| {
        let syntax = element(0x0002_0010, "UI", b"1.2.840.10008.1.2.2", false);
        let head = [us(0x0028_0002, 1), e(0x0028_0004, "CS", b"MONOCHROME2 "), e(0x0028_0008, "IS", b"2 "), us(0x0028_0010, 3)].concat();
        let bits = [us(0x0028_0011, 5), us(0x0028_0100, 8), us(0x0028_0101, 8), us(0x0028_0102, 7), us(0x0028_0103, 0)].concat();
        [vec![0; 128], b"DICM".to_vec(), syntax, head, bits, e(0x7fe0_0010, vr, pixels)].concat()
    };
    let dir = Folder::new();
    let pixels: Vec<u8> = (0..30).collect();
    let mut words = pixels.clone();
    words.chunks_mut(2).for_each(<[u8]>::reverse);
    for (vr, content) in [("OW", &words), ("OB", &pixels)] {
        let volume = read(&dir.file("a.dcm", &[&file(vr, content)])).unwrap();
        assert_eq!(volume.grid().dims(), [5, 3, 2]);
        assert!((0..30).all(|i| volume.value(i) == i as f32), "{vr}");
    }
    // The comparison sees bytes that stay where they are.
    assert_eq!(read(&dir.file("a.dcm", &[&file("OW", &pixels)])).unwrap().value(0), 1.0);
}

#[test]
fn multi_frame_files() {
    let dir = Folder::new();
    let item = |value: &[u8]| [&[0xfe, 0xff, 0, 0xe0][..], &(value.len() as u32).to_le_bytes(), value].concat();
    let sequence = |tag, items: &[u8]| element(tag, "SQ", items, false);
    let text = |tag, value: &str| element(tag, "DS", value.as_bytes(), false);
    // Frames in an order that is not theirs, each with its position; what is shared stands once.
    let order = [2usize, 0, 1];
    let frames: Vec<u8> =
        order.iter().flat_map(|z| item(&sequence(0x0020_9113, &item(&text(0x0020_0032, &format!("1\\2\\{}", 4 * z)))))).collect();
    let shared = [
        sequence(0x0020_9116, &item(&text(0x0020_0037, "1\\0\\0\\0\\1\\0"))),
        sequence(0x0028_9110, &item(&text(0x0028_0030, "2\\3"))),
        sequence(0x0028_9145, &item(&[text(0x0028_1052, "5"), text(0x0028_1053, "2")].concat())),
    ]
    .concat();
    let mut d = Dicom::new(1, 0.0, order.iter().flat_map(|&z| slice(SampleType::U8, z)).collect());
    (d.frames, d.position) = (Some(3), None);
    d.more = [sequence(0x5200_9229, &item(&shared)), sequence(0x5200_9230, &frames)].concat();
    let volume = read(&dir.file("m.dcm", &[&d.bytes()])).unwrap();
    let (info, expected) = (describe(&volume), values(SampleType::U8));
    assert_eq!((info.spacing, info.first_centre), ([3.0, 2.0, 4.0], [1.0, 2.0, 0.0]));
    assert!((0..60).all(|i| volume.value(i) == 2.0 * expected[i] as f32 + 5.0));
    // Without positions: in order, as thick as a slice.
    let mut plain = Dicom::new(1, 0.0, bytes(SampleType::U8, false));
    (plain.frames, plain.position) = (Some(3), None);
    let volume = read(&dir.file("p.dcm", &[&plain.bytes()])).unwrap();
    assert!(holds(&volume, SampleType::U8) && describe(&volume).spacing == [0.75, 0.5, 2.5]);
    // With the first frame's position: along the normal from there, by the thickness or by their own offsets, as a dose has them.
    plain.position = Some([1.0, 2.0, 3.0]);
    let info = describe(&read(&dir.file("p.dcm", &[&plain.bytes()])).unwrap());
    assert_eq!((info.spacing, info.first_centre), ([0.75, 0.5, 2.5], [1.0, 2.0, 3.0]));
    let dose = |offsets: &str| [text(0x3004_000c, offsets), text(0x3004_000e, "0.5")].concat();
    plain.more = dose("10\\14\\18");
    let volume = read(&dir.file("p.dcm", &[&plain.bytes()])).unwrap();
    assert_eq!((describe(&volume).spacing, describe(&volume).first_centre), ([0.75, 0.5, 4.0], [1.0, 2.0, 3.0]));
    assert!((0..60).all(|i| volume.value(i) == 0.5 * expected[i] as f32));
    plain.more = dose("0\\-4\\-8");
    let volume = read(&dir.file("p.dcm", &[&plain.bytes()])).unwrap();
    assert_eq!(describe(&volume).first_centre, [1.0, 2.0, -5.0]);
    assert!((0..60).all(|i| volume.value(i) == 0.5 * expected[(i + 40 - i / 20 * 40) % 60] as f32));
    plain.more = dose("0\\4");
    says(read(&dir.file("p.dcm", &[&plain.bytes()])), &["GridFrameOffsetVector is '0\\4'", "3 numbers"]);
    (plain.position, plain.more) = (None, Vec::new());
    plain.frames = Some(4);
    says(read(&dir.file("p.dcm", &[&plain.bytes()])), &["p.dcm: 4 frames", "need 80 bytes, its pixel data have 60"]);
}

#[test]
fn what_is_no_volume_is_refused() {
    let dir = Folder::new();
    let mixed = dicom_series(&dir.path("m"), |z, d| d.series = if z == 2 { "4.5.6".into() } else { "1.2.3".into() });
    says(read(&mixed), &["it holds 2 series: 1.2.3 (made by a test, 2 slices), 4.5.6", "choose one with volume.series"]);
    let series = |uid: &str| read_volume(&mixed, &ReadOptions { series: Some(uid.into()), ..Default::default() });
    assert_eq!(series("1.2.3").unwrap().grid().dims(), [5, 4, 2]);
    assert_eq!(series("4.5.6").unwrap().grid().dims(), [5, 4, 1]);
    says(series("7"), &["volume.series", "is '7'", "1.2.3", "4.5.6"]);
    let same = dicom_series(&dir.path("d"), |z, d| d.position = Some([0.0, 0.0, if z == 1 { 0.0 } else { z as f64 }]));
    says(read(&same), &["lie at the same place", "several times, echoes or phases"]);
    let sizes = dicom_series(&dir.path("z"), |z, d| {
        if z == 1 {
            (d.rows, d.columns) = (2, 10);
        }
    });
    says(read(&sizes), &["10x2", "5x4", "share size"]);
    let turned = dicom_series(&dir.path("o"), |z, d| {
        if z == 1 {
            d.orientation = [0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        }
    });
    says(read(&turned), &["share size, type, orientation"]);
    let jpeg = dicom_series(&dir.path("j"), |_, d| d.syntax = "1.2.840.10008.1.2.4.70".into());
    says(read(&jpeg), &["compressed as lossless JPEG", "gdcmconv --raw"]);
    let axes = dicom_series(&dir.path("a"), |_, d| d.orientation = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    says(read(&axes), &["ImageOrientationPatient", "right angles"]);
    let short = dicom_series(&dir.path("h"), |_, d| d.pixels.truncate(10));
    says(read(&short), &["need 20 bytes, its pixel data have 10"]);
    let one = ReadOptions { component: Some("1".into()), ..Default::default() };
    says(read_volume(&dicom_series(&dir.path("c"), |_, _| {}), &one), &["volume.component", "'1' is none of"]);
    std::fs::create_dir(dir.path("empty")).unwrap();
    says(read(&dir.path("empty")), &["a folder with 0 files, none of them DICOM, TIFF or PNG"]);
    let spaced = ReadOptions { spacing: Some([1.0; 3]), ..Default::default() };
    says(read_volume(&dir.path("c"), &spaced), &["volume.spacing", "changes nothing", "a DICOM series"]);
}

#[test]
fn gaps_keep_the_common_distance() {
    let dir = Folder::new();
    // Slices at 0, 1, 2, 3, 5, 6: one is missing (a warning says so); they stay 1 apart.
    let folder = dir.path("g");
    std::fs::create_dir(&folder).unwrap();
    for (i, z) in [0.0, 1.0, 2.0, 3.0, 5.0, 6.0].into_iter().enumerate() {
        std::fs::write(folder.join(format!("{i}.dcm")), Dicom::new(i as i32, z, slice(SampleType::U8, 0)).bytes()).unwrap();
    }
    let info = describe(&read(&folder).unwrap());
    assert_eq!((info.dims, info.spacing), ([5, 4, 6], [0.75, 0.5, 1.0]));
}
