//! Facts learned about two cameras over the frames of a video: the field of rows, compared with a filter that
//! is updated with one number at a time, the range of disparities, the events, and all of it as text.

use std::array::from_fn;
use std::sync::Arc;

use crate::common::hash;
use phasestereo::internals::estimation::blur::psf::{Family, Psf};
use phasestereo::internals::estimation::blur::{Blur, Estimate, Side};
use phasestereo::internals::estimation::rows::RowOffsets;
use phasestereo::internals::estimation::tracks::{Seed, Track};
use phasestereo::internals::rectification::cameras::Cameras;
use phasestereo::internals::rectification::{Raw, Rectification};
use phasestereo::internals::video::limits::check;
use phasestereo::internals::video::rig::changes::Changes;
use phasestereo::internals::video::rig::columns::Columns;
use phasestereo::internals::video::rig::events::{Events, Steady, Subject};
use phasestereo::internals::video::rig::field::{FieldFilter, seeds};
use phasestereo::internals::video::rig::sensors::{BlurKind, BlurMap, Sensors};
use phasestereo::internals::video::rig::stopped::Stopped;
use phasestereo::internals::video::rig::text::{read, written};
use phasestereo::internals::video::rig::{Geometry, Rig};
use phasestereo_match::base::digest::Digest;
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::matcher::{Disparity, Timings};
use phasestereo_match::pair::alignment::{Alignment, TERMS, places, terms};
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::Settings;

const SIZE: (usize, usize) = (300, 400);

type Matrix = [[f64; TERMS]; TERMS];

/// A number from -1 to 1.
fn random(salt: u64, y: usize, x: usize) -> f64 {
    (hash(salt, y, x) % 2001) as f64 / 1000.0 - 1.0
}

/// Blocks all over an image whose rows are off by `field`, except for some of them.
fn tracks(frame: usize, field: impl Fn(f64, f64) -> f64) -> Vec<Track> {
    let track = |at: usize| {
        let (row, col) = (at / 14, at % 14);
        let (x, y) = (20.0 + 26.0 * col as f64, 20.0 + 31.0 * row as f64);
        let dx = 6.0 * random(1, frame, at);
        let mistake = if hash(2, frame, at).is_multiple_of(17) { 9.0 } else { 0.0 };
        let dy = field(x + dx, y) + 0.1 * random(3, frame, at) + mistake;
        Track { place: Seed { x, y, dx, dy }, weight: 2.0 + 1.9 * random(4, frame, at) }
    };
    (0..126).map(track).collect()
}

/// The filter by definition, updated with one block after another: that of the inverse of a sum is the same.
struct Naive {
    value: [f64; TERMS],
    drift: [f64; TERMS],
    covariance: Matrix,
}

impl Naive {
    fn predict(&mut self) {
        for term in 0..TERMS {
            self.value[term] += self.drift[term];
            let change = if term < 3 { 6e-6 } else { 4e-7 };
            self.covariance[term][term] += (change * SIZE.1 as f64).powi(2);
        }
    }

    fn error(&self) -> f64 {
        let variance = |(x, y)| -> f64 {
            let terms = terms(x, y);
            let pairs = (0..TERMS).flat_map(|a| (0..TERMS).map(move |b| (a, b)));
            pairs.map(|(a, b)| terms[a] * self.covariance[a][b] * terms[b]).sum()
        };
        (places().map(variance).sum::<f64>() / places().count() as f64).sqrt()
    }

