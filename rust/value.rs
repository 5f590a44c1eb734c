//! The integers of costs and path totals: as narrow as the settings allow, for as many lanes at once; and how numbers
//! become integers.

use std::fmt::Debug;

/// Disparities that are worked on together: one AVX2 register of bytes.
pub const LANES: usize = 32;

/// One value for each of [`LANES`] neighboring disparities.
pub type Lanes<T> = [T; LANES];

/// The least of all lanes. To be asked in a small loop of its own: in larger ones the compiler goes lane by lane.
#[inline(always)]
pub fn least_lane<T: Copy + Ord>(values: &Lanes<T>) -> T {
    let mut least = values[0];
    for value in values {
        least = least.min(*value);
    }
    least
}

/// The integer that is nearest, of two the even one, to a number of magnitude below 2^31: a sum with 1.5 times 2^52 has no
/// room for fractions, and its low bits are the integer. So loops need no conversion that the instructions lack.
#[inline(always)]
pub fn nearest(value: f64) -> i32 {
    (value + 1.5 * (1u64 << 52) as f64).to_bits() as i32
}

/// An unsigned integer that holds aggregated costs and the totals of paths.
pub trait Value: Copy + Debug + Default + Ord + Send + Sync + 'static {
    /// The cost of a disparity that is not searched, and the total of one that is out of reach. Together with any
    /// total up to [`Self::LARGEST_TOTAL`] it neither wraps nor wins.
    const FAR: Self;
    /// The largest total of a path that the type is used for.
    const LARGEST_TOTAL: u64;

    /// The low bits of `value`.
    fn truncated(value: u64) -> Self;
    /// The same number.
    fn widened(self) -> u64;
    /// Sum; with [`Self::FAR`] no less than that.
    fn plus(self, other: Self) -> Self;
    /// Difference; wraps.
    fn minus(self, other: Self) -> Self;
    /// Half the sum, rounded up.
    fn mean(self, other: Self) -> Self;
    /// Without its lowest bits.
    fn shifted(self, bits: u32) -> Self;
}

macro_rules! impl_value {
    (
        $type:ty, far: $far:expr, largest_total: $largest:expr, plus: $plus:ident
    ) => {
        impl Value for $type {
            const FAR: Self = $far;
            const LARGEST_TOTAL: u64 = $largest as u64;

            #[inline(always)]
            fn truncated(value: u64) -> Self {
                value as Self
            }

            #[inline(always)]
            fn widened(self) -> u64 {
                self.into()
            }

            #[inline(always)]
            fn plus(self, other: Self) -> Self {
                self.$plus(other)
            }

            #[inline(always)]
            fn minus(self, other: Self) -> Self {
                self.wrapping_sub(other)
            }

            #[inline(always)]
            fn mean(self, other: Self) -> Self {
                // In integers of the same width: the compiler knows this as one instruction.
                (self | other) - ((self ^ other) >> 1)
            }

            #[inline(always)]
            fn shifted(self, bits: u32) -> Self {
                self.wrapping_shr(bits)
            }
        }
    };
}

// Bytes and words have saturating instructions and no room to spare; 32 bits have it the other way.
impl_value!(u8, far: u8::MAX, largest_total: u8::MAX, plus: saturating_add);
impl_value!(u16, far: u16::MAX, largest_total: u16::MAX, plus: saturating_add);
impl_value!(u32, far: 1 << 29, largest_total: (1u32 << 29) - 1, plus: wrapping_add);
