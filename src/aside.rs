//! Files appear whole or not at all: written aside, then renamed over their place.

use crate::error::{Error, Result};
use std::fs::{File, Permissions};
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Most symbolic links that are followed, as Linux has it.
const LINKS: usize = 40;

/// The file that writing to `path` means: behind symbolic links, even where none is there yet.
///
/// # Errors
/// [`Error::Io`] for a link that cannot be read, and for links that lead in a circle.
pub fn write_target(path: &Path) -> Result<PathBuf> {
    let fail = |source| Error::Io { path: path.to_owned(), action: "follow the link", source };
    let mut target = path.to_owned();
    for _ in 0..LINKS {
        if !target.symlink_metadata().is_ok_and(|m| m.is_symlink()) {
            return Ok(target);
        }
        let next = target.read_link().map_err(fail)?;
        target = folder_of(&target).join(next);
    }
    Err(fail(std::io::Error::other("it leads to itself")))
}

/// The folder that holds `path`.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Writes a file beside `path` and renames it over `path` when `write` has succeeded: there is never a partial output. A
/// symbolic link stays, its target is written. A new file has the permissions that the umask leaves, an old one keeps its
/// own.
///
/// # Errors
/// [`Error::Io`] naming `path`, or what `write` returned.
pub fn write_aside(path: &Path, write: impl FnOnce(&mut BufWriter<Bounded>) -> Result<()>) -> Result<()> {
    let fail = |action| move |source| Error::Io { path: path.to_owned(), action, source };
    let target = write_target(path)?;
    let aside = Aside::new(folder_of(&target)).map_err(fail("create"))?;
    let mut out = BufWriter::with_capacity(1 << 20, Bounded { file: aside.file(), at: 0, most: size_limit() });
    write(&mut out)?;
    out.flush().map_err(fail("write"))?;
    drop(out);
    if let Some(old) = old_permissions(&target) {
        aside.file().set_permissions(old).map_err(fail("write"))?;
    }
    aside.file().sync_data().map_err(fail("write"))?;
    aside.rename(&target).map_err(fail("write"))
}

/// A file on its way.
enum Aside {
    /// Without a name, where the file system knows such files: a process that is killed leaves nothing.
    #[cfg(target_os = "linux")]
    Unnamed(File),
    Named(tempfile::NamedTempFile),
}

impl Aside {
    fn new(folder: &Path) -> std::io::Result<Self> {
        #[cfg(target_os = "linux")]
        if Path::new(OPEN).exists() {
            use rustix::fs::{Mode, OFlags, open};
            if let Ok(file) = open(folder, OFlags::RDWR | OFlags::TMPFILE | OFlags::CLOEXEC, Mode::from(0o666)) {
                return Ok(Self::Unnamed(file.into()));
            }
        }
        named(folder).map(Self::Named)
    }

    fn file(&self) -> &File {
        match self {
            #[cfg(target_os = "linux")]
            Self::Unnamed(file) => file,
            Self::Named(file) => file.as_file(),
        }
    }

    fn rename(self, target: &Path) -> std::io::Result<()> {
        match self {
            #[cfg(target_os = "linux")]
            Self::Unnamed(mut file) => {
                use rustix::fs::{AtFlags, CWD, linkat};
                use std::os::fd::AsRawFd;
                let from = format!("{OPEN}/{}", file.as_raw_fd());
                link_or_copy(&mut file, target, |to| Ok(linkat(CWD, &from, CWD, to, AtFlags::SYMLINK_FOLLOW)?))
            }
            Self::Named(file) => file.persist(target).map(drop).map_err(|e| e.error),
        }
    }
}

/// Gives a file without a name its place. A link cannot take another file's place, but a rename can. Where the file system knows
/// files without a name and no links, the file is copied.
#[cfg(target_os = "linux")]
fn link_or_copy(file: &mut File, target: &Path, link: impl FnMut(&Path) -> std::io::Result<()>) -> std::io::Result<()> {
    let folder = folder_of(target);
    if let Ok(linked) = tempfile::Builder::new().prefix(PREFIX).make_in(folder, link) {
        return linked.persist(target).map(drop).map_err(|e| e.error);
    }
    let mut copy = named(folder)?;
    file.rewind()?;
    std::io::copy(file, &mut copy)?;
    copy.as_file().set_permissions(file.metadata()?.permissions())?;
    copy.as_file().sync_data()?;
    copy.persist(target).map(drop).map_err(|e| e.error)
}

/// A file beside others, which goes again unless it is renamed.
fn named(folder: &Path) -> std::io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

/// Where Linux names open files.
#[cfg(target_os = "linux")]
const OPEN: &str = "/proc/self/fd";

/// What the names of files aside begin with.
const PREFIX: &str = ".halflight-";

#[cfg(unix)]
fn old_permissions(target: &Path) -> Option<Permissions> {
    use std::os::unix::fs::PermissionsExt;
    target.metadata().ok().map(|m| Permissions::from_mode(m.permissions().mode() & 0o777))
}

#[cfg(not(unix))]
fn old_permissions(_: &Path) -> Option<Permissions> {
    None
}

/// A file that fails at the process's limit of file sizes, where the system would end a process that does not catch SIGXFSZ.
pub struct Bounded<'a> {
    file: &'a File,
    at: u64,
    most: u64,
}

