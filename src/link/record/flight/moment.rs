//! A moment that a flight recorder keeps: its beginning, its end and its reasons. A text file beside the recording of
//! the moment lists them.

use std::fmt;

/// The most reasons of a moment that its text lists; further ones are only counted. \[OURS]
pub(super) const REASONS_MAX: usize = 50;
/// The most bytes of the text of a moment. \[OURS]
pub(super) const TEXT_MAX: u64 = 64 * 1024;
/// The most bytes of a mark's text; the rest is cut off. \[OURS]
pub const MARK_MAX: usize = 500;

/// The first line of the text of a moment.
const HEAD: &str = "ecmsk flight moment";

/// Why a moment is kept. If the bound for kept moments is reached, moments of the kinds that are listed first here are
/// deleted first. \[OURS]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// No report came for a long time.
    Gap,
    /// A change of the AL state has failed.
    State,
    /// An axis was further from its executed target than the limit.
    FollowingError,
    /// A drive has held its axis back (internal limit active).
    HeldBack,
    /// A slave was lost.
    LostSlave,
    /// A drive has an alarm.
    Alarm,
    /// A person has marked the moment.
    Mark,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 7] =
        [Self::Gap, Self::State, Self::FollowingError, Self::HeldBack, Self::LostSlave, Self::Alarm, Self::Mark];

    /// The word for the kind, in texts and in JSON.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Gap => "gap",
            Self::State => "state",
            Self::FollowingError => "following-error",
            Self::HeldBack => "held-back",
            Self::LostSlave => "lost-slave",
            Self::Alarm => "alarm",
            Self::Mark => "mark",
        }
    }
}

/// One reason for which a moment is kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reason {
    /// The time of the frame that shows the event, on the clock of the recording, ns.
    pub at_ns: u64,
    /// What kind of reason it is.
    pub kind: Kind,
    /// What has happened, in one line.
    pub text: String,
}

/// A moment that is kept.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Moment {
    /// The number of the moment in its folder: moments are ordered by it, whatever the clock of the machine was set to.
    pub number: u64,
    /// The first segment of the ring that has frames of the moment.
    pub(super) segment: u64,
    /// The time from which on frames are kept, on the clock of the recording, ns.
    pub from_ns: u64,
    /// The time until which frames are kept, on the clock of the recording, ns.
    pub to_ns: u64,
    /// Whether `from_ns` and `to_ns` are times of a virtual clock. If not, they count from 1970-01-01, UTC.
    pub is_virtual: bool,
    /// The reasons for which the moment is kept, in the order of their events.
    pub reasons: Vec<Reason>,
    /// The number of further reasons that `reasons` does not list.
    pub more: u64,
}

impl Moment {
    /// The highest kind of the moment's reasons, which decides how long the moment is kept.
    pub(super) fn rank(&self) -> Option<Kind> {
        self.reasons.iter().map(|reason| reason.kind).max()
    }

    /// Adds a reason and lets the moment last until `to_ns`. Returns whether the text now lists the reason; if not, the
    /// reason was only counted.
    pub(super) fn add(&mut self, reason: Reason, to_ns: u64) -> bool {
        self.to_ns = self.to_ns.max(to_ns);
        let has_room = self.reasons.len() < REASONS_MAX;
        if has_room {
            self.reasons.push(reason);
        } else {
            self.more += 1;
        }
        has_room
    }

    /// Reads what [`Display`](fmt::Display) has written; `None` if it is something else. Unknown lines are skipped.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let mut lines = text.lines();
        lines.next().filter(|line| *line == HEAD)?;
        let mut moment = Self::default();
        for line in lines {
            let Some((word, value)) = line.split_once(' ') else { continue };
            let number = || value.parse().ok();
            match word {
                "number" => moment.number = number()?,
                "segment" => moment.segment = number()?,
                "from_ns" => moment.from_ns = number()?,
                "to_ns" => moment.to_ns = number()?,
                "more" => moment.more = number()?,
                "clock" => moment.is_virtual = value == "virtual",
                "reason" => moment.reasons.extend(reason(value)),
                _ => {}
            }
        }
        (!moment.reasons.is_empty()).then_some(moment)
    }
}

fn reason(line: &str) -> Option<Reason> {
    let mut parts = line.splitn(3, ' ');
    let (at_ns, word, text) = (parts.next()?, parts.next()?, parts.next()?);
    let kind = Kind::ALL.into_iter().find(|kind| kind.word() == word)?;
    Some(Reason { at_ns: at_ns.parse().ok()?, kind, text: text.to_owned() })
}

impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { number, segment, from_ns, to_ns, more, .. } = self;
        let clock = if self.is_virtual { "virtual" } else { "real" };
        writeln!(f, "{HEAD}\nnumber {number}\nsegment {segment}\nfrom_ns {from_ns}\nto_ns {to_ns}\nclock {clock}")?;
        for Reason { at_ns, kind, text } in &self.reasons {
            writeln!(f, "reason {at_ns} {} {}", kind.word(), one_line(text))?;
        }
        writeln!(f, "more {more}")
    }
}

/// A text as one line of printable characters.
pub(super) fn one_line(text: &str) -> String {
    text.trim().chars().map(|char| if char.is_control() { ' ' } else { char }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_read_as_it_was_written() {
        let reasons = Kind::ALL.map(|kind| Reason { at_ns: 7, kind, text: format!("of {} it is", kind.word()) });
        let moment = Moment {
            number: 3,
            segment: 41,
            from_ns: 1_700_000_000_000_000_000,
            to_ns: 1_700_000_000_000_000_001,
            is_virtual: true,
            reasons: reasons.to_vec(),
            more: 9,
        };
        assert_eq!(Moment::parse(&moment.to_string()), Some(moment.clone()));
        assert_eq!(moment.rank(), Some(Kind::Mark));
        for text in ["", "any", "ecmsk flight moment\nnumber x", "ecmsk flight moment\nnumber 1"] {
            assert_eq!(Moment::parse(text), None, "{text}");
        }
    }
}
