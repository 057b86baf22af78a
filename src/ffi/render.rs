//! `hl_render*`: from a field and a light to a picture.

use super::abi::*;
use super::abi_vulkan::hl_vulkan_image;
use super::call::{Scope, alone, choice, enter, finite, out, read, switch};
use super::fault::{Fault, Result};
use super::field::FieldCell;
use super::host::{Host, InUse};
use super::image::ImageCell;
use super::job::{Body, Job, Progress, Work};
use super::layers::{self, Layers};
use super::light::{LightCell, LightState};
use super::matter::clip;
use super::vulkan;
use crate::engine::{Engine, Lit, Medium, Reference, ReferenceSettings, surface_layers};
use crate::scene::camera::{CameraSettings, DEFAULT_FOV_DEGREES, Rays, Space};
use crate::scene::scene::{MAX_SIDE, fill_background};
use crate::scene::{Background, Camera, Clip, ImageSettings, Picture};
use glam::DVec3;
use std::sync::Arc;

/// The part of the progress before the picture itself: its cut, and its light.
pub(super) const PREPARED: f32 = 0.05;

/// A whole request. It holds what it reads.
pub(super) struct Request {
    pub host: Arc<Host>,
    field: Arc<FieldCell>,
    pub light: LightState,
    /// Cannot be changed while this lives.
    _light: Option<InUse<LightCell>>,
    pub camera: Camera,
    pub image: ImageSettings,
    clip: Clip,
    /// Bits of the layers that are wanted.
    pub layers: u32,
    pub reference: Option<ReferenceSettings>,
    /// An image of the host's device, in place of one in main memory.
    target: Option<Target>,
    pub progress: Progress,
}

impl Request {
    pub fn of(scope: &mut Scope, engine: *mut hl_engine, info: *const hl_render_info) -> Result<Self> {
        let (host, info) = (scope.engine(engine), read("hl_render_info", info));
        // Tells that the host's image is not touched, whatever is refused.
        let target = info.as_ref().map_or(Ok(None), target);
        let (host, info, target) = (host?, info?, target?);
        if info.reference > 0.0 && (info.layers != 0 || !info.clip.is_null()) {
            let right = "a reference picture has no layers and is cut as its field is: give the clip to the precompute";
            return Err(Fault::invalid("hl_render_info.layers or clip", "is set beside reference", right));
        }
        let field = scope.get::<FieldCell>(info.field)?;
        let light = scope.optional::<LightCell>(info.light)?.map(InUse::new);
        let image = image(&info)?;
        let aspect = image.width as f64 / image.height as f64;
        let camera = Camera::from_settings(&camera(info.camera)?, field.medium.grid(), aspect)?;
        Ok(Self {
            host,
            light: light.as_ref().map_or_else(LightState::white, |l| l.0.state()),
            _light: light,
            camera,
            image,
            clip: clip(info.clip)?,
            layers: wanted_layers(&info)?,
            reference: reference(&info)?,
            target,
            field,
            progress: Progress { callback: info.progress, user: info.user },
        })
    }

    fn body(self) -> Body {
        Box::new(move |work| self.work(work))
    }

    fn work(self, work: &mut Work) -> Result<()> {
        let engine = work.engine();
        work.step("relight", 0.0)?;
        let medium = &self.seen(work, &engine)?;
        if let Some(Target(target)) = &self.target {
            let lit = self.lit(work, &engine)?;
            work.part(PREPARED, 1.0);
            let mut image = vulkan::host_image(target);
            let done = engine.render_to(medium, &lit, &self.camera, &self.image, &mut image, &mut |stage, f| work.tell(stage, f));
            vulkan::tell(target.handed_back, image.handed_back());
            return Ok(done?);
        }
        let rays = self.camera.rays(self.field.medium.grid(), self.image.width, self.image.height)?;
        if let Some(settings) = &self.reference {
            work.part(PREPARED, 1.0);
            return self.traced(work, &engine, medium, &rays, settings);
        }
        let lit = self.lit(work, &engine)?;
        work.part(PREPARED, if self.layers == 0 { 1.0 } else { 0.5 });
        let mut progress = |stage, f| work.tell(stage, f);
        let (mut picture, hits) = engine.render_with_distance(medium, &lit, &self.camera, &self.image, &mut progress)?;
        let layers = match self.layers {
            0 => None,
            _ => {
                work.part(0.5, 1.0);
                Some(self.behind(work, &engine, medium, (&lit, &picture, &hits))?)
            }
        };
        self.background(&mut picture, &rays);
        work.image(ImageCell::new(self.host, picture, layers), None);
        Ok(())
    }

