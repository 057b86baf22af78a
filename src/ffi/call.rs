//! The way in: every entry runs inside [`enter`]; nothing unwinds out of it, and its fault is kept for `hl_last_error`.

use super::abi::*;
use super::defect;
use super::fault::{self, Fault, Result};
use super::handle::{self, Object};
use super::host::{Active, Host};
use std::ffi::{CStr, OsStr, c_char};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The engine that a call turned out to be about.
#[derive(Default)]
pub(super) struct Scope {
    host: Option<Arc<Host>>,
    // Keeps the engine from being closed meanwhile.
    active: Option<Active>,
}

/// Runs the body of an entry.
pub(super) fn enter(body: impl FnOnce(&mut Scope) -> Result<hl_status>) -> hl_status {
    let mut scope = Scope::default();
    let fault = match defect::caught(|| body(&mut scope)) {
        Ok(Ok(status)) => return status,
        Ok(Err(fault)) => fault,
        Err(said) => panicked(scope.host.as_deref(), &said),
    };
    let status = fault.status;
    fault::remember(scope.host.map_or(0, |h| h.id), fault);
    status
}

/// Poisons the engine that a panic went through, and tells its log.
pub(super) fn panicked(host: Option<&Host>, said: &str) -> Fault {
    let Some(host) = host else { return Fault::new(HL_ERROR_INTERNAL, format!("a defect was hit: {said}")) };
    host.poison(said);
    let text = format!("a defect was hit: {said}; the engine can only be destroyed");
    // The log is the host's, and may have a defect of its own.
    let _ = defect::caught(|| host.log.write(host.id, HL_LOG_ERROR, &text));
    Fault::new(HL_ERROR_INTERNAL, text)
}

impl Scope {
    /// The object of a handle, of an engine that is whole and the same for all objects of the call; not from within a
    /// callback.
    pub fn get<T: Object>(&mut self, handle: *const T::Handle) -> Result<Arc<T>> {
        handle::find::<T>(handle, |object| {
            self.about(object.host(), T::NAME)?;
            if self.active.is_none() {
                self.active = Some(object.host().begin()?);
            }
            Ok(())
        })
    }

    /// The same, or `None` for NULL.
    pub fn optional<T: Object>(&mut self, handle: *const T::Handle) -> Result<Option<Arc<T>>> {
        if handle.is_null() { Ok(None) } else { self.get::<T>(handle).map(Some) }
    }

    /// The object of a handle, also from within a callback.
    pub fn inside<T: Object>(&mut self, handle: *const T::Handle) -> Result<Arc<T>> {
        handle::find::<T>(handle, |object| {
            self.about(object.host(), T::NAME)?;
            self.active = Some(object.host().enter()?);
            Ok(())
        })
    }

    /// Forgets a handle, also of an engine that is poisoned; not from within a callback.
    pub fn take<T: Object>(&mut self, handle: *const T::Handle) -> Result<Option<Arc<T>>> {
        handle::take::<T>(handle, |object| {
            self.host = Some(object.host().clone());
            object.host().outside()?;
            self.active = Some(object.host().enter()?);
            Ok(())
        })
    }

    /// Forgets the handle of an engine, which then ends: it is not waited for by itself.
    pub fn end<T: Object>(&mut self, handle: *const T::Handle) -> Result<Option<Arc<T>>> {
        handle::take::<T>(handle, |object| {
            self.host = Some(object.host().clone());
            object.host().outside()
        })
    }

    /// What a call begins with that makes something: its output says "nothing", and what it is `of` is found before a fault
    /// of the output, which the engine then keeps.
    pub fn making<T, R>(&mut self, item: &str, at: *mut *mut T, of: impl FnOnce(&mut Self) -> Result<R>) -> Result<(R, Out<T>)> {
        let out = out(item, at);
        Ok((of(self)?, out?))
    }

    fn about(&mut self, host: &Arc<Host>, name: &str) -> Result<()> {
        match &self.host {
            Some(first) if !Arc::ptr_eq(first, host) => {
                let text = format!("{name}: it belongs to another engine; all handles of a call must be of one");
                return Err(Fault::new(HL_ERROR_HANDLE, text));
            }
            Some(_) => {}
            None => self.host = Some(host.clone()),
        }
        host.whole()
    }
}

