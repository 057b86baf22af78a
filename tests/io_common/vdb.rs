//! A writer of small OpenVDB files (format 224), on its own: it shares nothing with the reader.
#![allow(dead_code)]

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;

pub type Ijk = [i32; 3];

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pack {
    None,
    Zip,
    /// Blosc with blocks of so many bytes; 0: one block.
    Blosc(usize),
    /// Blosc frames that hold their bytes as they are.
    BloscCopied,
}

/// A tree 5_4_3.
#[derive(Clone)]
pub struct Tree {
    pub background: f64,
    /// By origin: values and active voxels, x·64 + y·8 + z.
    pub leaves: BTreeMap<Ijk, (Vec<f64>, Vec<bool>)>,
    /// Origin, size (8, 128 or 4096), value, active.
    pub tiles: Vec<(Ijk, i32, f64, bool)>,
}

impl Tree {
    pub fn new(background: f64) -> Self {
        Self { background, leaves: BTreeMap::new(), tiles: Vec::new() }
    }

    pub fn set(&mut self, at: Ijk, value: f64, active: bool) {
        let origin = at.map(|v| v.div_euclid(8) * 8);
        let background = self.background;
        let leaf = self.leaves.entry(origin).or_insert_with(|| (vec![background; 512], vec![false; 512]));
        let [x, y, z] = at.map(|v| v.rem_euclid(8) as usize);
        leaf.0[x * 64 + y * 8 + z] = value;
        leaf.1[x * 64 + y * 8 + z] = active;
    }
}

/// A grid and how it is written.
#[derive(Clone)]
pub struct Grid {
    pub name: &'static str,
    /// Of the tree's type name: "float", "double", "half", "vec3s", …; vectors hold (v, 2v, −v).
    pub value: &'static str,
    pub as_half: bool,
    pub class: &'static str,
    /// Type and numbers of the transform.
    pub map: (&'static str, Vec<f64>),
    pub pack: Pack,
    pub masked: bool,
    pub instance_of: &'static str,
    pub tree: Tree,
}

impl Grid {
    pub fn new(name: &'static str, value: &'static str, tree: Tree) -> Self {
        let map = ("UniformScaleMap", scale_map([1.0; 3]));
        Self { name, value, as_half: false, class: "fog volume", map, pack: Pack::None, masked: true, instance_of: "", tree }
    }
}

/// The numbers of a scale map: scale, voxel size, inverse, inverse squared, half the inverse.
pub fn scale_map(s: [f64; 3]) -> Vec<f64> {
    [s, s, s.map(|v| 1.0 / v), s.map(|v| 1.0 / (v * v)), s.map(|v| 0.5 / v)].concat()
}

fn text(out: &mut Vec<u8>, t: &str) {
    out.extend((t.len() as u32).to_le_bytes());
    out.extend(t.as_bytes());
}

fn single(value: &str, v: f64) -> Vec<u8> {
    match value {
        "half" => half::f16::from_f64(v).to_le_bytes().to_vec(),
        "float" => (v as f32).to_le_bytes().to_vec(),
        "double" => v.to_le_bytes().to_vec(),
        "int32" => (v as i32).to_le_bytes().to_vec(),
        "int64" => (v as i64).to_le_bytes().to_vec(),
        "vec3s" => [v, 2.0 * v, -v].iter().flat_map(|v| single("float", *v)).collect(),
        "vec3d" => [v, 2.0 * v, -v].iter().flat_map(|v| single("double", *v)).collect(),
        "vec3i" => [v, 2.0 * v, -v].iter().flat_map(|v| single("int32", *v)).collect(),
        "vec3h" => [v, 2.0 * v, -v].iter().flat_map(|v| single("half", *v)).collect(),
        other => panic!("no such type: {other}"),
    }
}

fn words(out: &mut Vec<u8>, bits: &[bool]) {
    for byte in bits.chunks(8) {
        out.push(byte.iter().enumerate().map(|(i, b)| u8::from(*b) << i).sum());
    }
}

struct Writer<'a> {
    out: Vec<u8>,
    grid: &'a Grid,
    /// Codes of inactive values that were written.
    codes: BTreeSet<u8>,
}

