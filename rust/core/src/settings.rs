//! The settings of the matcher: meaning, unit, range and default, checked once.

pub mod presets;
mod text;

use crate::error::{Error, Result};

/// Largest neighborhood and largest aggregation window, pixels.
pub const LARGEST_WINDOW: usize = 63;
/// Pixels by which the second size of neighborhoods is larger than the first.
pub const LARGER: usize = 2;
/// Largest frequency index of the descriptor.
pub const HIGHEST_FREQUENCY: usize = 4;
/// Most disparities that one match may search.
pub const MOST_DISPARITIES: usize = 16_384;
/// Largest noise threshold, standard deviations: a sign that is as sure as this is not noise.
pub const LARGEST_WEAK: f64 = 100.0;
/// Largest penalty, in units of the cost: it exceeds the cost of any pixel, so that larger ones change nothing.
pub const LARGEST_PENALTY: f64 = 65_535.0;
/// Largest factor of the mean difference of neighbors in `adaptive_p2`.
pub const LARGEST_EDGES: f64 = 1000.0;
/// Largest uniqueness: all of a cost, in percent.
pub const MOST_UNIQUENESS: usize = 100;
/// Largest magnitude of a float pixel and of the ends of an intensity range; products with it are finite.
pub const LARGEST_PIXEL: f64 = 1e300;

/// How two pixels are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CostKind {
    /// Hamming distance of phase codes; unit: bits.
    Phase,
    /// Sum over the channels of absolute differences; unit: gray levels, 255 over the intensity range.
    Sad,
    /// The same on channels normalized by local mean and deviation; unit: standard deviations.
    NormalizedSad,
}

/// Window under the local Fourier transform.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Taper {
    /// Every pixel of the neighborhood has the same weight: the transform of the paper.
    Uniform,
    /// Gaussian of standard deviation `(L - 1) / 4`.
    Gaussian,
    /// Raised cosine that would reach zero one pixel outside the neighborhood.
    Hann,
}

/// How costs become disparities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Optimizer {
    /// One-pass dynamic programming along the scanline under the ordering constraint.
    DynamicProgramming,
    /// The least sum of the totals of two paths along the scanline, from the left and from the right.
    ScanlineOptimization,
    /// The smallest cost of each pixel by itself.
    WinnerTakesAll,
    /// The least sum of the totals of four paths: from the left, the right, above and below.
    SemiGlobal,
}

/// How exactly aggregated costs are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// Exactly.
    Full,
    /// With as many bits of the sums over columns as let the sum over the window fit a byte.
    Byte,
}

/// The names of costs.
pub const COSTS: [(&str, CostKind); 3] =
    [("phase", CostKind::Phase), ("sad", CostKind::Sad), ("nsad", CostKind::NormalizedSad)];
/// The names of tapers.
pub const TAPERS: [(&str, Taper); 3] =
    [("uniform", Taper::Uniform), ("gaussian", Taper::Gaussian), ("hann", Taper::Hann)];
/// The names of precisions.
pub const PRECISIONS: [(&str, Precision); 2] =
    [("full", Precision::Full), ("byte", Precision::Byte)];
/// The names of optimizers.
pub const OPTIMIZERS: [(&str, Optimizer); 4] = [
    ("dp", Optimizer::DynamicProgramming),
    ("so", Optimizer::ScanlineOptimization),
    ("wta", Optimizer::WinnerTakesAll),
    ("sgm", Optimizer::SemiGlobal),
];

/// Passes the names of all settings to a macro that does something with each.
#[doc(hidden)]
#[macro_export]
macro_rules! with_every_setting {
    ($then:ident) => {
        $then! {
            cost,
            neighborhood,
            taper,
            frequencies,
            power,
            bits,
            noise_threshold,
            sizes,
            window,
            shiftable,
            precision,
            optimizer,
            p1,
            p2,
            adaptive_p2,
            compensate_blur,
            despike,
            denoise,
            align_rows,
            intensity_range,
            subpixel,
            lr_check,
            uniqueness,
            speckle_size,
            speckle_range,
            synthesis,
            guided_median,
            median,
            fill,
            confidence,
            min_confidence,
            scales,
        }
    };
}
pub use with_every_setting;

