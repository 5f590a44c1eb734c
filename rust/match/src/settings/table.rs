//! The table of settings, the only place where a setting is defined. `macros.rs` documents how entries
//! expand.
//!
//! After a change, `make settings` regenerates the Python class and the glossary. Section and equation
//! numbers are those of the paper (see the crate).

use crate::base::error::Result;
use crate::settings::costs::costs;
use crate::settings::kind::{Kind, Setting, SettingDescription, Value};
use crate::settings::presets::Preset;
use crate::settings::ranges::{either, indices, integer, number, odd, optional, rising};

costs!(words);

words! {
    /// Window under the local Fourier transform.
    Taper {
        /// Every pixel of the neighborhood has the same weight, as in the paper. Only this one costs the same
        /// for every L.
        "uniform": Uniform,
        /// A Gaussian of standard deviation (L - 1) / 4.
        "gaussian": Gaussian,
        /// A raised cosine that would reach zero one pixel outside the neighborhood.
        "hann": Hann,
    }

    /// Precision of aggregated costs.
    Precision {
        /// Exact.
        "full": Full,
        /// Rounded to fit a byte each, which is nearly twice as fast. The sum of each column of the window
        /// drops its lowest n bits: the smallest n for which window * (window * ceiling >> n) <= 170, where
        /// the ceiling is the largest cost of one pixel. It drops one more if the largest sum and P2 together
        /// fit a byte only then, and the largest sum stays at least 80. Totals then fit a byte too, unless
        /// penalties are large.
        "byte": Byte,
    }

    /// Optimizer: how costs become disparities.
    Optimizer {
        /// One-pass dynamic programming along the row under the ordering constraint (section 2.3): from one
        /// pixel to the next the disparity stays, rises by one, or drops to any smaller one.
        "dp": DynamicProgramming,
        /// Scanline optimization without the ordering constraint: the minimum of the mean of two paths along
        /// the row, from the left and from the right. Along a path the disparity stays, changes by one either
        /// way at cost P1, or jumps to any other at cost P2 (Hirschmüller, *Stereo Processing by Semiglobal
        /// Matching and Mutual Information*, PAMI 2008).
        "so": ScanlineOptimization,
        /// Winner-takes-all: each pixel by itself.
        "wta": WinnerTakesAll,
        /// Semi-global matching: the minimum of the mean of four such paths, from the left, the right, above
        /// and below. Paths from above and below begin 16 rows outside each band of 64 rows, so each band
        /// depends on nothing else: memory does not grow with the height, and a part of a pair matches as it
        /// does in the whole.
        "sgm": SemiGlobal,
    }
}

