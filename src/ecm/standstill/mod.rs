//! Bringing axes to a standstill from the host. The axes stay enabled.
//!
//! Entries that are ahead are executed first: they are the way on which the axes were sent. In CSP the axes then hold its end; velocities
//! and torques are ramped from there. Of a program's own axes it is known what was commanded last. Of those of another program it may
//! not be known, and then the ramp waits until the FIFO is empty, and begins with what reports show.
//!
//! How to read this folder: here is the whole of a stop; `movement.rs` says whether an axis moves, `axis_ramp.rs` how one axis is
//! ramped, `left_behind.rs` what becomes of entries that wait in the FIFO, `close.rs` what closing a board does beside it.

mod axis_ramp;
mod close;
mod left_behind;
mod movement;

use std::sync::Arc;
use std::time::Duration;

use parking_lot::MutexGuard;

use axis_ramp::{AxisRamp, needs_observation, ramp_from_position, ramp_of};
use movement::Observation;

use super::config::Slave;
use super::exchange::{Session, ahead_of_the_board};
use super::{Ecm, EcmError};
use crate::ethercat::SlaveSet;
use crate::sk::{FIFO_ENTRIES, FifoAction, MasterCommand, SlaveCommand, SlotCommand, SlotSize};

/// \[OURS] Frames of the ramp that are ahead of the board at most.
const AHEAD_MAX: u16 = 64;
/// \[OURS] The time for axes to come to rest after the ramp.
const SETTLING_TIME: Duration = Duration::from_millis(200);
/// \[OURS] The same in cycles, if the cycle is long.
const SETTLING_CYCLES: u32 = 3;

/// \[OURS] For how long a stop waits for a report that shows the present, and for how many cycles.
const PRESENT_MAX: Duration = Duration::from_millis(20);
const PRESENT_CYCLES: u32 = 3;

/// \[OURS] A ramp has at least that many frames, if the cycle is long.
pub const RAMP_FRAMES_MIN: u32 = 4;

/// What a program has left, whose axes are brought to a standstill.
#[derive(Clone, Copy, Debug, Default)]
pub struct LeftBehind {
    /// It is another program, which has ended: what it was about to do is not known.
    pub is_foreign: bool,
    /// Slaves to which it may have sent GO_HOME.
    pub homing: SlaveSet,
    /// It has set a threshold that may be in force.
    pub has_threshold: bool,
    /// The board takes no entry out of its FIFO, though there are some.
    pub is_held: bool,
    /// Entries that were discarded.
    pub discarded: u16,
}

/// The part of a limit that is kept for axes to come to rest after the ramp.
pub fn settling_time(cycle: Duration) -> Duration {
    SETTLING_TIME.max(cycle * SETTLING_CYCLES)
}

/// Ramps the axes that move to a standstill, by `deadline`. If that fails no entry is left in the FIFO that moves an axis later.
pub fn to_standstill(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
    left: &mut LeftBehind,
) -> Result<(), EcmError> {
    let mut stop = Stop::new(ecm, session, deadline, left);
    let stood = stop.until_all_stand();
    if matches!(&stood, Err(error) if !matches!(error, EcmError::Link(_))) {
        // The error of the stop says why axes do not stand; one of this frame would say less.
        let _ = stop.in_one_step();
    }
    stood
}

/// Discards the entries that wait for a threshold, of a network of which nothing else is known.
pub fn discard_held(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
    left: &mut LeftBehind,
) -> Result<(), EcmError> {
    let mut stop = Stop::new(ecm, session, deadline, left);
    // The error of the discarding says more than one of the last frame.
    stop.discard_held().inspect_err(|_| drop(stop.in_one_step()))
}

/// The ramps of slaves' axes, by slot; `None` for a slave that needs none.
type AxisRamps = [Option<AxisRamp>; SlotSize::Bytes12.slots()];

/// A stop under way.
struct Stop<'a, 's> {
    ecm: &'a Ecm,
    session: &'a mut MutexGuard<'s, Session>,
    began: Duration,
    deadline: Duration,
    left: &'a mut LeftBehind,
    /// Slaves whose axes have been ramped.
    ramped: SlaveSet,
    /// The board takes entries out of its FIFO, whatever threshold was in force.
    unlocked: bool,
    /// An axis may have moved since the stop began: one that stands for a cycle may be where it turns back to its target.
    has_moved: bool,
}

impl<'a, 's> Stop<'a, 's> {
    fn new(
        ecm: &'a Ecm,
        session: &'a mut MutexGuard<'s, Session>,
        deadline: Duration,
        left: &'a mut LeftBehind,
    ) -> Self {
        let began = ecm.exchange.now();
        Self { ecm, session, began, deadline, left, ramped: SlaveSet::EMPTY, unlocked: false, has_moved: false }
    }

