//! The field's memory: bricks of cells near matter, what is said beforehand, and what little memory changes.

mod common;

use common::{Checked, data, engine, homogeneous, linear, load, quiet, surface, worst};
use halflight::engine::{Engine, Field, Medium, Options};
use halflight::scene::transfer::{Kind, Reference};
use halflight::scene::visibility::{Cells, Method, Sampling};
use halflight::scene::{Camera, Grid, ImageSettings, Light, Matter, Probe, Shading, Surface, Transfer, Visibility, Volume};
use halflight::stages::bricks::Bricks;
use halflight::stages::cells::CellMap;
use halflight::stages::{pack, relight};
use halflight::vk::DeviceKind;

/// Balls of radius `r` voxels of which the first lies off the centre, in a void.
fn balls(dims: [usize; 3], r: f64, count: usize) -> Volume {
    let mut random = common::Random(5);
    let centres: Vec<[f64; 3]> =
        (0..count).map(|_| std::array::from_fn(|a| r + 2.0 + f64::from(random.unit()) * (dims[a] as f64 - 2.0 * r - 4.0))).collect();
    let grid = Grid::axis_aligned(dims, [1.0; 3]).expect("grid");
    Volume::from_fn(grid, |p| {
        let d = centres.iter().map(|c| (0..3).map(|a| (p[a] - c[a]).powi(2)).sum::<f64>().sqrt()).fold(f64::INFINITY, f64::min);
        (r + 1.0 - d).clamp(0.0, 1.0) as f32
    })
    .expect("a valid volume")
}

fn settings(method: Method, ratio: u32) -> Visibility {
    Visibility { method, ratio, directions: 48, near: 1, step: 1.0, ..Visibility::default() }
}

fn field(engine: &Engine, medium: &Medium, v: &Visibility) -> Field {
    engine.precompute(medium, v, &mut quiet).expect("precompute")
}

/// The held cells' coefficients are those of the estimate, packed, and every other cell is zero; at every number of bands
/// and bits, in fields that bricks do not divide.
#[test]
fn bricks_hold_the_wanted_cells_and_nothing_else() {
    let engine = engine();
    for (dims, ratio) in [([33, 21, 26], 2), ([40, 9, 3], 1), ([7, 30, 64], 4)] {
        let (_, medium) = load(&engine, &balls(dims, if dims[2] < 8 { 0.4 } else { 2.0 }, 1), &linear(1.0));
        for (bands, bits) in [(4, 8), (4, 16), (4, 32), (1, 8), (1, 16), (2, 8), (3, 8), (1, 32)] {
            let v = Visibility { bands, bits, ..settings(Method::March, ratio) };
            let got = field(&engine, &medium, &v);
            let (read, kept) = (engine.read_field(&got).expect("read"), v.coefficients());
            let wanted = engine.wanted_cells(&medium, &v).expect("cells");
            let estimate = engine.estimate(&medium, &v, &wanted, &mut quiet).expect("estimate");
            let mut expected = vec![0f32; read.len()];
            for (&cell, e) in wanted.iter().zip(&estimate) {
                let codes = pack::decode(&pack::reference(e, bands, bits, false), bits, false);
                expected[cell as usize * kept..][..kept].copy_from_slice(&codes[..kept]);
            }
            assert!(!wanted.is_empty() && (ratio == 4 || wanted.len() * kept < read.len()), "some cells are far from matter");
            // A code more or less where the device rounds the product with 4π/N another way.
            let one = if bits == 32 { 1e-6 } else { 4.0 / f32::from(u16::MAX >> (16 - bits)) };
            let (difference, at) = worst(&read, &expected);
            assert!(difference <= one, "{dims:?} {bands} bands {bits} bits: {difference} at {at}");
            let off = expected.iter().zip(&read).filter(|(a, b)| **a == 0.0 && **b != 0.0).count();
            assert!(off <= read.len() / 100, "{off} zeros are not");
            // Sabotage: one cell taken for its neighbour is seen.
            let mut swapped = expected.clone();
            let cell = wanted[wanted.len() / 2] as usize * kept;
            swapped.copy_within(cell..cell + kept, if cell >= kept { cell - kept } else { cell + kept });
            assert!(worst(&read, &swapped).0 > one || worst(&expected, &swapped).0 == 0.0);
        }
    }
}

