//! What the frames of a program show of its troubles, one after the other: alarms, changes of state that failed, gaps in a
//! motion, a FIFO that was full, frames with a wrong CRC.

use super::gaps::Gaps;
use super::line::{Alarm, StateFailed};
use crate::cia402::{DriveState, Statusword};
use crate::recording::Kinds;
use crate::sk::dump::MAX_SLAVES;
use crate::sk::{
    CommandId, DriveResponse, FIFO_ENTRIES, Frame, MasterCommand, MasterResponse, MasterState, SlaveKind, SlotSize,
    StateByte,
};

/// What was seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sight {
    /// An alarm begins.
    Alarm(Alarm),
    /// A change of state has failed.
    StateFailed(StateFailed),
}

/// What was counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts {
    /// Command frames.
    pub commands: u64,
    /// Reports.
    pub reports: u64,
    /// Frames lost to a full FIFO, by slot 0's own count.
    pub full: u64,
    /// Frames with a wrong CRC, by slot 0's own count.
    pub crc: u64,
    /// Gaps in a motion: the FIFO ran empty on the way of one or more axes.
    pub gaps: u64,
}

/// Follows frames. Nothing of it allocates.
#[derive(Debug)]
pub struct FrameWatch {
    size: SlotSize,
    kinds: Kinds,
    declared: bool,
    state: StateByte,
    /// Full count and CRC errors of the last report.
    losses: Option<(u16, u8)>,
    /// The alarm of each slave.
    alarms: [Option<u16>; MAX_SLAVES],
    gaps: [Gaps; MAX_SLAVES],
    /// When the newest command frame was sent.
    sent_ns: i64,
    /// Reports since then that showed an empty FIFO.
    idle_reports: u32,
    counts: FrameCounts,
}

impl FrameWatch {
    /// Of frames with slots of that size.
    pub fn new(size: SlotSize) -> Self {
        Self {
            size,
            kinds: Kinds::new(None),
            declared: false,
            state: StateByte::default(),
            losses: None,
            alarms: [None; MAX_SLAVES],
            gaps: std::array::from_fn(|_| Gaps::default()),
            sent_ns: i64::MIN,
            idle_reports: 0,
            counts: FrameCounts::default(),
        }
    }

    /// What was counted so far.
    pub const fn counts(&self) -> FrameCounts {
        self.counts
    }

    /// A command frame goes by.
    pub fn command(&mut self, at_ns: i64, frame: &Frame) {
        self.counts.commands += 1;
        self.sent_ns = at_ns;
        self.idle_reports = 0;
        self.kinds.command(frame, self.size);
        if self.state.state() != Some(MasterState::Op) {
            match MasterCommand::decode(&frame.slot(self.size, 0), self.size) {
                Ok(MasterCommand::SetAxis { kinds, .. }) => {
                    self.declared |= kinds.iter().any(|kind| !matches!(kind, SlaveKind::Io | SlaveKind::None));
                }
                Ok(MasterCommand::SoftReset) => self.declared = false,
                _ => {}
            }
            return;
        }
        let mut is_gap = false;
        for (slave, gaps) in (1..=self.size.max_slaves()).zip(&mut self.gaps) {
            let slot = frame.slot(self.size, slave);
            match CommandId::from_code(slot.id) {
                CommandId::Csp => is_gap |= gaps.target(at_ns, slot.data1 as i32).is_some(),
                CommandId::GetStatus => {}
                _ => gaps.reset(),
            }
        }
        self.counts.gaps += u64::from(is_gap);
    }

    /// A report goes by.
    pub fn report(&mut self, at_ns: i64, frame: &Frame, see: &mut dyn FnMut(Sight)) {
        self.counts.reports += 1;
        self.kinds.response(frame, self.size);
        let board = MasterResponse::decode(&frame.slot(self.size, 0));
        let before = std::mem::replace(&mut self.state, board.state);
        if board.state.is_failed() && before != board.state {
            see(Sight::StateFailed(StateFailed { state: board.state.0, declared: self.declared }));
        }
        if !matches!(board.state.state(), Some(MasterState::SafeOp | MasterState::Op)) {
            // The FIFO and what slaves said are of no meaning any more.
            self.losses = None;
            self.gaps.iter_mut().for_each(Gaps::reset);
            return;
        }
        if board.state.state() == Some(MasterState::Op) {
            let (full, crc) =
                self.losses.replace((board.full_count, board.error)).unwrap_or((board.full_count, board.error));
            self.counts.full += u64::from(board.full_count.wrapping_sub(full));
            self.counts.crc += u64::from(board.error.wrapping_sub(crc));
            if board.fifo_free >= FIFO_ENTRIES && at_ns > self.sent_ns {
                self.idle_reports = self.idle_reports.saturating_add(1);
                // The first one shows that the newest target is executed: a program that sends one in each cycle has no gap.
                if self.idle_reports > 1 {
                    self.gaps.iter_mut().for_each(|gaps| gaps.idle(at_ns));
                }
            }
        }
        for slave in 1..=self.size.max_slaves() {
            let slot = frame.slot(self.size, slave);
            let drive = DriveResponse::decode(&slot);
            let code = match self.kinds.of(slave) {
                Some(SlaveKind::Drive | SlaveKind::Step) => drive.error_code,
                Some(SlaveKind::Hsp) => 0,
                Some(SlaveKind::Io | SlaveKind::None) => continue,
                // The board runs since before this program: what answers to commands of drives is one.
                None if is_of_drives(CommandId::from_code(slot.id)) => drive.error_code,
                None => continue,
            };
            self.alarm(slave, is_fault(drive.statusword).then_some(code), see);
        }
    }

    fn alarm(&mut self, slave: usize, now: Option<u16>, see: &mut dyn FnMut(Sight)) {
        let before = std::mem::replace(&mut self.alarms[slave - 1], now);
        // A drive may show its fault before it shows the code.
        if let Some(code) = now
            && before.is_none_or(|before| before != code && code != 0)
        {
            see(Sight::Alarm(Alarm { slave: slave as u8, code }));
        }
    }
}

fn is_fault(statusword: Statusword) -> bool {
    matches!(statusword.state(), Some(DriveState::Fault | DriveState::FaultReactionActive))
}

fn is_of_drives(id: CommandId) -> bool {
    use CommandId::{AbortHome, AlarmClear, Csp, Cst, Csv, GoHome, ServoOff, ServoOn};
    matches!(id, AlarmClear | ServoOn | ServoOff | Csp | Csv | Cst | GoHome | AbortHome)
}
