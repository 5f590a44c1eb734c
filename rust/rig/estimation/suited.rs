//! Settings -> the settings that suit what was found of a pair: larger neighborhoods, larger penalties and smoother surfaces
//! where single pixels say less.
//!
//! Each image has noise, a loss by coding, and texture that is smeared or not. What both have counts; what one image alone
//! has is compensated as its blur is, or does not outweigh the other one:
//!
//! ```text
//! harm  = max(noise, 1.5 * loss of coding, 7 if 4/5 of the texture are smeared)     # gray levels of 8 bits, of the lesser image
//! share = (harm - 3) / 4, 0 to 2, in eighths
//! p1, p2 = 6 + 2 share, 24 + 16 share
//! smoothing_reach = 5 if share > 0, or the loss of coding is 1 or more, or a blur is compensated
//! neighborhood += 2 if smeared or noise >= 7
//! ```
//!
//! A blur of one image that is compensated needs larger neighborhoods and windows, too: they describe what is left of the
//! texture, and average what noise and coding add to it. A slight blur without those does not.
//!
//! A fault changes only settings that have the values of the default preset: others are somebody's choice.

use crate::rig::blur::{Blur, Estimate};
use crate::rig::photometry::Photometry;
use crate::rig::psf::{Family, Psf};
use crate::settings::presets::Preset;
use crate::settings::{LARGEST_WINDOW, Settings};

/// Pixels by which neighborhoods and windows grow where there is blur: larger ones describe what is left of the texture.
pub const LARGER: usize = 2;
/// Pixels by which neighborhoods grow where all blur is Gaussian, of at least [`WIDE`].
///
/// They pay off where nothing finer is left in any direction. Wrong pixels of twelve scenes with 2 and with 4 pixels
/// more, in %: Gaussian 1.5: 10.9, 11.2; 2: 13.5, 13.5; 2.5: 16.7, 16.1; 3: 20.0, 19.0; 4: 26.5, 24.7; disk 3: 11.6,
/// 12.2; disk 6: 18.2, 18.4; motion 15: 15.8, 16.4.
pub const MUCH_LARGER: usize = 4;
/// Standard deviation of a wide Gaussian, pixels.
pub const WIDE: f64 = 2.25;
/// Noise of the softer image, or loss of coding of either, up to which ...
const CLEAN: f64 = 0.5;
/// ... a blur of less spread than this, pixels, needs no larger neighborhoods. Means of bad-1.0 (%) over 12 scenes and over
/// 8 of large planes, with larger ones and without: disk 1.35: 7.7, 6.7; 15.4, 14.3; disk 2: 8.5, 7.7; 19.1, 18.2; disk 3:
/// 10.4, 9.5; 23.3, 22.8. With noise of one gray level: disk 1.35: 8.4, 7.8; 19.3, 20.2; disk 3: 11.6, 11.4; 26.0, 26.7.
const SLIGHT: f64 = 2.0;

/// Harm up to which penalties stay as they are: fine texture of sharp images looks like noise of up to 2.8.
const HARMLESS: f64 = 3.0;
/// Harm beyond that for one step of [`STEP`].
const PER_STEP: f64 = 4.0;
/// P1 and P2 rise by so much a step ...
const STEP: [f64; 2] = [2.0, 16.0];
/// ... and by so many steps at most.
const MOST_STEPS: f64 = 2.0;
/// Penalties rise in so many parts of a step.
const PARTS: f64 = 8.0;
/// The noise that asks for the penalties which a loss of coding of 1 asks for.
const OF_CODING: f64 = 1.5;
/// Share of smeared texture from which on an image is soft.
const SOFT: f64 = 0.8;
/// The noise that asks for the penalties which soft images ask for.
const OF_SOFT: f64 = 7.0;
/// Noise from which on neighborhoods grow.
const NOISY: f64 = 7.0;
/// Loss of coding from which on surfaces are smoothed farther.
const CODED: f64 = 1.0;
/// How far they are smoothed, pixels.
const FARTHER: usize = 5;

/// What both images of a pair suffer from.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Faults {
    /// Standard deviation of the noise, gray levels of 8 bits.
    noise: f64,
    /// That of a noise that would do as much harm as the loss of coding, likewise.
    coding: f64,
    /// Whether their texture is smeared.
    is_soft: bool,
}

