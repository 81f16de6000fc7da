//! Bringing axes to a standstill from the host. The axes stay enabled.
//!
//! The board first executes the entries in its FIFO, which are the path that the program commanded. In CSP the axes
//! then hold the end of the path. In CSV and CST the velocity or torque is ramped to 0 from there. If this program
//! moved the axes, their last commands are known. If another program did, they may be unknown: then the ramp begins
//! when the FIFO is empty, at the speed that reports show.
//!
//! How to read this folder: `mod.rs` has the whole stop. `movement.rs` judges whether an axis moves, `axis_ramp.rs` has
//! the ramp of one axis, `left_behind.rs` the treatment of entries that wait in the FIFO, `held_back.rs` that of axes
//! that do not follow, and `close.rs` the other steps of closing a board.

mod axis_ramp;
mod close;
mod held_back;
mod left_behind;
mod movement;

use std::sync::Arc;
use std::time::Duration;

use parking_lot::MutexGuard;

use axis_ramp::{AxisRamp, needs_observation, ramp_from_position, ramp_of};
pub use held_back::HeldBack;
use held_back::{Hold, hold_of};
use movement::Observation;

use super::config::Slave;
use super::exchange::{Session, ahead_of_the_board};
use super::{Ecm, EcmError};
use crate::ethercat::SlaveSet;
use crate::link::LinkError;
use crate::sk::{FIFO_ENTRIES, FifoAction, MasterCommand, SlaveCommand, SlotCommand, SlotSize};

/// \[OURS] The maximum number of frames that wait in the board's FIFO during a stop. The next frame is written when
/// fewer wait.
const AHEAD_MAX: u16 = 64;
/// \[OURS] The time reserved for axes to come to rest after the ramp.
const SETTLING_TIME: Duration = Duration::from_millis(200);
/// \[OURS] The fewest cycles that are reserved for axes to come to rest; with long cycles they take longer than
/// `SETTLING_TIME`.
const SETTLING_CYCLES: u32 = 3;

/// \[OURS] How long a stop waits for a report that shows the present state: this time or `PRESENT_CYCLES`, whichever
/// is longer.
const PRESENT_MAX: Duration = Duration::from_millis(20);
const PRESENT_CYCLES: u32 = 3;

/// \[OURS] The fewest frames of a ramp; with long cycles these take longer than the set ramp time.
pub const RAMP_FRAMES_MIN: u32 = 4;

/// What a stop knows about the program that has moved the axes, and about the entries that it has left in the FIFO.
#[derive(Clone, Copy, Debug, Default)]
pub struct LeftBehind {
    /// Whether another program has moved the axes, whose last commands may be unknown.
    pub is_foreign: bool,
    /// Whether the digital outputs of HSPs are not known. Then a frame with a target for an HSP would switch its
    /// outputs off, so a stationary HSP gets no target.
    pub outputs_unknown: bool,
    /// Slaves to which the program may have sent GO_HOME.
    pub homing: SlaveSet,
    /// Whether the program has set a FIFO threshold (SET_FIFO 2): until the FIFO has that many entries, the board
    /// executes none.
    pub has_threshold: bool,
    /// Whether reports have shown that entries wait for such a threshold: the FIFO has entries, and the board takes none
    /// out.
    pub is_held: bool,
    /// The number of FIFO entries that the stop has discarded.
    pub discarded: u16,
}

/// The part of the time limit that is reserved for axes to come to rest after the ramp.
pub fn settling_time(cycle: Duration) -> Duration {
    SETTLING_TIME.max(cycle * SETTLING_CYCLES)
}

/// Ramps moving axes to a standstill by `deadline`. If that fails, it empties the FIFO, so that no entry can move an
/// axis later.
pub fn to_standstill(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
    left: &mut LeftBehind,
) -> Result<(), EcmError> {
    let mut stop = Stop::new(ecm, session, deadline, left);
    let stood = stop.until_all_stand();
    if matches!(&stood, Err(error) if !error.is_of_link()) {
        // The stop has failed. Its error is returned, since it says why axes are not stationary. One more frame is sent as a
        // last resort; an error of that frame would say less, so it is dropped.
        let _ = stop.in_one_step();
    }
    stood
}

