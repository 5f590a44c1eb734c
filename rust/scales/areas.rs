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

use rayon::prelude::*;

use crate::error::Result;
use crate::image::plane::Plane;
use crate::pipeline::control::Control;

/// Least share of the image of an area.
const LEAST_SHARE: f64 = 0.01;
/// How far the window of the deviation reaches.
const RADIUS: usize = 2;
/// About so many pixels are looked at for the noise.
const SAMPLES: usize = 1 << 18;

/// A connected flat area.
#[derive(Debug)]
pub struct Area {
    /// Rows that hold it.
    pub rows: Range<usize>,
    /// Columns that hold it.
    pub cols: Range<usize>,
    /// Its label in [`Areas::labels`].
    pub label: u32,
}

/// All flat areas of an image.
#[derive(Debug)]
pub struct Areas {
    /// The area that each pixel belongs to; 0: none.
    pub labels: Plane<u32>,
    /// The large ones.
    pub large: Vec<Area>,
}

impl Areas {
    /// The flat areas of an image.
    pub fn new(gray: &Plane<i32>, control: &Control) -> Result<Self> {
        let flat = flat(gray, control)?;
        control.checkpoint()?;
        Ok(Self::of_flat(&opened(&flat, control)?))
    }

    /// The connected areas of marked pixels.
    fn of_flat(flat: &Plane<bool>) -> Self {
        let (rows, cols) = (flat.rows(), flat.cols());
        let least = (LEAST_SHARE * (rows * cols) as f64) as usize;
        let mut labels = flat.map(|_| 0);
        let (mut large, mut label, mut open) = (vec![], 0, vec![]);

        for (y, x) in (0..rows).flat_map(|y| (0..cols).map(move |x| (y, x))) {
            if !flat.row(y)[x] || labels.row(y)[x] != 0 {
                continue;
            }

            label += 1;
            let mut area = Area { rows: y..y + 1, cols: x..x + 1, label };
            let mut count = 0;
            labels.row_mut(y)[x] = label;
            open.push((y, x));

            while let Some((y, x)) = open.pop() {
                count += 1;
                area.rows = area.rows.start.min(y)..area.rows.end.max(y + 1);
                area.cols = area.cols.start.min(x)..area.cols.end.max(x + 1);

                let [above, before] = [y, x].map(|at| at.wrapping_sub(1));
                for (y, x) in [(above, x), (y + 1, x), (y, before), (y, x + 1)] {
                    let is_inside = y < rows && x < cols;
                    if is_inside && flat.row(y)[x] && labels.row(y)[x] == 0 {
                        labels.row_mut(y)[x] = label;
                        open.push((y, x));
                    }
                }
            }

            if count >= least.max(1) {
                large.push(area);
            }
        }

        Self { labels, large }
    }

    /// The pixels of these rows and columns that are at most `radius` rows and columns from an area.
    pub fn near(
        &self,
        area: &Area,
        (rows, cols): (Range<usize>, Range<usize>),
        radius: usize,
        control: &Control,
    ) -> Result<Plane<bool>> {
        let is_area = |y, x| self.labels.row(rows.start + y)[cols.start + x] == area.label;
        grown(&Plane::from_fn(rows.len(), cols.len(), is_area), radius, control)
    }
}

/// Which pixels are flat.
fn flat(gray: &Plane<i32>, control: &Control) -> Result<Plane<bool>> {
    let (rows, cols) = (gray.rows(), gray.cols());
    let noise = i128::from(noise(gray));

    Plane::by_rows((rows, cols), control, |y, flat: &mut [bool]| {
        let window = y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(rows);
        let height = window.len() as i64;

        // Sums, and sums of squares, of the columns of the window.
        let mut columns = vec![[0_i64; 2]; cols];
        for y in window {
            for ([sum, squares], gray) in columns.iter_mut().zip(gray.row(y)) {
                let gray = i64::from(*gray);
                *sum += gray;
                *squares += gray * gray;
            }
        }

        for (x, flat) in flat.iter_mut().enumerate() {
            let window = &columns[x.saturating_sub(RADIUS)..(x + RADIUS + 1).min(cols)];
            let count = i128::from(height * window.len() as i64);
            let [sum, squares] = [0, 1].map(|i| window.iter().map(|c| i128::from(c[i])).sum::<i128>());

            *flat = count * squares - sum * sum <= count * count * noise * noise;
        }
    })
}

/// The median magnitude of the Laplacian of an image.
fn noise(gray: &Plane<i32>) -> i64 {
    let (rows, cols) = (gray.rows(), gray.cols());
    let step = (rows * cols / SAMPLES).max(1);

    let inner: Vec<usize> = (1..rows.saturating_sub(1)).step_by(step).collect();
    let of_row = |y: usize| {
        let [above, row, below] = [y - 1, y, y + 1].map(|y| gray.row(y));
        (1..cols.saturating_sub(1)).map(move |x| {
            let around = [above[x], below[x], row[x - 1], row[x + 1]].map(i64::from);
            (4 * i64::from(row[x]) - around.iter().sum::<i64>()).abs()
        })
    };

    let mut magnitudes: Vec<i64> = inner.into_par_iter().flat_map_iter(of_row).collect();
    if magnitudes.is_empty() {
        return 0;
    }
    let middle = magnitudes.len() / 2;
    *magnitudes.select_nth_unstable(middle).1
}

/// The marked pixels whose neighbors are all marked, and these neighbors.
fn opened(marked: &Plane<bool>, control: &Control) -> Result<Plane<bool>> {
    let lost = grown(&marked.map(|is_marked| !is_marked), 1, control)?;
    grown(&lost.map(|is_lost| !is_lost), 1, control)
}

/// The pixels that are at most `radius` rows and columns from a marked one.
fn grown(marked: &Plane<bool>, radius: usize, control: &Control) -> Result<Plane<bool>> {
    let (rows, cols) = (marked.rows(), marked.cols());
    let window = |at: usize, count| at.saturating_sub(radius)..(at + radius + 1).min(count);

    let along = Plane::by_rows((rows, cols), control, |y, row: &mut [bool]| {
        for (x, is_near) in row.iter_mut().enumerate() {
            *is_near = marked.row(y)[window(x, cols)].contains(&true);
        }
    })?;

    Plane::by_rows((rows, cols), control, |y, row: &mut [bool]| {
        for y in window(y, rows) {
            for (is_near, is_marked) in row.iter_mut().zip(along.row(y)) {
                *is_near |= is_marked;
            }
        }
    })
}
