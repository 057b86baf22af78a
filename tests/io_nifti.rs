//! NIfTI-1 volumes written by a formula read back exactly; bad ones say what is wrong.

mod io_common;
use glam::DVec3;
use halflight::Result;
use halflight::io::{ReadOptions, SampleType, describe, describe_file, read_volume};
use halflight::scene::Volume;
use io_common::{DIMS, Folder, Nifti, bytes, encode, gzip, nifti_header, says, values};

const DIM: [i16; 8] = [3, 5, 4, 3, 1, 1, 1, 1];

fn code(kind: SampleType) -> (i16, i16) {
    use SampleType::*;
    let code = match kind {
        U8 => 2,
        I16 => 4,
        I32 => 8,
        F32 => 16,
        F64 => 64,
        I8 => 256,
        U16 => 512,
        U32 => 768,
        I64 => 1024,
        U64 => 1280,
    };
    (code, kind.bytes() as i16 * 8)
}

fn holds(volume: &Volume, kind: SampleType) -> bool {
    let expected = values(kind);
    volume.grid().dims() == DIMS && (0..expected.len()).all(|i| volume.value(i) == expected[i] as f32)
}

/// A float volume whose header is changed first.
fn open(dir: &Folder, change: impl FnOnce(&mut Nifti)) -> Result<Volume> {
    let mut h = Nifti { bytes: nifti_header(DIM, 16, 32, false), big_endian: false };
    change(&mut h);
    read_volume(&dir.file("a.nii", &[&h.bytes, &bytes(SampleType::F32, false)]), &ReadOptions::default())
}

#[test]
fn every_type_endian_and_packing_reads_back() {
    let dir = Folder::new();
    for kind in SampleType::ALL {
        for big in [false, true] {
            let (code, bits) = code(kind);
            let head = nifti_header(DIM, code, bits, big);
            let data = bytes(kind, big);
            let whole = [head.as_slice(), &data].concat();
            // The content tells, not the name.
            for (name, content) in [("a.nii", whole.clone()), ("a.nii.gz", gzip(&whole)), ("b.nii", gzip(&whole)), ("b.dat", whole.clone())]
            {
                let volume = read_volume(&dir.file(name, &[&content]), &ReadOptions::default()).unwrap();
                assert!(holds(&volume, kind), "{kind:?} big {big} {name}");
            }
            let mut pair = Nifti { bytes: head[..348].to_vec(), big_endian: big };
            pair.bytes[344..348].copy_from_slice(b"ni1\0");
            pair.f32(108, 0.0);
            let hdr = dir.file("p.hdr", &[&pair.bytes]);
            let img = dir.file("p.img", &[&data]);
            assert!(holds(&read_volume(&hdr, &ReadOptions::default()).unwrap(), kind));
            assert!(holds(&read_volume(&img, &ReadOptions::default()).unwrap(), kind));
            std::fs::remove_file(&img).unwrap();
            dir.file("p.img.gz", &[&gzip(&data)]);
            assert!(holds(&read_volume(&hdr, &ReadOptions::default()).unwrap(), kind));
            std::fs::remove_file(dir.path("p.img.gz")).unwrap();
            says(read_volume(&hdr, &ReadOptions::default()), &["its .img is not beside it"]);
            std::fs::remove_file(&hdr).unwrap();
            let hdr = dir.file("p.hdr.gz", &[&gzip(&pair.bytes)]);
            says(read_volume(&hdr, &ReadOptions::default()), &["p.hdr.gz", "its .img is not beside it", "name.img.gz"]);
            for (name, content) in [("p.img", data.clone()), ("p.img.gz", gzip(&data))] {
                let img = dir.file(name, &[&content]);
                for half in [&hdr, &img] {
                    assert!(holds(&read_volume(half, &ReadOptions::default()).unwrap(), kind), "{}", half.display());
                }
                std::fs::remove_file(img).unwrap();
            }
            says(read_volume(&dir.file("q.img.gz", &[&gzip(&data)]), &ReadOptions::default()), &["no volume file known here"]);
            std::fs::remove_file(hdr).unwrap();
        }
    }
    // The comparison can fail.
    let wrong = [nifti_header(DIM, 4, 16, false), bytes(SampleType::I16, true)].concat();
    assert!(!holds(&read_volume(&dir.file("a.nii", &[&wrong]), &ReadOptions::default()).unwrap(), SampleType::I16));
}

