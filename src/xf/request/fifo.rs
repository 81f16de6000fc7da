//! The FIFOs of process data: the RxFIFO holds RxPDOs that the chip sends, one a cycle, the TxFIFO the TxPDOs it
//! received.

use super::{Arguments, Switch, plain, short};
use crate::xf::value::choices;

/// The entries of each FIFO after a start (XF EN 1236).
pub const FIFO_ENTRIES: u8 = 64;

plain! {
    /// FIFO_GET_TX_CNT, code 53: the entries of the TxFIFO as set, in `ret` (XF EN 1249).
    FifoGetTxCount, FifoGetTxCount -> u8;
    /// FIFO_GET_RX_CNT, code 55: the entries of the RxFIFO as set, in `ret` (XF EN 1273).
    FifoGetRxCount, FifoGetRxCount -> u8;
    /// FIFO_INIT, code 66: builds the FIFOs from their entries and the sizes of the PDOs; 0x4000 bytes together at most
    /// (XF EN 1345).
    FifoInit, FifoInit -> ();
}

short! {
    /// FIFO_ENABLE, code 18: whether the RxFIFO is put out in each cycle. `par` the switch (XF EN 674).
    FifoEnable {
        /// It is put out.
        pub on: bool,
    }, FifoEnable -> (),
        |request| Arguments::NONE.parameter(request.on.into()),
        |a| Self { on: Switch::decode(a.parameter)? == Switch::On };

    /// FIFO_PACK_SIZE_GET, code 19: the bytes of one PDO, that is of one entry. `par` which; the answer @0 u16
    /// (XF EN 685).
    FifoPackSizeGet {
        /// Of which FIFO.
        pub fifo: Fifo,
    }, FifoPackSizeGet -> u16,
        |request| Arguments::NONE.parameter(request.fifo.code()),
        |a| Self { fifo: Fifo::decode(a.parameter)? };

    /// FIFO_CLR_OP, code 51: empties FIFOs. `par` which (XF EN 1224).
    FifoClear {
        /// Which FIFOs.
        pub fifos: Fifos,
    }, FifoClear -> (),
        |request| Arguments::NONE.parameter(request.fifos.code()),
        |a| Self { fifos: Fifos::decode(a.parameter)? };

    /// FIFO_SET_TX_CNT, code 52: the entries of the TxFIFO, 64 at first; when it is full the oldest is lost. `par`
    /// entries (XF EN 1236).
    FifoSetTxCount {
        /// Entries.
        pub entries: u8,
    }, FifoSetTxCount -> (),
        |request| Arguments::NONE.parameter(request.entries),
        |a| Self { entries: a.parameter };

    /// FIFO_SET_RX_CNT, code 54: the entries of the RxFIFO, 64 at first; when it is full the new one is lost. `par`
    /// entries (XF EN 1262).
    FifoSetRxCount {
        /// Entries.
        pub entries: u8,
    }, FifoSetRxCount -> (),
        |request| Arguments::NONE.parameter(request.entries),
        |a| Self { entries: a.parameter };

    /// ECAT_SET_FIFO_TH, code 70: limits at which the FIFOs raise an interrupt. `par` bit 0 TxFIFO high on, bit 1
    /// RxFIFO low on; `i0` limit of the TxFIFO, `i1` of the RxFIFO (XF EN 1374).
    FifoThresholdSet {
        /// The interrupt comes when the TxFIFO rises to so many entries.
        pub tx_high: Option<u8>,
        /// The interrupt comes when the RxFIFO falls to so many entries.
        pub rx_low: Option<u8>,
    }, FifoThresholdSet -> (),
        |request| {
            let on = u8::from(request.tx_high.is_some()) | u8::from(request.rx_low.is_some()) << 1;
            let limits = [request.tx_high.unwrap_or(0), request.rx_low.unwrap_or(0), 0, 0];
            Arguments::NONE.parameter(on).info(limits)
        },
        |a| Self {
            tx_high: (a.parameter & 1 != 0).then_some(a.info[0]),
            rx_low: (a.parameter & 2 != 0).then_some(a.info[1]),
        };
}

choices! {
    /// One of the FIFOs, in [`FifoPackSizeGet`].
    pub Fifo(u8), "FIFO_PACK_SIZE_GET FIFO", "0 RxPDO, 1 TxPDO" {
        /// 0: the RxFIFO.
        Rx = 0,
        /// 1: the TxFIFO.
        Tx = 1,
    }

    /// Which FIFOs are emptied, in [`FifoClear`].
    pub Fifos(u8), "FIFO_CLR_OP FIFOs", "0 both, 1 TxFIFO, 2 RxFIFO" {
        /// 0: both.
        Both = 0,
        /// 1: the TxFIFO.
        Tx = 1,
        /// 2: the RxFIFO.
        Rx = 2,
    }
}
