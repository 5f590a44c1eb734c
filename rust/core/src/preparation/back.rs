//! Maps of a prepared pair -> maps of the original left image.
//!
//! ```text
//! prepared image = mean of factor x factor pixels of the moved one
//! left:   column x is at x + shift of the moved image      right:   column x is at x
//! disparity = factor x that of the map - shift;   rectified images: see crate::rectification::warp
//! ```
//!
//! If a map has another size than the prepared images, it is interpolated linearly between four pixels that
//! differ by at most a pixel, and otherwise the nearest one is used: a mean over a jump would belong to
//! neither side.

use serde::{Deserialize, Serialize};

use crate::match_pair::Treatment;
use crate::rectification::cameras::Cameras;
use crate::rectification::warp::raw_disparity;
use crate::saved::{MOST_PIXELS, is_moderate};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::{Error, Result};
use phasestereo_match::base::plane::Plane;
use phasestereo_match::choices::JUMP;

/// For a map of another size: most prepared columns per column of the map, and the reverse.
const LARGEST_RATIO: f64 = 64.0;
const SMALLEST_RATIO: f64 = 1.0 / 8.0;
/// The beginning of a text.
const HEAD: &str = "phasestereo back 1";
/// Most rows or columns of an image in a text.
const MOST_SIDE: usize = 1 << 20;

/// The conversion of maps of a prepared pair to the original image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Back {
    /// Rows and columns of the original left image.
    size: (usize, usize),
    /// The increase of disparities, pixels of the original image.
    shift: i64,
    /// The factor by which the images were reduced.
    factor: usize,
    /// The cameras that rectified them.
    cameras: Option<Cameras>,
    /// Lengths of the alternating runs of valid and masked pixels, row after row; empty: all are valid.
    runs: Vec<usize>,
}

impl Back {
    /// The conversion for a pair that was moved and reduced.
    pub fn new(ready: Treatment, (shift, factor): (i64, usize)) -> Self {
        let pair = &ready.prepared.pair;
        let size = pair.size();
        // Cropped images keep a column.
        let shift = shift.max(1 - size.1 as i64);
        let cameras = ready.raw.map(|raw| raw.rectification.cameras.clone());
        let mask = pair.views()[0].mask().map(Plane::as_slice);
        Self { size, shift, factor, cameras, runs: mask.map_or(vec![], runs) }
    }

    /// The increase of disparities, pixels.
    pub fn shift(&self) -> i64 {
        self.shift
    }

    /// The factor by which the images were reduced.
    pub fn factor(&self) -> usize {
        self.factor
    }

    /// Rows and columns of the original left image.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// Rows and columns of the moved images.
    fn moved(&self) -> (usize, usize) {
        (self.size.0, (self.size.1 as i64 + self.shift).max(1) as usize)
    }

    /// Rows and columns of the prepared images.
    pub fn prepared_size(&self) -> (usize, usize) {
        let (rows, cols) = self.moved();
        (rows.div_ceil(self.factor), cols.div_ceil(self.factor))
    }

    /// The smallest whole disparity of the prepared pair that is not below one of the original pair.
    pub fn prepared(&self, disparity: i64) -> i64 {
        let factor = self.factor as i64;
        (disparity + self.shift + factor - 1).div_euclid(factor)
    }

    /// A channel of one side (0: left, 1: right), moved and reduced. Beyond the image its border is repeated.
    pub fn placed(&self, plane: &Plane<f64>, side: usize, control: &Control) -> Result<Plane<f64>> {
        let (rows, cols) = self.moved();
        let (factor, offset) = (self.factor, if side == 0 { self.shift } else { 0 });
        let last = (plane.cols() - 1) as i64;
        let share = 1.0 / (factor * factor) as f64;
        Plane::by_pixels(self.prepared_size(), control, |y, x| {
            let mut sum = 0.0;
            for y in y * factor..(y + 1) * factor {
                let row = plane.row(y.min(rows - 1));
                for x in x * factor..(x + 1) * factor {
                    let at = x.min(cols - 1) as i64 - offset;
                    sum += row[at.clamp(0, last) as usize];
                }
            }
            sum * share
        })
    }

    /// A map of the prepared pair, or a smaller or larger one in its own pixels, converted to the original
    /// left image; non-finite values are missing.
    pub fn restored(&self, map: &Plane<f32>, control: &Control) -> Result<Plane<f32>> {
        let matched = self.matched(map, control)?;
        match &self.cameras {
            Some(cameras) => raw_disparity(&matched, cameras, control),
            None => Ok(matched),
        }
    }

