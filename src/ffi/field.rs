//! `hl_field_*`: visibility, with the medium that it belongs to.

use super::abi::*;
use super::call::{enter, fill, put};
use super::fault::{Fault, Result};
use super::handle::Object;
use super::host::{Host, lock};
use super::volume::VolumeCell;
use crate::engine::{Engine, Field, Lit, Medium, Pass, Progress};
use crate::scene::visibility::{Method, Wanted};
use crate::scene::{Clip, Light, Visibility};
use std::sync::{Arc, Mutex, Weak};

/// What a field's handle stands for. It never changes: nobody has to wait for its readers.
pub(super) struct FieldCell {
    host: Arc<Host>,
    pub medium: Arc<Medium>,
    pub field: Field,
    /// Directions it has seen.
    directions: u32,
    /// What it was asked for with.
    pub asked: Asked,
    pub error: Option<[f64; 3]>,
    /// The last light that it was put under.
    lit: Mutex<Option<(Light, Arc<Lit>)>>,
    /// The last cut that it was looked at through.
    cut: Mutex<Option<(Clip, Arc<Medium>)>>,
    mapped: Mutex<(u32, Option<Arc<Vec<f32>>>)>,
}

/// What makes one field the same as another, beside the medium.
#[derive(Clone)]
pub(super) struct Asked {
    pub volume: Weak<VolumeCell>,
    pub clip: Clip,
    pub settings: Visibility,
    pub wanted: Option<Wanted>,
    /// Whether ratio and bits were left to a plan.
    pub free: [bool; 2],
}

impl Object for FieldCell {
    type Handle = hl_field;
    const NAME: &'static str = "field";

    fn host(&self) -> &Arc<Host> {
        &self.host
    }
}

impl FieldCell {
    pub fn new(host: &Arc<Host>, medium: &Arc<Medium>, field: Field, asked: &Asked, error: Option<[f64; 3]>) -> Arc<Self> {
        let directions = field.settings().directions;
        Self::after(host, medium, field, directions, asked, error)
    }

    /// A pass before the last: it has seen so many directions, and is not what was asked for.
    pub fn pass(host: &Arc<Host>, medium: &Arc<Medium>, pass: &Pass, asked: &Asked) -> Arc<Self> {
        let asked = Asked { volume: Weak::new(), ..asked.clone() };
        Self::after(host, medium, pass.field.clone(), pass.directions, &asked, None)
    }

    fn after(host: &Arc<Host>, medium: &Arc<Medium>, field: Field, directions: u32, asked: &Asked, error: Option<[f64; 3]>) -> Arc<Self> {
        Arc::new(Self {
            host: host.clone(),
            medium: medium.clone(),
            field,
            directions,
            asked: asked.clone(),
            error,
            lit: Mutex::default(),
            cut: Mutex::default(),
            mapped: Mutex::default(),
        })
    }

    /// The settings that it was made with.
    pub fn settings(&self) -> Visibility {
        Visibility { directions: self.directions, ..self.field.settings().clone() }
    }

    /// This field in another medium, if that is as opaque everywhere: only colours differ.
    pub fn recoloured(&self, medium: &Arc<Medium>, asked: &Asked) -> Option<Arc<Self>> {
        let (old, new) = (self.medium.table(), medium.table());
        let same = self.asked.volume.ptr_eq(&asked.volume)
            && asked.volume.strong_count() > 0
            && self.asked.clip == asked.clip
            && self.asked.settings == asked.settings
            && self.asked.wanted == asked.wanted
            && self.asked.free == asked.free
            && (old.lo, old.hi) == (new.lo, new.hi)
            && old.sigma == new.sigma
            && self.medium.has_surface() == medium.has_surface();
        same.then(|| {
            let cell = Self::new(&self.host, medium, self.field.clone(), asked, self.error);
            lock(&cell.lit).clone_from(&lock(&self.lit));
            cell
        })
    }

    /// The field under a light; computed where it was last under another.
    pub fn lit(&self, engine: &Engine, light: &Light, progress: &mut Progress) -> Result<Arc<Lit>> {
        if let Some(lit) = last(&self.lit, light) {
            return Ok(lit);
        }
        let lit = Arc::new(engine.relight_watched(&self.field, light, progress)?);
        *lock(&self.lit) = Some((*light, lit.clone()));
        Ok(lit)
    }

