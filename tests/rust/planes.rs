//! Flat areas and their planes: compared with naive ones, bit for bit, and with the places where they were
//! put.

use std::collections::BTreeSet;
use std::ops::Range;

use crate::common::naive::ResultBits;
use crate::common::{gray_of, hash, with_runtime};
use crate::scales::{naive_mean, random};
use ndarray::Array3;
use phasestereo::internals::scales::flat_areas::{FlatArea, flat_areas};
use phasestereo::internals::scales::planes::draw;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::pixels::Image;
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::{Disparity, Timings};
use phasestereo_match::pair::Pair;
use phasestereo_match::refinement::flag;

/// Row and column.
type Place = (usize, usize);

/// The bits of the confidence of pixels without evidence.
const UNSEEN: u32 = 0.4_f32.to_bits();

/// Gray values of texture, except where it is smooth: there grain is less than `least`.
fn textured(
    (rows, cols): (usize, usize),
    salt: u64,
    least: f32,
    is_smooth: impl Fn(usize, usize) -> bool,
) -> Plane<i32> {
    Plane::from_fn(rows, cols, |y, x| {
        let is_smooth = is_smooth(y, x);
        let grain = random(salt, y, x) * if is_smooth { least } else { 1000.0 };
        // Large texture has a small Laplacian.
        let waves = if is_smooth { 0.0 } else { 1500.0 * (((x + 2 * y) % 16) as f32 - 8.0).abs() };
        (grain + waves) as i32
    })
}

/// The same, smooth in patches.
fn patched(size: (usize, usize), salt: u64, least: f32) -> Plane<i32> {
    textured(size, salt + 1, least, |y, x| random(salt, y / 23, x / 31) > 0.5)
}

