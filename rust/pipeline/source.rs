//! Pairs that are read a few rows at a time, since they do not fit into memory: what has to be known of the whole
//! before a part can be matched is gathered from the top down.

use std::ops::Range;

use crate::cost::candidates::Candidates;
use crate::error::Result;
use crate::image::impulses;
use crate::image::intensity::{self, Gray, NOWHERE, RangeSample, full_range};
use crate::image::masking;
use crate::image::texture::Roughness;
use crate::image::view::Mask;
use crate::pipeline::control::Control;
use crate::pipeline::matcher::Pair;
use crate::simd::Level;

/// Pixels of one image that are asked for at a time, unless one row has more.
const MOST_PIXELS: usize = 1 << 22;

/// Where the rows of a pair come from.
pub trait Source: Sync {
    /// Rows and columns.
    fn size(&self) -> (usize, usize);

    /// The disparities to search.
    fn candidates(&self) -> Candidates;

    /// How many rows to ask for at a time.
    fn most_rows(&self) -> usize {
        (MOST_PIXELS / self.size().1).max(1)
    }

    /// These rows of both images; of floats the views tell where the pixels of the whole images lie, once that is known.
    fn rows(&self, rows: Range<usize>) -> Result<Pair>;
}

/// All rows, as many at a time as are to be asked for.
pub fn bands(source: &dyn Source) -> impl Iterator<Item = Range<usize>> {
    let (band, rows) = (source.most_rows(), source.size().0);
    (0..rows).step_by(band).map(move |first| first..(first + band).min(rows))
}

/// Rows and so many more on either side, as far as there are any.
pub fn widened(rows: &Range<usize>, by: usize, height: usize) -> Range<usize> {
    rows.start.saturating_sub(by)..(rows.end + by).min(height)
}

/// Where the pixels of both images lie; of images of floats.
pub fn ranges(source: &dyn Source, control: &Control) -> Result<[intensity::IntensityRange; 2]> {
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
    let mut all = [None, None];
    for rows in bands(source) {
        let pair = source.rows(rows)?;
        for (view, range) in pair.views().into_iter().zip(&mut all) {
            let here = full_range(view, control)?;
            *range = here.into_iter().chain(*range).reduce(intensity::IntensityRange::union);
        }
    }
    let [all_left, all_right] = all.map(|range| range.unwrap_or(NOWHERE));
    Ok([left.unwrap_or(all_left), right.unwrap_or(all_right)])
}

/// The roughness of the left image, whose impulses are of this height at least; 0: it has none.
pub fn roughness(
    source: &dyn Source,
    impulses: f64,
    level: Level,
    control: &Control,
) -> Result<Roughness> {
    let (height, cols) = source.size();
    let mut found = Roughness::default();
    for rows in bands(source) {
        // Whether a pixel is an impulse depends on those beside it.
        let beside = if impulses > 0.0 { impulses::REACH } else { 0 };
        let mut read = widened(&rows, beside, height);
        let mut pair = source.rows(read.clone())?.with_impulses([impulses, 0.0]);
        if pair.views()[0].mask.as_ref().is_some_and(has_empty_row) {
            // Such rows copy others, which may lie beyond.
            read = widened(&read, masking::REACH, height);
            pair = source.rows(read.clone())?.with_impulses([impulses, 0.0]);
        }
        let gray = Gray::new(pair.views()[0], level, control)?.plane(level, control)?;
        let places = (rows.start - read.start) * cols..(rows.end - read.start) * cols;
        found = found.and(Roughness::of_rows(&gray.as_slice()[places], cols));
    }
    Ok(found)
}

/// Whether no pixel of some row is valid.
pub fn has_empty_row(mask: &Mask) -> bool {
    (0..mask.rows()).any(|y| !mask.row(y).contains(&true))
}
