//! Reduced copies of a pair, the range of disparities that they show, and the blocks located in them.

use std::ops::Range;

use crate::common::{gray_of, hash, with_runtime};
use ndarray::Array3;
use phasestereo::internals::estimation::areas::Area;
use phasestereo::internals::estimation::blur::parts::PairRows;
use phasestereo::internals::estimation::extent::extent;
use phasestereo::internals::estimation::order::Signs;
use phasestereo::internals::estimation::overview::{Guess, Overview, RoughMap};
use phasestereo::internals::estimation::range::{
    Copies, LeftOut, SearchRange, bands_at_ends, belongs, beyond, ends, is_identical, range, reach, signs,
};
use phasestereo::internals::estimation::tracks::{BLOCK, Seed, Track, follow};
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::view::{Mask, View};
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;

/// A number from 0 to 999.
fn random(salt: u64, y: usize, x: usize) -> usize {
    (hash(salt, y, x) % 1000) as usize
}

fn map(disparity: Plane<f32>) -> RoughMap {
    RoughMap { run: extent(&disparity), unsure: disparity.clone(), disparity, field: None, confidence: 0.9 }
}

/// Copies as large as the pair, valid everywhere.
fn of_planes(planes: [Plane<f32>; 2]) -> Overview {
    Overview { factor: 1, valid: planes[0].map(|_| true), planes }
}

/// A gray image.
fn view(size: (usize, usize), pixel: impl Fn(usize, usize) -> u8, mask: Option<Mask>) -> View {
    let pixels = Array3::from_shape_fn((size.0, size.1, 1), |(y, x, _)| pixel(y, x));
    gray_of(Input { mask, ..Image::U8(pixels).into() })
}

#[test]
fn copies_are_reduced_to_the_usual_width_and_by_two_until_they_are_small() {
    let plane = Plane::from_fn(240, 600, |y, x| random(1, y, x) as f32);
    let valid = plane.map(|value| *value > 300.0);
    let negative = plane.map(|value| -value);
    let copies = Overview { factor: 2, planes: [plane.clone(), negative], valid };

    let usual =
        with_runtime(1, Level::best(), |runtime| copies.usual(runtime)).expect("it runs").expect("wide");
    let halved =
        with_runtime(1, Level::best(), |runtime| usual.halved(runtime)).expect("it runs").expect("wide");
    for (less, by) in [(&usual, 4), (&halved, 8)] {
        assert_eq!(less.factor, 2 * by);
        assert_eq!((less.valid.rows(), less.valid.cols()), (240 / by, 600 / by));
        for (y, x) in [(0, 0), (3, 7), (11, 20), (29, 74)] {
            assert_eq!(less.valid.row(y)[x], copies.valid.row(y * by)[x * by]);
            let square = (0..by * by).map(|at| plane.row(y * by + at / by)[x * by + at % by]);
            let mean = square.sum::<f32>() / (by * by) as f32;
            let found = less.planes.each_ref().map(|plane| plane.row(y)[x].to_bits());
            assert_eq!(found, [mean, -mean].map(f32::to_bits));
        }
    }
    with_runtime(1, Level::best(), |runtime| {
        assert!(usual.usual(runtime).expect("it runs").is_none());
        assert!(halved.halved(runtime).expect("it runs").is_none());
    });

    let map = map(Plane::new(1, 1).expect("memory"));
    let guess = |of: &Overview, others| {
        let Guess { by, finer, .. } = of.guess(&map, others);
        (by, finer)
    };
    assert_eq!([guess(&usual, &copies), guess(&copies, &usual)], [(1, 4), (4, 1)]);
}

#[test]
fn pixels_of_copies_are_valid_if_half_of_theirs_are() {
    let size @ (rows, cols) = (97, 523);
    let is_valid = |y: usize, x: usize| random(1, y, x) >= 520;
    let mask = Mask::from_fn(rows, cols, is_valid);
    let views = [Some(mask), None].map(|mask| view(size, |y, x| random(2, y, x) as u8, mask));
    let [left, right] = views;
    let pair = Pair::new(left, right, 0, 9).expect("legal");

    let copies =
        with_runtime(1, Level::best(), |runtime| Overview::new(&PairRows::new(&pair, runtime)?, runtime));
    let copies = copies.expect("it runs").expect("large enough");
    let expected = Plane::from_fn(24, 130, |y, x| {
        (0..16).filter(|at| is_valid(4 * y + at / 4, 4 * x + at % 4)).count() >= 8
    });
    assert_eq!((copies.factor, copies.valid), (4, expected));
}

