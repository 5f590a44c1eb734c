//! The order of the stages, and bands of rows on threads, without arithmetic of its own.

pub mod footprint;
pub mod halo;
pub mod map;
pub mod runtime;
pub mod section;
pub mod summary;

use std::any::Any;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use std::{env, mem, thread};

use rayon::prelude::*;

use crate::base::control::Control;
use crate::base::error::{Error, Result};
use crate::base::plane::{Plane, widened};
use crate::base::platform::{Instant, ThreadPool};
use crate::base::simd::Level;
use crate::base::value::Value;
use crate::choices::ENGINE_BANDS;
use crate::cost::Costs;
use crate::cost::aggregation::Window;
use crate::image::texture::Texture;
use crate::matcher::halo::Halo;
use crate::matcher::map::{DraftMap, MapBand};
use crate::matcher::section::Section;
use crate::optimization::edges::Edges;
use crate::optimization::engine::{Chunk, Engine};
use crate::optimization::evidence::{Evidence, NONE};
use crate::optimization::memory::{self, Width};
use crate::optimization::{AggregatedCosts, CandidateSearch, Penalties, Weighing, Workspace};
use crate::pair::Pair;
use crate::pair::candidates::Candidates;
use crate::pair::plan::{Demand, Plan};
use crate::refinement::calibration::{ConfidenceCalibration, Faults, Tally, Weights, traits};
use crate::refinement::left_right_check::Checker;
use crate::refinement::sample::{self, SampledMap};
use crate::refinement::synthesis;
use crate::refinement::{Draft, MapWriter, invalidate};
use crate::settings::{Optimizer, Settings};

/// Most threads that one match may use.
pub const MOST_THREADS: usize = 1024;

/// Threads and instructions; the result does not depend on them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Execution {
    /// Number of threads.
    pub threads: usize,
    /// Instructions to use.
    pub level: Level,
}

/// A disparity map as seen from the left image, with flags and confidence.
#[derive(Debug, Clone, PartialEq)]
pub struct Disparity {
    /// Disparity, pixels; NaN: none.
    pub disparity: Plane<f32>,
    /// Bits of [`crate::refinement::flag`].
    pub flags: Plane<u16>,
    /// Confidence from 0 to 1; `None`: not computed.
    pub confidence: Option<Plane<f32>>,
    /// Half the width of the interval that holds the true disparity with a probability of 90 %, pixels; NaN
    /// where there is no estimate. `None`: not computed.
    pub uncertainty: Option<Plane<f32>>,
    /// Without confidences, the estimated share of disparities that are off by more than 1 px, from those of
    /// a few rows; `None`: with confidences, or if nothing could be sampled.
    pub wrong: Option<f64>,
    /// Where smaller copies decided, the finest detail of the images, pixels: how many times smaller the
    /// copies are, as a geometric mean over the pixels. `None`: none decided.
    pub detail: Option<f64>,
    /// Wall-clock time of each stage.
    pub timings: Timings,
}

impl Disparity {
    /// The map of a turned pair, turned back.
    pub fn turned_back(self) -> Self {
        Self {
            disparity: self.disparity.turned_back(),
            flags: self.flags.turned_back(),
            confidence: self.confidence.as_ref().map(Plane::turned_back),
            uncertainty: self.uncertainty.as_ref().map(Plane::turned_back),
            ..self
        }
    }
}

/// Wall-clock time of each stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Timings {
    /// From images to codes (or whatever else the cost compares).
    pub description: Duration,
    /// From codes to unrefined disparities.
    pub matching: Duration,
    /// From unrefined to filled and smoothed disparities, with confidences.
    pub refinement: Duration,
    /// From there to a map that is decided over scales, including the match of smaller copies.
    pub scales: Duration,
    /// Whether the scales were skipped because the budget left no time.
    pub is_cut_short: bool,
}

impl Timings {
    /// The time of all stages.
    pub fn total(&self) -> Duration {
        self.description + self.matching + self.refinement + self.scales
    }
}

