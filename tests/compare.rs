//! One picture against another: FLIP as its authors' evaluator computes it, RMSE by formula, pictures read, and `compare`.

mod common;
use common::Random;
use halflight::io::{self, PictureKind};
use halflight::measure::{compare, flip, relative_rmse};
use halflight::scene::Picture;
use std::path::Path;

/// A test picture and its reference, by formula: a disc with a gradient, rippled, with a discoloured block and bright
/// dots. `radiance` ranges over six stops; `black` leaves out what is not in the disc.
fn pictures(w: usize, h: usize, radiance: bool, black: bool) -> [Picture; 2] {
    let mut pair = [Picture::new(w, h), Picture::new(w, h)];
    for i in 0..w * h {
        let (column, row) = (i % w, i / w);
        let (x, y, width, height) = (column as f64, row as f64, w as f64, h as f64);
        let r = (x - 0.4 * width).hypot(y - 0.5 * height) / height;
        let dim = if r < 0.35 { 1.0 } else { 0.15 };
        let reference = [0.2 + 0.6 * x / width, 0.3 + 0.5 * y / height, 0.5 + 0.4 * (9.0 * r).cos()].map(|v| v * dim);
        let ripple = 1.0 + 0.2 * (0.37 * x).sin() * (0.23 * y).cos();
        let block = (h / 4..h / 2).contains(&row) && (w / 2..3 * w / 4).contains(&column);
        let stain = if block { [1.3, 0.8, 1.0] } else { [1.0; 3] };
        let dot = if row % 7 == 0 && column % 11 == 0 { 0.25 } else { 0.0 };
        let test = [0, 1, 2].map(|c| reference[c] * ripple * stain[c] + dot);
        let gain = if black && r >= 0.35 {
            0.0
        } else if radiance {
            (6.0 * x / width - 2.0).exp2()
        } else {
            1.0
        };
        for (picture, rgb) in pair.iter_mut().zip([test, reference]) {
            let [r, g, b] = rgb.map(|v| (v * gain) as f32).map(|v| if radiance { v } else { v.clamp(0.0, 1.0) });
            picture.rgba[i] = [r, g, b, 1.0];
        }
    }
    pair
}

/// Radiance?, width, height, black around?; mean, largest, the middle pixel, the first pixel, weighted median.
type Expected = (bool, usize, usize, bool, [f64; 5]);

/// What the authors' evaluator says of the same pictures in linear RGB (`pip install flip-evaluator==1.7`, then
/// `flip_evaluator.evaluate(reference, test, "LDR" or "HDR", inputsRGB=False, applyMagma=False)`).
const EVALUATED: [Expected; 6] = [
    (false, 24, 17, false, [0.165433, 0.632561, 0.225104, 0.632561, 0.190957]),
    (false, 96, 64, false, [0.142431, 0.649419, 0.293366, 0.649419, 0.178411]),
    (false, 51, 37, true, [0.079645, 0.510904, 0.204319, 0.0, 0.236859]),
    (true, 24, 17, false, [0.168376, 0.712618, 0.140770, 0.712618, 0.197936]),
    (true, 96, 64, false, [0.154328, 0.768472, 0.166953, 0.768472, 0.191553]),
    (true, 51, 37, true, [0.053001, 0.302137, 0.146256, 0.0, 0.157467]),
];

/// The exposures that it chose: first, last, number.
const EXPOSURES: [(f64, f64, usize); 3] = [(0.183214, 2.513615, 3), (0.193773, 2.457491, 3), (0.063952, 24.083298, 25)];

fn figures(radiance: bool, [test, reference]: &[Picture; 2]) -> (flip::Flip, [f64; 5]) {
    let of = if radiance { flip::radiance } else { flip::display };
    let f = of(test, reference).expect("comparable");
    let (w, h) = (reference.width, reference.height);
    let middle = f64::from(f.map[h / 2 * w + w / 2]);
    let figures = [f.mean, f.max, middle, f64::from(f.map[0]), f.weighted[2]];
    (f, figures)
}

