//! The job of a change of state: moves slaves up by one state at a time, or directly down, until all are in the target
//! state.

use super::{Steps, TOLD_LATE};
use crate::ethercat::{AlState, AlStatus, Ns, SlaveSet};
use crate::fieldbus::xf::ask::Ask;
use crate::fieldbus::xf::chip_bus::ChipBus;
use crate::fieldbus::{Refusal, leaving_op_ns};
use crate::xf::host::{HostError, Wires};
use crate::xf::request::{Fifos, SlaveInfoItem};

/// The pause before the state is requested again from slaves that have not reached it, ns. \[OURS]
const RETRY_NS: Ns = 10_000_000;

/// What a running change of state has to remember between its steps.
struct Change {
    target: AlState,
    slaves: SlaveSet,
    /// The state to which the chip was last commanded to bring all slaves together. Slaves that are behind afterwards
    /// are moved one by one.
    all_tried: Option<AlState>,
    /// Whether all slaves have left OP and the job has waited until the engine has polled the last cycles in OP.
    /// Without this wait the engine would lose these cycles.
    has_told_op: bool,
    /// Unused slaves that the job has requested to go back to PreOP. Each is requested once, even if it refuses.
    brought_back: SlaveSet,
}

/// A wait for outputs that must be sent before slaves leave OP.
#[derive(Clone, Copy, Debug)]
struct SentFirst {
    /// The id of the newest outputs that must be sent first.
    newest: u64,
    /// When the wait ends even if the outputs are not known to be sent, on the clock of the wires to the chip.
    until: Ns,
}

impl<W: Wires> Steps<W> {
    pub(super) async fn change(&mut self, target: AlState, slaves: SlaveSet) -> Result<(), Refusal> {
        let cycle = self.with(|bus| bus.network.cycle);
        self.start_unless_known(cycle).await?;
        if self.with(|bus| bus.runs) && target < AlState::Op {
            self.send_first(slaves).await;
        }
        let slaves = slaves.intersection(SlaveSet::first(self.with(|bus| bus.network.found)));
        let mut change = Change { target, slaves, all_tried: None, has_told_op: false, brought_back: SlaveSet::EMPTY };
        loop {
            self.read_states().await?;
            self.with(|bus| bus.note_reached(&change))?;
            while let Some(slave) = self.with(|bus| bus.strayed(&change)) {
                self.bring_back(slave).await;
                change.brought_back.insert(slave);
                self.with(|bus| bus.note_reached(&change))?;
            }
            if self.step(&mut change).await? {
                return Ok(());
            }
        }
    }

    /// Waits until the outputs accepted so far are known to be sent. The command frame that requests a lower state may
    /// also switch outputs off, and the board executes that first. If all slaves leave OP, the bus also waits for
    /// outputs that are accepted during the wait, for [`leaving_op_ns`] plus the time for answers: SV_OFF, for example,
    /// has a second step, which follows the answer to the first. Outputs that are accepted after the wait are still
    /// sent while the slaves change their state, since an axis may have to be stopped then. It is not known which of
    /// these outputs reach the slaves, so they count as lost for these slaves.
    async fn send_first(&self, slaves: SlaveSet) {
        let (mut first, mut sends_until) = (None, 0);
        while let Some(next) = self.with(|bus| bus.sent_first(slaves, first, &mut sends_until)) {
            first = Some(next);
            self.wait_cycles(1).await;
        }
    }

    /// Sends a slave that is not used back to PreOP. If the slave refuses, it stays in its state, and the job does not wait
    /// for it.
    async fn bring_back(&self, slave: u8) {
        if self.ask(Ask::Enter(Some(slave), AlState::PreOp)).await.is_ok() {
            let n = usize::from(slave) - 1;
            self.with(|bus| (bus.network.commanded[n], bus.states[n]) = (AlState::PreOp, Some(AlState::PreOp)));
        }
    }

