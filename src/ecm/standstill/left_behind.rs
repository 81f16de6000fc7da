//! What a program has left in the board's FIFO, and what becomes of it before axes are ramped.
//!
//! Entries that are being executed are the way on which the axes are, and stay (see [`super`]). Discarded are entries that wait
//! for a threshold (SK-5.12) while the axes stand, since they would begin a motion that no program commands any more; and,
//! with long cycles, entries that cannot all be executed within the limit. \[OURS]

use std::time::Duration;

use parking_lot::MutexGuard;

use super::axis_ramp::ramp_from_position;
use super::movement::{self, Observation};
use super::{RAMP_FRAMES_MIN, settling_time};
use crate::cia402::Mode;
use crate::ecm::exchange::Session;
use crate::ecm::{Ecm, EcmError};
use crate::ethercat::SlaveSet;
use crate::sk::{AxisTarget, FIFO_ENTRIES, FifoAction, MasterCommand, Motion, RawSlot, SlaveCommand, SlotCommand};

/// \[OURS] Entries wait for a threshold if so many reports in a row show that none was taken out.
const HELD_REPORTS: u32 = 3;
/// \[OURS] How long the last frame of a stop that has failed may take.
const LAST_FRAME_LIMIT: Duration = Duration::from_millis(200);

/// \[OURS] An axis is held at the position that a report shows only if the report is no older than so many cycles.
const POSITION_AGE_CYCLES: u32 = 3;

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

/// Discards entries that must not be executed, or that cannot be within the limit.
pub(super) fn discard_unwanted(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
    left: &mut LeftBehind,
) -> Result<(), EcmError> {
    if left.is_foreign {
        let observed = Observation::begin(session);
        left.is_held = is_held(ecm, session, deadline)?;
        while left.is_held && session.in_op() && !observed.is_long_enough(session) {
            next_report(ecm, session, deadline)?;
        }
        let network = session.network.clone();
        if left.is_held && network.slaves().all(|(slave, config)| !observed.moves(session, slave, config)) {
            return discard_all(ecm, session, deadline, left);
        }
    }
    let cycle = session.network.cycle();
    let needed = cycle * (RAMP_FRAMES_MIN + u32::from(session.credit.ahead())) + settling_time(cycle);
    if session.credit.ahead() > 0 && needed > deadline.saturating_sub(ecm.exchange.now()) {
        return discard_all(ecm, session, deadline, left);
    }
    Ok(())
}

/// Discards the entries that wait for a threshold, of a network of which nothing else is known.
pub fn discard_held(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
    left: &mut LeftBehind,
) -> Result<(), EcmError> {
    if session.in_op() && is_held(ecm, session, deadline)? {
        discard_all(ecm, session, deadline, left)?;
    }
    Ok(())
}

/// Whether there are entries that the board does not take out.
fn is_held(ecm: &Ecm, session: &mut MutexGuard<'_, Session>, deadline: Duration) -> Result<bool, EcmError> {
    let mut free = session.board().fifo_free;
    for _ in 0..HELD_REPORTS {
        if free >= FIFO_ENTRIES {
            return Ok(false);
        }
        next_report(ecm, session, deadline)?;
        if !session.in_op() || session.board().fifo_free > free {
            return Ok(false);
        }
        free = session.board().fifo_free;
    }
    Ok(true)
}

/// Reads until there is another report.
fn next_report(ecm: &Ecm, session: &mut MutexGuard<'_, Session>, deadline: Duration) -> Result<(), EcmError> {
    let began = ecm.exchange.now();
    while !ecm.exchange.read(session, deadline)? {
        ecm.exchange.check_silence(session, began, "a standstill")?;
        if ecm.exchange.now() >= deadline {
            let waited = ecm.exchange.now().saturating_sub(began);
            return Err(EcmError::NoReport { what: "a standstill", waited, bad_crc: session.stats.bad_crc });
        }
    }
    Ok(())
}

/// Discards all entries (SET_FIFO 1). What the board has executed last goes on, and it is not known what that was.
fn discard_all(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
    left: &mut LeftBehind,
) -> Result<(), EcmError> {
    left.discarded += FIFO_ENTRIES.saturating_sub(session.board().fifo_free);
    (left.is_held, left.has_threshold) = (false, false);
    session.targets.clear();
    let clear = [(0, MasterCommand::SetFifo(FifoAction::Clear).encode())];
    // A command of another thread that waits for that slot goes out first.
    if !session.posts.post(&clear) {
        ecm.exchange.write(session, deadline)?;
        session.posts.post(&clear);
    }
    ecm.exchange.write(session, deadline)?;
    // The second report from now on shows the free count after it.
    next_report(ecm, session, deadline)?;
    next_report(ecm, session, deadline)
}

/// The last thing that a stop which has failed can do, in one frame: it discards all entries, so that none is executed later,
/// sets velocities to 0, and torques of axes that move, and holds an axis in CSP where it is that still goes to a far target.
pub fn stop_in_one_step(ecm: &Ecm, session: &mut MutexGuard<'_, Session>, left: &LeftBehind) -> Result<(), EcmError> {
    if !session.in_op() {
        return Ok(());
    }
    let is_fresh = ecm.exchange.now().saturating_sub(session.reports.heard_at)
        <= session.network.cycle() * POSITION_AGE_CYCLES
        && session.stats.reports > 1;
    let observed = if is_fresh { Observation::of_last_cycle(session) } else { Observation::begin(session) };
    let mut commands: Vec<(usize, RawSlot)> = vec![(0, MasterCommand::SetFifo(FifoAction::Clear).encode())];
    for (slave, config) in session.network.slaves() {
        let [first, second] =
            session.targets.outputs()[usize::from(slave)].map(|outputs| AxisTarget { target: 0, outputs });
        let command = match config.axis().map(|axis| axis.mode) {
            // A drive goes on to its last target by itself, however far that is. An old report does not tell where to hold it.
            Some(Mode::Csp) if is_fresh => {
                let ramp = ramp_from_position(session, &observed, slave, config, 0.0, left.is_foreign);
                let Some(hold) = ramp else { continue };
                hold.at(1, 1)
            }
            Some(Mode::Csv) => SlaveCommand::Csv(Motion { first, second }),
            Some(Mode::Cst) if movement::may_move(session, slave, config) => SlaveCommand::Cst(0),
            _ => continue,
        };
        if movement::may_be_on(session, slave, config) {
            commands.push((slave.into(), SlotCommand::from(command).encode(session.size)));
        }
    }
    let deadline = ecm.exchange.now() + LAST_FRAME_LIMIT;
    if !session.posts.post(&commands) {
        ecm.exchange.write(session, deadline)?;
        session.posts.post(&commands);
    }
    ecm.exchange.write(session, deadline)
}