#[test]
fn flip_is_what_its_authors_compute() {
    let mut chosen = EXPOSURES.iter();
    for (radiance, w, h, black, expected) in EVALUATED {
        let pair = pictures(w, h, radiance, black);
        let (f, found) = figures(radiance, &pair);
        let worst = |found: &[f64; 5]| found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        println!("{radiance} {w}x{h} {black}: {found:.6?}, off by {:.1e}", worst(&found));
        assert!(worst(&found) < 1e-4, "{found:?} {expected:?}");
        assert_eq!(f.exposures.is_some(), radiance);
        if let Some((first, last, count)) = f.exposures {
            let e = chosen.next().expect("three");
            assert!((first - e.0).abs() < 1e-4 && (last - e.1).abs() < 1e-4 && count == e.2, "{:?} {e:?}", f.exposures);
        }
        // Sabotage: two channels in the place of each other, the pictures in the place of each other (radiance), and one
        // hundredth more light are all seen.
        let mut swapped = pair.clone();
        swapped.iter_mut().flat_map(|p| &mut p.rgba).for_each(|p| p.swap(0, 2));
        assert!(worst(&figures(radiance, &swapped).1) > 1e-3);
        let mut brighter = pair.clone();
        brighter[0].rgba.iter_mut().for_each(|p| p[..3].iter_mut().for_each(|v| *v *= 1.01));
        assert!(worst(&figures(radiance, &brighter).1) > 1e-3);
    }
}

#[test]
fn flip_of_a_picture_and_itself_is_nothing_and_of_opposites_everything() {
    for radiance in [false, true] {
        let [_, reference] = pictures(40, 30, radiance, false);
        let (f, found) = figures(radiance, &[reference.clone(), reference]);
        assert_eq!(found, [0.0; 5]);
        assert_eq!(f.weighted, [0.0; 6]);
    }
    // Green against blue is the farthest that colours are apart, far from any edge.
    let of = |rgb: [f32; 3]| Picture { width: 64, height: 64, rgba: vec![[rgb[0], rgb[1], rgb[2], 1.0]; 64 * 64] };
    let f = flip::display(&of([0.0, 1.0, 0.0]), &of([0.0, 0.0, 1.0])).expect("comparable");
    assert!((f.mean - 1.0).abs() < 1e-4, "{}", f.mean);
    // One pixel, and a black reference, have their figures too.
    let dot = |v| Picture { width: 1, height: 1, rgba: vec![[v, v, v, 1.0]] };
    let f = flip::radiance(&dot(1.0), &dot(0.0)).expect("comparable");
    assert!(f.mean > 0.1 && f.mean <= 1.0 && f.exposures.is_some_and(|e| e.2 == 2), "{f:?}");
}

#[test]
fn weighted_percentiles_count_each_pixel_by_its_difference() {
    let [test, reference] = pictures(96, 64, false, false);
    let f = flip::display(&test, &reference).expect("comparable");
    let total: f64 = f.map.iter().map(|&v| f64::from(v)).sum();
    for (percent, at) in flip::PERCENTILES.iter().zip(f.weighted) {
        let below = |limit: f64| f.map.iter().map(|&v| f64::from(v)).filter(|v| *v < limit).sum::<f64>() / total;
        let share = f64::from(*percent) / 100.0;
        assert!(below(at) <= share + 1e-9 && below(at + 1e-7) >= share, "{percent} % at {at}: {}", below(at));
        // Sabotage: a hundredth beside it is not that percentile.
        assert!(below(at + 0.01) > share + 1e-4 && (below(at - 0.01) < share - 1e-5));
    }
    assert!(f.weighted.is_sorted() && f.weighted[5] <= f.max);
}

