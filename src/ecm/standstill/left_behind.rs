//! Entries that a program has left in the board's FIFO: which ones are discarded before axes are ramped.
//!
//! In general the board executes the entries, since they are the path of the axes (see [`super`]). They are discarded
//! in two cases. While they wait for a threshold (SK-5.12) the axes are stationary, and the entries would begin a
//! motion that no program commands any more. With long cycles the entries may be too many to be executed within the
//! time limit. \[OURS]

use std::time::Duration;

use super::axis_ramp::{keeps_outputs, ramp_from_position};
use super::held_back::hold_of;
use super::movement::{self, Observation};
use super::{RAMP_FRAMES_MIN, Stop, settling_time};
use crate::ecm::EcmError;
use crate::ethercat::cia402::Mode;
use crate::sk::{AxisTarget, FIFO_ENTRIES, FifoAction, MasterCommand, Motion, RawSlot, SlaveCommand, SlotCommand};

/// \[OURS] If this many consecutive reports show that the board took no entry out of its FIFO, the entries wait until the
/// FIFO reaches its threshold (SET_FIFO 2).
const HELD_REPORTS: u32 = 3;
/// \[OURS] The time limit for writing the frame that [`in_one_step`](Stop::in_one_step) sends after a failed stop.
const LAST_FRAME_LIMIT: Duration = Duration::from_millis(200);

impl Stop<'_, '_> {
    /// Discards the entries in the FIFO if they wait for a threshold (SET_FIFO 2), or if they are too many to be executed
    /// within the time limit.
    pub(super) fn discard_unwanted(&mut self) -> Result<(), EcmError> {
        if self.left.is_foreign {
            let observed = Observation::begin(self.session);
            self.left.is_held = self.is_held()?;
            while self.left.is_held && self.session.in_op() && !observed.is_long_enough(self.session) {
                self.next_report()?;
            }
            let moves = |(slave, config)| observed.moves(self.session, slave, config);
            if self.left.is_held && !self.session.network.slaves().any(moves) {
                return self.discard_all();
            }
        }
        let (cycle, ahead) = (self.session.network.cycle(), self.session.credit.ahead());
        let needed = cycle * (RAMP_FRAMES_MIN + u32::from(ahead)) + settling_time(cycle);
        if ahead > 0 && needed > self.deadline.saturating_sub(self.ecm.exchange.now()) {
            return self.discard_all();
        }
        Ok(())
    }

    /// Discards the entries in the FIFO if they wait for a threshold (SET_FIFO 2).
    pub(super) fn discard_held(&mut self) -> Result<(), EcmError> {
        if self.session.in_op() && self.is_held()? { self.discard_all() } else { Ok(()) }
    }

    /// Whether the FIFO has entries but the board takes none out, because they wait for a threshold (SET_FIFO 2).
    fn is_held(&mut self) -> Result<bool, EcmError> {
        let mut free = self.session.board().fifo_free;
        for _ in 0..HELD_REPORTS {
            if free >= FIFO_ENTRIES {
                return Ok(false);
            }
            self.next_report()?;
            if !self.session.in_op() || self.session.board().fifo_free > free {
                return Ok(false);
            }
            free = self.session.board().fifo_free;
        }
        Ok(true)
    }

    /// Waits for the next report. Fails at the deadline, or if the board is silent: no time before the beginning of the
    /// stop counts as silence.
    fn next_report(&mut self) -> Result<(), EcmError> {
        let (exchange, began) = (&self.ecm.exchange, self.began);
        while !exchange.read(self.session, self.deadline)? {
            exchange.check_silence(self.session, began, "a standstill")?;
            if exchange.now() >= self.deadline {
                let waited = exchange.now().saturating_sub(began);
                let bad_crc = self.session.stats.bad_crc;
                return Err(exchange.no_report("a standstill", waited, bad_crc));
            }
        }
        Ok(())
    }

    /// Discards all entries (SET_FIFO 1). Each axis keeps the command that was executed last. It is not known which
    /// command that is, so the recorded targets are removed.
    fn discard_all(&mut self) -> Result<(), EcmError> {
        self.left.discarded += FIFO_ENTRIES.saturating_sub(self.session.board().fifo_free);
        (self.left.is_held, self.left.has_threshold) = (false, false);
        self.session.targets.clear();
        let clear = [(0, MasterCommand::SetFifo(FifoAction::Clear).encode())];
        self.ecm.exchange.write_commands(self.session, &clear, self.deadline)?;
        // The next report may have been made before the command arrived. The one after it has the free count of the
        // cleared FIFO.
        self.next_report()?;
        self.next_report()
    }

    /// The last resort of a failed stop. One frame discards all entries, so that none is executed later, sets
    /// velocities to 0 and the torques of moving axes to 0, and makes an axis in CSP that is still going to a distant
    /// target hold its present position.
    pub(super) fn in_one_step(&mut self) -> Result<(), EcmError> {
        let (exchange, session) = (&self.ecm.exchange, &mut *self.session);
        if !session.in_op() {
            return Ok(());
        }
        let is_fresh = !exchange.is_stale(session) && session.stats.reports > 1;
        let observed = if is_fresh { Observation::of_last_cycle(session) } else { Observation::begin(session) };
        let mut commands: Vec<(usize, RawSlot)> = vec![(0, MasterCommand::SetFifo(FifoAction::Clear).encode())];
        for (slave, config) in session.network.slaves() {
            let [first, second] =
                session.targets.outputs()[usize::from(slave)].map(|outputs| AxisTarget { target: 0, outputs });
            let command = match config.axis().map(|axis| axis.mode) {
                // A drive goes on to its last target by itself, however far away it is. It can be held at its present
                // position only if a report shows that position, so the newest report must not be old.
                Some(Mode::Csp) if is_fresh => {
                    let limits = (0.0, self.left.is_foreign);
                    let ramp = ramp_from_position(session, &observed, slave, config, self.left, limits);
                    let held_back = || hold_of(session, &observed, slave, config, self.left);
                    match ramp.map(|ramp| ramp.at(1, 1)).or_else(|| held_back().map(|hold| hold.command)) {
                        Some(hold) => hold,
                        None => continue,
                    }
                }
                Some(Mode::Csv)
                    if is_fresh
                        && !self.ramped.contains(slave)
                        && keeps_outputs(session, &observed, slave, config, self.left) =>
                {
                    continue;
                }
                Some(Mode::Csv) => SlaveCommand::Csv(Motion { first, second }),
                Some(Mode::Cst) if movement::may_move(session, slave, config) => SlaveCommand::Cst(0),
                _ => continue,
            };
            if movement::may_be_on(session, slave, config) {
                commands.push((slave.into(), SlotCommand::from(command).encode(session.size)));
            }
        }
        exchange.write_commands(session, &commands, exchange.now() + LAST_FRAME_LIMIT)
    }
}
