//! A whole match by the reference implementations, which every fast match must equal, bit for bit.

use std::fmt;

use crate::reference;
use crate::reference::{PixelEvidence, RawMap};
use phasestereo_match::base::control::Control;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::cost::Costs;
use phasestereo_match::cost::aggregation::Window;
use phasestereo_match::descriptor::basis::Basis;
use phasestereo_match::image::convolution::Kernel;
use phasestereo_match::image::intensity::Gray;
use phasestereo_match::image::texture::Texture;
use phasestereo_match::image::view::View;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::optimization::Penalties;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::blur_compensation::{self, BlurCompensation};
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::refinement::calibration::Weights;
use phasestereo_match::refinement::confidence::VotedMap;
use phasestereo_match::refinement::flag;
use phasestereo_match::refinement::left_right_check::Choices;
use phasestereo_match::settings::{CostKind, Optimizer, Settings};

use super::{level_pair, levels};

/// The result of a match, floats by their bits, so that NaN equals NaN.
#[derive(Clone, PartialEq, Eq)]
pub struct ResultBits {
    pub disparity: Vec<u32>,
    pub flags: Vec<u16>,
    pub confidence: Option<Vec<u32>>,
    pub uncertainty: Option<Vec<u32>>,
}

/// Shows sums of the values: a failing assertion reports which map differs, in a line.
impl fmt::Debug for ResultBits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sum = |bits: &[u32]| bits.iter().map(|&value| u64::from(value)).sum::<u64>();
        let sum_of = |bits: &Option<Vec<u32>>| bits.as_deref().map(sum);
        let flags = self.flags.iter().map(|&flags| u64::from(flags)).sum::<u64>();
        let sums = (sum(&self.disparity), flags, sum_of(&self.confidence), sum_of(&self.uncertainty));
        write!(f, "sums of disparity, flags, confidence and uncertainty: {sums:?}")
    }
}

impl ResultBits {
    pub fn new(map: Disparity) -> Self {
        let bits = |plane: Plane<f32>| plane.into_vec().into_iter().map(f32::to_bits).collect();
        Self {
            disparity: bits(map.disparity),
            flags: map.flags.into_vec(),
            confidence: map.confidence.map(bits),
            uncertainty: map.uncertainty.map(bits),
        }
    }
}

/// Window and penalties of a match.
pub fn scale(pair: &Pair, settings: &Settings) -> (Window, Penalties) {
    let (window, steps) = window(pair, settings);
    (window, Penalties::new(settings, window, steps))
}

/// Window of a match, and steps of its costs per unit.
fn window(pair: &Pair, settings: &Settings) -> (Window, u16) {
    let candidates = pair.candidates();
    let control = Control::default();
    let costs =
        Costs::new(pair.views(), candidates, settings, pair.blur_compensation(), levels()[0], &control)
            .expect("not cancelled");

    let window = Window::new(pair.size(), candidates.count(), settings, costs.ceiling());
    (window, costs.steps())
}

/// Costs, 0 where either pixel is invalid.
pub fn costs(
    views: [&View; 2],
    candidates: Candidates,
    settings: &Settings,
    compensation: Option<&BlurCompensation>,
) -> Plane<u16> {
    let validity = validity(views, candidates);

    let costs = if settings.cost == CostKind::Phase {
        let none = BlurCompensation::of_noise([0.0; 2]).expect("legal noise");
        phase_costs(views, candidates, settings, compensation.unwrap_or(&none))
    } else {
        let levels @ [left, right] = &level_pair(views, settings.intensity_range);
        match settings.cost {
            CostKind::Phase => unreachable!("compared above"),
            CostKind::Sad => reference::absolute_differences(left, right, candidates),
            CostKind::NormalizedSad => {
                let [left, right] =
                    levels.each_ref().map(|levels| reference::normalize(levels, settings.window));
                reference::absolute_differences(&left, &right, candidates)
            }
            CostKind::Zncc => reference::zncc(left, right, candidates, settings.neighborhood),
        }
    };

    Plane::from_fn(costs.rows(), costs.cols(), |y, place| costs.row(y)[place] * validity.row(y)[place])
}

