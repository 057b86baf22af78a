//! What the reader tests share: formula volumes as bytes, files in a folder that goes away.
#![allow(dead_code)]

pub mod logs;
pub mod tiff_bytes;
pub mod vdb;
pub mod zeros;

use flate2::{Compression, write::GzEncoder};
use halflight::io::SampleType;
use std::io::Write;
use std::path::PathBuf;

mod formats;
mod seeds;
#[allow(unused_imports)]
pub use formats::*;
#[allow(unused_imports)]
pub use seeds::*;

pub const DIMS: [usize; 3] = [5, 4, 3];

/// The formula: every voxel differs from its neighbours and its mirror images; in the range of every type that is
/// unsigned, with negative values and a fraction where the type has them.
pub fn formula(kind: SampleType, x: usize, y: usize, z: usize) -> f64 {
    use SampleType::*;
    let n = (x + 7 * y + 31 * z) as f64;
    match kind {
        U8 => n,
        I8 => n - 64.0,
        U16 => 501.0 * n,
        I16 => 300.0 * n - 16000.0,
        U32 => 1_000_003.0 * n,
        I32 => 1_000_003.0 * (n - 50.0),
        U64 => 1_000_000_007.0 * n,
        I64 => 1_000_000_007.0 * (n - 50.0),
        F32 | F64 => n / 8.0 - 3.0,
    }
}

/// Bytes of one value.
pub fn encode(kind: SampleType, value: f64, big_endian: bool) -> Vec<u8> {
    use SampleType::*;
    let mut bytes = match kind {
        U8 => (value as u8).to_le_bytes().to_vec(),
        I8 => (value as i8).to_le_bytes().to_vec(),
        U16 => (value as u16).to_le_bytes().to_vec(),
        I16 => (value as i16).to_le_bytes().to_vec(),
        U32 => (value as u32).to_le_bytes().to_vec(),
        I32 => (value as i32).to_le_bytes().to_vec(),
        U64 => (value as u64).to_le_bytes().to_vec(),
        I64 => (value as i64).to_le_bytes().to_vec(),
        F32 => (value as f32).to_le_bytes().to_vec(),
        F64 => value.to_le_bytes().to_vec(),
    };
    if big_endian {
        bytes.reverse();
    }
    bytes
}

/// The values of the formula, x fastest.
pub fn values(kind: SampleType) -> Vec<f64> {
    let [nx, ny, nz] = DIMS;
    let at = |i: usize| formula(kind, i % nx, i / nx % ny, i / nx / ny);
    (0..nx * ny * nz).map(at).collect()
}

pub fn bytes(kind: SampleType, big_endian: bool) -> Vec<u8> {
    values(kind).into_iter().flat_map(|v| encode(kind, v, big_endian)).collect()
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = GzEncoder::new(Vec::new(), Compression::fast());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

/// A folder with files.
pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    pub fn file(&self, name: &str, parts: &[&[u8]]) -> PathBuf {
        let path = self.path(name);
        // Overwriting in place waits for the disk on some systems.
        let _ = std::fs::remove_file(&path);
        std::fs::write(&path, parts.concat()).unwrap();
        path
    }
}

/// Checks that a failure says each of `parts`.
#[track_caller]
pub fn says<T>(result: halflight::Result<T>, parts: &[&str]) {
    let text = match result {
        Ok(_) => panic!("no error; expected one with {parts:?}"),
        Err(e) => e.to_string(),
    };
    for part in parts {
        assert!(text.contains(part), "'{text}' does not say '{part}'");
    }
}

/// A NIfTI-1 header of 352 bytes: dims, type code, spacing 1, no scaling, no sform or qform.
pub fn nifti_header(dim: [i16; 8], code: i16, bits: i16, big_endian: bool) -> Vec<u8> {
    let mut h = Nifti { bytes: vec![0; 352], big_endian };
    h.i32(0, 348);
    for (i, n) in dim.into_iter().enumerate() {
        h.i16(40 + 2 * i, n);
    }
    h.i16(70, code);
    h.i16(72, bits);
    for i in 0..8 {
        h.f32(76 + 4 * i, 1.0);
    }
    h.f32(108, 352.0);
    h.bytes[344..348].copy_from_slice(b"n+1\0");
    h.bytes
}

/// Pokes numbers into a header.
pub struct Nifti {
    pub bytes: Vec<u8>,
    pub big_endian: bool,
}

impl Nifti {
    fn put<const N: usize>(&mut self, at: usize, mut le: [u8; N]) {
        if self.big_endian {
            le.reverse();
        }
        self.bytes[at..at + N].copy_from_slice(&le);
    }
    pub fn i16(&mut self, at: usize, v: i16) {
        self.put(at, v.to_le_bytes());
    }
    pub fn i32(&mut self, at: usize, v: i32) {
        self.put(at, v.to_le_bytes());
    }
    pub fn f32(&mut self, at: usize, v: f32) {
        self.put(at, v.to_le_bytes());
    }
}
