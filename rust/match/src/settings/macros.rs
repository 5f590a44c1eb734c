//! The macros of the table of settings.

/// Makes an enum of the words that a setting can be: each variant is a word in C and Python, and its
/// documentation is the meaning of the word there.
macro_rules! words {
    ($(
        $(#[doc = $about:literal])+
        $type:ident { $($(#[doc = $meaning:literal])+ $word:literal: $variant:ident $(in $module:ident)?,)+ }
    )+) => {
        $(
            $(#[doc = $about])+
            #[derive(Debug, Clone, Copy, PartialEq, Eq)]
            pub enum $type { $($(#[doc = $meaning])+ $variant,)+ }

            impl $type {
                /// All variants.
                pub const ALL: &[Self] = &[$(Self::$variant),+];
            }

            impl Setting for $type {
                const KIND: Kind = Kind::Word(&[$(($word, concat!($($meaning),+))),+]);

                fn from_value(value: &Value) -> Option<Self> {
                    let Value::Word(word) = value else { return None };
                    match *word {
                        $($word => Some(Self::$variant),)+
                        _ => None,
                    }
                }

                fn to_value(self) -> Value {
                    Value::Word(match self { $(Self::$variant => $word),+ })
                }
            }
        )+
    };
}

/// Turns each entry of the table
///
/// ```text
/// /// Its meaning, in a sentence.
/// ///
/// /// All else about it.
/// name: type, in range, default value, paper value, fast value;
/// ```
///
/// into a field of `Settings` with this documentation, its value in each preset, the check of its range, its
/// conversion to and from a `Value`, and a `SettingDescription` from which Python's class and the reference
/// are written. Without a range, every value of the type is accepted; presets that are not mentioned have the
/// default.
macro_rules! settings {
    ($(
        $(#[doc = $doc:literal])+
        $name:ident: $type:ty $(, in $range:expr)?, default $default:expr
            $(, paper $paper:expr)? $(, fast $fast:expr)?;
    )+) => {
        /// All settings of a match; the defaults are those of [`Preset::Robust`].
        ///
        /// More settings will be added: write those you need, and `..Settings::default()` for the others.
        #[derive(Debug, Clone, PartialEq)]
        pub struct Settings {
            $(
                $(#[doc = $doc])+
                $(#[doc = concat!("\n\nRange: `", stringify!($range), "`.")])?
                #[doc = concat!("\n\nDefault: `", stringify!($default), "`"
                    $(, "; paper: `", stringify!($paper), "`")? $(, "; fast: `", stringify!($fast), "`")?, ".")]
                pub $name: $type,
            )+
        }

        /// The settings, in the order of the table.
        pub const DESCRIPTIONS: &[SettingDescription] = &[$(SettingDescription {
            name: stringify!($name),
            documentation: concat!($($doc, "\n"),+),
            kind: <$type>::KIND,
            range: || String::new() $(+ &$range.text)?,
        }),+];

        impl Preset {
            /// The settings of the preset.
            pub fn settings(self) -> Settings {
                let mut settings = Settings { $($name: $default),+ };
                match self {
                    Self::Robust => {}
                    Self::Paper => { $($(settings.$name = $paper;)?)+ }
                    Self::Fast => { $($(settings.$name = $fast;)?)+ }
                }
                settings
            }
        }

        impl Default for Settings {
            fn default() -> Self {
                Preset::Robust.settings()
            }
        }

        impl Settings {
            /// Refuses a value outside the range of its field.
            pub(super) fn check_ranges(&self) -> Result<()> {
                $($($range.check(stringify!($name), self.$name)?;)?)+
                Ok(())
            }

            /// The values of all fields, in the order of the table.
            pub fn values(&self) -> Vec<Value> {
                vec![$(self.$name.to_value()),+]
            }

            /// Sets the field of this name if the value is of its kind; returns whether it did.
            pub(super) fn put(&mut self, name: &str, value: &Value) -> bool {
                match name {
                    $(stringify!($name) => Setting::from_value(value).map(|value| self.$name = value),)+
                    _ => None,
                }
                .is_some()
            }
        }
    };
}
