//! The range of disparities over the frames of a video: a fading histogram of those that were found, with a
//! reserve beyond its ends.
//!
//! ```text
//! share[d] += (share of the pixels of this frame with disparity d - share[d]) / FADING_FRAMES
//! high = largest d that enough pixels have, in this frame or by the histogram
//! if less than half of the reserve is left beyond it:  search up to high + reserve
//! if more than reserve + SPARE is left for long:       search up to high + reserve
//! ```
//!
//! Any isolated cluster that is large enough keeps the range while it is seen, and for a while after. Only
//! the near end moves by itself, since things come nearer; the far end moves only for things that entered
//! beyond it ([`Columns::include`]).

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::video::choices::{
    COUNTED_STEP, FADING_FRAMES, FEW_FADED, FEW_NOW, IDLE_FRAMES, LEAST_RESERVE, RESERVE_DIVISOR, SPARE,
};
use phasestereo_match::base::error::Result;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::MOST_DISPARITIES;

/// Shares are counted in units of 2^-20.
const WHOLE: i64 = 1 << 20;

/// The disparities that a rig has seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Columns {
    /// The searched disparities, half-open.
    pub searched: Range<i64>,
    /// The share of each of the searched ones.
    pub shares: Vec<i64>,
    /// Frames in a row that needed less.
    pub idle: u32,
}

impl Columns {
    /// These disparities, without any observation.
    pub fn new(candidates: Candidates) -> Self {
        let (min, count) = candidates.numbers();
        Self { searched: min..min + count, shares: vec![0; candidates.count()], idle: 0 }
    }

    /// The disparities to search in images of this width.
    pub fn candidates(&self, width: usize) -> Result<Candidates> {
        Candidates::new(self.searched.start, self.searched.end - self.searched.start, width)
    }

    /// Updates it with the map of a frame. Returns whether the range has grown.
    pub fn update(&mut self, map: &Disparity, width: usize) -> bool {
        let counts = self.counts(map);
        let start = self.searched.start;
        let seen = |shares: &[i64], few: i64| {
            let few = few * WHOLE / 1_000_000;
            shares.iter().rposition(|share| *share >= few).map(|at| start + at as i64)
        };

        let now = self.fade(&counts);
        let last = seen(&now, FEW_NOW);
        let high = last.max(seen(&self.shares, FEW_FADED)).unwrap_or(self.searched.end - 1);

        let reserve = LEAST_RESERVE.max((high - self.searched.start) / RESERVE_DIVISOR);
        let left = self.searched.end - 1 - high;
        let wanted = (high + 1 + reserve).min(self.searched.start + width.min(MOST_DISPARITIES) as i64);
        if 2 * left < reserve && wanted > self.searched.end {
            self.searched.end = wanted;
            self.shares.resize((wanted - self.searched.start) as usize, 0);
            self.idle = 0;
            return true;
        }

        self.idle = if left > reserve + SPARE { self.idle + 1 } else { 0 };
        if self.idle > IDLE_FRAMES {
            self.searched.end = wanted;
            self.shares.truncate((wanted - self.searched.start) as usize);
            self.idle = 0;
        }
        false
    }

    /// Updates it with the map of a frame whose range is given.
    pub fn watch(&mut self, given: Candidates, map: &Disparity) {
        let new = Self::new(given);
        if self.searched != new.searched {
            *self = new;
        }
        let counts = self.counts(map);
        self.fade(&counts);
    }

    /// Updates the shares with numbers of pixels by disparity. Returns those of this frame.
    fn fade(&mut self, counts: &[i64]) -> Vec<i64> {
        let total: i64 = counts.iter().sum();
        let now: Vec<i64> = counts.iter().map(|count| count * WHOLE / total.max(1)).collect();
        for (share, now) in self.shares.iter_mut().zip(&now) {
            *share += (now - *share) / FADING_FRAMES;
        }
        now
    }

    /// How many disparities were searched beyond the nearest thing; `None`: nothing was seen.
    pub fn reserve(&self) -> Option<i64> {
        // Few frames fill only a part of the histogram.
        let filled: i64 = self.shares.iter().sum();
        let last = self.shares.iter().rposition(|share| *share > FEW_FADED * filled / 1_000_000)?;
        Some((self.shares.len() - 1 - last) as i64)
    }

    /// Numbers of pixels by disparity, counting disparities of their own that passed all checks.
    fn counts(&self, map: &Disparity) -> Vec<i64> {
        let mut counts = vec![0; self.shares.len()];
        for y in (0..map.disparity.rows()).step_by(COUNTED_STEP) {
            let (values, flags) = (map.disparity.row(y), map.flags.row(y));
            for x in (0..values.len()).step_by(COUNTED_STEP).filter(|x| flags[*x] == 0) {
                let value = values[x];
                if value.is_finite() {
                    let at = value.round_ties_even() as i64 - self.searched.start;
                    if let Some(count) = usize::try_from(at).ok().and_then(|at| counts.get_mut(at)) {
                        *count += 1;
                    }
                }
            }
        }
        counts
    }

    /// Includes these disparities in the search, with a reserve. Returns whether the range has grown.
    pub fn include(&mut self, seen: Range<i64>, width: usize) -> bool {
        let Range { start, end } = self.searched;
        let reserve = LEAST_RESERVE.max((seen.end - seen.start.min(start)) / RESERVE_DIVISOR);
        let first = if seen.start < start { seen.start - reserve } else { start };
        let last = if seen.end > end { seen.end + reserve } else { end };
        let last = last.min(first + width.min(MOST_DISPARITIES) as i64);
        if first >= start && last <= end {
            return false;
        }

        let before = (start - first) as usize;
        self.shares.splice(0..0, std::iter::repeat_n(0, before));
        self.searched.start = first;
        self.extend(last);
        true
    }

    /// Extends the search up to, but excluding, this disparity.
    pub fn extend(&mut self, end: i64) {
        self.searched.end = end.max(self.searched.end);
        self.shares.resize((self.searched.end - self.searched.start) as usize, 0);
    }

    /// Whether frames can have produced its numbers.
    pub fn is_sound(&self, width: usize) -> bool {
        let Self { searched: Range { start, end }, shares, idle } = self;
        start.checked_add_unsigned(shares.len() as u64) == Some(*end)
            && shares.iter().all(|share| (0..=WHOLE).contains(share))
            && *idle <= IDLE_FRAMES
            && Candidates::new(*start, shares.len() as i64, width).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_entered_is_searched_from_then_on_with_a_reserve() -> Result<()> {
        let mut columns = Columns::new(Candidates::new(0, 64, 640)?);
        columns.shares[63] = 9;
        assert!(!columns.include(2..64, 640));
        assert!(columns.include(90..93, 640));
        assert_eq!((columns.searched.clone(), columns.shares[63]), (0..100, 9));
        assert!(columns.include(-5..-3, 640));
        assert_eq!((columns.searched.clone(), columns.shares[74]), (-11..100, 9));
        assert!(columns.is_sound(640));
        assert!(columns.include(300..700, 640));
        assert_eq!(columns.searched, -11..629);
        Ok(())
    }
}
