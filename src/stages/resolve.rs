//! resolve: the renderers' state → pixels, premultiplied RGBA. Coverage is 1 − exp(−τ) of a ray's optical depth τ; a surface's
//! stands there already.

use crate::error::Result;
use crate::kernels::resolve as kernel;
use crate::vk::{Buffer, Format, Recorder};

/// What the pixels are to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Form {
    /// Whether the state ends in optical depth rather than coverage.
    pub depth: bool,
    /// Half floats instead of single ones.
    pub half: bool,
}

impl Form {
    /// The formats of pictures, and of each whether it takes half floats.
    pub const FORMATS: [(Format, bool); 2] = [(Format::Rgba32Sfloat, false), (Format::Rgba16Sfloat, true)];

    /// Bytes of a pixel.
    pub fn bytes(self) -> u64 {
        if self.half { 8 } else { 16 }
    }
}

/// Records `count` pixels from `state` (vec4 each) to `pixels`.
///
/// # Errors
/// What the recorder refuses.
pub fn record(rec: &mut Recorder, form: Form, state: &Buffer, pixels: &Buffer, count: u32) -> Result<()> {
    rec.dispatch(
        &kernel::Bindings { state, pixels },
        &kernel::Spec { depth: form.depth.into(), half: form.half.into() },
        &kernel::Params { count },
        [count, 1, 1],
    )
}

/// The twin: a pixel's four numbers. Halves are given as the floats that they stand for.
pub fn reference(form: Form, state: [f32; 4]) -> [f32; 4] {
    let [r, g, b, last] = state;
    let a = if form.depth { (-(-f64::from(last)).exp_m1()) as f32 } else { last };
    let round = |x: f32| if form.half { half::f16::from_f32(x).to_f32() } else { x };
    [r, g, b, a].map(round)
}
