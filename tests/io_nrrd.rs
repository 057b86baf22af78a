//! NRRD volumes written by a formula read back exactly; bad ones say what is wrong.

mod io_common;
use glam::DVec3;
use halflight::Result;
use halflight::io::{RawLayout, ReadOptions, SampleType, read_volume};
use halflight::scene::Volume;
use io_common::{DIMS, Folder, bytes, gzip, says, values};
use std::cell::RefCell;
use std::ops::ControlFlow;
use std::path::Path;

fn read(path: &Path) -> Result<Volume> {
    read_volume(path, &ReadOptions::default())
}

/// Whether the volume holds the formula exactly (rounded to `f32`).
fn holds(volume: &Volume, kind: SampleType) -> bool {
    let expected = values(kind);
    volume.grid().dims() == DIMS && (0..expected.len()).all(|i| volume.value(i) == expected[i] as f32)
}

fn header(kind: SampleType, encoding: &str, big: bool, more: &str) -> String {
    let endian = if big { "big" } else { "little" };
    let name = match kind {
        SampleType::F32 => "float",
        SampleType::F64 => "double",
        k => k.name(),
    };
    format!(
        "NRRD0004\n# a comment\ntype: {name}\ndimension: 3\nsizes: 5 4 3\nencoding: {encoding}\nendian: {endian}\nkey:=a value\n{more}\n"
    )
}

#[test]
fn every_type_endian_and_encoding_reads_back() {
    let dir = Folder::new();
    for kind in SampleType::ALL {
        for big in [false, true] {
            let raw = bytes(kind, big);
            let text: String = values(kind).iter().map(|v| format!("{v}\n")).collect();
            let packed = gzip(&raw);
            for (encoding, data) in [("raw", raw.as_slice()), ("gzip", &packed), ("ascii", text.as_bytes())] {
                let attached = dir.file("a.nrrd", &[header(kind, encoding, big, "").as_bytes(), data]);
                let volume = read(&attached).unwrap();
                assert!(holds(&volume, kind), "{kind:?} {encoding} big {big}");
                let expected = match kind {
                    SampleType::U8 => "uint8",
                    SampleType::I8 | SampleType::I16 => "int16",
                    SampleType::U16 => "uint16",
                    _ => "float32",
                };
                assert_eq!(volume.samples().type_name(), expected);

                dir.file("d.data", &[data]);
                let detached = dir.file("d.nhdr", &[header(kind, encoding, big, "data file: d.data").as_bytes()]);
                assert!(holds(&read(&detached).unwrap(), kind), "{kind:?} {encoding} big {big} detached");
            }
        }
    }
}

#[test]
fn the_comparison_can_fail() {
    let dir = Folder::new();
    let mut raw = bytes(SampleType::I16, false);
    raw[40] ^= 1;
    let path = dir.file("a.nrrd", &[header(SampleType::I16, "raw", false, "").as_bytes(), &raw]);
    assert!(!holds(&read(&path).unwrap(), SampleType::I16), "one flipped bit is seen");
    let path = dir.file("a.nrrd", &[header(SampleType::I16, "raw", true, "").as_bytes(), &bytes(SampleType::I16, false)]);
    assert!(!holds(&read(&path).unwrap(), SampleType::I16), "the wrong byte order is seen");
}

#[test]
fn all_names_of_types() {
    use SampleType::*;
    let dir = Folder::new();
    let names: [(SampleType, &str); 10] = [
        (I8, "signed char|int8|int8_t"),
        (U8, "uchar|unsigned char|uint8|uint8_t"),
        (I16, "short|short int|signed short|signed short int|int16|int16_t"),
        (U16, "ushort|unsigned short|unsigned short int|uint16|uint16_t"),
        (I32, "int|signed int|int32|int32_t"),
        (U32, "uint|unsigned int|uint32|uint32_t"),
        (I64, "longlong|long long|long long int|signed long long|signed long long int|int64|int64_t"),
        (U64, "ulonglong|unsigned long long|unsigned long long int|uint64|uint64_t"),
        (F32, "float"),
        (F64, "double"),
    ];
    for (kind, list) in names {
        for name in list.split('|') {
            let head = format!("NRRD0001\ntype: {name}\ndimension: 3\nsizes: 5 4 3\nencoding: raw\nendian: little\n\n");
            let path = dir.file("a.nrrd", &[head.as_bytes(), &bytes(kind, false)]);
            assert!(holds(&read(&path).unwrap(), kind), "{name}");
        }
    }
}

