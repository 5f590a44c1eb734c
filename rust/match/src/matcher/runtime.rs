//! The matcher, threads and control that estimations and a whole match use.

use crate::base::control::Control;
use crate::base::simd::Level;
use crate::matcher::{Execution, Matcher};

/// The matcher, its threads and instructions, and the control that may stop it.
#[derive(Clone, Copy)]
pub struct Runtime<'a> {
    /// The matcher for rough matches; all work is done on its threads.
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
