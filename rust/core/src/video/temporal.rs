//! The temporal filter: where neither image of a video has changed, a disparity is the mean over some frames.
//!
//! Fresh noise in every frame makes the disparities of a static scene flicker. Several frames are better than
//! one, as long as both cameras still see the same thing at a pixel. So the filter has two parts: detecting
//! where a view has changed ([`change`]), and the recurrence of a pixel. With `d` the disparity of this
//! frame, `D` that of the previous output, and `n` the number of frames that support it:
//!
//! ```text
//! seen(d) = the right view is unchanged at (x - d, y), or (x - d, y) is outside the image, or d is missing
//! still   = of the places in the 32 x 32 block with both d and D, at most 2 / 3 have d - D from 1/4 to 2,
//!           or from -2 to -1/4; or there are fewer than LEAST_MOVED such places
//! if n > 0 and still and the left view has not changed at (x, y) and seen(d) and seen(D):
//!     if |d - D| <= 1, or there is neither d nor D:  n = min(n + 1, MEAN_FRAMES)   D += (d - D) / n
//!     else if n > 1:                                 n = n - 1                D stays
//!     else:                                          n = 1                    D = d
//! else:                                              n = 1                    D = d
//! ```
//!
//! Things that come nearer by at most a pixel per frame, and are so plain that hardly a gray value changes,
//! move whole blocks of disparities one way, which noise does not.
//!
//! A disparity that is off by more than a pixel is outvoted by the number of frames that support the other
//! one: the majority vote of Boyer & Moore (1981). The rest is the recursive mean of the temporal filters of
//! depth cameras, with a weight that begins at 1 and ends at 1 / [`MEAN_FRAMES`]. Where the previous
//! disparity stays, its flags, its confidence and its error bar stay, too; elsewhere they are those of this
//! frame.
//!
//! Bit-identical frames give bit-identical maps. A view that has changed everywhere, as at a cut, leaves the
//! map unchanged.
//!
//! Why disparities are averaged, not images: means of images that changed by less than their noise give
//! better maps of a static scene, but worse ones with a moving camera, because matching uses texture below
//! the noise, which a test of a few pixels does not detect. `phasestereo bench video` measures both kinds of
//! scenes.
//!
//! State: the previous output (disparity, flags, confidence, error bar, `n`) and the means of each view: 15
//! bytes a pixel, 23 with confidences. Pixels do not depend on each other, so rows are filtered in place and
//! in parallel.

pub mod change;

use rayon::prelude::*;

use self::change::{Scale, ViewChanges};
use crate::video::choices::{
    CHANGE_STEP, LEAST_MOVED, MEAN_FRAMES, MOST_MOVED_BY, MOVED_BLOCK, MOVED_BY, MOVED_STEP, SAME_THING,
};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::{Level, leveled};
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::Settings;

/// The state carried over from one frame of a video to the next.
#[derive(Debug, Default)]
pub struct TemporalFilter {
    /// `None`: no frame yet, or an error ended its filtering.
    before: Option<Before>,
}

/// The previous output, and the views it belongs to.
#[derive(Debug)]
struct Before {
    key: Key,
    views: [ViewChanges; 2],
    disparity: Plane<f32>,
    flags: Plane<u16>,
    /// Confidence and uncertainty, if any.
    trust: [Option<Plane<f32>>; 2],
    support: Plane<u8>,
    /// Working memory: where something has changed, then where the previous disparity stays.
    marks: Plane<bool>,
}

/// Properties of a match that must be equal for anything to be carried over.
#[derive(Debug, PartialEq)]
struct Key {
    size: (usize, usize),
    scales: [Scale; 2],
    settings: Settings,
    candidates: Candidates,
}

impl TemporalFilter {
    /// A filter without frames.
    pub fn new() -> Self {
        Self::default()
    }

    /// Filters the map of the next frame in place, and returns the number of frames that support each
    /// disparity, 1 to 8.
    ///
    /// The pair is the one that was matched with these settings. Nothing is carried over to another size,
    /// pixel type, range of disparities or other settings, or after an error.
    pub fn apply(
        &mut self,
        pair: &Pair,
        settings: &Settings,
        map: &mut Disparity,
        runtime: Runtime,
    ) -> Result<Plane<u8>> {
        // Taken out, so that an error does not leave anything half updated.
        let before = self.before.take().filter(|before| before.is_of(pair, settings));
        let mut before = match before {
            Some(before) => before,
            None => Before::nothing(pair, settings, map)?,
        };

        for (view, changes) in pair.views().into_iter().zip(&mut before.views) {
            changes.update(view, runtime)?;
        }
        before.follow(map, runtime)?;

        let support = before.support.clone();
        self.before = Some(before);
        Ok(support)
    }
}

