//! The three threads of the server. One serves the host: events of the controller, requests on endpoint 0 and completed
//! transfers. One serves the board: it reads every report, stops the axes when the host is gone, and opens the board
//! again after a loss. One writes the host's frames to the board.

use std::io;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::host::{Answer, Change, Controller, Gone, Host, Written};
use super::lateness::Lateness;
use super::watched_link::WatchedLink;
use super::{OnVanish, Opener, Options};
use crate::io::gadget::wire::{Event, SETUP_LEN};
use crate::io::gadget::{ControlEndpoint, Direction, End, StepError};
use crate::link::{Dir, Link, LinkError, Wait};
use crate::notes::Notes;
use crate::port::is_temporary;
use crate::port::log_limit::RefusedFrames;
use crate::port::standstill::LeftBoard;
use crate::port::usb_board::descriptors::Descriptors;
use crate::sk::{FRAME_LEN, Frame};
use crate::tcp::Waker;
use crate::tcp::wire::StopEnd;

/// The longest single wait. A cancellation that comes just before a wait begins is noticed at the end of this wait. An
/// endpoint that did not accept a transfer gets the next attempt after this time. \[OURS]
const WAIT_SLICE: Duration = Duration::from_millis(50);

/// The interrupt endpoints of a device controller, with the transfers that have completed.
pub(super) trait Endpoints: Controller + Send {
    /// The next transfer that has completed, if there is one.
    fn next_end(&mut self) -> Option<End>;
    /// Copies the packet that the host has sent last. `packet` has the length that the completed transfer has reported.
    fn copy_received(&self, packet: &mut [u8]);
}

/// Makes the board visible to a host, or hides it.
pub(super) trait Port: Send + Sync {
    /// Makes the board visible: a host that is connected, or that connects later, finds it.
    fn plug_in(&self) -> Result<(), StepError>;
    /// Hides the board. A host sees this as an unplugged device.
    fn pull(&self);
}

/// The host, and the endpoints that it uses. Threads give transfers to the endpoints only under the lock of
/// `Service::bus`, so that host and endpoints agree.
struct Bus {
    host: Host,
    transfers: Box<dyn Endpoints>,
    /// Whether a frame is being handed to the board.
    is_writing: bool,
    /// The error of a write after which the board is lost. `None`: no write has failed.
    lost: Option<LinkError>,
}

/// The state that the three threads share.
pub(super) struct Service {
    opener: Opener,
    options: Options,
    port: Box<dyn Port>,
    notes: Notes<String>,
    bus: Mutex<Bus>,
    /// Wakes the threads that wait for a frame for the board, for the end of a write, or for the end of the server.
    frames: Condvar,
    link: Mutex<Arc<WatchedLink>>,
    /// The counters of delays when the present host came: the log line at the end of its session gives the increase.
    late_before: Mutex<Lateness>,
    waker: Waker,
    is_stopping: AtomicBool,
    /// Whether axes of a host may still move, because the board was lost before they were stopped.
    left_moving: AtomicBool,
    began: Instant,
    failure: Mutex<Option<io::Error>>,
}

impl Service {
    pub(super) fn new(
        opener: Opener,
        link: Arc<dyn Link>,
        descriptors: Descriptors,
        transfers: Box<dyn Endpoints>,
        port: Box<dyn Port>,
        options: Options,
        notes: Notes<String>,
    ) -> io::Result<Self> {
        Ok(Self {
            opener,
            options,
            port,
            notes,
            bus: Mutex::new(Bus { host: Host::new(descriptors), transfers, is_writing: false, lost: None }),
            frames: Condvar::new(),
            late_before: Mutex::new(Lateness::of(&link.stats())),
            link: Mutex::new(Arc::new(WatchedLink::new(link))),
            waker: Waker::new()?,
            is_stopping: AtomicBool::new(false),
            left_moving: AtomicBool::new(false),
            began: Instant::now(),
            failure: Mutex::default(),
        })
    }

    /// Makes the board visible to a host.
    pub(super) fn plug_in(&self) -> Result<(), StepError> {
        self.port.plug_in()
    }

    /// Makes all threads end, and hides the board from its host.
    pub(super) fn stop(&self) {
        self.is_stopping.store(true, Ordering::Release);
        self.port.pull();
        self.waker.wake();
        // Waits on the link are not cancelled: they end by themselves within a time limit, and the thread of the board
        // still has to stop the axes over this link. While this lock is held, no thread is between its check of
        // `is_stopping` and its wait on `frames`, so no thread misses the notification.
        let _bus = self.bus.lock();
        self.frames.notify_all();
    }

