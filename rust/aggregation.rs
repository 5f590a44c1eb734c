//! Rows of costs -> box sums -> shiftable-window minima, through a ring of about one window's height.
//!
//! A row holds `width x candidates` values, candidate innermost. Costs continue beyond the image by
//! repeating its edge; a shifted window's centre is clamped into the image.

use crate::control::Control;
use crate::cost::Costs;
use crate::error::Result;
use crate::plane::{Plane, zeroed};
use crate::settings::Settings;

/// Shape of the volume that streams through, and of the window that sums it.
#[derive(Debug, Clone, Copy)]
pub struct Window {
    /// Rows of the image.
    pub rows: usize,
    /// Columns of the image.
    pub cols: usize,
    /// Candidates of each pixel.
    pub candidates: usize,
    /// Side of the window, odd.
    pub side: usize,
    /// Whether the best of five windows counts.
    pub shiftable: bool,
    /// The largest cost of one vote: what a pixel with no vote in its window pays per place.
    pub ceiling: u16,
}

impl Window {
    /// The window of checked settings over the costs of a pair.
    pub fn new(
        (rows, cols): (usize, usize),
        candidates: usize,
        settings: &Settings,
        ceiling: u16,
    ) -> Self {
        let Settings { window: side, shiftable, .. } = *settings;
        Self { rows, cols, candidates, side, shiftable, ceiling }
    }

    /// Memory for one aggregated row.
    pub fn row(&self) -> Result<Vec<u32>> {
        zeroed(self.row_length())
    }

    /// Pixels from the window's centre to its side.
    pub fn radius(&self) -> usize {
        self.side / 2
    }

    /// Rows and columns by which a window may be shifted.
    fn reach(&self) -> usize {
        if self.shiftable { self.radius() } else { 0 }
    }

    /// Places in the window.
    pub fn area(&self) -> u32 {
        (self.side * self.side) as u32
    }

    fn row_length(&self) -> usize {
        self.cols * self.candidates
    }

    /// A window without votes costs the ceiling at each of its places; one with some, their mean.
    pub fn share(&self, sum: u32, votes: u32) -> u32 {
        let area = u64::from(self.area());
        let mean = match u64::from(votes) {
            0 => area * u64::from(self.ceiling),
            votes => (u64::from(sum) * area + votes / 2) / votes,
        };
        mean as u32
    }
}

/// Where rows of costs, and of the votes they consist of, come from.
pub trait Source {
    /// Writes the costs of row `y`; 0 where there is no vote.
    fn write_costs(&self, y: usize, costs: &mut [u16]);
    /// Writes the votes of row `y`, 0 or 1.
    fn write_votes(&self, y: usize, votes: &mut [u16]);
    /// Whether every pixel votes for every candidate, so that nobody need ask.
    fn all_vote(&self) -> bool;
}

impl Source for Costs<'_> {
    fn write_costs(&self, y: usize, costs: &mut [u16]) {
        self.write_row(y, costs);
    }

    fn write_votes(&self, y: usize, counts: &mut [u16]) {
        match self.votes() {
            Some(votes) => votes.write_row(y, counts),
            None => counts.fill(1),
        }
    }

    fn all_vote(&self) -> bool {
        self.votes().is_none()
    }
}

/// A whole cost volume: every pixel votes for every candidate.
impl Source for Plane<u16> {
    fn write_costs(&self, y: usize, costs: &mut [u16]) {
        costs.copy_from_slice(self.row(y));
    }

    fn write_votes(&self, _: usize, counts: &mut [u16]) {
        counts.fill(1);
    }

    fn all_vote(&self) -> bool {
        true
    }
}

/// Aggregates rows from top to bottom, starting anywhere.
pub struct Aggregator<'a, S: Source> {
    window: Window,
    source: &'a S,
    control: &'a Control,
    costs: BoxSums,
    votes: Option<Ballots>,
    /// Box sums of the rows that a shifted window can reach, by row modulo the window's side.
    ring: Vec<Vec<u32>>,
    /// The next row to enter the ring.
    next: usize,
}

/// Box sums of the votes, and memory for one row of them.
struct Ballots {
    sums: BoxSums,
    row: Vec<u32>,
}

impl<'a, S: Source> Aggregator<'a, S> {
    /// An aggregator whose first row will be `first`.
    pub fn new(window: Window, first: usize, source: &'a S, control: &'a Control) -> Result<Self> {
        let next = first.saturating_sub(window.reach());
        let ballots = || Ok(Ballots { sums: BoxSums::new(window, next)?, row: window.row()? });
        // All rows of an image lower than the window fit into fewer.
        let kept = (2 * window.reach() + 1).min(window.rows);
        Ok(Self {
            window,
            source,
            control,
            costs: BoxSums::new(window, next)?,
            votes: if source.all_vote() { None } else { Some(ballots()?) },
            ring: (0..kept).map(|_| window.row()).collect::<Result<_>>()?,
            next,
        })
    }

    /// Writes the aggregated costs of row `y`, which must be the one after the last row asked for.
    pub fn write_row(&mut self, y: usize, aggregated: &mut [u32]) -> Result<()> {
        let (reach, last) = (self.window.reach(), self.window.rows - 1);
        while self.next <= (y + reach).min(last) {
            self.enter_row()?;
        }
        let row = |y: usize| &self.ring[y.min(last) % self.ring.len()];
        aggregated.copy_from_slice(row(y));
        if self.window.shiftable {
            lower(aggregated, row(y.saturating_sub(reach)));
            lower(aggregated, row(y + reach));
            lower_sideways(aggregated, row(y), self.window);
        }
        Ok(())
    }

