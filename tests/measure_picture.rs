//! The measured error of a picture: what was put into it is found, through noise too, and said.

mod common;
use common::*;
use halflight::measure::{PictureError, Pictured};
use halflight::scene::visibility::Method;
use halflight::scene::{Camera, Grid, ImageSettings, Light, Picture, Sky, Visibility, Volume};

/// The error of a picture under a light of `radiance` against a sky of 1, with so many seconds for each reference; and the
/// pictures of that many pixels.
fn measured<const N: usize>(radiances: [f64; N], seconds: f64) -> [(PictureError, Picture); N] {
    let engine = engine();
    let grid = Grid::axis_aligned([24, 20, 16], [1.0; 3]).expect("grid");
    let volume = Volume::from_fn(grid, |_| 1.0).expect("volume");
    let (_, medium) = load(&engine, &volume, &homogeneous(1e-3));
    let settings = Visibility { method: Method::March, ratio: 2, directions: 64, bits: 16, ..Visibility::default() };
    let field = engine.precompute(&medium, &settings, &mut quiet).expect("field");
    let camera = Camera::framing(volume.grid());
    let image = ImageSettings { width: 300, height: 200, ..ImageSettings::default() };
    let sky = Sky::constant([1.0; 3]).expect("sky");
    radiances.map(|radiance| {
        let lit = engine.relight(&field, &Light::constant([radiance; 3])).expect("relight");
        let of = Pictured { medium: &medium, lit: &lit, sky: &sky, camera: &camera, image: &image };
        let error = PictureError::measure(&engine, &of, seconds, &mut quiet).expect("measure").expect("something is seen");
        let image = ImageSettings { width: error.size[0], height: error.size[1], ..image };
        (error, engine.render(&medium, &lit, &camera, &image, &mut quiet).expect("picture"))
    })
}

/// The relative RMSE, within its 95 % interval by the spread of the pixels, of a picture that is `right` and that share of it:
/// share·√mean(b²)/mean(b).
fn too_bright(right: &Picture, share: f64) -> [f64; 3] {
    let covered: Vec<f64> = right.rgba.iter().filter(|p| p[3] > 0.0).map(|p| f64::from(p[0] + p[1] + p[2]) / 3.0).collect();
    let mean = |v: &mut dyn Iterator<Item = f64>| v.sum::<f64>() / covered.len() as f64;
    let (b, square) = (mean(&mut covered.iter().copied()), mean(&mut covered.iter().map(|b| b * b)));
    let spread = (mean(&mut covered.iter().map(|b| (b * b - square).powi(2))) / covered.len() as f64).sqrt();
    [-1.96, 0.0, 1.96].map(|k| share * (square + k * spread).sqrt() / b)
}

/// Thin matter under constant light scatters what the formula says; so does its picture, whose error is then nothing. A light of
/// 1.5 times the sky's radiance is wrong by a half, and is said to be.
#[test]
fn a_pictures_error_is_what_was_put_into_it() {
    let [(right, picture), (bright, _)] = measured([1.0, 1.5], 2.0);
    assert!(right.size[0] < 120 && right.size[0] * 2 == right.size[1] * 3, "{:?}", right.size);
    assert!(right.relative_rmse < 0.02 && (right.mean_ratio - 1.0).abs() < 0.01, "{right:?}");
    // All pixels are off by half of what they are: relative to the mean a little more than a half, for pixels differ.
    let [least, expected, most] = too_bright(&picture, 0.5);
    println!("{bright:?}, expected {expected:.4} [{least:.4}, {most:.4}]");
    assert!((bright.mean_ratio - 1.5).abs() < 0.015 && (bright.relative_rmse - expected).abs() < 0.01, "{bright:?} {expected}");
    // Beside the spread there is the noise's tenth in doubt, of next to no noise.
    let [lo, hi] = bright.interval;
    for (end, wanted) in [(bright.relative_rmse - lo, expected - least), (hi - bright.relative_rmse, most - expected)] {
        assert!((0.8..1.25).contains(&(end / wanted)), "{end} {wanted}: {bright:?}");
    }
    let said = bright.sentence();
    assert!(said.contains("+50.") || said.contains("+49."), "{said}");
    assert!(said.contains(" is taken off the RMSE, not off FLIP, which is of all pixels"), "{said}");
}

