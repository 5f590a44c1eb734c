//! Areas outside the run of disparities: compared with a naive search, and with the places where objects were
//! put.

use crate::common::{hash, levels};
use crate::reference;
use phasestereo::internals::estimation::areas::{Area, areas, fine_areas};
use phasestereo::internals::estimation::overview::{Guess, Overview};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::{Execution, Matcher};
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::Settings;
use phasestereo_match::settings::presets::Preset;
use std::collections::{BTreeMap, HashMap, HashSet};

/// Rows and columns of the copies.
const SIZE: (usize, usize) = (61, 117);
/// Disparity of the background, and the run that holds it.
const FAR: isize = 3;
const RUN: (isize, isize) = (1, 6);
const REACH: (isize, isize) = (-30, 52);

fn noise(salt: u64, y: usize, x: usize) -> f32 {
    (hash(salt, y, x) % 256) as f32 / 2.0
}

/// An object in front of a background: top, rows, first column of the left image, columns, disparity.
type Thing = (usize, usize, usize, usize, isize);

/// Copies of a background with objects in front of it.
fn copies(things: &[Thing]) -> Overview {
    copies_of(SIZE, FAR, things)
}

/// The same, with a given size and background disparity.
fn copies_of(size: (usize, usize), far: isize, things: &[Thing]) -> Overview {
    let background = |y: usize, x: isize| noise(1, y, (x + 500) as usize);
    let seen = |y: usize, x: usize, is_right: bool| {
        let shift = |disparity: isize| if is_right { disparity } else { 0 };
        let thing = things.iter().enumerate().find(|(_, (top, rows, first, columns, disparity))| {
            let column = x as isize + shift(*disparity) - *first as isize;
            (*top..top + rows).contains(&y) && (0..*columns as isize).contains(&column)
        });

        match thing {
            Some((number, (.., disparity))) => {
                noise(number as u64 + 2, y, (x as isize + shift(*disparity) + 500) as usize)
            }
            None => background(y, x as isize + shift(far)),
        }
    };

    let plane = |is_right| Plane::from_fn(size.0, size.1, |y, x| seen(y, x, is_right));
    let valid = Plane::from_fn(size.0, size.1, |y, x| y > 2 || x > 20);
    Overview { factor: 1, planes: [plane(false), plane(true)], valid }
}

/// A rough match of copies of the same size that found the background, with errors and gaps.
fn guessed() -> Plane<f32> {
    Plane::from_fn(SIZE.0, SIZE.1, |y, x| match hash(99, y, x) % 16 {
        0 => f32::NAN,
        1 => FAR as f32 + 1.0,
        _ if x < 5 => f32::NAN,
        _ => FAR as f32,
    })
}

/// The rough match of copies of half the size.
fn guessed_on_smaller() -> Plane<f32> {
    let (rows, cols) = (SIZE.0 / 2, SIZE.1 / 2);
    Plane::from_fn(rows, cols, |y, x| if hash(98, y, x).is_multiple_of(9) { f32::NAN } else { 2.0 })
}

fn found(copies: &Overview, guess: Guess, threads: usize, level: Level) -> Vec<Area> {
    run(threads, level, |runtime| areas(copies, guess, RUN, REACH, None, runtime))
}

fn run(threads: usize, level: Level, search: impl FnOnce(Runtime) -> Result<Vec<Area>> + Send) -> Vec<Area> {
    let matcher = Matcher::new(threads).expect("threads");
    let control = Control::default();
    let runtime = Runtime { matcher: &matcher, execution: Execution { threads, level }, control: &control };

    matcher.install(|| search(runtime)).expect("it runs")
}

/// The sums of a pixel over its window by disparity; `None` if the match lies outside the image.
struct Sums {
    costs: Plane<u16>,
    cols: usize,
    low: isize,
    count: usize,
    /// Rows, and columns, on either side of the middle of a window.
    around: (isize, isize),
}

/// Windows of copies, of those by which finer ones are searched, and of the finer ones.
const TALL: (isize, isize) = (4, 1);
const FLAT: (isize, isize) = (1, 2);
const SQUARE: (isize, isize) = (2, 2);

