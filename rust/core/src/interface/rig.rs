//! Two cameras that take one pair after another, and a video that is steadied.

use crate::video::rig;
use crate::video::rig::text;
use crate::video::temporal::TemporalFilter;
use phasestereo_match::base::error::Result;

/// What two cameras are, learned from pair to pair, and, if it is wanted, the temporal filter of their video.
#[derive(Debug)]
pub struct Rig {
    pub(super) state: rig::Rig,
    pub(super) filter: Option<TemporalFilter>,
    pub(super) reestimate: u64,
}

impl Rig {
    /// The usual number of pairs after which blur is estimated anew.
    pub const REESTIMATE: u64 = 30;

    /// A rig that has seen nothing; `steadied`: disparities are filtered over time where neither image
    /// changes. After `reestimate` pairs blur is estimated anew at the latest; 1: every pair is matched by
    /// itself.
    pub fn new(steadied: bool, reestimate: u64) -> Self {
        let filter = steadied.then(TemporalFilter::new);
        Self { state: rig::Rig::default(), filter, reestimate }
    }

    /// The rig with what a text says that [`Self::text`] wrote.
    pub fn with_text(self, written: &str) -> Result<Self> {
        Ok(Self { state: text::read(written)?, ..self })
    }

    /// What is known of the cameras, as text; a temporal filter is left out.
    pub fn text(&self) -> Result<String> {
        text::written(&self.state)
    }

    /// Forgets all pairs.
    pub fn reset(&mut self) {
        *self = Self::new(self.filter.is_some(), self.reestimate);
    }
}
