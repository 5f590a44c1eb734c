//! Whole matches: whatever the threads, the integers and the previous use of memory, they equal the chain of
//! reference implementations.

use std::io::Write;
use std::sync::Arc;

use crate::common::naive::{self, ResultBits};
use crate::common::parts;
use crate::common::{
    LARGEST_PENALTY, OPTIMIZERS, affordable, blur_compensation, eight_valid_pairs, hash, levels, mask,
    noises, random, refinements, robust, settings, view, views,
};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Error;
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::base::value::Value;
use phasestereo_match::cost::validity::Validity;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::{Execution, Matcher, on_threads};
use phasestereo_match::optimization::PANEL;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::refinement::flag;
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{CostKind, Optimizer, Precision, Settings};
use proptest::prelude::*;
use proptest::sample::select;

/// Limit on the work of the naive chain: pixels x candidates x places of the window, and the same for the
/// codes.
const AFFORDABLE: usize = 1 << 21;

/// A pair and the settings to match it with.
#[derive(Debug, Clone)]
struct MatchJob {
    pair: Pair,
    settings: Settings,
}

impl MatchJob {
    fn new([left, right]: [View; 2], min: i64, count: i64, settings: Settings) -> Self {
        settings.check().expect("legal settings");

        let pair = Pair::new(left, right, min, count).expect("a legal pair");
        // The weak level depends on the noise.
        let known = settings.has_weak().then(|| noise_alone([1.0; 2]));
        Self { pair: parts::compensated(pair, known), settings }
    }

    /// The result, from a new matcher.
    fn run(&self, execution: Execution) -> ResultBits {
        self.run_with(&Matcher::new(execution.threads).expect("threads"), execution)
    }

    /// The result, from a matcher that may have been used before.
    fn run_with(&self, matcher: &Matcher, execution: Execution) -> ResultBits {
        let control = Control::default();

        let map = matcher.match_pair(&self.pair, &self.settings, execution, &control).expect("a legal match");
        assert_eq!(control.rows_done(), self.pair.size().0);

        ResultBits::new(map)
    }

    /// The result of the naive chain.
    fn expected(&self) -> ResultBits {
        naive::matched(&self.pair, &self.settings)
    }

    /// Compares the match with the naive chain, at every level.
    fn check(&self) {
        let expected = self.expected();
        for level in levels() {
            assert!(self.run(execution(1, level)) == expected, "{}: {self}", level.name());
        }
    }

    /// Bytes of the integers that are wide enough for the costs and totals of this match.
    fn bytes(&self) -> usize {
        let (window, penalties) = naive::scale(&self.pair, &self.settings);
        let is_masked = Validity::new(self.pair.views(), self.pair.candidates()).expect("memory").is_some();

        let total = match self.settings.optimizer {
            Optimizer::DynamicProgramming | Optimizer::WinnerTakesAll => 0,
            Optimizer::ScanlineOptimization | Optimizer::SemiGlobal => {
                penalties.largest_total(window.largest_sum())
            }
        };

        let largest = total.max(window.largest_value(is_masked));

        if largest <= u8::LARGEST_TOTAL {
            1
        } else if largest <= u16::LARGEST_TOTAL {
            2
        } else {
            4
        }
    }
}

impl std::fmt::Display for MatchJob {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let (size, candidates) = (self.pair.size(), self.pair.candidates());
        write!(f, "{size:?}, {candidates:?}, {:?}", self.settings)
    }
}

fn execution(threads: usize, level: Level) -> Execution {
    Execution { threads, level }
}

fn executions() -> impl Strategy<Value = Execution> {
    (1usize..=8, select(levels())).prop_map(|(threads, level)| execution(threads, level))
}