    /// Closes the link of the board. Called after the threads have ended, because they use it.
    pub(super) fn close_board(&self) {
        self.link().close_board();
    }

    /// Takes the error for which the server has ended by itself; `None`: the server has not ended by itself.
    pub(super) fn take_failure(&self) -> Option<io::Error> {
        self.failure.lock().take()
    }

    /// The body of the thread that serves the host. `ended` becomes readable when a transfer has completed.
    pub(super) fn serve_host(&self, control: &ControlEndpoint, ended: &OwnedFd) {
        // The result is ignored here: the board's thread applies the same settings, and logs those that the system
        // refuses.
        let _ = self.options.real_time.apply();
        let slice = Timespec { tv_sec: 0, tv_nsec: WAIT_SLICE.as_nanos() as _ };
        while !self.is_stopping() {
            let [events, ends, woken] = [
                PollFd::new(control, PollFlags::IN),
                PollFd::new(ended, PollFlags::IN),
                PollFd::new(self.waker.waited(), PollFlags::IN),
            ];
            // After an interrupted wait the calls below find no event and no completed transfer, and the loop waits
            // again.
            let _ = poll(&mut [events, ends, woken], Some(&slice));
            self.waker.seen();
            if let Err(error) = self.take_events(control) {
                return self.fail(error);
            }
            self.take_ends();
        }
    }

    /// Handles the pending events of the controller, oldest first.
    fn take_events(&self, control: &ControlEndpoint) -> io::Result<()> {
        while let Some(event) = control.next_event()? {
            match event {
                Event::Setup(setup) => self.answer(control, setup),
                event => self.event(event),
            }
        }
        Ok(())
    }

    /// Handles an event other than a request. Handles the transfers that have completed so far first, because they
    /// belong to the session that this event may end. Otherwise a frame of that session could start axes that were just
    /// stopped.
    pub(super) fn event(&self, event: Event) {
        let mut bus = self.bus.lock();
        self.take_ends_of(&mut bus);
        let Bus { host, transfers, .. } = &mut *bus;
        let change = host.event(event, self.began.elapsed(), transfers.as_mut());
        drop(bus);
        self.tell_change(change);
    }

    /// Returns the answer to a request on endpoint 0.
    pub(super) fn setup(&self, setup: [u8; SETUP_LEN]) -> Answer {
        self.bus.lock().host.setup(setup)
    }

    /// Handles the data of a request after [`Answer::Take`].
    pub(super) fn control_data(&self, setup: [u8; SETUP_LEN], data: &[u8]) {
        self.bus.lock().host.control_data(setup, data);
        self.frames.notify_all();
    }

    /// Answers a request. The lock is not held while the kernel transfers the bytes, because a slow host must not block
    /// the other threads.
    fn answer(&self, control: &ControlEndpoint, setup: [u8; SETUP_LEN]) {
        match self.setup(setup) {
            Answer::Data(bytes) => control.answer(&bytes),
            Answer::Acknowledge => control.acknowledge(),
            Answer::Stall { to_host } => control.stall(to_host),
            Answer::Take(length) => {
                let mut bytes = [0; FRAME_LEN];
                let bytes = &mut bytes[..length.min(FRAME_LEN)];
                if let Some(count) = control.take(bytes) {
                    self.control_data(setup, &bytes[..count]);
                }
            }
        }
    }

    fn tell_change(&self, change: Option<Change>) {
        if matches!(change, Some(Change::Came | Change::Woke)) {
            *self.late_before.lock() = Lateness::of(&self.link().stats());
        }
        match change {
            Some(Change::Came) => self.tell("a host has the board"),
            Some(Change::Woke) => self.tell("the host is awake"),
            // The board's thread logs the end of the session, and stops the axes.
            Some(Change::Went) | None => {}
        }
    }

    /// Handles the transfers that have completed.
    pub(super) fn take_ends(&self) {
        self.take_ends_of(&mut self.bus.lock());
    }

