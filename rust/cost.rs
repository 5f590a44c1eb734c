//! Two images -> matching costs: what it costs to match a pixel with a candidate, one candidate of a strip
//! at a time.

use std::ops::Range;

use crate::candidates::Candidates;
use crate::control::Control;
use crate::descriptor::{Codes, describe};
use crate::error::Result;
use crate::intensity::{Gray, LEVEL_CEILING, LEVEL_STEPS, level_planes};
use crate::memory::Memory;
use crate::normalisation::{DEVIATION_CEILING, DEVIATION_STEPS, normalise};
use crate::plane::Plane;
use crate::settings::{CostKind, Settings};
use crate::simd::{Kernel, Level};
use crate::strip::{BLOCK, Strip};
use crate::value::Value;
use crate::versions::Versions;
use crate::view::View;
use crate::votes::Votes;

/// What the pixels of a pair are compared by, and what that amounts to.
pub struct Costs<'a> {
    compared: Compared<'a>,
    candidates: Candidates,
    cols: usize,
    ceiling: u16,
    steps: u16,
    votes: Option<Votes<'a>>,
}

enum Compared<'a> {
    /// Hamming distance of phase codes (paper, eq. 7; by Johnson codes also eq. 6 for any `b`).
    Codes([Codes; 2]),
    /// Sum over the channels of absolute differences: the baseline of the paper's section 3.
    Levels(Vec<[Plane<u16>; 2]>),
    /// Costs that are known already, candidate innermost.
    Volume(&'a Plane<u16>),
}

impl<'a> Costs<'a> {
    /// The costs that the settings name, for checked views and settings.
    pub fn new(
        views: [&'a View; 2],
        candidates: Candidates,
        settings: &Settings,
        versions: Option<&Versions>,
        level: Level,
        control: &Control,
    ) -> Result<Self> {
        let (compared, ceiling, steps) = match settings.cost {
            CostKind::Phase => {
                let codes = |side: usize| {
                    let gray = Gray::new(views[side], level, control)?;
                    let noise = versions.map(|versions| versions.noise()[side]);
                    describe(&gray, settings, noise, level, control)
                };
                (Compared::Codes([codes(0)?, codes(1)?]), settings.code_length() as u16, 1)
            }
            CostKind::Sad => {
                let channels = level_planes(views, settings.intensity_range, control)?;
                absolute_differences(channels, LEVEL_CEILING, LEVEL_STEPS)
            }
            CostKind::NormalisedSad => {
                let [left, right] = level_planes(views, settings.intensity_range, control)?;
                let normalised = |side: Vec<Plane<u16>>| -> Result<Vec<_>> {
                    side.iter().map(|plane| normalise(plane, settings.window, control)).collect()
                };
                let channels = [normalised(left)?, normalised(right)?];
                absolute_differences(channels, DEVIATION_CEILING, DEVIATION_STEPS)
            }
        };
        let cols = views[0].image.shape().1;
        let votes = Votes::new(views, candidates);
        Ok(Self { compared, candidates, cols, ceiling, steps, votes })
    }

    /// Costs that are known already: rows of `columns x candidates`.
    pub fn of_volume(volume: &'a Plane<u16>, candidates: Candidates) -> Self {
        let cols = volume.cols() / candidates.count();
        let (compared, ceiling) = (Compared::Volume(volume), u16::MAX);
        Self { compared, candidates, cols, ceiling, steps: 1, votes: None }
    }

    /// All costs at once, for those who want to look at them: rows of `columns x candidates`.
    pub fn volume(&self, rows: usize, level: Level, control: &Control) -> Result<Plane<u16>> {
        let count = self.candidates.count();
        let mut volume = Plane::new(rows, self.cols * count)?;
        let (mut operands, mut costs) = (Operands::default(), Memory::default());
        for first in (0..rows).step_by(BLOCK) {
            let rows = BLOCK.min(rows - first);
            let strip = Strip { first, rows, margin: 0, height: volume.rows() };
            operands.load(self, &strip)?;
            costs.room(self.cols * strip.lanes())?;
            for k in 0..count {
                control.checkpoint()?;
                level.run(Write {
                    operands: &operands,
                    columns: 0..self.cols,
                    k,
                    costs: &mut costs,
                });
                for (x, costs) in costs.chunks_exact(strip.lanes()).enumerate().take(self.cols) {
                    for (y, cost) in strip.range().zip(costs) {
                        volume.row_mut(y)[x * count + k] = *cost;
                    }
                }
            }
        }
        Ok(volume)
    }

    /// Who may vote; `None`: everybody.
    pub fn votes(&self) -> Option<&Votes<'a>> {
        self.votes.as_ref()
    }

