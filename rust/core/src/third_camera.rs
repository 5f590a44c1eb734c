//! Depths of the rectified left camera as seen by a third camera, such as a color camera beside the pair.
//!
//! ```text
//! p = the place of left pixel (x, y) in the third camera,   z = its depth there
//! area(x, y) = p +- half the way to its neighbors on the same surface: |difference of disparities| <= 1
//! source(q) = the left pixel with the least z among those whose area contains q; of equal ones, the first
//! hole(q): no source, and q is in the area of a left pixel without depth, drawn as deep as the background
//! occluded(q): neither, and the left camera has q in view at the depth of the background beside it
//! ```
//!
//! Lenses are those of OpenCV's `projectPoints` and `fisheye::projectPoints`.

use std::array::from_fn;

use crate::rectification::calibration::distorted;
use crate::rectification::cameras::{Matrix, Point, times};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::choices::JUMP;

/// Pixels of the third camera that a left pixel covers at most, either way.
const LARGEST: i32 = 64;
/// Pixels: neighbors share an edge, which rounding must not open.
const SLACK: f64 = 1e-3;
/// Factor of the widest angle in a distorted image: polynomials turn back beyond it.
const RIM: f64 = 1.05;
/// Most steps of Newton's method that undo a distortion.
const STEPS: usize = 50;
/// Largest error of the place found for a ray, in focal lengths.
const EXACT: f64 = 1e-10;

/// The effect of a lens on a place in focal lengths from the principal point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// Nothing.
    Pinhole,
    /// k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, and then the effect of a tilted sensor.
    Polynomial([f64; 12], Matrix),
    /// k1 to k4 of a fisheye lens.
    Fisheye([f64; 4]),
}

impl Lens {
    /// A lens from its 0, 4, 5, 8, 12 or 14 numbers, in OpenCV's order; a fisheye lens from 4.
    pub fn new(numbers: &[f64], is_fisheye: bool) -> Result<Self> {
        let count = numbers.len();
        let is_known = if is_fisheye { count == 4 } else { [0, 4, 5, 8, 12, 14].contains(&count) };
        if !is_known || numbers.iter().any(|number| !number.is_finite()) {
            let accepts = "4, 5, 8, 12 or 14 finite numbers, 4 of a fisheye lens";
            return Err(Error::value("distortion", format!("{numbers:?}"), accepts));
        }

        let number = |index: usize| numbers.get(index).copied().unwrap_or(0.0);
        Ok(match (count, is_fisheye) {
            (0, _) => Self::Pinhole,
            (_, true) => Self::Fisheye(from_fn(number)),
            _ => Self::Polynomial(from_fn(number), tilt(number(12), number(13))),
        })
    }

    /// The place to which the lens moves a place.
    fn bent(&self, flat: Point) -> Point {
        match self {
            Self::Pinhole => flat,
            Self::Polynomial(numbers, tilt) => {
                let [x, y] = distorted(numbers, flat);
                let [x, y, z] = tilt.map(|[a, b, c]| a * x + b * y + c);
                [x / z, y / z]
            }
            Self::Fisheye(numbers) => {
                let tangent = norm(flat);
                let by = angle_seen(numbers, math::atan2(tangent, 1.0)) / tangent;
                if tangent > 0.0 { flat.map(|at| at * by) } else { flat }
            }
        }
    }

    /// The place that the lens moves to this one; `None`: Newton's method does not find one.
    fn straight(&self, bent: Point) -> Option<Point> {
        match self {
            Self::Pinhole => Some(bent),
            Self::Polynomial(..) => self.straight_by_newton(bent),
            Self::Fisheye(numbers) => {
                let wanted = norm(bent);
                let mut angle = wanted.min(1.0);
                for _ in 0..STEPS {
                    let [low, high] = [-1e-6, 1e-6].map(|by| angle_seen(numbers, angle + by));
                    angle -= (angle_seen(numbers, angle) - wanted) * 2e-6 / (high - low);
                }
                let is_exact = (angle_seen(numbers, angle) - wanted).abs() < EXACT;
                let (sin, cos) = math::sin_cos(angle);
                let by = if wanted > 0.0 { sin / cos / wanted } else { 1.0 };
                (is_exact && angle >= 0.0 && cos > 0.0).then(|| bent.map(|at| at * by))
            }
        }
    }

