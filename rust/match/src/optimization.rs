//! Aggregated costs -> the best candidate of every pixel: by the sum of four paths (Hirschmüller, *Stereo
//! Processing by Semiglobal Matching and Mutual Information*, PAMI 2008), by two along the row, by dynamic
//! programming under the ordering constraint, or for each pixel by itself.
//!
//! The cost volume never exists as a whole. An image is cut into bands of [`BAND`] rows, or half that
//! ([`band_height`]), and a band into panels of [`PANEL`] columns. The costs of a panel lie in strips of
//! [`STRIP`] columns; those of up to about 128 disparities fit in a second-level cache. Paths from the left
//! run through whole rows. Paths from the right start [`LOOKAHEAD_COLUMNS`] columns to the right of each
//! panel, paths from above and below [`LOOKAHEAD_ROWS`] rows outside each band. So no band depends on
//! another, and any thread may work on any band at any time. Bands and panels begin at multiples of their
//! sizes in the whole image, so the result does not depend on which rows are matched together:
//!
//! ```text
//! for band in bands:                                       # any thread, any order
//!     for panel in panels, from the left:
//!         candidates to search in it                       # all, or those of panel_ranges
//!         costs of the panel and its look-ahead columns    # aggregation
//!         paths from the right, then from the left         # paths::HorizontalPass; keeps their mean
//!         paths from below, then from above                # paths::VerticalPass
//!         the least mean of all four paths wins            # selection
//! ```
//!
//! Four paths are as good as eight, and look-aheads lose hardly anything compared with whole paths. Paths
//! from above and along the row alone are worse.

pub mod edges;
pub mod engine;
pub mod evidence;
pub mod kernels;
pub mod memory;
pub mod ordered;
pub mod panel_ranges;
pub mod paths;
mod penalties;
pub mod selection;
pub mod subpixel;
pub mod tasks;

use std::ops::Range;

use rayon::prelude::*;

use crate::base::control::Control;
use crate::base::error::{Error, Result};
use crate::base::memory::RunMemory;
use crate::base::plane::Plane;
use crate::base::simd::{Level, Loop, leveled};
use crate::base::value::{LANES, Lanes, Value};
pub use crate::choices::{BAND, LOOKAHEAD_ROWS, PANEL};
use crate::cost::Costs;
use crate::cost::aggregation::{Aggregator, PixelBlock, Window};
use crate::optimization::edges::Edges;
use crate::optimization::evidence::Evidence;
use crate::pair::candidates::Searched;
use crate::settings::Optimizer;

use self::ordered::Ordered;
pub use self::ordered::ROWS as ORDERED_ROWS;
use self::panel_ranges::PanelRanges;
use self::paths::{AdaptivePenalties, Horizontal, HorizontalPass, Panel, Smoothness, Vertical, VerticalPass};
pub use self::paths::{STRIDE, STRIP};
pub use self::penalties::{LARGEST_SUMMED_PENALTY, Penalties};
use self::selection::{PIXELS, Selection};

/// Columns to the right of a panel where its paths from the right start: one strip, which the next panel
/// reuses. Results depend on it through the means above.
pub const LOOKAHEAD_COLUMNS: usize = STRIP;
/// Strips of a panel and its look-ahead columns.
const STRIPS: usize = (PANEL + LOOKAHEAD_COLUMNS) / STRIP;

/// The rows that need more than the chosen candidates.
#[derive(Debug, Clone, Copy)]
pub enum Weighing {
    /// None.
    Nothing,
    /// The rows of the whole image for which this returns true.
    Sampled(fn(usize) -> bool),
    /// All.
    All,
}

