//! Costs around the chosen candidate -> sub-pixel offset.
//!
//! The offset depends on the shape of the costs around their minimum. Sums of Hamming distances are V-shaped,
//! like sums of absolute differences, so the offset is the tip of a V through three costs. A V attracts
//! disparities to whole pixels ("pixel locking"), which an interpolation function corrects (Haller and
//! Nedevschi: *Design of interpolation functions for subpixel-accuracy stereo-vision systems*, IEEE TIP 21,
//! 2012):
//!
//! ```text
//! tip    = (below - above) / (max(below, above) - own), clamped to -1 .. 1   # twice the tip of the V
//! offset = tip / 2 * (1 + SUBPIXEL_STEEPNESS * (1 - |tip|))
//! ```

use crate::choices::{SUBPIXEL_COST_WEIGHT, SUBPIXEL_STEEPNESS};

/// The cost of a candidate for [`offset`]: the mean of the path totals plus the weighted cost of the pixel's
/// own window, which each total already contains once; at most [`i32::MAX`].
#[inline(always)]
pub fn evidence(total: u32, cost: u32) -> u32 {
    total.saturating_add(cost.saturating_mul(SUBPIXEL_COST_WEIGHT)).min(i32::MAX as u32)
}

/// The offset of the match from the chosen candidate, -0.5 to 0.5 pixels, from the costs of the candidate
/// below, the chosen one and the one above, each at most [`i32::MAX`].
///
/// Only the ratio of the cost differences counts. Equal costs on both sides give 0. If one of them is below
/// the candidate's own, the match is halfway to it. At either end of the range the V is incomplete: use the
/// candidate itself.
#[inline(always)]
pub fn offset(below: u32, own: u32, above: u32) -> f32 {
    let lean = below as i32 - above as i32;
    let depth = (below.max(above) as i32 - own as i32).max(1);
    // Twice the offset of the tip of the V.
    let tip = (lean as f32 / depth as f32).clamp(-1.0, 1.0);

    0.5 * tip * (1.0 + SUBPIXEL_STEEPNESS * (1.0 - tip.abs()))
}
