//! DICOM objects of nuclear medicine, what is said of samples that a table would change, and files as scanners and archives leave
//! them: padding, mosaics, rounded positions, series that share a folder.

mod io_common;
use glam::DVec3;
use halflight::Result;
use halflight::io::{ReadOptions, SampleType, describe, read_volume};
use halflight::scene::Volume;
use io_common::logs::warnings;
use io_common::{DIMS, Dicom, Folder, IMPLICIT, bytes, dicom_series, element, says, slice, values};
use std::path::Path;

fn read(path: &Path) -> Result<Volume> {
    read_volume(path, &ReadOptions::default())
}

/// Whether frame `z` of the formula lies where `place` says: the centre of each of its voxels, from the file's own words.
fn lies(volume: &Volume, place: impl Fn(f64, f64, f64) -> DVec3) -> bool {
    let expected = values(SampleType::U8);
    let to_voxel = volume.grid().voxel_to_world().inverse();
    volume.grid().dims() == DIMS
        && (0..60).all(|i| {
            let (x, y, z) = (i % 5, i / 5 % 4, i / 20);
            let v = to_voxel.transform_point3(place(x as f64, y as f64, z as f64)) - DVec3::splat(0.5);
            let near = (v - v.round()).length() < 1e-6 && v.round().cmpge(DVec3::ZERO).all();
            let at = v.round().as_usizevec3();
            near && at.x < 5 && at.y < 4 && at.z < 3 && volume.value(at.x + 5 * at.y + 20 * at.z) == expected[i] as f32
        })
}

fn text(tag: u32, value: &str, implicit: bool) -> Vec<u8> {
    element(tag, "DS", value.as_bytes(), implicit)
}

fn sequence(tag: u32, items: &[&[u8]], implicit: bool) -> Vec<u8> {
    let item = |value: &&[u8]| [&[0xfe, 0xff, 0, 0xe0][..], &(value.len() as u32).to_le_bytes(), value].concat();
    element(tag, "SQ", &items.iter().flat_map(item).collect::<Vec<u8>>(), implicit)
}

/// Three frames, without a place of their own.
fn frames(syntax: &str) -> Dicom {
    let mut d = Dicom::new(1, 0.0, bytes(SampleType::U8, false));
    (d.syntax, d.frames, d.position) = (syntax.into(), Some(3), None);
    d
}

#[test]
fn the_sign_of_the_spacing_is_the_direction_of_stacking() {
    let dir = Folder::new();
    for spacing in [4.0, -4.0] {
        for syntax in [io_common::EXPLICIT, IMPLICIT] {
            let mut d = frames(syntax);
            d.between = Some(spacing);
            d.position = Some([1.0, 2.0, 3.0]);
            let placed = read(&dir.file("p.dcm", &[&d.bytes()])).unwrap();
            let from = |p: [f64; 3]| move |x: f64, y: f64, z: f64| DVec3::from(p) + DVec3::new(0.75 * x, 0.5 * y, spacing * z);
            assert!(lies(&placed, from([1.0, 2.0, 3.0])), "{spacing}");
            // The comparison sees a mirrored volume.
            assert!(!lies(&placed, |x, y, z| from([1.0, 2.0, 3.0])(x, y, -z)));
            // Without a place the first frame lies at the origin.
            d.position = None;
            assert!(lies(&read(&dir.file("n.dcm", &[&d.bytes()])).unwrap(), from([0.0; 3])), "{spacing} without a place");
        }
    }
    // Slices that have positions lie there; one slice is as thick as the spacing says.
    let series = dicom_series(&dir.path("s"), |_, d| d.between = Some(-4.0));
    assert!(lies(&read(&series).unwrap(), |x, y, z| DVec3::new(10.0 + 0.75 * x, 20.0 + 0.5 * y, -4.0 + 2.5 * z)));
    let one = read(&series.join("b")).unwrap();
    assert_eq!(one.grid().voxel_to_world().transform_vector3(DVec3::Z), DVec3::new(0.0, 0.0, 4.0));
}

#[test]
fn the_detector_says_where_the_slices_lie() {
    let dir = Folder::new();
    // A coronal one: columns descend along z, so that the normal is +y.
    let place = |x: f64, y: f64, z: f64| DVec3::new(5.0 + 0.75 * x, 6.0 - 4.0 * z, 7.0 - 0.5 * y);
    for syntax in [io_common::EXPLICIT, IMPLICIT] {
        let implicit = syntax == IMPLICIT;
        let detector =
            |position: &str, orientation: &str| [text(0x0020_0032, position, implicit), text(0x0020_0037, orientation, implicit)].concat();
        let first = detector("5\\6\\7", "1\\0\\0\\0\\0\\-1");
        let second = detector("50\\60\\70", "0\\1\\0\\0\\0\\-1");
        let mut d = frames(syntax);
        d.between = Some(-4.0);
        d.more = sequence(0x0054_0022, &[&first, &second], implicit);
        assert!(lies(&read(&dir.file("d.dcm", &[&d.bytes()])).unwrap(), place), "{syntax}");
        // The object's own place comes before it; the same elements elsewhere speak of other images.
        d.position = Some([1.0, 2.0, 3.0]);
        let own = |x: f64, y: f64, z: f64| DVec3::new(1.0 + 0.75 * x, 2.0 + 0.5 * y, 3.0 - 4.0 * z);
        assert!(lies(&read(&dir.file("d.dcm", &[&d.bytes()])).unwrap(), own));
        d.position = None;
        d.more = sequence(0x0054_0012, &[&first], implicit);
        assert!(lies(&read(&dir.file("d.dcm", &[&d.bytes()])).unwrap(), |x, y, z| DVec3::new(0.75 * x, 0.5 * y, -4.0 * z)));
    }
}

