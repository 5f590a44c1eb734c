//! Candidates chosen along paths, in order and pixel by pixel: lanes of narrow integers, band by band and
//! panel by panel, compared with the reference implementations, which try every path, every origin and every
//! candidate.

use std::ops::Range;

use crate::common::{
    COUNTS, LARGEST_ADAPTIVE, LARGEST_PENALTY, OPTIMIZERS, hash, heights, levels, naive, random, widths,
};
use crate::reference;
use crate::reference::PixelEvidence;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::base::value::{LANES, Value};
use phasestereo_match::cost::aggregation::Window;
use phasestereo_match::image::intensity::LARGEST_REACH;
use phasestereo_match::image::texture::Texture;
use phasestereo_match::matcher::on_threads;
use phasestereo_match::optimization::edges::Edges;
use phasestereo_match::optimization::evidence::NONE;
use phasestereo_match::optimization::panel_ranges::PanelRanges;
use phasestereo_match::optimization::{
    BAND, CandidateSearch, CostVolume, LARGEST_SUMMED_PENALTY, LOOKAHEAD_COLUMNS, LOOKAHEAD_ROWS, PANEL,
    Penalties, Weighing, Workspace, optimize,
};
use phasestereo_match::pair::candidates::Searched;
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{MOST_DISPARITIES, Optimizer, Settings};
use proptest::prelude::*;
use proptest::sample::select;

/// Values of a volume that the reference implementation has time for.
const AFFORDABLE: usize = 40_000;

/// Costs, and how candidates are chosen from them.
#[derive(Debug, Clone)]
struct Volume {
    costs: Plane<u32>,
    candidates: usize,
    optimizer: Optimizer,
    penalties: Penalties,
    /// Gray values, and the threshold of their jumps.
    gray: Option<(Plane<i32>, f64)>,
    /// A seed for the candidates of each panel; `None`: all of them everywhere.
    ranges: Option<u64>,
}

/// Buffers for integers of every width, reused from volume to volume.
#[derive(Default)]
struct Workspaces {
    bytes: Workspace<u8>,
    words: Workspace<u16>,
    widest: Workspace<u32>,
}

impl Volume {
    /// Costs up to the largest one: noise, or patches of one disparity with some noise.
    fn new(
        (rows, cols, candidates): (usize, usize, usize),
        largest: u64,
        optimizer: Optimizer,
        penalties: Penalties,
        seed: u64,
    ) -> Self {
        let is_scene = seed & 1 == 0;

        let costs = Plane::from_fn(rows, cols * candidates, |y, place| {
            let (x, k) = (place / candidates, place % candidates);
            let truth = hash(seed, y / 9, x / 11) as usize % candidates;
            let noise = hash(!seed, y, place) % (largest + 1);
            let ramp = largest / 4 * k.abs_diff(truth) as u64 + noise / 4;

            if is_scene { ramp.min(largest) as u32 } else { noise as u32 }
        });

        Self { costs, candidates, optimizer, penalties, gray: None, ranges: None }
    }

    /// Adds gray values, patches with some noise: jumps of every size.
    fn with_gray(self, threshold: f64, seed: u64) -> Self {
        let (rows, cols) = self.size();
        let gray = Plane::from_fn(rows, cols, |y, x| {
            (hash(seed, y / 5, x / 7) % 200) as i32 + (hash(!seed, y, x) % 30) as i32
        });

        Self { gray: Some((gray, threshold)), ..self }
    }

    /// The candidates that are searched in a band and a panel: one, some, or all.
    fn searched(&self, band: usize, panel: usize) -> Range<usize> {
        let Some(seed) = self.ranges else { return 0..self.candidates };
        let number = |salt: u64| hash(seed ^ salt, band, panel) as usize;
        let start = number(1) % self.candidates;
        let count = 1 + number(2) % (self.candidates - start);
        // Neighbors often have the same ones.
        if number(3).is_multiple_of(3) { 0..self.candidates } else { start..start + count }
    }

    /// Rows and columns of the image.
    fn size(&self) -> (usize, usize) {
        (self.costs.rows(), self.costs.cols() / self.candidates)
    }

