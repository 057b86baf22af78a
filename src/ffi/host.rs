//! An engine as many threads of a host share it: calls that need its device take turns, in the order in which they came.

use super::abi::*;
use super::fault::{Fault, Result};
use super::log::Log;
use super::vulkan::Guard;
use crate::engine::{Engine, Span};
use std::cell::RefCell;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError, RwLock, Weak};

use super::job::Job;

/// An engine and what is around it.
pub(super) struct Host {
    pub id: usize,
    /// Gone once the engine was destroyed.
    engine: RwLock<Option<Arc<Engine>>>,
    queue: Mutex<Queue>,
    moved: Condvar,
    /// What the defect said that was hit on it.
    poisoned: OnceLock<String>,
    pub log: Log,
    /// Jobs that may still run.
    pub jobs: Mutex<Vec<Weak<Job>>>,
    /// Validation messages that were handed to the log.
    told: AtomicUsize,
    /// Of the host's queue; the engine goes before.
    _guard: Option<Box<Guard>>,
}

/// Who is next, by number.
#[derive(Default)]
struct Queue {
    next: u64,
    serving: u64,
    /// Calls and jobs under way.
    active: usize,
    /// Nothing begins any more, but calls from within callbacks of what is under way.
    closing: bool,
}

thread_local! {
    /// Engines in whose callbacks this thread is.
    static CALLBACKS: RefCell<Vec<usize>> = const { RefCell::new(Vec::new()) };
}

