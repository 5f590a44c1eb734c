//! Findings on a pair, or on its match, in plain words, the same for all interfaces.
//!
//! [`of_pair`] reports on a pair, topic by topic, in a fixed order, including topics that are well.
//! [`of_match`] reports on its match, worst first, and nothing if all is well: how many pixels are probably
//! wrong, and why; where the range was too short; and the relevant findings on the pair, word for word.
//! Faults of the pair that the match compensated or suffered from are notes: the first sentence reports the
//! harm.
//!
//! Each finding is a row of a [`table`]: a quantity, two levels, a sentence, a cause, and what to do.

pub mod choices;
mod outcome;
mod pair;
mod rectified;
pub mod table;

pub use self::outcome::{device_failed, most_wrong, of_copy, of_match};
pub use self::pair::{levels_of, of_pair, with_findings};
pub use self::rectified::{along_columns, not_rectified, rectification, rectified};

use crate::finding::{Finding, Severity, Topic};

/// Findings of several sources by topic, in the order in which the topics first occur, without "all is well"
/// where the same topic has another finding.
pub fn by_topic(mut findings: Vec<Finding>) -> Vec<Finding> {
    let mut topics: Vec<Topic> = vec![];
    for finding in &findings {
        if !topics.contains(&finding.topic) {
            topics.push(finding.topic);
        }
    }
    let is_well = |topic: Topic, all: &[Finding]| {
        all.iter().all(|one| one.topic != topic || one.severity == Severity::Ok)
    };
    let well: Vec<bool> = topics.iter().map(|topic| is_well(*topic, &findings)).collect();
    let place = |topic: Topic| topics.iter().position(|other| *other == topic).unwrap_or(topics.len());

    findings.retain(|one| one.severity != Severity::Ok || well[place(one.topic)]);
    findings.sort_by_key(|one| place(one.topic));
    findings
}

#[cfg(test)]
mod tests {
    use super::*;
    use phasestereo_match::base::math::{cos, sin};

    use crate::estimation::blur;
    use crate::estimation::blur::Side;
    use crate::estimation::blur::psf::Psf;
    use crate::estimation::estimates::Estimates;
    use crate::estimation::facts::Fact;
    use crate::estimation::order::Signs;
    use crate::estimation::photometry::{Contrast, Photometry, Saturation};
    use crate::estimation::range::{LeftOut, SearchRange};
    use crate::estimation::rows::RowOffsets;
    use crate::rectification::cameras::{Cameras, NUMBERS, USUAL};
    use crate::rectification::{Rectification, Refusal};
    use phasestereo_match::pair::alignment::sway::{INTERVALS, KNOTS};
    use phasestereo_match::pair::alignment::{Alignment, TERMS};
    use phasestereo_match::pair::candidates::Candidates;
    use phasestereo_match::settings::presets::Preset;

    const SIZE: (usize, usize) = (200, 300);
    const EVEN: Contrast = Contrast { gain: 1.0, gamma: 1.0, ratio: 1.0, ends: [1.0; 2] };
    const PHOTOMETRY: Photometry = Photometry {
        black: 0.0,
        range: 255.0,
        saturation: [Saturation { dark: 0.0, bright: 0.0 }; 2],
        flat: [0.1; 2],
        smeared: [0.0; 2],
        repeated: [0.0; 2],
        mosaic: [false; 2],
        fields: [0; 2],
        contrast: Some(EVEN),
    };
    const RANGE: SearchRange = SearchRange {
        min: 0,
        count: 20,
        low: 2.0,
        high: 15.0,
        negative: false,
        mixed: false,
        shown: Signs::NONE,
        identical: false,
    };

    /// Estimates of a pair without faults.
    fn sound() -> Estimates {
        let candidates = Candidates::new(0, 20, SIZE.1).expect("legal");
        Estimates {
            confidence: Some(0.9),
            range: Some(RANGE),
            offsets: Some(offsets([0.0; TERMS])),
            blur: Some(blur::Estimate { certainty: 0.9, ..blur::Estimate::unknown(SIZE) }),
            photometry: Some(PHOTOMETRY),
            ..Estimates::of_candidates(candidates)
        }
    }