#[test]
fn slope_and_intercept() {
    let dir = Folder::new();
    let v = open(&dir, |h| {
        h.f32(112, 2.0);
        h.f32(116, -100.0);
    });
    let v = v.unwrap();
    assert_eq!(v.rescale(), (2.0, -100.0));
    assert_eq!(v.value(9), 2.0 * values(SampleType::F32)[9] as f32 - 100.0);
    for none in [0.0, f32::NAN, f32::INFINITY] {
        assert_eq!(open(&dir, |h| h.f32(112, none)).unwrap().rescale(), (1.0, 0.0));
    }
    says(open(&dir, |h| [112, 116].into_iter().for_each(|at| h.f32(at, if at == 112 { 1.0 } else { f32::NAN }))), &["scl_inter is NaN"]);
    says(open(&dir, |h| h.f32(112, 1e38)), &["beyond the range of float32"]);
    // A stand-in is meant in the data's unit.
    let mut h = Nifti { bytes: nifti_header(DIM, 16, 32, false), big_endian: false };
    h.f32(112, 2.0);
    h.f32(116, 1.0);
    let mut data = bytes(SampleType::F32, false);
    data[80..84].copy_from_slice(&f32::NAN.to_le_bytes());
    let path = dir.file("n.nii", &[&h.bytes, &data]);
    says(read_volume(&path, &ReadOptions::default()), &["1 of the samples", "voxel (0, 0, 1): NaN"]);
    let v = read_volume(&path, &ReadOptions { nan_as: Some(7.0), ..Default::default() }).unwrap();
    assert_eq!(v.value(20), 7.0);
    // Counted instead, with a slope below 0: the rest is described as if the sample were not there.
    h.f32(112, -2.0);
    let info = describe_file(&dir.file("m.nii", &[&h.bytes, &data]), &ReadOptions::default()).unwrap();
    data.copy_within(0..4, 80);
    let whole = describe(&read_volume(&dir.file("w.nii", &[&h.bytes, &data]), &ReadOptions::default()).unwrap());
    let first = -2.0 * f64::from(f32::from_le_bytes([data[0], data[1], data[2], data[3]])) + 1.0;
    let voxels = whole.histogram.iter().sum::<u64>() as f64;
    assert_eq!((info.not_finite, info.range), (1, whole.range));
    assert!((info.mean - (whole.mean * voxels - first) / (voxels - 1.0)).abs() < 1e-6, "{} {}", info.mean, whole.mean);
    assert_eq!(info.histogram.iter().sum::<u64>() as f64, voxels - 1.0);
}

fn centre(v: &Volume, p: [f64; 3]) -> DVec3 {
    v.grid().voxel_to_world().transform_point3(DVec3::from(p) + 0.5)
}

