//! Elementary functions of doubles, the same to the bit on every platform.
//!
//! The methods of `f64` call the platform's C library, and libraries differ in the last bit. These functions
//! are written in Rust with nothing but additions, multiplications and divisions, which IEEE 754 defines.
//! Clippy refuses the methods (`clippy.toml`). Exact ones stay methods: `sqrt`, `floor`, `round`, `mul_add`;
//! so does `powi`, a fixed sequence of multiplications that the compiler provides. Single precision is
//! computed in these and rounded.

use crate::base::simd::whole;

pub use libm::{atan2, cos, exp, exp2, hypot, log as ln, sin, sincos as sin_cos};

/// The exponential of a single, with an error of at most 3e-7 of it; arguments beyond 80 count as 80. Loops
/// with it are vectorized.
#[inline(always)]
pub fn exp_single(value: f32) -> f32 {
    let value = value.clamp(-80.0, 80.0);
    let halves = whole(value * std::f32::consts::LOG2_E + 0.5_f32.copysign(value));
    // The logarithm of 2 in two parts, so that the remainder of the value is exact.
    let rest = value - halves as f32 * 0.693_359_4 - halves as f32 * -2.121_944_4e-4;

    let series = [720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0_f32];
    let power = series.iter().fold(0.0, |sum, factorial| sum * rest + 1.0 / factorial);
    power * f32::from_bits(((halves + 127) << 23) as u32)
}

/// The natural logarithm of a positive single, with an error of at most 3e-7 of it or of 1, whichever is
/// larger; loops with it are vectorized.
#[inline(always)]
pub fn ln_single(value: f32) -> f32 {
    // The bits of the root of 1/2: mantissas run from there to the root of 2.
    const LEAST: u32 = 0x3f35_04f3;
    let bits = value.to_bits().wrapping_sub(LEAST);
    let exponent = (bits as i32) >> 23;
    let mantissa = f32::from_bits((bits & 0x007f_ffff) + LEAST);

    let part = (mantissa - 1.0) / (mantissa + 1.0);
    let square = part * part;
    let series = [9.0, 7.0, 5.0, 3.0, 1.0_f32];
    let sum = series.iter().fold(0.0, |sum, odd| sum * square + 1.0 / odd);
    exponent as f32 * std::f32::consts::LN_2 + 2.0 * part * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn singles_are_close_to_doubles() {
        for step in -8000..=8000 {
            let value = step as f32 / 100.0;
            let (found, exact) = (f64::from(exp_single(value)), exp(f64::from(value)));
            assert!((found / exact - 1.0).abs() < 3e-7, "{value}: {found} {exact}");

            let value = exp_single(value);
            let (found, exact) = (f64::from(ln_single(value)), ln(f64::from(value)));
            assert!((found - exact).abs() < 3e-7 * exact.abs().max(1.0), "{value}: {found}");
        }
    }
}
