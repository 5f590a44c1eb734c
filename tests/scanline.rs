//! Scanlines: lanes of narrow integers against the trial of every origin.

mod common;

use common::{COUNTS, RULES, hash, heights, levels, tile, widths};
use phasestereo::aggregation::{Aggregated, Window};
use phasestereo::control::Control;
use phasestereo::error::Error;
use phasestereo::plane::Plane;
use phasestereo::reference;
use phasestereo::scanline::{Advance, Scanline, Steps, optimize};
use phasestereo::settings::{LARGEST_PENALTY, MOST_DISPARITIES, Penalty, Rule};
use phasestereo::simd::Level;
use phasestereo::strip::{BLOCK, Strip};
use phasestereo::value::Value;
use proptest::prelude::*;
use proptest::sample::select;

/// Costs and what they are searched with.
#[derive(Debug, Clone)]
struct Problem {
    volume: Plane<u32>,
    candidates: usize,
    rule: Rule,
    steps: Steps,
}

impl Problem {
    fn random(
        (rows, cols, candidates): (usize, usize, usize),
        largest: u64,
        seed: u64,
        rule: Rule,
        steps: Steps,
    ) -> Self {
        let cost = |y, place| (hash(seed, y, place) % (largest + 1)) as u32;
        let volume = Plane::from_fn(rows, cols * candidates, cost);
        Self { volume, candidates, rule, steps }
    }

    fn optimized(&self, level: Level) -> Plane<u16> {
        let Self { volume, candidates, rule, steps } = self;
        optimize(volume, *candidates, *rule, *steps, level, &Control::default()).expect("memory")
    }

    /// The same with integers of our choice, and all rows in one strip.
    fn optimized_in<V: Value, T: Value>(&self, level: Level) -> Plane<u16> {
        let Self { volume, candidates, .. } = self;
        let (rows, cols) = (volume.rows(), volume.cols() / candidates);
        let window = Window { rows, cols, candidates: *candidates, side: 1, ..Window::default() };
        let strip = Strip { first: 0, rows, margin: 0, height: rows };
        let mut scanline = Scanline::<T>::default();
        scanline.begin(window, strip, self.rule, self.steps).expect("memory");
        for tile in window.tiles() {
            let blocks = (0..tile.finished.len() * strip.blocks()).flat_map(|block| {
                let (x, lanes) =
                    (tile.finished.start + block / strip.blocks(), block % strip.blocks());
                (0..*candidates).map(move |k| {
                    std::array::from_fn(|lane| {
                        let y = (lanes * BLOCK + lane).min(rows - 1);
                        V::truncated(volume.row(y)[x * candidates + k].into())
                    })
                })
            });
            let values: Vec<[V; BLOCK]> = blocks.collect();
            let costs = Aggregated::new(&values, strip.blocks(), *candidates);
            level.run(Advance { scanline: &mut scanline, tile: &tile, costs });
        }
        scanline.trace_back();
        Plane::from_fn(rows, cols, |y, x| {
            scanline.chosen()[(y / BLOCK * cols + x) * BLOCK + y % BLOCK]
        })
    }

    fn expected(&self) -> Plane<u16> {
        let Self { volume, candidates, rule, steps } = self;
        let rows = (0..volume.rows())
            .flat_map(|y| reference::optimize(volume.row(y), *candidates, *rule, *steps));
        Plane::from_vec(volume.rows(), volume.cols() / candidates, rows.collect())
            .expect("all rows")
    }

    /// Holds every level, and all integers that are wide enough for costs up to `largest`, to the twin.
    fn check(&self, largest: u64) {
        let cols = self.volume.cols() / self.candidates;
        let total = self.steps.largest_total(self.rule, cols, largest);
        let expected = self.expected();
        let told = format!("{:?} {:?} {:?}", self.candidates, self.rule, self.steps);
        for level in levels() {
            assert!(self.optimized(level) == expected, "{told}");
            assert!(self.optimized_in::<u32, u64>(level) == expected, "u64: {told}");
            if largest <= u16::MAX.into() && total <= u32::LARGEST_TOTAL {
                assert!(self.optimized_in::<u16, u32>(level) == expected, "u32: {told}");
            }
            if largest <= u8::MAX.into() && total <= u32::LARGEST_TOTAL {
                assert!(self.optimized_in::<u8, u32>(level) == expected, "u8, u32: {told}");
            }
            if largest <= u8::MAX.into() && total <= u8::LARGEST_TOTAL {
                assert!(self.optimized_in::<u8, u8>(level) == expected, "u8: {told}");
            }
        }
    }
}

