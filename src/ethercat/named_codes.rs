//! The macro for numeric codes of the standards that have names.

/// Defines the codes of a newtype: one constant per code with its text, `ALL`, `text`, and a
/// [`Display`](core::fmt::Display) that shows the number in the given format and the text. A code without a name is kept
/// and has no text.
macro_rules! named_codes {
    ($type:ident as $format:literal; $($name:ident = $code:literal, $text:literal;)*) => {
        impl $type {
            $(#[doc = $text] pub const $name: Self = Self($code);)*

            /// All codes with a name, in ascending order.
            pub const ALL: &'static [Self] = &[$(Self::$name,)*];

            /// The meaning of the code; `None` for a code that the standards do not list.
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
