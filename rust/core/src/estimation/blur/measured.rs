//! Measurement of a kernel that does not belong to a family, from the areas that both images show.

use super::bank::Side;
use super::bins::SIDE;
use super::rough::RoughMatch;
use super::spectrum::{BlockPlace, Cross, kernel};
use super::taps::Taps;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::{Plane, around};
use phasestereo_match::base::simd::Level;
use phasestereo_match::matcher::runtime::Runtime;

/// Taps on either side of the center: blocks are too small for larger kernels.
const REACH: usize = 15;
/// Taps below this share of the largest are noise.
const LEAST_TAP: f32 = 0.08;
/// Share of the mean power of the sharp image that is added to every power: it regularizes the division.
const REGULAR: f32 = 1e-3;

/// Adds the cross-spectra of blocks of the left image and of the right image warped to the left one.
pub fn add_cross_spectra(
    grays: &[Plane<f32>; 2],
    rough: &RoughMatch,
    places: &[BlockPlace],
    sums: &mut Cross,
    runtime: Runtime,
) -> Result<()> {
    let warped = warped(&grays[1], rough, runtime.control)?;

    // In the warped image, the right block has the corner of the left one.
    let same_corner = |place: &BlockPlace| BlockPlace { right_top: place.top, right: place.left, ..*place };
    let places: Vec<BlockPlace> = places.iter().map(same_corner).collect();

    sums.add_all([&grays[0], &warped], &places, runtime)
}

/// The kernel that turns the sharp image into the soft one, by regularized least squares: the sum of
/// cross-spectra over the sum of powers. `None` if the images have nothing in common.
pub fn measured(sums: &Cross, side: Side, level: Level) -> Option<Taps> {
    let sharp = &sums.powers[1 - side.index()];
    let regular = sharp.iter().sum::<f32>() / sharp.len() as f32 * REGULAR;

    let over = |product: &[f32], sign: f32| -> Vec<f32> {
        let quotient =
            |(product, power): (&f32, &f32)| sign * product / (power + regular).max(f32::MIN_POSITIVE);
        product.iter().zip(sharp).map(quotient).collect()
    };

    // The product is left times conjugate right: its conjugate applies to a soft right image.
    let sign = if side == Side::Left { 1.0 } else { -1.0 };
    let [re, im] = &sums.product;
    cleaned(&kernel(&[over(re, 1.0), over(im, sign)], level))
}

/// The right image warped to the left one by the rough disparities.
fn warped(right: &Plane<f32>, rough: &RoughMatch, control: &Control) -> Result<Plane<f32>> {
    let last = right.cols() as isize - 1;

    Plane::by_pixels(right.size(), control, |y, x| {
        // The rough disparity gives the column, the field the row.
        let from = (x as isize - rough.at(y, x).round() as isize).clamp(0, last) as usize;
        let below = y as isize + rough.rows_at(y, from);

        right.row(below.clamp(0, right.rows() as isize - 1) as usize)[from]
    })
}

/// The point-spread function in a measured kernel: the connected positive taps around the largest one.
fn cleaned(kernel: &Plane<f32>) -> Option<Taps> {
    let corner = SIDE / 2 - REACH;
    let side = 2 * REACH + 1;
    let inner = Plane::from_fn(side, side, |y, x| kernel.row(corner + y)[corner + x]);

    let taps = inner.as_slice();
    let start = (0..taps.len()).max_by(|a, b| taps[*a].total_cmp(&taps[*b]))?;

    // Least squares leave noise everywhere: small and separate taps are dropped.
    let floor = taps[start] * LEAST_TAP;
    if floor <= 0.0 {
        return None;
    }

    // A flood fill from the largest tap.
    let mut values = vec![0.0; side * side];
    let mut open = vec![start];
    while let Some(place) = open.pop() {
        let tap = taps[place];
        if tap < floor || values[place] != 0.0 {
            continue;
        }

        values[place] = f64::from(tap);

        let (y, x) = (place / side, place % side);
        for row in around(y, 1, side) {
            open.extend(around(x, 1, side).map(|col| row * side + col));
        }
    }

    Some(Taps::new(REACH, values))
}

#[cfg(test)]
mod tests {
    use super::super::taps::path;
    use super::*;
    use crate::estimation::blur::rough::{Correspondence, RoughScale, grays};
    use crate::testing::{on_a_thread, texture};
    use phasestereo_match::base::plane::reflect;
    use phasestereo_match::image::pixels::{Image, Input};
    use phasestereo_match::pair::Pair;

