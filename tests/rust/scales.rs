//! Matching over scales: every stage as a naive one computes it, and planes where they were put.

use std::collections::BTreeSet;

use crate::common::{hash, levels};
use ndarray::Array3;
use phasestereo::internals::image::plane::Plane;
use phasestereo::internals::image::view::{Image, Mask, View};
use phasestereo::internals::image::window_sums::window_means;
use phasestereo::internals::pipeline::control::Control;
use phasestereo::internals::pipeline::matcher::{Disparity, Execution, Matcher, Pair, Timings};
use phasestereo::internals::refinement::flag;
use phasestereo::internals::rig::estimation::{Known, Means, prepare, prepare_and_match};
use phasestereo::internals::scales::choice::{Doubt, choose};
use phasestereo::internals::scales::flat_areas::{FlatArea, flat_areas};
use phasestereo::internals::scales::planes::draw;
use phasestereo::internals::scales::reduction::halved;
use phasestereo::internals::settings::Settings;
use phasestereo::internals::simd::Level;

/// A number from 0 to 1.
fn random(salt: u64, y: usize, x: usize) -> f32 {
    (hash(salt, y, x) % 1024) as f32 / 1023.0
}

/// A map whose confidences are low in some places and high in others.
fn map((rows, cols): (usize, usize), salt: u64, scale: f32) -> Disparity {
    let patch = |y: usize, x: usize| random(salt, y / 9, x / 11);
    let confidence =
        |y: usize, x: usize| (0.7 * patch(y, x) + 0.3 * random(salt + 1, y, x)).clamp(0.0, 1.0);
    let disparity = |y: usize, x: usize| {
        let is_missing = hash(salt + 2, y, x).is_multiple_of(17);
        if is_missing { f32::NAN } else { scale * (8.0 + 3.0 * random(salt + 3, y / 4, x / 6)) }
    };

    Disparity {
        disparity: Plane::from_fn(rows, cols, disparity),
        flags: Plane::from_fn(rows, cols, |y, x| (hash(salt + 4, y, x) % 4) as u16 * 128),
        confidence: Some(Plane::from_fn(rows, cols, confidence)),
        uncertainty: Some(Plane::from_fn(rows, cols, |y, x| 1.0 + random(salt + 5, y, x))),
        wrong: None,
        timings: Timings::default(),
    }
}

/// The mean of the window that reaches so far, as far as the plane does.
fn naive_mean(plane: &Plane<f32>, (y, x): (usize, usize), radius: isize) -> f32 {
    let (mut sum, mut count) = (0_u64, 0_u64);
    for dy in -radius..=radius {
        for dx in -radius..=radius {
            let (y, x) = (y as isize + dy, x as isize + dx);
            let is_inside =
                (0..plane.rows() as isize).contains(&y) && (0..plane.cols() as isize).contains(&x);
            if is_inside {
                sum += (plane.row(y as usize)[x as usize] * 1_048_576.0) as u64;
                count += 1;
            }
        }
    }
    (sum as f64 / count as f64) as f32 / 1_048_576.0
}

#[test]
fn means_of_windows_are_those_of_every_window_by_itself() {
    for (size, radius) in [((1, 1), 3), ((70, 9), 2), ((131, 40), 15), ((5, 80), 30)] {
        let plane = Plane::from_fn(size.0, size.1, |y, x| random(7, y, x));

        let means = window_means(size, radius, |y| plane.row(y).iter().copied());

        let naive =
            Plane::from_fn(size.0, size.1, |y, x| naive_mean(&plane, (y, x), radius as isize));
        assert_eq!(means, Ok(naive), "{size:?}, {radius}");
    }
}

/// The value of a copy at a pixel of the map: its own pixel and the three nearest others.
fn naive_neighbors(plane: &Plane<f32>, y: usize, x: usize) -> [f32; 4] {
    let beside = |at: usize, count: usize| {
        let other = if at.is_multiple_of(2) { (at / 2).max(1) - 1 } else { at / 2 + 1 };
        other.min(count - 1)
    };
    let (y0, x0) = ((y / 2).min(plane.rows() - 1), (x / 2).min(plane.cols() - 1));
    let (y1, x1) = (beside(y, plane.rows()), beside(x, plane.cols()));
    [plane.row(y0)[x0], plane.row(y0)[x1], plane.row(y1)[x0], plane.row(y1)[x1]]
}

