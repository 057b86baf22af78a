//! `hl_transfer_*` and `hl_surface`, `hl_clip`: what fills a volume.

use super::abi::*;
use super::call::{alone, choice, enter, finite, numbers, read, switch, words};
use super::fault::{Fault, Result};
use super::handle::Object;
use super::host::{Host, Users, lock};
use super::volume::VolumeCell;
use crate::io;
use crate::io::transfer::{Preset, read_preset};
use crate::scene::camera::Space;
use crate::scene::clip::{Clip, MAX_PLANES};
use crate::scene::scene::ramp;
use crate::scene::transfer::{Kind, Reference};
use crate::scene::{Matter, Shading, Surface, Transfer};
use std::ffi::c_char;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Points that are taken seriously.
const MAX_POINTS: u32 = 1 << 20;

const REFERENCES: [(i32, Reference); 3] =
    [(HL_PER_VOXEL, Reference::Voxel), (HL_PER_WORLD, Reference::World), (HL_PER_SIDE, Reference::Side)];

/// What a transfer function's handle stands for.
pub(super) struct TransferCell {
    host: Arc<Host>,
    users: Users,
    state: Mutex<State>,
}

/// The function, or a ramp over whatever range the data have.
#[derive(Clone)]
enum State {
    Points(Transfer),
    Ramp(Reference),
    /// A preset's ends may lie on the data's range.
    File(Arc<Preset>, PathBuf, Option<[f64; 2]>, Reference),
}

impl Object for TransferCell {
    type Handle = hl_transfer;
    const NAME: &'static str = "transfer function";

    fn host(&self) -> &Arc<Host> {
        &self.host
    }
}

impl AsRef<Users> for TransferCell {
    fn as_ref(&self) -> &Users {
        &self.users
    }
}

impl TransferCell {
    fn new(host: &Arc<Host>, state: State) -> Arc<Self> {
        Arc::new(Self { host: host.clone(), users: Users::default(), state: Mutex::new(state) })
    }
}

impl State {
    fn of(info: *const hl_transfer_info) -> Result<Self> {
        if info.is_null() {
            return Ok(Self::Ramp(Reference::Voxel));
        }
        let info = read("hl_transfer_info", info)?;
        alone("hl_transfer_info", info.next)?;
        let reference = choice("hl_transfer_info.reference", info.reference, &REFERENCES)?;
        let kind = choice("hl_transfer_info.kind", info.kind, &[(HL_OPACITY, Kind::Opacity), (HL_EXTINCTION, Kind::Extinction)])?;
        if info.points.is_null() && info.count == 0 {
            return Ok(Self::Ramp(reference));
        }
        if info.count == 0 || info.count > MAX_POINTS {
            return Err(Fault::invalid("hl_transfer_info.count", format_args!("is {}", info.count), "1 to 1048576 points are taken"));
        }
        let points = numbers("hl_transfer_info.points", info.points.cast::<[f64; 5]>(), info.count as usize)?;
        Ok(Self::Points(Transfer::from_points(&points, kind, reference)?))
    }

    fn of_file(path: &Path, info: *const hl_transfer_file_info) -> Result<Self> {
        let mut range = None;
        let (mut name, mut reference) = (None, Reference::Voxel);
        if !info.is_null() {
            let info = read("hl_transfer_file_info", info)?;
            alone("hl_transfer_file_info", info.next)?;
            reference = choice("hl_transfer_file_info.reference", info.reference, &REFERENCES)?;
            name = words("hl_transfer_file_info.name", info.name)?;
            let [low, high] = info.range;
            if info.range != [0.0; 2] {
                finite("hl_transfer_file_info.range", &info.range)?;
                if low > high {
                    return Err(Fault::invalid("hl_transfer_file_info.range", format_args!("is {low} to {high}"), "it must ascend"));
                }
                range = Some(info.range);
            }
        }
        Ok(Self::File(Arc::new(read_preset(path, name.as_deref())?), path.to_owned(), range, reference))
    }
}

