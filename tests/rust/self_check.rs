//! Digests of matches are those of every platform at every level, for any threads; and the pairs show the
//! right things.

use crate::common::levels;
use phasestereo::internals::estimation::facts::Facts;
use phasestereo::internals::match_pair::match_pair;
use phasestereo::internals::self_check::scenes::{FAR, Fault, NEAR, pair};
use phasestereo::internals::self_check::{CASES, Case};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::Level;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::{Execution, Matcher};
use phasestereo_match::pair::Pair;
use phasestereo_match::settings::presets::Preset;

fn found(case: &Case, level: Level, threads: usize) -> u64 {
    let (matcher, control) = (Matcher::new(threads).expect("threads"), Control::default());
    let execution = Execution { threads, level };
    let runtime = Runtime { matcher: &matcher, execution, control: &control };
    case.found(runtime).unwrap_or_else(|error| panic!("{}: {error}", case.name()))
}

#[test]
fn digests_are_those_of_every_platform() {
    let (levels, mut changed) = (levels(), Vec::new());
    for (number, case) in CASES.iter().enumerate() {
        // Plain code takes several times as long, so the levels take turns.
        let other = levels[number % levels.len()];
        for (level, threads) in [(Level::best(), 2), (other, 3)] {
            let found = found(case, level, threads);
            if found != case.digest {
                changed.push(format!("{} at {}: {found:#018x}", case.name(), level.name()));
            }
        }
    }

    assert!(changed.is_empty(), "{}", changed.join("\n"));
}

#[test]
fn pairs_show_a_box_in_front_of_a_wall() {
    let size = (240, 320);
    for fault in [Fault::None, Fault::Defocus, Fault::Motion, Fault::Noise, Fault::Rows, Fault::Floats] {
        let [left, right] = pair(fault, size, 0);
        let pair = Pair::of_any([left, right], 0, 1).expect("a pair");
        let (matcher, control) = (Matcher::new(2).expect("threads"), Control::default());
        let execution = Execution { threads: 2, level: Level::best() };
        let runtime = Runtime { matcher: &matcher, execution, control: &control };
        let found = match_pair(pair, &Facts::default(), &Preset::Robust.settings(), runtime);

        let map = found.expect("a match").map.disparity;
        let medians = [median(&map, (110, 130), (150, 210)), median(&map, (20, 60), (40, 300))];
        let shown = [NEAR as f32, FAR as f32];
        let is_near = |(found, shown): (f32, f32)| (found - shown).abs() < 1.0;
        assert!(medians.into_iter().zip(shown).all(is_near), "{fault:?}: {medians:?}");
    }
}

/// The median disparity of some rows and columns.
fn median(map: &Plane<f32>, rows: (usize, usize), cols: (usize, usize)) -> f32 {
    let mut values: Vec<f32> = (rows.0..rows.1).flat_map(|y| map.row(y)[cols.0..cols.1].to_vec()).collect();
    values.sort_by(f32::total_cmp);
    values[values.len() / 2]
}
