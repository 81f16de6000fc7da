//! Jobs that make SDO transfers: SDO_REQ, and the ends of PDO_CONFIG_SET and PDO_CONFIG_REQ.

use super::{JobResult, PartStart, Progress, SdoJob};
use crate::ethercat::coe::AbortCode;
use crate::xf::chip::Chip;
use crate::xf::chip::network::{Operation, OperationAnswer, SdoData, SlaveNetwork};

impl<N: SlaveNetwork> Chip<N> {
    pub(super) fn begin_sdo(&mut self, job: &SdoJob) -> PartStart {
        let (slave, object) = (job.slave, job.object);
        if let Some(code) = self.network.sdo_abort(slave, object) {
            return PartStart::Result(JobResult::Answer(OperationAnswer::Written(Err(code))));
        }
        let (scope, timeout_ns) = (job.scope, job.deadline - self.now);
        if job.writes {
            let value = SdoData::of(0, &job.data[..job.bytes]);
            return self.ask_for(Operation::Write { slave, object, scope, value, timeout_ns });
        }
        let most = self.sdo.data.len();
        let room = if job.bytes == 0 { most } else { job.bytes.min(most) };
        self.ask_for(Operation::Read { slave, object, scope, room, timeout_ns })
    }

    /// Ends SDO_REQ. If a slave does not answer within the timeout of SDO_REQ, the abort code is
    /// [`AbortCode::TIMEOUT`].
    ///
    /// `[OURS]` The abort code is kept until the next transfer, and is 0 after a successful one. A value that is longer than
    /// the number of bytes in the request is cut to that number; a request of 0 bytes gets as many as a data segment holds.
    pub(super) fn end_sdo(&mut self, job: &SdoJob, result: JobResult) -> Progress {
        let result = match result {
            JobResult::Answer(OperationAnswer::Value(value)) => value.map(|(value, _)| {
                self.sdo.data[..value.len()].copy_from_slice(&value);
                self.sdo.len = Some(value.len());
            }),
            JobResult::Answer(OperationAnswer::Written(result)) => result,
            _ => Err(AbortCode::TIMEOUT),
        };
        self.sdo.abort = match result {
            Err(AbortCode::TIMEOUT) if self.now < job.deadline => return Progress::Again(job.deadline),
            Err(abort) => abort,
            Ok(()) => AbortCode(0),
        };
        if result.is_err() && !job.writes {
            // After a failed read ECAT_SDO_GET returns no bytes, instead of the bytes of an earlier read.
            self.sdo.len = Some(0);
        }
        if result.is_ok() { Progress::Done } else { Progress::Failed }
    }

    /// Ends PDO_CONFIG_SET or PDO_CONFIG_REQ. `[OURS]` If it fails, ECAT_SDO_ABORTCODE_GET returns the abort code of the SDO
    /// transfer that failed.
    pub(super) fn end_pdo_transfer(&mut self, result: Result<(), AbortCode>) -> Progress {
        self.sdo.abort = result.err().unwrap_or(AbortCode(0));
        if result.is_ok() { Progress::Done } else { Progress::Failed }
    }
}