/// Matches pairs, one after another or several at a time, and reuses threads and memory.
#[derive(Debug)]
pub struct Matcher {
    pool: ThreadPool,
    /// Workspaces that no band is using, the most recently used one last.
    spare: Mutex<Vec<Spare>>,
    /// The engine that searches instead of the core; `None`: the core searches.
    engine: Option<Arc<dyn Engine>>,
}

/// A workspace of any type.
#[derive(Debug)]
struct Spare {
    memory: Box<dyn Any + Send>,
    /// The most bytes that it can take, by the memory model.
    bytes: usize,
}

/// The unrefined disparities of some rows.
struct Unrefined<'a> {
    /// The map.
    map: DraftMap,
    /// The texture of the left image, if the settings need it.
    texture: Option<Texture<'a>>,
    /// Wall-clock time of each stage so far.
    timings: Timings,
}

/// The shared data of the bands of a match.
struct Job<'a> {
    costs: &'a Costs<'a>,
    window: Window,
    search: CandidateSearch<'a>,
    settings: &'a Settings,
    /// Bytes of the workspace of a band, by the memory model.
    workspace: usize,
}

/// Runs `work` on threads that start before it and end after it.
pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T> {
    Ok(thread_pool(threads)?.install(work))
}

/// The number of threads in the environment variable `RAYON_NUM_THREADS`, or else the number of cores that
/// the process may use.
pub fn usable_threads() -> usize {
    let wanted = env::var("RAYON_NUM_THREADS").ok().and_then(|text| text.parse().ok());
    let usable = || thread::available_parallelism().map_or(1, Into::into);

    wanted.filter(|&count| count > 0).unwrap_or_else(usable).min(MOST_THREADS)
}

/// The plan for a pair that does not need straightening.
fn plan<'a>(pair: &'a Pair, settings: &'a Settings) -> Plan<'a> {
    Plan { settings, compensation: pair.blur_compensation(), alignment: None }
}

fn thread_pool(threads: usize) -> Result<ThreadPool> {
    if !(1..=MOST_THREADS).contains(&threads) {
        return Err(Error::value("threads", threads, format!("an integer from 1 to {MOST_THREADS}")));
    }

    ThreadPool::new(threads)
}

impl Matcher {
    /// A matcher with 1 to 1024 threads.
    pub fn new(threads: usize) -> Result<Self> {
        Ok(Self { pool: thread_pool(threads)?, spare: Mutex::default(), engine: None })
    }

    /// Adds an engine that searches; the core does whatever it does not accept.
    pub fn with_engine(self, engine: Arc<dyn Engine>) -> Self {
        Self { engine: Some(engine), ..self }
    }

    /// Why the engine no longer searches; `None`: nothing failed.
    pub fn engine_failure(&self) -> Option<String> {
        self.engine.as_ref()?.failure()
    }

    /// Starts work on the threads without waiting for it. The work must not panic.
    pub fn spawn(&self, work: impl FnOnce() + Send + 'static) {
        self.pool.spawn(work);
    }

