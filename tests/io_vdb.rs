//! OpenVDB: every value type and compression gives the formula that was written, in the place that the transform says.

mod io_common;
use halflight::Result;
use halflight::io::{ReadOptions, describe, read_volume};
use halflight::scene::Volume;
use io_common::vdb::{Grid, Ijk, Pack, Tree, file, file_and_codes, scale_map};
use io_common::{Folder, says};

/// Exact in half precision, different from its neighbours, positive and negative.
fn formula([x, y, z]: Ijk) -> f64 {
    f64::from((x * 3 + y * 17 + z * 57).rem_euclid(1999) - 700)
}

/// Whether the test's grid has a voxel there: two thirds of a box that crosses all levels of the tree's raster.
fn is_active([x, y, z]: Ijk) -> bool {
    (x + 2 * y + z).rem_euclid(3) != 0
}

const LO: Ijk = [-7, 120, 4090];
const HI: Ijk = [9, 133, 4101];

fn each(lo: Ijk, hi: Ijk) -> impl Iterator<Item = Ijk> {
    let mut at = Vec::new();
    for z in lo[2]..=hi[2] {
        for y in lo[1]..=hi[1] {
            at.extend((lo[0]..=hi[0]).map(|x| [x, y, z]));
        }
    }
    at.into_iter()
}

fn tree(background: f64) -> Tree {
    let mut tree = Tree::new(background);
    for at in each(LO, HI).filter(|at| is_active(*at)) {
        tree.set(at, formula(at), true);
    }
    tree
}

fn open(bytes: &[u8], component: Option<&str>) -> Result<Volume> {
    let dir = Folder::new();
    read_volume(&dir.file("a.vdb", &[bytes]), &ReadOptions { component: component.map(String::from), ..Default::default() })
}

/// The worst difference between a volume and the formula, times `factor`, over the active box.
fn worst(volume: &Volume, background: f64, factor: f64) -> f64 {
    let expected = each(LO, HI).map(|at| factor * if is_active(at) { formula(at) } else { background });
    expected.enumerate().map(|(i, v)| (f64::from(volume.value(i)) - v).abs()).fold(0.0, f64::max)
}

#[test]
fn every_type_and_compression_gives_the_formula() {
    let packs = [Pack::None, Pack::Zip, Pack::Blosc(0), Pack::Blosc(300), Pack::Blosc(640), Pack::BloscCopied];
    for (value, as_half) in
        [("float", false), ("double", false), ("half", false), ("float", true), ("double", true), ("int32", false), ("int64", false)]
    {
        for pack in packs {
            for masked in [false, true] {
                let grid = Grid { as_half, pack, masked, ..Grid::new("density", value, tree(5.0)) };
                let volume = open(&file(&[grid]), None).unwrap_or_else(|e| panic!("{value} {as_half} {pack:?} {masked}: {e}"));
                assert_eq!(volume.grid().dims(), [17, 14, 12]);
                assert_eq!(worst(&volume, 5.0, 1.0), 0.0, "{value} {as_half} {pack:?} {masked}");
            }
        }
    }
}

#[test]
fn a_vector_gives_the_named_component() {
    for (value, as_half) in [("vec3s", false), ("vec3d", false), ("vec3i", false), ("vec3s", true)] {
        for pack in [Pack::None, Pack::Zip, Pack::Blosc(0)] {
            let bytes = file(&[Grid { as_half, pack, ..Grid::new("v", value, tree(0.0)) }]);
            for (name, factor) in [("v:0", 1.0), ("v:1", 2.0), ("v:2", -1.0), ("0", 1.0), ("2", -1.0)] {
                assert_eq!(worst(&open(&bytes, Some(name)).unwrap(), 0.0, factor), 0.0, "{value} {pack:?} {name}");
            }
            says(open(&bytes, None), &["it holds 'v' (", "volume.component: v:0, v:1, v:2"]);
            says(open(&bytes, Some("v")), &["volume.component", "'v' is none of", "v:0, v:1, v:2"]);
        }
    }
}

