//! The state of the network, derived from the frames between a program and its board: configured slaves, their modes,
//! and the last commands.

use super::seen::Seen;
use crate::ecm::config::Config;
use crate::ethercat::cia402::Statusword;
use crate::link::Stamp;
use crate::recording::Kinds;
use crate::sk::{
    CycleTime, FIFO_ENTRIES, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, SlaveKind, SlotSize,
};

const SLAVES: usize = SlotSize::Bytes12.max_slaves();

/// The state of a network, derived from the frames in both directions.
#[derive(Clone, Debug)]
pub struct Watch {
    kinds: Kinds,
    pub(super) slaves: [Seen; SLAVES],
    cycle: CycleTime,
    state: Option<MasterState>,
    /// The count of frames that found the FIFO full, as the newest report in OP shows it.
    full_count: u16,
    /// The count of frames with a wrong CRC, as the newest report shows it.
    error_count: u8,
    /// When SW_RESET was written; `None` if none was, or if a report has shown that the board has executed or rejected
    /// it. A board that rejects it (SK-1.24) goes on as before.
    resets: Option<Stamp>,
    /// Whether a program has set a threshold (SET_FIFO) that may be in force.
    has_threshold: bool,
    /// Whether the link to the board was opened again, and no report has come since.
    is_reopened: bool,
}

impl Default for Watch {
    fn default() -> Self {
        Self {
            kinds: Kinds::new(None),
            slaves: [Seen::default(); SLAVES],
            cycle: CycleTime::DEFAULT,
            state: None,
            full_count: 0,
            error_count: 0,
            resets: None,
            has_threshold: false,
            is_reopened: false,
        }
    }
}

impl Watch {
    /// The state of the network in the newest report.
    pub const fn state(&self) -> Option<MasterState> {
        self.state
    }

    /// Reads a command frame that was written at `at`.
    pub fn command(&mut self, frame: &Frame, size: SlotSize, at: Stamp) {
        let command = MasterCommand::decode(&frame.slot(size, 0), size);
        if let Ok(MasterCommand::SoftReset) = command {
            self.resets = Some(at);
            return;
        }
        // A program that configures slaves after SW_RESET has seen the effect of the reset, or has waited for it. So
        // the reset counts as executed, even if no report has shown it. The same holds for a reset while the link was
        // lost.
        if (self.resets.is_some() || self.is_reopened) && matches!(command, Ok(MasterCommand::SetAxis { .. })) {
            self.forget_all(None);
        }
        let set_up = !matches!(self.state, Some(MasterState::SafeOp | MasterState::Op));
        self.kinds.command(frame, size);
        match command {
            Ok(MasterCommand::SetAxis { group, .. }) if set_up => {
                let slaves = self.slaves.iter_mut().skip(usize::from(group) * 8).take(8);
                slaves.for_each(Seen::forget_all_but_the_mode);
            }
            Ok(MasterCommand::SetDc { cycle, .. }) if set_up => self.cycle = cycle,
            // It is now unknown which command each axis has executed last: the newest ones may be among the discarded
            // entries.
            Ok(MasterCommand::SetFifo(FifoAction::Clear)) => {
                self.forget_targets();
                self.has_threshold = false;
            }
            Ok(MasterCommand::SetFifo(FifoAction::Threshold(free))) => {
                self.has_threshold = free < FIFO_ENTRIES.into();
            }
            _ => {}
        }
        let in_op = self.state == Some(MasterState::Op);
        for (n, seen) in (1..=size.max_slaves()).zip(&mut self.slaves) {
            // The slots of other slaves are not read, because only axes get motion commands. Below SafeOP all slots are
            // read, because DRIVE_MODE may come before SET_AXIS declares the slave.
            let has_axes = matches!(self.kinds.of(n), Some(SlaveKind::Drive | SlaveKind::Hsp | SlaveKind::Step));
            if has_axes || set_up {
                seen.command(&frame.slot(size, n), size, set_up, in_op && has_axes);
            }
        }
    }