    /// Makes the next step, once the states of the slaves were read. Returns whether all slaves are in the target
    /// state.
    async fn step(&self, change: &mut Change) -> Result<bool, Refusal> {
        let (in_op, runs) = self.with(|bus| (bus.network.in_op(), bus.runs));
        if !in_op.is_empty() && !runs {
            let _ = self.ask(Ask::Clear(Fifos::Tx)).await;
            let _ = self.ask(Ask::Fifo { on: true }).await;
            self.with(ChipBus::enter_op);
            return Ok(false);
        }
        if in_op.is_empty() {
            if runs && !change.has_told_op {
                change.has_told_op = true;
                self.wait_cycles(TOLD_LATE).await;
                return Ok(false);
            }
            self.with(ChipBus::leave_op);
        }
        let Some(lowest) = self.with(|bus| bus.lowest_behind(change)) else {
            let Some(slave) = self.with(|bus| change.slaves.iter().find(|slave| bus.state(*slave).is_none())) else {
                return Ok(true);
            };
            // All slaves that answer are in the target state. A slave that does not answer may answer again until the
            // job's timeout.
            self.tell_refusal(slave).await?;
            return Ok(false);
        };
        let to = if lowest > change.target { change.target } else { lowest.above().min(change.target) };
        if to == AlState::Op && in_op.is_empty() {
            self.with(ChipBus::leave_op);
            let _ = self.ask(Ask::Fifo { on: false }).await;
            let _ = self.ask(Ask::Clear(Fifos::Both)).await;
            self.with(ChipBus::send_holding);
            self.wait(0).await;
        }
        self.enter(change, to).await?;
        Ok(false)
    }

    /// Handles a slave that is not in the wanted state. If it has an AL status code, returns its refusal as the error.
    /// Otherwise waits [`RETRY_NS`] and returns `Ok`: the caller tries again.
    async fn tell_refusal(&self, slave: u8) -> Result<(), Refusal> {
        match self.ask(Ask::Info(slave, SlaveInfoItem::AlStatus)).await {
            Ok(al_status) if al_status != 0 => Err(Refusal::of(slave, AlStatus(al_status as u16))),
            _ => {
                self.wait(RETRY_NS).await;
                Ok(())
            }
        }
    }

    /// Brings the slaves that are behind to the state `to`. The chip can move one slave or all slaves at once, which
    /// takes no longer than moving one. Slaves are moved one by one only if not all may move, or if moving all has
    /// failed.
    ///
    /// \[OURS] Slaves that are declared as none (SK-4.57) go to SafeOP with the others and come back to PreOP at once:
    /// one by one, 39 slaves that take 300 ms each would need more than the 10 s that SET_STATE has. They do not go on
    /// to OP, because outputs act there.
    async fn enter(&self, change: &mut Change, to: AlState) -> Result<(), Refusal> {
        let behind = self.with(|bus| bus.behind(change, to));
        let Some(unused) = self.with(|bus| bus.unused_beside(change, behind, to)) else {
            return self.enter_one_by_one(behind, to).await;
        };
        change.all_tried = Some(to);
        self.with(|bus| bus.note_commanded(behind.union(unused), to, AlState::SafeOp));
        // If the command fails, the states read next show which slaves have moved. The others are then moved one by
        // one.
        if self.ask(Ask::Enter(None, to)).await.is_ok() {
            self.with(|bus| bus.note_commanded(SlaveSet::first(bus.network.found), to, AlState::Op));
        }
        Ok(())
    }

    async fn enter_one_by_one(&self, behind: SlaveSet, to: AlState) -> Result<(), Refusal> {
        for slave in behind.iter() {
            self.with(|bus| bus.note_commanded([slave].into_iter().collect(), to, AlState::SafeOp));
            match self.ask(Ask::Enter(Some(slave), to)).await {
                Ok(_) => self.with(|bus| bus.network.commanded[usize::from(slave) - 1] = to),
                Err(HostError::Failed { .. }) => {
                    self.with(|bus| bus.stay_up(slave));
                    return self.tell_refusal(slave).await;
                }
                Err(_) => return Err(Refusal::no_answer(slave)),
            }
        }
        Ok(())
    }
}

impl<W: Wires> ChipBus<W> {
    /// The outputs that must be sent first; `None`: there are none, they were sent, a clear discards them, or the wait
    /// for them is over. `sends_until`: outputs that are accepted during the wait must be sent first too, until this
    /// time; the first call sets it.
    fn sent_first(&self, slaves: SlaveSet, first: Option<SentFirst>, sends_until: &mut Ns) -> Option<SentFirst> {
        let (now, cycle_ns) = (self.wires.now(), self.network.cycle.ns());
        let until = now.saturating_add((u64::from(self.depth()) + 2 * TOLD_LATE) * cycle_ns);
        let in_op = self.network.in_op();
        let all_leave = in_op.difference(slaves).is_empty();
        if first.is_none() && all_leave && !in_op.is_empty() {
            *sends_until = now.saturating_add(leaving_op_ns(in_op.len()) + 2 * TOLD_LATE * cycle_ns);
        }
        let more = |first: &SentFirst| all_leave && now < *sends_until && self.newest_taken() > Some(first.newest);
        let newest = self.newest_taken().map(|newest| SentFirst { newest, until });
        let first = first.filter(|first| !more(first)).or(newest)?;
        let is_sent = self.ledger.newest_sent() >= Some(first.newest);
        (now < first.until && !is_sent && !self.is_clearing()).then_some(first)
    }

