//! Compares the memory model with the memory of matches, each in a process of its own: the system reports the
//! peak resident memory.
#![cfg(target_os = "linux")]

use std::env;
use std::fs;
use std::hint::black_box;
use std::process::Command;

use crate::common::parts::compensated;
use crate::common::{hash, robust};
use ndarray::Array3;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::matcher::footprint::bytes;
use phasestereo_match::matcher::halo::Halo;
use phasestereo_match::matcher::section::Section;
use phasestereo_match::matcher::{Execution, Matcher};
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::pair::plan::{Demand, Plan};
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{CostKind, Optimizer, Settings};

/// Names the case that this process measures.
const CASE: &str = "PHASESTEREO_MEMORY_OF";

/// A match whose memory is measured.
struct Case {
    name: &'static str,
    settings: Settings,
    /// Rows, halo included, and columns.
    size: (usize, usize),
    candidates: usize,
    /// The share of the model's bytes that it takes.
    share: f64,
    channels: usize,
    threads: usize,
    /// Kernels of the right image.
    kernels: usize,
}

/// Allowed error of a share: the system counts pages, and allocators keep some.
const OFF: f64 = 0.07;

fn cases() -> Vec<Case> {
    let (large, flat, high) = ((500, 1200), (300, 700), (560, 700));
    let case = |name, share, settings: &Settings, size, candidates| {
        let settings = settings.clone();
        Case { name, settings, size, candidates, share, channels: 1, threads: 1, kernels: 0 }
    };
    let (fast, paper) = (Preset::Fast.settings(), Preset::Paper.settings());
    let plain = Settings { synthesis: false, speckle_size: 0, ..robust() };
    let searched = |optimizer| Settings { optimizer, ..paper.clone() };
    let compared = |cost| Settings { cost, ..fast.clone() };
    let (wta, so) = (Optimizer::WinnerTakesAll, Optimizer::ScanlineOptimization);
    let (sgm, dp) = (Optimizer::SemiGlobal, Optimizer::DynamicProgramming);

    vec![
        case("fast", 0.67, &fast, large, 32),
        Case { channels: 3, ..case("fast, colors", 0.72, &fast, large, 32) },
        case("fast, wide", 0.87, &fast, flat, 600),
        case("paper", 0.72, &paper, large, 32),
        case("paper, wide", 0.93, &paper, flat, 600),
        case("robust", 0.67, &plain, large, 32),
        case("robust, wide", 0.83, &plain, high, 600),
        Case { threads: 3, ..case("robust, threads", 0.80, &plain, high, 600) },
        Case { kernels: 6, ..case("kernels", 0.71, &plain, large, 32) },
        Case { kernels: 1, ..case("synthesis", 0.42, &robust(), (800, 1200), 32) },
        Case { channels: 3, ..case("sad", 0.71, &compared(CostKind::Sad), large, 32) },
        Case { channels: 3, ..case("zncc", 0.98, &compared(CostKind::Zncc), large, 32) },
        Case { channels: 3, ..case("nsad", 0.72, &compared(CostKind::NormalizedSad), large, 32) },
        case("wta", 0.88, &searched(wta), flat, 600),
        case("so", 0.86, &searched(so), flat, 600),
        case("sgm", 0.86, &searched(sgm), high, 600),
        case("dp", 0.93, &searched(dp), flat, 600),
    ]
}