    fn straight_by_newton(&self, bent: Point) -> Option<Point> {
        let mut at = bent;
        for _ in 0..STEPS {
            let [x, y] = self.bent(at);
            let off = [x - bent[0], y - bent[1]];
            if norm(off) < EXACT {
                return Some(at);
            }
            let slope = |by: Point| {
                let [one, other] = [1.0, -1.0].map(|s| self.bent([at[0] + s * by[0], at[1] + s * by[1]]));
                [(one[0] - other[0]) / 2e-6, (one[1] - other[1]) / 2e-6]
            };
            let [along, down] = [slope([1e-6, 0.0]), slope([0.0, 1e-6])];
            let determinant = along[0] * down[1] - down[0] * along[1];
            at[0] -= (down[1] * off[0] - down[0] * off[1]) / determinant;
            at[1] -= (along[0] * off[1] - along[1] * off[0]) / determinant;
        }
        None
    }
}

/// The angle at which a fisheye lens shows a point at an angle from its axis, radians.
fn angle_seen([k1, k2, k3, k4]: &[f64; 4], angle: f64) -> f64 {
    let square = angle * angle;
    angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
}

/// The effect of a sensor tilted about x and y, in radians.
fn tilt(about_x: f64, about_y: f64) -> Matrix {
    let (sin_x, cos_x) = math::sin_cos(about_x);
    let (sin_y, cos_y) = math::sin_cos(about_y);
    let along_x = [[1.0, 0.0, 0.0], [0.0, cos_x, sin_x], [0.0, -sin_x, cos_x]];
    let along_y = [[cos_y, 0.0, -sin_y], [0.0, 1.0, 0.0], [sin_y, 0.0, cos_y]];
    let both = times(&along_y, &along_x);
    let [z, x, y] = [both[2][2], both[0][2], both[1][2]];
    times(&[[z, 0.0, -x], [0.0, z, -y], [0.0, 0.0, 1.0]], &both)
}

/// The rectified left camera: focal lengths and principal point, pixels, and the distance of the right one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftCamera {
    /// Along x and y.
    pub focal: Point,
    /// Column and row.
    pub center: Point,
    /// In the unit of depths.
    pub baseline: f64,
}

impl LeftCamera {
    fn ray(&self, x: usize, y: usize) -> [f64; 3] {
        let [x, y] = [(x, 0), (y, 1)].map(|(at, k)| (at as f64 - self.center[k]) / self.focal[k]);
        [x, y, 1.0]
    }
}

/// A camera beside a rectified pair: `rotation X + translation` maps the left camera's points to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThirdCamera {
    focal: Point,
    center: Point,
    lens: Lens,
    rotation: Matrix,
    translation: [f64; 3],
    size: (usize, usize),
    rim: f64,
}

/// Depths as a third camera sees them, each map of its size.
#[derive(Debug, Clone, PartialEq)]
pub struct Registered {
    /// The left pixel that each pixel sees, as an index into the flat map; -1 without one.
    pub source: Plane<i64>,
    /// Along its axis; NaN without one.
    pub depth: Plane<f32>,
    /// No depth, although the left camera sees the point.
    pub holes: Plane<bool>,
    /// No depth, because something hides the point from the left camera.
    pub occluded: Plane<bool>,
}

/// The part of the third camera that a left pixel covers, up to but excluding `right` and `bottom`, and its
/// depth.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Covered {
    left: i32,
    top: i32,
    right: i32,
    bottom: i32,
    depth: f32,
}

impl ThirdCamera {
    /// A camera from a matrix (its skew is 0), with images of `size`: rows, columns.
    pub fn new(
        matrix: &Matrix,
        lens: Lens,
        (rotation, translation): (Matrix, [f64; 3]),
        size: (usize, usize),
    ) -> Self {
        let [[fx, _, cx], [_, fy, cy], _] = *matrix;
        let mut camera =
            Self { focal: [fx, fy], center: [cx, cy], lens, rotation, translation, size, rim: f64::INFINITY };
        if lens != Lens::Pinhole {
            let (rows, cols) = (size.0 as i64, size.1 as i64);
            let ends = (-1..=cols).flat_map(|x| [[x, -1], [x, rows]]);
            let sides = (-1..=rows).flat_map(|y| [[-1, y], [cols, y]]);
            let seen = ends.chain(sides).filter_map(|at| camera.flat(at.map(|at| at as f64)));
            camera.rim = RIM * seen.map(norm).fold(0.0, f64::max);
        }
        camera
    }

