//! How an image was read, if not all its pixels alike, and what a match does about it.
//!
//! ```text
//! fields:  odd rows were taken later      out(y)    = mean of the even rows at or beside y
//! mosaic:  neighbors have other colors    out(y, x) = sum over i, j of b(i) b(j) in(y + i, x + j),
//!                                         b = [1 2 1] / 4
//! ```
//!
//! The binomial filter removes what alternates from pixel to pixel, and is symmetric: phases stay as they
//! are, whichever colors a mosaic has.

use crate::estimation::means::means;
use crate::estimation::photometry::Photometry;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::reflect;
use phasestereo_match::image::conversion::view_of_input;
use phasestereo_match::image::pixels::Input;
use phasestereo_match::image::view::View;
use phasestereo_match::pair::Pair;

/// Weights along each axis of a pixel and its neighbors: the shortest symmetric ones that count even and odd
/// pixels alike, so that what alternates cancels.
const BINOMIAL: [i64; 3] = [1, 2, 1];
/// Those of the pixel alone.
const ALONE: [i64; 3] = [0, 1, 0];

/// How the pixels of an image were read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Raster {
    /// All at once, in gray or in color.
    Whole,
    /// Even rows at one time, odd ones at another.
    Fields,
    /// Neighbors show different things: the colors of a sensor's filters, or luma and chroma.
    Mosaic,
}

impl Raster {
    /// The rasters of both images, by the differences between their pixels.
    pub fn of(found: &Photometry) -> [Self; 2] {
        [0, 1].map(|side| match (found.mosaic[side], found.fields[side]) {
            (true, _) => Self::Mosaic,
            (false, 0) => Self::Whole,
            _ => Self::Fields,
        })
    }
}

/// The pair as if all pixels had been read alike.
pub fn resolved(pair: &Pair, rasters: [Raster; 2]) -> Result<Pair> {
    let views = pair.views();
    // Means have finer steps: then both images get them.
    let is_finer = rasters.contains(&Raster::Mosaic);
    let view = |side: usize| -> Result<View> {
        let view = match rasters[side] {
            Raster::Fields => views[side].of_even_rows(),
            _ => views[side].clone(),
        };
        let weights = if rasters[side] == Raster::Mosaic { BINOMIAL } else { ALONE };
        if is_finer { filtered(&view, weights) } else { Ok(view) }
    };
    Ok(pair.with_views([view(0)?, view(1)?]))
}

/// A view in finer steps, with these weights along each axis.
fn filtered(view: &View, weights: [i64; 3]) -> Result<View> {
    let (rows, cols) = view.size();
    let gray = |y: usize, x: usize| i64::from(view.gray().row(y)[x]);
    let near = |at: usize, length: usize| [-1, 0, 1].map(|by| reflect(at as isize + by, length));
    let sum = |y: usize, x: usize| -> i64 {
        let columns = near(x, cols);
        let along = |y: usize| -> i64 { columns.iter().zip(weights).map(|(x, by)| by * gray(y, *x)).sum() };
        near(y, rows).iter().zip(weights).map(|(y, by)| by * along(*y)).sum()
    };

    let count = weights.iter().sum::<i64>().pow(2);
    let (image, unit) = means(view, (rows, cols), count, sum);
    view_of_input(Input { image, mask: view.mask().cloned(), unit })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array3;
    use phasestereo_match::image::pixels::Image;

    fn view(pixel: impl Fn(usize, usize) -> u8) -> Result<View> {
        let pixels = Array3::from_shape_fn((20, 30, 1), |(y, x, _)| pixel(y, x));
        view_of_input(Image::U8(pixels).into())
    }

    #[test]
    fn what_alternates_is_removed_and_slopes_stay() -> Result<()> {
        let slope = |y: usize, x: usize| (50 + 3 * y + 2 * x) as u8;
        let mosaic = |y: usize, x: usize| slope(y, x) + [0, 32, 64, 0][2 * (y % 2) + x % 2];
        let pair = Pair::new(view(mosaic)?, view(slope)?, 0, 8)?;
        let found = resolved(&pair, [Raster::Mosaic, Raster::Whole])?;
        let [left, right] = found.views();
        let pixel = |view: &View, y: usize, x: usize| view.scale().pixel(view.gray().row(y)[x].into());
        for (y, x) in (1..19).flat_map(|y| (1..29).map(move |x| (y, x))) {
            let expected = f64::from(slope(y, x));
            assert!((pixel(left, y, x) - expected - 24.0).abs() < 0.01, "{y}, {x}");
            assert!((pixel(right, y, x) - expected).abs() < 0.01, "{y}, {x}");
        }
        Ok(())
    }
}