/// Sets an output to "nothing"; the place to write the result to.
pub(super) fn out<T>(item: &str, at: *mut *mut T) -> Result<Out<T>> {
    if at.is_null() {
        return Err(Fault::invalid(item, "is NULL", "a place for the handle is needed"));
    }
    // SAFETY: the caller gave a place for a pointer.
    unsafe { at.write_unaligned(std::ptr::null_mut()) };
    Ok(Out(at))
}

/// A place for a handle.
pub(super) struct Out<T>(*mut *mut T);

impl<T> Out<T> {
    /// Hands an object out.
    pub fn give<O: Object<Handle = T>>(self, object: Arc<O>) -> Result<hl_status> {
        self.give_as(handle::number(), object)
    }

    /// Hands an object out under a number.
    pub fn give_as<O: Object<Handle = T>>(self, number: usize, object: Arc<O>) -> Result<hl_status> {
        // SAFETY: as in `out`, which checked it.
        unsafe { self.0.write_unaligned(handle::insert(number, object)) };
        Ok(HL_OK)
    }
}

/// Writes a number that the caller may not want.
pub(super) fn put<T>(at: *mut T, value: T) {
    if !at.is_null() {
        // SAFETY: the caller gave a place for one.
        unsafe { at.write_unaligned(value) };
    }
}

/// Largest struct that is looked at, bytes: what lies beyond was never initialised.
const MAX_STRUCT: usize = 1 << 12;

/// Reads a struct of the size that it says it has.
pub(super) fn read<T: Sized_>(item: &str, at: *const T) -> Result<T> {
    read_as(item, at, 0)
}

/// Reads an extension.
pub(super) fn read_as<T: Sized_>(item: &str, at: *const T, kind: i32) -> Result<T> {
    let value = look(item, at, kind)?;
    unreserved(item, &value)?;
    Ok(value)
}

/// Refuses a struct whose reserved member is set.
pub(super) fn unreserved<T: Sized_>(item: &str, value: &T) -> Result<()> {
    if value.reserved() { Err(Fault::invalid(item, "its member reserved is set", "it must be 0")) } else { Ok(()) }
}

/// Reads an extension whose reserved member is still to be looked at.
pub(super) fn look<T: Sized_>(item: &str, at: *const T, kind: i32) -> Result<T> {
    let size = size_of_struct(item, at)?;
    let mut value = std::mem::MaybeUninit::<T>::zeroed();
    let ours = size_of::<T>();
    // SAFETY: the caller says that `size` bytes are there; no more than the value holds are copied.
    unsafe { std::ptr::copy_nonoverlapping(at.cast::<u8>(), value.as_mut_ptr().cast::<u8>(), size.min(ours)) };
    // SAFETY: as above.
    let tail = unsafe { std::slice::from_raw_parts(at.cast::<u8>().add(ours.min(size)), size.saturating_sub(ours)) };
    if tail.iter().any(|&byte| byte != 0) {
        return Err(Fault::invalid(
            item,
            format_args!("holds values beyond the {ours} bytes known here"),
            "set them to 0, or use a newer library",
        ));
    }
    // SAFETY: `Sized_` promises that any bytes are a value.
    let value = unsafe { value.assume_init() };
    // SAFETY: every such struct begins with the header.
    let header: hl_header = unsafe { std::ptr::from_ref(&value).cast::<hl_header>().read() };
    if header.struct_type != kind {
        let what = format!("struct_type is {}", header.struct_type);
        return Err(Fault::invalid(item, what, &format!("it must be {kind} here; HL_INIT or HL_INIT_AS sets it")));
    }
    Ok(value)
}

fn size_of_struct<T: Sized_>(item: &str, at: *const T) -> Result<usize> {
    if at.is_null() {
        return Err(Fault::invalid(item, "is NULL", "a struct is needed"));
    }
    // SAFETY: every such struct begins with its size.
    let size = unsafe { at.cast::<u32>().read_unaligned() } as usize;
    // What is no multiple of the alignment is no sizeof, and would cut a pointer in half.
    if !(size_of::<hl_header>()..=MAX_STRUCT).contains(&size) || !size.is_multiple_of(align_of::<T>()) {
        return Err(Fault::invalid(item, format_args!("struct_size is {size}"), "set it to the sizeof of the struct"));
    }
    Ok(size)
}