    /// Runs work on the threads and waits for it.
    pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        self.pool.install(work)
    }

    /// Matches a pair.
    pub fn match_pair(
        &self,
        pair: &Pair,
        settings: &Settings,
        execution: Execution,
        control: &Control,
    ) -> Result<Disparity> {
        self.match_rows(pair, &Section::whole(pair), settings, execution, control)
    }

    /// Matches some rows of a pair: bit for bit as in the whole pair, if the pair contains their halo.
    pub fn match_rows(
        &self,
        pair: &Pair,
        section: &Section,
        settings: &Settings,
        execution: Execution,
        control: &Control,
    ) -> Result<Disparity> {
        Ok(self.match_calibrated(pair, section, settings, execution, control)?.returned(settings))
    }

    /// [`Self::match_rows`] with all estimated disparities, including those that the settings reject.
    pub fn match_calibrated(
        &self,
        pair: &Pair,
        section: &Section,
        settings: &Settings,
        execution: Execution,
        control: &Control,
    ) -> Result<Disparity> {
        let raw = self.match_raw(pair, section, settings, execution, control)?;
        self.pool.install(|| {
            let tally = section.tally.or_else(|| raw.tally(pair.candidates()));
            let faults = Faults::of_pair(pair);
            raw.calibrated(tally, faults, settings.optimizer, execution.level)
        })
    }

    /// [`Self::match_rows`] with raw confidences. The sums over these rows are those that calibration needs,
    /// if the rows are to be sampled.
    pub fn match_raw(
        &self,
        pair: &Pair,
        section: &Section,
        settings: &Settings,
        execution: Execution,
        control: &Control,
    ) -> Result<Disparity> {
        settings.check()?;
        section.check(pair)?;

        // Refinement reads unrefined rows around these, so more rows are matched, then cut off.
        let around = widened(&section.rows, Halo::new(plan(pair, settings)).map, pair.size().0);
        let wanted = section.rows.start - around.start..section.rows.end - around.start;
        let wider = Section { rows: around, ..section.clone() };

        let found = self.pool.install(|| self.refined(pair, &wider, settings, execution, control))?;
        Ok(found.of_rows(wanted))
    }

    /// Matches some rows of a pair, and refines their map as if the pair had no other rows. Confidences stay
    /// raw, as needed by the stages before the match of the pair itself.
    pub fn match_alone(
        &self,
        pair: &Pair,
        section: &Section,
        settings: &Settings,
        execution: Execution,
        control: &Control,
    ) -> Result<Disparity> {
        settings.check()?;
        section.check(pair)?;

        let found = self.pool.install(|| self.refined(pair, section, settings, execution, control))?;
        Ok(found.returned(settings))
    }

    fn refined(
        &self,
        pair: &Pair,
        section: &Section,
        settings: &Settings,
        execution: Execution,
        control: &Control,
    ) -> Result<Disparity> {
        let unrefined = self.choose(pair, section, settings, execution, control)?;
        unrefined.refined(pair, section.rows.clone(), settings, execution.level, control)
    }

    fn choose<'a>(
        &self,
        pair: &'a Pair,
        section: &Section,
        settings: &Settings,
        execution: Execution,
        control: &Control,
    ) -> Result<Unrefined<'a>> {
        let started = Instant::now();
        let (candidates, level) = (pair.candidates(), execution.level);
        let costs = Costs::new(pair.views(), candidates, settings, pair.blur_compensation(), level, control)?;
        let description = started.elapsed();

        let started = Instant::now();
        let texture = Texture::of_view(pair.views()[0], settings, section.roughness);
        let edges = Edges::asked_for(texture.as_ref(), settings, pair.size().1, level, control)?;

        let window = Window::new(pair.size(), candidates.count(), settings, costs.ceiling());
        let search = CandidateSearch {
            size: pair.size(),
            first: section.first,
            candidates: candidates.count(),
            ranges: section.ranges.as_ref(),
            optimizer: settings.optimizer,
            penalties: Penalties::new(settings, window, costs.steps()),
            edges: &edges,
            weighs: if settings.needs_evidence() {
                Weighing::All
            } else {
                Weighing::Sampled(sample::is_weighed)
            },
            level,
            control,
        };

        let demand = Demand {
            plan: plan(pair, settings),
            cols: pair.size().1,
            candidates: candidates.count(),
            pixel: 1,
            threads: execution.threads,
        };
        let workspace = memory::workspace(&demand);
        let job = Job { costs: &costs, window, search, settings, workspace };

        let mut map = DraftMap::new((section.rows.len(), pair.size().1), texture.is_some())?;
        let bands = map.bands(job.search.bands(section.rows.clone()));
        let width = Width::new(settings, window, job.search.penalties, costs.has_masks());
        let bands = self.match_by_engine(bands, &job, width)?;
        // The narrower the integers, the more candidates fit a register.
        match width {
            Width::Bytes => self.match_bands::<u8>(bands, &job),
            Width::Words => self.match_bands::<u16>(bands, &job),
            Width::Widest => self.match_bands::<u32>(bands, &job),
        }?;
        let matching = started.elapsed();

        let timings = Timings { description, matching, ..Timings::default() };
        Ok(Unrefined { map, texture, timings })
    }

    /// Lets the engine search, chunk by chunk, and returns the bands that are left to the core.
    fn match_by_engine<'m>(
        &self,
        mut bands: Vec<MapBand<'m>>,
        job: &Job,
        width: Width,
    ) -> Result<Vec<MapBand<'m>>> {
        let Some(engine) = &self.engine else { return Ok(bands) };
        let chunk = Chunk { search: &job.search, source: job.source(), width };
        let (mut evidence, mut left) = (Evidence::default(), Vec::new());

        while !bands.is_empty() {
            job.search.control.checkpoint()?;
            let next = bands.split_off(ENGINE_BANDS.min(bands.len()));
            let here = mem::replace(&mut bands, next);
            let rows = here[0].rows().start..here[here.len() - 1].rows().end;

            if engine.choose(rows.clone(), &chunk, &mut evidence)? {
                here.into_par_iter().with_max_len(1).try_for_each(|mut band| {
                    let first = band.rows().start - rows.start;
                    job.write(&mut band, &evidence, first)
                })?;
            } else {
                left.extend(here);
            }
        }

        Ok(left)
    }

    /// Matches bands, each by itself: cost -> aggregation -> optimization -> disparity and flags of each
    /// pixel.
    fn match_bands<T: Value>(&self, bands: Vec<MapBand>, job: &Job) -> Result<()> {
        // One band per task: longer tasks would leave threads idle at the end.
        bands.into_par_iter().with_max_len(1).try_for_each(|mut band| {
            let (mut workspace, bytes): (Box<Workspace<T>>, _) = self.memory();
            let evidence = job.search.choose(band.rows(), &job.source(), &mut workspace)?;
            job.write(&mut band, evidence, 0)?;

            let bytes = bytes.max(job.workspace);
            self.spare().push(Spare { memory: workspace, bytes });
            Ok(())
        })
    }

    /// A workspace of this type, reused if possible, and its bytes by the memory model.
    fn memory<M: Default + Send + 'static>(&self) -> (Box<M>, usize) {
        let mut spare = self.spare();
        let index = spare.iter().rposition(|spare| spare.memory.is::<M>());
        let Spare { memory, bytes } = index
            .map_or_else(|| Spare { memory: Box::<M>::default(), bytes: 0 }, |index| spare.remove(index));

        (memory.downcast().unwrap_or_default(), bytes)
    }

    /// Frees idle workspaces, the least recently used ones first, until the others have at most `bytes`.
    pub fn keep_at_most(&self, bytes: usize) {
        let mut spare = self.spare();
        let mut kept = spare.iter().map(|spare| spare.bytes).sum::<usize>();
        spare.retain(|one| {
            let is_kept = kept <= bytes;
            kept -= if is_kept { 0 } else { one.bytes };
            is_kept
        });
    }

    fn spare(&self) -> MutexGuard<'_, Vec<Spare>> {
        self.spare.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<'a> Job<'a> {
    fn source(&self) -> AggregatedCosts<'a> {
        let Self { costs, window, search, .. } = *self;
        AggregatedCosts { costs, window, level: search.level }
    }

    /// Writes the disparities and flags of a band into the map; its evidence begins at row `first`.
    fn write(&self, band: &mut MapBand, evidence: &Evidence, first: usize) -> Result<()> {
        let writer = self.writer();
        let mut checker = Checker::default();

        for (row, y) in band.rows().enumerate() {
            let (found, mut out) = (evidence.row(first + row), band.row(row));
            let found = if self.search.weighs(y) { found } else { found.bare() };
            // Without confidences, those of a sample estimate the share of wrong disparities.
            let is_voted = self.settings.needs_confidence() || sample::is_weighed(self.search.first + y);
            out.votes = out.votes.filter(|_| is_voted);

            writer.write(y, found, &mut checker, out, self.search.level)?;
        }

        self.search.control.finish_rows(band.rows().len());
        Ok(())
    }

    fn writer(&self) -> MapWriter<'_> {
        MapWriter {
            candidates: self.costs.candidates(),
            cols: self.window.cols,
            validity: self.costs.validity(),
            subpixel: self.settings.subpixel,
            consistency: self.settings.lr_check.map(|most| most as u16),
            uniqueness: self.settings.uniqueness as u64,
            unit: self.window.unit(self.costs.steps()) as f32,
            unrelated: self.costs.unrelated().map_or(NONE, |cost| (cost * self.window.unit(1)) as u32),
        }
    }
}

