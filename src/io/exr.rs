//! OpenEXR: pictures out, pictures and probes in.

use super::exr_layers::{ExrChannel, ExrOptions, write_exr_layers};
use super::limits::open;
use super::write_aside;
use crate::error::{Error, Result};
use crate::room::more;
use crate::scene::Picture;
use exr::image::read::specific_channels::ReadSpecificChannel;
use exr::meta::MetaData;
use exr::meta::header::Header;
use exr::prelude::{
    AttributeValue, Encoding, Image, Layer, LayerAttributes, ReadChannels, ReadLayers, SpecificChannels, Text, Vec2, WritableImage, read,
};
use std::io::{BufRead, Seek};
use std::path::Path;

/// The first four bytes of an OpenEXR file.
pub(super) const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Most channels in a layer that is read.
pub(super) const MAX_CHANNELS: usize = 64;

/// Largest side of a picture, pixels.
pub(super) const MAX_SIDE: usize = 65_536;

/// Most pixels of a picture.
pub(super) const MAX_PIXELS: usize = 1 << 27;

/// Sixteen numbers of a picture's header: the standard attribute `worldToCamera` in OpenEXR.
pub const WORLD_TO_CAMERA: &str = "worldToCamera";

/// A number of a picture's header: the standard attribute `screenWindowWidth` in OpenEXR, the width of the picture one unit
/// before the camera.
pub const SCREEN_WINDOW_WIDTH: &str = "screenWindowWidth";

/// A number of a picture's header: the standard attribute `framesPerSecond` in OpenEXR, there a fraction.
pub const FRAMES_PER_SECOND: &str = "framesPerSecond";

/// The channel of what a picture covers, also where it lies over a background: that of `--aov opacity`.
const COVERAGE: &str = "opacity.Y";

/// Writes linear, premultiplied RGBA (OpenEXR's convention) as 32-bit float, ZIP compressed. Each pair of `meta` becomes a
/// text attribute `halflight/KEY`, a name that no standard attribute has, but for [`WORLD_TO_CAMERA`],
/// [`SCREEN_WINDOW_WIDTH`] and [`FRAMES_PER_SECOND`].
///
/// # Errors
/// [`Error::Invalid`] for a picture whose pixels do not match its size, or a key that is empty, longer than 245 bytes or
/// holds a NUL; [`Error::Io`] when the file cannot be written.
pub fn write_exr(path: &Path, picture: &Picture, meta: &[(String, String)]) -> Result<()> {
    check(picture)?;
    let at = |p: Vec2<usize>| {
        let [r, g, b, a] = picture.rgba[p.y() * picture.width + p.x()];
        (r, g, b, a)
    };
    let layer = Layer::new((picture.width, picture.height), attributes(meta)?, Encoding::SMALL_LOSSLESS, SpecificChannels::rgba(at));
    write_aside(path, |out| Image::from_layer(layer).write().to_buffered(out).map_err(|e| trouble(path, "write", e)))
}

/// As [`write_exr`], with the standard error of each pixel's R, G, B as the channels `stderr.R`, `stderr.G`, `stderr.B`, and, of a
/// picture that lies over a background, what it `covered` without one as the channel `opacity.Y`.
///
/// # Errors
/// As [`write_exr`], and [`Error::Invalid`] where there is not one standard error, or coverage, per pixel.
pub fn write_exr_with_error(
    path: &Path,
    picture: &Picture,
    standard_error: &[[f32; 3]],
    covered: Option<&[f32]>,
    meta: &[(String, String)],
) -> Result<()> {
    let noise = ["stderr.R", "stderr.G", "stderr.B"].into_iter().enumerate();
    let noise = noise.map(|(c, name)| (name, standard_error.iter().map(|e| e[c]).collect()));
    let channels = noise.chain(covered.map(|c| (COVERAGE, c.to_vec())));
    let more: Vec<_> = channels.map(|(name, values)| ExrChannel { name: name.into(), values, full: true }).collect();
    write_exr_layers(path, picture, &more, ExrOptions::default(), meta)
}

/// The header's own entries.
pub(super) fn attributes(meta: &[(String, String)]) -> Result<LayerAttributes> {
    let text = |s: &str| Text::from_slice_unchecked(s.as_bytes());
    let mut attributes =
        LayerAttributes { software_name: Some(text(concat!("halflight ", env!("CARGO_PKG_VERSION")))), ..LayerAttributes::default() };
    for (key, value) in meta {
        if key.is_empty() || key.len() > 245 || key.contains('\0') {
            return Err(Error::Invalid {
                item: "picture metadata",
                what: format!("the key {:?}", key.chars().take(40).collect::<String>()),
                right: "keys have 1 to 245 bytes and no NUL".into(),
            });
        }
        match key.as_str() {
            WORLD_TO_CAMERA => attributes.world_to_camera = Some(matrix(value).ok_or_else(|| unread(key, value))?),
            SCREEN_WINDOW_WIDTH => attributes.screen_window_width = width(value).ok_or_else(|| unread(key, value))?,
            FRAMES_PER_SECOND => attributes.frames_per_second = Some(fraction(value).ok_or_else(|| unread(key, value))?),
            _ => drop(attributes.other.insert(text(&format!("halflight/{key}")), AttributeValue::Text(text(value)))),
        }
    }
    Ok(attributes)
}

