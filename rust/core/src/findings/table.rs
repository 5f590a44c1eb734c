//! The tables of findings: the parts of a row, and its evaluation.
//!
//! ```text
//! for each row:  values = its quantity, measured
//!     for each value:  severity = by the two levels of the row, or fixed
//!                      sentence = that of the row, filled in; if it is not well, ": " and the remedy
//! ```

use crate::finding::{Finding, Severity, Topic};

/// The rule for the severity of a finding.
#[derive(Debug, Clone, Copy)]
pub enum Grade {
    /// Always well.
    Well,
    /// Always a note.
    Note,
    /// Always a warning.
    Warning,
    /// A note from the first level, a warning from the second.
    Levels([f64; 2]),
}

/// One measured value of a quantity.
#[derive(Debug, Clone, Default)]
pub struct Measured {
    /// The value.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
    /// The words that fill in the sentence.
    pub words: Vec<String>,
    /// The reason for a missing value.
    pub unknown: Option<String>,
}

/// A row of a table. `M` measures the quantity; without a value it makes no finding.
#[derive(Debug, Clone, Copy)]
pub struct Row<M> {
    topic: Topic,
    grade: Grade,
    measure: M,
    sentence: &'static str,
    errors: [f64; 2],
    well: &'static str,
    remedy: &'static str,
    cause: (&'static str, f64),
}

impl<M: Copy> Row<M> {
    /// A row; `{0}` of a sentence is the first of the words, and so on.
    pub const fn new(topic: Topic, grade: Grade, measure: M, sentence: &'static str) -> Self {
        let (errors, cause) = ([0.0; 2], ("", 0.0));
        Self { topic, grade, measure, sentence, errors, well: "", remedy: "", cause }
    }

    /// The least value in standard errors.
    pub const fn errors(self, errors: [f64; 2]) -> Self {
        Self { errors, ..self }
    }

    /// The sentence for values below the levels; without it they make no finding.
    pub const fn well(self, well: &'static str) -> Self {
        Self { well, ..self }
    }

    /// The remedy.
    pub const fn remedy(self, remedy: &'static str) -> Self {
        Self { remedy, ..self }
    }

    /// The cause of a failed match, if the value is at least this.
    pub const fn cause(self, cause: &'static str, from: f64) -> Self {
        Self { cause: (cause, from), ..self }
    }

    fn severity(&self, Measured { value, error, .. }: &Measured) -> Severity {
        match self.grade {
            Grade::Well => Severity::Ok,
            Grade::Note => Severity::Note,
            Grade::Warning => Severity::Warning,
            Grade::Levels([note, warning]) => {
                let [least, most] = self.errors.map(|errors| errors * error);
                Severity::of(*value, [note.max(least), warning.max(most)])
            }
        }
    }

    fn finding(&self, measured: &Measured) -> Option<Finding> {
        if let Some(why) = &measured.unknown {
            return Some(Finding::unknown(self.topic, why));
        }
        let severity = self.severity(measured);
        let is_below = severity == Severity::Ok && matches!(self.grade, Grade::Levels(_));
        let mut sentence = if is_below { self.well } else { self.sentence }.to_owned();
        if sentence.is_empty() {
            return None;
        }
        if severity != Severity::Ok && !self.remedy.is_empty() {
            sentence = sentence + ": " + self.remedy;
        }
        for (index, word) in measured.words.iter().enumerate() {
            sentence = sentence.replace(&format!("{{{index}}}"), word);
        }
        let (cause, from) = self.cause;
        let cause = if measured.value >= from { cause } else { "" };
        Some(Finding { cause, ..Finding::new(self.topic, severity, sentence) })
    }
}

/// A table of quantities of a type: topic, grade, the quantity as an expression of the named value, sentence,
/// and the other parts of a row.
macro_rules! table {
    ($(#[$about:meta])* $table:ident of $of:ident: $type:ty;
     $($topic:ident, $grade:expr, $measure:expr, $sentence:expr $(, $key:ident($($value:expr),*))*;)*) => {
        $(#[$about])*
        const $table: &[Row<fn(&$type) -> Vec<Measured>>] = &[$({
            let measure: fn(&$type) -> Vec<Measured> = |$of| $measure;
            Row::new($crate::finding::Topic::$topic, $grade, measure, $sentence)$(.$key($($value),*))*
        }),*];
    };
}
pub(crate) use table;

/// The findings of a table, row after row.
pub fn evaluated<M: Copy>(rows: &[Row<M>], measure: impl Fn(M) -> Vec<Measured>) -> Vec<Finding> {
    let of_row = |row: &Row<M>| -> Vec<Finding> {
        measure(row.measure).iter().filter_map(|measured| row.finding(measured)).collect()
    };
    rows.iter().flat_map(of_row).collect()
}

/// The levels of the first row of a topic that has levels: for a note, and for a warning.
pub fn levels<M>(rows: &[Row<M>], topic: Topic) -> [f64; 2] {
    let of_row = |row: &Row<M>| match row.grade {
        Grade::Levels(levels) if row.topic == topic => Some(levels),
        _ => None,
    };
    rows.iter().find_map(of_row).unwrap_or([f64::INFINITY; 2])
}

/// A value with its words.
pub fn value(value: f64, words: impl Into<Vec<String>>) -> Vec<Measured> {
    vec![Measured { value, words: words.into(), ..Measured::default() }]
}

/// Words under a condition.
pub fn when<const N: usize>(is_so: bool, words: [String; N]) -> Vec<Measured> {
    if is_so { value(0.0, words) } else { vec![] }
}

/// A share in whole percent.
pub fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}
