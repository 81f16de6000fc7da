//! Names of the kinds of slaves: for `--kinds`, and in the JSON of a dump.

use ecmsk::sk::SlaveKind;
use ecmsk::sk::dump::MAX_SLAVES;

/// Kinds of slaves in the order of the network, as `--kinds` has them: `drive*2,io`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KindList(Vec<SlaveKind>);

/// The names. All names in a link's `slaves` are among them, so that the same list can be used for both.
const WORDS: [(&str, SlaveKind); 7] = [
    ("drive", SlaveKind::Drive),
    ("io", SlaveKind::Io),
    ("hsp", SlaveKind::Hsp),
    ("hsp2", SlaveKind::Hsp),
    ("step", SlaveKind::Step),
    ("dp3cl", SlaveKind::Step),
    ("none", SlaveKind::None),
];

/// The word for a kind.
pub fn word(kind: SlaveKind) -> &'static str {
    // Every kind has its name in the table.
    WORDS.into_iter().find(|(_, known)| *known == kind).map_or("none", |(word, _)| word)
}

impl KindList {
    /// The kinds in the order of the network, slave 1 first.
    pub fn kinds(&self) -> &[SlaveKind] {
        &self.0
    }

    /// Parses a comma list of kinds, each with `*N` if there are N in a row. A part behind a colon, with which other
    /// lists of slaves give a mode or a travel, is ignored.
    ///
    /// # Errors
    /// The text is invalid; the error says what is wrong and what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut kinds = Vec::new();
        for item in text.split(',') {
            let (word, count) = item.split_once('*').map_or((item, Some(1)), |(word, n)| (word, n.parse().ok()));
            let word = word.split(':').next().unwrap_or_default();
            let kind = WORDS.into_iter().find(|(name, _)| name.eq_ignore_ascii_case(word.trim()));
            let Some((_, kind)) = kind else {
                return Err(format!("kind `{word}` is unknown; allowed: {}", WORDS.map(|(name, _)| name).join(", ")));
            };
            let Some(count @ 1..=MAX_SLAVES) = count else {
                return Err(format!("in `{item}` a number from 1 to {MAX_SLAVES} belongs after the *"));
            };
            kinds.extend(std::iter::repeat_n(kind, count));
        }
        if kinds.len() > MAX_SLAVES {
            return Err(format!("{} slaves, allowed: at most {MAX_SLAVES}", kinds.len()));
        }
        Ok(Self(kinds))
    }
}
