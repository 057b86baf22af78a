//! Fields in a folder, each under the hash of what it is of: what one process computed, no other computes again.

use super::session::{FIELDS, Going, Paid, VISIBILITY};
use crate::cli::fail::Failure;
use crate::cli::field_file::{self, Keys, settled};
use crate::cli::fingerprint;
use crate::cli::output::Folder;
use fs4::{FileExt, TryLockError};
use halflight::engine::{Engine, Field};
use halflight::error::{Error, bytes};
use halflight::io;
use halflight::scene::{Scene, Visibility, Volume};
use serde_json::{Value, json};
use std::collections::HashSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How often another process is looked after.
const LOOK: Duration = Duration::from_millis(100);

/// How often a lock that has lost its name is taken anew: not for ever, should a file system number its files anew each time.
const TRIES: u32 = 16;

/// The folder, and what came of it.
pub struct Store {
    pub folder: PathBuf,
    pub computed: usize,
    /// Names of what was computed here.
    own: HashSet<String>,
    pub found: usize,
    /// Files that were there and were not what their name says.
    pub bad: usize,
    /// Whether something could not be written here: that is no frame's own fault.
    pub broken: bool,
    /// Bytes of the largest file.
    pub largest: u64,
    /// Seconds spent on waiting for others.
    waited: f64,
    /// Made in vain, it goes again.
    _made: Folder,
}

/// What a field is wanted of.
pub struct Of<'a> {
    pub engine: &'a Engine,
    pub volume: &'a Volume,
    /// With the settings of visibility that count.
    pub scene: Scene,
    pub keys: Keys,
}

/// A field's name. Of the device and the build, too: others round otherwise, and a frame has the same bits whoever computed its field.
pub fn name(engine: &Engine, keys: &Keys, settings: &Visibility) -> String {
    let (device, settings) = (engine.device(), settled(settings));
    let of = (&keys.volume, &keys.matter, settings, &device.name, &device.driver);
    fingerprint::field(&format!("{of:?}"))
}

impl Store {
    /// The folder, made where it is missing.
    pub fn open(folder: &Path) -> Result<Self, Failure> {
        let made = Folder::make(folder)?;
        Ok(Self {
            folder: folder.to_owned(),
            computed: 0,
            own: HashSet::new(),
            found: 0,
            bad: 0,
            broken: false,
            largest: 0,
            waited: 0.0,
            _made: made,
        })
    }

    /// The field from its file, or else computed and kept there. Of several processes that want one field, one computes it.
    pub fn field(
        &mut self,
        of: &Of,
        going: Going,
        paid: &mut Paid,
        compute: impl FnOnce() -> Result<Field, Failure>,
    ) -> Result<Field, Failure> {
        let name = name(of.engine, &of.keys, &of.scene.visibility);
        let path = self.folder.join(format!("{name}.nrrd"));
        let bad = self.bad;
        if let Some(field) = paid.time(FIELDS, || self.read(&path, &name, of))? {
            return Ok(field);
        }
        let missing = self.bad == bad;
        let lock = self.folder.join(format!("{name}.lock"));
        let start = Instant::now();
        let (held, waited) = paid.time(FIELDS, || take(&lock, going)).inspect_err(|_| self.broken = true)?;
        if waited {
            self.waited += start.elapsed().as_secs_f64();
        }
        if waited || missing {
            // Another may have put it there meanwhile.
            if let Some(field) = paid.time(FIELDS, || self.read(&path, &name, of))? {
                return Ok(field);
            }
        }
        let field = paid.time(VISIBILITY, compute)?;
        let device = of.engine.device();
        let meta = vec![
            ("scene".into(), io::scene_text(&of.scene)),
            ("device".into(), format!("{}; {}", device.name, device.driver)),
            ("field_key".into(), name.clone()),
        ];
        let write = || field_file::write(of.engine, &path, &field, of.volume.grid(), &of.keys, meta);
        paid.time(FIELDS, write).inspect_err(|_| self.broken = true)?;
        self.largest = self.largest.max(path.metadata().map_or(0, |m| m.len()));
        self.computed += 1;
        self.own.insert(name);
        drop(held);
        Ok(field)
    }

    /// Whether another process has put a field of this name here.
    pub fn others(&self, name: &str) -> bool {
        !self.own.contains(name) && self.folder.join(format!("{name}.nrrd")).is_file()
    }

    /// The field of a file; `None` where there is none, or one of something else.
    fn read(&mut self, path: &Path, name: &str, of: &Of) -> Result<Option<Field>, Failure> {
        if path.symlink_metadata().is_err_and(|e| e.kind() == std::io::ErrorKind::NotFound) {
            return Ok(None);
        }
        match field_file::read(of.engine, path, of.volume, &of.scene, &of.keys, Some(name)) {
            Ok(loaded) => {
                self.largest = self.largest.max(path.metadata().map_or(0, |m| m.len()));
                self.found += 1;
                Ok(Some(loaded.field))
            }
            Err(failure) if failure.code == 3 => {
                log::warn!("{}", failure.sentence);
                self.bad += 1;
                Ok(None)
            }
            Err(failure) => Err(failure),
        }
    }

    /// "2 computed, 6 found, of at most 1.5 MiB each, in fields".
    pub fn text(&self) -> String {
        let mut text = format!("{} computed, {} found", self.computed, self.found);
        if self.bad > 0 {
            text += &format!(", {} damaged or of something else and replaced", self.bad);
        }
        if self.waited > 0.0 {
            text += &format!(", {:.1} s waited for others", self.waited);
        }
        text + &format!("; at most {} each, in {}", bytes(self.largest), self.folder.display())
    }

    pub fn json(&self) -> Value {
        json!({ "computed": self.computed, "found": self.found, "bad": self.bad, "bytes": self.largest, "waited": self.waited })
    }
}

/// The right to compute a field. Its file goes with it, field or no field.
struct Lock {
    path: PathBuf,
    /// The system takes it back from processes that end.
    _file: File,
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Still held: nobody else's can be at this place. Who opened it before finds that it has lost its name.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// The right to compute a field, and whether another had it first. Where a file system has no locks, everyone has it: two then
/// compute the same bits and one file replaces the other.
fn take(path: &Path, going: Going) -> Result<(Lock, bool), Failure> {
    let fail = |source| Error::Io { path: path.to_owned(), action: "open", source };
    let mut waited = false;
    let mut tries = 0..TRIES;
    loop {
        let file = File::options().create(true).truncate(false).write(true).open(path).map_err(fail)?;
        while let Err(TryLockError::WouldBlock) = FileExt::try_lock(&file) {
            if !going() {
                return Err(Error::Cancelled.into());
            }
            if !waited {
                log::info!("{}: another process computes this field, waiting for it", path.display());
            }
            waited = true;
            std::thread::sleep(LOOK);
        }
        if is_at(&file, path) || tries.next().is_none() {
            return Ok((Lock { path: path.to_owned(), _file: file }, waited));
        }
        // Its holder took it away: another may hold the one that has its name now.
        waited = true;
    }
}

/// Whether the file of that name is this one.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    matches!((file.metadata(), path.metadata()), (Ok(a), Ok(b)) if (a.dev(), a.ino()) == (b.dev(), b.ino()))
}

/// Files that are open keep their names here.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}
