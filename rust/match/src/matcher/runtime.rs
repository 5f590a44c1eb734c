//! The matcher, threads and control of an estimation and a whole match.

use crate::base::control::Control;
use crate::base::simd::Level;
use crate::matcher::{Execution, Matcher};

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

impl Runtime<'_> {
    /// The instructions.
    pub fn level(&self) -> Level {
        self.execution.level
    }
}
