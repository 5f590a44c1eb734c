//! Areas outside the run of disparities: as a naive search finds them, and where things were put.

use crate::common::{hash, levels};
use phasestereo::internals::estimation::areas::{Area, areas};
use phasestereo::internals::estimation::overview::{Guess, Overview};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::cost::Costs;
use phasestereo_match::image::conversion::view_of_plane;
use phasestereo_match::image::intensity_range::IntensityRange;
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::{Execution, Matcher};
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::Settings;
use phasestereo_match::settings::presets::Preset;

/// Rows and columns of the copies.
const SIZE: (usize, usize) = (61, 117);
/// Disparity of the background, and the run that holds it.
const FAR: isize = 3;
const RUN: (isize, isize) = (1, 6);
const REACH: (isize, isize) = (-30, 52);

fn noise(salt: u64, y: usize, x: usize) -> f32 {
    (hash(salt, y, x) % 256) as f32 / 2.0
}

/// A copy as a view.
fn as_view(plane: &Plane<f32>) -> View {
    view_of_plane(plane, IntensityRange { black: -128_000.0, white: 128_000.0 })
}

/// Copies of a background with things before it: top, rows, first column of the left image, columns, disparity.
fn copies(things: &[(usize, usize, usize, usize, isize)]) -> Overview {
    let background = |y: usize, x: isize| noise(1, y, (x + 500) as usize);
    let seen = |y: usize, x: usize, is_right: bool| {
        let shift = |disparity: isize| if is_right { disparity } else { 0 };
        let thing =
            things.iter().enumerate().find(|(_, (top, rows, first, columns, disparity))| {
                let column = x as isize + shift(*disparity) - *first as isize;
                (*top..top + rows).contains(&y) && (0..*columns as isize).contains(&column)
            });

        match thing {
            Some((number, (.., disparity))) => {
                noise(number as u64 + 2, y, (x as isize + shift(*disparity) + 500) as usize)
            }
            None => background(y, x as isize + shift(FAR)),
        }
    };

    let plane = |is_right| Plane::from_fn(SIZE.0, SIZE.1, |y, x| seen(y, x, is_right));
    let valid = Plane::from_fn(SIZE.0, SIZE.1, |y, x| y > 2 || x > 20);
    Overview { factor: 1, planes: [plane(false), plane(true)], valid }
}

/// A rough match of copies of the same size that has found the background, with errors and gaps.
fn guessed() -> Plane<f32> {
    Plane::from_fn(SIZE.0, SIZE.1, |y, x| match hash(99, y, x) % 16 {
        0 => f32::NAN,
        1 => FAR as f32 + 1.0,
        _ if x < 5 => f32::NAN,
        _ => FAR as f32,
    })
}

/// One of copies of half the size.
fn guessed_on_smaller() -> Plane<f32> {
    let (rows, cols) = (SIZE.0 / 2, SIZE.1 / 2);
    Plane::from_fn(rows, cols, |y, x| if hash(98, y, x).is_multiple_of(9) { f32::NAN } else { 2.0 })
}

fn found(copies: &Overview, guess: Guess, threads: usize, level: Level) -> Vec<Area> {
    let matcher = Matcher::new(threads).expect("threads");
    let control = Control::default();
    let runtime =
        Runtime { matcher: &matcher, execution: Execution { threads, level }, control: &control };

    matcher.install(|| areas(copies, guess, RUN, REACH, None, runtime)).expect("it runs")
}

/// The sums of a pixel over its window by disparity; `None` where the match lies outside the image.
struct Sums {
    costs: Plane<u16>,
    low: isize,
    count: usize,
}

impl Sums {
    fn new(left: &View, right: &View, (low, high): (isize, isize)) -> Self {
        let count = (high - low + 1) as usize;
        let candidates = Candidates::new(low as i64, count as i64, SIZE.1).expect("legal");
        let settings =
            Settings { neighborhood: 3, frequencies: (1, 1), ..Preset::Paper.settings() };

        let (level, control) = (Level::best(), Control::default());
        let costs = Costs::new([left, right], candidates, &settings, None, level, &control);
        let costs = costs.expect("legal").volume(SIZE.0, level, &control).expect("it fits");
        Self { costs, low, count }
    }