    fn until_all_stand(&mut self) -> Result<(), EcmError> {
        self.see_the_present()?;
        if !self.session.in_op() || self.session.network.count == 0 {
            return Ok(());
        }
        self.began = self.ecm.exchange.now();
        self.discard_unwanted()?;
        self.end_homing()?;
        loop {
            self.ramp()?;
            let may_wait = self.left.is_held || self.left.has_threshold && self.session.credit.ahead() > 0;
            if !self.session.posts.is_empty() || may_wait && !self.unlocked {
                // No axis has to be ramped yet, but what waits, here or in the board, must not wait for ever.
                self.write()?;
            }
            if self.stands()? {
                break;
            }
        }
        if self.left.has_threshold && !self.unlocked && self.session.in_op() {
            // Nothing had to be done. The frames of the next program must not wait for a threshold that it does not know.
            self.write()?;
        }
        Ok(())
    }

    /// Reads a report that shows what the axes do now: the newest one may be from before this process stood still. A board that makes
    /// none is braked all the same, by the last one.
    fn see_the_present(&mut self) -> Result<(), EcmError> {
        let exchange = &self.ecm.exchange;
        exchange.catch_up(self.session)?;
        let (began, limit) = (exchange.now(), PRESENT_MAX.max(self.session.network.cycle() * PRESENT_CYCLES));
        while exchange.is_stale(self.session) && exchange.now() < (began + limit).min(self.deadline) {
            exchange.read(self.session, began + limit)?;
        }
        Ok(())
    }

    /// Ends the homing of slaves, by commands in the slots of one frame.
    fn end_homing(&mut self) -> Result<(), EcmError> {
        let abort = SlotCommand::from(SlaveCommand::AbortHome).encode(self.session.size);
        let commands: Vec<_> = self.left.homing.iter().map(|slave| (slave.into(), abort)).collect();
        if commands.is_empty() {
            return Ok(());
        }
        // They go out with the first frame of a ramp, if there is one, so that the targets of other axes have no gap.
        if !self.session.posts.post(&commands) {
            self.write()?;
            self.session.posts.post(&commands);
        }
        if self.ramps(&Observation::begin(self.session)).iter().any(Option::is_some) {
            return Ok(());
        }
        self.write()
    }

    /// Ramps the axes that move and have not been ramped yet. An axis of which only reports tell how it moves is observed first.
    fn ramp(&mut self) -> Result<(), EcmError> {
        let observed = Observation::begin(self.session);
        let network = Arc::clone(&self.session.network);
        let is_unclear = |stop: &Self, slave, config| {
            !stop.ramped.contains(slave) && needs_observation(stop.session, slave, config, stop.left)
        };
        while !observed.is_long_enough(self.session)
            && self.session.in_op()
            && network.slaves().any(|(slave, config)| is_unclear(self, slave, config))
        {
            self.read()?;
        }
        let ramps = self.ramps(&observed);
        if ramps.iter().all(Option::is_none) {
            return Ok(());
        }
        self.run(&ramps)
    }

    /// Writes the frames of ramps.
    fn run(&mut self, ramps: &AxisRamps) -> Result<(), EcmError> {
        let frames = self.frames();
        let network = Arc::clone(&self.session.network);
        for k in 1..=frames {
            if k > 1 && ramps.iter().flatten().any(AxisRamp::is_of_position) {
                self.ecm.exchange.catch_up(self.session)?;
                if self.session.credit.ahead() == 0 {
                    // The board ran dry, and an axis in CSP stands where the ramp was: the rest would set it going again.
                    return Ok(());
                }
            }
            self.write_with(|session| {
                for (slave, config) in network.slaves() {
                    let Some(ramp) = &ramps[usize::from(slave)] else { continue };
                    // An axis that went off meanwhile gets no target.
                    let is_on = movement::may_be_on(session, slave, config);
                    session.targets.set(slave, is_on.then(|| ramp.at(k, frames)));
                }
            })?;
        }
        for (slave, _) in network.slaves().filter(|(slave, _)| ramps[usize::from(*slave)].is_some()) {
            self.ramped.insert(slave);
        }
        Ok(())
    }

    /// The ramps of the axes that have not been ramped yet.
    fn ramps(&self, observed: &Observation) -> AxisRamps {
        self.ramps_by(|slave, config| {
            let is_new = !self.ramped.contains(slave);
            if is_new { ramp_of(self.session, observed, slave, config, self.left) } else { None }
        })
    }

    fn ramps_by(&self, ramp: impl Fn(u8, &Slave) -> Option<AxisRamp>) -> AxisRamps {
        let mut ramps = [None; SlotSize::Bytes12.slots()];
        for (slave, config) in self.session.network.slaves() {
            ramps[usize::from(slave)] = ramp(slave, config);
        }
        ramps
    }

