//! Which settings are tried, in which order, and what each is predicted to cost.

use crate::scene::visibility::{Filter, Method, Sampling};
use crate::scene::{Grid, Visibility};

/// All four minification filters of `hierarchical`.
const FILTERS: [Filter; 4] = [Filter::Axis, Filter::Product, Filter::Extinction, Filter::Box];

/// Every estimator's settings at `ratio`, unpacked, the telling ones first: where time runs out, the end is left out.
pub fn of_estimators(ratio: u32) -> Vec<Visibility> {
    let base = Visibility { ratio, bits: 32, ..Visibility::default() };
    let march = |step: f32, directions, sampling| Visibility { method: Method::March, step, directions, sampling, ..base.clone() };
    let pyramid = |filter, growth: f32, directions, sampling| Visibility {
        method: Method::Hierarchical,
        filter,
        growth,
        directions,
        sampling,
        ..base.clone()
    };
    let sweep = |near, directions, step: f32| Visibility { method: Method::Sweep, near, directions, step, ..base.clone() };
    use Sampling::{Jittered, Stratified};
    let mut list: Vec<Visibility> = Vec::new();
    // One line through each estimator's range, with the paper's own choice; the first four are measured in any case.
    list.extend([sweep(2, 128, 2.0), pyramid(Filter::Axis, 0.25, 64, Stratified), march(1.0, 64, Stratified), sweep(2, 64, 2.0)]);
    list.extend([256, 32].map(|n| sweep(2, n, 2.0)));
    list.push(pyramid(Filter::Axis, 0.25, 400, Stratified));
    list.push(sweep(4, 128, 1.0));
    list.push(sweep(2, 512, 2.0));
    list.extend(FILTERS.map(|f| pyramid(f, 0.25, 64, Stratified)));
    // Fewer bands store fewer sums.
    list.extend(telling(ratio).iter().flat_map(|v| [3, 2, 1].map(|bands| Visibility { bands, ..v.clone() })));
    list.push(march(1.0, 400, Stratified));
    list.extend([(1, 64), (1, 128), (4, 128), (4, 512)].map(|(near, n)| sweep(near, n, 1.0)));
    list.push(pyramid(Filter::Axis, 0.25, 400, Jittered));
    list.extend([0.5, 1.0].map(|g| pyramid(Filter::Axis, g, 400, Stratified)));
    list.push(march(1.0, 400, Jittered));
    list.extend([2.0, 4.0].map(|s| march(s, 400, Stratified)));
    list.push(march(0.5, 1024, Stratified));
    // The rest of each estimator's product.
    for near in [1, 2, 4] {
        for step in [1.0, 2.0] {
            list.extend([32, 64, 128, 256, 512].map(|n| sweep(near, n, step)));
        }
    }
    for n in [400, 64] {
        for growth in [0.25, 0.5, 1.0] {
            list.extend(FILTERS.map(|f| pyramid(f, growth, n, Stratified)));
        }
    }
    for n in [400, 128, 64] {
        for step in [1.0, 2.0, 4.0, 0.5] {
            list.extend([Stratified, Jittered].map(|s| march(step, n, s)));
        }
    }
    unique(list)
}

/// One setting of each estimator, which is measured with every number of bands.
pub fn telling(ratio: u32) -> [Visibility; 3] {
    let base = Visibility { ratio, bits: 32, ..Visibility::default() };
    [
        Visibility { method: Method::Sweep, near: 2, directions: 128, step: 2.0, ..base.clone() },
        Visibility { method: Method::Hierarchical, directions: 64, ..base.clone() },
        Visibility { method: Method::March, directions: 64, step: 1.0, ..base },
    ]
}

/// A few settings that are repeated at other ratios.
pub fn of_ratio(ratio: u32) -> Vec<Visibility> {
    let all = of_estimators(ratio);
    let told = |v: &&Visibility| match v.method {
        Method::Sweep => v.near == 2 && v.step == 2.0 && v.bands == 4 && [64, 128, 256].contains(&v.directions),
        Method::Hierarchical => v.filter == Filter::Axis && v.growth == 0.25 && v.sampling == Sampling::Stratified && v.bands == 4,
        Method::March => v.step == 1.0 && v.sampling == Sampling::Stratified && v.directions == 400 && v.bands == 4,
    };
    all.iter().filter(told).cloned().collect()
}

