//! The costs of claims and of the own match -> evidence against the claims, summed over the area in which
//! they differ.
//!
//! Where claim and own disparity differ, surrounding pixels that differ in the same direction most likely
//! belong to the same mistake, of the map or of the match, and each of them has costs of its own. Their
//! differences are summed along both surfaces, even slanted ones, and not at one disparity:
//!
//! ```text
//! for each pixel q:
//!     side[q]  = sign of own[q] - claim[q], 0 if they differ by at most DIFFERENT
//!     lower[q] = cost(q, claim[q]) - cost(q, own[q])      # 0 if either match is outside the right image
//! for each pixel p with a side:
//!     same     = pixels q of the window around p with side[q] = side[p]
//!     evidence[p] = sum of lower[q] over same / sqrt(number of same + FEW)
//! ```
//!
//! So a claim that costs the same as the own disparity in every pixel has no evidence against it, and many
//! small differences weigh as much as noise allows. The costs of disparities between two candidates are
//! interpolated.

use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::cost::Costs;
use phasestereo_match::image::window_sums::Windows;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;

/// Steps per pixel for interpolated disparities, so costs are in fractions of a bit.
pub const STEPS: u32 = 256;
/// Disparities further apart than this are different, pixels.
pub const DIFFERENT: f32 = 0.8;
/// Pixels from the center of the window to its side.
const RADIUS: usize = 7;
/// Pixels that are added to the number, so that small areas count less.
const FEW: f64 = 4.0;

/// A pixel whose claim and own disparity differ.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Compared {
    /// -1: the own disparity is smaller, 1: it is larger, 0: neither.
    side: i8,
    /// How much less the own disparity costs.
    lower: i32,
}

/// The evidence against the claims of a map, bits per square root of the pixels, on the threads of the
/// current pool; 0 where claim and own disparity agree or one is missing.
pub fn against(map: &Plane<f32>, own: &Disparity, costs: &Costs, runtime: Runtime) -> Result<Plane<f32>> {
    let size = map.size();
    let compared = Plane::by_rows(size, runtime.control, |y, row| {
        let pixels = row.iter_mut().zip(map.row(y)).zip(own.disparity.row(y));
        for (x, ((out, claim), own)) in pixels.enumerate() {
            *out = Compared::of(costs, size.1, (y, x), *claim, *own);
        }
    })?;

    let values = |y: usize| compared.row(y).iter().map(|one| one.by_side());
    let strength = |y: usize, x: usize, sums| strength(compared.row(y)[x].side, sums);
    Windows::new(size, RADIUS).plane(values, strength, runtime.level(), runtime.control)
}

impl Compared {
    fn of(costs: &Costs, cols: usize, place: (usize, usize), claim: f32, own: f32) -> Self {
        let by = own - claim;
        let side = i8::from(by > DIFFERENT) - i8::from(by < -DIFFERENT);
        // Infinity makes no claim, like NaN.
        if side == 0 || !claim.is_finite() {
            return Self::default();
        }

        let cost = |disparity| cost_at(costs, cols, place, disparity);
        let lower = cost(claim).zip(cost(own)).map_or(0, |(claimed, own)| claimed - own);
        Self { side, lower }
    }

    /// The amounts it adds to the sums: differences and pixels of the negative side, then of the positive
    /// one.
    fn by_side(self) -> [i32; 4] {
        match self.side {
            0 => [0; 4],
            1.. => [0, 0, self.lower, 1],
            _ => [self.lower, 1, 0, 0],
        }
    }
}

/// The evidence of a pixel, from the sums over its window.
fn strength(side: i8, [below, few, above, many]: [i32; 4]) -> f32 {
    let (sum, pixels) = match side {
        0 => return 0.0,
        1.. => (above, many),
        _ => (below, few),
    };

    (f64::from(sum) / f64::from(STEPS) / (f64::from(pixels) + FEW).sqrt()) as f32
}

/// The cost of a pixel at a disparity between candidates, in fractions of a bit; `None` if the match is
/// invalid or outside the right image.
pub fn cost_at(costs: &Costs, cols: usize, (y, x): (usize, usize), disparity: f32) -> Option<i32> {
    // Beyond the image anyway, and too large for the integers below.
    if disparity.is_nan() || disparity.abs() >= cols as f32 {
        return None;
    }

    let steps = STEPS as i32;
    let place = x as i32 * steps - (disparity * STEPS as f32).round() as i32;
    if place < 0 || place > (cols as i32 - 1) * steps {
        return None;
    }

    let (column, rest) = ((place / steps) as usize, place % steps);
    let near = costs.between(y, x, column)? as i32 * (steps - rest);
    if rest == 0 {
        return Some(near);
    }
    Some(near + costs.between(y, x, column + 1)? as i32 * rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn costs_between_two_columns_are_interpolated() {
        // Row 0, left column 3: the cost of right column c is 10 c.
        let volume =
            Plane::from_fn(1, 4 * 4, |_, index| 10 * (index / 4 - (index % 4).min(index / 4)) as u16);
        let costs = Costs::of_volume(
            &volume,
            phasestereo_match::pair::candidates::Candidates::new(0, 4, 4).expect("legal"),
        );

        let cost = |disparity| cost_at(&costs, 4, (0, 3), disparity).map(|cost| f64::from(cost) / 256.0);
        assert_eq!(cost(0.0), Some(30.0));
        assert_eq!(cost(1.25), Some(17.5));
        assert_eq!(cost(3.0), Some(0.0));
        assert_eq!([3.01, -0.01, 1e9, f32::NAN, f32::INFINITY].map(cost), [None; 5]);
    }
}
