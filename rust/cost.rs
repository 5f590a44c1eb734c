//! Two images -> one row of matching costs at a time: what it costs to match a pixel with a candidate.

use crate::candidates::Candidates;
use crate::control::Control;
use crate::descriptor::{Code, Codes, describe};
use crate::error::Result;
use crate::intensity::{LEVEL_CEILING, LEVEL_STEPS, gray_planes, level_planes};
use crate::normalisation::{DEVIATION_CEILING, DEVIATION_STEPS, normalise};
use crate::plane::Plane;
use crate::settings::{CostKind, Settings};
use crate::view::{Mask, View};

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
            let mut voting = vec![0; costs.len()];
            votes.write_row(y, &mut voting);
            costs.iter_mut().zip(voting).for_each(|(cost, vote)| *cost *= vote);
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
    let told = settings.intensity_range;
    let differences = |channels, ceiling, steps| {
        Box::new(AbsoluteDifferences::new(channels, candidates, ceiling, steps))
    };
    Ok(match settings.cost {
        CostKind::Phase => {
            let [left, right] = gray_planes(views, told, control)?;
            let codes = [describe(&left, settings, control)?, describe(&right, settings, control)?];
            phase(codes, candidates, settings.code_length() as u16)
        }
        CostKind::Sad => {
            let channels = level_planes(views, told, control)?;
            differences(channels, LEVEL_CEILING, LEVEL_STEPS)
        }
        CostKind::NormalisedSad => {
            let [left, right] = level_planes(views, told, control)?;
            let normalised = |side: Vec<Plane<u16>>| -> Result<Vec<_>> {
                side.iter().map(|plane| normalise(plane, settings.window, control)).collect()
            };
            let channels = [normalised(left)?, normalised(right)?];
            differences(channels, DEVIATION_CEILING, DEVIATION_STEPS)
        }
    })
}

/// Hamming distance of phase codes (paper, eq. 7; by Johnson codes also eq. 6 for any `b`).
struct PhaseDistance<C> {
    left: Plane<C>,
    right: Plane<C>,
    candidates: Candidates,
    code_length: u16,
}

fn phase(codes: [Codes; 2], candidates: Candidates, code_length: u16) -> Box<dyn Cost> {
    match codes {
        [Codes::U16(left), Codes::U16(right)] => {
            Box::new(PhaseDistance { left, right, candidates, code_length })
        }
        [Codes::U32(left), Codes::U32(right)] => {
            Box::new(PhaseDistance { left, right, candidates, code_length })
        }
        [left, right] => {
            let [left, right] = [left.widened(), right.widened()];
            Box::new(PhaseDistance { left, right, candidates, code_length })
        }
    }
}

impl<C: Code> Cost for PhaseDistance<C> {
    fn write_row(&self, y: usize, costs: &mut [u16]) {
        let right = self.candidates.unroll(self.right.row(y));
        for_each_pixel(self.candidates, self.left.row(y), &right, costs, |left, right, costs| {
            for (cost, code) in costs.iter_mut().zip(right) {
                *cost = left.distance(*code);
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
            let right = self.candidates.unroll(right.row(y));
            for_each_pixel(self.candidates, left.row(y), &right, costs, |left, right, costs| {
                for (cost, value) in costs.iter_mut().zip(right) {
                    *cost += left.abs_diff(*value);
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

/// Which (pixel, candidate) pairs may vote: those whose pixels are valid in both images.
#[derive(Debug)]
pub struct Votes<'a> {
    masks: [Option<&'a Mask>; 2],
    width: usize,
    candidates: Candidates,
}

impl<'a> Votes<'a> {
    /// The votes of a pair; `None` where both images are valid everywhere.
    pub fn new([left, right]: [&'a View; 2], candidates: Candidates) -> Option<Self> {
        let masks = [left.mask.as_ref(), right.mask.as_ref()];
        let width = left.image.shape().1;
        masks.iter().any(Option::is_some).then_some(Self { masks, width, candidates })
    }

    /// Whether the left pixel is masked.
    pub fn is_masked(&self, y: usize, x: usize) -> bool {
        self.masks[0].is_some_and(|mask| !mask.row(y)[x])
    }

    /// Writes 1 for each pair of row `y` that votes, else 0.
    pub fn write_row(&self, y: usize, votes: &mut [u16]) {
        let [left, right] = self.masks.map(|mask| match mask {
            Some(mask) => mask.row(y).to_vec(),
            None => vec![true; self.width],
        });
        let right = self.candidates.unroll(&right);
        for_each_pixel(self.candidates, &left, &right, votes, |left, right, votes| {
            for (vote, valid) in votes.iter_mut().zip(right) {
                *vote = u16::from(left && *valid);
            }
        });
    }
}

/// Hands every pixel's left value, the right values of its candidates and its places in `row` to `write`.
fn for_each_pixel<T: Copy>(
    candidates: Candidates,
    left: &[T],
    unrolled_right: &[T],
    row: &mut [u16],
    mut write: impl FnMut(T, &[T], &mut [u16]),
) {
    let count = candidates.count();
    for (x, (&left, places)) in left.iter().zip(row.chunks_exact_mut(count)).enumerate() {
        // The row is unrolled from its last pixel to its first.
        let first = unrolled_right.len() - count - x;
        write(left, &unrolled_right[first..][..count], places);
    }
}
