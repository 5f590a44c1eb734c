//! The bank: candidate blurs, by softer image and point-spread function.

use std::sync::OnceLock;

use super::psf::{Family, Psf};
use super::response::{Response, response};
use phasestereo_match::base::simd::Level;
use phasestereo_match::named;

named! {
    /// Which image is the softer one.
    pub enum Side {
        /// The left one.
        Left = "left",
        /// The right one.
        Right = "right",
    }
}

/// A point-spread function with the share of the power that it leaves in every bin.
#[derive(Debug, Clone)]
pub struct Entry {
    /// The function.
    pub psf: Psf,
    /// Its response.
    pub response: Response,
}

impl Entry {
    /// The entry of a function.
    pub fn new(psf: Psf, level: Level) -> Self {
        Self { psf, response: response(&psf.taps(), level) }
    }
}

/// A coarse selection from all families; `refine` finds the sizes and directions between them.
pub fn bank() -> &'static [Entry] {
    static BANK: OnceLock<Vec<Entry>> = OnceLock::new();
    BANK.get_or_init(|| {
        let all = Family::all().flat_map(Family::members);
        all.map(|psf| Entry::new(psf, Level::best())).collect()
    })
}

/// A few entries of the bank. If some other blur explains blocks better, one of these does, too, if by less.
pub fn probes() -> &'static [&'static Entry] {
    static PROBES: OnceLock<Vec<&Entry>> = OnceLock::new();
    PROBES.get_or_init(|| {
        let is_probe = |entry: &&Entry| entry.psf.family.probes().any(|psf| psf == entry.psf);
        bank().iter().filter(is_probe).collect()
    })
}

impl Side {
    /// Its index: 0 left, 1 right.
    pub fn index(self) -> usize {
        self as usize
    }

    /// The other image.
    pub fn other(self) -> Self {
        Self::ALL[1 - self.index()]
    }
}
