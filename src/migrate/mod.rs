//! What a recorded program needs of an ECM-XF: whether it runs there as it is, in what it would differ, and how the chip
//! has to be set up. For the owner of a machine, before anybody buys a chip; `ecmsk migrate` shows it, and
//! `docs/MIGRATION.md` has what the differences mean.
//!
//! How to read it:
//!
//! | file | what it holds |
//! | --- | --- |
//! | `mod.rs` | [`Migration`]: all that is said about a run, and [`Migration::of`], which makes it |
//! | `survey.rs` | [`Survey`]: follows a run frame by frame |
//! | `usage.rs` | [`Subject`], [`Count`]: what the program uses, how often, where first |
//! | `timing.rs`, `spread.rs` | [`HostTiming`]: when the host was late, and how full the board's FIFO was |
//! | `network.rs` | [`Network`]: the slaves and their process data |
//! | `chip.rs` | [`Needs`]: packets, clock and entries that these need |
//! | `row.rs`, `judge.rs` | [`Row`], [`Verdict`]: in what a chip differs, and what that means for each thing used |
//! | `start.rs` | [`Start`]: how long the way to OP was, and how long it is behind a chip |
//! | `plan.rs` | [`Plan`]: `ahead=`, and the links that result |
//!
//! ```
//! use ecmsk::compare::TimedFrame;
//! use ecmsk::link::Dir;
//! use ecmsk::migrate::{Migration, Row, Setting, Survey};
//! use ecmsk::sk::{Frame, MasterCommand, SlotSize};
//!
//! let mut frame = Frame::new();
//! frame.put_master(SlotSize::Bytes12, &MasterCommand::LocalWrite(1));
//! let mut survey = Survey::new(SlotSize::Bytes12);
//! survey.frame(&TimedFrame { number: 1, at_ns: 0, dir: Dir::Write, frame });
//! let found = Migration::of(&survey, &Setting::default());
//! assert_eq!(found.items[0].verdict.row(), Some(Row::Lio));
//! assert_eq!(found.items[0].verdict.word(), "differs");
//! ```

mod chip;
mod judge;
mod network;
mod plan;
mod row;
mod spread;
mod start;
mod survey;
#[cfg(test)]
mod tests;
mod timing;
mod usage;

pub use chip::{IDLE_NS, INT0_IDLE_NS, Needs, Packets, Refused};
pub use network::Network;
pub use plan::{Ahead, Links, Plan};
pub use row::{Row, Verdict};
pub use spread::Spread;
pub use start::{Start, time_to_op_ns};
pub use survey::{Seen, Survey};
pub use timing::{HostTiming, Levels, SeenBy, Stall};
pub use usage::{Count, Subject};

use crate::recording::Clock;
use crate::sk::{CycleTime, SlotSize};

/// A frame of a run, as a place where something is found again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// The number of the frame in the recording, from 1.
    pub frame: u64,
    /// When it passed, in nanoseconds since the first frame.
    pub at_ns: i64,
}

/// A stretch of time, in nanoseconds since the first frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// Its beginning.
    pub from_ns: i64,
    /// Its end.
    pub to_ns: i64,
}

/// What is known beside the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    /// The clock of SPI that the machine is to have, in Hz; 24 MHz by default, as in `xf-spi:`.
    pub clock_hz: u32,
    /// Whose times the frames have; on a virtual clock they tell nothing of a host.
    pub clock: Clock,
    /// The slot size of the program, for the links.
    pub slot: SlotSize,
    /// Whether the program was recorded with its slaves behind a chip: it has waited for the way to OP there.
    pub is_behind_chip: bool,
}

impl Default for Setting {
    fn default() -> Self {
        Self { clock_hz: 24_000_000, clock: Clock::Real, slot: SlotSize::default(), is_behind_chip: false }
    }
}

/// One thing that the program uses, and whether it runs on an ECM-XF.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Item {
    /// What, how often, where first.
    pub count: Count,
    /// Whether it runs.
    pub verdict: Verdict,
}

/// What is said about a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Migration {
    /// Command frames of the run that ask for something.
    pub commands: u64,
    /// Command frames of nothing but GET_STATUS.
    pub polls: u64,
    /// Reports of the run.
    pub reports: u64,
    /// When the last frame passed, in nanoseconds since the first one.
    pub last_ns: i64,
    /// From the first to the last frame of OP; `None` if the program was never there. Then nothing is known of its host, and
    /// of its motion neither.
    pub op: Option<Stretch>,
    /// All that the program uses.
    pub items: Vec<Item>,
    /// The cycle of the network.
    pub cycle: CycleTime,
    /// How the host kept its time.
    pub timing: HostTiming,
    /// What the network needs of a chip; `None`: no slave was declared, or none came to SafeOP.
    pub plan: Option<Plan>,
}

impl Migration {
    /// What the frames of a run that was followed to its end say.
    pub fn of(survey: &Survey, setting: &Setting) -> Self {
        let network = survey.largest.as_ref();
        let items = survey
            .usage
            .counts()
            .map(|count| Item { count: *count, verdict: judge::verdict(count, network, survey.op.is_some(), setting) });
        let timing = survey.timing().clone();
        Self {
            commands: survey.commands,
            polls: survey.polls,
            reports: survey.reports,
            last_ns: survey.last_ns,
            op: survey.op,
            items: items.collect(),
            cycle: survey.cycle(),
            plan: network.map(|network| Plan::of(network, survey, setting)),
            timing,
        }
    }

    /// All verdicts: those of the items, and that of the host's stalls.
    pub fn verdicts(&self) -> impl Iterator<Item = &Verdict> {
        self.items.iter().map(|item| &item.verdict).chain(self.plan.iter().map(|plan| &plan.ahead.verdict))
    }

    /// Whether the program runs as it is, and was seen to do what it is for.
    pub fn runs_as_it_is(&self) -> bool {
        self.op.is_some() && self.verdicts().all(|verdict| *verdict == Verdict::Yes)
    }

    /// The rows that the verdicts refer to, each once, in the order of the table.
    pub fn rows(&self) -> Vec<Row> {
        Row::ALL.into_iter().filter(|row| self.verdicts().any(|verdict| verdict.row() == Some(*row))).collect()
    }
}
