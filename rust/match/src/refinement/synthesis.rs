//! Analysis by synthesis: if one image is blurred, finds the disparities near jumps that explain it best.
//!
//! Under a blur, the costs only show that a jump is somewhere within the kernel, and windows draw it to the
//! wider side: near surfaces come out too large. But given a map, the soft (blurred) image can be synthesized
//! from the sharp one and the estimated kernel. Where the jumps are wrong, the synthetic image differs from
//! the soft one.
//!
//! ```text
//! for map in the current one, the same eroded, the same dilated by SYNTHESIS_RADIUS:
//!     shown     = the part of the sharp image that each pixel of the soft view shows, by the map
//!     synthetic = shown under the kernel of its area
//!     distance  = Hamming distance of the codes of the synthetic and of the soft image
//!     unlike    = sum of distance over the window of SYNTHESIS_WINDOW pixels around
//! each pixel takes the disparity of the map with the smallest unlike
//! ```
//!
//! If the left image is soft, everything happens in its view. If the right image is soft, the map is first
//! warped there, with nearer disparities first. The sums are then read at the places of a left pixel under
//! the smallest and the largest of its disparities, so that all maps are judged at the same places.
//!
//! Only codes are compared, so neither contrast nor offset matters. Views are rounded to integers, and
//! everything is computed by bands of rows.

mod view;

use std::array::from_fn;
use std::ops::Range;

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::{Plane, parts, widened, zeroed};
use crate::base::simd::{Level, leveled};
use crate::choices::{SAME_DISPARITY, SYNTHESIS_RADIUS, SYNTHESIS_WINDOW};
use crate::image::convolution::Kernel as Blur;
use crate::image::intensity::Gray;
use crate::image::view::View;
use crate::pair::blur_compensation::{self, BlurCompensation};
use crate::pair::plan::{Bytes, Demand, Plan, Stage};
use crate::refinement::median::{NONE, disparity as disparity_of, key};
use crate::settings::Settings;

/// Rows of a band: its halo, as far as windows and kernels reach, is computed again.
const BAND: usize = 128;
/// Pixels that a window reaches in each direction.
const REACH: usize = SYNTHESIS_WINDOW / 2;
/// Columns whose extremes are found at a time.
const LANES: usize = 32;

