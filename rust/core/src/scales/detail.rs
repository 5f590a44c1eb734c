//! What an image shows around each pixel, and whether that is more than its noise.
//!
//! ```text
//! gray[0]    = gray values of the image;  gray[k + 1] = means of squares of four of gray[k]
//! noise[k]   = noise / 2^k
//! rest[k]    = gray[k] - mean of gray[k] over 7 x 7 pixels
//! detail[k]  = mean square of rest[k] / noise[k], over 9 x 9 pixels
//! sides[k]   = least detail[k] of the four places SIDE pixels to the left and right, above and below
//! seen[y, x] = detail[0] >= SEEN at (y, x), or sides[k] >= SEEN at (y, x) / 2^k, for a k up to HALVINGS,
//!              or up to the number of halvings of the copy whose disparity the pixel has, if that is more
//! ```
//!
//! Where nothing is seen, codes are those of noise, or of an edge within the windows: a pixel may match
//! there, and agree with others, but without evidence in the image. The four places separate the two cases.
//! Beside the edge of a house, a plain sky shows detail on one side only; a faintly textured wall shows it on
//! all sides.
//!
//! Noise is estimated from the quietest blocks. If all blocks show fine texture, that counts as noise, but
//! such texture is matched with confidence: pixels that are sure by themselves, `TRUST`, are doubted only
//! where their detail is that of rounding.
//!
//! Rests are integers, in parts of the noise, and clipped: a single one of `MOST` or more makes more detail
//! than any bound. So the sums of their squares have no error, and fit into 32 bits.

use std::borrow::Cow;

use crate::scales::choice::halvings;
use crate::scales::choices::{DETAIL_RADIUS, FAINT, HALVINGS, ROUNDING, SEEN, SMOOTH_RADIUS, TRUST};
use crate::scales::reduction::sum_of_four;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::{Plane, TASK_ROWS};
use phasestereo_match::base::simd::{Level, leveled, whole};
use phasestereo_match::image::window_sums::Windows;
use phasestereo_match::matcher::runtime::Runtime;

/// Parts of the noise in which rests count: `MOST` is 27 times the noise.
const PARTS: f64 = 256.0;
/// Largest rest, in these parts: the sum of its squares over a window fits into 32 bits.
const MOST: f32 = 7000.0;
const _: () = assert!((MOST as u64).pow(2) * ((2 * DETAIL_RADIUS + 1) as u64).pow(2) <= u32::MAX as u64);
/// Pixels to each side: the windows there end at the pixel.
const SIDE: usize = SMOOTH_RADIUS + DETAIL_RADIUS;
/// Copies whose gray values are sums of four of the larger ones, without rounding; smaller copies use means.
/// So they fit into 32 bits.
const SUMMED: usize = 2;

/// Marks that no copy shows more than noise.
const NOWHERE: u8 = u8::MAX;

/// The detail of an image.
pub struct Detail<'a> {
    /// Gray values of 15 bits.
    gray: &'a Plane<i32>,
    /// The standard deviation of their noise, not below that of rounding.
    noise: f64,
    /// One step of rounding; 0: floats.
    step: f64,
    /// Mean squares, in squares of parts of the noise.
    squares: Plane<f32>,
}

impl<'a> Detail<'a> {
    /// The detail of 15-bit gray values with noise of this standard deviation (0: unknown), rounded to
    /// multiples of this step (0: floats, which may also have been rounded).
    pub fn new(gray: &'a Plane<i32>, noise: f64, step: f64, runtime: Runtime) -> Result<Self> {
        let noise = noise.max(ROUNDING * step);
        Ok(Self { gray, noise, step, squares: squares(gray, noise, runtime)? })
    }

    /// The pixels with hardly any detail; `None`: all detail counts.
    pub fn faint(&self) -> Option<Plane<bool>> {
        let most = square_of(FAINT * self.step / self.noise);
        (self.step > 0.0).then(|| self.squares.map(|square| *square <= most))
    }

    /// The pixels without evidence: they show only noise and are not sure by themselves, or they show only
    /// rounding. `flags` are those of a map whose scales are not concluded.
    pub fn unseen(
        self,
        flags: &Plane<u16>,
        confidence: &Plane<f32>,
        runtime: Runtime,
    ) -> Result<Plane<bool>> {
        let halved = flags.as_slice().iter().map(|flags| halvings(*flags)).max().unwrap_or(0);
        let rounding = square_of(SEEN.sqrt() * ROUNDING * self.step / self.noise);
        let scales = self.of_copies(halved.max(HALVINGS), runtime)?;

        let (rows, cols) = scales[scales.len() - 1].size();
        let mut first = Plane::from_fn(rows.div_ceil(2), cols.div_ceil(2), |_, _| NOWHERE);
        for (k, squares) in scales.iter().enumerate().rev() {
            first = Plane::by_rows(squares.size(), runtime.control, |y, seen: &mut [u8]| {
                double(first.row((y / 2).min(first.rows() - 1)), seen);
                mark_seen(runtime.level(), squares, y, k as u8, seen);
            })?;
        }

        Plane::by_rows(flags.size(), runtime.control, |y, unseen: &mut [bool]| {
            let known = first.row(y).iter().zip(flags.row(y));
            let own = confidence.row(y).iter().zip(scales[0].row(y));
            for ((unseen, (first, flags)), (confidence, square)) in unseen.iter_mut().zip(known).zip(own) {
                let is_unseen = usize::from(*first) > halvings(*flags).max(HALVINGS);
                *unseen = is_unseen & ((*confidence < TRUST) | (*square < rounding));
            }
        })
    }