impl Sums {
    fn new([left, right]: [&Plane<f32>; 2], (low, high): (isize, isize), around: (isize, isize)) -> Self {
        let cols = left.cols();
        let count = (high - low + 1) as usize;
        let candidates = Candidates::new(low as i64, count as i64, cols).expect("legal");
        let settings = Settings { neighborhood: 3, frequencies: (1, 1), ..Preset::Paper.settings() };

        // Gray values are in 128ths.
        let codes = |plane: &Plane<f32>| {
            reference::describe_roughly(&plane.map(|value| (128.0 * value) as i32), &settings)
        };
        let costs = reference::phase_costs(&codes(left), &codes(right), candidates);
        Self { costs, cols, low, count, around }
    }

    /// The pixels of the window of a pixel.
    fn window(&self, y: usize, x: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let clamped =
            |at: usize, by: isize, length: usize| (at as isize + by).clamp(0, length as isize - 1) as usize;
        let (up, across) = self.around;
        let places = (-up..=up).flat_map(move |dy| (-across..=across).map(move |dx| (dy, dx)));
        places.map(move |(dy, dx)| (clamped(y, dy, self.costs.rows()), clamped(x, dx, self.cols)))
    }

    /// The cost of one pixel.
    fn cost(&self, y: usize, x: usize, disparity: isize) -> u64 {
        u64::from(self.costs.row(y)[x * self.count + (disparity - self.low) as usize])
    }

    fn sees(&self, x: usize, disparity: isize) -> bool {
        (self.low..self.low + self.count as isize).contains(&disparity)
            && (0..self.cols as isize).contains(&(x as isize - disparity))
    }

    fn at(&self, y: usize, x: usize, disparity: isize) -> Option<u64> {
        let sum = || self.window(y, x).map(|(y, x)| self.cost(y, x, disparity)).sum();
        self.sees(x, disparity).then(sum)
    }

    /// The sum with a separate disparity for every pixel of the window; matches outside the image are on its
    /// border.
    fn along(&self, y: usize, x: usize, disparity: impl Fn(usize, usize) -> isize) -> u64 {
        self.window(y, x).map(|(y, x)| self.cost(y, x, disparity(y, x))).sum()
    }

    /// The smallest sum over some disparities, and the first that has it.
    fn least(&self, y: usize, x: usize, is_one: impl Fn(isize) -> bool) -> (u64, isize) {
        (self.low..self.low + self.count as isize)
            .filter(|disparity| is_one(*disparity))
            .filter_map(|disparity| self.at(y, x, disparity).map(|sum| (sum, disparity)))
            .min_by_key(|(sum, _)| *sum)
            .unwrap_or((255, isize::MIN))
    }
}

/// A place, its disparity and its gain.
type Member = ((usize, usize), (isize, u64));

/// A run of disparities, and those to try.
#[derive(Clone, Copy)]
struct Tried {
    run: (isize, isize),
    reach: (isize, isize),
}

const TRIED: Tried = Tried { run: RUN, reach: REACH };

fn median(mut sums: Vec<u64>) -> u64 {
    sums.sort_unstable();
    sums[sums.len() / 2]
}

/// The block of a pixel.
fn block((y, x): (usize, usize)) -> (usize, usize) {
    (y / 8, x / 8)
}

