//! The macro for numeric codes of the standards that have names.

/// Defines the named codes of an integer newtype: one constant per code, `ALL`, `text` (the meaning of a code), and a
/// [`Display`](core::fmt::Display) that shows the number in the format given after `as`, and the meaning in
/// parentheses. A value may also be a code without a name; it has no text.
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
