//! Flat areas and their planes: as naive ones are found, to the bit, and where they were put.

use std::collections::BTreeSet;
use std::ops::Range;

use crate::common::gray_of;
use crate::common::hash;
use crate::common::naive::ResultBits;
use crate::scales::{naive_mean, random};
use ndarray::Array3;
use phasestereo::internals::scales::flat_areas::{FlatArea, flat_areas};
use phasestereo::internals::scales::planes::draw;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::pixels::Image;
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::{Disparity, Timings};
use phasestereo_match::pair::Pair;
use phasestereo_match::refinement::flag;

/// Row and column.
type Place = (usize, usize);

/// Gray values of texture, but where it is smooth.
fn textured(
    (rows, cols): (usize, usize),
    salt: u64,
    is_smooth: impl Fn(usize, usize) -> bool,
) -> Plane<i32> {
    Plane::from_fn(rows, cols, |y, x| {
        let is_smooth = is_smooth(y, x);
        let grain = random(salt, y, x) * if is_smooth { 40.0 } else { 1000.0 };
        // Large texture has a small Laplacian.
        let waves = if is_smooth { 0.0 } else { 1500.0 * (((x + 2 * y) % 16) as f32 - 8.0).abs() };
        (grain + waves) as i32
    })
}

/// The same, smooth in patches.
fn patched(size: (usize, usize), salt: u64) -> Plane<i32> {
    textured(size, salt + 1, |y, x| random(salt, y / 23, x / 31) > 0.5)
}

/// The places of the window that reaches so far, as far as the plane does, in reading order.
fn window((y, x): Place, by: usize, (rows, cols): (usize, usize)) -> impl Iterator<Item = Place> {
    let near = move |at: usize, count: usize| at.saturating_sub(by)..(at + by + 1).min(count);
    near(y, rows).flat_map(move |y| near(x, cols).map(move |x| (y, x)))
}

fn places((rows, cols): (usize, usize)) -> impl Iterator<Item = Place> {
    (0..rows).flat_map(move |y| (0..cols).map(move |x| (y, x)))
}

/// The flat areas of an image whose gray values are less than 2^15.
fn naive_areas(gray: &Plane<i32>) -> Vec<BTreeSet<Place>> {
    let size @ (rows, cols) = (gray.rows(), gray.cols());
    // In large images rows are left out.
    let looked_at = (1..rows - 1).step_by((rows * cols / 32_768).max(1));
    let mut laplacian: Vec<i64> = looked_at
        .flat_map(|y| (1..cols - 1).map(move |x| (y, x)))
        .map(|(y, x)| {
            let [g, n, s] = [y, y - 1, y + 1].map(|y| gray.row(y));
            i64::from((4 * g[x] - n[x] - s[x] - g[x - 1] - g[x + 1]).abs())
        })
        .collect();
    laplacian.sort_unstable();
    let noise = i128::from(laplacian[laplacian.len() / 2]);

    let flat = Plane::from_fn(rows, cols, |y, x| {
        let around = || window((y, x), 2, size).map(|(y, x)| i128::from(gray.row(y)[x]));
        let (count, sum) = (around().count() as i128, around().sum::<i128>());
        let squares: i128 = around().map(|value| value * value).sum();
        count * squares - sum * sum <= (count * noise).pow(2)
    });
    let every = |plane: &Plane<bool>, at: Place, wanted: bool| {
        window(at, 1, size).all(|(y, x)| plane.row(y)[x] == wanted)
    };
    let eroded = Plane::from_fn(rows, cols, |y, x| every(&flat, (y, x), true));
    let opened = Plane::from_fn(rows, cols, |y, x| !every(&eroded, (y, x), false));

    // Every pixel of a flat area, by the first pixel that it is connected with.
    let (mut areas, mut seen) = (vec![], BTreeSet::new());
    for start in places(size) {
        let (mut open, mut area) = (vec![start], BTreeSet::new());
        while let Some((y, x)) = open.pop() {
            let is_inside = y < rows && x < cols;
            if is_inside && opened.row(y)[x] && seen.insert((y, x)) {
                area.insert((y, x));
                open.extend([(y + 1, x), (y, x + 1)]);
                open.extend(y.checked_sub(1).map(|y| (y, x)));
                open.extend(x.checked_sub(1).map(|x| (y, x)));
            }
        }
        if 100 * area.len() >= (rows * cols).max(1) {
            areas.push(area);
        }
    }
    areas
}