#[test]
fn rmse_ratio_and_largest_difference_are_what_was_put_in() {
    let mut b = Picture::new(8, 4);
    for (i, p) in b.rgba.iter_mut().enumerate() {
        *p = if i % 2 == 0 { [0.5, 1.0, 1.5, 0.7] } else { [0.0; 4] };
    }
    let mut a = b.clone();
    a.rgba.iter_mut().for_each(|p| p[..3].iter_mut().for_each(|v| *v *= 1.1));
    let d = compare(&a, &b).expect("comparable");
    // √mean((0.1 v)²)/mean(v) over 0.5, 1, 1.5.
    let expected = 0.1 * ((0.25 + 1.0 + 2.25) / 3.0f64).sqrt();
    assert!((d.relative_rmse.expect("covered") - expected).abs() < 1e-6 && d.relative_rmse == relative_rmse(&a, &b));
    // Half of the pixels are empty in both: mean and mean square are halved.
    assert!((d.relative_rmse_all.expect("not black") - expected * 2f64.sqrt()).abs() < 1e-6);
    assert!((d.mean_ratio.expect("covered") - 1.1).abs() < 1e-6 && d.covered == 16 && d.size == [8, 4]);
    a.rgba[8 * 2 + 5][1] = -3.0;
    let d = compare(&a, &b).expect("comparable");
    assert!((d.max - 3.0).abs() < 1e-9 && d.max_at == [5, 2, 1], "{d:?}");
    assert_eq!(compare(&b, &b).expect("comparable").relative_rmse, Some(0.0));
    let black = Picture::new(8, 4);
    let d = compare(&b, &black).expect("comparable");
    assert_eq!((d.relative_rmse, d.relative_rmse_all, d.mean_ratio, d.covered), (None, None, None, 0));
    // What cannot be compared is refused by each alike.
    b.rgba[9][2] = f32::NAN;
    for (p, q, says) in
        [(&a, &Picture::new(4, 8), "8x4 pixels against 4x8"), (&a, &b, "pixel 1,1 of the second is"), (&b, &a, "of the first")]
    {
        for error in [compare(p, q).err(), flip::display(p, q).err(), flip::radiance(p, q).err()] {
            let error = error.expect("refused").to_string();
            assert!(error.contains(says), "{error}");
        }
    }
    let short = Picture { width: 3, height: 3, rgba: vec![[0.0; 4]; 8] };
    assert!(compare(&short, &short).is_err());
}

fn png(path: &Path, color: png::ColorType, depth: png::BitDepth, palette: Option<&[u8]>, size: (u32, u32), data: &[u8]) {
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), size.0, size.1);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if let Some(palette) = palette {
        encoder.set_palette(palette.to_vec());
    }
    encoder.write_header().unwrap().write_image_data(data).unwrap();
}

