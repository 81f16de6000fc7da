//! The threads of the program, and their waits.

use std::collections::BTreeMap;
use std::ffi::{c_int, c_void};
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicPtr, AtomicU32, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use crate::clock::{self, NEVER};
use crate::mode::{self, Own};
use crate::signals::Blocked;
use crate::{counts, system};

/// How long a waiting thread sleeps on the real clock before it checks whether virtual time can advance: the first
/// time, and at most \[OURS]. Other threads wake it when its wait ends. It has to check by itself, because nothing
/// reports that a thread has blocked in the kernel.
const FIRST_PAUSE: Duration = Duration::from_micros(20);
const PAUSE_MAX: Duration = Duration::from_millis(1);

/// The record of a thread of the program.
pub struct Thread {
    /// The kernel's id of the thread; 0 until the thread has begun.
    pub number: AtomicI32,
    /// The pthread_t; 0 until the thread has begun.
    handle: AtomicUsize,
    /// The futex word that changes to end a wait of the thread.
    word: AtomicU32,
    /// How many nested calls of NEXTWUSBLib the thread is in. During these calls it counts as running.
    pub inside: AtomicU32,
    /// Whether the thread has come back from its call of [`outside`], or from the kernel in a wait. It may still be
    /// waiting for the lock of the table.
    pub is_back: AtomicBool,
}

/// What a thread waits for, in addition to its deadline.
#[derive(Clone)]
pub enum What {
    /// Nothing else: the thread sleeps until the deadline.
    Time,
    /// All other threads have to be waiting. The deadline has come already.
    Turn,
    /// The condition variable at this address.
    Condition(usize),
    /// The semaphore at this address.
    Semaphore(usize),
    /// A lock. Only the thread itself can try to take it.
    Lock,
    /// This word has to differ from `seen`, as for futex(2).
    Word { address: usize, seen: u32 },
    /// One of these descriptors has to become ready.
    Descriptors(Arc<[libc::pollfd]>),
}

/// How a wait has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The virtual clock has reached the deadline.
    Reached,
    /// What the thread waits for has come, or may have come.
    Woken,
    /// A signal handler has run, or the thread was cancelled (pthread_cancel).
    Interrupted,
}

/// What a thread is doing.
pub enum State {
    /// The thread runs, or is blocked in a call that this library does not replace.
    Running,
    /// The thread is in a call that ends by something other than time. It counts as waiting while it is blocked in the
    /// kernel.
    Outside,
    /// The thread waits in [`wait_and`].
    Waiting {
        /// The deadline on the virtual clock, in nanoseconds.
        deadline: u64,
        what: What,
        /// The serial number of the wait: waits with lower numbers began earlier.
        ticket: u64,
    },
    /// The wait is over, but the blocking call of the thread has not returned yet.
    Ended(Outcome),
    /// The thread is ending. It counts as running until the system has ended it, because a thread that waits for its
    /// end then continues.
    Ending,
}

/// A thread of the table, with what it is doing.
pub struct Entry {
    pub thread: Arc<Thread>,
    pub state: State,
    /// When a running thread was first found blocked: the number of its context switches, and the real time, in
    /// nanoseconds.
    pub blocked: Option<(u64, u64)>,
    /// The processor time that the thread had used when it was first found running after virtual time stopped, in
    /// nanoseconds.
    pub used_ns: Option<u64>,
    /// Whether the thread was woken to try again for what it waits for, since virtual time last advanced.
    pub is_retried: bool,
}

impl Entry {
    /// Whether the thread has this id in the kernel.
    fn is_number(&self, number: i32) -> bool {
        self.thread.number.load(Ordering::Relaxed) == number
    }

    /// The ticket of the thread's wait, if it waits for the word at this address.
    fn ticket_at(&self, word: usize) -> Option<u64> {
        match self.state {
            State::Waiting { what: What::Word { address, .. }, ticket, .. } if address == word => Some(ticket),
            _ => None,
        }
    }

    /// Ends the wait of the thread.
    pub fn end_wait(&mut self, outcome: Outcome) {
        self.state = State::Ended(outcome);
        system::wake(&self.thread.word);
    }
}

/// The clocks of condition variables that use another clock than CLOCK_REALTIME, by their addresses. `None`: the
/// variable is shared with other processes, so that its waits stay real.
type ConditionClocks = BTreeMap<usize, Option<c_int>>;

/// The table of all threads of the program.
#[derive(Default)]
pub struct Threads {
    pub entries: Vec<Entry>,
    tickets: u64,
    /// Since when virtual time stands still because a thread runs: the virtual and the real time, in nanoseconds.
    pub stands_still_from: Option<(u64, u64)>,
    pub condition_clocks: ConditionClocks,
    /// A buffer for files of `/proc`.
    pub buffer: Vec<u8>,
}