/// The centre of voxel (i, j, k) in the world.
fn centre(volume: &Volume, i: usize, j: usize, k: usize) -> DVec3 {
    volume.grid().voxel_to_world().transform_point3(DVec3::new(i as f64, j as f64, k as f64) + 0.5)
}

#[test]
fn the_origin_is_the_centre_of_the_first_sample() {
    let dir = Folder::new();
    let data = bytes(SampleType::U8, false);
    let place = |more: &str| {
        let path = dir.file("a.nrrd", &[header(SampleType::U8, "raw", false, more).as_bytes(), &data]);
        read(&path).unwrap()
    };
    // Oblique and sheared: centre of (i, j, k) = origin + i·a + j·b + k·c.
    let (a, b, c) = (DVec3::new(0.8, 0.6, 0.0), DVec3::new(-1.2, 1.6, 0.1), DVec3::new(0.0, 0.5, -3.0));
    let o = DVec3::new(10.0, -20.0, 30.5);
    let volume = place(
        "space: left-posterior-superior\nspace directions: (0.8,0.6,0) (-1.2, 1.6, 0.1)  (0,5e-1,-3)\nspace origin: (10,-20,30.5)\nkinds: domain domain domain\n",
    );
    for (i, j, k) in [(0, 0, 0), (4, 0, 0), (0, 3, 0), (0, 0, 2), (4, 3, 2)] {
        let expected = o + a * i as f64 + b * j as f64 + c * k as f64;
        assert!((centre(&volume, i, j, k) - expected).length() < 1e-12, "voxel ({i}, {j}, {k})");
    }
    let corner = volume.grid().voxel_to_world().translation;
    assert!((corner - (o - 0.5 * (a + b + c))).length() < 1e-12);
    assert!((corner - o).length() > 1.0, "corner and centre are not the same place");
    // No origin: the box begins at the world origin.
    assert_eq!(centre(&place("spacings: 2 3 4\n"), 0, 0, 0), DVec3::new(1.0, 1.5, 2.0));
    assert_eq!(place("spacings: 2 nan 4\n").grid().spacing(), [2.0, 1.0, 4.0], "an unknown spacing counts as 1");
    assert_eq!(place("").grid().spacing(), [1.0; 3]);
}