/// The pixels that cost much along the run, by definition.
fn doubtful(
    copies: &Overview,
    guess: Guess,
    tried: Tried,
    around: (isize, isize),
) -> HashSet<(usize, usize)> {
    let planes = copies.planes.each_ref();
    let (rows, cols) = (planes[0].rows(), planes[0].cols());
    let forward = Sums::new(planes, tried.reach, around);
    let run = Sums::new(planes, tried.run, around);
    let pixels: Vec<(usize, usize)> = (0..rows).flat_map(|y| (0..cols).map(move |x| (y, x))).collect();

    let middle = (tried.run.0 + tried.run.1).div_euclid(2);
    let is_judged = |(y, x): &(usize, usize)| {
        copies.valid.row(*y)[*x] && (0..cols as isize).contains(&(*x as isize - middle))
    };
    // The disparity that the rough match found at a pixel, or left of it.
    let rough = |y: usize, x: usize| {
        let plane = guess.disparity;
        let row = plane.row((y * guess.by / guess.finer).min(plane.rows() - 1));
        let at = |x: usize| row[(x * guess.by / guess.finer).min(plane.cols() - 1)];
        let known = (0..=x).rev().map(at).find(|value| !value.is_nan());
        let scaled = |value: f32| value * guess.finer as f32 / guess.by as f32;
        known.map_or(isize::midpoint(tried.run.0, tried.run.1), |value| {
            scaled(value).round_ties_even() as isize
        })
    };
    let within = guess.finer as isize / 2;
    let guessed = |(y, x): (usize, usize)| {
        let sums = (-within..=within).map(|off| forward.along(y, x, |y, x| rough(y, x) + off));
        sums.min().expect("one")
    };
    let guessed: Vec<u64> = pixels.iter().map(|at| guessed(*at)).collect();
    let judged = pixels.iter().zip(&guessed).filter(|(at, _)| is_judged(at));
    let usual = median(judged.map(|(_, sum)| *sum).collect());

    let bits = 8 * (2 * around.0 + 1) * (2 * around.1 + 1);
    let mut most = usual + bits as u64 / 8;
    if around != TALL {
        let other = Plane::from_fn(rows, cols, |y, x| planes[1].row((y + rows / 2) % rows)[x]);
        most = most.min(u64::midpoint(usual, chance([planes[0], &other], tried.run, around)));
    }

    let many = |pixels: &mut dyn Iterator<Item = (usize, usize)>| {
        let mut counts = HashMap::new();
        let all: Vec<(usize, usize)> = pixels.collect();
        for at in &all {
            *counts.entry(block(*at)).or_insert(0) += 1;
        }
        all.into_iter().filter(move |at| counts[&block(*at)] >= 10).collect::<HashSet<_>>()
    };
    let is_asked = |(y, x): &(usize, usize)| guess.judged.is_none_or(|all| all.row(*y)[*x]);
    let is_judged = |at: &(usize, usize)| is_judged(at) && is_asked(at);
    let much = pixels.iter().zip(&guessed).filter(|(at, sum)| is_judged(at) && **sum > most);
    let first: HashSet<_> = many(&mut much.map(|(at, _)| *at)).into_iter().map(block).collect();
    let along = |(y, x): (usize, usize)| run.least(y, x, |_| true).0;
    let is_one = |at: &(usize, usize)| is_judged(at) && first.contains(&block(*at)) && along(*at) > most;
    pixels.into_iter().filter(is_one).collect()
}

/// The median of the smallest sums of unrelated rows along the run, in blocks all over the image.
fn chance(planes: [&Plane<f32>; 2], run: (isize, isize), around: (isize, isize)) -> u64 {
    let along = Sums::new(planes, run, around);
    let (rows, cols) = (planes[0].rows(), planes[0].cols());
    let width = cols.div_ceil(8);
    let step = (rows.div_ceil(8) * width / 64) | 1;
    let pixels = (0..rows).flat_map(|y| (0..cols).map(move |x| (y, x)));
    let sampled = pixels.filter(|at| (block(*at).0 * width + block(*at).1).is_multiple_of(step));
    median(sampled.map(|(y, x)| along.least(y, x, |_| true).0).filter(|sum| *sum > 0).collect())
}

/// The members connected over up to two rows and columns by disparities that differ by at most one.
fn connected(found: &[Member]) -> Vec<Vec<Member>> {
    let mut open: BTreeMap<(usize, usize), (isize, u64)> = found.iter().copied().collect();
    let mut groups = vec![];
    while let Some(first) = open.pop_first() {
        let mut members = vec![first];
        let mut next = 0;
        while next < members.len() {
            let ((y, x), (disparity, _)) = members[next];
            next += 1;
            for (row, column) in (y.saturating_sub(2)..=y + 2)
                .flat_map(|row| (x.saturating_sub(2)..=x + 2).map(move |x| (row, x)))
            {
                if open.get(&(row, column)).is_some_and(|(other, _)| (other - disparity).abs() <= 1) {
                    members.extend(open.remove_entry(&(row, column)));
                }
            }
        }
        groups.push(members);
    }
    groups
}

/// What stands out: the disparity outside the run with the smallest sum, and its gain.
fn standing_out(
    least: impl Fn(&dyn Fn(isize) -> bool) -> (u64, isize),
    run: (isize, isize),
) -> Option<(isize, u64)> {
    let is_along = |disparity: isize| (run.0 - 1..=run.1 + 1).contains(&disparity);
    let (own, disparity) = least(&|disparity| !is_along(disparity));
    let others = least(&|other| is_along(other) || (other - disparity).abs() > 2).0;
    (8 * own < 7 * others).then(|| (disparity, others - own))
}

