//! The fit beside a sweep: points of visible matter, what they see, and the cells that read it right.

use super::sweep::Sweeper;
use super::{Engine, Medium, Progress, telling};
use crate::error::{Error, Result};
use crate::scene::Visibility;
use crate::stages::cells;
use crate::stages::fit::{self, Equations, Group, STEPS, Seen};
use crate::stages::pack::groups as coefficient_groups;
use crate::stages::sweep;
use crate::vk::{Access, Buffer, Format, Image, ImageDesc};

/// Cells whose points are drawn in a dispatch: 600 taps each, tens of milliseconds on a CPU device.
const DRAWN: usize = 1 << 12;

/// Cells whose equations are set up in a dispatch: those of some hundred points each.
const SET_UP: u32 = 1 << 13;

/// Cells that a dispatch iterates over.
const ITERATED: u32 = 1 << 16;

/// Points, and what they have seen so far.
pub(super) struct Fit {
    points: Buffer,
    per_box: u32,
    boxes: u32,
    /// Per cell of the field its box + 1, or 0.
    lookup: Buffer,
    order: Buffer,
    /// Per axis and slice: first of the order, boxes.
    runs: [Vec<[u32; 2]>; 3],
    sums: Buffer,
    /// Bands that the sums hold.
    bands: u32,
    /// What was found last, in the slots of the wanted cells; readable.
    pub fitted: [Image; 4],
    /// Linear indices of the cells that points read.
    read: Vec<u32>,
    /// Per cell of the field its place among them + 1, or 0.
    places: Buffer,
}

/// Device bytes of a fit, at most: `matter` cells hold matter, `wanted` are fitted, of `all`; their images take what the sweep's
/// `sums` take.
pub(super) fn bytes(settings: &Visibility, (matter, wanted, all): (u64, u64, u64), sums: u64) -> u64 {
    if settings.fit == 0 {
        return 0;
    }
    let kept = settings.coefficients() as u64;
    let points = matter * u64::from(settings.fit);
    let drawn = (DRAWN as u64).min(matter) * (4 + 16 * u64::from(settings.fit));
    let solver = wanted * (27 * 4 + 4 * kept + 3 * 16 + 8);
    8 * all + 12 * matter + points * (16 + 4 * kept) + drawn.max(solver) + sums
}

impl Fit {
    /// Draws the points of a medium's matter for a field of `dims` cells; none where none is met.
    pub fn new(engine: &Engine, medium: &Medium, settings: &Visibility, dims: [usize; 3], wanted: u64) -> Result<Option<Self>> {
        let device = &engine.device;
        let per_box = settings.fit;
        if per_box == 0 || wanted == 0 {
            return Ok(None);
        }
        let matter = cells::matter(medium.occupancy.filled(), medium.occupancy.dims(), medium.grid().dims(), dims);
        let candidates: Vec<u32> = (0..matter.len() as u32).filter(|&c| matter[c as usize]).collect();
        if candidates.is_empty() {
            return Ok(None);
        }
        let most = candidates.len().min(DRAWN);
        let cells = device.buffer::<u32>("cells to draw in", most)?;
        let drawn = device.buffer::<[f32; 4]>("drawn points", most * per_box as usize)?;
        let (mut found, mut points) = (Vec::new(), Vec::new());
        for chunk in candidates.chunks(DRAWN) {
            device.write(&cells, chunk)?;
            let mut rec = device.record()?;
            // The host has read what was there.
            rec.barrier(&[drawn.all().from(drawn.last_access()).to(Access::ComputeWrite)]);
            fit::record_points(&mut rec, &medium.view(), dims, (&cells, chunk.len() as u32), per_box, &drawn)?;
            rec.submit()?;
            let read: Vec<[f32; 4]> = device.read(&drawn, chunk.len() * per_box as usize)?;
            for (cell, of) in chunk.iter().zip(read.chunks_exact(per_box as usize)).filter(|(_, of)| of[0][3] > 0.0) {
                found.push(*cell);
                points.extend_from_slice(of);
            }
        }
        drop((cells, drawn));
        if found.is_empty() {
            return Ok(None);
        }
        let strides = [1, dims[0], dims[0] * dims[1]];
        let mut order = Vec::with_capacity(3 * found.len());
        let mut runs: [Vec<[u32; 2]>; 3] = Default::default();
        for (axis, runs) in runs.iter_mut().enumerate() {
            let mut slices = vec![Vec::new(); dims[axis]];
            for (i, &cell) in found.iter().enumerate() {
                slices[cell as usize / strides[axis] % dims[axis]].push(i as u32);
            }
            for slice in slices {
                runs.push([order.len() as u32, slice.len() as u32]);
                order.extend(slice);
            }
        }
        let mut lookup = vec![0u32; matter.len()];
        for (i, &cell) in found.iter().enumerate() {
            lookup[cell as usize] = i as u32 + 1;
        }
        let read = around(&found, dims);
        let mut places = vec![0u32; matter.len()];
        for (i, &cell) in read.iter().enumerate() {
            places[cell as usize] = i as u32 + 1;
        }
        // The equations come after the sweep: they are refused before it.
        let buffers = [("equations", 27 * read.len()), ("sight", settings.coefficients() * points.len())];
        for (what, numbers) in buffers {
            let (needs, most) = (4 * numbers as u64, device.info().max_storage_range);
            if needs > most {
                return Err(Error::Invalid {
                    item: "visibility.fit",
                    what: format!("{per_box} points of each of {} cells: their {what} take {}", found.len(), crate::error::bytes(needs)),
                    right: format!("this device binds at most {} as one buffer; take a coarser ratio, or fit 0", crate::error::bytes(most)),
                });
            }
        }
        let kept = coefficient_groups(settings.bands);
        let image = |g: usize| {
            device.image3(&ImageDesc {
                name: ["fitted 0", "fitted 1", "fitted 2", "fitted 3"][g],
                // Coefficients beyond the bands are bound and never touched.
                dims: if g < kept { cells::slot_dims(wanted) } else { [1; 3] },
                levels: 1,
                format: Format::Rgba32Sfloat,
                views: &[],
                storage: true,
            })
        };
        let fitted = [image(0)?, image(1)?, image(2)?, image(3)?];
        let sums = device.buffer::<f32>("what points see", settings.coefficients() * points.len())?;
        let mut rec = device.record()?;
        // Fresh sums: the first batch stores without loading. What is fitted is stored before it is read.
        rec.barrier(&[sums.all().from(Access::None).to(Access::ComputeReadWrite)]);
        rec.barrier(&fitted.each_ref().map(|i| i.mip(0).from(Access::None).to(Access::ComputeRead)));
        rec.submit()?;
        Ok(Some(Self {
            points: device.buffer_from("points", &points)?,
            per_box,
            boxes: found.len() as u32,
            lookup: device.buffer_from("boxes", &lookup)?,
            order: device.buffer_from("boxes by slice", &order)?,
            runs,
            sums,
            bands: settings.bands,
            fitted,
            places: device.buffer_from("places", &places)?,
            read,
        }))
    }

