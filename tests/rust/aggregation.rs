//! Windows: sliding sums over lanes against each window summed by itself.

use crate::common::{
    COUNTS, affordable, eight_valid_pairs, hash, heights, levels, mask, naive, random, settings, view,
    volumes, widths,
};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Error;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::base::value::{LANES, Value};
use phasestereo_match::cost::Costs;
use phasestereo_match::cost::aggregation::{Aggregator, PixelBlock, Window, aggregate};
use phasestereo_match::image::view::{Mask, View};
use phasestereo_match::optimization::PANEL;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::pair::candidates::{Candidates, Searched};
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{CostKind, LARGEST_WINDOW, Precision, Settings};
use proptest::prelude::*;

/// Limit on the work of naive windows: pixels x candidates x places.
const AFFORDABLE: usize = 1 << 20;

fn aggregated(costs: &Plane<u16>, window: Window, level: Level) -> Plane<u32> {
    aggregate(costs, window, level, &Control::default()).expect("memory")
}

/// Compares the sums at every level with the reference implementation.
fn check(costs: &Plane<u16>, window: Window) {
    let expected = reference::aggregate(costs, &costs.map(|_| 1), window);

    for level in levels() {
        let found = aggregated(costs, window, level);
        assert!(found == expected, "{} {window:?}", level.name());
    }
}

fn any_costs(window: Window) -> Plane<u16> {
    Plane::from_fn(window.rows, window.cols * window.candidates, |y, place| {
        (hash(7, y, place) % (u64::from(window.ceiling) + 1)) as u16
    })
}

/// Windows over images of any size, up to what the reference implementation has time for.
fn windows() -> impl Strategy<Value = Window> {
    let candidates = prop::sample::select(COUNTS[..9].to_vec());
    let ceiling = prop::sample::select(vec![1u16, 14, 64, 36_720, u16::MAX]);
    (heights(), widths(), candidates, 0usize..=31, any::<bool>(), ceiling, 0u32..6).prop_map(
        |(rows, cols, candidates, radius, shiftable, ceiling, dropped)| {
            let side = affordable(2 * radius + 1, AFFORDABLE / (rows * cols * candidates));
            Window { rows, cols, candidates, side, shiftable, ceiling, dropped }
        },
    )
}

proptest! {
    #![proptest_config(random(128))]

    #[test]
    fn sliding_sums_equal_single_windows(window in windows()) {
        check(&any_costs(window), window);
    }

    #[test]
    fn small_volumes_of_any_values(
        (window, costs) in (1usize..=9, 1usize..=9, 1usize..=4, 0usize..=6, any::<bool>(), 0u32..3)
            .prop_flat_map(|(rows, cols, candidates, radius, shiftable, dropped)| {
                let side = 2 * radius + 1;
                let window =
                    Window { rows, cols, candidates, side, shiftable, ceiling: 3, dropped };
                (Just(window), volumes(rows, cols, candidates, 3))
            }),
    ) {
        check(&costs, window);
    }

    #[test]
    fn bytes_hold_the_sums_of_byte_precision(settings in settings(), ceiling in 1u16..=36_720) {
        let settings = Settings { precision: Precision::Byte, ..settings };

        let side = settings.window as u64;
        let sum = |dropped: u32| side * ((side * u64::from(ceiling)) >> dropped);
        let unit = match settings.cost {
            CostKind::Phase => 1.0,
            CostKind::Sad => 16.0,
            CostKind::NormalizedSad | CostKind::Zncc => 256.0,
        };

        // Two thirds of a byte; one more bit is dropped if P2 fits only then, and at least 80 steps are left.
        let least = (0..64).find(|dropped| sum(*dropped) <= 170).expect("bits");
        let fits = |dropped: u32| {
            let p2 = settings.p2 * (side * side) as f64 * unit / f64::from(1 << dropped);
            sum(dropped) >= 80 && sum(dropped) as f64 + p2.round() <= 255.0
        };
        let expected = if !fits(least) && fits(least + 1) { least + 1 } else { least };

        prop_assert_eq!(Window::new((9, 9), 5, &settings, ceiling).dropped, expected);
    }
}

#[test]
fn every_window_and_larger_ones_than_the_image() {
    for side in (1..=LARGEST_WINDOW).step_by(2) {
        for (shiftable, dropped) in [(true, 3), (false, 0)] {
            let cols = PANEL + 5;
            let window = Window { rows: 35, cols, candidates: 1, side, shiftable, ceiling: 99, dropped };
            check(&any_costs(window), window);

            let window = Window { rows: 2, cols: 3, ..window };
            check(&any_costs(window), window);
        }
    }
}

