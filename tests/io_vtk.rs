//! VTK images, XML and legacy, written by a formula read back exactly; bad ones say what is wrong.

mod io_common;
use glam::DVec3;
use halflight::Result;
use halflight::io::{ReadOptions, SampleType, describe, read_volume};
use halflight::scene::Volume;
use io_common::logs::warnings;
use io_common::{Array, DIMS, Folder, Vti, bytes, says, values, vti, vti_packed};
use std::path::Path;

const WHOLE: &str = "0 4 0 3 0 2";
const IMAGE: &str = "Origin=\"10 20 30\" Spacing=\"0.5 2 3\"";

fn holds(volume: &Volume, kind: SampleType) -> bool {
    let expected = values(kind);
    volume.grid().dims() == DIMS && (0..expected.len()).all(|i| volume.value(i) == expected[i] as f32)
}

fn read(path: &Path) -> Result<Volume> {
    read_volume(path, &ReadOptions::default())
}

fn pick(path: &Path, c: &str) -> Result<Volume> {
    read_volume(path, &ReadOptions { component: Some(c.into()), ..Default::default() })
}

#[test]
fn every_type_order_and_packing_of_vti_reads_back() {
    let dir = Folder::new();
    for kind in SampleType::ALL {
        let array: Array = ("a b", kind, 1, values(kind));
        for form in [Vti::Ascii, Vti::Inline, Vti::AppendedRaw, Vti::AppendedBase64] {
            for (big, wide, block) in [(false, false, 0), (true, true, 0), (false, true, 32), (true, false, 64), (false, false, 20)] {
                let content = vti(form, IMAGE, WHOLE, std::slice::from_ref(&array), &[], big, wide, block);
                let volume =
                    read(&dir.file("a.vti", &[&content])).unwrap_or_else(|e| panic!("{kind:?} {form:?} {big} {wide} {block}: {e}"));
                assert!(holds(&volume, kind), "{kind:?} {form:?} big {big} wide {wide} block {block}");
            }
        }
    }
    // Whatever compresses.
    for compressor in ["ZLib", "LZ4", "LZMA"] {
        for (form, kind, block) in
            [(Vti::Inline, SampleType::U16, 50), (Vti::AppendedRaw, SampleType::F32, 64), (Vti::AppendedRaw, SampleType::U8, 999)]
        {
            let array: Array = ("a", kind, 1, values(kind));
            let content = vti_packed(form, IMAGE, WHOLE, std::slice::from_ref(&array), &[], false, false, block, compressor);
            let volume = read(&dir.file("a.vti", &[&content])).unwrap_or_else(|e| panic!("{compressor} {kind:?}: {e}"));
            assert!(holds(&volume, kind), "{compressor} {kind:?} {block}");
        }
    }
    // The comparison can fail.
    let array: Array = ("a", SampleType::U16, 1, values(SampleType::U16));
    let text = vti(Vti::AppendedRaw, IMAGE, WHOLE, &[array], &[], true, false, 0);
    let lies = String::from_utf8_lossy(&text[..200]).replace("BigEndian", "LittleEndian");
    assert!(lies.contains("LittleEndian"));
    let mut wrong = text.clone();
    let last = wrong.len() - 60;
    wrong[last] ^= 1;
    assert!(!read(&dir.file("a.vti", &[&wrong])).is_ok_and(|v| holds(&v, SampleType::U16)));
}

