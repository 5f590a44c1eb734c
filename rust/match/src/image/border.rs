//! Black borders: pixels that a frame, a round lens or a rectification leaves around an image.
//!
//! From each of the four sides, a run of pixels reaches inward as long as all have exactly one value, the
//! least of the whole image; no lens and no sensor gives an area one exact value. The area of these runs is a
//! border if its outline is that of an image: except for a small share of the area, the run lengths along
//! each side form a convex function, as around anything convex (a frame, a circle, a rotated rectangle), or a
//! concave one (where a lens bends the edge inward). Objects before a black sky and dark parts of a scene
//! have neither.
//!
//! ```text
//! run(i)  = pixels of the value from place i of a side on; 0 where the whole row or column has it
//! off     = sum over i of min(run(i) - its convex hull from below, its concave hull from above - run(i))
//! border  = all runs, if off <= RAGGED_BORDER sum of run over all sides, and their share >= LEAST_BORDER
//! ```
//!
//! A lossy codec leaves waves beside the edge of a border, in whole blocks of pixels. If most runs of an
//! 8-bit image continue with pixels of nearly the value, all runs are extended, and the outline of the
//! extended runs counts.
//!
//! Areas of one value other than the least are left alone: a uniformly white sky or wall belongs to the
//! scene, and planes are drawn into it.

use std::cmp::Ordering;
use std::ops::Range;

use crate::base::error::Result;
use crate::base::plane::{Plane, around, reserve, zeroed};
use crate::choices::{LEAST_BORDER, LEAST_MASKED, RAGGED_BORDER, RIM, RIM_LEVELS, SHORTEST_BORDER};
use crate::image::masking::Mask;
use crate::image::pixels::{Image, Input};

/// A pixel: up to three channels.
type ExactPixel = [f64; 3];

/// The runs of one side: their lengths, and the value of each.
#[derive(Debug, Clone)]
struct BorderRuns {
    lengths: Vec<u32>,
    values: Vec<Option<ExactPixel>>,
}

/// Follows the runs of an image that arrives a few rows at a time.
#[derive(Debug, Clone)]
pub struct BorderScan {
    size: (usize, usize),
    /// From the top, the bottom, the left and the right.
    sides: [BorderRuns; 4],
    /// Rows so far.
    rows: usize,
}

/// A possible border, and how far each of its runs continues.
#[derive(Debug, Clone)]
pub struct Candidate {
    border: Border,
    more: [Vec<u32>; 4],
}

/// The border of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Border {
    size: (usize, usize),
    value: ExactPixel,
    /// Lengths of the runs from the top and the bottom, by column, and from the left and the right, by row.
    pub runs: [Vec<u32>; 4],
}

impl BorderRuns {
    fn new(count: usize) -> Result<Self> {
        let mut values = vec![];
        reserve(&mut values, count)?;
        values.resize(count, None);
        Ok(Self { lengths: zeroed(count)?, values })
    }

    /// Follows pixels (`None`: masked) as long as they continue the run at this place.
    fn follow(&mut self, at: usize, pixels: impl Iterator<Item = Option<ExactPixel>>) {
        for pixel in pixels {
            match (self.values[at], pixel) {
                (Some(own), Some(other)) if !is_same(own, other) => break,
                (None, Some(other)) => self.values[at] = Some(other),
                _ => {}
            }
            self.lengths[at] += 1;
        }
    }
}

impl BorderScan {
    /// The scan of an image of this size.
    pub fn new((rows, cols): (usize, usize)) -> Result<Self> {
        let sides =
            [BorderRuns::new(cols)?, BorderRuns::new(cols)?, BorderRuns::new(rows)?, BorderRuns::new(rows)?];
        Ok(Self { size: (rows, cols), sides, rows: 0 })
    }

    /// Adds the next rows.
    pub fn add(&mut self, input: &Input) {
        let (rows, cols) = input.size();
        let first = self.rows;
        let [top, bottom, left, right] = &mut self.sides;

        for x in 0..cols {
            if top.lengths[x] as usize == first {
                top.follow(x, (0..rows).map(|y| pixel(input, y, x)));
            }
            // Runs that reach the last of these rows may continue in the next ones.
            let mut here = BorderRuns { lengths: vec![0], values: vec![None] };
            here.follow(0, (0..rows).rev().map(|y| pixel(input, y, x)));
            let goes_on = here.lengths[0] as usize == rows
                && (bottom.values[x] == here.values[0]
                    || bottom.values[x].is_none()
                    || here.values[0].is_none());
            bottom.lengths[x] = here.lengths[0] + if goes_on { bottom.lengths[x] } else { 0 };
            bottom.values[x] = if goes_on { here.values[0].or(bottom.values[x]) } else { here.values[0] };
        }

        for y in 0..rows {
            left.follow(first + y, (0..cols).map(|x| pixel(input, y, x)));
            right.follow(first + y, (0..cols).rev().map(|x| pixel(input, y, x)));
        }
        self.rows += rows;
    }

