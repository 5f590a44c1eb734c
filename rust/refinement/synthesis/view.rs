//! The soft view of a band: what it should show by each of the maps, and how unlike the soft image that is.

use std::mem::replace;
use std::ops::Range;

use super::{BESIDE, ClassGroup, REACH, RivalMaps, WINDOW, around};
use crate::descriptor::{Code, Codes, describe};
use crate::error::Result;
use crate::image::convolution::Kernel as Blur;
use crate::image::intensity::Gray;
use crate::image::plane::{Plane, parts, zeroed};
use crate::simd::{Level, Loop};

/// The soft view of a band, for the classes of a pass.
pub(super) struct SoftView<'a> {
    band: &'a RivalMaps<'a>,
    pass: &'a ClassGroup<'a>,
    /// Columns of the view that are looked at.
    columns: Range<usize>,
    /// Those, and all that they depend on.
    around: Range<usize>,
    /// Codes of the soft image there.
    soft: Codes,
    /// For each column of the band and row: the columns of the view where it is looked for, if that is the right one.
    places: Option<[Plane<u32>; 2]>,
}

impl<'a> SoftView<'a> {
    /// Looks where to look.
    pub(super) fn new(band: &'a RivalMaps, pass: &'a ClassGroup) -> Result<Self> {
        let scene = band.scene;
        let (cols, by) = (band.maps[0].cols(), around(scene.settings, scene.compensation)[1]);
        let places = (pass.side == 1).then(|| band.places()).transpose()?;
        let columns = match &places {
            None => band.columns.clone(),
            Some(places) => {
                let all = || places.iter().flat_map(Plane::as_slice).map(|x| *x as usize);
                all().min().unwrap_or(0)..all().max().unwrap_or(0) + 1
            }
        };
        let around = columns.start.saturating_sub(by)..(columns.end + by).min(cols);
        let gray = scene.part(pass.side, &band.seen, &around)?;
        let soft = band.codes(pass.side, gray, None)?;
        Ok(Self { band, pass, columns, around, soft, places })
    }

    /// How unlike the soft image the synthetic one is by a map, of the pixels of the band.
    pub(super) fn unlike(&self, map: usize) -> Result<Plane<u16>> {
        let band = self.band;
        let distances = self.distances(self.shown(map)?)?;
        let mut sums = Plane::new(band.rows.len(), self.columns.len())?;
        let mut column_sums = zeroed(distances.cols())?;
        for y in 0..WINDOW - 1 {
            band.level.run(Move { enters: distances.row(y), leaves: None, sums: &mut column_sums });
        }
        for y in 0..band.rows.len() {
            let leaves = y.checked_sub(1).map(|y| distances.row(y));
            let enters = distances.row(y + WINDOW - 1);
            band.level.run(Move { enters, leaves, sums: &mut column_sums });
            band.level.run(WindowSums { columns: &column_sums, sums: sums.row_mut(y) });
        }
        self.read(sums)
    }

    /// What is to be read of sums in the view for the pixels of the band.
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

    /// What the view shows of the sharp image by a map.
    fn shown(&self, map: usize) -> Result<Plane<i32>> {
        let (band, side) = (self.band, self.pass.side);
        let disparity = &band.maps[map];
        let [soft, sharp] = [side, 1 - side].map(|side| &band.scene.grays[side]);
        let scale = band.scene.scales[1 - side].steps_to(&band.scene.scales[side]);
        let reach: i64 = band.scene.scales[1 - side].reach().into();
        let (mut whole, mut seen) = (zeroed(disparity.cols())?, zeroed(disparity.cols())?);
        let mut shown = Plane::new(band.seen.len(), self.around.len())?;
        for (row, y) in band.seen.clone().enumerate() {
            band.level.run(Whole { disparity: disparity.row(row), whole: &mut whole });
            let out = shown.row_mut(row);
            if side == 0 {
                show(sharp.row(y), &whole, self.around.clone(), out);
            } else {
                look_from_right(&whole, &mut seen);
                let (left, right, seen) = (sharp.row(y), soft.row(y), &seen[..]);
                FromRight { left, right, scale, reach, seen }.write(self.around.clone(), out);
            }
        }
        Ok(shown)
    }

