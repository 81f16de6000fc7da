//! State of the USB host at the other end of the cable, derived from the events and completed transfers of this
//! machine's device controller. This is state without I/O and waits; the caller passes the time.
//!
//! The controller holds at most one report for the host, and accepts one frame at a time. It answers the host with NAK
//! on the IN endpoint while it has no report, and on the OUT endpoint while the board has not accepted the previous
//! frame. The requests and transfers of the host go to the USB device model that USB/IP uses too.

use std::fmt;
use std::time::Duration;

use crate::io::gadget::wire::{Event, SETUP_LEN};
use crate::port::usb_board::descriptors::{Descriptors, IN, OUT};
use crate::port::usb_board::device::{Device, TRANSFERS_AT_ONCE};
use crate::port::usb_board::setup::{Request, Setup, report};
use crate::port::usb_board::transfer::{Direction, Ends, Status, Transfer};
use crate::sk::{FRAME_LEN, Frame};

/// The age at which a report that the host has not fetched is replaced by a newer one. A reading host fetches a report
/// within 125 us. Without the replacement, a host that begins to read would get an outdated report first. \[OURS]
const REPLACE_AFTER: Duration = Duration::from_millis(20);

/// The sequence numbers that this file gives to transfers, one for each use. They tell [`Ended`] which transfer has
/// completed.
const CONTROL: u32 = 0;
const REPORT: u32 = 1;
const FRAME: u32 = 2;
const FRAME_BY_CONTROL: u32 = 3;

/// What [`Host`] needs of a device controller: its two interrupt endpoints, IN for reports and OUT for frames.
pub(super) trait Controller {
    /// Whether the controller holds a report that the host has not fetched.
    fn is_sending(&self) -> bool;
    /// Whether the OUT endpoint is ready: the controller will accept the host's next frame.
    fn is_receiving(&self) -> bool;
    /// Gives the controller a report for the host.
    fn send(&mut self, report: &[u8; FRAME_LEN]);
    /// Cancels the transfer of the report that the controller holds. The result of that transfer says whether the host
    /// has fetched the report before the cancellation.
    fn take_back(&mut self);
    /// Makes the OUT endpoint ready to accept a frame of the host.
    fn receive(&mut self);
}

/// Results of completed transfers that the owner of the device model has not handled yet.
#[derive(Debug, Default)]
struct Ended {
    report: Option<Frame>,
    /// The answer to a control request; `Some(None)` is a stall, `None`: no control request has completed.
    control: Option<Option<Vec<u8>>>,
    frame: bool,
    frames_by_control: usize,
}

impl Ends for Ended {
    fn ended(&mut self, sequence: u32, status: Status, _moved: u32, data: &[u8]) {
        match sequence {
            REPORT if status == Status::Done => self.report = Some(Frame::from_prefix(data)),
            CONTROL => self.control = Some((status == Status::Done).then(|| data.to_vec())),
            FRAME => self.frame = true,
            FRAME_BY_CONTROL => self.frames_by_control += 1,
            _ => {}
        }
    }

    fn unlinked(&mut self, _sequence: u32, _status: Status) {}
}

/// Whether a host is connected, and awake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Presence {
    Away,
    There,
    Asleep,
}

/// Why a host no longer uses the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Why {
    /// The host is unplugged or switched off, or has reset the device or deselected its configuration: the kernel does
    /// not say which.
    Detached,
    /// The host has selected the configuration again. A new session begins, so the previous one has ended.
    Configured,
    /// The bus is idle: the host sleeps, or its controller has stopped. Some device controllers report a pulled cable
    /// as an idle bus first, and as [`Event::Disabled`] later.
    Asleep,
}

impl fmt::Display for Why {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Detached => "it was unplugged, or has reset the board",
            Self::Configured => "it has configured the board anew",
            Self::Asleep => "it sleeps, or was unplugged",
        })
    }
}

/// The session of a host that no longer uses the board: why it has ended, and its counters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Gone {
    pub why: Why,
    /// The number of frames that the board has accepted from this host.
    pub frames: u64,
    /// The number of reports that this host has fetched.
    pub reports: u64,
    /// Whether the board hung, because the host has sent a short packet.
    pub hung: bool,
}

