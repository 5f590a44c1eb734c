//! Compares the engine with the core, bit by bit, on an adapter whose name contains the environment variable
//! `PHASESTEREO_GPU`; by default Mesa's software driver for Vulkan, which computes on the processor.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use ndarray::Array3;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::matcher::section::Section;
use phasestereo_match::matcher::{Execution, Matcher};
use phasestereo_match::optimization::Workspace;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::blur_compensation::{BlurCompensation, MOST_CLASSES};
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{Optimizer, Precision, Settings};
use proptest::prelude::*;
use proptest::sample::{Index, select};
use proptest::test_runner::RngSeed;

use super::*;

/// A GPU whose every answer is compared with the core's.
#[derive(Debug)]
struct Compared {
    gpu: Gpu,
    /// Numbers of values compared, of those that differ, and of chunks that were not supported.
    values: AtomicUsize,
    different: AtomicUsize,
    left: AtomicUsize,
}

impl Engine for Compared {
    fn choose(&self, rows: Range<usize>, chunk: &Chunk, evidence: &mut Evidence) -> Result<bool> {
        if !self.gpu.choose(rows.clone(), chunk, evidence)? {
            self.left.fetch_add(1, Ordering::Relaxed);
            return Ok(false);
        }

        let mut workspace = Workspace::<u8>::default();
        for band in chunk.search.bands(rows.clone()) {
            let expected = chunk.search.choose(band.clone(), &chunk.source, &mut workspace)?;
            for (row, y) in band.enumerate() {
                let (expected, found) = (expected.row(row), evidence.row(y - rows.start));
                self.count(expected.chosen, found.chosen);
                if chunk.search.weighs(y) {
                    self.count(expected.best, found.best);
                    self.count(expected.second_best, found.second_best);
                    let [expected, found] = [expected.offset, found.offset]
                        .map(|all| all.iter().map(|value| value.to_bits()).collect::<Vec<_>>());
                    self.count(&expected, &found);
                }
            }
        }
        Ok(true)
    }
}

impl Compared {
    fn new(gpu: Gpu) -> Arc<Self> {
        let [values, different, left] = [0; 3].map(AtomicUsize::new);
        Arc::new(Self { gpu, values, different, left })
    }

    fn count<T: PartialEq>(&self, expected: &[T], found: &[T]) {
        assert_eq!(expected.len(), found.len());
        let different = expected.iter().zip(found).filter(|(a, b)| a != b).count();
        self.values.fetch_add(expected.len(), Ordering::Relaxed);
        self.different.fetch_add(different, Ordering::Relaxed);
    }

    /// Numbers of values compared, of those that differ, and of chunks that were not supported.
    fn counts(&self) -> [usize; 3] {
        [&self.values, &self.different, &self.left].map(|count| count.load(Ordering::Relaxed))
    }
}

/// The adapter, unless the machine has none; with `CI=true` it must have one.
fn gpu() -> Option<Gpu> {
    let name = std::env::var("PHASESTEREO_GPU").unwrap_or_else(|_| "llvmpipe".to_owned());
    match Gpu::new(Some(&name)) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var("CI").as_deref() == Ok("true") => panic!("{error}"),
        Err(error) => {
            eprintln!("SKIPPED: {error}");
            None
        }
    }
}

/// A pair, the part of it to match, the settings, and the bytes of a volume.
#[derive(Debug, Clone)]
struct Job {
    pair: Pair,
    section: Section,
    settings: Settings,
    most_bytes: u64,
}

impl Job {
    /// Matches with an engine, and returns the bits of the map.
    fn run(&self, engine: Option<Arc<dyn Engine>>) -> Vec<u32> {
        let matcher = Matcher::new(2).expect("threads");
        let matcher = match engine {
            Some(engine) => matcher.with_engine(engine),
            None => matcher,
        };
        let execution = Execution { threads: 2, level: Level::best() };
        let control = Control::default();
        let map = matcher.match_rows(&self.pair, &self.section, &self.settings, execution, &control);
        let map = map.expect("a legal match");
        let flags = map.flags.as_slice().iter().map(|flags| u32::from(*flags));
        map.disparity.as_slice().iter().map(|value| value.to_bits()).chain(flags).collect()
    }
}

