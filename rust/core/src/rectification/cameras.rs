//! Two cameras, of which only one thing is known: they look about the same way. Fourteen numbers describe
//! them, each with a usual value and a usual deviation.
//!
//! ```text
//! focal length, and the ratio of both       0.85 widths, within a third or so
//! radial distortion k1, k2; difference in k1
//! principal points                          the middle, within 1.5 % of the width
//! rotations                                 yaw and roll of both cameras, pitch of one against the other
//!
//! p = (raw - principal point) / f = u (1 + k1 |u|^2 + k2 |u|^4)     # u: undistorted
//! X = Rx(pitch) Ry(yaw) Rz(roll) (u, 1);   rectified = F (X0, X1) / X2 + middle
//! ```
//!
//! The pitch that both share moves all rows equally: it stays at 0. Numbers that the images do not determine,
//! such as the focal length of a narrow view, stay at their usual values.

use std::array::from_fn;

use serde::{Deserialize, Serialize};

use phasestereo_match::base::math;

/// How many numbers describe two cameras.
pub const NUMBERS: usize = 14;
/// Indices that other modules use.
pub const K1: usize = 2;

/// The usual focal length in widths.
const FOCAL: f64 = 0.85;
/// Usual deviations: of logarithms for the focal length and the ratio, of widths, of radians. In order: focal
/// length, ratio, k1, k2, difference in k1, principal point left (column, row) and right, yaw and roll left,
/// pitch, yaw and roll right.
pub const USUAL: [f64; NUMBERS] =
    [0.35, 0.03, 0.2, 0.08, 0.02, 0.015, 0.015, 0.015, 0.015, 0.07, 0.07, 0.1, 0.07, 0.07];
/// The deviations for cameras that differ more in focal length and distortion.
pub const WIDE: [f64; NUMBERS] =
    [0.35, 0.15, 0.2, 0.08, 0.4, 0.015, 0.015, 0.015, 0.015, 0.07, 0.07, 0.1, 0.07, 0.07];

/// Steps that undo a distortion, which converge quadratically.
const STEPS: usize = 7;
/// Beyond the radius where the distorted one grows more slowly than this, an image would fold back.
const LEAST_SLOPE: f64 = 0.1;
/// The largest radius to examine, in focal lengths, and the steps up to it.
const RADIUS: (f64, usize) = (2.0, 200);
/// Rays at a flatter angle to the image plane do not meet it.
const LEAST_DEPTH: f64 = 0.05;

/// A column and a row.
pub type Point = [f64; 2];
/// Rows of numbers.
pub type Matrix = [[f64; 3]; 3];

/// Two cameras, given by their numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "Saved", into = "Saved")]
pub struct Cameras {
    numbers: [f64; NUMBERS],
    spreads: [f64; NUMBERS],
    size: (usize, usize),
    /// Columns and rows by which the rectified images are moved.
    pub shifts: [Point; 2],
    focal: f64,
    sides: [Camera; 2],
}

/// The saved data of two cameras; the rest is computed from it.
#[derive(Serialize, Deserialize)]
struct Saved {
    numbers: [f64; NUMBERS],
    spreads: [f64; NUMBERS],
    size: (usize, usize),
    shifts: [Point; 2],
}

impl From<Saved> for Cameras {
    fn from(Saved { numbers, spreads, size, shifts }: Saved) -> Self {
        Self { shifts, ..Self::new(numbers, spreads, size) }
    }
}

impl From<Cameras> for Saved {
    fn from(Cameras { numbers, spreads, size, shifts, .. }: Cameras) -> Self {
        Self { numbers, spreads, size, shifts }
    }
}

/// One of the cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Focal length, pixels.
    pub focal: f64,
    /// Principal point: column and row.
    pub center: Point,
    /// Radial distortion: k1 and k2.
    pub distortion: [f64; 2],
    /// From the raw camera to the rectified one.
    pub rotation: Matrix,
    /// The rotation's derivatives by pitch, yaw and roll.
    turns: [Matrix; 3],
    /// The undistorted radius beyond which the image folds back, in focal lengths.
    reach: f64,
}

