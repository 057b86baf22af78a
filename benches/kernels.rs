//! Time of each kernel, of a whole precompute and of a whole frame, on the demo volume.
//!
//! Group `device` is the time between the timestamps around a kernel's dispatches; where the device has none the group is
//! called `wall without timestamps` and holds the time of the whole call instead. Group `wall` is the time of the call,
//! with uploads and read-back. The element of each throughput is what the header of `glsl/NAME.comp` counts by; the lines
//! printed first say how many taps an element has at most, for nanoseconds per tap.
//!
//! No number without a check: each result is compared with the CPU twin, or a formula, before it is timed.

use criterion::{BenchmarkGroup, Criterion, SamplingMode, Throughput, criterion_group, criterion_main, measurement::WallTime};
use halflight::demo;
use halflight::engine::{Engine, Lit, Medium, Options, Reference as ReferencePicture, ReferenceSettings};
use halflight::record::Record;
use halflight::scene::transfer::{Kind, Reference, Table};
use halflight::scene::visibility::{Cells, Method};
use halflight::scene::{Camera, ImageSettings, Light, Matter, Picture, Probe, Shading, Sky, Surface, Transfer, Visibility, Volume};
use halflight::stages::directions::Directions;
use halflight::stages::raymarch::View;
use halflight::stages::{classify, hierarchical, isosurface, majorant, march, minify, pack, raymarch, relight, sweep, trace, twin};
use std::cell::RefCell;
use std::ops::ControlFlow;
use std::path::Path;
use std::time::{Duration, Instant};

/// Voxels along the demo volume's longer sides.
const SIDE: usize = 96;

/// Directions per cell of the estimators.
const DIRECTIONS: u32 = 64;

/// The picture.
const IMAGE: ImageSettings =
    ImageSettings { width: 512, height: 384, step: 1.0, background: halflight::scene::Background::Transparent, exposure: 0.0, skip: true };

/// Samples of a pixel of the reference renderer.
const TRACED: u32 = 32;

/// The picture that times it: a whole one takes seconds.
const TRACED_IMAGE: ImageSettings = ImageSettings { width: 128, height: 96, ..IMAGE };

/// Half a step of half floats below 1, and room for exp's last bits.
const HALF: f32 = 3e-4;

