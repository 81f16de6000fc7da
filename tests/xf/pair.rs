//! The driver and the model of the chip, byte by byte: they were written from the same manuals, and each has to do what
//! the other one expects. Each function is sent by the driver, and its effect is checked at the other end: in the chip,
//! in its slaves, at its pins, or in the answer.
//!
//! - `start.rs`: from an unknown chip to a running one; sizes, check words, resets
//! - `network.rs`: initialisation, states, clocks, process data laid out, working counter
//! - `transfers.rs`: SDOs, mappings, flash memory
//! - `fifos.rs`: process data through the FIFOs and past them
//! - `helper.rs`: the CiA 402 helper with a drive
//! - `interrupts.rs`: INT0 and INT1
//! - `units.rs`: GPIO, encoder, DAC, ADC, PHY
//! - `registers.rs`: slaves behind controllers: registers, EEPROMs, files, mailboxes
//! - `wire.rs`: slaves behind controllers as the wire shows them
//! - `refused.rs`: functions that slave models do not have
//! - `application.rs`: the usual start of an application, and drives along a path
//! - `saboteur.rs`: a wire on which one function has no effect
//! - `coverage.rs`: each of the 91 functions has a test, which fails if the function has no effect

#[path = "pair/application.rs"]
mod application;
#[path = "pair/coverage.rs"]
mod coverage;
#[path = "pair/fifos.rs"]
mod fifos;
#[path = "pair/helper.rs"]
mod helper;
#[path = "pair/interrupts.rs"]
mod interrupts;
#[path = "pair/network.rs"]
mod network;
#[path = "pair/refused.rs"]
mod refused;
#[path = "pair/registers.rs"]
mod registers;
#[path = "pair/saboteur.rs"]
mod saboteur;
#[path = "pair/start.rs"]
mod start;
#[path = "pair/transfers.rs"]
mod transfers;
#[path = "pair/units.rs"]
mod units;
#[path = "pair/wire.rs"]
mod wire;

use std::cell::Cell;

use ecmsk::coe::{AbortCode, ObjectAddress};
use ecmsk::ethercat::Ns;
use ecmsk::slave::Slave;
use ecmsk::slave::handle::SimHandle;
use ecmsk::xf::chip::{Chip, ChipPort, Controllers, Profile, SimulatedNetwork, SlaveModels};
use ecmsk::xf::host::{Host, HostConfig, HostError, HostState, Next, ProcessOutcome, ProcessRequest, Ticket};
use ecmsk::xf::request::{Call, InfoUpdate, Reconfig, SdoOperation};
use ecmsk::xf::{AnswerHeader, EtherCatState, MAX_PACKET, Status};

use crate::network::{INIT, drive, drives_and_io, sdo, to_all};
use saboteur::Saboteur;

/// How long a byte takes at 24 MHz.
const BYTE: Ns = 333;
const MS: Ns = 1_000_000;
const S: Ns = 1000 * MS;
/// The longest wait.
const WAIT_MAX: Ns = 20 * S;

thread_local! {
    /// Whether pairs of this thread have slaves behind controllers, not slave models.
    static OVER_CONTROLLERS: Cell<bool> = const { Cell::new(false) };
}

/// A driver whose bytes go to a model.
struct Pair {
    host: Host,
    port: ChipPort<SimulatedNetwork>,
    now: Ns,
    /// The level of INT0 that the driver is wired to take for "ready".
    int0_active: bool,
    /// Whether a bit of the next packet to the chip is inverted.
    damages_next: bool,
    saboteur: Saboteur,
}

impl Pair {
    /// A driver, and a chip with these slaves that gets its power now; `skipped` bytes have passed before the driver
    /// begins.
    fn new(profile: Profile, config: HostConfig, slaves: Vec<Box<dyn Slave>>, skipped: usize) -> Self {
        let handle = SimHandle::default();
        let network = if OVER_CONTROLLERS.get() {
            SimulatedNetwork::Controllers(Controllers::new(slaves, handle).expect("slaves can be described"))
        } else {
            SimulatedNetwork::Models(SlaveModels::new(slaves).reached_by(handle))
        };
        let mut port = ChipPort::new(Chip::new(profile, network));
        port.transfer(0, &vec![0; skipped], &mut vec![0; skipped]);
        let host = Host::new(0, config);
        Self { host, port, now: 0, int0_active: true, damages_next: false, saboteur: Saboteur::of_the_start() }
    }

