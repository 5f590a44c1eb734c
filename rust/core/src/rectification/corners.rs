//! Corners: places where an image differs from itself moved a little, in any direction (J. Shi, C. Tomasi:
//! *Good features to track*, CVPR 1994).
//!
//! ```text
//! a, b, c = sums over 5 x 5 of gx gx, gx gy, gy gy
//! strength = (a + c) / 2 - sqrt(((a - c) / 2)^2 + b^2)     # the smaller eigenvalue of [[a, b], [b, c]]
//! corners = maxima of strength over 5 x 5, of at least STRENGTH
//! kept    = the strongest of each of 8 x 12 cells, equally many
//! ```
//!
//! A parabola through the strengths of the neighbors gives the fraction of a pixel along each axis.

use super::filters::{gradients, summed};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;

/// Rows and columns of cells over which corners are spread.
const CELLS: (usize, usize) = (8, 12);
/// Radius of the sums and of the maxima, pixels.
const RADIUS: usize = 2;
/// Least strength of a corner, summed over its window, where gray values go from 0 to 255.
const STRENGTH: f32 = 7.5;

/// A corner of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Its column and row.
    pub pixel: [usize; 2],
    /// Where it is, to a fraction of a pixel: column and row.
    pub place: [f64; 2],
}

/// The corners of an image that are at least `border` pixels from its ends: about `most`, spread evenly.
pub fn corners(image: &Plane<f32>, most: usize, border: usize, level: Level) -> Result<Vec<Corner>> {
    let strength = strengths(image, level)?;
    let (rows, cols) = (image.rows(), image.cols());
    let border = border.max(RADIUS + 1);

    let mut cells = vec![vec![]; CELLS.0 * CELLS.1];
    for y in border..rows.saturating_sub(border) {
        for x in border..cols.saturating_sub(border) {
            let value = strength.row(y)[x];
            if value > STRENGTH && is_largest(&strength, y, x) {
                cells[y * CELLS.0 / rows * CELLS.1 + x * CELLS.1 / cols].push((value, y, x));
            }
        }
    }

    let quota = most.div_ceil(cells.len());
    for cell in &mut cells {
        // The sort is stable: equally strong corners stay in their order.
        cell.sort_by(|one, other| other.0.total_cmp(&one.0));
        cell.truncate(quota);
    }
    Ok(cells.concat().into_iter().map(|(_, y, x)| corner(&strength, y, x)).collect())
}

fn strengths(image: &Plane<f32>, level: Level) -> Result<Plane<f32>> {
    let [along, down] = gradients(image)?;
    let product = |one: &Plane<f32>, other: &Plane<f32>| {
        let values = one.as_slice().iter().zip(other.as_slice()).map(|(a, b)| a * b).collect();
        summed(&Plane::from_vec(image.rows(), image.cols(), values)?, RADIUS, level)
    };
    let (a, b, c) = (product(&along, &along)?, product(&along, &down)?, product(&down, &down)?);

    let sums = a.as_slice().iter().zip(b.as_slice()).zip(c.as_slice());
    let smaller = |((a, b), c): ((&f32, &f32), &f32)| {
        let half = 0.5 * (a - c);
        0.5 * (a + c) - (half * half + b * b).sqrt()
    };
    Plane::from_vec(image.rows(), image.cols(), sums.map(smaller).collect())
}

/// Whether no neighbor is stronger.
fn is_largest(strength: &Plane<f32>, y: usize, x: usize) -> bool {
    let value = strength.row(y)[x];
    let columns = x - RADIUS..=x + RADIUS;
    (y - RADIUS..=y + RADIUS).all(|y| strength.row(y)[columns.clone()].iter().all(|other| *other <= value))
}

fn corner(strength: &Plane<f32>, y: usize, x: usize) -> Corner {
    let at = |y: usize, x: usize| f64::from(strength.row(y)[x]);
    let middle = at(y, x);
    let part = |before: f64, after: f64| {
        let bend = 2.0 * (2.0 * middle - before - after);
        ((after - before) / bend.max(1e-6)).clamp(-0.5, 0.5)
    };

    let by = [part(at(y, x - 1), at(y, x + 1)), part(at(y - 1, x), at(y + 1, x))];
    Corner { pixel: [x, y], place: [x as f64 + by[0], y as f64 + by[1]] }
}
