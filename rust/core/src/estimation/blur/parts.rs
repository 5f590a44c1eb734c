//! The rows of a pair that the estimation reads, a part at a time if the pair does not fit into memory.

use std::borrow::Cow;
use std::ops::Range;

use super::bins::SIDE;
use super::rough::{Correspondence, RoughMatch, RoughScale, grays, has_contrast};
use super::spectrum::BlockPlace;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::{Plane, widened};
use phasestereo_match::base::platform::both;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::source::Source;

/// Rows above and below a block that its rough disparities depend on: those of windows and neighborhoods of
/// the rough match, those that masked rows copy, and one for the detection of impulses.
pub const HALO: usize = 97;
/// The rough match that finds corresponding blocks.
pub const ROUGHEST: RoughScale = RoughScale { factor: 4, ..RoughScale::ROUGH };

/// Some rows of a pair.
pub struct Part<'a> {
    /// The row of the whole image that is the first one here.
    pub first: usize,
    /// The rows.
    pub pair: Cow<'a, Pair>,
    /// Gray values of both images.
    pub grays: [Plane<f32>; 2],
}

/// All rows of a pair.
pub struct PairRows<'a> {
    source: &'a dyn Source,
    /// The pair as one part, if it is read at once; else parts are read when they are visited.
    whole: Option<Part<'a>>,
}

/// Strips of rows to visit.
#[derive(Clone, Copy)]
pub struct Strips<'a> {
    /// The top row of each strip, ascending.
    pub tops: &'a [usize],
    /// Rows of each strip.
    pub rows: usize,
    /// Rows that are needed above and below.
    pub halo: usize,
    /// Parts begin and end at multiples of this many rows.
    pub unit: usize,
}

impl<'a> PairRows<'a> {
    /// The rows of a pair.
    pub fn new(source: &'a dyn Source, runtime: Runtime) -> Result<Self> {
        let height = source.size().0;
        let is_whole = source.most_rows() >= height;
        let whole = is_whole.then(|| Part::read(source, 0..height, runtime)).transpose()?;
        Ok(Self { source, whole })
    }

    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        self.source.size()
    }

    /// The pair as one part, if it is read at once.
    pub fn whole(&self) -> Option<&Part<'a>> {
        self.whole.as_ref()
    }

    /// Some rows of the pair, with the type and the range of the whole.
    pub fn sample(&self) -> Result<Cow<'_, Pair>> {
        match &self.whole {
            Some(part) => Ok(Cow::Borrowed(&*part.pair)),
            None => self.source.rows(0..1),
        }
    }

    /// Visits the strips from the first one down: calls `visit` with a part of the pair and the indices of
    /// the strips in it. The number of strips in a part does not matter.
    pub fn visit(
        &self,
        strips: Strips,
        runtime: Runtime,
        mut visit: impl FnMut(&Part, Range<usize>) -> Result<()>,
    ) -> Result<()> {
        if let Some(part) = &self.whole {
            return visit(part, 0..strips.tops.len());
        }

        let (source, height, most) = (self.source, self.source.size().0, self.source.most_rows());
        let mut first = 0;
        while let Some(rest) = strips.tops.get(first..).filter(|rest| !rest.is_empty()) {
            // All strips that fit into a part, and at least one.
            let fits = |top: &&usize| *top - rest[0] + strips.rows <= most;
            let count = rest.iter().take_while(fits).count().max(1);

            let rows = widened(&(rest[0]..rest[count - 1] + strips.rows), strips.halo, height);
            let start = rows.start / strips.unit * strips.unit;
            let end = rows.end.next_multiple_of(strips.unit).min(height);
            visit(&Part::read(source, start..end, runtime)?, first..first + count)?;

            first += count;
        }

        Ok(())
    }
}

impl<'a> Part<'a> {
    /// The part that begins at row `first` of the whole image.
    pub fn new(first: usize, pair: Cow<'a, Pair>, Runtime { control, .. }: Runtime) -> Result<Self> {
        let grays = both(|side| grays(pair.views()[side], control))?;
        Ok(Self { first, pair, grays })
    }

    fn read(source: &'a dyn Source, rows: Range<usize>, runtime: Runtime) -> Result<Self> {
        Part::new(rows.start, source.rows(rows)?, runtime)
    }

    /// Rough disparities of the part.
    pub fn rough(&self, known: &Correspondence, scale: RoughScale, runtime: Runtime) -> Result<RoughMatch> {
        let alignment = known.alignment.clone().map(|field| field.starting_at_row(self.first));
        let known = Correspondence { alignment, ..*known };

        RoughMatch::new(&self.grays, known, scale, runtime)
    }

    /// The pair of corresponding blocks whose left one has this corner in the whole image; `None` if there is
    /// none, or it has no contrast. The rough disparities begin at row `first` of the whole image.
    pub fn place(
        &self,
        (rough, first): (&RoughMatch, usize),
        (top, left): (usize, usize),
    ) -> Option<BlockPlace> {
        let place = rough.place(&self.pair, self.first - first, top - self.first, left)?;

        let [left, right] = &self.grays;
        let has_contrast =
            has_contrast(left, place.top, place.left) && has_contrast(right, place.right_top, place.right);

        let right_top = place.right_top + self.first;
        has_contrast.then_some(BlockPlace { top, right_top, ..place })
    }

    /// Places of the whole image, relative to the part.
    pub fn local<'b>(&self, places: impl IntoIterator<Item = &'b BlockPlace>) -> Vec<BlockPlace> {
        let local = |place: &BlockPlace| BlockPlace {
            top: place.top - self.first,
            right_top: place.right_top - self.first,
            ..*place
        };

        places.into_iter().map(local).collect()
    }
}

/// The strips of blocks with these top rows, with the halo of their rough disparities.
pub fn blocks<'a>(tops: &'a [usize], known: &Correspondence) -> Strips<'a> {
    let field = known.alignment.as_ref().map_or(0, |field| field.bound().ceil() as usize);

    Strips { tops, rows: SIDE, halo: HALO + field, unit: ROUGHEST.factor }
}
