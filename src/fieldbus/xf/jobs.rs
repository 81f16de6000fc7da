//! The jobs of the bus as sequences of commands of the chip.
//!
//! [`XfBus::go_on`] is called when a job begins, when the answer to its command is there and when its wait is over; it
//! says what comes next. `configure.rs` has the steps of a configuration, `state.rs` those of a change of state.

mod configure;
mod run;
mod state;

use super::XfBus;
use super::ask::{Ask, Reply};
use super::network::Mapped;
use crate::ethercat::coe::AbortCode;
use crate::ethercat::{AlState, AlStatus, MAX_SLAVES, Ns, SlaveSet};
use crate::fieldbus::pdo::ProcessData;
use crate::fieldbus::{BusConfig, Job, JobDone, Refusal, SdoRequest};
use crate::sk::CycleTime;
use crate::xf::host::{HostError, Wires};
use crate::xf::request::{Fifos, SlaveInfoItem};
use crate::xf::{DataSize, EtherCatState, NetworkState};
use state::TOLD_LATE;

/// Between two attempts to bring slaves to a state. \[OURS]
const RETRY_NS: Ns = 10_000_000;

/// A job under way, and how far it is.
#[derive(Clone, Debug)]
pub(super) struct Running {
    kind: Kind,
    stage: Stage,
    deadline: Ns,
    /// Where the next stage waits for a time: until then.
    pub(super) wait_until: Option<Ns>,
    /// The slaves' states as read last; `None`: no answer.
    states: [Option<AlState>; MAX_SLAVES],
    /// Slaves that have left OP for the configuration of others.
    disturbed: SlaveSet,
    /// The others stay as they are.
    keeps_layout: bool,
    /// All were asked together to enter this state.
    all_tried: Option<AlState>,
    /// What is to be sent before slaves leave OP.
    sent_first: Option<SentFirst>,
    /// All slaves leave OP: until when outputs that are taken are sent before.
    sends_until: Ns,
    /// All slaves have left OP, and its last cycles were told.
    has_told_op: bool,
    /// How long the job waits at most until a loss is told; `None`: it has seen none.
    tells_until: Option<Ns>,
    second_axes: SlaveSet,
    /// The process data that are being mapped.
    mapping: Option<ProcessData>,
    /// What the slave has of that mapping.
    mapped: Mapped,
    /// It is a configuration that nobody has asked for yet: nothing is written to a slave, and nobody is told its end.
    pub(super) is_ahead: bool,
    /// Slaves that are not used, and were told to go back to PreOP.
    brought_back: SlaveSet,
    /// The lengths of a slave's outputs as the chip has them.
    output_bytes: usize,
}

/// Outputs that are to be sent before slaves leave OP.
#[derive(Clone, Copy, Debug)]
struct SentFirst {
    /// The id of the newest ones.
    newest: u64,
    /// How long they are waited for.
    until: Ns,
}

#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "there is one at a time")]
enum Kind {
    Scan,
    Configure(BusConfig),
    State { target: AlState, slaves: SlaveSet },
}

/// What the command that was asked last was for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Begin,
    /// Outputs that the bus has taken are sent before slaves leave OP.
    SendFirst,
    FifoOff,
    ClearFifos,
    Init,
    Count,
    HasDc(u8),
    AllToPreOp,
    UpdateStates,
    StateOf(u8),
    /// The chip could read no state: whether it knows any slaves.
    CountAgain,
    /// A slave has turned out to be lost: that is told before the job may bring it back, so that the commands which it has missed
    /// are counted.
    TellLoss,
    /// The other slaves leave OP or SafeOP, from this one on.
    Leave(u8),
    /// They have, and the last cycles of OP are told.
    Left,
    SecondAxis(u8),
    /// A mapping object of a slave is read, that at this place.
    Look(u8, usize),
    LookAtSyncType(u8, usize),
    Download(u8, usize),
    Reconfig,
    OutputBytes(u8),
    InputBytes(u8),
    RxEntries,
    TxEntries,
    BuildFifos,
    Resize,
    StopFifo,
    EmptyFifos,
    Hold,
    /// The slaves that are in the lowest state go to this one, from this slave on.
    Enter(AlState, u8),
    /// All slaves go to this one.
    EnterAll(AlState),
    /// Some have not entered it.
    Retry,
    /// A slave that is not used, and went to SafeOP with all others, goes back to PreOP.
    BringBack(u8),
    AlStatus(u8),
    EmptyTxFifo,
    FifoOn,
}