#[test]
fn every_number_of_candidates_in_rows_of_any_width() {
    let near = [1, 2, 31, 32, 33, 63, 64, 65, 97, 200];
    for (candidates, cols) in COUNTS.into_iter().zip(near.into_iter().cycle()) {
        for (rows, side) in [(1, 5), (33, 3)] {
            let shiftable = true;
            let window = Window { rows, cols, candidates, side, shiftable, ceiling: 14, dropped: 1 };
            check(&any_costs(window), window);
        }
    }
}

#[test]
fn the_largest_costs_do_not_overflow() {
    for shiftable in [true, false] {
        let ceiling = u16::MAX;
        let window = Window { rows: 33, cols: 34, candidates: 1, side: 63, shiftable, ceiling, dropped: 0 };

        let volume = Plane::from_fn(33, 34, |_, _| u16::MAX);
        let sums = aggregated(&volume, window, levels()[0]);
        assert!(sums.as_slice().iter().all(|&sum| sum == 63 * 63 * 65_535));
    }
}

#[test]
fn a_cancelled_sum_stops() {
    let control = Control::default();
    control.cancel();

    let window = Window { rows: 2, cols: 2, candidates: 1, side: 1, ..Window::default() };
    let stopped = aggregate(&any_costs(window), window, levels()[0], &control);
    assert_eq!(stopped, Err(Error::Cancelled));
}

/// A masked pair, its settings, and the rows and columns of the blocks that it is cut into.
#[derive(Debug)]
struct MaskedCosts {
    views: [View; 2],
    candidates: Candidates,
    settings: Settings,
    block: (usize, usize),
}

impl MaskedCosts {
    fn window(&self, ceiling: u16) -> Window {
        let (rows, cols) = self.views[0].size();
        Window::new((rows, cols), self.candidates.count(), &self.settings, ceiling)
    }

    /// Aggregated costs, block after block with the same buffers.
    fn aggregated<V: Value>(&self, costs: &Costs, level: Level) -> Plane<u32> {
        let window = self.window(costs.ceiling());
        let count = self.candidates.count();
        let (high, wide) = self.block;

        let mut result = Plane::new(window.rows, window.cols * count).expect("memory");
        let mut aggregator = Aggregator::<V>::default();

        let places = (0..window.rows).step_by(high);
        for (y, x) in places.flat_map(|y| (0..window.cols).step_by(wide).map(move |x| (y, x))) {
            let rows = y..(y + high).min(window.rows);
            let columns = x..(x + wide).min(window.cols);

            // Strips of one column, of a few, and one of all.
            let strip = [1, 3, columns.len()][(y + x) % 3];
            let block = PixelBlock::new(rows.clone(), columns.clone(), strip);

            // All candidates together, or two overlapping parts of them.
            let middle = (y + x) % count;
            let parts = [0..middle.max(1), middle..count].map(|part| {
                if (y + x) % 2 == 0 {
                    Searched::all(count)
                } else {
                    Searched::holding(part.start, part.end - 1, 1, count)
                }
            });
            assert!(parts[0].start == 0 && parts[1].start <= middle);

            for searched in parts {
                let block = (block.clone(), searched);
                let mut out = vec![[V::truncated(77); LANES]; block.0.places() * searched.runs()];
                aggregator.aggregate(costs, window, block, level, &mut out).expect("memory");

                let pixels: Vec<_> = out.chunks_exact(searched.runs()).map(<[_]>::as_flattened).collect();

                for (y, x) in rows.clone().flat_map(|y| columns.clone().map(move |x| (y, x))) {
                    let (row, col) = (y - rows.start, x - columns.start);
                    let place = (col / strip * rows.len() + row) * (strip + 1) + col % strip;
                    let (sums, beyond) = pixels[place].split_at(searched.count);

                    assert!(beyond.iter().all(|sum| *sum == V::FAR), "beyond the last candidate");
                    let row = &mut result.row_mut(y)[x * count + searched.start..];
                    row.iter_mut().zip(sums).for_each(|(out, sum)| *out = sum.widened() as u32);
                }
            }
        }

        result
    }