#[test]
fn pictures_of_every_kind_are_read() {
    use png::{BitDepth, ColorType};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.png");
    let close = |a: [f32; 4], b: [f32; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
    let read = || io::read_picture(&path).unwrap();
    // sRGB 188 is linear 0.5029; premultiplied with alpha 51/255.
    let half = 0.50289;
    png(&path, ColorType::Rgba, BitDepth::Eight, None, (2, 1), &[188, 255, 0, 51, 188, 188, 188, 255]);
    let (kind, p) = read();
    assert_eq!((kind, p.width, p.height), (PictureKind::Display, 2, 1));
    assert!(close(p.rgba[0], [half * 0.2, 0.2, 0.0, 0.2]) && close(p.rgba[1], [half, half, half, 1.0]), "{p:?}");
    // Sabotage: without the transfer function it would be 188/255.
    assert!(!close(p.rgba[1], [188.0 / 255.0, half, half, 1.0]));
    png(&path, ColorType::Rgb, BitDepth::Sixteen, None, (1, 1), &[188, 188, 0, 0, 255, 255]);
    assert!(close(read().1.rgba[0], [half, 0.0, 1.0, 1.0]));
    png(&path, ColorType::Grayscale, BitDepth::One, None, (2, 1), &[0b0100_0000]);
    assert_eq!(read().1.rgba, [[0.0, 0.0, 0.0, 1.0], [1.0; 4]]);
    png(&path, ColorType::GrayscaleAlpha, BitDepth::Eight, None, (1, 1), &[188, 51]);
    assert!(close(read().1.rgba[0], [half * 0.2, half * 0.2, half * 0.2, 0.2]));
    png(&path, ColorType::Indexed, BitDepth::Eight, Some(&[0, 0, 0, 188, 255, 0]), (2, 1), &[1, 0]);
    assert!(close(read().1.rgba[0], [half, 1.0, 0.0, 1.0]) && read().1.rgba[1] == [0.0, 0.0, 0.0, 1.0]);
    // What we write: to half a step of eight bits.
    let [_, reference] = pictures(24, 17, false, false);
    io::write_png(&path, &reference, 0.0, &[]).unwrap();
    let back = read().1;
    assert!(compare(&back, &reference).unwrap().max < 0.006, "{:?}", compare(&back, &reference));
    let exr = folder.path().join("p.exr");
    io::write_exr(&exr, &reference, &[]).unwrap();
    assert_eq!(io::read_picture(&exr).unwrap(), (PictureKind::Radiance, reference));
}

#[test]
fn damaged_pictures_are_refused_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.png");
    let [_, reference] = pictures(24, 17, false, false);
    io::write_png(&path, &reference, 0.0, &[("scene".into(), "x = 1".into())]).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let says = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        io::read_picture(&path).map_err(|e| e.to_string())
    };
    for cut in [0, 3, 8, 20, 33, 60, whole.len() / 2, whole.len() - 20] {
        let sentence = says(&whole[..cut]).expect_err("cut short");
        assert!(sentence.contains("p.png: ") && !sentence.contains('\n') && sentence.len() < 500, "{cut}: {sentence}");
    }
    assert!(says(b"GIF89a").expect_err("no picture").contains("neither OpenEXR's nor PNG's"));
    // A claim of 2^31 − 1 by 2^31 − 1 pixels, with its checksum right, asks for no memory.
    let mut huge = whole[..8].to_vec();
    let mut chunk = b"IHDR\x7f\xff\xff\xff\x7f\xff\xff\xff\x10\x06\0\0\0".to_vec();
    huge.extend(13u32.to_be_bytes());
    let crc =
        chunk.iter().fold(!0u32, |c, b| (0..8).fold(c ^ u32::from(*b), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 }));
    chunk.extend((!crc).to_be_bytes());
    huge.extend(chunk);
    huge.extend(&whole[33..]);
    assert!(says(&huge).is_err());
    // Any change of a byte is refused or read, never a panic; most are refused by a checksum.
    let mut random = Random(11);
    let mut refused = 0;
    for _ in 0..600 {
        let mut bytes = whole.clone();
        for _ in 0..2 {
            let at = (random.unit() * bytes.len() as f32) as usize % bytes.len();
            bytes[at] ^= 1 << ((random.unit() * 8.0) as u8 % 8);
        }
        refused += usize::from(says(&bytes).is_err());
    }
    assert!(refused > 500, "{refused}");
}

#[cfg(feature = "cli")]
mod cli {
    use super::*;
    use crate::common::run;
    use serde_json::Value;

