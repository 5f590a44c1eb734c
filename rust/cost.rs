//! Two images -> matching costs: what it costs to match a pixel with a candidate, one candidate of a strip
//! at a time.

use std::ops::Range;

use crate::candidates::Candidates;
use crate::control::Control;
use crate::convolution::Kernel;
use crate::descriptor::{Codes, describe};
use crate::error::{Error, Result};
use crate::intensity::{Gray, LEVEL_CEILING, LEVEL_STEPS, level_planes};
use crate::memory::Memory;
use crate::normalisation::{DEVIATION_CEILING, DEVIATION_STEPS, normalise};
use crate::plane::Plane;
use crate::settings::{CostKind, Settings};
use crate::simd::{self, Level};
use crate::strip::{BLOCK, Strip};
use crate::value::Value;
use crate::versions::{Labels, Versions};
use crate::view::View;
use crate::votes::Votes;

/// Codes of the left image, each of the version that its pixel is compared in, and of every version of the
/// right one; with several of these, which of them it is.
struct PairCodes {
    left: Codes,
    rights: Vec<Codes>,
    labels: Option<Labels>,
}

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
    Codes(PairCodes),
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
        if settings.cost != CostKind::Phase && versions.is_some_and(Versions::has_kernels) {
            return Err(Error::value("equalisation", "kernels for another cost", "cost='phase'"));
        }
        let (compared, ceiling, steps) = match settings.cost {
            CostKind::Phase => {
                let codes = PairCodes::new(views, settings, versions, level, control)?;
                (Compared::Codes(codes), settings.code_length() as u16, 1)
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
            operands.mix(&(0..self.cols), level)?;
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

impl PairCodes {
    fn new(
        views: [&View; 2],
        settings: &Settings,
        versions: Option<&Versions>,
        level: Level,
        control: &Control,
    ) -> Result<Self> {
        let (rows, cols, _) = views[0].image.shape();
        let grays = [Gray::new(views[0], level, control)?, Gray::new(views[1], level, control)?];
        let codes = |side: usize, kernel: Option<&Kernel>| {
            let noise = versions.map(|versions| versions.noise()[side]);
            match kernel {
                None => describe(&grays[side], settings, noise, level, control),
                Some(kernel) => {
                    let blurred = grays[side].convolved(kernel, level, control)?;
                    describe(&blurred, settings, noise, level, control)
                }
            }
        };
        let Some(versions) = versions else {
            return Ok(Self { left: codes(0, None)?, rights: vec![codes(1, None)?], labels: None });
        };
        let (kernels, labels) = versions.of_side(0, (rows, cols))?;
        let mut left = codes(0, kernels[0])?;
        for (label, kernel) in (1..).zip(&kernels[1..]) {
            left.take_where(&codes(0, *kernel)?, |y| labels.row(y), label);
        }
        let (kernels, labels) = versions.of_side(1, (rows, cols))?;
        let rights: Vec<_> = kernels.iter().map(|k| codes(1, *k)).collect::<Result<_>>()?;
        let labels = (rights.len() > 1).then_some(labels);
        Ok(Self { left, rights, labels })
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

/// One byte of the codes: of the left image, and of each version of the right one.
#[derive(Debug, Default)]
struct Byte {
    left: Memory<u8>,
    rights: Vec<Memory<u8>>,
    /// What the segments are compared with, of one after another.
    mixed: Memory<u8>,
}

/// Columns whose labels are alike.
#[derive(Debug)]
struct Segment {
    columns: Range<usize>,
    /// The versions that they are compared with, as bits.
    met: u16,
    /// Where the mixture of these begins, if there are several: columns.
    mixed: usize,
}

/// What is compared, of one strip: memory that is used for one strip after another.
#[derive(Debug, Default)]
pub struct Operands {
    lanes: usize,
    candidates: usize,
    /// Bytes of the codes: those that hold bits.
    bytes: Vec<Byte>,
    /// With which version of the right image each pixel is compared, if there are several.
    labels: Memory<u8>,
    has_labels: bool,
    /// The columns whose costs can be written, if there are labels.
    segments: Vec<Segment>,
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
        codes: &PairCodes,
        [left, right]: &[Vec<usize>; 2],
        strip: &Strip,
    ) -> Result<()> {
        for (byte, planes) in self.bytes.iter_mut().enumerate() {
            load_byte(&codes.left, byte, left, strip, &mut planes.left)?;
            planes.rights.resize_with(codes.rights.len(), Default::default);
            for (codes, out) in codes.rights.iter().zip(&mut planes.rights) {
                load_byte(codes, byte, right, strip, out)?;
            }
        }
        self.segments.clear();
        self.has_labels = codes.labels.is_some();
        match &codes.labels {
            Some(labels) => {
                strip.transpose(left, |y| labels.row(y), |label| label, &mut self.labels)
            }
            None => Ok(()),
        }
    }

    /// Brings together what these columns are compared with, in each lane one version of the right image or
    /// another: to be done before their costs are written. For many candidates it takes no time.
    pub fn mix(&mut self, columns: &Range<usize>, level: Level) -> Result<()> {
        self.segments.clear();
        if !self.has_labels {
            return Ok(());
        }
        let (lanes, labels) = (self.lanes, self.labels.chunks_exact(self.lanes));
        let labels: Vec<_> = labels.skip(columns.start).take(columns.len()).collect();
        let (mut start, mut mixed) = (columns.start, 0);
        for alike in labels.chunk_by(|a, b| a == b) {
            let met = alike[0].iter().fold(0u16, |met, label| met | 1 << label);
            let columns = start..start + alike.len();
            start = columns.end;
            self.segments.push(Segment { columns, met, mixed });
            // With all candidates, one behind the other, they meet so many columns.
            mixed += if met.is_power_of_two() { 0 } else { alike.len() + self.candidates - 1 };
        }
        for Byte { rights, mixed: out, .. } in &mut self.bytes {
            out.room(mixed * lanes)?;
            for Segment { columns, met, mixed } in &self.segments {
                if !met.is_power_of_two() {
                    let count = (columns.len() + self.candidates - 1) * lanes;
                    let first = columns.start * lanes;
                    level.run(Mix {
                        rights,
                        labels: &self.labels[first..][..lanes],
                        met: *met,
                        places: first..first + count,
                        mixed: &mut out[mixed * lanes..][..count],
                    });
                }
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
            ([_, ..], _) => self.write_distances(&columns, k, costs),
            (_, [first, rest @ ..]) => {
                let [left, right] = self.places(first.each_ref(), &columns, k);
                write_difference(left, right, costs);
                for plane in rest {
                    let [left, right] = self.places(plane.each_ref(), &columns, k);
                    add_difference(left, right, costs);
                }
            }
            _ => self.write_known(columns.clone(), k, costs),
        }
        if let Some(valid) = &self.valid {
            let [left, right] = self.places(valid.each_ref(), &columns, k);
            silence(left, right, costs);
        }
    }

    /// Writes in how many bits codes differ.
    #[inline(always)]
    fn write_distances<V: Value>(&self, columns: &Range<usize>, k: usize, costs: &mut [V]) {
        // The first candidate of a column comes last: a larger disparity lies further left.
        let across = self.candidates - 1 - k;
        debug_assert_eq!(self.segments.is_empty(), !self.has_labels);
        if self.segments.is_empty() {
            return self.write_between(
                columns,
                columns.start + across,
                |byte| &byte.rights[0],
                costs,
            );
        }
        let mut rest = costs;
        for Segment { columns, met, mixed } in &self.segments {
            let (costs, others) = rest.split_at_mut(columns.len() * self.lanes);
            if met.is_power_of_two() {
                let version = met.trailing_zeros() as usize;
                let first = columns.start + across;
                self.write_between(columns, first, |byte| &byte.rights[version], costs);
            } else {
                self.write_between(columns, mixed + across, |byte| &byte.mixed, costs);
            }
            rest = others;
        }
    }

    /// The same of columns of the left image and as many from one of the right image on.
    #[inline(always)]
    fn write_between<V: Value>(
        &self,
        columns: &Range<usize>,
        first: usize,
        right: impl Fn(&Byte) -> &Memory<u8>,
        costs: &mut [V],
    ) {
        let count = columns.len() * self.lanes;
        for (index, byte) in self.bytes.iter().enumerate() {
            let left = &byte.left[columns.start * self.lanes..][..count];
            let right = &right(byte)[first * self.lanes..][..count];
            if index == 0 {
                write_distance(left, right, costs);
            } else {
                add_distance(left, right, costs);
            }
        }
    }

    /// Writes 1 where these columns vote for candidate `k`, else 0; only where there are votes.
    #[inline(always)]
    pub fn write_votes<V: Value>(&self, columns: Range<usize>, k: usize, votes: &mut [V]) {
        let Some(valid) = &self.valid else { return };
        let [left, right] = self.places(valid.each_ref(), &columns, k);
        for ((vote, left), right) in votes.iter_mut().zip(left).zip(right) {
            *vote = V::truncated(u64::from(left & right));
        }
    }

    /// What the columns hold on the left, and on the right under candidate `k`.
    #[inline(always)]
    fn places<'a, T>(
        &self,
        [left, right]: [&'a Memory<T>; 2],
        columns: &Range<usize>,
        k: usize,
    ) -> [&'a [T]; 2] {
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

fn load_byte(
    codes: &Codes,
    byte: usize,
    columns: &[usize],
    strip: &Strip,
    out: &mut Memory<u8>,
) -> Result<()> {
    let shift = 8 * byte;
    match codes {
        Codes::U16(plane) => {
            strip.transpose(columns, |y| plane.row(y), |code| (code >> shift) as u8, out)
        }
        Codes::U32(plane) => {
            strip.transpose(columns, |y| plane.row(y), |code| (code >> shift) as u8, out)
        }
        Codes::U64(plane) => {
            strip.transpose(columns, |y| plane.row(y), |code| (code >> shift) as u8, out)
        }
    }
}

/// Several versions of one byte of codes -> that which the labels choose in each lane, the same in every
/// column.
struct Mix<'a> {
    rights: &'a [Memory<u8>],
    labels: &'a [u8],
    met: u16,
    /// The values of the columns that are wanted.
    places: Range<usize>,
    mixed: &'a mut [u8],
}

impl simd::Kernel for Mix<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { rights, labels, met, places, mixed } = self;
        for (version, right) in (0..).zip(rights).filter(|(version, _)| met >> version & 1 == 1) {
            let right = right[places.clone()].chunks_exact(labels.len());
            for (mixed, right) in mixed.chunks_exact_mut(labels.len()).zip(right) {
                take_labelled(labels, version, right, mixed);
            }
        }
    }
}

#[inline(always)]
fn take_labelled(labels: &[u8], label: u8, right: &[u8], mixed: &mut [u8]) {
    for ((mixed, right), known) in mixed.iter_mut().zip(right).zip(labels) {
        *mixed = if *known == label { *right } else { *mixed };
    }
}

/// The costs of one candidate.
struct Write<'a> {
    operands: &'a Operands,
    columns: Range<usize>,
    k: usize,
    costs: &'a mut [u16],
}

impl simd::Kernel for Write<'_> {
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