/// All settings of a match; the defaults are those of [`Preset::Robust`](presets::Preset::Robust).
///
/// Settings will be added: write those that matter, and the others as `..Settings::default()`.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "each is a choice of its own, made by name")]
pub struct Settings {
    /// How two pixels are compared.
    pub cost: CostKind,
    /// Side `L` of the square neighborhood which a code describes, pixels; odd, 3 to 63.
    pub neighborhood: usize,
    /// Window under the local Fourier transform.
    pub taper: Taper,
    /// Highest frequency indices `(r, s)` along x and y; 0 to 4, not both 0, at most `(L - 1) / 2`.
    pub frequencies: (usize, usize),
    /// Power `k` of the spectrum, 1 or 2; 2 makes codes blind to the sign flips of a blur.
    pub power: usize,
    /// Bits `b` of the phase, 1 to 4: it is quantized to `2^b` levels.
    pub bits: usize,
    /// Noise threshold. Components whose magnitude is at most this many standard deviations of what the image noise
    /// makes of them are weak: a level of its own between the two signs; 0 to 100, 0: there is no such level. It needs
    /// `bits` = 2, that is, signs, and phase codes, which it makes twice as long.
    pub noise_threshold: f64,
    /// Number of sizes of neighborhoods that a code describes, 1 or 2. The second is two pixels larger, and only the
    /// components `(1, 0)` and `(0, 1)` of it are used; these alone have a weak level then.
    pub sizes: usize,
    /// Side of the square aggregation window, pixels; odd, 1 to 63.
    pub window: usize,
    /// Whether the best of five shifted windows is taken, or the centered one alone.
    pub shiftable: bool,
    /// How exactly aggregated costs are computed.
    pub precision: Precision,
    /// How costs become disparities.
    pub optimizer: Optimizer,
    /// P1, the cost of a change of disparity by one along a path, in units of the cost, as averaged over the window; 0
    /// to
    /// 65535. With the ordering constraint, where disparities rise by one at most: the cost of a rise.
    pub p1: f64,
    /// P2, the cost of any other change of disparity; if it is less than P1, P1 is taken. With the ordering constraint:
    /// the cost of a drop, however deep.
    pub p2: f64,
    /// Adaptive P2, with [`Optimizer::ScanlineOptimization`] and [`Optimizer::SemiGlobal`]: where gray values of the
    /// left image jump from one pixel of a path to the next by more than so many times the mean difference of
    /// neighbors, P2 is halved; by more than thrice that, a third of it, but at least P1; 0 to 1000, 0: nowhere.
    pub adaptive_p2: f64,
    /// Whether the relative blur of the images is estimated and the sharper one blurred alike, for phase codes; where
    /// any is found, neighborhood and window are two pixels larger.
    pub compensate_blur: bool,
    /// Whether impulses are detected and repaired before all else, for phase codes.
    pub despike: bool,
    /// Whether noise and the artifacts of compression are smoothed away before the images are described, for phase
    /// codes.
    pub denoise: bool,
    /// Whether the rows of the images are aligned: it is estimated how they correspond, and the right image is
    /// straightened where they clearly do not; where they hardly do not, only if the match gets better by it.
    pub align_rows: bool,
    /// Intensities of black and white; `None`: the type's range for integers, a robust range for floats.
    pub intensity_range: Option<(f64, f64)>,
    /// Whether disparities are refined between candidates and smoothed over surfaces.
    pub subpixel: bool,
    /// Left-right check: pixels by which the disparities of two left pixels with one match may differ, 0 to 16384;
    /// `None`: no check.
    pub lr_check: Option<usize>,
    /// Percent by which the least cost elsewhere must exceed that of the chosen candidate, as a share of the former,
    /// 0 to 100; 0: no check.
    pub uniqueness: usize,
    /// Most pixels of a region that is taken for a speckle; 0: no check.
    pub speckle_size: usize,
    /// Pixels by which the disparities of neighbors in one region differ at most, 0 to 16384.
    pub speckle_range: f64,
    /// Whether disparities near jumps are replaced by those with which the blurred image of a pair is best synthesized.
    pub synthesis: bool,
    /// Whether edges in depth are aligned with those of the left image.
    pub guided_median: bool,
    /// Side of the median filter of disparities: 3; 0: none.
    pub median: usize,
    /// Whether pixels that fail the checks are filled from those beside them, or left without an estimate.
    pub fill: bool,
    /// Whether confidences are computed.
    pub confidence: bool,
    /// Least confidence of an estimate that stays in the map, 0 to 1.
    pub min_confidence: f64,
    /// Whether copies of half the size, a quarter ... decide where they are more likely to be right than the pair as it
    /// is, and flat areas become planes, for phase codes; where there are many disparities, a copy also tells where each
    /// panel is searched. It needs confidences.
    pub scales: bool,
}

