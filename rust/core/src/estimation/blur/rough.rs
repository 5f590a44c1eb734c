//! Rough matches: gray values of both images, disparities of reduced copies, and pairs of corresponding
//! blocks.

use std::ops::Range;

use super::bins::SIDE;
use super::spectrum::BlockPlace;
use phasestereo_match::base::control::Control;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::base::simd::{Level, leveled};
use phasestereo_match::base::statistics::median;
use phasestereo_match::base::value::nearest;
use phasestereo_match::descriptor::basis::ROUGH_REACH;
use phasestereo_match::image::conversion::view_of_plane;
use phasestereo_match::image::intensity::Gray;
use phasestereo_match::image::intensity_range::IntensityRange;
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::matcher::section::Section;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::presets::Preset;
use phasestereo_match::settings::{Optimizer, Precision, Settings};

/// Gray values are within this distance of zero, whatever the type of the image.
const REACH: f64 = 128.0;
/// Side of the area around the center of a block whose median is the block's disparity, pixels.
const CORE: usize = SIDE / 2;
/// At most one pixel of a block in this many may be masked.
const MASKED_SHARE: usize = 10;
/// Steps per row to which the offsets of a reduced image are rounded.
const RAISED_STEPS: isize = 64;

/// Number of gray values per unit of the pixels of a view.
pub fn grays_per_unit(view: &View) -> f64 {
    view.scale().steps(1.0) * scale(view)
}

/// Gray values per step of a view.
fn scale(view: &View) -> f64 {
    REACH / f64::from(view.scale().reach())
}

/// The gray values of a view around the middle of its range, in one range for all types; masked pixels take
/// the values of valid neighbors.
pub fn grays(view: &View, control: &Control) -> Result<Plane<f32>> {
    let scale = scale(view) as f32;
    Plane::by_rows(view.size(), control, |y, row: &mut [f32]| {
        let steps = view.gray().row(y).iter();
        row.iter_mut().zip(steps).for_each(|(to, from)| *to = *from as f32 * scale);
    })
}

/// Whether the block with this corner has more than one gray value: blur leaves evidence only in contrast.
pub fn has_contrast(grays: &Plane<f32>, top: usize, left: usize) -> bool {
    let mut values = (top..top + SIDE).flat_map(|y| &grays.row(y)[left..left + SIDE]);
    let first = values.next().map(|value| value.to_bits());
    values.any(|value| Some(value.to_bits()) != first)
}

/// Means over squares of `factor` pixels, a power of two; incomplete squares at the far ends are left out.
pub fn reduced(plane: &Plane<f32>, factor: usize, runtime: Runtime) -> Result<Plane<f32>> {
    if factor == 1 {
        return Ok(plane.clone());
    }

    let size = (plane.rows() / factor, plane.cols() / factor);
    Plane::by_rows(size, runtime.control, |y, out: &mut [f32]| {
        reduce_row(runtime.level(), plane, factor, y, out);
    })
}

/// Writes a row of means over squares into zeros.
#[leveled]
fn reduce_row(level: Level, plane: &Plane<f32>, factor: usize, y: usize, out: &mut [f32]) {
    for row in y * factor..(y + 1) * factor {
        // Sums of a fixed number of pixels are vectorized.
        match factor {
            2 => add_sums::<2>(plane.row(row), out),
            4 => add_sums::<4>(plane.row(row), out),
            8 => add_sums::<8>(plane.row(row), out),
            _ => {
                for (sum, part) in out.iter_mut().zip(plane.row(row).chunks_exact(factor)) {
                    *sum += part.iter().sum::<f32>();
                }
            }
        }
    }

    let share = 1.0 / (factor * factor) as f32;
    for sum in out {
        *sum *= share;
    }
}

/// Adds the sum of every `FACTOR` pixels.
#[inline(always)]
fn add_sums<const FACTOR: usize>(row: &[f32], sums: &mut [f32]) {
    for (sum, part) in sums.iter_mut().zip(row.as_chunks::<FACTOR>().0) {
        let mut total = part[0];
        for pixel in &part[1..] {
            total += pixel;
        }
        *sum += total;
    }
}

/// The scale of a rough match.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RoughScale {
    /// The factor by which the images are reduced.
    pub factor: usize,
    /// Side of the neighborhoods of the descriptor in the reduced images,
    pub neighborhood: usize,
    /// ... and of the windows that costs are summed over.
    pub window: usize,
    /// Whether disparities are found between whole pixels of the reduced images.
    pub subpixel: bool,
}