/// What a job needs next.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant, reason = "it is made and used at once")]
enum Todo {
    Ask(Ask),
    Wait(Ns),
    /// The driver is set to another n.
    Resize(DataSize),
    /// Outputs past the FIFO with which nothing moves.
    Hold,
    Done(JobDone),
}

impl Running {
    pub(super) fn new(job: Job, now: Ns) -> Option<Self> {
        let (kind, timeout_ns) = match job {
            Job::Scan => (Kind::Scan, Ns::MAX),
            Job::Configure(config) => (Kind::Configure(config), Ns::MAX),
            Job::State { target, slaves, timeout_ns } => (Kind::State { target, slaves }, timeout_ns),
            Job::Sdo(_) => return None,
        };
        Some(Self {
            kind,
            stage: Stage::Begin,
            deadline: now.saturating_add(timeout_ns),
            wait_until: None,
            states: [None; MAX_SLAVES],
            disturbed: SlaveSet::EMPTY,
            keeps_layout: false,
            all_tried: None,
            sent_first: None,
            sends_until: 0,
            has_told_op: false,
            tells_until: None,
            second_axes: SlaveSet::EMPTY,
            mapping: None,
            mapped: Mapped::ALL,
            is_ahead: false,
            brought_back: SlaveSet::EMPTY,
            output_bytes: 0,
        })
    }

    /// A configuration that nobody has asked for yet.
    pub(super) fn ahead(config: BusConfig, now: Ns) -> Option<Self> {
        Some(Self { is_ahead: true, ..Self::new(Job::Configure(config), now)? })
    }

    /// Whether the job may be dropped between two commands, and nothing is left half done that another one would find: the network
    /// is not being initialised.
    pub(super) const fn may_be_left(&self) -> bool {
        use Stage::{AllToPreOp, ClearFifos, Count, FifoOff, Init};
        !matches!(self.stage, FifoOff | ClearFifos | Init | Count | AllToPreOp)
    }

    /// Whether the job lays out process data for this configuration, of which all objects were seen.
    pub(super) fn lays_out(&self, wanted: &BusConfig) -> bool {
        use Stage::{BuildFifos, InputBytes, OutputBytes, Reconfig, Resize, RxEntries, TxEntries};
        let is_layout = matches!(
            self.stage,
            Reconfig | OutputBytes(_) | InputBytes(_) | RxEntries | TxEntries | BuildFifos | Resize
        );
        is_layout && matches!(&self.kind, Kind::Configure(config) if config == wanted)
    }

    fn ask(&mut self, stage: Stage, ask: Ask) -> Todo {
        self.stage = stage;
        Todo::Ask(ask)
    }

    fn failed(&self, refusal: Refusal) -> Todo {
        Todo::Done(self.failure(refusal))
    }

    const fn failure(&self, refusal: Refusal) -> JobDone {
        match self.kind {
            Kind::Scan => JobDone::Scan { found: 0 },
            Kind::Configure(_) => JobDone::Configure(Err(refusal)),
            Kind::State { .. } => JobDone::State(Err(refusal)),
        }
    }

    fn state(&self, slave: u8) -> Option<AlState> {
        self.states[usize::from(slave) - 1]
    }

    /// The end of a change of state that was not done in time.
    pub(super) fn late(&self) -> Option<JobDone> {
        let Kind::State { target, slaves } = self.kind else { return None };
        let slave = slaves.iter().find(|slave| self.state(*slave) != Some(target));
        Some(self.failure(no_answer(slave.unwrap_or(self.first()))))
    }

    /// The end of a job whose chip has forgotten what it was told.
    pub(super) fn cut_off(&self) -> JobDone {
        self.failure(no_answer(self.first()))
    }

    /// The first slave that the job is about.
    fn first(&self) -> u8 {
        let slaves = match &self.kind {
            Kind::Scan => return 1,
            Kind::Configure(config) => config.selected,
            Kind::State { slaves, .. } => *slaves,
        };
        slaves.iter().next().unwrap_or(1)
    }

    pub(super) const fn is_late(&self, now: Ns) -> bool {
        now >= self.deadline
    }
}

const fn no_answer(slave: u8) -> Refusal {
    Refusal { slave, al_status: 0, abort: None }
}

/// The end of an SDO.
pub(super) fn sdo_done(request: &SdoRequest, reply: Reply) -> JobDone {
    JobDone::Sdo(match reply {
        Ok(value) => Ok(request.write.map_or(value, |(_, written)| written)),
        Err(error) => Err(abort_code(&error)),
    })
}

/// What a transfer that the chip could not do ends with: the slave's abort code, or a timeout.
fn abort_code(error: &HostError) -> AbortCode {
    match error {
        HostError::Failed { abort: Some(abort), .. } if abort.0 != 0 => *abort,
        _ => AbortCode::TIMEOUT,
    }
}

