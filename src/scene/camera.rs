//! The pinhole camera: where it stands in the world, and the ray of each pixel in voxel space.

use super::grid::Grid;
use crate::error::{Error, Result};
use glam::{DQuat, DVec3};

/// Direction from the volume's centre to a camera that nobody placed.
pub const DEFAULT_DIRECTION: DVec3 = DVec3::new(1.6, -1.9, 1.1);

/// Vertical field of view of a camera that nobody set, degrees.
pub const DEFAULT_FOV_DEGREES: f64 = 30.0;

/// A pinhole camera in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The pinhole, world.
    pub position: DVec3,
    /// The point that the picture's centre shows, world.
    pub target: DVec3,
    /// The direction that is up in the picture, world; its length is of no matter.
    pub up: DVec3,
    /// Vertical field of view, degrees: the angle from the lower to the upper edge of the picture.
    pub fov_degrees: f64,
}

/// What the numbers of [`CameraSettings`] mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Space {
    /// Longest sides of the volume's box, from its centre, along the world's axes.
    #[default]
    Side,
    /// World coordinates.
    World,
}

/// A camera as a scene writes it, before the volume is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraSettings {
    /// The pinhole, in `space`; without one the camera looks from [`DEFAULT_DIRECTION`], as far off as shows the whole box.
    pub position: Option<DVec3>,
    /// The point looked at, in `space`; without one the centre of the volume's box.
    pub target: Option<DVec3>,
    /// Up, a direction of the world.
    pub up: DVec3,
    /// Vertical field of view, degrees.
    pub fov_degrees: f64,
    /// What the numbers mean.
    pub space: Space,
    /// Axis (world, length 1) and degrees by which position, target and up are turned about `centre`.
    pub orbit: Option<(DVec3, f64)>,
    /// The orbit's centre, in `space`; without one the target.
    pub centre: Option<DVec3>,
    /// How far the camera stands from its target, in `space`; without one as far as its position says.
    pub distance: Option<f64>,
    /// What shows the whole box where there is neither position nor distance; without one the camera itself.
    pub fit: Option<Framing>,
}

/// A view that the whole box fits into: an animation's camera stands where this one would, while its own view changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Framing {
    /// The point looked at, as [`CameraSettings::target`].
    pub target: Option<DVec3>,
    /// Vertical field of view, degrees.
    pub fov_degrees: f64,
}

impl Default for CameraSettings {
    fn default() -> Self {
        Self {
            position: None,
            target: None,
            up: DVec3::Z,
            fov_degrees: DEFAULT_FOV_DEGREES,
            space: Space::Side,
            orbit: None,
            centre: None,
            distance: None,
            fit: None,
        }
    }
}

impl CameraSettings {
    /// The same camera with a position in place of a `fit`, for a volume on `grid` and a picture of width/height `aspect`:
    /// what a scene's text can hold.
    pub fn placed(&self, grid: &Grid, aspect: f64) -> Self {
        let mut out = Self { fit: None, ..*self };
        if let (Some(fit), None, None) = (self.fit, self.position, self.distance) {
            let (centre, side) = (grid.centre_world(), grid.longest_side());
            let offset = framing_offset(grid, fit.fov_degrees, aspect);
            out.position = Some(match self.space {
                Space::Side => fit.target.unwrap_or_default() + offset / side,
                Space::World => fit.target.unwrap_or(centre) + offset,
            });
        }
        out
    }
}

/// The rays of a picture. Pixel (i, j) counts from the top left; its centre is seen along
/// `corner` + i·`du` + j·`dv` from `origin_voxel`, all in voxel coordinates. The directions are not normalised: their
/// component along the camera's axis has world length 1, so a ray parameter t is a depth in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rays {
    /// The pinhole, voxel coordinates.
    pub origin_voxel: [f64; 3],
    /// Direction through the centre of pixel (0, 0), the top left, voxel space.
    pub corner: [f64; 3],
    /// Change of direction from one pixel to its right neighbour, voxel space.
    pub du: [f64; 3],
    /// Change of direction from one pixel to the one below, voxel space.
    pub dv: [f64; 3],
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    world: [DVec3; 3],
}

impl Camera {
    /// A camera that sees the whole volume: from [`DEFAULT_DIRECTION`] at the centre, +z up, so far that the box's
    /// bounding sphere fits a picture that is at least as wide as high.
    pub fn framing(grid: &Grid) -> Self {
        let target = grid.centre_world();
        let fov_degrees = DEFAULT_FOV_DEGREES;
        Self { position: target + framing_offset(grid, fov_degrees, 1.0), target, up: DVec3::Z, fov_degrees }
    }

    /// The camera that `settings` mean for a volume on `grid` and a picture of width/height `aspect`.
    ///
    /// # Errors
    /// As [`Camera::check`].
    pub fn from_settings(settings: &CameraSettings, grid: &Grid, aspect: f64) -> Result<Self> {
        check_fov(settings.fov_degrees)?;
        let settings = &settings.placed(grid, aspect);
        let centre = grid.centre_world();
        let to_world = |p: DVec3| match settings.space {
            Space::Side => centre + p * grid.longest_side(),
            Space::World => p,
        };
        let target = settings.target.map_or(centre, to_world);
        let mut position = settings.position.map_or_else(|| target + framing_offset(grid, settings.fov_degrees, aspect), to_world);
        if let Some(distance) = settings.distance {
            let unit = if settings.space == Space::Side { grid.longest_side() } else { 1.0 };
            position = target + (position - target).normalize_or_zero() * distance * unit;
        }
        let mut camera = Self { position, target, up: settings.up, fov_degrees: settings.fov_degrees };
        if let Some((axis, degrees)) = settings.orbit {
            let turn = DQuat::from_axis_angle(axis, degrees.to_radians());
            let centre = settings.centre.map_or(target, to_world);
            camera.position = centre + turn * (position - centre);
            camera.target = centre + turn * (target - centre);
            camera.up = turn * settings.up;
        }
        // What is wrong is said in the numbers that the settings hold.
        camera.check().map_err(|e| match (e, settings.position) {
            (Error::Invalid { item: item @ "camera.position", right, .. }, Some(p)) if position.is_finite() && target.is_finite() => {
                Error::Invalid { item, what: format!("{} is the target itself", exact(p)), right }
            }
            (other, _) => other,
        })?;
        Ok(camera)
    }