impl Settings {
    /// Refuses a value outside its range, naming the field.
    pub fn check(&self) -> Result<()> {
        odd_between("neighborhood", self.neighborhood, 3)?;
        odd_between("window", self.window, 1)?;
        self.check_frequencies()?;
        between("power", self.power, 1, 2)?;
        between("bits", self.bits, 1, 4)?;

        self.check_weak()?;
        self.check_sizes()?;

        self.check_code_length()?;
        number_between("p1", self.p1, LARGEST_PENALTY)?;
        number_between("p2", self.p2, LARGEST_PENALTY)?;
        number_between("adaptive_p2", self.adaptive_p2, LARGEST_EDGES)?;

        // These act on phase codes only.
        let of_codes = [
            ("compensate_blur", self.compensate_blur),
            ("despike", self.despike),
            ("denoise", self.denoise),
            ("scales", self.scales),
        ];
        if let Some((name, _)) =
            of_codes.into_iter().find(|(_, is_on)| *is_on && self.cost != CostKind::Phase)
        {
            return Err(Error::value(name, "True", "False unless cost = 'phase'"));
        }

        if let Some(most) = self.lr_check {
            between("lr_check", most, 0, MOST_DISPARITIES)?;
        }
        between("uniqueness", self.uniqueness, 0, MOST_UNIQUENESS)?;
        number_between("speckle_range", self.speckle_range, MOST_DISPARITIES as f64)?;

        if !matches!(self.median, 0 | 3) {
            return Err(Error::value("median", self.median, "0 or 3"));
        }
        number_between("min_confidence", self.min_confidence, 1.0)?;
        self.check_intensity_range()
    }

    /// Number of spectral components, `D = r (2 s + 1) + s` (paper, section 2.1).
    pub fn components(&self) -> usize {
        let (r, s) = self.frequencies;
        r * (2 * s + 1) + s
    }

    /// Whether weak components have a level of their own.
    pub fn has_weak(&self) -> bool {
        self.noise_threshold > 0.0
    }

    /// Number of components of the larger neighborhood, if there is one.
    pub fn larger_components(&self) -> usize {
        let (r, s) = self.frequencies;
        if self.has_larger() { r.min(1) + s.min(1) } else { 0 }
    }

    /// Whether codes describe two sizes of neighborhoods.
    pub fn has_larger(&self) -> bool {
        self.sizes == 2
    }

    /// Side of the largest neighborhood that a code describes.
    pub fn largest_neighborhood(&self) -> usize {
        self.neighborhood + if self.has_larger() { LARGER } else { 0 }
    }

    /// Bits of one pixel's code: `2^(b-1)` for each component, twice as many where there is a weak level.
    pub fn code_length(&self) -> usize {
        let (all, larger) = (self.components(), self.larger_components());

        // With two sizes, only the components of the larger one have a weak level.
        let weak = usize::from(self.has_weak());
        if self.has_larger() {
            (all << (self.bits - 1)) + (larger << (self.bits - 1) << weak)
        } else {
            all << (self.bits - 1) << weak
        }
    }

    /// Whether any check flags pixels that cannot be right.
    pub fn has_checks(&self) -> bool {
        self.lr_check.is_some() || self.uniqueness > 0 || self.speckle_size > 0
    }

    /// Whether confidences are needed.
    pub fn needs_confidence(&self) -> bool {
        self.confidence || self.min_confidence > 0.0 || self.scales
    }

    /// Whether costs beside that of the chosen candidate are needed.
    pub fn needs_evidence(&self) -> bool {
        let checks_choices = self.lr_check.is_some() || self.uniqueness > 0;

        self.needs_confidence() || self.subpixel || checks_choices
    }

    fn check_frequencies(&self) -> Result<()> {
        let (r, s) = self.frequencies;
        let highest = HIGHEST_FREQUENCY.min((self.neighborhood - 1) / 2);

        if (r, s) != (0, 0) && r.max(s) <= highest {
            return Ok(());
        }

        let accepts = format!(
            "two integers from 0 to {highest} (at most 4 and at most (neighborhood - 1) / 2), not both 0"
        );
        Err(Error::value("frequencies", format!("({r}, {s})"), accepts))
    }

    fn check_weak(&self) -> Result<()> {
        number_between("noise_threshold", self.noise_threshold, LARGEST_WEAK)?;
        if self.has_weak() && (self.bits, self.cost) != (2, CostKind::Phase) {
            let got = format!(
                "{} with bits = {} and the cost {:?}",
                self.noise_threshold, self.bits, self.cost
            );
            return Err(Error::value(
                "noise_threshold",
                got,
                "0 unless bits = 2 and cost = 'phase'",
            ));
        }

        Ok(())
    }

    fn check_sizes(&self) -> Result<()> {
        between("sizes", self.sizes, 1, 2)?;
        if self.largest_neighborhood() > LARGEST_WINDOW {
            let got = format!("2 with neighborhood = {}", self.neighborhood);
            let accepts = format!("1 unless neighborhood is {} at most", LARGEST_WINDOW - LARGER);
            return Err(Error::value("sizes", got, accepts));
        }

        Ok(())
    }

