//! The range of disparities to search: the run that holds nearly all of those found in reduced copies of a
//! pair, with adjacent ones, and the areas that match outside it ([`super::areas`]), however small.

use std::cmp::Reverse;
use std::ops::Range;

use super::areas::{Area, BLOCK, areas, fine_areas};
use super::extent::{FEW, Span, known};
use super::order::{Order, Signs};
use super::overview::{
    self, COARSE_WIDTH, FINE, GOOD_CONFIDENCE, Guess, LEAST_SIZE, Overview, ROUGH, RoughMap, fine_factor,
};
use super::periods::periods;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::linear::Normal;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::statistics::ranked;
use phasestereo_match::image::blocking::SIDE;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::MOST_DISPARITIES;

/// Least mean confidence of a usable match: 0.58 to 0.95 for 12 pairs, sharp, after six one-sided blurs and
/// with changed contrast; 0.11 to 0.44 for unrelated images.
pub const LEAST_CONFIDENCE: f64 = 0.45;
/// Disparities searched beyond those that were found on either side, as a share of the range's length.
const MARGIN: f64 = 0.08;
/// ... and as a share of a pixel of the copy on which the ends were found.
const COARSE: f64 = 0.1;
/// Length of a long range, pixels.
const LONG: f64 = 16.0;
/// Nearly all of the matches.
const NEARLY_ALL: f64 = 0.95;
/// Least mean confidence of the match of finer copies; with less, noise or blur hide everything in them.
const LEAST_FINE: f64 = 0.5;
/// Pixels of the copy by which finer copies of less confidence may still move an end inward.
const LOST: isize = 1;
/// Least advantage, in bits, of disparities outside the run for an area that belongs to the range. Of 54
/// objects of 0.5 % of an image, 8 to 14 px wide, or of 24 to 40 px, one has less; in 27 pairs without such
/// objects, no area has more than 857 ...
const CERTAIN: u64 = 1000;
/// ... or of this, on the near side of the run, within this share of its length.
const BESIDE: (u64, f64) = (500, 0.25);
/// Least advantage, in bits, for an area of the finest copies, where pixels that the right image does not
/// confirm count against it. In 42 pairs without such objects, sharp, blurred, or with noise of up to 8 gray
/// levels, none has more than 433; under objects of a few pixels, those that were lost with twice as much
/// have 580 to 1120.
const CERTAIN_FINE: u64 = 500;
/// The same for areas farther than the run, which are not small. Without such objects, areas in 50 streams
/// have up to 2400; with objects of 125 x 44 px there, 12 000 and more.
const CERTAIN_FARTHER: u64 = 5000;
/// Factor by which steps between neighboring columns are larger at the borders of the blocks of lossy
/// compression. Of 20 pairs, 0.87 to 1.04; under JPEG of quality 60 1.07 to 1.71, of quality 30 1.28 to 2.47.
const BLOCKY: f64 = 1.06;
/// Frames that take turns in covering all rows of a video: if it is known which squares change, and if not.
/// Two take 6 % of the time of a steady frame of 741 x 497 by `fast`, and find some objects one frame late.
const TURNS: [usize; 2] = [8, 2];
/// Rows of squares that are examined together.
const TURN_ROWS: usize = 2;
/// Rows of a band of the finer copies in which an end of the run is refined.
const BAND: usize = 16;
/// Fewest bands for an end, and one in how many of all.
const BANDS: (usize, usize) = (2, 6);
/// Of the disparities on the other side of zero, one in this many is tried.
const OTHER_SIDE: isize = 4;
/// Longest run, pixels of the copy, between an image and its copy with noise.
const NARROW: isize = 8;
/// Tiles on each side of an image.
const TILES: usize = 4;
/// Shifts, pixels of the copy, that count as none.
const SHIFT: f64 = 0.05;
/// Share of the disparities that is left out at either end of those of the fine copies.
const FARTHEST: f64 = 0.0005;
/// Disparities of the copy, pixels, that are clearly not zero.
const CLEARLY: f64 = 2.0;

