//! Aggregated costs -> the best candidate by the sum of eight paths through the image (Hirschmüller, *Stereo
//! Processing by Semiglobal Matching and Mutual Information*, PAMI 2008), in memory that does not grow with its
//! height.
//!
//! Along each path a total goes on: staying at a disparity is free, a change by one costs the near penalty, any other
//! the far one, which is lower where the gray values of the left image jump. Two paths come along the row, three from
//! all that is above. What is below has not been seen yet, but what matters most of it: three paths come up from
//! [`LOOK`] rows below the band that is worked on. Bands begin at multiples of [`BAND`] rows, whatever is worked on
//! by whom, so the result depends on nothing else.

pub mod across;
pub mod selection;
pub mod vertical;
pub mod volume;

use std::ops::Range;

use rayon::prelude::*;

use crate::aggregation::{Aggregated, Window};
use crate::control::Control;
use crate::edges::Edges;
use crate::error::Result;
use crate::evidence::Evidence;
use crate::memory::Memory;
use crate::plane::Plane;
use crate::scanline::Steps;
use crate::simd::Level;
use crate::strip::{BLOCK, Strip};
use crate::value::Value;

use self::across::{Across, Advance, Rows};
use self::selection::Selection;
use self::vertical::{Down, Up, Vertical};
use self::volume::{GROUP, Volume};

/// Paths that come to a pixel.
pub const PATHS: u32 = 8;
/// Rows of a band: as many as lanes.
pub const BAND: usize = BLOCK;
/// Rows below a band from which paths come up. Means of bad-1.0 and bad-2.0 (%) over the 12 sharp scenes of the
/// one-sided-blur suite: without any such path 6.8, 4.7; from 16 rows 6.2, 4.2; from 32 rows 6.1, 4.2; from the
/// last row of the image 6.1, 4.2.
pub const LOOK: usize = 16;
const _: () = assert!(LOOK <= BAND && BAND <= GROUP);

/// Bands that are worked on at the same time, at most: memory grows with them.
const MOST_BANDS: usize = 8;
/// Least groups of columns for which a thread of its own is worth two more groups that both neighbours work on.
const LEAST_GROUPS: usize = 6;

/// What a change by more than one costs, by the jump of the gray values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Far<T>([T; 3]);

impl<T: Value> Far<T> {
    /// The whole penalty, half, and a third of it, but not less than the near one.
    pub fn new(steps: Steps) -> Self {
        Self([1, 2, 3].map(|part| T::truncated((steps.far / part).max(steps.near))))
    }

    /// The penalty after a jump.
    #[inline(always)]
    pub fn after(&self, jump: u8) -> T {
        let [whole, half, third] = self.0;
        match jump {
            0 => whole,
            1 => half,
            _ => third,
        }
    }

    /// The penalties after jumps.
    #[inline(always)]
    pub fn after_all<const N: usize>(&self, jumps: [u8; N]) -> [T; N] {
        let mut penalties = [T::default(); N];
        for j in 0..N {
            penalties[j] = self.after(jumps[j]);
        }
        penalties
    }
}

/// The image that paths go through.
#[derive(Debug, Clone, Copy)]
pub struct Field<'a> {
    /// Rows and columns.
    pub size: (usize, usize),
    /// Candidates of each pixel.
    pub candidates: usize,
    /// The penalties.
    pub steps: Steps,
    /// Where they are lower; `None`: nowhere.
    pub edges: Option<&'a Edges>,
    /// Instructions to use.
    pub level: Level,
    /// Whether to go on.
    pub control: &'a Control,
}

/// Searches one image after another; its memory is used again.
#[derive(Debug)]
pub struct SemiGlobal<V, T: Value> {
    /// Of the bands at hand and the one after them.
    rows: Vec<Rows<V, T>>,
    /// What comes from below, of each band at hand.
    below: Vec<(Vertical<T>, Volume<T>)>,
    /// What comes from above.
    above: Vertical<T>,
    /// The same for some columns, and what is best there.
    parts: Vec<(Vertical<T>, Selection<T::Wide>)>,
    /// Of each band at hand.
    evidence: Vec<Evidence>,
}

