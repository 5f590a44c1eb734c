//! Generators that the tests of several stages share: settings, images and volumes, including awkward ones.

pub mod estimates;
pub mod maps;
pub mod naive;
pub mod parts;

use ndarray::Array3;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::conversion::view_of_input;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::intensity::level_planes;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::image::view::{Mask, View};
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::{Execution, Matcher};
use phasestereo_match::pair::blur_compensation::{BlurCompensation, MOST_CLASSES};
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{CostKind, MOST_DISPARITIES, Optimizer, Precision, Settings, Taper};
use proptest::prelude::*;
use proptest::sample::select;
use proptest::test_runner::RngSeed;

/// Numbers of candidates around those that fill one run of lanes, or two, three or four.
pub const COUNTS: [usize; 14] = [1, 2, 3, 7, 31, 32, 33, 64, 65, 96, 97, 128, 129, 257];

/// The largest penalty that is accepted.
pub const LARGEST_PENALTY: f64 = 65_535.0;
/// The largest threshold of adaptive P2 that is accepted.
pub const LARGEST_ADAPTIVE: f64 = 1000.0;

/// Every optimizer.
pub const OPTIMIZERS: [Optimizer; 4] = [
    Optimizer::DynamicProgramming,
    Optimizer::ScanlineOptimization,
    Optimizer::WinnerTakesAll,
    Optimizer::SemiGlobal,
];

/// This many random examples, the same in every run and on every machine.
pub fn random(cases: u32) -> ProptestConfig {
    let rng_seed = RngSeed::Fixed(0);
    let failure_persistence = None;

    ProptestConfig { cases, rng_seed, failure_persistence, max_shrink_iters: 200, ..<_>::default() }
}

/// Works with a matcher that has this many threads.
pub fn with_runtime<T>(threads: usize, level: Level, work: impl FnOnce(Runtime) -> T) -> T {
    let (matcher, control) = (Matcher::new(threads).expect("threads"), Control::default());
    work(Runtime { matcher: &matcher, execution: Execution { threads, level }, control: &control })
}

/// Every level that this machine has.
pub fn levels() -> Vec<Level> {
    Level::all().filter_map(|(_, level)| level).collect()
}

/// The result of some work, which must be the same at every level.
pub fn at_every_level<T: PartialEq + std::fmt::Debug>(work: impl Fn(Level) -> T) -> T {
    let mut found = levels().into_iter().map(work);
    let first = found.next().expect("a level");
    found.for_each(|other| assert_eq!(other, first));
    first
}

/// Numbers of rows: a few, or about those of the look-ahead, of a band, and of both together.
pub fn heights() -> impl Strategy<Value = usize> {
    let near = vec![15, 16, 17, 63, 64, 65, 79, 80, 81, 127, 128, 129];
    prop_oneof![3 => 1usize..=9, 1 => select(near)]
}

/// Numbers of columns: a few, or about those of the look-ahead, of a panel, and of both together.
pub fn widths() -> impl Strategy<Value = usize> {
    let near = vec![31, 32, 33, 63, 64, 65, 95, 96, 97, 127, 128, 129, 200];
    prop_oneof![3 => 1usize..=12, 1 => select(near)]
}

/// Legal descriptors of any family; small sizes are frequent, since frequencies reach their bounds there.
pub fn descriptors() -> impl Strategy<Value = Settings> {
    let size = prop_oneof![6 => 1usize..=5, 1 => 6usize..=31].prop_map(|radius| 2 * radius + 1);

    let taper = prop_oneof![
        3 => Just(Taper::Uniform),
        1 => Just(Taper::Gaussian),
        1 => Just(Taper::Hann)
    ];

    (size, taper, 0usize..=4, 0usize..=4, 1usize..=2, 1usize..=4).prop_filter_map(
        "no legal descriptor",
        |(neighborhood, taper, r, s, power, bits)| {
            let frequencies = (r, s);
            let settings =
                Settings { neighborhood, taper, frequencies, power, bits, ..Preset::Paper.settings() };

            settings.check().is_ok().then_some(settings)
        },
    )
}

