//! Pairs matched in parts, with only their halo of rows around them, give the bits of a match of the whole.

use std::ops::Range;

use crate::common::maps;
use crate::common::naive::ResultBits;
use crate::common::parts::{Slow, Stored, rows_of};
use crate::common::{
    LARGEST_PENALTY, OPTIMIZERS, affordable, blur_compensation, hash, input, inputs, levels, mask, noises,
    random, robust, settings,
};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Error;
use phasestereo_match::base::plane::{Plane, widened};
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::pixels::Input;
use phasestereo_match::image::texture::{Roughness, Texture};
use phasestereo_match::image::view::Mask;
use phasestereo_match::matcher::halo::Halo;
use phasestereo_match::matcher::section::Section;
use phasestereo_match::matcher::{Disparity, Execution, Matcher, Timings};
use phasestereo_match::optimization::BAND;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::pair::plan::Plan;
use phasestereo_match::pair::source::roughness;
use phasestereo_match::refinement::calibration::{Tally, sampled};
use phasestereo_match::refinement::{Draft, flag};
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{CostKind, Optimizer, Precision, Settings};
use proptest::prelude::*;
use proptest::sample::{Index, select};

/// Limit on the work of a match: pixels x candidates x sides of window and neighborhood.
const AFFORDABLE: usize = 1 << 22;

/// The halo of a pair that does not need straightening.
fn halo(settings: &Settings, compensation: Option<&BlurCompensation>) -> Halo {
    Halo::new(Plan { settings, compensation, alignment: None })
}

/// A pair to match in parts, and the data of the whole that a part needs.
#[derive(Debug)]
struct PartsJob {
    stored: Stored,
    settings: Settings,
    roughness: Roughness,
    tally: Option<Tally>,
}

impl PartsJob {
    fn new(stored: Stored, settings: Settings) -> Self {
        let pair = &stored.pair;
        let impulses = pair.blur_compensation().map_or(0.0, |known| known.impulses()[0]);
        let source = Slow::new(&stored, pair.size().0);
        let rough = roughness(&source, impulses, Level::best(), &Control::default());

        let roughness = rough.expect("all rows");
        let mut job = Self { stored, settings, roughness, tally: None };
        job.tally = job.settings.needs_confidence().then(|| job.sums());
        job
    }

    /// The sums over the sampled rows, matched with only their halo of rows around them.
    fn sums(&self) -> Tally {
        let matcher = Matcher::new(1).expect("a thread");
        let execution = Execution { threads: 1, level: Level::best() };
        let candidates = self.stored.pair.candidates();

        let sums = sampled(self.stored.pair.size().0).into_iter().map(|rows| {
            let (pair, section) = self.section(&rows, &self.around(&rows));
            let found = matcher.match_raw(&pair, &section, &self.settings, execution, &Control::default());
            let map = found.expect("legal rows");
            let confidence = map.confidence.expect("asked for");
            let (disparity, flags) = (map.disparity.as_slice(), map.flags.as_slice());
            Tally::new(confidence.as_slice(), disparity, flags, candidates)
        });
        sums.reduce(Tally::and).expect("some rows")
    }

    /// The rows around a part that it depends on.
    fn halo(&self) -> Halo {
        halo(&self.settings, self.stored.pair.blur_compensation())
    }

    /// The result of a match of the whole.
    fn whole(&self, (matcher, execution): (&Matcher, Execution)) -> ResultBits {
        let found = matcher.match_pair(&self.stored.pair, &self.settings, execution, &Control::default());
        ResultBits::new(found.expect("a legal match"))
    }

    /// The rows to read for some rows: more if a halo has rows without a valid pixel.
    fn around(&self, rows: &Range<usize>) -> Range<usize> {
        let halo = self.halo();
        let height = self.stored.pair.size().0;
        let read = widened(rows, halo.rows(), height);

        let is_empty = |mask: &Mask| read.clone().any(|y| !mask.row(y).contains(&true));
        if self.stored.pair.views().iter().filter_map(|view| view.mask()).any(is_empty) {
            return widened(&read, halo.masked, height);
        }

        read
    }