impl Write for Bounded<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let room = self.most.saturating_sub(self.at);
        if room == 0 && !bytes.is_empty() {
            return Err(std::io::ErrorKind::FileTooLarge.into());
        }
        let n = self.file.write(&bytes[..bytes.len().min(usize::try_from(room).unwrap_or(usize::MAX))])?;
        self.at += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Bounded<'_> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}

/// The limit of file sizes (`ulimit -f`), bytes; Linux tells it in a file.
fn size_limit() -> u64 {
    let limits = std::fs::read_to_string("/proc/self/limits").unwrap_or_default();
    let soft = limits.lines().find_map(|l| l.strip_prefix("Max file size")).and_then(|l| l.split_whitespace().next());
    soft.and_then(|n| n.parse().ok()).unwrap_or(u64::MAX)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn put(path: &Path, bytes: &[u8]) -> Result<()> {
        write_aside(path, |out| out.write_all(bytes).map_err(|source| Error::Io { path: path.to_owned(), action: "write", source }))
    }

    #[test]
    #[cfg(unix)]
    fn links_stay_and_old_permissions_too() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("d")).unwrap();
        // A new file is what the system makes of 0666.
        std::fs::File::create(at("plain")).unwrap();
        put(&at("d/real"), b"1").unwrap();
        let mode = |name: &str| at(name).metadata().unwrap().permissions().mode();
        assert_eq!(mode("d/real"), mode("plain"));
        std::fs::set_permissions(at("d/real"), Permissions::from_mode(0o640)).unwrap();
        symlink("d/real", at("link")).unwrap();
        symlink("link", at("link2")).unwrap();
        put(&at("link2"), b"22").unwrap();
        assert!(at("link").symlink_metadata().unwrap().is_symlink() && at("link2").symlink_metadata().unwrap().is_symlink());
        assert_eq!((std::fs::read(at("d/real")).unwrap(), mode("d/real") & 0o777), (b"22".to_vec(), 0o640));
        // A link to a file that is not there yet makes it.
        symlink("d/new", at("dangling")).unwrap();
        put(&at("dangling"), b"333").unwrap();
        assert_eq!(std::fs::read(at("d/new")).unwrap(), b"333");
        symlink("round", at("round")).unwrap();
        assert!(put(&at("round"), b"").unwrap_err().to_string().contains("leads to itself"));
        assert_eq!(std::fs::read_dir(at("d")).unwrap().count(), 2, "nothing is left aside");
    }

    /// Both ways of writing aside, whatever this machine's file system offers.
    #[test]
    fn nothing_stands_half_written_whichever_way() {
        let folder = tempfile::tempdir().unwrap();
        let names = || std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect::<Vec<_>>();
        let target = folder.path().join("out");
        std::fs::write(&target, b"old").unwrap();
        let best = Aside::new(folder.path()).unwrap();
        #[cfg(target_os = "linux")]
        {
            use rustix::fs::{Mode, OFlags, open};
            let known = open(folder.path(), OFlags::RDWR | OFlags::TMPFILE, Mode::RUSR | Mode::WUSR).is_ok();
            assert_eq!(matches!(best, Aside::Unnamed(_)), known, "files without a name are used where there are such");
        }
        for aside in [Aside::Named(named(folder.path()).unwrap()), best] {
            let unnamed = !matches!(aside, Aside::Named(_));
            assert_eq!(names().len(), if unnamed { 1 } else { 2 });
            aside.file().write_all(b"new").unwrap();
            assert_eq!(std::fs::read(&target).unwrap(), b"old");
            aside.rename(&target).unwrap();
            assert_eq!((std::fs::read(&target).unwrap(), names().len()), (b"new".to_vec(), 1));
            std::fs::write(&target, b"old").unwrap();
        }
        // Where no link is to be had.
        #[cfg(target_os = "linux")]
        {
            let mut file = tempfile::tempfile_in(folder.path()).unwrap();
            file.write_all(b"new").unwrap();
            file.set_permissions(std::os::unix::fs::PermissionsExt::from_mode(0o640)).unwrap();
            link_or_copy(&mut file, &target, |_| Err(std::io::ErrorKind::PermissionDenied.into())).unwrap();
            use std::os::unix::fs::PermissionsExt;
            assert_eq!(
                (std::fs::read(&target).unwrap(), target.metadata().unwrap().permissions().mode() & 0o777),
                (b"new".to_vec(), 0o640)
            );
            std::fs::write(&target, b"old").unwrap();
        }
        // What fails on its way leaves the old.
        let failed = write_aside(&target, |out| {
            out.write_all(b"half").unwrap();
            Err(Error::Cancelled)
        });
        assert!(failed.is_err() && names().len() == 1 && std::fs::read(&target).unwrap() == b"old");
    }

    #[test]
    fn a_size_limit_is_an_error() {
        let file = tempfile::tempfile().unwrap();
        let mut out = Bounded { file: &file, at: 0, most: 5 };
        assert_eq!(out.write(b"1234567").unwrap(), 5);
        assert_eq!(out.write(b"8").unwrap_err().kind(), std::io::ErrorKind::FileTooLarge);
        out.seek(SeekFrom::Start(3)).unwrap();
        assert_eq!(out.write(b"1234567").unwrap(), 2);
    }
}
