//! A raw view -> the rectified one, and a map of the rectified pair -> one of the raw left image.
//!
//! ```text
//! place = the raw place of the rectified pixel, in steps of 1 / 64 pixel
//! out = sum over rows j and columns i of 8 x 8 pixels around it of weights[j] weights[i] raw    # Lanczos
//! valid if the place is inside the raw image, and the raw pixel nearest to it is valid
//!
//! q = the place of the raw left pixel p in the rectified image;   d = disparity of the pixel nearest to q
//! p' = the place of (q.x - d, q.y) in the raw right image
//! disparity(p) = p.x - p'.x,  rows(p) = p'.y - p.y
//! ```
//!
//! A map of the raw pair is converted to one of the rectified pair by solving this for `d`.
//!
//! The weights are those of [`phasestereo_match::image::resampling`]. Disparities are copied from the nearest
//! pixel, since a mean over a jump would belong to neither side. Sums have a fixed order; those of integers
//! are exact.

use std::array::from_fn;

use super::cameras::{Backward, Cameras, Point};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::{Level, Loop, leveled};
use phasestereo_match::image::pixels::{Input, Resampler};
use phasestereo_match::image::resampling::{CENTER, STEPS, TAPS, WEIGHT_BITS, weights};
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::refinement::flag;

/// Pixels whose places are computed at once.
const LANES: usize = 32;

/// The raw place of each pixel of a rectified image: column and row, NaN where no ray comes from.
pub type Places = Plane<[f32; 2]>;

/// How images are read between their pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// From the four pixels around a place, in single precision, with 0 beyond the image, like OpenCV's
    /// `remap`.
    Linear,
    /// From 8 x 8 pixels, at 64 places between two; the border is repeated.
    Lanczos,
}

/// The places of all pixels of the left (0) or the right image (1).
pub fn places(cameras: &Cameras, camera: usize, size: (usize, usize), control: &Control) -> Result<Places> {
    let backward = cameras.backward(camera);
    Plane::by_pixels(size, control, |y, x| backward.place([x as f64, y as f64]).map(|at| at as f32))
}

/// The rectified view.
pub fn rectified(view: &View, places: &Places, control: &Control) -> Result<View> {
    // Masked pixels must not spread over the taps.
    let source = view.filled_along_columns(TAPS);
    let (rows, cols) = view.size();
    let warp = Warp { places, interpolation: Interpolation::Lanczos, control };
    let scale = view.scale();
    let gray = warp.resampled(&source, (rows, cols, 1), |gray| scale.nearest(gray))?;

    let mask = warp.mask((rows, cols), |y, x| view.is_valid(y, x))?;
    Ok(View::new(Plane::from_vec(rows, cols, gray)?, Some(mask), scale))
}

/// The rectified image, in pixels of its own type.
pub fn rectified_input(
    input: &Input,
    places: &Places,
    interpolation: Interpolation,
    control: &Control,
) -> Result<Input> {
    let warp = Warp { places, interpolation, control };
    let mask = warp.mask(input.size(), |y, x| input.is_valid(y, x))?;
    input.resampled(&warp, Some(mask))
}

/// How a raw image is read.
struct Warp<'a> {
    places: &'a Places,
    interpolation: Interpolation,
    control: &'a Control,
}

impl Warp<'_> {
    /// The rectified pixels whose places are inside a raw image of this size, on valid pixels.
    fn mask(
        &self,
        (rows, cols): (usize, usize),
        is_valid: impl Fn(usize, usize) -> bool + Sync,
    ) -> Result<Plane<bool>> {
        let ends = [cols as f32 - 1.0, rows as f32 - 1.0];
        let is_seen = |place: [f32; 2]| {
            let is_inside = (0..2).all(|axis| (0.0..=ends[axis]).contains(&place[axis]));
            let [x, y] = place.map(|at| at.round() as usize);
            is_inside && is_valid(y, x)
        };
        Plane::by_pixels((rows, cols), self.control, |y, x| is_seen(self.places.row(y)[x]))
    }
}