    /// Matches some rows, using only the images that were read.
    fn part(
        &self,
        rows: &Range<usize>,
        read: &Range<usize>,
        (matcher, execution): (&Matcher, Execution),
    ) -> ResultBits {
        let (pair, section) = self.section(rows, read);
        let found = matcher.match_rows(&pair, &section, &self.settings, execution, &Control::default());
        ResultBits::new(found.expect("a legal part"))
    }

    /// Some rows as a part of the rows that were read, and these as a pair.
    fn section(&self, rows: &Range<usize>, read: &Range<usize>) -> (Pair, Section) {
        let section = Section {
            rows: rows.start - read.start..rows.end - read.start,
            first: read.start,
            roughness: Some(self.roughness),
            ranges: None,
            tally: self.tally,
        };
        (self.stored.part(read), section)
    }

    /// The whole match, with the rows between successive cuts matched separately.
    fn by_parts(&self, cuts: &[usize], on: (&Matcher, Execution)) -> ResultBits {
        let rows = cuts.windows(2).map(|ends| ends[0]..ends[1]);
        joined(rows.map(|rows| self.part(&rows, &self.around(&rows), on)))
    }
}

impl std::fmt::Display for PartsJob {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let (size, candidates) = (self.stored.pair.size(), self.stored.pair.candidates());
        write!(f, "{size:?}, {candidates:?}, {:?}, {:?}", self.settings, self.halo())
    }
}

/// The parts one below the other.
fn joined(parts: impl Iterator<Item = ResultBits>) -> ResultBits {
    let join = |mut one: ResultBits, next: ResultBits| {
        one.disparity.extend(next.disparity);
        one.flags.extend(next.flags);
        let joined = |one: Option<Vec<u32>>, next: Option<Vec<u32>>| {
            one.zip(next).map(|(one, next)| [one, next].concat())
        };
        one.confidence = joined(one.confidence, next.confidence);
        one.uncertainty = joined(one.uncertainty, next.uncertainty);
        one
    };

    parts.reduce(join).expect("at least one part")
}

fn execution(threads: usize, level: Level) -> Execution {
    Execution { threads, level }
}

/// Masks of single pixels, and of all pixels of some rows.
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

/// Pairs of several bands: with few gray values, so that ties abound, or with many; or small ones of any
/// type.
fn pairs() -> impl Strategy<Value = Stored> {
    let small = (1usize..=20, 1usize..=12, 0u8..4)
        .prop_flat_map(|(rows, cols, kind)| [inputs(rows, cols, kind), inputs(rows, cols, kind)]);

    let heights = prop_oneof![
        2 => 1usize..=260,
        1 => select(vec![63, 64, 65, 79, 80, 81, 128, 129, 193]),
        1 => 261usize..=600,
    ];

    let tall = (heights, 1usize..=40, select(vec![1u64, 7, 255]), 0u8..4, any::<u64>()).prop_map(
        |(rows, cols, white, masks, seed)| {
            [0u8, 1].map(|side| {
                let own = seed ^ u64::from(side);
                let shift = if seed & 16 == 0 { 2 * usize::from(side) } else { 0 };

                let noise = seed & 32 == 0;
                let pixel = |y, x: usize| {
                    // A scene that the right image shows further left, or noise without any match.
                    let scene = hash(seed, y / 2, usize::midpoint(x, shift)) % (white + 1);
                    let lot = hash(own, y, x) % (white + 1);

                    if noise { lot as u8 } else { scene as u8 }
                };

                let is_masked = masks >> side & 1 == 1;
                let mask = is_masked.then(|| masked(rows, cols, hash(own, 1, 1)));
                Input { mask, ..input(rows, cols, pixel) }
            })
        },
    );

    (prop_oneof![1 => small, 3 => tall], any::<Index>(), any::<Index>()).prop_map(
        |([left, right], min, count)| {
            let cols = left.size().1;
            let count = 1 + count.index(cols.min(20)) as i64;
            let lowest = 1 - cols as i64 - (count - 1);
            let min = lowest + min.index((2 * cols as i64 + count - 2) as usize) as i64;
            Stored::new([left, right], min, count)
        },
    )
}

fn noise_alone(noise: [f64; 2]) -> BlurCompensation {
    BlurCompensation::of_noise(noise).expect("legal noise")
}

