//! Codes of the standard that have names.

/// Gives a newtype its codes: a constant with its text for each, `ALL`, `text`, and [`Display`](core::fmt::Display) as the format of
/// the number and the text. A code without a name survives and has no text.
macro_rules! named_codes {
    ($type:ident as $format:literal; $($name:ident = $code:literal, $text:literal;)*) => {
        impl $type {
            $(#[doc = $text] pub const $name: Self = Self($code);)*

            /// All codes that have a name here, ascending.
            pub const ALL: &'static [Self] = &[$(Self::$name,)*];

            /// The code's meaning; `None` for a code that no list has.
            pub const fn text(self) -> Option<&'static str> {
                match self.0 {
                    $($code => Some($text),)*
                    _ => None,
                }
            }
        }

        impl core::fmt::Display for $type {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                write!(f, $format, self.0)?;
                self.text().map_or(Ok(()), |text| write!(f, " ({text})"))
            }
        }
    };
}

pub(super) use named_codes;
