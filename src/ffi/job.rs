//! `hl_job_*`: work on a thread of its own, and what it shares with blocking calls: progress, cancelling, results.

use super::abi::*;
use super::call::{Scope, copy_text, enter, fill, panicked};
use super::defect;
use super::estimate::Estimate;
use super::fault::{Fault, Result};
use super::field::FieldCell;
use super::handle::Object;
use super::host::{Active, Host, Turn, lock};
use super::image::ImageCell;
use crate::engine::{Engine, Span};
use std::ffi::{CString, c_void};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Work under way, and what came of it.
pub(super) struct Job {
    host: Arc<Host>,
    cancelled: AtomicBool,
    begun: Instant,
    state: Mutex<State>,
    ended: Condvar,
    thread: Mutex<Option<JoinHandle<()>>>,
}

#[derive(Default)]
struct State {
    /// `None` while it runs.
    outcome: Option<std::result::Result<(), Fault>>,
    seconds: f64,
    fraction: f32,
    stage: &'static str,
    passes: u32,
    directions: u32,
    spans: Vec<Span>,
    error: Option<[f64; 3]>,
    field: Option<Arc<FieldCell>>,
    image: Option<Arc<ImageCell>>,
    estimate: Option<Estimate>,
}

impl Object for Job {
    type Handle = hl_job;
    const NAME: &'static str = "job";

    fn host(&self) -> &Arc<Host> {
        &self.host
    }
}

/// A host's progress callback.
#[derive(Clone, Copy)]
pub(super) struct Progress {
    pub callback: hl_progress_fn,
    pub user: *mut c_void,
}

// SAFETY: the header says that callbacks run on the thread of the job; the pointer is only handed back.
unsafe impl Send for Progress {}

/// What is done, told what goes on.
pub(super) type Body = Box<dyn FnOnce(&mut Work) -> Result<()> + Send>;

impl Job {
    fn new(host: &Arc<Host>) -> Arc<Self> {
        Arc::new(Self {
            host: host.clone(),
            cancelled: AtomicBool::new(false),
            begun: Instant::now(),
            state: Mutex::default(),
            ended: Condvar::new(),
            thread: Mutex::default(),
        })
    }

    /// Does the work here and now.
    pub fn run(host: &Arc<Host>, progress: Progress, body: Body) -> Result<Arc<Self>> {
        let job = Self::new(host);
        job.clone().work(progress, body)?;
        Ok(job)
    }

    /// Does the work on a thread of its own.
    pub fn start(host: &Arc<Host>, progress: Progress, body: Body) -> Result<Arc<Self>> {
        let active = host.begin()?;
        let job = Self::new(host);
        let mut thread = lock(&job.thread);
        let own = job.clone();
        let spawned = std::thread::Builder::new().name("halflight job".into()).spawn(move || own.thread(active, progress, body));
        *thread = Some(
            spawned.map_err(|e| Fault::new(HL_ERROR_MEMORY, format!("a thread for the job: {e}; end some threads, or raise the limit")))?,
        );
        drop(thread);
        let mut jobs = lock(&host.jobs);
        jobs.retain(|j| j.strong_count() > 0);
        jobs.push(Arc::downgrade(&job));
        Ok(job)
    }

    fn thread(self: Arc<Self>, active: Active, progress: Progress, body: Body) {
        let outcome = defect::caught(|| self.clone().work(progress, body));
        let outcome = outcome.unwrap_or_else(|said| Err(panicked(Some(&self.host), &said)));
        let mut state = lock(&self.state);
        state.seconds = self.begun.elapsed().as_secs_f64();
        state.outcome = Some(outcome);
        self.ended.notify_all();
        drop(state);
        // What it made may be on the device, which can go as soon as this is no longer active.
        drop(self);
        drop(active);
    }

