//! Pairs that are read a few rows at a time since they do not fit into memory: statistics of the whole pair that the
//! match of each part needs are gathered in a pass from top to bottom.

use std::borrow::Cow;
use std::ops::Range;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::simd::Level;
use crate::image::impulses;
use crate::image::intensity::{Gray, RangeSample, full_range};
use crate::image::intensity_range::{IntensityRange, NOWHERE};
use crate::image::masking;
use crate::image::packing::{Packing, Scan};
use crate::image::texture::Roughness;
use crate::image::view::Mask;
use crate::pair::Pair;
use crate::pair::candidates::Candidates;

/// Pixels of one image that are read at a time, unless one row has more.
const MOST_PIXELS: usize = 1 << 22;

/// Gives the rows of a pair, from wherever they are stored.
pub trait Source: Sync {
    /// Rows and columns.
    fn size(&self) -> (usize, usize);

    /// The disparities to search.
    fn candidates(&self) -> Candidates;

    /// How many rows to read at a time.
    fn most_rows(&self) -> usize {
        (MOST_PIXELS / self.size().1).max(1)
    }

    /// Reads rows of both images. Once they are known, pixels are packed as those of the whole pair, and views carry the
    /// range of the whole image.
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

/// Rows and up to `by` more on either side, as far as the image has them.
pub fn widened(rows: &Range<usize>, by: usize, height: usize) -> Range<usize> {
    rows.start.saturating_sub(by)..(rows.end + by).min(height)
}

/// How a whole pair is packed whose rows come as they are stored; `first` are some of them.
pub fn packing(first: &Pair, source: &dyn Source, control: &Control) -> Result<Packing> {
    let mut scan = Scan::new(first.views());
    // Usually one row says enough, or a few.
    scan.add(first.views(), control)?;

    for rows in bands(source) {
        if scan.is_decided() {
            break;
        }
        scan.add(source.rows(rows)?.views(), control)?;
    }

    Ok(scan.packing())
}

/// The ranges of the pixels of both images, which are not bytes.
pub fn ranges(source: &dyn Source, control: &Control) -> Result<[IntensityRange; 2]> {
    // Usually a sample of the pixels says enough.
    let mut samples = [RangeSample::new(source.size()), RangeSample::new(source.size())];
    for rows in bands(source) {
        let pair = source.rows(rows.clone())?;
        for (view, sample) in pair.views().into_iter().zip(&mut samples) {
            sample.add(view, rows.start, control)?;
        }
    }

    let [left, right] = samples.map(RangeSample::range);
    if let (Some(left), Some(right)) = (left, right) {
        return Ok([left, right]);
    }

    // Otherwise all pixels are read again for their full range.
    let mut all = [None, None];
    for rows in bands(source) {
        let pair = source.rows(rows)?;
        for (view, range) in pair.views().into_iter().zip(&mut all) {
            let here = full_range(view, control)?;
            *range = here.into_iter().chain(*range).reduce(IntensityRange::union);
        }
    }

    let [all_left, all_right] = all.map(|range| range.unwrap_or(NOWHERE));
    Ok([left.unwrap_or(all_left), right.unwrap_or(all_right)])
}

/// The roughness of the left image, whose impulses stand out by at least `impulses`; 0: it has none.
pub fn roughness(
    source: &dyn Source,
    impulses: f64,
    level: Level,
    control: &Control,
) -> Result<Roughness> {
    let (height, cols) = source.size();
    let mut roughness = Roughness::default();

    for rows in bands(source) {
        // Whether a pixel is an impulse depends on its neighbors.
        let beside = if impulses > 0.0 { impulses::REACH } else { 0 };
        let mut read = widened(&rows, beside, height);
        let mut pair = source.rows(read.clone())?.into_owned().with_impulses([impulses, 0.0]);

        if pair.views()[0].mask.as_ref().is_some_and(has_empty_row) {
            // Rows without a valid pixel copy the nearest ones that have some, which may not have been read.
            read = widened(&read, masking::REACH, height);
            pair = source.rows(read.clone())?.into_owned().with_impulses([impulses, 0.0]);
        }

        let gray = Gray::new(pair.views()[0], level, control)?.plane(level, control)?;
        // Only the wanted rows count; the others have been read for them.
        let places = (rows.start - read.start) * cols..(rows.end - read.start) * cols;
        roughness = roughness.and(Roughness::of_rows(&gray.as_slice()[places], cols));
    }

    Ok(roughness)
}

/// Whether some row has no valid pixel.
pub fn has_empty_row(mask: &Mask) -> bool {
    (0..mask.rows()).any(|y| !mask.row(y).contains(&true))
}