    fn offsets(coefficients: [f64; TERMS]) -> RowOffsets {
        let field = Alignment::new(coefficients, SIZE).expect("legal");
        RowOffsets { field, error: 0.02, blocks: 100, spread: 0.1, errors: [0.02; INTERVALS] }
    }

    fn softer(side: Side, psf: Psf, other: Option<Psf>, certainty: f32) -> blur::Estimate {
        let kind = blur::Blur { other, ..blur::Blur::of(side, psf) };
        blur::Estimate { blurs: vec![kind], certainty, ..blur::Estimate::unknown(SIZE) }
    }

    /// The severity and the sentence of the first finding on a topic that is not well.
    fn said(estimates: &Estimates, topic: Topic) -> (Severity, String) {
        let found = of_pair(estimates, SIZE, None, &Preset::Robust.settings());
        let one = found.into_iter().filter(|one| one.topic == topic).max_by_key(|one| one.severity);
        one.map_or((Severity::Ok, String::new()), |one| (one.severity, one.sentence))
    }

    fn with_photometry(photometry: Photometry) -> Estimates {
        Estimates { photometry: Some(photometry), ..sound() }
    }

    #[test]
    fn a_sound_pair_is_not_accused() {
        let found = of_pair(&sound(), SIZE, None, &Preset::Robust.settings());
        assert!(found.iter().all(|one| one.severity == Severity::Ok), "{found:?}");
        assert!(found.iter().any(|one| one.sentence.contains("min_disparity 0 and num_disparities 20")));
    }

    #[test]
    fn the_range_and_what_it_tells_are_said() {
        let of = |range: SearchRange| said(&Estimates { range: Some(range), ..sound() }, Topic::Swap);
        let negative = SearchRange { low: -15.0, high: -2.0, negative: true, ..RANGE };
        let shown = |ground, sides| Signs { ground, sides, is_seen: true };
        for (shown, expected, words) in [
            (shown(-0.8, -0.2), Severity::Warning, "to be swapped"),
            (shown(0.8, 0.0), Severity::Note, "seem to be in their places"),
            (shown(-0.8, 0.2), Severity::Note, "does not show which"),
            (Signs::NONE, Severity::Note, "does not show which"),
        ] {
            let (severity, sentence) = of(SearchRange { shown, ..negative });
            assert!(severity == expected && sentence.contains(words), "{sentence}");
            assert_eq!(sentence.contains(Finding::NO_DEPTH), expected == Severity::Note, "{sentence}");
        }
        let positive = of(SearchRange { shown: shown(-0.8, -0.2), ..RANGE });
        assert!(positive.0 == Severity::Note && positive.1.contains("may be exchanged"));
        assert_eq!(of(SearchRange { mixed: true, ..RANGE }).0, Severity::Note);

        // Disparities are the same; rows distinguish turned cameras from exchanged images.
        let swapped = SearchRange { shown: shown(-0.8, -0.2), ..negative };
        for (twist, is_toed_in) in [(2.0, true), (0.2, false), (-2.0, false)] {
            let mut terms = [0.0; TERMS];
            terms[3] = twist;
            let estimates = Estimates { range: Some(swapped), offsets: Some(offsets(terms)), ..sound() };
            let (severity, sentence) = said(&estimates, Topic::Swap);
            assert_eq!(sentence.contains("toed in, with"), is_toed_in, "{twist}: {sentence}");
            assert_eq!(severity == Severity::Note, is_toed_in);
            assert_eq!(sentence.contains(Finding::NO_DEPTH), is_toed_in, "{sentence}");
        }

        let same = Estimates { range: Some(SearchRange { identical: true, ..RANGE }), ..sound() };
        assert_eq!(said(&same, Topic::Match).0, Severity::Warning);
        let nothing = Estimates { range: None, confidence: Some(0.2), ..sound() };
        assert!(said(&nothing, Topic::Match).1.contains("these are not a pair"));
        let wall = Photometry { flat: [0.99; 2], ..PHOTOMETRY };
        let wall = Estimates { range: None, confidence: Some(0.2), ..with_photometry(wall) };
        assert!(said(&wall, Topic::Range).1.contains("too little texture to measure which disparities"));
        assert_eq!(said(&wall, Topic::Texture).0, Severity::Warning);
        let dots = Estimates { confidence: Some(0.95), ..wall };
        assert_eq!(said(&dots, Topic::Texture).0, Severity::Ok, "as fine as noise, and it matches");

        let place = LeftOut { rows: 5..20, columns: 30..44, low: 88.2, high: 91.0 };
        let left_out = Estimates { left_out: vec![place], ..sound() };
        let expected = "something at 88 to 91 px seems to be in columns 30 to 44, rows 5 to 20";
        assert!(said(&left_out, Topic::Range).1.starts_with(expected));

        let searched = |min| Fact::given(Candidates::new(min, 20, SIZE.1).expect("legal"));
        for (min, expected) in [
            (90, "from 90 px are searched, so the left 30 %"),
            (-109, "up to -90 px are searched, so the right 30 %"),
        ] {
            let near = Estimates { candidates: searched(min), range: None, ..sound() };
            let (severity, sentence) = said(&near, Topic::Range);
            assert!(severity == Severity::Note && sentence.contains(expected), "{sentence}");
        }
        for min in [60, -70] {
            assert_eq!(
                said(&Estimates { candidates: searched(min), range: None, ..sound() }, Topic::Range).0,
                Severity::Ok
            );
        }

        let range = Some(SearchRange { high: 30.0, ..RANGE });
        let candidates = Fact::given(sound().candidates.value);
        let known = Estimates { candidates, range, ..sound() };
        let found = of_pair(&known, SIZE, None, &Preset::Robust.settings());
        assert!(found.iter().any(|one| one.sentence.contains("there seem to be 2 to 30 px")));
    }

