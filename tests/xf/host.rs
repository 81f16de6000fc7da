//! The driver of a host, against a chip that is scripted here.
//!
//! - `chip.rs`: that chip, and its faults
//! - `start.rs`: from unknown packets to a chip that runs; timeouts
//! - `commands.rs`: queues, results, errors, repetitions
//! - `process.rs`: process data
//! - `error_bits.rs`: whose they are
//! - `faults.rs`: any bytes and any answers
//! - `budget.rs`: the time of an exchange; `allocation.rs`: no exchange allocates

#[path = "host/allocation.rs"]
mod allocation;
#[path = "host/budget.rs"]
mod budget;
#[path = "host/chip.rs"]
mod chip;
#[path = "host/commands.rs"]
mod commands;
#[path = "host/error_bits.rs"]
mod error_bits;
#[path = "host/faults.rs"]
mod faults;
#[path = "host/process.rs"]
mod process;
#[path = "host/start.rs"]
mod start;

use chip::{Chip, Fault};
use ecmsk::xf::DataSize;
use ecmsk::xf::host::{Host, HostConfig, HostError, HostState, Next, Ticket};
use ecmsk::xf::request::Call;

/// The time that a packet is under way.
const TRANSFER_NS: u64 = 40_000;

/// A host and a chip with a clock.
struct Rig {
    host: Host,
    chip: Chip,
    now: u64,
    /// The time from an exchange to INT0.
    int0_ns: Option<u64>,
    /// Faults of the next exchanges.
    faults: Vec<Fault>,
    /// Whole packets that the host has sent.
    sent: Vec<Vec<u8>>,
}

impl Rig {
    fn new(config: HostConfig, chip: Chip) -> Self {
        Self { host: Host::new(0, config), chip, now: 0, int0_ns: None, faults: Vec::new(), sent: Vec::new() }
    }

    /// A host that starts with a known n.
    fn starting(config: HostConfig) -> Self {
        Self::new(HostConfig { size: Some(DataSize::MANUAL), ..config }, Chip::new(DataSize::MANUAL))
    }

    /// A running host, with the records of the start cleared.
    fn running(config: HostConfig) -> Self {
        let mut rig = Self::starting(config);
        rig.until_running();
        rig.chip.ran.clear();
        rig.chip.taken.clear();
        rig.sent.clear();
        rig
    }

    /// Runs one turn: an exchange, or a wait.
    fn turn(&mut self) -> Result<bool, HostError> {
        match self.host.next(self.now)? {
            Next::Exchange(packet) => {
                let packet = packet.to_vec();
                let fault = if self.faults.is_empty() { Fault::None } else { self.faults.remove(0) };
                let back = self.chip.exchange(&packet, fault);
                self.sent.push(packet);
                self.now += TRANSFER_NS;
                self.host.received(self.now, &back);
                return Ok(true);
            }
            Next::WaitUntil(time) => {
                assert!(time > self.now, "a wait that is over: {time} at {}", self.now);
                self.now = time;
            }
            Next::WaitForReady { until } => {
                assert!(until > self.now);
                match self.int0_ns {
                    Some(delay) if self.now + delay < until => {
                        self.now += delay;
                        self.host.ready(self.now);
                    }
                    _ => self.now = until,
                }
            }
        }
        Ok(false)
    }

    /// Runs turns until something holds.
    fn until(&mut self, what: &str, holds: impl Fn(&mut Self) -> bool) {
        for _ in 0..20_000 {
            if holds(self) {
                return;
            }
            self.turn().unwrap_or_else(|error| panic!("{what}: {error}"));
        }
        panic!("{what} does not come: {:?} {:?}", self.host.state(), self.host.counters());
    }

    fn until_running(&mut self) {
        self.until("running", |rig| rig.host.state() == HostState::Running);
    }

    /// Runs that many exchanges.
    fn exchanges(&mut self, n: usize) {
        let mut done = 0;
        while done < n {
            done += usize::from(self.turn().expect("it runs"));
        }
    }

    fn submit<'d>(&mut self, call: &impl Call<'d>) -> Ticket {
        self.host.submit(self.now, call).expect("there is room")
    }

    /// Runs turns until the command is done.
    fn done(&mut self, ticket: Ticket) {
        self.until("the end of a command", |rig| rig.host.is_done(ticket));
    }

    /// Runs a command to its end.
    fn ended<'d>(&mut self, call: &impl Call<'d>) -> Ticket {
        let ticket = self.submit(call);
        self.done(ticket);
        ticket
    }

    /// Runs turns until the driver stops.
    fn stops(&mut self) -> HostError {
        for _ in 0..1_000_000 {
            if let Err(error) = self.turn() {
                return error;
            }
        }
        panic!("it does not stop: {:?}", self.host.counters());
    }
}
