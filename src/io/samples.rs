//! Sample types of files, and their way into [`Samples`].

use super::ReadOptions;
use super::limits::{Source, bad, check_cap, damaged, fill, grow, quote, shape};
pub use super::sample_type::SampleType;
use crate::error::Result;
use crate::scene::Samples;
use std::path::Path;

/// How the samples stand in a file, x fastest.
#[derive(Clone, Copy)]
pub(crate) struct Layout {
    pub dims: [usize; 3],
    /// Samples per voxel, stored fastest; 1 for a scalar volume.
    pub components: usize,
    /// The one of them that is kept; without it, all are.
    pub pick: Option<usize>,
    /// Other data follow the samples, by the format.
    pub more: bool,
    pub kind: SampleType,
    pub big_endian: bool,
    /// Numbers in ASCII, parted by white space or commas.
    pub text: bool,
    /// Stands in for NaN and infinity, in the unit of the stored sample.
    pub replace: Option<f32>,
}

impl Layout {
    /// One little-endian sample per voxel.
    pub fn scalar(dims: [usize; 3], kind: SampleType) -> Self {
        Self { dims, components: 1, pick: None, more: false, kind, big_endian: false, text: false, replace: None }
    }

    /// Number of samples in the file.
    pub fn count(&self) -> Option<u64> {
        self.dims.iter().chain([&self.components]).try_fold(1u64, |p, &n| p.checked_mul(n as u64))
    }

    /// Bytes that they take in the file, as binary numbers.
    pub fn stored_bytes(&self) -> Option<u64> {
        self.count()?.checked_mul(self.kind.bytes())
    }

    /// Samples in the file from which one is kept.
    fn record(&self) -> usize {
        if self.pick.is_some() { self.components.max(1) } else { 1 }
    }

    /// "4x4x4 uint8 samples".
    pub fn what(&self) -> String {
        let components = if self.components == 1 { String::new() } else { format!("{}x", self.components) };
        format!("{components}{} {} samples", shape(self.dims), self.kind.name())
    }
}

/// Bytes read at a time.
const CHUNK: usize = 1 << 20;

/// Most values per voxel of which one is picked.
pub(crate) const MAX_COMPONENTS: usize = 1 << 16;

/// Values that are not finite: how many, and the first.
#[derive(Default)]
struct NotFinite {
    replace: Option<f32>,
    /// Leave them where they are.
    keep: bool,
    count: u64,
    first: Option<(u64, f64)>,
}

impl NotFinite {
    /// `value` as `f32`; a number beyond its range counts as infinite.
    #[inline]
    fn check(&mut self, index: u64, value: f64) -> f32 {
        let v = value as f32;
        if v.is_finite() {
            return v;
        }
        self.count += 1;
        self.first.get_or_insert((index, value));
        if self.keep { v } else { self.replace.unwrap_or(0.0) }
    }

    fn report(&self, path: &Path, layout: &Layout) -> Result<()> {
        let Some((i, value)) = self.first else { return Ok(()) };
        let voxel = i as usize / (layout.components / layout.record()).max(1);
        let [nx, ny, _] = layout.dims;
        let place = format!("({}, {}, {})", voxel % nx, voxel / nx % ny, voxel / nx / ny);
        if let Some(v) = self.replace {
            log::warn!(
                "{}: {} samples are not finite, the first at voxel {place}; {v} stands for them",
                crate::error::shown(path),
                self.count
            );
            return Ok(());
        }
        let beyond = if value.is_finite() { ", beyond the range of float32" } else { "" };
        Err(bad(
            path,
            format!("{} of the samples are not finite, the first at voxel {place}: {value}{beyond}", self.count),
            "all must be finite; --nan-as VALUE (volume.nan_as in a scene) puts a value in their place",
        ))
    }
}

