//! The bank: blurs to tell apart, by which image is the softer one and by the point-spread function.

use std::sync::OnceLock;

use super::fit::Response;
use super::spectrum::response;
use crate::estimation::blur::psf::{Family, Psf};
use phasestereo_match::base::simd::Level;

/// Which image is the softer one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

/// A point-spread function with the share of the power that it leaves in every bin.
#[derive(Debug, Clone)]
pub struct Entry {
    /// The function.
    pub psf: Psf,
    /// Its response.
    pub response: Response,
}

const SIGMAS: [f64; 7] = [1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 7.0];
const RADII: [f64; 7] = [2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
const LENGTHS: [f64; 9] = [5.0, 7.0, 9.0, 11.0, 13.0, 15.0, 18.0, 21.0, 25.0];
/// Step between the directions of motions, degrees.
const TURN: u8 = 15;
/// Outer radii of annuli, pixels, and inner ones as shares of these.
const OUTER: [f64; 6] = [3.0, 4.0, 5.0, 6.0, 8.0, 10.0];
const INNER: [f64; 2] = [0.5, 0.75];

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
        let round = |family: Family, sizes: &'static [f64]| {
            sizes.iter().map(move |size| Psf::round(family, *size))
        };

        // A motion of 180 degrees is that of 0.
        let motions = LENGTHS.iter().flat_map(|length| {
            let angles = (0..180u8).step_by(TURN.into());
            angles.map(move |angle| Psf::motion(*length, f64::from(angle)))
        });

        let annuli =
            OUTER.iter().flat_map(|radius| INNER.map(|inner| Psf::annulus(*radius, inner)));

        let rounds = round(Family::Gaussian, &SIGMAS).chain(round(Family::Disk, &RADII));
        let all = rounds.chain(motions).chain(annuli);
        all.map(|psf| Entry::new(psf, Level::best())).collect()
    })
}

/// A few entries of the bank. A blur that explains blocks better than these would be explained better by one of them,
/// too, if by less.
pub fn probes() -> impl Iterator<Item = &'static Entry> {
    bank().iter().filter(|Entry { psf, .. }| match psf.family {
        Family::Gaussian => false,
        Family::Disk => [2.0, 4.0, 8.0].contains(&psf.size),
        Family::Motion => [5.0, 9.0, 15.0].contains(&psf.size) && psf.angle % 30.0 == 0.0,
        Family::Annulus => [4.0, 6.0].contains(&psf.size),
    })
}

impl Side {
    /// Its index: 0 left, 1 right.
    pub fn index(self) -> usize {
        self as usize
    }
}
