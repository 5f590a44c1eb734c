//! Small regions, compared with a flood fill from every pixel.

use crate::common::maps::{FlaggedMap, maps};
use crate::common::{at_every_level, levels, random};
use crate::reference;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Error;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::matcher::on_threads;
use phasestereo_match::refinement::flag;
use phasestereo_match::refinement::speckles::flag_speckles;
use proptest::prelude::*;
use proptest::sample::select;

fn flagged(map: &FlaggedMap, execution: (usize, f32)) -> Plane<u16> {
    at_every_level(|level| {
        let mut flags = map.flags.clone();
        let control = Control::default();
        flag_speckles(&map.disparity, &mut flags, execution, level, &control).expect("memory");

        flags
    })
}

/// Whether each pixel is a speckle in a map without flags, written with a digit for each pixel.
fn speckles(drawn: &[&str], execution: (usize, f32)) -> Vec<String> {
    let digit = |y: usize, x: usize| f32::from(drawn[y].as_bytes()[x] - b'0');
    let disparity = Plane::from_fn(drawn.len(), drawn[0].len(), digit);

    let flags = disparity.map(|_| 0);
    let flags = flagged(&FlaggedMap { disparity, flags }, execution);

    let mark = |&flags: &u16| if flags == flag::SPECKLE { 'x' } else { '.' };
    (0..flags.rows()).map(|y| flags.row(y).iter().map(mark).collect()).collect()
}

proptest! {
    #![proptest_config(random(256))]

    #[test]
    fn speckles_are_those_of_the_reference(
        map in maps(),
        size in select(vec![0, 1, 2, 5, 20, 100]),
        range in select(vec![0.0, 0.25, 1.0, 2.0, f32::INFINITY]),
    ) {
        prop_assert_eq!(
            flagged(&map, (size, range)),
            reference::flag_speckles(&map.disparity, &map.flags, (size, range))
        );
    }
}

#[test]
fn small_regions_are_flagged_and_corners_do_not_connect() {
    let drawn = ["1111111", "1511551", "1151551", "1111111", "1121111"];

    let one = speckles(&drawn, (1, 0.0));
    assert_eq!(one, [".......", ".x.....", "..x....", ".......", "..x...."]);

    assert_eq!(speckles(&drawn, (4, 1.0)), [".......", ".x..xx.", "..x.xx.", ".......", "......."]);

    let all = speckles(&drawn, (100, 9.0));
    assert!(all.iter().all(|row| row == "xxxxxxx"));
}

/// One region that winds through all bands of rows, down and up again: it is large.
#[test]
fn a_serpent_through_all_bands_is_one_region() {
    let (rows, cols) = (131, 40);
    let is_body = |y: usize, x: usize| {
        let turn = if (x / 2).is_multiple_of(2) { rows - 1 } else { 0 };
        x.is_multiple_of(2) || y == turn
    };

    let disparity = Plane::from_fn(rows, cols, |y, x| if is_body(y, x) { 7.0 } else { f32::NAN });
    let body = disparity.as_slice().iter().filter(|value| !value.is_nan()).count();

    let map = FlaggedMap { flags: disparity.map(|_| 0), disparity };
    assert!(flagged(&map, (body - 1, 0.0)).as_slice().iter().all(|&flags| flags == 0));

    let flags = flagged(&map, (body, 0.0));
    assert_eq!(flags.as_slice().iter().filter(|&&flags| flags == flag::SPECKLE).count(), body);
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let map = FlaggedMap::random((200, 37), 20, 5);
    let [one, three] =
        [1, 3].map(|threads| on_threads(threads, || flagged(&map, (9, 1.0))).expect("threads"));

    assert_eq!(one, three);
}

#[test]
fn a_cancelled_search_stops() {
    let control = Control::default();
    control.cancel();

    let FlaggedMap { disparity, mut flags } = FlaggedMap::random((3, 3), 0, 1);
    let stopped = flag_speckles(&disparity, &mut flags, (1, 1.0), levels()[0], &control);
    assert_eq!(stopped, Err(Error::Cancelled));
}