/// The matter that a precompute asks for.
pub(super) fn matter(transfer: Option<&TransferCell>, surface: *const hl_surface, range: [f32; 2]) -> Result<Matter> {
    let state = transfer.map_or(State::Ramp(Reference::Voxel), |t| lock(&t.state).clone());
    let transfer = match state {
        State::Points(transfer) => transfer,
        State::Ramp(reference) => ramp(range, reference)?,
        State::File(preset, path, laid, reference) => preset.transfer(&path, laid, range.map(f64::from), reference)?,
    };
    let surface = if surface.is_null() { None } else { Some(surface_of(&read("hl_surface", surface)?)?) };
    Ok(Matter { transfer, surface })
}

/// What `info` keeps of a volume; all for NULL.
pub(super) fn clip(info: *const hl_clip) -> Result<Clip> {
    if info.is_null() {
        return Ok(Clip::default());
    }
    let info = read("hl_clip", info)?;
    alone("hl_clip", info.next)?;
    if info.plane_count as usize > MAX_PLANES {
        return Err(Fault::invalid("hl_clip.plane_count", format_args!("is {}", info.plane_count), "at most 10 planes are cut by"));
    }
    let planes = match info.plane_count {
        0 => Vec::new(),
        n => numbers("hl_clip.planes", info.planes.cast::<[f64; 4]>(), n as usize)?,
    };
    let boxed = info.low != [0.0; 3] || info.high != [0.0; 3];
    let space = choice("hl_clip.space", info.space, &[(HL_CLIP_SIDE, Space::Side), (HL_CLIP_WORLD, Space::World)])?;
    let clip = Clip { bounds: boxed.then_some([info.low, info.high]), planes, space };
    clip.check()?;
    Ok(clip)
}

fn surface_of(info: &hl_surface) -> Result<Surface> {
    alone("hl_surface", info.next)?;
    let shading = choice("hl_surface.shading", info.shading, &[(HL_LAMBERT, Shading::Lambert), (HL_ISOTROPIC, Shading::Isotropic)])?;
    let own = switch("hl_surface.own_albedo", info.own_albedo)?;
    if own && !info.albedo.iter().all(|a| (0.0..=1.0).contains(a)) {
        return Err(Fault::invalid("hl_surface.albedo", format_args!("is {:?}", info.albedo), "it must lie in 0..1"));
    }
    Ok(Surface { iso: info.iso, shading, albedo: own.then_some(info.albedo) })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_transfer_create(
    engine: *mut hl_engine,
    info: *const hl_transfer_info,
    transfer: *mut *mut hl_transfer,
) -> hl_status {
    enter(|scope| {
        let (host, out) = scope.making("transfer", transfer, |s| s.engine(engine))?;
        out.give(TransferCell::new(&host, State::of(info)?))
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_transfer_load(
    engine: *mut hl_engine,
    path: *const c_char,
    info: *const hl_transfer_file_info,
    transfer: *mut *mut hl_transfer,
) -> hl_status {
    enter(|scope| {
        let (host, out) = scope.making("transfer", transfer, |s| s.engine(engine))?;
        let path = super::call::path(path)?;
        let state = host.log.during(host.id, || State::of_file(&path, info))?;
        out.give(TransferCell::new(&host, state))
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_transfer_guess(volume: *const hl_volume, transfer: *mut *mut hl_transfer) -> hl_status {
    enter(|scope| {
        let (volume, out) = scope.making("transfer", transfer, |s| s.get::<VolumeCell>(volume))?;
        let points = io::guess_transfer(&volume.described()?);
        let state = State::Points(Transfer::from_points(&points, Kind::Opacity, Reference::Voxel)?);
        out.give(TransferCell::new(volume.host(), state))
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_transfer_set(transfer: *mut hl_transfer, info: *const hl_transfer_info) -> hl_status {
    enter(|scope| {
        let transfer = scope.get::<TransferCell>(transfer)?;
        transfer.users.none(TransferCell::NAME)?;
        *lock(&transfer.state) = State::of(info)?;
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_transfer_destroy(transfer: *mut hl_transfer) -> hl_status {
    enter(|scope| {
        scope.take::<TransferCell>(transfer)?;
        Ok(HL_OK)
    })
}