#[test]
fn place_in_the_world() {
    let dir = Folder::new();
    // sform: rows of the matrix that maps voxel indices to the centres of voxels.
    let rows = [[1.0f32, 0.5, 0.0, -10.0], [0.0, 2.0, 0.25, 20.0], [0.0, 0.0, -3.0, 30.0]];
    let with_sform = |h: &mut Nifti| {
        h.i16(254, 1);
        (0..12).for_each(|i| h.f32(280 + 4 * i, rows[i / 4][i % 4]));
    };
    let v = open(&dir, with_sform).unwrap();
    for p in [[0.0; 3], [4.0, 3.0, 2.0]] {
        let expected = rows.map(|r| f64::from(r[0]) * p[0] + f64::from(r[1]) * p[1] + f64::from(r[2]) * p[2] + f64::from(r[3]));
        assert!((centre(&v, p) - DVec3::from(expected)).length() < 1e-12, "voxel {p:?}");
    }
    assert_eq!(describe(&v).first_centre, [-10.0, 20.0, 30.0]);
    assert_ne!(describe(&v).corner, [-10.0, 20.0, 30.0], "corner and centre are not the same place");
    // qform: 90 degrees about z (b = c = 0, d = sin 45), spacing 2, 3, 4, qfac -1 flips the third axis.
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let with_qform = |h: &mut Nifti| {
        h.i16(252, 1);
        [-1.0, 2.0, 3.0, 4.0].iter().enumerate().for_each(|(i, &s)| h.f32(76 + 4 * i, s));
        [0.0, 0.0, half, 5.0, 6.0, 7.0].iter().enumerate().for_each(|(i, &s)| h.f32(256 + 4 * i, s));
    };
    let v = open(&dir, with_qform).unwrap();
    // x goes to +y, y to -x.
    assert!((centre(&v, [1.0, 1.0, 1.0]) - DVec3::new(5.0 - 3.0, 6.0 + 2.0, 7.0 - 4.0)).length() < 1e-6);
    // A turn by 180 degrees about y: c = 1, a little too long by rounding.
    let v = open(&dir, |h| {
        h.i16(252, 1);
        h.f32(260, 1.0 + 1e-6);
    });
    assert!((centre(&v.unwrap(), [1.0, 1.0, 1.0]) - DVec3::new(-1.0, 1.0, -1.0)).length() < 1e-6);
    // An unusable sform falls back on the qform, an unusable qform on the spacings.
    let v = open(&dir, |h| {
        with_qform(h);
        h.i16(254, 1);
    });
    assert!((centre(&v.unwrap(), [0.0; 3]) - DVec3::new(5.0, 6.0, 7.0)).length() < 1e-6);
    let v = open(&dir, |h| {
        with_qform(h);
        h.f32(256, f32::NAN);
    });
    assert_eq!(v.unwrap().grid().spacing(), [2.0, 3.0, 4.0]);
    let v = open(&dir, |h| h.f32(80, 0.0)).unwrap();
    assert_eq!((v.grid().spacing(), centre(&v, [0.0; 3])), ([1.0; 3], DVec3::ZERO));
}

#[test]
fn bad_headers_say_what_is_wrong() {
    let dir = Folder::new();
    let dim = |at: usize, n: i16| move |h: &mut Nifti| h.i16(40 + 2 * at, n);
    says(open(&dir, |h| (h.i16(40, 4), h.i16(48, 20)).0), &["a series of 20 volumes (dim[4])", "fslroi"]);
    says(open(&dir, |h| (h.i16(40, 5), h.i16(50, 3)).0), &["each voxel has 3 values (dim[5])"]);
    assert!(open(&dir, |h| (h.i16(40, 5), h.i16(48, 0)).0).is_ok(), "unused axes may be 0");
    says(open(&dir, dim(0, 9)), &["dim[0] is 9", "1 to 7"]);
    says(open(&dir, dim(2, 0)), &["dim[2] is 0"]);
    says(open(&dir, dim(2, -4)), &["dim[2] is -4"]);
    says(open(&dir, dim(1, 6)), &["6x4x3 float32 samples need 288 bytes, the file holds 240"]);
    for (code, what) in [(1, "single bits"), (32, "complex"), (1536, "128-bit"), (1792, "complex"), (77, "unknown")] {
        says(open(&dir, |h| h.i16(70, code)), &[what, &format!("datatype {code}"), "8 to 64 bits"]);
    }
    says(open(&dir, |h| h.i16(70, 128)), &["RGB colours", "datatype 128", "volume.component: R, G, B"]);
    says(open(&dir, |h| h.bytes[344..348].fill(0)), &["ANALYZE 7.5"]);
    says(open(&dir, |h| h.bytes[344..348].copy_from_slice(b"n+9\0")), &["its mark is 'n+9"]);
    says(open(&dir, |h| (h.i32(0, 540), h.bytes[4..8].copy_from_slice(b"n+2\0")).0), &["NIfTI-2"]);
    says(open(&dir, |h| h.i32(0, 347)), &["its header says that it has 347 bytes"]);
    for bad in [-1.0, 352.5, f32::NAN, f32::INFINITY, 1e30] {
        says(open(&dir, |h| h.f32(108, bad)), &["vox_offset is", "whole number"]);
    }
    says(open(&dir, |h| h.f32(108, 1e6)), &["999652 bytes are to be skipped where 244 are left"]);
    says(open(&dir, |h| h.f32(108, 356.0)), &["need 240 bytes, the file holds 236"]);
    assert!(open(&dir, |h| h.f32(108, 0.0)).is_ok(), "samples cannot begin before 352");
    says(
        read_volume(&dir.file("s.nii", &[&nifti_header(DIM, 2, 8, false)[..200]]), &ReadOptions::default()),
        &["after 200 bytes, inside its header"],
    );
}

