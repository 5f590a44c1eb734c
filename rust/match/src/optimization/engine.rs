//! The interface of devices that search instead of the core.
//!
//! An engine computes the same bits as the core, so a match may switch between the two at any chunk: if a
//! device does not support the settings, is lost, or runs out of memory, the core does its chunk.

use std::fmt::Debug;
use std::ops::Range;

use crate::base::error::Result;
use crate::optimization::evidence::Evidence;
use crate::optimization::memory::Width;
use crate::optimization::{AggregatedCosts, CandidateSearch};

/// Neighboring bands of a match, and how to search their candidates.
#[derive(Clone, Copy)]
pub struct Chunk<'a> {
    /// Penalties, edges, range, and the outputs needed besides the chosen candidates. Bands are those of
    /// [`CandidateSearch::bands`].
    pub search: &'a CandidateSearch<'a>,
    /// The window, and the costs of pixels or the codes whose distances they are
    /// ([`Costs::codes`](crate::cost::Costs::codes)).
    pub source: AggregatedCosts<'a>,
    /// The narrowest integers that hold all sums and totals.
    pub width: Width,
}

/// A device that chooses candidates.
///
/// ```
/// use std::ops::Range;
/// use std::sync::Arc;
///
/// use phasestereo_match::base::error::Result;
/// use phasestereo_match::matcher::Matcher;
/// use phasestereo_match::optimization::Workspace;
/// use phasestereo_match::optimization::engine::{Chunk, Engine};
/// use phasestereo_match::optimization::evidence::Evidence;
/// use phasestereo_match::optimization::memory::Width;
///
/// /// Searches by the core, band after band, where bytes hold every total and all rows are weighed.
/// #[derive(Debug)]
/// struct Bytes;
///
/// impl Engine for Bytes {
///     fn choose(&self, rows: Range<usize>, chunk: &Chunk, evidence: &mut Evidence) -> Result<bool> {
///         if chunk.width != Width::Bytes || !chunk.search.is_weighed() {
///             return Ok(false);
///         }
///         evidence.begin(rows.len(), chunk.search.size.1, chunk.search.is_weighed())?;
///         let mut workspace = Workspace::<u8>::default();
///         for band in chunk.search.bands(rows.clone()) {
///             let found = chunk.search.choose(band.clone(), &chunk.source, &mut workspace)?;
///             for (row, y) in band.enumerate() {
///                 evidence.set(y - rows.start, 0, found.row(row));
///             }
///         }
///         Ok(true)
///     }
/// }
///
/// let matcher = Matcher::new(2)?.with_engine(Arc::new(Bytes));
/// # Ok::<(), phasestereo_match::base::error::Error>(())
/// ```
pub trait Engine: Debug + Send + Sync {
    /// Chooses candidates for some rows of an image, bit for bit like [`CandidateSearch::choose`] in each of
    /// their bands; besides the chosen candidates only for weighed rows. Row 0 of the evidence is the first
    /// of these rows. `false`: the engine does not support the chunk, or failed, and the core searches it. An
    /// error means that the match was cancelled, or that the evidence does not fit in memory.
    fn choose(&self, rows: Range<usize>, chunk: &Chunk, evidence: &mut Evidence) -> Result<bool>;

    /// Why it no longer searches, for example a lost device. `None`: nothing failed.
    fn failure(&self) -> Option<String> {
        None
    }
}
