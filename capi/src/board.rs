//! An open board, and the single board of the vendor's four functions, whose calls name no board.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Weak};
use std::thread;
use std::time::Duration;

use ecmsk::link::{Link, LinkError, Wait};
use ecmsk::sk::{Frame, SlotSize};
use ecmsk::threads::CallingThread;
use ecmsk::threads::sync::{Mutex, lock};

use crate::error::CallError;
use crate::forked::{self, MayHoldLock};
use crate::module::ModuleReference;
use crate::program_clock::{self, BoardClock};

/// An open link with the default timeouts of its URI.
pub struct OpenBoard {
    pub link: Arc<dyn Link>,
    /// The timeout of a read, from the link's URI (`read_timeout_ms`); without that key a read has none.
    pub read_wait: Wait,
    /// The timeout of a write, from the link's URI (`write_timeout_ms`) or the link's default.
    pub write_wait: Wait,
    closed: AtomicBool,
    /// The length of this board's frames in bytes. 0 means that the length of written frames is not checked: the link
    /// does not know the board's slot size, or the warning about a wrong length was logged already.
    frame_len: AtomicUsize,
    /// The clock of a program whose waits take virtual time. `None` if its waits take real time, or if the board's time
    /// is real.
    clock: Option<BoardClock>,
    /// A reference to this library's module, which keeps it in memory while the board is open: the link's threads execute code
    /// of it.
    module: Mutex<Option<ModuleReference>>,
}

impl OpenBoard {
    /// Makes an open board of a link that was just opened.
    pub fn new(link: Arc<dyn Link>) -> Arc<Self> {
        let info = link.info();
        let clock = BoardClock::begin(link.as_ref());
        forked::note_opened();
        Arc::new(Self {
            link,
            read_wait: info.read_wait,
            write_wait: info.write_wait,
            closed: AtomicBool::new(false),
            frame_len: AtomicUsize::new(info.slot.map_or(0, SlotSize::frame_len)),
            clock,
            module: Mutex::new(Some(ModuleReference::begin())),
        })
    }

    /// Writes a command frame.
    ///
    /// # Errors
    /// The errors of [`Link::write`].
    pub fn write(&self, frame: &Frame, wait: Wait) -> Result<(), LinkError> {
        self.in_time(|link| link.write(frame, wait)).map(drop)
    }

    /// Waits for a report.
    ///
    /// # Errors
    /// The errors of [`Link::read`].
    pub fn read(&self, report: &mut Frame, wait: Wait) -> Result<(), LinkError> {
        self.in_time(|link| link.read(report, wait)).map(drop)
    }

    /// Runs a call that lets the board's time pass. If the program has a virtual clock, the board is advanced to it
    /// before the call, and the clock to the board's time after the call.
    fn in_time<T>(&self, call: impl FnOnce(&dyn Link) -> T) -> T {
        let link = self.link.as_ref();
        let Some(clock) = &self.clock else { return call(link) };
        program_clock::turn();
        clock.before(link);
        let result = call(link);
        clock.after(link);
        result
    }

    /// Lets the board's time pass up to a time of the program's clock.
    #[cfg(target_os = "linux")]
    pub fn pass_to(&self, time: u64) {
        if let Some(clock) = &self.clock {
            clock.pass_to(self.link.as_ref(), time);
        }
    }

    /// Closes the link. Closing it again changes nothing.
    pub fn close(&self) {
        self.end(|link| link.close());
    }

    /// Ends the link of a process that exits without CloseECMUSB or `ecmsk_close`, by [`Link::vanish`]: a server then brings
    /// the axes to a standstill, which it does not do after [`Self::close`].
    #[cfg(unix)]
    pub fn vanish(&self) {
        self.end(|link| link.vanish());
    }

    fn end(&self, end: impl FnOnce(&dyn Link)) {
        let _may_hold_lock = MayHoldLock::begin();
        if !self.closed.swap(true, Ordering::Relaxed) {
            forked::note_closed();
        }
        end(self.link.as_ref());
        #[cfg(windows)]
        if !forked::any_open() {
            crate::logger::rest();
        }
        lock(&self.module).take();
    }

