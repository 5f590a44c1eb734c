//! Blur compensation: every pixel is compared in the version of the images that suits its area.
//!
//! Blur in only one image is compensated by blurring the other one equally. If the blur varies over the
//! image, so do the kernels: square tiles divide the pixels of the left image into classes, and each class
//! has the kernels that blur both images before they are compared.

use crate::base::control::Control;
use crate::base::error::{Error, Result};
use crate::base::plane::Plane;
use crate::base::simd::Level;
use crate::image::convolution::Kernel;
use crate::image::intensity::Gray;
use crate::image::view::View;
use crate::settings::LARGEST_PIXEL;

/// Most classes there can be.
pub const MOST_CLASSES: usize = 16;

/// The classes of the pixels of a pair, their kernels, and the noise of the images.
#[derive(Debug, Clone, PartialEq)]
pub struct BlurCompensation {
    noise: [f64; 2],
    impulses: [f64; 2],
    smoothing: [f64; 2],
    kernels: Vec<[Option<Kernel>; 2]>,
    labels: Plane<u8>,
    tile: usize,
    /// The row of the labeled image that is the first row of the pair.
    first: usize,
}

/// The index of the version of an image in which each pixel is compared.
#[derive(Debug)]
pub struct Labels {
    /// One row of pixels for each row of tiles.
    rows: Plane<u8>,
    tile: usize,
    /// Rows of the first row of tiles that lie above the pair.
    above: usize,
}

impl BlurCompensation {
    /// `noise` holds the standard deviations of the noise of the left and the right image, in units of the
    /// pixels; `kernels`, for each class, the kernels of the left and the right image (`None`: the image
    /// stays unchanged). Pixel `(x, y)` belongs to the class `labels[y / tile][x / tile]`; beyond the last
    /// tile, to the class of that one.
    pub fn new(
        noise: [f64; 2],
        kernels: Vec<[Option<Kernel>; 2]>,
        labels: Plane<u8>,
        tile: usize,
    ) -> Result<Self> {
        let count = kernels.len();
        noise.map(check_noise).into_iter().collect::<Result<Vec<_>>>()?;

        if !(1..=MOST_CLASSES).contains(&count) {
            let accepts = format!("pairs of kernels for 1 to {MOST_CLASSES} classes");
            return Err(Error::value("kernels", format!("{count} classes"), accepts));
        }

        if labels.as_slice().is_empty() {
            let got = format!("shape ({}, {})", labels.rows(), labels.cols());
            return Err(Error::value("labels", got, "at least one label"));
        }

        if let Some(label) = labels.as_slice().iter().find(|label| usize::from(**label) >= count) {
            let accepts = format!("labels below the number of classes, {count}");
            return Err(Error::value("labels", format!("the label {label}"), accepts));
        }

        if tile == 0 {
            return Err(Error::value("tile", 0, "an integer from 1"));
        }

        let none = [0.0; 2];
        Ok(Self { noise, impulses: none, smoothing: none, kernels, labels, tile, first: 0 })
    }

    /// The same, with impulses of at least these heights in the left and the right image, in units of the
    /// pixels; 0: none.
    pub fn with_impulses(self, impulses: [f64; 2]) -> Result<Self> {
        let [left, right] = impulses;

        let impulses = [deviation(left, "impulses")?, deviation(right, "impulses")?];
        Ok(Self { impulses, ..self })
    }

    /// The same, with both images first smoothed by these standard deviations in units of the pixels; 0: not
    /// smoothed.
    pub fn with_smoothing(self, smoothing: [f64; 2]) -> Result<Self> {
        let [left, right] = smoothing;

        let smoothing = [deviation(left, "smoothing")?, deviation(right, "smoothing")?];
        Ok(Self { smoothing, ..self })
    }

    /// A compensation that leaves the images unchanged, with noise of these standard deviations.
    pub fn of_noise(noise: [f64; 2]) -> Result<Self> {
        Self::new(noise, vec![[None, None]], Plane::from_fn(1, 1, |_, _| 0), 1)
    }

    /// The same, for a pair whose first row is row `first` of the labeled one.
    pub fn starting_at_row(self, first: usize) -> Self {
        Self { first, ..self }
    }

    /// The same, for a pair that begins `rows` rows below this one.
    pub fn below(self, rows: usize) -> Self {
        Self { first: self.first + rows, ..self }
    }

