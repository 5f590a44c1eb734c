//! Enums whose variants have names.

use crate::base::error::{Error, Result};

/// Turns `Variant = "name"` into the variants of an enum, the list of them, and their names.
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
            /// All variants.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$variant),+];

            /// The name of the variant.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),+ }
            }
        }
    };
}

/// The variant of this name, given as the value of an argument.
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
