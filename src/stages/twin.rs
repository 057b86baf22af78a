//! What the CPU twins share: sampling of volumes and tables in plain loops, in single precision as the kernels.

use crate::scene::transfer::{TABLE_SIZE, Table};
use crate::scene::{Grid, Volume};
use crate::vk::Filtering;
use std::cell::Cell;

/// Voxel (x, y, z) with coordinates clamped to the volume.
pub fn fetch(volume: &Volume, p: [i64; 3]) -> f32 {
    let d = volume.grid().dims();
    let c = |a: usize| p[a].clamp(0, d[a] as i64 - 1) as usize;
    volume.value(c(0) + d[0] * (c(1) + d[1] * c(2)))
}

thread_local! {
    static FILTERING: Cell<Option<Filtering>> = const { Cell::new(None) };
}

/// Runs twins on this thread with textures read as a device does that rounds weights of interpolation ([`Device::filtering`]), by
/// the arithmetic of the one such device that was looked at ([`Filtering::weights`]): what they then differ by is not its textures.
///
/// [`Device::filtering`]: crate::vk::Device::filtering
pub fn filtered<T>(filtering: Option<Filtering>, twin: impl FnOnce() -> T) -> T {
    // However it ends.
    struct Back(Option<Filtering>);
    impl Drop for Back {
        fn drop(&mut self) {
            FILTERING.set(self.0);
        }
    }
    let _back = Back(FILTERING.replace(filtering));
    twin()
}

/// [`trilinear`] in a texture; see [`filtered`].
pub fn texture(dims: [usize; 3], p: [f32; 3], get: impl Fn([usize; 3]) -> f32) -> f32 {
    match FILTERING.get() {
        None => trilinear(dims, p, get),
        // Places beyond the outermost centres count as these.
        Some(filtering) => {
            let p = std::array::from_fn(|a| p[a].clamp(0.5, dims[a] as f32 - 0.5));
            trilinear_of(dims, p, |f| filtering.weights(f), get)
        }
    }
}

/// Trilinear value at voxel coordinates `p`, clamped to the edge; `get` returns a texel by (clamped) index.
pub fn trilinear(dims: [usize; 3], p: [f32; 3], get: impl Fn([usize; 3]) -> f32) -> f32 {
    let product = |f: [f32; 3]| std::array::from_fn(|i| (0..3).map(|a| if i >> a & 1 == 1 { f[a] } else { 1.0 - f[a] }).product());
    trilinear_of(dims, p, product, get)
}

/// `weights` of the eight texels around, x least, by the place between them.
fn trilinear_of(dims: [usize; 3], p: [f32; 3], weights: impl Fn([f32; 3]) -> [f32; 8], get: impl Fn([usize; 3]) -> f32) -> f32 {
    let mut lo = [0usize; 3];
    let mut hi = [0usize; 3];
    let mut f = [0f32; 3];
    for a in 0..3 {
        let q = p[a] - 0.5;
        let base = q.floor();
        f[a] = q - base;
        lo[a] = (base as i64).clamp(0, dims[a] as i64 - 1) as usize;
        hi[a] = (base as i64 + 1).clamp(0, dims[a] as i64 - 1) as usize;
    }
    let mut sum = 0.0;
    for (i, w) in weights(f).into_iter().enumerate() {
        if w != 0.0 {
            sum += w * get(std::array::from_fn(|a| if i >> a & 1 == 1 { hi[a] } else { lo[a] }));
        }
    }
    sum
}

/// The cells around a place, counted in cells from the first's centre and clamped to the outermost, by linear index, and their
/// trilinear weights, of which none is 0.
pub fn corners(dims: [usize; 3], q: [f32; 3]) -> Vec<(usize, f32)> {
    let q: [f32; 3] = std::array::from_fn(|a| q[a].clamp(0.0, (dims[a] - 1) as f32));
    let weight = |i: usize, a: usize| if i >> a & 1 == 1 { q[a].fract() } else { 1.0 - q[a].fract() };
    let place = |i: usize, a: usize| (q[a] as usize + (i >> a & 1)).min(dims[a] - 1);
    (0..8)
        .map(|i| (place(i, 0) + dims[0] * (place(i, 1) + dims[1] * place(i, 2)), weight(i, 0) * weight(i, 1) * weight(i, 2)))
        .filter(|(_, w)| *w > 0.0)
        .collect()
}

