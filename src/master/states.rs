//! Changes of the AL state: step by step, with what each step needs, until the slave is there, refuses, or time is up.

use std::sync::Arc;
use std::task::{Context, Poll};

use super::bus::{Bus, Unanswered};
use super::place::{Place, place};
use super::process_data::Registers;
use super::{StateError, StateReason, SyncSignals, clocks, sii, watchdog};
use crate::ethercat::registers::{
    AL_CONTROL, AL_STATUS, AlControl, AlStatusRegister, AlStatusWithCode, Fmmu, RequestedState, SyncManager, TYPE,
    fmmu, sync_manager,
};
use crate::ethercat::{AlState, AlStatus, MAX_SLAVES, Ns};

/// \[OURS] How long a slave that is asked for its state again and again has between two times.
pub(super) const STATE_POLL_NS: Ns = 200_000;

/// What the steps of one slave write.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    /// Its number, from 1.
    pub(super) slave: u8,
    pub(super) station: u16,
    /// The sync managers of the mailbox.
    pub(super) mailbox: Option<[SyncManager; 2]>,
    /// What the registers say about its process data; `None`: it is not there.
    pub(super) registers: Option<Arc<Registers>>,
    pub(super) sync: Option<SyncSignals>,
}

/// What one slave does in a change of state.
struct Part {
    slave: u8,
    /// What is to be written, until it begins.
    plan: Option<Plan>,
    way: Place<(Plan, AlState, Ns), Result<(), StateReason>>,
    ended: Option<Result<(), StateReason>>,
}

/// A place for a change of state: slaves are brought to it, each at its own pace.
pub(super) struct StateChange {
    target: AlState,
    timeout_ns: Ns,
    /// Those of the slaves that take part, and others for which there is room, in the order of the cable.
    parts: Vec<Part>,
    /// How many slaves take part.
    slaves: usize,
}

impl StateChange {
    /// With room for so many slaves.
    pub(super) fn new(bus: &Bus, slaves: usize) -> Self {
        let mut change =
            Self { target: AlState::Init, timeout_ns: 0, parts: Vec::with_capacity(MAX_SLAVES), slaves: 0 };
        change.parts.extend((0..slaves).map(|_| Part::new(bus.clone())));
        change
    }

    /// Begins a change of state of the slaves that these plans are for. There is none under way here.
    pub(super) fn begin(&mut self, bus: &Bus, plans: impl IntoIterator<Item = Plan>, target: AlState, timeout_ns: Ns) {
        (self.target, self.timeout_ns, self.slaves) = (target, timeout_ns, 0);
        for plan in plans {
            if self.parts.len() == self.slaves {
                self.parts.push(Part::new(bus.clone()));
            }
            let part = &mut self.parts[self.slaves];
            (part.slave, part.plan, part.ended) = (plan.slave, Some(plan), None);
            self.slaves += 1;
        }
    }

    /// Goes on with all slaves; when all have ended, the error of the first one in the order of the cable that is not there.
    pub(super) fn poll(&mut self, bus: &Bus, context: &mut Context<'_>) -> Poll<Result<(), StateError>> {
        let target = self.target;
        let parts = &mut self.parts[..self.slaves];
        for part in parts.iter_mut().filter(|part| part.ended.is_none()) {
            if let Some(plan) = part.plan.take() {
                let until = bus.now().saturating_add(self.timeout_ns);
                part.way.begin((plan, target, until));
            }
            if let Poll::Ready(ended) = part.way.poll(context) {
                part.ended = Some(ended);
            }
        }
        if parts.iter().any(|part| part.ended.is_none()) {
            return Poll::Pending;
        }
        let failed = parts.iter().find_map(|part| Some((part.slave, part.ended?.err()?)));
        Poll::Ready(failed.map_or(Ok(()), |(slave, reason)| Err(StateError { slave, target, reason })))
    }

    /// Gives up what is under way.
    pub(super) fn give_up(&mut self) {
        for part in &mut self.parts[..self.slaves] {
            part.plan = None;
            part.way.give_up();
        }
        self.slaves = 0;
    }
}

