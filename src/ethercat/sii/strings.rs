//! The texts in an EEPROM, and their display.

use core::fmt::{self, Write as _};

/// A text of an EEPROM.
///
/// ETG.2010 defines ISO-8859-1 for texts. \[OURS] A text whose bytes are valid UTF-8 is decoded as UTF-8, which some tools
/// write; as ISO-8859-1 it would not be readable. Control characters are left out of the display.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SiiText<'a>(pub &'a [u8]);

impl fmt::Display for SiiText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut put = |c: char| if c.is_control() { Ok(()) } else { f.write_char(c) };
        match core::str::from_utf8(self.0) {
            Ok(text) => text.chars().try_for_each(&mut put),
            Err(_) => self.0.iter().try_for_each(|byte| put(char::from(*byte))),
        }
    }
}

/// The texts of a category, numbered from 1. [`SiiText`] displays a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SiiStrings<'a> {
    data: &'a [u8],
}

impl<'a> SiiStrings<'a> {
    pub(super) const fn new(data: &'a [u8]) -> Self {
        Self { data }
    }

    /// Iterates over the texts, beginning with number 1. The number of texts is limited by the count in the category and by
    /// its length.
    pub fn iter(self) -> impl Iterator<Item = &'a [u8]> {
        let (count, mut rest) = self.data.split_first().map_or((0, self.data), |(count, rest)| (*count, rest));
        (0..count).map_while(move |_| {
            let (len, behind) = rest.split_first()?;
            let (text, behind) = behind.split_at_checked(usize::from(*len))?;
            rest = behind;
            Some(text)
        })
    }

    /// The text with the given number, by which other categories refer to it. `None` for number 0, which means "no
    /// text", and for a number without a text.
    pub fn get(self, number: u8) -> Option<&'a [u8]> {
        self.iter().nth(usize::from(number).checked_sub(1)?)
    }
}
