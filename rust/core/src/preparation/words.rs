//! The changes made to a pair for other matchers, in sentences.

use super::channels::Channels;
use crate::estimation::raster::Raster;
use crate::estimation::shared::Shared;
use crate::match_pair::Treatment;
use crate::preparation::back::Back;
use phasestereo_match::pair::blur_compensation::BlurCompensation;

/// The right image alone.
const RIGHT: [bool; 2] = [false, true];

/// The changes: each sentence, and the images it applies to.
pub struct WorkDone(Vec<([bool; 2], String)>);

impl WorkDone {
    /// The changes to a pair.
    pub fn new(ready: Treatment, channels: &Channels, back: &Back, is_converted: bool) -> Self {
        let mut work = Self(vec![]);
        let estimates = &ready.prepared.estimates;
        let pair = &ready.prepared.pair;
        if is_converted {
            work.add(RIGHT, "the right image has the pixel type and the white of the left one".into());
        }
        if let Some(fit) = pair.fit() {
            let ((a, b), (c, d)) = (fit.from, fit.to);
            work.add(RIGHT, format!("the right image is resampled from {b} x {a} to {d} x {c} pixels"));
        }
        match estimates.shared {
            Some((Shared::Pattern, _)) => {
                work.add([true; 2], "the pattern that both images share is subtracted".into());
            }
            Some((Shared::Crosstalk(share), _)) => {
                work.add([true; 2], format!("crosstalk of {:.0} % is subtracted", 100.0 * share));
            }
            None => {}
        }
        work.add_rasters(ready.rasters);
        if ready.raw.is_some() {
            work.add([true; 2], "both images are rectified by what they show".into());
            work.add_rasters(estimates.rasters);
        }
        if channels.is_inverted {
            work.add(RIGHT, "the right image is inverted, since it is a negative".into());
        }
        let impulses = pair.blur_compensation().map_or([0.0; 2], BlurCompensation::impulses);
        work.add_to(impulses.map(|height| height > 0.0), "impulses are removed from {}");
        if let Some(field) = &estimates.alignment {
            let most = field.bound();
            work.add(RIGHT, format!("rows of the right image are aligned, by up to {most:.1} px"));
        }
        work.add_to(channels.smoothing.map(|by| by > 0.0), "noise is smoothed in {}");
        for (side, name, other) in [(0, "left", "right"), (1, "right", "left")] {
            if channels.kernels(side).iter().any(Option::is_some) {
                let what = format!("the {name} image is blurred like the {other} one");
                work.add([side == 0, side == 1], format!("{what}, where that one is softer"));
            }
        }
        if let Some(tone) = channels.tone {
            let (gain, gamma) = (tone.curve.gain, tone.curve.gamma);
            let what = "gray levels of the right image become those of the left one";
            work.add(RIGHT, format!("{what}: {gain:.2} x right ^ {gamma:.2}, black 0 to white 1"));
        }
        match back.shift() {
            0 => {}
            by if by > 0 => work
                .add([true; 2], format!("disparities are {by} px larger: columns are added to both images")),
            by => work.add(
                [true; 2],
                format!("disparities are {} px smaller: columns are cut off both images", -by),
            ),
        }
        if back.factor() > 1 {
            work.add([true; 2], format!("both images are reduced by {}", back.factor()));
        }
        work
    }

    /// Whether the left (0) or the right (1) image is changed.
    pub fn changes(&self, side: usize) -> bool {
        self.0.iter().any(|(sides, _)| sides[side])
    }

    /// The sentences.
    pub fn sentences(self) -> Vec<String> {
        self.0.into_iter().map(|(_, sentence)| sentence).collect()
    }

    fn add(&mut self, sides: [bool; 2], sentence: String) {
        self.0.push((sides, sentence));
    }

    /// What was done about fields and mosaics.
    fn add_rasters(&mut self, rasters: [Raster; 2]) {
        let are = |which: Raster| rasters.map(|raster| raster == which);
        self.add_to(are(Raster::Fields), "odd rows of {} are means of the even ones beside them");
        self.add_to(are(Raster::Mosaic), "the mosaic of {} is smoothed");
    }

    /// A sentence about the images that it applies to, if any.
    fn add_to(&mut self, sides: [bool; 2], sentence: &str) {
        let which = match sides {
            [false, false] => return,
            [true, false] => "the left image",
            [false, true] => "the right image",
            [true, true] => "both images",
        };
        self.add(sides, sentence.replace("{}", which));
    }
}
