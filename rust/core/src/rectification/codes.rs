//! Codes of the appearance of corners: gradients by direction, gathered on a grid around the corner, as in
//! SIFT (D. Lowe: *Distinctive image features from scale-invariant keypoints*, IJCV 2004), rooted as by R.
//! Arandjelović and A. Zisserman (*Three things everyone should know*, CVPR 2012). They do not determine
//! which way is up, so turned images need turned codes: the grid and the directions are turned.
//!
//! ```text
//! for each of 8 directions t:
//!     energy[t] = Gaussian of max(gx cos t + gy sin t, 0)^2
//! code[i, j, t] = sqrt(energy[t] at the corner + 5 (i, j)) weight(i, j)      # a grid of 4 x 4, 5 px apart
//! code = min(code / |code|, 0.25);   code = sqrt(code / sum of code)     # of length 1, in steps of 1 / 2048
//! ```
//!
//! Images are processed on five levels, each smaller than the one before by the root of two, since cameras
//! may be nearer or zoomed.

use std::array::from_fn;

use super::corners::{Corner, corners};
use super::filters::{Kernel, gradients, reduced, smoothed};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::{Level, leveled};
use phasestereo_match::matcher::runtime::Runtime;

/// Most columns of the first level.
const COLUMNS: usize = 800;
/// The size of each level and the number of its corners.
const LEVELS: [(f64, usize); 5] = [
    (1.0, 500),
    (std::f64::consts::FRAC_1_SQRT_2, 400),
    (0.5, 300),
    (0.5 * std::f64::consts::FRAC_1_SQRT_2, 200),
    (0.25, 120),
];
/// Fewest rows and columns of a level.
const LEAST_SIZE: usize = 60;
/// No corners lie nearer to the ends of a level, pixels.
const BORDER: usize = 12;
/// Smoothing before gradients are computed, and of the energies, pixels.
const SMOOTHING: [f64; 2] = [1.0, 2.5];
/// Directions of gradients.
const DIRECTIONS: usize = 8;
/// Side of the grid, and the distance of its points, pixels.
const GRID: (usize, f64) = (4, 5.0);
/// Points weigh less the farther they are from the corner: a Gaussian, pixels.
const WEIGHT: f64 = 9.0;
/// The largest number of a code, so that a single strong edge does not decide.
const LARGEST: f32 = 0.25;
/// Numbers of a code.
pub const LENGTH: usize = GRID.0 * GRID.0 * DIRECTIONS;
/// The value of 1 in a code: the products of two codes fit 32 bits.
pub const UNIT: f32 = 2048.0;

/// The appearance of a corner.
pub type CornerCode = [i16; LENGTH];

/// The corners of an image on all its levels.
pub struct Features {
    /// Where they are in the image: column and row.
    pub places: Vec<[f64; 2]>,
    /// Columns of the image per column of the level that a corner was found on.
    pub scales: Vec<f64>,
    /// The corners of each level, and its energies under the Gaussian along rows.
    levels: Vec<(Vec<Corner>, Plane<f32>)>,
    /// That Gaussian; along columns it is applied only where energies are sampled.
    gaussian: Kernel,
}

impl Features {
    /// The corners of an image with gray values from 0 to 255.
    pub fn new(image: &Plane<f32>, runtime: Runtime) -> Result<Self> {
        let (rows, cols) = image.size();
        let factor = cols.div_ceil(COLUMNS);
        let first = reduced(image, (rows / factor, cols / factor))?;
        let gaussian = Kernel::gaussian(SMOOTHING[1], DIRECTIONS);
        let mut features = Self { places: vec![], scales: vec![], levels: vec![], gaussian };

        for (scale, most) in LEVELS {
            runtime.control.checkpoint()?;
            let [rows_here, cols_here] =
                [first.rows(), first.cols()].map(|side| (side as f64 * scale).round() as usize);
            if rows_here.min(cols_here) < LEAST_SIZE {
                continue;
            }

            let smaller = reduced(&first, (rows_here, cols_here))?;
            let smaller = smoothed(&smaller, SMOOTHING[0], runtime.level())?;
            let gradients = gradients(&smaller, runtime.level())?;
            let found = corners(&gradients, most, BORDER, runtime.level())?;

            let steps = [cols as f64 / cols_here as f64, rows as f64 / rows_here as f64];
            let place = |corner: &Corner| [0, 1].map(|axis| (corner.place[axis] + 0.5) * steps[axis] - 0.5);
            features.places.extend(found.iter().map(place));
            features.scales.resize(features.places.len(), steps[0]);
            let energies = energies(&gradients, &features.gaussian, runtime.level())?;
            features.levels.push((found, energies));
        }

        Ok(features)
    }