fn optimizers() -> impl Strategy<Value = Rule> {
    select(RULES.to_vec())
}

/// Costs so large, or so small that ties abound.
fn largest_costs() -> impl Strategy<Value = u64> {
    select(vec![0, 1, 2, 7, 100, 255, 65_535, u32::MAX.into()])
}

/// Penalties like the costs, none, and those that nothing makes up for.
fn steps(largest: u64) -> impl Strategy<Value = Steps> {
    let one = move || {
        prop_oneof![
            2 => 0..=3u64,
            2 => 0..=largest.max(1),
            1 => Just(largest),
            1 => Just(largest + 1),
            1 => Just(1u64 << 40)
        ]
    };
    (one(), one()).prop_map(|(near, far)| Steps { near, far })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(384))]

    #[test]
    fn the_best_path_is_found(
        (rows, cols, candidates) in (heights(), widths(), select(COUNTS[..8].to_vec())),
        (largest, steps) in largest_costs().prop_flat_map(|largest| (Just(largest), steps(largest))),
        rule in optimizers(),
        seed in any::<u64>(),
    ) {
        let size = (rows.min(1 + 30_000 / (cols * candidates)), cols, candidates);
        Problem::random(size, largest, seed, rule, steps).check(largest);
    }

    /// Random costs are no rows of an image: neighbours are alike there, and paths go on for long.
    #[test]
    fn the_best_path_through_smooth_costs_is_found(
        (cols, candidates) in (widths(), select(COUNTS[..9].to_vec())),
        (largest, steps) in (1u64..=30).prop_flat_map(|largest| (Just(largest), steps(largest))),
        rule in optimizers(),
        seed in any::<u64>(),
    ) {
        let cost = |y: usize, place: usize| {
            let (x, k) = (place / candidates, place % candidates);
            let truth = (hash(seed, y, x / 4) as usize) % candidates;
            (k.abs_diff(truth) as u64 + hash(!seed, y, place) % 3).min(largest) as u32
        };
        let volume = Plane::from_fn(2, cols * candidates, cost);
        Problem { volume, candidates, rule, steps }.check(largest);
    }

    #[test]
    fn no_index_rises_by_more_than_one_in_order(cols in widths(), candidates in 1usize..=9, seed: u64) {
        let (rule, steps) = (Rule::DynamicProgramming, Steps { near: 0, far: 0 });
        let problem = Problem::random((1, cols, candidates), 5, seed, rule, steps);
        let chosen = problem.optimized(levels()[0]);
        prop_assert!(chosen.row(0).windows(2).all(|pair| pair[1] <= pair[0] + 1), "{chosen:?}");
    }

    #[test]
    fn the_winner_is_the_first_least(cols in widths(), candidates in 1usize..=300, seed: u64) {
        let rule = Rule::WinnerTakesAll;
        let problem = Problem::random((1, cols, candidates), 40, seed, rule, Steps::default());
        let chosen = problem.optimized(levels()[0]);
        for (costs, &index) in problem.volume.row(0).chunks(candidates).zip(chosen.row(0)) {
            let least = costs.iter().min();
            prop_assert_eq!(costs.iter().position(|cost| Some(cost) == least), Some(index.into()));
        }
    }
}

#[test]
fn every_number_of_candidates() {
    for (rule, candidates) in RULES.into_iter().flat_map(|rule| COUNTS.map(|count| (rule, count))) {
        for (rows, cols, largest) in [(33, 2, 3), (1, tile() + 1, 20)] {
            let steps = Steps { near: 2, far: 5 };
            Problem::random((rows, cols, candidates), largest, 5, rule, steps).check(largest);
        }
    }
}

