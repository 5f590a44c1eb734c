//! Pairs matched in bands of rows, with no more around them than they reach: what a match of the whole gives, bit
//! for bit.

mod common;

use std::ops::Range;

use common::maps;
use common::naive::Seen;
use common::parts::{Slow, known_part, rows_of};
use common::{
    OPTIMIZERS, affordable, hash, levels, mask, noises, random, robust, settings, versions, view,
    views,
};
use phasestereo::control::Control;
use phasestereo::error::Error;
use phasestereo::filling;
use phasestereo::intensity;
use phasestereo::map::Map;
use phasestereo::matcher::{Choice, Disparity, Execution, Matcher, Pair, Timings};
use phasestereo::optimization::BAND;
use phasestereo::plane::Plane;
use phasestereo::reach::Reach;
use phasestereo::section::Section;
use phasestereo::settings::{CostKind, LARGEST_PENALTY, Optimizer, Penalty, Precision, Settings};
use phasestereo::simd::Level;
use phasestereo::source::{ranges, roughness, widened};
use phasestereo::texture::{Roughness, Texture};
use phasestereo::versions::Versions;
use phasestereo::view::{Mask, View};
use proptest::prelude::*;
use proptest::sample::{Index, select};

/// What a match may cost: pixels x candidates x sides of window and neighbourhood.
const AFFORDABLE: usize = 1 << 22;

/// A pair to be matched in bands, and what is known of the whole of it.
#[derive(Debug)]
struct Job {
    pair: Pair,
    settings: Settings,
    ranges: [intensity::Range; 2],
    roughness: Roughness,
}

impl Job {
    fn new(pair: Pair, settings: Settings) -> Self {
        let (control, whole) = (Control::default(), pair.size().0);
        let found = ranges(&Slow::new(&pair, whole), &control).expect("all rows");
        let known = pair.clone().with_ranges(found.map(Some));
        let rough = roughness(&Slow::new(&known, whole), Level::best(), &control);
        Self { pair, settings, ranges: found, roughness: rough.expect("all rows") }
    }

    fn reach(&self) -> Reach {
        Reach::new(&self.settings, self.pair.versions())
    }

    fn whole(&self, matcher: &Matcher, how: Execution) -> Seen {
        let found = matcher.run(&self.pair, &self.settings, how, &Control::default());
        Seen::of(found.expect("a legal match"))
    }

    /// Chooses some rows, with no more of the images than they reach.
    fn choose(
        &self,
        rows: &Range<usize>,
        reach: Reach,
        (matcher, how): (&Matcher, Execution),
    ) -> Choice {
        let height = self.pair.size().0;
        let mut read = widened(rows, reach.images, height);
        let is_empty = |mask: &Mask| read.clone().any(|y| !mask.row(y).contains(&true));
        if self.pair.views().iter().filter_map(|view| view.mask.as_ref()).any(is_empty) {
            read = widened(&read, reach.masked, height);
        }
        let section = Section {
            rows: rows.start - read.start..rows.end - read.start,
            first: read.start,
            roughness: Some(self.roughness),
        };
        let pair = without_full_masks(known_part(&self.pair, &read, self.ranges));
        let control = Control::default();
        let mut chosen =
            matcher.choose(&pair, &section, &self.settings, how, &control).expect("a legal part");
        assert_eq!(control.rows_done(), rows.len());
        chosen.texture = chosen.texture.map(|all| all.of_rows(section.rows).expect("these rows"));
        chosen
    }

    /// Refines the rows between each two cuts by themselves.
    fn refined(
        &self,
        draft: &Draft,
        cuts: &[usize],
        reach: usize,
        (matcher, how): (&Matcher, Execution),
    ) -> Seen {
        let refine = |rows: Range<usize>| {
            let around = widened(&rows, reach, self.pair.size().0);
            let (map, texture) = draft.rows(&around);
            let control = Control::default();
            let found = matcher.refine(map, texture.as_ref(), &self.settings, how, &control);
            let wanted = rows.start - around.start..rows.end - around.start;
            Seen::of(of_rows(found.expect("a legal map"), &wanted))
        };
        joined(between(cuts).map(refine))
    }

    /// The whole match in bands, chosen and refined between cuts.
    fn by_bands(&self, chosen: &[usize], refined: &[usize], on: (&Matcher, Execution)) -> Seen {
        let reach = self.reach();
        let parts = between(chosen).map(|rows| Draft::of(self.choose(&rows, reach, on)));
        let draft = parts.reduce(Draft::followed_by).expect("at least one band");
        self.refined(&draft, refined, reach.map, on)
    }

