//! The interface of the crate: whole matches of images given as slices, on persistent threads.

#[cfg(feature = "ndarray")]
mod arrays;
#[cfg(feature = "image")]
mod decoded;
pub mod image;
pub mod keep;
pub mod rig;

use std::ops::Range;
use std::sync::Arc;

use ndarray::Axis;

use self::image::Image;
use self::rig::Rig;
use crate::estimation::facts::{Direction, Fact, Facts};
use crate::estimation::{Estimates, Prepared};
use crate::finding::{Finding, Topic};
use crate::findings;
use crate::match_pair::{Matched, Rectified, diagnosed, match_pair};
use crate::preparation::back::Back;
use crate::preparation::{Preparation, prepared_for_others};
use crate::rectification::calibration::{Calibration, Sizes};
use crate::rectification::warp::Interpolation;
use crate::rectification::{rectify_views, warp};
use crate::third_camera::{LeftCamera, Registered, ThirdCamera, register};
use crate::verification;
use crate::video::frames::{self, Options};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::pixels::Input;
use phasestereo_match::matcher::footprint;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::summary::Summary;
use phasestereo_match::matcher::{self, Disparity, Execution, Timings, usable_threads};
use phasestereo_match::optimization::engine::Engine;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::pair::fitting::resized_right;
use phasestereo_match::pair::plan::{Demand, Plan};
use phasestereo_match::settings::Settings;

/// Settings, threads and working memory, kept from one pair to the next. Any number of threads may use one
/// matcher at the same time.
#[derive(Debug)]
pub struct Matcher {
    core: matcher::Matcher,
    settings: Settings,
    threads: usize,
    axis: Option<Direction>,
}

/// A disparity map as seen from the left image, and the findings about it.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Match {
    /// Disparity, pixels: left pixel (x, y) corresponds to right pixel (x - d, y). NaN: none.
    pub disparity: Plane<f32>,
    /// Bits of [`crate::flag`].
    pub flags: Plane<u16>,
    /// Confidence from 0 to 1; `None`: not computed.
    pub confidence: Option<Plane<f32>>,
    /// Half the width of the interval that holds the true disparity with a probability of 90 %, pixels; NaN
    /// without an estimate. `None`: not computed.
    pub uncertainty: Option<Plane<f32>>,
    /// How many pairs of a rig support each disparity, 1 to 8; `None`: not filtered over time.
    pub support: Option<Plane<u8>>,
    /// Shares of the pixels, and their mean confidence.
    pub summary: Summary,
    /// Noteworthy findings about the match, the worst first.
    pub findings: Vec<Finding>,
    /// The estimates from the pair.
    pub estimates: Estimates,
    /// The result for a pair that was too far from rectified; `None`: the pair was matched as it is.
    pub rectified: Option<Rectified>,
    /// Wall-clock time of each stage.
    pub timings: Timings,
}

/// The verdict of the images on a disparity map.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Verification {
    /// Codes of [`crate::verdict`].
    pub verdicts: Plane<u8>,
    /// The disparity of the library's own match where the claim is refuted, NaN elsewhere.
    pub better: Plane<f32>,
    /// The probability, 0 to 1, that the claim is within 1 px of the true disparity; 0 without a claim.
    pub confidence: Plane<f32>,
    /// The error bar of the claim, pixels: it holds 90 % of the errors; NaN without a claim.
    pub uncertainty: Plane<f32>,
    /// Findings about the map as a whole, worst first.
    pub findings: Vec<Finding>,
    /// The library's own match.
    pub own: Match,
}

/// A pair that any other matcher can use.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct PreparedPair {
    /// Left and right image, of one size and type; disparities begin at 0.
    pub images: [Image; 2],
    /// The changes, in sentences; empty: none.
    pub done: Vec<String>,
    /// Number of disparities, starting at 0.
    pub num_disparities: usize,
    /// Noteworthy findings about the pair.
    pub findings: Vec<Finding>,
    back: Back,
}

impl PreparedPair {
    /// Converts a disparity map of the prepared pair to the original left image, in pixels; non-finite values
    /// are missing. A map of another size is in its own pixels.
    pub fn restore(&self, map: &Plane<f32>) -> Result<Plane<f32>> {
        self.back.restored(map, &Control::default())
    }

