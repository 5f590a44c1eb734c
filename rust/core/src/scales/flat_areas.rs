//! Flat areas of an image: connected pixels around which gray values vary less than the noise.
//!
//! ```text
//! noise = median of |4 g[y, x] - g[y - 1, x] - g[y + 1, x] - g[y, x - 1] - g[y, x + 1]|
//! flat  = deviation of g over 5 x 5 pixels <= noise, opened by 3 x 3
//! area  = 4-connected flat pixels, at least LEAST_SHARE of the image
//! ```
//!
//! Both sides are in gray levels of the same image, so its contrast and unit do not matter. In a finely
//! textured image the "noise" is texture, and areas with little of it are flat.

use std::ops::Range;

use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::{Plane, around};
use phasestereo_match::base::simd::{Level, leveled};
use phasestereo_match::base::statistics::median;
use phasestereo_match::image::regions::{Connectivity, Region, Regions, Run};
use phasestereo_match::image::window_sums::Windows;
use phasestereo_match::matcher::runtime::Runtime;

/// Least share of the image that an area covers.
const LEAST_SHARE: f64 = 0.01;
/// Reach of the window of the deviation.
const RADIUS: usize = 2;
/// Pixels of a row that are checked together.
const WHOLE: usize = 32;
/// Approximate number of pixels sampled for the noise.
const SAMPLES: usize = 1 << 15;

/// A connected flat area.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FlatArea {
    /// Rows that contain it.
    pub rows: Range<usize>,
    /// Columns that contain it.
    pub cols: Range<usize>,
    /// Its pixels: row and columns.
    runs: Vec<(usize, Range<usize>)>,
}

/// The large flat areas of an image of short gray values, from top to bottom.
pub fn flat_areas(gray: &Plane<i32>, runtime: Runtime) -> Result<Vec<FlatArea>> {
    let least = LEAST_SHARE * (gray.rows() * gray.cols()) as f64;
    let flat = flat(gray, runtime)?;
    let opened = grown(&shrunk(&flat, 1, runtime)?, 1, runtime)?;
    drop(flat);

    large(&opened, least, runtime.control)
}

impl FlatArea {
    /// Copies the marks of its pixels.
    pub fn copy(&self, from: &Plane<bool>, to: &mut Plane<bool>) {
        for (y, run) in &self.runs {
            to.row_mut(*y)[run.clone()].copy_from_slice(&from.row(*y)[run.clone()]);
        }
    }

    /// The pixels of these rows and columns that are at most `radius` rows and columns from the area.
    pub fn near(
        &self,
        (rows, cols): (&Range<usize>, &Range<usize>),
        radius: usize,
        runtime: Runtime,
    ) -> Result<Plane<bool>> {
        let mut marked = Plane::new(rows.len(), cols.len())?;
        for (y, run) in &self.runs {
            marked.row_mut(y - rows.start)[run.start - cols.start..run.end - cols.start].fill(true);
        }

        grown(&marked, radius, runtime)
    }
}

/// Which pixels are flat.
fn flat(gray: &Plane<i32>, runtime: Runtime) -> Result<Plane<bool>> {
    let noise = noise(gray);
    let windows = Windows::new(gray.size(), RADIUS);
    let moments = |y: usize| gray.row(y).iter().map(|gray| i64::from(*gray)).map(|g| [g, g * g]);

    let is_flat = move |y: usize, x: usize, [sum, squares]: [i64; 2]| {
        let count = i64::from(windows.pixels(y, x));
        count * squares - sum * sum <= count * count * noise * noise
    };
    windows.plane(moments, is_flat, runtime.level(), runtime.control)
}

