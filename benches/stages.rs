//! Time of each stage alone, on one thread, in (pixel x candidate) or pixels per second.
//!
//! One group per stage, named after the files of `rust/match/src`; `cargo bench -- optimization` runs one of
//! them. Compare the times of the stages with the limits of the machine: `cargo bench -- machine`.

use divan::Bencher;
use divan::counter::ItemsCount;
use ndarray::Array3;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::cost::Costs;
use phasestereo_match::cost::aggregation::Window;
use phasestereo_match::image::conversion::view_of_input;
use phasestereo_match::image::pixels::Image;
use phasestereo_match::image::texture::Texture;
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::{Matcher, on_threads};
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::refinement::flag;
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{CostKind, Optimizer, Settings};

/// Rows of the images: those of a band.
const ROWS: usize = 64;
const COLS: usize = 640;
/// Numbers of candidates.
const COUNTS: [usize; 4] = [16, 64, 256, 512];

fn main() {
    divan::main();
}

/// Values without any structure: no stage's time depends on the content of the images.
fn noise<T>(rows: usize, cols: usize, mut value: impl FnMut(u32) -> T) -> Plane<T> {
    let mut state = 1u32;
    Plane::from_fn(rows, cols, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        value(state >> 16)
    })
}

/// The gray values of an image.
fn gray(image: Image) -> View {
    view_of_input(image.into()).expect("memory")
}

/// A scene, and the same scene a few pixels further left.
fn views() -> [View; 2] {
    let scene = noise(ROWS, COLS + 8, |value| value as u8);
    [0, 8].map(|shift| {
        let pixel = |(y, x, _): (usize, usize, usize)| scene.row(y)[x + shift];
        gray(Image::U8(Array3::from_shape_fn((ROWS, COLS, 1), pixel)))
    })
}

/// The preset `fast`, whose costs and totals are bytes.
fn fast() -> Settings {
    Preset::Fast.settings()
}

/// The stages of the preset `robust` without its estimates; costs and totals are bytes.
fn robust() -> Settings {
    Settings {
        compensate_blur: false,
        despike: false,
        denoise: false,
        align_rows: false,
        ..Settings::default()
    }
}

/// The parameters of one bench: an instruction-set level of this machine, and a number of candidates.
#[derive(Clone, Copy)]
struct Case {
    level: Level,
    candidates: usize,
}

impl Case {
    fn evaluations(self) -> ItemsCount {
        ItemsCount::new(ROWS * COLS * self.candidates)
    }
}

impl std::fmt::Display for Case {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{}, {}", self.level.name(), self.candidates)
    }
}

fn levels() -> impl Iterator<Item = Level> {
    Level::all().filter_map(|(_, level)| level)
}

fn cases() -> impl Iterator<Item = Case> {
    levels().flat_map(|level| COUNTS.map(|candidates| Case { level, candidates }))
}

/// An instruction-set level of this machine, which benches print by name.
struct At(Level);

impl std::fmt::Display for At {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{}", self.0.name())
    }
}

fn every() -> impl Iterator<Item = At> {
    levels().map(At)
}

/// A map to refine, and the inputs of its refinement.
#[derive(Clone)]
struct SampleMap {
    disparity: Plane<f32>,
    flags: Plane<u16>,
    votes: Plane<f32>,
    texture: Texture<'static>,
}

impl SampleMap {
    const PIXELS: usize = ROWS * COLS;

    /// Surfaces of 20 x 40 pixels, some with a gray value of their own; one pixel in sixteen is an outlier,
    /// one in ten is occluded.
    fn new() -> Self {
        let lots = noise(ROWS, COLS, |value| value);
        let surface = |y: usize, x: usize| (7 * (y / 20) + 5 * (x / 40)) % 11;

        let disparity = Plane::from_fn(ROWS, COLS, |y, x| {
            let lot = lots.row(y)[x];
            let alone = if lot % 16 == 0 { 9.0 } else { 0.0 };
            surface(y, x) as f32 + alone + (lot >> 8) as f32 / 512.0
        });

        let flags = lots.map(|lot| if lot % 10 == 0 { flag::OCCLUDED } else { 0 });
        let votes = lots.map(|lot| (lot % 1000) as f32 / 1000.0);

        let texture = Texture::new(Plane::from_fn(ROWS, COLS, |y, x| {
            (20 * (surface(y, x) / 2)) as i32 + (lots.row(y)[x] >> 12) as i32
        }));

        Self { disparity, flags, votes, texture }
    }

