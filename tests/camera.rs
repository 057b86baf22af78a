//! The camera against plain geometry.

use glam::{DAffine3, DMat3, DVec3};
use halflight::Error;
use halflight::scene::camera::{CameraSettings, DEFAULT_DIRECTION, Space};
use halflight::scene::{Camera, Grid};

/// An oblique, mirrored, anisotropic grid away from the origin.
fn oblique() -> Grid {
    let m = DMat3::from_cols(DVec3::new(-0.9, 0.1, 0.0), DVec3::new(0.2, 0.7, -0.1), DVec3::new(0.0, 0.3, 2.1));
    Grid::new([40, 30, 20], DAffine3 { matrix3: m, translation: DVec3::new(100.0, -50.0, 7.0) }).unwrap()
}

fn camera() -> Camera {
    Camera {
        position: DVec3::new(150.0, -120.0, 60.0),
        target: DVec3::new(90.0, -40.0, 20.0),
        up: DVec3::new(0.1, 0.2, 1.0),
        fov_degrees: 37.0,
    }
}

/// World direction of a voxel-space one.
fn world(grid: &Grid, d: [f64; 3]) -> DVec3 {
    grid.voxel_to_world().transform_vector3(DVec3::from(d)).normalize()
}

/// Distance of `point` from the ray through pixel (i, j), world units.
fn miss(grid: &Grid, camera: &Camera, i: f64, j: f64, size: (usize, usize), point: DVec3) -> f64 {
    let rays = camera.rays(grid, size.0, size.1).unwrap();
    let origin = grid.voxel_to_world().transform_point3(DVec3::from(rays.origin_voxel));
    let d = world(grid, rays.direction_voxel(i, j));
    (point - origin).cross(d).length()
}

#[test]
fn the_middle_of_the_picture_looks_at_the_target() {
    let (grid, camera) = (oblique(), camera());
    // Odd sizes have a middle pixel; even ones a middle corner, half a pixel on.
    assert!(miss(&grid, &camera, 7.0, 3.0, (15, 7), camera.target) < 1e-9);
    assert!(miss(&grid, &camera, 7.5, 3.5, (16, 8), camera.target) < 1e-9);
    // Sabotage: the neighbouring pixel and another camera must miss.
    assert!(miss(&grid, &camera, 8.0, 3.0, (15, 7), camera.target) > 1e-3);
    let moved = Camera { target: camera.target + DVec3::X * 1e-3, ..camera };
    assert!(miss(&grid, &moved, 7.0, 3.0, (15, 7), camera.target) > 1e-5);
}

#[test]
fn the_vertical_field_of_view_spans_lower_to_upper_edge() {
    let (grid, camera) = (oblique(), camera());
    for (w, h) in [(640, 480), (31, 77)] {
        let rays = camera.rays(&grid, w, h).unwrap();
        let middle = 0.5 * w as f64 - 0.5;
        let top = world(&grid, rays.direction_voxel(middle, -0.5));
        let bottom = world(&grid, rays.direction_voxel(middle, h as f64 - 0.5));
        let angle = top.angle_between(bottom).to_degrees();
        assert!((angle - camera.fov_degrees).abs() < 1e-9, "{angle}");
        // Row 0 is the top.
        assert!(top.dot(camera.up) > bottom.dot(camera.up));
    }
}

#[test]
fn pixels_are_square_and_columns_run_to_the_right() {
    let (grid, camera) = (oblique(), camera());
    let rays = camera.rays(&grid, 50, 20).unwrap();
    let m = grid.voxel_to_world().matrix3;
    let (du, dv) = (m * DVec3::from(rays.du), m * DVec3::from(rays.dv));
    assert!((du.length() - dv.length()).abs() < 1e-12 && du.dot(dv).abs() < 1e-12);
    let forward = (camera.target - camera.position).normalize();
    assert!((du.normalize() - forward.cross(camera.up).normalize()).length() < 1e-9);
    // The component along the axis has world length 1: ray parameters are depths.
    for (i, j) in [(0.0, 0.0), (49.0, 3.0), (17.0, 19.0)] {
        assert!(((m * DVec3::from(rays.direction_voxel(i, j))).dot(forward) - 1.0).abs() < 1e-9);
    }
}

