//! The chip itself: packets, check words, FIFOs, interrupts, resets, PHY; the CiA 402 helper.

use super::FunctionFields;
use super::field::{Field, Kind, Names, Place};
use super::network::answer;
use super::rows::rows;
use crate::xf::Interrupts;
use crate::xf::request::*;
use crate::xf::value::{Switch, WriteOrRead};

/// Values of ASYNCCMD_RESET as bits.
const RESETS: Names = &[("clear_busy", 1), ("skip_port_wait", 2), ("give_up", 4)];
/// Bits of ECAT_SET_FIFO_TH.
const THRESHOLDS: Names = &[("tx_high", 1), ("rx_low", 2)];

const fn motor() -> Field {
    Field::par("motor")
}

const fn sources() -> Field {
    Field::at("sources", 0, 4).bits(Interrupts::NAMES)
}

const fn gpio() -> Field {
    Field::at("gpio", 4, 1).hex()
}

const fn peripherals() -> Field {
    Field::at("peripherals", 5, 1).bits(PeripheralInterrupts::NAMES)
}

#[rustfmt::skip]
pub(super) const ROWS: &[FunctionFields] = rows! {
    FifoEnable, "switches the RxFIFO's cyclic output on or off", [Field::par("on").one_of(Switch::NAMES)];
    FifoPackSizeGet, "gives the bytes of one PDO", [Field::par("fifo").one_of(Fifo::NAMES)]
        -> answer(&[Field::at("bytes", 0, 2)]);
    SpiPackSizeGet, "gives n, the size of the data segment", [] -> answer(&[Field::at("bytes", 0, 2)]);
    SpiReconfig, "sets n", [Field::word("size", Place::Length)];
    CrcErrorCountClear, "clears the count of wrong check words", [] -> answer(&[Field::ret("returned")]);
    CrcTypeSet, "chooses the check word", [Field::par("kind").one_of(&[("fixed", 0), ("crc32", 3)])];
    FifoClear, "empties FIFOs", [Field::par("fifos").one_of(Fifos::NAMES)];
    FifoSetTxCount, "sets the entries of the TxFIFO, which hold from FIFO_INIT on", [Field::par("entries")];
    FifoGetTxCount, "gives the entries of the TxFIFO", [] -> answer(&[Field::ret("entries")]);
    FifoSetRxCount, "sets the entries of the RxFIFO, which hold from FIFO_INIT on", [Field::par("entries")];
    FifoGetRxCount, "gives the entries of the RxFIFO", [] -> answer(&[Field::ret("entries")]);
    FirmwareVersionGet, "gives version and series of the chip", [] -> answer(&[
        Field::ret("version").hex(), Field::at("extended", 0, 2).hex(), Field::at("series", 3, 1),
        Field::at("identification", 4, 16).kind(Kind::Bytes),
    ]);
    InterruptSetEnable, "chooses what raises INT1, and the polarity of INT0 and INT1", [
        Field::par("polarity").bits(Polarity::NAMES), sources(), gpio().or(0), peripherals().or(0),
    ];
    InterruptGetEnable, "gives what INT_SET_ENABLE has set", [] -> answer(&[
        Field::ret("polarity").bits(Polarity::NAMES), sources(), gpio(), peripherals(),
    ]);
    FifoInit, "builds the FIFOs from their entries and the sizes of the PDOs", [];
    FifoThresholdSet, "sets the limits at which FIFOs raise an interrupt", [
        Field::par("on").bits(THRESHOLDS), Field::info("tx_high", 0, 1).or(0), Field::info("rx_low", 1, 1).or(0),
    ];
    AsyncReset, "ends what keeps the chip busy", [Field::par("action").bits(RESETS)];
    Mdio, "reads or writes a register of a PHY", [
        Field::par("operation").one_of(WriteOrRead::NAMES), Field::info("register", 0, 1), Field::info("phy", 1, 1),
        Field::info("value", 2, 2).hex().or(0),
    ] -> answer(&[Field::at("value", 0, 2).hex()]);
    WarmReset, "resets the chip: all is as after power-on", [];

    HelperConfigSet, "tells the CiA 402 helper where an axis has its words", [
        motor(), Field::info("controlword_offset", 0, 1), Field::info("statusword_offset", 1, 1),
        Field::info("control", 2, 1).bits(HelperControl::NAMES), Field::info("slave", 3, 1),
    ];
    HelperStateSet, "leads an axis to a state", [motor(), Field::info("state", 0, 1).kind(Kind::DriveState)];
    HelperStateGet, "gives the state of an axis", [motor()] -> answer(&[Field::ret("state").kind(Kind::DriveState)]);
    HelperControlSet, "changes what the helper does with an axis", [
        motor(), Field::info("control", 0, 1).bits(HelperControl::NAMES), Field::info("key", 1, 1).hex().or(0x5A),
        Field::info("motors", 2, 1), Field::info("slave", 3, 1),
    ];
    HelperControlGet, "gives what the helper does with an axis", [motor()]
        -> answer(&[Field::ret("control").bits(HelperControl::NAMES)]);
    HelperStatuswordGet, "gives the statusword of an axis", [motor()] -> answer(&[Field::at("statusword", 0, 2).hex()]);
};
