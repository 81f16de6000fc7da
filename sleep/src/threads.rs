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

/// How long a thread that waits sleeps on the real clock before it looks whether time goes on: for the first time, and at
/// most \[OURS]. Other threads wake it when its wait ends. It looks by itself because nobody says when a thread has blocked
/// in the kernel.
const FIRST_PAUSE: Duration = Duration::from_micros(20);
const PAUSE_MAX: Duration = Duration::from_millis(1);

/// A thread of the program.
pub struct Thread {
    /// The kernel's number; 0 until the thread has begun.
    pub number: AtomicI32,
    /// The pthread_t; 0 until the thread has begun.
    handle: AtomicUsize,
    /// Changes to end a wait of the thread.
    word: AtomicU32,
    /// How many calls of NEXTWUSBLib the thread is in. In them it counts as running.
    pub inside: AtomicU32,
    /// Whether it has come back from its call of [`outside`], or from the kernel in a wait. It may still wait for the lock of
    /// the table.
    pub is_back: AtomicBool,
}

/// What a thread waits for, beside its deadline.
#[derive(Clone)]
pub enum What {
    /// Nothing.
    Time,
    /// That all others wait; its deadline has come already.
    Turn,
    /// The condition variable at this address.
    Condition(usize),
    /// The semaphore at this address.
    Semaphore(usize),
    /// A lock, which only the thread itself can try.
    Lock,
    /// That this word is no longer `seen`, as futex(2) waits.
    Word { address: usize, seen: u32 },
    /// One of these descriptors.
    Descriptors(Arc<[libc::pollfd]>),
}

/// How a wait has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The virtual clock has reached the deadline.
    Reached,
    /// It has come, or may have.
    Woken,
    /// A signal handler has run, or the thread is to end (pthread_cancel).
    Interrupted,
}

/// What a thread is doing.
pub enum State {
    /// It runs, or is blocked in a call that this library does not know.
    Running,
    /// It is in a call that ends by something else than time. It waits while it is blocked in the kernel.
    Outside,
    /// It waits.
    Waiting {
        /// On the virtual clock.
        deadline: u64,
        what: What,
        /// Waits with lower numbers began earlier.
        ticket: u64,
    },
    /// Its wait has ended, which it has not seen yet.
    Ended(Outcome),
    /// It ends. Until the system has ended it, it counts as running: then whoever waits for its end goes on.
    Ending,
}

/// A thread with what it is doing.
pub struct Entry {
    pub thread: Arc<Thread>,
    pub state: State,
    /// The number of context switches, and the real time, at which a running thread was first found blocked.
    pub blocked: Option<(u64, u64)>,
    /// The time of the processor that it had used when it was first found running while time stands still, in nanoseconds.
    pub used_ns: Option<u64>,
    /// Whether it has tried again what it waits for since time went on.
    pub is_retried: bool,
}

impl Entry {
    /// Whether this is the kernel's number of the thread.
    fn is_number(&self, number: i32) -> bool {
        self.thread.number.load(Ordering::Relaxed) == number
    }

    /// The ticket of its wait, if it waits for the word at this address.
    fn ticket_at(&self, word: usize) -> Option<u64> {
        match self.state {
            State::Waiting { what: What::Word { address, .. }, ticket, .. } if address == word => Some(ticket),
            _ => None,
        }
    }

    /// Ends its wait.
    pub fn end_wait(&mut self, outcome: Outcome) {
        self.state = State::Ended(outcome);
        system::wake(&self.thread.word);
    }
}

/// Condition variables that measure another clock than CLOCK_REALTIME; `None`: shared with other processes, so that their waits
/// stay real.
type ConditionClocks = BTreeMap<usize, Option<c_int>>;

/// The threads of the program.
#[derive(Default)]
pub struct Threads {
    pub entries: Vec<Entry>,
    tickets: u64,
    /// The virtual and the real time since when time stands still because a thread runs, in nanoseconds.
    pub stands_still_from: Option<(u64, u64)>,
    pub condition_clocks: ConditionClocks,
    /// Room for files of `/proc`.
    pub buffer: Vec<u8>,
}

/// The present table. A child of fork gets a new one, because another thread may have held the lock of the old one.
static THREADS: AtomicPtr<Mutex<Threads>> = AtomicPtr::new(std::ptr::null_mut());

