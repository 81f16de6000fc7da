//! For tests: a server whose USB device port is in memory. The test acts as the host, and can pull the cable.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex};

use super::host::{Answer, Controller};
use super::service::{Endpoints, Port, Service};
use super::{Opener, Options, ServeError};
use crate::io::gadget::wire::{Event, SETUP_LEN};
use crate::io::gadget::{Direction, End, StepError};
use crate::link::{Dir, Link, LinkError, LinkInfo, LinkStats, ReadMeta, Stamp, Wait};
use crate::notes::{Note, Notes};
use crate::port::usb_board::descriptors::Descriptors;
use crate::sk::{FRAME_LEN, Frame};
use crate::threads;

/// The wires between the host and the board.
#[derive(Default)]
struct Wires {
    is_plugged_in: bool,
    /// The report that the controller has for the host. `None`: the controller holds none.
    report: Option<Frame>,
    /// Whether the OUT endpoint is ready to accept a frame of the host.
    is_receiving: bool,
    received: Vec<u8>,
    ends: Vec<End>,
}

#[derive(Clone, Default)]
struct Cable(Arc<(Mutex<Wires>, Condvar)>);

impl Cable {
    fn with<T>(&self, work: impl FnOnce(&mut Wires) -> T) -> T {
        let done = work(&mut self.0.0.lock());
        self.0.1.notify_all();
        done
    }

    /// Waits until `take` returns a value, but not longer than `limit`. `take` is called again after every change of
    /// the wires; `None`: the time limit has passed.
    fn wait<T>(&self, limit: Duration, mut take: impl FnMut(&mut Wires) -> Option<T>) -> Option<T> {
        let until = Instant::now() + limit;
        let mut wires = self.0.0.lock();
        loop {
            if let Some(taken) = take(&mut wires) {
                return Some(taken);
            }
            if self.0.1.wait_until(&mut wires, until).timed_out() {
                return take(&mut wires);
            }
        }
    }
}

impl Controller for Cable {
    fn is_sending(&self) -> bool {
        self.with(|wires| wires.report.is_some())
    }

    fn is_receiving(&self) -> bool {
        self.with(|wires| wires.is_receiving)
    }

    fn send(&mut self, report: &[u8; FRAME_LEN]) {
        self.with(|wires| wires.report = Some(Frame::from_bytes(*report)));
    }

    fn take_back(&mut self) {
        self.with(|wires| {
            if wires.report.take().is_some() {
                let result = Err(std::io::Error::from_raw_os_error(libc::ECONNRESET));
                wires.ends.push(End { direction: Direction::In, result });
            }
        });
    }

    fn receive(&mut self) {
        self.with(|wires| wires.is_receiving = true);
    }
}

impl Endpoints for Cable {
    fn next_end(&mut self) -> Option<End> {
        self.with(|wires| (!wires.ends.is_empty()).then(|| wires.ends.remove(0)))
    }

    fn copy_received(&self, packet: &mut [u8]) {
        self.with(|wires| packet.copy_from_slice(&wires.received[..packet.len()]));
    }
}

impl Port for Cable {
    fn plug_in(&self) -> Result<(), StepError> {
        self.with(|wires| wires.is_plugged_in = true);
        Ok(())
    }

    fn pull(&self) {
        self.with(|wires| wires.is_plugged_in = false);
    }
}

/// A served board whose host is a test. Dropping it stops the server.
pub struct InMemory {
    service: Arc<Service>,
    cable: Cable,
    notes: Notes<String>,
    threads: Vec<JoinHandle<()>>,
}

/// The error that the board has answered a request on endpoint 0 with a stall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stalled;

impl InMemory {
    /// Opens the link of a board and serves it without a USB device controller.
    ///
    /// # Errors
    /// [`ServeError`]: the link cannot be opened, the identity does not fit into USB descriptors, or the system has no
    /// thread or socket left.
    pub fn start(opener: Opener, options: Options) -> Result<Self, ServeError> {
        let descriptors = Descriptors::new(&options.identity)?;
        let (link, cable, notes) = (opener()?, Cable::default(), Notes::default());
        let (endpoints, port) = (Box::new(cable.clone()), Box::new(cable.clone()));
        let system = |source| ServeError::System { what: "start a server", source };
        let service =
            Arc::new(Service::new(opener, link, descriptors, endpoints, port, options, notes.clone()).map_err(system)?);
        cable.with(|wires| wires.is_plugged_in = true);
        let [frames, reports] = [Arc::clone(&service), Arc::clone(&service)];
        let threads = vec![
            threads::spawn("gadget-frames", move || frames.move_frames()).map_err(system)?,
            threads::spawn("gadget-board", move || reports.serve_board()).map_err(system)?,
        ];
        Ok(Self { service, cable, notes, threads })
    }

    /// Reports an event of the USB function to the server, as the kernel does.
    pub fn event(&self, event: Event) {
        self.service.event(event);
    }

    /// The host at the other end selects the configuration: from now on it can use the board.
    pub fn attach(&self) {
        self.event(Event::Enabled);
    }

    /// The host is gone. As the kernel does, first ends the host's pending transfers, then reports the event to the
    /// server.
    pub fn detach(&self) {
        self.cable.with(|wires| {
            let failed = || Err(std::io::Error::from_raw_os_error(libc::ESHUTDOWN));
            if wires.report.take().is_some() {
                wires.ends.push(End { direction: Direction::In, result: failed() });
            }
            if std::mem::take(&mut wires.is_receiving) {
                wires.ends.push(End { direction: Direction::Out, result: failed() });
            }
        });
        self.event(Event::Disabled);
        self.service.take_ends();
    }

