//! Flat areas of which nothing is seen but the outline of what lies before them, such as skies.
//!
//! An outline is evidence only if it is the area's own. A table's is: beyond it lies something else. That of a
//! sky behind houses is the houses', and their surfaces go on outside. Then what the map has in the area is
//! theirs, too, be it matched, filled or drawn, unless the area itself shows something that is in the right
//! image where the map has it:
//!
//! ```text
//! outward    = the pixels OUTSIDE steps from an area, along rows and columns, as far as it does not begin again
//! goes on    = share of these that are sure (confidence > 1/2, neither inferred nor of a smaller copy)
//!              and whose disparity is within GOES_ON px of that of the pixel of the area from which they are counted
//! fine       = sum of rest over 3 x 3 pixels                                               (detail.rs)
//! seen       = mean of sign(fine[y, x]) sign(fine of right[y, x - d]), d the disparity, rounded,
//!              over the pixels of the area more than INSIDE from others, of the tiles up to NEARBY tiles away
//! confidence = at most UNSEEN in an area and MARGIN px around it, where goes on > OCCLUDER and seen <= SEEN
//! ```
//!
//! Tiles count from the corner of the area and its margin.

use rayon::prelude::*;

use crate::scales::choices::{GOES_ON, INSIDE, MARGIN, NEARBY, OCCLUDER, OUTSIDE, SEEN, TILE};
use crate::scales::detail::{BAND, rests};
use crate::scales::flat_areas::{FlatArea, shortened, shrunk};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::image::window_sums::{Beyond, Windows};
use phasestereo_match::matcher::Disparity;
use phasestereo_match::pair::Pair;
use phasestereo_match::refinement::flag;

/// The sum of the products of the signs of pixels in both images, and their number.
type Products = [i32; 2];

/// The pixels of areas of which nothing is seen but the outline of others; `None`: there are none.
pub fn unseen(
    map: &Disparity,
    pair: &Pair,
    (areas, rest): (&[FlatArea], &Plane<i32>),
    level: Level,
    control: &Control,
) -> Result<Option<Plane<bool>>> {
    let Some(confidence) = &map.confidence else { return Ok(None) };
    let behind: Result<Vec<bool>> =
        areas.par_iter().map(|area| lies_behind(area, map, confidence, level, control)).collect();
    let behind: Vec<&FlatArea> =
        areas.iter().zip(behind?).filter(|(_, behind)| *behind).map(|(area, _)| area).collect();
    if behind.is_empty() {
        return Ok(None);
    }

    let [_, right] = pair.views();
    let (gray, _) = shortened(right.gray(), right.scale().reach());
    let fine = [fine(rest, level)?, fine(&rests(&gray, level, control)?, level)?];
    let scene = Scene { disparity: &map.disparity, fine, level, control };
    let mut unseen = Plane::new(map.disparity.rows(), map.disparity.cols())?;
    for area in behind {
        scene.mark(area, &mut unseen)?;
    }
    Ok(Some(unseen))
}

/// Whether the surfaces of the outline of an area go on outside.
fn lies_behind(
    area: &FlatArea,
    map: &Disparity,
    confidence: &Plane<f32>,
    level: Level,
    control: &Control,
) -> Result<bool> {
    let (disparity, flags) = (&map.disparity, &map.flags);
    let (rows, cols) = (&area.rows, &area.cols);
    let inside = area.near((rows, cols), 0, level, control)?;
    let holds = |y: usize, x: usize| {
        rows.contains(&y) && cols.contains(&x) && inside.row(y - rows.start)[x - cols.start]
    };
    let is_sure = |y: usize, x: usize| {
        confidence.row(y)[x] > 0.5 && flags.row(y)[x] & (flag::INFERRED | flag::COARSE) == 0
    };

    let (mut going_on, mut all) = (0u64, 0u64);
    let mut look = |(y, x): (usize, usize), [down, right]: [isize; 2]| {
        let own = disparity.row(y)[x];
        for step in 1..=OUTSIDE[1] as isize {
            let place = (y.checked_add_signed(step * down), x.checked_add_signed(step * right));
            let (Some(y), Some(x)) = place else { break };
            if y >= disparity.rows() || x >= disparity.cols() || holds(y, x) {
                break;
            }
            if step > OUTSIDE[0] as isize {
                all += 1;
                let is_near = (disparity.row(y)[x] - own).abs() < GOES_ON;
                going_on += u64::from(is_near && is_sure(y, x));
            }
        }
    };
    for (y, run) in area.runs() {
        look((y, run.start), [0, -1]);
        look((y, run.end - 1), [0, 1]);
        for x in run.clone() {
            look((y, x), [-1, 0]);
            look((y, x), [1, 0]);
        }
    }
    Ok(going_on as f64 > OCCLUDER * all as f64)
}

