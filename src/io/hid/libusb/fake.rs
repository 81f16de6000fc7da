//! A simulated libusb with one device, for tests. The test decides which reports the device sends, accepts and refuses,
//! and when it is unplugged.

mod functions;

use std::cell::Cell;
use std::collections::VecDeque;
use std::ffi::c_int;
use std::io::{Read as _, Write as _};
use std::os::fd::{AsRawFd as _, RawFd};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::api::{RawTransfer, status};
use super::bus::Bus;
use super::{FoundDevice, REPORT_LEN, UsbError, find};

pub const VENDOR: u16 = 0x16C0;
pub const PRODUCT: u16 = 0x05DF;

const NO_DEVICE: c_int = -4;

/// How the device reacts to a report from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportReaction {
    /// The device accepts the report.
    All,
    /// The device does not accept the report. `moved` bytes have been transferred when the host cancels the transfer.
    None { moved: usize },
    /// The endpoint stalls and does not accept the report. It stays halted until the host clears the halt.
    Nothing,
}

/// A transfer that has ended and whose callback was not called yet.
struct Ending {
    transfer: *mut RawTransfer,
    status: c_int,
    moved: usize,
    bytes: Vec<u8>,
}

// SAFETY: the pointers are those of transfers, which may be used from any thread.
unsafe impl Send for Inside {}

struct Inside {
    /// The submitted transfers that have not ended, the oldest first.
    pending: Vec<*mut RawTransfer>,
    endings: VecDeque<Ending>,
    to_send: VecDeque<(c_int, Vec<u8>)>,
    reaction: ReportReaction,
    taken: Vec<[u8; REPORT_LEN]>,
    halted: bool,
    halts_cleared: Vec<u8>,
    interrupted: bool,
    /// How many of the next waits for events end as if by a signal to the program.
    signals: u32,
    /// How many of the next waits for events fail with an error.
    event_errors: u32,
    /// Number of waits for events so far.
    event_waits: u64,
    /// A socket that is readable while there is an event, and its other end; `None`: libusb offers no file descriptor,
    /// so callers wait inside libusb.
    bell: Option<(UnixStream, UnixStream)>,
    rung: bool,
    gone: bool,
    /// How many functions of libusb were called so far.
    calls: usize,
    /// The device is unplugged at the call of libusb with this number.
    pulled_at: usize,
    /// Return codes to use instead of the real ones, each with the name of its function.
    answers: Vec<(&'static str, c_int)>,
    /// How many contexts, devices, handles, claims and transfers exist, in this order. What still exists at the end of
    /// a test has leaked.
    leaked: [isize; 5],
    /// An action during the next submission of a transfer; see [`FakeUsb::at_next_submit`].
    hook: Option<Box<dyn FnOnce() + Send>>,
    cancels: usize,
    /// The function that answers the host's packets; see [`FakeUsb::on_packet`].
    answer_packet: Option<PacketAnswer>,
    /// The device's answers to packets that the host has not received yet.
    packets: VecDeque<Vec<u8>>,
}

type PacketAnswer = Box<dyn FnMut(&[u8]) -> Vec<u8> + Send>;

/// A simulated libusb with one bus and one device.
pub struct FakeUsb {
    inside: Mutex<Inside>,
    changed: Condvar,
}

thread_local! {
    static NEXT: Cell<Option<&'static FakeUsb>> = const { Cell::new(None) };
}

impl FakeUsb {
    /// Creates a bus with its device, which exist until the test program ends.
    pub fn new() -> &'static Self {
        Box::leak(Box::new(Self {
            inside: Mutex::new(Inside {
                pending: Vec::new(),
                endings: VecDeque::new(),
                to_send: VecDeque::new(),
                reaction: ReportReaction::All,
                taken: Vec::new(),
                halted: false,
                halts_cleared: Vec::new(),
                interrupted: false,
                gone: false,
                signals: 0,
                event_errors: 0,
                event_waits: 0,
                bell: None,
                rung: false,
                calls: 0,
                pulled_at: usize::MAX,
                answers: Vec::new(),
                leaked: [0; 5],
                hook: None,
                cancels: 0,
                answer_packet: None,
                packets: VecDeque::new(),
            }),
            changed: Condvar::new(),
        }))
    }

