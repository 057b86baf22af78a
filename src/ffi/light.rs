//! `hl_light_*`: distant light.

use super::abi::*;
use super::call::{alone, choice, enter, finite, numbers, put, read};
use super::fault::{Fault, Result};
use super::handle::Object;
use super::host::{Host, Users, lock};
use super::image::ImageCell;
use crate::scene::scene::{LightSettings, LightSource, Windowing};
use crate::scene::{Light, Probe, Sky};
use glam::{DQuat, DVec3};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

/// What a light's handle stands for.
pub(super) struct LightCell {
    host: Arc<Host>,
    users: Users,
    state: Mutex<LightState>,
}

impl Object for LightCell {
    type Handle = hl_light;
    const NAME: &'static str = "light";

    fn host(&self) -> &Arc<Host> {
        &self.host
    }
}

impl AsRef<Users> for LightCell {
    fn as_ref(&self) -> &Users {
        &self.users
    }
}

impl LightCell {
    pub fn state(&self) -> LightState {
        lock(&self.state).clone()
    }
}

/// A light, and what the background shows of it.
#[derive(Clone)]
pub(super) struct LightState {
    /// Unturned, with all bands.
    light: Light,
    shape: Shape,
    settings: LightSettings,
}

/// The light's own radiance, unturned and unscaled.
#[derive(Clone)]
enum Shape {
    Constant([f32; 3]),
    Probe(Arc<Probe>),
    /// Too small to be seen.
    Point,
    Cone(DVec3, f64, [f64; 3]),
    Series,
}

impl LightState {
    /// The same radiance, 1, from everywhere.
    pub fn white() -> Self {
        Self::constant([1.0; 3])
    }

    fn constant(radiance: [f32; 3]) -> Self {
        Self { light: Light::constant(radiance.map(f64::from)), shape: Shape::Constant(radiance), settings: LightSettings::default() }
    }

    /// The light as it meets visibility.
    pub fn prepared(&self) -> Light {
        self.settings.prepare(&self.light)
    }

    /// What is seen of it toward a world direction.
    pub fn background(&self, dir: DVec3) -> [f32; 3] {
        let back = self.settings.rotate.map_or(dir, |(axis, degrees)| DQuat::from_axis_angle(axis, -degrees.to_radians()) * dir);
        let scaled = |rgb: [f64; 3]| rgb.map(|v| (v.max(0.0) * self.settings.scale) as f32);
        match &self.shape {
            // As the command shows them.
            Shape::Probe(probe) => self.settings.background(Some(probe), dir),
            Shape::Constant(_) => self.settings.background(None, dir),
            Shape::Point => [0.0; 3],
            Shape::Cone(toward, cosine, radiance) if back.dot(*toward) >= *cosine => scaled(*radiance),
            Shape::Cone(..) => [0.0; 3],
            Shape::Series => scaled(self.light.radiance(back)),
        }
    }

    /// The exact light, for reference pictures.
    pub fn sky(&self) -> Result<Sky> {
        match &self.shape {
            Shape::Probe(probe) => Ok(Sky::from_settings(&self.settings, Some(probe))?),
            Shape::Constant(_) => Ok(Sky::from_settings(&self.settings, None)?),
            _ => Err(Fault::invalid("hl_render_info.light", "is not a constant or a probe", "a reference picture needs one of these")),
        }
    }

