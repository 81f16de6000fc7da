//! The values of the axes and the board at each report of a recording, for the conditions of `ecmsk find`.

use ecmsk::cia402::DriveState;
use ecmsk::link::Dir;
use ecmsk::recording::Kinds;
use ecmsk::sk::dump::MAX_SLAVES;
use ecmsk::sk::{CommandId, DriveResponse, FIFO_ENTRIES, MasterResponse, MasterState, RawSlot, SlaveKind, StateByte};

use super::condition::{Flag, OfAxis, Values};
use crate::motion::{Axes, Execution, Quantity, Value};
use crate::plot::series::answers_abort_home;
use crate::plot::states::Homing;
use crate::recording::Framed;

/// Processes frames, and has the values at the last report.
pub struct Watch {
    axes: Axes,
    slaves: Vec<Slave>,
    state: StateByte,
    fifo: Option<u16>,
    /// The kinds of the slaves, where no command has said them.
    known: Kinds,
}

/// The values of a slave at the last report.
#[derive(Debug, Default)]
struct Slave {
    /// The decoded slot of an axis with process data; `None` if there is no process data, or the slave has no axis.
    drive: Option<DriveResponse>,
    /// Whether the slot has a torque and an error code; the slot of an HSP has neither.
    is_drive: bool,
    homing: Homing,
    /// The slot of the last report.
    slot: RawSlot,
    /// Whether the slave may be lost: the board is in state 0x18, and the slot has not changed since the last report
    /// before it.
    is_lost: bool,
    /// The value of each [`Quantity`] in the last report.
    moving: [Option<i64>; Quantity::ALL.len()],
}

impl Watch {
    /// Starts without frames.
    pub fn new() -> Self {
        Self {
            axes: Axes::new(),
            slaves: (0..MAX_SLAVES).map(|_| Slave::default()).collect(),
            state: StateByte::default(),
            fifo: None,
            known: Kinds::new(None),
        }
    }

    /// Sets the kinds of the slaves, for frames without the commands that say them.
    pub fn set_kinds(&mut self, kinds: Kinds) {
        self.known = kinds;
    }

    /// Processes the next frame; frames must be sorted by time. For a report, returns what it shows about the execution
    /// of commands; for a command frame, `None`.
    pub fn frame(&mut self, framed: &Framed) -> Option<Execution> {
        let (frame, size) = (&framed.recorded.frame, framed.size);
        if framed.recorded.dir == Dir::Write {
            self.axes.frame(framed, &mut |_| {});
            for (slave, number) in self.slaves.iter_mut().zip(1..=size.max_slaves()) {
                if CommandId::from_code(frame.slot(size, number).id) == CommandId::GoHome {
                    slave.homing.ask();
                }
            }
            return None;
        }
        let Self { axes, slaves, .. } = self;
        slaves.iter_mut().for_each(|slave| slave.moving = Default::default());
        let execution = axes.frame(framed, &mut |Value { slave, quantity, value, .. }| {
            let Some(slave) = slaves.get_mut(slave - 1) else { return };
            // A report may show the steps of several targets; the largest one counts.
            let now = &mut slave.moving[quantity as usize];
            if now.is_none_or(|before| before.unsigned_abs() < value.unsigned_abs()) {
                *now = Some(value);
            }
        });
        let board = MasterResponse::decode(&frame.slot(size, 0));
        let before = std::mem::replace(&mut self.state, board.state);
        let is_op = board.state.state() == Some(MasterState::Op);
        self.fifo = is_op.then_some(board.fifo_free.min(FIFO_ENTRIES));
        let has_data = is_op || board.state.state() == Some(MasterState::SafeOp);
        let is_aborted = is_op && answers_abort_home(frame, size);
        for (slave, number) in self.slaves.iter_mut().zip(1..=size.max_slaves()) {
            let slot = frame.slot(size, number);
            let is_same = std::mem::replace(&mut slave.slot, slot) == slot;
            slave.is_lost = is_op && board.state.is_failed() && is_same && (slave.is_lost || !before.is_failed());
            let kind = self.axes.kind(number).or(self.known.of(number));
            let is_axis = match kind {
                Some(kind) => matches!(kind, SlaveKind::Drive | SlaveKind::Step | SlaveKind::Hsp),
                None => CommandId::from_code(slot.id).is_for_axes(),
            };
            slave.is_drive = kind != Some(SlaveKind::Hsp);
            slave.drive = (has_data && is_axis).then(|| DriveResponse::decode(&slot));
            match &slave.drive {
                Some(drive) if is_op && !slave.is_lost => {
                    slave.homing.report(framed.time_ns, drive, is_aborted);
                }
                _ => slave.homing.interrupt(),
            }
        }
        Some(execution)
    }
}

impl Slave {
    fn is_fault(&self) -> Option<bool> {
        let state = self.drive.as_ref()?.statusword.state();
        Some(matches!(state, Some(DriveState::Fault | DriveState::FaultReactionActive)))
    }

    fn flag(&self, flag: Flag) -> Option<bool> {
        let drive = self.drive.as_ref()?;
        match flag {
            Flag::Enabled => Some(drive.statusword.is_enabled()),
            Flag::Fault => self.is_fault(),
            Flag::QuickStop => Some(drive.statusword.state() == Some(DriveState::QuickStopActive)),
            Flag::Homing => Some(self.homing.is_under_way()),
            Flag::Lost => Some(self.is_lost),
            Flag::Bit(bit) => Some(drive.statusword.0 & bit != 0),
        }
    }
}

impl Values for Watch {
    fn of_axis(&self, quantity: OfAxis, number: u8) -> Option<i64> {
        let slave = self.slaves.get(usize::from(number).checked_sub(1)?)?;
        let drive = slave.drive.as_ref()?;
        match quantity {
            OfAxis::Position => Some(drive.position.into()),
            OfAxis::Target => self.axes.target(number.into()).map(i64::from),
            OfAxis::Moving(Quantity::Torque) => slave.is_drive.then_some(drive.torque.into()),
            OfAxis::Moving(quantity) => slave.moving[quantity as usize],
            OfAxis::Alarm if !slave.is_fault()? => Some(0),
            OfAxis::Alarm => slave.is_drive.then_some(drive.error_code.into()),
        }
    }

    fn flag(&self, flag: Flag, number: Option<u8>) -> Option<bool> {
        match number {
            Some(number) => self.slaves.get(usize::from(number).checked_sub(1)?)?.flag(flag),
            None => {
                let known = self.slaves.iter().filter_map(|slave| slave.flag(flag));
                known.reduce(|any, has| any || has)
            }
        }
    }

    fn state(&self) -> u8 {
        self.state.0
    }

    fn fifo(&self) -> Option<u16> {
        self.fifo
    }
}
