//! What went wrong, as C hears it: a status and a sentence, kept per thread and engine.

use super::abi::*;
use crate::error::Error;
use std::cell::RefCell;

/// A status below 0 and its sentence.
#[derive(Clone, Debug)]
pub(super) struct Fault {
    pub status: hl_status,
    pub text: String,
}

pub(super) type Result<T> = std::result::Result<T, Fault>;

impl Fault {
    pub fn new(status: hl_status, text: impl Into<String>) -> Self {
        Self { status, text: text.into() }
    }

    /// `HL_ERROR_INVALID`: which value, what is wrong with it, what would be right.
    pub fn invalid(item: &str, what: impl std::fmt::Display, right: &str) -> Self {
        Self::new(HL_ERROR_INVALID, format!("{item}: {what}; {right}"))
    }

    /// `HL_ERROR_MEMORY`: main memory.
    pub fn memory(what: &str) -> Self {
        Self::new(HL_ERROR_MEMORY, format!("there is no main memory for {what}; free some, or ask for less"))
    }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        let status = match &error {
            Error::Io { .. } => HL_ERROR_IO,
            Error::Format { .. } => HL_ERROR_FORMAT,
            Error::Scene { .. } | Error::Invalid { .. } => HL_ERROR_INVALID,
            Error::NoDevice { .. } => HL_ERROR_NO_DEVICE,
            Error::DeviceLacks { .. } => HL_ERROR_DEVICE_LACKS,
            Error::DeviceLost { .. } => HL_ERROR_DEVICE_LOST,
            Error::OutOfMemory { .. } | Error::NoMemory { .. } => HL_ERROR_MEMORY,
            Error::Cancelled => HL_ERROR_CANCELLED,
            Error::Hazard { .. } | Error::Vulkan { .. } => HL_ERROR_INTERNAL,
        };
        Self::new(status, error.to_string())
    }
}

/// The name of a status.
pub(super) fn name(status: hl_status) -> Option<&'static std::ffi::CStr> {
    Some(match status {
        HL_OK => c"HL_OK",
        HL_NOT_READY => c"HL_NOT_READY",
        HL_TIMEOUT => c"HL_TIMEOUT",
        HL_END => c"HL_END",
        HL_ERROR_INVALID => c"HL_ERROR_INVALID",
        HL_ERROR_HANDLE => c"HL_ERROR_HANDLE",
        HL_ERROR_BUSY => c"HL_ERROR_BUSY",
        HL_ERROR_REENTRANT => c"HL_ERROR_REENTRANT",
        HL_ERROR_CANCELLED => c"HL_ERROR_CANCELLED",
        HL_ERROR_NO_DEVICE => c"HL_ERROR_NO_DEVICE",
        HL_ERROR_DEVICE_LACKS => c"HL_ERROR_DEVICE_LACKS",
        HL_ERROR_DEVICE_LOST => c"HL_ERROR_DEVICE_LOST",
        HL_ERROR_MEMORY => c"HL_ERROR_MEMORY",
        HL_ERROR_IO => c"HL_ERROR_IO",
        HL_ERROR_FORMAT => c"HL_ERROR_FORMAT",
        HL_ERROR_POISONED => c"HL_ERROR_POISONED",
        HL_ERROR_INTERNAL => c"HL_ERROR_INTERNAL",
        _ => return None,
    })
}

/// Engines whose last fault a thread remembers.
const REMEMBERED: usize = 16;

thread_local! {
    /// (engine, 0 for none; fault), the latest last.
    static LAST: RefCell<Vec<(usize, Fault)>> = const { RefCell::new(Vec::new()) };
}

/// Keeps a fault for `hl_last_error`.
pub(super) fn remember(engine: usize, fault: Fault) {
    // Where the thread is ending there is nobody left to ask.
    let _ = LAST.try_with(|last| {
        if let Ok(mut last) = last.try_borrow_mut() {
            last.retain(|(e, _)| *e != engine);
            if last.len() >= REMEMBERED {
                last.remove(0);
            }
            last.push((engine, fault));
        }
    });
}

/// This thread's last fault of an engine; of any for `None`.
pub(super) fn last(engine: Option<usize>) -> Option<Fault> {
    let find = |last: &RefCell<Vec<(usize, Fault)>>| {
        let last = last.try_borrow().ok()?;
        last.iter().rev().find(|(e, _)| engine.is_none_or(|wanted| wanted == *e)).map(|(_, fault)| fault.clone())
    };
    LAST.try_with(find).ok().flatten()
}