fn naive_blend([a, b, c, d]: [f32; 4]) -> f32 {
    (9.0 * a + 3.0 * (b + c) + d) / 16.0
}

/// Disparity, flags, confidence and bar of a pixel after the choice.
fn naive_choice(fine: &Disparity, coarse: &Disparity, y: usize, x: usize) -> (f32, u16, f32, f32) {
    let known = |map: &Disparity| {
        (map.confidence.clone().expect("made so"), map.uncertainty.clone().expect("made so"))
    };
    let ((confidence, bars), (coarse_confidence, coarse_bars)) = (known(fine), known(coarse));
    let as_it_is =
        (fine.disparity.row(y)[x], fine.flags.row(y)[x], confidence.row(y)[x], bars.row(y)[x]);

    let stricter = |c: f32| c / (c + (1.0 - c) * 3.0);
    let lacking = confidence.map(|c| 1.0 - c);
    let doubt = naive_mean(&lacking, (y, x), 15);
    if doubt <= 0.4 || as_it_is.0.is_nan() {
        return as_it_is;
    }

    let coarse_lacking = coarse_confidence.map(|c| 1.0 - stricter(*c));
    let means = Plane::from_fn(coarse_lacking.rows(), coarse_lacking.cols(), |y, x| {
        naive_mean(&coarse_lacking, (y, x), 7)
    });
    let coarse_doubt = naive_blend(naive_neighbors(&means, y, x));
    let sure = stricter(naive_blend(naive_neighbors(&coarse_confidence, y, x)));

    let found = naive_neighbors(&coarse.disparity, y, x);
    let is_smooth = found.iter().all(|other| (other - found[0]).abs() <= 1.0);
    let disparity = 2.0 * if is_smooth { naive_blend(found) } else { found[0] };

    if doubt <= coarse_doubt + 0.05 || sure <= as_it_is.2 || disparity.is_nan() {
        return as_it_is;
    }
    let (row, col) = ((y / 2).min(means.rows() - 1), (x / 2).min(means.cols() - 1));
    let flags = coarse.flags.row(row)[col] | 2048;
    (disparity, flags, sure, 2.0 * coarse_bars.row(row)[col])
}

#[test]
fn the_choice_is_that_of_a_naive_one() {
    let mut changed = 0;
    for (size, salt) in [((41, 57), 1), ((52, 38), 20), ((33, 61), 40)] {
        let mut fine = map(size, salt, 2.0);
        let coarse = map((size.0 / 2, size.1 / 2), salt + 9, 1.0);
        let before = fine.clone();
        let doubt = Doubt::of_map(&fine).expect("enough memory").expect("confidences");

        choose(&mut fine, &doubt, &coarse).expect("enough memory");

        for (y, x) in (0..size.0).flat_map(|y| (0..size.1).map(move |x| (y, x))) {
            let (disparity, flags, confidence, bar) = naive_choice(&before, &coarse, y, x);
            let (found, sure) = (fine.confidence.as_ref(), fine.uncertainty.as_ref());
            assert_eq!(fine.disparity.row(y)[x].to_bits(), disparity.to_bits(), "{y}, {x}");
            assert_eq!(fine.flags.row(y)[x], flags, "{y}, {x}");
            assert_eq!(found.map(|plane| plane.row(y)[x]), Some(confidence), "{y}, {x}");
            assert_eq!(sure.map(|plane| plane.row(y)[x]), Some(bar), "{y}, {x}");
            changed += usize::from(flags & 2048 != 0);
        }
    }
    assert!(changed > 200, "{changed} pixels were chosen from the copy");
}

/// Gray values with smooth patches in texture.
fn patched(rows: usize, cols: usize) -> Plane<i32> {
    Plane::from_fn(rows, cols, |y, x| {
        let is_smooth = random(3, y / 23, x / 31) > 0.5;
        let grain = random(4, y, x) * if is_smooth { 40.0 } else { 4000.0 };
        // Large texture has a small Laplacian.
        let waves = if is_smooth { 0.0 } else { 1500.0 * (((x + 2 * y) % 16) as f32 - 8.0).abs() };
        (grain + waves) as i32
    })
}

