//! Flags speckles: small regions whose disparities differ from all around them are wrong, whatever they cost.
//!
//! Connected components by runs: each row is cut into runs of connected pixels, and a run is united with the runs that it
//! touches in the row above (union-find). Bands of rows are labeled in parallel, then united across their seams. The size
//! of a region does not depend on the order.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::image::plane::{Plane, reserve};
use crate::pipeline::control::Control;
use crate::refinement::filling::Trusted;
use crate::refinement::flag;
use crate::simd::{Level, Loop};

/// Rows of a band: enough that uniting bands is little work, few enough that there are bands for all threads.
const BAND: usize = 32;
/// Pixels that are tested together for the end of a run.
const LOOK: usize = 8;

/// Flags the connected regions of up to `size` trusted pixels. Two neighbors, horizontal or vertical, are connected if
/// their disparities differ by `range` at most.
pub fn flag_speckles(
    disparity: &Plane<f32>,
    flags: &mut Plane<u16>,
    (size, range): (usize, f32),
    level: Level,
    control: &Control,
) -> Result<()> {
    let cols = disparity.cols();
    let count = disparity.as_slice().len();
    // Runs are numbered in 32 bits, and there are no more runs than pixels.
    if u32::try_from(count).is_err() {
        return Err(Error::value("left", format!("{count} pixels"), "fewer than 2^32 pixels"));
    }

    let (bands, regions) = TrustedMap { disparity, flags, range, level }.find(control)?;

    // Bands number their runs from 0, the forest those of all bands.
    let first_runs = bands.iter().scan(0, |next, band| {
        let first = *next;
        *next += band.runs.len();
        Some(first)
    });
    let first_runs: Vec<usize> = first_runs.collect();

    let parts = flags.as_mut_slice().par_chunks_mut(BAND * cols).zip(&bands).zip(first_runs);
    parts.for_each(|((flags, band), first)| {
        let is_small = |run: usize| regions.size((first + run) as u32) <= size;
        for (y, flags) in flags.chunks_mut(cols).enumerate() {
            for index in (band.rows[y]..band.rows[y + 1]).filter(|index| is_small(*index)) {
                let Run { start, end } = band.runs[index];
                for flags in &mut flags[start as usize..end as usize] {
                    *flags |= flag::SPECKLE;
                }
            }
        }
    });
    Ok(())
}

/// The map whose regions are searched.
struct TrustedMap<'a> {
    disparity: &'a Plane<f32>,
    flags: &'a Plane<u16>,
    range: f32,
    level: Level,
}

/// The columns of a run of connected pixels.
#[derive(Debug, Clone, Copy)]
struct Run {
    start: u32,
    end: u32,
}

/// The runs of some rows, from left to right, and how they are connected.
#[derive(Debug, Default)]
struct RunBand {
    runs: Vec<Run>,
    /// The first run of each row, and where those of the last row end.
    rows: Vec<usize>,
    regions: Forest,
}

/// A union-find forest of runs.
#[derive(Debug, Default)]
struct Forest {
    /// The parent of each run; a root is its own.
    parents: Vec<u32>,
    /// The pixels of each root's set.
    sizes: Vec<u32>,
}

/// The trusted disparities of a row, NaN elsewhere, and where runs begin.
#[derive(Debug)]
struct TrustedRow {
    values: Vec<f32>,
    /// 1 where a pixel is not connected with its left neighbor, else 0; zeros up to a multiple of [`LOOK`].
    breaks: Vec<u8>,
}