/// The range of disparities of a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchRange {
    /// Smallest disparity to search.
    pub min: i64,
    /// Number of disparities to search.
    pub count: i64,
    /// Least disparity found, pixels.
    pub low: f64,
    /// Largest disparity found, pixels.
    pub high: f64,
    /// Whether nearly all disparities are negative, most of them clearly, as for swapped or cropped images
    /// and toed-in cameras.
    pub negative: bool,
    /// Whether many disparities of either sign are clearly not zero, as for toed-in cameras.
    pub mixed: bool,
    /// The evidence in the images about the order of the cameras.
    pub shown: Signs,
    /// Whether both images are the same, up to noise.
    pub identical: bool,
}

impl SearchRange {
    /// Whether left and right are swapped: nearly all disparities are negative, and the scene confirms it.
    pub fn is_swapped(&self) -> bool {
        self.negative && self.is_exchanged()
    }

    /// Whether the scene shows that left and right are exchanged, whatever the sign of the disparities.
    pub fn is_exchanged(&self) -> bool {
        self.shown.order() == Order::Exchanged
    }

    /// The disparities to search in images of this width.
    pub fn candidates(&self, width: usize) -> Result<Candidates> {
        let count = self.count.clamp(1, width.min(MOST_DISPARITIES) as i64);
        let min = self.min.clamp(1 - width as i64, width as i64 - 1);
        Candidates::new(min, count, width)
    }
}

/// A place whose disparities are not searched, although an object seems to be there; pixels of the full
/// image.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// Its rows.
    pub rows: Range<usize>,
    /// Its columns.
    pub columns: Range<usize>,
    /// The smallest disparity there.
    pub low: f64,
    /// The largest one.
    pub high: f64,
}

/// The range of a pair, and the places that it leaves out.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundRange {
    /// The range.
    pub range: SearchRange,
    /// Places that it may leave out.
    pub left_out: Vec<LeftOut>,
}

/// Copies of a pair: the finest, on which the smallest objects are found, those on which the ends of the
/// range are found, and the overview.
#[derive(Clone, Copy)]
pub struct Copies<'a> {
    /// The finest ones.
    pub finest: &'a Overview,
    /// Those on which the ends are found.
    pub fine: &'a Overview,
    /// Those of the rough match.
    pub overview: &'a Overview,
}

/// The known facts about the ends of a range, pixels.
struct Ends {
    low: f64,
    high: f64,
    /// The factor of the copies on which they were found.
    factor: usize,
    /// Places outside the run of most disparities.
    places: Vec<LeftOut>,
    identical: bool,
}

/// The range from a rough match of the overview; `None` if there is too little texture or too little in
/// common. `is_turned`: as for [`Signs::new`].
pub fn range(
    copies: Copies,
    map: &RoughMap,
    is_turned: bool,
    runtime: Runtime,
) -> Result<Option<FoundRange>> {
    // Repeating texture matches badly, but its periods are seen.
    let fine = copies.fine;
    let periods = periods(fine, map.field.as_ref(), runtime)?;
    let run = map.run.filter(|_| map.confidence >= LEAST_CONFIDENCE);
    let Some(mut ends) = (match run {
        Some(run) => Some(Ends::of_run(copies, map, run, runtime)?),
        None => periods.map(|periods| Ends::of_span(periods, fine.factor)),
    }) else {
        return Ok(None);
    };
    let periods = periods.filter(|_| !ends.identical);
    if let Some((low, high)) = periods.map(|span| LeftOut::ends(span, fine.factor)) {
        (ends.low, ends.high) = (ends.low.min(low), ends.high.max(high));
    }
    for place in &ends.places {
        (ends.low, ends.high) = (ends.low.min(place.low), ends.high.max(place.high));
    }

    let Ends { low, high, factor, places, identical } = ends;
    let (start, end) = with_margin(low, high, factor as f64);
    let overview = copies.overview;
    let width = overview.planes[0].cols() * overview.factor;
    // The sign of repeating texture is unknown.
    let (negative, mixed) = if periods.is_some() { (false, false) } else { signs(map) };
    let mixed = mixed && low < 0.0 && high > 0.0;
    let shown = Signs::new(overview, map, is_turned);
    let count = (end - start + 1).min(width as i64);
    let range = SearchRange { min: start, count, low, high, negative, mixed, shown, identical };

    let left_out = beyond(places, range.candidates(width)?);
    Ok(Some(FoundRange { range, left_out }))
}

impl Ends {
    /// The ends of a span of disparities of copies.
    fn of_span(span: Span, factor: usize) -> Self {
        let (low, high) = LeftOut::ends(span, factor);
        Self { low, high, factor, places: vec![], identical: false }
    }

