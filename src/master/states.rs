//! Changes of the AL state: step by step, with the preparation of each step, until the slave is there, refuses, or the
//! timeout has passed.

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

/// \[OURS] The interval in which a slave's AL status is polled.
pub(super) const STATE_POLL_NS: Ns = 200_000;
/// \[OURS] How long a device has to act on an acknowledgement before it gets another one. Devices poll AL control every
/// 1 to 10 ms.
const ACKNOWLEDGE_AGAIN_NS: Ns = 20_000_000;
/// \[OURS] How many errors on the way to a lower state are acknowledged, each followed by another request. The slave's
/// watchdog may expire before the device reads the request; the device then ignores the request.
const ERRORS_ON_THE_WAY_DOWN: u32 = 3;

/// What a change of state writes into the registers of one slave.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    /// Slave, from 1.
    pub(super) slave: u8,
    pub(super) station: u16,
    /// The sync managers of the mailbox; `None`: the slave has no mailbox.
    pub(super) mailbox: Option<[SyncManager; 2]>,
    /// The register values for the slave's process data; `None`: the slave was not found.
    pub(super) registers: Option<Arc<Registers>>,
    pub(super) sync: Option<SyncSignals>,
}

/// One slave's part in a change of state.
struct Part {
    slave: u8,
    /// The registers to be written; `None` once the sequence has begun.
    plan: Option<Plan>,
    way: Place<(Plan, AlState, Ns), Result<(), StateReason>>,
    ended: Option<Result<(), StateReason>>,
}

/// A reusable slot for a change of state of several slaves, each at its own pace.
pub(super) struct StateChange {
    target: AlState,
    timeout_ns: Ns,
    /// One entry per slave that changes its state, in network order. Entries from `slaves` on are not in use: the vector is
    /// allocated once.
    parts: Vec<Part>,
    /// The number of slaves that change their state.
    slaves: usize,
}

impl StateChange {
    /// Allocates a slot with parts for `slaves` slaves.
    pub(super) fn new(bus: &Bus, slaves: usize) -> Self {
        let mut change =
            Self { target: AlState::Init, timeout_ns: 0, parts: Vec::with_capacity(MAX_SLAVES), slaves: 0 };
        change.parts.extend((0..slaves).map(|_| Part::new(bus.clone())));
        change
    }

    /// Begins a change of state of the slaves in `plans`. No change may be running in this slot: it would be lost.
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

    /// Continues the changes of all slaves. When all have ended, returns the error of the first failed slave in network
    /// order.
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