/// The places of the window with this reach, within the plane, in reading order.
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
    // In large images, rows are skipped.
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
    // In the second one, rows are skipped.
    for (size, salt) in [((90, 130), 3), ((270, 251), 8)] {
        let gray = patched(size, salt, 40.0);
        let naive = naive_areas(&gray);

        let areas = with_runtime(1, Level::best(), |runtime| flat_areas(&gray, runtime)).expect("memory");
        let pixels = |area: &FlatArea| {
            let all = (&(0..size.0), &(0..size.1));
            let marked = with_runtime(1, Level::best(), |runtime| area.near(all, 0, runtime));
            let marked = marked.expect("memory");
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

/// The plane that most samples are within 0.7 px of, fitted to them three times. A sample is column, row and
/// disparity.
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

/// Draws the plane of one area of a map into another one, and returns where; `None`: it has no plane. Faint
/// pixels do not count.
fn naive_plane(
    (map, confidence): (&Disparity, &Plane<f32>),
    faint: Option<&Plane<bool>>,
    area: &BTreeSet<Place>,
    least: f32,
    out: &mut Disparity,
) -> Option<BTreeSet<Place>> {
    let size = (confidence.rows(), confidence.cols());
    let near = |by: usize| places(size).filter(move |at| window(*at, by, size).any(|at| area.contains(&at)));
    let disparity = |(y, x): Place| map.disparity.row(y)[x];
    let mut weights = Plane::from_fn(size.0, size.1, |_, _| 0.0);
    for (y, x) in near(4).filter(|(y, x)| !faint.is_some_and(|faint| faint.row(*y)[*x])) {
        weights.row_mut(y)[x] = confidence.row(y)[x] * confidence.row(y)[x];
    }

    let weight = |(y, x): &Place| f64::from(weights.row(*y)[*x]);
    let heavy: Vec<Place> = places(size).filter(|at| weight(at) > 0.25).collect();
    if heavy.len() < 100 {
        return None;
    }
    let mut sum = 0.0;
    let sums = heavy.iter().map(|at| {
        sum += weight(at);
        sum
    });
    let sums: Vec<f64> = sums.collect();
    let reached = |k: usize| sums.iter().position(|sum| *sum >= sums[sums.len() - 1] / 2000.0 * k as f64);
    let sample = |index: usize| {
        let (y, x) = heavy[index];
        [x as f64, y as f64, disparity((y, x)).into()]
    };
    let samples: Vec<_> = (1..).map_while(reached).map(sample).collect();
    let plane = naive_fit(&samples)?;
    let drawn = |(y, x): Place| naive_height(plane, (y as f64, x as f64)) as f32;

    // Tiles count from the corner of the near pixels.
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
    if whole <= if faint.is_some() { 0.6 } else { 0.5 } {
        return None;
    }

    // If the surface continues outside, the outline belongs to an object in front of it.
    let inner: BTreeSet<Place> = near(4).collect();
    let ring: Vec<Place> = near(14).filter(|at| !inner.contains(at)).collect();
    let goes_on = ring.iter().filter(|&&(y, x)| {
        let is_sure = confidence.row(y)[x].powi(2) > 0.25 && map.flags.row(y)[x] & 2048 == 0;
        is_sure && (disparity((y, x)) - drawn((y, x))).abs() < 2.0
    });
    let is_behind = goes_on.count() as f64 > 0.45 * ring.len() as f64;
    let agrees = |at: &Place| weight(at) > 0.25 && (disparity(*at) - drawn(*at)).abs() < 1.0;
    let has_evidence = |at: Place| window(at, 4, size).any(|at| agrees(&at));

    let nearby = |plane: &Plane<f32>| Plane::from_fn(tiles.0, tiles.1, |y, x| naive_mean(plane, (y, x), 7));
    let (agree, all) = (nearby(&agree), nearby(&all));
    let mut found = BTreeSet::new();
    for (y, x) in near(2) {
        let (tile_y, tile_x) = ((y - top) / 4, (x - left) / 4);
        let (agree, all) = (agree.row(tile_y)[tile_x], all.row(tile_y)[tile_x]);
        let p = 0.9 * (agree + 0.2 * whole) / (all + 0.2);

        let sure = confidence.row(y)[x].max(naive_mean(confidence, (y, x), 4));
        let is_other = (disparity((y, x)) - drawn((y, x))).abs() > 0.5;
        if sure < 0.9 && p > sure && drawn((y, x)) >= least && is_other {
            found.insert((y, x));
            if map.flags.row(y)[x] & flag::MISSING != 0 {
                continue;
            }
            let p = if is_behind && !has_evidence((y, x)) { p.min(0.4) } else { p };
            out.disparity.row_mut(y)[x] = drawn((y, x));
            out.flags.row_mut(y)[x] = map.flags.row(y)[x] & !(256 | 2048 | 4096) | 1024;
            let (confidence, bars) = (out.confidence.as_mut(), out.uncertainty.as_mut());
            confidence.expect("made so").row_mut(y)[x] = p;
            bars.expect("made so").row_mut(y)[x] = 9.0 * (1.0 - p) / p;
        }
    }
    Some(found)
}

/// The mean squares of 9 x 9 pixels of what is left without means of 7 x 7, where this noise is 256.
fn naive_detail(gray: &Plane<i32>, noise: f64) -> Plane<f32> {
    let size = (gray.rows(), gray.cols());
    let parts = (256.0 / noise) as f32;
    let rest = Plane::from_fn(size.0, size.1, |y, x| {
        let around: Vec<i32> = window((y, x), 3, size).map(|(y, x)| gray.row(y)[x]).collect();
        let count = around.len() as i32;
        let rest = (count * gray.row(y)[x] - around.iter().sum::<i32>()) as f32 / count as f32;
        (rest * parts).clamp(-7000.0, 7000.0) as i64
    });
    Plane::from_fn(size.0, size.1, |y, x| {
        let squares = || window((y, x), 4, size).map(|(y, x)| rest.row(y)[x].pow(2));
        squares().sum::<i64>() as f32 / squares().count() as f32
    })
}

/// The pixels at which nothing but noise is seen, neither there nor to all sides in a copy, and that are not
/// sure by themselves, or at which nothing but rounding is seen. `noises`: both, and rounding.
fn naive_unseen(gray: &Plane<i32>, noises: [f64; 2], map: &Disparity) -> BTreeSet<Place> {
    let [noise, rounding] = noises;
    let confidence = map.confidence.as_ref().expect("made so");
    // Gray values of copies are 1, 4, 16, 16, ... times as large as means.
    let mut scales = vec![naive_detail(gray, noise)];
    let mut copy = gray.clone();
    for k in 1..=6 {
        let (rows, cols) = (copy.rows() / 2, copy.cols() / 2);
        let last = if k > 2 { 4 } else { 1 };
        copy = Plane::from_fn(rows, cols, |y, x| {
            let four = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(v, u)| copy.row(2 * y + v)[2 * x + u]);
            four.iter().sum::<i32>().div_euclid(last)
        });
        let larger = [1.0, 2.0, 4.0, 2.0, 1.0, 0.5, 0.25][k];
        scales.push(naive_detail(&copy, larger * noise));
    }

    let least = (256.0_f64 * 256.0 * 1.5) as f32;
    let is_unseen = |(y, x): &Place| {
        let halved = usize::from(map.flags.row(*y)[*x] / 4096).max(2);
        let is_seen = |k: usize| {
            let scale = &scales[k];
            let at = |v: i64, u: i64| {
                let inside = |place: usize, by: i64, count: usize| {
                    let place = (place >> k).min(count - 1) as i64 + by;
                    place.clamp(0, count as i64 - 1) as usize
                };
                scale.row(inside(*y, v, scale.rows()))[inside(*x, u, scale.cols())] >= least
            };
            at(-7, 0) && at(7, 0) && at(0, -7) && at(0, 7)
        };
        let own = scales[0].row(*y)[*x];
        let is_sure = confidence.row(*y)[*x] >= 0.9
            && own >= (rounding / noise * 256.0 * 1.5_f64.sqrt()).powi(2) as f32;
        own < least && !(0..=halved).any(is_seen) && !is_sure
    };
    places((gray.rows(), gray.cols())).filter(is_unseen).collect()
}

/// The planes of a pair whose left image has these pixels, of 16 bits, and this noise.
fn naive_planes(pixels: &Plane<i32>, noise: f64, min: i64, map: &Disparity) -> Disparity {
    // Less the middle of the range, and halved if they have more than 15 bits.
    let is_small = pixels.as_slice().iter().all(|value| *value < 256);
    let short = |value: &i32| {
        if is_small { value - 128 } else { (value - 32_768).div_euclid(2) }
    };
    let gray = pixels.map(short);
    let confidence = map.confidence.as_ref().expect("made so");
    let least = if min < 0 { f32::NEG_INFINITY } else { 0.0 };
    // One step of rounding is half a step by then.
    let step = if is_small { 1.0 } else { 0.5 };
    let rounding = step / 12_f64.sqrt();
    let noise = (noise * step).max(rounding);

    let mut out = map.clone();
    let areas = naive_areas(&gray);
    let first = |area: &BTreeSet<Place>, out: &mut _| {
        naive_plane((map, confidence), None, area, least, out).is_none()
    };
    let without: Vec<_> = areas.iter().filter(|area| first(area, &mut out)).collect();

    let most = (128.0 * step / noise).powi(2) as f32;
    let faint = naive_detail(&gray, noise).map(|square| *square <= most);
    let bounded = Plane::from_fn(gray.rows(), gray.cols(), |y, x| {
        let own = confidence.row(y)[x];
        if faint.row(y)[x] { own.min(0.4) } else { own }
    });
    let mut unseen = naive_unseen(&gray, [noise, rounding], map);
    for area in without {
        let drawn = naive_plane((map, &bounded), Some(&faint), area, least, &mut out);
        let Some(drawn) = drawn else { continue };
        unseen.extend(area.iter().filter(|(y, x)| faint.row(*y)[*x] && !drawn.contains(&(*y, *x))));
    }

    let (confidence, bars) = (out.confidence.as_mut(), out.uncertainty.as_mut());
    let (confidence, bars) = (confidence.expect("made so"), bars.expect("made so"));
    for (y, x) in unseen {
        if confidence.row(y)[x] > 0.4 {
            confidence.row_mut(y)[x] = 0.4;
            bars.row_mut(y)[x] = bars.row(y)[x].max(9.0 * (1.0 - 0.4_f32) / 0.4);
        }
    }
    out
}

/// A map of a plane with a share of its pixels off, in clumps, and in more doubt.
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
        flags: Plane::from_fn(rows, cols, |y, x| {
            let is_unseen = hash(salt + 7, y, x).is_multiple_of(8);
            let left_out = flag::INFERRED | if is_unseen { 0 } else { flag::MISSING };
            let halved = hash(salt + 8, y / 9, x / 9) as u16 % 5;
            4096 * halved + ((hash(salt + 6, y, x) % 4096) as u16 & !left_out)
        }),
        confidence: Some(Plane::from_fn(rows, cols, confidence)),
        uncertainty: Some(Plane::from_fn(rows, cols, |y, x| random(salt + 7, y, x))),
        wrong: None,
        detail: None,
        timings: Timings::default(),
    }
}

