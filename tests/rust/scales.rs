//! Matching over scales: every stage as a naive one computes it.

use crate::common::{hash, levels, with_runtime};
use ndarray::Array3;
use phasestereo::internals::estimation::facts::{Fact, Facts};
use phasestereo::internals::estimation::{Prepared, complete, prepare};
use phasestereo::internals::match_pair::match_pair;
use phasestereo::internals::scales::choice::{Doubt, choose, conclude};
use phasestereo::internals::scales::ranges::panel_ranges;
use phasestereo::internals::scales::reduction::halved;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::view::Mask;
use phasestereo_match::image::window_sums::window_means;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::{Disparity, Timings};
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::refinement::flag;
use phasestereo_match::settings::{Optimizer, Settings};

/// A number from 0 to 1.
pub fn random(salt: u64, y: usize, x: usize) -> f32 {
    (hash(salt, y, x) % 1024) as f32 / 1023.0
}

/// A map whose confidences are low in some places and high in others.
fn map((rows, cols): (usize, usize), salt: u64, scale: f32) -> Disparity {
    let patch = |y: usize, x: usize| random(salt, y / 9, x / 11);
    let confidence = |y: usize, x: usize| (0.7 * patch(y, x) + 0.3 * random(salt + 1, y, x)).clamp(0.0, 1.0);
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
        detail: None,
        timings: Timings::default(),
    }
}

