//! One camera's part of a pair: its gray values, and which of them are valid.

use std::borrow::Cow;
use std::ops::Range;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::simd::Level;
use crate::image::gray_scale::GrayScale;
use crate::image::impulses;
pub use crate::image::masking::Mask;
use crate::image::masking::{fill_masked, filled_along_columns};

/// One camera's part of a pair, in gray.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    gray: Plane<i32>,
    mask: Option<Mask>,
    scale: GrayScale,
}

impl View {
    /// Gray values on this scale; masked pixels take the values of valid neighbors.
    pub fn new(mut gray: Plane<i32>, mask: Option<Mask>, scale: GrayScale) -> Self {
        // A mask that is true everywhere would only cost time.
        let mask = mask.filter(|mask| mask.as_slice().contains(&false));
        if let Some(mask) = &mask {
            fill_masked(&mut gray, mask);
        }

        Self { gray, mask, scale }
    }

    /// The gray values.
    pub fn gray(&self) -> &Plane<i32> {
        &self.gray
    }

    /// The valid pixels; `None`: all.
    pub fn mask(&self) -> Option<&Mask> {
        self.mask.as_ref()
    }

    /// The meaning of the gray values.
    pub fn scale(&self) -> GrayScale {
        self.scale
    }

    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        (self.gray.rows(), self.gray.cols())
    }

    /// Whether the pixel is valid by the mask, if there is one.
    pub fn is_valid(&self, y: usize, x: usize) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask.row(y)[x])
    }

    /// The same gray values with another mask.
    pub fn with_mask(self, mask: Option<Mask>) -> Self {
        Self::new(self.gray, mask, self.scale)
    }

    /// The view turned by 90 degrees counterclockwise. Masked pixels take values of their neighbors along the
    /// new rows.
    pub fn turned(&self) -> Self {
        Self::new(self.gray.turned(), self.mask.as_ref().map(Plane::turned), self.scale)
    }

    /// The negative: white becomes black.
    pub fn inverted(&self) -> Self {
        let mirror = self.scale.mirror();
        let [least, largest] = self.scale.ends();
        let gray = self.gray.map(|value| (mirror - value).clamp(least, largest));
        Self { gray, mask: self.mask.clone(), scale: self.scale.inverted() }
    }

    /// The even rows alone: an odd one becomes the mean of those beside it, the last one a copy of the one
    /// above. A pixel is valid where both are.
    pub fn of_even_rows(&self) -> Self {
        let (rows, cols) = self.size();
        let gray = Plane::from_fn(rows, cols, |y, x| {
            let [above, below] = beside(y, rows).map(|y| self.gray.row(y)[x]);
            // Rounded down.
            (above + below) >> 1
        });
        let mask = self.mask.as_ref().map(|mask| {
            let is_valid = |y: usize, x: usize| beside(y, rows).iter().all(|y| mask.row(*y)[x]);
            Plane::from_fn(rows, cols, is_valid)
        });

        Self::new(gray, mask, self.scale)
    }

    /// Some rows.
    pub fn of_rows(&self, rows: Range<usize>) -> Self {
        Self {
            gray: self.gray.copy_of_rows(rows.clone()),
            mask: self.mask.as_ref().map(|mask| mask.copy_of_rows(rows)),
            scale: self.scale,
        }
    }

    /// The view without impulses of at least this height, in units of the pixels; 0: unchanged.
    pub fn repaired(&self, height: f64, level: Level, control: &Control) -> Result<Cow<'_, Self>> {
        if height <= 0.0 {
            return Ok(Cow::Borrowed(self));
        }

        let height = self.scale.steps(height) as i32;
        let gray = impulses::repaired(&self.gray, height, level, control)?;
        Ok(Cow::Owned(Self { gray, mask: self.mask.clone(), scale: self.scale }))
    }

    /// The gray values, row after row, with masked ones replaced along columns ([`filled_along_columns`]).
    pub fn filled_along_columns(&self, reach: usize) -> Cow<'_, [i32]> {
        let gray = self.gray.as_slice();
        match &self.mask {
            Some(mask) => Cow::Owned(filled_along_columns(gray, 1, mask, reach, self.scale.darkest())),
            None => Cow::Borrowed(gray),
        }
    }
}

/// The even rows that make up row `y` of this many: itself, or those above and below it.
fn beside(y: usize, rows: usize) -> [usize; 2] {
    let below = if y + y % 2 < rows { y + y % 2 } else { y - 1 };
    [y - y % 2, below]
}
