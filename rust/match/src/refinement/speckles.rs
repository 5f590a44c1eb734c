//! Flags speckles: small regions whose disparities differ from everything around them are wrong, whatever
//! their costs.

use std::ops::Range;

use rayon::prelude::*;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::simd::{Level, leveled};
use crate::image::regions::{Connectivity, Regions, Run};
use crate::pair::plan::{Plan, Stage};
use crate::refinement::filling::write_trusted;
use crate::refinement::flag;

/// Pixels tested together for the end of a run.
const LOOK: usize = 8;

/// The detection of speckles.
pub struct Speckles;

impl Stage for Speckles {
    fn reach(&self, plan: Plan) -> usize {
        // A region that is not larger than a speckle has no more rows than pixels.
        plan.settings.speckle_size
    }
}

/// Flags the connected regions of up to `size` trusted pixels. Two neighbors, horizontal or vertical, are
/// connected if their disparities differ by at most `range`.
pub fn flag_speckles(
    disparity: &Plane<f32>,
    flags: &mut Plane<u16>,
    (size, range): (usize, f32),
    level: Level,
    control: &Control,
) -> Result<()> {
    let regions = Regions::find(&TrustedMap { disparity, flags, range, level }, control)?;

    let rows = flags.as_mut_slice().par_chunks_mut(disparity.cols()).enumerate();
    rows.for_each(|(y, flags)| {
        for (run, _) in regions.row(y).filter(|(_, region)| region.pixels <= size) {
            for flags in &mut flags[run] {
                *flags |= flag::SPECKLE;
            }
        }
    });
    Ok(())
}

/// The map whose regions are searched.
struct TrustedMap<'a> {
    disparity: &'a Plane<f32>,
    flags: &'a Plane<u16>,
    range: f32,
    level: Level,
}

/// The trusted disparities of a row, NaN elsewhere, and where runs begin.
#[derive(Debug)]
struct TrustedRow {
    values: Vec<f32>,
    /// 1 where a pixel is not connected with its left neighbor, else 0; zeros up to a multiple of [`LOOK`].
    breaks: Vec<u8>,
}

impl Connectivity for TrustedMap<'_> {
    type Row = TrustedRow;

    fn size(&self) -> (usize, usize) {
        (self.disparity.rows(), self.disparity.cols())
    }

    fn row(&self, y: usize) -> TrustedRow {
        let disparity = self.disparity.row(y);
        let flags = self.flags.row(y);
        let mut row = TrustedRow {
            values: vec![0.0; disparity.len()],
            breaks: vec![0; disparity.len().next_multiple_of(LOOK)],
        };

        let TrustedRow { values, breaks } = &mut row;
        find_breaks(self.level, disparity, flags, self.range, values, breaks);
        row
    }

    fn add_runs(row: &TrustedRow, runs: &mut Vec<Run>) {
        let mut start = None;
        let mut end_at = |column: usize| {
            if let Some(start) = start {
                runs.push(Run { start, end: column as u32 });
            }
            let is_trusted = row.values.get(column).is_some_and(|value| !value.is_nan());
            start = is_trusted.then_some(column as u32);
        };

        // Eight bytes are tested at once: most pixels do not begin a run.
        for (look, breaks) in row.breaks.as_chunks::<LOOK>().0.iter().enumerate() {
            let mut breaks = u64::from_le_bytes(*breaks);
            while breaks != 0 {
                end_at(look * LOOK + breaks.trailing_zeros() as usize / 8);
                breaks &= breaks - 1;
            }
        }
        end_at(row.values.len());
    }

    fn is_connected(&self, above: &TrustedRow, here: &TrustedRow, columns: Range<usize>) -> bool {
        let mut pairs = above.values[columns.clone()].iter().zip(&here.values[columns]);
        pairs.any(|(a, b)| (a - b).abs() <= self.range)
    }
}

/// Extracts the trusted disparities of a row and where they are not connected.
#[leveled]
fn find_breaks(
    level: Level,
    disparity: &[f32],
    flags: &[u16],
    range: f32,
    values: &mut [f32],
    breaks: &mut [u8],
) {
    write_trusted(disparity, flags, values);

    // NaN is not connected with anything, so runs of trusted pixels end at untrusted ones.
    breaks[0] = 1;
    for ((out, from), to) in breaks[1..].iter_mut().zip(&values[..]).zip(&values[1..]) {
        let is_connected = (from - to).abs() <= range;
        *out = u8::from(!is_connected);
    }
}
