//! The costs of claims and of the own match -> evidence against the claims, summed over the area that they differ in.
//!
//! Where claim and own disparity differ, the pixels around that differ in the same direction are most likely the same
//! mistake, of the map or of the match, and each pixel of it has costs of its own. Their differences are added along the
//! two surfaces, slanted as they may be, and not at one disparity:
//!
//! ```text
//! for each pixel q:
//!     side[q]  = sign of own[q] - claim[q], 0 if they differ by at most DIFFERENT
//!     lower[q] = cost(q, claim[q]) - cost(q, own[q])      # 0 where either match lies outside the right image
//! for each pixel p with a side:
//!     same     = pixels q of the window around p with side[q] = side[p]
//!     evidence[p] = sum of lower[q] over same / sqrt(number of same + FEW)
//! ```
//!
//! So a claim that costs as much as the own disparity in every pixel has no evidence against it, and many small
//! differences weigh as much as noise lets them. The costs of disparities between two candidates are interpolated.

use crate::cost::Costs;
use crate::error::Result;
use crate::image::plane::{Plane, zeroed};
use crate::pipeline::control::Control;
use crate::pipeline::matcher::Disparity;

/// Parts of a pixel in which disparities are interpolated, so costs are in parts of a bit.
pub const STEPS: u32 = 256;
/// Disparities further apart than this are different, pixels.
pub const DIFFERENT: f32 = 0.8;
/// Pixels from the center of the window to its side.
const RADIUS: usize = 7;
/// Pixels by which a small area counts less.
const FEW: f64 = 4.0;
/// Rows that one task works on.
const BAND: usize = 32;

/// What pixels say against the claims.
#[derive(Debug)]
pub struct Evidence {
    /// Bits per square root of the pixels; 0 where claim and own disparity agree or there is none.
    pub against: Plane<f32>,
}

/// How claim and own disparity of a pixel differ.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Difference {
    /// -1: the own disparity is smaller, 1: it is larger, 0: neither.
    side: i8,
    /// By how much it costs less.
    lower: i32,
}

impl Evidence {
    /// The evidence against the claims of a map, on the threads of the current pool.
    pub fn new(
        map: &Plane<f32>,
        own: &Disparity,
        costs: &Costs,
        control: &Control,
    ) -> Result<Self> {
        let size = (map.rows(), map.cols());
        let cols = size.1;

        let mut differences = Plane::<Difference>::new(size.0, cols)?;
        differences.write_bands(1, |y, row| {
            control.checkpoint()?;
            let pixels = row.iter_mut().zip(map.row(y)).zip(own.disparity.row(y));
            for (x, ((out, claim), own)) in pixels.enumerate() {
                *out = Difference::of(costs, cols, (y, x), *claim, *own);
            }
            Ok(())
        })?;

        let against = Plane::by_bands(size, BAND, |first, band| {
            control.checkpoint()?;
            let rows = first..first + band.len() / cols;
            let value = |y: usize, x: usize| differences.row(y)[x].by_side();
            window_sums(size, rows, RADIUS, value, |y, x, sums| {
                band[(y - first) * cols + x] = strength(differences.row(y)[x].side, sums);
            })
        })?;

        Ok(Self { against })
    }
}

impl Difference {
    fn of(costs: &Costs, cols: usize, place: (usize, usize), claim: f32, own: f32) -> Self {
        let by = own - claim;
        let side = i8::from(by > DIFFERENT) - i8::from(by < -DIFFERENT);
        // Infinity claims nothing, as NaN does.
        if side == 0 || !claim.is_finite() {
            return Self::default();
        }

        let cost = |disparity| cost_at(costs, cols, place, disparity);
        let lower = cost(claim).zip(cost(own)).map_or(0, |(claimed, own)| claimed - own);
        Self { side, lower }
    }