    /// The disparities of one band, as chosen with such a reach.
    fn chosen_rows(
        &self,
        rows: &Range<usize>,
        reach: Reach,
        on: (&Matcher, Execution),
    ) -> Plane<u32> {
        self.choose(rows, reach, on).map.disparity.map(|value| value.to_bits())
    }
}

impl std::fmt::Display for Job {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let (size, candidates) = (self.pair.size(), self.pair.candidates());
        write!(f, "{size:?}, {candidates:?}, {:?}, {:?}", self.settings, self.reach())
    }
}

/// What was chosen of some rows.
struct Draft {
    disparity: Plane<f32>,
    flags: Plane<u16>,
    votes: Option<Plane<f32>>,
    texture: Option<Texture>,
}

impl Draft {
    fn of(Choice { map: Map { disparity, flags, votes }, texture, .. }: Choice) -> Self {
        Self { disparity, flags, votes, texture }
    }

    fn followed_by(self, next: Self) -> Self {
        let gray = |one: Texture, next: Texture| {
            let gray = below(one.gray, &next.gray);
            Texture { gray, ..one }
        };
        Self {
            disparity: below(self.disparity, &next.disparity),
            flags: below(self.flags, &next.flags),
            votes: self.votes.zip(next.votes).map(|(one, next)| below(one, &next)),
            texture: self.texture.zip(next.texture).map(|(one, next)| gray(one, next)),
        }
    }

    fn rows(&self, rows: &Range<usize>) -> (Map, Option<Texture>) {
        let map = Map {
            disparity: rows_of(&self.disparity, rows),
            flags: rows_of(&self.flags, rows),
            votes: self.votes.as_ref().map(|votes| rows_of(votes, rows)),
        };
        let texture = self
            .texture
            .as_ref()
            .map(|texture| Texture { gray: rows_of(&texture.gray, rows), ..*texture });
        (map, texture)
    }
}

/// A plane and another one below it.
fn below<T>(one: Plane<T>, next: &Plane<T>) -> Plane<T>
where
    T: Copy,
{
    let (rows, cols) = (one.rows() + next.rows(), one.cols());
    let mut values = one.into_vec();
    values.extend_from_slice(next.as_slice());
    Plane::from_vec(rows, cols, values).expect("the right length")
}

fn of_rows(found: Disparity, rows: &Range<usize>) -> Disparity {
    Disparity {
        disparity: rows_of(&found.disparity, rows),
        flags: rows_of(&found.flags, rows),
        confidence: found.confidence.map(|plane| rows_of(&plane, rows)),
        timings: Timings::default(),
    }
}

fn joined(parts: impl Iterator<Item = Seen>) -> Seen {
    let join = |mut one: Seen, next: Seen| {
        one.disparity.extend(next.disparity);
        one.flags.extend(next.flags);
        one.confidence =
            one.confidence.zip(next.confidence).map(|(one, next)| [one, next].concat());
        one
    };
    parts.reduce(join).expect("at least one band")
}

/// The rows between each cut and the next.
fn between(cuts: &[usize]) -> impl Iterator<Item = Range<usize>> {
    cuts.windows(2).map(|ends| ends[0]..ends[1])
}

/// A part as a reader may give it: without masks that are true everywhere.
fn without_full_masks(pair: Pair) -> Pair {
    let [left, right] = pair.views().map(|view| {
        let mask = view.mask.clone().filter(|mask| mask.as_slice().contains(&false));
        View { mask, ..view.clone() }
    });
    let (candidates, versions) = (pair.candidates(), pair.versions().cloned());
    let parted = Pair::new(left, right, candidates.min() as i64, candidates.count() as i64);
    parted.expect("a legal pair").with_versions(versions)
}

fn how(threads: usize, level: Level) -> Execution {
    Execution { threads, level }
}

/// Masks of rows here and there, and of all rows of some part.
fn masked(rows: usize, cols: usize, seed: u64) -> Mask {
    let percent = [100, 95, 60, 20][(seed % 4) as usize];
    let lot = |salt: u64| (hash(seed ^ salt, 0, 0) % (rows as u64 + 1)) as usize;
    let (here, empty, few) = (lot(1), lot(2), lot(3) % 100);
    let some = mask(rows, cols, percent, seed);
    let is_full = seed & 8 == 0;
    Mask::from_fn(rows, cols, |y, x| {
        let is_lost = (empty..empty + few).contains(&y);
        let is_valid = (is_full && y < here) || some.row(y)[x];
        is_valid && !is_lost
    })
}

