//! A drive whose homing the test defines: the delay of bit 4, the duration, the result and the braking time. In CSP it
//! reaches each target at once and keeps the longest jump that was commanded.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};

use ecmsk::cia402::{DriveState, Statusword};
use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope, SdoSize};
use ecmsk::engine::{EngineConfig, EventKind, Firmware, HomingEnd, HomingPhase};
use ecmsk::fieldbus::sim::{SimBus, SimHandle};
use ecmsk::fieldbus::{AlState, AxisIn, AxisOut, Fieldbus, Ns};
use ecmsk::sk::{Frame, SlaveCommand};
use ecmsk::slave::{AlStatus, Slave};

use crate::host::Host;
use crate::puppet::{DISABLED, ENABLED, READY, SWITCHED_ON};
use crate::watch::{Spans, Watch};
use support::ahead_bus::{Ahead, AheadBus};
use support::images::{Images, number};

pub const BIT_4: u16 = 0x10;
pub const BIT_10: u16 = 1 << 10;
pub const BIT_12: u16 = 1 << 12;
pub const BIT_13: u16 = 1 << 13;
const RESULTS: u16 = BIT_10 | BIT_12 | BIT_13;

/// The course of a homing.
#[derive(Clone, Copy)]
pub struct Script {
    /// Cycles for which it does not see that bit 4 has changed.
    pub deaf: u32,
    /// Cycles from then to the end; 0: it is home at once, and its bits never clear.
    pub takes: u32,
    /// Bits 10, 12 and 13 at the end.
    pub result: u16,
    /// Cycles until the drive is at rest after bit 4 has fallen; it then shows bit 10.
    pub brakes: u32,
    /// The position that the home event gives it.
    pub home: i32,
}

impl Default for Script {
    fn default() -> Self {
        Self { deaf: 0, takes: 20, result: BIT_10 | BIT_12, brakes: 5, home: -700_000 }
    }
}

/// The drive's state.
pub struct State {
    al: AlState,
    pub shows: AxisIn,
    pub script: Script,
    /// 0x6060.
    pub mode: u8,
    pub objects: BTreeMap<u16, u32>,
    /// What was written: index and value.
    pub writes: Vec<(u16, u32)>,
    /// Controlwords since the test last cleared them, in CSP and homing alike.
    pub words: Vec<u16>,
    /// The newest outputs.
    pub last: AxisOut,
    /// The longest distance that CSP was commanded to go in one cycle.
    pub jump: i32,
    /// Cycles since bit 4 last changed.
    steady: u32,
    bit: bool,
    under_way: Option<u32>,
    braking: Option<u32>,
    /// Number of homings begun.
    pub begun: u32,
    images: Images,
}

/// The drive; clones are the same one.
#[derive(Clone)]
pub struct Homer(Arc<Mutex<State>>);

impl Homer {
    pub fn new() -> Self {
        let shows = AxisIn { statusword: Statusword(DISABLED), position: 5000, ..AxisIn::default() };
        Self(Arc::new(Mutex::new(State {
            al: AlState::Init,
            shows,
            script: Script::default(),
            mode: 8,
            objects: [0x6060, 0x6098, 0x607C, 0x6099, 0x609A].map(|index| (index, 0)).into(),
            writes: Vec::with_capacity(10_000),
            words: Vec::with_capacity(100_000),
            last: AxisOut::default(),
            jump: 0,
            steady: 0,
            bit: false,
            under_way: None,
            braking: None,
            begun: 0,
            images: Images::default(),
        })))
    }

    pub fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap()
    }

    pub fn script(&self, script: Script) {
        self.state().script = script;
    }

    /// Controlwords since the last call, repetitions left out, and at the start those that only hold it on.
    pub fn words(&self) -> Vec<u16> {
        let mut words: Vec<u16> = self.state().words.drain(..).collect();
        words.dedup();
        words.into_iter().skip_while(|word| *word == 0x0F).collect()
    }

    /// What was written to 0x6060 since the last call.
    pub fn modes(&self) -> Vec<u32> {
        let writes: Vec<(u16, u32)> = self.state().writes.drain(..).collect();
        writes.into_iter().filter(|(index, _)| *index == 0x6060).map(|(_, value)| value).collect()
    }

    pub fn jump(&self) -> i32 {
        self.state().jump
    }

    pub fn position(&self) -> i32 {
        self.state().shows.position
    }

    /// 0x6060.
    pub fn mode(&self) -> u8 {
        self.state().mode
    }

    /// The newest target.
    pub fn target(&self) -> i32 {
        self.state().last.target
    }

    /// Number of homings begun.
    pub fn begun(&self) -> u32 {
        self.state().begun
    }

    /// Falls into a state by itself.
    pub fn fall(&self, statusword: u16) {
        self.state().shows.statusword = Statusword(statusword);
    }
}