    /// x and y of the ray of depth 1 of a pixel; `None`: the lens shows no ray there.
    pub fn flat(&self, pixel: Point) -> Option<Point> {
        self.lens.straight(from_fn(|k| (pixel[k] - self.center[k]) / self.focal[k]))
    }

    /// Column, row and depth of a point of the left camera; `None`: behind this camera, or beyond the lens's
    /// view.
    fn seen(&self, point: [f64; 3]) -> Option<[f64; 3]> {
        let [x, y, z] = from_fn(|k| dot(self.rotation[k], point) + self.translation[k]);
        let flat = [x / z, y / z];
        if !(z > 0.0 && norm(flat) <= self.rim) {
            return None;
        }
        let [x, y] = self.lens.bent(flat);
        Some([x * self.focal[0] + self.center[0], y * self.focal[1] + self.center[1], z])
    }

    /// Depths along rays of the left camera as depths of this one, at the pixels that have a source.
    pub fn moved(&self, depth: &Plane<f32>, source: &Plane<i64>, left: &LeftCamera) -> Plane<f32> {
        source.map(|index| {
            let found = usize::try_from(*index).ok().and_then(|index| {
                let ray = left.ray(index % depth.cols(), index / depth.cols());
                let along = dot(self.rotation[2], ray);
                depth.as_slice().get(index).map(|z| along * f64::from(*z) + self.translation[2])
            });
            found.map_or(f32::NAN, |z| z as f32)
        })
    }

    /// Whether the point at a pixel and a depth is in the left image, of `rows` and `cols`.
    fn is_in_left_view(
        &self,
        pixel: Point,
        depth: f32,
        left: &LeftCamera,
        (rows, cols): (usize, usize),
    ) -> bool {
        let Some([x, y]) = self.flat(pixel) else { return false };
        let z = f64::from(depth);
        let moved: [f64; 3] = from_fn(|k| [x * z, y * z, z][k] - self.translation[k]);
        let point: [f64; 3] = from_fn(|k| (0..3).map(|i| self.rotation[i][k] * moved[i]).sum());
        let ends = [cols as f64 - 0.5, rows as f64 - 0.5];
        let at = |k: usize| point[k] / point[2] * left.focal[k] + left.center[k];
        point[2] > 0.0 && (0..2).all(|k| (-0.5..=ends[k]).contains(&at(k)))
    }
}

/// Depths of the left camera (NaN: none) as a third camera sees them.
pub fn register(
    depth: &Plane<f32>,
    left: &LeftCamera,
    camera: &ThirdCamera,
    control: &Control,
) -> Result<Registered> {
    // Pixels without depth are drawn as the background beside them, to see where they may be.
    let areas = areas(&with_background(depth.clone()), left, camera, control)?;
    let (source, mut seen) = nearest(&areas, depth, camera.size, f32::is_finite, control)?;
    for (z, source) in seen.as_mut_slice().iter_mut().zip(source.as_slice()) {
        *z = if *source < 0 { f32::NAN } else { *z };
    }

    let (missing, _) = nearest(&areas, depth, camera.size, |z| !z.is_finite(), control)?;
    let is_hole = |y, x| source.row(y)[x] < 0 && missing.row(y)[x] >= 0;
    let holes = Plane::by_pixels(camera.size, control, is_hole)?;

    let (size, around) = (depth.size(), with_background(seen.clone()));
    let occluded = Plane::by_pixels(camera.size, control, |y, x| {
        let (z, is_known) = (around.row(y)[x], source.row(y)[x] >= 0 || holes.row(y)[x]);
        !is_known && camera.is_in_left_view([x as f64, y as f64], z, left, size)
    })?;
    Ok(Registered { source, depth: seen, holes, occluded })
}