/// The median magnitude of the Laplacian of an image.
fn noise(gray: &Plane<i32>) -> i64 {
    let (rows, cols) = gray.size();
    let step = (rows * cols / SAMPLES).max(1);

    let mut magnitudes: Vec<u32> = vec![];
    for y in (1..rows.saturating_sub(1)).step_by(step) {
        let [above, row, below] = [y - 1, y, y + 1].map(|y| gray.row(y));
        let across = row.windows(3).zip(above.iter().zip(below).skip(1));
        magnitudes.extend(across.map(|(beside, (above, below))| {
            (4 * beside[1] - above - below - beside[0] - beside[2]).unsigned_abs()
        }));
    }
    median(magnitudes).unwrap_or(0).into()
}

/// The pixels around which all others are marked, up to `radius` rows and columns away.
fn shrunk(marked: &Plane<bool>, radius: usize, runtime: Runtime) -> Result<Plane<bool>> {
    let lost = grown(&marked.map(|is_marked| !is_marked), radius, runtime)?;
    Ok(lost.map(|is_lost| !is_lost))
}

/// The pixels that are at most `radius` rows and columns from a marked one.
pub fn grown(marked: &Plane<bool>, radius: usize, runtime: Runtime) -> Result<Plane<bool>> {
    let size = marked.size();

    let along = Plane::by_rows(size, runtime.control, |y, near: &mut [bool]| {
        let marked = marked.row(y);
        for shift in 0..=radius.min(size.1) {
            mark_row(runtime.level(), &mut near[shift..], marked);
            mark_row(runtime.level(), &mut *near, &marked[shift..]);
        }
    })?;

    Plane::by_rows(size, runtime.control, |y, near: &mut [bool]| {
        for y in around(y, radius, size.0) {
            mark_row(runtime.level(), &mut *near, along.row(y));
        }
    })
}

/// Marks the pixels marked in another row, as far as both reach.
#[leveled]
fn mark_row(level: Level, near: &mut [bool], marked: &[bool]) {
    for (near, marked) in near.iter_mut().zip(marked) {
        *near |= marked;
    }
}

/// Marked pixels, connected with marked neighbors.
struct Marked<'a>(&'a Plane<bool>);

impl<'a> Connectivity for Marked<'a> {
    type Row = &'a [bool];

    fn size(&self) -> (usize, usize) {
        self.0.size()
    }

    fn row(&self, y: usize) -> &'a [bool] {
        self.0.row(y)
    }

    fn add_runs(row: &&[bool], runs: &mut Vec<Run>) {
        let mut start = 0;
        while start < row.len() {
            let is_marked = row[start];
            // Most runs are long.
            let alike = |part: &&[bool]| part.iter().fold(true, |all, one| all & (*one == is_marked));
            let whole = row[start..].chunks_exact(WHOLE).take_while(alike).count();
            let rest = start + whole * WHOLE;
            let end = row[rest..].iter().position(|one| *one != is_marked);
            let end = end.map_or(row.len(), |end| rest + end);

            if is_marked {
                runs.push(Run { start: start as u32, end: end as u32 });
            }
            start = end;
        }
    }

    fn is_connected(&self, _: &&[bool], _: &&[bool], _: Range<usize>) -> bool {
        true
    }
}

/// The areas of at least this many marked pixels, by their first pixels.
fn large(marked: &Plane<bool>, least: f64, control: &Control) -> Result<Vec<FlatArea>> {
    let regions = Regions::find(&Marked(marked), control)?;
    let mut areas: Vec<(Region, FlatArea)> = vec![];

    for y in 0..marked.rows() {
        for (run, region) in regions.row(y).filter(|(_, region)| region.pixels as f64 >= least) {
            // There are few areas.
            let known = areas.iter().position(|(one, _)| *one == region).unwrap_or(areas.len());
            if known == areas.len() {
                areas.push((region, FlatArea { rows: y..y, cols: run.clone(), runs: vec![] }));
            }

            let area = &mut areas[known].1;
            area.rows.end = y + 1;
            area.cols = area.cols.start.min(run.start)..area.cols.end.max(run.end);
            area.runs.push((y, run));
        }
    }

    Ok(areas.into_iter().map(|(_, area)| area).collect())
}
