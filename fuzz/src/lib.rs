//! What the targets share: bytes as a file in memory's file system, read under a small limit.

use halflight::io::{ReadOptions, describe_file, read_volume};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Largest volume in memory, bytes: small, so that one that slips past it shows.
const CAP: u64 = 16 << 20;

/// A folder of this process, with what headers may name beside them.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let make = || {
        let shm = Path::new("/dev/shm");
        let dir = if shm.is_dir() { tempfile::tempdir_in(shm) } else { tempfile::tempdir() }.expect("a folder for the files");
        std::fs::write(dir.path().join("own.raw"), [7; 120]).expect("a data file");
        dir
    };
    FOLDER.get_or_init(make).path()
}

/// Bytes as a file of that name.
pub fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder().join(name);
    if let Some(parent) = path.parent() {
        std::fs::create_dir_all(parent).expect("a folder");
    }
    std::fs::write(&path, bytes).expect("a file");
    path
}

/// How a volume is read.
pub fn options() -> ReadOptions<'static> {
    ReadOptions { max_bytes: CAP, ..ReadOptions::default() }
}

/// Reads a volume in several ways; what opens must keep its promises.
pub fn volume(path: &Path) {
    for component in [None, Some("1")] {
        let options = ReadOptions { component: component.map(String::from), nan_as: component.map(|_| 0.0), ..options() };
        if let Ok(volume) = read_volume(path, &options) {
            assert_eq!(volume.samples().len() as u64, volume.grid().voxels());
            assert!(volume.range().iter().all(|v| v.is_finite()));
        }
    }
    if let Ok(info) = describe_file(path, &options()) {
        let voxels = info.dims.iter().map(|&n| n as u64).product::<u64>();
        assert_eq!(info.histogram.iter().sum::<u64>() + info.not_finite, voxels);
    }
}