    /// Updates it with blocks that are at most this far off the field; `spread` is that of those that agree.
    fn update(&mut self, tracks: &[Track], spread: f64) {
        let mut weights: Vec<f64> = tracks.iter().map(|track| track.weight).collect();
        weights.sort_unstable_by(f64::total_cmp);
        let usual = weights[weights.len() / 2];

        let (before, start) = (self.error(), self.value);
        for track in tracks {
            let Seed { x, y, dx, dy } = track.place;
            let share = |at: f64, length: usize| (at + 0.5) / (length as f64 / 2.0) - 1.0;
            let t = terms(share(x + dx, SIZE.1), share(y, SIZE.0));
            let off = |value: &[f64; TERMS]| dy - (0..TERMS).map(|at| t[at] * value[at]).sum::<f64>();
            if off(&start).abs() > 3.0 {
                continue;
            }

            let variance = 2.0 * spread * spread / (track.weight / usual).min(2.0);
            let spread: [f64; TERMS] =
                from_fn(|row| (0..TERMS).map(|col| self.covariance[row][col] * t[col]).sum());
            let total = variance + (0..TERMS).map(|at| t[at] * spread[at]).sum::<f64>();
            let wrong = off(&self.value);
            for row in 0..TERMS {
                self.value[row] += spread[row] * wrong / total;
                for col in 0..TERMS {
                    self.covariance[row][col] -= spread[row] * spread[col] / total;
                }
            }
        }

        if self.error() > 0.8 * before {
            for (drift, (after, before)) in self.drift.iter_mut().zip(self.value.iter().zip(start)) {
                *drift = 0.995 * (*drift + 0.06 * (after - before));
            }
        }
    }
}

fn assert_near(found: &[f64], expected: &[f64], what: &str) {
    let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-9 + 1e-6 * b.abs();
    assert!(found.iter().zip(expected).all(near), "{what}: {found:?}, {expected:?}");
}

#[test]
fn the_field_of_rows_is_that_of_a_filter_of_single_blocks() {
    let field = |frame: usize| {
        let coefficients = [0.8 + 0.004 * frame as f64, -0.5, 0.3, 0.02, -0.03, 0.01, 0.02, 0.0];
        move |x, y| Alignment::new(coefficients, SIZE).expect("legal").at(x, y)
    };
    let mut filter = FieldFilter::new(SIZE, None);
    assert!(!filter.is_seen() && filter.offsets() == Ok(None));

    let covariance = from_fn(|row| {
        from_fn(|col| {
            if row != col {
                0.0
            } else if row < 3 {
                1.0
            } else {
                0.0025
            }
        })
    });
    let mut naive = Naive { value: [0.0; TERMS], drift: [0.0; TERMS], covariance };
    for frame in 0..25 {
        let tracks = tracks(frame, field(frame));
        filter.predict();
        naive.predict();
        let found = filter.innovation(&tracks).expect("blocks");
        assert!(!found.sways && !found.is_moved, "{frame}: {}", found.moved);
        filter.update(&found);

        let FieldFilter { value, drift, covariance, agreement: (blocks, spread), .. } = filter.clone();
        naive.update(&tracks, spread);
        assert!((105..=126).contains(&blocks) && (0.05..0.11).contains(&spread));
        assert_near(&value, &naive.value, "value");
        assert_near(&drift, &naive.drift, "drift");
        assert_near(covariance.as_flattened(), naive.covariance.as_flattened(), "covariance");
        assert_near(&[filter.error()], &[naive.error()], "error");
    }

    let offsets = filter.offsets().expect("legal").expect("blocks");
    assert_eq!(offsets.field, filter.field().expect("legal"));
    assert!((offsets.field.at(200.0, 150.0) - field(24)(200.0, 150.0)).abs() < 0.03);
    let middle = offsets.errors[7].midpoint(offsets.errors[8]);
    assert!(offsets.errors[0] > middle && offsets.errors[15] > middle && middle < offsets.error);
    assert!((0.001..0.008).contains(&filter.drift()), "{}", filter.drift());
    let angle = math::hypot(math::atan2(naive.value[0], 500.0), math::atan2(naive.value[1], 200.0));
    assert_near(&[filter.rotation(500.0)], &[angle.to_degrees()], "rotation");

    // The cameras are moved.
    let moved = filter.innovation(&tracks(25, |x, y| field(25)(x, y) + 0.6)).expect("blocks");
    assert!(moved.is_moved && (moved.moved - 0.6).abs() < 0.03, "{}", moved.moved);
    let slightly = filter.innovation(&tracks(25, |x, y| field(25)(x, y) + 0.15)).expect("blocks");
    assert!(!slightly.is_moved);
    filter.reopen(&moved);
    assert!((filter.field().expect("legal").at(200.0, 150.0) - 1.5).abs() < 0.1);
    assert!(filter.drift() <= 0.0, "none");

    let swaying = tracks(25, |x, y| field(25)(x, y) + math::sin(y / 30.0));
    assert!(filter.innovation(&swaying).expect("blocks").sways);
    assert!(filter.innovation(&swaying[..11]).is_none());
}