    /// Like [`Self::new`], with a file descriptor for events, as the real libusb has.
    pub fn with_descriptor() -> &'static Self {
        let world = Self::new();
        world.inside.lock().bell = Some(UnixStream::pair().expect("two sockets"));
        world
    }

    /// The file descriptor of [`Self::with_descriptor`].
    pub fn descriptor(&self) -> RawFd {
        self.inside.lock().bell.as_ref().expect("it has one").0.as_raw_fd()
    }

    /// Opens the bus as the code under test does.
    pub fn bus(&'static self) -> Result<Arc<Bus>, UsbError> {
        NEXT.set(Some(self));
        Bus::over(&functions::FAKE)
    }

    /// Finds the device as the code under test does.
    #[track_caller]
    pub fn found(&'static self) -> FoundDevice {
        let bus = self.bus().expect("it opens");
        find(&bus, VENDOR, PRODUCT).expect("it lists").pop().expect("it is there")
    }

    fn with<T>(&self, work: impl FnOnce(&mut Inside) -> T) -> T {
        let mut inside = self.inside.lock();
        let done = work(&mut inside);
        inside.ring();
        drop(inside);
        self.changed.notify_all();
        done
    }

    /// Makes the device send `bytes`. The transfer that receives them ends with libusb's status `status`.
    pub fn send(&self, status: c_int, bytes: &[u8]) {
        self.with(|inside| {
            inside.to_send.push_back((status, bytes.to_vec()));
            inside.deliver();
        });
    }

    pub fn set_reaction(&self, reaction: ReportReaction) {
        self.with(|inside| inside.reaction = reaction);
    }

    /// Makes the device accept the pending reports, which it has not accepted so far.
    pub fn accept_pending(&self) {
        self.with(|inside| {
            let (reports, others) = std::mem::take(&mut inside.pending).into_iter().partition(|one| !to_host(*one));
            inside.pending = others;
            let reports: Vec<_> = reports;
            for transfer in reports {
                inside.taken.push(report_of(transfer));
                inside.end(transfer, status::COMPLETED, REPORT_LEN, Vec::new());
            }
        });
    }

    /// Unplugs the device: all submitted transfers end with libusb's status for a missing device, and so do later
    /// calls.
    pub fn pull(&self) {
        self.with(Inside::pull);
    }

    /// Unplugs the device during the call of libusb with this number, counted from 1.
    pub fn pull_at(&self, call: usize) {
        self.with(|inside| inside.pulled_at = call);
    }

    /// Ends the next `times` waits for events as if by a signal to the program.
    pub fn signal(&self, times: u32) {
        self.with(|inside| inside.signals = times);
    }

    /// Makes the next `times` waits for events fail, beginning with a wait that is already running.
    pub fn fail_events(&self, times: u32) {
        self.with(|inside| inside.event_errors = times);
    }

    /// The number of waits for events so far.
    pub fn event_waits(&self) -> u64 {
        self.inside.lock().event_waits
    }

    /// Makes all calls of the function `name` return `code` from now on.
    pub fn answer(&self, name: &'static str, code: c_int) {
        self.with(|inside| inside.answers.push((name, code)));
    }

    /// Ends the effect of [`FakeUsb::answer`]: all functions return their real results again.
    pub fn answers_as_it_is(&self) {
        self.with(|inside| inside.answers.clear());
    }

    /// Sets the function that makes the device's answer to a packet of the host. If it returns no bytes, the device
    /// does not answer.
    pub fn on_packet(&self, answer: impl FnMut(&[u8]) -> Vec<u8> + Send + 'static) {
        self.with(|inside| inside.answer_packet = Some(Box::new(answer)));
    }

    /// Runs `work` during the next submission of a transfer.
    pub fn at_next_submit(&self, work: impl FnOnce() + Send + 'static) {
        self.with(|inside| inside.hook = Some(Box::new(work)));
    }

    /// Waits until a transfer was cancelled, for at most `limit`. Returns without an error if none was.
    pub fn wait_for_a_cancel(&self, limit: Duration) {
        let mut inside = self.inside.lock();
        if inside.cancels == 0 {
            self.changed.wait_for(&mut inside, limit);
        }
    }

    /// Waits until exactly `count` transfers are submitted. Panics after 20 s.
    #[track_caller]
    pub fn until_pending(&self, count: usize) {
        let mut inside = self.inside.lock();
        while inside.pending.len() != count {
            let late = self.changed.wait_for(&mut inside, Duration::from_secs(20)).timed_out();
            assert!(!late, "{} transfers wait, not {count}", inside.pending.len());
        }
    }

    pub fn calls(&self) -> usize {
        self.inside.lock().calls
    }

    pub fn taken(&self) -> Vec<[u8; REPORT_LEN]> {
        self.inside.lock().taken.clone()
    }

    pub fn halts_cleared(&self) -> Vec<u8> {
        self.inside.lock().halts_cleared.clone()
    }

    /// How many contexts, devices, handles, claims and transfers exist, in this order; all 0 if nothing has leaked.
    pub fn leaked(&self) -> [isize; 5] {
        self.inside.lock().leaked
    }

    fn enter(&self, name: &str) -> Result<MutexGuard<'_, Inside>, c_int> {
        let mut inside = self.inside.lock();
        inside.calls += 1;
        if inside.calls == inside.pulled_at {
            inside.pull();
            inside.ring();
            self.changed.notify_all();
        }
        if let Some((_, code)) = inside.answers.iter().find(|(other, _)| *other == name) {
            return Err(*code);
        }
        if inside.gone { Err(NO_DEVICE) } else { Ok(inside) }
    }

    fn count(&self, what: usize, change: isize) {
        self.inside.lock().leaked[what] += change;
    }
}

