//! What else is wrong with images, beside blur and noise, and is decided once for the whole of a pair: whether there are
//! impulses ([`crate::image::impulses`]), and how much compression has left of its blocks ([`crate::image::blocking`]).

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;

use super::parts::Means;
use crate::cost::candidates::Candidates;
use crate::error::Result;
use crate::image::blocking::{self, Extra};
use crate::image::impulses::{self, HEIGHT, count_doubtless, has_impulses};
use crate::image::intensity::{Gray, float_range};
use crate::image::masking;
use crate::image::view::{Image, View};
use crate::pipeline::matcher::Pair;
use crate::pipeline::source::{Source, bands, has_empty_row, widened};

/// The noise, in gray levels, that does as much harm as what compression has lost where blocks stand out by one. Means of
/// bad-1.0 (%) over 12 scenes, JPEG of quality 90, 70 and 30 in both images, of 70 and 30 in the right one: without: 8.8,
/// 14.1, 25.7; 6: 8.39, 12.56, 22.2, 9.97, 16.1; 9: 8.35, 12.53, 21.9, 10.43, 16.7.
const HARM: f64 = 6.0;
/// Rows that one task looks at.
const ROWS: usize = 64;
/// Rows above and below one that count.
const REACH: usize =
    if impulses::REACH > blocking::REACH { impulses::REACH } else { blocking::REACH };

/// What is wrong with the left and the right image, in units of their pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Defects {
    /// The least height of their impulses; 0: there are none.
    pub impulses: [f64; 2],
    /// Standard deviations of a noise that would do as much harm as what compression has lost.
    pub coding: [f64; 2],
}

/// A pair that is read by rows, whose impulses are known.
pub struct Repaired<'a> {
    /// The pair as it is.
    pub source: &'a dyn Source,
    /// The least height of its impulses, left and right.
    pub impulses: [f64; 2],
}

impl Source for Repaired<'_> {
    fn size(&self) -> (usize, usize) {
        self.source.size()
    }

    fn candidates(&self) -> Candidates {
        self.source.candidates()
    }

    fn most_rows(&self) -> usize {
        self.source.most_rows()
    }

    fn rows(&self, rows: Range<usize>) -> Result<Pair> {
        Ok(self.source.rows(rows)?.with_impulses(self.impulses))
    }
}

/// What is counted of one image.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    doubtless: u64,
    extra: Extra,
    /// Steps of the gray values to the unit of the pixels.
    steps: f64,
}

impl Defects {
    /// Those of a pair in memory.
    pub fn of_pair(pair: &Pair, means: Means) -> Result<Self> {
        let levels = gray_levels(pair, largest(pair), means)?;
        let height = pair.size().0;
        let left = counts(pair, 0, 0..height, (0, height), levels[0], means)?;
        let right = counts(pair, 1, 0..height, (0, height), levels[1], means)?;
        Ok(Self::told(&[left, right], levels, pair.size()))
    }

    /// The same of one that is read by rows.
    pub fn of_source(source: &dyn Source, means: Means) -> Result<Self> {
        let (height, cols) = source.size();
        let sample = source.rows(0..1)?;
        let mut brightest = 0;
        if matches!(sample.views()[0].image, Image::U16(_)) {
            for rows in bands(source) {
                brightest = largest(&source.rows(rows)?).max(brightest);
            }
        }
        let levels = gray_levels(&sample, brightest, means)?;
        let mut found = [Counts::default(); 2];
        for rows in bands(source) {
            let mut read = widened(&rows, REACH, height);
            let mut pair = source.rows(read.clone())?;
            if pair.views().iter().any(|view| view.mask.as_ref().is_some_and(has_empty_row)) {
                // Such rows copy others, which may lie beyond.
                read = widened(&read, masking::REACH, height);
                pair = source.rows(read.clone())?;
            }
            let here = rows.start - read.start..rows.end - read.start;
            for (side, found) in found.iter_mut().enumerate() {
                let place = (read.start, height);
                *found = found.and(counts(&pair, side, here.clone(), place, levels[side], means)?);
            }
        }
        Ok(Self::told(&found, levels, (height, cols)))
    }

    /// The pair with what is known of its impulses.
    pub fn repaired<'a>(&self, pair: &'a Pair) -> Cow<'a, Pair> {
        if self.impulses.iter().all(|height| *height <= 0.0) {
            return Cow::Borrowed(pair);
        }
        Cow::Owned(pair.clone().with_impulses(self.impulses))
    }

    fn told(found: &[Counts; 2], levels: [f64; 2], (rows, cols): (usize, usize)) -> Self {
        let mut told = Self { impulses: [0.0; 2], coding: [0.0; 2] };
        for (side, Counts { doubtless, extra, steps }) in found.iter().enumerate() {
            if has_impulses(*doubtless, rows * cols) {
                told.impulses[side] = HEIGHT * levels[side];
            }
            told.coding[side] = HARM * extra.jump() / steps;
        }
        told
    }
}

impl Counts {
    fn and(self, other: Self) -> Self {
        Self {
            doubtless: self.doubtless + other.doubtless,
            extra: self.extra.and(other.extra),
            steps: other.steps,
        }
    }
}

/// What is counted of some rows of an image of a pair that begins with row `first` of one of `height` rows.
fn counts(
    pair: &Pair,
    side: usize,
    rows: Range<usize>,
    (first, height): (usize, usize),
    gray_level: f64,
    Means { how, control, .. }: Means,
) -> Result<Counts> {
    let gray = Gray::new(pair.views()[side], how.level, control)?;
    let (plane, level) = (gray.plane(how.level, control)?, gray.steps(gray_level));
    let of_rows = |start: usize| -> Result<Counts> {
        control.checkpoint()?;
        let rows = start..(start + ROWS).min(rows.end);
        Ok(Counts {
            doubtless: count_doubtless(&plane, rows.clone(), level, how.level)?,
            extra: Extra::of_rows(&plane, rows, (first, height), level, how.level)?,
            steps: gray.steps(1.0),
        })
    };
    let starts: Vec<usize> = rows.clone().step_by(ROWS).collect();
    let found = starts.into_par_iter().map(of_rows);
    found.try_reduce(Counts::default, |a, b| Ok(a.and(b)))
}

/// The largest valid pixel of either image, of 16 bits; 0 of others.
fn largest(pair: &Pair) -> u16 {
    let of_view = |view: &View| match (&view.image, &view.mask) {
        (Image::U16(pixels), None) => pixels.iter().copied().max(),
        (Image::U16(pixels), Some(_)) => {
            let valid = pixels.indexed_iter().filter(|((y, x, _), _)| view.is_valid(*y, *x));
            valid.map(|(_, pixel)| *pixel).max()
        }
        _ => None,
    };
    let [left, right] = pair.views().map(of_view);
    left.max(right).unwrap_or(0)
}

/// A gray level of either image, in units of the pixels, of which there are 256 from black to white; of 16 bits, of which
/// few cameras use all, as many count as are used.
fn gray_levels(pair: &Pair, largest: u16, means: Means) -> Result<[f64; 2]> {
    let bits = (u16::BITS - largest.leading_zeros()).max(u8::BITS);
    let level = |view: &View| match &view.image {
        Image::U8(_) => Ok(1.0),
        Image::U16(_) => Ok(f64::from(1u32 << (bits - u8::BITS))),
        // In thousandths.
        Image::F32(_) | Image::F64(_) => Ok(float_range(view, means.control)?.width() / 256e3),
    };
    let [left, right] = pair.views();
    Ok([level(left)?, level(right)?])
}
