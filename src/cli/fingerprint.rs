//! What a field or a frame is of, as hashes (BLAKE3): of contents, never of names or dates, so that they hold on every node.

use super::fail::Failure;
use halflight::error::Error;
use halflight::io;
use halflight::scene::scene::{LightSource, TransferSource};
use halflight::scene::transfer::Table;
use halflight::scene::{Matter, Samples, Scene, Volume};
use std::path::{Path, PathBuf};

/// What a volume holds: dims, place, type, rescaling, samples.
pub fn volume(volume: &Volume) -> String {
    let mut hasher = blake3::Hasher::new();
    let map = volume.grid().voxel_to_world();
    for n in volume.grid().dims() {
        hasher.update(&(n as u64).to_le_bytes());
    }
    for x in map.to_cols_array() {
        hasher.update(&x.to_le_bytes());
    }
    let (slope, intercept) = volume.rescale();
    hasher.update(&slope.to_le_bytes()).update(&intercept.to_le_bytes()).update(volume.samples().type_name().as_bytes());
    match volume.samples() {
        Samples::U8(s) => drop(hasher.update(s)),
        Samples::U16(s) => numbers(&mut hasher, s, |v| v.to_le_bytes()),
        Samples::I16(s) => numbers(&mut hasher, s, |v| v.to_le_bytes()),
        Samples::F32(s) => numbers(&mut hasher, s, |v| v.to_le_bytes()),
    }
    hex(&hasher)
}

fn numbers<T: Copy, const N: usize>(hasher: &mut blake3::Hasher, values: &[T], bytes: impl Fn(T) -> [u8; N]) {
    let mut buffer = Vec::with_capacity(N << 16);
    for part in values.chunks(1 << 16) {
        buffer.clear();
        buffer.extend(part.iter().flat_map(|v| bytes(*v)));
        hasher.update(&buffer);
    }
}

/// Where a medium absorbs, and how much: what visibility depends on beside the volume. Colours have no part in it.
pub fn matter(matter: &Matter, scene: &Scene, volume: &Volume) -> String {
    let mut hasher = blake3::Hasher::new();
    match matter.surface {
        Some(surface) => drop(hasher.update(b"surface").update(&surface.iso.to_le_bytes())),
        None => {
            let Table { lo, hi, sigma, .. } = matter.transfer.table(volume.range(), volume.grid());
            hasher.update(b"medium").update(&lo.to_le_bytes()).update(&hi.to_le_bytes());
            numbers(&mut hasher, &sigma, f32::to_le_bytes);
        }
    }
    for plane in scene.clip.half_spaces(volume.grid()) {
        numbers(&mut hasher, &plane, f32::to_le_bytes);
    }
    hex(&hasher)
}

/// The numbers of a field.
pub fn coefficients(data: &[f32]) -> String {
    let mut hasher = blake3::Hasher::new();
    numbers(&mut hasher, data, f32::to_le_bytes);
    hex(&hasher)
}

/// Words.
pub fn text(text: &str) -> String {
    hex(blake3::Hasher::new().update(text.as_bytes()))
}

/// A frame: its scene with the contents of its files in place of their names, and how its file is written.
pub fn frame(scene: &Scene, volume: &str, files: &mut Files, written: &str) -> Result<String, Failure> {
    let mut scene = scene.clone();
    scene.volume.file = volume.into();
    if let LightSource::Probe(path) = &mut scene.light.source {
        *path = files.hash(path)?.into();
    }
    if let TransferSource::File { path, .. } = &mut scene.transfer {
        *path = files.hash(path)?.into();
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update(concat!("halflight ", env!("CARGO_PKG_VERSION"), "\n").as_bytes()).update(written.as_bytes()).update(b"\n");
    hasher.update(io::scene_text(&scene).as_bytes());
    Ok(hex(&hasher))
}

/// Hashes of small files, each read once.
#[derive(Default)]
pub struct Files(Vec<(PathBuf, String)>);

impl Files {
    fn hash(&mut self, path: &Path) -> Result<String, Failure> {
        if let Some((_, hash)) = self.0.iter().find(|(known, _)| known == path) {
            return Ok(hash.clone());
        }
        let fail = |source| Error::Io { path: path.to_owned(), action: "read", source };
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(std::fs::File::open(path).map_err(fail)?).map_err(fail)?;
        let hash = hex(&hasher);
        self.0.push((path.to_owned(), hash.clone()));
        Ok(hash)
    }
}

/// 32 digits: 128 bits tell any two of them apart.
fn hex(hasher: &blake3::Hasher) -> String {
    hasher.finalize().to_hex()[..32].to_owned()
}
