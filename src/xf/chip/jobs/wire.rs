//! Jobs that do not use SDOs: sync managers, EEPROMs, datagrams, files, mailboxes.

use super::{DatagramJob, EepromJob, FileJob, JobResult, PartStart, Progress, done_if};
use crate::ethercat::coe::AbortCode;
use crate::ethercat::foe::FoeError;
use crate::ethercat::registers::{SmActivate, SmControl, SmDirection, SyncManager};
use crate::ethercat::{Addressing, Command};
use crate::xf::chip::Chip;
use crate::xf::chip::flash::Flash;
use crate::xf::chip::network::{EepromFailure, Operation, OperationAnswer, SlaveNetwork};
use crate::xf::chip::results::EepromResult;
use crate::xf::request::{ConfigSyncManager, EepromOperation};

/// Number of words that EEPROM_REQ reads: 8 bytes, as many as EEPROM_GET returns (OBS).
const EEPROM_WORDS: usize = 4;
/// The first sync manager for process data; lower ones are for the mailbox.
const PROCESS_MANAGERS: u8 = 2;

/// The error code that EEPROM_GET returns for a failure of EEPROM_REQ. `[OURS]` The manuals define only the code 0, and
/// only imply that it means success.
const fn eeprom_error(failure: EepromFailure) -> u8 {
    match failure {
        EepromFailure::NoAnswer => 1,
        EepromFailure::Busy => EEPROM_TIMED_OUT,
        EepromFailure::CommandRefused => 3,
    }
}

/// The error code that EEPROM_GET returns after a timeout of EEPROM_REQ. `[OURS]`
const EEPROM_TIMED_OUT: u8 = 2;

impl<N: SlaveNetwork> Chip<N> {
    /// Begins EEPROM_REQ. `[OURS]` A read that would go beyond the end of the EEPROM returns fewer words.
    pub(super) fn begin_eeprom(&mut self, job: &EepromJob) -> PartStart {
        let EepromJob { slave, position, operation, .. } = *job;
        let operation = match operation {
            EepromOperation::Read => {
                let behind = usize::from(u16::MAX - position) + 1;
                Operation::ReadEeprom { slave, word: position, count: EEPROM_WORDS.min(behind) }
            }
            EepromOperation::Write(value) => Operation::WriteEeprom { slave, word: position, value },
        };
        self.ask_for(operation)
    }

    pub(super) fn begin_datagram(&mut self, job: &DatagramJob) -> PartStart {
        let command = Command::from_code(job.operation.code());
        let address = match command.addressing() {
            Addressing::Logical => job.logical,
            _ => u32::from(job.adp) | u32::from(job.ado) << 16,
        };
        self.ask_for(Operation::Datagram { command, address, data: job.data[..job.bytes].to_vec() })
    }

    pub(super) fn begin_set_manager(&mut self, request: &ConfigSyncManager) -> PartStart {
        let registers = SyncManager {
            start: request.start,
            len: request.length,
            control: SmControl(request.control),
            activate: SmActivate(request.activate),
            ..SyncManager::default()
        };
        self.ask_for(Operation::SetManager { slave: request.slave.get(), number: request.number, registers })
    }

    /// Ends CONFIG_SM. `[OURS]` The sync manager is set at once, and again whenever the slave goes to PreOP or SafeOP.
    /// A sync manager for process data also sets the length of the slave's outputs or inputs, depending on the
    /// direction in its control byte. The length applies from the next layout of process data on; it is 0 if the sync
    /// manager is off.
    pub(super) fn end_set_manager(&mut self, request: &ConfigSyncManager, is_set: bool) -> Progress {
        if is_set && request.number >= PROCESS_MANAGERS {
            let is_on = SmActivate(request.activate).contains(SmActivate::ENABLE);
            let direction = match SmControl(request.control).direction() {
                SmDirection::Write => 0,
                _ => 1,
            };
            let length = if is_on { request.length } else { 0 };
            self.bus.lengths[usize::from(request.slave.get())].of_managers[direction] = Some(length);
        }
        done_if(is_set)
    }

    /// Ends EEPROM_REQ. `[OURS]` The result for EEPROM_GET is kept until the next EEPROM_REQ ends; after a write it has
    /// no data.
    pub(super) fn end_eeprom(&mut self, result: JobResult) -> Progress {
        let result = match result {
            JobResult::Answer(OperationAnswer::Eeprom(result)) => result.map_err(eeprom_error),
            _ => Err(EEPROM_TIMED_OUT),
        };
        self.results.eeprom = Some(match &result {
            Ok(words) => EepromResult::of(words),
            Err(error) => EepromResult::failed(*error),
        });
        done_if(result.is_ok())
    }

    /// Ends RAW_ECAT_FUNC_REQ. `[OURS]` A datagram that does not come back in time is a failure; its answer has the
    /// working counter -1.
    pub(super) fn end_datagram(&mut self, job: &DatagramJob, result: JobResult) -> Progress {
        let came = match result {
            JobResult::Answer(OperationAnswer::Datagram(came)) => came,
            _ => None,
        };
        let mut datagram = *job;
        if let Some((data, working_counter)) = &came {
            datagram.working_counter = (*working_counter).into();
            datagram.data[..data.len()].copy_from_slice(data);
        }
        self.results.datagram = Some(datagram);
        done_if(came.is_some())
    }

    pub(super) fn begin_file(&mut self, job: &FileJob) -> PartStart {
        let (slave, name, password, timeout_ns) = (job.slave, job.name.clone(), job.password, job.timeout_ns);
        self.ask_for(if job.downloads {
            // The slice is valid: `file_job` refuses a download that reaches beyond the memory.
            let content = self.flash.memory()[job.start as usize..][..job.bytes as usize].to_vec();
            Operation::WriteFile { slave, name, password, content, timeout_ns }
        } else {
            Operation::ReadFile { slave, name, password, timeout_ns }
        })
    }

    /// Ends a file transfer. `[OURS]` A file that is longer than FOE_FUNC_REQ says (0: any length), or that exceeds the flash
    /// memory, fails with the FoE error "disk full" and leaves the memory unchanged. A shorter file leaves the bytes after it
    /// unchanged. After the transfer ECAT_SDO_ABORTCODE_GET returns the FoE error code, the abort code of a timeout if the
    /// slave did not answer, or 0 for success.
    pub(super) fn end_file(&mut self, job: &FileJob, result: Result<Vec<u8>, u32>) -> Progress {
        let result = result.and_then(|content| {
            let is_as_said = job.bytes == 0 || content.len() <= job.bytes as usize;
            if job.downloads {
                Ok(())
            } else if is_as_said && Flash::has(job.start, content.len()) {
                self.flash.write(job.start, &content);
                Ok(())
            } else {
                Err(FoeError::DISK_FULL.0)
            }
        });
        self.sdo.abort = AbortCode(result.err().unwrap_or(0));
        done_if(result.is_ok())
    }

    /// Ends the request of RECV_MAILBOX. `[OURS]` An empty mailbox and a slave that does not answer are failures; an
    /// earlier message is kept.
    pub(super) fn end_mail(&mut self, mail: Option<Vec<u8>>) -> Progress {
        let has_come = mail.is_some();
        self.results.mail = mail.or_else(|| self.results.mail.take());
        done_if(has_come)
    }
}
