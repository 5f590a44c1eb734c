//! Two images -> matching costs of each pixel of the left image with each of its candidates.
//!
//! Candidates are neighboring lanes. The right image is stored *unrolled*: every row reversed, and clamped at
//! both ends. The pixels that left column `x` is compared with under candidates 0, 1, 2, ... are then
//! neighboring values from place `cols - 1 - x` on. For any column, one unaligned load reads the pixels of
//! many candidates:
//!
//! ```text
//! for x in columns:
//!     for k in 0..candidates:                      # neighboring lanes
//!         cost[x][k] = distance(left[x], unrolled[cols - 1 - x + k])
//! ```
//!
//! Each way to compare pixels is a [`Cost`], in a file of its own; `settings/costs.rs` lists them.

pub mod aggregation;
mod differences;
pub mod normalized_sad;
pub mod phase;
pub mod sad;
pub mod unrolled;
pub mod validity;
pub mod volume;
pub mod zncc;

use std::ops::Range;
use std::slice::ChunksExactMut;

use crate::base::control::Control;
use crate::base::error::{Error, Result};
use crate::base::memory::RunMemory;
use crate::base::plane::Plane;
use crate::base::simd::{self, Level};
use crate::base::value::{LANES, Lanes, Value};
use crate::cost::phase::PhaseCodes;
use crate::cost::validity::Validity;
use crate::cost::volume::Volume;
use crate::image::view::View;
use crate::pair::blur_compensation::BlurCompensation;
use crate::pair::candidates::{Candidates, Searched};
use crate::pair::plan::{Bytes, Demand, Plan, Stage};
use crate::settings::costs::costs;
use crate::settings::{CostKind, Settings};

/// A way to compare two pixels: the data it keeps of them, and how it writes the costs of a row.
pub trait Cost: Sized {
    /// Steps of the cost per unit of the penalties.
    const STEPS: u16;

    /// The largest cost.
    fn ceiling(settings: &Settings) -> u16;

    /// Rows of an image on either side of a pixel that its cost depends on.
    fn reach(plan: Plan) -> usize;

    /// Memory of each pixel of the images.
    fn bytes(demand: &Demand) -> PixelBytes;

    /// The least mean cost of unrelated pixels; `None`: unknown.
    fn unrelated(_ceiling: u16) -> Option<f64> {
        None
    }

    /// Prepares the images of a pair.
    fn new(input: CostInput) -> Result<Self>;

    /// Writes the costs of up to `L` candidates into a line of each pixel. Values beyond the last one are
    /// undefined.
    fn write<V: Value, const L: usize>(&self, part: RowPart, out: &mut Lines<V, L>);

    /// The cost of a left pixel and the one at a place of the unrolled right image.
    fn between(&self, y: usize, x: usize, place: usize) -> u32;
}

/// A pair to compare: checked views and settings.
#[derive(Clone, Copy)]
pub struct CostInput<'a> {
    /// Left and right image.
    pub views: [&'a View; 2],
    /// The disparities to search.
    pub candidates: Candidates,
    /// The settings.
    pub settings: &'a Settings,
    /// The blur compensation.
    pub compensation: Option<&'a BlurCompensation>,
    /// Instructions to use.
    pub level: Level,
    /// Progress and cancellation.
    pub control: &'a Control,
}

/// A row, some of its columns, and the candidates to search.
pub type RowPart = (usize, Range<usize>, Searched);

/// Bytes that a cost uses for a pixel.
#[derive(Debug, Clone, Copy)]
pub struct PixelBytes {
    /// For its description, in one image.
    pub described: usize,
    /// Descriptions of the right image.
    pub versions: usize,
    /// Additional bytes while one image is described.
    pub passing: usize,
}

/// The matching costs of a pair, computed on demand from descriptions of its pixels.
pub struct Costs<'a> {
    compared: ComparedBy<'a>,
    candidates: Candidates,
    cols: usize,
    ceiling: u16,
    steps: u16,
    unrelated: Option<f64>,
    /// `None`: neither image has a mask.
    validity: Option<Validity>,
}

