//! Two images -> matching costs: what it costs to match a pixel of the left image with each of its candidates.
//!
//! Candidates are neighboring lanes. The right image is kept *unrolled*: every row reversed, and clamped at both ends. The
//! pixels that left column `x` is compared with under the candidates 0, 1, 2, ... are then neighboring values from place
//! `cols - 1 - x` on. One unaligned load has the pixels of many candidates, for any column:
//!
//! ```text
//! for x in columns:
//!     for k in 0..candidates:                      # neighboring lanes
//!         cost[x][k] = distance(left[x], unrolled[cols - 1 - x + k])
//! ```
//!
//! Codes are kept as bytes: a row has the lowest byte of all its codes, then the next byte of all. So a load of each byte
//! has whole runs of candidates, and codes of any length take no more bytes than they need.

pub mod aggregation;
pub mod validity;

use std::ops::Range;
use std::slice::ChunksExactMut;

use crate::base::control::Control;
use crate::base::error::{Error, Result};
use crate::base::memory::RunMemory;
use crate::base::plane::Plane;
use crate::base::platform::both;
use crate::base::simd::{self, Level};
use crate::base::value::{LANES, Lanes, Value};
use crate::cost::validity::Validity;
use crate::descriptor::spectrum::Word;
use crate::descriptor::{RowOfCodes, describe_rows};
use crate::image::convolution::Kernel;
use crate::image::intensity::{Gray, LEVEL_CEILING, LEVEL_STEPS, level_planes};
use crate::image::normalization::{DEVIATION_CEILING, DEVIATION_STEPS, normalize};
use crate::image::view::{Mask, View};
use crate::pair::blur_compensation::{self, BlurCompensation, Labels};
use crate::pair::candidates::{Candidates, Searched};
use crate::settings::{CostKind, Settings};

/// Rows that are unrolled together.
const ROWS: usize = 32;

/// The matching costs of a pair, worked out from codes or gray values when they are asked for.
pub struct Costs<'a> {
    compared: Compared<'a>,
    candidates: Candidates,
    cols: usize,
    ceiling: u16,
    steps: u16,
    validity: Option<Validity<'a>>,
    /// 1 where the left and the unrolled right image are valid, else 0. `None`: neither image has a mask.
    valid: Option<[Plane<u8>; 2]>,
}

/// What the pixels of a pair are compared by.
enum Compared<'a> {
    /// Hamming distance of phase codes (paper, eq. 7; by Johnson codes also eq. 6 for any `b`).
    Codes(PairCodes),
    /// Sum over the channels of absolute differences of left and unrolled right: the baseline of the paper's section 3.
    Levels(Vec<[Plane<u16>; 2]>),
    /// Costs of the caller, candidate innermost.
    Volume(&'a Plane<u16>),
}

/// Values of neighboring pixels, to be written: of each pixel `L` lanes from `first` on, where it has `stride` of them.
pub struct Lines<'a, V, const L: usize> {
    /// All lanes of the pixels.
    pub values: &'a mut [V],
    /// The first lane of a line.
    pub first: usize,
    /// Lanes of a pixel.
    pub stride: usize,
}

impl<V, const L: usize> Lines<'_, V, L> {
    /// Pixels.
    #[inline(always)]
    pub fn count(&self) -> usize {
        self.values.len() / self.stride
    }

    /// The line of one pixel.
    #[inline(always)]
    pub fn line(&mut self, pixel: usize) -> &mut [V; L] {
        line(&mut self.values[pixel * self.stride..], self.first)
    }

    /// All lanes of each pixel, and the first of a line: see [`line()`].
    #[inline(always)]
    pub fn pixels(&mut self) -> (ChunksExactMut<'_, V>, usize) {
        (self.values.chunks_exact_mut(self.stride), self.first)
    }

    /// Those of the pixels from index `start` on, so many.
    #[inline(always)]
    pub fn part(&mut self, start: usize, count: usize) -> Lines<'_, V, L> {
        let values = &mut self.values[start * self.stride..][..count * self.stride];
        Lines { values, ..*self }
    }
}

