//! One picture against another, number by number.

use crate::error::{Error, Result};
use crate::scene::Picture;
use serde::Serialize;

/// How picture `a` differs from reference `b`, in linear radiance times coverage, both over black or over one background: then
/// `b`'s coverage must be what it was before, or all of the background counts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Pixels per row, and rows.
    pub size: [usize; 2],
    /// Pixels that `b` covers (coverage above 0).
    pub covered: usize,
    /// √mean((a − b)²)/mean(b) over R, G, B of the covered pixels; `None` where they are black or there are none.
    pub relative_rmse: Option<f64>,
    /// The same over all pixels.
    pub relative_rmse_all: Option<f64>,
    /// mean(a)/mean(b) over the covered pixels: 1.04 is 4 % too bright.
    pub mean_ratio: Option<f64>,
    /// Largest |a − b| of a channel.
    pub max: f64,
    /// Where: column, row (0 is the top row), channel (0..2 for R, G, B).
    pub max_at: [usize; 3],
}

/// Sums over a choice of pixels.
#[derive(Default)]
struct Sums {
    squares: f64,
    a: f64,
    b: f64,
    count: f64,
}

impl Sums {
    fn of(a: &Picture, b: &Picture, choose: impl Fn(&[f32; 4]) -> bool) -> Self {
        let mut sums = Self::default();
        for (a, b) in a.rgba.iter().zip(&b.rgba).filter(|(_, b)| choose(b)) {
            for c in 0..3 {
                sums.squares += f64::from(a[c] - b[c]).powi(2);
                sums.a += f64::from(a[c]);
                sums.b += f64::from(b[c]);
                sums.count += 1.0;
            }
        }
        sums
    }

    fn relative_rmse(&self) -> Option<f64> {
        (self.count > 0.0 && self.b > 0.0).then(|| (self.squares / self.count).sqrt() / (self.b / self.count))
    }
}

/// a − b, signed, for programs; coverage 1 everywhere, so that none of it is lost to a background.
///
/// # Errors
/// As [`compare`].
pub fn signed(a: &Picture, b: &Picture) -> Result<Picture> {
    comparable(a, b)?;
    let rgba = a.rgba.iter().zip(&b.rgba).map(|(a, b)| [a[0] - b[0], a[1] - b[1], a[2] - b[2], 1.0]).collect();
    Ok(Picture { width: b.width, height: b.height, rgba })
}

/// √mean((a − b)²)/mean(b) over R, G, B of the pixels that `b` covers (coverage above 0). `None` where sizes differ or
/// nothing is covered.
pub fn relative_rmse(a: &Picture, b: &Picture) -> Option<f64> {
    if (a.width, a.height) != (b.width, b.height) {
        return None;
    }
    Sums::of(a, b, |b| b[3] > 0.0).relative_rmse()
}

/// How `a` differs from the reference `b`.
///
/// # Errors
/// [`Error::Invalid`] for pictures of different sizes and for pixels that are not finite.
pub fn compare(a: &Picture, b: &Picture) -> Result<Difference> {
    comparable(a, b)?;
    let (covered, all) = (Sums::of(a, b, |b| b[3] > 0.0), Sums::of(a, b, |_| true));
    let (mut max, mut max_at) = (0.0, [0; 3]);
    for (i, (p, q)) in a.rgba.iter().zip(&b.rgba).enumerate() {
        for c in 0..3 {
            let d = (f64::from(p[c]) - f64::from(q[c])).abs();
            if d > max {
                (max, max_at) = (d, [i % b.width, i / b.width, c]);
            }
        }
    }
    Ok(Difference {
        size: [b.width, b.height],
        covered: (covered.count / 3.0) as usize,
        relative_rmse: covered.relative_rmse(),
        relative_rmse_all: all.relative_rmse(),
        mean_ratio: (covered.b > 0.0).then(|| covered.a / covered.b),
        max,
        max_at,
    })
}

/// Refuses pictures of different sizes, and pixels that are not finite.
pub(super) fn comparable(a: &Picture, b: &Picture) -> Result<()> {
    let invalid = |what: String, right: &str| Err(Error::Invalid { item: "compared pictures", what, right: right.into() });
    if (a.width, a.height) != (b.width, b.height) {
        let what = format!("{}x{} pixels against {}x{}", a.width, a.height, b.width, b.height);
        return invalid(what, "both must be of one size");
    }
    for (name, picture) in [("first", a), ("second", b)] {
        if picture.rgba.is_empty() || Some(picture.rgba.len()) != picture.width.checked_mul(picture.height) {
            let what = format!("the {name} has {} pixels for {}x{}", picture.rgba.len(), picture.width, picture.height);
            return invalid(what, "there must be one per place, and at least one");
        }
        if let Some(i) = picture.rgba.iter().position(|p| p.iter().any(|v| !v.is_finite())) {
            let (x, y) = (i % picture.width, i / picture.width);
            return invalid(format!("pixel {x},{y} of the {name} is {:?}", picture.rgba[i]), "all must be finite");
        }
    }
    Ok(())
}
