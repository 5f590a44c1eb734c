//! The settings of the matcher: each is written once, in the table, and checked once.

#[macro_use]
mod macros;

pub mod costs;
pub mod kind;
pub mod presets;
mod ranges;
mod table;

use crate::base::error::{Error, Result};
use crate::settings::kind::{SettingDescription, Value};

pub use self::table::{CostKind, DESCRIPTIONS, Optimizer, Precision, Settings, Taper};

/// Largest neighborhood and largest aggregation window, pixels.
pub const LARGEST_WINDOW: usize = 63;
/// Pixels by which the second neighborhood size exceeds the first.
pub const LARGER: usize = 2;
/// Most disparities that one match may search.
pub const MOST_DISPARITIES: usize = 16_384;
/// Largest magnitude of a float pixel and of the ends of an intensity range; products with it are finite.
pub const LARGEST_PIXEL: f64 = 1e300;

impl Settings {
    /// Refuses a value outside its range, naming the field.
    pub fn check(&self) -> Result<()> {
        self.check_ranges()?;

        self.check_frequencies()?;
        self.check_weak()?;
        self.check_sizes()?;
        self.check_code_length()?;

        // These act on phase codes only.
        let of_codes = [
            ("compensate_blur", self.compensate_blur),
            ("despike", self.despike),
            ("denoise", self.denoise),
            ("scales", self.scales),
        ];
        if let Some((name, _)) = of_codes.into_iter().find(|(_, is_on)| *is_on && !self.compares_codes()) {
            return Err(Error::value(name, "True", "False unless cost = 'phase'"));
        }

        Ok(())
    }

    /// Sets the field of this name from text: as Python writes it, or with lowercase "none", "true" and
    /// "false", and pairs as "0, 4095". Call [`Self::check`] afterward.
    pub fn set(&mut self, name: &str, text: &str) -> Result<()> {
        let Some(setting) = DESCRIPTIONS.iter().find(|setting| setting.name == name) else {
            let names: Vec<_> = DESCRIPTIONS.iter().map(|setting| setting.name).collect();
            return Err(Error::value("settings", format!("'{name}'"), names.join(", ")));
        };
        self.set_value(setting, &setting.kind.read(text, setting.name)?)
    }

    /// Sets a field to a value. Call [`Self::check`] afterward.
    pub fn set_value(&mut self, setting: &SettingDescription, value: &Value) -> Result<()> {
        if self.put(setting.name, value) {
            return Ok(());
        }
        Err(Error::value(setting.name, value, setting.kind))
    }

