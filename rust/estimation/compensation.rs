//! What evens out a blur that one image alone has: the sharper one is given it, area by area.

use crate::blur::{Blur, Estimate, Side};
use crate::convolution::Kernel;
use crate::error::Result;
use crate::plane::Plane;
use crate::settings::{LARGEST_WINDOW, Settings};
use crate::versions::Versions;

/// Pixels by which neighborhoods and windows are larger where there is blur: what is left of it is described by larger ones.
pub const LARGER: usize = 2;

/// Taps that the left and the right image are convolved with; `None`: an image stays as it is.
pub type Taps = [Option<Plane<f32>>; 2];

/// What suits the noise and the blur of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Compensation {
    /// The settings, some of them larger where there is blur.
    pub settings: Settings,
    /// Standard deviations of the noise under which a component is weak, left and right.
    pub noise: [f64; 2],
    /// What each class of pixels is convolved with.
    pub kernels: Vec<Taps>,
    /// The class of every tile.
    pub labels: Plane<u8>,
    /// Side of a tile, pixels.
    pub tile: usize,
}

impl Compensation {
    /// What suits images of which this was found out; `noise` is that which is told, if any.
    pub fn new(found: &Estimate, noise: Option<[f64; 2]>, settings: &Settings) -> Result<Self> {
        let noise = noise.unwrap_or_else(|| weak_level(found));
        if !settings.equalise || found.blurs.iter().all(|blur| blur.taps.is_none()) {
            return Self::of_noise(noise, settings);
        }
        let (rows, cols, labels) = &found.labels;
        let larger = |side: usize| (side + LARGER).min(LARGEST_WINDOW);
        let settings = Settings {
            neighborhood: larger(settings.neighborhood),
            window: larger(settings.window),
            ..settings.clone()
        };
        Ok(Self {
            settings,
            noise,
            kernels: found.blurs.iter().map(kernels).collect::<Result<_>>()?,
            labels: Plane::from_vec(*rows, *cols, labels.clone())?,
            tile: found.tile,
        })
    }

    /// The images as they are, with noise of these standard deviations.
    pub fn of_noise(noise: [f64; 2], settings: &Settings) -> Result<Self> {
        let labels = Plane::new(1, 1)?;
        let settings = settings.clone();
        Ok(Self { settings, noise, kernels: vec![[None, None]], labels, tile: 1 })
    }

    /// The versions of both images in which pixels are compared.
    pub fn versions(&self) -> Result<Versions> {
        let kernel = |taps: &Option<Plane<f32>>| {
            let kernel = |taps: &Plane<f32>| Kernel::new(&taps.map(|tap| f64::from(*tap)));
            taps.as_ref().map(kernel).transpose()
        };
        let both = |[left, right]: &Taps| Ok([kernel(left)?, kernel(right)?]);
        let kernels = self.kernels.iter().map(both).collect::<Result<_>>()?;
        Versions::new(self.noise, kernels, self.labels.clone(), self.tile)
    }
}

/// What the images are convolved with: the sharper one with what it lacks.
fn kernels(blur: &Blur) -> Result<Taps> {
    let (Some(side), Some(taps)) = (blur.side, &blur.taps) else { return Ok([None, None]) };
    let values = taps.values.iter().map(|tap| *tap as f32).collect();
    let kernel = Some(Plane::from_vec(taps.side(), taps.side(), values)?);
    Ok(match side {
        Side::Left => [None, kernel],
        Side::Right => [kernel, None],
    })
}

/// The noise under which a component is weak: one level, at the contrast of each image.
///
/// The noise of the softer image is what is left in both once the sharper one is blurred; and fine texture of the sharper
/// one, which looks like noise, is not counted.
fn weak_level(found: &Estimate) -> [f64; 2] {
    let [left, right] = found.noise;
    let level = match found.blurs[0].side {
        Some(Side::Left) => left,
        Some(Side::Right) => right * found.gain,
        None => left.max(right * found.gain),
    };
    [level, level / found.gain]
}
