//! Dispatches: what kernels get and give, and that the ledger refuses each kind of missing barrier while the same code with the
//! barrier runs clean.

use halflight::Error;
use halflight::kernels::{canary, test_buffers, test_sample, test_store};
use halflight::vk::{Access, Buffer, Device, Format, Image, ImageDesc, Options, Recorder};

fn open() -> Device {
    Device::new(&Options { validation: true, ..Options::default() }).expect("a device with the validation layer")
}

fn clean(device: &Device) {
    assert_eq!(device.validation_errors(), Vec::<String>::new());
}

fn hazard<T>(result: Result<T, Error>) -> (&'static str, String) {
    match result {
        Err(Error::Hazard { binding, had, needs, .. }) => (binding, format!("{had} -> {needs}")),
        Err(other) => panic!("no hazard: {other}"),
        Ok(_) => panic!("the ledger let it pass"),
    }
}

const N: usize = 1000;
const ONES: test_buffers::Params = test_buffers::Params { offset: [1.0, 10.0, 100.0], count: N as u32, pair: [3, 4], weights: [0.5, 0.25] };

struct Three {
    source: Buffer,
    target: Buffer,
    total: Buffer,
}

impl Three {
    fn new(device: &Device) -> Self {
        let data: Vec<f32> = (0..N).map(|i| i as f32).collect();
        Self {
            source: device.buffer_from("source", &data).unwrap(),
            target: device.buffer::<f32>("target", N).unwrap(),
            total: device.buffer_from("total", &vec![5_u32; N]).unwrap(),
        }
    }

    fn run(&self, rec: &mut Recorder, spec: &test_buffers::Spec) -> halflight::Result<()> {
        let bindings = test_buffers::Bindings { source: &self.source, target: &self.target, total: &self.total };
        rec.dispatch(&bindings, spec, &ONES, [N as u32, 1, 1])
    }

    /// After `write`, before the first run.
    fn ready(&self, rec: &mut Recorder) {
        rec.barrier(&[self.total.all().from(Access::ComputeRead).to(Access::ComputeReadWrite)]);
    }

    /// Between two runs.
    fn again(&self, rec: &mut Recorder) {
        rec.barrier(&[
            self.target.all().from(Access::ComputeWrite).to(Access::ComputeWrite),
            self.total.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite),
        ]);
    }
}

/// What the kernel computes, by its text.
fn expected(i: usize, spec: &test_buffers::Spec) -> f32 {
    let value = (i as f32 + 1.0 + 20.0 + 400.0) * spec.factor as f32 * spec.scale + (spec.shift + 12) as f32 + 0.25;
    if spec.negate { -value } else { value }
}

#[test]
fn parameters_and_specialization_arrive() {
    let device = open();
    let special = test_buffers::Spec { factor: 3, shift: -20, scale: 0.25, negate: true };
    for spec in [test_buffers::Spec::default(), special] {
        let three = Three::new(&device);
        let mut rec = device.record().unwrap();
        three.ready(&mut rec);
        three.run(&mut rec, &spec).unwrap();
        three.again(&mut rec);
        three.run(&mut rec, &spec).unwrap();
        rec.submit().unwrap();
        let values = device.read::<f32>(&three.target, N).unwrap();
        for (i, value) in values.iter().enumerate() {
            assert!((value - expected(i, &spec)).abs() < 1e-3, "{i}: {value}");
        }
        assert_eq!(device.read::<u32>(&three.total, N).unwrap(), vec![7; N]);
    }
    // Sabotage: the two settings do differ.
    assert!((expected(7, &special) - expected(7, &test_buffers::Spec::default())).abs() > 1.0);
    clean(&device);
}