impl Cameras {
    /// Cameras with these numbers, as multiples of the deviations, and images of this many rows and columns.
    pub fn new(numbers: [f64; NUMBERS], spreads: [f64; NUMBERS], size: (usize, usize)) -> Self {
        let values: [f64; NUMBERS] = from_fn(|index| numbers[index] * spreads[index]);
        let [focal, ratio, k1, k2, differs, ..] = values;
        let [column_left, row_left, column_right, row_right] = from_fn(|index| values[5 + index]);
        let [yaw_left, roll_left, pitch, yaw_right, roll_right] = from_fn(|index| values[9 + index]);

        let (rows, cols) = (size.0 as f64, size.1 as f64);
        let focal = FOCAL * cols * math::exp(focal);
        let camera = |sign: f64, column: f64, row: f64, [yaw, roll]: [f64; 2]| {
            let distortion = [k1 + sign * differs, k2];
            let (rotation, turns) = rotation([sign * pitch, yaw, roll]);
            Camera {
                focal: focal * math::exp(sign * ratio),
                center: [0.5 * (cols - 1.0) + cols * column, 0.5 * (rows - 1.0) + cols * row],
                distortion,
                rotation,
                turns,
                reach: reach(distortion),
            }
        };

        let sides = [
            camera(-0.5, column_left, row_left, [yaw_left, roll_left]),
            camera(0.5, column_right, row_right, [yaw_right, roll_right]),
        ];
        Self { numbers, spreads, size, shifts: [[0.0; 2]; 2], focal, sides }
    }

    /// The numbers as multiples of the deviations.
    pub fn numbers(&self) -> &[f64; NUMBERS] {
        &self.numbers
    }

    /// Rows and columns of the images.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// The deviations.
    pub fn spreads(&self) -> &[f64; NUMBERS] {
        &self.spreads
    }

    /// The same with other numbers.
    pub fn with_numbers(&self, numbers: [f64; NUMBERS]) -> Self {
        Self { shifts: self.shifts, ..Self::new(numbers, self.spreads, self.size) }
    }

    /// The same cameras with images of another size.
    pub fn resized(&self, size: (usize, usize)) -> Self {
        let scale = size.1 as f64 / self.size.1 as f64;
        let shifts = self.shifts.map(|shift| shift.map(|by| by * scale));
        Self { shifts, ..Self::new(self.numbers, self.spreads, size) }
    }

    /// The left and the right camera.
    pub fn sides(&self) -> &[Camera; 2] {
        &self.sides
    }

    /// Focal length of the rectified images, pixels.
    pub fn focal(&self) -> f64 {
        self.focal
    }

    /// The principal point of a rectified image: column and row.
    #[inline(always)]
    pub fn center(&self, side: usize) -> Point {
        let middle = self.middle();
        from_fn(|axis| middle[axis] + self.shifts[side][axis])
    }

    /// The middle of the rectified images before they are moved.
    #[inline(always)]
    fn middle(&self) -> Point {
        [0.5 * (self.size.1 as f64 - 1.0), 0.5 * (self.size.0 as f64 - 1.0)]
    }

    /// The rectified place of a point of a raw image.
    #[inline(always)]
    pub fn rectified(&self, raw: Point, side: usize) -> Point {
        let ray = self.sides[side].ray(raw);
        let center = self.center(side);
        from_fn(|axis| self.focal * ray.turned[axis] / ray.turned[2] + center[axis])
    }

    /// The rectified places of some pixels of a raw row, from a column on.
    #[inline(always)]
    pub fn rectified_row<const N: usize>(&self, first: usize, y: usize, side: usize) -> [Point; N] {
        let (camera, center) = (&self.sides[side], self.center(side));
        let raw: [Point; N] = from_fn(|at| [(first + at) as f64, y as f64]);
        let places = raw.map(|raw| from_fn(|axis| (raw[axis] - camera.center[axis]) / camera.focal));
        let distorted = places.map(|[x, y]: Point| (x * x + y * y).sqrt());
        let radii = camera.undistorted(distorted);
        from_fn(|at| {
            let turned = camera.ray_of(places[at], distorted[at], radii[at]).turned;
            from_fn(|axis| self.focal * turned[axis] / turned[2] + center[axis])
        })
    }

    /// The raw place of a point of a rectified image; `None` where no ray of that camera comes from.
    pub fn raw(&self, rectified: Point, side: usize) -> Option<Point> {
        let place = self.backward(side).place(rectified);
        (!place[0].is_nan()).then_some(place)
    }

    /// The way from a rectified image to the raw one.
    pub fn backward(&self, side: usize) -> Backward {
        let Camera { focal, center, distortion, rotation, reach, .. } = &self.sides[side];
        let [x, y] = self.center(side);
        let turn = from_fn(|k| {
            let [right, down] = [rotation[0][k] / self.focal, rotation[1][k] / self.focal];
            [right, down, rotation[2][k] - x * right - y * down]
        });
        Backward { turn, focal: *focal, center: *center, distortion: *distortion, reach: *reach }
    }

