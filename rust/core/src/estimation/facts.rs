//! What is known of a pair before it is matched, and where that comes from.
//!
//! A caller states some facts, an earlier frame of the same cameras shows others, a copy of half the size has
//! those of the pair. [`super::complete`] estimates what is missing. It never changes a fact that it gets,
//! nor the settings.
//!
//! Explanations of what the images show compete by their evidence: the logarithm of the probability of the
//! observations under one explanation, less that under another, in nats. An explanation with more parameters
//! pays for each with half the logarithm of the number of observations (Schwarz: *Estimating the dimension of
//! a model*, Annals of Statistics 6, 1978).

use phasestereo_match::base::math;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::pair::candidates::Candidates;

/// Evidence over "nothing is wrong" from which on a fault is compensated for, nats. Of 60 pairs of 12 scenes
/// whose rows do not sway (sharp, noisy, compressed, turned, with keystone) none has more than 2.6 for a
/// spline of the row; where rows sway by 1 px, all have 27 and more.
pub const SUFFICIENT: f64 = 10.0;
/// Blocks of rows overlap and share their errors: of 60 to 2000, this number counts as independent. Not swept;
/// with it, two cameras have to leave less than .69 of what a field of offsets leaves.
pub const INDEPENDENT: usize = 60;

/// Where a fact comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// The caller states it.
    Given,
    /// It was estimated from this pair.
    Estimated,
    /// Earlier frames of the same cameras have shown it.
    Remembered,
    /// It is that of the same pair at another size.
    Scaled,
}

/// Something that is known of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Fact<T> {
    /// What is known.
    pub value: T,
    /// Where it comes from.
    pub origin: Origin,
}

/// How the rows of a pair correspond.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Rows {
    /// It is not known: estimated if the settings ask for it.
    #[default]
    Unknown,
    /// It is to be estimated, whatever the settings ask for.
    Wanted,
    /// By this field of vertical offsets; `None`: they are aligned.
    Known(Box<Fact<Option<Alignment>>>),
}

impl Rows {
    /// Rows of which this is known.
    pub fn known(fact: Fact<Option<Alignment>>) -> Self {
        Self::Known(Box::new(fact))
    }
}

/// Along what things move from one image to the other by their distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Along rows: the cameras are beside each other.
    Rows,
    /// Along columns: the right camera is below the left one.
    Columns,
}

/// What is known of a pair.
#[derive(Debug, Clone, Default)]
pub struct Facts {
    /// Along what things move by their distance; `None`: along rows, unless the images show clearly that it
    /// is along columns. A pair that moves along columns is turned before it is looked at ([`Facts::turns`]).
    pub axis: Option<Fact<Direction>>,
    /// The disparities to search.
    pub candidates: Option<Fact<Candidates>>,
    /// Standard deviations of the noise, left and right.
    pub noise: Option<[f64; 2]>,
    /// How blur is compensated for before pixels are compared; where it is known, neither blur nor noise is
    /// estimated.
    pub compensation: Option<BlurCompensation>,
    /// How rows correspond.
    pub rows: Rows,
    /// Whether the images match once one of them is inverted.
    pub is_inverted: bool,
}

impl<T> Fact<T> {
    /// What the caller states.
    pub fn given(value: T) -> Self {
        Self { value, origin: Origin::Given }
    }

    /// What was estimated from this pair.
    pub fn estimated(value: T) -> Self {
        Self { value, origin: Origin::Estimated }
    }

    /// What earlier frames have shown.
    pub fn remembered(value: T) -> Self {
        Self { value, origin: Origin::Remembered }
    }

    /// What the same pair has at another size.
    pub fn scaled(value: T) -> Self {
        Self { value, origin: Origin::Scaled }
    }
}

impl Facts {
    /// The disparities to search, if they are known.
    pub fn searched(&self) -> Option<Candidates> {
        self.candidates.as_ref().map(|known| known.value)
    }

    /// How rows correspond, if that is known.
    pub fn aligned(&self) -> Option<&Option<Alignment>> {
        match &self.rows {
            Rows::Known(known) => Some(&known.value),
            Rows::Unknown | Rows::Wanted => None,
        }
    }

    /// Whether pairs are to be turned: things move along their columns.
    pub fn turns(&self) -> bool {
        self.axis.as_ref().is_some_and(|axis| axis.value == Direction::Columns)
    }

    /// The same for who searches rows alone, whatever the images show.
    pub fn along_rows(&self) -> Self {
        Self { axis: Some(Fact::given(Direction::Rows)), ..self.clone() }
    }

    /// Whether something is known of the images that would not hold once they are resampled.
    pub fn is_of_these_pixels(&self) -> bool {
        self.aligned().is_some_and(Option::is_some) || self.compensation.is_some()
    }
}

/// The evidence for an explanation that leaves residuals of standard deviation `after` over one that leaves
/// `before`, nats: it has more parameters, by `parameters`, and independent observations with normal errors
/// distinguish them.
///
/// ```text
/// nats = observations ln(before / after) - parameters / 2 ln(observations)
/// ```
pub fn evidence(before: f64, after: f64, parameters: usize, observations: usize) -> f64 {
    let count = observations.max(1) as f64;
    count * math::ln(before / after) - parameters as f64 / 2.0 * math::ln(count)
}