    /// The evidence from the reference implementations.
    fn expected(&self) -> Plane<PixelEvidence> {
        let gray = self.gray.as_ref();
        let edges = gray.map(|(gray, threshold)| reference::edges(gray, *threshold));

        let Self { costs, candidates, optimizer, penalties, .. } = self;
        let searched = |band: usize, panel: usize| self.searched(band, panel);
        naive::optimized(costs, *candidates, *optimizer, *penalties, edges.as_ref(), &searched)
    }

    /// The evidence by bands, from the last one up, since bands must not depend on each other.
    fn found<T: Value>(
        &self,
        workspace: &mut Workspace<T>,
        weighs: bool,
        level: Level,
        control: &Control,
    ) -> Result<Plane<PixelEvidence>> {
        let size @ (rows, cols) = self.size();
        let calm = Control::default();
        let edges = match &self.gray {
            Some((gray, threshold)) => Edges::new(&Texture::new(gray.clone()), *threshold, level, &calm),
            None => Edges::nowhere(cols),
        };

        let Self { ref costs, candidates, optimizer, penalties, .. } = *self;
        let edges = &edges.expect("memory");

        let ranges = self.ranges.map(|_| {
            PanelRanges::new(size, |[rows, columns]| {
                let Range { start, end } = self.searched(rows.start / BAND, columns.start / PANEL);
                Searched { start, count: end - start }
            })
        });

        let search = CandidateSearch {
            size,
            first: 0,
            candidates,
            ranges: ranges.as_ref(),
            optimizer,
            penalties,
            edges,
            weighs: if weighs { Weighing::All } else { Weighing::Nothing },
            level,
            control,
        };

        let nothing = PixelEvidence { chosen: u16::MAX, best: NONE, second_best: NONE, offset: f32::NAN };
        let mut found = Plane::from_fn(rows, cols, |_, _| nothing);

        let bands: Vec<_> = search.bands(0..rows).collect();
        for band in bands.into_iter().rev() {
            let source = CostVolume { volume: costs, candidates };
            let evidence = search.choose(band.clone(), &source, workspace)?;

            for (row, y) in band.enumerate() {
                let seen = evidence.row(row);
                for (x, found) in found.row_mut(y).iter_mut().enumerate() {
                    // A band that is not weighed only has the choices.
                    let cost = |costs: &[u32]| costs.get(x).copied().unwrap_or(NONE);
                    let offset = seen.offset.get(x).copied().unwrap_or(f32::NAN);
                    let (best, second_best) = (cost(seen.best), cost(seen.second_best));

                    *found = PixelEvidence { chosen: seen.chosen[x], best, second_best, offset };
                }
            }
        }

        Ok(found)
    }

    /// Compares all integers that are wide enough with the reference implementation, at every level.
    fn check(&self, workspaces: &mut Workspaces) {
        let Workspaces { bytes, words, widest } = workspaces;
        let expected = self.expected();

        let largest_cost = self.costs.as_slice().iter().max().map_or(0, |cost| u64::from(*cost));
        let largest = match self.optimizer {
            Optimizer::DynamicProgramming | Optimizer::WinnerTakesAll => largest_cost,
            Optimizer::ScanlineOptimization | Optimizer::SemiGlobal => {
                self.penalties.largest_total(largest_cost)
            }
        };

        self.check_in(&expected, widest);
        if largest <= u16::LARGEST_TOTAL {
            self.check_in(&expected, words);
        }

        if largest <= u8::LARGEST_TOTAL {
            self.check_in(&expected, bytes);
        }
    }

    /// Compares one width of integers with the reference implementation.
    fn check_in<T: Value>(&self, expected: &Plane<PixelEvidence>, workspace: &mut Workspace<T>) {
        for (level, weighs) in levels().into_iter().flat_map(|level| [(level, true), (level, false)]) {
            let found = self.found(workspace, weighs, level, &Control::default()).expect("memory");
            let mut pairs = found.as_slice().iter().zip(expected.as_slice()).enumerate();
            let wrong = pairs.find(
                |(_, (found, expected))| {
                    if weighs { found != expected } else { found.chosen != expected.chosen }
                },
            );

            assert!(
                wrong.is_none(),
                "{:?} of {:?}, {} candidates, {:?}, {:?}, edges: {}, ranges: {:?}, {}, {}",
                wrong,
                self.size(),
                self.candidates,
                self.optimizer,
                self.penalties,
                self.gray.is_some(),
                self.ranges,
                level.name(),
                std::any::type_name::<T>(),
            );
        }
    }
}

