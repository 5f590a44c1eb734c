//! The second opinion: its evidence and its verdicts, pixel by pixel from their definitions.

use crate::common::{hash, levels, mask, view, with_runtime};
use phasestereo::internals::verification::evidence::against;
use phasestereo::internals::verification::fuse::fuse;
use phasestereo::internals::verification::judge::{Chance, bar as bar_of};
use phasestereo::internals::verification::test::Test;
use phasestereo::internals::verification::traits::{Traits, Values};
use phasestereo::internals::verification::verdict;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::math::{exp_single, ln};
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::cost::Costs;
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::{Disparity, Timings};
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::refinement::flag;
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{CostKind, Settings};

const ROWS: usize = 40;
const COLS: usize = 37;

/// A pair of different views, with or without masks.
fn views(is_masked: bool) -> [View; 2] {
    [1, 2].map(|seed| {
        let view = view(ROWS, COLS, |y, x| hash(seed, y, x) as u8);
        view.with_mask(is_masked.then(|| mask(ROWS, COLS, 80, seed)))
    })
}

/// A number from 0 to 1 that depends on the place.
fn share(seed: u64, y: usize, x: usize) -> f32 {
    (hash(seed, y, x) % 1009) as f32 / 1009.0
}

/// Claims with holes, infinite ones, and some far outside the image.
fn claims() -> Plane<f32> {
    Plane::from_fn(ROWS, COLS, |y, x| match hash(3, y, x) % 23 {
        0 => f32::NAN,
        1 => f32::INFINITY,
        2 => 1e30,
        3 => -40.0,
        _ => 4.0 + 3.0 * share(4, y / 9, x / 7) + share(5, y, x),
    })
}

/// A match that agrees with some of them.
fn own() -> Disparity {
    let disparity = |y: usize, x: usize| match hash(6, y, x) % 29 {
        0 => f32::NAN,
        _ => 4.0 + 3.0 * share(7, y / 8, x / 9) + share(8, y, x),
    };
    let flags = |y: usize, x: usize| match hash(9, y, x) % 11 {
        0 => flag::OCCLUDED | flag::FILLED,
        1 => flag::OUTSIDE,
        2 | 3 => flag::FILLED,
        _ => 0,
    };
    let confidence = |y: usize, x: usize| share(10, y / 6, x / 5).sqrt();

    Disparity {
        disparity: Plane::from_fn(ROWS, COLS, disparity),
        flags: Plane::from_fn(ROWS, COLS, flags),
        confidence: Some(Plane::from_fn(ROWS, COLS, confidence)),
        uncertainty: None,
        wrong: None,
        detail: None,
        timings: Timings::default(),
    }
}

/// Settings for which the noise need not be known.
fn settings() -> Settings {
    Settings { noise_threshold: 0.0, ..Preset::Robust.settings() }
}

/// The costs of a pair, between any two columns.
fn any_columns<'a>(views: [&'a View; 2], settings: &Settings) -> Costs<'a> {
    let any = Candidates::new(0, 1, COLS).expect("legal");
    Costs::new(views, any, settings, None, levels()[0], &Control::default()).expect("memory")
}

/// Window around a place, within the image.
fn window(y: usize, x: usize, radius: usize) -> impl Iterator<Item = (usize, usize)> {
    let rows = y.saturating_sub(radius)..(y + radius + 1).min(ROWS);
    rows.flat_map(move |v| {
        let columns = x.saturating_sub(radius)..(x + radius + 1).min(COLS);
        columns.map(move |u| (v, u))
    })
}

/// -1, 0 or 1: how a claim and the own disparity differ.
fn side(map: &Plane<f32>, own: &Disparity, y: usize, x: usize) -> i32 {
    let (claim, own) = (map.row(y)[x], own.disparity.row(y)[x]);
    match own - claim {
        _ if !claim.is_finite() || own.is_nan() => 0,
        by if by > 0.8 => 1,
        by if by < -0.8 => -1,
        _ => 0,
    }
}

/// The cost at a disparity, in 256ths of a bit.
fn cost(costs: &Costs, y: usize, x: usize, disparity: f32) -> Option<i64> {
    let right = x as f64 * 256.0 - f64::from((disparity * 256.0).round());
    if !(0.0..=(COLS as f64 - 1.0) * 256.0).contains(&right) {
        return None;
    }

    let (column, rest) = (right as usize / 256, right as i64 % 256);
    let at = |column| costs.between(y, x, column).map(i64::from);
    let near = at(column)? * (256 - rest);
    if rest == 0 { Some(near) } else { Some(near + at(column + 1)? * rest) }
}

