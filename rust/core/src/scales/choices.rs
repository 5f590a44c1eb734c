//! The constants of planes and blank areas that are not derived: each with its unit, and the measurement that
//! chose it. Built skies are 20 pairs of textured houses before a sky at disparity 0.

/// Pixels on either side of the mean that an image is compared with: a box as wide as a Gaussian of 2 px.
pub const SMOOTH_RADIUS: usize = 3;
/// Pixels on either side that detail is averaged over.
pub const DETAIL_RADIUS: usize = 4;
/// Steps of rounding rms that are no detail: rounding itself has 0.29, that of three channels 0.19.
pub const BLANK: f64 = 0.3;
/// Pixels: blank areas are as wide as a square that reaches this far to each side,
pub const BLANK_LEAST: usize = 2;
/// ... and nothing may be seen this far around, which is more than windows of codes and costs reach.
pub const BLANK_DEPTH: usize = 8;
/// Most confidence where there is no evidence: below one half nothing is trusted. Of the pixels of built
/// skies 10 % are trusted and wrong with these bounds, 25 % without, and as many right ones are trusted
/// there, on table tops and on planes.
pub const UNSEEN: f32 = 0.4;
/// Steps of rounding rms that are hardly any detail: 1.7 times what rounding has. Only where an area has no
/// plane by all of its pixels: a bound by detail in every area would take the planes from Monopoly.
pub const FAINT: f64 = 0.5;
/// Share of the weight that agrees with a plane, from which on it is drawn; and where faint pixels do not
/// count.
pub const LEAST_AGREEING: [f32; 2] = [0.5, 0.6];
/// Pixels around an area, from and to, in which its surface may go on.
pub const OUTSIDE: [usize; 2] = [4, 14];
/// Pixels of disparity: what goes on there is as near the plane as this.
pub const GOES_ON: f32 = 2.0;
/// Share of all pixels there that are sure and near the plane, from which on the outline belongs to what lies
/// before the area: below 0.4 around six table tops, up to 0.41 around the largest area of a sheet of
/// plastic, 0.52 to 0.72 around built skies.
pub const OCCLUDER: f64 = 0.45;
/// Pixels from those that agree with a plane within which it has evidence all the same.
pub const EVIDENCE_REACH: usize = 4;
