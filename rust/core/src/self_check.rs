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
    case(Fault::None, SMALL, Work::Match(Preset::Robust, TOLD), 0xF601_3770_7955_7618),
    case(Fault::None, SMALL, Work::Match(Preset::Fast, TOLD), 0x8766_A069_EEFC_34C6),
    case(Fault::None, SMALL, Work::Match(Preset::Paper, TOLD), 0x0AE6_CA93_10C9_FDDB),
    case(Fault::Defocus, SMALL, Work::Match(Preset::Fast, TOLD), 0x071F_871F_8067_3481),
    case(Fault::Defocus, SMALL, Work::Match(Preset::Paper, TOLD), 0x6461_EC01_A6A0_2EDD),
    case(Fault::Motion, SMALL, Work::Match(Preset::Robust, TOLD), 0x8B52_FEF3_9A81_A1F4),
    case(Fault::None, LARGE, Work::Match(Preset::Robust, None), 0x7C33_84ED_7EE3_E4E0),
    case(Fault::Defocus, LARGE, Work::Match(Preset::Robust, None), 0x22BA_5AC3_5EAC_BBC9),
    case(Fault::FocusApart, LARGE, Work::Match(Preset::Robust, None), 0xE73A_0C3B_A7BF_D3AC),
    case(Fault::Rows, LARGE, Work::Match(Preset::Robust, None), 0xCEAB_ED21_0F09_EED3),
    case(Fault::Plain, LARGE, Work::Match(Preset::Robust, None), 0x7BC7_7DE0_6D64_660E),
    case(Fault::Defocus, MIDDLE, Work::Match(Preset::Robust, None), 0x8408_2B87_CA9A_A486),
    case(Fault::Motion, MIDDLE, Work::Match(Preset::Robust, None), 0xAEF2_B2F8_B29F_2819),
    case(Fault::Noise, MIDDLE, Work::Match(Preset::Robust, None), 0x7F7C_627E_8337_DBA0),
    case(Fault::Impulses, MIDDLE, Work::Match(Preset::Robust, None), 0x988F_FE3F_E635_4E51),
    case(Fault::Blocks, MIDDLE, Work::Match(Preset::Robust, None), 0x0D82_8368_5D5A_CC32),
    case(Fault::Stripes, MIDDLE, Work::Match(Preset::Robust, None), 0x7E11_A35C_53C9_E512),
    case(Fault::Rows, MIDDLE, Work::Match(Preset::Robust, None), 0xF799_D25E_CCF8_3FB8),
    case(Fault::Turned, MIDDLE, Work::Match(Preset::Robust, None), 0x7AAA_872B_7B7C_7724),
    case(Fault::Zoomed, MIDDLE, Work::Match(Preset::Robust, None), 0x5507_363C_085E_0055),
    case(Fault::Distorted, MIDDLE, Work::Match(Preset::Robust, None), 0x8553_AFD4_AC08_B69A),
    case(Fault::Interlaced, MIDDLE, Work::Match(Preset::Robust, None), 0x75A7_FF86_2C4A_EC23),
    case(Fault::Mosaic, MIDDLE, Work::Match(Preset::Robust, None), 0xE1B2_3BBB_F37A_F590),
    case(Fault::Crosstalk, MIDDLE, Work::Match(Preset::Robust, None), 0xFFEC_E617_4575_BF90),
    case(Fault::Vignetting, MIDDLE, Work::Match(Preset::Robust, None), 0xC5B3_DBE0_D57C_A818),
    case(Fault::Floats, MIDDLE, Work::Match(Preset::Robust, None), 0xF494_4F6F_FDDA_A109),
    case(Fault::Inverted, MIDDLE, Work::Match(Preset::Robust, None), 0xBD57_C078_5EEE_3440),
    case(Fault::Swapped, MIDDLE, Work::Match(Preset::Robust, None), 0x3F11_2394_6660_07BE),
    case(Fault::Smaller, MIDDLE, Work::Match(Preset::Robust, None), 0xB316_4603_D829_E799),
    case(Fault::Masked, MIDDLE, Work::Match(Preset::Robust, None), 0xCCE5_0CA9_93CA_FC5A),
    case(Fault::Bordered, MIDDLE, Work::Match(Preset::Robust, None), 0x521E_6356_C762_E805),
    case(Fault::Pole, MIDDLE, Work::Match(Preset::Robust, None), 0xC91B_1266_C8D6_7B24),
    case(Fault::Fence, MIDDLE, Work::Match(Preset::Robust, None), 0x9082_E800_5B67_EA54),
    case(Fault::Twice, MIDDLE, Work::Match(Preset::Robust, None), 0x8386_044E_D2E6_6C0D),
    // Ranges that are too small.
    case(Fault::Pole, MIDDLE, Work::Match(Preset::Robust, Some(24)), 0xD08E_1824_E090_2AF9),
    case(Fault::None, MIDDLE, Work::Match(Preset::Robust, Some(4)), 0xAE53_B2F0_1287_6A13),
    case(Fault::None, MIDDLE, Work::Frame, 0x2F04_C53F_571A_DDD1),
    case(Fault::Rows, MIDDLE, Work::Frame, 0x5F82_D15D_4ACE_5705),
    case(Fault::Defocus, MIDDLE, Work::Frame, 0x7A3B_842C_DFD5_02D4),
    case(Fault::Nearer(16), MIDDLE, Work::After(&COMES_NEARER), 0x2772_7C19_B6E3_BE14),
    case(Fault::None, MIDDLE, Work::After(&LOST), 0xCD2D_1C90_0D2D_94BF),
    case(Fault::Inverted, MIDDLE, Work::After(&[Fault::None; 3]), 0xE1FE_2C6D_3A92_82DC),
    case(Fault::None, SMALL, Work::Verify, 0x4543_42B3_45CE_C16C),
    case(Fault::Plain, SMALL, Work::Verify, 0x2708_C62F_EED8_0CAF),
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
