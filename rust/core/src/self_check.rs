//! Matches whose bits are known: of pairs that are made here, as rigs of many kinds take them.
//!
//! Arithmetic is the same on every platform, so are the maps and what is said of them. A build, a processor or an emulator
//! that computes something else has other digests. Whoever changes a result changes digests, too: `cargo test
//! self_check` prints what they have become.

pub mod scenes;

use self::scenes::{Fault, pair};
use crate::estimation::facts::{Fact, Facts};
use crate::finding::Finding;
use crate::findings;
use crate::match_pair::match_pair;
use crate::rectification::rectify_views;
use crate::video::frames::{Way, match_frame};
use crate::video::rig::{Rig, text};
use crate::video::temporal::TemporalFilter;
use phasestereo_match::base::error::Result;
use phasestereo_match::base::plane::Plane;
use phasestereo_match::matcher::Disparity;
use phasestereo_match::matcher::runtime::Runtime;
use phasestereo_match::pair::Pair;
use phasestereo_match::pair::candidates::Candidates;
use phasestereo_match::settings::presets::Preset;

/// What is done with a pair.
#[derive(Debug, Clone, Copy)]
pub enum Work {
    /// It is matched over so many disparities, or told nothing.
    Match(Preset, Option<i64>),
    /// It is matched as a frame, after some of a rig without faults.
    Frame,
    /// Its cameras are found.
    Cameras,
}

/// A pair, what is done with it, and the digest of what comes of it.
#[derive(Debug)]
pub struct Case {
    /// What the rig does to its images.
    pub fault: Fault,
    /// Rows and columns.
    pub size: (usize, usize),
    /// What is done with the pair.
    pub work: Work,
    /// The digest.
    pub digest: u64,
}

const SMALL: (usize, usize) = (120, 160);
const MIDDLE: (usize, usize) = (240, 320);
const LARGE: (usize, usize) = (400, 720);
const TOLD: Option<i64> = Some(32);

const fn case(fault: Fault, size: (usize, usize), work: Work, digest: u64) -> Case {
    Case { fault, size, work, digest }
}

/// All of them.
pub const CASES: [Case; 38] = [
    case(Fault::None, SMALL, Work::Match(Preset::Robust, TOLD), 0x0BE5_EB2A_DBD4_FC41),
    case(Fault::None, SMALL, Work::Match(Preset::Fast, TOLD), 0x31B0_7587_72DD_CEF5),
    case(Fault::None, SMALL, Work::Match(Preset::Paper, TOLD), 0x1E17_8564_CCF9_7EF5),
    case(Fault::Defocus, SMALL, Work::Match(Preset::Fast, TOLD), 0xD4EE_B9DC_8316_8716),
    case(Fault::Defocus, SMALL, Work::Match(Preset::Paper, TOLD), 0x8A54_C932_3BAB_DE3C),
    case(Fault::Motion, SMALL, Work::Match(Preset::Robust, TOLD), 0x4274_3379_C315_8488),
    case(Fault::None, LARGE, Work::Match(Preset::Robust, None), 0x2A32_F079_E5A5_8BFC),
    case(Fault::Defocus, LARGE, Work::Match(Preset::Robust, None), 0x0EE6_C22B_DC3D_8410),
    case(Fault::FocusApart, LARGE, Work::Match(Preset::Robust, None), 0xFFD8_6F5C_263C_C128),
    case(Fault::Rows, LARGE, Work::Match(Preset::Robust, None), 0x3875_203F_A5BB_EC91),
    case(Fault::Plain, LARGE, Work::Match(Preset::Robust, None), 0xFC20_2591_E74F_308A),
    case(Fault::Defocus, MIDDLE, Work::Match(Preset::Robust, None), 0x6025_EE8F_9D64_CBE6),
    case(Fault::Motion, MIDDLE, Work::Match(Preset::Robust, None), 0xE3E5_1EA9_3F38_B746),
    case(Fault::Noise, MIDDLE, Work::Match(Preset::Robust, None), 0xB5A3_18D3_B814_C2AD),
    case(Fault::Impulses, MIDDLE, Work::Match(Preset::Robust, None), 0xBE7E_A80D_2093_22D7),
    case(Fault::Blocks, MIDDLE, Work::Match(Preset::Robust, None), 0xC387_F8C0_534F_3573),
    case(Fault::Stripes, MIDDLE, Work::Match(Preset::Robust, None), 0xEF88_D942_D612_9C17),
    case(Fault::Rows, MIDDLE, Work::Match(Preset::Robust, None), 0x1B51_8FAE_0923_C3AA),
    case(Fault::Turned, MIDDLE, Work::Match(Preset::Robust, None), 0xBEEC_CF92_C04F_6C96),
    case(Fault::Zoomed, MIDDLE, Work::Match(Preset::Robust, None), 0x849B_2F5C_DA30_ADE8),
    case(Fault::Distorted, MIDDLE, Work::Match(Preset::Robust, None), 0xF5DA_EF89_46C4_48DA),
    case(Fault::Interlaced, MIDDLE, Work::Match(Preset::Robust, None), 0x9148_E963_5D18_8D83),
    case(Fault::Vignetting, MIDDLE, Work::Match(Preset::Robust, None), 0xB0D5_F601_4CDE_9454),
    case(Fault::Floats, MIDDLE, Work::Match(Preset::Robust, None), 0x8861_AB99_70FC_B56C),
    case(Fault::Inverted, MIDDLE, Work::Match(Preset::Robust, None), 0xAEED_7513_D3A1_C81B),
    case(Fault::Swapped, MIDDLE, Work::Match(Preset::Robust, None), 0x0977_BA2D_70BC_4B27),
    case(Fault::Smaller, MIDDLE, Work::Match(Preset::Robust, None), 0x21CF_FEB1_6D04_BBE6),
    case(Fault::Masked, MIDDLE, Work::Match(Preset::Robust, None), 0x2526_353E_109B_4466),
    case(Fault::Pole, MIDDLE, Work::Match(Preset::Robust, None), 0x2DC4_D1E6_BDB7_A33F),
    case(Fault::Fence, MIDDLE, Work::Match(Preset::Robust, None), 0xF1E5_07D3_4F9B_27AF),
    case(Fault::Twice, MIDDLE, Work::Match(Preset::Robust, None), 0x0B2F_72A3_7C9A_2002),
    // Ranges that are too small.
    case(Fault::Pole, MIDDLE, Work::Match(Preset::Robust, Some(24)), 0x667F_4A11_87E8_B851),
    case(Fault::None, MIDDLE, Work::Match(Preset::Robust, Some(4)), 0x85A6_3E3F_0743_CE90),
    case(Fault::None, MIDDLE, Work::Frame, 0xBA65_117B_D8CF_A275),
    case(Fault::Rows, MIDDLE, Work::Frame, 0xD681_C51C_3B41_8268),
    case(Fault::Defocus, MIDDLE, Work::Frame, 0x5813_7038_C91E_F73A),
    case(Fault::Distorted, LARGE, Work::Cameras, 0x96B9_10C6_6A7C_2758),
    case(Fault::Turned, LARGE, Work::Cameras, 0xA299_FE8A_891A_494E),
];

