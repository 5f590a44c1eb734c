//! The choice between accuracy and density: which estimates of a map to use.

use super::Match;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::named::chosen;
use phasestereo_match::named;

/// The least probability of being within 1 px with which an estimate is trusted.
const TRUSTED: f32 = 0.5;

named! {
    /// Which estimates to use.
    pub enum Keep {
        /// Those that are probably within 1 px of the true disparity, with a confidence of at least 0.5. In a
        /// map without confidences: those without a flag, or none if most are wrong.
        Trusted = "trusted",
        /// Trusted ones without a flag: fewer, but more of them are right, and none is filled in.
        Checked = "checked",
        /// Every estimate.
        All = "all",
    }
}

impl Keep {
    /// The choice of this name.
    pub fn named(name: &str) -> Result<Self> {
        chosen("keep", Self::ALL, Self::name, name)
    }

    /// Whether a pixel is kept, in a map with an estimated share `wrong` of wrong disparities (NaN: unknown).
    pub fn keeps(self, disparity: f32, flags: u16, confidence: Option<f32>, wrong: f64) -> bool {
        let has_failed = wrong > 1.0 - f64::from(TRUSTED);
        let is_trusted = confidence.map_or(flags == 0 && !has_failed, |sure| sure >= TRUSTED);
        let is_chosen = match self {
            Self::Trusted => is_trusted,
            Self::Checked => is_trusted && flags == 0,
            Self::All => true,
        };
        is_chosen && disparity.is_finite()
    }
}

impl Match {
    /// The map with the disparities and error bars that a choice does not keep set to NaN.
    pub fn kept(mut self, keep: Keep) -> Self {
        for y in 0..self.disparity.rows() {
            let confidence = self.confidence.as_ref().map(|plane| plane.row(y));
            let mut bars = self.uncertainty.as_mut().map(|plane| plane.row_mut(y));
            for (x, disparity) in self.disparity.row_mut(y).iter_mut().enumerate() {
                let sure = confidence.map(|row| row[x]);
                if !keep.keeps(*disparity, self.flags.row(y)[x], sure, self.summary.wrong) {
                    *disparity = f32::NAN;
                    if let Some(bars) = &mut bars {
                        bars[x] = f32::NAN;
                    }
                }
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_found_by_name() {
        for keep in Keep::ALL {
            assert_eq!(Keep::named(keep.name()), Ok(keep));
        }
        let refused = Keep::named("sure").expect_err("no choice");
        let said = "keep: got 'sure'; accepts 'trusted', 'checked', 'all'";
        assert_eq!(refused.to_string(), said);
    }

    #[test]
    fn fewer_are_kept_where_more_is_asked() {
        let pixels = [
            ((3.0, 0, Some(0.5), 0.9), [true, true, true]),
            ((3.0, 16, Some(0.5), 0.9), [true, false, true]),
            ((3.0, 0, Some(0.49), 0.1), [false, false, true]),
            ((f32::NAN, 0, Some(0.9), 0.1), [false; 3]),
            ((3.0, 0, None, 0.5), [true, true, true]),
            ((3.0, 0, None, f64::NAN), [true, true, true]),
            ((3.0, 0, None, 0.51), [false, false, true]),
            ((3.0, 16, None, 0.1), [false, false, true]),
        ];
        for ((disparity, flags, confidence, wrong), wanted) in pixels {
            let kept = Keep::ALL.map(|keep| keep.keeps(disparity, flags, confidence, wrong));
            assert_eq!(kept, wanted, "{disparity} {flags} {confidence:?} {wrong}");
        }
    }
}