/// Legal descriptors, many of them with a weak level where one is allowed.
pub fn weak_descriptors() -> impl Strategy<Value = Settings> {
    // If the code would be too long: first without a weak level, then of one size.
    let weak = prop_oneof![1 => Just(0.0), 1 => Just(100.0), 6 => 0.01..4.0f64];
    (descriptors(), weak, 1usize..=2).prop_map(|(descriptor, weak, sizes)| {
        let wanted = [(weak, sizes), (0.0, sizes), (weak, 1)];
        let settings =
            wanted.map(|(noise_threshold, sizes)| Settings { noise_threshold, sizes, ..descriptor.clone() });
        settings.into_iter().find(|settings| settings.check().is_ok()).unwrap_or(descriptor)
    })
}

/// Noise of a pair: none, some, and more than the contrast of any image.
pub fn noises() -> impl Strategy<Value = [f64; 2]> {
    let one = || prop_oneof![1 => Just(0.0), 4 => 0.0..8.0f64, 2 => 0.0..1e-4f64, 1 => Just(1e300)];
    (one(), one()).prop_map(|(left, right)| [left, right])
}

/// Kernels of random taps, many of them zero, or none; some larger than the image.
pub fn kernels() -> impl Strategy<Value = Option<Kernel>> {
    let radius = || prop_oneof![4 => 0usize..=2, 1 => 3usize..=8];
    let taps = (radius(), radius()).prop_flat_map(|(vertical, horizontal)| {
        let tap = prop_oneof![1 => Just(0.0), 1 => 0.0..1.0f64];
        let count = (2 * vertical + 1) * (2 * horizontal + 1);
        (Just(2 * vertical + 1), prop::collection::vec(tap, count))
    });

    let kernel = taps.prop_map(|(rows, mut taps)| {
        // At least one tap is not 0, so the sum is not.
        taps[0] += 0.1;
        let total: f64 = taps.iter().sum();
        let taps = taps.iter().map(|tap| tap / total).collect::<Vec<_>>();
        let taps = Plane::from_vec(rows, taps.len() / rows, taps).expect("the right length");
        Kernel::new(&taps).expect("a legal kernel")
    });

    prop_oneof![1 => Just(None), 2 => kernel.prop_map(Some)]
}

/// Classes of any kernels in tiles of any size.
pub fn blur_compensation() -> impl Strategy<Value = BlurCompensation> {
    let kernels = prop::collection::vec((kernels(), kernels()), 1..=MOST_CLASSES);
    let labels = (1usize..=5, 1usize..=5).prop_flat_map(|(rows, cols)| {
        (Just((rows, cols)), prop::collection::vec(any::<prop::sample::Index>(), rows * cols))
    });

    let known = (noises(), impulses(), noises(), 1usize..=40);

    (known, kernels, labels).prop_map(|(known, kernels, (size, labels))| {
        let (noise, impulses, smoothing, tile) = known;
        let labels = labels.iter().map(|label| label.index(kernels.len()) as u8).collect();
        let labels = Plane::from_vec(size.0, size.1, labels).expect("the right length");

        let kernels = kernels.into_iter().map(|(left, right)| [left, right]).collect();

        let compensation = BlurCompensation::new(noise, kernels, labels, tile).expect("legal compensation");
        let compensation = compensation.with_impulses(impulses).expect("legal heights");
        compensation.with_smoothing(smoothing).expect("legal deviations")
    })
}

/// Heights of impulses of a pair: none, some, and more than the contrast of any image.
pub fn impulses() -> impl Strategy<Value = [f64; 2]> {
    let one = || prop_oneof![2 => Just(0.0), 3 => 0.01..60.0f64, 1 => Just(1e300)];
    (one(), one()).prop_map(|(left, right)| [left, right])
}

/// P1 and P2 in the range of the costs, none, and penalties larger than any cost.
pub fn penalties() -> impl Strategy<Value = (f64, f64)> {
    let one = || prop_oneof![4 => 0.0..4.0f64, 2 => Just(0.0), 1 => Just(LARGEST_PENALTY)];
    (one(), one())
}

