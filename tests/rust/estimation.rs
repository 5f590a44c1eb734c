//! Rows and ranges: injected faults are found and corrected, the same at every level, for any threads, and
//! for a pair that is read a few rows at a time.

use std::ops::Range;

use crate::common::parts::{Slow, Stored};
use crate::common::{hash, levels, with_runtime};
use ndarray::Array3;
use phasestereo::Finding;
use phasestereo::internals::estimation::blur::Side;
use phasestereo::internals::estimation::blur::psf::Psf;
use phasestereo::internals::estimation::facts::{Fact, Facts};
use phasestereo::internals::estimation::{Estimates, complete, complete_source};
use phasestereo::internals::findings::of_pair;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::{Plane, reflect};
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::view::{Mask, View};
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::alignment::straighten::straightened;
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{Optimizer, Settings};

/// Rows and columns of the scenes.
const SIZE: (usize, usize) = (260, 330);
/// Disparity of the left half of a scene, and of its right half.
const DEPTHS: [usize; 2] = [9, 21];

/// Squares of many sizes, at any place, including between pixels.
fn texture(y: f64, x: f64) -> f64 {
    let shade = |side: f64, salt: u64| {
        let (row, col) = (y / side, x / side);

        let corner = |dy: usize, dx: usize| {
            let (row, col) = (row.floor() as i64 + 4096, col.floor() as i64 + 4096);
            (hash(salt, row as usize + dy, col as usize + dx) % 256) as f64
        };

        let (vertical, horizontal) = (row - row.floor(), col - col.floor());
        let row = |dy| corner(dy, 0) + horizontal * (corner(dy, 1) - corner(dy, 0));
        row(0) + vertical * (row(1) - row(0))
    };

    [(13.0, 0.35), (7.0, 0.3), (4.0, 0.35)].iter().map(|(side, part)| part * shade(*side, *side as u64)).sum()
}

/// The disparity that the right image shows at a column.
fn depth(x: f64) -> f64 {
    DEPTHS[usize::from(x > SIZE.1 as f64 / 2.0)] as f64
}

/// Both images of a scene; the right one shows row `y` of the left one at `y + field(x, y)`.
fn shots(field: &Alignment) -> [Plane<f64>; 2] {
    let left = Plane::from_fn(SIZE.0, SIZE.1, |y, x| texture(y as f64, x as f64 - depth(x as f64)));

    let right = Plane::from_fn(SIZE.0, SIZE.1, |y, x| {
        // The row of the left image that appears here, by iteration: the field is smooth.
        let mut row = y as f64;
        for _ in 0..8 {
            row = y as f64 - field.at(x as f64, row);
        }
        texture(row, x as f64)
    });

    [left, right]
}

/// The same with lenses in focus at different distances: the left one blurs near objects, the right one far
/// ones.
fn in_focus_apart([left, right]: [Plane<f64>; 2]) -> [Plane<f64>; 2] {
    let taps = Psf::disk(5.0).taps();
    let soft = |plane: &Plane<f64>, y: usize, x: usize| -> f64 {
        let tap = |(dy, dx, value): (isize, isize, f64)| {
            let row = plane.row(reflect(y as isize - dy, SIZE.0));
            row[reflect(x as isize - dx, SIZE.1)] * value
        };
        taps.places().map(tap).sum()
    };
    let shown = |plane: &Plane<f64>, is_soft: &dyn Fn(usize) -> bool| {
        let pixel = |y, x| if is_soft(x) { soft(plane, y, x) } else { plane.row(y)[x] };
        Plane::from_fn(SIZE.0, SIZE.1, pixel)
    };

    let middle = (SIZE.1 - DEPTHS[0] - DEPTHS[1]) / 2;
    [shown(&left, &|x| depth(x as f64) > 15.0), shown(&right, &|x| x < middle)]
}

/// Gray pixels.
fn bytes(plane: &Plane<f64>) -> Image {
    let pixels = Array3::from_shape_fn((plane.rows(), plane.cols(), 1), |(y, x, _)| {
        plane.row(y)[x].round().clamp(0.0, 255.0) as u8
    });
    Image::U8(pixels)
}

/// The upper rows of twice the size.
fn doubled(plane: &Plane<f64>) -> Plane<f64> {
    Plane::from_fn(SIZE.0, 2 * SIZE.1, |y, x| plane.row(y / 2)[x / 2])
}

