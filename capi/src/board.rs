//! An open board, and the one that the vendor's functions speak of without naming it.

use std::cell::RefCell;
use std::sync::atomic::{AtomicU64, Ordering};
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
/// number of threads. Closing ends their waits. A thread keeps its reference from call to call, so that a call costs
/// little more than the link's own: one that was closed is let go with the thread's next call, or with the thread.
pub struct VendorBoard {
    /// Held by a thread that opens or closes, so that two do not open the board twice, and none finds it in use by a
    /// link that is just being closed.
    changing: Mutex<()>,
    current: Mutex<Option<Arc<OpenBoard>>>,
    /// Number of what is in `current`, never the same twice in a process; 0: nothing.
    number: AtomicU64,
}

/// Numbers given to boards so far.
static NUMBERS: AtomicU64 = AtomicU64::new(0);

thread_local! {
    /// The board that this thread used last.
    static USED: RefCell<Option<(u64, Arc<OpenBoard>)>> = const { RefCell::new(None) };
}

impl VendorBoard {
    /// Not open.
    pub const fn new() -> Self {
        Self { changing: Mutex::new(()), current: Mutex::new(None), number: AtomicU64::new(0) }
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
        let mut current = lock(&self.current);
        *current = Some(board);
        self.number.store(NUMBERS.fetch_add(1, Ordering::Relaxed) + 1, Ordering::Release);
        Ok(())
    }

    /// Closes the board; reads and writes under way end with an error.
    pub fn close(&self) {
        let _one_at_a_time = lock(&self.changing);
        self.give_back();
    }

    /// [`Self::close`], without waiting for a thread that is just opening: for the end of the process.
    pub fn give_back(&self) {
        let board = {
            let mut current = lock(&self.current);
            self.number.store(0, Ordering::Release);
            current.take()
        };
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

    /// Works with the open board, by the reference that this thread keeps.
    fn with<T>(&self, mut work: impl FnMut(&OpenBoard) -> Result<T, CallError>) -> Result<T, CallError> {
        let kept = USED.try_with(|used| {
            let mut used = used.try_borrow_mut().ok()?;
            let number = self.number.load(Ordering::Acquire);
            if used.as_ref().is_none_or(|(kept, _)| *kept != number) {
                let current = lock(&self.current);
                *used = current.clone().map(|board| (self.number.load(Ordering::Acquire), board));
            }
            Some(match &*used {
                Some((_, board)) => work(board),
                None => Err(CallError::NotOpen),
            })
        });
        match kept {
            Ok(Some(result)) => result,
            // The thread is ending and keeps nothing any more.
            _ => work(&*self.get()?),
        }
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
