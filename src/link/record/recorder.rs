//! A running recording. Calls of the program add entries to a queue, which the recorder's thread writes to the file.

use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{JoinHandle, Thread};
use std::time::{Duration, Instant};

use super::blocks::BlockWriter;
use super::file::Sink;
use super::loss::Loss;
use super::queue::{LOOK_INTERVAL, Queue, UNTOLD_MAX};
use super::writer::{self, Capture, Entry, Writer};
use crate::recording::file_formats::ecmrec;
use crate::recording::{Clock, RecordMeta};
use crate::threads::{self, CallingThread, sync};

/// How long the end of a recording waits for calls of the program that are still running. They end because their link
/// is closed. \[OURS]
const CALLS_LIMIT: Duration = Duration::from_secs(10);

/// A recording in progress: its queue and its thread. Calls of the program add entries; [`Recorder::finish`] ends it.
pub(in crate::link) struct Recorder<E> {
    /// The time in the file minus the time of the link, nanoseconds.
    base_ns: u64,
    /// Whether a call waits for room in the queue: only on a virtual clock.
    may_wait: bool,
    /// How long a call or the end of the recording waits for the reader of a pipe; `None` for a file.
    stall_max: Option<Duration>,
    /// Whether the reader of the pipe has stalled for so long that calls no longer wait for it.
    given_up: AtomicBool,
    queue: Arc<Queue<E>>,
    /// Whether the recording is ending: calls that begin from now on are not recorded.
    is_ending: AtomicBool,
    /// The threads of the program that are in a call of the link. The end of the recording waits for them.
    callers: sync::Mutex<Vec<CallingThread>>,
    /// The recorder's thread, which is woken after each new entry. Waking it takes no lock.
    wakes: Thread,
    writer: Mutex<Option<JoinHandle<()>>>,
}

impl<E: Entry> Recorder<E> {
    /// Begins a recording to `sink`, with a queue of `queue` entries. `name` is the name of the sink in messages; its
    /// extension decides the format.
    ///
    /// # Errors
    /// The headers cannot be written, or the system provides no thread.
    pub fn begin(
        name: &str,
        sink: Sink,
        meta: &RecordMeta,
        queue: usize,
        stall_max: Option<Duration>,
    ) -> io::Result<Self> {
        let dropped = Arc::new(AtomicU64::new(0));
        let loss = Loss::new(name.to_owned(), Arc::clone(&dropped));
        if ecmrec::is_named(Path::new(name)) {
            Self::run(BlockWriter::<E>::begin(loss, sink, meta)?, dropped, meta, queue, stall_max)
        } else {
            Self::run(Capture::<E>::begin(loss, sink, meta)?, dropped, meta, queue, stall_max)
        }
    }

    /// Begins a recording that `recording` writes; missing entries are counted in `dropped`.
    ///
    /// # Errors
    /// The system provides no thread.
    pub(super) fn run(
        recording: impl Writer<E>,
        dropped: Arc<AtomicU64>,
        meta: &RecordMeta,
        queue: usize,
        stall_max: Option<Duration>,
    ) -> io::Result<Self> {
        let queue = Arc::new(Queue::new(queue, meta.clock, dropped));
        let entries = Arc::clone(&queue);
        let writer = threads::spawn("ecmsk-record", move || writer::run(&entries, recording))?;
        Ok(Self {
            base_ns: meta.base_ns,
            may_wait: meta.clock == Clock::Virtual,
            stall_max,
            given_up: AtomicBool::new(false),
            queue,
            is_ending: AtomicBool::new(false),
            callers: sync::Mutex::default(),
            wakes: writer.thread().clone(),
            writer: Mutex::new(Some(writer)),
        })
    }

    /// Converts a time of the link to a time in the file, nanoseconds.
    pub const fn file_ns(&self, link_ns: u64) -> u64 {
        self.base_ns.saturating_add(link_ns)
    }