    fn work(self: Arc<Self>, progress: Progress, body: Body) -> Result<()> {
        let host = self.host.clone();
        let turn = host.turn()?;
        let mut work = Work { turn, job: self, progress, part: [0.0, 1.0], told: 0.0 };
        let outcome = host.log.during(host.id, || body(&mut work));
        work.book();
        if outcome.is_ok() {
            let stage = lock(&work.job.state).stage;
            // It is done: nobody can cancel any more.
            let _ = work.report(stage, 1.0);
        }
        outcome
    }

    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::SeqCst);
    }

    /// Waits until the thread has ended.
    pub fn join(&self) {
        if let Some(thread) = lock(&self.thread).take() {
            let _ = thread.join();
        }
    }

    pub fn field(&self) -> Option<Arc<FieldCell>> {
        lock(&self.state).field.clone()
    }

    pub fn image(&self) -> Option<Arc<ImageCell>> {
        lock(&self.state).image.clone()
    }

    pub fn estimate(&self) -> Option<Estimate> {
        lock(&self.state).estimate
    }
}

/// The device and the job, for the body of the work.
pub(super) struct Work {
    pub turn: Turn,
    job: Arc<Job>,
    progress: Progress,
    /// Where the stage under way begins and ends in the whole.
    part: [f32; 2],
    told: f32,
}

impl Work {
    /// The engine; not to be kept beyond the body.
    pub fn engine(&self) -> Arc<Engine> {
        self.turn.engine().clone()
    }

    /// What comes next goes from one fraction of the whole to another.
    pub fn part(&mut self, from: f32, to: f32) {
        self.part = [from, to];
    }

    /// Tells the fraction of the part under way.
    pub fn tell(&mut self, stage: &'static str, fraction: f32) -> ControlFlow<()> {
        let [from, to] = self.part;
        // The end is told when it has come.
        let whole = (from + fraction.clamp(0.0, 1.0) * (to - from)).clamp(self.told, 0.999);
        self.report(stage, whole)
    }

    fn report(&mut self, stage: &'static str, whole: f32) -> ControlFlow<()> {
        self.told = if whole.is_nan() { self.told } else { whole };
        let told = self.told;
        let spans = self.turn.spent().to_vec();
        let mut state = lock(&self.job.state);
        (state.stage, state.fraction, state.spans) = (stage, told, spans);
        drop(state);
        let host = self.turn.host().clone();
        match (self.progress.callback, CString::new(stage)) {
            (Some(callback), Ok(name)) => {
                let user = self.progress.user;
                // The host may take its time, and others may have the device meanwhile.
                let answer = self.turn.without(|| {
                    host.call_back(|| {
                        // SAFETY: the host's own function and pointer; the name lives until it returns.
                        unsafe { callback(user, name.as_ptr(), told) }
                    })
                });
                if answer != 0 {
                    self.job.cancel();
                }
            }
            _ => self.turn.give_way(),
        }
        match self.job.cancelled.load(Ordering::SeqCst) || host.is_closing() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    /// Tells, and stops where the host wants that.
    pub fn step(&mut self, stage: &'static str, fraction: f32) -> Result<()> {
        match self.tell(stage, fraction) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(crate::Error::Cancelled.into()),
        }
    }

    /// A finished pass of a field.
    pub fn field(&self, field: Arc<FieldCell>, directions: u32) {
        let mut state = lock(&self.job.state);
        state.passes += 1;
        state.directions = directions;
        state.field = Some(field);
    }

    /// The field of the last pass, with what was found out since.
    pub fn last_field(&self, field: Arc<FieldCell>, directions: u32) {
        let mut state = lock(&self.job.state);
        state.passes = state.passes.max(1);
        state.directions = directions;
        state.field = Some(field);
    }

    /// A finished picture, or pass of a reference picture with its samples a pixel and its standard error.
    pub fn image(&self, image: Arc<ImageCell>, pass: Option<(u32, f64)>) {
        let mut state = lock(&self.job.state);
        state.passes += 1;
        if let Some((samples, error)) = pass {
            (state.directions, state.error) = (samples, Some([error; 3]));
        }
        state.image = Some(image);
    }

    /// What work will cost.
    pub fn estimate(&self, estimate: Estimate) {
        lock(&self.job.state).estimate = Some(estimate);
    }

