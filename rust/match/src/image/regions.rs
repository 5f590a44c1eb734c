//! Regions of connected pixels, found by runs:
//!
//! ```text
//! for each band of rows, in parallel:
//!     for each row:
//!         cut it into runs of connected pixels, each a region of its own
//!         for each of these runs and each of the row above with shared columns, connected in one of them:
//!             unite their regions                                     # union-find, the larger root stays
//! unite regions across the seams of the bands
//! ```
//!
//! The map defines which pixels are connected. Neither the pixels of a region nor their number depend on the
//! order.

use std::ops::Range;

use rayon::prelude::*;

use crate::base::control::Control;
use crate::base::error::{Error, Result};
use crate::base::plane::reserve;

/// Rows of a band: enough that uniting bands is little work, few enough that all threads have bands.
const BAND: usize = 32;

/// A map that defines which neighboring pixels are connected.
pub trait Connectivity: Sync {
    /// The data of a row.
    type Row;

    /// Rows and columns.
    fn size(&self) -> (usize, usize);

    /// Row `y`.
    fn row(&self, y: usize) -> Self::Row;

    /// Adds the runs of connected pixels of a row, from left to right.
    fn add_runs(row: &Self::Row, runs: &mut Vec<Run>);

    /// Whether a pixel of a row is connected with the one above it in any of these columns.
    fn is_connected(&self, above: &Self::Row, here: &Self::Row, columns: Range<usize>) -> bool;
}

/// The columns of a run of connected pixels.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    /// The first one.
    pub start: u32,
    /// The one after the last.
    pub end: u32,
}

/// All regions of a map.
#[derive(Debug)]
pub struct Regions {
    bands: Vec<RunBand>,
    /// The number of the first run of each band.
    firsts: Vec<usize>,
    forest: Forest,
}

/// A region of connected pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// Identical for all its runs, and unique to it.
    pub number: u32,
    /// How many pixels it has.
    pub pixels: usize,
}

/// The runs of some rows, from left to right, and how they are connected.
#[derive(Debug, Default)]
struct RunBand {
    runs: Vec<Run>,
    /// The first run of each row, and the end of those of the last row.
    rows: Vec<usize>,
    forest: Forest,
}

/// A union-find forest of runs.
#[derive(Debug, Default)]
struct Forest {
    /// The parent of each run; a root is its own.
    parents: Vec<u32>,
    /// The pixels of each root's set.
    sizes: Vec<u32>,
}

impl Regions {
    /// The regions of a map.
    pub fn find<M: Connectivity>(map: &M, control: &Control) -> Result<Self> {
        let (rows, cols) = map.size();
        // Runs are numbered in 32 bits, and there are no more runs than pixels.
        if u32::try_from(rows * cols).is_err() {
            let count = format!("{} pixels", rows * cols);
            return Err(Error::value("left", count, "fewer than 2^32 pixels"));
        }

        let tops: Vec<usize> = (0..rows).step_by(BAND).collect();
        let bands = tops.par_iter().map(|&top| {
            control.checkpoint()?;
            RunBand::new(map, top..(top + BAND).min(rows))
        });
        let mut bands: Vec<RunBand> = bands.collect::<Result<_>>()?;

        // Bands number their runs from 0, the forest numbers those of all bands. Seams are united in order:
        // that is little work.
        let (mut forest, mut firsts) = (Forest::default(), vec![]);
        for index in 0..bands.len() {
            let first = forest.parents.len();
            forest.take(std::mem::take(&mut bands[index].forest))?;
            firsts.push(first);

            if let Some(before) = index.checked_sub(1) {
                let seam = [map.row(tops[index] - 1), map.row(tops[index])];
                let above = bands[before].last();
                let here = bands[index].row(0);
                let firsts = [first - above.len(), first];
                forest.unite_rows(map, seam.each_ref(), [above, here], firsts);
            }
        }

        Ok(Self { bands, firsts, forest })
    }

    /// The runs of row `y`, from left to right: their columns, and their regions.
    pub fn row(&self, y: usize) -> impl Iterator<Item = (Range<usize>, Region)> {
        let (band, row) = (&self.bands[y / BAND], y % BAND);
        let first = self.firsts[y / BAND] + band.rows[row];

        let runs = (first as u32..).zip(band.row(row));
        runs.map(|(number, run)| (run.start as usize..run.end as usize, self.forest.region(number)))
    }
}