    /// Times one stage on one thread. The stage may change the map or write another plane of its size.
    fn bench<T: Send>(bencher: Bencher, stage: impl Fn(&mut Self, &mut Plane<f32>) -> T + Send + Sync) {
        let map = Self::new();
        let pool = Matcher::new(1).expect("a thread starts");

        bencher
            .counter(ItemsCount::new(Self::PIXELS))
            .with_inputs(|| (map.clone(), map.disparity.clone()))
            .bench_local_refs(|(map, out)| pool.install(|| stage(map, out)));
    }
}

/// Passes the costs of a pair and their window to some work, on one thread.
fn with_costs<T>(case: Case, settings: &Settings, work: impl FnOnce(&Costs, Window) -> T) -> T {
    let (views, count) = (views(), case.candidates);

    let candidates = Candidates::new(0, count as i64, COLS).expect("in reach");
    let [left, right] = &views;
    let costs = Costs::new([left, right], candidates, settings, None, case.level, &Control::default())
        .expect("memory");

    work(&costs, Window::new((ROWS, COLS), count, settings, costs.ceiling()))
}

mod descriptor {
    use super::{Bencher, COLS, Control, Image, ItemsCount, Preset, ROWS, Settings, gray, noise, on_threads};
    use ndarray::Array3;
    use phasestereo_match::base::simd::Level;
    use phasestereo_match::descriptor::describe as describe_gray;
    use phasestereo_match::image::intensity::Gray;

    /// The image and the settings of one bench, by name.
    type Case = (&'static str, fn() -> Image, Settings);

    fn pixels<T>(channels: usize, mut value: impl FnMut(u32) -> T) -> Array3<T> {
        let values = noise(ROWS, COLS * channels, &mut value).into_vec();
        Array3::from_shape_vec((ROWS, COLS, channels), values).expect("as many values")
    }

    fn cases() -> Vec<Case> {
        let bytes = || Image::U8(pixels(1, |value| value as u8));
        let of_size = |neighborhood| Settings { neighborhood, ..Preset::Paper.settings() };
        let of_bits = |power, bits| Settings { power, bits, ..Preset::Paper.settings() };

        vec![
            ("L = 7", bytes, of_size(7)),
            ("L = 11", bytes, of_size(11)),
            ("L = 15", bytes, of_size(15)),
            ("L = 21", bytes, of_size(21)),
            ("L = 63", bytes, of_size(63)),
            ("b = 1", bytes, of_bits(1, 1)),
            ("b = 3", bytes, of_bits(1, 3)),
            ("b = 4", bytes, of_bits(1, 4)),
            ("k = 2", bytes, of_bits(2, 2)),
            ("weak", bytes, Settings { noise_threshold: 1.0, ..Preset::Paper.settings() }),
            ("fast", bytes, super::fast()),
            ("fast, weak", bytes, Settings { noise_threshold: 1.0, ..super::fast() }),
            ("color", || Image::U8(pixels(3, |value| value as u8)), of_size(7)),
            ("u16", || Image::U16(pixels(1, |value| value as u16)), of_size(7)),
            ("f32", || Image::F32(pixels(1, |value| value as f32)), of_size(7)),
        ]
    }

    fn names() -> Vec<String> {
        let levels = Level::all().filter(|(_, level)| level.is_some());
        levels
            .flat_map(|(level, _)| cases().into_iter().map(move |(case, ..)| format!("{level}, {case}")))
            .collect()
    }

    /// From the pixels of an image to its codes.
    #[divan::bench(args = names())]
    fn describe(bencher: Bencher, name: &str) {
        let (level, case) = name.split_once(", ").expect("a level and a case");
        let level = Level::all().find(|(known, _)| *known == level).and_then(|(_, level)| level);
        let (_, image, settings) = cases().into_iter().find(|(known, ..)| *known == case).expect("a case");
        let (level, control) = (level.expect("of this machine"), Control::default());

        let view = gray(image());

        let work = || describe_gray(&Gray::of_view(&view), &settings, Some(2.0), level, &control);

        bencher.counter(ItemsCount::new(ROWS * COLS)).bench(|| on_threads(1, work));
    }
}

/// An image of 741 x 497 gray bytes under the kernels of common blurs.
mod convolution {
    use super::{Bencher, Control, Image, ItemsCount, gray, noise, on_threads};
    use ndarray::Array3;
    use phasestereo_match::base::math;
    use phasestereo_match::base::plane::Plane;
    use phasestereo_match::base::simd::Level;
    use phasestereo_match::image::convolution::{Kernel, convolve as convolve_gray};
    use phasestereo_match::image::intensity::Gray;

