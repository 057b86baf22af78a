//! What is logged while a file is read.

use std::cell::RefCell;

thread_local! {
    static SAID: RefCell<Vec<String>> = const { RefCell::new(Vec::new()) };
}

struct Listener;

impl log::Log for Listener {
    fn enabled(&self, _: &log::Metadata) -> bool {
        true
    }
    fn log(&self, record: &log::Record) {
        if record.level() <= log::Level::Warn {
            SAID.with_borrow_mut(|said| said.push(record.args().to_string()));
        }
    }
    fn flush(&self) {}
}

/// What `work` yields, and the warnings that it gives on the way.
pub fn warnings<T>(work: impl FnOnce() -> T) -> (T, Vec<String>) {
    // Tests of one program share it.
    let _ = log::set_logger(&Listener);
    log::set_max_level(log::LevelFilter::Warn);
    SAID.take();
    let out = work();
    (out, SAID.take())
}
