//! The kinds of blur in an image and their areas: the fewest kinds that explain the tiles, and a map without
//! specks.

use phasestereo_match::base::plane::around;

/// The loss of every choice on every tile: tiles by rows, choices innermost.
#[derive(Debug, Clone)]
pub struct Losses {
    /// Rows of tiles.
    pub rows: usize,
    /// Columns of tiles.
    pub cols: usize,
    /// Number of choices.
    pub choices: usize,
    /// The losses, nepers; all infinite for a tile without evidence.
    pub values: Vec<f32>,
}

/// Differences up to this, nepers, do not count toward a further choice: on sharp pairs some are better by
/// chance.
const MARGIN: f32 = 0.06;
/// ... and the mean excess over all tiles must be at least this, nepers: 1 % of the tiles, all explained as
/// badly as possible, or 10 % of them slightly.
pub const WORTH: f32 = 0.01;
/// Most choices.
const MOST: usize = 8;
/// Cost of a neighboring tile with another choice, nepers; half of it for diagonal ones. Twice this makes no
/// difference.
const BOUNDARY: f32 = 0.15;
/// Choices with a smaller share of the tiles are left out: the whole map would be redrawn for hardly any
/// pixels.
const LEAST_SHARE: f64 = 0.02;
/// Most rounds in which tiles adapt to their neighbors.
const ROUNDS: usize = 8;

impl Losses {
    /// The losses of a tile.
    pub fn of(&self, tile: usize) -> &[f32] {
        &self.values[tile * self.choices..][..self.choices]
    }

    /// The mean of the smallest loss of each tile with evidence; infinite without any.
    pub fn mean_of_best(&self) -> f32 {
        let best = |losses: &[f32]| losses.iter().copied().fold(f32::INFINITY, f32::min);
        let count = self.informative().count();
        if count == 0 { f32::INFINITY } else { self.informative().map(best).sum::<f32>() / count as f32 }
    }

    /// The losses of the tiles with evidence.
    fn informative(&self) -> impl Iterator<Item = &[f32]> {
        self.values.chunks(self.choices).filter(|losses| losses[0].is_finite())
    }

    /// The fewest choices that explain the tiles: the best for all, then those that explain enough tiles
    /// better; choice 0 is preferred as the first one. Empty if no tile has evidence.
    pub fn chosen(&self) -> Vec<usize> {
        let count = self.informative().count() as f32;
        let Some(first) = first(self.informative()) else {
            return Vec::new();
        };

        // Greedy: every round takes the choice that adds most.
        let mut chosen = vec![first];
        while chosen.len() < MOST {
            let (next, worth) = self.next(&chosen);
            if worth < WORTH * count {
                break;
            }
            chosen.push(next);
        }

        chosen
    }

    /// The choice that lowers the losses of the chosen ones most, and by how much.
    fn next(&self, chosen: &[usize]) -> (usize, f32) {
        let mut worth = vec![0.0; self.choices];
        for losses in self.informative() {
            // Differences up to the margin are chance.
            let so_far = chosen.iter().map(|choice| losses[*choice]).fold(f32::INFINITY, f32::min);

            for (worth, loss) in worth.iter_mut().zip(losses) {
                *worth += (so_far - loss - MARGIN).max(0.0);
            }
        }

        let best = (0..self.choices).max_by(|a, b| worth[*a].total_cmp(&worth[*b])).unwrap_or(0);
        (best, worth[best])
    }

    /// The tiles that a choice explains better than the others. With several choices, only the better half of
    /// these: tiles on a boundary are of mixed kinds.
    pub fn best_members(&self, choice: usize) -> Vec<usize> {
        let is_member = |tile: &usize| self.of(*tile)[0].is_finite() && least(self.of(*tile)) == choice;
        let mut members: Vec<usize> = (0..self.rows * self.cols).filter(is_member).collect();

        if self.choices > 1 {
            members.sort_by(|a, b| self.of(*a)[choice].total_cmp(&self.of(*b)[choice]));
            members.truncate(members.len().div_ceil(2));
        }

        members
    }

    /// The losses with those of every tile replaced by those of the best explained tile around it: tiles on a
    /// boundary, which no choice explains well, copy them from others.
    pub fn steadied(&self) -> Self {
        let best = |tile: usize| self.of(tile).iter().copied().fold(f32::INFINITY, f32::min);

        let mut steadied = self.clone();
        for (tile, losses) in steadied.values.chunks_mut(self.choices).enumerate() {
            // Ties keep the tile's own losses.
            let steadiest = self.around(tile).fold(tile, |a, b| if best(b) < best(a) { b } else { a });
            losses.copy_from_slice(self.of(steadiest));
        }

        steadied
    }

    /// Whether the tiles around one have different best choices.
    pub fn is_boundary(&self, tile: usize) -> bool {
        let informative = self.around(tile).filter(|tile| self.of(*tile)[0].is_finite());
        let mut choices = informative.map(|tile| least(self.of(tile)));

        let first = choices.next();
        choices.any(|choice| Some(choice) != first)
    }

