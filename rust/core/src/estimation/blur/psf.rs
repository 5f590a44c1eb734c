//! Point-spread functions of lenses and shutters, and the table of their families.
//!
//! The bank, its refinement, priors, findings, the text of a rig and the faces loop over the table: to add a
//! family, add a row to it, and a kernel in [`super::taps`].

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::taps::{Taps, annulus, gaussian, motion};

/// A family of point-spread functions: a row of `TABLE`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[repr(usize)]
pub enum Family {
    /// Gaussian; the size is its standard deviation.
    Gaussian,
    /// Defocus of a round aperture; the size is the disk's radius.
    Disk,
    /// Straight motion at constant speed; the size is its length; 1: no blur.
    Motion,
    /// Defocus of a round aperture with a covered middle, as by the small mirror of a mirror lens; the size
    /// is the outer radius.
    Annulus,
}

/// A point-spread function of a family.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Psf {
    /// Its family.
    pub family: Family,
    /// Its size, pixels.
    pub size: f64,
    /// Direction of a motion, degrees from x toward y; 0 for others.
    pub angle: f64,
    /// Inner radius of an annulus as a share of the outer one; 0 for others.
    pub inner: f64,
}

/// Properties of a family.
#[derive(Debug)]
pub struct FamilyTraits {
    /// Its name.
    pub name: &'static str,
    /// Words in a sentence for one blur of it, with holes `{size}` and `{angle}`.
    pub words: &'static str,
    /// The same for blurs of one image whose sizes follow depth, with holes `{least}` and `{largest}`;
    /// `None`: sizes do not.
    pub by_depth: Option<&'static str>,
    /// Whether it comes from the focus; otherwise from motion during the exposure.
    pub is_of_focus: bool,
    /// The smallest size, pixels, that leaves nothing finer in any direction; `None`: something is always
    /// left.
    pub wide: Option<f64>,
    /// Sizes in the bank, pixels.
    sizes: &'static [f64],
    /// The largest size, pixels: blocks are too small for kernels that are larger than half of them.
    largest: f64,
    /// The parameter besides the size.
    shape: Shape,
    /// The evidence it requires; `None`: the same as other families.
    pub rarity: Option<Rarity>,
    /// Sizes that are tried when only a few entries of the bank are used, and the step between shapes.
    probes: (&'static [f64], usize),
    taps: fn(&Psf) -> Taps,
    spread: fn(&Psf) -> f64,
}

/// A parameter besides the size: its values in the bank.
#[derive(Debug)]
enum Shape {
    /// No blur.
    None,
    /// A direction, degrees.
    Angle(&'static [f64]),
    /// The covered share of the radius: the bank's values, and the range. A smaller hole hardly makes a
    /// difference.
    Inner(&'static [f64], RangeInclusive<f64>),
}

/// How much better a rare family has to explain the evidence than the others.
#[derive(Debug)]
pub struct Rarity {
    /// The addition to its loss in the bank, nepers.
    pub prior: f32,
    /// The largest ratio of its loss to that of all other families.
    pub share: f32,
}

/// First step of the size, as a share of it; of a covered share, half of that.
const STEP: f64 = 0.2;
/// First step of the direction, degrees.
const TURN: f64 = 8.0;

/// The families, by their numbers.
static TABLE: [FamilyTraits; 4] = [
    FamilyTraits {
        name: "gaussian",
        words: "a Gaussian of sigma {size} px",
        by_depth: None,
        is_of_focus: true,
        wide: Some(2.25),
        sizes: &[1.0, 1.5, 2.0, 3.0, 4.0, 5.5, 7.0],
        largest: 8.0,
        shape: Shape::None,
        rarity: None,
        probes: (&[], 1),
        taps: |psf| gaussian(psf.size),
        spread: |psf| psf.size,
    },
    FamilyTraits {
        name: "disk",
        words: "a disk of radius {size} px",
        by_depth: Some("disks of radius {least} to {largest} px"),
        is_of_focus: true,
        wide: None,
        sizes: &[2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0],
        largest: 14.0,
        shape: Shape::None,
        rarity: None,
        probes: (&[2.0, 4.0, 8.0], 1),
        taps: |psf| annulus(psf.size, 0.0),
        spread: |psf| psf.size / 2.0,
    },
    FamilyTraits {
        name: "motion",
        words: "a motion of {size} px at {angle} degrees",
        by_depth: None,
        is_of_focus: false,
        wide: None,
        sizes: &[5.0, 7.0, 9.0, 11.0, 13.0, 15.0, 18.0, 21.0, 25.0],
        largest: 31.0,
        // A motion of 180 degrees is that of 0.
        shape: Shape::Angle(&[0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0, 105.0, 120.0, 135.0, 150.0, 165.0]),
        rarity: None,
        probes: (&[5.0, 9.0, 15.0], 2),
        taps: |psf| motion(psf.size, psf.angle),
        spread: |psf| (psf.size - 1.0) / 24f64.sqrt(),
    },
    FamilyTraits {
        name: "annulus",
        words: "an annulus of outer radius {size} px",
        by_depth: None,
        is_of_focus: true,
        wide: None,
        sizes: &[3.0, 4.0, 5.0, 6.0, 8.0, 10.0],
        largest: 14.0,
        shape: Shape::Inner(&[0.5, 0.75], 0.4..=0.9),
        // Lenses with a covered middle are rare, and the many zeros of annuli resemble those that compression
        // leaves of a blur, and areas with several blurs. True annuli have about a third of the loss of the
        // best disk, mistaken ones more than two thirds.
        rarity: Some(Rarity { prior: 0.1, share: 0.5 }),
        probes: (&[4.0, 6.0], 1),
        taps: |psf| annulus(psf.size, psf.inner),
        spread: |psf| psf.size / 2.0 * (1.0 + psf.inner * psf.inner).sqrt(),
    },
];

impl Family {
    /// All families, by their numbers.
    pub fn all() -> impl Iterator<Item = Self> {
        [Self::Gaussian, Self::Disk, Self::Motion, Self::Annulus].into_iter()
    }

    /// Its number.
    pub fn number(self) -> usize {
        self as usize
    }

    /// The family of a number; `None` beyond the last.
    pub fn of_number(number: usize) -> Option<Self> {
        Self::all().nth(number)
    }

    /// Its row of the table.
    pub fn traits(self) -> &'static FamilyTraits {
        &TABLE[self.number()]
    }

    /// The members in the bank with the wanted sizes, shape by shape.
    fn grid(self, is_wanted: impl Fn(f64) -> bool) -> impl Iterator<Item = Psf> {
        let FamilyTraits { sizes, shape, .. } = self.traits();
        let round = move |size: f64| Psf { family: self, size, angle: 0.0, inner: 0.0 };
        let members = sizes.iter().copied().filter(move |size| is_wanted(*size));
        members.flat_map(move |size| {
            let (angles, inners): (&[f64], &[f64]) = match shape {
                Shape::None => (&[0.0], &[0.0]),
                Shape::Angle(angles) => (angles, &[0.0]),
                Shape::Inner(inners, _) => (&[0.0], inners),
            };
            let with_angle = move |angle: &f64| Psf { angle: *angle, ..round(size) };
            let turned = angles.iter().map(with_angle);
            turned.flat_map(move |psf| inners.iter().map(move |inner| Psf { inner: *inner, ..psf }))
        })
    }

    /// Its members in the bank.
    pub fn members(self) -> impl Iterator<Item = Psf> {
        self.grid(|_| true)
    }

    /// Some of them, to check for any blur.
    pub fn probes(self) -> impl Iterator<Item = Psf> {
        let (sizes, step) = self.traits().probes;
        self.grid(|size| sizes.contains(&size)).step_by(step)
    }

    /// Whether the parameters of a member are within their ranges.
    pub fn contains(self, psf: &Psf) -> bool {
        let FamilyTraits { largest, shape, .. } = self.traits();
        let has_shape = match shape {
            Shape::Inner(_, range) => range.contains(&psf.inner),
            Shape::None | Shape::Angle(_) => true,
        };
        psf.size <= *largest && has_shape
    }
}

impl Psf {
    /// A Gaussian of a standard deviation.
    pub fn gaussian(sigma: f64) -> Self {
        Self { family: Family::Gaussian, size: sigma, angle: 0.0, inner: 0.0 }
    }