    /// [`Self::restored`] for the left image that is matched: the rectified one, if it was rectified.
    pub fn matched(&self, map: &Plane<f32>, control: &Control) -> Result<Plane<f32>> {
        let ratio = self.ratio(map.size())?;
        let valid = self.valid();
        let (size, shift) = (self.size, self.shift);

        Plane::by_pixels(size, control, |y, x| {
            let at = x as i64 + shift;
            let is_valid = valid.as_ref().is_none_or(|valid| valid[y * size.1 + x]);
            let value = if is_valid && at >= 0 { sampled(map, ratio, (y, at as usize)) } else { f32::NAN };
            if value.is_finite() { value - shift as f32 } else { f32::NAN }
        })
    }

    /// Moved columns per column of a map with this many rows and columns.
    fn ratio(&self, (rows, cols): (usize, usize)) -> Result<f64> {
        let (prepared, moved) = (self.prepared_size(), self.moved());
        if (rows, cols) == prepared {
            return Ok(self.factor as f64);
        }

        let ratio = moved.1 as f64 / cols.max(1) as f64;
        let is_alike = rows.min(cols) > 0 && (moved.0 as f64 / ratio - rows as f64).abs() <= 1.0;
        let reduced = ratio / self.factor as f64;
        if is_alike && (SMALLEST_RATIO..=LARGEST_RATIO).contains(&reduced) {
            return Ok(ratio);
        }
        let accepts = format!(
            "that of the prepared images, {} x {}, or a multiple or a fraction of it",
            prepared.0, prepared.1
        );
        Err(Error::value("disparity", format!("{rows} x {cols} pixels"), accepts))
    }

    /// The valid pixels; `None`: all.
    fn valid(&self) -> Option<Vec<bool>> {
        let of = |(index, run): (usize, &usize)| std::iter::repeat_n(index % 2 == 0, *run);
        (!self.runs.is_empty()).then(|| self.runs.iter().enumerate().flat_map(of).collect())
    }

    /// Its text: a line that identifies it, then one of JSON.
    pub fn written(&self) -> Result<String> {
        let json = serde_json::to_string(self).map_err(|error| wrong(&error.to_string()))?;
        Ok(format!("{HEAD}\n{json}\n"))
    }

    /// Reads a text, which may come from anyone.
    pub fn read(text: &str) -> Result<Self> {
        let (head, json) = text.split_once('\n').unwrap_or((text, ""));
        if head.trim_end() != HEAD {
            return Err(wrong(head));
        }
        let back: Self = serde_json::from_str(json).map_err(|error| wrong(&error.to_string()))?;
        if back.is_sound() { Ok(back) } else { Err(wrong("numbers out of range")) }
    }

    fn is_sound(&self) -> bool {
        let sides = 1..=MOST_SIDE;
        let is_sized = sides.contains(&self.size.0) && sides.contains(&self.size.1);
        let pixels = self.size.0.saturating_mul(self.size.1);
        let most = self.size.1 as i64;
        let is_placed = (1 - most..=most).contains(&self.shift)
            && self.factor.is_power_of_two()
            && self.factor <= super::MOST_REDUCED;
        let counted = self.runs.iter().try_fold(0usize, |sum, run| sum.checked_add(*run));
        let is_masked = self.runs.is_empty() || counted == Some(pixels);
        let are_cameras = self.cameras.as_ref().is_none_or(|cameras| {
            let numbers = cameras.numbers().iter().chain(cameras.shifts.as_flattened());
            cameras.size() == self.size && is_moderate(numbers)
        });
        is_sized && pixels <= MOST_PIXELS && is_placed && is_masked && are_cameras
    }
}

/// The lengths of runs that are valid, masked, valid ...
fn runs(valid: &[bool]) -> Vec<usize> {
    let mut found = vec![];
    if valid.first() == Some(&false) {
        found.push(0);
    }
    found.extend(valid.chunk_by(|a, b| a == b).map(<[bool]>::len));
    found
}

fn wrong(got: &str) -> Error {
    let got: String = got.chars().take(80).collect();
    Error::value("back", format!("'{got}'"), format!("a saved way back, which begins with '{HEAD}'"))
}