    /// Warns once, in the log, if the program writes frames of the other slot size than the board's.
    fn check_length(&self, length: usize) {
        let expected = self.frame_len.load(Ordering::Relaxed);
        if expected == length || expected == 0 {
            return;
        }
        self.frame_len.store(0, Ordering::Relaxed);
        let size_of = |length| SlotSize::ALL.into_iter().find(|size| size.frame_len() == length);
        if let (Some(of_program), Some(of_board)) = (size_of(length), size_of(expected)) {
            log::warn!(
                "the program writes frames of {length} bytes, the board's are {expected} ({}-byte slots); \
                 if its answers make no sense, set the link's slot= to the program's, {}",
                of_board.bytes(),
                of_program.bytes()
            );
        }
    }
}

/// The board that OpenECMUSB opens, one per process.
///
/// A call uses its own reference to the board and holds no lock while it waits, so that any number of threads may read,
/// write and close. Closing ends their waits. To make calls cheap, a thread remembers the board between calls, but only
/// by a weak reference: a link may hold its device as long as the link exists.
///
/// Programs end threads by force in the middle of a call. So a lock is held only to read or write the fields below, and
/// an Open does not wait for a thread that ended while it was opening or closing the board.
pub struct VendorBoard {
    state: Mutex<VendorState>,
    /// The serial number of the open board, counted over this process; 0 if no board is open. A thread compares it with
    /// the number of the board that it kept, to detect that another board was opened since.
    number: AtomicU64,
}

struct VendorState {
    current: Option<Arc<OpenBoard>>,
    /// The thread that is opening the board, so that two threads do not open it twice; `None`: no thread is. If the
    /// thread was ended by force, the next Open notices that and goes on.
    opening: Option<CallingThread>,
    /// The thread that is closing the board; `None`: no thread is. An Open waits for it, so that the board is free when
    /// it is opened again.
    closing: Option<CallingThread>,
}

impl VendorState {
    /// Whether an Open of `caller` has to wait for another thread.
    fn is_changing(&self, caller: CallingThread) -> bool {
        [self.opening, self.closing].into_iter().flatten().any(|other| other != caller && !other.is_gone())
    }
}

/// The interval at which a waiting Open checks whether another thread has finished opening or closing the board. \[OURS]
const CHECK_INTERVAL: Duration = Duration::from_millis(1);

/// The serial number of the board that was opened last in this process; the next one gets the next number, see [`VendorBoard`].
static NUMBERS: AtomicU64 = AtomicU64::new(0);

thread_local! {
    /// The board that this thread used last, with its serial number: a call on the same board then takes no lock.
    static BOARD_OF_THREAD: RefCell<Option<(u64, Weak<OpenBoard>)>> = const { RefCell::new(None) };
}

impl VendorBoard {
    /// The state before the first Open: no board is open.
    pub const fn new() -> Self {
        let state = VendorState { current: None, opening: None, closing: None };
        Self { state: Mutex::new(state), number: AtomicU64::new(0) }
    }

    /// Opens the board with `connect`. Does nothing if it is open already; a board that was lost is closed and opened again.
    ///
    /// # Errors
    /// Those of `connect`.
    pub fn open(&self, connect: impl FnOnce() -> Result<Arc<dyn Link>, Box<CallError>>) -> Result<(), Box<CallError>> {
        let _may_hold_lock = MayHoldLock::begin();
        let _turn = self.turn_to_open();
        if let Ok(board) = self.get() {
            match board.link.check() {
                Ok(()) => return Ok(()),
                Err(lost) => log::info!("opening again: {lost}"),
            }
            if let Some(board) = self.take(&mut lock(&self.state)) {
                board.close();
            }
        }
        let board = OpenBoard::new(connect()?);
        let mut state = lock(&self.state);
        state.current = Some(board);
        self.number.store(NUMBERS.fetch_add(1, Ordering::Relaxed) + 1, Ordering::Release);
        Ok(())
    }

