//! Bringing axes to a standstill from the host. The axes stay enabled. How one axis is braked says [`super::brake`]; what
//! waits in the board's FIFO meanwhile, [`super::leftover`].
//!
//! Entries that are ahead of the ramp are executed first: they are the way that the axes were sent, and the ramp goes on from
//! its end. What was commanded last is known of a program's own axes; of others it may not be, and then the ramp waits until
//! the FIFO is empty and goes by what reports show.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::MutexGuard;

use super::brake::{Brake, brake, brake_chase, is_strange};
use super::leftover::{self, Left};
use super::session::Session;
use super::still::{self, Since};
use super::targets::bits;
use super::{Ecm, EcmError};
use crate::sk::{FIFO_ENTRIES, FifoAction, MasterCommand, SlaveCommand, SlotCommand, SlotSize};

/// \[OURS] Frames of the ramp that are ahead of the board at most.
const DEPTH: u16 = 64;
/// \[OURS] What of the limit is left for standing still after the ramp.
const SETTLE: Duration = Duration::from_millis(200);
/// \[OURS] The same in cycles, where they are long.
const SETTLE_CYCLES: u32 = 3;

/// \[OURS] A ramp has at least that many frames, where the cycle is long.
pub(super) const MIN_FRAMES: u32 = 4;

/// What is left of a limit for standing still after the ramp.
pub(super) fn settle(cycle: Duration) -> Duration {
    SETTLE.max(cycle * SETTLE_CYCLES)
}

/// Ramps what moves to a standstill, by `deadline`. Where that fails nothing is left in the FIFO that moves an axis later.
pub(super) fn to_standstill(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
    left: &mut Left,
) -> Result<(), EcmError> {
    let stood = stop(ecm, session, deadline, left);
    if matches!(&stood, Err(error) if !matches!(error, EcmError::Link(_))) {
        // Why axes do not stand says the error of the stop.
        let _ = leftover::cut_short(ecm, session, left);
    }
    stood
}

fn stop(ecm: &Ecm, session: &mut MutexGuard<'_, Session>, deadline: Duration, left: &mut Left) -> Result<(), EcmError> {
    ecm.core.catch_up(session)?;
    if !session.in_op() || session.plan.count == 0 {
        return Ok(());
    }
    let mut stop = Stop { ecm, began: ecm.core.now(), deadline, braked: 0, unlocked: false };
    leftover::sort_out(ecm, session, deadline, left)?;
    stop.end_homing(session, left)?;
    loop {
        stop.ramp(session, left)?;
        let may_wait = left.is_held || left.has_threshold && session.credit.ahead() > 0;
        if session.has_posts() || may_wait && !stop.unlocked {
            // No axis has to be ramped yet, and what waits, here or in the board, shall not wait for ever.
            stop.write(session, left)?;
        }
        if stop.stands(session, left)? {
            break;
        }
    }
    if left.has_threshold && !stop.unlocked && session.in_op() {
        // Nothing had to be done; what the next program writes shall not wait for a number that it does not know.
        stop.write(session, left)?;
    }
    Ok(())
}

/// How the axes of each slave are braked that are.
type Brakes = [Option<Brake>; SlotSize::Bytes12.slots()];

/// A stop under way.
struct Stop<'a> {
    ecm: &'a Ecm,
    began: Duration,
    deadline: Duration,
    /// Slaves whose axes have been ramped, a bit each.
    braked: u64,
    /// The board takes entries out, whatever threshold was in force.
    unlocked: bool,
}