impl Writer<'_> {
    /// Values of a node; `child` slots have none.
    fn values(&mut self, values: &[f64], active: &[bool], child: &[bool]) {
        let g = self.grid;
        let background = g.tree.background;
        let stored = match (g.as_half, g.value) {
            (true, "float" | "double") => "half",
            (true, "vec3s" | "vec3d") => "vec3h",
            (_, value) => value,
        };
        let mut kinds: Vec<f64> = Vec::new();
        for i in 0..values.len() {
            if !active[i] && !child[i] && !kinds.contains(&values[i]) {
                kinds.push(values[i]);
            }
        }
        let code = match kinds[..] {
            _ if !g.masked => 6,
            [] => 0,
            [a] if a == background => 0,
            [a] if a == -background => 1,
            [_] => 2,
            [a, b] if (a == background && b == -background) || (a == -background && b == background) => 3,
            [a, b] if a == background || b == background => 4,
            [_, _] => 5,
            _ => 6,
        };
        self.codes.insert(code);
        self.out.push(code);
        // What a set bit of the selection mask stands for.
        let mut on = background;
        if code == 2 || code == 5 {
            self.out.extend(single(g.value, kinds[0]));
        }
        if code == 4 {
            self.out.extend(single(g.value, if kinds[0] == background { kinds[1] } else { kinds[0] }));
        }
        if code == 5 {
            self.out.extend(single(g.value, kinds[1]));
            on = kinds[1];
        }
        if (3..=5).contains(&code) {
            let selection: Vec<bool> = (0..values.len()).map(|i| !active[i] && !child[i] && values[i] == on).collect();
            words(&mut self.out, &selection);
        }
        let kept = |i: &usize| code == 6 || active[*i];
        let numbers: Vec<f64> = (0..values.len()).filter(kept).map(|i| if child[i] { 0.0 } else { values[i] }).collect();
        let bytes: Vec<u8> = numbers.iter().flat_map(|v| single(stored, *v)).collect();
        if stored != g.value && numbers.is_empty() {
            return;
        }
        let width = bytes.len() / numbers.len().max(1);
        let packed = match g.pack {
            Pack::None => {
                self.out.extend(bytes);
                return;
            }
            Pack::Zip => {
                let mut z = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
                z.write_all(&bytes).unwrap();
                z.finish().unwrap()
            }
            Pack::Blosc(block) => blosc(&bytes, width, block),
            Pack::BloscCopied => {
                let n = (bytes.len() as u32).to_le_bytes();
                [&[2, 1, 0x23, width as u8][..], &n, &n, &(bytes.len() as u32 + 16).to_le_bytes(), &bytes].concat()
            }
        };
        if packed.len() < bytes.len() || (g.pack == Pack::BloscCopied && !bytes.is_empty()) {
            self.out.extend((packed.len() as i64).to_le_bytes());
            self.out.extend(packed);
        } else {
            self.out.extend((-(bytes.len() as i64)).to_le_bytes());
            self.out.extend(bytes);
        }
    }

    fn node(&mut self, origin: Ijk, log2: u32) {
        let (n, size) = (1 << log2, if log2 == 5 { 128 } else { 8 });
        let tree = &self.grid.tree;
        let at = |i: i32| -> Ijk { [origin[0] + i / (n * n) * size, origin[1] + i / n % n * size, origin[2] + i % n * size] };
        let mut children: BTreeSet<Ijk> = tree.leaves.keys().map(|o| o.map(|v| v.div_euclid(size) * size)).collect();
        if size == 128 {
            children.extend(tree.tiles.iter().filter(|t| t.1 == 8).map(|t| t.0.map(|v| v.div_euclid(size) * size)));
        }
        let tiles: BTreeMap<Ijk, (f64, bool)> = tree.tiles.iter().filter(|t| t.1 == size).map(|t| (t.0, (t.2, t.3))).collect();
        let count = n * n * n;
        let (mut child, mut active, mut values) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..count {
            let p = at(i);
            child.push(children.contains(&p));
            let tile = tiles.get(&p).copied();
            active.push(tile.is_some_and(|t| t.1));
            values.push(tile.map_or(tree.background, |t| t.0));
        }
        words(&mut self.out, &child);
        words(&mut self.out, &active);
        self.values(&values, &active, &child);
        for i in 0..count {
            if !child[i as usize] {
                continue;
            }
            if log2 == 5 {
                self.node(at(i), 4);
            } else {
                let active = self.grid.tree.leaves[&at(i)].1.clone();
                words(&mut self.out, &active);
            }
        }
    }

    fn leaves_of(&self) -> Vec<Ijk> {
        // The order of the walk: child of the root, then inner nodes, each x before y before z.
        let mut all: Vec<Ijk> = self.grid.tree.leaves.keys().copied().collect();
        all.sort_by_key(|o| (o.map(|v| v.div_euclid(4096)), o.map(|v| v.div_euclid(128)), *o));
        all
    }

    fn tree(&mut self) {
        let g = self.grid;
        let roots: BTreeSet<Ijk> = g
            .tree
            .leaves
            .keys()
            .chain(g.tree.tiles.iter().filter(|t| t.1 < 4096).map(|t| &t.0))
            .map(|o| o.map(|v| v.div_euclid(4096) * 4096))
            .collect();
        let tiles: Vec<_> = g.tree.tiles.iter().filter(|t| t.1 == 4096).collect();
        self.out.extend(1i32.to_le_bytes());
        self.out.extend(single(g.value, g.tree.background));
        self.out.extend((tiles.len() as u32).to_le_bytes());
        self.out.extend((roots.len() as u32).to_le_bytes());
        for (origin, _, value, active) in tiles {
            self.out.extend(origin.iter().flat_map(|v| v.to_le_bytes()));
            self.out.extend(single(g.value, *value));
            self.out.push(u8::from(*active));
        }
        for origin in roots {
            self.out.extend(origin.iter().flat_map(|v| v.to_le_bytes()));
            self.node(origin, 5);
        }
        for origin in self.leaves_of() {
            let (values, active) = g.tree.leaves[&origin].clone();
            words(&mut self.out, &active);
            self.values(&values, &active, &[false; 512]);
        }
    }
}

