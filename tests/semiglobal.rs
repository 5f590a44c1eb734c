//! Paths through the image: bands in lanes of narrow integers, parts of columns on threads, against every path
//! by itself.

mod common;

use common::volumes::{Search, Volume};
use common::{hash, levels};
use phasestereo::control::Control;
use phasestereo::edges::Edges;
use phasestereo::error::Error;
use phasestereo::intensity::LARGEST_REACH;
use phasestereo::plane::Plane;
use phasestereo::reference::{self, Found};
use phasestereo::scanline::Steps;
use phasestereo::semiglobal::{BAND, LOOK, optimize};
use phasestereo::settings::LARGEST_EDGES;
use phasestereo::texture::Texture;
use phasestereo::value::Value;
use proptest::prelude::*;
use proptest::sample::select;

/// Numbers of candidates: none to choose from, none elsewhere, and more.
const COUNTS: [usize; 6] = [1, 2, 3, 7, 16, 33];
/// Values of a volume that the twin has time for.
const AFFORDABLE: usize = 60_000;

/// Memory of searches in integers of every width.
#[derive(Default)]
struct Searches {
    bytes: Search<u8, u8>,
    byte_costs: Search<u8, u32>,
    word_costs: Search<u16, u32>,
    widest: Search<u32, u64>,
}

impl Searches {
    /// Holds all integers that are wide enough for a volume to the twin, at every level and on every number of
    /// threads.
    fn check(&mut self, volume: &Volume, threads: &[usize]) {
        let expected = volume.expected();
        for &threads in threads {
            self.check_on(volume, &expected, threads);
        }
    }

    fn check_on(&mut self, volume: &Volume, expected: &Plane<Found>, threads: usize) {
        let Self { bytes, byte_costs, word_costs, widest } = self;
        let largest = volume.costs.as_slice().iter().max().map_or(0, |cost| u64::from(*cost));
        let total = largest + volume.steps.largest_change();
        check_in(volume, expected, threads, widest);
        if largest <= u16::MAX.into() && total <= u32::LARGEST_TOTAL {
            check_in(volume, expected, threads, word_costs);
        }
        if largest <= u8::MAX.into() && total <= u32::LARGEST_TOTAL {
            check_in(volume, expected, threads, byte_costs);
        }
        if total <= u8::LARGEST_TOTAL {
            check_in(volume, expected, threads, bytes);
        }
    }
}

fn check_in<V: Value, T: Value>(
    volume: &Volume,
    expected: &Plane<Found>,
    threads: usize,
    search: &mut Search<V, T>,
) {
    for level in levels() {
        let control = Control::default();
        let found = volume.found(search, level, threads, &control).expect("memory");
        assert_eq!(control.rows_done(), volume.size().0);
        let pairs = found.as_slice().iter().zip(expected.as_slice());
        let wrong = pairs.enumerate().find(|(_, (found, expected))| found != expected);
        assert!(
            wrong.is_none(),
            "{:?} of {:?}, {} candidates, {:?}, edges {}, {}, {threads} threads, {} and {} bits",
            wrong,
            volume.size(),
            volume.candidates,
            volume.steps,
            volume.gray.is_some(),
            level.name(),
            V::BITS,
            T::BITS,
        );
    }
}

/// Costs without any structure, or of patches of one disparity with some noise.
fn volume(
    (rows, cols, candidates): (usize, usize, usize),
    largest: u64,
    steps: Steps,
    seed: u64,
) -> Volume {
    let is_scene = seed & 1 == 0;
    let costs = Plane::from_fn(rows, cols * candidates, |y, place| {
        let (x, k) = (place / candidates, place % candidates);
        let truth = hash(seed, y / 9, x / 11) as usize % candidates;
        let noise = hash(!seed, y, place) % (largest + 1);
        let ramp = largest / 4 * k.abs_diff(truth) as u64 + noise / 4;
        if is_scene { ramp.min(largest) as u32 } else { noise as u32 }
    });
    Volume { costs, candidates, steps, gray: None }
}

/// Gray values of patches, with some noise: jumps of every size.
fn gray(rows: usize, cols: usize, seed: u64) -> Plane<i32> {
    Plane::from_fn(rows, cols, |y, x| {
        (hash(seed, y / 5, x / 7) % 200) as i32 + (hash(!seed, y, x) % 30) as i32
    })
}

/// About the rows of one band, or two, or three, and about as many as are looked at below them.
fn heights() -> impl Strategy<Value = usize> {
    let near = |rows| [rows - 1, rows, rows + 1];
    let awkward = [LOOK, BAND, BAND + LOOK, 2 * BAND, 3 * BAND].map(near).as_flattened().to_vec();
    prop_oneof![1 => 1usize..=100, 2 => select(awkward)]
}

/// About as many columns as one group has, or several, of which threads then take parts.
fn widths() -> impl Strategy<Value = usize> {
    let awkward = vec![1, 2, 31, 32, 33, 63, 64, 65, 191, 192, 193, 200];
    prop_oneof![1 => 1usize..=200, 1 => select(awkward)]
}