impl Resampler for Warp<'_> {
    fn size(&self) -> (usize, usize) {
        self.places.size()
    }

    fn resampled<T: Copy + Default + Send + Sync + Into<f64>>(
        &self,
        pixels: &[T],
        (rows, cols, channels): (usize, usize, usize),
        nearest: impl Fn(f64) -> T + Sync,
    ) -> Result<Vec<T>> {
        let source = RawPixels { pixels, rows, cols, channels, nearest };
        let out = Plane::by_rows((rows, cols * channels), self.control, |y, out: &mut [T]| {
            match self.interpolation {
                Interpolation::Linear => {
                    let pixels = out.chunks_exact_mut(channels).zip(self.places.row(y));
                    pixels.for_each(|(out, place)| source.write_linear(*place, out));
                }
                Interpolation::Lanczos => {
                    Level::best().run(LanczosRow { source: &source, places: self.places.row(y), out });
                }
            }
        })?;
        Ok(out.into_vec())
    }
}

/// A row of resampled pixels, writable.
struct LanczosRow<'a, T, N> {
    source: &'a RawPixels<'a, T, N>,
    places: &'a [[f32; 2]],
    out: &'a mut [T],
}

impl<T: Copy + Into<f64>, N: Fn(f64) -> T> Loop for LanczosRow<'_, T, N> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let weights = weights();
        for (out, place) in self.out.chunks_exact_mut(self.source.channels).zip(self.places) {
            self.source.write(weights, *place, out);
        }
    }
}

/// An image, row after row.
struct RawPixels<'a, T, N> {
    pixels: &'a [T],
    rows: usize,
    cols: usize,
    channels: usize,
    /// Rounds a value to one of the pixels' type.
    nearest: N,
}

impl<T: Copy + Into<f64>, N: Fn(f64) -> T> RawPixels<'_, T, N> {
    /// Writes the channels at a place. Beyond the image its border is repeated; a missing place gives 0.
    #[inline(always)]
    fn write(&self, weights: &[[i32; TAPS]; STEPS as usize], place: [f32; 2], out: &mut [T]) {
        if place[0].is_nan() {
            return;
        }

        let steps = place.map(|at| (f64::from(at) * f64::from(STEPS)).round() as i64);
        let step = i64::from(STEPS);
        let [along, down] = steps.map(|at| &weights[at.rem_euclid(step) as usize]);
        let [column, row] = steps.map(|at| at.div_euclid(step) as isize - CENTER);
        let clamp = |at: isize, length: usize| at.clamp(0, length as isize - 1) as usize;
        let columns: [usize; TAPS] = from_fn(|tap| clamp(column + tap as isize, self.cols));
        let length = self.cols * self.channels;
        // Where the values begin if they lie side by side; else beyond the row.
        let is_inside = self.channels == 1 && columns[TAPS - 1] - columns[0] == TAPS - 1;
        let first = if is_inside { columns[0] } else { length };

        let scale = f64::from(1u32 << WEIGHT_BITS).powi(2);
        for (channel, out) in out.iter_mut().enumerate() {
            let mut sums = [0.0; TAPS];
            for (tap, weight) in (0..).zip(down) {
                let row = &self.pixels[clamp(row + tap, self.rows) * length..][..length];
                let values: [f64; TAPS] = match row[first..].first_chunk::<TAPS>() {
                    Some(values) => values.map(Into::into),
                    None => columns.map(|at| row[at * self.channels + channel].into()),
                };
                for (sum, value) in sums.iter_mut().zip(values) {
                    *sum += f64::from(*weight) * value;
                }
            }
            let sum = sums.iter().zip(along).fold(0.0, |all, (sum, weight)| all + sum * f64::from(*weight));
            *out = (self.nearest)(sum / scale);
        }
    }

    /// Writes the channels interpolated between the four pixels around a place. Missing places give 0.
    fn write_linear(&self, place: [f32; 2], out: &mut [T]) {
        let corner = place.map(f32::floor);
        let [right, down] = from_fn(|axis| f64::from(place[axis] - corner[axis]));
        let farthest = self.rows.max(self.cols) as f32;
        let [column, row] = corner.map(|at| at.clamp(-2.0, farthest) as isize);

        // A product of singles is exact as a double: only the result of each step is rounded.
        let single = |value: f64| f64::from(value as f32);
        let between = |one: f64, other: f64, share: f64| single(one + single(other - one) * share);
        for (channel, out) in out.iter_mut().enumerate() {
            let value = |row: isize, column: isize| -> f64 {
                let is_inside =
                    (0..self.rows as isize).contains(&row) && (0..self.cols as isize).contains(&column);
                let at = || (row as usize * self.cols + column as usize) * self.channels + channel;
                if is_inside { self.pixels[at()].into() } else { 0.0 }
            };
            let along = |row: isize| between(value(row, column), value(row, column + 1), right);
            *out = (self.nearest)(between(along(row), along(row + 1), down));
        }
    }
}

