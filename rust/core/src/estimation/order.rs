//! Whether the left image comes from the left camera. The sign of the disparities does not show it: cropped
//! images and toed-in cameras have negative ones, too. Two other signs do, independent of each other.
//!
//! ```text
//! ground = rank correlation of row and disparity      # the ground is below, and nearer the lower it appears
//! sides  = (votes for "in place" - votes for "exchanged") / votes          # of half-seen strips
//!
//! in place:  ground >= .3 and sides >= -.1, or sides >= .25 and ground >= -.2
//! exchanged: the same with ground and sides negated
//! ```
//!
//! A half-seen strip has no disparity, since only one camera sees it: its width is the difference between the
//! disparities beside it. It belongs to the far surface, and lies to the left of the near object in the image
//! of the left camera, to its right in that of the right one. So each strip has two votes: which end has the
//! stronger edge, that of the near object; and which side has similar gray values, that of the far surface.

use super::overview::{Overview, RoughMap};

/// Signs of the order that are clear by themselves: see the start of this file. All thresholds of .2 to .5
/// and .15 to .35 gave no wrong answer in 327 pairs, both ways each.
const CLEAR: (f64, f64) = (0.3, 0.25);
/// ... and contradicting values of the other sign that they tolerate.
const BORNE: (f64, f64) = (0.2, 0.1);
/// Fewest votes of strips that count: 30 pairs of 256 columns have 29 to 1105.
const LEAST_VOTES: usize = 20;
/// Least share of the pixels with a disparity that shows the order.
const LEAST_KNOWN: f64 = 0.25;
/// Least width of a strip, pixels of the copy; and the share of its width by which the jump of the
/// disparities may differ from it.
const LEAST_STRIP: f32 = 2.0;
const UNLIKE: f32 = 0.5;
/// Pixels on either side of a strip's end that show its edge and its gray value.
const BESIDE: usize = 3;
/// Least ratio of two gray differences that is clear.
const TIMES: f32 = 1.5;

/// Whether the left image comes from the left camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// It does.
    InPlace,
    /// It comes from the right one.
    Exchanged,
    /// The images do not show it.
    Unknown,
}

/// The evidence in the images about the order of the cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Signs {
    /// Rank correlation of row and disparity.
    pub ground: f64,
    /// Votes of half-seen strips for "in place" minus those for "exchanged", as a share of all; 0 if there
    /// are few.
    pub sides: f64,
    /// Whether enough pixels have a disparity.
    pub is_seen: bool,
}

impl Signs {
    /// No signs.
    pub const NONE: Self = Self { ground: 0.0, sides: 0.0, is_seen: false };

    /// The signs in a rough match of some copies, which may be turned: then the columns are the rows of the
    /// original images ([`Pair::turned`](phasestereo_match::pair::Pair::turned)).
    pub fn new(copies: &Overview, map: &RoughMap, is_turned: bool) -> Self {
        let known = map.disparity.as_slice().iter().filter(|value| value.is_finite()).count();
        let votes = votes(copies, map);
        let [in_place, exchanged] = votes.map(|count| count as f64);
        let is_few = votes[0] + votes[1] < LEAST_VOTES;

        Self {
            ground: rank_correlation(map, is_turned),
            sides: if is_few { 0.0 } else { (in_place - exchanged) / (in_place + exchanged) },
            is_seen: known as f64 >= LEAST_KNOWN * map.disparity.as_slice().len() as f64,
        }
    }

    /// The order that they show.
    pub fn order(self) -> Order {
        let shows = |ground: f64, sides: f64| {
            ground >= CLEAR.0 && sides >= -BORNE.1 || sides >= CLEAR.1 && ground >= -BORNE.0
        };
        match (self.is_seen, shows(self.ground, self.sides), shows(-self.ground, -self.sides)) {
            (true, true, false) => Order::InPlace,
            (true, false, true) => Order::Exchanged,
            _ => Order::Unknown,
        }
    }
}