#[test]
fn any_two_columns_cost_what_the_volume_has() {
    for &cost in CostKind::ALL {
        for is_masked in [false, true] {
            let settings = Settings { cost, ..Preset::Paper.settings() };
            let [left, right] = &views(is_masked);
            let costs = any_columns([left, right], &settings);

            let candidates = Candidates::new(-9, 20, COLS).expect("legal");
            let control = Control::default();
            let volume = Costs::new([left, right], candidates, &settings, None, levels()[0], &control)
                .and_then(|costs| costs.volume(ROWS, levels()[0], &control))
                .expect("memory");

            let is_valid = |view: &View, y: usize, x: usize| view.is_valid(y, x);
            for (y, x) in window(ROWS / 2, COLS / 2, COLS) {
                for k in 0..20 {
                    let Ok(column) = usize::try_from(x as i64 + 9 - k as i64) else { continue };
                    if column >= COLS {
                        continue;
                    }
                    let expected = (is_valid(left, y, x) && is_valid(right, y, column))
                        .then(|| u32::from(volume.row(y)[x * 20 + k]));
                    assert_eq!(costs.between(y, x, column), expected, "{cost:?} {y} {x} {k}");
                }
            }
        }
    }
}

#[test]
fn evidence_is_what_its_definition_says() {
    let (map, own) = (claims(), own());
    let mut told = 0;

    for is_masked in [false, true] {
        let [left, right] = &views(is_masked);
        let costs = any_columns([left, right], &settings());
        let found = with_runtime(1, Level::best(), |runtime| against(&map, &own, &costs, runtime));
        let found = found.expect("memory");

        for (y, x) in window(0, 0, ROWS) {
            let here = side(&map, &own, y, x);
            let same = window(y, x, 7).filter(|(v, u)| side(&map, &own, *v, *u) == here);
            let (mut sum, mut pixels) = (0, 0);
            for (v, u) in same {
                let claimed = cost(&costs, v, u, map.row(v)[u]);
                let matched = cost(&costs, v, u, own.disparity.row(v)[u]);
                sum += claimed.zip(matched).map_or(0, |(claimed, matched)| claimed - matched);
                pixels += 1;
            }

            let expected =
                if here == 0 { 0.0 } else { (sum as f64 / 256.0 / (f64::from(pixels) + 4.0).sqrt()) as f32 };
            told += i32::from(expected != 0.0);
            assert_eq!(found.row(y)[x].to_bits(), expected.to_bits(), "{y} {x}");
        }
    }

    assert!(told > 1000, "hardly anything differs: {told}");
}

/// Verdict on a pixel.
fn judged(map: &Plane<f32>, own: &Disparity, against: f32, y: usize, x: usize) -> u8 {
    let logit = |p: f64| {
        let p = p.clamp(0.001, 0.999);
        phasestereo_match::base::math::ln(p / (1.0 - p))
    };
    let confidence = own.confidence.as_ref().expect("confidences");
    let mean = |places: Vec<(usize, usize)>| {
        let whole: u64 = places.iter().map(|(v, u)| (confidence.row(*v)[*u] * 1_048_576.0) as u64).sum();
        whole as f64 / 1_048_576.0 / places.len() as f64
    };

    let (claim, matched) = (map.row(y)[x], own.disparity.row(y)[x]);
    if !claim.is_finite() {
        return verdict::NO_CLAIM;
    }
    if matched.is_nan() || own.flags.row(y)[x] & (flag::OCCLUDED | flag::OUTSIDE) != 0 {
        return verdict::UNKNOWN;
    }

    let trust = logit(mean(window(y, x, 4).collect())).clamp(-3.0, 4.0);

    let around = || window(y, x, 3).map(|(v, u)| map.row(v)[u]).filter(|claim| claim.is_finite());
    let jump = around().fold(f32::NEG_INFINITY, f32::max) - around().fold(f32::INFINITY, f32::min);
    let nowhere =
        window(y, x, 3).map(|(v, u)| (own.disparity.row(v)[u] - claim).abs()).fold(f32::INFINITY, f32::min);

    let column = |u: usize| (u as f32 - map.row(y)[u]).round() as i64;
    let is_seen = (0..COLS as i64).contains(&column(x));
    let is_hidden = is_seen && (0..COLS).any(|u| map.row(y)[u] > claim + 1.0 && column(u) == column(x));

    let by = (matched - claim).abs();
    let beyond = f64::from(by) - 1.0;
    let score = -1.95
        + 0.21 * trust
        + 0.43 * beyond.clamp(-0.2, 2.0)
        + 1.34 * beyond.clamp(-0.2, 0.5)
        + 0.029 * f64::from(against).clamp(-20.0, 60.0)
        + 0.35 * f64::from(jump).min(3.0)
        + 0.87 * f64::from(nowhere).min(1.5)
        + if is_hidden { -0.4 } else { 0.0 };
    assert!((score - 1.45).abs() > 1e-9, "sums in another order might differ: {y} {x}");

    match (by > 0.8 && score > 1.45, by <= 1.5 && confidence.row(y)[x] > 0.8) {
        (true, _) => verdict::REFUTED,
        (_, true) => verdict::SUPPORTED,
        _ => verdict::UNKNOWN,
    }
}