/// Settings without refinement, so that halos are as small as possible.
fn unrefined(settings: Settings) -> Settings {
    Settings {
        subpixel: false,
        lr_check: None,
        uniqueness: 0,
        speckle_size: 0,
        synthesis: false,
        guided_median: false,
        median: 0,
        confidence: false,
        min_confidence: 0.0,
        ..settings
    }
}

/// Settings of any kind, and near the default ones.
fn any_settings() -> impl Strategy<Value = Settings> {
    let of_few = |optimizer| Settings { optimizer, speckle_size: 10, ..robust() };

    prop_oneof![
        2 => settings(),
        2 => settings().prop_map(unrefined),
        1 => select(OPTIMIZERS.to_vec()).prop_map(of_few),
        1 => select(OPTIMIZERS.to_vec()).prop_map(move |optimizer| unrefined(of_few(optimizer))),
    ]
}

fn jobs() -> impl Strategy<Value = PartsJob> {
    let known = prop_oneof![1 => noises().prop_map(noise_alone), 2 => blur_compensation()];
    (pairs(), any_settings(), known).prop_map(|(pair, mut settings, known)| {
        let (rows, cols) = pair.pair.size();

        let places = AFFORDABLE / (rows * cols * pair.pair.candidates().count());
        settings.window = affordable(settings.window, places);

        let (r, s) = settings.frequencies;
        let least = (2 * r.max(s) + 1).max(3);
        // The neighborhood has to stay large enough for its frequencies.
        settings.neighborhood = affordable(settings.neighborhood, places).max(least);

        let is_phase = settings.cost == CostKind::Phase;
        let known = if is_phase { known } else { noise_alone(known.noise()) };

        PartsJob::new(pair.compensated(known), settings)
    })
}

/// Cuts through this many rows, the first and the last among them.
fn cuts(height: usize, places: &[Index]) -> Vec<usize> {
    let inner = places.iter().map(|place| place.index(height));

    let mut cuts: Vec<_> = inner.chain([0, height]).collect();
    cuts.sort_unstable();
    cuts.dedup();
    cuts
}

proptest! {
    #![proptest_config(random(2500))]

    #[test]
    fn parts_put_together_are_the_whole(
        job in jobs(),
        places in prop::collection::vec(any::<Index>(), 0..5),
        threads in 1usize..=8,
        level in select(levels()),
    ) {
        let cuts = cuts(job.stored.pair.size().0, &places);
        let matcher = Matcher::new(threads).expect("threads start");
        let on = (&matcher, execution(threads, level));
        let found = job.by_parts(&cuts, on);
        let expected = job.whole(on);

        prop_assert!(found == expected, "{:?} of {}", cuts, job);
    }
}

/// A scene and the same further left, so that costs range from 0 to the largest.
fn shifted(rows: usize, cols: usize) -> [Input; 2] {
    [0, 2].map(|shift| input(rows, cols, |y, x| hash(9, y, x + shift) as u8))
}

/// A pair with these columns, with some invalid pixels in the rows that `is_masked` selects.
fn pair(rows: usize, cols: usize, is_masked: impl Fn(usize) -> bool) -> Stored {
    let mask = Mask::from_fn(rows, cols, |y, x| !(is_masked(y) && hash(3, y, x).is_multiple_of(4)));
    let mask = Some(mask).filter(|mask| mask.as_slice().contains(&false));
    let inputs = shifted(rows, cols).map(|input| Input { mask: mask.clone(), ..input });
    Stored::new(inputs, -1, 9)
}

/// Masks and penalties decide in which integers a part is matched: not always in those of the whole.
#[test]
fn parts_are_matched_in_any_integers() {
    let height = 4 * BAND + 9;
    let matcher = Matcher::new(2).expect("threads");

    let phase = Settings { neighborhood: 5, ..Preset::Paper.settings() };
    let byte = Settings { precision: Precision::Byte, ..phase };
    let cheap = (0.05, 0.1);
    let dear = (LARGEST_PENALTY, LARGEST_PENALTY);

    let every = [
        Settings { window: 3, p1: cheap.0, p2: cheap.1, ..byte },
        Settings { window: 17, p1: cheap.0, p2: cheap.1, frequencies: (1, 0), bits: 1, ..byte },
        Settings { window: 5, adaptive_p2: 0.5, ..phase },
        Settings { window: 3, p1: dear.0, p2: dear.1, ..phase },
        Settings { window: 7, cost: CostKind::Sad, ..phase },
    ];

    for (settings, optimizer) in
        every.iter().flat_map(|settings| OPTIMIZERS.map(|optimizer| (settings, optimizer)))
    {
        let settings = Settings { optimizer, ..settings.clone() };

        for is_masked in [|y: usize| y < 10, |y: usize| y > 3 * BAND] {
            let job = PartsJob::new(pair(height, 40, is_masked), settings.clone());
            let on = (&matcher, execution(2, Level::best()));
            let found = job.by_parts(&[0, BAND, BAND + 1, 3 * BAND + 5, height], on);
            assert!(found == job.whole(on), "{job}");
        }
    }
}