impl<W: Wires> XfBus<W> {
    /// What the job needs next; `reply` is the answer to what it needed last.
    fn go_on(&mut self, job: &mut Running, reply: Reply, now: Ns) -> Todo {
        match job.stage {
            Stage::Begin => self.begin(job, now),
            Stage::SendFirst => self.send_first(job, now),
            Stage::FifoOff => job.ask(Stage::ClearFifos, Ask::Clear(Fifos::Both)),
            Stage::ClearFifos => job.ask(Stage::Init, Ask::Init { sync0_ns: self.wanted_cycle(job).ns() as u32 }),
            Stage::Init => match reply {
                Ok(_) => job.ask(Stage::Count, Ask::Count),
                Err(_) => {
                    self.network.stop();
                    job.failed(no_answer(1))
                }
            },
            Stage::Count => self.counted(job, reply),
            Stage::HasDc(slave) => {
                if reply.is_ok_and(|has_dc| has_dc != 0) {
                    self.network.with_dc.insert(slave);
                }
                self.ask_dc(job, slave + 1)
            }
            Stage::AllToPreOp => {
                self.network.commanded[..usize::from(self.network.found)].fill(AlState::PreOp);
                self.read_states(job)
            }
            Stage::UpdateStates => self.ask_state(job, 1, now),
            Stage::StateOf(slave) => {
                job.states[usize::from(slave) - 1] = state_of(reply);
                self.ask_state(job, slave + 1, now)
            }
            Stage::CountAgain if matches!(reply, Ok(0) | Err(HostError::Refused { .. })) => {
                self.lose_all();
                job.failed(no_answer(1))
            }
            Stage::CountAgain | Stage::TellLoss => self.states_are_read(job, now),
            Stage::Leave(slave) => {
                if reply.is_ok() {
                    self.network.commanded[usize::from(slave) - 1] = AlState::PreOp;
                }
                self.leave(job, slave + 1, now)
            }
            Stage::Left => self.left(job),
            Stage::SecondAxis(slave) => self.map(job, slave, reply.is_ok()),
            Stage::Look(slave, place) => self.looked(job, slave, place, reply),
            Stage::LookAtSyncType(slave, place) => self.looked_at_sync_type(job, slave, place, reply),
            Stage::Download(slave, place) => self.downloaded(job, slave, place, reply),
            Stage::Reconfig => match reply {
                Ok(_) => job.ask(Stage::OutputBytes(1), Ask::Info(1, SlaveInfoItem::OutputBytes)),
                Err(_) => {
                    let AlStatus(al_status) = AlStatus::INVALID_OUTPUTS;
                    job.failed(Refusal { slave: job.first(), al_status, abort: None })
                }
            },
            Stage::OutputBytes(slave) => {
                job.output_bytes = reply.unwrap_or(0) as usize;
                job.ask(Stage::InputBytes(slave), Ask::Info(slave, SlaveInfoItem::InputBytes))
            }
            Stage::InputBytes(slave) => {
                self.network.place(slave, job.output_bytes, reply.unwrap_or(0) as usize);
                if slave < self.network.found {
                    let next = slave + 1;
                    job.ask(Stage::OutputBytes(next), Ask::Info(next, SlaveInfoItem::OutputBytes))
                } else {
                    self.laid_out(job)
                }
            }
            Stage::RxEntries => job.ask(Stage::TxEntries, Ask::TxEntries(self.entries())),
            Stage::TxEntries => job.ask(Stage::BuildFifos, Ask::BuildFifos),
            Stage::BuildFifos => self.fifos_built(job),
            Stage::Resize => self.configured(job),
            Stage::StopFifo => job.ask(Stage::EmptyFifos, Ask::Clear(Fifos::Both)),
            Stage::EmptyFifos => {
                job.stage = Stage::Hold;
                Todo::Hold
            }
            Stage::Hold => self.enter(job, AlState::Op),
            Stage::Enter(to, slave) => self.entered(job, to, slave, reply),
            Stage::EnterAll(to) => self.all_entered(job, to, reply),
            Stage::Retry => self.read_states(job),
            Stage::BringBack(slave) => self.brought_back(job, slave, reply, now),
            Stage::AlStatus(slave) => match reply {
                Ok(al_status) if al_status != 0 => {
                    job.failed(Refusal { slave, al_status: al_status as u16, abort: None })
                }
                _ => {
                    job.stage = Stage::Retry;
                    Todo::Wait(now.saturating_add(RETRY_NS))
                }
            },
            Stage::EmptyTxFifo => job.ask(Stage::FifoOn, Ask::Fifo { on: true }),
            Stage::FifoOn => {
                self.enter_op();
                self.read_states(job)
            }
        }
    }

