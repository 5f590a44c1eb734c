//! Named sets of settings.
//!
//! `phasestereo bench choices` measures them with one setting changed at a time.

use crate::error::{Error, Result};
use crate::settings::{CostKind, Optimizer, Precision, Settings, Taper};

/// A named set of settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// The default: it estimates what the pair lacks (blur, rows, impulses, noise) and compensates for it, describes
    /// two sizes of neighborhoods, searches along four paths, checks, fills and smooths.
    Robust,
    /// The method of Pedone & Heikkilä, ACIVS 2008, as published.
    Paper,
    /// For frame rates: short codes, costs in bytes, two paths along each row, no checks.
    Fast,
}

impl Preset {
    /// All of them, the default first.
    pub const ALL: [Self; 3] = [Self::Robust, Self::Paper, Self::Fast];

    /// The preset of this name.
    pub fn named(name: &str) -> Result<Self> {
        let names = || Self::ALL.map(|preset| format!("'{}'", preset.name())).join(", ");
        let found = Self::ALL.into_iter().find(|preset| preset.name() == name);

        found.ok_or_else(|| Error::value("preset", format!("'{name}'"), names()))
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Robust => "robust",
            Self::Paper => "paper",
            Self::Fast => "fast",
        }
    }

    /// Its settings.
    pub fn settings(self) -> Settings {
        match self {
            Self::Robust => robust(),
            Self::Paper => paper(),
            Self::Fast => fast(),
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Preset::Robust.settings()
    }
}

// Where one image is blurred, neighborhood and window are two larger than the settings say.
fn robust() -> Settings {
    Settings {
        neighborhood: 3,
        frequencies: (1, 1),
        noise_threshold: 0.5,
        sizes: 2,
        window: 5,
        shiftable: false,
        precision: Precision::Byte,
        optimizer: Optimizer::SemiGlobal,
        p1: 6.0,
        p2: 24.0,
        adaptive_p2: 1.0,
        compensate_blur: true,
        despike: true,
        denoise: true,
        align_rows: true,
        subpixel: true,
        lr_check: Some(1),
        speckle_size: 100,
        synthesis: true,
        guided_median: true,
        median: 3,
        scales: true,
        ..paper()
    }
}

fn paper() -> Settings {
    Settings {
        cost: CostKind::Phase,
        neighborhood: 7,
        taper: Taper::Uniform,
        frequencies: (2, 1),
        power: 1,
        bits: 2,
        noise_threshold: 0.0,
        sizes: 1,
        window: 9,
        shiftable: true,
        precision: Precision::Full,
        optimizer: Optimizer::DynamicProgramming,
        p1: 2.0,
        p2: 2.0,
        adaptive_p2: 0.0,
        compensate_blur: false,
        despike: false,
        denoise: false,
        align_rows: false,
        intensity_range: None,
        subpixel: false,
        lr_check: None,
        uniqueness: 0,
        speckle_size: 0,
        speckle_range: 1.0,
        synthesis: false,
        guided_median: false,
        median: 0,
        fill: true,
        confidence: true,
        min_confidence: 0.0,
        scales: false,
    }
}

fn fast() -> Settings {
    Settings {
        neighborhood: 9,
        frequencies: (1, 1),
        window: 9,
        shiftable: false,
        precision: Precision::Byte,
        optimizer: Optimizer::ScanlineOptimization,
        p1: 3.0,
        p2: 16.0,
        adaptive_p2: 2.0,
        median: 3,
        confidence: false,
        ..paper()
    }
}

#[cfg(test)]
mod tests {
    use super::Preset;

    #[test]
    fn presets_are_legal_and_found_by_their_names() {
        for preset in Preset::ALL {
            assert_eq!(preset.settings().check(), Ok(()), "{preset:?}");
            assert_eq!(Preset::named(preset.name()), Ok(preset));
        }
        let refused = Preset::named("best").expect_err("must be refused").to_string();
        assert_eq!(refused, "preset: got 'best'; accepts 'robust', 'paper', 'fast'");
    }
}
