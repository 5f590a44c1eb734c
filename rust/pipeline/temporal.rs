//! The temporal filter: where neither image of a video has changed, a disparity is the mean of those of some frames.
//!
//! Fresh noise in every frame makes the disparities of a scene that stands still flicker. What a pixel had in the frames
//! before tells more than one frame, as long as it is still the same thing that both cameras see there. So the filter
//! has two parts: where a view has changed ([`change`]), and the recurrence of a pixel. With `d` the disparity of this
//! frame, `D` that of the output before, and `n` the number of frames that support it:
//!
//! ```text
//! seen(d) = the right view has not changed at (x - d, y), or (x - d, y) lies beside the image, or there is no d
//! if n > 0 and the left view has not changed at (x, y) and seen(d) and seen(D):
//!     if |d - D| <= 1, or there is neither d nor D:  n = min(n + 1, FRAMES)   D += (d - D) / n
//!     else if n > 1:                                 n = n - 1                D stays
//!     else:                                          n = 1                    D = d
//! else:                                              n = 1                    D = d
//! ```
//!
//! A disparity that is off by more than a pixel is outvoted, by as many frames as support the other one: the majority
//! vote of Boyer & Moore (1981). The rest is the recursive mean of temporal filters as depth cameras have them, with a
//! weight that begins at 1 and ends at 1 / [`FRAMES`]. Of a disparity that stays the flags and the confidence stay, too;
//! else they are those of this frame.
//!
//! Frames that are the same to the bit give the same maps to the bit. A view that has changed everywhere, as at a cut,
//! gives the map as it is.
//!
//! Why disparities and not images: the mean of images that have changed by less than their noise gives better maps of
//! what stands still (bad-1.0 of `robust` under a noise of 8 gray levels 3.83 -> 3.12 %, here 3.64), but of a camera that
//! moves worse ones (3.79 -> 4.00 %, here 3.75): matching sees texture below the noise, which no test of a few pixels does.
//!
//! State: the output before (disparity, flags, confidence, `n`), row by row in place, since a pixel depends on no other one,
//! and what is known of each view: together 15 bytes a pixel, 19 with confidences.

pub mod change;

use rayon::prelude::*;

use self::change::{Changes, STEP, Scale};
use crate::cost::candidates::Candidates;
use crate::error::Result;
use crate::image::plane::Plane;
use crate::pipeline::control::Control;
use crate::pipeline::matcher::{Disparity, Pair};
use crate::settings::Settings;
use crate::simd::{Level, Loop};

/// Most frames that a disparity is the mean of. The deviation over 12 frames of a static scene is 0.43, 0.39 and 0.38 of
/// that without the filter with 4, 8 and 16 (`fast`, noise of 3 gray levels): 8 have half the lag of 16.
pub const FRAMES: u8 = 8;
/// Pixels by which disparities of one thing differ at most: the steps of integer maps. With half of it integer maps
/// flicker more (0.46 in place of 0.39), with twice as much bad-1.0 gets worse (`robust`, noise of 8: 3.64 -> 3.73 %).
const SAME: f32 = 1.0;

/// What is carried over from one frame of a video to the next.
#[derive(Debug, Default)]
pub struct TemporalFilter {
    /// `None`: there was no frame, or what came of it is not whole.
    before: Option<Before>,
}

#[derive(Debug)]
struct Before {
    key: Key,
    views: [Changes; 2],
    disparity: Plane<f32>,
    flags: Plane<u16>,
    confidence: Option<Plane<f32>>,
    support: Plane<u8>,
    /// Where the disparity of before stayed in the last frame.
    marks: Plane<bool>,
}

/// What has to be the same for anything to be carried over.
#[derive(Debug, PartialEq)]
struct Key {
    size: (usize, usize),
    scales: [Scale; 2],
    settings: Settings,
    candidates: Candidates,
}

impl TemporalFilter {
    /// A filter that has seen nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Filters the map of the next frame in place, and returns how many frames support each disparity, 1 to 8.
    ///
    /// The pair is the one that was matched with these settings. Nothing is carried over to another size, type of pixels,
    /// range of disparities or other settings, nor after an error.
    pub fn apply(
        &mut self,
        pair: &Pair,
        settings: &Settings,
        map: &mut Disparity,
        level: Level,
        control: &Control,
    ) -> Result<Plane<u8>> {
        let before = self.before.take().filter(|before| before.is_of(pair, settings));
        let mut before = match before {
            Some(before) => before,
            None => Before::nothing(pair, settings, map, control)?,
        };
        for (view, changes) in pair.views().into_iter().zip(&mut before.views) {
            changes.update(view, level, control)?;
        }
        before.follow(map, level, control)?;
        let support = before.support.clone();
        self.before = Some(before);
        Ok(support)
    }
}

impl Before {
    fn nothing(
        pair: &Pair,
        settings: &Settings,
        map: &Disparity,
        control: &Control,
    ) -> Result<Self> {
        let (size, views) = (pair.size(), pair.views());
        let scale = |view| Scale::of_view(view, control);
        let scales = [scale(views[0])?, scale(views[1])?];
        let (settings, candidates) = (compared(settings), pair.candidates());
        let key = Key { size, scales, settings, candidates };
        Ok(Self {
            key,
            views: [Changes::new(size, scales[0])?, Changes::new(size, scales[1])?],
            disparity: Plane::new(size.0, size.1)?,
            flags: Plane::new(size.0, size.1)?,
            confidence: map.confidence.is_some().then(|| Plane::new(size.0, size.1)).transpose()?,
            support: Plane::new(size.0, size.1)?,
            marks: Plane::new(size.0, size.1)?,
        })
    }

