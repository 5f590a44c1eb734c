//! The estimates of a pair as C structures.

use std::array;

use phasestereo::Estimates;
use phasestereo::found::{self, BlurEstimate, Family, Psf, RowOffsets, SearchRange, Side};
use phasestereo_match::pair::alignment::TERMS;

use crate::sized::Growing;

/// Most kinds of blur that are reported: those of the largest areas.
pub const PHASESTEREO_MOST_BLURS: usize = 8;
/// Coefficients of the field of vertical offsets.
pub const PHASESTEREO_TERMS: usize = 8;
const _: () = assert!(PHASESTEREO_TERMS == TERMS);

/// Neither image: both are equally sharp.
pub const PHASESTEREO_NEITHER: u32 = 0;
/// The left image.
pub const PHASESTEREO_LEFT: u32 = 1;
/// The right image.
pub const PHASESTEREO_RIGHT: u32 = 2;

/// No blur.
pub const PHASESTEREO_NO_BLUR: u32 = 0;
/// A Gaussian; its size is the standard deviation.
pub const PHASESTEREO_GAUSSIAN: u32 = 1;
/// Defocus; its size is the radius.
pub const PHASESTEREO_DISK: u32 = 2;
/// A straight motion; its size is the length.
pub const PHASESTEREO_MOTION: u32 = 3;
/// Defocus of a lens with a covered middle; its size is the outer radius.
pub const PHASESTEREO_ANNULUS: u32 = 4;
/// None of these families; its size is the root mean square radius.
pub const PHASESTEREO_OTHER: u32 = 5;

/// The disparities were given by the caller.
pub const PHASESTEREO_GIVEN: u32 = 0;
/// The disparities were estimated from the images.
pub const PHASESTEREO_FOUND: u32 = 1;
/// The range could not be estimated: the number of disparities is a third of the width.
pub const PHASESTEREO_DEFAULT: u32 = 2;

/// A kind of relative blur: the blur that makes one image match the other. No field will ever be added to it.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C)]
pub struct Blur {
    /// Its size, pixels.
    pub size: f64,
    /// Direction of a motion, degrees in [0, 180): 0 is along x, 90 along y.
    pub angle: f64,
    /// The share of the image with this blur.
    pub share: f64,
    /// The softer image: `PHASESTEREO_NEITHER`, `PHASESTEREO_LEFT` or `PHASESTEREO_RIGHT`.
    pub side: u32,
    /// Its family: `PHASESTEREO_NO_BLUR`, `PHASESTEREO_GAUSSIAN` and so on
    pub kind: u32,
}

