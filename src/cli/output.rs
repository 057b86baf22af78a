//! Output files, checked before the work starts.

use super::fail::Failure;
use halflight::Error;
use halflight::error::shown;
use halflight::io;
use halflight::scene::Picture;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Kinds of output file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Exr,
    Png,
    Nrrd,
    Transfer,
}

/// A place that can be written to.
pub struct Output {
    pub path: PathBuf,
    pub kind: Kind,
    /// Made in vain, it goes again.
    folder: Folder,
}

impl Output {
    /// Checks `path`, and makes its folder where that is missing.
    pub fn check(path: &Path, kinds: &[(&str, Kind)]) -> Result<Self, Failure> {
        let kind = Self::kind(path, kinds)?;
        Ok(Self { path: path.to_owned(), kind, folder: Folder::around(&Self::file(path)?)? })
    }

    /// What the extension of `path` says.
    pub fn kind(path: &Path, kinds: &[(&str, Kind)]) -> Result<Kind, Failure> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        kinds.iter().find(|(name, _)| *name == extension).map(|(_, kind)| *kind).ok_or_else(|| {
            let names: Vec<String> = kinds.iter().map(|(name, _)| format!(".{name}")).collect();
            Failure::usage(format!("{}: its extension must be {}", shown(path), names.join(" or ")))
        })
    }

    /// The file that writing to `path` means; refuses what is there and is none.
    pub fn file(path: &Path) -> Result<PathBuf, Failure> {
        // "o.png/" is the name of a folder, whether or not there is one; `Path` itself looks past the slash.
        let name = path.file_name().unwrap_or_default().as_encoded_bytes();
        if path.is_dir() || !path.as_os_str().as_encoded_bytes().ends_with(name) {
            return Err(Failure::usage(format!("{}: is a folder; name a file", shown(path))));
        }
        let target = io::write_target(path)?;
        if target.metadata().is_ok_and(|m| !m.is_file()) {
            return Err(Failure::usage(format!("{}: is a pipe or a device; name a regular file", shown(path))));
        }
        Ok(target)
    }

    /// Refuses to overwrite what the command reads.
    pub fn is_none_of(&self, inputs: &[&Path]) -> Result<(), Failure> {
        Inputs::of(inputs).spare(&self.path)
    }

    /// Where to write now: another run that made the folder, and ended in vain, may have taken it away meanwhile.
    pub fn place(&self) -> Result<&Path, Failure> {
        if !self.folder.path.is_dir() {
            self.folder.again()?;
        }
        Ok(&self.path)
    }

    /// The picture, as the extension says. `meta` goes into the file's header.
    pub fn write(&self, picture: &Picture, exposure: f64, meta: &[(String, String)]) -> Result<(), Failure> {
        match self.kind {
            Kind::Exr => io::write_exr(self.place()?, picture, meta)?,
            _ => io::write_png(self.place()?, picture, exposure as f32, meta)?,
        }
        Ok(())
    }
}

/// Files that a command reads, known through links of either kind.
pub struct Inputs(HashSet<Identity>);

#[cfg(unix)]
type Identity = (u64, u64);
#[cfg(not(unix))]
type Identity = PathBuf;

impl Inputs {
    pub fn of<P: AsRef<Path>>(paths: impl IntoIterator<Item = P>) -> Self {
        Self(paths.into_iter().filter_map(|p| identity(p.as_ref())).collect())
    }

    /// Refuses to overwrite one of them.
    pub fn spare(&self, output: &Path) -> Result<(), Failure> {
        match identity(output).is_some_and(|id| self.0.contains(&id)) {
            true => Err(Failure::usage(format!("{}: is an input of this command; name another output", shown(output)))),
            false => Ok(()),
        }
    }
}

fn identity(path: &Path) -> Option<Identity> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        path.metadata().ok().map(|m| (m.dev(), m.ino()))
    }
    #[cfg(not(unix))]
    {
        path.canonicalize().ok()
    }
}

/// A folder that is made where it is missing; made in vain, it goes again.
pub struct Folder {
    path: PathBuf,
    made: Vec<PathBuf>,
}

impl Folder {
    /// Makes the folder that holds `file`.
    pub fn around(file: &Path) -> Result<Self, Failure> {
        Self::make(file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")))
    }

    /// Makes `path` and what is missing above it, and checks that files can be made there.
    pub fn make(path: &Path) -> Result<Self, Failure> {
        let missing = path.ancestors().filter(|p| !p.as_os_str().is_empty() && !p.exists()).map(Path::to_owned).collect();
        let made = Self { path: path.to_owned(), made: missing };
        made.again()?;
        check_folder(path)?;
        Ok(made)
    }

    fn again(&self) -> Result<(), Failure> {
        let fail = |source| Error::Io { path: self.path.clone(), action: "make this folder", source };
        Ok(std::fs::create_dir_all(&self.path).map_err(fail)?)
    }

    /// What is in it.
    pub fn entries(&self) -> Result<std::fs::ReadDir, Failure> {
        Ok(std::fs::read_dir(&self.path).map_err(|source| Error::Io { path: self.path.clone(), action: "read", source })?)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // Only empty folders can be removed this way: where a file was written, all stay.
        for folder in &self.made {
            let _ = std::fs::remove_dir(folder);
        }
    }
}

/// Extensions of pictures.
pub const PICTURES: &[(&str, Kind)] = &[("exr", Kind::Exr), ("png", Kind::Png)];

/// Whether files can be made in `folder`; says so now rather than after the work.
fn check_folder(folder: &Path) -> Result<(), Failure> {
    let fail = |source| Error::Io { path: folder.to_owned(), action: "write into this folder", source };
    std::fs::read_dir(folder).map_err(fail)?;
    match tempfile::Builder::new().prefix(".halflight-").tempfile_in(folder) {
        Ok(_) => Ok(()),
        Err(source) => Err(fail(source).into()),
    }
}