/// Largest costs, and penalties from none to more than any cost; many of which bytes have room for.
fn scales() -> impl Strategy<Value = (u64, Steps)> {
    let largest = select(vec![0, 1, 3, 20, 100, 200, 255, 65_535, u64::from(u32::MAX)]);
    largest.prop_flat_map(|largest| {
        let room = 255u64.saturating_sub(largest);
        let one = move || {
            prop_oneof![
                2 => Just(0),
                3 => 0..=room,
                1 => Just(room),
                1 => 0..=largest,
                1 => Just(1u64 << 40)
            ]
        };
        (Just(largest), one(), one(), any::<bool>()).prop_map(|(largest, near, far, is_one)| {
            (largest, Steps { near, far: if is_one { near } else { far } })
        })
    })
}

fn volumes() -> impl Strategy<Value = Volume> {
    let size = (heights(), widths(), select(COUNTS.to_vec()));
    let threshold = prop_oneof![3 => 0.05..3.0f64, 1 => Just(LARGEST_EDGES)];
    (size, scales(), prop::option::of(threshold), any::<u64>()).prop_map(
        |((rows, cols, candidates), (largest, steps), threshold, seed)| {
            let rows = rows.min((AFFORDABLE / (cols * candidates)).max(BAND + LOOK + 1));
            let gray = threshold.map(|threshold| (gray(rows, cols, seed), threshold));
            Volume { gray, ..volume((rows, cols, candidates), largest, steps, seed) }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { max_shrink_iters: 200, ..ProptestConfig::with_cases(100) })]

    #[test]
    fn every_pixel_is_as_by_single_paths(volume in volumes(), threads in 1usize..=5) {
        Searches::default().check(&volume, &[threads]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { max_shrink_iters: 50, ..ProptestConfig::with_cases(12) })]

    #[test]
    fn memory_used_before_leaves_no_trace(
        volumes in prop::collection::vec(volumes(), 2..5),
        threads in prop::collection::vec(1usize..=5, 5),
    ) {
        let mut searches = Searches::default();
        for (volume, &threads) in volumes.iter().zip(&threads) {
            searches.check(volume, &[threads]);
        }
    }
}

/// Gray values from one to the largest, in patches and singly.
fn grays() -> impl Strategy<Value = Plane<i32>> {
    let largest = select(vec![0, 1, 5, 255, LARGEST_REACH]);
    (1usize..=70, 1usize..=70, largest, any::<u64>()).prop_map(|(rows, cols, largest, seed)| {
        let part = |lot: u64| (lot % (2 * u64::from(largest) + 1)) as i32 - largest as i32;
        let is_patchy = seed & 1 == 0;
        Plane::from_fn(rows, cols, |y, x| {
            if is_patchy { part(hash(seed, y / 4, x / 5)) } else { part(hash(seed, y, x)) }
        })
    })
}

proptest! {
    #[test]
    fn edges_are_found_like_by_the_twin(
        gray in grays(),
        threshold in prop_oneof![0.001..3.0f64, Just(1.0), Just(LARGEST_EDGES)],
    ) {
        let expected = reference::edges(&gray, threshold);
        for level in levels() {
            let found = Edges::new(&Texture::new(gray.clone()), threshold, level, &Control::default()).expect("memory");
            for y in 0..gray.rows() {
                prop_assert_eq!(found.row(y), expected.row(y));
            }
        }
    }
}

/// In single rows and columns, about every border of bands and groups, on every number of threads.
#[test]
fn sizes_about_every_border() {
    let mut searches = Searches::default();
    let steps = Steps { near: 20, far: 70 };
    for (rows, cols) in
        [(1, 1), (1, 200), (100, 1), (31, 32), (32, 33), (33, 31), (64, 64), (65, 65)]
    {
        for candidates in COUNTS {
            let seed = (rows * cols + candidates) as u64;
            let gray = Some((gray(rows, cols, seed), 1.0));
            let plain = volume((rows, cols, candidates), 150, steps, seed);
            searches.check(&Volume { gray, ..plain.clone() }, &[1, 3]);
            searches.check(&plain, &[2]);
        }
    }
}

/// Groups enough for a part of its own for each of five threads, and so for all of their borders.
#[test]
fn every_number_of_threads_gives_the_same_bits() {
    let mut searches = Searches::default();
    for (rows, cols) in [(97, 32 * 30 + 5), (129, 32 * 13), (40, 32 * 31 - 1)] {
        let gray = Some((gray(rows, cols, 3), 1.0));
        for (near, far) in [(0, 5), (90, 90)] {
            let volume = volume((rows, cols, 3), 120, Steps { near, far }, 8);
            let volume = Volume { gray: gray.clone(), ..volume };
            searches.check(&volume, &[1, 2, 3, 4, 5]);
        }
    }
}