    /// The possible border.
    pub fn candidate(self) -> Option<Candidate> {
        let Self { size: (rows, cols), sides, .. } = self;
        let values = sides.iter().flat_map(|side| side.values.iter().flatten());
        let value = values.copied().reduce(|a, b| [0, 1, 2].map(|c| f64::min(a[c], b[c])))?;

        let runs = sides.map(|side| -> Vec<u32> {
            let is_border = |own: &Option<ExactPixel>| own.is_none_or(|own| is_same(own, value));
            let runs = side.lengths.iter().zip(&side.values);
            runs.map(|(run, own)| if is_border(own) { *run } else { 0 }).collect()
        });

        // Most images have no border, and end here.
        if rows.min(cols) < LEAST_MASKED {
            return None;
        }
        let most: u64 = runs.iter().flatten().map(|run| u64::from(*run)).sum();
        if (most as f64) < LEAST_BORDER * (rows * cols) as f64 {
            return None;
        }

        let more = runs.clone().map(|runs| vec![0; runs.len()]);
        Some(Candidate { border: Border { size: (rows, cols), value, runs }, more })
    }
}

impl Candidate {
    /// Follows the rim in rows from `first` on, which arrive in order.
    pub fn add(&mut self, input: &Input, first: usize) {
        let Image::U8(_) = &input.image else { return };
        let Border { size, value, runs } = &self.border;
        let is_rim = |y: usize, x: usize| {
            let is_near = |own: ExactPixel| [0, 1, 2].iter().all(|c| own[*c] - value[*c] <= RIM_LEVELS);
            pixel(input, y, x).is_none_or(is_near)
        };

        let ((rows, cols), [top, bottom, left, right]) = (input.size(), &mut self.more);
        for x in 0..cols {
            let from = (runs[0][x] + top[x]) as usize;
            if from >= first {
                top[x] += (from - first..rows).take_while(|y| is_rim(*y, x)).count() as u32;
            }
            // The rim of the run from the bottom; a rim is at most RIM pixels wide.
            let end = size.0 - runs[1][x] as usize;
            for at in end.saturating_sub(RIM).max(first)..end.min(first + rows) {
                bottom[x] = if is_rim(at - first, x) { bottom[x] + 1 } else { 0 };
            }
        }
        for (y, at) in (first..first + rows).enumerate() {
            let along = |run: usize| (run..cols).take(RIM);
            let from_left = along(runs[2][at] as usize);
            left[at] = from_left.take_while(|x| is_rim(y, *x)).count() as u32;
            let from_right = along(runs[3][at] as usize);
            right[at] = from_right.take_while(|x| is_rim(y, cols - 1 - x)).count() as u32;
        }
    }

    /// The border, if no pixel of the image is darker.
    pub fn border(self) -> Option<Border> {
        let Self { border: Border { size, value, runs }, more } = self;
        let far = [size.0, size.0, size.1, size.1].map(|far| far as u32);

        let mut soft = [0, 0];
        for ((runs, more), far) in runs.iter().zip(&more).zip(far) {
            let inner = runs.iter().zip(more).filter(|(run, _)| (1..far).contains(*run));
            for (_, more) in inner {
                soft = [soft[0] + usize::from(*more > 0), soft[1] + 1];
            }
        }
        let runs = if 2 * soft[0] > soft[1] { with_rim(&runs, &more, far) } else { runs };

        let mut sums = [0.0; 2];
        for (runs, far) in runs.iter().zip(far) {
            let [off, area] = outline(runs, far);
            sums = [sums[0] + off, sums[1] + area];
        }
        let is_outline = sums[0] <= RAGGED_BORDER * sums[1];
        let border = Border { size, value, runs };
        let has_others = || (0..size.0).any(|y| border.row(y).any(|is_in| !is_in));
        (is_outline && has_others()).then_some(border)
    }
}

