//! Named sets of settings.
//!
//! `phasestereo bench tables --only choices` measures them with one setting changed at a time.

use crate::base::error::Result;
use crate::base::named::chosen;
use crate::named;

named! {
    /// A named set of settings.
    pub enum Preset {
        /// The default: it estimates blur, row offsets, impulses and noise and compensates for them,
        /// describes two sizes of neighborhoods, searches along four paths, checks, fills and smooths.
        Robust = "robust",
        /// The method of Pedone & Heikkilä, ACIVS 2008, as published.
        Paper = "paper",
        /// For frame rates: short codes, costs in bytes, two paths along each row, no checks.
        Fast = "fast",
    }
}

impl Preset {
    /// The preset of this name.
    pub fn named(name: &str) -> Result<Self> {
        chosen("preset", Self::ALL, Self::name, name)
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
