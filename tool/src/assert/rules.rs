//! Reads a file of rules, which a user writes: limits, the order of events, and times.
//!
//! ```toml
//! format = 1
//! fail_on = ["state", "gap"]          # as `ecmsk summary --fail-on` takes them
//! at_most = "10s"                     # from the first frame to the last
//!
//! [axes.1]                            # or a name of the machine file, or `all`
//! following_error = 5000              # counts, or e.g. "0.5mm"
//! torque = 80                         # percent
//!
//! [[events]]                          # in this order
//! state = "op"
//! by = "3s"                           # after the opening of the board
//!
//! [[events]]
//! alarm = 2                           # an axis, or "any"
//! code = 0x7500
//! within = "5s"                       # after the event before
//!
//! [[never]]
//! alarm = 1
//! ```

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ecmsk::machine_file::{MachineFile, Unit};
use ecmsk::sk::MasterState;
use serde::Deserialize;

use crate::board::{AxisWord, duration};
use crate::motion::Quantity;
use crate::summary::fail_on::Reason;

/// The version of the file format that this tool reads.
const FORMAT: i64 = 1;
/// The longest file of rules that is read, in bytes. \[OURS]
const FILE_BYTES_MAX: u64 = 1 << 20;
/// The word for all axes. The next constant is the word for an alarm of any axis.
const ALL: &str = "all";
const ANY: &str = "any";

/// Why a file of rules cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RulesError {
    /// The file cannot be read.
    #[error("cannot read the rules {}: {message}; name another file", .file.display())]
    Unreadable {
        /// The path of the file.
        file: PathBuf,
        /// Why it cannot be read.
        message: String,
    },
    /// A rule is invalid.
    #[error("{}: {what}", .file.display())]
    Wrong {
        /// The path of the file.
        file: PathBuf,
        /// The position in the file, what is wrong there, and what to do.
        what: String,
    },
}

/// The rules of a file, after they were checked.
#[derive(Debug, PartialEq)]
pub struct Rules {
    /// The reasons of `fail_on`, which apply to the whole run, each with its text.
    pub fail_on: Vec<(String, Reason)>,
    /// The shortest allowed time from the first frame to the last. The next field is the longest one.
    pub at_least: Option<Duration>,
    pub at_most: Option<Duration>,
    /// The limits of axes.
    pub limits: Vec<Limit>,
    /// Events that must occur, in this order.
    pub events: Vec<Event>,
    /// Events that must not occur.
    pub never: Vec<What>,
}

/// A limit of one axis, or of all axes.
#[derive(Debug, PartialEq)]
pub struct Limit {
    /// The number of the slave; `None` for every axis that was commanded.
    pub slave: Option<u8>,
    pub quantity: Quantity,
    /// The text of the limit in the file, with its unit.
    pub text: String,
    /// The condition under which the limit is exceeded.
    pub above: Reason,
}

/// An event that must occur, and the allowed times.
#[derive(Debug, PartialEq)]
pub struct Event {
    pub what: What,
    /// The longest time after the previous event; for the first event, after the opening of the board.
    pub within: Option<Duration>,
    /// The latest allowed time after the opening of the board. The next field is the earliest one.
    pub by: Option<Duration>,
    pub not_before: Option<Duration>,
}

/// The kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// The network reaches a state.
    State(MasterState),
    /// An axis (`None`: any) has a new alarm, with this error code (`None`: any).
    Alarm { slave: Option<u8>, code: Option<u16> },
    /// The homing of an axis is attained.
    Homed(u8),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Content {
    format: i64,
    #[serde(default)]
    fail_on: Vec<String>,
    at_least: Option<String>,
    at_most: Option<String>,
    #[serde(default)]
    axes: BTreeMap<String, BTreeMap<String, LimitField>>,
    #[serde(default)]
    events: Vec<EventFields>,
    #[serde(default)]
    never: Vec<EventFields>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a number, or a text with a unit such as \"0.5mm\"")]
enum LimitField {
    Whole(u64),
    Number(f64),
    Text(String),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EventFields {
    state: Option<String>,
    alarm: Option<AxisField>,
    code: Option<u16>,
    homed: Option<AxisField>,
    within: Option<String>,
    by: Option<String>,
    not_before: Option<String>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "the number of a slave, or the name of an axis")]
enum AxisField {
    Number(u8),
    Name(String),
}

impl Rules {
    /// Reads a file of rules. `machine` is needed for axes that are given by name.
    ///
    /// # Errors
    /// [`RulesError`] if the file cannot be read or a rule is invalid; only the first invalid rule is reported.
    pub fn load(file: &Path, machine: Option<&MachineFile>) -> Result<Self, RulesError> {
        let unreadable = |message: String| RulesError::Unreadable { file: file.to_owned(), message };
        let mut text = String::new();
        let read = File::open(file).and_then(|open| open.take(FILE_BYTES_MAX + 1).read_to_string(&mut text));
        read.map_err(|error| unreadable(error.to_string()))?;
        if text.len() as u64 > FILE_BYTES_MAX {
            return Err(unreadable(format!("it has more than {FILE_BYTES_MAX} bytes")));
        }
        Self::parse(&text, machine).map_err(|what| RulesError::Wrong { file: file.to_owned(), what })
    }