    /// Compares all integers that are wide enough with the reference implementation.
    fn check(&self) {
        let views = [&self.views[0], &self.views[1]];
        let (settings, control) = (&self.settings, Control::default());
        let noise = BlurCompensation::of_noise([2.0; 2]).expect("legal noise");
        let noise = Some(&noise);

        let costs = Costs::new(views, self.candidates, settings, noise, levels()[0], &control)
            .expect("not cancelled");

        let window = self.window(costs.ceiling());
        let validity = naive::validity(views, self.candidates);
        let naive = naive::costs(views, self.candidates, settings, noise);
        let expected = reference::aggregate(&naive, &validity, window);
        let largest = window.largest_value(costs.validity().is_some());

        for level in levels() {
            let case = format!("{window:?} {} {:?}", level.name(), self.block);

            assert!(self.aggregated::<u32>(&costs, level) == expected, "u32: {case}");

            if largest <= u16::MAX.into() {
                assert!(self.aggregated::<u16>(&costs, level) == expected, "u16: {case}");
            }

            if largest <= u8::MAX.into() {
                assert!(self.aggregated::<u8>(&costs, level) == expected, "u8: {case}");
            }
        }
    }
}

fn masked_costs() -> impl Strategy<Value = MaskedCosts> {
    let masks = (0u64..=100, any::<u64>());
    let counts = prop_oneof![3 => 1i64..=9, 1 => 31i64..=33];
    let block = (1usize..=70, 1usize..=70);

    (heights(), widths(), settings(), masks, block, -9i64..9, counts).prop_filter_map(
        "too much to do, or out of reach",
        |(rows, cols, settings, (percent, seed), block, min, count)| {
            let work = rows * cols * count as usize * settings.window.pow(2);
            let described = rows * cols * settings.components() * settings.neighborhood.pow(2);

            let candidates = Candidates::new(min, count, cols).ok()?;
            let views = [seed, !seed].map(|seed| {
                let view = view(rows, cols, |y, x| hash(seed, y, x) as u8);
                view.with_mask((seed % 3 > 0).then(|| mask(rows, cols, percent, seed)))
            });

            let affordable = work.max(described) <= AFFORDABLE;
            affordable.then_some(MaskedCosts { views, candidates, settings, block })
        },
    )
}

proptest! {
    #![proptest_config(random(128))]

    #[test]
    fn any_masks_in_any_blocks_of_any_integers(costs in masked_costs()) {
        costs.check();
    }
}

/// Numbers of candidates that fill cache lines, with and without masks and shifted windows.
#[test]
fn lines_of_candidates_and_what_is_left_of_them() {
    for (count, shiftable) in [(64, false), (65, true), (96, true), (97, false), (140, false)] {
        let (rows, cols) = (7, 140);
        let views = [1u64, 2].map(|seed| {
            let view = view(rows, cols, |y, x| hash(seed, y, x) as u8);
            view.with_mask((seed as i64 == count % 4).then(|| mask(rows, cols, 3, seed)))
        });

        let candidates = Candidates::new(0, count, cols).expect("in reach");
        let settings = Settings { shiftable, window: 5, ..Preset::Fast.settings() };
        MaskedCosts { views, candidates, settings, block: (5, PANEL) }.check();
    }
}

/// Borders that are all that some lines of candidates see: upright, slanted, and across all of a block's
/// rows.
#[test]
fn borders_of_every_shape_under_lines_of_candidates() {
    for (count, shiftable, slope) in [(140, false, 0), (140, true, 1), (70, false, 2), (65, true, 3)] {
        let (rows, cols) = (13, 180);
        let views = [3u64, 4].map(|seed| {
            let view = view(rows, cols, |y, x| hash(seed, y, x) as u8);
            let is_inside = |y, x| x >= 10 + slope * y && x + 4 < cols && (y < 11 || seed == 3);
            view.with_mask(Some(Mask::from_fn(rows, cols, is_inside)))
        });

        let candidates = Candidates::new(-9, count, cols).expect("in reach");
        let settings = Settings { shiftable, window: 5, ..Preset::Fast.settings() };
        MaskedCosts { views, candidates, settings, block: (5, PANEL) }.check();
    }
}

/// The mean of a few valid pixels may exceed the largest sum of a window, since bits are dropped from that.
#[test]
fn few_valid_pixels_do_not_overflow_a_byte() {
    MaskedCosts {
        views: eight_valid_pairs(),
        candidates: Candidates::new(0, 4, 42).expect("in reach"),
        settings: Settings {
            frequencies: (3, 2),
            bits: 1,
            window: 11,
            precision: Precision::Byte,
            ..Preset::Paper.settings()
        },
        block: (11, 42),
    }
    .check();
}