/// Small pairs of any pixels, or pairs about as large as bands and panels: with few gray values, and so with
/// many ties, or with many.
fn pairs() -> impl Strategy<Value = Pair> {
    let small = (1usize..=14, 1usize..=14, 0u8..4)
        .prop_flat_map(|(rows, cols, kind)| [views(rows, cols, kind), views(rows, cols, kind)]);

    let heights = select(vec![1usize, 2, 17, 63, 64, 65, 81, 130]);
    let widths = select(vec![1, 2, 31, 63, 64, 65, 97, 131]);
    let masked = prop::option::of(0u64..=100);
    let seeded = (heights, widths, select(vec![1u64, 255]), masked, any::<u64>()).prop_map(
        |(rows, cols, white, percent, seed)| {
            [seed, !seed].map(|seed| {
                let view = view(rows, cols, |y, x| (hash(seed, y, x) % (white + 1)) as u8);
                view.with_mask(percent.map(|percent| mask(rows, cols, percent, seed)))
            })
        },
    );

    let range = (any::<prop::sample::Index>(), any::<prop::sample::Index>());

    (prop_oneof![2 => small, 1 => seeded], range).prop_map(|([left, right], (min, count))| {
        let cols = left.size().1;
        let count = 1 + count.index(cols.min(70)) as i64;
        let lowest = 1 - cols as i64 - (count - 1);
        let min = lowest + min.index((2 * cols as i64 + count - 2) as usize) as i64;

        Pair::new(left, right, min, count).expect("in reach")
    })
}

fn jobs() -> impl Strategy<Value = MatchJob> {
    let known = prop_oneof![1 => noises().prop_map(noise_alone), 1 => blur_compensation()];
    (pairs(), settings(), known).prop_map(|(pair, mut settings, known)| {
        let (rows, cols) = pair.size();

        let places = AFFORDABLE / (rows * cols * pair.candidates().count());
        settings.window = affordable(settings.window, places);

        let places = AFFORDABLE / (rows * cols * settings.components());
        let (r, s) = settings.frequencies;
        let least = (2 * r.max(s) + 1).max(3);
        // The neighborhood has to stay large enough for its frequencies.
        settings.neighborhood = affordable(settings.neighborhood, places).max(least);

        let is_phase = settings.cost == CostKind::Phase;
        let known = if is_phase { known } else { noise_alone(known.noise()) };

        MatchJob { pair: parts::compensated(pair, known), settings }
    })
}

fn noise_alone(noise: [f64; 2]) -> BlurCompensation {
    BlurCompensation::of_noise(noise).expect("legal noise")
}

proptest! {
    #![proptest_config(random(100))]

    #[test]
    fn any_match_equals_the_naive_chain(job in jobs(), execution in executions()) {
        prop_assert!(job.run(execution) == job.expected(), "{}", job);
    }
}

proptest! {
    #![proptest_config(random(60))]

    #[test]
    fn memory_used_before_leaves_no_trace(
        jobs in prop::collection::vec(jobs(), 2..7),
        execution in executions(),
    ) {
        let matcher = Matcher::new(execution.threads).expect("threads start");
        for job in &jobs {
            prop_assert!(job.run_with(&matcher, execution) == job.run(execution), "{}", job);
        }
    }
}

/// A scene and the same scene moved left by `shift`, so that costs range from 0 to the largest.
fn shifted(rows: usize, cols: usize, shift: usize) -> [View; 2] {
    [0, shift].map(|shift| view(rows, cols, |y, x| hash(9, y, x + shift) as u8))
}

fn with_masks([left, right]: [View; 2], percent: u64) -> [View; 2] {
    [(left, 11), (right, 12)].map(|(view, seed)| {
        let (rows, cols) = view.size();
        view.with_mask(Some(mask(rows, cols, percent, seed)))
    })
}