/// Pairs of several bands: of few gray values, so that ties abound, or of many; or small ones of any type.
fn pairs() -> impl Strategy<Value = Pair> {
    let small = (1usize..=20, 1usize..=12, 0u8..4)
        .prop_flat_map(|(rows, cols, kind)| [views(rows, cols, kind), views(rows, cols, kind)]);
    let heights =
        prop_oneof![1 => 1usize..=260, 1 => select(vec![63, 64, 65, 79, 80, 81, 128, 129, 193])];
    let tall = (heights, 1usize..=40, select(vec![1u64, 7, 255]), 0u8..4, any::<u64>()).prop_map(
        |(rows, cols, white, masks, seed)| {
            [0u8, 1].map(|side| {
                let own = seed ^ u64::from(side);
                let shift = if seed & 16 == 0 { 2 * usize::from(side) } else { 0 };
                let noise = seed & 32 == 0;
                let pixel = |y, x: usize| {
                    let scene = hash(seed, y / 2, usize::midpoint(x, shift)) % (white + 1);
                    let lot = hash(own, y, x) % (white + 1);
                    if noise { lot as u8 } else { scene as u8 }
                };
                let is_masked = masks >> side & 1 == 1;
                let mask = is_masked.then(|| masked(rows, cols, hash(own, 1, 1)));
                View { mask, ..view(rows, cols, pixel) }
            })
        },
    );
    (prop_oneof![1 => small, 3 => tall], any::<Index>(), any::<Index>()).prop_map(
        |([left, right], min, count)| {
            let cols = left.image.shape().1;
            let count = 1 + count.index(cols.min(20)) as i64;
            let lowest = 1 - cols as i64 - (count - 1);
            let min = lowest + min.index((2 * cols as i64 + count - 2) as usize) as i64;
            Pair::new(left, right, min, count).expect("in reach")
        },
    )
}

fn noise_alone(noise: [f64; 2]) -> Versions {
    Versions::of_noise(noise).expect("legal noise")
}

fn jobs() -> impl Strategy<Value = Job> {
    let known = prop_oneof![1 => noises().prop_map(noise_alone), 2 => versions()];
    (pairs(), settings(), known).prop_map(|(pair, mut settings, known)| {
        let (rows, cols) = pair.size();
        let places = AFFORDABLE / (rows * cols * pair.candidates().count());
        settings.window = affordable(settings.window, places);
        let (r, s) = settings.frequencies;
        let least = (2 * r.max(s) + 1).max(3);
        settings.neighborhood = affordable(settings.neighborhood, places).max(least);
        let is_phase = settings.cost == CostKind::Phase;
        let known = if is_phase { known } else { noise_alone(known.noise()) };
        Job::new(pair.with_versions(known), settings)
    })
}

/// Cuts through so many rows, the first and the last among them.
fn cuts(height: usize, places: &[Index]) -> Vec<usize> {
    let inner = places.iter().map(|place| place.index(height));
    let mut cuts: Vec<_> = inner.chain([0, height]).collect();
    cuts.sort_unstable();
    cuts.dedup();
    cuts
}

proptest! {
    #![proptest_config(random(150))]

    #[test]
    fn bands_put_together_are_the_whole(
        job in jobs(),
        places in [0, 1].map(|_| prop::collection::vec(any::<Index>(), 0..5)),
        threads in 1usize..=3,
        level in select(levels()),
    ) {
        let [first, second] = places;
        let height = job.pair.size().0;
        let (chosen, refined) = (cuts(height, &first), cuts(height, &second));
        let (matcher, how) = (Matcher::new(threads).expect("threads start"), how(threads, level));
        let expected = job.whole(&matcher, how);
        let found = job.by_bands(&chosen, &refined, (&matcher, how));
        prop_assert!(found == expected, "{:?}, {:?} of {}", chosen, refined, job);
    }
}

/// A scene and the same further left, so that costs range from none to all there are.
fn shifted(rows: usize, cols: usize) -> [View; 2] {
    [0, 2].map(|shift| view(rows, cols, |y, x| hash(9, y, x + shift) as u8))
}

