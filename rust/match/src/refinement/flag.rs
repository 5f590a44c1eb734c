//! Why an estimate is missing or untrusted; bits of the flags.

/// The left pixel is masked: no estimate.
pub const MASKED: u16 = 1;
/// No candidate has a valid pixel in the right image: no estimate.
pub const NO_CANDIDATE: u16 = 2;
/// The match lies outside the right image.
pub const OUTSIDE: u16 = 4;
/// The match lies on a masked pixel of the right image.
pub const MATCH_MASKED: u16 = 8;
/// The right image does not show the left pixel: its match belongs to another left pixel.
pub const OCCLUDED: u16 = 16;
/// The match belongs to another left pixel, although the right image shows this one.
pub const MISMATCHED: u16 = 32;
/// The confidence is below the lowest one that was asked for.
pub const LOW_CONFIDENCE: u16 = 64;
/// The pixel belongs to a small region that differs from everything around it.
pub const SPECKLE: u16 = 128;
/// The disparity was filled in from other pixels.
pub const FILLED: u16 = 256;
/// A disparity elsewhere fits nearly as well.
pub const AMBIGUOUS: u16 = 512;
/// The disparity is that of a plane drawn into a flat area without evidence of its own.
pub const INFERRED: u16 = 1024;
/// The disparity comes from a smaller copy of the pair, which is more likely to be right there. The other
/// flags are those of the copy.
pub const COARSE: u16 = 2048;
/// The disparity comes from a second map, which is more likely to be right there. The other flags mean that
/// the right image does not show the pixel.
pub const SECOND: u16 = 4096;

/// Flags of pixels without an estimate.
pub const MISSING: u16 = MASKED | NO_CANDIDATE;
/// Flags of pixels that the right image does not show.
pub const UNSEEN: u16 = OUTSIDE | MATCH_MASKED | OCCLUDED;
/// Flags of pixels whose own estimate is missing or untrusted.
pub const UNTRUSTED: u16 = MISSING | UNSEEN | MISMATCHED | LOW_CONFIDENCE | SPECKLE | AMBIGUOUS | INFERRED;