/// Trilinear value of a volume at voxel coordinates.
pub fn sample(volume: &Volume, p: [f32; 3]) -> f32 {
    let d = volume.grid().dims();
    texture(d, p, |q| volume.value(q[0] + d[0] * (q[1] + d[1] * q[2])))
}

/// Table entry below a value, and the weight of the next.
pub fn table_position(table: &Table, value: f32) -> (usize, f32) {
    let last = (TABLE_SIZE - 1) as f32;
    let u = if table.hi > table.lo { ((value - table.lo) / (table.hi - table.lo) * last).clamp(0.0, last) } else { 0.0 };
    let i = (u as usize).min(TABLE_SIZE - 2);
    (i, u - i as f32)
}

/// σ_t [1/world unit] of a value, linear between table entries.
pub fn extinction(table: &Table, value: f32) -> f32 {
    let (i, f) = table_position(table, value);
    table.sigma[i] + (table.sigma[i + 1] - table.sigma[i]) * f
}

/// Albedo of a value.
pub fn albedo(table: &Table, value: f32) -> [f32; 3] {
    let (i, f) = table_position(table, value);
    std::array::from_fn(|c| table.albedo[i][c] + (table.albedo[i + 1][c] - table.albedo[i][c]) * f)
}

/// p + t·d.
pub fn along(p: [f32; 3], d: [f32; 3], t: f32) -> [f32; 3] {
    std::array::from_fn(|a| p[a] + t * d[a])
}

/// World distance from p (inside) along d (voxel space, world length 1) to where the ray leaves the box 0..dims.
pub fn exit_distance(p: [f32; 3], d: [f32; 3], dims: [usize; 3]) -> f32 {
    let mut t = f32::INFINITY;
    for a in 0..3 {
        let wall = if d[a] > 0.0 { dims[a] as f32 } else { 0.0 };
        t = t.min((wall - p[a]) / d[a]);
    }
    t.max(0.0)
}

/// Where a ray from outside enters and leaves the box 0..dims (world distance); first > second when it misses.
pub fn box_span(p: [f32; 3], d: [f32; 3], dims: [usize; 3]) -> (f32, f32) {
    let (mut enter, mut leave) = (f32::NEG_INFINITY, f32::INFINITY);
    for a in 0..3 {
        let (t0, t1) = ((0.0 - p[a]) / d[a], (dims[a] as f32 - p[a]) / d[a]);
        enter = enter.max(t0.min(t1));
        leave = leave.min(t0.max(t1));
    }
    (enter, leave)
}

/// The part of a ray's interval that clip planes keep (n·p + d ≥ 0); first > second where there is none.
pub fn clip_span(planes: &[[f32; 4]], p: [f32; 3], d: [f32; 3], (mut begin, mut end): (f32, f32)) -> (f32, f32) {
    for n in planes {
        let at = n[0] * p[0] + n[1] * p[1] + n[2] * p[2] + n[3];
        let slope = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
        if slope > 0.0 {
            begin = begin.max(-at / slope);
        } else if slope < 0.0 {
            end = end.min(-at / slope);
        } else if at < 0.0 {
            end = begin - 1.0;
        }
    }
    (begin, end)
}

/// Centre of field cell `cell` (linear index) in voxel coordinates.
pub fn cell_centre(grid: &Grid, field_dims: [usize; 3], cell: u32) -> [f32; 3] {
    let c = cell as usize;
    let at = [c % field_dims[0], c / field_dims[0] % field_dims[1], c / field_dims[0] / field_dims[1]];
    let n = grid.dims();
    std::array::from_fn(|a| (at[a] as f32 + 0.5) * (n[a] as f32 / field_dims[a] as f32))
}
