//! What is asked for: whether a device takes it, in which parts, what it needs for them, and what its words
//! mean.

use std::ops::Range;

use phasestereo_match::base::plane::Plane;
use phasestereo_match::cost::phase::PhaseCodes;
use phasestereo_match::optimization::engine::Chunk;
use phasestereo_match::optimization::evidence::{Evidence, EvidenceRow, NONE};
use phasestereo_match::optimization::memory::Width;
use phasestereo_match::optimization::{BAND, LOOKAHEAD_ROWS, subpixel};
use phasestereo_match::pair::blur_compensation::MOST_CLASSES;
use phasestereo_match::settings::Optimizer;
use rayon::prelude::*;

use crate::kernels;

/// Words that are found of each pixel.
pub const PIXEL_WORDS: usize = 3;
/// Bits of a pixel's byte below its version of the right image; the others hold all that there may be.
const VERSION_SHIFT: u32 = 4;
const _: () = assert!(MOST_CLASSES <= 1 << (u8::BITS - VERSION_SHIFT));
/// Largest radius of a window: some of the columns that are summed are those of its center.
const MOST_RADIUS: usize = (kernels::SUMMED_COLUMNS as usize - 1) / 2;

/// A chunk that a device takes.
pub struct Request<'a> {
    chunk: &'a Chunk<'a>,
    codes: PhaseCodes<'a>,
    /// Words of the candidates of a pixel, four in each.
    words: usize,
    is_along_columns: bool,
    /// Bands of a part.
    bands: usize,
}

/// The rows of one part, and all that the kernels read.
pub struct Task {
    /// The numbers of the structure of the same name in the shader.
    pub numbers: [u32; 20],
    pub left: Vec<u8>,
    pub right: Vec<u8>,
    pub pixels: Vec<u8>,
    pub cols: usize,
    pub words: u32,
    pub radius: usize,
    pub is_along_columns: bool,
    /// Rows to choose for, and those that have costs.
    chosen: Range<usize>,
    seen: Range<usize>,
    bands: usize,
}

impl<'a> Request<'a> {
    /// The chunk, if a device with these limits takes it.
    pub fn new(chunk: &'a Chunk, limits: wgpu::Limits, most_bytes: u64) -> Option<Self> {
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
        let threads = words as u32 * kernels::paths(words as u32);
        let has_threads = threads <= limits.max_compute_invocations_per_workgroup
            && words as u32 <= limits.max_compute_workgroup_size_x;

        let largest = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let volume = search.size.1 * words.max(PIXEL_WORDS) * 4;
        let right = codes.rights.iter().map(|right| right.cols()).sum::<usize>();
        let rows = (most_bytes.min(largest) as usize / volume)
            .min((largest as usize / right).saturating_sub(2 * radius));
        let ahead = if is_along_columns { 2 * LOOKAHEAD_ROWS } else { 0 };
        let bands = rows.saturating_sub(ahead) / BAND;

        let is_taken = is_plain && has_window && has_threads && bands > 0;
        is_taken.then_some(Self { chunk, codes, words, is_along_columns, bands })
    }

    /// Parts of rows, each of which ends where a band does.
    pub fn parts(&self, rows: Range<usize>) -> impl Iterator<Item = Range<usize>> + use<> {
        let (first, bands, mut start) = (self.chunk.search.first, self.bands, rows.start);
        std::iter::from_fn(move || {
            let end = (((start + first) / BAND + bands) * BAND - first).min(rows.end);
            let part = start..end;
            start = end;
            (!part.is_empty()).then_some(part)
        })
    }

    /// What the kernels need for a part.
    pub fn task(&self, chosen: Range<usize>) -> Task {
        let Chunk { search, source, .. } = self.chunk;
        let ((height, cols), first, radius) = (search.size, search.first, source.window.radius());
        // The bands of the whole image, of which the first may begin above this one.
        let bands = (chosen.start + first) / BAND..(chosen.end + first).div_ceil(BAND);
        let band = (bands.start * BAND) as isize - first as isize;
        let seen = if self.is_along_columns {
            let start = band.saturating_sub_unsigned(LOOKAHEAD_ROWS).max(0) as usize;
            start..(bands.end * BAND + LOOKAHEAD_ROWS - first).min(height)
        } else {
            chosen.clone()
        };
        let rows = seen.start.saturating_sub(radius)..(seen.end + radius).min(height);
        let [top, bottom, start, end] =
            [seen.start, seen.end, chosen.start, chosen.end].map(|y| (y - rows.start) as u32);

        let [whole, half, third] = search.penalties.adaptive_p2().map(|p2| p2 as u32);
        let places = self.codes.rights[0].cols() / self.codes.bytes;
        let numbers = [
            [cols, rows.len(), search.candidates, self.codes.bytes].map(|n| n as u32),
            [places as u32, radius as u32, source.window.dropped, search.penalties.p1 as u32],
            [whole, half, third, third],
            [top, bottom, start, end],
            [(band - rows.start as isize) as u32, 0, 0, 0],
        ];

        Task {
            numbers: bytemuck::cast(numbers),
            left: bytes(&[self.codes.left], &rows),
            right: bytes(&self.codes.rights, &rows),
            pixels: self.pixels(&rows),
            cols,
            words: self.words as u32,
            radius,
            is_along_columns: self.is_along_columns,
            chosen,
            seen,
            bands: bands.len(),
        }
    }

    /// Of each pixel of some rows a byte: the jumps from its neighbors, and the version of the right image that
    /// it is compared with.
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

    /// Writes what was found of a part, whose first row is row `first` of the evidence.
    pub fn write(&self, part: Range<usize>, found: &[u32], evidence: &mut Evidence, first: usize) {
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

impl Task {
    /// Rows that are chosen for.
    pub fn rows(&self) -> usize {
        self.chosen.len()
    }

    /// Rows that have costs.
    pub fn seen_rows(&self) -> u32 {
        self.seen.len() as u32
    }

    /// Bands that these rows lie in.
    pub fn bands(&self) -> u32 {
        self.bands as u32
    }

    /// Bytes of a volume of costs or totals.
    pub fn volume_bytes(&self) -> u64 {
        (self.seen.len() * self.cols * self.words as usize * 4) as u64
    }
}

/// The evidence of a row; beside the chosen candidates empty unless the row is weighed.
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
            let k = (pixel[0] & 0xffff) as usize;
            row.chosen.push(k as u16);
            if !is_weighed {
                continue;
            }

            // As in `optimization::selection`.
            let [totals, costs] = [pixel[1], pixel[2]].map(u32::to_le_bytes);
            row.best.push(totals[k.min(1)].into());
            let has_second = k >= 2 || k + 2 < candidates;
            row.second_best.push(if has_second { pixel[0] >> 16 } else { NONE });
            let [below, at, above] =
                [0, 1, 2].map(|i| subpixel::evidence(totals[i].into(), costs[i].into()));
            let is_inside = k > 0 && k + 1 < candidates;
            row.offset.push(if is_inside { subpixel::offset(below, at, above) } else { 0.0 });
        }
        row
    }
}

/// Some rows of each of some planes.
fn bytes(planes: &[&Plane<u8>], rows: &Range<usize>) -> Vec<u8> {
    let part = |plane: &&Plane<u8>| {
        plane.as_slice()[rows.start * plane.cols()..rows.end * plane.cols()].to_vec()
    };
    whole_words(planes.iter().flat_map(part).collect())
}

/// Bytes up to the end of a word.
fn whole_words(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}
