//! The travel of a simulated axis: its start position, limit switches, home switch, index pulse and end stops. A link
//! gives it after the kind of a slave: `drive:limits@-200000..300000:home@-500..500:index@12345`.
//!
//! Every part consists of a word, `@` and a position in counts of the motor shaft (pulses for an hsp). Parts that are
//! not given have the default of the kind. None of the characters used has a special meaning in shells and URIs.

use std::fmt;

use super::kinds::{SlaveModel, UsualTravel};
use super::text::{decimal, suggestion};

/// The largest position in either direction \[OURS]: the range of object 0x6064.
const POSITION_MAX_COUNTS: i64 = i32::MAX as i64;

/// The value that removes a switch or the index pulse which the kind of slave has by default: `home@none` is an axis
/// without a home switch.
const NONE: &str = "none";

/// A range of positions in counts, both ends included. One of the two ends may be missing; the range is then unlimited
/// in that direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PositionRange {
    /// The lowest position, counts; `None` if the range has no lower end.
    pub from: Option<i64>,
    /// The highest position, counts; `None` if the range has no upper end.
    pub to: Option<i64>,
}

impl PositionRange {
    fn parse(text: &str) -> Option<Self> {
        let (from, to) = text.split_once("..")?;
        let end = |text: &str| if text.is_empty() { Some(None) } else { position(text).map(Some) };
        let span = Self { from: end(from)?, to: end(to)? };
        let in_order = match (span.from, span.to) {
            (Some(from), Some(to)) => from <= to,
            (from, to) => from.is_some() || to.is_some(),
        };
        in_order.then_some(span)
    }
}

impl fmt::Display for PositionRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let end = |end: Option<i64>| end.map(|place| place.to_string()).unwrap_or_default();
        write!(f, "{}..{}", end(self.from), end(self.to))
    }
}

/// The travel that a link gives for the axes of a slave. If the slave has two axes, it applies to both. `None` in a
/// field means the default of the kind of slave, `Some(None)` that the axis does not have this part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct TravelSpec {
    /// The position at power-on, counts; 0 if not given.
    pub start: Option<i64>,
    /// The limit switches, counts: the negative one is active at `from` and below, the positive one at `to` and above.
    /// Explicitly given limit switches act in every mode; the default ones act only in homing, except those of a DP3CL.
    pub limits: Option<Option<PositionRange>>,
    /// The positions at which the home switch is active, counts. If one end is missing, the switch is active everywhere
    /// beyond the other end.
    pub home: Option<Option<PositionRange>>,
    /// A position of the index pulse, counts, from 0; the pulse repeats once per turn in both directions.
    pub index: Option<Option<u32>>,
    /// Mechanical end stops that the shaft cannot pass, counts.
    pub stops: Option<PositionRange>,
    /// The maximum distance that a homing run searches for its reference, counts.
    pub search: Option<u64>,
}

/// One part of a slave's travel in a URI, such as `limits@..`: how it is written, read and explained.
struct Part {
    word: &'static str,
    /// The syntax of the value after the `@`.
    form: &'static str,
    meaning: &'static str,
    /// The number of axes of a slave of this kind for which a link can give this part; 0 if the kind does not allow it.
    axes: fn(SlaveModel) -> usize,
    /// Parses the value and stores it in a [`TravelSpec`]; returns false if the value is invalid.
    read: fn(&mut TravelSpec, &str) -> bool,
    /// The value as text; `None` if the [`TravelSpec`] does not have the part.
    write: fn(&TravelSpec) -> Option<String>,
}