/// Two classes in tiles, with kernels of two sizes.
fn two_versions() -> BlurCompensation {
    let taps = |side: usize| Plane::from_fn(side, side, |_, _| 1.0 / (side * side) as f64);
    let kernel = |side| Some(Kernel::new(&taps(side)).expect("a legal kernel"));
    let labels = Plane::from_fn(3, 2, |y, x| ((y + x) % 2) as u8);

    let kernels = vec![[None, kernel(7)], [kernel(3), None]];
    BlurCompensation::new([1.0; 2], kernels, labels, 40).expect("legal compensation")
}

/// The same, for images with impulses that are also smoothed.
fn cleaned_versions() -> BlurCompensation {
    let compensation = two_versions().with_impulses([5.0, 0.5]).expect("legal heights");
    compensation.with_smoothing([90.0, 70.0]).expect("legal deviations")
}

#[test]
fn tall_pairs_in_parts_are_the_whole() {
    let inputs = shifted(600, 75).map(|input| Input { mask: Some(masked(600, 75, 12)), ..input });
    let pair = Stored::new(inputs, 0, 16);
    let matcher = Matcher::new(2).expect("threads");

    for known in [two_versions(), cleaned_versions()] {
        let job = PartsJob::new(pair.clone().compensated(known), robust());
        for level in levels() {
            let on = (&matcher, execution(1, level));
            let found = job.by_parts(&[0, 1, 63, 128, 330, 599, 600], on);
            assert!(found == job.whole(on), "{}", level.name());
        }
    }
}

/// Windows and neighborhoods of several sizes with every optimizer, without refinement and with stages that
/// depend on more rows.
fn settings_of_many_halos() -> Vec<(Settings, Option<BlurCompensation>)> {
    let alone = Optimizer::WinnerTakesAll;
    let phase = Settings { optimizer: alone, neighborhood: 3, window: 3, ..nothing() };
    let phase = Settings { frequencies: (1, 1), ..phase };
    // If changes are expensive, a path remembers the costs of rows far away.
    let several = Settings { optimizer: Optimizer::SemiGlobal, p1: 1e4, p2: 1e4, ..phase };
    let ordered = Settings { optimizer: Optimizer::DynamicProgramming, ..phase };

    vec![
        (Settings { shiftable: false, ..phase }, None),
        (phase.clone(), None),
        (Settings { neighborhood: 9, window: 1, ..phase }, None),
        (Settings { sizes: 2, window: 1, ..phase }, None),
        (Settings { window: 1, ..phase }, Some(cleaned_versions())),
        (Settings { sizes: 2, shiftable: false, ..phase }, Some(cleaned_versions())),
        (Settings { window: 9, shiftable: false, ..phase }, None),
        (Settings { window: 1, ..phase }, Some(two_versions())),
        (Settings { cost: CostKind::Sad, window: 5, ..phase }, None),
        (Settings { cost: CostKind::NormalizedSad, window: 5, ..phase }, None),
        (Settings { cost: CostKind::Zncc, neighborhood: 5, window: 3, ..phase }, None),
        (Settings { shiftable: false, ..several }, None),
        (Settings { window: 1, adaptive_p2: 1.0, ..several }, Some(two_versions())),
        (Settings { cost: CostKind::Sad, window: 1, ..several }, None),
        (Settings { shiftable: true, ..ordered }, None),
        (Settings { median: 3, ..phase.clone() }, None),
        (Settings { confidence: true, ..phase }, None),
        (Settings { confidence: true, window: 1, ..several }, Some(two_versions())),
        (Settings { confidence: true, window: 1, ..several }, Some(cleaned_versions())),
    ]
}

