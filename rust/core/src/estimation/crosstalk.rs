//! Crosstalk: each image contains a share of the other one, as behind a half-silvered mirror, or in frames that
//! take turns.
//!
//! ```text
//! left  = (1 - share) own left  + share own right
//! right = (1 - share) own right + share own left
//! own left  = left  - share / (1 - 2 share) (right - left)
//! own right = right + share / (1 - 2 share) (right - left)
//! ```
//!
//! The own images show nothing in common at the same place where disparities are not 0. So the share is the one
//! that leaves no lead there ([`super::fine_detail`]); the lead falls with it. Fine detail is linear, so it
//! is that of both images in the same proportion:
//!
//! ```text
//! share: lead of sign(fine left - w fine right), sign(fine right - w fine left) = 0,  w = share / (1 - share)
//! ```

use rayon::prelude::*;

use super::fine_detail::{agreeing, fine_levels, led, sampled};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::pair::Pair;

/// The largest share: with a half, both images are the same.
const MOST: f64 = 0.45;
/// Halvings of its interval, to 0.0002.
const HALVINGS: usize = 11;

/// The share of each image in the other one, from pixels that are not at disparity 0; `None`: both images show
/// nothing in common there, or the same whatever the share is.
pub fn share(pair: &Pair, is_one: impl Fn(usize, usize) -> bool + Sync) -> Option<f64> {
    let rows: Vec<Row> =
        sampled(pair.size(), 1).into_par_iter().map(|y| Row::new(pair, y, &is_one)).collect();
    let lead = |share: f64| {
        let weight = share / (1.0 - share);
        let sums = rows.par_iter().map(|row| row.same(weight));
        led(sums.reduce(|| [0; 5], |a, b| [0, 1, 2, 3, 4].map(|k| a[k] + b[k])).map(|sum| sum as f64))
    };

    let [mut low, mut high] = [0.0, MOST];
    if lead(low) <= 0.0 || lead(high) > 0.0 {
        return None;
    }
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(low, high);
        if lead(middle) > 0.0 { low = middle } else { high = middle }
    }
    Some(high)
}

/// What is subtracted from the left image, and added to the right one, in gray levels of the left one.
pub fn levels(pair: &Pair, share: f64, control: &Control) -> Result<Plane<f64>> {
    let views = pair.views();
    let level = |side: usize, y: usize, x: usize| {
        let scale = views[side].scale();
        scale.pixel(views[side].gray().row(y)[x].into()) / scale.level()
    };
    let factor = share / (1.0 - 2.0 * share);
    Plane::by_pixels(pair.size(), control, |y, x| factor * (level(1, y, x) - level(0, y, x)))
}

/// The fine detail of a row of both images, in gray levels, and which of its pixels count.
struct Row {
    fine: [Vec<f64>; 2],
    counts: Vec<bool>,
}

impl Row {
    fn new(pair: &Pair, y: usize, is_one: impl Fn(usize, usize) -> bool) -> Self {
        let counts = (0..pair.size().1).map(|x| is_one(y, x)).collect();
        Self { fine: pair.views().map(|view| fine_levels(view, y)), counts }
    }

    /// How often the signs of both images agree at each of SHIFTS, after this share of the other one is
    /// subtracted from each.
    fn same(&self, weight: f64) -> [i64; 5] {
        let [left, right] = &self.fine;
        let own = |one: &[f64], other: &[f64]| -> Vec<i32> {
            let differences = one.iter().zip(other).map(|(one, other)| one - weight * other);
            differences.map(|own| i32::from(own > 0.0) - i32::from(own < 0.0)).collect()
        };
        let (mut own_left, own_right) = (own(left, right), own(right, left));
        own_left.iter_mut().zip(&self.counts).for_each(|(sign, counts)| *sign *= i32::from(*counts));
        agreeing(&own_left, &own_right, 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;
    use phasestereo_match::image::pixels::{Image, Input};

    const SIZE: (usize, usize) = (200, 400);

    /// A texture at disparity 9, with these shares of the other view in the left and the right one.
    fn pair(shares: [f64; 2], black: f64, white: f64) -> Pair {
        let own = |y: usize, x: usize| f64::from(crate::testing::texture(y, x, 5));
        let views = [0, 9].map(|by| move |y, x| own(y, x + by));
        let inputs = [0, 1].map(|side| {
            let mixed = |(y, x, _)| {
                let [one, other] = [side, 1 - side].map(|view: usize| views[view](y, x));
                black + white / 255.0 * ((1.0 - shares[side]) * one + shares[side] * other)
            };
            Input::from(Image::F64(Array3::from_shape_fn((SIZE.0, SIZE.1, 1), mixed)))
        });
        Pair::of_inputs(inputs, 0, 32).expect("legal")
    }

    #[test]
    fn the_share_is_found_in_any_unit() {
        for (known, black, white) in
            [(0.03, 0.0, 255.0), (0.1, 0.0, 255.0), (0.3, 0.2, 0.5), (0.42, -7.0, 9e4)]
        {
            let found = share(&pair([known; 2], black, white), |_, _| true).expect("a share");
            assert!((found - known).abs() < 0.01, "{found} of {known}");
        }
        let found = share(&pair([0.2, 0.0], 0.0, 255.0), |_, x| x > 100).expect("a share");
        assert!((0.08..0.12).contains(&found), "the mean: {found}");
        assert_eq!(share(&pair([0.5; 2], 0.0, 255.0), |_, _| true), None);
    }

    #[test]
    fn own_images_are_left() {
        let (mixed, own) = (pair([0.2; 2], 0.0, 255.0), pair([0.0; 2], 0.0, 255.0));
        let levels = levels(&mixed, 0.2, &Control::default()).expect("memory");
        for side in 0..2 {
            let pixel = |pair: &Pair, x| {
                let view = pair.views()[side];
                view.scale().pixel(f64::from(view.gray().row(70)[x]))
            };
            for x in 0..SIZE.1 {
                let sign = [1.0, -1.0][side];
                let level = mixed.views()[side].scale().level();
                let left = pixel(&mixed, x) - sign * levels.row(70)[x] * level;
                assert!((left - pixel(&own, x)).abs() < 0.1, "{left} at {x}");
            }
        }
    }
}