impl<V, T: Value> Default for SemiGlobal<V, T> {
    fn default() -> Self {
        Self {
            rows: vec![],
            below: vec![],
            above: Vertical::default(),
            parts: vec![],
            evidence: vec![],
        }
    }
}

impl<V: Value, T: Value> SemiGlobal<V, T> {
    /// Searches some bands of an image, from that of index `top` on: `load` tells the rows of the band of an index,
    /// `hand_on` takes what was found of it to one of `bands`. Paths from above go on from where those through the
    /// bands before had come to, or begin.
    pub fn run<B: Send>(
        &mut self,
        field: Field,
        (top, paths): (usize, Option<&[u8]>),
        bands: &mut [B],
        load: impl Fn(usize, &mut Rows<V, T>) -> Result<()> + Sync,
        hand_on: impl Fn(&mut B, &Evidence) -> Result<()> + Sync,
    ) -> Result<()> {
        let at_once = rayon::current_num_threads().min(MOST_BANDS);
        self.begin(field, at_once.min(bands.len()))?;
        paths.map(|paths| self.above.read(paths)).transpose()?;
        let (mut loaded, count) = (top, field.size.0.div_ceil(BAND));
        for (first, bands) in (top..).step_by(at_once).zip(bands.chunks_mut(at_once)) {
            if first > top {
                self.rows.rotate_left(at_once);
            }
            let end = (first + bands.len() + 1).min(count);
            let missing = self.rows[loaded - first..end - first].par_iter_mut();
            missing.zip(loaded..end).try_for_each(|(rows, band)| load(band, rows))?;
            loaded = end;
            self.come_up(field, first, bands.len())?;
            for band in 0..bands.len() {
                self.go_down(field, first, band)?;
            }
            let evidence = self.evidence.par_iter();
            bands
                .par_iter_mut()
                .zip(evidence)
                .try_for_each(|(band, found)| hand_on(band, found))?;
        }
        Ok(())
    }

    /// Where the paths from above have come to.
    pub fn paths(&self) -> Vec<u8> {
        self.above.write()
    }

    fn begin(&mut self, field: Field, at_once: usize) -> Result<()> {
        let groups = field.size.1.div_ceil(GROUP);
        self.rows.resize_with(at_once + 1, Default::default);
        self.below.resize_with(at_once, Default::default);
        self.evidence.resize_with(at_once, Default::default);
        let parts = rayon::current_num_threads().min(groups / LEAST_GROUPS).max(1);
        self.parts.resize_with(parts, Default::default);
        for (part, (paths, _)) in self.parts.iter_mut().enumerate() {
            paths.begin(around(part, parts, groups).len(), field.candidates)?;
        }
        self.above.begin(groups, field.candidates)
    }

    /// Paths from below, for each of the bands by itself.
    fn come_up(&mut self, field: Field, first: usize, count: usize) -> Result<()> {
        let Self { rows, below, .. } = self;
        below[..count].par_iter_mut().enumerate().try_for_each(|(index, (paths, sums))| {
            field.control.checkpoint()?;
            let band = field.band(first + index);
            paths.begin(field.size.1.div_ceil(GROUP), field.candidates)?;
            sums.begin(field.size.1, field.candidates)?;
            let start = (band.end - 1 + LOOK).min(field.size.0 - 1);
            field.level.run(Up {
                paths,
                rows: [rows.get(index), rows.get(index + 1)],
                places: [band.start, band.end - 1, start],
                edges: field.edges,
                penalties: field.penalties(),
                sums,
            });
            Ok(())
        })
    }