/// Next to no time for the reference: its noise is larger than what it measures, is taken off, and widens the interval.
#[test]
fn an_error_is_found_through_stronger_noise() {
    let [(right, picture), (bright, _)] = measured([1.0, 1.05], 1e-9);
    let [_, expected, _] = too_bright(&picture, 0.05);
    println!("{right:?}\n{bright:?}, expected {expected:.4}");
    assert!(right.noise > 1.2 * expected && right.noise == bright.noise, "{right:?}");
    // Nothing is wrong, and that is among what the interval holds; what noise hides is about a third of it.
    assert!(right.interval[0] == 0.0 && right.relative_rmse < right.interval[1] && right.interval[1] < 0.5 * right.noise, "{right:?}");
    let [lo, hi] = bright.interval;
    assert!(0.0 < lo && lo < expected && expected < hi && hi < 1.5 * expected, "{bright:?} {expected}");
    // Sabotage: with its noise left in, the error would lie outside.
    assert!(bright.relative_rmse.hypot(bright.noise) > hi && right.noise > right.interval[1], "{bright:?}");
    // FLIP is of the noisy picture as it is.
    let [(sure, _)] = measured([1.0], 2.0);
    assert!(right.flip > 2.0 * sure.flip, "{} {}", right.flip, sure.flip);
}

#[cfg(feature = "cli")]
mod cli {
    use super::common::run;
    use serde_json::Value;

    #[test]
    fn render_measures_says_and_stores_it() {
        let folder = tempfile::tempdir().unwrap();
        let f = folder.path();
        let mut bytes = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 16 12 8\nencoding: raw\n\n".to_vec();
        bytes.extend((0..16 * 12 * 8).map(|i: i32| if (i % 16 - 8).abs() < 3 && (i / 192 - 4).abs() < 2 { 200u8 } else { 0 }));
        std::fs::write(f.join("v.nrrd"), bytes).unwrap();
        let scene = "volume.file = 'v.nrrd'\nvisibility.ratio = 2\nvisibility.directions = 32\nimage.width = 64\nimage.height = 48\n\
                     transfer.points = [[50, 1, 1, 1, 0], [150, 1, 1, 1, 0.5]]";
        std::fs::write(f.join("s.toml"), scene).unwrap();
        let (code, out, err) = run(f, &["render", "s.toml", "-o", "a.exr", "--measure=1"]);
        assert_eq!((code, err.as_str()), (0, ""), "{out}");
        assert!(out.contains("error      relative RMSE 0.") && out.contains("64x48 pixels against Monte Carlo of "), "{out}");
        // The picture is the same, and its header tells.
        assert_eq!(run(f, &["render", "s.toml", "-o", "b.exr"]).0, 0);
        let [a, b] = ["a.exr", "b.exr"].map(|n| halflight::io::read_picture(&f.join(n)).unwrap().1);
        assert_eq!(a.rgba, b.rgba);
        let has = |n: &str, text: &str| std::fs::read(f.join(n)).unwrap().windows(text.len()).any(|w| w == text.as_bytes());
        assert!(has("a.exr", "picture_error_json") && !has("b.exr", "picture_error_json"));
        let (code, out, _) = run(f, &["render", "s.toml", "-o", "c.png", "--measure=1", "--json"]);
        let said: Value = serde_json::from_str(&out).unwrap();
        let error = said["picture_error"]["relative_rmse"].as_f64().unwrap();
        assert!(code == 0 && error > 0.0 && error < 1.0, "{out}");
        let (code, _, err) = run(f, &["render", "s.toml", "-o", "d.exr", "--measure", "--reference"]);
        assert!(code == 2 && err.contains("cannot be used with") && !f.join("d.exr").exists(), "{err}");
        // An empty scene has no error.
        let (code, out, _) = run(f, &["render", "s.toml", "-o", "e.exr", "--measure=1", "--set", "transfer.points=[[50, 1, 1, 1, 0]]"]);
        assert!(code == 0 && out.contains("not measured: nothing is seen"), "{out}");
    }
}