settings! {
    /// Matching cost of two pixels.
    cost: CostKind, default CostKind::Phase;

    /// Side L of the square neighborhood that a phase code describes or `"zncc"` correlates, pixels.
    ///
    /// Larger ones resist blur better and fatten the foreground more.
    neighborhood: usize, in odd(3, 63), default 3, paper 7, fast 9;

    /// The window under the local Fourier transform.
    taper: Taper, default Taper::Uniform;

    /// Highest frequency indices (r, s) of the transform along x and y in a code (eq. 3).
    ///
    /// Each is at most (L - 1) / 2.
    frequencies: (usize, usize), in indices(4), default (1, 1), paper (2, 1);

    /// Power k of the spectrum (eq. 3).
    ///
    /// 2 makes the codes blind to the sign flips of a symmetric blur beyond its first zero, but less
    /// discriminative.
    power: usize, in integer(1, 2), default 1;

    /// Bits b of each phase: it is quantized to 2^b levels (eq. 3).
    ///
    /// A pixel's code takes (r (2 s + 1) + s) 2^(b - 1) bits, at most 64.
    bits: usize, in integer(1, 4), default 2;

    /// Noise threshold: a part of the spectrum must exceed it to count as clear.
    ///
    /// Real and imaginary parts of up to this many standard deviations of their image noise count as weak:
    /// where there is little texture, their signs are noise. A weak part differs by one from a clear one, and
    /// clear ones of opposite signs by two, so a pixel's code takes twice the bits. It needs 2 `bits`, phase
    /// codes, and the noise, which a match estimates unless it is given. 0: no weak level.
    noise_threshold: f64, in number(100.0), default 0.5, paper 0.0, fast 0.0;

    /// Number of neighborhood sizes that a code describes.
    ///
    /// With 2, a neighborhood two pixels larger adds its bits to those of `neighborhood`. Of the larger one
    /// only the components (0, 1) and (1, 0) count, and only these have the weak level. Small neighborhoods
    /// keep details; larger ones resist noise, compression and softness. It needs a `neighborhood` of 61 at
    /// most, and without a weak level takes (r (2 s + 1) + s + 2) 2^(b - 1) bits.
    sizes: usize, in integer(1, 2), default 2, paper 1, fast 1;

    /// Side of the square aggregation window, pixels.
    ///
    /// It may be larger than the image (OpenCV's `blockSize`).
    window: usize, in odd(1, 63), default 5, paper 9, fast 9;

    /// Whether the best of five windows counts, or only the centered one.
    ///
    /// The pixel is at their center, top, bottom, left and right (section 2.3).
    shiftable: bool, default false, paper true;

    /// Precision of aggregated costs.
    precision: Precision, default Precision::Byte, paper Precision::Full;

    /// Optimizer: how costs become disparities.
    optimizer: Optimizer, default Optimizer::SemiGlobal, paper Optimizer::DynamicProgramming,
        fast Optimizer::ScanlineOptimization;

    /// P1: the cost of a change of disparity by one along a path.
    ///
    /// The unit is that of the cost, averaged over the window (OpenCV's `P1`). With `"dp"`, the cost of a
    /// rise by one. `"wta"` ignores it.
    p1: f64, in number(65_535.0), default 6.0, paper 2.0, fast 3.0;

    /// P2: the cost of any other change of disparity, at least P1.
    ///
    /// The unit is that of `p1` (OpenCV's `P2`). With `precision="byte"`, it also decides how coarsely costs
    /// are rounded. With `"dp"`, the cost of a drop of any depth. `"wta"` ignores it.
    p2: f64, in number(65_535.0), default 24.0, paper 2.0, fast 16.0;

    /// Adaptive P2: how large a jump of the gray value lowers P2.
    ///
    /// With `"so"` and `"sgm"`: where the gray value of the left image changes from one pixel of a path to
    /// the next by more than this multiple of the mean difference of neighbors, P2 is halved; by more than
    /// three times that, it is divided by three. It stays at least P1. 0: never lowered.
    adaptive_p2: f64, in number(1000.0), default 1.0, paper 0.0, fast 2.0;

    /// Whether to estimate the relative blur of the images, and blur the sharper one to match.
    ///
    /// The images are blurred area by area before they are compared; it needs phase codes. Slight blur is
    /// left, except in noise. Larger neighborhoods cope with the rest of stronger blur: in noise, or if it is
    /// wide in all directions (a disk of 3.2 pixels), `neighborhood` and `window` are two pixels larger than
    /// set (`neighborhood` four if the blur is all Gaussian, of 2.25 pixels or more), up to 61 and 63. With 2
    /// `sizes`, both neighborhoods grow.
    compensate_blur: bool, default true, paper false, fast false;

    /// Whether to estimate vertical offsets between the rows of the images, and straighten the right image.
    ///
    /// The estimate is a smooth field of vertical offsets (shift, turn, focal length, keystone, distortion),
    /// and a spline of the row if rows sway. If the offsets are significant, the right image is straightened:
    /// resampled along its columns. If they are slight, it is only if some bands match better that way. If
    /// the fields of an interlaced image are shifted, only its even rows are matched, and the raw mosaic of a
    /// color sensor is smoothed, except in parts of a pair.
    align_rows: bool, default true, paper false, fast false;

    /// Whether to rectify a pair whose rows are too far off to straighten, from its images, before it is
    /// matched.
    ///
    /// It is tried if small copies hardly match: turned, tilted, zoomed and toed-in cameras, lenses that
    /// distort. It is kept if they match better, and a finding reports it; disparities are then x - x' of the
    /// original images.
    self_rectify: bool, default true, paper false, fast false;

    /// Whether to detect and repair impulses (hot, dead and stuck pixels, salt and pepper).
    ///
    /// Before anything else, they take the median of their eight neighbors; it needs phase codes. An image
    /// has impulses if more than 4e-5 of its pixels lie beyond the range of their neighbors (without the
    /// largest and the smallest) by more than three times that range plus 40 gray levels of 256; then pixels
    /// beyond it by more than that range plus 20 levels are repaired. Black to white is 8 bits, the bits that
    /// 16-bit values use, or the range of floats.
    despike: bool, default true, paper false, fast false;

    /// Whether to smooth away noise and compression artifacts before the images are described.
    ///
    /// The noise of the images and the loss from block compression (JPEG, video) are estimated; edges are
    /// kept. It needs phase codes. The weak level stays that of the original noise.
    denoise: bool, default true, paper false, fast false;

    /// Intensities (black, white) of the images, which set the unit of gray levels for all costs but
    /// `"phase"`.
    ///
    /// Values more than one range below black or above white are clamped. None: 0 to 255 for 8-bit values of
    /// any type; else the range of the pixels of both images, without 0.1 % at either end. Phase codes do not
    /// depend on it.
    intensity_range: Option<(f64, f64)>, in optional(rising(1e300)), default None;

    /// Whether disparities lie between whole pixels.
    ///
    /// They are then at the tip of a V through the costs around the chosen one, corrected for the error of a
    /// V, and smoothed over 7 x 7 pixels of the same surface.
    subpixel: bool, default true, paper false, fast false;

    /// Left-right check: most pixels by which the disparities of two left pixels with one match may differ.
    ///
    /// A pixel is flagged if the right pixel chosen for it fits another left pixel better whose disparity
    /// differs by more (OpenCV's `disp12MaxDiff`). None: no check.
    lr_check: Option<usize>, in optional(integer(0, 16_384)), default Some(1), paper None, fast None;

    /// Percent of the second-best cost by which that of the chosen disparity must be lower.
    ///
    /// A pixel is flagged unless its disparity costs less, by at least this percentage, than the best of
    /// those more than one pixel away (OpenCV's `uniquenessRatio`). 0: no check.
    uniqueness: usize, in integer(0, 100), default 0;

    /// Largest region that counts as a speckle, pixels.
    ///
    /// Regions of up to this size that differ from everything around them are flagged (OpenCV's
    /// `speckleWindowSize`). 0: no check.
    speckle_size: usize, default 100, paper 0, fast 0;

    /// Most pixels by which the disparities of neighbors in one region differ (OpenCV's `speckleRange`).
    speckle_range: f64, in number(16_384.0), default 1.0;

    /// Whether to choose the disparities near jumps that best explain the blurred image (analysis by
    /// synthesis).
    ///
    /// If only one image is blurred, they come from the current map, or from it eroded or dilated by 4
    /// pixels, whichever best reproduces the blurred image from the sharp one.
    synthesis: bool, default true, paper false, fast false;

    /// Whether to align depth edges with those of the left image (guided median).
    ///
    /// Near a jump of the disparities, a pixel takes the median of those of similar gray value; OpenCV's
    /// `ximgproc.createDisparityWLSFilter` is similar.
    guided_median: bool, default true, paper false, fast false;

    /// Side of the square median filter over disparities.
    ///
    /// 0: no filter.
    median: usize, in either(0, 3), default 3, paper 0;

    /// Whether pixels that fail a check are filled from the background beside them, or left without an
    /// estimate.
    ///
    /// These are the pixels that the left-right check, `uniqueness` or the speckle filter flags, and with any
    /// of these also those whose match lies outside the right image. If not filled, they become NaN. Without
    /// such checks nothing is filled: all estimates stay, flagged.
    fill: bool, default true;

    /// Whether to compute confidences.
    confidence: bool, default true, fast false;

    /// Lowest confidence of an estimate that stays in the map.
    ///
    /// Estimates of lower confidence, including filled ones, become NaN and are flagged: with 0.9, at most
    /// one in ten of the others is expected to be off by more than 1 pixel.
    min_confidence: f64, in number(1.0), default 0.0;

    /// Whether smaller copies of the pair, and planes, decide where they are more likely to be right.
    ///
    /// Copies of half the size, a quarter and so on may be right on plain surfaces in large images; flat
    /// areas may become planes (flags `COARSE` and `INFERRED`). With 384 or more disparities, a copy also
    /// sets where each part of the image is searched. It needs phase codes and confidences, which are
    /// computed for it even without `confidence`. Parts of a pair are matched without it.
    scales: bool, default true, paper false, fast false;

    /// Seconds after which a match skips optional parts.
    ///
    /// The search for cameras, smaller copies and planes are skipped if they would end later, judging by the
    /// time taken so far, and a finding reports it. The match itself is never cut short. Which parts fit
    /// depends on the machine and its load. None: no limit.
    budget: Option<f64>, in optional(number(86_400.0)), default None;
}