/// The line of a pixel that begins with lane `first`. A function, not a closure in an iterator, which might not be inlined.
#[inline(always)]
pub fn line<V, const L: usize>(pixel: &mut [V], first: usize) -> &mut [V; L] {
    &mut pixel[first..].as_chunks_mut().0[0]
}

/// Steps of the cost per unit of the penalties.
pub fn steps_of(cost: CostKind) -> u16 {
    match cost {
        CostKind::Phase => 1,
        CostKind::Sad => LEVEL_STEPS,
        CostKind::NormalizedSad => DEVIATION_STEPS,
    }
}

/// Phase codes by their bytes.
///
/// Under blur compensation with kernels, the right image has several versions, each described and unrolled by itself;
/// `labels` say which of them each left pixel is compared with. The left codes are already those of that version.
struct PairCodes {
    left: BytePlanes,
    rights: Vec<BytePlanes>,
    labels: Option<Labels>,
}

/// The bytes of codes: each row has the lowest byte of all of its codes, then the next one of all, and so on.
struct BytePlanes {
    plane: Plane<u8>,
    /// Codes of a row.
    width: usize,
    /// Bytes of a code.
    count: usize,
}

impl<'a> Costs<'a> {
    /// The costs that the settings name, for checked views and settings. Only phase costs take kernels.
    pub fn new(
        views: [&'a View; 2],
        candidates: Candidates,
        settings: &Settings,
        compensation: Option<&BlurCompensation>,
        level: Level,
        control: &Control,
    ) -> Result<Self> {
        if settings.cost != CostKind::Phase
            && compensation.is_some_and(BlurCompensation::has_kernels)
        {
            return Err(Error::value(
                "blur_compensation",
                "kernels for another cost",
                "cost='phase'",
            ));
        }

        let (compared, ceiling) = match settings.cost {
            CostKind::Phase => {
                let codes =
                    PairCodes::new(views, candidates, settings, compensation, level, control)?;
                (Compared::Codes(codes), settings.code_length() as u16)
            }
            CostKind::Sad => {
                let channels = level_planes(views, settings.intensity_range, control)?;
                absolute_differences(channels, candidates, LEVEL_CEILING)?
            }
            CostKind::NormalizedSad => {
                let [left, right] = level_planes(views, settings.intensity_range, control)?;
                let normalized = |side: Vec<Plane<u16>>| -> Result<Vec<_>> {
                    side.iter()
                        .map(|plane| normalize(plane, settings.window, level, control))
                        .collect()
                };

                let channels = [normalized(left)?, normalized(right)?];
                absolute_differences(channels, candidates, DEVIATION_CEILING)?
            }
        };

        let (rows, cols, _) = views[0].image.shape();
        let validity = Validity::new(views, candidates)?;
        let valid = validity
            .as_ref()
            .map(|validity| valid(validity, (rows, cols), candidates))
            .transpose()?;
        let steps = steps_of(settings.cost);

        Ok(Self { compared, candidates, cols, ceiling, steps, validity, valid })
    }

    /// The Hamming distances of codes of one byte, which are known.
    pub fn of_codes([left, right]: [&Plane<u8>; 2], candidates: Candidates) -> Result<Self> {
        let cols = left.cols();
        let bytes = |plane: Plane<u8>| BytePlanes { width: plane.cols(), plane, count: 1 };
        let rights = vec![bytes(unroll(right, candidates, |code| code)?)];
        let codes = PairCodes { left: bytes(left.clone()), rights, labels: None };

        Ok(Self {
            compared: Compared::Codes(codes),
            candidates,
            cols,
            ceiling: 8,
            steps: 1,
            validity: None,
            valid: None,
        })
    }

    /// Costs of the caller: rows of `columns x candidates`.
    pub fn of_volume(volume: &'a Plane<u16>, candidates: Candidates) -> Self {
        let cols = volume.cols() / candidates.count();
        let compared = Compared::Volume(volume);
        let ceiling = u16::MAX;

        Self { compared, candidates, cols, ceiling, steps: 1, validity: None, valid: None }
    }

    /// The whole volume at once, for inspection and tests: rows of `columns x candidates`.
    pub fn volume(&self, rows: usize, level: Level, control: &Control) -> Result<Plane<u16>> {
        let count = self.candidates.count();
        let padded = self.runs() * LANES;

        Plane::by_bands((rows, self.cols * count), 1, |y, volume| {
            control.checkpoint()?;
            let mut costs = RunMemory::default();
            costs.resize(self.cols * self.runs())?;
            level.run(WriteRow { costs: self, y, out: &mut costs });

            for (volume, costs) in
                volume.chunks_exact_mut(count).zip(costs.as_flattened().chunks_exact(padded))
            {
                volume.copy_from_slice(&costs[..count]);
            }

            Ok(())
        })
    }

    /// All candidates.
    pub fn searched(&self) -> Searched {
        Searched::all(self.candidates.count())
    }

    /// Runs of [`LANES`] candidates of a pixel, the last of them padded.
    pub fn runs(&self) -> usize {
        self.searched().runs()
    }

    /// Whether either image has a mask.
    pub fn has_masks(&self) -> bool {
        self.valid.is_some()
    }

    /// The valid pairs of pixel and candidate; `None`: all.
    pub fn validity(&self) -> Option<&Validity<'a>> {
        self.validity.as_ref()
    }

