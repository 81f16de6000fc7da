//! What is along the way of a simulated axis, as a link writes it behind the kind of a slave:
//! `drive:limits@-200000..300000:home@-500..500:index@12345`.
//!
//! Every part is a word, `@` and a place, in counts of the shaft (pulses of an hsp); what is not named is as the kind has
//! it by default. Neither shells nor URIs have a meaning for these characters.

use std::fmt;

use super::uri::suggestion;

/// Places that can be named, either way \[OURS]: those that object 0x6064 can show.
const FARTHEST: i64 = i32::MAX as i64;

/// The word for a part that is not there.
const NONE: &str = "none";

/// Places from one to another, both among them; an end that is not there has no bound. One of the two is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Span {
    /// The lowest place.
    pub from: Option<i64>,
    /// The highest place.
    pub to: Option<i64>,
}

impl Span {
    fn parse(text: &str) -> Option<Self> {
        let (from, to) = text.split_once("..")?;
        let end = |text: &str| if text.is_empty() { Some(None) } else { place(text).map(Some) };
        let span = Self { from: end(from)?, to: end(to)? };
        let in_order = match (span.from, span.to) {
            (Some(from), Some(to)) => from <= to,
            (from, to) => from.is_some() || to.is_some(),
        };
        in_order.then_some(span)
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let end = |end: Option<i64>| end.map(|place| place.to_string()).unwrap_or_default();
        write!(f, "{}..{}", end(self.from), end(self.to))
    }
}

/// What a link says of the travel of a slave's axes: of both if it has two. `None`: as the kind of the slave has it by
/// default; `Some(None)`: it is not there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct TravelSpec {
    /// Where the axis stands at power-on; 0 if nothing is said.
    pub start: Option<i64>,
    /// The limit switches: the negative one at the first place and below, the positive one at the second and above.
    pub limits: Option<Option<Span>>,
    /// Where the home switch is active: a cam, or a step up or down if one end is left out.
    pub home: Option<Option<Span>>,
    /// Where the index pulse is: there, and once a turn.
    pub index: Option<Option<u32>>,
    /// Mechanical end stops, which the shaft cannot leave.
    pub stops: Option<Span>,
    /// How far a homing run may go, there and back.
    pub search: Option<u64>,
}

/// One part.
struct Part {
    word: &'static str,
    /// What stands behind the `@`.
    form: &'static str,
    meaning: &'static str,
    /// Takes the value; false: it is none.
    read: fn(&mut TravelSpec, &str) -> bool,
    /// The value, if there is one.
    write: fn(&TravelSpec) -> Option<String>,
}

const PARTS: [Part; 6] = [
    Part {
        word: "start",
        form: "N",
        meaning: "where the axis stands at power-on",
        read: |travel, text| {
            travel.start = place(text);
            travel.start.is_some()
        },
        write: |travel| travel.start.filter(|start| *start != 0).map(|start| start.to_string()),
    },
    Part {
        word: "limits",
        form: "N..P|N..|..P|none",
        meaning: "limit switches: the negative one at N and below, the positive one at P and above",
        read: |travel, text| {
            travel.limits = unless_none(text, Span::parse);
            travel.limits.is_some()
        },
        write: |travel| travel.limits.map(or_none),
    },
    Part {
        word: "home",
        form: "A..B|A..|..B|none",
        meaning: "where the home switch is on",
        read: |travel, text| {
            travel.home = unless_none(text, Span::parse);
            travel.home.is_some()
        },
        write: |travel| travel.home.map(or_none),
    },
    Part {
        word: "index",
        form: "N|none",
        meaning: "an index pulse at N, and once a turn",
        read: |travel, text| {
            let index = |text: &str| u32::try_from(place(text)?).ok();
            travel.index = unless_none(text, index);
            travel.index.is_some()
        },
        write: |travel| travel.index.filter(|index| *index != Some(0)).map(or_none),
    },
    Part {
        word: "stops",
        form: "A..B",
        meaning: "mechanical end stops (drive and step)",
        read: |travel, text| {
            let both = |span: &Span| span.from.is_some() && span.to.is_some() && span.from < span.to;
            travel.stops = Span::parse(text).filter(both);
            travel.stops.is_some()
        },
        write: |travel| travel.stops.map(|stops| stops.to_string()),
    },
    Part {
        word: "search",
        form: "N",
        meaning: "a homing run gives up after N counts",
        read: |travel, text| {
            travel.search = place(text).and_then(|way| u64::try_from(way).ok()).filter(|way| *way > 0);
            travel.search.is_some()
        },
        write: |travel| travel.search.map(|search| search.to_string()),
    },
];

