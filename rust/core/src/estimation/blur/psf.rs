//! Point-spread functions: the families of lenses and shutters, as kernels of taps.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2};

use serde::{Deserialize, Serialize};

use phasestereo_match::base::math;

/// A family of point-spread functions of one size each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Family {
    /// Gaussian; the size is its standard deviation.
    Gaussian,
    /// Defocus of a round aperture; the size is the disk's radius.
    Disk,
    /// Straight motion at constant speed; the size is its length, of which 1 is none.
    Motion,
    /// Defocus of a round aperture whose middle is covered, as by the small mirror of a mirror lens; the size is the outer
    /// radius.
    Annulus,
}

/// A point-spread function of a family.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Psf {
    /// Its family.
    pub family: Family,
    /// Its size, pixels.
    pub size: f64,
    /// Direction of a motion, degrees from x towards y; 0 for others.
    pub angle: f64,
    /// Inner radius of an annulus as a share of the outer one; 0 for others.
    pub inner: f64,
}

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

impl Psf {
    /// One of a family that has neither a direction nor a hole.
    pub fn round(family: Family, size: f64) -> Self {
        Self { family, size, angle: 0.0, inner: 0.0 }
    }

    /// Motion in a direction.
    pub fn motion(length: f64, angle: f64) -> Self {
        Self { family: Family::Motion, size: length, angle, inner: 0.0 }
    }

    /// Between two radii, the inner one as a share of the outer one.
    pub fn annulus(radius: f64, inner: f64) -> Self {
        Self { family: Family::Annulus, size: radius, angle: 0.0, inner }
    }

    /// The kernel: a Gaussian cut at four standard deviations, a disk or an annulus integrated over each pixel, a path
    /// whose samples are split bilinearly over their four pixels.
    pub fn taps(&self) -> Taps {
        match self.family {
            Family::Gaussian => gaussian(self.size),
            Family::Disk => annulus(self.size, 0.0),
            Family::Motion => motion(self.size, self.angle),
            Family::Annulus => annulus(self.size, self.inner),
        }
    }

    /// Root mean square distance from the center along one axis, averaged over the directions, pixels. It makes sizes
    /// of different families comparable.
    pub fn spread(&self) -> f64 {
        match self.family {
            Family::Gaussian => self.size,
            Family::Disk => self.size / 2.0,
            Family::Motion => (self.size - 1.0) / 24f64.sqrt(),
            Family::Annulus => self.size / 2.0 * (1.0 + self.inner * self.inner).sqrt(),
        }
    }
}

impl Taps {
    /// A kernel with `reach` taps on either side, from values whose sum is not zero.
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