#[test]
fn images_are_opposite_if_what_matches_gets_darker_where_it_gets_brighter() {
    let is_opposite = |sign: f32, salt: u64| {
        let scene = |y: usize, x: usize| random(salt, y, x) as f32;
        let left = Plane::from_fn(9, 40, scene);
        // Invalid pixels, and rows between the sampled ones, show the opposite.
        let right = Plane::from_fn(9, 40, |y, x| {
            let is_odd = (y == 4 && (7..27).contains(&x)) || y % 4 > 0;
            3000.0 + if is_odd { -2.0 * sign * scene(y, x + 3) } else { sign * scene(y, x + 3) }
        });
        let valid = Plane::from_fn(9, 40, |y, x| y != 4 || !(10..30).contains(&x));
        let copies = Overview { factor: 1, planes: [left, right], valid };
        // A match before the first column, and one behind the last one.
        let found = Plane::from_fn(9, 40, |_, x| if x < 39 { 3.0 } else { -1.0 });
        copies.is_opposite(&map(found))
    };
    for salt in 1..6 {
        assert!(is_opposite(-1.0, salt) && !is_opposite(1.0, salt));
    }
}

#[test]
fn rows_that_are_off_are_shifted_by_the_least_that_matches_best() {
    let size = (100, 250);
    for off in [0_isize, 4, -6] {
        let scene = |y: usize, x: usize| random(1, y, x) as f32;
        let planes = [
            Plane::from_fn(size.0, size.1, |y, x| scene(y + 10, x)),
            Plane::from_fn(size.0, size.1, |y, x| scene((y + 10).wrapping_add_signed(-off), x + 6)),
        ];
        let copies = of_planes(planes);
        let candidates = Candidates::new(0, 12, size.1).expect("legal");
        let found = with_runtime(1, Level::best(), |runtime| copies.shift(Some(candidates), size, runtime));
        let shift = found.expect("it runs").map(|field| field.coefficients()[0]);
        assert_eq!(shift, (off != 0).then_some(off as f64));
    }
}

#[test]
fn blocks_are_found_where_nine_tenths_of_both_are_valid() {
    let (rows, cols) = (170, 230);
    let shown = |shift: usize, salt: u64| {
        let scene = |y: usize, x: usize| (random(3, y / 4, (x + shift) / 4) / 4) as u8;
        let is_valid = |y: usize, x: usize| random(salt, y, x) >= 70 + x / 4;
        view((rows, cols), scene, Some(Mask::from_fn(rows, cols, is_valid)))
    };
    let pair = Pair::new(shown(0, 4), shown(6, 5), 0, 16).expect("legal");
    let none = || Plane::new(1, 1).expect("memory");
    let valid = Plane::new(1, 1).expect("memory");
    let overview = Overview { factor: 8, planes: [none(), none()], valid };

    for factor in [1, 2] {
        let places = (40..130).step_by(5).flat_map(|y| (50..180).step_by(13).map(move |x| (y, x)));
        let seed = |(y, x): (usize, usize)| Seed { x: x as f64, y: y as f64, dx: -6.0, dy: 0.0 };
        let seeds: Vec<Seed> = places.clone().map(seed).collect();
        let found = with_runtime(1, Level::best(), |runtime| {
            follow(&PairRows::new(&pair, runtime)?, &overview, &seeds, factor, runtime)
        });
        let found = found.expect("it runs");

        let is_valid = |(side, (y, x)): (usize, (usize, usize))| {
            let mask = pair.views()[side].mask().expect("masked");
            let corner = |at: usize| (at / factor - BLOCK / 2) * factor;
            let block = (0..BLOCK * factor).flat_map(|dy| (0..BLOCK * factor).map(move |dx| (dy, dx)));
            let masked = block.filter(|(dy, dx)| !mask.row(corner(y) + dy)[corner(x) + dx]).count();
            10 * masked <= (BLOCK * factor).pow(2)
        };
        let valid: Vec<_> =
            places.filter(|(y, x)| [(0, (*y, *x)), (1, (*y, *x - 6))].into_iter().all(is_valid)).collect();
        assert!(4 * valid.len() > seeds.len() && valid.len() < seeds.len());

        let middle = |at: usize| (at / factor * factor) as f64 - 0.5;
        let expected: Vec<_> = valid.iter().map(|(y, x)| (middle(*y), middle(*x))).collect();
        assert_eq!(found.iter().map(|one| (one.place.y, one.place.x)).collect::<Vec<_>>(), expected);
        for Track { place: Seed { dx, dy, .. }, .. } in found {
            assert!((dx + 6.0).abs() < 0.6 && dy.abs() < 0.6, "{dx}, {dy}");
        }
    }
}

