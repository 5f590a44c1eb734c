//! Rows of pixels -> rows of spectral components, for one band of the image.
//!
//! Separable: along each row first, for every `u`; then down the columns, for every `(u, v)`. With the
//! uniform window both directions slide, at a cost that does not depend on `L`: what enters and what
//! leaves a window lie `L` apart and share one factor, so a step adds that factor times their difference.

use crate::basis::{Basis, Complex};
use crate::error::Result;
use crate::plane::{reflect, zeroed};

/// One row of complex numbers.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct ComplexRow {
    re: Vec<i64>,
    im: Vec<i64>,
}

impl ComplexRow {
    fn new(cols: usize) -> Result<Self> {
        Ok(Self { re: zeroed(cols)?, im: zeroed(cols)? })
    }

    fn set(&mut self, x: usize, value: Complex) {
        (self.re[x], self.im[x]) = (value.re, value.im);
    }

    fn clear(&mut self) {
        self.re.fill(0);
        self.im.fill(0);
    }

    /// Adds `factor * other`.
    fn add_scaled(&mut self, factor: Complex, other: &Self) {
        let places = self.re.iter_mut().zip(&mut self.im).zip(other.re.iter().zip(&other.im));
        for ((re, im), (a, b)) in places {
            *re += factor.re * a - factor.im * b;
            *im += factor.re * b + factor.im * a;
        }
    }

    /// Becomes `next`, and `next` becomes the difference of the two.
    fn replace_by(&mut self, next: &mut Self) {
        let pairs = |now: &mut [i64], next: &mut [i64]| {
            for (now, next) in now.iter_mut().zip(next) {
                (*now, *next) = (*next, *next - *now);
            }
        };
        pairs(&mut self.re, &mut next.re);
        pairs(&mut self.im, &mut next.im);
    }
}

/// The components of successive rows; rows are pushed from top to bottom without a gap.
#[derive(Debug)]
pub struct Spectrum<'a> {
    basis: &'a Basis,
    /// Transforms along the last `L` rows, one per `u`, by row modulo `L`.
    ring: Vec<Vec<ComplexRow>>,
    /// The components of the row last asked for (sliding: last pushed).
    sums: Vec<ComplexRow>,
}

impl<'a> Spectrum<'a> {
    /// Empty, for rows of `cols` pixels.
    pub fn new(basis: &'a Basis, cols: usize) -> Result<Self> {
        let rows = |count: usize| (0..count).map(|_| ComplexRow::new(cols)).collect::<Result<_>>();
        Ok(Self {
            basis,
            ring: (0..basis.size()).map(|_| rows(basis.highest_u() + 1)).collect::<Result<_>>()?,
            sums: rows(basis.components().len())?,
        })
    }

    /// Takes in row `y` (absolute, possibly outside the image) with these pixels.
    pub fn push(&mut self, y: isize, pixels: &[i32]) -> Result<()> {
        let (basis, slot) = (self.basis, self.slot(y));
        let margin = basis.radius() as isize + 1;
        let places = -margin..pixels.len() as isize + margin;
        let padded: Vec<i64> = places.map(|x| pixels[reflect(x, pixels.len())].into()).collect();
        for u in 0..=basis.highest_u() {
            let mut along = along_row(basis, u, &padded)?;
            self.ring[slot][u].replace_by(&mut along);
            if basis.slides() {
                add(basis, &mut self.sums, u, (y, 0), &along);
            }
        }
        Ok(())
    }

    /// Completes the components centred on row `y`; all rows within the radius must have been pushed, and
    /// with a sliding basis none after them.
    pub fn centre_on(&mut self, y: isize) {
        if self.basis.slides() {
            return;
        }
        self.sums.iter_mut().for_each(ComplexRow::clear);
        let radius = self.basis.radius() as isize;
        for offset in -radius..=radius {
            let row = &self.ring[self.slot(y + offset)];
            for (u, along) in row.iter().enumerate() {
                add(self.basis, &mut self.sums, u, (y + offset, offset), along);
            }
        }
    }

    /// Component `c` at column `x`, its origin not yet rotated to the centre pixel.
    pub fn at(&self, c: usize, x: usize) -> Complex {
        Complex { re: self.sums[c].re[x], im: self.sums[c].im[x] }
    }

    fn slot(&self, y: isize) -> usize {
        y.rem_euclid(self.basis.size() as isize) as usize
    }
}

/// Adds to every component of frequency `u` what one row contributes: row `y`, `offset` from the centre.
fn add(
    basis: &Basis,
    sums: &mut [ComplexRow],
    u: usize,
    (y, offset): (isize, isize),
    along: &ComplexRow,
) {
    for (sum, component) in sums.iter_mut().zip(basis.components()) {
        if component.u == u {
            sum.add_scaled(basis.filter(component.v, y, offset), along);
        }
    }
}

/// The transform of index `u` along one row, around every pixel; `padded` continues the row by
/// `radius + 1` pixels on either side.
fn along_row(basis: &Basis, u: usize, padded: &[i64]) -> Result<ComplexRow> {
    let (size, radius) = (basis.size(), basis.radius());
    let cols = padded.len() - size - 1;
    let factor = |x: usize, j: usize| {
        let offset = j as isize - radius as isize;
        basis.filter(u as isize, x as isize + offset, offset)
    };
    let around = |x: usize| {
        let factors = (0..size).map(|j| factor(x, j));
        factors.zip(&padded[x + 1..]).fold(Complex::default(), |sum, (f, p)| sum.plus(f, *p))
    };
    let mut row = ComplexRow::new(cols)?;
    let mut sum = around(0);
    row.set(0, sum);
    // What enters on the right of x = 1 lies at column 1 + radius.
    let entering =
        (1 + radius..).map(|x| x % size).map(|m| basis.filter(u as isize, m as isize, 0));
    for (x, factor) in (1..cols).zip(entering) {
        sum =
            if basis.slides() { sum.plus(factor, padded[x + size] - padded[x]) } else { around(x) };
        row.set(x, sum);
    }
    Ok(row)
}