        self.values.iter().enumerate().map(move |(i, value)| {
            ((i / side) as isize - reach, (i % side) as isize - reach, *value)
        })
    }

    /// The least share of texture that is left at half the highest frequency, a period of 4 pixels, along rows, columns and both
    /// diagonals.
    pub fn least_response(&self) -> f64 {
        let along = |down: f64, across: f64| {
            let (mut real, mut imaginary) = (0.0, 0.0);
            for (dy, dx, value) in self.places() {
                let (sine, cosine) =
                    math::sin_cos(FRAC_PI_2 * (down * dy as f64 + across * dx as f64));
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

    /// The standard deviation in the direction in which it is least, pixels: nearly 0 of a motion.
    pub fn least_spread(&self) -> f64 {
        let [down, across, both] = self.moments();
        let least = f64::midpoint(down, across) - math::hypot((down - across) / 2.0, both);
        least.max(0.0).sqrt()
    }

    /// The second moments about the mean, which need not be the center: down, across, and of both.
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
fn gaussian(sigma: f64) -> Taps {
    let reach = (4.0 * sigma + 0.5) as usize;

    let side = 0..=2 * reach;
    let profile: Vec<f64> = side
        .map(|i| {
            math::exp(-0.5 * ((i as f64 - reach as f64) / sigma.max(f64::MIN_POSITIVE)).powi(2))
        })
        .collect();

    // A Gaussian is separable: the outer product of its profile.
    let rows = profile.iter().flat_map(|a| profile.iter().map(move |b| a * b));
    Taps::new(reach, rows.collect())
}

/// An annulus, or a disk where `inner` is 0, from samples that are counted in each pixel.
fn annulus(radius: f64, inner: f64) -> Taps {
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

    // Between two samples there may be none: that is no blur.
    if values.iter().all(|value| *value == 0.0) {
        values[side * side / 2] = 1.0;
    }

    Taps::new(reach, values)
}

/// A straight path.
fn motion(length: f64, angle: f64) -> Taps {
    // A path between the centers of pixels is one pixel shorter than the pixels that it covers.
    let half = (length - 1.0).max(0.0) / 2.0;
    let samples = (length * MOTION_SAMPLES).round().max(1.0) as usize + 1;
    let steps = (0..samples).map(|i| -half + 2.0 * half * i as f64 / (samples - 1) as f64);

    let (sine, cosine) = math::sin_cos(angle.to_radians());
    path(steps.map(|step| (exact(step * sine), exact(step * cosine))))
}

/// A coordinate without rounding errors, so that right angles are exact: the computed cosine of 90 degrees is 6e-17.
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

    fn psfs() -> impl Iterator<Item = Psf> {
        let sizes = [1.0, 1.3, 2.0, 3.7, 6.0, 8.0];
        let angles = [0.0, 17.0, 45.0, 90.0, 163.0];
        sizes.into_iter().flat_map(move |size| {
            let rounds = [Family::Gaussian, Family::Disk].map(|family| Psf::round(family, size));
            let annuli = [0.3, 0.5, 0.8].map(|inner| Psf::annulus(size, inner));
            let motions = angles.map(|angle| Psf::motion(size, angle));
            rounds.into_iter().chain(annuli).chain(motions)
        })
    }

    #[test]
    fn taps_have_the_sum_one_and_are_symmetric_about_the_center() {
        for psf in psfs() {
            let taps = psf.taps();
            assert!((taps.values.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{psf:?}");
            let mirrored = taps.values.iter().rev();
            assert!(
                taps.values.iter().zip(mirrored).all(|(a, b)| (a - b).abs() < 1e-12),
                "{psf:?}"
            );
            assert_eq!(taps.values.len(), taps.side().pow(2));
        }
    }

    #[test]
    fn the_spread_is_that_of_the_taps_along_one_axis() {
        for psf in psfs() {
            // Splitting samples bilinearly, and pixels, have a spread of their own: at most a third of a pixel.
            let along = psf.taps().radius() / 2f64.sqrt();
            assert!((along - psf.spread()).abs() < 0.35, "{psf:?}: {along}");
        }
    }

    #[test]
    fn angles_turn_from_x_towards_y() {
        let motion = |angle| Psf::motion(9.0, angle).taps();
        assert!(motion(0.0).places().all(|(dy, _, tap)| dy == 0 || tap == 0.0));
        assert!(motion(90.0).places().all(|(_, dx, tap)| dx == 0 || tap == 0.0));
        let slant: f64 = motion(45.0).places().map(|(dy, dx, tap)| (dy * dx) as f64 * tap).sum();
        assert!(slant > 1.0, "down to the right");
    }

    #[test]
    fn the_smallest_of_every_family_is_no_blur() {
        for psf in [
            Psf::round(Family::Gaussian, 0.0),
            Psf::round(Family::Disk, 0.01),
            Psf::motion(1.0, 30.0),
            Psf::motion(0.5, 30.0),
            Psf::annulus(0.01, 0.5),
        ] {
            let taps = psf.taps();
            let center = taps.values[taps.values.len() / 2];
            assert!((center - 1.0).abs() < 1e-12, "{psf:?} {taps:?}");
        }
    }

    #[test]
    fn a_path_need_not_be_symmetric() {
        let taps = path([(0.0, 0.0), (0.0, 1.0), (2.0, 1.5)].into_iter());
        assert_eq!(taps.reach, 2);
        let tap = |y: usize, x: usize| taps.values[y * taps.side() + x];
        let expected = [(2, 2, 1.0), (2, 3, 1.0), (4, 3, 0.5), (4, 4, 0.5)];
        assert!(expected.iter().all(|(y, x, tap_)| (tap(*y, *x) - tap_ / 3.0).abs() < 1e-12));
    }
}