    /// The ends of the run of a rough match of the overview, on finer copies if these match.
    fn of_run(copies: Copies, map: &RoughMap, known: Span, runtime: Runtime) -> Result<Self> {
        let Copies { finest, fine, overview } = copies;
        let mut used = fine;
        let (mut run, mut found) = refined(fine, overview, map, known, runtime)?;
        if found.confidence < LEAST_FINE && fine.factor < overview.factor {
            used = overview;
            (run, found) = refined(overview, overview, map, known, runtime)?;
        }

        let is_narrow = run.0 <= 0 && run.1 >= 0 && run.1 - run.0 <= NARROW;
        if is_narrow && is_identical(used) {
            let factor = used.factor;
            return Ok(Self { low: 0.0, high: 0.0, factor, places: vec![], identical: true });
        }

        let [mut low, mut high] = ends(&found, run);
        if found.confidence < LEAST_FINE {
            // They hide disparities that the rough match was sure of.
            (low, high) = (low.min((run.0 + LOST) as f64), high.max((run.1 - LOST) as f64));
        }
        let factor = used.factor as f64;
        let mut places = outside(used, overview, map, run, runtime)?;
        let run = scaled(run, used.factor, finest.factor);
        places.extend(small_places(copies, run, map, runtime)?);
        let (low, high) = (low * factor, high * factor);
        Ok(Self { low, high, factor: used.factor, places, identical: false })
    }
}

/// The run of a rough map of the overview, with its ends refined on finer copies, and a match of these at the
/// ends.
fn refined(
    copies: &Overview,
    overview: &Overview,
    map: &RoughMap,
    (first, last): Span,
    runtime: Runtime,
) -> Result<(Span, RoughMap)> {
    let finer = overview.factor / copies.factor;
    let bands = bands_at_ends(map, (first, last), BAND.div_ceil(finer));
    let bands: Vec<Range<usize>> = bands.iter().map(|rows| rows.start * finer..rows.end * finer).collect();

    let by = finer as isize;
    let around = ((first - 1) * by - 1, (last + 2) * by);
    let bands = copies.bands(&bands, map.field.as_ref(), runtime.control)?;
    let fine = bands.matched(around, None, FINE, runtime)?;

    // Each end is the outermost disparity near it that has enough matches.
    let mut counts = vec![0usize; (around.1 - around.0 + 1) as usize];
    for value in known(&fine.disparity) {
        let at = value.round_ties_even() as isize - around.0;
        let count = usize::try_from(at).ok().and_then(|at| counts.get_mut(at));
        if let Some(count) = count {
            *count += 1;
        }
    }
    let enough = (FEW * counts.iter().sum::<usize>() as f64).max(2.0);
    let is_likely = |count: &usize| *count as f64 >= enough;
    let disparity = |at: usize| at as isize + around.0;
    let low = counts.iter().position(is_likely).map_or(first * by, disparity);
    let high = counts.iter().rposition(is_likely).map_or(last * by, disparity);
    Ok(((low.min((first + 1) * by), high.max((last - 1) * by).max(low)), fine))
}

/// The bands of this many rows that show most of the disparities at either end of a run, and the outermost
/// ones, from the top down.
pub fn bands_at_ends(map: &RoughMap, (first, last): Span, height: usize) -> Vec<Range<usize>> {
    let rows = map.disparity.rows();
    let bands: Vec<Range<usize>> =
        (0..rows).step_by(height).map(|top| top..(top + height).min(rows)).collect();
    let wanted = (bands.len() / BANDS.1).max(BANDS.0);

    // The border shows the ends of a floor or a slope.
    let mut chosen = vec![0, bands.len() - 1];
    for end in [first, last] {
        let is_there = |value: &&f32| (**value - end as f32).abs() < 0.5;
        let count = |rows: &Range<usize>| -> usize {
            rows.clone().map(|y| map.disparity.row(y).iter().filter(is_there).count()).sum()
        };
        let mut order: Vec<(usize, usize)> = bands.iter().map(count).zip(0..).collect();
        order.sort_by_key(|(count, band)| (Reverse(*count), *band));
        chosen.extend(order.into_iter().take(wanted).map(|(_, band)| band));
    }

    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter().map(|band| bands[band].clone()).collect()
}