    /// An image of squares of a few sizes.
    fn scene(y: usize, x: usize) -> f32 {
        let shade = |y: usize, x: usize, salt: u64| f32::from(texture(y, x, salt));
        shade(y / 9, x / 9, 1) + 0.7 * shade(y / 4, x / 4, 2) + 0.5 * shade(y, x, 3)
    }

    fn convolved(image: &Plane<f32>, taps: &Taps) -> Plane<f32> {
        Plane::from_fn(image.rows(), image.cols(), |y, x| {
            let tap = |(dy, dx, value): (isize, isize, f64)| {
                let row = image.row(reflect(y as isize - dy, image.rows()));
                row[reflect(x as isize - dx, image.cols())] * value as f32
            };
            taps.places().map(tap).sum()
        })
    }

    /// A hook, unlike its mirror images.
    fn hook() -> Taps {
        let down = (0..90).map(|i| (f64::from(i) / 15.0 - 4.0, -1.0));
        let along = (0..60).map(|i| (2.0, f64::from(i) / 15.0 - 1.0));
        path(down.chain(along))
    }

    /// Normalized correlation of two kernels of any reach.
    fn likeness(a: &Taps, b: &Taps) -> f64 {
        let product = |a: &Taps, b: &Taps| -> f64 {
            let at = |dy: isize, dx: isize| {
                b.places().find(|tap| (tap.0, tap.1) == (dy, dx)).map_or(0.0, |tap| tap.2)
            };

            a.places().map(|(dy, dx, value)| value * at(dy, dx)).sum()
        };
        product(a, b) / (product(a, a) * product(b, b)).sqrt()
    }

    #[test]
    fn a_kernel_of_no_family_is_found_on_either_side() {
        let scale = RoughScale { factor: 2, ..RoughScale::ROUGH };

        let sharp = Plane::from_fn(150, 200, scene);
        let soft = convolved(&sharp, &hook());

        for side in [Side::Left, Side::Right] {
            let shots = if side == Side::Left { [&soft, &sharp] } else { [&sharp, &soft] };

            let view = |plane: &Plane<f32>| {
                let pixels = ndarray::Array3::from_shape_vec((150, 200, 1), plane.as_slice().into());
                Input::from(Image::F32(pixels.expect("the right length")))
            };

            let pair = Pair::of_inputs([view(shots[0]), view(shots[1])], 0, 8).expect("a legal pair");
            let known = Correspondence { candidates: pair.candidates(), alignment: None };

            let corner = |i: usize| BlockPlace {
                top: i / 4 * 40,
                left: i % 4 * 40,
                right_top: i / 4 * 40,
                right: i % 4 * 40,
            };

            let places: Vec<BlockPlace> = (0..12).map(corner).collect();
            let mut sums = Cross::default();
            on_a_thread(Level::best(), |runtime| {
                let grays = pair.views().map(|view| grays(view, runtime.control).expect("memory"));
                let rough = RoughMatch::new(&grays, known, scale, runtime).expect("a match");
                add_cross_spectra(&grays, &rough, &places, &mut sums, runtime).expect("not cancelled");
            });

            let found = measured(&sums, side, Level::best()).expect("there is contrast");

            let mirrored = Taps::new(hook().reach, hook().values.into_iter().rev().collect());
            let (alike, unlike) = (likeness(&found, &hook()), likeness(&found, &mirrored));
            assert!(alike > 0.9 && unlike < 0.7, "{side:?}: {alike} {unlike}");
        }
    }

    #[test]
    fn only_taps_connected_to_the_largest_are_kept() {
        let mut kernel = Plane::from_fn(SIDE, SIDE, |_, _| 0.01);

        let center = SIDE / 2;
        for (dy, dx, tap) in [(0, 0, 1.0), (1, 1, 0.5), (2, 2, 0.25), (0, 6, 0.9), (0, 1, -0.7)] {
            kernel.row_mut(center + dy)[center + dx] = tap;
        }

        let taps = cleaned(&kernel).expect("there is a largest tap");

        let kept: Vec<_> = taps.places().filter(|tap| tap.2 != 0.0).collect();

        let expected = [(0, 0, 1.0 / 1.75), (1, 1, 0.5 / 1.75), (2, 2, 0.25 / 1.75)];
        assert_eq!(kept.len(), 3);

        for ((y, x, tap), (dy, dx, value)) in kept.into_iter().zip(expected) {
            assert!((y, x) == (dy, dx) && (tap - value).abs() < 1e-6);
        }
    }

    #[test]
    fn there_is_no_kernel_without_positive_taps() {
        assert_eq!(cleaned(&Plane::from_fn(SIDE, SIDE, |_, _| 0.0)), None);
        assert_eq!(cleaned(&Plane::from_fn(SIDE, SIDE, |_, _| -1.0)), None);
    }
}
