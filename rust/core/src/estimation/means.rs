//! Images whose pixels are means of gray values.
//!
//! Means of integers are kept in 16 bits, which hold those of 256 bytes exactly.

use ndarray::Array3;

use phasestereo_match::image::pixels::Image;
use phasestereo_match::image::view::View;

/// An image of this size whose pixels are sums of `count` gray values of a view, divided by their number, and
/// the unit of its values. Integers have 16 bits.
pub fn means(
    view: &View,
    (rows, cols): (usize, usize),
    count: i64,
    sum: impl Fn(usize, usize) -> i64,
) -> (Image, f64) {
    let scale = view.scale();
    let reach = i64::from(scale.reach());
    let (image, step) = if scale.step().is_some() {
        let mean = |(y, x, _)| ((sum(y, x) + count * reach) * (1 << 16) / (2 * count * reach)) as u16;
        let pixels = Array3::from_shape_fn((rows, cols, 1), mean);
        (Image::U16(pixels), 2.0 * reach as f64 / f64::from(1 << 16))
    } else {
        let mean = |(y, x, _)| sum(y, x) as f32 / count as f32;
        (Image::F32(Array3::from_shape_fn((rows, cols, 1), mean)), 1.0)
    };
    (image, step / scale.steps(1.0))
}
