//! The order of the stages; bands of rows on threads. No arithmetic of its own.

use std::any::Any;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::aggregation::{Aggregated, Aggregator, Sweep, Tile, Window};
use crate::candidates::Candidates;
use crate::consistency::Checker;
use crate::control::Control;
use crate::cost::{Costs, Operands};
use crate::edges::Edges;
use crate::error::{Error, Result};
use crate::evidence::{Evidence, EvidenceRow};
use crate::intensity;
use crate::map::{Band, Map};
use crate::plane::Plane;
use crate::refinement::{Draft, Judge, Margins, Measure};
use crate::scanline::{self, Scanline, Steps};
use crate::section::Section;
use crate::semiglobal::across::{Across, Advance, Rows};
use crate::semiglobal::{BAND, Field, PATHS, SemiGlobal};
use crate::settings::{Optimizer, Rule, Settings};
use crate::simd::Level;
use crate::strip::{BLOCK, Strip};
use crate::texture::Texture;
use crate::value::Value;
use crate::versions::Versions;
use crate::view::View;

/// Most threads that one match may ask for.
pub const MOST_THREADS: usize = 1024;
/// Blocks of rows that a strip has at most: the more, the smaller the share of its margins. Nanoseconds per
/// (pixel, candidate) of 741x497 with 64 and 1920x1080 with 256 candidates, AVX2, Zen 3: 2: 0.61, 0.45; 3:
/// 0.61, 0.41; 4: 0.59, 0.41; 6: 0.58, 0.40.
const MOST_BLOCKS: usize = 6;

/// What is matched, and how far to search.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    left: View,
    right: View,
    candidates: Candidates,
    versions: Option<Versions>,
}

/// How the work is cut up; the result does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Execution {
    /// Number of threads.
    pub threads: usize,
    /// Rows that one task matches; `None`: as suits the window and the threads.
    pub strip_rows: Option<usize>,
    /// Instructions to use.
    pub level: Level,
}

/// A disparity map and what is known about it, as seen from the left image.
#[derive(Debug, Clone, PartialEq)]
pub struct Disparity {
    /// Disparity, pixels; NaN where there is none.
    pub disparity: Plane<f32>,
    /// Bits of [`crate::refinement::flag`].
    pub flags: Plane<u16>,
    /// From 0 to 1; `None`: not worked out.
    pub confidence: Option<Plane<f32>>,
    /// Wall-clock time of each stage.
    pub timings: Timings,
}

/// Wall-clock time of each stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Timings {
    /// Images to codes (or to whatever else the cost compares).
    pub description: Duration,
    /// Codes to disparities.
    pub matching: Duration,
    /// Disparities to those that are filled and smoothed, with confidences.
    pub refinement: Duration,
}

impl Pair {
    /// A pair that can be matched: of one size and type, with proper pixels and a reachable range.
    pub fn new(left: View, right: View, min_disparity: i64, num_disparities: i64) -> Result<Self> {
        left.check("left")?;
        right.check("right")?;
        let (rows, cols, _) = left.image.shape();
        let (right_rows, right_cols, _) = right.image.shape();
        if (rows, cols) != (right_rows, right_cols) {
            let got = format!("{right_rows} x {right_cols} pixels");
            return Err(Error::value("right", got, format!("the size of left, {rows} x {cols}")));
        }
        if std::mem::discriminant(&left.image) != std::mem::discriminant(&right.image) {
            return Err(Error::value("right", "pixels of another type", "the type of left"));
        }
        let candidates = Candidates::new(min_disparity, num_disparities, cols)?;
        Ok(Self { left, right, candidates, versions: None })
    }

    /// The pair with the versions in which its pixels are compared.
    pub fn with_versions(self, versions: impl Into<Option<Versions>>) -> Self {
        Self { versions: versions.into(), ..self }
    }

    /// The pair as a part of one whose left and right pixels, if they are floats, lie in these ranges.
    pub fn with_ranges(mut self, ranges: [Option<intensity::Range>; 2]) -> Self {
        let [left, right] = ranges;
        (self.left.range, self.right.range) = (left, right);
        self
    }

    /// Left and right view.
    pub fn views(&self) -> [&View; 2] {
        [&self.left, &self.right]
    }

    /// The disparities to search.
    pub fn candidates(&self) -> Candidates {
        self.candidates
    }

    /// The versions in which the pixels are compared; `None`: as they are.
    pub fn versions(&self) -> Option<&Versions> {
        self.versions.as_ref()
    }