/// How a write of a frame to the board has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Written {
    /// The board has accepted the frame.
    Taken,
    /// The link has refused this frame, but may accept the next one. The host does not learn of the refusal: the device
    /// controller has already acknowledged the packet.
    Refused,
    /// The board has not accepted the frame. The frame is kept for the next attempt.
    Not,
}

/// How an event has changed the presence of the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// A host has selected the configuration: it can use the board.
    Came,
    /// A host that slept is awake, and can use the board again.
    Woke,
    /// The host can no longer use the board; [`Host::take_gone`] has the reason.
    Went,
}

/// The answer to a request on endpoint 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// The request succeeds, and these bytes go to the host.
    Data(Vec<u8>),
    /// The caller has to read this many bytes from the host and pass them to [`Host::control_data`].
    Take(usize),
    /// The request succeeds without a data stage.
    Acknowledge,
    /// The request is refused.
    Stall {
        /// The direction in the setup packet: whether the data stage goes to the host. To stall endpoint 0, the server
        /// has to try a transfer in the other direction.
        to_host: bool,
    },
}

/// The host, and the USB device model that it uses.
#[derive(Debug)]
pub(super) struct Host {
    descriptors: Descriptors,
    device: Device<Ended>,
    presence: Presence,
    /// Whether reports and frames are passed between host and board; `false` while axes are being stopped, or while the
    /// link to the board is lost.
    is_open: bool,
    /// The generation of the device model, which rises with each new model. The result of a write is ignored if its
    /// frame came through an earlier model.
    generation: u64,
    /// Whether a frame that the host has sent to the OUT endpoint waits for the board.
    frame_waits: bool,
    /// How many frames that came on endpoint 0 (SET_REPORT) wait for the board, in addition to `frame_waits`.
    control_frames: usize,
    /// The time at which the controller got the report that it holds.
    given: Duration,
    is_taken_back: bool,
    reports: u64,
    /// Whether the board has accepted a frame since the axes were stopped last: if so, axes may move.
    has_written: bool,
    gone: Option<Gone>,
}

impl Host {
    pub(super) fn new(descriptors: Descriptors) -> Self {
        Self {
            device: Device::over(descriptors.clone(), Ended::default()),
            descriptors,
            presence: Presence::Away,
            is_open: true,
            generation: 0,
            frame_waits: false,
            control_frames: 0,
            given: Duration::ZERO,
            is_taken_back: false,
            reports: 0,
            has_written: false,
            gone: None,
        }
    }

    /// Handles an event of the USB function other than a request. Returns how the event has changed the presence of the
    /// host; `None`: the presence is unchanged.
    pub(super) fn event(&mut self, event: Event, now: Duration, controller: &mut dyn Controller) -> Option<Change> {
        match event {
            Event::Enabled => {
                let change = if self.presence == Presence::There { Change::Went } else { Change::Came };
                self.leave(Why::Configured);
                self.arrive(now, controller);
                Some(change)
            }
            Event::Disabled | Event::Unbound => {
                let was_there = self.presence != Presence::Away;
                self.leave(Why::Detached);
                self.presence = Presence::Away;
                was_there.then_some(Change::Went)
            }
            Event::Suspended if self.presence == Presence::There => {
                self.leave(Why::Asleep);
                self.presence = Presence::Asleep;
                Some(Change::Went)
            }
            Event::Resumed if self.presence == Presence::Asleep => {
                self.arrive(now, controller);
                Some(Change::Woke)
            }
            _ => None,
        }
    }