    /// The codes that the corners would have if the image were turned by this many radians.
    pub fn codes(&self, turn: f64, level: Level) -> Vec<CornerCode> {
        let sampling = Sampling::new(turn);
        let of_level = |(corners, energies): &(Vec<Corner>, Plane<f32>)| -> Vec<CornerCode> {
            corners.iter().map(|corner| code(level, &sampling, corner, energies, &self.gaussian)).collect()
        };
        self.levels.iter().flat_map(of_level).collect()
    }
}

/// The energies of all directions, side by side at each pixel, under a Gaussian along rows.
fn energies([along, down]: &[Plane<f32>; 2], gaussian: &Kernel, level: Level) -> Result<Plane<f32>> {
    let directions: [[f32; 2]; DIRECTIONS] = from_fn(|direction| {
        let angle = std::f64::consts::TAU * direction as f64 / DIRECTIONS as f64;
        [math::cos(angle), math::sin(angle)].map(|value| value as f32)
    });
    let size = (along.rows(), along.cols() * DIRECTIONS);
    gaussian.along(size, level, |y, out| write_energies(level, along.row(y), down.row(y), &directions, out))
}

#[leveled]
fn write_energies(
    level: Level,
    along: &[f32],
    down: &[f32],
    directions: &[[f32; 2]; DIRECTIONS],
    out: &mut [f32],
) {
    let pixels = out.chunks_exact_mut(DIRECTIONS);
    for ((energies, along), down) in pixels.zip(along).zip(down) {
        for (energy, [cos, sin]) in energies.iter_mut().zip(directions) {
            let rise = (along * cos + down * sin).max(0.0);
            *energy = rise * rise;
        }
    }
}

/// The places where energies are sampled around a corner.
struct Sampling {
    /// Columns, rows and weight of each point of the grid.
    points: Vec<([f64; 2], f32)>,
    /// How many directions codes are turned by: whole ones, and the rest.
    turn: (usize, f32),
}

impl Sampling {
    fn new(turn: f64) -> Self {
        let (sin, cos) = math::sin_cos(turn);
        let (side, step) = GRID;
        let offset = |index: usize| (index as f64 - 0.5 * (side - 1) as f64) * step;
        let point = |index: usize| {
            let [x, y] = [offset(index % side), offset(index / side)];
            let weight = math::exp(-(x * x + y * y) / (2.0 * WEIGHT * WEIGHT)) as f32;
            ([cos * x - sin * y, sin * x + cos * y], weight)
        };

        let by = (turn / std::f64::consts::TAU * DIRECTIONS as f64).rem_euclid(DIRECTIONS as f64);
        let turn = (by.floor() as usize, (by - by.floor()) as f32);
        Self { points: (0..side * side).map(point).collect(), turn }
    }
}

#[leveled]
fn code(
    level: Level,
    sampling: &Sampling,
    corner: &Corner,
    energies: &Plane<f32>,
    gaussian: &Kernel,
) -> CornerCode {
    let near = |place: usize, by: f64, length: usize| {
        ((place as f64 + by).round().max(0.0) as usize).min(length - 1)
    };
    let (whole, rest) = sampling.turn;

    let mut code = [0.0; LENGTH];
    for (values, ([x, y], weight)) in code.chunks_exact_mut(DIRECTIONS).zip(&sampling.points) {
        let [column, row] = corner.pixel;
        let first = DIRECTIONS * near(column, *x, energies.cols() / DIRECTIONS);
        let energies = gaussian.down_at(energies, near(row, *y, energies.rows()), first);
        let energies: [f32; DIRECTIONS] = energies.map(f32::sqrt);

        for (direction, value) in values.iter_mut().enumerate() {
            let at = |by: usize| energies[(direction + whole + by) % DIRECTIONS];
            *value = weight * ((1.0 - rest) * at(0) + rest * at(1));
        }
    }

    let length = code.iter().fold(0.0f32, |sum, value| sum + value * value).sqrt();
    let clipped = code.map(|value| (value / length.max(1e-6)).min(LARGEST));
    let sum = clipped.iter().fold(0.0f32, |sum, value| sum + value).max(1e-6);
    clipped.map(|value| (UNIT * (value / sum).sqrt()).round() as i16)
}