impl Unrefined<'_> {
    /// Flags disparities that cannot be right, fills them and smooths the map. The map covers these rows of
    /// the pair.
    fn refined(
        self,
        pair: &Pair,
        rows: Range<usize>,
        settings: &Settings,
        level: Level,
        control: &Control,
    ) -> Result<Disparity> {
        let started = Instant::now();
        let (views, compensation) = (pair.views(), pair.blur_compensation());
        let blurred_pair =
            synthesis::BlurredPair::new(views, compensation, rows.clone(), settings, level, control)?;
        let is_whole = rows.len() == pair.size().0;
        let texture = self.texture.map(|texture| texture.of_rows(rows));

        let DraftMap { disparity, mut flags, votes } = self.map;
        let draft = Draft {
            disparity,
            flags: &mut flags,
            votes: votes.as_ref().filter(|_| settings.needs_confidence()),
            texture: texture.as_ref(),
            blurred_pair: blurred_pair.as_ref(),
        };

        let (disparity, confidence) = draft.refine(settings, level, control)?;
        let wrong = match (&confidence, &votes, &texture) {
            // The rows of a part do not represent the whole.
            (None, Some(votes), Some(texture)) if is_whole => {
                let map = SampledMap { disparity: &disparity, flags: &flags, votes, texture };
                let faults = Faults::of_pair(pair);
                map.wrong(pair.candidates(), faults, settings.optimizer, level, control)?
            }
            _ => None,
        };
        let timings = Timings { refinement: started.elapsed(), ..self.timings };
        let (uncertainty, detail) = (None, None);
        Ok(Disparity { disparity, flags, confidence, uncertainty, wrong, detail, timings })
    }
}