#[test]
fn images_and_axes_of_size_one() {
    let dir = Folder::new();
    let data: Vec<u8> = (0..20).collect();
    let open = |fields: &str| {
        let head = format!("NRRD0005\r\ntype: uint8\r\nencoding: raw\r\n{fields}\r\n\r\n");
        read(&dir.file("a.nrrd", &[head.as_bytes(), &data]))
    };
    let image = open("dimension: 2\r\nsizes: 5 4\r\nspacings: 2 3").unwrap();
    assert_eq!((image.grid().dims(), image.grid().spacing()), ([5, 4, 1], [2.0, 3.0, 2.0]));
    let first = open("dimension: 4\nsizes: 1 5 2 2\nkinds: scalar domain domain domain\nspace dimension: 3\nspace directions: none (2,0,0) (0,3,0) (0,0,4)").unwrap();
    assert_eq!((first.grid().dims(), first.grid().spacing()), ([5, 2, 2], [2.0, 3.0, 4.0]));
    assert_eq!(open("dimension: 4\nsizes: 5 2 2 1\nspacings: 2 3 4 5").unwrap().grid().spacing(), [2.0, 3.0, 4.0]);
    assert_eq!(open("dimension: 3\nsizes: 20 1 1").unwrap().grid().dims(), [20, 1, 1]);
    says(
        open("dimension: 3\nsizes: 5 2 2\nkinds: RGB-color domain domain"),
        &["axis 0 has 5 samples", "'rgb-color'", "three axes in space"],
    );
    says(open("dimension: 4\nsizes: 5 2 2 1\nkinds: 3-vector domain domain domain"), &["axis 0", "3-vector"]);
    says(open("dimension: 3\nsizes: 5 2 2\nspace directions: (1,0,0) none (0,0,1)"), &["axis 1 has 2 samples and is without a direction"]);
    says(
        open(
            "dimension: 4\nsizes: 5 1 2 2\nkinds: domain domain domain domain\nspace dimension: 4\nspace directions: (1,0,0,0) (0,1,0,0) (0,0,1,0) (0,0,0,1)",
        ),
        &["axis 3 has 2 samples and is along the fourth dimension of its space"],
    );
    // Unless space leans into it.
    says(
        open("dimension: 3\nsizes: 5 2 2\nspace dimension: 4\nspace directions: (1,0,0,0) (0,1,0,0) (0,0,1,1)"),
        &["4 dimensions", "a fourth of time"],
    );
    // One slice several times, or in colours: its own thickness and place.
    let pick = |fields: &str| {
        let head = format!("NRRD0005\ntype: uint8\nencoding: raw\n{fields}\n\n");
        let path = dir.file("b.nrrd", &[head.as_bytes(), &data]);
        read_volume(&path, &ReadOptions { component: Some("1".into()), ..Default::default() }).unwrap()
    };
    let times = pick(
        "dimension: 4\nsizes: 5 2 1 2\nkinds: domain domain domain list\nspace dimension: 3\nspace directions: (0.7,0,0) (0,0.6,0) (0,0,8) none\nspace origin: (1,2,3)",
    );
    assert_eq!((times.grid().dims(), times.grid().spacing(), times.value(0)), ([5, 2, 1], [0.7, 0.6, 8.0], 10.0));
    let colours = pick(
        "dimension: 4\nsizes: 2 5 2 1\nkinds: vector domain domain domain\nspace dimension: 3\nspace directions: none (0.7,0,0) (0,0.6,0) (0,0,8)",
    );
    assert_eq!((colours.grid().dims(), colours.grid().spacing(), colours.value(1)), ([5, 2, 1], [0.7, 0.6, 8.0], 3.0));
    let within = pick("dimension: 4\nsizes: 5 2 2 1\nkinds: domain domain vector domain");
    assert_eq!((within.grid().dims(), within.value(0)), ([5, 2, 1], 10.0));
    // As ITK writes times: a fourth dimension of space.
    let itk = pick(
        "dimension: 4\nsizes: 5 2 1 2\nkinds: domain domain domain domain\nspace dimension: 4\nspace directions: (1,0,0,0) (0,2,0,0) (0,0,3,0) (0,0,0,0.5)\nspace origin: (0,0,0,7)",
    );
    assert_eq!((itk.grid().dims(), itk.grid().spacing(), itk.value(0)), ([5, 2, 1], [1.0, 2.0, 3.0], 10.0));
    says(open("dimension: 4\nsizes: 5 2 1 2\nspacings: 1 1 1"), &["'spacings: 1 1 1'", "4 entries", "3 stand there"]);
    says(open("dimension: 1\nsizes: 20"), &["one axis only"]);
    says(open("dimension: 5\nsizes: 5 2 2 2 2"), &["5 axes (5x2x2x2x2)", "axis 4 alone has 2"]);
}

/// The world is right-handed: the same patient in two spaces lies at the same place.
#[test]
fn a_left_handed_space_is_not_mirrored() {
    let dir = Folder::new();
    let place = |space: &str, sign: f64| {
        let head = format!(
            "NRRD0005\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\nspace: {space}\nspace directions: ({},0.1,0) (0,2,0) ({},0,3)\nspace origin: ({},20,30)\n\n",
            0.5 * sign,
            0.2 * sign,
            10.0 * sign
        );
        read(&dir.file("a.nrrd", &[head.as_bytes(), &bytes(SampleType::U8, false)])).unwrap().grid().voxel_to_world()
    };
    let right = place("right-anterior-superior", 1.0);
    assert!(right.matrix3.determinant() > 0.0);
    for space in ["left-anterior-superior", "LAS", "3D-left-handed"] {
        assert_eq!(place(space, -1.0), right, "{space}");
    }
    assert_ne!(place("RAS", -1.0), right);
}