const PARTS: [Part; 6] = [
    Part {
        word: "start",
        form: "N",
        meaning: "where the axis stands at power-on",
        axes: SlaveModel::axes,
        read: |travel, text| set(&mut travel.start, position(text)),
        write: |travel| travel.start.filter(|start| *start != 0).map(|start| start.to_string()),
    },
    Part {
        word: "limits",
        form: "N..P|N..|..P|none",
        meaning: "limit switches: the negative one at N and below, the positive one at P and above; limits that are given\n      \
                  stop the axis in every mode, with bit 11 of the statusword, and the way back is free",
        axes: SlaveModel::axes,
        read: |travel, text| set(&mut travel.limits, unless_none(text, PositionRange::parse)),
        write: |travel| travel.limits.map(or_none),
    },
    Part {
        word: "home",
        form: "A..B|A..|..B|none",
        meaning: "where the home switch is on",
        axes: SlaveModel::axes,
        read: |travel, text| set(&mut travel.home, unless_none(text, PositionRange::parse)),
        write: |travel| travel.home.map(or_none),
    },
    Part {
        word: "index",
        form: "N|none",
        meaning: "an index pulse at N, and once a turn",
        axes: SlaveModel::axes,
        read: |travel, text| set(&mut travel.index, unless_none(text, |text| u32::try_from(position(text)?).ok())),
        write: |travel| travel.index.filter(|index| *index != Some(0)).map(or_none),
    },
    Part {
        word: "stops",
        form: "A..B",
        meaning: "mechanical end stops, for slaves with a motor",
        axes: SlaveModel::motors,
        read: |travel, text| {
            let both = |span: &PositionRange| span.from.is_some() && span.to.is_some() && span.from < span.to;
            set(&mut travel.stops, PositionRange::parse(text).filter(both))
        },
        write: |travel| travel.stops.map(|stops| stops.to_string()),
    },
    Part {
        word: "search",
        form: "N",
        meaning: "a homing run gives up after N counts",
        axes: SlaveModel::axes,
        read: |travel, text| {
            let way = position(text).and_then(|way| u64::try_from(way).ok());
            set(&mut travel.search, way.filter(|way| *way > 0))
        },
        write: |travel| travel.search.map(|search| search.to_string()),
    },
];

/// Stores a parsed value in a field of [`TravelSpec`], `place`. Returns false if `value` is `None`, because parsing has
/// failed.
fn set<T>(place: &mut Option<T>, value: Option<T>) -> bool {
    *place = value;
    place.is_some()
}

impl TravelSpec {
    /// Parses the options for the travel that follow the kind of a slave, such as `home@-500..500`.
    ///
    /// # Errors
    /// Why an option is invalid, and what is allowed.
    pub(crate) fn parse(parts: &[&str]) -> Result<Self, String> {
        let mut travel = Self::default();
        let mut seen = Vec::new();
        for item in parts {
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
                    "`{value}` in `{item}` is no value; allowed: {}@{}, places from -{POSITION_MAX_COUNTS} to {POSITION_MAX_COUNTS}, the lower \
                     one first",
                    part.word, part.form
                ));
            }
        }
        travel.check()?;
        Ok(travel)
    }

    fn check(&self) -> Result<(), String> {
        let Some(PositionRange { from: Some(from), to: Some(to) }) = self.stops else { return Ok(()) };
        let start = self.start.unwrap_or(0);
        if (from..=to).contains(&start) {
            return Ok(());
        }
        Err(format!(
            "the axis stands at {start} and cannot be there with stops@{from}..{to}; allowed: start@ between them"
        ))
    }
}

/// Writes each given option with a `:` before it, such as `:home@-500..500`, in the order of the table `PARTS`.
impl fmt::Display for TravelSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        PARTS.iter().try_for_each(|part| match (part.write)(self) {
            Some(value) => write!(f, ":{}@{value}", part.word),
            None => Ok(()),
        })
    }
}

/// The default travel of each kind, for `ecmsk link help`.
fn usual_help() -> String {
    let mut rows: Vec<(UsualTravel, Vec<&str>)> = Vec::new();
    for model in SlaveModel::ALL {
        let Some(usual) = model.usual_travel() else { continue };
        match rows.iter_mut().find(|(known, _)| *known == usual) {
            Some((_, kinds)) => kinds.push(model.name()),
            None => rows.push((usual, vec![model.name()])),
        }
    }
    let mut text = String::from(
        "Of what is not given there is the usual, whose limits are for homing (and for all of a dp3cl):\n",
    );
    for (UsualTravel { parts, counts_a_turn }, kinds) in rows {
        text.push_str(&format!("  {:<24} :{parts}, {counts_a_turn} counts a turn\n", kinds.join(", ")));
    }
    text
}