    fn of(info: &hl_light_info, probe: Option<&ImageCell>) -> Result<Self> {
        alone("hl_light_info", info.next)?;
        let mut state = Self::white();
        let radiance = info.radiance.map(f64::from);
        finite("hl_light_info.radiance", &radiance)?;
        finite("hl_light_info.toward, half_angle and scale", &[&info.toward[..], &[info.half_angle, info.scale]].concat())?;
        let toward = DVec3::from(info.toward).try_normalize();
        let toward = || toward.ok_or_else(|| Fault::invalid("hl_light_info.toward", "is zero", "a direction is needed"));
        match info.kind {
            HL_LIGHT_WHITE => {}
            HL_LIGHT_CONSTANT => state = Self::constant(info.radiance),
            HL_LIGHT_DIRECTIONAL => (state.light, state.shape) = (Light::directional(toward()?, radiance), Shape::Point),
            HL_LIGHT_CONE => {
                if !(info.half_angle > 0.0 && info.half_angle <= 180.0) {
                    return Err(Fault::invalid(
                        "hl_light_info.half_angle",
                        format_args!("is {} degrees", info.half_angle),
                        "it must be above 0 and at most 180",
                    ));
                }
                let toward = toward()?;
                state.light = Light::cone(toward, info.half_angle, radiance);
                state.shape = Shape::Cone(toward, info.half_angle.to_radians().cos(), radiance);
            }
            HL_LIGHT_PROBE => {
                let Some(image) = probe else { return Err(Fault::invalid("hl_light_info.probe", "is NULL", "an image is needed")) };
                let picture = image.picture()?;
                let pixels = picture.rgba.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
                let probe = Probe::new(picture.width, picture.height, pixels)?;
                (state.light, state.shape) = (Light::from_probe(&probe), Shape::Probe(Arc::new(probe)));
            }
            HL_LIGHT_SH => {
                let values = numbers("hl_light_info.coefficients", info.coefficients.cast::<[f64; 3]>(), 16)?;
                finite("hl_light_info.coefficients", values.as_flattened())?;
                let coefficients = std::array::from_fn(|i| values[i]);
                (state.light, state.shape) = (Light { coefficients }, Shape::Series);
            }
            other => return Err(Fault::invalid("hl_light_info.kind", format_args!("is {other}"), "it must be one of HL_LIGHT_...")),
        }
        if !(0..=4).contains(&info.bands) {
            return Err(Fault::invalid("hl_light_info.bands", format_args!("is {}", info.bands), "it must be 1 to 4, or 0 for 4"));
        }
        let windows = [
            (HL_WINDOW_NONE, Windowing::None),
            (HL_WINDOW_HANNING, Windowing::Hanning),
            (HL_WINDOW_LANCZOS, Windowing::Lanczos),
            (HL_WINDOW_GAUSS, Windowing::Gauss),
        ];
        let source = match (&state.shape, info.radiance) {
            // Only whether there is a probe matters, not its file.
            (Shape::Probe(_), _) => LightSource::Probe(PathBuf::new()),
            (Shape::Constant(rgb), _) => LightSource::Constant(*rgb),
            (_, rgb) => LightSource::Constant(rgb),
        };
        state.settings = LightSettings {
            source,
            rotate: rotation(info.axis, info.degrees)?,
            scale: if info.scale == 0.0 { 1.0 } else { info.scale },
            bands: if info.bands == 0 { 4 } else { info.bands.unsigned_abs() },
            window: choice("hl_light_info.window", info.window, &windows)?,
        };
        Ok(state)
    }
}

fn rotation(axis: [f64; 3], degrees: f64) -> Result<Option<(DVec3, f64)>> {
    finite("hl_light_info.axis and degrees", &[axis[0], axis[1], axis[2], degrees])?;
    if degrees == 0.0 {
        return Ok(None);
    }
    let axis = DVec3::from(axis).try_normalize();
    axis.map(|a| Some((a, degrees))).ok_or_else(|| Fault::invalid("hl_light_info.axis", "is zero", "a direction is needed"))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_light_create(engine: *mut hl_engine, info: *const hl_light_info, light: *mut *mut hl_light) -> hl_status {
    enter(|scope| {
        let (host, out) = scope.making("light", light, |s| s.engine(engine))?;
        let state = if info.is_null() {
            LightState::white()
        } else {
            let info = read("hl_light_info", info)?;
            let probe = scope.optional::<ImageCell>(info.probe)?;
            LightState::of(&info, probe.as_deref())?
        };
        out.give(Arc::new(LightCell { host, users: Users::default(), state: Mutex::new(state) }))
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_light_set(light: *mut hl_light, info: *const hl_light_info) -> hl_status {
    enter(|scope| {
        let light = scope.get::<LightCell>(light)?;
        light.users.none(LightCell::NAME)?;
        let info = read("hl_light_info", info)?;
        let probe = scope.optional::<ImageCell>(info.probe)?;
        *lock(&light.state) = LightState::of(&info, probe.as_deref())?;
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_light_rotate(light: *mut hl_light, axis: *const f64, degrees: f64) -> hl_status {
    enter(|scope| {
        let light = scope.get::<LightCell>(light)?;
        light.users.none(LightCell::NAME)?;
        let axis = numbers("axis", axis, 3)?;
        lock(&light.state).settings.rotate = rotation([axis[0], axis[1], axis[2]], degrees)?;
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_light_get_coefficients(light: *const hl_light, coefficients: *mut f64) -> hl_status {
    enter(|scope| {
        let light = scope.get::<LightCell>(light)?;
        if coefficients.is_null() {
            return Err(Fault::invalid("coefficients", "is NULL", "room for 48 numbers is needed"));
        }
        put(coefficients.cast(), light.state().prepared().coefficients);
        Ok(HL_OK)
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_light_destroy(light: *mut hl_light) -> hl_status {
    enter(|scope| {
        scope.take::<LightCell>(light)?;
        Ok(HL_OK)
    })
}