impl State {
    /// Processes outputs.
    pub fn obey(&mut self, out: &AxisOut) {
        use DriveState::*;
        let Statusword(word) = self.shows.statusword;
        let state = self.shows.statusword.state().expect("a state");
        let next = match (state, out.controlword.0 & 0x8F) {
            (Fault | FaultReactionActive, _) => word,
            (_, 0x00) => DISABLED,
            (SwitchOnDisabled | SwitchedOn | OperationEnabled, 0x06) => READY,
            (ReadyToSwitchOn | OperationEnabled, 0x07) => SWITCHED_ON,
            (SwitchedOn, 0x0F) => ENABLED,
            _ => word,
        };
        self.shows.statusword = Statusword(next & !RESULTS | word & RESULTS);
        self.last = *out;
        self.words.push(out.controlword.0);
        let enabled = self.shows.statusword.is_enabled();
        match self.mode {
            6 => self.home(out, enabled),
            _ => self.under_way = None,
        }
        if self.mode == 8 && enabled {
            self.jump = self.jump.max((out.target - self.shows.position).abs());
            self.shows.position = out.target;
            self.show(BIT_10 | BIT_12);
        }
        let bit = out.controlword.0 & BIT_4 != 0;
        self.steady = if bit == self.bit { self.steady + 1 } else { 0 };
        self.bit = bit;
    }

    fn show(&mut self, results: u16) {
        let word = &mut self.shows.statusword.0;
        *word = *word & !RESULTS | results;
    }

    fn home(&mut self, out: &AxisOut, enabled: bool) {
        let Script { deaf, takes, result, brakes, home } = self.script;
        let bit = out.controlword.0 & BIT_4 != 0;
        let steady = if bit == self.bit { self.steady + 1 } else { 0 };
        if !enabled {
            self.under_way = None;
        } else if bit && steady == deaf {
            self.begun += 1;
            self.under_way = Some(0);
            self.braking = None;
        } else if !bit && steady == deaf && self.under_way.take().is_some() {
            self.braking = Some(0);
        }
        if let Some(passed) = &mut self.under_way {
            *passed += 1;
            if *passed > takes {
                self.under_way = None;
                self.show(result);
                if result & BIT_12 != 0 {
                    self.shows.position = home;
                }
            } else {
                self.shows.position += 1000;
                self.show(0);
            }
        }
        if let Some(passed) = &mut self.braking {
            *passed += 1;
            if *passed >= brakes {
                self.braking = None;
                self.show(BIT_10);
            }
        }
    }
}

impl Slave for Homer {
    fn name(&self) -> &str {
        "homer"
    }

    fn state(&self) -> AlState {
        self.state().al
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        let mut state = Self::state(self);
        if target < AlState::Op && state.al == AlState::Op {
            state.shows.statusword = Statusword(DISABLED);
            state.under_way = None;
        }
        state.al = target;
        Ok(())
    }

    fn read(&mut self, object: ObjectAddress, _: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        let state = Self::state(self);
        if let Some(len) = state.images.read(object, value) {
            return Ok(len);
        }
        let Some(bits) = state.objects.get(&object.index) else {
            return Images::read_identity(object, value).ok_or(AbortCode::NO_OBJECT);
        };
        value[..4].copy_from_slice(&bits.to_le_bytes());
        Ok(4)
    }

