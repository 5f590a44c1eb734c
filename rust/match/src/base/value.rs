//! The integers of costs and path totals: as narrow as the settings allow, so that a register has as many
//! lanes as possible. Also the rounding of floats to integers.

use std::fmt::Debug;

use crate::base::simd::least_bytes;

/// Disparities that are processed together: one AVX2 register of bytes.
pub const LANES: usize = 32;

/// Rows of lanes whose minima are found together.
pub const ROWS: usize = 16;

/// One value for each of [`LANES`] neighboring disparities.
pub type Lanes<T> = [T; LANES];

/// The lanes of some pixels, starting at a cache line: no register of them spans two lines.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct LaneRows<T>(pub [Lanes<T>; ROWS]);

/// The minimum of all lanes. Call it in a small loop of its own: in larger loops it is compiled lane by lane.
#[inline(always)]
pub fn least_lane<T: Copy + Ord>(values: &Lanes<T>) -> T {
    let mut least = values[0];
    for value in values {
        least = least.min(*value);
    }
    least
}

/// The minimum of each row of lanes.
#[inline(always)]
fn least_lanes<T: Value>(rows: &[Lanes<T>; ROWS]) -> [T; ROWS] {
    let mut least = [T::default(); ROWS];
    for (least, row) in least.iter_mut().zip(rows) {
        *least = least_lane(row);
    }
    least
}

/// The nearest integer (ties: even) to a number of magnitude below 2^31.
///
/// The sum with 1.5 times 2^52 has no fraction bits, so it is rounded, and its low bits are the integer. Not
/// all instruction sets can convert vectors directly.
#[inline(always)]
pub fn nearest(value: f64) -> i32 {
    (value + 1.5 * (1u64 << 52) as f64).to_bits() as i32
}

/// An unsigned integer that holds aggregated costs and the totals of paths.
pub trait Value: Copy + Debug + Default + Ord + Send + Sync + 'static {
    /// The cost and the total of a disparity that is not searched. Added to any total up to
    /// [`Self::LARGEST_TOTAL`], it neither wraps nor wins.
    const FAR: Self;
    /// The largest total of a path that the type is used for.
    const LARGEST_TOTAL: u64;
    /// Whether only large windows in full precision need the type: loops over it are compiled for fewer
    /// cases.
    const IS_RARE: bool = size_of::<Self>() >= size_of::<u32>();

    /// The low bits of `value`.
    fn truncated(value: u64) -> Self;
    /// The same number.
    fn widened(self) -> u64;
    /// Sum; with [`Self::FAR`] at least that.
    fn plus(self, other: Self) -> Self;
    /// Difference; wraps.
    fn minus(self, other: Self) -> Self;
    /// Half the sum, rounded up.
    fn mean(self, other: Self) -> Self;
    /// Shifted right, dropping the lowest bits.
    fn shifted(self, bits: u32) -> Self;
    /// The minimum of each row.
    fn least_lanes(rows: &LaneRows<Self>) -> [Self; ROWS];
}

macro_rules! impl_value {
    (
        $type:ty, far: $far:expr, largest_total: $largest:expr, plus: $plus:ident,
        least_lanes: $least_lanes:path
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
                // In integers of the same width, without overflow; compiled to a single instruction where one
                // exists.
                (self | other) - ((self ^ other) >> 1)
            }

            #[inline(always)]
            fn shifted(self, bits: u32) -> Self {
                self.wrapping_shr(bits)
            }

            #[inline(always)]
            fn least_lanes(rows: &LaneRows<Self>) -> [Self; ROWS] {
                $least_lanes(&rows.0)
            }
        }
    };
}

// Bytes and words have saturating instructions, so their whole range is used. 32 bits have none, but range to
// spare.
impl_value!(
    u8, far: u8::MAX, largest_total: u8::MAX, plus: saturating_add,
    least_lanes: least_bytes
);
impl_value!(
    u16, far: u16::MAX, largest_total: u16::MAX, plus: saturating_add,
    least_lanes: least_lanes
);
impl_value!(
    u32, far: 1 << 29, largest_total: (1u32 << 29) - 1, plus: wrapping_add,
    least_lanes: least_lanes
);
