//! The field of rows over the frames of a video: its value, its uncertainty, and its drift.
//!
//! After the match of a frame, some blocks are located in the right image by their disparities, as in
//! [`crate::estimation::tracks`]. Each shows how many rows it is off the field. A Kalman filter of the eight
//! coefficients is updated with them, and the mean of its corrections gives the drift:
//!
//! ```text
//! value += drift;   P += Q                              # the possible change from frame to frame
//! for each block of terms t, residual r, variance s^2 of r:
//!     k = P t / (t' P t + s^2);   step += k (r - t' step);   P -= k t' P
//! value += step;   drift = DAMPED (drift + FOLLOWED step), unless the field is being found
//! ```
//!
//! First, a plane is fitted to the residuals of a frame. If it is larger than its error and that of the field
//! allow, the cameras have been moved: the field is opened and found again. If there is evidence for a spline
//! of the row in addition to the plane, rows sway: no field holds for other frames.

use std::array::from_fn;

use serde::{Deserialize, Serialize};

use crate::estimation::facts::SUFFICIENT;
use crate::estimation::rows::robust::{Equation, Model, RobustFit};
use crate::estimation::rows::{RowOffsets, SUSPICION};
use crate::estimation::tracks::{Seed, Track};

use crate::video::choices::{
    ALIKE, CELL_COLUMNS, CELL_PLACES, CELL_ROWS, CUT_SPREADS, DAMPED, FIELD_CHANGES, FOLLOWED, FOUND_SHARE,
    LEAST_BLOCKS, MOST_WEIGHT, MOVED_ERRORS, MOVED_FROM, ROW_TURNS, SEED_BORDER, UNKNOWN_DEVIATIONS,
};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::linear::Normal;
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::statistics::median;
use phasestereo_match::pair::alignment::sway::INTERVALS;
use phasestereo_match::pair::alignment::{Alignment, LARGEST_OFFSET, LINEAR, TERMS, places, terms};

/// The model fitted to the residuals of a frame.
const PLANE: Model = Model { smooth: LINEAR, sways: false, excess: ALIKE };
/// More than the largest possible number of agreeing blocks of a frame.
const MOST_BLOCKS: usize = 1 << 20;
/// Allowed rounding of a covariance, as a share of its diagonal.
const ROUNDING: f64 = 1e-9;

type Covariance = [[f64; TERMS]; TERMS];

/// The field and its covariance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FieldFilter {
    size: (usize, usize),
    /// The coefficients of the field.
    pub value: [f64; TERMS],
    /// The change per frame.
    pub drift: [f64; TERMS],
    /// The covariance of the coefficients.
    pub covariance: Covariance,
    /// Number of blocks that agreed with it in the last frame, and their spread, pixels.
    pub agreement: (usize, f64),
}

/// The evidence of a frame's blocks about the rows.
pub struct Innovation {
    points: Vec<Equation>,
    /// A plane through their offsets from the field.
    plane: RobustFit,
    /// Root mean square of the plane over the image, pixels.
    pub moved: f64,
    /// Whether that is more than errors and drift explain.
    pub is_moved: bool,
    /// Whether the rows sway.
    pub sways: bool,
}

impl FieldFilter {
    /// The field of a pair of this size, with found or unknown rows.
    pub fn new(size: (usize, usize), found: Option<&RowOffsets>) -> Self {
        let mut all = Self {
            size,
            value: [0.0; TERMS],
            drift: [0.0; TERMS],
            covariance: [[0.0; TERMS]; TERMS],
            agreement: found.map_or((0, 0.0), |found| (found.blocks, found.spread)),
        };

        let mut deviations: [f64; TERMS] = from_fn(|term| UNKNOWN_DEVIATIONS[usize::from(term >= LINEAR)]);
        if let Some(found) = found {
            all.value = *found.field.coefficients();
            let has_bend = all.value[LINEAR..].iter().any(|value| *value != 0.0);
            for deviation in &mut deviations[..if has_bend { TERMS } else { LINEAR }] {
                *deviation = 2.0 * found.error;
            }
        }
        for (term, deviation) in deviations.into_iter().enumerate() {
            all.covariance[term][term] = deviation * deviation;
        }
        all
    }

    /// Discards the certainty of the field, since the cameras have been moved, and updates it with the
    /// evidence of a frame.
    pub fn reopen(&mut self, innovation: &Innovation) {
        *self = Self { value: self.value, ..Self::new(self.size, None) };
        self.update(innovation);
    }