    /// The measured error, and its interval.
    pub fn error(&self, error: [f64; 3]) {
        lock(&self.job.state).error = Some(error);
    }

    fn book(&mut self) {
        let spans = self.turn.spent().to_vec();
        lock(&self.job.state).spans = spans;
    }
}

impl Scope {
    fn job(&mut self, job: *const hl_job) -> Result<Arc<Job>> {
        self.inside::<Job>(job)
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_job_poll(job: *mut hl_job, state: *mut hl_job_state) -> hl_status {
    enter(|scope| {
        let job = scope.job(job)?;
        let now = lock(&job.state);
        fill("hl_job_state", state, |out| {
            out.status = match &now.outcome {
                None => HL_NOT_READY,
                Some(Ok(())) => HL_OK,
                Some(Err(fault)) => fault.status,
            };
            (out.fraction, out.passes, out.directions) = (now.fraction, now.passes, now.directions);
            copy_text(&mut out.stage, now.stage);
            out.seconds = if now.outcome.is_some() { now.seconds } else { job.begun.elapsed().as_secs_f64() };
            out.device_seconds = now.spans.iter().map(|s| s.seconds).sum();
            [out.error, out.error_low, out.error_high] = now.error.unwrap_or([-1.0; 3]);
        })
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_job_wait(job: *mut hl_job, seconds: f64) -> hl_status {
    enter(|scope| {
        let job = scope.job(job)?;
        if seconds.is_nan() {
            return Err(Fault::invalid("seconds", "is NaN", "it must be a number; negative waits as long as it takes"));
        }
        // A callback would wait for its own end; a look does no harm.
        if seconds != 0.0 {
            job.host.outside()?;
        }
        let limit = Duration::try_from_secs_f64(seconds).ok().and_then(|d| Instant::now().checked_add(d));
        let mut state = lock(&job.state);
        loop {
            match &state.outcome {
                Some(Ok(())) => return Ok(HL_OK),
                Some(Err(fault)) => return Err(fault.clone()),
                None => {}
            }
            state = match limit {
                // Too long for a clock is as long as it takes.
                None => job.ended.wait(state).unwrap_or_else(PoisonError::into_inner),
                Some(limit) => {
                    let left = limit.saturating_duration_since(Instant::now());
                    if left.is_zero() {
                        return Ok(HL_TIMEOUT);
                    }
                    job.ended.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_job_cancel(job: *mut hl_job) -> hl_status {
    enter(|scope| {
        scope.job(job)?.cancel();
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_job_timing(job: *const hl_job, index: u32, timing: *mut hl_timing) -> hl_status {
    enter(|scope| {
        let job = scope.job(job)?;
        let Some(span) = lock(&job.state).spans.get(index as usize).cloned() else { return Ok(HL_END) };
        fill("hl_timing", timing, |out| {
            copy_text(&mut out.kernel, span.kernel);
            (out.calls, out.timed, out.seconds) = (span.calls, i32::from(span.timed), span.seconds);
        })
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_job_get_field(job: *mut hl_job, field: *mut *mut hl_field) -> hl_status {
    enter(|scope| {
        let (job, out) = scope.making("field", field, |s| s.job(job))?;
        match job.field() {
            Some(field) => out.give(field),
            None => Ok(HL_NOT_READY),
        }
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_job_get_image(job: *mut hl_job, image: *mut *mut hl_image) -> hl_status {
    enter(|scope| {
        let (job, out) = scope.making("image", image, |s| s.job(job))?;
        match job.image() {
            Some(image) => out.give(image),
            None => Ok(HL_NOT_READY),
        }
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_job_get_estimate(job: *mut hl_job, estimate: *mut hl_estimate) -> hl_status {
    enter(|scope| match scope.job(job)?.estimate() {
        Some(found) => found.tell(estimate),
        None => fill("hl_estimate", estimate, |_| ()).map(|_| HL_NOT_READY),
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_job_destroy(job: *mut hl_job) -> hl_status {
    enter(|scope| {
        if let Some(job) = scope.take::<Job>(job)? {
            job.cancel();
            job.join();
        }
        Ok(HL_OK)
    })
}
