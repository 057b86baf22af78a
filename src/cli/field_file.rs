//! Field files: what they say of their making, and whether they are a scene's.

use super::fail::Failure;
use clap::ArgMatches;
use halflight::engine::{Engine, Field};
use halflight::error::{Error, shown};
use halflight::io::{self, COMMAND_LINE, ReadOptions};
use halflight::measure::Report;
use halflight::scene::{Grid, Matter, Scene, Visibility, Volume};
use std::path::{Path, PathBuf};

pub use halflight::io::FieldKeys as Keys;

/// What a scene's field is of.
pub fn keys(scene: &Scene, volume: &Volume, matter: &Matter) -> Keys {
    Keys::of(volume, matter, &scene.clip.half_spaces(volume.grid()))
}

/// The file that `--field` names, looked at before any work: whether it is a field at all, and whether the command line asks for
/// another beside it.
pub fn given(m: &ArgMatches, scene: &Scene) -> Result<Option<PathBuf>, Failure> {
    let Some(path) = m.get_one::<PathBuf>("field") else { return Ok(None) };
    // One in the scene may be how the field was made.
    let asked = |word: &&&str| scene.origins.keys.get(&format!("visibility.{word}")).is_some_and(|o| o == COMMAND_LINE);
    if let Some(word) = ["tolerance", "quality"].iter().find(asked) {
        return Err(Failure::usage(format!(
            "--{word} chooses how a field is computed, and --field takes one from a file; drop one of the two"
        )));
    }
    if !io::is_nrrd_field(path)? {
        // Other programs' may lack what those of halflight begin with; the reader says what is wrong with all else.
        io::read_nrrd_field(path, &ReadOptions::default())?;
    }
    Ok(Some(path.clone()))
}

/// What a field's file says that it was computed with; `None` where it does not say so.
pub fn settings(path: &Path) -> Result<Option<Visibility>, Failure> {
    let file = io::read_nrrd_field(path, &ReadOptions::default())?;
    of(&file, "scene").map(|text| made_with(path, text)).transpose()
}

/// What a field's file says under a key.
fn of<'a>(file: &'a io::NrrdField, key: &str) -> Option<&'a str> {
    file.meta.iter().find(|(k, _)| k == key).map(|(_, v)| v.as_str())
}

/// The settings in the scene that a field's file holds.
fn made_with(path: &Path, text: &str) -> Result<Visibility, Failure> {
    Ok(io::parse_scene(text, &shown(path), Path::new(""), &[])?.visibility)
}

/// A field on the device, and what its file says was measured of it.
pub struct Loaded {
    pub field: Field,
    pub meta: Vec<(String, String)>,
}

/// Writes a field with what it is of, and a hash of its coefficients.
pub fn write(
    engine: &Engine,
    path: &Path,
    field: &Field,
    grid: &Grid,
    keys: &Keys,
    mut meta: Vec<(String, String)>,
) -> Result<(), Failure> {
    let data = engine.read_field(field)?;
    meta.extend(keys.meta(&data));
    io::write_nrrd_field(path, field.dims(), field.settings().coefficients(), &data, grid, &meta)?;
    Ok(())
}

/// Reads a field of `scene`'s volume and matter, or says what it is not of. Where the scene asks for a tolerance, the file's
/// own settings count. A file in a folder of fields must be the one that it was `named` for.
pub fn read(engine: &Engine, path: &Path, volume: &Volume, scene: &Scene, keys: &Keys, named: Option<&str>) -> Result<Loaded, Failure> {
    let bad = |what: &str, right: &str| Failure::from(Error::Format { path: path.to_owned(), what: what.into(), right: right.into() });
    let file = io::read_nrrd_field(path, &ReadOptions::default())?;
    let again = match named {
        None => "compute it anew with halflight precompute, or drop --field",
        Some(_) => "it is computed anew",
    };
    let text = of(&file, "scene").filter(|_| Keys::told(&file));
    let Some(text) = text else { return Err(bad("it does not say what it was computed from", again)) };
    if let Some(why) = keys.differ(&file) {
        return Err(bad(why, again));
    }
    let mut settings = made_with(path, text)?;
    if scene.wanted.is_none() && settled(&settings) != settled(&scene.visibility) {
        return Err(bad("it was computed with other [visibility] settings", again));
    }
    if named.is_some_and(|name| of(&file, "field_key") != Some(name)) {
        return Err(bad("it was computed on another device or by another version", again));
    }
    // What was dropped for a light is not there, whatever the text says.
    settings.bands = (file.coefficients as f64).sqrt() as u32;
    let field = engine.load_field(volume.grid(), &settings, &file.data)?;
    let meta = file.meta.iter().filter(|(k, _)| Report::KEYS.contains(&k.as_str())).cloned().collect();
    Ok(Loaded { field, meta })
}

/// Settings without those of other methods.
pub fn settled(v: &Visibility) -> Visibility {
    use halflight::scene::visibility::Method;
    let d = Visibility::default();
    let mut out = v.clone();
    if v.method != Method::Hierarchical {
        (out.filter, out.growth) = (d.filter, d.growth);
    }
    if v.method == Method::Hierarchical {
        out.step = d.step;
    }
    if v.method != Method::Sweep {
        (out.near, out.fit) = (d.near, d.fit);
    }
    out
}