/// The settings of a match of reduced images. Paths only along rows, few frequencies and one-byte costs are
/// fast, and rough disparities suffice.
pub fn rough_settings(neighborhood: usize, window: usize, subpixel: bool) -> Settings {
    Settings {
        neighborhood,
        window,
        subpixel,
        frequencies: (1, 1),
        precision: Precision::Byte,
        optimizer: Optimizer::ScanlineOptimization,
        shiftable: false,
        confidence: false,
        ..Preset::Paper.settings()
    }
}

impl RoughScale {
    /// Large neighborhoods withstand the remaining blur. The factor is to be chosen.
    pub const ROUGH: Self = Self { factor: 1, neighborhood: 9, window: 9, subpixel: false };
}

/// The known geometry of a pair.
#[derive(Debug, Clone)]
pub struct Correspondence {
    /// The disparities to search.
    pub candidates: Candidates,
    /// The field of vertical offsets of the pair; `None`: its rows correspond.
    pub alignment: Option<Alignment>,
}

/// Disparities of reduced images.
#[derive(Debug)]
pub struct RoughMatch {
    /// Pixels of the reduced image; NaN: none.
    disparity: Plane<f32>,
    factor: usize,
    alignment: Option<Alignment>,
}

/// The right image, reduced by a factor, resampled by the field of vertical offsets; linear between rows.
pub fn raised(
    right: &Plane<f32>,
    alignment: &Alignment,
    factor: usize,
    control: &Control,
) -> Result<Plane<f32>> {
    // The center of a reduced pixel in the whole image.
    let center = |at: usize| (at as f64 + 0.5) * factor as f64 - 0.5;

    let last = right.rows() as isize - 1;

    Plane::by_rows(right.size(), control, |y, row: &mut [f32]| {
        let along = alignment.along(center(y));

        for (x, value) in row.iter_mut().enumerate() {
            // Offsets are rounded to steps, so that it does not matter where a part of the image begins.
            let offset = nearest(along.at(center(x)) * RAISED_STEPS as f64 / factor as f64) as isize;
            let above = y as isize + offset.div_euclid(RAISED_STEPS);
            let share = offset.rem_euclid(RAISED_STEPS) as f32 / RAISED_STEPS as f32;

            let [upper, lower] = [above, above + 1].map(|y| right.row(y.clamp(0, last) as usize)[x]);
            *value = upper + share * (lower - upper);
        }
    })
}

/// Matches images reduced by a factor over a span of their disparities, both ends included, with the right
/// one row-aligned by the field.
pub fn match_reduced(
    [left, right]: [Plane<f32>; 2],
    factor: usize,
    alignment: Option<&Alignment>,
    span: (isize, isize),
    settings: &Settings,
    Runtime { matcher, execution, control }: Runtime,
) -> Result<Disparity> {
    let right = match alignment {
        Some(field) => raised(&right, field, factor, control)?,
        None => right,
    };

    let (min, count) = Candidates::of_span(span, left.cols())?.numbers();
    let pair = Pair::new(as_view(&left), as_view(&right), min, count)?;

    // Rows of the reduced pair are not rows of the result: its progress is counted separately.
    let all = Section::whole(&pair);
    matcher.match_alone(&pair, &all, settings, execution, &control.aside())
}

impl RoughMatch {
    /// Matches a pair reduced by a factor, with neighborhoods of a given side: blur shrinks with the images,
    /// and larger neighborhoods tolerate the rest of it.
    pub fn new(
        grays: &[Plane<f32>; 2],
        known: Correspondence,
        scale: RoughScale,
        runtime: Runtime,
    ) -> Result<Self> {
        let Correspondence { candidates, alignment } = known;
        let factor = scale.factor;
        let copy = |side: usize| reduced(&grays[side], factor, runtime);
        let (left, right) = (copy(0)?, copy(1)?);

        // The reduced range contains the full one.
        let [low, high] = [candidates.min(), candidates.max()].map(|end| end.div_euclid(factor as isize));
        let span = (low, high + 1);

        let RoughScale { neighborhood, window, subpixel, .. } = scale;
        let settings = Settings { p1: 3.0, p2: 16.0, ..rough_settings(neighborhood, window, subpixel) };

        let map = match_reduced([left, right], factor, alignment.as_ref(), span, &settings, runtime)?;
        Ok(Self { disparity: map.disparity, factor, alignment })
    }