    /// The same; returns when it takes commands.
    fn running_with(profile: Profile, config: HostConfig, slaves: Vec<Box<dyn Slave>>) -> Self {
        let mut pair = Self::new(profile, config, slaves, 7);
        pair.until_running();
        pair.saboteur = Saboteur::of_this_thread();
        pair
    }

    /// A newer chip with [`drives_and_io`].
    fn running() -> Self {
        Self::running_with(Profile::NEW, HostConfig::DEFAULT, drives_and_io())
    }

    /// The same network, initialised, in a state, its process data laid out from SafeOP on.
    fn in_state(state: EtherCatState) -> Self {
        let mut pair = Self::running();
        pair.bring_to(state);
        pair
    }

    fn bring_to(&mut self, state: EtherCatState) {
        self.run(&INIT);
        if state != EtherCatState::Init {
            self.run(&to_all(EtherCatState::PreOp));
        }
        if matches!(state, EtherCatState::SafeOp | EtherCatState::Op) {
            self.run(&Reconfig);
            self.run(&to_all(state));
        }
    }

    fn until_running(&mut self) {
        self.until("a start", |host| host.state() == HostState::Running);
    }

    /// Runs an exchange, or lets time pass: not beyond `limit` if there is nothing to do until then.
    fn turn(&mut self, limit: Ns) {
        let (mut sent, mut back) = ([0; MAX_PACKET], [0; MAX_PACKET]);
        match self.host.next(self.now).unwrap_or_else(|error| panic!("the driver has stopped: {error}")) {
            Next::Exchange(bytes) => {
                let len = bytes.len();
                sent[..len].copy_from_slice(bytes);
                self.saboteur.outgoing(&mut sent[..len]);
                if std::mem::take(&mut self.damages_next) {
                    sent[len / 2] ^= 0x10;
                }
                self.now += BYTE * len as Ns;
                self.port.transfer(self.now, &sent[..len], &mut back[..len]);
                self.saboteur.incoming(&mut back[..len]);
                self.host.received(self.now, &back[..len]);
            }
            Next::WaitUntil(time) => self.now = time.min(limit).max(self.now + 1),
            Next::WaitForReady { until } => {
                while self.port.chip_mut().int0(self.now) != self.int0_active && self.now < until {
                    self.now += 10_000;
                }
                if self.now < until {
                    self.host.ready(self.now);
                }
            }
        }
    }

    /// Runs until `done`.
    fn until(&mut self, what: &str, mut done: impl FnMut(&mut Host) -> bool) {
        let end = self.now + WAIT_MAX;
        while !done(&mut self.host) {
            assert!(self.now < end, "never: {what}; {:?} {:?}", self.host.state(), self.host.counters());
            self.turn(end);
        }
    }

    /// Runs for a while.
    fn pass(&mut self, ns: Ns) {
        let end = self.now + ns;
        while self.now < end {
            self.turn(end);
        }
        self.port.chip_mut().run_until(self.now);
    }

    fn submit<'d, C: Call<'d>>(&mut self, call: &C) -> Ticket {
        self.host.submit(self.now, call).expect("there is room")
    }