    /// Reads a report that was made at `at`.
    pub fn report(&mut self, frame: &Frame, size: SlotSize, at: Stamp) {
        let board = MasterResponse::decode(&frame.slot(size, 0));
        self.kinds.response(frame, size);
        self.state = board.state.state();
        let in_op = self.state == Some(MasterState::Op);
        if std::mem::take(&mut self.is_reopened) && !in_op {
            self.forget_all(self.state);
        }
        // In OP a changed error count means that the board has rejected a frame. Outside OP a reset may have set the
        // count to 0.
        let refused = std::mem::replace(&mut self.error_count, board.error) != board.error && in_op;
        // Only a report made after the reset shows its effect. A program that reads late may still get older reports
        // from the time before OP, which look like those after a reset.
        let shows = self.resets.is_some_and(|reset| at > reset);
        if shows && refused {
            self.resets = None;
        } else if shows && !in_op {
            self.forget_all(self.state);
        }
        if !in_op {
            self.slaves.iter_mut().for_each(Seen::forget_all_but_the_mode);
            self.has_threshold = false;
            return;
        }
        // The board has rejected frames with a wrong CRC, or lost frames because its FIFO was full. Reports do not show
        // which ones.
        let full = std::mem::replace(&mut self.full_count, board.full_count) != board.full_count;
        if refused || full {
            self.forget_targets();
        }
        // A rejected frame may be the one that reset the threshold, so the threshold may still be in force.
        self.has_threshold |= refused;
        let slots = frame.slots(size);
        for (n, seen) in (1..=size.max_slaves()).zip(&mut self.slaves) {
            let slot = slots.head(n);
            seen.report(slot.id, Statusword(slot.parm.get()));
        }
    }

    /// Notes that reports were lost. One of them may have shown that a slave has begun to home.
    pub fn missed(&mut self) {
        self.slaves.iter_mut().for_each(Seen::missed);
    }

    /// Whether SW_RESET was commanded, and no report has shown its effect yet.
    pub const fn is_being_reset(&self) -> bool {
        self.resets.is_some()
    }

    /// Notes that the link to the board was lost and was opened again. Frames and reports are missing, so the last
    /// commands are not known, and a threshold may be in force. If the next report is outside OP, the board may have
    /// been reset: then everything is forgotten.
    pub fn reopened(&mut self) {
        self.missed();
        self.forget_targets();
        (self.state, self.resets) = (None, None);
        (self.has_threshold, self.is_reopened) = (true, true);
    }

    /// Forgets everything, because the board was reset. `state`: the state of the network after the reset, if it is
    /// known.
    fn forget_all(&mut self, state: Option<MasterState>) {
        *self = Self { error_count: self.error_count, state, ..Self::default() };
    }

    /// Forgets the last commands, because the board may not have executed them.
    fn forget_targets(&mut self) {
        self.slaves.iter_mut().for_each(Seen::forget_targets);
    }

    /// Whether a FIFO threshold may still hold entries back.
    pub const fn has_threshold(&self) -> bool {
        self.has_threshold
    }

    /// The configuration of the network; `None` if no SET_AXIS was seen.
    pub fn config(&self) -> Option<Config> {
        let declared = |slave: &usize| self.kinds.of(*slave).is_some_and(|kind| kind != SlaveKind::None);
        let count = (1..=SLAVES).rev().find(declared)?;
        let slaves = (1..=count).zip(&self.slaves).map(|(n, seen)| seen.slave(self.kinds.of(n))).collect();
        Some(Config { slaves, cycle_us: self.cycle.us() })
    }

