//! The effects of both cameras on their images: noise, blur by area, and the relation of their gray levels,
//! from the last reliable frame.

use serde::{Deserialize, Serialize};

use crate::estimation::Estimates;
use crate::estimation::blur::Blur;
use crate::estimation::blur::psf::Psf;

/// A kind of blur.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BlurKind {
    /// The softer image: 1 left, 2 right, 0 neither.
    pub side: u8,
    /// The point-spread function, if a family explains the blur.
    pub psf: Option<Psf>,
    /// Its standard deviation along an axis, pixels.
    pub spread: f64,
}

/// Blur by area.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BlurMap {
    /// The kinds, that of the largest area first.
    pub kinds: Vec<BlurKind>,
    /// Rows and columns of tiles.
    pub tiles: (usize, usize),
    /// Side of a tile, pixels.
    pub side: usize,
    /// The kind of each tile, row after row.
    pub labels: Vec<u8>,
    /// The certainty of this, 0 to 1.
    pub certainty: f64,
}

/// The effects of both cameras on their images; pairs of values have the left one first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sensors {
    /// The frame that showed it.
    pub frame: u64,
    /// Black to white, in units of the pixels.
    pub range: f64,
    /// Standard deviations of the noise, in units of the pixels.
    pub noise: Option<[f64; 2]>,
    /// Gain and gamma of the left gray levels over the right ones, and their ratio at the right median.
    pub response: Option<[f64; 3]>,
    /// Blur by area, if it was estimated.
    pub blur: Option<BlurMap>,
}

impl Sensors {
    /// The estimates from a frame; `None`: it has none of these.
    pub fn new(found: &Estimates, frame: u64) -> Option<Self> {
        let photometry = found.photometry?;
        let response = photometry.contrast.map(|curve| [curve.gain, curve.gamma, curve.ratio]);
        let blur = found.blur.as_ref().map(|blur| BlurMap {
            kinds: blur.blurs.iter().map(BlurKind::new).collect(),
            tiles: blur.labels.size(),
            side: blur.tile,
            labels: blur.labels.as_slice().to_vec(),
            certainty: blur.certainty.into(),
        });
        let noise = found.noise();
        Some(Self { frame, range: photometry.range, noise, response, blur })
    }
}

impl BlurKind {
    fn new(blur: &Blur) -> Self {
        Self { side: blur.softer(), psf: blur.psf, spread: blur.spread() }
    }
}

impl BlurMap {
    /// The largest spread over at least this share of the tiles, pixels.
    pub fn largest(&self, least_share: f64) -> f64 {
        let tiles = |kind| self.labels.iter().filter(|label| usize::from(**label) == kind).count();
        let is_wide = |kind| tiles(kind) as f64 >= least_share * self.labels.len() as f64;
        let wide = self.kinds.iter().enumerate().filter(|(kind, _)| is_wide(*kind));
        wide.fold(0.0, |most, (_, kind)| most.max(kind.spread))
    }
}