#[test]
fn world_and_voxel_directions_are_the_same_rays() {
    let (grid, camera) = (oblique(), camera());
    let rays = camera.rays(&grid, 12, 9).unwrap();
    for (i, j) in [(0.0, 0.0), (11.0, 8.0), (4.0, 6.0)] {
        assert!((rays.direction_world(i, j) - world(&grid, rays.direction_voxel(i, j))).length() < 1e-12);
    }
    assert!((rays.direction_world(0.0, 0.0) - world(&grid, rays.direction_voxel(1.0, 0.0))).length() > 1e-3);
}

#[test]
fn framing_holds_the_whole_box_and_wastes_little() {
    let grid = oblique();
    let camera = Camera::framing(&grid);
    assert!((camera.target - grid.centre_world()).length() < 1e-9);
    assert!((camera.position - camera.target).normalize().dot(DEFAULT_DIRECTION.normalize()) > 1.0 - 1e-12);
    // Formula: the bounding sphere touches the upper edge's plane.
    let distance = (camera.position - camera.target).length();
    assert!((distance * 15f64.to_radians().sin() - 0.5 * grid.diagonal()).abs() < 1e-9);
    let portrait = Camera::from_settings(&CameraSettings::default(), &grid, 0.5).unwrap();
    for (camera, w, h) in [(camera, 64, 48), (portrait, 20, 40)] {
        let [right, up, forward] = camera.basis().unwrap();
        let half = 15f64.to_radians().tan();
        for corner in 0..8 {
            let n = grid.dims();
            let at = |a: usize| if corner >> a & 1 == 1 { n[a] as f64 } else { 0.0 };
            let p = grid.voxel_to_world().transform_point3(DVec3::new(at(0), at(1), at(2))) - camera.position;
            let z = p.dot(forward);
            assert!((p.dot(up) / z).abs() <= half + 1e-12);
            assert!((p.dot(right) / z).abs() <= half * w as f64 / h as f64 + 1e-12);
        }
    }
}

#[test]
fn settings_count_in_longest_sides_or_in_the_world() {
    let grid = oblique();
    let (c, s) = (grid.centre_world(), grid.longest_side());
    let p = DVec3::new(1.0, -2.0, 0.5);
    let settings = CameraSettings { position: Some(p), ..CameraSettings::default() };
    let camera = Camera::from_settings(&settings, &grid, 1.0).unwrap();
    assert!((camera.position - (c + p * s)).length() < 1e-9 && (camera.target - c).length() < 1e-9);
    let settings = CameraSettings { space: Space::World, target: Some(DVec3::ONE), ..settings };
    let camera = Camera::from_settings(&settings, &grid, 1.0).unwrap();
    assert_eq!((camera.position, camera.target), (p, DVec3::ONE));
}

#[test]
fn cameras_that_see_nothing_are_refused() {
    let grid = oblique();
    let good = camera();
    let sentence = |c: Camera| c.rays(&grid, 4, 4).unwrap_err().to_string();
    let cases = [
        (Camera { target: good.position, ..good }, "camera.position: [150, -120, 60] is the target itself; place it away from the target"),
        (Camera { up: good.target - good.position, ..good }, "is parallel to the view"),
        (Camera { up: DVec3::ZERO, ..good }, "camera.up: [0, 0, 0] is parallel"),
        (Camera { fov_degrees: 0.5, ..good }, "camera.fov: is 0.5 degrees; it must lie in 1..170"),
        (Camera { fov_degrees: 171.0, ..good }, "camera.fov"),
        (Camera { fov_degrees: f64::NAN, ..good }, "camera.fov"),
        (Camera { position: DVec3::new(f64::INFINITY, 0.0, 0.0), ..good }, "camera.position: is [inf, 0, 0]"),
        (Camera { target: DVec3::NAN, ..good }, "camera.target"),
    ];
    for (camera, part) in cases {
        assert!(sentence(camera).contains(part), "{}", sentence(camera));
    }
    // Settings are refused in their own numbers, not in those of the world.
    let refused = |settings: CameraSettings| Camera::from_settings(&settings, &grid, 1.0).unwrap_err().to_string();
    let centre = CameraSettings { position: Some(DVec3::ZERO), ..CameraSettings::default() };
    assert!(refused(centre).starts_with("camera.position: [0, 0, 0] is the target itself;"), "{}", refused(centre));
    let side = DVec3::new(0.25, -0.00001, 3.0);
    let there = CameraSettings { position: Some(side), target: Some(side), ..CameraSettings::default() };
    assert!(refused(there).starts_with("camera.position: [0.25, -0.00001, 3] is"), "{}", refused(there));
    assert!(matches!(good.rays(&grid, 0, 4), Err(Error::Invalid { .. })));
}