#[test]
fn a_field_that_was_estimated_is_known_as_well_as_that() {
    let deviations = |bend: f64| {
        let field = Alignment::new([0.5, 0.1, 0.0, bend, 0.0, 0.0, 0.0, 0.0], SIZE).expect("legal");
        let found = RowOffsets { field, error: 0.2, blocks: 70, spread: 0.3, errors: [0.2; 16] };
        let filter = FieldFilter::new(SIZE, Some(&found));
        assert_eq!(filter.field(), Ok(found.field));
        assert_eq!(filter.agreement, (70, 0.3));
        [0, 2, 3, 7].map(|term| filter.covariance[term][term].sqrt())
    };
    assert_near(&deviations(0.0), &[0.4, 0.4, 0.05, 0.05], "a plane");
    assert_near(&deviations(0.1), &[0.4; 4], "all terms");
}

#[test]
fn blocks_are_looked_for_in_each_cell_at_places_in_turns() {
    let field = Alignment::new([0.4, 0.2, -0.3, 0.0, 0.0, 0.0, 0.0, 0.0], SIZE).expect("legal");
    let disparity = Plane::from_fn(SIZE.0, SIZE.1, |y, x| {
        if hash(5, y, x).is_multiple_of(11) { f32::NAN } else { (y % 7) as f32 }
    });
    let flags = Plane::from_fn(SIZE.0, SIZE.1, |y, x| u16::from(hash(6, y, x).is_multiple_of(5)));

    for frame in [0usize, 1, 2, 3, 34, 47, 48] {
        for has_all in [false, true] {
            let expected: Vec<Vec<Seed>> = (0..9)
                .filter(|row| has_all || row % 3 == frame % 3)
                .map(|row| {
                    let place = |cell: usize, step: usize, cells: usize, length: usize| {
                        let place = frame / 3 * step % 16;
                        20 + (16 * cell + place) * (length - 40) / (16 * cells)
                    };
                    let y = place(row, 11, 9, SIZE.0);
                    let columns = (0..14).map(|col| place(col, 7, 14, SIZE.1));
                    let known = columns.filter(|x| disparity.row(y)[*x].is_finite() && flags.row(y)[*x] == 0);
                    let seed = |x: usize| {
                        let dx = -f64::from(disparity.row(y)[x]);
                        let (x, y) = (x as f64, y as f64);
                        Seed { x, y, dx, dy: field.at(x + dx, y) }
                    };
                    known.map(seed).collect()
                })
                .collect();
            assert_eq!(seeds(&disparity, &flags, &field, frame as u64, has_all), expected);
        }
    }

    let small = |rows, cols| {
        let none = Plane::from_fn(rows, cols, |_, _| 0.0);
        seeds(&none, &none.map(|_| 0), &field, 0, true).is_empty()
    };
    assert!(small(54, 300) && small(300, 54) && !small(55, 55));
}

/// A map of this many pixels, in units of a 2500th, by disparity; others failed a check, or have no number.
fn map(shares: &[(f32, usize)]) -> Disparity {
    let (rows, cols) = (200, 200);
    let values: Vec<f32> = shares.iter().flat_map(|(value, count)| vec![*value; *count]).collect();
    let at = |y: usize, x: usize| values.get(y / 4 * 50 + x / 4).copied();
    let is_counted = |y: usize, x: usize| y.is_multiple_of(4) && x.is_multiple_of(4);
    Disparity {
        disparity: Plane::from_fn(rows, cols, |y, x| {
            if is_counted(y, x) { at(y, x).unwrap_or(f32::NAN) } else { 39.0 }
        }),
        flags: Plane::from_fn(rows, cols, |y, x| u16::from(at(y, x) == Some(38.0))),
        confidence: None,
        uncertainty: None,
        wrong: None,
        detail: None,
        timings: Timings::default(),
    }
}

