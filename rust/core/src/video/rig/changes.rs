//! Where the left image of a video changes: compares means of squares with those of earlier frames.
//!
//! ```text
//! change  = abs(mean of a square in this frame - before)
//! before += change / 2, so that something that enters is a change for some frames
//! changed = change > LEAST_CHANGE + CHANGE_MEDIANS median change
//! ```
//!
//! While the cameras move, or the light changes, the median is large: then squares show nothing.

use crate::estimation::areas::BLOCK;
use crate::estimation::overview::fine_factor;
use crate::video::choices::{CHANGE_MEDIANS, LEAST_CHANGE, MOVING_FROM};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::{Plane, around};
use phasestereo_match::base::statistics::ranked;
use phasestereo_match::image::view::View;

/// The earlier means of squares of the left image, and the squares that have changed.
#[derive(Debug, Clone, Default)]
pub struct Changes {
    /// The means of the frames before, gray levels.
    before: Option<Plane<f64>>,
    /// The squares that have changed, with their neighbors; `None`: the cameras are moving, or nothing is
    /// known.
    pub squares: Option<Plane<bool>>,
}

impl Changes {
    /// Updates it with the left image of a frame.
    pub fn update(&mut self, view: &View) -> Result<()> {
        let mut now = means(view)?;
        let size = now.size();
        let is_like = |before: &Plane<f64>| before.size() == size;
        let Some(before) = self.before.take().filter(is_like) else {
            *self = Self { before: Some(now), squares: None };
            return Ok(());
        };
        let pairs = || now.as_slice().iter().zip(before.as_slice());
        let changes: Vec<f64> = pairs().map(|(now, before)| (now - before).abs()).collect();
        let median = ranked(&mut changes.clone(), changes.len() / 2).unwrap_or_default();

        let (rows, cols) = size;
        let most = LEAST_CHANGE + CHANGE_MEDIANS * median;
        let has_changed = |y: usize, x: usize| {
            around(y, 1, rows).any(|y| around(x, 1, cols).any(|x| changes[y * cols + x] > most))
        };
        self.squares = (median < MOVING_FROM).then(|| Plane::from_fn(rows, cols, has_changed));
        for (now, before) in now.as_mut_slice().iter_mut().zip(before.as_slice()) {
            *now = f64::midpoint(*now, *before);
        }
        self.before = Some(now);
        Ok(())
    }
}

/// The means, in gray levels, of squares of the same size as the blocks of fine copies that are searched
/// together.
fn means(view: &View) -> Result<Plane<f64>> {
    let gray = view.gray();
    let (rows, cols) = gray.size();
    let side = BLOCK * fine_factor((rows, cols));
    let mut sums = Plane::<i64>::new(rows.div_ceil(side), cols.div_ceil(side))?;
    for y in 0..rows {
        for (sum, part) in sums.row_mut(y / side).iter_mut().zip(gray.row(y).chunks(side)) {
            *sum += part.iter().map(|gray| i64::from(*gray)).sum::<i64>();
        }
    }
    let level = view.scale().steps(view.scale().level());
    let length = |at: usize, end: usize| (end - at * side).min(side) as f64;
    let mean = |y: usize, x: usize| sums.row(y)[x] as f64 / (length(y, rows) * length(x, cols) * level);
    Ok(Plane::from_fn(sums.rows(), sums.cols(), mean))
}
