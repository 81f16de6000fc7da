//! Driver and chip with a clock, and a program that uses the driver as programs do.

use ecmsk::coe::SdoScope;
use ecmsk::ethercat::Ns;
use ecmsk::xf::chip::{Chip, ChipTiming, Profile};
use ecmsk::xf::host::{Host, HostConfig, HostError, HostPacing, HostState, Next, ProcessRequest, Ticket, Timeouts};
use ecmsk::xf::request::{
    Call, DcTiming, EcatInit, Fifo, FifoEnable, FifoPackSizeGet, FlashAddress, FoeRequest, Mdio, Reconfig,
    ReferenceClock, SdoGet, SdoOperation, SdoRequest, SlaveCountGet, Slaves, StateSet, WarmReset,
};
use ecmsk::xf::{DataSize, EtherCatState, MAX_PACKET};
use support::dice::Dice;
use support::faulty_wire::{FLASH_AT, Fault, REGISTER, Wire, quick};

use super::Done;
use super::books::{Books, End, MOST_AT_ONCE, What};
use super::network::{Logged, WRITTEN, pdo, read_object, read_value};
use crate::slave;

const US: Ns = 1_000;
const MS: Ns = 1_000_000;
const S: Ns = 1_000_000_000;
/// The EtherCAT cycle.
const CYCLE: Ns = MS;
/// The program polls the driver at this interval.
const LOOK: Ns = 500 * US;
/// By then every command has ended: the driver's timeouts for one command and one start.
const END: Ns = 60 * S;
/// The length of a host's silence.
const SILENCE: Ns = 60 * S;

pub struct Rig {
    seed: u64,
    dice: Dice,
    host: Host,
    wire: Wire<Logged>,
    books: Books,
    done: Done,
    now: Ns,
    /// One in this number of exchanges has a fault; `None`: none has.
    rarely: Option<u64>,
    /// The next edge of INT0 is lost.
    edge_lost: bool,
    number: u32,
    serial: u32,
    rx_bytes: usize,
    tx_bytes: usize,
    chip_resets: u64,
    begun_anew: u64,
    previous_index: u8,
}

fn config(dice: &mut Dice, profile: Profile) -> HostConfig {
    let timeouts = Timeouts {
        answer_ns: dice.pick(&[20 * MS, 100 * MS]),
        busy_ns: dice.pick(&[20 * MS, 300 * MS]),
        queue_ns: dice.pick(&[50 * MS, 2 * S]),
        int0_ns: 5 * MS,
        ..Timeouts::default()
    };
    HostConfig {
        size: dice.pick(&[None, Some(profile.size)]),
        wanted_size: dice.pick(&[None, None, DataSize::new(64), DataSize::new(256)]),
        pacing: dice.pick(&[HostPacing::Idle, HostPacing::Idle, HostPacing::Int0]),
        idle_ns: dice.pick(&[20 * US, 150 * US]),
        pipelined_writes: dice.one_in(2),
        rx_entries: dice.pick(&[64, 64, 128]),
        resync_after: dice.pick(&[2, 4, 8]),
        timeouts,
        ..HostConfig::default()
    }
}

fn timing(dice: &mut Dice) -> ChipTiming {
    let timing = quick(dice.pick(&[5 * US, 100 * US, 400 * US, 2 * MS]));
    ChipTiming { sdo_ns: dice.pick(&[100 * US, 3 * MS, 30 * MS]), ..timing }
}

impl Rig {
    pub fn new(seed: u64) -> Self {
        let mut dice = Dice(seed);
        let profile = Profile::OLD;
        let config = config(&mut dice, profile);
        let wire = Wire::new(Chip::with_timing(profile, timing(&mut dice), Logged::new()));
        let books = Books::new(config.rx_entries > 64);
        Self {
            seed,
            dice,
            host: Host::new(0, config),
            wire,
            books,
            done: Done::default(),
            now: 0,
            rarely: None,
            edge_lost: false,
            number: 0,
            serial: 1,
            rx_bytes: 0,
            tx_bytes: 0,
            chip_resets: 0,
            begun_anew: 0,
            previous_index: 0,
        }
    }

