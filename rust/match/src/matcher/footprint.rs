//! The memory model: an upper bound of the bytes that a match takes, by which out-of-core matching plans its bands.
//!
//! Buffers that grow with the rows are counted by the pixel: the images, as read and as kept, with masks; codes; gray
//! values; the map. The others are the [`Workspace`](crate::optimization::Workspace) of each thread.
//! Measured, a match takes 67 to 99 % of this bound, with synthesis 39 %, as `tests/rust/footprint.rs` has it for each kind.

use crate::base::value::LANES;
use crate::cost::aggregation::Window;
use crate::image::intensity::{LEVEL_CEILING, LEVEL_STEPS};
use crate::image::normalization::{DEVIATION_CEILING, DEVIATION_STEPS};
use crate::image::texture::Texture;
use crate::matcher::Width;
use crate::matcher::halo::Halo;
use crate::optimization::{
    BAND, LOOKAHEAD_COLUMNS, LOOKAHEAD_ROWS, ORDERED_ROWS, PANEL, Penalties, STRIDE, STRIP,
    band_height,
};
use crate::pair::alignment::Alignment;
use crate::pair::blur_compensation::BlurCompensation;
use crate::refinement::synthesis;
use crate::settings::{CostKind, Optimizer, Settings};

/// Most channels of an image.
const CHANNELS: usize = 3;
/// Bytes of a pixel of the evidence: chosen candidate, two costs, offset.
const FOUND: usize = 14;
/// Bytes of a pixel of the map: disparity, flags, support.
const MAP: usize = 10;
/// Bytes of a pixel of the map while it is refined, with the copies of the stages: without and with gray values.
const REFINED: [usize; 2] = [24, 44];
/// Bytes of a pixel of gray values, with the intermediate images.
const GRAY: usize = 16;
/// Bytes of a pixel of the gray values and jumps that are kept.
const TEXTURE: usize = 5;
/// Bytes of a pixel of both images that is kept to synthesize one of them, with the intermediate images.
const SYNTHESIZED: usize = 28;

/// The match whose memory is estimated.
#[derive(Debug, Clone, Copy)]
pub struct Demand<'a> {
    /// Checked settings.
    pub settings: &'a Settings,
    /// How blur is compensated for before pixels are compared.
    pub compensation: Option<&'a BlurCompensation>,
    /// The field by which the right image is straightened.
    pub alignment: Option<&'a Alignment>,
    /// Columns of the images.
    pub cols: usize,
    /// Disparities that are searched.
    pub candidates: usize,
    /// Bytes of a pixel of one image, all channels together.
    pub pixel: usize,
    /// Threads.
    pub threads: usize,
}

/// A product that may be larger than memory.
fn times(count: usize, bytes: usize) -> u128 {
    count as u128 * bytes as u128
}

