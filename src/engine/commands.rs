//! The commands of the board: what each of them does when its command frame is executed, and why it may be rejected
//! (SK-4).

use super::sdo::Accepted;
use super::{CrcSwitches, Engine, Event, EventKind, HomingEnd, Reason, Rejection, SlotHead};
use crate::ethercat::cia402::Mode;
use crate::fieldbus::{Ns, Role};
use crate::sk::{
    CommandId, DcShift, FifoAction, Frame, MasterCommand, MasterState, Motion, RawSlot, SdoCommand, SlaveCommand,
    SlaveKind, SlotCommand, SlotKind,
};

/// The bit that stands for a kind of slot (slot 0, a slave, SDO) in [`ADMITTED`].
const fn slot_bit(slot: SlotKind) -> u8 {
    1 << slot as u8
}

const STATES: [MasterState; 4] = [MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op];

/// For each command code the slots that may hold it ([`slot_bit`]) and the network states that allow it
/// ([`state_bit`]). It is a precomputed table because every slot of every cycle needs it.
static ADMITTED: [u8; 256] = {
    let mut admitted = [0; 256];
    let mut n = 0;
    while n < CommandId::ALL.len() {
        let id = CommandId::ALL[n];
        let mut bits = 0;
        let mut slot = 0;
        while slot < SlotKind::ALL.len() {
            if id.belongs_in(SlotKind::ALL[slot]) {
                bits |= slot_bit(SlotKind::ALL[slot]);
            }
            slot += 1;
        }
        let mut state = 0;
        while state < STATES.len() {
            if id.is_allowed_in(STATES[state]) {
                bits |= state_bit(STATES[state]);
            }
            state += 1;
        }
        admitted[id.code() as usize] = bits;
        n += 1;
    }
    admitted
};

/// The bit that stands for a network state in [`ADMITTED`]. These bits do not overlap those of [`slot_bit`].
const fn state_bit(state: MasterState) -> u8 {
    match state {
        MasterState::Init => 1 << 4,
        MasterState::PreOp => 1 << 5,
        MasterState::SafeOp => 1 << 6,
        MasterState::Op => 1 << 7,
    }
}

/// What became of a slave's command that was not rejected.
enum Outcome {
    /// The command was executed. `Some` after IO_WR: the output image that the answer shows.
    Executed(Option<u16>),
    /// The command was ignored because the slave is homing. The answer does not show it.
    Ignored,
    /// The command has no effect, because the slave is homing, but it is answered as if it had been executed (SV_ON).
    InVain,
}

/// Whether a slave that is configured for this role, a kind of slave with its mode, accepts the command. The error is the
/// reason for the rejection.
#[inline(always)]
pub(super) const fn check_kind(command: &SlaveCommand, role: Role) -> Result<(), Reason> {
    let id = command.id();
    let (takes, why_not) = match role {
        Role::Unused => (id.is_for(SlaveKind::None), Reason::NoSlave),
        Role::Drive(_) => (id.is_for(SlaveKind::Drive), Reason::WrongSlot),
        Role::Step(_) => (id.is_for(SlaveKind::Step), Reason::WrongSlot),
        Role::Hsp(_) => (id.is_for(SlaveKind::Hsp), Reason::WrongSlot),
        Role::Io => (id.is_for(SlaveKind::Io), Reason::WrongSlot),
    };
    if takes { Ok(()) } else { Err(why_not) }
}

#[inline]
fn admit_in(state: Option<MasterState>, id: CommandId, slot: SlotKind) -> Result<(), Reason> {
    let needed = slot_bit(slot) | state.map_or(u8::MAX, state_bit);
    if ADMITTED[usize::from(id.code())] & needed == needed { Ok(()) } else { Err(why_not_admitted(id, slot)) }
}

#[cold]
fn why_not_admitted(id: CommandId, slot: SlotKind) -> Reason {
    match id {
        CommandId::Unknown(_) => Reason::UnknownId,
        _ if !id.belongs_in(slot) => Reason::WrongSlot,
        _ => Reason::WrongState,
    }
}