/// A dense field and one in bricks give the same picture.
#[test]
fn pictures_are_those_of_a_dense_field() {
    let engine = engine();
    let volume = balls([48, 40, 36], 5.0, 3);
    let camera = Camera::framing(volume.grid());
    let image = ImageSettings { width: 96, height: 72, ..ImageSettings::default() };
    let light = Light::from_probe(&Probe::two_colored());
    let lambert = Surface { iso: 0.5, albedo: Some([0.8; 3]), shading: Shading::Lambert };
    for matter in [linear(1.0), surface(lambert)] {
        let (_, medium) = load(&engine, &volume, &matter);
        for ratio in [1, 2, 4] {
            let near = settings(Method::March, ratio);
            let all = Visibility { cells: Cells::All, ..near.clone() };
            let frame = |v: &Visibility| {
                let field = field(&engine, &medium, v);
                let lit = engine.relight(&field, &light).expect("relight");
                let picture = engine.render(&medium, &lit, &camera, &image, &mut quiet).expect("render");
                (picture.rgba.into_iter().flatten().collect::<Vec<f32>>(), field.bytes(), lit.bytes())
            };
            let (bricks, dense) = (frame(&near), frame(&all));
            let bright = dense.0.iter().fold(0f32, |m, v| m.max(*v));
            let (difference, at) = worst(&bricks.0, &dense.0);
            // The irradiance's box moves its texture coordinates by a few units in the last place: a weight of the few that lie at
            // the edge of a step of the device's goes to the other side, where a pixel's irradiance is up to all its light.
            let mean = bricks.0.iter().zip(&dense.0).map(|(a, b)| (a - b).abs()).sum::<f32>() / dense.0.len() as f32;
            let step = engine.filtering().expect("filtering").map_or(0.0, |f| 1.0 / f.steps as f32);
            assert!(
                difference <= (1e-5 + step) * bright && mean <= 1e-5 * bright,
                "1:{ratio}: {difference} of {bright} at {at}, mean {mean}"
            );
            if ratio == 1 {
                // Cards pad images of this size to some half megabyte each.
                let times = if engine.device().kind == DeviceKind::Cpu { 2 } else { 1 };
                assert!(times * bricks.1 < dense.1 && bricks.2 <= dense.2, "{:?} {:?}", (bricks.1, bricks.2), (dense.1, dense.2));
            }
        }
    }
}

/// Twin of the box's place: the same cell, whether asked through the whole field or through the box.
#[test]
fn the_window_maps_coordinates_exactly() {
    let dims = [20, 13, 9];
    let mut wants = vec![false; dims.iter().product()];
    for (x, y, z) in [(9, 5, 4), (13, 6, 7)] {
        wants[x + dims[0] * (y + dims[1] * z)] = true;
    }
    let map = CellMap::listed(wants.into_iter());
    let bricks = Bricks::new(dims, &map, 4);
    assert_eq!(bricks.window(), [[8, 4, 4], [16, 8, 8]]);
    let [scale, shift] = relight::window(dims, &bricks);
    for a in 0..3 {
        let [lo, hi] = bricks.window().map(|p| p[a]);
        for cell in lo..hi {
            let p = (cell as f32 + 0.5) / dims[a] as f32;
            let inside = (p * scale[a] + shift[a]) * (hi - lo) as f32;
            assert!((inside - ((cell - lo) as f32 + 0.5)).abs() < 1e-5);
        }
    }
    // Of the whole field nothing moves.
    let bricks = Bricks::new(dims, &CellMap::listed((0..20 * 13 * 9).map(|_| true)), 4);
    assert_eq!(relight::window(dims, &bricks), [[1.0, 1.0, 1.0, 0.0], [0.0; 4]]);
    assert_eq!(bricks.count(), 5 * 4 * 3);
}

