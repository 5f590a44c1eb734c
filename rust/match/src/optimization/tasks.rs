//! Searches for devices that compute with words: which ones they support, how they are split, the inputs of
//! the kernels, and the meaning of their results.

use std::ops::Range;

use rayon::prelude::*;

use crate::base::error::Result;
use crate::base::plane::{Plane, widened};
use crate::cost::phase::PhaseCodes;
use crate::optimization::engine::Chunk;
use crate::optimization::evidence::{Evidence, EvidenceRow, NONE};
use crate::optimization::memory::Width;
use crate::optimization::{BAND, LOOKAHEAD_ROWS, subpixel};
use crate::pair::blur_compensation::MOST_CLASSES;
use crate::settings::Optimizer;

/// Words of results for each pixel.
pub const PIXEL_WORDS: usize = 3;
/// Largest radius of a window.
pub const MOST_RADIUS: usize = 15;
/// Bits of a pixel's byte below its version of the right image; the other bits hold all possible versions.
const VERSION_SHIFT: u32 = 4;
const _: () = assert!(MOST_CLASSES <= 1 << (u8::BITS - VERSION_SHIFT));

/// The limits of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Threads of a workgroup, at least 32: each follows a path of four candidates.
    pub threads: u64,
    /// Bytes of the largest buffer.
    pub buffer: u64,
    /// Bytes of the largest volume of costs or totals, of which `"so"` has two and `"sgm"` three.
    pub volume: u64,
}

/// The rows of one part, and all inputs of the kernels.
#[derive(Debug, Clone, Copy)]
pub struct Task<'a> {
    /// Columns, rows of the codes, candidates, bytes of a code; places of a row of right codes, radius of the
    /// window, dropped bits of a column's sum, P1; P2 after no jump, a small one and, twice, a large one;
    /// first row with costs and the one after the last, and the same for rows to choose for; the first band's
    /// row, the number of bands, 1 if paths run along columns, too.
    pub numbers: [u32; 20],
    /// Left codes: row, byte of the code, column. This and what follows is whole words.
    pub left: &'a [u8],
    /// Right codes: version, row, byte of the code, place.
    pub right: &'a [u8],
    /// For each pixel, the jumps from its neighbors, and in the bits above them its version of the right
    /// image.
    pub pixels: &'a [u8],
}

impl Task<'_> {
    /// Columns.
    pub fn cols(&self) -> u32 {
        self.numbers[0]
    }

    /// Words of the candidates of a pixel, four in each.
    pub fn words(&self) -> u32 {
        self.numbers[2].div_ceil(4)
    }

    /// The radius of the window.
    pub fn radius(&self) -> u32 {
        self.numbers[5]
    }

    /// Rows that have costs.
    pub fn seen_rows(&self) -> u32 {
        self.numbers[13] - self.numbers[12]
    }

    /// Rows to choose for.
    pub fn rows(&self) -> u32 {
        self.numbers[15] - self.numbers[14]
    }

    /// Bands that these lie in.
    pub fn bands(&self) -> u32 {
        self.numbers[17]
    }

    /// Whether paths run along columns, too.
    pub fn is_along_columns(&self) -> bool {
        self.numbers[18] != 0
    }

    /// Bytes of a volume of costs or totals.
    pub fn volume_bytes(&self) -> u64 {
        u64::from(self.seen_rows()) * u64::from(self.cols()) * u64::from(self.words()) * 4
    }

    /// Words of results.
    pub fn found_words(&self) -> usize {
        self.rows() as usize * self.cols() as usize * PIXEL_WORDS
    }
}

