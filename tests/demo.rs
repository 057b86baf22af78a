//! The demo's scene is what it says.

use halflight::demo;

#[test]
fn the_tube_is_hollow_and_the_block_bored() {
    let v = demo::volume(128).unwrap();
    assert_eq!((v.grid().dims(), v.range()), ([128, 128, 64], [0.0, 220.0]));
    let at = |x: usize, y: usize, z: usize| v.value(x + 128 * (y + 128 * z));
    // Along the tube's axis from the front to the back: vacuum all the way.
    assert!((0..128).all(|y| at(64, y, 40) == 0.0));
    assert_eq!((at(64, 60, 41 + 17), at(18, 60, 20), at(32, 82, 30), at(32, 82, 8)), (demo::METAL, demo::BLOCK, 0.0, demo::BLOCK));
    // The windows: open on both sides, closed behind them.
    assert_eq!((at(64 + 17, 24, 42), at(64 - 18, 24, 42), at(64 + 17, 44, 42)), (0.0, 0.0, demo::METAL));
}

#[test]
fn its_shape_does_not_depend_on_the_resolution() {
    // The edges' fade is symmetric, so the mean keeps to the shape.
    let mean = |n| {
        let v = demo::volume(n).unwrap();
        (0..v.samples().len()).map(|i| f64::from(v.value(i))).sum::<f64>() / v.samples().len() as f64
    };
    assert!((mean(64) / mean(128) - 1.0).abs() < 0.02, "{} {}", mean(64), mean(128));
    assert!(mean(128) > 10.0 && mean(128) < 80.0);
}

#[test]
fn matter_and_camera_are_usable() {
    let v = demo::volume(64).unwrap();
    assert!(!demo::dvr().unwrap().is_vacuum(v.range()) && !demo::iso().unwrap().is_vacuum(v.range()));
    demo::camera(v.grid()).check().unwrap();
    demo::visibility(true).check().unwrap();
    demo::visibility(false).check().unwrap();
}
