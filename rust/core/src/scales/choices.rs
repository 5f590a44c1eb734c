//! The constants of planes, and of what an image shows, that are not derived: each with its unit, and the
//! measurement that chose it. Built skies are 24 pairs of textured houses before a plain sky at disparity 0, each
//! with noise of 0.6, 1.5 and 3 gray levels, and as JPEG.

/// Pixels on either side of the mean that an image is compared with: a box as wide as a Gaussian of 2 px.
pub const SMOOTH_RADIUS: usize = 3;
/// Pixels on either side that detail is averaged over.
pub const DETAIL_RADIUS: usize = 4;
/// Standard deviation of rounding, in steps: the square root of 1/12.
pub const ROUNDING: f64 = 0.288_675_134_594_812_9;
/// Times the variance of the noise from which on detail is more than noise; mean squares of 81 pixels of noise
/// have a standard deviation of 0.2. Of the built skies 16 % are trusted and wrong without it; 9, 8 and 7 % with
/// 1.3, 1.5 and 2. Of scenes with noise of 5 gray levels 71.2 % are trusted and right without it; 70.5, 70.1 and
/// 69.3 % with these.
pub const SEEN: f64 = 1.5;
/// How often an image is halved at least in search of more than noise. With 1, a tenth of the trusted pixels of
/// scenes with noise of 5 gray levels are doubted, of which three quarters are right; with 3, half as much of the
/// skies as with 2.
pub const HALVINGS: usize = 2;
/// The probability of a plane with which all agrees, and from which on a pixel is sure by itself.
pub const TRUST: f32 = 0.9;
/// Most confidence where there is no evidence: below one half nothing is trusted. Of noisy scenes 60 % of what it
/// bounds is right, of built skies 3 %.
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