fn naive_flat(gray: &Plane<i32>) -> Plane<bool> {
    let (rows, cols) = (gray.rows(), gray.cols());
    let mut laplacian: Vec<i64> = (1..rows - 1)
        .flat_map(|y| (1..cols - 1).map(move |x| (y, x)))
        .map(|(y, x)| {
            let [g, n, s] = [y, y - 1, y + 1].map(|y| gray.row(y));
            i64::from((4 * g[x] - n[x] - s[x] - g[x - 1] - g[x + 1]).abs())
        })
        .collect();
    laplacian.sort_unstable();
    let noise = i128::from(laplacian[laplacian.len() / 2]);

    let near = |at: usize, by: usize, count: usize| at.saturating_sub(by)..(at + by + 1).min(count);
    let flat = Plane::from_fn(rows, cols, |y, x| {
        let values: Vec<i128> = near(y, 2, rows)
            .flat_map(|y| near(x, 2, cols).map(move |x| (y, x)))
            .map(|(y, x)| gray.row(y)[x].into())
            .collect();
        let count = values.len() as i128;
        let sum: i128 = values.iter().sum();
        let squares: i128 = values.iter().map(|value| value * value).sum();
        count * squares - sum * sum <= (count * noise).pow(2)
    });

    let every = |plane: &Plane<bool>, y: usize, x: usize, wanted: bool| {
        near(y, 1, rows).all(|y| near(x, 1, cols).all(|x| plane.row(y)[x] == wanted))
    };
    let eroded = Plane::from_fn(rows, cols, |y, x| every(&flat, y, x, true));
    Plane::from_fn(rows, cols, |y, x| !every(&eroded, y, x, false))
}

#[test]
fn flat_areas_are_those_of_a_naive_search() {
    let gray = patched(90, 130);
    let flat = naive_flat(&gray);

    // Every pixel of a flat area, by the first pixel that it is connected with.
    let mut naive = BTreeSet::new();
    let mut seen = BTreeSet::new();
    for start in (0..90).flat_map(|y| (0..130).map(move |x| (y, x))) {
        let (mut open, mut area) = (vec![start], BTreeSet::new());
        while let Some((y, x)) = open.pop() {
            let is_inside = y < 90 && x < 130;
            if is_inside && flat.row(y)[x] && seen.insert((y, x)) {
                area.insert((y, x));
                open.extend([(y + 1, x), (y, x + 1)]);
                open.extend(y.checked_sub(1).map(|y| (y, x)));
                open.extend(x.checked_sub(1).map(|x| (y, x)));
            }
        }
        if area.len() >= 117 {
            naive.insert(area);
        }
    }

    let areas = flat_areas(gray, 1 << 13, &Control::default()).expect("enough memory");
    let pixels = |area: &FlatArea| {
        let marked = area.near((&(0..90), &(0..130)), 0, &Control::default()).expect("memory");
        let all = (0..90).flat_map(|y| (0..130).map(move |x| (y, x)));
        all.filter(|&(y, x)| marked.row(y)[x]).collect::<BTreeSet<_>>()
    };

    assert!(naive.len() > 1);
    assert_eq!(areas.iter().map(pixels).collect::<BTreeSet<_>>(), naive);
}

/// Gray values as a view.
fn as_view(plane: &Plane<i32>) -> View {
    let pixel = |(y, x, _)| plane.row(y)[x] as u16;
    View::from(Image::U16(Array3::from_shape_fn((plane.rows(), plane.cols(), 1), pixel)))
}

/// A smooth board in texture: rows, columns.
const BOARD: [std::ops::Range<usize>; 2] = [30..150, 40..220];

fn is_board(y: usize, x: usize) -> bool {
    BOARD[0].contains(&y) && BOARD[1].contains(&x)
}