/// The estimates from a pair. Numbers that were not or could not be estimated are NaN, and counts are 0.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct Found {
    /// `sizeof(phasestereo_found)`, to be set before the call.
    pub struct_size: usize,
    /// Mean confidence, 0 to 1, of a rough match of small copies.
    pub confidence: f64,
    /// Smallest disparity found, pixels.
    pub low: f64,
    /// Largest disparity found, pixels.
    pub high: f64,
    /// The field of vertical offsets v: a point at row y of the left image is at y + v in the right one. With
    /// X and Y from -1 to 1 over the columns of the right and the rows of the left image, and `R2 = X^2 +
    /// Y^2`, it is `c0 + c1 X + c2 Y + c3 X Y + c4 X^2 + c5 Y^2 + c6 Y R2 + c7 X R2`, in pixels.
    pub rows: [f64; PHASESTEREO_TERMS],
    /// Root mean square of v over the image, pixels.
    pub rows_rms: f64,
    /// Its standard error, pixels.
    pub rows_error: f64,
    /// Robust standard deviation of the blocks from it, pixels.
    pub rows_spread: f64,
    /// Certainty of the first of `blurs`, from 0 to 1: how much better it explains its part of the images
    /// than the opposite.
    pub certainty: f64,
    /// Contrast of the left image relative to the right one.
    pub contrast: f64,
    /// Standard deviations of the noise, left and right, in units of the pixels.
    pub noise: [f64; 2],
    /// Least height of hot, dead and stuck pixels above or below their neighbors, left and right; 0: there
    /// are none.
    pub impulses: [f64; 2],
    /// Loss from block compression, left and right, as the standard deviation of a noise that would do the
    /// same harm.
    pub coding: [f64; 2],
    /// The kinds of blur, that of the largest area first. If each image has a blur that the other does not,
    /// both blurs are listed, one after the other, with the same share.
    pub blurs: [Blur; PHASESTEREO_MOST_BLURS],
    /// Number of kinds of blur; 0: blur was not estimated.
    pub num_blurs: u32,
    /// Number of blocks of the images that agree with the field; 0: no field.
    pub rows_blocks: u32,
    /// 1: the right image was straightened by the field.
    pub rows_applied: u32,
    /// Smallest disparity to search.
    pub min_disparity: i32,
    /// Number of disparities to search.
    pub num_disparities: i32,
    /// Origin of the disparities: `PHASESTEREO_GIVEN`, `PHASESTEREO_FOUND` or `PHASESTEREO_DEFAULT`.
    pub origin: u32,
    /// 1: left and right are swapped: nearly all disparities are negative, and the scene confirms it.
    pub swapped: u32,
    /// 1: many disparities of either sign are clearly not zero.
    pub mixed: u32,
    /// 1: the images match only after one of them is inverted.
    pub inverted: u32,
    /// Largest offset of a row from the field, pixels, as with a shaking rolling shutter; 0: rows do not
    /// sway. The right image was straightened by both.
    pub rows_sway: f64,
    /// 1: the right camera is below the left one, as given or found, and columns are matched: left pixel (x,
    /// y) corresponds to right pixel (x, y - d). All other estimates describe the images turned by 90 degrees
    /// counterclockwise.
    pub vertical: u32,
}

// SAFETY: it begins with its size; all others are numbers.
unsafe impl Growing for Found {
    const LEAST: usize = size_of::<usize>();
}

impl Found {
    /// The estimates for C; `is_given`: the caller gave the disparities.
    pub fn new(estimates: &Estimates, is_given: bool) -> Self {
        let Estimates { range, offsets, blur, .. } = estimates;
        let blurs = blur.as_ref().map(blurs).unwrap_or_default();

        // Numbers that were not estimated are NaN.
        let of_range = |value: fn(&_) -> f64| range.as_ref().map_or(f64::NAN, value);
        let of_rows = |value: fn(&_) -> f64| offsets.as_ref().map_or(f64::NAN, value);
        let of_blur = |value: fn(&_) -> f64| blur.as_ref().map_or(f64::NAN, value);
        let of_both = |value: fn(&BlurEstimate) -> [f64; 2]| blur.as_ref().map_or([f64::NAN; 2], value);

        Self {
            struct_size: size_of::<Self>(),
            confidence: estimates.confidence.unwrap_or(f64::NAN),
            low: of_range(|range: &SearchRange| range.low),
            high: of_range(|range| range.high),
            rows: offsets.as_ref().map_or([f64::NAN; TERMS], |rows| *rows.field.coefficients()),
            rows_rms: of_rows(|rows: &RowOffsets| rows.field.rms()),
            rows_error: of_rows(|rows| rows.error),
            rows_spread: of_rows(|rows| rows.spread),
            certainty: of_blur(|blur: &BlurEstimate| blur.certainty.into()),
            contrast: of_blur(|blur| blur.gain),
            noise: of_both(|blur| blur.noise),
            impulses: of_both(|blur| blur.impulses),
            coding: of_both(|blur| blur.coding),
            blurs: array::from_fn(|index| blurs.get(index).copied().unwrap_or_default()),
            num_blurs: blurs.len() as u32,
            rows_blocks: offsets.as_ref().map_or(0, |rows| rows.blocks as u32),
            rows_applied: estimates.alignment.is_some().into(),
            min_disparity: estimates.candidates.value.min() as i32,
            num_disparities: estimates.candidates.value.count() as i32,
            origin: match range {
                _ if is_given => PHASESTEREO_GIVEN,
                Some(_) => PHASESTEREO_FOUND,
                None => PHASESTEREO_DEFAULT,
            },
            swapped: range.as_ref().is_some_and(SearchRange::is_swapped).into(),
            mixed: range.as_ref().is_some_and(|range| range.mixed).into(),
            inverted: estimates.is_inverted.into(),
            rows_sway: of_rows(|rows| rows.field.largest_sway()),
            vertical: estimates.is_vertical().into(),
        }
    }
}