/// Reads the samples of `layout` from `source`.
pub(crate) fn read(path: &Path, mut source: Source, layout: &Layout, options: &ReadOptions) -> Result<Samples> {
    let what = layout.what();
    let total = layout.count().ok_or_else(|| bad(path, format!("{what} are too many to count"), "at most 2^63 bytes can be read"))?;
    if layout.record() > MAX_COMPONENTS || layout.pick.is_some_and(|p| p >= layout.components) {
        return Err(bad(path, format!("each voxel has {} values", layout.components), format!("at most {MAX_COMPONENTS} are read")));
    }
    let length = check_cap(path, &what, total / layout.record() as u64, layout.kind.bytes_in_memory(), options.max_bytes)?;
    // The shortest number in text is a digit and a separator.
    let needs = if layout.text { total.saturating_mul(2).saturating_sub(1) } else { total.saturating_mul(layout.kind.bytes()) };
    source.check_claim(path, &what, needs)?;
    let count = options.count_not_finite.filter(|_| layout.replace.is_none());
    let mut odd = NotFinite { replace: layout.replace, keep: count.is_some(), ..NotFinite::default() };
    let mut out = empty(layout.kind);
    if source.coding().is_none() && !layout.text {
        // The file was seen to hold them all.
        reserve(path, &mut out, length, length)?;
    }
    if layout.text {
        read_text(path, &mut source, layout, &mut out, &mut odd, length, options)?;
    } else {
        read_binary(path, &mut source, layout, &mut out, &mut odd, length, options)?;
        if !layout.more {
            source.finish(path)?;
        }
    }
    match count {
        None => odd.report(path, layout)?,
        Some(count) => {
            count.set(odd.count);
            stand_in(&mut out);
        }
    }
    Ok(out)
}

/// Puts the smallest finite sample, or 0, in the place of those that are not finite.
fn stand_in(samples: &mut Samples) {
    let Samples::F32(samples) = samples else { return };
    let least = samples.iter().copied().filter(|v| v.is_finite()).reduce(f32::min).unwrap_or(0.0);
    samples.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = least);
}

fn read_binary(
    path: &Path,
    source: &mut Source,
    layout: &Layout,
    out: &mut Samples,
    odd: &mut NotFinite,
    length: usize,
    options: &ReadOptions,
) -> Result<()> {
    let each = layout.kind.bytes() as usize;
    // Bytes in the file of one sample that is kept.
    let record = each * layout.record();
    let mut buffer = vec![0; (CHUNK / record).clamp(1, length.max(1)) * record];
    while out.len() < length {
        let count = (length - out.len()).min(buffer.len() / record);
        let wanted = count * record;
        let (n, error) = fill(source, &mut buffer[..wanted]);
        if n < wanted {
            let (got, needs) = (out.len() * record + n, length * record);
            return Err(match error {
                Some(e) => damaged(path, source, e, format!("after {got} of {needs} bytes of samples")),
                None => bad(
                    path,
                    format!("{} need {needs} bytes, the data end after {got}", layout.what()),
                    "the file is cut short or its header is wrong",
                ),
            });
        }
        if let Some(pick) = layout.pick.filter(|_| record > each) {
            for i in 0..count {
                let from = i * record + pick * each;
                buffer.copy_within(from..from + each, i * each);
            }
        }
        reserve(path, out, count, length)?;
        decode(&buffer[..count * each], layout, out, odd);
        options.report(out.len() as f64 / length as f64)?;
    }
    Ok(())
}

/// Appends the samples in `raw`, whole samples only.
fn decode(raw: &[u8], layout: &Layout, out: &mut Samples, odd: &mut NotFinite) {
    let at = out.len() as u64;
    macro_rules! each {
        ($vec:expr, $type:ty, $convert:expr) => {{
            #[allow(unused_mut)]
            let mut convert = $convert;
            let chunks = raw.as_chunks::<{ size_of::<$type>() }>().0.iter();
            if layout.big_endian {
                $vec.extend(chunks.zip(at..).map(|(c, i)| convert(i, <$type>::from_be_bytes(*c))));
            } else {
                $vec.extend(chunks.zip(at..).map(|(c, i)| convert(i, <$type>::from_le_bytes(*c))));
            }
        }};
    }
    match (out, layout.kind) {
        (Samples::U8(v), _) => v.extend_from_slice(raw),
        (Samples::U16(v), _) => each!(v, u16, |_, x| x),
        (Samples::I16(v), SampleType::I8) => each!(v, i8, |_, x| i16::from(x)),
        (Samples::I16(v), _) => each!(v, i16, |_, x| x),
        (Samples::F32(v), SampleType::I32) => each!(v, i32, |_, x| x as f32),
        (Samples::F32(v), SampleType::U32) => each!(v, u32, |_, x| x as f32),
        (Samples::F32(v), SampleType::I64) => each!(v, i64, |_, x| x as f32),
        (Samples::F32(v), SampleType::U64) => each!(v, u64, |_, x| x as f32),
        (Samples::F32(v), SampleType::F64) => each!(v, f64, |i, x| odd.check(i, x)),
        (Samples::F32(v), _) => each!(v, f32, |i, x: f32| odd.check(i, f64::from(x))),
    }
}