impl Engine {
    /// Executes all slots of a frame in their order. A rejected command in one slot does not affect the others.
    pub(super) fn execute(&mut self, frame: &Frame, at: Ns) {
        let size = self.config.slot;
        let boots = self.boots;
        if self.network().in_op() {
            self.execute_queued_master(&frame.slot(size, 0), at);
        } else {
            self.execute_master(&frame.slot(size, 0), at);
        }
        if self.boots != boots {
            return;
        }
        self.execute_slaves(frame, at);
        self.execute_sdo(&frame.slot(size, size.sdo_slot()), at);
    }

    /// Executes the slots of the slaves in a frame, without slot 0 and the SDO slot.
    pub(super) fn execute_slaves(&mut self, frame: &Frame, at: Ns) {
        let size = self.config.slot;
        let slots = frame.slots(size);
        self.homing_before = self.homing_slaves();
        self.homing_elsewhere = self.excludes_go_home(frame);
        for slave in 1..size.max_slaves() + 1 {
            self.execute_slave(slave, &slots.get(slave), at);
        }
        self.start_homing();
    }

    /// Executes slot 0 of a FIFO entry. Commands that act on the arrival of their frame (SET_STATE, SET_FIFO and
    /// SW_RESET) have been executed already and are skipped. The network may have left OP before the board learns that
    /// the entry was sent; commands that OP allows are executed nevertheless.
    pub(super) fn execute_queued_master(&mut self, slot: &RawSlot, at: Ns) {
        let id = CommandId::from_code(slot.id);
        if id.acts_on_arrival() {
            return;
        }
        match admit_in(Some(MasterState::Op), id, SlotKind::Master) {
            Ok(()) => self.execute_master(slot, at),
            Err(reason) => self.reject(0, id, reason, at),
        }
    }

    pub(super) fn execute_master(&mut self, slot: &RawSlot, at: Ns) {
        let id = CommandId::from_code(slot.id);
        let done = self.admit(id, SlotKind::Master).and_then(|()| {
            let command = MasterCommand::decode(slot, self.config.slot).map_err(Reason::BadArgument)?;
            self.run_master(&command, at)
        });
        match done {
            // SW_RESET gets no answer: it has just reset slot 0, which would show the answer.
            Ok(_) if id == CommandId::SoftReset => {}
            Ok(result) => {
                self.volatile.master_id = id;
                if id != CommandId::GetStatus {
                    self.volatile.master_result = result;
                }
            }
            Err(reason) => self.reject(0, id, reason, at),
        }
    }

    /// Executes a command of slot 0. Returns the result for bytes 4..7 of the answer; 0 for a command without a result
    /// (SK-2 \[OURS]).
    fn run_master(&mut self, command: &MasterCommand, at: Ns) -> Result<u32, Reason> {
        match *command {
            MasterCommand::GetStatus | MasterCommand::Other(_) => {}
            MasterCommand::SetState(target) => {
                let deadline = at.saturating_add(self.config.state_timeout_ns);
                if !self.volatile.network.request(target, deadline, self.has_new_declarations()) {
                    return Err(Reason::WrongState);
                }
            }
            MasterCommand::SetAxis { group, kinds } => {
                let first = usize::from(group) * 8;
                for (place, kind) in self.volatile.kinds.iter_mut().skip(first).zip(kinds) {
                    *place = kind;
                }
                self.declared(at);
                let in_init = self.network().state() == Some(MasterState::Init);
                return Ok(if in_init { 0 } else { self.network().found().into() });
            }
            MasterCommand::SetDc { cycle, shift } => {
                self.volatile.cycle = cycle;
                self.declared(at);
                if let DcShift::Other(data2) = shift {
                    self.log.push(Event { at, kind: EventKind::OddDcShift { data2 } });
                }
            }
            MasterCommand::SetEx { check_commands, fill_responses } => {
                self.remembered = CrcSwitches { check_commands, fill_responses };
            }
            MasterCommand::SetFifo(FifoAction::Clear) => self.clear_fifo(),
            MasterCommand::SetFifo(FifoAction::Threshold(free)) => self.fifo.set_threshold(free),
            MasterCommand::LocalRead => return Ok(self.local_inputs.into()),
            MasterCommand::LocalWrite(bits) => self.volatile.local_outputs = bits,
            MasterCommand::SoftReset => self.reset(),
        }
        Ok(0)
    }