#[test]
fn verdicts_are_what_their_definition_says() {
    let (map, own) = (claims(), own());
    let [left, right] = &views(false);
    let costs = any_columns([left, right], &settings());
    let against = with_runtime(1, Level::best(), |runtime| against(&map, &own, &costs, runtime));
    let against = against.expect("memory");

    let test = Test { map: &map, own: &own, against: &against };
    let judged_all = with_runtime(1, Level::best(), |runtime| test.judge(runtime));
    let (verdicts, counts) = judged_all.expect("memory");

    let mut expected = [0; 4];
    for (y, x) in window(0, 0, ROWS) {
        let verdict = judged(&map, &own, against.row(y)[x], y, x);
        assert_eq!(verdicts.row(y)[x], verdict, "{y} {x}");
        expected[usize::from(verdict)] += 1;
    }

    assert_eq!(counts.verdicts, expected);
    assert!(expected.iter().all(|count| *count > 20), "a verdict is missing: {expected:?}");
    let outside = window(0, 0, ROWS).filter(|(y, x)| {
        let claim = map.row(*y)[*x];
        claim.is_finite() && !(0.0..COLS as f32).contains(&(*x as f32 - claim).round())
    });
    assert_eq!(counts.outside, outside.count() as u64);
}

/// Chances without a pattern.
fn chances() -> Plane<Chance> {
    let (map, own) = (claims(), own());
    let differs = |y: usize, x: usize| {
        let by = (map.row(y)[x] - own.disparity.row(y)[x]).abs();
        by.is_finite() && by > 1.0
    };
    Plane::from_fn(ROWS, COLS, |y, x| Chance {
        confidence: share(20, y, x),
        ahead: if differs(y, x) { 6.0 * share(23, y, x) - 3.0 } else { 0.0 },
        bar: share(21, y, x),
    })
}

/// Disparity, flags, confidence and bar of a pixel of the fused map.
fn fused_pixel(
    [map, own]: [&Plane<f32>; 2],
    whole: &Disparity,
    chances: &Plane<Chance>,
    share: f32,
    (y, x): (usize, usize),
) -> (f32, u16, f32, f32) {
    let (claim, matched, flags) = (map.row(y)[x], own.row(y)[x], whole.flags.row(y)[x]);
    let confidence = whole.confidence.as_ref().expect("confidences").row(y)[x];
    let bar = whole.uncertainty.as_ref().expect("bars").row(y)[x];
    let here = chances.row(y)[x];
    if !claim.is_finite() || flags & flag::MASKED != 0 {
        return (matched, flags, confidence, bar);
    }
    if (matched - claim).abs() <= 1.0 {
        let disparity = matched + share * (claim - matched);
        return (disparity, flags, here.confidence, 0.5 * (here.bar + bar));
    }

    let ahead: i64 = window(y, x, 4)
        .filter(|(v, u)| {
            let by = (map.row(*v)[*u] - own.row(*v)[*u]).abs();
            by.is_finite() && by > 1.0
        })
        .map(|(v, u)| (chances.row(v)[u].ahead.clamp(-10.0, 10.0) * 1024.0) as i64)
        .sum();
    if if matched.is_nan() { here.confidence > 0.5 } else { ahead > 0 } {
        let seen = flags & (flag::OUTSIDE | flag::MATCH_MASKED | flag::OCCLUDED);
        return (claim, seen | flag::SECOND, here.confidence, here.bar);
    }
    if matched.is_nan() {
        return (matched, flags, confidence, bar);
    }
    let rest = here.confidence / exp_single(here.ahead);
    let kept = rest.min(confidence).min(1.0 - here.confidence).clamp(0.003, 1.0 - 0.003);
    (matched, flags, kept, bar_of(kept, flags))
}

