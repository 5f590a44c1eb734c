//! What the estimation looks at, a part of the rows at a time where the pair does not fit into memory.

use std::borrow::Cow;
use std::ops::Range;

use super::bins::SIDE;
use super::rough::{Known, Rough, Scale, Shades};
use super::spectrum::Place;
use crate::error::Result;
use crate::pipeline::control::Control;
use crate::pipeline::matcher::{Execution, Matcher, Pair};
use crate::pipeline::source::{Source, widened};

/// Rows above and below a block that its rough disparities depend on: windows and neighborhoods of the rough match, and
/// Rows above and below a block that its rough disparities depend on: windows and neighborhoods of the rough match, and
/// rows that masked ones copy; and one by which impulses are told.
pub const MARGIN: usize = 97;
/// The match that tells which blocks show the same.
pub const ROUGHEST: Scale = Scale { factor: 4, neighborhood: 9 };

/// Some rows of a pair.
pub struct Part<'a> {
    /// The row of the whole image that these begin with.
    pub first: usize,
    /// They themselves.
    pub pair: Cow<'a, Pair>,
    /// Gray values of both images.
    pub shades: [Shades; 2],
}

/// What the work is done with.
#[derive(Clone, Copy)]
pub struct Means<'a> {
    /// Matches roughly.
    pub matcher: &'a Matcher,
    /// By which threads and instructions.
    pub how: Execution,
    /// Whether to go on.
    pub control: &'a Control,
}

/// All rows of a pair.
#[derive(Clone, Copy)]
pub enum Rows<'a> {
    /// In memory.
    Kept(&'a Part<'a>),
    /// Read when they are looked at.
    Read(&'a dyn Source),
}

/// Which rows are looked at.
#[derive(Clone, Copy)]
pub struct Look<'a> {
    /// The top rows of what is looked at, from the first one down.
    pub tops: &'a [usize],
    /// Rows of each.
    pub rows: usize,
    /// Rows that are needed above and below.
    pub margin: usize,
    /// Parts begin, and end, at multiples of so many rows.
    pub unit: usize,
}

impl Rows<'_> {
    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Kept(part) => part.pair.size(),
            Self::Read(source) => source.size(),
        }
    }

    /// These rows as a pair of their own.
    pub fn pair(&self, rows: Range<usize>) -> Result<Pair> {
        match self {
            Self::Kept(part) => Ok(part.pair.of_rows(rows)),
            Self::Read(source) => source.rows(rows),
        }
    }

    /// Has rows looked at, from the first top down: of how many tops at a time makes no difference.
    pub fn look(
        &self,
        look: Look,
        means: Means,
        mut at: impl FnMut(&Part, Range<usize>) -> Result<()>,
    ) -> Result<()> {
        let source = match self {
            Self::Kept(part) => return at(part, 0..look.tops.len()),
            Self::Read(source) => *source,
        };
        let (height, most) = (source.size().0, source.most_rows());
        let mut first = 0;
        while let Some(rest) = look.tops.get(first..).filter(|rest| !rest.is_empty()) {
            let fits = |top: &&usize| *top - rest[0] + look.rows <= most;
            let count = rest.iter().take_while(fits).count().max(1);
            let rows = widened(&(rest[0]..rest[count - 1] + look.rows), look.margin, height);
            let rows = rows.start / look.unit * look.unit..rows.end.next_multiple_of(look.unit);
            at(
                &Part::read(source, rows.start..rows.end.min(height), means)?,
                first..first + count,
            )?;
            first += count;
        }
        Ok(())
    }
}

impl<'a> Part<'a> {
    /// Those from a row of the whole image on.
    pub fn new(
        first: usize,
        pair: Cow<'a, Pair>,
        Means { how, control, .. }: Means,
    ) -> Result<Self> {
        let [left, right] = pair.views();
        let shades = [Shades::new(left, how, control)?, Shades::new(right, how, control)?];
        Ok(Self { first, pair, shades })
    }

    fn read(source: &dyn Source, rows: Range<usize>, means: Means) -> Result<Self> {
        Part::new(rows.start, Cow::Owned(source.rows(rows)?), means)
    }

    /// Rough disparities.
    pub fn rough(
        &self,
        known: &Known,
        scale: Scale,
        Means { matcher, how, control }: Means,
    ) -> Result<Rough> {
        let alignment = known.alignment.clone().map(|field| field.starting_at_row(self.first));
        let known = Known { alignment, ..*known };
        Rough::new(&self.shades, known, scale, matcher, how, control)
    }

    /// The pair of blocks that show the same, whose left one has this corner in the whole image; `None` where there is
    /// none, or they show nothing.
    pub fn place(&self, rough: &Rough, top: usize, left: usize) -> Option<Place> {
        let place = rough.place(&self.pair, top - self.first, left)?;
        let [here, there] = &self.shades;
        let tells = here.has_contrast(place.top, place.left)
            && there.has_contrast(place.right_top, place.right);
        let right_top = place.right_top + self.first;
        tells.then_some(Place { top, right_top, ..place })
    }

    /// Places in the whole image as they are here.
    pub fn local<'b>(&self, places: impl IntoIterator<Item = &'b Place>) -> Vec<Place> {
        let local = |place: &Place| Place {
            top: place.top - self.first,
            right_top: place.right_top - self.first,
            ..*place
        };
        places.into_iter().map(local).collect()
    }
}

/// Blocks whose top rows are these, with all that their rough disparities depend on.
pub fn blocks<'a>(tops: &'a [usize], known: &Known) -> Look<'a> {
    let field = known.alignment.as_ref().map_or(0, |field| field.bound().ceil() as usize);
    Look { tops, rows: SIDE, margin: MARGIN + field, unit: ROUGHEST.factor }
}