    /// How often the chip or the driver has restarted.
    pub fn life(&self) -> u32 {
        self.books.life
    }

    fn begin_life(&mut self) {
        self.books.life += 1;
    }

    /// Asks the driver for its next action, and carries it out.
    fn turn(&mut self) {
        let mut back = None;
        match self.host.next(self.now) {
            Ok(Next::Exchange(packet)) => {
                assert!((1..=MAX_PACKET).contains(&packet.len()), "{} bytes", packet.len());
                back = Some(packet.to_vec());
            }
            Ok(Next::WaitUntil(time)) => {
                assert!(time > self.now, "a wait that is over");
                self.now = time.min(self.now + LOOK);
            }
            Ok(Next::WaitForReady { until }) => {
                assert!(until > self.now, "a wait that is over");
                if !self.edge_lost && self.wire.port.chip_mut().int0(self.now) {
                    self.host.ready(self.now);
                } else {
                    self.now = until.min(self.now + 20 * US);
                }
            }
            Err(error) => self.stopped(error),
        }
        if let Some(packet) = back {
            self.exchange(&packet);
        }
        self.look();
    }

    fn exchange(&mut self, packet: &[u8]) {
        if self.host.state() == HostState::Running {
            assert_eq!(packet.len(), self.host.size().packet_len(), "a whole packet");
            self.done.indices_went_round += u64::from(packet[11] < self.previous_index);
            self.previous_index = packet[11];
        }
        let fault = self.fault();
        match fault {
            Some(Fault::Reset) => {
                self.begin_life();
                self.wire.reset(self.now);
            }
            Some(Fault::Resized) => {
                self.begin_life();
                let size = self.dice.pick(&[32, 112, 300]);
                self.wire.resize(self.now, DataSize::new(size).expect("32 to 1408"));
            }
            _ => {}
        }
        let (end, answer) = self.wire.exchange(self.now, packet, fault, &mut self.dice);
        self.now = end;
        self.edge_lost = self.rarely.is_some() && self.dice.one_in(30);
        self.host.received(end, &answer);
    }

    fn fault(&mut self) -> Option<Fault> {
        let fault = Fault::random(self.rarely?, &mut self.dice)?;
        *self.done.faults.entry(fault).or_default() += 1;
        Some(fault)
    }

    fn stopped(&mut self, error: HostError) {
        let name = format!("{error:?}");
        let name = name.split([' ', '{']).next().unwrap_or_default().to_owned();
        *self.done.errors.entry(name).or_default() += 1;
        assert_eq!(self.host.state(), HostState::Stopped(error));
        self.begin_life();
        self.begun_anew += 1;
        self.host.restart(self.now);
    }

    /// Takes the driver's results and reports.
    fn look(&mut self) {
        let counters = self.host.counters();
        if counters.chip_resets > self.chip_resets {
            self.begun_anew += counters.chip_resets - self.chip_resets;
            self.chip_resets = counters.chip_resets;
            self.begin_life();
        }
        let newest = self.wire.port.chip().network().log.tx;
        while let Some(report) = self.host.take_report() {
            let name = format!("{:?}", report.outcome).replace(" { read: ", " ").replace(" }", "");
            *self.done.outcomes.entry(name).or_default() += 1;
            self.books.reported(report, self.host.inputs(), self.tx_bytes, newest);
        }
        for (ticket, what, since) in std::mem::take(&mut self.books.open) {
            match self.take(ticket, what) {
                Some(end) => {
                    self.done.end(end);
                    self.books.ended(what, end);
                }
                None => {
                    assert!(self.now - since < END, "{what:?} does not end: {:?}", self.host.state());
                    self.books.open.push((ticket, what, since));
                }
            }
        }
    }

