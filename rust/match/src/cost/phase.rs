//! The Hamming distance of phase codes (paper, eq. 7; with Johnson codes also eq. 6 for any `b`).
//!
//! Codes are stored as bytes: a row has the lowest byte of all its codes, then the next byte of all. One load
//! of a byte then covers whole runs of candidates, and codes of any length take only the bytes they need.

use std::ops::Range;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::platform::both;
use crate::base::simd::Level;
use crate::base::value::{LANES, Lanes, Value};
use crate::cost::unrolled::{Unrolled, UnrolledPlane, leading};
use crate::cost::{Cost, CostInput, Lines, PixelBytes, RowPart, fill, line};
use crate::descriptor::spectrum::Word;
use crate::descriptor::{RowOfCodes, describe_rows};
use crate::image::convolution::Kernel;
use crate::image::intensity::Gray;
use crate::image::smoothing;
use crate::pair::blur_compensation::{self, BlurCompensation, Labels};
use crate::pair::candidates::{Candidates, Searched};
use crate::pair::plan::{Demand, Plan};
use crate::settings::Settings;

/// Bytes of a pixel of gray values, with the intermediate images.
const GRAY_BYTES: usize = 16;

/// The phase codes of a pair, by their bytes.
///
/// Under blur compensation with kernels, the right image has several versions, each described and unrolled
/// separately; `labels` choose the version for each left pixel. The left codes already belong to that
/// version.
pub struct Phase {
    left: BytePlanes,
    rights: Vec<BytePlanes>,
    labels: Option<Labels>,
}

/// The phase codes of a pair.
#[derive(Debug, Clone)]
pub struct PhaseCodes<'a> {
    /// The left codes: each row has the lowest byte of all its codes, then the next one of all, and so on.
    pub left: &'a Plane<u8>,
    /// The codes of each version of the right image in the same layout, each row unrolled: [`crate::cost`].
    pub rights: Vec<&'a Plane<u8>>,
    /// The version that each left pixel is compared with; `None`: the first one.
    pub labels: Option<&'a Labels>,
    /// Bytes of a code.
    pub bytes: usize,
}

/// The bytes of codes: each row has the lowest byte of all its codes, then the next one of all, and so on.
struct BytePlanes {
    plane: Plane<u8>,
    /// Codes of a row.
    width: usize,
    /// Bytes of a code.
    count: usize,
}

impl Cost for Phase {
    const STEPS: u16 = 1;

    fn ceiling(settings: &Settings) -> u16 {
        settings.code_length() as u16
    }

    fn reach(Plan { settings, compensation, .. }: Plan) -> usize {
        let smoothed = if compensation.is_some_and(BlurCompensation::smooths) { smoothing::REACH } else { 0 };
        let kernels = compensation.into_iter().flat_map(BlurCompensation::every_kernel);
        let blurred = kernels.map(|kernel| kernel.radii().0).max().unwrap_or(0);

        settings.largest_neighborhood() / 2 + smoothed + blurred
    }

    fn bytes(demand: &Demand) -> PixelBytes {
        let Plan { settings, compensation, .. } = demand.plan;
        let bytes = settings.code_length().div_ceil(8);
        // The right image is described once unchanged, and at most once more for each kernel.
        let versions = 1 + compensation.map_or(0, |all| all.every_kernel().count());
        // For the left image, the codes of one version are kept beside those of another.
        PixelBytes { described: bytes, versions, passing: bytes + GRAY_BYTES }
    }

    fn unrelated(ceiling: u16) -> Option<f64> {
        // Random codes differ in half of their bits; those with a weak level differ in fewer.
        Some(f64::from(ceiling) / 3.0)
    }

    fn new(
        CostInput { views, candidates, settings, compensation, level, control }: CostInput,
    ) -> Result<Self> {
        let (rows, cols) = views[0].size();
        let gray = |side: usize| blur_compensation::gray(views[side], compensation, side, level, control);

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
            // With a single version no lookup is needed.
            let labels = (rights.len() > 1).then_some(labels);
            Ok((rights, labels))
        };

        let (left, rights) = rayon::join(left, rights);
        rights.and_then(|(rights, labels)| Ok(Self { left: left?, rights, labels }))
    }

    #[inline(always)]
    fn write<V: Value, const L: usize>(&self, part: RowPart, out: &mut Lines<V, L>) {
        match self.left.count {
            1 => self.write_distances::<V, 1, L>((0, false), part, out),
            2 => self.write_distances::<V, 2, L>((0, false), part, out),
            // Longer codes: one byte after another.
            bytes => {
                fill(out, V::default());
                for byte in 0..bytes {
                    self.write_distances::<V, 1, L>((byte, true), part.clone(), out);
                }
            }
        }
    }

    fn between(&self, y: usize, x: usize, place: usize) -> u32 {
        let version = self.labels.as_ref().map_or(0, |labels| labels.row(y)[x].into());

        let bits = |byte: usize| {
            let ([left], [right]) = (self.left.rows(byte, y), self.rights[version].rows(byte, y));
            (left[x] ^ right[place]).count_ones()
        };
        (0..self.left.count).map(bits).sum()
    }
}