/// Spearman's rank correlation between known disparities and their rows in the original images.
fn rank_correlation(map: &RoughMap, is_turned: bool) -> f64 {
    let pixels = (0..map.disparity.rows()).flat_map(|y| {
        let row = map.disparity.row(y).iter().enumerate();
        row.map(move |(x, value)| (if is_turned { x } else { y }, *value))
    });
    let known = pixels.filter(|(_, value)| value.is_finite());
    let known: Vec<[i64; 2]> =
        known.map(|(row, value)| [row as i64, value.round_ties_even() as i64]).collect();

    let of_rows = middle_ranks(known.iter().map(|pixel| pixel[0]));
    let of_values = middle_ranks(known.iter().map(|pixel| pixel[1]));
    let mean = (known.len() as f64 - 1.0) / 2.0;
    let (mut both, mut down, mut near) = (0.0, 0.0, 0.0);
    for (row, value) in of_rows.iter().zip(&of_values) {
        let (row, value) = (row - mean, value - mean);
        both += row * value;
        down += row * row;
        near += value * value;
    }
    if down * near > 0.0 { both / (down * near).sqrt() } else { 0.0 }
}

/// The rank of each value; equal ones have the mean of their ranks.
fn middle_ranks(values: impl Iterator<Item = i64> + Clone) -> Vec<f64> {
    let Some(least) = values.clone().min() else { return vec![] };
    let most = values.clone().max().unwrap_or(least);

    let mut counts = vec![0usize; (most - least + 1) as usize];
    values.clone().for_each(|value| counts[(value - least) as usize] += 1);
    let mut below = 0;
    let ranks: Vec<f64> = counts
        .iter()
        .map(|count| {
            below += count;
            below as f64 - f64::midpoint(*count as f64, 1.0)
        })
        .collect();
    values.map(|value| ranks[(value - least) as usize]).collect()
}

/// Votes of half-seen strips for images in place, and for exchanged ones.
fn votes(copies: &Overview, map: &RoughMap) -> [usize; 2] {
    let mut votes = [0; 2];
    for y in 0..map.disparity.rows() {
        let (disparities, gray) = (map.disparity.row(y), copies.planes[0].row(y));
        let valid = copies.valid.row(y);
        let mut last = None;
        for (x, value) in disparities.iter().enumerate() {
            if !value.is_finite() {
                continue;
            }
            if let Some(before) = last.replace(x)
                && is_strip(disparities, [before, x])
                && valid[before..x].iter().all(|valid| *valid)
            {
                let edge = edges(gray, [before, x]);
                // The near object is at the end with the stronger edge: the right one, if the images are in
                // place.
                votes[usize::from(edge[0] >= edge[1])] += 1;
                if let Some(is_exchanged) = is_of_right_surface(gray, [before, x]) {
                    votes[usize::from(is_exchanged)] += 1;
                }
            }
        }
    }
    votes
}

/// Whether the pixels between two with disparities are hidden from the other camera.
fn is_strip(disparities: &[f32], [before, after]: [usize; 2]) -> bool {
    let width = (after - before - 1) as f32;
    let jump = disparities[after] - disparities[before];
    jump > LEAST_STRIP && (width - jump).abs() <= (UNLIKE * jump).max(LEAST_STRIP)
}

/// The steepest edge at either end of a strip.
fn edges(gray: &[f32], ends: [usize; 2]) -> [f32; 2] {
    ends.map(|end| {
        let around = end.saturating_sub(BESIDE).max(1)..(end + BESIDE).min(gray.len() - 1);
        around.map(|x| (gray[x + 1] - gray[x - 1]).abs()).fold(0.0, f32::max)
    })
}