/// Largest costs, and penalties from none to more than any cost; often the largest that fit in bytes or
/// words.
fn scales() -> impl Strategy<Value = (u64, Penalties)> {
    let largest =
        select(vec![0, 1, 3, 20, 100, 200, 255, 256, 1000, 65_535, 1 << 20, LARGEST_SUMMED_PENALTY]);

    largest.prop_flat_map(|largest| {
        let spare = if largest > 255 { 65_535u64 } else { 255 }.saturating_sub(largest);

        let one = move || {
            prop_oneof![
                2 => Just(0),
                3 => 0..=spare,
                1 => Just(spare),
                1 => Just(spare + 1),
                1 => 0..=largest,
                1 => Just(LARGEST_SUMMED_PENALTY),
            ]
        };

        (Just(largest), one(), one(), any::<bool>()).prop_map(|(largest, p1, p2, is_one)| {
            (largest, Penalties { p1, p2: if is_one { p1 } else { p2 } })
        })
    })
}

/// The wanted rows and columns, reduced to what the reference implementation has time for.
fn affordable(rows: usize, cols: usize, candidates: usize, is_wide: bool) -> (usize, usize) {
    let places = AFFORDABLE / candidates;
    if is_wide { (rows.min((places / cols).max(1)), cols) } else { (rows, cols.min((places / rows).max(1))) }
}

fn volumes() -> impl Strategy<Value = Volume> {
    let size = (heights(), widths(), select(COUNTS.to_vec()), any::<bool>());
    let threshold = prop_oneof![3 => 0.05..3.0f64, 1 => Just(LARGEST_ADAPTIVE)];
    let optimizers = OPTIMIZERS.into_iter().chain([Optimizer::SemiGlobal; 2]).collect::<Vec<_>>();
    let choices = (select(optimizers), prop::option::of(threshold), prop::option::of(any::<u64>()));

    (size, scales(), choices, any::<u64>()).prop_map(
        |((rows, cols, candidates, is_wide), (largest, penalties), (optimizer, threshold, ranges), seed)| {
            let (rows, cols) = affordable(rows, cols, candidates, is_wide);
            let size = (rows, cols, candidates);
            let volume = Volume { ranges, ..Volume::new(size, largest, optimizer, penalties, seed) };

            match threshold {
                Some(threshold) => volume.with_gray(threshold, seed),
                None => volume,
            }
        },
    )
}

proptest! {
    #![proptest_config(random(300))]

    #[test]
    fn every_pixel_is_as_by_the_reference(volume in volumes()) {
        volume.check(&mut Workspaces::default());
    }
}

proptest! {
    #![proptest_config(random(16))]

    #[test]
    fn memory_used_before_leaves_no_trace(volumes in prop::collection::vec(volumes(), 2..7)) {
        let mut workspaces = Workspaces::default();
        for volume in &volumes {
            volume.check(&mut workspaces);
        }
    }
}

