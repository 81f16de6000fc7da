//! Parsing of numbers in user input, and helpers for messages that quote it.

/// Parses an unsigned number of decimal digits only; `str::parse` would accept a plus sign.
pub(crate) fn decimal(text: &str) -> Option<u64> {
    text.parse().ok().filter(|_| text.bytes().all(|byte| byte.is_ascii_digit()))
}

/// The text with invisible characters, such as NUL, replaced by their codes, so that a message shows them.
pub(crate) fn visible(message: &str) -> String {
    let mut shown = String::with_capacity(message.len());
    for character in message.chars() {
        if character.is_control() || matches!(character, '\u{200B}'..='\u{200F}' | '\u{2028}'..='\u{202E}' | '\u{FEFF}')
        {
            shown.extend(character.escape_unicode());
        } else {
            shown.push(character);
        }
    }
    shown
}

/// Longer words get no suggestion, because the time of the comparison grows with the square of the length.
const SUGGESTION_LEN_MAX: usize = 64;

/// The text ` did you mean ..?` if one of the known words is similar, otherwise an empty text. Similar means that the
/// edit distance is at most a third of the longer word's length. \[OURS]
pub(crate) fn suggestion(word: &str, known: impl IntoIterator<Item = &'static str>) -> String {
    if word.len() > SUGGESTION_LEN_MAX {
        return String::new();
    }
    let word = word.to_lowercase();
    let distances = known.into_iter().map(|name| (strsim::osa_distance(&word, name), name));
    let near = distances.filter(|(distance, name)| *distance <= name.len().max(word.len()) / 3);
    near.min_by_key(|(distance, _)| *distance).map(|(_, name)| format!(" did you mean `{name}`?")).unwrap_or_default()
}

/// The number of the line, from 1, at a position of a text.
pub(crate) fn line_at(text: &str, at: usize) -> usize {
    let before = text.as_bytes().get(..at).unwrap_or(text.as_bytes());
    1 + before.iter().filter(|byte| **byte == b'\n').count()
}
