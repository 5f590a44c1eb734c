//! Small regions that stand out from all around them are wrong, whatever they cost.
//!
//! Regions are sets of pixels that are united: along each row, then with the row above. Bands of rows are
//! worked out by themselves and then united with one another; sizes do not depend on the order.

use rayon::prelude::*;

use crate::control::Control;
use crate::error::{Error, Result};
use crate::filling::is_trusted;
use crate::plane::{Plane, zeroed};
use crate::refinement::flag;

/// Rows of a band: enough that uniting bands is little work, few enough that there are bands for all threads.
const BAND: usize = 32;

/// Flags the regions of up to `size` trusted pixels: those that hang together by steps, to the left, right, up
/// or down, between disparities that differ by `range` at most.
pub fn flag_speckles(
    disparity: &Plane<f32>,
    flags: &mut Plane<u16>,
    (size, range): (usize, f32),
    control: &Control,
) -> Result<()> {
    let cols = disparity.cols();
    let count = disparity.as_slice().len();
    if u32::try_from(count).is_err() {
        return Err(Error::value("left", format!("{count} pixels"), "fewer than 2^32 pixels"));
    }
    let (mut parents, mut sizes) = (zeroed(count)?, zeroed(count)?);
    let map = Map { disparity, flags, range };
    map.find(&mut parents, &mut sizes, control)?;
    let regions = Forest { parents: &mut parents, sizes: &mut sizes, first: 0 };
    let rows = flags.as_mut_slice().par_chunks_mut(cols).enumerate();
    rows.for_each(|(y, flags)| {
        let mut last = (u32::MAX, false);
        for (flags, &parent) in flags.iter_mut().zip(&regions.parents[y * cols..]) {
            if parent != last.0 {
                last = (parent, (1..=size).contains(&regions.size(parent)));
            }
            *flags |= if last.1 { flag::SPECKLE } else { 0 };
        }
    });
    Ok(())
}

/// What is searched for regions.
struct Map<'a> {
    disparity: &'a Plane<f32>,
    flags: &'a Plane<u16>,
    range: f32,
}

/// Sets of neighbouring pixels, as trees: of each pixel its parent, of a root itself; of each root, of how many.
struct Forest<'a> {
    parents: &'a mut [u32],
    sizes: &'a mut [u32],
    /// The first pixel that is in here.
    first: u32,
}

impl Map<'_> {
    /// Finds all regions; pixels that are not trusted belong to a region of none.
    fn find(&self, parents: &mut [u32], sizes: &mut [u32], control: &Control) -> Result<()> {
        let (rows, cols) = (self.disparity.rows(), self.disparity.cols());
        let bands = parents.par_chunks_mut(BAND * cols).zip(sizes.par_chunks_mut(BAND * cols));
        bands.enumerate().try_for_each(|(band, (parents, sizes))| {
            control.checkpoint()?;
            let (top, count) = (band * BAND, parents.len() / cols);
            let mut forest = Forest { parents, sizes, first: (top * cols) as u32 };
            let mut above = vec![f32::NAN; cols];
            for y in top..top + count {
                let here = self.row(y);
                self.begin(&here, y, &mut forest);
                self.unite([&above, &here], y, &mut forest);
                above = here;
            }
            Ok(())
        })?;
        let mut forest = Forest { parents, sizes, first: 0 };
        for y in (BAND..rows).step_by(BAND) {
            self.unite([&self.row(y - 1), &self.row(y)], y, &mut forest);
        }
        Ok(())
    }

    /// The trusted disparities of a row; NaN for others, which then hang together with nothing.
    fn row(&self, y: usize) -> Vec<f32> {
        let pixels = self.disparity.row(y).iter().zip(self.flags.row(y));
        pixels
            .map(|(&value, &flags)| if is_trusted(value, flags) { value } else { f32::NAN })
            .collect()
    }

    fn is_step(&self, from: f32, to: f32) -> bool {
        (from - to).abs() <= self.range
    }

    /// Puts each pixel of a row into the set of the pixel to its left, or into one of its own.
    fn begin(&self, row: &[f32], y: usize, forest: &mut Forest) {
        let places = y * row.len() - forest.first as usize..;
        let mut start = places.start;
        for ((x, &value), place) in row.iter().enumerate().zip(places) {
            if x == 0 || !self.is_step(row[x - 1], value) {
                start = place;
            }
            forest.parents[place] = forest.first + start as u32;
            forest.sizes[start] += u32::from(!value.is_nan());
        }
    }

    /// Unites the pixels of row `y` with those above; where the neighbours to the left have united all four,
    /// there is nothing to do.
    fn unite(&self, [above, here]: [&[f32]; 2], y: usize, forest: &mut Forest) {
        let cols = here.len();
        let mut is_united = false;
        for x in 0..cols {
            let is_step = self.is_step(above[x], here[x]);
            let is_same = is_united
                && self.is_step(above[x - 1], above[x])
                && self.is_step(here[x - 1], here[x]);
            if is_step && !is_same {
                forest.unite([(y - 1) * cols + x, y * cols + x].map(|pixel| pixel as u32));
            }
            is_united = is_step;
        }
    }
}

impl Forest<'_> {
    fn parent(&self, pixel: u32) -> u32 {
        self.parents[(pixel - self.first) as usize]
    }

    /// The root of a pixel's set; the way to it becomes half as long.
    fn root(&mut self, mut pixel: u32) -> u32 {
        while self.parent(pixel) != pixel {
            let grandparent = self.parent(self.parent(pixel));
            self.parents[(pixel - self.first) as usize] = grandparent;
            pixel = grandparent;
        }
        pixel
    }

    /// Makes one set of those of two pixels, the smaller one a branch of the larger.
    fn unite(&mut self, pixels: [u32; 2]) {
        let [a, b] = pixels.map(|pixel| self.root(pixel) - self.first);
        if a == b {
            return;
        }
        let (a, b) = (a as usize, b as usize);
        let (small, large) = if self.sizes[a] < self.sizes[b] { (a, b) } else { (b, a) };
        self.parents[small] = self.first + large as u32;
        self.sizes[large] += self.sizes[small];
    }

    /// Of how many pixels the set is that a pixel belongs to.
    fn size(&self, mut pixel: u32) -> usize {
        while self.parent(pixel) != pixel {
            pixel = self.parent(pixel);
        }
        self.sizes[(pixel - self.first) as usize] as usize
    }
}
