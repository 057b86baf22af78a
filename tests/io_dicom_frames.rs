//! DICOM objects of nuclear medicine, and what is said of samples that a table would change.

mod io_common;
use glam::DVec3;
use halflight::Result;
use halflight::io::{ReadOptions, SampleType, read_volume};
use halflight::scene::Volume;
use io_common::logs::warnings;
use io_common::{DIMS, Dicom, Folder, IMPLICIT, bytes, dicom_series, element, values};
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
