//! Two cameras that take one pair after another, and steadied video.

use crate::video::rig;
use crate::video::rig::text;
use crate::video::temporal::TemporalFilter;
use phasestereo_match::base::error::Result;

/// Facts about two cameras, learned from pair to pair, and, if requested, the temporal filter of their video.
#[derive(Debug)]
pub struct Rig {
    pub(super) state: rig::Rig,
    pub(super) filter: Option<TemporalFilter>,
    pub(super) reestimate: u64,
}

impl Rig {
    /// The default number of pairs after which blur is estimated again.
    pub const REESTIMATE: u64 = 30;

    /// A new rig without pairs; `steadied`: disparities are filtered over time where neither image changes.
    /// Blur is estimated again after at most `reestimate` pairs; 1: every pair is matched by itself.
    pub fn new(steadied: bool, reestimate: u64) -> Self {
        let filter = steadied.then(TemporalFilter::new);
        Self { state: rig::Rig::default(), filter, reestimate }
    }

    /// The rig with the facts from a text that [`Self::text`] wrote.
    pub fn with_text(self, written: &str) -> Result<Self> {
        Ok(Self { state: text::read(written)?, ..self })
    }

    /// The known facts about the cameras, as text, without a temporal filter.
    pub fn text(&self) -> Result<String> {
        text::written(&self.state)
    }

    /// Forgets all pairs.
    pub fn reset(&mut self) {
        *self = Self::new(self.filter.is_some(), self.reestimate);
    }
}
