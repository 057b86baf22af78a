//! The runtime's resources: devices, copies, budget, caches. Runs on whatever device there is (lavapipe in tests).

use halflight::Error;
use halflight::error::bytes;
use halflight::kernels::constants::{COEFFICIENTS, PACK_RANGE};
use halflight::vk::{self, Device, Format, ImageDesc, Options};
use std::process::Command;

fn open(options: &Options) -> Device {
    Device::new(&Options { validation: true, ..options.clone() }).expect("a device with the validation layer")
}

fn clean(device: &Device) {
    assert_eq!(device.validation_errors(), Vec::<String>::new());
}

/// Both ways of copying: directly and through staging.
fn both_ways() -> [Device; 2] {
    [false, true].map(|as_card| open(&Options { as_card, ..Options::default() }))
}

#[test]
fn buffers_keep_what_is_written() {
    for device in both_ways() {
        // Longer than both staging halves, and of odd length.
        let data: Vec<u8> = (0..(33 << 20) + 5_usize).map(|i| (i * 7 + (i >> 13)) as u8).collect();
        let buffer = device.buffer_from("long", &data).unwrap();
        assert_eq!(buffer.len_bytes(), data.len() as u64);
        assert!(device.read::<u8>(&buffer, data.len()).unwrap() == data);
        // A prefix replaces the beginning only.
        device.write(&buffer, &[1_u32, 2, 3]).unwrap();
        let back = device.read::<u8>(&buffer, 16).unwrap();
        assert_eq!(back[..12], [1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0]);
        assert_eq!(back[12..], data[12..16]);
        clean(&device);
    }
}

#[test]
fn copies_past_the_end_and_unwritten_sources_are_refused() {
    let device = open(&Options::default());
    let buffer = device.buffer::<f32>("short", 3).unwrap();
    assert!(matches!(device.read::<f32>(&buffer, 3), Err(Error::Hazard { .. })));
    let error = device.write(&buffer, &[0.0_f32; 4]).unwrap_err().to_string();
    assert!(error.contains("16 bytes") && error.contains("it holds 12"), "{error}");
    assert!(matches!(device.read::<f32>(&buffer, usize::MAX), Err(Error::Invalid { .. })));
    assert!(matches!(device.buffer::<f32>("none", 0), Err(Error::Invalid { .. })));
    clean(&device);
}

#[test]
fn images_keep_every_level() {
    for device in both_ways() {
        for (dims, levels, format) in
            [([37, 5, 3], 6, Format::R16Unorm), ([1, 1, 129], 8, Format::Rgba32Sfloat), ([300, 200, 150], 9, Format::Rgba8Unorm)]
        {
            let image = device.image3(&ImageDesc { name: "levels", dims, levels, format, views: &[], storage: false }).unwrap();
            let value = |level: u32, i: usize| (i.wrapping_mul(31) >> 3).wrapping_add(level as usize * 17 + (i >> 11)) as u8;
            for level in 0..levels {
                let [x, y, _] = image.level_dims(level);
                let slice = (x * y * format.bytes()) as usize;
                let mut next = 0;
                let mut fill = |z: u32, bytes: &mut [u8]| {
                    assert_eq!(z, next, "slices come in order");
                    assert_eq!(bytes.len() % slice, 0, "slices come whole");
                    next += (bytes.len() / slice) as u32;
                    let start = z as usize * slice;
                    bytes.iter_mut().enumerate().for_each(|(i, b)| *b = value(level, start + i));
                };
                device.write_image(&image, level, &mut fill).unwrap();
                assert_eq!(next, image.level_dims(level)[2]);
            }
            for level in 0..levels {
                let back = device.read_image(&image, level).unwrap();
                assert_eq!(back.len(), image.level_dims(level).iter().product::<u32>() as usize * format.bytes() as usize);
                assert!(back.iter().enumerate().all(|(i, b)| *b == value(level, i)), "{dims:?} level {level}");
            }
        }
        clean(&device);
    }
}

#[test]
fn a_slice_larger_than_staging_goes_in_rows() {
    let device = open(&Options::default());
    let dims = [4096, 1100, 2];
    let image = device.image3(&ImageDesc { name: "wide", dims, levels: 1, format: Format::R32Uint, views: &[], storage: false }).unwrap();
    let slice = 4096 * 1100;
    let mut fill = |z: u32, bytes: &mut [u8]| {
        assert_eq!(bytes.len(), 4 * slice);
        for (i, texel) in bytes.chunks_exact_mut(4).enumerate() {
            texel.copy_from_slice(&((z as usize * slice + i) as u32).to_le_bytes());
        }
    };
    device.write_image(&image, 0, &mut fill).unwrap();
    let back = device.read_image(&image, 0).unwrap();
    assert!(back.chunks_exact(4).enumerate().all(|(i, t)| t == (i as u32).to_le_bytes()));
    clean(&device);
}

