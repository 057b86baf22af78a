//! Defects: a panic inside the library is caught where the host came in. What it said goes to the host's sentence and log, and
//! not to its standard error.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    /// How deep this thread is in what catches panics.
    static INSIDE: Cell<u32> = const { Cell::new(0) };
    /// Where the last one of this thread was.
    static PLACE: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Runs something; what a panic said, and where it was.
pub(super) fn caught<T>(body: impl FnOnce() -> T) -> Result<T, String> {
    struct Inside;
    impl Drop for Inside {
        fn drop(&mut self) {
            let _ = INSIDE.try_with(|depth| depth.set(depth.get() - 1));
        }
    }
    listen();
    let outcome = {
        let _inside = INSIDE.try_with(|depth| depth.set(depth.get() + 1)).is_ok().then_some(Inside);
        catch_unwind(AssertUnwindSafe(body))
    };
    outcome.map_err(|payload| {
        let said = words(payload.as_ref());
        match PLACE.try_with(|place| place.try_borrow_mut().map(|mut place| std::mem::take(&mut *place))) {
            Ok(Ok(place)) if !place.is_empty() => format!("{said} ({place})"),
            _ => said,
        }
    })
}

fn words(payload: &(dyn Any + Send)) -> String {
    let words = payload.downcast_ref::<&str>().map(|s| (*s).to_owned()).or_else(|| payload.downcast_ref::<String>().cloned());
    words.unwrap_or_else(|| "an exception".into())
}

/// Panics that are caught here are silent; all others are heard as before.
fn listen() {
    static INSTALLED: Once = Once::new();
    // A hook cannot be changed while a panic unwinds.
    if INSTALLED.is_completed() || std::thread::panicking() {
        return;
    }
    INSTALLED.call_once(|| {
        let before = take_hook();
        set_hook(Box::new(move |info| {
            if !INSIDE.try_with(|depth| depth.get() > 0).unwrap_or(false) {
                return before(info);
            }
            if let Some(at) = info.location() {
                let _ = PLACE.try_with(|place| place.try_borrow_mut().map(|mut place| *place = format!("{}:{}", at.file(), at.line())));
            }
        }));
    });
}
