//! An open board, and the one that the vendor's functions speak of without naming it.

use std::sync::{Arc, Mutex};

use ecmsk::link::{Link, Wait};
use ecmsk::sk::Frame;

use crate::error::{CallError, lock};

/// A link with the limits that its URI gave it.
pub struct OpenBoard {
    /// The link.
    pub link: Arc<dyn Link>,
    /// Limit of a read that names none.
    pub read_wait: Wait,
    /// Limit of a write that names none.
    pub write_wait: Wait,
}

impl OpenBoard {
    /// Takes a link over.
    pub fn new(link: Arc<dyn Link>) -> Arc<Self> {
        let info = link.info();
        Arc::new(Self { link, read_wait: info.read_wait, write_wait: info.write_wait })
    }
}

/// The board of OpenECMUSB.
///
/// A call works on its own reference and holds no lock while it waits, so that reader, writer and closer may be any
/// number of threads. Closing ends their waits.
pub struct VendorBoard {
    /// Held by a thread that opens or closes, so that two do not open the board twice, and none finds it in use by a
    /// link that is just being closed.
    changing: Mutex<()>,
    current: Mutex<Option<Arc<OpenBoard>>>,
}

impl VendorBoard {
    /// Not open.
    pub const fn new() -> Self {
        Self { changing: Mutex::new(()), current: Mutex::new(None) }
    }

    /// Opens the board by `connect`. Does nothing if it is open and there; a board that was lost is given back and
    /// opened anew.
    ///
    /// # Errors
    /// What `connect` says.
    pub fn open(&self, connect: impl FnOnce() -> Result<Arc<dyn Link>, CallError>) -> Result<(), CallError> {
        let _one_at_a_time = lock(&self.changing);
        if let Ok(board) = self.get() {
            match board.link.check() {
                Ok(()) => return Ok(()),
                Err(gone) => log::info!("opening again: {gone}"),
            }
            self.give_back();
        }
        let board = OpenBoard::new(connect()?);
        *lock(&self.current) = Some(board);
        Ok(())
    }

    /// Closes the board; reads and writes under way end with an error.
    pub fn close(&self) {
        let _one_at_a_time = lock(&self.changing);
        self.give_back();
    }

    /// [`Self::close`], without waiting for a thread that is just opening: for the end of the process.
    pub fn give_back(&self) {
        let board = lock(&self.current).take();
        if let Some(board) = board {
            board.link.close();
        }
    }

    /// The open board.
    ///
    /// # Errors
    /// [`CallError::NotOpen`].
    pub fn get(&self) -> Result<Arc<OpenBoard>, CallError> {
        lock(&self.current).clone().ok_or(CallError::NotOpen)
    }

    /// Hands a command frame to the board.
    ///
    /// # Errors
    /// [`CallError::NotOpen`], [`CallError::Link`].
    pub fn write(&self, frame: &Frame) -> Result<(), CallError> {
        let board = self.get()?;
        board.link.write(frame, board.write_wait)?;
        Ok(())
    }

    /// Waits for a report.
    ///
    /// # Errors
    /// [`CallError::NotOpen`], [`CallError::Link`].
    pub fn read(&self) -> Result<Frame, CallError> {
        let board = self.get()?;
        let mut report = Frame::new();
        board.link.read(&mut report, board.read_wait)?;
        Ok(report)
    }
}

#[cfg(test)]
mod tests;