#[test]
fn tables_are_said_once() {
    let dir = Folder::new();
    let (plain, none) = warnings(|| read(&dicom_series(&dir.path("p"), |_, _| {})).unwrap());
    assert!(none.is_empty(), "{none:?}");
    let table = sequence(0x0028_3000, &[&text(0x0028_3003, "a table", false)], false);
    let (volume, said) = warnings(|| read(&dicom_series(&dir.path("t"), |_, d| d.more = table.clone())).unwrap());
    assert!(said.len() == 1 && said[0].contains("its Modality LUT is not applied"), "{said:?}");
    assert_eq!(volume.range(), plain.range());
    let palette = |_: usize, d: &mut Dicom| d.photometric = "PALETTE COLOR ".into();
    let (volume, said) = warnings(|| read(&dicom_series(&dir.path("c"), palette)).unwrap());
    assert!(said.len() == 1 && said[0].contains("indices of a palette (PALETTE COLOR)"), "{said:?}");
    assert_eq!(volume.range(), plain.range());
    // Elsewhere the table is another image's.
    let inner = sequence(0x0028_9999, &[&table], false);
    assert!(warnings(|| read(&dicom_series(&dir.path("i"), |_, d| d.more = inner.clone())).unwrap()).1.is_empty());
}

#[test]
fn padding_counts_as_the_smallest_sample() {
    let dir = Folder::new();
    let us = |tag: u32, v: i32| element(tag, "US", &(v as u16).to_le_bytes(), false);
    // The first voxel of each slice is padding, the others are 0 to 1900.
    let padded = |name: &str, signed: bool, at: i32, more: &[u8]| {
        dicom_series(&dir.path(name), |_, d| {
            (d.bits, d.signed, d.rescale, d.more) = ([16, 16, 15], signed, Some([1.0, -1024.0]), more.to_vec());
            d.pixels = (0..20).flat_map(|i| (if i == 0 { at as u16 } else { 100 * i as u16 }).to_le_bytes()).collect();
        })
    };
    for (i, (signed, at, more)) in [
        (true, -2000, us(0x0028_0120, -2000)),
        (false, 63536, us(0x0028_0120, 63536)),
        (true, -2500, [us(0x0028_0120, -3000), us(0x0028_0121, -2000)].concat()),
        (true, -2500, [us(0x0028_0120, -2000), us(0x0028_0121, -3000)].concat()),
    ]
    .into_iter()
    .enumerate()
    {
        let (volume, said) = warnings(|| read(&padded(&format!("p{i}"), signed, at, &more)).unwrap());
        assert_eq!((volume.range(), volume.value(0), volume.value(20)), ([-924.0, 876.0], -924.0, -924.0), "{at}");
        assert!(said.len() == 1 && said[0].contains("3 samples are padding") && said[0].contains("smallest sample, 100"), "{said:?}");
        assert_eq!(volume.value(7), -324.0);
    }
    // Between the image's samples it is one of them; without the element all are.
    for more in [us(0x0028_0120, 300), Vec::new()] {
        let (volume, said) = warnings(|| read(&padded(&format!("o{}", more.len()), true, -2000, &more)).unwrap());
        assert!(volume.range() == [-3024.0, 876.0] && volume.value(3) == -724.0 && said.is_empty(), "{said:?}");
    }
    // Labels have a background, which is one of them.
    let labels = [us(0x0028_0120, -2000), element(0x0062_0001, "CS", b"LABELMAP", false)].concat();
    let (volume, said) = warnings(|| read(&padded("labels", true, -2000, &labels)).unwrap());
    assert!(volume.range() == [-3024.0, 876.0] && said.is_empty(), "{said:?}");
    // All of a volume may be padding.
    let (volume, _) =
        warnings(|| read(&dicom_series(&dir.path("all"), |_, d| (d.pixels, d.more) = (vec![7; 20], us(0x0028_0120, 7)))).unwrap());
    assert_eq!(volume.range(), [7.0, 7.0]);
}