    fn take(&mut self, ticket: Ticket, what: What) -> Option<End> {
        if !self.host.is_done(ticket) {
            return None;
        }
        let host = &mut self.host;
        let result = match what {
            What::WriteSdo(_) => host.take(ticket, &sdo(0, SdoOperation::Read { bytes: 0 })),
            What::ReadSdo(n) => {
                let result = host.take(ticket, &SdoGet);
                result.map(|result| result.map(|value| assert_eq!(value, read_value(n).to_le_bytes(), "{what:?}")))
            }
            What::WriteRegister(value) => host.take(ticket, &write_register(value)).map(|result| result.map(drop)),
            What::ReadRegister(n) => {
                let result = host.take(ticket, &read_register(n));
                result.map(|result| result.map(|answer| assert_eq!(answer.0, Some(0), "{what:?}")))
            }
            What::WriteFlash(n) => host.take(ticket, &write_flash(&n.to_le_bytes())),
            What::CountSlaves => {
                let result = host.take(ticket, &SlaveCountGet);
                result.map(|result| result.map(|count| assert!(count == 0 || count == 2, "{count}")))
            }
            What::Restart => host.take(ticket, &WarmReset),
        };
        Some(End::of(result.expect("it is done")))
    }

    /// Runs a command to its end.
    fn run<'d, C: Call<'d>>(&mut self, call: &C) -> Result<Ticket, HostError> {
        let ticket = self.host.submit_within(self.now, call, 5 * S)?;
        let end = self.now + END;
        while !self.host.is_done(ticket) {
            assert!(self.now < end, "{} does not end: {:?} {:?}", C::CODE, self.host.state(), self.host.counters());
            self.turn();
        }
        Ok(ticket)
    }

    fn runs<'d, C: Call<'d>>(&mut self, call: &C) -> bool {
        self.run(call).is_ok_and(|ticket| self.host.take(ticket, call).is_some_and(|result| result.is_ok()))
    }

    /// Runs a command without faults; returns whether it succeeded.
    pub fn run_quietly<'d, C: Call<'d>>(&mut self, call: &C) -> bool {
        self.rarely = None;
        self.runs(call)
    }

    /// Brings the network to OP, with faults at first; returns the number of restarts.
    pub fn bring_up(&mut self) -> u32 {
        for attempt in 0.. {
            self.rarely = if attempt < 2 { self.dice.pick(&[None, Some(200), Some(40)]) } else { None };
            assert!(attempt < 20, "the network does not come up: {:?}", self.host.state());
            if let Some(life) = self.start() {
                return life;
            }
        }
        unreachable!("it is brought up, or not")
    }

    /// Restarts the network, which clears the FIFOs; returns the number of restarts.
    fn start(&mut self) -> Option<u32> {
        let end = self.now + END;
        while self.host.state() != HostState::Running {
            assert!(
                self.now < end,
                "the driver does not start: {:?} {:?} {:?}",
                self.host.state(),
                self.done.errors,
                self.host.counters()
            );
            self.turn();
        }
        let dc = DcTiming { sync0_ns: CYCLE as u32, ..DcTiming::default() };
        let init =
            EcatInit { special_slaves: false, reference_clock: ReferenceClock::Chip, lrw: true, fifo_on: false, dc };
        let to = |state| StateSet { slaves: Slaves::All, state };
        self.wire.port.chip_mut().network_mut().silence(1, false);
        self.begin_life();
        let life = self.life();
        let up = self.runs(&init)
            && self.runs(&to(EtherCatState::PreOp))
            && self.runs(&Reconfig)
            && self.pdo_bytes()
            && self.runs(&to(EtherCatState::SafeOp))
            && self.runs(&to(EtherCatState::Op))
            && self.runs(&FifoEnable { on: true });
        (up && life == self.life()).then_some(life)
    }

    fn pdo_bytes(&mut self) -> bool {
        let mut bytes = [0; 2];
        for (fifo, bytes) in [Fifo::Rx, Fifo::Tx].into_iter().zip(&mut bytes) {
            let get = FifoPackSizeGet { fifo };
            let Ok(ticket) = self.run(&get) else { return false };
            let Some(Ok(found)) = self.host.take(ticket, &get) else { return false };
            *bytes = found.into();
        }
        [self.rx_bytes, self.tx_bytes] = bytes;
        self.rx_bytes > 0 && self.tx_bytes > 0
    }

