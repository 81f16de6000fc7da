//! The same machine twice: its slaves are on the simulated network of a board, or behind the model of an ECM-XF.
//! Everything else, including the engine and the link, is the same code.

use std::time::Duration;

use ecmsk::cia402::{Mode, Statusword};
use ecmsk::coe::ObjectAddress;
use ecmsk::engine::{Board, Counters, EngineConfig, StateFailure};
use ecmsk::fieldbus::Fieldbus;
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::link::{Link, Wait};
use ecmsk::sk::{
    CycleTime, DcShift, DriveResponse, DriveSync, FIFO_ENTRIES, Frame, MasterCommand, MasterResponse, MasterState,
    RawSlot, SdoCommand, SdoResponse, SlaveCommand, SlaveKind, SlotSize, StateByte,
};
use ecmsk::slave::Slave;
use support::chip_line::xf_bus_reached_by;

use crate::tap::Log;

/// The longest boot.
const BOOT_NS: u64 = 60_000_000_000;
/// Reports after which a wait fails. 40 slaves take some seconds to OP.
const PATIENCE: usize = 60_000;
/// Reports until a chip has sent the last entry and answered: more than the row `latency` allows.
const SETTLED: usize = 40;

/// Where the slaves are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Behind {
    /// On the board's own network.
    Board,
    /// Behind a chip whose FIFO may hold that many sets of outputs.
    Chip { ahead: u16 },
}

impl Behind {
    /// The chip with its link's defaults.
    pub const CHIP: Self = Self::Chip { ahead: XfBusOptions::DEFAULT.ahead };
    /// Both.
    pub const BOTH: [Self; 2] = [Self::Board, Self::CHIP];
}

/// A program and its board.
pub struct Machine {
    link: EngineLink,
    pub log: Log,
    pub network: SimHandle,
    pub size: SlotSize,
    pub report: Frame,
    /// Reports that were read.
    pub reports: u64,
    cycle_us: u32,
}

impl Machine {
    /// A board that has booted with these slaves.
    pub fn new(behind: Behind, size: SlotSize, slaves: Vec<Box<dyn Slave>>) -> Self {
        let log = Log::default();
        let slaves = log.tapped(slaves);
        match behind {
            Behind::Board => {
                let bus = SimBus::new(slaves);
                let network = bus.handle();
                Self::over(size, Box::new(bus), network, log)
            }
            Behind::Chip { ahead } => {
                let network = SimHandle::default();
                let options = XfBusOptions { ahead, ..XfBusOptions::DEFAULT };
                Self::over(size, Box::new(xf_bus_reached_by(slaves, network.clone(), options)), network, log)
            }
        }
    }

    /// A board that has booted over a bus whose slaves have the taps of that account.
    pub fn over(size: SlotSize, bus: Box<dyn Fieldbus>, network: SimHandle, log: Log) -> Self {
        let mut board = Board::new(EngineConfig { slot: size, ..EngineConfig::default() }, bus);
        assert!(board.boot(BOOT_NS), "the board does not talk");
        let link = EngineLink::open("the machine", board, RunOptions::default(), None).expect("it talks");
        let mut machine =
            Self { link, log, network, size, report: Frame::new(), reports: 0, cycle_us: CycleTime::DEFAULT.us() };
        machine.read();
        machine
    }

    /// Sends a frame filled by `build`.
    pub fn send(&mut self, build: impl FnOnce(&mut Frame, SlotSize)) -> &mut Self {
        let mut frame = Frame::new();
        build(&mut frame, self.size);
        self.link.write(&frame, Wait::Forever).expect("it is taken");
        self
    }

    pub fn master(&mut self, command: MasterCommand) -> &mut Self {
        self.send(|frame, size| frame.put_master(size, &command))
    }

    pub fn slave(&mut self, slave: usize, command: SlaveCommand) -> &mut Self {
        self.send(|frame, size| frame.put_slave(size, slave, &command.into()))
    }

    /// Reads the next report.
    pub fn read(&mut self) -> &mut Self {
        self.link.read(&mut self.report, Wait::For(Duration::from_secs(60))).expect("a report");
        self.reports += 1;
        self
    }

    /// Whether no report comes for that time.
    pub fn says_nothing(&mut self, limit: Duration) -> bool {
        self.link.read(&mut self.report, Wait::For(limit)).is_err()
    }

    pub fn read_some(&mut self, reports: usize) -> &mut Self {
        for _ in 0..reports {
            self.read();
        }
        self
    }

    /// Reads for that many milliseconds of cycles.
    pub fn rest(&mut self, ms: u32) -> &mut Self {
        self.read_some((1000 * ms / self.cycle_us).max(1) as usize)
    }

    /// Reads until `done`; the number of reports that took.
    pub fn until(&mut self, what: &str, done: impl Fn(&Self) -> bool) -> usize {
        for n in 0..PATIENCE {
            if done(self) {
                return n;
            }
            self.read();
        }
        panic!("never: {what}; {:?}, {:?}", self.answer(), self.failure());
    }

