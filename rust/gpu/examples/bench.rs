//! Times the search by the core and by a GPU on a generated pair, and compares their bits: `make bench-gpu
//! ARGS="part of the name of an adapter"`.

use std::num::NonZero;
use std::ops::Range;
use std::sync::{Arc, Mutex};
use std::thread::available_parallelism;
use std::time::{Duration, Instant};
use std::{env, mem};

use ndarray::Array3;
use phasestereo_gpu::{Gpu, Kind, adapters};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::matcher::{Disparity, Execution, Matcher};
use phasestereo_match::optimization::engine::{Chunk, Engine};
use phasestereo_match::optimization::evidence::Evidence;
use phasestereo_match::pair::Pair;
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{Optimizer, Settings};

/// Rows, columns and candidates.
const SIZES: [[usize; 3]; 3] = [[480, 640, 64], [1080, 1920, 128], [1080, 1920, 256]];
/// Matches, the fastest of which counts, after one that compiles kernels and allocates memory.
const RUNS: usize = 5;

/// A GPU, and the time it has taken.
#[derive(Debug)]
struct Timed {
    gpu: Gpu,
    taken: Mutex<Duration>,
}

impl Engine for Timed {
    fn choose(&self, rows: Range<usize>, chunk: &Chunk, evidence: &mut Evidence) -> Result<bool> {
        let started = Instant::now();
        let is_taken = self.gpu.choose(rows, chunk, evidence)?;
        if let Ok(mut taken) = self.taken.lock() {
            *taken += started.elapsed();
        }
        Ok(is_taken)
    }
}

/// A scene of random blocks, at disparities that change from area to area.
fn pair([rows, cols, candidates]: [usize; 3]) -> Result<Pair> {
    let hash = |y: usize, x: usize| {
        let bits = ((y as u64) << 32 | x as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (bits ^ bits >> 29).wrapping_mul(0x94d0_49bb_1331_11eb) >> 40
    };
    let image = |side: usize| -> Input {
        let pixel = |y: usize, x: usize| {
            let near = hash(y / 120 + 7, x / 160) as usize % candidates;
            (hash(y / 3, (x + side * near) / 3) % 251) as u8
        };
        Image::U8(Array3::from_shape_fn((rows, cols, 1), |(y, x, _)| pixel(y, x))).into()
    };
    Pair::of_inputs([image(0), image(1)], 0, candidates as i64)
}

/// The fastest time of the stage between codes and unrefined disparities, and a map.
fn fastest(matcher: &Matcher, pair: &Pair, settings: &Settings) -> Result<(Duration, Disparity)> {
    let execution = Execution { threads: threads(), level: Level::best() };
    let run = || matcher.match_pair(pair, settings, execution, &Control::default());

    let map = run()?;
    let times = (0..RUNS).map(|_| Ok(run()?.timings.matching)).collect::<Result<Vec<_>>>()?;
    Ok((times.into_iter().min().unwrap_or_default(), map))
}

fn threads() -> usize {
    available_parallelism().map_or(1, NonZero::get)
}

fn bits(map: &Disparity) -> Vec<u32> {
    map.disparity.as_slice().iter().map(|value| value.to_bits()).collect()
}

/// Prints the times of one size and optimizer.
fn compare(engine: &Arc<Timed>, pair: &Pair, optimizer: Optimizer) -> Result<()> {
    let settings = Settings { optimizer, ..Preset::Fast.settings() };
    let (core, expected) = fastest(&Matcher::new(threads())?, pair, &settings)?;
    let matcher = Matcher::new(threads())?.with_engine(engine.clone());
    let (whole, found) = fastest(&matcher, pair, &settings)?;
    if let Some(reason) = engine.gpu.failure() {
        return Err(Error::value("device", reason, "one that does not fail"));
    }
    if bits(&expected) != bits(&found) {
        let name = &engine.gpu.adapter().name;
        return Err(Error::value("device", name, "one with the bits of the core"));
    }

    let taken = engine.taken.lock().map(|mut taken| mem::take(&mut *taken));
    let mean = taken.unwrap_or_default() / (RUNS + 1) as u32;
    let [core, whole, mean] = [core, whole, mean].map(|time| time.as_secs_f64() * 1e3);
    let name = if optimizer == Optimizer::SemiGlobal { "sgm" } else { "so" };
    let ((rows, cols), count) = (pair.size(), pair.candidates().count());
    let size = format!("{cols} x {rows} x {count}");
    println!("{size:>18} {name:>4} {core:8.1} {whole:8.1} {mean:12.1}");
    Ok(())
}

fn main() -> Result<()> {
    let name = env::args().nth(1);
    for adapter in adapters() {
        println!("{adapter:?}");
    }
    let engine = Arc::new(Timed { gpu: Gpu::new(name.as_deref())?, taken: Mutex::default() });
    let adapter = engine.gpu.adapter();
    println!("{}, beside the core on {} threads; ms", adapter.name, threads());
    println!("{:>18} {:>4} {:>8} {:>8} {:>12}", "pair", "", "core", "GPU", "mean on GPU");

    // Software drivers take minutes for more.
    let sizes = if adapter.kind == Kind::Processor { &SIZES[..1] } else { &SIZES };
    for size in sizes {
        let pair = pair(*size)?;
        compare(&engine, &pair, Optimizer::ScanlineOptimization)?;
        compare(&engine, &pair, Optimizer::SemiGlobal)?;
    }
    Ok(())
}