    const ROWS: usize = 497;
    const COLS: usize = 741;
    /// Bits of the kernel after the binary point.
    const FRACTION: u32 = 4;
    /// Samples per pixel in each direction.
    const SAMPLES: usize = 8;

    /// The kernel whose taps are the shares of each pixel that lie `inside`, by offset from the center.
    fn shares(radius: usize, inside: impl Fn(f64, f64) -> bool) -> Kernel {
        let side = 2 * radius + 1;
        let offset = |pixel: usize, sample: usize| {
            pixel as f64 - radius as f64 + (sample as f64 + 0.5) / SAMPLES as f64 - 0.5
        };

        let samples = |y, x| {
            let places = (0..SAMPLES).flat_map(|j| (0..SAMPLES).map(move |i| (j, i)));
            places.filter(|(j, i)| inside(offset(y, *j), offset(x, *i))).count() as f64
        };

        let shares = Plane::from_fn(side, side, samples);
        let total: f64 = shares.as_slice().iter().sum();
        Kernel::new(&shares.map(|share| share / total)).expect("a legal kernel")
    }

    fn disk(radius: f64) -> Kernel {
        shares(radius.ceil() as usize, |y, x| math::hypot(y, x) <= radius)
    }

    /// A path of some length, one pixel wide, at 30 degrees.
    fn motion(length: f64) -> Kernel {
        let (sine, cosine) = math::sin_cos(std::f64::consts::FRAC_PI_6);
        shares((length / 2.0).ceil() as usize, |y, x| {
            (x * cosine + y * sine).abs() <= length / 2.0 && (y * cosine - x * sine).abs() <= 0.5
        })
    }

    fn gaussian(sigma: f64) -> Kernel {
        let reach = (4.0 * sigma) as i32;
        let profile = (-reach..=reach).map(|j| math::exp(-0.5 * (f64::from(j) / sigma).powi(2)));
        let total: f64 = profile.clone().sum();

        let profile: Vec<f64> = profile.map(|tap| tap / total).collect();
        Kernel::separable(&profile, &profile).expect("a legal kernel")
    }

    /// A kernel by name, and the largest magnitude of the gray values under it.
    fn cases() -> Vec<(&'static str, Kernel, u32)> {
        vec![
            ("motion 15", motion(15.0), 128),
            ("disk 2", disk(2.0), 128),
            ("disk 6", disk(6.0), 128),
            ("disk 10", disk(10.0), 128),
            ("Gaussian 1.5", gaussian(1.5), 128),
            ("Gaussian 4", gaussian(4.0), 128),
            ("Gaussian 6", gaussian(6.0), 128),
            ("disk 6 of 64 bits", disk(6.0), 1 << 24),
            ("Gaussian 4 of 64 bits", gaussian(4.0), 1 << 24),
        ]
    }

    fn names() -> Vec<String> {
        let levels = Level::all().filter(|(_, level)| level.is_some());
        let cases = cases();
        levels.flat_map(|(level, _)| cases.iter().map(move |(case, ..)| format!("{level}, {case}"))).collect()
    }

    #[divan::bench(args = names(), sample_count = 20)]
    fn convolve(bencher: Bencher, name: &str) {
        let (level, case) = name.split_once(", ").expect("a level and a case");
        let level = Level::all().find(|(known, _)| *known == level).and_then(|(_, level)| level);
        let (_, kernel, reach) = cases().into_iter().find(|(known, ..)| *known == case).expect("a case");
        let (level, control) = (level.expect("of this machine"), Control::default());

        let pixels = noise(ROWS, COLS, |value| value as u8).into_vec();
        let pixels = Array3::from_shape_vec((ROWS, COLS, 1), pixels).expect("as many values");
        let view = gray(Image::U8(pixels));

        let bytes = Gray::of_view(&view);
        let wide = noise(ROWS, COLS, |value| (value << 8) as i32 - (1 << 23));
        let gray = if reach == 128 { bytes } else { Gray::within(reach, wide) };
        let work = || convolve_gray(&gray, &kernel, FRACTION, level, &control);

        bencher.counter(ItemsCount::new(ROWS * COLS)).bench_local(|| on_threads(1, work));
    }
}

/// Codes or gray values -> costs of all candidates, panel after panel into the same few kilobytes.
mod cost {
    use super::{Bencher, COLS, Case, CostKind, Costs, Preset, ROWS, Settings, cases, with_costs};
    use phasestereo_match::base::simd::Loop;
    use phasestereo_match::base::value::{LANES, Lanes, Value};
    use phasestereo_match::optimization::PANEL;