    /// Whether frames can have produced its numbers: finite offsets of an image of this size, and a
    /// covariance.
    pub fn is_sound(&self, size: (usize, usize)) -> bool {
        let Self { value, drift, covariance, agreement: (blocks, spread), .. } = self;
        let is_field = |values: &[f64; TERMS]| Alignment::new(*values, size).is_ok();
        self.size == size
            && is_field(value)
            && is_field(drift)
            && is_covariance(covariance)
            && *blocks <= MOST_BLOCKS
            && (0.0..=LARGEST_OFFSET).contains(spread)
    }

    /// The field in the form of an estimate; `None`: no blocks have shown it.
    pub fn offsets(&self) -> Result<Option<RowOffsets>> {
        let (blocks, spread) = self.agreement;
        let (field, error) = (self.field()?, self.error());
        let errors = from_fn(|interval| {
            let y = (2 * interval + 1) as f64 / INTERVALS as f64 - 1.0;
            self.error_at(places().map(|(x, _)| (x, y)))
        });
        Ok((blocks > 0).then_some(RowOffsets { field, error, blocks, spread, errors }))
    }

    /// The field.
    pub fn field(&self) -> Result<Alignment> {
        Alignment::new(self.value, self.size)
    }

    /// Whether blocks have shown it.
    pub fn is_seen(&self) -> bool {
        self.agreement.0 > 0
    }

    /// The change per frame, root mean square over the image, pixels.
    pub fn drift(&self) -> f64 {
        Alignment::new(self.drift, self.size).map_or(0.0, |drift| drift.rms())
    }

    /// How many degrees the right camera is pitched and rolled relative to the left one, if images are
    /// rectified at this focal length in pixels. A rotation about the vertical axis does not change its rows.
    pub fn rotation(&self, focal: f64) -> f64 {
        let [shift, slope, ..] = self.value;
        let pitch = math::atan2(shift, focal);
        let roll = math::atan2(slope, self.size.1 as f64 / 2.0);
        math::hypot(pitch, roll).to_degrees()
    }

    /// Its standard error, root mean square over the image, pixels.
    pub fn error(&self) -> f64 {
        self.error_at(places())
    }

    /// The same, over these places.
    fn error_at(&self, places: impl Iterator<Item = (f64, f64)>) -> f64 {
        let variance = |(x, y)| -> f64 {
            let terms = terms(x, y);
            let row =
                |row: usize| -> f64 { (0..TERMS).map(|col| self.covariance[row][col] * terms[col]).sum() };
            (0..TERMS).map(|at| terms[at] * row(at)).sum()
        };
        let all: Vec<f64> = places.map(variance).collect();
        (all.iter().sum::<f64>() / all.len() as f64).max(0.0).sqrt()
    }

    /// Advances to the next frame.
    pub fn predict(&mut self) {
        for term in 0..TERMS {
            self.value[term] += self.drift[term];
            let change = FIELD_CHANGES[usize::from(term >= LINEAR)] * self.size.1 as f64;
            self.covariance[term][term] += change * change;
        }
    }

    /// The evidence of a frame's blocks; `None`: too little.
    pub fn innovation(&self, tracks: &[Track]) -> Option<Innovation> {
        let point = |track: &Track| {
            let point = Equation::of_track(track, self.size, 1);
            Equation { value: point.residual(&self.value), ..point }
        };
        let mut points: Vec<Equation> = tracks.iter().map(point).collect();
        if points.len() < LEAST_BLOCKS {
            return None;
        }

        // Weights relative to the usual one; no block counts much more than others.
        let usual = median(points.iter().map(|point| point.weight)).unwrap_or(1.0);
        for point in &mut points {
            point.weight = (point.weight / usual).min(MOST_WEIGHT);
        }

        let plane = PLANE.fitted(&points)?;
        if plane.agreeing < LEAST_BLOCKS.max(points.len() / 2) {
            return None;
        }
        let moved = Alignment::new(plane.coefficients, self.size).ok()?.rms();
        let error = math::hypot(self.error(), plane.error);
        let is_moved = moved > MOVED_FROM.max(MOVED_ERRORS * error);
        let sways = PLANE.evidence(&points, &plane) >= SUSPICION && sways(&points);
        Some(Innovation { points, plane, moved, is_moved, sways })
    }