impl Part {
    fn new(bus: Bus) -> Self {
        let way = place(move |(plan, target, until)| bring(bus.clone(), plan, target, until));
        Self { slave: 0, plan: None, way, ended: None }
    }
}

/// A change of a slave's state under way. Dropped, it has ended.
struct Change<'a> {
    bus: &'a Bus,
    slave: u8,
}

impl<'a> Change<'a> {
    fn begin(bus: &'a Bus, slave: u8) -> Option<Self> {
        bus.with(|shared| shared.begin_change(slave)).then(|| Self { bus, slave })
    }
}

impl Drop for Change<'_> {
    fn drop(&mut self) {
        self.bus.with(|shared| shared.end_change(self.slave));
    }
}

/// Brings a slave to a state.
async fn bring(bus: Bus, plan: Plan, target: AlState, until: Ns) -> Result<(), StateReason> {
    let (bus, plan) = (&bus, &plan);
    let Some(_change) = Change::begin(bus, plan.slave) else { return Err(StateReason::Busy) };
    let ended = lead(bus, plan, target, until).await;
    // Does it answer at all?
    if ended == Err(StateReason::NotTaken(0)) && bus.read::<1>(plan.station, TYPE).await.is_err() {
        return Err(StateReason::NoAnswer);
    }
    ended
}

/// Leads a slave there, step by step.
async fn lead(bus: &Bus, plan: &Plan, target: AlState, until: Ns) -> Result<(), StateReason> {
    let mut current = acknowledge(bus, plan, until).await?;
    while current != target {
        let next = if target < current { target } else { current.above() };
        step(bus, plan, current, next, until).await?;
        current = next;
    }
    Ok(())
}

async fn status(bus: &Bus, plan: &Plan) -> Result<AlStatusWithCode, StateReason> {
    let status = AlStatusWithCode::decode(&bus.read(plan.station, AL_STATUS).await?);
    bus.with(|shared| shared.note_status(plan.slave, status));
    Ok(status)
}

async fn request(bus: &Bus, plan: &Plan, control: AlControl) -> Result<(), StateReason> {
    Ok(bus.write(plan.station, AL_CONTROL, &control.0.to_le_bytes()).await?)
}

/// Takes back the acknowledgement of a request, where a controller shows it as an error: with device emulation (0x0141 bit 0) AL status
/// copies AL control, bit 4 too, and nobody is there who would clear that, or give it a code. A device with a state machine stays where
/// it is.
pub(super) async fn take_acknowledgement_back(bus: &Bus, station: u16) -> Result<(), Unanswered> {
    let AlStatusWithCode { status, code } = AlStatusWithCode::decode(&bus.read(station, AL_STATUS).await?);
    if !status.contains(AlStatusRegister::ERROR) || code != AlStatus::NONE {
        return Ok(());
    }
    match bus.write(station, AL_CONTROL, &AlControl::request(status.state()).0.to_le_bytes()).await {
        // A device that is still at work on the request before takes none.
        Ok(()) | Err(Unanswered::Counter(_)) => Ok(()),
        Err(lost) => Err(lost),
    }
}

/// Clears an error, and leaves states that are no steps; the state then.
async fn acknowledge(bus: &Bus, plan: &Plan, until: Ns) -> Result<AlState, StateReason> {
    loop {
        let AlStatusWithCode { status: now, code } = status(bus, plan).await?;
        let state = now.state();
        match state {
            RequestedState::State(state) if !now.contains(AlStatusRegister::ERROR) => return Ok(state),
            _ if bus.now() >= until && now.contains(AlStatusRegister::ERROR) => {
                return Err(StateReason::Refused { state, code });
            }
            _ if bus.now() >= until => return Err(StateReason::TimeUp { state }),
            RequestedState::State(_) => {}
            // Boot and states that there are not are left for Init alone.
            _ => {
                let init = AlControl::request(RequestedState::State(AlState::Init));
                request(bus, plan, init.with(AlControl::ACKNOWLEDGE)).await?;
                bus.sleep(STATE_POLL_NS).await;
                take_acknowledgement_back(bus, plan.station).await?;
                continue;
            }
        }
        request(bus, plan, AlControl::request(state).with(AlControl::ACKNOWLEDGE)).await?;
        bus.sleep(STATE_POLL_NS).await;
        take_acknowledgement_back(bus, plan.station).await?;
    }
}

