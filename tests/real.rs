//! Real data: the field error of both estimators on the engine block, with its dense reference. Skipped, saying so, where
//! the data is absent.

mod common;
use common::*;
use halflight::measure;
use halflight::scene::transfer::{Kind, Reference};
use halflight::scene::visibility::{Filter, Method, Sampling};
use halflight::scene::{Matter, Transfer, Visibility};

#[test]
fn field_error_of_both_estimators_on_the_engine_block() {
    let Some(file) = data("volumes/engine.nii.gz") else { return };
    let engine = engine();
    let volume = halflight::io::read_volume(&file, &Default::default()).expect("volume");
    assert_eq!(volume.grid().dims(), [256, 256, 128]);
    let points = [[70.0, 0.8, 0.7, 0.5, 0.0], [120.0, 0.8, 0.7, 0.5, 0.15], [200.0, 0.8, 0.7, 0.5, 0.6]];
    let matter = Matter { transfer: Transfer::from_points(&points, Kind::Opacity, Reference::Voxel).expect("transfer"), surface: None };
    let (_, medium) = load(&engine, &volume, &matter);
    let probes = measure::probes(&engine, &volume, &medium, 4, 1024).expect("probes");
    assert_eq!(probes.len(), 1024);
    engine.take_timings();
    let reference = measure::reference(&engine, &medium, 4, &probes, &mut quiet).expect("reference");
    let seconds = |engine: &halflight::Engine| engine.take_timings().iter().map(|s| s.seconds).sum::<f64>();
    println!("engine.nii.gz at 1:4, {} probes; reference: {:.1} s of device time", probes.len(), seconds(&engine));
    println!(
        "method        sampling    N    settings         error before packing     8 bit   16 bit  device s (sweep: of the whole field)"
    );
    let error = |s: &Visibility| -> f64 {
        engine.take_timings();
        let v = engine.estimate(&medium, s, &probes, &mut quiet).expect("estimate");
        let e = measure::field_error(&v, &reference);
        let packed = [8, 16].map(|bits| measure::field_error(&measure::packed(&v, 4, bits), &reference).relative_l2);
        println!(
            "{:12}  {:10}  {:3}  {:15}  {:.4} [{:.4}, {:.4}]  {:.4}  {:.4}  {:.2}",
            format!("{:?}", s.method),
            format!("{:?}", s.sampling),
            s.directions,
            match s.method {
                Method::March => "-".into(),
                Method::Hierarchical => format!("{:?} {}", s.filter, s.growth),
                Method::Sweep => format!("near {} step {}", s.near, s.step),
            },
            e.relative_l2,
            e.interval[0],
            e.interval[1],
            packed[0],
            packed[1],
            seconds(&engine)
        );
        assert!(e.interval[0] <= e.relative_l2 && e.relative_l2 <= e.interval[1]);
        // 8 bits add their own quantum and no more: half of 2R/254 per coefficient against a field of about 2.
        assert!((packed[0] - e.relative_l2).abs() < 0.01 && (packed[1] - e.relative_l2).abs() < 1e-3);
        e.relative_l2
    };
    let base = Visibility { method: Method::Hierarchical, ratio: 4, directions: 400, ..Visibility::default() };
    let march = |sampling| Visibility { method: Method::March, sampling, ..base.clone() };
    let stratified = error(&march(Sampling::Stratified));
    let jittered = error(&march(Sampling::Jittered));
    let mut hierarchical = Vec::new();
    for growth in [0.25, 0.5, 1.0] {
        for filter in [Filter::Box, Filter::Product, Filter::Axis, Filter::Extinction] {
            hierarchical.push(error(&Visibility { filter, growth, ..base.clone() }));
        }
    }
    hierarchical.push(error(&Visibility { sampling: Sampling::Jittered, ..base.clone() }));
    let sweep = [(1, 64), (2, 128)]
        .map(|(near, directions)| error(&Visibility { method: Method::Sweep, near, directions, step: 2.0, ..base.clone() }));
    // Two slices marched densely and 128 directions beat the hierarchy's 400.
    assert!(sweep[1] < sweep[0] && sweep[1] < 0.6 * hierarchical[2], "{sweep:?}");
    // A fixed, well-spread set beats jitter, and the dense march beats the hierarchy, whose error is bias.
    assert!(stratified < jittered && jittered < 0.12, "{stratified} {jittered}");
    assert!(hierarchical.iter().all(|&h| h > stratified), "{hierarchical:?}");
    // The default, `axis` with growth 1/4, is the best of them.
    assert!(hierarchical[2] < 0.15 && hierarchical[..12].iter().all(|&h| h >= hierarchical[2]), "{hierarchical:?}");
    // Sabotage: probes of a neighbouring cell are not within the dense estimator's error.
    let shifted: Vec<u32> = probes.iter().map(|p| if *p > 0 { p - 1 } else { 1 }).collect();
    let moved = engine.estimate(&medium, &march(Sampling::Stratified), &shifted, &mut quiet).expect("estimate");
    assert!(measure::field_error(&moved, &reference).relative_l2 > 2.0 * stratified);
}
