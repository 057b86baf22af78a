//! The packed field on the device: its bricks, how it is filled, read back and brought back.

use super::estimate::{Estimator, Work};
use super::{Engine, Medium};
use crate::error::{Error, Result};
use crate::room::zeroed;
use crate::scene::{Grid, Visibility};
use crate::stages::bricks::Bricks;
use crate::stages::cells::CellMap;
use crate::stages::estimate::Run;
use crate::stages::pack::{self, Packed};
use crate::vk::{Access, Format, Image, ImageDesc};
use std::f32::consts::PI;
use std::sync::Arc;

/// A visibility field on the device: 16 (or fewer) SH coefficients per cell, packed. Only bricks of cells near matter take
/// memory (see `stages::bricks`); all other cells are zero. Clones share it.
#[derive(Clone)]
pub struct Field(Arc<FieldData>);

struct FieldData {
    dims: [usize; 3],
    settings: Visibility,
    images: [Image; pack::GROUPS],
    layout: Arc<Layout>,
}

/// Gives a tile's sums: its cells, the stride between coefficients, sums of 0.
type Fill<'a> = dyn Fn(&[u32], usize, &mut [f32]) + 'a;

/// Which bricks a field holds, and the directory that kernels look them up in. Passes share it.
pub(super) struct Layout {
    pub bricks: Bricks,
    directory: Image,
}

impl Field {
    /// Cells along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.0.dims
    }

    /// Bytes on the device: the packed coefficients of the held bricks, and the directory.
    pub fn bytes(&self) -> u64 {
        let directory = &self.0.layout.directory;
        self.0.images.iter().chain([directory]).map(Image::bytes).sum()
    }

    /// Share of the field's bricks that are held, 0..1.
    pub fn held(&self) -> f64 {
        self.bricks().count() as f64 / self.bricks().directory().len() as f64
    }

    /// The settings that it was computed with.
    pub fn settings(&self) -> &Visibility {
        &self.0.settings
    }

    pub(super) fn bricks(&self) -> &Bricks {
        &self.0.layout.bricks
    }

    /// What kernels take.
    pub(super) fn packed(&self) -> Packed<'_> {
        Packed {
            images: self.0.images.each_ref(),
            directory: &self.0.layout.directory,
            bits: self.0.settings.bits,
            wide: self.0.settings.fit > 0,
        }
    }
}

impl Engine {
    /// The bricks of the cells that `map` wants, in a field of `dims` cells.
    pub(super) fn layout(&self, dims: [usize; 3], settings: &Visibility, map: &CellMap) -> Result<Arc<Layout>> {
        let bricks = Bricks::new(dims, map, pack::formats(settings.bands, settings.bits).0.bytes().into());
        let dims = bricks.directory_dims();
        let desc = ImageDesc { name: "bricks", dims, levels: 1, format: Format::R32Uint, views: &[], storage: false };
        let directory = self.device.image3(&desc)?;
        let area = dims[0] as usize * dims[1] as usize;
        self.device.write_image(&directory, 0, &mut |z, bytes| {
            for (out, word) in bytes.chunks_exact_mut(4).zip(&bricks.directory()[z as usize * area..]) {
                out.copy_from_slice(&word.to_ne_bytes());
            }
        })?;
        Ok(Arc::new(Layout { bricks, directory }))
    }

    /// A field of the cells of `work`; the others are zero.
    pub(super) fn packed(
        &self,
        medium: &Medium,
        settings: &Visibility,
        (map, layout): (&CellMap, &Arc<Layout>),
        work: &Work,
        estimator: &Estimator,
        tell: &mut dyn FnMut(f64) -> Result<()>,
    ) -> Result<Field> {
        let grid = medium.grid();
        let field = self.fresh(grid, settings, layout)?;
        let mut store = |run: &Run| self.store(&field, run, 4.0 * PI / run.pattern_size as f32);
        self.put(grid, settings, &layout.bricks.spare(map), work.tile, None, &mut store)?;
        self.estimate_tiles(medium, settings, work, estimator, tell, &mut store)?;
        self.finished(field)
    }

    /// Brings back a field that was read or written to a file: `coefficients` as [`Engine::read_field`] gives them, for a
    /// volume of `grid`. Cells whose coefficients are all zero take no memory, where whole bricks are.
    ///
    /// # Errors
    /// [`Error::Invalid`] for settings out of their range or a wrong number of coefficients, [`Error::OutOfMemory`].
    pub fn load_field(&self, grid: &Grid, settings: &Visibility, coefficients: &[f32]) -> Result<Field> {
        let kept = settings.coefficients();
        let dims = self.field_dims(grid, settings)?;
        let cells: usize = dims.iter().product();
        if coefficients.len() != kept * cells {
            return Err(Error::Invalid {
                item: "field",
                what: format!("{} coefficients", coefficients.len()),
                right: format!("{cells} cells (1:{}) of {kept} coefficients take {}", settings.ratio, kept * cells),
            });
        }
        let map = CellMap::listed(coefficients.chunks_exact(kept).map(|v| v.iter().any(|&v| v != 0.0)));
        let cost = self.cost_of_loading(grid, settings, &map)?;
        let tile = self.admitted(&format!("the visibility field at 1:{}", settings.ratio), 1, &cost, |_| "allow more memory".into())?.tile;
        let layout = self.layout(dims, settings, &map)?;
        let field = self.fresh(grid, settings, &layout)?;
        let mut store = |run: &Run| self.store(&field, run, 1.0);
        let values = |tile: &[u32], capacity: usize, sums: &mut [f32]| {
            for (i, &cell) in tile.iter().enumerate() {
                for (c, v) in coefficients[cell as usize * kept..][..kept].iter().enumerate() {
                    sums[c * capacity + i] = *v;
                }
            }
        };
        self.put(grid, settings, &layout.bricks.spare(&map), tile, None, &mut store)?;
        self.put(grid, settings, &map.cells(), tile, Some(&values), &mut store)?;
        self.finished(field)
    }

