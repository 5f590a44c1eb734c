//! Calibrated cameras: how their images are turned and projected so that rows correspond, and the place of
//! each rectified pixel in the raw image. All of it follows OpenCV's `stereoRectify` and
//! `initUndistortRectifyMap`, including their rounding to single precision, so places are bit-identical
//! except for the last bits of doubles.

use std::array::from_fn;

use super::cameras::{Camera, Cameras, Matrix, times};
use super::warp::Places;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::pair::fitting::Fit;

/// Steps that undo the distortion of a corner.
const STEPS: usize = 5;
/// Largest deviation of a rotation matrix from a true one, as from digits left out in a file.
const ROUNDED: f64 = 1e-3;

type Vector = [f64; 3];
/// Rows and columns of the left and of the right image.
pub type Sizes = [(usize, usize); 2];

/// Two calibrated cameras and their rectification, by OpenCV's names; left and right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Camera matrices K1 and K2, pixels.
    pub camera: [Matrix; 2],
    /// Distortions D1 and D2: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4; 0 for unknown ones.
    pub distortion: [[f64; 12]; 2],
    /// R1 and R2: from the raw camera to the rectified one.
    pub rotation: [Matrix; 2],
    /// P1 and P2: from the rectified left camera to the pixels of the rectified images.
    pub projection: [[[f64; 4]; 3]; 2],
}

impl Calibration {
    /// Cameras with the right one turned by `R` and moved by `T` relative to the left one: `X_right = R
    /// X_left + T`. Images of this many rows and columns are rectified as by `stereoRectify` with
    /// `CALIB_ZERO_DISPARITY` and its default `alpha`.
    pub fn new(
        camera: [Matrix; 2],
        distortion: [[f64; 12]; 2],
        (rotation, translation): (Matrix, Vector),
        (rows, cols): (usize, usize),
    ) -> Result<Self> {
        let half = half_turn(&rotation)?;
        let moved = applied(&half, translation);
        let along = [if moved[0] > 0.0 { 1.0 } else { -1.0 }, 0.0, 0.0];
        if moved[1].abs() >= moved[0].abs() || moved.iter().any(|at| !at.is_finite()) {
            let got = format!("one that leads to {moved:?}");
            let accepts =
                "that of cameras side by side; turn images of cameras one above the other by 90 degrees";
            return Err(Error::value("translation", got, accepts));
        }

        // Both are turned by half, and together until the columns lie along the line between them.
        let across = cross(moved, along);
        let angle = math::atan2(norm(across), moved[0].abs());
        let both = turned(scaled(across, angle / norm(across)));
        let rotation = [times(&both, &transposed(&half)), times(&both, &half)];

        let focal = 0.5 * (camera[0][1][1] + camera[1][1][1]);
        let center = [0, 1].map(|side| {
            let corner = [cols as f64 - 1.0, rows as f64 - 1.0];
            let seen = |at: [f64; 2]| {
                let [x, y] = undistorted(&camera[side], &distortion[side], at);
                let [x, y, z] = applied(&rotation[side], [x, y, 1.0]);
                [x, y].map(|at| f64::from((focal * at / z) as f32))
            };
            let corners = [[0.0; 2], [corner[0], 0.0], [0.0, corner[1]], corner].map(seen);
            let mean = |axis: usize| corners.iter().map(|at| at[axis]).sum::<f64>() / 4.0;
            [0, 1].map(|axis| 0.5 * corner[axis] - mean(axis))
        });
        let [cx, cy] = [0, 1].map(|axis| 0.5 * (center[0][axis] + center[1][axis]));
        let baseline = focal * applied(&rotation[1], translation)[0];
        let projection = |last| [[focal, 0.0, cx, last], [0.0, focal, cy, 0.0], [0.0, 0.0, 1.0, 0.0]];

        let found =
            Self { camera, distortion, rotation, projection: [projection(0.0), projection(baseline)] };
        found.inverses().map(|_| found)
    }