    /// The row difference, after rectification, of a point in both raw images.
    pub fn row_difference(&self, [left, right]: [Point; 2]) -> f64 {
        self.rectified(left, 0)[1] - self.rectified(right, 1)[1]
    }

    /// The same, and its derivatives by the numbers.
    pub fn row_derivatives(&self, places: [Point; 2]) -> (f64, [f64; NUMBERS]) {
        let cols = self.size.1 as f64;
        let (mut difference, mut all) = (0.0, [0.0; NUMBERS]);

        for (side, sign) in [(0, 1.0), (1, -1.0)] {
            let half = -0.5 * sign;
            let camera = &self.sides[side];
            let ray = camera.ray(places[side]);
            let [_, down, depth] = ray.turned;
            let row = self.focal * down / depth;
            difference += sign * (row + self.shifts[side][1]);

            // The row's derivative along a change of the turned ray, and of the undistorted place.
            let by_ray = |change: [f64; 3]| {
                sign * self.focal * (change[1] * depth - down * change[2]) / (depth * depth)
            };
            let by_place =
                |[x, y]: Point| by_ray(from_fn(|k| camera.rotation[k][0] * x + camera.rotation[k][1] * y));
            let [x, y] = ray.place;
            let radial = by_place([x / ray.slope, y / ray.slope]);
            let by_center = |axis: usize| {
                let bent = 2.0 * ray.bend * ray.place[axis] / ray.slope;
                let unit: Point = from_fn(|k| if k == axis { 1.0 } else { 0.0 });
                by_place(from_fn(|k| (unit[k] - bent * ray.place[k]) / ray.longer)) * -cols / camera.focal
            };
            let by_turn = |turn: &Matrix| by_ray(from_fn(|k| turn[k][0] * x + turn[k][1] * y + turn[k][2]));

            let by_focal = -radial * ray.longer;
            let by_k1 = -radial * ray.square;
            all[0] += sign * row + by_focal;
            all[1] += half * by_focal;
            all[2] += by_k1;
            all[3] -= radial * ray.square * ray.square;
            all[4] += half * by_k1;
            all[5 + 2 * side] = by_center(0);
            all[6 + 2 * side] = by_center(1);

            let [pitch, yaw, roll] = &camera.turns;
            all[11] += half * by_turn(pitch);
            all[9 + 3 * side] = by_turn(yaw);
            all[10 + 3 * side] = by_turn(roll);
        }

        (difference, from_fn(|index| all[index] * self.spreads[index]))
    }

    /// How many pixels a lens moves a point at half the width from the middle, outward, and its derivatives
    /// by the numbers.
    pub fn distortion(&self, side: usize) -> (f64, [f64; NUMBERS]) {
        let half = 0.5 * self.size.1 as f64;
        let sign = if side == 0 { -0.5 } else { 0.5 };
        let [k1, k2] = self.sides[side].distortion;
        let square = (half / self.sides[side].focal).powi(2);

        let by_k1 = half * square;
        let by_focal = -by_k1 * (2.0 * k1 + 4.0 * k2 * square);
        let mut slope = [0.0; NUMBERS];
        slope[..5].copy_from_slice(&[by_focal, sign * by_focal, by_k1, by_k1 * square, sign * by_k1]);
        let slope = from_fn(|index| slope[index] * self.spreads[index]);
        (by_k1 * (k1 + square * k2), slope)
    }

    /// Whether a place of a raw image is where its distortion turns back.
    pub fn is_folded(&self, raw: Point, side: usize) -> bool {
        let Camera { focal, center, distortion: [k1, k2], reach, .. } = &self.sides[side];
        let square = reach * reach;
        let limit = reach * (1.0 + square * (k1 + square * k2));
        math::hypot(raw[0] - center[0], raw[1] - center[1]) / focal > 0.98 * limit
    }
}

/// The conversion of places in a rectified image to those in the raw one.
#[derive(Debug, Clone, Copy)]
pub struct Backward {
    /// From a column, a row and 1 to a ray of the raw camera.
    turn: Matrix,
    focal: f64,
    center: Point,
    distortion: [f64; 2],
    reach: f64,
}

