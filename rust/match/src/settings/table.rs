//! The table of settings: the one place where a setting is written. `macros.rs` documents what an entry
//! becomes.
//!
//! After a change `make settings` writes the class of Python and the glossary anew. Section and equation
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
        /// Every pixel of the neighborhood has the same weight, as in the paper; it alone costs the same
        /// whatever L is.
        "uniform": Uniform,
        /// A Gaussian of standard deviation (L - 1) / 4.
        "gaussian": Gaussian,
        /// A raised cosine that would reach zero one pixel outside the neighborhood.
        "hann": Hann,
    }

    /// Precision of aggregated costs.
    Precision {
        /// Exactly.
        "full": Full,
        /// To few enough bits that each fits a byte, which is nearly twice as fast: from the sum of each
        /// column of the window the lowest n bits are dropped, the least n for which window * (window *
        /// ceiling >> n) <= 170, the ceiling being the largest cost of one pixel; one more where only so the
        /// largest sum and P2 together fit a byte, if that leaves a largest sum of at least 80. So totals fit
        /// one, too, unless penalties are large.
        "byte": Byte,
    }

    /// Optimizer: the way from costs to disparities.
    Optimizer {
        /// One-pass dynamic programming along the row under the ordering constraint (section 2.3): from a
        /// pixel to the next the disparity stays, rises by one or drops to any smaller one.
        "dp": DynamicProgramming,
        /// Scanline optimization without the ordering constraint: the least mean of two paths along the row,
        /// from the left and from the right. Along a path the disparity stays, changes by one either way, for
        /// P1, or jumps to any other, for P2 (Hirschmüller, *Stereo Processing by Semiglobal Matching and
        /// Mutual Information*, PAMI 2008).
        "so": ScanlineOptimization,
        /// Winner-takes-all, each pixel by itself.
        "wta": WinnerTakesAll,
        /// Semi-global matching, the least mean of four such paths: from the left, the right, above and
        /// below. Those from above and below begin 16 rows outside each band of 64 rows, so that bands depend
        /// on nothing else: memory does not grow with the height, and parts of a pair are those of the whole.
        "sgm": SemiGlobal,
    }
}

