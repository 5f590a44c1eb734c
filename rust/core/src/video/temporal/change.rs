//! Where a view of a video has changed by more than its noise.
//!
//! A view is compared with its mean over the frames since each place last changed, so changes too slow to be
//! seen from one frame to the next add up. Places are the pixels of every [`CHANGE_STEP`]th row and column,
//! and represent the pixels up to the next ones. With `g` the gray value of this frame, `m` and `n` mean and
//! count of earlier ones, and `noise` the variance of the noise:
//!
//! ```text
//! gain    = median of g / m over some places, or 1                   the change of exposure
//! off     = g - gain m         0 where the brighter of both is at white and may have been brighter still
//! excess  = min(off^2 / noise, LARGEST_SQUARE) - CHANGE_RATIO (1 + 1 / n)  0 if outside or g or m is unknown
//! changed = the sum of the excesses of 3 x 3 places is positive, or g or m is unknown
//! if changed:  n = 1                    m = g
//! else:        n = min(n + 1, MEAN_FRAMES)   m = gain m + (g - gain m) / n
//! ```
//!
//! A change of exposure changes all gray values alike, so their quotients agree; if they do not, as when the
//! camera moves, the gain is 1. A gain that is hardly more than noise is also 1.
//!
//! `noise (1 + 1 / n)` is the expectation of `(g - m)^2` where nothing has changed. Masked pixels are
//! unknown.
//!
//! The noise is estimated in each frame: the mean square of the second difference along both axes (Immerkaer
//! 1996), which cancels everything but noise and fine texture, in blocks of 8 x 8 pixels; the quietest
//! twentieth of the blocks gives the estimate. The noise of the blur estimation is not a substitute, since
//! `fast` runs without it. One variance is assumed for the whole view. If noise grows with the light, the
//! filter does nearly as well.
//!
//! Values are 32-bit floats, each computed by itself in the order above: no result depends on threads or
//! lanes.

use rayon::prelude::*;

use crate::video::choices::{
    AGREEING_GAINS, CHANGE_RATIO, CHANGE_STEP, DARK_BELOW, EVEN_GAIN, GAIN_STEP, LARGEST_SQUARE,
    LEAST_GAIN_PLACES, LEAST_NOISE, MEAN_FRAMES, MOST_NOISE, NOISE_BLOCK, NOISE_BLOCKS, NOISE_FACTOR,
    QUIET_DIVISOR, WHITE_FROM,
};
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::{Plane, zeroed};
use phasestereo_match::base::simd::{Level, leveled};
use phasestereo_match::base::statistics::ranked;
use phasestereo_match::image::gray_scale::GrayScale;
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::runtime::Runtime;

/// Gray levels from black to white.
const WHITE: f64 = 255.0;
/// Largest relative difference of equal units.
const SAME_UNIT: f64 = 1e-6;

/// The conversion of pixels to gray levels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// The scale of the first frame.
    gray: GrayScale,
    /// Black, in units of the pixels.
    black: f64,
    /// Gray levels per unit.
    factor: f64,
}

impl Scale {
    /// The scale of a view. The range of this frame also holds for later ones.
    pub fn of_view(view: &View) -> Self {
        let gray = view.scale();
        let width = if gray.width() > 0.0 { gray.width() } else { 1.0 };
        Self { gray, black: gray.pixel(gray.range()[0].into()), factor: WHITE / width }
    }

    /// Whether the view has pixels of this kind and unit.
    pub fn suits(&self, view: &View) -> bool {
        let scale = view.scale();
        // Units that are determined from the values of each frame may differ by a rounding.
        let is_same_unit = match self.gray.step().zip(scale.step()) {
            Some((own, other)) => (other / own - 1.0).abs() < SAME_UNIT,
            None => self.gray.step().is_none() && scale.step().is_none(),
        };
        is_same_unit && self.gray.ends() == scale.ends()
    }

    /// Writes the gray levels of a row; NaN where they are masked.
    fn write(&self, view: &View, y: usize, level: Level, gray: &mut [f32]) {
        let scale = view.scale();
        // If both are bytes, all of this is exact.
        let black = (scale.pixel(0.0) - self.black) * self.factor;
        let factor = self.factor / scale.steps(1.0);
        let (factor, black) = (factor as f32, black as f32);
        to_gray_levels(level, view.gray().row(y), factor, black, gray);

        if let Some(mask) = view.mask() {
            for (gray, is_valid) in gray.iter_mut().zip(mask.row(y)) {
                *gray = if *is_valid { *gray } else { f32::NAN };
            }
        }
    }
}

/// The means of a view over the frames before, and where the last frame changed.
#[derive(Debug)]
pub struct ViewChanges {
    scale: Scale,
    /// Mean gray levels of the places ...
    mean: Plane<f32>,
    /// ... and their numbers of frames; 0: unknown.
    count: Plane<u8>,
    changed: Plane<bool>,
    /// The gray levels of the last frame ...
    gray: Plane<f32>,
    /// ... and their excesses, with one more place on each side, where nothing is in excess.
    excess: Plane<f32>,
}

