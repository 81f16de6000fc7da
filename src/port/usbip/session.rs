//! A host that has attached a board: its connection, and the threads that pass frames between it and the link.
//!
//! The thread of the connection receives the host's transfers. If a transfer asks for a report and the link already has
//! one, this thread reads the report itself. A second thread waits for reports while the host wants one, and a third
//! writes frames to the board. Whichever of these threads sends them, answers are sent in the order in which the device
//! makes them.

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
use crate::port::is_temporary;
use crate::port::log_limit::RefusedFrames;
use crate::sk::Frame;

/// The longest single wait on the link. `Link::cancel` ends only a wait in progress, so a cancellation that comes just
/// before a wait begins is noticed after this time. \[OURS]
const WAIT_SLICE: Duration = Duration::from_millis(50);

/// The size of the buffer for the host's bytes, in bytes.
const INPUT_BUFFER_BYTES: usize = 16 * 1024;

/// The reason why a host no longer has the board.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SessionEnd {
    /// The host closed the connection, or it broke.
    #[error("the host detached the board")]
    Detached,
    /// The host has accepted no bytes for this long.
    #[error("the host read nothing for {0:?}; is it stopped? Attach the board again")]
    SendTimeout(Duration),
    /// The host has sent something that is not USB/IP.
    #[error(transparent)]
    InvalidMessage(#[from] WireError),
    /// A command of the host names another device.
    #[error("a command is for device {found:#010x}, this one is {expected:#010x}; is the client one for USB/IP?")]
    OtherDevice {
        /// The device number in the command.
        found: u32,
        /// The number of the device that the host has attached.
        expected: u32,
    },
    /// The host has submitted too many transfers.
    #[error(transparent)]
    TooMany(#[from] TooMany),
    /// The board was lost: the error of its link says why.
    #[error("{0}")]
    LinkLost(LinkError),
    /// The server was stopped.
    #[error("the server stops")]
    Stopped,
}

/// The session of a host that has attached a board.
pub struct Session {
    stream: Stream,
    link: Arc<dyn Link>,
    device_id: u32,
    send_timeout: Duration,
    device: Mutex<Device>,
    /// Wakes the thread that waits for reports, when the host wants one.
    reads: Condvar,
    /// Wakes the thread that passes frames to the board.
    writes: Condvar,
    /// The answers that are being sent. A thread that holds this lock may lock `device`. A thread that holds `device`
    /// must not wait for this lock, because two threads could then wait for each other.
    sending: Mutex<Vec<u8>>,
    over: AtomicBool,
    end: Mutex<Option<SessionEnd>>,
}

impl Session {
    /// Creates the session of a host that has just attached the board.
    pub fn new(
        stream: Stream,
        link: Arc<dyn Link>,
        descriptors: Descriptors,
        device_id: u32,
        send_timeout: Duration,
    ) -> Self {
        Self {
            stream,
            link,
            device_id,
            send_timeout,
            device: Mutex::new(Device::new(descriptors)),
            reads: Condvar::new(),
            writes: Condvar::new(),
            sending: Mutex::default(),
            over: AtomicBool::new(false),
            end: Mutex::new(None),
        }
    }

    /// Sends the answer to the request to attach the board, after which the host submits transfers. If the host is
    /// gone, [`Self::run`] notices it.
    pub fn greet(&self, answer: &[u8]) {
        let _ = (&mut &self.stream).write_all(answer);
    }

    /// Passes frames on until the host or the board is gone, or until [`Self::end`].
    pub fn run(&self) -> SessionEnd {
        if self.stream.for_traffic(self.send_timeout).is_err() {
            self.end(SessionEnd::Detached);
        }
        thread::scope(|scope| {
            // New threads inherit the signal mask of this thread, which blocks all signals, so that the program's
            // signal handlers do not run in them.
            let pump = |name: &str, work: fn(&Self)| {
                let started = thread::Builder::new().name(name.into()).spawn_scoped(scope, move || work(self));
                if let Err(error) = started {
                    self.end(SessionEnd::LinkLost(LinkError::Io {
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
        self.end.lock().clone().unwrap_or(SessionEnd::Detached)
    }

    /// Ends the session from any thread. The first reason is kept.
    pub fn end(&self, why: SessionEnd) {
        self.end.lock().get_or_insert(why);
        self.over.store(true, Ordering::Release);
        self.stream.shutdown();
        // While this lock is held, no thread is between its check of `over` and its wait, so no thread misses the
        // notification.
        {
            let _device = self.device.lock();
            self.reads.notify_all();
            self.writes.notify_all();
        }
        self.link.cancel(Dir::Read);
        self.link.cancel(Dir::Write);
    }

    /// The counters of the host's transfers since it has attached the board.
    pub fn counters(&self) -> Counters {
        self.device.lock().counters()
    }

    fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }

    /// Receives the host's commands until the connection ends.
    fn receive(&self) -> SessionEnd {
        let mut input = BufReader::with_capacity(INPUT_BUFFER_BYTES, &self.stream);
        let mut header = [0; HEADER_LEN];
        let mut data = Vec::new();
        let mut report = Frame::new();
        loop {
            if input.read_exact(&mut header).is_err() {
                return SessionEnd::Detached;
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
                            return SessionEnd::Detached;
                        }
                    }
                    let mut device = self.device.lock();
                    if let Err(error) = device.submit(&transfer, &data) {
                        return error.into();
                    }
                    // A report that is waiting already is fetched here, without waking the other thread.
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
            // `send` waits while another thread is sending. Without an answer to send this thread skips it, and handles
            // the host's next command at once.
            if answered {
                self.send();
            }
        }
    }

    fn other_device(&self, found: u32) -> SessionEnd {
        SessionEnd::OtherDevice { found, expected: self.device_id }
    }

    fn wake(&self, device: &Device) {
        if device.wants_report() {
            self.reads.notify_one();
        }
        if device.has_frame() {
            self.writes.notify_one();
        }
    }

    /// Sends the pending answers. If another thread is sending, this one waits for it.
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
                    return self.end(SessionEnd::SendTimeout(self.send_timeout));
                }
                Err(_) => return self.end(SessionEnd::Detached),
            }
        }
    }

    /// Fetches reports from the board, one for each transfer in which the host wants one.
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
            // A report whose transfer was unlinked is kept. If there is no newer one, it goes to the next transfer.
            let wait = if kept { Wait::Now } else { Wait::For(WAIT_SLICE) };
            if let Err(end) = self.read(&mut report, wait) {
                return self.end(end);
            }
            self.send();
        }
    }

    /// Reads a report for the device, after [`Device::begin_read`].
    fn read(&self, report: &mut Frame, wait: Wait) -> Result<(), SessionEnd> {
        match self.link.read(report, wait) {
            Ok(_) => self.device.lock().report(report),
            Err(error) if is_temporary(&error) => self.device.lock().deliver(),
            Err(error) => return Err(SessionEnd::LinkLost(error)),
        }
        Ok(())
    }

    /// Passes the host's frames to the board, one after the other. While the board does not take a frame, the host's
    /// transfer is not completed. If the link refuses a frame, its transfer ends with a stall, so the host learns that
    /// its write has failed.
    fn move_frames(&self) {
        let mut refused_frames = RefusedFrames::default();
        self.move_frames_until_over(&mut refused_frames);
        refused_frames.end().iter().for_each(|line| log::warn!("{line}"));
    }

    fn move_frames_until_over(&self, refused_frames: &mut RefusedFrames) {
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
            match self.link.write(&frame, Wait::For(WAIT_SLICE)) {
                Ok(_) => self.device.lock().written(),
                Err(error) if is_temporary(&error) => self.device.lock().not_written(),
                Err(error) if self.link.check().is_ok() => {
                    refused_frames.lines(&error).iter().for_each(|line| log::warn!("{line}"));
                    self.device.lock().refused();
                }
                Err(error) => return self.end(SessionEnd::LinkLost(error)),
            }
            self.send();
        }
    }
}
