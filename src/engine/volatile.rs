//! What a board forgets at SW_RESET: all that programs told it, but for the switches of SET_EX.

use super::axis::Axis;
use super::network::Network;
use super::restore::Restores;
use super::sdo::SdoSlot;
use super::{StateFailure, lost, test_mode};
use crate::cia402::Mode;
use crate::fieldbus::{MAX_AXES, MAX_SLAVES, Role, SlaveSet};
use crate::sk::{CommandId, CycleTime, DriveSync, Frame, SlaveKind};

/// The switches of SET_EX.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CrcSwitches {
    pub(super) check_commands: bool,
    pub(super) fill_responses: bool,
}

/// SK-1 \[OURS]: the factory setting.
pub(super) const FACTORY_CRC: CrcSwitches = CrcSwitches { check_commands: false, fill_responses: true };

/// What a slave's slot shows of the command executed last.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SlotHead {
    pub(super) id: u8,
    pub(super) index: u8,
    /// The command was IO_WR: Data1 of the answer is this output image.
    pub(super) output_image: Option<u16>,
}

impl SlotHead {
    /// The slave's outputs are off, whatever was written last.
    pub(super) fn outputs_off(&mut self) {
        self.output_image = self.output_image.map(|_| 0);
    }
}

/// What a board forgets at SW_RESET.
pub(super) struct Volatile {
    pub(super) switches: CrcSwitches,
    pub(super) kinds: [SlaveKind; MAX_SLAVES],
    pub(super) modes: [(Mode, DriveSync); MAX_SLAVES],
    pub(super) cycle: CycleTime,
    pub(super) network: Network,
    /// What went wrong last.
    pub(super) failure: Option<StateFailure>,
    /// Cycle, roles and synchronisation as they were configured on the way to SafeOP.
    pub(super) cycle_in_op: CycleTime,
    pub(super) roles: [Role; MAX_SLAVES],
    /// Pulse modules of two channels among them.
    pub(super) second_axes: SlaveSet,
    pub(super) syncs: [DriveSync; MAX_SLAVES],
    pub(super) answers_valid_from: lost::AnswersValidFrom,
    pub(super) test: test_mode::TestPhase,
    /// 0x6060 (0x6860) as the board or a host's SDO wrote it last.
    pub(super) modes_written: [[u8; MAX_AXES]; MAX_SLAVES],
    pub(super) axes: [[Axis; MAX_AXES]; MAX_SLAVES],
    pub(super) sdo: SdoSlot,
    /// Slaves with an axis that is homing, or not done with what follows; and perhaps some that have just been.
    pub(super) homing_active: SlaveSet,
    /// Modes that the board has to write back after homing.
    pub(super) restores: Restores,
    /// Byte 0 and bytes 4..7 of slot 0 outside OP.
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
            network: Network::default(),
            failure: None,
            cycle_in_op: CycleTime::DEFAULT,
            roles: [Role::Unused; MAX_SLAVES],
            second_axes: SlaveSet::EMPTY,
            syncs: [DriveSync::DcSync; MAX_SLAVES],
            answers_valid_from: [0; MAX_SLAVES],
            test: test_mode::TestPhase::default(),
            modes_written: [[0; MAX_AXES]; MAX_SLAVES],
            axes: [[Axis::default(); MAX_AXES]; MAX_SLAVES],
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