/// The present table. A child of fork gets a new one, because another thread may have held the lock of the old one.
static THREADS: AtomicPtr<Mutex<Threads>> = AtomicPtr::new(std::ptr::null_mut());

/// The locked table. No signal handler runs in the thread until it is dropped: handlers may call NEXTWUSBLib, whose boards are
/// locked while their time passes, and functions that lock the table.
pub struct Locked {
    // The fields are dropped in this order, so that handlers that are due run after the table is unlocked.
    threads: MutexGuard<'static, Threads>,
    signals: Blocked,
}

impl Deref for Locked {
    type Target = Threads;

    fn deref(&self) -> &Threads {
        &self.threads
    }
}

impl DerefMut for Locked {
    fn deref_mut(&mut self) -> &mut Threads {
        &mut self.threads
    }
}

/// Locks the table. Only for use while the calling thread is in [`Own`].
pub fn lock() -> Locked {
    let signals = Blocked::begin();
    let mut table = THREADS.load(Ordering::Acquire);
    if table.is_null() {
        let new = Box::into_raw(Box::default());
        table = match THREADS.compare_exchange(std::ptr::null_mut(), new, Ordering::AcqRel, Ordering::Acquire) {
            Ok(_) => new,
            // Another thread was faster. The unused table stays allocated, once.
            Err(other) => other,
        };
    }
    // SAFETY: tables are never freed.
    let threads = unsafe { &*table }.lock().unwrap_or_else(PoisonError::into_inner);
    Locked { threads, signals }
}

/// What a child of fork takes over from its parent's table: the clocks of condition variables. Null: there are none.
static FOR_CHILD: AtomicPtr<ConditionClocks> = AtomicPtr::new(std::ptr::null_mut());

/// Called before fork. The table is not kept locked until the child begins: other handlers of pthread_atfork may end
/// threads.
pub extern "C" fn before_fork() {
    let _own = Own::begin();
    let clocks = lock().condition_clocks.clone();
    keep_for_child(if clocks.is_empty() { std::ptr::null_mut() } else { Box::into_raw(Box::new(clocks)) });
}

/// Replaces the content of [`FOR_CHILD`] by `clocks`, and returns the old content.
fn keep_for_child(clocks: *mut ConditionClocks) -> ConditionClocks {
    let before = FOR_CHILD.swap(clocks, Ordering::AcqRel);
    if before.is_null() {
        return ConditionClocks::new();
    }
    // SAFETY: made in `before_fork`, and the swap has given it to this call alone.
    *unsafe { Box::from_raw(before) }
}

/// Called in a child of fork, which has one thread: begins a new table.
pub extern "C" fn begin_anew() {
    let _own = Own::begin();
    let condition_clocks = keep_for_child(std::ptr::null_mut());
    let table = Threads { condition_clocks, ..Threads::default() };
    THREADS.store(Box::into_raw(Box::new(Mutex::new(table))), Ordering::Release);
    clock::set_earliest(NEVER);
    // The record of the parent's thread is never freed.
    mode::set_thread(std::ptr::null());
}

/// The record of the calling thread, which is made at its first call. It exists until the thread ends.
pub fn current() -> &'static Thread {
    let known = mode::thread();
    // SAFETY: null or the record of this thread, which exists until it ends.
    if let Some(thread) = unsafe { known.as_ref() } {
        return thread;
    }
    let thread = add();
    begin(&thread);
    // SAFETY: as above, since `begin` keeps a reference.
    unsafe { &*Arc::as_ptr(&thread) }
}

/// Adds a thread that is about to begin. It counts as running.
pub fn add() -> Arc<Thread> {
    let thread = Arc::new(Thread {
        number: AtomicI32::new(0),
        handle: AtomicUsize::new(0),
        word: AtomicU32::new(0),
        inside: AtomicU32::new(0),
        is_back: AtomicBool::new(false),
    });
    lock().entries.push(Entry {
        thread: Arc::clone(&thread),
        state: State::Running,
        blocked: None,
        used_ns: None,
        is_retried: false,
    });
    thread
}

/// Removes a thread whose `pthread_create` has failed.
pub fn remove(thread: &Thread) {
    let mut threads = lock();
    threads.entries.retain(|entry| !std::ptr::eq(&*entry.thread, thread));
}

