//! The ranges of settings: the accepted values of a type, and their description in messages.

use crate::base::error::{Error, Result};
use crate::settings::kind::Setting;

/// The values that a setting of some type accepts.
pub struct Range<T> {
    /// Their description, as in "accepts an integer from 1 to 4".
    pub text: String,
    contains: Box<dyn Fn(T) -> bool>,
}

impl<T: Setting> Range<T> {
    fn new(text: String, contains: impl Fn(T) -> bool + 'static) -> Self {
        Self { text, contains: Box::new(contains) }
    }

    /// Refuses a value outside the range.
    pub fn check(&self, name: &'static str, value: T) -> Result<()> {
        if (self.contains)(value) {
            return Ok(());
        }
        Err(Error::value(name, value.to_value(), &self.text))
    }
}

/// Integers from `least` to `most`, both included.
pub fn integer(least: usize, most: usize) -> Range<usize> {
    let text = format!("an integer from {least} to {most}");
    Range::new(text, move |value| (least..=most).contains(&value))
}

/// Odd integers from `least` to `most`, both included.
pub fn odd(least: usize, most: usize) -> Range<usize> {
    let text = format!("an odd integer from {least} to {most}");
    Range::new(text, move |value| value % 2 == 1 && (least..=most).contains(&value))
}

/// One of two integers.
pub fn either(one: usize, other: usize) -> Range<usize> {
    Range::new(format!("{one} or {other}"), move |value| [one, other].contains(&value))
}

/// Numbers from 0 to `most`, both included.
pub fn number(most: f64) -> Range<f64> {
    // The range does not contain NaN, so this refuses it, too.
    Range::new(format!("a number from 0 to {most}"), move |value| (0.0..=most).contains(&value))
}

/// Two integers from 0 to `most`, not both 0.
pub fn indices(most: usize) -> Range<(usize, usize)> {
    let text = format!("two integers from 0 to {most}, not both 0");
    Range::new(text, move |(one, other): (usize, usize)| (1..=most).contains(&one.max(other)))
}

/// Two numbers of magnitude up to `most`, the first one smaller.
pub fn rising(most: f64) -> Range<(f64, f64)> {
    let text = format!("two numbers of magnitude up to {most:e}, the first smaller");
    Range::new(text, move |(low, high): (f64, f64)| low < high && low.abs().max(high.abs()) <= most)
}

/// The values of a range, or nothing.
pub fn optional<T: Setting + 'static>(range: Range<T>) -> Range<Option<T>> {
    let text = format!("{}, or None", range.text);
    Range::new(text, move |value: Option<T>| value.is_none_or(|value| (range.contains)(value)))
}
