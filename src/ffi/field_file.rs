//! `hl_field_save`, `hl_field_load`: fields in files, as the command writes them.

use super::abi::*;
use super::call::enter;
use super::fault::{Fault, Result};
use super::field::{Asked, FieldCell};
use super::handle::Object;
use super::precompute::Request;
use crate::io::{self, FieldKeys, ReadOptions};
use crate::scene::{Scene, Visibility};
use std::ffi::c_char;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Weak;

/// What a field file says of its settings: a scene, as the command writes it.
fn meta(settings: &Visibility) -> Vec<(String, String)> {
    let scene = Scene { visibility: settings.clone(), ..Scene::of_volume("volume".into()) };
    vec![("scene".into(), io::scene_text(&scene))]
}

/// The settings that a field file tells, or what its shape lets guess.
fn told(path: &Path, file: &io::NrrdField, dims: [usize; 3]) -> Result<Visibility> {
    let bands = file.coefficients.isqrt() as u32;
    let scene = file.meta.iter().find(|(key, _)| key == "scene").map(|(_, text)| text);
    let settings = match scene {
        Some(text) => io::parse_scene(text, &crate::error::shown(path), Path::new(""), &[])?.visibility,
        None => {
            let fits = |ratio: &u32| dims.map(|n| n.div_ceil(*ratio as usize)) == file.grid.dims();
            let ratio = [1, 2, 4, 8].into_iter().find(fits).unwrap_or(1);
            Visibility { ratio, bands, bits: 32, ..Visibility::default() }
        }
    };
    if settings.bands != bands || dims.map(|n| n.div_ceil(settings.ratio as usize)) != file.grid.dims() {
        let ([x, y, z], [a, b, c]) = (file.grid.dims(), dims);
        let what = format!("{} coefficients of {x}x{y}x{z} cells do not belong to {a}x{b}x{c} voxels", file.coefficients);
        return Err(Fault::new(
            HL_ERROR_FORMAT,
            format!("{}: {what}; load it with the volume that it was computed for", crate::error::shown(path)),
        ));
    }
    Ok(settings)
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_field_save(field: *const hl_field, path: *const c_char) -> hl_status {
    enter(|scope| {
        let cell = scope.get::<FieldCell>(field)?;
        let path = super::call::path(path)?;
        match super::call::extension(&path).as_str() {
            "nrrd" => {}
            other => return Err(Fault::invalid("path", format_args!("ends in {other:?}"), "a field is an .nrrd")),
        }
        let turn = cell.host().turn()?;
        let (engine, medium) = (turn.engine(), &cell.medium);
        let (data, volume) = (engine.read_field(&cell.field)?, engine.read_volume(medium.volume())?);
        drop(turn);
        let mut meta = meta(&cell.settings());
        meta.extend(FieldKeys::of(&volume, medium.matter(), medium.clip()).meta(&data));
        io::write_nrrd_field(&path, cell.field.dims(), cell.field.settings().coefficients(), &data, cell.medium.grid(), &meta)?;
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_field_load(
    engine: *mut hl_engine,
    path: *const c_char,
    info: *const hl_precompute_info,
    field: *mut *mut hl_field,
) -> hl_status {
    enter(|scope| {
        let (request, out) = scope.making("field", field, |s| Request::of(s, engine, info))?;
        let path = super::call::path(path)?;
        let grid = *request.volume.device.grid();
        let file = request.host.log.during(request.host.id, || io::read_nrrd_field(&path, &ReadOptions::default()))?;
        let settings = told(&path, &file, grid.dims())?;
        let turn = request.host.turn()?;
        let medium = request.medium(turn.engine(), &mut |_, _| ControlFlow::Continue(()))?;
        // Older files, and those of other programs, are taken on trust.
        if let Some(why) = FieldKeys::of(&*request.volume.volume(turn.engine())?, medium.matter(), medium.clip()).differ(&file) {
            let right = "load it with what it was computed for, or compute it anew";
            return Err(Fault::new(HL_ERROR_FORMAT, format!("{}: {why}; {right}", crate::error::shown(&path))));
        }
        let loaded = turn.engine().load_field(&grid, &settings, &file.data)?;
        // Not what a precompute was asked for, so that none takes it for its own.
        let asked = Asked { volume: Weak::new(), ..request.asked.clone() };
        out.give(FieldCell::new(&request.host, &medium, loaded, &asked, None))
    })
}