/// Chooses, from the table of costs, the one that the settings name.
macro_rules! dispatch {
    (
        $dollar:tt
        $(#[doc = $about:literal])+
        CostKind {
            $($(#[doc = $meaning:literal])+ $word:literal: $variant:ident in $module:ident,)+
        }
    ) => {
        /// The descriptions that pixels of a pair are compared by.
        enum ComparedBy<'a> {
            $($variant($module::$variant),)+
            Volume(Volume<'a>),
        }

        impl ComparedBy<'_> {
            fn new(input: CostInput) -> Result<Self> {
                Ok(match input.settings.cost {
                    $(CostKind::$variant => Self::$variant(Cost::new(input)?),)+
                })
            }

            #[inline(always)]
            fn write<V: Value, const L: usize>(&self, part: RowPart, out: &mut Lines<V, L>) {
                match self {
                    $(Self::$variant(cost) => cost.write(part, out),)+
                    Self::Volume(volume) => volume.write(part, out),
                }
            }

            fn between(&self, y: usize, x: usize, place: usize) -> Option<u32> {
                match self {
                    $(Self::$variant(cost) => Some(cost.between(y, x, place)),)+
                    Self::Volume(volume) => volume.between(y, x, place),
                }
            }
        }

        /// Evaluates an expression with a name for the type of a cost.
        macro_rules! with_cost {
            ($dollar settings:expr, $dollar cost:ident => $dollar result:expr) => {
                match $dollar settings.cost {
                    $(CostKind::$variant => {
                        type $dollar cost = $module::$variant;
                        $dollar result
                    })+
                }
            };
        }
    };
}

costs!(dispatch $);

/// Steps of the cost per unit of the penalties.
pub fn steps_of(settings: &Settings) -> u16 {
    with_cost!(settings, C => C::STEPS)
}

/// The largest cost of a pixel.
pub fn ceiling_of(settings: &Settings) -> u16 {
    with_cost!(settings, C => C::ceiling(settings))
}

/// The description of the pixels of both images, at the same time.
pub struct Description;

impl Stage for Description {
    fn reach(&self, plan: Plan) -> usize {
        with_cost!(plan.settings, C => C::reach(plan))
    }

    fn bytes(&self, demand: &Demand) -> Bytes {
        let PixelBytes { passing, .. } = with_cost!(demand.plan.settings, C => C::bytes(demand));
        let passing = passing * demand.cols * demand.threads.min(2);
        let kept = Descriptions.bytes(demand).read;
        Bytes { read: kept + passing, ..Bytes::default() }
    }
}

/// The descriptions, from which costs are computed.
pub struct Descriptions;

impl Stage for Descriptions {
    fn bytes(&self, demand: &Demand) -> Bytes {
        let PixelBytes { described, versions, .. } = with_cost!(demand.plan.settings, C => C::bytes(demand));
        // The right image is kept unrolled: each row has one more clamped column per candidate.
        let unrolled = demand.cols + demand.candidates.next_multiple_of(LANES);
        let valid = demand.cols + unrolled;
        let read = described * (demand.cols + versions * unrolled) + valid;
        Bytes { read, ..Bytes::default() }
    }
}

/// Values of neighboring pixels, writable: `L` lanes of each pixel from `first` on, out of its `stride`
/// lanes.
pub struct Lines<'a, V, const L: usize> {
    /// All lanes of the pixels.
    pub values: &'a mut [V],
    /// The first lane of a line.
    pub first: usize,
    /// Lanes of a pixel.
    pub stride: usize,
}

impl<V, const L: usize> Lines<'_, V, L> {
    /// Pixels.
    #[inline(always)]
    pub fn count(&self) -> usize {
        self.values.len() / self.stride
    }

    /// The line of one pixel.
    #[inline(always)]
    pub fn line(&mut self, pixel: usize) -> &mut [V; L] {
        line(&mut self.values[pixel * self.stride..], self.first)
    }

    /// All lanes of each pixel, and the first lane of a line: see [`line()`].
    #[inline(always)]
    pub fn pixels(&mut self) -> (ChunksExactMut<'_, V>, usize) {
        (self.values.chunks_exact_mut(self.stride), self.first)
    }

    /// The lines of `count` pixels from index `start` on.
    #[inline(always)]
    pub fn part(&mut self, start: usize, count: usize) -> Lines<'_, V, L> {
        let values = &mut self.values[start * self.stride..][..count * self.stride];
        Lines { values, ..*self }
    }
}

/// The line of a pixel that begins with lane `first`. It is a function, since a closure in an iterator might
/// not be inlined.
#[inline(always)]
pub fn line<V, const L: usize>(pixel: &mut [V], first: usize) -> &mut [V; L] {
    &mut pixel[first..].as_chunks_mut().0[0]
}

