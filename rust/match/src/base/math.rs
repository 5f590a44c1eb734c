//! Elementary functions of doubles, the same to the bit on every platform.
//!
//! The methods of `f64` call the C library of the platform, and libraries differ in the last bit. These are
//! written in Rust: nothing but additions, multiplications and divisions, which IEEE 754 defines. Clippy
//! refuses the methods (`clippy.toml`). What is exact stays a method: `sqrt`, `floor`, `round`, `mul_add`; so
//! does `powi`, a fixed sequence of multiplications that the compiler brings along. Single precision goes
//! through these and is rounded.

pub use libm::{atan2, cos, exp, exp2, hypot, log as ln, sin, sincos as sin_cos};