impl Disparity {
    /// The sums over the sampled rows of a whole raw map; `None`: without confidences.
    fn tally(&self, candidates: Candidates) -> Option<Tally> {
        let confidence = self.confidence.as_ref()?;
        Some(Tally::of_sample(confidence, &self.disparity, &self.flags, candidates))
    }

    /// Calibrates raw confidences, if any, by the sums over the whole map.
    fn calibrated(
        mut self,
        tally: Option<Tally>,
        faults: Faults,
        optimizer: Optimizer,
        level: Level,
    ) -> Result<Self> {
        if let (Some(tally), Some(confidence)) = (tally, &mut self.confidence) {
            let calibration = ConfidenceCalibration::new(&traits(tally, faults), Weights::of(optimizer));
            let bars = calibration.apply(confidence, &self.disparity, &self.flags, level)?;
            self.uncertainty = Some(bars);
        }

        Ok(self)
    }

    /// The result that the settings ask for: without the estimates they reject, and without confidences that
    /// were only needed for that.
    pub fn returned(mut self, settings: &Settings) -> Self {
        let confidence = self.confidence.as_ref().map(Plane::as_slice);
        let uncertainty = self.uncertainty.as_mut().map(Plane::as_mut_slice);
        let (disparity, flags) = (self.disparity.as_mut_slice(), self.flags.as_mut_slice());
        invalidate(settings, disparity, flags, confidence, uncertainty);

        Self {
            confidence: self.confidence.filter(|_| settings.confidence),
            uncertainty: self.uncertainty.filter(|_| settings.confidence),
            ..self
        }
    }

    /// Some rows of the map.
    fn of_rows(self, rows: Range<usize>) -> Self {
        Self {
            disparity: self.disparity.of_rows(rows.clone()),
            flags: self.flags.of_rows(rows.clone()),
            confidence: self.confidence.map(|confidence| confidence.of_rows(rows.clone())),
            uncertainty: self.uncertainty.map(|uncertainty| uncertainty.of_rows(rows)),
            wrong: self.wrong,
            detail: self.detail,
            timings: self.timings,
        }
    }
}