    /// Waits until no other thread is opening or closing the board. Other threads that call Open then wait until the
    /// returned turn is dropped.
    fn turn_to_open(&self) -> Turn<'_> {
        let caller = CallingThread::current();
        loop {
            {
                let mut state = lock(&self.state);
                if !state.is_changing(caller) {
                    (state.opening, state.closing) = (Some(caller), None);
                    return Turn { state: &self.state, of: |state| &mut state.opening };
                }
            }
            thread::sleep(CHECK_INTERVAL);
        }
    }

    /// Closes the board; reads and writes under way end with an error. It does not wait for a thread that is just opening the
    /// board, which is open afterwards.
    pub fn close(&self) {
        let _may_hold_lock = MayHoldLock::begin();
        let mut state = lock(&self.state);
        let Some(board) = self.take(&mut state) else { return };
        state.closing = Some(CallingThread::current());
        drop(state);
        let _turn = Turn { state: &self.state, of: |state| &mut state.closing };
        board.close();
    }

    /// Ends the use of the board at the end of a process ([`OpenBoard::vanish`]). Does not wait for a thread that is just
    /// opening the board.
    #[cfg(unix)]
    pub fn vanish(&self) {
        let board = self.take(&mut lock(&self.state));
        if let Some(board) = board {
            board.vanish();
        }
    }

    fn take(&self, state: &mut VendorState) -> Option<Arc<OpenBoard>> {
        self.number.store(0, Ordering::Release);
        state.current.take()
    }

    /// The board that is open.
    ///
    /// # Errors
    /// [`CallError::NotOpen`]: no board is open.
    pub fn get(&self) -> Result<Arc<OpenBoard>, Box<CallError>> {
        let _may_hold_lock = MayHoldLock::begin();
        lock(&self.state).current.clone().ok_or_else(|| CallError::NotOpen.into())
    }

    /// Runs `work` on the open board. The thread remembers the board from call to call. If that board was closed or
    /// replaced since, the thread first looks up the board that is open now.
    fn with_board<T>(
        &self,
        mut work: impl FnMut(&OpenBoard) -> Result<T, Box<CallError>>,
    ) -> Result<T, Box<CallError>> {
        let kept = BOARD_OF_THREAD.try_with(|used| {
            let mut used = used.try_borrow_mut().ok()?;
            let number = self.number.load(Ordering::Acquire);
            let known = used.as_ref().filter(|(known, _)| *known == number);
            let mut board = known.and_then(|(_, board)| board.upgrade());
            if board.is_none() {
                let _may_hold_lock = MayHoldLock::begin();
                let state = lock(&self.state);
                let now = self.number.load(Ordering::Acquire);
                *used = state.current.as_ref().map(|board| (now, Arc::downgrade(board)));
                board.clone_from(&state.current);
            }
            Some(match &board {
                Some(board) => work(board),
                None => Err(CallError::NotOpen.into()),
            })
        });
        match kept {
            Ok(Some(result)) => result,
            // The thread is ending and its thread-local variables are gone, so it cannot keep a reference.
            _ => work(&*self.get()?),
        }
    }

    /// Writes a command frame, of which the program has given `length` bytes.
    ///
    /// # Errors
    /// [`CallError::NotOpen`]: no board is open. [`CallError::Link`]: the link has failed or reached its timeout.
    pub fn write(&self, frame: &Frame, length: usize) -> Result<(), Box<CallError>> {
        self.with_board(|board| {
            board.check_length(length);
            Ok(board.write(frame, board.write_wait)?)
        })
    }

    /// Waits for a report.
    ///
    /// # Errors
    /// [`CallError::NotOpen`]: no board is open. [`CallError::Link`]: the link has failed or reached its timeout.
    /// `report` is unchanged then.
    pub fn read(&self, report: &mut Frame) -> Result<(), Box<CallError>> {
        self.with_board(|board| Ok(board.read(report, board.read_wait)?))
    }
}

/// Marks this thread as the one that opens or closes the board, until this is dropped. `of` selects
/// [`VendorState::opening`] or [`VendorState::closing`].
struct Turn<'a> {
    state: &'a Mutex<VendorState>,
    of: fn(&mut VendorState) -> &mut Option<CallingThread>,
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        let mut state = lock(self.state);
        let mine = (self.of)(&mut state);
        if *mine == Some(CallingThread::current()) {
            *mine = None;
        }
    }
}

#[cfg(test)]
mod tests;
