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
/// Pixels outside an area, from and to, in which surfaces of its outline may go on.
pub const OUTSIDE: [usize; 2] = [4, 14];
/// Pixels of disparity: what goes on there is as near the area's own as this.
pub const GOES_ON: f32 = 2.0;
/// Share of those pixels that are sure and near, from which on the outline belongs to what lies before the
/// area: at most 0.01 around six table tops, 0.56 to 0.98 around 50 skies, built, pasted and of a street.
pub const OCCLUDER: f64 = 0.55;
/// Pixels of an area that fine detail is not compared at, along its outline: windows of it reach 4, flat ones 2.
pub const INSIDE: usize = 2;
/// Pixels of a side of the tiles over which signs are compared,
pub const TILE: usize = 8;
/// ... and how many tiles to either side.
pub const NEARBY: usize = 2;
/// Mean product of signs up to which nothing is seen. Trusted and wrong of 20 built skies, 14 pasted ones and
/// one of a street: 23, 8, 40 % without this bound, 6, 3, 6 with 0.05, 2, 1, 5 with 0.08; of 12 scenes 0.5 to
/// 0.6 % of the pixels lose their trust rightly matched, 0.3 to 0.4 % wrongly.
pub const SEEN: f64 = 0.0625;
/// Pixels around an area that belong to it: flat windows of 5 x 5 end as far from its outline.
pub const MARGIN: usize = 2;