/// Settings that need integers of every width, whatever the optimizer, and their bytes.
fn settings_of_every_width() -> Vec<(Settings, usize)> {
    use Optimizer::{DynamicProgramming, ScanlineOptimization, SemiGlobal, WinnerTakesAll};

    let phase = Settings { neighborhood: 5, ..Preset::Paper.settings() };
    let byte = Settings { precision: Precision::Byte, ..phase };

    let cheap = (0.05, 0.1);

    let dear = (LARGEST_PENALTY, LARGEST_PENALTY);
    let sad = Settings { cost: CostKind::Sad, ..phase };
    let normalized = Settings { cost: CostKind::NormalizedSad, ..byte };

    let by = |optimizer, (p1, p2), settings: &Settings| Settings { optimizer, p1, p2, ..settings.clone() };
    let of = |window, settings: &Settings| Settings { window, ..settings.clone() };

    let several = Settings { adaptive_p2: 0.5, ..by(SemiGlobal, dear, &phase) };
    let alone = Settings { shiftable: false, ..by(WinnerTakesAll, dear, &phase) };

    vec![
        (of(3, &by(ScanlineOptimization, cheap, &byte)), 1),
        (of(3, &by(SemiGlobal, cheap, &byte)), 1),
        (of(3, &by(DynamicProgramming, dear, &byte)), 1),
        (of(3, &alone), 1),
        (of(5, &alone), 2),
        (of(5, &by(ScanlineOptimization, cheap, &phase)), 2),
        (of(5, &Settings { adaptive_p2: 0.5, ..by(SemiGlobal, cheap, &phase) }), 2),
        (phase.clone(), 2),
        (of(1, &sad), 2),
        (of(1, &by(WinnerTakesAll, cheap, &Settings { precision: Precision::Byte, ..sad })), 2),
        (of(3, &by(SemiGlobal, cheap, &normalized)), 2),
        (of(3, &by(ScanlineOptimization, dear, &phase)), 4),
        (of(3, &several), 4),
        (of(7, &by(WinnerTakesAll, cheap, &sad)), 4),
        (of(9, &Settings { precision: Precision::Full, ..normalized }), 4),
        (of(63, &by(ScanlineOptimization, dear, &sad)), 4),
        (of(63, &by(SemiGlobal, dear, &sad)), 4),
    ]
}

#[test]
fn integers_of_every_width_give_the_bits_of_the_naive_chain() {
    for (settings, bytes) in settings_of_every_width() {
        let cols = if settings.window > 9 { 9 } else { PANEL + 3 };
        for views in [shifted(35, cols, 2), with_masks(shifted(35, cols, 2), 90)] {
            let job = MatchJob::new(views, -1, 8, settings.clone());
            assert_eq!(job.bytes(), bytes, "{job}");
            job.check();
        }
    }
}

#[test]
fn penalties_from_none_to_the_largest() {
    let ends = [0.0, LARGEST_PENALTY];
    for (p1, p2) in ends.into_iter().flat_map(|p1| ends.map(|p2| (p1, p2))) {
        for optimizer in OPTIMIZERS {
            for (cost, window) in [(CostKind::Phase, 3), (CostKind::Phase, 31), (CostKind::Sad, 3)] {
                let settings = Settings { cost, window, optimizer, p1, p2, ..Preset::Paper.settings() };
                MatchJob::new(shifted(4, 11, 3), 0, 9, settings).check();
            }
        }
    }
}

/// A row of waves, the right one shifted by half a wave: at disparity 0 all bits differ, at half a wave none
/// does.
fn waves(rows: usize, cols: usize, half: usize) -> [View; 2] {
    [0, half].map(|shift| {
        let wave = |x: usize| math::cos(std::f64::consts::PI * (x + shift) as f64 / half as f64);
        view(rows, cols, |_, x| (128.0 + 100.0 * wave(x)) as u8)
    })
}