impl Case {
    /// Its name.
    pub fn name(&self) -> String {
        let Self { fault, size: (rows, cols), work, .. } = self;
        format!("{fault:?} ({cols} x {rows}, {work:?})")
    }

    /// The digest of what comes of it here.
    pub fn found(&self, runtime: Runtime) -> Result<u64> {
        let mut digest = Digest(0xCBF2_9CE4_8422_2325);
        match self.work {
            Work::Match(preset, count) => self.matched(preset, count, &mut digest, runtime),
            Work::Frame => self.frame(&mut digest, runtime),
            Work::Cameras => self.cameras(&mut digest, runtime),
        }?;
        Ok(digest.0)
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

    fn frame(&self, digest: &mut Digest, runtime: Runtime) -> Result<()> {
        let settings = &Preset::Robust.settings();
        let candidates = Some(Fact::given(Candidates::new(0, 32, self.size.1)?));
        let facts = &Facts { candidates, ..Facts::default() };
        let way = Way { facts, settings, reestimate: 30 };
        let (mut rig, mut filter) = (Rig::default(), TemporalFilter::new());

        for (moment, fault) in (0..).zip([Fault::Noise, Fault::Noise, self.fault, self.fault]) {
            let pair = self.pair(fault, moment, 32)?;
            let frame = match_frame(&mut rig, pair, way, Some(&mut filter), runtime)?;
            digest.add_map(&frame.matched.map);
            if let Some((support, _)) = frame.support {
                digest.add(support.into_vec());
            }
        }
        digest.add(text::written(&rig).into_bytes());
        Ok(())
    }

    fn cameras(&self, digest: &mut Digest, runtime: Runtime) -> Result<()> {
        let views = pair(self.fault, self.size, 0);
        let found = rectify_views(&[views], runtime.execution.level, runtime.control)?;

        for number in found.cameras.numbers().iter().chain(found.cameras.spreads()) {
            digest.add(number.to_bits().to_le_bytes());
        }
        digest.add(findings::rectification(&found).concat().into_bytes());
        Ok(())
    }

    fn pair(&self, fault: Fault, moment: u32, count: i64) -> Result<Pair> {
        let [left, right] = pair(fault, self.size, moment);
        Pair::of_any(left, right, 0, count)
    }
}

/// The cases whose digests are not those of every platform: their names, and the digests. Each case counts as a row done.
pub fn differing(runtime: Runtime) -> Result<Vec<String>> {
    let mut differing = Vec::new();
    for case in &CASES {
        let found = case.found(Runtime { control: &runtime.control.aside(), ..runtime })?;
        runtime.control.finish_rows(1);
        if found != case.digest {
            differing.push(format!("{}: {found:#018x}", case.name()));
        }
    }
    Ok(differing)
}

/// FNV-1a of 64 bits.
struct Digest(u64);

impl Digest {
    fn add(&mut self, bytes: impl IntoIterator<Item = u8>) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }

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
