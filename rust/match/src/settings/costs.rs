//! The table of costs. A new cost adds an entry here and its module in `cost`.

/// Passes the table to a macro, after an optional first token: the word of each cost with its meaning, its
/// name, and its module.
macro_rules! costs {
    ($make:ident $($first:tt)?) => {
        $make! {
            $($first)?
            /// Matching costs of two pixels.
            CostKind {
                /// The Hamming distance of their phase codes (unit: bits; eq. 7).
                "phase": Phase in phase,
                /// The absolute difference of their gray levels, 255 of which span the intensity range; color
                /// becomes gray first (unit: gray levels).
                "sad": Sad in sad,
                /// The same, after gray levels are normalized by the mean and the standard deviation of the
                /// window around the pixel (unit: standard deviations).
                "nsad": NormalizedSad in normalized_sad,
                /// 1 minus the zero-mean normalized cross-correlation of the gray levels of their
                /// neighborhoods (unit: 1; from 0 for equal neighborhoods to 2 for inverted ones).
                "zncc": Zncc in zncc,
            }
        }
    };
}

pub(crate) use costs;