    /// Rows and columns of either image.
    pub fn size(&self) -> (usize, usize) {
        let (rows, cols, _) = self.left.image.shape();
        (rows, cols)
    }
}

/// Matches pairs, one after another or several at a time; threads and memory are used again.
#[derive(Debug)]
pub struct Matcher {
    pool: rayon::ThreadPool,
    /// Memory that no strip is being matched in.
    spare: Mutex<Vec<Box<dyn Any + Send>>>,
}

/// What was chosen for some rows.
#[derive(Debug)]
pub struct Choice {
    /// The map, to be refined.
    pub map: Map,
    /// Where paths have come to after the last row, if that was asked for and the optimizer has any.
    pub paths: Option<Vec<u8>>,
    /// The left image, if the settings need it.
    pub texture: Option<Texture>,
    /// Wall-clock time of each stage so far.
    pub timings: Timings,
}

/// What a strip is matched in.
#[derive(Debug)]
struct Workspace<V, T> {
    operands: Operands,
    aggregator: Aggregator<V>,
    scanline: Scanline<T>,
    across: Across<V, T>,
    margins: Margins<V>,
    evidence: Evidence,
}

/// All that the strips of a match have in common.
struct Job<'a> {
    costs: &'a Costs<'a>,
    window: Window,
    steps: Steps,
    edges: Option<&'a Edges>,
    section: &'a Section,
    settings: &'a Settings,
    level: Level,
    control: &'a Control,
}

/// Matches a pair on threads of its own.
///
/// They live as long as the match: a pool that outlived it would be dead, and waited for, in a forked
/// child of the process.
pub fn run(
    pair: &Pair,
    settings: &Settings,
    how: Execution,
    control: &Control,
) -> Result<Disparity> {
    Matcher::new(how.threads)?.run(pair, settings, how, control)
}

/// Runs `work` on so many threads, started for it and ended after it.
pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T> {
    Ok(thread_pool(threads)?.install(work))
}

fn thread_pool(threads: usize) -> Result<rayon::ThreadPool> {
    if !(1..=MOST_THREADS).contains(&threads) {
        return Err(Error::value(
            "threads",
            threads,
            format!("an integer from 1 to {MOST_THREADS}"),
        ));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|error| Error::Threads(error.to_string()))
}

impl Matcher {
    /// A matcher with so many threads.
    pub fn new(threads: usize) -> Result<Self> {
        Ok(Self { pool: thread_pool(threads)?, spare: Mutex::default() })
    }

    /// Has the threads do some work, and does not wait for it, which must not panic.
    pub fn spawn(&self, work: impl FnOnce() + Send + 'static) {
        self.pool.spawn(work);
    }

