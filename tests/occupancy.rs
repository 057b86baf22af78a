//! Occupancy: which blocks hold matter, and how far the others are from them.

mod common;

use common::{Random, blobs, data, engine, homogeneous, linear, load, oblique, surface};
use halflight::io::{ReadOptions, read_volume};
use halflight::scene::transfer::{Kind, Reference};
use halflight::scene::{Grid, Matter, Samples, Shading, Surface, Transfer, Volume};
use halflight::stages::occupancy;

fn cube(dims: [usize; 3]) -> Grid {
    Grid::axis_aligned(dims, [1.0; 3]).expect("grid")
}

/// σ_t [1/world unit] at scalars, linear in between.
fn extinctions(points: &[[f64; 2]]) -> Matter {
    let points: Vec<[f64; 5]> = points.iter().map(|&[s, e]| [s, 1.0, 1.0, 1.0, e]).collect();
    Matter { transfer: Transfer::from_points(&points, Kind::Extinction, Reference::World).expect("transfer"), surface: None }
}

#[test]
fn one_voxel_fills_the_blocks_whose_taps_touch_it() {
    let engine = engine();
    for (dims, at) in
        [([20, 24, 28], [9, 12, 15]), ([20, 24, 28], [0, 0, 0]), ([21, 7, 5], [20, 6, 4]), ([1, 1, 9], [0, 0, 8]), ([1, 1, 1], [0; 3])]
    {
        let volume = Volume::from_fn(cube(dims), |p| f32::from(u8::from((0..3).all(|a| p[a] as usize == at[a])))).expect("volume");
        let (_, medium) = load(&engine, &volume, &linear(1.0));
        let read = engine.read_occupancy(&medium).expect("read");
        let n = occupancy::block_dims(dims);
        assert_eq!(medium.occupancy().dims(), n);
        assert_eq!(read.len(), n.iter().product::<usize>());
        // The voxel reaches a block when it is one of its 4 or one to either side.
        let first: [usize; 3] = std::array::from_fn(|a| at[a].saturating_sub(4).div_ceil(4));
        let last: [usize; 3] = std::array::from_fn(|a| ((at[a] + 1) / 4).min(n[a] - 1));
        for (i, &d) in read.iter().enumerate() {
            let b = [i % n[0], i / n[0] % n[1], i / n[0] / n[1]];
            let expected = (0..3).map(|a| first[a].saturating_sub(b[a]).max(b[a].saturating_sub(last[a]))).max().expect("3");
            assert_eq!(usize::from(d), expected.min(15), "{dims:?}, voxel {at:?}, block {b:?}");
        }
        let bounds = [first.map(|b| 4 * b), std::array::from_fn(|a| (4 * (last[a] + 1)).min(dims[a]))];
        assert_eq!(medium.occupancy().bounds(), Some(bounds));
        assert_eq!(medium.occupancy().occupied(), read.iter().filter(|&&d| d == 0).count());
    }
}

#[test]
fn vacuum_has_no_bounds_and_full_matter_the_whole_box() {
    let engine = engine();
    let volume = blobs(cube([17, 18, 19]), 3);
    let (_, empty) = load(&engine, &volume, &homogeneous(0.0));
    assert_eq!((empty.occupancy().bounds(), empty.occupancy().occupied()), (None, 0));
    assert!(engine.read_occupancy(&empty).expect("read").iter().all(|&d| d == 15));
    let (_, full) = load(&engine, &volume, &homogeneous(0.1));
    assert_eq!(full.occupancy().bounds(), Some([[0; 3], [17, 18, 19]]));
    assert!(engine.read_occupancy(&full).expect("read").iter().all(|&d| d == 0));
}