/// A map of the rectified pair, converted to the raw left image, and how many rows lower each pixel is in the
/// raw right image (NaN without a disparity).
pub fn raw(map: &Disparity, cameras: &Cameras, control: &Control) -> Result<(Disparity, Plane<f32>)> {
    let claims = claims(&map.disparity, cameras, control)?;

    let flags = sampled(&map.flags, &claims, flag::NO_CANDIDATE, control)?;
    let confidence = map.confidence.as_ref();
    let confidence = confidence.map(|plane| sampled(plane, &claims, 0.0, control)).transpose()?;
    let uncertainty = map.uncertainty.as_ref().map(|plane| -> Result<Plane<f32>> {
        let mut found = sampled(plane, &claims, f32::NAN, control)?;
        for (value, claim) in found.as_mut_slice().iter_mut().zip(claims.as_slice()) {
            *value *= claim.scale;
        }
        Ok(found)
    });

    let raw = Disparity {
        disparity: claims.map(|claim| claim.disparity),
        flags,
        confidence,
        uncertainty: uncertainty.transpose()?,
        wrong: map.wrong,
        detail: map.detail,
        timings: map.timings,
    };
    Ok((raw, claims.map(|claim| claim.lower)))
}

/// Disparities of the rectified pair, converted to the raw left image; NaN without one.
pub fn raw_disparity(disparity: &Plane<f32>, cameras: &Cameras, control: &Control) -> Result<Plane<f32>> {
    Ok(claims(disparity, cameras, control)?.map(|claim| claim.disparity))
}

/// The data that a raw left pixel takes from the nearest rectified pixel. NaN without a disparity.
#[derive(Debug, Clone, Copy, Default)]
struct Claim {
    /// The number of the rectified pixel in reading order, or the number of pixels if it lies beyond the
    /// image.
    index: u64,
    /// How many columns farther left the pixel is in the raw right image, and how many rows lower.
    disparity: f32,
    lower: f32,
    /// Raw columns per rectified column there.
    scale: f32,
}

fn claims(disparity_map: &Plane<f32>, cameras: &Cameras, control: &Control) -> Result<Plane<Claim>> {
    let size @ (rows, cols) = disparity_map.size();
    let backward = cameras.backward(1);
    Plane::by_rows(size, control, |y, out: &mut [Claim]| {
        for (index, out) in out.chunks_mut(LANES).enumerate() {
            let first = index * LANES;
            let places = rectified_row(Level::best(), cameras, [first, y]);
            let mut disparities = [f32::NAN; LANES];
            for ((claim, disparity), place) in out.iter_mut().zip(&mut disparities).zip(places) {
                let [u, v] = place.map(f64::round);
                let is_inside = (0.0..cols as f64).contains(&u) && (0.0..rows as f64).contains(&v);
                let index = if is_inside { v as usize * cols + u as usize } else { rows * cols };
                *disparity = disparity_map.as_slice().get(index).copied().unwrap_or(f32::NAN);
                claim.index = index as u64;
            }
            let claims = claims_of(Level::best(), &backward, [first, y], &places, &disparities);
            for (claim, [disparity, lower, scale]) in out.iter_mut().zip(claims) {
                *claim = Claim { index: claim.index, disparity, lower, scale };
            }
        }
    })
}