#[test]
fn every_buffer_hazard_is_refused_and_its_barrier_heals_it() {
    let device = open();
    let spec = test_buffers::Spec::default();

    // Announced as readable, wanted for both.
    let three = Three::new(&device);
    let mut rec = device.record().unwrap();
    let (binding, text) = hazard(three.run(&mut rec, &spec));
    assert_eq!(binding, "total", "{text}");
    // Refused dispatches leave no trace: with the barrier the same recorder goes on.
    three.ready(&mut rec);
    three.run(&mut rec, &spec).unwrap();

    // Write after write, and read-write twice (the validation layer's blind spot).
    assert_eq!(hazard(three.run(&mut rec, &spec)).0, "target");
    rec.barrier(&[three.target.all().from(Access::ComputeWrite).to(Access::ComputeWrite)]);
    assert_eq!(hazard(three.run(&mut rec, &spec)).0, "total");
    rec.barrier(&[three.total.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
    three.run(&mut rec, &spec).unwrap();

    // Read after write: the target becomes a source.
    let next = Three { source: three.target.clone(), target: device.buffer::<f32>("next", N).unwrap(), total: Three::new(&device).total };
    next.ready(&mut rec);
    assert_eq!(hazard(next.run(&mut rec, &spec)).0, "source");
    rec.barrier(&[three.target.all().from(Access::ComputeWrite).to(Access::ComputeRead)]);
    next.run(&mut rec, &spec).unwrap();

    // Write after read: the first source becomes a target.
    let back = Three { source: three.target.clone(), target: three.source.clone(), total: Three::new(&device).total };
    back.ready(&mut rec);
    assert_eq!(hazard(back.run(&mut rec, &spec)).0, "target");
    rec.barrier(&[three.source.all().from(Access::ComputeRead).to(Access::ComputeWrite)]);
    back.run(&mut rec, &spec).unwrap();

    // One buffer in two roles of one dispatch.
    let twice = Three { source: next.target.clone(), target: next.target.clone(), total: Three::new(&device).total };
    rec.barrier(&[next.target.all().from(Access::ComputeWrite).to(Access::ComputeReadWrite)]);
    twice.ready(&mut rec);
    hazard(twice.run(&mut rec, &spec));
    rec.submit().unwrap();

    // The record outlives the recorder.
    let mut rec = device.record().unwrap();
    assert_eq!(hazard(three.run(&mut rec, &spec)).0, "target");
    clean(&device);
}

#[test]
fn wrong_barriers_are_told() {
    let device = open();
    let three = Three::new(&device);
    let mut rec = device.record().unwrap();
    rec.barrier(&[three.total.all().from(Access::ComputeWrite).to(Access::ComputeReadWrite)]);
    let (_, text) = hazard(three.run(&mut rec, &test_buffers::Spec::default()));
    assert!(text.contains("ComputeRead") && text.contains("'total'") && text.contains("ComputeWrite"), "{text}");
    let mut rec = device.record().unwrap();
    rec.barrier(&[three.source.all().from(Access::None).to(Access::ComputeRead)]);
    hazard(rec.submit());
    clean(&device);
}

#[test]
fn recorders_that_cross_are_refused_where_it_matters() {
    let device = open();
    let spec = test_buffers::Spec::default();
    let one = Three::new(&device);
    let other = Three { source: one.source.clone(), ..Three::new(&device) };
    let (mut a, mut b) = (device.record().unwrap(), device.record().unwrap());
    for (rec, three) in [(&mut a, &one), (&mut b, &other)] {
        three.ready(rec);
        three.run(rec, &spec).unwrap();
    }
    a.submit().unwrap();
    b.submit().unwrap();
    let (mut a, mut b) = (device.record().unwrap(), device.record().unwrap());
    for rec in [&mut a, &mut b] {
        one.again(rec);
        one.run(rec, &spec).unwrap();
    }
    // One leaves the buffer as the other found it: nothing is amiss. Sabotage: it does not.
    a.submit().unwrap();
    b.submit().unwrap();
    let (mut a, mut b) = (device.record().unwrap(), device.record().unwrap());
    for rec in [&mut a, &mut b] {
        one.again(rec);
        one.run(rec, &spec).unwrap();
    }
    a.barrier(&[one.target.all().from(Access::ComputeWrite).to(Access::ComputeRead)]);
    a.submit().unwrap();
    hazard(b.submit());
    clean(&device);
}

#[test]
fn fills_are_in_the_ledger_too() {
    let device = open();
    let buffer = device.buffer::<u32>("filled", 9).unwrap();
    let mut rec = device.record().unwrap();
    rec.fill(&buffer, 7).unwrap();
    hazard(rec.fill(&buffer, 8));
    rec.barrier(&[buffer.all().from(Access::TransferWrite).to(Access::ComputeRead)]);
    rec.submit().unwrap();
    assert_eq!(device.read::<u32>(&buffer, 9).unwrap(), [7; 9]);
    clean(&device);
}

fn texels(device: &Device, levels: u32) -> Image {
    let desc = ImageDesc { name: "texels", dims: [6, 4, 3], levels, format: Format::R32Uint, views: &[Format::Rgba8Unorm], storage: true };
    device.image3(&desc).unwrap()
}

fn store(rec: &mut Recorder, image: &Image, level: u32, first: u32) -> halflight::Result<()> {
    rec.dispatch(&test_store::Bindings { texels: image.storage(level) }, &(), &test_store::Params { first }, image.level_dims(level))
}

/// One sample of `image`, and the first texel of `other`.
fn sample(device: &Device, image: halflight::vk::Sampled<'_>, other: &Image, position: [f32; 3], lod: f32) -> [[f32; 4]; 2] {
    let out = device.buffer::<f32>("sample", 8).unwrap();
    let mut rec = device.record().unwrap();
    let bindings = test_sample::Bindings { image, texels: other.storage(0), sampled: &out };
    rec.dispatch(&bindings, &(), &test_sample::Params { position, lod }, [1, 1, 1]).unwrap();
    rec.submit().unwrap();
    let back = device.read::<f32>(&out, 8).unwrap();
    [[back[0], back[1], back[2], back[3]], [back[4], back[5], back[6], back[7]]]
}

#[test]
fn integers_written_by_a_kernel_are_filtered_as_bytes() {
    let device = open();
    let (image, other) = (texels(&device, 2), texels(&device, 1));
    let mut rec = device.record().unwrap();
    // Undefined layout: the kernel may not write yet.
    hazard(store(&mut rec, &image, 0, 10));
    rec.barrier(&[image.all().from(Access::None).to(Access::ComputeWrite), other.all().from(Access::None).to(Access::ComputeWrite)]);
    store(&mut rec, &image, 0, 10).unwrap();
    store(&mut rec, &image, 1, 100).unwrap();
    store(&mut rec, &other, 0, 1).unwrap();
    rec.barrier(&[
        image.mip(0).from(Access::ComputeWrite).to(Access::ComputeRead),
        other.all().from(Access::ComputeWrite).to(Access::ComputeReadWrite),
    ]);
    // Level 1 is not announced: the whole chain cannot be sampled, its level 0 can.
    let out = device.buffer::<f32>("sample", 8).unwrap();
    let bind = |image| test_sample::Bindings { image, texels: other.storage(0), sampled: &out };
    let at = test_sample::Params { position: [0.5; 3], lod: 0.0 };
    let (binding, text) = hazard(rec.dispatch(&bind(image.sampled_as(Format::Rgba8Unorm)), &(), &at, [1, 1, 1]));
    assert!(binding == "image" && text.contains("level 1"), "{text}");
    rec.barrier(&[image.mip(1).from(Access::ComputeWrite).to(Access::ComputeRead)]);
    rec.dispatch(&bind(image.sampled_as(Format::Rgba8Unorm)), &(), &at, [1, 1, 1]).unwrap();
    rec.submit().unwrap();

    assert!(device.supports_filtering(Format::Rgba8Unorm));
    // Half way between texels 2 and 3 of six: bytes 12.5, 13.5, ...; the filter itself may round to 8 bits.
    let [value, loaded] = sample(&device, image.sampled_as(Format::Rgba8Unorm), &other, [0.5; 3], 0.0);
    for (c, value) in value.iter().enumerate() {
        assert!((value * 255.0 - (12.5 + c as f32)).abs() < 1.01, "{c}: {}", value * 255.0);
    }
    let word = 1.0 + 2.0 * 256.0 + 3.0 * 65536.0 + 4.0 * 16_777_216.0;
    assert_eq!(loaded[0], word as f32);
    // Sabotage: the level above is told apart.
    let [off, _] = sample(&device, image.sampled_as(Format::Rgba8Unorm), &other, [0.5; 3], 1.0);
    assert!((off[0] * 255.0 - 12.5).abs() > 50.0);
    // Nearest gives texel 3 (the centre of 0.55 of six texels) exactly.
    let [near, _] = sample(&device, image.sampled_as(Format::Rgba8Unorm).as_nearest(), &other, [0.55, 0.5, 0.5], 0.0);
    assert!((near[0] * 255.0 - 13.0).abs() < 1e-3, "{}", near[0] * 255.0);
    // The memory itself.
    let bytes = device.read_image(&image, 0).unwrap();
    assert_eq!(bytes[..8], [10, 11, 12, 13, 11, 12, 13, 14]);
    clean(&device);
}

#[test]
fn image_hazards_and_misuse_are_refused() {
    let device = open();
    let image = texels(&device, 1);
    let mut rec = device.record().unwrap();
    rec.barrier(&[image.all().from(Access::None).to(Access::ComputeWrite)]);
    store(&mut rec, &image, 0, 1).unwrap();
    assert!(hazard(store(&mut rec, &image, 0, 2)).1.contains("written since"));
    rec.barrier(&[image.all().from(Access::ComputeWrite).to(Access::ComputeWrite)]);
    store(&mut rec, &image, 0, 2).unwrap();
    // Readable is another layout than writable.
    rec.barrier(&[image.all().from(Access::ComputeWrite).to(Access::ComputeRead)]);
    hazard(store(&mut rec, &image, 0, 3));
    assert!(matches!(store(&mut rec, &image, 1, 3), Err(Error::Invalid { .. })), "there is no level 1");
    rec.barrier(&[image.mip(1).from(Access::None).to(Access::ComputeRead)]);
    assert!(matches!(rec.submit(), Err(Error::Invalid { .. })));

    let plain =
        device.image3(&ImageDesc { name: "plain", dims: [2; 3], levels: 1, format: Format::R32Uint, views: &[], storage: false }).unwrap();
    let mut rec = device.record().unwrap();
    assert!(matches!(store(&mut rec, &plain, 0, 3), Err(Error::Invalid { .. })), "made without storage");
    assert!(matches!(store(&mut open().record().unwrap(), &image, 0, 3), Err(Error::Invalid { .. })), "another device's image");
    clean(&device);
}

#[test]
fn time_is_kept_per_kernel_in_order() {
    let device = open();
    assert_eq!(device.take_timings(), [], "the start-up test is not the caller's");
    let three = Three::new(&device);
    let counted = device.buffer::<u32>("counted", 2).unwrap();
    let mut rec = device.record().unwrap();
    three.ready(&mut rec);
    // More dispatches than one pool of timestamps, descriptor sets or descriptors holds.
    for _ in 0..300 {
        three.run(&mut rec, &test_buffers::Spec::default()).unwrap();
        three.again(&mut rec);
    }
    rec.dispatch(&canary::Bindings { counted: &counted }, &(), &canary::Params { trips: 50_000 }, [1, 1, 1]).unwrap();
    rec.submit().unwrap();
    let spans = device.take_timings();
    let calls: Vec<_> = spans.iter().map(|s| (s.kernel, s.calls)).collect();
    assert_eq!(calls, [("test_buffers", 300), ("canary", 1)]);
    assert!(spans.iter().all(|s| !s.timed || (s.seconds > 0.0 && s.seconds < 60.0)), "{spans:?}");
    assert_eq!(device.take_timings(), []);
    assert_eq!(device.read::<u32>(&three.total, 1).unwrap(), [305]);
    clean(&device);
}

#[test]
fn loops_run_to_the_stated_limit() {
    let device = open();
    let trips = device.loop_limit();
    assert!(trips >= 1000);
    let counted = device.buffer::<u32>("counted", 2).unwrap();
    let mut rec = device.record().unwrap();
    rec.dispatch(&canary::Bindings { counted: &counted }, &(), &canary::Params { trips }, [1, 1, 1]).unwrap();
    rec.submit().unwrap();
    assert_eq!(device.read::<u32>(&counted, 1).unwrap(), [trips]);
    clean(&device);
}

#[test]
fn too_many_or_no_work_groups_are_refused() {
    let device = open();
    let counted = device.buffer::<u32>("counted", 2).unwrap();
    let mut rec = device.record().unwrap();
    for threads in [[0, 1, 1], [1, u32::MAX, 1]] {
        let error = rec.dispatch(&canary::Bindings { counted: &counted }, &(), &canary::Params { trips: 1 }, threads);
        assert!(matches!(error, Err(Error::Invalid { .. })));
    }
}

#[test]
fn validation_errors_are_heard() {
    // Sabotage of `clean`: an image of floats where the kernel stores integers is beyond what the runtime checks.
    let device = open();
    let image = device
        .image3(&ImageDesc { name: "floats", dims: [4; 3], levels: 1, format: Format::R32Sfloat, views: &[], storage: true })
        .unwrap();
    let mut rec = device.record().unwrap();
    rec.barrier(&[image.all().from(Access::None).to(Access::ComputeWrite)]);
    store(&mut rec, &image, 0, 1).unwrap();
    rec.submit().unwrap();
    assert!(!device.validation_errors().is_empty());
}

#[test]
fn what_another_device_made_is_refused_everywhere() {
    let (device, other) = (open(), open());
    let words = device.buffer_from("words", &[7u32; 16]).unwrap();
    let image = texels(&device, 1);
    let refused = |result: halflight::Result<()>| match result {
        Err(Error::Invalid { what, .. }) => assert!(what.contains("another device"), "{what}"),
        other => panic!("{other:?}"),
    };
    refused(other.write(&words, &[1u32]));
    refused(other.read::<u32>(&words, 1).map(drop));
    refused(other.read_into(&words, &mut [0u32; 4]));
    refused(other.write_image(&image, 0, &mut |_, _| panic!("nothing is to be filled")));
    refused(other.read_image(&image, 0).map(drop));
    refused(other.record().unwrap().fill(&words, 0));
    let barriers =
        [words.all().from(Access::ComputeRead).to(Access::TransferWrite), image.all().from(Access::None).to(Access::ComputeWrite)];
    for barrier in barriers {
        let mut rec = other.record().unwrap();
        rec.barrier(&[barrier]);
        refused(rec.submit());
    }
    // All of it is well on its own device, and nothing was touched.
    assert_eq!(device.read::<u32>(&words, 16).unwrap(), [7; 16]);
    clean(&device);
    clean(&other);
}

/// Reading an image changes its layout until it is done: another thread's kernel, which samples it, waits.
#[test]
fn threads_read_and_sample_one_image() {
    let device = open();
    let (dims, texel) = ([128, 128, 64], 16);
    let desc = ImageDesc { name: "shared", dims, levels: 1, format: Format::Rgba32Sfloat, views: &[], storage: false };
    let image = device.image3(&desc).unwrap();
    device
        .write_image(&image, 0, &mut |_, bytes| bytes.chunks_exact_mut(4).for_each(|b| b.copy_from_slice(&1.5f32.to_ne_bytes())))
        .unwrap();
    let texels = || {
        let own = texels(&device, 1);
        let mut rec = device.record().unwrap();
        rec.barrier(&[own.all().from(Access::None).to(Access::ComputeReadWrite)]);
        rec.submit().unwrap();
        own
    };
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                for _ in 0..4 {
                    let bytes = device.read_image(&image, 0).unwrap();
                    assert_eq!(bytes.len(), dims.iter().product::<u32>() as usize * texel);
                    assert!(bytes.chunks_exact(4).all(|b| b == 1.5f32.to_ne_bytes()));
                }
            });
            scope.spawn(|| {
                let own = texels();
                for _ in 0..64 {
                    assert_eq!(sample(&device, image.sampled(), &own, [0.5; 3], 0.0)[0], [1.5; 4]);
                }
            });
        }
    });
    clean(&device);
}