/// The areas of these pixels by definition.
fn areas_of(
    planes: [&Plane<f32>; 2],
    tried: Tried,
    around: (isize, isize),
    is_searched: impl Fn((usize, usize)) -> bool,
) -> Vec<Area> {
    let Tried { run, reach } = tried;
    let forward = Sums::new(planes, reach, around);
    let back = Sums::new([planes[1], planes[0]], (-reach.1, -reach.0), around);
    let (rows, cols) = (planes[0].rows(), planes[0].cols());
    let pixels = (0..rows).flat_map(|y| (0..cols).map(move |x| (y, x)));
    let found: Vec<Member> = pixels
        .filter(|at| is_searched(*at))
        .filter_map(|at| {
            let one = standing_out(|is_one| forward.least(at.0, at.1, is_one), run)?;
            Some((at, one))
        })
        .collect();

    let is_seen = |((y, x), (disparity, _)): &Member| {
        let column = (*x as isize - disparity) as usize;
        (back.least(*y, column, |_| true).1 + disparity).abs() <= 2
    };
    let area = |members: Vec<Member>| {
        let ends = |of: &dyn Fn(&Member) -> isize| {
            let values = members.iter().map(of);
            (values.clone().min().expect("one"), values.max().expect("one"))
        };
        let (top, bottom) = ends(&|member| member.0.0 as isize);
        let (first, last) = ends(&|member| member.0.1 as isize);
        Area {
            rows: top as usize..bottom as usize + 1,
            columns: first as usize..last as usize + 1,
            span: ends(&|member| member.1.0),
            size: members.len(),
            seen: members.iter().filter(|member| is_seen(member)).count(),
            gain: members.iter().map(|member| member.1.1).sum(),
        }
    };
    connected(&found).into_iter().filter(|members| members.len() >= 12).map(area).collect()
}

/// The areas of copies by definition.
fn naive(copies: &Overview, guess: Guess) -> Vec<Area> {
    let doubtful = doubtful(copies, guess, TRIED, TALL);
    let count = |at| doubtful.iter().filter(|other| block(**other) == block(at)).count();
    areas_of(copies.planes.each_ref(), TRIED, TALL, |at| count(at) >= 10)
}

/// The areas of finer copies by definition.
fn naive_fine([finer, copies]: [&Overview; 2], guess: Guess, tried: Tried) -> Vec<Area> {
    let by = copies.factor / finer.factor;
    let scaled = |(low, high): (isize, isize)| (low.div_euclid(by as isize), high.div_euclid(by as isize));
    let coarse = Tried { run: scaled(tried.run), reach: scaled(tried.reach) };
    let doubtful = doubtful(copies, guess, coarse, FLAT);

    let planes = finer.planes.each_ref();
    let (rows, cols) = (planes[0].rows(), planes[0].cols());
    let alone = Sums::new(planes, tried.reach, (0, 0));
    let is_voter = |(y, x): &(usize, usize)| doubtful.contains(&(y / by, x / by));
    let vote = |at: (usize, usize)| -> Option<Member> {
        let within = (8 * at.0..(8 * at.0 + 8).min(rows))
            .flat_map(|y| (8 * at.1..(8 * at.1 + 8).min(cols)).map(move |x| (y, x)));
        let voters: Vec<(usize, usize)> = within.filter(is_voter).collect();
        let of_disparity = |disparity: isize| -> u64 {
            let even = voters.iter().filter(|(y, _)| y % 2 == 0);
            even.map(|(y, x)| alone.cost(*y, *x, disparity)).sum::<u64>().min(255)
        };
        let least = |is_one: &dyn Fn(isize) -> bool| {
            (tried.reach.0..=tried.reach.1)
                .filter(|disparity| is_one(*disparity) && alone.sees(8 * at.1, *disparity))
                .map(|disparity| (of_disparity(disparity), disparity))
                .min_by_key(|(sum, _)| *sum)
                .unwrap_or((255, isize::MIN))
        };
        // A voter of the copies represents a square here, also beyond the last row or column.
        let count = doubtful.iter().filter(|(y, x)| (y * by / 8, x * by / 8) == at).count();
        (count * by * by >= 10).then(|| standing_out(least, tried.run)).flatten().map(|one| (at, one))
    };
    let blocks = (0..rows.div_ceil(8)).flat_map(|y| (0..cols.div_ceil(8)).map(move |x| (y, x)));
    let votes: Vec<Member> = blocks.filter_map(vote).collect();
    let mut nominated = HashSet::new();
    for members in connected(&votes) {
        if members.iter().map(|member| member.1.1).sum::<u64>() >= 15 {
            for ((y, x), _) in members {
                nominated.extend(
                    (y.saturating_sub(1)..=y + 1)
                        .flat_map(|y| (x.saturating_sub(1)..=x + 1).map(move |x| (y, x))),
                );
            }
        }
    }
    areas_of(planes, tried, SQUARE, |at| nominated.contains(&block(at)))
}