    /// Cameras that were estimated from images: the distance between them is unknown.
    pub fn of_cameras(cameras: &Cameras) -> Self {
        let (focal, sides) = (cameras.focal(), cameras.sides());
        let projection = |side: usize| {
            let [x, y] = cameras.center(side);
            [[focal, 0.0, x, 0.0], [0.0, focal, y, 0.0], [0.0, 0.0, 1.0, 0.0]]
        };

        Self {
            camera: sides.each_ref().map(|Camera { focal, center: [x, y], .. }| {
                [[*focal, 0.0, *x], [0.0, *focal, *y], [0.0, 0.0, 1.0]]
            }),
            distortion: sides.each_ref().map(|camera| {
                let mut distortion = [0.0; 12];
                distortion[..2].copy_from_slice(&camera.distortion);
                distortion
            }),
            rotation: sides.each_ref().map(|camera| camera.rotation),
            projection: [projection(0), projection(1)],
        }
    }

    /// The same for right images that are scaled to the size of the left ones, if K2 is that of the original
    /// images.
    pub fn fitted(mut self, [left, right]: Sizes) -> Result<Self> {
        self.camera[1] = times(&Fit::new(right, left)?.matrix(), &self.camera[1]);
        Ok(self)
    }

    /// The same for original right images, if K2 is that of images scaled to the size of the left ones.
    pub fn as_they_come(mut self, [left, right]: Sizes) -> Result<Self> {
        let back = inverse(&Fit::new(right, left)?.matrix());
        self.camera[1] = back.map_or(self.camera[1], |back| times(&back, &self.camera[1]));
        Ok(self)
    }

    /// OpenCV's matrix Q, which turns disparities into points; `None`: the distance between the cameras is
    /// unknown.
    pub fn q(&self) -> Result<Option<[[f64; 4]; 4]>> {
        let [left, right] = &self.projection;
        let [along, down] = [0, 1].map(|axis| right[axis][3] - left[axis][3]);
        if along > 0.0 || down.abs() > along.abs() {
            let got = "a right camera that is not on the right of the left one";
            let accepts = "cameras side by side, in this order";
            return Err(Error::value("calibration", got, accepts));
        }
        if along == 0.0 {
            return Ok(None);
        }

        let focal = left[0][0];
        let row = focal / left[1][1];
        Ok(Some([
            [1.0, 0.0, 0.0, -left[0][2]],
            [0.0, row, 0.0, -left[1][2] * row],
            [0.0, 0.0, 0.0, focal],
            [0.0, 0.0, -focal / along, (left[0][2] - right[0][2]) * focal / along],
        ]))
    }

    /// The raw place of each pixel of the rectified left and right images, of this many rows and columns.
    pub fn places(&self, size: (usize, usize), control: &Control) -> Result<[Places; 2]> {
        let [left, right] = self.inverses()?;
        Ok([self.places_of(0, &left, size, control)?, self.places_of(1, &right, size, control)?])
    }

    fn places_of(
        &self,
        camera: usize,
        inverse: &Matrix,
        size: (usize, usize),
        control: &Control,
    ) -> Result<Places> {
        let [[fx, _, cx], [_, fy, cy], _] = self.camera[camera];
        Plane::by_pixels(size, control, |y, x| {
            let [x, y, z] = applied(inverse, [x as f64, y as f64, 1.0]);
            let [x, y] = distorted(&self.distortion[camera], [x / z, y / z]);
            [(fx * x + cx) as f32, (fy * y + cy) as f32]
        })
    }

    /// From the pixels of the rectified images to rays of the raw cameras.
    fn inverses(&self) -> Result<[Matrix; 2]> {
        let inverse = |side: usize| {
            let square = self.projection[side].map(|[a, b, c, _]| [a, b, c]);
            inverse(&times(&square, &self.rotation[side]))
        };
        let numbers = [self.camera.as_flattened(), self.rotation.as_flattened()].concat();
        let mut numbers = numbers.as_flattened().iter().chain(self.distortion.as_flattened());

        let refused = || {
            let got = "numbers by which no pixel is found";
            Error::value("calibration", got, "finite ones, with focal lengths that are not 0")
        };
        let is_finite = numbers.all(|number| number.is_finite());
        let both = inverse(0).zip(inverse(1)).filter(|_| is_finite).ok_or_else(refused)?;
        Ok([both.0, both.1])
    }
}

/// The place to which a lens moves a place, in focal lengths from the principal point.
pub fn distorted(
    &[k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4]: &[f64; 12],
    [x, y]: [f64; 2],
) -> [f64; 2] {
    let (xx, yy, xy) = (x * x, y * y, 2.0 * x * y);
    let square = xx + yy;
    let longer = (1.0 + ((k3 * square + k2) * square + k1) * square)
        / (1.0 + ((k6 * square + k5) * square + k4) * square);

    [
        x * longer + p1 * xy + p2 * (square + 2.0 * xx) + s1 * square + s2 * square * square,
        y * longer + p1 * (square + 2.0 * yy) + p2 * xy + s3 * square + s4 * square * square,
    ]
}