    /// Disparities of the full images, reduced by a factor, with rows that correspond by the field.
    pub fn of_whole(disparity: Plane<f32>, factor: usize, alignment: Option<Alignment>) -> Self {
        Self { disparity, factor, alignment }
    }

    /// The factor by which the images are reduced.
    pub fn factor(&self) -> usize {
        self.factor
    }

    /// How many rows lower column `x` of the right image is than row `y` of the left one.
    pub fn rows_at(&self, y: usize, x: usize) -> isize {
        let offset = |alignment: &Alignment| alignment.at(x as f64, y as f64).round() as isize;
        self.alignment.as_ref().map_or(0, offset)
    }

    /// The disparity at a pixel of the whole image, interpolated bilinearly.
    pub fn at(&self, y: usize, x: usize) -> f32 {
        let place = |at: usize, length: usize| {
            // Pixel centers of both sizes; beyond the outermost ones, the disparity stays constant.
            let exact = (at as f32 + 0.5) / self.factor as f32 - 0.5;
            let exact = exact.clamp(0.0, (length - 1) as f32);
            let first = (exact as usize).min(length.saturating_sub(2));
            (first, (first + 1).min(length - 1), exact - first as f32)
        };

        let (top, bottom, down) = place(y, self.disparity.rows());
        let (left, right, along) = place(x, self.disparity.cols());

        let row = |y: usize| {
            let row = self.disparity.row(y);
            row[left] + along * (row[right] - row[left])
        };

        (row(top) + down * (row(bottom) - row(top))) * self.factor as f32
    }

    /// The median disparity around the center of a left block; `None`: none.
    fn of_block(&self, top: usize, left: usize) -> Option<f32> {
        self.around(top + SIDE / 2, left + SIDE / 2)
    }

    /// The median disparity around a pixel; `None`: none.
    pub fn around(&self, y: usize, x: usize) -> Option<f32> {
        let span = |center: usize, length: usize| {
            let first = (center.saturating_sub(CORE / 2) / self.factor).min(length - 1);
            first..(first + CORE / self.factor).min(length)
        };

        let cols = span(x, self.disparity.cols());
        let rows = span(y, self.disparity.rows());
        let values = rows.flat_map(|y| self.disparity.row(y)[cols.clone()].iter().copied());
        Some(median(values.filter(|value| value.is_finite()))? * self.factor as f32)
    }

    /// The pair of blocks whose left one has this corner, in a pair that begins `above` rows below these
    /// disparities; `None` if no disparity is known, the right block would leave its image, or too much of
    /// either is masked.
    pub fn place(&self, pair: &Pair, above: usize, top: usize, left: usize) -> Option<BlockPlace> {
        // The median disparity gives the column of the right block, then the field its row.
        let right = left as isize - self.of_block(above + top, left)?.round() as isize;

        let right = usize::try_from(right).ok().filter(|x| x + SIDE <= pair.size().1)?;

        let below = self.rows_at(above + top + SIDE / 2, right + SIDE / 2);
        let right_top = top.checked_add_signed(below).filter(|y| y + SIDE <= pair.size().0)?;

        let place = BlockPlace { top, left, right_top, right };

        let [left_view, right_view] = pair.views();
        let is_valid = |view, top, left| is_mostly_valid(view, top..top + SIDE, left..left + SIDE);
        (is_valid(left_view, top, left) && is_valid(right_view, right_top, right)).then_some(place)
    }
}

/// Whether few enough pixels of a block are masked for it to show the scene.
pub fn is_mostly_valid(view: &View, rows: Range<usize>, cols: Range<usize>) -> bool {
    let Some(mask) = view.mask() else { return true };
    let total = rows.len() * cols.len();
    let masked = rows.flat_map(|y| &mask.row(y)[cols.clone()]).filter(|valid| !**valid).count();
    masked * MASKED_SHARE <= total
}

/// Gray values in steps for rough codes.
pub fn rough_gray(plane: &Plane<f32>, runtime: Runtime) -> Result<Gray<'static>> {
    let steps = Plane::by_rows(plane.size(), runtime.control, |y, steps: &mut [i32]| {
        write_steps(runtime.level(), plane.row(y), steps);
    })?;
    Ok(Gray::within(ROUGH_REACH, steps))
}

#[leveled]
fn write_steps(level: Level, values: &[f32], steps: &mut [i32]) {
    for (step, value) in steps.iter_mut().zip(values) {
        *step = nearest(f64::from(*value) * (f64::from(ROUGH_REACH) / REACH));
    }
}