    /// A disk of a radius.
    pub fn disk(radius: f64) -> Self {
        Self { family: Family::Disk, size: radius, angle: 0.0, inner: 0.0 }
    }

    /// Motion in a direction.
    pub fn motion(length: f64, angle: f64) -> Self {
        Self { family: Family::Motion, size: length, angle, inner: 0.0 }
    }

    /// An annulus between two radii, the inner one as a share of the outer one.
    pub fn annulus(radius: f64, inner: f64) -> Self {
        Self { family: Family::Annulus, size: radius, angle: 0.0, inner }
    }

    /// The kernel: a Gaussian cut at four standard deviations, a disk or an annulus integrated over each
    /// pixel, a path whose samples are split bilinearly over their four pixels.
    pub fn taps(&self) -> Taps {
        (self.family.traits().taps)(self)
    }

    /// Root mean square distance from the center along one axis, averaged over the directions, pixels. It
    /// makes sizes of different families comparable.
    pub fn spread(&self) -> f64 {
        (self.family.traits().spread)(self)
    }

    /// The addition to its loss in the bank, nepers: more for a rare family.
    pub fn prior(&self) -> f32 {
        self.family.traits().rarity.as_ref().map_or(0.0, |rarity| rarity.prior)
    }

    /// Whether it leaves nothing fine in any direction.
    pub fn is_wide(&self) -> bool {
        self.family.traits().wide.is_some_and(|least| self.size >= least)
    }