/// Copies of a scene whose left half is at one disparity and the right one at another, with an upright object
/// in front of it.
fn stage(halves: [usize; 2], thing: usize) -> Overview {
    let (rows, cols) = (112, 320);
    let mut planes = [0, 1].map(|_| Plane::from_fn(rows, cols, |_, _| 0.0));
    let mut show = |salt: u64, disparity: usize, tops: Range<usize>, columns: Range<usize>| {
        for (y, x) in tops.flat_map(|y| columns.clone().map(move |x| (y, x))) {
            let value = random(salt, y, x) as f32 + random(salt, y / 2, x / 2) as f32;
            planes[0].row_mut(y)[x] = value;
            if let Some(x) = x.checked_sub(disparity) {
                planes[1].row_mut(y)[x] = value;
            }
        }
    };
    show(1, halves[0], 0..rows, 0..cols / 2);
    show(2, halves[1], 0..rows, cols / 2..cols);
    if thing > 0 {
        show(3, thing, 20..90, 200..216);
    }
    let valid = planes[0].map(|_| true);
    Overview { factor: 2, planes, valid }
}

#[test]
fn a_range_holds_what_is_found_and_what_stands_before_it() {
    let range_of = |copies: &Overview| {
        with_runtime(1, Level::best(), |runtime| {
            let usual = copies.usual(runtime)?.expect("wide");
            let map = usual.rough(None, None, runtime)?;
            range(Copies { finest: copies, fine: copies, overview: &usual }, &map, false, runtime)
        })
    };
    let found = |halves, thing| range_of(&stage(halves, thing)).expect("it runs").expect("texture").range;

    let plain = found([12, 40], 0);
    assert!((plain.low - 24.0).abs() < 1.0 && (plain.high - 80.0).abs() < 1.0, "{plain:?}");
    assert!(plain.min == 0 && (85..=88).contains(&plain.count) && !plain.identical, "{plain:?}");
    let thing = found([12, 20], 120);
    // Half a pixel of the smallest copies further.
    assert_eq!((thing.high, thing.min), (244.0, 0), "{thing:?}");

    let mut same = stage([0, 0], 0);
    same.planes[1] = same.planes[0].clone();
    let same = range_of(&same).expect("it runs").expect("texture").range;
    assert!(same.identical && same.min == -2 && same.count == 5, "{same:?}");

    let mut apart = stage([12, 40], 0);
    apart.planes[1] = stage([3, 7], 50).planes[0].map(|value| value.sqrt());
    apart.planes[0] = Plane::from_fn(112, 320, |y, x| random(9, y, x) as f32);
    assert_eq!(range_of(&apart), Ok(None));
}

/// A map of disparities by their numbers.
fn counted(counts: &[(f32, usize)]) -> RoughMap {
    let values: Vec<f32> = counts.iter().flat_map(|(value, count)| vec![*value; *count]).collect();
    map(Plane::from_vec(values.len(), 1, values).expect("all"))
}

#[test]
fn an_extent_grows_by_what_is_next_to_it_and_frequent() {
    let mut counts: Vec<_> = (10..=30).map(|value| (value as f32 + 0.3, 250)).collect();
    counts.extend([(8.0, 6), (32.0, 6), (34.8, 6), (f32::NAN, 900)]);
    // Too few, or too far.
    counts.extend([(6.0, 5), (37.6, 5), (40.0, 6), (60.0, 8)]);
    assert_eq!(extent(&counted(&counts).disparity), Some((8, 35)));
    assert_eq!(extent(&counted(&[(-3.0, 700), (-1.0, 2), (1.0, 1)]).disparity), Some((-3, -1)));
    assert_eq!(extent(&counted(&[(f32::NAN, 3)]).disparity), None);
}

