//! Matches with known bits, of pairs that are generated here like those of rigs of many kinds.
//!
//! Arithmetic is the same on every platform, and so are the maps and their findings. A build, a processor or
//! an emulator that computes something else gives other digests. If you change a result, update the digests:
//! `cargo test self_check` prints the new ones.

pub mod scenes;

use self::scenes::{Fault, claims, pair};
use crate::estimation::facts::{Fact, Facts};
use crate::finding::Finding;
use crate::findings;
use crate::match_pair::match_pair;
use crate::rectification::rectify_views;
use crate::verification::verify;
use crate::video::frames::{Options, match_frame};
use crate::video::limits::{Check, check};
use crate::video::rig::{Rig, text};
use crate::video::temporal::TemporalFilter;
use phasestereo_match::base::digest::Digest;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::presets::Preset;

/// The task for a pair.
#[derive(Debug, Clone, Copy)]
pub enum Work {
    /// It is matched over this many disparities, or without a given range.
    Match(Preset, Option<i64>),
    /// It is matched as two frames, after two of a rig that only has noise.
    Frame,
    /// It is matched as a frame after others, without given facts.
    After(&'static [Fault]),
    /// Verifies a map of it that is right except in some areas.
    Verify,
    /// Its cameras are found.
    Cameras,
}

/// A pair, its task, and the digest of the result.
#[derive(Debug)]
pub struct Case {
    /// The fault of the rig.
    pub fault: Fault,
    /// Rows and columns.
    pub size: (usize, usize),
    /// The task for the pair.
    pub work: Work,
    /// The digest.
    pub digest: u64,
}

const SMALL: (usize, usize) = (120, 160);
const MIDDLE: (usize, usize) = (240, 320);
const LARGE: (usize, usize) = (400, 720);
const TOLD: Option<i64> = Some(32);
/// Focal length, pixels, that converts rows to a rotation.
const FOCAL: f64 = 300.0;
const COMES_NEARER: [Fault; 4] = [Fault::None, Fault::None, Fault::Nearer(8), Fault::Nearer(12)];
/// Frames, among others, that no estimate matches.
const LOST: [Fault; 8] = [
    Fault::None,
    Fault::None,
    Fault::Night,
    Fault::Night,
    Fault::Night,
    Fault::Night,
    Fault::Night,
    Fault::None,
];

const fn case(fault: Fault, size: (usize, usize), work: Work, digest: u64) -> Case {
    Case { fault, size, work, digest }
}

/// All of them.
pub const CASES: &[Case] = &[
    case(Fault::None, SMALL, Work::Match(Preset::Robust, TOLD), 0x03DF_0D22_C28D_105B),
    case(Fault::None, SMALL, Work::Match(Preset::Fast, TOLD), 0x8766_A069_EEFC_34C6),
    case(Fault::None, SMALL, Work::Match(Preset::Paper, TOLD), 0x2446_6D62_48C0_880C),
    case(Fault::Defocus, SMALL, Work::Match(Preset::Fast, TOLD), 0x071F_871F_8067_3481),
    case(Fault::Defocus, SMALL, Work::Match(Preset::Paper, TOLD), 0x303D_1013_AEA9_7FE8),
    case(Fault::Motion, SMALL, Work::Match(Preset::Robust, TOLD), 0x76E2_73D9_AEBB_E1F7),
    case(Fault::None, LARGE, Work::Match(Preset::Robust, None), 0x2A42_2AF3_7258_8418),
    case(Fault::Defocus, LARGE, Work::Match(Preset::Robust, None), 0x3D7C_FEFC_EDF0_BC48),
    case(Fault::FocusApart, LARGE, Work::Match(Preset::Robust, None), 0x61BB_768A_873B_CCE7),
    case(Fault::Rows, LARGE, Work::Match(Preset::Robust, None), 0xF285_5656_4F69_21B6),
    case(Fault::Plain, LARGE, Work::Match(Preset::Robust, None), 0x73D6_5A39_001B_F8E6),
    case(Fault::Defocus, MIDDLE, Work::Match(Preset::Robust, None), 0x5D31_3E61_3631_F18A),
    case(Fault::Motion, MIDDLE, Work::Match(Preset::Robust, None), 0xD770_0888_B851_8F38),
    case(Fault::Noise, MIDDLE, Work::Match(Preset::Robust, None), 0x9EEA_7857_435C_BD4F),
    case(Fault::Impulses, MIDDLE, Work::Match(Preset::Robust, None), 0xF682_B8D4_1911_16F4),
    case(Fault::Blocks, MIDDLE, Work::Match(Preset::Robust, None), 0x7931_AC64_B721_64A6),
    case(Fault::Stripes, MIDDLE, Work::Match(Preset::Robust, None), 0x6F1C_3E69_D8EC_F531),
    case(Fault::Rows, MIDDLE, Work::Match(Preset::Robust, None), 0x483F_5EB1_314F_BA55),
    case(Fault::Turned, MIDDLE, Work::Match(Preset::Robust, None), 0xD860_DF18_CC2C_F39C),
    case(Fault::Zoomed, MIDDLE, Work::Match(Preset::Robust, None), 0xC2A5_94F3_6EAB_ECED),
    case(Fault::Distorted, MIDDLE, Work::Match(Preset::Robust, None), 0x0272_DF7A_875F_9639),
    case(Fault::Interlaced, MIDDLE, Work::Match(Preset::Robust, None), 0x47A6_8AA1_95C1_247B),
    case(Fault::Vignetting, MIDDLE, Work::Match(Preset::Robust, None), 0x732F_56E4_9D7D_E45E),
    case(Fault::Floats, MIDDLE, Work::Match(Preset::Robust, None), 0x0309_EC43_ECC6_C774),
    case(Fault::Inverted, MIDDLE, Work::Match(Preset::Robust, None), 0xB75E_F868_E6B3_611B),
    case(Fault::Swapped, MIDDLE, Work::Match(Preset::Robust, None), 0xAB11_C502_D48B_75C5),
    case(Fault::Smaller, MIDDLE, Work::Match(Preset::Robust, None), 0xE1A2_4326_6537_D2DA),
    case(Fault::Masked, MIDDLE, Work::Match(Preset::Robust, None), 0x2CE1_1D88_B0FA_CA76),
    case(Fault::Bordered, MIDDLE, Work::Match(Preset::Robust, None), 0xB2B8_483E_BFE4_5FE5),
    case(Fault::Pole, MIDDLE, Work::Match(Preset::Robust, None), 0x295B_5952_68DD_12CC),
    case(Fault::Fence, MIDDLE, Work::Match(Preset::Robust, None), 0x011D_DFCF_D269_2CF3),
    case(Fault::Twice, MIDDLE, Work::Match(Preset::Robust, None), 0x3D1A_717E_2B51_A0DD),
    // Ranges that are too small.
    case(Fault::Pole, MIDDLE, Work::Match(Preset::Robust, Some(24)), 0xD792_00D3_0C61_C443),
    case(Fault::None, MIDDLE, Work::Match(Preset::Robust, Some(4)), 0xAFBF_A317_D249_6FD2),
    case(Fault::None, MIDDLE, Work::Frame, 0x1EE3_7319_9EEE_A845),
    case(Fault::Rows, MIDDLE, Work::Frame, 0xC6A3_1C4F_CBE3_0044),
    case(Fault::Defocus, MIDDLE, Work::Frame, 0x9931_A8C3_94FE_D246),
    case(Fault::Nearer(16), MIDDLE, Work::After(&COMES_NEARER), 0xC5D1_6AD9_02EC_BECD),
    case(Fault::None, MIDDLE, Work::After(&LOST), 0xA78B_D2FA_FFD2_A46C),
    case(Fault::Inverted, MIDDLE, Work::After(&[Fault::None; 3]), 0xA1DC_E9A8_D3A0_7870),
    case(Fault::None, SMALL, Work::Verify, 0xA857_A28D_4367_9459),
    case(Fault::Plain, SMALL, Work::Verify, 0x98ED_7B38_B80B_F4A4),
    case(Fault::Distorted, LARGE, Work::Cameras, 0x8409_60F0_2B1B_3C3F),
    case(Fault::Turned, LARGE, Work::Cameras, 0x97AA_9C1A_0881_4515),
];

impl Case {
    /// Its name.
    pub fn name(&self) -> String {
        let Self { fault, size: (rows, cols), work, .. } = self;
        format!("{fault:?} ({cols} x {rows}, {work:?})")
    }