/// At the limits of bytes and of words, and one above: half of a penalty of 300 and 15 * (15 >> 1) = 105 are
/// 255; 9 * 14 = 126 and 65 409 are 65 535.
#[test]
fn totals_about_the_largest_are_exact() {
    let codes = Settings { neighborhood: 3, frequencies: (1, 0), ..Preset::Paper.settings() };
    let bytes = Settings { bits: 1, window: 15, precision: Precision::Byte, ..codes };
    let words = Settings { neighborhood: 5, window: 3, ..Preset::Paper.settings() };
    let limits = [(&bytes, 300.0, 1), (&words, 65_409.0, 2)];

    for (settings, p2, width) in limits {
        let unit = settings.window.pow(2) as f64;

        // One step more is the smallest difference: half of a step is dropped from sums.
        for (p1, width) in [(p2, width), (p2 + 2.0, 2 * width)] {
            let (p1, p2) = (p1 / unit, p2 / unit);

            for optimizer in [Optimizer::ScanlineOptimization, Optimizer::SemiGlobal] {
                for (half, min, count) in [(3, 0, 1), (3, 0, 7), (12, -3, 9), (3, -2, 31)] {
                    let settings = Settings { p1, p2, optimizer, ..settings.clone() };
                    let job = MatchJob::new(waves(17, 31, half), min, count, settings);
                    assert_eq!(job.bytes(), width, "{job}");
                    job.check();
                }
            }
        }
    }
}

#[test]
fn few_valid_pixels_do_not_overflow_a_byte() {
    for (optimizer, shiftable) in OPTIMIZERS.into_iter().zip([true, false, false, true]) {
        let settings = Settings {
            frequencies: (3, 2),
            bits: 1,
            window: 11,
            precision: Precision::Byte,
            optimizer,
            shiftable,
            ..Preset::Paper.settings()
        };
        MatchJob::new(eight_valid_pairs(), 0, 4, settings).check();
    }
}

#[test]
fn windows_larger_than_the_image_and_single_pixels() {
    for (rows, cols, count) in [(1, 1, 1), (1, 40, 7), (40, 1, 1), (3, 4, 4), (65, 2, 2)] {
        for window in [1, 3, 31, 63] {
            for optimizer in OPTIMIZERS {
                let settings = Settings { neighborhood: 5, window, optimizer, ..Preset::Paper.settings() };
                MatchJob::new(shifted(rows, cols, 1), 0, count, settings.clone()).check();
                MatchJob::new(with_masks(shifted(rows, cols, 1), 60), 0, count, settings).check();
            }
        }
    }
}

#[test]
fn nothing_valid_is_no_estimate_anywhere() {
    let job = MatchJob::new(with_masks(shifted(5, 9, 1), 0), -2, 5, Preset::Paper.settings());

    job.check();

    let seen = job.run(execution(2, levels()[0]));
    assert!(seen.disparity.into_iter().all(|bits| f32::from_bits(bits).is_nan()));
}

/// Jobs that leave the most in memory for the next one: different sizes, costs, masks and integers.
fn unlike_jobs() -> Vec<MatchJob> {
    let sizes = [(70, 3 * PANEL + 1, 33), (3, 17, 16), (33, PANEL, 9)];
    let every = settings_of_every_width().into_iter().zip(sizes.into_iter().cycle()).enumerate();

    every
        .map(|(i, ((settings, _), (rows, cols, count)))| {
            let settings = Settings { confidence: i % 3 > 0, bits: 1 + i % 4, ..settings };
            let views = shifted(rows, cols, 2);
            let views = if i % 2 == 0 { views } else { with_masks(views, 85) };
            MatchJob::new(views, -1, count, settings)
        })
        .collect()
}

#[test]
fn a_matcher_forgets_any_job_before_any_other() {
    let execution = execution(1, Level::best());
    let jobs: Vec<_> = unlike_jobs().into_iter().map(|job| (job.run(execution), job)).collect();
    for (_, before) in &jobs {
        let matcher = Matcher::new(1).expect("a thread starts");
        for (expected, job) in &jobs {
            before.run_with(&matcher, execution);
            assert!(job.run_with(&matcher, execution) == *expected, "{job} after {before}");
        }
    }
}

#[test]
fn one_matcher_serves_several_threads_at_once() {
    let execution = execution(2, Level::best());
    let jobs: Vec<_> = unlike_jobs().into_iter().map(|job| (job.run(execution), job)).collect();
    let matcher = Matcher::new(2).expect("threads start");
    std::thread::scope(|scope| {
        for first in 0..4 {
            let (jobs, matcher) = (&jobs, &matcher);
            scope.spawn(move || {
                for (expected, job) in jobs.iter().cycle().skip(3 * first).take(2 * jobs.len()) {
                    assert!(job.run_with(matcher, execution) == *expected, "{job}");
                }
            });
        }
    });
}

