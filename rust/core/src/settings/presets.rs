//! Named sets of settings.
//!
//! Figures beside them are means of bad-1.0 (%) over the 12 scenes of the one-sided-blur suite.

use crate::error::{Error, Result};
use crate::settings::Settings;

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
}

// The preset "robust": sharp, the mean of the six blurs, and both images with noise of 5 gray levels, or JPEG of quality 70.
// Where one image is blurred, neighborhood and window are two larger than the settings say. Before, with sizes=1,
// denoise off and P1, P2 = (5, 20), the figures were 5.56 17.69 16.9 17.3.
//   as it is            5.20  17.45  12.0  12.6     P1, P2 (5, 20)  5.14  17.54  12.3  12.9
//   sizes 1             6.01  17.85  16.2  13.7     P1, P2 (7, 28)  5.27  17.37  12.0  12.4
//   denoise off       5.38  17.70  13.7  14.5     P1, P2 (4, 24)  5.17  17.76  12.4  13.1
//   neighborhood 5      6.32  18.52  12.5  13.1     P1, P2 (5, 32)  5.24  17.66  12.0  12.7
//   window 7            5.61  17.35  12.3  12.7     adaptive_p2 0.5        5.24  17.58  12.4  12.8
//   noise_threshold 0.35           5.18  17.42  12.4  12.8     adaptive_p2 2          5.27  17.42  12.0  12.6
//   noise_threshold 0.7            5.29  17.38  12.1  12.5     adaptive_p2 0          5.68  18.02  12.5  13.1
//   guided_median=False        5.56  17.98  13.0  13.3     median 0         5.44  17.61  12.3  12.8
//   speckle_size 0      5.24  17.76  12.6  12.9
// Others, before and with these: noise of 2 and 20: 10.2 -> 8.2, 41.5 -> 28.1; of 20 in one image:
// 23.5 -> 16.6; JPEG of quality 90 and 30: 10.1 -> 8.4, 31.4 -> 22.2; 4 bits: 13.6 -> 12.0; both
// after a disk of 3 px: 19.9 -> 14.5; 1 % of hot pixels: 20.1 -> 5.3; bad-0.5 of sharp pairs: 11.4
// -> 11.0.
// With synthesis, which is not in the figures above: the six blurs, Gaussian 2, 4, disk 3, 6, motion
// 9, 15, their mean, and areas blurred differently.
//   synthesis off     14.25  26.45  12.14  20.72  12.60  18.22   17.40  13.01
//   as it is            13.08  24.49  11.33  18.45  11.71  16.23   15.88  12.32
//
// The preset "fast":
//                        sharp  gauss 2  disk 3
//   as it is              10.9     19.3    17.8
//   neighborhood 7         9.1     20.2    21.5
//   window 7              11.4     20.2    18.6
//   P1, P2 (3, 12)       11.0     19.4    17.8
//   P1, P2 (4, 16)       11.2     19.6    17.9
//   adaptive_p2 0               11.5     19.8    18.4
//   adaptive_p2 1               10.9     19.5    18.0
//   median 0              11.2     19.9    18.3
//   paper                 11.4     26.2    45.6
impl Default for Settings {
    fn default() -> Self {
        Preset::Robust.settings()
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
