//! The first exchanges with a board. They show whether there is a board, and whether the wires are right.

use std::time::{Duration, Instant};

use super::answer_check::{AnswerCheck, WiringFault};
use super::options::SpiOptions;
use crate::io::spi::{BusyWires, SpiError};
use crate::link::LinkError;
use crate::sk::{CommandId, Frame, MasterCommand, MasterResponse, MasterState, RawSlot};

/// How long RESETN is held low; the board needs 32 us (SK-10). \[OURS]
const RESET_LOW: Duration = Duration::from_micros(100);
/// How many valid answers show that a board is there. \[OURS]
const VALID_ANSWERS_MIN: u32 = 2;
/// How many invalid answers, without a valid one in between, show that a wire is faulty. Zeros from a board without a
/// BUSY line do not show this before the time limit, because the board may still be starting up. \[OURS]
const INVALID_ANSWERS_MAX: u32 = 8;
/// The maximum number of valid answers if none of them proves that no bit is shifted. A shifted answer may look valid:
/// it has the form of a report and no CRC, and does not answer LIO_RD. After this many, opening the link fails once its
/// time limit has passed. \[OURS]
const UNCONFIRMED_ANSWERS_MAX: u32 = 12;
/// The pause between two of the first exchanges. It is longer than a cycle below OP, so that each answer is a new one,
/// and longer than the shortest period of a board without BUSY
/// ([`PERIOD_WITHOUT_BUSY`](super::options::PERIOD_WITHOUT_BUSY)). \[OURS]
const EXCHANGE_INTERVAL: Duration = Duration::from_micros(1500);
/// A byte in the SDO slot of the first frames. No board has this byte there in its answer, so if it comes back, MISO is
/// connected to MOSI. \[OURS]
const ECHO_MARK: u8 = 0x5A;

/// Exchanges frames until enough answers were valid ([`VALID_ANSWERS_MIN`]) and one of them has shown that no bit is
/// shifted; returns the latest answer. The error says which wire is faulty, or that BUSY stays high.
pub(super) fn begin(
    name: &str,
    wires: &mut dyn BusyWires,
    options: &SpiOptions,
    answer_check: &mut AnswerCheck,
) -> Result<MasterResponse, LinkError> {
    let no_board = |reason: String| LinkError::NoBoard { name: name.to_owned(), reason };
    let link_error = |error| link_error(name, error);
    let began = Instant::now();
    wires.reset(RESET_LOW).map_err(link_error)?;
    let mut answer = Frame::new();
    let (mut exchanges, mut valid, mut invalid, mut rises) = (0, 0, 0, false);
    // The latest wiring fault that an invalid answer has shown. It becomes the reason of the error if valid answers
    // follow and none of them proves the wiring: such answers may be shifted by some bits.
    let mut known_fault = WiringFault::Garbled;
    loop {
        let left = options.open_limit.saturating_sub(began.elapsed());
        if !wires.wait_ready(left).map_err(link_error)? {
            return Err(no_board(busy_is_high(options.open_limit)));
        }
        let question = question(options, exchanges);
        let length = options.slot.frame_len();
        wires.exchange(question.wire(options.slot), &mut answer.bytes_mut()[..length]).map_err(link_error)?;
        exchanges += 1;
        let fault = match answer_check.check(&answer) {
            Ok(_) if answer.wire(options.slot) == question.wire(options.slot) => Some(WiringFault::Echo),
            Ok(response) => {
                (valid, invalid) = (valid + 1, 0);
                let sure = answer_check.fills_crc()
                    || response.state.state() == Some(MasterState::Op)
                    || response.id == CommandId::LocalRead.code();
                if valid >= VALID_ANSWERS_MIN && sure {
                    if !wires.wait_ready(options.busy_limit).map_err(link_error)? {
                        return Err(no_board(busy_is_high(options.busy_limit)));
                    }
                    rises |= wires.busy_has_fallen().map_err(link_error)?;
                    if wires.has_busy_line() && !rises {
                        return Err(no_board(BUSY_IS_LOW.to_owned()));
                    }
                    return Ok(response);
                }
                (valid >= UNCONFIRMED_ANSWERS_MAX).then_some(known_fault)
            }
            Err(_) => {
                let fault = answer_check.explain();
                if fault != WiringFault::Garbled {
                    known_fault = fault;
                }
                Some(fault)
            }
        };
        if let Some(fault) = fault {
            invalid += 1;
            // Without a BUSY line, zeros may come from a board that is still starting up.
            let may_start = fault == WiringFault::Zeros && !wires.has_busy_line();
            if (invalid >= INVALID_ANSWERS_MAX && !may_start) || began.elapsed() >= options.open_limit {
                return Err(no_board(fault.to_string()));
            }
        }
        // Each answer reports the previous cycle, so the next answer is new only after a cycle.
        std::thread::sleep(EXCHANGE_INTERVAL);
    }
}