    fn take_ends_of(&self, bus: &mut Bus) {
        let now = self.began.elapsed();
        let Bus { host, transfers, .. } = bus;
        let mut failed = false;
        while let Some(end) = transfers.next_end() {
            match (end.direction, end.result) {
                (Direction::In, Ok(_)) => host.sent(true, now, transfers.as_mut()),
                (Direction::Out, Ok(count)) => {
                    let mut packet = [0; FRAME_LEN];
                    let packet = &mut packet[..count.min(FRAME_LEN)];
                    transfers.copy_received(packet);
                    host.received(packet, now, transfers.as_mut());
                }
                (Direction::In, Err(error)) if error.raw_os_error() == Some(libc::ECONNRESET) => {
                    host.sent(false, now, transfers.as_mut());
                }
                // The endpoint is disabled, for example because the host has gone. An event reports the reason; without
                // one the next attempt follows after `WAIT_SLICE`.
                (direction, Err(_)) => {
                    failed = true;
                    if direction == Direction::In {
                        host.not_sent();
                    }
                }
            }
        }
        if !failed {
            host.arm(now, transfers.as_mut());
        }
        if host.has_frame() {
            self.frames.notify_all();
        }
    }

    /// The body of the thread that writes frames to the board, one after the other. Until the board accepts a frame,
    /// the controller receives no further one.
    pub(super) fn move_frames(&self) {
        // The result is ignored here: the board's thread applies the same settings, and logs those that the system
        // refuses.
        let _ = self.options.real_time.apply();
        let (mut frame, mut refused_frames) = (Frame::new(), RefusedFrames::default());
        while let Some(generation) = self.next_frame(&mut frame) {
            let link = self.link();
            let written = link.write(&frame, Wait::For(WAIT_SLICE));
            let mut bus = self.bus.lock();
            let Bus { host, transfers, is_writing, lost } = &mut *bus;
            *is_writing = false;
            let written = match written {
                Ok(_) => Written::Taken,
                Err(error) if is_temporary(&error) => Written::Not,
                Err(error) if link.check().is_ok() => {
                    refused_frames.lines(&error).iter().for_each(|line| self.tell(line));
                    Written::Refused
                }
                Err(error) => {
                    host.close();
                    *lost = Some(error);
                    Written::Not
                }
            };
            host.write_ended(generation, written, self.began.elapsed(), transfers.as_mut());
            drop(bus);
            self.frames.notify_all();
        }
        refused_frames.end().iter().for_each(|line| self.tell(line));
    }

    /// Waits for the next frame of the host; `None`: the server ends.
    fn next_frame(&self, frame: &mut Frame) -> Option<u64> {
        let mut bus = self.bus.lock();
        loop {
            if self.is_stopping() {
                return None;
            }
            if let Some(generation) = bus.host.begin_write(frame) {
                bus.is_writing = true;
                return Some(generation);
            }
            self.frames.wait(&mut bus);
        }
    }

    /// The body of the thread that serves the board.
    pub(super) fn serve_board(&self) {
        self.options.real_time.apply().iter().for_each(|line| self.tell(line));
        let mut report = Frame::new();
        while !self.is_stopping() {
            let (gone, lost) = {
                let mut bus = self.bus.lock();
                (bus.host.take_gone(), bus.lost.take())
            };
            if let Some(gone) = &gone {
                self.tell_gone(gone);
                self.stop_axes(&format!("the host is gone ({})", gone.why));
            }
            if let Some(error) = lost {
                self.reopen(&error);
                continue;
            }
            if gone.is_some() {
                self.open();
                continue;
            }
            let link = self.link();
            match link.read(&mut report, Wait::For(WAIT_SLICE)) {
                Ok(_) => {
                    let mut bus = self.bus.lock();
                    let Bus { host, transfers, .. } = &mut *bus;
                    host.report(&report, self.began.elapsed(), transfers.as_mut());
                }
                Err(error) if is_temporary(&error) => {
                    if let Err(error) = link.check() {
                        self.reopen(&error);
                    }
                }
                Err(error) => self.reopen(&error),
            }
        }
        self.stop_axes("the server was stopped");
    }

    fn open(&self) {
        let mut bus = self.bus.lock();
        let Bus { host, transfers, .. } = &mut *bus;
        host.open(self.began.elapsed(), transfers.as_mut());
        // A frame may already wait from before the opening, so the thread that writes frames has to check.
        self.frames.notify_all();
    }

