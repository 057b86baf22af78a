//! Pictures in the host's image are those in main memory.

use crate::host::{Host, all_features};
use crate::work::{Bytes, Clock, Commands, Texels};
use crate::{on, quiet, staged};
use ash::vk;
use half::f16;
use halflight::engine::host::{Features, HostDevice, HostDeviceParts, HostImageParts};
use halflight::engine::{Engine, Options};
use halflight::scene::Picture;
use halflight::{Error, demo};
use std::ops::ControlFlow;

/// What the image of a format holds after this picture, the rest of it 0xEE.
fn bytes_of(picture: &Picture, format: vk::Format, extent: [u32; 3]) -> Vec<u8> {
    let texel = |p: &[f32; 4]| -> Vec<u8> {
        match format {
            vk::Format::R32G32B32A32_SFLOAT => p.iter().flat_map(|v| v.to_le_bytes()).collect(),
            _ => p.iter().flat_map(|&v| f16::from_f32(v).to_le_bytes()).collect(),
        }
    };
    let [width, height, _] = extent.map(|n| n as usize);
    let empty = vec![0xee; texel(&[0.0; 4]).len()];
    let at = |x: usize, y: usize| (x < picture.width && y < picture.height).then(|| texel(&picture.rgba[y * picture.width + x]));
    (0..width * height).flat_map(|i| at(i % width, i / width).unwrap_or_else(|| empty.clone())).collect()
}

fn read(host: &Host, texels: &Texels, layout: vk::ImageLayout, clock: &Clock, value: u64) -> Vec<u8> {
    let size = if texels.format == vk::Format::R32G32B32A32_SFLOAT { 16 } else { 8 };
    let to = Bytes::new(host, u64::from(texels.extent[0] * texels.extent[1] * size));
    let commands = Commands::begin(host);
    texels.drain(&commands, layout, &to);
    commands.submit(clock.at(value), None);
    drop(commands);
    to.read()
}

#[test]
fn the_picture_in_the_hosts_image_is_that_of_main_memory() {
    let host = Host::new();
    let engine = on(&host);
    let volume = engine.upload(&demo::volume(32).unwrap()).unwrap();
    for matter in [demo::dvr().unwrap(), demo::iso().unwrap()] {
        let (medium, lit, camera, image) = staged(&engine, &volume, &matter);
        let picture = engine.render(&medium, &lit, &camera, &image, &mut quiet).unwrap();
        assert!(picture.rgba.iter().any(|p| p[3] > 0.5));
        for format in [vk::Format::R32G32B32A32_SFLOAT, vk::Format::R16G16B16A16_SFLOAT] {
            // Larger than the picture: what lies beside it stays.
            let texels = Texels::new(&host, format, [96, 70, 1]);
            let old = Bytes::of(&host, &vec![0xee; 96 * 70 * if format == vk::Format::R32G32B32A32_SFLOAT { 16 } else { 8 }]);
            let clock = Clock::new(&host);
            let commands = Commands::begin(&host);
            texels.fill(&commands, &old, vk::ImageLayout::GENERAL);
            commands.submit(None, clock.at(1));
            let mut target = texels.lent(vk::ImageLayout::GENERAL, |p| {
                p.layout_after = vk::ImageLayout::TRANSFER_SRC_OPTIMAL.as_raw();
                (p.wait, p.signal) = (clock.at(1), clock.at(2));
            });
            engine.render_to(&medium, &lit, &camera, &image, &mut target, &mut quiet).unwrap();
            assert!(target.handed_back() && target.parts().layout == vk::ImageLayout::TRANSFER_SRC_OPTIMAL.as_raw());
            assert!(clock.reaches(2));
            let found = read(&host, &texels, vk::ImageLayout::TRANSFER_SRC_OPTIMAL, &clock, 2);
            assert!(found == bytes_of(&picture, format, texels.extent), "{format:?}");
            // Sabotage: one pixel more is another picture.
            let mut other = picture.clone();
            other.rgba[1234][2] += 1.0;
            assert!(found != bytes_of(&other, format, texels.extent));
        }
    }
}