    /// The disparities that are searched.
    pub fn candidates(&self) -> Candidates {
        self.candidates
    }

    /// The largest cost there can be.
    pub fn ceiling(&self) -> u16 {
        self.ceiling
    }

    /// What pixels that have nothing to do with one another cost at least, on average: a third of the bits of a code.
    /// Random codes differ in half of them, those with a weak level in fewer. `None`: unknown.
    pub fn unrelated(&self) -> Option<f64> {
        matches!(self.compared, Compared::Codes(_)).then(|| f64::from(self.ceiling) / 3.0)
    }

    /// Steps of the cost per unit of the penalties.
    pub fn steps(&self) -> u16 {
        self.steps
    }

    /// Writes the costs of some columns of row `y`, the searched candidates of one column after another; 0 where either
    /// pixel is invalid. Values beyond the last candidate are undefined.
    #[inline(always)]
    pub fn write<V: Value>(
        &self,
        y: usize,
        columns: Range<usize>,
        searched: Searched,
        out: &mut [Lanes<V>],
    ) {
        let (values, stride) = (out.as_flattened_mut(), searched.runs() * LANES);

        for first in (0..stride).step_by(LANES) {
            let block = (y, columns.clone(), searched.part(first, LANES));
            self.write_lines(block, Lines::<V, LANES> { values, first, stride });
        }
    }

    /// Writes the costs of up to `L` candidates, as [`Self::write`], into a line of each pixel.
    #[inline(always)]
    pub fn write_lines<V: Value, const L: usize>(
        &self,
        (y, columns, searched): (usize, Range<usize>, Searched),
        mut out: Lines<V, L>,
    ) {
        match &self.compared {
            Compared::Codes(codes) => {
                let block = (y, columns.clone(), searched);
                match codes.left.count {
                    1 => self.write_distances::<V, 1, L>(codes, (0, false), block, &mut out),
                    2 => self.write_distances::<V, 2, L>(codes, (0, false), block, &mut out),
                    // Longer codes: one byte after another.
                    bytes => {
                        clear(&mut out);
                        for byte in 0..bytes {
                            let block = block.clone();
                            self.write_distances::<V, 1, L>(codes, (byte, true), block, &mut out);
                        }
                    }
                }
            }
            Compared::Levels(channels) => {
                clear(&mut out);
                for [left, right] in channels {
                    for (place, x) in columns.clone().enumerate() {
                        let right = self.unrolled(right, y, x, searched);
                        add_differences(left.row(y)[x], right, out.line(place));
                    }
                }
            }
            Compared::Volume(volume) => {
                let count = self.candidates.count();
                let costs = volume.row(y)[columns.start * count..].chunks_exact(count);
                for (place, costs) in costs.take(columns.len()).enumerate() {
                    let lanes = out.line(place).iter_mut().zip(&costs[searched.start..]);
                    lanes.for_each(|(out, cost)| *out = V::truncated((*cost).into()));
                }
            }
        }

        // Invalid pairs add nothing to sums, which aggregation scales by the number of valid ones.
        if let (Some(validity), Some([left, right])) = (&self.validity, &self.valid) {
            let (whole, left) = (validity.whole(y), left.row(y));
            for (place, x) in columns.enumerate().filter(|(_, x)| !whole[*x]) {
                mask_out(left[x], self.unrolled(right, y, x, searched), out.line(place));
            }
        }
    }

