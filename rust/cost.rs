//! Two images -> matching costs: what it costs to match a pixel with a candidate, one candidate of a strip
//! at a time.

use std::array::from_fn;
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
use crate::versions::{Labels, MOST_CLASSES, Versions};
use crate::view::View;
use crate::votes::Votes;

/// Codes of the left image, each of the version that its pixel is compared in, and of every version of the
/// right one; with several of these, which of them it is.
struct PairCodes {
    left: Codes,
    rights: Vec<Codes>,
    labels: Option<Labels>,
}

/// Lanes come in multiples of this.
const HALF: usize = BLOCK / 2;

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
    /// Of each column, as bits, with which versions its pixels are compared; empty: there is one.
    met: Vec<u16>,
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
        self.met.clear();
        if let Some(labels) = &codes.labels {
            strip.transpose(left, |y| labels.row(y), |label| label, &mut self.labels)?;
            let met = |column: &[u8]| column.iter().fold(0, |met, label| met | 1 << label);
            self.met.extend(self.labels.chunks_exact(strip.lanes()).map(met));
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
        let met = self.met.get(columns.clone()).unwrap_or(&[1]);
        let met = met.iter().fold(0, |all, met| all | met);
        match met.count_ones() {
            0 | 1 => self.write_plain(met.trailing_zeros() as usize, columns, k, costs),
            2 => self.write_mixed::<V, 2>(met, columns, k, costs),
            3 | 4 => self.write_mixed::<V, 4>(met, columns, k, costs),
            _ => self.write_mixed::<V, MOST_CLASSES>(met, columns, k, costs),
        }
    }

    /// Where all pixels are compared with one version of the right image.
    #[inline(always)]
    fn write_plain<V: Value>(
        &self,
        version: usize,
        columns: &Range<usize>,
        k: usize,
        costs: &mut [V],
    ) {
        for (index, Byte { left, rights }) in self.bytes.iter().enumerate() {
            let [left, right] = self.places([left, &rights[version]], columns, k);
            if index == 0 {
                write_distance(left, right, costs);
            } else {
                add_distance(left, right, costs);
            }
        }
    }

    /// Where pixels are compared with several versions of the right image, `K` at most, whose bits are `met`.
    #[inline(always)]
    fn write_mixed<V: Value, const K: usize>(
        &self,
        met: u16,
        columns: &Range<usize>,
        k: usize,
        costs: &mut [V],
    ) {
        let versions = members::<K>(met);
        let labels = &self.labels[columns.start * self.lanes..][..costs.len()];
        for (index, Byte { left, rights }) in self.bytes.iter().enumerate() {
            let places = versions.map(|v| self.places([left, &rights[usize::from(v)]], columns, k));
            let mixed =
                Mixed { left: places[0][0], labels, versions, rights: places.map(|p| p[1]) };
            if index == 0 {
                mixed.for_each(costs, |cost, distance| *cost = distance);
            } else {
                mixed.for_each(costs, |cost, distance| *cost = cost.plus(distance));
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

/// The places of the bits in `met`, the last one again and again to the end.
#[inline(always)]
fn members<const K: usize>(mut met: u16) -> [u8; K] {
    from_fn(|_| {
        let first = met.trailing_zeros() as u8;
        met = if met.is_power_of_two() { met } else { met & (met - 1) };
        first
    })
}

/// One byte of codes on the left, and of the `K` versions on the right of which the labels choose one.
struct Mixed<'a, const K: usize> {
    left: &'a [u8],
    labels: &'a [u8],
    versions: [u8; K],
    rights: [&'a [u8]; K],
}

impl<const K: usize> Mixed<'_, K> {
    /// Calls `put` with each cost and its distance, a block of lanes at a time; lanes fill half blocks.
    #[inline(always)]
    fn for_each<V: Value>(&self, costs: &mut [V], put: impl Fn(&mut V, V)) {
        let (blocks, rest) = costs.as_chunks_mut::<BLOCK>();
        let done = blocks.len() * BLOCK;
        for (index, costs) in blocks.iter_mut().enumerate() {
            let distances = self.distances::<BLOCK>(index * BLOCK);
            costs.iter_mut().zip(distances).for_each(|(c, d)| put(c, V::truncated(d.into())));
        }
        for (index, costs) in rest.as_chunks_mut::<HALF>().0.iter_mut().enumerate() {
            let distances = self.distances::<HALF>(done + index * HALF);
            costs.iter_mut().zip(distances).for_each(|(c, d)| put(c, V::truncated(d.into())));
        }
    }

    /// All is copied into arrays first: only so is nothing known to overlap.
    #[inline(always)]
    fn distances<const N: usize>(&self, first: usize) -> [u8; N] {
        let block = |values: &[u8]| -> [u8; N] {
            let values = &values[first..][..N];
            from_fn(|i| values[i])
        };
        let (left, labels) = (block(self.left), block(self.labels));
        let mut mixed = [0; N];
        for (right, version) in self.rights.iter().zip(self.versions) {
            let right = block(right);
            mixed = from_fn(|i| mixed[i] | if labels[i] == version { right[i] } else { 0 });
        }
        from_fn(|i| (left[i] ^ mixed[i]).count_ones() as u8)
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
