//! `hl_engine_*`, `hl_version`, `hl_last_error`.

use super::abi::*;
use super::call::{Scope, copy_text, enter, fill, out, put, read, switch, words};
use super::defect;
use super::fault::{self, Fault, Result};
use super::handle::{self, Object};
use super::host::Host;
use super::log::Log;
use super::vulkan;
use crate::engine::{DeviceInfo, DeviceKind, Engine, Options, devices};
use std::ffi::{CStr, c_char};
use std::path::PathBuf;
use std::sync::Arc;

/// What an engine's handle stands for.
pub(super) struct Owner(pub Arc<Host>);

impl Object for Owner {
    type Handle = hl_engine;
    const NAME: &'static str = "engine";

    fn host(&self) -> &Arc<Host> {
        &self.0
    }
}

impl Scope {
    /// The engine of a handle.
    pub fn engine(&mut self, engine: *const hl_engine) -> Result<Arc<Host>> {
        Ok(self.get::<Owner>(engine)?.0.clone())
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_version(major: *mut u32, minor: *mut u32, patch: *mut u32, abi: *mut u32) -> hl_status {
    put(major, HL_VERSION_MAJOR);
    put(minor, HL_VERSION_MINOR);
    put(patch, HL_VERSION_PATCH);
    put(abi, HL_ABI);
    HL_OK
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_status_name(status: hl_status, name: *mut *const c_char) -> hl_status {
    enter(|_| {
        if name.is_null() {
            return Err(Fault::invalid("name", "is NULL", "a place for a pointer is needed"));
        }
        let known = fault::name(status);
        put(name, known.map_or(std::ptr::null(), CStr::as_ptr));
        known.map(|_| HL_OK).ok_or_else(|| Fault::invalid("status", format_args!("is {status}"), "it must be one of hl_status"))
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_last_error(engine: *const hl_engine, text: *mut c_char, size: u64) -> hl_status {
    // No fault of its own is kept: that would hide the one that is asked for.
    let found = defect::caught(|| fault::last((!engine.is_null()).then(|| engine.addr())));
    let found = found.ok().flatten();
    let sentence = found.as_ref().map_or("", |f| f.text.as_str());
    if !text.is_null() && size > 0 {
        let size = usize::try_from(size).unwrap_or(usize::MAX).min(sentence.len() + 1);
        // SAFETY: the caller says that so many bytes are there.
        copy_text(unsafe { std::slice::from_raw_parts_mut(text, size) }, sentence);
    }
    found.map_or(HL_OK, |f| f.status)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_engine_create(info: *const hl_engine_info, engine: *mut *mut hl_engine) -> hl_status {
    enter(|_| {
        let out = out("engine", engine)?;
        let info = if info.is_null() { None } else { Some(read("hl_engine_info", info)?) };
        let options = info.as_ref().map_or_else(|| Ok(Options::default()), options)?;
        let log = match &info {
            Some(i) => Log::new(i.log, i.log_user, i.log_level)?,
            None => Log::default(),
        };
        let id = handle::number();
        let next = info.as_ref().map_or(std::ptr::null(), |i| i.next);
        let (made, guard) = log.during(id, || match next.is_null() {
            true => Ok((Engine::new(&options)?, None)),
            false => vulkan::open(id, next, &options),
        })?;
        let host = Arc::new(Host::new(id, made, log, guard));
        out.give_as(id, Arc::new(Owner(host)))
    })
}

fn options(info: &hl_engine_info) -> Result<Options> {
    Ok(Options {
        device: words("hl_engine_info.device", info.device)?,
        validation: switch("hl_engine_info.validate", info.validate)?,
        memory_budget: (info.memory > 0).then_some(info.memory),
        threads: (info.threads > 0).then_some(info.threads as usize),
        pipeline_cache: words("hl_engine_info.pipeline_cache", info.pipeline_cache)?.map(PathBuf::from),
        ..Options::default()
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_engine_destroy(engine: *mut hl_engine) -> hl_status {
    enter(|scope| {
        let Some(owner) = scope.end::<Owner>(engine)? else { return Ok(HL_OK) };
        let host = owner.0.clone();
        drop(owner);
        host.close();
        // What was made from it goes before the device, which the last of them would otherwise hold.
        drop(handle::take_engine(host.id));
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_engine_get_device(engine: *const hl_engine, info: *mut hl_device_info) -> hl_status {
    enter(|scope| {
        let engine = scope.engine(engine)?.engine()?;
        fill("hl_device_info", info, |out| {
            let memory = engine.memory();
            describe(engine.device(), out);
            out.validation_errors = u32::try_from(engine.validation_errors().len()).unwrap_or(u32::MAX);
            (out.memory_used, out.memory_peak, out.memory_budget) = (memory.used, memory.peak, memory.budget);
        })
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_device_get(index: u32, info: *mut hl_device_info) -> hl_status {
    enter(|_| {
        let all = devices()?;
        let Some(device) = all.get(index as usize) else { return Ok(HL_END) };
        fill("hl_device_info", info, |out| {
            describe(device, out);
            out.memory_budget = device.heap_bytes;
        })
    })
}

fn describe(device: &DeviceInfo, out: &mut hl_device_info) {
    copy_text(&mut out.name, &device.name);
    copy_text(&mut out.driver, &device.driver);
    copy_text(&mut out.uuid, &device.uuid);
    out.kind = match device.kind {
        DeviceKind::Discrete => 0,
        DeviceKind::Integrated => 1,
        DeviceKind::Virtual => 2,
        DeviceKind::Cpu => 3,
        DeviceKind::Other => 4,
    };
    (out.vulkan_major, out.vulkan_minor) = (device.api_version.0, device.api_version.1);
}
