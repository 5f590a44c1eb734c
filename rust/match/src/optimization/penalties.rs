//! Penalties for jumps of the disparity: P1 for a step by one, P2 for any other, and less of P2 where gray
//! values jump.
//!
//! | jump of the gray value, in thresholds | P2 |
//! |---|---|
//! | up to 1 | the whole |
//! | up to [`LARGE_JUMP`](crate::choices::LARGE_JUMP) | a half |
//! | more | a third |
//!
//! P2 is at least P1. With [`Precision::Byte`](crate::settings::Precision) P2 also decides how coarsely costs
//! are rounded: see [`Window::rounded_to_bytes`].

use crate::choices::P2_DIVISORS;
use crate::cost::aggregation::Window;
use crate::settings::Settings;

/// The largest penalty in steps of the aggregated costs: larger than any cost of a window, so even larger
/// ones change nothing.
pub const LARGEST_SUMMED_PENALTY: u64 = 1 << 28;

/// P1 and P2, in steps of the aggregated costs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Penalties {
    /// For a disparity that differs by one; under the ordering constraint for a rise by one.
    pub p1: u64,
    /// For any other change; under the ordering constraint for any smaller disparity.
    pub p2: u64,
}

impl Penalties {
    /// The penalties of checked settings for costs summed over a window; one unit of the cost is `steps`
    /// steps.
    pub fn new(settings: &Settings, window: Window, steps: u16) -> Self {
        let unit = window.unit(steps);
        let rounded = |value: f64| ((value * unit).round() as u64).min(LARGEST_SUMMED_PENALTY);

        Self { p1: rounded(settings.p1), p2: rounded(settings.p2) }
    }

    /// P2 after no jump of the gray value, after a small and after a large one.
    pub fn adaptive_p2(self) -> [u64; 3] {
        P2_DIVISORS.map(|divisor| (self.p2 / divisor).max(self.p1))
    }

    /// The largest total of a path, if no cost exceeds `largest_cost`.
    pub fn largest_total(self, largest_cost: u64) -> u64 {
        largest_cost.saturating_add(self.p1.max(self.p2))
    }
}
