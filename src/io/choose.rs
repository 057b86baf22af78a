//! Which of a file's values per voxel, or of its arrays, is the scalar: `volume.component`.

use super::ReadOptions;
use super::limits::{bad, quote};
use crate::error::{Error, Result, shown};
use std::path::Path;

/// The index that [`ReadOptions::component`] means among `count` channels: a label (in any case, where that is
/// unambiguous) or a number from 0. `labels` is empty where they have none. Without a wish it is the only one, else
/// `default`. `what` describes the file: "each voxel has 3 values".
pub(crate) fn component(
    path: &Path,
    what: &str,
    count: usize,
    labels: &[String],
    default: Option<usize>,
    options: &ReadOptions,
) -> Result<usize> {
    let right = || match (labels, count) {
        ([], 1) => "0 is its only component".to_owned(),
        ([only], _) => format!("'{}' is its only component", quote(only)),
        ([], _) => format!("choose one with volume.component, 0 to {}", count.saturating_sub(1)),
        _ => format!("choose one with volume.component: {}", list(labels)),
    };
    let Some(asked) = options.component.as_deref() else {
        return match (count, default) {
            (1, _) => Ok(0),
            (_, Some(default)) => Ok(default),
            _ => Err(bad(path, what, right())),
        };
    };
    let exact = labels.iter().position(|l| l == asked);
    let mut loose = labels.iter().enumerate().filter(|(_, l)| l.eq_ignore_ascii_case(asked)).map(|(i, _)| i);
    let loose = loose.next().filter(|_| loose.next().is_none());
    let number = || asked.parse::<usize>().ok().filter(|n| *n < count);
    exact.or(loose).or_else(number).ok_or_else(|| {
        let what = format!("'{}' is none of {}: {}", quote(asked), shown(path), quote(what));
        Error::Invalid { item: "volume.component", what, right: right() }
    })
}

/// "R, G, B", shortened where they are many.
pub(crate) fn list(labels: &[String]) -> String {
    const MOST: usize = 12;
    let mut text = labels.iter().take(MOST).map(|l| quote(l)).collect::<Vec<_>>().join(", ");
    if labels.len() > MOST {
        text += &format!(", … ({} in all)", labels.len());
    }
    text
}

/// "name" for a scalar array, "name:0", "name:1", … for one of several components.
pub(crate) fn labels(name: &str, components: usize) -> impl Iterator<Item = String> + '_ {
    (0..components).map(move |c| if components == 1 { name.to_owned() } else { format!("{name}:{c}") })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn labels_and_numbers_choose() {
        let rgb: Vec<String> = ["R", "G", "B"].map(String::from).into();
        let ask = |asked: Option<&str>, labels: &[String], default| {
            let options = ReadOptions { component: asked.map(String::from), ..Default::default() };
            component(Path::new("a"), "each voxel has 3 values", 3, labels, default, &options).map_err(|e| e.to_string())
        };
        assert_eq!(ask(Some("G"), &rgb, None), Ok(1));
        assert_eq!(ask(Some("b"), &rgb, None), Ok(2));
        assert_eq!(ask(Some("2"), &[], None), Ok(2));
        assert_eq!(ask(None, &rgb, Some(1)), Ok(1));
        let said = ask(None, &rgb, None).expect_err("refused");
        assert_eq!(said, "a: each voxel has 3 values; choose one with volume.component: R, G, B");
        for wrong in ["3", "-1", "x", ""] {
            assert!(ask(Some(wrong), &[], None).expect_err("refused").ends_with("choose one with volume.component, 0 to 2"), "{wrong}");
        }
        // Two labels that differ in case only: neither is meant by a third spelling.
        let twins: Vec<String> = ["ab", "AB", "x"].map(String::from).into();
        assert_eq!(ask(Some("AB"), &twins, None), Ok(1));
        assert!(ask(Some("aB"), &twins, None).is_err());
        assert_eq!(labels("v", 2).collect::<Vec<_>>(), ["v:0", "v:1"]);
    }
}