/// A frame with GET_STATUS in every slot. In every second pair of frames, slot 0 contains LIO_RD instead: below OP and
/// without a CRC, only an answer with the command id of LIO_RD shows that no bit is shifted.
fn question(options: &SpiOptions, number: u32) -> Frame {
    let mut frame = Frame::new();
    if number >= VALID_ANSWERS_MIN && number / 2 % 2 == 1 {
        frame.put_master(options.slot, &MasterCommand::LocalRead);
    }
    let slot = RawSlot { id: CommandId::GetStatus.code(), index: ECHO_MARK, ..RawSlot::ZERO };
    frame.put(options.slot, options.slot.sdo_slot(), &slot);
    frame.fill_crc(options.slot);
    frame
}

/// The error text if BUSY does not go low.
pub(super) fn busy_is_high(limit: Duration) -> String {
    format!(
        "BUSY has been high for {limit:?}: the board starts up, finds no slave or hangs (switch it off and on), or busy= \
         names another line than that of BUSY (J3/J2 pin 5)"
    )
}

/// The error text if BUSY stays low during an exchange.
pub(super) const BUSY_IS_LOW: &str = "BUSY does not go high in an exchange: busy= names another line than that of BUSY \
                                      (J3/J2 pin 5), or it is not connected; correct it, or leave busy= out";

/// The error of a link whose SPI device or GPIO lines cannot be used.
pub(super) fn link_error(name: &str, error: SpiError) -> LinkError {
    let next = next_step(&error);
    match error {
        SpiError::InUse { what, by } => LinkError::InUse {
            name: name.to_owned(),
            by: format!("{by} ({what})"),
            instead: "share the board by `ecmsk serve tcp`",
        },
        SpiError::Refused { what, message } => LinkError::Io { what, message: format!("{message}; {next}") },
        _ => LinkError::NoBoard { name: name.to_owned(), reason: format!("{error}; {next}") },
    }
}

/// What a user can do if the SPI device or a GPIO line cannot be used.
pub(crate) const fn next_step(error: &SpiError) -> &'static str {
    match error {
        SpiError::Missing { .. } => {
            "switch SPI on in the system (a device tree overlay, e.g. dtparam=spi=on), or correct the link"
        }
        SpiError::WrongKind { .. } | SpiError::InUse { .. } => "correct the link",
        SpiError::Denied { .. } => "add the user to the groups of the devices (spi, gpio), or be root",
        SpiError::Refused { .. } => "look at speed= and mode=, and at bufsiz of the module spidev (512 at least)",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wires_that_cannot_be_used_are_told_with_the_next_step() {
        let said = |error| link_error("spi:/dev/spidev0.0", error);
        let what = || "line 25 of /dev/gpiochip0".to_owned();
        let denied = said(SpiError::Denied { what: what() });
        assert!(matches!(denied, LinkError::NoBoard { .. }));
        assert!(denied.to_string().contains("line 25 of /dev/gpiochip0 may not be used by this user; add the user to"));
        let missing = said(SpiError::Missing { what: what(), there: "it has lines 0 to 7".to_owned() });
        assert!(missing.to_string().contains("is not there; it has lines 0 to 7; switch SPI on"), "{missing}");
        let another = said(SpiError::WrongKind { what: "/dev/null".to_owned(), there: "there is y".to_owned() });
        assert!(another.to_string().ends_with("/dev/null is no device of that kind; there is y; correct the link"));
        let used = said(SpiError::InUse { what: what(), by: " by a driver".to_owned() });
        assert!(
            matches!(&used, LinkError::InUse { by, .. } if by == " by a driver (line 25 of /dev/gpiochip0)"),
            "{used}"
        );
        let failed = said(SpiError::Refused { what: what(), message: "no".to_owned() });
        assert!(matches!(&failed, LinkError::Io { message, .. } if message.contains("bufsiz")), "{failed}");
    }
}