/// What a field and its making will take, said beforehand, against the most that was held.
fn predicted(engine: &Engine, medium: &Medium, v: &Visibility) -> (u64, u64, Field) {
    let before = engine.memory().used;
    let (kept, scratch) = engine.precompute_memory(medium, v).expect("known settings");
    let field = field(engine, medium, v);
    assert_eq!(engine.memory().used - before, field.bytes(), "all scratch is given back");
    (before + kept + scratch, engine.memory().peak, field)
}

#[test]
fn memory_is_predicted_within_a_tenth() {
    for (name, volume) in [("little", balls([128, 128, 128], 5.0, 4)), ("much", balls([96, 96, 96], 40.0, 2))] {
        for method in [Method::March, Method::Hierarchical, Method::Sweep] {
            for (bands, bits, ratio) in [(4, 8, 1), (4, 32, 1), (1, 8, 2), (4, 8, 2)] {
                // Its own engine, for its own peak.
                let engine = engine();
                let (_, medium) = load(&engine, &volume, &linear(4.0));
                let v = Visibility { bands, bits, directions: 6, step: 2.0, growth: 4.0, ..settings(method, ratio) };
                let base = engine.memory().used;
                let (said, held, field) = predicted(&engine, &medium, &v);
                let error = said as f64 / held as f64 - 1.0;
                println!(
                    "{name:6} {method:?} 1:{ratio} {bands} bands {bits} bits: {:.2} MiB said, {:.2} held (volume {:.2}, field {:.2}, {:.0} % of its bricks): {:+.1} %",
                    said as f64 / 1048576.0,
                    held as f64 / 1048576.0,
                    base as f64 / 1048576.0,
                    field.bytes() as f64 / 1048576.0,
                    100.0 * field.held(),
                    100.0 * error
                );
                assert!(error.abs() < 0.1, "{name} {method:?}: {said} said, {held} held");
                // Sabotage: counting all cells is far off where there is little matter.
                let dense = halflight::engine::precompute_memory(medium.grid(), &v);
                if name == "little" && ratio == 1 && bands == 4 && method != Method::Hierarchical {
                    assert!((base + dense.0 + dense.1) as f64 > 1.5 * held as f64, "{dense:?} {held}");
                }
            }
        }
    }
}

#[test]
fn little_memory_makes_a_sweep_slower_not_impossible() {
    let volume = balls([64, 64, 64], 8.0, 2);
    let v = Visibility { directions: 256, ..settings(Method::Sweep, 1) };
    let plenty = engine();
    let (_, medium) = load(&plenty, &volume, &linear(2.0));
    let (truth, need) = (field(&plenty, &medium, &v), plenty.need(&medium, &v, None).expect("need"));
    let least = need.volume + need.field + need.least_scratch;
    assert!(2 * need.scratch > 3 * need.least_scratch, "{need:?}");
    let truth = plenty.read_field(&truth).expect("read");
    for extra in [0, 1 << 20] {
        // The table of the matter passes through some more.
        let budget = least + extra + (64 << 10);
        let small = Engine::new(&Options { memory_budget: Some(budget), validation: true, ..Options::default() }).expect("device");
        let (_, medium) = load(&small, &volume, &linear(2.0));
        small.admit(&medium, &v, None).expect("it fits");
        let got = small.read_field(&field(&small, &medium, &v)).expect("read");
        assert!(small.memory().peak <= budget);
        assert_eq!(small.validation_errors(), Vec::<String>::new());
        // Sums of 256 directions in another order, packed: one code at most.
        let (difference, at) = worst(&got, &truth);
        assert!(difference < 4.0 / 127.0, "{difference} at {at}");
        let differing = got.iter().zip(&truth).filter(|(a, b)| a != b).count();
        assert!(differing < got.len() / 1000, "{differing}");
    }
    let tiny = Engine::new(&Options { memory_budget: Some(least - (1 << 20)), ..Options::default() }).expect("device");
    let (_, medium) = load(&tiny, &volume, &linear(2.0));
    let before = tiny.memory();
    for text in [
        tiny.admit(&medium, &v, None).expect_err("too little").to_string(),
        tiny.precompute(&medium, &v, &mut quiet).err().expect("too little").to_string(),
    ] {
        assert!(text.contains("1:2 would fit"), "{text}");
    }
    assert_eq!((tiny.memory().used, tiny.memory().peak), (before.used, before.peak), "refused before anything was allocated");
}

