//! The Pareto front: what nothing else beats in both time and error.

/// From and to: what a measured value may be.
pub type Range = [f64; 2];

/// Whether each point, a range of cost and one of error, is on the front.
///
/// Ranges that overlap are a tie. One point beats another where it is better in cost, in error or in both, and worse in
/// neither. A point on the front is beaten by none on it; each of the others is beaten by one on it, not merely by another
/// of the others, for ties in a row may lead far. Points that are not finite are never on it.
pub fn front(points: &[[Range; 2]]) -> Vec<bool> {
    let better = |a: Range, b: Range| a[1] < b[0];
    let beats = |a: &[Range; 2], b: &[Range; 2]| (0..2).any(|k| better(a[k], b[k])) && !(0..2).any(|k| better(b[k], a[k]));
    let mut front = vec![false; points.len()];
    let mut open: Vec<usize> = (0..points.len()).filter(|&i| points[i].iter().flatten().all(|v| v.is_finite())).collect();
    while !open.is_empty() {
        let mut best: Vec<usize> = open.iter().copied().filter(|&i| !open.iter().any(|&j| beats(&points[j], &points[i]))).collect();
        if best.is_empty() {
            // A ring of points that beat each other in turn: a tie of all of them.
            best.clone_from(&open);
        }
        best.iter().for_each(|&i| front[i] = true);
        open.retain(|i| !best.contains(i) && !best.iter().any(|&j| beats(&points[j], &points[*i])));
    }
    front
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without noise.
    fn sharp(pairs: &[(f64, f64)]) -> Vec<bool> {
        front(&pairs.iter().map(|&(a, b)| [[a; 2], [b; 2]]).collect::<Vec<_>>())
    }

    #[test]
    fn what_is_beaten_is_not_on_it() {
        let pairs = [(1.0, 5.0), (2.0, 3.0), (3.0, 3.0), (2.0, 4.0), (4.0, 1.0), (5.0, 1.5), (f64::NAN, 0.0), (0.5, f64::INFINITY)];
        assert_eq!(sharp(&pairs), [true, true, false, false, true, false, false, false]);
        // Twins do not beat each other.
        assert_eq!(sharp(&[(1.0, 1.0), (1.0, 1.0)]), [true, true]);
        assert!(sharp(&[]).is_empty());
    }

    #[test]
    fn noise_neither_puts_on_it_nor_takes_off() {
        let at = |x: f64, y: f64| [[x - 1.0, x + 1.0], [y - 1.0, y + 1.0]];
        // As fast within noise: the better one alone, although it is a little slower.
        assert_eq!(front(&[at(10.0, 50.0), at(11.0, 20.0)]), [false, true]);
        // As good and as fast within noise: both.
        assert_eq!(front(&[at(10.0, 20.5), at(11.0, 20.0)]), [true, true]);
        // The third ties with the second, which the first beats, but with the first no more: it stays.
        assert_eq!(front(&[at(10.0, 23.0), at(20.0, 21.5), at(30.0, 20.0)]), [true, false, true]);
        // A sabotage: without their noise all three are on it.
        assert_eq!(sharp(&[(10.0, 23.0), (20.0, 21.5), (30.0, 20.0)]), [true; 3]);
    }
}