/// A pair with these columns, of which the rows that `masks` says have some invalid pixels.
fn pair(rows: usize, cols: usize, is_masked: impl Fn(usize) -> bool) -> Pair {
    let mask = Mask::from_fn(rows, cols, |y, x| !(is_masked(y) && hash(3, y, x).is_multiple_of(4)));
    let mask = Some(mask).filter(|mask| mask.as_slice().contains(&false));
    let [left, right] = shifted(rows, cols).map(|view| View { mask: mask.clone(), ..view });
    Pair::new(left, right, -1, 9).expect("a legal pair")
}

/// Masks and penalties tell in what integers a part is matched: not always in those of the whole.
#[test]
fn parts_are_matched_in_any_integers() {
    let (height, matcher) = (4 * BAND + 9, Matcher::new(2).expect("threads"));
    let phase = Settings { neighborhood: 5, ..Settings::default() };
    let byte = Settings { precision: Precision::Byte, ..phase };
    let cheap = Penalty { near: 0.05, far: 0.1 };
    let dear = Penalty { near: LARGEST_PENALTY, far: LARGEST_PENALTY };
    let every = [
        Settings { window: 3, penalty: cheap, ..byte },
        Settings { window: 17, penalty: cheap, frequencies: (1, 0), bits: 1, ..byte },
        Settings { window: 5, edges: 0.5, ..phase },
        Settings { window: 3, penalty: dear, ..phase },
        Settings { window: 7, cost: CostKind::Sad, ..phase },
    ];
    for (settings, optimizer) in
        every.iter().flat_map(|settings| OPTIMIZERS.map(|optimizer| (settings, optimizer)))
    {
        let settings = Settings { optimizer, ..settings.clone() };
        for is_masked in [|y: usize| y < 10, |y: usize| y > 3 * BAND] {
            let job = Job::new(pair(height, 40, is_masked), settings.clone());
            let on = (&matcher, how(2, Level::best()));
            let found = job.by_bands(&[0, BAND, BAND + 1, 3 * BAND + 5, height], &[0, height], on);
            assert!(found == job.whole(on.0, on.1), "{job}");
        }
    }
}

/// Several kernels, of as many rows above and below as the largest, in tiles of several classes.
fn two_versions() -> Versions {
    use phasestereo::convolution::Kernel;
    let taps = |side: usize| Plane::from_fn(side, side, |_, _| 1.0 / (side * side) as f64);
    let kernel = |side| Some(Kernel::new(&taps(side)).expect("a legal kernel"));
    let labels = Plane::from_fn(3, 2, |y, x| ((y + x) % 2) as u8);
    let kernels = vec![[None, kernel(7)], [kernel(3), None]];
    Versions::new([1.0; 2], kernels, labels, 40).expect("legal versions")
}

#[test]
fn tall_pairs_in_the_default_way_are_the_whole() {
    let [left, right] =
        shifted(230, 75).map(|view| View { mask: Some(masked(230, 75, 12)), ..view });
    let pair = Pair::new(left, right, 0, 16).expect("a legal pair").with_versions(two_versions());
    let job = Job::new(pair, robust());
    let matcher = Matcher::new(2).expect("threads");
    for level in levels() {
        let on = (&matcher, how(1, level));
        let found = job.by_bands(&[0, 1, 63, 96, 128, 230], &[0, 1, 50, 51, 229, 230], on);
        assert!(found == job.whole(on.0, on.1), "{}", level.name());
    }
}

/// Settings that choose by windows and neighbourhoods of several sizes, in all ways.
fn ways_to_choose() -> Vec<(Settings, Option<Versions>)> {
    let alone = Optimizer::WinnerTakesAll;
    let phase = Settings { optimizer: alone, neighborhood: 3, window: 3, ..Settings::default() };
    let phase = Settings { frequencies: (1, 1), ..phase };
    // What rows far away cost is not forgotten on the way where changes are dear.
    let penalty = Penalty { near: 1e4, far: 1e4 };
    let several = Settings { optimizer: Optimizer::SemiGlobal, penalty, ..phase };
    let ordered = Settings { optimizer: Optimizer::DynamicProgramming, ..phase };
    vec![
        (Settings { shiftable: false, ..phase }, None),
        (phase.clone(), None),
        (Settings { neighborhood: 9, window: 1, ..phase }, None),
        (Settings { window: 9, shiftable: false, ..phase }, None),
        (Settings { window: 1, ..phase }, Some(two_versions())),
        (Settings { cost: CostKind::Sad, window: 5, ..phase }, None),
        (Settings { cost: CostKind::NormalisedSad, window: 5, ..phase }, None),
        (Settings { shiftable: false, ..several }, None),
        (Settings { window: 1, edges: 1.0, ..several }, Some(two_versions())),
        (Settings { cost: CostKind::Sad, window: 1, ..several }, None),
        (Settings { shiftable: true, ..ordered }, None),
    ]
}

