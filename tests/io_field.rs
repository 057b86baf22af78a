//! A field written as NRRD reads back bit for bit, at the place of its volume.

mod io_common;
use glam::{DAffine3, DMat3, DVec3};
use halflight::io::{NrrdField, ReadOptions, read_nrrd_field, write_nrrd_field};
use halflight::scene::Grid;
use io_common::{Folder, says};

fn oblique() -> Grid {
    let matrix3 = DMat3::from_cols(DVec3::new(0.8, 0.6, 0.0), DVec3::new(-0.9, 1.2, 0.1), DVec3::new(0.1, 0.0, 3.0));
    Grid::new([9, 8, 5], DAffine3 { matrix3, translation: DVec3::new(-3.0, 4.5, 1e-7) }).unwrap()
}

fn field(n: usize) -> Vec<f32> {
    (0..n).map(|i| ((i * 2_654_435_761) % 1000) as f32 / 7.0 - 60.0).collect()
}

#[test]
fn it_reads_back() {
    let dir = Folder::new();
    let path = dir.path("field.nrrd");
    let grid = oblique();
    let dims = grid.field_dims(4);
    assert_eq!(dims, [3, 2, 2]);
    let data = field(16 * 12);
    let meta = [("ratio", "1:4"), ("note", "two\nlines \\ and := a colon: here"), ("empty", "")].map(|(k, v)| (k.to_owned(), v.to_owned()));
    write_nrrd_field(&path, dims, 16, &data, &grid, &meta).unwrap();
    let NrrdField { coefficients, grid: cells, data: read, meta: read_meta } = read_nrrd_field(&path, &ReadOptions::default()).unwrap();
    assert_eq!((coefficients, cells.dims()), (16, dims));
    assert_eq!(read, data);
    assert_eq!(read_meta, meta);
    // The cells cover the box: its eight corners, and cell centres at (j + ½)·n/c.
    for corner in 0..8 {
        let unit = DVec3::new(f64::from(corner & 1), f64::from(corner >> 1 & 1), f64::from(corner >> 2));
        let of = |g: &Grid| g.voxel_to_world().transform_point3(unit * DVec3::from(g.dims().map(|n| n as f64)));
        assert!((of(&cells) - of(&grid)).length() < 1e-12, "corner {corner}");
    }
    let centre = cells.voxel_to_world().transform_point3(DVec3::new(1.5, 0.5, 0.5));
    let expected = grid.voxel_to_world().transform_point3(DVec3::new(1.5 * 9.0 / 3.0, 0.5 * 8.0 / 2.0, 0.5 * 5.0 / 2.0));
    assert!((centre - expected).length() < 1e-12);
    // The comparison can fail: one changed bit is seen.
    let mut bytes = std::fs::read(&path).unwrap();
    let n = bytes.len();
    bytes[n - 3] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    assert_ne!(read_nrrd_field(&path, &ReadOptions::default()).unwrap().data, data);
    std::fs::write(&path, &bytes[..n - 1]).unwrap();
    says(read_nrrd_field(&path, &ReadOptions::default()), &["16x3x2x2 float32 samples need 768 bytes, the file holds 767"]);
}

#[test]
fn what_cannot_be_written_is_refused() {
    let dir = Folder::new();
    let path = dir.path("field.nrrd");
    let grid = oblique();
    let write = |dims, n, data: &[f32], key: &str, value: &str| {
        write_nrrd_field(&path, dims, n, data, &grid, &[(key.to_owned(), value.to_owned())])
    };
    says(write([3, 2, 2], 16, &field(191), "k", "v"), &["191 numbers for 16 coefficients of 3x2x2 cells"]);
    says(write([0, 2, 2], 16, &[], "k", "v"), &["must not be 0"]);
    let mut data = field(12);
    data[5] = f32::NAN;
    says(write([3, 2, 2], 1, &data, "k", "v"), &["number 5 is NaN"]);
    for key in ["", "#k", "a:b", " k", "a\nb\r"] {
        says(write([3, 2, 2], 1, &field(12), key, "v"), &["the key"]);
    }
    says(write([3, 2, 2], 1, &field(12), "k", "a\rb"), &["the value", "control"]);
    assert!(!path.exists(), "nothing was left behind");
    assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 0);
    says(write_nrrd_field(&dir.path("no/such/f.nrrd"), [3, 2, 2], 1, &field(12), &grid, &[]), &["cannot create"]);
}

#[test]
fn other_files_are_no_fields() {
    let dir = Folder::new();
    let open = |fields: &str| {
        let head = format!("NRRD0004\n{fields}\nencoding: raw\nendian: little\n\n");
        read_nrrd_field(&dir.file("a.nrrd", &[head.as_bytes(), &[0; 320]]), &ReadOptions::default())
    };
    says(open("type: uchar\ndimension: 3\nsizes: 2 2 2"), &["3 axes of type uint8", "4 (coefficients, x, y, z)"]);
    says(open("type: float\ndimension: 4\nsizes: 5 2 2 4"), &["first axis has 5", "1, 4, 9 or 16"]);
    assert!(open("type: float\ndimension: 4\nsizes: 4 2 2 5").is_ok());
}
