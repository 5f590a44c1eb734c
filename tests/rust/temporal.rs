//! The temporal filter, compared with its recurrence, pixel by pixel.

use crate::common::maps::bits;
use crate::common::{at_every_level, gray_of, hash, levels, mask, random, view, with_runtime};
use ndarray::Array3;
use phasestereo::internals::video::choices::{
    CHANGE_RATIO, CHANGE_STEP, LARGEST_SQUARE, LEAST_NOISE, MEAN_FRAMES, MOST_NOISE, NOISE_BLOCK,
    NOISE_BLOCKS, NOISE_FACTOR, QUIET_DIVISOR,
};
use phasestereo::internals::video::temporal::TemporalFilter;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Error;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::{Disparity, Timings, on_threads};
use phasestereo_match::pair::Pair;
use phasestereo_match::settings::Settings;
use phasestereo_match::settings::presets::Preset;
use proptest::prelude::*;

/// A frame to filter.
#[derive(Debug, Clone)]
struct Frame {
    pair: Pair,
    map: Disparity,
}

/// The result of a frame: bits of disparities, flags, bits of confidences and of error bars, support.
type Seen = (Vec<u32>, Vec<u16>, [Option<Vec<u32>>; 2], Vec<u8>);

fn seen(map: &Disparity, support: &Plane<u8>) -> Seen {
    let bits_of = |plane: &Option<Plane<f32>>| plane.as_ref().map(|plane| bits(plane).into_vec());
    (
        bits(&map.disparity).into_vec(),
        map.flags.as_slice().to_vec(),
        [bits_of(&map.confidence), bits_of(&map.uncertainty)],
        support.as_slice().to_vec(),
    )
}

fn map(disparity: Plane<f32>, flags: Plane<u16>, confidence: Option<Plane<f32>>) -> Disparity {
    let timings = Timings::default();
    // Separate bars, which differ from the confidences.
    let uncertainty = confidence.as_ref().map(|plane| plane.map(|value| 3.0 - value));
    Disparity { disparity, flags, confidence, uncertainty, wrong: None, detail: None, timings }
}

/// The result of the filter for a sequence.
fn filtered(frames: &[Frame], level: Level) -> Vec<Seen> {
    let mut filter = TemporalFilter::new();
    with_runtime(1, level, |runtime| {
        let next = |frame: &Frame| {
            let (mut map, settings) = (frame.map.clone(), Settings::default());
            let support = filter.apply(&frame.pair, &settings, &mut map, runtime);
            seen(&map, &support.expect("not cancelled"))
        };

        frames.iter().map(next).collect()
    })
}

/// Frames of a scene in which tiles change now and then, with noise, of any type of pixels.
fn sequence((rows, cols): (usize, usize), kind: u8, seed: u64) -> Vec<Frame> {
    let is_masked = seed & 8 != 0;
    let (has_confidence, channels) = (seed & 16 != 0, if seed & 32 != 0 { 3 } else { 1 });
    let state = |time: u64, salt: u64, y: usize, x: usize| {
        (0..=time).rev().find(|time| hash(seed ^ salt ^ *time << 8, y / 6, x / 6).is_multiple_of(4))
    };

    let pixel = |time: u64, salt: u64, (y, x, c): (usize, usize, usize)| {
        let tile = hash(state(time, salt, y, x).unwrap_or(99), y / 6, x / 6) % 160;
        let gray = 20 + tile + hash(seed ^ salt ^ (time + 1) << 16, y, 3 * x + c) % 8;
        // The first frames are exposed differently.
        gray * [100, 140, 70].get(time as usize).unwrap_or(&100) / 100
    };

    let image = |time: u64, salt: u64| {
        let values = Array3::from_shape_fn((rows, cols, channels), |at| pixel(time, salt, at));
        match kind {
            0 => Image::U8(values.mapv(|value| value as u8)),
            1 => Image::U16(values.mapv(|value| 200 * value as u16 + 1)),
            2 => Image::F32(values.mapv(|value| (value as f32).sqrt())),
            _ => Image::F64(values.mapv(|value| (value as f64).sqrt() * 1e6 - 3e7)),
        }
    };

    let camera = |time: u64, salt: u64| {
        let seed = seed ^ salt ^ (time / 2);
        let mask = is_masked.then(|| mask(rows, cols, 90, seed));
        gray_of(Input { mask, ..image(time, salt).into() })
    };

    let disparity = |time: u64, y: usize, x: usize| match hash(seed ^ time << 24, y, x) % 16 {
        0 => f32::NAN,
        1 => 40.0,
        2 => -2.5,
        other => 3.0 + (hash(seed, y / 4, x / 4) % 3) as f32 + other as f32 / 16.0,
    };

    let frame = |time: u64| Frame {
        pair: Pair::new(camera(time, 1), camera(time, 2), 0, 1).expect("a legal pair"),
        map: map(
            Plane::from_fn(rows, cols, |y, x| disparity(time, y, x)),
            Plane::from_fn(rows, cols, |y, x| hash(seed ^ time, y, x) as u16),
            has_confidence
                .then(|| Plane::from_fn(rows, cols, |y, x| (hash(!time, y, x) % 101) as f32 / 100.0)),
        ),
    };

    (0..12).map(frame).collect()
}