    /// What is looked at.
    pub fn seen(&self, work: &mut Work, engine: &Engine) -> Result<Arc<Medium>> {
        work.part(0.0, 0.5 * PREPARED);
        self.field.seen(engine, &self.clip, &mut |stage, f| work.tell(stage, f))
    }

    /// In which light.
    pub fn lit(&self, work: &mut Work, engine: &Engine) -> Result<Arc<Lit>> {
        work.part(0.5 * PREPARED, PREPARED);
        self.field.lit(engine, &self.light.prepared(), &mut |stage, f| work.tell(stage, f))
    }

    /// A reference picture, which can be had pass by pass.
    fn traced(&self, work: &mut Work, engine: &Engine, medium: &Medium, rays: &Rays, settings: &ReferenceSettings) -> Result<()> {
        let sky = self.light.sky()?;
        let work = std::cell::RefCell::new(work);
        let mut progress = |stage, f| work.borrow_mut().tell(stage, f);
        let mut finished = |pass: &Reference| {
            let mut picture = pass.picture.clone();
            self.background(&mut picture, rays);
            let image = ImageCell::new(self.host.clone(), picture, Some(Layers::Noise(pass.standard_error.clone())));
            work.borrow().image(image, Some((pass.samples, pass.relative_error)));
        };
        let made = engine.refine_reference(medium, &sky, (&self.camera, &self.image), settings, &mut progress, &mut finished)?;
        // What was finished before can still be had from the job.
        if made.cancelled { Err(crate::Error::Cancelled.into()) } else { Ok(()) }
    }

    /// What lies behind the pixels.
    fn behind(&self, work: &mut Work, engine: &Engine, medium: &Medium, (lit, picture, hits): (&Lit, &Picture, &[f32])) -> Result<Layers> {
        let mut progress = |stage, f| work.tell(stage, f);
        let mut behind = engine.aovs(medium, lit, &self.camera, &self.image, hits, &mut progress)?;
        if let Some(albedo) = medium.surface_albedo() {
            surface_layers(&mut behind, picture, albedo);
        }
        Ok(Layers::Behind(self.layers, behind))
    }

    fn background(&self, picture: &mut Picture, rays: &Rays) {
        match self.image.background {
            Background::Transparent => {}
            Background::Color(rgb) => fill_background(picture, rays, |_| rgb),
            Background::Light => fill_background(picture, rays, |dir| self.light.background(dir)),
        }
    }
}

/// An image of the host's device.
struct Target(hl_vulkan_image);

// SAFETY: the header says that the image, and where its return is told, are the engine's until the job has ended.
unsafe impl Send for Target {}

fn target(info: &hl_render_info) -> Result<Option<Target>> {
    if info.next.is_null() {
        return Ok(None);
    }
    let image = vulkan::image("hl_render_info.next", info.next)?;
    if info.background != HL_BACKGROUND_NONE || info.reference != 0.0 || info.layers != 0 {
        let right = "an image of the host's takes the picture with its coverage alone: lay it over a background there";
        return Err(Fault::invalid("hl_render_info.background, reference or layers", "is set", right));
    }
    Ok(Some(Target(image)))
}

fn wanted_layers(info: &hl_render_info) -> Result<u32> {
    const ITEM: &str = "hl_render_info.layers";
    match layers::bits(ITEM, info.layers)? {
        bits if bits & HL_LAYER_NOISE != 0 => {
            Err(Fault::invalid(ITEM, "asks for HL_LAYER_NOISE", "reference pictures have it unasked, others never: leave it out"))
        }
        bits => Ok(bits),
    }
}