    /// Returns the answer to a request on endpoint 0.
    pub(super) fn setup(&mut self, bytes: [u8; SETUP_LEN]) -> Answer {
        let setup = Setup::parse(bytes);
        let has_data = !setup.to_host && setup.length > 0;
        if has_data {
            let is_report = matches!(setup.request, Request::SetReport { kind: report::OUTPUT, id: 0 });
            // After [`Answer::Take`] the kernel acknowledges the request to the host. So a frame that the device model
            // cannot store any more has to be refused here.
            let has_room = self.control_frames + 1 < TRANSFERS_AT_ONCE && !self.device.hangs();
            return match usize::from(setup.length) {
                FRAME_LEN if is_report && has_room => Answer::Take(FRAME_LEN),
                _ => Answer::Stall { to_host: false },
            };
        }
        match self.control(CONTROL, bytes, &setup, &[]) {
            Some(data) if setup.to_host => Answer::Data(data),
            Some(_) => Answer::Acknowledge,
            None => Answer::Stall { to_host: setup.to_host },
        }
    }

    /// Handles the data of a request after [`Answer::Take`]. The kernel has already acknowledged the request to the
    /// host, so it can no longer be refused.
    pub(super) fn control_data(&mut self, bytes: [u8; SETUP_LEN], data: &[u8]) {
        self.control_frames += 1;
        self.control(FRAME_BY_CONTROL, bytes, &Setup::parse(bytes), data);
        self.count_ends();
    }

    /// Passes a request to the device model. Returns the bytes of the answer; `None` if the model refuses the request,
    /// or answers it only when the board has accepted the frame in it.
    fn control(&mut self, sequence: u32, bytes: [u8; SETUP_LEN], setup: &Setup, data: &[u8]) -> Option<Vec<u8>> {
        let direction = if setup.to_host && setup.length > 0 { Direction::In } else { Direction::Out };
        let transfer = Transfer { sequence, direction, endpoint: 0, length: setup.length.into(), setup: bytes };
        self.device.transfer(&transfer, data).ok()?;
        self.device.ends_mut().control.take().flatten()
    }

    /// Stores a new report of the board and gives it to the controller for the host if the controller holds none. A
    /// report that the controller has held for [`REPLACE_AFTER`] is taken back. While passing is stopped
    /// ([`Self::close`]), the report is dropped.
    pub(super) fn report(&mut self, report: &Frame, now: Duration, controller: &mut dyn Controller) {
        if !self.is_open {
            return;
        }
        self.device.report(report);
        self.arm(now, controller);
        let is_old = now.saturating_sub(self.given) >= REPLACE_AFTER;
        if is_old && !self.is_taken_back && self.device.report_waits() && controller.is_sending() {
            self.is_taken_back = true;
            controller.take_back();
        }
    }

    /// Handles the end of the controller's transfer of a report: counts the report if the host has fetched it, and
    /// gives the controller the newest report. `was_fetched` is false if the transfer was cancelled.
    pub(super) fn sent(&mut self, was_fetched: bool, now: Duration, controller: &mut dyn Controller) {
        self.is_taken_back = false;
        self.reports += u64::from(was_fetched && self.presence != Presence::Away);
        self.arm(now, controller);
    }

    /// Handles the failure of the controller's transfer of a report by an error other than a cancellation.
    pub(super) const fn not_sent(&mut self) {
        self.is_taken_back = false;
    }

    /// Handles a packet that the controller has received on the OUT endpoint: passes it to the device model. The
    /// controller accepts no further packet until the board has accepted this frame. Without a host the packet is
    /// dropped.
    pub(super) fn received(&mut self, packet: &[u8], now: Duration, controller: &mut dyn Controller) {
        if self.presence == Presence::Away {
            return;
        }
        let transfer = Transfer {
            sequence: FRAME,
            direction: Direction::Out,
            endpoint: OUT,
            length: packet.len() as u32,
            setup: [0; SETUP_LEN],
        };
        // The device model cannot refuse this transfer for lack of room: no other transfer of the OUT endpoint is
        // pending, and `setup` refuses frames on endpoint 0 that would use the last of the model's entries for OUT
        // transfers.
        self.frame_waits = self.device.transfer(&transfer, packet).is_ok();
        self.settle(now, controller);
    }

    /// Copies the next frame for the board into `frame`. Returns the generation that the caller passes to
    /// [`Self::write_ended`]; `None`: there is no frame, or [`Self::close`] has stopped the passing of frames.
    pub(super) fn begin_write(&mut self, frame: &mut Frame) -> Option<u64> {
        (self.is_open && self.device.begin_write(frame)).then_some(self.generation)
    }

