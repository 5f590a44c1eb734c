//! Pairs that are read and matched a few rows at a time.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use ndarray::{Array3, s};
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::plane::Plane;
use phasestereo_match::image::intensity_range::IntensityRange;
use phasestereo_match::image::view::{Image, View};
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::pair::source::Source;

/// A pair in memory that gives at most so many rows at a time, with a record of what was read.
pub struct Slow {
    pub pair: Pair,
    pub most_rows: usize,
    pub reads: Mutex<Vec<Range<usize>>>,
    /// The read, counted from 0, that fails.
    pub broken: Option<usize>,
}

impl Slow {
    pub fn new(pair: &Pair, most_rows: usize) -> Self {
        Self { pair: pair.clone(), most_rows, reads: Mutex::default(), broken: None }
    }

    /// The rows of every read, in order.
    pub fn asked(&self) -> Vec<Range<usize>> {
        self.reads.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Source for Slow {
    fn size(&self) -> (usize, usize) {
        self.pair.size()
    }

    fn candidates(&self) -> Candidates {
        self.pair.candidates()
    }

    fn most_rows(&self) -> usize {
        self.most_rows
    }

    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Pair>> {
        let mut reads = self.reads.lock().unwrap_or_else(PoisonError::into_inner);
        reads.push(rows.clone());

        if Some(reads.len() - 1) == self.broken {
            return Err(Error::value("read", "a torn tape", "a whole one"));
        }
        Ok(Cow::Owned(part(&self.pair, &rows)))
    }
}

/// Some rows of a pair, without its blur compensation; ranges stay as they are.
pub fn part(pair: &Pair, rows: &Range<usize>) -> Pair {
    let [left, right] = pair.views().map(|view| view_of(view, rows));
    let (candidates, count) = (pair.candidates(), pair.candidates().count());
    Pair::new(left, right, candidates.min() as i64, count as i64).expect("a legal part")
}

/// Some rows of a pair, with these ranges and the blur compensation of the whole.
pub fn known_part(pair: &Pair, rows: &Range<usize>, ranges: [IntensityRange; 2]) -> Pair {
    let compensation = pair
        .blur_compensation()
        .cloned()
        .map(|compensation| compensation.starting_at_row(rows.start));

    part(pair, rows).with_blur_compensation(compensation).with_ranges(ranges.map(Some))
}

fn view_of(view: &View, rows: &Range<usize>) -> View {
    fn cut<T: Clone>(pixels: &Array3<T>, rows: &Range<usize>) -> Array3<T> {
        pixels.slice(s![rows.clone(), .., ..]).to_owned()
    }

    let image = match &view.image {
        Image::U8(pixels) => Image::U8(cut(pixels, rows)),
        Image::U16(pixels) => Image::U16(cut(pixels, rows)),
        Image::F32(pixels) => Image::F32(cut(pixels, rows)),
        Image::F64(pixels) => Image::F64(cut(pixels, rows)),
    };
    let mask = view.mask.as_ref().map(|mask| rows_of(mask, rows));
    View { image, mask, ..*view }
}

/// Some rows of a plane.
pub fn rows_of<T: Copy>(plane: &Plane<T>, rows: &Range<usize>) -> Plane<T> {
    Plane::from_fn(rows.len(), plane.cols(), |y, x| plane.row(rows.start + y)[x])
}
