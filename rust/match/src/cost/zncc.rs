//! Zero-mean normalized cross-correlation of neighborhoods (ZNCC), which depends on neither brightness nor
//! contrast.
//!
//! ```text
//! covariance(x, k) = n sum(left right) - sum(left) sum(right)         # over n pixels of both neighborhoods
//! spread           = sqrt(n sum(value^2) - sum(value)^2 + (n level)^2)  # of one; level: one gray level
//! cost(x, k)       = 1 - covariance / (spread(left) spread(right))
//! ```
//!
//! As in normalized SAD, one gray level of deviation is added in quadrature, so that noise in flat areas does
//! not correlate. Images continue beyond their edges by repeating them. The sums are integers that double
//! precision holds exactly, in any order; each quotient is rounded the same on every machine.

use crate::base::control::Control;
use crate::base::error::Result;
use crate::base::plane::Plane;
use crate::base::simd::Level;
use crate::base::value::{Value, nearest};
use crate::cost::unrolled::UnrolledPlane;
use crate::cost::{Cost, CostInput, Lines, PixelBytes, RowPart};
use crate::image::intensity::{LEVEL_STEPS, level_planes};
use crate::image::window_sums::Windows;
use crate::pair::plan::{Demand, Plan};
use crate::settings::{LARGEST_WINDOW, Settings};

/// Fixed-point steps per unit of the correlation: as fine as those of normalized SAD.
const STEPS: u16 = 256;
/// Rows whose sums one task computes; each task warms up over the rows of a neighborhood.
const BAND_ROWS: usize = 128;

/// The gray levels of a pair, ready to be correlated: continued by half a neighborhood on all sides.
pub struct Zncc {
    /// Side of the neighborhoods.
    side: usize,
    left: Plane<u16>,
    right: UnrolledPlane<u16>,
    left_moments: Moments<Plane<f64>>,
    right_moments: Moments<UnrolledPlane<f64>>,
}

/// Sums and spreads of the neighborhoods around all pixels.
struct Moments<P> {
    sums: P,
    spreads: P,
}

impl Cost for Zncc {
    const STEPS: u16 = STEPS;

    fn ceiling(_: &Settings) -> u16 {
        2 * STEPS
    }

    fn reach(plan: Plan) -> usize {
        plan.settings.neighborhood / 2
    }

    fn bytes(_: &Demand) -> PixelBytes {
        // The values, and their sums and spreads in double precision.
        PixelBytes { described: 2 + 2 * 8, versions: 1, passing: 2 }
    }

    fn new(CostInput { views, candidates, settings, level, control, .. }: CostInput) -> Result<Self> {
        let side = settings.neighborhood;
        let [left, right] = level_planes(views, settings.intensity_range, control)?;
        let left = continued(&left, side / 2)?;
        let right = continued(&right, side / 2)?;
        let right = UnrolledPlane::new(&right, candidates, |level| level)?;

        let left_moments = Moments::new(&left, side, level, control)?;
        let Moments { sums, spreads } = Moments::new(right.plane(), side, level, control)?;
        let right_moments = Moments { sums: right.like(sums), spreads: right.like(spreads) };
        Ok(Self { side, left, right, left_moments, right_moments })
    }

    /// Products are summed down each column of the neighborhoods, and these sums along the row.
    #[inline(always)]
    fn write<V: Value, const L: usize>(&self, (y, columns, searched): RowPart, out: &mut Lines<V, L>) {
        let &Self { side, ref left, ref right, ref left_moments, ref right_moments } = self;
        let (row, radius, pixels) = (y + side / 2, side / 2, (side * side) as f64);
        let mut ring = [[0.0; L]; LARGEST_WINDOW];
        let mut products = [0.0; L];

        for (count, x) in (1..).zip(columns.start..columns.end + side - 1) {
            let mut entering = [0.0; L];
            for y in y..y + side {
                add_products(left.row(y)[x], right.under(y, x, searched), &mut entering);
            }
            slide(&mut products, entering, &mut ring[count % side]);

            if let Some(pixel) = count.checked_sub(side) {
                let center = x - radius;
                let left = [&left_moments.sums, &left_moments.spreads].map(|p| p.row(row)[center]);
                let sums = right_moments.sums.under(row, center, searched);
                let spreads = right_moments.spreads.under(row, center, searched);
                write_costs((&products, pixels), left, [sums, spreads], out.line(pixel));
            }
        }
    }