/// Pixels in color.
fn floats(plane: &Plane<f64>) -> Image {
    let shape = (plane.rows(), plane.cols(), 3);
    Image::F32(Array3::from_shape_fn(shape, |(y, x, _)| plane.row(y)[x] as f32))
}

fn pair_of(shots: &[Plane<f64>; 2], image: impl Fn(&Plane<f64>) -> Image) -> Pair {
    stored(shots, image).pair
}

fn stored(shots: &[Plane<f64>; 2], image: impl Fn(&Plane<f64>) -> Image) -> Stored {
    Stored::new([Input::from(image(&shots[0])), Input::from(image(&shots[1]))], 0, 48)
}

fn field(coefficients: &[f64]) -> Alignment {
    let mut all = [0.0; 8];
    all[..coefficients.len()].copy_from_slice(coefficients);
    Alignment::new(all, SIZE).expect("legal")
}

/// The same, with swaying rows.
fn swaying(coefficients: &[f64]) -> Alignment {
    let factor = |knot: usize| [0.2, 1.3, 1.6, 0.3, -1.1, -1.7, -0.6][knot % 7];
    field(coefficients).with_sway(std::array::from_fn(factor)).expect("legal")
}

/// Settings that need rows, noise and blur.
fn settings() -> Settings {
    Settings {
        neighborhood: 3,
        frequencies: (1, 1),
        noise_threshold: 0.5,
        window: 5,
        shiftable: false,
        optimizer: Optimizer::SemiGlobal,
        p1: 5.0,
        p2: 20.0,
        adaptive_p2: 1.0,
        compensate_blur: true,
        align_rows: true,
        lr_check: Some(1),
        ..Preset::Paper.settings()
    }
}

/// The estimates of a pair with known or unknown disparities.
fn found(pair: &Pair, is_known: bool, threads: usize, level: Level) -> Estimates {
    let candidates = is_known.then(|| Fact::given(pair.candidates()));
    let facts = Facts { candidates, ..Facts::default() };

    let found = with_runtime(threads, level, |runtime| complete(pair.clone(), &facts, &settings(), runtime));
    with_findings(found.expect("it runs").1, pair)
}

/// The estimates with the findings that follow from them.
fn with_findings(mut found: Estimates, pair: &Pair) -> Estimates {
    found.findings = of_pair(&found, pair.size(), None, &settings());
    found
}

/// The same for a pair that is read at most this many rows at a time.
fn found_by_rows(stored: &Stored, is_known: bool, most: usize) -> Estimates {
    let candidates = is_known.then(|| Fact::given(stored.pair.candidates()));
    let facts = Facts { candidates, ..Facts::default() };

    let slow = Slow::new(stored, most);
    let found =
        with_runtime(2, Level::best(), |runtime| complete_source(&slow, &facts, &settings(), runtime));
    with_findings(found.expect("it runs"), &stored.pair)
}

/// Compares everything except the times.
fn assert_same(found: &Estimates, expected: &Estimates, what: &str) {
    let parts = |found: &Estimates| {
        let Estimates { candidates, range, left_out, offsets, .. } = found;
        let Estimates { alignment, blur, compensation, .. } = found;
        let range = (candidates.clone(), *range, left_out.clone());
        (range, offsets.clone(), alignment.clone(), blur.clone(), compensation.clone())
    };

    assert_eq!(parts(found), parts(expected), "{what}");
    // NaN is unequal to itself, but its text is equal.
    let said = |found: &Estimates| format!("{:?} {:?}", found.photometry, found.findings);
    assert_eq!(said(found), said(expected), "{what}");
}

#[test]
fn rows_that_do_not_correspond_are_found_and_straightened() {
    let injected: [&[f64]; 6] = [
        &[0.6],
        &[-7.3],
        &[1.0, 2.5, -0.8],
        &[0.0, -4.0],
        &[0.2, 0.0, 3.0],
        &[0.0, 0.0, 0.0, 2.5, 0.0, 0.0, 1.5, 0.0],
    ];

    for coefficients in injected {
        let exact = field(coefficients);
        let pair = pair_of(&shots(&exact), bytes);
        let found = found(&pair, true, 1, Level::best());

        let measured = found.offsets.expect("there is texture").field;

        let coefficients = measured.coefficients().iter().zip(exact.coefficients());
        let mut rest = [0.0; 8];
        rest.iter_mut().zip(coefficients).for_each(|(rest, (a, b))| *rest = a - b);
        let rest = Alignment::new(rest, SIZE).expect("legal").rms();

        assert!(rest < 0.06, "{exact:?}: off by {rest}");
        assert_eq!(found.alignment, Some(measured), "the pair is aligned");
    }
}