    /// What it adds to the sums: differences and pixels of the negative side, then of the positive one.
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

/// The cost of a pixel at a disparity between candidates, in parts of a bit; `None` where the match is invalid or lies
/// outside the right image.
pub fn cost_at(costs: &Costs, cols: usize, (y, x): (usize, usize), disparity: f32) -> Option<i32> {
    // Beyond the image anyway, and too far for the integers below.
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

/// Sums over the square windows around the pixels of some rows, as far as the image has them.
pub fn window_sums<const N: usize>(
    (rows, cols): (usize, usize),
    wanted: std::ops::Range<usize>,
    radius: usize,
    value: impl Fn(usize, usize) -> [i32; N],
    mut take: impl FnMut(usize, usize, [i32; N]),
) -> Result<()> {
    // The sums of each column over the rows of the window.
    let mut columns = zeroed::<i32>(cols * N)?;
    let add = |columns: &mut [i32], y: usize, sign: i32| {
        for (x, sums) in columns.as_chunks_mut::<N>().0.iter_mut().enumerate() {
            let values = value(y, x);
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += sign * value;
            }
        }
    };

    for y in wanted.start.saturating_sub(radius)..(wanted.start + radius).min(rows) {
        add(&mut columns, y, 1);
    }

    for y in wanted {
        if y + radius < rows {
            add(&mut columns, y + radius, 1);
        }

        let columns_now = columns.as_chunks::<N>().0;
        let mut sums = [0; N];
        let change = |sums: &mut [i32; N], x: usize, sign: i32| {
            for (sum, column) in sums.iter_mut().zip(columns_now[x]) {
                *sum += sign * column;
            }
        };

        (0..radius.min(cols)).for_each(|x| change(&mut sums, x, 1));
        for x in 0..cols {
            if x + radius < cols {
                change(&mut sums, x + radius, 1);
            }
            take(y, x, sums);
            if x >= radius {
                change(&mut sums, x - radius, -1);
            }
        }

        if y >= radius {
            add(&mut columns, y - radius, -1);
        }
    }

    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn window_sums_equal_those_of_every_window_by_itself() {
        let (rows, cols) = (9_usize, 7_usize);
        let value = |y: usize, x: usize| [(y * 31 + x * 17) as i32 % 11 - 5, (y + x) as i32 % 3];

        for radius in [0, 1, 3, 12] {
            for wanted in [0..rows, 0..1, 3..8] {
                let mut seen = 0;
                let check = |y: usize, x: usize, sums: [i32; 2]| {
                    let mut expected = [0, 0];
                    for v in 0..rows {
                        for u in 0..cols {
                            if v.abs_diff(y) <= radius && u.abs_diff(x) <= radius {
                                expected[0] += value(v, u)[0];
                                expected[1] += value(v, u)[1];
                            }
                        }
                    }
                    assert_eq!(sums, expected, "row {y}, column {x}, radius {radius}");
                    seen += 1;
                };

                let count = wanted.len() * cols;
                window_sums((rows, cols), wanted, radius, value, check).expect("enough memory");
                assert_eq!(seen, count);
            }
        }
    }

    #[test]
    fn costs_between_two_columns_are_interpolated() {
        // Row 0, left column 3: the cost of right column c is 10 c.
        let volume = Plane::from_fn(1, 4 * 4, |_, index| {
            10 * (index / 4 - (index % 4).min(index / 4)) as u16
        });
        let costs = Costs::of_volume(
            &volume,
            crate::cost::candidates::Candidates::new(0, 4, 4).expect("legal"),
        );

        let cost =
            |disparity| cost_at(&costs, 4, (0, 3), disparity).map(|cost| f64::from(cost) / 256.0);
        assert_eq!(cost(0.0), Some(30.0));
        assert_eq!(cost(1.25), Some(17.5));
        assert_eq!(cost(3.0), Some(0.0));
        assert_eq!([3.01, -0.01, 1e9, f32::NAN, f32::INFINITY].map(cost), [None; 5]);
    }
}