/// What was read can be brought back, to the last bit, and takes the same memory.
#[test]
fn a_field_that_was_read_can_be_loaded() {
    let engine = engine();
    let volume = balls([40, 36, 44], 4.0, 2);
    let (_, medium) = load(&engine, &volume, &linear(1.0));
    for (bands, bits) in [(4, 8), (3, 16), (4, 32), (1, 8)] {
        let v = Visibility { bands, bits, ..settings(Method::March, 2) };
        let field = field(&engine, &medium, &v);
        let read = engine.read_field(&field).expect("read");
        let back = engine.load_field(volume.grid(), &v, &read).expect("load");
        assert_eq!(engine.read_field(&back).expect("read"), read, "{bands} bands, {bits} bits");
        assert!(back.bytes() <= field.bytes());
        let light = Light::from_probe(&Probe::two_colored());
        let lit = [&field, &back].map(|f| engine.read_irradiance(&engine.relight(f, &light).expect("relight")).expect("read"));
        assert_eq!(lit[0], lit[1]);
        let text = engine.load_field(volume.grid(), &v, &read[1..]).err().expect("one too few").to_string();
        assert!(text.contains("coefficients"), "{text}");
    }
}

#[test]
fn a_vacuum_takes_no_field() {
    let engine = engine();
    let grid = Grid::axis_aligned([64, 64, 64], [1.0; 3]).expect("grid");
    let (_, medium) = load(&engine, &Volume::from_fn(grid, |p| p[0] as f32).expect("volume"), &homogeneous(0.0));
    for method in [Method::March, Method::Hierarchical, Method::Sweep] {
        let field = field(&engine, &medium, &settings(method, 1));
        assert_eq!(field.held(), 0.0);
        assert!(field.bytes() < 32 << 10, "{}", field.bytes());
        assert!(engine.read_field(&field).expect("read").iter().all(|&v| v == 0.0));
        let lit = engine.relight(&field, &Light::constant([1.0; 3])).expect("relight");
        assert!(engine.read_irradiance(&lit).expect("read").iter().all(|s| *s == [0.0; 4]));
    }
}

/// Real volumes: what they take against a dense field.
#[test]
fn real_volumes_take_what_they_hold() {
    let opaque = [[40.0, 1.0, 1.0, 1.0, 0.0], [60.0, 1.0, 1.0, 1.0, 0.8], [255.0, 1.0, 1.0, 1.0, 0.95]];
    let glass = [[70.0, 0.8, 0.7, 0.5, 0.0], [120.0, 0.8, 0.7, 0.5, 0.15], [200.0, 0.8, 0.7, 0.5, 0.6]];
    for (name, points, ratio, most) in
        [("volumes/engine.nii.gz", &glass, 4, 0.6), ("volumes/bonsai.nii.gz", &opaque, 1, 0.32), ("volumes/aneurism.nrrd", &opaque, 2, 0.3)]
    {
        let Some(path) = data(name) else { continue };
        let volume = halflight::io::read_volume(&path, &Default::default()).expect("a volume");
        let transfer = Transfer::from_points(points, Kind::Opacity, Reference::Voxel).expect("a transfer function");
        let engine: Checked = engine();
        let (_, medium) = load(&engine, &volume, &Matter { transfer, surface: None });
        let v = Visibility { sampling: Sampling::Stratified, directions: 64, near: 2, ..settings(Method::Sweep, ratio) };
        let (kept, scratch) = engine.precompute_memory(&medium, &v).expect("known settings");
        let dense = halflight::engine::precompute_memory(volume.grid(), &v);
        println!("{name} 1:{ratio}: {kept} kept of {}, {scratch} while it is made of {}", dense.0, dense.1);
        // Cards pad each of the five images by up to some half a megabyte.
        let padding = if engine.device().kind == DeviceKind::Cpu { 0.0 } else { f64::from(2 << 20) };
        assert!((kept as f64) < most * dense.0 as f64 + padding, "{kept} of {}", dense.0);
    }
}