    /// Marks the beginning of a call of the program. [`Self::finish`] waits until the call has ended.
    pub fn call(&self) -> RecordedCall<'_, E> {
        let caller = CallingThread::current();
        self.callers().push(caller);
        RecordedCall { recorder: self, caller, is_recorded: !self.is_ending.load(Ordering::SeqCst) }
    }

    fn callers(&self) -> sync::MutexGuard<'_, Vec<CallingThread>> {
        sync::lock(&self.callers)
    }

    /// The number of entries that are missing from the recording.
    pub fn dropped(&self) -> u64 {
        self.queue.dropped.load(Ordering::Relaxed)
    }

    /// Records an entry, or counts it as missing.
    pub fn record(&self, entry: E) {
        self.record_if(!self.is_ending.load(Ordering::SeqCst), entry);
    }

    fn record_if(&self, is_recorded: bool, entry: E) {
        let queue = &self.queue;
        let taken = is_recorded && !queue.is_over.load(Ordering::SeqCst) && self.add(entry);
        if taken {
            self.wakes.unpark();
        } else {
            queue.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Adds an entry to the queue; returns whether it was taken.
    fn add(&self, entry: E) -> bool {
        match self.queue.ring.add(entry) {
            Ok(()) => true,
            Err(entry) => self.may_wait && self.wait_and_add(entry),
        }
    }

    /// Waits for room in the queue and adds the entry; returns whether it was added. The reader of a pipe may never
    /// read, so this wait ends after `stall_max` without success. It also ends without success when the recording ends.
    fn wait_and_add(&self, mut entry: E) -> bool {
        let queue = &self.queue;
        let began = Instant::now();
        while !queue.is_over.load(Ordering::SeqCst) {
            if self.stall_max.is_some_and(|max| self.given_up.load(Ordering::Relaxed) || began.elapsed() > max) {
                self.given_up.store(true, Ordering::Relaxed);
                return false;
            }
            let ticket = queue.room.ticket();
            let limit = if queue.ring.is_full() { UNTOLD_MAX } else { Duration::ZERO };
            queue.room.wait(ticket, Some(limit));
            match queue.ring.add(entry) {
                Ok(()) => return true,
                Err(back) => entry = back,
            }
        }
        false
    }

    /// Waits for the calls that are in progress, then ends the recording.
    pub fn finish(&self) {
        self.is_ending.store(true, Ordering::SeqCst);
        self.wait_for_calls();
        self.queue.end();
        self.wakes.unpark();
        self.wait_for_writer();
    }

    /// Waits until the file is complete. Any number of threads may wait, and none of them holds a lock meanwhile.
    fn wait_for_writer(&self) {
        let began = Instant::now();
        loop {
            let stalled = self.stall_max.filter(|max| began.elapsed() >= *max);
            let ended = {
                let mut writer = self.writer.lock().unwrap_or_else(PoisonError::into_inner);
                if writer.is_none() {
                    return;
                }
                writer.take_if(|thread| stalled.is_some() || thread.is_finished())
            };
            let Some(thread) = ended else {
                std::thread::sleep(LOOK_INTERVAL);
                continue;
            };
            if !threads::end_within(thread, Duration::ZERO) {
                let stalled = stalled.unwrap_or_default();
                log::warn!("the recording lacks its end: the reader of its pipe has taken nothing for {stalled:?}");
            }
            return;
        }
    }

    /// Waits until all threads have left their calls, except threads that were ended by force.
    fn wait_for_calls(&self) {
        let began = Instant::now();
        while began.elapsed() <= CALLS_LIMIT && !self.callers().iter().all(CallingThread::is_gone) {
            std::thread::sleep(LOOK_INTERVAL);
        }
    }
}

/// A call of the program on the link. Its frame is recorded at its end.
pub(in crate::link) struct RecordedCall<'a, E> {
    recorder: &'a Recorder<E>,
    caller: CallingThread,
    /// Whether the call began before the recording was being ended. Only then its frame is recorded.
    is_recorded: bool,
}

impl<E: Entry> RecordedCall<'_, E> {
    /// Records the frame of the call, or counts it as missing.
    pub fn record(&self, entry: E) {
        self.recorder.record_if(self.is_recorded, entry);
    }
}

