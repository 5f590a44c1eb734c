//! Volumes of costs to be searched along paths through the image, in integers of one's choice.

use std::sync::Mutex;

use phasestereo::aggregation::{Aggregated, Window};
use phasestereo::control::Control;
use phasestereo::edges::Edges;
use phasestereo::error::Result;
use phasestereo::evidence::EvidenceRow;
use phasestereo::matcher::on_threads;
use phasestereo::memory::Memory;
use phasestereo::plane::Plane;
use phasestereo::reference::{self, Found};
use phasestereo::scanline::Steps;
use phasestereo::semiglobal::across::{Across, Advance, Rows};
use phasestereo::semiglobal::{BAND, Field, SemiGlobal};
use phasestereo::simd::Level;
use phasestereo::strip::Strip;
use phasestereo::texture::Texture;
use phasestereo::value::Value;

/// Costs and what they are searched with.
#[derive(Debug, Clone)]
pub struct Volume {
    pub costs: Plane<u32>,
    pub candidates: usize,
    pub steps: Steps,
    /// Gray values, and by how much these are to jump.
    pub gray: Option<(Plane<i32>, f64)>,
}

/// Memory of a search, used again and again.
#[derive(Debug)]
pub struct Search<V, T: Value> {
    paths: SemiGlobal<V, T>,
    across: Mutex<Vec<Across<V, T>>>,
}

impl<V: Value, T: Value> Default for Search<V, T> {
    fn default() -> Self {
        Self { paths: SemiGlobal::default(), across: Mutex::default() }
    }
}

impl Volume {
    /// Rows and columns of the image.
    pub fn size(&self) -> (usize, usize) {
        (self.costs.rows(), self.costs.cols() / self.candidates)
    }

    /// What is found by the naive twins.
    pub fn expected(&self) -> Plane<Found> {
        let Self { costs, candidates, steps, gray } = self;
        let edges = gray.as_ref().map(|(gray, threshold)| reference::edges(gray, *threshold));
        let sums = reference::semi_global(costs, *candidates, *steps, edges.as_ref());
        let (rows, cols) = self.size();
        Plane::from_fn(rows, cols, |y, x| {
            let places = x * candidates..(x + 1) * candidates;
            reference::select(&sums.row(y)[places.clone()], &costs.row(y)[places])
        })
    }

    /// What is found on so many threads.
    pub fn found<V: Value, T: Value>(
        &self,
        search: &mut Search<V, T>,
        level: Level,
        threads: usize,
        control: &Control,
    ) -> Result<Plane<Found>> {
        on_threads(threads, || self.found_here(search, level, control))?
    }

    fn found_here<V: Value, T: Value>(
        &self,
        search: &mut Search<V, T>,
        level: Level,
        control: &Control,
    ) -> Result<Plane<Found>> {
        let (rows, cols) = self.size();
        let edges = self.gray.as_ref().map(|(gray, threshold)| {
            Edges::new(&Texture::new(gray.clone()), *threshold, level, &Control::default())
                .expect("memory")
        });
        let Self { candidates, steps, .. } = *self;
        let edges = edges.as_ref();
        let field = Field { size: (rows, cols), candidates, steps, edges, level, control };
        let mut found = Plane::from_fn(rows, cols, |_, _| None);
        let mut bands: Vec<_> = found.as_mut_slice().chunks_mut(BAND * cols).collect();
        let (paths, across) = (&mut search.paths, &search.across);
        let load = |band, rows: &mut Rows<V, T>| {
            let spare = across.lock().expect("no panic").pop();
            let mut used = spare.unwrap_or_default();
            self.load(field, band, &mut used, rows)?;
            across.lock().expect("no panic").push(used);
            Ok(())
        };
        paths.run(field, (0, None), &mut bands, load, |band, evidence| {
            for (row, out) in band.chunks_exact_mut(cols).enumerate() {
                write(evidence.row(row), out);
            }
            Ok(())
        })?;
        Ok(found.map(|found| found.expect("every pixel is handed on")))
    }

    /// The rows of a band.
    fn load<V: Value, T: Value>(
        &self,
        field: Field,
        band: usize,
        across: &mut Across<V, T>,
        rows: &mut Rows<V, T>,
    ) -> Result<()> {
        let ((height, cols), candidates) = (self.size(), self.candidates);
        let first = band * BAND;
        let strip = Strip { first, rows: BAND.min(height - first), margin: 0, height };
        let window = Window { rows: height, cols, candidates, side: 1, ..Window::default() };
        let mut lanes = Memory::default();
        across.begin(rows, strip, (cols, candidates), field.steps, field.edges)?;
        for tile in window.tiles() {
            let columns = tile.finished.clone();
            let places: Vec<_> = (columns.start * candidates..columns.end * candidates).collect();
            let value = |cost: u32| V::truncated(cost.into());
            strip.transpose(&places, |y| self.costs.row(y), value, &mut lanes)?;
            let costs = Aggregated::new(lanes.as_chunks().0, 1, candidates);
            field.level.run(Advance { across, rows, tile: &tile, costs });
        }
        across.finish(rows, field.level)
    }
}

fn write(row: EvidenceRow, out: &mut [Option<Found>]) {
    for (x, out) in out.iter_mut().enumerate() {
        *out = Some(Found {
            chosen: row.chosen[x],
            own: row.own[x],
            elsewhere: row.elsewhere[x],
            offset: row.offset[x],
        });
    }
}
