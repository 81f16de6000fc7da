//! A writer of a served board that does whatever bytes say, at any threshold and level of the FIFO, in CSP, CSV, CST and homing,
//! and then is gone: its axes stand within the documented time, and nothing that it has left moves one of them later.

#![no_main]

#[path = "../../tests/invariants/ends/eyes.rs"]
#[allow(dead_code, reason = "ramps are not compared with what any bytes say")]
mod eyes;
#[path = "support/frames.rs"]
mod frames;
#[path = "../../tests/invariants/machine.rs"]
#[allow(dead_code, reason = "the board runs behind a link")]
mod machine;
#[path = "../../tests/invariants/ends/standstill.rs"]
mod standstill;
#[path = "../../tests/invariants/tap.rs"]
mod tap;

use std::sync::Arc;
use std::time::Duration;

use ecmsk::cia402::Mode;
use ecmsk::coe::{ObjectAddress, SdoSize};
use ecmsk::link::Link;
use ecmsk::link::engine::{EngineLink, RunOptions};
use ecmsk::port::tcp::ServeOptions;
use ecmsk::port::tcp::in_memory::{ClientMessage, InMemoryClient, InMemoryServer};
use ecmsk::sk::{
    CommandId, CycleTime, FifoAction, Frame, MasterCommand, MasterResponse, MasterState, SdoCommand, SlaveCommand,
    SlotSize,
};
use eyes::{Break, Eyes};
use libfuzzer_sys::fuzz_target;
use machine::{Machine, SPEED, Unit};
use standstill::{DOCUMENTED, End, assert_lasting, heal};

/// Bytes of a step.
const STEP: usize = 16;
/// Messages of a writer at most: a model lives through the time between them.
const MESSAGES_MAX: u32 = 4000;
/// With a longer cycle there may be too few of them in the documented time, and the server says so.
const CYCLE_MAX_US: u32 = 16_000;
/// A drive that was just told to stand comes to rest, and no longer than that.
const COMES_TO_REST: Duration = Duration::from_millis(50);

fuzz_target!(|bytes: &[u8]| {
    let Some((&[seed, timing, host, end], bytes)) = bytes.split_first_chunk() else { return };
    let mut machine = Machine::new(seed.into());
    let cycle_us = [250, 500, 1000, 1000, 1000, 2000, 4000, 8000][usize::from(timing & 7)];
    machine.cycle = CycleTime::from_us(cycle_us).expect("a cycle of the guide's");
    let set_up = machine.set_up();
    let Machine { board, network, size, units, .. } = machine;
    let host_ns = [0, 1000, 125_000, 125_000][usize::from(host & 3)];
    let run = RunOptions { host_ns, queue: [1, 4, 32, 32][usize::from(host >> 2 & 3)], ..RunOptions::default() };
    let link = EngineLink::open("sim:", board, run, None).expect("it talks");
    let eyes = Arc::new(Eyes::new(link, network, &units));
    let options = ServeOptions {
        tell: Arc::new(|line| panic!("nobody takes what a server tells people: {line}")),
        ..ServeOptions::default()
    };
    let server = InMemoryServer::new(Arc::clone(&eyes) as Arc<dyn Link>, options);
    let caller = server.join(true).expect("the place is free");
    let (at, speed) = (vec![[0; 2]; units.len()], vec![[0; 2]; units.len()]);
    let mut writer = Writer { caller, eyes: &eyes, units: &units, size, cycle_us, left: MESSAGES_MAX, at, speed };
    if timing & 8 == 0 {
        writer.come_up(&set_up);
    }
    let mut frame = Frame::new();
    for step in bytes.chunks_exact(STEP) {
        writer.step(step, &mut frame);
    }
    if eyes.check().is_err() {
        // SW_RESET: the link has ended with it, and the drives have lost their master.
        return;
    }
    let mut caller = writer.caller;
    match end & 3 {
        // It dies in the middle of a message, or while it waits.
        0 => drop(caller.say(
            ClientMessage::Write(&frame),
            usize::from(end >> 2) * 8 % InMemoryClient::length(ClientMessage::Write(&frame)),
        )),
        1 => drop(caller.begin(ClientMessage::Pass(Duration::from_millis(end.into())), usize::MAX)),
        _ => {}
    }
    if host >> 4 != 0 {
        let what = [Break::Cable(seed & 3), Break::Silence(2), Break::Power(2), Break::Alarm(2)];
        eyes.break_in(u64::from(host >> 4) * 4, what[usize::from(timing >> 4 & 3)]);
    }
    let end = End::of(caller, &server, &eyes, cycle_us);
    let was_broken = heal(&eyes, cycle_us);
    assert!(
        !end.has_failed() || was_broken || cycle_us > CYCLE_MAX_US,
        "{:?}, entries held: {}",
        end.told,
        end.was_held
    );
    // Drives that were on their way out of OP, or have failed, brake by themselves, as long as it takes.
    let report = eyes.report();
    let is_on = |unit: &Unit| unit.answer(&report, size).0.is_enabled();
    let held =
        MasterResponse::decode(&report.slot(size, 0)).state.state() == Some(MasterState::Op) && units.iter().all(is_on);
    let rest = if held { COMES_TO_REST } else { DOCUMENTED.saturating_sub(end.took).max(COMES_TO_REST) };
    assert_lasting(&server, &eyes, &[], rest, cycle_us);
});