#[test]
fn rows_that_sway_are_found_beside_the_smooth_field() {
    let exact = swaying(&[0.4, 1.2, -0.6]);
    let pair = pair_of(&shots(&exact), bytes);
    let found = found(&pair, true, 1, Level::best());

    let offsets = found.offsets.expect("there is texture");
    let rest = offsets.field.less(&exact).rms();
    assert!(rest < 0.15 && offsets.error < 0.15, "off by {rest}, {offsets:?}");
    assert_eq!(found.alignment, Some(offsets.field), "the pair is aligned");

    let said = |one: &Finding| one.sentence.starts_with("rows sway by up to 1.");
    assert!(found.findings.iter().any(said), "{:?}", found.findings);
}

#[test]
fn aligned_pairs_are_not_aligned_again() {
    let pair = pair_of(&shots(&field(&[])), bytes);
    let found = found(&pair, true, 1, Level::best());

    let offsets = found.offsets.expect("there is texture");
    assert!(offsets.field.rms() < 0.05 && found.alignment.is_none(), "{offsets:?}");
}

#[test]
fn an_estimated_range_contains_the_disparities() {
    for coefficients in [&[][..], &[3.0], &[0.0, 3.0]] {
        let pair = pair_of(&shots(&field(coefficients)), bytes);
        let found = found(&pair, false, 1, Level::best());

        let range = found.range.expect("there is texture");

        assert!(!range.negative && !range.mixed);
        assert_eq!(found.candidates.value.min(), 0);
        assert!((24..=36).contains(&found.candidates.value.count()), "{range:?}");

        let [left, right] = pair.views();
        let swapped = Pair::new(right.clone(), left.clone(), 0, 48).expect("legal");

        let found = self::found(&swapped, false, 1, Level::best());
        assert!(found.range.expect("there is texture").negative);
        assert!(found.candidates.value.min() <= -21);
    }
}

#[test]
fn a_range_without_the_disparities_does_not_count_as_images_that_hardly_match() {
    let pair = pair_of(&shots(&field(&[])), bytes);
    let [left, right] = pair.views().map(View::clone);
    let narrow = Pair::new(left, right, 0, 4).expect("legal");
    let found = found(&narrow, true, 1, Level::best());

    assert!(found.range.is_some_and(|range| range.candidates(SIZE.1).expect("legal").count() > 16));
    assert!(found.confidence.is_some_and(|found| found > 0.65), "{:?}", found.confidence);
}

#[test]
fn estimates_depend_on_nothing_but_the_images() {
    let pairs = [field(&[1.5, 1.0, -0.5]), swaying(&[0.4, 1.2, -0.6])];
    let pairs = pairs.map(|field| pair_of(&shots(&field), bytes));

    for (pair, is_known) in pairs.iter().flat_map(|pair| [(pair, true), (pair, false)]) {
        let expected = found(pair, is_known, 1, Level::best());
        assert!(expected.alignment.is_some());

        for level in levels() {
            for threads in [1, 3] {
                let found = found(pair, is_known, threads, level);
                assert_same(&found, &expected, level.name());
            }
        }
    }
}

#[test]
fn blur_that_follows_depth_has_the_disk_of_each_disparity() {
    let pair = pair_of(&in_focus_apart(shots(&field(&[0.0; 8]))), bytes);
    let estimates = found(&pair, true, 1, Level::best());
    let blur = estimates.blur.expect("estimated");

    let ((rows, cols), labels) = (blur.labels.size(), blur.labels.as_slice());
    let of_side = |side: Side, columns: Range<usize>| {
        let is_of = |x: usize| blur.blurs[usize::from(labels[rows / 2 * cols + x])].side == Some(side);
        columns.filter(|x| is_of(*x)).count()
    };
    // Far objects are in the left half; the tiles at the jump belong to either half.
    let half = cols / 2 - 2;
    assert_eq!(of_side(Side::Right, 0..half), half, "{blur:?}");
    assert_eq!(of_side(Side::Left, cols - half..cols), half, "{blur:?}");

    let mut psfs = blur.blurs.iter().filter_map(|blur| blur.psf);
    assert!(psfs.all(|psf| psf == Psf::disk(psf.size) && psf.size <= 6.5), "{blur:?}");
    let softer = estimates.findings.iter().filter(|one| one.sentence.contains("is softer than"));
    assert_eq!(softer.count(), 2, "one of each image: {:?}", estimates.findings);
}

