//! Scanlines: dynamic programming against the trial of every origin.

mod common;

use common::volumes;
use phasestereo::aggregation::Window;
use phasestereo::control::Control;
use phasestereo::plane::Plane;
use phasestereo::reference;
use phasestereo::scanline::{Scanline, Steps, optimize};
use phasestereo::settings::{Optimizer, Penalty};
use proptest::prelude::*;

/// Volumes of large costs, or of so small ones that ties abound.
fn problems() -> impl Strategy<Value = (Plane<u32>, usize)> {
    let largest = prop_oneof![Just(2u16), Just(u16::MAX)];
    (1usize..=3, 1usize..=12, 1usize..=9, largest).prop_flat_map(
        |(rows, cols, candidates, largest)| {
            let volume = volumes(rows, cols, candidates, largest);
            (volume.prop_map(|volume| volume.map(|&cost| u32::from(cost))), Just(candidates))
        },
    )
}

proptest! {
    #[test]
    fn dynamic_programming_finds_the_best_path(
        (volume, candidates) in problems(),
        rise in 0u64..5,
        drop in 0u64..5,
    ) {
        let steps = Steps { rise, drop };
        let optimizer = Optimizer::DynamicProgramming;
        let chosen = optimize(&volume, candidates, optimizer, steps, &Control::default()).expect("memory");
        for y in 0..volume.rows() {
            let expected = reference::dynamic_programming(volume.row(y), candidates, steps);
            prop_assert_eq!(chosen.row(y), &expected[..]);
        }
    }

    #[test]
    fn no_index_rises_by_more_than_one((volume, candidates) in problems()) {
        let steps = Steps { rise: 0, drop: 0 };
        let mut scanline =
            Scanline::new(volume.cols() / candidates, candidates, Optimizer::DynamicProgramming, steps)
                .expect("memory");
        let chosen = scanline.choose(volume.row(0)).to_vec();
        prop_assert!(chosen.windows(2).all(|pair| pair[1] <= pair[0] + 1), "{chosen:?}");
    }

    #[test]
    fn winner_takes_all_takes_the_first_least((volume, candidates) in problems()) {
        let steps = Steps { rise: 1, drop: 1 };
        let chosen = optimize(&volume, candidates, Optimizer::WinnerTakesAll, steps, &Control::default()).expect("memory");
        for y in 0..volume.rows() {
            let expected = reference::winner_takes_all(volume.row(y), candidates);
            prop_assert_eq!(chosen.row(y), &expected[..]);
        }
    }
}

#[test]
fn penalties_are_in_units_of_the_mean_cost() {
    let window = Window { rows: 1, cols: 1, candidates: 1, side: 9, shiftable: true, ceiling: 14 };
    let penalty = Penalty { rise: 0.5, drop: 2.0 };
    assert_eq!(Steps::new(penalty, window, 1), Steps { rise: 41, drop: 162 }, "40.5 is rounded up");
    assert_eq!(Steps::new(penalty, window, 16), Steps { rise: 648, drop: 2592 });
}

#[test]
fn totals_beyond_32_bits_do_not_overflow() {
    let volume =
        Plane::from_fn(1, 600, |_, place| if place % 2 == 0 { u32::MAX } else { u32::MAX - 1 });
    let steps = Steps { rise: 1 << 40, drop: 1 << 40 };
    let chosen = optimize(&volume, 2, Optimizer::DynamicProgramming, steps, &Control::default())
        .expect("memory");
    assert!(chosen.as_slice().iter().all(|&index| index == 1));
}
