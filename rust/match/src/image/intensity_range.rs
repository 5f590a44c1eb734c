//! Black and white of an image.

/// Black and white, in thousandths of the pixels' unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IntensityRange {
    /// Black.
    pub black: f64,
    /// White.
    pub white: f64,
}

impl IntensityRange {
    /// A range around zero that contains magnitudes up to `most`. Its ends are powers of two, so its steps
    /// are, too.
    pub fn about_zero(most: f64) -> Self {
        let white = 2f64.powi(floor_log2(most) + 1);
        Self { black: -white, white }
    }

    /// White minus black.
    pub fn width(self) -> f64 {
        self.white - self.black
    }

    /// The smallest range that contains both.
    pub fn union(self, other: Self) -> Self {
        Self { black: self.black.min(other.black), white: self.white.max(other.white) }
    }
}

/// The range of an image without a valid pixel.
pub const NOWHERE: IntensityRange = IntensityRange { black: 0.0, white: 0.0 };

/// The exponent of the leading bit; 0 for zero, so that a constant image has a valid scale.
pub fn floor_log2(value: f64) -> i32 {
    if value == 0.0 { 0 } else { ((value.to_bits() >> 52) & 0x7ff) as i32 - 1023 }
}
