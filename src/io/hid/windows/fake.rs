//! A simulated Windows with HID devices, for tests. The test decides what the devices send, take and refuse, and when they
//! are unplugged.

mod functions;

use std::cell::Cell;
use std::collections::VecDeque;
use std::sync::Arc;

use parking_lot::{Condvar, Mutex};

use super::api::Overlapped;
use super::bus::Bus;
use super::codes::PENDING;
use super::find::Candidate;
use super::{NUMBERED_LEN, UsbError};

pub const VENDOR: u16 = 0x16C0;
pub const PRODUCT: u16 = 0x05DF;
/// `ERROR_OPERATION_ABORTED`
const ABORTED: u32 = 995;

/// What the board does with a report that it is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Takes {
    /// It takes it.
    All,
    /// It does not take it.
    Nothing,
    /// The wire fails: Windows says so by this code.
    Fails(u32),
}

/// A device as Windows lists it.
pub struct Listed {
    /// What stands between `\\?\` and the class: `hid#vid_16c0&pid_05df#7&1&0&0000`.
    pub name: &'static str,
    /// Names of the devices it belongs to, the nearest first.
    pub parents: &'static [&'static str],
    /// Bytes of its reports to the host and to it.
    pub reports: [u16; 2],
}

/// The board of most tests.
pub const BOARD: Listed = Listed {
    name: "hid#vid_16c0&pid_05df#7&1a2b&0&0000",
    parents: &[r"USB\VID_16C0&PID_05DF\0001"],
    reports: [NUMBERED_LEN as u16; 2],
};

/// A transfer that Windows has.
struct Pending {
    overlapped: *mut Overlapped,
    buffer: *mut u8,
    to_host: bool,
}

// SAFETY: the pointers are those of transfers, which any thread may use.
unsafe impl Send for Inside {}

struct Inside {
    devices: Vec<Listed>,
    pending: Vec<Pending>,
    /// Transfers that have ended: which, by which code, how many bytes have moved.
    ended: VecDeque<(*mut Overlapped, u32, usize)>,
    woken: bool,
    /// Events that are set: of the transfer to the device, and of an interruption.
    set: [bool; 2],
    /// The first of a backend's events has been made.
    has_event: bool,
    to_send: VecDeque<Vec<u8>>,
    takes: Takes,
    taken: Vec<Vec<u8>>,
    /// What every call on the board fails by, once it is pulled.
    gone: Option<u32>,
    /// What opening the board to move reports fails by.
    refused: Option<u32>,
    /// Handles, lists and other things that were made and not given back.
    leaked: isize,
    /// Paths that were opened.
    opened: Vec<String>,
    /// Texts that a device was asked for.
    asked: usize,
    /// How many reports the driver was told to keep.
    keeps: Option<u32>,
    /// The call for the next write does not come back before this has gone.
    held: bool,
}

/// The devices and the one board that is opened.
#[repr(align(8))] // Its handles keep something in the lowest bits.
pub struct FakeWindows {
    inside: Mutex<Inside>,
    changed: Condvar,
}

thread_local! {
    static HERE: Cell<Option<&'static FakeWindows>> = const { Cell::new(None) };
}

