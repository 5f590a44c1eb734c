//! The share of wrong pixels of a map without confidences, estimated from a few rows.
//!
//! Costs other than that of the chosen candidate take a fifth of the time of a fast match. One row in
//! `SAMPLE_PERIOD` represents the map as a whole, and its confidences use [`CONFIDENCE_RADIUS`] rows on
//! either side, so these rows are weighed:
//!
//! ```text
//! weighed: rows of the whole image with y mod SAMPLE_PERIOD at most CONFIDENCE_RADIUS from MIDDLE
//! wrong  = 1 - mean calibrated confidence of pixels with a disparity, where y mod SAMPLE_PERIOD = MIDDLE
//! ```

use std::borrow::Cow;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::simd::Level;
use crate::choices::{CONFIDENCE_RADIUS, SAMPLE_PERIOD};
use crate::image::texture::Texture;
use crate::pair::candidates::Candidates;
use crate::refinement::calibration::{ConfidenceCalibration, Faults, STEPS, Tally, Weights, traits};
use crate::refinement::confidence::VotedMap;
use crate::settings::Optimizer;

/// The first sampled row.
const MIDDLE: usize = SAMPLE_PERIOD / 2;

/// Whether the costs of this row of a whole image are needed.
pub fn is_weighed(y: usize) -> bool {
    (y % SAMPLE_PERIOD).abs_diff(MIDDLE) <= CONFIDENCE_RADIUS
}

/// A map whose weighed rows have votes.
#[derive(Debug, Clone, Copy)]
pub struct SampledMap<'a> {
    /// Disparities, pixels; NaN: none.
    pub disparity: &'a Plane<f32>,
    /// Bits of [`crate::refinement::flag`].
    pub flags: &'a Plane<u16>,
    /// Votes for the disparities, from 0 to 1.
    pub votes: &'a Plane<f32>,
    /// Gray values of the left image.
    pub texture: &'a Texture<'a>,
}

impl SampledMap<'_> {
    /// The estimated share of its disparities that are off by more than 1 px; `None`: no row is sampled.
    pub fn wrong(
        self,
        candidates: Candidates,
        faults: Faults,
        optimizer: Optimizer,
        level: Level,
        control: &Control,
    ) -> Result<Option<f64>> {
        let last = self.disparity.rows().saturating_sub(CONFIDENCE_RADIUS);
        let rows = (MIDDLE..last).step_by(SAMPLE_PERIOD);

        let mut tally = Tally::default();
        let mut sampled = vec![];
        for y in rows {
            let confidence = self.confidences(y, level, control)?;
            let disparity = Plane::from_vec(1, confidence.cols(), self.disparity.row(y).to_vec())?;
            let flags = Plane::from_vec(1, confidence.cols(), self.flags.row(y).to_vec())?;

            let row = [&confidence, &disparity].map(Plane::as_slice);
            tally = tally.and(Tally::new(row[0], row[1], flags.as_slice(), candidates));
            sampled.push((confidence, disparity, flags));
        }

        let calibration = ConfidenceCalibration::new(&traits(tally, faults), Weights::of(optimizer));
        let (mut right, mut count) = (0u64, 0u64);
        for (mut confidence, disparity, flags) in sampled {
            calibration.apply(&mut confidence, &disparity, &flags, level)?;
            for (confidence, disparity) in confidence.as_slice().iter().zip(disparity.as_slice()) {
                right += u64::from((confidence * STEPS) as u32);
                count += u64::from(!disparity.is_nan());
            }
        }

        Ok((count > 0).then(|| 1.0 - right as f64 / f64::from(STEPS) / count as f64))
    }

    /// The raw confidences of a row.
    fn confidences(&self, y: usize, level: Level, control: &Control) -> Result<Plane<f32>> {
        let cols = self.disparity.cols();
        let rows = 2 * CONFIDENCE_RADIUS + 1;
        let places = (y - CONFIDENCE_RADIUS) * cols..(y - CONFIDENCE_RADIUS + rows) * cols;
        let around =
            |plane: &Plane<f32>| Plane::from_vec(rows, cols, plane.as_slice()[places.clone()].to_vec());

        let gray = Plane::from_vec(rows, cols, self.texture.gray.as_slice()[places.clone()].to_vec())?;
        let texture = Texture { gray: Cow::Owned(gray), roughness: self.texture.roughness };
        let (disparity, votes) = (around(self.disparity)?, around(self.votes)?);

        let mut confidence = Plane::new(rows, cols)?;
        let map = VotedMap { disparity: &disparity, votes: &votes, texture: &texture };
        map.confidences(&mut confidence, level, control)?;
        Ok(confidence.of_rows(CONFIDENCE_RADIUS..CONFIDENCE_RADIUS + 1))
    }
}