#[test]
fn skips() {
    let dir = Folder::new();
    let data = bytes(SampleType::U16, false);
    let detached = |name: &str, more: &str, encoding: &str, parts: &[&[u8]]| {
        dir.file(name, parts);
        read(&dir.file("h.nhdr", &[header(SampleType::U16, encoding, false, &format!("datafile: {name}\n{more}")).as_bytes()]))
    };
    let v = detached("a.raw", "line skip: 2\nbyte skip: 3\n", "raw", &[b"one\ntwo\nxyz", &data]);
    assert!(holds(&v.unwrap(), SampleType::U16));
    let v = detached("a.raw", "byte skip: -1\n", "raw", &[b"anything before", &data]);
    assert!(holds(&v.unwrap(), SampleType::U16));
    // Lines are skipped before decompression, bytes after it.
    let packed = gzip(&[b"xyz".as_slice(), &data].concat());
    let v = detached("a.gz", "lineskip: 1\nbyteskip: 3\n", "gz", &[b"one\n", &packed]);
    assert!(holds(&v.unwrap(), SampleType::U16));
    // Two gzip members are one stream; what follows is left.
    let (one, two) = data.split_at(31);
    assert!(holds(&detached("a.gz", "", "gz", &[&gzip(one), &gzip(two), b"junk"]).unwrap(), SampleType::U16));
    assert!(holds(&detached("a.raw", "", "raw", &[&data, b"junk"]).unwrap(), SampleType::U16));
    says(detached("a.raw", "line skip: 5\n", "raw", &[b"one\n"]), &["5 lines are to be skipped, it has 1"]);
    says(detached("a.raw", "byte skip: 5\n", "raw", &[b"one\n"]), &["5 bytes are to be skipped where 4 are left"]);
    says(detached("a.raw", "byte skip: -1\n", "raw", &[b"one\n"]), &["need 120 bytes, the file holds 4"]);
    says(detached("a.gz", "byte skip: -1\n", "gzip", &[&packed]), &["'byte skip: -1'", "encoding: raw only"]);
}

#[test]
fn a_data_file_stays_in_its_folder() {
    let dir = Folder::new();
    let data = bytes(SampleType::U8, false);
    std::fs::create_dir(dir.path("sub")).unwrap();
    let secret = dir.file("secret.raw", &[&data]);
    let open = |name: &str, allow_outside: bool| {
        let h = dir.file("sub/h.nhdr", &[header(SampleType::U8, "raw", false, &format!("data file: {name}\n")).as_bytes()]);
        read_volume(&h, &ReadOptions { allow_outside, ..Default::default() })
    };
    let absolute = secret.to_str().unwrap();
    for name in ["../secret.raw", "./../secret.raw", absolute] {
        says(open(name, false), &["lies elsewhere", "header's folder"]);
        assert!(open(name, true).is_ok());
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&secret, dir.path("sub/link.raw")).unwrap();
        says(open("link.raw", false), &["lies elsewhere"]);
        assert!(open("link.raw", true).is_ok());
    }
    dir.file("sub/own.raw", &[&data]);
    assert!(open("./own.raw", false).is_ok());
    says(open("none.raw", false), &["its data file 'none.raw' is not there"]);
    says(open("none.raw", true), &["none.raw", "cannot open", "no such file"]);
    says(open(".", false), &["it is a folder"]);
    says(open("LIST", false), &["several files"]);
    says(open("LIST\ns00.raw\ns01.raw", false), &["several files are not read; `unu save` joins them"]);
    says(open("LIST 2\nslabs/s00.raw", false), &["'data file: LIST 2'", "several files"]);
    says(open("s%03d.raw 1 3 1", false), &["several files"]);
}

