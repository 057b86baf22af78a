//! Stability where methods fail: every row of the library's table keeps its bound, or fails as documented.
//! `cargo test --release --test stability -- --nocapture` prints the table.

#[path = "../common/mod.rs"]
mod common;
mod devices;
mod sabotage;

use common::*;
use halflight::stability::{self, CASES, Case};

/// Runs a case, prints its rows in one piece and asserts each.
fn check(name: &str) {
    let case = find(name);
    let start = std::time::Instant::now();
    let rows = case.run(&engine(), &mut quiet).expect("the case runs");
    println!("{}\n  {name}: {:.1} s", stability::table(&rows), start.elapsed().as_secs_f64());
    for row in &rows {
        assert!(row.holds(), "{row}");
    }
    assert!(!rows.is_empty());
}

fn find(name: &str) -> &'static Case {
    CASES.iter().find(|c| c.name == name).expect("a case of this name")
}

macro_rules! cases {
    ($($test:ident: $name:literal),* $(,)?) => { $(#[test] fn $test() { check($name); })* };
}

cases! {
    sheet: "sheet",
    checkerboard: "checkerboard",
    far_voxel: "far voxel",
    tube: "tube",
    half_space: "half-space",
    walls: "walls",
    pinhole: "pinhole",
    axis_switch: "axis switch",
    extinction: "extinction",
    iso_value: "iso value",
    sun: "sun",
    turned_light: "turned light",
    spacing: "spacing",
    dims: "dims",
    odd_size: "odd size",
    directions: "directions",
    step: "step",
    coarse_field: "coarse field",
    camera: "camera",
    long_rays: "long rays",
    repeat: "repeat",
    elsewhere: "elsewhere",
}
