#![doc = include_str!("../README.md")]
//!
//! # From two images to one disparity map
//!
//! Start with `match_pair`. It runs, in this order:
//!
//! 1. `estimation`: what the caller does not know of the pair is estimated from the images: the range of
//!    disparities, how rows correspond, blur, noise, light.
//! 2. `rectification`: a pair that is too far from rectified for that is rectified by what its images show.
//! 3. The matcher, the crate `phasestereo-match`, matches the pair that is now ready.
//! 4. `scales`: where a copy of the pair of half the size, a quarter ... is more likely to be right, it
//!    decides, and flat areas become planes.
//! 5. `findings`: what is worth knowing about the pair and the match becomes sentences.
//!
//! `preparation` makes a pair that any other matcher can use of what 1 and 2 have found. `video` does the
//! same for frame after frame of two cameras, which it learns from. `verification` judges a disparity map of
//! another origin by a match of its own and by the costs of both. `interface` takes images that are slices,
//! matches them on threads that are kept, and returns the map with all there is to say about it.
//!
//! `self_check` holds this build to the digests of matches that every platform has.

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

/// What was found out about a pair: the types of the fields of [`Estimates`] and [`Rectified`].
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
        /// All of this crate, for the extension module of Python, the tests and the benches. It is not part
        /// of the interface: any of it may change with any version.
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
