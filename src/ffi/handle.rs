//! Handles: numbers that look like pointers and are never used twice. The registry knows which object each stands for, so
//! that a destroyed, foreign or mistaken one is found out before anything is touched.

use super::abi::*;
use super::fault::{Fault, Result};
use super::host::Host;
use std::any::Any;
use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, PoisonError, RwLock};

/// What a handle may stand for.
pub(super) trait Object: Any + Send + Sync {
    /// The C type.
    type Handle;
    /// "volume"
    const NAME: &'static str;

    fn host(&self) -> &Arc<Host>;
}

struct Entry {
    object: Arc<dyn Any + Send + Sync>,
    name: &'static str,
    engine: usize,
}

static REGISTRY: LazyLock<RwLock<HashMap<usize, Entry>>> = LazyLock::new(RwLock::default);
static NEXT: AtomicUsize = AtomicUsize::new(1);

/// A number for an object: aligned as a pointer would be, and too small to be one.
pub(super) fn number() -> usize {
    NEXT.fetch_add(1, Ordering::Relaxed) << 4
}

/// Makes an object known under `number`.
pub(super) fn insert<T: Object>(number: usize, object: Arc<T>) -> *mut T::Handle {
    let engine = object.host().id;
    let entry = Entry { object, name: T::NAME, engine };
    REGISTRY.write().unwrap_or_else(PoisonError::into_inner).insert(number, entry);
    std::ptr::without_provenance_mut(number)
}

/// The object of a handle, if `begin` lets it be used. The engine cannot go between the two: nobody is left with an object of
/// an engine that has ended.
pub(super) fn find<T: Object>(handle: *const T::Handle, begin: impl FnOnce(&T) -> Result<()>) -> Result<Arc<T>> {
    let registry = REGISTRY.read().unwrap_or_else(PoisonError::into_inner);
    let entry = registry.get(&handle.addr());
    let object = entry.and_then(|e| Arc::clone(&e.object).downcast::<T>().ok());
    let object = object.ok_or_else(|| wrong::<T>(handle.addr(), entry))?;
    begin(&object)?;
    Ok(object)
}

/// Forgets a handle and returns its object, if `begin` lets it: `None` for NULL.
pub(super) fn take<T: Object>(handle: *const T::Handle, begin: impl FnOnce(&T) -> Result<()>) -> Result<Option<Arc<T>>> {
    if handle.is_null() {
        return Ok(None);
    }
    let mut registry = REGISTRY.write().unwrap_or_else(PoisonError::into_inner);
    let found = registry.get(&handle.addr());
    match found.and_then(|e| Arc::clone(&e.object).downcast::<T>().ok()) {
        Some(object) => {
            begin(&object)?;
            let entry = registry.remove(&handle.addr());
            // Its memory is freed, and callbacks run, after the registry is free again.
            drop(registry);
            drop(entry);
            Ok(Some(object))
        }
        None => Err(wrong::<T>(handle.addr(), found)),
    }
}

/// Forgets everything of an engine.
pub(super) fn take_engine(engine: usize) -> Vec<Arc<dyn Any + Send + Sync>> {
    let mut registry = REGISTRY.write().unwrap_or_else(PoisonError::into_inner);
    registry.extract_if(|_, e| e.engine == engine).map(|(_, e)| e.object).collect()
}

fn wrong<T: Object>(number: usize, entry: Option<&Entry>) -> Fault {
    let name = T::NAME;
    let text = match entry {
        _ if number == 0 => format!("{name}: the handle is NULL; one that was created is needed"),
        Some(entry) => format!("{name}: the handle is that of another thing, {}; hand over the right one", entry.name),
        None => format!("{name}: the handle {number:#x} is not known; it was destroyed, or is none of this library"),
    };
    Fault::new(HL_ERROR_HANDLE, text)
}
