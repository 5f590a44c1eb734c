#![doc = include_str!("../README.md")]
//!
//! # The story of one disparity map
//!
//! Each folder is a stage, in the order in which the data flows:
//!
//! 1. `image`: images of any type become integer planes; masked pixels take the values of their neighbors.
//!    Impulses are repaired, noise and block artifacts of compression are smoothed away, blur is added.
//! 2. `pair`: two images of one size, the disparities to search, and what makes the images comparable: rows
//!    that are resampled so that they correspond, kernels that blur both alike.
//! 3. `descriptor`: the phase of a local Fourier transform around every pixel is quantized coarsely.
//!    Symmetric blur and contrast leave it unchanged. The levels are packed into one word per pixel.
//! 4. `cost`: a pixel and a candidate in the other image cost the number of bits that differ; or, for
//!    comparison, the difference of their intensities or local contrasts. Costs are summed over a window, or
//!    over the best of five shifted ones.
//! 5. `optimization`: the totals of a few paths, or dynamic programming along the row, choose a candidate for
//!    every pixel. Jumps cost less at edges of the image.
//! 6. `refinement`: candidates become sub-pixel disparities. The left-right check and the speckle filter flag
//!    disparities that cannot be right, which are then filled from the pixels beside them. Edges in depth are
//!    aligned with those of the left image. Where one image is blurred, it is synthesized by the map, which
//!    corrects disparities near jumps. Every disparity is given a confidence.
//!
//! `matcher` runs bands of rows on threads. It knows the rows that a part of a pair depends on (its halo),
//! the memory that a match takes, and the statistics of a whole pair that the match of its parts needs.
//!
//! Costs and totals are integers as narrow as the settings allow (`base::value`). The candidates of a pixel
//! lie in neighboring lanes, in loops that are compiled for every instruction set (`base::simd`, the only
//! unsafe code). All arithmetic is that of integers (the descriptor may use floats that hold them exactly),
//! so the result is the same to the bit for any number of threads, any part of a pair and any instructions,
//! and equals that of a reference implementation, which computes the same in the most obvious way
//! (`tests/rust/reference.rs`).
//!
//! M. Pedone, J. Heikkilä: *Blur and Contrast Invariant Fast Stereo Matching*, ACIVS 2008.

// The attribute `leveled` names this crate, also within it.
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