#[test]
fn no_less_than_the_reach_would_do_for_what_is_chosen() {
    let matcher = Matcher::new(1).expect("a thread");
    let on = (&matcher, how(1, Level::best()));
    for (settings, known) in ways_to_choose() {
        let (mut is_first_unlike, mut is_last_unlike) = (false, false);
        for seed in 0..12 {
            let [left, right] =
                [seed, !seed].map(|seed| view(280, 60, |y, x| hash(seed, y, x) as u8));
            let pair = Pair::new(left, right, 0, 30).expect("a legal pair");
            let job = Job::new(pair.with_versions(known.clone()), settings.clone());
            // The last row of a band, and the first of the next one, reach furthest.
            let (reach, rows) = (job.reach(), 2 * BAND - 1..2 * BAND + 1);
            let enough = job.chosen_rows(&rows, reach, on);
            let more = Reach { images: reach.images + 40, ..reach };
            assert_eq!(enough, job.chosen_rows(&rows, more, on), "{job}");
            let less = job.chosen_rows(&rows, Reach { images: reach.images - 1, ..reach }, on);
            is_first_unlike |= enough.row(0) != less.row(0);
            is_last_unlike |= enough.row(1) != less.row(1);
        }
        assert!(is_first_unlike && is_last_unlike, "{settings:?}");
    }
}

/// Each way to refine by itself, on maps of which it makes something.
fn ways_to_refine() -> Vec<Settings> {
    let nothing = Settings { confidence: false, ..Settings::default() };
    vec![
        nothing.clone(),
        Settings { speckle_size: 12, fill: false, ..nothing },
        Settings { consistency: Some(1), ..nothing },
        Settings { guided: true, ..nothing },
        Settings { median: 3, ..nothing },
        Settings { subpixel: true, ..nothing },
        Settings { confidence: true, ..nothing },
        Settings { min_confidence: 0.5, ..nothing },
        Settings { guided: true, median: 3, subpixel: true, confidence: true, ..nothing },
        Settings { speckle_size: 3, guided: true, uniqueness: 10, ..robust() },
    ]
}

/// Rows in which nothing is trusted, of any number.
fn lost(seed: u64) -> Range<usize> {
    let first = (hash(seed, 1, 1) % 150) as usize;
    first..first + (hash(seed, 2, 2) % 80) as usize
}

fn draft(seed: u64, percent: u64) -> Draft {
    let maps::Map { disparity, flags } = maps::Map::random((150, 24), percent, seed);
    let lost = lost(seed);
    let flags = Plane::from_fn(150, 24, |y, x| {
        let flag = if lost.contains(&y) { phasestereo::refinement::flag::OCCLUDED } else { 0 };
        flags.row(y)[x] | flag
    });
    let votes = Plane::from_fn(150, 24, |y, x| (hash(seed ^ 8, y, x) % 100) as f32 / 100.0);
    let gray = Plane::from_fn(150, 24, |y, x| (hash(seed ^ 9, y / 3, x / 3) % 30) as i32);
    let texture = Some(Texture::new(gray));
    Draft { disparity, flags, votes: Some(votes), texture }
}

/// Whether a draft refined in two parts with such a reach is that refined as a whole.
fn is_whole(job: &Job, draft: &Draft, cut: usize, reach: usize, on: (&Matcher, Execution)) -> bool {
    let all = job.refined(draft, &[0, 150], 0, on);
    job.refined(draft, &[0, cut, 150], reach, on) == all
}