/// The area of each left pixel.
fn areas(
    depth: &Plane<f32>,
    left: &LeftCamera,
    camera: &ThirdCamera,
    control: &Control,
) -> Result<Plane<Covered>> {
    let size = depth.size();
    let seen: Plane<[f64; 3]> = Plane::by_pixels(size, control, |y, x| {
        let point = left.ray(x, y).map(|at| at * f64::from(depth.row(y)[x]));
        camera.seen(point).unwrap_or([f64::NAN; 3])
    })?;

    Plane::by_pixels(size, control, |y, x| {
        let [place @ .., z] = seen.row(y)[x];
        if !z.is_finite() {
            return Covered::default();
        }
        let ahead = f64::from(depth.row(y)[x]);
        let half: Point = from_fn(|k| camera.focal[k] / left.focal[0] * (ahead / z) / 2.0);
        let disparity = |z: f32| left.focal[0] * left.baseline / f64::from(z);
        let way = |row: usize, col: usize| -> Option<Point> {
            let off = (disparity(depth.row(row)[col]) - disparity(depth.row(y)[x])).abs();
            let way = from_fn(|k| (seen.row(row)[col][k] - place[k]) / 2.0);
            (off <= f64::from(JUMP) && way.iter().all(|way: &f64| way.is_finite())).then_some(way)
        };
        let along = [
            [x.checked_sub(1).map(|x| (y, x)), (x + 1 < size.1).then_some((y, x + 1))],
            [y.checked_sub(1).map(|y| (y, x)), (y + 1 < size.0).then_some((y + 1, x))],
        ];
        let ways = along.map(|sides| sides.map(|side| side.and_then(|(y, x)| way(y, x))));
        area_of([place[0], place[1]], z as f32, &ways, |axis| from_fn(|k| half[k] * camera.rotation[k][axis]))
    })
}

/// An area that extends halfway to its neighbors, before and after along x and y. Where a surface ends, a
/// pixel extends as far as toward its other side; without neighbors, it has the size `alone`.
fn area_of(
    place: Point,
    depth: f32,
    ways: &[[Option<Point>; 2]; 2],
    alone: impl Fn(usize) -> Point,
) -> Covered {
    let (mut low, mut high) = ([0.0f64; 2], [0.0f64; 2]);
    for (axis, [before, after]) in ways.iter().enumerate() {
        let opposite = |way: Point| way.map(|at| -at);
        let after = after.or(before.map(opposite)).unwrap_or_else(|| alone(axis));
        let before = before.unwrap_or_else(|| opposite(after));
        for k in 0..2 {
            low[k] = low[k].min(after[k]).min(before[k]);
            high[k] = high[k].max(after[k]).max(before[k]);
        }
    }

    let [[left, right], [top, bottom]] = from_fn(|k| {
        let [low, high] = [low[k], high[k]].map(|by| (place[k] + by - SLACK).ceil());
        // An area smaller than a pixel covers the pixel that contains it.
        let nearest = place[k].round_ties_even();
        if high > low { [low as i32, high as i32] } else { [nearest as i32, (nearest + 1.0) as i32] }
    });
    Covered { left, top, right, bottom, depth }
}

/// For each pixel, the left pixel with a `chosen` depth that it sees (-1: none), and its depth.
fn nearest(
    areas: &Plane<Covered>,
    depth: &Plane<f32>,
    (rows, cols): (usize, usize),
    chosen: impl Fn(f32) -> bool,
    control: &Control,
) -> Result<(Plane<i64>, Plane<f32>)> {
    let (mut source, mut seen) = (Plane::new(rows, cols)?, Plane::new(rows, cols)?);
    source.as_mut_slice().fill(-1);
    seen.as_mut_slice().fill(f32::INFINITY);

    let inside = |start: i32, stop: i32, end: usize| {
        let stop = stop.min(start.saturating_add(LARGEST)).min(end as i32);
        start.max(0) as usize..stop.max(0) as usize
    };
    for y in 0..areas.rows() {
        control.checkpoint()?;
        for (x, area) in areas.row(y).iter().enumerate() {
            if !chosen(depth.row(y)[x]) {
                continue;
            }
            for row in inside(area.top, area.bottom, rows) {
                for col in inside(area.left, area.right, cols) {
                    if area.depth < seen.row(row)[col] {
                        seen.row_mut(row)[col] = area.depth;
                        source.row_mut(row)[col] = (y * areas.cols() + x) as i64;
                    }
                }
            }
        }
    }
    Ok((source, seen))
}

/// Depths with holes filled to the depth of the farther side, along rows, then columns.
fn with_background(mut depth: Plane<f32>) -> Plane<f32> {
    let (rows, cols) = depth.size();
    for y in 0..rows {
        fill_line(depth.as_mut_slice(), y * cols, 1, cols);
    }
    for x in 0..cols {
        fill_line(depth.as_mut_slice(), x, cols, rows);
    }
    depth
}

fn fill_line(values: &mut [f32], first: usize, step: usize, count: usize) {
    let at = |index: usize| first + index * step;
    let mut start = 0;
    while start < count {
        let end = (start..count).find(|index| values[at(*index)].is_finite()).unwrap_or(count);
        let before = if start > 0 { values[at(start - 1)] } else { f32::NAN };
        let after = if end < count { values[at(end)] } else { f32::NAN };
        for index in start..end {
            values[at(index)] = before.max(after);
        }
        start = end + 1;
    }
}