#[test]
fn every_thread_count_gives_the_same_bits() {
    for optimizer in OPTIMIZERS {
        let settings = Settings { optimizer, ..Preset::Paper.settings() };
        let job = MatchJob::new(shifted(131, 67, 3), 0, 16, settings);
        let expected = job.expected();
        for level in levels() {
            for threads in 1..=8 {
                let found = job.run(execution(threads, level));
                assert!(found == expected, "{threads} threads, {}: {job}", level.name());
            }
        }
    }
}

#[test]
fn levels_that_this_machine_lacks_are_told() {
    let mut told = std::io::stderr();
    for (name, level) in Level::all() {
        let run = if level.is_some() { "run" } else { "not run: this machine lacks it" };
        writeln!(told, "level {name}: {run}").expect("somebody listens");
    }
    assert!(levels().contains(&Level::best()));
}

#[test]
fn a_shifted_image_is_found_again() {
    let job = MatchJob::new(shifted(40, 80, 3), 0, 9, Preset::Paper.settings());
    let seen = job.run(execution(2, Level::best()));

    for (place, (bits, flags)) in seen.disparity.iter().zip(&seen.flags).enumerate() {
        assert!(place % 80 < 8 || *bits == 3f32.to_bits() && *flags == 0, "{place}");
    }
}

/// A kernel of one tap: it moves the image by this many columns, which distinguishes classes.
fn moving(columns: isize) -> Kernel {
    let taps = Plane::from_fn(1, 33, |_, x| f64::from(u8::from(x as isize - 16 == columns)));

    Kernel::new(&taps).expect("a legal kernel")
}

/// A match in this many classes, each of which finds a different disparity.
fn in_classes(count: usize, size: (usize, usize), tile: usize) -> MatchJob {
    let kernels = (0..count as isize).map(|class| [None, Some(moving(-class))]).collect();
    let tiles = (size.0.div_ceil(tile), size.1.div_ceil(tile));
    let labels = Plane::from_fn(tiles.0, tiles.1, |y, x| (hash(5, y, x) % count as u64) as u8);

    let compensation = BlurCompensation::new([0.5, 0.5], kernels, labels, tile).expect("legal compensation");

    let settings = Settings { noise_threshold: 1.0, confidence: false, ..Preset::Paper.settings() };
    let settings = Settings { neighborhood: 5, frequencies: (1, 1), window: 1, ..settings };

    let MatchJob { pair, settings } = MatchJob::new(shifted(size.0, size.1, 1), 0, 20, settings);
    MatchJob { pair: parts::compensated(pair, compensation), settings }
}

#[test]
fn every_number_of_classes_in_tiles_of_any_size() {
    for (count, tile_side) in [(1, 9), (2, 40), (3, 7), (4, 33), (5, 16), (16, 3), (16, 1)] {
        in_classes(count, (67, 2 * PANEL + 9), tile_side).check();
    }
}

#[test]
fn each_class_is_compared_in_its_own_version() {
    let job = in_classes(4, (64, 96), 32);
    let seen = job.run(execution(1, Level::best()));
    let compensation = job.pair.blur_compensation().expect("classes");

    // Within a tile, beyond the reach of the windows and of the left border.
    for (y, x) in (8..56).flat_map(|y| (40..90).map(move |x| (y, x))) {
        let is_inner = |place: usize| (8..24).contains(&(place % 32));
        let expected = 1.0 + compensation.class(y, x) as f32;

        let found = f32::from_bits(seen.disparity[y * 96 + x]);
        assert!(
            !is_inner(y) || !is_inner(x) || (found - expected).abs() < 0.1,
            "{y}, {x}: {found}, {expected}"
        );
    }
}

