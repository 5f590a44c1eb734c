//! Instruction-set levels: hot loops are written once, in plain Rust, and compiled for each level.
//!
//! ```text
//! level.run(loop)   ->   avx2(loop) { loop.run() }      # compiled with AVX2, `run` inlined
//! ```
//!
//! Most loops are functions with the attribute [`leveled`].
//!
//! This is the only file with unsafe code besides the C interface, and the only one that names an
//! architecture.

#![allow(unsafe_code, reason = "a function with target features may only be called where they exist")]

use std::sync::OnceLock;

pub use phasestereo_leveled::leveled;

/// The environment variable that lowers the level.
pub const OVERRIDE: &str = "PHASESTEREO_SIMD";

/// A loop over arrays that the compiler vectorizes with the instructions of the level.
///
/// `run` and everything it calls must be `#[inline(always)]`: code not inlined into the level's own function
/// is compiled for the baseline.
pub trait Loop {
    /// The result.
    type Output;
    /// Whether it counts the bits of bytes or words: other loops gain nothing from the level with these
    /// instructions, and are not compiled for it.
    const COUNTS_BITS: bool = false;
    /// Runs the loop.
    fn run(self) -> Self::Output;
}

/// Expanded by [`leveled`](crate::base::simd::leveled), from a level, the function's inputs and its body: the
/// level runs the body as a [`Loop`](crate::base::simd::Loop). Outputs and inputs are separate arguments, so
/// that the vectorizer sees that they do not overlap.
#[doc(hidden)]
#[macro_export]
macro_rules! by_level {
    (
        $(#[$meta:meta])*
        $visibility:vis fn $name:ident $(<$($generic:ident: $bound:path),+>)? (
            $level:ident: $of:ty, $($argument:ident: $type:ty),+ $(,)?
        ) $(-> $output:ty)? $body:block
    ) => {
        $(#[$meta])*
        #[inline]
        $visibility fn $name $(<$($generic: $bound),+>)? (
            $level: $of, $($argument: $type),+
        ) $(-> $output)? {
            #[inline(always)]
            fn run $(<$($generic: $bound),+>)? ($($argument: $type),+) $(-> $output)? $body

            struct Arguments<T>(T);

            impl $(<$($generic: $bound),+>)? $crate::base::simd::Loop for Arguments<($($type,)+)> {
                type Output = $crate::by_level!(@output $($output)?);

                #[inline(always)]
                fn run(self) -> Self::Output {
                    let Self(($($argument,)+)) = self;
                    run($($argument),+)
                }
            }

            $level.run(Arguments(($($argument,)+)))
        }
    };
    (@output) => { () };
    (@output $output:ty) => { $output };
}

/// A value without its fraction, clamped to magnitudes up to 2^30; 0 for NaN. A cast by `as` saturates, and
/// no instruction does that: loops with one are compiled value by value.
#[inline(always)]
pub fn whole(value: f32) -> i32 {
    const MOST: f32 = (1 << 30) as f32;
    let known = if value.is_nan() { 0.0 } else { value };
    // SAFETY: it is a number, and fits 32 bits.
    unsafe { known.clamp(-MOST, MOST).to_int_unchecked() }
}

/// An instruction-set level that this machine has; no other can be constructed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Level(Isa);

/// The levels that loops are compiled for, from the lowest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Isa {
    /// Instructions of every machine of the target: SSE2 on x86-64, NEON on aarch64.
    Baseline,
    /// AVX2, and the bit manipulation instructions of the same processors.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX-512 on bytes and words.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// The same, with a population count of bytes and words.
    #[cfg(target_arch = "x86_64")]
    Avx512Bitalg,
}

impl Isa {
    #[cfg(target_arch = "x86_64")]
    const ALL: &[(Self, &str)] = &[
        (Self::Baseline, "sse2"),
        (Self::Avx2, "avx2"),
        (Self::Avx512, "avx512"),
        (Self::Avx512Bitalg, "avx512bitalg"),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    const ALL: &[(Self, &str)] = &[(Self::Baseline, "baseline")];

    fn is_here(self) -> bool {
        match self {
            Self::Baseline => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("lzcnt")
                    && is_x86_feature_detected!("popcnt")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                Self::Avx2.is_here()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512cd")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512Bitalg => Self::Avx512.is_here() && is_x86_feature_detected!("avx512bitalg"),
        }
    }
}

impl Level {
    /// The highest level of this machine, up to the one that the environment variable `PHASESTEREO_SIMD`
    /// names. The variable is read once; an unknown name is ignored.
    pub fn best() -> Self {
        static BEST: OnceLock<Level> = OnceLock::new();
        *BEST.get_or_init(|| Self::at_most(std::env::var(OVERRIDE).ok().as_deref()))
    }

    /// The highest level of this machine that is not above the named one.
    fn at_most(name: Option<&str>) -> Self {
        // Without a known name, all levels are allowed.
        let named = Isa::ALL.iter().position(|(_, known)| Some(*known) == name);
        let allowed = &Isa::ALL[..=named.unwrap_or(Isa::ALL.len() - 1)];

        let here = allowed.iter().rev().find(|(isa, _)| isa.is_here());
        Self(here.map_or(Isa::Baseline, |(isa, _)| *isa))
    }

    /// The name of every level that loops are compiled for, and the level itself if this machine has it.
    pub fn all() -> impl Iterator<Item = (&'static str, Option<Self>)> {
        Isa::ALL.iter().map(|(isa, name)| (*name, isa.is_here().then_some(Self(*isa))))
    }

    /// The name of this level.
    pub fn name(self) -> &'static str {
        Isa::ALL.iter().find(|(isa, _)| *isa == self.0).map_or("", |(_, name)| name)
    }

    /// Runs a loop, compiled for this level.
    #[inline]
    pub fn run<L: Loop>(self, work: L) -> L::Output {
        match self.0 {
            Isa::Baseline => work.run(),
            // SAFETY: a `Level` is constructed only after `is_here` has found all of its features.
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => unsafe { avx2(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512Bitalg if L::COUNTS_BITS => unsafe { avx512_bitalg(work) },
            // SAFETY: as above; this level includes the features of the one below.
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 | Isa::Avx512Bitalg => unsafe { avx512(work) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn avx2<L: Loop>(work: L) -> L::Output {
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl")]
fn avx512<L: Loop>(work: L) -> L::Output {
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
#[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx512bitalg")]
fn avx512_bitalg<L: Loop>(work: L) -> L::Output {
    work.run()
}

/// Prefetches the cache line of an address, before it is read or written. Any address is allowed.
#[inline(always)]
pub fn fetch<T>(place: *const T) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: it is a hint that never faults; every x86-64 processor has SSE.
    unsafe {
        std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(place.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = place;
}

#[cfg(not(target_arch = "x86_64"))]
pub use self::portable::{highest_bits, least_bytes};
#[cfg(target_arch = "x86_64")]
pub use self::sse2::{highest_bits, least_bytes};

/// Instructions that the compiler does not generate from plain loops: it extracts single bytes and writes
/// them one by one, and code that reads them together has to wait.
///
/// Every x86-64 processor has these instructions. In loops for a higher level, they are compiled with its
/// own, two registers in one wider one.
#[cfg(target_arch = "x86_64")]
mod sse2 {
    use std::arch::x86_64::{
        __m128i, _mm_min_epu8, _mm_movemask_epi8, _mm_unpackhi_epi8, _mm_unpackhi_epi16, _mm_unpackhi_epi32,
        _mm_unpackhi_epi64, _mm_unpacklo_epi8, _mm_unpacklo_epi16, _mm_unpacklo_epi32, _mm_unpacklo_epi64,
    };
    use std::mem::transmute;

    /// The highest bit of each byte: that of byte `j` as bit `j`.
    #[inline(always)]
    pub fn highest_bits(bytes: &[u8; 32]) -> u32 {
        // SAFETY: registers are bytes of any value; every x86-64 processor has SSE2.
        let [low, high] = unsafe {
            let [low, high] = transmute::<[u8; 32], [__m128i; 2]>(*bytes);
            [_mm_movemask_epi8(low), _mm_movemask_epi8(high)]
        };

        low as u32 | (high as u32) << 16
    }

    /// The least byte of each of sixteen rows.
    ///
    /// Two registers of bytes become one that alternates theirs, then one that alternates pairs of bytes, and
    /// so on: in the last one each byte belongs to another row.
    #[inline(always)]
    pub fn least_bytes(rows: &[[u8; 32]; 16]) -> [u8; 16] {
        // SAFETY: registers are bytes of any value; every x86-64 processor has SSE2.
        unsafe {
            let mut least = [transmute::<[u8; 16], __m128i>([0; 16]); 16];
            for (least, row) in least.iter_mut().zip(rows) {
                let [low, high] = transmute::<[u8; 32], [__m128i; 2]>(*row);
                *least = _mm_min_epu8(low, high);
            }

            for i in 0..8 {
                let [a, b] = [least[2 * i], least[2 * i + 1]];
                least[i] = _mm_min_epu8(_mm_unpacklo_epi8(a, b), _mm_unpackhi_epi8(a, b));
            }
            for i in 0..4 {
                let [a, b] = [least[2 * i], least[2 * i + 1]];
                least[i] = _mm_min_epu8(_mm_unpacklo_epi16(a, b), _mm_unpackhi_epi16(a, b));
            }
            for i in 0..2 {
                let [a, b] = [least[2 * i], least[2 * i + 1]];
                least[i] = _mm_min_epu8(_mm_unpacklo_epi32(a, b), _mm_unpackhi_epi32(a, b));
            }

            let [a, b, ..] = least;
            let least = _mm_min_epu8(_mm_unpacklo_epi64(a, b), _mm_unpackhi_epi64(a, b));
            transmute::<__m128i, [u8; 16]>(least)
        }
    }
}

/// The same for other processors.
#[cfg(any(test, not(target_arch = "x86_64")))]
mod portable {
    /// The highest bit of each byte: that of byte `j` as bit `j`.
    #[inline(always)]
    pub fn highest_bits(bytes: &[u8; 32]) -> u32 {
        let mut bits = 0;
        for (i, eight) in bytes.as_chunks().0.iter().enumerate() {
            // The product shifts the bit of byte `j` from place 8 `j` + 7 to 56 + `j`.
            let highest = u64::from_le_bytes(*eight) & 0x8080_8080_8080_8080;
            bits |= (highest.wrapping_mul(0x0002_0408_1020_4081) >> 56 << (8 * i)) as u32;
        }
        bits
    }

    /// The least byte of each of sixteen rows.
    #[inline(always)]
    pub fn least_bytes(rows: &[[u8; 32]; 16]) -> [u8; 16] {
        let mut least = [u8::MAX; 16];
        for (least, row) in least.iter_mut().zip(rows) {
            for byte in row {
                *least = (*least).min(*byte);
            }
        }
        least
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_lowers_the_level_and_never_raises_it() {
        let best = Level::at_most(None);
        assert_eq!(Level::at_most(Some("no such level")), best);

        for (name, level) in Level::all() {
            let lowered = Level::at_most(Some(name));
            assert!(lowered <= best);
            assert!(level.is_none_or(|level| level == lowered && level.name() == name));
        }
    }

    #[test]
    fn whole_values_are_those_of_a_cast_up_to_a_limit() {
        for value in [0.0, -0.0, 0.99, -0.99, 1.5, -7.5, 8_388_607.5, 16_777_217.0, -1e9, 1e-40] {
            assert_eq!(whole(value), value as i32);
        }
        assert_eq!([f32::NAN, -f32::NAN].map(whole), [0; 2]);
        assert_eq!([2e9, f32::INFINITY, f32::MAX].map(whole), [1 << 30; 3]);
        assert_eq!([-2e9, f32::NEG_INFINITY, f32::MIN].map(whole), [-1 << 30; 3]);
    }

    #[test]
    fn every_level_runs_the_same_code() {
        #[leveled]
        fn byte_sum(level: Level, bytes: &[u8]) -> u32 {
            bytes.iter().map(|value| u32::from(*value)).sum()
        }

        let values: Vec<u8> = (0..1000).map(|i| i as u8).collect();
        let expected: u32 = values.iter().map(|value| u32::from(*value)).sum();

        for (name, level) in Level::all() {
            match level {
                Some(level) => assert_eq!(byte_sum(level, &values), expected, "{name}"),
                None => println!("{name}: not run, this machine does not have it"),
            }
        }
    }

    #[test]
    fn every_level_finds_the_bits_and_the_least_of_bytes() {
        #[leveled]
        fn bits_and_least(level: Level, rows: &[[u8; 32]; 16]) -> ([u32; 16], [u8; 16]) {
            (rows.map(|row| highest_bits(&row)), least_bytes(rows))
        }

        // The least byte of row `i` is 5 `i`, at place 7 `i`.
        let byte = |i: usize, j: usize| if j == 7 * i % 32 { 5 * i } else { 90 + 37 * (i + j) % 166 };
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| byte(i, j) as u8));
        let least = std::array::from_fn(|i| 5 * i as u8);
        let bits = rows
            .map(|row: [u8; 32]| row.iter().enumerate().map(|(j, byte)| u32::from(*byte >= 128) << j).sum());

        assert_eq!(
            (rows.map(|row| portable::highest_bits(&row)), portable::least_bytes(&rows)),
            (bits, least)
        );
        for (name, level) in Level::all() {
            if let Some(level) = level {
                assert_eq!(bits_and_least(level, &rows), (bits, least), "{name}");
            }
        }
    }
}
