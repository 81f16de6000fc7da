//! The scan and the start of the chip's network, and the reading of the slaves' states.

use super::{Part, Steps, TOLD_LATE};
use crate::ethercat::{AlState, MAX_SLAVES, Ns, SlaveSet};
use crate::fieldbus::Refusal;
use crate::fieldbus::xf::ask::{Ask, Reply};
use crate::fieldbus::xf::chip_bus::ChipBus;
use crate::sk::CycleTime;
use crate::xf::host::{HostError, Wires};
use crate::xf::request::{Fifos, SlaveInfoItem};
use crate::xf::{EtherCatState, NetworkState};

impl<W: Wires> Steps<W> {
    /// Scans the network. Returns the number of slaves found.
    pub(super) async fn scan(&self) -> Result<u8, Refusal> {
        let found = self.start_network(CycleTime::DEFAULT).await?;
        for slave in 1..=found {
            let has_dc = self.ask(Ask::Info(slave, SlaveInfoItem::HasDc)).await;
            if has_dc.is_ok_and(|has_dc| has_dc != 0) {
                self.with(|bus| bus.network.with_dc.insert(slave));
            }
        }
        Ok(found)
    }

    /// Makes the chip initialise its network, after which all slaves are in Init. Returns the number of slaves that the
    /// chip has found.
    async fn start_network(&self, cycle: CycleTime) -> Result<u8, Refusal> {
        self.with(|bus| {
            bus.leave_op();
            bus.part = Part::StartsNetwork;
        });
        let _ = self.ask(Ask::Fifo { on: false }).await;
        let _ = self.ask(Ask::Clear(Fifos::Both)).await;
        if self.with(|bus| bus.is_network_up()) {
            // Applications also request Init before the initialisation (OBS). An earlier program may have left the
            // slaves in OP.
            self.with(|bus| bus.network.commanded.fill(AlState::Init));
            let _ = self.ask(Ask::Enter(None, AlState::Init)).await;
        }
        if self.ask(Ask::Init { sync0_ns: cycle.ns() as u32 }).await.is_err() {
            self.with(|bus| bus.network.stop());
            return Err(Refusal::no_answer(1));
        }
        let found = self.ask(Ask::Count).await.unwrap_or(0).min(MAX_SLAVES as u32) as u8;
        self.with(|bus| bus.network.start(found, cycle));
        Ok(found)
    }

    /// Starts the chip's network again and brings all slaves to PreOP, unless the network already runs with that cycle
    /// time.
    pub(super) async fn start_unless_known(&self, cycle: CycleTime) -> Result<(), Refusal> {
        let (before, is_known) = self.with(|bus| (bus.network.found, bus.network.is_known(cycle)));
        if is_known {
            return Ok(());
        }
        let found = self.start_network(cycle).await?;
        self.with(|bus| bus.network.found = before);
        if found < before {
            // The chip has found fewer slaves than the scan. It cannot reach a slave that it has not found, so the network
            // counts as stopped and the next job starts it again.
            self.with(|bus| bus.network.stop());
            return Err(Refusal::no_answer(found + 1));
        }
        let _ = self.ask(Ask::Enter(None, AlState::PreOp)).await;
        self.with(|bus| {
            bus.network.commanded[..usize::from(before)].fill(AlState::PreOp);
            bus.part = Part::Any;
        });
        Ok(())
    }

    /// Reads the states of all slaves. If one of them turns out to be lost, waits until the engine has polled this
    /// loss. Only then may the job bring the slave back: otherwise the engine would not count the commands that the
    /// slave has missed.
    pub(super) async fn read_states(&mut self) -> Result<(), Refusal> {
        self.with(ChipBus::begin_reading);
        let _ = self.ask(Ask::UpdateStates).await;
        let found = self.with(|bus| bus.network.found);
        for slave in 1..=found {
            let state = state_of(self.ask(Ask::StateOf(slave)).await);
            self.with(|bus| bus.states[usize::from(slave) - 1] = state);
        }
        // If no slave has answered, the chip may have been reset. The driver misses a reset that happens while it sets
        // the check word, for example after a change of the packet size.
        if found > 0
            && self.with(|bus| bus.states[..usize::from(found)].iter().all(Option::is_none))
            && matches!(self.ask(Ask::Count).await, Ok(0) | Err(HostError::Refused { .. }))
        {
            self.with(ChipBus::lose_all);
            return Err(Refusal::no_answer(1));
        }
        while self.bus.lock().note_states(&mut self.tells_until) {
            self.wait_cycles(1).await;
        }
        Ok(())
    }
}

impl<W: Wires> ChipBus<W> {
    /// Whether slaves of the chip may be above Init: the newest answer shows such a state, or a job has brought a slave
    /// there. The chip shows the lowest state of all slaves.
    fn is_network_up(&self) -> bool {
        let shown = self.host.header().and_then(|header| header.state.state());
        shown.is_some_and(|state| state != EtherCatState::Init) || !self.network.at_least(AlState::PreOp).is_empty()
    }

    /// Evaluates the states of all slaves. Any slave may have left its state by itself, including those that the job is
    /// about to move. Returns whether slaves were lost and the engine has not polled this loss yet, so that the job has
    /// to wait.
    fn note_states(&mut self, tells_until: &mut Option<Ns>) -> bool {
        for slave in SlaveSet::first(self.network.found).iter() {
            self.note_state(slave, self.state(slave));
        }
        self.end_reading();
        let now = self.wires.now();
        let is_told = self.network.lost.difference(self.told_lost).is_empty();
        let waits = self.runs && !is_told && tells_until.is_none_or(|until| now < until);
        if waits {
            tells_until.get_or_insert(now.saturating_add(TOLD_LATE * self.network.cycle.ns()));
        }
        waits
    }
}

/// The state in the answer to a STATE_GET; `None`: the slave does not answer.
pub(in crate::fieldbus::xf) fn state_of(reply: Reply) -> Option<AlState> {
    match NetworkState(reply.unwrap_or(0) as u8).state()? {
        EtherCatState::Init => Some(AlState::Init),
        EtherCatState::PreOp => Some(AlState::PreOp),
        EtherCatState::SafeOp => Some(AlState::SafeOp),
        EtherCatState::Op => Some(AlState::Op),
        EtherCatState::Boot => None,
    }
}