/// The search for the best candidates of an image.
#[derive(Debug, Clone, Copy)]
pub struct CandidateSearch<'a> {
    /// Rows and columns of the image.
    pub size: (usize, usize),
    /// The first row of the image in the whole image: bands are those of the whole.
    pub first: usize,
    /// Candidates of each pixel.
    pub candidates: usize,
    /// The candidates that are searched along paths in each panel; `None`: all.
    pub ranges: Option<&'a PanelRanges>,
    /// The optimizer.
    pub optimizer: Optimizer,
    /// P1 and P2.
    pub penalties: Penalties,
    /// The jumps of the gray value that lower P2.
    pub edges: &'a Edges,
    /// The rows for which cost margins and sub-pixel offsets are needed.
    pub weighs: Weighing,
    /// Instructions to use.
    pub level: Level,
    /// Progress and cancellation.
    pub control: &'a Control,
}

/// A source of aggregated costs.
pub trait CostSource<T>: Sync {
    /// Writes the costs of a block into its places, the searched candidates of a pixel in neighboring lanes.
    fn write(
        &self,
        aggregator: &mut Aggregator<T>,
        block: (PixelBlock, Searched),
        out: &mut [Lanes<T>],
    ) -> Result<()>;
}

/// The aggregated costs of a pair.
#[derive(Clone, Copy)]
pub struct AggregatedCosts<'a> {
    /// Costs of single pixels.
    pub costs: &'a Costs<'a>,
    /// The window that they are summed over.
    pub window: Window,
    /// Instructions to use.
    pub level: Level,
}

impl<T: Value> CostSource<T> for AggregatedCosts<'_> {
    fn write(
        &self,
        aggregator: &mut Aggregator<T>,
        block: (PixelBlock, Searched),
        out: &mut [Lanes<T>],
    ) -> Result<()> {
        aggregator.aggregate(self.costs, self.window, block, self.level, out)
    }
}

/// Aggregated costs given by the caller: rows of `columns x candidates`.
#[derive(Debug, Clone, Copy)]
pub struct CostVolume<'a> {
    /// The costs.
    pub volume: &'a Plane<u32>,
    /// Candidates of each pixel.
    pub candidates: usize,
}

impl<T: Value> CostSource<T> for CostVolume<'_> {
    fn write(
        &self,
        _: &mut Aggregator<T>,
        (block, searched): (PixelBlock, Searched),
        out: &mut [Lanes<T>],
    ) -> Result<()> {
        let runs = searched.runs();

        for (row, y) in block.rows.clone().enumerate() {
            for (strip, columns) in block.strips().enumerate() {
                let costs = &self.volume.row(y)[columns.start * self.candidates..];
                let costs = costs.chunks_exact(self.candidates);
                let out = out[block.place(strip, row) * runs..].chunks_exact_mut(runs);

                for (out, costs) in out.take(columns.len()).zip(costs) {
                    let (out, filling) = out.as_flattened_mut().split_at_mut(searched.count);
                    let costs = &costs[searched.start..];
                    out.iter_mut().zip(costs).for_each(|(o, c)| *o = T::truncated((*c).into()));
                    filling.fill(T::FAR);
                }
            }
        }

        Ok(())
    }
}

/// The buffers of a band, reused from band to band.
#[derive(Debug)]
pub struct Workspace<T: Value> {
    aggregator: Aggregator<T>,
    /// Costs of the current panel and of its look-ahead columns.
    costs: RunMemory<T>,
    horizontal: Horizontal<T>,
    vertical: Vertical<T>,
    ordered: Ordered,
    selection: Selection<T>,
    evidence: Evidence,
}

impl<T: Value> Default for Workspace<T> {
    fn default() -> Self {
        Self {
            aggregator: Aggregator::default(),
            costs: RunMemory::default(),
            horizontal: Horizontal::default(),
            vertical: Vertical::default(),
            ordered: Ordered::default(),
            selection: Selection::default(),
            evidence: Evidence::default(),
        }
    }
}

/// Rows of a band of an image with `rows`. Without paths along columns, bands of half of [`BAND`] give the
/// same result. They are used because with many candidates a panel of all rows does not fit in the
/// second-level cache, and few bands leave threads idle.
pub fn band_height(optimizer: Optimizer, candidates: usize, rows: usize) -> usize {
    let is_along_rows = optimizer == Optimizer::ScanlineOptimization;
    if is_along_rows && (candidates > 128 || rows < 8 * BAND) { BAND / 2 } else { BAND }
}