/// The rectified places of pixels of the raw left image, from a column and row on.
#[leveled]
fn rectified_row(level: Level, cameras: &Cameras, at: [usize; 2]) -> [Point; LANES] {
    cameras.rectified_row(at[0], at[1], 0)
}

/// The place of a raw left pixel's claim in the rectified left image.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RawPlace {
    /// The number of the pixel in reading order, or the number of pixels if it has no claim or lies beyond
    /// the image.
    pub index: u64,
    /// Raw columns per rectified column there.
    pub columns: f32,
}

/// The places of raw left pixels.
pub type RawPlaces = Plane<RawPlace>;

/// A map of the raw pair -> that of the pair rectified by these cameras; its left pixels are at `places`. A
/// rectified pixel takes the claim of a raw one that lies in it, else that of the raw pixel nearest to its
/// own place.
pub fn matched(
    map: &Plane<f32>,
    cameras: &Cameras,
    places: &Places,
    control: &Control,
) -> Result<(Plane<f32>, RawPlaces)> {
    let size @ (rows, cols) = map.size();
    let inside = |[u, v]: [f64; 2]| {
        let is_inside = (0.0..cols as f64).contains(&u) && (0.0..rows as f64).contains(&v);
        is_inside.then_some((v as usize, u as usize))
    };

    let nowhere = RawPlace { index: (rows * cols) as u64, columns: f32::NAN };
    let found: Plane<(f32, RawPlace)> = Plane::by_pixels(size, control, |y, x| {
        let place = [x as f64, y as f64];
        let pixel = inside(cameras.rectified(place, 0).map(f64::round));
        match pixel.zip(rectified_claim(cameras, place, map.row(y)[x])) {
            Some(((v, u), [claim, columns])) => (claim, RawPlace { index: (v * cols + u) as u64, columns }),
            None => (f32::NAN, nowhere),
        }
    })?;

    let mut matched = Plane::by_pixels(size, control, |y, x| {
        let pixel = inside(places.row(y)[x].map(|at| f64::from(at).round()));
        pixel.map_or(f32::NAN, |(v, u)| found.row(v)[u].0)
    })?;
    for (claim, place) in found.as_slice() {
        if let Some(out) = matched.as_mut_slice().get_mut(place.index as usize) {
            *out = *claim;
        }
    }

    Ok((matched, found.map(|(_, place)| *place)))
}

/// Newton's steps to a rectified disparity: the places of raw columns are nearly straight.
const NEWTON: usize = 6;

/// For a raw left pixel with a claim in raw columns: the rectified disparity, and the raw columns per
/// rectified column there.
fn rectified_claim(cameras: &Cameras, place: Point, claim: f32) -> Option<[f32; 2]> {
    let wanted = place[0] - f64::from(claim);
    if !wanted.is_finite() {
        return None;
    }

    let [x, y] = cameras.rectified(place, 0);
    let column = |disparity: f64| Some(cameras.raw([x - disparity, y], 1)?[0]);
    let (mut disparity, mut columns) = (f64::from(claim), 1.0);
    for _ in 0..NEWTON {
        columns = column(disparity - 0.5)? - column(disparity + 0.5)?;
        disparity += (column(disparity)? - wanted) / columns;
    }

    let is_found = (column(disparity)? - wanted).abs() < 0.01 && columns > 0.0;
    is_found.then_some([disparity as f32, columns as f32])
}

