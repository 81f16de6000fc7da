//! Commands that take time: one at a time, each ends with its effect or with an error.

mod network;
mod transfers;

use super::Chip;
use super::network::Network;
use crate::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::xf::request::{DcSync, EcatInit, FlashBytes, PdoConfig, PdoConfigRequest, SDO_DATA_MAX, Slaves};
use crate::xf::{DataSize, Errors};

/// What runs.
#[allow(clippy::large_enum_variant, reason = "there is one, and boxing it would allocate")]
pub(super) enum Job {
    Init(EcatInit),
    /// RECONFIG_OP and CONFIG_MAP.
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
}

pub(super) struct SdoJob {
    pub slave: u8,
    pub object: ObjectAddress,
    pub scope: SdoScope,
    pub deadline: Ns,
    /// Bytes to read, or of `data` to write.
    pub bytes: usize,
    pub writes: bool,
    pub data: [u8; SDO_DATA_MAX],
}

#[derive(Clone, Copy)]
pub(super) struct StateJob {
    pub slaves: Slaves,
    /// `None`: Boot, which no slave here knows.
    pub target: Option<AlState>,
    /// All states are read at the end: ECAT_STATE_CHECK.
    pub updates: bool,
}

/// A job under way.
pub(super) struct Running {
    pub job: Job,
    /// When it ends, or a part of it.
    pub due: Ns,
}

impl Running {
    /// An initialisation, which begins when the network port is ready.
    pub const fn waits_for_port(&self) -> bool {
        matches!(self.job, Job::Init(_))
    }
}

/// How a part of a job ends.
pub(super) enum Progress {
    Done,
    /// Another part follows, which ends then.
    Next(Ns),
    Failed,
}

/// What SDO_REQ has read, and why the last transfer failed.
pub(super) struct SdoResult {
    pub data: [u8; DataSize::MAX.bytes()],
    /// Bytes read; `None`: nothing was.
    pub len: Option<usize>,
    /// 0: it did not fail.
    pub abort: AbortCode,
}

impl SdoResult {
    pub const fn new() -> Self {
        Self { data: [0; DataSize::MAX.bytes()], len: None, abort: AbortCode(0) }
    }
}

impl<N: Network> Chip<N> {
    /// Starts a job if none runs. False: one does.
    pub(super) fn start_job(&mut self, job: Job) -> bool {
        if self.job.is_some() {
            return false;
        }
        let due = self.now.saturating_add(self.first_part_ns(&job));
        self.job = Some(Running { job, due });
        true
    }

    /// How long the first part of a job takes from now on.
    fn first_part_ns(&self, job: &Job) -> Ns {
        let timing = &self.timing;
        let count = Ns::from(self.bus.count);
        match job {
            Job::Init(_) => self.port_ready_at.saturating_sub(self.now) + timing.init_ns,
            Job::Map => timing.reconfig_ns + timing.slave_ns * count,
            Job::InitDc | Job::DcSync(_) => timing.dc_ns,
            Job::PdoConfigSet(_) | Job::PdoConfigRequest(_) => timing.pdo_config_ns,
            Job::Sdo(sdo) => {
                let takes = timing.sdo_ns.saturating_add(self.network.sdo_delay_ns(sdo.slave));
                takes.min(sdo.deadline.saturating_sub(self.now))
            }
            Job::State(state) => self.next_change_ns(state),
            Job::StateUpdate => timing.update_ns,
            Job::FifoInit => timing.fifo_init_ns,
            Job::ReadFlash { .. } | Job::WriteFlash { .. } => timing.flash_ns,
        }
    }

    /// A part of the job under way ends now.
    pub(super) fn end_job(&mut self) {
        let Some(Running { mut job, .. }) = self.job.take() else { return };
        match self.end_part(&mut job) {
            Progress::Done => {}
            Progress::Next(due) => self.job = Some(Running { job, due: due.max(self.now + 1) }),
            Progress::Failed => self.errors = self.errors | Errors::NON_IMMEDIATE,
        }
    }

    fn end_part(&mut self, job: &mut Job) -> Progress {
        match job {
            Job::Init(init) => self.end_init(init),
            Job::Map => self.end_map(),
            Job::InitDc => self.end_init_dc(),
            Job::DcSync(dc_sync) => self.end_dc_sync(dc_sync),
            Job::PdoConfigSet(config) => self.end_pdo_config_set(config),
            Job::PdoConfigRequest(request) => self.end_pdo_config_request(request),
            Job::Sdo(sdo) => self.end_sdo(sdo),
            Job::State(state) => self.end_change(state),
            Job::StateUpdate => {
                self.update_states();
                Progress::Done
            }
            Job::FifoInit => {
                if self.build_fifos() {
                    Progress::Done
                } else {
                    Progress::Failed
                }
            }
            Job::ReadFlash { start, bytes } => {
                self.flash.read(*start, *bytes);
                Progress::Done
            }
            Job::WriteFlash { start, bytes, data } => {
                self.flash.write(*start, &data[..usize::from(*bytes)]);
                Progress::Done
            }
        }
    }

    /// Builds the FIFOs for the present process data. False: they are too long. `[OURS]` That is a FIFO error.
    pub(super) fn build_fifos(&mut self) -> bool {
        let fits = self.fifos.build(self.bus.rx_bytes, self.bus.tx_bytes);
        if !fits {
            self.errors = self.errors | Errors::FIFO;
        }
        fits
    }

    fn update_states(&mut self) {
        for slave in self.bus.slaves() {
            self.bus.update(&self.network, slave);
        }
    }

    fn note_refusal(&mut self, slave: u8, status: AlStatus) {
        self.bus.known[usize::from(slave)].al_status = status.0;
    }
}
