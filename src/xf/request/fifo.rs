//! Requests for the FIFOs of process data. The RxFIFO holds RxPDOs, of which the chip sends one per cycle; the TxFIFO
//! holds the TxPDOs that the chip has received.

use crate::xf::Malformed;
use crate::xf::layout::{FieldDecl, FieldLayout, FieldList, FieldReader, FieldWriter, info, layout, par};
use crate::xf::value::choices;

/// Number of entries of each FIFO after the chip's start (XF EN 1236).
pub const FIFO_ENTRIES: u8 = 64;

layout! {
    /// FIFO_GET_TX_CNT, command code 53: reads the capacity of the TxFIFO from the return byte, in entries
    /// (XF EN 1249).
    pub struct FifoGetTxCount;

    /// FIFO_GET_RX_CNT, command code 55: reads the capacity of the RxFIFO from the return byte, in entries
    /// (XF EN 1273).
    pub struct FifoGetRxCount;

    /// FIFO_INIT, command code 66: allocates the FIFOs from their capacities and the sizes of the PDOs, together at
    /// most 0x4000 bytes (XF EN 1345).
    pub struct FifoInit;

    /// FIFO_ENABLE, command code 18: switches on or off that the chip takes an RxPDO out of the RxFIFO in each cycle.
    /// The parameter byte is 1 for on, 0 for off (XF EN 674).
    pub struct FifoEnable {
        /// Whether the chip takes an RxPDO out of the RxFIFO in each cycle.
        pub on: bool = par(),
    }

    /// FIFO_PACK_SIZE_GET, command code 19: reads the size of one PDO, which is one entry of a FIFO. The parameter byte
    /// selects the FIFO (XF EN 685). Answer: u16 at byte 0 of the data, in bytes.
    pub struct FifoPackSizeGet {
        /// The FIFO whose entry size is read.
        pub fifo: Fifo = par(),
    }

    /// FIFO_CLR_OP, command code 51: empties FIFOs. The parameter byte selects them (XF EN 1224).
    pub struct FifoClear {
        /// The FIFOs to empty.
        pub fifos: Fifos = par(),
    }

    /// FIFO_SET_TX_CNT, command code 52: sets the capacity that the TxFIFO has from the next [`FifoInit`] on; it is 64
    /// entries at power-on. A full TxFIFO loses its oldest entry. The parameter byte is the number of entries
    /// (XF EN 1236).
    pub struct FifoSetTxCount {
        /// The new capacity of the TxFIFO in entries.
        pub entries: u8 = par(),
    }

    /// FIFO_SET_RX_CNT, command code 54: sets the capacity that the RxFIFO has from the next [`FifoInit`] on; it is 64
    /// entries at power-on. A full RxFIFO loses the new entry. The parameter byte is the number of entries
    /// (XF EN 1262).
    pub struct FifoSetRxCount {
        /// The new capacity of the RxFIFO in entries.
        pub entries: u8 = par(),
    }
}

/// ECAT_SET_FIFO_TH, command code 70: sets the FIFO levels that raise an interrupt (XF EN 1374). Parameter byte: bit 0
/// enables the interrupt of the TxFIFO, bit 1 the interrupt of the RxFIFO; information bytes: `i0` level of the TxFIFO,
/// `i1` level of the RxFIFO.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FifoThresholdSet {
    /// The level that raises an interrupt when the TxFIFO rises to it; `None` for no interrupt.
    pub tx_high: Option<u8>,
    /// The level that raises an interrupt when the RxFIFO falls to it; `None` for no interrupt.
    pub rx_low: Option<u8>,
}

impl FifoThresholdSet {
    const ON: FieldDecl = par().bits(&[("tx_high", 1), ("rx_low", 2)]).of::<u8>("on");
    const TX_HIGH: FieldDecl = info(0).or(0).of::<u8>("tx_high");
    const RX_LOW: FieldDecl = info(1).or(0).of::<u8>("rx_low");
}

impl FieldLayout<'_> for FifoThresholdSet {
    const FIELDS: FieldList =
        FieldList::of(Self::ON).and(FieldList::of(Self::TX_HIGH)).and(FieldList::of(Self::RX_LOW));

    fn put(&self, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        let on = u8::from(self.tx_high.is_some()) | u8::from(self.rx_low.is_some()) << 1;
        Self::ON.put(&on, to)?;
        Self::TX_HIGH.put(&self.tx_high.unwrap_or(0), to)?;
        Self::RX_LOW.put(&self.rx_low.unwrap_or(0), to)
    }

    fn take(from: &FieldReader<'_>) -> Result<Self, Malformed> {
        let on: u8 = Self::ON.take(from)?;
        let (tx_high, rx_low) = (Self::TX_HIGH.take(from)?, Self::RX_LOW.take(from)?);
        Ok(Self { tx_high: (on & 1 != 0).then_some(tx_high), rx_low: (on & 2 != 0).then_some(rx_low) })
    }
}

choices! {
    /// One of the two FIFOs, in [`FifoPackSizeGet`].
    pub Fifo(u8), "FIFO_PACK_SIZE_GET FIFO", "0 RxPDO, 1 TxPDO" {
        /// 0: the RxFIFO.
        Rx = 0,
        /// 1: the TxFIFO.
        Tx = 1,
    }

    /// The FIFOs to empty, in [`FifoClear`].
    pub Fifos(u8), "FIFO_CLR_OP FIFOs", "0 both, 1 TxFIFO, 2 RxFIFO" {
        /// 0: both FIFOs.
        Both = 0,
        /// 1: the TxFIFO only.
        Tx = 1,
        /// 2: the RxFIFO only.
        Rx = 2,
    }
}
