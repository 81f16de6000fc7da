//! What all lists of slaves have in common: entries `KIND:PART:PART*N` between commas. Which kinds there are and what the
//! parts mean is up to who reads the list.

use std::iter::repeat_n;

use crate::address::text::decimal;

/// The characters that end a kind, a part or a number, and begin the next part or the number.
const SIGNS: [char; 2] = [':', '*'];

/// An entry of a list, in its pieces.
pub(super) struct Entry<'a> {
    /// The entry as it is written.
    pub(super) text: &'a str,
    /// The kind: the text before the first `:` or `*`.
    pub(super) kind: &'a str,
    /// The parts of the kind, each behind a `:`.
    pub(super) parts: Vec<&'a str>,
    /// The numbers of slaves in a row, each behind a `*`. A valid entry has one, or none for one slave.
    numbers: Vec<&'a str>,
    /// Whether no part stands behind a number.
    number_is_last: bool,
}

impl<'a> Entry<'a> {
    fn new(text: &'a str) -> Self {
        let (kind, mut rest) = next_piece(text);
        let mut entry = Self { text, kind, parts: Vec::new(), numbers: Vec::new(), number_is_last: true };
        while let Some(sign) = rest.chars().next() {
            let (piece, behind) = next_piece(&rest[sign.len_utf8()..]);
            if sign == '*' {
                entry.numbers.push(piece);
            } else {
                entry.parts.push(piece);
                entry.number_is_last &= entry.numbers.is_empty();
            }
            rest = behind;
        }
        entry
    }

    /// The same without blanks around its pieces.
    fn trimmed(mut self) -> Self {
        self.kind = self.kind.trim();
        self.parts.iter_mut().chain(&mut self.numbers).for_each(|piece| *piece = piece.trim());
        self
    }

    /// An error of a piece of this entry.
    pub(super) fn error(&self, why: &str) -> String {
        format!("in `{}`, {why}", self.text)
    }

    fn check_number_is_last(&self) -> Result<(), String> {
        if self.number_is_last {
            return Ok(());
        }
        let (parts, number) = (self.parts.join(":"), self.numbers.join("*"));
        Err(self.error(&format!("the number stands last; allowed: {}:{parts}*{number}", self.kind)))
    }

    fn count(&self, slaves_max: usize) -> Result<usize, String> {
        let count = match self.numbers[..] {
            [] => Some(1),
            [number] => decimal(number).and_then(|number| usize::try_from(number).ok()),
            _ => None,
        };
        count
            .filter(|count| (1..=slaves_max).contains(count))
            .ok_or_else(|| self.error(&format!("allowed: a whole number from 1 to {slaves_max} after the *")))
    }
}

/// The text up to the next sign, and the rest from there.
fn next_piece(text: &str) -> (&str, &str) {
    text.split_at(text.find(SIGNS).unwrap_or(text.len()))
}

/// Which spelling of a list is valid.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// Without blanks, and the number of an entry last: as a link has it, whose normal form is compared.
    Strict,
    /// As people write it: blanks are ignored, parts may stand behind the number.
    Loose,
}

/// Reads a list: `read` makes a slave of each entry, which is repeated as often as the entry says.
///
/// # Errors
/// What `read` says, a number that is none, too many slaves.
pub(super) fn read<T: Clone>(
    list: &str,
    form: Form,
    slaves_max: usize,
    read: impl Fn(&Entry<'_>) -> Result<T, String>,
) -> Result<Vec<T>, String> {
    let (mut slaves, mut total) = (Vec::new(), 0_usize);
    for entry in list.split(',').map(Entry::new) {
        let entry = if form == Form::Loose { entry.trimmed() } else { entry };
        if form == Form::Strict {
            entry.check_number_is_last()?;
        }
        let count = entry.count(slaves_max)?;
        let slave = read(&entry)?;
        total = total.saturating_add(count);
        if total <= slaves_max {
            slaves.extend(repeat_n(slave, count));
        }
    }
    if total > slaves_max {
        return Err(format!("{total} slaves, allowed: at most {slaves_max} slaves"));
    }
    Ok(slaves)
}

/// The words as a list in which equal neighbours are counted: `drive*2,io`.
pub(crate) fn list(words: impl Iterator<Item = String>) -> String {
    let words: Vec<String> = words.collect();
    let runs = words.chunk_by(|a, b| a == b).map(|run| match run.len() {
        1 => run[0].clone(),
        n => format!("{}*{n}", run[0]),
    });
    runs.collect::<Vec<_>>().join(",")
}
