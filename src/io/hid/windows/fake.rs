//! A simulated Windows with HID devices, for tests. The test decides which reports the devices send, accept and refuse,
//! and when they are unplugged.

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
/// `ERROR_OPERATION_ABORTED`: the transfer was cancelled.
const ABORTED: u32 = 995;

/// How the board reacts to a report from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportReaction {
    /// The board accepts the report.
    All,
    /// The board does not accept the report, so that the write stays pending.
    Nothing,
    /// The transfer fails on the wire, with this error code of Windows.
    Fails(u32),
}

/// A HID device that the simulated Windows lists.
pub struct Listed {
    /// The part of the device path between `\\?\` and the class, such as `hid#vid_16c0&pid_05df#7&1&0&0000`.
    pub name: &'static str,
    /// The names of the parent devices, the nearest one first.
    pub parents: &'static [&'static str],
    /// The lengths of the reports in bytes, to the host and from the host.
    pub reports: [u16; 2],
}

/// The board that most tests use.
pub const BOARD: Listed = Listed {
    name: "hid#vid_16c0&pid_05df#7&1a2b&0&0000",
    parents: &[r"USB\VID_16C0&PID_05DF\0001"],
    reports: [NUMBERED_LEN as u16; 2],
};

/// A submitted read or write of a report that has not ended.
struct Pending {
    overlapped: *mut Overlapped,
    buffer: *mut u8,
    to_host: bool,
}

// SAFETY: the pointers are those of transfers, which may be used from any thread.
unsafe impl Send for Inside {}

struct Inside {
    devices: Vec<Listed>,
    pending: Vec<Pending>,
    /// Transfers that have ended, each with its error code and the number of bytes transferred.
    ended: VecDeque<(*mut Overlapped, u32, usize)>,
    woken: bool,
    /// Whether a backend's two events are set: the end of the transfer to the device, and the interruption.
    set: [bool; 2],
    /// Whether the backend has created the first of its two events: the next one that it creates is the second.
    has_event: bool,
    to_send: VecDeque<Vec<u8>>,
    reaction: ReportReaction,
    taken: Vec<Vec<u8>>,
    /// The error code that all calls for the board return once it is unplugged; `None`: it is connected.
    gone: Option<u32>,
    /// The error code with which opening the board for reports fails; `None`: it can be opened.
    refused: Option<u32>,
    /// How many handles, lists and other objects exist that the code under test has to free.
    leaked: isize,
    /// The device paths that were opened.
    opened: Vec<String>,
    /// How many texts (product name, serial number) were read from devices.
    asked: usize,
    /// The length of the driver's queue of reports that the code under test has set; `None`: it has set none.
    keeps: Option<u32>,
    /// Whether the next write does not return until [`FakeWindows::let_go`].
    held: bool,
}

/// The simulated Windows with its devices. Only one of them, the board, is opened for reports.
#[repr(align(8))] // The lowest 3 bits of its address are 0, so that handles can use them to distinguish events.
pub struct FakeWindows {
    inside: Mutex<Inside>,
    changed: Condvar,
}

thread_local! {
    static HERE: Cell<Option<&'static FakeWindows>> = const { Cell::new(None) };
}

impl FakeWindows {
    /// Creates a Windows with these devices, which exists until the test program ends.
    pub fn new(devices: Vec<Listed>) -> &'static Self {
        let inside = Inside {
            devices,
            pending: Vec::new(),
            ended: VecDeque::new(),
            woken: false,
            set: [false; 2],
            has_event: false,
            to_send: VecDeque::new(),
            reaction: ReportReaction::All,
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

    /// The devices with the board's ids, as the code under test finds them.
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

    /// Makes the board send a report with the report id `number`.
    pub fn send(&self, number: u8, report: &[u8]) {
        self.with(|inside| {
            inside.to_send.push_back([&[number], report].concat());
            inside.deliver();
        });
    }

    pub fn set_reaction(&self, reaction: ReportReaction) {
        self.with(|inside| inside.reaction = reaction);
    }

    /// Makes the next write return only after [`FakeWindows::let_go`] was called.
    pub fn hold(&self) {
        self.with(|inside| inside.held = true);
    }

    pub fn let_go(&self) {
        self.with(|inside| inside.held = false);
    }

    pub fn refuse(&self, code: u32) {
        self.with(|inside| inside.refused = Some(code));
    }

    /// Unplugs the board. Calls and transfers then fail with this error code.
    pub fn pull(&self, code: u32) {
        self.with(|inside| {
            inside.gone = Some(code);
            for pending in std::mem::take(&mut inside.pending) {
                inside.end(pending.overlapped, code, 0);
            }
        });
    }

    /// Waits until `count` transfers are submitted and have not ended.
    pub fn until_pending(&self, count: usize) {
        let mut inside = self.inside.lock();
        while inside.pending.len() != count || !inside.ended.is_empty() {
            self.changed.wait(&mut inside);
        }
    }

    /// The reports that the board has accepted, each with its report id.
    pub fn taken(&self) -> Vec<Vec<u8>> {
        self.with(|inside| inside.taken.clone())
    }

    pub fn opened(&self) -> Vec<String> {
        self.with(|inside| inside.opened.clone())
    }

    pub fn asked(&self) -> usize {
        self.with(|inside| inside.asked)
    }

    /// How many reads are submitted and have not ended.
    pub fn reads(&self) -> usize {
        self.with(|inside| inside.pending.iter().filter(|pending| pending.to_host).count())
    }

    pub fn keeps(&self) -> Option<u32> {
        self.with(|inside| inside.keeps)
    }

    /// How many handles, lists and other objects exist that the code under test has to free.
    pub fn leaked(&self) -> isize {
        self.with(|inside| inside.leaked)
    }
}

impl Inside {
    /// Delivers the board's reports to pending reads, the oldest first.
    fn deliver(&mut self) {
        while !self.to_send.is_empty() {
            let Some(at) = self.pending.iter().position(|pending| pending.to_host) else { break };
            let (Pending { overlapped, buffer, .. }, bytes) = (self.pending.remove(at), self.to_send.pop_front());
            let bytes = bytes.unwrap_or_default();
            // SAFETY: the transfer is under way, and its buffer has room for a report.
            unsafe { buffer.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len().min(NUMBERED_LEN)) };
            self.end(overlapped, 0, bytes.len());
        }
        let keeps = self.keeps.map_or(0, |keeps| keeps as usize);
        self.to_send.drain(..self.to_send.len().saturating_sub(keeps));
    }

    /// Handles a write of a report to the board. Returns the error code of WriteFile.
    fn write(&mut self, overlapped: *mut Overlapped, buffer: *mut u8, report: Vec<u8>) -> u32 {
        if let Some(code) = self.gone {
            return code;
        }
        match self.reaction {
            ReportReaction::All => {
                self.end(overlapped, 0, report.len());
                self.taken.push(report);
            }
            ReportReaction::Nothing => self.pending.push(Pending { overlapped, buffer, to_host: false }),
            ReportReaction::Fails(code) => self.end(overlapped, code, 0),
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

    /// Ends a transfer: sets its event if it has one, otherwise queues it for the completion port.
    fn end(&mut self, overlapped: *mut Overlapped, code: u32, moved: usize) {
        // SAFETY: the transfer is under way.
        let transfer = unsafe { &mut *overlapped };
        (transfer.internal, transfer.internal_high) = (code as usize, moved);
        if transfer.event.addr() & 1 == 0 {
            self.ended.push_back((overlapped, code, moved));
        } else {
            self.set[functions::event(transfer.event)] = true;
        }
    }
}