/// Pixels that differ little, with impulses among them.
fn spoilt(lot: u64) -> u8 {
    let [little, much] = [lot % 60, lot >> 8].map(|lot| lot as u8);
    if (lot >> 16).is_multiple_of(16) { much } else { 90 + little }
}

#[test]
fn halos_are_as_small_as_possible() {
    let matcher = Matcher::new(1).expect("a thread");
    let on = (&matcher, execution(1, Level::best()));
    for (settings, known) in settings_of_many_halos() {
        let mut is_tight = [false; 2];
        for seed in 0..12 {
            let inputs = [seed, !seed].map(|seed| input(280, 60, |y, x| spoilt(hash(seed, y, x))));
            let pair = Stored::new(inputs, 0, 30);
            let job = PartsJob::new(pair.compensated(known.clone()), settings.clone());

            let halo = job.halo();
            // The last row of a band depends on the furthest row above, the first of the next one on the
            // furthest below.
            for (y, is_above) in [(2 * BAND - 1 + halo.map, true), (2 * BAND - halo.map, false)] {
                let rows = y..y + 1;
                let read = widened(&rows, halo.rows(), 280);
                let enough = job.part(&rows, &read, on);

                let more = widened(&rows, halo.rows() + 40, 280);
                assert!(enough == job.part(&rows, &more, on), "{job}");

                let [above, below] = [usize::from(is_above), usize::from(!is_above)];
                let less = read.start + above..read.end - below;
                is_tight[below] |= enough != job.part(&rows, &less, on);
            }
        }
        assert_eq!(is_tight, [true; 2], "{settings:?}");
    }
}

/// Settings without refinement.
fn nothing() -> Settings {
    unrefined(Preset::Paper.settings())
}

/// Every stage of refinement alone, and some together.
fn settings_of_refinement() -> Vec<Settings> {
    let nothing = nothing();
    vec![
        nothing.clone(),
        Settings { speckle_size: 12, fill: false, ..nothing },
        Settings { lr_check: Some(1), ..nothing },
        Settings { guided_median: true, ..nothing },
        Settings { synthesis: true, ..nothing },
        Settings { median: 3, ..nothing },
        Settings { subpixel: true, ..nothing },
        Settings { confidence: true, ..nothing },
        Settings { min_confidence: 0.5, ..nothing },
        Settings { guided_median: true, median: 3, subpixel: true, confidence: true, ..nothing },
        Settings { speckle_size: 3, guided_median: true, uniqueness: 10, ..robust() },
    ]
}

/// Some rows without a trusted pixel.
fn lost(seed: u64) -> Range<usize> {
    let first = (hash(seed, 1, 1) % 150) as usize;
    first..first + (hash(seed, 2, 2) % 80) as usize
}

/// A map to refine, and the inputs of every stage.
#[derive(Clone)]
struct DraftMap {
    disparity: Plane<f32>,
    flags: Plane<u16>,
    votes: Plane<f32>,
    texture: Texture<'static>,
}

impl DraftMap {
    fn random(seed: u64, percent: u64) -> Self {
        let maps::FlaggedMap { disparity, flags } = maps::FlaggedMap::random((150, 24), percent, seed);

        let lost = lost(seed);
        let flags = Plane::from_fn(150, 24, |y, x| {
            flags.row(y)[x] | if lost.contains(&y) { flag::OCCLUDED } else { 0 }
        });

        let votes = Plane::from_fn(150, 24, |y, x| (hash(seed ^ 8, y, x) % 100) as f32 / 100.0);
        let gray = Plane::from_fn(150, 24, |y, x| (hash(seed ^ 9, y / 3, x / 3) % 30) as i32);

        Self { disparity, flags, votes, texture: Texture::new(gray) }
    }

