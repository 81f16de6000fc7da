//! The slaves on a cable, and what a script does to them. Time is an argument; nothing here knows the network interface.

use super::ServeError;
use super::scripted::Scripted;
use crate::engine::Script as _;
use crate::ethercat::registers::AL_STATUS_CODE;
use crate::ethercat::{AlState, AlStatus, Frame, Ns, SlaveSet};
use crate::link::script::{RunningScript, Script};
use crate::link::simulated_slaves;
use crate::slave::Slave;
use crate::slave::cable::Cable;
use crate::slave::esc::{Chain, EscSettings, EscSlave, FrameFate, eeprom_of};

/// Slaves in a line, with the handle by which scripts and tests reach them.
pub struct Network {
    chain: Chain,
    cable: Cable,
    script: Option<RunningScript>,
    /// How many slaves the cable reaches.
    reach: u8,
    /// The slaves that answer.
    answering: SlaveSet,
    /// The states that were told of the slaves.
    told: Vec<(AlState, AlStatus)>,
    /// What has happened that nobody has taken yet.
    lines: Vec<String>,
}

impl Network {
    /// Slaves in a line that are switched on at time 0, when the script begins.
    ///
    /// # Errors
    /// [`ServeError::Description`]: a device does not say what belongs into its EEPROM.
    pub fn new(devices: Vec<Box<dyn Slave>>, script: Option<Script>) -> Result<Self, ServeError> {
        let (cable, settings) = (Cable::default(), EscSettings::default());
        let on_cable = |(n, device): (usize, Box<dyn Slave>)| {
            let mut device = device;
            let kind = device.name().to_owned();
            let eeprom = eeprom_of(&mut *device, &settings);
            let eeprom = eeprom.map_err(|source| ServeError::Description { slave: n + 1, kind, source })?;
            let device = Box::new(Scripted::new(device, cable.clone(), n as u8 + 1));
            Ok(EscSlave::new(device, settings.clone(), eeprom, 0))
        };
        let slaves = devices.into_iter().enumerate().map(on_cable).collect::<Result<Vec<_>, ServeError>>()?;
        let told = vec![(AlState::Init, AlStatus::NONE); slaves.len()];
        Ok(Self {
            answering: SlaveSet::first(slaves.len() as u8),
            chain: Chain::line(slaves),
            script: script.map(|script| simulated_slaves::start(script, cable.clone(), 0)),
            reach: cable.reach(),
            cable,
            told,
            lines: Vec::new(),
        })
    }

    /// The cable, for faults.
    pub const fn cable(&self) -> &Cable {
        &self.cable
    }

    /// The slaves.
    pub const fn chain(&self) -> &Chain {
        &self.chain
    }

    /// Whether the frame is one of a master: EtherCAT with datagrams that no slave has had yet.
    pub fn is_masters(frame: &[u8]) -> bool {
        Frame::decode(frame).is_ok_and(|frame| frame.datagrams().is_some())
    }

    /// A frame comes at `now` and is changed in place; false: it does not come back. Times have to ascend.
    pub fn answer(&mut self, frame: &mut [u8], now: Ns) -> bool {
        self.carry_out(now);
        let fate = self.chain.process(frame, now);
        // A master may acknowledge an error before time passes again.
        self.tell_states(|(_, code)| code != AlStatus::NONE);
        matches!(fate, FrameFate::Returned(_))
    }

    /// Time passes up to `now`.
    pub fn advance(&mut self, now: Ns) {
        self.carry_out(now);
        self.chain.advance(now);
        self.tell_states(|_| true);
    }

    /// The lines on what has happened since the last call.
    pub fn take_lines(&mut self) -> impl Iterator<Item = String> {
        self.lines.drain(..)
    }

    /// What the script wants is done to the slaves.
    fn carry_out(&mut self, now: Ns) {
        let lines = &mut self.lines;
        if let Some(script) = &mut self.script {
            script.run(now, &mut |event| lines.push(event.to_string()));
        }
        let chain = &mut self.chain;
        let place = |slave: u8| usize::from(slave) - 1;
        let last = chain.len() as u8;
        let reach = self.cable.reach();
        if reach != std::mem::replace(&mut self.reach, reach) {
            (1..=last).for_each(|slave| chain.connect(place(slave), place(slave) != usize::from(reach)));
        }
        for slave in self.cable.take_powered_off().iter().filter(|slave| *slave <= last) {
            chain.power(place(slave), false, now);
            chain.power(place(slave), true, now);
        }
        let answering =
            self.cable.answering().union(SlaveSet::first(last).difference(SlaveSet::first(reach.min(last))));
        if answering != std::mem::replace(&mut self.answering, answering) {
            (1..=last).for_each(|slave| chain.silence(place(slave), !answering.contains(slave)));
        }
        self.cable.take_faults(|slave, fault| {
            if (1..=last).contains(&slave) {
                chain.slave_mut(place(slave)).device_mut().apply_fault(fault);
            }
        });
    }

    /// Makes lines of the states of `which` that have changed, one for neighbours that have changed alike.
    fn tell_states(&mut self, which: impl Fn((AlState, AlStatus)) -> bool) {
        let mut n = 0;
        while n < self.told.len() {
            let state = state_of(self.chain.slave(n));
            let is_alike =
                |n: &usize| which(state) && self.told[*n] != state && state_of(self.chain.slave(*n)) == state;
            let end = (n..self.told.len()).find(|n| !is_alike(n)).unwrap_or(self.told.len());
            if end > n {
                self.lines.push(line_of(n, end, state));
                self.told[n..end].fill(state);
            }
            n = end.max(n + 1);
        }
    }
}

/// The AL state of a slave and why it is there; 0: as the master wanted.
fn state_of(slave: &EscSlave) -> (AlState, AlStatus) {
    let code = slave.controller().peek(AL_STATUS_CODE, 2);
    let code = code.try_into().map_or(0, u16::from_le_bytes);
    (slave.state(), AlStatus(code))
}

/// The line on the slaves from the place `first` to the one before `end`.
fn line_of(first: usize, end: usize, (state, code): (AlState, AlStatus)) -> String {
    let who = match end - first {
        1 => format!("slave {} is", first + 1),
        _ => format!("slaves {} to {end} are", first + 1),
    };
    let state = match state {
        AlState::Init => "Init",
        AlState::PreOp => "PreOP",
        AlState::SafeOp => "SafeOP",
        AlState::Op => "OP",
    };
    match code {
        AlStatus::NONE => format!("{who} in {state}"),
        code => format!("{who} in {state} with AL status {code}"),
    }
}
