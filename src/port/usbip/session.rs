//! One host that has the board: its connection, and the two threads that move frames between it and the link.
//!
//! The thread of the connection reads what the host hands over, and takes the report that there is by then; one thread
//! waits for reports as long as the host wants one, one gives frames to the board. Answers go out in the order in which
//! the device made them, whoever sends them.

use std::io::{self, BufReader, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use parking_lot::{Condvar, Mutex};

use super::descriptors::Descriptors;
use super::device::{Counters, Device, TooMany};
use super::stream::Stream;
use super::wire::{Command, Direction, HEADER_LEN, WireError};
use crate::link::{Dir, Link, LinkError, Wait};
use crate::sk::Frame;

/// How long one wait of a link may last: a host that takes a frame back or goes is then noticed, should it have come just
/// before the wait began. \[OURS]
const SLICE: Duration = Duration::from_millis(50);

/// Bytes of the host that are read at once.
const READ_AHEAD: usize = 16 * 1024;

/// Why a host's time with the board ended.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum End {
    /// The host closed the connection, or it broke.
    #[error("the host detached the board")]
    Detached,
    /// The host took nothing of what it was sent.
    #[error("the host read nothing for {0:?}; is it stopped? Attach the board again")]
    NeverReads(Duration),
    /// What the host sent is not the protocol.
    #[error(transparent)]
    Nonsense(#[from] WireError),
    /// The host named another device.
    #[error("a command is for device {found:#010x}, this one is {expected:#010x}; is the client one for USB/IP?")]
    OtherDevice {
        /// What it said.
        found: u32,
        /// What the board was called.
        expected: u32,
    },
    /// The host handed over too much.
    #[error(transparent)]
    TooMany(#[from] TooMany),
    /// The board is gone.
    #[error("{0}")]
    LinkLost(LinkError),
    /// The server stops.
    #[error("the server stops")]
    Stopped,
}

/// A host and the board it has.
pub struct Session {
    stream: Stream,
    link: Arc<dyn Link>,
    device_id: u32,
    never_reads: Duration,
    device: Mutex<Device>,
    /// The host wants a report.
    reads: Condvar,
    /// There is a frame for the board.
    writes: Condvar,
    /// Answers on their way. Whoever sends holds it, and takes the device's lock after it, never before.
    sending: Mutex<Vec<u8>>,
    over: AtomicBool,
    end: Mutex<Option<End>>,
}

impl Session {
    /// A host that has just got the board.
    pub fn new(
        stream: Stream,
        link: Arc<dyn Link>,
        descriptors: Descriptors,
        device_id: u32,
        never_reads: Duration,
    ) -> Self {
        Self {
            stream,
            link,
            device_id,
            never_reads,
            device: Mutex::new(Device::new(descriptors)),
            reads: Condvar::new(),
            writes: Condvar::new(),
            sending: Mutex::default(),
            over: AtomicBool::new(false),
            end: Mutex::new(None),
        }
    }

    /// Sends what comes before the traffic. A host that is gone already is noticed by [`Self::run`].
    pub fn greet(&self, answer: &[u8]) {
        let _ = (&mut &self.stream).write_all(answer);
    }

    /// Moves frames until the host or the board goes, or [`Self::end`] is called.
    pub fn run(&self) -> End {
        if self.stream.for_traffic(self.never_reads).is_err() {
            self.end(End::Detached);
        }
        thread::scope(|scope| {
            // They begin with the signal mask of this thread, which takes none.
            let pump = |name: &str, work: fn(&Self)| {
                let started = thread::Builder::new().name(name.into()).spawn_scoped(scope, move || work(self));
                if let Err(error) = started {
                    self.end(End::LinkLost(LinkError::Io {
                        what: "start a thread for the board".into(),
                        message: error.to_string(),
                    }));
                }
            };
            pump("usbip-in", Self::move_reports);
            pump("usbip-out", Self::move_frames);
            let end = self.receive();
            self.end(end);
        });
        self.end.lock().clone().unwrap_or(End::Detached)
    }

    /// Ends the session, from any thread. The first reason counts.
    pub fn end(&self, why: End) {
        self.end.lock().get_or_insert(why);
        self.over.store(true, Ordering::Release);
        self.stream.shutdown();
        // With the lock held nobody is between looking and waiting.
        {
            let _device = self.device.lock();
            self.reads.notify_all();
            self.writes.notify_all();
        }
        self.link.cancel(Dir::Read);
        self.link.cancel(Dir::Write);
    }

    /// What was moved so far.
    pub fn counters(&self) -> Counters {
        self.device.lock().counters()
    }

    fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }

    /// Reads what the host hands over, until there is no more.
    fn receive(&self) -> End {
        let mut input = BufReader::with_capacity(READ_AHEAD, &self.stream);
        let mut header = [0; HEADER_LEN];
        let mut data = Vec::new();
        let mut report = Frame::new();
        loop {
            if input.read_exact(&mut header).is_err() {
                return End::Detached;
            }
            let answered = match Command::parse(&header) {
                Err(error) => return error.into(),
                Ok(Command::Submit(transfer)) => {
                    if transfer.device != self.device_id {
                        return self.other_device(transfer.device);
                    }
                    data.clear();
                    if transfer.direction == Direction::Out {
                        data.resize(transfer.length as usize, 0);
                        if input.read_exact(&mut data).is_err() {
                            return End::Detached;
                        }
                    }
                    let mut device = self.device.lock();
                    if let Err(error) = device.submit(&transfer, &data) {
                        return error.into();
                    }
                    // One that is there already needs no other thread.
                    if device.begin_read() {
                        drop(device);
                        if let Err(end) = self.read(&mut report, Wait::Now) {
                            return end;
                        }
                        device = self.device.lock();
                    }
                    self.wake(&device);
                    device.has_replies()
                }
                Ok(Command::Unlink { sequence, device, victim }) => {
                    if device != self.device_id {
                        return self.other_device(device);
                    }
                    let under_way = self.device.lock().unlink(sequence, victim);
                    if under_way {
                        self.link.cancel(Dir::Write);
                    }
                    !under_way
                }
            };
            // Without an answer of its own a transfer does not wait until another thread has sent its.
            if answered {
                self.send();
            }
        }
    }

    fn other_device(&self, found: u32) -> End {
        End::OtherDevice { found, expected: self.device_id }
    }

    fn wake(&self, device: &Device) {
        if device.wants_report() {
            self.reads.notify_one();
        }
        if device.has_frame() {
            self.writes.notify_one();
        }
    }

    /// Sends the answers that there are. If another thread is about to, this one waits for it.
    fn send(&self) {
        let mut answers = self.sending.lock();
        loop {
            {
                let mut device = self.device.lock();
                if !device.has_replies() {
                    return;
                }
                device.take_replies(&mut answers);
            }
            match (&mut &self.stream).write_all(&answers) {
                Ok(()) => {}
                Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                    return self.end(End::NeverReads(self.never_reads));
                }
                Err(_) => return self.end(End::Detached),
            }
        }
    }

    /// Gives the host the board's reports, one for each that it asks for.
    fn move_reports(&self) {
        let mut report = Frame::new();
        loop {
            let kept = {
                let mut device = self.device.lock();
                while !self.is_over() && !device.begin_read() {
                    self.reads.wait(&mut device);
                }
                device.report_waits()
            };
            if self.is_over() {
                return;
            }
            // A report that was read for a transfer which then was taken back is still the newest one, or is not.
            let wait = if kept { Wait::Now } else { Wait::For(SLICE) };
            if let Err(end) = self.read(&mut report, wait) {
                return self.end(end);
            }
            self.send();
        }
    }

    /// Ends what [`Device::begin_read`] began.
    fn read(&self, report: &mut Frame, wait: Wait) -> Result<(), End> {
        match self.link.read(report, wait) {
            Ok(_) => self.device.lock().report(report),
            Err(error) if passes(&error) => self.device.lock().deliver(),
            Err(error) => return Err(End::LinkLost(error)),
        }
        Ok(())
    }

    /// Gives the board the host's frames, one after the other. While the board does not take one the host's transfer is
    /// held.
    fn move_frames(&self) {
        let mut frame = Frame::new();
        loop {
            {
                let mut device = self.device.lock();
                while !self.is_over() && !device.begin_write(&mut frame) {
                    self.writes.wait(&mut device);
                }
            }
            if self.is_over() {
                return;
            }
            match self.link.write(&frame, Wait::For(SLICE)) {
                Ok(_) => self.device.lock().written(),
                Err(error) if passes(&error) => self.device.lock().not_written(),
                Err(error) => return self.end(End::LinkLost(error)),
            }
            self.send();
        }
    }
}

/// Whether the board may do what it did not do in this wait.
const fn passes(error: &LinkError) -> bool {
    matches!(error, LinkError::Timeout { .. } | LinkError::Cancelled { .. } | LinkError::Silent { .. })
}