/// The words before `@`, such as `limits`, of the options that a slave of this kind can have.
pub(super) fn words_of(model: SlaveModel) -> impl Iterator<Item = &'static str> {
    PARTS.iter().filter(move |part| (part.axes)(model) > 0).map(|part| part.word)
}

/// The section of `ecmsk link help` on the travel of axes.
pub(crate) fn help() -> String {
    let mut text = String::from(
        "Behind a kind with axes may stand what is along their way, in counts of the shaft (pulses of an hsp), e.g.\n\
         drive:start@-50000:limits@-200000..300000:home@-500..500*2. Neither shells nor URIs mind:\n",
    );
    for Part { word, form, meaning, .. } in &PARTS {
        text.push_str(&format!("  :{word}@{form}\n      {meaning}\n"));
    }
    text + &usual_help()
}

fn allowed() -> String {
    format!(
        "allowed: {}",
        PARTS.iter().map(|part| format!("{}@{}", part.word, part.form)).collect::<Vec<_>>().join(", ")
    ) + ", objects@FILE|any"
}

/// Parses an integer position with an optional minus sign.
fn position(text: &str) -> Option<i64> {
    let (digits, sign) = text.strip_prefix('-').map_or((text, 1), |digits| (digits, -1));
    let place = i64::try_from(decimal(digits)?).ok()?;
    (place <= POSITION_MAX_COUNTS).then_some(sign * place)
}

fn unless_none<T>(text: &str, read: impl FnOnce(&str) -> Option<T>) -> Option<Option<T>> {
    if text == NONE { Some(None) } else { read(text).map(Some) }
}

fn or_none(value: Option<impl fmt::Display>) -> String {
    value.map_or_else(|| NONE.to_owned(), |value| value.to_string())
}

#[cfg(all(test, feature = "sim"))]
mod tests {
    use super::*;
    use crate::slave::{Dp3clConfig, DriveConfig, HomeSwitch, HspConfig, Travel};

    /// The default travel in the table of kinds equals that of the models.
    #[test]
    fn the_usual_travel_is_what_the_models_have() {
        for model in SlaveModel::ALL {
            let hsp = HspConfig::default().travels;
            let travels = match model {
                SlaveModel::Drive => vec![DriveConfig::default().travel],
                SlaveModel::Step => vec![DriveConfig::stepper().travel],
                SlaveModel::Dp3cl => vec![Dp3clConfig::default().travel],
                SlaveModel::Hsp => vec![hsp[0]],
                SlaveModel::Hsp2 => hsp.to_vec(),
                _ => vec![],
            };
            assert_eq!(travels.len(), model.axes(), "{model:?}");
            assert_eq!(model.usual_travel().is_some(), !travels.is_empty(), "{model:?}");
            for travel in travels {
                let usual = model.usual_travel().expect("there are axes");
                let said = TravelSpec::parse(&usual.parts.split(':').collect::<Vec<_>>()).expect(usual.parts);
                let range = |from, to| Some(Some(PositionRange { from: Some(from), to: Some(to) }));
                let Travel {
                    negative_limit: Some(negative), positive_limit: Some(positive), index: Some(index), ..
                } = travel
                else {
                    panic!("{travel:?}")
                };
                let Some(HomeSwitch::Cam { first, last }) = travel.home else { panic!("{travel:?}") };
                assert_eq!(said.limits, range(negative, positive), "{model:?}");
                assert_eq!(said.home, range(first, last), "{model:?}");
                assert_eq!(said.index, Some(Some(index)), "{model:?}");
            }
        }
    }
}