    /// Rows and columns of the original left image.
    pub fn size(&self) -> (usize, usize) {
        self.back.size()
    }
}

impl Matcher {
    /// A matcher with these settings and this many threads, from 1 to 1024; `None`: the number in the
    /// environment variable `RAYON_NUM_THREADS`, or else all processors available to the process.
    pub fn new(settings: Settings, threads: impl Into<Option<usize>>) -> Result<Self> {
        settings.check()?;

        let threads = threads.into().unwrap_or_else(usable_threads);
        Ok(Self { core: matcher::Matcher::new(threads)?, settings, threads, axis: None })
    }

    /// Sets whether the right camera is below the left one, `true`, or beside it, `false`; `None`: below if a
    /// pair shows it clearly.
    pub fn with_vertical(self, vertical: Option<bool>) -> Self {
        let axis = vertical.map(|is| if is { Direction::Columns } else { Direction::Rows });
        Self { axis, ..self }
    }

    /// Sets an engine that searches instead of the processor, with identical bits; the processor searches
    /// whatever the engine does not support.
    pub fn with_engine(self, engine: Arc<dyn Engine>) -> Self {
        Self { core: self.core.with_engine(engine), ..self }
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The number of threads.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Matches two rectified images over a half-open range of disparities, at least 1 and at most the number
    /// of columns of the left image; `None`: the range is estimated. A right image of another size is scaled
    /// to that of the left one. Images that are far from rectified are rectified first, if the settings allow
    /// it and the images show how.
    pub fn match_pair(
        &self,
        left: Image,
        right: Image,
        disparities: impl Into<Option<Range<i64>>>,
    ) -> Result<Match> {
        self.match_controlled(left, right, disparities, &Control::default())
    }

    /// The map of the right image: right pixel (x, y) corresponds to left pixel (x + d, y). It is the map of
    /// the exchanged, mirrored pair, mirrored back, and all estimates are of that pair. It takes the same
    /// arguments as [`Self::match_pair`], and the same time again.
    pub fn match_right(
        &self,
        left: Image,
        right: Image,
        disparities: impl Into<Option<Range<i64>>>,
    ) -> Result<Match> {
        let disparities = disparities.into();
        let mirrored = |along: Axis, axis: Option<Direction>| -> Result<Match> {
            let images = [&right, &left].map(|image| image.reversed(along));
            let found = self.matched(images, disparities.clone(), axis, &Control::default())?;
            Ok(found.reversed(along))
        };

        if self.axis != Some(Direction::Columns) {
            let found = mirrored(Axis(1), self.axis)?;
            if !found.estimates.is_vertical() {
                return Ok(found);
            }
        }
        // If the cameras are above each other, rows are mirrored.
        mirrored(Axis(0), Some(Direction::Columns))
    }

    /// [`Self::match_pair`] with a control, by which another thread may follow the progress and cancel the
    /// match.
    pub fn match_controlled(
        &self,
        left: Image,
        right: Image,
        disparities: impl Into<Option<Range<i64>>>,
        control: &Control,
    ) -> Result<Match> {
        self.matched([left, right], disparities.into(), self.axis, control)
    }

    /// Matches a pair whose disparities are along this axis; `None`: along columns if the images show it.
    fn matched(
        &self,
        images: [Image; 2],
        disparities: Option<Range<i64>>,
        axis: Option<Direction>,
        control: &Control,
    ) -> Result<Match> {
        let (pair, facts) = read_pair(images, disparities, axis)?;
        let matched =
            self.on_threads(control, |runtime| match_pair(pair, &facts, &self.settings, runtime))?;
        Ok(Match::new(matched))
    }

    /// Matches the next pair of a rig, which learns from it. A rig learns nothing from a pair that fails.
    pub fn match_frame(
        &self,
        rig: &mut Rig,
        left: Image,
        right: Image,
        disparities: impl Into<Option<Range<i64>>>,
    ) -> Result<Match> {
        let (pair, facts) = read_pair([left, right], disparities.into(), self.axis)?;
        let Rig { state, filter, reestimate } = rig;

        let options = Options { facts: &facts, settings: &self.settings, reestimate: *reestimate };
        let frame = self.on_threads(&Control::default(), |runtime| {
            frames::match_frame(state, pair, options, filter.as_mut(), runtime)
        })?;
        let support = frame.support.map(|(support, _)| support);
        Ok(Match { support, ..Match::new(frame.matched) })
    }

    /// Diagnoses a pair: estimates everything that a match would estimate, and matches a copy of at most 0.4
    /// megapixels. If that match fails, the first finding is a warning about it. The arguments are those of
    /// [`Self::match_pair`].
    pub fn check(
        &self,
        left: Image,
        right: Image,
        disparities: impl Into<Option<Range<i64>>>,
    ) -> Result<Estimates> {
        let (pair, facts) = read_pair([left, right], disparities.into(), self.axis)?;

        let control = Control::default();
        self.on_threads(&control, |runtime| diagnosed(pair, &facts, &self.settings, runtime))
    }

    /// Prepares two images for any other matcher; `max_disparity` is the largest disparity that the matcher
    /// can return, at least 1. The other arguments are those of [`Self::match_pair`].
    pub fn prepare(
        &self,
        left: Image,
        right: Image,
        disparities: impl Into<Option<Range<i64>>>,
        max_disparity: impl Into<Option<i64>>,
    ) -> Result<PreparedPair> {
        let inputs = [left.into_input(), right.into_input()];
        let given = disparities.into().map(|Range { start, end }| -> Result<_> {
            let count = end.saturating_sub(start);
            Ok(Fact::given(Candidates::new(start, count, inputs[0].size().1)?))
        });
        let facts = Facts { candidates: given.transpose()?, ..Facts::default() };

        let most = max_disparity.into();
        let made = self.on_threads(&Control::default(), |runtime| {
            prepared_for_others(inputs, &facts, most, &self.settings, runtime)
        })?;

        let (Preparation { images, done, num_disparities, back, .. }, ready) = made;
        let images = images.map(Image::of_input);
        let findings = ready.prepared.estimates.findings;
        Ok(PreparedPair { images, done, num_disparities, findings, back })
    }

    /// Judges a disparity map of the left image, in pixels; non-finite values make no claim. The pair is
    /// matched again.
    pub fn verify(&self, left: Image, right: Image, map: &Plane<f32>) -> Result<Verification> {
        let (pair, facts) = read_pair([left, right], None, None)?;

        let control = Control::default();
        let judged = self.on_threads(&control, |runtime| {
            verification::verify(pair, map, &facts, &self.settings, runtime)
        })?;

        let verification::Verification {
            verdicts, better, confidence, uncertainty, findings, matched, ..
        } = judged;
        let own = Match::new(matched);
        Ok(Verification { verdicts, better, confidence, uncertainty, findings, own })
    }

    /// Finds how to rectify two raw images, and others of the same cameras, from the images alone; also
    /// returns findings.
    pub fn calibrate(&self, left: Image, right: Image) -> Result<(Calibration, Vec<Finding>)> {
        let (inputs, sizes) = raw(left, right)?;
        let pair = Pair::of_any(inputs, 0, 1)?;

        let control = Control::default();
        let found = self.on_threads(&control, |runtime| rectify_views(&[pair], runtime))?;

        let note = |sentence: String| Finding::note(Topic::Alignment, sentence);
        let told = findings::rectification(&found).into_iter().map(note).collect();
        Ok((Calibration::of_cameras(&found.cameras).as_they_come(sizes)?, told))
    }

    /// Rectifies two raw images; pixels outside the raw images are masked. Both results are as large as the
    /// left image; K2 is that of the original right image.
    pub fn rectify(
        &self,
        left: Image,
        right: Image,
        calibration: &Calibration,
        interpolation: Interpolation,
    ) -> Result<[Image; 2]> {
        let (inputs, sizes) = raw(left, right)?;
        let calibration = calibration.fitted(sizes)?;

        let control = Control::default();
        self.on_threads(&control, |Runtime { control, .. }| {
            let places = calibration.places(sizes[0], control)?;
            let rectified = |side: usize| -> Result<Image> {
                let (input, places) = (&inputs[side], &places[side]);
                let found = warp::rectified_input(input, places, interpolation, control)?;
                Ok(Image::of_input(found))
            };
            Ok([rectified(0)?, rectified(1)?])
        })
    }

    /// Depths of the rectified left camera (NaN: none), as a third camera sees them.
    pub fn register(
        &self,
        depth: &Plane<f32>,
        left: &LeftCamera,
        camera: &ThirdCamera,
    ) -> Result<Registered> {
        let control = Control::default();
        self.on_threads(&control, |Runtime { control, .. }| register(depth, left, camera, control))
    }

    /// The most bytes of working memory for a match of images with this many rows and columns, where each
    /// pixel, all channels together, takes `pixel_bytes`. The caller's images and maps are not included, nor the
    /// codes of the right image that are kept for each kind of compensated blur.
    pub fn working_memory(
        &self,
        (rows, cols): (usize, usize),
        pixel_bytes: usize,
        num_disparities: usize,
    ) -> Result<u64> {
        let candidates = Candidates::new(0, num_disparities as i64, cols)?;
        // 1 byte per pixel, up to 3 channels of 8.
        if !(1..=24).contains(&pixel_bytes) {
            return Err(Error::value("pixel_bytes", pixel_bytes, "an integer from 1 to 24"));
        }

        let demand = Demand {
            plan: Plan { settings: &self.settings, compensation: None, alignment: None },
            cols,
            candidates: candidates.count(),
            pixel: pixel_bytes,
            threads: self.threads,
        };
        Ok(footprint::bytes(&demand, rows))
    }

    /// Runs all work on the matcher's threads: on the calling thread, rayon would start another pool.
    fn on_threads<T: Send>(
        &self,
        control: &Control,
        work: impl FnOnce(Runtime) -> Result<T> + Send,
    ) -> Result<T> {
        let execution = Execution { threads: self.threads, level: Level::best() };
        let runtime = Runtime { matcher: &self.core, execution, control };

        self.core.install(|| work(runtime))
    }
}

impl Match {
    fn new(matched: Matched) -> Self {
        let summary = matched.summary();
        let Matched { map, prepared: Prepared { pair, estimates, .. }, rectified } = matched;
        let findings = findings::of_match(&estimates, &summary, pair.size());

        let Disparity { disparity, flags, confidence, uncertainty, timings, .. } = map;
        Self {
            disparity,
            flags,
            confidence,
            uncertainty,
            support: None,
            summary,
            findings,
            estimates,
            rectified,
            timings,
        }
    }