impl FakeWindows {
    /// A world with these devices, which lives as long as the test program.
    pub fn new(devices: Vec<Listed>) -> &'static Self {
        let inside = Inside {
            devices,
            pending: Vec::new(),
            ended: VecDeque::new(),
            woken: false,
            set: [false; 2],
            has_event: false,
            to_send: VecDeque::new(),
            takes: Takes::All,
            taken: Vec::new(),
            gone: None,
            refused: None,
            leaked: 0,
            opened: Vec::new(),
            asked: 0,
            keeps: None,
            held: false,
        };
        Box::leak(Box::new(Self { inside: Mutex::new(inside), changed: Condvar::new() }))
    }

    /// The devices with the board's ids, as the link sees them.
    pub fn candidates(&'static self) -> Result<Vec<Candidate>, UsbError> {
        HERE.set(Some(self));
        let bus: Arc<Bus> = Bus::over(functions::FAKE);
        super::find::candidates(&bus, VENDOR, PRODUCT)
    }

    fn with<T>(&self, work: impl FnOnce(&mut Inside) -> T) -> T {
        let done = work(&mut self.inside.lock());
        self.changed.notify_all();
        done
    }

    /// The board sends that: number and report.
    pub fn send(&self, number: u8, report: &[u8]) {
        self.with(|inside| {
            inside.to_send.push_back([&[number], report].concat());
            inside.deliver();
        });
    }

    pub fn set_takes(&self, takes: Takes) {
        self.with(|inside| inside.takes = takes);
    }

    /// The call for the next write comes back when [`FakeWindows::let_go`] is called.
    pub fn hold(&self) {
        self.with(|inside| inside.held = true);
    }

    pub fn let_go(&self) {
        self.with(|inside| inside.held = false);
    }

    pub fn refuse(&self, code: u32) {
        self.with(|inside| inside.refused = Some(code));
    }

    /// The board is pulled; calls and transfers fail by that code.
    pub fn pull(&self, code: u32) {
        self.with(|inside| {
            inside.gone = Some(code);
            for pending in std::mem::take(&mut inside.pending) {
                inside.end(pending.overlapped, code, 0);
            }
        });
    }

    /// Waits until Windows has so many transfers.
    pub fn until_pending(&self, count: usize) {
        let mut inside = self.inside.lock();
        while inside.pending.len() != count || !inside.ended.is_empty() {
            self.changed.wait(&mut inside);
        }
    }

    /// Reports that the board was sent, each with its number.
    pub fn taken(&self) -> Vec<Vec<u8>> {
        self.with(|inside| inside.taken.clone())
    }

    pub fn opened(&self) -> Vec<String> {
        self.with(|inside| inside.opened.clone())
    }

    pub fn asked(&self) -> usize {
        self.with(|inside| inside.asked)
    }

    /// Reads that Windows has.
    pub fn reads(&self) -> usize {
        self.with(|inside| inside.pending.iter().filter(|pending| pending.to_host).count())
    }

    pub fn keeps(&self) -> Option<u32> {
        self.with(|inside| inside.keeps)
    }

    /// What was made and not given back.
    pub fn leaked(&self) -> isize {
        self.with(|inside| inside.leaked)
    }
}

impl Inside {
    /// Moves what is to be sent into reads, the oldest first.
    fn deliver(&mut self) {
        while !self.to_send.is_empty() {
            let Some(at) = self.pending.iter().position(|pending| pending.to_host) else { break };
            let (Pending { overlapped, buffer, .. }, bytes) = (self.pending.remove(at), self.to_send.pop_front());
            let bytes = bytes.unwrap_or_default();
            // SAFETY: Windows has the transfer, whose buffer has room for a report.
            unsafe { buffer.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len().min(NUMBERED_LEN)) };
            self.end(overlapped, 0, bytes.len());
        }
        let keeps = self.keeps.map_or(0, |keeps| keeps as usize);
        self.to_send.drain(..self.to_send.len().saturating_sub(keeps));
    }

    /// A write of that report; the code that the function for it fails by.
    fn write(&mut self, overlapped: *mut Overlapped, buffer: *mut u8, report: Vec<u8>) -> u32 {
        if let Some(code) = self.gone {
            return code;
        }
        match self.takes {
            Takes::All => {
                self.end(overlapped, 0, report.len());
                self.taken.push(report);
            }
            Takes::Nothing => self.pending.push(Pending { overlapped, buffer, to_host: false }),
            Takes::Fails(code) => self.end(overlapped, code, 0),
        }
        PENDING
    }

    fn cancel(&mut self, overlapped: *mut Overlapped) -> bool {
        let at = self.pending.iter().position(|pending| pending.overlapped == overlapped);
        if let Some(at) = at {
            self.pending.remove(at);
            self.end(overlapped, ABORTED, 0);
        }
        at.is_some()
    }

    /// A transfer has ended, which its event is told, or the port.
    fn end(&mut self, overlapped: *mut Overlapped, code: u32, moved: usize) {
        // SAFETY: Windows has the transfer.
        let transfer = unsafe { &mut *overlapped };
        (transfer.internal, transfer.internal_high) = (code as usize, moved);
        if transfer.event.addr() & 1 == 0 {
            self.ended.push_back((overlapped, code, moved));
        } else {
            self.set[functions::event(transfer.event)] = true;
        }
    }
}
