//! The search for the blurs that explain pairs of blocks: over the whole bank if needed, otherwise over a
//! small part of it.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::bank::{Side, bank, probes};
use super::fit::{BlurEvidence, BlurFit};
use super::regions::{WORTH, first};
use super::response::Response;
use super::spectrum::Powers;
use phasestereo_match::base::simd::Level;

/// Least loss of choices that are not tried, nepers: about that of a blur of the wrong side. With 4, a few
/// blocks that do not show exactly the same things outweigh all others.
const UNTRIED: f32 = 1.0;
/// An image is softer if it is missing this much more power than the other one, nepers. In blocks of little
/// contrast, either may seem to miss a little. Without this, `phasestereo bench blur` finds a second kind of
/// blur in many trials.
const CLEAR: f32 = 0.3;
/// Blocks that the first blur explains are tried with all others if one of a few of these is better by this,
/// nepers. The gain of a further blur on the other blocks is far below the required one (see `regions`), and
/// half the number is tried compared with 0.
const BETTER: f32 = 0.02;

/// Least mean gain of a few blurs on a sample of blocks that are sharp together, nepers, for which all blocks
/// are examined: a quarter of the required gain of a kind, since a sample may show less than its share.
const GLANCE: f32 = 0.25 * WORTH;

/// A hypothesis about the blur: blur of one image, or none.
#[derive(Debug, Clone, Copy)]
pub struct Choice<'a> {
    /// The softer image; `None`: both are alike.
    pub side: Option<Side>,
    /// The share of the power that the blur leaves.
    pub response: &'a Response,
}

impl Choice<'static> {
    /// Choice 0 means no blur; then come all blurs of the bank for the left image, then for the right one.
    pub fn at(index: usize) -> Self {
        let Some(blurred) = index.checked_sub(1) else {
            return Self { side: None, response: flat() };
        };

        let side = if blurred < bank().len() { Side::Left } else { Side::Right };
        Self { side: Some(side), response: &bank()[blurred % bank().len()].response }
    }
}

/// The response of no blur.
pub fn flat() -> &'static Response {
    static FLAT: OnceLock<Response> = OnceLock::new();
    FLAT.get_or_init(Response::flat)
}

/// The evidence of a pair of blocks.
pub struct BlockPair {
    /// The evidence for a blur of the left one and for one of the right one.
    pub evidence: [BlurEvidence; 2],
    /// The fits of no blur to each of them.
    unblurred: [BlurFit; 2],
}

impl BlockPair {
    /// The evidence of these powers, given the powers of the noise of both images.
    pub fn new(powers: &Powers, noise: [f32; 2], level: Level) -> Self {
        let evidence = BlurEvidence::of_both(powers, noise, level);
        let unblurred = evidence.each_ref().map(|evidence| evidence.fit(flat(), level));

        Self { evidence, unblurred }
    }

    /// The fit of no blur, with the mean loss of both directions: missing power of one block may look like
    /// noise of the other one, but not both ways.
    pub fn none(&self) -> BlurFit {
        let [mut left, right] = self.unblurred;
        left.loss = 0.5 * (left.loss + right.loss);
        left
    }

    /// The loss of a choice.
    pub fn loss(&self, choice: Choice, level: Level) -> f32 {
        choice
            .side
            .map_or(self.none().loss, |side| self.evidence[side.index()].fit(choice.response, level).loss)
    }

    /// The losses of all choices. Blurs of an image that is clearly missing less power than the other one are
    /// not tried.
    pub fn losses(&self, level: Level) -> Vec<f32> {
        let none = self.none().loss;
        let mut losses = vec![none];
        for (evidence, tried) in self.evidence.iter().zip(self.may_be_softer()) {
            if tried {
                let responses = bank().iter().map(|entry| &entry.response);
                let tried = evidence.losses(responses, level);
                losses.extend(tried.iter().zip(bank()).map(|(loss, entry)| loss + entry.psf.prior()));
            } else {
                losses.extend(vec![none.max(UNTRIED); bank().len()]);
            }
        }

        losses
    }

