//! Filters of the verbs that show a recording: by slot, by slave, by command, by time.

use ecmsk::sk::dump::{MAX_SLAVES, SlotLine, SlotRole};
use ecmsk::sk::{CommandId, MASTER_CYCLIC, SlotSize};

/// The word for 0xBF, the id of slot 0 in OP. It does not show which command the response answers.
pub const CYCLIC: &str = "CYCLIC";
/// The highest slot number in frames of either size.
const LAST_SLOT: u8 = SlotSize::Bytes12.sdo_slot() as u8;

/// A range of slots that the user has selected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slots {
    /// From the first to the last, both included.
    Range(u8, u8),
    /// The SDO slot, which is the last one in either slot size.
    Sdo,
}

impl Slots {
    /// Reads `3`, `3-5`, `ecm` or `sdo`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        match text.trim() {
            word if word.eq_ignore_ascii_case("ecm") => Ok(Self::Range(0, 0)),
            word if word.eq_ignore_ascii_case("sdo") => Ok(Self::Sdo),
            range => parse_range(range, u8::MIN..=u8::MAX)
                .map(|(first, last)| Self::Range(first, last))
                .ok_or_else(|| format!("allowed: slots 0 to {LAST_SLOT}, ranges as 3-5, `ecm` and `sdo`")),
        }
    }

    /// Whether slot `i` is in the range.
    pub fn contains(self, i: usize, size: SlotSize) -> bool {
        match self {
            Self::Range(first, last) => (usize::from(first)..=usize::from(last)).contains(&i),
            Self::Sdo => i == size.sdo_slot(),
        }
    }

    /// The first slot of the range that frames of that size do not have; `None` if they have all.
    pub fn missing(self, size: SlotSize) -> Option<usize> {
        match self {
            Self::Range(first, last) => {
                (usize::from(last) >= size.slots()).then_some(usize::from(first).max(size.slots()))
            }
            Self::Sdo => None,
        }
    }
}

/// A range of slave numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slaves {
    first: u8,
    last: u8,
}

impl Slaves {
    /// Reads `3` or `3-5`.
    ///
    /// # Errors
    /// The text is invalid; the error says what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        parse_range(text.trim(), 1..=MAX_SLAVES as u8)
            .map(|(first, last)| Self { first, last })
            .ok_or_else(|| format!("allowed: slaves 1 to {MAX_SLAVES}, and ranges as 3-5"))
    }

    /// The numbers of the slaves.
    pub fn numbers(self) -> impl Iterator<Item = u8> {
        self.first..=self.last
    }
}

/// Reads `3` or `3-5`, of numbers in a range; `None`: it is something else.
pub fn parse_range(text: &str, allowed: std::ops::RangeInclusive<u8>) -> Option<(u8, u8)> {
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let (first, last): (u8, u8) = (first.trim().parse().ok()?, last.trim().parse().ok()?);
    (first <= last && allowed.contains(&first) && allowed.contains(&last)).then_some((first, last))
}

/// A command id by which slots are filtered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Command(u8);

impl Command {
    /// Reads a name of UG17 1.8 in any case, or an id as `0x15`.
    ///
    /// # Errors
    /// The text is no command; the error lists them.
    pub fn parse(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let name = text.to_ascii_uppercase().replace('-', "_");
        let known = CommandId::ALL.into_iter().find(|id| id.name() == name).map(CommandId::code);
        let id = || u8::from_str_radix(name.strip_prefix("0X")?, 16).ok();
        let cyclic = (name == CYCLIC).then_some(MASTER_CYCLIC);
        known.or(cyclic).or_else(id).map(Self).ok_or_else(|| {
            let names = CommandId::ALL.map(CommandId::name).join(", ");
            format!("allowed: {names}, {CYCLIC}, and any id as 0x15")
        })
    }

    /// The command id, which is in byte 0 of a slot.
    pub const fn code(self) -> u8 {
        self.0
    }

    /// Whether the slot contains this command, or in a response answers it.
    pub fn is_in(self, line: &SlotLine) -> bool {
        // 0xBF means CYCLIC in slot 0 only.
        line.raw.id == self.0 && (self.0 != MASTER_CYCLIC || line.role == SlotRole::Master)
    }
}

/// The options of a verb that shows a part of a recording, by the times of its frames.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct TimeOptions {
    /// Leave out what is before this time, e.g. 1.5, 1.5s or 1500ms, counted from the opening of the board, in a capture from
    /// its first frame
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, value_parser = parse_seconds)]
    from: Option<f64>,

    /// Leave out what is after this time
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, value_parser = parse_seconds)]
    to: Option<f64>,

    /// Leave out what is more than 0.1 s before or after this time, such as one that `ecmsk find` prints
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, value_parser = parse_seconds, conflicts_with_all = ["from", "to"])]
    around: Option<f64>,
}

/// How much time `--around` selects before and after its moment, in seconds. \[OURS] Some hundred cycles show how a
/// moment came about, and in a plot single cycles can still be distinguished.
pub const AROUND_SECONDS: f64 = 0.1;

