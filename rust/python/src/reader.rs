//! Reading of a pair through a Python callable, a few rows at a time, for the duration of one call.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;

use crate::arguments::{Both, Disparities, read_images};
use crate::failure::{Failure, Result};
use phasestereo::Error;
use phasestereo_match::image::intensity_range::IntensityRange;
use phasestereo_match::image::packing::{Integers, Packing};
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::pair::source::Source;

/// A callable `read(first, last)` that returns ((left, right), masks) of these rows, as [`read_images`] takes them.
pub struct Reader {
    read: Py<PyAny>,
    size: (usize, usize),
    search: Disparities,
    candidates: Candidates,
    /// How pixels are packed; `None`: they stay as they are read.
    packing: Option<Packing>,
    ranges: [Option<IntensityRange>; 2],
    /// The exception that the callable raised.
    raised: Mutex<Option<Failure>>,
}

/// Black and white of the left and of the right image, in thousandths of their unit.
pub type Ranges = ((f64, f64), (f64, f64));

/// How a pair is packed: the step and the bits of its integers, 0 bits for pixels that keep their type; whether the
/// channels of the left and of the right image are equal.
pub type PackingTuple = (f64, u32, bool, bool);

/// The scale of a whole pair that its parts take.
#[pyclass(module = "phasestereo._core", frozen, get_all)]
#[derive(Debug)]
pub struct Scale {
    /// How its pixels are packed.
    pub packing: PackingTuple,
    /// Where they lie, if the match needs it.
    pub ranges: Option<Ranges>,
}

impl Reader {
    /// A reader of a pair of so many rows and columns.
    pub fn new(
        read: Bound<'_, PyAny>,
        size: (usize, usize),
        search: Disparities,
        scale: Option<&Scale>,
    ) -> phasestereo::Result<Arc<Self>> {
        let (min, count) = search.unwrap_or((0, 1));
        let candidates = Candidates::new(min, count, size.1)?;

        let packing = scale.map(|scale| as_packing(scale.packing));
        let ranges = as_ranges(scale.and_then(|scale| scale.ranges));
        let (read, raised) = (read.unbind(), Mutex::default());
        Ok(Arc::new(Self { read, size, search, candidates, packing, ranges, raised }))
    }

    /// The exception that the callable raised, if that is why a call failed.
    pub fn reason(&self, failure: Failure) -> Failure {
        let raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner).take();
        raised.unwrap_or(failure)
    }

    fn call(&self, py: Python<'_>, rows: &Range<usize>) -> Result<Pair> {
        let (images, masks): (Both<'_>, Both<'_>) =
            self.read.bind(py).call1((rows.start, rows.end))?.extract()?;

        let pair = read_images(&images, &masks, self.search)?;
        let pair = match &self.packing {
            Some(packing) => pair.packed(packing),
            None => pair,
        };
        Ok(pair.with_ranges(self.ranges))
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
        // The core knows no Python exceptions: the reader keeps it, and the call fails as if cancelled.
        let pair = Python::attach(|py| self.call(py, &rows)).map_err(|raised| {
            *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(raised);
            Error::Cancelled
        })?;

        if pair.size() == (rows.len(), self.size.1) {
            return Ok(Cow::Owned(pair));
        }

        let accepts = format!("{} x {} for rows {rows:?}", rows.len(), self.size.1);
        Err(Error::value("read", format!("{:?} pixels", pair.size()), accepts))
    }
}

/// How a pair is packed, for the core.
pub fn as_packing((step, bits, left, right): PackingTuple) -> Packing {
    let integers = (bits > 0).then_some(Integers { step, are_bytes: bits <= u8::BITS });
    Packing { integers, is_gray: [left, right] }
}

/// The same for Python.
pub fn packing_to_py(Packing { integers, is_gray: [left, right] }: Packing) -> PackingTuple {
    let bits = |are_bytes| if are_bytes { u8::BITS } else { u16::BITS };
    let (step, bits) = integers.map_or((1.0, 0), |found| (found.step, bits(found.are_bytes)));
    (step, bits, left, right)
}

/// The ranges of both images for the core.
pub fn as_ranges(ranges: Option<Ranges>) -> [Option<IntensityRange>; 2] {
    let range = |(black, white)| Some(IntensityRange { black, white });
    ranges.map_or([None; 2], |(left, right)| [range(left), range(right)])
}