#[test]
fn ends_leave_out_the_few_outermost_disparities_of_a_run() {
    let few = [(9.4, 9), (9.5, 2), (9.75, 2), (20.0, 3992), (30.25, 2), (30.5, 2), (30.6, 9)];
    let is_from = |counts: &[(f32, usize)], low: f64, high: f64| {
        ends(&counted(counts), (10, 30)).map(f64::to_bits) == [low, high].map(f64::to_bits)
    };
    assert!(is_from(&few, 9.75, 30.25) && is_from(&[(5.0, 7)], 9.5, 30.5));
}

#[test]
fn signs_count_if_they_are_clear() {
    let signs = |counts: &[(f32, usize)]| signs(&counted(counts));
    assert_eq!(signs(&[(-3.0, 96), (1.0, 4), (f32::NAN, 50)]), (true, false));
    assert_eq!(signs(&[(-3.0, 94), (1.0, 6)]), (false, false));
    assert_eq!(signs(&[(-2.0, 50), (-1.0, 50)]), (true, false));
    assert_eq!(signs(&[(-2.0, 49), (-1.0, 51)]), (false, false));
    assert_eq!(signs(&[(8.0, 94), (-2.0, 6)]), (false, true));
    assert_eq!(signs(&[(-8.0, 94), (2.0, 6)]), (false, true));
    assert_eq!(signs(&[(8.0, 94), (-1.9, 6)]), (false, false));
    assert_eq!(signs(&[(8.0, 96), (-2.0, 4)]), (false, false));
}

#[test]
fn bands_show_most_of_both_ends_and_the_border() {
    // Of 24 bands of two rows, four show most of an end; the last one has only one row.
    let mut disparities = Plane::from_fn(47, 6, |_, _| 5.0f32);
    let lows = [(7, 5), (12, 4), (3, 3), (15, 2), (20, 1)];
    let highs = [(9, 6), (10, 3), (11, 3), (13, 3), (14, 3)];
    for (band, count) in lows {
        disparities.row_mut(2 * band + 1)[..count].fill(3.4);
        disparities.row_mut(40)[..].fill(3.5);
    }
    for (band, count) in highs {
        disparities.row_mut(2 * band)[..count].fill(8.6);
    }

    let bands = bands_at_ends(&map(disparities), (3, 9), 2);
    let expected = [0, 3, 7, 9, 10, 11, 12, 13, 15, 23].map(|band| 2 * band..(2 * band + 2).min(47));
    assert_eq!(bands, expected);
}

#[test]
fn nearer_disparities_are_tried_and_some_across_zero_on_coarse_copies() {
    let copies = of_planes([0, 1].map(|_| Plane::from_fn(1, 100, |_, _| 0.0)));
    let reach = |run| [false, true].map(|is_finer| reach(&copies, run, is_finer));
    assert_eq!(reach((4, 20)), [(-11, 45), (4, 45)]);
    assert_eq!(reach((-20, 30)), [(-20, 45), (-20, 45)]);
    assert_eq!(reach((-5, 5)), [(-11, 45), (-5, 45)]);
    assert_eq!(reach((-20, -4)), [(-45, 11), (-45, -4)]);
    assert_eq!(reach((-30, 20)), [(-45, 20), (-45, 20)]);
}

#[test]
fn an_area_belongs_to_the_range_if_it_is_certain_the_less_so_beside_it() {
    let belongs =
        |span, seen, gain, run| belongs(&Area { rows: 0..9, columns: 0..9, span, size: 20, seen, gain }, run);
    assert!(belongs((40, 42), 14, 1000, (4, 20)) && !belongs((40, 42), 13, 1000, (4, 20)));
    assert!(!belongs((40, 42), 20, 999, (4, 20)));

    // A quarter of the length of a run is four.
    for (first, run) in [(20, (4, 20)), (24, (4, 20)), (-26, (-20, -4)), (-22, (-20, -4))] {
        assert!(belongs((first, first + 2), 14, 500, run), "{first}");
        assert!(!belongs((first, first + 2), 14, 499, run), "{first}");
    }
    for (first, run) in [(19, (4, 20)), (25, (4, 20)), (-27, (-20, -4)), (-21, (-20, -4))] {
        assert!(!belongs((first, first + 2), 14, 500, run), "{first}");
    }
    assert!(belongs((10, 14), 14, 500, (-10, 10)));
}

