//! One cycle's commands and its answer, with only `core` and the wire format.

use core::fmt::{self, Write};

use ecmsk::cia402::DriveState;
use ecmsk::sk::{
    CommandDump, CommandId, CrcPolicy, DriveResponse, FRAME_LEN, Frame, MasterResponse, MasterState, Motion,
    SlaveCommand, SlotSize,
};

const SIZE: SlotSize = SlotSize::Bytes12;

/// Why a response has no position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum Refusal {
    Crc = 1,
    NotInOp = 2,
    NotEnabled = 3,
    OtherCommand = 4,
}

/// Sends slave 1 to `target`.
pub fn command(target: i32, index: u8) -> Frame {
    let mut frame = Frame::new();
    frame.put_slave(SIZE, 1, &SlaveCommand::Csp(Motion::to(target)).with_index(index));
    frame.fill_crc(SIZE);
    frame
}

/// The position of slave 1.
pub fn position(bytes: &[u8; FRAME_LEN]) -> Result<i32, Refusal> {
    let frame = Frame::from_bytes(*bytes);
    frame.check_crc(SIZE, CrcPolicy::Strict).map_err(|_| Refusal::Crc)?;
    let board = MasterResponse::decode(&frame.slot(SIZE, 0));
    if board.state.state() != Some(MasterState::Op) {
        return Err(Refusal::NotInOp);
    }
    let drive = DriveResponse::decode(&frame.slot(SIZE, 1));
    if CommandId::from_code(drive.head.id) != CommandId::Csp {
        return Err(Refusal::OtherCommand);
    }
    match drive.statusword.state() {
        Some(DriveState::OperationEnabled) => Ok(drive.position),
        _ => Err(Refusal::NotEnabled),
    }
}

/// Text without an allocator: text that does not fit is left out.
pub struct Screen<const N: usize> {
    bytes: [u8; N],
    len: usize,
}

impl<const N: usize> Screen<N> {
    /// The frame's dump, as far as it fits.
    pub fn showing(frame: &Frame) -> Self {
        let mut screen = Self { bytes: [0; N], len: 0 };
        // The only error is a full screen.
        let _ = write!(screen, "{}", CommandDump::new(frame, SIZE));
        screen
    }

    /// The text shown.
    pub fn text(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

impl<const N: usize> Write for Screen<N> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let fits = text.len().min(N - self.len);
        self.bytes[self.len..self.len + fits].copy_from_slice(&text.as_bytes()[..fits]);
        self.len += fits;
        if fits == text.len() { Ok(()) } else { Err(fmt::Error) }
    }
}
