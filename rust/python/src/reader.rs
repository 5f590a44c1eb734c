//! Reads a pair through a Python callable, a few rows at a time, for the duration of one call.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;

use crate::arguments::{Both, Disparities, read_inputs};
use crate::failure::{Failure, Result};
use phasestereo::Error;
use phasestereo_match::image::conversion::{Conversion, Integers};
use phasestereo_match::image::intensity_range::IntensityRange;
use phasestereo_match::image::pixels::Input;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::pair::source::Source;
use phasestereo_match::pair::{Pair, check};

/// A callable `read(first, last)` that returns ((left, right), masks) of these rows, as [`read_inputs`]
/// accepts them.
pub struct Reader {
    read: Py<PyAny>,
    size: (usize, usize),
    candidates: Candidates,
    conversions: [Conversion; 2],
    /// The exception that the callable raised.
    raised: Mutex<Option<Failure>>,
}

/// Black and white of the left and the right image, in thousandths of the pixels' unit.
pub type Ranges = ((f64, f64), (f64, f64));

/// How to convert a pair to gray: the step and the bits of its integers, 0 bits for floats; whether the three
/// channels of the left and the right image are equal.
pub type PackingTuple = (f64, u32, bool, bool);

/// The scale of a whole pair, which its parts use.
#[pyclass(module = "phasestereo._core", frozen, get_all)]
#[derive(Debug, Default)]
pub struct Scale {
    /// How to convert its pixels to gray.
    pub packing: PackingTuple,
    /// Their ranges, unless they are bytes.
    pub ranges: Option<Ranges>,
}

impl Reader {
    /// A reader of a pair of this many rows and columns.
    pub fn new(
        read: Bound<'_, PyAny>,
        size: (usize, usize),
        search: Disparities,
        scale: &Scale,
    ) -> phasestereo::Result<Arc<Self>> {
        let (min, count) = search.unwrap_or((0, 1));
        let candidates = Candidates::new(min, count, size.1)?;

        let conversions = as_conversions(scale.packing, scale.ranges);
        let (read, raised) = (read.unbind(), Mutex::default());
        Ok(Arc::new(Self { read, size, candidates, conversions, raised }))
    }

    /// The exception that the callable raised, if that is why a call failed.
    pub fn reason(&self, failure: Failure) -> Failure {
        let raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner).take();
        raised.unwrap_or(failure)
    }

    fn call(&self, py: Python<'_>, rows: &Range<usize>) -> Result<[Input; 2]> {
        let (images, masks): (Both<'_>, Both<'_>) =
            self.read.bind(py).call1((rows.start, rows.end))?.extract()?;

        let inputs = read_inputs(&images, &masks)?;
        check(inputs.each_ref())?;
        Ok(inputs)
    }

    /// Rows of both images in the form they are read.
    pub fn inputs(&self, rows: Range<usize>) -> phasestereo::Result<[Input; 2]> {
        // The core does not know Python exceptions: the reader keeps it, and the call fails as if cancelled.
        let inputs = Python::attach(|py| self.call(py, &rows)).map_err(|raised| {
            *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(raised);
            Error::Cancelled
        })?;

        let size = inputs[0].size();
        if size == (rows.len(), self.size.1) {
            return Ok(inputs);
        }

        let accepts = format!("{} x {} for rows {rows:?}", rows.len(), self.size.1);
        Err(Error::value("read", format!("{size:?} pixels"), accepts))
    }
}

impl Source for Reader {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn candidates(&self) -> Candidates {
        self.candidates
    }

    fn rows(&self, rows: Range<usize>) -> phasestereo::Result<Cow<'_, Pair>> {
        let pair = Pair::converted(self.inputs(rows)?, self.conversions, 0, 1)?;
        Ok(Cow::Owned(pair.searched(self.candidates)))
    }
}

/// How to convert both images, for the core.
pub fn as_conversions((step, bits, left, right): PackingTuple, ranges: Option<Ranges>) -> [Conversion; 2] {
    let integers = (bits > 0).then_some(Integers { step, bits });
    let range = |(black, white)| IntensityRange { black, white };
    let of_left = ranges.map(|(left, _)| range(left));
    let of_right = ranges.map(|(_, right)| range(right));

    [(left, of_left), (right, of_right)].map(|(is_gray, range)| Conversion { integers, is_gray, range })
}

impl From<[Conversion; 2]> for Scale {
    /// The same for Python.
    fn from([left, right]: [Conversion; 2]) -> Self {
        let (step, bits) = left.integers.map_or((1.0, 0), |found| (found.step, found.bits));
        let ranges = left.range.zip(right.range);
        Self {
            packing: (step, bits, left.is_gray, right.is_gray),
            ranges: ranges.map(|(left, right)| ((left.black, left.white), (right.black, right.white))),
        }
    }
}