#[test]
fn impossible_images_are_refused() {
    let device = open(&Options { memory_budget: Some(16 << 30), ..Options::default() });
    let make = |dims, levels, format, views: &[Format]| {
        device.image3(&ImageDesc { name: "odd", dims, levels, format, views, storage: true }).map(|_| ()).map_err(|e| e.to_string())
    };
    let most = device.info().max_image_3d;
    assert!(make([most + 1, 1, 1], 1, Format::R8Unorm, &[]).unwrap_err().contains("maxImageDimension3D"));
    assert!(make([0, 1, 1], 1, Format::R8Unorm, &[]).is_err());
    assert!(make([8, 4, 2], 5, Format::R8Unorm, &[]).unwrap_err().contains("1 to 4"));
    assert!(make([8, 4, 2], 4, Format::R32Uint, &[Format::R16Uint]).unwrap_err().contains("4 bytes"));
    // Drivers fail late or overflow here; the refusal comes before they are asked.
    if device.info().max_allocation < 4 << 30 {
        assert!(make([2048, 2048, 256], 1, Format::Rgba32Sfloat, &[]).unwrap_err().contains("maxMemoryAllocationSize"));
    }
    make([8, 4, 2], 4, Format::R32Uint, &[Format::Rgba8Unorm]).unwrap();
    clean(&device);
}

#[test]
fn the_budget_is_kept_and_named() {
    let budget = 1 << 20;
    let device = open(&Options { memory_budget: Some(budget), ..Options::default() });
    let before = device.memory();
    assert_eq!((before.used, before.budget), (0, budget));
    let held = device.buffer::<u8>("held", 600 << 10).unwrap();
    let error = device.buffer::<u8>("second", 600 << 10).err().unwrap();
    assert!(matches!(error, Error::OutOfMemory { needs, budget: b, .. } if needs >= 600 << 10 && b == budget));
    let text = error.to_string();
    assert!(text.contains("'second'") && text.contains(&bytes(budget)), "{text}");
    let error = device
        .image3(&ImageDesc { name: "image", dims: [128; 3], levels: 1, format: Format::R8Unorm, views: &[], storage: false })
        .err()
        .unwrap();
    assert!(matches!(error, Error::OutOfMemory { .. }));
    drop(held);
    // What is given back can be taken again.
    let _second = device.buffer::<u8>("second", 600 << 10).unwrap();
    assert!(device.memory().peak <= budget && device.memory().used >= 600 << 10);
    // The other bound is named as what it is.
    let device = open(&Options { memory_budget: Some(u64::MAX), ..Options::default() });
    let text = device.buffer::<u8>("huge", device.info().max_storage_range as usize + 1).err().unwrap().to_string();
    assert!(text.contains("maxStorageBufferRange"), "{text}");
    clean(&device);
}

#[test]
fn devices_are_found_by_index_name_and_uuid() {
    let all = vk::devices().unwrap();
    let first = &all[0];
    let part = first.name[..6].to_uppercase();
    for wish in ["0", &part, &first.uuid] {
        assert_eq!(open(&Options { device: Some(wish.to_owned()), ..Options::default() }).info().uuid, first.uuid);
    }
    for wish in ["no such thing", "99", ""] {
        let error = Device::new(&Options { device: Some(wish.to_owned()), ..Options::default() }).err().unwrap();
        assert!(matches!(error, Error::NoDevice { .. }) && error.to_string().contains(&first.name), "{error}");
    }
}

#[test]
fn a_damaged_pipeline_cache_is_ignored_and_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let options = Options { pipeline_cache: Some(folder.path().join("deep/er")), ..Options::default() };
    let file = || {
        let mut found = std::fs::read_dir(folder.path().join("deep/er")).unwrap().map(|e| e.unwrap().path());
        let file = found.next().expect("a cache file");
        assert!(found.next().is_none(), "one file only");
        file
    };
    drop(open(&options));
    let good = std::fs::read(file()).unwrap();
    assert!(good.starts_with(b"halfpipe") && good.len() > 24);
    let mut flipped = good.clone();
    *flipped.last_mut().unwrap() ^= 1;
    for bad in [b"".to_vec(), b"halfpipe".to_vec(), vec![0xff; 5000], good[..good.len() - 1].to_vec(), flipped] {
        std::fs::write(file(), &bad).unwrap();
        let device = open(&options);
        clean(&device);
        drop(device);
        let now = std::fs::read(file()).unwrap();
        assert!(now != bad && now.starts_with(b"halfpipe") && now.len() > 24);
    }
}