proptest! {
    #![proptest_config(random(100))]

    #[test]
    fn no_index_rises_by_more_than_one_in_order(cols in widths(), candidates in 1usize..=40, seed: u64) {
        let (optimizer, penalties) = (Optimizer::DynamicProgramming, Penalties { p1: 0, p2: 0 });
        let volume = Volume::new((1, cols, candidates), 5, optimizer, penalties, seed);
        let found = volume.found(&mut Workspace::<u8>::default(), true, levels()[0], &Control::default());

        let found = found.expect("memory");
        prop_assert!(found.row(0).windows(2).all(|pair| pair[1].chosen <= pair[0].chosen + 1));
    }

    /// Gray values up to the largest, in patches and singly.
    #[test]
    fn edges_are_found_like_by_the_reference(
        (rows, cols, seed) in (1usize..=70, 1usize..=70, any::<u64>()),
        largest in select(vec![0, 1, 5, 255, LARGEST_REACH]),
        threshold in prop_oneof![0.001..3.0f64, Just(1.0), Just(LARGEST_ADAPTIVE)],
    ) {
        let part = |lot: u64| (lot % (2 * u64::from(largest) + 1)) as i32 - largest as i32;
        let side = if seed & 1 == 0 { (4, 5) } else { (1, 1) };
        let gray = Plane::from_fn(rows, cols, |y, x| part(hash(seed, y / side.0, x / side.1)));

        let expected = reference::edges(&gray, threshold);

        for level in levels() {
            let texture = Texture::new(gray.clone());
            let found = Edges::new(&texture, threshold, level, &Control::default()).expect("memory");
            for y in 0..rows {
                prop_assert_eq!(found.row(y), expected.row(y));
            }
        }
    }
}

/// Sizes around every border of bands, panels and runs of candidates.
#[test]
fn sizes_around_every_border() {
    let mut workspaces = Workspaces::default();
    let penalties = Penalties { p1: 20, p2: 70 };

    let heights = [1, 15, 16, 17, 63, 64, 65, 79, 80, 81, 127, 128, 129];
    let widths = [1, 31, 32, 33, 63, 64, 65, 95, 96, 97, 127, 128, 129, 200];
    let sizes = heights.map(|rows| (rows, 5, 7)).into_iter();
    let sizes = sizes.chain(widths.map(|cols| (3, cols, 7))).chain(COUNTS.map(|k| (3, 9, k)));

    for (index, (rows, cols, candidates)) in sizes.chain([(81, 97, 3), (3, 97, 97)]).enumerate() {
        for optimizer in OPTIMIZERS {
            let volume = Volume::new((rows, cols, candidates), 150, optimizer, penalties, index as u64);
            let volume = if index % 4 < 2 { volume.with_gray(1.0, 5) } else { volume };
            let volume = Volume { ranges: (index % 3 > 0).then_some(index as u64), ..volume };
            volume.check(&mut workspaces);
        }
    }
}

/// Costs of 0 or of the largest value, so that totals become as large as possible: up to the limits of bytes
/// and of words, one above, and up to the largest costs with the largest penalties.
#[test]
fn totals_up_to_the_largest_are_exact() {
    let mut workspaces = Workspaces::default();

    let of_bytes = [(255, 0, 0), (200, 55, 55), (200, 55, 10), (200, 0, 55), (1, 254, 254), (0, 255, 255)];
    let of_words = [(65_535, 0, 0), (65_280, 255, 255), (255, 65_280, 65_280), (1, 0, 65_534)];
    let above = [(256, 0, 0), (200, 56, 56), (65_535, 1, 1), (1 << 28, 1 << 28, 1 << 28)];
    let all = of_bytes.into_iter().chain(of_words).chain(above);

    for (index, (largest, p1, p2)) in all.enumerate() {
        let penalties = Penalties { p1, p2 };

        for odds in [1, 2, 8, 1 << 40] {
            let candidates = [1, 2, 3, 33][(index + odds.min(3) as usize) % 4];
            let cost = |y, place| if hash(1, y, place).is_multiple_of(odds) { largest } else { 0 };
            let costs = Plane::from_fn(20, 40 * candidates, cost);

            for optimizer in OPTIMIZERS {
                let costs = costs.clone();
                let volume = Volume { costs, candidates, optimizer, penalties, gray: None, ranges: None };
                let volume = if odds == 2 { volume.with_gray(1.0, 4) } else { volume };
                volume.check(&mut workspaces);
            }
        }
    }
}