/// For raw left pixels from a column and row on: their rectified places and disparities, how many columns
/// farther left each is in the raw right image, how many rows lower, and the raw columns per rectified
/// column; NaN if one of them is unknown.
#[leveled]
fn claims_of(
    level: Level,
    backward: &Backward,
    at: [usize; 2],
    rectified: &[Point; LANES],
    disparities: &[f32; LANES],
) -> [[f32; 3]; LANES] {
    from_fn(|index| {
        let ([x, y], disparity) = (rectified[index], f64::from(disparities[index]));
        let place = |by: f64| backward.place([x - by, y]);
        let (found, before, after) = (place(disparity), place(disparity - 0.5), place(disparity + 0.5));

        let columns = (at[0] + index) as f64 - found[0];
        let claim = [columns, found[1] - at[1] as f64, (before[0] - after[0]).abs()];
        let is_known = claim[0].is_finite() & claim[1].is_finite() & claim[2].is_finite();
        claim.map(|value| if is_known { value as f32 } else { f32::NAN })
    })
}

fn sampled<T: Copy + Default + Send + Sync>(
    plane: &Plane<T>,
    claims: &Plane<Claim>,
    nowhere: T,
    control: &Control,
) -> Result<Plane<T>> {
    let sample = |claim: Claim| plane.as_slice().get(claim.index as usize).copied().unwrap_or(nowhere);
    Plane::by_pixels(plane.size(), control, |y, x| sample(claims.row(y)[x]))
}

#[cfg(test)]
mod tests {
    use super::super::cameras::{NUMBERS, USUAL};
    use super::*;
    use ndarray::Array3;
    use phasestereo_match::image::conversion::view_of_input;
    use phasestereo_match::image::pixels::Image;

    const SIZE: (usize, usize) = (60, 80);

    fn input() -> Input {
        let value = |(y, x, c)| ((31 * y + 17 * x + 5 * c) % 200) as u8;
        Input::from(Image::U8(Array3::from_shape_fn((SIZE.0, SIZE.1, 3), value)))
    }

    fn map() -> Disparity {
        Disparity {
            disparity: Plane::from_fn(SIZE.0, SIZE.1, |y, x| if x < 20 { f32::NAN } else { y as f32 / 8.0 }),
            flags: Plane::from_fn(SIZE.0, SIZE.1, |_, x| x as u16),
            confidence: Some(Plane::from_fn(SIZE.0, SIZE.1, |_, x| x as f32 / 100.0)),
            uncertainty: Some(Plane::from_fn(SIZE.0, SIZE.1, |_, _| 1.0)),
            wrong: None,
            detail: None,
            timings: phasestereo_match::matcher::Timings::default(),
        }
    }

    #[test]
    fn usual_cameras_change_nothing() {
        let cameras = Cameras::new([0.0; NUMBERS], USUAL, SIZE);
        let control = Control::default();
        let places = places(&cameras, 0, SIZE, &control).expect("memory");
        let of_input = rectified_input(&input(), &places, Interpolation::Lanczos, &control);
        assert_eq!(of_input.expect("memory").image, input().image);
        let view = view_of_input(input()).expect("memory");
        assert_eq!(rectified(&view, &places, &control).expect("memory"), view);

        let (raw, rows) = raw(&map(), &cameras, &control).expect("memory");
        assert_eq!((&raw.flags, &raw.confidence), (&map().flags, &map().confidence));
        for (found, known) in raw.disparity.as_slice().iter().zip(map().disparity.as_slice()) {
            assert!((found - known).abs() < 1e-4 || (found.is_nan() && known.is_nan()));
        }
        assert!(rows.as_slice().iter().all(|row| row.is_nan() || row.abs() < 1e-4));
    }

