//! What is lent stands in the ledger: taken once, copied under barriers, given back once, and nothing else.

use crate::host::Host;
use crate::work::{Bytes, Clock, Commands, Texels};
use ash::vk;
use halflight::Error;
use halflight::kernels::test_sample;
use halflight::vk::{Access, CopySpan, Device, Format, Image, ImageDesc, Options, Piece, Recorder};

const WHOLE: Piece = Piece { x: 4, y: 0, z: 0, rows: 4, slices: 4 };

fn hazard<T>(result: Result<T, Error>) -> String {
    match result {
        Err(Error::Hazard { had, needs, .. }) => format!("{had} -> {needs}"),
        Err(other) => panic!("no hazard: {other}"),
        Ok(_) => panic!("the ledger let it pass"),
    }
}

fn invalid<T>(result: Result<T, Error>) -> String {
    match result {
        Err(error @ Error::Invalid { .. }) => error.to_string(),
        Err(other) => panic!("not invalid: {other}"),
        Ok(_) => panic!("the ledger let it pass"),
    }
}

fn lend(device: &Device, texels: &Texels, clock: &Clock, value: u64) -> Image {
    let host = texels.lent(vk::ImageLayout::GENERAL, |p| p.signal = clock.at(value));
    device.borrow_image(&host, "lent", &[Format::R8Unorm], false).unwrap()
}

fn take(rec: &mut Recorder, lent: &Image) {
    rec.barrier(&[lent.all().from(Access::Foreign).to(Access::TransferRead)]);
}

fn give(rec: &mut Recorder, lent: &Image) {
    rec.barrier(&[lent.all().from(Access::TransferRead).to(Access::Foreign)]);
}

#[test]
fn what_is_lent_is_taken_once_and_given_back_once() {
    let host = Host::new();
    let device = Device::import(&host.handed_over(), &Options::default()).unwrap();
    assert_eq!(device.queue_family(), 0);
    let data: Vec<u8> = (0..64).map(|i| 3 * i).collect();
    let texels = Texels::new(&host, vk::Format::R8_UNORM, [4, 4, 4]);
    let source = Bytes::of(&host, &data);
    let clock = Clock::new(&host);
    let commands = Commands::begin(&host);
    texels.fill(&commands, &source, vk::ImageLayout::GENERAL);
    commands.submit(None, None);
    drop(commands);

    let lent = lend(&device, &texels, &clock, 1);
    let to = device.buffer::<u8>("to", 64).unwrap();
    let mut rec = device.record().unwrap();
    // Not taken yet; then as it should be, and the wrong ways after.
    assert!(hazard(rec.copy_image_to_buffer(&lent, &WHOLE, &to)).contains("Foreign"));
    take(&mut rec, &lent);
    rec.copy_image_to_buffer(&lent, &WHOLE, &to).unwrap();
    hazard(rec.copy_image_to_buffer(&lent, &WHOLE, &to));
    give(&mut rec, &lent);
    hazard(rec.copy_image_to_buffer(&lent, &WHOLE, &to));
    rec.submit().unwrap();
    assert!(device.read::<u8>(&to, 64).unwrap() == data && clock.reaches(1));
    let mut rec = device.record().unwrap();
    take(&mut rec, &lent);
    assert!(invalid(rec.submit()).contains("has been given back"));

    // Twice in one recording; and a recording that is dropped takes nothing.
    let lent = lend(&device, &texels, &clock, 2);
    let mut rec = device.record().unwrap();
    take(&mut rec, &lent);
    give(&mut rec, &lent);
    take(&mut rec, &lent);
    assert!(invalid(rec.submit()).contains("has been given back"));
    let mut rec = device.record().unwrap();
    take(&mut rec, &lent);
    give(&mut rec, &lent);
    rec.submit().unwrap();
    assert!(clock.reaches(2));
}

#[test]
fn what_is_lent_is_copied_and_nothing_else() {
    let host = Host::new();
    let device = Device::import(&host.handed_over(), &Options::default()).unwrap();
    let texels = Texels::new(&host, vk::Format::R8_UNORM, [4, 4, 4]);
    let clock = Clock::new(&host);
    let lent = lend(&device, &texels, &clock, 1);
    assert!(invalid(device.read_image(&lent, 0)).contains("is the host's"));
    assert!(invalid(device.write_image(&lent, 0, &mut |_, _| ())).contains("is the host's"));
    let bytes = Bytes::new(&host, 64);
    let lent_bytes = device.borrow_buffer(&bytes.lent(|_| ()), "lent bytes").unwrap();
    invalid(device.read::<u8>(&lent_bytes, 4));
    invalid(device.write(&lent_bytes, &[1u8; 4]));

    let desc = ImageDesc { name: "ours", dims: [4; 3], levels: 1, format: Format::R32Uint, views: &[], storage: true };
    let ours = device.image3(&desc).unwrap();
    let out = device.buffer::<f32>("out", 8).unwrap();
    let mut rec = device.record().unwrap();
    invalid(rec.fill(&lent_bytes, 0));
    let at = test_sample::Params { position: [0.5; 3], lod: 0.0 };
    let bindings = test_sample::Bindings { image: lent.sampled(), texels: ours.storage(0), sampled: &out };
    invalid(rec.dispatch(&bindings, &(), &at, [1, 1, 1]));
    // Ours cannot be given away, nor can what is lent be left without an access.
    rec.barrier(&[ours.all().from(Access::None).to(Access::Foreign)]);
    assert!(invalid(rec.submit()).contains("is not borrowed"));
    let mut rec = device.record().unwrap();
    rec.barrier(&[lent.all().from(Access::Foreign).to(Access::Foreign)]);
    invalid(rec.submit());

    let small = device.buffer::<u8>("small", 63).unwrap();
    let mut rec = device.record().unwrap();
    take(&mut rec, &lent);
    invalid(rec.copy_image_to_buffer(&lent, &WHOLE, &small));
    for piece in [Piece { z: 1, ..WHOLE }, Piece { x: 5, ..WHOLE }, Piece { rows: 0, ..WHOLE }, Piece { y: u32::MAX, ..WHOLE }] {
        invalid(rec.copy_image_to_buffer(&lent, &piece, &out));
    }
    for (from, to, bytes) in [(0, 0, 65), (1, 0, 64), (0, 30, 4), (u64::MAX, 0, 2), (0, 0, 0)] {
        invalid(rec.copy_buffer(&lent_bytes, &out, &[CopySpan { from, to, bytes }]));
    }
    // An image that has no layout yet cannot be copied to.
    let read = device.buffer_from("read", &[0u32; 64]).unwrap();
    rec.barrier(&[read.all().from(Access::ComputeRead).to(Access::TransferRead)]);
    assert!(hazard(rec.copy_buffer_to_image(&read, &ours, &WHOLE)).contains("None"));
    rec.barrier(&[ours.all().from(Access::None).to(Access::TransferWrite)]);
    rec.copy_buffer_to_image(&read, &ours, &WHOLE).unwrap();
    hazard(rec.copy_buffer_to_image(&read, &ours, &WHOLE));
    drop(rec);

    // Another device's.
    let other = Device::import(&host.handed_over(), &Options::default()).unwrap();
    let mut rec = other.record().unwrap();
    assert!(invalid(rec.copy_buffer_to_image(&read, &ours, &WHOLE)).contains("another device"));
    assert_eq!(clock.value(), 0);
}