impl Stop<'_> {
    /// Ends the homing of slaves: in their slots of one frame.
    fn end_homing(&mut self, session: &mut MutexGuard<'_, Session>, left: &Left) -> Result<(), EcmError> {
        let abort = SlotCommand::from(SlaveCommand::AbortHome).encode(session.size);
        let commands: Vec<_> = bits(left.homing).map(|slave| (slave, abort)).collect();
        if commands.is_empty() {
            return Ok(());
        }
        // They ride in the first frame of a ramp, if there is one: other axes have no gap then.
        if !session.post(&commands) {
            self.write(session, left)?;
            session.post(&commands);
        }
        if self.brakes(session, &Since::now(session), left).iter().any(Option::is_some) {
            return Ok(());
        }
        self.write(session, left)
    }

    /// Ramps what has not been ramped yet. An axis of which only reports tell how it moves has to wait for an empty FIFO.
    fn ramp(&mut self, session: &mut MutexGuard<'_, Session>, left: &Left) -> Result<(), EcmError> {
        let since = Since::now(session);
        let plan = Arc::clone(&session.plan);
        let waits =
            |session: &Session, slave, config| !self.is_braked(slave) && is_strange(session, slave, config, left);
        while !since.is_over(session)
            && session.in_op()
            && plan.slaves().any(|(slave, config)| waits(session, slave, config))
        {
            self.read(session)?;
        }
        let brakes = self.brakes(session, &since, left);
        if brakes.iter().all(Option::is_none) {
            return Ok(());
        }
        self.run(session, left, &brakes)
    }

    /// Has the board execute a ramp.
    fn run(&mut self, session: &mut MutexGuard<'_, Session>, left: &Left, brakes: &Brakes) -> Result<(), EcmError> {
        let frames = self.frames(session);
        let plan = Arc::clone(&session.plan);
        for k in 1..=frames {
            self.write_with(session, left, |session| {
                for (slave, config) in plan.slaves() {
                    let Some(brake) = &brakes[usize::from(slave)] else { continue };
                    // An axis that went off meanwhile gets none.
                    let is_on = still::may_be_on(session, slave, config);
                    session.targets.set(slave.into(), is_on.then(|| brake.at(k, frames)));
                }
            })?;
        }
        for (slave, brake) in brakes.iter().enumerate() {
            self.braked |= u64::from(brake.is_some()) << slave;
        }
        Ok(())
    }

    const fn is_braked(&self, slave: u8) -> bool {
        self.braked & 1 << slave != 0
    }

    fn brakes(&self, session: &Session, since: &Since, left: &Left) -> Brakes {
        let mut brakes = [None; SlotSize::Bytes12.slots()];
        for (slave, config) in session.plan.slaves() {
            if !self.is_braked(slave) {
                brakes[usize::from(slave)] = brake(session, since, slave, config, left);
            }
        }
        brakes
    }

    /// Writes the next frame, as soon as it may be ahead of the board.
    fn write(&mut self, session: &mut MutexGuard<'_, Session>, left: &Left) -> Result<(), EcmError> {
        self.write_with(session, left, |_| ())
    }

    /// As [`write`](Self::write), with targets that are put into the frame last: a report that comes before would take away
    /// those of a slave of which one axis is off. The first frame has the board take entries out, whatever threshold somebody
    /// has set (SK-5.12): it acts on arrival, when the FIFO is full too.
    fn write_with(
        &mut self,
        session: &mut MutexGuard<'_, Session>,
        left: &Left,
        aim: impl Fn(&mut Session),
    ) -> Result<(), EcmError> {
        while !self.unlocked && session.in_op() {
            if session.credit.credit() == 0 && !left.is_held {
                self.read(session)?;
                continue;
            }
            let threshold = MasterCommand::SetFifo(FifoAction::Threshold(FIFO_ENTRIES.into())).encode();
            // Whatever another thread has in that slot goes first.
            self.unlocked = session.post(&[(0, threshold)]);
            if self.unlocked && session.credit.credit() > 0 {
                aim(session);
                return self.ecm.core.write(session, self.deadline);
            }
            // A full FIFO does not take what else is in the frame: it is written again, once there is room.
            let posts = session.posts();
            aim(session);
            self.ecm.core.write(session, self.deadline)?;
            if self.unlocked {
                session.post_again(posts);
            }
        }
        while session.in_op() && session.credit.ahead() >= DEPTH {
            self.read(session)?;
        }
        aim(session);
        self.ecm.core.write(session, self.deadline)
    }

    /// Waits until the FIFO is empty, and looks whether all axes stand. False: there is one to be ramped, which was set going
    /// by what was in the FIFO.
    fn stands(&mut self, session: &mut MutexGuard<'_, Session>, left: &Left) -> Result<bool, EcmError> {
        let plan = Arc::clone(&session.plan);
        let mut since: Option<Since> = None;
        while session.in_op() {
            if session.credit.ahead() > 0 {
                since = None;
                self.read(session)?;
                continue;
            }
            let began = since.get_or_insert_with(|| Since::now(session));
            // Of its own axes a program knows what they were told: none begins to move.
            if !left.is_foreign && plan.slaves().all(|(slave, config)| !still::may_move(session, slave, config)) {
                return Ok(true);
            }
            if began.is_over(session) {
                if self.brakes(session, began, left).iter().any(Option::is_some) {
                    return Ok(false);
                }
                if plan.slaves().all(|(slave, config)| !began.moves(session, slave, config)) {
                    return Ok(true);
                }
                let chases = self.chases(session, began, left);
                since = None;
                if chases.iter().any(Option::is_some) {
                    self.run(session, left, &chases)?;
                    continue;
                }
            }
            self.read(session)?;
        }
        Ok(true)
    }

    /// Axes that will not have reached their last target by the limit.
    fn chases(&self, session: &Session, since: &Since, of: &Left) -> Brakes {
        let cycle = session.plan.cycle();
        let left = self.deadline.saturating_sub(self.ecm.core.now());
        // What a program has never told its axis to do, it knows.
        let overdue = of.is_foreign && left < settle(cycle) + cycle * (2 * MIN_FRAMES);
        let mut chases = [None; SlotSize::Bytes12.slots()];
        for (slave, config) in session.plan.slaves() {
            let cycles = left.as_secs_f64() / cycle.as_secs_f64();
            chases[usize::from(slave)] = brake_chase(session, since, slave, config, cycles, overdue);
        }
        chases
    }

    fn read(&self, session: &mut MutexGuard<'_, Session>) -> Result<(), EcmError> {
        if !self.ecm.core.read(session, self.deadline)? {
            self.ecm.core.check_silence(session, self.began, "a standstill")?;
        }
        let waited = self.ecm.core.now().saturating_sub(self.began);
        if self.ecm.core.now() < self.deadline {
            return Ok(());
        }
        Err(EcmError::Timeout {
            what: "a standstill",
            waited,
            seen: format!("{} entries are ahead of the board", session.credit.ahead()),
            hint: "use the emergency stop if axes move",
        })
    }

    /// Frames of the ramp: those of its time, as many as end before the limit.
    fn frames(&self, session: &Session) -> u32 {
        let cycle = session.plan.cycle();
        let of = |time: Duration| time.as_nanos().div_ceil(cycle.as_nanos()) as u32;
        let left = self.deadline.saturating_sub(self.ecm.core.now()).saturating_sub(settle(cycle));
        let possible = (left.as_nanos() / cycle.as_nanos()) as u32;
        let possible = possible.saturating_sub(session.credit.ahead().into());
        of(self.ecm.core.options.ramp).max(MIN_FRAMES).min(possible).max(1)
    }
}
