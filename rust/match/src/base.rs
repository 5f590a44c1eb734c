//! The basis of all stages: errors, planes, memory, threads, and arithmetic that is the same on every
//! platform.

pub mod control;
pub mod digest;
pub mod error;
pub mod linear;
pub mod math;
pub mod memory;
pub mod named;
pub mod plane;
pub mod platform;
pub mod simd;
pub mod statistics;
pub mod value;