impl Inside {
    /// Makes the event descriptor readable while there is an event, and unreadable otherwise.
    fn ring(&mut self) {
        let Some((mut read, mut write)) = self.bell.as_ref().map(|(read, write)| (read, write)) else { return };
        let wanted = !self.endings.is_empty() || self.interrupted || self.event_errors > 0 || self.signals > 0;
        match (self.rung, wanted) {
            (false, true) => write.write_all(&[0]).expect("there is room"),
            (true, false) => read.read_exact(&mut [0]).expect("it is there"),
            _ => {}
        }
        self.rung = wanted;
    }

    fn pull(&mut self) {
        self.gone = true;
        for transfer in std::mem::take(&mut self.pending) {
            self.end(transfer, status::NO_DEVICE, 0, Vec::new());
        }
    }

    fn end(&mut self, transfer: *mut RawTransfer, status: c_int, moved: usize, bytes: Vec<u8>) {
        self.endings.push_back(Ending { transfer, status, moved, bytes });
    }

    fn deliver(&mut self) {
        while let Some(at) = self.pending.iter().position(|transfer| to_host(*transfer)) {
            let Some((status, bytes)) = self.to_send.pop_front() else { return };
            let transfer = self.pending.remove(at);
            self.end(transfer, status, bytes.len(), bytes);
        }
    }

    fn output(&mut self, transfer: *mut RawTransfer) {
        match self.reaction {
            ReportReaction::All if !self.halted => {
                self.taken.push(report_of(transfer));
                self.end(transfer, status::COMPLETED, REPORT_LEN, Vec::new());
            }
            ReportReaction::None { .. } => self.pending.push(transfer),
            ReportReaction::All | ReportReaction::Nothing => {
                self.halted = true;
                self.end(transfer, status::STALL, 0, Vec::new());
            }
        }
    }
}

fn to_host(transfer: *mut RawTransfer) -> bool {
    // SAFETY: a submitted transfer is valid.
    unsafe { (*transfer).endpoint & 0x80 != 0 }
}

fn report_of(transfer: *mut RawTransfer) -> [u8; REPORT_LEN] {
    // SAFETY: a submitted transfer is valid, and its buffer has the length of a report.
    unsafe { *(*transfer).buffer.cast::<[u8; REPORT_LEN]>() }
}
