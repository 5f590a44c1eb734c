//! The integers of the search for candidates, and its margins and memory.

use crate::base::value::{LANES, Value};
use crate::cost::aggregation::Window;
use crate::cost::{ceiling_of, steps_of};
use crate::optimization::{
    BAND, LOOKAHEAD_COLUMNS, LOOKAHEAD_ROWS, ORDERED_ROWS, PANEL, Penalties, STRIDE, STRIP, band_height,
};
use crate::pair::plan::{Bytes, Demand, Plan, Stage};
use crate::settings::{Optimizer, Settings};

/// Bytes of a pixel of the evidence: chosen candidate, two costs, offset.
const EVIDENCE_BYTES: usize = 14;
/// Bytes of a pixel of the map: disparity, flags, support.
const MAP_BYTES: usize = 10;

/// The integers that store costs and totals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Width {
    /// Of 8 bits.
    Bytes,
    /// Of 16 bits.
    Words,
    /// Of 32 bits.
    Widest,
}

impl Width {
    /// The narrowest integers that hold every sum, every total of a path and the number of every run of
    /// candidates.
    pub fn new(settings: &Settings, window: Window, penalties: Penalties, has_masks: bool) -> Self {
        let largest_cost = window.largest_value(has_masks);
        // Only paths accumulate totals beyond the cost of a window.
        let largest_total = match settings.optimizer {
            Optimizer::ScanlineOptimization | Optimizer::SemiGlobal => {
                penalties.largest_total(window.largest_sum())
            }
            Optimizer::DynamicProgramming | Optimizer::WinnerTakesAll => 0,
        };

        let largest = largest_cost.max(largest_total);

        if largest <= u8::LARGEST_TOTAL {
            Self::Bytes
        } else if largest <= u16::LARGEST_TOTAL {
            Self::Words
        } else {
            Self::Widest
        }
    }

    /// Bytes of one integer.
    pub fn bytes(self) -> usize {
        match self {
            Self::Bytes => 1,
            Self::Words => 2,
            Self::Widest => 4,
        }
    }
}

/// The search for candidates.
pub struct Search;

impl Stage for Search {
    fn reach(&self, plan: Plan) -> usize {
        match plan.settings.optimizer {
            // The rows of a band are chosen together, and their vertical paths start some rows beyond the
            // band.
            Optimizer::SemiGlobal => BAND - 1 + LOOKAHEAD_ROWS,
            _ => 0,
        }
    }

    fn bytes(&self, demand: &Demand) -> Bytes {
        Bytes { read: 0, mapped: MAP_BYTES * demand.cols, thread: workspace(demand) }
    }
}

/// Bytes of the [`Workspace`](crate::optimization::Workspace) that one thread searches in.
pub fn workspace(demand: &Demand) -> usize {
    let Demand { plan: Plan { settings, .. }, cols, candidates, .. } = *demand;
    let ceiling = ceiling_of(settings);
    let window = Window::new((BAND, cols), candidates, settings, ceiling);
    let penalties = Penalties::new(settings, window, steps_of(settings));
    let runs = candidates.div_ceil(LANES);

    // Rows and columns of the costs, and totals of paths: half their sums, those from below and from the
    // left.
    let seen = PANEL + LOOKAHEAD_COLUMNS;
    let places = |columns: usize| columns.div_ceil(STRIP) * STRIDE;
    // Lower images have bands of this height at most.
    let band = band_height(settings.optimizer, candidates, usize::MAX);
    let (rows, cols, totals) = match settings.optimizer {
        Optimizer::SemiGlobal => {
            (BAND + 2 * LOOKAHEAD_ROWS, seen, (BAND * (1 + places(PANEL) + STRIP)) * runs)
        }
        Optimizer::ScanlineOptimization => (band, seen, band * (1 + places(PANEL)) * runs),
        Optimizer::WinnerTakesAll => (BAND, PANEL, 0),
        // It works on whole rows, the other optimizers on panels of columns.
        Optimizer::DynamicProgramming => (ORDERED_ROWS, cols, 0),
    };

    let is_whole = settings.optimizer == Optimizer::DynamicProgramming;
    let around = seen + 2 * window.halo();

    // For a line of candidates: costs and votes of the rows of a window and of the one that has left it,
    // their sums, and sums of windows.
    let summed = 2 * (window.side + 2) * around + (window.side + 1) * around;

    // The paths themselves, along rows and along columns, at two pixels each, and the sums of a row.
    let paths = 2 * 2 * STRIP * (runs + 2) + STRIP * runs;

    let lanes = rows * places(cols) * runs + totals + paths + 2 * summed;

    let width = Width::new(settings, window, penalties, true).bytes();
    // The origins of the totals of all rows, and the totals of a pixel.
    let origins = ORDERED_ROWS * (cols * candidates + 8 * (candidates + 1));
    let origins = if is_whole { origins } else { 0 };

    width * LANES * lanes + origins + BAND * cols * EVIDENCE_BYTES
}
