//! Absolute differences of gray levels: the baseline of the paper's section 3.

use crate::base::error::Result;
use crate::base::value::Value;
use crate::cost::differences::Differences;
use crate::cost::{Cost, CostInput, Lines, PixelBytes, RowPart};
use crate::image::intensity::{LEVEL_CEILING, LEVEL_STEPS, level_planes};
use crate::pair::plan::{Demand, Plan};
use crate::settings::Settings;

/// The gray levels of a pair.
pub struct Sad(Differences);

impl Cost for Sad {
    const STEPS: u16 = LEVEL_STEPS;

    fn ceiling(_: &Settings) -> u16 {
        LEVEL_CEILING
    }

    fn reach(_: Plan) -> usize {
        0
    }

    fn bytes(_: &Demand) -> PixelBytes {
        PixelBytes { described: 2, versions: 1, passing: 4 }
    }

    fn new(input: CostInput) -> Result<Self> {
        let levels = level_planes(input.views, input.settings.intensity_range, input.control)?;
        Ok(Self(Differences::new(levels, input.candidates)?))
    }

    #[inline(always)]
    fn write<V: Value, const L: usize>(&self, part: RowPart, out: &mut Lines<V, L>) {
        self.0.write(part, out);
    }

    fn between(&self, y: usize, x: usize, place: usize) -> u32 {
        self.0.between(y, x, place)
    }
}
