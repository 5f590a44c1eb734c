//! The range of disparities over the frames of a video: a histogram of those that were found, which fades, with a reserve
//! beyond its ends.
//!
//! ```text
//! share[d] += (share of the pixels of this frame with disparity d - share[d]) / FADING
//! high = largest d that enough pixels have, in this frame or by the histogram
//! if fewer than half of the reserve are left beyond it:  search up to high + reserve
//! if more than all of them are left for long:            search up to high + reserve
//! ```
//!
//! Any isolated cluster that is large enough keeps the range as long as it is seen, and for a while. The near end alone moves
//! by itself, since things come nearer; how far away things are is seen when the range is estimated.

use std::ops::Range;

use phasestereo_match::base::error::Result;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::pair::candidates::Candidates;

/// One pixel of so many along each axis is counted.
const STEP: usize = 4;
/// Shares are counted in units of 2^-20.
const WHOLE: i64 = 1 << 20;
/// The frames over which the histogram fades, and the fewest of them before the range shrinks.
const FADING: i64 = 32;
const PATIENCE: u32 = 90;
/// A disparity that so many millionths of the pixels have is there: of this frame, and of the histogram.
const FEW: [i64; 2] = [4000, 2000];
/// Disparities beyond the largest one: the least number, and as a share of all. A lane of the match has 16.
const RESERVE: (i64, i64) = (6, 12);
/// So many more are cut off, if they were not needed for long.
const SPARE: i64 = 16;

/// The disparities that a rig has seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    /// Those that are searched, half-open.
    pub searched: Range<i64>,
    /// The share of each of the searched ones.
    shares: Vec<i64>,
    /// Frames in a row that needed less.
    idle: u32,
}

impl Columns {
    /// Nothing seen of these disparities yet.
    pub fn new(candidates: Candidates) -> Self {
        let (min, count) = (candidates.min() as i64, candidates.count());
        Self { searched: min..min + count as i64, shares: vec![0; count], idle: 0 }
    }

    /// The disparities to search in images of this width.
    pub fn candidates(&self, width: usize) -> Result<Candidates> {
        Candidates::new(self.searched.start, self.searched.end - self.searched.start, width)
    }

    /// Takes in the map of a frame. Returns whether the range has grown.
    pub fn update(&mut self, map: &Disparity, width: usize) -> bool {
        let counts = self.counts(map);
        let start = self.searched.start;
        let seen = |shares: &[i64], few: i64| {
            let few = few * WHOLE / 1_000_000;
            shares.iter().rposition(|share| *share >= few).map(|at| start + at as i64)
        };

        let now = self.fade(&counts);
        let last = seen(&now, FEW[0]);
        let high = last.max(seen(&self.shares, FEW[1])).unwrap_or(self.searched.end - 1);

        let reserve = RESERVE.0.max((high - self.searched.start) / RESERVE.1);
        let left = self.searched.end - 1 - high;
        let wanted = (high + 1 + reserve).min(self.searched.start + width as i64);
        if 2 * left < reserve && wanted > self.searched.end {
            self.searched.end = wanted;
            self.shares.resize((wanted - self.searched.start) as usize, 0);
            self.idle = 0;
            return true;
        }

        self.idle = if left > reserve + SPARE { self.idle + 1 } else { 0 };
        if self.idle > PATIENCE {
            self.searched.end = wanted;
            self.shares.truncate((wanted - self.searched.start) as usize);
            self.idle = 0;
        }
        false
    }

    /// Takes in the map of a frame of this range, which is given.
    pub fn watch(&mut self, given: Candidates, map: &Disparity) {
        let range = given.min() as i64..given.min() as i64 + given.count() as i64;
        if self.searched != range {
            *self = Self::new(given);
        }
        let counts = self.counts(map);
        self.fade(&counts);
    }

    /// Takes in numbers of pixels by disparity. Returns their shares.
    fn fade(&mut self, counts: &[i64]) -> Vec<i64> {
        let total: i64 = counts.iter().sum();
        let now: Vec<i64> = counts.iter().map(|count| count * WHOLE / total.max(1)).collect();
        for (share, now) in self.shares.iter_mut().zip(&now) {
            *share += (now - *share) / FADING;
        }
        now
    }

    /// How many disparities were searched beyond the nearest thing; `None`: nothing was seen.
    pub fn reserve(&self) -> Option<i64> {
        // Few frames have filled a part of the histogram only.
        let filled: i64 = self.shares.iter().sum();
        let last = self.shares.iter().rposition(|share| *share > FEW[1] * filled / 1_000_000)?;
        Some((self.shares.len() - 1 - last) as i64)
    }

    /// Numbers of pixels by disparity; those whose disparity is their own and passed all checks.
    fn counts(&self, map: &Disparity) -> Vec<i64> {
        let mut counts = vec![0; self.shares.len()];
        for y in (0..map.disparity.rows()).step_by(STEP) {
            let (values, flags) = (map.disparity.row(y), map.flags.row(y));
            for x in (0..values.len()).step_by(STEP).filter(|x| flags[*x] == 0) {
                let value = values[x];
                if value.is_finite() {
                    let at = value.round_ties_even() as i64 - self.searched.start;
                    if let Some(count) = usize::try_from(at).ok().and_then(|at| counts.get_mut(at))
                    {
                        *count += 1;
                    }
                }
            }
        }
        counts
    }

    /// Searches disparities up to, but without, this one.
    pub fn extend(&mut self, end: i64) {
        self.searched.end = end.max(self.searched.end);
        self.shares.resize((self.searched.end - self.searched.start) as usize, 0);
    }

    /// The shares of the searched disparities.
    pub fn shares(&self) -> &[i64] {
        &self.shares
    }

    /// Frames in a row that needed less.
    pub fn idle(&self) -> u32 {
        self.idle
    }

    /// A range as it was written down.
    pub fn of_numbers(start: i64, shares: Vec<i64>, idle: u32) -> Self {
        Self { searched: start..start + shares.len() as i64, shares, idle }
    }
}