    /// Standard deviations of the noise of the left and of the right image, in units of the pixels.
    pub fn noise(&self) -> [f64; 2] {
        self.noise
    }

    /// The least height of impulses of the left and the right image, in units of the pixels; 0: none.
    pub fn impulses(&self) -> [f64; 2] {
        self.impulses
    }

    /// Whether impulses of either image are repaired.
    pub fn repairs(&self) -> bool {
        self.impulses.iter().any(|height| *height > 0.0)
    }

    /// Whether either image is smoothed.
    pub fn smooths(&self) -> bool {
        self.smoothing.iter().any(|deviation| *deviation > 0.0)
    }

    /// Standard deviations by which the left and the right image are smoothed, in units of the pixels; 0: not
    /// smoothed.
    pub fn smoothing(&self) -> [f64; 2] {
        self.smoothing
    }

    /// Whether any image is blurred.
    pub fn has_kernels(&self) -> bool {
        self.every_kernel().next().is_some()
    }

    /// The kernels of all classes and both images.
    pub fn every_kernel(&self) -> impl Iterator<Item = &Kernel> {
        self.kernels.iter().flatten().flatten()
    }

    /// The class of a pixel of the left image.
    pub fn class(&self, y: usize, x: usize) -> usize {
        let row = self.labels.row(self.row_of_labels(y));
        row[(x / self.tile).min(self.labels.cols() - 1)].into()
    }

    fn row_of_labels(&self, y: usize) -> usize {
        ((y + self.first) / self.tile).min(self.labels.rows() - 1)
    }

    /// Writes the classes of neighboring pixels of row `y` of the left image, from column `first` on.
    pub fn write_classes(&self, y: usize, first: usize, classes: &mut [u8]) {
        let row = self.labels.row(self.row_of_labels(y));

        let mut x = first;
        let end = first + classes.len();

        while x < end {
            // Tile after tile; the last one extends to the end.
            let tile = (x / self.tile).min(row.len() - 1);
            let next = if tile + 1 == row.len() { end } else { end.min((tile + 1) * self.tile) };
            classes[x - first..next - first].fill(row[tile]);
            x = next;
        }
    }

    /// Whether pixels may belong to different classes.
    pub fn is_mixed(&self) -> bool {
        self.kernels.len() > 1
    }

    /// The kernels of the left and of the right image, by class.
    pub fn classes(&self) -> impl Iterator<Item = &[Option<Kernel>; 2]> {
        self.kernels.iter()
    }

    /// The kernels of a class for the left and for the right image.
    pub fn kernels(&self, class: usize) -> &[Option<Kernel>; 2] {
        &self.kernels[class]
    }

    /// The distinct kernels of one side (0: left, 1: right) that occur in a left image of this many rows and
    /// columns, and the index of the kernel for each pixel.
    pub fn of_side(
        &self,
        side: usize,
        (rows, cols): (usize, usize),
    ) -> Result<(Vec<Option<&Kernel>>, Labels)> {
        // A class is represented by the first one with the same kernel.
        let kernel = |class: usize| self.kernels[class][side].as_ref();
        let alike = |class: usize| (0..class).find(|before| kernel(*before) == kernel(class));
        let alike: Vec<_> = (0..self.kernels.len()).map(|c| alike(c).unwrap_or(c)).collect();

        // Kernels are numbered in the order in which pixels use them.
        let mut classes = vec![];
        let tiles = self.row_of_labels(0)..=self.row_of_labels(rows - 1);
        let above = self.first - tiles.start() * self.tile;
        let mut labels = Plane::new(tiles.clone().count(), cols)?;

        for (index, tile) in tiles.enumerate() {
            let y = (tile * self.tile).saturating_sub(self.first);
            for (x, label) in labels.row_mut(index).iter_mut().enumerate() {
                let class = alike[self.class(y, x)];
                let known = classes.iter().position(|known| *known == class);
                *label = known.unwrap_or(classes.len()) as u8;

                if known.is_none() {
                    classes.push(class);
                }
            }
        }

        let kernels = classes.into_iter().map(kernel).collect();
        Ok((kernels, Labels { rows: labels, tile: self.tile, above }))
    }
}

impl Labels {
    /// The labels of row `y`.
    pub fn row(&self, y: usize) -> &[u8] {
        self.rows.row(((y + self.above) / self.tile).min(self.rows.rows() - 1))
    }
}