/// Costs of phase codes: of whole images for each class; every pixel then takes those of its own class.
fn phase_costs(
    views: [&View; 2],
    candidates: Candidates,
    settings: &Settings,
    compensation: &BlurCompensation,
) -> Plane<u16> {
    let (rows, cols) = views[0].size();
    let count = candidates.count();
    let classes = Plane::from_fn(rows, cols, |y, x| compensation.class(y, x));

    let of_class = |class: usize| {
        classes.as_slice().contains(&class).then(|| {
            let [left, right] = [0, 1].map(|side| {
                let kernel = compensation.kernels(class)[side].as_ref();
                let smoothing = compensation.smoothing()[side];
                codes(views[side], smoothing, kernel, settings, compensation.noise()[side])
            });
            reference::phase_costs(&left, &right, candidates)
        })
    };

    let volumes: Vec<_> = (0..16).map(of_class).collect();

    Plane::from_fn(rows, cols * count, |y, place| {
        let volume = &volumes[classes.row(y)[place / count]];
        volume.as_ref().expect("of a class that occurs").row(y)[place]
    })
}

/// Codes of an image. Smoothed ones are in sixteenths of a byte, or have four more bits, or the number that
/// keeps them below 2^17; ones under a kernel have four more bits, or the number that keeps them below 2^25.
fn codes(
    view: &View,
    smoothing: f64,
    kernel: Option<&Kernel>,
    settings: &Settings,
    noise: f64,
) -> Plane<u64> {
    let gray = Gray::of_view(view);
    let mut values = view.gray().clone();
    let mut reach = gray.reach();

    let most = |reach: u32, limit: u32| {
        let bits = [4, 3, 2, 1].into_iter().find(|bits| reach << bits <= limit);
        bits.unwrap_or(0)
    };

    if smoothing > 0.0 {
        // Bytes end up on one scale, with or without color.
        let is_of_bytes = matches!(reach, 128 | 2048);
        let smoothed = if is_of_bytes { 2048 } else { reach << most(reach, 1 << 17) };

        let scale = f64::from(smoothed) / f64::from(reach);
        values = reference::smooth_gray(&values, gray.steps(smoothing), scale);
        reach = smoothed;
    }

    if let Some(kernel) = kernel {
        let bits = most(reach, 1 << 25);
        values = reference::convolve(&values, kernel, bits);
        reach <<= bits;
    }

    let scale = f64::from(reach) / f64::from(gray.reach());
    let threshold = weak_threshold(&gray, settings, noise * scale);
    reference::describe(&values, settings, threshold)
}

/// Codes of gray values of this scale, which are already smoothed.
fn codes_of(
    gray: &Gray,
    values: &Plane<i32>,
    kernel: Option<&Kernel>,
    settings: &Settings,
    noise: f64,
) -> Plane<u64> {
    let threshold = weak_threshold(gray, settings, noise);
    let Some(kernel) = kernel else {
        return reference::describe(values, settings, threshold);
    };

    let finer = [4, 3, 2, 1].into_iter().find(|bits| gray.reach() << bits <= 1 << 25);
    let bits = finer.unwrap_or(0);
    let threshold = weak_threshold(gray, settings, noise * f64::from(1 << bits));
    reference::describe(&reference::convolve(values, kernel, bits), settings, threshold)
}

/// Magnitude up to which the parts of a component are weak: in white noise a component has the energy of the
/// window, half of which belongs to either part.
pub fn weak_threshold(gray: &Gray, settings: &Settings, noise: f64) -> f64 {
    let neighborhood = settings.neighborhood + 2 * (settings.sizes - 1);
    let window = Basis::new(&Settings { neighborhood, ..settings.clone() });
    // The filter of frequency 0 is the window.
    let window = window.filters()[0].even.clone();

    let weight = |j: isize| f64::from(window[j.unsigned_abs()]);
    let radius = (neighborhood / 2) as isize;

    let places = (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dy, dx)));
    let energy: f64 = places.map(|(dy, dx)| (weight(dy) * weight(dx)).powi(2)).sum();

    (settings.noise_threshold * gray.steps(noise) * (energy / 2.0).sqrt()).round()
}