#[test]
fn areas_are_those_of_the_definition() {
    let copies = copies(&[(10, 30, 60, 4, 34), (44, 12, 40, 14, -22), (0, 9, 80, 20, 25)]);
    let (same, smaller) = (guessed(), guessed_on_smaller());

    for guess in [
        Guess { disparity: &same, by: 1, finer: 1, judged: None },
        Guess { disparity: &smaller, by: 1, finer: 2, judged: None },
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

/// Objects a few pixels high or wide in front of a background, as finer copies show them, and these copies
/// reduced.
fn fine_copies() -> [Overview; 2] {
    let things = [(30, 5, 110, 60, 61), (60, 60, 140, 5, 70), (90, 9, 60, 9, 48)];
    let finer = copies_of((122, 234), 4, &things);
    let half = |plane: &Plane<f32>| {
        Plane::from_fn(61, 117, |y, x| {
            let [above, below] = [plane.row(2 * y), plane.row(2 * y + 1)];
            (above[2 * x] + above[2 * x + 1] + below[2 * x] + below[2 * x + 1]) / 4.0
        })
    };
    let planes = finer.planes.each_ref().map(half);
    let valid = Plane::from_fn(61, 117, |y, x| y > 2 || x > 20);
    [finer, Overview { factor: 2, planes, valid }]
}

#[test]
fn areas_of_finer_copies_are_those_of_the_definition() {
    let [finer, copies] = fine_copies();
    let tried = Tried { run: (2, 11), reach: (-10, 100) };
    let is_unknown = |y: usize, x: usize| hash(97, y, x).is_multiple_of(16);
    let guess = Plane::from_fn(61, 117, |y, x| if is_unknown(y, x) { f32::NAN } else { 2.0 });
    let guess = Guess { disparity: &guess, by: 1, finer: 1, judged: None };
    let expected = naive_fine([&finer, &copies], guess, tried);
    let holds = |disparity| expected.iter().any(|area| area.span == (disparity, disparity));
    assert!(holds(61) && holds(70), "a bar across and a pole: {expected:?}");
    let upper = Plane::from_fn(61, 117, |y, _| y < 30);
    let asked = Guess { judged: Some(&upper), ..guess };
    assert_ne!(naive_fine([&finer, &copies], asked, tried), expected);

    for guess in [guess, asked] {
        let expected = naive_fine([&finer, &copies], guess, tried);
        for (level, threads) in levels().into_iter().flat_map(|level| [(level, 1), (level, 3)]) {
            let found = run(threads, level, |runtime| {
                fine_areas([&finer, &copies], guess, tried.run, tried.reach, None, runtime)
            });
            assert_eq!(found, expected, "{}", level.name());
        }
    }
}

#[test]
fn what_a_larger_match_says_is_scaled() {
    let copies = copies(&[(10, 30, 60, 4, 34), (0, 9, 80, 20, 25)]);
    let large = Plane::from_fn(2 * SIZE.0, 2 * SIZE.1, |y, x| {
        if (y * x).is_multiple_of(6) { 2.0 * FAR as f32 } else { 99.0 }
    });

    let guess = Guess { disparity: &large, by: 2, finer: 1, judged: None };
    assert_eq!(found(&copies, guess, 1, Level::best()), naive(&copies, guess));
}

#[test]
fn a_thin_thing_is_found_where_it_is() {
    let guess = Guess { disparity: &guessed(), by: 1, finer: 1, judged: None };
    let found = found(&copies(&[(10, 30, 60, 4, 34)]), guess, 1, Level::best());
    let largest = found.iter().max_by_key(|area| area.gain).expect("one");

    assert_eq!(largest.span, (34, 34));
    assert!((8..=14).contains(&largest.rows.start) && (36..=42).contains(&largest.rows.end));
    assert!(58 <= largest.columns.start && largest.columns.end <= 66);
    assert!(largest.size >= 60 && 10 * largest.seen >= 9 * largest.size, "{largest:?}");
}

#[test]
fn nothing_is_found_where_all_lies_in_the_run() {
    let guess = Guess { disparity: &guessed(), by: 1, finer: 1, judged: None };
    assert_eq!(found(&copies(&[]), guess, 1, Level::best()), []);
}