/// A pair with the blur of its areas, and the rows that a map covers.
#[derive(Debug)]
pub struct BlurredPair<'a> {
    views: [&'a View; 2],
    compensation: &'a BlurCompensation,
    settings: &'a Settings,
    /// The rows of the pair that the map covers.
    rows: Range<usize>,
    /// The scale of the gray values of both images.
    scales: [Gray<'a>; 2],
    /// Gray values of these rows of both images.
    grays: [Plane<i32>; 2],
}

/// The side of the image that is soft, if only one is (0: left, 1: right), and its blur relative to the
/// other.
///
/// `kernels` blur the two sides to make them alike, so the soft side is the one without a kernel.
pub fn softness(kernels: &[Option<Blur>; 2]) -> Option<(usize, &Blur)> {
    match kernels {
        [None, Some(blur)] => Some((0, blur)),
        [Some(blur), None] => Some((1, blur)),
        _ => None,
    }
}

/// Whether the settings ask for synthesis, and any area of the pair needs it.
pub fn is_asked_for(settings: &Settings, compensation: Option<&BlurCompensation>) -> bool {
    let is_soft =
        |compensation: &BlurCompensation| compensation.classes().any(|kernels| softness(kernels).is_some());

    settings.synthesis && settings.compares_codes() && compensation.is_some_and(is_soft)
}

/// Bytes kept per pixel of both images to synthesize one of them, with the intermediate images.
const KEPT_BYTES: usize = 28;
/// Most bytes of a pixel of a band: for its maps, and for gray values, codes and sums of both views.
const BAND_BYTES: usize = 64;

/// Analysis by synthesis.
pub struct Synthesis;

impl Stage for Synthesis {
    fn reach(&self, Plan { settings, compensation, .. }: Plan) -> usize {
        let asked = compensation.filter(|_| is_asked_for(settings, compensation));
        asked.map_or(0, |compensation| SYNTHESIS_RADIUS + around(settings, compensation)[0])
    }

    fn bytes(&self, Demand { plan: Plan { settings, compensation, .. }, cols, .. }: &Demand) -> Bytes {
        let asked = compensation.filter(|_| is_asked_for(settings, *compensation));
        asked.map_or(Bytes::default(), |compensation| {
            let [above, beside] = around(settings, compensation);
            let thread = (BAND + 2 * above) * (cols + 2 * beside) * BAND_BYTES;
            Bytes { read: KEPT_BYTES * cols, mapped: 0, thread }
        })
    }
}

/// Rows and columns on either side of a pixel that its window reaches, with the codes there and the kernels
/// under these.
fn around(settings: &Settings, compensation: &BlurCompensation) -> [usize; 2] {
    let radii = compensation.every_kernel().map(Blur::radii);
    let largest = radii.fold((0, 0), |most, radii| (most.0.max(radii.0), most.1.max(radii.1)));

    [largest.0, largest.1].map(|radius| REACH + settings.largest_neighborhood() / 2 + radius)
}

impl<'a> BlurredPair<'a> {
    /// The pair for some rows of a map, if there is anything to synthesize.
    pub fn new(
        views: [&'a View; 2],
        compensation: Option<&'a BlurCompensation>,
        rows: Range<usize>,
        settings: &'a Settings,
        level: Level,
        control: &Control,
    ) -> Result<Option<Self>> {
        let Some(compensation) =
            compensation.filter(|compensation| is_asked_for(settings, Some(compensation)))
        else {
            return Ok(None);
        };

        let scale = |side| blur_compensation::gray(views[side], Some(compensation), side, level, control);
        let scales = [scale(0)?, scale(1)?];

        let grays = scales.each_ref().map(|gray| gray.plane().copy_of_rows(rows.clone()));

        Ok(Some(Self { views, compensation, settings, rows, scales, grays }))
    }

    /// The map with the disparities that explain the soft image best.
    pub fn redraw(
        &self,
        disparity: &Plane<f32>,
        redrawn: &mut Plane<f32>,
        level: Level,
        control: &Control,
    ) -> Result<()> {
        let cols = disparity.cols();
        redrawn.write_bands(BAND, |first, out| {
            control.checkpoint()?;
            out.copy_from_slice(&disparity.as_slice()[first * cols..][..out.len()]);

            let rows = first..first + out.len() / cols;
            let band = RivalMaps::new(self, disparity, rows, level, control)?;
            band.groups()?.into_iter().try_for_each(|group| band.writer(&group, out))
        })
    }

    /// The validity of row `y` of the map, on one side; `None`: all valid.
    fn valid(&self, side: usize, y: usize) -> Option<&[bool]> {
        self.views[side].mask().map(|mask| mask.row(self.rows.start + y))
    }

    /// The gray values of a rectangle, on one side.
    fn part(&self, side: usize, rows: &Range<usize>, columns: &Range<usize>) -> Result<Plane<i32>> {
        let mut part = Plane::new(rows.len(), columns.len())?;

        for (row, y) in rows.clone().enumerate() {
            part.row_mut(row).copy_from_slice(&self.grays[side].row(y)[columns.clone()]);
        }
        Ok(part)
    }
}

/// The maps that are compared, for a band of rows.
struct RivalMaps<'a> {
    pair: &'a BlurredPair<'a>,
    level: Level,
    control: &'a Control,
    /// The rows of the band.
    rows: Range<usize>,
    /// The rows that they depend on.
    seen: Range<usize>,
    /// The current map, eroded and dilated, of these rows.
    maps: [Plane<f32>; MAPS],
    /// The columns in which the maps of the band differ.
    columns: Range<usize>,
}

/// The current map, the eroded and the dilated one.
const MAPS: usize = 3;

/// Classes of pixels that are judged in one view.
struct ClassGroup<'a> {
    /// The soft side.
    side: usize,
    /// Class and kernel of each.
    blurs: Vec<(usize, &'a Blur)>,
}

impl<'a> RivalMaps<'a> {
    fn new(
        pair: &'a BlurredPair<'a>,
        disparity: &Plane<f32>,
        rows: Range<usize>,
        level: Level,
        control: &'a Control,
    ) -> Result<Self> {
        let by = around(pair.settings, pair.compensation)[0];
        let seen = widened(&rows, by, disparity.rows());

        let maps = rivals(disparity, &seen, level)?;
        let columns = differing(&maps, rows.start - seen.start..rows.end - seen.start);
        Ok(Self { pair, level, control, rows, seen, maps, columns })
    }

    /// The groups to judge: all classes with a soft left image together, since they share a view; otherwise
    /// each class by itself.
    fn groups(&self) -> Result<Vec<ClassGroup<'a>>> {
        if self.columns.is_empty() {
            return Ok(vec![]);
        }

        let mut left = vec![];
        let mut groups = vec![];
        for class in self.classes()? {
            match softness(self.pair.compensation.kernels(class)) {
                Some((0, blur)) => left.push((class, blur)),
                Some((side, blur)) => groups.push(ClassGroup { side, blurs: vec![(class, blur)] }),
                None => {}
            }
        }

        if !left.is_empty() {
            groups.push(ClassGroup { side: 0, blurs: left });
        }

        Ok(groups)
    }

    /// The classes that occur in the windows of the band.
    fn classes(&self) -> Result<Vec<usize>> {
        let mut classes = vec![];
        let mut labels = zeroed(self.columns.len())?;

        for y in self.within(REACH) {
            self.labels(y, self.columns.clone(), &mut labels);
            for &class in &labels {
                if !classes.contains(&usize::from(class)) {
                    classes.push(class.into());
                }
            }
        }

        classes.sort_unstable();
        Ok(classes)
    }

    /// The classes of some columns of a row.
    fn labels(&self, y: usize, columns: Range<usize>, labels: &mut [u8]) {
        self.pair.compensation.write_classes(self.pair.rows.start + y, columns.start, labels);
    }

    /// The rows of the band and `by` rows on either side, within the rows that they depend on.
    fn within(&self, by: usize) -> Range<usize> {
        widened(&self.rows, by, self.seen.end)
    }

    /// Replaces disparities of a group's pixels by those of the map that explains them best.
    fn writer(&self, group: &ClassGroup, out: &mut [f32]) -> Result<()> {
        let cols = self.maps[0].cols();
        let view = view::SoftView::new(self, group)?;
        let mut best = view.unlike(0)?;
        let mut labels = zeroed(self.columns.len())?;
        let mut judged = zeroed(self.columns.len())?;

        for map in 1..MAPS {
            let sums = view.unlike(map)?;
            for (row, y) in self.rows.clone().enumerate() {
                self.labels(y, self.columns.clone(), &mut labels);
                mark_classes(self.level, &labels, &group.blurs, &mut judged);

                take_better(
                    self.level,
                    sums.row(row),
                    &judged,
                    &self.maps[map].row(y - self.seen.start)[self.columns.clone()],
                    best.row_mut(row),
                    &mut out[row * cols..][self.columns.clone()],
                );
            }
        }

        Ok(())
    }
}