#[test]
fn flat_areas_are_those_of_a_naive_search() {
    // Of the second one rows are left out.
    for (size, salt) in [((90, 130), 3), ((270, 251), 8)] {
        let gray = patched(size, salt);
        let naive = naive_areas(&gray);

        let areas =
            flat_areas(&gray, 1 << 13, Level::best(), &Control::default()).expect("enough memory");
        let pixels = |area: &FlatArea| {
            let all = (&(0..size.0), &(0..size.1));
            let marked = area.near(all, 0, Level::best(), &Control::default()).expect("memory");
            places(size).filter(|&(y, x)| marked.row(y)[x]).collect::<BTreeSet<_>>()
        };

        assert!(naive.len() > 1);
        assert_eq!(areas.iter().map(pixels).collect::<Vec<_>>(), naive);
    }
}

/// A plane: by column, by row, and height.
type Naive = [f64; 3];

fn naive_height([by_column, by_row, height]: Naive, (y, x): (f64, f64)) -> f64 {
    x * by_column + y * by_row + height
}

/// The plane that most samples are within 0.7 px of, fitted to them three times. A sample is column, row and disparity.
fn naive_fit(samples: &[[f64; 3]]) -> Option<Naive> {
    let near = |plane: Naive| {
        let is_near = move |s: &&[f64; 3]| (s[2] - naive_height(plane, (s[1], s[0]))).abs() < 0.7;
        samples.iter().filter(is_near).collect::<Vec<_>>()
    };

    let mut state = 1_u128;
    let (mut best, mut most) = (None, 0);
    for _ in 0..300 {
        let mut three = vec![];
        for _ in 0..3 {
            state = (state * 6_364_136_223_846_793_005 + 1_442_695_040_888_963_407) % (1 << 64);
            three.push(samples[(state / (1 << 33)) as usize % samples.len()]);
        }
        let less = |k: usize, i: usize| three[k][i] - three[0][i];
        let (bx, by, bd, cx, cy, cd) =
            (less(1, 0), less(1, 1), less(1, 2), less(2, 0), less(2, 1), less(2, 2));

        let span = bx * cy - by * cx;
        let by_column = (bd * cy - by * cd) / span;
        let by_row = (bx * cd - bd * cx) / span;
        let is_flat_enough = by_column.abs() <= 0.5 && by_row.abs() <= 0.7;
        if span.abs() < 100.0 || !is_flat_enough {
            continue;
        }

        let [x, y, d] = three[0];
        let plane = [by_column, by_row, d - by_column * x - by_row * y];
        if near(plane).len() > most {
            (best, most) = (Some(plane), near(plane).len());
        }
    }

    let mut plane = best?;
    for _ in 0..3 {
        let near = near(plane);
        let mean = |i: usize| near.iter().map(|s| s[i]).sum::<f64>() / near.len() as f64;
        let [x, y, d] = [mean(0), mean(1), mean(2)];
        let sum = |of: &dyn Fn(&[f64; 3]) -> f64| near.iter().map(|s| of(s)).sum::<f64>();

        let xx = sum(&|s| (s[0] - x) * (s[0] - x));
        let xy = sum(&|s| (s[0] - x) * (s[1] - y));
        let yy = sum(&|s| (s[1] - y) * (s[1] - y));
        let xd = sum(&|s| (s[0] - x) * (s[2] - d));
        let yd = sum(&|s| (s[1] - y) * (s[2] - d));

        let determinant = xx * yy - xy * xy;
        if determinant >= 1.0 {
            let by_column = (xd * yy - yd * xy) / determinant;
            let by_row = (yd * xx - xd * xy) / determinant;
            plane = [by_column, by_row, d - by_column * x - by_row * y];
        }
    }
    Some(plane)
}