/// Makes `thread` the record of the calling thread, until it ends.
pub fn begin(thread: &Arc<Thread>) {
    /// The key whose value is the record. Its destructor runs when a thread ends, but not when the process ends: exit
    /// handlers of the program may still wait and read clocks.
    static KEY: OnceLock<Option<libc::pthread_key_t>> = OnceLock::new();

    let number = system::thread_number();
    // The kernel gives the ids of ended threads to new threads.
    lock().entries.retain(|entry| !(matches!(entry.state, State::Ending) && entry.is_number(number)));
    thread.number.store(number, Ordering::Relaxed);
    // SAFETY: the function has no arguments and cannot fail.
    thread.handle.store(unsafe { libc::pthread_self() } as usize, Ordering::Relaxed);
    let key = KEY.get_or_init(|| {
        let mut key = 0;
        // SAFETY: the key exists, and the function is in a library that is not unloaded.
        (unsafe { libc::pthread_key_create(&raw mut key, Some(end)) } == 0).then_some(key)
    });
    let record = Arc::into_raw(Arc::clone(thread));
    if let Some(key) = key {
        // SAFETY: the key was made above. If there is no memory for the value, the thread is removed from the table
        // when `/proc` no longer lists it, and its record is never freed.
        unsafe { libc::pthread_setspecific(*key, record.cast()) };
    }
    mode::set_thread(record);
}

/// Called when the thread with this record ends.
unsafe extern "C" fn end(record: *mut c_void) {
    let _own = Own::begin();
    mode::set_thread(std::ptr::null());
    // Further calls of the thread are real: they must not make a new record, whose end nobody would notice.
    mode::set_real();
    // SAFETY: the reference that `begin` has kept.
    let thread = unsafe { Arc::from_raw(record.cast::<Thread>()) };
    let mut threads = lock();
    // While no thread waits, nothing else checks which threads have ended.
    threads.remove_gone(|entry| matches!(entry.state, State::Ending));
    threads.set(&thread, State::Ending);
}

impl Threads {
    fn entry(&mut self, thread: &Thread) -> Option<&mut Entry> {
        self.entries.iter_mut().find(|entry| std::ptr::eq(&*entry.thread, thread))
    }

    /// Sets what a thread is doing. Returns what it was doing; `None` if the thread is not in the table, which is a new
    /// one after a fork.
    fn set(&mut self, thread: &Thread, state: State) -> Option<State> {
        thread.is_back.store(false, Ordering::Relaxed);
        let before = self.entry(thread).map(|entry| {
            (entry.blocked, entry.used_ns) = (None, None);
            std::mem::replace(&mut entry.state, state)
        });
        self.note_earliest();
        before
    }

    /// The earliest deadline of all waits; [`NEVER`]: none has one.
    pub fn earliest(&self) -> u64 {
        let deadlines = self.entries.iter().map(|entry| match entry.state {
            State::Waiting { deadline, .. } => deadline,
            _ => NEVER,
        });
        deadlines.min().unwrap_or(NEVER)
    }

    fn note_earliest(&self) {
        clock::set_earliest(self.earliest());
    }

    /// Ends the waits that `ends` selects by their deadline and by what they are for. Returns their number.
    pub fn end_waits(&mut self, outcome: Outcome, mut ends: impl FnMut(u64, &What) -> bool) -> usize {
        let mut count = 0;
        for entry in &mut self.entries {
            if let State::Waiting { deadline, what, .. } = &entry.state
                && ends(*deadline, what)
            {
                entry.end_wait(outcome);
                count += 1;
            }
        }
        self.note_earliest();
        count
    }

    /// Ends the waits whose deadline has come, except waits for a turn: only [`Self::advance`] ends those.
    fn end_due(&mut self) {
        let now = clock::now();
        self.end_waits(Outcome::Reached, |deadline, what| deadline <= now && !matches!(what, What::Turn));
    }

    fn outcome(&mut self, thread: &Thread) -> Option<Outcome> {
        match self.entry(thread).map(|entry| &entry.state) {
            Some(State::Ended(outcome)) => Some(*outcome),
            Some(State::Waiting { .. }) => None,
            // The table was replaced after a fork, so the wait is not in it.
            _ => Some(Outcome::Woken),
        }
    }
}

/// Wakes the threads whose deadline has come.
pub fn wake_due() {
    let _own = Own::begin();
    lock().end_due();
}

/// Waits until `deadline`, until `is_done` returns true, or until another thread ends the wait. `is_done` is called
/// from time to time.
pub fn wait(what: What, deadline: u64, is_done: impl FnMut() -> bool) -> Outcome {
    wait_and(what, deadline, || (), is_done)
}