    fn parse(text: &str, machine: Option<&MachineFile>) -> Result<Self, String> {
        let content: Content = toml::from_str(text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start.min(text.len()));
            let line = 1 + text.as_bytes()[..at].iter().filter(|byte| **byte == b'\n').count();
            format!("line {line}: {}; see docs/CI.md", error.message().trim_end().replace('\n', ", "))
        })?;
        if content.format != FORMAT {
            return Err(format!("format = {}; this tool reads format = {FORMAT}", content.format));
        }
        let fail_on = content.fail_on.into_iter().map(|reason| {
            let parsed = Reason::parse(&reason).map_err(|why| format!("fail_on: `{reason}`: {why}"))?;
            Ok((reason, parsed))
        });
        let rules = Self {
            fail_on: fail_on.collect::<Result<_, String>>()?,
            at_least: time("at_least", content.at_least)?,
            at_most: time("at_most", content.at_most)?,
            limits: limits(content.axes, machine)?,
            events: numbered("events", content.events, |place, fields| event(place, fields, machine))?,
            never: numbered("never", content.never, |place, fields| never(place, &fields, machine))?,
        };
        let Self { fail_on, at_least, at_most, limits, events, never } = &rules;
        let is_empty = fail_on.is_empty() && limits.is_empty() && events.is_empty() && never.is_empty();
        if is_empty && at_least.is_none() && at_most.is_none() {
            return Err("there is no rule; write some, see docs/CI.md".to_owned());
        }
        Ok(rules)
    }
}

fn numbered<T>(
    name: &str,
    fields: Vec<EventFields>,
    checked: impl Fn(&str, EventFields) -> Result<T, String>,
) -> Result<Vec<T>, String> {
    let one = |(number, fields)| checked(&format!("{name}, number {number}"), fields);
    (1..).zip(fields).map(one).collect()
}

fn time(place: &str, text: Option<String>) -> Result<Option<Duration>, String> {
    text.map(|text| duration(&text).map_err(|why| format!("{place} = \"{text}\": {why}"))).transpose()
}

/// The slave number of an axis.
fn axis(place: &str, word: &str, machine: Option<&MachineFile>) -> Result<u8, String> {
    let axis =
        AxisWord::parse(word).ok_or_else(|| format!("{place}: `{word}` is no axis; allowed: 1 to 40, or a name"))?;
    axis.slave(place, machine).map_err(|error| error.to_string())
}

fn limits(
    axes: BTreeMap<String, BTreeMap<String, LimitField>>,
    machine: Option<&MachineFile>,
) -> Result<Vec<Limit>, String> {
    let mut limits = Vec::new();
    for (word, fields) in axes {
        let place = format!("axes.{word}");
        let slave = if word == ALL { None } else { Some(axis(&place, &word, machine)?) };
        for (name, value) in fields {
            let quantity = Quantity::ALL.into_iter().find(|quantity| quantity.word().replace('-', "_") == name);
            let quantity = quantity.ok_or_else(|| {
                let known = Quantity::ALL.map(|quantity| quantity.word().replace('-', "_")).join(", ");
                format!("{place}: `{name}` is no limit; allowed: {known}")
            })?;
            let text = match value {
                LimitField::Whole(number) => number.to_string(),
                LimitField::Number(number) => number.to_string(),
                LimitField::Text(text) => text,
            };
            let above = Reason::parse(&format!("{}>{text}", quantity.word()));
            let above = above.map_err(|_| {
                format!("{place}.{name}: `{text}` is no limit; allowed: a number of 0 and more, or e.g. \"0.5mm\" by the machine file")
            })?;
            if let Reason::AboveUnits(_, _, unit) = above {
                has_unit(&place, unit, slave, machine)?;
            }
            limits.push(Limit { slave, quantity, text: with_unit(quantity, above, &text), above });
        }
    }
    Ok(limits)
}

/// Checks that an axis with this unit exists: otherwise the limit would apply to no axis, and every run would pass.
fn has_unit(place: &str, unit: Unit, slave: Option<u8>, machine: Option<&MachineFile>) -> Result<(), String> {
    let axes = machine.map_or(&[][..], |machine| &machine.axes);
    let mut meant = axes.iter().filter(|axis| slave.is_none_or(|slave| axis.slave == slave));
    if meant.any(|axis| axis.unit == unit) {
        return Ok(());
    }
    Err(format!("{place}: no such axis of a machine file is in {unit}; write the limit in its unit, see --machine"))
}

