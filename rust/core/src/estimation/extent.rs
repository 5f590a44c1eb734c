//! The run of disparities that a rough map holds: the shortest with nearly all of them, and what is frequent
//! next to it. Few disparities outside it are mistakes.

use phasestereo_match::base::plane::Plane;

/// Least share of the matches in the shortest range.
const CORE: f64 = 0.97;
/// A disparity next to the range belongs to it if it has at least this share of the matches.
pub const FEW: f64 = 0.001;
/// Disparities farther off than this share of the range's length are mistakes.
const NEXT: f64 = 0.12;

/// Least and largest disparity of a copy, both included.
pub type Span = (isize, isize);

/// The smallest and the largest disparity, without mistakes.
pub fn extent(disparity: &Plane<f32>) -> Option<Span> {
    let whole = |value: f32| value.round_ties_even() as isize;
    let lowest = whole(known(disparity).reduce(f32::min)?);
    let highest = whole(known(disparity).reduce(f32::max)?);

    let mut counts = vec![0usize; (highest - lowest + 1) as usize];
    known(disparity).for_each(|value| counts[(whole(value) - lowest) as usize] += 1);
    let total: usize = counts.iter().sum();

    let (mut first, mut last) = shortest(&counts, (CORE * total as f64).ceil() as usize);

    // The range grows while disparities within a step of its ends have enough matches.
    let is_likely = |count: usize| count as f64 >= (FEW * total as f64).max(2.0);
    loop {
        let step = ((NEXT * (last - first) as f64).round() as usize).max(2);

        let mut likely = (first.saturating_sub(step)..(last + step + 1).min(counts.len()))
            .filter(|at| is_likely(counts[*at]));
        let from = likely.next().unwrap_or(first);
        let to = likely.next_back().unwrap_or(last);

        let wider = (first.min(from), last.max(to));
        if wider == (first, last) {
            return Some((first as isize + lowest, last as isize + lowest));
        }
        (first, last) = wider;
    }
}

/// The first and the last index of the shortest run of counts whose sum is at least `enough`.
fn shortest(counts: &[usize], enough: usize) -> (usize, usize) {
    let mut best = (0, counts.len() - 1);
    let (mut start, mut sum) = (0, 0);

    // Each end has one best start, which only moves to the right: linear time.
    for (end, count) in counts.iter().enumerate() {
        sum += count;

        while start < end && sum - counts[start] >= enough {
            sum -= counts[start];
            start += 1;
        }

        if sum >= enough && end - start < best.1 - best.0 {
            best = (start, end);
        }
    }

    best
}

/// The finite disparities.
pub fn known(disparity: &Plane<f32>) -> impl Iterator<Item = f32> {
    disparity.as_slice().iter().copied().filter(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_run_holds_enough() {
        assert_eq!(shortest(&[1, 0, 5, 6, 0, 1], 11), (2, 3));
        assert_eq!(shortest(&[1, 0, 5, 6, 0, 1], 13), (0, 5));
        assert_eq!(shortest(&[4], 4), (0, 0));
    }
}
