#![doc = include_str!("../README.md")]
//!
//! # From two images to one disparity map
//!
//! Start with `match_pair`. It runs, in this order:
//!
//! 1. `estimation`: properties of the pair that the caller does not give are estimated from the images: range
//!    of disparities, correspondence of rows, blur, noise, light.
//! 2. `rectification`: a pair that is too far from rectified is rectified from its images.
//! 3. The matcher, the crate `phasestereo-match`, matches the pair that is now ready.
//! 4. `scales`: copies of half the size, a quarter ... decide where they are more likely to be right, and
//!    flat areas become planes.
//! 5. `findings`: noteworthy facts about the pair and the match become sentences.
//!
//! `preparation` uses the results of 1 and 2 to make a pair that any other matcher can use. `video` does the
//! same for consecutive frames of two cameras, and learns from them. `verification` judges a disparity map
//! from elsewhere, by its own match and by the costs of both. `interface` takes images as slices, matches
//! them on persistent threads, and returns the map with all findings.
//!
//! `self_check` compares this build with the digests of matches that every platform must have.

mod estimation;
mod finding;
mod findings;
mod interface;
mod match_pair;
mod preparation;
mod rectification;
mod saved;
mod scales;
mod self_check;
#[cfg(test)]
mod testing;
mod third_camera;
mod verification;
mod video;

pub use estimation::Estimates;
pub use finding::{Finding, Severity, Topic};
pub use interface::image::{Image, Pixel};
pub use interface::keep::Keep;
pub use interface::rig::Rig;
pub use interface::{Match, Matcher, PreparedPair, Verification};
pub use match_pair::Rectified;
pub use phasestereo_match::base::control::Control;
pub use phasestereo_match::base::error::{Error, Result};
pub use phasestereo_match::base::plane::Plane;
pub use phasestereo_match::matcher::Timings;
pub use phasestereo_match::matcher::summary::Summary;
pub use phasestereo_match::optimization::engine::Engine;
pub use phasestereo_match::refinement::flag;
pub use phasestereo_match::settings::presets::Preset;
pub use phasestereo_match::settings::{CostKind, Optimizer, Precision, Settings, Taper};
pub use rectification::calibration::Calibration;
pub use rectification::warp::Interpolation;
pub use third_camera::{LeftCamera, Lens, Registered, ThirdCamera};
pub use verification::verdict;

/// The types of the fields of [`Estimates`] and [`Rectified`].
///
/// ```
/// use phasestereo::{Estimates, found::Side};
///
/// fn softer_image(estimates: &Estimates) -> Option<Side> {
///     estimates.blur.as_ref()?.blurs.iter().find_map(|blur| blur.side)
/// }
/// ```
pub mod found {
    pub use crate::estimation::blur::psf::{Family, Psf};
    pub use crate::estimation::blur::taps::Taps;
    pub use crate::estimation::blur::{Blur, Estimate as BlurEstimate, Side};
    pub use crate::estimation::compensation_plan::CompensationPlan;
    pub use crate::estimation::facts::{Fact, Origin};
    pub use crate::estimation::photometry::{Contrast, Photometry, Saturation};
    pub use crate::estimation::range::{LeftOut, SearchRange};
    pub use crate::estimation::rows::RowOffsets;
    pub use crate::rectification::cameras::Cameras;
    pub use crate::rectification::{Raw, Rectification};
    pub use phasestereo_match::pair::alignment::Alignment;
    pub use phasestereo_match::pair::candidates::Candidates;
}

macro_rules! open {
    ($($module:ident)*) => {
        /// All of this crate, for the Python extension module, the tests and the benches. It is not part of
        /// the interface: any of it may change in any version.
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
    estimation finding findings match_pair preparation rectification scales self_check third_camera verification video
}
