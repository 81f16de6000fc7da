//! An open board, and the one that the vendor's functions speak of without naming it.

use std::sync::{Arc, Mutex};

use arc_swap::{ArcSwapOption, Guard};
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
    current: ArcSwapOption<OpenBoard>,
}

impl VendorBoard {
    /// Not open.
    pub const fn new() -> Self {
        Self { changing: Mutex::new(()), current: ArcSwapOption::const_empty() }
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
        self.current.store(Some(board));
        Ok(())
    }

    /// Closes the board; reads and writes under way end with an error.
    pub fn close(&self) {
        let _one_at_a_time = lock(&self.changing);
        self.give_back();
    }

    /// [`Self::close`], without waiting for a thread that is just opening: for the end of the process.
    pub fn give_back(&self) {
        if let Some(board) = self.current.swap(None) {
            board.link.close();
        }
    }

    /// The open board.
    ///
    /// # Errors
    /// [`CallError::NotOpen`].
    pub fn get(&self) -> Result<Arc<OpenBoard>, CallError> {
        self.current.load_full().ok_or(CallError::NotOpen)
    }

    /// Works with the open board, for as long as the call lasts: without the cost of a reference of its own.
    fn with<T>(&self, work: impl FnOnce(&OpenBoard) -> Result<T, CallError>) -> Result<T, CallError> {
        let board: Guard<Option<Arc<OpenBoard>>> = self.current.load();
        work(board.as_deref().ok_or(CallError::NotOpen)?)
    }

    /// Hands a command frame to the board.
    ///
    /// # Errors
    /// [`CallError::NotOpen`], [`CallError::Link`].
    pub fn write(&self, frame: &Frame) -> Result<(), CallError> {
        self.with(|board| Ok(board.link.write(frame, board.write_wait).map(|_| ())?))
    }

    /// Waits for a report.
    ///
    /// # Errors
    /// [`CallError::NotOpen`], [`CallError::Link`]; `report` is as it was then.
    pub fn read(&self, report: &mut Frame) -> Result<(), CallError> {
        self.with(|board| Ok(board.link.read(report, board.read_wait).map(|_| ())?))
    }
}

#[cfg(test)]
mod tests;