/// Locks, also after a panic: what the mutexes here guard is whole between any two statements.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Host {
    pub fn new(id: usize, engine: Engine, log: Log, guard: Option<Box<Guard>>) -> Self {
        Self {
            id,
            engine: RwLock::new(Some(Arc::new(engine))),
            queue: Mutex::default(),
            moved: Condvar::new(),
            poisoned: OnceLock::new(),
            log,
            jobs: Mutex::default(),
            told: AtomicUsize::new(0),
            _guard: guard,
        }
    }

    /// The engine, for what needs no turn.
    pub fn engine(&self) -> Result<Arc<Engine>> {
        let engine = self.engine.read().unwrap_or_else(PoisonError::into_inner).clone();
        engine.ok_or_else(|| Fault::new(HL_ERROR_HANDLE, "engine: it is being destroyed"))
    }

    pub fn poison(&self, said: &str) {
        // The first is the cause.
        let _ = self.poisoned.set(said.to_owned());
    }

    /// Refuses a poisoned engine.
    pub fn whole(&self) -> Result<()> {
        match self.poisoned.get() {
            Some(said) => {
                Err(Fault::new(HL_ERROR_POISONED, format!("engine: a defect was hit earlier: {said}; destroy it and create another")))
            }
            None => Ok(()),
        }
    }

    /// Refuses calls from within this engine's callbacks.
    pub fn outside(&self) -> Result<()> {
        let inside = CALLBACKS.try_with(|all| all.try_borrow().is_ok_and(|all| all.contains(&self.id))).unwrap_or(false);
        match inside {
            true => Err(Fault::new(
                HL_ERROR_REENTRANT,
                "engine: this call is not allowed within one of its callbacks; make it after the callback has returned",
            )),
            false => Ok(()),
        }
    }

    /// Runs a callback of the host's.
    pub fn call_back<T>(&self, callback: impl FnOnce() -> T) -> T {
        call_back(self.id, callback)
    }

    /// Begins a call or a job that keeps the engine alive.
    pub fn begin(self: &Arc<Self>) -> Result<Active> {
        self.outside()?;
        self.whole()?;
        self.enter()
    }

    /// Begins a call that may come from within a callback, or on an engine that is poisoned.
    pub fn enter(self: &Arc<Self>) -> Result<Active> {
        // What the callback belongs to is under way, and waited for.
        let within = self.outside().is_err();
        let mut queue = lock(&self.queue);
        if queue.closing && !(within && queue.active > 0) {
            return Err(closing());
        }
        queue.active += 1;
        Ok(Active(self.clone()))
    }

    /// Waits for the device.
    pub fn turn(self: &Arc<Self>) -> Result<Turn> {
        let active = self.begin()?;
        let engine = self.engine()?;
        self.wait();
        let (aside, before) = (engine.take_timings(), engine.total_timings());
        Ok(Turn { engine, aside, before, spent: Vec::new(), held: true, active })
    }

    fn wait(&self) {
        let mut queue = lock(&self.queue);
        let mine = queue.next;
        queue.next += 1;
        while queue.serving != mine {
            queue = self.moved.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn pass_on(&self) {
        lock(&self.queue).serving += 1;
        self.moved.notify_all();
    }

    fn wanted(&self) -> bool {
        let queue = lock(&self.queue);
        queue.next > queue.serving + 1
    }

    pub fn is_closing(&self) -> bool {
        lock(&self.queue).closing
    }

    /// Ends the engine: nothing begins any more, jobs are cancelled, and what is under way is waited for.
    pub fn close(&self) {
        lock(&self.queue).closing = true;
        let jobs: Vec<_> = lock(&self.jobs).drain(..).filter_map(|j| j.upgrade()).collect();
        for job in jobs {
            job.cancel();
            job.join();
        }
        let mut queue = lock(&self.queue);
        while queue.active > 0 {
            queue = self.moved.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
        drop(queue);
        let engine = self.engine.write().unwrap_or_else(PoisonError::into_inner).take();
        drop(engine);
    }

    /// Hands new validation messages to the log.
    fn tell_validation(&self, engine: &Engine) {
        let messages = engine.validation_errors();
        let told = self.told.fetch_max(messages.len(), Ordering::SeqCst);
        for message in messages.iter().skip(told) {
            self.log.write(self.id, HL_LOG_ERROR, message);
        }
    }
}

fn closing() -> Fault {
    Fault::new(HL_ERROR_HANDLE, "engine: it is being destroyed")
}

/// Runs a callback of an engine's host; calls from within are recognised.
pub(super) fn call_back<T>(engine: usize, callback: impl FnOnce() -> T) -> T {
    struct Inside;
    impl Drop for Inside {
        fn drop(&mut self) {
            let _ = CALLBACKS.try_with(|all| all.try_borrow_mut().map(|mut all| all.pop()));
        }
    }
    let _ = CALLBACKS.try_with(|all| all.try_borrow_mut().map(|mut all| all.push(engine)));
    let _inside = Inside;
    callback()
}

/// A call or job that is under way.
pub(super) struct Active(pub Arc<Host>);

impl Drop for Active {
    fn drop(&mut self) {
        lock(&self.0.queue).active -= 1;
        self.0.moved.notify_all();
    }
}

/// The device, until this is dropped. Device time is booked on whoever has the turn.
pub(super) struct Turn {
    engine: Arc<Engine>,
    /// Timings that others have not taken yet.
    aside: Vec<Span>,
    before: Vec<Span>,
    spent: Vec<Span>,
    held: bool,
    active: Active,
}

impl Turn {
    pub fn engine(&self) -> &Arc<Engine> {
        &self.engine
    }

    pub fn host(&self) -> &Arc<Host> {
        &self.active.0
    }

    /// Runs something while others may have the device.
    pub fn without<T>(&mut self, other: impl FnOnce() -> T) -> T {
        self.spent();
        let mine = self.engine.take_timings();
        self.engine.put_timings(std::mem::take(&mut self.aside));
        self.held = false;
        self.host().pass_on();
        let result = other();
        self.host().wait();
        self.held = true;
        self.aside = self.engine.take_timings();
        self.engine.put_timings(mine);
        self.before = self.engine.total_timings();
        result
    }

    /// Lets those who wait go first.
    pub fn give_way(&mut self) {
        if self.host().wanted() {
            self.without(|| ());
        }
    }

    /// Device time so far, by kernel.
    pub fn spent(&mut self) -> &[Span] {
        let now = self.engine.total_timings();
        for span in &now {
            let before = self.before.iter().find(|s| s.kernel == span.kernel);
            let (calls, seconds) = before.map_or((0, 0.0), |b| (b.calls, b.seconds));
            if span.calls > calls {
                let own = Span { calls: span.calls - calls, seconds: span.seconds - seconds, ..span.clone() };
                Engine::merge_timings(&mut self.spent, [own]);
            }
        }
        self.before = now;
        &self.spent
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        // A panic in a callback unwinds from where the turn was given away.
        if self.held {
            self.engine.take_timings();
            self.engine.put_timings(std::mem::take(&mut self.aside));
            self.host().pass_on();
        }
        self.host().tell_validation(&self.engine);
    }
}

/// A thing that jobs read and that can be changed: not both at once.
#[derive(Default)]
pub(super) struct Users(AtomicUsize);

/// While this lives, the thing is in use.
pub(super) struct InUse<T: AsRef<Users>>(pub Arc<T>);

impl<T: AsRef<Users>> InUse<T> {
    pub fn new(of: Arc<T>) -> Self {
        (*of).as_ref().0.fetch_add(1, Ordering::SeqCst);
        Self(of)
    }
}

impl<T: AsRef<Users>> Drop for InUse<T> {
    fn drop(&mut self) {
        (*self.0).as_ref().0.fetch_sub(1, Ordering::SeqCst);
    }
}

impl Users {
    /// Refuses a change while somebody reads.
    pub fn none(&self, name: &str) -> Result<()> {
        match self.0.load(Ordering::SeqCst) {
            0 => Ok(()),
            _ => Err(Fault::new(HL_ERROR_BUSY, format!("{name}: a running job reads it; wait for the job, or cancel it"))),
        }
    }
}