    /// Has the threads do some work, and waits for it.
    pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.pool.install(work)
    }

    /// Matches a pair.
    pub fn run(
        &self,
        pair: &Pair,
        settings: &Settings,
        how: Execution,
        control: &Control,
    ) -> Result<Disparity> {
        settings.check()?;
        self.pool.install(|| self.match_pair(pair, settings, how, control))
    }

    /// Matches some rows of a pair, to be refined together with those around them.
    pub fn choose(
        &self,
        pair: &Pair,
        section: &Section,
        settings: &Settings,
        how: Execution,
        control: &Control,
    ) -> Result<Choice> {
        settings.check()?;
        section.check(pair, settings)?;
        self.pool.install(|| self.choose_rows(pair, section, settings, how, control))
    }

    /// Refines a map of some rows; `texture` is of the same rows, if the settings need it.
    pub fn refine(
        &self,
        map: Map,
        texture: Option<&Texture>,
        settings: &Settings,
        how: Execution,
        control: &Control,
    ) -> Result<Disparity> {
        settings.check()?;
        map.check(texture, settings)?;
        self.pool.install(|| refined(map, texture, settings, how.level, control))
    }

    fn match_pair(
        &self,
        pair: &Pair,
        settings: &Settings,
        how: Execution,
        control: &Control,
    ) -> Result<Disparity> {
        let section = Section::whole(pair);
        let choice = self.choose_rows(pair, &section, settings, how, control)?;
        let refined = refined(choice.map, choice.texture.as_ref(), settings, how.level, control)?;
        let refinement = refined.timings.refinement;
        Ok(Disparity { timings: Timings { refinement, ..choice.timings }, ..refined })
    }

    fn choose_rows(
        &self,
        pair: &Pair,
        section: &Section,
        settings: &Settings,
        how: Execution,
        control: &Control,
    ) -> Result<Choice> {
        let started = Instant::now();
        let (views, candidates, level) = (pair.views(), pair.candidates, how.level);
        let costs = Costs::new(views, candidates, settings, pair.versions(), level, control)?;
        let described = Instant::now();
        let texture = Texture::of_view(&pair.left, settings, section.roughness, level, control)?;
        let edges = Edges::asked_for(texture.as_ref(), settings, level, control)?;
        let mut map = Map::new((section.rows.len(), pair.size().1), settings.needs_confidence())?;
        let window = Window::new(pair.size(), candidates.count(), settings, costs.ceiling());
        let steps = Steps::new(settings.penalty, window, costs.steps());
        let edges = edges.as_ref();
        let job = Job { costs: &costs, window, steps, edges, section, settings, level, control };
        let bands =
            map.bands(section.rows.start, job.band_rows(how, self.pool.current_num_threads()));
        let paths = match job.width() {
            Width::Bytes => self.match_bands::<u8, u8>(bands, &job),
            Width::ByteCosts => self.match_bands::<u8, u32>(bands, &job),
            Width::WordCosts => self.match_bands::<u16, u32>(bands, &job),
            Width::Widest => self.match_bands::<u32, u64>(bands, &job),
        }?;
        let (description, matching) = (described - started, described.elapsed());
        let timings = Timings { description, matching, refinement: Duration::ZERO };
        Ok(Choice { map, paths, texture, timings })
    }

    /// Matches bands, each by itself where the optimizer lets it be; where it does not, paths go on after the last one.
    fn match_bands<V: Value, T: Value>(
        &self,
        mut bands: Vec<Band>,
        job: &Job,
    ) -> Result<Option<Vec<u8>>> {
        match job.settings.optimizer {
            Optimizer::Scanline(rule) => {
                let parts = bands.into_par_iter();
                parts.try_for_each(|band| self.match_band::<V, T>(band, rule, job))?;
                Ok(None)
            }
            Optimizer::SemiGlobal => {
                let mut search: Box<SemiGlobal<V, T>> = self.memory();
                search.run(
                    job.field(),
                    (job.section.rows.start / BAND, job.section.paths.as_deref()),
                    &mut bands,
                    |band, rows| self.load_rows(job.strip(band), rows, job),
                    |band, evidence| job.write(band, evidence),
                )?;
                let paths = job.section.is_handed_on.then(|| search.paths());
                self.keep(search);
                Ok(paths)
            }
        }
    }

    /// Costs of a band, and the paths along its rows: cost -> aggregation -> paths.
    fn load_rows<V: Value, T: Value>(
        &self,
        strip: Strip,
        rows: &mut Rows<V, T>,
        job: &Job,
    ) -> Result<()> {
        let mut workspace: Box<Workspace<V, T>> = self.memory();
        workspace.operands.load(job.costs, &strip)?;
        workspace.across(rows, strip, job)?;
        workspace.across.finish(rows, job.level)?;
        self.keep(workspace);
        Ok(())
    }

    /// Matches the rows of one band: cost -> aggregation -> scanline -> refinement.
    fn match_band<V: Value, T: Value>(&self, mut band: Band, rule: Rule, job: &Job) -> Result<()> {
        let strip = band.strip(job.window);
        let mut workspace: Box<Workspace<V, T>> = self.memory();
        workspace.operands.load(job.costs, &strip)?;
        workspace.choose(strip, rule, job)?;
        if job.settings.needs_evidence() {
            workspace.measure(strip, job)?;
            workspace.tell(strip, job)?;
            job.write(&mut band, &workspace.evidence)?;
        } else {
            workspace.write(&mut band, strip, job);
        }
        job.control.finish_rows(strip.rows);
        self.keep(workspace);
        Ok(())
    }

    /// Memory to work in: used before, if there is any of this kind.
    #[expect(clippy::unnecessary_box_returns, reason = "the box is what is kept")]
    fn memory<M: Default + Send + 'static>(&self) -> Box<M> {
        let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
        let found = spare.iter().rposition(|memory| memory.is::<M>());
        let found = found.map(|index| spare.swap_remove(index));
        found.and_then(|memory| memory.downcast().ok()).unwrap_or_default()
    }

    /// Keeps memory to be used again.
    fn keep(&self, memory: Box<dyn Any + Send>) {
        self.spare.lock().unwrap_or_else(PoisonError::into_inner).push(memory);
    }
}

