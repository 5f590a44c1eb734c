//! Dense stereo matching on quantized local phase, which blur and contrast leave alone.
//!
//! A match is one call. The settings are those of a preset, of [`Preset::Robust`] by default, which finds out by itself
//! what the pair lacks: which disparities there are, how the rows of the images correspond, which image is blurred, where
//! and by what, and how much noise there is.
//!
//! ```
//! use phasestereo::{Image, Pair, Settings, View, match_pair};
//!
//! // Rows x columns x channels: texture, 5 columns further left in the right image.
//! let texture = |shift: usize| {
//!     let gray = |(y, x, _)| ((x + shift) * 89 % 251) as u8 ^ (y * 37 % 256) as u8;
//!     View::from(Image::U8(ndarray::Array3::from_shape_fn((80, 120, 1), gray)))
//! };
//! let pair = Pair::new(texture(0), texture(5), 0, 16)?;
//!
//! let (found, estimates) = match_pair(pair, &Settings::default(), 1)?;
//!
//! assert!((found.disparity.row(40)[60] - 5.0).abs() < 0.5);
//! assert!(estimates.alignment.is_none(), "its rows correspond");
//! # Ok::<(), phasestereo::Error>(())
//! ```
//!
//! # The story of one disparity map
//!
//! Each folder is a stage, in the order in which the data flows:
//!
//! 1. `image`: two rectified images of any type become integer planes; masked pixels take the values of their neighbors.
//!    Impulses are repaired, noise and what compression has left of its blocks are smoothed away, blur is added.
//! 2. `descriptor`: around every pixel a local Fourier transform is taken, of which only the phase is kept, coarsely:
//!    symmetric blur and contrast leave it alone. The levels are packed into one word per pixel.
//! 3. `cost`: a pixel and a candidate in the other image cost as many bits as differ; or, for comparison, what their
//!    intensities or local contrasts differ by. Costs are summed over a window, of which the best of five positions counts.
//! 4. `optimization`: the sum of the totals of a few paths chooses a candidate for every pixel, or dynamic programming
//!    along the row does; paths jump more easily at edges of the image.
//! 5. `refinement`: what was chosen becomes a disparity between the candidates. Those that cannot be right are flagged by
//!    the left-right check and as speckles, and filled from the pixels beside them. Edges in depth are drawn to those of
//!    the image; where one image is blurred it is made again by the map, by which jumps are put right. Every disparity is
//!    given a confidence.
//!
//! Of a video, a map may then be filtered over time (`pipeline/temporal.rs`): where nothing changes it is steady.
//!
//! Before all that, `rig` may find out what nobody told, and compensates for it. `pipeline` runs bands of rows on threads,
//! and knows which rows a part of a pair depends on (its halo), how much memory it takes, and what must be known of a whole
//! pair of which only parts are at hand.
//!
//! Costs and totals are integers as narrow as the settings allow (`value`), the candidates of a pixel in neighboring lanes,
//! in loops that are compiled for every instruction set (`simd`, the only unsafe code but that of the C interface). All
//! arithmetic is that of integers (the descriptor's may be carried out in floats that hold them exactly): the result is the
//! same to the bit for any number of threads, any part of a pair and any instructions, and equal to that of a reference
//! implementation, which does the same in the most obvious way (`tests/rust/reference.rs`).
//!
//! M. Pedone, J. Heikkilä: *Blur and Contrast Invariant Fast Stereo Matching*, ACIVS 2008.

#![cfg_attr(
    not(feature = "python"),
    allow(
        dead_code,
        reason = "single stages, parts of a pair and the memory model are for the Python face, with which lints are run"
    )
)]

mod error;
mod math;
mod settings;
mod simd;
mod value;

mod cost;
mod descriptor;
mod image;
mod optimization;
mod pipeline;
mod refinement;
mod rig;

#[cfg(feature = "c")]
mod c;
#[cfg(feature = "python")]
mod python;

pub use error::{Error, Result};
pub use image::plane::Plane;
pub use image::view::{Image, Mask, View};
pub use pipeline::control::Control;
pub use pipeline::matcher::{Disparity, Execution, Matcher, Pair, Timings};
pub use pipeline::temporal::TemporalFilter;
pub use refinement::flag;
pub use rig::estimation::{Estimates, Known, Means, Prepared, prepare, prepare_and_match};
pub use settings::presets::Preset;
pub use settings::{CostKind, Optimizer, Precision, Settings, Taper};
pub use simd::Level;

/// Matches a pair on so many threads, started for it: its disparity map, and what was found out of the pair.
///
/// The disparities of the pair are searched, and all else is found that the settings ask for. [`prepare_and_match`] is
/// for disparities to be found, for pairs of which something is known, and for one pair after another on the same threads;
/// [`prepare`] and [`Matcher::run`] are its two steps.
pub fn match_pair(
    pair: Pair,
    settings: &Settings,
    threads: usize,
) -> Result<(Disparity, Estimates)> {
    let (matcher, control) = (Matcher::new(threads)?, Control::default());
    let how = Execution { threads, level: Level::best() };
    let known = Known { candidates: Some(pair.candidates()), ..Known::default() };
    let means = Means { matcher: &matcher, how, control: &control };
    prepare_and_match(pair, known, settings, means)
}

/// All stages, for tests and benches.
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod internals {
    /// See the crate.
    pub mod error {
        pub use crate::error::*;
    }
    /// See the crate.
    pub mod math {
        pub use crate::math::*;
    }
    /// See the crate.
    pub mod settings {
        pub use crate::settings::*;
    }
    /// See the crate.
    pub mod simd {
        pub use crate::simd::*;
    }
    /// See the crate.
    pub mod value {
        pub use crate::value::*;
    }
    /// See the crate.
    pub mod cost {
        pub use crate::cost::*;
    }
    /// See the crate.
    pub mod descriptor {
        pub use crate::descriptor::*;
    }
    /// See the crate.
    pub mod image {
        pub use crate::image::*;
    }
    /// See the crate.
    pub mod optimization {
        pub use crate::optimization::*;
    }
    /// See the crate.
    pub mod pipeline {
        pub use crate::pipeline::*;
    }
    /// See the crate.
    pub mod refinement {
        pub use crate::refinement::*;
    }
    /// See the crate.
    pub mod rig {
        pub use crate::rig::*;
    }
}