impl CandidateSearch<'_> {
    /// The bands that contain some rows of the image, each clipped to these rows.
    pub fn bands(&self, rows: Range<usize>) -> impl Iterator<Item = Range<usize>> + use<> {
        let (height, first) = (band_height(self.optimizer, self.candidates, self.size.0), self.first);
        let mut start = rows.start;

        std::iter::from_fn(move || {
            // Bands end at multiples of their height in the whole image.
            let end = (((start + first) / height + 1) * height - first).min(rows.end);

            let band = start..end;
            start = end;

            (!band.is_empty()).then_some(band)
        })
    }

    /// All candidates.
    fn all(&self) -> Searched {
        Searched::all(self.candidates)
    }

    /// The candidates that are searched in a panel: in the band of row `y` of the image, from column `x` on.
    fn searched(&self, y: usize, x: usize) -> Searched {
        self.ranges.map_or(self.all(), |ranges| ranges.at(self.first + y, x))
    }

    /// Chooses candidates for some rows of one band; row 0 of the evidence is the first of these rows.
    pub fn choose<'w, T: Value>(
        &self,
        rows: Range<usize>,
        source: &impl CostSource<T>,
        workspace: &'w mut Workspace<T>,
    ) -> Result<&'w Evidence> {
        workspace.evidence.begin(rows.len(), self.size.1, self.is_weighed())?;

        match self.optimizer {
            Optimizer::DynamicProgramming => self.choose_in_order(rows, source, workspace)?,
            Optimizer::WinnerTakesAll => self.choose_singly(rows, source, workspace)?,
            Optimizer::ScanlineOptimization | Optimizer::SemiGlobal => {
                self.choose_along_paths(rows, source, workspace)?;
            }
        }

        Ok(&workspace.evidence)
    }

    /// Whether the evidence contains more than the chosen candidates.
    pub fn is_weighed(&self) -> bool {
        // The vertical pass selects and weighs at once.
        !matches!(self.weighs, Weighing::Nothing) || self.optimizer == Optimizer::SemiGlobal
    }

    /// Whether a row of the image is weighed.
    #[inline(always)]
    pub fn weighs(&self, y: usize) -> bool {
        match self.weighs {
            Weighing::Nothing => false,
            Weighing::Sampled(is_weighed) => is_weighed(self.first + y),
            Weighing::All => true,
        }
    }

    /// The panels of the image.
    fn panels(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let cols = self.size.1;
        (0..cols).step_by(PANEL).map(move |start| start..(start + PANEL).min(cols))
    }

    /// The rows whose costs the vertical paths of a band cross: those of the band and the look-ahead rows on
    /// either side.
    fn seen(&self, rows: &Range<usize>) -> Range<usize> {
        let band = (rows.start + self.first) / BAND * BAND;
        let start = band.saturating_sub(LOOKAHEAD_ROWS + self.first);
        let end = (band + BAND + LOOKAHEAD_ROWS - self.first).min(self.size.0);

        start..end
    }

    /// Chooses by totals of paths, panel by panel from the left.
    fn choose_along_paths<T: Value>(
        &self,
        rows: Range<usize>,
        source: &impl CostSource<T>,
        workspace: &mut Workspace<T>,
    ) -> Result<()> {
        let is_vertical = self.optimizer == Optimizer::SemiGlobal;
        let cols = self.size.1;
        // Vertical paths also need the costs of the look-ahead rows.
        let seen = if is_vertical { self.seen(&rows) } else { rows.clone() };
        let searched = |x: usize| self.searched(rows.start, x);
        let most = (0..cols).step_by(PANEL).map(|x| searched(x).runs()).max().unwrap_or_default();

        let Workspace { aggregator, costs, horizontal, vertical, selection, evidence, .. } = workspace;

        costs.resize(seen.len() * STRIPS * STRIDE * most)?;
        selection.begin(most)?;
        horizontal.begin(rows.len(), most)?;
        if is_vertical {
            vertical.begin(rows.len(), most)?;
        }

        let smoothness = Smoothness { penalties: AdaptivePenalties::new(self.penalties), edges: self.edges };
        // The look-ahead columns of a panel are the first strip of the next one, and keep their costs in the
        // ring.
        let (mut before, mut first) = (None, 0);

        for columns in self.panels() {
            self.control.checkpoint()?;

            let searched = searched(columns.start);
            if before != Some(searched) {
                horizontal.search(before, searched)?;
                if is_vertical {
                    vertical.search(searched)?;
                }
            }

            let end = (columns.end + LOOKAHEAD_COLUMNS).min(cols);
            let around = PixelBlock::new(seen.clone(), columns.start..end, STRIP);
            let around = around.in_ring(STRIPS, first);
            first += PANEL / STRIP;

            let is_known = before.replace(searched) == Some(searched);
            let unknown = around.without(if is_known { LOOKAHEAD_COLUMNS / STRIP } else { 0 });
            if !unknown.columns.is_empty() {
                source.write(aggregator, (unknown, searched), costs)?;
            }

            let block = PixelBlock::new(rows.clone(), columns, STRIP);
            let panel = &Panel { block, seen: around, costs, searched };

            self.level.run(HorizontalPass { horizontal, panel, smoothness });

            let means = horizontal.means();
            if is_vertical {
                self.level.run(VerticalPass { vertical, panel, means, smoothness, selection, evidence });
            } else {
                select_pixels(
                    self.level,
                    self,
                    (&panel.block, searched),
                    means,
                    Some((&panel.seen, panel.costs)),
                    selection,
                    evidence,
                );
            }
        }

        Ok(())
    }

    /// Chooses for each pixel by its own costs.
    fn choose_singly<T: Value>(
        &self,
        rows: Range<usize>,
        source: &impl CostSource<T>,
        workspace: &mut Workspace<T>,
    ) -> Result<()> {
        let Workspace { aggregator, costs, selection, evidence, .. } = workspace;

        let all = self.all();
        costs.resize(rows.len() * PANEL / STRIP * STRIDE * all.runs())?;
        selection.begin(all.runs())?;

        for columns in self.panels() {
            self.control.checkpoint()?;

            let block = &PixelBlock::new(rows.clone(), columns, STRIP);
            let totals = &mut costs[..block.places() * all.runs()];
            source.write(aggregator, (block.clone(), all), totals)?;
            select_pixels(self.level, self, (block, all), totals, None, selection, evidence);
        }

        Ok(())
    }

    /// Chooses for rows under the ordering constraint, [`ORDERED_ROWS`] at a time.
    fn choose_in_order<T: Value>(
        &self,
        rows: Range<usize>,
        source: &impl CostSource<T>,
        workspace: &mut Workspace<T>,
    ) -> Result<()> {
        let Workspace { aggregator, costs, ordered, selection, evidence, .. } = workspace;
        let (searched, cols) = (self.all(), self.size.1);
        selection.begin(searched.runs())?;

        for first in rows.clone().step_by(ORDERED_ROWS) {
            let group = first..(first + ORDERED_ROWS).min(rows.end);
            let block = &PixelBlock::new(group, 0..cols, STRIP);
            costs.resize(block.places() * searched.runs())?;

            // Strips follow one another, so those of each panel form a block of their own.
            let mut rest = &mut costs[..];
            for columns in self.panels() {
                self.control.checkpoint()?;
                let panel = PixelBlock::new(block.rows.clone(), columns, STRIP);
                let (here, others) = rest.split_at_mut(panel.places() * searched.runs());
                source.write(aggregator, (panel, searched), here)?;
                rest = others;
            }

            let runtime = (self.level, self.control);
            let chosen = ordered.choose((block, costs), self.candidates, self.penalties, runtime)?;
            self.level.run(WeighRows {
                search: self,
                block,
                row: first - rows.start,
                chosen,
                costs,
                selection,
                evidence,
            });
        }

        Ok(())
    }
}