/// At the very limit of bytes: what lies one above it is for words.
#[test]
fn totals_up_to_the_largest_byte_are_exact() {
    let mut searches = Searches::default();
    for (largest, near, far) in
        [(255, 0, 0), (200, 55, 55), (200, 55, 10), (200, 0, 55), (1, 254, 254), (0, 255, 255)]
    {
        let steps = Steps { near, far };
        // Costs of nothing or of all there is: totals come as far as they can.
        for odds in [1, 2, 8, 1 << 40] {
            for candidates in [1, 2, 3, 9] {
                let cost = |y, place| {
                    if hash(1, y, place).is_multiple_of(odds) { largest as u32 } else { 0 }
                };
                let costs = Plane::from_fn(50, 40 * candidates, cost);
                let gray = (odds == 2).then(|| (gray(50, 40, 4), 1.0));
                searches.check(&Volume { costs, candidates, steps, gray }, &[2]);
            }
        }
    }
}

/// At the very limit of 32 bits and beyond it, where costs have their largest value.
#[test]
fn totals_up_to_the_largest_word_are_exact() {
    let mut searches = Searches::default();
    let most = u32::LARGEST_TOTAL - 65_535;
    for (near, far) in [(most, most), (0, most), (most, 0), (1 << 40, 1 << 40)] {
        for largest in [65_535, u32::MAX.into()] {
            searches.check(&volume((40, 40, 5), largest, Steps { near, far }, 3), &[1]);
        }
    }
}

#[test]
fn costs_of_nobody_choose_the_first() {
    let costs = Plane::from_fn(3, 4 * 5, |_, _| 7);
    let volume = Volume { costs, candidates: 5, steps: Steps { near: 1, far: 2 }, gray: None };
    let found = volume.expected();
    assert!(found.as_slice().iter().all(|found| found.chosen == 0));
    Searches::default().check(&volume, &[1]);
}

/// Two pixels whose one path leads from one to the other, by hand.
#[test]
fn a_pixel_is_drawn_to_its_neighbour() {
    let costs = Plane::from_vec(1, 6, vec![0, 9, 9, 4, 9, 3]).expect("two pixels");
    let steps = Steps { near: 1, far: 2 };
    let volume = Volume { costs: costs.clone(), candidates: 3, steps, gray: None };
    // Along the row the second pixel's totals are 4, 10, 5 from the left and 4, 9, 3 from the right: twice their
    // means, rounded up, and six times what it costs by itself.
    let sums = reference::semi_global(&costs, 3, steps, None);
    let expected = [2 * 4 + 3 * 4 + 4 * 3, 2 * 10 + 3 * 9 + 4 * 7, 2 * 4 + 3 * 3 + 4 * 2];
    assert_eq!(sums.row(0)[3..], expected);
    let found = volume.expected().row(0)[1];
    assert_eq!((found.chosen, found.own, found.elsewhere), (2, 25, 32));
    Searches::default().check(&volume, &[1]);
}

/// What is seen from a band of what is below it, and from where on nothing is.
#[test]
fn paths_from_below_begin_some_rows_below_the_band() {
    let changed = |y: usize| {
        let cost = |row, place| u32::from(row == y) * u32::from(place % 2 == 0) * 100;
        let costs = Plane::from_fn(2 * BAND + LOOK, 6, cost);
        let steps = Steps { near: 200, far: 200 };
        let sums = reference::semi_global(&costs, 2, steps, None);
        sums.row(BAND - 1).iter().any(|&sum| sum > 0)
    };
    assert!(changed(BAND + LOOK - 1), "the last row that is looked at");
    assert!(!changed(BAND + LOOK), "the one below it");
    assert!(changed(0), "any row above");
}

#[test]
fn a_volume_is_optimized_as_a_whole() {
    let volume = volume((70, 45, 9), 100, Steps { near: 10, far: 60 }, 2);
    let (expected, control) = (volume.expected().map(|found| found.chosen), Control::default());
    for level in levels() {
        let found = optimize(&volume.costs, 9, volume.steps, None, level, &control);
        assert_eq!(found.as_ref(), Ok(&expected));
    }
}

#[test]
fn a_cancelled_search_stops_and_the_next_one_is_right() {
    let volume = volume((70, 45, 9), 100, Steps { near: 10, far: 60 }, 2);
    let (mut search, control) = (Search::<u8, u8>::default(), Control::default());
    control.cancel();
    for threads in [1, 2, 5] {
        let stopped = volume.found(&mut search, levels()[0], threads, &control);
        assert_eq!(stopped, Err(Error::Cancelled));
        let found = volume.found(&mut search, levels()[0], threads, &Control::default());
        assert_eq!(found, Ok(volume.expected()));
    }
    let stopped = optimize(&volume.costs, 9, volume.steps, None, levels()[0], &control);
    assert_eq!(stopped, Err(Error::Cancelled));
}
