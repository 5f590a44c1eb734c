//! Settings by name, as text.

use crate::error::{Error, Result};
use crate::settings::{
    COSTS, CostKind, OPTIMIZERS, Optimizer, PRECISIONS, Precision, Settings, TAPERS, Taper,
    with_every_setting,
};

/// The type of a setting, which can be read from text.
trait Readable: Sized {
    /// Reads the value of a setting; an error names the setting.
    fn read(name: &'static str, text: &str) -> Result<Self>;
}

macro_rules! set_by_name {
    ($($name:ident),* $(,)?) => {
        impl Settings {
            /// Sets the field of this name to a value that is written as in Python, with "none", "true" and "false" in
            /// small letters and pairs as "0, 4095"; [`Self::check`] has to be called afterwards.
            pub fn set(&mut self, name: &str, text: &str) -> Result<()> {
                match name {
                    $(stringify!($name) => {
                        self.$name = Readable::read(stringify!($name), text.trim())?;
                    })*
                    _ => {
                        let names = [$(stringify!($name)),*].join(", ");
                        return Err(Error::value("settings", format!("'{name}'"), names));
                    }
                }
                Ok(())
            }
        }
    };
}

with_every_setting!(set_by_name);

macro_rules! choices {
    ($($kind:ty: $choices:ident),*) => {
        $(impl Readable for $kind {
            fn read(name: &'static str, text: &str) -> Result<Self> {
                let found = $choices.iter().find(|(word, _)| *word == text);
                let words = || $choices.map(|(word, _)| word).join(", ");
                found
                    .map(|(_, choice)| *choice)
                    .ok_or_else(|| Error::value(name, format!("'{text}'"), words()))
            }
        })*
    };
}

choices!(CostKind: COSTS, Taper: TAPERS, Precision: PRECISIONS, Optimizer: OPTIMIZERS);

impl Readable for usize {
    fn read(name: &'static str, text: &str) -> Result<Self> {
        let accepts = "an integer that is not negative";
        text.parse().map_err(|_| Error::value(name, format!("'{text}'"), accepts))
    }
}

impl Readable for f64 {
    fn read(name: &'static str, text: &str) -> Result<Self> {
        text.parse().map_err(|_| Error::value(name, format!("'{text}'"), "a number"))
    }
}

impl Readable for bool {
    fn read(name: &'static str, text: &str) -> Result<Self> {
        text.parse().map_err(|_| Error::value(name, format!("'{text}'"), "true or false"))
    }
}

impl<T: Readable> Readable for (T, T) {
    fn read(name: &'static str, text: &str) -> Result<Self> {
        let Some((first, second)) = text.split_once(',') else {
            return Err(Error::value(
                name,
                format!("'{text}'"),
                "a pair with a comma, as \"1, 2\"",
            ));
        };
        Ok((T::read(name, first.trim())?, T::read(name, second.trim())?))
    }
}

impl<T: Readable> Readable for Option<T> {
    fn read(name: &'static str, text: &str) -> Result<Self> {
        if text == "none" { Ok(None) } else { T::read(name, text).map(Some) }
    }
}
