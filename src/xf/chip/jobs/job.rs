//! The kinds of jobs, with their arguments.

use crate::ethercat::coe::{ObjectAddress, SdoScope};
use crate::ethercat::{AlState, Ns};
use crate::xf::request::{
    ConfigSyncManager, DcSync, EcatInit, EepromOperation, FlashBytes, PdoConfig, PdoConfigRequest, RAW_DATA_MAX,
    RawOperation, SDO_DATA_MAX, Slaves,
};

/// A job: a command that takes time, with its arguments.
#[allow(clippy::large_enum_variant, reason = "there is one, and boxing it would allocate")]
pub(in crate::xf::chip) enum Job {
    Init(EcatInit),
    /// ECAT_RECONFIG_OP or CONFIG_MAP, which lay out the process data.
    Map,
    InitDc,
    DcSync(DcSync),
    PdoConfigSet(PdoConfig),
    PdoConfigRequest(PdoConfigRequest),
    Sdo(SdoJob),
    State(StateJob),
    StateUpdate,
    FifoInit,
    ReadFlash {
        start: u32,
        bytes: u16,
    },
    WriteFlash {
        start: u32,
        bytes: u16,
        data: [u8; FlashBytes::MAX.get() as usize],
    },
    File(FileJob),
    SetManager(ConfigSyncManager),
    /// CONFIG_FMMU, which has no effect, since the chip sets the FMMUs itself.
    SetFmmus,
    Eeprom(EepromJob),
    Datagram(DatagramJob),
    ReceiveMail {
        slave: u8,
    },
}

pub(in crate::xf::chip) struct SdoJob {
    pub slave: u8,
    pub object: ObjectAddress,
    pub scope: SdoScope,
    pub deadline: Ns,
    /// The number of bytes to read, or to write from `data`.
    pub bytes: usize,
    pub writes: bool,
    pub data: [u8; SDO_DATA_MAX],
}

#[derive(Clone, Copy)]
pub(in crate::xf::chip) struct StateJob {
    pub slaves: Slaves,
    /// The target state; `None` for Boot, which no simulated slave supports.
    pub target: Option<AlState>,
    /// Whether all states are read at the end: true for ECAT_STATE_CHECK, false for ECAT_STATE_SET.
    pub updates: bool,
    /// Whether a slave does not answer or cannot be set up in the present step of the change of state.
    pub has_failed: bool,
}

/// The transfer of a file between a slave and the flash memory.
pub(in crate::xf::chip) struct FileJob {
    pub slave: u8,
    pub name: Vec<u8>,
    pub password: u32,
    pub start: u32,
    /// The length of a file that is written to the slave, or the maximum length of a file that is read from it, where 0
    /// means any length.
    pub bytes: u32,
    pub timeout_ns: Ns,
    /// Whether the file is written to the slave; otherwise it is read.
    pub downloads: bool,
}

#[derive(Clone, Copy)]
pub(in crate::xf::chip) struct EepromJob {
    pub slave: u8,
    pub position: u16,
    pub operation: EepromOperation,
    pub deadline: Ns,
}

/// A datagram that the host sends by RAW_ECAT_FUNC_REQ. The copy for RAW_ECAT_FUNC_GET has the working counter and the data
/// with which the datagram has come back.
#[derive(Clone, Copy)]
pub(in crate::xf::chip) struct DatagramJob {
    pub operation: RawOperation,
    pub adp: u16,
    pub ado: u16,
    pub logical: u32,
    pub timeout_us: i32,
    pub deadline: Ns,
    /// The working counter; -1 if the datagram did not come back.
    pub working_counter: i32,
    pub bytes: usize,
    pub data: [u8; RAW_DATA_MAX],
}

impl Job {
    /// The time at which the timeout in the host's command ends; `None` for a command without a timeout.
    pub(super) const fn deadline(&self) -> Option<Ns> {
        match self {
            Self::Sdo(job) => Some(job.deadline),
            Self::Eeprom(job) => Some(job.deadline),
            Self::Datagram(job) => Some(job.deadline),
            _ => None,
        }
    }
}
