//! Two images -> one row of matching costs at a time: what it costs to match a pixel with a candidate.

use crate::candidates::Candidates;
use crate::control::Control;
use crate::descriptor::{Code, Codes, describe};
use crate::error::Result;
use crate::intensity::{LEVEL_CEILING, LEVEL_STEPS, gray_plane, level_planes};
use crate::normalisation::{DEVIATION_CEILING, DEVIATION_STEPS, normalise};
use crate::plane::Plane;
use crate::settings::{CostKind, Settings};
use crate::view::View;
use crate::votes::Votes;

/// Matching costs of a pair, a row at a time.
pub trait Cost: Sync {
    /// Writes the costs of row `y`, `width x candidates`, candidate innermost.
    fn write_row(&self, y: usize, costs: &mut [u16]);
    /// The largest cost there can be.
    fn ceiling(&self) -> u16;
    /// Steps of the cost per unit of the penalties.
    fn steps(&self) -> u16;
}

/// The costs of a pair, with the votes of masked pixels taken out.
pub struct Costs<'a> {
    cost: Box<dyn Cost>,
    votes: Option<Votes<'a>>,
}

impl<'a> Costs<'a> {
    /// The costs that the settings name, for checked views and settings.
    pub fn new(
        views: [&'a View; 2],
        candidates: Candidates,
        settings: &Settings,
        control: &Control,
    ) -> Result<Self> {
        let cost = prepare(views, candidates, settings, control)?;
        Ok(Self { cost, votes: Votes::new(views, candidates) })
    }

    /// Writes the costs of row `y`, `width x candidates`, candidate innermost; 0 where there is no vote.
    pub fn write_row(&self, y: usize, costs: &mut [u16]) {
        self.cost.write_row(y, costs);
        if let Some(votes) = &self.votes {
            votes.silence(y, costs);
        }
    }

    /// All rows at once, for those who want to look at them.
    pub fn volume(&self, rows: usize, row_length: usize, control: &Control) -> Result<Plane<u16>> {
        let mut volume = Plane::new(rows, row_length)?;
        for y in 0..rows {
            control.checkpoint()?;
            self.write_row(y, volume.row_mut(y));
        }
        Ok(volume)
    }

    /// Who may vote; `None`: everybody.
    pub fn votes(&self) -> Option<&Votes<'a>> {
        self.votes.as_ref()
    }

    /// The largest cost there can be.
    pub fn ceiling(&self) -> u16 {
        self.cost.ceiling()
    }

    /// Steps of the cost per unit of the penalties.
    pub fn steps(&self) -> u16 {
        self.cost.steps()
    }
}

fn prepare(
    views: [&View; 2],
    candidates: Candidates,
    settings: &Settings,
    control: &Control,
) -> Result<Box<dyn Cost>> {
    match settings.cost {
        CostKind::Phase => phase_distance(views, candidates, settings, control),
        CostKind::Sad => {
            let channels = level_planes(views, settings.intensity_range, control)?;
            Ok(Box::new(AbsoluteDifferences::new(channels, candidates, LEVEL_CEILING, LEVEL_STEPS)))
        }
        CostKind::NormalisedSad => {
            let [left, right] = level_planes(views, settings.intensity_range, control)?;
            let normalised = |side: Vec<Plane<u16>>| -> Result<Vec<_>> {
                side.iter().map(|plane| normalise(plane, settings.window, control)).collect()
            };
            let channels = [normalised(left)?, normalised(right)?];
            let (ceiling, steps) = (DEVIATION_CEILING, DEVIATION_STEPS);
            Ok(Box::new(AbsoluteDifferences::new(channels, candidates, ceiling, steps)))
        }
    }
}

/// Hamming distance of phase codes (paper, eq. 7; by Johnson codes also eq. 6 for any `b`).
struct PhaseDistance<C> {
    left: Plane<C>,
    right: Plane<C>,
    candidates: Candidates,
    code_length: u16,
}

fn phase_distance(
    views: [&View; 2],
    candidates: Candidates,
    settings: &Settings,
    control: &Control,
) -> Result<Box<dyn Cost>> {
    let code_length = settings.code_length() as u16;
    let codes = |view: &View| describe(&gray_plane(view, control)?, settings, control);
    Ok(match (codes(views[0])?, codes(views[1])?) {
        (Codes::U16(left), Codes::U16(right)) => {
            Box::new(PhaseDistance { left, right, candidates, code_length })
        }
        (Codes::U32(left), Codes::U32(right)) => {
            Box::new(PhaseDistance { left, right, candidates, code_length })
        }
        (left, right) => {
            let (left, right) = (left.widened(), right.widened());
            Box::new(PhaseDistance { left, right, candidates, code_length })
        }
    })
}

impl<C: Code> Cost for PhaseDistance<C> {
    fn write_row(&self, y: usize, costs: &mut [u16]) {
        let (left, right) = (self.left.row(y), self.right.row(y));
        self.candidates.pair_up(left, right, costs, |left, right, costs| {
            for (cost, right) in costs.iter_mut().zip(right) {
                *cost = left.distance(*right);
            }
        });
    }

    fn ceiling(&self) -> u16 {
        self.code_length
    }

    fn steps(&self) -> u16 {
        1
    }
}

/// Sum over the channels of absolute differences: the baseline of the paper's section 3.
struct AbsoluteDifferences {
    channels: Vec<(Plane<u16>, Plane<u16>)>,
    candidates: Candidates,
    ceiling: u16,
    steps: u16,
}

impl AbsoluteDifferences {
    fn new(
        [left, right]: [Vec<Plane<u16>>; 2],
        candidates: Candidates,
        ceiling: u16,
        steps: u16,
    ) -> Self {
        let channels: Vec<_> = left.into_iter().zip(right).collect();
        let ceiling = ceiling * channels.len() as u16;
        Self { channels, candidates, ceiling, steps }
    }
}

impl Cost for AbsoluteDifferences {
    fn write_row(&self, y: usize, costs: &mut [u16]) {
        costs.fill(0);
        for (left, right) in &self.channels {
            self.candidates.pair_up(left.row(y), right.row(y), costs, |left, right, costs| {
                for (cost, right) in costs.iter_mut().zip(right) {
                    *cost += left.abs_diff(*right);
                }
            });
        }
    }

    fn ceiling(&self) -> u16 {
        self.ceiling
    }

    fn steps(&self) -> u16 {
        self.steps
    }
}