impl Before {
    /// The state before any frame supports a disparity.
    fn nothing(pair: &Pair, settings: &Settings, map: &Disparity) -> Result<Self> {
        let size = pair.size();
        let [left, right] = pair.views();
        let like =
            |plane: &Option<Plane<f32>>| plane.is_some().then(|| Plane::new(size.0, size.1)).transpose();
        let scales = [Scale::of_view(left), Scale::of_view(right)];
        let settings = compared(settings);
        let key = Key { size, scales, settings, candidates: pair.candidates() };

        Ok(Self {
            key,
            views: [ViewChanges::new(size, scales[0])?, ViewChanges::new(size, scales[1])?],
            disparity: Plane::new(size.0, size.1)?,
            flags: Plane::new(size.0, size.1)?,
            trust: [like(&map.confidence)?, like(&map.uncertainty)?],
            support: Plane::new(size.0, size.1)?,
            marks: Plane::new(size.0, size.1)?,
        })
    }

    /// Whether the pair may be the next frame.
    fn is_of(&self, pair: &Pair, settings: &Settings) -> bool {
        let [left, right] = pair.views();
        let Key { size, scales, settings: before, candidates } = &self.key;

        *size == pair.size()
            && scales[0].suits(left)
            && scales[1].suits(right)
            && *before == compared(settings)
            && *candidates == pair.candidates()
    }

    /// The blocks whose disparities have moved together.
    fn moved(&self, now: &Plane<f32>) -> Plane<bool> {
        let (rows, cols) = now.size();
        let has_moved = |block_row: usize, block: usize| {
            let (mut up, mut down, mut known) = (0u32, 0u32, 0u32);
            for y in (block_row * MOVED_BLOCK..((block_row + 1) * MOVED_BLOCK).min(rows)).step_by(MOVED_STEP)
            {
                let (before, now) = (self.disparity.row(y), now.row(y));
                let support = self.support.row(y);
                for x in (block * MOVED_BLOCK..((block + 1) * MOVED_BLOCK).min(cols)).step_by(MOVED_STEP) {
                    let by = now[x] - before[x];
                    known += u32::from(support[x] > 0 && !by.is_nan());
                    let has_moved = by.abs() > MOVED_BY && by.abs() <= MOST_MOVED_BY && support[x] > 0;
                    up += u32::from(has_moved && by > 0.0);
                    down += u32::from(has_moved && by < 0.0);
                }
            }
            known >= LEAST_MOVED && 3 * up.max(down) > 2 * known
        };
        Plane::from_fn(rows.div_ceil(MOVED_BLOCK), cols.div_ceil(MOVED_BLOCK), has_moved)
    }

    /// Applies the recurrence of the module to the map of the next frame, in place.
    fn follow(&mut self, map: &mut Disparity, runtime: Runtime) -> Result<()> {
        let cols = self.key.size.1;
        let moved = self.moved(&map.disparity);
        let [left, right] = &self.views;

        let rows = self.disparity.as_mut_slice().par_chunks_mut(cols);
        let rows = rows.zip(self.flags.as_mut_slice().par_chunks_mut(cols));
        let rows = rows.zip(self.support.as_mut_slice().par_chunks_mut(cols));
        let rows = rows.zip(self.marks.as_mut_slice().par_chunks_mut(cols));
        let rows = rows.zip(map.disparity.as_mut_slice().par_chunks_mut(cols));
        let rows = rows.zip(map.flags.as_mut_slice().par_chunks_mut(cols)).enumerate();
        rows.try_for_each(|(y, (((((before, flags), support), marks), now), new_flags))| {
            runtime.control.checkpoint()?;

            let changed = [left.row(y), right.row(y)];
            let moved = moved.row(y / MOVED_BLOCK);
            follow_row(runtime.level(), changed, moved, before, support, now, marks);
            keep(runtime.level(), marks, flags, new_flags);
            Ok(())
        })?;

        for (before, now) in self.trust.iter_mut().zip([&mut map.confidence, &mut map.uncertainty]) {
            let (Some(before), Some(now)) = (before, now) else { continue };

            let rows = before.as_mut_slice().par_chunks_mut(cols);
            let rows = rows.zip(now.as_mut_slice().par_chunks_mut(cols));
            let rows = rows.zip(self.marks.as_slice().par_chunks(cols));
            rows.for_each(|((before, now), stays)| keep(runtime.level(), stays, before, now));
        }

        Ok(())
    }
}