/// The gray values of one side of a pair before they are described or convolved, smoothed if the compensation
/// requires it.
pub fn gray<'a>(
    view: &'a View,
    compensation: Option<&BlurCompensation>,
    side: usize,
    level: Level,
    control: &Control,
) -> Result<Gray<'a>> {
    let gray = Gray::of_view(view);

    match compensation.map_or(0.0, |compensation| compensation.smoothing[side]) {
        0.0 => Ok(gray),
        deviation => gray.smoothed(deviation, level, control),
    }
}

/// Refuses a value that is not a standard deviation of noise.
pub fn check_noise(noise: f64) -> Result<f64> {
    deviation(noise, "noise")
}

fn deviation(value: f64, name: &'static str) -> Result<f64> {
    if (0.0..=LARGEST_PIXEL).contains(&value) {
        return Ok(value);
    }

    let what = if name == "impulses" { "heights" } else { "standard deviations" };
    Err(Error::value(name, value, format!("{what} from 0 to {LARGEST_PIXEL:e}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A kernel that differs from others in the place of its single tap.
    fn kernel(place: usize) -> Kernel {
        let taps = Plane::from_fn(1, 9, |_, x| f64::from(u8::from(x == place)));
        Kernel::new(&taps).expect("a legal kernel")
    }

    fn labels(rows: usize, cols: usize, labels: &[u8]) -> Plane<u8> {
        Plane::from_vec(rows, cols, labels.to_vec()).expect("the right length")
    }

    #[test]
    fn versions_are_those_that_occur_and_each_once() {
        let kernels = vec![
            [Some(kernel(1)), None],
            [None, Some(kernel(2))],
            [Some(kernel(1)), Some(kernel(3))],
            [None, None],
        ];

        // The last row and the last column of tiles lie beyond the image.
        let labels = labels(3, 3, &[2, 1, 3, 0, 2, 3, 3, 3, 3]);
        let compensation = BlurCompensation::new([0.0; 2], kernels, labels, 2).expect("legal");

        let (left, of_left) = compensation.of_side(0, (3, 4)).expect("memory");
        assert_eq!(left, [Some(&kernel(1)), None]);
        assert_eq!([0, 1, 2].map(|y| of_left.row(y).to_vec()), [[0, 0, 1, 1], [0, 0, 1, 1], [0; 4]]);

        let (right, of_right) = compensation.of_side(1, (3, 4)).expect("memory");
        assert_eq!(right, [Some(&kernel(3)), Some(&kernel(2)), None]);
        assert_eq!([1, 2].map(|y| of_right.row(y).to_vec()), [[0, 0, 1, 1], [2, 2, 0, 0]]);
    }

    #[test]
    fn pixels_beyond_the_last_tile_are_of_its_class() {
        let kernels = vec![[None, None]; 3];
        let compensation = BlurCompensation::new([0.0; 2], kernels, labels(1, 2, &[1, 2]), 3).expect("legal");

        assert_eq!([(0, 2), (9, 2), (0, 3), (9, 9)].map(|(y, x)| compensation.class(y, x)), [1, 1, 2, 2]);

        let (_, all) = compensation.of_side(0, (10, 10)).expect("memory");
        assert_eq!((all.row(9), all.rows.rows()), (&[0; 10][..], 1), "alike: one version");
    }

    #[test]
    fn illegal_arguments_are_refused_by_name() {
        let refused = |noise, count, plane, tile| {
            let compensation = BlurCompensation::new(noise, vec![[None, None]; count], plane, tile);
            compensation.expect_err("must be refused").to_string()
        };

        let one = || labels(1, 1, &[0]);

        for noise in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(refused([0.0, noise], 1, one(), 1).starts_with("noise: got"));
        }

        for count in [0, MOST_CLASSES + 1] {
            assert!(refused([0.0; 2], count, one(), 1).starts_with("kernels: got"));
        }

        assert!(refused([0.0; 2], 1, labels(0, 3, &[]), 1).starts_with("labels: got shape (0, 3)"));
        let message = refused([0.0; 2], 2, labels(1, 2, &[1, 2]), 1);
        assert!(message.starts_with("labels: got the label 2; accepts labels below"), "{message}");
        assert!(refused([0.0; 2], 1, one(), 0).starts_with("tile: got 0"));
    }
}
