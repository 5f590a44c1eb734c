//! Applies all changes of a pair to the channels of both images, with the kernels and resamplers of a match.

use crate::estimation::overview::Seen;
use crate::estimation::photometry::{Contrast, Photometry};
use crate::estimation::raster::resolved;
use crate::estimation::shared::SharedPart;
use crate::match_pair::Treatment;
use crate::preparation::SMOOTHED_FROM;
use crate::preparation::back::Back;
use crate::rectification::raw_pair::resampled;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::math;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::image::conversion::view_of_input;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::intensity::Gray;
use phasestereo_match::image::pixels::Input;
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::pair::fitting::{fitted, white};
use phasestereo_match::pair::{Pair, is_same_type};

/// Entries in the table of a curve, which is linear between them: one per 16th of a gray level.
const PLACES: usize = 4096;

/// The changes to each channel.
pub struct Channels<'a> {
    ready: Treatment<'a>,
    /// Whether the match takes the negative of the right image.
    pub is_inverted: bool,
    /// The strength of smoothing of each image, in units of the pixels; 0: not smoothed.
    pub smoothing: [f64; 2],
    /// The blur classes of the pixels of each image; `None`: there is one.
    classes: [Option<Plane<u8>>; 2],
    /// The part of both images that they share.
    pub shared: Option<&'a SharedPart>,
    /// The curve of the right image's gray levels.
    pub tone: Option<&'a Tone>,
}

/// A curve of gray levels.
pub struct Tone {
    black: f64,
    range: f64,
    values: Vec<f64>,
    /// The same, in numbers.
    pub curve: Contrast,
}

impl Tone {
    /// The curve of the right image's gray levels: `left = gain right^gamma`, black 0 to white 1.
    pub fn new(found: &Photometry, curve: Contrast) -> Self {
        let value = |place: usize| {
            let fraction = place as f64 / PLACES as f64;
            let power = if place > 0 { math::exp(curve.gamma * math::ln(fraction)) } else { 0.0 };
            found.black + found.range * (curve.gain * power).clamp(0.0, 1.0)
        };
        let values = (0..=PLACES).map(value).collect();
        Self { black: found.black, range: found.range, values, curve }
    }

    fn apply(&self, plane: &mut Plane<f64>) {
        for value in plane.as_mut_slice() {
            let at = ((*value - self.black) / self.range).clamp(0.0, 1.0) * PLACES as f64;
            let first = (at as usize).min(PLACES - 1);
            let share = at - first as f64;
            *value = self.values[first] + share * (self.values[first + 1] - self.values[first]);
        }
    }
}

impl<'a> Channels<'a> {
    /// The changes to the channels of a pair.
    pub fn new(ready: Treatment<'a>, is_inverted: bool, runtime: Runtime) -> Result<Self> {
        let pair = &ready.prepared.pair;
        let photometry = ready.prepared.estimates.photometry;
        let least = photometry.map_or(f64::INFINITY, |found| SMOOTHED_FROM * found.range);
        let compensation = pair.blur_compensation();
        let smoothing = compensation.map_or([0.0; 2], BlurCompensation::smoothing);
        let smoothing = smoothing.map(|deviation| if deviation >= least { deviation } else { 0.0 });

        let is_mixed = compensation.filter(|all| all.is_mixed() && all.has_kernels());
        let seen = ready.prepared.estimates.seen.as_deref();
        let classes = match is_mixed {
            Some(all) => {
                let left = left_classes(all, pair.size(), runtime)?;
                let right = seen.map(|seen| right_classes(&left, seen)).transpose()?;
                [Some(left.clone()), Some(right.unwrap_or(left))]
            }
            None => [None, None],
        };
        Ok(Self { ready, is_inverted, smoothing, classes, shared: None, tone: None })
    }

    /// The left (0) or right (1) image for other matchers.
    pub fn image(&self, inputs: &[Input; 2], side: usize, back: &Back, runtime: Runtime) -> Result<Input> {
        let count = inputs[side].image.shape().2;
        let mut planes = vec![];
        for channel in 0..count {
            let made;
            let view = if count == 1 {
                self.ready.prepared.pair.views()[side]
            } else {
                made = self.remade(inputs, (side, channel), runtime)?;
                made.views()[side]
            };
            planes.push(back.placed(&self.finished(view, side, runtime)?, side, runtime.control)?);
        }
        Ok(Input::from(inputs[0].image.of_channels(&planes)?))
    }