    /// Sends commands and process data for that many turns, with random faults, at times many and at times few.
    pub fn stream(&mut self, turns: u64) {
        let busily = self.dice.pick(&[1, 3, 10, 40]);
        let commands = self.dice.pick(&[2, 10]);
        for turn in 0..turns {
            if turn % 64 == 0 {
                self.rarely = self.dice.pick(&[None, Some(1), Some(3), Some(10), Some(50)]);
                let silent = self.dice.one_in(8);
                self.wire.port.chip_mut().network_mut().silence(1, silent);
            }
            if self.dice.one_in(busily) {
                self.process();
            }
            if self.dice.one_in(commands) {
                self.command();
            }
            if self.dice.one_in(20_000) {
                self.done.silences += 1;
                self.now += SILENCE;
                // A driver that is not polled cannot end commands.
                self.books.open.iter_mut().for_each(|(_, _, since)| *since += SILENCE);
            }
            self.turn();
        }
    }

    fn process(&mut self) {
        let count = if self.dice.one_in(4) { 1 + self.dice.below(MOST_AT_ONCE) as u8 } else { 1 };
        let outputs: Vec<u8> = (0..u32::from(count)).flat_map(|n| pdo(self.serial + n, self.rx_bytes.max(4))).collect();
        let (data, written, reads) = match self.dice.below(8) {
            0 => (ProcessRequest::Read { count }, 0, count),
            1 => (ProcessRequest::DirectRead, 0, 0),
            2 => (ProcessRequest::Write { count, outputs: &outputs }, u32::from(count), 0),
            // Of a wrong length.
            3 if self.dice.one_in(8) => (ProcessRequest::Write { count, outputs: &outputs[1..] }, u32::from(count), 0),
            _ => (ProcessRequest::Exchange { count, outputs: &outputs }, u32::from(count), count),
        };
        match self.host.process(data) {
            Ok(sequence) => {
                self.books.process(sequence, self.serial, written, reads.into());
                self.serial += written;
            }
            Err(HostError::ProcessBusy { .. } | HostError::FifoFull { .. } | HostError::TooLong { .. }) => {}
            Err(error) => assert_eq!(self.host.state(), HostState::Stopped(error), "process data: {error}"),
        }
    }

    fn command(&mut self) {
        self.number += 1;
        let (now, n) = (self.now, self.number);
        let kinds = if self.dice.one_in(100) { 7 } else { 6 };
        let what = match self.dice.below(kinds) {
            0 => What::WriteSdo(n),
            1 => What::ReadSdo(n),
            2 => What::WriteRegister(n as u16),
            3 => What::ReadRegister(6 + (n % 20) as u8),
            4 => What::WriteFlash(n),
            5 => What::CountSlaves,
            _ => What::Restart,
        };
        let host = &mut self.host;
        let to = (n % 2) as u8;
        let submitted = match what {
            What::WriteSdo(n) => host.submit(now, &sdo(to, SdoOperation::Write(&n.to_le_bytes()))),
            What::ReadSdo(n) => {
                let read = sdo(to, SdoOperation::Read { bytes: 4 });
                host.submit_pair(now, &SdoRequest { object: read_object(n), ..read }, &SdoGet, S)
            }
            What::WriteRegister(value) => host.submit(now, &write_register(value)),
            What::ReadRegister(n) => host.submit(now, &read_register(n)),
            What::WriteFlash(n) => host.submit(now, &write_flash(&n.to_le_bytes())),
            What::CountSlaves => host.submit(now, &SlaveCountGet),
            What::Restart => host.submit(now, &WarmReset),
        };
        match submitted {
            Ok(ticket) => {
                if what == What::Restart {
                    self.begin_life();
                }
                self.books.submitted(ticket, what, now);
            }
            Err(HostError::QueueFull { .. } | HostError::TooLong { .. }) => {}
            Err(error) => assert_eq!(self.host.state(), HostState::Stopped(error), "{what:?}: {error}"),
        }
    }