/// The reference implementation: a view.
#[derive(Default)]
struct NaiveView {
    scale: Option<(f64, f64)>,
    /// Mean and count of each pixel.
    before: Vec<(f32, u8)>,
}

impl NaiveView {
    /// Whether the place of each pixel has changed in the next frame.
    fn changed(&mut self, view: &View) -> Vec<bool> {
        let ((rows, cols), scale) = (view.size(), view.scale());
        let (black, factor) = *self.scale.get_or_insert_with(|| {
            let width = if scale.width() > 0.0 { scale.width() } else { 1.0 };
            (scale.pixel(scale.range()[0].into()), 255.0 / width)
        });
        // The range is that of the first frame, but each frame has its own steps.
        let (black, factor) = ((scale.pixel(0.0) - black) * factor, factor / scale.steps(1.0));
        let (black, factor) = (black as f32, factor as f32);

        let gray = |y: usize, x: usize| {
            let value = view.gray().row(y)[x] as f32 * factor + black;
            if view.is_valid(y, x) { value } else { f32::NAN }
        };

        if self.before.is_empty() {
            self.before = vec![(0.0, 0); rows.div_ceil(CHANGE_STEP) * cols.div_ceil(CHANGE_STEP)];
        }

        let (before, inverse) = (self.before.clone(), 1.0 / noise((rows, cols), gray));
        let (image_rows, image_cols, gray) = (rows, cols, |y, x| gray(CHANGE_STEP * y, CHANGE_STEP * x));
        let (rows, cols) = (rows.div_ceil(CHANGE_STEP), cols.div_ceil(CHANGE_STEP));

        let places = (0..rows * cols).map(|index| (index / cols, index % cols));
        let sampled = places.filter(|(y, x)| y % 4 == 0 && x % 4 == 0);
        let quotient = |(y, x): (usize, usize)| {
            let (now, (mean, count)) = (gray(y, x), before[y * cols + x]);
            let is_clear = |value: f32| (24.0..250.0).contains(&value);
            (count > 0 && is_clear(now) && is_clear(mean)).then(|| now / mean)
        };
        let gain = gain(sampled.filter_map(quotient).collect());

        let excess = |y: isize, x: isize| {
            let inside = (0..rows as isize).contains(&y) && (0..cols as isize).contains(&x);
            let Some((y, x)) = inside.then_some((y as usize, x as usize)) else { return 0.0 };
            let (mean, count) = before[y * cols + x];
            let (now, then) = (gray(y, x), gain * mean);
            // The brighter of both may have been brighter than white.
            let is_white = if now > then { mean >= 250.0 } else { now >= 250.0 };
            let difference = if is_white { 0.0 } else { now - then };
            if count == 0 || gray(y, x).is_nan() {
                return 0.0;
            }
            let square = (difference * difference * inverse).min(LARGEST_SQUARE);
            square - (CHANGE_RATIO + CHANGE_RATIO / f32::from(count))
        };

        let next = |index: usize| {
            let (y, x) = (index / cols, index % cols);
            let column = |x: isize| {
                let y = y as isize;
                excess(y - 1, x) + excess(y, x) + excess(y + 1, x)
            };
            let sum = column(x as isize - 1) + column(x as isize) + column(x as isize + 1);
            let (new, (mean, count)) = (gray(y, x), before[index]);
            match (new.is_nan(), sum > 0.0 || count == 0) {
                (true, _) => ((0.0, 0), true),
                (false, true) => ((new, 1), true),
                (false, false) => {
                    let count = MEAN_FRAMES.min(count + 1);
                    let then = gain * mean;
                    ((then + (new - then) / f32::from(count), count), false)
                }
            }
        };
        let (now, changed): (_, Vec<bool>) = (0..rows * cols).map(next).unzip();
        self.before = now;
        let pixels = (0..image_rows).flat_map(|y| (0..image_cols).map(move |x| (y, x)));
        pixels.map(|(y, x)| changed[y / CHANGE_STEP * cols + x / CHANGE_STEP]).collect()
    }
}