    /// Handles the result of a write to the board.
    pub(super) fn write_ended(
        &mut self,
        generation: u64,
        written: Written,
        now: Duration,
        controller: &mut dyn Controller,
    ) {
        // The board may have got a part of a frame that its link has refused, so axes may move.
        self.has_written |= written != Written::Not;
        if generation != self.generation {
            return;
        }
        match written {
            Written::Taken => self.device.written(),
            Written::Refused => self.device.refused(),
            Written::Not => self.device.not_written(),
        }
        self.settle(now, controller);
    }

    /// Whether a frame of the host waits for the board and [`Self::close`] has not stopped the passing of frames.
    pub(super) fn has_frame(&self) -> bool {
        self.is_open && self.device.has_frame()
    }

    /// The session that has ended, once: later calls return `None` until another session ends.
    pub(super) fn take_gone(&mut self) -> Option<Gone> {
        self.gone.take()
    }

    /// Whether axes may move because of frames of a host. The call resets the answer to false.
    pub(super) fn take_has_written(&mut self) -> bool {
        std::mem::take(&mut self.has_written)
    }

    /// Stops passing reports and frames between host and board until [`Self::open`].
    pub(super) fn close(&mut self) {
        self.is_open = false;
    }

    /// Passes reports and frames again. If another host has gone meanwhile, reports and frames stay blocked until the
    /// axes of that host are stopped, too.
    pub(super) fn open(&mut self, now: Duration, controller: &mut dyn Controller) {
        self.is_open = self.gone.is_none();
        self.arm(now, controller);
    }

    /// Gives the controller the newest report if it holds none, and makes the OUT endpoint ready if no frame waits for
    /// the board.
    pub(super) fn arm(&mut self, now: Duration, controller: &mut dyn Controller) {
        if self.presence != Presence::There || !self.is_open || self.device.hangs() {
            return;
        }
        if !controller.is_sending() {
            self.next_report();
            if let Some(report) = self.device.ends_mut().report.take() {
                self.given = now;
                controller.send(report.bytes());
            }
        }
        if !self.frame_waits && !controller.is_receiving() {
            controller.receive();
        }
    }

    /// Gives the device model an IN transfer for the newest report, unless one is pending or has completed.
    fn next_report(&mut self) {
        if self.device.ends().report.is_some() {
            return;
        }
        if !self.device.wants_report() {
            let (endpoint, length) = (IN & 0x0F, FRAME_LEN as u32);
            let transfer =
                Transfer { sequence: REPORT, direction: Direction::In, endpoint, length, setup: [0; SETUP_LEN] };
            // This cannot fail for lack of room: no other IN transfer is pending.
            let _ = self.device.transfer(&transfer, &[]);
        }
        self.device.deliver();
    }

    fn settle(&mut self, now: Duration, controller: &mut dyn Controller) {
        self.count_ends();
        if self.device.hangs() && controller.is_sending() {
            controller.take_back();
        }
        self.arm(now, controller);
    }

    fn count_ends(&mut self) {
        let ends = self.device.ends_mut();
        self.frame_waits &= !std::mem::take(&mut ends.frame);
        self.control_frames = self.control_frames.saturating_sub(std::mem::take(&mut ends.frames_by_control));
    }

    fn arrive(&mut self, now: Duration, controller: &mut dyn Controller) {
        self.presence = Presence::There;
        self.device.select_configuration();
        self.arm(now, controller);
    }

    /// Ends the session of the host. The next host starts with a new device model, without frames and reports of this
    /// host.
    fn leave(&mut self, why: Why) {
        if self.presence == Presence::There {
            let counters = self.device.counters();
            let gone = Gone { why, frames: counters.frames, reports: self.reports, hung: counters.short_packets > 0 };
            self.gone.get_or_insert(gone);
            self.is_open = false;
        }
        self.device = Device::over(self.descriptors.clone(), Ended::default());
        self.generation += 1;
        (self.frame_waits, self.control_frames, self.reports) = (false, 0, 0);
    }
}
