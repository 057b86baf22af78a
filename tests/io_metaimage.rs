//! MetaImage volumes written by a formula read back exactly; bad ones say what is wrong.

mod io_common;
use glam::DVec3;
use halflight::Result;
use halflight::io::{ReadOptions, SampleType, describe, read_volume};
use halflight::scene::Volume;
use io_common::{DIMS, Folder, bytes, gzip, meta_header, says, values, zlib};
use std::path::Path;

fn holds(volume: &Volume, kind: SampleType) -> bool {
    let expected = values(kind);
    volume.grid().dims() == DIMS && (0..expected.len()).all(|i| volume.value(i) == expected[i] as f32)
}

fn read(path: &Path) -> Result<Volume> {
    read_volume(path, &ReadOptions::default())
}

const TYPES: [(&str, SampleType); 10] = [
    ("MET_CHAR", SampleType::I8),
    ("MET_UCHAR", SampleType::U8),
    ("MET_SHORT", SampleType::I16),
    ("MET_USHORT", SampleType::U16),
    ("MET_LONG", SampleType::I32),
    ("MET_UINT", SampleType::U32),
    ("MET_LONG_LONG", SampleType::I64),
    ("MET_ULONG_LONG_ARRAY", SampleType::U64),
    ("MET_FLOAT", SampleType::F32),
    ("MET_DOUBLE", SampleType::F64),
];

#[test]
fn every_type_order_and_packing_reads_back() {
    let dir = Folder::new();
    for (name, kind) in TYPES {
        for big in [false, true] {
            let data = bytes(kind, big);
            let order = format!("BinaryData = True\n{} = {big}\n", if big { "BinaryDataByteOrderMSB" } else { "ElementByteOrderMSB" });
            let local = dir.file("a.mha", &[&meta_header(name, &order, "LOCAL"), &data]);
            assert!(holds(&read(&local).unwrap(), kind), "{name} {big}");
            dir.file("b.raw", &[b"head", &data]);
            let beside = dir.file("b.mhd", &[&meta_header(name, &format!("{order}HeaderSize = 4\n"), "b.raw")]);
            assert!(holds(&read(&beside).unwrap(), kind));
            // In the file itself it counts the header, too.
            let inside = |skip: usize| meta_header(name, &format!("{order}HeaderSize = {skip:4}\n"), "LOCAL");
            let skip = inside(0).len() + 4;
            assert!(holds(&read(&dir.file("i.mha", &[&inside(skip), b"head", &data])).unwrap(), kind));
            let tail = dir.file("b.mhd", &[&meta_header(name, &format!("{order}HeaderSize = -1\n"), "b.raw")]);
            assert!(holds(&read(&tail).unwrap(), kind));
            for (i, packed) in [zlib(&data), gzip(&data)].iter().enumerate() {
                let size = if i == 0 { format!("CompressedDataSize = {}\n", packed.len()) } else { String::new() };
                let more = format!("{order}CompressedData = True\n{size}");
                let path = dir.file("c.mha", &[&meta_header(name, &more, "LOCAL"), packed]);
                assert!(holds(&read(&path).unwrap(), kind), "{name} {big} packed {i}");
            }
        }
        let text: Vec<u8> = values(kind).iter().flat_map(|v| format!("{v}\n").into_bytes()).collect();
        let path = dir.file("t.mha", &[&meta_header(name, "BinaryData = False\n", "LOCAL"), &text]);
        assert!(holds(&read(&path).unwrap(), kind), "{name} in text");
    }
    // The comparison can fail.
    let wrong = dir.file("a.mha", &[&meta_header("MET_SHORT", "ElementByteOrderMSB = True\n", "LOCAL"), &bytes(SampleType::I16, false)]);
    assert!(!holds(&read(&wrong).unwrap(), SampleType::I16));
}