    #[inline(always)]
    fn execute_slave(&mut self, slave: usize, slot: &RawSlot, at: Ns) {
        if self.is_lost_in_op(slave) {
            return self.execute_for_lost(slave, slot, at);
        }
        let head = SlotHead { id: slot.id, index: slot.index, output_image: None };
        if slot.id == CommandId::GetStatus.code() {
            // Outside OP, GET_STATUS changes only the id, byte 0, of a slave's slot. Bytes 1..11 stay at the result of
            // the previous command (UG17 2.1.1).
            let kept = if self.network().in_op() { head } else { self.volatile.heads[slave - 1] };
            self.volatile.heads[slave - 1] = SlotHead { id: slot.id, ..kept };
            return;
        }
        let id = CommandId::from_code(slot.id);
        let done = match id {
            // During a motion nearly every slot contains CSP. A constant id lets the compiler inline a `run_slot` that
            // decodes CSP only.
            CommandId::Csp => self.run_slot(slave, CommandId::Csp, slot, at),
            _ => self.run_other_slot(slave, id, slot, at),
        };
        match done {
            Ok(Outcome::Executed(output_image)) => {
                let index =
                    if id == CommandId::DriveMode { self.index_of_drive_mode(slave, slot.index) } else { head.index };
                self.volatile.heads[slave - 1] = SlotHead { index, output_image, ..head };
            }
            Ok(Outcome::InVain) => {
                self.commanded.remove(slave as u8);
                self.volatile.heads[slave - 1] = head;
            }
            // SK-3 [OURS]: byte 0 of the slave's slot shows the command that was executed last. An ignored command was
            // not executed, so the byte keeps its value.
            Ok(Outcome::Ignored) => {
                self.commanded.remove(slave as u8);
            }
            Err(reason) => {
                self.commanded.remove(slave as u8);
                // SK-4 [OURS]: outside OP a rejected command leaves the slave's slot in reports unchanged. In OP the
                // slot becomes an answer to GET_STATUS.
                if self.network().in_op() {
                    self.volatile.heads[slave - 1] = SlotHead::default();
                }
                self.reject(slave, id, reason, at);
            }
        }
    }

    #[inline(always)]
    fn run_slot(&mut self, slave: usize, id: CommandId, slot: &RawSlot, at: Ns) -> Result<Outcome, Reason> {
        self.admit(id, SlotKind::Slave)?;
        let SlotCommand { command, .. } =
            SlotCommand::decode_as(id, slot, self.config.slot).map_err(Reason::BadArgument)?;
        self.mark_commanded(slave);
        self.run_slave(slave, &command, at)
    }

    #[inline(never)]
    fn run_other_slot(&mut self, slave: usize, id: CommandId, slot: &RawSlot, at: Ns) -> Result<Outcome, Reason> {
        let done = self.run_slot(slave, id, slot, at)?;
        if id == CommandId::DriveMode && slot.data2 > 1 {
            self.log.push(Event { at, kind: EventKind::OddDriveType { slave: slave as u8, data2: slot.data2 } });
        }
        Ok(done)
    }

    #[inline(always)]
    fn run_slave(&mut self, slave: usize, command: &SlaveCommand, at: Ns) -> Result<Outcome, Reason> {
        if let SlaveCommand::DriveMode { mode, sync } = *command {
            self.volatile.modes[slave - 1] = (mode, sync);
            self.declared(at);
            return Ok(Outcome::Executed(None));
        }
        check_kind(command, self.role(slave))?;
        if command.id().is_ignored_while_homing() && self.ignores_motion(slave) {
            // SV_ON is answered during homing, although it has no effect [OURS]: a program that waits for the answer
            // would otherwise wait until homing ends. Other ignored commands are not answered.
            let is_on = *command == SlaveCommand::ServoOn;
            return Ok(if is_on { Outcome::InVain } else { Outcome::Ignored });
        }
        match *command {
            SlaveCommand::IoWrite(bits) => {
                self.end_output_test();
                self.axes[slave - 1][0].requested.out.outputs = bits;
                return Ok(Outcome::Executed(Some(bits)));
            }
            SlaveCommand::ServoOn => self.each_axis(slave, super::Axis::switch_on),
            SlaveCommand::ServoOff => {
                self.end_homing(slave, HomingEnd::ServoOff, at);
                self.each_axis(slave, super::Axis::switch_off);
            }
            SlaveCommand::AlarmClear => self.each_axis(slave, super::Axis::clear_alarm),
            SlaveCommand::Csp(motion) => self.set_targets(slave, Mode::Csp, &motion)?,
            SlaveCommand::Csv(motion) => self.set_targets(slave, Mode::Csv, &motion)?,
            SlaveCommand::Cst(torque) => self.set_targets(slave, Mode::Cst, &Motion::to(torque.into()))?,
            SlaveCommand::GoHome => self.go_home(slave)?,
            SlaveCommand::AbortHome => self.abort_home_in_frame(at),
            SlaveCommand::GetStatus
            | SlaveCommand::IoRead
            | SlaveCommand::DriveMode { .. }
            | SlaveCommand::Other(_) => {}
        }
        Ok(Outcome::Executed(None))
    }

