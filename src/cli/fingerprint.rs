//! What a frame is of, as hashes (BLAKE3): of contents, never of names or dates, so that they hold on every node. Those of a
//! field's data are the library's: [`field_keys`]. What is found under a hash is taken without being asked for by name, so that the
//! hashes here are also of the build: another may compute other bits.

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

/// The version and the sources that this program was built from.
const BUILD: &str = concat!("halflight ", env!("CARGO_PKG_VERSION"), ", sources ", env!("HALFLIGHT_SOURCES"), "\n");

/// Hashes what a `build` computes.
fn computed(build: &str) -> blake3::Hasher {
    let mut hasher = blake3::Hasher::new();
    hasher.update(build.as_bytes());
    hasher
}

/// A field of what `of` says.
pub fn field(of: &str) -> String {
    hex(computed(BUILD).update(b"field of ").update(of.as_bytes()))
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
    let mut hasher = computed(BUILD);
    hasher.update(written.as_bytes()).update(b"\n");
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

#[cfg(test)]
#[path = "../../build/sources.rs"]
mod sources;

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn one_build_is_told_from_another_by_its_sources() {
        let parts = ["build.rs", "build", "glsl", "src", "Cargo.lock"];
        // Those that are there: any change of them builds this program anew.
        assert!(BUILD.contains(&sources::hash(Path::new(env!("CARGO_MANIFEST_DIR")), &parts).unwrap()), "{BUILD}");
        assert_ne!(hex(&computed(BUILD)), hex(&computed(&BUILD.replace(|c: char| c.is_ascii_digit(), "7"))));
        assert_ne!(field("a"), field("b"));
        let of = |files: &[(&str, &str)]| {
            let folder = tempfile::tempdir().unwrap();
            for (name, content) in files {
                let path = folder.path().join(name);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, content).unwrap();
            }
            sources::hash(folder.path(), &["glsl", "src"]).unwrap()
        };
        let plain = of(&[("glsl/a.comp", "x\ny\n"), ("src/b.rs", "z"), ("src/c/d.rs", "")]);
        // Written in another order, elsewhere, with other ends of lines, beside what an editor leaves.
        assert_eq!(
            plain,
            of(&[("src/c/d.rs", ""), ("src/b.rs", "z"), ("src/b.rs~", "q"), ("src/.b.swp", "q"), ("glsl/a.comp", "x\r\ny\r\n")])
        );
        for other in [
            [("glsl/a.comp", "x\ny\n"), ("src/b.rs", "Z"), ("src/c/d.rs", "")],
            [("glsl/a.comp", "x\ny\n"), ("src/b.rs", "z"), ("src/d.rs", "")],
            [("glsl/a.comp", "x\ny"), ("src/b.rs", "\nz"), ("src/c/d.rs", "")],
        ] {
            assert_ne!(plain, of(&other), "{other:?}");
        }
    }
}
