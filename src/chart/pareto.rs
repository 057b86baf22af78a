//! The Pareto front: what nothing else beats in both time and error.

/// Whether each (cost, error) pair is on the front: no other pair is at most as costly and at most as wrong, and better in
/// one of the two. Pairs that are not finite are never on it.
pub fn front(pairs: &[(f64, f64)]) -> Vec<bool> {
    let beats = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    let finite = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
    pairs.iter().map(|p| finite(p) && !pairs.iter().any(|q| finite(q) && beats(q, p))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_beaten_is_not_on_it() {
        let pairs = [(1.0, 5.0), (2.0, 3.0), (3.0, 3.0), (2.0, 4.0), (4.0, 1.0), (5.0, 1.5), (f64::NAN, 0.0), (0.5, f64::INFINITY)];
        assert_eq!(front(&pairs), [true, true, false, false, true, false, false, false]);
        // Twins do not beat each other.
        assert_eq!(front(&[(1.0, 1.0), (1.0, 1.0)]), [true, true]);
        assert!(front(&[]).is_empty());
    }
}
