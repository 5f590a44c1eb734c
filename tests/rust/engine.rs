//! Engines: whatever chunks one accepts, the match has the bits of the core, and its inputs suffice.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use crate::common::naive::ResultBits;
use crate::common::{OPTIMIZERS, hash, mask, robust, view};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::simd::Level;
use phasestereo_match::choices::ENGINE_BANDS;
use phasestereo_match::cost::Costs;
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::section::Section;
use phasestereo_match::matcher::{Execution, Matcher};
use phasestereo_match::optimization::engine::{Chunk, Engine};
use phasestereo_match::optimization::evidence::Evidence;
use phasestereo_match::optimization::memory::Width;
use phasestereo_match::optimization::{BAND, Workspace};
use phasestereo_match::pair::Pair;
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{CostKind, Settings};

const COLS: usize = 70;
/// Three chunks of bands of either height, the last of them with a partial band.
const ROWS: usize = 2 * ENGINE_BANDS * BAND + BAND + 5;

/// Accepts every `step`th chunk, and lets the core search it in wider integers than needed.
#[derive(Debug, Default)]
struct Wide {
    step: usize,
    asked: AtomicUsize,
    /// The rows and the width of each chunk that was offered.
    offered: Mutex<Vec<(Range<usize>, Width)>>,
}

impl Engine for Wide {
    fn choose(&self, rows: Range<usize>, chunk: &Chunk, evidence: &mut Evidence) -> Result<bool> {
        let Chunk { search, source, width } = *chunk;
        self.offered.lock().expect("no panic").push((rows.clone(), width));
        check_codes(source.costs, &rows);
        let number = self.asked.fetch_add(1, Ordering::Relaxed);
        if self.step == 0 || !number.is_multiple_of(self.step) {
            return Ok(false);
        }

        evidence.begin(rows.len(), search.size.1, search.is_weighed())?;
        let mut workspace = Workspace::<u32>::default();
        for band in search.bands(rows.clone()) {
            let found = search.choose(band.clone(), &source, &mut workspace)?;
            for (row, y) in band.enumerate() {
                let found = found.row(row);
                if search.is_weighed() {
                    evidence.set(y - rows.start, 0, found);
                } else {
                    evidence.choose(y - rows.start, 0, found.chosen);
                }
            }
        }
        Ok(true)
    }
}

/// The costs of the middle row must be the Hamming distances of the codes, if there are any.
fn check_codes(costs: &Costs, rows: &Range<usize>) {
    let Some(codes) = costs.codes() else { return };
    let (y, count) = (usize::midpoint(rows.start, rows.end), costs.candidates().count());
    let volume = costs.volume(y + 1, Level::best(), &Control::default()).expect("memory");
    let [left, right] =
        [codes.left, codes.rights[0]].map(|plane| plane.row(y).chunks_exact(plane.cols() / codes.bytes));

    for (x, expected) in volume.row(y).chunks_exact(count).enumerate() {
        for (k, cost) in expected.iter().enumerate() {
            let bytes = left.clone().zip(right.clone());
            let bits = bytes.map(|(left, right)| (left[x] ^ right[COLS - 1 - x + k]).count_ones());
            assert_eq!(bits.sum::<u32>(), u32::from(*cost), "row {y}, column {x}, candidate {k}");
        }
    }
}

fn execution() -> Execution {
    Execution { threads: 2, level: Level::best() }
}

fn pair(is_masked: bool) -> Pair {
    let [left, right] = [0, 3].map(|shift| -> View {
        let image = view(ROWS, COLS, |y, x| hash(5, y, x + shift) as u8);
        image.with_mask(is_masked.then(|| mask(ROWS, COLS, 90, shift as u64)))
    });
    Pair::new(left, right, -2, 9).expect("a legal pair")
}

fn matched(matcher: &Matcher, pair: &Pair, rows: Range<usize>, settings: &Settings) -> ResultBits {
    let (section, control) = (Section { rows, ..Section::whole(pair) }, Control::default());
    let map = matcher.match_rows(pair, &section, settings, execution(), &control);
    ResultBits::new(map.expect("a legal match"))
}

#[test]
fn any_chunks_of_an_engine_leave_the_bits_of_the_core() {
    let core = Matcher::new(2).expect("threads");
    // The noise of the images is unknown here.
    let plain = Settings { noise_threshold: 0.0, ..robust() };
    let all = OPTIMIZERS.map(|optimizer| Settings { optimizer, ..Preset::Fast.settings() });
    let others = [plain, Settings { cost: CostKind::Sad, ..Preset::Fast.settings() }];

    for (index, settings) in all.iter().chain(&others).enumerate() {
        let (pair, rows) = (pair(index == 1), if index % 2 == 0 { 0..ROWS } else { 37..ROWS - 9 });
        let expected = matched(&core, &pair, rows.clone(), settings);
        for step in [0, 1, 2] {
            let engine = Arc::new(Wide { step, ..Wide::default() });
            let matcher = Matcher::new(2).expect("threads").with_engine(engine.clone());
            let found = matched(&matcher, &pair, rows.clone(), settings);
            assert_eq!(found, expected, "every {step}. chunk, {settings:?}");

            // Chunks follow one another, and all but the last end where a band of any height does.
            let offered = engine.offered.lock().expect("no panic");
            assert!(offered.len() >= 3, "{offered:?}");
            assert!(offered.windows(2).all(|two| two[0].0.end == two[1].0.start));
            assert!(offered.windows(2).all(|two| two[0].0.end.is_multiple_of(BAND / 2)));
            let [(first, _), .., (last, _)] = &offered[..] else { panic!("three chunks") };
            assert!(first.start <= rows.start && rows.end <= last.end);
        }
    }
}

#[test]
fn a_cancelled_match_asks_no_engine() {
    let engine = Arc::new(Wide { step: 1, ..Wide::default() });
    let matcher = Matcher::new(1).expect("a thread").with_engine(engine.clone());
    let control = Control::default();
    control.cancel();

    let found = matcher.match_pair(&pair(false), &Preset::Fast.settings(), execution(), &control);
    assert_eq!(found.err(), Some(Error::Cancelled));
    assert_eq!(engine.asked.load(Ordering::Relaxed), 0);
}