    fn enter_row(&mut self) -> Result<()> {
        let (source, control) = (self.source, self.control);
        let slot = self.next % self.ring.len();
        let sums = &mut self.ring[slot];
        self.costs.write_row(self.next, sums, |y, costs| {
            source.write_costs(y, costs);
            control.checkpoint()
        })?;
        if let Some(votes) = &mut self.votes {
            votes.sums.write_row(self.next, &mut votes.row, |y, row| {
                source.write_votes(y, row);
                control.checkpoint()
            })?;
            for (sum, count) in sums.iter_mut().zip(&votes.row) {
                *sum = self.window.share(*sum, *count);
            }
        }
        self.next += 1;
        Ok(())
    }
}

/// The aggregated costs of a whole volume.
pub fn aggregate(volume: &Plane<u16>, window: Window, control: &Control) -> Result<Plane<u32>> {
    let mut aggregated = Plane::new(volume.rows(), volume.cols())?;
    let mut aggregator = Aggregator::new(window, 0, volume, control)?;
    for y in 0..volume.rows() {
        aggregator.write_row(y, aggregated.row_mut(y))?;
    }
    Ok(aggregated)
}

/// Element-wise minimum, in place.
fn lower(row: &mut [u32], other: &[u32]) {
    for (value, other) in row.iter_mut().zip(other) {
        *value = (*value).min(*other);
    }
}

/// Minimum with the windows centred a radius to the left and to the right.
fn lower_sideways(row: &mut [u32], sums: &[u32], window: Window) {
    let count = window.candidates;
    let at = |x: usize| &sums[x * count..][..count];
    for (x, places) in row.chunks_exact_mut(count).enumerate() {
        lower(places, at(x.saturating_sub(window.radius())));
        lower(places, at((x + window.radius()).min(window.cols - 1)));
    }
}

/// Box sums of one row after another.
struct BoxSums {
    window: Window,
    /// The rows under the window and the one that has just left it, by row modulo their number.
    ring: Vec<Vec<u16>>,
    /// Sum over the rows under the window, for each place of a row.
    columns: Vec<u32>,
    /// The next row to come from the source.
    next: usize,
    /// Whether a row was summed already, so that the next can slide from it.
    started: bool,
}

impl BoxSums {
    fn new(window: Window, first: usize) -> Result<Self> {
        Ok(Self {
            window,
            ring: (0..(window.side + 1).min(window.rows))
                .map(|_| zeroed(window.row_length()))
                .collect::<Result<_>>()?,
            columns: window.row()?,
            next: first.saturating_sub(window.radius()),
            started: false,
        })
    }

    fn write_row(
        &mut self,
        y: usize,
        sums: &mut [u32],
        mut source: impl FnMut(usize, &mut [u16]) -> Result<()>,
    ) -> Result<()> {
        let radius = self.window.radius() as isize;
        let y = y as isize;
        if self.started {
            self.enter(y + radius, &mut source)?;
            self.leave(y - radius - 1);
        } else {
            (y - radius..=y + radius).try_for_each(|row| self.enter(row, &mut source))?;
            self.started = true;
        }
        sum_sideways(&self.columns, sums, self.window);
        Ok(())
    }

    fn enter(
        &mut self,
        y: isize,
        source: &mut impl FnMut(usize, &mut [u16]) -> Result<()>,
    ) -> Result<()> {
        let y = self.clamped(y);
        while self.next <= y {
            let slot = self.next % self.ring.len();
            source(self.next, &mut self.ring[slot])?;
            self.next += 1;
        }
        for (sum, value) in self.columns.iter_mut().zip(&self.ring[y % self.ring.len()]) {
            *sum += u32::from(*value);
        }
        Ok(())
    }

    fn leave(&mut self, y: isize) {
        let y = self.clamped(y);
        for (sum, value) in self.columns.iter_mut().zip(&self.ring[y % self.ring.len()]) {
            *sum -= u32::from(*value);
        }
    }

    fn clamped(&self, y: isize) -> usize {
        y.clamp(0, self.window.rows as isize - 1) as usize
    }
}

/// Sums of `side` neighbouring places of a row, for each candidate by itself.
fn sum_sideways(columns: &[u32], sums: &mut [u32], window: Window) {
    let (count, radius) = (window.candidates, window.radius() as isize);
    let at = |x: isize| {
        let x = x.clamp(0, window.cols as isize - 1) as usize;
        &columns[x * count..][..count]
    };
    let (first, rest) = sums.split_at_mut(count);
    first.fill(0);
    for x in -radius..=radius {
        first.iter_mut().zip(at(x)).for_each(|(sum, value)| *sum += value);
    }
    let mut before: &[u32] = first;
    for (x, places) in (1..).zip(rest.chunks_exact_mut(count)) {
        let changes = at(x + radius).iter().zip(at(x - radius - 1));
        for ((sum, before), (enters, leaves)) in places.iter_mut().zip(before).zip(changes) {
            *sum = before + enters - leaves;
        }
        before = places;
    }
}