/// The mean of the window that reaches so far, as far as the plane does.
pub fn naive_mean(plane: &Plane<f32>, (y, x): (usize, usize), radius: isize) -> f32 {
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

        let runtime = window_means(size, radius, |y| plane.row(y).iter().copied(), Level::best());

        let naive = Plane::from_fn(size.0, size.1, |y, x| naive_mean(&plane, (y, x), radius as isize));
        assert_eq!(runtime, Ok(naive), "{size:?}, {radius}");
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
fn naive_choice(
    fine: &Disparity,
    coarse: &Disparity,
    [low, high]: [f32; 2],
    (y, x): (usize, usize),
) -> (f32, u16, f32, f32) {
    let known = |map: &Disparity| {
        (map.confidence.clone().expect("made so"), map.uncertainty.clone().expect("made so"))
    };
    let ((confidence, bars), (coarse_confidence, coarse_bars)) = (known(fine), known(coarse));
    let as_it_is = (fine.disparity.row(y)[x], fine.flags.row(y)[x], confidence.row(y)[x], bars.row(y)[x]);

    let stricter = |c: f32| c / (c + (1.0 - c) * 3.0);
    let lacking = confidence.map(|c| 1.0 - c);
    let doubt = naive_mean(&lacking, (y, x), 15);
    if doubt <= 0.4 || as_it_is.0.is_nan() {
        return as_it_is;
    }

    let coarse_lacking = coarse_confidence.map(|c| 1.0 - stricter(*c));
    let runtime = Plane::from_fn(coarse_lacking.rows(), coarse_lacking.cols(), |y, x| {
        naive_mean(&coarse_lacking, (y, x), 7)
    });
    let coarse_doubt = naive_blend(naive_neighbors(&runtime, y, x));
    let sure = stricter(naive_blend(naive_neighbors(&coarse_confidence, y, x)));

    let found = naive_neighbors(&coarse.disparity, y, x);
    let is_smooth = found.iter().all(|other| (other - found[0]).abs() <= 1.0);
    let disparity = 2.0 * if is_smooth { naive_blend(found) } else { found[0] };

    if doubt <= coarse_doubt + 0.05 || sure <= as_it_is.2 || disparity.is_nan() {
        return as_it_is;
    }
    let (row, col) = ((y / 2).min(runtime.rows() - 1), (x / 2).min(runtime.cols() - 1));
    // Halved once more.
    let flags = (coarse.flags.row(row)[col] | 2048) + 4096;
    let within = if disparity < low {
        low
    } else if disparity > high {
        high
    } else {
        disparity
    };
    (within, flags, sure, 2.0 * coarse_bars.row(row)[col])
}

#[test]
fn the_choice_is_that_of_a_naive_one() {
    let mut changed = 0;
    for (size, salt) in [((41, 57), 1), ((52, 38), 20), ((33, 61), 40)] {
        let mut fine = map(size, salt, 2.0);
        let coarse = map((size.0 / 2, size.1 / 2), salt + 9, 1.0);
        let before = fine.clone();
        let doubt = Doubt::of_map(&fine, Level::best()).expect("enough memory").expect("confidences");

        // Some disparities of the copies, 16 to 22 px, lie outside.
        let searched = Candidates::new(18, 4, size.1).expect("legal");

        choose(&mut fine, &doubt, &coarse, searched, Level::best()).expect("enough memory");

        for (y, x) in (0..size.0).flat_map(|y| (0..size.1).map(move |x| (y, x))) {
            let (disparity, flags, confidence, bar) = naive_choice(&before, &coarse, [18.0, 21.0], (y, x));
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

#[test]
fn the_detail_of_a_map_is_the_mean_factor_of_the_copies_that_decided() {
    // Certain of this disparity up to a column: the copy knows the left half, and a copy of its own the right
    // one.
    let certain = |size: (usize, usize), disparity: f32, from: usize| Disparity {
        disparity: Plane::from_fn(size.0, size.1, |_, _| disparity),
        flags: Plane::from_fn(size.0, size.1, |_, _| flag::FILLED),
        confidence: Some(Plane::from_fn(size.0, size.1, |_, x| if x < from { 0.99 } else { 0.01 })),
        ..map(size, 1, 1.0)
    };
    let (mut fine, mut half) = (certain((120, 160), 5.0, 0), certain((60, 80), 10.0, 40));
    let quarter = certain((30, 40), 30.0, 40);

    let decide = |map: &mut Disparity, copy: &Disparity| {
        let searched = Candidates::new(0, 128, 128).expect("legal");
        let doubt = Doubt::of_map(map, Level::best()).expect("enough memory").expect("confidences");
        choose(map, &doubt, copy, searched, Level::best()).expect("enough memory");
    };
    decide(&mut half, &quarter);
    decide(&mut fine, &half);
    conclude(&mut fine);

    // One half of the pixels of each, with no other flags.
    let expected = Plane::from_fn(120, 160, |_, x| if x < 80 { 20.0 } else { 120.0 });
    assert_eq!(fine.disparity, expected);
    assert_eq!(fine.flags, expected.map(|_| flag::FILLED | flag::COARSE));
    assert!(fine.detail.is_some_and(|detail| (detail - 8_f64.sqrt()).abs() < 1e-9));

    // If none decides, there is nothing to report.
    let mut alone = certain((120, 160), 5.0, 160);
    conclude(&mut alone);
    assert_eq!(alone.detail, None);
}

#[test]
fn a_copy_is_the_mean_of_squares_and_its_range_covers_that_of_the_pair() {
    let image = |salt: u64| {
        let pixel = |(y, x, c)| (hash(salt + c as u64, y, x) % 256) as u8;
        let mask = Mask::from_fn(231, 243, |y, x| !hash(salt + 7, y, x).is_multiple_of(50));
        let mask = (salt > 20).then_some(mask);
        Input { mask, ..Image::U8(Array3::from_shape_fn((231, 243, 3), pixel)).into() }
    };
    let inputs = [image(1), image(31)];

    for (min, count, low, high) in [(0, 64, 0, 32), (-31, 40, -16, 4), (7, 9, 3, 8)] {
        let pair = Pair::of_inputs(inputs.clone(), min, count).expect("a legal pair");
        let copy = halved(&pair).expect("large enough");
        let candidates = copy.candidates();
        assert_eq!((copy.size(), candidates.min()), ((115, 121), low));
        assert_eq!(candidates.disparity(candidates.count() - 1), high);

        let [copied, masked] = copy.views();
        assert_eq!(copied.scale().reach(), 1 << 15, "16 bits for 8");
        let Image::U8(pixels) = &inputs[0].image else { panic!("bytes") };
        for (y, x) in [(0, 0), (17, 99), (114, 120)] {
            let four = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(dy, dx)| {
                let [r, g, b] = [0, 1, 2].map(|c| u64::from(pixels[(2 * y + dy, 2 * x + dx, c)]));
                299 * r + 587 * g + 114 * b
            });
            let expected = four.iter().sum::<u64>() as f64 / 4000.0;
            let found = copied.scale().pixel(copied.gray().row(y)[x].into());
            assert!((found - expected).abs() < 0.005, "{found}, {expected}");
        }

        let mask = inputs[1].mask.as_ref().expect("made so");
        let is_valid = |y: usize, x: usize| {
            mask.row(y)[x] && mask.row(y)[x + 1] && mask.row(y + 1)[x] && mask.row(y + 1)[x + 1]
        };
        for (y, x) in (0..115).flat_map(|y| (0..121).map(move |x| (y, x))) {
            assert_eq!(masked.is_valid(y, x), is_valid(2 * y, 2 * x));
        }
    }

    let whole = Pair::of_inputs(inputs.clone(), 0, 64).expect("legal");
    assert_eq!(halved(&whole.of_rows(0..199)), None);
    let narrow = Pair::of_inputs(inputs, 0, 7).expect("legal");
    assert_eq!(halved(&narrow), None);
}

/// A pair with texture so faint and noisy that only copies match.
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
        let pixel =
            |(y, x, _)| (48.0 + texture(y, x as f32 + 20.0 + shift) + noise(y, x)).clamp(0.0, 255.0) as u8;
        Input::from(Image::U8(Array3::from_shape_fn((260, 300, 1), pixel)))
    };
    Pair::of_inputs([image(20, 0.0), image(30, 14.0)], 0, 32).expect("a legal pair")
}

#[test]
fn copies_decide_where_the_pair_has_no_evidence_with_the_same_bits_everywhere() {
    let settings = Settings::default();
    let candidates = Some(Fact::given(blocks().candidates()));
    let facts = &Facts { candidates, ..Facts::default() };

    let result = |threads, level| {
        with_runtime(threads, level, |runtime| match_pair(blocks(), facts, &settings, runtime))
            .expect("a legal pair")
            .map
    };

    let found = result(1, Level::best());
    let coarse = found.flags.as_slice().iter().filter(|flags| **flags & flag::COARSE != 0).count();
    assert!(coarse > 260 * 300 / 4, "{coarse} pixels of copies");
    assert!(found.detail.is_some_and(|detail| (2.0..=4.0).contains(&detail)), "{:?}", found.detail);
    assert!(found.flags.as_slice().iter().all(|flags| *flags < 4096));

    for (threads, level) in levels().into_iter().map(|level| (1, level)).chain([(3, Level::best())]) {
        let other = result(threads, level);
        assert_eq!(other.disparity, found.disparity);
        assert_eq!(other.flags, found.flags);
        assert_eq!(
            (other.confidence, other.uncertainty),
            (found.confidence.clone(), found.uncertainty.clone())
        );
    }

    // They make it better.
    let alone = with_runtime(1, Level::best(), |runtime| {
        let (pair, estimates) = complete(blocks(), facts, &settings, runtime).expect("a legal pair");
        let Prepared { pair, settings, .. } =
            prepare(pair, estimates, facts, &settings, runtime).expect("a legal pair");
        let Runtime { matcher, execution, control } = runtime;
        matcher.match_pair(&pair, &settings, execution, control).expect("a legal pair")
    });
    let right = |map: &Disparity| {
        map.disparity.as_slice().iter().filter(|value| (**value - 14.0).abs() <= 2.0).count()
    };
    assert!(right(&found) > right(&alone) + 260 * 300 / 20, "{} {}", right(&found), right(&alone));
}

/// A wall 30 px off, a board in front of it 120 px off, and a stretch in which the images are unrelated.
fn deep() -> Pair {
    let truth = |y: usize, x: usize| if y < 300 && (400..700).contains(&x) { 120 } else { 30 };
    let texture = |y: usize, x: usize| (hash(40, y / 2, x / 2) % 200) as u8;

    let (rows, cols) = (804, 900);
    let mut right = Array3::from_shape_fn((rows, cols, 1), |(y, x, _)| texture(y, x + 30));
    for (y, x) in (0..300).flat_map(|y| (400..700).map(move |x| (y, x))) {
        right[(y, x - 120, 0)] = texture(y, x + 1000);
    }
    let left = Array3::from_shape_fn((rows, cols, 1), |(y, x, _)| match truth(y, x) {
        120 => texture(y, x + 1000),
        _ if y >= 600 => (hash(41, y, x) % 200) as u8,
        _ => texture(y, x),
    });
    Pair::of_inputs([left, right].map(|pixels| Image::U8(pixels).into()), -4, 400).expect("legal")
}

#[test]
fn a_panel_is_searched_where_its_copy_matches() {
    let ranges = |pair: &Pair, threads: usize, level: Level| {
        with_runtime(threads, level, |runtime| {
            let found = || panel_ranges(pair, Optimizer::SemiGlobal, runtime);
            runtime.matcher.install(found).expect("enough memory")
        })
    };
    let found = ranges(&deep(), 1, Level::best()).expect("large enough");

    // Candidate 0 is the disparity of -4.
    let span = |y: usize, x: usize| {
        let searched = found.at(y, x);
        (searched.start, searched.start + searched.count)
    };
    // Panels by the middle of each. Left of the board, the right image does not show the wall.
    let shown = [288, 416, 480, 544, 608, 672, 736, 800];
    for (y, x) in (0..9).flat_map(|band| shown.map(|x| (64 * band + 32, x))) {
        let (start, end) = span(y, x);
        let has_board = y < 300 && (400..=704).contains(&x);
        let has_wall = y > 256 || !(416..=640).contains(&x);

        assert!(!has_wall || (start <= 34 && 34 < end), "the wall at {y}, {x}: {start}..{end}");
        assert!(!has_board || (start <= 124 && 124 < end), "the board at {y}, {x}: {start}..{end}");
        let has_one = x == 800 || (400..500).contains(&y) || (480..=608).contains(&x) && y < 160;
        if has_one && y < 500 {
            assert_eq!(end - start, 64, "{y}, {x}");
        }
    }
    // Where nothing matches, all are searched.
    assert_eq!((span(700, 300), span(803, 899)), ((0, 400), (0, 400)));

    for (threads, level) in levels().into_iter().map(|level| (1, level)).chain([(3, Level::best())]) {
        assert_eq!(ranges(&deep(), threads, level).as_ref(), Some(&found));
    }

    let all = |pair: &Pair| ranges(pair, 1, Level::best()).is_none();
    let few = Candidates::new(-4, 383, 900).expect("legal");
    assert!(all(&deep().of_rows(0..199)) && all(&deep().searched(few)));
}