/// The settings that a map depends on. `align_rows` is left out: a stream requests rows only when it
/// estimates them again.
fn compared(settings: &Settings) -> Settings {
    Settings { align_rows: false, ..settings.clone() }
}

/// The recurrence along a row: writes the result to both `before` and `now`, and marks where the previous
/// disparity stays.
#[leveled]
fn follow_row(
    level: Level,
    changed: [&[bool]; 2],
    moved: &[bool],
    before: &mut [f32],
    support: &mut [u8],
    now: &mut [f32],
    marks: &mut [bool],
) {
    let [left, right] = changed;

    mark_changed(left, right, before, now, marks);
    for (marks, has_moved) in marks.chunks_mut(MOVED_BLOCK).zip(moved) {
        if *has_moved {
            marks.fill(true);
        }
    }
    follow(before, support, now, marks);
}

/// Marks pixels where the left view has changed, or the right view at the match of the previous disparity or
/// of this frame's.
#[inline(always)]
fn mark_changed(left: &[bool], right: &[bool], before: &[f32], now: &[f32], marks: &mut [bool]) {
    let (places, rest) = marks.as_chunks_mut::<CHANGE_STEP>();
    for (place, has_changed) in places.iter_mut().zip(left) {
        *place = [*has_changed; CHANGE_STEP];
    }
    rest.fill(left.last().is_some_and(|has_changed| *has_changed));

    // Most rows of a static scene have not changed at all: no match has to be looked up there.
    if !right.contains(&true) {
        return;
    }

    let cols = marks.len();
    for (x, mark) in marks.iter_mut().enumerate().filter(|(_, mark)| !**mark) {
        let has_changed = |disparity: f32| {
            let place = (x as f32 - disparity).round_ties_even();
            // Both comparisons are false for NaN.
            (place >= 0.0 && place < cols as f32) && right[place as usize / CHANGE_STEP]
        };
        *mark = has_changed(before[x]) || has_changed(now[x]);
    }
}

/// The recurrence of the module. `marks` holds where something has changed, then where the previous disparity
/// stays.
#[inline(always)]
fn follow(before: &mut [f32], support: &mut [u8], now: &mut [f32], marks: &mut [bool]) {
    let count = now.len();
    let (before, support, marks) = (&mut before[..count], &mut support[..count], &mut marks[..count]);
    for x in 0..count {
        let (old, new, frames) = (before[x], now[x], support[x]);
        let is_same = ((new - old).abs() <= SAME_THING) | (new.is_nan() & old.is_nan());
        let is_known = (frames > 0) & !marks[x];
        let more = if frames < MEAN_FRAMES { frames + 1 } else { MEAN_FRAMES };
        let mean = old + (new - old) / f32::from(more);

        let stays = is_known & !is_same & (frames > 1);
        let is_mean = is_known & is_same;

        // A mean of NaN is not used: its bits differ between processors.
        let result = if is_mean & !new.is_nan() { mean } else { new };
        let result = if stays { old } else { result };
        let fewer = if stays { frames.wrapping_sub(1) } else { 1 };

        (before[x], now[x]) = (result, result);
        support[x] = if is_mean { more } else { fewer };
        marks[x] = stays;
    }
}

/// Flags or confidences of a row: writes the previous ones to `now` where the disparity stays, and all of
/// `now` to `before`.
#[leveled]
fn keep<T: Copy>(level: Level, stays: &[bool], before: &mut [T], now: &mut [T]) {
    let count = now.len();
    let (stays, before) = (&stays[..count], &mut before[..count]);
    for x in 0..count {
        let kept = if stays[x] { before[x] } else { now[x] };
        (before[x], now[x]) = (kept, kept);
    }
}