#[test]
fn classes_that_change_nothing_change_nothing() {
    let job = in_classes(1, (40, 50), 16);
    let known = job.pair.blur_compensation().expect("noise").noise();

    let labels = Plane::from_fn(3, 4, |y, x| (hash(1, y, x) % 3) as u8);
    let same = BlurCompensation::new(known, vec![[None, Some(moving(0))]; 3], labels, 16).expect("legal");
    let alike = MatchJob { pair: parts::compensated(job.pair.clone(), same), settings: job.settings.clone() };
    let plain = MatchJob { pair: parts::compensated(job.pair, noise_alone(known)), settings: job.settings };

    let execution = execution(1, Level::best());
    assert!(alike.run(execution) == plain.run(execution));
}

#[test]
fn kernels_are_for_phase_codes() {
    let MatchJob { pair, settings } = in_classes(2, (6, 30), 4);
    let settings = Settings { cost: CostKind::Sad, noise_threshold: 0.0, ..settings };

    let execution = execution(1, Level::best());
    let refused = Matcher::new(execution.threads)
        .and_then(|matcher| matcher.match_pair(&pair, &settings, execution, &Control::default()))
        .expect_err("refused");
    assert!(refused.to_string().starts_with("blur_compensation: got"), "{refused}");
}

/// A near patch in front of a surface: part of the surface is occluded on the right, and there is noise.
fn layered(rows: usize, cols: usize) -> [View; 2] {
    let is_near = |y: usize, x: usize| {
        (rows / 4..rows - rows / 4).contains(&y) && (cols / 3..cols - cols / 3).contains(&x)
    };
    let scene = |y, x| hash(9, y, x) as u8;
    let left = |y, x| match (hash(3, y, x) % 12, is_near(y, x)) {
        (0, _) => hash(4, y, x) as u8,
        (_, true) => scene(y, x + 2),
        (_, false) => scene(y, x + 6),
    };

    [view(rows, cols, left), view(rows, cols, |y, x| scene(y, x + 8))]
}

/// The same job in three classes, with tiles that fit neither bands nor panels.
fn compensated(job: MatchJob) -> MatchJob {
    let labels = Plane::from_fn(4, 7, |y, x| (hash(2, y, x) % 3) as u8);
    let kernels = vec![[None, None], [Some(moving(1)), None], [None, Some(moving(-2))]];
    let compensation = BlurCompensation::new([0.5, 1.5], kernels, labels, 11).expect("legal compensation");

    MatchJob { pair: parts::compensated(job.pair, compensation), ..job }
}

/// Matches with nearly default settings, of pairs large and tiny, with and without masks, in one version and
/// in several.
fn robust_jobs() -> Vec<MatchJob> {
    let sizes = [(1, 1, 1), (1, 40, 7), (40, 1, 1), (33, 65, 1), (3, 4, 4), (50, 70, 9)];
    let pairs = sizes.into_iter().flat_map(|(rows, cols, count)| {
        let views = layered(rows, cols);
        [views.clone(), with_masks(views, 85)].map(|views| (views, count))
    });

    let jobs = pairs.map(|(views, count)| MatchJob::new(views, -count / 4, count, robust()));
    jobs.flat_map(|job| [job.clone(), compensated(job)]).collect()
}

#[test]
fn matches_by_default_are_those_of_the_naive_chain() {
    robust_jobs().iter().for_each(MatchJob::check);
}

/// Wide enough for several panels, and high enough for several bands.
#[test]
fn matches_by_default_are_the_same_on_any_threads_and_levels() {
    let wide = |views| compensated(MatchJob::new(views, -2, 12, robust()));

    let views = layered(150, 200);
    let jobs = robust_jobs().into_iter().chain([wide(views.clone()), wide(with_masks(views, 90))]);
    let known: Vec<_> = jobs.map(|job| (job.run(execution(1, levels()[0])), job)).collect();

    for threads in [1, 2, 4] {
        let matcher = Matcher::new(threads).expect("threads start");
        for level in levels() {
            // From the largest one on, and in reverse.
            for (expected, job) in known.iter().rev().chain(&known) {
                let found = job.run_with(&matcher, execution(threads, level));
                assert!(found == *expected, "{threads} threads, {}: {job}", level.name());
            }
        }
    }
}

