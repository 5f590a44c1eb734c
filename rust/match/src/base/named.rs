//! Enums whose variants have names.

use crate::base::error::{Error, Result};

/// Makes of `Variant = "name"` the variants of an enum, the list of all of them, and their names.
#[macro_export]
macro_rules! named {
    (
        $(#[$about:meta])*
        pub enum $type:ident { $($(#[$meaning:meta])* $variant:ident = $name:literal,)+ }
    ) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $type { $($(#[$meaning])* $variant,)+ }

        impl $type {
            /// All of them.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$variant),+];

            /// Its name.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),+ }
            }
        }
    };
}

/// The one of `all` with a name, which is the value of an argument.
pub fn chosen<T: Copy, const N: usize>(
    argument: &'static str,
    all: [T; N],
    name_of: fn(T) -> &'static str,
    name: &str,
) -> Result<T> {
    let names = || all.map(|one| format!("'{}'", name_of(one))).join(", ");
    let found = all.into_iter().find(|one| name_of(*one) == name);
    found.ok_or_else(|| Error::value(argument, format!("'{name}'"), names()))
}
