//! Rows of a pair that are matched by themselves.
//!
//! Nothing that a match computes depends on which other rows are requested. So rows equal those of the whole
//! pair if the part contains their halo: [`crate::matcher::halo::Halo::rows`] on either side, as far as the
//! image extends.

use std::ops::Range;

use crate::base::error::{Error, Result};
use crate::image::texture::Roughness;
use crate::optimization::panel_ranges::PanelRanges;
use crate::pair::Pair;
use crate::refinement::calibration::Tally;

/// Rows of a pair that are matched by themselves, with data about the whole pair that this one is a part of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Section {
    /// The rows.
    pub rows: Range<usize>,
    /// The row of the whole pair that is the first row of this one.
    pub first: usize,
    /// The roughness of the whole left image; `None`: the pair is the whole.
    pub roughness: Option<Roughness>,
    /// The candidates that are searched along paths in each panel of the whole pair; `None`: all.
    pub ranges: Option<PanelRanges>,
    /// Sums over the whole map that its confidences depend on; `None`: the pair is the whole.
    pub tally: Option<Tally>,
}

impl Section {
    /// All rows of a whole pair.
    pub fn whole(pair: &Pair) -> Self {
        Self { rows: 0..pair.size().0, first: 0, roughness: None, ranges: None, tally: None }
    }

    /// Refuses rows that are outside the pair.
    pub fn check(&self, pair: &Pair) -> Result<()> {
        let Range { start, end } = self.rows.clone();
        let height = pair.size().0;

        if start < end && end <= height {
            return Ok(());
        }

        let accepts = format!("rows within 0..{height}");
        Err(Error::value("rows", format!("{start}..{end}"), accepts))
    }
}
