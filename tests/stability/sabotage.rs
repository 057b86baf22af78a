//! The bounds can be broken.

use crate::common::{engine, quiet};
use crate::find;
use halflight::engine::Engine;
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

/// Rows of a case that break with every coefficient multiplied by `factor`.
fn broken(engine: &Engine, name: &str, factor: f32) -> usize {
    let rows = find(name).tampered(engine, &mut quiet, factor).expect("the case runs");
    rows.iter().filter(|r| !r.holds()).count()
}

#[test]
fn a_tenth_of_the_light_lost_or_gained_is_noticed() {
    let engine = engine();
    // Not those that compare a method with itself: a factor is no difference to them, only a number that is none.
    let told = [
        "sheet",
        "checkerboard",
        "far voxel",
        "half-space",
        "walls",
        "extinction",
        "iso value",
        "sun",
        "spacing",
        "dims",
        "long rays",
        "elsewhere",
    ];
    for name in told {
        for factor in [0.9, 1.1, f32::NAN] {
            assert!(broken(&engine, name, factor) > 0, "{name} does not notice a factor of {factor}");
        }
    }
}

#[test]
fn a_third_of_the_light_behind_an_opening_is_noticed() {
    let engine = engine();
    // So little light comes through that the directions which meet it are few: a tenth is within their chance.
    for name in ["tube", "pinhole"] {
        for factor in [0.7, 1.4, f32::NAN] {
            assert!(broken(&engine, name, factor) > 0, "{name} does not notice a factor of {factor}");
        }
    }
}

#[test]
fn what_compares_a_method_with_itself_notices_what_is_no_number() {
    let engine = engine();
    for name in ["axis switch", "turned light", "directions", "step"] {
        assert!(broken(&engine, name, f32::NAN) > 0, "{name}");
    }
}