/// Cells centred inside an opaque surface: the twin's, zero by every method and in the field, on both sides of signed data, at
/// clip planes, in fields that words of 32 do not divide.
#[test]
fn cells_inside_a_surface_are_left_out() {
    use halflight::scene::Clip;
    use halflight::stages::buried;
    let engine = engine();
    let shell = Surface { iso: 0.5, albedo: Some([0.8; 3]), shading: Shading::Lambert };
    for (dims, ratio) in [([45, 31, 27], 1), ([45, 31, 27], 2), ([60, 44, 52], 4)] {
        let volume = balls(dims, 8.0, 3);
        let uploaded = engine.upload(&volume).expect("upload");
        for clip in [Clip::default(), Clip { bounds: Some([[0.4, 0.0, 0.0], [1.0, 0.9, 1.0]]), ..Clip::default() }] {
            let medium = engine.classify_clipped(&uploaded, &surface(shell), &clip).expect("classify");
            let v = settings(Method::March, ratio);
            let field_dims = volume.grid().field_dims(ratio as usize);
            let twin = buried::reference(&volume, field_dims, 0.5, &clip.half_spaces(volume.grid()));
            let wanted = engine.wanted_cells(&medium, &v).expect("cells");
            let all = engine.wanted_cells(&medium, &Visibility { cells: Cells::All, ..v.clone() }).expect("cells");
            let left_out: Vec<u32> = (0..twin.len() as u32).filter(|c| all.binary_search(c).is_err()).collect();
            let expected: Vec<u32> = (0..twin.len() as u32).filter(|&c| twin[c as usize]).collect();
            assert_eq!(left_out, expected, "{dims:?} 1:{ratio}");
            assert!(expected.len() > 8 && wanted.iter().all(|&c| !twin[c as usize]));
            // Sabotage: another iso value buries other cells.
            assert_ne!(buried::reference(&volume, field_dims, 0.1, &clip.half_spaces(volume.grid())), twin);
            let some = [expected[0], wanted[0], expected[expected.len() - 1], wanted[wanted.len() - 1]];
            for method in [Method::March, Method::Hierarchical, Method::Sweep] {
                let got = engine.estimate(&medium, &settings(method, ratio), &some, &mut quiet).expect("estimate");
                assert!(got[0] == [0.0; 16] && got[2] == [0.0; 16] && got[1][0] > 0.1 && got[3][0] > 0.1, "{method:?}: {got:?}");
                let alone = engine.estimate(&medium, &settings(method, ratio), &some[1..2], &mut quiet).expect("estimate");
                assert_eq!(alone[0], got[1]);
            }
        }
        let cleared = engine.classify(&uploaded, &linear(1.0)).expect("classify");
        let v = Visibility { cells: Cells::All, ..settings(Method::March, ratio) };
        let cells = volume.grid().field_dims(ratio as usize).iter().product::<usize>();
        assert_eq!(engine.wanted_cells(&cleared, &v).expect("cells").len(), cells, "a medium without a surface buries nothing");
    }
}
