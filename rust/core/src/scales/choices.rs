//! The constants of planes and of image detail that are not derived: each with its unit, and the measurement
//! that chose it. Built skies are 24 pairs of textured houses in front of a plain sky at disparity 0, each
//! with noise of 0.6, 1.5 and 3 gray levels, and as JPEG.

/// Pixels on either side in the mean that an image is compared with: a box as wide as a Gaussian of 2 px.
pub const SMOOTH_RADIUS: usize = 3;
/// Pixels on either side over which detail is averaged.
pub const DETAIL_RADIUS: usize = 4;
/// Standard deviation of rounding, in steps: the square root of 1/12.
pub const ROUNDING: f64 = 0.288_675_134_594_812_9;
/// Multiple of the noise variance from which detail is more than noise; mean squares of 81 pixels of noise
/// have a standard deviation of 0.2. On built skies with noise, 14.5 % are trusted and wrong without it; 8.7,
/// 8.0 and 7.6 % with 1.3, 1.5 and 2. On scenes with noise of 5 gray levels, 71.2 % are trusted and right
/// without it; 70.5, 70.1 and 69.3 % with these.
pub const SEEN: f64 = 1.5;
/// Fewest halvings of an image in search of more than noise. With windows of 5 x 5 and 1 halving, a tenth of
/// the trusted pixels of scenes with noise of 5 gray levels are doubted, and three quarters of these are
/// right; with 3, half as much of the skies is doubted as with 2.
pub const HALVINGS: usize = 2;
/// The probability of a plane with which everything agrees, and the confidence from which a pixel is sure by
/// itself.
pub const TRUST: f32 = 0.9;
/// Most confidence without evidence: below one half nothing is trusted. Of the pixels that it bounds, 60 %
/// are right on noisy scenes, 3 % on built skies.
pub const UNSEEN: f32 = 0.4;
/// Rms steps of rounding up to which there is hardly any detail: 1.7 times that of rounding. Only if an area
/// has no plane by all of its pixels: a bound by detail in every area would remove the planes of Monopoly.
pub const FAINT: f64 = 0.5;
/// Share of the weight that agrees with a plane, above which it is drawn; the second: where faint pixels do
/// not count.
pub const LEAST_AGREEING: [f32; 2] = [0.5, 0.6];
/// Pixels around an area, from and to, in which its surface may continue.
pub const OUTSIDE: [usize; 2] = [4, 14];
/// Pixels of disparity: a surface that continues there is nearer the plane than this.
pub const GOES_ON: f32 = 2.0;
/// Share of all pixels there that are sure and near the plane, above which the outline belongs to something
/// in front of the area: below 0.4 around six table tops, up to 0.41 around the largest area of a sheet of
/// plastic, 0.52 to 0.72 around built skies.
pub const OCCLUDER: f64 = 0.45;
/// Pixels from those that agree with a plane within which it still has evidence.
pub const EVIDENCE_REACH: usize = 4;
