//! Limits of values read from a text, which may come from anyone.

/// Most pixels of an image. A text about larger images is refused, whatever memory a match would take.
pub const MOST_PIXELS: usize = 1 << 30;
/// Largest values measured in pixels, multiples of deviations, or degrees, and of the numbers of cameras.
pub const LARGEST: f64 = 1e6;

/// Whether all numbers are finite and not huge.
pub fn is_moderate<'a>(values: impl IntoIterator<Item = &'a f64>) -> bool {
    values.into_iter().all(|value| value.abs() <= LARGEST)
}