#[test]
fn bad_headers_say_what_is_wrong() {
    let dir = Folder::new();
    let data = bytes(SampleType::U8, false);
    let good = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n\n";
    let with = |from: &str, to: &str| {
        assert!(good.contains(from));
        read(&dir.file("a.nrrd", &[good.replace(from, to).as_bytes(), &data]))
    };
    assert!(holds(&with("uchar", "uchar").unwrap(), SampleType::U8));
    says(with("0004", "0009"), &["first line is 'NRRD0009'", "NRRD0001 to NRRD0005"]);
    says(with("type: uchar\n", ""), &["'type' is missing"]);
    says(with("dimension: 3\n", ""), &["'dimension' is missing"]);
    says(with("sizes: 5 4 3\n", ""), &["'sizes' is missing"]);
    says(with("encoding: raw\n", ""), &["'encoding' is missing", "gzip"]);
    says(with("uchar", "block"), &["'type: block'", "no scalars"]);
    says(with("uchar", "half"), &["line 2: 'type: half'", "float or double"]);
    says(with("uchar", "short"), &["'endian' is missing", "int16"]);
    says(with("raw", "bzip2"), &["'encoding: bzip2'", "raw, gzip and ascii"]);
    says(with("raw", "hex"), &["'encoding: hex'"]);
    says(with("5 4 3", "5 0 3"), &["'sizes: 5 0 3'", "above 0"]);
    says(with("5 4 3", "5 4 x"), &["'sizes: 5 4 x'"]);
    says(with("5 4 3", "5 4 4"), &["5x4x4 uint8 samples need 80 bytes, the file holds 60"]);
    says(with("5 4 3", "500000 400000 300000"), &["need 54569.7 TiB of memory", "the limit is 16.0 GiB"]);
    says(with("5 4 3", "4294967296 4294967296 4294967296"), &["1048576"]);
    says(with("sizes: 5 4 3\n", "sizes: 5 4 3\nsizes: 5 4 3\n"), &["line 5 gives the field 'sizes' a second time"]);
    says(with("sizes: 5 4 3\n", "sizes: 5 4 3\nnonsense\n"), &["line 5 is 'nonsense'", "field: value"]);
    says(with("sizes: 5 4 3\n", "sizes: 5 4 3\nspacings: 1 0 1\n"), &["grid spacing", "not zero"]);
    says(with("sizes: 5 4 3\n", "sizes: 5 4 3\nspace directions: (1,0,0) (0,1,0)\n"), &["3 entries"]);
    says(with("sizes: 5 4 3\n", "sizes: 5 4 3\nspace directions: (1,0,0) (0,1,0) (1,1,0)\n"), &["span no volume"]);
    says(with("sizes: 5 4 3\n", "sizes: 5 4 3\nspace directions: (1,0,0) (0,1) (1,1,0)\n"), &["vector (x,y,z)"]);
    says(with("sizes: 5 4 3\n", "sizes: 5 4 3\nspace origin: 1 2 3\n"), &["'space origin: 1 2 3'"]);
    says(with("sizes: 5 4 3\n", "sizes: 5 4 3\nendian: middle\n"), &["little or big"]);
    // Text of the file is clamped and escaped.
    let evil = format!("\u{1b}[2J{}", "x".repeat(5000));
    let error = with("uchar", &evil).unwrap_err().to_string();
    assert!(error.contains("\\u{1b}[2J") && !error.contains('\u{1b}') && error.len() < 600, "{error}");
    says(read(&dir.file("a.nrrd", &[b"NRRD0004\n", &vec![b'x'; 5 << 20]])), &["does not end within 4 MiB"]);
    says(read(&dir.file("a.nrrd.gz", &[&gzip(good.as_bytes())])), &["gzipped NRRD"]);
}

#[test]
fn damaged_data_say_how_much_was_there() {
    let dir = Folder::new();
    let data = bytes(SampleType::F32, false);
    let open = |encoding: &str, data: &[u8]| read(&dir.file("a.nrrd", &[header(SampleType::F32, encoding, false, "").as_bytes(), data]));
    says(open("raw", &data[..239]), &["need 240 bytes, the file holds 239"]);
    let packed = gzip(&data);
    says(open("gzip", &packed[..packed.len() / 2]), &["break off after", "of 240 bytes"]);
    says(open("gzip", &packed[..packed.len() - 4]), &["break off after the last sample"]);
    says(open("gzip", &gzip(&data[..100])), &["need 240 bytes, the data end after 100"]);
    let mut bad = packed.clone();
    let n = bad.len();
    bad[n - 6] ^= 1;
    says(open("gzip", &bad), &["damaged after the last sample", "undamaged"]);
    says(open("gzip", b"no gzip at all, but as long"), &["damaged after 0 of 240"]);
    says(open("ascii", b"1 2 3"), &["need"]);
    says(open("ascii", &b"1,".repeat(59)), &["need 119 bytes, the file holds 118"]);
    says(open("ascii", &b" 1 ".repeat(59)), &["holds 59 of 60 samples"]);
    says(open("ascii", &b"1 nine ".repeat(60)), &["sample 1 is 'nine'", "float32"]);
    // A claim that no such stream can hold is refused before memory is asked for.
    let head = header(SampleType::F32, "gzip", false, "").replace("5 4 3", "1000 1000 1000");
    says(read(&dir.file("a.nrrd", &[head.as_bytes(), &packed])), &["need 4000000000 bytes, more than", "of gzip data can hold"]);
}