impl Border {
    /// Whether the pixels of a row of the image belong to it.
    pub fn row(&self, y: usize) -> impl Iterator<Item = bool> + '_ {
        let [top, bottom, left, right] = &self.runs;
        let (y, below) = (y as u32, (self.size.0 - y) as u32);
        let inside = left[y as usize]..(self.size.1 as u32).saturating_sub(right[y as usize]);
        (0..).zip(top.iter().zip(bottom)).map(move |(x, (top, bottom))| {
            (y < *top) | (below <= *bottom) | (x < inside.start) | (x >= inside.end)
        })
    }

    /// How many valid pixels of the rows from `first` on belong to it; `None`: some pixel is darker.
    fn count(&self, input: &Input, first: usize) -> Option<usize> {
        let (rows, cols) = input.size();
        // No integer is less than 0.
        let is_least = matches!(input.image, Image::U8(_) | Image::U16(_)) && is_same(self.value, [0.0; 3]);
        let is_darker = |y: usize, x: usize| {
            let found = pixel(input, y, x);
            found.is_some_and(|own| own.iter().zip(self.value).any(|(own, least)| *own < least))
        };
        let mut count = 0;
        for y in 0..rows {
            if !is_least && (0..cols).any(|x| is_darker(y, x)) {
                return None;
            }
            let places = self.row(first + y).enumerate();
            count += places.filter(|(x, is_in)| *is_in && input.is_valid(y, *x)).count();
        }
        Some(count)
    }

    /// Which pixels of these rows, from `first` on, are valid.
    pub fn mask(&self, input: &Input, first: usize) -> Result<Mask> {
        let (rows, cols) = input.size();
        let mut valid = Vec::with_capacity(rows * cols);
        for y in 0..rows {
            let places = self.row(first + y).enumerate();
            valid.extend(places.map(|(x, is_in)| !is_in && input.is_valid(y, x)));
        }
        Plane::from_vec(rows, cols, valid)
    }
}

/// The image without its border, and the border's share of it.
pub fn without_border(input: Input) -> Result<(Input, f64)> {
    let size = input.size();
    let mut scan = BorderScan::new(size)?;
    scan.add(&input);
    let found = scan.candidate().and_then(|mut candidate| {
        candidate.add(&input, 0);
        let border = candidate.border()?;
        let share = share_of(border.count(&input, 0)?, size)?;
        Some((border.mask(&input, 0), share))
    });
    Ok(match found {
        Some((mask, share)) => (Input { mask: Some(mask?), ..input }, share),
        None => (input, 0.0),
    })
}

/// The borders of the images of a pair that these rows are read from, and their shares.
pub fn of_rows(
    size: (usize, usize),
    bands: &[Range<usize>],
    read: impl Fn(Range<usize>) -> Result<[Input; 2]>,
) -> Result<[Option<(Border, f64)>; 2]> {
    let mut scans = [BorderScan::new(size)?, BorderScan::new(size)?];
    for rows in bands {
        for (scan, input) in scans.iter_mut().zip(&read(rows.clone())?) {
            scan.add(input);
        }
    }

    let mut candidates = scans.map(BorderScan::candidate);
    if candidates.iter().any(Option::is_some) {
        for rows in bands {
            for (candidate, input) in candidates.iter_mut().zip(&read(rows.clone())?) {
                if let Some(candidate) = candidate {
                    candidate.add(input, rows.start);
                }
            }
        }
    }

    let mut found = candidates.map(|candidate| candidate?.border().map(|border| (border, 0)));
    for rows in bands {
        if found.iter().all(Option::is_none) {
            break;
        }
        for (found, input) in found.iter_mut().zip(&read(rows.clone())?) {
            *found = found.take().and_then(|(border, count)| {
                let more = border.count(input, rows.start)?;
                Some((border, count + more))
            });
        }
    }
    Ok(found.map(|found| found.and_then(|(border, count)| Some((border, share_of(count, size)?)))))
}

/// The share of this many pixels, if it is large enough for a border.
fn share_of(count: usize, (rows, cols): (usize, usize)) -> Option<f64> {
    let share = count as f64 / (rows * cols) as f64;
    (share >= LEAST_BORDER).then_some(share)
}

/// The runs of the four sides with their rims, where there is a run nearby.
fn with_rim(runs: &[Vec<u32>; 4], more: &[Vec<u32>; 4], far: [u32; 4]) -> [Vec<u32>; 4] {
    [0, 1, 2, 3].map(|side| {
        let (runs, more) = (&runs[side], &more[side]);
        let near = |at: usize| &runs[around(at, RIM, runs.len())];
        let grown = |at: usize| {
            let is_border = near(at).iter().any(|run| *run > 0);
            let more = if is_border { more[at].min(RIM as u32) } else { 0 };
            (runs[at] + more).min(far[side])
        };
        (0..runs.len()).map(grown).collect()
    })
}

