//! Commands for process data, through the FIFOs and directly.

use super::{CommandOutcome, CommandRefused, DONE};
use crate::xf::Errors;
use crate::xf::chip::Chip;
use crate::xf::chip::fifo::FIFO_ENTRIES_MAX;
use crate::xf::chip::network::SlaveNetwork;
use crate::xf::request::{Fifo, Fifos, PdoData, PdoDataFifo, PdoOperation};
use crate::xf::response::Returned;

impl<N: SlaveNetwork> Chip<N> {
    /// PDO_DATA_FIFO_OP: puts RxPDOs into the FIFO and takes TxPDOs out of it.
    ///
    /// `[OURS]` Nothing is done if process data are not configured, if `count` is 0, or if a write does not have
    /// exactly `count` RxPDOs as its data. In this case the answer says "failed", and the command error is set. RxPDOs
    /// beyond the free entries are lost: the FIFO error is set, and the answer says "failed" and not "written".
    pub(super) fn pdo_data_fifo(&mut self, request: &PdoDataFifo<'_>, data: &mut [u8]) -> Returned {
        let (writes, reads) = (has(request.operation, PdoOperation::WRITE), has(request.operation, PdoOperation::READ));
        let (count, rx_bytes) = (usize::from(request.count), usize::from(self.bus.rx_bytes));
        let is_right = count > 0 && (!writes || request.data.len() == count * rx_bytes);
        if !self.bus.mapped || !is_right {
            return self.failed();
        }
        let mut done = PdoOperation::NONE;
        if writes {
            let stored = (0..count).all(|i| self.fifos.push_rx(&request.data[i * rx_bytes..][..rx_bytes]));
            if !stored {
                self.raise(Errors::FIFO);
            }
            done = done | if stored { PdoOperation::WRITE } else { PdoOperation::FAILED };
        }
        let mut len = 0;
        if reads {
            for _ in 0..count {
                if !self.fifos.pop_tx(&mut data[len..]) {
                    break;
                }
                done = done | PdoOperation::READ;
                len += usize::from(self.bus.tx_bytes);
            }
        }
        Returned { ret: done.0, len: len as u16 }
    }

    /// PDO_DATA_OP: writes outputs and reads inputs without the FIFOs. The RxPDO is sent from the next cycle on; the
    /// newest TxPDO is read.
    ///
    /// Bit 2 of the operation, "bits are valid", says that its bits 0 and 1 select writing and reading. Bit 2 is
    /// repeated in the return byte, because the vendor's driver accepts inputs only with it (OBS).
    ///
    /// `[OURS]` Without bit 2, a request with data writes, and every request reads. A wrong length fails as in
    /// [`Self::pdo_data_fifo`], without bit 2 in the return byte.
    pub(super) fn pdo_data(&mut self, request: &PdoData<'_>, data: &mut [u8]) -> Returned {
        let is_chosen = has(request.operation, PdoOperation::VALID);
        let writes = if is_chosen { has(request.operation, PdoOperation::WRITE) } else { !request.data.is_empty() };
        let reads = !is_chosen || has(request.operation, PdoOperation::READ);
        let (rx_bytes, tx_bytes) = (usize::from(self.bus.rx_bytes), usize::from(self.bus.tx_bytes));
        let is_right = (!writes || request.data.len() == rx_bytes) && (!reads || tx_bytes <= data.len());
        if !self.bus.mapped || !is_right {
            return self.failed();
        }
        let mut returned = Returned { ret: request.operation.0 & PdoOperation::VALID.0, len: 0 };
        if writes {
            self.bus.outputs[..rx_bytes].copy_from_slice(request.data);
            returned.ret |= PdoOperation::WRITE.0;
        }
        if reads {
            data[..tx_bytes].copy_from_slice(&self.bus.inputs[..tx_bytes]);
            returned.ret |= PdoOperation::READ.0;
            returned.len = self.bus.tx_bytes;
        }
        returned
    }

    fn failed(&mut self) -> Returned {
        self.raise(Errors::COMMAND);
        Returned { ret: PdoOperation::FAILED.0, len: 0 }
    }

    pub(super) const fn pdo_bytes(&self, fifo: Fifo) -> u16 {
        match fifo {
            Fifo::Rx => self.bus.rx_bytes,
            Fifo::Tx => self.bus.tx_bytes,
        }
    }

    pub(super) const fn clear_fifos(&mut self, fifos: Fifos) -> CommandOutcome {
        if matches!(fifos, Fifos::Both | Fifos::Rx) {
            self.fifos.clear_rx();
        }
        if matches!(fifos, Fifos::Both | Fifos::Tx) {
            self.fifos.clear_tx();
        }
        DONE
    }

    /// Sets the capacity of a FIFO, which applies from the next FIFO_INIT or layout of process data on. `[OURS]` 0 and
    /// more than 128 are refused.
    pub(super) fn set_entries(entries: &mut u8, wanted: u8) -> CommandOutcome {
        if !(1..=FIFO_ENTRIES_MAX).contains(&wanted) {
            return Err(CommandRefused);
        }
        *entries = wanted;
        DONE
    }
}

const fn has(operation: PdoOperation, bit: PdoOperation) -> bool {
    operation.contains(bit)
}