/// Legal settings of the whole matcher.
pub fn settings() -> impl Strategy<Value = Settings> {
    let cost = prop_oneof![1 => Just(CostKind::Phase), 1 => select(CostKind::ALL)];

    let radius = prop_oneof![6 => 0usize..=5, 1 => 6usize..=31];
    let precision = select(vec![Precision::Full, Precision::Byte]);
    let optimizers = OPTIMIZERS.into_iter().chain([Optimizer::SemiGlobal; 2]).collect::<Vec<_>>();
    let edges = prop_oneof![2 => Just(0.0), 2 => 0.1..3.0f64, 1 => Just(LARGEST_ADAPTIVE)];

    let paths = (select(optimizers), penalties(), edges);

    (weak_descriptors(), cost, radius, precision, paths, any::<bool>(), refinements()).prop_map(
        |(descriptor, cost, radius, precision, paths, shiftable, refinement)| Settings {
            cost,
            neighborhood: descriptor.neighborhood,
            taper: descriptor.taper,
            frequencies: descriptor.frequencies,
            power: descriptor.power,
            bits: descriptor.bits,
            sizes: descriptor.sizes,
            noise_threshold: if cost == CostKind::Phase { descriptor.noise_threshold } else { 0.0 },
            window: 2 * radius + 1,
            shiftable,
            precision,
            optimizer: paths.0,
            p1: paths.1.0,
            p2: paths.1.1,
            adaptive_p2: paths.2,
            ..refinement
        },
    )
}

/// Legal settings of refinement; everything else is as in the paper.
pub fn refinements() -> impl Strategy<Value = Settings> {
    let consistency = prop::option::of(select(vec![0, 1, 2, MOST_DISPARITIES]));
    let uniqueness = prop_oneof![2 => Just(0), 1 => 1..=100usize];
    let speckles = (select(vec![0, 0, 1, 5, 100]), select(vec![0.0, 0.5, 1.0, 3.0]));
    let median = select(vec![0, 3]);
    let least = prop_oneof![2 => Just(0.0), 1 => 0.0..1.0f64, 1 => Just(1.0)];

    let switches = [any::<bool>(); 5];
    let checks = (consistency, uniqueness);
    (checks, speckles, median, least, switches).prop_map(
        |(
            checks,
            speckles,
            median,
            min_confidence,
            [subpixel, synthesis, guided_median, fill, confidence],
        )| {
            Settings {
                subpixel,
                lr_check: checks.0,
                uniqueness: checks.1,
                speckle_size: speckles.0,
                speckle_range: speckles.1,
                synthesis,
                guided_median,
                median,
                fill,
                confidence,
                min_confidence,
                ..Preset::Paper.settings()
            }
        },
    )
}

/// The default settings for matching a pair, without the estimation of its rig.
pub fn robust() -> Settings {
    Settings {
        compensate_blur: false,
        despike: false,
        denoise: false,
        align_rows: false,
        ..Settings::default()
    }
}

/// Every legal (L, r, s, k, b) of one size.
pub fn every_descriptor(neighborhood: usize) -> impl Iterator<Item = Settings> {
    let frequencies = (0..=4).flat_map(|r| (0..=4).map(move |s| (r, s)));
    let families = frequencies.flat_map(|f| (1..=2).map(move |k| (f, k)));

    families.flat_map(|(f, k)| (1..=4).map(move |b| (f, k, b))).filter_map(
        move |(frequencies, power, bits)| {
            let settings = Settings { neighborhood, frequencies, power, bits, ..Preset::Paper.settings() };
            settings.check().is_ok().then_some(settings)
        },
    )
}

/// Gray planes from 1x1 up, of full range or with few enough values that there are many ties.
pub fn grays(largest: usize) -> impl Strategy<Value = Plane<i32>> {
    let values = prop_oneof![Just(0..=2), Just(-32_767_500..=32_767_500)];
    (1..=largest, 1..=largest, values).prop_flat_map(|(rows, cols, values)| {
        prop::collection::vec(values, rows * cols)
            .prop_map(move |data| Plane::from_vec(rows, cols, data).expect("the right length"))
    })
}

/// A volume of small values with `candidates` for each pixel.
pub fn volumes(
    rows: usize,
    cols: usize,
    candidates: usize,
    largest: u16,
) -> impl Strategy<Value = Plane<u16>> {
    let length = cols * candidates;
    prop::collection::vec(0..=largest, rows * length)
        .prop_map(move |data| Plane::from_vec(rows, length, data).expect("the right length"))
}

/// The gray values of a single image.
pub fn gray_of(input: impl Into<Input>) -> View {
    view_of_input(input.into()).expect("memory")
}

