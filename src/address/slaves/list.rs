//! The syntax that all lists of slaves share: comma-separated entries `KIND:PART:PART*N`. The callers define the kinds,
//! and the meaning of the parts, which are the options of a kind.

use std::iter::repeat_n;

use crate::address::text::decimal;

/// The characters that begin an option of a kind (`:`) and the repeat count (`*`).
const SIGNS: [char; 2] = [':', '*'];

/// One entry of a list, split at `:` and `*`.
pub(super) struct Entry<'a> {
    /// The whole entry, as written.
    pub(super) text: &'a str,
    /// The kind: the text before the first `:` or `*`.
    pub(super) kind: &'a str,
    /// The options of the kind, such as `limits@-1000..1000`, each written after a `:`.
    pub(super) parts: Vec<&'a str>,
    /// The repeat counts, each written after a `*`. A valid entry has at most one. An entry without a count stands for
    /// one slave.
    numbers: Vec<&'a str>,
    /// Whether the repeat count, if there is one, is at the end of the entry.
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

    /// The entry with blanks removed around the kind, its options and the repeat count.
    fn trimmed(mut self) -> Self {
        self.kind = self.kind.trim();
        self.parts.iter_mut().chain(&mut self.numbers).for_each(|piece| *piece = piece.trim());
        self
    }

    /// The message for an error in this entry.
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

/// Returns the text before the next `:` or `*`, and the rest, which begins with this separator.
fn next_piece(text: &str) -> (&str, &str) {
    text.split_at(text.find(SIGNS).unwrap_or(text.len()))
}

/// The syntax that the parser accepts for a list of slaves.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// For links: without blanks, and with the repeat count last, so that each list has one form and normal forms can
    /// be compared.
    Strict,
    /// For text that people type: blanks are ignored, and options of the kind may follow the repeat count.
    Loose,
}

/// Parses a list: `read` converts each entry into a slave, which is repeated as the entry says.
///
/// # Errors
/// The message of `read`, or a message about an invalid repeat count or too many slaves.
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

/// Joins the texts of slaves with commas. Equal neighbours are written once with their count: `drive*2,io`.
pub(crate) fn list(words: impl Iterator<Item = String>) -> String {
    let words: Vec<String> = words.collect();
    let runs = words.chunk_by(|a, b| a == b).map(|run| match run.len() {
        1 => run[0].clone(),
        n => format!("{}*{n}", run[0]),
    });
    runs.collect::<Vec<_>>().join(",")
}