/// The locked table. No signal handler runs in the thread until it is dropped: handlers may call NEXTWUSBLib, whose boards are
/// locked while their time passes, and functions that lock the table.
pub struct Locked {
    // Dropped in this order: handlers that are due run when the table is free.
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

/// The table. To be locked only while the calling thread is in [`Own`].
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

/// What a child of fork needs of the table: the condition variables that it has. Null: it has none.
static FOR_CHILD: AtomicPtr<ConditionClocks> = AtomicPtr::new(std::ptr::null_mut());

/// Before fork. The table is not kept locked until the child begins: other handlers of pthread_atfork may end threads.
pub extern "C" fn before_fork() {
    let _own = Own::begin();
    let clocks = lock().condition_clocks.clone();
    keep_for_child(if clocks.is_empty() { std::ptr::null_mut() } else { Box::into_raw(Box::new(clocks)) });
}

/// Puts these in the place of [`FOR_CHILD`], and returns what was there.
fn keep_for_child(clocks: *mut ConditionClocks) -> ConditionClocks {
    let before = FOR_CHILD.swap(clocks, Ordering::AcqRel);
    if before.is_null() {
        return ConditionClocks::new();
    }
    // SAFETY: made in `before_fork`, and the swap has given it to this call alone.
    *unsafe { Box::from_raw(before) }
}

/// In a child of fork: it has one thread.
pub extern "C" fn begin_anew() {
    let _own = Own::begin();
    let condition_clocks = keep_for_child(std::ptr::null_mut());
    let table = Threads { condition_clocks, ..Threads::default() };
    THREADS.store(Box::into_raw(Box::new(Mutex::new(table))), Ordering::Release);
    clock::set_earliest(NEVER);
    // The record of the parent's thread stays allocated.
    mode::set_thread(std::ptr::null());
}

/// The record of the calling thread, which is made with its first call. It exists until the thread ends.
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

/// Removes a thread that has not begun.
pub fn remove(thread: &Thread) {
    let mut threads = lock();
    threads.entries.retain(|entry| !std::ptr::eq(&*entry.thread, thread));
}

/// Makes `thread` the record of the calling thread, until it ends.
pub fn begin(thread: &Arc<Thread>) {
    /// The key whose value is the record. Its destructor runs when a thread ends, but not when the process does: exit
    /// handlers of the program still wait and read clocks.
    static KEY: OnceLock<Option<libc::pthread_key_t>> = OnceLock::new();

    let number = system::thread_number();
    // The system gives the numbers of ended threads to new ones.
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
        // SAFETY: the key was made above. Without memory for the value the record is removed when `/proc` has the thread no
        // more, and stays allocated.
        unsafe { libc::pthread_setspecific(*key, record.cast()) };
    }
    mode::set_thread(record);
}

/// The end of a thread, whose record this is.
unsafe extern "C" fn end(record: *mut c_void) {
    let _own = Own::begin();
    mode::set_thread(std::ptr::null());
    // What the thread still calls is real: nobody would see its second end.
    mode::set_real();
    // SAFETY: the reference that `begin` has kept.
    let thread = unsafe { Arc::from_raw(record.cast::<Thread>()) };
    let mut threads = lock();
    // If nobody waits, nobody else looks which threads have ended.
    threads.remove_gone(|entry| matches!(entry.state, State::Ending));
    threads.set(&thread, State::Ending);
}

impl Threads {
    fn entry(&mut self, thread: &Thread) -> Option<&mut Entry> {
        self.entries.iter_mut().find(|entry| std::ptr::eq(&*entry.thread, thread))
    }

    /// Sets what a thread is doing. Returns what it was doing; `None`: the table does not have it since a fork.
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

    /// Ends the waits that `ends` chooses by their deadline and what they are for.
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

    /// Ends the waits whose deadline has come. Those for a turn end in [`Self::advance`] alone.
    fn end_due(&mut self) {
        let now = clock::now();
        self.end_waits(Outcome::Reached, |deadline, what| deadline <= now && !matches!(what, What::Turn));
    }

    fn outcome(&mut self, thread: &Thread) -> Option<Outcome> {
        match self.entry(thread).map(|entry| &entry.state) {
            Some(State::Ended(outcome)) => Some(*outcome),
            Some(State::Waiting { .. }) => None,
            // The table is another one since a fork.
            _ => Some(Outcome::Woken),
        }
    }
}

/// Wakes the threads whose deadline has come.
pub fn wake_due() {
    let _own = Own::begin();
    lock().end_due();
}

/// Waits until `deadline`, or until `is_done`, which is asked from time to time, or until another thread ends the wait.
pub fn wait(what: What, deadline: u64, is_done: impl FnMut() -> bool) -> Outcome {
    wait_and(what, deadline, || (), is_done)
}

/// [`wait`], where `begun` is called when other threads can end the wait.
pub fn wait_and(what: What, deadline: u64, begun: impl FnOnce(), mut is_done: impl FnMut() -> bool) -> Outcome {
    let thread = current();
    let is_turn = matches!(what, What::Turn);
    if !is_turn {
        counts::wait();
    }
    let mut threads = lock();
    threads.tickets += 1;
    let ticket = threads.tickets;
    // Another wait, or a call outside, if this is one of a signal handler in it.
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
            // Time has gone on a part of the way.
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

/// The calling thread begins a call in which it may wait several times for the same.
pub fn begin_call() {
    let thread = current();
    if let Some(entry) = lock().entry(thread) {
        entry.is_retried = false;
    }
}

/// Waits until all other threads wait.
pub fn turn() {
    if mode::is_real() {
        return;
    }
    current();
    if lock().entries.len() > 1 {
        wait(What::Turn, clock::now(), || false);
    }
}

/// Runs a call of the C library that ends by something else than time. No destructor of this library runs if the thread is
/// cancelled in it.
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

/// Ends the oldest wait for a condition variable, or all of them. Returns how many.
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

/// Ends the oldest waits for a word, at most so many. Returns how many.
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
    // A thread that ends may have the same handle still.
    let is_it = |entry: &&mut Entry| {
        matches!(entry.state, State::Waiting { .. }) && entry.thread.handle.load(Ordering::Relaxed) == handle as usize
    };
    if let Some(entry) = threads.entries.iter_mut().find(is_it) {
        entry.end_wait(Outcome::Interrupted);
    }
    threads.note_earliest();
}