    /// The medium that is looked at through a cut; classified anew where the last one was another.
    pub fn seen(&self, engine: &Engine, clip: &Clip, progress: &mut Progress) -> Result<Arc<Medium>> {
        if *clip == Clip::default() {
            return Ok(self.medium.clone());
        }
        if let Some(medium) = last(&self.cut, clip) {
            return Ok(medium);
        }
        let medium = Arc::new(engine.cut(&self.medium, clip, progress)?);
        *lock(&self.cut) = Some((clip.clone(), medium.clone()));
        Ok(medium)
    }

    /// Its coefficients.
    pub fn read(&self) -> Result<Vec<f32>> {
        let turn = self.host.turn()?;
        Ok(turn.engine().read_field(&self.field)?)
    }

    fn count(&self) -> u64 {
        self.field.dims().iter().map(|&n| n as u64).product::<u64>() * self.field.settings().coefficients() as u64
    }
}

/// What was last made for a key, if it is this; otherwise it goes before another is made, for both need not fit. Nothing is locked
/// meanwhile: between two dispatches others have the device, and may want the same.
fn last<K: PartialEq, T>(kept: &Mutex<Option<(K, Arc<T>)>>, key: &K) -> Option<Arc<T>> {
    let mut kept = lock(kept);
    if kept.as_ref().is_some_and(|(last, _)| last != key) {
        *kept = None;
    }
    kept.as_ref().map(|(_, made)| made.clone())
}

/// The number of a method.
fn method(method: Method) -> i32 {
    match method {
        Method::March => HL_METHOD_MARCH,
        Method::Hierarchical => HL_METHOD_HIERARCHICAL,
        Method::Sweep => HL_METHOD_SWEEP,
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_field_destroy(field: *mut hl_field) -> hl_status {
    enter(|scope| {
        scope.take::<FieldCell>(field)?;
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_field_get_info(field: *const hl_field, info: *mut hl_field_info) -> hl_status {
    enter(|scope| {
        let cell = scope.get::<FieldCell>(field)?;
        fill("hl_field_info", info, |out| {
            let s = cell.settings();
            out.dims = cell.field.dims().map(|n| n as u32);
            out.coefficients = s.coefficients() as i32;
            (out.method, out.ratio, out.bits) = (method(s.method), s.ratio.cast_signed(), s.bits.cast_signed());
            (out.near_slices, out.directions, out.step) = (s.near.cast_signed(), s.directions, s.step);
            out.bytes = cell.field.bytes();
            [out.error, out.error_low, out.error_high] = cell.error.unwrap_or([-1.0; 3]);
        })
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_field_read(field: *const hl_field, data: *mut f32, count: u64) -> hl_status {
    enter(|scope| {
        let cell = scope.get::<FieldCell>(field)?;
        if data.is_null() || count != cell.count() {
            let what = if data.is_null() { "data is NULL".into() } else { format!("count is {count}") };
            return Err(Fault::invalid("field", what, &format!("room for {} numbers is needed", cell.count())));
        }
        let numbers = cell.read()?;
        // SAFETY: the caller says that `count` numbers fit, and there are as many; bytes need no alignment.
        unsafe { std::ptr::copy_nonoverlapping(numbers.as_ptr().cast::<u8>(), data.cast::<u8>(), 4 * numbers.len()) };
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_field_map(field: *mut hl_field, data: *mut *const f32, count: *mut u64) -> hl_status {
    enter(|scope| {
        let cell = scope.get::<FieldCell>(field)?;
        if data.is_null() {
            return Err(Fault::invalid("data", "is NULL", "a place for the pointer is needed"));
        }
        let mut mapped = lock(&cell.mapped);
        let numbers = match &mapped.1 {
            Some(numbers) => numbers.clone(),
            None => Arc::new(cell.read()?),
        };
        put(data, numbers.as_ptr());
        put(count, numbers.len() as u64);
        *mapped = (mapped.0.saturating_add(1), Some(numbers));
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_field_unmap(field: *mut hl_field) -> hl_status {
    enter(|scope| {
        let cell = scope.get::<FieldCell>(field)?;
        let mut mapped = lock(&cell.mapped);
        match mapped.0 {
            0 => return Err(Fault::invalid("field", "is not mapped", "unmap once for each map")),
            1 => *mapped = (0, None),
            _ => mapped.0 -= 1,
        }
        Ok(HL_OK)
    })
}