#[test]
fn an_undefined_image_is_taken_and_a_cancelled_one_handed_back() {
    let host = Host::new();
    let engine = on(&host);
    let volume = engine.upload(&demo::volume(24).unwrap()).unwrap();
    let (medium, lit, camera, image) = staged(&engine, &volume, &demo::dvr().unwrap());
    let texels = Texels::new(&host, vk::Format::R16G16B16A16_SFLOAT, [80, 60, 1]);
    let clock = Clock::new(&host);
    let mut value = 0;
    for cancel_after in [0, 1, 2, usize::MAX] {
        value += 1;
        let mut target = texels.lent(vk::ImageLayout::UNDEFINED, |p| p.signal = clock.at(value));
        let mut told = 0;
        let mut progress = |_: &'static str, _: f32| {
            told += 1;
            if told > cancel_after { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let outcome = engine.render_to(&medium, &lit, &camera, &image, &mut target, &mut progress);
        assert_eq!(outcome.is_ok(), cancel_after == usize::MAX);
        assert!(cancel_after == usize::MAX || matches!(outcome, Err(Error::Cancelled)));
        assert!(target.handed_back());
        assert!(target.parts().layout == vk::ImageLayout::GENERAL.as_raw() && clock.reaches(value), "after {cancel_after}");
    }
    let picture = engine.render(&medium, &lit, &camera, &image, &mut quiet).unwrap();
    assert!(read(&host, &texels, vk::ImageLayout::GENERAL, &clock, value) == bytes_of(&picture, texels.format, texels.extent));
}

#[test]
fn the_engine_waits_for_the_hosts_value() {
    // Without the layers: 1.3.239 may lose a value that the processor sets while a queue waits, and says itself that it is a bug.
    let host = Host::with_layers(false);
    let engine = on(&host);
    let volume = engine.upload(&demo::volume(16).unwrap()).unwrap();
    let (medium, lit, camera, image) = staged(&engine, &volume, &demo::dvr().unwrap());
    let texels = Texels::new(&host, vk::Format::R32G32B32A32_SFLOAT, [80, 60, 1]);
    let clock = Clock::new(&host);
    let wait = std::time::Duration::from_millis(400);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(wait);
            assert_eq!(clock.value(), 0, "nothing was handed back before its turn");
            clock.set(5);
        });
        let start = std::time::Instant::now();
        let mut target = texels.lent(vk::ImageLayout::UNDEFINED, |p| (p.wait, p.signal) = (clock.at(5), clock.at(6)));
        engine.render_to(&medium, &lit, &camera, &image, &mut target, &mut quiet).unwrap();
        assert!(start.elapsed() >= wait);
    });
    assert!(clock.reaches(6));
}

#[test]
fn images_that_cannot_take_the_picture_are_refused() {
    let host = Host::new();
    let engine = on(&host);
    let volume = engine.upload(&demo::volume(16).unwrap()).unwrap();
    let (medium, lit, camera, image) = staged(&engine, &volume, &demo::dvr().unwrap());
    let clock = Clock::new(&host);
    let refused = |engine: &Engine, format, extent, change: &dyn Fn(&mut HostImageParts)| {
        let texels = Texels::new(&host, format, extent);
        let mut target = texels.lent(vk::ImageLayout::UNDEFINED, change);
        let text = engine.render_to(&medium, &lit, &camera, &image, &mut target, &mut quiet).expect_err("refused").to_string();
        assert!(!target.handed_back(), "{text}");
        println!("{text}");
        text
    };
    let float = vk::Format::R32G32B32A32_SFLOAT;
    assert!(refused(&engine, float, [79, 60, 1], &|_| ()).contains("the picture has 80x60"));
    assert!(refused(&engine, vk::Format::R8G8B8A8_UNORM, [80, 60, 1], &|_| ()).contains("make it one of"));
    assert!(refused(&engine, float, [80, 60, 1], &|p| p.usage = 4).contains("TRANSFER_DST"));
    let back = vk::ImageLayout::PREINITIALIZED.as_raw();
    assert!(refused(&engine, float, [80, 60, 1], &|p| p.layout_after = back).contains("PREINITIALIZED"));
    assert_eq!(clock.value(), 0);

    // Semaphores need the feature, and nothing else does.
    let plain = Features::from_bits(all_features().bits() & !Features::TIMELINE_SEMAPHORE.bits());
    // SAFETY: as in `handed_over`; a feature that is enabled need not be listed.
    let device = unsafe { HostDevice::new(HostDeviceParts { features: plain, ..host.parts() }) };
    let second = Engine::on_host(&device, &Options::default()).unwrap();
    let volume = second.upload(&demo::volume(16).unwrap()).unwrap();
    let (medium, lit, camera, image) = staged(&second, &volume, &demo::dvr().unwrap());
    let texels = Texels::new(&host, float, [80, 60, 1]);
    let mut target = texels.lent(vk::ImageLayout::UNDEFINED, |p| p.signal = clock.at(1));
    let text = second.render_to(&medium, &lit, &camera, &image, &mut target, &mut quiet).expect_err("refused").to_string();
    assert!(text.contains("timelineSemaphore"), "{text}");
    let mut target = texels.lent(vk::ImageLayout::UNDEFINED, |_| ());
    second.render_to(&medium, &lit, &camera, &image, &mut target, &mut quiet).unwrap();
    assert!(target.handed_back());
}