/// The reference implementation of the change of the exposure.
fn gain(mut quotients: Vec<f32>) -> f32 {
    quotients.sort_by(f32::total_cmp);
    let quarter = |number: usize| quotients[quotients.len() * number / 4];
    match quotients.len() {
        0..64 => 1.0,
        _ if quarter(3) - quarter(1) > 0.15 * quarter(2) => 1.0,
        _ if (quarter(2) - 1.0).abs() < 0.01 => 1.0,
        _ => quarter(2),
    }
}

/// The reference implementation of the variance of the noise.
fn noise((rows, cols): (usize, usize), gray: impl Fn(usize, usize) -> f32) -> f32 {
    let (down, across) = (rows.saturating_sub(2) / NOISE_BLOCK, cols.saturating_sub(2) / NOISE_BLOCK);
    let step = (down * across).div_ceil(NOISE_BLOCKS).max(1);
    let second = |y: usize, x: usize| {
        let column = |x: usize| gray(y - 1, x) + gray(y + 1, x) - 2.0 * gray(y, x);
        (column(x - 1) + column(x + 1) - 2.0 * column(x)) / 6.0
    };
    let mut squares = vec![];
    for top in (0..down).step_by(step) {
        for left in 0..across {
            let column = |x: usize| {
                let rows = top * NOISE_BLOCK..(top + 1) * NOISE_BLOCK;
                rows.map(|y| second(y + 1, x + 1).powi(2)).sum::<f32>()
            };
            let columns = left * NOISE_BLOCK..(left + 1) * NOISE_BLOCK;
            squares.push(columns.map(column).sum::<f32>() / (NOISE_BLOCK * NOISE_BLOCK) as f32);
        }
    }
    squares.retain(|square| !square.is_nan());
    squares.sort_by(f32::total_cmp);
    let (least, most) = (LEAST_NOISE.powi(2), MOST_NOISE.powi(2));
    let quiet = squares.get(squares.len() / QUIET_DIVISOR);
    quiet.map_or(least, |square| (square * NOISE_FACTOR).clamp(least, most))
}

/// The reference implementation: whether the block of a pixel has moved.
fn has_moved(maps: [&Plane<f32>; 2], support: &Plane<u8>, (y, x): (usize, usize)) -> bool {
    let mut differences = vec![];
    for row in (0..support.rows()).filter(|row| row / 32 == y / 32 && row % 4 == 0) {
        for col in (0..support.cols()).filter(|col| col / 32 == x / 32 && col % 4 == 0) {
            let by = maps[0].row(row)[col] - maps[1].row(row)[col];
            if support.row(row)[col] > 0 && !by.is_nan() {
                differences.push(by);
            }
        }
    }
    let share = |sign: f32| {
        let moved = differences.iter().filter(|by| **by * sign > 0.25 && **by * sign <= 2.0);
        moved.count() as f64 / differences.len() as f64
    };
    differences.len() >= 16 && share(1.0).max(share(-1.0)) > 2.0 / 3.0
}

/// The reference implementation: a sequence.
fn expected(frames: &[Frame]) -> Vec<Seen> {
    let mut views = [NaiveView::default(), NaiveView::default()];
    let mut before: Option<(Disparity, Plane<u8>)> = None;
    let next = |frame: &Frame| {
        let [left, right] = frame.pair.views();
        let changed = [views[0].changed(left), views[1].changed(right)];
        let none = (frame.map.clone(), Plane::from_fn(0, 0, |_, _| 0));
        let (old, frames) = before.take().unwrap_or(none);
        let (rows, cols) = frame.pair.size();
        let (mut map, mut support) = (frame.map.clone(), Plane::from_fn(rows, cols, |_, _| 1));
        for y in (0..rows).filter(|_| frames.rows() > 0) {
            for x in 0..cols {
                let (new, was, count) = (map.disparity.row(y)[x], old.disparity.row(y)[x], frames.row(y)[x]);
                let seen = |disparity: f32| {
                    let place = (x as f32 - disparity).round_ties_even();
                    let is_inside = place >= 0.0 && place < cols as f32;
                    !is_inside || !changed[1][y * cols + place as usize]
                };
                if changed[0][y * cols + x] || !seen(new) || !seen(was) {
                    continue;
                }
                if has_moved([&frame.map.disparity, &old.disparity], &frames, (y, x)) {
                    continue;
                }
                if new.is_nan() && was.is_nan() {
                    support.row_mut(y)[x] = MEAN_FRAMES.min(count + 1);
                } else if (new - was).abs() <= 1.0 {
                    let more = MEAN_FRAMES.min(count + 1);
                    support.row_mut(y)[x] = more;
                    map.disparity.row_mut(y)[x] = was + (new - was) / f32::from(more);
                } else if count > 1 {
                    support.row_mut(y)[x] = count - 1;
                    map.disparity.row_mut(y)[x] = was;
                    map.flags.row_mut(y)[x] = old.flags.row(y)[x];
                    if let (Some(now), Some(old)) = (&mut map.confidence, &old.confidence) {
                        now.row_mut(y)[x] = old.row(y)[x];
                    }
                    if let (Some(now), Some(old)) = (&mut map.uncertainty, &old.uncertainty) {
                        now.row_mut(y)[x] = old.row(y)[x];
                    }
                }
            }
        }
        let found = seen(&map, &support);
        before = Some((map, support));
        found
    };

    frames.iter().map(next).collect()
}

