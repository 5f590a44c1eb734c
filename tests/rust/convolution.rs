//! Convolution: blocks of columns, rows on threads and every level, compared with each sum by itself.

use crate::common::{hash, levels, noise, random, view};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::LARGEST_KERNEL;
use phasestereo_match::image::convolution::{GUARD, Kernel, KernelWeights, MOST_FRACTION, SHIFT, convolve};
use phasestereo_match::image::intensity::Gray;
use phasestereo_match::matcher::on_threads;
use proptest::prelude::*;
use proptest::sample::select;

/// Largest magnitude whose sums fit in 32 bits, with the half that rounds them.
const NARROW: u32 = (1 << (31 - SHIFT)) - 1;
/// Magnitudes of bytes, on either side of that limit, and the largest that leaves 3 bits.
const REACHES: [u32; 4] = [128, NARROW, NARROW + 1, 1 << 25];

/// The plane under a kernel, which must be the same at every level of this machine.
fn convolved(plane: &Plane<i32>, kernel: &Kernel, fraction: u32, reach: u32) -> Plane<i32> {
    let gray = Gray::within(reach, plane.clone());
    let mut found = levels().into_iter().map(|level| {
        let found = convolve(&gray, kernel, fraction, level, &Control::default());
        (level.name(), found.expect("not cancelled"))
    });

    let (_, first) = found.next().expect("a level");
    found.for_each(|(name, found)| assert_eq!(found, first, "{name}"));
    first
}

/// Noise, including both extremes.
fn extremes(rows: usize, cols: usize, reach: u32) -> Plane<i32> {
    let reach = i64::from(reach);

    Plane::from_fn(rows, cols, |y, x| {
        let bits = hash(7, y, x);
        let inside = (bits >> 8) as i64 % (2 * reach + 1) - reach;

        (match bits % 4 {
            0 => -reach,
            1 => reach,
            _ => inside.clamp(-reach, reach),
        }) as i32
    })
}

/// A kernel of these taps, normalized.
fn kernel(rows: usize, cols: usize, tap: impl Fn(usize, usize) -> f64) -> Result<Kernel> {
    let taps = Plane::from_fn(rows, cols, tap);
    let total: f64 = taps.as_slice().iter().sum();
    Kernel::new(&taps.map(|tap| tap / total))
}

/// Random taps; about `percent` are not zero, the first one never is.
fn scattered(rows: usize, cols: usize, percent: u64) -> Kernel {
    let tap = |y, x| {
        let bits = hash(9, y, x);
        if bits % 100 < percent || y + x == 0 { ((bits >> 8) % 1000 + 1) as f64 } else { 0.0 }
    };
    kernel(rows, cols, tap).expect("a legal kernel")
}

/// A row of random taps, of sum 1.
fn profile(length: usize, seed: u64) -> Vec<f64> {
    let taps: Vec<f64> = (0..length).map(|x| (hash(seed, 0, x) % 1000 + 1) as f64).collect();
    let total: f64 = taps.iter().sum();
    taps.into_iter().map(|tap| tap / total).collect()
}

/// An outer product of random taps.
fn product(rows: usize, cols: usize) -> Kernel {
    Kernel::separable(&profile(rows, 1), &profile(cols, 2)).expect("a legal kernel")
}

/// One tap, in some place.
fn single(rows: usize, cols: usize, place: (usize, usize)) -> Kernel {
    kernel(rows, cols, |y, x| if (y, x) == place { 1.0 } else { 0.0 }).expect("a legal kernel")
}

/// All weight in one corner, on a diagonal: not an outer product, so both axes are applied at once.
fn corner(side: usize, (bottom, right): (bool, bool)) -> Kernel {
    let depth = |place: usize, far: bool| if far { side - 1 - place } else { place };

    let tap = |y, x| match (depth(y, bottom), depth(x, right)) {
        (0, 0) => 2.0,
        (1, 1) => 1.0,
        _ => 0.0,
    };

    kernel(side, side, tap).expect("a legal kernel")
}

fn total(weights: &Plane<i32>) -> i32 {
    weights.as_slice().iter().sum()
}

#[test]
fn convolution_is_that_of_scipy() {
    let taps = [0, 1, 2, 3, 4, 0, 0, 0, 6].map(|tap| f64::from(tap) / 16.0);
    let kernel = Kernel::new(&Plane::from_vec(3, 3, taps.to_vec()).expect("nine taps"));
    let plane = Plane::from_vec(2, 4, vec![10, -20, 30, 7, 5, 0, -60, 100]).expect("eight pixels");

    // floor(16 scipy.ndimage.convolve(plane, kernel, mode="reflect") + 1/2)
    let expected = vec![55, 80, -39, 209, 95, -110, -120, 860];
    let expected = Plane::from_vec(2, 4, expected).expect("eight pixels");
    assert_eq!(convolved(&plane, &kernel.expect("a legal kernel"), 4, 128), expected);

    let corner = single(7, 7, (0, 6));
    let expected = Plane::from_vec(2, 4, vec![30, -20, 10, 10, 30, -20, 10, 10]);
    assert_eq!(convolved(&plane, &corner, 0, 128), expected.expect("eight pixels"));
}