    /// The tile and its up to eight neighbors.
    fn around(&self, tile: usize) -> impl Iterator<Item = usize> {
        let (y, x, cols) = (tile / self.cols, tile % self.cols, self.cols);
        around(y, 1, self.rows).flat_map(move |y| around(x, 1, cols).map(move |x| y * cols + x))
    }

    /// The choice of every tile: the one that explains it, smoothed by agreement with its neighbors (iterated
    /// conditional modes of a Potts model; Besag 1986).
    pub fn labels(&self) -> Vec<u8> {
        let mut labels: Vec<u8> =
            self.values.chunks(self.choices).map(|losses| least(losses) as u8).collect();

        for _ in 0..ROUNDS {
            let next: Vec<u8> = (0..labels.len()).map(|tile| self.agreed(tile, &labels)).collect();
            if next == labels {
                break;
            }
            labels = next;
        }

        labels
    }

    /// The same, without choices of hardly any tiles; these tiles take the best of the other choices.
    pub fn main_labels(&self) -> Vec<u8> {
        let mut labels = self.labels();
        let mut areas = vec![0; self.choices];
        for label in &labels {
            areas[usize::from(*label)] += 1;
        }

        let is_large = |choice: &usize| f64::from(areas[*choice]) >= LEAST_SHARE * labels.len() as f64;
        let mut kept: Vec<usize> = (0..self.choices).filter(is_large).collect();
        // If losses are equal, or without evidence, the choice with the largest area.
        kept.sort_by_key(|choice| std::cmp::Reverse(areas[*choice]));

        for (label, losses) in labels.iter_mut().zip(self.values.chunks(self.choices)) {
            if !kept.contains(&usize::from(*label)) {
                let better = |a: usize, b: usize| if losses[b] < losses[a] { b } else { a };
                *label = kept.iter().copied().reduce(better).unwrap_or(0) as u8;
            }
        }

        labels
    }

    /// The choice with the smallest energy, given those of the neighbors.
    fn agreed(&self, tile: usize, labels: &[u8]) -> u8 {
        // A neighbor's choice lowers the energy of the same choice, which is the Potts model up to a
        // constant.
        let mut energy: Vec<f32> =
            self.of(tile).iter().map(|loss| if loss.is_finite() { *loss } else { 0.0 }).collect();

        for other in self.around(tile).filter(|other| *other != tile) {
            let beside = other / self.cols == tile / self.cols || other % self.cols == tile % self.cols;
            energy[usize::from(labels[other])] -= if beside { BOUNDARY } else { BOUNDARY / 2.0 };
        }

        least(&energy) as u8
    }
}

/// The choice with the smallest mean loss; choice 0 is preferred unless another is clearly better. `None`
/// without tiles.
pub fn first<'a>(tiles: impl Iterator<Item = &'a [f32]>) -> Option<usize> {
    let mut tiles = tiles.peekable();
    let mut means = vec![0.0; tiles.peek()?.len()];

    let mut count = 0.0;
    for losses in tiles {
        means.iter_mut().zip(losses).for_each(|(sum, loss)| *sum += loss);
        count += 1.0;
    }

    for mean in &mut means {
        *mean /= count;
    }

    // The margin favors no blur: on sharp pairs, some blur is better by chance.
    let best = least(&means);
    Some(if means[0] <= means[best] + MARGIN / 2.0 { 0 } else { best })
}

/// The index of the least value, the first of equals.
fn least(values: &[f32]) -> usize {
    (0..values.len()).fold(0, |a, b| if values[b] < values[a] { b } else { a })
}

#[cfg(test)]
mod tests {
    use super::*;

    const NO_EVIDENCE: [f32; 3] = [f32::INFINITY; 3];

    fn losses<const N: usize>(cols: usize, tiles: &[[f32; N]]) -> Losses {
        let rows = tiles.len() / cols;
        Losses { rows, cols, choices: N, values: tiles.concat() }
    }

    #[test]
    fn the_best_for_all_tiles_is_chosen() {
        let clear = [[0.9, 0.1, 0.5]; 12];
        assert_eq!(losses(4, &clear).chosen(), [1]);
    }

    #[test]
    fn no_blur_is_preferred_where_there_is_little_between_them() {
        assert_eq!(losses(4, &[[0.12, 0.1, 0.5]; 12]).chosen(), [0]);
        assert_eq!(losses(4, &[[0.2, 0.1, 0.5]; 12]).chosen(), [1]);
    }

    #[test]
    fn a_choice_that_explains_enough_tiles_better_is_added() {
        let mut tiles = [[0.1, 0.9, 1.8]; 40];

        assert_eq!(losses(8, &tiles).chosen(), [0]);

        tiles[3] = [1.5, 0.1, 1.8];
        assert_eq!(losses(8, &tiles).chosen(), [0, 1]);

        tiles[39] = [1.4, 1.4, 0.1];
        assert_eq!(losses(8, &tiles).chosen(), [0, 1, 2]);
    }

