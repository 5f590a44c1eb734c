//! Helpers for the inline tests of several modules.

use phasestereo_match::base::control::Control;
use phasestereo_match::base::simd::Level;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::{Execution, Matcher};

/// Works with a matcher of one thread.
pub fn on_a_thread<T>(level: Level, work: impl FnOnce(Runtime) -> T) -> T {
    let matcher = Matcher::new(1).expect("a thread");
    work(Runtime {
        matcher: &matcher,
        execution: Execution { threads: 1, level },
        control: &Control::default(),
    })
}

/// Every level that this machine has.
pub fn levels() -> impl Iterator<Item = Level> {
    Level::all().filter_map(|(_, level)| level)
}

/// Pseudorandom numbers below 2^24, always the same.
pub fn random(seed: u32) -> impl FnMut() -> u32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 8
    }
}

/// A pseudorandom byte by place.
pub fn texture(y: usize, x: usize, salt: u64) -> u8 {
    let mut bits = (y as u64) << 32 | x as u64 | salt << 60;
    for factor in [0xbf58_476d_1ce4_e5b9, 0x94d0_49bb_1331_11eb] {
        bits = (bits ^ bits >> 29).wrapping_add(0x9e37_79b9).wrapping_mul(factor);
    }
    (bits >> 56) as u8
}