    fn at(&self, y: usize, x: usize, disparity: isize) -> Option<u64> {
        let k = usize::try_from(disparity - self.low).ok().filter(|k| *k < self.count)?;
        if !(0..SIZE.1 as isize).contains(&(x as isize - disparity)) {
            return None;
        }

        let clamped = |at: usize, by: isize, length: usize| {
            (at as isize + by).clamp(0, length as isize - 1) as usize
        };
        let places = (-4..=4).flat_map(|dy| (-1..=1).map(move |dx| (dy, dx)));
        Some(
            places
                .map(|(dy, dx)| {
                    let column = clamped(x, dx, SIZE.1);
                    u64::from(self.costs.row(clamped(y, dy, SIZE.0))[column * self.count + k])
                })
                .sum(),
        )
    }

    /// The sum where every pixel of the window has a disparity of its own; matches outside the image are on its border.
    fn along(&self, y: usize, x: usize, disparity: impl Fn(usize, usize) -> isize) -> u64 {
        let clamped = |at: usize, by: isize, length: usize| {
            (at as isize + by).clamp(0, length as isize - 1) as usize
        };
        let places = (-4..=4).flat_map(|dy| (-1..=1).map(move |dx| (dy, dx)));
        places
            .map(|(dy, dx)| {
                let (y, x) = (clamped(y, dy, SIZE.0), clamped(x, dx, SIZE.1));
                let k = (disparity(y, x) - self.low) as usize;
                u64::from(self.costs.row(y)[x * self.count + k])
            })
            .sum()
    }

    /// The least sum over some disparities, and the first that has it.
    fn least(&self, y: usize, x: usize, is_one: impl Fn(isize) -> bool) -> (u64, isize) {
        (self.low..self.low + self.count as isize)
            .filter(|disparity| is_one(*disparity))
            .filter_map(|disparity| self.at(y, x, disparity).map(|sum| (sum, disparity)))
            .min_by_key(|(sum, _)| *sum)
            .unwrap_or((255, isize::MIN))
    }
}

/// A pixel, its disparity and its gain.
type Member = ((usize, usize), (isize, u64));

/// The areas by the definition.
fn naive(copies: &Overview, guess: Guess) -> Vec<Area> {
    let [left, right] = copies.planes.each_ref().map(as_view);
    let (forward, back) =
        (Sums::new(&left, &right, REACH), Sums::new(&right, &left, (-REACH.1, -REACH.0)));
    let run = Sums::new(&left, &right, RUN);
    let pixels: Vec<(usize, usize)> =
        (0..SIZE.0).flat_map(|y| (0..SIZE.1).map(move |x| (y, x))).collect();

    let along = |(y, x): (usize, usize)| run.least(y, x, |_| true).0;
    let is_judged = |(y, x): (usize, usize)| {
        copies.valid.row(y)[x] && (0..SIZE.1 as isize).contains(&(x as isize - 3))
    };
    // The disparity that the rough match found at a pixel, or left of it.
    let rough = |y: usize, x: usize| {
        let plane = guess.disparity;
        let row = plane.row((y * guess.by / guess.finer).min(plane.rows() - 1));
        let at = |x: usize| row[(x * guess.by / guess.finer).min(plane.cols() - 1)];
        let known = (0..=x).rev().map(at).find(|value| !value.is_nan());
        let scaled = |value: f32| value * guess.finer as f32 / guess.by as f32;
        known
            .map_or(isize::midpoint(RUN.0, RUN.1), |value| scaled(value).round_ties_even() as isize)
    };
    let within = guess.finer as isize / 2;
    let guessed = |(y, x): (usize, usize)| {
        let sums = (-within..=within).map(|off| forward.along(y, x, |y, x| rough(y, x) + off));
        sums.min().expect("one")
    };

    let guessed: Vec<u64> = pixels.iter().map(|at| guessed(*at)).collect();
    let mut judged: Vec<u64> = pixels
        .iter()
        .zip(&guessed)
        .filter(|(at, _)| is_judged(**at))
        .map(|(_, sum)| *sum)
        .collect();
    judged.sort_unstable();
    let median = judged[judged.len() / 2];

    let (mut doubtful, mut many) = (vec![0; 100 * 100], vec![0; 100 * 100]);
    for (at, sum) in pixels.iter().zip(guessed).filter(|(at, _)| is_judged(**at)) {
        let block = at.0 / 8 * 100 + at.1 / 8;
        doubtful[block] += usize::from(sum > median + 27);
        many[block] += usize::from(along(*at) > median + 27);
    }

    // The disparity and the gain of the pixels that stand out.
    let is_along = |disparity: isize| (RUN.0 - 1..=RUN.1 + 1).contains(&disparity);
    let stands_out = |(y, x): (usize, usize)| {
        let (own, disparity) = forward.least(y, x, |disparity| !is_along(disparity));
        let others =
            forward.least(y, x, |other| is_along(other) || (other - disparity).abs() > 2).0;
        let block = y / 8 * 100 + x / 8;
        let is_searched = doubtful[block] >= 10 && many[block] >= 10;
        (is_searched && 8 * own < 7 * others).then(|| (disparity, others - own))
    };
    let mut open: Vec<Option<(isize, u64)>> = pixels.iter().map(|at| stands_out(*at)).collect();

    let mut found = vec![];
    for start in 0..pixels.len() {
        let Some(first) = open[start].take() else { continue };
        let mut members = vec![(pixels[start], first)];
        let mut next = 0;
        while next < members.len() {
            let ((y, x), (disparity, _)) = members[next];
            next += 1;
            for (dy, dx) in (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (dy, dx))) {
                let (row, column) = (y as isize + dy, x as isize + dx);
                let is_inside =
                    (0..SIZE.0 as isize).contains(&row) && (0..SIZE.1 as isize).contains(&column);
                let at = if is_inside { row as usize * SIZE.1 + column as usize } else { continue };
                if open[at].is_some_and(|(other, _)| (other - disparity).abs() <= 1) {
                    members.extend(open[at].take().map(|known| (pixels[at], known)));
                }
            }
        }

        let is_seen = |((y, x), (disparity, _)): &Member| {
            let column = (*x as isize - disparity) as usize;
            (back.least(*y, column, |_| true).1 + disparity).abs() <= 2
        };
        let ends = |of: &dyn Fn(&Member) -> isize| {
            let values = members.iter().map(of);
            (values.clone().min().expect("one"), values.max().expect("one"))
        };
        let ((top, bottom), (first, last)) =
            (ends(&|member| member.0.0 as isize), ends(&|member| member.0.1 as isize));
        if members.len() >= 12 {
            found.push(Area {
                rows: top as usize..bottom as usize + 1,
                columns: first as usize..last as usize + 1,
                span: ends(&|member| member.1.0),
                size: members.len(),
                seen: members.iter().filter(|member| is_seen(member)).count(),
                gain: members.iter().map(|member| member.1.1).sum(),
            });
        }
    }
    found
}