/// One step: prepares it, asks for it, waits for it.
async fn step(bus: &Bus, plan: &Plan, from: AlState, to: AlState, until: Ns) -> Result<(), StateReason> {
    match (from, to) {
        (AlState::Init, AlState::PreOp) => prepare_mailbox(bus, plan).await?,
        (AlState::PreOp, AlState::SafeOp) => prepare_process_data(bus, plan).await?,
        _ => {}
    }
    bus.with(|shared| shared.expect_state(plan.slave, to));
    request(bus, plan, AlControl::request(RequestedState::State(to))).await?;
    wait_for(bus, plan, from, to, until).await?;
    match (from, to) {
        (AlState::Init, AlState::PreOp) => Ok(sii::offer(bus, plan.station, false).await?),
        (AlState::SafeOp | AlState::Op, AlState::PreOp | AlState::Init) => Ok(end_process_data(bus, plan).await?),
        _ => Ok(()),
    }
}

async fn wait_for(bus: &Bus, plan: &Plan, from: AlState, to: AlState, until: Ns) -> Result<(), StateReason> {
    loop {
        let AlStatusWithCode { status: now, code } = status(bus, plan).await?;
        let state = now.state();
        if now.contains(AlStatusRegister::ERROR) {
            return Err(StateReason::Refused { state, code });
        }
        if state == RequestedState::State(to) {
            return Ok(());
        }
        if bus.now() >= until {
            return Err(StateReason::TimeUp { state });
        }
        // A slave that is elsewhere without an error has lost its power on the way.
        if state != RequestedState::State(from) {
            return Err(StateReason::Refused { state, code });
        }
        bus.sleep(STATE_POLL_NS).await;
    }
}

/// Init to PreOP: the mailbox, and the EEPROM for the slave's own controller.
async fn prepare_mailbox(bus: &Bus, plan: &Plan) -> Result<(), Unanswered> {
    if let Some(managers) = &plan.mailbox {
        for (n, manager) in (0..).zip(managers) {
            set_manager(bus, plan, n, manager).await?;
        }
    }
    bus.with(|shared| shared.begin_mailbox(plan.slave));
    sii::offer(bus, plan.station, true).await
}

/// A sync manager takes its start and its length while it is off.
async fn set_manager(bus: &Bus, plan: &Plan, n: u8, manager: &SyncManager) -> Result<(), Unanswered> {
    bus.write(plan.station, sync_manager(n), &SyncManager::default().encode()).await?;
    bus.write(plan.station, sync_manager(n), &manager.encode()).await
}

/// PreOP to SafeOP: sync managers and FMMUs of process data, and the clock.
async fn prepare_process_data(bus: &Bus, plan: &Plan) -> Result<(), StateReason> {
    bus.with(|shared| shared.mapped.insert(plan.slave));
    if let Some(registers) = &plan.registers {
        for (n, manager) in &registers.managers {
            set_manager(bus, plan, *n, manager).await?;
        }
        for (n, mapped) in (0..).zip(&registers.fmmus) {
            bus.write(plan.station, fmmu(n), &mapped.encode()).await?;
        }
    }
    watchdog::set(bus, plan.station, plan.registers.as_deref()).await?;
    Ok(clocks::start_sync(bus, plan.slave, plan.station, plan.sync).await?)
}

/// Below SafeOP nothing is exchanged any more.
async fn end_process_data(bus: &Bus, plan: &Plan) -> Result<(), Unanswered> {
    clocks::stop_sync(bus, plan.slave, plan.station).await?;
    let Some(registers) = &plan.registers else { return Ok(()) };
    for n in 0..registers.fmmus.len() as u8 {
        bus.write(plan.station, fmmu(n), &Fmmu::default().encode()).await?;
    }
    for (n, _) in &registers.managers {
        bus.write(plan.station, sync_manager(*n), &SyncManager::default().encode()).await?;
    }
    bus.with(|shared| shared.mapped.remove(plan.slave));
    Ok(())
}