fn unread(key: &str, value: &str) -> Error {
    Error::Invalid {
        item: "picture metadata",
        what: format!("{key} is {:?}", value.chars().take(40).collect::<String>()),
        right: "worldToCamera is sixteen finite numbers, screenWindowWidth one above 0, framesPerSecond one in 0.001..1e6".into(),
    }
}

fn width(text: &str) -> Option<f32> {
    text.parse().ok().filter(|w: &f32| w.is_finite() && *w > 0.0)
}

fn matrix(text: &str) -> Option<[f32; 16]> {
    let numbers: Option<Vec<f32>> = text.split_whitespace().map(|n| n.parse().ok().filter(|x: &f32| x.is_finite())).collect();
    numbers?.try_into().ok()
}

/// The fraction of a rate: that with the smallest denominator, up to the 1001 of television, which is not off by a
/// hundred-millionth: two of those lie further apart.
fn fraction(text: &str) -> Option<(i32, u32)> {
    let rate: f64 = text.parse().ok().filter(|r| (1e-3..=1e6).contains(r))?;
    let off = |n: u32| ((rate * f64::from(n)).round() / f64::from(n) / rate - 1.0).abs();
    let n = (1..=1001).find(|&n| off(n) < 1e-8).unwrap_or(1000);
    Some(((rate * f64::from(n)).round() as i32, n))
}

/// Checks that a picture's pixels are those of its size.
pub(super) fn check(picture: &Picture) -> Result<()> {
    let Picture { width, height, rgba } = picture;
    if rgba.is_empty() || width.checked_mul(*height) != Some(rgba.len()) {
        return Err(Error::Invalid {
            item: "picture",
            what: format!("{} pixels for {width}x{height}", rgba.len()),
            right: "there must be one per place, and at least one".into(),
        });
    }
    Ok(())
}

/// Reads a picture as [`write_exr`] writes it: the first layer with R, G, B and, if there is one, A (else coverage 1).
///
/// # Errors
/// [`Error::Io`] when the file cannot be read; [`Error::Format`] when it is damaged, of another kind, or too large.
pub fn read_picture_exr(path: &Path) -> Result<Picture> {
    let (mut file, _) = open(path)?;
    let too_large = |w: usize, h: usize| {
        let good = w <= MAX_SIDE && h <= MAX_SIDE && w * h <= MAX_PIXELS;
        (!good).then(|| format!("at most {MAX_SIDE} a side and {MAX_PIXELS} pixels are read"))
    };
    let window = layer(path, &mut file, &["R", "G", "B"], too_large)?;
    window.check_primaries(path);
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required("R")
        .required("G")
        .required("B")
        .optional("A", 1.0)
        .collect_pixels(|size, _| Grid::new(size), |grid: &mut Grid<4>, at, (r, g, b, a)| grid.put(at, [r, g, b, a]))
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(file)
        .map_err(|e| trouble(path, "read", e))?;
    let (width, height, rgba) = window.shown(path, image.layer_data.channel_data.pixels.whole(path)?)?;
    Ok(Picture { width, height, rgba })
}

/// What the picture of a file covers of each pixel where it says so beside its alpha, which is 1 everywhere over a background.
pub(super) fn read_coverage(path: &Path) -> Result<Option<Vec<f32>>> {
    let (mut file, _) = open(path)?;
    let Ok(window) = layer(path, &mut file, &["R", "G", "B", COVERAGE], |_, _| None) else { return Ok(None) };
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required("R")
        .required(COVERAGE)
        .collect_pixels(|size, _| Grid::new(size), |grid: &mut Grid<1>, at, (_, covered): (f32, f32)| grid.put(at, [covered]))
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(file)
        .map_err(|e| trouble(path, "read", e))?;
    let (_, _, covered) = window.shown(path, image.layer_data.channel_data.pixels.whole(path)?)?;
    Ok(Some(covered.into_iter().flatten().collect()))
}

