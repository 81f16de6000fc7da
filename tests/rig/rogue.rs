//! A device on this machine's bus that behaves as a test wants, served by the test itself.

use std::collections::VecDeque;
use std::fs;
use std::io::{Read, Write};
use std::net::Shutdown;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};

use ecmsk::port::usbip::descriptors::Descriptors;
use ecmsk::port::usbip::setup::{Request, Setup, descriptor};
use ecmsk::port::usbip::wire::{self, Command, Direction, Status, Submit};
use ecmsk::port::usbip::{Identity, VHCI, free_ports};

use support::served::until;

/// The device's reaction to a transfer.
pub enum Answer {
    /// It sends these bytes, or accepts the received ones.
    Data(Vec<u8>),
    /// Its endpoint stalls.
    Stall,
    /// No answer, as long as it is plugged in.
    Hold,
}

/// How it behaves.
pub struct Manners {
    pub identity: Identity,
    /// Replaces its configuration descriptor.
    pub configuration: Option<Vec<u8>>,
    /// 3: high speed, 2: full speed.
    pub speed: u32,
    /// Answers to the next reads; later ones are held.
    pub sends: VecDeque<Answer>,
    /// The reaction to a frame.
    pub takes: fn(&[u8]) -> Answer,
}

impl Default for Manners {
    fn default() -> Self {
        Self {
            identity: Identity { serial: "ROGUE".into(), ..Identity::default() },
            configuration: None,
            speed: wire::HIGH_SPEED,
            sends: VecDeque::new(),
            takes: |_| Answer::Data(Vec::new()),
        }
    }
}

/// Requests on endpoint 0.
pub type Requests = Arc<Mutex<Vec<Request>>>;

/// Held transfers: number, and whether to the host. The lock's owner may write to the kernel.
type Held = Arc<Mutex<Vec<(u32, bool)>>>;

/// It is plugged in until it is dropped.
pub struct Rogue {
    stream: UnixStream,
    thread: Option<JoinHandle<()>>,
    pub requests: Requests,
    held: Held,
}

impl Rogue {
    /// Plugs it in.
    #[track_caller]
    pub fn plug_in(manners: Manners) -> Self {
        let vhci = PathBuf::from(VHCI);
        let status = fs::read_to_string(vhci.join("status")).expect("the guest has the controller");
        let port = free_ports(&status).next().expect("a free port");
        let (ours, theirs) = UnixStream::pair().expect("sockets");
        // An address other than that of a board of the server.
        let order = format!("{port} {} {} {}", theirs.as_raw_fd(), wire::device_id(7, 7), manners.speed);
        fs::write(vhci.join("attach"), order).expect("the kernel takes it");
        let (requests, held) = (Requests::default(), Held::default());
        let (stream, heard, holds) = (ours.try_clone().expect("a copy"), requests.clone(), held.clone());
        let thread = Some(thread::spawn(move || serve(ours, manners, &heard, &holds)));
        Self { stream, thread, requests, held }
    }

    /// Plugs it in and waits until the kernel has set it up.
    #[track_caller]
    pub fn plug_in_and_wait(manners: Manners) -> Self {
        let rogue = Self::plug_in(manners);
        until("the kernel shows it", || (!plugged_in().is_empty()).then_some(()));
        rogue
    }

    /// Answers the oldest held read with a report.
    #[track_caller]
    pub fn send(&self, report: &[u8; 512]) {
        self.end_held(true, report);
    }

    /// Accepts the oldest held frame.
    #[track_caller]
    pub fn take(&self) {
        self.end_held(false, &[]);
    }

    #[track_caller]
    fn end_held(&self, to_host: bool, data: &[u8]) {
        let mut held = self.held.lock().expect("no panic there");
        let at = held.iter().position(|other| other.1 == to_host).expect("it holds one");
        let mut reply = Vec::new();
        wire::ret_submit(&mut reply, held.remove(at).0, Status::Done, 512, data);
        (&self.stream).write_all(&reply).expect("it is plugged in");
    }

