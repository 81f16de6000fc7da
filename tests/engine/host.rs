//! A host with its board: sends typed commands, reads typed answers, lets time pass. There is no link and no runner.

use std::any::Any;
use std::env;
use std::io::{self, Write};
use std::thread;

use ecmsk::coe::{AbortCode, ObjectAddress, SdoSize};
use ecmsk::engine::{Board, Counters, EngineConfig, EventKind, Reason, Rejection};
use ecmsk::fieldbus::nic::{ChainWires, NicBus};
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::fieldbus::{Fieldbus, Ns, Pacing};
use ecmsk::master::Settings;
use ecmsk::sk::{
    CommandId, DriveResponse, FIFO_ENTRIES, Frame, MasterCommand, MasterResponse, MasterState, Motion, RawSlot,
    SdoCommand, SdoResponse, SlaveCommand, SlaveKind, SlotSize, StateByte,
};

use crate::watch::Watch;
use ecmsk::slave::Slave;
use support::ahead_bus::{Ahead, AheadBus};
use support::chip_line::xf_bus_reached_by;

/// The time of a write: one USB microframe.
pub const MICROFRAME: Ns = 125_000;
/// The longest boot in these tests.
pub const BOOT_LIMIT: Ns = 60_000_000_000;
/// The longest change of state in these tests, in reports.
const PATIENCE: usize = 30_000;

/// Cycles after which [`Ahead::chip`] has answered at the latest.
const LATE: usize = 12;

/// A board and its newest report.
pub struct Host {
    pub board: Board,
    pub size: SlotSize,
    pub report: Frame,
    /// Reports so far.
    pub reports: u64,
    /// The bus answers late.
    is_late: bool,
}

/// In the environment of a run (tests/engine/over.rs): every board gets a bus that takes outputs ahead, except in tests
/// that choose such a bus themselves. The value is one of those below.
pub const OVER: &str = "ECMSK_TEST_OVER";
/// After the cycles of a test, [`LATE`] more cycles pass.
pub const SETTLED: &str = "settled";
/// No more cycles pass.
pub const ONE_BY_ONE: &str = "one_by_one";
/// As [`SETTLED`], but the simulated network is behind the model of an ECM-XF.
pub const XF_SETTLED: &str = "xf_settled";
/// As [`ONE_BY_ONE`], likewise.
pub const XF_ONE_BY_ONE: &str = "xf_one_by_one";
/// The simulated network is at the end of a wire, as slave controllers behind this project's own master.
pub const NIC: &str = "nic";
/// The prefix on standard error in such a run; the name of each test follows that has a board whose slaves are behind
/// the chip, or at the end of the wire.
pub const SLAVES_MOVED: &str = "slaves moved: ";

/// Whether this is such a run.
pub fn is_over() -> bool {
    env::var_os(OVER).is_some()
}

/// A board that has booted over that bus, or with that bus behind one that takes outputs ahead.
pub fn on(how: Option<Ahead>, config: EngineConfig, bus: impl Fieldbus + 'static) -> Host {
    match how {
        None => Host::new(config, bus),
        Some(how) => Host::new(config, AheadBus::new(bus, how)),
    }
}

/// The slaves behind the model of an ECM-XF.
fn chip(slaves: Vec<Box<dyn Slave>>, handle: SimHandle) -> impl Fieldbus {
    xf_bus_reached_by(slaves, handle, XfBusOptions::DEFAULT)
}

/// The slaves at the end of a wire.
fn wire(slaves: Vec<Box<dyn Slave>>, handle: SimHandle) -> impl Fieldbus {
    let wires = ChainWires::new(slaves, handle).expect("its slaves have an EEPROM");
    NicBus::new(wires, Settings::default())
}

/// Puts the slaves of a simulated network, watched or not, behind another bus; a bus of another kind stays as it is.
fn behind<B: Fieldbus + 'static, F: Fieldbus + 'static>(
    bus: B,
    put: fn(Vec<Box<dyn Slave>>, SimHandle) -> F,
) -> Box<dyn Fieldbus> {
    let put_behind = |sim: SimBus| {
        // This bypasses the captured output of a test: tests/engine/over.rs reads it.
        let test = thread::current();
        let _ = writeln!(io::stderr(), "{SLAVES_MOVED}{}", test.name().unwrap_or_default());
        let (slaves, handle) = sim.into_parts();
        put(slaves, handle)
    };
    let mut bus = Some(bus);
    let any = &mut bus as &mut dyn Any;
    if let Some(sim) = any.downcast_mut::<Option<SimBus>>() {
        return Box::new(put_behind(sim.take().expect("it is there")));
    }
    if let Some(watched) = any.downcast_mut::<Option<Watch<SimBus>>>() {
        return Box::new(watched.take().expect("it is there").over(put_behind));
    }
    Box::new(bus.expect("it is there"))
}