/// Width, height and RGB of a probe. `bad_shape` says what would be right, where a size is refused.
pub(super) fn read_rgb(
    path: &Path,
    mut file: impl BufRead + Seek,
    bad_shape: impl Fn(usize, usize) -> Option<String>,
) -> Result<(usize, usize, Vec<[f32; 3]>)> {
    let reader = || read().no_deep_data().largest_resolution_level().specific_channels();
    let (window, pixels) = match layer(path, &mut file, &["R", "G", "B"], &bad_shape) {
        Ok(window) => (
            window,
            reader()
                .required("R")
                .required("G")
                .required("B")
                .collect_pixels(|size, _| Grid::new(size), |grid: &mut Grid<3>, at, (r, g, b)| grid.put(at, [r, g, b]))
                .first_valid_layer()
                .all_attributes()
                .non_parallel()
                .from_buffered(file)
                .map(|image| image.layer_data.channel_data.pixels),
        ),
        Err(without_color) => {
            // The refusal that names R, G and B says more than one that misses Y.
            let Ok(window) = layer(path, &mut file, &["Y"], &bad_shape) else { return Err(without_color) };
            (
                window,
                reader()
                    .required("Y")
                    .collect_pixels(|size, _| Grid::new(size), |grid: &mut Grid<3>, at, (y,)| grid.put(at, [y; 3]))
                    .first_valid_layer()
                    .all_attributes()
                    .non_parallel()
                    .from_buffered(file)
                    .map(|image| image.layer_data.channel_data.pixels),
            )
        }
    };
    window.check_primaries(path);
    window.shown(path, pixels.map_err(|e| trouble(path, "read", e))?.whole(path)?)
}

/// What is shown of a layer: the display window, in which its data lie, or beyond which.
struct Window {
    size: [usize; 2],
    /// Of the data's first pixel.
    at: [i64; 2],
    /// Whether its colours are of the primaries of Rec. 709.
    rec709: bool,
}

impl Window {
    fn of(header: &Header) -> Self {
        let display = header.shared_attributes.display_window;
        let first = header.own_attributes.layer_position;
        let at = [first.0, first.1].map(i64::from);
        let corner = [display.position.0, display.position.1].map(i64::from);
        let near = |a: Vec2<f32>, b: (f32, f32)| (a.0 - b.0).abs() < 2e-3 && (a.1 - b.1).abs() < 2e-3;
        let rec709 = header.shared_attributes.chromaticities.is_none_or(|c| {
            near(c.red, (0.64, 0.33)) && near(c.green, (0.3, 0.6)) && near(c.blue, (0.15, 0.06)) && near(c.white, (0.3127, 0.329))
        });
        Self { size: [display.size.0, display.size.1], at: [at[0] - corner[0], at[1] - corner[1]], rec709 }
    }

    fn check_primaries(&self, path: &Path) {
        if !self.rec709 {
            log::warn!(
                "{}: its chromaticities are not those of Rec. 709; its red, green and blue are taken as they stand",
                crate::error::shown(path)
            );
        }
    }

    /// The display window of a layer's data: nothing where they do not reach.
    fn shown<const N: usize>(&self, path: &Path, (width, height, pixels): Pixels<N>) -> Result<Pixels<N>> {
        let [w, h] = self.size;
        if (self.at, [w, h]) == ([0, 0], [width, height]) {
            return Ok((width, height, pixels));
        }
        let mut out = Vec::new();
        more(|| format!("{}: its display window", crate::error::shown(path)), &mut out, w * h)?;
        out.resize(w * h, [0.0; N]);
        let within = |n: i64, at: i64, count: usize| usize::try_from(n - at).ok().filter(|&i| i < count);
        for (y, row) in out.chunks_exact_mut(w).enumerate() {
            let Some(from) = within(y as i64, self.at[1], height) else { continue };
            for (x, pixel) in row.iter_mut().enumerate() {
                if let Some(column) = within(x as i64, self.at[0], width) {
                    *pixel = pixels[from * width + column];
                }
            }
        }
        Ok((w, h, out))
    }
}

type Pixels<const N: usize> = (usize, usize, Vec<[f32; N]>);