#[test]
fn the_comparison_sees_one_wrong_byte() {
    let good = file(&[Grid::new("density", "float", tree(5.0))]);
    let mut seen = 0;
    for back in [1, 2, 100, 2000] {
        let mut bad = good.clone();
        let at = bad.len() - back;
        bad[at] ^= 0x40;
        seen += usize::from(open(&bad, None).map_or(true, |v| worst(&v, 5.0, 1.0) > 0.0));
    }
    assert_eq!(seen, 4, "values stand at the file's end: each change must show");
}

#[test]
fn inactive_values_follow_from_every_code() {
    let mut tree = Tree::new(2.0);
    // One leaf for each way that inactive values can differ.
    let kinds: [&[f64]; 7] = [&[2.0], &[-2.0], &[9.0], &[2.0, -2.0], &[2.0, 7.0], &[6.0, 7.0], &[4.0, 5.0, 6.0]];
    let value = |[x, y, z]: Ijk| {
        let kinds = kinds[(x / 8) as usize];
        if (x + y + z) % 2 == 0 {
            (f64::from(x * y * z % 31) + 50.0, true)
        } else {
            (kinds[(y as usize + z as usize) % kinds.len()], false)
        }
    };
    for at in each([0; 3], [55, 7, 7]) {
        tree.set(at, value(at).0, value(at).1);
    }
    for pack in [Pack::None, Pack::Zip, Pack::Blosc(0)] {
        for as_half in [false, true] {
            let (bytes, codes) = file_and_codes(&[Grid { pack, as_half, ..Grid::new("d", "float", tree.clone()) }]);
            assert_eq!(codes.into_iter().collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6]);
            let volume = open(&bytes, None).unwrap();
            assert_eq!(volume.grid().dims(), [56, 8, 8]);
            for (i, at) in each([0; 3], [55, 7, 7]).enumerate() {
                assert_eq!(f64::from(volume.value(i)), value(at).0, "{at:?} {pack:?}");
            }
        }
    }
}

#[test]
fn tiles_fill_their_cubes() {
    let mut tree = Tree::new(0.0);
    tree.tiles.push(([-8, 0, 0], 8, 3.0, true));
    tree.tiles.push(([0, 0, 0], 8, 4.0, false));
    tree.tiles.push(([128, 0, 0], 128, 5.0, true));
    tree.set([8, 7, 7], 6.0, true);
    for pack in [Pack::None, Pack::Zip, Pack::Blosc(0)] {
        let volume = open(&file(&[Grid { pack, ..Grid::new("d", "double", tree.clone()) }]), None).unwrap();
        assert_eq!(volume.grid().dims(), [264, 128, 128]);
        for (i, [x, y, z]) in each([-8, 0, 0], [255, 127, 127]).enumerate() {
            let small = y < 8 && z < 8;
            let expected = match x {
                -8..=-1 if small => 3.0,
                0..=7 if small => 4.0,
                8 if (y, z) == (7, 7) => 6.0,
                128.. => 5.0,
                _ => 0.0,
            };
            assert_eq!(volume.value(i), expected, "at {x} {y} {z}");
        }
    }
    // A tile of the root covers 4096³ voxels: said before anything is allocated.
    tree.tiles.push(([4096, 0, 0], 4096, 1.0, true));
    says(open(&file(&[Grid::new("d", "float", tree)]), None), &["8200x4096x4096 float32 samples", "512.5 GiB", "the limit is 16.0 GiB"]);
}