/// Lets a device choose candidates like [`Engine::choose`](super::engine::Engine::choose): `run` returns the
/// words of a task, or `None` if the device failed. `false`: it does not support the chunk, or failed.
///
/// Devices support searches with the optimizers `"so"` and `"sgm"`, by phase codes without masks and fixed
/// windows of up to 31 pixels, if a byte holds every total and no panel has a range of its own.
pub fn choose(
    rows: Range<usize>,
    chunk: &Chunk,
    limits: Limits,
    evidence: &mut Evidence,
    mut run: impl FnMut(&Task) -> Option<Vec<u32>>,
) -> Result<bool> {
    let Some(request) = Request::new(chunk, limits) else { return Ok(false) };

    evidence.begin(rows.len(), chunk.search.size.1, chunk.search.is_weighed())?;
    for part in request.parts(rows.clone()) {
        chunk.search.control.checkpoint()?;
        let words = part.len() * chunk.search.size.1 * PIXEL_WORDS;
        let found = request.with_task(part.clone(), &mut run).filter(|found| found.len() == words);
        let Some(found) = found else { return Ok(false) };
        request.write(part.clone(), &found, evidence, part.start - rows.start);
    }
    Ok(true)
}

/// A chunk that a device supports.
struct Request<'a> {
    chunk: &'a Chunk<'a>,
    codes: PhaseCodes<'a>,
    is_along_columns: bool,
    /// Bands of a part.
    bands: usize,
}

impl<'a> Request<'a> {
    /// The chunk, if a device with these limits supports it.
    fn new(chunk: &'a Chunk, limits: Limits) -> Option<Self> {
        let Chunk { search, source, width } = chunk;
        let codes = source.costs.codes()?;
        let is_along_columns = match search.optimizer {
            Optimizer::SemiGlobal => true,
            Optimizer::ScanlineOptimization => false,
            Optimizer::DynamicProgramming | Optimizer::WinnerTakesAll => return None,
        };
        let is_plain = search.ranges.is_none() && *width == Width::Bytes;
        let radius = source.window.radius();
        let has_window = !source.window.shiftable && radius <= MOST_RADIUS;

        let words = search.candidates.div_ceil(4);
        let volume = search.size.1 * words.max(PIXEL_WORDS) * 4;
        let right = codes.rights.iter().map(|right| right.cols()).sum::<usize>();
        let rows = (limits.volume.min(limits.buffer) as usize / volume)
            .min((limits.buffer as usize / right).saturating_sub(2 * radius));
        let ahead = if is_along_columns { 2 * LOOKAHEAD_ROWS } else { 0 };
        let bands = rows.saturating_sub(ahead) / BAND;

        let is_taken = is_plain && has_window && words as u64 <= limits.threads && bands > 0;
        is_taken.then_some(Self { chunk, codes, is_along_columns, bands })
    }

    /// Parts of rows, each of which ends where a band does.
    fn parts(&self, rows: Range<usize>) -> impl Iterator<Item = Range<usize>> + use<> {
        let (first, bands, mut start) = (self.chunk.search.first, self.bands, rows.start);
        std::iter::from_fn(move || {
            let end = (((start + first) / BAND + bands) * BAND - first).min(rows.end);
            let part = start..end;
            start = end;
            (!part.is_empty()).then_some(part)
        })
    }

    /// Runs `run` with the inputs of the kernels for a part.
    fn with_task<T>(&self, chosen: Range<usize>, run: impl FnOnce(&Task) -> T) -> T {
        let Chunk { search, source, .. } = self.chunk;
        let ((height, cols), first, radius) = (search.size, search.first, source.window.radius());
        // The bands of the whole image, the first of which may begin above this one.
        let bands = (chosen.start + first) / BAND..(chosen.end + first).div_ceil(BAND);
        let band = (bands.start * BAND) as isize - first as isize;
        let seen = if self.is_along_columns {
            let start = band.saturating_sub_unsigned(LOOKAHEAD_ROWS).max(0) as usize;
            start..(bands.end * BAND + LOOKAHEAD_ROWS - first).min(height)
        } else {
            chosen.clone()
        };
        let rows = widened(&seen, radius, height);
        let [top, bottom, start, end] =
            [seen.start, seen.end, chosen.start, chosen.end].map(|y| (y - rows.start) as u32);

        let [whole, half, third] = search.penalties.adaptive_p2().map(|p2| p2 as u32);
        let places = self.codes.rights[0].cols() / self.codes.bytes;
        let [cols, height, candidates, bytes, places, radius, bands] =
            [cols, rows.len(), search.candidates, self.codes.bytes, places, radius, bands.len()]
                .map(|number| number as u32);
        let (dropped, p1) = (source.window.dropped, search.penalties.p1 as u32);
        let band = (band - rows.start as isize) as u32;
        #[rustfmt::skip]
        let numbers = [
            cols, height, candidates, bytes,
            places, radius, dropped, p1,
            whole, half, third, third,
            top, bottom, start, end,
            band, bands, self.is_along_columns.into(), 0,
        ];

        let left = of_rows(&[self.codes.left], &rows);
        let right = of_rows(&self.codes.rights, &rows);
        run(&Task { numbers, left: &left, right: &right, pixels: &self.pixels(&rows) })
    }