#[test]
fn areas_are_those_of_the_definition() {
    let copies = copies(&[(10, 30, 60, 4, 34), (44, 12, 40, 14, -22), (0, 9, 80, 20, 25)]);
    let (same, smaller) = (guessed(), guessed_on_smaller());

    for guess in [
        Guess { disparity: &same, by: 1, finer: 1 },
        Guess { disparity: &smaller, by: 1, finer: 2 },
    ] {
        let expected = naive(&copies, guess);
        assert!(expected.len() >= 2, "{expected:?}");

        for level in levels() {
            for threads in [1, 3] {
                assert_eq!(found(&copies, guess, threads, level), expected, "{}", level.name());
            }
        }
    }
}

#[test]
fn what_a_larger_match_says_is_scaled() {
    let copies = copies(&[(10, 30, 60, 4, 34), (0, 9, 80, 20, 25)]);
    let large = Plane::from_fn(2 * SIZE.0, 2 * SIZE.1, |y, x| {
        if (y * x).is_multiple_of(6) { 2.0 * FAR as f32 } else { 99.0 }
    });

    let guess = Guess { disparity: &large, by: 2, finer: 1 };
    assert_eq!(found(&copies, guess, 1, Level::best()), naive(&copies, guess));
}

#[test]
fn a_thin_thing_is_found_where_it_is() {
    let guess = Guess { disparity: &guessed(), by: 1, finer: 1 };
    let found = found(&copies(&[(10, 30, 60, 4, 34)]), guess, 1, Level::best());
    let largest = found.iter().max_by_key(|area| area.gain).expect("one");

    assert_eq!(largest.span, (34, 34));
    assert!((8..=14).contains(&largest.rows.start) && (36..=42).contains(&largest.rows.end));
    assert!(58 <= largest.columns.start && largest.columns.end <= 66);
    assert!(largest.size >= 60 && 10 * largest.seen >= 9 * largest.size, "{largest:?}");
}

#[test]
fn nothing_is_found_where_all_lies_in_the_run() {
    let guess = Guess { disparity: &guessed(), by: 1, finer: 1 };
    assert_eq!(found(&copies(&[]), guess, 1, Level::best()), []);
}