    /// The squares of the image and its copies, down to one with this many halvings, if the image is large
    /// enough.
    fn of_copies(self, halved: usize, runtime: Runtime) -> Result<Vec<Plane<f32>>> {
        let mut scales = vec![self.squares];
        let mut copy = Cow::Borrowed(self.gray);
        for k in 1..=halved {
            if copy.rows().min(copy.cols()) < 2 {
                break;
            }
            let lost = if k > SUMMED { 2 } else { 0 };
            let size = (copy.rows() / 2, copy.cols() / 2);
            copy = Cow::Owned(Plane::by_rows(size, runtime.control, |y, sums: &mut [i32]| {
                sums.iter_mut().enumerate().for_each(|(x, sum)| *sum = sum_of_four(&copy, y, x) >> lost);
            })?);
            let noise = self.noise * 2_f64.powi(2 * k.min(SUMMED) as i32 - k as i32);
            scales.push(squares(&copy, noise, runtime)?);
        }
        Ok(scales)
    }
}

/// The square of this multiple of the noise.
fn square_of(times: f64) -> f32 {
    // A single clipped rest is more.
    let side = (2 * DETAIL_RADIUS + 1) as f64;
    (times * PARTS).min((f64::from(MOST) - 1.0) / side).powi(2) as f32
}

/// Copies a row of a copy to one that is twice as wide, or one pixel wider.
fn double(from: &[u8], to: &mut [u8]) {
    let (pairs, rest) = to.as_chunks_mut::<2>();
    pairs.iter_mut().zip(from).for_each(|(pair, from)| *pair = [*from; 2]);
    rest.fill(from[from.len() - 1]);
}

/// Writes `k` to the pixels of row `y` at which copy `k` shows more than noise.
#[leveled]
fn mark_seen(level: Level, squares: &Plane<f32>, y: usize, k: u8, seen: &mut [u8]) {
    let least = square_of(SEEN.sqrt());
    let (last, end) = (squares.rows() - 1, seen.len() - 1);
    let [own, above, below] =
        [y, y.saturating_sub(SIDE), (y + SIDE).min(last)].map(|y| &squares.row(y)[..=end]);
    let mut mark = |x: usize, left: f32, right: f32| {
        let sides = left.min(right).min(above[x]).min(below[x]);
        let is_seen = (sides >= least) | ((k == 0) & (own[x] >= least));
        seen[x] = if is_seen { k } else { seen[x] };
    };

    // Without clamped columns, the compiler marks many pixels at once.
    let inner = SIDE.min(end)..(end + 1).saturating_sub(SIDE);
    for x in (0..inner.start).chain(inner.end.max(inner.start)..=end) {
        mark(x, own[x.saturating_sub(SIDE)], own[(x + SIDE).min(end)]);
    }
    for (x, (left, right)) in inner.zip(own.iter().zip(own.iter().skip(2 * SIDE))) {
        mark(x, *left, *right);
    }
}

/// The mean squares of detail around each pixel, in squares of parts of this noise.
fn squares(gray: &Plane<i32>, noise: f64, runtime: Runtime) -> Result<Plane<f32>> {
    let size = gray.size();
    let (means, parts) = (Windows::new(size, SMOOTH_RADIUS), (PARTS / noise) as f32);
    let rest = Plane::by_bands(size, TASK_ROWS, |first, band| {
        runtime.control.checkpoint()?;
        let values = |y: usize| gray.row(y).iter().map(|gray| [*gray]);
        means.write((first, band), values, |_, _, [sum]: [i32; 1]| sum, runtime.level())?;
        for (y, rests) in (first..).zip(band.chunks_exact_mut(size.1)) {
            write_rests(runtime.level(), means, y, gray.row(y), parts, rests);
        }
        Ok(())
    })?;

    let around = Windows::new(size, DETAIL_RADIUS);
    let values = |y: usize| rest.row(y).iter().map(|rest| [(rest * rest) as u32]);
    let mean = move |y: usize, x: usize, [sum]: [u32; 1]| sum as f32 / around.pixels(y, x) as f32;
    around.plane(values, mean, runtime.level(), runtime.control)
}

/// Turns the sums of gray values over the windows of row `y` into rests.
#[leveled]
fn write_rests(level: Level, means: Windows, y: usize, gray: &[i32], parts: f32, rests: &mut [i32]) {
    for (x, (rest, gray)) in rests.iter_mut().zip(gray).enumerate() {
        let count = means.pixels(y, x) as i32;
        let quotient = (count * gray - *rest) as f32 / count as f32 * parts;
        *rest = whole(quotient.clamp(-MOST, MOST));
    }
}