#[test]
fn place_pieces_cells_and_arrays() {
    let dir = Folder::new();
    let a: Array = ("a", SampleType::F32, 1, values(SampleType::F32));
    let doubled: Vec<f64> = values(SampleType::I16).iter().flat_map(|v| [0.0, *v, 1.0]).collect();
    let v: Array = ("v", SampleType::I16, 3, doubled);
    let turned = "Origin=\"10 20 30\" Spacing=\"0.5 2 3\" Direction=\"0 -1 0 1 0 0 0 0 1\"";
    let path = dir.file("a.vti", &[&vti(Vti::AppendedRaw, turned, "2 6 0 3 -1 1", &[a.clone(), v.clone()], &[], false, true, 0)]);
    // The array that is called scalars is the default; others by name.
    let volume = read(&path).unwrap();
    assert!(holds(&volume, SampleType::F32));
    assert!(holds(&pick(&path, "v:1").unwrap(), SampleType::I16));
    assert!(holds(&pick(&path, "2").unwrap(), SampleType::I16));
    says(pick(&path, "w"), &["'w' is none of", "it holds 2 arrays", "a, v:0, v:1, v:2"]);
    // Point (2, 0, -1) of the extent is the first voxel's centre; the columns of Direction are the axes.
    let info = describe(&volume);
    assert_eq!(info.directions, [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!((info.spacing, info.first_centre), ([0.5, 2.0, 3.0], [10.0, 21.0, 27.0]));
    let only: Array = ("v", SampleType::I16, 3, v.3.clone());
    let path = dir.file("b.vti", &[&vti(Vti::Inline, IMAGE, WHOLE, &[only], &[], false, false, 32)]);
    says(read(&path), &["its array 'v' has 3 components", "v:0, v:1, v:2"]);
    // Cells: one fewer than points, their corner at the origin.
    let c: Array = ("c", SampleType::U8, 1, values(SampleType::U8));
    let path = dir.file("c.vti", &[&vti(Vti::Ascii, IMAGE, "0 5 0 4 0 3", &[], &[c], false, false, 0)]);
    let volume = read(&path).unwrap();
    assert!(holds(&volume, SampleType::U8));
    assert_eq!(describe(&volume).corner, [10.0, 20.0, 30.0]);
    assert!(holds(&pick(&path, "cells/c").unwrap(), SampleType::U8));
}

#[test]
fn bad_vti_says_what_would_be_right() {
    let dir = Folder::new();
    let a: Array = ("a", SampleType::U16, 1, values(SampleType::U16));
    let good = vti(Vti::AppendedRaw, IMAGE, WHOLE, std::slice::from_ref(&a), &[], false, false, 0);
    let text = String::from_utf8_lossy(&good).into_owned();
    let change = |from: &str, to: &str| {
        assert!(text.contains(from));
        let at = text.find(from).unwrap();
        let content = [&good[..at], to.as_bytes(), &good[at + from.len()..]].concat();
        read(&dir.file("a.vti", &[&content]))
    };
    says(change("type=\"ImageData\"", "type=\"PolyData\""), &["a.vti: it is a VTK file of type 'PolyData'"]);
    says(change("header_type=\"UInt32\"", "compressor=\"vtkZstdDataCompressor\""), &["vtkZstdDataCompressor", "ZLib, LZ4 and LZMA"]);
    says(change("<!-- made by a test -->", "<!DOCTYPE x [<!ENTITY a \"b\">]>"), &["<!DOCTYPE", "not read"]);
    says(change(WHOLE, "0 4 0 3 0 x"), &["WholeExtent=\"0 4 0 3 0 x\"", "six whole numbers"]);
    says(
        change("<Piece Extent=\"0 4 0 3 0 2\"", "<Piece Extent=\"0 9 0 3 0 2\""),
        &["10x4x3 uint16 samples need 240 bytes", "says that there are 120"],
    );
    let pieces = [text.find("<Piece").unwrap()..text.find("<PointData").unwrap(), 0..text.find("<PointData").unwrap()];
    let [piece, before] = pieces.map(|range| &text[range]);
    let part = piece.replace("0 4 0 3 0 2", "0 4 0 3 0 1");
    let two = [before, "</Piece>\n", &part, &text[before.len()..]].concat();
    // Nothing is said of a part where nothing is read.
    let (result, said) = warnings(|| read(&dir.file("a.vti", &[two.replace(piece, &part).as_bytes()])));
    says(result, &["it has several pieces", "where NumberOfPieces is 1"]);
    assert!(said.is_empty(), "{said:?}");
    says(change("offset=\"0\"", "offset=\"9999\""), &["begins at byte", "cut short"]);
    says(read(&dir.file("a.vti", &[&good[..text.find("<AppendedData").unwrap()]])), &["no appended data", "cut short"]);
    says(change("Spacing=\"0.5 2 3\"", "Spacing=\"0.5 2\""), &["Spacing=\"0.5 2\"", "3 numbers"]);
    says(change("type=\"UInt16\"", "type=\"String\""), &["no array of numbers"]);
    let huge = vti(Vti::AppendedRaw, IMAGE, "0 999999 0 999999 0 999999", &[a], &[], false, false, 16);
    says(read(&dir.file("a.vti", &[&huge])), &["need"]);
    says(read(&dir.file("a.vti", &[&good[..300]])), &["cut short"]);
    says(read(&dir.file("a.vti", &[&good[..good.len() - 80]])), &["a.vti"]);
}

#[test]
fn damaged_blocks_say_what_is_wrong() {
    let dir = Folder::new();
    let a: Array = ("a", SampleType::U16, 1, values(SampleType::U16));
    for (compressor, name) in [("LZ4", "LZ4"), ("LZMA", "xz")] {
        let good = vti_packed(Vti::AppendedRaw, IMAGE, WHOLE, std::slice::from_ref(&a), &[], false, false, 64, compressor);
        let at = String::from_utf8_lossy(&good).find(" _").unwrap() + 2;
        // Blocks: how many, of which size, the last of which size, then their compressed sizes.
        let poked = |place: usize, number: u32| {
            let mut bytes = good.clone();
            bytes[at + place..at + place + 4].copy_from_slice(&number.to_le_bytes());
            read(&dir.file("a.vti", &[&bytes]))
        };
        let size = u32::from_le_bytes(good[at + 12..at + 16].try_into().unwrap());
        assert!(poked(12, size).is_ok());
        says(poked(12, size - 1), &["a.vti", name, "damaged"]);
        says(poked(12, 0), &["a.vti", name]);
        says(poked(16, u32::MAX), &["a.vti", name]);
        says(read(&dir.file("a.vti", &[&good[..at + 25]])), &["a.vti", name]);
    }
    // A block of a gigabyte is not decoded whole; one of zlib's is no trouble.
    let header = |compressor: &str| {
        let file = vti_packed(Vti::AppendedRaw, IMAGE, "0 1023 0 1023 0 1023", std::slice::from_ref(&a), &[], false, false, 64, compressor);
        let at = String::from_utf8_lossy(&file).find(" _").unwrap() + 2;
        let sizes: Vec<u8> = [1u32, 1 << 31, 0, 8].iter().flat_map(|n| n.to_le_bytes()).collect();
        read(&dir.file("a.vti", &[&file[..at], &sizes, &[0; 400]]))
    };
    says(header("LZ4"), &["its blocks have 2.0 GiB, and are decoded whole", "at most 64.0 MiB"]);
    says(header("ZLib"), &["zlib data can hold"]);
}

fn legacy(mode: &str, more: &str) -> Vec<u8> {
    format!(
        "# vtk DataFile Version 3.0\ntitle\n{mode}\nDATASET STRUCTURED_POINTS\nDIMENSIONS 5 4 3\nORIGIN 10 20 30\nSPACING 0.5 2 3\n{more}"
    )
    .into_bytes()
}

#[test]
fn legacy_files_read_back() {
    let dir = Folder::new();
    let names = ["char", "unsigned_char", "short", "unsigned_short", "int", "unsigned_int", "long", "unsigned_long", "float", "double"];
    for (kind, name) in SampleType::ALL.into_iter().zip(names) {
        let head = format!("POINT_DATA 60\nSCALARS a%20b {name}\nLOOKUP_TABLE default\n");
        let binary = dir.file("a.vtk", &[&legacy("BINARY", &head), &bytes(kind, true), b"\nMETADATA\nINFORMATION 0\n\n"]);
        let volume = read(&binary).unwrap();
        assert!(holds(&volume, kind), "{name}");
        assert_eq!((describe(&volume).first_centre, describe(&volume).spacing), ([10.0, 20.0, 30.0], [0.5, 2.0, 3.0]));
        assert!(holds(&pick(&binary, "a b").unwrap(), kind));
        let text: Vec<u8> = values(kind).iter().flat_map(|v| format!("{v}\n").into_bytes()).collect();
        let ascii = dir.file("a.vtk", &[&legacy("ASCII", &head.replace("\nLOOKUP", " 1\nLOOKUP")), &text]);
        assert!(holds(&read(&ascii).unwrap(), kind), "{name} in text");
        // Long text of other arrays may follow.
        let more = [b"\nMETADATA\nINFORMATION 0\n\nVECTORS v double\n".to_vec(), b"1.25 ".repeat(180)].concat();
        let two = dir.file("a.vtk", &[&legacy("ASCII", &head), &text, &more]);
        assert!(holds(&pick(&two, "a b").unwrap(), kind), "{name} in text, before another");
        assert_eq!(pick(&two, "v:2").unwrap().range(), [1.25, 1.25]);
    }
}

/// What VTK's writers make of images of unsigned char: shares of 255 in text, bytes as they are in binary.
#[test]
fn colour_scalars_are_bytes() {
    let dir = Folder::new();
    let text: Vec<u8> = values(SampleType::U8).iter().flat_map(|v| format!("{} ", v / 255.0 * 1.0000001).into_bytes()).collect();
    let head = |form: &str, n: usize| legacy(form, &format!("POINT_DATA 60\nCOLOR_SCALARS s {n}\n"));
    let ascii = read(&dir.file("a.vtk", &[&head("ASCII", 1), &text])).unwrap();
    assert!(holds(&ascii, SampleType::U8) && ascii.samples().type_name() == "uint8");
    let binary = read(&dir.file("b.vtk", &[&head("BINARY", 1), &bytes(SampleType::U8, true)])).unwrap();
    assert!(holds(&binary, SampleType::U8));
    let three: Vec<u8> = values(SampleType::U8).iter().flat_map(|v| format!("0.1 {} 1 ", v / 255.0).into_bytes()).collect();
    let path = dir.file("c.vtk", &[&head("ASCII", 3), &three, b"\nVECTORS v float\n", &b"0.5 0.25 1 ".repeat(60)]);
    assert!(holds(&pick(&path, "s:1").unwrap(), SampleType::U8));
    // Other arrays are not.
    assert_eq!(pick(&path, "v:0").unwrap().range(), [0.5, 0.5]);
}

#[test]
fn legacy_arrays_are_chosen() {
    let dir = Folder::new();
    let (a, b) = (bytes(SampleType::I16, true), bytes(SampleType::U8, true));
    let vectors: Vec<u8> = values(SampleType::F32).iter().flat_map(|v| [0.0, *v as f32, 7.0].map(f32::to_be_bytes).concat()).collect();
    let path = dir.file(
        "a.vtk",
        &[
            &legacy("BINARY", "FIELD FieldData 1\nTIME 1 1 double\n"),
            &1.5f64.to_be_bytes(),
            b"\nPOINT_DATA 60\nSCALARS s short 1\nLOOKUP_TABLE mine\n",
            &a,
            b"\nLOOKUP_TABLE mine 2\n",
            &[255; 8],
            b"\nVECTORS v float\n",
            &vectors,
            b"\nFIELD more 1\nf 1 60 unsigned_char\n",
            &b,
            b"\n",
        ],
    );
    says(read(&path), &["it holds 3 arrays", "s, v:0, v:1, v:2, f"]);
    assert!(holds(&pick(&path, "s").unwrap(), SampleType::I16));
    assert!(holds(&pick(&path, "v:1").unwrap(), SampleType::F32));
    assert!(holds(&pick(&path, "F").unwrap(), SampleType::U8));
    // As vtkStructuredPointsWriter has it where it writes extents: points 2 to 6, -1 to 2, 4 to 6.
    let text = String::from_utf8(legacy("BINARY", "POINT_DATA 60\nSCALARS s unsigned_long_long\nLOOKUP_TABLE default\n")).unwrap();
    let extent = text.replace("DIMENSIONS 5 4 3", "EXTENT 2 6 -1 2 4 6");
    let volume = read(&dir.file("e.vtk", &[extent.as_bytes(), &bytes(SampleType::U64, true)])).unwrap();
    assert!(holds(&volume, SampleType::U64));
    assert_eq!((describe(&volume).spacing, describe(&volume).first_centre), ([0.5, 2.0, 3.0], [11.0, 18.0, 42.0]));
    let signed = text.replace("unsigned_long_long", "long_long");
    assert!(holds(&read(&dir.file("l.vtk", &[signed.as_bytes(), &bytes(SampleType::I64, true)])).unwrap(), SampleType::I64));
    let cells = String::from_utf8(legacy("BINARY", "CELL_DATA 60\nSCALARS s short\nLOOKUP_TABLE default\n")).unwrap();
    let path = dir.file("c.vtk", &[cells.replace("5 4 3", "6 5 4").as_bytes(), &a]);
    let volume = read(&path).unwrap();
    assert!(holds(&volume, SampleType::I16));
    assert!((volume.grid().voxel_to_world().translation - DVec3::new(10.0, 20.0, 30.0)).length() < 1e-12);
}

#[test]
fn bad_legacy_files_say_what_would_be_right() {
    let dir = Folder::new();
    let open = |content: &[u8]| read(&dir.file("a.vtk", &[content]));
    let text = String::from_utf8(legacy("BINARY", "POINT_DATA 60\nSCALARS s short\nLOOKUP_TABLE default\n")).unwrap();
    says(open(text.replace("STRUCTURED_POINTS", "POLYDATA").as_bytes()), &["its dataset is 'POLYDATA'", "STRUCTURED_POINTS is read"]);
    says(open(text.replace("BINARY", "EBCDIC").as_bytes()), &["line 3 is 'EBCDIC'"]);
    says(open(text.replace("POINT_DATA 60", "POINT_DATA 61").as_bytes()), &["POINT_DATA has 61 tuples for 5x4x3 points", "60 are needed"]);
    says(open(text.replace("DIMENSIONS 5", "DIMENSIONS 0").as_bytes()), &["DIMENSIONS have 0"]);
    for extent in ["3 2 0 3 0 2", "-9223372036854775808 9223372036854775807 0 3 0 2", "0 1048576 0 3 0 2"] {
        says(open(text.replace("DIMENSIONS 5 4 3", &format!("EXTENT {extent}")).as_bytes()), &["its EXTENT runs from", "1 to 1048576"]);
    }
    says(open(text.as_bytes()), &["a.vtk", "need 120 bytes, the file holds 0"]);
    says(open(text.replace("LOOKUP_TABLE", "LOKUP_TABLE").as_bytes()), &["'LOKUP_TABLE' stands behind SCALARS s"]);
    says(open(text.replace("SCALARS", "SCALAR").as_bytes()), &["'SCALAR' stands at byte"]);
    says(open(text.replace("short", "bit").as_bytes()), &["no array of numbers"]);
    says(open(b"# vtk DataFile Version 3.0\n"), &["ends where ASCII or BINARY is due"]);
}