    #[test]
    fn rows_are_as_grave_as_they_are_off_and_sure() {
        let of = |coefficients: [f64; TERMS], error: f64, is_straightened: bool| {
            let offsets = RowOffsets { error, ..offsets(coefficients) };
            let alignment = is_straightened.then(|| offsets.field.clone());
            said(&Estimates { offsets: Some(offsets), alignment, ..sound() }, Topic::Alignment)
        };
        let shift = |by: f64| [by, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

        assert_eq!(of(shift(0.2), 0.02, true).0, Severity::Ok);
        assert_eq!(of(shift(0.5), 0.02, true).0, Severity::Note);
        assert_eq!(of(shift(0.5), 0.2, true).0, Severity::Ok);
        assert_eq!(of(shift(-2.0), 0.02, true).0, Severity::Warning);
        assert!(of(shift(-2.0), 0.02, true).1.contains("shows things 2.0 px higher than the left one"));
        assert!(of(shift(2.0), 0.02, false).1.contains("straightening does not help"));

        let turned = of(
            [0.0, 150.0 * sin(1f64.to_radians()) / cos(1f64.to_radians()), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            0.02,
            true,
        );
        assert!(turned.1.contains("rotated clockwise (or sheared) by 1.00 degrees"), "{}", turned.1);
        let bent = of([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 3.0], 0.02, true);
        assert!(bent.1.contains("bent by 3.0 px (lens distortion left in"));

        let even = offsets([0.0; TERMS]);
        let field = even.field.clone().with_sway([0.8; KNOTS]).expect("legal");
        let swaying = RowOffsets { field: field.clone(), ..even };
        let swaying = Estimates { offsets: Some(swaying), alignment: Some(field), ..sound() };
        let said = of_pair(&swaying, SIZE, None, &Preset::Robust.settings());
        assert!(said.iter().any(|one| one.sentence.starts_with("rows sway by up to 0.8 px")));
    }

    #[test]
    fn blur_is_as_grave_as_it_is_large_and_certain() {
        let of = |psf: Psf, certainty: f32| {
            said(&Estimates { blur: Some(softer(Side::Left, psf, None, certainty)), ..sound() }, Topic::Blur)
        };
        assert_eq!(of(Psf::gaussian(0.2), 1.0).0, Severity::Ok);
        assert_eq!(of(Psf::gaussian(0.5), 1.0).0, Severity::Note);
        assert_eq!(of(Psf::gaussian(2.0), 1.0).0, Severity::Warning);
        assert!(of(Psf::gaussian(2.0), 0.3).1.contains("too little in common"));
        let disk = "the left image is softer than the right by a disk of radius 3.1 px: check its focus; \
                    robust matching compensates it";
        assert_eq!(of(Psf::disk(3.1), 0.9).1, disk);

        let both = softer(Side::Right, Psf::motion(9.0, 30.0), Some(Psf::motion(15.0, 0.0)), 0.9);
        let both = said(&Estimates { blur: Some(both), ..sound() }, Topic::Blur).1;
        assert!(both.contains(
            "the right image is blurred by a motion of 9.0 px at 30 degrees, the left one by a motion"
        ));

        // Images that do not match have no relative blur.
        let blur = || softer(Side::Left, Psf::disk(3.1), None, 0.9);
        let unlike = Estimates { blur: Some(blur()), confidence: Some(0.3), ..sound() };
        assert!(said(&unlike, Topic::Blur).1.contains("too little in common"));
        let stripes = Photometry { repeated: [0.6; 2], ..PHOTOMETRY };
        let stripes = Estimates { blur: Some(blur()), ..with_photometry(stripes) };
        assert!(said(&stripes, Topic::Blur).1.contains("too little in common"));
    }

    #[test]
    fn contrast_is_judged_where_the_grays_are() {
        let of = |gain: f64, gamma: f64, ends: [f64; 2]| {
            let contrast = Some(Contrast { gain, gamma, ratio: gain, ends });
            said(&with_photometry(Photometry { contrast, ..PHOTOMETRY }), Topic::Contrast)
        };
        assert_eq!(of(1.05, 0.97, [1.06, 1.04]).0, Severity::Ok);
        assert_eq!(of(1.05, 0.6, [1.1, 1.0]).0, Severity::Ok, "hardly any other grays");
        assert!(of(0.8, 1.0, [0.8; 2]).1.contains("the left image is darker, its gray levels 0.80 times"));
        assert_eq!(of(1.8, 1.0, [1.8; 2]).0, Severity::Warning);
        assert!(of(1.8, 1.0, [1.8; 2]).1.contains("the right image is darker, its gray levels 0.56 times"));
        assert!(of(1.0, 0.5, [1.6, 0.8]).1.contains("another curve"));
    }

    #[test]
    fn gray_levels_are_shares_of_their_range() {
        let noisy = |noise: [f64; 2], range: f64| {
            let blur = blur::Estimate { noise, certainty: 0.9, ..blur::Estimate::unknown(SIZE) };
            let photometry = Photometry { range, ..PHOTOMETRY };
            said(&Estimates { blur: Some(blur), ..with_photometry(photometry) }, Topic::Noise)
        };
        assert_eq!(noisy([1.0, 6.0], 255.0).0, Severity::Note);
        assert_eq!(noisy([20.0, 1.0], 255.0).0, Severity::Warning);
        assert!(
            noisy([20.0, 1.04], 255.0).1.starts_with("noise of 20 gray levels in the left image, 1.0 in")
        );
        assert_eq!(noisy([20.0, 20.0], 65535.0).0, Severity::Ok);
        assert!(
            noisy([0.0123, 0.0], 1.0)
                .1
                .contains("0.0123 gray levels in the left image, 0 in the right, on a scale of 1")
        );

        let coded = blur::Estimate { coding: [0.5, 4.0], ..blur::Estimate::unknown(SIZE) };
        let coded = Estimates { blur: Some(coded), ..sound() };
        assert!(
            said(&coded, Topic::Coding).1.contains("blocks in the right image, as harmful as noise of 4.0")
        );

        let bright = Saturation { dark: 0.0, bright: 0.25 };
        let bright = Photometry { saturation: [bright, Saturation::default()], ..PHOTOMETRY };
        let (severity, sentence) = said(&with_photometry(bright), Topic::Saturation);
        assert_eq!(severity, Severity::Warning);
        assert_eq!(sentence, "25 % of the left image is as bright as it can be: expose it less");
    }

    #[test]
    fn what_misleads_a_match_is_said() {
        let of = |photometry: Photometry, topic: Topic| said(&with_photometry(photometry), topic);
        let repeated = |share: f64| Photometry { repeated: [share, 0.9], ..PHOTOMETRY };
        assert_eq!(of(repeated(0.1), Topic::Repetition).0, Severity::Ok);
        assert_eq!(of(repeated(0.3), Topic::Repetition).0, Severity::Note);
        assert_eq!(of(repeated(0.5), Topic::Repetition).0, Severity::Warning);

        let fields = |fields: [i32; 2]| of(Photometry { fields, ..PHOTOMETRY }, Topic::Interlacing);
        assert_eq!(fields([0, 0]).0, Severity::Ok);
        assert!(fields([0, -4]).1.starts_with("the right image is interlaced: odd rows are shifted by 4 px"));
        assert!(fields([3, -4]).1.starts_with("the images are interlaced"));
        let mosaic = Photometry { mosaic: [true, false], ..PHOTOMETRY };
        assert!(of(mosaic, Topic::Interlacing).1.starts_with("the left image is a mosaic: pixels two apart"));
    }

    #[test]
    fn names_lead_back() {
        for topic in Topic::ALL {
            assert_eq!(Topic::named(topic.name()), Some(topic));
        }
        for severity in Severity::ALL {
            assert_eq!(Severity::named(severity.name()), Some(severity));
        }
        assert_eq!((Topic::named("weather"), Severity::named("")), (None, None));
    }

    #[test]
    fn a_pair_that_was_rectified_is_told_of() {
        let found = Rectification {
            cameras: Cameras::new([0.0; NUMBERS], USUAL, SIZE),
            matches: [100, 90],
            blocks: 80,
            rows: 12.34,
            rms: 0.2,
            error: 0.1,
            disparities: [-40.0, -20.0, -3.0],
            pairs: 2,
            is_inverted: true,
            moved: 21.0,
            distortion: [(-9.0, 1.0), (3.0, 2.0)],
        };
        let told = rectified(&found);
        assert_eq!((told.topic, told.severity), (Topic::Alignment, Severity::Note));
        for part in [
            "far from rectified, rows differ by 12.3 px rms",
            "to 0.20 px rms in 80 blocks",
            "the lenses distort, by 9 px at half the width (barrel)",
            "columns were moved by 21 px",
        ] {
            assert!(told.sentence.contains(part), "{}", told.sentence);
        }

        let told = rectification(&found).join("; ");
        for part in
            ["80 blocks of 2 pairs", "known to 0.10 px", "-40 to -3 px", "are negative", "negative of"]
        {
            assert!(told.contains(part), "{told}");
        }

        let plain = Rectification { moved: 0.0, distortion: [(9.0, 4.0); 2], ..found };
        let told = rectified(&plain).sentence;
        assert!(!told.contains("distort") && !told.contains("moved"), "{told}");

        let refusal = Refusal::Matches([9, 40]);
        assert_eq!(not_rectified(&sound(), false, &refusal), None);
        let failed = vec![Finding::warning(Topic::Match, "hardly anything")];
        let told = not_rectified(&Estimates { findings: failed, ..sound() }, false, &refusal);
        assert!(told.is_some_and(|told| told.sentence.contains("only 9 of 40 corners")));
    }

    #[test]
    fn a_topic_with_a_warning_is_not_well_and_topics_stay_together() {
        let well = |topic| Finding::new(topic, Severity::Ok, "well".to_owned());
        let all = vec![
            well(Topic::Range),
            well(Topic::Alignment),
            Finding::note(Topic::Noise, "noisy"),
            Finding::warning(Topic::Alignment, "rows are off"),
            Finding::note(Topic::Range, "short"),
        ];
        let told: Vec<_> = by_topic(all).into_iter().map(|one| (one.topic, one.severity)).collect();
        assert_eq!(
            told,
            [
                (Topic::Range, Severity::Note),
                (Topic::Alignment, Severity::Warning),
                (Topic::Noise, Severity::Note)
            ]
        );
        assert_eq!(by_topic(vec![well(Topic::Range)]).len(), 1);
    }
}
