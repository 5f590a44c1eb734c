//! A whole match by the naive twins: what every fast one must give, bit for bit.

use phasestereo::aggregation::Window;
use phasestereo::basis::Basis;
use phasestereo::candidates::Candidates;
use phasestereo::control::Control;
use phasestereo::convolution::Kernel;
use phasestereo::cost::Costs;
use phasestereo::intensity::Gray;
use phasestereo::matcher::{Disparity, Pair};
use phasestereo::plane::Plane;
use phasestereo::reference;
use phasestereo::refinement::flag;
use phasestereo::scanline::Steps;
use phasestereo::settings::{CostKind, Settings};
use phasestereo::versions::{MOST_CLASSES, Versions};
use phasestereo::view::View;

use super::{level_pair, levels, plane};

/// What a caller sees of a match; floats by their bits, so that NaN equals NaN.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Seen {
    pub disparity: Vec<u32>,
    pub flags: Vec<u16>,
    pub confidence: Option<Vec<u32>>,
}

impl Seen {
    pub fn of(map: Disparity) -> Self {
        let bits = |plane: Plane<f32>| plane.into_vec().into_iter().map(f32::to_bits).collect();
        Self {
            disparity: bits(map.disparity),
            flags: map.flags.into_vec(),
            confidence: map.confidence.map(bits),
        }
    }
}

/// Window and penalties of a match.
pub fn scale(pair: &Pair, settings: &Settings) -> (Window, Steps) {
    let (candidates, control) = (pair.candidates(), Control::default());
    let costs =
        Costs::new(pair.views(), candidates, settings, pair.versions(), levels()[0], &control)
            .expect("not cancelled");
    let window = Window::new(pair.size(), candidates.count(), settings, costs.ceiling());
    (window, Steps::new(settings.penalty, window, costs.steps()))
}

/// Costs, 0 where there is no vote.
pub fn costs(
    views: [&View; 2],
    candidates: Candidates,
    settings: &Settings,
    versions: Option<&Versions>,
) -> Plane<u16> {
    let votes = votes(views, candidates);
    let costs = if settings.cost == CostKind::Phase {
        let untold = Versions::of_noise([0.0; 2]).expect("legal noise");
        phase_costs(views, candidates, settings, versions.unwrap_or(&untold))
    } else {
        let [left, right] = level_pair(views, settings.intensity_range).map(|channels| {
            let normalised = |plane: &Plane<u16>| match settings.cost {
                CostKind::NormalisedSad => reference::normalise(plane, settings.window),
                _ => plane.clone(),
            };
            channels.iter().map(normalised).collect::<Vec<_>>()
        });
        reference::absolute_differences(&left, &right, candidates)
    };
    Plane::from_fn(costs.rows(), costs.cols(), |y, place| costs.row(y)[place] * votes.row(y)[place])
}

/// Costs of phase codes: of whole images for each class, of which every pixel then takes its own's.
fn phase_costs(
    views: [&View; 2],
    candidates: Candidates,
    settings: &Settings,
    versions: &Versions,
) -> Plane<u16> {
    let (rows, cols, _) = views[0].image.shape();
    let count = candidates.count();
    let classes = Plane::from_fn(rows, cols, |y, x| versions.class(y, x));
    let of_class = |class: usize| {
        classes.as_slice().contains(&class).then(|| {
            let [left, right] = [0, 1].map(|side| {
                let kernel = versions.kernels(class)[side].as_ref();
                codes(views[side], kernel, settings, versions.noise()[side])
            });
            reference::phase_costs(&left, &right, candidates)
        })
    };
    let volumes: Vec<_> = (0..MOST_CLASSES).map(of_class).collect();
    Plane::from_fn(rows, cols * count, |y, place| {
        let volume = &volumes[classes.row(y)[place / count]];
        volume.as_ref().expect("of a class that occurs").row(y)[place]
    })
}