fn quiet(_: &'static str, _: f32) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Everything that is timed works on this.
struct Bench {
    engine: Engine,
    volume: Volume,
    table: Table,
    dvr: Medium,
    iso: Medium,
    light: Light,
    camera: Camera,
    view: View,
    timed: bool,
    /// What is written into benches/records.
    record: RefCell<Record>,
}

impl Bench {
    fn new() -> Self {
        let engine = Engine::new(&Options::default()).expect("a Vulkan device (on Debian: mesa-vulkan-drivers)");
        let volume = demo::volume(SIDE).expect("the demo volume");
        let uploaded = engine.upload(&volume).expect("upload");
        let matter = demo::dvr().expect("the demo's matter");
        let table = matter.transfer.table(volume.range(), volume.grid());
        let dvr = engine.classify(&uploaded, &matter).expect("classify");
        let iso = engine.classify(&uploaded, &demo::iso().expect("the demo's surface")).expect("classify");
        let camera = demo::camera(volume.grid());
        let view = View::new(volume.grid(), &camera.rays(volume.grid(), IMAGE.width, IMAGE.height).expect("rays"));
        engine.read_pyramid(&dvr, &Visibility::default()).expect("pyramid");
        let timed = engine.take_timings().iter().all(|s| s.timed);
        let light = Light::from_probe(&Probe::two_colored());
        let record = RefCell::new(Record::new("kernels", engine.device()));
        Self { engine, volume, table, dvr, iso, light, camera, view, timed, record }
    }

    fn settings(&self, method: Method) -> Visibility {
        Visibility { method, directions: DIRECTIONS, cells: Cells::All, ..Visibility::default() }
    }

    fn field_dims(&self) -> [usize; 3] {
        self.volume.grid().field_dims(Visibility::default().ratio as usize)
    }

    fn cells(&self) -> Vec<u32> {
        (0..self.field_dims().iter().product::<usize>() as u32).collect()
    }

    /// Some cells all over the field.
    fn probes(&self) -> Vec<u32> {
        let count = self.cells().len();
        (0..12).map(|i| ((2 * i + 1) * count / 24) as u32).collect()
    }

    fn estimate(&self, settings: &Visibility, cells: &[u32]) -> Vec<[f32; 16]> {
        self.engine.estimate(&self.dvr, settings, cells, &mut quiet).expect("estimate")
    }

    fn lit(&self, medium: &Medium, light: &Light) -> Lit {
        let field = self.engine.precompute(medium, &self.settings(Method::Hierarchical), &mut quiet).expect("precompute");
        self.engine.relight(&field, light).expect("relight")
    }

    fn render(&self, medium: &Medium, lit: &Lit) -> Picture {
        self.engine.render(medium, lit, &self.camera, &IMAGE, &mut quiet).expect("render")
    }

    /// A grid of pixels all over the picture.
    fn pixels(&self) -> impl Iterator<Item = [usize; 2]> {
        (0..12 * 16).map(|i| [(2 * (i % 16) + 1) * IMAGE.width / 32, (2 * (i / 16) + 1) * IMAGE.height / 24])
    }

    /// Times `call`: device seconds of `kernels` (all where none is named), or wall seconds.
    fn time(&self, group: &mut BenchmarkGroup<'_, WallTime>, device: bool, kernels: &[&str], name: &str, elements: usize, call: impl Fn()) {
        group.throughput(Throughput::Elements(elements as u64));
        let mut runs = Vec::new();
        group.bench_function(name, |b| {
            b.iter_custom(|iterations| {
                self.engine.take_timings();
                let start = Instant::now();
                for _ in 0..iterations {
                    call();
                }
                if !(device && self.timed) {
                    let wall = start.elapsed();
                    runs.push(wall.as_secs_f64() / iterations as f64);
                    return wall;
                }
                let spans = self.engine.take_timings();
                let seconds: f64 = spans.iter().filter(|s| kernels.is_empty() || kernels.contains(&s.kernel)).map(|s| s.seconds).sum();
                assert!(seconds > 0.0, "{name}: no time was measured among {spans:?}");
                runs.push(seconds / iterations as f64);
                Duration::from_secs_f64(seconds)
            });
        });
        // The first run warms up.
        let runs = if runs.len() > 1 { runs.split_off(1) } else { runs };
        let what = if device && self.timed { "device" } else { "wall" };
        self.record.borrow_mut().add(format!("{name}: {what} time of {elements}"), "s", runs);
    }
}

/// Fails with what differs, before anything is timed.
fn agree(name: &str, got: &[f32], expected: &[f32], tolerance: f32) {
    assert!(got.len() == expected.len() && !got.is_empty(), "{name}: {} results for {}", got.len(), expected.len());
    let wrong = got.iter().zip(expected).position(|(g, e)| g.is_nan() || (g - e).abs() > tolerance * (1.0 + e.abs()));
    assert!(wrong.is_none(), "{name}: {} instead of {} at {}", got[wrong.unwrap_or(0)], expected[wrong.unwrap_or(0)], wrong.unwrap_or(0));
}

fn check_pyramid(b: &Bench) {
    let settings = b.settings(Method::Hierarchical);
    let levels = b.engine.read_pyramid(&b.dvr, &settings).expect("pyramid");
    agree("classify", &levels[0], &classify::reference(&b.volume, &b.table), HALF);
    let mut dims = b.volume.grid().dims().map(|n| n as u32);
    for k in 1..levels.len() {
        let (twin, coarse) = minify::reference(&levels[k - 1], dims, settings.filter);
        agree("minify", &levels[k], &twin, HALF);
        dims = coarse;
    }
}

fn check_estimators(b: &Bench) {
    let grid = b.volume.grid();
    let (dims, cells) = (b.field_dims(), b.probes());
    let set = Directions::new(DIRECTIONS, Visibility::default().sampling, grid);
    // Single precision along some hundred steps.
    let tolerance = 2e-3;
    let settings = b.settings(Method::March);
    let twin = march::reference(&b.volume, &b.table, dims, &cells, &set, f64::from(settings.step) * grid.voxel_length());
    agree("march", b.estimate(&settings, &cells).as_flattened(), twin.as_flattened(), tolerance);
    let settings = b.settings(Method::Hierarchical);
    let pyramid = b.engine.read_pyramid(&b.dvr, &settings).expect("pyramid");
    let twin = hierarchical::reference(grid, &pyramid, dims, &cells, &set, settings.growth);
    agree("hierarchical", b.estimate(&settings, &cells).as_flattened(), twin.as_flattened(), tolerance);
    let settings = b.settings(Method::Sweep);
    let all = {
        let rays = sweep::rays(settings.directions, grid);
        let step_length = f64::from(settings.step) * grid.voxel_length();
        sweep::reference(&b.volume, &b.table, dims, &rays, sweep::Settings { near: settings.near, step_length })
    };
    let twin: Vec<[f32; 16]> = cells.iter().map(|&c| all[c as usize]).collect();
    agree("sweep", b.estimate(&settings, &cells).as_flattened(), twin.as_flattened(), tolerance);
}

/// The packed field against the twin's packing of the estimates.
fn check_field(b: &Bench, settings: &Visibility) {
    let field = b.engine.precompute(&b.dvr, settings, &mut quiet).expect("precompute");
    let read = b.engine.read_field(&field).expect("read");
    let cells = b.probes();
    let v = b.estimate(settings, &cells);
    for (&cell, v) in cells.iter().zip(&v) {
        let twin = pack::decode(&pack::reference(v, settings.bands, settings.bits, false), settings.bits, false);
        for (i, expected) in twin.iter().enumerate() {
            // At a tie the last bit of the device's division may round the other way: one code.
            let code = 2.0 * halflight::kernels::constants::PACK_RANGE[i] / 254.0;
            agree("pack", &[read[cell as usize * 16 + i]], &[*expected], 1.01 * code);
        }
    }
}

fn check_relight(b: &Bench) {
    let field = b.engine.precompute(&b.dvr, &b.settings(Method::Hierarchical), &mut quiet).expect("precompute");
    let read = b.engine.read_field(&field).expect("read");
    let lit = b.engine.relight(&field, &b.light).expect("relight");
    let got = b.engine.read_irradiance(&lit).expect("read");
    for &cell in &b.probes() {
        let v = std::array::from_fn(|i| read[cell as usize * 16 + i]);
        agree("relight", &got[cell as usize], &relight::reference(&v, &b.light.to_f32()), 1e-3);
    }
}

fn check_raymarch(b: &Bench, lit: &Lit) {
    let cells = b.engine.read_irradiance(lit).expect("read");
    let (dims, n) = (b.field_dims(), b.volume.grid().dims());
    let light_at = |p: [f32; 3]| -> [f32; 3] {
        let q = std::array::from_fn(|a| p[a] / n[a] as f32 * dims[a] as f32);
        std::array::from_fn(|c| twin::trilinear(dims, q, |i| cells[i[0] + dims[0] * (i[1] + dims[1] * i[2])][c]))
    };
    let picture = b.render(&b.dvr, lit);
    for pixel in b.pixels() {
        let [r, g, blue, depth] = raymarch::reference(&b.volume, &b.table, &b.view, pixel, b.volume.grid().voxel_length(), light_at);
        // A ray may end one step earlier (1e-3 of what is left).
        agree("raymarch", &picture.rgba[pixel[0] + IMAGE.width * pixel[1]], &[r, g, blue, -(-depth).exp_m1()], 2e-3);
    }
}

/// The hits against the twin's; their shading, where the field is a vacuum's, against quadrature over the sphere.
fn check_isosurface(b: &Bench) {
    let nothing = Transfer::from_points(&[[0.0, 0.5, 0.5, 0.5, 0.0]], Kind::Extinction, Reference::World).expect("a transfer function");
    let uploaded = b.engine.upload(&b.volume).expect("upload");
    let vacuum = b.engine.classify(&uploaded, &Matter { transfer: nothing, surface: None }).expect("classify");
    let settings = b.settings(Method::March);
    let field = b.engine.precompute(&vacuum, &settings, &mut quiet).expect("precompute");
    let read = b.engine.read_field(&field).expect("read");
    let v = std::array::from_fn(|i| read[i]);
    let lit = b.engine.relight(&field, &b.light).expect("relight");
    let (picture, distance) = b.engine.render_with_distance(&b.iso, &lit, &b.camera, &IMAGE, &mut quiet).expect("render");
    let surface: Surface = demo::iso().expect("the demo's surface").surface.expect("a surface");
    let (mut hits, mut shaded) = (0, 0);
    for pixel in b.pixels() {
        let at = pixel[0] + IMAGE.width * pixel[1];
        let hit = isosurface::reference_hit(&b.volume, demo::ISO as f32, &b.view, pixel, b.volume.grid().voxel_length());
        agree("isosurface, distance", &[distance[at]], &[hit.map_or(-1.0, |h| h.distance)], 1e-4);
        hits += usize::from(hit.is_some());
        if let Some(normal) = hit.and_then(|h| h.normal)
            && shaded < 8
        {
            let albedo = surface.albedo.expect("an albedo");
            let expected = isosurface::reference_radiance(&v, &b.light, albedo, normal, Shading::Lambert);
            agree("isosurface, radiance", &picture.rgba[at][..3], &expected, 0.02);
            shaded += 1;
        }
    }
    assert!(hits > 20 && shaded > 4, "isosurface: {hits} hits, {shaded} shaded");
}

/// The reference picture of few samples.
fn traced(b: &Bench, image: &ImageSettings) -> ReferencePicture {
    let sky = Sky::from_probe(&Probe::two_colored());
    let settings = ReferenceSettings { samples: TRACED, error: 0.0, ..ReferenceSettings::default() };
    b.engine.render_reference(&b.dvr, &sky, &b.camera, image, &settings, &mut quiet).expect("reference picture")
}

/// Sample by sample the twin's; where a rounded number lets one of them take another way, it is the pixel that differs.
fn check_trace(b: &Bench) {
    agree("majorant", &b.engine.read_majorants(&b.dvr).expect("majorants"), &majorant::reference(&b.volume, &b.table), 1e-3);
    let (sky, majorants, picture) =
        (Sky::from_probe(&Probe::two_colored()), majorant::reference(&b.volume, &b.table), traced(b, &IMAGE).picture);
    let scene = trace::Twin {
        volume: &b.volume,
        table: &b.table,
        majorants: &majorants,
        sky: &sky,
        view: &b.view,
        width: IMAGE.width,
        seed: 0,
        surface: None,
    };
    let (mut near, mut count) = (0, 0);
    for pixel in b.pixels() {
        let mut mean = [0f32; 4];
        for s in 0..TRACED {
            let l = trace::reference(&scene, pixel, s);
            (0..4).for_each(|c| mean[c] += l[c] / TRACED as f32);
        }
        let got = picture.rgba[pixel[0] + IMAGE.width * pixel[1]];
        count += 1;
        near += usize::from((0..4).all(|c| (got[c] - mean[c]).abs() < 2e-3 * (0.1 + mean[c])));
    }
    assert!(near * 20 > count * 19, "trace: {near} of {count} pixels equal the twin's");
}

/// Says how many taps the elements have at most: rays that end in the dark take fewer.
fn print_taps(b: &Bench) {
    let grid = b.volume.grid();
    let n = grid.dims();
    let set = Directions::new(DIRECTIONS, Visibility::default().sampling, grid);
    let cells = b.cells();
    let (mut dense, mut growing) = (0u64, 0u64);
    let voxel = grid.voxel_length();
    for &cell in &cells {
        let x = twin::cell_centre(grid, b.field_dims(), cell);
        for d in &set.table {
            let end = f64::from(twin::exit_distance(x, [d.voxel[0], d.voxel[1], d.voxel[2]], n));
            dense += march::max_steps(end, voxel) - 1;
            growing += hierarchical::max_steps(end / voxel, f64::from(Visibility::default().growth));
        }
    }
    let rays = (cells.len() * set.table.len()) as f64;
    let mut steps = 0.0;
    for j in 0..IMAGE.height {
        for i in 0..IMAGE.width {
            let (enter, leave) = twin::box_span(b.view.origin, b.view.direction(i, j), n);
            steps += (f64::from(leave - enter.max(0.0)) / voxel).ceil().max(0.0);
        }
    }
    let info = b.engine.device();
    println!("{}, {}; demo volume of {}x{}x{} voxels", info.name, info.driver, n[0], n[1], n[2]);
    println!("march: at most {:.1} trilinear taps per cell and direction", dense as f64 / rays);
    println!("hierarchical: at most {:.1} quadrilinear taps per cell and direction", growing as f64 / rays);
    println!("raymarch, isosurface: at most {:.1} steps per pixel", steps / (IMAGE.width * IMAGE.height) as f64);
}

fn configure(group: &mut BenchmarkGroup<'_, WallTime>) {
    group.sample_size(10).sampling_mode(SamplingMode::Flat);
    group.warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(3));
}