impl<V: Value, T: Value> Default for Workspace<V, T> {
    fn default() -> Self {
        Self {
            operands: Operands::default(),
            aggregator: Aggregator::default(),
            scanline: Scanline::default(),
            across: Across::default(),
            margins: Margins::default(),
            evidence: Evidence::default(),
        }
    }
}

impl<V: Value, T: Value> Workspace<V, T> {
    /// Finds the best candidate of every pixel of the strip.
    fn choose(&mut self, strip: Strip, rule: Rule, job: &Job) -> Result<()> {
        let Self { operands, aggregator, scanline, .. } = self;
        scanline.begin(job.window, strip, rule, job.steps)?;
        job.sweep(strip, operands, aggregator, |tile, costs| {
            job.level.run(scanline::Advance { scanline, tile, costs });
        })?;
        scanline.trace_back();
        Ok(())
    }

    /// Finds the paths along the rows of the strip.
    fn across(&mut self, rows: &mut Rows<V, T>, strip: Strip, job: &Job) -> Result<()> {
        let Self { operands, aggregator, across, .. } = self;
        let Window { cols, candidates, .. } = job.window;
        across.begin(rows, strip, (cols, candidates), job.steps, job.edges)?;
        job.sweep(strip, operands, aggregator, |tile, costs| {
            job.level.run(Advance { across, rows, tile, costs });
        })
    }

    /// Sweeps over the costs again, to see by how much the chosen candidates are better than others.
    fn measure(&mut self, strip: Strip, job: &Job) -> Result<()> {
        let Self { operands, aggregator, scanline, margins, .. } = self;
        let (blocks, cols) = (strip.blocks(), job.window.cols);
        margins.begin(cols * blocks)?;
        let chosen = scanline.chosen();
        job.sweep(strip, operands, aggregator, |tile, costs| {
            job.level.run(Measure { margins, chosen, tile, costs, blocks, cols });
        })
    }

    /// Brings together what was found of the strip.
    fn tell(&mut self, strip: Strip, job: &Job) -> Result<()> {
        let Self { scanline, margins, evidence, .. } = self;
        let Window { cols, candidates, .. } = job.window;
        evidence.begin(strip.rows, cols)?;
        let chosen = scanline.chosen();
        places(strip.rows, cols).for_each(|(lane, x)| {
            let place = (lane / BLOCK * cols + x) * BLOCK + lane % BLOCK;
            let (own, elsewhere, offset) = margins.of(place, chosen[place], candidates);
            let found = EvidenceRow {
                chosen: &[chosen[place]],
                own: &[own],
                elsewhere: &[elsewhere],
                offset: &[offset],
            };
            evidence.set(lane, x, found);
        });
        Ok(())
    }

    /// Writes what was chosen for the strip into the map, when nothing else is to be known of it.
    fn write(&self, band: &mut Band, strip: Strip, job: &Job) {
        let (chosen, cols, judge) = (self.scanline.chosen(), job.window.cols, job.judge());
        places(strip.rows, cols).for_each(|(lane, x)| {
            let index = chosen[(lane / BLOCK * cols + x) * BLOCK + lane % BLOCK];
            let flags = judge.flags(strip.first + lane, x, index.into());
            let place = lane * cols + x;
            (band.disparity[place], band.flags[place]) = (judge.disparity(index, flags), flags);
        });
    }
}

/// The pixels of a strip, a few columns of a block at a time: these are at hand.
fn places(rows: usize, cols: usize) -> impl Iterator<Item = (usize, usize)> {
    let corners = (0..rows)
        .step_by(BLOCK)
        .flat_map(move |top| (0..cols).step_by(BLOCK).map(move |left| (top, left)));
    corners.flat_map(move |(top, left)| {
        let lanes = top..(top + BLOCK).min(rows);
        lanes.flat_map(move |lane| (left..(left + BLOCK).min(cols)).map(move |x| (lane, x)))
    })
}