/// The kinds of blur with their shares of the image; for a kind that both images have, both blurs with the
/// same share.
fn blurs(estimate: &BlurEstimate) -> Vec<Blur> {
    let mut blurs = vec![];
    for (kind, share) in estimate.blurs.iter().zip(estimate.shares()) {
        let own = Blur { share, ..Blur::new(kind) };
        blurs.push(own);
        if let Some(psf) = kind.other {
            let side = PHASESTEREO_LEFT + PHASESTEREO_RIGHT - own.side;
            blurs.push(Blur { side, ..Blur::of_psf(psf, own) });
        }
    }

    // A kind of both images is the only one; disks that follow depth may be more numerous.
    blurs.truncate(PHASESTEREO_MOST_BLURS);
    blurs
}

impl Blur {
    /// A kind of blur, with an unknown share so far.
    fn new(blur: &found::Blur) -> Self {
        let (kind, size, angle) = match (blur.psf, &blur.taps) {
            (Some(psf), _) => (kind(psf.family), psf.size, psf.angle),
            (None, Some(taps)) => (PHASESTEREO_OTHER, taps.radius(), 0.0),
            (None, None) => (PHASESTEREO_NO_BLUR, 0.0, 0.0),
        };

        let softer = match blur.side {
            None => PHASESTEREO_NEITHER,
            Some(Side::Left) => PHASESTEREO_LEFT,
            Some(Side::Right) => PHASESTEREO_RIGHT,
        };

        Self { size, angle, share: 0.0, side: softer, kind }
    }

    /// The blur of a family; other fields are copied from another one.
    fn of_psf(psf: Psf, like: Self) -> Self {
        Self { size: psf.size, angle: psf.angle, kind: kind(psf.family), ..like }
    }
}

/// The families of the core by their numbers.
const KINDS: [u32; 4] = [PHASESTEREO_GAUSSIAN, PHASESTEREO_DISK, PHASESTEREO_MOTION, PHASESTEREO_ANNULUS];

fn kind(family: Family) -> u32 {
    KINDS.get(family.number()).copied().unwrap_or(PHASESTEREO_OTHER)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_the_families_by_name() {
        let families = Family::all().map(|family| (kind(family), family.traits().name));
        let names = ["gaussian", "disk", "motion", "annulus"];
        assert!(families.eq(KINDS.into_iter().zip(names)));
    }

    #[test]
    fn blurs_of_both_images_follow_one_another() {
        let (left, right) = (Psf::motion(15.0, 30.0), Psf::motion(9.0, 120.0));
        let both = found::Blur {
            side: Some(Side::Left),
            psf: Some(left),
            taps: Some(left.taps()),
            other: Some(right),
        };
        let estimate = BlurEstimate { blurs: vec![both], ..BlurEstimate::unknown((64, 64)) };

        let listed = blurs(&estimate);
        let seen = listed.iter().map(|blur| (blur.side, blur.kind, blur.size, blur.angle, blur.share));
        let expected = [
            (PHASESTEREO_LEFT, PHASESTEREO_MOTION, 15.0, 30.0, 1.0),
            (PHASESTEREO_RIGHT, PHASESTEREO_MOTION, 9.0, 120.0, 1.0),
        ];
        assert!(seen.eq(expected));
    }
}