    /// Writes 1 where a pixel of some columns of row `y` and its candidate are both valid, else 0. Writes nothing without
    /// masks.
    #[inline(always)]
    pub fn write_validity<V: Value, const L: usize>(
        &self,
        (y, columns, searched): (usize, Range<usize>, Searched),
        out: &mut [[V; L]],
    ) {
        let Some([left, right]) = &self.valid else { return };

        let left = &left.row(y)[columns.clone()];
        for ((x, left), out) in columns.zip(left).zip(out) {
            mark_valid(*left, self.unrolled(right, y, x, searched), out);
        }
    }

    /// Writes the Hamming distances over `N` bytes of the codes, from byte `first` on; `adds`: to what is there.
    #[inline(always)]
    fn write_distances<V: Value, const N: usize, const L: usize>(
        &self,
        codes: &PairCodes,
        (first, adds): (usize, bool),
        (y, columns, searched): (usize, Range<usize>, Searched),
        out: &mut Lines<V, L>,
    ) {
        let Some(labels) = &codes.labels else {
            let block = (y, columns, searched);
            return self.write_stretch::<V, N, L>(codes, (0, first, adds), block, out);
        };

        // Most neighbors have the same label, so are compared with the same version of the right image.
        let mut start = 0;
        for stretch in labels.row(y)[columns.clone()].chunk_by(|label, next| label == next) {
            let version = usize::from(stretch[0]);
            let here = columns.start + start..columns.start + start + stretch.len();
            let (block, mut out) = ((y, here, searched), out.part(start, stretch.len()));
            self.write_stretch::<V, N, L>(codes, (version, first, adds), block, &mut out);
            start += stretch.len();
        }
    }

    /// As [`Self::write_distances`], for columns that are compared with one version of the right image.
    #[inline(always)]
    fn write_stretch<V: Value, const N: usize, const L: usize>(
        &self,
        codes: &PairCodes,
        (version, first, adds): (usize, usize, bool),
        (y, columns, searched): (usize, Range<usize>, Searched),
        out: &mut Lines<V, L>,
    ) {
        let mut lefts: [&[u8]; N] = codes.left.rows(first, y);
        let mut rights: [&[u8]; N] = codes.rights[version].rows(first, y);

        // What the last of these columns meets comes first.
        let start = self.cols - columns.end + searched.start;
        let width = columns.len() - 1 + L;
        for byte in 0..N {
            lefts[byte] = &lefts[byte][columns.clone()];
            rights[byte] = &rights[byte][start..][..width];
        }

        compare(lefts, rights, adds, out);
    }

    /// The cost of a left pixel with the pixel of any right column; `None` where either is invalid. Disparity 0 must be the
    /// least candidate: then every right column is unrolled.
    pub fn between(&self, y: usize, x: usize, column: usize) -> Option<u32> {
        debug_assert!(self.candidates.min() == 0 && column < self.cols);
        let place = self.cols - 1 - column;
        if self
            .valid
            .as_ref()
            .is_some_and(|[left, right]| left.row(y)[x] & right.row(y)[place] == 0)
        {
            return None;
        }

        Some(match &self.compared {
            Compared::Codes(codes) => codes.distance(y, x, place),
            Compared::Levels(channels) => {
                let difference = |[left, right]: &[Plane<u16>; 2]| {
                    u32::from(left.row(y)[x].abs_diff(right.row(y)[place]))
                };
                channels.iter().map(difference).sum()
            }
            Compared::Volume(volume) => {
                let count = self.candidates.count();
                let candidate = x.checked_sub(column).filter(|candidate| *candidate < count)?;
                volume.row(y)[x * count + candidate].into()
            }
        })
    }

