//! The memory model: an upper bound of the bytes that a match takes. Out-of-core matching plans its bands by
//! it.
//!
//! Each stage reports the bytes that grow with the rows (images, descriptions, maps) and those of each
//! thread. A match takes 67 to 99 % of the bound, 39 % with synthesis; `tests/rust/footprint.rs` measures it
//! for each kind.

use crate::cost::{Description, Descriptions};
use crate::matcher::halo::Halo;
use crate::optimization::edges::TextureAndEdges;
use crate::optimization::memory::Search;
use crate::pair::Images;
use crate::pair::plan::{Bytes, Demand, Stage};
use crate::refinement::Refinement;

/// The stages whose memory exists at the same time, one phase of the match after another.
const PHASES: [&[&dyn Stage]; 3] =
    [&[&Images, &Description], &[&Images, &Descriptions, &TextureAndEdges, &Search], &[&Images, &Refinement]];

/// An upper bound of the bytes that a match of `rows`, including their halo, takes; `u64::MAX` if it is
/// larger.
pub fn bytes(demand: &Demand, rows: usize) -> u64 {
    let halo = Halo::new(demand.plan);
    let read = rows + 2 * (halo.rows() + halo.masked);
    let mapped = rows + 2 * halo.map;

    let phases = PHASES
        .map(|stages| stages.iter().map(|stage| stage.bytes(demand)).fold(Bytes::default(), Bytes::and));
    // The phases follow one another, so the largest one counts. Threads keep their buffers.
    let pixels = phases.iter().map(|phase| times(read, phase.read) + times(mapped, phase.mapped));
    let thread = phases.iter().map(|phase| phase.thread).sum();

    let bytes = pixels.max().unwrap_or_default() + times(demand.threads, thread);
    u64::try_from(bytes).unwrap_or(u64::MAX)
}

/// A product that may exceed the size of memory.
fn times(count: usize, bytes: usize) -> u128 {
    count as u128 * bytes as u128
}
