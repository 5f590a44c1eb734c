//! The plan that compensates estimated noise and blur: area by area, the sharper image receives the blur of
//! the other.

use crate::estimation::blur::taps::Taps;
use crate::estimation::blur::{Blur, Estimate, Side};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::settings::{LARGEST_PIXEL, LARGEST_WINDOW, Settings};

/// Pixels by which neighborhoods and windows grow if there is more than a narrow blur: larger ones describe
/// the remaining texture.
pub const LARGER: usize = 2;
/// Pixels by which neighborhoods grow where all blur is wide
/// ([`Psf::is_wide`](super::blur::psf::Psf::is_wide)).
///
/// They pay off if nothing finer is left in any direction.
pub const MUCH_LARGER: usize = 4;

/// At this share of the range or more, only larger neighborhoods withstand noise, or equivalent harm from
/// compression. Then even a slight blur is worth compensating: the fine texture that this costs is lost in
/// noise.
const NOISY: f64 = 0.008;
/// Standard deviation, pixels, of a narrow blur in its narrowest direction. Without noise it leaves fine
/// texture in that direction, or in all, and larger neighborhoods make less of it. This holds for motions of
/// any length, and disks of radius 3.
const NARROW: f64 = 1.6;

/// Standard deviations of the noise that are smoothed away. Fewer leave more of noise and compression, and
/// harm sharp pairs hardly less.
const DEVIATIONS: f64 = 2.0;

/// The kernels that the left and the right image are convolved with; `None`: the image stays unchanged.
pub type KernelPair = [Option<Plane<f32>>; 2];

/// The settings and kernels adapted to the noise and the blur of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct CompensationPlan {
    /// The settings, with larger neighborhoods and windows if there is blur.
    pub settings: Settings,
    /// Standard deviations of the noise under which a component is weak, left and right.
    pub noise: [f64; 2],
    /// The least height of impulses, left and right; 0: there are none.
    pub impulses: [f64; 2],
    /// Standard deviations for smoothing the left and the right image; 0: not smoothed.
    pub smoothing: [f64; 2],
    /// The kernels of each class of pixels.
    pub kernels: Vec<KernelPair>,
    /// The class of every tile.
    pub labels: Plane<u8>,
    /// Side of a tile, pixels.
    pub tile: usize,
}

impl CompensationPlan {
    /// The plan for an estimate; `noise` is the known noise, if any, and `range` white minus black, in units
    /// of the pixels.
    pub fn new(
        estimate: &Estimate,
        noise: Option<[f64; 2]>,
        range: f64,
        settings: &Settings,
    ) -> Result<Self> {
        let plain = Self {
            impulses: if settings.despike { estimate.impulses } else { [0.0; 2] },
            smoothing: if settings.denoise { smoothing(estimate, noise) } else { [0.0; 2] },
            ..Self::of_noise(noise.unwrap_or_else(|| weak_level(estimate)), settings)?
        };

        let harm = estimate.harm(plain.noise).into_iter().fold(0.0, f64::max);
        let is_noisy = harm >= NOISY * range;
        let mut blurs = estimate.blurs.iter().filter(|blur| blur.taps.is_some()).peekable();
        let is_slight = estimate.blurs.iter().all(Blur::is_slight);
        if !settings.compensate_blur || blurs.peek().is_none() || (is_slight && !is_noisy) {
            return Ok(plain);
        }

        // The larger of two neighborhood sizes has to stay within the limit, too.
        let largest = LARGEST_WINDOW - (settings.largest_neighborhood() - settings.neighborhood);
        let growth = match () {
            () if is_slight || (!is_noisy && blurs.clone().all(is_narrow)) => 0,
            () if blurs.all(is_wide) => MUCH_LARGER,
            () => LARGER,
        };
        let settings = Settings {
            neighborhood: (settings.neighborhood + growth).min(largest),
            window: (settings.window + growth.min(LARGER)).min(LARGEST_WINDOW),
            ..settings.clone()
        };

        Ok(Self {
            settings,
            kernels: estimate.blurs.iter().map(kernels).collect::<Result<_>>()?,
            labels: estimate.labels.clone(),
            tile: estimate.tile,
            ..plain
        })
    }

    /// A plan that leaves the images unchanged, with noise of these standard deviations.
    pub fn of_noise(noise: [f64; 2], settings: &Settings) -> Result<Self> {
        Ok(Self {
            settings: settings.clone(),
            noise,
            impulses: [0.0; 2],
            smoothing: [0.0; 2],
            kernels: vec![[None, None]],
            labels: Plane::new(1, 1)?,
            tile: 1,
        })
    }

    /// The blur compensation of a match.
    pub fn blur_compensation(&self) -> Result<BlurCompensation> {
        let kernel = |taps: &Option<Plane<f32>>| {
            let kernel = |taps: &Plane<f32>| Kernel::new(&taps.map(|tap| f64::from(*tap)));
            taps.as_ref().map(kernel).transpose()
        };

        let both = |[left, right]: &KernelPair| Ok([kernel(left)?, kernel(right)?]);
        let kernels = self.kernels.iter().map(both).collect::<Result<_>>()?;

        let compensation = BlurCompensation::new(self.noise, kernels, self.labels.clone(), self.tile)?;
        compensation.with_impulses(self.impulses)?.with_smoothing(self.smoothing)
    }
}