impl Host {
    /// A board that has booted.
    pub fn new(config: EngineConfig, bus: impl Fieldbus + 'static) -> Self {
        let over = env::var(OVER).ok().filter(|_| bus.pacing() == Pacing::Runner);
        let is_late = over.as_ref().is_some_and(|how| [SETTLED, XF_SETTLED, NIC].contains(&how.as_str()));
        let bus: Box<dyn Fieldbus> = match over.as_deref() {
            None => Box::new(bus),
            Some(XF_SETTLED | XF_ONE_BY_ONE) => behind(bus, chip),
            Some(NIC) => behind(bus, wire),
            Some(_) => Box::new(AheadBus::new(bus, Ahead::chip())),
        };
        let mut board = Board::new(config, bus);
        assert!(board.boot(BOOT_LIMIT), "the board does not talk");
        Self { board, size: config.slot, report: Frame::new(), reports: 0, is_late }
    }

    /// Sends a frame; it arrives a microframe later.
    pub fn send(&mut self, frame: &Frame) -> &mut Self {
        let at = self.board.now() + MICROFRAME;
        let Self { board, report, reports, .. } = self;
        board.host(frame, at, &mut |frame, _| {
            report.clone_from(frame);
            *reports += 1;
        });
        self
    }

    /// Sends a frame that was put together by `build`, with its CRC.
    pub fn build(&mut self, build: impl FnOnce(&mut Frame, SlotSize)) -> &mut Self {
        let mut frame = Frame::new();
        build(&mut frame, self.size);
        frame.fill_crc(self.size);
        self.send(&frame)
    }

    /// Sends a command for the board itself.
    pub fn master(&mut self, command: MasterCommand) -> &mut Self {
        self.build(|frame, size| frame.put_master(size, &command))
    }

    /// Sends a command for one slave, index 0.
    pub fn slave(&mut self, slave: usize, command: SlaveCommand) -> &mut Self {
        self.build(|frame, size| frame.put_slave(size, slave, &command.into()))
    }

    /// Sends an SDO command.
    pub fn sdo(&mut self, command: SdoCommand) -> &mut Self {
        self.build(|frame, size| frame.put_sdo(size, &command))
    }

    /// Sends a raw slot.
    pub fn raw(&mut self, slot: usize, raw: RawSlot) -> &mut Self {
        self.build(|frame, size| frame.put(size, slot, &raw))
    }

    /// Sends a frame that asks for nothing.
    pub fn idle(&mut self) -> &mut Self {
        self.build(|_, _| {})
    }

    /// Sends SW_RESET and waits until the board talks again; earlier reports are dropped.
    pub fn soft_reset(&mut self) -> &mut Self {
        self.master(MasterCommand::SoftReset);
        assert!(self.board.boot(BOOT_LIMIT), "the board does not talk after SW_RESET");
        self.report = Frame::new();
        self
    }

    /// Lets one cycle pass; returns whether it brought a report.
    pub fn cycle(&mut self) -> bool {
        let came = self.one_cycle();
        if self.is_late {
            for _ in 0..LATE {
                self.one_cycle();
            }
        }
        came
    }

    fn one_cycle(&mut self) -> bool {
        let before = self.reports;
        let Self { board, report, reports, .. } = self;
        board.cycle(&mut |frame, _| {
            report.clone_from(frame);
            *reports += 1;
        });
        self.reports > before
    }

    /// Lets `n` cycles pass.
    pub fn cycles(&mut self, n: usize) -> &mut Self {
        for _ in 0..n {
            self.one_cycle();
        }
        if self.is_late {
            for _ in 0..LATE {
                self.one_cycle();
            }
        }
        self
    }

    /// Lets cycles pass until `done` returns true.
    pub fn until(&mut self, what: &str, mut done: impl FnMut(&Self) -> bool) -> &mut Self {
        for _ in 0..PATIENCE {
            if done(self) {
                return self;
            }
            self.one_cycle();
        }
        panic!("never: {what}; newest answer {:?}, {:?}", self.answer(), self.board.engine().state_failure());
    }