impl Job<'_> {
    /// Aggregates the costs of a strip, a tile at a time, and hands them on.
    fn sweep<V: Value>(
        &self,
        strip: Strip,
        operands: &mut Operands,
        aggregator: &mut Aggregator<V>,
        mut hand_on: impl FnMut(&Tile, Aggregated<V>),
    ) -> Result<()> {
        aggregator.begin(self.window, strip, operands.has_votes())?;
        for tile in self.window.tiles() {
            self.control.checkpoint()?;
            operands.mix(&tile.entering, self.level)?;
            self.level.run(Sweep { aggregator, operands, tile: &tile });
            hand_on(&tile, aggregator.aggregated());
        }
        Ok(())
    }

    fn field(&self) -> Field<'_> {
        Field {
            size: (self.window.rows, self.window.cols),
            candidates: self.window.candidates,
            steps: self.steps,
            edges: self.edges,
            level: self.level,
            control: self.control,
        }
    }

    /// Writes what was found of a band into the map.
    fn write(&self, band: &mut Band, evidence: &Evidence) -> Result<()> {
        let (judge, mut checker) = (self.judge(), Checker::default());
        for (row, y) in band.strip(self.window).range().enumerate() {
            judge.write(y, evidence.row(row), &mut checker, band.row(row))?;
        }
        Ok(())
    }

    /// The strip of a band of the pair, with [`Optimizer::SemiGlobal`].
    fn strip(&self, band: usize) -> Strip {
        let (first, height) = (band * BAND, self.window.rows);
        let rows = BAND.min(height - first);
        Strip { first, rows, margin: self.window.margin(), height }
    }

    /// Rows of the bands that the map is written in.
    fn band_rows(&self, how: Execution, threads: usize) -> usize {
        match self.settings.optimizer {
            Optimizer::Scanline(_) => {
                how.rows_per_strip(self.section.rows.len(), self.window.margin(), threads)
            }
            Optimizer::SemiGlobal => BAND,
        }
    }

    fn judge(&self) -> Judge<'_> {
        let paths = match self.settings.optimizer {
            Optimizer::Scanline(_) => 1,
            Optimizer::SemiGlobal => PATHS,
        };
        Judge {
            candidates: self.costs.candidates(),
            cols: self.window.cols,
            votes: self.costs.votes(),
            subpixel: self.settings.subpixel,
            consistency: self.settings.consistency.map(|most| most as u16),
            uniqueness: self.settings.uniqueness as u64,
            unit: (self.window.unit(self.costs.steps()) * f64::from(paths)) as f32,
        }
    }

    /// The narrowest integers that hold every sum and every total.
    fn width(&self) -> Width {
        let largest_cost = self.window.largest_value(self.costs.votes().is_some());
        let largest_sum = self.window.largest_sum();
        let largest_total = match self.settings.optimizer {
            Optimizer::Scanline(rule) => {
                self.steps.largest_total(rule, self.window.cols, largest_sum)
            }
            Optimizer::SemiGlobal => self.steps.largest_change().saturating_add(largest_sum),
        };
        Width::holding(largest_cost, largest_total)
    }
}

impl Execution {
    /// Rows that one task matches: those with which the threads are done soonest, counting the margins.
    fn rows_per_strip(self, all: usize, margin: usize, threads: usize) -> usize {
        let rounds = |rows: usize| all.div_ceil(rows).div_ceil(threads);
        let work = |rows: &usize| rounds(*rows) * (rows + 2 * margin);
        let likely = (1..=MOST_BLOCKS).rev().map(|blocks| blocks * BLOCK).min_by_key(work);
        self.strip_rows.or(likely).unwrap_or(BLOCK).max(1)
    }
}

/// Tells what cannot be right, fills it, smooths.
fn refined(
    map: Map,
    texture: Option<&Texture>,
    settings: &Settings,
    level: Level,
    control: &Control,
) -> Result<Disparity> {
    let started = Instant::now();
    let Map { disparity, mut flags, votes } = map;
    let draft = Draft { disparity, flags: &mut flags, votes: votes.as_ref(), texture };
    let (disparity, confidence) = draft.refine(settings, level, control)?;
    let confidence = confidence.filter(|_| settings.confidence);
    let timings = Timings { refinement: started.elapsed(), ..Timings::default() };
    Ok(Disparity { disparity, flags, confidence, timings })
}

/// What integers a strip is made of: those of its costs and of its totals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Width {
    Bytes,
    ByteCosts,
    WordCosts,
    Widest,
}

impl Width {
    fn holding(largest_cost: u64, largest_total: u64) -> Self {
        if largest_cost > u16::MAX.into() || largest_total > u32::LARGEST_TOTAL {
            Self::Widest
        } else if largest_cost > u8::MAX.into() {
            Self::WordCosts
        } else if largest_total > u8::LARGEST_TOTAL {
            Self::ByteCosts
        } else {
            Self::Bytes
        }
    }
}