    /// A byte for each pixel of some rows: the jumps from its neighbors, and the version of the right image
    /// that it is compared with.
    fn pixels(&self, rows: &Range<usize>) -> Vec<u8> {
        let mut pixels = Vec::new();
        for y in rows.clone() {
            let start = pixels.len();
            pixels.extend_from_slice(self.chunk.search.edges.row(y));
            if let Some(labels) = self.codes.labels {
                let row = pixels[start..].iter_mut().zip(labels.row(y));
                row.for_each(|(pixel, label)| *pixel |= label << VERSION_SHIFT);
            }
        }
        whole_words(pixels)
    }

    /// Writes the results of a part, whose first row is row `first` of the evidence.
    fn write(&self, part: Range<usize>, found: &[u32], evidence: &mut Evidence, first: usize) {
        let search = self.chunk.search;
        let cols = search.size.1;
        let rows = found.par_chunks_exact(cols * PIXEL_WORDS).zip(part.into_par_iter());
        let rows: Vec<_> =
            rows.map(|(found, y)| Row::new(found, search.candidates, search.weighs(y))).collect();

        for (row, Row { chosen, best, second_best, offset }) in (first..).zip(&rows) {
            if best.is_empty() {
                evidence.choose(row, 0, chosen);
            } else {
                evidence.set(row, 0, EvidenceRow { chosen, best, second_best, offset });
            }
        }
    }
}

/// The evidence of a row; unless the row is weighed, all but the chosen candidates is empty.
#[derive(Default)]
struct Row {
    chosen: Vec<u16>,
    best: Vec<u32>,
    second_best: Vec<u32>,
    offset: Vec<f32>,
}

impl Row {
    fn new(found: &[u32], candidates: usize, is_weighed: bool) -> Self {
        let mut row = Self::default();
        for pixel in found.chunks_exact(PIXEL_WORDS) {
            // A faulty device must not leave the range.
            let k = ((pixel[0] & 0xffff) as usize).min(candidates - 1);
            row.chosen.push(k as u16);
            if !is_weighed {
                continue;
            }

            // As in `optimization::selection`.
            let [totals, costs] = [pixel[1], pixel[2]].map(u32::to_le_bytes);
            row.best.push(totals[k.min(1)].into());
            let has_second = k >= 2 || k + 2 < candidates;
            row.second_best.push(if has_second { pixel[0] >> 16 } else { NONE });
            let [below, at, above] = [0, 1, 2].map(|i| subpixel::evidence(totals[i].into(), costs[i].into()));
            let is_inside = k > 0 && k + 1 < candidates;
            row.offset.push(if is_inside { subpixel::offset(below, at, above) } else { 0.0 });
        }
        row
    }
}

/// Some rows of each of some planes.
fn of_rows(planes: &[&Plane<u8>], rows: &Range<usize>) -> Vec<u8> {
    let part =
        |plane: &&Plane<u8>| plane.as_slice()[rows.start * plane.cols()..rows.end * plane.cols()].to_vec();
    whole_words(planes.iter().flat_map(part).collect())
}

/// Pads bytes to the end of a word.
fn whole_words(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}