    /// The pixels under `L` candidates of column `x`, of row `y` of an unrolled plane.
    #[inline(always)]
    fn unrolled<'p, T, const L: usize>(
        &self,
        plane: &'p Plane<T>,
        y: usize,
        x: usize,
        searched: Searched,
    ) -> &'p [T; L] {
        leading(&plane.row(y)[self.cols - 1 - x + searched.start..])
    }
}

impl PairCodes {
    fn new(
        views: [&View; 2],
        candidates: Candidates,
        settings: &Settings,
        compensation: Option<&BlurCompensation>,
        level: Level,
        control: &Control,
    ) -> Result<Self> {
        let (rows, cols, _) = views[0].image.shape();
        let gray =
            |side: usize| blur_compensation::gray(views[side], compensation, side, level, control);

        let codes = |gray: &Gray, side: usize, kernel: Option<&Kernel>| {
            let noise = compensation.map(|compensation| compensation.noise()[side]);
            let unrolled = (side == 1).then(|| Unrolled::new(cols, candidates));
            let bytes = ByteRows { width: unrolled.map_or(cols, |row| row.width), unrolled };
            match kernel {
                None => bytes.describe(gray, settings, noise, level, control),
                Some(kernel) => {
                    let blurred = gray.convolved(kernel, level, control)?;
                    bytes.describe(&blurred, settings, noise, level, control)
                }
            }
        };

        let Some(compensation) = compensation else {
            let [left, right] = both(|side| codes(&gray(side)?, side, None))?;
            return Ok(Self { left, rights: vec![right], labels: None });
        };

        // The left pixels take the codes of the version that their label names.
        let left = || {
            let ((kernels, labels), gray) = (compensation.of_side(0, (rows, cols))?, gray(0)?);
            let mut left = codes(&gray, 0, kernels[0])?;
            for (label, kernel) in (1..).zip(&kernels[1..]) {
                left.take_where(&codes(&gray, 0, *kernel)?, &labels, label);
            }
            Ok(left)
        };
        // Any left pixel may be compared with any version of the right image, so all are kept.
        let rights = || {
            let ((kernels, labels), gray) = (compensation.of_side(1, (rows, cols))?, gray(1)?);
            let rights = kernels.iter().map(|kernel| codes(&gray, 1, *kernel));
            let rights = rights.collect::<Result<Vec<_>>>()?;
            // With a single version there is nothing to look up.
            let labels = (rights.len() > 1).then_some(labels);
            Ok((rights, labels))
        };

        let (left, rights) = rayon::join(left, rights);
        rights.and_then(|(rights, labels)| Ok(Self { left: left?, rights, labels }))
    }

    /// The Hamming distance of the code of a left pixel and one at a place of the unrolled right image.
    fn distance(&self, y: usize, x: usize, place: usize) -> u32 {
        let version = self.labels.as_ref().map_or(0, |labels| labels.row(y)[x].into());

        let bits = |byte: usize| {
            let ([left], [right]) = (self.left.rows(byte, y), self.rights[version].rows(byte, y));
            (left[x] ^ right[place]).count_ones()
        };
        (0..self.left.count).map(bits).sum()
    }
}

impl BytePlanes {
    /// Row `y` of the bytes from byte `first` on.
    #[inline(always)]
    fn rows<const N: usize>(&self, first: usize, y: usize) -> [&[u8]; N] {
        let row = self.plane.row(y);
        let mut rows = [&[][..]; N];

        for byte in 0..N {
            rows[byte] = &row[(first + byte) * self.width..][..self.width];
        }

        rows
    }

    /// Takes the codes of other planes of the same size where the labels are `label`.
    fn take_where(&mut self, other: &Self, labels: &Labels, label: u8) {
        for y in 0..self.plane.rows() {
            let rows = self.plane.row_mut(y).chunks_exact_mut(self.width);
            for (row, other) in rows.zip(other.plane.row(y).chunks_exact(self.width)) {
                for ((byte, other), known) in row.iter_mut().zip(other).zip(labels.row(y)) {
                    *byte = if *known == label { *other } else { *byte };
                }
            }
        }
    }
}