fn camera(info: *const hl_camera) -> Result<CameraSettings> {
    if info.is_null() {
        return Ok(CameraSettings::default());
    }
    let info = read("hl_camera", info)?;
    alone("hl_camera", info.next)?;
    let up = if info.up == [0.0; 3] { DVec3::Z } else { DVec3::from(info.up) };
    let spaces = [(HL_CAMERA_FRAME, None), (HL_CAMERA_SIDE, Some(Space::Side)), (HL_CAMERA_WORLD, Some(Space::World))];
    let space = choice("hl_camera.space", info.space, &spaces)?;
    if !(info.distance.is_finite() && info.distance >= 0.0) {
        return Err(Fault::invalid("hl_camera.distance", format_args!("is {}", info.distance), "it must be above 0, or 0 for none"));
    }
    let [x, y, z, degrees] = info.orbit;
    let axis = DVec3::new(x, y, z).try_normalize();
    let orbit = match (info.orbit == [0.0; 4], axis) {
        (true, _) => None,
        (false, Some(axis)) if degrees.is_finite() => Some((axis, degrees)),
        _ => {
            let right = "an axis that is not 0 and degrees are needed, or all 0";
            return Err(Fault::invalid("hl_camera.orbit", format_args!("is {:?}", info.orbit), right));
        }
    };
    Ok(CameraSettings {
        position: space.map(|_| DVec3::from(info.position)),
        target: space.map(|_| DVec3::from(info.target)),
        up,
        fov_degrees: if info.fov == 0.0 { DEFAULT_FOV_DEGREES } else { info.fov },
        space: space.unwrap_or_default(),
        orbit,
        centre: switch("hl_camera.own_centre", info.own_centre)?.then(|| DVec3::from(info.centre)),
        distance: (info.distance != 0.0).then_some(info.distance),
        fit: None,
    })
}

fn image(info: &hl_render_info) -> Result<ImageSettings> {
    let default = ImageSettings::default();
    let side = |item, n: u32, default: usize| match n as usize {
        0 => Ok(default),
        n if n <= MAX_SIDE => Ok(n),
        n => Err(Fault::invalid(item, format_args!("is {n} pixels"), &format!("at most {MAX_SIDE} are rendered"))),
    };
    let background = match info.background {
        HL_BACKGROUND_NONE => Background::Transparent,
        HL_BACKGROUND_COLOR => {
            finite("hl_render_info.background_color", &info.background_color.map(f64::from))?;
            Background::Color(info.background_color)
        }
        HL_BACKGROUND_LIGHT => Background::Light,
        other => {
            return Err(Fault::invalid("hl_render_info.background", format_args!("is {other}"), "it must be one of HL_BACKGROUND_..."));
        }
    };
    Ok(ImageSettings {
        width: side("hl_render_info.width", info.width, default.width)?,
        height: side("hl_render_info.height", info.height, default.height)?,
        step: if info.step == 0.0 { default.step } else { info.step },
        background,
        skip: !switch("hl_render_info.every_block", info.every_block)?,
        ..default
    })
}

fn reference(info: &hl_render_info) -> Result<Option<ReferenceSettings>> {
    finite("hl_render_info.reference and reference_seconds", &[info.reference, info.reference_seconds])?;
    if info.reference < 0.0 || info.reference_seconds < 0.0 {
        return Err(Fault::invalid("hl_render_info.reference", "is negative, or its seconds are", "they must be 0 or above"));
    }
    let default = ReferenceSettings::default();
    Ok((info.reference > 0.0).then(|| ReferenceSettings {
        error: info.reference,
        samples: if info.reference_samples == 0 { default.samples } else { info.reference_samples },
        seconds: (info.reference_seconds > 0.0).then_some(info.reference_seconds),
        seed: info.seed,
        ..default
    }))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_render(engine: *mut hl_engine, info: *const hl_render_info, image: *mut *mut hl_image) -> hl_status {
    enter(|scope| {
        let out = if image.is_null() { None } else { Some(out("image", image)?) };
        let request = Request::of(scope, engine, info)?;
        if out.is_none() && request.target.is_none() {
            return Err(Fault::invalid("image", "is NULL", "a place for the handle is needed, or an image of the host's device"));
        }
        let (host, progress) = (request.host.clone(), request.progress);
        let job = Job::run(&host, progress, request.body())?;
        match (out, job.image()) {
            (Some(out), Some(image)) => out.give(image),
            _ => Ok(HL_OK),
        }
    })
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn hl_render_start(engine: *mut hl_engine, info: *const hl_render_info, job: *mut *mut hl_job) -> hl_status {
    enter(|scope| {
        let (request, out) = scope.making("job", job, |s| Request::of(s, engine, info))?;
        let (host, progress) = (request.host.clone(), request.progress);
        out.give(Job::start(&host, progress, request.body())?)
    })
}
