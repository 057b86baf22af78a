//! SIGINT and SIGTERM as a flag that work looks at.

use super::fail::Failure;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// The signal that came, if one did.
#[derive(Clone)]
pub struct Signals(Arc<AtomicUsize>);

impl Signals {
    /// Listens from now on. A second signal ends the process at once.
    pub fn listen() -> Result<Self, Failure> {
        let (signal, again) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicBool::new(false)));
        for number in [SIGINT, SIGTERM] {
            let register = || {
                signal_hook::flag::register_conditional_shutdown(number, 128 + number, again.clone())?;
                signal_hook::flag::register(number, again.clone())?;
                signal_hook::flag::register_usize(number, signal.clone(), number as usize)
            };
            register().map_err(|e| Failure::new(1, format!("signals cannot be listened to: {e}")))?;
        }
        Ok(Self(signal))
    }

    /// Whether none came.
    pub fn going(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }

    /// What a command that was stopped ends with.
    pub fn failure(&self) -> Option<Failure> {
        let name = match i32::try_from(self.0.load(Ordering::Relaxed)) {
            Ok(SIGINT) => "SIGINT",
            Ok(SIGTERM) => "SIGTERM",
            _ => return None,
        };
        Some(Failure::new(128 + self.0.load(Ordering::Relaxed) as u8, format!("stopped by {name}")))
    }
}