/// Stores codes as [`BytePlanes`].
struct ByteRows {
    width: usize,
    /// How rows of the right image are unrolled; `None`: rows of the left one stay as they are.
    unrolled: Option<Unrolled>,
}

impl ByteRows {
    /// The codes of an image.
    fn describe(
        self,
        gray: &Gray,
        settings: &Settings,
        noise: Option<f64>,
        level: Level,
        control: &Control,
    ) -> Result<BytePlanes> {
        let count = settings.code_length().div_ceil(8);
        let plane =
            describe_rows(gray, settings, noise, &self, count * self.width, level, control)?;

        Ok(BytePlanes { plane, width: self.width, count })
    }
}

impl RowOfCodes for ByteRows {
    type Item = u8;

    #[inline(always)]
    fn write<W: Word>(&self, words: [&[W]; 2], row: &mut [u8]) {
        for (index, row) in row.chunks_exact_mut(self.width).enumerate() {
            let words = words[index / 4];
            let byte = |word: W| word.byte(index % 4);
            match &self.unrolled {
                Some(unrolled) => unrolled.write(words, byte, row),
                None => write_bytes(words, byte, row),
            }
        }
    }
}

/// Writes a byte of each word.
#[inline(always)]
fn write_bytes<W: Word>(words: &[W], byte: impl Fn(W) -> u8, row: &mut [u8]) {
    let words = &words[..row.len()];

    for i in 0..row.len() {
        row[i] = byte(words[i]);
    }
}

/// How a row of the right image is reversed and clamped at both ends: column `x` meets candidate `k` at place
/// `cols - 1 - x + k`. Whole runs of [`LANES`] candidates can be read anywhere.
#[derive(Clone, Copy)]
struct Unrolled {
    /// Places of a row.
    width: usize,
    /// First places, which lie right of the image ...
    beyond: usize,
    /// ... and the columns, from the first one on, that the next places show. The others lie left of it.
    seen: usize,
}

impl Unrolled {
    fn new(cols: usize, candidates: Candidates) -> Self {
        // The last run of candidates reads up to `LANES - 1` places beyond the last candidate.
        let width = cols + candidates.count().next_multiple_of(LANES) - 1;
        // Place 0 would show column `cols - 1 - min` if the image had no border.
        let beyond = (-candidates.min()).clamp(0, width as isize) as usize;
        let first = cols as isize - 1 - candidates.min();
        let seen = (first + 1 - beyond as isize).clamp(0, cols as isize) as usize;

        Self { width, beyond, seen }
    }

    /// Writes an unrolled row of the values of pixels.
    #[inline(always)]
    fn write<T: Copy, U: Clone>(&self, pixels: &[T], value: impl Fn(T) -> U, row: &mut [U]) {
        let (right, rest) = row.split_at_mut(self.beyond);
        let (within, left) = rest.split_at_mut(self.seen.min(self.width - self.beyond));

        right.fill(value(pixels[pixels.len() - 1]));
        within
            .iter_mut()
            .zip(pixels[..self.seen].iter().rev())
            .for_each(|(out, pixel)| *out = value(*pixel));
        left.fill(value(pixels[0]));
    }
}

/// A right image unrolled.
fn unroll<T: Copy + Sync, U: Clone + Default + Send>(
    plane: &Plane<T>,
    candidates: Candidates,
    value: impl Fn(T) -> U + Sync,
) -> Result<Plane<U>> {
    let unrolled = Unrolled::new(plane.cols(), candidates);

    Plane::by_bands((plane.rows(), unrolled.width), ROWS, |top, band| {
        for (y, row) in (top..).zip(band.chunks_exact_mut(unrolled.width)) {
            unrolled.write(plane.row(y), &value, row);
        }
        Ok(())
    })
}

/// Where the left and the unrolled right image are valid.
fn valid(
    validity: &Validity,
    (rows, cols): (usize, usize),
    candidates: Candidates,
) -> Result<[Plane<u8>; 2]> {
    let everywhere = Mask::from_fn(rows, cols, |_, _| true);
    let [left, right] = validity.masks().map(|mask| mask.unwrap_or(&everywhere));
    Ok([left.map(|valid| u8::from(*valid)), unroll(right, candidates, u8::from)?])
}