    /// Runs a command; returns its result, mapped by `look`.
    fn result<'d, C: Call<'d>, T>(
        &mut self,
        ticket: Ticket,
        call: &C,
        look: impl FnOnce(C::Answer<'_>) -> T,
    ) -> Result<T, HostError> {
        self.until("the end of a command", |host| host.is_done(ticket));
        self.host.take(ticket, call).expect("it is done").map(look)
    }

    /// Runs a command to its end.
    fn run<'d, C: Call<'d>>(&mut self, call: &C) {
        self.get(call, |_| ());
    }

    /// Runs a command, and returns its answer, mapped by `look`.
    fn get<'d, C: Call<'d>, T>(&mut self, call: &C, look: impl FnOnce(C::Answer<'_>) -> T) -> T {
        let ticket = self.submit(call);
        self.result(ticket, call, look).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Runs a command that has to fail.
    fn fails<'d, C: Call<'d>>(&mut self, call: &C) -> HostError {
        let ticket = self.submit(call);
        self.result(ticket, call, |_| ()).expect_err("it fails")
    }

    /// The same, and the failure has to be that the chip refuses it.
    fn is_refused<'d, C: Call<'d>>(&mut self, call: &C) {
        assert_eq!(self.fails(call), HostError::Refused { code: C::CODE });
    }

    /// Runs a command that takes time and has to fail. Its abort code, if it has one.
    fn ends_in_failure<'d, C: Call<'d>>(&mut self, call: &C) -> Option<AbortCode> {
        match self.fails(call) {
            HostError::Failed { code, abort, .. } => {
                assert_eq!(code, C::CODE);
                abort
            }
            error => panic!("{error}"),
        }
    }

    /// Runs a command and the one that reads its result.
    fn read<'d, 'e, C: Call<'d>, R: Call<'e>, T>(
        &mut self,
        call: &C,
        read: &R,
        look: impl FnOnce(R::Answer<'_>) -> T,
    ) -> Result<T, HostError> {
        let ticket = self.host.submit_pair(self.now, call, read, 10 * S).expect("there is room");
        self.result(ticket, read, look)
    }

    /// Exchanges process data; returns their outcome.
    fn process(&mut self, data: ProcessRequest<'_>) -> ProcessOutcome {
        let sequence = self.host.process(data).expect("there is room");
        let mut report = None;
        self.until("a report", |host| {
            report = host.take_report();
            report.is_some()
        });
        let report = report.expect("it was waited for");
        assert_eq!(report.sequence, sequence);
        report.outcome
    }

    /// The header of an answer to a packet that is sent from now on, when counts do not lag any more.
    fn header(&mut self) -> AnswerHeader {
        self.pass(35 * MS);
        *self.host.header().expect("it runs")
    }

    /// The header of the answer to a packet that is sent now.
    fn header_now(&mut self) -> AnswerHeader {
        self.run(&InfoUpdate);
        *self.host.header().expect("it runs")
    }

    /// Writes an object, which has to succeed.
    fn write(&mut self, slave: u8, index: u16, sub: u8, value: &[u8]) {
        self.run(&sdo(slave, index, sub, SdoOperation::Write(value)));
    }

    fn has(&mut self, status: Status) -> bool {
        self.header().status.contains(status)
    }

    fn chip(&mut self) -> &mut Chip<SimulatedNetwork> {
        self.port.chip_mut()
    }

    /// Makes a slave not answer, or answer again.
    fn silence(&mut self, slave: u8, silent: bool) {
        self.chip().network().handle().silence(slave + 1, silent);
    }

    /// The controllers of the slaves, where they have some.
    fn controllers(&mut self) -> &mut Controllers {
        match self.chip().network_mut() {
            SimulatedNetwork::Controllers(controllers) => controllers,
            SimulatedNetwork::Models(_) => panic!("the slaves are models"),
        }
    }

    /// The device of a slave, to change it.
    fn device(&mut self, slave: u8) -> &mut dyn Slave {
        self.chip().network_mut().slave_mut(slave).expect("the slave")
    }

    /// An object as the slave itself has it.
    fn object(&mut self, slave: u8, index: u16, sub: u8) -> u32 {
        let slave = self.device(slave);
        slave.upload(ObjectAddress::new(index, sub)).expect("the object").bits
    }

    /// The outputs of the IO module behind the two drives.
    fn io_outputs(&mut self) -> u32 {
        self.object(2, 0x7000, 1)
    }
}