    /// Hamming distances of the codes of what is shown and of the soft image, about the columns and rows that are looked
    /// at; 0 beside the image, and where a pixel has none of the classes or is masked.
    fn distances(&self, mut shown: Plane<i32>) -> Result<Plane<u8>> {
        let Self { band, pass, .. } = self;
        let (rows, wide) = (band.within(REACH), self.columns.len() + 2 * REACH);
        let mut distances = Plane::new(band.rows.len() + 2 * REACH, wide)?;
        let columns = self.columns.start.saturating_sub(REACH)
            ..(self.columns.end + REACH).min(self.around.end);
        let (above, left) =
            (REACH - (band.rows.start - rows.start), REACH - (self.columns.start - columns.start));
        let is_partial = pass.side == 0 && band.scene.compensation.is_mixed();
        let (mut labels, mut bits) = (zeroed(columns.len())?, zeroed(columns.len())?);
        for (index, (class, blur)) in pass.blurs.iter().enumerate() {
            let is_last = index + 1 == pass.blurs.len();
            let gray = if is_last { replace(&mut shown, Plane::new(0, 0)?) } else { shown.clone() };
            let codes = band.codes(1 - pass.side, gray, Some(blur))?;
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
                if let Some(valid) = band.scene.valid(pass.side, y) {
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
    /// The codes of gray values of one side, perhaps under a kernel.
    fn codes(&self, side: usize, gray: Plane<i32>, blur: Option<&Blur>) -> Result<Codes> {
        let Self { scene, level, control, .. } = *self;
        let noise = Some(scene.compensation.noise()[side]);
        let gray: Gray = scene.scales[side].like(gray);
        match blur {
            None => describe(&gray, scene.settings, noise, level, control),
            Some(blur) => {
                let gray = gray.convolved(blur, level, control)?;
                describe(&gray, scene.settings, noise, level, control)
            }
        }
    }

    /// The columns of the right view where the pixels of the band lie by their smallest and by their largest disparity,
    /// or those next to them within the image.
    fn places(&self) -> Result<[Plane<u32>; 2]> {
        let (cols, count) = (self.maps[0].cols(), self.columns.len());
        let mut places = [Plane::new(self.rows.len(), count)?, Plane::new(self.rows.len(), count)?];
        let mut whole = [zeroed(count)?, zeroed(count)?, zeroed(count)?];
        for (row, y) in self.rows.clone().enumerate() {
            for (map, whole) in self.maps.iter().zip(&mut whole) {
                let disparity = &map.row(y - self.seen.start)[self.columns.clone()];
                self.level.run(Whole { disparity, whole });
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

/// The column so many to the right, or the nearest one within the image.
fn column(x: usize, by: i32, cols: usize) -> usize {
    (x as i32 + by).clamp(0, cols as i32 - 1) as usize
}

/// Writes what the left view shows of a row of the right image.
fn show(right: &[i32], whole: &[i32], columns: Range<usize>, out: &mut [i32]) {
    for (out, x) in out.iter_mut().zip(columns) {
        *out = right[column(x, -whole[x], right.len())];
    }
}

/// No disparity.
const UNSEEN: i32 = i32::MIN;

/// Writes the disparity of each pixel of a row of the right view: the largest of those that lead to it. One that none
/// leads to has the larger one of the pixels beside it, if both have any.
fn look_from_right(whole: &[i32], seen: &mut [i32]) {
    seen.fill(UNSEEN);
    for (x, disparity) in whole.iter().enumerate() {
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

/// A row of the left image as the right view shows it.
struct FromRight<'a> {
    left: &'a [i32],
    right: &'a [i32],
    /// Steps of the left image to one of the right one.
    scale: f64,
    /// Largest magnitude of gray values of the left image.
    reach: i64,
    /// The disparities that are seen.
    seen: &'a [i32],
}

impl FromRight<'_> {
    /// Writes some columns. Where no pixel of the left image is seen there is that of the right one, as bright as what
    /// is shown beside it.
    fn write(&self, columns: Range<usize>, out: &mut [i32]) {
        let (mut end, mut brighter) = (0, 0);
        for (out, x) in out.iter_mut().zip(columns) {
            if self.seen[x] == UNSEEN && x >= end {
                (end, brighter) = self.gap(x);
            }
            let own = || (self.own(x) + brighter).clamp(-self.reach, self.reach);
            *out = self.shown(x).unwrap_or_else(own) as i32;
        }
    }

    fn shown(&self, x: usize) -> Option<i64> {
        let disparity = self.seen[x];
        let from = || self.left[column(x, disparity, self.left.len())].into();
        (disparity != UNSEEN).then(from)
    }

    /// What the right image has, in steps of the left one.
    fn own(&self, x: usize) -> i64 {
        // So large a value has no meaning: it only must not overflow sums.
        i64::from((f64::from(self.right[x]) * self.scale).round() as i32)
    }

    /// Where the gap about a column ends, and by how much what is shown beside it is brighter than what the right image
    /// has there.
    fn gap(&self, x: usize) -> (usize, i64) {
        let is_seen = |x: &usize| self.seen[*x] != UNSEEN;
        let start = (0..x).rev().find(is_seen).map_or(0, |x| x + 1);
        let end = (x..self.seen.len()).find(is_seen).unwrap_or(self.seen.len());
        let beside = start.saturating_sub(BESIDE)..start;
        let beside = beside.chain(end..(end + BESIDE).min(self.seen.len()));
        let differences = beside.filter_map(|x| Some(self.shown(x)? - self.own(x)));
        let (count, sum) = differences.fold((0, 0), |(count, sum), by| (count + 1, sum + by));
        (end, sum.div_euclid(count.max(1)))
    }
}

/// Disparities in whole pixels, the nearest (ties: even); 0 where there is none.
struct Whole<'a> {
    disparity: &'a [f32],
    whole: &'a mut [i32],
}

impl Loop for Whole<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        // Beside it there is no room for fractions: the sum is rounded, and its low bits are the integer.
        let rounder = 1.5 * (1 << 23) as f32;
        for (whole, disparity) in self.whole.iter_mut().zip(self.disparity) {
            let bits =
                (disparity + rounder).to_bits().cast_signed() - rounder.to_bits().cast_signed();
            *whole = if disparity.is_nan() { 0 } else { bits };
        }
    }
}

/// Hamming distances of codes of two planes, in a row from a place on.
fn write_distances(codes: [&Codes; 2], place: (usize, usize), level: Level, bits: &mut [u8]) {
    match codes {
        [Codes::U16(a), Codes::U16(b)] => write_distances_of(a, b, place, level, bits),
        [Codes::U32(a), Codes::U32(b)] => write_distances_of(a, b, place, level, bits),
        [Codes::U64(a), Codes::U64(b)] => write_distances_of(a, b, place, level, bits),
        _ => unreachable!("codes of the same settings are equally wide"),
    }
}

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

struct Distances<'a, C> {
    codes: [&'a [C]; 2],
    bits: &'a mut [u8],
}

impl<C: Code> Loop for Distances<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let [a, b] = self.codes.map(|codes| &codes[..self.bits.len()]);
        for (x, bits) in self.bits.iter_mut().enumerate() {
            *bits = a[x].distance(b[x]) as u8;
        }
    }
}

/// Sums of columns, of which the window is moved by a row.
struct Move<'a> {
    enters: &'a [u8],
    leaves: Option<&'a [u8]>,
    sums: &'a mut [u16],
}

impl Loop for Move<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let n = self.sums.len();
        let (sums, enters) = (&mut *self.sums, &self.enters[..n]);
        if let Some(leaves) = self.leaves {
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
}

/// Sums of windows: each of [`WINDOW`] sums of columns from its own on.
struct WindowSums<'a> {
    columns: &'a [u16],
    sums: &'a mut [u16],
}

/// Sums that are worked out at a time.
const LANES: usize = 64;
/// Columns that they are of.
const SPAN: usize = LANES + WINDOW - 1;

impl Loop for WindowSums<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut room = [[0; SPAN]];
        for (index, out) in self.sums.chunks_mut(LANES).enumerate() {
            let [columns] = parts([self.columns], (index * LANES) as isize, &mut room, |_, _| 0);
            let columns = &columns[..SPAN];
            let mut sums = [0; LANES];
            for away in 0..WINDOW {
                let columns = &columns[away..][..LANES];
                for j in 0..LANES {
                    sums[j] += columns[j];
                }
            }
            out.copy_from_slice(&sums[..out.len()]);
        }
    }
}