    /// The least loss of a few blurs.
    fn least_of_probes(&self, level: Level) -> f32 {
        let tried = self.evidence.iter().zip(self.may_be_softer()).filter(|(_, tried)| *tried);
        let losses = tried
            .flat_map(|(evidence, _)| evidence.losses(probes().iter().map(|entry| &entry.response), level));
        losses.fold(f32::INFINITY, f32::min)
    }

    /// How much better the best of a few blurs is than none, minus the effect of chance.
    fn worth(&self, level: Level) -> f32 {
        (self.none().loss - self.least_of_probes(level) - BETTER).max(0.0)
    }

    /// Whether the left and the right block may be the softer one.
    fn may_be_softer(&self) -> [bool; 2] {
        // Missing power is relative to the other image, so the two have nearly opposite signs.
        let [left, right] = self.unblurred.map(|fit| fit.lack);

        [right - left <= CLEAR, left - right <= CLEAR]
    }

    /// The losses of all choices. If none of a few blurs is better than the first choice, only this and none
    /// are tried.
    fn losses_unless_explained(&self, first: usize, level: Level) -> Vec<f32> {
        let own = self.loss(Choice::at(first), level);
        if self.least_of_probes(level) < own - BETTER {
            return self.losses(level);
        }
        self.losses_of(first, level)
    }

    /// The losses if only one choice and none are tried.
    fn losses_of(&self, choice: usize, level: Level) -> Vec<f32> {
        let own = self.loss(Choice::at(choice), level);
        // Choices that are not tried must not look better than those that are.
        let mut losses = vec![own.max(UNTRIED); 1 + 2 * bank().len()];
        (losses[0], losses[choice]) = (self.none().loss, own);

        losses
    }
}