    /// The digest of the result here.
    pub fn found(&self, runtime: Runtime) -> Result<u64> {
        let mut digest = Digest::default();
        match self.work {
            Work::Match(preset, count) => self.matched(preset, count, &mut digest, runtime),
            Work::Frame => {
                let faults = [Fault::Noise, Fault::Noise, self.fault, self.fault];
                self.frames(Preset::Robust, TOLD, &faults, &mut digest, runtime)
            }
            Work::After(others) => {
                let faults = [others, &[self.fault]].concat();
                self.frames(Preset::Fast, None, &faults, &mut digest, runtime)
            }
            Work::Verify => self.verified(&mut digest, runtime),
            Work::Cameras => self.cameras(&mut digest, runtime),
        }?;
        Ok(digest.value())
    }

    fn matched(
        &self,
        preset: Preset,
        count: Option<i64>,
        digest: &mut Digest,
        runtime: Runtime,
    ) -> Result<()> {
        let pair = self.pair(self.fault, 0, count.unwrap_or(1))?;
        let candidates = count.map(|_| Fact::given(pair.candidates()));
        let facts = &Facts { candidates, ..Facts::default() };
        let found = match_pair(pair, facts, &preset.settings(), runtime)?;

        digest.add_map(&found.map);
        let summary = found.summary();
        let estimates = &found.prepared.estimates;
        digest.add_said(&findings::of_match(estimates, &summary, self.size));
        digest.add_said(&estimates.findings);
        Ok(())
    }