proptest! {
    #![proptest_config(random(48))]

    #[test]
    fn sequences_are_filtered_like_by_the_reference(
        rows in 1usize..=40,
        cols in 1usize..=70,
        kind in 0u8..4,
        seed: u64,
    ) {
        let frames = sequence((rows, cols), kind, seed);
        prop_assert_eq!(at_every_level(|level| filtered(&frames, level)), expected(&frames));
    }
}

#[test]
fn a_video_one_column_wide_is_filtered() {
    let frames = sequence((12, 1), 0, 3);
    assert_eq!(at_every_level(|level| filtered(&frames, level)), expected(&frames));
}

#[test]
fn the_sequences_have_all_that_may_happen() {
    let found = expected(&sequence((40, 70), 0, 5));
    let (_, _, _, last) = found.last().expect("frames");
    assert!((1..=MEAN_FRAMES).all(|count| last.contains(&count)), "every count");
}

#[test]
fn the_result_does_not_depend_on_threads_and_large_images_are_sampled() {
    // More than enough blocks, and rows for many bands.
    let (frames, level) = (sequence((330, 300), 0, 40), levels()[0]);
    let on = |threads| on_threads(threads, || filtered(&frames[..3], level)).expect("threads");
    let one = on(1);
    assert_eq!(one, expected(&frames[..3]));
    assert_eq!(one, on(3));
}

/// A frame of a scene whose pixels are slightly off by `noise`, with one disparity in every other four rows,
/// including the middle ones, and 4 in those between.
fn still(shift: usize, noise: u64, disparity: f32, size: (usize, usize)) -> Frame {
    let pixel = |seed, y, x| {
        let scene = hash(7, y / 9, (x + shift) / 9) % 180;
        (20 + scene + hash(noise ^ seed, y, x) % 5) as u8
    };
    let camera = |seed| view(size.0, size.1, |y, x| pixel(seed, y, x));
    let at = |y: usize| if y / 4 % 2 == 1 { disparity } else { 4.0 };
    let flags = Plane::from_fn(size.0, size.1, |y, _| at(y) as u16);
    let found = Plane::from_fn(size.0, size.1, |y, _| at(y));
    let pair = Pair::new(camera(1 << 40), camera(2 << 40), 0, 16).expect("a legal pair");
    Frame { pair, map: map(found, flags, None) }
}

const SIZE: (usize, usize) = (30, 50);

/// The disparity, flags and support in the middle of each frame.
fn in_the_middle(frames: &[Frame]) -> Vec<(f32, u16, u8)> {
    let at = SIZE.0 / 2 * SIZE.1 + SIZE.1 / 2;
    let of = |(disparity, flags, _, support): Seen| (f32::from_bits(disparity[at]), flags[at], support[at]);
    filtered(frames, Level::best()).into_iter().map(of).collect()
}

#[test]
fn what_stands_still_gets_the_mean_and_an_outlier_is_outvoted() {
    let drawn = [4.0, 5.0, 4.5, 9.0, 4.5];
    let frames = (1..).zip(drawn).map(|(time, drawn)| still(0, time, drawn, SIZE));
    let found = in_the_middle(&frames.collect::<Vec<_>>());
    assert_eq!(found, [(4.0, 4, 1), (4.5, 5, 2), (4.5, 4, 3), (4.5, 4, 2), (4.5, 4, 3)]);
}

