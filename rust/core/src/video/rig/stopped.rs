//! Detects a camera that has stopped, or that is late.
//!
//! The image of a stopped camera equals that of the previous frame, while that of the other one has changed:
//! the noise of a running camera differs in every frame. If both images equal those of the previous frame,
//! the frame was only sent twice. A camera that is always late moves like the other one did some frames ago:
//!
//! ```text
//! profiles    = sums of the rows and of the columns of an image
//! motion(t)   = the shift that best matches the profiles of frame t to those of frame t - 1, along both axes
//! error(k)    = sum over the last t of |motion of the right image (t) - motion of the left one (t - k)|^2
//! late by k   : error(the lag so far) over the same t
//!               >= LEAST_APART + APART (error(k) + MOTION_REST per t), and there is motion
//! ```
//!
//! Cameras that rest or move evenly do not show it.

use super::events::Steady;
use crate::video::choices::{
    APART, CHANGED_FRAMES, LATEST, LEAST_APART, MOTION_FRAMES, MOTION_REACH, MOTION_REST,
};
use phasestereo_match::image::view::View;
use phasestereo_match::pair::Pair;

/// Rows and columns.
type Profiles = [Vec<i64>; 2];
/// Pixels along rows and columns, of both images.
type Motions = [[f64; 2]; 2];

/// Data of recent frames, and which camera has stopped or is late.
#[derive(Debug, Clone)]
pub struct Stopped {
    /// The profiles of the last frame's images.
    last: Option<[Profiles; 2]>,
    /// The stopped camera: 0 neither, 1 left, 2 right.
    side: Steady,
    /// The motions of recent frames.
    motions: Vec<Motions>,
    /// How many frames late the right camera is.
    late: isize,
}

impl Default for Stopped {
    fn default() -> Self {
        Self { last: None, side: Steady::new(0), motions: vec![], late: 0 }
    }
}

impl Stopped {
    /// Updates it with a frame. Returns a sentence about a change, if any.
    pub fn update(&mut self, pair: &Pair) -> Option<String> {
        let profiles = pair.views().map(profiles);
        let last = self.last.replace(profiles)?;
        let now = self.last.as_ref()?;

        let (said, patience) = match [now[0] == last[0], now[1] == last[1]] {
            [true, true] => return None,
            [true, false] => (1, 1),
            [false, true] => (2, 1),
            [false, false] => (0, CHANGED_FRAMES),
        };
        let before = self.side.state;
        let has_changed = self.side.update(said, patience).is_some();
        if said != 0 || self.side.state != 0 {
            self.motions.clear();
        }

        let name = |state| if state == 1 { "left" } else { "right" };
        if has_changed {
            return Some(match said {
                0 => format!("the {} camera goes on", name(before)),
                one => format!(
                    "the {} camera has stopped or is late: its image is that of the frame before, the other \
                     one changes",
                    name(one)
                ),
            });
        }
        if self.side.state != 0 {
            return None;
        }
        let of_axis = |side: usize, axis: usize| motion(&last[side][axis], &now[side][axis]);
        self.late([0, 1].map(|side| [0, 1].map(|axis| of_axis(side, axis))))
    }

    /// Updates it with the motions of both images. Returns a sentence about a camera that is late, or no
    /// longer is.
    fn late(&mut self, motions: [[Option<f64>; 2]; 2]) -> Option<String> {
        let [[Some(left), Some(down)], [Some(right), Some(below)]] = motions else {
            self.motions.clear();
            return None;
        };
        self.motions.push([[left, down], [right, below]]);
        let surplus = self.motions.len().saturating_sub(MOTION_FRAMES);
        self.motions.drain(..surplus);

        let lags = (-LATEST..=LATEST).filter(|lag| *lag != self.late);
        let fits = |lag: isize| {
            let [known, other, moved] = self.errors(lag);
            let most = LEAST_APART + APART * other;
            (known >= most && moved >= LEAST_APART).then_some((known / most, lag))
        };
        let (_, best) = lags.filter_map(fits).max_by(|a, b| a.0.total_cmp(&b.0))?;
        self.motions.clear();
        let before = std::mem::replace(&mut self.late, best);
        let name = |lag: isize| if lag > 0 { ["right", "left"] } else { ["left", "right"] };
        Some(if best == 0 {
            format!("the {} camera is in time again", name(before)[0])
        } else {
            let [one, other] = name(best);
            let (count, s) = (best.unsigned_abs(), if best.abs() == 1 { "" } else { "s" });
            format!("the {one} camera is late by {count} frame{s}: it moves as the {other} one did before")
        })
    }

