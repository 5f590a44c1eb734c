//! Claims of a map of the original left image -> those of the pair to match, and the conversion of results
//! back.

use crate::rectification::{Raw, warp};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::plane::Plane;

/// The claims of a map.
#[derive(Debug)]
pub struct Claims {
    /// Disparities of the pair to match, pixels; non-finite values make no claim.
    pub matched: Plane<f32>,
    /// The places of the original left pixels in a rectified image.
    places: Option<warp::RawPlaces>,
}

impl Claims {
    /// The claims of a map of images of this size, which these cameras rectified.
    pub fn new(
        map: &Plane<f32>,
        (rows, cols): (usize, usize),
        raw: Option<&Raw>,
        control: &Control,
    ) -> Result<Self> {
        if map.size() != (rows, cols) {
            let got = format!("{} x {} pixels", map.rows(), map.cols());
            let accepts = format!("the size of the images, {rows} x {cols}");
            return Err(Error::value("disparity", got, accepts));
        }
        if !map.as_slice().iter().any(|claim| claim.is_finite()) {
            let accepts = "a map in which some pixel claims a disparity";
            return Err(Error::value("disparity", "no finite value", accepts));
        }

        let Some(raw) = raw else { return Ok(Self { matched: map.clone(), places: None }) };
        let cameras = &raw.rectification.cameras;
        let (matched, places) = warp::matched(map, cameras, &raw.places(control)?[0], control)?;
        Ok(Self { matched, places: Some(places) })
    }

    /// Results about the claims, in the original left image; `nothing` where no claim was judged.
    pub fn raw<T: Copy>(&self, found: Plane<T>, nothing: T) -> Plane<T> {
        let Some(places) = &self.places else { return found };
        places.map(|place| found.as_slice().get(place.index as usize).copied().unwrap_or(nothing))
    }

    /// The same for lengths along rows, NaN where no claim was judged.
    pub fn raw_lengths(&self, found: Plane<f32>) -> Plane<f32> {
        let Some(places) = &self.places else { return found };
        places.map(|place| {
            let length = found.as_slice().get(place.index as usize).copied();
            length.unwrap_or(f32::NAN) * place.columns
        })
    }
}