#[test]
fn places_beyond_the_candidates_are_left_out() {
    let area = Area { rows: 2..5, columns: 7..9, span: (-3, 4), size: 6, seen: 6, gain: 9 };
    let place = LeftOut { rows: 8..20, columns: 28..36, low: -14.0, high: 18.0 };
    assert_eq!(LeftOut::new(&area, 4), place);

    let candidates = Candidates::new(-2, 12, 100).expect("legal");
    let is_left_out =
        |low: f64, high: f64| !beyond(vec![LeftOut { low, high, ..place.clone() }], candidates).is_empty();
    assert!(is_left_out(-4.0, -1.5) && !is_left_out(-4.0, -1.0));
    assert!(is_left_out(8.0, 11.5) && !is_left_out(8.0, 11.0));
}

#[test]
fn the_candidates_of_a_range_fit_the_image() {
    let range = |min, count| {
        let (low, high, of_none) = (0.0, 0.0, false);
        let (negative, mixed, identical) = (of_none, of_none, of_none);
        let shown = Signs::NONE;
        let range = SearchRange { min, count, low, high, negative, mixed, shown, identical };
        range.candidates(50).map(|all| (all.min(), all.count())).expect("legal")
    };
    assert_eq!(range(-3, 20), (-3, 20));
    assert_eq!(range(-70, 0), (-49, 1));
    assert_eq!(range(70, 80), (49, 50));
}

#[test]
fn images_are_identical_up_to_noise_if_nothing_has_moved_anywhere() {
    let (rows, cols) = (42, 58);
    let scene = |y: f64, x: f64| 90.0 * (math::sin(0.61 * y + 0.3 * x) + math::cos(0.83 * x));
    let is_identical = |right: &dyn Fn(f64, f64) -> f64, noise: f32| {
        let plane = |of: &dyn Fn(f64, f64) -> f64, noise: f32| {
            Plane::from_fn(rows, cols, |y, x| {
                of(y as f64, x as f64) as f32 + noise * (random(4, y, x) as f32 / 500.0 - 1.0)
            })
        };
        is_identical(&of_planes([plane(&scene, 0.0), plane(right, noise)]))
    };

    assert!(is_identical(&scene, 0.0) && is_identical(&scene, 8.0));
    assert!(!is_identical(&scene, 200.0));
    for (top, left) in (1..33).step_by(8).flat_map(|y| (1..49).step_by(8).map(move |x| (y, x))) {
        let is_there = |at: f64, first: i32| (0.0..8.0).contains(&(at - f64::from(first)));
        let part = |y, x| scene(y, if is_there(y, top) && is_there(x, left) { x + 1.0 } else { x });
        assert!(!is_identical(&part, 0.0), "a part at {top}, {left}");
    }
    assert!(is_identical(&|y, x| scene(y, x + 0.03), 0.0));
    assert!(is_identical(&|y, x| 0.6 * scene(y, x) + 20.0, 4.0));
    assert!(is_identical(&|y, x| 0.6 * scene(y, x + 0.03) + 20.0, 0.0));
    assert!(!is_identical(&|y, x| 0.6 * scene(y, x + 0.08) + 20.0, 0.0));
    assert!(is_identical(&|y, x| 255.0 * (scene(y, x) / 400.0 + 0.5).sqrt(), 4.0));
    assert!(!is_identical(&|y, x| scene(y, x + 0.08), 0.0));
    assert!(!is_identical(&|y, x| scene(y, x - 0.08), 0.0));
    assert!(!is_identical(&|y, x| scene(y + 0.08, x), 0.0));
    assert!(!is_identical(&|y, x| scene(y - 0.08, x), 0.0));
}