/// Codes of an image, perhaps under a kernel: with four more bits, or as many as leave it below 2^25.
fn codes(view: &View, kernel: Option<&Kernel>, settings: &Settings, noise: f64) -> Plane<u64> {
    let gray = Gray::new(view, levels()[0], &Control::default()).expect("memory");
    let threshold = weak_threshold(&gray, settings, noise);
    let Some(kernel) = kernel else {
        return reference::describe(&plane(&gray), settings, threshold);
    };
    let finer = [4, 3, 2, 1].into_iter().find(|bits| gray.reach() << bits <= 1 << 25);
    let bits = finer.unwrap_or(0);
    let threshold = weak_threshold(&gray, settings, noise * f64::from(1 << bits));
    reference::describe(&reference::convolve(&plane(&gray), kernel, bits), settings, threshold)
}

/// Magnitude up to which parts of components are weak: white noise gives each the energy of the window, of
/// which half falls to either part.
pub fn weak_threshold(gray: &Gray, settings: &Settings, noise: f64) -> f64 {
    let window = Basis::new(settings).filters()[0].even.clone();
    let weight = |j: isize| f64::from(window[j.unsigned_abs()]);
    let radius = (settings.neighborhood / 2) as isize;
    let places = (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dy, dx)));
    let energy: f64 = places.map(|(dy, dx)| (weight(dy) * weight(dx)).powi(2)).sum();
    (settings.weak * gray.steps(noise) * (energy / 2.0).sqrt()).round()
}

/// 1 where left pixel and candidate are both valid, else 0.
pub fn votes([left, right]: [&View; 2], candidates: Candidates) -> Plane<u16> {
    let ((rows, cols, _), count) = (left.image.shape(), candidates.count());
    Plane::from_fn(rows, cols * count, |y, place| {
        let (x, k) = (place / count, place % count);
        u16::from(left.is_valid(y, x) && right.is_valid(y, candidates.column(x, k, cols)))
    })
}

/// The whole match.
pub fn matched(pair: &Pair, settings: &Settings) -> Seen {
    let (candidates, count) = (pair.candidates(), pair.candidates().count());
    let (window, steps) = scale(pair, settings);
    let votes = votes(pair.views(), candidates);
    let costs = costs(pair.views(), candidates, settings, pair.versions());
    let aggregated = reference::aggregate(&costs, &votes, window);
    let confidences = settings.confidence.then(Vec::new);
    let mut seen = Seen { disparity: vec![], flags: vec![], confidence: confidences };
    for y in 0..window.rows {
        let row = aggregated.row(y);
        let chosen = reference::optimize(row, count, settings.optimizer, steps);
        for (x, &index) in chosen.iter().enumerate() {
            let (index, places) = (usize::from(index), x * count..(x + 1) * count);
            let flags = flags(pair, &votes.row(y)[places.clone()], (y, x), index);
            let missing = flags & flag::MISSING != 0 || flags != 0 && !settings.fill;
            let disparity = if missing { f32::NAN } else { candidates.disparity(index) as f32 };
            seen.disparity.push(disparity.to_bits());
            seen.flags.push(flags);
            if let Some(confidences) = &mut seen.confidence {
                let known = if missing { 0.0 } else { confidence(&row[places], index) };
                confidences.push(known.to_bits());
            }
        }
    }
    seen
}

/// Flags of the pixel at `(y, x)`, by the votes for each of its candidates.
fn flags(pair: &Pair, votes: &[u16], (y, x): (usize, usize), chosen: usize) -> u16 {
    if !pair.views()[0].is_valid(y, x) {
        return flag::MASKED;
    }
    if !votes.contains(&1) {
        return flag::NO_CANDIDATE;
    }
    let is_outside = pair.candidates().is_outside(x, chosen, pair.size().1);
    let outside = if is_outside { flag::OUTSIDE } else { 0 };
    outside | if votes[chosen] == 1 { 0 } else { flag::MATCH_MASKED }
}

/// The margin to the least cost that is not next to the chosen one, relative to it.
fn confidence(costs: &[u32], chosen: usize) -> f32 {
    let apart = costs.iter().enumerate().filter(|(k, _)| k.abs_diff(chosen) > 1);
    match apart.map(|(_, cost)| *cost).min() {
        None | Some(0) => 0.0,
        Some(other) => (f64::from(other.saturating_sub(costs[chosen])) / f64::from(other)) as f32,
    }
}