    /// The sums of squared motion differences with the known lag and with another one, and of the repeated
    /// motions.
    fn errors(&self, lag: isize) -> [f64; 3] {
        let square = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
        let repeated = |at: usize, lag: isize| {
            let [early, late] = if lag >= 0 { [0, 1] } else { [1, 0] };
            (self.motions[at - lag.unsigned_abs()][early], self.motions[at][late])
        };
        let apart = |at: usize, lag: isize| {
            let (then, now) = repeated(at, lag);
            square(then, now)
        };

        let seen = lag.unsigned_abs().max(self.late.unsigned_abs())..self.motions.len();
        let rest = MOTION_REST * seen.len() as f64;
        let sum = |lag| seen.clone().map(|at| apart(at, lag)).sum::<f64>();
        let moved = seen.clone().map(|at| square(repeated(at, lag).0, [0.0; 2])).sum();
        [sum(self.late), sum(lag) + rest, moved]
    }
}

/// The sums of rows and of columns.
fn profiles(view: &View) -> Profiles {
    let gray = view.gray();
    let mut columns = vec![0; gray.cols()];
    let row = |y: usize| {
        let row = gray.row(y);
        columns.iter_mut().zip(row).for_each(|(sum, value)| *sum += i64::from(*value));
        row.iter().map(|value| i64::from(*value)).sum()
    };
    let rows = (0..gray.rows()).map(row).collect();
    [rows, columns]
}

/// How many pixels a profile has moved; `None`: beyond the tried range, or a different profile.
fn motion(before: &[i64], now: &[i64]) -> Option<f64> {
    let slopes = |profile: &[i64]| -> Vec<f64> {
        profile.windows(3).map(|three| (three[2] - three[0]) as f64).collect()
    };
    let (before, now) = (slopes(before), slopes(now));
    if before.len() != now.len() || before.len() < 4 * MOTION_REACH {
        return None;
    }
    let middle = &now[MOTION_REACH..now.len() - MOTION_REACH];
    let apart = |shift: usize| -> f64 {
        middle.iter().zip(&before[shift..]).map(|(now, before)| (now - before).powi(2)).sum()
    };
    let apart: Vec<f64> = (0..=2 * MOTION_REACH).map(apart).collect();
    let best = (0..apart.len()).min_by(|a, b| apart[*a].total_cmp(&apart[*b]))?;
    let energy: f64 = middle.iter().map(|slope| slope * slope).sum();
    let &[left, least, right] = apart.get(best.checked_sub(1)?..best + 2)? else { return None };
    if 2.0 * least > energy {
        return None;
    }
    let bend = left - 2.0 * least + right;
    let part = if bend > 0.0 { (left - right) / (2.0 * bend) } else { 0.0 };
    Some(MOTION_REACH as f64 - best as f64 - part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use phasestereo_match::base::error::Result;
    use phasestereo_match::base::plane::Plane;
    use phasestereo_match::image::conversion::view_of_plane;
    use phasestereo_match::image::intensity_range::IntensityRange;

    fn frame(left: usize, right: usize) -> Result<Pair> {
        let range = IntensityRange { black: 0.0, white: 255.0 };
        let gray = |number| Plane::from_fn(48, 64, |y, x| ((y * x + 7 * number) % 97) as f32);
        let view = |number| view_of_plane(&gray(number), range);
        Pair::new(view(left), view(right), 0, 8)
    }

    #[test]
    fn a_camera_has_stopped_if_the_other_one_goes_on_alone() -> Result<()> {
        let mut stopped = Stopped::default();
        let mut said = |left, right| -> Result<Option<String>> { Ok(stopped.update(&frame(left, right)?)) };
        for (left, right) in [(0, 0), (1, 1), (1, 1), (2, 2)] {
            assert_eq!(said(left, right)?, None);
        }
        assert!(said(2, 3)?.is_some_and(|said| said.starts_with("the left camera has stopped")));
        // Half the speed is equally bad.
        for (left, right) in [(2, 4), (3, 5), (3, 6), (4, 7), (5, 8)] {
            assert_eq!(said(left, right)?, None);
        }
        assert_eq!(said(6, 9)?.as_deref(), Some("the left camera goes on"));
        assert!(said(7, 9)?.is_some_and(|said| said.starts_with("the right camera has stopped")));
        Ok(())
    }
}