#[test]
fn damaged_data_say_how_much_was_there() {
    let dir = Folder::new();
    let data: Vec<u8> = (0..60).flat_map(|i| encode(SampleType::F32, f64::from(i * i), false)).collect();
    let whole = [nifti_header(DIM, 16, 32, false), data].concat();
    let open = |content: &[u8]| read_volume(&dir.file("a.nii.gz", &[content]), &ReadOptions::default());
    let packed = gzip(&whole);
    assert!(open(&packed).is_ok());
    says(open(&packed[..packed.len() - 60]), &["break off after", "of 240 bytes"]);
    says(open(&packed[..40]), &["break off after", "of the header's 348 bytes"]);
    says(open(&whole[..100]), &["after 100 bytes, inside its header"]);
    says(open(&gzip(&whole[..400])), &["need 240 bytes, the data end after 48"]);
    says(open(&gzip(&whole[..350])), &["bytes are to be skipped where 2 are left"]);
    let mut bad = packed.clone();
    let n = bad.len();
    bad[n - 7] ^= 0x10;
    says(open(&bad), &["damaged after the last sample"]);
    let huge = [nifti_header([3, 32767, 32767, 32767, 1, 1, 1, 1], 2, 8, false), vec![0; 99]].concat();
    let options = ReadOptions { max_bytes: u64::MAX, ..Default::default() };
    says(read_volume(&dir.file("h.nii.gz", &[&gzip(&huge)]), &options), &["of gzip data can hold"]);
    says(open(&gzip(&huge)), &["the limit is 16.0 GiB"]);
}

#[test]
fn volumes_of_a_series_and_colours_are_chosen() {
    let dir = Folder::new();
    let (a, b) = (bytes(SampleType::I16, false), bytes(SampleType::U16, false));
    let head = nifti_header([4, 5, 4, 3, 2, 1, 1, 1], 4, 16, false);
    let pick = |path: &std::path::Path, c: &str| read_volume(path, &ReadOptions { component: Some(c.into()), ..Default::default() });
    let whole = [head.as_slice(), &b, &a].concat();
    for (name, content) in [("s.nii", whole.clone()), ("s.nii.gz", gzip(&whole))] {
        let path = dir.file(name, &[&content]);
        says(read_volume(&path, &ReadOptions::default()), &["a series of 2 volumes", "volume.component, 0 to 1"]);
        assert!(holds(&pick(&path, "1").unwrap(), SampleType::I16) && !holds(&pick(&path, "0").unwrap(), SampleType::I16));
    }
    let colours: Vec<u8> = bytes(SampleType::U8, false).iter().flat_map(|&v| [9, v, 7]).collect();
    let mut head = Nifti { bytes: nifti_header(DIM, 128, 24, false), big_endian: false };
    // Of these colours slope and intercept are to be ignored.
    for (slope, intercept) in [(0.0, 0.0), (2.0, 1.0), (0.5, f32::NAN)] {
        head.f32(112, slope);
        head.f32(116, intercept);
        let path = dir.file("c.nii", &[&head.bytes, &colours]);
        assert!(holds(&pick(&path, "G").unwrap(), SampleType::U8) && pick(&path, "0").unwrap().range() == [9.0, 9.0], "{slope}");
    }
}