/// The Hamming distances of given one-byte codes.
pub struct ByteDistances {
    codes: Phase,
    candidates: Candidates,
}

impl ByteDistances {
    /// The distances of the codes of two images.
    pub fn new([left, right]: [&Plane<u8>; 2], candidates: Candidates) -> Result<Self> {
        let bytes = |plane: Plane<u8>| BytePlanes { width: plane.cols(), plane, count: 1 };
        let right = UnrolledPlane::new(right, candidates, |code| code)?.into_plane();
        let codes = Phase { left: bytes(left.clone()), rights: vec![bytes(right)], labels: None };
        Ok(Self { codes, candidates })
    }

    /// The disparities to search.
    pub fn candidates(&self) -> Candidates {
        self.candidates
    }

    /// Runs of [`LANES`] candidates of a pixel, the last one padded.
    pub fn runs(&self) -> usize {
        Searched::all(self.candidates.count()).runs()
    }

    /// Writes the distances of some columns of row `y`, all candidates of one column after another. Values
    /// beyond the last candidate are undefined.
    #[inline(always)]
    pub fn write(&self, y: usize, columns: Range<usize>, out: &mut [Lanes<u8>]) {
        let searched = Searched::all(self.candidates.count());
        let (values, stride) = (out.as_flattened_mut(), self.runs() * LANES);

        for first in (0..stride).step_by(LANES) {
            let block = (y, columns.clone(), searched.part(first, LANES));
            let mut out = Lines::<u8, LANES> { values, first, stride };
            self.codes.write_stretch::<_, 1, _>((0, 0, false), block, &mut out);
        }
    }
}

impl Phase {
    /// The codes of both images.
    pub fn codes(&self) -> PhaseCodes<'_> {
        let rights = self.rights.iter().map(|right| &right.plane).collect();
        let labels = self.labels.as_ref();
        PhaseCodes { left: &self.left.plane, rights, labels, bytes: self.left.count }
    }

    /// Writes the Hamming distances over `N` bytes of the codes, from byte `first` on; `adds`: to the
    /// existing values.
    #[inline(always)]
    fn write_distances<V: Value, const N: usize, const L: usize>(
        &self,
        (first, adds): (usize, bool),
        (y, columns, searched): (usize, Range<usize>, Searched),
        out: &mut Lines<V, L>,
    ) {
        let Some(labels) = &self.labels else {
            let block = (y, columns, searched);
            return self.write_stretch::<V, N, L>((0, first, adds), block, out);
        };

        // Most neighbors have the same label, and are compared with the same version of the right image.
        let mut start = 0;
        for stretch in labels.row(y)[columns.clone()].chunk_by(|label, next| label == next) {
            let version = usize::from(stretch[0]);
            let here = columns.start + start..columns.start + start + stretch.len();
            let (block, mut out) = ((y, here, searched), out.part(start, stretch.len()));
            self.write_stretch::<V, N, L>((version, first, adds), block, &mut out);
            start += stretch.len();
        }
    }

    /// [`Self::write_distances`] for columns that are compared with one version of the right image.
    #[inline(always)]
    fn write_stretch<V: Value, const N: usize, const L: usize>(
        &self,
        (version, first, adds): (usize, usize, bool),
        (y, columns, searched): (usize, Range<usize>, Searched),
        out: &mut Lines<V, L>,
    ) {
        let mut lefts: [&[u8]; N] = self.left.rows(first, y);
        let mut rights: [&[u8]; N] = self.rights[version].rows(first, y);

        // The candidates of the last of these columns come first.
        let start = self.left.width - columns.end + searched.start;
        let width = columns.len() - 1 + L;
        for byte in 0..N {
            lefts[byte] = &lefts[byte][columns.clone()];
            rights[byte] = &rights[byte][start..][..width];
        }

        compare(lefts, rights, adds, out);
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
    /// The layout of unrolled rows of the right image; `None`: rows of the left image, as they are.
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
        let plane = describe_rows(gray, settings, noise, &self, count * self.width, level, control)?;

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

/// Writes the Hamming distances over `N` bytes between pixels and their candidates, or adds them to the
/// existing values.
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
