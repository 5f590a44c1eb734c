//! The order of the stages; bands of rows on threads. No arithmetic of its own.

use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::aggregation::{Aggregator, Window};
use crate::candidates::Candidates;
use crate::control::Control;
use crate::cost::Costs;
use crate::error::{Error, Result};
use crate::plane::Plane;
use crate::refinement::{Evidence, ResultRow};
use crate::scanline::{Scanline, Steps};
use crate::settings::Settings;
use crate::view::View;

/// Most threads that one match may ask for.
pub const MOST_THREADS: usize = 1024;
/// Bands for each thread: one that falls behind then delays the others by a quarter of its work at most.
const BANDS_PER_THREAD: usize = 4;
/// A band warms up over two windows' heights of rows: that must be a small share of its own.
const LEAST_BAND_WINDOWS: usize = 8;
/// Higher bands would save nothing more, and answer for less even work.
const MOST_BAND_ROWS: usize = 256;

/// What is matched, and how far to search.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    left: View,
    right: View,
    candidates: Candidates,
}

/// How the work is cut up; the result does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Execution {
    /// Number of threads.
    pub threads: usize,
    /// Rows that one task matches; `None`: as suits the window and the threads.
    pub band_rows: Option<usize>,
}

/// A disparity map and what is known about it, as seen from the left image.
#[derive(Debug, Clone, PartialEq)]
pub struct Disparity {
    /// Disparity, pixels; NaN where there is none.
    pub disparity: Plane<f32>,
    /// Bits of [`crate::refinement::flag`].
    pub flags: Plane<u16>,
    /// From 0 to 1.
    pub confidence: Plane<f32>,
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
        Ok(Self { left, right, candidates })
    }

    /// Left and right view.
    pub fn views(&self) -> [&View; 2] {
        [&self.left, &self.right]
    }

    /// The disparities to search.
    pub fn candidates(&self) -> Candidates {
        self.candidates
    }

    /// Rows and columns of either image.
    pub fn size(&self) -> (usize, usize) {
        let (rows, cols, _) = self.left.image.shape();
        (rows, cols)
    }
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
    settings.check()?;
    on_threads(how.threads, || match_pair(pair, settings, how, control))?
}

/// Runs `work` on so many threads, started for it and ended after it.
pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T> {
    if !(1..=MOST_THREADS).contains(&threads) {
        return Err(Error::value(
            "threads",
            threads,
            format!("an integer from 1 to {MOST_THREADS}"),
        ));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    Ok(pool.map_err(|error| Error::Threads(error.to_string()))?.install(work))
}

fn match_pair(
    pair: &Pair,
    settings: &Settings,
    how: Execution,
    control: &Control,
) -> Result<Disparity> {
    let started = Instant::now();
    let costs = Costs::new(pair.views(), pair.candidates, settings, control)?;
    let described = Instant::now();
    let mut map = Disparity::new(pair.size())?;
    let band_rows = how.rows_per_band(pair, settings);
    map.bands(band_rows).try_for_each(|band| match_band(band, pair, &costs, settings, control))?;
    map.timings = Timings { description: described - started, matching: described.elapsed() };
    Ok(map)
}

/// Matches the rows of one band: cost -> aggregation -> scanline -> refinement.
fn match_band(
    mut band: Band,
    pair: &Pair,
    costs: &Costs,
    settings: &Settings,
    control: &Control,
) -> Result<()> {
    let window = Window::new(pair.size(), pair.candidates.count(), settings, costs.ceiling());
    let mut aggregator = Aggregator::new(window, band.first, costs, control)?;
    let steps = Steps::new(settings.penalty, window, costs.steps());
    let mut scanline = Scanline::new(window.cols, window.candidates, settings.optimizer, steps)?;
    let mut aggregated = window.row()?;
    for y in band.rows() {
        control.checkpoint()?;
        aggregator.write_row(y, &mut aggregated)?;
        let chosen = scanline.choose(&aggregated);
        let evidence = Evidence { y, chosen, aggregated: &aggregated, votes: costs.votes() };
        band.result_row(y).write(evidence, pair.candidates, settings);
        control.row_done();
    }
    Ok(())
}

/// The part of the result that one task writes.
struct Band<'a> {
    first: usize,
    cols: usize,
    disparity: &'a mut [f32],
    flags: &'a mut [u16],
    confidence: &'a mut [f32],
}

impl Band<'_> {
    fn rows(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.disparity.len() / self.cols
    }

    fn result_row(&mut self, y: usize) -> ResultRow<'_> {
        let places = (y - self.first) * self.cols..(y - self.first + 1) * self.cols;
        ResultRow {
            disparity: &mut self.disparity[places.clone()],
            flags: &mut self.flags[places.clone()],
            confidence: &mut self.confidence[places],
        }
    }
}

impl Disparity {
    fn new((rows, cols): (usize, usize)) -> Result<Self> {
        Ok(Self {
            disparity: Plane::new(rows, cols)?,
            flags: Plane::new(rows, cols)?,
            confidence: Plane::new(rows, cols)?,
            timings: Timings::default(),
        })
    }

    fn bands(&mut self, band_rows: usize) -> impl ParallelIterator<Item = Band<'_>> {
        let cols = self.disparity.cols();
        let places = band_rows.saturating_mul(cols);
        let disparity = self.disparity.as_mut_slice().par_chunks_mut(places);
        let flags = self.flags.as_mut_slice().par_chunks_mut(places);
        let confidence = self.confidence.as_mut_slice().par_chunks_mut(places);
        let parts = disparity.zip(flags).zip(confidence).enumerate();
        parts.map(move |(index, ((disparity, flags), confidence))| Band {
            first: index * band_rows,
            cols,
            disparity,
            flags,
            confidence,
        })
    }
}

impl Execution {
    /// Several bands for each thread, but none so low that warming up dominates.
    fn rows_per_band(self, pair: &Pair, settings: &Settings) -> usize {
        let even = pair.size().0.div_ceil(BANDS_PER_THREAD * self.threads);
        let least = LEAST_BAND_WINDOWS * settings.window;
        self.band_rows.unwrap_or_else(|| even.min(MOST_BAND_ROWS).max(least)).max(1)
    }
}