    /// Writes RxPDOs alone, with random faults; returns the serial number of the first one.
    pub fn write_with_faults(&mut self) -> u32 {
        let first = self.serial;
        self.rarely = self.dice.pick(&[Some(2), Some(4), Some(10)]);
        // More than the chip has entries, if the driver is configured for more.
        let turns = if self.host.config().rx_entries > 64 { 1500 } else { 120 };
        for _ in 0..turns {
            let outputs = pdo(self.serial, self.rx_bytes);
            if let Ok(sequence) = self.host.process(ProcessRequest::Write { count: 1, outputs: &outputs }) {
                self.books.process(sequence, self.serial, 1, 0);
                self.serial += 1;
            }
            if self.dice.one_in(4) {
                self.command_beside();
            }
            self.turn();
        }
        first
    }

    /// Sends a command that does not affect the FIFOs.
    fn command_beside(&mut self) {
        self.number += 1;
        let value = self.number as u16;
        if let Ok(ticket) = self.host.submit(self.now, &write_register(value)) {
            self.books.submitted(ticket, What::WriteRegister(value), self.now);
        }
    }

    /// Runs without faults and new commands until all have ended.
    pub fn rest(&mut self) {
        self.rarely = None;
        let end = self.now + END;
        let busy = |rig: &Self| {
            rig.host.state() != HostState::Running || !rig.books.open.is_empty() || rig.books.has_open_targets()
        };
        while busy(self) {
            assert!(
                self.now < end,
                "seed {}: it does not end: {:?} {:?} {:?}",
                self.seed,
                self.host.state(),
                self.books.open,
                self.host.counters()
            );
            self.turn();
        }
        self.pass(100);
    }

    /// Lets that many cycles pass without faults.
    pub fn pass(&mut self, cycles: u64) {
        self.rarely = None;
        let until = self.now + cycles * CYCLE;
        while self.now < until {
            self.turn();
        }
    }

    /// Entries of the RxFIFO by the newest answer.
    pub fn entries(&self) -> u32 {
        self.host.header().map_or(0, |header| header.rx_fifo.into())
    }

    /// Checks that the chip has as many entries as were reported as written since that one.
    pub fn compare_entries(&mut self, first: u32, entries: u32) {
        let (sure, most) = self.books.in_fifo(first);
        assert!((sure..=most).contains(&entries), "{entries} entries, {sure} to {most} were written");
        self.done.bursts += 1;
    }

    /// Checks that each RxPDO from that one on was sent in one cycle, except the last one, which is repeated.
    pub fn each_took_one_cycle(&self, first: u32) {
        let cycles = &self.wire.port.chip().network().log.cycles;
        let burst: Vec<_> = cycles.iter().filter(|(serial, _)| *serial >= first).collect();
        if let Some((_, before)) = burst.split_last() {
            assert!(before.iter().all(|(_, cycles)| *cycles == 1), "an RxPDO was put out twice: {burst:?}");
        }
    }

    pub fn close(mut self) -> Done {
        let counters = self.host.counters();
        self.books.close(&self.wire, &counters, self.begun_anew);
        self.done.gaps = self.books.gaps;
        self.done.int0_missed = counters.int0_missed;
        self.done.not_ready = counters.not_ready;
        self.done.rejected = counters.rejected;
        self.done.asked_again = counters.asked_again;
        self.done
    }
}

fn sdo(to: u8, operation: SdoOperation<'_>) -> SdoRequest<'_> {
    SdoRequest { slave: slave(to), object: WRITTEN, scope: SdoScope::Entry, timeout_us: 100_000, operation }
}

const fn write_register(value: u16) -> Mdio {
    Mdio::Write { phy: REGISTER.0, register: REGISTER.1, value }
}

const fn read_register(register: u8) -> Mdio {
    Mdio::Read { phy: REGISTER.0, register }
}

fn write_flash(data: &[u8]) -> FoeRequest<'_> {
    FoeRequest::WriteFlash { start: FlashAddress::new(FLASH_AT as u32).expect("in the memory"), data }
}