/// 1 where left pixel and candidate are both valid, else 0.
pub fn validity([left, right]: [&View; 2], candidates: Candidates) -> Plane<u16> {
    let (rows, cols) = left.size();
    let count = candidates.count();

    Plane::from_fn(rows, cols * count, |y, place| {
        let (x, k) = (place / count, place % count);
        u16::from(left.is_valid(y, x) && right.is_valid(y, candidates.column(x, k, cols)))
    })
}

/// The whole match.
pub fn matched(pair: &Pair, settings: &Settings) -> ResultBits {
    let found = found(pair, settings);
    let draft = drafted(pair, settings, &found);
    let texture = Texture::new(pair.views()[0].gray().clone());

    let unit = unit(pair, settings);
    let unrelated = unrelated(pair, settings);

    let mut votes = found.map(|found| {
        let second_best =
            if found.second_best == reference::NO_CANDIDATE { unrelated } else { Some(found.second_best) };
        reference::vote(found.best, second_best, unit)
    });

    for (vote, flags) in votes.as_mut_slice().iter_mut().zip(draft.1.as_slice()) {
        *vote = if flags & flag::MISSING == 0 { *vote } else { 0.0 };
    }

    let (disparity, mut flags) = refined(pair, draft, &texture, settings);
    let raw = reference::confidences(VotedMap { disparity: &disparity, votes: &votes, texture: &texture });

    let map = RawMap { disparity: &disparity, flags: &flags, confidence: &raw };
    let known = (pair.blur_compensation(), gray_level(pair.views()[0]));
    let weights = Weights::of(settings.optimizer);
    let [confidences, mut bars] = reference::calibrated(map, pair.candidates(), known, weights);

    let mut disparity = disparity.into_vec();
    for (place, disparity) in disparity.iter_mut().enumerate() {
        let flags = &mut flags.as_mut_slice()[place];
        let is_doubtful = f64::from(confidences.as_slice()[place]) < settings.min_confidence;
        if is_doubtful && !disparity.is_nan() {
            let doubtful = (*flags | flag::LOW_CONFIDENCE) & !flag::FILLED;
            *disparity = f32::NAN;
            *flags = doubtful;
        }

        if !settings.fill && *flags & flag::UNTRUSTED != 0 {
            *disparity = f32::NAN;
            *flags &= !flag::FILLED;
        }
    }

    for (bar, disparity) in bars.as_mut_slice().iter_mut().zip(&disparity) {
        *bar = if disparity.is_nan() { f32::NAN } else { *bar };
    }

    let bits = |values: Vec<f32>| values.into_iter().map(f32::to_bits).collect();
    let confidence = settings.confidence.then(|| bits(confidences.into_vec()));
    let uncertainty = settings.confidence.then(|| bits(bars.into_vec()));
    ResultBits { disparity: bits(disparity), flags: flags.into_vec(), confidence, uncertainty }
}

/// The evidence of the candidate chosen for each pixel.
fn found(pair: &Pair, settings: &Settings) -> Plane<PixelEvidence> {
    let candidates = pair.candidates();
    let (window, penalties) = scale(pair, settings);

    let validity = validity(pair.views(), candidates);
    let costs = costs(pair.views(), candidates, settings, pair.blur_compensation());
    let costs = reference::aggregate(&costs, &validity, window);

    let gray = pair.views()[0].gray();
    let edges = (settings.adaptive_p2 > 0.0).then(|| reference::edges(gray, settings.adaptive_p2));
    let count = candidates.count();
    optimized(&costs, count, settings.optimizer, penalties, edges.as_ref(), &|_, _| 0..count)
}