impl<E> Drop for RecordedCall<'_, E> {
    fn drop(&mut self) {
        let mut callers = sync::lock(&self.recorder.callers);
        if let Some(own) = callers.iter().position(|caller| *caller == self.caller) {
            callers.swap_remove(own);
        }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::io::Write;
    use std::sync::mpsc;

    use super::super::writer::FrameEntry;
    use super::*;
    use crate::link::{Dir, Stamp};
    use crate::sk::Frame;

    /// A writer that counts the bytes of a recording.
    struct Counted(Arc<AtomicU64>);

    impl Write for Counted {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.fetch_add(bytes.len() as u64, Ordering::SeqCst);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn record(recorder: &Recorder<FrameEntry>) {
        recorder.call().record(FrameEntry { at_ns: 0, dir: Dir::Read, frame: Frame::new() });
    }

    /// Makes the system end the calling thread, and no other, at its next call that wakes another thread.
    fn end_where_it_wakes() {
        use libc::{
            BPF_ABS, BPF_ALU, BPF_AND, BPF_JEQ, BPF_JMP, BPF_JUMP, BPF_K, BPF_LD, BPF_RET, BPF_STMT, BPF_W,
            FUTEX_CMD_MASK, FUTEX_WAKE, PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, SECCOMP_MODE_FILTER, SECCOMP_RET_ALLOW,
            SECCOMP_RET_KILL_THREAD, SYS_futex,
        };

        let op = std::mem::offset_of!(libc::seccomp_data, args) + if cfg!(target_endian = "big") { 12 } else { 8 };
        let code = |parts: u32| parts as u16;
        // SAFETY: the functions only store their arguments in a structure.
        let mut steps = unsafe {
            [
                BPF_STMT(code(BPF_LD | BPF_W | BPF_ABS), std::mem::offset_of!(libc::seccomp_data, nr) as u32),
                BPF_JUMP(code(BPF_JMP | BPF_JEQ | BPF_K), SYS_futex as u32, 0, 4),
                BPF_STMT(code(BPF_LD | BPF_W | BPF_ABS), op as u32),
                BPF_STMT(code(BPF_ALU | BPF_AND | BPF_K), FUTEX_CMD_MASK as u32),
                BPF_JUMP(code(BPF_JMP | BPF_JEQ | BPF_K), FUTEX_WAKE as u32, 0, 1),
                BPF_STMT(code(BPF_RET | BPF_K), SECCOMP_RET_KILL_THREAD),
                BPF_STMT(code(BPF_RET | BPF_K), SECCOMP_RET_ALLOW),
            ]
        };
        let program = libc::sock_fprog { len: steps.len() as u16, filter: steps.as_mut_ptr() };
        // SAFETY: the filter is for this thread alone, and the system copies it.
        unsafe {
            assert_eq!(libc::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0), 0);
            assert_eq!(libc::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &raw const program), 0);
        }
    }

    /// LIB-70 A thread is ended by force while it wakes the recorder's thread. All other threads go on recording, their
    /// frames are written, and the recording ends.
    #[test]
    fn a_thread_that_is_ended_while_it_records_hinders_nobody() {
        let written = Arc::new(AtomicU64::new(0));
        let meta = RecordMeta::begun("test:".to_owned(), None, false, Stamp(0));
        let sink = Sink::Other(Box::new(Counted(Arc::clone(&written))));
        let recorder = Arc::new(Recorder::begin("test", sink, &meta, super::super::QUEUE, None).expect("it begins"));
        for _ in 0..3 {
            let (tells, told) = mpsc::channel();
            let recording = Arc::clone(&recorder);
            std::thread::spawn(move || {
                tells.send(CallingThread::current()).expect("the test waits for it");
                end_where_it_wakes();
                loop {
                    // After this pause the recorder's thread sleeps, or will sleep before it sees the next entry.
                    std::thread::sleep(LOOK_INTERVAL);
                    record(&recording);
                }
            });
            let caller = told.recv().expect("it tells");
            while !caller.is_gone() {
                std::thread::sleep(LOOK_INTERVAL);
            }
            record(&recorder);
        }
        let before = written.load(Ordering::SeqCst);
        (0..50).for_each(|_| record(&recorder));
        recorder.finish();
        assert_eq!(recorder.dropped(), 0);
        assert!(written.load(Ordering::SeqCst) >= before + 50 * 512);
    }
}