/// A range of disparities without observations.
fn unseen(min: i64, count: i64) -> Columns {
    Columns::new(Candidates::new(min, count, 400).expect("legal"))
}

#[test]
fn the_range_follows_what_comes_nearer_and_forgets_what_is_gone() {
    let mut columns = unseen(-2, 42);
    // Too few pixels, unknown and flagged ones keep the range unchanged.
    let usual = map(&[(10.3, 2400), (f32::NAN, 10), (38.0, 40), (35.0, 9)]);
    assert!(!columns.update(&usual, 400) && columns.searched == (-2..40));
    let whole = 1i64 << 20;
    let share = |count: i64, total: i64| count * whole / total / 32;
    assert_eq!(columns.shares[12], share(2400, 2409));
    assert_eq!(columns.shares[37], share(9, 2409));
    assert_eq!(columns.shares.iter().filter(|share| **share > 0).count(), 2);
    assert_eq!((columns.reserve(), columns.idle), (Some(4), 1));

    // A hundredth of it is enough: at 37, half of the reserve of 6 is left; at 38 less.
    let near = |value| map(&[(10.0, 2480), (value, 20)]);
    assert!(!columns.update(&near(36.0), 400) && columns.idle == 0);
    assert!(columns.update(&near(37.0), 400) && columns.searched == (-2..44));
    // At most the width, and a twelfth of a long range.
    assert!(!unseen(0, 50).update(&near(49.0), 50));
    let mut long = unseen(0, 130);
    assert!(long.update(&near(129.0), 400) && long.searched == (0..140));
    let mut long = unseen(0, 130);
    assert!(long.update(&near(129.0), 133) && long.searched == (0..133));

    // A frame is idle if it leaves more than the reserve plus 16.
    let idle = |value| {
        let mut columns = unseen(0, 40);
        columns.update(&map(&[(value, 2500)]), 400);
        columns.idle
    };
    assert_eq!((idle(17.0), idle(16.0)), (0, 1));

    // Disparities that are not seen fade by a 32nd with each frame, and are cut off 90 frames later.
    let before = columns.shares[39];
    assert!(!columns.update(&usual, 400));
    assert_eq!(columns.shares[39], before - before / 32);
    for _ in 0..200 {
        columns.update(&usual, 400);
    }
    assert_eq!(columns.searched, -2..44, "few pixels, but again and again");
    let frames = (0..400).take_while(|_| {
        columns.update(&map(&[(10.0, 2500)]), 400);
        columns.searched == (-2..44)
    });
    let frames = frames.count();
    assert_eq!(columns.searched, -2..17, "up to 10, and 6 more");
    assert!((105..115).contains(&frames), "{frames}");

    let given = unseen(5, 20).candidates(400).expect("legal");
    columns.watch(given, &near(24.0));
    assert_eq!((columns.searched.clone(), columns.reserve()), (5..25, Some(0)));
    columns.watch(given, &near(24.0));
    assert_eq!(columns.shares[19], {
        let one = 20 * whole / 2500;
        one / 32 + (one - one / 32) / 32
    });
    columns.extend(30);
    columns.extend(20);
    assert_eq!((columns.searched.clone(), columns.shares.len()), (5..30, 25));
    assert_eq!(unseen(0, 9).reserve(), None);
}