/// The evidence by aggregated costs; `edges` are those of [`reference::edges`], `searched` those of paths.
pub fn optimized(
    costs: &Plane<u32>,
    candidates: usize,
    optimizer: Optimizer,
    penalties: Penalties,
    edges: Option<&Plane<u8>>,
    searched: reference::Searched,
) -> Plane<PixelEvidence> {
    let (rows, cols) = (costs.rows(), costs.cols() / candidates);
    let of_pixel = |x: usize| x * candidates..(x + 1) * candidates;
    let by_sums = |sums: &Plane<u64>, costs: &Plane<u32>, searched: reference::Searched| {
        Plane::from_fn(rows, cols, |y, x| {
            let searched = searched(y / 64, x / 64);
            let places = x * candidates + searched.start..x * candidates + searched.end;
            let found = reference::select(&sums.row(y)[places.clone()], &costs.row(y)[places]);
            PixelEvidence { chosen: found.chosen + searched.start as u16, ..found }
        })
    };

    match optimizer {
        Optimizer::DynamicProgramming => {
            let row = |y| reference::in_order(costs.row(y), candidates, penalties);

            let chosen: Vec<_> = (0..rows).map(row).collect();
            Plane::from_fn(rows, cols, |y, x| reference::margin(chosen[y][x], &costs.row(y)[of_pixel(x)]))
        }
        Optimizer::ScanlineOptimization => {
            let sums = reference::scanline_optimization(costs, candidates, penalties, edges, searched);
            by_sums(&sums, costs, searched)
        }
        Optimizer::WinnerTakesAll => {
            let sums = costs.map(|&cost| cost.into());
            by_sums(&sums, &costs.map(|_| 0), &|_, _| 0..candidates)
        }
        Optimizer::SemiGlobal => {
            let sums = reference::semi_global(costs, candidates, penalties, edges, searched);
            by_sums(&sums, costs, searched)
        }
    }
}

/// One unit of the mean cost, in steps of the aggregated costs.
fn unit(pair: &Pair, settings: &Settings) -> f32 {
    let (window, steps) = window(pair, settings);
    window.unit(steps) as f32
}

/// One of 255 steps from black to white of a view.
fn gray_level(view: &View) -> f64 {
    let [black, white] = view.scale().range().map(|end| view.scale().pixel(end.into()));
    if white > black { (white - black) / 255.0 } else { 1.0 }
}

/// The cost of a window of unrelated codes, in steps of the aggregated costs: a third of the bits.
fn unrelated(pair: &Pair, settings: &Settings) -> Option<u32> {
    let (window, _) = window(pair, settings);
    let pixels = f64::from(window.area()) / f64::from(1 << window.dropped);
    let bits = settings.code_length() as f64 / 3.0;

    (settings.cost == CostKind::Phase).then_some((bits * pixels) as u32)
}

/// Disparities and flags, each row by itself.
fn drafted(pair: &Pair, settings: &Settings, found: &Plane<PixelEvidence>) -> (Plane<f32>, Plane<u16>) {
    let candidates = pair.candidates();
    let count = candidates.count();
    let validity = validity(pair.views(), candidates);

    let mut all = vec![];
    for y in 0..found.rows() {
        let row = found.row(y);
        let of_pixel = |x: usize| &validity.row(y)[x * count..(x + 1) * count];
        let flags: Vec<_> =
            (0..row.len()).map(|x| flags(pair, of_pixel(x), (y, x), row[x].chosen.into())).collect();

        let chosen: Vec<_> = row.iter().map(|found| found.chosen).collect();
        let costs: Vec<_> = row.iter().map(|found| found.best).collect();
        let choices = Choices { chosen: &chosen, costs: &costs, candidates };

        let flags = match settings.lr_check {
            Some(most) => reference::check_row(choices, most as u16, &flags),
            None => flags,
        };

        let ambiguous = row.iter().map(|found| ambiguous(found, settings.uniqueness as f64));
        all.extend(
            flags.iter().zip(ambiguous).map(|(&flags, ambiguous)| {
                if flags & flag::MISSING == 0 { flags | ambiguous } else { flags }
            }),
        );
    }

    let flags = Plane::from_vec(found.rows(), found.cols(), all).expect("all rows");

    let disparity = Plane::from_fn(found.rows(), found.cols(), |y, x| {
        let PixelEvidence { chosen, offset, .. } = found.row(y)[x];
        let whole = candidates.disparity(chosen.into()) as f32;
        let is_missing = flags.row(y)[x] & flag::MISSING != 0;

        if is_missing { f32::NAN } else { whole + if settings.subpixel { offset } else { 0.0 } }
    });

    (disparity, flags)
}

