//! Facts about a pair that are known before its match, and their origins.
//!
//! A caller states some facts, an earlier frame of the same cameras shows others, and a copy of half the size
//! has those of the pair. [`super::complete`] estimates missing ones. It never changes a given fact or the
//! settings.
//!
//! Explanations of the images compete by their evidence: the logarithm of the probability of the observations
//! under one explanation, minus that under another, in nats. An explanation with more parameters pays, for
//! each, half the logarithm of the number of observations (Schwarz: *Estimating the dimension of a model*,
//! Annals of Statistics 6, 1978).

use super::shared::Shared;
use phasestereo_match::base::math;
use phasestereo_match::pair::alignment::Alignment;
use phasestereo_match::pair::blur_compensation::BlurCompensation;
use phasestereo_match::pair::candidates::Candidates;

/// Least evidence against "nothing is wrong" for which a fault is compensated, nats. Of 60 pairs of 12 scenes
/// without swaying rows (sharp, noisy, compressed, turned, with keystone), none has more than 2.6 for a
/// spline of the row; where rows sway by 1 px, all have at least 27.
pub const SUFFICIENT: f64 = 10.0;
/// Blocks of rows overlap and share their errors: out of 60 to 2000, this number counts as independent. Not
/// swept; with it, two cameras have to leave less than .69 of the differences that a field of offsets leaves.
pub const INDEPENDENT: usize = 60;

/// The origin of a fact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// The caller states it.
    Given,
    /// It was estimated from this pair.
    Estimated,
    /// Earlier frames of the same cameras showed it.
    Remembered,
    /// It comes from the same pair at another size.
    Scaled,
}

/// A known fact about a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Fact<T> {
    /// Its value.
    pub value: T,
    /// Its origin.
    pub origin: Origin,
}

/// How the rows of a pair correspond.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Rows {
    /// Unknown: estimated if the settings ask for it.
    #[default]
    Unknown,
    /// To be estimated, whatever the settings.
    Wanted,
    /// By this field of vertical offsets; `None`: they are aligned.
    Known(Box<Fact<Option<Alignment>>>),
}

impl Rows {
    /// Rows with this known fact.
    pub fn known(fact: Fact<Option<Alignment>>) -> Self {
        Self::Known(Box::new(fact))
    }
}

/// The axis of the disparities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// Along rows: the cameras are beside each other.
    Rows,
    /// Along columns: the right camera is below the left one.
    Columns,
}

/// The known facts about a pair.
#[derive(Debug, Clone, Default)]
pub struct Facts {
    /// The axis of the disparities; `None`: along rows, unless the images clearly show that it is along
    /// columns. A pair with disparities along columns is turned before anything else ([`Facts::turns`]).
    pub axis: Option<Fact<Direction>>,
    /// The disparities to search.
    pub candidates: Option<Fact<Candidates>>,
    /// Standard deviations of the noise, left and right.
    pub noise: Option<[f64; 2]>,
    /// The blur compensation before pixels are compared; if it is known, neither blur nor noise is estimated.
    pub compensation: Option<BlurCompensation>,
    /// How rows correspond.
    pub rows: Rows,
    /// Whether the images match once one of them is inverted.
    pub is_inverted: bool,
    /// What both images show at the same place; it is subtracted.
    pub shared: Option<Shared>,
}

impl<T> Fact<T> {
    /// A fact that the caller states.
    pub fn given(value: T) -> Self {
        Self { value, origin: Origin::Given }
    }

    /// A fact that was estimated from this pair.
    pub fn estimated(value: T) -> Self {
        Self { value, origin: Origin::Estimated }
    }

    /// A fact from earlier frames.
    pub fn remembered(value: T) -> Self {
        Self { value, origin: Origin::Remembered }
    }

    /// A fact about the same pair at another size.
    pub fn scaled(value: T) -> Self {
        Self { value, origin: Origin::Scaled }
    }
}

impl Facts {
    /// The disparities to search, if known.
    pub fn searched(&self) -> Option<Candidates> {
        self.candidates.as_ref().map(|known| known.value)
    }

    /// How rows correspond, if known.
    pub fn aligned(&self) -> Option<&Option<Alignment>> {
        match &self.rows {
            Rows::Known(known) => Some(&known.value),
            Rows::Unknown | Rows::Wanted => None,
        }
    }

    /// Whether pairs are to be turned, since disparities are along their columns.
    pub fn turns(&self) -> bool {
        self.axis.as_ref().is_some_and(|axis| axis.value == Direction::Columns)
    }

    /// The same facts for matchers that only search rows, whatever the images show.
    pub fn along_rows(&self) -> Self {
        Self { axis: Some(Fact::given(Direction::Rows)), ..self.clone() }
    }

    /// Whether some fact about the images would no longer hold after resampling.
    pub fn is_of_these_pixels(&self) -> bool {
        self.aligned().is_some_and(Option::is_some) || self.compensation.is_some()
    }
}

/// The evidence, in nats, for an explanation that leaves residuals of standard deviation `after`, over one
/// that leaves `before` and has fewer parameters, by `parameters`; independent observations with normal
/// errors distinguish them.
///
/// ```text
/// nats = observations ln(before / after) - parameters / 2 ln(observations)
/// ```
pub fn evidence(before: f64, after: f64, parameters: usize, observations: usize) -> f64 {
    let count = observations.max(1) as f64;
    count * math::ln(before / after) - parameters as f64 / 2.0 * math::ln(count)
}