struct Writer<'a> {
    caller: InMemoryClient<'a>,
    eyes: &'a Eyes,
    units: &'a [Unit],
    size: SlotSize,
    cycle_us: u32,
    left: u32,
    /// Where its axes were sent, and how fast.
    at: Vec<[i32; 2]>,
    speed: Vec<[i32; 2]>,
}

impl Writer<'_> {
    /// All axes are on.
    fn come_up(&mut self, set_up: &[Frame]) {
        set_up.iter().for_each(|frame| self.write(frame));
        for _ in 0..300 {
            self.say(ClientMessage::Read);
            if self.state() == Some(MasterState::Op) {
                break;
            }
        }
        let mut on = Frame::new();
        self.units.iter().for_each(|unit| on.put_slave(self.size, unit.slave, &SlaveCommand::ServoOn.into()));
        self.write(&on);
        for _ in 0..400 {
            self.say(ClientMessage::Read);
            let report = self.eyes.report();
            if self.units.iter().all(|unit| unit.answer(&report, self.size).0.is_enabled()) {
                break;
            }
        }
        self.look();
    }

    /// Paths begin where axes are.
    fn look(&mut self) {
        let report = self.eyes.report();
        self.at = self.units.iter().map(|unit| unit.answer(&report, self.size).1).collect();
    }

    fn state(&self) -> Option<MasterState> {
        MasterResponse::decode(&self.eyes.report().slot(self.size, 0)).state.state()
    }

    fn step(&mut self, step: &[u8], frame: &mut Frame) {
        let [what, a, b, c, low, high, ..] = *step else { return };
        let place = usize::from(b) % self.units.len();
        let slave = self.units[place].slave;
        match what % 10 {
            0 => (0..=a % 64).for_each(|_| self.say(ClientMessage::Read)),
            1 => self.say(ClientMessage::Pass(Duration::from_micros(u64::from(a) * u64::from(self.cycle_us)))),
            2 => {
                for _ in 0..=a % 64 {
                    self.write(frame);
                    if b & 1 == 0 {
                        self.say(ClientMessage::Read);
                    }
                }
            }
            3 if b & 7 == 0 => self.master(FifoAction::Clear),
            3 => self.master(FifoAction::Threshold(a.max(1).into())),
            4 => self.drive(u32::from(a), place, i16::from_le_bytes([low, high]), c),
            5 => {
                self.object(slave, 0x6060, 6);
                self.object(slave, 0x6098, [17, 18, 19, 21, 24, 33, 35, 37][usize::from(c) % 8]);
                self.slave(slave, SlaveCommand::GoHome);
                (0..a).for_each(|_| self.say(ClientMessage::Read));
            }
            6 => {
                self.object(slave, if a & 1 == 0 { 0x6060 } else { 0x6098 }, [6, 8, 9, 10, 35, 33][usize::from(c) % 6])
            }
            7 => {
                use SlaveCommand::{AbortHome, AlarmClear, GetStatus, GoHome, ServoOff, ServoOn};
                let command = [ServoOn, ServoOff, AlarmClear, AbortHome, GoHome, GetStatus][usize::from(a) % 6];
                self.slave(slave, command);
            }
            8 => {
                // Any command, but for SDOs that make another drive of it.
                let place = usize::from(a) % self.size.sdo_slot();
                let slot = frames::slot(&step[4..]);
                frame.put(self.size, place, &slot);
                if place > 0 && CommandId::from_code(slot.id) == CommandId::Cst {
                    // Friction holds it: how far an axis goes by more is the program's affair.
                    frame.put_slave(self.size, place, &SlaveCommand::Cst(slot.data1 as i16 % 25).into());
                }
            }
            _ if a & 1 == 0 => *frame = Frame::new(),
            _ => self.look(),
        }
    }

    /// Moves its axes for so many frames; one of them gets another speed. All bits of `how` but the first say how often
    /// reports are read meanwhile.
    fn drive(&mut self, frames: u32, place: usize, share: i16, how: u8) {
        let a_frame = i64::from(SPEED) * i64::from(self.cycle_us) / 1_000_000;
        let fastest = if self.units[place].mode == Mode::Csp { a_frame } else { SPEED.into() };
        let goal = (i64::from(share) * fastest / i64::from(i16::MAX)) as i32;
        for n in 0..=frames {
            let mut frame = Frame::new();
            for (i, unit) in self.units.iter().enumerate() {
                for axis in 0..unit.axes {
                    if i == place && axis == usize::from(how & 1) {
                        let change = (goal.abs() / 50).max(1);
                        let speed = &mut self.speed[i][axis];
                        *speed += (goal - *speed).clamp(-change, change);
                    }
                    self.at[i][axis] = self.at[i][axis].wrapping_add(self.speed[i][axis]);
                }
                frame.put_slave(self.size, unit.slave, &unit.motion(self.at[i], self.speed[i]).into());
            }
            self.write(&frame);
            if n.is_multiple_of(1 + u32::from(how >> 1)) {
                self.say(ClientMessage::Read);
            }
        }
    }

    fn object(&mut self, slave: usize, index: u16, value: u8) {
        let object = ObjectAddress::new(index, 0);
        let mut frame = Frame::new();
        frame.put_sdo(
            self.size,
            &SdoCommand::Write { slave: slave as u8, object, size: SdoSize::One, value: value.into() },
        );
        self.write(&frame);
        (0..10).for_each(|_| self.say(ClientMessage::Read));
    }

    fn master(&mut self, action: FifoAction) {
        let mut frame = Frame::new();
        frame.put_master(self.size, &MasterCommand::SetFifo(action));
        self.write(&frame);
    }

    fn slave(&mut self, slave: usize, command: SlaveCommand) {
        let mut frame = Frame::new();
        frame.put_slave(self.size, slave, &command.into());
        self.write(&frame);
    }

    fn write(&mut self, frame: &Frame) {
        self.say(ClientMessage::Write(frame));
    }

    fn say(&mut self, what: ClientMessage<'_>) {
        if self.left == 0 || self.eyes.check().is_err() {
            return;
        }
        self.left -= 1;
        self.caller.say(what, usize::MAX);
        drop(self.caller.take_sent());
    }
}