#[test]
fn a_shared_place_is_the_place_of_every_frame() {
    let dir = Folder::new();
    let mut d = frames(io_common::EXPLICIT);
    let shared = [
        sequence(0x0020_9113, &[&text(0x0020_0032, "1\\2\\3", false)], false),
        sequence(0x0020_9116, &[&text(0x0020_0037, "1\\0\\0\\0\\1\\0", false)], false),
    ]
    .concat();
    d.more = sequence(0x5200_9229, &[&shared], false);
    says(read(&dir.file("t.dcm", &[&d.bytes()])), &["frames of", "t.dcm lie at the same place", "dcm2niix"]);
    // A place of its own for each: a volume.
    let places: Vec<Vec<u8>> = (0..3).map(|z| sequence(0x0020_9113, &[&text(0x0020_0032, &format!("1\\2\\{z}"), false)], false)).collect();
    let places: Vec<&[u8]> = places.iter().map(Vec::as_slice).collect();
    d.more.extend(sequence(0x5200_9230, &places, false));
    assert_eq!(read(&dir.file("t.dcm", &[&d.bytes()])).unwrap().grid().spacing()[2], 1.0);
}

#[test]
fn a_mosaic_is_no_slice() {
    let dir = Folder::new();
    let kind = element(0x0008_0008, "CS", b"ORIGINAL\\PRIMARY\\M\\ND\\MOSAIC ", false);
    let mut d = Dicom::new(1, 0.0, slice(SampleType::U8, 0));
    d.more = kind.clone();
    says(read(&dir.file("m.dcm", &[&d.bytes()])), &["m.dcm: its one picture is a mosaic", "dcm2niix"]);
    // Unpacked ones keep the word.
    let mut unpacked = frames(io_common::EXPLICIT);
    unpacked.more = kind;
    assert_eq!(read(&dir.file("u.dcm", &[&unpacked.bytes()])).unwrap().grid().dims(), DIMS);
}

#[test]
fn rounded_positions_do_not_stretch_a_volume() {
    let dir = Folder::new();
    let folder = dir.path("r");
    std::fs::create_dir(&folder).unwrap();
    for i in 0..41 {
        let z = (12.5 * f64::from(i)).round() / 10.0;
        std::fs::write(folder.join(format!("{i:02}")), Dicom::new(i, z, slice(SampleType::U8, 0)).bytes()).unwrap();
    }
    let (volume, said) = warnings(|| read(&folder).unwrap());
    // Gaps of 1.2 and 1.3: the median is either, 4 % off.
    assert!((volume.grid().spacing()[2] - 1.25).abs() < 1e-9 && said.len() == 1, "{} {said:?}", volume.grid().spacing()[2]);
}

#[test]
fn slices_may_use_other_bits_of_their_samples() {
    let dir = Folder::new();
    let bits = |name: &str, change: &dyn Fn(usize, &mut Dicom)| {
        read(&dicom_series(&dir.path(name), |z, d| {
            d.bits = [16, [12, 11, 16][z], [11, 10, 15][z]];
            d.pixels = (0..20u16).flat_map(|i| (i + 20 * z as u16).to_le_bytes()).collect();
            change(z, d);
        }))
    };
    let volume = bits("b", &|_, _| {}).unwrap();
    assert!((0..60).all(|i| volume.value(i) == i as f32));
    // What does not fit is named with what it differs in.
    let odd = bits("s", &|z, d| d.spacing = if z == 1 { [0.5, 0.8] } else { d.spacing });
    says(odd, &["0.8x0.5 mm", "0.75x0.5 mm", "share size, type, orientation and spacing"]);
    says(bits("t", &|z, d| d.signed = z == 1), &["16 bits signed", "16 bits, MONOCHROME2"]);
}

#[test]
fn what_cannot_be_read_of_another_series_is_no_matter() {
    let dir = Folder::new();
    let jpeg = |d: &mut Dicom| d.syntax = "1.2.840.10008.1.2.4.70".into();
    let folder = dicom_series(&dir.path("s"), |z, d| {
        if z == 1 {
            (d.series, d.columns) = ("4.5.6".into(), 7);
            jpeg(d);
        }
    });
    says(read(&folder), &["it holds 2 series", "1.2.3 (made by a test, 2 slices)", "4.5.6 (no description, 0 slices, not readable)"]);
    let series = |uid: &str| read_volume(&folder, &ReadOptions { series: Some(uid.into()), ..Default::default() });
    assert_eq!(describe(&series("1.2.3").unwrap()).dims, [5, 4, 2]);
    says(series("4.5.6"), &["compressed as lossless JPEG"]);
    // Of the same series it is.
    let own = dicom_series(&dir.path("o"), |z, d| {
        if z == 1 {
            jpeg(d)
        }
    });
    says(read(&own), &["compressed as lossless JPEG"]);
}

#[test]
fn a_slope_of_zero_is_one() {
    let dir = Folder::new();
    let (volume, said) = warnings(|| read(&dicom_series(&dir.path("z"), |_, d| d.rescale = Some([0.0, 5.0]))).unwrap());
    assert_eq!(volume.rescale(), (1.0, 5.0));
    assert!(said.len() == 1 && said[0].contains("its RescaleSlope is 0; 1 is taken"), "{said:?}");
    let mut dose = frames(io_common::EXPLICIT);
    dose.more = text(0x3004_000e, "1e60", false);
    says(read(&dir.file("d.dcm", &[&dose.bytes()])), &["DoseGridScaling is '1e60'", "float32"]);
}
