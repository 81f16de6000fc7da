//! The thread of the server of simulated slaves. It owns the slaves and the sockets of the network interfaces.

use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::ServeError;
use super::masters::Masters;
use super::network::Network;
use crate::engine::RealTime;
use crate::ethercat::{CableEnd, FRAME_LEN_MAX, Ns};
use crate::io::ethernet::{Claim, EthernetSocket, LinkState, SocketError};
use crate::link::Dir;
use crate::link::record::NetworkRecording;
use crate::notes::Notes;
use crate::port::log_limit::LogLimit;
use crate::port::serving::Shared;

/// The interval at which the slaves' time advances while no frame comes, and at which their states are logged. \[OURS]
const TICK: Duration = Duration::from_millis(5);
/// The pause after a socket has failed to receive a frame, before the server reads from the sockets again. \[OURS]
const RETRY_PAUSE: Duration = Duration::from_millis(100);
/// The interval at which the server checks whether each interface has a link. \[OURS] It is short, because a real slave
/// closes its port some milliseconds after a loss of the link, long before its process data watchdog expires.
const LINK_PERIOD: Duration = Duration::from_millis(10);

/// A network interface at one end of the line of slaves.
pub(super) struct Port {
    pub(super) interface: String,
    pub(super) socket: EthernetSocket,
    /// Keeps other servers of this program from using the interface.
    pub(super) _claim: Claim,
    /// Whether the cable at this end counts as connected in the simulated network.
    pub(super) is_connected: bool,
    /// When the last frame arrived at this interface. `None`: none has arrived yet.
    pub(super) last_frame: Option<Instant>,
}

/// Where the thread stores the reason if it ends by itself.
pub(super) type Failure = Arc<Mutex<Option<ServeError>>>;

pub(super) struct Service {
    pub(super) network: Network,
    /// The interfaces at the first end and, for a ring, at the last one.
    pub(super) ports: Vec<Port>,
    pub(super) recording: Option<NetworkRecording>,
    pub(super) begin: Instant,
    pub(super) shared: Arc<Shared>,
    pub(super) notes: Notes<String>,
    pub(super) log_limit: LogLimit,
    pub(super) masters: Masters,
    pub(super) next_tick: Instant,
    pub(super) next_look: Instant,
    /// The content of the newest log line about the ring, so that only changes are logged: true if both ends have a
    /// link, false if one end has none; `None`: no line was logged yet.
    pub(super) told_ring: Option<bool>,
    pub(super) answered: u64,
    pub(super) lost: u64,
}

impl Service {
    /// Serves until the server is stopped, or until an interface disappears: then `failure` has the reason.
    pub(super) fn run(mut self, real_time: RealTime, failure: &Failure) {
        real_time.apply().into_iter().for_each(|line| self.notes.push(line));
        // One byte more than the longest frame, to detect longer ones.
        let mut frame = [0; FRAME_LEN_MAX + 1];
        while !self.shared.is_stopping() {
            self.wait();
            self.answer_all(&mut frame);
            let now = Instant::now();
            if now >= self.next_tick {
                self.tick(now);
            }
            if now >= self.next_look
                && let Some(interface) = self.look_at_links(now)
            {
                *failure.lock() = Some(ServeError::Gone { interface });
                break;
            }
        }
        self.network.finish();
        self.network.take_lines().for_each(|line| self.notes.push(line));
        let Self { answered, lost, .. } = self;
        self.notes.push(format!("{answered} frames were answered, {lost} were lost"));
    }

    fn now(&self) -> Ns {
        self.time_of(Instant::now())
    }

    /// Converts an instant to the time of the simulated network.
    fn time_of(&self, at: Instant) -> Ns {
        Ns::try_from(at.duration_since(self.begin).as_nanos()).unwrap_or(Ns::MAX)
    }

    /// Waits until a frame arrives, or until it is time for the next [`Self::tick`].
    fn wait(&mut self) {
        let limit = self.next_tick.saturating_duration_since(Instant::now());
        let limit = Timespec::try_from(limit).ok();
        let [Some(first), Some(last)] = [self.ports.first(), self.ports.last()] else { return };
        let sockets = [&first.socket, &last.socket].map(|socket| PollFd::new(socket, PollFlags::IN));
        let [first, last] = sockets;
        let mut fds = [first, last, PollFd::new(self.shared.waker.waited(), PollFlags::IN)];
        // If the wait fails, the following calls on the sockets report the error.
        let _ = poll(&mut fds, limit.as_ref());
    }

