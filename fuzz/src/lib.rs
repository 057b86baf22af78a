//! What the targets share: bytes as a file in memory's file system, read under a small limit.

use halflight::io::transfer::{Format, convert, read_presets};
use halflight::io::{ReadOptions, TransferOptions, describe_file, read_transfer, read_volume};
use std::cell::RefCell;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

#[path = "../../tests/io_common/zeros.rs"]
mod zeros;
pub use zeros::unpack;

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

/// Bytes as a file of that name. It stays open between inputs: half the time would go by making it.
pub fn file(name: &str, bytes: &[u8]) -> PathBuf {
    thread_local! { static FILES: RefCell<Vec<(PathBuf, File)>> = const { RefCell::new(Vec::new()) } }
    let path = folder().join(name);
    FILES.with_borrow_mut(|files| {
        let at = files.iter().position(|f| f.0 == path).unwrap_or_else(|| {
            std::fs::create_dir_all(path.parent().expect("it is in the folder")).expect("a folder");
            files.push((path.clone(), File::create(&path).expect("a file")));
            files.len() - 1
        });
        files[at].1.set_len(bytes.len() as u64).expect("a length");
        files[at].1.write_all_at(bytes, 0).expect("bytes");
    });
    path
}

/// How a volume is read.
pub fn options() -> ReadOptions<'static> {
    ReadOptions { max_bytes: CAP, ..ReadOptions::default() }
}

/// Reads a volume in a way that `length`, the input's, chooses; what opens must keep its promises.
pub fn volume(path: &Path, length: usize) {
    let component = (length % 2 == 1).then(|| "1".to_owned());
    let options = ReadOptions { nan_as: component.as_ref().map(|_| 0.0), component, ..options() };
    let Ok(volume) = read_volume(path, &options) else { return };
    assert_eq!(volume.samples().len() as u64, volume.grid().voxels());
    assert!(volume.range().iter().all(|v| v.is_finite()));
    let info = describe_file(path, &options).expect("what opens can be described");
    let voxels = info.dims.iter().map(|&n| n as u64).product::<u64>();
    assert_eq!(info.histogram.iter().sum::<u64>() + info.not_finite, voxels);
}

/// Reads the presets of a file and writes them in a format that `length`, the input's, chooses.
pub fn transfer(path: &Path, length: usize) {
    let Ok((_, presets)) = read_presets(path) else { return };
    for named in presets.into_iter().take(3) {
        let Ok(preset) = named.preset else { continue };
        let _ = read_transfer(path, &TransferOptions { name: Some(named.name), ..TransferOptions::new([-1.0, 9.0]) });
        let format = Format::ALL[length % Format::ALL.len()].1;
        let _ = convert(std::slice::from_ref(&preset), format, Some([-1.0, 9.0]).filter(|_| length % 4 == 0));
    }
}