    fn is_of(&self, pair: &Pair, settings: &Settings) -> bool {
        let [left, right] = pair.views();
        let Key { size, scales, settings: before, candidates } = &self.key;
        *size == pair.size()
            && scales[0].suits(left)
            && scales[1].suits(right)
            && *before == compared(settings)
            && *candidates == pair.candidates()
    }

    /// Takes the map of the next frame up, and writes over it what comes of it.
    fn follow(&mut self, map: &mut Disparity, level: Level, control: &Control) -> Result<()> {
        let cols = self.key.size.1;
        let [left, right] = &self.views;
        let rows = self.disparity.as_mut_slice().par_chunks_mut(cols);
        let rows = rows.zip(self.flags.as_mut_slice().par_chunks_mut(cols));
        let rows = rows.zip(self.support.as_mut_slice().par_chunks_mut(cols));
        let rows = rows.zip(self.marks.as_mut_slice().par_chunks_mut(cols));
        let rows = rows.zip(map.disparity.as_mut_slice().par_chunks_mut(cols));
        let rows = rows.zip(map.flags.as_mut_slice().par_chunks_mut(cols)).enumerate();
        rows.try_for_each(|(y, (((((before, flags), support), marks), now), new_flags))| {
            control.checkpoint()?;
            let changed = [left.row(y), right.row(y)];
            level.run(Follow { changed, before, support, now, marks });
            level.run(Keep { stays: marks, before: flags, now: new_flags });
            Ok(())
        })?;

        let (Some(before), Some(now)) = (&mut self.confidence, &mut map.confidence) else {
            return Ok(());
        };
        let rows = before.as_mut_slice().par_chunks_mut(cols);
        let rows = rows.zip(now.as_mut_slice().par_chunks_mut(cols));
        let rows = rows.zip(self.marks.as_slice().par_chunks(cols));
        rows.for_each(|((before, now), stays)| level.run(Keep { stays, before, now }));
        Ok(())
    }
}

/// The settings that a map depends on. Whether rows were to be straightened is told by the pair, whose field may have been
/// found in an earlier frame.
fn compared(settings: &Settings) -> Settings {
    Settings { align_rows: false, ..settings.clone() }
}

/// The recurrence along a row: writes what comes of it to both `before` and `now`, and marks where that of before stays.
struct Follow<'a> {
    changed: [&'a [bool]; 2],
    before: &'a mut [f32],
    support: &'a mut [u8],
    now: &'a mut [f32],
    marks: &'a mut [bool],
}

impl Loop for Follow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { changed: [left, right], before, support, now, marks } = self;
        mark_changed(left, right, before, now, marks);
        follow(before, support, now, marks);
    }
}

/// Marks where either view has changed: at the pixel, or where the disparity of before or of now leads.
#[inline(always)]
fn mark_changed(left: &[bool], right: &[bool], before: &[f32], now: &[f32], marks: &mut [bool]) {
    let (places, rest) = marks.as_chunks_mut::<STEP>();
    for (place, has_changed) in places.iter_mut().zip(left) {
        *place = [*has_changed; STEP];
    }
    rest.fill(left.last().is_some_and(|has_changed| *has_changed));
    // Of what stands still most rows have not changed at all: nothing is to be looked up there.
    if !right.contains(&true) {
        return;
    }
    let cols = marks.len();
    for (x, mark) in marks.iter_mut().enumerate().filter(|(_, mark)| !**mark) {
        let has_changed = |disparity: f32| {
            let place = (x as f32 - disparity).round_ties_even();
            // No comparison is true of what is not a number.
            (place >= 0.0 && place < cols as f32) && right[place as usize / STEP]
        };
        *mark = has_changed(before[x]) || has_changed(now[x]);
    }
}

/// See the module; `marks` are where something has changed, and become those where the disparity of before stays.
#[inline(always)]
fn follow(before: &mut [f32], support: &mut [u8], now: &mut [f32], marks: &mut [bool]) {
    let count = now.len();
    let (before, support, marks) =
        (&mut before[..count], &mut support[..count], &mut marks[..count]);
    for x in 0..count {
        let (old, new, frames) = (before[x], now[x], support[x]);
        let is_same = ((new - old).abs() <= SAME) | (new.is_nan() & old.is_nan());
        let is_known = (frames > 0) & !marks[x];
        let more = if frames < FRAMES { frames + 1 } else { FRAMES };
        let mean = old + (new - old) / f32::from(more);

        let stays = is_known & !is_same & (frames > 1);
        let is_mean = is_known & is_same;
        // No arithmetic on what is no number: its bits would not be the same everywhere.
        let result = if is_mean & !new.is_nan() { mean } else { new };
        let result = if stays { old } else { result };
        let fewer = if stays { frames.wrapping_sub(1) } else { 1 };

        (before[x], now[x]) = (result, result);
        support[x] = if is_mean { more } else { fewer };
        marks[x] = stays;
    }
}

/// Flags or confidences of a row: those of before where they stay, to `now`; all of them to `before`.
struct Keep<'a, T> {
    stays: &'a [bool],
    before: &'a mut [T],
    now: &'a mut [T],
}

impl<T: Copy> Loop for Keep<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let count = self.now.len();
        let (stays, before) = (&self.stays[..count], &mut self.before[..count]);
        for x in 0..count {
            let kept = if stays[x] { before[x] } else { self.now[x] };
            (before[x], self.now[x]) = (kept, kept);
        }
    }
}
