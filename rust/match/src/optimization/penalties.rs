//! What jumps of the disparity cost.

use crate::cost::aggregation::Window;
use crate::settings::Settings;

/// The largest penalty in steps of the aggregated costs: more than any cost of a window, so larger ones change nothing.
pub const LARGEST_SUMMED_PENALTY: u64 = 1 << 28;

/// P1 and P2, in steps of the aggregated costs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Penalties {
    /// For a disparity that differs by one; under the ordering constraint for a disparity that is larger by one.
    pub p1: u64,
    /// For any other change; under the ordering constraint for any smaller disparity.
    pub p2: u64,
}

impl Penalties {
    /// The penalties of checked settings for costs summed over a window, where one unit of the cost is `steps` steps.
    pub fn new(settings: &Settings, window: Window, steps: u16) -> Self {
        let unit = window.unit(steps);
        let rounded = |value: f64| ((value * unit).round() as u64).min(LARGEST_SUMMED_PENALTY);

        Self { p1: rounded(settings.p1), p2: rounded(settings.p2) }
    }

    /// The largest total of a path, where no cost is larger than `largest_cost`.
    pub fn largest_total(self, largest_cost: u64) -> u64 {
        largest_cost.saturating_add(self.p1.max(self.p2))
    }
}