    /// The disparities that are searched.
    pub fn candidates(&self) -> Candidates {
        self.candidates
    }

    /// The largest cost there can be.
    pub fn ceiling(&self) -> u16 {
        self.ceiling
    }

    /// Steps of the cost per unit of the penalties.
    pub fn steps(&self) -> u16 {
        self.steps
    }
}

fn absolute_differences<'a>(
    [left, right]: [Vec<Plane<u16>>; 2],
    ceiling: u16,
    steps: u16,
) -> (Compared<'a>, u16, u16) {
    let channels: Vec<_> = left.into_iter().zip(right).map(|(l, r)| [l, r]).collect();
    let ceiling = ceiling * channels.len() as u16;
    (Compared::Levels(channels), ceiling, steps)
}

/// What is compared, of one strip: memory that is used for one strip after another.
#[derive(Debug, Default)]
pub struct Operands {
    lanes: usize,
    candidates: usize,
    /// Bytes of the codes: a plane for each byte that holds bits, left and right.
    bytes: Vec<[Memory<u8>; 2]>,
    /// Levels of each channel, left and right.
    words: Vec<[Memory<u16>; 2]>,
    /// Known costs, of one candidate after another.
    known: Memory<u16>,
    /// Where pixels are valid (1, else 0), left and right.
    valid: Option<[Memory<u8>; 2]>,
}

impl Operands {
    /// Brings what is compared into the lanes of `strip`.
    pub fn load(&mut self, costs: &Costs, strip: &Strip) -> Result<()> {
        let (candidates, cols) = (costs.candidates, costs.cols);
        (self.lanes, self.candidates) = (strip.lanes(), candidates.count());
        // Planes of another kind of match would be compared before those of this one.
        let (codes, levels) = match &costs.compared {
            Compared::Codes(_) => (usize::from(costs.ceiling).div_ceil(8), 0),
            Compared::Levels(channels) => (0, channels.len()),
            Compared::Volume(_) => (0, 0),
        };
        self.bytes.resize_with(codes, Default::default);
        self.words.resize_with(levels, Default::default);
        let columns: [Vec<usize>; 2] = [(0..cols).collect(), candidates.unrolled(cols)];
        match &costs.compared {
            Compared::Codes(codes) => self.load_codes(codes, &columns, strip)?,
            Compared::Levels(channels) => {
                for (planes, words) in channels.iter().zip(&mut self.words) {
                    for ((plane, words), columns) in planes.iter().zip(words).zip(&columns) {
                        strip.transpose(columns, |y| plane.row(y), |level| level, words)?;
                    }
                }
            }
            Compared::Volume(volume) => {
                let count = candidates.count();
                let places: Vec<usize> =
                    (0..count * cols).map(|i| i % cols * count + i / cols).collect();
                strip.transpose(&places, |y| volume.row(y), |cost| cost, &mut self.known)?;
            }
        }
        self.load_votes(costs.votes.as_ref(), &columns, strip)
    }

    fn load_codes(
        &mut self,
        codes: &[Codes; 2],
        columns: &[Vec<usize>; 2],
        strip: &Strip,
    ) -> Result<()> {
        for (byte, planes) in self.bytes.iter_mut().enumerate() {
            let shift = 8 * byte;
            for ((codes, out), columns) in codes.iter().zip(planes).zip(columns) {
                match codes {
                    Codes::U16(plane) => strip.transpose(
                        columns,
                        |y| plane.row(y),
                        |code| (code >> shift) as u8,
                        out,
                    ),
                    Codes::U32(plane) => strip.transpose(
                        columns,
                        |y| plane.row(y),
                        |code| (code >> shift) as u8,
                        out,
                    ),
                    Codes::U64(plane) => strip.transpose(
                        columns,
                        |y| plane.row(y),
                        |code| (code >> shift) as u8,
                        out,
                    ),
                }?;
            }
        }
        Ok(())
    }

    fn load_votes(
        &mut self,
        votes: Option<&Votes>,
        columns: &[Vec<usize>; 2],
        strip: &Strip,
    ) -> Result<()> {
        let Some(votes) = votes else {
            self.valid = None;
            return Ok(());
        };
        let valid = self.valid.get_or_insert_default();
        let everywhere = vec![true; votes.width()];
        for ((out, columns), mask) in valid.iter_mut().zip(columns).zip(votes.masks()) {
            let row = |y| mask.map_or(&everywhere[..], |mask| mask.row(y));
            strip.transpose(columns, row, u8::from, out)?;
        }
        Ok(())
    }