/// Draws the plane of one area of a map into another one.
fn naive_plane(
    map: &Disparity,
    confidence: &Plane<f32>,
    area: &BTreeSet<Place>,
    least: f32,
    out: &mut Disparity,
) {
    let size = (confidence.rows(), confidence.cols());
    let near = |by: usize| {
        places(size).filter(move |at| window(*at, by, size).any(|at| area.contains(&at)))
    };
    let disparity = |(y, x): Place| map.disparity.row(y)[x];
    let mut weights = Plane::from_fn(size.0, size.1, |_, _| 0.0);
    for (y, x) in near(4) {
        weights.row_mut(y)[x] = confidence.row(y)[x] * confidence.row(y)[x];
    }

    let weight = |(y, x): &Place| f64::from(weights.row(*y)[*x]);
    let heavy: Vec<Place> = places(size).filter(|at| weight(at) > 0.25).collect();
    if heavy.len() < 100 {
        return;
    }
    let mut sum = 0.0;
    let sums = heavy.iter().map(|at| {
        sum += weight(at);
        sum
    });
    let sums: Vec<f64> = sums.collect();
    let reached =
        |k: usize| sums.iter().position(|sum| *sum >= sums[sums.len() - 1] / 2000.0 * k as f64);
    let sample = |index: usize| {
        let (y, x) = heavy[index];
        [x as f64, y as f64, disparity((y, x)).into()]
    };
    let samples: Vec<_> = (1..).map_while(reached).map(sample).collect();
    let Some(plane) = naive_fit(&samples) else { return };
    let drawn = |(y, x): Place| naive_height(plane, (y as f64, x as f64)) as f32;

    // Tiles count from the corner of what is near.
    let corner = (near(4).map(|at| at.0).min(), near(4).map(|at| at.1).min());
    let (top, left) = (corner.0.expect("heavy"), corner.1.expect("heavy"));
    let end = (near(4).map(|at| at.0).max(), near(4).map(|at| at.1).max());
    let (bottom, right) = (end.0.expect("heavy"), end.1.expect("heavy"));
    let tiles = ((bottom - top) / 4 + 1, (right - left) / 4 + 1);
    let mean = |is_counted: &dyn Fn(Place) -> bool| {
        Plane::from_fn(tiles.0, tiles.1, |tile_y, tile_x| {
            let inside = places((4, 4)).map(|(y, x)| (top + 4 * tile_y + y, left + 4 * tile_x + x));
            let inside = inside.filter(|(y, x)| *y <= bottom && *x <= right);
            let counted = inside.filter(|at| is_counted(*at));
            counted.map(|(y, x)| weights.row(y)[x] / 16.0).fold(0.0, |a, b| a + b)
        })
    };
    let agree = mean(&|at| (disparity(at) - drawn(at)).abs() < 1.0);
    let all = mean(&|_| true);

    let sum = |plane: &Plane<f32>| plane.as_slice().iter().map(|v| f64::from(*v)).sum::<f64>();
    let whole = (sum(&agree) / sum(&all)) as f32;
    if whole <= 0.5 {
        return;
    }

    let nearby =
        |plane: &Plane<f32>| Plane::from_fn(tiles.0, tiles.1, |y, x| naive_mean(plane, (y, x), 7));
    let (agree, all) = (nearby(&agree), nearby(&all));
    for (y, x) in near(2) {
        let (tile_y, tile_x) = ((y - top) / 4, (x - left) / 4);
        let (agree, all) = (agree.row(tile_y)[tile_x], all.row(tile_y)[tile_x]);
        let p = 0.9 * (agree + 0.2 * whole) / (all + 0.2);

        let sure = confidence.row(y)[x].max(naive_mean(confidence, (y, x), 4));
        let is_other = (disparity((y, x)) - drawn((y, x))).abs() > 0.5;
        if sure < 0.9 && p > sure && drawn((y, x)) >= least && is_other {
            out.disparity.row_mut(y)[x] = drawn((y, x));
            out.flags.row_mut(y)[x] = map.flags.row(y)[x] & !256 & !2048 | 1024;
            let (confidence, bars) = (out.confidence.as_mut(), out.uncertainty.as_mut());
            confidence.expect("made so").row_mut(y)[x] = p;
            bars.expect("made so").row_mut(y)[x] = 9.0 * (1.0 - p) / p;
        }
    }
}

/// The planes of a pair whose left image has these pixels, of 16 bits.
fn naive_planes(pixels: &Plane<i32>, min: i64, map: &Disparity) -> Disparity {
    // Less the middle of the range, and halved, so that 15 bits remain.
    let gray = pixels.map(|value| (value - 32_768).div_euclid(2));
    let confidence = map.confidence.as_ref().expect("made so");
    let least = if min < 0 { f32::NEG_INFINITY } else { 0.0 };

    let mut out = map.clone();
    for area in naive_areas(&gray) {
        naive_plane(map, confidence, &area, least, &mut out);
    }
    out
}