    fn write(&mut self, object: ObjectAddress, _: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        let mut state = Self::state(self);
        let value = number(value);
        if state.images.take(object, value) {
            if object.index == 0x6060 {
                state.mode = value as u8;
            }
            return Ok(());
        }
        let kept = state.objects.get_mut(&object.index).ok_or(AbortCode::NO_OBJECT)?;
        if object.index == 0x6060 && value == 99 {
            return Err(AbortCode::VALUE_RANGE);
        }
        *kept = value;
        state.writes.push((object.index, value));
        if object.index == 0x6060 {
            state.mode = value as u8;
        }
        Ok(())
    }

    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]) {
        let mut state = Self::state(self);
        state.images.put_inputs(&[state.shows, AxisIn::default()], inputs);
        if let Some([out, _]) = outputs.map(|outputs| state.images.outputs(outputs)) {
            state.obey(&out);
        }
    }

    fn step(&mut self, _dt_ns: Ns) {}
}

fn watched(config: EngineConfig, bus: impl Fieldbus + 'static) -> (Host, Spans) {
    let (bus, jobs) = Watch::new(bus);
    (Host::new(config, bus), jobs)
}

/// A board with such drives.
pub struct Home {
    pub host: Host,
    pub drives: Vec<Homer>,
    pub network: SimHandle,
    pub jobs: Spans,
}

impl Home {
    /// In PreOP.
    pub fn in_preop(n: usize, firmware: Firmware, how: Option<Ahead>) -> Self {
        let drives: Vec<Homer> = (0..n).map(|_| Homer::new()).collect();
        let bus = SimBus::new(drives.iter().map(|drive| Box::new(drive.clone()) as Box<dyn Slave>).collect());
        let network = bus.handle();
        let config = EngineConfig { firmware, ..EngineConfig::default() };
        let (host, jobs) = match how {
            None => watched(config, bus),
            Some(how) => watched(config, AheadBus::new(bus, how)),
        };
        Self { host, drives, network, jobs }
    }

    /// In OP and on, CSP.
    pub fn on(n: usize, firmware: Firmware, how: Option<Ahead>) -> Self {
        let mut home = Self::in_preop(n, firmware, how);
        home.host.op(n);
        home.switch_on();
        home
    }

    pub fn switch_on(&mut self) {
        for slave in 1..=self.drives.len() {
            self.host.servo_on(slave);
        }
        self.host.cycles(30);
        self.drives.iter().for_each(|drive| {
            drive.words();
        });
    }

    /// One drive, on and in mode 6.
    pub fn ready(firmware: Firmware, how: Option<Ahead>) -> Self {
        Self::ready_of(1, firmware, how)
    }

    /// All drives on and in mode 6.
    pub fn ready_of(n: usize, firmware: Firmware, how: Option<Ahead>) -> Self {
        let mut home = Self::on(n, firmware, how);
        (1..=n).for_each(|slave| home.mode(slave, 6));
        home.host.cycles(30);
        home.drives.iter().for_each(|drive| {
            drive.words();
            drive.modes();
        });
        home
    }

    /// The host writes 0x6060, to its end.
    pub fn mode(&mut self, slave: usize, mode: u32) {
        // Another answer first, so that an old one does not match.
        self.host.read_object(slave as u8, 0x6098, 0).unwrap();
        assert_eq!(self.host.write_object(slave as u8, 0x6060, 0, SdoSize::One, mode), Ok(mode));
    }

    pub fn go_home(&mut self, slave: usize) -> &mut Host {
        self.host.slave(slave, SlaveCommand::GoHome)
    }

    /// A frame that asks for nothing arrives now.
    pub fn arrive_idle(&mut self) {
        self.host.arrive(&Frame::new());
    }

    pub fn drive(&self) -> &Homer {
        &self.drives[0]
    }

    pub fn phase(&self, slave: usize) -> HomingPhase {
        self.host.board.engine().homing_phase(slave as u8)
    }

    /// Waits until the board reports that phase for a slave.
    pub fn until_phase(&mut self, slave: usize, phase: HomingPhase) {
        let wanted = |host: &Host| host.board.engine().homing_phase(slave as u8) == phase;
        self.host.until(&format!("{phase:?}"), wanted);
    }

    /// Homings that ended since a mark: the slave and the end.
    pub fn ends(&self, mark: u64) -> Vec<(u8, HomingEnd)> {
        let events = self.host.board.engine().events_since(mark).filter_map(|event| match event.kind {
            EventKind::HomingEnded { slave, end, .. } => Some((slave, end)),
            _ => None,
        });
        events.collect()
    }

    /// Commands ignored so far.
    pub fn ignored(&self) -> u64 {
        self.host.counters().ignored_homing
    }
}