fn hash(seed: u64, y: usize, x: usize) -> u64 {
    let bits = (seed ^ (y as u64) << 20 ^ (x as u64) << 40).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let bits = (bits ^ bits >> 29).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ bits >> 31
}

/// A textured scene, and the same scene moved left, by more in some blocks than in others, with some noise.
fn pair((rows, cols): (usize, usize), (min, count): (i64, i64), white: u64, seed: u64) -> Pair {
    let texture = |y: usize, x: i64| hash(seed, y / 2, (x + 1000) as usize) % (white + 1);
    let image = |side: u64| -> Input {
        let pixel = |y: usize, x: usize| {
            let near = hash(seed ^ 1, y / 24, x / 24) % count as u64;
            let shift = if side == 0 { 0 } else { min + near as i64 };
            let noise = u64::from(hash(seed ^ 2 ^ side, y, x).is_multiple_of(7));
            (texture(y, x as i64 + shift) + noise).min(white) as u8
        };
        let image = Array3::from_shape_fn((rows, cols, 1), |(y, x, _)| pixel(y, x));
        Image::U8(image).into()
    };
    let pair = Pair::of_inputs([image(0), image(1)], min, count).expect("a legal pair");
    compensated(pair, vec![[None, None]], 1)
}

/// A pair whose classes have these kernels, in tiles of this size.
fn compensated(pair: Pair, kernels: Vec<[Option<Kernel>; 2]>, tile: usize) -> Pair {
    let label = |y, x| (hash(9, y, x) % kernels.len() as u64) as u8;
    let labels = Plane::from_fn(20, 20, label);
    let found = BlurCompensation::new([1.0; 2], kernels, labels, tile).expect("legal kernels");
    let (level, control) = (Level::best(), Control::default());
    pair.with_blur_compensation(Some(found), level, &control).expect("memory")
}

/// The largest number of kernels for the right image, each with a different size.
fn kernels() -> Vec<[Option<Kernel>; 2]> {
    let kernel = |n: usize| {
        let (rows, cols) = (1 + n % 4 * 2, 1 + n / 4 * 2);
        let taps = Plane::from_fn(rows, cols, |_, _| 1.0 / (rows * cols) as f64);
        Kernel::new(&taps).expect("legal taps")
    };
    (0..MOST_CLASSES).map(|n| [None, (n > 0).then(|| kernel(n))]).collect()
}

/// Settings near those of the presets that a GPU supports.
fn settings() -> impl Strategy<Value = Settings> {
    let preset = select(vec![Preset::Fast, Preset::Robust]);
    let optimizer = select(vec![Optimizer::ScanlineOptimization, Optimizer::SemiGlobal]);
    let window = select(vec![1, 3, 5, 9, 15, 31]);
    let penalties = (0.0..8.0f64, 0.0..24.0f64);
    let edges = select(vec![0.0, 0.5, 1.0, 2.0]);
    let checks = (any::<bool>(), any::<bool>());
    (preset, optimizer, window, penalties, edges, checks).prop_map(
        |(preset, optimizer, window, (p1, p2), adaptive_p2, (confidence, subpixel))| {
            let preset = preset.settings();
            // A byte has to hold the sum of a column of the window.
            let most = (255 / preset.code_length() - 1) | 1;
            Settings {
                optimizer,
                window: window.min(most),
                p1,
                p2,
                adaptive_p2,
                confidence,
                subpixel,
                precision: Precision::Byte,
                ..preset
            }
        },
    )
}

fn jobs() -> impl Strategy<Value = Job> {
    let heights = prop_oneof![1 => 1usize..=40, 1 => select(vec![63, 64, 65, 80, 81, 129, 193])];
    let widths = prop_oneof![1 => 1usize..=60, 1 => select(vec![63, 64, 65, 80, 81, 129, 150])];
    let places = prop::array::uniform5(any::<Index>());
    let shown = (select(vec![1u64, 15, 254]), any::<u64>());
    (heights, widths, places, settings(), shown).prop_map(|(rows, cols, places, settings, shown)| {
        let [count, min, start, length, first] = places;
        let count = 1 + count.index(cols.min(80));
        let min = 1 - cols as i64 - (count as i64 - 1) + min.index(2 * cols + count - 2) as i64;
        let pair = pair((rows, cols), (min, count as i64), shown.0, shown.1);
        let has_versions = shown.1.is_multiple_of(3);
        let tile = 1 + (shown.1 >> 8) as usize % 40;
        let pair = if has_versions { compensated(pair, kernels(), tile) } else { pair };

        let start = start.index(rows);
        let rows = start..start + 1 + length.index(rows - start);
        let first = if shown.1.is_multiple_of(2) { 0 } else { first.index(200) };
        let section = Section { rows, first, ..Section::whole(&pair) };
        // Half of the jobs are cut into parts of one band.
        let band = (4 * cols * count.div_ceil(4) * 96) as u64;
        let most_bytes = if shown.1 % 4 < 2 { band } else { MOST_BYTES };
        Job { pair, section, settings, most_bytes }
    })
}