/// More runs of candidates than a byte can count.
#[test]
fn the_last_of_the_most_candidates_can_be_chosen() {
    let candidates = MOST_DISPARITIES;
    assert!(candidates > LANES * usize::from(u8::MAX));

    for optimizer in OPTIMIZERS {
        let last = candidates - 1;
        let penalties = Penalties { p1: 1, p2: 1 };

        // Good candidates: the last for the first pixel, the last but one for the second, the first for the
        // third.
        let good = [last, last - 1, 0];
        let cost = |_, place| u32::from(place % candidates != good[place / candidates]) * 9;
        let costs = Plane::from_fn(1, 3 * candidates, cost);

        let volume = Volume { costs, candidates, optimizer, penalties, gray: None, ranges: None };
        let chosen = volume.expected().map(|found| usize::from(found.chosen));
        assert_eq!(chosen.row(0), good, "{optimizer:?}");
        volume.check(&mut Workspaces::default());
    }
}

/// Two pixels whose only path leads from one to the other, by hand.
#[test]
fn a_pixel_is_drawn_to_its_neighbor() {
    let costs = Plane::from_vec(1, 6, vec![0, 9, 9, 4, 9, 3]).expect("two pixels");
    let optimizer = Optimizer::ScanlineOptimization;
    let penalties = Penalties { p1: 1, p2: 4 };

    // The second pixel's totals are 4, 10, 7 from the left and 4, 9, 3 from everywhere else.
    let sums = reference::scanline_optimization(&costs, 3, penalties, None, &|_, _| 0..3);
    assert_eq!(sums.row(0)[3..], [4, 10, 5]);
    let sums = reference::semi_global(&costs, 3, penalties, None, &|_, _| 0..3);
    assert_eq!(sums.row(0)[3..], [4, 10, 4]);

    let volume = Volume { costs, candidates: 3, optimizer, penalties, gray: None, ranges: None };
    let found = volume.expected().row(0)[1];
    assert_eq!((found.chosen, found.best, found.second_best), (0, 4, 5));
    volume.check(&mut Workspaces::default());
}

/// Whether a cost at one pixel affects the choice at another one.
fn is_seen(
    from: (usize, usize),
    there: (usize, usize),
    (rows, cols): (usize, usize),
    optimizer: Optimizer,
) -> bool {
    let is_there = |y, place| (y, place / 4) == there && place % 4 == 0;
    let costs = Plane::from_fn(rows, cols * 4, |y, place| 100 * u32::from(is_there(y, place)));

    let penalties = Penalties { p1: 200, p2: 200 };
    let volume = Volume { costs, candidates: 4, optimizer, penalties, gray: None, ranges: None };

    let found = volume.found(&mut Workspace::<u16>::default(), true, levels()[0], &Control::default());
    found.expect("memory").row(from.0)[from.1].chosen != 0
}

#[test]
fn paths_start_in_the_look_ahead() {
    let size = (3 * BAND, 2);
    let is_seen_in = |from, y| is_seen((from, 1), (y, 1), size, Optimizer::SemiGlobal);

    assert!(is_seen_in(BAND, 2 * BAND + LOOKAHEAD_ROWS - 1), "the last row of the look-ahead");
    assert!(!is_seen_in(2 * BAND - 1, 2 * BAND + LOOKAHEAD_ROWS), "the one below it");
    assert!(is_seen_in(2 * BAND - 1, BAND - LOOKAHEAD_ROWS), "the first row of the look-ahead");
    assert!(!is_seen_in(BAND, BAND - LOOKAHEAD_ROWS - 1), "the one above it");

    for optimizer in [Optimizer::ScanlineOptimization, Optimizer::SemiGlobal] {
        let is_seen_in = |from, x| is_seen((1, from), (1, x), (2, 4 * PANEL), optimizer);
        let beyond = 2 * PANEL + LOOKAHEAD_COLUMNS;

        assert!(is_seen_in(PANEL, beyond - 1), "the last column of the look-ahead");
        assert!(!is_seen_in(2 * PANEL - 1, beyond), "the one right of it");
        assert!(is_seen_in(4 * PANEL - 1, 0), "paths from the left have no limit");
    }
}

