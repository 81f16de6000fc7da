//! The texts of an EEPROM.

/// The texts of a category; each has a number from 1. They are bytes, since nobody says in which encoding they are.
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