#[test]
fn refinement_needs_its_reach_and_no_more() {
    let matcher = Matcher::new(1).expect("a thread");
    let on = (&matcher, how(1, Level::best()));
    for settings in ways_to_refine() {
        // What several stages reach together is not always needed, and what speckles and edges reach is told by
        // other maps.
        let stages = [settings.speckle_size > 0, settings.guided];
        let is_one = !stages.contains(&true);
        let job = Job::new(pair(150, 24, |_| false), settings);
        let reach = job.reach().map;
        let mut is_tight = reach == 0;
        for seed in 0..400 {
            let percent = [0, 3, 20, 60, 97][seed as usize % 5];
            // Anywhere, or as far from what is trusted as filling looks.
            let any = 1 + (hash(seed, 0, 0) % 149) as usize;
            let far = (lost(seed).end + 1).saturating_sub(filling::REACH).clamp(1, 149);
            let (draft, cut) = (draft(seed, percent), if seed % 2 == 0 { any } else { far });
            assert!(is_whole(&job, &draft, cut, reach, on), "seed {seed}, {job}");
            is_tight |= is_one && reach > 0 && !is_whole(&job, &draft, cut, reach - 1, on);
            if seed > 60 && (is_tight || !is_one) {
                break;
            }
        }
        assert!(is_tight || !is_one, "{job}");
    }
}

/// The last row that a pixel is near a jump of is the one above it.
#[test]
fn edges_are_drawn_to_jumps_as_far_as_they_reach() {
    let matcher = Matcher::new(1).expect("a thread");
    let on = (&matcher, how(1, Level::best()));
    let settings = Settings { guided: true, confidence: false, ..Settings::default() };
    let job = Job::new(pair(150, 24, |_| false), settings);
    let reach = job.reach().map;
    for cut in [60, 61, 75] {
        let calm = |y: usize, x: usize| (hash(6, y, x) % 4) as f32 / 4.0;
        let step = |y: usize| if y + 1 >= cut + reach { 5.0 } else { 0.0 };
        let draft = Draft {
            disparity: Plane::from_fn(150, 24, |y, x| calm(y, x) + step(y)),
            flags: Plane::from_fn(150, 24, |_, _| 0),
            ..draft(1, 0)
        };
        assert!(is_whole(&job, &draft, cut, reach, on), "{cut}");
        assert!(!is_whole(&job, &draft, cut, reach - 1, on), "{cut}");
    }
}

/// A column of so many pixels that stands out hangs on to more than a speckle has, or not, that many rows away.
#[test]
fn speckles_are_as_large_as_they_reach() {
    let matcher = Matcher::new(1).expect("a thread");
    let on = (&matcher, how(1, Level::best()));
    let settings =
        Settings { speckle_size: 20, fill: false, confidence: false, ..Settings::default() };
    let job = Job::new(pair(150, 24, |_| false), settings);
    let reach = job.reach().map;
    let column = |length: usize| Draft {
        disparity: Plane::from_fn(150, 24, |y, x| {
            if x == 7 && (60..60 + length).contains(&y) { 9.0 } else { 1.0 }
        }),
        flags: Plane::from_fn(150, 24, |_, _| 0),
        votes: None,
        texture: None,
    };
    for length in [19, 20, 21, 22] {
        for cut in [59, 60, 61, 70, 79, 80, 81, 82] {
            assert!(is_whole(&job, &column(length), cut, reach, on), "{length}, {cut}");
        }
    }
    assert!(!is_whole(&job, &column(21), 61, 19, on));
}

#[test]
fn rows_that_copy_others_need_those() {
    let matcher = Matcher::new(1).expect("a thread");
    let on = (&matcher, how(1, Level::best()));
    let settings = Settings { neighborhood: 9, window: 1, ..Settings::default() };
    // The nearest valid row above a band that is valid itself is where the neighbourhoods of its first rows end.
    let valid = |y: usize| y >= 64 || (50..62).contains(&y);
    let views = [5, 6].map(|seed| View {
        mask: Some(Mask::from_fn(160, 60, |y, _| valid(y))),
        ..view(160, 60, |y, x| hash(seed, y, x) as u8)
    });
    let [left, right] = views;
    let job = Job::new(Pair::new(left, right, 0, 30).expect("a legal pair"), settings);
    let reach = job.reach();
    for rows in [63..70, 64..70, 65..70, 66..160, 61..64] {
        let found = job.chosen_rows(&rows, reach, on);
        let whole = job.chosen_rows(&(0..160), reach, on);
        assert_eq!(found, rows_of(&whole, &rows), "{rows:?}");
    }
    let close = Reach { images: 2, masked: 0, ..reach };
    let enough = Reach { images: 2, ..reach };
    let rows = 66..67;
    let whole = job.chosen_rows(&rows, reach, on);
    assert_eq!(job.chosen_rows(&rows, Reach { images: 4, ..enough }, on), whole);
    assert_ne!(job.chosen_rows(&rows, close, on), whole);
}