    /// Endpoints whose halt was cleared.
    pub fn halts_cleared(&self) -> Vec<u8> {
        let requests = self.requests.lock().expect("no panic there");
        let cleared = requests.iter().filter_map(|request| match request {
            Request::SetHalt { endpoint, halted: false } => Some(*endpoint),
            _ => None,
        });
        cleared.collect()
    }

    /// Unplugs it, and waits until the kernel has noticed.
    #[track_caller]
    pub fn pull(self) {
        drop(self);
        until("it is gone", || plugged_in().is_empty().then_some(()));
    }
}

impl Drop for Rogue {
    fn drop(&mut self) {
        // The kernel may have closed it.
        let _ = self.stream.shutdown(Shutdown::Both);
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Folders of devices with a board's ids that the kernel has set up.
pub fn plugged_in() -> Vec<PathBuf> {
    let all = fs::read_dir("/sys/bus/usb/devices").into_iter().flatten().flatten().map(|entry| entry.path());
    let says = |folder: &PathBuf, file: &str| fs::read_to_string(folder.join(file)).unwrap_or_default();
    all.filter(|folder| says(folder, "idVendor") == "16c0\n" && says(folder, "idProduct") == "05df\n").collect()
}

fn serve(mut stream: UnixStream, mut manners: Manners, requests: &Requests, held: &Held) {
    let descriptors = Descriptors::new(&manners.identity).expect("its texts are short");
    let mut header = [0; wire::HEADER_LEN];
    while stream.read_exact(&mut header).is_ok() {
        let mut replies = Vec::new();
        let command = Command::parse(&header).expect("the kernel speaks USB/IP");
        let mut data = match &command {
            Command::Submit(transfer) if transfer.direction == Direction::Out => vec![0; transfer.length as usize],
            _ => Vec::new(),
        };
        if stream.read_exact(&mut data).is_err() {
            return;
        }
        let mut held = held.lock().expect("no panic there");
        match command {
            Command::Unlink { sequence, victim, .. } => {
                let was_there = held.iter().any(|other| other.0 == victim);
                held.retain(|other| other.0 != victim);
                wire::ret_unlink(&mut replies, sequence, if was_there { Status::Unlinked } else { Status::Done });
            }
            Command::Submit(transfer) => {
                let to_host = transfer.direction == Direction::In;
                let answer = match (transfer.endpoint, to_host) {
                    (0, _) => control(&transfer, &descriptors, &manners, requests),
                    (_, true) => manners.sends.pop_front().unwrap_or(Answer::Hold),
                    (_, false) => (manners.takes)(&data),
                };
                match answer {
                    Answer::Data(bytes) if to_host => {
                        let moved = bytes.len().min(transfer.length as usize);
                        wire::ret_submit(&mut replies, transfer.sequence, Status::Done, moved as u32, &bytes[..moved]);
                    }
                    Answer::Data(_) => {
                        wire::ret_submit(&mut replies, transfer.sequence, Status::Done, transfer.length, &[]);
                    }
                    Answer::Stall => wire::ret_submit(&mut replies, transfer.sequence, Status::Stall, 0, &[]),
                    Answer::Hold => held.push((transfer.sequence, to_host)),
                }
            }
        }
        if stream.write_all(&replies).is_err() {
            return;
        }
    }
}

fn control(transfer: &Submit, descriptors: &Descriptors, manners: &Manners, requests: &Requests) -> Answer {
    let setup = Setup::parse(transfer.setup);
    requests.lock().expect("no panic there").push(setup.request);
    match setup.request {
        Request::GetDescriptor { kind: descriptor::CONFIGURATION, index: 0 } if manners.configuration.is_some() => {
            let mut bytes = manners.configuration.clone().unwrap_or_default();
            bytes.truncate(setup.length.into());
            Answer::Data(bytes)
        }
        Request::GetDescriptor { kind, index } => match descriptors.get(kind, index) {
            Some(bytes) => Answer::Data(bytes[..bytes.len().min(setup.length.into())].to_vec()),
            None => Answer::Stall,
        },
        Request::GetStatus => Answer::Data(vec![0, 0]),
        _ if transfer.direction == Direction::In => Answer::Stall,
        _ => Answer::Data(Vec::new()),
    }
}