impl RunBand {
    /// The runs of some rows of a map.
    fn new<M: Connectivity>(map: &M, rows: Range<usize>) -> Result<Self> {
        let cols = map.size().1;
        let mut band = Self { rows: vec![0], ..Self::default() };
        let mut above: Option<M::Row> = None;

        for y in rows {
            let here = map.row(y);
            reserve(&mut band.runs, cols)?;
            M::add_runs(&here, &mut band.runs);

            let first = band.forest.parents.len();
            band.forest.add(band.runs[first..].iter().map(|run| run.end - run.start))?;
            band.rows.push(band.runs.len());

            if let (Some(above), &[.., before, first, _]) = (&above, band.rows.as_slice()) {
                let runs = band.runs[before..].split_at(first - before).into();
                band.forest.unite_rows(map, [above, &here], runs, [before, first]);
            }

            above = Some(here);
        }

        Ok(band)
    }

    /// The runs of row `y` of the band.
    fn row(&self, y: usize) -> &[Run] {
        &self.runs[self.rows[y]..self.rows[y + 1]]
    }

    /// The runs of the last row.
    fn last(&self) -> &[Run] {
        self.row(self.rows.len() - 2)
    }
}

impl Forest {
    /// Adds sets of one run each, of these sizes.
    fn add(&mut self, sizes: impl ExactSizeIterator<Item = u32>) -> Result<()> {
        reserve(&mut self.parents, sizes.len())?;
        reserve(&mut self.sizes, sizes.len())?;

        let first = self.parents.len() as u32;
        self.parents.extend(first..first + sizes.len() as u32);
        self.sizes.extend(sizes);
        Ok(())
    }

    /// Adds the sets of another forest.
    fn take(&mut self, other: Self) -> Result<()> {
        reserve(&mut self.parents, other.parents.len())?;
        reserve(&mut self.sizes, other.sizes.len())?;

        let first = self.parents.len() as u32;
        self.parents.extend(other.parents.iter().map(|parent| first + parent));
        self.sizes.extend(other.sizes);
        Ok(())
    }

    fn parent(&self, run: u32) -> u32 {
        self.parents[run as usize]
    }

    /// The root of a run's set. Halves the path to it.
    fn root(&mut self, mut run: u32) -> u32 {
        while self.parent(run) != run {
            let grandparent = self.parent(self.parent(run));
            self.parents[run as usize] = grandparent;

            run = grandparent;
        }
        run
    }

    /// Unites the runs of a row with the runs above that they connect to. `firsts` are the numbers of the
    /// first run of each row.
    fn unite_rows<M: Connectivity>(
        &mut self,
        map: &M,
        [above, here]: [&M::Row; 2],
        [upper, lower]: [&[Run]; 2],
        firsts: [usize; 2],
    ) {
        // Both rows are followed from left to right; whichever run ends first advances to the next of its
        // row.
        let (mut i, mut j) = (0, 0);
        while let (Some(a), Some(b)) = (upper.get(i), lower.get(j)) {
            let both = a.start.max(b.start) as usize..a.end.min(b.end) as usize;
            if !both.is_empty() {
                let roots = [firsts[0] + i, firsts[1] + j].map(|run| self.root(run as u32));
                if roots[0] != roots[1] && map.is_connected(above, here, both) {
                    self.unite(roots);
                }
            }

            if a.end < b.end { i += 1 } else { j += 1 }
        }
    }

    /// Unites the sets of two roots; the larger one's root stays.
    fn unite(&mut self, roots: [u32; 2]) {
        let [a, b] = roots.map(|root| root as usize);
        let (small, large) = if self.sizes[a] < self.sizes[b] { (a, b) } else { (b, a) };
        self.parents[small] = large as u32;
        self.sizes[large] += self.sizes[small];
    }

    /// The region of a run.
    fn region(&self, mut run: u32) -> Region {
        while self.parent(run) != run {
            run = self.parent(run);
        }
        Region { number: run, pixels: self.sizes[run as usize] as usize }
    }
}