impl Backward {
    /// The raw place of a rectified one; NaN where no ray of the camera comes from.
    #[inline(always)]
    pub fn place(&self, [x, y]: Point) -> Point {
        let [right, down, depth] = self.turn.map(|[a, b, c]| a * x + b * y + c);
        let nearer = 1.0 / depth;
        let [x, y] = [right * nearer, down * nearer];
        let square = x * x + y * y;
        let longer = 1.0 + square * (self.distortion[0] + square * self.distortion[1]);

        let is_seen = depth > LEAST_DEPTH && square <= self.reach * self.reach;
        let scale = if is_seen { self.focal * longer } else { f64::NAN };
        [scale * x + self.center[0], scale * y + self.center[1]]
    }
}

/// The ray of a raw pixel.
struct Ray {
    /// Its undistorted place, in focal lengths from the principal point.
    place: Point,
    /// The squared radius there, the factor by which the distorted one is longer, and `k1 + 2 k2 square`.
    square: f64,
    longer: f64,
    bend: f64,
    /// The slope of the distorted radius.
    slope: f64,
    /// The ray, turned into the rectified camera.
    turned: [f64; 3],
}

impl Camera {
    #[inline(always)]
    fn ray(&self, raw: Point) -> Ray {
        let [x, y]: Point = from_fn(|axis| (raw[axis] - self.center[axis]) / self.focal);
        let distorted = (x * x + y * y).sqrt();
        let [radius] = self.undistorted([distorted]);
        self.ray_of([x, y], distorted, radius)
    }

    /// The undistorted radii for some distorted ones.
    #[inline(always)]
    fn undistorted<const N: usize>(&self, distorted: [f64; N]) -> [f64; N] {
        let [k1, k2] = self.distortion;
        let mut radii = distorted.map(|radius| radius.min(self.reach));
        for _ in 0..STEPS {
            let mut change = 0.0;
            for (radius, distorted) in radii.iter_mut().zip(&distorted) {
                let square = *radius * *radius;
                let excess = *radius * (1.0 + square * (k1 + square * k2)) - distorted;
                let next = (*radius - excess / self.slope(square)).max(0.0).min(self.reach);
                change += (next - *radius).abs();
                *radius = next;
            }
            if change <= 0.0 {
                break;
            }
        }
        radii
    }

    /// The slope of the distorted radius at this squared undistorted radius.
    #[inline(always)]
    fn slope(&self, square: f64) -> f64 {
        let [k1, k2] = self.distortion;
        (1.0 + square * (3.0 * k1 + 5.0 * k2 * square)).max(LEAST_SLOPE)
    }

    /// The ray of a raw pixel at this distorted place, given its distorted and undistorted radius.
    #[inline(always)]
    fn ray_of(&self, [x, y]: Point, distorted: f64, radius: f64) -> Ray {
        let [k1, k2] = self.distortion;
        let shorter = if distorted > 1e-9 { radius / distorted } else { 1.0 };
        let place @ [x, y] = [x * shorter, y * shorter];
        let square = x * x + y * y;
        let mut turned: [f64; 3] =
            from_fn(|k| self.rotation[k][0] * x + self.rotation[k][1] * y + self.rotation[k][2]);
        turned[2] = turned[2].max(LEAST_DEPTH);

        Ray {
            place,
            square,
            longer: (1.0 + square * (k1 + square * k2)).max(LEAST_SLOPE),
            bend: k1 + 2.0 * square * k2,
            slope: self.slope(square),
            turned,
        }
    }
}

/// The radius beyond which an image folds back.
fn reach([k1, k2]: [f64; 2]) -> f64 {
    let (most, steps) = RADIUS;
    let radius = |step: usize| most * step as f64 / steps as f64;
    let is_flat = |radius: &f64| {
        let square = radius * radius;
        1.0 + square * (3.0 * k1 + 5.0 * k2 * square) < LEAST_SLOPE
    };
    (0..=steps).map(radius).find(is_flat).unwrap_or(most)
}

/// The rotation `Rx(pitch) Ry(yaw) Rz(roll)`, and its derivatives by the three angles.
fn rotation(angles: [f64; 3]) -> (Matrix, [Matrix; 3]) {
    let turns: [Matrix; 3] = from_fn(|axis| turn(axis, angles[axis], false));
    let slopes: [Matrix; 3] = from_fn(|axis| turn(axis, angles[axis], true));
    let with = |changed: usize| {
        let part = |axis: usize| if axis == changed { &slopes[axis] } else { &turns[axis] };
        times(&times(part(0), part(1)), part(2))
    };

    (with(3), from_fn(with))
}