#[test]
fn any_size_of_image_and_kernel_equals_its_definition() {
    let images = [(1, 1), (1, 2), (2, 1), (1, 65), (40, 1), (3, 31), (4, 32), (5, 33), (2, 70)];
    let kernels = [
        scattered(1, 1, 100),
        scattered(3, 3, 50),
        scattered(1, 9, 100),
        scattered(9, 1, 100),
        scattered(129, 3, 5),
        scattered(5, 129, 5),
        product(3, 5),
        product(49, 11),
        product(3, 129),
        single(129, 129, (0, 128)),
        corner(5, (true, false)),
        corner(129, (false, false)),
        corner(129, (false, true)),
        corner(129, (true, false)),
        corner(129, (true, true)),
        single(129, 129, (64, 64)),
    ];

    assert!(matches!(corner(129, (true, true)).weights(), KernelWeights::All(all) if all.rows() == 129));

    for (rows, cols) in images {
        let plane = noise(rows, cols);
        for kernel in &kernels {
            let expected = reference::convolve(&plane, kernel, 4);
            assert_eq!(convolved(&plane, kernel, 4, 255), expected, "{rows} x {cols}");
        }
    }
}

#[test]
fn sums_of_any_width_are_exact_at_their_bounds() {
    for reach in REACHES {
        let bright = Plane::from_fn(3, 5, |_, _| reach as i32);
        for plane in [bright.clone(), bright.map(|value| -value), extremes(9, 37, reach)] {
            for kernel in [scattered(5, 5, 80), product(5, 7), single(3, 3, (1, 1))] {
                let expected = reference::convolve(&plane, &kernel, 3);
                assert_eq!(convolved(&plane, &kernel, 3, reach), expected, "{reach}");
            }
        }
    }
}

#[test]
fn a_constant_stays_what_it_is() {
    for value in [-128, -1, 0, 1, 127] {
        let plane = Plane::from_fn(4, 6, |_, _| value);
        for kernel in [scattered(7, 5, 60), product(9, 9)] {
            for fraction in [0, 4, MOST_FRACTION] {
                let expected = plane.map(|value| value << fraction);
                assert_eq!(convolved(&plane, &kernel, fraction, 128), expected);
            }
        }
    }
}

#[test]
fn threads_leave_no_seam() {
    let plane = noise(70, 45);
    for kernel in [scattered(9, 7, 50), product(13, 9)] {
        let expected = reference::convolve(&plane, &kernel, 4);
        for threads in 1..=8 {
            let found = on_threads(threads, || convolved(&plane, &kernel, 4, 255));
            assert_eq!(found.expect("threads start"), expected, "{threads} threads");
        }
    }
}

#[test]
fn pixels_of_an_image_are_centered_first() {
    let view = view(9, 40, |y, x| hash(3, y, x) as u8);
    let (level, control, kernel) = (Level::best(), Control::default(), scattered(5, 3, 70));
    let gray = Gray::of_view(&view);
    let expected = reference::convolve(view.gray(), &kernel, 4);
    assert_eq!(convolve(&gray, &kernel, 4, level, &control), Ok(expected));
}

#[test]
fn outer_products_are_recognized_and_nothing_else() {
    let gaussian = |y: usize, x: usize| {
        let squares = (y as f64 - 12.0).powi(2) + (x as f64 - 12.0).powi(2);
        // In single precision, as in files and Python.
        f64::from(math::exp(-squares / 18.0) as f32)
    };

    let found = kernel(25, 25, gaussian).expect("a legal kernel");
    assert!(matches!(found.weights(), KernelWeights::Factors { .. }), "Gaussian");
    let disk = |y: usize, x: usize| f64::from(y.abs_diff(5).pow(2) + x.abs_diff(5).pow(2) <= 25);

    let disk = |y, x| if disk(y, x) > 0.0 { 1.0 } else { 0.0 };

    let found = kernel(11, 11, disk).expect("a legal kernel");
    assert!(matches!(found.weights(), KernelWeights::All(_)), "disk");

    let row = kernel(7, 7, |y, x| if y == 3 { x as f64 + 1.0 } else { 0.0 });
    let expected = Kernel::new(&Plane::from_fn(1, 7, |_, x| (x as f64 + 1.0) / 28.0));
    assert_eq!(row, expected);
    assert!(matches!(row.expect("a legal kernel").weights(), KernelWeights::All(_)), "row");
}