#[test]
fn a_state_changes_where_frames_in_a_row_say_so() {
    let mut steady = Steady::new(0);
    let said = [1, 1, 0, 1, 1, 1, 1, 0, 0, 0].map(|said| steady.update(said, 3));
    let expected = [None, None, None, None, None, Some(2), None, None, None, Some(2)];
    assert_eq!((said, steady.state), (expected, 0));

    let mut events = Events::default();
    events.push(Subject::Rows, 4, "a");
    events.renew(Subject::Rows, 34, "b");
    events.renew(Subject::Range, 34, "c");
    events.renew(Subject::Rows, 65, "d");
    let sentences: Vec<&str> = events.all().iter().map(|event| &*event.sentence).collect();
    assert_eq!(sentences, ["b", "c", "d"]);
    (0..300).for_each(|frame| events.push(Subject::Blur, frame, "e"));
    assert_eq!((events.all().len(), events.all()[0].frame), (256, 44));
}

/// A rig of a field with this shift, known to an error of 0.04 pixels.
fn rig(shift: f64, straightens: i64) -> Rig {
    let mut field = FieldFilter::new(SIZE, None);
    (field.value[0], field.drift, field.agreement) = (shift, [0.001; TERMS], (80, 0.25));
    field.covariance = [[0.0; TERMS]; TERMS];
    field.covariance[0][0] = 0.0016;

    let mut cameras = Cameras::new([0.1; 14], [0.2; 14], SIZE);
    cameras.shifts = [[1.0, 2.0], [3.0, 4.0]];
    let rectification = Rectification {
        cameras,
        matches: [9, 8],
        blocks: 7,
        rows: 0.1,
        rms: 0.2,
        error: 0.3,
        disparities: [4.5, 5.5, 6.5],
        pairs: 6,
        is_inverted: false,
        moved: 0.4,
        distortion: [(0.5, 0.6), (0.7, 0.8)],
    };
    let mut events = Events::default();
    events.push(Subject::Rows, 3, "rows are straightened from here on");
    events.push(Subject::Health, 6, "the match is well again");
    let psf = Psf { family: Family::Motion, size: 9.0, angle: 30.0, inner: 0.0 };
    let blur = BlurMap {
        kinds: vec![
            BlurKind { side: 1, psf: Some(psf), spread: 2.6 },
            BlurKind { side: 0, psf: None, spread: 0.0 },
        ],
        tiles: (1, 3),
        side: 16,
        labels: vec![0, 1, 1],
        certainty: 0.75,
    };
    let geometry = Geometry {
        is_turned: false,
        size: SIZE,
        cameras: Some(Arc::new(Raw::new(rectification, SIZE))),
        field,
        straightens: Steady::new(straightens),
        sways: Steady::new(0),
        columns: Columns { shares: vec![0, 5, 7, 1], idle: 2, ..unseen(-3, 4) },
        is_inverted: true,
    };
    let rig = Rig {
        stopped: Stopped::default(),
        changes: Changes::default(),
        frames: 7,
        geometry: Some(geometry),
        appearance: None,
        sensors: Some(Sensors {
            frame: 5,
            range: 255.0,
            noise: Some([1.5, 2.5]),
            response: Some([1.1, 0.9, 1.2]),
            blur: Some(blur),
        }),
        events,
        health: Some(0.125),
        soft: Some(Steady { state: 1, next: 2, frames: 3 }),
        ill: Some(Steady { state: 0, next: 0, frames: 4 }),
        doubt: (3, 9),
    };
    let text = written(&rig).expect("numbers");
    let rig = read(&text).expect("legal");
    assert_eq!(written(&rig).expect("numbers"), text);
    rig
}

/// The text with other JSON and a correct checksum.
fn signed(json: &str) -> String {
    let mut digest = Digest::default();
    digest.add(json.bytes());
    format!("phasestereo rig 2 {:016x}\n{json}\n", digest.value())
}

