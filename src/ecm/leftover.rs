//! What a program that is gone has left in the board's FIFO, and what becomes of it before its axes are ramped.
//!
//! Entries that run are the way on which the axes are, and stay (see [`super::ramp`]). Dropped are those that wait behind a
//! threshold (SK-5.12) while the axes stand, for they would begin a motion that nobody commands any more, and more than can
//! be executed within the limit, with long cycles. \[OURS]

use std::time::Duration;

use parking_lot::MutexGuard;

use super::brake::brake_chase;
use super::ramp::{MIN_FRAMES, settle};
use super::session::Session;
use super::still::{self, Since};
use super::{Ecm, EcmError};
use crate::cia402::Mode;
use crate::sk::{AxisTarget, FIFO_ENTRIES, FifoAction, MasterCommand, Motion, RawSlot, SlaveCommand, SlotCommand};

/// \[OURS] Entries wait behind a threshold if so many reports in a row show none that was taken out.
const HELD_REPORTS: u32 = 3;
/// \[OURS] How long the last frame may take that a stop sends which has failed.
const LAST_FRAME: Duration = Duration::from_millis(200);

/// \[OURS] A report is no older than that if an axis is to be held where it shows it.
const FRESH_CYCLES: u32 = 3;

/// What is known of a program whose axes are stopped by another one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Left {
    /// It is another program's, which is gone: what it was about to do is not known.
    pub(super) is_foreign: bool,
    /// Slaves that it may have sent home, a bit each.
    pub(super) homing: u64,
    /// It has set a threshold that may be in force.
    pub(super) has_threshold: bool,
    /// The board takes nothing out of its FIFO, though there is something.
    pub(super) is_held: bool,
    /// Entries that were dropped.
    pub(super) dropped: u16,
}

/// Drops what must not or cannot be executed.
pub(super) fn sort_out(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
    left: &mut Left,
) -> Result<(), EcmError> {
    if left.is_foreign {
        let since = Since::now(session);
        left.is_held = is_held(ecm, session, deadline)?;
        while left.is_held && session.in_op() && !since.is_over(session) {
            next_report(ecm, session, deadline)?;
        }
        let plan = session.plan.clone();
        if left.is_held && plan.slaves().all(|(slave, config)| !since.moves(session, slave, config)) {
            return drop_entries(ecm, session, deadline, left);
        }
    }
    let cycle = session.plan.cycle();
    let needed = cycle * (MIN_FRAMES + u32::from(session.credit.ahead())) + settle(cycle);
    if session.credit.ahead() > 0 && needed > deadline.saturating_sub(ecm.core.now()) {
        return drop_entries(ecm, session, deadline, left);
    }
    Ok(())
}

/// Drops what waits in the FIFO of a network of which nothing else is known.
pub(super) fn drop_held(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
    left: &mut Left,
) -> Result<(), EcmError> {
    if session.in_op() && is_held(ecm, session, deadline)? {
        drop_entries(ecm, session, deadline, left)?;
    }
    Ok(())
}

/// Whether entries wait that the board does not take out.
fn is_held(ecm: &Ecm, session: &mut MutexGuard<'_, Session>, deadline: Duration) -> Result<bool, EcmError> {
    let mut free = session.board.fifo_free;
    for _ in 0..HELD_REPORTS {
        if free >= FIFO_ENTRIES {
            return Ok(false);
        }
        next_report(ecm, session, deadline)?;
        if !session.in_op() || session.board.fifo_free > free {
            return Ok(false);
        }
        free = session.board.fifo_free;
    }
    Ok(true)
}

fn next_report(ecm: &Ecm, session: &mut MutexGuard<'_, Session>, deadline: Duration) -> Result<(), EcmError> {
    let began = ecm.core.now();
    while !ecm.core.read(session, deadline)? {
        ecm.core.check_silence(session, began, "a standstill")?;
        if ecm.core.now() >= deadline {
            let waited = ecm.core.now().saturating_sub(began);
            return Err(EcmError::NoReport { what: "a standstill", waited, bad_crc: session.stats.bad_crc });
        }
    }
    Ok(())
}

/// SET_FIFO 1. Whatever the board has executed last goes on, and what that was is not known.
fn drop_entries(
    ecm: &Ecm,
    session: &mut MutexGuard<'_, Session>,
    deadline: Duration,
    left: &mut Left,
) -> Result<(), EcmError> {
    left.dropped += FIFO_ENTRIES.saturating_sub(session.board.fifo_free);
    (left.is_held, left.has_threshold) = (false, false);
    session.targets.clear();
    let clear = [(0, MasterCommand::SetFifo(FifoAction::Clear).encode())];
    // Whatever another thread has in that slot goes first.
    if !session.post(&clear) {
        ecm.core.write(session, deadline)?;
        session.post(&clear);
    }
    ecm.core.write(session, deadline)?;
    // The free count of now.
    next_report(ecm, session, deadline)?;
    next_report(ecm, session, deadline)
}

/// The last thing that a stop can do which has failed: nothing of what is in the FIFO is executed later, and velocities, and
/// torques of axes that move, are 0 in one step; an axis that still goes after a target in CSP is held where it is.
pub(super) fn cut_short(ecm: &Ecm, session: &mut MutexGuard<'_, Session>, left: &Left) -> Result<(), EcmError> {
    if !session.in_op() {
        return Ok(());
    }
    let is_fresh = ecm.core.now().saturating_sub(session.heard) <= session.plan.cycle() * FRESH_CYCLES
        && session.stats.reports > 1;
    let since = if is_fresh { Since::previous(session) } else { Since::now(session) };
    let mut commands: Vec<(usize, RawSlot)> = vec![(0, MasterCommand::SetFifo(FifoAction::Clear).encode())];
    for (slave, config) in session.plan.slaves() {
        let [first, second] =
            session.targets.outputs()[usize::from(slave)].map(|outputs| AxisTarget { target: 0, outputs });
        let command = match config.axis().map(|axis| axis.mode) {
            // A drive goes on to its last target by itself, however far it is. What an old report shows is no place to hold.
            Some(Mode::Csp) if is_fresh => {
                let Some(hold) = brake_chase(session, &since, slave, config, 0.0, left.is_foreign) else { continue };
                hold.at(1, 1)
            }
            Some(Mode::Csv) => SlaveCommand::Csv(Motion { first, second }),
            Some(Mode::Cst) if still::may_move(session, slave, config) => SlaveCommand::Cst(0),
            _ => continue,
        };
        if still::may_be_on(session, slave, config) {
            commands.push((slave.into(), SlotCommand::from(command).encode(session.size)));
        }
    }
    let deadline = ecm.core.now() + LAST_FRAME;
    if !session.post(&commands) {
        ecm.core.write(session, deadline)?;
        session.post(&commands);
    }
    ecm.core.write(session, deadline)
}