    /// Refines some rows, with `halo` rows on either side.
    fn refined(&self, rows: &Range<usize>, halo: usize, settings: &Settings) -> ResultBits {
        let read = widened(rows, halo, 150);
        let mut flags = rows_of(&self.flags, &read);
        let votes = rows_of(&self.votes, &read);

        let draft = Draft {
            disparity: rows_of(&self.disparity, &read),
            flags: &mut flags,
            votes: settings.needs_confidence().then_some(&votes),
            texture: Some(&self.texture.clone().of_rows(read.clone())),
            blurred_pair: None,
        };

        let found = draft.refine(settings, Level::best(), &Control::default());
        let (disparity, confidence) = found.expect("memory");

        let rows = rows.start - read.start..rows.end - read.start;
        ResultBits::new(Disparity {
            disparity: disparity.of_rows(rows.clone()),
            flags: flags.of_rows(rows.clone()),
            confidence: confidence.map(|plane| plane.of_rows(rows)),
            uncertainty: None,
            wrong: None,
            detail: None,
            timings: Timings::default(),
        })
    }

    /// Whether the map, refined in two parts with this halo, equals the map refined as a whole.
    fn is_whole(&self, cut: usize, halo: usize, settings: &Settings) -> bool {
        let parts = [0..cut, cut..150].map(|rows| self.refined(&rows, halo, settings));
        joined(parts.into_iter()) == self.refined(&(0..150), 0, settings)
    }
}

#[test]
fn each_stage_adds_its_reach() {
    for (settings, rows) in [
        (nothing(), 0),
        (Settings { speckle_size: 12, fill: false, ..nothing() }, 12 + 32),
        (Settings { lr_check: Some(1), ..nothing() }, 32),
        (Settings { guided_median: true, ..nothing() }, 5),
        (Settings { median: 3, ..nothing() }, 1),
        (Settings { subpixel: true, ..nothing() }, 3),
        (Settings { confidence: true, ..nothing() }, 4),
    ] {
        assert_eq!(halo(&settings, None).map, rows, "{settings:?}");
    }

    // For the image: half a neighborhood, half a window, twice if it may shift, and for vertical paths a band
    // with its look-ahead.
    for (optimizer, rows) in [(Optimizer::WinnerTakesAll, 0), (Optimizer::SemiGlobal, 63 + 16)] {
        let settings = Settings { neighborhood: 9, window: 7, optimizer, ..nothing() };
        let [fixed, shiftable] =
            [false, true].map(|shiftable| halo(&Settings { shiftable, ..settings.clone() }, None).images);
        assert_eq!([fixed, shiftable], [4 + 3 + rows, 4 + 6 + rows], "{optimizer:?}");
    }
}

#[test]
fn refinement_needs_its_halo_and_no_more() {
    for settings in settings_of_refinement() {
        // The halo of several stages together is not always needed in full; those of speckles and of edges
        // are tested below.
        let is_one = settings.speckle_size == 0 && !settings.guided_median;
        let halo = halo(&settings, None).map;
        let mut is_tight = halo == 0;

        for seed in 0..400 {
            let percent = [0, 3, 20, 60, 97][seed as usize % 5];

            // Anywhere, or at the distance from trusted rows that filling reaches.
            let any = 1 + (hash(seed, 0, 0) % 149) as usize;
            let far = (lost(seed).end + 1).saturating_sub(32).clamp(1, 149);
            let map = DraftMap::random(seed, percent);
            let cut = if seed % 2 == 0 { any } else { far };

            assert!(map.is_whole(cut, halo, &settings), "seed {seed}, {settings:?}");
            is_tight |= is_one && halo > 0 && !map.is_whole(cut, halo - 1, &settings);

            if seed > 60 && (is_tight || !is_one) {
                break;
            }
        }

        assert!(is_tight || !is_one, "{settings:?}");
    }
}

/// A pixel is near the jump between the last row of its halo and the one before.
#[test]
fn edges_need_their_halo_and_no_more() {
    let settings = Settings { guided_median: true, ..nothing() };
    let halo = 5;
    assert_eq!(self::halo(&settings, None).map, halo);

    for cut in [60, 61, 75] {
        let calm = |y: usize, x: usize| (hash(6, y, x) % 4) as f32 / 4.0;
        let step = |y: usize| if y + 1 >= cut + halo { 5.0 } else { 0.0 };

        let map = DraftMap {
            disparity: Plane::from_fn(150, 24, |y, x| calm(y, x) + step(y)),
            flags: Plane::from_fn(150, 24, |_, _| 0),
            ..DraftMap::random(1, 0)
        };

        assert!(map.is_whole(cut, halo, &settings), "{cut}");
        assert!(!map.is_whole(cut, halo - 1, &settings), "{cut}");
    }
}