fn read_text(
    path: &Path,
    source: &mut Source,
    layout: &Layout,
    out: &mut Samples,
    odd: &mut NotFinite,
    length: usize,
    options: &ReadOptions,
) -> Result<()> {
    // No number that is meant to be read is longer than this.
    const TOKEN: usize = 400;
    let mut buffer = vec![0; CHUNK.min(1 << 16)];
    let mut token = Vec::with_capacity(TOKEN);
    let (record, pick) = (layout.record(), layout.pick.unwrap_or(0));
    let (mut over, mut seen) = (false, 0);
    while out.len() < length && !over {
        let (n, error) = fill(source, &mut buffer);
        if let Some(e) = error {
            return Err(damaged(path, source, e, format!("after {} of {length} samples", out.len())));
        }
        over = n < buffer.len();
        // A blank behind the last byte ends its number.
        for &byte in buffer[..n].iter().chain(over.then_some(&b' ')) {
            // What follows the last sample is not ours.
            if out.len() == length {
                break;
            }
            if !byte.is_ascii_whitespace() && byte != b',' {
                if token.len() == TOKEN {
                    return Err(not_a_number(path, &token, out.len(), layout));
                }
                token.push(byte);
            } else if !token.is_empty() {
                let kept = seen == pick;
                seen = if seen + 1 == record { 0 } else { seen + 1 };
                if !kept {
                    token.clear();
                    continue;
                }
                reserve(path, out, 1, length)?;
                let text = std::str::from_utf8(&token).unwrap_or_default();
                push(text, layout.kind, out, odd).ok_or_else(|| not_a_number(path, &token, out.len(), layout))?;
                token.clear();
            }
        }
        options.report(out.len() as f64 / length as f64)?;
    }
    if out.len() < length {
        return Err(bad(path, format!("the text holds {} of {length} samples", out.len()), "the file is cut short or its header is wrong"));
    }
    Ok(())
}

fn not_a_number(path: &Path, token: &[u8], index: usize, layout: &Layout) -> crate::Error {
    let text = quote(&String::from_utf8_lossy(token));
    bad(
        path,
        format!("sample {index} is '{text}', not a number of type {}", layout.kind.name()),
        "text samples are numbers parted by blanks",
    )
}

/// Appends the number in `text`; `None` when it is none of that type.
fn push(text: &str, kind: SampleType, out: &mut Samples, odd: &mut NotFinite) -> Option<()> {
    let at = out.len() as u64;
    match (out, kind) {
        (Samples::U8(v), _) => v.push(text.parse().ok()?),
        (Samples::U16(v), _) => v.push(text.parse().ok()?),
        (Samples::I16(v), SampleType::I8) => v.push(i16::from(text.parse::<i8>().ok()?)),
        (Samples::I16(v), _) => v.push(text.parse().ok()?),
        (Samples::F32(v), SampleType::I32) => v.push(text.parse::<i32>().ok()? as f32),
        (Samples::F32(v), SampleType::U32) => v.push(text.parse::<u32>().ok()? as f32),
        (Samples::F32(v), SampleType::I64) => v.push(text.parse::<i64>().ok()? as f32),
        (Samples::F32(v), SampleType::U64) => v.push(text.parse::<u64>().ok()? as f32),
        (Samples::F32(v), _) => v.push(odd.check(at, text.parse::<f64>().ok()?)),
    }
    Some(())
}

fn empty(kind: SampleType) -> Samples {
    use SampleType::*;
    match kind {
        U8 => Samples::U8(Vec::new()),
        U16 => Samples::U16(Vec::new()),
        I8 | I16 => Samples::I16(Vec::new()),
        _ => Samples::F32(Vec::new()),
    }
}

fn reserve(path: &Path, out: &mut Samples, add: usize, total: usize) -> Result<()> {
    match out {
        Samples::U8(v) => grow(path, v, add, total),
        Samples::U16(v) => grow(path, v, add, total),
        Samples::I16(v) => grow(path, v, add, total),
        Samples::F32(v) => grow(path, v, add, total),
    }
}