proptest! {
    #![proptest_config(random(40))]

    #[test]
    fn matches_by_default_but_for_refinement_are_those_of_the_naive_chain(
        pair in pairs(),
        refinement in refinements(),
        execution in executions(),
    ) {
        let Settings { neighborhood, frequencies, noise_threshold, window, .. } = robust();
        let Settings { shiftable, precision, optimizer, p1, p2, adaptive_p2, .. } = robust();
        let settings = Settings { neighborhood, frequencies, noise_threshold, window, ..refinement };
        let settings = Settings { shiftable, precision, optimizer, p1, p2, adaptive_p2, ..settings };

        let job = MatchJob { pair: parts::compensated(pair, noise_alone([1.0; 2])), settings };
        prop_assert!(job.run(execution) == job.expected(), "{}", job);
    }
}

fn disparities(seen: &ResultBits) -> Vec<f32> {
    seen.disparity.iter().map(|bits| f32::from_bits(*bits)).collect()
}

fn found_with(settings: Settings) -> ResultBits {
    let job = MatchJob::new(with_masks(layered(60, 80), 97), -1, 12, settings);
    job.check();
    job.run(execution(2, Level::best()))
}

#[test]
fn what_is_not_filled_is_missing() {
    let filled = found_with(robust());
    let bare = found_with(Settings { fill: false, ..robust() });

    assert!(filled.flags.iter().any(|flags| flags & flag::FILLED != 0));

    let pixels = disparities(&filled).into_iter().zip(disparities(&bare));
    let flags = filled.flags.iter().zip(&bare.flags);

    for ((filled, bare), (all, flags)) in pixels.zip(flags) {
        let is_trusted = flags & flag::UNTRUSTED == 0;
        assert_eq!(*flags, all & !flag::FILLED);
        assert_eq!(filled.is_nan(), flags & flag::MASKED != 0);
        assert!(if is_trusted { filled.to_bits() == bare.to_bits() } else { bare.is_nan() });
    }
}

#[test]
fn low_confidence_is_masked_out() {
    let all = found_with(robust());

    // A third of all pixels has a lower confidence.
    let mut least: Vec<_> = all.confidence.iter().flatten().map(|bits| f32::from_bits(*bits)).collect();
    least.sort_by(f32::total_cmp);
    let least = f64::from(least[least.len() / 3]);

    for confidence in [true, false] {
        let some = found_with(Settings { min_confidence: least, confidence, ..robust() });
        assert_eq!(some.confidence, all.confidence.clone().filter(|_| confidence));

        let confidences = all.confidence.as_ref().expect("asked for").iter();

        // Both counts ensure that the threshold is neither below nor above all confidences.
        let (mut kept, mut invalid) = (0, 0);

        for (place, bits) in confidences.enumerate() {
            let is_low = f64::from(f32::from_bits(*bits)) < least;
            let was_there = !f32::from_bits(all.disparity[place]).is_nan();

            if is_low && was_there {
                invalid += 1;
                let flags = all.flags[place] & !flag::FILLED;
                assert_eq!(some.flags[place], flags | flag::LOW_CONFIDENCE);
                assert!(f32::from_bits(some.disparity[place]).is_nan());
            } else {
                kept += 1;
                assert_eq!(some.flags[place], all.flags[place]);
                assert_eq!(some.disparity[place], all.disparity[place]);
            }
        }

        assert!(kept > 100 && invalid > 100, "{kept} and {invalid}");
    }
}

