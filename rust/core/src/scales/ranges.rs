//! The disparities to search in each panel, if a pair has many: those that a rough match at half the size
//! finds there and nearby.
//!
//! ```text
//! ranges(pair):
//!     if it has fewer than MANY disparities: all of them everywhere
//!     copy     = pair / 2
//!     rough    = match(copy, ranges(copy)), left-right check and speckles, nothing filled or smoothed
//!     searched = min .. max of 2 rough within REACH of the panel, and MARGIN more on either side,
//!                in whole runs, LEAST_RUNS at least;
//!                all, where a fifth of that or more is unknown
//! ```
//!
//! The copy is matched only along rows and with small windows, since paths along columns and large windows
//! lose thin upright objects. Rows beyond those on the paths of a panel count, too, since such an object is
//! rarely lost everywhere. Local mistakes of the match only widen the search, so noise costs time, not
//! quality. A confidence depends on how much cheaper a match is than all others: at least `LEAST_RUNS` are
//! searched, and all where the copy is in doubt.
//!
//! Objects that no pixel of the copy shows are lost: larger windows, more speckles and a smaller reach save
//! evaluations and lose thin objects. The rough match takes time, so few disparities gain little: pairs with
//! fewer than MANY are searched completely.

use std::ops::Range;

use crate::estimation::overview::CopySettings;
use crate::scales::reduction::halved;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::section::Section;
use phasestereo_match::optimization::panel_ranges::PanelRanges;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::{Candidates, Searched};
use phasestereo_match::settings::{Optimizer, Settings};

/// Fewest disparities of a pair to narrow.
const MANY: usize = 384;
/// Rows and columns around a panel in which the copy counts.
const REACH: [usize; 2] = [48, 16];
/// Disparities searched below the least and above the largest one of the copy.
const MARGIN: isize = 4;
/// Fewest runs of candidates. With only one, confidences become too high to ask a copy.
const LEAST_RUNS: usize = 2;

/// The disparities to search in each panel; `None`: all.
pub fn panel_ranges(pair: &Pair, optimizer: Optimizer, runtime: Runtime) -> Result<Option<PanelRanges>> {
    let follows_paths = matches!(optimizer, Optimizer::SemiGlobal | Optimizer::ScanlineOptimization);
    if !follows_paths || pair.candidates().count() < MANY {
        return Ok(None);
    }
    let Some(copy) = halved(pair) else { return Ok(None) };
    let rough = roughly_matched(&copy, runtime)?;

    let all = pair.candidates();
    let searched = |panel: [Range<usize>; 2]| searched(&rough, panel, all);
    Ok(Some(PanelRanges::new(pair.size(), searched)))
}

/// The disparities of a copy; NaN where the match is in doubt.
fn roughly_matched(copy: &Pair, runtime: Runtime) -> Result<Plane<f32>> {
    let detail = CopySettings { neighborhood: 5, window: 3, speckle: 6, subpixel: false };
    let settings = Settings { lr_check: Some(3), confidence: false, ..detail.settings() };

    let ranges = panel_ranges(copy, settings.optimizer, runtime)?;
    let section = Section { ranges, ..Section::whole(copy) };
    // Its rows are not rows of the result: its progress counts separately.
    let Runtime { matcher, execution, control } = runtime;
    let map = matcher.match_alone(copy, &section, &settings, execution, &control.aside())?;
    Ok(map.disparity)
}

/// The candidates to search in a panel, out of all.
fn searched(rough: &Plane<f32>, [rows, cols]: [Range<usize>; 2], all: Candidates) -> Searched {
    let near = |range: Range<usize>, reach: usize, count: usize| {
        range.start.saturating_sub(reach) / 2..((range.end + reach).div_ceil(2)).min(count)
    };
    let (rows, cols) = (near(rows, REACH[0], rough.rows()), near(cols, REACH[1], rough.cols()));
    let (mut lowest, mut highest, mut known) = (f32::INFINITY, f32::NEG_INFINITY, 0);

    for y in rows.clone() {
        for disparity in &rough.row(y)[cols.clone()] {
            // Unknown ones are ignored.
            (lowest, highest) = (lowest.min(*disparity), highest.max(*disparity));
            known += usize::from(!disparity.is_nan());
        }
    }
    if 5 * known <= 4 * rows.len() * cols.len() {
        return Searched::all(all.count());
    }

    // A disparity of the copy represents two.
    let index = |disparity: isize| all.index(disparity).min(all.count() - 1);
    let first = index(2 * lowest as isize - MARGIN);
    let last = index(2 * highest as isize + 1 + MARGIN);
    Searched::holding(first, last, LEAST_RUNS, all.count())
}
