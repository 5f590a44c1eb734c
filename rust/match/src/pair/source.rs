//! Pairs that do not fit into memory and are read a few rows at a time: one pass from top to bottom gathers
//! the statistics of the whole pair that the match of each part needs.

use std::borrow::Cow;
use std::ops::Range;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::widened;
use crate::base::simd::Level;
use crate::image::conversion::{Conversion, Extent, Scan};
use crate::image::impulses;
use crate::image::masking;
use crate::image::pixels::Input;
use crate::image::texture::Roughness;
use crate::image::view::Mask;
use crate::pair::Pair;
use crate::pair::candidates::Candidates;

/// Pixels of one image that are read at a time, unless one row has more.
const MOST_PIXELS: usize = 1 << 22;

/// Provides the rows of a pair, from wherever they are stored.
pub trait Source: Sync {
    /// Rows and columns.
    fn size(&self) -> (usize, usize);

    /// The disparities to search.
    fn candidates(&self) -> Candidates;

    /// How many rows to read at a time.
    fn most_rows(&self) -> usize {
        (MOST_PIXELS / self.size().1).max(1)
    }

    /// Reads rows of both images, converted like the whole pair.
    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Pair>>;
}

/// A pair in memory is read at once.
impl Source for Pair {
    fn size(&self) -> (usize, usize) {
        self.size()
    }

    fn candidates(&self) -> Candidates {
        self.candidates()
    }

    fn most_rows(&self) -> usize {
        self.size().0
    }

    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Pair>> {
        let is_whole = rows == (0..self.size().0);
        Ok(if is_whole { Cow::Borrowed(self) } else { Cow::Owned(self.of_rows(rows)) })
    }
}

/// Ranges of rows to read, one after another, that cover the image.
pub fn bands(source: &dyn Source) -> impl Iterator<Item = Range<usize>> {
    let (band, rows) = (source.most_rows(), source.size().0);
    (0..rows).step_by(band).map(move |first| first..(first + band).min(rows))
}

/// How to convert a whole pair that is read by rows; `first` are some of them, `read` returns others as they
/// are stored.
pub fn conversions(
    first: [&Input; 2],
    source: &dyn Source,
    read: impl Fn(Range<usize>) -> Result<[Input; 2]>,
    control: &Control,
) -> Result<[Conversion; 2]> {
    let mut scan = Scan::new(first);
    // Usually one row, or a few, are enough.
    scan.add(first);

    for rows in bands(source) {
        if scan.is_decided() {
            break;
        }
        control.checkpoint()?;
        scan.add(read(rows)?.each_ref());
    }

    let mut extents = [Extent::new(source.size()), Extent::new(source.size())];
    if !scan.are_bytes() {
        for rows in bands(source) {
            control.checkpoint()?;
            for (input, extent) in read(rows.clone())?.iter().zip(&mut extents) {
                extent.add(input, rows.start);
            }
        }
    }

    Ok(scan.conversions(extents))
}

/// The roughness of the left image, whose impulses have at least the height `impulses`; 0: none.
pub fn roughness(source: &dyn Source, impulses: f64, level: Level, control: &Control) -> Result<Roughness> {
    let (height, cols) = source.size();
    let mut roughness = Roughness::default();

    for rows in bands(source) {
        control.checkpoint()?;
        // Whether a pixel is an impulse depends on its neighbors.
        let beside = if impulses > 0.0 { impulses::REACH } else { 0 };
        let mut read = widened(&rows, beside, height);
        let mut pair = source.rows(read.clone())?;

        if pair.views()[0].mask().is_some_and(has_empty_row) {
            // Rows without a valid pixel copy the nearest ones that have some, which may not have been read.
            read = widened(&read, masking::REACH, height);
            pair = source.rows(read.clone())?;
        }

        let left = pair.views()[0].repaired(impulses, level, control)?;
        // Only the wanted rows count; the others have been read for them.
        let places = (rows.start - read.start) * cols..(rows.end - read.start) * cols;
        roughness = roughness.and(Roughness::of_rows(&left.gray().as_slice()[places], cols));
    }

    Ok(roughness)
}

/// Whether some row has no valid pixel.
pub fn has_empty_row(mask: &Mask) -> bool {
    (0..mask.rows()).any(|y| !mask.row(y).contains(&true))
}