/// Like [`wait`], but calls `begun` as soon as other threads can end the wait.
pub fn wait_and(what: What, deadline: u64, begun: impl FnOnce(), mut is_done: impl FnMut() -> bool) -> Outcome {
    let thread = current();
    let is_turn = matches!(what, What::Turn);
    if !is_turn {
        counts::wait();
    }
    let mut threads = lock();
    threads.tickets += 1;
    let ticket = threads.tickets;
    // If a signal handler calls this, the state before is that of the wait, or of the call outside, that the handler
    // has interrupted.
    let around = threads.set(thread, State::Waiting { deadline, what, ticket });
    begun();
    let mut pause = FIRST_PAUSE;
    let outcome = loop {
        if let Some(outcome) = threads.outcome(thread) {
            break outcome;
        }
        if is_done() {
            break Outcome::Woken;
        }
        if !is_turn && deadline <= clock::now() {
            break Outcome::Reached;
        }
        let before = clock::now();
        if threads.advance() {
            continue;
        }
        if clock::now() > before {
            // Virtual time has advanced, but not up to the deadline.
            pause = FIRST_PAUSE;
        }
        let seen = thread.word.load(Ordering::Acquire);
        let is_handler_due = threads.signals.is_handler_due();
        drop(threads);
        let is_interrupted = is_handler_due || system::wait_on(&thread.word, seen, pause);
        thread.is_back.store(true, Ordering::Release);
        pause = (pause * 2).min(PAUSE_MAX);
        threads = lock();
        thread.is_back.store(false, Ordering::Relaxed);
        if is_interrupted && threads.outcome(thread).is_none() {
            break Outcome::Interrupted;
        }
    };
    threads.set(thread, around.unwrap_or(State::Running));
    outcome
}

/// Marks the beginning of a call in which the thread may wait several times for the same thing, so that it may be woken
/// to try again.
pub fn begin_call() {
    let thread = current();
    if let Some(entry) = lock().entry(thread) {
        entry.is_retried = false;
    }
}

/// Waits until all other threads of the program wait.
pub fn turn() {
    if mode::is_real() {
        return;
    }
    current();
    if lock().entries.len() > 1 {
        wait(What::Turn, clock::now(), || false);
    }
}

/// Runs a call of the C library that ends by something other than time. No value with a destructor exists during the
/// call, so that the thread may be cancelled in it.
pub fn outside<T>(call: impl FnOnce() -> T) -> T {
    {
        let _own = Own::begin();
        let thread = current();
        lock().set(thread, State::Outside);
    }
    let result = call();
    let _own = Own::begin();
    let thread = current();
    thread.is_back.store(true, Ordering::Release);
    lock().set(thread, State::Running);
    result
}

/// Ends the oldest wait for a condition variable, or all waits for it. Returns how many it has ended.
pub fn signal(condition: usize, is_all: bool) -> usize {
    let mut threads = lock();
    let is_it = |what: &What| matches!(what, What::Condition(of) if *of == condition);
    let oldest = threads.entries.iter().filter_map(|entry| match &entry.state {
        State::Waiting { what, ticket, .. } if is_it(what) => Some((*ticket, Arc::clone(&entry.thread))),
        _ => None,
    });
    let oldest = oldest.min_by_key(|(ticket, _)| *ticket).map(|(_, thread)| thread);
    match oldest {
        None => 0,
        Some(_) if is_all => threads.end_waits(Outcome::Woken, |_, what| is_it(what)),
        Some(thread) => {
            threads.set(&thread, State::Ended(Outcome::Woken));
            system::wake(&thread.word);
            1
        }
    }
}

/// Ends the oldest waits for a word, at most `most` of them. Returns how many it has ended.
pub fn woken(word: usize, most: usize) -> usize {
    let mut threads = lock();
    let mut tickets: Vec<u64> = threads.entries.iter().filter_map(|entry| entry.ticket_at(word)).collect();
    tickets.sort_unstable();
    tickets.truncate(most);
    for entry in &mut threads.entries {
        if entry.ticket_at(word).is_some_and(|ticket| tickets.contains(&ticket)) {
            entry.end_wait(Outcome::Woken);
        }
    }
    threads.note_earliest();
    tickets.len()
}

/// Lets the threads that wait for a semaphore try again.
pub fn posted(semaphore: usize) {
    lock().end_waits(Outcome::Woken, |_, what| matches!(what, What::Semaphore(of) if *of == semaphore));
}

/// Ends the wait of a thread that is cancelled.
pub fn cancelled(handle: libc::pthread_t) {
    let mut threads = lock();
    // A thread that is ending may still have the same handle.
    let is_it = |entry: &&mut Entry| {
        matches!(entry.state, State::Waiting { .. }) && entry.thread.handle.load(Ordering::Relaxed) == handle as usize
    };
    if let Some(entry) = threads.entries.iter_mut().find(is_it) {
        entry.end_wait(Outcome::Interrupted);
    }
    threads.note_earliest();
}
