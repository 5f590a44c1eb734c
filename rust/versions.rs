//! What robust matching knows about a pair beside its pixels: the noise of both images.

use crate::descriptor::check_noise;
use crate::error::Result;

/// Noise of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Versions {
    noise: [f64; 2],
}

impl Versions {
    /// The images as they are, left and right one with noise of these standard deviations, in units of the
    /// pixels.
    pub fn of_noise(noise: [f64; 2]) -> Result<Self> {
        noise.map(check_noise).into_iter().collect::<Result<Vec<_>>>()?;
        Ok(Self { noise })
    }

    /// Standard deviations of the noise of the left and of the right image, in units of the pixels.
    pub fn noise(&self) -> [f64; 2] {
        self.noise
    }
}