#[test]
fn weights_are_within_a_step_of_the_taps_and_sum_to_a_power_of_two() {
    let disk = |y: usize, x: usize| {
        if y.abs_diff(10).pow(2) + x.abs_diff(10).pow(2) <= 100 { 1.0 } else { 0.0 }
    };

    let kernel = kernel(21, 21, disk).expect("a legal kernel");
    let KernelWeights::All(weights) = kernel.weights() else { panic!("a disk is not an outer product") };
    assert_eq!(total(weights), 1 << SHIFT);

    let inside = weights.as_slice().iter().filter(|weight| **weight > 0).count() as f64;
    let exact = f64::from(1 << SHIFT) / inside;

    assert!(weights.as_slice().iter().all(|&w| w == 0 || (f64::from(w) - exact).abs() < 1.0));

    // Opposite weights are equal except for one pair: the disk has not been shifted.

    let opposite = weights.as_slice().iter().rev();
    let differing = weights.as_slice().iter().zip(opposite).filter(|(a, b)| a != b).count();
    assert!(differing <= 2, "{differing} weights differ");

    let product = product(9, 5);
    let KernelWeights::Factors { column, row } = product.weights() else { panic!("an outer product") };
    assert_eq!([total(column), total(row)], [1 << SHIFT; 2]);
}

#[test]
fn rows_and_columns_without_weights_are_left_out() {
    let kernel = single(129, 129, (64, 67));
    let KernelWeights::All(weights) = kernel.weights() else { panic!("a row") };
    assert_eq!((weights.rows(), weights.cols()), (1, 7));
}

#[test]
fn illegal_kernels_are_refused() {
    let of = |rows, cols, tap: f64| Kernel::new(&Plane::from_fn(rows, cols, |_, _| tap));
    let too_large = LARGEST_KERNEL + 2;

    for (rows, cols) in [(2, 3), (3, 2), (0, 0), (0, 3), (too_large, 1), (1, too_large)] {
        let refused = of(rows, cols, 1.0 / (rows * cols).max(1) as f64).map_err(|e| e.to_string());
        assert!(refused.is_err_and(|e| e.contains("odd sides")), "{rows} x {cols}");
    }

    for tap in [f64::NAN, f64::INFINITY, -1.0] {
        assert!(of(1, 1, tap).map_err(|e| e.to_string()).is_err_and(|e| e.contains("the tap")));
    }

    for tap in [0.0, 0.998, 1.002] {
        assert!(of(1, 1, tap).map_err(|e| e.to_string()).is_err_and(|e| e.contains("of sum")));
    }

    assert!(of(1, 1, 1.0009).is_ok());
    assert!(Kernel::separable(&[1.0], &[0.5, 0.5]).is_err());
}

#[test]
fn a_fraction_that_does_not_fit_is_refused() {
    let kernel = scattered(3, 3, 100);
    let with = |fraction, reach| {
        let gray = Gray::within(reach, noise(2, 2));
        convolve(&gray, &kernel, fraction, Level::best(), &Control::default())
    };

    assert!(with(MOST_FRACTION, 255).is_ok());
    assert!(with(MOST_FRACTION + 1, 255).is_err());
    assert!(with(5 - GUARD, 1 << 25).is_ok());
    assert!(with(6 - GUARD, 1 << 25).is_err());
}

#[test]
fn a_cancelled_convolution_stops() {
    let control = Control::default();
    control.cancel();

    let gray = Gray::within(255, noise(3, 3));
    let stopped = convolve(&gray, &scattered(3, 3, 100), 4, Level::best(), &control);
    assert_eq!(stopped, Err(Error::Cancelled));
}

/// Kernels of any shape: of single taps, scattered ones, and outer products.
fn kernels() -> impl Strategy<Value = Kernel> {
    let side = || prop_oneof![4 => 0usize..=4, 1 => 5usize..=64].prop_map(|r| 2 * r + 1);
    (side(), side(), 0u64..=100, any::<bool>()).prop_map(|(rows, cols, percent, is_product)| {
        if is_product { product(rows, cols) } else { scattered(rows, cols, percent) }
    })
}

proptest! {
    #![proptest_config(random(128))]

    #[test]
    fn any_image_equals_its_definition(
        (rows, cols) in (1usize..=9, 1usize..=70),
        kernel in kernels(),
        fraction in 0u32..=3,
        reach in select(REACHES.to_vec()),
    ) {
        let plane = extremes(rows, cols, reach);
        let expected = reference::convolve(&plane, &kernel, fraction);
        prop_assert_eq!(convolved(&plane, &kernel, fraction, reach), expected);
    }
}