/// A pair that shows the board, and a map that knows `surface` at its outline alone.
fn board(surface: impl Fn(usize, usize) -> f32) -> (Pair, Disparity) {
    let gray = Plane::from_fn(180, 260, |y, x| {
        let grain = hash(5, y, x) % 2000;
        if is_board(y, x) { 9000 + grain as i32 / 100 } else { 8000 + 2 * grain as i32 }
    });
    let pair = Pair::new(as_view(&gray), as_view(&gray), 0, 64).expect("a legal pair");

    // Inside, 8 px from the outline, nothing is known: the disparities are wrong and in doubt.
    let is_unknown = |y: usize, x: usize| {
        is_board(y.saturating_sub(8), x.saturating_sub(8)) && is_board(y + 8, x + 8)
    };
    let disparity = |y: usize, x: usize| {
        if is_unknown(y, x) { 60.0 * random(6, y / 5, x / 5) } else { surface(y, x) }
    };
    let map = Disparity {
        disparity: Plane::from_fn(180, 260, disparity),
        flags: Plane::from_fn(180, 260, |_, _| flag::FILLED),
        confidence: Some(Plane::from_fn(
            180,
            260,
            |y, x| if is_unknown(y, x) { 0.2 } else { 0.95 },
        )),
        uncertainty: Some(Plane::from_fn(180, 260, |_, _| 1.0)),
        wrong: None,
        timings: Timings::default(),
    };
    (pair, map)
}

fn drawn(pair: &Pair, mut map: Disparity) -> Disparity {
    draw(&mut map, pair, Level::best(), &Control::default()).expect("enough memory");
    map
}

#[test]
fn a_plain_board_becomes_the_plane_of_its_outline() {
    let plane = |y: usize, x: usize| 10.0 + 0.1 * x as f32 - 0.05 * y as f32;
    let (pair, before) = board(plane);
    let map = drawn(&pair, before.clone());

    for (y, x) in [(40, 60), (90, 130), (140, 200)] {
        assert!((map.disparity.row(y)[x] - plane(y, x)).abs() < 0.05, "{y}, {x}");
        assert_eq!(map.flags.row(y)[x], flag::INFERRED);
    }

    // A plane is as sure as the outline agrees, less so far from it.
    let (confidence, bars) = (map.confidence.expect("made so"), map.uncertainty.expect("made so"));
    assert!((0.6..0.75).contains(&confidence.row(90)[130]), "{}", confidence.row(90)[130]);
    assert!((0.8..0.9).contains(&confidence.row(40)[60]), "{}", confidence.row(40)[60]);
    assert!((3.0..6.0).contains(&bars.row(90)[130]), "{}", bars.row(90)[130]);

    // The texture around keeps what it has.
    assert_eq!(map.disparity.row(10), before.disparity.row(10));
    assert_eq!(map.flags.row(10), before.flags.row(10));
}

#[test]
fn what_is_not_a_plane_is_not_drawn() {
    let ball = |y: usize, x: usize| {
        let [y, x] = [y as f32 - 90.0, x as f32 - 130.0];
        40.0 - (y * y + x * x) / 500.0
    };
    let (pair, before) = board(ball);
    let map = drawn(&pair, before.clone());
    assert_eq!(map, before);

    // Nothing lies behind infinity.
    let (pair, before) = board(|y, _| -3.0 - 0.1 * y as f32);
    assert_eq!(drawn(&pair, before.clone()), before);
}

fn means<'a>(
    matcher: &'a Matcher,
    threads: usize,
    level: Level,
    control: &'a Control,
) -> Means<'a> {
    Means { matcher, how: Execution { threads, level }, control }
}