/// The numbers of drawn pixels and of doubted ones, which must be those of the naive planes.
fn compared(pixels: &Plane<i32>, noise: f64, min: i64, map: &Disparity) -> [usize; 2] {
    let pair = Pair::new(as_view(pixels), as_view(pixels), min, 40).expect("a legal pair");
    let found = drawn_amid(noise, &pair, map.clone());
    let count = found.flags.as_slice().iter().filter(|flags| **flags & 1024 != 0).count();

    let doubted = found.confidence.iter().flat_map(Plane::as_slice).filter(|c| c.to_bits() == UNSEEN).count();

    assert!(ResultBits::new(found) == ResultBits::new(naive_planes(pixels, noise, min, map)));
    [count, doubted]
}

/// The numbers of drawn and of doubted pixels of a random map, whose image has grain up to `least` where it
/// is smooth, and this noise.
fn compared_random(salt: u64, least: f32, noise: f64) -> [usize; 2] {
    let size = (50 + hash(salt, 0, 0) as usize % 60, 60 + hash(salt, 0, 1) as usize % 60);
    let of = |index: usize| random(salt, 1, index) - 0.5;
    let plane = [0.8 * of(0), of(1), 40.0 * of(2) + 20.0];
    let min = if of(3) > 0.0 { 0 } else { -50 };

    let pixels = patched(size, salt + 10, least);
    compared(&pixels, noise, min, &scattered(size, plane, of(4) + 0.5, salt))
}