/// Rows of a map, and of the same map eroded and dilated, where disparities that count as the same stay
/// exactly the same.
fn rivals(disparity: &Plane<f32>, rows: &Range<usize>, level: Level) -> Result<[Plane<f32>; MAPS]> {
    let cols = disparity.cols();
    let new = || Plane::<f32>::new(rows.len(), cols);
    let [mut own, mut eroded, mut dilated] = [new()?, new()?, new()?];

    let mut columns = [zeroed(cols)?, zeroed(cols)?];

    // Extremes over a square: down the columns first, then along the row.
    for (row, y) in rows.clone().enumerate() {
        own.row_mut(row).copy_from_slice(disparity.row(y));

        let around = from_fn(|k| disparity.row_or_nothing((y + k) as isize - SYNTHESIS_RADIUS as isize));
        let [least, largest] = &mut columns;
        column_extremes(level, around, least, largest);

        let (eroded, dilated) = (eroded.row_mut(row), dilated.row_mut(row));
        erode_and_dilate(level, least, largest, disparity.row(y), eroded, dilated);
    }

    Ok([own, eroded, dilated])
}

/// Rows of the square around a pixel.
const SIDE: usize = 2 * SYNTHESIS_RADIUS + 1;

/// Finds the extremes of each column of some rows, as keys; rows beyond the image are empty.
#[leveled]
fn column_extremes(level: Level, rows: [&[f32]; SIDE], least: &mut [i32], largest: &mut [i32]) {
    let n = least.len();
    let largest = &mut largest[..n];
    least.fill(i32::MAX);
    largest.fill(NONE);

    for row in rows.into_iter().filter(|row| !row.is_empty()) {
        let row = &row[..n];
        for x in 0..n {
            let key = key(row[x]);

            // The key of a missing disparity is the smallest, so only the minimum has to exclude it.
            least[x] = least[x].min(if key == NONE { i32::MAX } else { key });
            largest[x] = largest[x].max(key);
        }
    }
}

