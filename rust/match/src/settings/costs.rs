//! The table of costs. A new cost takes an entry here, and its module in `cost`.

/// Hands the table to a macro, after a token that may come first: the word of each cost with its meaning, its
/// name, and its module.
macro_rules! costs {
    ($make:ident $($first:tt)?) => {
        $make! {
            $($first)?
            /// Matching costs of two pixels.
            CostKind {
                /// The Hamming distance of their phase codes (unit: bits; eq. 7).
                "phase": Phase in phase,
                /// The absolute difference of their gray levels, of which the intensity range has 255; color
                /// becomes gray first (unit: gray levels).
                "sad": Sad in sad,
                /// The same after gray levels have been normalized by the mean and the standard deviation in
                /// the window around the pixel (unit: standard deviations).
                "nsad": NormalizedSad in normalized_sad,
                /// 1 less the zero-mean normalized cross-correlation of the gray levels of their
                /// neighborhoods (unit: 1; from 0 for alike neighborhoods to 2 for inverted ones).
                "zncc": Zncc in zncc,
            }
        }
    };
}

pub(crate) use costs;