    fn frames(
        &self,
        preset: Preset,
        count: Option<i64>,
        faults: &[Fault],
        digest: &mut Digest,
        runtime: Runtime,
    ) -> Result<()> {
        let settings = &preset.settings();
        let given = count.map(|count| Candidates::new(0, count, self.size.1)).transpose()?;
        let facts = &Facts { candidates: given.map(Fact::given), ..Facts::default() };
        let options = Options { facts, settings, reestimate: 30 };
        let (mut rig, mut filter) = (Rig::default(), TemporalFilter::new());

        for (moment, fault) in (0..).zip(faults) {
            let pair = self.pair(*fault, moment, count.unwrap_or(1))?;
            let frame = match_frame(&mut rig, pair, options, Some(&mut filter), runtime)?;
            digest.add_map(&frame.matched.map);
            if let Some((support, _)) = frame.support {
                digest.add(support.into_vec());
            }
        }
        digest.add(text::written(&rig)?.into_bytes());

        // Against the usual limits, and against its own values, which are within them.
        let usual = check(&rig, &[], Some(FOCAL))?;
        let value = |check: &Check| Some((check.quantity.words()[0].to_owned(), check.value?));
        let own: Vec<_> = usual.iter().filter_map(value).collect();
        digest.add(format!("{usual:?} {:?}", check(&rig, &own, Some(FOCAL))?).into_bytes());
        Ok(())
    }

    fn verified(&self, digest: &mut Digest, runtime: Runtime) -> Result<()> {
        let (pair, map) = (self.pair(self.fault, 0, 1)?, claims(self.fault, self.size));
        let facts = &Facts::default();
        let found = verify(pair, &map, facts, &Preset::Robust.settings(), runtime)?;

        digest.add(found.verdicts.into_vec());
        for number in found.confidence.as_slice().iter().chain(found.uncertainty.as_slice()) {
            digest.add(number.to_bits().to_le_bytes());
        }
        digest.add(format!("{:?}", found.counts).into_bytes());
        digest.add_said(&found.findings);
        Ok(())
    }

    fn cameras(&self, digest: &mut Digest, runtime: Runtime) -> Result<()> {
        let pair = Pair::of_inputs(pair(self.fault, self.size, 0), 0, 1)?;
        let found = rectify_views(&[pair], runtime)?;

        for number in found.cameras.numbers().iter().chain(found.cameras.spreads()) {
            digest.add(number.to_bits().to_le_bytes());
        }
        digest.add(findings::rectification(&found).concat().into_bytes());
        Ok(())
    }

    fn pair(&self, fault: Fault, moment: u32, count: i64) -> Result<Pair> {
        Pair::of_any(pair(fault, self.size, moment), 0, count)
    }
}

/// The names and digests of the cases that differ from those of every platform. Each case counts as a
/// finished row.
pub fn differing(runtime: Runtime) -> Result<Vec<String>> {
    let mut differing = Vec::new();
    for case in CASES {
        let found = case.found(Runtime { control: &runtime.control.aside(), ..runtime })?;
        runtime.control.finish_rows(1);
        if found != case.digest {
            differing.push(format!("{}: {found:#018x}", case.name()));
        }
    }
    Ok(differing)
}

/// The data that a case adds to its digest.
trait Add {
    fn add_map(&mut self, map: &Disparity);
    fn add_said(&mut self, said: &[Finding]);
}

impl Add for Digest {
    fn add_map(&mut self, map: &Disparity) {
        let floats = [Some(&map.disparity), map.confidence.as_ref(), map.uncertainty.as_ref()];
        for value in floats.into_iter().flatten().flat_map(Plane::as_slice) {
            self.add(value.to_bits().to_le_bytes());
        }
        for flags in map.flags.as_slice() {
            self.add(flags.to_le_bytes());
        }
    }

    fn add_said(&mut self, said: &[Finding]) {
        for finding in said {
            self.add(finding.sentence.bytes());
        }
    }
}