/// The layer with these channels, of a size that is read; leaves `file` at its start.
fn layer(
    path: &Path,
    file: &mut (impl BufRead + Seek),
    channels: &[&str],
    bad_shape: impl Fn(usize, usize) -> Option<String>,
) -> Result<Window> {
    let wrong = |what: String, right: String| Err(Error::Format { path: path.to_owned(), what, right });
    let io = |source| Error::Io { path: path.to_owned(), action: "read", source };
    file.rewind().map_err(io)?;
    let headers = MetaData::read_from_buffered(&mut *file, false).map_err(|e| trouble(path, "read", e))?.headers;
    file.rewind().map_err(io)?;
    if headers.iter().any(|h| h.deep) {
        return wrong("it holds deep data".into(), "flat layers are read: flatten it first".into());
    }
    // A single Y beside RY and BY is half of a luminance-chroma picture, not a grey one.
    let names = |h: &Header| -> Vec<String> { h.channels.list.iter().map(|c| c.name.to_string()).collect() };
    let whole = |h: &&Header| {
        let names = names(h);
        channels.iter().all(|c| names.iter().any(|n| n == c)) && !(channels == ["Y"] && names.iter().any(|n| n == "RY"))
    };
    let Some(header) = headers.iter().find(whole) else {
        let mut found: Vec<String> = headers.iter().flat_map(names).take(12).map(|n| n.chars().take(24).collect()).collect();
        found.dedup();
        return wrong(
            format!("no layer has the channels {}; there are {}", channels.join(", "), found.join(", ")),
            "R, G and B, or Y alone, are read".into(),
        );
    };
    if header.channels.list.len() > MAX_CHANNELS {
        return wrong(format!("its layer has {} channels", header.channels.list.len()), format!("at most {MAX_CHANNELS} are read"));
    }
    if let Some(c) = header.channels.list.iter().find(|c| c.sampling != Vec2(1, 1)) {
        return wrong(format!("channel {} is subsampled", c.name), "every channel must have a sample per pixel".into());
    }
    let Vec2(width, height) = header.layer_size;
    let window = Window::of(header);
    let [w, h] = window.size;
    if let Some(right) = bad_shape(w, h) {
        return wrong(format!("{w}x{h} pixels"), right);
    }
    // What is not there takes memory all the same, and so does what is not shown.
    let (data, display) = (width.saturating_mul(height), w.saturating_mul(h));
    if width > MAX_SIDE || height > MAX_SIDE || data > MAX_PIXELS {
        return wrong(format!("{width}x{height} pixels"), format!("at most {MAX_SIDE} a side and {MAX_PIXELS} pixels are read"));
    }
    if display > data.saturating_mul(16).max(1 << 23) || data > display.saturating_mul(16) {
        let what = format!("its {width}x{height} pixels lie in a picture of {w}x{h}");
        return wrong(what, "neither may have more than sixteen times the other's pixels: crop it".into());
    }
    Ok(window)
}

/// Pixels as they come in.
struct Grid<const N: usize> {
    size: Vec2<usize>,
    pixels: Vec<[f32; N]>,
}

impl<const N: usize> Grid<N> {
    fn new(size: Vec2<usize>) -> Self {
        Self { size, pixels: Vec::new() }
    }

    fn put(&mut self, at: Vec2<usize>, value: [f32; N]) {
        let Vec2(width, height) = self.size;
        // Memory grows by the row with what the file delivers. Where there is none left the pixels end, which `whole` sees.
        if at.0 < width && at.1 < height && width.saturating_mul(height) <= MAX_PIXELS {
            let needed = (at.1 + 1) * width;
            if needed > self.pixels.len() && self.pixels.try_reserve(needed - self.pixels.len()).is_ok() {
                self.pixels.resize(needed, [0.0; N]);
            }
            if let Some(pixel) = self.pixels.get_mut(at.1 * width + at.0) {
                *pixel = value;
            }
        }
    }

    fn whole(self, path: &Path) -> Result<Pixels<N>> {
        let Vec2(width, height) = self.size;
        if self.pixels.is_empty() || Some(self.pixels.len()) != width.checked_mul(height) {
            return Err(Error::Format {
                path: path.to_owned(),
                what: format!("{} of its {width}x{height} pixels could be read", self.pixels.len()),
                right: "all must be there and fit into memory".into(),
            });
        }
        Ok((width, height, self.pixels))
    }
}

pub(super) fn trouble(path: &Path, action: &'static str, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::Io(source) => Error::Io { path: path.to_owned(), action, source },
        other => Error::Format {
            path: path.to_owned(),
            what: format!("OpenEXR: {}", other.to_string().chars().take(200).collect::<String>()),
            right: "the file must be whole and flat".into(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::{attributes, fraction};

    #[test]
    fn rates_are_the_fractions_that_people_mean() {
        for (text, fraction_of) in [
            ("24", (24, 1)),
            ("23.976", (2997, 125)),
            ("23.976023976023978", (24000, 1001)),
            ("29.97002997", (30000, 1001)),
            ("12.5", (25, 2)),
            ("0.001", (1, 1000)),
        ] {
            assert_eq!(fraction(text), Some(fraction_of), "{text}");
        }
        assert!(fraction("12.3456789").is_some_and(|(a, b)| (f64::from(a) / f64::from(b) - 12.3456789).abs() < 1e-3));
        for (key, value) in [("framesPerSecond", "0"), ("framesPerSecond", "fast"), ("worldToCamera", "1 0 0"), ("worldToCamera", "NaN")] {
            assert!(attributes(&[(key.into(), value.into())]).is_err(), "{key} {value}");
        }
    }
}
