//! The soft view of a band: the image it should show by each map, and how much the soft image differs from
//! that.

use std::mem::replace;
use std::ops::Range;

use super::{ClassGroup, REACH, RivalMaps, around};
use crate::base::error::Result;
use crate::base::plane::{Plane, parts, widened, zeroed};
use crate::base::simd::{Level, Loop, leveled};
use crate::choices::{BESIDE_GAP, SYNTHESIS_WINDOW};
use crate::descriptor::{Code, Codes, describe};
use crate::image::convolution::Kernel as Blur;
use crate::image::intensity::Gray;

/// The soft view of a band, for the classes of a group.
pub(super) struct SoftView<'a> {
    band: &'a RivalMaps<'a>,
    group: &'a ClassGroup<'a>,
    /// Columns of the view whose sums are needed.
    columns: Range<usize>,
    /// These columns and their halo.
    around: Range<usize>,
    /// Codes of the soft image there.
    soft: Codes,
    /// In the right view: the columns where each pixel of the band is looked up, by its smallest and largest
    /// disparity.
    places: Option<[Plane<u32>; 2]>,
}

impl<'a> SoftView<'a> {
    /// Finds the needed columns, and describes the soft image there.
    pub(super) fn new(band: &'a RivalMaps, group: &'a ClassGroup) -> Result<Self> {
        let pair = band.pair;
        let cols = band.maps[0].cols();
        let by = around(pair.settings, pair.compensation)[1];

        let places = (group.side == 1).then(|| band.places()).transpose()?;
        let columns = match &places {
            None => band.columns.clone(),
            Some(places) => {
                let all = || places.iter().flat_map(Plane::as_slice).map(|x| *x as usize);
                all().min().unwrap_or(0)..all().max().unwrap_or(0) + 1
            }
        };

        let around = widened(&columns, by, cols);
        let gray = pair.part(group.side, &band.seen, &around)?;
        let soft = band.codes(group.side, gray, None)?;

        Ok(Self { band, group, columns, around, soft, places })
    }

    /// The difference between the soft image and the synthetic one by a map: a sum for each pixel of the
    /// band.
    pub(super) fn unlike(&self, map: usize) -> Result<Plane<u16>> {
        let band = self.band;
        let distances = self.distances(self.shown(map)?)?;
        let mut sums = Plane::new(band.rows.len(), self.columns.len())?;
        let mut column_sums = zeroed(distances.cols())?;

        // The first window without its last row; each further row completes one window and opens the next.
        for y in 0..SYNTHESIS_WINDOW - 1 {
            slide_down(band.level, distances.row(y), None, &mut column_sums);
        }

        for y in 0..band.rows.len() {
            let leaves = y.checked_sub(1).map(|y| distances.row(y));
            let enters = distances.row(y + SYNTHESIS_WINDOW - 1);
            slide_down(band.level, enters, leaves, &mut column_sums);
            window_sums(band.level, &column_sums, sums.row_mut(y));
        }

        self.read(sums)
    }

    /// Sums in the view -> sums for the pixels of the band.
    fn read(&self, sums: Plane<u16>) -> Result<Plane<u16>> {
        let Some([near, far]) = &self.places else { return Ok(sums) };
        let mut read = Plane::new(near.rows(), near.cols())?;

        for y in 0..near.rows() {
            let sums = sums.row(y);
            let places = near.row(y).iter().zip(far.row(y));

            for (read, (near, far)) in read.row_mut(y).iter_mut().zip(places) {
                let [near, far] = [near, far].map(|x| sums[*x as usize - self.columns.start]);
                *read = near + far;
            }
        }

        Ok(read)
    }