/// The text of a limit for messages. A number without a unit has the unit of recordings (counts, counts/s or %).
fn with_unit(quantity: Quantity, above: Reason, text: &str) -> String {
    match (above, quantity) {
        (Reason::AboveUnits(..), _) => text.to_owned(),
        (_, Quantity::FollowingError | Quantity::TargetStep) => format!("{text} counts"),
        (_, Quantity::Velocity) => format!("{text} counts/s"),
        (_, Quantity::Torque) => format!("{} %", text.trim().trim_end_matches('%').trim_end()),
    }
}

fn event(place: &str, fields: EventFields, machine: Option<&MachineFile>) -> Result<Event, String> {
    Ok(Event {
        what: what(place, &fields, machine)?,
        within: time(&format!("{place}: within"), fields.within)?,
        by: time(&format!("{place}: by"), fields.by)?,
        not_before: time(&format!("{place}: not_before"), fields.not_before)?,
    })
}

fn never(place: &str, fields: &EventFields, machine: Option<&MachineFile>) -> Result<What, String> {
    if fields.within.is_some() || fields.by.is_some() || fields.not_before.is_some() {
        return Err(format!("{place}: an event that never comes has no time; take the time out"));
    }
    what(place, fields, machine)
}

fn what(place: &str, fields: &EventFields, machine: Option<&MachineFile>) -> Result<What, String> {
    let slave = |field: &AxisField| match field {
        AxisField::Number(slave) => axis(place, &slave.to_string(), machine),
        AxisField::Name(name) => axis(place, name, machine),
    };
    match (&fields.state, &fields.alarm, &fields.homed) {
        (Some(state), None, None) if fields.code.is_none() => match crate::step::parse_state(state) {
            Ok(state) => Ok(What::State(state)),
            Err(why) => Err(format!("{place}: state = \"{state}\": {why}")),
        },
        (None, Some(alarm), None) => {
            let is_any = matches!(alarm, AxisField::Name(name) if name == ANY);
            let slave = if is_any { None } else { Some(slave(alarm)?) };
            Ok(What::Alarm { slave, code: fields.code })
        }
        (None, None, Some(homed)) if fields.code.is_none() => Ok(What::Homed(slave(homed)?)),
        _ => Err(format!("{place}: allowed: one of state, alarm (also with code) and homed")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wrong(text: &str) -> String {
        Rules::parse(&format!("format = 1\n{text}"), None).expect_err(text)
    }

    /// The error for a wrong rule says where it is, what is wrong, and what is allowed.
    #[test]
    fn wrong_rules_are_named() {
        for (text, says) in [
            ("", "there is no rule"),
            ("fail_on = [\"jerk\"]", "fail_on: `jerk`: allowed: any, alarm"),
            ("most = 3", "line 2: unknown field `most`"),
            ("at_most = \"soon\"", "at_most = \"soon\": allowed: a time up to a day"),
            ("[axes.41]\ntorque = 1", "axes.41: `41` is no axis"),
            ("[axes.X]\ntorque = 1", "axes.X: axis `X` is no number from 1 to 40"),
            ("[axes.1]\njerk = 1", "axes.1: `jerk` is no limit; allowed: following_error, target_step"),
            ("[axes.1]\nvelocity = \"-1\"", "axes.1.velocity: `-1` is no limit"),
            ("[axes.1]\nvelocity = \"1mm/s\"", "axes.1: no such axis of a machine file is in mm"),
            ("[[events]]\nstate = \"up\"", "events, number 1: state = \"up\": "),
            ("[[events]]\nby = \"1s\"", "events, number 1: allowed: one of state, alarm"),
            ("[[events]]\nstate = \"op\"\ncode = 1", "events, number 1: allowed: one of state, alarm"),
            ("[[never]]\nalarm = 1\nby = \"1s\"", "never, number 1: an event that never comes has no time"),
        ] {
            assert!(wrong(text).contains(says), "{text}: {}", wrong(text));
        }
        assert_eq!(Rules::parse("format = 2", None).unwrap_err(), "format = 2; this tool reads format = 1");
    }

    #[test]
    fn rules_are_read() {
        let text = "format = 1\n[axes.all]\ntorque = 80.5\n[axes.2]\nvelocity = 100\n[[events]]\nalarm = \"any\"\ncode = 0x7500";
        let rules = Rules::parse(text, None).expect("rules");
        let limits: Vec<_> = rules.limits.iter().map(|limit| (limit.slave, &*limit.text, limit.above)).collect();
        assert_eq!(
            limits,
            [
                (Some(2), "100 counts/s", Reason::Above(Quantity::Velocity, 100)),
                (None, "80.5 %", Reason::Above(Quantity::Torque, 805)),
            ]
        );
        assert_eq!(rules.events[0].what, What::Alarm { slave: None, code: Some(0x7500) });
    }
}