/// The best candidates of a block of strips of [`STRIP`] columns, by totals of paths or by costs alone.
/// `costs`: the costs of a block that begins at the same pixel.
#[leveled]
fn select_pixels<T: Value>(
    level: Level,
    search: &CandidateSearch<'_>,
    block: (&PixelBlock, Searched),
    totals: &[Lanes<T>],
    costs: Option<(&PixelBlock, &[Lanes<T>])>,
    selection: &mut Selection<T>,
    evidence: &mut Evidence,
) {
    let (block, searched) = block;
    let runs = searched.runs();

    for (strip, columns) in block.strips().enumerate() {
        for row in 0..block.rows.len() {
            let pixels = columns.len();
            let totals = &totals[block.place(strip, row) * runs..][..pixels * runs];

            selection.find_least(totals, runs);
            selection.settle(totals, runs);

            if search.weighs(block.rows.start + row) {
                let costs =
                    costs.map(|(block, costs)| &costs[block.place(strip, row) * runs..][..pixels * runs]);
                selection.weigh(totals, costs, (searched.count, runs));
                selection.number_from(searched.start);
                selection.write(pixels, evidence, (row, columns.start));
            } else {
                selection.number_from(searched.start);
                evidence.choose(row, columns.start, selection.chosen(pixels));
            }
        }
    }
}