/// At the very limit of bytes: what lies one above it is for words.
#[test]
fn totals_up_to_the_largest_byte_are_exact() {
    for (near, far) in [(55, 55), (55, 10), (0, 55), (55, 0)] {
        for (largest, cols, rule) in
            [(200, 40, Rule::ScanlineOptimization), (5, 40, Rule::DynamicProgramming)]
        {
            let steps = Steps { near, far };
            assert_eq!(steps.largest_total(rule, cols, largest), 255);
            // Costs of nothing or of all there is: totals come as far as they can.
            for odds in [1, 2, 8, 1 << 40] {
                let cost = |y, place| {
                    if hash(1, y, place).is_multiple_of(odds) { largest as u32 } else { 0 }
                };
                for candidates in [1, 2, 9, 17] {
                    let volume = Plane::from_fn(3, cols * candidates, cost);
                    Problem { volume, candidates, rule, steps }.check(largest);
                    let volume = Plane::from_fn(3, cols * candidates, |_, _| largest as u32);
                    Problem { volume, candidates, rule, steps }.check(largest);
                }
            }
        }
    }
}

/// At the very limit of 32 bits, by penalties and by long rows.
#[test]
fn totals_up_to_the_largest_word_are_exact() {
    for far in [u32::LARGEST_TOTAL - 65_535 * 40, 0] {
        for near in [far, 0] {
            for rule in RULES {
                let steps = Steps { near, far };
                let largest = 65_535;
                Problem::random((2, 40, 9), largest, 3, rule, steps).check(largest);
                let cols = ((u32::LARGEST_TOTAL - far) / largest) as usize;
                let volume = Plane::from_fn(1, 2 * cols, |_, place| 65_535 - (place % 2) as u32);
                Problem { volume, candidates: 2, rule, steps }.check(largest);
            }
        }
    }
}

#[test]
fn the_last_of_the_most_candidates_can_be_chosen() {
    let (candidates, last) = (MOST_DISPARITIES, MOST_DISPARITIES - 1);
    for rule in RULES {
        let steps = Steps { near: 1, far: 1 };
        // The only good ones are the last, then the last but one, then the first.
        let good = [last, last - 1, 0];
        let cost = |_, place| u32::from(place % candidates != good[place / candidates]) * 9;
        let volume = Plane::from_fn(1, 3 * candidates, cost);
        let problem = Problem { volume, candidates, rule, steps };
        for level in levels() {
            let expected = good.map(|index| index as u16);
            assert_eq!(problem.optimized(level).row(0), expected, "{rule:?}");
            assert_eq!(problem.optimized_in::<u8, u8>(level).row(0), expected, "{rule:?}");
            assert_eq!(problem.optimized_in::<u16, u32>(level).row(0), expected, "{rule:?}");
        }
    }
}

#[test]
fn penalties_are_in_units_of_the_mean_cost() {
    let window =
        Window { rows: 1, cols: 1, candidates: 1, side: 9, ceiling: 14, ..Window::default() };
    let penalty = Penalty { near: 0.5, far: 2.0 };
    assert_eq!(Steps::new(penalty, window, 1), Steps { near: 41, far: 162 }, "40.5 is rounded up");
    assert_eq!(Steps::new(penalty, window, 16), Steps { near: 648, far: 2592 });
    let coarse = Window { dropped: 2, ..window };
    assert_eq!(Steps::new(penalty, coarse, 1), Steps { near: 10, far: 41 }, "40.5 / 4 and 162 / 4");
}

#[test]
fn the_largest_penalty_on_the_largest_window_is_exact() {
    let window = Window { side: 63, ..Window::default() };
    let penalty = Penalty { near: LARGEST_PENALTY, far: LARGEST_PENALTY };
    let most = 65_535 * 63 * 63 * 256;
    assert_eq!(Steps::new(penalty, window, 256), Steps { near: most, far: most });
}

#[test]
fn totals_beyond_32_bits_do_not_overflow() {
    let volume =
        Plane::from_fn(1, 600, |_, place| if place % 2 == 0 { u32::MAX } else { u32::MAX - 1 });
    for rule in RULES {
        let steps = Steps { near: 1 << 40, far: 1 << 40 };
        let problem = Problem { volume: volume.clone(), candidates: 2, rule, steps };
        assert!(problem.optimized(levels()[0]).as_slice().iter().all(|&index| index == 1));
    }
}

#[test]
fn a_cancelled_search_stops() {
    let control = Control::default();
    control.cancel();
    let volume = Plane::from_fn(2, 6, |_, _| 1);
    let rule = Rule::ScanlineOptimization;
    let stopped = optimize(&volume, 3, rule, Steps::default(), levels()[0], &control);
    assert_eq!(stopped, Err(Error::Cancelled));
}
