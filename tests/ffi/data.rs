//! Memory of the host: types, strides, copies, loans, maps, files.

use crate::scenes::*;
use crate::{Engine, init};
use halflight::ffi::*;
use std::ffi::{CString, c_void};
use std::ptr::null;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The picture of a volume under the defaults.
fn picture(engine: &Engine, info: &hl_volume_info) -> Vec<f32> {
    let mut volume = std::ptr::null_mut();
    ok!(hl_volume_create(engine.0, info, &mut volume));
    let field = field(engine.0, &quick(volume));
    let image = image(engine.0, &small(field));
    let all = pixels(image);
    ok!(hl_volume_destroy(volume));
    ok!(hl_field_destroy(field));
    ok!(hl_image_destroy(image));
    assert!(all.iter().any(|&v| v > 0.1), "something is seen");
    all
}

#[test]
fn every_type_and_any_strides_show_the_same() {
    let engine = Engine::new();
    let n = 12;
    let data: Vec<u8> = ball(n).into_iter().map(|v| v / 2).collect();
    let dims = [n as u32; 3];
    let truth = picture(&engine, &volume_info(&data, n));
    macro_rules! same {
        ($($name:ident: $type:ty),*) => {$({
            let other: Vec<$type> = data.iter().map(|&v| v as $type).collect();
            let info = hl_volume_info { data: other.as_ptr().cast(), dims, r#type: $name, ..init() };
            let worst = picture(&engine, &info).iter().zip(&truth).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // A signed sample v is 1/2 + v/65535 on the device, of which half an ulp is 0.002 samples: of a ramp over 60
            // samples 3e-5, which its steep end, where opacity comes to 1, multiplies by some ten.
            assert!(worst < 1e-3, "{}: {worst}", stringify!($name));
        })*};
    }
    same!(HL_INT8: i8, HL_UINT16: u16, HL_INT16: i16, HL_UINT32: u32, HL_INT32: i32, HL_UINT64: u64, HL_INT64: i64, HL_FLOAT32: f32, HL_FLOAT64: f64);

    // Turned inside out: z fastest and backwards, with a hole between the samples; the picture is the same bit for bit.
    let (step, row) = (3usize, 3 * n + 1);
    let mut odd = vec![77u8; row * n * n];
    for z in 0..n {
        for y in 0..n {
            for x in 0..n {
                odd[(x * n + y) * row + (n - 1 - z) * step] = data[x + n * (y + n * z)];
            }
        }
    }
    let strides = [(row * n) as i64, row as i64, -(step as i64)];
    let first = odd[(n - 1) * step..].as_ptr().cast();
    let info = hl_volume_info { data: first, dims, r#type: HL_UINT8, strides, ..init() };
    assert_eq!(picture(&engine, &info), truth);
    // Slope and intercept: the ramp lies over the values, wherever they are.
    let info = hl_volume_info { slope: 2.0, intercept: -100.0, ..volume_info(&data, n) };
    let worst = picture(&engine, &info).iter().zip(&truth).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-3, "{worst}");
    // Sabotage: other data, another picture.
    let mut wrong = data.clone();
    wrong[n * n * n / 2..].fill(0);
    assert_ne!(picture(&engine, &volume_info(&wrong, n)), truth);
}

#[test]
fn numbers_that_are_none_are_found_or_replaced() {
    let engine = Engine::new();
    let mut data = [0.5f32; 27];
    data[14] = f32::NAN;
    let info = hl_volume_info { data: data.as_ptr().cast(), dims: [3; 3], r#type: HL_FLOAT32, ..init() };
    let mut volume = std::ptr::null_mut();
    refused!(HL_ERROR_INVALID, "sample (2, 1, 1) is NaN", hl_volume_create(engine.0, &info, &mut volume));
    assert!(volume.is_null());
    ok!(hl_volume_create(engine.0, &hl_volume_info { replace_nan: 1, nan_as: 2.0, ..info }, &mut volume));
    let (mut dims, mut range) = ([0u32; 3], [0f64; 2]);
    ok!(hl_volume_get_range(volume, dims.as_mut_ptr(), range.as_mut_ptr()));
    assert_eq!((dims, range), ([3; 3], [0.5, 2.0]));
}

static RELEASED: AtomicUsize = AtomicUsize::new(0);

unsafe extern "C-unwind" fn release(user: *mut c_void, data: *const c_void) {
    assert_eq!(user.addr(), 42);
    assert!(!data.is_null());
    RELEASED.fetch_add(1, Ordering::SeqCst);
}

#[test]
fn borrowed_memory_is_let_go_of_once() {
    let engine = Engine::new();
    let n = 12;
    let data = ball(n);
    let lent = hl_volume_info {
        memory: HL_BORROW,
        release: Some(release),
        release_user: std::ptr::without_provenance_mut(42),
        ..volume_info(&data, n)
    };
    let mut volume = std::ptr::null_mut();
    // A call that fails does not take it.
    refused!(HL_ERROR_INVALID, "must be one of", hl_volume_create(engine.0, &hl_volume_info { r#type: 99, ..lent }, &mut volume));
    assert_eq!(RELEASED.load(Ordering::SeqCst), 0);
    ok!(hl_volume_create(engine.0, &lent, &mut volume));
    let mut job = std::ptr::null_mut();
    // What a job reads stays until it has ended.
    let info = hl_precompute_info { directions: 256, ..quick(volume) };
    ok!(hl_precompute_start(engine.0, &info, &mut job));
    ok!(hl_volume_destroy(volume));
    ok!(hl_job_wait(job, -1.0));
    let mut field = std::ptr::null_mut();
    ok!(hl_job_get_field(job, &mut field));
    ok!(hl_job_destroy(job));
    assert_eq!(RELEASED.load(Ordering::SeqCst), 1);
    let image = image(engine.0, &small(field));
    assert!(pixels(image).iter().any(|&v| v > 0.1));

    // An image, read when it is used; the engine's end lets go of it.
    let texels: Vec<[f32; 3]> = (0..8 * 4).map(|i| [i as f32, 1.0, 0.5]).collect();
    let info = hl_image_info {
        data: texels.as_ptr().cast(),
        width: 8,
        height: 4,
        format: HL_RGB32F,
        memory: HL_BORROW,
        release: Some(release),
        release_user: std::ptr::without_provenance_mut(42),
        ..init()
    };
    let mut probe = std::ptr::null_mut();
    ok!(hl_image_create(engine.0, &info, &mut probe));
    let mut light = std::ptr::null_mut();
    ok!(hl_light_create(engine.0, &hl_light_info { kind: HL_LIGHT_PROBE, probe, ..init() }, &mut light));
    assert_eq!(RELEASED.load(Ordering::SeqCst), 1);
    drop(engine);
    assert_eq!(RELEASED.load(Ordering::SeqCst), 2);
}

#[test]
fn pictures_go_out_and_in() {
    let engine = Engine::new();
    let field = field(engine.0, &quick(volume(engine.0, 16)));
    let image = image(engine.0, &small(field));
    let all = pixels(image);
    let (mut map, mut count) = (std::ptr::null(), 0);
    ok!(hl_image_map(image, &mut map, &mut count));
    // SAFETY: mapped, of this length.
    assert_eq!(unsafe { std::slice::from_raw_parts(map, count as usize) }, all);
    ok!(hl_image_unmap(image));
    refused!(HL_ERROR_INVALID, "not mapped", hl_image_unmap(image));

    // Rows with a gap; what lies in it stays.
    let (row, stride) = (40 * 4, 40 * 4 + 7);
    let mut bytes = vec![9u8; 30 * stride];
    ok!(hl_image_read(image, HL_RGBA8, 0.0, bytes.as_mut_ptr().cast(), stride as i64, bytes.len() as u64));
    assert!(bytes[row..stride].iter().all(|&b| b == 9));
    // Upwards, as OpenGL and BMP lay them: the same rows, the other way round.
    let mut flipped = vec![9u8; 30 * stride];
    let top = flipped[29 * stride..].as_mut_ptr();
    ok!(hl_image_read(image, HL_RGBA8, 0.0, top.cast(), -(stride as i64), flipped.len() as u64));
    assert!((0..30).all(|y| flipped[(29 - y) * stride..][..stride] == bytes[y * stride..][..stride]) && flipped != bytes);
    let least = (29 * stride + row) as u64;
    ok!(hl_image_read(image, HL_RGBA8, 0.0, top.cast(), -(stride as i64), least));
    for (stride, size) in [(-(stride as i64), least - 1), (-159, least), (159, least), (i64::MIN, u64::MAX), (i64::MAX, u64::MAX)] {
        refused!(HL_ERROR_INVALID, "30 rows of 160 bytes", hl_image_read(image, HL_RGBA8, 0.0, top.cast(), stride, size));
    }
    let size = bytes.len() as u64 - 8;
    refused!(HL_ERROR_INVALID, "30 rows of 160 bytes", hl_image_read(image, HL_RGBA8, 0.0, bytes.as_mut_ptr().cast(), stride as i64, size));

    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| CString::new(folder.path().join(name).to_str().unwrap()).unwrap();
    let mut again = std::ptr::null_mut();
    ok!(hl_image_save(image, path("a.exr").as_ptr(), null()));
    ok!(hl_image_load(engine.0, path("a.exr").as_ptr(), &mut again));
    assert_eq!(pixels(again), all);
    // Twice as wide as high, as a probe is: a picture all the same, with its coverage.
    let wide = self::image(engine.0, &hl_render_info { width: 64, height: 32, ..small(field) });
    ok!(hl_image_save(wide, path("w.exr").as_ptr(), null()));
    ok!(hl_image_load(engine.0, path("w.exr").as_ptr(), &mut again));
    assert!(pixels(again) == pixels(wide) && pixels(again).chunks(4).any(|p| p[3] == 0.0));
    ok!(hl_image_load(engine.0, path("a.exr").as_ptr(), &mut again));
    ok!(hl_image_save(image, path("a.png").as_ptr(), &hl_save_info { exposure: 0.5, ..init() }));
    let mut difference: hl_difference = init();
    ok!(hl_image_compare(again, image, &mut difference));
    assert!(difference.relative_rmse == 0.0 && difference.flip_mean == 0.0 && (difference.mean_ratio - 1.0).abs() < 1e-12);
    // From memory, upside down.
    let last_row = all[4 * 40 * 29..].as_ptr().cast();
    let info = hl_image_info { data: last_row, width: 40, height: 30, row_stride: -(4 * 4 * 40), ..init() };
    ok!(hl_image_create(engine.0, &info, &mut again));
    let flipped = pixels(again);
    assert!(flipped[..160] == all[4 * 40 * 29..] && flipped != all);
    ok!(hl_image_compare(again, image, &mut difference));
    assert!(difference.relative_rmse > 0.1 && difference.flip_mean > 0.01 && difference.largest > 0.1);
    // Mirrored: columns go left from the last, rows still go down.
    let info = hl_image_info { data: all[4 * 39..].as_ptr().cast(), width: 40, height: 30, column_stride: -16, ..init() };
    ok!(hl_image_create(engine.0, &info, &mut again));
    let mirrored: Vec<f32> = all.chunks(160).flat_map(|row| row.chunks(4).rev().flatten().copied()).collect();
    assert!(pixels(again) == mirrored && mirrored != all);
    refused!(HL_ERROR_INVALID, "an .exr or .png", hl_image_save(image, path("a.gif").as_ptr(), null()));
    refused!(HL_ERROR_IO, "no such folder", hl_image_save(image, path("b/a.png").as_ptr(), null()));
    refused!(HL_ERROR_IO, "no such file", hl_image_load(engine.0, path("none.png").as_ptr(), &mut again));
    assert!(again.is_null());
}

#[test]
fn a_field_is_read_and_mapped() {
    let engine = Engine::new();
    let field = field(engine.0, &quick(volume(engine.0, 16)));
    let mut info: hl_field_info = init();
    ok!(hl_field_get_info(field, &mut info));
    assert_eq!(
        (info.dims, info.coefficients, info.method, info.ratio, info.bits, info.directions),
        ([4; 3], 16, HL_METHOD_SWEEP, 4, 8, 32)
    );
    assert!(info.error < 0.0 && info.bytes > 0);
    let mut numbers = vec![0f32; 64 * 16];
    ok!(hl_field_read(field, numbers.as_mut_ptr(), numbers.len() as u64));
    // A corner sees nearly all of the sky: v00 near 2√π.
    assert!(numbers[0] > 3.0 && numbers[0] < 3.6 && numbers.iter().all(|v| v.is_finite()));
    let (mut map, mut count) = (std::ptr::null(), 0);
    ok!(hl_field_map(field, &mut map, &mut count));
    // SAFETY: mapped, of this length.
    assert_eq!(unsafe { std::slice::from_raw_parts(map, count as usize) }, numbers);
    ok!(hl_field_unmap(field));
    refused!(HL_ERROR_INVALID, "room for 1024 numbers", hl_field_read(field, numbers.as_mut_ptr(), 1023));
}