/// Cost margin and sub-pixel offset of the candidates chosen for a block of rows; the evidence begins at row
/// `row`.
struct WeighRows<'a, T> {
    search: &'a CandidateSearch<'a>,
    block: &'a PixelBlock,
    row: usize,
    chosen: &'a [u16],
    costs: &'a [Lanes<T>],
    selection: &'a mut Selection<T>,
    evidence: &'a mut Evidence,
}

impl<T: Value> Loop for WeighRows<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { search, block, row, chosen, costs, selection, evidence } = self;
        let (runs, candidates) = (search.all().runs(), search.candidates);

        for (index, chosen) in chosen.chunks_exact(block.columns.len()).enumerate() {
            let row = row + index;
            if !search.weighs(block.rows.start + index) {
                evidence.choose(row, 0, chosen);
                continue;
            }

            for (strip, chosen) in chosen.chunks(PIXELS).enumerate() {
                let costs = &costs[block.place(strip, index) * runs..][..chosen.len() * runs];
                for (pixel, chosen) in chosen.iter().enumerate() {
                    let k = usize::from(*chosen);
                    selection.choose(pixel, *chosen, costs[pixel * runs + k / LANES][k % LANES]);
                }

                selection.weigh(costs, None, (candidates, runs));
                selection.write(chosen.len(), evidence, (row, strip * PIXELS));
            }
        }
    }
}

/// The indices of the chosen candidates for a whole volume of aggregated costs, rows of `columns x
/// candidates`.
pub fn optimize(
    volume: &Plane<u32>,
    candidates: usize,
    optimizer: Optimizer,
    penalties: Penalties,
    level: Level,
    control: &Control,
) -> Result<Plane<u16>> {
    let size @ (rows, cols) = (volume.rows(), volume.cols() / candidates);
    // With costs and penalties up to this limit, totals fit in 32 bits.
    if let Some(cost) = volume.as_slice().iter().find(|cost| u64::from(**cost) > LARGEST_SUMMED_PENALTY) {
        return Err(Error::value("costs", cost, format!("costs up to {LARGEST_SUMMED_PENALTY}")));
    }

    let penalties = Penalties {
        p1: penalties.p1.min(LARGEST_SUMMED_PENALTY),
        p2: penalties.p2.min(LARGEST_SUMMED_PENALTY),
    };

    let (edges, weighs) = (&Edges::nowhere(cols)?, Weighing::Nothing);
    let search = CandidateSearch {
        size,
        first: 0,
        candidates,
        ranges: None,
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