    /// Cancels the change of state, if one is running. Each slave stays in the state that it has reached, or still goes
    /// to the state that was requested last.
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

/// Marks a slave as changing its state. Dropping it removes the mark.
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

/// Brings a slave to a state. Claims the slave for this change, and finds the reason if the change fails.
async fn bring(bus: Bus, plan: Plan, target: AlState, until: Ns) -> Result<(), StateReason> {
    let (bus, plan) = (&bus, &plan);
    let Some(_change) = Change::begin(bus, plan.slave) else { return Err(StateReason::Busy) };
    let ended = lead(bus, plan, target, until).await;
    // With working counter 0 the slave has refused an access, or does not answer at all. A read of its type register
    // shows which.
    if ended == Err(StateReason::NotTaken(0)) && bus.read::<1>(plan.station, TYPE).await.is_err() {
        return Err(StateReason::NoAnswer);
    }
    ended
}

/// The steps of [`bring`], for a slave that is claimed: acknowledges an error, then goes from state to state.
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

/// Writes AL control. Returns false if the controller takes no request yet, because the device has not read the one
/// before. A slave that no longer answers gives the same result, so the caller reads the AL status next.
async fn request(bus: &Bus, station: u16, control: AlControl) -> Result<bool, Unanswered> {
    match bus.write(station, AL_CONTROL, &control.0.to_le_bytes()).await {
        Ok(()) => Ok(true),
        Err(Unanswered::Counter(0)) => Ok(false),
        Err(error) => Err(error),
    }
}

/// Requests Init and acknowledges an error, as soon as the device has read the request before, but no later than `until`.
pub(super) async fn request_init(bus: &Bus, station: u16, until: Ns) -> Result<(), Unanswered> {
    let init = AlControl::request(RequestedState::State(AlState::Init)).with(AlControl::ACKNOWLEDGE);
    while !request(bus, station, init).await? && bus.now() < until {
        bus.sleep(STATE_POLL_NS).await;
    }
    Ok(())
}

/// Sends a request again without the acknowledge bit, for slaves that show that bit as an error. With device emulation
/// (0x0141 bit 0) the AL status copies the AL control register, with bit 4, and no application clears it or sets an AL
/// status code. A device with a state machine keeps its state.
pub(super) async fn take_acknowledgement_back(bus: &Bus, station: u16) -> Result<(), Unanswered> {
    let AlStatusWithCode { status, code } = AlStatusWithCode::decode(&bus.read(station, AL_STATUS).await?);
    if !status.contains(AlStatusRegister::ERROR) || code != AlStatus::NONE {
        return Ok(());
    }
    match bus.write(station, AL_CONTROL, &AlControl::request(status.state()).0.to_le_bytes()).await {
        // A device that is still busy with the previous request takes no new one.
        Ok(()) | Err(Unanswered::Counter(_)) => Ok(()),
        Err(lost) => Err(lost),
    }
}

/// Acknowledges an error, and leaves Boot and invalid states. Returns the state after that.
async fn acknowledge(bus: &Bus, plan: &Plan, until: Ns) -> Result<AlState, StateReason> {
    let mut ask_at = bus.now();
    loop {
        let AlStatusWithCode { status: now, code } = status(bus, plan).await?;
        let state = now.state();
        let asked = match state {
            RequestedState::State(state) if !now.contains(AlStatusRegister::ERROR) => return Ok(state),
            _ if bus.now() >= until && now.contains(AlStatusRegister::ERROR) => {
                return Err(StateReason::Refused { state, code });
            }
            _ if bus.now() >= until => return Err(StateReason::TimeUp { state }),
            RequestedState::State(_) => state,
            // From Boot and invalid states the only transition leads to Init.
            _ => RequestedState::State(AlState::Init),
        };
        let is_asked = bus.now() >= ask_at
            && request(bus, plan.station, AlControl::request(asked).with(AlControl::ACKNOWLEDGE)).await?;
        bus.sleep(STATE_POLL_NS).await;
        if is_asked {
            ask_at = bus.now().saturating_add(ACKNOWLEDGE_AGAIN_NS);
            take_acknowledgement_back(bus, plan.station).await?;
        }
    }
}

/// Takes one step, to the next higher state or directly down to the target: prepares it, requests the new state, and
/// waits for it.
async fn step(bus: &Bus, plan: &Plan, from: AlState, to: AlState, until: Ns) -> Result<(), StateReason> {
    match (from, to) {
        (AlState::Init, AlState::PreOp) => prepare_mailbox(bus, plan).await?,
        (AlState::PreOp, AlState::SafeOp) => prepare_process_data(bus, plan).await?,
        _ => {}
    }
    let mut errors = 0;
    loop {
        ask_for(bus, plan, to, until).await?;
        match wait_for(bus, plan, from, to, until).await {
            Err(StateReason::Refused { state: RequestedState::State(state), .. })
                if (to..=from).contains(&state) && errors < ERRORS_ON_THE_WAY_DOWN =>
            {
                errors += 1;
                if acknowledge(bus, plan, until).await? == to {
                    break;
                }
            }
            ended => {
                ended?;
                break;
            }
        }
    }
    match (from, to) {
        (AlState::Init, AlState::PreOp) => Ok(sii::offer(bus, plan.station, false).await?),
        (AlState::SafeOp | AlState::Op, AlState::PreOp | AlState::Init) => Ok(end_process_data(bus, plan).await?),
        _ => Ok(()),
    }
}

/// Requests a state, and repeats the request while the device has not read the one before.
async fn ask_for(bus: &Bus, plan: &Plan, to: AlState, until: Ns) -> Result<(), StateReason> {
    bus.with(|shared| shared.expect_state(plan.slave, to));
    while !request(bus, plan.station, AlControl::request(RequestedState::State(to))).await? {
        // Shows whether the slave still answers.
        status(bus, plan).await?;
        if bus.now() >= until {
            return Err(StateReason::NotTaken(0));
        }
        bus.sleep(STATE_POLL_NS).await;
    }
    Ok(())
}

/// Waits until a slave that has left, or is to leave, the state `from` is in the state `to`. On its way down it may show
/// the states between.
async fn wait_for(bus: &Bus, plan: &Plan, from: AlState, to: AlState, until: Ns) -> Result<(), StateReason> {
    let between = from.min(to)..=from.max(to);
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
        // A slave in any other state that reports no error has lost its power meanwhile.
        if !matches!(state, RequestedState::State(state) if between.contains(&state)) {
            return Err(StateReason::Refused { state, code });
        }
        bus.sleep(STATE_POLL_NS).await;
    }
}

/// For Init to PreOP: sets up the mailbox, and gives the EEPROM to the slave's own controller.
async fn prepare_mailbox(bus: &Bus, plan: &Plan) -> Result<(), Unanswered> {
    if let Some(managers) = &plan.mailbox {
        for (n, manager) in (0..).zip(managers) {
            set_manager(bus, plan, n, manager).await?;
        }
    }
    bus.with(|shared| shared.begin_mailbox(plan.slave));
    sii::offer(bus, plan.station, true).await
}

/// Writes a sync manager. It accepts address and length only while it is disabled.
async fn set_manager(bus: &Bus, plan: &Plan, n: u8, manager: &SyncManager) -> Result<(), Unanswered> {
    bus.write(plan.station, sync_manager(n), &SyncManager::default().encode()).await?;
    bus.write(plan.station, sync_manager(n), &manager.encode()).await
}

/// For PreOP to SafeOP: sets up sync managers and FMMUs of process data, the watchdog, and the clock.
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

/// After a change from SafeOP or OP to PreOP or Init: stops the SYNC signals, and disables the FMMUs and sync managers
/// of the process data.
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