    /// The same, with the rows or the columns of all maps reversed.
    fn reversed(self, axis: Axis) -> Self {
        Self {
            disparity: self.disparity.reversed(axis),
            flags: self.flags.reversed(axis),
            confidence: self.confidence.map(|plane| plane.reversed(axis)),
            uncertainty: self.uncertainty.map(|plane| plane.reversed(axis)),
            ..self
        }
    }
}

/// Two raw images, the right one scaled to the size of the left one, and the original sizes.
fn raw(left: Image, right: Image) -> Result<([Input; 2], Sizes)> {
    let [left, mut right] = [left.into_input(), right.into_input()];
    left.check("left")?;
    right.check("right")?;

    let sizes = [left.size(), right.size()];
    if sizes[0] != sizes[1] {
        (right, _) = resized_right([&left, &right])?;
    }
    Ok(([left, right], sizes))
}

/// Both images, and the disparities and the axis if given.
fn read_pair(
    [left, right]: [Image; 2],
    disparities: Option<Range<i64>>,
    axis: Option<Direction>,
) -> Result<(Pair, Facts)> {
    // The pair needs some range until its own is estimated, or until it is turned.
    let pair = Pair::of_any([left.into_input(), right.into_input()], 0, 1)?;
    let (rows, cols) = pair.size();
    let length = if axis == Some(Direction::Columns) { rows } else { cols };
    let given =
        disparities.map(|Range { start, end }| Candidates::new(start, end.saturating_sub(start), length));

    let candidates = given.transpose()?;
    let axis = axis.map(Fact::given);
    Ok((pair, Facts { axis, candidates: candidates.map(Fact::given), ..Facts::default() }))
}
