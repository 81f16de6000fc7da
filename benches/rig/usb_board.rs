//! A board on this machine's virtual USB host controller: it sends back each frame, or its own number each so often.
//! It takes every frame at once, and keeps reads waiting as long as it has no report.

use std::collections::VecDeque;
use std::fs;
use std::io::{Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use ecmsk::port::usbip::descriptors::Descriptors;
use ecmsk::port::usbip::setup::{Request, Setup};
use ecmsk::port::usbip::wire::{self, Command, Direction, Status, Submit};
use ecmsk::port::usbip::{Identity, VHCI, free_ports};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::other::{Other, READY};

/// What is different of boards on one bus.
#[derive(Clone, Copy)]
pub enum Which {
    Links,
    Synchronous,
    Queued,
}

impl Which {
    pub const fn product(self) -> u16 {
        match self {
            Self::Links => 0x05DF,
            Self::Synchronous => 0x05DE,
            Self::Queued => 0x05DD,
        }
    }
}

/// A board until it is dropped; `period`: `None` is one that sends back frames.
pub fn plug_in(which: Which, period: Option<Duration>) -> Other {
    static PLUGGED_IN: AtomicU32 = AtomicU32::new(0);

    let period = period.unwrap_or_default().as_micros().to_string();
    // None that was there before has its serial number.
    let serial = format!("{}-{}", std::process::id(), PLUGGED_IN.fetch_add(1, Ordering::Relaxed));
    let other = Other::start(&["usb-board", &which.product().to_string(), &period, &serial]);
    let limit = Instant::now() + Duration::from_secs(60);
    while !set_up(which.product(), &serial) {
        assert!(Instant::now() < limit, "the kernel shows it");
        std::thread::sleep(Duration::from_millis(10));
    }
    other
}

/// Whether the kernel's driver has the board, before which it is not quiet, and the one with its ids that was there before
/// it has gone.
fn set_up(product: u16, serial: &str) -> bool {
    let entries = |folder| fs::read_dir(folder).into_iter().flatten().flatten();
    let devices = entries("/sys/bus/usb/devices").filter(|entry| {
        let says = |name: &str| fs::read_to_string(entry.path().join(name)).unwrap_or_default();
        says("idVendor").trim() == "16c0" && says("idProduct").trim() == format!("{product:04x}")
    });
    let id = format!("HID_ID=0003:000016C0:0000{product:04X}\n");
    let ours = format!("HID_UNIQ={serial}\n");
    devices.count() == 1
        && entries("/sys/class/hidraw")
            .filter_map(|entry| fs::read_to_string(entry.path().join("device/uevent")).ok())
            .any(|facts| facts.contains(&id) && facts.contains(&ours))
}

/// The process that is the board.
pub fn run(words: &[&str]) {
    let [product, period, serial] = words else { panic!("{words:?}") };
    let product = product.parse().expect("a number");
    let period = Duration::from_micros(period.parse().expect("a number"));
    let identity = Identity { product, serial: (*serial).to_owned(), ..Identity::default() };
    let status = fs::read_to_string(Path::new(VHCI).join("status")).expect("the guest has the controller");
    let port = free_ports(&status).next().expect("a free port");
    let (ours, theirs) = UnixStream::pair().expect("sockets");
    let number = wire::device_id(7, product);
    let order = format!("{port} {} {number} {}", theirs.as_raw_fd(), wire::HIGH_SPEED);
    fs::write(Path::new(VHCI).join("attach"), order).expect("the kernel takes it");
    println!("{READY}");
    let board = Board {
        descriptors: Descriptors::new(&identity).expect("its texts are short"),
        waiting: VecDeque::new(),
        reports: VecDeque::new(),
        echo: period.is_zero(),
        replies: Vec::with_capacity(64 * 1024),
    };
    board.serve(ours, period);
}

struct Board {
    descriptors: Descriptors,
    /// Reads of the host.
    waiting: VecDeque<u32>,
    /// Reports that nobody has read, of a board that sends back.
    reports: VecDeque<[u8; 512]>,
    echo: bool,
    replies: Vec<u8>,
}

impl Board {
    fn serve(mut self, mut stream: UnixStream, period: Duration) {
        let mut bytes = vec![0; 64 * 1024];
        let mut len = 0;
        let (mut due, mut number) = (None, 0_u64);
        loop {
            let wait = due.map(|due: Instant| due.saturating_duration_since(Instant::now()));
            let limit = wait.map(|wait| Timespec { tv_sec: wait.as_secs() as _, tv_nsec: wait.subsec_nanos() as _ });
            if poll(&mut [PollFd::new(&stream, PollFlags::IN)], limit.as_ref()).expect("it waits") > 0 {
                match stream.read(&mut bytes[len..]) {
                    Ok(0) | Err(_) => return,
                    Ok(more) => len += more,
                }
                let taken = self.take(&bytes[..len]);
                bytes.copy_within(taken..len, 0);
                len -= taken;
            }
            while let Some(now) = due.filter(|due| *due <= Instant::now()) {
                self.report(number);
                number += 1;
                due = Some(now + period);
            }
            if !self.echo && due.is_none() && !self.waiting.is_empty() {
                due = Some(Instant::now() + period);
            }
            if !self.replies.is_empty() && stream.write_all(&self.replies).is_err() {
                return;
            }
            self.replies.clear();
        }
    }

    /// Answers what is whole; gives how many bytes that was.
    fn take(&mut self, bytes: &[u8]) -> usize {
        let mut at = 0;
        while let Some(header) = bytes[at..].first_chunk::<{ wire::HEADER_LEN }>() {
            let data = at + wire::HEADER_LEN;
            match Command::parse(header).expect("the kernel speaks USB/IP") {
                Command::Unlink { sequence, victim, .. } => {
                    let was_there = self.waiting.contains(&victim);
                    self.waiting.retain(|other| *other != victim);
                    let status = if was_there { Status::Unlinked } else { Status::Done };
                    wire::ret_unlink(&mut self.replies, sequence, status);
                    at = data;
                }
                Command::Submit(transfer) if transfer.direction == Direction::Out => {
                    let end = data + transfer.length as usize;
                    let Some(frame) = bytes.get(data..end) else { return at };
                    wire::ret_submit(&mut self.replies, transfer.sequence, Status::Done, transfer.length, &[]);
                    if self.echo && transfer.endpoint != 0 {
                        self.reports.push_back(frame.try_into().expect("512 bytes"));
                        self.send();
                    }
                    at = end;
                }
                Command::Submit(transfer) if transfer.endpoint != 0 => {
                    self.waiting.push_back(transfer.sequence);
                    self.send();
                    at = data;
                }
                Command::Submit(transfer) => {
                    self.control(&transfer);
                    at = data;
                }
            }
        }
        at
    }

    fn send(&mut self) {
        while !self.waiting.is_empty()
            && let Some(report) = self.reports.pop_front()
        {
            self.answer(&report);
        }
    }

    /// A report of this moment: if the host does not read now it never sees it.
    fn report(&mut self, number: u64) {
        let mut report = [0; 512];
        report[..8].copy_from_slice(&number.to_le_bytes());
        self.answer(&report);
    }

    fn answer(&mut self, report: &[u8; 512]) {
        if let Some(sequence) = self.waiting.pop_front() {
            wire::ret_submit(&mut self.replies, sequence, Status::Done, 512, report);
        }
    }

    fn control(&mut self, transfer: &Submit) {
        let setup = Setup::parse(transfer.setup);
        let bytes = match setup.request {
            Request::GetDescriptor { kind, index } => self.descriptors.get(kind, index),
            Request::GetStatus => Some(&[0, 0][..]),
            _ => None,
        };
        match bytes {
            Some(bytes) => {
                let bytes = &bytes[..bytes.len().min(setup.length.into())];
                wire::ret_submit(&mut self.replies, transfer.sequence, Status::Done, bytes.len() as u32, bytes);
            }
            None => wire::ret_submit(&mut self.replies, transfer.sequence, Status::Stall, 0, &[]),
        }
    }
}