#[test]
fn values_that_are_not_finite() {
    let dir = Folder::new();
    let mut v = values(SampleType::F64);
    v[27] = f64::NAN;
    v[40] = 1e39;
    let data: Vec<u8> = v.iter().flat_map(|x| x.to_le_bytes()).collect();
    let path = dir.file("a.nrrd", &[header(SampleType::F64, "raw", false, "").as_bytes(), &data]);
    says(read(&path), &["2 of the samples are not finite, the first at voxel (2, 1, 1): NaN", "nan_as"]);
    let options = ReadOptions { nan_as: Some(-1.5), ..Default::default() };
    let volume = read_volume(&path, &options).unwrap();
    assert_eq!((volume.value(27), volume.value(40), volume.value(1)), (-1.5, -1.5, v[1] as f32));
    says(read_volume(&path, &ReadOptions { nan_as: Some(f32::NAN), ..Default::default() }), &["nan_as"]);
    v[27] = 0.0;
    let data: Vec<u8> = v.iter().flat_map(|x| x.to_le_bytes()).collect();
    let path = dir.file("a.nrrd", &[header(SampleType::F64, "raw", false, "").as_bytes(), &data]);
    says(read(&path), &["1 of the samples", "beyond the range of float32"]);
}

#[test]
fn raw_files_account_for_every_byte() {
    let dir = Folder::new();
    for kind in SampleType::ALL {
        for big in [false, true] {
            let path = dir.file("a.raw", &[b"head", &bytes(kind, big)]);
            let raw = RawLayout { big_endian: big, spacing: [1.0, 2.0, 3.0], offset: 4, ..RawLayout::new(DIMS, kind) };
            let volume = read_volume(&path, &ReadOptions { raw: Some(raw), ..Default::default() }).unwrap();
            assert!(holds(&volume, kind), "{kind:?}");
            assert_eq!(volume.grid().spacing(), [1.0, 2.0, 3.0]);
        }
    }
    let path = dir.file("a.raw", &[&bytes(SampleType::U16, false)]);
    let open = |raw: RawLayout| read_volume(&path, &ReadOptions { raw: Some(raw), ..Default::default() });
    let layout = RawLayout::new(DIMS, SampleType::U16);
    says(open(RawLayout { kind: SampleType::U8, ..layout }), &["5x4x3 uint8 samples need 60 bytes, the file holds 120", "every byte"]);
    says(open(RawLayout { offset: 1, ..layout }), &["need 120 bytes, the file holds 119 from byte 1 on"]);
    says(open(RawLayout { dims: [1 << 20; 3], kind: SampleType::F64, ..layout }), &["need 9223372036854775808 bytes"]);
    says(open(RawLayout { dims: [0, 1, 1], ..layout }), &["0x1x1"]);
    says(open(RawLayout { spacing: [0.0, 1.0, 1.0], ..layout }), &["grid spacing"]);
    says(read(&path), &["no volume file known", "--volume.dims"]);
    says(read(&dir.file("a.vtu", &[b"x"])), &["a VTK file of another kind, which is not read"]);
    says(read(&dir.file("empty.raw", &[])), &["it is empty"]);
}

