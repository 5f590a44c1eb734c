//! Aggregated costs -> the best candidate of every pixel: by the sum of four paths (Hirschmüller, *Stereo Processing by
//! Semiglobal Matching and Mutual Information*, PAMI 2008), by two along the row, by dynamic programming under the
//! ordering constraint, or each pixel by itself.
//!
//! The cost volume never exists. An image is cut into bands of [`BAND`] rows, a band into panels of [`PANEL`] columns;
//! what is worked on at a time stays in the second-level cache. Paths from the left go through whole rows. Those from the
//! right begin [`LOOKAHEAD_COLUMNS`] columns right of each panel, those from above and below [`LOOKAHEAD_ROWS`] rows outside each
//! band: so no band depends on another one, whoever works on it and when. Bands and panels begin at multiples of their
//! sizes, whatever is matched by whom, so the result depends on nothing else:
//!
//! ```text
//! for band in bands:                                       # on any thread, in any order
//!     for panel in panels, from the left:
//!         costs of the panel after this one                # aggregation
//!         paths from the right, then from the left         # paths::HorizontalPass; their mean is kept
//!         paths from below, then from above; the sum of
//!             all four decides                             # paths::VerticalPass, selection
//! ```
//!
//! Means of bad-1.0 (%) over 13 sharp scenes, Gauss 2 and disk 3: eight whole paths 5.5, 15.3, 12.8; four whole ones
//! 5.5, 15.1, 12.7; as here 5.6, 15.1, 12.7; three from above and the row alone 5.8, 15.4, 13.0.

pub mod edges;
pub mod evidence;
pub mod ordered;
pub mod paths;
pub mod selection;

use std::ops::Range;

use rayon::prelude::*;

use crate::cost::Costs;
use crate::cost::aggregation::{Aggregator, PixelBlock, Window};
use crate::error::{Error, Result};
use crate::image::plane::Plane;
use crate::optimization::edges::Edges;
use crate::optimization::evidence::Evidence;
use crate::pipeline::control::Control;
use crate::pipeline::memory::Memory;
use crate::settings::{Optimizer, Settings};
use crate::simd::{Level, Loop};
use crate::value::{LANES, Lanes, Value};

use self::ordered::Ordered;
use self::paths::{
    AdaptivePenalties, Horizontal, HorizontalPass, Panel, Smoothness, Vertical, VerticalPass,
};
use self::selection::{Minimum, PIXELS, Selection};

/// Rows of a band.
pub const BAND: usize = 64;
/// Rows above and below a band from where its vertical paths come.
pub const LOOKAHEAD_ROWS: usize = 16;
/// Columns of a panel.
pub const PANEL: usize = 64;
/// Columns right of a panel from where its paths from the right come.
pub const LOOKAHEAD_COLUMNS: usize = 16;

/// Rows whose costs are at hand together for dynamic programming along each.
pub const ORDERED_ROWS: usize = 16;

/// The largest penalty: more than any cost of a window, so that a path is free to jump only where that is of use.
pub const LARGEST_SUMMED_PENALTY: u64 = 1 << 28;

/// P1 and P2 in steps of the aggregated costs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Penalties {
    /// For a disparity that differs by one; under the ordering constraint for one that is larger by one.
    pub p1: u64,
    /// For any other change; under the ordering constraint for any smaller disparity.
    pub p2: u64,
}

impl Penalties {
    /// The penalties of checked settings against costs summed over a window, `steps` to the unit.
    pub fn new(settings: &Settings, window: Window, steps: u16) -> Self {
        let unit = window.unit(steps);
        let rounded = |value: f64| ((value * unit).round() as u64).min(LARGEST_SUMMED_PENALTY);
        Self { p1: rounded(settings.p1), p2: rounded(settings.p2) }
    }

    /// The largest total of a path through costs up to this one.
    pub fn largest_total(self, largest_cost: u64) -> u64 {
        largest_cost.saturating_add(self.p1.max(self.p2))
    }
}

/// How the best candidates of an image are searched for.
#[derive(Debug, Clone, Copy)]
pub struct CandidateSearch<'a> {
    /// Rows and columns of the image.
    pub size: (usize, usize),
    /// The row of the whole image that it begins with: bands are those of the whole.
    pub first: usize,
    /// Candidates of each pixel.
    pub candidates: usize,
    /// How costs become disparities.
    pub optimizer: Optimizer,
    /// P1 and P2.
    pub penalties: Penalties,
    /// Where P2 is lower.
    pub edges: &'a Edges,
    /// Whether more than the chosen candidates is to be known.
    pub weighs: bool,
    /// Instructions to use.
    pub level: Level,
    /// Whether to go on.
    pub control: &'a Control,
}