/// Whether nearly all disparities are negative, and whether there are many of either sign.
pub fn signs(map: &RoughMap) -> (bool, bool) {
    let known: Vec<f64> = known(&map.disparity).map(f64::from).collect();
    let share = |is_one: &dyn Fn(f64) -> bool| {
        known.iter().filter(|value| is_one(**value)).count() as f64 / known.len() as f64
    };

    // Few clear disparities of the other sign may be mistakes.
    let below = share(&|value| value <= -CLEARLY);
    let negative = share(&|value| value < 0.0) >= NEARLY_ALL && below >= 0.5;
    let mixed = below.min(share(&|value| value >= CLEARLY)) >= 1.0 - NEARLY_ALL;
    (negative, mixed)
}

/// The places that known disparities leave out, as far as the overview shows.
pub fn left_out(
    overview: &Overview,
    map: &RoughMap,
    candidates: Candidates,
    runtime: Runtime,
) -> Result<Vec<LeftOut>> {
    let run = overview.span(candidates);
    let guess = overview.guess(map, overview);
    let places = places_of(overview, guess, run, reach(overview, run, false), map, runtime)?;
    Ok(beyond(places, candidates))
}

/// Where to search for objects that have entered a video.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a> {
    /// The number of the frame: some rows of squares are examined in turns, ...
    pub turn: usize,
    /// ... those that have changed in each; squares of [`BLOCK`] pixels of the fine copies.
    pub changed: Option<&'a Plane<bool>>,
}

impl Asked<'_> {
    /// Whether a row of squares has its turn.
    fn is_in_turn(self, row: usize) -> bool {
        let turns = TURNS[usize::from(self.changed.is_none())];
        // After all turns, others are neighbors.
        (row + self.turn / turns) / TURN_ROWS % turns == self.turn % turns
    }

    /// The bands of rows of squares to examine.
    fn bands(self, rows: usize) -> Vec<Range<usize>> {
        let is_one = |row: &usize| {
            self.is_in_turn(*row) || self.changed.is_some_and(|all| all.row(*row).contains(&true))
        };
        let mut bands: Vec<Range<usize>> = vec![];
        for row in (0..rows).filter(is_one) {
            match bands.last_mut() {
                Some(last) if last.end == row => last.end += 1,
                _ => bands.push(row..row + 1),
            }
        }
        bands
    }
}

/// The places, among those asked for, that match beyond the candidates of a map: objects that have entered a
/// video.
pub fn entered(
    pair: &Pair,
    map: &Plane<f32>,
    candidates: Candidates,
    asked: Asked,
    runtime: Runtime,
) -> Result<Vec<LeftOut>> {
    let (rows, cols) = pair.size();
    let unit = fine_factor((rows, cols));
    let (side, end) = (BLOCK * unit, rows / unit * unit);
    let asked_rows = asked.bands(end.div_ceil(side));
    let bands: Vec<Range<usize>> =
        asked_rows.iter().map(|band| band.start * side..(band.end * side).min(end)).collect();
    if bands.is_empty() || rows.min(cols) < LEAST_SIZE {
        return Ok(vec![]);
    }

    let finest = Overview::finest_of_bands(pair, &bands, runtime)?;
    let copies = finest.reduced_by(unit / finest.factor, runtime)?;
    let map = overview::of_bands(map, &bands)?;
    let squares: Vec<usize> = asked_rows.into_iter().flatten().collect();
    let is_asked = |y: usize, x: usize| {
        let row = squares[y / BLOCK];
        asked.is_in_turn(row) || asked.changed.is_some_and(|all| all.row(row)[x / BLOCK])
    };
    let judged = Plane::from_fn(copies.valid.rows(), copies.valid.cols(), is_asked);
    let guess = Guess { disparity: &map, by: copies.factor, finer: 1, judged: Some(&judged) };

    let run = finest.span(candidates);
    let tried = reach(&finest, run, false);
    let found = fine_areas([&finest, &copies], guess, run, tried, None, runtime)?;
    let blocky = || {
        // Few rows do not show it.
        let whole = Overview::finest_of_bands(pair, std::slice::from_ref(&(0..end)), runtime)?;
        Ok(is_blocky(&whole))
    };
    Ok(beyond(certain(found, finest.factor, run, blocky)?, candidates))
}