impl TimeOptions {
    /// The range of times that the options select.
    pub fn times(self) -> Times {
        match self.around {
            Some(at) => Times { from: Some(at - AROUND_SECONDS), to: Some(at + AROUND_SECONDS) },
            None => Times { from: self.from, to: self.to },
        }
    }
}

/// A range of times of frames in seconds, both ends included.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Times {
    /// The earliest time; `None`: no limit.
    pub from: Option<f64>,
    /// The latest time; `None`: no limit.
    pub to: Option<f64>,
}

impl Times {
    /// Whether the time is in the range.
    pub fn contains(self, at_ns: i64) -> bool {
        !self.begin_after(at_ns) && self.to.is_none_or(|to| at_ns <= nanoseconds(to))
    }

    /// Whether the range begins after the time.
    pub fn begin_after(self, at_ns: i64) -> bool {
        self.from.is_some_and(|from| at_ns < nanoseconds(from))
    }
}

impl std::fmt::Display for Times {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.from, self.to) {
            (Some(from), Some(to)) => write!(f, "asked for {from} s to {to} s"),
            (Some(from), None) => write!(f, "asked for {from} s and later"),
            (None, Some(to)) => write!(f, "asked for all until {to} s"),
            (None, None) => f.write_str("asked for all"),
        }
    }
}

/// Converts seconds to nanoseconds, rounded to the nearest one.
pub fn nanoseconds(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

/// Parses a time of the command line to seconds: `3.5`, `3.5s`, `500ms` or `250us`. NaN and the infinities are
/// refused.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn parse_seconds(text: &str) -> Result<f64, String> {
    const UNITS: [(&str, f64); 4] = [("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("s", 1.0)];
    let text = text.trim();
    let unit = UNITS.into_iter().find_map(|(unit, factor)| Some((text.strip_suffix(unit)?, factor)));
    let (number, factor) = unit.unwrap_or((text, 1.0));
    let number: f64 = number.trim().parse().map_err(|_| "not a time; write it as in 3.5, 3.5s or 500ms".to_owned())?;
    if number.is_finite() {
        // Multiples of 1e-3 are not exact in binary; rounding to whole nanoseconds gives the time that was written.
        Ok((number * factor * 1e9).round() / 1e9)
    } else {
        Err("not a time; leave the option out for no limit".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slots are given as a number, a range, `ecm` or `sdo`. The slot number of `sdo` depends on the slot size.
    #[test]
    fn slots_are_numbers_ranges_and_two_words() {
        assert_eq!(Slots::parse("3-5"), Ok(Slots::Range(3, 5)));
        assert_eq!(Slots::parse(" ECM "), Ok(Slots::Range(0, 0)));
        let [narrow, wide] = [SlotSize::Bytes12, SlotSize::Bytes16];
        let sdo = Slots::parse("sdo").expect("a word");
        assert!(sdo.contains(41, narrow) && sdo.contains(31, wide) && !sdo.contains(41, wide));
        assert_eq!((Slots::Range(30, 41).missing(narrow), Slots::Range(30, 41).missing(wide)), (None, Some(32)));
        for wrong in ["", "x", "5-3", "3-", "-3", "1-2-3", "300"] {
            assert!(Slots::parse(wrong).is_err(), "{wrong}");
        }
        for wrong in ["0", "41", "0-3", "3-41", "sdo"] {
            assert!(Slaves::parse(wrong).is_err(), "{wrong}");
        }
        assert!(Slaves::parse("3-5").expect("a range").numbers().eq([3, 4, 5]));
    }

    /// Every command can be given by its name, in any case, or by its id.
    #[test]
    fn a_command_is_named_by_its_name_in_any_case_or_its_id() {
        for id in CommandId::ALL {
            for text in [id.name().to_owned(), id.name().to_lowercase(), format!("0x{:02x}", id.code())] {
                assert_eq!(Command::parse(&text), Ok(Command(id.code())), "{text}");
            }
        }
        assert_eq!(Command::parse("sdo-rd"), Ok(Command(7)));
        assert_eq!(Command::parse("cyclic"), Ok(Command(0xBF)));
        assert!(Command::parse("SDO_READ").expect_err("no name").contains("SDO_RD"));
    }

    /// A decimal time such as 3.3 matches the frame with exactly this nanosecond, although floating-point numbers are inexact.
    #[test]
    fn a_time_that_is_written_down_matches_that_nanosecond_exactly() {
        for (text, ns) in [("1.204", 1_204_000_000), ("1.204s", 1_204_000_000), ("500ms", 500_000_000), ("-3us", -3000)]
        {
            let seconds = parse_seconds(text).expect("a time");
            assert_eq!(nanoseconds(seconds), ns, "{text}");
            let only = Times { from: Some(seconds), to: Some(seconds) };
            assert!(only.contains(ns) && !only.contains(ns + 1) && !only.contains(ns - 1), "{text}");
        }
        for wrong in ["", "s", "1h", "inf", "NaN s", "1,5"] {
            assert!(parse_seconds(wrong).is_err(), "{wrong}");
        }
    }
}