    #[test]
    fn a_map_is_taken_from_where_raw_pixels_are() {
        let mut numbers = [0.0; NUMBERS];
        (numbers[1], numbers[13]) = (1.0, 2.0);
        let shifts = [[0.0, 0.0], [-4.0, 1.0]];
        let mut cameras = Cameras::new(numbers, USUAL, SIZE);
        cameras.shifts = shifts;
        let (raw, rows) = raw(&map(), &cameras, &Control::default()).expect("memory");

        let mut seen = 0;
        for (y, x) in (0..SIZE.0).flat_map(|y| (0..SIZE.1).map(move |x| (y, x))) {
            let place = cameras.rectified([x as f64, y as f64], 0);
            let [u, v] = place.map(|at| at.round() as i64);
            if !(0..80).contains(&u) || !(0..60).contains(&v) {
                assert_eq!(
                    (raw.flags.row(y)[x], raw.disparity.row(y)[x].is_nan()),
                    (flag::NO_CANDIDATE, true)
                );
                continue;
            }

            let disparity = map().disparity.row(v as usize)[u as usize];
            let right = [place[0] - f64::from(disparity), place[1]];
            let right = cameras.raw(right, 1).filter(|_| disparity.is_finite());
            assert_eq!(right.is_none(), raw.disparity.row(y)[x].is_nan());
            if let Some(right) = right {
                assert!((x as f64 - right[0] - f64::from(raw.disparity.row(y)[x])).abs() < 1e-4);
                assert!((right[1] - y as f64 - f64::from(rows.row(y)[x])).abs() < 1e-4);
                seen += 1;
            }
        }
        assert!(seen > 2000, "{seen}");
    }

    #[test]
    fn a_map_of_raw_pixels_becomes_the_rectified_one_that_it_came_from() {
        let mut numbers = [0.0; NUMBERS];
        (numbers[1], numbers[13]) = (1.0, 2.0);
        let mut cameras = Cameras::new(numbers, USUAL, SIZE);
        cameras.shifts = [[0.0, 0.0], [-4.0, 1.0]];
        let control = Control::default();
        let (there, _) = raw(&map(), &cameras, &control).expect("memory");
        let places = places(&cameras, 0, SIZE, &control).expect("memory");
        let (back, of_raw) = matched(&there.disparity, &cameras, &places, &control).expect("memory");

        let mut seen = 0;
        for ((claim, place), y) in
            there.disparity.as_slice().iter().zip(of_raw.as_slice()).zip((0..).map(|i| i / SIZE.1))
        {
            assert_eq!(claim.is_nan(), place.columns.is_nan(), "{y}");
            let Some(found) = back.as_slice().get(place.index as usize) else { continue };
            // Several raw pixels may lie in one, for example from a row above or below.
            let known = map().disparity.as_slice()[place.index as usize];
            assert!((found - known).abs() < 0.13, "{found} {known}");
            seen += 1;
        }
        assert!(seen > 2000, "{seen}");
    }

    #[test]
    fn what_lies_outside_is_masked_and_masked_pixels_do_not_spread() {
        let mut numbers = [0.0; NUMBERS];
        numbers[10] = 3.0;
        let cameras = Cameras::new(numbers, USUAL, SIZE);
        let control = Control::default();
        let places = places(&cameras, 0, SIZE, &control).expect("memory");

        let mut pixels = Array3::from_elem((SIZE.0, SIZE.1, 1), 50.0f32);
        pixels[(30, 40, 0)] = f32::NAN;
        let mask = Plane::from_fn(SIZE.0, SIZE.1, |y, x| (y, x) != (30, 40));
        let input = Input { mask: Some(mask), ..Image::F32(pixels).into() };
        let found = rectified_input(&input, &places, Interpolation::Lanczos, &control);
        let Input { image: Image::F32(pixels), mask: Some(mask), .. } = found.expect("memory") else {
            unreachable!("as it was, and corners are outside")
        };
        assert!(pixels.iter().all(|value| (value - 50.0).abs() < 1e-3));

        let view = view_of_input(input).expect("memory");
        let found = rectified(&view, &places, &control).expect("memory");
        assert_eq!(found.mask(), Some(&mask));
        assert!(found.gray().as_slice().iter().all(|gray| *gray == 50 - 128));
        assert!(!mask.row(0)[0] && mask.row(20)[20]);
        let hidden = mask.as_slice().iter().filter(|valid| !**valid).count();
        assert!((100..2000).contains(&hidden), "{hidden}");
    }
}