/// Writes one row of the eroded and the dilated map, from the extremes of its columns.
#[leveled]
fn erode_and_dilate(
    level: Level,
    least: &[i32],
    largest: &[i32],
    own: &[f32],
    eroded: &mut [f32],
    dilated: &mut [f32],
) {
    let mut buffer = [[0; SPAN]; 2];

    let outs = eroded.chunks_mut(LANES).zip(dilated.chunks_mut(LANES));
    for (index, (eroded, dilated)) in outs.enumerate() {
        let x = index * LANES;
        let count = eroded.len();
        let first = x as isize - SYNTHESIS_RADIUS as isize;
        let near = |row: &[i32], x: isize| row[x.clamp(0, row.len() as isize - 1) as usize];
        let [low, high] = parts([least, largest], first, &mut buffer, near);
        let (low, high) = (&low[..SPAN], &high[..SPAN]);

        let mut least = [i32::MAX; LANES];
        let mut largest = [NONE; LANES];
        for away in 0..SIDE {
            let (low, high) = (&low[away..][..LANES], &high[away..][..LANES]);
            for j in 0..LANES {
                least[j] = least[j].min(low[j]);
                largest[j] = largest[j].max(high[j]);
            }
        }

        let mut here = [f32::NAN; LANES];
        here[..count].copy_from_slice(&own[x..][..count]);

        let mut down = [0.0; LANES];
        let mut up = [0.0; LANES];
        for j in 0..LANES {
            down[j] = unless_same(disparity_of(least[j]), here[j]);
            up[j] = unless_same(disparity_of(largest[j]), here[j]);
        }

        eroded.copy_from_slice(&down[..count]);
        dilated.copy_from_slice(&up[..count]);
    }
}

/// Columns that the squares of [`LANES`] pixels reach.
const SPAN: usize = LANES + 2 * SYNTHESIS_RADIUS;

/// A disparity, or the pixel's own if there is no other or it counts as the same.
#[inline(always)]
fn unless_same(disparity: f32, own: f32) -> f32 {
    if (disparity - own).abs() > SAME_DISPARITY { disparity } else { own }
}

/// The columns, from the first to the last, in which the maps differ in any of these rows.
fn differing([own, eroded, dilated]: &[Plane<f32>; MAPS], rows: Range<usize>) -> Range<usize> {
    let mut first = usize::MAX;
    let mut end = 0;

    for y in rows {
        let (own, eroded, dilated) = (own.row(y), eroded.row(y), dilated.row(y));
        // NaN differs from nothing: all maps have it.
        let differs = |x: &usize| eroded[*x] < own[*x] || dilated[*x] > own[*x];

        // Only columns outside the range so far can widen it.
        let before = first.min(own.len());
        first = first.min((0..before).find(differs).unwrap_or(first));
        end = end.max((end..own.len()).rev().find(differs).map_or(end, |x| x + 1));
    }

    first.min(end)..end
}

/// Marks, with nonzero bytes, the pixels of a row that belong to the classes of a group.
#[leveled]
fn mark_classes(level: Level, labels: &[u8], blurs: &[(usize, &Blur)], out: &mut [u8]) {
    out.fill(0);
    for (class, _) in blurs {
        for (out, label) in out.iter_mut().zip(labels) {
            *out |= u8::from(usize::from(*label) == *class);
        }
    }
}

/// Takes the disparities of a map where their sums are below the best ones so far.
#[leveled]
fn take_better(
    level: Level,
    sums: &[u16],
    judged: &[u8],
    disparity: &[f32],
    best: &mut [u16],
    out: &mut [f32],
) {
    let n = out.len();
    let (sums, judged, disparity) = (&sums[..n], &judged[..n], &disparity[..n]);
    let best = &mut best[..n];
    let out = &mut out[..n];

    for x in 0..n {
        let is_better = (sums[x] < best[x]) & (judged[x] != 0);
        out[x] = if is_better { disparity[x] } else { out[x] };
        best[x] = if is_better { sums[x] } else { best[x] };
    }
}
