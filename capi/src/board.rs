//! An open board, and the one that the vendor's functions speak of without naming it.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use ecmsk::link::{Link, Wait};
use ecmsk::sk::{Frame, SlotSize};

use crate::error::{CallError, lock};
use crate::module::Stay;
use crate::shutdown::Busy;

/// A link with the limits that its URI gave it.
pub struct OpenBoard {
    /// The link.
    pub link: Arc<dyn Link>,
    /// Limit of a read that names none.
    pub read_wait: Wait,
    /// Limit of a write that names none.
    pub write_wait: Wait,
    closed: AtomicBool,
    /// Bytes of a frame of this board, if the link knows; 0: it does not, or a program has been told.
    frame_len: AtomicUsize,
    /// The link's threads run in this library.
    stay: Mutex<Option<Stay>>,
}

/// Boards open in this process.
static OPEN: AtomicUsize = AtomicUsize::new(0);

/// Whether any board is open.
pub fn any_open() -> bool {
    OPEN.load(Ordering::Relaxed) > 0
}

impl OpenBoard {
    /// Takes a link over.
    pub fn new(link: Arc<dyn Link>) -> Arc<Self> {
        let info = link.info();
        OPEN.fetch_add(1, Ordering::Relaxed);
        Arc::new(Self {
            link,
            read_wait: info.read_wait,
            write_wait: info.write_wait,
            closed: AtomicBool::new(false),
            frame_len: AtomicUsize::new(info.slot.map_or(0, SlotSize::frame_len)),
            stay: Mutex::new(Some(Stay::begin())),
        })
    }

    /// Closes the link.
    pub fn close(&self) {
        self.end(|link| link.close());
    }

    /// Gives the board back at the end of a program that has not closed it ([`Link::vanish`]).
    #[cfg(unix)]
    pub fn vanish(&self) {
        self.end(|link| link.vanish());
    }

    fn end(&self, end: impl FnOnce(&dyn Link)) {
        let _busy = Busy::begin();
        if !self.closed.swap(true, Ordering::Relaxed) {
            OPEN.fetch_sub(1, Ordering::Relaxed);
        }
        end(self.link.as_ref());
        lock(&self.stay).take();
    }

    /// A program that writes frames of the other slot size means other slots than the board: it is told once, in the
    /// log.
    fn look_at_length(&self, length: usize) {
        let expected = self.frame_len.load(Ordering::Relaxed);
        if expected == length || expected == 0 {
            return;
        }
        self.frame_len.store(0, Ordering::Relaxed);
        let size_of = |length| SlotSize::ALL.into_iter().find(|size| size.frame_len() == length);
        if let (Some(theirs), Some(ours)) = (size_of(length), size_of(expected)) {
            log::warn!(
                "the program writes frames of {length} bytes, the board's are {expected} ({}-byte slots); \
                 if its answers make no sense, set the link's slot= to the program's, {}",
                ours.bytes(),
                theirs.bytes()
            );
        }
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
    pub fn open(&self, connect: impl FnOnce() -> Result<Arc<dyn Link>, Box<CallError>>) -> Result<(), Box<CallError>> {
        let _busy = Busy::begin();
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
        let _busy = Busy::begin();
        let _one_at_a_time = lock(&self.changing);
        self.give_back();
    }

    /// For the end of a process that has not closed the board; does not wait for a thread that is just opening.
    #[cfg(unix)]
    pub fn vanish(&self) {
        if let Some(board) = self.take() {
            board.vanish();
        }
    }

    fn give_back(&self) {
        if let Some(board) = self.take() {
            board.close();
        }
    }

    fn take(&self) -> Option<Arc<OpenBoard>> {
        let mut current = lock(&self.current);
        self.number.store(0, Ordering::Release);
        current.take()
    }

    /// The open board.
    ///
    /// # Errors
    /// [`CallError::NotOpen`].
    pub fn get(&self) -> Result<Arc<OpenBoard>, Box<CallError>> {
        let _busy = Busy::begin();
        lock(&self.current).clone().ok_or_else(|| CallError::NotOpen.into())
    }

    /// Works with the open board, by the reference that this thread keeps.
    fn with<T>(&self, mut work: impl FnMut(&OpenBoard) -> Result<T, Box<CallError>>) -> Result<T, Box<CallError>> {
        let kept = USED.try_with(|used| {
            let mut used = used.try_borrow_mut().ok()?;
            let number = self.number.load(Ordering::Acquire);
            if used.as_ref().is_none_or(|(kept, _)| *kept != number) {
                let _busy = Busy::begin();
                let current = lock(&self.current);
                *used = current.clone().map(|board| (self.number.load(Ordering::Acquire), board));
            }
            Some(match &*used {
                Some((_, board)) => work(board),
                None => Err(CallError::NotOpen.into()),
            })
        });
        match kept {
            Ok(Some(result)) => result,
            // The thread is ending and keeps nothing any more.
            _ => work(&*self.get()?),
        }
    }

    /// Hands a command frame to the board, of which the program gave `length` bytes.
    ///
    /// # Errors
    /// [`CallError::NotOpen`], [`CallError::Link`].
    pub fn write(&self, frame: &Frame, length: usize) -> Result<(), Box<CallError>> {
        self.with(|board| {
            board.look_at_length(length);
            Ok(board.link.write(frame, board.write_wait).map(|_| ())?)
        })
    }

    /// Waits for a report.
    ///
    /// # Errors
    /// [`CallError::NotOpen`], [`CallError::Link`]; `report` is as it was then.
    pub fn read(&self, report: &mut Frame) -> Result<(), Box<CallError>> {
        self.with(|board| Ok(board.link.read(report, board.read_wait).map(|_| ())?))
    }
}

#[cfg(test)]
mod tests;