#[test]
fn limit_and_progress() {
    let dir = Folder::new();
    let path = dir.file("a.nrrd", &[header(SampleType::F64, "raw", false, "").as_bytes(), &bytes(SampleType::F64, false)]);
    says(read_volume(&path, &ReadOptions { max_bytes: 239, ..Default::default() }), &["need 240 B of memory", "the limit is 239 B"]);
    assert!(read_volume(&path, &ReadOptions { max_bytes: 240, ..Default::default() }).is_ok(), "float64 is held as float32");
    let seen = RefCell::new(Vec::new());
    let progress = |f| {
        seen.borrow_mut().push(f);
        if seen.borrow().len() < 6 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let big = dir.file("b.nrrd", &[b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 256 256 64\nencoding: raw\n\n", &vec![7; 256 * 256 * 64]]);
    let watched = || read_volume(&big, &ReadOptions { progress: Some(&progress), ..Default::default() });
    assert!(watched().is_ok());
    assert_eq!(*seen.borrow(), [0.25, 0.5, 0.75, 1.0]);
    // Asked to stop half-way through a second time.
    assert!(matches!(watched(), Err(halflight::Error::Cancelled)));
    assert_eq!(seen.borrow()[4..], [0.25, 0.5]);
}

#[test]
fn samples_that_are_not_finite_are_counted_and_the_rest_described() {
    use halflight::io::{describe, describe_file};
    let dir = Folder::new();
    let head = |n: usize| format!("NRRD0004\ntype: float\ndimension: 3\nsizes: {n} 1 1\nencoding: raw\nendian: little\n\n");
    let file = |name: &str, values: &[f32]| {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        dir.file(name, &[head(values.len()).as_bytes(), &bytes])
    };
    let finite = file("a.nrrd", &[3.0, -2.0, 6.0, 5.0]);
    let mixed = file("b.nrrd", &[f32::NAN, 3.0, -2.0, f32::NEG_INFINITY, 6.0, f32::INFINITY, 5.0]);
    let (a, b) = (describe_file(&finite, &ReadOptions::default()).unwrap(), describe_file(&mixed, &ReadOptions::default()).unwrap());
    assert_eq!(a, describe(&read(&finite).unwrap()));
    assert_eq!((a.not_finite, b.not_finite), (0, 3));
    assert_eq!((b.range, b.mean, &b.histogram), ([-2.0, 6.0], 3.0, &a.histogram));
    // A value to put in their place leaves nothing to count.
    let c = describe_file(&mixed, &ReadOptions { nan_as: Some(-9.0), ..Default::default() }).unwrap();
    assert_eq!((c.not_finite, c.range), (0, [-9.0, 6.0]));
    let none = describe_file(&file("c.nrrd", &[f32::NAN; 5]), &ReadOptions::default()).unwrap();
    assert_eq!((none.not_finite, none.range, none.histogram.iter().sum::<u64>()), (5, [0.0; 2], 0));
}

#[test]
fn components_are_chosen() {
    let dir = Folder::new();
    let (a, b) = (bytes(SampleType::I16, false), bytes(SampleType::U16, false));
    let both: Vec<u8> = a.chunks(2).zip(b.chunks(2)).flat_map(|(a, b)| [a, b].concat()).collect();
    let head = |more: &str| format!("NRRD0004\ntype: short\nencoding: raw\nendian: little\n{more}\n\n").into_bytes();
    let pick = |path: &Path, c: usize| read_volume(path, &ReadOptions { component: Some(c.to_string()), ..Default::default() });
    let is_a = |v: Volume| (0..60).all(|i| v.value(i) == values(SampleType::I16)[i] as f32) && v.grid().dims() == DIMS;
    let fast = dir.file("f.nrrd", &[&head("dimension: 4\nsizes: 2 5 4 3\nkinds: vector domain domain domain"), &both]);
    says(read(&fast), &["axis 0 has 2 samples and is of kind 'vector'", "choose one with volume.component, 0 to 1"]);
    assert!(is_a(pick(&fast, 0).unwrap()) && !is_a(pick(&fast, 1).unwrap()));
    says(pick(&fast, 2), &["'2' is none of"]);
    for more in ["dimension: 4\nsizes: 5 4 3 2\nkinds: domain domain domain list", "dimension: 4\nsizes: 5 4 3 2"] {
        let slow = dir.file("s.nrrd", &[&head(more), &b, &a]);
        assert!(read(&slow).is_err());
        assert!(is_a(pick(&slow, 1).unwrap()) && !is_a(pick(&slow, 0).unwrap()), "{more}");
        let packed = dir.file(
            "g.nrrd",
            &[
                &[b"NRRD0004\ntype: short\nendian: little\nencoding: gzip\n", more.as_bytes(), b"\n\n"].concat(),
                &gzip(&[b.clone(), a.clone()].concat()),
            ],
        );
        assert!(is_a(pick(&packed, 1).unwrap()) && !is_a(pick(&packed, 0).unwrap()), "{more}");
    }
    let one = dir.file("1.nrrd", &[&head("dimension: 3\nsizes: 5 4 3"), &a]);
    assert!(is_a(pick(&one, 0).unwrap()));
    says(pick(&one, 1), &["volume.component", "0 is its only component"]);
}