    /// What kernels take.
    pub fn seen(&self) -> Seen<'_> {
        Seen { points: &self.points, per_box: self.per_box, boxes: self.boxes, order: &self.order, sums: &self.sums }
    }

    /// First of the order, and boxes, of a slice.
    pub fn run(&self, axis: usize, slice: usize) -> [u32; 2] {
        self.runs[axis][slice]
    }

    /// Finds the cells `wanted` (slot by slot of `cell_map`), whose centres see `sums` of so many `directions` as the points do by
    /// now; the images must be readable. `tell` is told that it goes on.
    pub fn solve(
        &mut self,
        engine: &Engine,
        medium: &Medium,
        dims: [usize; 3],
        (wanted, cell_map): (&[u32], &Image),
        (sums, directions): ([&Image; 4], u32),
        tell: &mut dyn FnMut() -> Result<()>,
    ) -> Result<()> {
        let device = &engine.device;
        let count = self.read.len();
        let wanted_cells = device.buffer_from("wanted cells", wanted)?;
        let rows = device.buffer::<f32>("rows", 27 * count)?;
        let side = device.buffer::<f32>("side", (self.bands * self.bands) as usize * count)?;
        let vectors = |name| device.buffer::<[f32; 4]>(name, count);
        let (a, b, moves) = (vectors("solution")?, vectors("other solution")?, vectors("moves")?);
        let equations = Equations {
            dims,
            cells: &device.buffer_from("cells that are read", &self.read)?,
            count: count as u32,
            boxes: &self.lookup,
            places: &self.places,
            rows: &rows,
            side: &side,
            solutions: [&a, &b],
            moves: &moves,
            bands: self.bands,
            directions,
        };
        let mut rec = device.record()?;
        // Fresh: the rows are written next.
        rec.barrier(&[&rows, &side].map(|b| b.all().from(Access::None).to(Access::ComputeWrite)));
        rec.barrier(&[&a, &b, &moves].map(|b| b.all().from(Access::None).to(Access::ComputeReadWrite)));
        rec.barrier(&self.fitted.each_ref().map(|i| i.mip(0).from(Access::ComputeRead).to(Access::ComputeWrite)));
        rec.submit()?;
        let chunks = |all: u32, size: u32| (0..all).step_by(size as usize).map(move |first| (first, size.min(all - first)));
        for part in chunks(count as u32, SET_UP) {
            let mut rec = device.record()?;
            fit::record_rows(&mut rec, medium.grid(), &self.seen(), &equations, part)?;
            // Parts do not overlap.
            rec.barrier(&[&rows, &side].map(|b| b.all().from(Access::ComputeWrite).to(Access::ComputeWrite)));
            rec.submit()?;
            tell()?;
        }
        let mut rec = device.record()?;
        // The iterations read them.
        rec.barrier(&[&rows, &side].map(|b| b.all().from(Access::ComputeWrite).to(Access::ComputeRead)));
        rec.submit()?;
        for (index, (sums, fitted)) in sums.into_iter().zip(&self.fitted).enumerate().take(coefficient_groups(self.bands)) {
            let group = Group { index: index as u32, cell_map, sums, fitted };
            for part in chunks(wanted.len() as u32, ITERATED) {
                let mut rec = device.record()?;
                fit::record_start(&mut rec, &equations, &group, &wanted_cells, part)?;
                // Parts do not overlap; the iterations begin with it.
                rec.barrier(&[a.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
                rec.barrier(&[group.fitted.mip(0).from(Access::ComputeWrite).to(Access::ComputeWrite)]);
                rec.submit()?;
            }
            for step in 0..STEPS {
                for part in chunks(count as u32, ITERATED) {
                    let mut rec = device.record()?;
                    fit::record_step(&mut rec, &equations, &group, step, part)?;
                    // The next iteration reads what this one wrote.
                    rec.barrier(&[&a, &b, &moves].map(|b| b.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)));
                    rec.barrier(&[group.fitted.mip(0).from(Access::ComputeWrite).to(Access::ComputeWrite)]);
                    rec.submit()?;
                }
                tell()?;
            }
        }
        let mut rec = device.record()?;
        // What was found is read next, and further directions add to what points see.
        rec.barrier(&[self.sums.all().from(Access::ComputeReadWrite).to(Access::ComputeReadWrite)]);
        rec.barrier(&self.fitted.each_ref().map(|i| i.mip(0).from(Access::ComputeWrite).to(Access::ComputeRead)));
        rec.submit()
    }
}