    #[test]
    fn a_choice_that_is_a_little_better_by_chance_is_not_added() {
        let mut tiles = [[0.1, 0.9, 1.8]; 40];
        tiles[..20].fill([0.1, 0.05, 1.8]);
        assert_eq!(losses(8, &tiles).chosen(), [0]);
    }

    #[test]
    fn tiles_without_evidence_do_not_count() {
        let mut tiles = [NO_EVIDENCE; 40];
        assert!(losses(8, &tiles).chosen().is_empty());

        tiles[17] = [0.9, 0.1, 0.5];
        assert_eq!(losses(8, &tiles).chosen(), [1]);
    }

    #[test]
    fn the_number_of_choices_is_limited() {
        let tile =
            |own: usize| -> [f32; 12] { std::array::from_fn(|choice| if choice == own { 0.0 } else { 2.0 }) };

        let tiles: Vec<[f32; 12]> = (0..12).map(tile).collect();
        assert_eq!(losses(4, &tiles).chosen().len(), MOST);
    }

    #[test]
    fn a_single_choice_has_all_tiles_with_evidence() {
        let tiles = [[0.5], [f32::INFINITY], [0.1], [0.3]];
        assert_eq!(losses(2, &tiles).best_members(0), [0, 2, 3]);
    }

    #[test]
    fn of_several_choices_each_has_the_better_half_of_its_tiles() {
        let tiles = [[0.3, 0.9], [0.1, 0.9], [0.2, 0.9], [0.9, 0.4], [0.9, 0.2], [f32::INFINITY; 2]];

        let losses = losses(3, &tiles);
        assert_eq!(losses.best_members(0), [1, 2]);
        assert_eq!(losses.best_members(1), [4]);
    }

    #[test]
    fn the_first_choice_may_lose_all_tiles() {
        // Choice 1 is the best for all; then 2 and 3 each explain one half better.
        let mut tiles = [[2.0, 0.5, 0.1, 1.5]; 8];
        tiles[4..].fill([2.0, 0.5, 1.5, 0.2]);

        let losses = losses(4, &tiles);
        assert_eq!(losses.chosen(), [1, 2, 3]);
        assert!(losses.best_members(1).is_empty());
        assert_eq!(losses.best_members(2).len(), 2);
    }

    #[test]
    fn tiles_on_a_boundary_take_over_from_well_explained_ones() {
        let tiles = [[0.1, 0.9], [0.8, 0.7], [0.9, 0.05], [0.9, 0.2], [f32::INFINITY; 2], [0.9, 0.3]];
        let steadied = losses(6, &tiles).steadied();
        let expected = [[0.1, 0.9], [0.9, 0.05], [0.9, 0.05], [0.9, 0.05], [0.9, 0.2], [0.9, 0.3]];
        assert_eq!(steadied.values, expected.concat());
    }

    #[test]
    fn specks_are_removed_unless_the_evidence_is_strong() {
        let mut tiles = [[0.1, 0.6]; 25];
        tiles[12] = [0.3, 0.1];

        assert_eq!(losses(5, &tiles).labels(), [0; 25], "a speck");

        tiles[12] = [1.8, 0.1];
        let labels = losses(5, &tiles).labels();
        assert_eq!((labels[12], labels.iter().sum::<u8>()), (1, 1), "clear evidence");
    }

    #[test]
    fn areas_keep_their_boundary() {
        let mut tiles = [[0.1, 0.5]; 36];
        (0..36).filter(|tile| tile % 6 >= 3).for_each(|tile| tiles[tile] = [0.5, 0.1]);

        let expected: Vec<u8> = (0..36).map(|tile| u8::from(tile % 6 >= 3)).collect();
        assert_eq!(losses(6, &tiles).labels(), expected);
    }

    #[test]
    fn tiles_without_evidence_take_the_kind_around_them() {
        let mut tiles = [[0.9, 0.2]; 25];
        tiles[..3].fill([f32::INFINITY; 2]);
        assert_eq!(losses(5, &tiles).labels(), [1; 25]);
    }

    #[test]
    fn choices_of_hardly_any_tiles_are_left_out() {
        let mut tiles = [[0.1, 0.9, 0.5]; 200];
        tiles[100..].fill([0.9, 0.1, 0.5]);
        // Three by three tiles are a choice with more than 2 %, one by three has less.
        let block =
            |first: usize, rows: usize| (0..rows).flat_map(move |y| (0..3).map(move |x| first + 20 * y + x));
        block(25, 3).for_each(|tile| tiles[tile] = [1.9, 1.8, 0.1]);
        assert_eq!(losses(20, &tiles).main_labels(), losses(20, &tiles).labels());
        assert!(losses(20, &tiles).main_labels().contains(&2));

        block(25, 3).for_each(|tile| tiles[tile] = [0.1, 0.9, 0.5]);
        block(25, 1).for_each(|tile| tiles[tile] = [1.9, 1.8, 0.1]);
        assert!(losses(20, &tiles).labels().contains(&2));
        let found = losses(20, &tiles).main_labels();
        assert!(!found.contains(&2));
        assert_eq!(found[25..28], [1; 3]);
    }
}