    /// Stops passing reports and frames, cancels a write in progress, and waits for its end. Returns whether axes may
    /// move because of frames of a host.
    fn close(&self) -> bool {
        self.link().cancel(Dir::Write);
        let mut bus = self.bus.lock();
        bus.host.close();
        while bus.is_writing {
            self.frames.wait(&mut bus);
        }
        bus.host.take_has_written()
    }

    /// If frames of a host may have moved axes, brings these axes to a standstill; `why` is the reason for the log. If
    /// that fails, the server stops the axes when the board is back.
    fn stop_axes(&self, why: &str) {
        let (has_written, was_left) = (self.close(), self.left_moving.swap(false, Ordering::AcqRel));
        if (has_written || was_left) && !self.bring_to_standstill(why) {
            self.left_moving.store(true, Ordering::Release);
        }
    }

    /// Brings the axes to a standstill, unless they are to be left as they are. Returns `false` if that failed and has
    /// to be repeated when the board is back.
    fn bring_to_standstill(&self, why: &str) -> bool {
        let link = self.link();
        let watch = || link.watch();
        let shared: Arc<dyn Link> = link.clone();
        let left = LeftBoard { link: shared, watch: &watch, who: why, tell: &|line| self.tell(line) };
        // `LeftBoard` has logged how the stop has ended.
        match left.bring_to_standstill(self.options.on_vanish) {
            Some(ended) => ended.end != StopEnd::Failed,
            None => self.options.on_vanish == OnVanish::Leave,
        }
    }

    /// Hides a lost board from its host, and makes it visible again when its link can be opened.
    fn reopen(&self, error: &LinkError) {
        // A link can fail without its board being gone: then the axes that the host has moved can still be stopped. The
        // axes of a lost board cannot be reached, and are stopped when the board is back.
        if self.link().check().is_ok() {
            self.stop_axes("the board's link has failed");
        } else if self.close() {
            self.left_moving.store(true, Ordering::Release);
        }
        // Discards the error that a write on the old link has left: otherwise the new link would count as lost.
        self.bus.lock().lost = None;
        self.port.pull();
        self.tell(&format!("the board is lost, {error}; for its host it is pulled; waiting for its return"));
        // The kernel's event may come only when the board is back, and a frame that waits must not reach that board.
        self.event(Event::Unbound);
        let gone = self.bus.lock().host.take_gone();
        gone.iter().for_each(|gone| self.tell_gone(gone));
        self.close_board();
        let mut told = String::new();
        while !self.is_stopping() {
            match self.come_back() {
                Ok(()) => return self.tell("the board is back"),
                Err(why) if why != told => {
                    self.tell(&format!("the board cannot be shown yet: {why}"));
                    told = why;
                }
                Err(_) => {}
            }
            let mut bus = self.bus.lock();
            if !self.is_stopping() {
                self.frames.wait_for(&mut bus, self.options.retry);
            }
        }
    }

    /// Opens the link of the board, stops axes that have kept moving meanwhile, and makes the board visible to a host.
    /// An error is the reason for the log.
    fn come_back(&self) -> Result<(), String> {
        let link = (self.opener)().map_err(|error| error.to_string())?;
        let again = Arc::new(self.link().reopened(link));
        *self.link.lock() = again;
        if self.left_moving.load(Ordering::Acquire) {
            self.stop_axes("the board was lost");
        }
        if let Err(error) = self.plug_in() {
            self.close_board();
            return Err(error.to_string());
        }
        self.open();
        Ok(())
    }

    fn link(&self) -> Arc<WatchedLink> {
        Arc::clone(&self.link.lock())
    }

    fn is_stopping(&self) -> bool {
        self.is_stopping.load(Ordering::Acquire)
    }

    fn tell(&self, line: &str) {
        self.notes.push(line.to_owned());
    }

    fn tell_gone(&self, gone: &Gone) {
        let Gone { why, frames, reports, hung } = gone;
        let hung = if *hung { "; it hung after an OUT packet of fewer than 512 bytes, as the board does" } else { "" };
        let now = Lateness::of(&self.link().stats());
        let late = now.since(std::mem::replace(&mut *self.late_before.lock(), now));
        self.tell(&format!("the host is gone, {why}; {frames} frames out, {reports} reports in{hung}{late}"));
    }

    fn fail(&self, error: io::Error) {
        if !self.is_stopping() {
            *self.failure.lock() = Some(error);
            (self.options.failed)();
        }
    }
}