/// The flag of a candidate whose cost is not lower than the second-best one by `percent`.
fn ambiguous(found: &PixelEvidence, percent: f64) -> u16 {
    let least = f64::from(found.second_best) * (100.0 - percent);
    let is_unique = percent == 0.0 || found.second_best == reference::NO_CANDIDATE;

    if !is_unique && f64::from(found.best) * 100.0 > least { flag::AMBIGUOUS } else { 0 }
}

/// Disparities and flags of the map as a whole.
fn refined(
    pair: &Pair,
    (mut disparity, mut flags): (Plane<f32>, Plane<u16>),
    texture: &Texture,
    settings: &Settings,
) -> (Plane<f32>, Plane<u16>) {
    if settings.speckle_size > 0 {
        let region = (settings.speckle_size, settings.speckle_range as f32);
        flags = reference::flag_speckles(&disparity, &flags, region);
    }

    let checks = [settings.lr_check.is_some(), settings.uniqueness > 0, settings.speckle_size > 0];
    if checks.contains(&true) {
        (disparity, flags) = reference::fill(&disparity, &flags);
    }

    if settings.guided_median {
        disparity = reference::guided_median(&disparity, &texture.gray, false);
    }

    if settings.median > 0 {
        disparity = reference::smooth(&disparity);
    }

    let is_soft = |kernels: &[Option<Kernel>; 2]| kernels[0].is_some() != kernels[1].is_some();
    let is_explained = settings.synthesis
        && settings.cost == CostKind::Phase
        && pair.blur_compensation().is_some_and(|known| known.classes().any(is_soft));

    if is_explained {
        disparity = synthesized(&disparity, pair, settings);
        disparity = reference::guided_median(&disparity, &texture.gray, true);
    }

    if settings.subpixel {
        disparity = reference::smooth_surfaces(&disparity);
    }

    (disparity, flags)
}

/// The map that best explains the soft image of a pair.
pub fn synthesized(disparity: &Plane<f32>, pair: &Pair, settings: &Settings) -> Plane<f32> {
    let (views, (rows, cols)) = (pair.views(), pair.size());
    let compensation = pair.blur_compensation().expect("kernels");
    let (level, control) = (levels()[0], Control::default());
    let scales = [0, 1].map(|side| {
        blur_compensation::gray(views[side], Some(compensation), side, level, &control).expect("memory")
    });
    let grays = scales.each_ref().map(|gray| gray.plane().clone());
    let valid = views.map(|view| Plane::from_fn(rows, cols, |y, x| view.is_valid(y, x)));
    let classes = Plane::from_fn(rows, cols, |y, x| compensation.class(y, x));
    let kernels: Vec<_> = compensation.classes().cloned().collect();
    let codes = |side: usize, gray: &Plane<i32>, kernel: Option<&Kernel>| {
        codes_of(&scales[side], gray, kernel, settings, compensation.noise()[side])
    };
    let units = scales.each_ref().map(|gray| gray.steps(1.0));
    let soft = reference::Soft {
        grays: [&grays[0], &grays[1]],
        valid: [&valid[0], &valid[1]],
        classes: &classes,
        kernels: &kernels,
        codes: &codes,
        left: (units[0] / units[1], scales[0].reach().into()),
    };
    reference::synthesize(disparity, soft)
}

/// Flags of the pixel at `(y, x)`, from the votes for each of its candidates.
fn flags(pair: &Pair, votes: &[u16], (y, x): (usize, usize), chosen: usize) -> u16 {
    if !pair.views()[0].is_valid(y, x) {
        return flag::MASKED;
    }
    if !votes.contains(&1) {
        return flag::NO_CANDIDATE;
    }
    let columns = 0..pair.size().1 as isize;
    let is_outside = !columns.contains(&(x as isize - pair.candidates().disparity(chosen)));
    let outside = if is_outside { flag::OUTSIDE } else { 0 };
    outside | if votes[chosen] == 1 { 0 } else { flag::MATCH_MASKED }
}
