//! The part of a board's state that SW_RESET resets: everything that programs have set, except the CRC switches of
//! SET_EX.

use super::network::Network;
use super::restore::Restores;
use super::sdo::SdoSlot;
use super::{StateFailure, test_mode};
use crate::ethercat::cia402::Mode;
use crate::fieldbus::{MAX_AXES, MAX_SLAVES, Ns, Role, SlaveSet};
use crate::sk::{CommandId, CycleTime, DriveSync, Frame, SlaveKind};

/// For each slave, the board time from which on inputs of a cycle are certainly newer than the slave's last change of
/// state. A bus that queues may deliver inputs from before the change, which do not show whether the slave is in the
/// new state.
pub(super) type AnswersValidFrom = [Ns; MAX_SLAVES];

/// The two switches that SET_EX sets: whether the board checks the CRC of command frames, and whether it fills in the
/// CRC of responses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CrcSwitches {
    pub(super) check_commands: bool,
    pub(super) fill_responses: bool,
}

/// The CRC switches of a board as delivered, before the first SET_EX: it checks no command frames and fills the CRC of
/// reports. SK-1 \[OURS].
pub(super) const FACTORY_CRC: CrcSwitches = CrcSwitches { check_commands: false, fill_responses: true };

/// The part of a slave's slot in a report that shows the command executed last: id, index and, after IO_WR, the
/// outputs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SlotHead {
    pub(super) id: u8,
    pub(super) index: u8,
    /// After IO_WR: the output image that Data1 of the answer shows; `None` after any other command.
    pub(super) output_image: Option<u16>,
}

impl SlotHead {
    /// Called when the outputs of the slave are off since it has left OP or is lost. The answer to its last IO_WR then
    /// shows 0, which is what the terminals have, instead of the outputs that were written.
    pub(super) fn outputs_off(&mut self) {
        self.output_image = self.output_image.map(|_| 0);
    }
}

/// The part of a board's state that SW_RESET resets.
pub(super) struct Volatile {
    pub(super) switches: CrcSwitches,
    pub(super) kinds: [SlaveKind; MAX_SLAVES],
    pub(super) modes: [(Mode, DriveSync); MAX_SLAVES],
    pub(super) cycle: CycleTime,
    /// Whether SET_AXIS, DRIVE_MODE or SET_DC came since the boot. Only then the bus gets a configuration to prepare.
    pub(super) has_declared: bool,
    /// The board time at which the engine gives the bus the declared configuration to prepare, some time after the last
    /// declaring command, as programs send several in a row. `None`: nothing to prepare is pending.
    pub(super) told_at: Option<Ns>,
    pub(super) network: Network,
    /// Why the newest change of state failed, or which slave was lost since. `None`: no failure.
    pub(super) failure: Option<StateFailure>,
    /// The cycle time in force: the last change to SafeOP has configured it. [`Self::roles`] and [`Self::syncs`] are in
    /// force since the same change.
    pub(super) cycle_in_op: CycleTime,
    pub(super) roles: [Role; MAX_SLAVES],
    /// The pulse modules that have a second axis.
    pub(super) second_axes: SlaveSet,
    pub(super) syncs: [DriveSync; MAX_SLAVES],
    pub(super) answers_valid_from: AnswersValidFrom,
    /// After a failed change of state, inputs of cycles from this board time on show in which states the change has
    /// left the slaves. The next step waits for such inputs. `None`: nothing to wait for.
    pub(super) left_shown_from: Option<Ns>,
    pub(super) test: test_mode::TestPhase,
    /// For each axis the mode that the board or an SDO of the host has written last to 0x6060 (0x6860).
    pub(super) modes_written: [[u8; MAX_AXES]; MAX_SLAVES],
    pub(super) sdo: SdoSlot,
    /// The slaves with an axis that is homing, or that has not finished the steps after it. A slave that has just
    /// finished stays in the set until its next inputs are evaluated.
    pub(super) homing_active: SlaveSet,
    /// The modes of operation that the board has to restore after homing.
    pub(super) restores: Restores,
    /// Byte 0 (the id of the last command) and bytes 4..7 (its result) of slot 0 in reports outside OP.
    pub(super) master_id: CommandId,
    pub(super) master_result: u32,
    pub(super) crc_errors: u8,
    pub(super) local_outputs: u8,
    pub(super) heads: [SlotHead; MAX_SLAVES],
    pub(super) response: Frame,
}

impl Volatile {
    pub(super) fn new(switches: CrcSwitches) -> Self {
        Self {
            switches,
            kinds: [SlaveKind::default(); MAX_SLAVES],
            modes: [(Mode::Csp, DriveSync::DcSync); MAX_SLAVES],
            cycle: CycleTime::DEFAULT,
            has_declared: false,
            told_at: None,
            network: Network::default(),
            failure: None,
            cycle_in_op: CycleTime::DEFAULT,
            roles: [Role::Unused; MAX_SLAVES],
            second_axes: SlaveSet::EMPTY,
            syncs: [DriveSync::DcSync; MAX_SLAVES],
            answers_valid_from: [0; MAX_SLAVES],
            left_shown_from: None,
            test: test_mode::TestPhase::default(),
            modes_written: [[0; MAX_AXES]; MAX_SLAVES],
            sdo: SdoSlot::new(),
            homing_active: SlaveSet::EMPTY,
            restores: Restores::new(),
            master_id: CommandId::GetStatus,
            master_result: 0,
            crc_errors: 0,
            local_outputs: 0,
            heads: [SlotHead::default(); MAX_SLAVES],
            response: Frame::new(),
        }
    }
}
