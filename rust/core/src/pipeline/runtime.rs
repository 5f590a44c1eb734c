//! What an estimation and a whole match are carried out with.

use crate::error::Result;
use crate::pipeline::control::Control;
use crate::pipeline::matcher::{Execution, Matcher};

/// The matcher, how it works, and what may end it.
#[derive(Clone, Copy)]
pub struct Runtime<'a> {
    /// The matcher for rough matches, on whose threads all work is done.
    pub matcher: &'a Matcher,
    /// Threads and instructions.
    pub execution: Execution,
    /// Cancellation.
    pub control: &'a Control,
}

/// Does the same for the left image and for the right one, at the same time: side 0 and 1. Two threads wait for one another
/// less often than if they shared the work on each.
pub fn both<T: Send>(of: impl Fn(usize) -> Result<T> + Sync) -> Result<[T; 2]> {
    let (left, right) = rayon::join(|| of(0), || of(1));
    Ok([left?, right?])
}