/// The places outside a run of the copies that belong to the range, on all coarser copies, which withstand
/// noise. `map` is the rough match of the overview. On copies finer than the overview, only nearer places are
/// searched: anything farther than a run is not small.
fn outside(
    copies: &Overview,
    overview: &Overview,
    map: &RoughMap,
    run: Span,
    runtime: Runtime,
) -> Result<Vec<LeftOut>> {
    let mut places = vec![];
    let mut coarser = copies.halved(runtime)?;
    while let Some(here) = coarser {
        let by = (here.factor / copies.factor) as isize;
        let run = (run.0.div_euclid(by), (run.1 + by - 1).div_euclid(by));

        let reach = reach(&here, run, here.factor < overview.factor);
        places.extend(places_of(&here, overview.guess(map, &here), run, reach, map, runtime)?);
        coarser = here.halved(runtime)?;
    }
    Ok(places)
}

/// A run of disparities of copies, converted to copies of another factor.
fn scaled((low, high): Span, from: usize, to: usize) -> Span {
    let (from, to) = (from as isize, to as isize);
    ((low * from).div_euclid(to), ((high + 1) * from - 1).div_euclid(to))
}

/// The places outside a run that only the finest copies show.
fn small_places(
    Copies { finest, fine, overview }: Copies,
    run: Span,
    map: &RoughMap,
    runtime: Runtime,
) -> Result<Vec<LeftOut>> {
    let (guess, reach) = (overview.guess(map, fine), reach(finest, run, true));
    let found = fine_areas([finest, fine], guess, run, reach, map.field.as_ref(), runtime)?;
    certain(found, finest.factor, run, || Ok(is_blocky(finest)))
}

/// The disparities to try beside a run: all nearer ones, and, unless the copies are finer than the overview,
/// as far on the other side of zero as cameras see that are slightly off parallel.
pub fn reach(copies: &Overview, run: Span, is_finer: bool) -> Span {
    let (lowest, highest) = copies.widest();
    let (lowest, highest) = (lowest.min(run.0), highest.max(run.1));
    if run.0 + run.1 >= 0 {
        (run.0.min(if is_finer { highest } else { lowest / OTHER_SIDE }), highest)
    } else {
        (lowest, run.1.max(if is_finer { lowest } else { highest / OTHER_SIDE }))
    }
}

/// The places outside a run of some copies that belong to the range.
fn places_of(
    copies: &Overview,
    guess: Guess,
    run: Span,
    reach: Span,
    map: &RoughMap,
    runtime: Runtime,
) -> Result<Vec<LeftOut>> {
    let mut found = areas(copies, guess, run, reach, map.field.as_ref(), runtime)?;
    found.retain(|area| belongs(area, run));
    Ok(found.iter().map(|area| LeftOut::new(area, copies.factor)).collect())
}

/// Whether the right image confirms an area, and disparities outside a run, or next to its near side, explain
/// it so much better.
pub fn belongs(area: &Area, run: Span) -> bool {
    let step = (BESIDE.1 * (run.1 - run.0) as f64) as isize;
    let is_beside = if run.0 + run.1 >= 0 {
        (run.1..=run.1 + step).contains(&area.span.0)
    } else {
        (run.0 - step..=run.0).contains(&area.span.1)
    };

    let least = if is_beside { BESIDE.0 } else { CERTAIN };
    is_seen(area) && area.gain >= least
}

/// The places of the areas of the finest copies that are certain. Blocks of lossy compression match each
/// other where their borders do, whatever they show.
fn certain(
    mut found: Vec<Area>,
    factor: usize,
    run: Span,
    is_blocky: impl FnOnce() -> Result<bool>,
) -> Result<Vec<LeftOut>> {
    let is_farther = |area: &Area| {
        if run.0 + run.1 >= 0 { area.span.1 < run.0 } else { area.span.0 > run.1 }
    };
    let is_certain = |area: &Area| {
        let (size, against) = (area.size as u64, (area.size - area.seen) as u64);
        let least = if is_farther(area) { CERTAIN_FARTHER } else { CERTAIN_FINE };
        area.gain * size.saturating_sub(2 * against) >= least * size
    };
    found.retain(is_certain);

    let mut places: Vec<LeftOut> = found.iter().map(|area| LeftOut::new(area, factor)).collect();
    let coincides = |place: &LeftOut| {
        let last = place.high.ceil() as isize;
        last.rem_euclid(SIDE as isize) <= last - place.low.floor() as isize
    };
    if places.iter().any(coincides) && is_blocky()? {
        places.retain(|place| !coincides(place));
    }
    Ok(places)
}

