//! Runs commands that the program knows only at run time.

use super::{Xf, XfError};
use crate::link::chip_link::ChipLink;
use crate::xf::host::ProcessRequest;
use crate::xf::request::{Call, PdoData, PdoDataFifo, PdoOperation, Visit};
use crate::xf::response::{Answer, PdoExchange, Returned};
use crate::xf::{Allowed, Malformed, Request};

/// A visitor that runs a request and writes its answer into a data segment.
struct Run<'x, 'b, L: ChipLink> {
    xf: &'x mut Xf<L>,
    data: &'b mut [u8],
}

impl<L: ChipLink> Visit for Run<'_, '_, L> {
    type Output = Result<Returned, XfError>;

    fn call<'d, C: Call<'d>>(self, call: &C) -> Self::Output {
        let answer = self.xf.run(call)?;
        self.data.fill(0);
        Ok(answer.encode(self.data)?)
    }
}

impl<L: ChipLink> Xf<L> {
    /// Runs any request to its end, and writes its answer into `data` in the layout of a data segment, at most 1408
    /// bytes. With [`FunctionFields`](crate::xf::fields::FunctionFields) a program reads the fields of this answer.
    ///
    /// PDO_DATA_FIFO_OP and PDO_DATA_OP do not wait in a queue of commands: they are sent like the process data of
    /// [`Self::cycle`]. The driver supports five of their operations. Through the FIFO: write, read, or both. Directly,
    /// without the FIFO: read, or write and read together. The layout of their answers is that of the manuals.
    ///
    /// # Errors
    /// As with [`Self::run`]; CRC_TYPE_SET and SPI_RECONFIG_OP are refused, since the driver sends them itself.
    pub fn run_request(&mut self, request: &Request<'_>, data: &mut [u8]) -> Result<Returned, XfError> {
        match request {
            Request::PdoDataFifo(request) => self.run_process(through_fifo(request)?, data),
            Request::PdoData(request) => self.run_process(past_fifo(request)?, data),
            _ => request.visit(Run { xf: self, data }).unwrap_or_else(|| {
                let (field, found) = ("command code", request.code().code().into());
                Err(Malformed { field, found, allowed: Allowed::Only("one of the manuals") }.into())
            }),
        }
    }

    fn run_process(&mut self, exchanged: ProcessRequest<'_>, data: &mut [u8]) -> Result<Returned, XfError> {
        let written = match exchanged {
            ProcessRequest::Read { .. } | ProcessRequest::DirectRead => PdoOperation::NONE,
            _ => PdoOperation::WRITE,
        };
        let read = self.exchange_raw(exchanged)?;
        let (done, inputs) = if read { (written | PdoOperation::READ, self.host.inputs()) } else { (written, &[][..]) };
        data.fill(0);
        Ok(PdoExchange { done, data: inputs }.encode(data)?)
    }
}

fn through_fifo<'d>(request: &PdoDataFifo<'d>) -> Result<ProcessRequest<'d>, Malformed> {
    let PdoDataFifo { count, operation, data: outputs } = *request;
    match (operation.contains(PdoOperation::WRITE), operation.contains(PdoOperation::READ)) {
        (true, true) => Ok(ProcessRequest::Exchange { count, outputs }),
        (true, false) => Ok(ProcessRequest::Write { count, outputs }),
        (false, true) => Ok(ProcessRequest::Read { count }),
        (false, false) => Err(without_operation("PDO_DATA_FIFO_OP operation", operation)),
    }
}

fn past_fifo<'d>(request: &PdoData<'d>) -> Result<ProcessRequest<'d>, Malformed> {
    let PdoData { operation, data: outputs } = *request;
    // Without the bit "valid" the chip writes and reads.
    match (operation.contains(PdoOperation::VALID), operation.contains(PdoOperation::WRITE)) {
        (false, _) | (true, true) => Ok(ProcessRequest::DirectExchange { outputs }),
        (true, false) if operation.contains(PdoOperation::READ) => Ok(ProcessRequest::DirectRead),
        (true, false) => Err(without_operation("PDO_DATA_OP operation", operation)),
    }
}

fn without_operation(field: &'static str, operation: PdoOperation) -> Malformed {
    Malformed { field, found: operation.0.into(), allowed: Allowed::Only("write, read or both") }
}