fn is_narrow(blur: &Blur) -> bool {
    let is_narrow = |taps: &Taps| taps.least_spread() < NARROW;
    blur.other.is_none() && blur.taps.as_ref().is_none_or(is_narrow)
}

fn is_wide(blur: &Blur) -> bool {
    blur.other.is_none() && blur.psf.is_some_and(|psf| psf.is_wide())
}

/// The kernels of a class: each image is convolved with the blur that it is missing.
fn kernels(blur: &Blur) -> Result<KernelPair> {
    let (Some(side), Some(taps)) = (blur.side, &blur.taps) else {
        return Ok([None, None]);
    };

    let kernel = |taps: &Taps| {
        let values = taps.values.iter().map(|tap| *tap as f32).collect();
        Plane::from_vec(taps.side(), taps.side(), values)
    };
    let for_sharper = Some(kernel(taps)?);
    let for_softer = blur.other.map(|psf| kernel(&psf.taps())).transpose()?;

    Ok(match side {
        Side::Left => [for_softer, for_sharper],
        Side::Right => [for_sharper, for_softer],
    })
}

/// The standard deviations for smoothing both images: each by its own noise, and by the loss from
/// compression.
///
/// If one image is softer, fine texture of the sharper one looks like noise: then the level at which
/// components are weak is used. `known` is the known noise.
fn smoothing(estimate: &Estimate, known: Option<[f64; 2]>) -> [f64; 2] {
    let is_blurred = estimate.blurs.iter().any(|blur| blur.side.is_some());
    let own = if is_blurred { weak_level(estimate) } else { estimate.noise };

    estimate.harm(known.unwrap_or(own)).map(|harm| (DEVIATIONS * harm).min(LARGEST_PIXEL))
}

/// The noise below which a component is weak: the same level for both images, scaled by the contrast of each.
///
/// The noise of the softer image is the noise that remains in both once the sharper one is blurred. The noise
/// of the sharper one would include fine texture, which looks like noise.
fn weak_level(estimate: &Estimate) -> [f64; 2] {
    let [left, right] = estimate.noise;
    let level = match estimate.blurs[0].side {
        Some(Side::Left) => left,
        Some(Side::Right) => right * estimate.gain,
        None => left.max(right * estimate.gain),
    };

    [level, level / estimate.gain]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::blur::psf::Psf;

    /// The plan for areas blurred by these functions, beside areas without blur, and noise of this standard
    /// deviation in gray levels.
    fn plan(psfs: &[Psf], noise: f64) -> CompensationPlan {
        let blurs = psfs.iter().map(|psf| Blur::of(Side::Left, *psf)).chain([Blur::NONE]);
        let estimate = Estimate { blurs: blurs.collect(), noise: [noise; 2], ..Estimate::unknown((16, 16)) };

        let settings = Settings { noise_threshold: 0.0, sizes: 1, ..Settings::default() };
        CompensationPlan::new(&estimate, None, 255.0, &settings).expect("legal")
    }

    /// Neighborhood and window of such a plan.
    fn sizes(psfs: &[Psf], noise: f64) -> (usize, usize) {
        let settings = plan(psfs, noise).settings;
        (settings.neighborhood, settings.window)
    }

    #[test]
    fn slight_blur_is_left_as_it_is_but_in_noise() {
        for slight in [Psf::gaussian(0.9), Psf::disk(1.4)] {
            assert_eq!(plan(&[slight], 1.0).kernels, [[None, None]]);
            let kernels = plan(&[slight], 3.0).kernels;
            assert!(kernels[0][0].is_none() && kernels[0][1].is_some(), "the right one is sharper");
            assert_eq!(sizes(&[slight], 3.0), (3, 5));
        }
        assert_eq!(plan(&[], 3.0).kernels, [[None, None]]);
    }

    #[test]
    fn neighborhoods_grow_with_blur_that_is_wide_in_all_directions_and_in_noise() {
        for narrow in [Psf::gaussian(1.3), Psf::disk(3.0), Psf::motion(15.0, 30.0)] {
            assert_eq!(sizes(&[narrow], 1.0), (3, 5));
            assert!(plan(&[narrow], 1.0).kernels[0][1].is_some());
            assert_eq!(sizes(&[narrow], 3.0), (5, 7));
        }
        for more in [Psf::gaussian(2.0), Psf::disk(4.0)] {
            assert_eq!(sizes(&[more], 1.0), (5, 7));
            assert_eq!(sizes(&[more, Psf::motion(5.0, 30.0)], 1.0), (5, 7));
        }
    }

    #[test]
    fn only_wide_gaussians_take_much_larger_neighborhoods() {
        assert_eq!(sizes(&[], 1.0), (3, 5));
        assert_eq!(sizes(&[Psf::gaussian(2.5)], 1.0), (7, 7));
        assert_eq!(sizes(&[Psf::gaussian(2.5), Psf::gaussian(4.0)], 1.0), (7, 7));
        for other in [Psf::gaussian(2.0), Psf::disk(4.0), Psf::motion(9.0, 30.0)] {
            assert_eq!(sizes(&[Psf::gaussian(4.0), other], 1.0), (5, 7));
        }
    }
}