    /// Answers the frames that have arrived, from both ends in turn, until the next tick is due.
    fn answer_all(&mut self, frame: &mut [u8]) {
        let mut has_come = true;
        while has_come {
            has_come = false;
            for (n, end) in CableEnd::BOTH.into_iter().enumerate().take(self.ports.len()) {
                match self.ports[n].socket.take(frame) {
                    Ok(None) => {}
                    Ok(Some(len)) => {
                        has_come = true;
                        // A frame that does not fit into `FRAME_LEN_MAX` is not valid Ethernet, and is ignored.
                        if len <= FRAME_LEN_MAX {
                            self.answer(end, frame, len);
                        }
                    }
                    Err(error) => {
                        self.interface_failed(n, &error);
                        self.next_tick = Instant::now() + RETRY_PAUSE;
                        std::thread::sleep(RETRY_PAUSE);
                    }
                }
            }
            if Instant::now() >= self.next_tick {
                break;
            }
        }
    }

    fn answer(&mut self, end: CableEnd, frame: &mut [u8], len: usize) {
        if !Network::is_masters(&frame[..len]) {
            return;
        }
        let came = Instant::now();
        let now = self.time_of(came);
        self.record(Dir::Write, now, &frame[..len]);
        let source = (end == CableEnd::First).then(|| &frame[6..]);
        if let Some(line) = self.masters.note(source, came) {
            self.notes.push(line);
        }
        let port = &mut self.ports[end as usize];
        port.last_frame = Some(came);
        if !port.is_connected {
            // A frame shows that the interface has a link, before the next check of the link does.
            port.is_connected = true;
            self.network.connect(end, true);
        }
        match self.network.answer(end, frame, len, now) {
            None => self.lost += 1,
            Some((len, end)) => {
                self.answered += 1;
                if let Err(error) = self.ports[end as usize].socket.send(&frame[..len]) {
                    self.interface_failed(end as usize, &error);
                }
                self.record(Dir::Read, self.now(), &frame[..len]);
            }
        }
        // Called after the answer is sent, so that writing log lines does not delay the answer.
        self.network.look();
    }

    fn record(&self, dir: Dir, at: Ns, frame: &[u8]) {
        if let Some(recording) = &self.recording {
            recording.record(dir, at, frame);
        }
    }

    /// Advances the time of the slaves, and passes their log lines to the log.
    fn tick(&mut self, now: Instant) {
        self.next_tick = self.next_tick.max(now) + TICK;
        self.network.advance(self.now());
        for line in self.network.take_lines() {
            self.notes.push(line);
        }
        self.masters.pass(now).into_iter().for_each(|line| self.notes.push(line));
        self.log_limit.due(now).into_iter().for_each(|line| self.notes.push(line));
    }

    /// Checks the links of the interfaces. Returns the name of an interface that has disappeared; `None`: none has. If
    /// an interface of a ring has no link, the slave at that end closes its port. With a single interface the slave's
    /// port stays as it is: without a link no frames come.
    fn look_at_links(&mut self, now: Instant) -> Option<String> {
        self.next_look = now + LINK_PERIOD;
        let is_ring = self.ports.len() > 1;
        for (port, end) in self.ports.iter_mut().zip(CableEnd::BOTH) {
            let state = port.socket.link_state();
            if state == LinkState::Gone {
                return Some(port.interface.clone());
            }
            let has_frames = port.last_frame.is_some_and(|last| now.saturating_duration_since(last) < LINK_PERIOD);
            let is_connected = state == LinkState::Up || has_frames;
            if is_ring && is_connected != std::mem::replace(&mut port.is_connected, is_connected) {
                self.network.connect(end, is_connected);
            }
        }
        self.tell_ring(now);
        None
    }

    fn tell_ring(&mut self, now: Instant) {
        let [first, second] = &*self.ports else { return };
        let is_whole = first.is_connected && second.is_connected;
        if self.told_ring.replace(is_whole) == Some(is_whole) {
            return;
        }
        let dead = if first.is_connected { second } else { first };
        let line = match is_whole {
            true => format!("{} and {} close a ring", first.interface, second.interface),
            false => format!("no ring: {} has no link", dead.interface),
        };
        self.tell_limited("lines on the ring", &line, now);
    }

    fn interface_failed(&mut self, port: usize, error: &SocketError) {
        let line = format!("the network interface {} fails: {error}", self.ports[port].interface);
        self.tell_limited("the network interface fails", &line, Instant::now());
    }

    /// Logs a line that masters can cause as often as they like: too many lines of the same kind are only counted.
    fn tell_limited(&mut self, kind: &str, line: &str, now: Instant) {
        if self.log_limit.may_log(kind, now) {
            self.notes.push(line.to_owned());
        }
    }
}
