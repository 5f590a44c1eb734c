//! A camera that has stopped: its image is that of the frame before, while the image of the other one has
//! changed.
//!
//! The noise of a camera that runs is another one in every frame. Where both images are those of the frame
//! before, the frame was only sent twice.

use super::events::Steady;
use crate::video::choices::CHANGED_FRAMES;
use phasestereo_match::base::digest::Digest;
use phasestereo_match::image::view::View;
use phasestereo_match::pair::Pair;

/// What the last frame was, and which camera has stopped.
#[derive(Debug, Clone)]
pub struct Stopped {
    /// The digests of its images.
    last: Option<[u64; 2]>,
    /// 0: none, 1: the left one, 2: the right one.
    side: Steady,
}

impl Default for Stopped {
    fn default() -> Self {
        Self { last: None, side: Steady::new(0) }
    }
}

impl Stopped {
    /// Takes in a frame. Returns a sentence about a change, if there is one.
    pub fn update(&mut self, pair: &Pair) -> Option<String> {
        let [left, right] = pair.views().map(digest);
        let last = self.last.replace([left, right])?;

        let (said, patience) = match [left == last[0], right == last[1]] {
            [true, true] => return None,
            [true, false] => (1, 1),
            [false, true] => (2, 1),
            [false, false] => (0, CHANGED_FRAMES),
        };
        let before = self.side.state;
        self.side.update(said, patience)?;
        let name = |state| if state == 1 { "left" } else { "right" };
        Some(match said {
            0 => format!("the {} camera goes on", name(before)),
            one => format!(
                "the {} camera has stopped or is late: its image is that of the frame before, the other one \
                 changes",
                name(one)
            ),
        })
    }
}

/// A digest of the gray values: of the sums of each row, weighted so that values which change places count.
fn digest(view: &View) -> u64 {
    let gray = view.gray();
    let mut digest = Digest::default();
    for y in 0..gray.rows() {
        let weighted =
            gray.row(y).iter().zip(0..).map(|(value, x)| i64::from(*value) * (2 * x + 1));
        digest.add(weighted.sum::<i64>().to_le_bytes());
    }
    digest.value()
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
        let mut said =
            |left, right| -> Result<Option<String>> { Ok(stopped.update(&frame(left, right)?)) };
        for (left, right) in [(0, 0), (1, 1), (1, 1), (2, 2)] {
            assert_eq!(said(left, right)?, None);
        }
        assert!(said(2, 3)?.is_some_and(|said| said.starts_with("the left camera has stopped")));
        // Half as fast is as bad.
        for (left, right) in [(2, 4), (3, 5), (3, 6), (4, 7), (5, 8)] {
            assert_eq!(said(left, right)?, None);
        }
        assert_eq!(said(6, 9)?.as_deref(), Some("the left camera goes on"));
        assert!(said(7, 9)?.is_some_and(|said| said.starts_with("the right camera has stopped")));
        Ok(())
    }
}