impl ViewChanges {
    /// The state before the first frame.
    pub fn new((rows, cols): (usize, usize), scale: Scale) -> Result<Self> {
        let rows = rows.div_ceil(CHANGE_STEP);
        let cols = cols.div_ceil(CHANGE_STEP);

        Ok(Self {
            scale,
            mean: Plane::new(rows, cols)?,
            count: Plane::new(rows, cols)?,
            changed: Plane::new(rows, cols)?,
            gray: Plane::new(rows, cols)?,
            excess: Plane::new(rows + 2, cols + 2)?,
        })
    }

    /// Which places of image row `y` changed in the last frame.
    pub fn row(&self, y: usize) -> &[bool] {
        self.changed.row(y / CHANGE_STEP)
    }

    /// Finds where the next frame has changed, and updates the means.
    pub fn update(&mut self, view: &View, runtime: Runtime) -> Result<()> {
        let noise = noise(view, &self.scale, runtime)?;
        let gain = self.gain(view, runtime)?;
        self.compare(view, noise, gain, runtime)?;

        let Self { mean, count, changed, gray, excess, .. } = self;
        let cols = changed.cols();
        let rows = mean.as_mut_slice().par_chunks_mut(cols);
        let rows = rows.zip(count.as_mut_slice().par_chunks_mut(cols));
        let rows = rows.zip(changed.as_mut_slice().par_chunks_mut(cols)).enumerate();
        rows.for_each(|(y, ((mean, count), changed))| {
            let excess = [y, y + 1, y + 2].map(|y| excess.row(y));
            update_row(runtime.level(), excess, gray.row(y), gain, mean, count, changed);
        });

        Ok(())
    }

    /// The exposure of a frame relative to that of the means.
    fn gain(&self, view: &View, runtime: Runtime) -> Result<f32> {
        let Self { scale, mean, count, .. } = self;
        let mut row: Vec<f32> = zeroed(view.size().1)?;
        let mut quotients = vec![];
        for y in (0..mean.rows()).step_by(GAIN_STEP) {
            runtime.control.checkpoint()?;
            scale.write(view, CHANGE_STEP * y, runtime.level(), &mut row);
            for x in (0..mean.cols()).step_by(GAIN_STEP) {
                let (gray, mean) = (row[CHANGE_STEP * x], mean.row(y)[x]);
                let range = DARK_BELOW..WHITE_FROM;
                if count.row(y)[x] > 0 && range.contains(&gray) && range.contains(&mean) {
                    quotients.push(gray / mean);
                }
            }
        }
        if quotients.len() < LEAST_GAIN_PLACES {
            return Ok(1.0);
        }

        let mut quartile = |number: usize| {
            let at = quotients.len() * number / 4;
            ranked(&mut quotients, at).unwrap_or(1.0)
        };
        let [low, middle, high] = [1, 2, 3].map(&mut quartile);
        let is_even = (middle - 1.0).abs() < EVEN_GAIN || high - low > AGREEING_GAINS * middle;
        Ok(if is_even { 1.0 } else { middle })
    }

    /// Computes gray levels and excesses.
    fn compare(&mut self, view: &View, noise: f32, gain: f32, runtime: Runtime) -> Result<()> {
        let Self { scale, mean, count, gray, excess, .. } = self;
        let (cols, image_cols) = (gray.cols(), view.size().1);
        let inside = excess.as_mut_slice().par_chunks_mut(cols + 2).skip(1);
        let rows = gray.as_mut_slice().par_chunks_mut(cols).zip(inside).enumerate();

        let compare_row = |row: &mut Result<Vec<f32>>,
                           (y, (gray, excess)): (usize, (&mut [f32], &mut [f32]))| {
            runtime.control.checkpoint()?;

            let row = row.as_mut().map_err(|error| error.clone())?;
            scale.write(view, CHANGE_STEP * y, runtime.level(), row);
            for (gray, value) in gray.iter_mut().zip(row.iter().step_by(CHANGE_STEP)) {
                *gray = *value;
            }

            let (mean, count) = (mean.row(y), count.row(y));
            let out = &mut excess[1..=cols];
            write_excess(runtime.level(), gray, mean, count, 1.0 / noise, gain, out);
            Ok(())
        };
        rows.try_for_each_init(|| zeroed(image_cols), compare_row)
    }
}

/// Scales a row of integers to gray levels.
#[leveled]
fn to_gray_levels(level: Level, values: &[i32], factor: f32, black: f32, gray: &mut [f32]) {
    for (gray, value) in gray.iter_mut().zip(values) {
        *gray = *value as f32 * factor + black;
    }
}

