//! Words and numbers in what a person writes, and how a message shows them.

/// A whole number of decimal digits alone: `parse` would let a plus sign pass.
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

/// ` did you mean ..?` if one of the known words is similar: at most every third letter differs. \[OURS]
pub(crate) fn suggestion(word: &str, known: impl IntoIterator<Item = &'static str>) -> String {
    if word.len() > SUGGESTION_LEN_MAX {
        return String::new();
    }
    let word = word.to_lowercase();
    let distances = known.into_iter().map(|name| (strsim::osa_distance(&word, name), name));
    let near = distances.filter(|(distance, name)| *distance <= name.len().max(word.len()) / 3);
    near.min_by_key(|(distance, _)| *distance).map(|(_, name)| format!(" did you mean `{name}`?")).unwrap_or_default()
}
