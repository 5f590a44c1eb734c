//! Go or no-go: the quantities of a rig against limits, for example at the end of a production line or at the
//! start of a robot.
//!
//! The usual limits are those at which a match triggers a warning (the tables of findings), if there are such
//! limits. An unknown quantity passes, unless its limit was given, or nothing can be concluded without it.

use crate::finding::Topic;
use crate::findings::choices::{BLUR_SHARE, SURE};
use crate::findings::{levels_of, most_wrong};
use crate::video::choices::DRIFT_FRAMES;
use crate::video::rig::Rig;
use crate::video::rig::field::FieldFilter;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::math;

/// The checked quantities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// How far rows are from corresponding.
    Rows,
    /// The uncertainty of that.
    Error,
    /// The speed at which it changes.
    Drift,
    /// The rotation of the right camera against its calibration.
    Rotation,
    /// Pixels that are probably wrong.
    Wrong,
    /// Disparities beyond the nearest thing.
    Reserve,
    /// Noise of the worse image.
    Noise,
    /// How many times brighter one image is.
    Exposure,
    /// Blur of one image relative to the other.
    Blur,
}

impl Quantity {
    /// All quantities.
    pub const ALL: [Self; 9] = [
        Self::Rows,
        Self::Error,
        Self::Drift,
        Self::Rotation,
        Self::Wrong,
        Self::Reserve,
        Self::Noise,
        Self::Exposure,
        Self::Blur,
    ];

    /// Its name, its unit, and its description.
    pub fn words(self) -> [&'static str; 3] {
        match self {
            Self::Rows => ["rows", "px", "rows that do not correspond, root mean square"],
            Self::Error => ["error", "px", "standard error of the rows"],
            Self::Drift => ["drift", "px in 100 frames", "rows that change from frame to frame"],
            Self::Rotation => ["rotation", "degrees", "pitch and roll against the calibration"],
            Self::Wrong => ["wrong", "of the pixels", "share that is probably wrong"],
            Self::Reserve => ["reserve", "px", "disparities beyond the nearest thing"],
            Self::Noise => ["noise", "of the range", "noise of the worse image"],
            Self::Exposure => ["exposure", "times", "brightness of one image beside the other"],
            Self::Blur => ["blur", "px", "blur of one image beside the other, root mean square"],
        }
    }

    /// The usual limit: the maximum, or for the reserve the minimum.
    pub fn usual(self) -> f64 {
        match self {
            Self::Rows => levels_of(Topic::Alignment)[1],
            // A third of the value at which matches begin to suffer.
            Self::Error => 0.1,
            // Enough to straighten or bend a pair within ten seconds.
            Self::Drift => levels_of(Topic::Alignment)[0],
            // At a focal length of 860 pixels, rows are then off by as much as they may be.
            Self::Rotation => 0.05,
            Self::Wrong => most_wrong(),
            // The two neighbors that determine a fraction of a pixel.
            Self::Reserve => 2.0,
            Self::Noise => levels_of(Topic::Noise)[1],
            Self::Exposure => math::exp(levels_of(Topic::Contrast)[1]),
            Self::Blur => levels_of(Topic::Blur)[1],
        }
    }

    /// Whether nothing can be concluded without it.
    fn is_needed(self) -> bool {
        matches!(self, Self::Rows | Self::Error | Self::Wrong)
    }

    /// The value for a rig; `None`: unknown. `focal` is the focal length in pixels, if the calibration has
    /// it.
    fn of(self, rig: &Rig, focal: Option<f64>) -> Option<f64> {
        let geometry = rig.geometry.as_ref();
        let field = geometry.map(|geometry| &geometry.field);
        let field = field.filter(|field| field.is_seen());
        let sensors = rig.sensors.as_ref();

        match self {
            Self::Rows => field?.field().ok().map(|field| field.rms()),
            Self::Error => field.map(FieldFilter::error),
            Self::Drift if rig.frames < DRIFT_FRAMES => None,
            Self::Drift => field.map(|field| 100.0 * field.drift()),
            Self::Rotation => field.zip(focal).map(|(field, focal)| field.rotation(focal)),
            Self::Wrong => rig.health,
            Self::Reserve => geometry?.columns.reserve().map(|left| left as f64),
            Self::Noise => {
                let sensors = sensors?;
                sensors.noise.map(|[left, right]| left.max(right) / sensors.range)
            }
            Self::Exposure => sensors?.response.map(|[_, _, ratio]| ratio.max(ratio.recip())),
            Self::Blur => {
                let blur = sensors?.blur.as_ref();
                blur.filter(|blur| blur.certainty >= SURE.into()).map(|blur| blur.largest(BLUR_SHARE))
            }
        }
    }
}

/// A quantity against its limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Check {
    /// The quantity.
    pub quantity: Quantity,
    /// The measured value; `None`: unknown.
    pub value: Option<f64>,
    /// The limit.
    pub limit: f64,
    /// Whether it is within the limit; `None`: unknown, and not needed.
    pub passed: Option<bool>,
}

/// Compares all quantities of a rig with their limits: those given by name, or the usual ones.
pub fn check(rig: &Rig, given: &[(String, f64)], focal: Option<f64>) -> Result<Vec<Check>> {
    let names = Quantity::ALL.map(|quantity| quantity.words()[0]);
    for (given, limit) in given {
        let Some(name) = names.into_iter().find(|name| name == given) else {
            let accepts = format!("limits of {}", names.join(", "));
            return Err(Error::value("limits", format!("'{given}'"), accepts));
        };
        if !(limit.is_finite() && *limit >= 0.0) {
            return Err(Error::value(name, limit, "a finite number that is not negative"));
        }
    }
    if let Some(focal) = focal.filter(|focal| !(focal.is_finite() && *focal > 0.0)) {
        return Err(Error::value("focal", focal, "a positive number of pixels"));
    }

    let check = |quantity: Quantity| {
        let given = given.iter().find(|(name, _)| name == quantity.words()[0]);
        let limit = given.map_or(quantity.usual(), |(_, limit)| *limit);
        let value = quantity.of(rig, focal);

        let is_within = |value: f64| {
            if quantity == Quantity::Reserve { value >= limit } else { value <= limit }
        };
        let is_needed = given.is_some() || quantity.is_needed();
        let passed = value.map(is_within).or(is_needed.then_some(false));
        Check { quantity, value, limit, passed }
    };
    Ok(Quantity::ALL.map(check).to_vec())
}