    fn begin(&mut self, job: &mut Running, now: Ns) -> Todo {
        let known = self.network.initialised && self.network.cycle == self.wanted_cycle(job);
        match job.kind {
            // A chip that has lost its network is not started before somebody asks for it.
            Kind::Configure(_) if job.is_ahead && !self.network.initialised => self.configured(job),
            Kind::State { target, .. } if known && self.runs && target < AlState::Op => self.send_first(job, now),
            Kind::Configure(_) if known && job.is_ahead => self.map_from(job, 1),
            Kind::Configure(_) | Kind::State { .. } if known => self.read_states(job),
            _ => {
                self.leave_op();
                job.ask(Stage::FifoOff, Ask::Fifo { on: false })
            }
        }
    }

    /// The cycle of the network: that of the configuration, or the present one.
    fn wanted_cycle(&self, job: &Running) -> CycleTime {
        match &job.kind {
            Kind::Configure(config) => config.cycle,
            Kind::Scan => CycleTime::DEFAULT,
            Kind::State { .. } => self.network.cycle,
        }
    }

    fn counted(&mut self, job: &mut Running, reply: Reply) -> Todo {
        let found = reply.unwrap_or(0).min(MAX_SLAVES as u32) as u8;
        let before = self.network.found;
        let cycle = self.wanted_cycle(job);
        self.network.start(found, cycle);
        match job.kind {
            Kind::Scan => self.ask_dc(job, 1),
            // Slaves that a scan did not find, or that are gone now.
            // What the chip has not found it cannot reach: the next job starts the network anew.
            _ if found < before => {
                self.network.found = before;
                self.network.stop();
                job.failed(no_answer(found + 1))
            }
            _ => {
                self.network.found = before;
                job.ask(Stage::AllToPreOp, Ask::Enter(None, AlState::PreOp))
            }
        }
    }

    fn ask_dc(&mut self, job: &mut Running, slave: u8) -> Todo {
        if slave > self.network.found {
            return Todo::Done(JobDone::Scan { found: self.network.found });
        }
        job.ask(Stage::HasDc(slave), Ask::Info(slave, SlaveInfoItem::HasDc))
    }

    fn read_states(&mut self, job: &mut Running) -> Todo {
        self.begin_reading();
        job.ask(Stage::UpdateStates, Ask::UpdateStates)
    }

    fn ask_state(&mut self, job: &mut Running, slave: u8, now: Ns) -> Todo {
        if slave <= self.network.found {
            return job.ask(Stage::StateOf(slave), Ask::StateOf(slave));
        }
        if self.network.found > 0 && (1..=self.network.found).all(|slave| job.state(slave).is_none()) {
            // A reset of the chip goes unnoticed where the driver sets its check word anew, as behind another packet size.
            return job.ask(Stage::CountAgain, Ask::Count);
        }
        self.states_are_read(job, now)
    }

    fn states_are_read(&mut self, job: &mut Running, now: Ns) -> Todo {
        self.note_read(job);
        let cycle_ns = self.network.cycle.ns();
        let is_told = self.network.lost.difference(self.told_lost).is_empty();
        if self.runs && !is_told && job.tells_until.is_none_or(|until| now < until) {
            job.tells_until.get_or_insert(now.saturating_add(TOLD_LATE * cycle_ns));
            job.stage = Stage::TellLoss;
            return Todo::Wait(now.saturating_add(cycle_ns));
        }
        match job.kind {
            Kind::Configure(_) => self.check_before_leaving(job, now),
            _ => self.move_on(job, now),
        }
    }
}

impl<W: Wires> XfBus<W> {
    /// Slaves may have left their states by themselves, those that the job is about to move, too.
    fn note_read(&mut self, job: &Running) {
        for slave in 1..=self.network.found {
            self.note_state(slave, job.state(slave));
        }
        self.end_reading();
    }
}

/// The state that a STATE_GET tells; `None`: the slave does not answer.
pub(super) fn state_of(reply: Reply) -> Option<AlState> {
    match NetworkState(reply.unwrap_or(0) as u8).state()? {
        EtherCatState::Init => Some(AlState::Init),
        EtherCatState::PreOp => Some(AlState::PreOp),
        EtherCatState::SafeOp => Some(AlState::SafeOp),
        EtherCatState::Op => Some(AlState::Op),
        EtherCatState::Boot => None,
    }
}