#[test]
fn a_rig_as_text_is_read_back_and_anything_else_is_refused() {
    let text = written(&rig(0.5, 1)).expect("numbers");
    let json = text.lines().nth(1).expect("a second line");
    assert_eq!(signed(json), text);
    for (from, to) in
        [("rig 2", "rig 1"), ("\"frames\":7", "\"frames\":8"), ("0.125", "0.126"), ("rig 2 ", "rig 2 0")]
    {
        assert!(read(&text.replacen(from, to, 1)).is_err(), "{to}");
    }

    for (from, to) in [
        ("\"frames\":7", "\"frames\":\"x\""),
        ("\"frames\":7", "\"frames\":7,\"frames\":7"),
        ("\"frames\":7", "\"frames\":18446744073709551615"),
        ("\"frames\":7", "\"frames\":2"),
        ("\"doubt\":[3,", "\"doubt\":[9223372036854775807,"),
        ("\"health\":0.125", "\"health\":1.5"),
        ("\"size\":[300,400]", "\"size\":[0,400]"),
        ("\"size\":[300,400]", "\"size\":[300,401]"),
        ("\"size\":[300,400]", "\"size\":[4294967296,4294967296]"),
        ("[[0.0016", "[[-0.0016"),
        ("[[0.0016", "[[1e308"),
        ("[[0.0016,0.0", "[[0.0016,0.1"),
        ("\"value\":[0.5", "\"value\":[16385.0"),
        ("\"agreement\":[80", "\"agreement\":[18446744073709551615"),
        ("\"shares\":[0,5,7,1]", "\"shares\":[]"),
        ("\"shares\":[0,5", "\"shares\":[0,9223372036854775807"),
        ("\"shares\":[0,5", "\"shares\":[0,-5"),
        ("\"idle\":2", "\"idle\":4294967295"),
        ("\"start\":-3,\"end\":1", "\"start\":400,\"end\":404"),
        ("\"start\":-3,\"end\":1", "\"start\":-3,\"end\":9"),
        ("\"start\":-3,\"end\":1", "\"start\":9223372036854775807,\"end\":1"),
        ("\"shifts\":[[1.0", "\"shifts\":[[null"),
        ("\"numbers\":[0.1", "\"numbers\":[1e7"),
        ("\"spreads\":[0.2", "\"spreads\":[2.0"),
        ("\"rms\":0.2", "\"rms\":1e308"),
        ("\"pairs\":6", "\"pairs\":18446744073709551615"),
        ("\"range\":255.0", "\"range\":0.0"),
        ("\"noise\":[1.5", "\"noise\":[-1.5"),
        ("\"side\":1", "\"side\":7"),
        ("\"spread\":2.6", "\"spread\":-2.6"),
        ("\"tiles\":[1,3]", "\"tiles\":[1,2]"),
        ("\"labels\":[0", "\"labels\":[2"),
        ("\"subject\":\"Rows\"", "\"subject\":\"Shows\""),
        ("\"state\":1,\"next\":2", "\"state\":1,\"next\":3"),
        ("\"straightens\":{\"state\":1", "\"straightens\":{\"state\":9"),
        ("\"certainty\":0.75", "\"certainty\":7.5"),
    ] {
        assert!(json.contains(from), "{from}");
        assert!(read(&signed(&json.replacen(from, to, 1))).is_err(), "{to}");
    }

    let sensors = read(&text).expect("legal").sensors.expect("known");
    let blur = sensors.blur.as_ref().expect("known");
    assert_near(&[0.3, 0.4].map(|share| blur.largest(share)), &[2.6, 0.0], "spreads");

    let none = written(&Rig::default()).expect("numbers");
    assert_eq!(written(&read(&none).expect("legal")).expect("numbers"), none);
}