/// The fine detail of an image by its rests.
fn fine(rest: &Plane<i32>, level: Level) -> Result<Plane<i32>> {
    let size = (rest.rows(), rest.cols());
    let windows = Windows { size, radius: 1, beyond: Beyond::Nothing };
    let values = |y: usize| rest.row(y).iter().map(|rest| [*rest]);
    Plane::by_bands(size, BAND, |first, band| {
        windows.write((first, band), values, |_, _, [sum]: [i32; 1]| sum, level)
    })
}

struct Scene<'a> {
    disparity: &'a Plane<f32>,
    /// Of the left and the right image.
    fine: [Plane<i32>; 2],
    level: Level,
    control: &'a Control,
}

impl Scene<'_> {
    /// Marks what is not seen of an area.
    fn mark(&self, area: &FlatArea, unseen: &mut Plane<bool>) -> Result<()> {
        let size = (unseen.rows(), unseen.cols());
        let [rows, cols] = area.wider(MARGIN.max(INSIDE), size);
        let near = |by: usize| area.near((&rows, &cols), by, self.level, self.control);
        let inner = shrunk(&near(0)?, INSIDE, self.level, self.control)?;

        let tiles = (rows.len().div_ceil(TILE), cols.len().div_ceil(TILE));
        let sums = Plane::by_rows(tiles, self.control, |tile, sums: &mut [Products]| {
            for row in tile * TILE..((tile + 1) * TILE).min(rows.len()) {
                self.add_products((rows.start + row, cols.start), inner.row(row), sums);
            }
        })?;
        let windows = Windows { size: tiles, radius: NEARBY, beyond: Beyond::Nothing };
        let values = |tile: usize| sums.row(tile).iter().copied();
        let seen = Plane::by_bands(tiles, BAND, |first, band| {
            let is_seen = |_, _, [sum, count]: Products| f64::from(sum) > SEEN * f64::from(count);
            windows.write((first, band), values, is_seen, self.level)
        })?;

        let marked = near(MARGIN)?;
        for (row, y) in rows.enumerate() {
            let places = unseen.row_mut(y)[cols.clone()].iter_mut().zip(marked.row(row));
            for (col, (unseen, is_marked)) in places.enumerate() {
                *unseen |= is_marked & !seen.row(row / TILE)[col / TILE];
            }
        }
        Ok(())
    }

    /// Adds the products of those pixels of a row that are inside to the sums of tiles. The row begins at a
    /// place.
    fn add_products(&self, (y, first): (usize, usize), inside: &[bool], sums: &mut [Products]) {
        let [left, right] = self.fine.each_ref().map(|fine| fine.row(y));
        let disparity = self.disparity.row(y);
        for (i, _) in inside.iter().enumerate().filter(|(_, inside)| **inside) {
            let x = first + i;
            // Of NaN it is that of the pixel beyond the image.
            let there = x as f32 - disparity[x].round();
            let Some(right) = right.get(there as usize).filter(|_| there >= 0.0) else { continue };
            let [sum, count] = &mut sums[i / TILE];
            *sum += left[x].signum() * right.signum();
            *count += 1;
        }
    }
}
