//! The constants of findings that are neither levels of the tables nor derived: each with its unit, its
//! meaning, and the measurement that chose it.

/// Share of an image that a blur covers at least to be reported.
pub const BLUR_SHARE: f64 = 0.05;
/// Least certainty, 0 to 1, of a blur that is reported.
pub const SURE: f32 = 0.5;
/// Least mean confidence of the low-resolution match of a blur that is reported: images that do not match
/// have no blur in common.
pub const BLUR_CONFIDENCE: f64 = 0.6;
/// Pixels by which the spline of rows moves some row at least to be reported.
pub const SWAY: f64 = 0.25;
/// Pixels of a part of the vertical disparity that is named, at the center and at the border; standard errors
/// that it must have as well.
pub const PART: [f64; 2] = [0.25, 0.5];
/// See [`PART`].
pub const PART_ERRORS: f64 = 3.0;
/// Mean confidence of the low-resolution match from which on images have texture, even as fine as noise:
/// random dots have.
pub const TEXTURED: f64 = 0.9;
/// Share of an image without texture from which on nothing else can be measured.
pub const UNIFORM: f64 = 0.97;
/// Smeared texture that is named as a cause, as a share of the texture: of 21 sharp images less than half.
pub const SMEARED: f64 = 0.55;
/// Share of pixels that smaller copies and planes decide from which on both are reported, and least share of
/// either: less rounds to 0 %.
pub const PLAIN: f64 = 0.25;
/// See [`PLAIN`].
pub const MENTIONED: f64 = 0.005;
/// Pixels at disparity 0, where that is the lower end of the range of a doubtful match: far things are there,
/// up to 1.3 % of the pixels of 13 pairs.
pub const AT_ZERO: f64 = 0.05;
/// Pixels below zero from which on the median of all disparities counts as negative.
pub const CLEARLY: f64 = 2.0;
