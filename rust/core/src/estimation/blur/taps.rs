//! Kernels of taps: of Gaussians, disks, annuli and paths.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2};

use phasestereo_match::base::math;

/// A square kernel of odd side whose taps have the sum 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Taps {
    /// Taps on either side of the center.
    pub reach: usize,
    /// Row after row.
    pub values: Vec<f64>,
}

/// Sub-samples of a pixel in each direction under a disk or an annulus.
const DISK_SAMPLES: usize = 8;
/// Samples of a path per pixel of its length.
const MOTION_SAMPLES: f64 = 16.0;

impl Taps {
    /// A kernel with `reach` taps on either side, from values with a nonzero sum.
    pub fn new(reach: usize, mut values: Vec<f64>) -> Self {
        debug_assert_eq!(values.len(), (2 * reach + 1).pow(2));

        let sum: f64 = values.iter().sum();
        for value in &mut values {
            *value /= sum;
        }

        Self { reach, values }
    }

    /// Taps along one side.
    pub fn side(&self) -> usize {
        2 * self.reach + 1
    }

    /// The taps as (dy, dx, value) relative to the center.
    pub fn places(&self) -> impl Iterator<Item = (isize, isize, f64)> + '_ {
        let (side, reach) = (self.side(), self.reach as isize);

        self.values
            .iter()
            .enumerate()
            .map(move |(i, value)| ((i / side) as isize - reach, (i % side) as isize - reach, *value))
    }

    /// The smallest share of texture that is left at half the highest frequency, a period of 4 pixels, along
    /// rows, columns and both diagonals.
    pub fn least_response(&self) -> f64 {
        let along = |down: f64, across: f64| {
            let (mut real, mut imaginary) = (0.0, 0.0);
            for (dy, dx, value) in self.places() {
                let (sine, cosine) = math::sin_cos(FRAC_PI_2 * (down * dy as f64 + across * dx as f64));
                real += value * cosine;
                imaginary += value * sine;
            }
            math::hypot(real, imaginary)
        };
        let diagonal = FRAC_1_SQRT_2;
        [(0.0, 1.0), (1.0, 0.0), (diagonal, diagonal), (diagonal, -diagonal)]
            .into_iter()
            .map(|(down, across)| along(down, across))
            .fold(1.0, f64::min)
    }

    /// Root mean square distance of the taps from their mean, pixels.
    pub fn radius(&self) -> f64 {
        let [down, across, _] = self.moments();
        (down + across).max(0.0).sqrt()
    }

    /// The standard deviation in the direction where it is smallest, pixels: nearly 0 for a motion.
    pub fn least_spread(&self) -> f64 {
        let [down, across, both] = self.moments();
        let least = f64::midpoint(down, across) - math::hypot((down - across) / 2.0, both);
        least.max(0.0).sqrt()
    }

    /// The second moments around the mean, which may differ from the center: down, across, and mixed.
    fn moments(&self) -> [f64; 3] {
        let moment = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            self.places().map(|(dy, dx, value)| value * of(dy as f64, dx as f64)).sum()
        };
        let (y, x) = (moment(&|y, _| y), moment(&|_, x| x));
        let down = moment(&|dy, _| (dy - y).powi(2));
        let across = moment(&|_, dx| (dx - x).powi(2));
        [down, across, moment(&|dy, dx| (dy - y) * (dx - x))]
    }
}

/// A Gaussian that is cut off at four standard deviations.
pub fn gaussian(sigma: f64) -> Taps {
    let reach = (4.0 * sigma + 0.5) as usize;

    let side = 0..=2 * reach;
    let profile: Vec<f64> = side
        .map(|i| math::exp(-0.5 * ((i as f64 - reach as f64) / sigma.max(f64::MIN_POSITIVE)).powi(2)))
        .collect();

    // A Gaussian is separable: the outer product of its profile.
    let rows = profile.iter().flat_map(|a| profile.iter().map(move |b| a * b));
    Taps::new(reach, rows.collect())
}

/// An annulus, or a disk if `inner` is 0, integrated over each pixel by counting samples.
pub fn annulus(radius: f64, inner: f64) -> Taps {
    let reach = (radius - 0.5).ceil().max(0.0) as usize;
    let side = 2 * reach + 1;
    let samples = side * DISK_SAMPLES;
    let place = |i: usize| (i as f64 + 0.5) / DISK_SAMPLES as f64 - 0.5 - reach as f64;

    let mut values = vec![0.0; side * side];
    let hole = (inner * radius).powi(2);

    for i in 0..samples {
        let y = place(i);
        for j in 0..samples {
            let square = y * y + place(j).powi(2);
            if square <= radius * radius && (square > hole || inner == 0.0) {
                values[i / DISK_SAMPLES * side + j / DISK_SAMPLES] += 1.0;
            }
        }
    }

    // Without a sample between the radii, the kernel is a point.
    if values.iter().all(|value| *value == 0.0) {
        values[side * side / 2] = 1.0;
    }

    Taps::new(reach, values)
}

/// A straight path of a length and a direction, degrees: its samples are split bilinearly over their four
/// pixels.
pub fn motion(length: f64, angle: f64) -> Taps {
    // A path between the centers of pixels is one pixel shorter than the pixels that it covers.
    let half = (length - 1.0).max(0.0) / 2.0;
    let samples = (length * MOTION_SAMPLES).round().max(1.0) as usize + 1;
    let steps = (0..samples).map(|i| -half + 2.0 * half * i as f64 / (samples - 1) as f64);

    let (sine, cosine) = math::sin_cos(angle.to_radians());
    path(steps.map(|step| (exact(step * sine), exact(step * cosine))))
}

/// A coordinate without rounding errors, so that right angles are exact: the computed cosine of 90 degrees is
/// 6e-17.
fn exact(value: f64) -> f64 {
    (value * 1e12).round() / 1e12
}

/// A kernel of samples (y, x), each split bilinearly over its four pixels.
pub fn path(samples: impl Iterator<Item = (f64, f64)>) -> Taps {
    let samples: Vec<_> = samples.collect();
    let farthest = samples.iter().map(|(y, x)| y.abs().max(x.abs())).fold(0.0, f64::max);
    let reach = farthest.ceil() as usize;

    // One more row and column for the far neighbors of the ends, which have no weight.
    let (side, wide) = (2 * reach + 1, 2 * reach + 2);

    let mut values = vec![0.0; wide * wide];

    for (y, x) in samples {
        let (top, left) = (y.floor(), x.floor());
        let place = |offset: f64| (offset + reach as f64) as usize;

        for (row, down) in [(top, 1.0 - (y - top)), (top + 1.0, y - top)] {
            for (col, along) in [(left, 1.0 - (x - left)), (left + 1.0, x - left)] {
                values[place(row) * wide + place(col)] += down * along;
            }
        }
    }

    let rows = values.chunks(wide).take(side).flat_map(|row| &row[..side]);
    Taps::new(reach, rows.copied().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_need_not_be_symmetric() {
        let taps = path([(0.0, 0.0), (0.0, 1.0), (2.0, 1.5)].into_iter());
        assert_eq!(taps.reach, 2);
        let tap = |y: usize, x: usize| taps.values[y * taps.side() + x];
        let expected = [(2, 2, 1.0), (2, 3, 1.0), (4, 3, 0.5), (4, 4, 0.5)];
        assert!(expected.iter().all(|(y, x, tap_)| (tap(*y, *x) - tap_ / 3.0).abs() < 1e-12));
    }
}