#[test]
fn a_copy_is_the_mean_of_squares_and_its_range_covers_that_of_the_pair() {
    let image = |salt: u64| {
        let pixel = |(y, x, c)| (hash(salt + c as u64, y, x) % 256) as u8;
        let mask = Mask::from_fn(231, 243, |y, x| !hash(salt + 7, y, x).is_multiple_of(50));
        let mask = (salt > 20).then_some(mask);
        View { mask, ..View::from(Image::U8(Array3::from_shape_fn((231, 243, 3), pixel))) }
    };
    let (left, right) = (image(1), image(31));
    let control = Control::default();
    let matcher = Matcher::new(1).expect("a thread");
    let means = means(&matcher, 1, Level::best(), &control);

    for (min, count, low, high) in [(0, 64, 0, 32), (-31, 40, -16, 4), (7, 9, 3, 8)] {
        let pair = Pair::new(left.clone(), right.clone(), min, count).expect("a legal pair");
        let copy = halved(&pair, means).expect("enough memory").expect("large enough");
        let candidates = copy.candidates();
        assert_eq!((copy.size(), candidates.min()), ((115, 121), low));
        assert_eq!(candidates.disparity(candidates.count() - 1), high);

        let [copied, masked] = copy.views();
        let (Image::U8(pixels), Image::U16(found)) = (&left.image, &copied.image) else {
            panic!("16 bits for 8")
        };
        for (y, x) in [(0, 0), (17, 99), (114, 120)] {
            let four = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(dy, dx)| {
                let [r, g, b] = [0, 1, 2].map(|c| u64::from(pixels[(2 * y + dy, 2 * x + dx, c)]));
                299 * r + 587 * g + 114 * b
            });
            let expected = four.iter().sum::<u64>() as f64 / 4000.0;
            let found = f64::from(found[(y, x, 0)]) * copied.unit;
            assert!((found - expected).abs() < 0.005, "{found}, {expected}");
        }

        let mask = right.mask.as_ref().expect("made so");
        let is_valid = |y: usize, x: usize| {
            mask.row(y)[x] && mask.row(y)[x + 1] && mask.row(y + 1)[x] && mask.row(y + 1)[x + 1]
        };
        for (y, x) in (0..115).flat_map(|y| (0..121).map(move |x| (y, x))) {
            assert_eq!(masked.is_valid(y, x), is_valid(2 * y, 2 * x));
        }
    }

    let small = Pair::new(left.of_rows(0..199), right.of_rows(0..199), 0, 64).expect("legal");
    assert_eq!(halved(&small, means), Ok(None));
    let narrow = Pair::new(left, right, 0, 7).expect("legal");
    assert_eq!(halved(&narrow, means), Ok(None));
}

/// A pair whose texture is so faint and noisy that only copies match.
fn blocks() -> Pair {
    let texture = |y: usize, x: f32| {
        let cell = |x: usize| random(11, y / 16, x) * 50.0;
        let at = x / 16.0;
        cell(at as usize) + (cell(at as usize + 1) - cell(at as usize)) * at.fract()
    };
    let image = |salt: u64, shift: f32| {
        let noise = |y, x| {
            let parts = [0, 1, 2].map(|part| random(salt + part, y, x));
            60.0 * (parts.iter().sum::<f32>() - 1.5)
        };
        let pixel = |(y, x, _)| {
            (48.0 + texture(y, x as f32 + 20.0 + shift) + noise(y, x)).clamp(0.0, 255.0) as u8
        };
        View::from(Image::U8(Array3::from_shape_fn((260, 300, 1), pixel)))
    };
    Pair::new(image(20, 0.0), image(30, 14.0), 0, 32).expect("a legal pair")
}

#[test]
fn copies_decide_where_the_pair_has_no_evidence_with_the_same_bits_everywhere() {
    let (settings, control) = (Settings::default(), Control::default());
    let known = || Known { candidates: Some(blocks().candidates()), ..Known::default() };

    let result = |threads, level| {
        let matcher = Matcher::new(threads).expect("threads");
        let means = means(&matcher, threads, level, &control);
        prepare_and_match(blocks(), known(), &settings, means).expect("a legal pair").0
    };

    let found = result(1, Level::best());
    let coarse = found.flags.as_slice().iter().filter(|flags| **flags & flag::COARSE != 0).count();
    assert!(coarse > 260 * 300 / 4, "{coarse} pixels of copies");

    for (threads, level) in levels().into_iter().map(|level| (1, level)).chain([(3, Level::best())])
    {
        let other = result(threads, level);
        assert_eq!(other.disparity, found.disparity);
        assert_eq!(other.flags, found.flags);
        assert_eq!(
            (other.confidence, other.uncertainty),
            (found.confidence.clone(), found.uncertainty.clone())
        );
    }

    // They make it better.
    let matcher = Matcher::new(1).expect("a thread");
    let means = means(&matcher, 1, Level::best(), &control);
    let prepared = prepare(blocks(), known(), &settings, means).expect("a legal pair");
    let alone = matcher
        .match_pair(&prepared.pair, &prepared.settings, means.how, &control)
        .expect("a legal pair");
    let right = |map: &Disparity| {
        map.disparity.as_slice().iter().filter(|value| (**value - 14.0).abs() <= 2.0).count()
    };
    assert!(right(&found) > right(&alone) + 260 * 300 / 20, "{} {}", right(&found), right(&alone));
}