/// The same examples in every run.
fn config(cases: u32) -> ProptestConfig {
    let (rng_seed, failure_persistence) = (RngSeed::Fixed(0), None);
    ProptestConfig { cases, rng_seed, failure_persistence, max_shrink_iters: 50, ..<_>::default() }
}

#[test]
fn any_search_has_the_bits_of_the_core() {
    let Some(gpu) = gpu() else { return };
    let name = gpu.adapter().clone();
    let held = Mutex::new(Some(gpu));
    let totals = Mutex::new([0; 3]);

    let mut runner = proptest::test_runner::TestRunner::new(config(300));
    let result = runner.run(&jobs(), |job| {
        let gpu = held.lock().expect("no panic").take().expect("the device");
        let compared = Compared::new(gpu.with_memory(job.most_bytes));
        let found = job.run(Some(compared.clone()));
        let counts = compared.counts();
        let compared = Arc::into_inner(compared).expect("the matcher is gone");
        *held.lock().expect("no panic") = Some(compared.gpu);

        let mut totals = totals.lock().expect("no panic");
        (0..3).for_each(|i| totals[i] += counts[i]);
        prop_assert_eq!(counts[1], 0, "values differ of {}", counts[0]);
        prop_assert!(found == job.run(None), "the maps differ");
        Ok(())
    });
    result.expect("no example differs");

    let gpu = held.into_inner().expect("no panic").expect("the device");
    assert_eq!(gpu.failure(), None);
    let [compared, different, left] = totals.into_inner().expect("no panic");
    println!("{name:?}: {compared} values, {different} differ; {left} chunks left to the core");
    assert!(compared > 1_000_000 && left < 100, "{compared} values; {left} chunks not taken");
}

/// A pair with several panels, bands and workgroups, in which every kernel matters.
fn large(optimizer: Optimizer, count: i64) -> Job {
    let pair = pair((150, 201), (-3, count), 254, 3);
    // Along columns, the right image has several versions, too.
    let has_versions = optimizer == Optimizer::SemiGlobal;
    let pair = if has_versions { compensated(pair, kernels(), 17) } else { pair };
    let settings = Settings { optimizer, ..Preset::Robust.settings() };
    Job { section: Section::whole(&pair), pair, settings, most_bytes: MOST_BYTES }
}

/// How many values differ with another shader; `None`: it failed.
fn different(shader: String) -> Option<usize> {
    let mut gpu = gpu()?;
    gpu.memory = Mutex::new(Memory::new(shader.leak()));
    let compared = Compared::new(gpu);
    for optimizer in [Optimizer::ScanlineOptimization, Optimizer::SemiGlobal] {
        large(optimizer, 70).run(Some(compared.clone()));
    }
    let [values, different, left] = compared.counts();
    (values > 0 && left == 0).then_some(different)
}