    /// Writes the next frame, as soon as the board has room for it and not too many are ahead.
    fn write(&mut self) -> Result<(), EcmError> {
        self.write_with(|_| ())
    }

    /// As [`write`](Self::write), with targets that `aim` sets last: a report that was read after that would take away those of a
    /// slave of which one axis is off. The first frame has the board take entries out, whatever threshold a program has set
    /// (SK-5.12): that command acts on arrival, even if the FIFO is full.
    fn write_with(&mut self, aim: impl Fn(&mut Session)) -> Result<(), EcmError> {
        while !self.unlocked && self.session.in_op() {
            if self.session.credit.credit() == 0 && !self.left.is_held {
                self.read()?;
                continue;
            }
            let threshold = MasterCommand::SetFifo(FifoAction::Threshold(FIFO_ENTRIES.into())).encode();
            // A command of another thread that waits for that slot goes out first.
            self.unlocked = self.session.posts.post(&[(0, threshold)]);
            let has_room = self.session.credit.credit() > 0;
            // A full FIFO does not take the rest of the frame: that is written again when there is room.
            let posts = self.session.posts.slots();
            aim(self.session);
            self.ecm.exchange.write(self.session, self.deadline)?;
            if self.unlocked && has_room {
                return Ok(());
            }
            if self.unlocked {
                self.session.posts.post_again(posts);
            }
        }
        while self.session.in_op() && self.session.credit.ahead() >= AHEAD_MAX {
            self.read()?;
        }
        aim(self.session);
        self.ecm.exchange.write(self.session, self.deadline)
    }

    /// Waits until the FIFO is empty and all axes stand. False if an axis has to be ramped, which an entry of the FIFO has set
    /// going.
    fn stands(&mut self) -> Result<bool, EcmError> {
        let network = Arc::clone(&self.session.network);
        let mut observation: Option<Observation> = None;
        while self.session.in_op() {
            if self.session.credit.ahead() > 0 {
                (observation, self.has_moved) = (None, true);
                self.read()?;
                continue;
            }
            let observed = observation.get_or_insert_with(|| Observation::begin(self.session));
            // A program knows what its own axes were told: none of them begins to move.
            let may_move = |(slave, config)| movement::may_move(self.session, slave, config);
            self.has_moved |= network.slaves().any(may_move);
            if !self.left.is_foreign && !self.has_moved {
                return Ok(true);
            }
            if observed.is_long_enough(self.session) {
                if self.ramps(observed).iter().any(Option::is_some) {
                    return Ok(false);
                }
                if network.slaves().all(|(slave, config)| !observed.moves(self.session, slave, config)) {
                    return Ok(true);
                }
                let ramps = self.ramps_from_positions(observed);
                observation = None;
                if ramps.iter().any(Option::is_some) {
                    self.run(&ramps)?;
                    continue;
                }
            }
            self.read()?;
        }
        Ok(true)
    }

    /// The ramps of axes that will not have reached their last targets by the limit.
    fn ramps_from_positions(&self, observed: &Observation) -> AxisRamps {
        let cycle = self.session.network.cycle();
        let time_left = self.deadline.saturating_sub(self.ecm.exchange.now());
        // Of its own axes a program knows that they have no target which it has not given.
        let overdue = self.left.is_foreign && time_left < settling_time(cycle) + cycle * (2 * RAMP_FRAMES_MIN);
        let cycles = time_left.as_secs_f64() / cycle.as_secs_f64();
        self.ramps_by(|slave, config| ramp_from_position(self.session, observed, slave, config, cycles, overdue))
    }

    /// Reads a report. The end of the time for the stop, and a board that is silent, are errors.
    fn read(&mut self) -> Result<(), EcmError> {
        if !self.ecm.exchange.read(self.session, self.deadline)? {
            self.ecm.exchange.check_silence(self.session, self.began, "a standstill")?;
        }
        let waited = self.ecm.exchange.now().saturating_sub(self.began);
        if self.ecm.exchange.now() < self.deadline {
            return Ok(());
        }
        Err(EcmError::Timeout {
            what: "a standstill",
            waited,
            seen: ahead_of_the_board(self.session),
            hint: "use the emergency stop if axes move",
        })
    }

    /// The number of frames of a ramp: those of its time, but no more than end before the limit.
    fn frames(&self) -> u32 {
        let cycle = self.session.network.cycle();
        let of = |time: Duration| time.as_nanos().div_ceil(cycle.as_nanos()) as u32;
        let left = self.deadline.saturating_sub(self.ecm.exchange.now()).saturating_sub(settling_time(cycle));
        let possible = (left.as_nanos() / cycle.as_nanos()) as u32;
        let possible = possible.saturating_sub(self.session.credit.ahead().into());
        of(self.ecm.exchange.options.ramp).max(RAMP_FRAMES_MIN).min(possible).max(1)
    }
}