    /// The part of the sharp image that the view shows, by a map.
    fn shown(&self, map: usize) -> Result<Plane<i32>> {
        let band = self.band;
        let side = self.group.side;
        let disparity = &band.maps[map];

        let [soft, sharp] = [side, 1 - side].map(|side| &band.pair.grays[side]);
        let scale = band.pair.scales[1 - side].steps_to(&band.pair.scales[side]);
        let reach: i64 = band.pair.scales[1 - side].reach().into();

        let mut whole = zeroed(disparity.cols())?;
        let mut seen = zeroed(disparity.cols())?;
        let mut shown = Plane::new(band.seen.len(), self.around.len())?;

        for (row, y) in band.seen.clone().enumerate() {
            round_row(band.level, disparity.row(row), &mut whole);

            let out = shown.row_mut(row);
            if side == 0 {
                warp_left(sharp.row(y), &whole, self.around.clone(), out);
            } else {
                warp_disparities(&whole, &mut seen);
                let (left, right, seen) = (sharp.row(y), soft.row(y), &seen[..]);
                RightView { left, right, scale, reach, seen }.write(self.around.clone(), out);
            }
        }

        Ok(shown)
    }

    /// Hamming distances of the codes of the synthetic and the soft image, for the needed columns and rows
    /// and their windows; 0 beside the image, where a pixel is masked, and where its class is not in the
    /// group.
    fn distances(&self, mut shown: Plane<i32>) -> Result<Plane<u8>> {
        let Self { band, group, .. } = self;
        let rows = band.within(REACH);
        let wide = self.columns.len() + 2 * REACH;
        let mut distances = Plane::new(band.rows.len() + 2 * REACH, wide)?;
        let columns = widened(&self.columns, REACH, self.around.end);
        let above = REACH - (band.rows.start - rows.start);
        let left = REACH - (self.columns.start - columns.start);

        // Several classes share only the left view; each synthesizes all of it and keeps its own pixels.
        let is_partial = group.side == 0 && band.pair.compensation.is_mixed();
        let mut labels = zeroed(columns.len())?;
        let mut bits = zeroed(columns.len())?;

        for (index, (class, blur)) in group.blurs.iter().enumerate() {
            let is_last = index + 1 == group.blurs.len();
            // The last class takes the plane itself, which saves a copy.
            let gray = if is_last { replace(&mut shown, Plane::new(0, 0)?) } else { shown.clone() };
            let codes = band.codes(1 - group.side, gray, Some(blur))?;

            for (row, y) in rows.clone().enumerate() {
                let place = (y - band.seen.start, columns.start - self.around.start);
                let out = &mut distances.row_mut(above + row)[left..][..columns.len()];
                write_distances([&self.soft, &codes], place, band.level, &mut bits);

                if is_partial {
                    band.labels(y, columns.clone(), &mut labels);
                    for ((out, bits), label) in out.iter_mut().zip(&bits).zip(&labels) {
                        *out = if usize::from(*label) == *class { *bits } else { *out };
                    }
                } else {
                    out.copy_from_slice(&bits);
                }

                if let Some(valid) = band.pair.valid(group.side, y) {
                    for (out, valid) in out.iter_mut().zip(&valid[columns.clone()]) {
                        *out = if *valid { *out } else { 0 };
                    }
                }
            }
        }

        Ok(distances)
    }
}

impl RivalMaps<'_> {
    /// The codes of gray values of one side, under a kernel if given.
    fn codes(&self, side: usize, gray: Plane<i32>, blur: Option<&Blur>) -> Result<Codes> {
        let Self { pair, level, control, .. } = *self;
        let noise = Some(pair.compensation.noise()[side]);
        let gray: Gray = pair.scales[side].like(gray);

        match blur {
            None => describe(&gray, pair.settings, noise, level, control),
            Some(blur) => {
                let gray = gray.convolved(blur, level, control)?;
                describe(&gray, pair.settings, noise, level, control)
            }
        }
    }

    /// The columns of the right view where the pixels of the band lie under their smallest and largest
    /// disparities, clamped into the image.
    fn places(&self) -> Result<[Plane<u32>; 2]> {
        let cols = self.maps[0].cols();
        let count = self.columns.len();
        let mut places = [Plane::new(self.rows.len(), count)?, Plane::new(self.rows.len(), count)?];
        let mut whole = [zeroed(count)?, zeroed(count)?, zeroed(count)?];

        for (row, y) in self.rows.clone().enumerate() {
            for (map, whole) in self.maps.iter().zip(&mut whole) {
                let disparity = &map.row(y - self.seen.start)[self.columns.clone()];
                round_row(self.level, disparity, whole);
            }

            for (index, x) in self.columns.clone().enumerate() {
                let [a, b, c] = [whole[0][index], whole[1][index], whole[2][index]];
                let extremes = [a.min(b).min(c), a.max(b).max(c)];
                for (place, disparity) in places.iter_mut().zip(extremes) {
                    place.row_mut(row)[index] = column(x, -disparity, cols) as u32;
                }
            }
        }

        Ok(places)
    }
}