#[test]
fn each_check_goes_by_itself_with_any_optimizer() {
    for optimizer in OPTIMIZERS {
        let small = Settings { optimizer, p1: 5.0, p2: 20.0, sizes: 1, ..robust() };
        let plain = Settings { lr_check: None, speckle_size: 0, ..small };
        let speckles = found_with(Settings { speckle_size: 9, ..plain.clone() });
        let owners = found_with(Settings { lr_check: Some(0), ..plain.clone() });

        let all = |seen: &ResultBits| seen.flags.iter().fold(0, |all, flags| all | flags);
        let owned = flag::OCCLUDED | flag::MISMATCHED;
        assert_eq!(all(&speckles) & (owned | flag::SPECKLE), flag::SPECKLE, "{optimizer:?}");
        assert_eq!(all(&owners) & (owned | flag::SPECKLE), owned, "{optimizer:?}");

        let none = all(&found_with(plain));
        assert_eq!(none & (owned | flag::SPECKLE | flag::FILLED), 0, "{optimizer:?}");
    }
}

/// The right image shows the scene further right: disparities are negative.
#[test]
fn negative_disparities_are_found() {
    let [right, left] = shifted(60, 90, 5);
    let job = MatchJob::new([left, right], -9, 9, robust());

    job.check();

    let found = disparities(&job.run(execution(1, Level::best())));
    let inner = (10..50).flat_map(|y| (10..75).map(move |x| y * 90 + x));
    for place in inner {
        assert!((found[place] + 5.0).abs() < 0.5, "{place}: {}", found[place]);
    }
}

#[test]
fn a_cancelled_match_stops_and_the_matcher_goes_on() {
    let job = MatchJob::new(shifted(200, 120, 3), 0, 60, Preset::Paper.settings());
    let execution = execution(2, Level::best());
    let expected = job.run(execution);

    let matcher = Matcher::new(2).expect("threads start");
    let cancelled = Control::default();
    cancelled.cancel();
    assert_eq!(matcher.match_pair(&job.pair, &job.settings, execution, &cancelled), Err(Error::Cancelled));

    // In the middle of a match, after some rows. A fast machine may be done by then.
    for rows in [1, 20, 100] {
        let control = Arc::new(Control::default());
        let watched = Arc::clone(&control);
        let watch = std::thread::spawn(move || {
            while watched.rows_done() < rows {
                std::thread::yield_now();
            }
            watched.cancel();
        });

        match matcher.match_pair(&job.pair, &job.settings, execution, &control) {
            Ok(map) => assert!(ResultBits::new(map) == expected),
            Err(error) => assert_eq!(error, Error::Cancelled),
        }

        watch.join().expect("the watch ends");
        assert!(job.run_with(&matcher, execution) == expected, "cancelled after {rows} rows");
    }
}

#[test]
fn threads_are_counted() {
    for threads in [0, 1025] {
        let refused = on_threads(threads, || ()).expect_err("refused");
        assert!(refused.to_string().starts_with("threads: got"), "{refused}");
        assert!(Matcher::new(threads).is_err());
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let job = MatchJob::new(shifted(2, 3, 1), 0, 1, Preset::Paper.settings());
    let settings = Settings { window: 65, ..Preset::Paper.settings() };
    let execution = execution(1, Level::best());

    let refused = Matcher::new(execution.threads)
        .and_then(|matcher| matcher.match_pair(&job.pair, &settings, execution, &Control::default()))
        .expect_err("refused");
    assert!(refused.to_string().starts_with("window: got 65"), "{refused}");
}

#[test]
fn images_of_two_sizes_or_types_are_refused() {
    let input = |rows, image: fn(ndarray::Array3<u8>) -> Image| {
        Input::from(image(ndarray::Array3::zeros((rows, 4, 1))))
    };

    let refused = |right| {
        let inputs = [input(3, Image::U8), right];
        Pair::of_inputs(inputs, 0, 1).expect_err("refused").to_string()
    };
    assert_eq!(refused(input(2, Image::U8)), "right: got 2 x 4 pixels; accepts the size of left, 3 x 4");

    let wide = input(3, |pixels| Image::U16(pixels.mapv(u16::from)));
    assert_eq!(refused(wide), "right: got pixels of another type; accepts the type of left");
}

#[test]
fn without_masks_every_pair_is_valid() {
    let pair = MatchJob::new(shifted(4, 9, 1), 0, 3, Preset::Paper.settings()).pair;
    assert!(Validity::new(pair.views(), pair.candidates()).expect("memory").is_none());
}