    /// Slaves that may be homing: GO_HOME was written to them, and no later report shows a motion command.
    pub fn homing(&self) -> impl Iterator<Item = u8> {
        (1..).zip(&self.slaves).filter(|(_, seen)| seen.may_be_homing()).map(|(n, _)| n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ecm::config::Slave;
    use crate::ethercat::cia402::Mode;
    use crate::sk::{CommandId, DriveSync, MASTER_CYCLIC, Motion, RawSlot, SlaveCommand, StateByte};

    const SIZE: SlotSize = SlotSize::Bytes12;

    /// TCP-9 On virtual time a server sees only the reports that its writer reads. If the writer starts a homing and
    /// reads no report, the server learns of it from the first report that is read later.
    #[test]
    fn a_homing_that_only_a_report_shows() {
        let mut watch = Watch::default();
        let mut frame = Frame::new();
        frame.put_master(SIZE, &MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Drive; 8] });
        watch.command(&frame, SIZE, Stamp(0));
        frame = Frame::new();
        frame.put_slave(SIZE, 2, &SlaveCommand::GoHome.into());
        watch.command(&frame, SIZE, Stamp(0));
        assert_eq!(watch.homing().count(), 0, "as far as is known the network is not in OP");
        let mut report = Frame::new();
        let state = StateByte::reached(MasterState::Op);
        report.put(SIZE, 0, &MasterResponse { id: MASTER_CYCLIC, state, ..MasterResponse::default() }.encode());
        let enabled = RawSlot { parm: 0x0237, ..RawSlot::ZERO };
        report.put(SIZE, 1, &enabled);
        report.put(SIZE, 2, &RawSlot { id: CommandId::GoHome.code(), ..enabled });
        watch.report(&report, SIZE, Stamp(1));
        assert_eq!(watch.homing().collect::<Vec<_>>(), [2]);
        report.put(SIZE, 2, &RawSlot { id: CommandId::Csp.code(), ..enabled });
        watch.report(&report, SIZE, Stamp(1));
        assert_eq!(watch.homing().count(), 0, "it follows again");
    }

    fn report(watch: &mut Watch, state: MasterState, error: u8) {
        let state = StateByte::reached(state);
        let answer = MasterResponse { id: MASTER_CYCLIC, state, error, fifo_free: 160, ..MasterResponse::default() };
        let mut report = Frame::new();
        report.put(SIZE, 0, &answer.encode());
        report.put(SIZE, 1, &RawSlot { parm: 0x0237, ..RawSlot::ZERO });
        watch.report(&report, SIZE, Stamp(1));
    }

    fn master(watch: &mut Watch, command: &MasterCommand) {
        let mut frame = Frame::new();
        frame.put_master(SIZE, command);
        watch.command(&frame, SIZE, Stamp(0));
    }

