//! Finds out from a recording what a program needs to run with an ECM-XF: whether it runs unchanged, what would differ,
//! and how the chip has to be set up. It is meant for the owner of a machine who thinks of buying a chip. `ecmsk
//! migrate` shows the result, and `docs/MIGRATION.md` explains the differences.
//!
//! Files:
//!
//! | file | what it holds |
//! | --- | --- |
//! | `mod.rs` | [`Migration`]: the result for a run, and [`Migration::of`], which makes it |
//! | `survey.rs` | [`Survey`]: reads a run frame by frame |
//! | `usage.rs` | [`Subject`], [`Count`]: the features that the program uses, how often, where first |
//! | `timing.rs`, `spread.rs` | [`HostTiming`]: when the host was late, and how full the board's FIFO was |
//! | `network.rs` | [`Network`]: the slaves and their process data |
//! | `chip.rs` | [`Needs`]: the packets, the clock and the FIFO entries for these process data |
//! | `row.rs`, `judge.rs` | [`Row`], [`Verdict`]: how a chip differs, and what that means for each feature used |
//! | `start.rs` | [`Start`]: how long the start to OP took, and how long it takes over a chip |
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

/// A frame of a run, at which the survey has found something.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// The number of the frame in the recording, from 1.
    pub frame: u64,
    /// The time of the frame, in nanoseconds since the first frame.
    pub at_ns: i64,
}

/// An interval of time between two frames, in nanoseconds since the first frame of the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// The time of the first frame in the interval, in nanoseconds since the first frame of the run.
    pub from_ns: i64,
    /// The time of the last frame in the interval, in nanoseconds since the first frame of the run.
    pub to_ns: i64,
}

/// Facts about a run that its frames do not show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    /// The SPI clock that the machine is going to have, in Hz. Default: 24 MHz, as in `xf-spi:`.
    pub clock_hz: u32,
    /// The clock of the frames' times. Times of a virtual clock say nothing about the host's timing.
    pub clock: Clock,
    /// The slot size of the program. The suggested links repeat it as the key `slot=`.
    pub slot: SlotSize,
    /// Whether the program was recorded with its slaves behind a chip, so that it has waited for the longer start.
    pub is_behind_chip: bool,
}

impl Default for Setting {
    fn default() -> Self {
        Self { clock_hz: 24_000_000, clock: Clock::Real, slot: SlotSize::default(), is_behind_chip: false }
    }
}

/// One feature that the program uses, and whether it works with an ECM-XF.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Item {
    /// The feature, how often it is used, and where first.
    pub count: Count,
    /// Whether the feature works with an ECM-XF.
    pub verdict: Verdict,
}

/// What a program needs to run with an ECM-XF, found from one recorded run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Migration {
    /// The number of command frames of the run in which some slot requests something.
    pub commands: u64,
    /// The number of command frames in which all slots are GET_STATUS.
    pub polls: u64,
    /// The number of reports in the run.
    pub reports: u64,
    /// The time of the last frame, in nanoseconds since the first one.
    pub last_ns: i64,
    /// The interval from the first to the last frame of OP; `None` if the program was never in OP. Then the recording
    /// shows neither the timing of the host nor motions.
    pub op: Option<Stretch>,
    /// All features that the program uses.
    pub items: Vec<Item>,
    /// The EtherCAT cycle time of the network.
    pub cycle: CycleTime,
    /// The timing of the host in OP.
    pub timing: HostTiming,
    /// How a chip has to be set up for the network; `None` if no slave was declared, or if none came to SafeOP.
    pub plan: Option<Plan>,
}

impl Migration {
    /// The result for a run whose frames `survey` has read to the end.
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

    /// All verdicts: those on the features, and that on the host's stalls.
    pub fn verdicts(&self) -> impl Iterator<Item = &Verdict> {
        self.items.iter().map(|item| &item.verdict).chain(self.plan.iter().map(|plan| &plan.ahead.verdict))
    }

    /// Whether the program runs unchanged: all verdicts are "yes", and the recording includes OP.
    pub fn runs_as_it_is(&self) -> bool {
        self.op.is_some() && self.verdicts().all(|verdict| *verdict == Verdict::Yes)
    }

    /// The rows that the verdicts refer to, each once, in the order of the table in `docs/MIGRATION.md`.
    pub fn rows(&self) -> Vec<Row> {
        Row::ALL.into_iter().filter(|row| self.verdicts().any(|verdict| verdict.row() == Some(*row))).collect()
    }
}