    /// Whether not everybody votes.
    pub fn has_votes(&self) -> bool {
        self.valid.is_some()
    }

    /// Writes what these columns cost under candidate `k`; 0 where there is no vote.
    #[inline(always)]
    pub fn write_costs<V: Value>(&self, columns: Range<usize>, k: usize, costs: &mut [V]) {
        match (&self.bytes[..], &self.words[..]) {
            ([first, rest @ ..], _) => {
                let [left, right] = self.places(first, &columns, k);
                write_distance(left, right, costs);
                for plane in rest {
                    let [left, right] = self.places(plane, &columns, k);
                    add_distance(left, right, costs);
                }
            }
            (_, [first, rest @ ..]) => {
                let [left, right] = self.places(first, &columns, k);
                write_difference(left, right, costs);
                for plane in rest {
                    let [left, right] = self.places(plane, &columns, k);
                    add_difference(left, right, costs);
                }
            }
            _ => self.write_known(columns.clone(), k, costs),
        }
        if let Some(valid) = &self.valid {
            let [left, right] = self.places(valid, &columns, k);
            silence(left, right, costs);
        }
    }

    /// Writes 1 where these columns vote for candidate `k`, else 0; only where there are votes.
    #[inline(always)]
    pub fn write_votes<V: Value>(&self, columns: Range<usize>, k: usize, votes: &mut [V]) {
        let Some(valid) = &self.valid else { return };
        let [left, right] = self.places(valid, &columns, k);
        for ((vote, left), right) in votes.iter_mut().zip(left).zip(right) {
            *vote = V::truncated(u64::from(left & right));
        }
    }

    /// What the columns hold on the left, and on the right under candidate `k`.
    #[inline(always)]
    fn places<'a, T>(
        &self,
        sides: &'a [Memory<T>; 2],
        columns: &Range<usize>,
        k: usize,
    ) -> [&'a [T]; 2] {
        let [left, right] = sides;
        let count = columns.len() * self.lanes;
        // The first candidate of column 0 comes last: a larger disparity lies further left.
        let across = columns.start + self.candidates - 1 - k;
        [&left[columns.start * self.lanes..][..count], &right[across * self.lanes..][..count]]
    }

    #[inline(always)]
    fn write_known<V: Value>(&self, columns: Range<usize>, k: usize, costs: &mut [V]) {
        let cols = self.known.len() / (self.lanes * self.candidates);
        let known = &self.known[(k * cols + columns.start) * self.lanes..];
        for (cost, &known) in costs.iter_mut().zip(known) {
            *cost = V::truncated(known.into());
        }
    }
}

/// The costs of one candidate.
struct Write<'a> {
    operands: &'a Operands,
    columns: Range<usize>,
    k: usize,
    costs: &'a mut [u16],
}

impl Kernel for Write<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let count = self.columns.len() * self.operands.lanes;
        self.operands.write_costs(self.columns, self.k, &mut self.costs[..count]);
    }
}

#[inline(always)]
fn write_distance<V: Value>(left: &[u8], right: &[u8], costs: &mut [V]) {
    for ((cost, left), right) in costs.iter_mut().zip(left).zip(right) {
        *cost = V::truncated((left ^ right).count_ones().into());
    }
}

#[inline(always)]
fn add_distance<V: Value>(left: &[u8], right: &[u8], costs: &mut [V]) {
    for ((cost, left), right) in costs.iter_mut().zip(left).zip(right) {
        *cost = cost.plus(V::truncated((left ^ right).count_ones().into()));
    }
}

#[inline(always)]
fn write_difference<V: Value>(left: &[u16], right: &[u16], costs: &mut [V]) {
    for ((cost, left), right) in costs.iter_mut().zip(left).zip(right) {
        *cost = V::truncated(left.abs_diff(*right).into());
    }
}

#[inline(always)]
fn add_difference<V: Value>(left: &[u16], right: &[u16], costs: &mut [V]) {
    for ((cost, left), right) in costs.iter_mut().zip(left).zip(right) {
        *cost = cost.plus(V::truncated(left.abs_diff(*right).into()));
    }
}

#[inline(always)]
fn silence<V: Value>(left: &[u8], right: &[u8], costs: &mut [V]) {
    for ((cost, left), right) in costs.iter_mut().zip(left).zip(right) {
        *cost = if left & right == 1 { *cost } else { V::default() };
    }
}