    /// A network in OP with a drive that runs in CSV.
    fn running() -> Watch {
        let mut watch = Watch::default();
        report(&mut watch, MasterState::PreOp, 3);
        master(&mut watch, &MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Drive; 8] });
        let mut frame = Frame::new();
        let mode = SlaveCommand::DriveMode { mode: Mode::Csv, sync: DriveSync::DcSync };
        frame.put_slave(SIZE, 1, &mode.into());
        watch.command(&frame, SIZE, Stamp(0));
        report(&mut watch, MasterState::Op, 3);
        frame = Frame::new();
        frame.put_slave(SIZE, 1, &SlaveCommand::Csv(Motion::to(1000)).into());
        watch.command(&frame, SIZE, Stamp(0));
        report(&mut watch, MasterState::Op, 3);
        assert!(watch.slaves[0].last.is_some());
        watch
    }

    fn mode(watch: &Watch) -> Option<Mode> {
        match watch.config()?.slaves[0] {
            Slave::Drive(axis) => Some(axis.mode),
            _ => None,
        }
    }

    /// TCP-24, SK-1.24, SK-1.25 A SW_RESET that the board has refused because of its CRC changes nothing: the axes go
    /// on, and have to be stopped.
    #[test]
    fn a_reset_that_the_board_has_refused() {
        let mut watch = running();
        master(&mut watch, &MasterCommand::SoftReset);
        assert_eq!(mode(&watch), Some(Mode::Csv), "no report has shown yet that it has reset itself");
        // A writer that has read no report yet first gets the reports from the time before OP.
        let mut way = Frame::new();
        let state = StateByte::reached(MasterState::PreOp);
        way.put(SIZE, 0, &MasterResponse { state, ..MasterResponse::default() }.encode());
        watch.report(&way, SIZE, Stamp(0));
        assert_eq!(mode(&watch), Some(Mode::Csv), "that one was made before");
        report(&mut watch, MasterState::Op, 3);
        report(&mut watch, MasterState::Op, 4);
        assert_eq!((mode(&watch), watch.state()), (Some(Mode::Csv), Some(MasterState::Op)));
        // The error count has risen in OP: the board has refused SW_RESET. If the network leaves OP later, that is not taken
        // for the effect of this SW_RESET.
        report(&mut watch, MasterState::SafeOp, 4);
        report(&mut watch, MasterState::Op, 4);
        assert_eq!(mode(&watch), Some(Mode::Csv));
    }

    /// SK-4.33 An executed SW_RESET deletes all state. A program that configures slaves after it without reading a
    /// report has the same effect.
    #[test]
    fn a_reset_that_the_board_has_executed() {
        let mut watch = running();
        master(&mut watch, &MasterCommand::SoftReset);
        report(&mut watch, MasterState::Init, 0);
        assert!(watch.config().is_none());

        let mut watch = running();
        master(&mut watch, &MasterCommand::SoftReset);
        let mut kinds = [SlaveKind::None; 8];
        kinds[0] = SlaveKind::Drive;
        master(&mut watch, &MasterCommand::SetAxis { group: 0, kinds });
        for state in [MasterState::PreOp, MasterState::Op] {
            report(&mut watch, state, 0);
            let declared = watch.config().expect("it is declared");
            assert_eq!((declared.slaves.len(), mode(&watch)), (1, Some(Mode::Csp)), "{state:?}");
        }
    }

    /// TCP-26 After the link was lost and opened again, the axes and modes of a board in OP are still known, but not
    /// the last commands. A board outside OP may have been reset, and a board that is configured anew was reset.
    #[test]
    fn a_link_that_is_opened_again() {
        let mut watch = running();
        watch.reopened();
        report(&mut watch, MasterState::Op, 3);
        assert_eq!(mode(&watch), Some(Mode::Csv));
        assert!(watch.slaves[0].last.is_none() && watch.has_threshold());
        report(&mut watch, MasterState::SafeOp, 3);
        report(&mut watch, MasterState::Op, 3);
        assert_eq!((mode(&watch), watch.has_threshold()), (Some(Mode::Csv), false), "only the first report decides");

        // The outputs of an HSP are as before, until the network leaves OP.
        let mut watch = running();
        watch.slaves[0].outputs = [5, 6];
        watch.reopened();
        report(&mut watch, MasterState::Op, 3);
        assert_eq!(watch.slaves[0].outputs, [5, 6]);
        report(&mut watch, MasterState::SafeOp, 3);
        assert_eq!(watch.slaves[0].outputs, [0; 2]);

        let mut watch = running();
        watch.reopened();
        report(&mut watch, MasterState::PreOp, 0);
        assert!(watch.config().is_none());

        let mut watch = running();
        watch.reopened();
        master(&mut watch, &MasterCommand::SetAxis { group: 0, kinds: [SlaveKind::Drive; 8] });
        report(&mut watch, MasterState::PreOp, 0);
        assert_eq!(mode(&watch), Some(Mode::Csp), "the mode was that of before");
    }

    /// TCP-24, SK-1.24 After a frame with a wrong CRC the last targets are unknown, and a threshold may still be in force.
    #[test]
    fn frames_that_the_board_has_refused() {
        let mut watch = running();
        master(&mut watch, &MasterCommand::SetFifo(FifoAction::Threshold(10)));
        master(&mut watch, &MasterCommand::SetFifo(FifoAction::Clear));
        assert!(!watch.has_threshold());
        let mut frame = Frame::new();
        frame.put_slave(SIZE, 1, &SlaveCommand::Csv(Motion::to(0)).into());
        watch.command(&frame, SIZE, Stamp(0));
        report(&mut watch, MasterState::Op, 4);
        assert!(watch.slaves[0].last.is_none() && watch.has_threshold());
        assert_eq!(mode(&watch), Some(Mode::Csv));
    }
}