/// A plane of gray values as a view.
pub fn as_view(plane: &Plane<f32>) -> View {
    // A fixed range gives every part of an image the same scale; in thousandths.
    view_of_plane(plane, IntensityRange::about_zero(1000.0 * REACH))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{on_a_thread, texture};
    use phasestereo_match::base::simd::Level;
    use phasestereo_match::image::conversion::view_of_input;
    use phasestereo_match::image::pixels::{Image, Input};
    use phasestereo_match::image::view::Mask;

    const SHIFT: usize = 12;

    /// Squares of 3 pixels, all at one disparity.
    fn pair(masks: [Option<Mask>; 2]) -> Pair {
        let view = |from: usize, mask| {
            let pixel = |(y, x, _)| texture(y / 3, (x + from) / 3, 0);
            let image = Image::U8(ndarray::Array3::from_shape_fn((130, 200, 1), pixel));
            Input { mask, ..image.into() }
        };

        let [left, right] = masks;
        Pair::of_inputs([view(0, left), view(SHIFT, right)], 0, 40).expect("a legal pair")
    }

    fn rough(pair: &Pair, factor: usize) -> RoughMatch {
        let scale = RoughScale { factor, ..RoughScale::ROUGH };
        let known = Correspondence { candidates: pair.candidates(), alignment: None };
        on_a_thread(Level::best(), |runtime| {
            let grays = pair.views().map(|view| grays(view, runtime.control).expect("memory"));
            RoughMatch::new(&grays, known, scale, runtime).expect("a match")
        })
    }

    #[test]
    fn blocks_of_a_pair_show_the_same() {
        let pair = pair([None, None]);
        for factor in [2, 4] {
            let place = rough(&pair, factor).place(&pair, 0, 20, 70);
            assert_eq!(place, Some(BlockPlace { top: 20, left: 70, right_top: 20, right: 70 - SHIFT }));
        }
    }

    #[test]
    fn blocks_lie_inside_both_images() {
        let pair = pair([None, None]);

        let rough = rough(&pair, 4);
        assert_eq!(rough.place(&pair, 0, 0, SHIFT - 8).map(|place| place.right), None);
        assert!(rough.place(&pair, 0, 130 - SIDE, 200 - SIDE).is_some());
    }

    #[test]
    fn blocks_that_are_masked_in_either_image_are_left_out() {
        let masked = |share: usize| Some(Mask::from_fn(130, 200, |y, x| (31 * y + x) % 100 >= share));

        for masks in [[masked(13), None], [None, masked(13)]] {
            let pair = pair(masks);
            assert_eq!(rough(&pair, 4).place(&pair, 0, 20, 70), None);
        }

        let pair = pair([masked(5), masked(5)]);
        assert!(rough(&pair, 4).place(&pair, 0, 20, 70).is_some());
    }

    #[test]
    fn between_pixels_disparities_are_interpolated_and_beyond_them_kept() {
        let rough = RoughMatch {
            disparity: Plane::from_fn(2, 3, |y, x| (x + 10 * y) as f32),
            factor: 4,
            alignment: None,
        };

        for (place, expected) in [((0, 0), 0.0), ((1, 3), 1.5), ((3, 5), 18.5), ((7, 11), 48.0)] {
            assert!((rough.at(place.0, place.1) - expected).abs() < 1e-4, "{place:?}");
        }
    }

    #[test]
    fn one_value_all_over_is_no_contrast() {
        let plane = |odd: usize| Plane::from_fn(80, 80, |y, x| if y * 80 + x == odd { 1.0 } else { 7.0 });

        assert!(has_contrast(&plane(79 * 80), 16, 0), "the last row of the block");
        assert!(!has_contrast(&plane(79 * 80), 15, 0), "the row below it");
        assert!(has_contrast(&plane(0), 0, 0) && !has_contrast(&plane(0), 0, 1));
    }

    #[test]
    fn shades_are_in_one_range_whatever_the_type() {
        let bytes = ndarray::Array3::from_shape_fn((9, 11, 1), |(y, x, _)| texture(y, x, 0));
        let images =
            [(Image::U16(bytes.mapv(|value| u16::from(value) * 256)), 1.0 / 256.0), (Image::U8(bytes), 1.0)];

        let planes = images.map(|(image, unit)| {
            let view = view_of_input(image.into()).expect("memory");
            assert!((grays_per_unit(&view) / unit - 1.0).abs() < 1e-9);
            grays(&view, &Control::default()).expect("memory")
        });

        assert_eq!(planes[0], planes[1]);
    }
}
