//! A board, or a chip ECM-XF, on the SPI of a firmware whose other half is in C.

use core::convert::Infallible;

use ecmsk::embedded::{Board, ChipWires};
use ecmsk::sk::{CrcPolicy, Frame, MasterResponse, SlotSize};
use ecmsk::xf::host::{Host, HostConfig, HostState, Wires};
use ecmsk::xf::request::{DcTiming, EcatInit, ReferenceClock, SlaveCountGet};
use embedded_hal::digital::{self, InputPin};
use embedded_hal::spi::{Error, ErrorKind, ErrorType, Operation, SpiDevice};

/// The functions of the firmware in C.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Firmware {
    /// Exchanges `len` bytes under one chip select; returns 0 if that went well.
    pub exchange: extern "C" fn(to_chip: *const u8, from_chip: *mut u8, len: usize) -> i32,
    /// The time in nanoseconds, which never goes back.
    pub now: extern "C" fn() -> u64,
    /// The level of BUSY of a board.
    pub busy: extern "C" fn() -> bool,
}

/// An exchange that the firmware has refused.
#[derive(Clone, Copy, Debug)]
pub struct Refused;

impl Error for Refused {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl ErrorType for Firmware {
    type Error = Refused;
}

impl SpiDevice for Firmware {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Refused> {
        for operation in operations {
            // The driver only exchanges, as many bytes each way.
            let Operation::Transfer(from_chip, to_chip) = operation else { return Err(Refused) };
            if from_chip.len() != to_chip.len()
                || (self.exchange)(to_chip.as_ptr(), from_chip.as_mut_ptr(), to_chip.len()) != 0
            {
                return Err(Refused);
            }
        }
        Ok(())
    }
}

impl digital::ErrorType for Firmware {
    type Error = Infallible;
}

/// BUSY.
impl InputPin for Firmware {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok((self.busy)())
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!(self.busy)())
    }
}

/// The state byte of a board, or `None` if it is busy or does not answer.
pub fn state(firmware: Firmware) -> Option<u8> {
    let size = SlotSize::Bytes12;
    let mut board = Board::new(firmware, firmware, size, CrcPolicy::Strict);
    let answer = board.exchange(&Frame::new()).ok()??;
    Some(MasterResponse::decode(&answer.slot(size, 0)).state.0)
}

/// The number of slaves of the chip, or `None` if it does not answer.
pub fn slaves(firmware: Firmware) -> Option<u8> {
    let mut wires = ChipWires::new(firmware, || (firmware.now)());
    let mut host = start(&mut wires, HostConfig::default())?;
    count(&mut host, &mut wires)
}

/// The driver of the chip, started; `None` if the chip does not answer.
pub fn start<W: Wires>(wires: &mut W, config: HostConfig) -> Option<Host> {
    let mut host = Host::new(wires.now(), config);
    while host.state() != HostState::Running {
        host.step(wires, u64::MAX).ok()?;
    }
    Some(host)
}

/// Starts the network of the chip; returns the number of its slaves, or `None` if a command fails.
pub fn count<W: Wires>(host: &mut Host, wires: &mut W) -> Option<u8> {
    let dc = DcTiming { assign_activate: 0x0300, sync0_ns: 1_000_000, sync1_ns: 0, shift_ns: 0 };
    let reference_clock = ReferenceClock::Chip;
    let begin = EcatInit { special_slaves: false, reference_clock, lrw: true, fifo_on: false, dc };
    let ticket = host.submit(wires.now(), &begin).ok()?;
    loop {
        match host.take(ticket, &begin) {
            Some(begun) => break begun.ok()?,
            None => host.step(wires, u64::MAX).ok()?,
        }
    }
    let ticket = host.submit(wires.now(), &SlaveCountGet).ok()?;
    loop {
        match host.take(ticket, &SlaveCountGet) {
            Some(count) => break count.ok(),
            None => host.step(wires, u64::MAX).ok()?,
        }
    }
}