/// The excesses of a row of places. `inverse`: that of the noise.
#[leveled]
fn write_excess(
    level: Level,
    gray: &[f32],
    mean: &[f32],
    count: &[u8],
    inverse: f32,
    gain: f32,
    excess: &mut [f32],
) {
    let cols = excess.len();
    let (gray, mean, count) = (&gray[..cols], &mean[..cols], &count[..cols]);

    for x in 0..cols {
        let difference = gray[x] - gain * mean[x];
        // A white pixel may have been brighter still.
        let is_white = if difference > 0.0 { mean[x] } else { gray[x] } >= WHITE_FROM;
        let difference = if is_white { 0.0 } else { difference };
        let square = (difference * difference) * inverse;
        let square = if square < LARGEST_SQUARE { square } else { LARGEST_SQUARE };

        let value = square - (CHANGE_RATIO + CHANGE_RATIO / f32::from(count[x]));
        excess[x] = if (count[x] == 0) | gray[x].is_nan() { 0.0 } else { value };
    }
}

/// Changes and means of a row of places; `excess` has the rows above and below, too.
#[leveled]
fn update_row(
    level: Level,
    excess: [&[f32]; 3],
    gray: &[f32],
    gain: f32,
    mean: &mut [f32],
    count: &mut [u8],
    changed: &mut [bool],
) {
    let cols = gray.len();
    let [above, own, below] = excess.map(|row| &row[..cols + 2]);
    let (mean, count, changed) = (&mut mean[..cols], &mut count[..cols], &mut changed[..cols]);

    for x in 0..cols {
        let column = |x: usize| (above[x] + own[x]) + below[x];
        let sum = (column(x) + column(x + 1)) + column(x + 2);
        let is_unknown = gray[x].is_nan();
        let has_changed = (sum > 0.0) | is_unknown | (count[x] == 0);

        let more = if count[x] < MEAN_FRAMES { count[x] + 1 } else { MEAN_FRAMES };
        let before = gain * mean[x];
        let value = before + (gray[x] - before) / f32::from(more);
        let value = if has_changed { gray[x] } else { value };
        let frames = if has_changed { 1 } else { more };

        mean[x] = if is_unknown { 0.0 } else { value };
        count[x] = if is_unknown { 0 } else { frames };
        changed[x] = has_changed;
    }
}

/// The variance of the noise of a view, squared gray levels.
pub fn noise(view: &View, scale: &Scale, runtime: Runtime) -> Result<f32> {
    let (rows, cols) = view.size();

    // Second differences need a neighbor on every side.
    let [block_rows, block_cols] = [rows, cols].map(|length| length.saturating_sub(2) / NOISE_BLOCK);
    if block_cols == 0 {
        return Ok(LEAST_NOISE * LEAST_NOISE);
    }
    let step = (block_rows * block_cols).div_ceil(NOISE_BLOCKS).max(1);

    let squares = (0..block_rows.div_ceil(step)).into_par_iter().map(|index| {
        runtime.control.checkpoint()?;
        block_squares(view, scale, index * step * NOISE_BLOCK, runtime.level())
    });
    let squares: Vec<_> = squares.collect::<Result<_>>()?;

    let mut squares: Vec<f32> = squares.into_iter().flatten().filter(|square| !square.is_nan()).collect();
    let quiet = squares.len() / QUIET_DIVISOR;
    let square = ranked(&mut squares, quiet).unwrap_or(0.0);
    Ok((square * NOISE_FACTOR).clamp(LEAST_NOISE * LEAST_NOISE, MOST_NOISE * MOST_NOISE))
}

/// The mean squares of the second differences in a row of blocks; the row above its pixels is row `first`.
/// NaN where pixels are masked.
fn block_squares(view: &View, scale: &Scale, first: usize, level: Level) -> Result<Vec<f32>> {
    let cols = view.size().1;
    let mut rows = [zeroed(cols)?, zeroed(cols)?, zeroed(cols)?];
    let mut sums = zeroed(cols - 2)?;

    for y in 0..NOISE_BLOCK + 2 {
        scale.write(view, first + y, level, &mut rows[y % 3]);
        if y >= 2 {
            let rows = [y - 2, y - 1, y].map(|slot| &*rows[slot % 3]);
            sum_squares(level, rows, &mut sums);
        }
    }

    let pixels = (NOISE_BLOCK * NOISE_BLOCK) as f32;
    Ok(sums.chunks_exact(NOISE_BLOCK).map(|block| block.iter().sum::<f32>() / pixels).collect())
}

/// Adds the squared second differences of a row to those of its block. A sixth of the mask 1 -2 1 along both
/// axes keeps the variance of white noise.
#[leveled]
fn sum_squares(level: Level, rows: [&[f32]; 3], sums: &mut [f32]) {
    let cols = sums.len();
    let [above, own, below] = rows.map(|row| &row[..cols + 2]);

    for (x, sum) in sums.iter_mut().enumerate() {
        let column = |x: usize| (above[x] + below[x]) - 2.0 * own[x];
        let second = ((column(x) + column(x + 2)) - 2.0 * column(x + 1)) / 6.0;
        *sum += second * second;
    }
}
