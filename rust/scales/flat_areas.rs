//! Flat areas of an image: connected pixels around which gray values vary less than its noise does.
//!
//! ```text
//! noise = median of |4 g[y, x] - g[y - 1, x] - g[y + 1, x] - g[y, x - 1] - g[y, x + 1]|
//! flat  = deviation of g over 5 x 5 pixels <= noise, opened by 3 x 3
//! area  = 4-connected flat pixels, at least LEAST_SHARE of the image
//! ```
//!
//! Both sides are in gray levels of the same image, so neither its contrast nor its unit matters. In a finely textured
//! image the "noise" is texture, and flat is what has little of it.

use std::ops::Range;

use crate::error::Result;
use crate::image::plane::Plane;
use crate::image::window_sums::{Beyond, Windows};
use crate::pipeline::control::Control;

/// Least share of the image of an area.
const LEAST_SHARE: f64 = 0.01;
/// How far the window of the deviation reaches.
const RADIUS: usize = 2;
/// Rows in which one task takes the deviations.
const BAND: usize = 32;
/// Most bits of the magnitude of a gray value.
const MOST_BITS: u32 = 15;
/// About so many pixels are looked at for the noise.
const SAMPLES: usize = 1 << 15;

/// A connected flat area.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FlatArea {
    /// Rows that hold it.
    pub rows: Range<usize>,
    /// Columns that hold it.
    pub cols: Range<usize>,
    /// Its pixels: a row, and columns.
    runs: Vec<(usize, Range<usize>)>,
}

/// The large flat areas of an image of this reach, from top to bottom.
pub fn flat_areas(mut gray: Plane<i32>, reach: u32, control: &Control) -> Result<Vec<FlatArea>> {
    // Sums of squares then fit.
    let surplus = (u32::BITS - reach.leading_zeros()).saturating_sub(MOST_BITS);
    gray.as_mut_slice().iter_mut().for_each(|gray| *gray >>= surplus);
    let least = LEAST_SHARE * (gray.rows() * gray.cols()) as f64;

    let flat = flat(&gray, control)?;
    drop(gray);
    let lost = grown(&flat.map(|is_flat| !is_flat), 1, control)?;
    let opened = grown(&lost.map(|is_lost| !is_lost), 1, control)?;

    let mut areas = connected(&opened);
    areas.retain(|area| area.pixels() as f64 >= least);
    Ok(areas)
}

impl FlatArea {
    /// The number of its pixels.
    pub fn pixels(&self) -> usize {
        self.runs.iter().map(|(_, run)| run.len()).sum()
    }

    /// The pixels of these rows and columns that are at most `radius` rows and columns from the area.
    pub fn near(
        &self,
        (rows, cols): (&Range<usize>, &Range<usize>),
        radius: usize,
        control: &Control,
    ) -> Result<Plane<bool>> {
        let mut marked = Plane::new(rows.len(), cols.len())?;
        for (y, run) in &self.runs {
            marked.row_mut(y - rows.start)[run.start - cols.start..run.end - cols.start].fill(true);
        }

        grown(&marked, radius, control)
    }
}

/// Which pixels are flat.
fn flat(gray: &Plane<i32>, control: &Control) -> Result<Plane<bool>> {
    let (rows, cols) = (gray.rows(), gray.cols());
    let noise = noise(gray);
    let windows = Windows { size: (rows, cols), radius: RADIUS, beyond: Beyond::Nothing };
    let moments = |y: usize| gray.row(y).iter().map(|gray| i64::from(*gray)).map(|g| [g, g * g]);

    Plane::by_bands((rows, cols), BAND, |first, band| {
        control.checkpoint()?;
        windows.write((first, band), moments, |y, x, [sum, squares]| {
            let count = windows.pixels(y, x) as i64;
            count * squares - sum * sum <= count * count * noise * noise
        })
    })
}

/// The median magnitude of the Laplacian of an image.
fn noise(gray: &Plane<i32>) -> i64 {
    let (rows, cols) = (gray.rows(), gray.cols());
    let step = (rows * cols / SAMPLES).max(1);

    let of_row = |y: usize| {
        let [above, row, below] = [y - 1, y, y + 1].map(|y| gray.row(y));
        (1..cols.saturating_sub(1)).map(move |x| {
            let around = above[x] + below[x] + row[x - 1] + row[x + 1];
            i64::from(4 * row[x] - around).abs()
        })
    };

    let mut magnitudes: Vec<i64> =
        (1..rows.saturating_sub(1)).step_by(step).flat_map(of_row).collect();
    if magnitudes.is_empty() {
        return 0;
    }
    let middle = magnitudes.len() / 2;
    *magnitudes.select_nth_unstable(middle).1
}

/// The pixels that are at most `radius` rows and columns from a marked one.
fn grown(marked: &Plane<bool>, radius: usize, control: &Control) -> Result<Plane<bool>> {
    let (rows, cols) = (marked.rows(), marked.cols());
    let window = |at: usize, count| at.saturating_sub(radius)..(at + radius + 1).min(count);

    let along = Plane::by_rows((rows, cols), control, |y, near: &mut [bool]| {
        let marked = marked.row(y);
        for shift in 0..=radius.min(cols) {
            for (near, marked) in near[shift..].iter_mut().zip(marked) {
                *near |= marked;
            }
            for (near, marked) in near.iter_mut().zip(&marked[shift..]) {
                *near |= marked;
            }
        }
    })?;

    Plane::by_rows((rows, cols), control, |y, near: &mut [bool]| {
        for y in window(y, rows) {
            for (near, marked) in near.iter_mut().zip(along.row(y)) {
                *near |= marked;
            }
        }
    })
}

/// The 4-connected areas of marked pixels: runs along rows, joined where they touch.
fn connected(marked: &Plane<bool>) -> Vec<FlatArea> {
    let mut runs: Vec<(usize, Range<usize>)> = vec![];
    // Each run leads to another one of its area, or to itself.
    let mut joined: Vec<usize> = vec![];
    let mut above = 0..0;

    for y in 0..marked.rows() {
        let first = runs.len();
        let mut start = 0;
        for part in marked.row(y).chunk_by(|a, b| a == b) {
            if part[0] {
                joined.push(runs.len());
                runs.push((y, start..start + part.len()));
            }
            start += part.len();
        }

        let mut next = above.start;
        for index in first..runs.len() {
            let run = runs[index].1.clone();
            while next < above.end && runs[next].1.end <= run.start {
                next += 1;
            }
            for other in (next..above.end).take_while(|other| runs[*other].1.start < run.end) {
                let [a, b] = [root(&joined, index), root(&joined, other)];
                joined[a.max(b)] = a.min(b);
            }
        }
        above = first..runs.len();
    }

    let mut areas: Vec<Option<FlatArea>> = vec![None; runs.len()];
    for (index, (y, run)) in runs.into_iter().enumerate() {
        let of_none = || FlatArea { rows: y..y + 1, cols: run.clone(), runs: vec![] };
        let area = areas[root(&joined, index)].get_or_insert_with(of_none);

        area.rows.end = y + 1;
        area.cols = area.cols.start.min(run.start)..area.cols.end.max(run.end);
        area.runs.push((y, run));
    }

    areas.into_iter().flatten().collect()
}

/// The first run of the area of a run.
fn root(joined: &[usize], mut index: usize) -> usize {
    while joined[index] != index {
        index = joined[index];
    }
    index
}