#[test]
fn every_line_of_the_shader_that_keeps_order_or_rounds_counts() {
    let Some(gpu) = gpu() else { return };
    // A GPU runs the threads of small workgroups together, and does not need all barriers.
    if gpu.adapter().kind != Kind::Processor {
        eprintln!("SKIPPED: {} is not a software driver", gpu.adapter().name);
        return;
    }
    assert_eq!(different(SHADER.to_owned()), Some(0));

    let barriers = SHADER.matches("workgroupBarrier();").count();
    assert_eq!(barriers, 3);
    for removed in 0..barriers {
        let (start, _) = SHADER.match_indices("workgroupBarrier();").nth(removed).expect("there");
        let rest = &SHADER[start..].replacen("workgroupBarrier();", "", 1);
        let found = different(format!("{}{rest}", &SHADER[..start]));
        assert!(found.is_some_and(|count| count > 0), "barrier {removed}: {found:?}");
    }

    let changes = [
        ("version * u32(task.rows)", "0u * u32(task.rows)"),
        ("turn % 2u", "0u"),
        ("turn % 3u * PATHS", "turn % 2u * PATHS"),
        ("(turn + 1u) % 3u", "(turn + 2u) % 3u"),
        ("p2_from_left(y, x + 1)", "p2_from_left(y, x)"),
        ("p2_from_above(y + 1, x)", "p2_from_above(y, x)"),
        ("- (((a ^ b) >> 1u)", "- 0u * (((a ^ b) >> 1u)"),
        ("least & 0xffffu", "max(least & 0xffffu, 1u)"),
        ("var from_right = vec4<u32>(0u);", "var from_right = from_left;"),
        ("k <= vec4<u32>(chosen + 1u)", "k <= vec4<u32>(chosen)"),
    ];
    for (before, after) in changes {
        assert!(SHADER.contains(before), "{before}");
        let found = different(SHADER.replace(before, after));
        assert!(found.is_some_and(|count| count > 0), "{before} -> {after}: {found:?}");
    }
}

#[test]
fn what_is_not_taken_is_left_to_the_core() {
    let Some(gpu) = gpu() else { return };
    let job = large(Optimizer::SemiGlobal, 16);
    let of = |settings: Settings| Job { settings, ..job.clone() };
    let all = [
        of(Settings { optimizer: Optimizer::DynamicProgramming, ..job.settings.clone() }),
        of(Settings { precision: Precision::Full, p2: 1000.0, ..job.settings.clone() }),
        of(Settings { window: 33, ..job.settings.clone() }),
        of(Settings { shiftable: true, ..job.settings.clone() }),
    ];

    let compared = Compared::new(gpu);
    for job in &all {
        assert!(job.run(Some(compared.clone())) == job.run(None), "{:?}", job.settings);
    }
    assert_eq!(compared.counts(), [0, 0, all.len()]);

    // A volume that does not fit in memory.
    let gpu = Arc::into_inner(compared).expect("no matcher has it").gpu.with_memory(1 << 10);
    let compared = Compared::new(gpu);
    assert!(job.run(Some(compared.clone())) == job.run(None));
    assert_eq!(compared.counts(), [0, 0, 1]);
}

#[test]
fn a_device_that_fails_leaves_the_match_to_the_core() {
    let Some(mut gpu) = gpu() else { return };
    gpu.memory = Mutex::new(Memory::new("this is not a shader"));
    let gpu = Arc::new(gpu);
    let job = large(Optimizer::ScanlineOptimization, 16);

    assert_eq!(gpu.failure(), None);
    assert!(job.run(Some(gpu.clone())) == job.run(None));
    let reason = gpu.failure().expect("it failed");
    assert!(reason.contains("this is not a shader") || reason.contains("expected"), "{reason}");

    // The same for a device that is lost.
    let gpu = self::gpu().expect("an adapter");
    gpu.device.handle.destroy();
    let gpu = Arc::new(gpu);
    assert!(job.run(Some(gpu.clone())) == job.run(None));
    assert!(gpu.failure().is_some());
}

#[test]
fn processors_are_used_by_their_names_alone() {
    let all = adapters();
    for adapter in all.iter().filter(|adapter| adapter.kind == Kind::Processor) {
        let gpu = Gpu::new(Some(&adapter.name.to_uppercase())).expect("it opens");
        assert_eq!(gpu.adapter(), adapter);
    }
    if all.iter().all(|adapter| adapter.kind == Kind::Processor) {
        let refused = Gpu::new(None).expect_err("must be refused").to_string();
        assert!(refused.starts_with("device: got gpu; accepts a"), "{refused}");
    }

    let refused = Gpu::new(Some("no such device")).expect_err("must be refused").to_string();
    assert!(refused.starts_with("device: got no such device; accepts "), "{refused}");
    assert!(all.iter().all(|adapter| refused.contains(&adapter.name)), "{refused}");
}