/// A map of a plane, of which a share of the pixels is off, in clumps, and in more doubt.
fn scattered((rows, cols): (usize, usize), plane: [f32; 3], off: f32, salt: u64) -> Disparity {
    let is_off = |y: usize, x: usize| random(salt, y / 3, x / 4) < off;
    let is_missing = |y: usize, x: usize| hash(salt + 1, y, x).is_multiple_of(41);

    let disparity = |y: usize, x: usize| {
        let right = x as f32 * plane[0] + y as f32 * plane[1] + plane[2];
        match (is_missing(y, x), is_off(y, x)) {
            (true, _) => f32::NAN,
            (_, true) => right + 3.0 + 20.0 * random(salt + 2, y, x),
            (_, false) => right + 2.4 * (random(salt + 3, y, x) - 0.5),
        }
    };
    let confidence = |y: usize, x: usize| match (is_missing(y, x), is_off(y, x)) {
        (true, _) => 0.0,
        (_, true) => 0.6 * random(salt + 4, y, x),
        (_, false) => 0.3 + 0.7 * random(salt + 5, y / 5, x / 5),
    };
    Disparity {
        disparity: Plane::from_fn(rows, cols, disparity),
        flags: Plane::from_fn(rows, cols, |y, x| (hash(salt + 6, y, x) % 4096) as u16 & !1024),
        confidence: Some(Plane::from_fn(rows, cols, confidence)),
        uncertainty: Some(Plane::from_fn(rows, cols, |y, x| random(salt + 7, y, x))),
        wrong: None,
        detail: None,
        timings: Timings::default(),
    }
}

/// The number of drawn pixels, which must be those of the naive planes.
fn compared(pixels: &Plane<i32>, min: i64, map: &Disparity) -> usize {
    let pair = Pair::new(as_view(pixels), as_view(pixels), min, 40).expect("a legal pair");
    let found = drawn(&pair, map.clone());
    let count = found.flags.as_slice().iter().filter(|flags| **flags & 1024 != 0).count();

    assert!(ResultBits::new(found) == ResultBits::new(naive_planes(pixels, min, map)));
    count
}

#[test]
fn planes_of_random_maps_are_those_of_a_naive_search() {
    let mut counts = vec![];
    for salt in (0..240).step_by(20) {
        let size = (50 + hash(salt, 0, 0) as usize % 60, 60 + hash(salt, 0, 1) as usize % 60);
        let of = |index: usize| random(salt, 1, index) - 0.5;
        let plane = [0.8 * of(0), of(1), 40.0 * of(2) + 20.0];
        let min = if of(3) > 0.0 { 0 } else { -50 };

        let pixels = patched(size, salt + 10);
        counts.push(compared(&pixels, min, &scattered(size, plane, of(4) + 0.5, salt)));
    }

    assert!(counts.contains(&0), "{counts:?}");
    assert!(counts.iter().sum::<usize>() > 2000, "{counts:?}");
}

#[test]
fn planes_of_awkward_areas_are_those_of_a_naive_search() {
    let size = (60, 80);
    let gentle = [0.1, -0.1, 20.0];
    let count = |rows: Range<usize>, cols: Range<usize>, min, plane, off| {
        let pixels = textured(size, 9, |y, x| rows.contains(&y) && cols.contains(&x));
        compared(&pixels, min, &scattered(size, plane, off, 5))
    };

    // In the middle, and at each border.
    assert!(count(15..45, 20..60, 0, gentle, 0.3) > 100);
    assert!(count(0..30, 0..40, 0, gentle, 0.3) > 100);
    assert!(count(30..60, 40..80, 0, gentle, 0.3) > 100);
    assert!(count(0..60, 0..80, 0, gentle, 0.3) > 300);

    // Too small, too steep, and with too much that disagrees.
    assert_eq!(count(30..36, 40..46, 0, gentle, 0.3), 0);
    assert_eq!(count(15..45, 20..60, 0, [1.4, 0.1, 0.0], 0.3), 0);
    assert_eq!(count(15..45, 20..60, 0, [0.1, -1.8, 120.0], 0.3), 0);
    assert_eq!(count(15..45, 20..60, 0, gentle, 0.95), 0);

    // Behind infinity, unless that is searched, too.
    let behind = [0.05, 0.05, -30.0];
    assert_eq!(count(15..45, 20..60, 0, behind, 0.3), 0);
    assert!(count(15..45, 20..60, -40, behind, 0.3) > 100);
}

/// Gray values as a view.
fn as_view(plane: &Plane<i32>) -> View {
    let pixel = |(y, x, _)| plane.row(y)[x] as u16;
    gray_of(Image::U16(Array3::from_shape_fn((plane.rows(), plane.cols(), 1), pixel)))
}

/// A smooth board in texture: rows, columns.
const BOARD: [Range<usize>; 2] = [30..150, 40..220];

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
        detail: None,
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
