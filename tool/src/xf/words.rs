//! Names of states and options in the tool's spelling, and the parsing of such names.

use ecmsk::ethercat::AlStatus;
use ecmsk::xf::fields::Names;
use ecmsk::xf::{EtherCatState, NetworkState};

/// The AL states of a network, with the names that all verbs of the tool use.
pub const STATES: [(&str, EtherCatState); 5] = [
    ("Init", EtherCatState::Init),
    ("PreOP", EtherCatState::PreOp),
    ("Boot", EtherCatState::Boot),
    ("SafeOP", EtherCatState::SafeOp),
    ("OP", EtherCatState::Op),
];

/// The name of an AL state.
pub fn state_name(state: EtherCatState) -> &'static str {
    STATES.iter().find(|(_, known)| *known == state).map_or("unknown", |(name, _)| name)
}

/// A state that the chip reports, such as `SafeOP` and `PreOP, with an error`.
pub fn state_text(state: NetworkState) -> String {
    let name = match state.state() {
        Some(known) => state_name(known).to_owned(),
        None if state.0 & 0x0F == 0 => "not initialised".to_owned(),
        None => format!("unknown (0x{:02X})", state.0),
    };
    if state.has_error() { format!("{name}, with an error") } else { name }
}

/// Parses the number of a slave.
///
/// # Errors
/// The text is not a slave number; the error says what is allowed.
pub fn slave_number(text: &str) -> Result<u8, String> {
    let number = text.parse().ok().filter(|number| *number <= 127);
    number.ok_or_else(|| "allowed: 0 to 127, the first slave is 0".to_owned())
}

/// Parses the name of a state; upper and lower case are equal.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn parse_state(text: &str) -> Result<EtherCatState, String> {
    let state = STATES.iter().find(|(name, _)| name.eq_ignore_ascii_case(text));
    state.map(|(_, state)| *state).ok_or_else(|| "allowed: init, preop, boot, safeop, op".into())
}

/// Converts a Rust name of the library to the word that users type: `PinRising`, `X4Free` and `NON_IMMEDIATE` become
/// `pin-rising`, `x4-free` and `non-immediate`.
pub fn word(name: &str) -> String {
    let mut word = String::new();
    let mut before = '_';
    for letter in name.chars() {
        let begins = letter.is_ascii_uppercase() && (before.is_ascii_lowercase() || before.is_ascii_digit());
        match letter {
            '_' => word.push('-'),
            _ if begins => word.extend(['-', letter.to_ascii_lowercase()]),
            _ => word.push(letter.to_ascii_lowercase()),
        }
        before = letter;
    }
    word
}

/// Converts several names as [`word`] does.
pub fn words(names: impl Iterator<Item = &'static str>) -> Vec<String> {
    names.map(word).collect()
}

/// Joins texts such as the names of bits by commas; `none` if there are none.
pub fn listed(words: &[String]) -> String {
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}

/// The AL status code as text to be appended to a line; empty if the code is 0.
pub fn al_status_text(code: u16) -> String {
    if code == 0 { String::new() } else { format!(", AL status code {}", AlStatus(code)) }
}

/// The code of a name in a list. Case, dashes, underscores and spaces are ignored.
pub fn named(text: &str, names: &[(&str, u32)]) -> Option<u32> {
    let plain = |text: &str| text.replace(['-', '_', ' '], "").to_ascii_lowercase();
    names.iter().find(|(name, _)| plain(name) == plain(text)).map(|(_, number)| *number)
}

/// The code of a name in a list, as [`named`] finds it.
///
/// # Errors
/// There is no such name; the error lists the valid ones.
pub fn chosen(text: &str, names: Names) -> Result<u32, String> {
    named(text, names).ok_or_else(|| format!("allowed: {}", list(names).join(", ")))
}

/// The names in the form that users type, see [`word`].
pub fn list(names: Names) -> Vec<String> {
    names.iter().map(|(name, _)| word(name)).collect()
}

/// Converts a 12-bit value of the DAC or the ADC to volts.
pub fn volts(value: u32) -> f64 {
    f64::from(value) * 3.3 / 4095.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// XF-18.10 Names of the library are shown as words, and words are accepted in any spelling.
    #[test]
    fn names_become_words() {
        for (name, wanted) in [
            ("PinRising", "pin-rising"),
            ("X4Free", "x4-free"),
            ("NON_IMMEDIATE", "non-immediate"),
            ("INT0_HIGH", "int0-high"),
            ("Mhz192", "mhz192"),
            ("Lrw", "lrw"),
        ] {
            assert_eq!(word(name), wanted);
            for text in [name, wanted, &wanted.to_uppercase(), &wanted.replace('-', "")] {
                assert_eq!(named(text, &[("Other", 1), (name, 7)]), Some(7), "{text}");
            }
        }
        let names: Names = &[("PreOp", 2), ("Op", 8)];
        assert_eq!(chosen("up", names), Err("allowed: pre-op, op".to_owned()));
        assert_eq!(state_text(NetworkState(0x14)), "SafeOP, with an error");
        assert_eq!(
            (state_text(NetworkState(0)), state_text(NetworkState(7))),
            ("not initialised".to_owned(), "unknown (0x07)".to_owned())
        );
    }
}
