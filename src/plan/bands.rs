//! How many bands of visibility a light asks for.

use crate::scene::{Light, Shading, Surface};
use std::f64::consts::PI;

/// Bands are dropped where the irradiance changes by no more than this share of the unshadowed mean: half of what the half
/// floats round that hold it.
pub const NEGLIGIBLE: f64 = 1.0 / 4096.0;

/// The fewest bands of the field that leave the picture under `light` unchanged.
///
/// Isotropic scattering asks for ∫ V L dω = Σ v_lm L_lm: band l counts only where the light has it. For 0 ≤ V ≤ 1 all bands
/// of V above the first together are at most ‖V − ½‖ = √π, so those dropped change the irradiance by at most √π·‖L_dropped‖,
/// which is ½·‖L_dropped‖/L₀₀ of the unshadowed √(4π)·L₀₀. Lambert's ∫ V L max(0, n·ω) dω meets bands of V that L has
/// not: under light of one band those of the clamped cosine below 4 (0, 1, 2), otherwise all.
pub fn needed(light: &Light, surface: Option<&Surface>) -> u32 {
    let energy = light.energy();
    let kept = |n: usize| {
        (0..3).all(|c| {
            let dropped: f64 = energy[n..].iter().map(|e| e[c]).sum();
            dropped.sqrt() * PI.sqrt() <= NEGLIGIBLE * (4.0 * PI * energy[0][c]).sqrt()
        })
    };
    let bands = (1..energy.len()).find(|&n| kept(n)).unwrap_or(energy.len()).min(4) as u32;
    match surface {
        Some(s) if s.shading == Shading::Lambert => {
            if bands == 1 {
                3
            } else {
                4
            }
        }
        _ => bands,
    }
}