    /// Paths from above through a band, in several parts of its columns: at their borders each of two works out
    /// as many columns more as the band has rows, since so far what happens elsewhere can reach.
    fn go_down(&mut self, field: Field, first: usize, index: usize) -> Result<()> {
        let Self { rows, below, above, parts, evidence } = self;
        let groups = field.size.1.div_ceil(GROUP);
        let places = field.band(first + index);
        let count = parts.len();
        let whole = &*above;
        parts.par_iter_mut().enumerate().try_for_each(|(part, (paths, selection))| {
            field.control.checkpoint()?;
            paths.branch_off(whole, around(part, count, groups).start);
            selection.begin(places.len(), own(part, count, groups), field.candidates)?;
            field.level.run(Down {
                paths,
                first_group: around(part, count, groups).start,
                rows: &rows[index],
                places: places.clone(),
                from_below: &below[index].1,
                edges: field.edges,
                penalties: field.penalties(),
                selection,
            });
            Ok(())
        })?;
        evidence[index].begin(places.len(), groups * GROUP)?;
        for (part, (paths, selection)) in parts.iter().enumerate() {
            let range = own(part, count, groups);
            above.join(paths, around(part, count, groups).start, &range);
            if part > 0 && !range.is_empty() {
                above.meet(range.start);
            }
            evidence[index].take(selection.evidence(), range.start * GROUP);
        }
        field.control.finish_rows(places.len());
        Ok(())
    }
}

/// The groups of columns of one of several parts.
fn own(part: usize, parts: usize, groups: usize) -> Range<usize> {
    let width = groups.div_ceil(parts);
    (part * width).min(groups)..((part + 1) * width).min(groups)
}

/// These and one more on either side.
fn around(part: usize, parts: usize, groups: usize) -> Range<usize> {
    let Range { start, end } = own(part, parts, groups);
    start.saturating_sub(1)..(end + 1).min(groups)
}

impl Field<'_> {
    fn band(&self, index: usize) -> Range<usize> {
        index * BAND..((index + 1) * BAND).min(self.size.0)
    }

    fn penalties<T: Value>(&self) -> (T, Far<T>) {
        (T::truncated(self.steps.near), Far::new(self.steps))
    }
}

/// The chosen indices of a whole volume of aggregated costs.
pub fn optimize(
    volume: &Plane<u32>,
    candidates: usize,
    steps: Steps,
    edges: Option<&Edges>,
    level: Level,
    control: &Control,
) -> Result<Plane<u16>> {
    let (rows, cols) = (volume.rows(), volume.cols() / candidates);
    let mut chosen = Plane::new(rows, cols)?;
    let field = Field { size: (rows, cols), candidates, steps, edges, level, control };
    let mut bands: Vec<_> = chosen.as_mut_slice().chunks_mut(BAND * cols).collect();
    let load = |band: usize, rows: &mut Rows<u32, u64>| load_volume(field, volume, band, rows);
    SemiGlobal::default().run(field, (0, None), &mut bands, load, |band, evidence| {
        for (row, out) in band.chunks_exact_mut(cols).enumerate() {
            out.copy_from_slice(&evidence.row(row).chosen[..cols]);
        }
        Ok(())
    })?;
    Ok(chosen)
}

fn load_volume(
    field: Field,
    volume: &Plane<u32>,
    band: usize,
    rows: &mut Rows<u32, u64>,
) -> Result<()> {
    let (Field { candidates, level, .. }, (height, cols)) = (field, field.size);
    let band = field.band(band);
    let strip = Strip { first: band.start, rows: band.len(), margin: 0, height };
    let window = Window { rows: height, cols, candidates, side: 1, ..Window::default() };
    let (mut lanes, mut across) = (Memory::default(), Across::<u32, u64>::default());
    across.begin(rows, strip, (cols, candidates), field.steps, field.edges)?;
    for tile in window.tiles() {
        field.control.checkpoint()?;
        let columns = tile.finished.clone();
        let places: Vec<_> = (columns.start * candidates..columns.end * candidates).collect();
        strip.transpose(&places, |y| volume.row(y), |cost| cost, &mut lanes)?;
        let costs = Aggregated::new(lanes.as_chunks().0, 1, candidates);
        level.run(Advance { across: &mut across, rows, tile: &tile, costs });
    }
    across.finish(rows, level)
}