fn benches(c: &mut Criterion) {
    let b = Bench::new();
    let (march, hierarchical) = (b.settings(Method::March), b.settings(Method::Hierarchical));
    let swept = b.settings(Method::Sweep);
    // One direction leaves little to do but packing.
    let once = Visibility { directions: 1, ..hierarchical.clone() };
    check_pyramid(&b);
    check_estimators(&b);
    check_field(&b, &once);
    check_field(&b, &hierarchical);
    check_relight(&b);
    let dvr = b.lit(&b.dvr, &b.light);
    check_raymarch(&b, &dvr);
    check_isosurface(&b);
    check_trace(&b);
    let iso = b.lit(&b.iso, &b.light);
    println!("all results agree with their twins");
    print_taps(&b);

    let cells = b.cells();
    let (voxels, rays, pixels) = (b.volume.grid().voxels() as usize, cells.len() * DIRECTIONS as usize, IMAGE.width * IMAGE.height);
    let samples = TRACED_IMAGE.width * TRACED_IMAGE.height * TRACED as usize;
    let field = b.engine.precompute(&b.dvr, &hierarchical, &mut quiet).expect("precompute");
    let precompute = |s: &Visibility| drop(b.engine.precompute(&b.dvr, s, &mut quiet).expect("precompute"));
    let frame = || {
        let lit = b.engine.relight(&field, &b.light).expect("relight");
        b.render(&b.dvr, &lit);
    };

    let mut group = c.benchmark_group(if b.timed { "device" } else { "wall without timestamps" });
    configure(&mut group);
    let g = &mut group;
    let pyramid = || drop(b.engine.read_pyramid(&b.dvr, &hierarchical).expect("pyramid"));
    b.time(g, true, &["classify"], "classify, voxels", voxels, pyramid);
    b.time(g, true, &["classify", "minify"], "pyramid, voxels", voxels, pyramid);
    b.time(g, true, &["march"], "march, cells x directions", rays, || drop(b.estimate(&march, &cells)));
    b.time(g, true, &["hierarchical"], "hierarchical, cells x directions", rays, || drop(b.estimate(&hierarchical, &cells)));
    b.time(g, true, &["sweep"], "sweep, cells x directions", rays, || drop(b.estimate(&swept, &cells)));
    b.time(g, true, &["pack"], "pack, cells", cells.len(), || precompute(&once));
    let relight = || drop(b.engine.relight(&field, &b.light).expect("relight"));
    b.time(g, true, &["relight"], "relight, cells", cells.len(), relight);
    b.time(g, true, &["raymarch"], "raymarch, pixels", pixels, || drop(b.render(&b.dvr, &dvr)));
    b.time(g, true, &["isosurface"], "isosurface, pixels", pixels, || drop(b.render(&b.iso, &iso)));
    b.time(g, true, &["majorant"], "majorant, voxels", voxels, || drop(b.engine.read_majorants(&b.dvr).expect("majorants")));
    b.time(g, true, &["trace"], "trace, pixels x samples", samples, || drop(traced(&b, &TRACED_IMAGE)));
    b.time(g, true, &[], "precompute, cells x directions", rays, || precompute(&hierarchical));
    b.time(g, true, &[], "frame, pixels", pixels, frame);
    group.finish();

    let mut group = c.benchmark_group("wall");
    configure(&mut group);
    b.time(&mut group, false, &[], "precompute, cells x directions", rays, || precompute(&hierarchical));
    b.time(&mut group, false, &[], "frame, pixels", pixels, frame);
    group.finish();

    // `cargo bench` says --bench; a test run leaves nothing behind.
    let record = b.record.borrow();
    if std::env::args().any(|a| a == "--bench") && !record.figures.is_empty() {
        let path = record.write(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/benches/records"))).expect("a record");
        println!("wrote {}", path.display());
    }
}

criterion_group!(all, benches);
criterion_main!(all);
