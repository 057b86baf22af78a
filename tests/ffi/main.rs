//! The C interface, called as C calls it (from Rust, so that all of its answers can be looked at).
#![cfg(feature = "capi")]

/// Calls, and fails with the sentence.
macro_rules! ok {
    ($call:expr) => {{
        // SAFETY: the test hands over what the header asks for.
        let status = unsafe { $call };
        assert_eq!(status, halflight::ffi::HL_OK, "{}: {:?}", stringify!($call), $crate::last(std::ptr::null()));
    }};
}

/// Calls, and expects a status and a sentence to it that holds some words.
macro_rules! refused {
    ($status:expr, $words:expr, $call:expr) => {{
        // SAFETY: what is wrong in it is what the library promises to find out.
        let status = unsafe { $call };
        assert_eq!(status, $status, "{}", stringify!($call));
        let (kept, text) = $crate::last(std::ptr::null());
        assert!(kept == $status && text.contains($words), "{}: {kept} {text:?} lacks {:?}", stringify!($call), $words);
    }};
}

mod cancel;
mod data;
mod estimates;
mod everywhere;
mod jobs;
mod life;
mod misuse;
mod reference;
mod same;
mod scene_keys;
mod scenes;

use halflight::ffi::*;
use std::ffi::{CStr, c_char};

/// A struct as `HL_INIT` makes it.
pub(crate) fn init<T: halflight::ffi::abi::Sized_>() -> T {
    // SAFETY: any bytes are a value of such a struct.
    let mut value: T = unsafe { std::mem::MaybeUninit::zeroed().assume_init() };
    // SAFETY: every such struct begins with its size.
    unsafe { std::ptr::from_mut(&mut value).cast::<u32>().write(size_of::<T>() as u32) };
    value
}

/// Status and sentence of this thread's last fault.
pub(crate) fn last(engine: *const hl_engine) -> (i32, String) {
    let mut text = [0 as c_char; 1024];
    // SAFETY: there is room for so many bytes.
    unsafe {
        let status = hl_last_error(engine, text.as_mut_ptr(), text.len() as u64);
        (status, CStr::from_ptr(text.as_ptr()).to_string_lossy().into_owned())
    }
}

/// An engine whose destruction fails the test if the validation layers said anything.
pub(crate) struct Engine(pub *mut hl_engine);

// SAFETY: handles may be used on any thread.
unsafe impl Send for Engine {}
// SAFETY: as above.
unsafe impl Sync for Engine {}

impl Engine {
    pub(crate) fn new() -> Self {
        let mut engine = std::ptr::null_mut();
        let info = hl_engine_info { validate: 1, ..init() };
        ok!(hl_engine_create(&info, &mut engine));
        Self(engine)
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        let mut info: hl_device_info = init();
        // SAFETY: the handle may be stale by now, which is found out.
        let errors = unsafe { if hl_engine_get_device(self.0, &mut info) == HL_OK { info.validation_errors } else { 0 } };
        // SAFETY: as above.
        unsafe { hl_engine_destroy(self.0) };
        if !std::thread::panicking() {
            assert_eq!(errors, 0, "validation must be clean");
        }
    }
}
