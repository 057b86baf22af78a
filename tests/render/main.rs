//! Relighting, direct volume rendering and isosurfaces: formulas, twins, sabotage.

#[path = "../common/mod.rs"]
mod common;
mod media;
mod pictures;
mod spacing;
mod surfaces;

use common::*;
use halflight::scene::grid::glam::DVec3;
use halflight::scene::scene::Background;
use halflight::scene::visibility::{Cells, Method};
use halflight::scene::{Camera, Grid, ImageSettings, Light, Picture, Shading, Surface, Visibility, Volume};
use halflight::stages::raymarch::{self, View};
use halflight::stages::{isosurface, relight, twin};

fn image(width: usize, height: usize, step: f64) -> ImageSettings {
    ImageSettings { width, height, step, ..ImageSettings::default() }
}

fn march(ratio: u32) -> Visibility {
    Visibility { method: Method::March, ratio, directions: 128, bits: 32, step: 0.5, ..Visibility::default() }
}

/// A light with energy in every coefficient and channel.
fn coloured() -> Light {
    Light::constant([0.3, 0.4, 0.5]).plus(&Light::cone(DVec3::new(0.3, -0.5, 0.8), 40.0, [6.0, 1.0, 0.5])).plus(&Light::cone(
        DVec3::new(-0.8, 0.4, -0.1),
        25.0,
        [0.2, 2.0, 9.0],
    ))
}

/// A ball of radius r about the centre: D falls linearly with distance, so that iso 0 is the sphere.
fn ball(n: usize, r: f64) -> Volume {
    let c = n as f64 / 2.0;
    Volume::from_fn(Grid::axis_aligned([n; 3], [1.0; 3]).expect("grid"), |p| {
        (r - ((p[0] - c).powi(2) + (p[1] - c).powi(2) + (p[2] - c).powi(2)).sqrt()) as f32
    })
    .expect("volume")
}