/// Whether two pixels are equal.
fn is_same(one: ExactPixel, other: ExactPixel) -> bool {
    one.partial_cmp(&other) == Some(Ordering::Equal)
}

/// A pixel as three numbers; `None`: it is masked.
fn pixel(input: &Input, y: usize, x: usize) -> Option<ExactPixel> {
    if !input.is_valid(y, x) {
        return None;
    }
    let last = input.image.shape().2 - 1;
    let at = |c: usize| (y, x, c.min(last));
    Some([0, 1, 2].map(|c| match &input.image {
        Image::U8(pixels) => pixels[at(c)].into(),
        Image::U16(pixels) => pixels[at(c)].into(),
        Image::F32(pixels) => pixels[at(c)].into(),
        Image::F64(pixels) => pixels[at(c)],
    }))
}

/// How far the runs of a side deviate from the outline of an image, and their sum. Runs that reach the other
/// side are left out: they belong to the two sides across.
fn outline(runs: &[u32], far: u32) -> [f64; 2] {
    let inner = runs.iter().filter(|run| **run < far).map(|run| f64::from(*run));
    let inner: Vec<f64> = inner.collect();
    let pieces = inner.split(|run| *run == 0.0).filter(|piece| !piece.is_empty());
    let off = pieces.map(|piece| {
        // A few adjacent dark pixels have no outline.
        if piece.len() < SHORTEST_BORDER {
            piece.iter().sum()
        } else {
            above_hull(piece, 1.0).min(above_hull(piece, -1.0))
        }
    });
    [off.sum::<f64>(), inner.iter().sum()]
}