/// Discards entries that wait for a threshold, on a network whose configuration is not known.
pub fn discard_held(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
    left: &mut LeftBehind,
) -> Result<(), EcmError> {
    let mut stop = Stop::new(ecm, session, deadline, left);
    // If discarding fails, one more frame is sent as a last resort. An error of that frame is dropped, since the error of the
    // discarding says more.
    stop.discard_held().inspect_err(|_| drop(stop.in_one_step()))
}

/// The ramps of the axes, by slot; `None` for a slave that needs none.
type AxisRamps = [Option<AxisRamp>; SlotSize::Bytes12.slots()];

/// The state of a running stop.
struct Stop<'a, 's> {
    ecm: &'a Ecm,
    session: &'a mut MutexGuard<'s, Session>,
    began: Duration,
    deadline: Duration,
    left: &'a mut LeftBehind,
    /// Slaves for whose axes this stop has written a ramp.
    ramped: SlaveSet,
    /// Slaves with an axis that this stop holds at its actual position.
    held_back: SlaveSet,
    /// Whether the newest frame was sent without its targets in CSP, since one of them was beyond a limit of the machine file.
    is_cut: bool,
    /// Whether the drive of an axis pushes, and the newest frame that was to hold the axis was sent without CSP targets
    /// (`is_cut`).
    cannot_hold: bool,
    /// Whether this stop has reset the FIFO threshold, so that the board executes its entries however few they are.
    unlocked: bool,
    /// Whether an axis may have moved since the stop began. An axis that is about to reverse is stationary for a cycle,
    /// so after a motion one report without motion does not prove a standstill.
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
        Self {
            ecm,
            session,
            began,
            deadline,
            left,
            ramped: SlaveSet::EMPTY,
            held_back: SlaveSet::EMPTY,
            is_cut: false,
            cannot_hold: false,
            unlocked: false,
            has_moved: false,
        }
    }

    fn until_all_stand(&mut self) -> Result<(), EcmError> {
        self.see_the_present()?;
        if !self.session.in_op() || self.session.network.count == 0 {
            return Ok(());
        }
        self.discard_unwanted()?;
        self.end_homing()?;
        loop {
            self.ramp()?;
            let may_wait = self.left.is_held || self.left.has_threshold && self.session.credit.ahead() > 0;
            if !self.session.posts.is_empty() || may_wait && !self.unlocked {
                // `ramp` has written no frame, since no axis has to be ramped. A frame is needed all the same, to send
                // queued commands or to reset the threshold that holds entries back.
                self.write()?;
            }
            if self.stands()? && self.hold_back()? {
                break;
            }
        }
        if self.left.has_threshold && !self.unlocked && self.session.in_op() {
            // No frame was needed to stop the axes. One is written to reset the threshold, because the next program
            // does not know of it.
            self.write()?;
        }
        Ok(())
    }

    /// Reads reports until one shows the present state: after a stall of this process the newest report may be old. If
    /// the board makes no report, the stop goes on with the old one.
    fn see_the_present(&mut self) -> Result<(), EcmError> {
        let exchange = &self.ecm.exchange;
        exchange.catch_up(self.session)?;
        let (began, limit) = (exchange.now(), PRESENT_MAX.max(self.session.network.cycle() * PRESENT_CYCLES));
        while exchange.is_stale(self.session) && exchange.now() < (began + limit).min(self.deadline) {
            exchange.read(self.session, began + limit)?;
        }
        Ok(())
    }

    /// Aborts the homing of the slaves in `left.homing`, by ABORT_HOME in their slots of one frame.
    fn end_homing(&mut self) -> Result<(), EcmError> {
        let abort = SlotCommand::from(SlaveCommand::AbortHome).encode(self.session.size);
        let commands: Vec<_> = self.left.homing.iter().map(|slave| (slave.into(), abort)).collect();
        if commands.is_empty() {
            return Ok(());
        }
        // If a ramp follows, ABORT_HOME is sent with the first frame of the ramp. A frame with ABORT_HOME alone would have no
        // targets for the other axes.
        if !self.session.posts.post(&commands) {
            self.write()?;
            self.session.posts.post(&commands);
        }
        if self.ramps(&Observation::begin(self.session)).iter().any(Option::is_some) {
            return Ok(());
        }
        self.write()
    }

    /// Ramps moving axes that were not ramped yet. If the last command of an axis does not show how it moves, the axis
    /// is observed first.
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

    /// Writes the frames of the ramps, one for each cycle.
    fn run(&mut self, ramps: &AxisRamps) -> Result<(), EcmError> {
        let frames = self.frames();
        let network = Arc::clone(&self.session.network);
        for k in 1..=frames {
            if k > 1 && ramps.iter().flatten().any(AxisRamp::is_of_position) {
                self.ecm.exchange.catch_up(self.session)?;
                if self.session.credit.ahead() == 0 {
                    // The FIFO ran empty, so an axis in CSP has stopped in the middle of its ramp. Further frames would
                    // start it again.
                    return Ok(());
                }
            }
            self.write_with(|session| {
                for (slave, config) in network.slaves() {
                    let Some(ramp) = &ramps[usize::from(slave)] else { continue };
                    // An axis that was switched off meanwhile gets no target.
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

    /// The ramps of axes that need one and were not ramped yet.
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

    /// Writes the next frame once the board has room for it and fewer than [`AHEAD_MAX`] frames are waiting.
    fn write(&mut self) -> Result<(), EcmError> {
        self.write_with(|_| ())
    }

    /// As [`write`](Self::write). `aim` sets the targets just before the frame is written, because reading a report
    /// removes the targets of a slave with one axis off. The first frame also resets the threshold that a program may
    /// have set (SK-5.12), so that the board takes entries out. The board executes that command on arrival, even if the
    /// FIFO is full.
    fn write_with(&mut self, aim: impl Fn(&mut Session)) -> Result<(), EcmError> {
        while !self.unlocked && self.session.in_op() {
            if self.session.credit.credit() == 0 && !self.left.is_held {
                self.read()?;
                continue;
            }
            let threshold = MasterCommand::SetFifo(FifoAction::Threshold(FIFO_ENTRIES.into())).encode();
            // False if another thread's command is queued for slot 0. The loop then tries again with the next frame.
            self.unlocked = self.session.posts.post(&[(0, threshold)]);
            let has_room = self.session.credit.credit() > 0;
            // If the FIFO is full, the board executes only the threshold command in slot 0 and drops the rest of the
            // frame. So the queued commands in it are written again.
            let posts = self.session.posts.slots();
            aim(self.session);
            self.write_frame()?;
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
        self.write_frame()
    }

    /// Writes the next frame. If a ramp leads beyond a limit of the machine file, the board has got the frame without
    /// its CSP targets. So the axes in CSP hold their last targets, and the stop goes on.
    fn write_frame(&mut self) -> Result<(), EcmError> {
        let done = self.ecm.exchange.write(self.session, self.deadline);
        self.is_cut = matches!(&done, Err(EcmError::Link(LinkError::BeyondLimit { .. })));
        if self.is_cut { Ok(()) } else { done }
    }

    /// Waits until the FIFO is empty and all axes are stationary. Returns false if an executed entry has started an
    /// axis that now has to be ramped.
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
            // The FIFO is empty, so all commands of this program were executed: unless another program has moved the
            // axes, an axis that is stationary now will not start to move.
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

    /// Holds axes in CSP that are stationary far from their last targets at their actual positions. Returns true if
    /// there are no such axes: the stop has ended. Returns false after a hold, or if an axis has begun to move
    /// meanwhile: the stop goes on until the axes are stationary again.
    fn hold_back(&mut self) -> Result<bool, EcmError> {
        let observed = Observation::begin(self.session);
        if self.holds(&observed).is_empty() {
            return Ok(true);
        }
        // A drive may have got its target only now, so it has some time to start. If the deadline leaves no such time,
        // the axis is held at once.
        let cycle = self.session.network.cycle();
        let time = cycle.mul_f64(movement::lag_cycles(self.session).ceil() + 1.0);
        let until = self.ecm.exchange.now() + time;
        while until < self.deadline && self.ecm.exchange.now() < until && self.session.in_op() {
            self.read()?;
        }
        // This process may have stalled meanwhile, and an axis may have come free.
        self.see_the_present()?;
        if !self.session.in_op() {
            return Ok(true);
        }
        // An axis that has come free, or started late, goes to its last target by itself, and comes to rest only there.
        let network = Arc::clone(&self.session.network);
        self.has_moved |= network.slaves().any(|(slave, config)| observed.moves(self.session, slave, config));
        let holds = self.holds(&observed);
        if holds.is_empty() {
            self.cannot_hold = false;
            // At least one report is read, so that the loop of the caller ends at the deadline.
            self.read()?;
            return Ok(false);
        }
        self.write_with(|session| {
            for (slave, hold) in &holds {
                session.targets.set(*slave, Some(hold.command));
            }
        })?;
        // The link that checks the limits may have a newer report, in which an axis beyond its limit is some counts
        // nearer to that limit. The hold then leads further out, and is refused. The caller tries again with new
        // positions.
        self.cannot_hold = self.is_cut;
        if self.cannot_hold {
            self.read()?;
            return Ok(false);
        }
        for (slave, hold) in holds {
            self.held_back.insert(slave);
            // This is the last target of the axis, whatever it does now: it may come free or spring back while the
            // frame is in flight.
            self.session.targets.assume(slave, Some(hold.command));
            hold.note(self.session);
        }
        Ok(false)
    }

    fn holds(&self, observed: &Observation) -> Vec<(u8, Hold)> {
        let slaves = self.session.network.slaves().filter(|(slave, _)| !self.held_back.contains(*slave));
        let hold = |(slave, config)| Some((slave, hold_of(self.session, observed, slave, config, self.left)?));
        slaves.filter_map(hold).collect()
    }

    /// The ramps of axes in CSP that will not reach their last targets before the deadline of this stop.
    fn ramps_from_positions(&self, observed: &Observation) -> AxisRamps {
        let cycle = self.session.network.cycle();
        let time_left = self.deadline.saturating_sub(self.ecm.exchange.now());
        // Only an axis that another program has moved can have an unknown last target. It is ramped when the time left is
        // just enough for a short ramp.
        let overdue = self.left.is_foreign && time_left < settling_time(cycle) + cycle * (2 * RAMP_FRAMES_MIN);
        let cycles = time_left.as_secs_f64() / cycle.as_secs_f64();
        let limits = (cycles, overdue);
        self.ramps_by(|slave, config| ramp_from_position(self.session, observed, slave, config, self.left, limits))
    }

    /// Reads a report. Returns an error at the end of the time limit, and for a silent board.
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
            hint: if self.cannot_hold {
                "an axis pushes, and a limit of the machine file keeps it from being held where it is; use the emergency stop"
            } else {
                "use the emergency stop if axes move"
            },
        })
    }

    /// The number of frames in a ramp: as many as the set ramp time has cycles, limited by the time left.
    fn frames(&self) -> u32 {
        let cycle = self.session.network.cycle();
        let of = |time: Duration| time.as_nanos().div_ceil(cycle.as_nanos()) as u32;
        let left = self.deadline.saturating_sub(self.ecm.exchange.now()).saturating_sub(settling_time(cycle));
        let possible = (left.as_nanos() / cycle.as_nanos()) as u32;
        let possible = possible.saturating_sub(self.session.credit.ahead().into());
        of(self.ecm.exchange.options.ramp).max(RAMP_FRAMES_MIN).min(possible).max(1)
    }
}