    /// A channel of an image after all changes, at its side of a pair.
    fn remade(&self, inputs: &[Input; 2], (side, channel): (usize, usize), runtime: Runtime) -> Result<Pair> {
        let Runtime { execution, control, .. } = runtime;
        let mut input = inputs[side].channel(channel);
        if side == 1 && !is_same_type(&inputs[0], &inputs[1]) {
            input.unit = white(&inputs[0]) / white(&inputs[1]);
        }
        let mut view = view_of_input(input)?;
        if side == 1 && inputs[0].size() != view.size() {
            // Only the size of the left one counts.
            view = fitted(&view_of_input(inputs[0].channel(0))?, view)?.0;
        }

        if let Some(shared) = self.shared {
            view = view_of_input(shared.subtracted(&view, side))?;
        }

        let Treatment { prepared, raw, rasters: before } = self.ready;
        let estimates = &prepared.estimates;
        let mut pair = resolved(&Pair::new(view.clone(), view, 0, 1)?, before)?;
        if let Some(raw) = raw {
            pair = resolved(&resampled(&pair, raw.places(control)?, control)?, estimates.rasters)?;
        }
        if self.is_inverted {
            pair = pair.inverted();
        }
        let impulses = prepared.pair.blur_compensation().map_or([0.0; 2], BlurCompensation::impulses);
        pair = pair.repaired(impulses, execution.level, control)?.into_owned();
        if let Some(field) = estimates.alignment.as_ref().filter(|_| side == 1) {
            pair = pair.straightened(field, execution.level, control)?;
        }
        Ok(pair)
    }

    /// A channel of one image, smoothed and blurred as in a match, in units of the pixels.
    fn finished(&self, view: &View, side: usize, runtime: Runtime) -> Result<Plane<f64>> {
        let Runtime { execution, control, .. } = runtime;
        let (level, zero) = (execution.level, view.scale().pixel(0.0));
        let gray = Gray::of_view(view);
        let gray = match self.smoothing[side] {
            0.0 => gray,
            deviation => gray.smoothed(deviation, level, control)?,
        };
        let pixels = |kernel: Option<&Kernel>| -> Result<Plane<f64>> {
            let blurred;
            let gray = match kernel {
                Some(kernel) => {
                    blurred = gray.convolved(kernel, level, control)?;
                    &blurred
                }
                None => &gray,
            };
            let step = gray.steps(1.0);
            Plane::by_rows(gray.size(), control, |y, row: &mut [f64]| {
                for (value, steps) in row.iter_mut().zip(gray.row(y)) {
                    *value = zero + f64::from(*steps) / step;
                }
            })
        };

        let kernels = self.kernels(side);
        let mut out = pixels(kernels.first().copied().flatten())?;
        if let Some(classes) = &self.classes[side] {
            for (class, kernel) in kernels.iter().enumerate().skip(1) {
                let other = pixels(*kernel)?;
                let values = out.as_mut_slice().iter_mut().zip(other.as_slice());
                for ((value, other), of) in values.zip(classes.as_slice()) {
                    if usize::from(*of) == class {
                        *value = *other;
                    }
                }
            }
        }
        if let Some(tone) = self.tone.filter(|_| side == 1) {
            tone.apply(&mut out);
        }
        Ok(out)
    }

    /// The kernels of one side, by class.
    pub fn kernels(&self, side: usize) -> Vec<Option<&Kernel>> {
        let compensation = self.ready.prepared.pair.blur_compensation().into_iter();
        compensation.flat_map(BlurCompensation::classes).map(|pair| pair[side].as_ref()).collect()
    }
}

/// The classes of all pixels of the left image.
fn left_classes(all: &BlurCompensation, size: (usize, usize), runtime: Runtime) -> Result<Plane<u8>> {
    Plane::by_rows(size, runtime.control, |y, row| all.write_classes(y, 0, row))
}

/// The classes of all pixels of the right image: those of the left pixels that are seen there.
fn right_classes(left: &Plane<u8>, seen: &Seen) -> Result<Plane<u8>> {
    let (rows, cols) = seen.all.size();
    let middle = |at: usize, last: usize| (at * seen.factor + seen.factor / 2).min(last - 1);

    let mut coarse = Plane::<u8>::new(rows, cols)?;
    for y in 0..rows {
        let classes = left.row(middle(y, left.rows()));
        let mut found: Vec<Option<u8>> = vec![None; cols];
        for (x, disparity) in seen.all.row(y).iter().enumerate() {
            let at = x as f32 - disparity / seen.factor as f32;
            // A point farther to the right in the left image is nearer, and so hides others. NaN is in no
            // range.
            if (0.0..cols as f32).contains(&at) {
                found[at as usize] = Some(classes[middle(x, left.cols())]);
            }
        }

        // A pixel where nothing is seen takes the class of the one beside it.
        let mut last = found.iter().flatten().next().copied().unwrap_or(classes[0]);
        for (class, found) in coarse.row_mut(y).iter_mut().zip(found) {
            last = found.unwrap_or(last);
            *class = last;
        }
    }

    let place = |at: usize, count: usize| (at / seen.factor).min(count - 1);
    Ok(Plane::from_fn(left.rows(), left.cols(), |y, x| coarse.row(place(y, rows))[place(x, cols)]))
}
