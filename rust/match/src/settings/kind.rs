//! The types of settings and their values, as text and on their way to and from Python.

use std::fmt::{Display, Formatter, Result as Written};

use crate::base::error::{Error, Result};

/// The type of a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// True or false.
    Boolean,
    /// A nonnegative integer.
    Integer,
    /// A number.
    Number,
    /// One of these words; each is paired with its meaning.
    Word(&'static [(&'static str, &'static str)]),
    /// Two values of a kind.
    Pair(&'static Kind),
    /// A value of a kind, or nothing.
    Optional(&'static Kind),
}

/// The description of a setting.
#[derive(Debug)]
pub struct SettingDescription {
    /// Its name.
    pub name: &'static str,
    /// Its meaning: a first sentence, and the rest after an empty line.
    pub documentation: &'static str,
    /// Its type.
    pub kind: Kind,
    /// The range of its values, as text; empty: every value of the type.
    pub range: fn() -> String,
}

/// The value of any setting.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// The empty value of an optional setting.
    Nothing,
    /// True or false.
    Boolean(bool),
    /// A nonnegative integer.
    Integer(usize),
    /// A number.
    Number(f64),
    /// One of the words of its kind.
    Word(&'static str),
    /// Two values.
    Pair(Box<[Value; 2]>),
}

/// A type that a setting may have.
pub trait Setting: Copy {
    /// Its type.
    const KIND: Kind;

    /// The setting from a value; `None`: the value is of another kind.
    fn from_value(value: &Value) -> Option<Self>;

    /// The setting as a value.
    fn to_value(self) -> Value;
}

impl Kind {
    /// The word of this kind with this spelling.
    pub fn word(&self, text: &str) -> Option<Value> {
        let Self::Word(words) = self else { return None };
        words.iter().find(|(word, _)| *word == text).map(|(word, _)| Value::Word(word))
    }

    /// Reads a value of this kind: as Python writes it, or with lowercase "none", "true" and "false"; a pair
    /// without its parentheses.
    pub fn read(&self, text: &str, name: &'static str) -> Result<Value> {
        self.parse(text.trim()).ok_or_else(|| Error::value(name, format!("'{text}'"), self))
    }

    fn parse(&self, text: &str) -> Option<Value> {
        match self {
            Self::Boolean if matches!(text, "True" | "true") => Some(Value::Boolean(true)),
            Self::Boolean if matches!(text, "False" | "false") => Some(Value::Boolean(false)),
            Self::Boolean => None,

            Self::Integer => text.parse().ok().map(Value::Integer),
            Self::Number => text.parse().ok().map(Value::Number),
            Self::Word(_) => self.word(text),

            Self::Pair(kind) => {
                let inside = text.strip_prefix('(').and_then(|text| text.strip_suffix(')'));
                let (first, second) = inside.unwrap_or(text).split_once(',')?;
                let both = [kind.parse(first.trim())?, kind.parse(second.trim())?];
                Some(Value::Pair(Box::new(both)))
            }

            Self::Optional(_) if matches!(text, "None" | "none") => Some(Value::Nothing),
            Self::Optional(kind) => kind.parse(text),
        }
    }
}

impl Display for Kind {
    /// The values that a setting of this kind accepts.
    fn fmt(&self, f: &mut Formatter<'_>) -> Written {
        match self {
            Self::Boolean => f.write_str("True or False"),
            Self::Integer => f.write_str("an integer that is not negative"),
            Self::Number => f.write_str("a number"),
            Self::Word(words) => {
                let quoted: Vec<_> = words.iter().map(|(word, _)| format!("'{word}'")).collect();
                f.write_str(&quoted.join(", "))
            }
            Self::Pair(Self::Integer) => f.write_str("a pair of integers"),
            Self::Pair(Self::Number) => f.write_str("a pair of numbers"),
            Self::Pair(kind) => write!(f, "a pair, each of it {kind}"),
            Self::Optional(kind) => write!(f, "{kind} or None"),
        }
    }
}

impl Display for Value {
    /// The value as Python writes it.
    fn fmt(&self, f: &mut Formatter<'_>) -> Written {
        match self {
            Self::Nothing => f.write_str("None"),
            Self::Boolean(true) => f.write_str("True"),
            Self::Boolean(false) => f.write_str("False"),
            Self::Integer(value) => value.fmt(f),
            Self::Number(value) => value.fmt(f),
            Self::Word(word) => write!(f, "'{word}'"),
            Self::Pair(both) => write!(f, "({}, {})", both[0], both[1]),
        }
    }
}

macro_rules! plain {
    ($($type:ty: $kind:ident),*) => {
        $(impl Setting for $type {
            const KIND: Kind = Kind::$kind;

            fn from_value(value: &Value) -> Option<Self> {
                if let Value::$kind(value) = value { Some(*value) } else { None }
            }

            fn to_value(self) -> Value {
                Value::$kind(self)
            }
        })*
    };
}

plain!(bool: Boolean, usize: Integer, f64: Number);

impl<T: Setting> Setting for (T, T) {
    const KIND: Kind = Kind::Pair(&T::KIND);

    fn from_value(value: &Value) -> Option<Self> {
        let Value::Pair(both) = value else { return None };
        Some((T::from_value(&both[0])?, T::from_value(&both[1])?))
    }

    fn to_value(self) -> Value {
        Value::Pair(Box::new([self.0.to_value(), self.1.to_value()]))
    }
}

impl<T: Setting> Setting for Option<T> {
    const KIND: Kind = Kind::Optional(&T::KIND);

    fn from_value(value: &Value) -> Option<Self> {
        if *value == Value::Nothing { Some(None) } else { T::from_value(value).map(Some) }
    }

    fn to_value(self) -> Value {
        self.map_or(Value::Nothing, T::to_value)
    }
}