#[test]
fn bands_are_those_of_the_whole() {
    let bands = |first, rows| {
        let edges = &Edges::nowhere(1).expect("memory");
        let optimizer = Optimizer::SemiGlobal;
        let (level, control) = (levels()[0], &Control::default());
        let size = (1000, 1);
        let penalties = Penalties::default();
        let (candidates, weighs) = (1, Weighing::All);

        let search = CandidateSearch {
            size,
            first,
            candidates,
            ranges: None,
            optimizer,
            penalties,
            edges,
            weighs,
            level,
            control,
        };

        search.bands(rows).collect::<Vec<_>>()
    };

    assert_eq!(bands(0, 0..130), [0..64, 64..128, 128..130]);
    assert_eq!(bands(63, 0..66), [0..1, 1..65, 65..66]);
    assert_eq!(bands(65, 3..64), [3..63, 63..64]);
    assert_eq!(bands(64, 60..70), [60..64, 64..70]);
    assert_eq!(bands(7, 5..5), []);
}

#[test]
fn a_volume_is_optimized_as_a_whole_on_any_number_of_threads() {
    for optimizer in OPTIMIZERS {
        let mut volume = Volume::new((200, 20, 9), 100, optimizer, Penalties { p1: 10, p2: 60 }, 2);

        let chosen = |volume: &Volume, level| {
            let Volume { costs, candidates, penalties, .. } = volume;
            optimize(costs, *candidates, optimizer, *penalties, level, &Control::default())
        };

        let expected = Ok(volume.expected().map(|found| found.chosen));
        for threads in 1..=8 {
            for level in levels() {
                let found = on_threads(threads, || chosen(&volume, level)).expect("threads");
                assert_eq!(found, expected);
            }
        }
        // All penalties larger than any cost give the same choices.
        volume.costs = volume.costs.map(|cost| cost << 21);
        volume.penalties = Penalties { p1: LARGEST_SUMMED_PENALTY, p2: LARGEST_SUMMED_PENALTY };
        let expected = Ok(volume.expected().map(|found| found.chosen));

        volume.penalties = Penalties { p1: 1 << 40, p2: u64::MAX };
        assert_eq!(chosen(&volume, levels()[0]), expected);

        volume.costs.row_mut(9)[3] = LARGEST_SUMMED_PENALTY as u32 + 1;
        let refused = chosen(&volume, levels()[0]).expect_err("refused").to_string();
        assert_eq!(refused, "costs: got 268435457; accepts costs up to 268435456");
    }
}

#[test]
fn penalties_are_in_units_of_the_mean_cost() {
    let window = Window { rows: 1, cols: 1, candidates: 1, side: 9, ceiling: 14, ..Window::default() };
    let settings = Settings { p1: 0.5, p2: 2.0, ..Preset::Paper.settings() };

    assert_eq!(Penalties::new(&settings, window, 1), Penalties { p1: 41, p2: 162 }, "40.5 is rounded up");
    assert_eq!(Penalties::new(&settings, window, 16), Penalties { p1: 648, p2: 2592 });

    let coarse = Window { dropped: 2, ..window };
    assert_eq!(Penalties::new(&settings, coarse, 1), Penalties { p1: 10, p2: 41 }, "40.5 / 4 and 162 / 4");

    let largest = LARGEST_PENALTY;
    let window = Window { side: 63, ..window };
    let most = Penalties { p1: LARGEST_SUMMED_PENALTY, p2: LARGEST_SUMMED_PENALTY };
    let settings = Settings { p1: largest, p2: largest, ..settings };

    assert_eq!(Penalties::new(&settings, window, 256), most);
}

#[test]
fn a_cancelled_search_stops_and_the_next_one_is_right() {
    let control = Control::default();
    control.cancel();

    for optimizer in OPTIMIZERS {
        let volume = Volume::new((70, 70, 9), 100, optimizer, Penalties { p1: 10, p2: 60 }, 2);
        let mut workspace = Workspace::<u8>::default();
        let level = levels()[0];

        let stopped = volume.found(&mut workspace, true, level, &control);
        assert_eq!(stopped, Err(Error::Cancelled));

        let found = volume.found(&mut workspace, true, level, &Control::default());
        assert_eq!(found, Ok(volume.expected()));

        let stopped = optimize(&volume.costs, 9, optimizer, volume.penalties, level, &control);
        assert_eq!(stopped, Err(Error::Cancelled));
    }
}
