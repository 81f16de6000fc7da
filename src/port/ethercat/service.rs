//! The thread that has the slaves and the socket.

use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::network::Network;
use crate::engine::RealTime;
use crate::ethercat::{FRAME_LEN_MAX, Ns};
use crate::io::ethernet::Socket;
use crate::link::Dir;
use crate::link::record::NetworkRecording;
use crate::port::log_limit::LogLimit;
use crate::port::notes::Notes;
use crate::port::serving::Shared;

/// How often time passes for slaves that get no frame, and how often their states are looked at. \[OURS]
const TICK: Duration = Duration::from_millis(5);
/// The pause after the interface has failed. \[OURS]
const RETRY_PAUSE: Duration = Duration::from_millis(100);
/// Without a frame for this long the master is gone. \[OURS]
const SILENCE: Duration = Duration::from_secs(2);

pub(super) struct Service {
    interface: String,
    network: Network,
    socket: Socket,
    recording: Option<NetworkRecording>,
    begin: Instant,
    shared: Arc<Shared>,
    notes: Notes<String>,
    log_limit: LogLimit,
    /// When the last frame of a master came; `None`: no master is there.
    last_frame: Option<Instant>,
    next_tick: Instant,
    answered: u64,
    lost: u64,
}

impl Service {
    pub fn new(
        interface: String,
        network: Network,
        socket: Socket,
        recording: Option<NetworkRecording>,
        begin: Instant,
        shared: Arc<Shared>,
        notes: Notes<String>,
    ) -> Self {
        Self {
            interface,
            network,
            socket,
            recording,
            begin,
            shared,
            notes,
            log_limit: LogLimit::default(),
            last_frame: None,
            next_tick: begin,
            answered: 0,
            lost: 0,
        }
    }

    pub fn run(mut self, real_time: RealTime) {
        real_time.apply().into_iter().for_each(|line| self.notes.tell(line));
        // One byte more than a frame has shows one that is longer.
        let mut frame = [0; FRAME_LEN_MAX + 1];
        while !self.shared.is_stopping() {
            self.wait();
            if let Err(error) = self.answer_all(&mut frame) {
                self.interface_failed(&error);
            }
            let now = Instant::now();
            if now >= self.next_tick {
                self.tick(now);
            }
        }
        let Self { answered, lost, .. } = self;
        self.notes.tell(format!("{answered} frames were answered, {lost} were lost"));
    }

    fn now(&self) -> Ns {
        self.time_of(Instant::now())
    }

    /// The time of the network.
    fn time_of(&self, at: Instant) -> Ns {
        Ns::try_from(at.duration_since(self.begin).as_nanos()).unwrap_or(Ns::MAX)
    }

    /// Waits until a frame comes or time has to pass.
    fn wait(&mut self) {
        let limit = self.next_tick.saturating_duration_since(Instant::now());
        let limit = Timespec::try_from(limit).ok();
        let mut fds =
            [PollFd::new(&self.socket, PollFlags::IN), PollFd::new(self.shared.waker.waited(), PollFlags::IN)];
        // If the wait fails, the calls after it report the error.
        let _ = poll(&mut fds, limit.as_ref());
    }

    /// Answers the frames that have come, until it is time for a tick.
    fn answer_all(&mut self, frame: &mut [u8]) -> io::Result<()> {
        while let Some(len) = self.socket.take(frame)? {
            // A longer frame is none of Ethernet.
            if len <= FRAME_LEN_MAX {
                self.answer(frame, len);
            }
            if Instant::now() >= self.next_tick {
                break;
            }
        }
        Ok(())
    }

    fn answer(&mut self, frame: &mut [u8], len: usize) {
        if !Network::is_masters(&frame[..len]) {
            return;
        }
        let came = Instant::now();
        let now = self.time_of(came);
        self.record(Dir::Write, now, &frame[..len]);
        if self.last_frame.replace(came).is_none() {
            self.notes.tell(format!("a master is there on {}", self.interface));
        }
        match self.network.answer(frame, len, now) {
            None => self.lost += 1,
            Some(len) => {
                self.answered += 1;
                if let Err(error) = self.socket.send(&frame[..len]) {
                    self.interface_failed(&error);
                }
                self.record(Dir::Read, self.now(), &frame[..len]);
            }
        }
        // The master does not wait for that.
        self.network.look();
    }

    fn record(&self, dir: Dir, at: Ns, frame: &[u8]) {
        if let Some(recording) = &self.recording {
            recording.record(dir, at, frame);
        }
    }

    /// Time passes in the slaves, and what has happened is told.
    fn tick(&mut self, now: Instant) {
        self.next_tick = self.next_tick.max(now) + TICK;
        self.network.advance(self.now());
        let lines: Vec<String> = self.network.take_lines().collect();
        for line in lines {
            self.tell_limited("lines on states", &line, now);
        }
        if self.last_frame.is_some_and(|last| now.duration_since(last) >= SILENCE) {
            self.last_frame = None;
            self.notes.tell(format!("no frame has come for {} s: the master is gone", SILENCE.as_secs()));
        }
        self.log_limit.due(now).into_iter().for_each(|line| self.notes.tell(line));
    }

    fn interface_failed(&mut self, error: &io::Error) {
        let now = Instant::now();
        let line = format!("the network interface {} fails: {error}", self.interface);
        self.tell_limited("the network interface fails", &line, now);
        self.next_tick = now + RETRY_PAUSE;
        std::thread::sleep(RETRY_PAUSE);
    }

    /// Tells a line that masters can cause as often as they like.
    fn tell_limited(&mut self, kind: &str, line: &str, now: Instant) {
        if self.log_limit.may_log(kind, now) {
            self.notes.tell(line.to_owned());
        }
    }
}