/// The place of a raw pixel without distortion, in focal lengths from the principal point.
fn undistorted(camera: &Matrix, distortion: &[f64; 12], raw: [f64; 2]) -> [f64; 2] {
    let start: [f64; 2] = from_fn(|axis| (raw[axis] - camera[axis][2]) / camera[axis][axis]);
    let radial = |index: usize| distortion[index];
    let [over, under] = [[7, 6, 5], [4, 1, 0]].map(|indices| indices.map(radial));
    let mut bent = *distortion;
    for index in [0, 1, 4, 5, 6, 7] {
        bent[index] = 0.0;
    }

    let mut place = start;
    for _ in 0..STEPS {
        let square = place[0] * place[0] + place[1] * place[1];
        let polynomial = |[c, b, a]: [f64; 3]| 1.0 + ((c * square + b) * square + a) * square;
        let shorter = polynomial(over) / polynomial(under);
        if shorter < 0.0 {
            place = start;
            break;
        }
        let moved = distorted(&bent, place);
        place = from_fn(|axis| (start[axis] - (moved[axis] - place[axis])) * shorter);
    }
    place.map(|at| f64::from(at as f32))
}

/// Half of the inverse of a rotation.
fn half_turn(rotation: &Matrix) -> Result<Matrix> {
    let refused = || {
        let accepts = "a rotation of less than 90 degrees";
        Error::value("rotation", format!("{rotation:?}"), accepts)
    };

    // The nearest rotation, which compensates digits left out in a file.
    let mut nearest = *rotation;
    for _ in 0..3 {
        let other = transposed(&inverse(&nearest).ok_or_else(refused)?);
        nearest = from_fn(|row| from_fn(|col| 0.5 * (nearest[row][col] + other[row][col])));
    }
    let off = |row: usize, col: usize| (nearest[row][col] - rotation[row][col]).abs();
    let is_one = (0..9).all(|at| off(at / 3, at % 3) < ROUNDED);

    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = nearest;
    let axis = [zy - yz, xz - zx, yx - xy].map(|at| 0.5 * at);
    let (sin, cos) = (norm(axis), 0.5 * (xx + yy + zz - 1.0));
    if !is_one || cos <= 0.0 {
        return Err(refused());
    }
    Ok(turned(scaled(axis, -0.5 * math::atan2(sin, cos) / sin)))
}

/// The rotation about a vector by its length in radians.
fn turned(axis: Vector) -> Matrix {
    let angle = norm(axis);
    let [x, y, z] = scaled(axis, 1.0 / angle);
    let (sin, cos) = math::sin_cos(angle);

    let skew = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    let along = [x, y, z];
    from_fn(|row| {
        from_fn(|col| {
            let own = if row == col { cos } else { 0.0 };
            own + (1.0 - cos) * along[row] * along[col] + sin * skew[row][col]
        })
    })
}

fn inverse(matrix: &Matrix) -> Option<Matrix> {
    let [a, b, c] = *matrix;
    let columns = [cross(b, c), cross(c, a), cross(a, b)];
    let determinant: f64 = (0..3).map(|k| a[k] * columns[0][k]).sum();
    let is_one = determinant != 0.0 && determinant.is_finite();
    is_one.then(|| transposed(&columns.map(|column| column.map(|value| value / determinant))))
}

fn transposed(matrix: &Matrix) -> Matrix {
    from_fn(|row| from_fn(|col| matrix[col][row]))
}

fn applied(matrix: &Matrix, [x, y, z]: Vector) -> Vector {
    matrix.map(|[a, b, c]| a * x + b * y + c * z)
}

fn cross(one: Vector, other: Vector) -> Vector {
    from_fn(|k| one[(k + 1) % 3] * other[(k + 2) % 3] - one[(k + 2) % 3] * other[(k + 1) % 3])
}

fn norm([x, y, z]: Vector) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// A vector times a number; 0 stays 0 whatever the number.
fn scaled(vector: Vector, by: f64) -> Vector {
    vector.map(|at| if at == 0.0 { 0.0 } else { at * by })
}
