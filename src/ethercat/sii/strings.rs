//! The texts of an EEPROM.

use core::fmt::{self, Write as _};

/// A text of an EEPROM.
///
/// ETG.2010 has texts in ISO-8859-1. \[OURS] Bytes that are UTF-8 are taken for that, as some tools write it: in the other encoding they
/// would be no words. What a terminal obeys is left out.
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

/// The texts of a category; each has a number from 1, and is shown as [`SiiText`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SiiStrings<'a> {
    data: &'a [u8],
}

impl<'a> SiiStrings<'a> {
    pub(super) const fn new(data: &'a [u8]) -> Self {
        Self { data }
    }

    /// The texts, number 1 first, as many as the category announces and has.
    pub fn iter(self) -> impl Iterator<Item = &'a [u8]> {
        let (count, mut rest) = self.data.split_first().map_or((0, self.data), |(count, rest)| (*count, rest));
        (0..count).map_while(move |_| {
            let (len, behind) = rest.split_first()?;
            let (text, behind) = behind.split_at_checked(usize::from(*len))?;
            rest = behind;
            Some(text)
        })
    }

    /// The text with a number; `None` for number 0, which stands for no text, and for one that is not there.
    pub fn get(self, number: u8) -> Option<&'a [u8]> {
        self.iter().nth(usize::from(number).checked_sub(1)?)
    }
}