/// Where aggregated costs come from.
pub trait CostSource<T>: Sync {
    /// Writes those of a block, row by row, all candidates of one pixel after another.
    fn write(
        &self,
        aggregator: &mut Aggregator<T>,
        block: PixelBlock,
        out: &mut [Lanes<T>],
    ) -> Result<()>;
}

/// The aggregated costs of a pair.
#[derive(Clone, Copy)]
pub struct AggregatedCosts<'a> {
    /// What pixels cost.
    pub costs: &'a Costs<'a>,
    /// What is summed.
    pub window: Window,
    /// Instructions to use.
    pub level: Level,
}

impl<T: Value> CostSource<T> for AggregatedCosts<'_> {
    fn write(
        &self,
        aggregator: &mut Aggregator<T>,
        block: PixelBlock,
        out: &mut [Lanes<T>],
    ) -> Result<()> {
        aggregator.aggregate(self.costs, self.window, block, self.level, out)
    }
}

/// Costs that are known already: rows of `columns x candidates`.
#[derive(Debug, Clone, Copy)]
pub struct CostVolume<'a> {
    /// The costs.
    pub volume: &'a Plane<u32>,
    /// How many there are for each pixel.
    pub candidates: usize,
}

impl<T: Value> CostSource<T> for CostVolume<'_> {
    fn write(&self, _: &mut Aggregator<T>, block: PixelBlock, out: &mut [Lanes<T>]) -> Result<()> {
        let runs = self.candidates.div_ceil(LANES);
        let mut pixels = out.chunks_exact_mut(runs);
        for y in block.rows {
            let row = &self.volume.row(y)[block.columns.start * self.candidates..];
            for costs in row.chunks_exact(self.candidates).take(block.columns.len()) {
                let Some(out) = pixels.next() else { return Ok(()) };
                let (known, beyond) = out.as_flattened_mut().split_at_mut(self.candidates);
                known.iter_mut().zip(costs).for_each(|(o, c)| *o = T::truncated((*c).into()));
                beyond.fill(T::FAR);
            }
        }
        Ok(())
    }
}

/// What a band is searched in; its memory is used again.
#[derive(Debug)]
pub struct Workspace<T: Value> {
    aggregator: Aggregator<T>,
    /// Costs of the panel at hand and of the one after it.
    costs: [Memory<Lanes<T>>; 2],
    horizontal: Horizontal<T>,
    vertical: Vertical<T>,
    ordered: Ordered,
    evidence: Evidence,
}

impl<T: Value> Default for Workspace<T> {
    fn default() -> Self {
        Self {
            aggregator: Aggregator::default(),
            costs: Default::default(),
            horizontal: Horizontal::default(),
            vertical: Vertical::default(),
            ordered: Ordered::default(),
            evidence: Evidence::default(),
        }
    }
}