    /// Writes the costs of all panels of the image.
    struct WriteCosts<'a, V> {
        costs: &'a Costs<'a>,
        out: &'a mut [Lanes<V>],
    }

    impl<V: Value> Loop for WriteCosts<'_, V> {
        type Output = ();

        #[inline(always)]
        fn run(self) {
            for (y, start) in (0..ROWS).flat_map(|y| (0..COLS).step_by(PANEL).map(move |x| (y, x))) {
                self.costs.write(y, start..start + PANEL, self.costs.searched(), self.out);
            }
        }
    }

    fn write<V: Value>(bencher: Bencher, case: Case, settings: &Settings) {
        with_costs(case, settings, |costs, _| {
            let mut out = vec![[V::default(); LANES]; PANEL * costs.runs()];
            bencher.counter(case.evaluations()).bench_local(|| {
                case.level.run(WriteCosts { costs, out: divan::black_box(&mut out[..]) });
            });
        });
    }

    fn phase(frequencies: (usize, usize), bits: usize) -> Settings {
        Settings { neighborhood: 9, frequencies, bits, ..Preset::Paper.settings() }
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn phase_of_1_byte(bencher: Bencher, case: Case) {
        write::<u8>(bencher, case, &phase((1, 1), 2));
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn phase_of_2_bytes(bencher: Bencher, case: Case) {
        write::<u8>(bencher, case, &phase((2, 1), 2));
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn phase_of_4_bytes(bencher: Bencher, case: Case) {
        write::<u8>(bencher, case, &phase((1, 1), 4));
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn phase_of_8_bytes(bencher: Bencher, case: Case) {
        write::<u8>(bencher, case, &phase((4, 3), 2));
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn sad(bencher: Bencher, case: Case) {
        write::<u16>(bencher, case, &Settings { cost: CostKind::Sad, ..Preset::Paper.settings() });
    }
}

/// Sums over windows and the aggregated costs, panel by panel: for the codes of `fast`, `robust` and `paper`.
mod aggregation {
    use super::{Bencher, COLS, Case, Preset, ROWS, Settings, cases, fast, robust, with_costs};
    use phasestereo_match::base::value::{LANES, Value};
    use phasestereo_match::cost::aggregation::{Aggregator, PixelBlock};
    use phasestereo_match::optimization::{PANEL, STRIP};

    fn aggregate<V: Value>(bencher: Bencher, case: Case, settings: &Settings) {
        with_costs(case, settings, |costs, window| {
            assert!(window.largest_value(false) <= V::LARGEST_TOTAL);

            let places = PixelBlock::new(0..ROWS, 0..PANEL, STRIP).places();
            let mut out = vec![[V::default(); LANES]; places * costs.runs()];
            let mut aggregator = Aggregator::<V>::default();

            bencher.counter(case.evaluations()).bench_local(|| {
                for start in (0..COLS).step_by(PANEL) {
                    let columns = start..start + PANEL;
                    let block = PixelBlock::new(0..ROWS, columns, STRIP);
                    let block = (block, costs.searched());
                    let out = divan::black_box(&mut out[..]);
                    aggregator.aggregate(costs, window, block, case.level, out).expect("memory");
                }
            });
        });
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn like_fast(bencher: Bencher, case: Case) {
        aggregate::<u8>(bencher, case, &fast());
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn like_robust(bencher: Bencher, case: Case) {
        aggregate::<u8>(bencher, case, &Settings { noise_threshold: 0.0, ..robust() });
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn like_paper(bencher: Bencher, case: Case) {
        aggregate::<u16>(bencher, case, &Preset::Paper.settings());
    }
}

/// The search of a band, from aggregated costs to chosen candidates. All panels have the same costs.
mod optimization {
    use super::{Bencher, COLS, Case, Control, Optimizer, Texture, cases, noise};
    use phasestereo_match::base::error::Result;
    use phasestereo_match::base::value::{LANES, Lanes, Value};
    use phasestereo_match::cost::aggregation::{Aggregator, PixelBlock};
    use phasestereo_match::optimization::edges::Edges;
    use phasestereo_match::optimization::{
        BAND, CandidateSearch, CostSource, LOOKAHEAD_COLUMNS, LOOKAHEAD_ROWS, PANEL, Penalties, STRIP,
        Weighing, Workspace,
    };
    use phasestereo_match::pair::candidates::Searched;

    /// Rows that the paths of a band cross.
    const ROWS: usize = BAND + 2 * LOOKAHEAD_ROWS;

    /// Costs that are only copied.
    struct Same<T>(Vec<Lanes<T>>);

    impl<T: Value> CostSource<T> for Same<T> {
        fn write(
            &self,
            _: &mut Aggregator<T>,
            _: (PixelBlock, Searched),
            out: &mut [Lanes<T>],
        ) -> Result<()> {
            out.copy_from_slice(&self.0[..out.len()]);
            Ok(())
        }
    }

    fn search<T: Value>(bencher: Bencher, case: Case, optimizer: Optimizer, has_edges: bool) {
        let (candidates, level, control) = (case.candidates, case.level, &Control::default());
        let runs = candidates.div_ceil(LANES);

        // Enough for 16 whole rows, which dynamic programming reads together, or for a panel of all rows.
        let panel = PixelBlock::new(0..ROWS, 0..PANEL + LOOKAHEAD_COLUMNS, STRIP);
        let rows = PixelBlock::new(0..16, 0..COLS, STRIP);
        let places = runs * panel.places().max(rows.places());
        let costs = noise(places, LANES, |value| T::truncated(u64::from(value % 200)));
        let mut costs: Vec<Lanes<T>> = costs.as_slice().as_chunks().0.to_vec();
        // Beyond the last candidate, costs are never the smallest.
        let used = candidates.min(LANES);
        for lanes in &mut costs {
            lanes[used..].fill(T::FAR);
        }
        let source = Same(costs);

        let edges = if has_edges {
            let gray = noise(ROWS, COLS, |value| value as i32);
            Edges::new(&Texture::new(gray), 1.0, level, control)
        } else {
            Edges::nowhere(COLS)
        };

        let (size, first) = ((ROWS, COLS), BAND - LOOKAHEAD_ROWS);
        let (penalties, edges, weighs) =
            (Penalties { p1: 10, p2: 50 }, &edges.expect("memory"), Weighing::All);
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

        let mut workspace = Workspace::<T>::default();
        bencher.counter(case.evaluations()).bench_local(|| {
            let rows = LOOKAHEAD_ROWS..LOOKAHEAD_ROWS + BAND;
            search.choose(rows, &source, divan::black_box(&mut workspace)).is_ok()
        });
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn like_fast(bencher: Bencher, case: Case) {
        search::<u8>(bencher, case, Optimizer::ScanlineOptimization, true);
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn like_robust(bencher: Bencher, case: Case) {
        search::<u8>(bencher, case, Optimizer::SemiGlobal, true);
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn like_robust_in_words(bencher: Bencher, case: Case) {
        search::<u16>(bencher, case, Optimizer::SemiGlobal, true);
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn like_paper(bencher: Bencher, case: Case) {
        search::<u16>(bencher, case, Optimizer::DynamicProgramming, false);
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn singly(bencher: Bencher, case: Case) {
        search::<u8>(bencher, case, Optimizer::WinnerTakesAll, false);
    }
}

mod consistency {
    use super::{Bencher, COLS, ROWS, SampleMap};
    use phasestereo_match::pair::candidates::Candidates;
    use phasestereo_match::refinement::left_right_check::{Checker, Choices};

    #[divan::bench]
    fn check(bencher: Bencher) {
        let candidates = Candidates::new(0, 32, COLS).expect("in reach");
        let SampleMap { disparity, votes, .. } = SampleMap::new();
        let chosen = disparity.map(|disparity| *disparity as u16);
        let costs = votes.map(|vote| (1000.0 * vote) as u32);

        SampleMap::bench(bencher, |_, _| {
            let (mut checker, mut flags) = (Checker::default(), [0; COLS]);
            checker.resize(COLS).expect("memory");

            for y in 0..ROWS {
                let choices = Choices { chosen: chosen.row(y), costs: costs.row(y), candidates };
                flags.fill(0);
                checker.check(choices, 1, divan::black_box(&mut flags));
            }
        });
    }
}

mod speckles {
    use super::{At, Bencher, Control, SampleMap, every};
    use phasestereo_match::refinement::speckles::flag_speckles;

    #[divan::bench(args = every())]
    fn flag(bencher: Bencher, At(level): &At) {
        SampleMap::bench(bencher, |SampleMap { disparity, flags, .. }, _| {
            flag_speckles(disparity, flags, (100, 1.0), *level, &Control::default())
        });
    }
}

mod filling {
    use super::{At, Bencher, Control, SampleMap, every};

    #[divan::bench(args = every())]
    fn fill(bencher: Bencher, At(level): &At) {
        SampleMap::bench(bencher, |SampleMap { disparity, flags, .. }, _| {
            phasestereo_match::refinement::filling::fill(disparity, flags, *level, &Control::default())
        });
    }
}

mod outlines {
    use super::{At, Bencher, Control, SampleMap, every};
    use phasestereo_match::refinement::guided_median::GuidedMedian;

    fn draw(bencher: Bencher, At(level): &At, filter: GuidedMedian) {
        SampleMap::bench(bencher, |SampleMap { disparity, texture, .. }, out| {
            filter.filter(disparity, texture, out, *level, &Control::default())
        });
    }

    #[divan::bench(args = every())]
    fn crisp(bencher: Bencher, at: &At) {
        draw(bencher, at, GuidedMedian::Narrow);
    }

    #[divan::bench(args = every())]
    fn wide(bencher: Bencher, at: &At) {
        draw(bencher, at, GuidedMedian::Wide);
    }
}

mod synthesis {
    use super::{
        At, Bencher, COLS, Control, ItemsCount, Matcher, Plane, Preset, ROWS, Settings, every, noise, views,
    };
    use phasestereo_match::image::convolution::Kernel;
    use phasestereo_match::pair::blur_compensation::BlurCompensation;
    use phasestereo_match::refinement::synthesis::BlurredPair;

    /// Synthesizes the soft image (0: left, 1: right) from a map of patches.
    fn redraw(bencher: Bencher, At(level): &At, side: usize) {
        let (views, control) = (views(), Control::default());

        let kernel = Kernel::new(&Plane::from_fn(9, 9, |_, _| 1.0 / 81.0)).expect("legal");
        let kernels = if side == 0 { [None, Some(kernel)] } else { [Some(kernel), None] };
        let labels = Plane::from_fn(1, 1, |_, _| 0);
        let compensation = BlurCompensation::new([1.0; 2], vec![kernels], labels, 1).expect("legal");

        let settings = Settings {
            neighborhood: 5,
            frequencies: (1, 1),
            noise_threshold: 0.5,
            synthesis: true,
            ..Preset::Paper.settings()
        };

        let patches = noise(ROWS / 16, COLS / 16, |value| (value % 40) as f32);
        let map = Plane::from_fn(ROWS, COLS, |y, x| patches.row(y / 16)[x / 16]);

        let scene = BlurredPair::new(
            [&views[0], &views[1]],
            Some(&compensation),
            0..ROWS,
            &settings,
            *level,
            &control,
        );
        let scene = scene.expect("memory").expect("kernels");

        let mut out = map.clone();
        let pool = Matcher::new(1).expect("a thread starts");

        bencher.counter(ItemsCount::new(ROWS * COLS)).bench_local(|| {
            pool.install(|| scene.redraw(&map, &mut out, *level, &control)).expect("memory");
        });
    }

    #[divan::bench(args = every())]
    fn left(bencher: Bencher, at: &At) {
        redraw(bencher, at, 0);
    }

    #[divan::bench(args = every())]
    fn right(bencher: Bencher, at: &At) {
        redraw(bencher, at, 1);
    }
}

mod median {
    use super::{At, Bencher, Control, SampleMap, every};

    #[divan::bench(args = every())]
    fn smooth(bencher: Bencher, At(level): &At) {
        SampleMap::bench(bencher, |SampleMap { disparity, .. }, out| {
            phasestereo_match::refinement::median::smooth(disparity, out, *level, &Control::default())
        });
    }
}

mod subpixel {
    use super::{At, Bencher, Control, SampleMap, every};

    #[divan::bench(args = every())]
    fn smooth(bencher: Bencher, At(level): &At) {
        SampleMap::bench(bencher, |SampleMap { disparity, .. }, out| {
            phasestereo_match::refinement::surfaces::smooth(disparity, out, *level, &Control::default())
        });
    }
}

mod confidence {
    use super::{At, Bencher, Control, SampleMap, every};
    use phasestereo_match::refinement::confidence::VotedMap;

    #[divan::bench(args = every())]
    fn confidences(bencher: Bencher, At(level): &At) {
        SampleMap::bench(bencher, |SampleMap { disparity, votes, texture, .. }, out| {
            VotedMap { disparity, votes, texture }.confidences(out, *level, &Control::default())
        });
    }
}

/// Whole matches, from images to disparities, by a matcher whose memory is already allocated.
mod matcher {
    use super::{
        Bencher, Case, Control, Matcher, Plane, Preset, Settings, cases, fast, noise, robust, views,
    };
    use phasestereo_match::base::simd::Level;
    use phasestereo_match::image::convolution::Kernel;
    use phasestereo_match::matcher::Execution;
    use phasestereo_match::pair::Pair;
    use phasestereo_match::pair::blur_compensation::BlurCompensation;

    fn weak() -> Settings {
        Settings { noise_threshold: 1.0, p1: 6.0, p2: 32.0, ..fast() }
    }

    /// A compensation with `count` versions of the right image, each moved by some pixels.
    fn blur_compensation(count: usize) -> BlurCompensation {
        let moving = |class: usize| {
            let taps = Plane::from_fn(1, 9, |_, x| if x == 4 + class { 1.0 } else { 0.0 });
            Kernel::new(&taps).expect("a legal kernel")
        };

        let kernels = (0..count).map(|class| [None, (class > 0).then(|| moving(class))]).collect();
        let labels = noise(4, 16, |value| (value as usize % count) as u8);
        BlurCompensation::new([1.5; 2], kernels, labels, 40).expect("legal compensation")
    }

    fn whole(bencher: Bencher, case: Case, settings: &Settings) {
        whole_of(bencher, case, settings, None);
    }

    fn whole_of(bencher: Bencher, case: Case, settings: &Settings, compensation: Option<BlurCompensation>) {
        let [left, right] = views();
        let pair = Pair::new(left, right, 0, case.candidates as i64).expect("a legal pair");
        let control = Control::default();
        let pair = pair.with_blur_compensation(compensation, Level::best(), &control);
        let pair = pair.expect("memory");
        let execution = Execution { threads: 1, level: case.level };
        let matcher = Matcher::new(1).expect("a thread starts");

        bencher
            .counter(case.evaluations())
            .bench_local(|| matcher.match_pair(&pair, settings, execution, &Control::default()));
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn like_fast(bencher: Bencher, case: Case) {
        whole(bencher, case, &fast());
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn like_fast_with_a_weak_level(bencher: Bencher, case: Case) {
        whole_of(bencher, case, &weak(), Some(blur_compensation(1)));
    }

    /// Classes in tiles, several of which lie in a panel.
    #[divan::bench(args = cases(), sample_count = 10)]
    fn in_four_classes(bencher: Bencher, case: Case) {
        whole_of(bencher, case, &weak(), Some(blur_compensation(4)));
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn like_robust(bencher: Bencher, case: Case) {
        whole_of(bencher, case, &robust(), Some(blur_compensation(1)));
    }

    #[divan::bench(args = cases(), sample_count = 10)]
    fn like_paper(bencher: Bencher, case: Case) {
        whole(bencher, case, &Preset::Paper.settings());
    }
}

mod temporal {
    use super::{At, Bencher, COLS, Control, ItemsCount, Matcher, Plane, ROWS, every, fast, noise, views};
    use phasestereo::internals::video::temporal::TemporalFilter;
    use phasestereo_match::matcher::runtime::Runtime;
    use phasestereo_match::matcher::{Disparity, Execution, Timings};
    use phasestereo_match::pair::Pair;

    /// A frame equal to the previous one, so that all of its disparities become means.
    #[divan::bench(args = every())]
    fn still(bencher: Bencher, At(level): &At) {
        let [left, right] = views();
        let pair = Pair::new(left, right, 0, 16).expect("a legal pair");
        let mut map = Disparity {
            disparity: noise(ROWS, COLS, |value| 4.0 + (value % 64) as f32 / 64.0),
            flags: Plane::new(ROWS, COLS).expect("memory"),
            confidence: None,
            uncertainty: None,
            wrong: None,
            detail: None,
            timings: Timings::default(),
        };
        let (settings, control) = (fast(), Control::default());
        let (matcher, mut filter) = (Matcher::new(1).expect("a thread"), TemporalFilter::new());
        let execution = Execution { threads: 1, level: *level };
        let runtime = Runtime { matcher: &matcher, execution, control: &control };
        bencher
            .counter(ItemsCount::new(ROWS * COLS))
            .bench_local(|| matcher.install(|| filter.apply(&pair, &settings, &mut map, runtime)));
    }
}

/// Limits of the machine, in the same units: a stage that takes `n` of these steps for an evaluation is
/// hardly faster than an `n`th of this. (The first byte of a code is, since it is not added to a sum.)
mod machine {
    use super::{At, Bencher, every, noise};
    use divan::counter::{BytesCount, ItemsCount};
    use phasestereo_match::base::plane::Plane;
    use phasestereo_match::base::simd::Loop;

    /// Bytes of one operand: three of them fit into any first-level cache.
    const FEW: usize = 8 << 10;
    /// Passes over the operands in one sample.
    const TIMES: usize = 1000;

    /// The step for each byte.
    trait Step {
        fn step(left: u8, right: u8, sum: u8) -> u8;
    }

    #[derive(Clone, Copy)]
    struct Distance;
    #[derive(Clone, Copy)]
    struct Least;

    impl Step for Distance {
        #[inline(always)]
        fn step(left: u8, right: u8, sum: u8) -> u8 {
            sum.wrapping_add((left ^ right).count_ones() as u8)
        }
    }

    impl Step for Least {
        #[inline(always)]
        fn step(left: u8, right: u8, sum: u8) -> u8 {
            sum.min(left.saturating_add(right))
        }
    }

    /// One pass over the operands.
    struct BytePass<'a, S>([&'a [u8]; 2], &'a mut [u8], S);

    impl<S: Step> Loop for BytePass<'_, S> {
        type Output = ();

        #[inline(always)]
        fn run(self) {
            let Self([left, right], sums, _) = self;
            for ((sum, left), right) in sums.iter_mut().zip(left).zip(right) {
                *sum = S::step(*left, *right, *sum);
            }
        }
    }

    fn bench_passes<S: Step + Copy>(bencher: Bencher, At(level): &At, step: S) {
        let operands: Plane<u8> = noise(2, FEW, |value| value as u8);
        let mut sums = vec![0; FEW];

        bencher.counter(ItemsCount::new(FEW * TIMES)).bench_local(|| {
            for _ in 0..TIMES {
                let rows = divan::black_box([operands.row(0), operands.row(1)]);
                level.run(BytePass(rows, divan::black_box(&mut sums), step));
            }
        });
    }

    /// XOR, population count and sum of bytes.
    #[divan::bench(args = every(), sample_count = 20)]
    fn distance_of_bytes(bencher: Bencher, at: &At) {
        bench_passes(bencher, at, Distance);
    }

    /// Saturating sum and minimum of bytes: one direction of a search.
    #[divan::bench(args = every(), sample_count = 20)]
    fn least_of_bytes(bencher: Bencher, at: &At) {
        bench_passes(bencher, at, Least);
    }

    /// Copies of bytes in memory that fits into a first-level cache, a second-level one, and neither.
    #[divan::bench(args = [8 << 10, 160 << 10, 64 << 20], sample_count = 20)]
    fn copy(bencher: Bencher, bytes: usize) {
        let from = vec![1u8; bytes];
        let mut to = vec![0u8; bytes];
        let times = ((64 << 20) / bytes).max(1);

        bencher.counter(BytesCount::new(bytes * times)).bench_local(|| {
            for _ in 0..times {
                divan::black_box(&mut to[..]).copy_from_slice(divan::black_box(&from[..]));
            }
        });
    }
}