impl TravelSpec {
    /// Reads the parts behind a kind, `:` between them.
    ///
    /// # Errors
    /// Why they are none and what is allowed.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let mut travel = Self::default();
        let mut seen = Vec::new();
        for item in text.split(':') {
            let (word, value) = item.split_once('@').ok_or_else(|| format!("`{item}` is no part; {}", allowed()))?;
            let part = PARTS.iter().find(|part| part.word == word).ok_or_else(|| {
                let near = suggestion(word, PARTS.iter().map(|part| part.word));
                format!("`{word}` in `{item}` is unknown;{near} {}", allowed())
            })?;
            if seen.contains(&word) {
                return Err(format!("`{word}` is given twice; allowed: once"));
            }
            seen.push(word);
            if !(part.read)(&mut travel, value) {
                return Err(format!(
                    "`{value}` in `{item}` is no value; allowed: {}@{}, places from -{FARTHEST} to {FARTHEST}, the lower \
                     one first",
                    part.word, part.form
                ));
            }
        }
        travel.check()?;
        Ok(travel)
    }

    fn check(&self) -> Result<(), String> {
        let Some(Span { from: Some(from), to: Some(to) }) = self.stops else { return Ok(()) };
        let start = self.start.unwrap_or(0);
        if (from..=to).contains(&start) {
            return Ok(());
        }
        Err(format!(
            "the axis stands at {start} and cannot be there with stops@{from}..{to}; allowed: start@ between them"
        ))
    }
}

/// `:` and each part, in the order of the table; nothing if nothing is said.
impl fmt::Display for TravelSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        PARTS.iter().try_for_each(|part| match (part.write)(self) {
            Some(value) => write!(f, ":{}@{value}", part.word),
            None => Ok(()),
        })
    }
}

/// The parts, for the help.
pub(super) fn help() -> String {
    let mut text = String::from(
        "Behind a kind with axes may stand what is along their way, in counts of the shaft (pulses of an hsp), e.g.\n\
         drive:start@-50000:limits@-200000..300000:home@-500..500*2. Neither shells nor URIs mind:\n",
    );
    for Part { word, form, meaning, .. } in &PARTS {
        text.push_str(&format!("  :{word}@{form}\n      {meaning}\n"));
    }
    text
}

fn allowed() -> String {
    format!(
        "allowed: {}",
        PARTS.iter().map(|part| format!("{}@{}", part.word, part.form)).collect::<Vec<_>>().join(", ")
    ) + ", objects@FILE|any"
}

/// A whole number with or without a minus.
fn place(text: &str) -> Option<i64> {
    let digits = text.strip_prefix('-').unwrap_or(text);
    // `parse` alone would let a plus sign pass.
    let plain = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    text.parse().ok().filter(|place: &i64| plain && place.abs() <= FARTHEST)
}

fn unless_none<T>(text: &str, read: impl FnOnce(&str) -> Option<T>) -> Option<Option<T>> {
    if text == NONE { Some(None) } else { read(text).map(Some) }
}

fn or_none(value: Option<impl fmt::Display>) -> String {
    value.map_or_else(|| NONE.to_owned(), |value| value.to_string())
}
