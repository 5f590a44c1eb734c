//! Where in the image which blur is: as few kinds as explain the tiles, and a map without specks.

/// How much worse than the best of the tile every choice explains it: tiles by rows, choices innermost.
#[derive(Debug, Clone)]
pub struct Losses {
    /// Rows of tiles.
    pub rows: usize,
    /// Columns of tiles.
    pub cols: usize,
    /// Number of choices.
    pub choices: usize,
    /// One loss each, nepers; infinite, all of them, where a tile tells nothing.
    pub values: Vec<f32>,
}

/// A further choice must explain a tile better than those there are by more than this, nepers, to count:
/// on sharp pairs some are better by chance.
const MARGIN: f32 = 0.06;
/// ... and the mean over all tiles of what is beyond that must be this, nepers: 1 % of the tiles, all of
/// which were explained as badly as can be, or 10 % of them a little.
const WORTH: f32 = 0.01;
/// Most choices.
pub const MOST: usize = 8;
/// What a neighbouring tile of another choice costs, nepers; diagonal ones half. Mean bad-1.0 of the `mixed`
/// areas over 12 scenes: 0.15: 16.2 %, 0.3: 16.2 %.
const BOUNDARY: f32 = 0.15;
/// Rounds in which tiles look at their neighbours.
const ROUNDS: usize = 8;

impl Losses {
    fn of(&self, tile: usize) -> &[f32] {
        &self.values[tile * self.choices..][..self.choices]
    }

    fn told(&self) -> impl Iterator<Item = &[f32]> {
        self.values.chunks(self.choices).filter(|losses| losses[0].is_finite())
    }

    /// The fewest choices that explain the tiles: the best for all, then whatever explains enough of them
    /// better; choice 0 is preferred as the first one. Empty if no tile tells anything.
    pub fn chosen(&self) -> Vec<usize> {
        let count = self.told().count() as f32;
        let mean = |choice: usize| self.told().map(|losses| losses[choice]).sum::<f32>() / count;
        let means: Vec<f32> = (0..self.choices).map(mean).collect();
        let Some(best) = (0..self.choices).min_by(|a, b| means[*a].total_cmp(&means[*b])) else {
            return Vec::new();
        };
        if count == 0.0 {
            return Vec::new();
        }
        let mut chosen = vec![if means[0] <= means[best] + MARGIN / 2.0 { 0 } else { best }];
        while chosen.len() < MOST {
            let (next, worth) = self.next(&chosen);
            if worth < WORTH * count {
                break;
            }
            chosen.push(next);
        }
        chosen
    }

    /// The choice that adds most to those there are, and how much.
    fn next(&self, chosen: &[usize]) -> (usize, f32) {
        let mut worth = vec![0.0; self.choices];
        for losses in self.told() {
            let so_far = chosen.iter().map(|choice| losses[*choice]).fold(f32::INFINITY, f32::min);
            for (worth, loss) in worth.iter_mut().zip(losses) {
                *worth += (so_far - loss - MARGIN).max(0.0);
            }
        }
        let best = (0..self.choices).max_by(|a, b| worth[*a].total_cmp(&worth[*b])).unwrap_or(0);
        (best, worth[best])
    }

    /// The losses of some of the choices alone.
    pub fn only(&self, choices: &[usize]) -> Self {
        let pick =
            |losses: &[f32]| choices.iter().map(|choice| losses[*choice]).collect::<Vec<_>>();
        let values = self.values.chunks(self.choices).flat_map(pick).collect();
        Self { choices: choices.len(), values, ..*self }
    }

    /// The tiles that a choice explains better than others do; of several choices the better half of these,
    /// since those that straddle a boundary are not of one kind.
    pub fn best_members(&self, choice: usize) -> Vec<usize> {
        let is_member =
            |tile: &usize| self.of(*tile)[0].is_finite() && least(self.of(*tile)) == choice;
        let mut members: Vec<usize> = (0..self.rows * self.cols).filter(is_member).collect();
        if self.choices > 1 {
            members.sort_by(|a, b| self.of(*a)[choice].total_cmp(&self.of(*b)[choice]));
            members.truncate(members.len().div_ceil(2));
        }
        members
    }

    /// Every tile's losses replaced by those of the best explained tile around it: blocks that straddle a
    /// boundary, which nothing explains well, take over from those that do not.
    pub fn steadied(&self) -> Self {
        let best = |tile: usize| self.of(tile).iter().copied().fold(f32::INFINITY, f32::min);
        let mut steadied = self.clone();
        for (tile, losses) in steadied.values.chunks_mut(self.choices).enumerate() {
            let steadiest =
                self.around(tile).fold(tile, |a, b| if best(b) < best(a) { b } else { a });
            losses.copy_from_slice(self.of(steadiest));
        }
        steadied
    }

    fn around(&self, tile: usize) -> impl Iterator<Item = usize> {
        let (y, x, cols) = (tile / self.cols, tile % self.cols, self.cols);
        let rows = y.saturating_sub(1)..(y + 2).min(self.rows);
        rows.flat_map(move |y| (x.saturating_sub(1)..(x + 2).min(cols)).map(move |x| y * cols + x))
    }

    /// The choice of every tile: what explains it, and agrees with its neighbours unless the evidence says
    /// otherwise (iterated conditional modes of a Potts model; Besag 1986).
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

    fn agreed(&self, tile: usize, labels: &[u8]) -> u8 {
        let mut energy: Vec<f32> =
            self.of(tile).iter().map(|loss| if loss.is_finite() { *loss } else { 0.0 }).collect();
        for other in self.around(tile).filter(|other| *other != tile) {
            let beside =
                other / self.cols == tile / self.cols || other % self.cols == tile % self.cols;
            energy[usize::from(labels[other])] -= if beside { BOUNDARY } else { BOUNDARY / 2.0 };
        }
        least(&energy) as u8
    }
}

/// The index of the least value, the first of equals.
fn least(values: &[f32]) -> usize {
    (0..values.len()).fold(0, |a, b| if values[b] < values[a] { b } else { a })
}
