//! Natural light for scalar volumes: spherical-harmonic visibility, precomputed and rendered in Vulkan compute.
//!
//! The straight line, one stage after the other:
//!
//! | noun | made by | after |
//! |---|---|---|
//! | [`Volume`](scene::Volume) → device | [`Engine::upload`] | |
//! | [`Medium`](engine::Medium): extinction and albedo | [`Engine::classify`] | |
//! | opacity pyramid | inside `precompute` (`stages::classify`, `stages::minify`) | Ritschel 2007, 3.1 |
//! | [`Field`](engine::Field): visibility, 16 SH coefficients a cell | [`Engine::precompute`] (`stages::{march, hierarchical, sweep, fit, pack}`) | Ritschel 2007, Eq. 1 |
//! | [`Lit`](engine::Lit): irradiance volume | [`Engine::relight`] (`stages::relight`) | Ritschel 2007, 3.2 |
//! | [`Picture`](scene::Picture) | [`Engine::render`] (`stages::{raymarch, isosurface}`) | |
//!
//! A light can be turned, scaled or replaced without computing visibility again: only `relight` and `render` follow it.
//!
//! One worked frame, of the volume that `halflight demo` shows:
//!
//! ```
//! use halflight::engine::{Engine, Options};
//! use halflight::scene::{ImageSettings, Light, Probe, Visibility};
//! use std::ops::ControlFlow;
//!
//! # fn main() -> halflight::Result<()> {
//! let engine = Engine::new(&Options::default())?;
//! let volume = halflight::demo::volume(32)?;
//! let camera = halflight::demo::camera(volume.grid());
//! let mut quiet = |_stage: &'static str, _done: f32| ControlFlow::Continue(());
//!
//! let on_device = engine.upload(&volume)?;
//! let medium = engine.classify(&on_device, &halflight::demo::dvr()?)?;
//! let settings = Visibility { directions: 64, ..Visibility::default() };
//! let field = engine.precompute(&medium, &settings, &mut quiet)?;
//! let lit = engine.relight(&field, &Light::from_probe(&Probe::two_colored()))?;
//! let image = ImageSettings { width: 64, height: 48, ..ImageSettings::default() };
//! let picture = engine.render(&medium, &lit, &camera, &image, &mut quiet)?;
//!
//! assert!(picture.rgba.iter().any(|pixel| pixel[3] > 0.5));
//! # Ok(())
//! # }
//! ```
//!
//! Conventions: `voxel` coordinates run 0..n with the centre of voxel i at i + ½; `world` coordinates are the data's own
//! units ([`scene::Grid`]). Spherical harmonics are real and orthonormal, index l(l+1)+m, signs as in Sloan 2008
//! ([`scene::sh`]). A probe's top row is world +z; its column u = 0 looks along +y and u = ¼ along +x
//! ([`scene::Probe`]). Radiance is linear RGB; pictures are premultiplied.
#![deny(unsafe_code, clippy::unwrap_used)]
#![warn(missing_docs)]

mod aside;
#[cfg(feature = "chart")]
pub mod chart;
pub mod demo;
pub mod engine;
pub mod error;
#[cfg(feature = "capi")]
pub mod ffi;
pub mod io;
pub mod kernels;
pub mod measure;
pub mod plan;
pub mod record;
mod room;
pub mod scene;
pub mod stability;
pub mod stages;
pub mod vk;

pub use engine::Engine;
pub use error::{Error, Result};