/// The area between a line and its convex hull from below; with sign -1, its concave hull from above.
fn above_hull(line: &[f64], sign: f64) -> f64 {
    // Andrew's monotone chain.
    let mut hull: Vec<(f64, f64)> = vec![];
    for (x, y) in line.iter().enumerate() {
        let point = (x as f64, sign * y);
        while let [.., a, b] = hull[..] {
            let is_below = (b.0 - a.0) * (point.1 - a.1) > (b.1 - a.1) * (point.0 - a.0);
            if is_below {
                break;
            }
            hull.pop();
        }
        hull.push(point);
    }

    let below = |(a, b): ((f64, f64), (f64, f64))| {
        // The sum over whole places from a to b, without b.
        (b.0 - a.0) * a.1 + (b.1 - a.1) * (b.0 - a.0 - 1.0) / 2.0
    };
    let chords = hull.iter().copied().zip(hull.iter().copied().skip(1));
    let last = hull.last().map_or(0.0, |last| last.1);
    let hull: f64 = chords.map(below).sum::<f64>() + last;
    sign * line.iter().sum::<f64>() - hull
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array3, s};

    const SIZE: (usize, usize) = (90, 120);

    /// A textured image that is black outside an area.
    fn image(is_inside: impl Fn(f64, f64) -> bool) -> Input {
        let value = |y: usize, x: usize| (37 * y + 91 * x + y * x) as u8 % 200 + 1;
        let pixel = |(y, x, _)| if is_inside(y as f64, x as f64) { value(y, x) } else { 0 };
        Input::from(Image::U8(Array3::from_shape_fn((SIZE.0, SIZE.1, 3), pixel)))
    }

    fn found(view: &Input) -> (Input, f64) {
        without_border(view.clone()).expect("memory")
    }

    #[test]
    fn what_lies_around_an_image_is_masked() {
        let bent = |y: f64, x: f64| {
            let (v, u) = (y / 45.0 - 1.0, x / 60.0 - 1.0);
            u.abs() < 0.85 + 0.15 * v * v && v.abs() < 0.8 + 0.2 * u * u
        };
        let turned = |y: f64, x: f64| {
            let (v, u) = (y - 45.0, x - 60.0);
            (0.99 * u + 0.14 * v).abs() < 55.0 && (0.99 * v - 0.14 * u).abs() < 38.0
        };
        let shapes: [&dyn Fn(f64, f64) -> bool; 5] = [
            &|y, x| (8.0..80.0).contains(&y) && (10.0..110.0).contains(&x),
            &|_, x| x >= 20.0,
            &|y, x| (y - 45.0).powi(2) + (x - 60.0).powi(2) < 1600.0,
            &turned,
            &bent,
        ];
        for (at, is_inside) in shapes.iter().enumerate() {
            let view = image(is_inside);
            let (masked, share) = found(&view);
            let outside = |(y, x)| !is_inside(y as f64, x as f64);
            let places = (0..SIZE.0).flat_map(|y| (0..SIZE.1).map(move |x| (y, x)));
            let count = places.clone().filter(|place| outside(*place)).count();
            assert!((share - count as f64 / (SIZE.0 * SIZE.1) as f64).abs() < 1e-12, "{at}");
            for (y, x) in places {
                assert_eq!(masked.is_valid(y, x), is_inside(y as f64, x as f64), "{at}: {y} {x}");
            }

            // An image that arrives in parts has the same border.
            let bands: Vec<_> = (0..SIZE.0).step_by(7).map(|first| first..(first + 7).min(SIZE.0)).collect();
            let Image::U8(pixels) = &view.image else { unreachable!("bytes") };
            let part = |rows: Range<usize>| Input::from(Image::U8(pixels.slice(s![rows, .., ..]).to_owned()));
            let found = of_rows(SIZE, &bands, |rows| Ok([part(rows.clone()), part(rows)]));
            for (border, of_parts) in found.expect("memory").into_iter().flatten() {
                assert_eq!(Some(border.mask(&view, 0).expect("memory")), masked.mask, "{at}");
                assert_eq!(of_parts.to_bits(), share.to_bits());
            }
        }
    }

    #[test]
    fn what_a_codec_leaves_at_the_rim_is_masked() {
        let inside = |y: f64, x: f64| (y - 45.0).powi(2) + (x - 60.0).powi(2) < 1400.0;
        let rim = |y: f64, x: f64| (y - 45.0).powi(2) + (x - 60.0).powi(2) < 1900.0;
        let mut view = image(inside);
        let Image::U8(pixels) = &mut view.image else { unreachable!("bytes") };
        for ((y, x, c), value) in pixels.indexed_iter_mut() {
            // In blocks, as from a codec: rows and columns end the runs anywhere.
            let (row, col) = (y as f64, x as f64);
            if rim((y / 8 * 8) as f64, (x / 8 * 8) as f64) && rim(row, col) && !inside(row, col) {
                *value = ((5 * y + 3 * x + c) % 12 + 1) as u8;
            }
            *value = if inside(row, col) { (*value).max(40) } else { *value };
        }
        let (masked, share) = found(&view);
        assert!(share > 0.4);
        for (y, x) in (0..SIZE.0).flat_map(|y| (0..SIZE.1).map(move |x| (y, x))) {
            assert_eq!(masked.is_valid(y, x), inside(y as f64, x as f64), "{y} {x}");
        }
    }

    #[test]
    fn a_scene_is_not_a_border() {
        let houses = |y: f64, x: f64| y > 60.0 || (y > 20.0 && (x as usize / 17).is_multiple_of(2));
        let rough = |y: f64, x: f64| y > 20.0 + (x * 7.3) % 11.0 + (x * 1.7) % 13.0;
        let dark = |y: f64, x: f64| (37.0 * y + 91.0 * x + y * x) % 3.0 > 0.5;
        let shapes: [&dyn Fn(f64, f64) -> bool; 4] = [&houses, &rough, &dark, &|_, _| false];
        for is_inside in shapes {
            let view = image(is_inside);
            assert_eq!(found(&view), (view, 0.0));
        }

        // A white wall, and a black band with darker pixels elsewhere, belong to the scene.
        let mut view = image(|y, _| y > 30.0);
        if let Image::U8(pixels) = &mut view.image {
            pixels.iter_mut().for_each(|value| *value = if *value == 0 { 255 } else { *value });
        }
        assert!(found(&view).1 <= 0.0);
        if let Image::U8(pixels) = &mut view.image {
            pixels.iter_mut().for_each(|value| *value = if *value == 255 { 20 } else { *value });
        }
        assert!(found(&view).1 <= 0.0);
    }

    #[test]
    fn masks_and_borders_join() {
        let mut view = image(|_, x| x >= 30.0);
        view.mask = Some(Plane::from_fn(SIZE.0, SIZE.1, |y, x| x >= 12 && (y, x) != (50, 70)));
        let (masked, share) = found(&view);
        assert!((share - 18.0 / 120.0).abs() < 1e-12);
        assert!(!masked.is_valid(50, 70) && !masked.is_valid(0, 29) && masked.is_valid(0, 30));
    }
}
