//! Named sets of settings.
//!
//! `phasestereo bench tables --only choices` measures them with one setting changed at a time.

use crate::base::error::{Error, Result};

/// A named set of settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// The default: it estimates what the pair lacks (blur, rows, impulses, noise) and compensates for it,
    /// describes two sizes of neighborhoods, searches along four paths, checks, fills and smooths.
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