/// A view of random pixels of any type, with or without masked pixels.
pub fn views(rows: usize, cols: usize, kind: u8) -> impl Strategy<Value = View> {
    inputs(rows, cols, kind).prop_map(gray_of)
}

/// An image of random pixels of any type, with or without masked pixels.
pub fn inputs(rows: usize, cols: usize, kind: u8) -> impl Strategy<Value = Input> {
    let channels = prop_oneof![Just(1usize), Just(3usize)];
    let pixels = channels.prop_flat_map(move |channels| {
        (Just(channels), prop::collection::vec(any::<u16>(), rows * cols * channels))
    });

    let mask = prop::option::of(prop::collection::vec(prop::bool::weighted(0.8), rows * cols));

    (pixels, mask).prop_map(move |((channels, pixels), mask)| {
        let array = Array3::from_shape_vec((rows, cols, channels), pixels).expect("the right length");

        let image = match kind {
            0 => Image::U8(array.mapv(|value| value as u8)),
            1 => Image::U16(array),
            2 => Image::F32(array.mapv(|value| f32::from(value) / 65_535.0)),
            _ => Image::F64(array.mapv(|value| f64::from(value) * 1e6 - 3.0)),
        };

        let mask = mask.map(|mask| Mask::from_vec(rows, cols, mask).expect("the right length"));
        Input { mask, ..image.into() }
    })
}

/// The largest odd side up to `side` of squares with at most `places` places, but at least 1.
pub fn affordable(side: usize, places: usize) -> usize {
    let most = places.isqrt().max(1);
    side.min(if most.is_multiple_of(2) { most - 1 } else { most })
}

/// A gray view of bytes without a mask.
pub fn view(rows: usize, cols: usize, pixel: impl Fn(usize, usize) -> u8) -> View {
    gray_of(input(rows, cols, pixel))
}

/// A gray image of bytes without a mask.
pub fn input(rows: usize, cols: usize, pixel: impl Fn(usize, usize) -> u8) -> Input {
    Image::U8(Array3::from_shape_fn((rows, cols, 1), |(y, x, _)| pixel(y, x))).into()
}

/// A pseudo-random number for each place, the same in every run.
pub fn hash(seed: u64, y: usize, x: usize) -> u64 {
    let mut bits = seed ^ (y as u64) << 20 ^ (x as u64) << 40;

    for factor in [0xbf58_476d_1ce4_e5b9, 0x94d0_49bb_1331_11eb] {
        bits = (bits ^ bits >> 30).wrapping_add(0x9e37_79b9_7f4a_7c15).wrapping_mul(factor);
    }

    bits ^ bits >> 31
}

/// A mask with about `percent` of valid pixels, in clumps and singly.
pub fn mask(rows: usize, cols: usize, percent: u64, seed: u64) -> Mask {
    let valid = |seed, y, x| hash(seed, y, x) % 100 < percent;
    Mask::from_fn(rows, cols, |y, x| valid(seed, y, x) && valid(!seed, y / 5, x / 5))
}

/// A scene and its negative, of 11 x 42 pixels: every bit of their codes differs, and at disparity 0 only 8
/// pairs are valid, in one column. Three pixels in a row share a value; one is valid on the left and the
/// others on the right, so the masks do not hide any of the scene.
pub fn eight_valid_pairs() -> [View; 2] {
    let in_both = |y, x| x == 18 && y < 8;
    let valid = [0, 1]
        .map(|side| Mask::from_fn(11, 42, |y, x| (x % 3 == 1) == (side == 0) || side == 0 && in_both(y, x)));

    let scene = |y, x| hash(3, y, x / 3) as u8;

    let [left, right] = valid.map(Some);
    [view(11, 42, scene).with_mask(left), view(11, 42, |y, x| !scene(y, x)).with_mask(right)]
}

/// The gray levels of a pair, for SAD.
pub fn level_pair(views: [&View; 2], given: Option<(f64, f64)>) -> [Plane<u16>; 2] {
    level_planes(views, given, &Control::default()).expect("not cancelled")
}

/// A gray plane of pseudo-random values, for the tests that need a size of their own.
pub fn noise(rows: usize, cols: usize) -> Plane<i32> {
    let mut state = 1u32;

    Plane::from_fn(rows, cols, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as i32
    })
}
