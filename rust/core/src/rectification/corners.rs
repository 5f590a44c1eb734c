//! Corners: places where an image differs from itself when moved slightly in any direction (J. Shi, C.
//! Tomasi: *Good features to track*, CVPR 1994).
//!
//! ```text
//! a, b, c = sums over 5 x 5 of gx gx, gx gy, gy gy
//! strength = (a + c) / 2 - sqrt(((a - c) / 2)^2 + b^2)     # the smaller eigenvalue of [[a, b], [b, c]]
//! corners = maxima of strength over 5 x 5, of at least STRENGTH
//! kept    = the strongest of each of 8 x 12 cells, the same number of each
//! ```
//!
//! A parabola through the strengths of the neighbors gives the fraction of a pixel along each axis.

use std::array::from_fn;

use super::filters::Kernel;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::{Level, leveled};

/// Rows and columns of cells over which corners are spread.
const CELLS: (usize, usize) = (8, 12);
/// Radius of the sums and of the maxima, pixels.
const RADIUS: usize = 2;
const SIDE: usize = 2 * RADIUS + 1;
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

/// The corners of an image with these gradients that are at least `border` pixels from its ends: about
/// `most`, spread evenly.
pub fn corners(gradients: &[Plane<f32>; 2], most: usize, border: usize, level: Level) -> Result<Vec<Corner>> {
    let strength = strengths(gradients, level)?;
    let (rows, cols) = strength.size();
    let border = border.max(RADIUS + 1);

    let mut cells = vec![vec![]; CELLS.0 * CELLS.1];
    let mut largest = vec![0.0; cols];
    for y in border..rows.saturating_sub(border) {
        write_largest(level, &from_fn(|row| strength.row(y + row - RADIUS)), &mut largest);
        let values = strength.row(y).iter().zip(&largest).enumerate();
        for (x, (value, largest)) in values.take(cols.saturating_sub(border)).skip(border) {
            if *value > STRENGTH && value >= largest {
                cells[y * CELLS.0 / rows * CELLS.1 + x * CELLS.1 / cols].push((*value, y, x));
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

fn strengths([along, down]: &[Plane<f32>; 2], level: Level) -> Result<Plane<f32>> {
    let (size, sum) = (along.size(), Kernel::sum(RADIUS));
    let product = |one: &Plane<f32>, other: &Plane<f32>| {
        sum.along(size, level, |y, out| {
            for (out, (a, b)) in out.iter_mut().zip(one.row(y).iter().zip(other.row(y))) {
                *out = a * b;
            }
        })
    };
    let products = [product(along, along)?, product(along, down)?, product(down, down)?];

    let mut sums = [(); 3].map(|()| vec![0.0; size.1]);
    let mut strength = Plane::new(size.0, size.1)?;
    for y in 0..size.0 {
        for (sums, product) in sums.iter_mut().zip(&products) {
            sum.down(product, y, level, sums);
        }
        let [a, b, c] = &sums;
        write_strengths(level, a, b, c, strength.row_mut(y));
    }
    Ok(strength)
}

/// The smaller eigenvalues of `[[a, b], [b, c]]`.
#[leveled]
fn write_strengths(level: Level, a: &[f32], b: &[f32], c: &[f32], out: &mut [f32]) {
    for (out, ((a, b), c)) in out.iter_mut().zip(a.iter().zip(b).zip(c)) {
        let half = 0.5 * (a - c);
        *out = 0.5 * (a + c) - (half * half + b * b).sqrt();
    }
}

/// The largest strength in the window around each pixel of the middle row; nothing at its ends.
#[leveled]
fn write_largest(level: Level, rows: &[&[f32]; SIDE], out: &mut [f32]) {
    let mut columns = vec![0.0f32; out.len()];
    for row in rows {
        for (column, value) in columns.iter_mut().zip(*row) {
            *column = if value > column { *value } else { *column };
        }
    }
    for (out, window) in out.iter_mut().skip(RADIUS).zip(columns.windows(SIDE)) {
        *out = window.iter().fold(0.0, |most, value| if *value > most { *value } else { most });
    }
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