impl Demand<'_> {
    /// The bytes that a match of so many rows takes, with the rows of its halo; `u64::MAX` where these are more.
    pub fn bytes(&self, rows: usize) -> u64 {
        let halo = Halo::new(self.settings, self.compensation, self.alignment);
        let read = rows + 2 * (halo.rows() + halo.masked);
        let mapped = rows + 2 * halo.map;

        // Of each row that is read: both images and their masks, twice; the right one once more, or twice, if it is
        // straightened.
        let copies = if self.alignment.is_some() { 6 } else { 4 };
        let images = self.cols * copies * (self.pixel + 1);

        let (kept, passing) = self.compared();
        // Both images are described at the same time.
        let passing = passing * self.threads.min(2);
        let texture = TEXTURE * self.cols;
        let synthesized = if self.synthesizes() { SYNTHESIZED * self.cols } else { 0 };
        let refined = REFINED[usize::from(Texture::is_needed(self.settings))] * self.cols;

        // The three stages follow one another, so the largest one counts.
        let stages =
            [(kept + passing, 0), (kept + texture, MAP * self.cols), (synthesized, refined)];
        let stage = |(of_read, of_map)| times(read, images + of_read) + times(mapped, of_map);
        let pixels = stages.map(stage).into_iter().max().unwrap_or_default();

        let bytes = pixels + times(self.threads, self.workspace() + self.view());
        u64::try_from(bytes).unwrap_or(u64::MAX)
    }

    /// Bytes of a row of the descriptors of both images: of those that are kept, and of intermediate ones.
    fn compared(&self) -> (usize, usize) {
        // The right image is kept unrolled: each row has one more clamped column per candidate.
        let unrolled = self.cols + self.candidates.next_multiple_of(LANES);
        let valid = self.cols + unrolled;
        let channels = self.pixel.min(CHANNELS);

        let (bytes, right, passing) = match self.settings.cost {
            CostKind::Phase => {
                let length = self.settings.code_length();
                // The right image is described once as it is, and at most once more for each kernel.
                let right = 1 + self.compensation.map_or(0, |all| all.every_kernel().count());
                let bytes = length.div_ceil(8);
                // Of the left image, the codes of one version are kept beside those of another.
                (bytes, right, bytes + GRAY)
            }
            CostKind::Sad => (2 * channels, 1, 4 * channels),
            CostKind::NormalizedSad => (2 * channels, 1, 6 * channels + 8),
        };

        (bytes * (self.cols + right * unrolled) + valid, passing * self.cols)
    }

    fn synthesizes(&self) -> bool {
        synthesis::is_asked_for(self.settings, self.compensation)
    }

    /// Bytes that one thread synthesizes in.
    fn view(&self) -> usize {
        let compensation = self.compensation.filter(|_| self.synthesizes());
        compensation
            .map_or(0, |compensation| synthesis::memory(self.settings, compensation, self.cols))
    }

    /// Bytes that one thread searches in.
    pub fn workspace(&self) -> usize {
        let (window, penalties) = self.window();
        let runs = self.candidates.div_ceil(LANES);

        // Rows and columns of the costs, and totals of paths: half their sums, those from below and from the left.
        let seen = PANEL + LOOKAHEAD_COLUMNS;
        let places = |cols: usize| cols.div_ceil(STRIP) * STRIDE;
        // The bands of low images are no higher.
        let band = band_height(self.settings.optimizer, self.candidates, usize::MAX);
        let (rows, cols, totals) = match self.settings.optimizer {
            Optimizer::SemiGlobal => {
                (BAND + 2 * LOOKAHEAD_ROWS, seen, (BAND * (1 + places(PANEL) + STRIP)) * runs)
            }
            Optimizer::ScanlineOptimization => (band, seen, band * (1 + places(PANEL)) * runs),
            Optimizer::WinnerTakesAll => (BAND, PANEL, 0),
            // Works on whole rows, the other optimizers on panels of columns.
            Optimizer::DynamicProgramming => (ORDERED_ROWS, self.cols, 0),
        };

        let is_whole = self.settings.optimizer == Optimizer::DynamicProgramming;
        let around = seen + 2 * window.halo();

        // Of a line of candidates: costs and votes of the rows of a window and of the one that has left it, their sums, and
        // sums of windows.
        let summed = 2 * (window.side + 2) * around + (window.side + 1) * around;

        // The paths themselves, along rows and along columns, at two pixels each, and the sums of a row.
        let paths = 2 * 2 * STRIP * (runs + 2) + STRIP * runs;

        let lanes = rows * places(cols) * runs + totals + paths + 2 * summed;

        let width = Width::new(self.settings, window, penalties, true).bytes();
        // How the totals of all rows came about, and the totals of a pixel.
        let origins = ORDERED_ROWS * (self.cols * self.candidates + 8 * (self.candidates + 1));
        let origins = if is_whole { origins } else { 0 };

        width * LANES * lanes + origins + BAND * self.cols * FOUND
    }

    /// The window whose costs are summed, and the penalties against its sums.
    fn window(&self) -> (Window, Penalties) {
        let channels = self.pixel.min(CHANNELS) as u16;
        let (ceiling, steps) = match self.settings.cost {
            CostKind::Phase => (self.settings.code_length() as u16, 1),
            CostKind::Sad => (LEVEL_CEILING * channels, LEVEL_STEPS),
            CostKind::NormalizedSad => (DEVIATION_CEILING * channels, DEVIATION_STEPS),
        };

        let window = Window::new((BAND, self.cols), self.candidates, self.settings, ceiling);
        (window, Penalties::new(self.settings, window, steps))
    }
}