/// The settings that suit a pair; `noise` is the known noise, if any.
pub fn suited(
    found: &Estimate,
    noise: Option<[f64; 2]>,
    photometry: &Photometry,
    settings: &Settings,
) -> Settings {
    let gray_level = photometry.range / 255.0;
    let noise = noise.unwrap_or(found.noise).map(|noise| noise / gray_level);
    let of_both = |values: [f64; 2]| values[0].min(values[1]);

    let faults = Faults {
        noise: of_both(noise),
        coding: of_both(found.coding) / gray_level,
        is_soft: photometry.smeared.iter().all(|share| *share >= SOFT),
    };
    let none: &[Blur] = &[];
    let blurs = if settings.compensate_blur { &found.blurs } else { none };
    let blurs: Vec<&Blur> = blurs.iter().filter(|blur| blur.taps.is_some()).collect();

    let coding = found.coding[0].max(found.coding[1]) / gray_level;
    let grain = noise.map(|noise| noise.max(coding));
    faults.suited(settings, !blurs.is_empty(), growth(&blurs, grain))
}

/// The settings of the largest demand of memory that suit any pair.
#[cfg(feature = "c")]
pub fn most_demanding(settings: &Settings) -> Settings {
    let faults = Faults { noise: f64::INFINITY, coding: f64::INFINITY, is_soft: true };
    let growth = if settings.compensate_blur { [MUCH_LARGER, LARGER] } else { [0; 2] };
    faults.suited(settings, settings.compensate_blur, growth)
}

impl Faults {
    /// The settings that suit these faults, and a blur, if one is compensated, for which neighborhoods and windows grow by
    /// so much.
    fn suited(
        self,
        settings: &Settings,
        is_blurred: bool,
        [neighborhood, window]: [usize; 2],
    ) -> Settings {
        let usual = Preset::Robust.settings();
        let mut suited = settings.clone();
        let mut wider = neighborhood;

        if settings.denoise {
            let share = self.share();
            let penalties = |of: &Settings| [of.p1, of.p2].map(f64::to_bits);
            if penalties(settings) == penalties(&usual) {
                suited.p1 += STEP[0] * share;
                suited.p2 += STEP[1] * share;
            }
            if settings.smoothing_reach == usual.smoothing_reach
                && (is_blurred || self.blunts(share))
            {
                suited.smoothing_reach = FARTHER;
            }
            if settings.neighborhood == usual.neighborhood && (self.is_soft || self.noise >= NOISY)
            {
                wider = wider.max(LARGER);
            }
        }

        // The larger one of two sizes of neighborhoods has to stay within the limit, too.
        let largest = LARGEST_WINDOW - (settings.largest_neighborhood() - settings.neighborhood);
        suited.neighborhood = (settings.neighborhood + wider).min(largest);
        suited.window = (settings.window + window).min(LARGEST_WINDOW);
        suited
    }

    /// By how many steps penalties rise.
    fn share(self) -> f64 {
        let soft = if self.is_soft { OF_SOFT } else { 0.0 };
        let harm = self.noise.max(OF_CODING * self.coding).max(soft);

        let steps = ((harm - HARMLESS) / PER_STEP).clamp(0.0, MOST_STEPS);
        (steps * PARTS).floor() / PARTS
    }

    /// Whether offsets between candidates are worse than those of sharp pairs.
    fn blunts(self, share: f64) -> bool {
        share > 0.0 || self.coding >= CODED
    }
}

/// Pixels by which neighborhoods and windows grow for the sake of these blurs, where noise and coding do so much harm in
/// gray levels.
fn growth(blurs: &[&Blur], grain: [f64; 2]) -> [usize; 2] {
    let is_slight = |blur: &&Blur| {
        let is_clean = blur.side.is_some_and(|softer| grain[softer.index()] < CLEAN);
        let spread = |psf: Psf| psf.spread() < SLIGHT;
        is_clean && blur.other.is_none() && blur.psf.is_some_and(spread)
    };
    // Without any blur, too.
    if blurs.iter().all(is_slight) {
        return [0; 2];
    }

    let neighborhood = if blurs.iter().all(|blur| is_wide(blur)) { MUCH_LARGER } else { LARGER };
    [neighborhood, LARGER]
}

