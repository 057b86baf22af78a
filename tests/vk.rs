//! The Vulkan runtime on whatever device there is (lavapipe in tests).
use halflight::kernels::canary;
use halflight::vk::{Access, Device, Format, ImageDesc, Options};

fn device() -> Device {
    Device::new(&Options { validation: true, ..Options::default() }).expect("a device")
}

#[test]
fn first_light() {
    let device = device();
    println!("{:?} limit {} memory {:?}", device.info(), device.loop_limit(), device.memory());
    let data: Vec<u32> = (0..1000).collect();
    let buffer = device.buffer_from("b", &data).unwrap();
    assert_eq!(device.read::<u32>(&buffer, 1000).unwrap(), data);
    let mut rec = device.record().unwrap();
    rec.barrier(&[buffer.all().from(Access::ComputeRead).to(Access::ComputeWrite)]);
    rec.dispatch(&canary::Bindings { counted: &buffer }, &(), &canary::Params { trips: 1000 }, [1, 1, 1]).unwrap();
    rec.submit().unwrap();
    assert_eq!(device.read::<u32>(&buffer, 1).unwrap(), [1000]);
    println!("{:?}", device.take_timings());
    let image =
        device.image3(&ImageDesc { name: "i", dims: [37, 5, 3], levels: 3, format: Format::R16Unorm, views: &[], storage: true }).unwrap();
    device.write_image(&image, 1, &mut |z, bytes| bytes.fill(z as u8 + 1)).unwrap();
    assert_eq!(device.read_image(&image, 1).unwrap(), vec![1; 18 * 2 * 2]);
    assert_eq!(device.validation_errors(), Vec::<String>::new());
}
