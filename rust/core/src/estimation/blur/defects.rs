//! Defects of images besides blur and noise, detected once for a whole pair: impulses
//! ([`phasestereo_match::image::impulses`]), and blocks left by compression
//! ([`phasestereo_match::image::blocking`]).

use std::ops::Range;

use rayon::prelude::*;

use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::{Plane, widened};
use phasestereo_match::base::platform::both;
use phasestereo_match::image::blocking::{self, Extra};
use phasestereo_match::image::impulses::{self, HEIGHT, count_doubtless, has_impulses};
use phasestereo_match::image::masking;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::source::{Source, bands, has_empty_row};

/// The noise, in gray levels, that does the same harm as the loss from compression if blocks stand out by one
/// level. More helps a little if both images are compressed, and harms if one is.
const HARM: f64 = 6.0;
/// Rows of one task.
const ROWS: usize = 64;
/// Rows above and below one that its defects depend on.
const REACH: usize = if impulses::REACH > blocking::REACH { impulses::REACH } else { blocking::REACH };

/// The defects of the left and the right image, in units of their pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Defects {
    /// The least height of their impulses; 0: there are none.
    pub impulses: [f64; 2],
    /// Standard deviations of a noise that would do the same harm as the loss from compression.
    pub coding: [f64; 2],
}

/// Counts from an image.
#[derive(Debug, Clone, Copy, Default)]
struct DefectCounts {
    /// Pixels that are impulses without doubt.
    doubtless: u64,
    /// Differences at the borders of coding blocks beyond those elsewhere.
    extra: Extra,
    /// Steps of gray values per unit of the pixels.
    steps: f64,
}

impl Defects {
    /// The defects of a pair with given gray levels.
    pub fn new(source: &dyn Source, levels: [f64; 2], runtime: Runtime) -> Result<Self> {
        let (height, cols) = source.size();
        let mut found = [DefectCounts::default(); 2];
        for rows in bands(source) {
            let mut read = widened(&rows, REACH, height);
            let mut pair = source.rows(read.clone())?;

            if pair.views().iter().any(|view| view.mask().is_some_and(has_empty_row)) {
                // Rows without a valid pixel copy the nearest ones that have some, which may not have been
                // read.
                read = widened(&read, masking::REACH, height);
                pair = source.rows(read.clone())?;
            }

            let here = rows.start - read.start..rows.end - read.start;
            let place = (read.start, height);
            let counted = both(|side| counts(&pair, side, here.clone(), place, levels[side], runtime))?;
            found = [0, 1].map(|side| found[side].and(counted[side]));
        }

        Ok(Self::from_counts(&found, levels, (height, cols)))
    }

    fn from_counts(found: &[DefectCounts; 2], levels: [f64; 2], (rows, cols): (usize, usize)) -> Self {
        let mut defects = Self { impulses: [0.0; 2], coding: [0.0; 2] };

        for (side, DefectCounts { doubtless, extra, steps }) in found.iter().enumerate() {
            if has_impulses(*doubtless, rows * cols) {
                defects.impulses[side] = HEIGHT * levels[side];
            }
            defects.coding[side] = HARM * extra.jump() / steps;
        }

        defects
    }
}

impl DefectCounts {
    fn and(self, other: Self) -> Self {
        Self {
            doubtless: self.doubtless + other.doubtless,
            extra: self.extra.and(other.extra),
            steps: other.steps,
        }
    }
}

/// Counts in some rows of an image, in a pair that begins at row `first` of `height` rows.
fn counts(
    pair: &Pair,
    side: usize,
    rows: Range<usize>,
    (first, height): (usize, usize),
    gray_level: f64,
    Runtime { execution, control, .. }: Runtime,
) -> Result<DefectCounts> {
    let view = pair.views()[side];
    let (own_height, cols) = view.size();
    let level = view.scale().steps(gray_level);

    let of_rows = |start: usize| -> Result<DefectCounts> {
        control.checkpoint()?;

        // Gray values of few rows at a time stay in the cache.
        let rows = start..(start + ROWS).min(rows.end);
        let read = widened(&rows, REACH, own_height);
        let mut plane = Plane::new(read.len(), cols)?;
        for (row, y) in read.clone().enumerate() {
            plane.row_mut(row).copy_from_slice(view.gray().row(y));
        }

        let origin = (first + read.start, height);
        let rows = rows.start - read.start..rows.end - read.start;
        Ok(DefectCounts {
            doubtless: count_doubtless(&plane, rows.clone(), level, execution.level)?,
            extra: Extra::of_rows(&plane, rows, origin, level, execution.level)?,
            steps: view.scale().steps(1.0),
        })
    };

    // Counts are integers and sums of integers, so the order of the tasks does not matter.
    let starts: Vec<usize> = rows.clone().step_by(ROWS).collect();
    let found = starts.into_par_iter().map(of_rows);
    found.try_reduce(DefectCounts::default, |a, b| Ok(a.and(b)))
}

/// The gray levels of both images, in units of their pixels: one of 256 steps from black to white.
pub fn gray_levels(source: &dyn Source) -> Result<[f64; 2]> {
    let sample = source.rows(0..1)?;
    Ok(sample.views().map(|view| view.scale().level()))
}
