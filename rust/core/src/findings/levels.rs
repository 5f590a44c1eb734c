//! From where on something is noted, and from where on it is warned of.
//!
//! Ordinary pairs are below the first: rows of Middlebury's are off by up to 0.26 pixels rms, medians of their gray levels
//! differ by up to 9 %, and gamma by up to 7 %.

/// Offsets of rows, pixels rms over the image.
pub const ROWS: [f64; 2] = [0.3, 0.75];
/// ... which must also be so many times their standard error.
pub const ERRORS: [f64; 2] = [4.0, 5.0];
/// Parts of a field worth naming: pixels at the center, and at the border;
pub const PART: [f64; 2] = [0.25, 0.5];
/// ... at least so many standard errors.
pub const PART_ERRORS: f64 = 3.0;
/// Largest offset of a row by the spline, pixels.
pub const SWAY: f64 = 0.25;

/// Relative blur, pixels: root mean square along an axis.
pub const BLUR: [f64; 2] = [0.3, 0.7];
/// ... over at least this share of the image.
pub const BLUR_SHARE: f64 = 0.05;
/// Least certainty of a blur that is named,
pub const SURE: f32 = 0.5;
/// ... and least mean confidence of the rough match: what does not match has no blur in common.
pub const BLUR_CONFIDENCE: f64 = 0.6;

/// Logarithm of the ratio of gray levels.
pub const CONTRAST: [f64; 2] = [0.12, 0.35];
/// Logarithm of the ratio of gray levels in dark areas to that in bright ones.
pub const CURVE: [f64; 2] = [0.2, 0.6];
/// Noise, as a share of the range.
pub const NOISE: [f64; 2] = [0.02, 0.05];
/// The loss of compression, as the share of the range that a noise would have which does as much harm.
pub const CODING: [f64; 2] = [0.006, 0.03];
/// Saturated pixels, as a share of all.
pub const SATURATED: [f64; 2] = [0.1, 0.2];
/// What matches with this mean confidence has texture, be it as fine as noise, as random dots are.
pub const TEXTURED: f64 = 0.9;
/// Areas without texture, as a share of the image.
pub const TEXTURELESS: [f64; 2] = [0.5, 0.8];
/// ... from which on nothing else can be told.
pub const UNIFORM: f64 = 0.97;
/// Texture that repeats itself within the range, as a share of the image: of 21 pairs up to 3 %.
pub const REPEATED: [f64; 2] = [0.2, 0.45];
/// Smeared texture, as a share of it: of 21 sharp images less than half.
pub const SMEARED: f64 = 0.55;

/// Least mean confidence of a rough match of a pair: 0.58 to 0.95 for 12 pairs, sharp, after six one-sided blurs and with
/// changed contrast; 0.11 to 0.44 for images that have nothing in common.
pub const LEAST_ROUGH: f64 = 0.45;
/// Share of wrong pixels from which on a match is warned of: of 532 pairs under 28 kinds of faults, all but one of the 215 of
/// which 30 % were wrong or more, and 4 of the 192 with less than 15 %.
pub const WRONG: f64 = 0.25;
/// Share of pixels that smaller copies and planes decide from which on it is said.
pub const PLAIN: f64 = 0.25;
/// ... and least share of either that is named: less rounds to 0 %.
pub const MENTIONED: f64 = 0.005;
/// Flagged pixels, where the share of wrong ones is unknown. Of 12 pairs up to 22 %, of unrelated images 43 % or more, with
/// rows 2 px off 38 % or more.
pub const FLAGGED: [f64; 2] = [0.25, 0.35];
/// Pixels at an end of the range. Of 13 pairs up to 0.3 % at the upper one, of a range of a third 5 % or more, with any
/// preset.
pub const AT_END: [f64; 2] = [0.01, 0.02];
/// Pixels at disparity 0, where that is the lower end of the range of a match that is to be doubted: what is far away lies
/// there, up to 1.3 % of 13 pairs.
pub const AT_ZERO: f64 = 0.05;
/// A given range is too short if so much of its length is found beyond it.
pub const BEYOND: f64 = 0.2;
