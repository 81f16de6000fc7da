//! The FIFOs of process data: the RxFIFO holds RxPDOs that the chip sends, one a cycle, the TxFIFO the TxPDOs it
//! received.

use crate::xf::Malformed;
use crate::xf::layout::{FieldList, Layout, Reader, Spot, Writer, info, layout, par};
use crate::xf::value::choices;

/// The entries of each FIFO after a start (XF EN 1236).
pub const FIFO_ENTRIES: u8 = 64;

layout! {
    /// FIFO_GET_TX_CNT, code 53: the entries of the TxFIFO as set, in `ret` (XF EN 1249).
    pub struct FifoGetTxCount;

    /// FIFO_GET_RX_CNT, code 55: the entries of the RxFIFO as set, in `ret` (XF EN 1273).
    pub struct FifoGetRxCount;

    /// FIFO_INIT, code 66: builds the FIFOs from their entries and the sizes of the PDOs; 0x4000 bytes together at most
    /// (XF EN 1345).
    pub struct FifoInit;

    /// FIFO_ENABLE, code 18: whether the RxFIFO is put out in each cycle. `par` the switch (XF EN 674).
    pub struct FifoEnable {
        /// It is put out.
        pub on: bool = par(),
    }

    /// FIFO_PACK_SIZE_GET, code 19: the bytes of one PDO, that is of one entry. `par` which; the answer @0 u16
    /// (XF EN 685).
    pub struct FifoPackSizeGet {
        /// Of which FIFO.
        pub fifo: Fifo = par(),
    }

    /// FIFO_CLR_OP, code 51: empties FIFOs. `par` which (XF EN 1224).
    pub struct FifoClear {
        /// Which FIFOs.
        pub fifos: Fifos = par(),
    }

    /// FIFO_SET_TX_CNT, code 52: the entries of the TxFIFO, 64 at first; when it is full the oldest is lost. `par`
    /// entries (XF EN 1236).
    pub struct FifoSetTxCount {
        /// Entries.
        pub entries: u8 = par(),
    }

    /// FIFO_SET_RX_CNT, code 54: the entries of the RxFIFO, 64 at first; when it is full the new one is lost. `par`
    /// entries (XF EN 1262).
    pub struct FifoSetRxCount {
        /// Entries.
        pub entries: u8 = par(),
    }
}

/// ECAT_SET_FIFO_TH, code 70: limits at which the FIFOs raise an interrupt. `par` bit 0 TxFIFO high on, bit 1
/// RxFIFO low on; `i0` limit of the TxFIFO, `i1` of the RxFIFO (XF EN 1374).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FifoThresholdSet {
    /// The interrupt comes when the TxFIFO rises to so many entries.
    pub tx_high: Option<u8>,
    /// The interrupt comes when the RxFIFO falls to so many entries.
    pub rx_low: Option<u8>,
}

impl FifoThresholdSet {
    const ON: Spot = par().bits(&[("tx_high", 1), ("rx_low", 2)]).of::<u8>("on");
    const TX_HIGH: Spot = info(0).or(0).of::<u8>("tx_high");
    const RX_LOW: Spot = info(1).or(0).of::<u8>("rx_low");
}

impl Layout<'_> for FifoThresholdSet {
    const FIELDS: FieldList =
        FieldList::of(Self::ON).and(FieldList::of(Self::TX_HIGH)).and(FieldList::of(Self::RX_LOW));

    fn put(&self, to: &mut Writer<'_>) -> Result<(), Malformed> {
        let on = u8::from(self.tx_high.is_some()) | u8::from(self.rx_low.is_some()) << 1;
        Self::ON.put(&on, to)?;
        Self::TX_HIGH.put(&self.tx_high.unwrap_or(0), to)?;
        Self::RX_LOW.put(&self.rx_low.unwrap_or(0), to)
    }

    fn take(from: &Reader<'_>) -> Result<Self, Malformed> {
        let on: u8 = Self::ON.take(from)?;
        let (tx_high, rx_low) = (Self::TX_HIGH.take(from)?, Self::RX_LOW.take(from)?);
        Ok(Self { tx_high: (on & 1 != 0).then_some(tx_high), rx_low: (on & 2 != 0).then_some(rx_low) })
    }
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