/// The column `by` to the right, clamped into the image.
fn column(x: usize, by: i32, cols: usize) -> usize {
    (x as i32 + by).clamp(0, cols as i32 - 1) as usize
}

/// Writes a row of the right image as the left view shows it.
fn warp_left(right: &[i32], whole: &[i32], columns: Range<usize>, out: &mut [i32]) {
    for (out, x) in out.iter_mut().zip(columns) {
        *out = right[column(x, -whole[x], right.len())];
    }
}

/// No disparity: nothing of the left image is visible there.
const UNSEEN: i32 = i32::MIN;

/// Writes the disparity of each pixel of a row of the right view: the largest that leads to it. A pixel that
/// none leads to takes the larger one of its neighbors, if both have one: slanted surfaces leave such holes.
fn warp_disparities(whole: &[i32], seen: &mut [i32]) {
    seen.fill(UNSEEN);

    for (x, disparity) in whole.iter().enumerate() {
        // A negative column is beyond the row as an unsigned number.
        if let Some(seen) = seen.get_mut((x as isize - *disparity as isize) as usize) {
            *seen = (*seen).max(*disparity);
        }
    }

    let mut before = UNSEEN;
    for x in 0..seen.len().saturating_sub(1) {
        let (here, after) = (seen[x], seen[x + 1]);
        if here == UNSEEN && before != UNSEEN && after != UNSEEN {
            seen[x] = before.max(after);
        }
        before = here;
    }
}

/// A row of the left image, as the right view shows it.
struct RightView<'a> {
    left: &'a [i32],
    right: &'a [i32],
    /// Steps of the left image per step of the right one.
    scale: f64,
    /// Largest magnitude of gray values of the left image.
    reach: i64,
    /// The disparities in the right view.
    seen: &'a [i32],
}

impl RightView<'_> {
    /// Writes some columns. Where nothing of the left image is visible, they show the right image, made as
    /// bright as the left one beside it.
    fn write(&self, columns: Range<usize>, out: &mut [i32]) {
        let mut end = 0;
        let mut brighter = 0;

        for (out, x) in out.iter_mut().zip(columns) {
            if self.seen[x] == UNSEEN && x >= end {
                (end, brighter) = self.gap(x);
            }

            let own = || (self.own(x) + brighter).clamp(-self.reach, self.reach);
            *out = self.shown(x).unwrap_or_else(own) as i32;
        }
    }

    /// The visible part of the left image, if any.
    fn shown(&self, x: usize) -> Option<i64> {
        let disparity = self.seen[x];
        let from = || self.left[column(x, disparity, self.left.len())].into();
        (disparity != UNSEEN).then(from)
    }

    /// The right image, in steps of the left one.
    fn own(&self, x: usize) -> i64 {
        // The cast saturates. Values this large are meaningless, but their sums must not overflow.
        i64::from((f64::from(self.right[x]) * self.scale).round() as i32)
    }

    /// The end of the gap around a column, and how much brighter the left image beside it is than the right
    /// one.
    fn gap(&self, x: usize) -> (usize, i64) {
        let is_seen = |x: &usize| self.seen[*x] != UNSEEN;
        let start = (0..x).rev().find(is_seen).map_or(0, |x| x + 1);
        let end = (x..self.seen.len()).find(is_seen).unwrap_or(self.seen.len());

        let beside = start.saturating_sub(BESIDE_GAP)..start;
        let beside = beside.chain(end..(end + BESIDE_GAP).min(self.seen.len()));

        let differences = beside.filter_map(|x| Some(self.shown(x)? - self.own(x)));
        let (count, sum) = differences.fold((0, 0), |(count, sum), by| (count + 1, sum + by));

        (end, sum.div_euclid(count.max(1)))
    }
}

