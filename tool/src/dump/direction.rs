//! The direction of a frame: a command to the board, or a response from it.

use ecmsk::link::Dir;
use ecmsk::sk::{CommandId, Frame, MASTER_CYCLIC, MasterState, SlotSize, StateByte};

/// Parses `command` or `response`.
///
/// # Errors
/// The text is invalid; the error says what is allowed.
pub fn parse(text: &str) -> Result<Dir, String> {
    match text {
        "command" => Ok(Dir::Write),
        "response" => Ok(Dir::Read),
        _ => Err("allowed: command, response".to_owned()),
    }
}

/// Guesses the direction of a frame from the first bytes of its slot 0, which are the same for both slot sizes. \[OURS]
///
/// - byte 0 is the master's cyclic response 0xBF: a response;
/// - byte 2 is 0: a command; in a response it is the state, and no response is sent while the state is 0 (SK-4);
/// - SET_FIFO, with its argument in byte 2: a command, because it is sent only in OP, where byte 0 of responses is
///   0xBF;
/// - SET_AXIS, which also has an argument in byte 2: a response if byte 2 is the state PreOP and Data1 is 1 to 40, the
///   number of slaves found. Otherwise a command: its Data1 has eight slave kinds of 4 bits each, and so is rarely 1 to
///   40;
/// - any other command code with byte 2 set: a response.
pub fn guess(frame: &Frame) -> Dir {
    let slot = frame.slot(SlotSize::Bytes12, 0);
    let byte2 = slot.parm as u8;
    let is_response = match CommandId::from_code(slot.id) {
        _ if slot.id == MASTER_CYCLIC => true,
        _ if byte2 == 0 => false,
        CommandId::SetFifo => false,
        CommandId::SetAxis => {
            let counts_slaves = (1..=SlotSize::Bytes12.max_slaves()).contains(&(slot.data1 as usize));
            counts_slaves && StateByte(byte2).state() == Some(MasterState::PreOp)
        }
        _ => true,
    };
    if is_response { Dir::Read } else { Dir::Write }
}