    /// Slot 0 of the newest report.
    pub fn answer(&self) -> MasterResponse {
        MasterResponse::decode(&self.report.slot(self.size, 0))
    }

    /// A drive's slot of the newest report.
    pub fn drive(&self, slave: usize) -> DriveResponse {
        DriveResponse::decode(&self.report.slot(self.size, slave))
    }

    /// The SDO slot of the newest report.
    pub fn sdo_answer(&self) -> SdoResponse {
        SdoResponse::decode(&self.report.slot(self.size, self.size.sdo_slot()))
    }

    pub fn state(&self) -> StateByte {
        self.answer().state
    }

    /// A raw slot of the newest report.
    pub fn slot(&self, slot: usize) -> RawSlot {
        self.report.slot(self.size, slot)
    }

    /// The counters outside the wire.
    pub fn counters(&self) -> Counters {
        *self.board.engine().counters()
    }

    /// Events so far: a mark for [`Host::rejections`].
    pub fn mark(&self) -> u64 {
        self.board.engine().events_total()
    }

    /// Rejections since a mark: slot, id and reason.
    pub fn rejections(&self, mark: u64) -> Vec<(u8, CommandId, Reason)> {
        let events = self.board.engine().events_since(mark).filter_map(|event| match event.kind {
            EventKind::Rejected(Rejection { slot, id, reason }) => Some((slot, id, reason)),
            _ => None,
        });
        events.collect()
    }

    /// Declares slaves 1..=n drives, the others none.
    pub fn declare_drives(&mut self, n: usize) -> &mut Self {
        for group in 0..5u8 {
            let mut kinds = [SlaveKind::None; 8];
            for (k, kind) in kinds.iter_mut().enumerate() {
                if usize::from(group) * 8 + k < n {
                    *kind = SlaveKind::Drive;
                }
            }
            self.master(MasterCommand::SetAxis { group, kinds });
        }
        self
    }

    /// Asks for a state and waits until the state byte shows it.
    pub fn go(&mut self, state: MasterState) -> &mut Self {
        self.master(MasterCommand::SetState(state));
        self.until(&format!("state {state}"), |host| host.state() == StateByte::reached(state))
    }

    /// OP with `n` drives in CSP.
    pub fn op(&mut self, n: usize) -> &mut Self {
        self.declare_drives(n).go(MasterState::Op).drained()
    }

    /// Waits until the FIFO is empty.
    pub fn drained(&mut self) -> &mut Self {
        self.cycle();
        self.until("an empty FIFO", |host| host.answer().fifo_free == FIFO_ENTRIES)
    }

    /// Waits until the drive shows Operation enabled after an SV_ON.
    pub fn servo_on(&mut self, slave: usize) -> &mut Self {
        self.slave(slave, SlaveCommand::ServoOn);
        self.until("Operation enabled", |host| host.drive(slave).statusword.is_enabled())
    }

    /// Sends a target position.
    pub fn csp(&mut self, slave: usize, target: i32) -> &mut Self {
        self.slave(slave, SlaveCommand::Csp(Motion::to(target)))
    }

    /// Reads an object to its end.
    pub fn read_object(&mut self, slave: u8, index: u16, sub: u8) -> Result<u32, AbortCode> {
        self.transfer(SdoCommand::Read { slave, object: ObjectAddress::new(index, sub) })
    }

    /// Writes an object to its end.
    pub fn write_object(
        &mut self,
        slave: u8,
        index: u16,
        sub: u8,
        size: SdoSize,
        value: u32,
    ) -> Result<u32, AbortCode> {
        self.transfer(SdoCommand::Write { slave, object: ObjectAddress::new(index, sub), size, value })
    }

    /// One transfer; the slot must not show the same answer already.
    fn transfer(&mut self, command: SdoCommand) -> Result<u32, AbortCode> {
        self.cycle();
        let before = self.sdo_answer();
        self.sdo(command);
        self.until("the end of an SDO transfer", |host| host.sdo_answer() != before);
        match self.sdo_answer() {
            SdoResponse::Done { value, .. } => Ok(value),
            SdoResponse::Aborted { code, .. } => Err(code),
            other => panic!("{other:?}"),
        }
    }
}