/// A column of pixels that stands out: whether it is a speckle depends on its far end.
#[test]
fn speckles_need_their_halo_and_no_more() {
    let settings = Settings { speckle_size: 20, fill: false, ..nothing() };
    // Rows without a trusted pixel copy others at most 32 rows away.
    let halo = 20 + 32;
    assert_eq!(self::halo(&settings, None).map, halo);

    let column =
        |length: usize| DraftMap {
            disparity: Plane::from_fn(150, 24, |y, x| {
                if x == 7 && (60..60 + length).contains(&y) { 9.0 } else { 1.0 }
            }),
            flags: Plane::from_fn(150, 24, |_, _| 0),
            ..DraftMap::random(1, 0)
        };

    for length in [19, 20, 21, 22] {
        for cut in [59, 60, 61, 70, 79, 80, 81, 82] {
            assert!(column(length).is_whole(cut, halo, &settings), "{length}, {cut}");
        }
    }

    assert!(!column(21).is_whole(61, 19, &settings));
}

#[test]
fn rows_that_copy_others_need_those() {
    let matcher = Matcher::new(1).expect("a thread");
    let on = (&matcher, execution(1, Level::best()));
    let settings = Settings { neighborhood: 9, window: 1, ..nothing() };

    // Neighborhoods of row 66 end at row 62, which copies row 58: no nearer row is valid.
    let valid = |y: usize| y >= 66 || (50..=58).contains(&y);
    let inputs = [5, 6].map(|seed| Input {
        mask: Some(Mask::from_fn(160, 60, |y, _| valid(y))),
        ..input(160, 60, |y, x| hash(seed, y, x) as u8)
    });

    let job = PartsJob::new(Stored::new(inputs, 0, 30), settings);

    let whole = job.whole(on);
    for cuts in [[63, 70], [65, 66], [66, 67], [66, 159], [52, 64]] {
        assert!(job.by_parts(&[0, cuts[0], cuts[1], 160], on) == whole, "{cuts:?}");
    }

    let rows = 66..67;
    let halo = job.halo();
    let enough = job.part(&rows, &job.around(&rows), on);
    assert_eq!((halo.rows(), job.around(&rows).start), (4, 0));

    assert!(job.part(&rows, &(58..71), on) == enough);
    for first in [59, 62] {
        assert!(job.part(&rows, &(first..71), on) != enough, "{first}");
    }
}

#[test]
fn rows_beyond_the_pair_are_refused() {
    let matcher = Matcher::new(1).expect("a thread");
    let control = Control::default();
    let whole = pair(70, 40, |_| false).pair;
    let run = |optimizer, rows| {
        let settings = Settings { optimizer, ..Preset::Paper.settings() };
        let section = Section { rows, ..Section::whole(&whole) };
        matcher.match_rows(&whole, &section, &settings, execution(1, Level::best()), &control)
    };

    for optimizer in OPTIMIZERS {
        #[expect(clippy::reversed_empty_ranges, reason = "that is the point")]
        for rows in [0..71, 70..71, 7..7, 70..70, 9..5, 0..usize::MAX] {
            match run(optimizer, rows.clone()) {
                Err(error @ Error::Value { .. }) => {
                    let expected = format!("rows: got {rows:?}; accepts rows within 0..70");
                    assert_eq!(error.to_string(), expected);
                }
                other => panic!("{rows:?}: {other:?}"),
            }
        }

        for rows in [64..70, 31..33] {
            let found = run(optimizer, rows.clone()).expect("any rows");
            assert_eq!((found.disparity.rows(), found.flags.rows()), (rows.len(), rows.len()));
        }
    }
}

/// The class of a pixel depends on its row in the whole image.
#[test]
fn parts_are_of_the_classes_of_the_whole() {
    let whole = two_versions();
    for first in [0, 1, 39, 40, 41, 79, 80, 81, 119, 120, 1000] {
        let part = two_versions().starting_at_row(first);
        for (y, x) in [(0, 0), (1, 39), (38, 40), (39, 90), (40, 0), (80, 0), (500, 500)] {
            assert_eq!(part.class(y, x), whole.class(first + y, x), "{first}: {y}, {x}");
        }
    }
}