#[test]
fn place_and_intensity() {
    let dir = Folder::new();
    // Axes: x along +y of the world, y along -x, z along +z: a quarter turn.
    let more = "TransformMatrix = 0 1 0 -1 0 0 0 0 1\nOffset = 10 20 30\nElementSpacing = 0.5 2 3\n\
                ElementToIntensityFunctionSlope = 2\nElementToIntensityFunctionOffset = -100\n";
    let volume = read(&dir.file("a.mha", &[&meta_header("MET_UCHAR", more, "LOCAL"), &bytes(SampleType::U8, false)])).unwrap();
    let info = describe(&volume);
    assert_eq!((info.spacing, info.first_centre), ([0.5, 2.0, 3.0], [10.0, 20.0, 30.0]));
    assert_eq!(info.directions, [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
    let at = |x: f64, y: f64, z: f64| volume.grid().voxel_to_world().transform_point3(DVec3::new(x + 0.5, y + 0.5, z + 0.5));
    assert!((at(2.0, 0.0, 0.0) - DVec3::new(10.0, 21.0, 30.0)).length() < 1e-12);
    assert!((at(0.0, 1.0, 2.0) - DVec3::new(8.0, 20.0, 36.0)).length() < 1e-12);
    assert_eq!(volume.value(9), 2.0 * values(SampleType::U8)[9] as f32 - 100.0);
}

#[test]
fn channels_series_and_several_files() {
    let dir = Folder::new();
    let (a, b) = (bytes(SampleType::I16, false), bytes(SampleType::U16, false));
    let both: Vec<u8> = a.chunks(2).zip(b.chunks(2)).flat_map(|(a, b)| [a, b].concat()).collect();
    let path = dir.file("a.mha", &[&meta_header("MET_SHORT", "ElementNumberOfChannels = 2\n", "LOCAL"), &both]);
    says(read(&path), &["a.mha: each voxel has 2 channels; choose one with volume.component, 0 to 1"]);
    let pick = |path: &Path, c: &str| read_volume(path, &ReadOptions { component: Some(c.into()), ..Default::default() });
    assert!(holds(&pick(&path, "0").unwrap(), SampleType::I16));
    assert!(!holds(&pick(&path, "1").unwrap(), SampleType::I16));
    says(pick(&path, "2"), &["volume.component", "'2' is none of", "a.mha"]);
    let four =
        b"ObjectType = Image\nNDims = 4\nDimSize = 5 4 3 2\nElementSpacing = 1 1 2 1\nElementType = MET_SHORT\nElementDataFile = LOCAL\n";
    let path = dir.file("s.mha", &[four, &b, &a]);
    says(read(&path), &["a series of 2 volumes"]);
    assert!(holds(&pick(&path, "1").unwrap(), SampleType::I16));
    assert_eq!(describe(&pick(&path, "0").unwrap()).spacing, [1.0, 1.0, 2.0]);
    let apart = String::from_utf8_lossy(four).replace("ElementDataFile = LOCAL", "HeaderSize = -1\nElementDataFile = s.raw");
    dir.file("s.raw", &[b"head", &b, &a]);
    let tail = dir.file("t.mhd", &[apart.as_bytes()]);
    assert!(
        holds(&pick(&tail, "1").unwrap(), SampleType::I16) && pick(&tail, "0").unwrap().samples() == pick(&path, "0").unwrap().samples()
    );
    for (i, slab) in a.chunks(a.len() / 3).enumerate() {
        dir.file(&format!("s{:02}.raw", i + 1), &[slab]);
    }
    let list = dir.file("l.mhd", &[&meta_header("MET_SHORT", "", "LIST"), b"s01.raw\ns02.raw\ns03.raw\n"]);
    assert!(holds(&read(&list).unwrap(), SampleType::I16));
    let pattern = dir.file("p.mhd", &[&meta_header("MET_SHORT", "", "s%02d.raw 1 3 1")]);
    assert!(holds(&read(&pattern).unwrap(), SampleType::I16));
    for numbers in ["", " 1", " 1 3"] {
        let pattern = dir.file("p.mhd", &[&meta_header("MET_SHORT", "", &format!("s%02d.raw{numbers}"))]);
        assert!(holds(&read(&pattern).unwrap(), SampleType::I16), "'{numbers}'");
    }
    for numbers in [" 2", " 1 x", " 1 3 1 1"] {
        let pattern = dir.file("p.mhd", &[&meta_header("MET_SHORT", "", &format!("s%02d.raw{numbers}"))]);
        assert!(read(&pattern).is_err(), "'{numbers}'");
    }
    dir.file("s02.raw", &[b"short"]);
    says(read(&list), &["s02.raw: it holds 5 bytes", "each of its 3 files must hold 40"]);
    let two = dir.file("l.mhd", &[&meta_header("MET_SHORT", "", "LIST"), b"s01.raw\ns03.raw\n"]);
    says(read(&two), &["in 2 files", "3 slices must be spread evenly"]);
}

#[test]
fn bad_headers_say_what_would_be_right() {
    let dir = Folder::new();
    let data = bytes(SampleType::U8, false);
    let open = |text: &str| read(&dir.file("a.mha", &[text.as_bytes(), &data]));
    says(read(&dir.file("a.mha", &[b"NDims = 3\nDimSize = 5 4 3\n"])), &["a.mha", "no line ElementDataFile"]);
    says(open("NDims = 3\nDimSize = 5 4 x\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n"), &["line 2: 'DimSize = 5 4 x'; 3 numbers"]);
    says(open("NDims = 7\nElementDataFile = LOCAL\n"), &["line 1: 'NDims = 7'; 2 to 4"]);
    says(open("NDims = 3\nDimSize = 5 4 3\nDimSize = 5 4 3\n"), &["line 3 gives 'DimSize' a second time"]);
    // MetaIO takes both signs, and keys that it does not know as often as they stand there.
    let odd = "ObjectType: Image\nNDims : 3\nDimSize: 5 4 3\nFrom = a: b\nFrom = c\nElementType = MET_UCHAR\nElementDataFile: LOCAL\n";
    assert!(holds(&open(odd).unwrap(), SampleType::U8));
    assert!(holds(&read(&dir.file("a.dat", &[odd.as_bytes(), &data])).unwrap(), SampleType::U8));
    says(open("ObjectType = Tube\nNDims = 3\nElementDataFile = LOCAL\n"), &["of type 'Tube'", "ObjectType = Image"]);
    says(
        open("NDims = 3\nDimSize = 5 4 3\nElementType = MET_STRING\nElementDataFile = LOCAL\n"),
        &["MET_STRING", "MET_CHAR to MET_DOUBLE"],
    );
    says(open("NDims = 3\nwhat\nElementDataFile = LOCAL\n"), &["line 2 is 'what'", "Key = Value"]);
    let with = |more: &str, data: &str| read(&dir.file("a.mhd", &[&meta_header("MET_UCHAR", more, data)]));
    says(with("", "../x.raw"), &["lies elsewhere"]);
    says(with("", "/dev/zero"), &["lies elsewhere"]);
    says(with("", "none.raw"), &["'none.raw' is not there"]);
    says(with("ElementSpacing = 0 1 1\n", "none.raw"), &["span no volume"]);
    says(with("BinaryData = Maybe\n", "none.raw"), &["True or False"]);
    dir.file("s.raw", &[&data[..50]]);
    says(with("", "s.raw"), &["s.raw", "need 60 bytes, the file holds 50", "cut short"]);
    says(with("CompressedData = True\n", "s.raw"), &["s.raw", "zlib data are damaged"]);
    dir.file("z.raw", &[&zlib(&data)[..20]]);
    says(with("CompressedData = True\n", "z.raw"), &["zlib data break off"]);
    says(with("CompressedData = True\nCompressedDataSize = 999\n", "z.raw"), &["CompressedDataSize = 999", "holds 20 bytes"]);
    says(
        read(&dir.file("i.mha", &[&meta_header("MET_UCHAR", "HeaderSize = 4\n", "LOCAL"), b"head", &data])),
        &["HeaderSize = 4", "from the file's first byte, and the header ends at byte 108"],
    );
    // A bomb: sixty-four MiB from a few bytes are refused by the claim, not by the memory they would take.
    let bomb = meta_header("MET_UCHAR", "CompressedData = True\n", "z.raw");
    let bomb = String::from_utf8(bomb).unwrap().replace("5 4 3", "1000 1000 64");
    says(read(&dir.file("b.mhd", &[bomb.as_bytes()])), &["more than the zlib data can hold"]);
    assert!(read_volume(&dir.path("b.mhd"), &ReadOptions { max_bytes: 1 << 20, ..Default::default() }).is_err());
}