/// The points of a fitted field, and what they see: for tests and charts.
pub struct Points {
    /// Places, voxels.
    pub places: Vec<[f32; 3]>,
    /// How much the opacity that a point stands for exceeds its chance.
    pub weights: Vec<f32>,
    /// Coefficients of what is seen there, 0 beyond the bands.
    pub seen: Vec<[f32; 16]>,
}

impl Engine {
    /// The points that the field of `settings` is fitted to; none without matter or [`Visibility::fit`].
    ///
    /// # Errors
    /// As [`Engine::estimate`].
    pub fn fit_points(&self, medium: &Medium, settings: &Visibility, progress: &mut Progress) -> Result<Points> {
        let map = self.cell_map(medium, settings, &[])?;
        let cost = super::budget::Cost { kept: 0, ..self.cost(medium.grid(), settings, &map)? };
        let share = self.admitted("the fit", 0, &cost, |_| "take a coarser ratio, or allow more memory".into())?;
        let mut sweeper = Sweeper::new(self, medium, settings, &map, share.ring)?;
        sweeper.pass(&sweep::rays(settings.directions, medium.grid()), &mut telling("sweep", progress))?;
        let Some(fit) = &sweeper.fit else { return Ok(Points { places: Vec::new(), weights: Vec::new(), seen: Vec::new() }) };
        let (count, kept) = ((fit.boxes * fit.per_box) as usize, settings.coefficients());
        let points: Vec<[f32; 4]> = self.device.read(&fit.points, count)?;
        let sums: Vec<f32> = self.device.read(&fit.sums, kept * count)?;
        let weight = 4.0 * std::f32::consts::PI / settings.directions as f32;
        let seen = |i: usize| std::array::from_fn(|c| if c < kept { weight * sums[c * count + i] } else { 0.0 });
        Ok(Points {
            places: points.iter().map(|p| [p[0], p[1], p[2]]).collect(),
            weights: points.iter().map(|p| p[3]).collect(),
            seen: (0..count).map(seen).collect(),
        })
    }
}

/// The cells of a field of `dims` that stand around `cells`, and these, ascending.
fn around(cells: &[u32], dims: [usize; 3]) -> Vec<u32> {
    let mut near = vec![false; dims.iter().product()];
    for &cell in cells {
        let c = cell as usize;
        let at = [c % dims[0], c / dims[0] % dims[1], c / dims[0] / dims[1]];
        let [x, y, z] = std::array::from_fn(|a| at[a].saturating_sub(1)..=(at[a] + 1).min(dims[a] - 1));
        for (z, y) in z.flat_map(|z| y.clone().map(move |y| (z, y))) {
            let row = dims[0] * (y + dims[1] * z);
            near[row + x.start()..=row + x.end()].fill(true);
        }
    }
    (0..near.len() as u32).filter(|&c| near[c as usize]).collect()
}