    /// Records which slaves are in the target state. If the target is above PreOP and one of the slaves is not
    /// configured, returns a refusal.
    fn note_reached(&mut self, change: &Change) -> Result<(), Refusal> {
        let unconfigured = change.slaves.difference(self.network.with_process_data());
        if change.target > AlState::PreOp
            && let Some(slave) = unconfigured.iter().next()
        {
            // The chip was reset since the configuration. The slave counts as lost and has to be configured again
            // first, even if it is still in the state to which the chip brought it before the reset \[OURS].
            self.network.lost = self.network.lost.union(unconfigured);
            return Err(Refusal::no_answer(slave));
        }
        (1..=self.network.found).for_each(|slave| self.stay_up(slave));
        for slave in change.slaves.iter().filter(|slave| self.states[usize::from(*slave) - 1] == Some(change.target)) {
            self.network.commanded[usize::from(slave) - 1] = change.target;
            self.network.found_again(slave);
            self.network.lost_from[usize::from(slave) - 1] = None;
        }
        Ok(())
    }

    /// Returns an unused slave that has gone to SafeOP with the others and has to be sent back.
    fn strayed(&self, change: &Change) -> Option<u8> {
        let unused = self.network.unused().difference(change.slaves).difference(change.brought_back);
        unused.iter().find(|slave| self.state(*slave) > Some(AlState::PreOp))
    }

    /// The lowest state of the slaves that are not in the target state; `None`: all slaves that answer are in it.
    fn lowest_behind(&self, change: &Change) -> Option<AlState> {
        let states = change.slaves.iter().filter_map(|slave| self.state(slave));
        states.filter(|state| *state != change.target).min()
    }

    /// The unused slaves that move together with the slaves that are behind, because the chip moves all slaves at once.
    /// `None`: the slaves that are behind are moved one by one.
    fn unused_beside(&self, change: &Change, behind: SlaveSet, to: AlState) -> Option<SlaveSet> {
        let goes_along = |slave: &u8| to == AlState::SafeOp && self.state(*slave) == Some(AlState::PreOp);
        let unused: SlaveSet = self.network.unused().difference(behind).iter().filter(goes_along).collect();
        let stays = |slave: u8| unused.contains(slave) || self.state(slave).is_none_or(|state| state == to);
        let others = SlaveSet::first(self.network.found).difference(behind);
        let together = behind.len() >= 2 && change.all_tried != Some(to) && others.iter().all(stays);
        together.then_some(unused)
    }

    /// The slaves of a change of state that have to enter the state `to` in this step: those in a lower state than `to`, and
    /// those in a higher one than the target of the change.
    fn behind(&self, change: &Change, to: AlState) -> SlaveSet {
        let stays = |state: AlState| (to..=change.target.max(to)).contains(&state);
        let moves = |slave: &u8| self.state(*slave).is_some_and(|state| !stays(state));
        change.slaves.iter().filter(moves).collect()
    }

    /// Records `to` as the commanded state of slaves, unless it is above the state `most`. Callers pass SafeOP as
    /// `most` before the slaves change their state: so a slave that leaves OP on command does not count as lost, and OP
    /// is recorded only after the slaves have entered it.
    fn note_commanded(&mut self, slaves: SlaveSet, to: AlState, most: AlState) {
        if to <= most {
            slaves.iter().for_each(|slave| self.network.commanded[usize::from(slave) - 1] = to);
        }
    }

    /// If a slave is in a higher state than its commanded one, its present state becomes the commanded one: the slave
    /// has refused to go down, and is still used in that state. This does not apply to slaves above PreOP whose process
    /// data the chip has lost in a reset.
    fn stay_up(&mut self, slave: u8) {
        let Some(state) = self.state(slave) else { return };
        if state <= AlState::PreOp || self.network.with_process_data().contains(slave) {
            let commanded = &mut self.network.commanded[usize::from(slave) - 1];
            *commanded = state.max(*commanded);
        }
    }
}