    #[test]
    fn compare_says_and_draws_the_difference() {
        let folder = tempfile::tempdir().unwrap();
        let f = folder.path();
        let [a, b] = pictures(51, 37, true, true);
        io::write_exr(&f.join("a.exr"), &a, &[]).unwrap();
        io::write_exr(&f.join("b.exr"), &b, &[]).unwrap();
        let (code, out, err) = run(f, &["compare", "a.exr", "b.exr", "-o", "d.exr"]);
        assert_eq!((code, err.as_str()), (0, ""));
        for part in ["rel. RMSE", "over covered pixels", "HDR-FLIP over 25 exposures", "0.053", "95 %: ", "wrote      d.exr"] {
            assert!(out.contains(part), "{part}: {out}");
        }
        let (_, d) = io::read_picture(&f.join("d.exr")).unwrap();
        assert!((0..a.rgba.len()).all(|i| (0..3).all(|c| d.rgba[i][c] == a.rgba[i][c] - b.rgba[i][c])));
        let (code, out, _) = run(f, &["compare", "a.exr", "b.exr", "-o", "d.png", "--json"]);
        let v: Value = serde_json::from_str(&out).unwrap();
        let mean = v["flip"]["mean"].as_f64().unwrap();
        assert!(code == 0 && (mean - EVALUATED[5].4[0]).abs() < 1e-4 && v["flip"]["exposures"]["count"] == 25, "{v}");
        assert_eq!(v["difference"]["relative_rmse"].as_f64(), relative_rmse(&a, &b));
        assert!((v["flip"]["weighted_percentiles"]["50"].as_f64().unwrap() - EVALUATED[5].4[4]).abs() < 1e-4);
        // Where nothing differs the map is magma's darkest, elsewhere brighter.
        let (_, d) = io::read_picture(&f.join("d.png")).unwrap();
        let worst = v["flip"]["max"].as_f64().unwrap();
        assert!(d.rgba[0][..3].iter().all(|v| *v < 0.01) && worst > 0.2);
        assert!(d.rgba.iter().any(|p| p[0] > 0.05));
        // The other way round, the difference changes its sign and the reference its mean.
        let (_, out, _) = run(f, &["compare", "b.exr", "a.exr", "--json"]);
        let w: Value = serde_json::from_str(&out).unwrap();
        assert_ne!(v["difference"]["relative_rmse"], w["difference"]["relative_rmse"]);
        let (code, out, _) = run(f, &["compare", "a.exr", "a.exr"]);
        assert!(code == 0 && out.contains("0.00000 over covered pixels") && out.contains("0.000000 mean"), "{out}");
        // For the eye.
        let [a, b] = pictures(24, 17, false, false);
        io::write_png(&f.join("a.png"), &a, 0.0, &[]).unwrap();
        io::write_png(&f.join("b.png"), &b, 0.0, &[]).unwrap();
        let (code, out, _) = run(f, &["compare", "a.png", "b.png", "--json"]);
        let v: Value = serde_json::from_str(&out).unwrap();
        // Eight bits move it a little.
        assert!(code == 0 && v["flip"]["kind"] == "ldr" && (v["flip"]["mean"].as_f64().unwrap() - EVALUATED[0].4[0]).abs() < 5e-3, "{v}");
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let f = folder.path();
        let [mut a, b] = pictures(8, 6, true, false);
        io::write_exr(&f.join("a.exr"), &a, &[]).unwrap();
        io::write_exr(&f.join("small.exr"), &pictures(7, 6, true, false)[0], &[]).unwrap();
        io::write_png(&f.join("a.png"), &b, 0.0, &[]).unwrap();
        a.rgba[8 * 2 + 3][1] = f32::NAN;
        io::write_exr(&f.join("nan.exr"), &a, &[]).unwrap();
        std::fs::write(f.join("text.png"), "no picture").unwrap();
        let cases: [(&[&str], i32, &str); 8] = [
            (&["a.exr", "small.exr"], 3, "a.exr: compared with small.exr: 8x6 pixels against 7x6; both must be of one size"),
            (&["nan.exr", "a.exr"], 3, "pixel 3,2 of the first is"),
            (&["a.exr", "nan.exr"], 3, "pixel 3,2 of the second is"),
            (
                &["a.exr", "a.png"],
                3,
                "a.exr: it is linear radiance (OpenEXR), the reference is for display (PNG); both must be of one kind",
            ),
            (&["text.png", "a.png"], 3, "text.png: its first bytes are neither OpenEXR's nor PNG's; a picture is an .exr or .png"),
            (&["gone.png", "a.png"], 3, "no such file"),
            (&["a.exr", "a.exr", "-o", "a.exr"], 2, "is an input of this command"),
            (&["a.exr"], 2, "<REFERENCE>"),
        ];
        for (arguments, expected, part) in cases {
            let (code, out, err) = run(f, &[&["compare"], arguments].concat());
            assert_eq!((code, out.as_str()), (expected, ""), "{arguments:?}: {err}");
            assert!(err.contains(part) && err.trim_end().lines().count() == 1, "{arguments:?}: {err}");
        }
    }
}
