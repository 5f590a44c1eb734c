//! One thing that there is to say, what it is about, and how grave it is.

/// What a finding is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Topic {
    /// The match as a whole, or whether the images belong together.
    Match,
    /// Which image is the left one.
    Swap,
    /// The disparities.
    Range,
    /// How rows correspond.
    Alignment,
    /// The relative blur.
    Blur,
    /// How gray levels correspond.
    Contrast,
    /// The noise.
    Noise,
    /// The loss of compression.
    Coding,
    /// Pixels at the ends of their values.
    Saturation,
    /// How much of the image has texture.
    Texture,
    /// Texture that comes back.
    Repetition,
    /// Fields of interlaced video.
    Interlacing,
    /// Pixels of the images that show nothing of the scene.
    Border,
    /// A disparity map that was verified.
    Map,
}

/// How grave a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// All is well.
    Ok,
    /// Worth knowing.
    Note,
    /// To be fixed.
    Warning,
}

/// One thing that there is to say about a pair, or about a match.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// What it is about.
    pub topic: Topic,
    /// How grave it is.
    pub severity: Severity,
    /// Plain words, with numbers.
    pub sentence: String,
    /// Whether it reports that something cannot be measured.
    pub(crate) is_unknown: bool,
    /// What a failed match is due to because of it; empty: nothing.
    pub(crate) cause: &'static str,
}

/// Topics in the order in which they are named as causes.
const TOPICS: [(Topic, &str); 14] = [
    (Topic::Match, "match"),
    (Topic::Swap, "swap"),
    (Topic::Range, "range"),
    (Topic::Alignment, "alignment"),
    (Topic::Blur, "blur"),
    (Topic::Contrast, "contrast"),
    (Topic::Noise, "noise"),
    (Topic::Coding, "coding"),
    (Topic::Saturation, "saturation"),
    (Topic::Texture, "texture"),
    (Topic::Repetition, "repetition"),
    (Topic::Interlacing, "interlacing"),
    (Topic::Border, "border"),
    (Topic::Map, "map"),
];

impl Topic {
    /// All topics.
    pub const ALL: [Self; TOPICS.len()] = {
        let mut all = [Self::Match; TOPICS.len()];
        let mut at = 0;
        while at < all.len() {
            all[at] = TOPICS[at].0;
            at += 1;
        }
        all
    };

    /// Its name.
    pub fn name(self) -> &'static str {
        TOPICS.iter().find(|(topic, _)| *topic == self).map_or("match", |(_, name)| name)
    }

    /// The topic of a name.
    pub fn named(name: &str) -> Option<Self> {
        TOPICS.iter().find(|(_, other)| *other == name).map(|(topic, _)| *topic)
    }

    /// Whether it decides if a match is to be trusted at all.
    pub fn is_decisive(self) -> bool {
        matches!(self, Self::Match | Self::Swap | Self::Range | Self::Repetition)
    }
}

impl Severity {
    /// All severities, the mildest first.
    pub const ALL: [Self; 3] = [Self::Ok, Self::Note, Self::Warning];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Note => "note",
            Self::Warning => "warning",
        }
    }

    /// The severity of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|severity| severity.name() == name)
    }

    /// The severity of a value by the levels of a note and of a warning; NaN is well.
    pub(crate) fn of(value: f64, [note, warning]: [f64; 2]) -> Self {
        match value {
            _ if value >= warning => Self::Warning,
            _ if value >= note => Self::Note,
            _ => Self::Ok,
        }
    }
}

impl Finding {
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