/// Planes to compare by absolute differences, and the largest cost over all channels.
fn absolute_differences<'a>(
    [left, right]: [Vec<Plane<u16>>; 2],
    candidates: Candidates,
    ceiling: u16,
) -> Result<(Compared<'a>, u16)> {
    let unrolled = |right: Plane<u16>| unroll(&right, candidates, |level| level);
    let channels = left.into_iter().zip(right).map(|(left, right)| Ok([left, unrolled(right)?]));
    let channels: Vec<_> = channels.collect::<Result<_>>()?;

    let ceiling = ceiling * channels.len() as u16;
    Ok((Compared::Levels(channels), ceiling))
}

/// Writes all costs of a row.
struct WriteRow<'a> {
    costs: &'a Costs<'a>,
    y: usize,
    out: &'a mut [Lanes<u16>],
}

impl simd::Loop for WriteRow<'_> {
    type Output = ();
    const COUNTS_BITS: bool = true;

    #[inline(always)]
    fn run(self) {
        self.costs.write(self.y, 0..self.costs.cols, self.costs.searched(), self.out);
    }
}

#[inline(always)]
fn clear<V: Value, const L: usize>(out: &mut Lines<V, L>) {
    for pixel in 0..out.count() {
        *out.line(pixel) = [V::default(); L];
    }
}

/// The first `L` values.
#[inline(always)]
fn leading<T, const L: usize>(values: &[T]) -> &[T; L] {
    &values.as_chunks().0[0]
}

/// Writes the Hamming distances over `N` bytes, of pixels and their candidates, or adds them to what is there.
#[inline(always)]
fn compare<V: Value, const N: usize, const L: usize>(
    lefts: [&[u8]; N],
    rights: [&[u8]; N],
    adds: bool,
    out: &mut Lines<V, L>,
) {
    let last = lefts[0].len() - 1;

    let (pixels, first) = out.pixels();
    for (place, pixel) in pixels.enumerate() {
        let mut left = [0; N];
        let mut right = [&[0; L]; N];
        for byte in 0..N {
            left[byte] = lefts[byte][place];
            right[byte] = leading(&rights[byte][last - place..]);
        }

        let bits = distances(left, right);
        let out: &mut [V; L] = line(pixel, first);
        for j in 0..L {
            let bits = V::truncated(bits[j].into());
            out[j] = if adds { out[j].plus(bits) } else { bits };
        }
    }
}

#[inline(always)]
fn distances<const N: usize, const L: usize>(left: [u8; N], right: [&[u8; L]; N]) -> [u8; L] {
    let mut bits = [0; L];
    for byte in 0..N {
        let (left, right) = (left[byte], right[byte]);
        for j in 0..L {
            bits[j] += (left ^ right[j]).count_ones() as u8;
        }
    }
    bits
}

#[inline(always)]
fn add_differences<V: Value, const L: usize>(left: u16, right: &[u16; L], out: &mut [V; L]) {
    for j in 0..L {
        out[j] = out[j].plus(V::truncated(left.abs_diff(right[j]).into()));
    }
}

/// 1 for the candidates of a pixel that are valid as it is, else 0: in registers, as what is written may not overlap it.
#[inline(always)]
fn both_valid<const L: usize>(left: u8, right: &[u8; L]) -> [u8; L] {
    let mut both = *right;
    for both in &mut both {
        *both &= left;
    }
    both
}

#[inline(always)]
fn mark_valid<V: Value, const L: usize>(left: u8, right: &[u8; L], out: &mut [V; L]) {
    let both = both_valid(left, right);
    for j in 0..L {
        out[j] = V::truncated(both[j].into());
    }
}

#[inline(always)]
fn mask_out<V: Value, const L: usize>(left: u8, right: &[u8; L], out: &mut [V; L]) {
    let both = both_valid(left, right);
    for j in 0..L {
        // All bits or none: the compiler makes choices lane by lane.
        out[j] = V::truncated(out[j].widened() & u64::from(both[j]).wrapping_neg());
    }
}