    /// The blur in words.
    pub fn words(&self) -> String {
        let words = self.family.traits().words;
        let words = words.replace("{size}", &format!("{:.1}", self.size));
        words.replace("{angle}", &format!("{:.0}", self.angle))
    }

    /// The blurs that differ from this one by a step in one parameter, within its range. Steps have been
    /// halved this many times.
    pub fn steps(self, halvings: u32) -> impl Iterator<Item = Self> {
        // The steps of both parameters shrink together.
        let scale = 1.0 / f64::from(1u32 << halvings);
        let (grow, turn) = (STEP * scale, TURN * scale);

        let sizes = [1.0 - grow, 1.0 + grow].map(|factor| Self { size: self.size * factor, ..self });
        let shapes = [1.0, -1.0].map(|sign| match self.family.traits().shape {
            Shape::None => None,
            Shape::Angle(_) => Some(Self { angle: (self.angle + sign * turn).rem_euclid(180.0), ..self }),
            Shape::Inner(..) => Some(Self { inner: self.inner + sign * grow / 2.0, ..self }),
        });
        let all = sizes.into_iter().chain(shapes.into_iter().flatten());
        all.filter(move |psf| self.family.contains(psf))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn psfs() -> impl Iterator<Item = Psf> {
        let sizes = [1.0, 1.3, 2.0, 3.7, 6.0, 8.0];
        let angles = [0.0, 17.0, 45.0, 90.0, 163.0];
        sizes.into_iter().flat_map(move |size| {
            let rounds = [Psf::gaussian(size), Psf::disk(size)];
            let annuli = [0.3, 0.5, 0.8].map(|inner| Psf::annulus(size, inner));
            let motions = angles.map(|angle| Psf::motion(size, angle));
            rounds.into_iter().chain(annuli).chain(motions)
        })
    }

    #[test]
    fn taps_have_the_sum_one_and_are_symmetric_about_the_center() {
        for psf in psfs() {
            let taps = psf.taps();
            assert!((taps.values.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{psf:?}");
            let mirrored = taps.values.iter().rev();
            assert!(taps.values.iter().zip(mirrored).all(|(a, b)| (a - b).abs() < 1e-12), "{psf:?}");
            assert_eq!(taps.values.len(), taps.side().pow(2));
        }
    }

    #[test]
    fn the_spread_is_that_of_the_taps_along_one_axis() {
        for psf in psfs() {
            // Splitting samples bilinearly, and pixels, have a spread of their own: at most a third of a
            // pixel.
            let along = psf.taps().radius() / 2f64.sqrt();
            assert!((along - psf.spread()).abs() < 0.35, "{psf:?}: {along}");
        }
    }

    #[test]
    fn angles_turn_from_x_towards_y() {
        let motion = |angle| Psf::motion(9.0, angle).taps();
        assert!(motion(0.0).places().all(|(dy, _, tap)| dy == 0 || tap == 0.0));
        assert!(motion(90.0).places().all(|(_, dx, tap)| dx == 0 || tap == 0.0));
        let slant: f64 = motion(45.0).places().map(|(dy, dx, tap)| (dy * dx) as f64 * tap).sum();
        assert!(slant > 1.0, "down to the right");
    }

    #[test]
    fn the_smallest_of_every_family_is_no_blur() {
        for psf in [
            Psf::gaussian(0.0),
            Psf::disk(0.01),
            Psf::motion(1.0, 30.0),
            Psf::motion(0.5, 30.0),
            Psf::annulus(0.01, 0.5),
        ] {
            let taps = psf.taps();
            let center = taps.values[taps.values.len() / 2];
            assert!((center - 1.0).abs() < 1e-12, "{psf:?} {taps:?}");
        }
    }

    #[test]
    fn families_have_numbers_and_names_of_their_own() {
        for (number, family) in Family::all().enumerate() {
            assert_eq!(family.number(), number);
            let same = Family::all().filter(|other| other.traits().name == family.traits().name);
            assert_eq!(same.count(), 1);
            let grid: Vec<Psf> = family.grid(|_| true).collect();
            assert!(grid.iter().all(|psf| psf.family == family && family.contains(psf)));
            assert!(family.grid(|_| false).count() == 0);
        }
        assert_eq!(Family::of_number(TABLE.len()), None);
    }

    #[test]
    fn steps_change_one_parameter_within_its_range() {
        let steps = |psf: Psf| psf.steps(0).collect::<Vec<_>>();
        assert_eq!(steps(Psf::gaussian(2.0)), [1.6, 2.4].map(Psf::gaussian));
        assert_eq!(steps(Psf::disk(14.0)), [Psf::disk(14.0 * 0.8)]);
        let turned = [Psf::motion(5.0, 7.0), Psf::motion(5.0, 171.0)];
        assert_eq!(steps(Psf::motion(5.0, 179.0))[2..], turned);
        assert_eq!(steps(Psf::annulus(5.0, 0.45))[2..], [Psf::annulus(5.0, 0.45 + 0.1)]);
    }
}
