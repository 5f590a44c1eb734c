//! Everything that can go wrong, in one enum; the extension module turns each kind into a Python exception
//! type.

use thiserror::Error;

/// Why a computation was refused or stopped.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum Error {
    /// An argument has the right type but not an acceptable value.
    #[error("{argument}: got {got}; accepts {accepts}")]
    Value {
        /// Name of the argument or settings field.
        argument: &'static str,
        /// The refused value.
        got: String,
        /// The values that are accepted.
        accepts: String,
    },
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// The working memory could not be allocated.
    #[error("out of memory: {bytes} bytes of working memory could not be allocated")]
    OutOfMemory {
        /// Size of the allocation that failed.
        bytes: usize,
    },
    /// The operating system refused to start the worker threads.
    #[error("threads: could not start them: {0}")]
    Threads(String),
}

/// Shorthand for results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// A refused value in the crate's one form: name, value, accepted values.
    pub fn value(argument: &'static str, got: impl ToString, accepts: impl ToString) -> Self {
        Self::Value { argument, got: got.to_string(), accepts: accepts.to_string() }
    }

    /// The same error about another argument that contains the refused value.
    pub fn about(self, argument: &'static str) -> Self {
        match self {
            Self::Value { got, accepts, .. } => Self::Value { argument, got, accepts },
            other => other,
        }
    }
}