/// Rounds disparities to whole pixels (ties: even); a missing one becomes 0.
#[leveled]
fn round_row(level: Level, disparity: &[f32], whole: &mut [i32]) {
    // The sum with 1.5 * 2^23 has no fraction bits: it is rounded, and its low bits are the integer.
    let rounder = 1.5 * (1 << 23) as f32;

    for (whole, disparity) in whole.iter_mut().zip(disparity) {
        let bits = (disparity + rounder).to_bits().cast_signed() - rounder.to_bits().cast_signed();

        *whole = if disparity.is_nan() { 0 } else { bits };
    }
}

/// Writes the Hamming distances of the codes of two planes, of row `y` from column `x` on.
fn write_distances(codes: [&Codes; 2], place: (usize, usize), level: Level, bits: &mut [u8]) {
    match codes {
        [Codes::U16(a), Codes::U16(b)] => write_distances_of(a, b, place, level, bits),
        [Codes::U32(a), Codes::U32(b)] => write_distances_of(a, b, place, level, bits),
        [Codes::U64(a), Codes::U64(b)] => write_distances_of(a, b, place, level, bits),
        _ => unreachable!("codes of the same settings are equally wide"),
    }
}

/// [`write_distances`] for codes in words of one width.
fn write_distances_of<C: Code>(
    a: &Plane<C>,
    b: &Plane<C>,
    (y, x): (usize, usize),
    level: Level,
    bits: &mut [u8],
) {
    let codes = [a, b].map(|codes| &codes.row(y)[x..][..bits.len()]);
    level.run(Distances { codes, bits });
}

/// Hamming distances of two rows of codes.
struct Distances<'a, C> {
    codes: [&'a [C]; 2],
    bits: &'a mut [u8],
}

impl<C: Code> Loop for Distances<'_, C> {
    type Output = ();
    const COUNTS_BITS: bool = true;

    #[inline(always)]
    fn run(self) {
        let [a, b] = self.codes.map(|codes| &codes[..self.bits.len()]);
        for (x, bits) in self.bits.iter_mut().enumerate() {
            *bits = a[x].distance(b[x]) as u8;
        }
    }
}

/// Moves sums over the columns of a window down by a row.
#[leveled]
fn slide_down(level: Level, enters: &[u8], leaves: Option<&[u8]>, sums: &mut [u16]) {
    let n = sums.len();
    let enters = &enters[..n];

    if let Some(leaves) = leaves {
        let leaves = &leaves[..n];
        for x in 0..n {
            sums[x] = sums[x] + u16::from(enters[x]) - u16::from(leaves[x]);
        }
    } else {
        for x in 0..n {
            sums[x] += u16::from(enters[x]);
        }
    }
}

/// Sums over windows: each adds the [`SYNTHESIS_WINDOW`] column sums from its own on.
#[leveled]
fn window_sums(level: Level, columns: &[u16], sums: &mut [u16]) {
    let mut buffer = [[0; SPAN]];

    for (index, out) in sums.chunks_mut(LANES).enumerate() {
        let [columns] = parts([columns], (index * LANES) as isize, &mut buffer, |_, _| 0);
        let columns = &columns[..SPAN];

        let mut sums = [0; LANES];
        for away in 0..SYNTHESIS_WINDOW {
            let columns = &columns[away..][..LANES];
            for j in 0..LANES {
                sums[j] += columns[j];
            }
        }

        out.copy_from_slice(&sums[..out.len()]);
    }
}

/// Sums that are computed at a time.
const LANES: usize = 64;
/// Columns that their windows reach.
const SPAN: usize = LANES + SYNTHESIS_WINDOW - 1;