fn norm([x, y]: Point) -> f64 {
    (x * x + y * y).sqrt()
}

fn dot(one: [f64; 3], other: [f64; 3]) -> f64 {
    one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEFT: LeftCamera = LeftCamera { focal: [40.0, 42.0], center: [19.5, 14.5], baseline: 0.1 };
    const SIZE: (usize, usize) = (30, 40);

    fn camera(lens: Lens) -> ThirdCamera {
        let (sin, cos) = math::sin_cos(0.1);
        let rotation = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]];
        let matrix = [[70.0, 0.0, 31.5], [0.0, 68.0, 23.5], [0.0, 0.0, 1.0]];
        ThirdCamera::new(&matrix, lens, (rotation, [0.04, -0.02, 0.03]), (48, 64))
    }

    fn lenses() -> [Lens; 4] {
        let all = [-0.2, 0.05, 0.001, -0.002, 0.01, 0.02, 0.01, 0.003, 1e-3, 2e-3, -1e-3, 1e-3, 0.02, -0.03];
        let lens = |numbers: &[f64], fisheye| Lens::new(numbers, fisheye).expect("a lens");
        [Lens::Pinhole, lens(&all[..5], false), lens(&all, false), lens(&[0.05, -0.01, 0.002, 0.0], true)]
    }

    /// A box before a slanted wall, with holes in both, and at the border.
    fn scene() -> Plane<f32> {
        Plane::from_fn(SIZE.0, SIZE.1, |y, x| match (y, x) {
            (4..8, 5..9) | (16..19, 18..21) | (_, 0..2) => f32::NAN,
            (10..22, 14..26) => 0.7,
            _ => 2.0 + 0.01 * x as f32 - 0.02 * y as f32,
        })
    }

    #[test]
    fn each_pixel_sees_the_nearest_of_the_areas_that_hold_it() {
        let control = Control::default();
        for lens in lenses() {
            let (depth, third) = (scene(), camera(lens));
            let found = register(&depth, &LEFT, &third, &control).expect("memory");
            let areas = areas(&with_background(depth.clone()), &LEFT, &third, &control).expect("memory");
            for (row, col) in (0..48).flat_map(|row| (0..64).map(move |col| (row, col))) {
                let (y, x) = (row as i32, col as i32);
                let holds = |area: &Covered| {
                    (area.left..area.right).contains(&x) && (area.top..area.bottom).contains(&y)
                };
                let (mut best, mut is_hole) = (None, false);
                for (index, area) in areas.as_slice().iter().enumerate().filter(|(_, area)| holds(area)) {
                    if !depth.as_slice()[index].is_finite() {
                        is_hole = true;
                    } else if best.is_none_or(|(z, _)| area.depth < z) {
                        best = Some((area.depth, index));
                    }
                }

                let (z, source) = best.map_or((f32::NAN, -1), |(z, index)| (z, index as i64));
                assert_eq!(found.source.row(row)[col], source);
                assert_eq!(found.depth.row(row)[col].to_bits(), z.to_bits());
                assert_eq!(found.holes.row(row)[col], best.is_none() && is_hole);
                assert!(!found.occluded.row(row)[col] || (best.is_none() && !is_hole));
            }
            let known = found.source.as_slice().iter().filter(|source| **source >= 0).count();
            assert!(known > 1000, "{known}");
            assert!(found.holes.as_slice().contains(&true) && found.occluded.as_slice().contains(&true));

            let moved = third.moved(&depth, &found.source, &LEFT);
            for (moved, z) in moved.as_slice().iter().zip(found.depth.as_slice()) {
                assert!((moved - z).abs() < 1e-5 || (moved.is_nan() && z.is_nan()));
            }
        }
    }

    #[test]
    fn a_lens_is_undone() {
        for third in lenses().map(camera) {
            for pixel in [[0.0, 0.0], [63.0, 2.0], [31.5, 23.5], [40.0, 47.0]] {
                let [x, y] = third.flat(pixel).expect("a ray");
                let bent = third.lens.bent([x, y]);
                for k in 0..2 {
                    assert!((bent[k] * third.focal[k] + third.center[k] - pixel[k]).abs() < 1e-6);
                }
            }
        }
        assert!(Lens::new(&[0.1; 6], false).is_err() && Lens::new(&[0.1; 5], true).is_err());
    }
}
