//! Facts about two cameras, learned while they run: the field of their rows, the range of their disparities,
//! the cameras that rectify them, which image is softer, and the history of all these.
//!
//! `crate::video::frames` matches frames with it, and updates it from each of them. It holds a few thousand
//! numbers, and the places that raw images are rectified from, and does not grow. It can be saved as text
//! ([`text`]).

pub mod changes;
pub mod columns;
pub mod events;
pub mod field;
pub mod sensors;
pub mod stopped;
pub mod text;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use self::changes::Changes;
use self::columns::Columns;
use self::events::{Events, Steady, Subject};
use self::field::FieldFilter;
use self::sensors::Sensors;
use self::stopped::Stopped;
use crate::estimation::Estimates;
use crate::estimation::blur;
use crate::estimation::raster::Raster;
use crate::rectification::Raw;
use crate::video::choices::{
    CALM_FRAMES, CHANGED_FRAMES, HEALTH_FRAMES, ILL_FROM, STRAIGHT_BELOW, STRAIGHT_FRAMES, STRAIGHTEN_ERRORS,
    STRAIGHTEN_FROM, WELL_BELOW,
};
use phasestereo_match::base::error::Result;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::settings::Settings;

/// The known facts about two cameras.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Rig {
    /// Frames so far.
    pub frames: u64,
    /// Their geometry; `None`: no frame has shown it.
    pub geometry: Option<Geometry>,
    /// The estimates of blur, noise and light, and their frame.
    #[serde(skip)]
    pub appearance: Option<Arc<Appearance>>,
    /// The effects of the cameras on their images; `None`: no frame has shown them.
    pub sensors: Option<Sensors>,
    /// Which camera has stopped.
    #[serde(skip)]
    pub stopped: Stopped,
    /// Where the left image changes.
    #[serde(skip)]
    pub changes: Changes,
    /// The events.
    pub events: Events,
    /// The share of the match that is probably wrong, over recent frames; `None`: unknown.
    pub health: Option<f64>,
    /// Which image is the softer one.
    pub soft: Option<Steady>,
    /// Whether much is wrong.
    pub ill: Option<Steady>,
    /// Frames to wait before everything is estimated again, and from which frame on.
    pub doubt: (u64, u64),
}

/// Estimates from single frames that hold until something changes.
#[derive(Debug)]
pub struct Appearance {
    /// The estimates.
    pub estimates: Estimates,
    /// How the images were read as they came: frames are resolved before anything else.
    pub rasters: [Raster; 2],
    /// The requested settings.
    pub settings: Settings,
    /// The frame.
    pub frame: u64,
}

/// The geometry of two cameras.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Geometry {
    /// Whether images are turned, since disparities are along their columns; everything else describes the
    /// turned images.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_turned: bool,
    /// Rows and columns of an image.
    pub size: (usize, usize),
    /// The places that raw images are rectified from, if they are.
    pub cameras: Option<Arc<Raw>>,
    /// The field of rows, of the rectified images.
    pub field: FieldFilter,
    /// Whether it straightens the right image.
    pub straightens: Steady,
    /// Whether rows sway, so that they are estimated in every frame.
    pub sways: Steady,
    /// The disparities.
    pub columns: Columns,
    /// Whether the images match once one of them is inverted.
    pub is_inverted: bool,
}

impl Geometry {
    /// The geometry of a pair with these estimates.
    pub fn new(pair: &Pair, found: &Estimates, cameras: Option<Arc<Raw>>) -> Self {
        let size = pair.size();
        Self {
            is_turned: pair.is_turned(),
            size,
            cameras,
            field: FieldFilter::new(size, found.offsets.as_ref()),
            straightens: Steady::new(found.alignment.is_some().into()),
            sways: Steady::new(found.sways().into()),
            columns: Columns::new(found.candidates.value),
            is_inverted: found.is_inverted,
        }
    }

    /// The field by which the right image is straightened.
    pub fn alignment(&self) -> Result<Option<Alignment>> {
        let is_used = self.straightens.state == 1 && self.sways.state == 0;
        is_used.then(|| self.field.field()).transpose()
    }