#[test]
fn pairs_that_are_read_have_the_estimates_of_whole_ones() {
    let shots = shots(&field(&[1.5, 1.0, -0.5]));

    let masked = |pair: &Stored| {
        let inputs = pair.inputs.clone().map(|input| {
            let is_valid = |y: usize, x: usize| !((90..130).contains(&y) && x < 120 + y);
            Input { mask: Some(Mask::from_fn(SIZE.0, SIZE.1, is_valid)), ..input }
        });
        Stored::new(inputs, 0, 48)
    };

    let plain = [stored(&shots, bytes), stored(&shots, floats)];
    // Wide enough that one match of reduced images serves for rows and blur.
    let wide = stored(&shots.each_ref().map(doubled), bytes);

    let sways = stored(&self::shots(&swaying(&[0.4, 1.2, -0.6])), bytes);

    let floats = plain[1].clone();
    let apart = in_focus_apart(self::shots(&field(&[0.0; 8])));
    let apart = stored(&apart, bytes);

    for pair in [plain[0].clone(), masked(&plain[0]), masked(&floats), floats, wide, sways, apart] {
        for is_known in [true, false] {
            let expected = found(&pair.pair, is_known, 1, Level::best());

            for most in [1, 70, 131, 10_000] {
                let found = found_by_rows(&pair, is_known, most);
                assert_same(&found, &expected, &format!("{most} rows at a time"));
            }
        }
    }
}

#[test]
fn a_negative_is_found_by_rows_as_in_memory_and_may_be_known() {
    let [left, right] = shots(&field(&[0.0; 8]));
    let stored = stored(&[left, right.map(|value| 255.0 - value)], bytes);
    let pair = &stored.pair;
    let expected = found(pair, false, 2, Level::best());
    assert!(expected.is_inverted);

    let by_rows = found_by_rows(&stored, false, 50);
    assert_same(&by_rows, &expected, "by rows");
    assert!(by_rows.is_inverted);

    let facts = &Facts { is_inverted: true, ..Facts::default() };
    let known = with_runtime(2, Level::best(), |runtime| complete(pair.clone(), facts, &settings(), runtime));
    let (inverted, found) = known.expect("it runs");
    assert_same(&with_findings(found, pair), &expected, "known");
    assert_eq!(inverted.views()[1], pair.inverted().views()[1]);

    let slow = Slow::new(&stored, 50);
    let by_rows =
        with_runtime(2, Level::best(), |runtime| complete_source(&slow, facts, &settings(), runtime));
    assert_same(&with_findings(by_rows.expect("it runs"), pair), &expected, "known, by rows");
}

#[test]
fn a_part_is_straightened_as_the_whole() {
    let exact = swaying(&[2.2, 1.7, -3.1, 0.4, 0.0, -0.3, 0.8, 0.2]);
    let pair = pair_of(&shots(&exact), floats);
    let is_valid = |y, x| !hash(3, y / 3, x / 5).is_multiple_of(9);
    let mask = Mask::from_fn(SIZE.0, SIZE.1, is_valid);
    let right = pair.views()[1].clone().with_mask(Some(mask));

    let control = Control::default();
    let whole = straightened(&right, &exact, Level::best(), &control).expect("memory");

    // Offsets of at most 9.7 and 1.7 rows, half of 8 taps, and what a masked tap and an impulse ask for: 8
    // rows and one.
    let halo = 12 + 4 + 8 + 1;
    assert_eq!(exact.halo(), halo);

    for (first, end) in [(0, 40), (100, 150), (200, SIZE.0)] {
        let (top, bottom) = (first.max(halo) - halo, (end + halo).min(SIZE.0));
        let part = right.of_rows(top..bottom);
        let part = straightened(&part, &exact.clone().starting_at_row(top), Level::best(), &control)
            .expect("memory");
        assert_eq!(part.of_rows(first - top..end - top), whole.of_rows(first..end));
    }
}