    /// Whether the camera can take a picture.
    ///
    /// # Errors
    /// [`Error::Invalid`] when a number is not finite, when position and target coincide, when `up` is zero or parallel to
    /// the view, and when the field of view lies outside 1..170 degrees.
    pub fn check(&self) -> Result<()> {
        self.basis().map(|_| ())
    }

    /// Right, up and forward, world, orthonormal.
    ///
    /// # Errors
    /// As [`Camera::check`].
    pub fn basis(&self) -> Result<[DVec3; 3]> {
        let bad = |item, what: String, right: &str| Err(Error::Invalid { item, what, right: right.into() });
        check_fov(self.fov_degrees)?;
        for (item, v) in [("camera.position", self.position), ("camera.target", self.target), ("camera.up", self.up)] {
            if !v.is_finite() {
                return bad(item, format!("is {}", list(v)), "its three numbers must be finite");
            }
        }
        // Compared with the size of the coordinates themselves, below whose rounding no direction is left.
        let view = self.target - self.position;
        if view.length() <= 1e-12 * self.position.length().max(self.target.length()) {
            return bad("camera.position", format!("{} is the target itself", list(self.position)), "place it away from the target");
        }
        let forward = view.normalize();
        let across = forward.cross(self.up.normalize_or_zero());
        if across.length() <= 1e-6 {
            let right = "choose one at an angle to the view, such as [0, 1, 0] for a view along z";
            return bad("camera.up", format!("{} is parallel to the view {}", exact(self.up), list(forward)), right);
        }
        let right = across.normalize();
        Ok([right, right.cross(forward), forward])
    }

    /// The rays of a picture of `width` x `height` square pixels of a volume on `grid`. With f, r, u the camera's forward,
    /// right and up and h = tan(fov/2), pixel (i, j) looks along
    /// f + h·(width/height)·(2(i+½)/width − 1)·r + h·(1 − 2(j+½)/height)·u.
    ///
    /// # Errors
    /// As [`Camera::check`], and for a picture without pixels.
    pub fn rays(&self, grid: &Grid, width: usize, height: usize) -> Result<Rays> {
        if width == 0 || height == 0 {
            return Err(Error::Invalid {
                item: "image.width and image.height",
                what: format!("{width}x{height} pixels"),
                right: "each must be at least 1".into(),
            });
        }
        let [right, up, forward] = self.basis()?;
        let half = (0.5 * self.fov_degrees.to_radians()).tan();
        // Square pixels: one step is as long to the right as it is downwards.
        let step = 2.0 * half / height as f64;
        let du = right * step;
        let dv = up * -step;
        let corner = forward - 0.5 * (width as f64 - 1.0) * du - 0.5 * (height as f64 - 1.0) * dv;
        let to_voxel = grid.world_to_voxel();
        let direction = |d: DVec3| to_voxel.transform_vector3(d).to_array();
        Ok(Rays {
            origin_voxel: to_voxel.transform_point3(self.position).to_array(),
            corner: direction(corner),
            du: direction(du),
            dv: direction(dv),
            width,
            height,
            world: [corner, du, dv],
        })
    }
}

impl Rays {
    /// Direction through the centre of pixel (i, j) (fractions are allowed), voxel space, not normalised.
    pub fn direction_voxel(&self, i: f64, j: f64) -> [f64; 3] {
        std::array::from_fn(|a| self.corner[a] + i * self.du[a] + j * self.dv[a])
    }

    /// Direction through the centre of pixel (i, j), world, of length 1: what the background shows there.
    pub fn direction_world(&self, i: f64, j: f64) -> DVec3 {
        let [corner, du, dv] = self.world;
        (corner + i * du + j * dv).normalize()
    }
}

/// From the target to a camera that sees the box's bounding sphere, in height and in width.
fn framing_offset(grid: &Grid, fov_degrees: f64, aspect: f64) -> DVec3 {
    let half_height = (0.5 * fov_degrees.to_radians()).tan();
    let half_angle = (half_height * aspect.min(1.0)).atan();
    DEFAULT_DIRECTION.normalize() * (0.5 * grid.diagonal() / half_angle.sin())
}

fn check_fov(degrees: f64) -> Result<()> {
    if (1.0..=170.0).contains(&degrees) {
        return Ok(());
    }
    Err(Error::Invalid { item: "camera.fov", what: format!("is {degrees} degrees"), right: "it must lie in 1..170".into() })
}

/// "[1, 2, 0.00001]", as it is.
fn exact(v: DVec3) -> String {
    format!("[{}, {}, {}]", v.x, v.y, v.z)
}

/// "[1, 2, 3]" in a few digits.
fn list(v: DVec3) -> String {
    let n = |x: f64| format!("{}", (x * 1e4).round() / 1e4);
    format!("[{}, {}, {}]", n(v.x), n(v.y), n(v.z))
}
