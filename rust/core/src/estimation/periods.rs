//! Texture that repeats over much of an image, such as fences, tiles and bricks: several disparities fit
//! alike.
//!
//! Blocks all over the image are compared with the other image at every disparity that they see, by the codes
//! of their pixels.
//!
//! ```text
//! sum(d)     = bits in which the codes of a block and of the other image at d differ
//! own        = the least of them
//! chance     = their median; a block is judged if chance - own is at least CLEAR
//! d fits     : sum(d) <= own + (chance - own) / 4
//! ambiguous  = several d fit, between which sum rises above half of that way: not those of one edge
//! repeated   : one in AMBIGUOUS of the judged blocks is ambiguous
//! period     = d at which ambiguous blocks fit: one in FITTING of the judged ones that see d
//! ```
//!
//! Such texture does not show which of the periods is the true one. All are searched, of both signs: then
//! several fit every pixel, so it is not trusted.

use std::ops::Range;

use super::areas::{BLOCK, Blocks, SAMPLED, Voters, codes_of, median, vote};
use super::extent::Span;
use super::overview::Overview;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::around;
use phasestereo_match::cost::phase::ByteDistances;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::candidates::Candidates;

/// Bits by which a block must match better than by chance to be judged: about a third of the difference of
/// unlike ones.
const CLEAR: usize = 40;
/// One in this many judged blocks must be ambiguous. Of 20 pairs without such walls, 2 to 37 % of the blocks
/// are, with noise of 5 gray levels 10 to 49 %; of walls, all.
const AMBIGUOUS: usize = 2;
/// A period must fit one in this many judged blocks that see it: fewer than all, since whole disparities of
/// copies may miss it.
const FITTING: usize = 3;
/// Fewest judged blocks, ...
const LEAST_JUDGED: usize = SAMPLED / 4;
/// ... and fewest that see a disparity.
const LEAST_SEEING: usize = SAMPLED / 8;
/// Periods below zero to search: with two, pixels at the left border also see several.
const BELOW: usize = 2;

/// How often a disparity was seen, and fitted an ambiguous block.
#[derive(Debug, Clone, Copy, Default)]
struct Count {
    seen: usize,
    fits: usize,
}

/// The least and largest disparity of copies at which their texture repeats; `None`: it does not.
pub fn periods(copies: &Overview, field: Option<&Alignment>, runtime: Runtime) -> Result<Option<Span>> {
    let codes = codes_of(copies, field, runtime)?;
    let [left, right] = &codes;
    let (rows, cols) = left.size();
    let tried = Candidates::of_span(copies.widest(), cols)?;
    let costs = ByteDistances::new([left, right], tried)?;
    let voters = Voters { doubtful: &copies.valid, by: 1, rows, cols };

    let mut counts = vec![Count::default(); tried.count()];
    let (mut judged, mut ambiguous) = (0, 0);
    for block in Blocks::sampled(rows, cols).places() {
        runtime.control.checkpoint()?;
        let sums = vote(runtime.level(), &costs, voters, block);
        let seen = seen(tried, block.1..(block.1 + BLOCK).min(cols), cols);
        let Some(fits) = sums.as_flattened().get(seen.clone()).and_then(fitting) else { continue };

        judged += 1;
        ambiguous += usize::from(fits.contains(&true));
        for (at, count) in counts[seen].iter_mut().enumerate() {
            count.seen += 1;
            // Blocks at slightly different disparities have the same period.
            count.fits += usize::from(fits[around(at, 1, fits.len())].contains(&true));
        }
    }

    let is_repeated = judged >= LEAST_JUDGED && ambiguous * AMBIGUOUS >= judged;
    Ok(is_repeated.then(|| extent(&counts, tried)).flatten())
}

/// The candidates seen by all these columns.
fn seen(tried: Candidates, columns: Range<usize>, cols: usize) -> Range<usize> {
    // Column x sees x + 1 - cols to x.
    tried.index(columns.end as isize - cols as isize)..tried.index(columns.start as isize + 1)
}