/// Whether the gray values of a strip resemble the surface to its right, not the one to its left; `None`:
/// both.
fn is_of_right_surface(gray: &[f32], [before, after]: [usize; 2]) -> Option<bool> {
    let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
    let strip = mean(&gray[before + 1..after]);
    let left = mean(&gray[before.saturating_sub(BESIDE)..=before]);
    let right = mean(&gray[after..(after + BESIDE + 1).min(gray.len())]);

    let (left, right) = ((strip - left).abs(), (strip - right).abs());
    (left.max(right) > TIMES * left.min(right)).then_some(right < left)
}

#[cfg(test)]
mod tests {
    use super::*;
    use phasestereo_match::base::plane::Plane;

    const SIZE: (usize, usize) = (60, 120);

    /// A rough match of a ramp with an object in front of it, as seen by the left camera of a rig, or the
    /// right one.
    fn signs(slope: f32, near: f32, is_of_left: bool) -> Signs {
        let (rows, cols) = SIZE;
        let (from, to) = (50, 80);
        let ramp = |y: usize| 2.0 + slope * y as f32;
        let thing = |y: usize, x: usize| (20..50).contains(&y) && (from..to).contains(&x);
        let hidden = |y: usize, x: usize| {
            let width = (near - ramp(y)).max(0.0) as usize;
            let beside = if is_of_left { from - width..from } else { to..to + width };
            (20..50).contains(&y) && beside.contains(&x)
        };
        let sign = if is_of_left { 1.0 } else { -1.0 };

        let disparity = Plane::from_fn(rows, cols, |y, x| match () {
            () if thing(y, x) => sign * near,
            () if hidden(y, x) => f32::NAN,
            () => sign * ramp(y).round(),
        });
        let gray = Plane::from_fn(rows, cols, |y, x| if thing(y, x) { 200.0 } else { 50.0 });
        let copies = Overview::of_planes([gray.clone(), gray]);
        let map = RoughMap { unsure: disparity.clone(), disparity, run: None, field: None, confidence: 1.0 };
        Signs::new(&copies, &map, false)
    }

    #[test]
    fn ground_and_half_seen_strips_show_the_order() {
        for slope in [0.0, 0.05] {
            let (left, right) = (signs(slope, 12.0, true), signs(slope, 12.0, false));
            assert_eq!((left.order(), right.order()), (Order::InPlace, Order::Exchanged));
            assert_eq!((left.sides, right.sides), (1.0, -1.0), "{slope}");
        }
        assert_eq!(signs(0.05, 0.0, true).order(), Order::InPlace, "a ground alone");
        assert_eq!(signs(0.05, 0.0, false).order(), Order::Exchanged);
    }

    #[test]
    fn the_ground_is_below_in_the_images_before_they_were_turned() {
        let gray = Plane::from_fn(SIZE.0, SIZE.1, |_, _| 50.0);
        let copies = Overview::of_planes([gray.clone(), gray]);
        let disparity = Plane::from_fn(SIZE.0, SIZE.1, |_, x| (x / 4) as f32);
        let map = RoughMap { unsure: disparity.clone(), disparity, run: None, field: None, confidence: 1.0 };
        let ground = [true, false].map(|is_turned| Signs::new(&copies, &map, is_turned).ground);
        assert!(ground[0] > 0.99 && ground[1].abs() < 0.01, "{ground:?}");
    }

    #[test]
    fn signs_that_contradict_each_other_show_nothing() {
        assert_eq!(signs(-0.05, 12.0, true).order(), Order::Unknown, "a ceiling, and strips");
        assert_eq!(Signs::NONE.order(), Order::Unknown);
        assert_eq!(Signs { ground: 0.9, ..Signs::NONE }.order(), Order::Unknown, "hardly seen");
    }

    #[test]
    fn ranks_of_equal_values_are_their_mean() {
        assert_eq!(middle_ranks([5, 3, 5, 9].into_iter()), [1.5, 0.0, 1.5, 3.0]);
        assert_eq!(middle_ranks([].into_iter()), [0.0; 0]);
    }
}