#[test]
fn a_text_of_which_anything_was_changed_is_refused_or_a_rig_that_can_be_used() {
    let text = written(&rig(0.5, 1)).expect("numbers");
    let json = text.lines().nth(1).expect("a second line");
    let numbers = ["0", "-1", "255", "1e308", "-1e308", "1e-308", "18446744073709551615", "null", "{}"];
    let mut read_all = 0;
    for seed in 0..4000u64 {
        let mut changed = json.as_bytes().to_vec();
        for change in 0..=(hash(1, seed as usize, 0) % 3) as usize {
            let at = hash(2, seed as usize, change) as usize % changed.len();
            let other = numbers[hash(3, seed as usize, change) as usize % numbers.len()];
            // A whole number in place of another one, or any byte.
            let is_part = |byte: &u8| byte.is_ascii_digit() || b"-+.e".contains(byte);
            let first = changed[..at].iter().rposition(|byte| !is_part(byte)).map_or(0, |at| at + 1);
            let end = at + changed[at..].iter().take_while(|byte| is_part(byte)).count();
            if first < end {
                changed.splice(first..end, other.bytes());
            } else {
                changed[at] = (32 + hash(4, seed as usize, change) % 95) as u8;
            }
        }
        let changed = String::from_utf8(changed).expect("ASCII");
        assert!(changed == json || read(&text.replace(json, &changed)).is_err(), "a wrong checksum");

        // A valid one: the result can be queried, saved, and updated.
        let Ok(mut rig) = read(&signed(&changed)) else { continue };
        read_all += 1;
        check(&rig, &[], Some(400.0)).expect("limits");
        assert_eq!(written(&read(&written(&rig).expect("numbers")).expect("again")), written(&rig));
        if let Some(geometry) = &mut rig.geometry {
            geometry.field.predict();
            geometry.columns.update(&map(&[(1.0, 2500)]), SIZE.1);
        }
        rig.frames += 1;
        rig.settle(None, 0.9);
    }
    assert!(read_all > 100, "{read_all}");
}

#[test]
fn rows_blur_and_health_of_a_rig_change_where_frames_say_so() {
    let sentences = |rig: &Rig| -> Vec<String> {
        rig.events.all()[2..].iter().map(|event| format!("{} {}", event.frame, event.sentence)).collect()
    };
    // Number of frames until rows are straightened, or no longer are.
    let frames = |shift, straightens| {
        let mut rig = rig(shift, straightens);
        let settled = (1..50).find(|_| {
            rig.settle(None, f64::NAN);
            sentences(&rig).len() == 1
        });
        let geometry = rig.geometry.expect("known");
        assert_eq!(geometry.alignment().expect("legal").is_some(), geometry.straightens.state == 1);
        settled
    };
    assert_eq!(
        (frames(0.21, 0), frames(0.19, 0), frames(0.07, 1), frames(0.09, 1)),
        (Some(3), None, Some(20), None)
    );

    let blur = |side| Estimate {
        blurs: vec![Blur { side, psf: None, taps: None, other: None }],
        ..Estimate::unknown(SIZE)
    };
    let mut rig = rig(0.1, 0);
    (rig.soft, rig.frames) = (None, 10);
    for (side, wrong) in [(Side::Left, 0.5), (Side::Right, 0.1), (Side::Right, 0.3)] {
        for _ in 0..3 {
            rig.settle(Some(&blur(Some(side))), wrong);
            rig.frames += 1;
        }
    }
    (0..3).for_each(|_| rig.settle(Some(&blur(None)), 0.2));
    let expected = [
        "10 the left image is the softer one",
        "10 the match is probably wrong: 50 % wrong",
        "13 the right image is the softer one",
        "13 the match is well again: 10 % wrong",
        "17 both images are equally sharp again",
    ];
    assert_eq!(sentences(&rig), expected);
    let expected = [[0.5; 3], [0.1; 3], [0.3; 3], [0.2; 3]].concat();
    let expected = expected.into_iter().fold(0.125, |health, wrong| health + (wrong - health) / 8.0);
    assert!((rig.health.expect("known") - expected).abs() < 1e-12);

    // Images of another size come from other cameras.
    rig.suit(SIZE, false, &Settings::default());
    assert!(rig.geometry.is_some());
    rig.suit((300, 401), false, &Settings::default());
    assert!(rig.geometry.is_none() && rig.sensors.is_none() && rig.health.is_none());
    assert!(sentences(&rig)[5].ends_with("images are 401 x 300 from here on: all is learned anew"));
}
