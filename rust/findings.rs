//! What was found out about a pair, or about its match, in plain words, for all faces alike.
//!
//! [`of_pair`] says what there is to say about a pair, topic by topic, in a fixed order, also that all is well. [`of_match`]
//! says what there is to say about its match, the worst first, and nothing if all is well: how many pixels are probably
//! wrong, and because of what; where the range was too short; and, word for word, what is worth knowing about the pair.
//! What a match has evened out, or has suffered from, is a note of the pair: how much it suffered is in the first sentence.
//!
//! From where on something is said stands in [`levels`].

mod geometry;
mod levels;
mod lightness;
mod outcome;

pub use self::outcome::of_match;
use crate::rig::estimation::Estimates;
use crate::rig::estimation::overview::LEAST_SIZE;
use crate::settings::Settings;

/// What a finding is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
}

/// How grave a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// All is well.
    Ok,
    /// Worth knowing.
    Note,
    /// To be mended.
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
    /// Whether it says that something cannot be told.
    is_unknown: bool,
}

/// Topics in the order in which they are named as causes.
const TOPICS: [(Topic, &str); 12] = [
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
    fn of(value: f64, [note, warning]: [f64; 2]) -> Self {
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
        Self { topic, severity, sentence: sentence.into(), is_unknown: false }
    }

    /// A note that something cannot be told.
    fn unknown(topic: Topic, sentence: impl Into<String>) -> Self {
        Self { is_unknown: true, ..Self::note(topic, sentence) }
    }

    /// That something is well.
    fn ok(topic: Topic, sentence: impl Into<String>) -> Self {
        Self::new(topic, Severity::Ok, sentence)
    }

    /// Something worth knowing.
    fn note(topic: Topic, sentence: impl Into<String>) -> Self {
        Self::new(topic, Severity::Note, sentence)
    }

    /// Something to be mended.
    fn warning(topic: Topic, sentence: impl Into<String>) -> Self {
        Self::new(topic, Severity::Warning, sentence)
    }
}

/// A pair of which something was estimated.
#[derive(Clone, Copy)]
struct Known<'a> {
    estimates: &'a Estimates,
    size: (usize, usize),
    /// Whether the disparities were given.
    is_given: bool,
    settings: &'a Settings,
}

/// What there is to say about a pair of so many rows and columns, also that all is well.
pub fn of_pair(
    estimates: &Estimates,
    size: (usize, usize),
    is_given: bool,
    settings: &Settings,
) -> Vec<Finding> {
    let known = Known { estimates, size, is_given, settings };

    let mut findings = known.search();
    findings.extend(known.rows());
    findings.extend(known.blur());
    findings.extend(known.light());
    findings
}

impl Known<'_> {
    /// A note that the images are too small or too uniform to tell something, if they are.
    fn untold(&self, topic: Topic, what: &str) -> Option<Finding> {
        let (rows, cols) = self.size;
        if rows.min(cols) < LEAST_SIZE {
            return Some(Finding::unknown(topic, format!("the images are too small to tell {what}")));
        }

        let is_uniform = self.estimates.photometry.is_some_and(|found| found.flat[0].max(found.flat[1]) >= levels::UNIFORM);
        is_uniform.then(|| {
            Finding::unknown(topic, format!("the images have too little texture to tell {what}"))
        })
    }

    /// A note that something could not be told.
    fn not_told(&self, topic: Topic, what: &str) -> Finding {
        let sentence = || format!("the images have too little in common to tell {what}");
        self.untold(topic, what).unwrap_or_else(|| Finding::unknown(topic, sentence()))
    }
}

/// A share in whole percent.
fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