#[test]
fn matter_between_the_ends_of_a_blocks_range_counts() {
    let engine = engine();
    // A step from 0 to 1: only blocks whose taps see both can take the values in between.
    let volume = Volume::from_fn(cube([32, 8, 8]), |p| f32::from(u8::from(p[0] > 16.0))).expect("volume");
    let band = extinctions(&[[0.0, 0.0], [0.4, 0.0], [0.5, 1.0], [0.6, 0.0], [1.0, 0.0]]);
    let (_, medium) = load(&engine, &volume, &band);
    let read = engine.read_occupancy(&medium).expect("read");
    assert_eq!(read[..8], [3, 2, 1, 0, 0, 1, 2, 3]);
    // A hole in the middle: the ends hold matter, a block with only middle values does not.
    let hole = extinctions(&[[0.0, 1.0], [0.3, 1.0], [0.4, 0.0], [0.6, 0.0], [0.7, 1.0], [1.0, 1.0]]);
    let ramp = Volume::from_fn(cube([64, 4, 4]), |p| (p[0] / 64.0) as f32).expect("volume");
    let (_, medium) = load(&engine, &ramp, &hole);
    let read = engine.read_occupancy(&medium).expect("read");
    // 0.4 .. 0.6 are voxels 25.6 .. 38.4; block 7 takes 27.5 .. 32.5, block 8 31.5 .. 36.5.
    assert_eq!(read, [0, 0, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn the_device_agrees_with_the_twin_and_a_smaller_volume_does_not() {
    let engine = engine();
    let mut random = Random(11);
    for dims in [[33, 18, 27], [70, 5, 1], [4, 4, 4]] {
        for top in [1.0, 0.02] {
            // Matter in few places: what lies above the threshold.
            let volume = blobs(oblique(dims), 5 + dims[0] as u64);
            let threshold = f64::from(volume.range()[1]) * (1.0 - 0.3 * f64::from(random.unit()));
            let matter = extinctions(&[[threshold, 0.0], [threshold + 0.01, top]]);
            let (_, medium) = load(&engine, &volume, &matter);
            let read = engine.read_occupancy(&medium).expect("read");
            let twin = occupancy::reference(&volume, medium.table());
            assert_eq!(read, twin, "{dims:?}");
            assert!(twin.contains(&0));
            // Sabotage: a table that begins elsewhere is told apart.
            let other = extinctions(&[[0.6 * threshold, 0.0], [threshold, top]]).transfer.table(volume.range(), volume.grid());
            assert!(dims[0] < 8 || occupancy::reference(&volume, &other) != read);
        }
    }
}

#[test]
fn samples_of_every_type_give_the_same_blocks() {
    let engine = engine();
    let grid = cube([23, 13, 11]);
    let bytes: Vec<u8> = (0..grid.voxels()).map(|i| if i % 97 == 0 && i > 1500 { 200 } else { (i % 50) as u8 }).collect();
    let matter = extinctions(&[[100.0, 0.0], [120.0, 1.0]]);
    let distances = |samples: Samples, slope: f32| {
        let volume = Volume::new(grid, samples, slope, 0.0).expect("volume");
        let (_, medium) = load(&engine, &volume, &matter);
        assert_eq!(occupancy::reference(&volume, medium.table()), engine.read_occupancy(&medium).expect("read"));
        engine.read_occupancy(&medium).expect("read")
    };
    let first = distances(Samples::U8(bytes.clone()), 1.0);
    assert!(first.contains(&0) && first.iter().any(|&d| d > 0));
    assert_eq!(first, distances(Samples::U16(bytes.iter().map(|&v| u16::from(v)).collect()), 1.0));
    assert_eq!(first, distances(Samples::I16(bytes.iter().map(|&v| i16::from(v)).collect()), 1.0));
    // Negated samples: the map from image to table falls.
    assert_eq!(first, distances(Samples::I16(bytes.iter().map(|&v| -i16::from(v)).collect()), -1.0));
    assert_eq!(first, distances(Samples::F32(bytes.iter().map(|&v| f32::from(v)).collect()), 1.0));
}

#[test]
fn an_edit_of_the_matter_leaves_nothing_stale() {
    let engine = engine();
    let volume = blobs(cube([40, 32, 24]), 9);
    let uploaded = engine.upload(&volume).expect("upload");
    let [_, hi] = volume.range().map(f64::from);
    let mut seen = Vec::new();
    for threshold in [0.9 * hi, 0.2 * hi, 0.6 * hi, 0.9 * hi] {
        let medium = engine.classify(&uploaded, &extinctions(&[[threshold, 0.0], [threshold + 1e-3, 1.0]])).expect("classify");
        seen.push(engine.read_occupancy(&medium).expect("read"));
    }
    assert!(seen[0] == seen[3] && seen[0] != seen[1] && seen[1] != seen[2]);
}

#[test]
fn a_surface_at_the_value_of_samples_is_not_lost_to_rounding() {
    let engine = engine();
    let grid = cube([24, 24, 24]);
    // The iso value is the value of the samples themselves, in data whose range is wide against the table's.
    let samples = (0..grid.voxels())
        .map(|i| {
            if i == 12 + 24 * (12 + 24 * 12) {
                100
            } else if i == 0 {
                255
            } else {
                3
            }
        })
        .collect();
    let volume = Volume::new(grid, Samples::U8(samples), 1.0, 0.0).expect("volume");
    let (_, medium) = load(&engine, &volume, &surface(Surface { iso: 100.0, shading: Shading::Lambert, albedo: Some([1.0; 3]) }));
    let read = engine.read_occupancy(&medium).expect("read");
    assert_eq!(read[3 + 6 * (3 + 6 * 3)], 0);
    assert_eq!(medium.occupancy().bounds(), Some([[0; 3], [16; 3]]));
    assert_eq!(medium.occupancy().occupied(), 9);
}

/// Real data: what is found empty holds nothing, sample by sample; prints how much and what it costs.
#[test]
fn empty_blocks_of_a_ct_hold_nothing() {
    let Some(file) = data("volumes/engine.nii.gz") else { return };
    let engine = engine();
    let volume = read_volume(&file, &ReadOptions::default()).expect("volume");
    let points = [[70.0, 0.8, 0.7, 0.5, 0.0], [120.0, 0.8, 0.7, 0.5, 0.15], [200.0, 0.8, 0.7, 0.5, 0.6]];
    let matter = Matter { transfer: Transfer::from_points(&points, Kind::Opacity, Reference::Voxel).expect("transfer"), surface: None };
    let start = std::time::Instant::now();
    let ranges = occupancy::ranges(&volume);
    let host = start.elapsed();
    let uploaded = engine.upload(&volume).expect("upload");
    // Some drivers compile at a kernel's first dispatch.
    engine.classify(&uploaded, &matter).expect("classify");
    engine.take_timings();
    let start = std::time::Instant::now();
    let medium = engine.classify(&uploaded, &matter).expect("classify");
    let classify = start.elapsed();
    let o = medium.occupancy();
    println!("{} of {:?} blocks hold matter, bounds {:?}", o.occupied(), o.dims(), o.bounds());
    println!("ranges {host:.1?} on the host ({} KiB), classify {classify:.1?}: {:?}", ranges.len() >> 10, engine.take_timings());
    let read = engine.read_occupancy(&medium).expect("read");
    let (n, b) = (volume.grid().dims(), o.dims());
    for z in 0..n[2] {
        for y in 0..n[1] {
            for x in 0..n[0] {
                if volume.value(x + n[0] * (y + n[1] * z)) > 70.0 {
                    assert_eq!(read[x / 4 + b[0] * (y / 4 + b[1] * (z / 4))], 0, "voxel {x}, {y}, {z}");
                }
            }
        }
    }
}
