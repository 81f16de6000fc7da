//! What passing frames say of a network, for whoever sees them and has not sent them: what slaves are declared as, how
//! they are run, and what was commanded last.

use std::sync::Arc;

use super::config::{Axis, Config, Slave};
use super::second::Second;
use super::snapshot::Plan;
use super::{Ecm, EcmError};
use crate::cia402::Mode;
use crate::recording::Kinds;
use crate::sk::{
    CycleTime, DriveSync, Frame, MasterCommand, MasterResponse, MasterState, RawSlot, SlaveCommand, SlaveKind,
    SlotCommand, SlotSize,
};

const SLAVES: usize = SlotSize::Bytes12.max_slaves();

/// What is known of one slave.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    mode: Option<(Mode, DriveSync)>,
    /// The last motion command and the one before.
    last: Option<SlaveCommand>,
    before: Option<SlaveCommand>,
    homing: bool,
}

/// Follows frames both ways. It holds what the board holds, as far as frames show it.
#[derive(Clone, Debug)]
pub struct Watch {
    kinds: Kinds,
    slaves: [Seen; SLAVES],
    cycle: CycleTime,
    state: Option<MasterState>,
}

impl Default for Watch {
    fn default() -> Self {
        Self { kinds: Kinds::new(None), slaves: [Seen::default(); SLAVES], cycle: CycleTime::DEFAULT, state: None }
    }
}

impl Watch {
    /// The network's state, by the newest report.
    pub const fn state(&self) -> Option<MasterState> {
        self.state
    }

    /// A command frame goes by that the board has taken.
    pub fn command(&mut self, frame: &Frame, size: SlotSize) {
        let set_up = !matches!(self.state, Some(MasterState::SafeOp | MasterState::Op));
        self.kinds.command(frame, size);
        match MasterCommand::decode(&frame.slot(size, 0), size) {
            Ok(MasterCommand::SetAxis { group, .. }) if set_up => {
                self.slaves.iter_mut().skip(usize::from(group) * 8).take(8).for_each(|seen| *seen = Seen::default());
            }
            Ok(MasterCommand::SetDc { cycle, .. }) if set_up => self.cycle = cycle,
            Ok(MasterCommand::SoftReset) => *self = Self::default(),
            _ => {}
        }
        let in_op = self.state == Some(MasterState::Op);
        for (n, seen) in (1..=size.max_slaves()).zip(&mut self.slaves) {
            // IO has other commands, and what is not declared has none.
            if matches!(self.kinds.of(n), Some(SlaveKind::Drive | SlaveKind::Hsp | SlaveKind::Step)) {
                seen.command(&frame.slot(size, n), size, set_up, in_op);
            }
        }
    }

    /// A report goes by.
    pub fn report(&mut self, frame: &Frame, size: SlotSize) {
        self.kinds.response(frame, size);
        self.state = MasterResponse::decode(&frame.slot(size, 0)).state.state();
        if self.state != Some(MasterState::Op) {
            for seen in &mut self.slaves {
                (seen.last, seen.before, seen.homing) = (None, None, false);
            }
        }
    }

    /// The network as a configuration; `None` if no SET_AXIS went by.
    pub fn config(&self) -> Option<Config> {
        let declared = |slave: &usize| self.kinds.of(*slave).is_some_and(|kind| kind != SlaveKind::None);
        let count = (1..=SLAVES).rev().find(declared)?;
        let slaves = (1..=count).zip(&self.slaves).map(|(n, seen)| seen.slave(self.kinds.of(n))).collect();
        Some(Config { slaves, cycle_us: self.cycle.us() })
    }

    /// Slaves that were sent home and have not been told anything else since.
    pub fn homing(&self) -> impl Iterator<Item = usize> {
        (1..).zip(&self.slaves).filter(|(_, seen)| seen.homing).map(|(n, _)| n)
    }
}

impl Seen {
    fn command(&mut self, slot: &RawSlot, size: SlotSize, set_up: bool, in_op: bool) {
        match SlotCommand::decode(slot, size).map(|command| command.command) {
            Ok(SlaveCommand::DriveMode { mode, sync }) if set_up => self.mode = Some((mode, sync)),
            _ if !in_op => {}
            Ok(command @ (SlaveCommand::Csp(_) | SlaveCommand::Csv(_) | SlaveCommand::Cst(_))) => {
                (self.before, self.last, self.homing) = (self.last, Some(command), false);
            }
            Ok(SlaveCommand::GoHome) => (self.before, self.last, self.homing) = (None, None, true),
            Ok(SlaveCommand::AbortHome) => self.homing = false,
            Ok(SlaveCommand::ServoOff | SlaveCommand::AlarmClear) => {
                (self.before, self.last, self.homing) = (None, None, false);
            }
            // A frame without a target: the axis stays where the last one was.
            _ => self.before = self.last,
        }
    }

    fn slave(&self, kind: Option<SlaveKind>) -> Slave {
        let (mode, sync) = self.mode.unwrap_or((Mode::Csp, DriveSync::DcSync));
        let axis = |allowed: &[Mode]| {
            let mode = if allowed.contains(&mode) { mode } else { Mode::Csp };
            Axis { mode, sync, ..Axis::CSP }
        };
        match kind {
            Some(SlaveKind::Drive) => Slave::Drive(axis(&[Mode::Csp, Mode::Csv, Mode::Cst])),
            Some(SlaveKind::Hsp) => Slave::Hsp(axis(&[Mode::Csp, Mode::Csv])),
            Some(SlaveKind::Step) => Slave::Step(axis(&[Mode::Csp])),
            Some(SlaveKind::Io) => Slave::Io,
            Some(SlaveKind::None) | None => Slave::Unused,
        }
    }
}

impl Ecm {
    /// As [`Ecm::adopt`], for a network that somebody else has run until now: what was commanded last is known too, so
    /// that closing can ramp it down.
    ///
    /// # Errors
    /// As [`Ecm::adopt`]. A network of which nothing is known is adopted as one without slaves.
    pub fn take_over(&self, watch: &Watch) -> Result<(), EcmError> {
        let Some(config) = watch.config() else { return Ok(()) };
        config.check(self.slot_size()?)?;
        let mut session = self.core.lock()?;
        session.plan = Arc::new(Plan::of(&config));
        session.second = Second::new();
        for (slave, seen) in (1..=config.slaves.len()).zip(&watch.slaves) {
            session.targets.told(slave, seen.last, seen.before);
        }
        Ok(())
    }
}