    /// Discards everything from before now, so that the next read is newer.
    pub fn fresh(&mut self) -> &mut Self {
        while self.link.read(&mut self.report, Wait::Now).is_ok() {
            self.reports += 1;
        }
        self.read()
    }

    /// The program does not call the library for that time.
    pub fn sleep(&mut self, time: Duration) -> &mut Self {
        self.link.pass(time).expect("it passes");
        self
    }

    /// The board's time.
    pub fn now_ns(&self) -> u64 {
        self.link.pass(Duration::ZERO).expect("the link is open").expect("virtual time").0
    }

    pub fn answer(&self) -> MasterResponse {
        MasterResponse::decode(&self.report.slot(self.size, 0))
    }

    pub fn slot(&self, slave: usize) -> RawSlot {
        self.report.slot(self.size, slave)
    }

    /// A drive's slot; a pulse module has statusword and position of its first axis at the same bytes.
    pub fn drive(&self, slave: usize) -> DriveResponse {
        DriveResponse::decode(&self.slot(slave))
    }

    pub fn word(&self, slave: usize) -> Statusword {
        self.drive(slave).statusword
    }

    pub fn counters(&self) -> Counters {
        self.link.stats().board.expect("a board in this process")
    }

    pub fn failure(&self) -> Option<StateFailure> {
        self.link.stats().state_failure
    }

    /// Declares the slaves, their modes and the cycle.
    pub fn declare(&mut self, kinds: &[SlaveKind], modes: &[Option<Mode>], cycle_us: u32) -> &mut Self {
        for group in 0..5_u8 {
            let kind = |k| kinds.get(usize::from(group) * 8 + k).copied().unwrap_or(SlaveKind::None);
            self.master(MasterCommand::SetAxis { group, kinds: std::array::from_fn(kind) });
        }
        self.cycle_us = cycle_us;
        let cycle = CycleTime::from_us(cycle_us).expect("a cycle of the guide's");
        self.master(MasterCommand::SetDc { cycle, shift: DcShift::Auto });
        for (slave, mode) in (1..).zip(modes) {
            if let Some(mode) = *mode {
                self.slave(slave, SlaveCommand::DriveMode { mode, sync: DriveSync::DcSync });
            }
        }
        self
    }

    /// Requests a state; whether it is reached, or the change has failed.
    pub fn asks_for(&mut self, state: MasterState) -> bool {
        self.fresh().master(MasterCommand::SetState(state));
        // The first reports still have the state from before.
        self.read_some(2);
        let ended = |machine: &Self| {
            let shown = machine.answer().state;
            shown == StateByte::reached(state) || shown.is_failed()
        };
        self.until(&format!("state {state}"), ended);
        self.answer().state == StateByte::reached(state)
    }

    /// Requests a state and waits until it is reached.
    pub fn go(&mut self, state: MasterState) -> &mut Self {
        self.master(MasterCommand::SetState(state));
        self.until(&format!("state {state}"), |machine| machine.answer().state == StateByte::reached(state));
        self
    }

    /// That many drives in CSP, in OP.
    pub fn drives_in_op(&mut self, drives: usize, cycle_us: u32) -> &mut Self {
        self.declare(&vec![SlaveKind::Drive; drives], &vec![Some(Mode::Csp); drives], cycle_us);
        self.go(MasterState::Op).settle()
    }

    /// Waits until everything sent is executed and answered, on either bus.
    pub fn settle(&mut self) -> &mut Self {
        self.fresh();
        self.until("an empty FIFO", |machine| machine.answer().fifo_free == FIFO_ENTRIES);
        self.read_some(SETTLED)
    }

    /// Switches axes on together and waits for all.
    pub fn servo_on(&mut self, slaves: &[usize]) -> &mut Self {
        self.send(|frame, size| {
            slaves.iter().for_each(|slave| frame.put_slave(size, *slave, &SlaveCommand::ServoOn.into()))
        });
        self.until("servo on", |machine| slaves.iter().all(|slave| machine.word(*slave).is_enabled()));
        self
    }

    /// A transfer to its end.
    pub fn sdo(&mut self, command: SdoCommand) -> SdoResponse {
        self.fresh().send(|frame, size| frame.put_sdo(size, &command));
        let answer = |machine: &Self| SdoResponse::decode(&machine.report.slot(machine.size, machine.size.sdo_slot()));
        let is_it = |shown: SdoResponse| match (shown, command) {
            (
                SdoResponse::Done { id, slave, object, .. } | SdoResponse::Aborted { id, slave, object, .. },
                SdoCommand::Read { slave: of, object: asked } | SdoCommand::Write { slave: of, object: asked, .. },
            ) => (id, slave, object) == (command.id(), of, asked),
            _ => false,
        };
        // The answer to the same request of before stays until this one has ended.
        self.rest(if is_it(answer(self)) { 200 } else { 1 });
        self.until("the end of an SDO", |machine| is_it(answer(machine)));
        answer(self)
    }

    pub fn sdo_read(&mut self, slave: usize, index: u16, sub: u8) -> SdoResponse {
        self.sdo(SdoCommand::Read { slave: slave as u8, object: ObjectAddress::new(index, sub) })
    }
}
