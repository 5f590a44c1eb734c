#![doc = include_str!("../README.md")]
//!
//! # The story of one disparity map
//!
//! Each folder is a stage, in the order in which the data flows:
//!
//! 1. `image`: two rectified images of any type become integer planes; masked pixels take the values of their neighbors.
//!    Impulses are repaired, noise and block artifacts of compression are smoothed away, blur is added.
//! 2. `descriptor`: the phase of a local Fourier transform around every pixel is quantized coarsely. Symmetric blur and
//!    contrast leave it unchanged. The levels are packed into one word per pixel.
//! 3. `cost`: a pixel and a candidate in the other image cost the number of bits that differ; or, for comparison, the
//!    difference of their intensities or local contrasts. Costs are summed over a window, or over the best of five
//!    shifted ones.
//! 4. `optimization`: the totals of a few paths, or dynamic programming along the row, choose a candidate for every pixel.
//!    Jumps cost less at edges of the image.
//! 5. `refinement`: candidates become sub-pixel disparities. The left-right check and the speckle filter flag disparities
//!    that cannot be right, which are then filled from the pixels beside them. Edges in depth are aligned with those of
//!    the left image. Where one image is blurred, it is synthesized by the map, which corrects disparities near jumps.
//!    Every disparity is given a confidence.
//! 6. `scales`: where a copy of the pair of half the size, a quarter ... is more likely to be right, it decides, and flat
//!    areas become planes.
//!
//! The map of a video frame may then be filtered over time (`pipeline/temporal.rs`): it is steady where nothing changes. What
//! its cameras are is learned from frame to frame (`frames`, `rig/state.rs`).
//!
//! Before all that, `rig` may estimate what the caller does not know of the pair, and compensates for it. `pipeline`
//! runs bands of rows on threads. It knows the rows that a part of a pair depends on (its halo), the memory that a
//! match takes, and the statistics of a whole pair that the match of its parts needs.
//!
//! On top, `interface` takes images that are slices, matches them on threads that are kept, and returns the map with what
//! there is to say about it.
//!
//! Whether all that computes here what it computes elsewhere is known from pairs that are made here (`self_check`).
//!
//! A disparity map of another origin is judged by the same means: `verification` compares it with a match of its own and
//! with the costs of both.
//!
//! Costs and totals are integers as narrow as the settings allow (`value`). The candidates of a pixel lie in neighboring
//! lanes, in loops that are compiled for every instruction set (`simd`, the only unsafe code).
//! All arithmetic is that of integers (the descriptor may use floats that hold them exactly), so the result is the same to
//! the bit for any number of threads, any part of a pair and any instructions, and equals that of a reference
//! implementation, which computes the same in the most obvious way (`tests/rust/reference.rs`).
//!
//! M. Pedone, J. Heikkilä: *Blur and Contrast Invariant Fast Stereo Matching*, ACIVS 2008.

mod error;
mod findings;
mod interface;
mod math;
mod settings;
mod simd;
mod value;

mod cost;
mod descriptor;
mod frames;
mod image;
mod optimization;
mod pipeline;
mod refinement;
mod rig;
mod scales;
mod self_check;
mod verification;
mod whole;

pub use error::{Error, Result};
pub use findings::{Finding, Severity, Topic};
pub use image::plane::Plane;
pub use interface::image::{Image, Pixel};
pub use interface::rig::Rig;
pub use interface::{Match, Matcher, Verification};
pub use pipeline::control::Control;
pub use pipeline::matcher::Timings;
pub use pipeline::summary::Summary;
pub use refinement::flag;
pub use rig::estimation::Estimates;
pub use rig::rectification::calibration::Calibration;
pub use rig::rectification::warp::Interpolation;
pub use settings::presets::Preset;
pub use settings::{CostKind, Optimizer, Precision, Settings, Taper};
pub use verification::verdict;
pub use whole::Rectified;

macro_rules! open {
    ($($module:ident)*) => {
        /// All stages, for the extension module of Python, the tests and the benches. They are not part of the interface:
        /// any of them may change with any version.
        #[doc(hidden)]
        pub mod internals {
            $(
                /// See the crate.
                pub mod $module {
                    pub use crate::$module::*;
                }
            )*
        }
    };
}

open! {
    error findings math settings simd value
    cost descriptor frames image optimization pipeline refinement rig scales self_check verification whole
}