impl Case {
    /// Bytes that the match takes, as a share of the model's.
    fn measured(&self) -> f64 {
        let execution = Execution { threads: self.threads, level: Level::best() };
        let matcher = Matcher::new(self.threads).expect("threads");
        let compensation = self.compensation();
        let before = resident("VmRSS:");
        fs::write("/proc/self/clear_refs", "5").expect("the most is that from now on");

        // The caller keeps the images that it passes.
        let given = [3, 0].map(|shift| self.input(shift));
        let pair = Pair::of_inputs(given.clone(), 0, self.candidates as i64);
        let pair = compensated(pair.expect("a legal pair"), compensation.clone());

        let plan = Plan { settings: &self.settings, compensation: Some(&compensation), alignment: None };
        let halo = Halo::new(plan);
        let around = halo.rows() + halo.masked;
        let section = Section { rows: around..self.size.0 - around, ..Section::whole(&pair) };
        let rows = section.rows.len();
        let control = Control::default();
        let found = matcher.match_rows(&pair, &section, &self.settings, execution, &control);
        black_box((given, found.expect("a legal match")));

        let demand = Demand {
            plan,
            cols: self.size.1,
            candidates: self.candidates,
            pixel: self.channels,
            threads: self.threads,
        };
        (resident("VmHWM:") - before) as f64 / bytes(&demand, rows) as f64
    }

    fn input(&self, shift: usize) -> Input {
        let size = (self.size.0, self.size.1, self.channels);
        let pixel = |(y, x, channel)| hash(channel as u64, y, x + shift) as u8;
        Input::from(Image::U8(Array3::from_shape_fn(size, pixel)))
    }

    /// Noise, and kernels of the right image, each in a part of the tiles.
    fn compensation(&self) -> BlurCompensation {
        let noise = [1.0; 2];
        if self.kernels == 0 {
            return BlurCompensation::of_noise(noise).expect("legal noise");
        }
        let kernel = |number: usize| {
            let taps = vec![1.0 / (2 * number + 3) as f64; 2 * number + 3];
            Kernel::separable(&taps, &taps).expect("a legal kernel")
        };
        let kernels = (0..self.kernels).map(|number| [None, Some(kernel(number))]).collect();
        let labels = Plane::from_fn(20, 20, |y, x| ((y + x) % self.kernels) as u8);
        BlurCompensation::new(noise, kernels, labels, 80).expect("a legal compensation")
    }
}
/// Bytes of memory of this process, now (`VmRSS:`) or at the peak (`VmHWM:`).
fn resident(name: &str) -> u64 {
    let status = fs::read_to_string("/proc/self/status").expect("a system that tells");
    let line = status.lines().find(|line| line.starts_with(name)).expect("a line of that name");
    1024 * line.split_whitespace().nth(1).and_then(|word| word.parse::<u64>().ok()).expect("kB")
}

#[test]
fn matches_take_their_share_of_the_model() {
    if let Ok(name) = env::var(CASE) {
        let case = cases().into_iter().find(|case| case.name == name).expect("a case");
        println!("share {}", case.measured());
        return;
    }

    let this = env::current_exe().expect("this program");
    let arguments = ["footprint::matches_take", "--nocapture", "--test-threads=1"];
    let measured = |case: &Case| {
        let done = Command::new(&this).args(arguments).env(CASE, case.name).output().expect("it");
        let text = String::from_utf8_lossy(&done.stdout).into_owned();
        let share = text.lines().find_map(|line| line.split_once("share ")).map(|words| words.1);
        share.and_then(|share| share.parse::<f64>().ok()).unwrap_or_else(|| panic!("{}: {text}", case.name))
    };

    let shares = cases().into_iter().map(|case| (measured(&case), case));
    // Threads are seldom all at their peak at the same time.
    let is_off =
        |found: f64, case: &Case| found > case.share + OFF || found < case.share - OFF * case.threads as f64;
    let wrong = shares.filter(|(found, case)| is_off(*found, case));
    let wrong = wrong.map(|(found, case)| format!("{}: {found:.2}, not {}", case.name, case.share));
    assert_eq!(wrong.collect::<Vec<_>>(), [""; 0]);
}

#[test]
fn what_no_machine_holds_is_not_taken_for_little() {
    let side = u32::MAX as usize;
    let demand = Demand {
        plan: Plan { settings: &robust(), compensation: None, alignment: None },
        cols: side,
        candidates: 256,
        pixel: 24,
        threads: 1,
    };
    assert_eq!(bytes(&demand, side), u64::MAX);
    assert!(bytes(&demand, 1) < u64::MAX);
}