impl CandidateSearch<'_> {
    /// The bands that some rows of the image lie in, each as far as it is wanted.
    pub fn bands(&self, rows: Range<usize>) -> impl Iterator<Item = Range<usize>> + use<> {
        let (first, mut start) = (self.first, rows.start);
        std::iter::from_fn(move || {
            let end = (((start + first) / BAND + 1) * BAND - first).min(rows.end);
            let band = start..end;
            start = end;
            (!band.is_empty()).then_some(band)
        })
    }

    /// Runs of candidates of a pixel.
    fn runs(&self) -> usize {
        self.candidates.div_ceil(LANES)
    }

    /// Searches some rows of one band; what is found is of these rows, from the first one on.
    pub fn choose<'w, T: Value>(
        &self,
        rows: Range<usize>,
        source: &impl CostSource<T>,
        workspace: &'w mut Workspace<T>,
    ) -> Result<&'w Evidence> {
        let is_weighed = self.weighs || self.optimizer == Optimizer::SemiGlobal;
        workspace.evidence.begin(rows.len(), self.size.1, is_weighed)?;
        match self.optimizer {
            Optimizer::DynamicProgramming => self.in_order(rows, source, workspace)?,
            Optimizer::WinnerTakesAll => self.singly(rows, source, workspace)?,
            Optimizer::ScanlineOptimization | Optimizer::SemiGlobal => {
                self.along_paths(rows, source, workspace)?;
            }
        }
        Ok(&workspace.evidence)
    }

    /// The panels of the image.
    fn panels(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let cols = self.size.1;
        (0..cols).step_by(PANEL).map(move |start| start..(start + PANEL).min(cols))
    }

    /// The rows whose costs vertical paths of a band see that has these rows.
    fn seen(&self, rows: &Range<usize>) -> Range<usize> {
        let band = (rows.start + self.first) / BAND * BAND;
        let start = band.saturating_sub(LOOKAHEAD_ROWS + self.first);
        let end = (band + BAND + LOOKAHEAD_ROWS - self.first).min(self.size.0);
        start..end
    }

    fn along_paths<T: Value>(
        &self,
        rows: Range<usize>,
        source: &impl CostSource<T>,
        workspace: &mut Workspace<T>,
    ) -> Result<()> {
        let is_vertical = self.optimizer == Optimizer::SemiGlobal;
        let (runs, cols) = (self.runs(), self.size.1);
        let seen = if is_vertical { self.seen(&rows) } else { rows.clone() };
        let Workspace { aggregator, costs, horizontal, vertical, evidence, .. } = workspace;
        costs.iter_mut().try_for_each(|costs| costs.resize(seen.len() * PANEL * runs))?;
        horizontal.begin(rows.len(), PANEL, runs)?;
        vertical.begin(rows.len(), runs)?;
        let smoothness =
            Smoothness { penalties: AdaptivePenalties::new(self.penalties), edges: self.edges };

        let [here, next] = costs;
        let mut load = |columns: Range<usize>, costs: &mut Memory<Lanes<T>>| {
            let block = PixelBlock { rows: seen.clone(), columns };
            let places = seen.len() * block.columns.len() * runs;
            source.write(aggregator, block, &mut costs[..places])
        };
        load(0..PANEL.min(cols), here)?;
        for columns in self.panels() {
            self.control.checkpoint()?;
            let beyond = columns.end..(columns.end + PANEL).min(cols);
            if !beyond.is_empty() {
                load(beyond.clone(), next)?;
            }
            let panel = Panel {
                block: PixelBlock { rows: rows.clone(), columns },
                seen: seen.clone(),
                costs: here,
                beyond: (next, beyond.len()),
                runs,
            };
            let start = (beyond.start + LOOKAHEAD_COLUMNS).min(cols);
            self.level.run(HorizontalPass { horizontal, panel: &panel, smoothness, start });
            let (candidates, panel, totals) = (self.candidates, &panel, horizontal.means());
            if is_vertical {
                let means = totals;
                self.level.run(VerticalPass {
                    vertical,
                    panel,
                    means,
                    smoothness,
                    candidates,
                    evidence,
                });
            } else {
                let (block, costs) = (&panel.block, Some(panel.costs));
                self.level.run(SelectPixels { search: self, block, totals, costs, evidence });
            }
            std::mem::swap(here, next);
        }
        Ok(())
    }

    /// Each pixel by itself.
    fn singly<T: Value>(
        &self,
        rows: Range<usize>,
        source: &impl CostSource<T>,
        workspace: &mut Workspace<T>,
    ) -> Result<()> {
        let Workspace { aggregator, costs: [costs, _], evidence, .. } = workspace;
        costs.resize(rows.len() * PANEL * self.runs())?;
        for columns in self.panels() {
            self.control.checkpoint()?;
            let totals = &mut costs[..rows.len() * columns.len() * self.runs()];
            let block = &PixelBlock { rows: rows.clone(), columns };
            source.write(aggregator, block.clone(), totals)?;
            self.level.run(SelectPixels { search: self, block, totals, costs: None, evidence });
        }
        Ok(())
    }

    /// Each row by itself under the ordering constraint, a few of them at a time.
    fn in_order<T: Value>(
        &self,
        rows: Range<usize>,
        source: &impl CostSource<T>,
        workspace: &mut Workspace<T>,
    ) -> Result<()> {
        let Workspace { aggregator, costs: [costs, _], ordered, evidence, .. } = workspace;
        let width = self.size.1 * self.runs();
        costs.resize(ORDERED_ROWS.min(rows.len()) * width)?;
        for first in rows.clone().step_by(ORDERED_ROWS) {
            self.control.checkpoint()?;
            let some = first..(first + ORDERED_ROWS).min(rows.end);
            let block = PixelBlock { rows: some.clone(), columns: 0..self.size.1 };
            source.write(aggregator, block, &mut costs[..some.len() * width])?;
            for (y, costs) in some.zip(costs.chunks_exact_mut(width)) {
                self.control.checkpoint()?;
                let chosen = ordered.choose(costs, self.candidates, self.penalties)?;
                let row = y - rows.start;
                self.level.run(WeighRow { search: self, row, chosen, costs, evidence });
            }
        }
        Ok(())
    }
}