#[test]
fn a_level_set_is_positive_inside() {
    // A ball of radius 20 in a band of 3 voxels; inside, tiles and inactive voxels of minus the background.
    let (r, band) = (20.0, 3.0);
    let mut tree = Tree::new(band);
    let distance = |at: Ijk| at.iter().map(|v| f64::from(v * v)).sum::<f64>().sqrt() - r;
    for block in each([-4; 3], [3; 3]) {
        let origin = block.map(|v| v * 8);
        let all: Vec<(Ijk, f64)> = each(origin, origin.map(|v| v + 7)).map(|at| (at, distance(at))).collect();
        if all.iter().any(|(_, d)| d.abs() < band) {
            all.iter().for_each(|(at, d)| tree.set(*at, d.clamp(-band, band), d.abs() < band));
        } else if all[0].1 < 0.0 {
            tree.tiles.push((origin, 8, -band, false));
        }
    }
    assert!(!tree.tiles.is_empty(), "the ball is hollow: some blocks lie inside");
    for (pack, as_half, tolerance) in [(Pack::Blosc(0), false, 1e-6), (Pack::Zip, true, 2e-3)] {
        let map = ("ScaleTranslateMap", [vec![10.0, 0.0, 0.0], scale_map([0.5; 3])].concat());
        let grid = Grid { class: "level set", pack, as_half, map, ..Grid::new("surface", "float", tree.clone()) };
        let volume = open(&file(&[grid]), None).unwrap();
        let n = volume.grid().dims();
        assert_eq!(n, [45; 3], "the active band ends where the distance is below 3");
        let mut inside = 0.0;
        for (i, at) in each([-22; 3], [22; 3]).enumerate() {
            let expected = -distance(at).clamp(-band, band);
            assert!((f64::from(volume.value(i)) - expected).abs() < tolerance, "{at:?}: {} {expected}", volume.value(i));
            inside += f64::from(u8::from(volume.value(i) >= 0.0));
        }
        let ball = 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
        assert!((inside / ball - 1.0).abs() < 0.01, "{inside} voxels are inside, the ball has {ball}");
        let centre = volume.grid().centre_world();
        assert!((centre.x - 10.0).abs() < 1e-12 && centre.y.abs() < 1e-12, "{centre}");
    }
}

#[test]
fn transforms_place_voxel_centres() {
    let one = |map: &'static str, numbers: Vec<f64>| {
        let grid = Grid { map: (map, numbers), ..Grid::new("d", "float", tree(0.0)) };
        open(&file(&[grid]), None)
    };
    let centre = |v: Volume| v.grid().voxel_to_world().transform_point3(halflight::scene::grid::glam::DVec3::splat(0.5)).to_array();
    let [x, y, z] = LO.map(f64::from);
    let scaled = [vec![1.0, 2.0, 3.0], scale_map([0.5, 2.0, 4.0])].concat();
    assert_eq!(centre(one("UniformScaleMap", scale_map([0.5; 3])).unwrap()), [x * 0.5, y * 0.5, z * 0.5]);
    assert_eq!(centre(one("ScaleMap", scale_map([0.5, 2.0, 4.0])).unwrap()), [x * 0.5, y * 2.0, z * 4.0]);
    for map in ["UniformScaleTranslateMap", "ScaleTranslateMap"] {
        assert_eq!(centre(one(map, scaled.clone()).unwrap()), [x * 0.5 + 1.0, y * 2.0 + 2.0, z * 4.0 + 3.0]);
    }
    assert_eq!(centre(one("TranslationMap", vec![1.0, 2.0, 3.0]).unwrap()), [x + 1.0, y + 2.0, z + 3.0]);
    // Rows are the images of the axes: x → (0, 2, 0), y → (−3, 0, 0), z → (0, 1, 1), origin → (5, 6, 7).
    let affine = vec![0.0, 2.0, 0.0, 0.0, -3.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 5.0, 6.0, 7.0, 1.0];
    assert_eq!(centre(one("AffineMap", affine.clone()).unwrap()), [-3.0 * y + 5.0, 2.0 * x + z + 6.0, z + 7.0]);
    let mut perspective = affine.clone();
    perspective[3] = 0.1;
    says(one("AffineMap", perspective), &["perspective", "linear"]);
    let mut flat = affine;
    flat[8..11].copy_from_slice(&[0.0; 3]);
    says(one("UnitaryMap", flat), &["span no volume"]);
    says(one("ScaleMap", scale_map([f64::NAN; 3])), &["span no volume"]);
    says(one("NonlinearFrustumMap", vec![0.0; 20]), &["frustum", "linear"]);
    says(one("OddMap", vec![]), &["'OddMap'", "affine"]);
}