/// The rotation about an axis, or its derivative.
fn turn(axis: usize, angle: f64, is_slope: bool) -> Matrix {
    let (sin, cos) = math::sin_cos(angle);
    let (one, other) = ((axis + 1) % 3, (axis + 2) % 3);
    let [along, across] = if is_slope { [-sin, cos] } else { [cos, sin] };

    let mut matrix = [[0.0; 3]; 3];
    matrix[axis][axis] = if is_slope { 0.0 } else { 1.0 };
    (matrix[one][one], matrix[other][other]) = (along, along);
    (matrix[one][other], matrix[other][one]) = (-across, across);
    matrix
}

/// A matrix times another one.
pub fn times(one: &Matrix, other: &Matrix) -> Matrix {
    from_fn(|row| from_fn(|col| (0..3).map(|k| one[row][k] * other[k][col]).sum()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (480, 640);

    fn cameras() -> Cameras {
        let numbers = [0.5, 1.0, -0.8, 0.4, 1.5, 0.6, -0.7, 0.3, 1.0, 0.8, -1.2, 0.9, -0.4, 1.6];
        Cameras { shifts: [[3.0, -2.0], [-7.0, -2.0]], ..Cameras::new(numbers, USUAL, SIZE) }
    }

    fn places() -> impl Iterator<Item = Point> {
        (0..100).map(|i| [f64::from(i % 10) * 70.0 + 3.0, f64::from(i / 10) * 50.0 + 8.0])
    }

    #[test]
    fn raw_and_rectified_places_lead_to_each_other() {
        let cameras = cameras();
        for (side, place) in [0, 1].into_iter().flat_map(|side| places().map(move |at| (side, at))) {
            let back = cameras.raw(cameras.rectified(place, side), side).expect("a ray");
            assert!((0..2).all(|axis| (back[axis] - place[axis]).abs() < 1e-6), "{place:?} {back:?}");
        }
    }

    #[test]
    fn derivatives_are_those_of_small_changes() {
        let cameras = cameras();
        let step = 1e-6;
        for (left, right) in places().zip(places().skip(1)) {
            let (row, slopes) = cameras.row_derivatives([left, right]);
            assert!((row - cameras.row_difference([left, right])).abs() < 1e-9);

            for (index, slope) in slopes.iter().enumerate() {
                let changed = |by: f64| {
                    let mut numbers = *cameras.numbers();
                    numbers[index] += by;
                    cameras.with_numbers(numbers).row_difference([left, right])
                };
                let found = (changed(step) - changed(-step)) / (2.0 * step);
                assert!((found - slope).abs() < 1e-4, "number {index}: {found} {slope}");
            }
        }
    }

    #[test]
    fn usual_cameras_leave_images_as_they_are() {
        let cameras = Cameras::new([0.0; NUMBERS], USUAL, SIZE);
        for place in places() {
            let found = cameras.rectified(place, 1);
            assert!((0..2).all(|axis| (found[axis] - place[axis]).abs() < 1e-9));
        }
        assert!(cameras.distortion(0).0.abs() < 1e-12);
    }

    #[test]
    fn cameras_of_larger_images_see_the_same() {
        let (small, large) = (cameras(), cameras().resized((960, 1280)));
        for place in places() {
            let enlarged = |[x, y]: Point| [2.0 * x + 0.5, 2.0 * y + 0.5];
            let found = large.rectified(enlarged(place), 1);
            let expected = enlarged(small.rectified(place, 1));
            assert!((0..2).all(|axis| (found[axis] - expected[axis]).abs() < 1e-6));
        }
    }

    #[test]
    fn what_lies_beyond_a_fold_is_nowhere() {
        let mut numbers = [0.0; NUMBERS];
        numbers[K1] = -3.0;
        let cameras = Cameras::new(numbers, USUAL, SIZE);
        assert!(cameras.raw([320.0, 240.0], 0).is_some() && cameras.raw([5000.0, 240.0], 0).is_none());
        assert!(cameras.is_folded([640.0, 480.0], 0) && !cameras.is_folded([330.0, 240.0], 0));
        assert!(cameras.rectified([640.0, 480.0], 0).iter().all(|at| at.is_finite()));

        // Slopes fall below a tenth beyond a radius of 0.78, which appears at 0.58.
        (numbers[K1], numbers[K1 + 1]) = (-0.3, -0.2);
        let cameras = Cameras::new(numbers, [1.0; NUMBERS], SIZE);
        let [column, row] = cameras.sides()[0].center;
        let is_folded = |by: f64| cameras.is_folded([column, row + by * cameras.focal()], 0);
        assert!(is_folded(0.572) && !is_folded(0.565));
    }
}
