//! A finding: one statement about a pair or a match, with its topic and severity.

use phasestereo_match::named;

named! {
    /// The topic of a finding, in the order in which topics are named as causes.
    #[non_exhaustive]
    pub enum Topic {
        /// The match as a whole, or whether the images belong together.
        Match = "match",
        /// Which image is the left one.
        Swap = "swap",
        /// The disparities.
        Range = "range",
        /// How rows correspond.
        Alignment = "alignment",
        /// The relative blur.
        Blur = "blur",
        /// How gray levels correspond.
        Contrast = "contrast",
        /// The noise.
        Noise = "noise",
        /// The loss from compression.
        Coding = "coding",
        /// Pixels at the ends of their value range.
        Saturation = "saturation",
        /// How much of the image has texture.
        Texture = "texture",
        /// Repeating texture.
        Repetition = "repetition",
        /// Fields of interlaced video.
        Interlacing = "interlacing",
        /// Pixels of the images that do not show the scene.
        Border = "border",
        /// A disparity map that was verified.
        Map = "map",
    }
}

named! {
    /// The severity of a finding, the mildest first.
    #[derive(PartialOrd, Ord)]
    pub enum Severity {
        /// All is well.
        Ok = "ok",
        /// Worth knowing.
        Note = "note",
        /// To be fixed.
        Warning = "warning",
    }
}

/// One statement about a pair or a match.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// Its topic.
    pub topic: Topic,
    /// How grave it is.
    pub severity: Severity,
    /// Plain words, with numbers.
    pub sentence: String,
    /// Whether it reports that something cannot be measured.
    pub(crate) is_unknown: bool,
    /// The cause of a failed match that it implies; empty: none.
    pub(crate) cause: &'static str,
}

impl Topic {
    /// The topic with this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
    }

    /// Whether it decides if a match can be trusted at all.
    pub fn is_decisive(self) -> bool {
        matches!(self, Self::Match | Self::Swap | Self::Range | Self::Repetition)
    }
}

impl Severity {
    /// The severity with this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|severity| severity.name() == name)
    }

    /// The severity of a value, given the levels of a note and of a warning; NaN is well.
    pub(crate) fn of(value: f64, [note, warning]: [f64; 2]) -> Self {
        match value {
            _ if value >= warning => Self::Warning,
            _ if value >= note => Self::Note,
            _ => Self::Ok,
        }
    }
}

impl Finding {
    /// Words of every finding that disparities of a pair are not a depth.
    pub const NO_DEPTH: &str = "are not a depth";

    /// A finding.
    pub fn new(topic: Topic, severity: Severity, sentence: impl Into<String>) -> Self {
        Self { topic, severity, sentence: sentence.into(), is_unknown: false, cause: "" }
    }

    /// A note that something cannot be measured.
    pub(super) fn unknown(topic: Topic, sentence: impl Into<String>) -> Self {
        Self { is_unknown: true, ..Self::note(topic, sentence) }
    }

    /// Something worth knowing.
    pub(crate) fn note(topic: Topic, sentence: impl Into<String>) -> Self {
        Self::new(topic, Severity::Note, sentence)
    }

    /// Something to be fixed.
    #[cfg(test)]
    pub(crate) fn warning(topic: Topic, sentence: impl Into<String>) -> Self {
        Self::new(topic, Severity::Warning, sentence)
    }
}