settings! {
    /// Matching cost of two pixels.
    cost: CostKind, default CostKind::Phase;

    /// Side L of the square neighborhood that a phase code describes, or that `"zncc"` correlates, pixels.
    ///
    /// Larger ones resist blur better and fatten the foreground more.
    neighborhood: usize, in odd(3, 63), default 3, paper 7, fast 9;

    /// The window under the local Fourier transform.
    taper: Taper, default Taper::Uniform;

    /// Highest frequency indices (r, s) of the transform along x and y that a code has (eq. 3).
    ///
    /// Each is at most (L - 1) / 2.
    frequencies: (usize, usize), in indices(4), default (1, 1), paper (2, 1);

    /// Power k of the spectrum (eq. 3).
    ///
    /// 2 makes the codes blind to the sign flips of a symmetric blur beyond its first zero, and less
    /// discriminative.
    power: usize, in integer(1, 2), default 1;

    /// Bits b of each phase: it is quantized to 2^b levels (eq. 3).
    ///
    /// A pixel's code takes (r (2 s + 1) + s) 2^(b - 1) bits, at most 64.
    bits: usize, in integer(1, 4), default 2;

    /// Noise threshold: a part of the spectrum must exceed it to count as clear.
    ///
    /// Real and imaginary parts of up to this number of standard deviations of the image noise in them count
    /// as weak: where there is little texture their signs are noise. A weak part differs by one from a clear
    /// one, and clear ones of opposite signs by two; so a pixel's code takes twice the bits. It needs 2
    /// `bits` and phase codes, and the noise, which a match estimates unless it is given. 0: there is no such
    /// level.
    noise_threshold: f64, in number(100.0), default 0.5, paper 0.0, fast 0.0;

    /// Number of sizes of neighborhoods that a code describes.
    ///
    /// With 2 the bits of `neighborhood` are joined by those of one that is two pixels larger, of which only
    /// the components (0, 1) and (1, 0) count; these alone have the weak level. Small neighborhoods keep
    /// details, larger ones stand noise, compression and softness. It needs a `neighborhood` of 61 at most,
    /// and without a weak level takes (r (2 s + 1) + s + 2) 2^(b - 1) bits.
    sizes: usize, in integer(1, 2), default 2, paper 1, fast 1;

    /// Side of the square aggregation window, pixels.
    ///
    /// It may be larger than the image (OpenCV's `blockSize`).
    window: usize, in odd(1, 63), default 5, paper 9, fast 9;

    /// Whether the best of five windows counts, or the centered one alone.
    ///
    /// The pixel anchors them at the center, top, bottom, left and right (section 2.3).
    shiftable: bool, default false, paper true;

    /// Precision of aggregated costs.
    precision: Precision, default Precision::Byte, paper Precision::Full;

    /// Optimizer: the way from costs to disparities.
    optimizer: Optimizer, default Optimizer::SemiGlobal, paper Optimizer::DynamicProgramming,
        fast Optimizer::ScanlineOptimization;

    /// P1, what a change of disparity by one costs along a path.
    ///
    /// The unit is that of the cost, as averaged over the window (OpenCV's `P1`). With `"dp"`: what a rise by
    /// one costs. `"wta"` ignores it.
    p1: f64, in number(65_535.0), default 6.0, paper 2.0, fast 3.0;

    /// P2, what any other change of disparity costs, at least P1.
    ///
    /// The unit is that of `p1` (OpenCV's `P2`). With `precision="byte"` it also decides how coarsely costs
    /// are rounded. With `"dp"`: what a drop costs, however deep. `"wta"` ignores it.
    p2: f64, in number(65_535.0), default 24.0, paper 2.0, fast 16.0;

    /// Adaptive P2: how large a jump of the gray value lowers P2.
    ///
    /// With `"so"` and `"sgm"`: where the gray value of the left image jumps from one pixel of a path to the
    /// next by more than this multiple of the mean difference of neighbors, P2 is halved, by more than three
    /// times that, a third of it, but at least P1. 0: nowhere.
    adaptive_p2: f64, in number(1000.0), default 1.0, paper 0.0, fast 2.0;

    /// Whether the relative blur of the images is estimated, and the sharper one blurred alike.
    ///
    /// The images are blurred area by area, before they are compared; it needs phase codes. Slight blur is
    /// left, but in noise. What is left of more blur is described by larger neighborhoods: in noise, or where
    /// it is wide in all directions (a disk of 3.2 pixels), `neighborhood` and `window` are two pixels larger
    /// than said (`neighborhood` four, where all of it is Gaussian, of 2.25 pixels or more), 61 and 63 at
    /// most; with 2 `sizes` both neighborhoods grow.
    compensate_blur: bool, default true, paper false, fast false;

    /// Whether vertical offsets between the rows of the images are estimated, and the right image
    /// straightened.
    ///
    /// The estimate is a smooth field of vertical offsets (shift, turn, focal length, keystone,
    /// distortion), and a spline of the row where rows sway. Where these are significant, the right image is
    /// straightened by them, that is resampled along its columns; where they are slight, only if some bands
    /// are matched better so. Of an interlaced image whose fields are shifted the even rows alone are
    /// matched, but for parts of a pair.
    align_rows: bool, default true, paper false, fast false;

    /// Whether a pair that is too far from rectified for that is rectified by what its images show, and
    /// matched then.
    ///
    /// It is tried where small copies hardly match: turned, tilted, zoomed and toed-in cameras, lenses that
    /// distort. It is done where they match better so, and said; disparities are then x - x' of the images as
    /// they came.
    self_rectify: bool, default true, paper false, fast false;

    /// Whether impulses (hot, dead and stuck pixels, salt and pepper) are detected and repaired.
    ///
    /// They take the median of their eight neighbors before all else; it needs phase codes. An image has some
    /// if more than 4e-5 of its pixels lie beyond the range of their neighbors (without the largest and the
    /// smallest) by more than three times that range and 40 gray levels of 256; then those are repaired that
    /// do by more than it and 20. Black to white is 8 bits, the bits that values of 16 bits use, or the range
    /// of floats.
    despike: bool, default true, paper false, fast false;

    /// Whether noise and the artifacts of compression are smoothed away before the images are described.
    ///
    /// The noise of the images, and what compression in blocks (JPEG, video) has lost, are estimated; edges
    /// are kept. It needs phase codes. The weak level stays that of the noise as it was.
    denoise: bool, default true, paper false, fast false;

    /// Intensities (black, white) of the images, which set the unit of gray levels of all costs but
    /// `"phase"`.
    ///
    /// Values beyond one range below black or above white are clamped. None: 0 to 255 for values of 8 bits,
    /// of whatever type; else the range in which the pixels of both images lie, but for 0.1 % at either end.
    /// Phase codes do not depend on it.
    intensity_range: Option<(f64, f64)>, in optional(rising(1e300)), default None;

    /// Whether disparities lie between whole pixels.
    ///
    /// They are then at the tip of a V through the costs about the chosen one, corrected for what a V gets
    /// wrong, and smoothed over 7 x 7 pixels of the same surface.
    subpixel: bool, default true, paper false, fast false;

    /// Left-right check: by how many pixels the disparities of two left pixels with one match may differ.
    ///
    /// A pixel is flagged when the right pixel that was chosen for it fits another left pixel better whose
    /// disparity differs by more (OpenCV's `disp12MaxDiff`). None: no check.
    lr_check: Option<usize>, in optional(integer(0, 16_384)), default Some(1), paper None, fast None;

    /// Percent by which the second-best cost must exceed that of the chosen disparity.
    ///
    /// A pixel is flagged unless its disparity costs less by at least this percentage than the best of those
    /// more than one pixel away (OpenCV's `uniquenessRatio`). 0: no check.
    uniqueness: usize, in integer(0, 100), default 0;

    /// Most pixels of a region that is taken for a speckle.
    ///
    /// Regions of up to this size that differ from all around them are flagged (OpenCV's
    /// `speckleWindowSize`). 0: no check.
    speckle_size: usize, default 100, paper 0, fast 0;

    /// Pixels by which the disparities of neighbors in one region differ at most (OpenCV's `speckleRange`).
    speckle_range: f64, in number(16_384.0), default 1.0;

    /// Whether disparities near jumps are those that best explain the blurred image (analysis by synthesis).
    ///
    /// Where one image alone is blurred, they are taken from the map at hand, or it eroded or dilated by 4
    /// pixels, by which of them the blurred image can best be made again from the sharp one.
    synthesis: bool, default true, paper false, fast false;

    /// Whether edges in depth are aligned with those of the left image (guided median).
    ///
    /// Near a jump of the disparities a pixel takes the median of those of similar gray value; OpenCV's
    /// `ximgproc.createDisparityWLSFilter` is akin.
    guided_median: bool, default true, paper false, fast false;

    /// Side of the square over which disparities give way to their median.
    ///
    /// 0: they do not.
    median: usize, in either(0, 3), default 3, paper 0;

    /// Whether pixels that fail a check are filled from the background beside them, or left without an
    /// estimate.
    ///
    /// Those are the pixels that the left-right check, `uniqueness` or the removal of speckles flags, and
    /// with any of these also those whose match lies outside the right image; not filled, they become NaN.
    /// Without such checks nothing is filled: all estimates stay, flagged.
    fill: bool, default true;

    /// Whether confidences are computed.
    confidence: bool, default true, fast false;

    /// Least confidence of an estimate that stays in the map.
    ///
    /// Estimates of less confidence, filled ones too, become NaN and are flagged: 0.9 leaves those of which
    /// at most one in ten is expected to be off by more than 1 pixel.
    min_confidence: f64, in number(1.0), default 0.0;

    /// Whether smaller copies of the pair, and planes, decide where they are more likely to be right.
    ///
    /// Copies of half the size, a quarter and so on decide, as on plain surfaces in large images, and flat
    /// areas become planes where these are (flags `COARSE` and `INFERRED`). From 384 disparities on a copy
    /// also sets where each part of the image is searched. It needs phase codes, and confidences, which are
    /// computed for it without `confidence`, too. Parts of a pair are matched without.
    scales: bool, default true, paper false, fast false;

    /// Seconds after which a match leaves out what it can do without.
    ///
    /// Cameras are not looked for, and smaller copies and planes are left out, as far as these would end
    /// later by what the match has taken so far, and a finding reports it. The match itself is never cut
    /// short. Which parts fit depends on the machine and its load. None: as long as it takes.
    budget: Option<f64>, in optional(number(86_400.0)), default None;
}