    /// Whether pixels are compared by their phase codes.
    pub fn compares_codes(&self) -> bool {
        self.cost == CostKind::Phase
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

    /// Bits of one pixel's code: `2^(b-1)` for each component, twice that with a weak level.
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

    /// Whether costs other than that of the chosen candidate are needed.
    pub fn needs_evidence(&self) -> bool {
        let checks_choices = self.lr_check.is_some() || self.uniqueness > 0;

        self.needs_confidence() || self.subpixel || checks_choices
    }

    fn check_frequencies(&self) -> Result<()> {
        let (r, s) = self.frequencies;
        let highest = (self.neighborhood - 1) / 2;
        if r.max(s) <= highest {
            return Ok(());
        }

        let got = format!("({r}, {s}) with neighborhood = {}", self.neighborhood);
        let accepts = format!("two integers up to {highest}, that is (neighborhood - 1) / 2");
        Err(Error::value("frequencies", got, accepts))
    }

    fn check_weak(&self) -> Result<()> {
        if self.has_weak() && (self.bits, self.compares_codes()) != (2, true) {
            let got =
                format!("{} with bits = {} and the cost {:?}", self.noise_threshold, self.bits, self.cost);
            return Err(Error::value("noise_threshold", got, "0 unless bits = 2 and cost = 'phase'"));
        }

        Ok(())
    }

    fn check_sizes(&self) -> Result<()> {
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
            format!("r = {r}, s = {s} and b = {}{with_weak}, which need {length} bits a pixel", self.bits),
            "settings whose code (r (2 s + 1) + s) * 2^(b - 1), twice that with a weak level, fits in 64 bits",
        ))
    }
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
    fn ranges_end_where_the_stages_say() {
        let (odd, pixel) = (LARGEST_WINDOW + 2, LARGEST_PIXEL * 1.01);
        let largest = Settings {
            neighborhood: LARGEST_WINDOW,
            window: LARGEST_WINDOW,
            lr_check: Some(MOST_DISPARITIES),
            speckle_range: MOST_DISPARITIES as f64,
            intensity_range: Some((-LARGEST_PIXEL, LARGEST_PIXEL)),
            ..Preset::Paper.settings()
        };
        assert_eq!(largest.check(), Ok(()));

        assert!(refused(|s| s.neighborhood = odd).starts_with("neighborhood: got 65"));
        assert!(refused(|s| s.window = odd).starts_with("window: got 65"));
        assert!(refused(|s| s.lr_check = Some(MOST_DISPARITIES + 1)).starts_with("lr_check: got"));
        assert!(refused(|s| s.speckle_range = 16_384.5).starts_with("speckle_range: got 16384.5"));
        assert!(refused(|s| s.intensity_range = Some((0.0, pixel))).starts_with("intensity_range"));
        assert!(refused(|s| s.p1 = f64::NAN).starts_with("p1: got NaN"));
    }

    #[test]
    fn every_setting_is_read_from_its_text_and_described() {
        for preset in Preset::ALL {
            let settings = preset.settings();
            let mut read = Settings::default();
            for (setting, value) in DESCRIPTIONS.iter().zip(settings.values()) {
                let text = value.to_string().replace('\'', "");
                assert_eq!(read.set(setting.name, &text), Ok(()));

                let (summary, _) = setting.documentation.split_once("\n\n").unwrap_or_default();
                let summary = if summary.is_empty() { setting.documentation } else { summary };
                assert!(summary.trim().ends_with('.'), "{}: {summary}", setting.name);
            }
            assert_eq!(read, settings);
        }
    }

    #[test]
    fn texts_are_read_as_in_python_or_in_small_letters() {
        let mut settings = Settings::default();
        for (name, text) in [("intensity_range", "0, 4095"), ("fill", "false"), ("lr_check", "none")] {
            assert_eq!(settings.set(name, text), Ok(()));
        }
        assert_eq!(settings.intensity_range, Some((0.0, 4095.0)));
        assert_eq!((settings.fill, settings.lr_check), (false, None));

        let message = |name, text| Settings::default().set(name, text).expect_err("refused").to_string();
        for (name, text, expected) in [
            ("cost", "ssd", "cost: got 'ssd'; accepts 'phase', 'sad', 'nsad', 'zncc'"),
            ("fill", "yes", "fill: got 'yes'; accepts True or False"),
            ("frequencies", "2", "frequencies: got '2'; accepts a pair of integers"),
            ("lr_check", "-1", "lr_check: got '-1'; accepts an integer that is not negative or None"),
            ("p1", "one", "p1: got 'one'; accepts a number"),
        ] {
            assert_eq!(message(name, text), expected);
        }
        assert!(message("windows", "5").starts_with("settings: got 'windows'; accepts cost, "));
    }

    #[test]
    fn a_value_of_another_kind_is_refused() {
        let fill = DESCRIPTIONS.iter().find(|setting| setting.name == "fill").expect("a setting");
        let refused = Settings::default().set_value(fill, &Value::Integer(1));
        let message = refused.expect_err("must be refused").to_string();
        assert_eq!(message, "fill: got 1; accepts True or False");
    }

    #[test]
    fn a_weak_level_needs_two_bits_of_phase_and_doubles_the_code() {
        let weak = |bits, cost| Settings { noise_threshold: 1.0, bits, cost, ..Preset::Paper.settings() };
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