    /// Updates the field with the estimated rows of a frame. Returns whether they no longer sway.
    pub fn take_rows(&mut self, found: &Estimates) -> bool {
        self.field = FieldFilter::new(self.size, found.offsets.as_ref());
        self.straightens = Steady::new(found.alignment.is_some().into());
        self.sways.update(found.sways().into(), CALM_FRAMES).is_some()
    }

    /// Straightens from now on, if moved rows make it necessary.
    pub fn straighten_at_once(&mut self) {
        if self.field.field().is_ok_and(|field| field.rms() > STRAIGHTEN_FROM) {
            self.straightens = Steady::new(1);
        }
    }

    /// Whether the rows are to be straightened from now on.
    fn decide(&mut self) -> Option<bool> {
        if self.sways.state == 1 {
            return None;
        }
        let rms = self.field.field().map_or(0.0, |field| field.rms());
        let said = if rms > STRAIGHTEN_FROM.max(STRAIGHTEN_ERRORS * self.field.error()) {
            1
        } else if rms < STRAIGHT_BELOW {
            0
        } else {
            self.straightens.state
        };

        let patience = if said == 0 { STRAIGHT_FRAMES } else { CHANGED_FRAMES };
        self.straightens.update(said, patience).map(|_| self.straightens.state == 1)
    }
}

impl Rig {
    /// Forgets the geometry if images have another size or were not turned before, and all estimates if the
    /// settings differ.
    pub fn suit(&mut self, size: (usize, usize), is_turned: bool, settings: &Settings) {
        let is_other = |geometry: &Geometry| geometry.size != size || geometry.is_turned != is_turned;
        if self.geometry.as_ref().is_some_and(is_other) {
            let (rows, cols) = if is_turned { (size.1, size.0) } else { size };
            let along = if is_turned { ", matched along columns" } else { "" };
            let sentence = format!("images are {cols} x {rows}{along} from here on: all is learned anew");
            self.events.push(Subject::Cameras, self.frames, sentence);
            (self.geometry, self.appearance, self.health, self.sensors) = (None, None, None, None);
        }
        if self.appearance.as_ref().is_some_and(|appearance| appearance.settings != *settings) {
            self.appearance = None;
        }
    }

    /// Updates the rig with the straightening, the blur and the health of a frame.
    pub fn settle(&mut self, blur: Option<&blur::Estimate>, wrong: f64) {
        let frame = self.frames;
        if let Some(straightens) = self.geometry.as_mut().and_then(Geometry::decide) {
            let what = if straightens { "are straightened" } else { "need no straightening" };
            self.events.push(Subject::Rows, frame, format!("rows {what} from here on"));
        }

        if let Some(kind) = blur.and_then(|blur| blur.blurs.first()) {
            let side = kind.softer().into();
            let soft = self.soft.get_or_insert(Steady::new(0));
            if let Some(ago) = soft.update(side, CHANGED_FRAMES) {
                let sentence = match side {
                    1 => "the left image is the softer one",
                    2 => "the right image is the softer one",
                    _ => "both images are equally sharp again",
                };
                self.events.push(Subject::Blur, frame.saturating_sub(ago.into()), sentence);
            }
        }

        if wrong.is_nan() {
            return;
        }
        let health = self.health.map_or(wrong, |before| before + (wrong - before) / HEALTH_FRAMES);
        self.health = Some(health);
        let ill = self.ill.get_or_insert(Steady::new(0));
        let said = if wrong > ILL_FROM {
            1
        } else if wrong < WELL_BELOW {
            0
        } else {
            ill.state
        };
        if let Some(ago) = ill.update(said, CHANGED_FRAMES) {
            let what = if said == 1 { "is probably wrong" } else { "is well again" };
            let sentence = format!("the match {what}: {:.0} % wrong", 100.0 * wrong);
            self.events.push(Subject::Health, frame.saturating_sub(ago.into()), sentence);
        }
    }
}