impl<'a> Costs<'a> {
    /// The costs that the settings name, for checked views and settings. Only phase costs accept kernels.
    pub fn new(
        views: [&'a View; 2],
        candidates: Candidates,
        settings: &Settings,
        compensation: Option<&BlurCompensation>,
        level: Level,
        control: &Control,
    ) -> Result<Self> {
        if !settings.compares_codes() && compensation.is_some_and(BlurCompensation::has_kernels) {
            return Err(Error::value("blur_compensation", "kernels for another cost", "cost='phase'"));
        }

        let input = CostInput { views, candidates, settings, compensation, level, control };
        let compared = ComparedBy::new(input)?;

        let (_, cols) = views[0].size();
        let ceiling = ceiling_of(settings);
        let validity = Validity::new(views, candidates)?;
        let (steps, unrelated) = (steps_of(settings), with_cost!(settings, C => C::unrelated(ceiling)));

        Ok(Self { compared, candidates, cols, ceiling, steps, unrelated, validity })
    }

    /// Costs given by the caller: rows of `columns x candidates`.
    pub fn of_volume(volume: &'a Plane<u16>, candidates: Candidates) -> Self {
        let volume = Volume::new(volume, candidates.count());
        Self {
            cols: volume.cols(),
            compared: ComparedBy::Volume(volume),
            candidates,
            ceiling: u16::MAX,
            steps: 1,
            unrelated: None,
            validity: None,
        }
    }

    /// The whole volume at once, for inspection and tests: rows of `columns x candidates`.
    pub fn volume(&self, rows: usize, level: Level, control: &Control) -> Result<Plane<u16>> {
        let count = self.candidates.count();
        let padded = self.runs() * LANES;

        Plane::by_bands((rows, self.cols * count), 1, |y, volume| {
            control.checkpoint()?;
            let mut costs = RunMemory::default();
            costs.resize(self.cols * self.runs())?;
            level.run(WriteRow { costs: self, y, out: &mut costs });

            for (volume, costs) in
                volume.chunks_exact_mut(count).zip(costs.as_flattened().chunks_exact(padded))
            {
                volume.copy_from_slice(&costs[..count]);
            }

            Ok(())
        })
    }

    /// All candidates.
    pub fn searched(&self) -> Searched {
        Searched::all(self.candidates.count())
    }

    /// Runs of [`LANES`] candidates of a pixel, the last one padded.
    pub fn runs(&self) -> usize {
        self.searched().runs()
    }

    /// The codes whose Hamming distances are the costs; `None`: other costs, or an image has a mask.
    pub fn codes(&self) -> Option<PhaseCodes<'_>> {
        match &self.compared {
            ComparedBy::Phase(phase) if !self.has_masks() => Some(phase.codes()),
            _ => None,
        }
    }

    /// Whether either image has a mask.
    pub fn has_masks(&self) -> bool {
        self.validity.is_some()
    }

    /// The valid pairs of pixel and candidate; `None`: all.
    pub fn validity(&self) -> Option<&Validity> {
        self.validity.as_ref()
    }

    /// The disparities to search.
    pub fn candidates(&self) -> Candidates {
        self.candidates
    }

    /// The largest possible cost.
    pub fn ceiling(&self) -> u16 {
        self.ceiling
    }

    /// The least mean cost of unrelated pixels; `None`: unknown.
    pub fn unrelated(&self) -> Option<f64> {
        self.unrelated
    }

    /// Steps of the cost per unit of the penalties.
    pub fn steps(&self) -> u16 {
        self.steps
    }

    /// Writes the costs of some columns of row `y`, the searched candidates of one column after another; 0
    /// where either pixel is invalid. Values beyond the last candidate are undefined.
    #[inline(always)]
    pub fn write<V: Value>(&self, y: usize, columns: Range<usize>, searched: Searched, out: &mut [Lanes<V>]) {
        let (values, stride) = (out.as_flattened_mut(), searched.runs() * LANES);

        for first in (0..stride).step_by(LANES) {
            let part = (y, columns.clone(), searched.part(first, LANES));
            let mut lines = Lines::<V, LANES> { values, first, stride };
            self.write_lines(part.clone(), &mut lines);
            self.mask(part, &mut lines);
        }
    }

    /// Writes the costs of up to `L` candidates into a line of each pixel, ignoring masks.
    #[inline(always)]
    pub fn write_lines<V: Value, const L: usize>(&self, part: RowPart, out: &mut Lines<V, L>) {
        self.compared.write(part, out);
    }

    /// Sets the costs of invalid pairs to 0: they add nothing to sums, which aggregation scales by the number
    /// of valid ones.
    #[inline(always)]
    pub fn mask<V: Value, const L: usize>(&self, part: RowPart, out: &mut Lines<V, L>) {
        if let Some(validity) = &self.validity {
            validity.mask(part, out);
        }
    }

    /// Writes 1 where a pixel in some columns of row `y` and its candidate are both valid, else 0. Without
    /// masks it writes nothing.
    #[inline(always)]
    pub fn write_validity<V: Value, const L: usize>(&self, part: RowPart, out: &mut Lines<V, L>) {
        if let Some(validity) = &self.validity {
            validity.write(part, out);
        }
    }

    /// The cost of a left pixel and the pixel of any right column; `None` if either is invalid. Disparity 0
    /// must be the smallest candidate: then every right column is unrolled.
    pub fn between(&self, y: usize, x: usize, column: usize) -> Option<u32> {
        debug_assert!(self.candidates.min() == 0 && column < self.cols);
        let place = self.cols - 1 - column;
        let is_valid = self.validity.as_ref().is_none_or(|validity| validity.are_valid(y, x, place));
        if is_valid { self.compared.between(y, x, place) } else { None }
    }
}

/// Writes all costs of a row.
struct WriteRow<'a> {
    costs: &'a Costs<'a>,
    y: usize,
    out: &'a mut [Lanes<u16>],
}

impl simd::Loop for WriteRow<'_> {
    type Output = ();
    const COUNTS_BITS: bool = true;

    #[inline(always)]
    fn run(self) {
        self.costs.write(self.y, 0..self.costs.cols, self.costs.searched(), self.out);
    }
}

/// Sets all lanes to a value.
#[inline(always)]
pub fn fill<V: Value, const L: usize>(out: &mut Lines<V, L>, value: V) {
    for pixel in 0..out.count() {
        *out.line(pixel) = [value; L];
    }
}
