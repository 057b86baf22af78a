//! The bounds can be broken.

use crate::common::{engine, quiet};
use crate::find;
use halflight::stability::{Bound, CASES};

#[test]
fn every_case_has_its_test() {
    // The list of main.rs, which `cases!` makes tests of.
    let text = include_str!("main.rs");
    for case in CASES {
        assert!(text.contains(&format!(": \"{}\"", case.name)), "{} has no test", case.name);
        assert_eq!(CASES.iter().filter(|c| c.name == case.name).count(), 1);
        assert!(!case.about.is_empty());
    }
}

#[test]
fn bounds_refuse_what_lies_outside() {
    for (bound, good, bad) in [
        (Bound::AtMost(0.1), [0.0, 0.1], [-1e-9, 0.11]),
        (Bound::Within(-1.0, 2.0), [-1.0, 2.0], [-1.1, 2.1]),
        (Bound::Fails(0.2, 0.4), [0.2, 0.4], [0.1, 0.5]),
    ] {
        assert!(good.iter().all(|&v| bound.holds(v)) && !bad.iter().any(|&v| bound.holds(v)));
        assert!(![f64::NAN, f64::INFINITY, f64::NEG_INFINITY].iter().any(|&v| bound.holds(v)));
    }
}

#[test]
fn a_tenth_of_the_light_lost_or_gained_is_noticed() {
    let engine = engine();
    for name in ["half-space", "sun", "spacing", "long rays"] {
        for factor in [0.9, 1.1, f32::NAN] {
            let rows = find(name).tampered(&engine, &mut quiet, factor).expect("the case runs");
            let broken = rows.iter().filter(|r| !r.holds()).count();
            assert!(broken > 0, "{name} does not notice a factor of {factor}");
        }
    }
}
