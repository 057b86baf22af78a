//! The kernels that stand where the host's memory begins, against their twins.

use half::f16;
use halflight::stages::resolve::{self, Form};
use halflight::stages::widen::{self, SampleType};
use halflight::vk::{Access, Device, Options};

fn open() -> Device {
    Device::new(&Options { validation: true, ..Options::default() }).unwrap()
}

fn clean(device: &Device) {
    assert_eq!(device.validation_errors(), Vec::<String>::new());
}

fn widened(device: &Device, from: SampleType, bytes: &[u8], samples: u64) -> Vec<u8> {
    let (narrow, wide) = from.buffers(samples);
    let mut padded = bytes.to_vec();
    padded.resize(narrow as usize, 0);
    let narrow = device.buffer_from("narrow", &padded).unwrap();
    let wide = device.buffer::<u8>("wide", wide as usize).unwrap();
    let mut rec = device.record().unwrap();
    widen::record(&mut rec, from, &narrow, &wide, samples).unwrap();
    rec.submit().unwrap();
    device.read::<u8>(&wide, samples as usize * from.format().bytes() as usize).unwrap()
}

#[test]
fn every_sample_is_widened_exactly() {
    let device = open();
    // All values of 16 bits, and of 8; an odd number of them, so that the last word is half used.
    let words: Vec<u8> = (0..=u16::MAX).chain([12345]).flat_map(u16::to_le_bytes).collect();
    let bytes: Vec<u8> = (0..=u8::MAX).chain([77]).collect();
    for from in [SampleType::U8, SampleType::I8, SampleType::I16, SampleType::F16] {
        let input = if from.bytes() == 1 { &bytes } else { &words };
        let found = widened(&device, from, input, input.len() as u64 / u64::from(from.bytes()));
        let twin = widen::reference(from, input);
        if from == SampleType::F16 {
            let bits = |b: &[u8]| u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
            for (i, (a, b)) in found.chunks_exact(4).zip(twin.chunks_exact(4)).enumerate() {
                // Of NaN only that it is one.
                let nan = f32::from_bits(bits(a)).is_nan() && f32::from_bits(bits(b)).is_nan();
                assert!(a == b || nan, "half {i:#x}");
            }
        } else {
            assert_eq!(found, twin, "{from:?}");
        }
        // Formula: the stored value comes back from what an image of these texels returns.
        if from.format().bytes() == 2 {
            for (i, texel) in found.chunks_exact(2).enumerate() {
                let sampled = f32::from(u16::from_le_bytes([texel[0], texel[1]])) / 65535.0;
                let stored = match from {
                    SampleType::U8 => f32::from(input[i]),
                    SampleType::I8 => f32::from(input[i].cast_signed()),
                    _ => f32::from(i16::from_le_bytes([input[2 * i], input[2 * i + 1]])),
                };
                assert_eq!(from.stored(sampled), stored, "{from:?}");
                let value = sampled * from.encoding((2.0, 1.0)).scale + from.encoding((2.0, 1.0)).bias;
                assert!((value - (2.0 * stored + 1.0)).abs() < 0.02, "{from:?}: {value} for {stored}");
            }
        }
        // Sabotage: one changed sample, and the wrong type.
        let mut other = input.clone();
        other[30] ^= 1;
        assert_ne!(found, widen::reference(from, &other));
    }
    assert_ne!(widen::reference(SampleType::U8, &bytes), widen::reference(SampleType::I8, &bytes));
    clean(&device);
}

fn resolved(device: &Device, form: Form, state: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let buffer = device.buffer_from("state", state).unwrap();
    let pixels = device.buffer::<u8>("pixels", state.len() * form.bytes() as usize).unwrap();
    let mut rec = device.record().unwrap();
    resolve::record(&mut rec, form, &buffer, &pixels, state.len() as u32).unwrap();
    rec.barrier(&[pixels.all().from(Access::ComputeWrite).to(Access::ComputeRead)]);
    rec.submit().unwrap();
    if form.half {
        let halves = device.read::<[u16; 4]>(&pixels, state.len()).unwrap();
        halves.iter().map(|p| p.map(|h| f16::from_bits(h).to_f32())).collect()
    } else {
        device.read(&pixels, state.len()).unwrap()
    }
}

#[test]
fn pixels_are_rounded_to_the_nearest_half() {
    let device = open();
    // All halves, what lies in the middle between two and next to it, and what is beyond.
    let mut values = vec![0.0, -0.0, 65519.9, 65520.0, -1e9, 1e-9, 2.9e-8, 3.0e-8, f32::INFINITY, f32::NEG_INFINITY, f32::MIN_POSITIVE];
    for bits in 0..0x7bffu16 {
        let (a, b) = (f16::from_bits(bits).to_f32(), f16::from_bits(bits + 1).to_f32());
        let middle = 0.5 * (a + b);
        values.extend([a, middle, f32::from_bits(middle.to_bits() + 1), f32::from_bits(middle.to_bits().saturating_sub(1)), -middle]);
    }
    values.resize(values.len().next_multiple_of(4), 1.0);
    let state: Vec<[f32; 4]> = values.chunks_exact(4).map(|c| [c[0], c[1], c[2], c[3]]).collect();
    let form = Form { depth: false, half: true };
    let found = resolved(&device, form, &state);
    for (found, state) in found.iter().zip(&state) {
        let twin = resolve::reference(form, *state);
        assert_eq!(found.map(f32::to_bits), twin.map(f32::to_bits), "{state:?}");
    }
    // As single floats they pass unchanged.
    assert_eq!(resolved(&device, Form { depth: false, half: false }, &state), state);
    // Sabotage: rounding towards zero is another picture.
    let truncated = |x: f32| f32::from_bits(x.to_bits() & 0xffff_e000);
    assert!(found.iter().zip(&state).any(|(f, s)| s[1].abs() > 1e-3 && f[1] != truncated(s[1])));
    assert!(resolved(&device, form, &[[f32::NAN; 4]])[0].iter().all(|v| v.is_nan()));
    clean(&device);
}

#[test]
fn coverage_is_that_of_the_optical_depth() {
    let device = open();
    let state: Vec<[f32; 4]> = (0..4000).map(|i| [1.0, 2.0, 3.0, 1e-7 * (i as f32 * 0.005).exp()]).collect();
    for half in [false, true] {
        let form = Form { depth: true, half };
        for (found, state) in resolved(&device, form, &state).iter().zip(&state) {
            let twin = resolve::reference(form, *state);
            // The series ends at the fourth power of 0.05 at most; beyond, 1 - exp(-x) is off by some ulp of 1. A half may fall to
            // either side of what it is rounded to.
            let single = if state[3] < 0.05 { 1e-6 * twin[3] } else { 2.4e-7 };
            let allowed = if half { twin[3] / 1024.0 + 6e-8 } else { single };
            assert!((found[3] - twin[3]).abs() <= allowed && found[..3] == twin[..3], "{found:?} for {state:?}");
        }
    }
    // Sabotage: the depth itself is not the coverage.
    let form = Form { depth: true, half: false };
    assert!((resolved(&device, form, &[[0.0, 0.0, 0.0, 0.5]])[0][3] - 0.5).abs() > 0.1);
    clean(&device);
}
