//! What a frame is of, as hashes (BLAKE3): of contents, never of names or dates, so that they hold on every node. Those of a
//! field are the library's: [`field_keys`].

use super::fail::Failure;
use super::load;
use halflight::error::Error;
use halflight::io;
use halflight::io::field_keys::{self, hex};
use halflight::scene::scene::{LightSource, TransferSource};
use halflight::scene::{Matter, Scene, Volume};
use std::path::{Path, PathBuf};

/// Where a medium absorbs, and how much.
pub fn matter(matter: &Matter, scene: &Scene, volume: &Volume) -> String {
    field_keys::of_matter(matter, &scene.clip.half_spaces(volume.grid()), volume.range(), volume.grid())
}

pub use halflight::io::field_keys::of_volume as volume;

/// Words.
pub fn text(text: &str) -> String {
    hex(blake3::Hasher::new().update(text.as_bytes()))
}

/// A frame: its scene with the contents of its files in place of their names, and how its file is written.
pub fn frame(scene: &Scene, volume: &str, files: &mut Files, written: &str) -> Result<String, Failure> {
    let mut hashed = scene.clone();
    hashed.volume.file = volume.into();
    let mut hash = |key: &str, path: &mut PathBuf| {
        *path = files.hash(path).map_err(|e| load::of_file(scene, key, e))?.into();
        Ok::<_, Failure>(())
    };
    if let LightSource::Probe(path) = &mut hashed.light.source {
        hash("light.probe", path)?;
    }
    if let TransferSource::File { path, .. } = &mut hashed.transfer {
        hash("transfer.file", path)?;
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update(concat!("halflight ", env!("CARGO_PKG_VERSION"), "\n").as_bytes()).update(written.as_bytes()).update(b"\n");
    hasher.update(io::scene_text(&hashed).as_bytes());
    Ok(hex(&hasher))
}

/// Hashes of small files, each read once.
#[derive(Default)]
pub struct Files(Vec<(PathBuf, String)>);

impl Files {
    fn hash(&mut self, path: &Path) -> Result<String, Error> {
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