#[test]
fn grids_are_chosen_by_name() {
    let float = |name, background| Grid::new(name, "float", tree(background));
    let instance = Grid { instance_of: "density", ..float("copy", 0.0) };
    let bytes = file(&[float("density", 1.0), Grid::new("v", "vec3s", tree(0.0)), Grid::new("flag", "bool", Tree::new(0.0)), instance]);
    assert_eq!(worst(&open(&bytes, None).unwrap(), 1.0, 1.0), 0.0, "the only scalar grid");
    assert_eq!(worst(&open(&bytes, Some("density")).unwrap(), 1.0, 1.0), 0.0);
    says(open(&bytes, Some("copy")), &["'copy' (float, an instance)", "'density'"]);
    says(open(&bytes, Some("flag")), &["'flag' (bool)", "not read", "double"]);
    says(open(&bytes, Some("other")), &["'other' is none of", "'density' (float), 'v' (vec3s)", "density, v:0, v:1, v:2"]);
    says(open(&bytes, Some("density:0")), &["'density:0' is none of"]);
    let none = file(&[Grid::new("flag", "bool", Tree::new(0.0))]);
    says(open(&none, None), &["of its grids none is read: 'flag' (bool)", "double"]);
    let two = file(&[float("a", 1.0), float("b", 2.0)]);
    says(open(&two, None), &["it holds 'a' (float), 'b' (float)", "volume.component: a, b"]);
    assert_eq!(worst(&open(&two, Some("b")).unwrap(), 2.0, 1.0), 0.0);
    // Grids of one name, and of none.
    let same = file(&[float("a", 1.0), float("a\u{1e}1", 2.0), float("\u{1e}0", 3.0)]);
    for (name, background) in [("a", 1.0), ("a[1]", 2.0), ("0", 3.0)] {
        assert_eq!(worst(&open(&same, Some(name)).unwrap(), background, 1.0), 0.0, "{name}");
    }
}

#[test]
fn what_is_wrong_is_said() {
    let good = file(&[Grid::new("density", "float", tree(0.0))]);
    let with = |at: usize, bytes: &[u8]| {
        let mut bad = good.clone();
        bad[at..at + bytes.len()].copy_from_slice(bytes);
        open(&bad, None)
    };
    says(with(8, &[221, 0, 0, 0]), &["file format is 221", "222 to 225"]);
    says(with(8, &[9, 1, 0, 0]), &["file format is 265"]);
    // Behind header, uuid and one metadatum: the number of grids.
    let count = 8 + 12 + 1 + 36 + 4 + (4 + 7) + (4 + 6) + (4 + 6);
    says(with(count, &[0; 4]), &["claims 0 grids"]);
    says(with(count, &[0xff; 4]), &["claims -1 grids"]);
    says(with(count, &[2, 0, 0, 0]), &["ends within the description of a grid"]);
    says(
        with(20, &[0]).and(with(count, &[1, 0, 0, 0])).and_then(|_| {
            let mut stream = good.clone();
            stream[20] = 0;
            stream[count] = 2;
            open(&stream, None)
        }),
        &["2 grids stand in a stream"],
    );
    let name = count + 4;
    says(with(name, &[0xff, 0xff, 0xff, 0x7f]), &["the description of a grid at byte", "text of 2147483647 bytes"]);
    let places = name + (4 + 7) + (4 + 16) + 4;
    says(with(places, &[1, 0, 0, 0, 0, 0, 0, 0]), &["grid 0 claims to stand at bytes 1"]);
    says(with(places, &[0, 0, 0, 0, 1, 0, 0, 0]), &["before its own description"]);
    let data = places + 24;
    says(with(data, &[8, 0, 0, 0]), &["its compression is 0x8", "zip, blosc"]);
    says(open(&file(&[Grid::new("d", "float", Tree::new(1.0))]), None), &["'d' (float) has no active voxel"]);
    for end in (0..good.len()).step_by(211).chain([good.len() - 1]) {
        assert!(open(&good[..end], None).is_err(), "cut at {end} of {}", good.len());
    }
    says(open(&good[..good.len() - 1], None), &["ends within the values of a leaf", "cut short"]);
    // NaN and infinity.
    let mut odd = tree(0.0);
    odd.set([0, 124, 4094], f64::NAN, true);
    odd.set([1, 124, 4094], 1e300, true);
    let bytes = file(&[Grid::new("d", "double", odd)]);
    says(open(&bytes, None), &["2 of the samples are not finite", "[7, 4, 4]", "--nan-as"]);
    let dir = Folder::new();
    let path = dir.file("odd.vdb", &[&bytes]);
    assert!(read_volume(&path, &ReadOptions { nan_as: Some(-1.0), ..Default::default() }).is_ok_and(|v| v.range()[0] <= -1.0));
    assert_eq!(halflight::io::describe_file(&path, &ReadOptions::default()).unwrap().not_finite, 2);
    says(read_volume(&path, &ReadOptions { max_bytes: 1000, ..Default::default() }), &["17x14x12 float32 samples", "the limit is 1000 B"]);
}

