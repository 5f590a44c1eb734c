//! What the estimation looks at, a part of the rows at a time where the pair does not fit into memory.

use std::borrow::Cow;
use std::ops::Range;

use super::bins::SIDE;
use super::rough::{Rough, Scale, Shades};
use super::spectrum::Place;
use crate::control::Control;
use crate::error::Result;
use crate::matcher::{Execution, Matcher, Pair};
use crate::source::{Source, widened};

/// Rows above and below a block that its rough disparities depend on: windows and neighbourhoods of the rough match, and
/// rows that masked ones copy.
const MARGIN: usize = 96;
/// The match that tells which blocks show the same.
pub const ROUGHEST: Scale = Scale { factor: 4, neighborhood: 9 };

/// Some rows of a pair.
pub struct Part<'a> {
    /// The row of the whole image that these begin with.
    first: usize,
    pair: Cow<'a, Pair>,
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

/// All rows of a pair that is in memory, with their rough disparities.
pub struct Kept<'a> {
    part: Part<'a>,
    rough: Rough,
}

/// All rows of a pair.
#[derive(Clone, Copy)]
pub enum Rows<'a> {
    /// Kept.
    Kept(&'a Kept<'a>),
    /// Read when they are looked at.
    Read(&'a dyn Source),
}

impl<'a> Kept<'a> {
    /// Those of a pair.
    pub fn new(pair: &'a Pair, means: Means) -> Result<Self> {
        let part = Part::new(0, Cow::Borrowed(pair), means)?;
        let rough = part.rough(ROUGHEST, means)?;
        Ok(Self { part, rough })
    }
}

impl Rows<'_> {
    /// Has blocks looked at whose top rows are these, from the first one down: of how many of them at a time makes no
    /// difference.
    pub fn look(
        &self,
        tops: &[usize],
        scale: Scale,
        means: Means,
        mut at: impl FnMut(&Part, &Rough, Range<usize>) -> Result<()>,
    ) -> Result<()> {
        match self {
            Self::Kept(Kept { part, rough }) if scale == ROUGHEST => at(part, rough, 0..tops.len()),
            Self::Kept(Kept { part, .. }) => at(part, &part.rough(scale, means)?, 0..tops.len()),
            Self::Read(source) => {
                let (height, most) = (source.size().0, source.most_rows());
                let mut first = 0;
                while let Some(rest) = tops.get(first..).filter(|rest| !rest.is_empty()) {
                    let fits = |top: &&usize| *top - rest[0] + SIDE <= most;
                    let count = rest.iter().take_while(fits).count().max(1);
                    let rows = widened(&(rest[0]..rest[count - 1] + SIDE), MARGIN, height);
                    let part = Part::read(*source, rows, means)?;
                    at(&part, &part.rough(scale, means)?, first..first + count)?;
                    first += count;
                }
                Ok(())
            }
        }
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

    /// Reads rows, from a multiple of what images are reduced by to one.
    fn read(source: &dyn Source, rows: Range<usize>, means: Means) -> Result<Self> {
        let unit = ROUGHEST.factor;
        let first = rows.start / unit * unit;
        let end = rows.end.next_multiple_of(unit).min(source.size().0);
        Part::new(first, Cow::Owned(source.rows(first..end)?), means)
    }

    fn rough(&self, scale: Scale, Means { matcher, how, control }: Means) -> Result<Rough> {
        Rough::new(&self.pair, &self.shades, scale, matcher, how, control)
    }

    /// The pair of blocks that show the same, whose left one has this corner in the whole image; `None` where there is
    /// none, or they show nothing.
    pub fn place(&self, rough: &Rough, top: usize, left: usize) -> Option<Place> {
        let place = rough.place(&self.pair, top - self.first, left)?;
        let [here, there] = &self.shades;
        let tells =
            here.has_contrast(place.top, place.left) && there.has_contrast(place.top, place.right);
        tells.then_some(Place { top, ..place })
    }

    /// Places in the whole image as they are here.
    pub fn local<'b>(&self, places: impl IntoIterator<Item = &'b Place>) -> Vec<Place> {
        let local = |place: &Place| Place { top: place.top - self.first, ..*place };
        places.into_iter().map(local).collect()
    }
}
