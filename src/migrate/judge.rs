//! Decides whether a feature that a program uses works with an ECM-XF.

use super::chip::Refused;
use super::row::{Row, Verdict};
use super::usage::{Count, Subject};
use super::{Needs, Network, Setting};
use crate::ethercat::Ns;
use crate::sk::{CommandId, CycleTime, MasterState};

/// A command with targets or IO gets the verdict "differs" if more than this fraction (1/2) of its uses was in a closed
/// loop. A smaller part may come from a program that writes ahead: its first commands find an empty FIFO, which looks
/// like a closed loop. \[OURS]
const EXPOSED_FRACTION: u64 = 2;

/// The verdict on one feature that a program uses. `network` is the network with the most process data per time;
/// `reaches_op` says whether the program was in OP.
pub(super) fn verdict(count: &Count, network: Option<&Network>, reaches_op: bool, setting: &Setting) -> Verdict {
    let often = count.exposed.saturating_mul(EXPOSED_FRACTION) > count.times;
    let ever = count.exposed > 0;
    let differs = |row: Row, so: bool| if so { Verdict::Differs(row) } else { Verdict::Yes };
    match count.subject {
        Subject::Command(CommandId::LocalRead | CommandId::LocalWrite) => Verdict::Differs(Row::Lio),
        Subject::Command(CommandId::Csp | CommandId::Csv | CommandId::Cst | CommandId::IoRead | CommandId::IoWrite) => {
            differs(Row::Latency, often)
        }
        Subject::Command(CommandId::ServoOn) => differs(Row::Hold, ever),
        Subject::Command(CommandId::SetFifo) => differs(Row::Clear, ever),
        Subject::Command(CommandId::SdoRead | CommandId::SdoWrite) | Subject::Read(_) | Subject::Write(_) => {
            differs(Row::Sdo, ever)
        }
        Subject::Cycle(cycle) if cycle.ns() > WATCHDOG_NS => outlasts_watchdog(cycle),
        Subject::Cycle(cycle) => {
            match network.map(|network| Needs::of(&Network { cycle, ..*network }, setting.clock_hz)) {
                Some(Needs { with_int0: Err(refused), .. }) => no_cycle(&refused),
                Some(Needs { with_int0: Ok(packets), without_int0, .. }) => {
                    differs(Row::Cycle, packets.in_flight > 1 || without_int0.is_err())
                }
                None => Verdict::Yes,
            }
        }
        // A recording does not show how long the program would have waited for OP. If it was recorded over a chip, the
        // program has waited long enough.
        Subject::State(MasterState::Op) => differs(Row::Start, ever || reaches_op && !setting.is_behind_chip),
        Subject::State(_) => differs(Row::Start, ever),
        Subject::Lost => Verdict::Differs(Row::Loss),
        Subject::Return => Verdict::Differs(Row::Remap),
        Subject::Command(
            CommandId::GetStatus
            | CommandId::SetState
            | CommandId::SetAxis
            | CommandId::SetDc
            | CommandId::SetEx
            | CommandId::DriveMode
            | CommandId::AlarmClear
            | CommandId::ServoOff
            | CommandId::GoHome
            | CommandId::AbortHome
            | CommandId::SoftReset
            | CommandId::Unknown(_),
        ) => Verdict::Yes,
        Subject::Kind(_) | Subject::Mode(..) | Subject::FifoFull => Verdict::Yes,
    }
}

/// The watchdog time of slaves: a slave that gets no outputs for this time leaves OP. It is the initial value of their
/// registers (ETG.1000.4, watchdog of process data). The simulated network of a board gives slaves their outputs right
/// before each step, so it works with longer cycles too.
const WATCHDOG_NS: Ns = 100_000_000;

fn outlasts_watchdog(cycle: CycleTime) -> Verdict {
    let longest = std::iter::successors(CycleTime::from_us(cycle.us() / 2), |cycle| CycleTime::from_us(cycle.us() / 2));
    let longest = longest.into_iter().find(|cycle| cycle.ns() <= WATCHDOG_NS).map_or(0, CycleTime::us);
    Verdict::No {
        row: Row::Cycle,
        reason: format!(
            "a slave that gets no outputs for {} ms leaves OP by its watchdog, and a cycle of {} us is longer",
            WATCHDOG_NS / 1_000_000,
            cycle.us()
        ),
        next: format!("take a cycle of {longest} us at most (SET_DC)"),
    }
}

fn no_cycle(refused: &Refused) -> Verdict {
    let next = match refused.next_cycle {
        Some(cycle) => format!("a cycle of {} us holds (SET_DC); or use fewer slaves", cycle.us()),
        None => "no cycle holds with this clock; use a faster one".to_owned(),
    };
    Verdict::No { row: Row::Cycle, reason: refused.reason(), next }
}
