//! A first guess of a transfer function from a histogram: something to look at, and to change.

use super::info::VolumeInfo;

/// Points of a guess, each [scalar, linear red, green, blue, opacity per voxel], as `transfer.points` takes them.
///
/// What there is most of is taken for what surrounds the object, and left transparent up to the valley beside its peak.
/// The rest is parted in soft and hard at Otsu's threshold (IEEE Trans. SMC 9, 1979, over √counts, so that little but
/// dense matter counts). Soft matter takes an optical depth of 1 from a quarter of the longest side, hard matter from a
/// fiftieth.
pub fn guess_transfer(info: &VolumeInfo) -> Vec<[f64; 5]> {
    let [lo, hi] = info.range.map(f64::from);
    let bins = info.histogram.len();
    let longest = info.dims.iter().copied().max().unwrap_or(1) as f64;
    let opacity = |share: f64| 1.0 - (-1.0 / (share * longest).max(1.0)).exp();
    let (soft, dense) = (opacity(0.25), opacity(0.02));
    if hi <= lo || bins < 4 {
        return vec![[lo, 0.8, 0.8, 0.8, short(soft)]];
    }
    let ground = ground(&info.histogram);
    let weights: Vec<f64> = info.histogram.iter().map(|&n| (n as f64).sqrt()).collect();
    let hard = otsu(&weights, ground).clamp(ground + 1, bins - 1);
    let at = |bin: f64| lo + (hi - lo) * bin / bins as f64;
    let half = 0.5 * (hard - ground) as f64;
    const SOFT: [f64; 3] = [0.80, 0.45, 0.28];
    const HARD: [f64; 3] = [0.90, 0.86, 0.78];
    let point = |scalar: f64, [r, g, b]: [f64; 3], opacity: f64| [near(scalar, [lo, hi]), r, g, b, short(opacity)];
    vec![
        point(at(ground as f64), SOFT, 0.0),
        point(at(ground as f64 + half.min(2.0)), SOFT, 0.5 * soft),
        point(at(hard as f64 - half.min(1.0)), SOFT, soft),
        point(at(hard as f64 + 0.5 * half.min(2.0)), HARD, 0.5 * dense),
        point(hi, HARD, dense),
    ]
}

/// To a thousandth of the range at least, within it: a large value may stand for a narrow range.
fn near(v: f64, [lo, hi]: [f64; 2]) -> f64 {
    let digits = 3 - (hi - lo).log10().floor() as i32;
    // Either power is exact enough where it is whole.
    let rounded = if digits >= 0 {
        (v * 10f64.powi(digits)).round() / 10f64.powi(digits)
    } else {
        (v / 10f64.powi(-digits)).round() * 10f64.powi(-digits)
    };
    rounded.clamp(lo, hi)
}

/// Four significant digits.
fn short(v: f64) -> f64 {
    let scale = 10f64.powi(3 - v.abs().max(1e-9).log10().floor() as i32);
    (v * scale).round() / scale
}

/// The first bin that is not what surrounds the object: behind the highest peak of the lower half, where counts have
/// fallen to a hundredth of it or rise again.
fn ground(histogram: &[u64]) -> usize {
    let half = histogram.len() / 2;
    let peak = (0..half).rev().max_by_key(|&i| histogram[i]).unwrap_or(0);
    let mut i = peak + 1;
    while i < half && histogram[i] * 100 > histogram[peak] && histogram[i] <= histogram[i - 1] {
        i += 1;
    }
    i
}

/// The threshold from `first` on that parts the weights into the two classes that differ most.
fn otsu(weights: &[f64], first: usize) -> usize {
    let moment = |range: std::ops::Range<usize>| range.fold((0.0, 0.0), |(w, m), i| (w + weights[i], m + weights[i] * i as f64));
    let between = |t: usize| {
        let ((wa, ma), (wb, mb)) = (moment(first..t), moment(t..weights.len()));
        if wa > 0.0 && wb > 0.0 { wa * wb * (ma / wa - mb / wb).powi(2) } else { 0.0 }
    };
    (first + 1..weights.len()).max_by(|&a, &b| between(a).total_cmp(&between(b)).then(b.cmp(&a))).unwrap_or(first + 1)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::scene::scene::{Matter, TransferSource};

    fn info(histogram: Vec<u64>, range: [f32; 2]) -> VolumeInfo {
        VolumeInfo {
            dims: [100, 50, 50],
            sample_type: "uint8",
            bytes: 0,
            spacing: [1.0; 3],
            directions: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            corner: [0.0; 3],
            first_centre: [0.5; 3],
            slope: 1.0,
            intercept: 0.0,
            not_finite: 0,
            range,
            mean: 0.0,
            histogram,
        }
    }

    #[test]
    fn ground_soft_and_hard_are_told_apart() {
        // Air in bins 0 to 3, soft matter around 20, hard matter around 50.
        let mut histogram = vec![5u64; 64];
        histogram[..4].copy_from_slice(&[100_000, 50_000, 9_000, 900]);
        (16..25).for_each(|i| histogram[i] = 3_000);
        (48..53).for_each(|i| histogram[i] = 2_000);
        let points = guess_transfer(&info(histogram, [-1000.0, 2200.0]));
        let bin = |p: [f64; 5]| (p[0] + 1000.0) / 50.0;
        assert!((1.0..8.0).contains(&bin(points[0])) && points[0][4] == 0.0, "{points:?}");
        assert!((25.0..48.0).contains(&bin(points[2])), "{points:?}");
        assert!(points[4][0] == 2200.0 && points[4][4] > 3.0 * points[2][4]);
        assert!(points.windows(2).all(|w| w[0][0] <= w[1][0] && w[0][4] <= w[1][4]));
    }

    #[test]
    fn a_narrow_range_of_large_values_keeps_its_points_apart() {
        for range in [[101_300.0, 101_350.0], [1026.0, 1028.0], [-5.0, -4.9375], [0.0, 3e9]] {
            let histogram = (0..64).map(|i| if i < 4 { 100_000 >> (4 * i) } else { 1000 }).collect();
            let points = guess_transfer(&info(histogram, range));
            let [lo, hi] = range.map(f64::from);
            assert!(points.windows(2).all(|w| w[0][0] < w[1][0]), "{points:?}");
            assert!(points.iter().all(|p| (lo..=hi).contains(&p[0])) && points[4][0] == hi, "{points:?}");
        }
    }

    #[test]
    fn every_guess_is_a_transfer_function() {
        let odd = [vec![0; 64], vec![7; 64], (0..64).map(|i| i * i).collect(), (0..64).rev().collect(), vec![u64::MAX / 200; 64]];
        for (i, histogram) in odd.into_iter().enumerate() {
            for range in [[0.0, 1e-30], [5.0, 5.0], [-3e38, 3e38], [0.0, 255.0]] {
                let points = guess_transfer(&info(histogram.clone(), range));
                let text = format!("volume.file = 'a'\ntransfer.points = {points:?}");
                let scene = crate::io::parse_scene(&text, "t", std::path::Path::new(""), &[]);
                let Ok(TransferSource::Points(transfer)) = scene.map(|s| s.transfer) else { panic!("{i} {range:?}: {points:?}") };
                assert!(
                    !Matter { transfer, surface: None }.is_vacuum(range) || range[1] < 1e-20 || range[1] > 1e38,
                    "{i} {range:?} {points:?}"
                );
            }
        }
    }
}
