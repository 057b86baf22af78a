//! Volumes that come from the host's images and buffers are those that come from main memory.

use crate::host::Host;
use crate::work::{Bytes, Clock, Commands, Texels};
use crate::{frame, on, own, same_bits};
use ash::vk;
use half::f16;
use halflight::engine::Engine;
use halflight::engine::host::{HostBufferParts, HostImageParts, SampleType};
use halflight::kernels::constants::BLOCK;
use halflight::scene::transfer::{Kind, Reference};
use halflight::scene::{Grid, Matter, Samples, Transfer, Volume};
use halflight::stages::occupancy;

const DIMS: [usize; 3] = [21, 18, 13];

fn grid() -> Grid {
    Grid::axis_aligned(DIMS, [1.0, 1.1, 1.4]).unwrap()
}

fn blob(i: usize) -> f64 {
    let p = [i % DIMS[0], i / DIMS[0] % DIMS[1], i / DIMS[0] / DIMS[1]];
    let d2: f64 = (0..3).map(|a| (p[a] as f64 / DIMS[a] as f64 - 0.45).powi(2)).sum();
    (-8.0 * d2).exp()
}

/// The same blob as every type: what the host has, what main memory has, and the map to values.
fn cases() -> Vec<(SampleType, vk::Format, Vec<u8>, Volume)> {
    let n = DIMS.iter().product::<usize>();
    let all = |f: &dyn Fn(f64) -> Vec<u8>| (0..n).flat_map(|i| f(blob(i))).collect::<Vec<u8>>();
    let volume = |samples, slope, intercept| Volume::new(grid(), samples, slope, intercept).unwrap();
    let u8s = all(&|v| vec![(v * 255.0) as u8]);
    let i8s = all(&|v| vec![(v * 255.0 - 128.0) as i8 as u8]);
    let u16s = all(&|v| ((v * 60000.0) as u16).to_le_bytes().to_vec());
    let i16s = all(&|v| ((v * 60000.0 - 30000.0) as i16).to_le_bytes().to_vec());
    let f16s = all(&|v| f16::from_f64(v).to_le_bytes().to_vec());
    let f32s = all(&|v| (v as f32).to_le_bytes().to_vec());
    let pairs = |b: &[u8]| b.chunks_exact(2).map(|c| u16::from_le_bytes([c[0], c[1]])).collect::<Vec<_>>();
    let floats = f32s.chunks_exact(4).map(|c| f32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect();
    vec![
        (SampleType::U8, vk::Format::R8_UNORM, u8s.clone(), volume(Samples::U8(u8s.clone()), 1.0 / 255.0, 0.0)),
        (SampleType::U8, vk::Format::R8_UINT, u8s.clone(), volume(Samples::U8(u8s), -1.0 / 255.0, 1.0)),
        (
            SampleType::I8,
            vk::Format::R8_SINT,
            i8s.clone(),
            volume(Samples::I16(i8s.iter().map(|&b| i16::from(b as i8)).collect()), 1.0 / 256.0, 0.5),
        ),
        (SampleType::U16, vk::Format::R16_UNORM, u16s.clone(), volume(Samples::U16(pairs(&u16s)), 1.0 / 60000.0, 0.0)),
        (SampleType::U16, vk::Format::R16_UINT, u16s.clone(), volume(Samples::U16(pairs(&u16s)), 1.0 / 60000.0, 0.0)),
        (
            SampleType::I16,
            vk::Format::R16_SINT,
            i16s.clone(),
            volume(Samples::I16(pairs(&i16s).iter().map(|&v| v as i16).collect()), 1.0 / 60000.0, 0.5),
        ),
        (
            SampleType::F16,
            vk::Format::R16_SFLOAT,
            f16s.clone(),
            volume(Samples::F32(pairs(&f16s).iter().map(|&v| f16::from_bits(v).to_f32()).collect()), 1.0, 0.0),
        ),
        (SampleType::F32, vk::Format::R32_SFLOAT, f32s, volume(Samples::F32(floats), 1.0, 0.0)),
    ]
}

fn values(volume: &Volume) -> Vec<u32> {
    (0..volume.samples().len()).map(|i| volume.value(i).to_bits()).collect()
}

fn matter() -> Matter {
    let points = [[0.0, 0.9, 0.4, 0.2, 0.0], [0.3, 0.9, 0.4, 0.2, 0.0], [0.5, 0.3, 0.8, 0.9, 0.3], [1.0, 1.0, 1.0, 1.0, 2.0]];
    Matter { transfer: Transfer::from_points(&points, Kind::Extinction, Reference::World).unwrap(), surface: None }
}

#[test]
fn images_and_buffers_of_every_type_give_the_same_volume() {
    let host = Host::new();
    let (engine, ours) = (on(&host), own());
    for (kind, format, bytes, volume) in cases() {
        let straight = ours.upload(&volume).unwrap();
        let expected = frame(&ours, &straight, &matter());
        assert!(expected.rgba.iter().any(|p| p[3] > 0.3), "{format:?}");

        let texels = Texels::new(&host, format, DIMS.map(|n| n as u32));
        let source = Bytes::of(&host, &bytes);
        let clock = Clock::new(&host);
        let commands = Commands::begin(&host);
        texels.fill(&commands, &source, vk::ImageLayout::GENERAL);
        commands.submit(None, clock.at(3));
        let mut image = texels.lent(vk::ImageLayout::GENERAL, |p| {
            p.layout_after = vk::ImageLayout::TRANSFER_DST_OPTIMAL.as_raw();
            (p.wait, p.signal) = (clock.at(3), clock.at(4));
        });
        let brought = engine.upload_image(&mut image, &grid(), volume.rescale()).unwrap();
        assert!(image.handed_back() && clock.reaches(4));
        assert_eq!(image.parts().layout, vk::ImageLayout::TRANSFER_DST_OPTIMAL.as_raw());
        assert_eq!(brought.range(), straight.range(), "{format:?}");
        // Read back, it is what it was.
        assert_eq!(values(&engine.read_volume(&brought).unwrap()), values(&volume), "{format:?}");
        assert_eq!(ours.read_volume(&straight).unwrap().samples(), volume.samples(), "{format:?}");
        assert_eq!(engine.read_ranges(&brought).unwrap(), occupancy::ranges(&volume), "{format:?}");
        assert!(same_bits(&frame(&engine, &brought, &matter()), &expected), "{format:?}");

        // The host's image is where it was said to be, and as it was.
        let back = Bytes::new(&host, bytes.len() as u64);
        let commands = Commands::begin(&host);
        texels.drain(&commands, vk::ImageLayout::TRANSFER_DST_OPTIMAL, &back);
        commands.submit(clock.at(4), None);
        drop(commands);
        assert_eq!(back.read(), bytes);

        let mut buffer = source.lent(|_| ());
        let brought = engine.upload_buffer(&mut buffer, kind, &grid(), volume.rescale()).unwrap();
        assert!(buffer.handed_back());
        assert_eq!(brought.range(), straight.range(), "{kind:?}");
        assert_eq!(engine.read_ranges(&brought).unwrap(), occupancy::ranges(&volume), "{kind:?}");
        assert!(same_bits(&frame(&engine, &brought, &matter()), &expected), "{kind:?}");
    }
}

#[test]
fn strides_and_offsets_are_walked() {
    let host = Host::new();
    let engine = on(&host);
    let (kind, _, bytes, volume) = cases().swap_remove(5);
    let (row, rows) = (2 * DIMS[0], DIMS[1]);
    let (row_bytes, slice_bytes, offset) = (row + 6, (row + 6) * rows + 14, 4);
    let mut apart = vec![0xee; offset + slice_bytes * DIMS[2]];
    for (i, line) in bytes.chunks_exact(row).enumerate() {
        let at = offset + i / rows * slice_bytes + i % rows * row_bytes;
        apart[at..at + row].copy_from_slice(line);
    }
    let source = Bytes::of(&host, &apart);
    let strides = |p: &mut HostBufferParts| {
        (p.offset, p.row_bytes, p.slice_bytes) = (offset as u64, row_bytes as u64, slice_bytes as u64);
    };
    let brought = engine.upload_buffer(&mut source.lent(strides), kind, &grid(), volume.rescale()).unwrap();
    assert_eq!(engine.read_ranges(&brought).unwrap(), occupancy::ranges(&volume));
    // Sabotage: read as if tight, it is another volume.
    let other = engine.upload_buffer(&mut source.lent(|_| ()), kind, &grid(), volume.rescale()).unwrap();
    assert_ne!(engine.read_ranges(&other).unwrap(), occupancy::ranges(&volume));
}

/// A volume of more than one piece, whose pieces end inside blocks: a ramp along z.
#[test]
fn large_volumes_come_in_pieces() {
    let host = Host::new();
    let engine = on(&host);
    let dims = [401, 307, 91];
    let grid = Grid::axis_aligned(dims, [1.0; 3]).unwrap();
    let value = |i: usize| (i % 401 / 4 + i / 401 % 307 / 8 + i / 401 / 307) as u8;
    let bytes: Vec<u8> = (0..dims.iter().product()).map(value).collect();
    let volume = Volume::new(grid, Samples::U8(bytes.clone()), 1.0, 0.0).unwrap();
    let start = std::time::Instant::now();
    let straight = engine.upload(&volume).unwrap();
    let there = start.elapsed();
    let source = Bytes::of(&host, &bytes);
    engine.take_timings();
    let start = std::time::Instant::now();
    let brought = engine.upload_buffer(&mut source.lent(|_| ()), SampleType::U8, &grid, (1.0, 0.0)).unwrap();
    println!("from main memory {there:.0?}, from the host's buffer {:.0?}: {:?}", start.elapsed(), engine.take_timings());
    let start = std::time::Instant::now();
    let ranges = occupancy::ranges(&volume);
    println!("ranges on the processor {:.0?}", start.elapsed());
    assert_eq!(engine.read_ranges(&brought).unwrap(), ranges);
    assert_eq!(brought.range(), straight.range());
}

#[test]
fn ranges_are_those_of_the_formula() {
    let host = Host::new();
    let engine = on(&host);
    // A ramp along x, negative at first: a block's smallest and largest are those of its ends, one voxel further out.
    let dims = [4 * BLOCK + 3, 5, 9];
    let grid = Grid::axis_aligned(dims, [1.0; 3]).unwrap();
    let bytes: Vec<u8> = (0..dims.iter().product()).flat_map(|i: usize| ((i % dims[0]) as f32 - 7.5).to_le_bytes()).collect();
    let source = Bytes::of(&host, &bytes);
    let brought = engine.upload_buffer(&mut source.lent(|_| ()), SampleType::F32, &grid, (-2.0, 1.0)).unwrap();
    let last = (dims[0] - 1) as f32 - 7.5;
    assert_eq!(brought.range(), [1.0 - 2.0 * last, 16.0]);
    let read = engine.read_ranges(&brought).unwrap();
    let blocks = occupancy::block_dims(dims);
    assert_eq!(read.len(), 8 * blocks.iter().product::<usize>());
    for (i, texel) in read.chunks_exact(8).enumerate() {
        let x = i % blocks[0];
        let value = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        assert_eq!(value(&texel[..4]), (BLOCK * x).saturating_sub(1) as f32 - 7.5);
        assert_eq!(value(&texel[4..]), (BLOCK * x + BLOCK).min(dims[0] - 1) as f32 - 7.5);
    }
}

#[test]
fn what_cannot_be_a_volume_is_refused_and_not_touched() {
    let host = Host::new();
    let engine = on(&host);
    let grid = grid();
    let dims = DIMS.map(|n| n as u32);
    let texels = Texels::new(&host, vk::Format::R8_UNORM, dims);
    let colours = Texels::new(&host, vk::Format::R8G8B8A8_UNORM, dims);
    let general = vk::ImageLayout::GENERAL;
    let refused = |texels: &Texels, layout, change: &dyn Fn(&mut HostImageParts)| {
        let mut image = texels.lent(layout, change);
        let text = engine.upload_image(&mut image, &grid, (1.0, 0.0)).err().expect("refused").to_string();
        assert!(!image.handed_back() && image.parts().layout == layout.as_raw(), "{text}");
        println!("{text}");
        text
    };
    assert!(refused(&colours, general, &|_| ()).contains("R8G8B8A8_UNORM"));
    assert!(refused(&texels, general, &|p| p.usage = vk::ImageUsageFlags::SAMPLED.as_raw()).contains("TRANSFER_SRC"));
    assert!(refused(&texels, general, &|p| p.extent[2] += 1).contains("the grid has"));
    assert!(refused(&texels, general, &|p| p.image = 0).contains("null"));
    assert!(refused(&texels, general, &|p| p.queue_family = 9).contains("queue family 9"));
    assert!(refused(&texels, vk::ImageLayout::UNDEFINED, &|_| ()).contains("no contents"));
    let clock = Clock::new(&host);
    assert!(refused(&texels, general, &|p| (p.wait, p.signal) = (clock.at(4), clock.at(4))).contains("rises"));
    let tiny = |p: &mut HostImageParts| p.wait = clock.at(0).map(|t| halflight::engine::host::Timeline { semaphore: 0, ..t });
    assert!(refused(&texels, general, &tiny).contains("null semaphore"));

    let source = Bytes::new(&host, 100);
    let short = engine.upload_buffer(&mut source.lent(|_| ()), SampleType::U16, &grid, (1.0, 0.0)).err().expect("refused").to_string();
    assert!(short.contains("100 bytes") && short.contains("9828 in all"), "{short}");
    let slope = engine.upload_buffer(&mut source.lent(|p| p.size = 1 << 20), SampleType::U16, &grid, (0.0, 0.0)).err().expect("refused");
    assert!(slope.to_string().contains("slope"));

    // Samples are looked at on the device; then the buffer has been handed back.
    for (odd, value) in [(f32::NAN, 1), (f32::NEG_INFINITY, 2)] {
        let bytes: Vec<u8> = (0..DIMS.iter().product()).flat_map(|i: usize| if i == 777 { odd } else { 0.5 }.to_le_bytes()).collect();
        let source = Bytes::of(&host, &bytes);
        let mut buffer = source.lent(|p| p.signal = clock.at(value));
        let text = engine.upload_buffer(&mut buffer, SampleType::F32, &grid, (1.0, 0.0)).err().expect("refused").to_string();
        assert!(text.contains("1 of them"), "{text}");
        assert!(buffer.handed_back() && clock.reaches(value));
    }
    budget(&host);
}

fn budget(host: &Host) {
    let options = halflight::engine::Options { memory_budget: Some(2 << 20), ..Default::default() };
    let engine = Engine::on_host(&host.handed_over(), &options).unwrap();
    let grid = Grid::axis_aligned([128; 3], [1.0; 3]).unwrap();
    let source = Bytes::new(host, 128 * 128 * 128);
    let error = engine.upload_buffer(&mut source.lent(|_| ()), SampleType::U8, &grid, (1.0, 0.0)).err().expect("refused");
    assert!(matches!(error, halflight::Error::OutOfMemory { .. }), "{error}");
}