    /// Images ready for stores.
    fn fresh(&self, grid: &Grid, settings: &Visibility, layout: &Arc<Layout>) -> Result<Field> {
        let groups = pack::groups(settings.bands);
        let (store, sample) = pack::formats(settings.bands, settings.bits);
        let image = |g: usize| {
            self.device.image3(&ImageDesc {
                name: ["field 0", "field 1", "field 2", "field 3"][g],
                // A group that the bands leave empty is one texel, bound and never read.
                dims: if g < groups { layout.bricks.image_dims() } else { [1; 3] },
                levels: 1,
                format: store,
                views: &[sample],
                storage: true,
            })
        };
        let images = [image(0)?, image(1)?, image(2)?, image(3)?];
        let dims = grid.field_dims(settings.ratio as usize);
        let field = Field(Arc::new(FieldData { dims, settings: settings.clone(), images, layout: layout.clone() }));
        self.turn(&field, Access::None, Access::ComputeWrite)?;
        Ok(field)
    }

    /// Stores a tile's sums.
    fn store(&self, field: &Field, run: &Run, weight: f32) -> Result<()> {
        let mut rec = self.device.record()?;
        pack::record(&mut rec, run, weight, &field.packed())?;
        // Tiles store disjoint cells; levels are tracked whole.
        rec.barrier(&field.packed().images.map(|i| i.mip(0).from(Access::ComputeWrite).to(Access::ComputeWrite)));
        rec.submit()
    }

    /// The field is only read from here on.
    fn finished(&self, field: Field) -> Result<Field> {
        self.turn(&field, Access::ComputeWrite, Access::ComputeRead)?;
        Ok(field)
    }

    fn turn(&self, field: &Field, from: Access, to: Access) -> Result<()> {
        let mut rec = self.device.record()?;
        // A fresh field is stored next, a stored one read.
        rec.barrier(&field.packed().images.map(|i| i.mip(0).from(from).to(to)));
        rec.submit()
    }

    /// Hands tiles of cells with the sums that `fill` gives, or with zeros, to `store`.
    fn put(
        &self,
        grid: &Grid,
        settings: &Visibility,
        cells: &[u32],
        tile: usize,
        fill: Option<&Fill>,
        store: &mut dyn FnMut(&Run) -> Result<()>,
    ) -> Result<()> {
        if cells.is_empty() {
            return Ok(());
        }
        let capacity = cells.len().min(tile.max(1));
        let cell_buffer = self.device.buffer::<u32>("cells", capacity)?;
        let sums = self.device.buffer::<f32>("sums", 16 * capacity)?;
        if fill.is_none() {
            let mut rec = self.device.record()?;
            rec.fill(&sums, 0)?;
            // All tiles read the same zeros.
            rec.barrier(&[sums.all().from(Access::TransferWrite).to(Access::ComputeRead)]);
            rec.submit()?;
        }
        let mut values = vec![0f32; if fill.is_some() { 16 * capacity } else { 0 }];
        for tile in cells.chunks(capacity) {
            self.device.write(&cell_buffer, tile)?;
            if let Some(fill) = fill {
                fill(tile, capacity, &mut values);
                self.device.write(&sums, &values)?;
            }
            store(&Run {
                grid,
                field_dims: grid.field_dims(settings.ratio as usize),
                cells: &cell_buffer,
                cell_count: tile.len() as u32,
                capacity: capacity as u32,
                directions: &cell_buffer,
                sums: &sums,
                pattern_size: settings.directions,
                patterns: 1,
                bands: settings.bands,
                first_direction: 0,
                direction_count: 0,
            })?;
        }
        Ok(())
    }

    /// The field's coefficients as the renderers see them (after packing): bands² per cell, coefficient fastest, then x,
    /// y, z; zero where it holds nothing.
    ///
    /// # Errors
    /// What the device refuses.
    pub fn read_field(&self, field: &Field) -> Result<Vec<f32>> {
        let s = field.settings();
        let kept = s.coefficients();
        let cells: usize = field.dims().iter().product();
        let (form, groups) = ((s.bands, s.bits, s.fit > 0), pack::groups(s.bands));
        let texel = pack::formats(s.bands, s.bits).0.bytes() as usize;
        let images = &field.packed().images[..groups];
        let images: Vec<Vec<u8>> = images.iter().map(|image| self.device.read_image(image, 0)).collect::<Result<_>>()?;
        let mut out: Vec<f32> = zeroed("a field", kept * cells)?;
        for (cell, first, count) in field.bricks().runs() {
            let out = &mut out[kept * cell..kept * (cell + count)];
            for (g, bytes) in images.iter().enumerate() {
                pack::unpack(&bytes[texel * first..texel * (first + count)], g, form, out);
            }
        }
        Ok(out)
    }
}