impl TrustedMap<'_> {
    /// The runs of all bands, and one forest of all of them.
    fn find(&self, control: &Control) -> Result<(Vec<RunBand>, Forest)> {
        let rows = self.disparity.rows();
        let tops: Vec<usize> = (0..rows).step_by(BAND).collect();
        let bands = tops.par_iter().map(|&top| {
            control.checkpoint()?;
            self.band(top, (top + BAND).min(rows))
        });
        // Seams are united in order: that is little work.
        let mut bands: Vec<RunBand> = bands.collect::<Result<_>>()?;

        let mut regions = Forest::default();
        for index in 0..bands.len() {
            let first = regions.parents.len();
            regions.take(std::mem::take(&mut bands[index].regions))?;

            if let Some(before) = index.checked_sub(1) {
                let seam = [self.row(tops[index] - 1), self.row(tops[index])];
                let above = bands[before].last();
                let here = bands[index].row(0);
                let firsts = [first - above.len(), first];
                self.unite(seam.each_ref(), [above, here], firsts, &mut regions);
            }
        }

        Ok((bands, regions))
    }

    /// The runs of the rows from `top` to `bottom`.
    fn band(&self, top: usize, bottom: usize) -> Result<RunBand> {
        let mut band = RunBand { rows: vec![0], ..RunBand::default() };
        let mut above: Option<TrustedRow> = None;
        for y in top..bottom {
            let here = self.row(y);
            band.add(&here)?;

            if let (Some(above), &[.., before, first, _]) = (&above, band.rows.as_slice()) {
                let (above_runs, here_runs) = band.runs[before..].split_at(first - before);
                let firsts = [before, first];
                self.unite([above, &here], [above_runs, here_runs], firsts, &mut band.regions);
            }

            above = Some(here);
        }

        Ok(band)
    }

    /// The trusted disparities of row `y` and its runs' beginnings.
    fn row(&self, y: usize) -> TrustedRow {
        let disparity = self.disparity.row(y);
        let flags = self.flags.row(y);
        let mut row = TrustedRow {
            values: vec![0.0; disparity.len()],
            breaks: vec![0; disparity.len().next_multiple_of(LOOK)],
        };

        let TrustedRow { values, breaks } = &mut row;
        self.level.run(FindBreaks { disparity, flags, range: self.range, values, breaks });
        row
    }

    /// Unites the runs of a row with the runs above that they touch. `firsts` are the numbers of the first run of each row.
    fn unite(
        &self,
        [above, here]: [&TrustedRow; 2],
        [upper, lower]: [&[Run]; 2],
        firsts: [usize; 2],
        regions: &mut Forest,
    ) {
        let is_connected = |(a, b): (&f32, &f32)| (a - b).abs() <= self.range;

        // Both rows are followed from left to right; the run that ends first makes way for the next of its row.
        let (mut i, mut j) = (0, 0);
        while let (Some(a), Some(b)) = (upper.get(i), lower.get(j)) {
            let both = a.start.max(b.start) as usize..a.end.min(b.end) as usize;
            if !both.is_empty() {
                let roots = [firsts[0] + i, firsts[1] + j].map(|run| regions.root(run as u32));
                let pairs = || above.values[both.clone()].iter().zip(&here.values[both.clone()]);

                if roots[0] != roots[1] && pairs().any(is_connected) {
                    regions.unite(roots);
                }
            }

            if a.end < b.end { i += 1 } else { j += 1 }
        }
    }
}

impl RunBand {
    /// Adds the runs of the next row, each a region of its own.
    fn add(&mut self, row: &TrustedRow) -> Result<()> {
        let most = row.values.len();
        reserve(&mut self.runs, most)?;

        let mut start = None;
        let mut end_at = |column: usize| {
            if let Some(start) = start {
                self.runs.push(Run { start, end: column as u32 });
            }
            let is_trusted = row.values.get(column).is_some_and(|value| !value.is_nan());
            start = is_trusted.then_some(column as u32);
        };

        // Eight bytes are tested at once: most pixels begin no run.
        for (look, breaks) in row.breaks.as_chunks::<LOOK>().0.iter().enumerate() {
            let mut breaks = u64::from_le_bytes(*breaks);
            while breaks != 0 {
                end_at(look * LOOK + breaks.trailing_zeros() as usize / 8);
                breaks &= breaks - 1;
            }
        }
        end_at(most);

        let first = self.regions.parents.len();
        self.regions.add(self.runs[first..].iter().map(|run| run.end - run.start))?;
        self.rows.push(self.runs.len());
        Ok(())
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

    /// Unites the sets of two roots; the larger one's root stays.
    fn unite(&mut self, roots: [u32; 2]) {
        let [a, b] = roots.map(|root| root as usize);
        let (small, large) = if self.sizes[a] < self.sizes[b] { (a, b) } else { (b, a) };
        self.parents[small] = large as u32;
        self.sizes[large] += self.sizes[small];
    }

    /// The pixels of the set of a run.
    fn size(&self, mut run: u32) -> usize {
        while self.parent(run) != run {
            run = self.parent(run);
        }
        self.sizes[run as usize] as usize
    }
}

/// Extracts the trusted disparities of a row and where they are not connected.
struct FindBreaks<'a> {
    disparity: &'a [f32],
    flags: &'a [u16],
    range: f32,
    values: &'a mut [f32],
    breaks: &'a mut [u8],
}

impl Loop for FindBreaks<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { disparity, flags, range, values, breaks } = self;
        Trusted { disparity, flags, row: values }.run();

        // NaN is connected with nothing, so runs of trusted pixels end at untrusted ones.
        breaks[0] = 1;
        for ((out, from), to) in breaks[1..].iter_mut().zip(&values[..]).zip(&values[1..]) {
            let is_connected = (from - to).abs() <= range;
            *out = u8::from(!is_connected);
        }
    }
}