#[test]
fn a_majority_of_other_disparities_takes_over() {
    let drawn = [4.0, 4.0, 9.0, 9.0, 9.0];
    let frames = (1..).zip(drawn).map(|(time, drawn)| still(0, time, drawn, SIZE));
    let found = in_the_middle(&frames.collect::<Vec<_>>());
    assert_eq!(found, [(4.0, 4, 1), (4.0, 4, 2), (4.0, 4, 1), (9.0, 9, 1), (9.0, 9, 2)]);
}

#[test]
fn what_moves_together_begins_anew() {
    let frame = |time: u64| {
        let mut frame = still(0, time, 4.0, SIZE);
        let disparity = 4.0 + 0.5 * time as f32;
        frame.map.disparity = Plane::from_fn(SIZE.0, SIZE.1, |_, _| disparity);
        frame
    };
    let found = in_the_middle(&(1..4).map(frame).collect::<Vec<_>>());
    assert_eq!(found, [(4.5, 4, 1), (5.0, 4, 1), (5.5, 4, 1)]);
}

#[test]
fn another_exposure_is_no_change() {
    let exposed = |time: u64, percent: i32| {
        let frame = still(0, time, 4.0, (80, 90));
        let views = frame.pair.views().map(|view| {
            let pixel = |gray: &i32| ((gray + 128) * percent / 100).min(255) - 128;
            View::new(view.gray().map(pixel), None, view.scale())
        });
        Frame { pair: frame.pair.with_views(views), ..frame }
    };
    let found = filtered(&[exposed(1, 100), exposed(2, 130), exposed(3, 60)], Level::best());
    let steady: usize = found[2].3.iter().map(|count| usize::from(*count == 3)).sum();
    assert!(steady * 100 > 95 * found[2].3.len(), "{steady}");
}

#[test]
fn a_cut_is_a_new_beginning() {
    let frames = [still(0, 1, 4.0, SIZE), still(0, 2, 4.0, SIZE), still(500, 3, 4.5, SIZE)];
    let found = filtered(&frames, Level::best());
    assert!(found[1].3.iter().all(|count| *count == 2));
    let own = frames[2].map.disparity.as_slice();
    let as_it_is = found[2].0.iter().zip(own).filter(|(bits, own)| **bits == own.to_bits());
    // Some tiles of another scene happen to have the same gray value.
    assert!(as_it_is.count() * 100 > 95 * own.len());
}

#[test]
fn nothing_is_carried_over_to_another_size_range_or_other_settings() {
    let (level, settings) = (Level::best(), Preset::Fast.settings());
    let other = Settings { p1: settings.p1 + 1.0, ..settings.clone() };
    let first = still(0, 1, 4.0, SIZE);
    let wide = Frame {
        pair: Pair::new(first.pair.views()[0].clone(), first.pair.views()[1].clone(), 0, 17)
            .expect("a legal pair"),
        ..first.clone()
    };
    let next = [
        (&first, &settings, 2),
        (&wide, &settings, 1),
        (&first, &other, 1),
        (&still(0, 1, 4.0, (30, 49)), &settings, 1),
    ];
    for (next, settings_of_next, expected) in next {
        let mut filter = TemporalFilter::new();
        for (frame, settings, expected) in [(&first, &settings, 1), (next, settings_of_next, expected)] {
            let mut map = frame.map.clone();
            let support =
                with_runtime(1, level, |runtime| filter.apply(&frame.pair, settings, &mut map, runtime));
            let support = support.expect("not cancelled");
            assert!(support.as_slice().iter().all(|count| *count == expected));
        }
    }
}

#[test]
fn a_cancelled_frame_is_forgotten_with_all_before_it() {
    let (level, settings, frame) = (Level::best(), Settings::default(), still(0, 1, 4.0, SIZE));
    let mut filter = TemporalFilter::new();
    let mut support = |control: &Control| {
        let mut map = frame.map.clone();
        let support = with_runtime(1, level, |runtime| {
            filter.apply(&frame.pair, &settings, &mut map, Runtime { control, ..runtime })
        })?;
        Ok::<_, Error>(support.row(0)[0])
    };
    let (calm, cancelled) = (Control::default(), Control::default());
    cancelled.cancel();
    assert_eq!(support(&calm), Ok(1));
    assert_eq!(support(&calm), Ok(2));
    assert_eq!(support(&cancelled), Err(Error::Cancelled));
    assert_eq!(support(&calm), Ok(1));
}
