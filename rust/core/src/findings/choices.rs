//! The constants of findings that are neither levels of the tables nor derived: each with its unit, its
//! meaning, and the measurement that chose it.

/// Least share of an image that a blur must cover to be reported.
pub const BLUR_SHARE: f64 = 0.05;
/// Least certainty, 0 to 1, of a reported blur.
pub const SURE: f32 = 0.5;
/// Least mean confidence of the low-resolution match for a blur to be reported: images that do not match
/// have no relative blur.
pub const BLUR_CONFIDENCE: f64 = 0.6;
/// Least largest offset of a row by the spline, pixels, for sway to be reported.
pub const SWAY: f64 = 0.25;
/// Least size of a part of the vertical disparity that is named, pixels, at the center and at the border; and
/// in standard errors.
pub const PART: [f64; 2] = [0.25, 0.5];
/// See [`PART`].
pub const PART_ERRORS: f64 = 3.0;
/// Mean confidence of the low-resolution match from which images have texture, even if it is as fine as
/// noise, like random dots.
pub const TEXTURED: f64 = 0.9;
/// Share of an image without texture from which nothing else can be measured.
pub const UNIFORM: f64 = 0.97;
/// Share of the texture that is smeared, from which it is named as a cause: below half on 21 sharp images.
pub const SMEARED: f64 = 0.55;
/// Share of pixels decided by smaller copies and planes together, from which both are reported; and least
/// share of either: less rounds to 0 %.
pub const PLAIN: f64 = 0.25;
/// See [`PLAIN`].
pub const MENTIONED: f64 = 0.005;
/// Share of pixels at disparity 0, if that is the lower end of the range of a doubtful match. Far objects are
/// there, up to 1.3 % of the pixels of 13 pairs.
pub const AT_ZERO: f64 = 0.05;
/// Pixels below zero from which the median of all disparities counts as negative.
pub const CLEARLY: f64 = 2.0;