fn unique(list: Vec<Visibility>) -> Vec<Visibility> {
    let mut out: Vec<Visibility> = Vec::new();
    for v in list {
        if !out.contains(&v) {
            out.push(v);
        }
    }
    out
}

/// Taps per cell and direction, roughly; only its ratio between settings of one method counts.
pub fn taps(v: &Visibility, grid: &Grid) -> f64 {
    let side = grid.dims().into_iter().max().unwrap_or(1) as f64;
    // A ray leaves after half the longest side, on average.
    let (way, growth) = (0.5 * side, f64::from(v.growth));
    match v.method {
        Method::March => way / f64::from(v.step) + 1.0,
        // What is seen from points comes on top: about as much per cell that is wanted for every two points.
        Method::Sweep => (f64::from(v.near * v.ratio) * 1.3 / f64::from(v.step) + 8.0) * (1.0 + 0.5 * f64::from(v.fit)),
        Method::Hierarchical => way.min(1.0 / growth) + (way * growth).max(1.0).ln() / growth + 1.0,
    }
}

/// "sweep, N 128, near 2, step 2": what is particular to a setting, for legends and tables.
pub fn name(v: &Visibility) -> String {
    let jittered = if v.sampling == Sampling::Jittered { ", jittered" } else { "" };
    let bands = if v.bands == 4 { String::new() } else { format!(", {}", counted_bands(v.bands)) };
    let n = v.directions;
    match v.method {
        Method::March => format!("march, N {n}, step {}{jittered}{bands}", v.step),
        Method::Hierarchical => format!("hierarchical, N {n}, {}, growth {}{jittered}{bands}", filter(v.filter), v.growth),
        Method::Sweep => format!("sweep, N {n}, near {}, step {}{}{bands}", v.near, v.step, fitted(v)),
    }
}

/// What stands beside a mark: the name without its estimator, for colour and shape tell that.
pub fn short(v: &Visibility) -> String {
    let jittered = if v.sampling == Sampling::Jittered { " jittered" } else { "" };
    let n = v.directions;
    match v.method {
        _ if v.bands < 4 => format!("N {n} {}", counted_bands(v.bands)),
        Method::March => format!("N {n} step {}{jittered}", v.step),
        Method::Hierarchical => format!("N {n} growth {}{jittered}", v.growth),
        Method::Sweep if v.fit > 0 => format!("N {n} fitted"),
        Method::Sweep => format!("N {n} near {} step {}", v.near, v.step),
    }
}

/// ", fitted to 8 points a cell", if it is.
fn fitted(v: &Visibility) -> String {
    if v.fit > 0 { format!(", fitted to {} points a cell", v.fit) } else { String::new() }
}

/// "1 band", "3 bands".
pub fn counted_bands(n: u32) -> String {
    if n == 1 { "1 band".into() } else { format!("{n} bands") }
}

/// The filter's name in a scene.
pub fn filter(f: Filter) -> &'static str {
    match f {
        Filter::Box => "box",
        Filter::Product => "product",
        Filter::Axis => "axis",
        Filter::Extinction => "extinction",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_are_valid_different_and_named_differently() {
        for ratio in [1, 2, 4, 8] {
            let all = of_estimators(ratio);
            assert!(all.len() > 60 && all.iter().all(|v| v.check().is_ok() && v.ratio == ratio));
            let mut names: Vec<String> = all.iter().map(name).collect();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), all.len());
            assert!(of_ratio(ratio).len() >= 5 && of_ratio(ratio).iter().all(|v| v.bands == 4));
            assert!(telling(ratio).iter().all(|v| all.contains(v)));
        }
    }

    #[test]
    fn more_work_is_predicted_to_cost_more() {
        let grid = Grid::axis_aligned([64; 3], [1.0; 3]);
        let Ok(grid) = grid else { return };
        let at = |v: &Visibility| taps(v, &grid);
        let base = Visibility { method: Method::Hierarchical, ..Visibility::default() };
        for method in [Method::March, Method::Sweep] {
            let v = Visibility { method, ..base.clone() };
            assert!(at(&Visibility { step: 0.5, ..v.clone() }) > at(&v));
        }
        assert!(at(&Visibility { growth: 1.0, ..base.clone() }) < at(&base));
    }
}