/// Where the sums of a block are nearly as small as the least one, if there are several such places; `None`:
/// nothing is clear.
fn fitting(sums: &[u8]) -> Option<Vec<bool>> {
    let own = usize::from(sums.iter().copied().min()?);
    let rise = median(sums.iter().copied()).checked_sub(own).filter(|rise| *rise >= CLEAR)?;

    let (mut fits, mut places, mut is_apart) = (vec![false; sums.len()], 0, true);
    for (fits, sum) in fits.iter_mut().zip(sums) {
        let above = usize::from(*sum) - own;
        *fits = 4 * above <= rise;
        places += usize::from(*fits && is_apart);
        is_apart = 2 * above > rise || is_apart && !*fits;
    }
    if places < 2 {
        fits.fill(false);
    }
    Some(fits)
}

/// The ends of the periods: all from zero up, and the first ones below zero.
fn extent(counts: &[Count], tried: Candidates) -> Option<Span> {
    let is_one = |count: &Count| count.seen >= LEAST_SEEING && count.fits * FITTING >= count.seen;
    let periods: Vec<isize> =
        (0..counts.len()).filter(|k| is_one(&counts[*k])).map(|k| tried.disparity(k)).collect();
    let (first, last) = (*periods.first()?, *periods.last()?);

    let below = periods.partition_point(|disparity| *disparity < 0);
    // The first disparity of each period.
    let starts = (0..below).rev().filter(|at| *at == 0 || periods[at - 1] < periods[*at] - 1);
    let low = starts.take(BELOW).last().map_or(first, |at| periods[at]);
    Some((low, last))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_is_ambiguous_where_several_disparities_fit_apart() {
        let sums = |fitting: &[usize]| -> Vec<u8> {
            (0..40).map(|k| if fitting.contains(&k) { 30 } else { 130 }).collect()
        };
        let places = |sums: &[u8]| -> Option<Vec<usize>> {
            let fits = fitting(sums)?;
            Some((0..fits.len()).filter(|k| fits[*k]).collect())
        };
        assert_eq!(places(&sums(&[9])), Some(vec![]));
        assert_eq!(places(&sums(&[9, 10, 11])), Some(vec![]));
        assert_eq!(places(&sums(&[9, 20, 31])), Some(vec![9, 20, 31]));
        // A slope between them belongs to one edge.
        let mut edge = sums(&[9, 12]);
        edge[10..12].fill(60);
        assert_eq!(places(&edge), Some(vec![]));
        assert_eq!(places(&[100; 40]), None);
    }

    #[test]
    fn the_first_periods_below_zero_and_all_above_it_are_searched() -> Result<()> {
        let tried = Candidates::new(-100, 201, 640)?;
        let of = |periods: &[isize]| {
            let count = |k| {
                let fits = if periods.contains(&tried.disparity(k)) { 10 } else { 2 };
                Count { seen: if k < 190 { 30 } else { 5 }, fits }
            };
            extent(&(0..tried.count()).map(count).collect::<Vec<_>>(), tried)
        };
        assert_eq!(of(&[-70, -50, -49, -30, -10, 10, 30, 50, 95]), Some((-30, 50)));
        assert_eq!(of(&[-60, -59, -39, -38, -18]), Some((-39, -18)));
        assert_eq!(of(&[20, 40]), Some((20, 40)));
        assert_eq!(of(&[]), None);
        Ok(())
    }

    #[test]
    fn disparities_are_seen_by_blocks_that_lie_in_the_other_image_with_all_columns() -> Result<()> {
        let tried = Candidates::new(-60, 100, 100)?;
        assert_eq!(seen(tried, 8..16, 100), 0..69);
        assert_eq!(seen(tried, 92..100, 100), 60..100);
        Ok(())
    }
}