#[test]
fn damaged_blosc_frames_are_refused() {
    let mut flat = Tree::new(0.0);
    each([0; 3], [7; 3]).for_each(|at| flat.set(at, f64::from(at[0] / 4), true));
    let good = file(&[Grid { pack: Pack::Blosc(0), ..Grid::new("d", "float", flat) }]);
    let at = good.windows(4).rposition(|w| w == [2, 1, 0x21, 4]).expect("a Blosc frame");
    assert!(open(&good, None).is_ok());
    let with = |offset: usize, bytes: &[u8]| {
        let mut bad = good.clone();
        bad[at + offset..at + offset + bytes.len()].copy_from_slice(bytes);
        open(&bad, None)
    };
    says(with(0, &[7]), &["the values of a leaf at byte", "header is odd: version 7"]);
    says(with(2, &[0x25]), &["shuffled by bits"]);
    says(with(2, &[0x81]), &["compressor 4 zstd"]);
    says(with(3, &[0]), &["header is odd"]);
    says(with(4, &[0, 0, 1, 0]), &["65536 bytes where 2048 are wanted"]);
    says(with(8, &[0, 0, 0, 0]), &["header is odd"]);
    says(with(12, &[0xff; 4]), &["header is odd"]);
    says(with(16, &[0xff; 4]), &["begins beyond its frame"]);
    says(with(20, &[0xff; 4]), &["cut short"]);
    says(with(20, &[3, 0, 0, 0]), &["the values of a leaf"]);
}

#[test]
fn real_files_open() {
    // File, grid, active box, sum of the voxels weighted by a hash of their place: as OpenVDB 10.0.1 itself reads them, but for
    // the double grid, which its Python module does not hold.
    let expected = [
        ("bonsai_small.vdb", None, [91, 197, 256], [0.0, 0.0, 0.0], Some(31804.188776431572)),
        ("bonsai_small.vdb", Some("albedo:0"), [91, 197, 256], [0.0, 0.0, 0.0], Some(31804.188776431572)),
        ("bonsai_small.vdb", Some("albedo:1"), [91, 197, 256], [0.0, 0.0, 0.0], Some(0.0)),
        ("smoke_sphere_double.vdb", None, [128, 64, 64], [-64.0, -32.0, 0.0], None),
        (
            "sphere_levelset.vdb",
            None,
            [48, 48, 48],
            [-0.274999993853271, 0.1649999963119626, -0.2249999949708581],
            Some(-825.8084307785724),
        ),
    ];
    for (name, component, dims, first, sum) in expected {
        let path = std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/volumes")).join(name);
        if !path.is_file() {
            println!("skipped: {name} is not here");
            continue;
        }
        let volume = read_volume(&path, &ReadOptions { component: component.map(String::from), ..Default::default() }).unwrap();
        let info = describe(&volume);
        println!(
            "{name}: {:?} spacing {:?} first {:?} range {:?} mean {}",
            info.dims, info.spacing, info.first_centre, info.range, info.mean
        );
        assert_eq!(info.dims, dims, "{name}");
        assert!((0..3).all(|a| (info.first_centre[a] - first[a]).abs() < 1e-9), "{name}: {:?}", info.first_centre);
        if let Some(expected) = sum {
            let sum = weighted(&volume);
            assert!((sum - expected).abs() <= 1e-6 * f64::abs(expected), "{name} {component:?}: {sum}, not {expected}");
        }
    }
}

/// Sum of value times (2654435761·index mod 2³²)/2³²: another order or another place changes it.
fn weighted(volume: &Volume) -> f64 {
    let weight = |i: usize| (i as u64 * 2_654_435_761 % (1 << 32)) as f64 / (1u64 << 32) as f64;
    (0..volume.samples().len()).map(|i| f64::from(volume.value(i)) * weight(i)).sum()
}
