#![doc = include_str!("../README.md")]
//!
//! # The story of one disparity map
//!
//! Each folder is a stage, in the order in which the data flows:
//!
//! 1. `image`: images of any type become integer planes; masked pixels take the values of their neighbors.
//!    Impulses are repaired, noise and compression block artifacts are smoothed away, blur is added.
//! 2. `pair`: two images of one size, the disparities to search, and the corrections that make the images
//!    comparable: rows resampled to correspond, kernels that blur both alike.
//! 3. `descriptor`: the phase of a local Fourier transform around every pixel is quantized coarsely.
//!    Symmetric blur and contrast leave it unchanged. The levels are packed into one word per pixel.
//! 4. `cost`: a pixel and a candidate in the other image cost the number of bits that differ or, for
//!    comparison, the difference of their intensities or local contrasts. Costs are summed over a window, or
//!    over the best of five shifted ones.
//! 5. `optimization`: the totals of a few paths, or dynamic programming along the row, choose a candidate for
//!    every pixel. Jumps cost less at edges of the image.
//! 6. `refinement`: candidates become sub-pixel disparities. The left-right check and the speckle filter flag
//!    disparities that cannot be right, which are then filled from the pixels beside them. Depth edges are
//!    aligned with those of the left image. If one image is blurred, it is synthesized from the map, which
//!    corrects disparities near jumps. Every disparity receives a confidence.
//!
//! `matcher` runs bands of rows on threads. It computes the rows that a part of a pair depends on (its halo),
//! the memory that a match takes, and the statistics of a whole pair that matching its parts needs.
//!
//! Costs and totals are integers as narrow as the settings allow (`base::value`). The candidates of a pixel
//! lie in neighboring lanes, in loops compiled for every instruction set (`base::simd`, the only unsafe
//! code). Arithmetic is on integers, or on floats in a fixed order, so the result is bit-identical for any
//! number of threads, any part of a pair and any instruction set. It equals a reference implementation that
//! computes the same in the most obvious way (`tests/rust/reference.rs`).
//!
//! M. Pedone, J. Heikkilä: *Blur and Contrast Invariant Fast Stereo Matching*, ACIVS 2008.

// The `leveled` attribute refers to this crate by name, even inside it.
extern crate self as phasestereo_match;

pub mod base;
pub mod choices;
pub mod settings;

pub mod image;
pub mod pair;

pub mod cost;
pub mod descriptor;
pub mod optimization;
pub mod refinement;

pub mod matcher;