fn is_wide(blur: &Blur) -> bool {
    blur.other.is_none()
        && blur.psf.is_some_and(|psf| psf.family == Family::Gaussian && psf.size >= WIDE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::blur::Side;

    const NONE: Faults = Faults { noise: 0.0, coding: 0.0, is_soft: false };

    /// Of usual settings: neighborhood, window, penalties, reach.
    fn changed(faults: Faults) -> (usize, usize, f64, f64, usize) {
        let found = faults.suited(&Settings::default(), false, [0; 2]);
        (found.neighborhood, found.window, found.p1, found.p2, found.smoothing_reach)
    }

    fn noise(noise: f64) -> Faults {
        Faults { noise, ..NONE }
    }

    fn coding(coding: f64) -> Faults {
        Faults { coding, ..NONE }
    }

    #[test]
    fn what_is_as_slight_as_in_sharp_pairs_changes_nothing() {
        for faults in [NONE, noise(3.0), coding(0.9)] {
            let usual = Settings::default();
            assert_eq!(faults.suited(&usual, false, [0; 2]), usual, "{faults:?}");
        }
    }

    #[test]
    fn settings_change_step_by_step_with_what_is_found() {
        assert_eq!(changed(noise(5.0)), (3, 5, 7.0, 32.0, 5));
        assert_eq!(changed(noise(6.99)), (3, 5, 7.75, 38.0, 5));
        assert_eq!(changed(noise(7.0)), (5, 5, 8.0, 40.0, 5));
        assert_eq!(changed(noise(1e9)), (5, 5, 10.0, 56.0, 5));

        assert_eq!(changed(coding(1.0)), (3, 5, 6.0, 24.0, 5));
        assert_eq!(changed(coding(4.0)), (3, 5, 7.5, 36.0, 5));
        assert_eq!(changed(Faults { is_soft: true, ..NONE }), (5, 5, 8.0, 40.0, 5));
        assert_eq!(changed(Faults { is_soft: true, ..noise(9.0) }), (5, 5, 9.0, 48.0, 5));
    }

    #[test]
    fn what_somebody_chose_stays() {
        let faults = Faults { is_soft: true, ..noise(20.0) };
        let chosen = Settings { neighborhood: 9, p1: 6.0, p2: 30.0, ..Settings::default() };
        let found = faults.suited(&chosen, false, [0; 2]);
        assert_eq!(found, Settings { smoothing_reach: 5, ..chosen });

        let off = Settings { denoise: false, ..Settings::default() };
        assert_eq!(faults.suited(&off, true, [0; 2]), off);
    }

    #[test]
    fn a_blur_asks_for_no_more_beside_a_fault_and_stays_within_the_limit() {
        let usual = Settings::default();
        let found = noise(20.0).suited(&usual, true, [LARGER, LARGER]);
        assert_eq!((found.neighborhood, found.window), (5, 7));

        let large = Settings { neighborhood: 59, window: 63, ..usual };
        let found = NONE.suited(&large, true, [MUCH_LARGER, LARGER]);
        assert_eq!((found.neighborhood, found.window), (61, 63));
    }

    /// Growth for blurs of the left image of these families and sizes, with so much noise in it.
    fn grown(kinds: &[(Family, f64)], noise: f64) -> [usize; 2] {
        let blur = |&(family, size): &(Family, f64)| {
            let psf = Psf::round(family, size);
            Blur { side: Some(Side::Left), psf: Some(psf), taps: Some(psf.taps()), other: None }
        };
        let blurs: Vec<Blur> = kinds.iter().map(blur).collect();
        growth(&blurs.iter().collect::<Vec<_>>(), [noise, 9.0])
    }

    #[test]
    fn only_wide_gaussians_take_much_larger_neighborhoods() {
        assert_eq!(grown(&[], 1.0), [0, 0]);
        assert_eq!(grown(&[(Family::Gaussian, 2.5)], 1.0), [4, 2]);
        assert_eq!(grown(&[(Family::Gaussian, 2.5), (Family::Gaussian, 4.0)], 1.0), [4, 2]);

        for other in [(Family::Gaussian, 2.0), (Family::Disk, 4.0), (Family::Motion, 9.0)] {
            assert_eq!(grown(&[other], 1.0), [2, 2]);
            assert_eq!(grown(&[(Family::Gaussian, 4.0), other], 1.0), [2, 2]);
        }
    }

    #[test]
    fn slight_blurs_of_clean_images_take_no_larger_neighborhoods() {
        assert_eq!(grown(&[(Family::Disk, 3.0)], 0.4), [0, 0]);
        assert_eq!(grown(&[(Family::Disk, 3.0)], 0.6), [2, 2]);
        assert_eq!(grown(&[(Family::Disk, 4.5)], 0.4), [2, 2]);
        assert_eq!(grown(&[(Family::Disk, 3.0), (Family::Disk, 4.5)], 0.4), [2, 2]);
        assert_eq!(grown(&[(Family::Gaussian, 2.5)], 0.4), [4, 2]);
    }
}