/// Whether copies show the borders of the blocks of lossy compression.
fn is_blocky(finest: &Overview) -> bool {
    let side = SIDE / finest.factor;
    if side < 2 {
        return false;
    }
    let mut steps = vec![0.0f64; side];
    let plane = &finest.planes[0];
    for y in 0..plane.rows() {
        for (x, pair) in plane.row(y).windows(2).enumerate() {
            steps[(x + 1) % side] += f64::from((pair[1] - pair[0]).abs());
        }
    }
    let border = steps[0];
    steps.sort_unstable_by(f64::total_cmp);
    border > BLOCKY * steps[side / 2]
}

/// Whether the right image confirms most of an area.
fn is_seen(area: &Area) -> bool {
    10 * area.seen >= 7 * area.size
}

/// The places with disparities beyond the candidates.
pub fn beyond(mut places: Vec<LeftOut>, candidates: Candidates) -> Vec<LeftOut> {
    let first = candidates.min() as f64 - 0.5;
    let last = candidates.max() as f64 + 0.5;

    let middle = |place: &LeftOut| f64::midpoint(place.low, place.high);
    places.retain(|place| !(first..=last).contains(&middle(place)));
    places
}

impl LeftOut {
    /// The place of an area of a copy that is reduced by a factor.
    pub fn new(area: &Area, factor: usize) -> Self {
        let whole = |range: &Range<usize>| range.start * factor..range.end * factor;
        let (low, high) = Self::ends(area.span, factor);
        Self { rows: whole(&area.rows), columns: whole(&area.columns), low, high }
    }

    /// The ends of disparities of a copy, extended by half a pixel of it on either side.
    fn ends((low, high): Span, factor: usize) -> (f64, f64) {
        ((low as f64 - 0.5) * factor as f64, (high as f64 + 0.5) * factor as f64)
    }
}

/// Whether both images are the same up to noise and light: nowhere do they differ as if one were shifted.
///
/// ```text
/// curve  = the cubic polynomial with the least sum of squares of curve(left) - right
/// shifts = in each of some tiles, the coefficients of curve(left) - right
///          on the slopes of curve(left) along both axes
/// ```
pub fn is_identical(copies: &Overview) -> bool {
    let [left, right] = &copies.planes;
    let left = &with_tone_of(left, right);
    let (rows, cols) = left.size();
    let tile = |at: usize, length: usize| at * (length - 2) / TILES + 1..(at + 1) * (length - 2) / TILES + 1;

    (0..TILES * TILES).all(|number| {
        let (mut by_along, mut by_down, mut rest) = (0.0f64, 0.0f64, 0.0f64);
        let (mut along, mut down) = (0.0f64, 0.0f64);
        for y in tile(number / TILES, rows) {
            let [above, here, below, there] = [left.row(y - 1), left.row(y), left.row(y + 1), right.row(y)];
            for x in tile(number % TILES, cols) {
                let difference = f64::from(here[x] - there[x]);
                let slope = f64::from(here[x + 1] - here[x - 1]) / 2.0;
                let descent = f64::from(below[x] - above[x]) / 2.0;

                by_along += difference * slope;
                along += slope * slope;
                by_down += difference * descent;
                down += descent * descent;
                rest += difference * difference;
            }
        }

        by_along.abs() <= SHIFT * along && by_down.abs() <= SHIFT * down && rest <= along + down
    })
}

/// The gray values of an image, mapped by the cubic curve that fits those of another image at the same place.
fn with_tone_of(image: &Plane<f32>, other: &Plane<f32>) -> Plane<f32> {
    let most = image.as_slice().iter().fold(f32::MIN_POSITIVE, |most, gray| most.max(gray.abs()));
    let terms = |gray: f32| {
        let t = f64::from(gray / most);
        [1.0, t, t * t, t * t * t]
    };
    let mut fit = Normal::<4>::new(4);
    for (gray, other) in image.as_slice().iter().zip(other.as_slice()) {
        fit.add(&terms(*gray), f64::from(*other), 1.0);
    }
    let Some(curve) = fit.solved() else { return image.clone() };
    image.map(|gray| terms(*gray).iter().zip(curve).map(|(term, factor)| term * factor).sum::<f64>() as f32)
}