#[test]
fn threads_are_set_soundly_or_not_at_all() {
    // The test harness has threads of its own.
    let error = Device::new(&Options { threads: Some(61), ..Options::default() }).err().unwrap();
    assert!(matches!(error, Error::Invalid { item: "threads", .. }), "{error}");
    assert!(std::env::var("LP_NUM_THREADS").is_err() || std::env::var("LP_NUM_THREADS").as_deref() != Ok("61"));
}

/// Runs one test of this file in a process of its own; whether this is that process.
fn in_child(test: &str, prepare: impl FnOnce(&mut Command)) -> bool {
    if std::env::var_os("HALFLIGHT_TEST_CHILD").is_some() {
        return true;
    }
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", test, "--nocapture"]).env("HALFLIGHT_TEST_CHILD", "1");
    prepare(&mut command);
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && text.contains("1 passed"), "{text}");
    false
}

#[test]
fn without_a_driver_there_is_no_device() {
    let no_driver = |c: &mut Command| {
        c.env("VK_DRIVER_FILES", "/nonexistent/icd.json").env("VK_ICD_FILENAMES", "/nonexistent/icd.json");
    };
    if in_child("without_a_driver_there_is_no_device", no_driver) {
        let error = Device::new(&Options::default()).err().unwrap();
        assert!(matches!(error, Error::NoDevice { .. }), "{error}");
        assert!(error.to_string().contains("mesa-vulkan-drivers"), "{error}");
        assert!(vk::devices().map_or(true, |all| all.is_empty()));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn without_a_loader_there_is_no_device() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["libvulkan.so.1", "libvulkan.so"] {
        std::fs::write(folder.path().join(name), "no library").unwrap();
    }
    let broken_loader = |c: &mut Command| {
        c.env("LD_LIBRARY_PATH", folder.path());
    };
    if in_child("without_a_loader_there_is_no_device", broken_loader) {
        let error = Device::new(&Options::default()).err().unwrap();
        assert!(matches!(error, Error::NoDevice { .. }) && error.to_string().contains("loader"), "{error}");
    }
}

/// The Vulkan loader and drivers in this process's memory (what a driver loads besides is its own affair).
#[cfg(target_os = "linux")]
fn libraries() -> std::collections::BTreeSet<String> {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    let names = maps.lines().filter_map(|l| l.rsplit('/').next()).filter(|n| n.starts_with("libvulkan") || n.starts_with("libGLX_"));
    names.map(str::to_owned).collect()
}

#[cfg(target_os = "linux")]
#[test]
fn drivers_stay_loaded_when_the_last_device_goes() {
    if in_child("drivers_stay_loaded_when_the_last_device_goes", |_| ()) {
        let device = Device::new(&Options::default()).unwrap();
        let there = libraries();
        drop(device);
        assert!(there.len() >= 2, "{there:?}");
        assert_eq!(libraries(), there);
    }
}

#[test]
fn pack_ranges_are_the_known_integrals() {
    use std::f64::consts::PI;
    // Half of the integral of |Y| in closed form: Y10 = √(3/4π)z, Y20 = √(5/16π)(3z²-1), Y21 = √(15/4π)xz.
    let y20 = 0.5 * (5.0 / (16.0 * PI)).sqrt() * 2.0 * PI * 8.0 / (3.0 * 3.0_f64.sqrt());
    let y21 = 0.5 * (15.0 / (4.0 * PI)).sqrt() * 8.0 / 3.0;
    let y33 = 0.5 * (35.0 / (32.0 * PI)).sqrt() * 4.0 * 3.0 * PI / 8.0;
    let y10 = 0.5 * (3.0 / (4.0 * PI)).sqrt() * 2.0 * PI;
    for (index, wanted) in [(0, 2.0 * PI.sqrt()), (1, y10), (2, y10), (3, y10), (4, y21), (5, y21), (6, y20), (8, y21), (9, y33), (15, y33)]
    {
        assert!((f64::from(PACK_RANGE[index]) - wanted).abs() < 1e-6, "{index}: {} against {wanted}", PACK_RANGE[index]);
    }
    assert_eq!(PACK_RANGE.len(), COEFFICIENTS);
}