/// The value of a map at a pixel of the moved image, in that image's pixels; `ratio` of them are one of the
/// map.
fn sampled(map: &Plane<f32>, ratio: f64, (y, x): (usize, usize)) -> f32 {
    let place = |at: usize, count: usize| ((at as f64 + 0.5) / ratio - 0.5).clamp(0.0, (count - 1) as f64);
    let (down, along) = (place(y, map.rows()), place(x, map.cols()));
    let (top, left) = (down as usize, along as usize);
    let (bottom, right) = ((top + 1).min(map.rows() - 1), (left + 1).min(map.cols() - 1));

    let corners = [map.row(top)[left], map.row(top)[right], map.row(bottom)[left], map.row(bottom)[right]];
    let low = corners.iter().fold(f32::INFINITY, |low, value| low.min(*value));
    let high = corners.iter().fold(f32::NEG_INFINITY, |high, value| high.max(*value));
    let is_smooth = corners.iter().all(|value| value.is_finite()) && high - low <= JUMP;
    let value = if is_smooth {
        let between = |a: f32, b: f32, share: f64| f64::from(a) + share * f64::from(b - a);
        let upper = between(corners[0], corners[1], along.fract());
        let lower = between(corners[2], corners[3], along.fract());
        upper + down.fract() * (lower - upper)
    } else {
        f64::from(map.row(down.round() as usize)[along.round() as usize])
    };
    (value * ratio) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn back(shift: i64, factor: usize) -> Back {
        Back { size: (9, 20), shift, factor, cameras: None, runs: vec![] }
    }

    #[test]
    fn a_plane_comes_back_from_any_shift_and_size() {
        let truth = |y: usize, x: usize| 0.2 * x as f32 - 0.1 * y as f32 - 3.0;
        for (shift, factor) in [(0, 1), (5, 1), (-4, 1), (0, 2), (6, 4), (-3, 2)] {
            let back = back(shift, factor);
            let (rows, cols) = back.prepared_size();
            let by = factor as f32;
            let map = Plane::from_fn(rows, cols, |y, x| {
                let [y, x] = [y, x].map(|at| (at as f32 + 0.5) * by - 0.5);
                (0.2 * (x - shift as f32) - 0.1 * y - 3.0 + shift as f32) / by
            });
            let found = back.restored(&map, &Control::default()).expect("of this size");
            for (y, x) in (0..9).flat_map(|y| (0..20).map(move |x| (y, x))) {
                let value = found.row(y)[x];
                let is_gone = (x as i64) < -shift;
                assert_eq!(value.is_nan(), is_gone, "{shift} {factor} {y} {x}");
                // Beyond the outermost centers of a smaller map, its slope is unknown.
                let inside = factor == 1 || (4..5).contains(&y) && (8..14).contains(&x);
                assert!(is_gone || !inside || (value - truth(y, x)).abs() < 1e-4, "{value}");
            }
        }
    }

    #[test]
    fn jumps_and_missing_values_are_not_smeared() {
        let map = Plane::from_fn(5, 10, |_, x| if x < 5 { 2.0 } else { 9.0 });
        let found = back(0, 2).restored(&map, &Control::default()).expect("half the size");
        assert!(found.as_slice().iter().all(|d| [4.0, 18.0].contains(&f64::from(*d))));

        let sparse = Plane::from_fn(9, 20, |y, x| if (y, x) == (3, 7) { 1.5 } else { f32::INFINITY });
        let found = back(0, 1).restored(&sparse, &Control::default()).expect("the same size");
        assert_eq!(found.as_slice().iter().filter(|d| d.is_finite()).count(), 1);
    }

    #[test]
    fn what_is_written_is_read_and_the_rest_refused() {
        let mut whole = back(3, 2);
        whole.runs = runs(&(0..180).map(|at| at % 7 > 1).collect::<Vec<_>>());
        let text = whole.written().expect("memory");
        assert_eq!(Back::read(&text).as_ref(), Ok(&whole));

        for (from, to) in [
            ("\"shift\":3", "\"shift\":99"),
            ("\"factor\":2", "\"factor\":3"),
            ("[9,20]", "[0,20]"),
            ("back 1", "back 9"),
        ] {
            assert!(text.contains(from), "{text}");
            let refused = Back::read(&text.replace(from, to)).expect_err("must be refused");
            assert!(refused.to_string().starts_with("back: got '"), "{refused}");
        }
        let refused = whole.restored(&Plane::from_fn(3, 3, |_, _| 0.0), &Control::default());
        assert!(refused.expect_err("another size").to_string().starts_with("disparity: got 3 x 3"));
    }
}
