//! Reduces a pair to half the size: each pixel is the mean of a square of four.
//!
//! Over a few scales no rounding noise hides faint detail of a plain surface ([`means`]). Only gray values
//! are kept, since phase codes see nothing else; impulses are repaired before, and a pixel is valid if all
//! four are.

use crate::estimation::means::means;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::image::pixels::Input;
use phasestereo_match::image::view::View;
use phasestereo_match::pair::Pair;

/// Fewest rows and columns of a copy.
pub const LEAST_SIZE: usize = 100;
/// Fewest disparities to search in a pair whose copy still has distinct ones.
pub const FEWEST_CANDIDATES: usize = 8;

/// A pair at half the size; `None` if it is too small for that.
pub fn halved(pair: &Pair) -> Option<Pair> {
    let (rows, cols) = pair.size();
    let candidates = pair.candidates();
    if rows.min(cols) / 2 < LEAST_SIZE || candidates.count() < FEWEST_CANDIDATES {
        return None;
    }

    let (low, high) = (candidates.min(), candidates.max());
    // Both ends lie within the range of the copy.
    let (low, high) = (low.div_euclid(2), -(-high).div_euclid(2));
    let count = (high - low + 1).min(cols as isize / 2);

    let inputs = pair.views().map(halved_view);
    // At the very ends of a range, the copy may have no disparities.
    Pair::of_inputs(inputs, low as i64, count as i64).ok()
}

/// The sum of the four gray values that a pixel of the image at half the size covers.
#[inline(always)]
pub fn sum_of_four(gray: &Plane<i32>, y: usize, x: usize) -> i32 {
    [2 * y, 2 * y + 1].map(|y| gray.row(y)[2 * x] + gray.row(y)[2 * x + 1]).iter().sum()
}

/// The gray values of an image at half the size.
fn halved_view(view: &View) -> Input {
    let (rows, cols) = (view.size().0 / 2, view.size().1 / 2);
    let (image, unit) = means(view, (rows, cols), 4, |y, x| sum_of_four(view.gray(), y, x).into());
    let is_valid = |mask: &Plane<bool>, y: usize, x: usize| {
        [2 * y, 2 * y + 1].iter().all(|y| mask.row(*y)[2 * x] && mask.row(*y)[2 * x + 1])
    };
    let mask = view.mask().map(|mask| Plane::from_fn(rows, cols, |y, x| is_valid(mask, y, x)));

    Input { image, mask, unit }
}