#[test]
fn planes_of_random_maps_are_those_of_a_naive_search() {
    let counts = (0..240).step_by(20).map(|salt| compared_random(salt, 40.0, 0.0)[0]);
    let counts: Vec<usize> = counts.collect();

    assert!(counts.contains(&0), "{counts:?}");
    assert!(counts.iter().sum::<usize>() > 2000, "{counts:?}");
}

#[test]
fn what_shows_nothing_but_noise_is_doubted_as_by_a_naive_search() {
    // Grain of hardly more than rounding, and of more.
    for least in [2.2, 40.0] {
        let doubted = [0.0, 6.0, 20.0, 2e4].map(|noise| {
            let counts = (0..120).step_by(20).map(|salt| compared_random(salt, least, noise)[1]);
            counts.sum::<usize>()
        });
        assert!(doubted.is_sorted() && doubted[0] + 1000 < doubted[3], "{doubted:?} with {least}");
    }
}

#[test]
fn planes_of_awkward_areas_are_those_of_a_naive_search() {
    let size = (60, 80);
    let gentle = [0.1, -0.1, 20.0];
    let count = |rows: Range<usize>, cols: Range<usize>, min, plane, off| {
        let pixels = textured(size, 9, 40.0, |y, x| rows.contains(&y) && cols.contains(&x));
        compared(&pixels, 0.0, min, &scattered(size, plane, off, 5))[0]
    };

    // In the middle, and at each border.
    assert!(count(15..45, 20..60, 0, gentle, 0.3) > 100);
    assert!(count(0..30, 0..40, 0, gentle, 0.3) > 100);
    assert!(count(30..60, 40..80, 0, gentle, 0.3) > 100);
    assert!(count(0..60, 0..80, 0, gentle, 0.3) > 300);

    // Too small, too steep, and with too much disagreement.
    assert_eq!(count(30..36, 40..46, 0, gentle, 0.3), 0);
    assert_eq!(count(15..45, 20..60, 0, [1.4, 0.1, 0.0], 0.3), 0);
    assert_eq!(count(15..45, 20..60, 0, [0.1, -1.8, 120.0], 0.3), 0);
    assert_eq!(count(15..45, 20..60, 0, gentle, 0.95), 0);

    // Beyond infinity, unless that is searched, too.
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

/// Whether a pixel is on the board, at least this far from its outline.
fn is_inside(y: usize, x: usize, by: usize) -> bool {
    is_board(y.saturating_sub(by), x.saturating_sub(by)) && is_board(y + by, x + by)
}

/// Whether a pixel is near the board, or on it.
fn is_near_board(y: usize, x: usize) -> bool {
    [y, y + 3, y.saturating_sub(3)]
        .iter()
        .any(|y| [x, x + 3, x.saturating_sub(3)].iter().any(|x| is_board(*y, *x)))
}

/// A board that is `before` px in front of its surroundings, as below.
fn board(before: f32, surface: impl Fn(usize, usize) -> f32) -> (Pair, Disparity) {
    let around = |y: usize, x: usize| if is_near_board(y, x) { 0.0 } else { before };
    let gray = Plane::from_fn(180, 260, |y, x| {
        let grain = hash(5, y, x) % 2000;
        if is_board(y, x) { 9000 + grain as i32 / 100 } else { 8000 + 2 * grain as i32 }
    });
    known_at_outline(as_view(&gray), |y, x| surface(y, x) - around(y, x))
}

/// A pair that shows the board, and a map that knows `surface` only outside and at its outline.
fn known_at_outline(view: View, surface: impl Fn(usize, usize) -> f32) -> (Pair, Disparity) {
    let pair = Pair::new(view.clone(), view, 0, 64).expect("a legal pair");

    // Inside, 8 px from the outline, nothing is known: the disparities are wrong and in doubt.
    let is_unknown = |y: usize, x: usize| is_inside(y, x, 8);
    let disparity = |y: usize, x: usize| {
        if is_unknown(y, x) { 60.0 * random(6, y / 5, x / 5) } else { surface(y, x) }
    };
    let map = Disparity {
        disparity: Plane::from_fn(180, 260, disparity),
        flags: Plane::from_fn(180, 260, |_, _| flag::FILLED),
        confidence: Some(Plane::from_fn(180, 260, |y, x| if is_unknown(y, x) { 0.2 } else { 0.95 })),
        uncertainty: Some(Plane::from_fn(180, 260, |_, _| 1.0)),
        wrong: None,
        detail: None,
        timings: Timings::default(),
    };
    (pair, map)
}

fn drawn(pair: &Pair, map: Disparity) -> Disparity {
    drawn_amid(0.0, pair, map)
}

fn drawn_amid(noise: f64, pair: &Pair, mut map: Disparity) -> Disparity {
    with_runtime(1, Level::best(), |runtime| draw(&mut map, pair, noise, runtime)).expect("enough memory");
    map
}

#[test]
fn a_plain_board_becomes_the_plane_of_its_outline() {
    let plane = |y: usize, x: usize| 10.0 + 0.1 * x as f32 - 0.05 * y as f32;
    let (pair, before) = board(8.0, plane);
    let map = drawn(&pair, before.clone());

    for (y, x) in [(40, 60), (90, 130), (140, 200)] {
        assert!((map.disparity.row(y)[x] - plane(y, x)).abs() < 0.05, "{y}, {x}");
        assert_eq!(map.flags.row(y)[x], flag::INFERRED);
    }

    // A plane is as certain as the outline agrees, less so far from it.
    let (confidence, bars) = (map.confidence.expect("made so"), map.uncertainty.expect("made so"));
    assert!((0.6..0.75).contains(&confidence.row(90)[130]), "{}", confidence.row(90)[130]);
    assert!((0.8..0.9).contains(&confidence.row(40)[60]), "{}", confidence.row(40)[60]);
    assert!((3.0..6.0).contains(&bars.row(90)[130]), "{}", bars.row(90)[130]);

    // The texture around keeps its values.
    assert_eq!(map.disparity.row(10), before.disparity.row(10));
    assert_eq!(map.flags.row(10), before.flags.row(10));
}

#[test]
fn what_is_not_a_plane_is_not_drawn() {
    let ball = |y: usize, x: usize| {
        let [y, x] = [y as f32 - 90.0, x as f32 - 130.0];
        40.0 - (y * y + x * x) / 500.0
    };
    let (pair, before) = board(0.0, ball);
    let map = drawn(&pair, before.clone());
    assert_eq!(map, before);

    // Nothing lies beyond infinity.
    let (pair, before) = board(0.0, |y, _| -3.0 - 0.1 * y as f32);
    assert_eq!(drawn(&pair, before.clone()), before);
}

/// Asserts the confidence and the bar of a pixel.
fn assert_sure(map: &Disparity, (y, x): Place, expected: [f32; 2]) {
    let planes = [&map.confidence, &map.uncertainty];
    let found = planes.map(|plane| plane.as_ref().expect("made so").row(y)[x]);
    assert_eq!(found.map(f32::to_bits), expected.map(f32::to_bits), "{found:?} at {y}, {x}");
}

/// Confidence and bar where there is no evidence.
const IN_DOUBT: [f32; 2] = [0.4, 9.0 * (1.0 - 0.4) / 0.4];

#[test]
fn the_outline_of_what_lies_before_a_plain_area_is_not_trusted() {
    // Like a sky between houses: their surface continues outside.
    let plane = |y: usize, x: usize| 10.0 + 0.1 * x as f32 - 0.05 * y as f32;
    let (pair, before) = board(0.0, plane);
    let map = drawn(&pair, before);

    assert_eq!(map.flags.row(90)[130], flag::INFERRED);
    assert_sure(&map, (90, 130), IN_DOUBT);
    assert!(map.confidence.expect("made so").row(40)[60] > 0.8, "beside pixels that agree");
}

/// The board in 8 bits; on it, one in `one_in` pixels is brighter by some steps.
fn nearly_blank(one_in: u64, steps: u8) -> View {
    let pixel = |(y, x, _)| match hash(5, y, x) {
        _ if is_inside(y, x, 8) => 150 + steps * u8::from(hash(7, y, x).is_multiple_of(one_in)),
        grain if is_board(y, x) => 147 + (grain % 8) as u8,
        grain => 60 + (grain % 128) as u8,
    };
    gray_of(Image::U8(Array3::from_shape_fn((180, 260, 1), pixel)))
}

#[test]
fn where_nothing_but_rounding_is_seen_nothing_is_trusted() {
    let (pair, mut before) = known_at_outline(nearly_blank(1, 0), |_, _| 20.0);
    before.disparity = before.disparity.map(|_| 20.0);
    before.confidence = before.confidence.map(|plane| plane.map(|_| 0.95));
    let map = drawn(&pair, before.clone());

    assert_eq!(map.disparity, before.disparity);
    assert_sure(&map, (90, 130), IN_DOUBT);
    // Beside detail, and amid it.
    assert_sure(&map, (34, 130), [0.95, 1.0]);
    assert_sure(&map, (10, 10), [0.95, 1.0]);
}

#[test]
fn faint_pixels_do_not_outvote_an_outline() {
    let (pair, mut before) =
        known_at_outline(nearly_blank(6, 1), |y, x| if is_near_board(y, x) { 20.0 } else { 12.0 });
    // Inside they match as well, but in many places at once.
    before.confidence = before.confidence.map(|plane| plane.map(|_| 0.8));
    let map = drawn(&pair, before.clone());

    let is_drawn = |y: usize, x: usize| map.flags.row(y)[x] == flag::INFERRED;
    let inside: Vec<Place> = places((180, 260)).filter(|(y, x)| is_inside(*y, *x, 16)).collect();
    let count = inside.iter().filter(|(y, x)| is_drawn(*y, *x)).count();
    assert!(count > inside.len() * 9 / 10, "{count} of {}", inside.len());
    for (y, x) in inside {
        if is_drawn(y, x) {
            assert!((map.disparity.row(y)[x] - 20.0).abs() < 0.1);
        } else {
            assert_sure(&map, (y, x), IN_DOUBT);
        }
    }

    // With the detail of noise, they are evidence against a plane.
    let (pair, _) = known_at_outline(nearly_blank(2, 3), |_, _| 20.0);
    assert!(drawn(&pair, before).flags.as_slice().iter().all(|flags| flags & flag::INFERRED == 0));
}
