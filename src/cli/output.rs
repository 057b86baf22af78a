//! Output files, checked before the work starts.

use super::fail::Failure;
use halflight::Error;
use halflight::error::shown;
use halflight::io;
use halflight::scene::Picture;
use std::path::{Path, PathBuf};

/// Kinds of output file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Exr,
    Png,
    Nrrd,
}

/// A place that can be written to.
#[derive(Clone, Debug)]
pub struct Output {
    pub path: PathBuf,
    pub kind: Kind,
}

impl Output {
    /// Checks extension and folder of `path`.
    pub fn check(path: &Path, kinds: &[(&str, Kind)]) -> Result<Self, Failure> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let Some((_, kind)) = kinds.iter().find(|(name, _)| *name == extension) else {
            let names: Vec<String> = kinds.iter().map(|(name, _)| format!(".{name}")).collect();
            return Err(Failure::usage(format!("{}: its extension must be {}", shown(path), names.join(" or "))));
        };
        if path.is_dir() {
            return Err(Failure::usage(format!("{}: is a folder; name a file", shown(path))));
        }
        check_folder(path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")))?;
        Ok(Self { path: path.to_owned(), kind: *kind })
    }

    /// Refuses to overwrite what the command reads.
    pub fn is_none_of(&self, inputs: &[&Path]) -> Result<(), Failure> {
        let same = |input: &Path| matches!((input.canonicalize(), self.path.canonicalize()), (Ok(a), Ok(b)) if a == b);
        if inputs.iter().any(|i| same(i)) {
            return Err(Failure::usage(format!("{}: is an input of this command; name another output", shown(&self.path))));
        }
        Ok(())
    }

    /// The picture, as the extension says. `meta` goes into the file's header.
    pub fn write(&self, picture: &Picture, exposure: f64, meta: &[(String, String)]) -> Result<(), Failure> {
        match self.kind {
            Kind::Exr => io::write_exr(&self.path, picture, meta)?,
            _ => io::write_png(&self.path, picture, exposure as f32, meta)?,
        }
        Ok(())
    }
}

/// Extensions of pictures.
pub const PICTURES: &[(&str, Kind)] = &[("exr", Kind::Exr), ("png", Kind::Png)];

/// Whether files can be made in `folder`; says so now rather than after the work.
pub fn check_folder(folder: &Path) -> Result<(), Failure> {
    let fail = |source| Error::Io { path: folder.to_owned(), action: "write into this folder", source };
    std::fs::read_dir(folder).map_err(fail)?;
    match tempfile::Builder::new().prefix(".halflight-").tempfile_in(folder) {
        Ok(_) => Ok(()),
        Err(source) => Err(fail(source).into()),
    }
}