    fn between(&self, y: usize, x: usize, place: usize) -> u32 {
        let side = self.side;
        let (row, radius, pixels) = (y + side / 2, side / 2, (side * side) as f64);
        let row_products = |y: usize| -> f64 {
            let left = self.left.row(y)[x..][..side].iter();
            let right = self.right.row(y)[place..][..side].iter().rev();
            left.zip(right).map(|(left, right)| f64::from(*left) * f64::from(*right)).sum()
        };
        let products = (y..y + side).map(row_products).sum();

        let Moments { sums, spreads } = &self.left_moments;
        let left = [sums, spreads].map(|plane| plane.row(row)[x + radius]);
        let Moments { sums, spreads } = &self.right_moments;
        let right = [sums, spreads].map(|plane| plane.row(row)[place + radius]);
        cost((products, pixels), left, right)
    }
}

impl Moments<Plane<f64>> {
    /// The moments of a plane; values within half a neighborhood of its edge are meaningless.
    fn new(plane: &Plane<u16>, side: usize, level: Level, control: &Control) -> Result<Self> {
        let windows = Windows::new(plane.size(), side / 2);
        let pixels = (side * side) as i64;
        let one_gray_level = (pixels * i64::from(LEVEL_STEPS)).pow(2);

        let values = |y: usize| plane.row(y).iter().map(|v| i64::from(*v)).map(|v| [v, v * v]);
        let sum = |_, _, [sum, _]: [i64; 2]| sum as f64;
        let spread =
            |_, _, [sum, squares]: [i64; 2]| ((pixels * squares - sum * sum + one_gray_level) as f64).sqrt();

        Ok(Self {
            sums: Plane::by_bands(plane.size(), BAND_ROWS, |first, band| {
                control.checkpoint()?;
                windows.write((first, band), values, sum, level)
            })?,
            spreads: Plane::by_bands(plane.size(), BAND_ROWS, |first, band| {
                control.checkpoint()?;
                windows.write((first, band), values, spread, level)
            })?,
        })
    }
}

/// A plane continued on all sides by its edge.
fn continued(plane: &Plane<u16>, by: usize) -> Result<Plane<u16>> {
    let (rows, cols) = (plane.rows(), plane.cols());

    Plane::by_bands((rows + 2 * by, cols + 2 * by), 1, |y, row| {
        let values = plane.row(y.saturating_sub(by).min(rows - 1));
        row.fill(values[0]);
        row[by..][..cols].copy_from_slice(values);
        row[by + cols..].fill(values[cols - 1]);
        Ok(())
    })
}

#[inline(always)]
fn add_products<const L: usize>(left: u16, right: &[u16; L], sums: &mut [f64; L]) {
    let left = f64::from(left);
    for j in 0..L {
        sums[j] += left * f64::from(right[j]);
    }
}

/// Slides sums over columns by one; the entering one replaces the leaving one.
#[inline(always)]
fn slide<const L: usize>(sums: &mut [f64; L], entering: [f64; L], leaving: &mut [f64; L]) {
    for j in 0..L {
        sums[j] += entering[j] - leaving[j];
    }
    *leaving = entering;
}

#[inline(always)]
fn write_costs<V: Value, const L: usize>(
    (products, pixels): (&[f64; L], f64),
    left: [f64; 2],
    [sums, spreads]: [&[f64; L]; 2],
    out: &mut [V; L],
) {
    for j in 0..L {
        let cost = cost((products[j], pixels), left, [sums[j], spreads[j]]);
        out[j] = V::truncated(cost.into());
    }
}

/// The cost of two neighborhoods, from the sum of their products over `pixels`, and the sum and spread of
/// each.
#[inline(always)]
fn cost(
    (products, pixels): (f64, f64),
    [left_sum, left_spread]: [f64; 2],
    [right_sum, right_spread]: [f64; 2],
) -> u32 {
    let covariance = pixels * products - left_sum * right_sum;
    let correlation = covariance / (left_spread * right_spread);
    nearest((1.0 - correlation.clamp(-1.0, 1.0)) * f64::from(STEPS)) as u32
}