/// The best candidates of a block by totals of paths, which are lost, or by costs alone.
struct SelectPixels<'a, T> {
    search: &'a CandidateSearch<'a>,
    block: &'a PixelBlock,
    totals: &'a mut [Lanes<T>],
    costs: Option<&'a [Lanes<T>]>,
    evidence: &'a mut Evidence,
}

impl<T: Value> Loop for SelectPixels<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { search, block: PixelBlock { rows, columns }, totals, costs, evidence } = self;
        let (runs, mut selection) = (search.runs(), Selection::default());
        for row in 0..rows.len() {
            for first in columns.clone().step_by(PIXELS) {
                let pixels = PIXELS.min(columns.end - first);
                let place = (row * columns.len() + first - columns.start) * runs;
                let totals = &mut totals[place..][..pixels * runs];
                for (pixel, totals) in totals.chunks_exact(runs).enumerate() {
                    selection.take(pixel, Minimum::of_all(totals));
                }
                selection.settle(runs);
                if search.weighs {
                    let costs = costs.map(|costs| &costs[place..][..pixels * runs]);
                    selection.weigh(totals, costs, (pixels, search.candidates, runs));
                    selection.write(pixels, evidence, (row, first));
                } else {
                    evidence.choose(row, first, selection.chosen(pixels));
                }
            }
        }
    }
}

/// What there is to know of the candidates chosen for a row, by the costs, which are lost.
struct WeighRow<'a, T> {
    search: &'a CandidateSearch<'a>,
    row: usize,
    chosen: &'a [u16],
    costs: &'a mut [Lanes<T>],
    evidence: &'a mut Evidence,
}

impl<T: Value> Loop for WeighRow<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { search, row, chosen, costs, evidence } = self;
        if !search.weighs {
            return evidence.choose(row, 0, chosen);
        }
        let (runs, mut selection) = (search.runs(), Selection::default());
        let some = chosen.chunks(PIXELS).zip(costs.chunks_mut(PIXELS * runs));
        for (first, (chosen, costs)) in (0..).step_by(PIXELS).zip(some) {
            for (pixel, chosen) in chosen.iter().enumerate() {
                let k = usize::from(*chosen);
                selection.choose(pixel, *chosen, costs[pixel * runs + k / LANES][k % LANES]);
            }
            selection.weigh(costs, None, (chosen.len(), search.candidates, runs));
            selection.write(chosen.len(), evidence, (row, first));
        }
    }
}

/// The chosen indices of a whole volume of aggregated costs.
pub fn optimize(
    volume: &Plane<u32>,
    candidates: usize,
    optimizer: Optimizer,
    penalties: Penalties,
    level: Level,
    control: &Control,
) -> Result<Plane<u16>> {
    let size @ (rows, cols) = (volume.rows(), volume.cols() / candidates);
    if let Some(cost) =
        volume.as_slice().iter().find(|cost| u64::from(**cost) > LARGEST_SUMMED_PENALTY)
    {
        return Err(Error::value("costs", cost, format!("costs up to {LARGEST_SUMMED_PENALTY}")));
    }
    let penalties = Penalties {
        p1: penalties.p1.min(LARGEST_SUMMED_PENALTY),
        p2: penalties.p2.min(LARGEST_SUMMED_PENALTY),
    };
    let (edges, weighs) = (&Edges::nowhere(cols)?, false);
    let search = CandidateSearch {
        size,
        first: 0,
        candidates,
        optimizer,
        penalties,
        edges,
        weighs,
        level,
        control,
    };
    let mut chosen = Plane::new(rows, cols)?;
    let bands = chosen.as_mut_slice().par_chunks_mut(BAND * cols).enumerate();
    bands.try_for_each(|(band, chosen)| {
        let rows = band * BAND..((band + 1) * BAND).min(rows);
        let mut workspace = Workspace::<u32>::default();
        let evidence = search.choose(rows, &CostVolume { volume, candidates }, &mut workspace)?;
        for (row, chosen) in chosen.chunks_exact_mut(cols).enumerate() {
            chosen.copy_from_slice(evidence.row(row).chosen);
        }
        Ok(())
    })?;
    Ok(chosen)
}