#[test]
fn two_maps_become_what_the_definition_says() {
    let uncertainty = Plane::from_fn(ROWS, COLS, |y, x| 2.0 * share(22, y, x));
    let (map, own, chances) = (claims(), Disparity { uncertainty: Some(uncertainty), ..own() }, chances());
    for (wrong, share) in [(0.1, 0.25), (0.3, 0.5)] {
        for level in levels() {
            let found = with_runtime(1, level, |runtime| fuse(own.clone(), &map, &chances, wrong, runtime));
            let found = found.expect("memory");
            let confidence = found.confidence.as_ref().expect("confidences");
            let bars = found.uncertainty.as_ref().expect("bars");

            let mut taken = 0;
            for (y, x) in (0..ROWS).flat_map(|y| (0..COLS).map(move |x| (y, x))) {
                let maps = [&map, &own.disparity];
                let expected = fused_pixel(maps, &own, &chances, share, (y, x));
                let at = [found.disparity.row(y)[x], confidence.row(y)[x], bars.row(y)[x]];
                let (disparity, flags, confident, bar) = expected;
                taken += i32::from(flags & flag::SECOND != 0);
                assert_eq!(at.map(f32::to_bits), [disparity, confident, bar].map(f32::to_bits));
                assert_eq!(found.flags.row(y)[x], flags, "{y} {x}");
            }
            assert!(taken > 100, "the second map is hardly taken: {taken}");
        }
    }
}

#[test]
fn traits_are_what_their_definition_says() {
    let (map, own) = (claims(), own());
    let [left, right] = views(false);
    let gray = left.gray().clone();
    let pair = Pair::new(left, right, 0, 20).expect("legal");
    let confidence = own.confidence.as_ref().expect("confidences");
    let odds = |p: f64| {
        let p = p.clamp(0.003, 0.997);
        ln(p / (1.0 - p))
    };
    let texture = |y: usize, x: usize| f64::from((gray.row(y)[x] - gray.row(y)[x.max(1) - 1]).abs());
    let all: Vec<_> = window(0, 0, ROWS).collect();
    let mean = |places: &[(usize, usize)], value: &dyn Fn(usize, usize) -> f64| {
        places.iter().map(|(v, u)| value(*v, *u)).sum::<f64>() / places.len() as f64
    };
    let inner: Vec<_> = all.iter().copied().filter(|(_, x)| *x > 0).collect();
    let roughness = mean(&inner, &texture);

    let sure = |y: usize, x: usize| f64::from(confidence.row(y)[x]);
    let agree = |places: &[(usize, usize)]| {
        let near = |v: usize, u: usize| (own.disparity.row(v)[u] - map.row(v)[u]).abs() <= 1.0;
        let claims = places.iter().filter(|(v, u)| map.row(*v)[*u].is_finite()).count();
        places.iter().filter(|(v, u)| near(*v, *u)).count() as f64 / claims.max(1) as f64
    };
    let column = |y: usize, u: usize| (u as f32 - map.row(y)[u]).round() as i64;
    for level in levels() {
        let traits = with_runtime(1, level, |runtime| Traits::new(&map, &own, &pair, runtime));
        let all_traits = traits
            .expect("memory")
            .by_rows(&Control::default(), |traits, row: &mut [Values]| traits.write(row))
            .expect("memory");
        for y in 0..ROWS {
            for (x, found) in all_traits.row(y).iter().enumerate() {
                let (claim, matched) = (map.row(y)[x], own.disparity.row(y)[x]);
                if !claim.is_finite() {
                    assert!(found.iter().all(|value| value.is_nan()));
                    continue;
                }
                let [near, far] = [4, 15].map(|radius| window(y, x, radius).collect::<Vec<_>>());
                let gap = if matched.is_nan() { 20.0 } else { (matched - claim).abs().min(20.0) };
                let is_seen = (0..COLS as i64).contains(&column(y, x));
                let hides = |u| map.row(y)[u] > claim + 1.0 && column(y, u) == column(y, x);
                let flags = own.flags.row(y)[x];
                let expected = [
                    (0, f64::from(gap)),
                    (1, odds(sure(y, x))),
                    (2, odds(mean(&near, &sure))),
                    (3, odds(mean(&far, &sure))),
                    (8, agree(&near)),
                    (9, agree(&far)),
                    (10, ln(0.05 + mean(&near, &texture) / roughness)),
                    (11, f64::from(is_seen && (0..COLS).any(hides))),
                    (12, f64::from(!is_seen)),
                    (14, f64::from(flags & flag::FILLED != 0)),
                    (16, odds(mean(&all, &sure))),
                    (17, agree(&all)),
                ];
                for (which, expected) in expected {
                    let off = (f64::from(found[which]) - expected).abs();
                    assert!(off < 1e-3, "{y} {x} {which}: {} {expected}", found[which]);
                }
            }
        }
    }
}