/// The ends of the disparities of a run, without the few outermost ones.
pub fn ends(map: &RoughMap, run: Span) -> [f64; 2] {
    let (first, last) = (run.0 as f32 - 0.5, run.1 as f32 + 0.5);
    let mut values: Vec<f32> = known(&map.disparity).filter(|value| (first..=last).contains(value)).collect();
    let few = (FARTHEST * values.len() as f64) as usize;
    let others = values.len().saturating_sub(1 + few);
    match [few, others].map(|rank| ranked(&mut values, rank)) {
        [Some(low), Some(high)] => [low, high].map(f64::from),
        _ => [f64::from(first), f64::from(last)],
    }
}

impl Overview {
    /// Matches the reduced images, the right one resampled by the field. If the disparities are unknown, all
    /// are tried on still smaller copies, farther ones if these match badly or to their very end, and here
    /// only those found there, and some around them.
    pub fn rough(
        &self,
        candidates: Option<Candidates>,
        field: Option<&Alignment>,
        runtime: Runtime,
    ) -> Result<RoughMap> {
        if let Some(all) = candidates {
            return self.matched(self.span(all), field, ROUGH, runtime);
        }

        // Coarse to fine: a wide search on few pixels, then a narrow one on more.
        let coarse = self.reduced(COARSE_WIDTH, runtime)?;
        let mut map = coarse.matched(coarse.widest(), field, ROUGH, runtime)?;
        if map.confidence < GOOD_CONFIDENCE || coarse.is_cut_off(&map) {
            for span in coarse.farther() {
                let far = coarse.matched(span, field, ROUGH, runtime)?;
                if far.confidence > map.confidence.max(LEAST_CONFIDENCE) {
                    map = far;
                }
            }
        }
        // A quarter of the range on either side covers what the smaller copies miss.
        let (low, high) = map.run.unwrap_or_else(|| coarse.widest());
        let around = ((high - low) / 4).max(2);
        let finer = (coarse.factor / self.factor) as isize;
        self.matched(((low - around) * finer, (high + around + 1) * finer), field, ROUGH, runtime)
    }

    /// Whether the disparities of a map over the widest span end where the span does.
    fn is_cut_off(&self, map: &RoughMap) -> bool {
        let (lowest, highest) = self.widest();
        map.run.is_none_or(|(low, high)| low <= lowest || high >= highest)
    }
}

/// The first and the last disparity to search, with a margin around those from low to high.
///
/// A range on one side of zero stays there, and begins at zero unless that would more than double it.
/// Searching too much costs time but no accuracy; searching too little costs both.
fn with_margin(low: f64, high: f64, factor: f64) -> (i64, i64) {
    let margin = 1.0 + MARGIN * (high - low) + COARSE * factor;
    let start = (low - margin).floor() as i64;
    let end = (high + margin).ceil() as i64;
    let length = end - start;

    // Ends that are this far on one side of zero are not there by mistake. The candidate 0 stands for half a
    // pixel on either side: in a long range, an end no farther away is most often a mistake.
    let clear = if high - low > LONG { -0.5 } else { factor / 4.0 };
    if low + high > 0.0 {
        let start = if low >= clear && start <= length { 0 } else { start };
        (start, end)
    } else {
        let end = if high <= -clear && -end <= length { 0 } else { end };
        (start, end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn margins_stay_on_their_side_of_zero_unless_the_ends_do_not() {
        assert_eq!(with_margin(2.0, 52.0, 2.0), (0, 58));
        assert_eq!(with_margin(30.0, 60.0, 2.0), (0, 64));
        assert_eq!(with_margin(200.0, 250.0, 2.0), (194, 256));
        assert_eq!(with_margin(-52.0, -2.0, 2.0), (-58, 0));
        assert_eq!(with_margin(-20.0, 30.0, 2.0), (-26, 36));
        assert_eq!(with_margin(-0.4, 40.0, 2.0), (0, 45));
        assert_eq!(with_margin(-0.4, 6.0, 2.0), (-3, 8));
        assert_eq!(with_margin(-40.0, 0.4, 2.0), (-45, 0));
        assert_eq!(with_margin(-6.0, 0.4, 2.0), (-8, 3));
        assert_eq!(with_margin(0.0, 0.0, 2.0), (-2, 2));
    }
}