/// A Blosc frame: LZ4, bytes shuffled.
pub fn blosc(bytes: &[u8], width: usize, block: usize) -> Vec<u8> {
    let block = if block == 0 { bytes.len().max(1) } else { block.min(bytes.len().max(1)) };
    let mut body = Vec::new();
    let mut starts = Vec::new();
    let blocks = bytes.len().div_ceil(block);
    for part in bytes.chunks(block) {
        starts.push((16 + 4 * blocks + body.len()) as u32);
        let values = part.len() / width;
        let mut shuffled: Vec<u8> = (0..width).flat_map(|s| (0..values).map(move |i| part[i * width + s])).collect();
        shuffled.extend(&part[values * width..]);
        let split = width <= 16 && block / width >= 128 && part.len() == block;
        for stream in shuffled.chunks(part.len() / if split { width } else { 1 }) {
            let packed = lz4_flex::block::compress(stream);
            let packed = if packed.len() < stream.len() { packed } else { stream.to_vec() };
            body.extend((packed.len() as u32).to_le_bytes());
            body.extend(packed);
        }
    }
    let total = 16 + 4 * blocks + body.len();
    let mut out = vec![2, 1, 0x21, width as u8];
    for n in [bytes.len(), block, total] {
        out.extend((n as u32).to_le_bytes());
    }
    out.extend(starts.iter().flat_map(|s| s.to_le_bytes()));
    out.extend(body);
    out
}

/// The file, and the codes of inactive values in it.
pub fn file_and_codes(grids: &[Grid]) -> (Vec<u8>, BTreeSet<u8>) {
    let mut out = b" BDV\0\0\0\0".to_vec();
    for n in [224u32, 8, 1] {
        out.extend(n.to_le_bytes());
    }
    out.push(1);
    out.extend(b"01234567-89ab-cdef-0123-456789abcdef");
    out.extend(1u32.to_le_bytes());
    text(&mut out, "creator");
    text(&mut out, "string");
    text(&mut out, "a test");
    out.extend((grids.len() as i32).to_le_bytes());
    let mut codes = BTreeSet::new();
    for grid in grids {
        text(&mut out, grid.name);
        text(&mut out, &format!("Tree_{}_5_4_3{}", grid.value, if grid.as_half { "_HalfFloat" } else { "" }));
        text(&mut out, grid.instance_of);
        let places = out.len();
        out.extend([0; 24]);
        let start = out.len() as i64;
        let flags = if grid.masked { 2u32 } else { 0 }
            + match grid.pack {
                Pack::None => 0,
                Pack::Zip => 1,
                Pack::Blosc(_) | Pack::BloscCopied => 4,
            };
        out.extend(flags.to_le_bytes());
        out.extend(2u32.to_le_bytes());
        text(&mut out, "class");
        text(&mut out, "string");
        text(&mut out, grid.class);
        text(&mut out, "file_bbox_min");
        text(&mut out, "vec3i");
        out.extend(12u32.to_le_bytes());
        out.extend([0; 12]);
        text(&mut out, grid.map.0);
        out.extend(grid.map.1.iter().flat_map(|v| v.to_le_bytes()));
        let mut writer = Writer { out: std::mem::take(&mut out), grid, codes: BTreeSet::new() };
        if grid.instance_of.is_empty()
            && matches!(grid.value, "half" | "float" | "double" | "int32" | "int64" | "vec3s" | "vec3d" | "vec3i")
        {
            writer.tree();
        }
        codes.append(&mut writer.codes);
        out = writer.out;
        let end = out.len() as i64;
        for (i, n) in [start, start, end].into_iter().enumerate() {
            out[places + 8 * i..places + 8 * i + 8].copy_from_slice(&n.to_le_bytes());
        }
    }
    (out, codes)
}

pub fn file(grids: &[Grid]) -> Vec<u8> {
    file_and_codes(grids).0
}