/// The message of what is refused.
fn refused<T>(found: Result<T, Error>) -> String {
    match found {
        Err(error @ Error::Value { .. }) => error.to_string(),
        Err(error) => panic!("{error}"),
        Ok(_) => panic!("it must be refused"),
    }
}

#[test]
fn rows_that_the_pair_has_not_are_refused() {
    let (matcher, control) = (Matcher::new(1).expect("a thread"), Control::default());
    let whole = pair(70, 40, |_| false);
    let choose = |optimizer, rows| {
        let settings = Settings { optimizer, ..Settings::default() };
        let section = Section { rows, ..Section::whole(&whole) };
        matcher.choose(&whole, &section, &settings, how(1, Level::best()), &control)
    };
    for optimizer in OPTIMIZERS {
        #[expect(clippy::reversed_empty_ranges, reason = "that is the point")]
        for rows in [0..71, 70..71, 7..7, 70..70, 9..5, 0..usize::MAX] {
            let message = refused(choose(optimizer, rows));
            assert!(message.starts_with("rows: got "), "{message}");
        }
        choose(optimizer, 64..70).expect("a whole band");
        choose(optimizer, 31..33).expect("any rows");
    }
}

#[test]
fn maps_that_do_not_fit_are_refused() {
    let matcher = Matcher::new(1).expect("a thread");
    let all = Settings { guided: true, median: 3, ..Settings::default() };
    let neither = Settings { confidence: false, ..Settings::default() };
    let guided = Settings { guided: true, ..neither };
    let draft = draft(1, 3);
    let refine = |map: Map, texture: Option<&Texture>, settings: &Settings| {
        matcher.refine(map, texture, settings, how(1, Level::best()), &Control::default())
    };
    let (fits, less, none) = (0..40, 0..39, 0..0);
    let map = || draft.rows(&fits).0;
    let texture = |rows| draft.rows(rows).1;
    refine(map(), texture(&fits).as_ref(), &all).expect("they fit");
    refine(Map { votes: None, ..map() }, None, &neither).expect("nothing else is needed");
    refine(Map { votes: None, ..map() }, texture(&fits).as_ref(), &guided).expect("no votes");

    for rows in [&less, &none] {
        let other = || draft.rows(rows).0;
        let wrong = [
            (Map { flags: other().flags, ..map() }, texture(&fits)),
            (Map { disparity: other().disparity, ..map() }, texture(&fits)),
            (Map { votes: other().votes, ..map() }, texture(&fits)),
            (map(), texture(rows)),
        ];
        for (map, texture) in wrong {
            let message = refused(refine(map, texture.as_ref(), &all));
            assert!(message.starts_with("map: got ("), "{message}");
        }
    }
    let missing = [
        (Map { votes: None, ..map() }, texture(&fits), &all),
        (map(), None, &all),
        (map(), None, &guided),
    ];
    for (map, texture, settings) in missing {
        let message = refused(refine(map, texture.as_ref(), settings));
        assert!(message.starts_with("map: got None; accepts votes and gray"), "{message}");
    }
}

#[test]
fn texture_of_rows_beyond_the_image_is_refused() {
    let texture = draft(1, 3).texture.expect("there is one");
    let roughness = texture.roughness;
    let some = texture.clone().of_rows(3..9).expect("it has them");
    assert_eq!((some.gray, some.roughness), (rows_of(&texture.gray, &(3..9)), roughness));
    let message = refused(texture.of_rows(149..151));
    assert_eq!(message, "left: got 150 rows; accepts at least 151");
}

/// Of one version all rows are alike, and of labels those that the whole has there.
#[test]
fn parts_are_of_the_classes_of_the_whole() {
    let whole = two_versions();
    for first in [0, 1, 39, 40, 41, 79, 80, 81, 119, 120, 1000] {
        let part = two_versions().from_row(first);
        for (y, x) in [(0, 0), (1, 39), (38, 40), (39, 90), (40, 0), (80, 0), (500, 500)] {
            assert_eq!(part.class(y, x), whole.class(first + y, x), "{first}: {y}, {x}");
        }
    }
}
