//! The candidates that are searched in each panel of each band, narrowed by a match of a smaller copy.
//!
//! A panel is matched as if all other candidates cost more than any, in its look-ahead, too. So it depends on
//! other panels only through its paths from the left. At a panel's first pixel, a path comes from a candidate
//! that both panels have, by a step, or by a jump from the smallest total of all previous ones.

use std::ops::Range;

use crate::choices::{BAND, PANEL};
use crate::pair::candidates::Searched;

/// The candidates of all panels of a whole image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PanelRanges {
    /// Panels of a band.
    panels: usize,
    /// The candidates of each panel, band after band.
    searched: Vec<Searched>,
}

impl PanelRanges {
    /// Calls `searched` with the rows and columns of each panel of an image of this size for its candidates.
    pub fn new((rows, cols): (usize, usize), searched: impl Fn([Range<usize>; 2]) -> Searched) -> Self {
        let bands = (0..rows).step_by(BAND).map(|y| y..(y + BAND).min(rows));
        let panel = |x: usize| x..(x + PANEL).min(cols);
        let of_band = |rows: Range<usize>| {
            let panels = (0..cols).step_by(PANEL);
            panels.map(|x| searched([rows.clone(), panel(x)])).collect::<Vec<_>>()
        };

        Self { panels: cols.div_ceil(PANEL), searched: bands.flat_map(of_band).collect() }
    }

    /// The candidates of the panel that contains row `y` and column `x` of the whole image.
    pub fn at(&self, y: usize, x: usize) -> Searched {
        self.searched[y / BAND * self.panels + x / PANEL]
    }
}
