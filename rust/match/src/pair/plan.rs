//! The inputs that determine the margins and memory of a match, and how each stage reports its own.

use crate::pair::alignment::Alignment;
use crate::pair::blur_compensation::BlurCompensation;
use crate::settings::Settings;

/// How a pair is to be matched.
#[derive(Debug, Clone, Copy)]
pub struct Plan<'a> {
    /// Checked settings.
    pub settings: &'a Settings,
    /// How blur is compensated before pixels are compared.
    pub compensation: Option<&'a BlurCompensation>,
    /// The field by which the right image is straightened.
    pub alignment: Option<&'a Alignment>,
}

/// The match whose memory is estimated.
#[derive(Debug, Clone, Copy)]
pub struct Demand<'a> {
    /// How the pair is matched.
    pub plan: Plan<'a>,
    /// Columns of the images.
    pub cols: usize,
    /// Disparities to search.
    pub candidates: usize,
    /// Bytes of a pixel of one image, all channels together.
    pub pixel: usize,
    /// Threads.
    pub threads: usize,
}

/// Bytes that a stage takes while it runs.
#[derive(Debug, Clone, Copy, Default)]
pub struct Bytes {
    /// For each row of the images that is read.
    pub read: usize,
    /// For each row of the map.
    pub mapped: usize,
    /// For each thread.
    pub thread: usize,
}

/// A stage of the match. If the plan skips it, it reads and takes nothing.
pub trait Stage: Sync {
    /// Rows of its input on either side of a row of its result that it reads.
    fn reach(&self, _: Plan) -> usize {
        0
    }

    /// Its memory.
    fn bytes(&self, _: &Demand) -> Bytes {
        Bytes::default()
    }
}

impl Bytes {
    /// The bytes of two stages that run at the same time.
    pub fn and(self, other: Self) -> Self {
        Self {
            read: self.read + other.read,
            mapped: self.mapped + other.mapped,
            thread: self.thread + other.thread,
        }
    }
}