    /// Sends a request on endpoint 0; `data` are the bytes of a request to the device. Returns the bytes that the board
    /// answers.
    ///
    /// # Errors
    /// [`Stalled`]: the board refuses the request.
    pub fn request(&self, setup: [u8; SETUP_LEN], data: &[u8]) -> Result<Vec<u8>, Stalled> {
        match self.service.setup(setup) {
            Answer::Data(bytes) => Ok(bytes),
            Answer::Acknowledge => Ok(Vec::new()),
            Answer::Take(length) => {
                self.service.control_data(setup, &data[..data.len().min(length)]);
                Ok(Vec::new())
            }
            Answer::Stall { .. } => Err(Stalled),
        }
    }

    /// Sends a packet as the host. Returns whether the OUT endpoint has accepted it within `limit`.
    pub fn put(&self, packet: &[u8], limit: Duration) -> bool {
        put(&self.cable, &self.service, packet, limit)
    }

    /// Sends a packet as the host; the server is late and notices it only at the next event or the next transfer. Returns
    /// whether the OUT endpoint has accepted it within `limit`.
    pub fn put_unnoticed(&self, packet: &[u8], limit: Duration) -> bool {
        accept(&self.cable, packet, limit)
    }

    /// Whether the OUT endpoint would accept a packet at once. It does not while the board has not accepted the
    /// previous frame.
    pub fn takes(&self) -> bool {
        self.cable.with(|wires| wires.is_receiving)
    }

    /// Fetches a report as the host; `None`: the board has made none within `limit`.
    pub fn get(&self, limit: Duration) -> Option<Frame> {
        get(&self.cable, &self.service, limit)
    }

    /// A link to the board, as a program on the host opens it.
    pub fn host(&self) -> Arc<dyn Link> {
        let (cable, service) = (self.cable.clone(), Arc::clone(&self.service));
        Arc::new(HostLink { cable, service, began: Instant::now(), next: Mutex::new(0) })
    }

    /// Whether a host can see the board.
    pub fn is_plugged_in(&self) -> bool {
        self.cable.with(|wires| wires.is_plugged_in)
    }

    /// Takes the log lines since the last call.
    pub fn lines(&self) -> Vec<String> {
        let next = || self.notes.take();
        std::iter::from_fn(next)
            .map(|note| match note {
                Note::Item(line) => line,
                Note::Dropped(count) => format!("{count} lines were dropped"),
            })
            .collect()
    }

    /// Stops the server and returns the last lines of its log.
    pub fn stop(mut self) -> Vec<String> {
        self.end();
        self.lines()
    }

    fn end(&mut self) {
        self.service.stop();
        for thread in self.threads.drain(..) {
            // An error is ignored: it means that the thread has panicked, and that was printed when it happened.
            let _ = thread.join();
        }
        self.service.close_board();
    }
}

impl Drop for InMemory {
    fn drop(&mut self) {
        self.end();
    }
}

fn put(cable: &Cable, service: &Service, packet: &[u8], limit: Duration) -> bool {
    let is_taken = accept(cable, packet, limit);
    service.take_ends();
    is_taken
}

fn accept(cable: &Cable, packet: &[u8], limit: Duration) -> bool {
    let taken = cable.wait(limit, |wires| {
        std::mem::take(&mut wires.is_receiving).then(|| {
            wires.received = packet.to_vec();
            wires.ends.push(End { direction: Direction::Out, result: Ok(packet.len()) });
        })
    });
    taken.is_some()
}

fn get(cable: &Cable, service: &Service, limit: Duration) -> Option<Frame> {
    let report = cable.wait(limit, |wires| {
        let report = wires.report.take();
        if report.is_some() {
            wires.ends.push(End { direction: Direction::In, result: Ok(FRAME_LEN) });
        }
        report
    });
    service.take_ends();
    report
}

/// The link of a program at the host.
struct HostLink {
    cable: Cable,
    service: Arc<Service>,
    began: Instant,
    /// The sequence number of the next report, counted from 0.
    next: Mutex<u64>,
}

/// The limit of a wait that should be endless, so that a test fails instead of hanging. No reply in these tests takes
/// that long.
const PATIENCE: Duration = Duration::from_secs(20);

impl HostLink {
    fn now(&self) -> Stamp {
        Stamp(self.began.elapsed().as_nanos() as u64)
    }
}

impl Link for HostLink {
    fn info(&self) -> LinkInfo {
        LinkInfo {
            name: "gadget:".into(),
            slot: None,
            virtual_time: false,
            opened_at: Stamp(0),
            read_wait: Wait::Forever,
            write_wait: Wait::Forever,
        }
    }

    fn write(&self, frame: &Frame, wait: Wait) -> Result<Stamp, LinkError> {
        let limit = wait.limit().unwrap_or(PATIENCE);
        if put(&self.cable, &self.service, frame.bytes(), limit) {
            return Ok(self.now());
        }
        Err(LinkError::Timeout { dir: Dir::Write, waited: limit, what: "the board takes nothing" })
    }

    fn read(&self, out: &mut Frame, wait: Wait) -> Result<ReadMeta, LinkError> {
        let limit = wait.limit().unwrap_or(PATIENCE);
        let Some(report) = get(&self.cable, &self.service, limit) else {
            return Err(LinkError::Timeout { dir: Dir::Read, waited: limit, what: "no report came" });
        };
        out.clone_from(&report);
        let mut next = self.next.lock();
        let sequence = *next;
        *next += 1;
        Ok(ReadMeta { at: self.now(), sequence, ..ReadMeta::default() })
    }

    fn cancel(&self, _dir: Dir) {}

    fn close(&self) {}

    fn check(&self) -> Result<(), LinkError> {
        Ok(())
    }

    fn stats(&self) -> LinkStats {
        LinkStats::default()
    }
}