    /// Byte 1 of the answer to DRIVE_MODE. In firmware 1.7 it is the index of the command, `index`. In firmware 1.5 it is
    /// the mode of operation (UG15 2.1.5); SK-3: 0 for an IO slave, and for a number without a slave \[OURS].
    fn index_of_drive_mode(&self, slave: usize, index: u8) -> u8 {
        self.config.firmware.byte_1(index, self.declared_mode(slave))
    }

    fn each_axis(&mut self, slave: usize, act: impl Fn(&mut super::Axis)) {
        let axes = self.axes(slave);
        self.axes[slave - 1][..axes].iter_mut().for_each(act);
    }

    /// Whether CSP, CSV or CST is accepted: only in the mode that DRIVE_MODE chose, and while 0x6060 has that value. On
    /// a slave with two axes, axis 1 decides \[OURS].
    pub(super) fn check_mode(&self, slave: usize, mode: Mode) -> Result<(), Reason> {
        let right = self.role(slave).mode() == Some(mode) && self.volatile.modes_written[slave - 1][0] == mode.code();
        if right { Ok(()) } else { Err(Reason::WrongMode) }
    }

    /// Takes the targets and digital outputs of CSP, CSV or CST. A target for an axis 2 that is in another mode than
    /// axis 1 is discarded \[OURS].
    ///
    /// A command counts as discarded once, whether one or both of its targets are discarded. Its digital outputs are
    /// taken in any case, since they do not depend on the power stage \[OURS].
    #[inline]
    fn set_targets(&mut self, slave: usize, mode: Mode, motion: &Motion) -> Result<(), Reason> {
        self.check_mode(slave, mode)?;
        let has_outputs = matches!(self.volatile.roles[slave - 1], Role::Hsp(_));
        let two_channels = self.carries_two_channels(slave);
        let [first, second] = &mut self.axes[slave - 1];
        let mut follows = first.set_target(motion.first.target);
        if has_outputs {
            first.requested.out.outputs = motion.first.outputs;
        }
        if two_channels {
            follows &= second.set_target(motion.second.target);
            second.requested.out.outputs = motion.second.outputs;
        }
        if !follows {
            self.counters.discarded_before_enabled += 1;
            self.commanded.remove(slave as u8);
        }
        Ok(())
    }

    pub(super) fn execute_sdo(&mut self, slot: &RawSlot, at: Ns) {
        if slot.id == CommandId::GetStatus.code() {
            return;
        }
        let id = CommandId::from_code(slot.id);
        let done = self.admit(id, SlotKind::Sdo).and_then(|()| {
            let command = SdoCommand::decode(slot, self.config.slot).map_err(Reason::BadArgument)?;
            Ok(self.volatile.sdo.command(command, at))
        });
        match done {
            Ok(Accepted::Repeats) => self.counters.sdo_repeated += 1,
            Ok(Accepted::New) => {
                self.holds_mode_write(at);
            }
            Ok(Accepted::Replaces(id)) => self.reject(self.config.slot.sdo_slot(), id, Reason::SdoBusy, at),
            Err(reason) => self.reject(self.config.slot.sdo_slot(), id, reason, at),
        }
    }

    #[inline]
    pub(super) fn admit(&self, id: CommandId, slot: SlotKind) -> Result<(), Reason> {
        admit_in(self.network().state(), id, slot)
    }

    pub(super) fn reject(&mut self, slot: usize, id: CommandId, reason: Reason, at: Ns) {
        self.counters.rejected[reason.kind()] += 1;
        self.log.push(Event { at, kind: EventKind::Rejected(Rejection { slot: slot as u8, id, reason }) });
    }
}