/// Fills a struct of the caller's, as far as it reaches; its header stays.
pub(super) fn fill<T: Sized_>(item: &str, at: *mut T, make: impl FnOnce(&mut T)) -> Result<hl_status> {
    let size = size_of_struct(item, at.cast_const())?;
    // SAFETY: `Sized_` promises that any bytes are a value.
    let mut value = unsafe { std::mem::MaybeUninit::<T>::zeroed().assume_init() };
    make(&mut value);
    let (header, ours) = (size_of::<hl_header>(), size_of::<T>());
    // SAFETY: the caller says that `size` bytes are there; what is copied or zeroed lies within them and within the value.
    unsafe {
        let end = size.min(ours);
        let from = std::ptr::from_ref(&value).cast::<u8>();
        std::ptr::copy_nonoverlapping(from.add(header), at.cast::<u8>().add(header), end - header);
        std::ptr::write_bytes(at.cast::<u8>().add(end), 0, size - end);
    }
    Ok(HL_OK)
}

/// No extension is known where `next` is this.
pub(super) fn alone(item: &str, next: *const std::ffi::c_void) -> Result<()> {
    if next.is_null() { Ok(()) } else { Err(Fault::invalid(item, "next is not NULL", "no extension is known here")) }
}

/// Numbers at a pointer.
pub(super) fn numbers<T: Copy>(item: &str, at: *const T, count: usize) -> Result<Vec<T>> {
    if at.is_null() {
        return Err(Fault::invalid(item, "is NULL", "numbers are needed"));
    }
    // SAFETY: the caller says that they are there; read one by one, for nobody promised alignment.
    Ok((0..count).map(|i| unsafe { at.add(i).read_unaligned() }).collect())
}

/// A C string, or `None` for NULL.
pub(super) fn text<'a>(at: *const c_char) -> Option<&'a CStr> {
    // SAFETY: the caller says that a string ends in 0, and keeps it during the call.
    if at.is_null() { None } else { Some(unsafe { CStr::from_ptr(at) }) }
}

/// A C string as text, or `None` for NULL.
pub(super) fn words(item: &str, at: *const c_char) -> Result<Option<String>> {
    let words = text(at).map(|t| t.to_str().map(str::to_owned)).transpose();
    words.map_err(|_| Fault::invalid(item, "is not UTF-8", "give UTF-8"))
}

/// A path.
pub(super) fn path(at: *const c_char) -> Result<PathBuf> {
    let Some(text) = text(at) else { return Err(Fault::invalid("path", "is NULL", "name a file")) };
    Ok(PathBuf::from(os(text)?))
}

/// What a path ends in, in small letters.
pub(super) fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

#[cfg(unix)]
fn os(text: &CStr) -> Result<&OsStr> {
    Ok(std::os::unix::ffi::OsStrExt::from_bytes(text.to_bytes()))
}

#[cfg(not(unix))]
fn os(text: &CStr) -> Result<&OsStr> {
    text.to_str().map(OsStr::new).map_err(|_| Fault::invalid("path", "is not UTF-8", "paths are UTF-8 here"))
}

/// Text into an array of the caller's, cut where it does not fit, ended by 0.
pub(super) fn copy_text(to: &mut [c_char], text: &str) {
    let Some(room) = to.len().checked_sub(1) else { return };
    let mut end = text.len().min(room);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    for (to, &byte) in to.iter_mut().zip(&text.as_bytes()[..end]) {
        *to = byte as c_char;
    }
    to[end] = 0;
}

/// A switch: 0 or 1.
pub(super) fn switch(item: &str, value: i32) -> Result<bool> {
    match value {
        0 => Ok(false),
        1 => Ok(true),
        other => Err(Fault::invalid(item, format_args!("is {other}"), "it must be 0 or 1")),
    }
}

/// One of some constants.
pub(super) fn choice<T: Copy>(item: &str, value: i32, known: &[(i32, T)]) -> Result<T> {
    known.iter().find(|(k, _)| *k == value).map(|(_, v)| *v).ok_or_else(|| {
        let list: Vec<String> = known.iter().map(|(k, _)| k.to_string()).collect();
        Fault::invalid(item, format_args!("is {value}"), &format!("it must be one of {}", list.join(", ")))
    })
}

/// Numbers that must be finite.
pub(super) fn finite(item: &str, values: &[f64]) -> Result<()> {
    match values.iter().find(|v| !v.is_finite()) {
        Some(v) => Err(Fault::invalid(item, format_args!("holds {v}"), "its numbers must be finite")),
        None => Ok(()),
    }
}
