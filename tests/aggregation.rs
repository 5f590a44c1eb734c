//! Windows: the ring of sliding sums against each window summed by itself.

mod common;

use common::volumes;
use phasestereo::aggregation::{Aggregator, Source, Window, aggregate};
use phasestereo::control::Control;
use phasestereo::plane::Plane;
use phasestereo::reference;
use proptest::prelude::*;

/// Costs in which not everybody votes.
#[derive(Debug)]
struct Ballot {
    costs: Plane<u16>,
    votes: Plane<u16>,
}

impl Source for Ballot {
    fn write_costs(&self, y: usize, costs: &mut [u16]) {
        costs.copy_from_slice(self.costs.row(y));
    }

    fn write_votes(&self, y: usize, votes: &mut [u16]) {
        votes.copy_from_slice(self.votes.row(y));
    }

    fn all_vote(&self) -> bool {
        false
    }
}

/// A window, its costs, and votes for about four of five of them.
fn elections() -> impl Strategy<Value = (Window, Ballot)> {
    let window = (1usize..=9, 1usize..=9, 1usize..=4, 0usize..=6, any::<bool>());
    window.prop_flat_map(|(rows, cols, candidates, radius, shiftable)| {
        let side = 2 * radius + 1;
        let window = Window { rows, cols, candidates, side, shiftable, ceiling: 64 };
        let lots = volumes(rows, cols, candidates, 4);
        (Just(window), volumes(rows, cols, candidates, 64), lots).prop_map(
            |(window, mut costs, lots)| {
                let votes = lots.map(|&lot| u16::from(lot > 0));
                for (cost, vote) in costs.as_mut_slice().iter_mut().zip(votes.as_slice()) {
                    *cost *= vote;
                }
                (window, Ballot { costs, votes })
            },
        )
    })
}

proptest! {
    #[test]
    fn sliding_sums_equal_single_windows((window, Ballot { costs, .. }) in elections()) {
        let everybody = costs.map(|_| 1);
        let expected = reference::aggregate(&costs, &everybody, window);
        prop_assert_eq!(aggregate(&costs, window, &Control::default()).expect("memory"), expected);
    }

    #[test]
    fn any_first_row_and_any_votes((window, ballot) in elections(), first in 0usize..9) {
        let first = first % window.rows;
        let expected = reference::aggregate(&ballot.costs, &ballot.votes, window);
        let control = Control::default();
        let mut aggregator = Aggregator::new(window, first, &ballot, &control).expect("memory");
        let mut row = window.row().expect("memory");
        for y in first..window.rows {
            aggregator.write_row(y, &mut row).expect("not cancelled");
            prop_assert_eq!(&row[..], expected.row(y), "row {} from {}", y, first);
        }
    }
}

#[test]
fn the_mean_of_the_votes_counts() {
    let window = Window { rows: 1, cols: 1, candidates: 1, side: 3, shiftable: false, ceiling: 14 };
    assert_eq!(window.share(30, 9), 30, "everybody voted");
    assert_eq!(window.share(10, 3), 30, "a third voted");
    assert_eq!(window.share(1, 2), 5, "4.5 is rounded up");
    assert_eq!(window.share(0, 0), 9 * 14, "nobody voted");
}