/// The losses of all choices on many pairs of blocks. Unless all blocks together are sharp, blocks of a
/// sample are tried with all choices; the others only if some blur explains them better than the one that
/// explains the sample best. If they are sharp, and a few blurs do not help the sample either, no blur is
/// tried.
pub fn searched(all: &[BlockPair], is_sample: &[bool], is_sharp: bool, level: Level) -> Vec<Vec<f32>> {
    if is_sharp {
        let sample: Vec<&BlockPair> =
            all.iter().zip(is_sample).filter(|(_, is_one)| **is_one).map(|(one, _)| one).collect();
        let worth: Vec<f32> = sample.par_iter().map(|blocks| blocks.worth(level)).collect();
        let is_all_sharp = worth.iter().sum::<f32>() < GLANCE * sample.len() as f32;

        let losses = |blocks: &BlockPair| {
            if is_all_sharp { blocks.losses_of(0, level) } else { blocks.losses_unless_explained(0, level) }
        };
        return all.par_iter().map(losses).collect();
    }

    let of_sample: Vec<Option<Vec<f32>>> = all
        .par_iter()
        .zip(is_sample)
        .map(|(blocks, is_sample)| is_sample.then(|| blocks.losses(level)))
        .collect();

    // The blur that explains the sample best explains most of the others, too.
    let first = first(of_sample.iter().flatten().map(Vec::as_slice)).unwrap_or(0);

    let of_others = all.par_iter().zip(of_sample);
    of_others
        .map(|(blocks, tried)| tried.unwrap_or_else(|| blocks.losses_unless_explained(first, level)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::bins::bins;
    use super::super::psf::Psf;
    use super::super::response::response;
    use super::*;

    /// Powers of a pair whose left block is blurred by an entry of the bank, or not.
    fn spectra(blur: Option<usize>, noise: f32) -> Powers {
        let scene: Vec<f32> = (0..bins().count()).map(|bin| 400.0 / (1.0 + bin as f32)).collect();

        let soft = match blur {
            Some(entry) => {
                let psf = bank()[entry].psf;
                let left = response(&psf.taps(), Level::best());
                scene.iter().zip(&left.values).map(|(power, left)| power * left).collect()
            }
            None => scene.clone(),
        };

        let seen = |all: Vec<f32>| all.into_iter().map(|power| power + noise).collect();
        Powers { binned: [seen(soft), seen(scene)], least_high: [0.0; 2] }
    }

    fn swapped(powers: &Powers) -> Powers {
        let [left, right] = powers.binned.clone();
        Powers { binned: [right, left], least_high: powers.least_high }
    }

    fn losses(powers: &Powers, noise: [f32; 2]) -> Vec<f32> {
        BlockPair::new(powers, noise, Level::best()).losses(Level::best())
    }

    #[test]
    fn losses_of_swapped_blocks_are_swapped() {
        let count = bank().len();
        for (blur, noise) in [(None, [0.1, 0.1]), (Some(4), [0.1, 3.0]), (Some(40), [2.0, 0.1])] {
            let pair = spectra(blur, 0.1);
            let [left, right] = noise;
            let (losses, others) = (losses(&pair, noise), losses(&swapped(&pair), [right, left]));

            assert_eq!(losses[..1], others[..1]);
            assert_eq!(losses[1..=count], others[count + 1..]);
            assert_eq!(losses[count + 1..], others[1..=count]);
        }
    }

    #[test]
    fn blurs_of_the_clearly_sharper_image_are_not_tried() {
        let count = bank().len();
        let disk = bank().iter().position(|entry| entry.psf == Psf::disk(2.0));

        let soft = losses(&spectra(disk, 0.1), [0.1; 2]);
        assert!(soft[1..=count].iter().all(|loss| *loss <= 2.0));
        assert!(soft[count + 1..].iter().all(|loss| loss.to_bits() == soft[0].max(UNTRIED).to_bits()));

        let alike = losses(&spectra(None, 0.1), [0.1; 2]);
        let untried = alike[0].max(UNTRIED).to_bits();
        assert!(alike[1..].iter().all(|loss| loss.to_bits() != untried), "neither is");
    }

    #[test]
    fn the_best_of_the_sample_is_tried_first_and_all_where_it_fails() {
        let disk = bank().iter().position(|entry| entry.psf == Psf::disk(2.0));
        let disk = 1 + disk.expect("there are disks");

        let level = Level::best();
        for (usual, odd) in [(None, Some(disk - 1)), (Some(disk - 1), None)] {
            let blocks =
                [usual, usual, usual, odd].map(|blur| BlockPair::new(&spectra(blur, 0.1), [0.1; 2], level));

            let found = searched(&blocks, &[true, true, false, false], false, level);
            assert_eq!(found[0], blocks[0].losses(level));
            assert_eq!(found[3], blocks[3].losses(level), "it is not explained");

            let first = usual.map_or(0, |entry| entry + 1);
            for (choice, loss) in found[2].iter().enumerate() {
                let is_tried = choice == 0 || choice == first;
                let expected = if is_tried { found[0][choice] } else { UNTRIED };
                assert_eq!(loss.to_bits(), expected.to_bits(), "{choice}");
            }
        }
    }

    #[test]
    fn where_all_blocks_together_are_sharp_the_bank_is_tried_on_those_that_are_not() {
        let disk = bank().iter().position(|entry| entry.psf == Psf::disk(2.0));
        let level = Level::best();
        let blocks = [None, disk].map(|blur| BlockPair::new(&spectra(blur, 0.1), [0.1; 2], level));

        let found = searched(&blocks, &[true, true], true, level);
        assert_eq!(found[1], blocks[1].losses(level));
        assert!(found[0][1..].iter().all(|loss| loss.to_bits() == UNTRIED.to_bits()));

        // If a sample is sharp, too, no blur is tried.
        let found = searched(&blocks, &[true, false], true, level);
        assert!(found.iter().all(|losses| losses[1..].iter().all(|loss| *loss >= UNTRIED)));
    }
}
