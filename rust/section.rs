//! Rows of a pair that are matched by themselves.

use std::ops::Range;

use crate::error::{Error, Result};
use crate::matcher::Pair;
use crate::semiglobal::BAND;
use crate::settings::{Optimizer, Settings};
use crate::texture::Roughness;

/// Rows of a pair that are matched by themselves, and what else is known of the whole one that the pair is a part of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Section {
    /// The rows. With [`Optimizer::SemiGlobal`] they begin with a band, and so must the pair.
    pub rows: Range<usize>,
    /// The roughness of the whole left image; `None`: the pair is the whole.
    pub roughness: Option<Roughness>,
    /// Where the paths through the rows above have come to; `None`: they begin here.
    pub paths: Option<Vec<u8>>,
    /// Whether it is to be told where the paths through these rows come to.
    pub is_handed_on: bool,
}

impl Section {
    /// All rows.
    pub fn whole(pair: &Pair) -> Self {
        Self { rows: 0..pair.size().0, roughness: None, paths: None, is_handed_on: false }
    }

    /// Refuses rows that the pair has not.
    pub fn check(&self, pair: &Pair, settings: &Settings) -> Result<()> {
        let (Range { start, end }, height) = (self.rows.clone(), pair.size().0);
        let is_band = settings.optimizer != Optimizer::SemiGlobal || start % BAND == 0;
        if start < end && end <= height && is_band {
            return Ok(());
        }
        let accepts = format!("rows within 0..{height}, in whole bands with optimizer = 'sgm'");
        Err(Error::value("rows", format!("{start}..{end}"), accepts))
    }
}