    /// Updates the field with the evidence of a frame's blocks.
    pub fn update(&mut self, innovation: &Innovation) {
        let Innovation { points, plane, .. } = innovation;
        self.agreement = (plane.agreeing, plane.spread);
        let variance = ALIKE * plane.spread * plane.spread;

        let before = self.error();
        let mut steps = [0.0; TERMS];
        let cut = CUT_SPREADS * plane.spread;
        for point in points.iter().filter(|one| one.residual(&plane.coefficients).abs() <= cut) {
            let covariances = self.covariance.map(|row| product(&row, &point.terms));
            let total = product(&covariances, &point.terms) + variance / point.weight;
            let innovation = point.residual(&steps);
            for row in 0..TERMS {
                steps[row] += covariances[row] * innovation / total;
                for col in 0..TERMS {
                    self.covariance[row][col] -= covariances[row] * covariances[col] / total;
                }
            }
        }
        for (value, step) in self.value.iter_mut().zip(steps) {
            *value += step;
        }

        if self.error() > FOUND_SHARE * before {
            for (drift, step) in self.drift.iter_mut().zip(steps) {
                *drift = DAMPED * (*drift + FOLLOWED * step);
            }
        }
    }
}

/// Whether there is much evidence that rows sway.
fn sways(points: &[Equation]) -> bool {
    let model = Model { sways: true, ..PLANE };
    let fit = model.fitted(points);
    fit.is_some_and(|fit| model.evidence(points, &fit) >= SUFFICIENT)
}

/// Whether a matrix may be a covariance: symmetric and without negative eigenvalues, except for rounding.
fn is_covariance(matrix: &Covariance) -> bool {
    let deviations: [f64; TERMS] = from_fn(|at| matrix[at][at].sqrt());
    if !deviations.iter().all(|deviation| (0.0..=LARGEST_OFFSET).contains(deviation)) {
        return false;
    }
    // As correlations, where rounding is a share of 1.
    let divisors = deviations.map(|deviation| if deviation > 0.0 { deviation } else { 1.0 });
    let mut matrix: Covariance =
        from_fn(|row| from_fn(|col| matrix[row][col] / (divisors[row] * divisors[col])));
    let is_symmetric =
        (0..TERMS).all(|row| (0..row).all(|col| (matrix[row][col] - matrix[col][row]).abs() <= ROUNDING));
    for (at, row) in matrix.iter_mut().enumerate() {
        row[at] += ROUNDING;
    }
    is_symmetric && Normal { matrix, ..Normal::new(TERMS) }.factor().is_some()
}

/// The sum of the products of two vectors.
fn product(left: &[f64; TERMS], right: &[f64; TERMS]) -> f64 {
    left.iter().zip(right).map(|(a, b)| a * b).sum()
}

/// Blocks of a matched map, row after row, at different places in every frame, where a disparity passed all
/// checks. `field` predicts their rows. Uses a third of the rows, in turns, or all of them.
pub fn seeds(
    disparity: &Plane<f32>,
    flags: &Plane<u16>,
    field: &Alignment,
    frame: u64,
    has_all: bool,
) -> Vec<Vec<Seed>> {
    let (rows, cols) = disparity.size();
    if rows.min(cols) <= 2 * SEED_BORDER + CELL_COLUMNS {
        return vec![];
    }
    // Seven and eleven have no divisor in common with the number of places.
    let turn = frame / ROW_TURNS as u64;
    let place = |step: u64| (turn.wrapping_mul(step) % CELL_PLACES as u64) as usize;
    let (along, down) = (place(7), place(11));
    let at = |cell: usize, place: usize, cells: usize, length: usize| {
        SEED_BORDER + (cell * CELL_PLACES + place) * (length - 2 * SEED_BORDER) / (cells * CELL_PLACES)
    };

    let mut seeds = vec![];
    let (first, step) = if has_all { (0, 1) } else { ((frame % ROW_TURNS as u64) as usize, ROW_TURNS) };
    for row in (first..CELL_ROWS).step_by(step) {
        let y = at(row, down, CELL_ROWS, rows);
        let mut here = vec![];
        for col in 0..CELL_COLUMNS {
            let x = at(col, along, CELL_COLUMNS, cols);
            let value = f64::from(disparity.row(y)[x]);
            if value.is_finite() && flags.row(y)[x] == 0 {
                let (x, y) = (x as f64, y as f64);
                here.push(Seed { x, y, dx: -value, dy: field.at(x - value, y) });
            }
        }
        seeds.push(here);
    }
    seeds
}
