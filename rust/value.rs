//! The integers that strips are made of: as narrow as the settings allow, for as many lanes at once.

use std::fmt::Debug;

/// An unsigned integer of a cost or of a path's total.
///
/// Arithmetic wraps where the bounds are known not to be reached, except for [`Self::plus_penalty`].
pub trait Value: Copy + Debug + Default + Ord + Send + Sync + 'static {
    /// Bits of the type: so many yes-or-no answers fit into one.
    const BITS: usize;
    /// More than any total; adding a penalty to it gives no less than itself.
    const FAR: Self;
    /// The largest total that stays clear of [`Self::FAR`].
    const LARGEST_TOTAL: u64;
    /// What holds the sum of sixteen of them.
    type Wide: Value;

    /// The low bits of `value`.
    fn truncated(value: u64) -> Self;
    /// The same number.
    fn widened(self) -> u64;
    /// Sum.
    fn plus(self, other: Self) -> Self;
    /// Difference.
    fn minus(self, other: Self) -> Self;
    /// Sum, where one of the two may be [`Self::FAR`].
    fn plus_penalty(self, penalty: Self) -> Self;
    /// Half the sum, rounded up.
    fn mean(self, other: Self) -> Self;
    /// Without its lowest bits.
    fn shifted(self, bits: u32) -> Self;
    /// Writes the values one after another, as bytes.
    fn write(values: &[Self], bytes: &mut Vec<u8>);
    /// This answer after those that `self` holds: the last one is the lowest bit.
    fn then(self, answer: bool) -> Self;
}

/// Takes values from bytes, so many for each, as they were written: by whichever type, if its values fit this one.
pub fn read<T: Value>(values: &mut [T], width: usize, bytes: &[u8]) {
    for (value, bytes) in values.iter_mut().zip(bytes.chunks_exact(width)) {
        let digits = bytes.iter().rev();
        *value = T::truncated(digits.fold(0, |number, digit| number << 8 | u64::from(*digit)));
    }
}

macro_rules! impl_value {
    (
        $type:ty, $wide:ty, far: $far:expr, largest_total: $largest:expr, plus_penalty: $plus_penalty:ident
    ) => {
        impl Value for $type {
            const BITS: usize = <$type>::BITS as usize;
            const FAR: Self = $far;
            const LARGEST_TOTAL: u64 = $largest as u64;
            type Wide = $wide;

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
                self.wrapping_add(other)
            }

            #[inline(always)]
            fn minus(self, other: Self) -> Self {
                self.wrapping_sub(other)
            }

            #[inline(always)]
            fn plus_penalty(self, penalty: Self) -> Self {
                self.$plus_penalty(penalty)
            }

            #[inline(always)]
            fn mean(self, other: Self) -> Self {
                (<$wide>::from(self) + <$wide>::from(other) + 1 >> 1) as Self
            }

            #[inline(always)]
            fn shifted(self, bits: u32) -> Self {
                self.wrapping_shr(bits)
            }

            fn write(values: &[Self], bytes: &mut Vec<u8>) {
                bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
            }

            #[inline(always)]
            fn then(self, answer: bool) -> Self {
                (self << 1) | Self::from(answer)
            }
        }
    };
}

// Bytes and words have saturating instructions and no room to spare; the wide types have it the other way.
impl_value!(u8, u16, far: u8::MAX, largest_total: u8::MAX, plus_penalty: saturating_add);
impl_value!(u16, u32, far: u16::MAX, largest_total: u16::MAX, plus_penalty: saturating_add);
impl_value!(u32, u64, far: u32::MAX / 2, largest_total: u32::MAX / 4, plus_penalty: wrapping_add);
impl_value!(u64, u64, far: u64::MAX / 2, largest_total: u64::MAX / 64, plus_penalty: wrapping_add);