    fn check_code_length(&self) -> Result<()> {
        let length = self.code_length();
        if length <= 64 {
            return Ok(());
        }

        let (r, s) = self.frequencies;
        let with_weak = if self.has_weak() { " and a weak level" } else { "" };
        Err(Error::value(
            "frequencies (r, s) and bits (b)",
            format!(
                "r = {r}, s = {s} and b = {}{with_weak}, which need {length} bits a pixel",
                self.bits
            ),
            "settings whose code (r (2 s + 1) + s) * 2^(b - 1), twice that with a weak level, fits in 64 bits",
        ))
    }

    fn check_intensity_range(&self) -> Result<()> {
        match self.intensity_range {
            Some((low, high)) if !(low < high && low.abs().max(high.abs()) <= LARGEST_PIXEL) => {
                Err(Error::value(
                    "intensity_range",
                    format!("({low}, {high})"),
                    format!(
                        "two numbers (black, white) of magnitude up to {LARGEST_PIXEL:e}, the first smaller"
                    ),
                ))
            }
            _ => Ok(()),
        }
    }
}

fn odd_between(argument: &'static str, value: usize, least: usize) -> Result<()> {
    if value % 2 == 1 && (least..=LARGEST_WINDOW).contains(&value) {
        return Ok(());
    }

    let accepts = format!("an odd integer from {least} to {LARGEST_WINDOW}");
    Err(Error::value(argument, value, accepts))
}

fn number_between(argument: &'static str, value: f64, most: f64) -> Result<()> {
    // The range does not contain NaN, so this refuses it, too.
    if (0.0..=most).contains(&value) {
        return Ok(());
    }

    Err(Error::value(argument, value, format!("a number from 0 to {most}")))
}

fn between(argument: &'static str, value: usize, least: usize, most: usize) -> Result<()> {
    if (least..=most).contains(&value) {
        return Ok(());
    }

    Err(Error::value(argument, value, format!("an integer from {least} to {most}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::presets::Preset;

    fn refused(change: impl FnOnce(&mut Settings)) -> String {
        let mut settings = Preset::Paper.settings();
        change(&mut settings);
        settings.check().expect_err("must be refused").to_string()
    }

    #[test]
    fn defaults_are_accepted_and_fit_sixteen_bits() {
        let settings = Preset::Paper.settings();
        assert_eq!(settings.check(), Ok(()));
        assert_eq!((settings.components(), settings.code_length()), (7, 14));
    }

    #[test]
    fn each_field_is_refused_by_its_name() {
        for value in [0, 1, 4, 65] {
            assert!(refused(|s| s.neighborhood = value).starts_with("neighborhood: got"));
        }
        for value in [0, 2, 65] {
            assert!(refused(|s| s.window = value).starts_with("window: got"));
        }
        for value in [(0, 0), (5, 0), (0, 4), (4, 1)] {
            assert!(refused(|s| s.frequencies = value).starts_with("frequencies: got"));
        }

        assert!(refused(|s| s.power = 3).starts_with("power: got 3"));
        assert!(refused(|s| s.bits = 5).starts_with("bits: got 5"));

        for value in [-0.1, 100.1, f64::NAN, f64::INFINITY] {
            assert!(refused(|s| s.noise_threshold = value).starts_with("noise_threshold: got"));
        }
        for value in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(refused(|s| s.p1 = value).starts_with("p1: got"));
            assert!(refused(|s| s.p2 = value).starts_with("p2: got"));
        }

        for value in [(1.0, 1.0), (0.0, f64::INFINITY), (f64::NAN, 1.0)] {
            assert!(refused(|s| s.intensity_range = Some(value)).starts_with("intensity_range"));
        }
    }

    #[test]
    fn a_weak_level_needs_two_bits_of_phase_and_doubles_the_code() {
        let weak =
            |bits, cost| Settings { noise_threshold: 1.0, bits, cost, ..Preset::Paper.settings() };
        assert_eq!(weak(2, CostKind::Phase).check(), Ok(()));

        assert_eq!(weak(2, CostKind::Phase).code_length(), 28);
        for (bits, cost) in [(1, CostKind::Phase), (3, CostKind::Phase), (2, CostKind::Sad)] {
            let refused = weak(bits, cost).check().expect_err("must be refused").to_string();
            assert!(refused.starts_with("noise_threshold: got 1 with bits"), "{refused}");
        }

        let refused = Settings { frequencies: (3, 2), ..weak(2, CostKind::Phase) }.check();
        let message = refused.expect_err("must be refused").to_string();
        assert!(message.contains("a weak level, which need 68 bits"), "{message}");
    }

    #[test]
    fn a_code_beyond_64_bits_names_all_three_settings() {
        let message = refused(|s| {
            s.neighborhood = 9;
            s.frequencies = (4, 4);
            s.bits = 2;
        });

        for part in ["r = 4", "s = 4", "b = 2", "80 bits"] {
            assert!(message.contains(part), "{message}");
        }
    }
}
