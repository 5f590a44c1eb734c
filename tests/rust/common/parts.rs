//! Pairs that are read and matched a few rows at a time.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use ndarray::{Array3, s};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::conversion::Conversion;
use phasestereo_match::image::pixels::{Image, Input};
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::pair::source::{Source, conversions};

/// A pair in its stored form, and in gray.
#[derive(Debug, Clone)]
pub struct Stored {
    pub inputs: [Input; 2],
    pub pair: Pair,
    conversions: [Conversion; 2],
}

impl Stored {
    pub fn new(inputs: [Input; 2], min: i64, count: i64) -> Self {
        let conversions = Conversion::of_pair(inputs.each_ref());
        let pair = Pair::of_inputs(inputs.clone(), min, count).expect("a legal pair");
        Self { inputs, pair, conversions }
    }

    /// The same with blur compensation, and without the impulses that it names.
    pub fn compensated(mut self, compensation: impl Into<Option<BlurCompensation>>) -> Self {
        self.pair = compensated(self.pair, compensation);
        self
    }

    /// Rows in their stored form.
    fn cut(&self, rows: &Range<usize>) -> [Input; 2] {
        self.inputs.each_ref().map(|input| input_of(input, rows))
    }

    /// Some rows of the pair, with its blur compensation.
    pub fn part(&self, rows: &Range<usize>) -> Pair {
        let part = self.plain_part(rows);
        match self.pair.blur_compensation() {
            Some(known) => compensated(part, known.clone().starting_at_row(rows.start)),
            None => part,
        }
    }

    fn plain_part(&self, rows: &Range<usize>) -> Pair {
        let (candidates, count) = (self.pair.candidates(), self.pair.candidates().count());
        let (min, count) = (candidates.min() as i64, count as i64);
        Pair::converted(self.cut(rows), self.conversions, min, count).expect("a legal part")
    }
}

/// A pair with blur compensation, without the impulses that it names.
pub fn compensated(pair: Pair, compensation: impl Into<Option<BlurCompensation>>) -> Pair {
    let (level, control) = (Level::best(), Control::default());
    pair.with_blur_compensation(compensation.into(), level, &control).expect("memory")
}

/// A pair in memory that returns at most this many rows at a time, with a record of all reads.
pub struct Slow {
    pub stored: Stored,
    pub most_rows: usize,
    pub reads: Mutex<Vec<Range<usize>>>,
    /// The read, counted from 0, that fails.
    pub broken: Option<usize>,
}

impl Slow {
    pub fn new(stored: &Stored, most_rows: usize) -> Self {
        Self { stored: stored.clone(), most_rows, reads: Mutex::default(), broken: None }
    }

    /// The rows of every read, in order.
    pub fn asked(&self) -> Vec<Range<usize>> {
        self.reads.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn record(&self, rows: &Range<usize>) -> Result<()> {
        let mut reads = self.reads.lock().unwrap_or_else(PoisonError::into_inner);
        reads.push(rows.clone());

        if Some(reads.len() - 1) == self.broken {
            return Err(Error::value("read", "a torn tape", "a whole one"));
        }
        Ok(())
    }

    /// How to convert the pair to gray, given the first row.
    pub fn conversions(&self, control: &Control) -> Result<[Conversion; 2]> {
        let first = self.stored.cut(&(0..1));
        let read = |rows: Range<usize>| {
            self.record(&rows)?;
            Ok(self.stored.cut(&rows))
        };
        conversions(first.each_ref(), self, read, control)
    }
}

impl Source for Slow {
    fn size(&self) -> (usize, usize) {
        self.stored.pair.size()
    }

    fn candidates(&self) -> Candidates {
        self.stored.pair.candidates()
    }

    fn most_rows(&self) -> usize {
        self.most_rows
    }

    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Pair>> {
        self.record(&rows)?;
        Ok(Cow::Owned(self.stored.plain_part(&rows)))
    }
}

fn input_of(input: &Input, rows: &Range<usize>) -> Input {
    fn cut<T: Clone>(pixels: &Array3<T>, rows: &Range<usize>) -> Array3<T> {
        pixels.slice(s![rows.clone(), .., ..]).to_owned()
    }

    let image = match &input.image {
        Image::U8(pixels) => Image::U8(cut(pixels, rows)),
        Image::U16(pixels) => Image::U16(cut(pixels, rows)),
        Image::F32(pixels) => Image::F32(cut(pixels, rows)),
        Image::F64(pixels) => Image::F64(cut(pixels, rows)),
    };
    let mask = input.mask.as_ref().map(|mask| rows_of(mask, rows));
    Input { image, mask, unit: input.unit }
}

/// Some rows of a plane.
pub fn rows_of<T: Copy>(plane: &Plane<T>, rows: &Range<usize>) -> Plane<T> {
    Plane::from_fn(rows.len(), plane.cols(), |y, x| plane.row(rows.start + y)[x])
}
