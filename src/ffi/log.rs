//! The host's log: what this crate says through the `log` crate while it works for an engine goes to that engine's callback.

use super::abi::*;
use super::defect;
use super::fault::{self, Fault, Result};
use super::host::call_back;
use crate::engine::HEARD;
use std::cell::RefCell;
use std::ffi::{CString, c_void};
use std::sync::{Arc, Once};

/// A host's callback.
#[derive(Clone, Copy, Default)]
pub(super) struct Log {
    callback: hl_log_fn,
    user: *mut c_void,
    level: i32,
}

// SAFETY: the header says that callbacks run on any thread of a call or a job; the pointer is only handed back.
unsafe impl Send for Log {}
// SAFETY: as above.
unsafe impl Sync for Log {}

impl Log {
    pub fn new(callback: hl_log_fn, user: *mut c_void, level: i32) -> Result<Self> {
        let levels = [(0, HL_LOG_WARNING), (1, HL_LOG_ERROR), (2, HL_LOG_WARNING), (3, HL_LOG_INFO), (4, HL_LOG_DEBUG)];
        let level = super::call::choice("hl_engine_info.log_level", level, &levels)?;
        if callback.is_some() {
            static INSTALLED: Once = Once::new();
            INSTALLED.call_once(|| {
                // A host in Rust may have a logger of its own, which then hears what is said instead.
                if log::set_logger(&Router).is_ok() {
                    log::set_max_level(log::LevelFilter::Debug);
                }
            });
        }
        Ok(Self { callback, user, level })
    }

    /// Tells the host, as engine `id`.
    pub fn write(&self, id: usize, severity: i32, text: &str) {
        if severity > self.level {
            return;
        }
        if let (Some(callback), Ok(text)) = (self.callback, CString::new(text.replace('\0', " "))) {
            // SAFETY: the host's own function and pointer; the text lives until it returns.
            call_back(id, || unsafe { callback(self.user, severity, text.as_ptr()) });
        }
    }

    /// While `work` runs on this thread, what the crate says goes to this log.
    pub fn during<T>(&self, id: usize, work: impl FnOnce() -> T) -> T {
        struct Ends;
        impl Drop for Ends {
            fn drop(&mut self) {
                let _ = CURRENT.try_with(|all| all.try_borrow_mut().map(|mut all| all.pop()));
            }
        }
        let _ = CURRENT.try_with(|all| all.try_borrow_mut().map(|mut all| all.push((id, *self))));
        let _ends = Ends;
        work()
    }
}

thread_local! {
    static CURRENT: RefCell<Vec<(usize, Log)>> = const { RefCell::new(Vec::new()) };
}

struct Router;

impl log::Log for Router {
    fn enabled(&self, _: &log::Metadata<'_>) -> bool {
        true
    }

    fn log(&self, record: &log::Record<'_>) {
        // Those the engine's turn hands over, whoever's logger this is.
        if record.target() == HEARD {
            return;
        }
        let severity = match record.level() {
            log::Level::Error => HL_LOG_ERROR,
            log::Level::Warn => HL_LOG_WARNING,
            log::Level::Info => HL_LOG_INFO,
            log::Level::Debug | log::Level::Trace => HL_LOG_DEBUG,
        };
        let current = CURRENT.try_with(|all| all.try_borrow().ok().and_then(|all| all.last().copied())).ok().flatten();
        if let Some((id, log)) = current {
            log.write(id, severity, &record.args().to_string());
        }
    }

    fn flush(&self) {}
}

/// A host's function that lets go of borrowed memory; called when this is dropped.
pub(super) struct Release {
    pub engine: usize,
    pub release: hl_release_fn,
    pub user: *mut c_void,
    pub data: *const c_void,
}

/// Memory of the host's, borrowed.
pub(super) type Borrowed = Arc<Release>;

// SAFETY: the header says that borrowed memory stays valid and unchanged until it is released, and that the release runs on
// whichever thread lets go last.
unsafe impl Send for Release {}
// SAFETY: as above; the memory is only read.
unsafe impl Sync for Release {}

impl Drop for Release {
    fn drop(&mut self) {
        if let Some(release) = self.release {
            // A panic must not leave a destructor.
            let run = || {
                call_back(self.engine, || {
                    // SAFETY: the host's own function and pointers, once.
                    unsafe { release(self.user, self.data) }
                })
            };
            if let Err(said) = defect::caught(run) {
                fault::remember(self.engine, Fault::new(HL_ERROR_INTERNAL, format!("a defect was hit in a release: {said}")));
            }
        }
    }
}
