//! The jobs of the bus as sequences of commands of the chip.
//!
//! [`XfBus::go_on`] is called when a job begins, when the answer to its command is there and when its wait is over; it
//! says what comes next. A change of state reads the states of the slaves again and again and moves those that are behind
//! by one state, until all are there.

use super::XfBus;
use super::ask::{Ask, Reply};
use super::network::Place;
use crate::coe::{AbortCode, ObjectAddress};
use crate::ethercat::{AlState, AlStatus, MAX_SLAVES, Ns, SlaveSet};
use crate::fieldbus::pdo::{self, Download, ProcessData};
use crate::fieldbus::{BusConfig, Configured, Job, JobDone, Refusal, Role, SdoRequest};
use crate::sk::CycleTime;
use crate::xf::host::{Budget, HostError, Wires};
use crate::xf::request::{Fifos, SlaveInfoItem};
use crate::xf::{DataSize, EtherCatState, NetworkState};

/// How long a slave may take for an SDO of a configuration. \[OURS]
const SDO_NS: Ns = 1_000_000_000;
/// Between two attempts to bring slaves to a state. \[OURS]
const RETRY_NS: Ns = 10_000_000;
/// The most entries of each FIFO that are asked for; fewer if the chip's memory does not hold them. \[OURS]
const ENTRIES: usize = 64;
/// The memory of both FIFOs, bytes (XF EN 1236).
const FIFO_MEMORY: usize = 0x4000;

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
    second_axes: SlaveSet,
    /// The process data that are being mapped.
    mapping: Option<ProcessData>,
    /// The lengths of a slave's outputs as the chip has them.
    output_bytes: usize,
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
    FifoOff,
    ClearFifos,
    Init,
    Count,
    HasDc(u8),
    AllToPreOp,
    UpdateStates,
    StateOf(u8),
    /// The other slaves leave OP or SafeOP, from this one on.
    Leave(u8),
    SecondAxis(u8),
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
    AlStatus(u8),
    EmptyTxFifo,
    FifoOn,
}

/// What a job needs next.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant, reason = "it is made and used at once")]
pub(super) enum Todo {
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
            second_axes: SlaveSet::EMPTY,
            mapping: None,
            output_bytes: 0,
        })
    }

    fn ask(&mut self, stage: Stage, ask: Ask) -> Todo {
        self.stage = stage;
        Todo::Ask(ask)
    }

    fn failed(&self, refusal: Refusal) -> Todo {
        Todo::Done(match self.kind {
            Kind::Scan => JobDone::Scan { found: 0 },
            Kind::Configure(_) => JobDone::Configure(Err(refusal)),
            Kind::State { .. } => JobDone::State(Err(refusal)),
        })
    }

    fn state(&self, slave: u8) -> Option<AlState> {
        self.states[usize::from(slave) - 1]
    }

    /// The end of a change of state that was not done in time.
    pub(super) fn late(&self) -> Option<JobDone> {
        let Kind::State { target, slaves } = self.kind else { return None };
        let slave = slaves.iter().find(|slave| self.state(*slave) != Some(target)).or(slaves.iter().next());
        Some(JobDone::State(Err(no_answer(slave.unwrap_or(1)))))
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
    pub(super) fn go_on(&mut self, job: &mut Running, reply: Reply, now: Ns) -> Todo {
        match job.stage {
            Stage::Begin => self.begin(job),
            Stage::FifoOff => job.ask(Stage::ClearFifos, Ask::Clear(Fifos::Both)),
            Stage::ClearFifos => job.ask(Stage::Init, Ask::Init { sync0_ns: self.wanted_cycle(job).ns() as u32 }),
            Stage::Init => match reply {
                Ok(_) => job.ask(Stage::Count, Ask::Count),
                Err(_) => {
                    self.network.forget();
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
            Stage::UpdateStates => self.ask_state(job, 1),
            Stage::StateOf(slave) => {
                job.states[usize::from(slave) - 1] = state_of(reply);
                self.ask_state(job, slave + 1)
            }
            Stage::Leave(slave) => {
                if reply.is_ok() {
                    self.network.commanded[usize::from(slave) - 1] = AlState::PreOp;
                }
                self.leave(job, slave + 1)
            }
            Stage::SecondAxis(slave) => self.map(job, slave, reply.is_ok()),
            Stage::Download(slave, place) => self.downloaded(job, slave, place, reply),
            Stage::Reconfig => match reply {
                Ok(_) => job.ask(Stage::OutputBytes(1), Ask::Info(1, SlaveInfoItem::OutputBytes)),
                Err(_) => {
                    let AlStatus(al_status) = AlStatus::INVALID_OUTPUTS;
                    let slave = self.first_selected(job);
                    job.failed(Refusal { slave, al_status, abort: None })
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
            Stage::BuildFifos => self.choose_size(job),
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

    fn begin(&mut self, job: &mut Running) -> Todo {
        let known = self.network.initialised && self.network.cycle == self.wanted_cycle(job);
        match job.kind {
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
            _ if found < before => {
                self.network.found = before;
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

    fn read_states(&self, job: &mut Running) -> Todo {
        job.ask(Stage::UpdateStates, Ask::UpdateStates)
    }

    fn ask_state(&mut self, job: &mut Running, slave: u8) -> Todo {
        if slave <= self.network.found {
            return job.ask(Stage::StateOf(slave), Ask::StateOf(slave));
        }
        match job.kind {
            Kind::Configure(_) => self.check_before_leaving(job),
            _ => self.move_on(job),
        }
    }

    /// Process data are laid out with all slaves in PreOP. One that does not answer would make that fail when the others
    /// have left OP for it already.
    fn check_before_leaving(&mut self, job: &mut Running) -> Todo {
        let Kind::Configure(config) = &job.kind else { return self.configured(job) };
        job.keeps_layout = self.keeps_layout(config);
        for slave in 1..=self.network.found {
            let selected = config.selected.contains(slave);
            match job.state(slave) {
                Some(AlState::PreOp) => {}
                Some(AlState::SafeOp | AlState::Op) if !selected => {}
                Some(_) if selected => {
                    let AlStatus(al_status) = AlStatus::INVALID_CHANGE;
                    return job.failed(Refusal { slave, al_status, abort: None });
                }
                _ if !selected && job.keeps_layout => {}
                _ => return job.failed(no_answer(slave)),
            }
        }
        if job.keeps_layout { self.map_from(job, 1) } else { self.leave(job, 1) }
    }

    /// Whether the selected slaves fit into the layout that the chip has, so that the others may stay in SafeOP and OP.
    ///
    /// \[OURS] The chip then configures a slave for that layout when it goes to SafeOP. If it does not, the slave
    /// refuses SafeOP, or the working counter is wrong.
    fn keeps_layout(&self, config: &BusConfig) -> bool {
        let network = &self.network;
        let others = network.at_least(AlState::SafeOp).difference(config.selected);
        let fits = |slave: u8| {
            let n = usize::from(slave) - 1;
            let Place { output_bytes, input_bytes, .. } = network.places[n];
            let role = config.slaves[n].role;
            let mut mapped = [false, true].into_iter().filter_map(|second| ProcessData::of(role, second));
            role == Role::Unused
                || mapped.any(|data| (data.output_bytes(), data.input_bytes()) == (output_bytes, input_bytes))
        };
        let found = SlaveSet::first(network.found);
        network.mapped && !others.is_empty() && config.selected.intersection(found).iter().all(fits)
    }

    fn leave(&mut self, job: &mut Running, from: u8) -> Todo {
        let above = |slave: &u8| self.network.commanded[usize::from(*slave) - 1] > AlState::PreOp;
        match (from..=self.network.found).find(above) {
            Some(slave) => {
                if self.network.in_op().contains(slave) {
                    job.disturbed.insert(slave);
                }
                job.ask(Stage::Leave(slave), Ask::Enter(Some(slave), AlState::PreOp))
            }
            None => self.map_from(job, 1),
        }
    }

    fn map_from(&mut self, job: &mut Running, from: u8) -> Todo {
        let Kind::Configure(config) = &job.kind else { return self.configured(job) };
        let found = self.network.found;
        let Some(slave) = (from..=found).find(|slave| config.selected.contains(*slave)) else {
            return if job.keeps_layout { self.check_layout(job) } else { job.ask(Stage::Reconfig, Ask::Reconfig) };
        };
        let role = config.slaves[usize::from(slave) - 1].role;
        self.network.process_data[usize::from(slave) - 1] = None;
        match role {
            Role::Unused => self.map_from(job, slave + 1),
            Role::Hsp(_) => {
                let object: ObjectAddress = pdo::SECOND_CONTROLWORD;
                job.ask(Stage::SecondAxis(slave), Ask::Upload { slave, object, timeout_ns: SDO_NS })
            }
            _ => self.map(job, slave, false),
        }
    }

    fn map(&mut self, job: &mut Running, slave: u8, has_second_axis: bool) -> Todo {
        let Kind::Configure(config) = &job.kind else { return self.configured(job) };
        let role = config.slaves[usize::from(slave) - 1].role;
        let Some(data) = ProcessData::of(role, has_second_axis) else {
            return job.failed(Refusal { slave, ..pdo::NO_SUCH_MODE });
        };
        if data.axes() > 1 {
            job.second_axes.insert(slave);
        }
        job.mapping = Some(data);
        self.download(job, slave, 0)
    }

    fn download_at(&self, job: &Running, slave: u8, place: usize) -> Option<Download> {
        let Kind::Configure(config) = &job.kind else { return None };
        let sync = config.slaves[usize::from(slave) - 1].sync;
        job.mapping?.downloads(sync).into_iter().nth(place)
    }

    fn download(&mut self, job: &mut Running, slave: u8, place: usize) -> Todo {
        match self.download_at(job, slave, place) {
            Some(Download { object, size, value, .. }) => {
                let ask = Ask::Download { slave, object, size, value, timeout_ns: SDO_NS };
                job.ask(Stage::Download(slave, place), ask)
            }
            None => {
                self.network.process_data[usize::from(slave) - 1] = job.mapping.take();
                self.map_from(job, slave + 1)
            }
        }
    }

    fn downloaded(&mut self, job: &mut Running, slave: u8, place: usize, reply: Reply) -> Todo {
        if let Err(error) = reply
            && let Some(download) = self.download_at(job, slave, place)
        {
            let code = abort_code(&error);
            if !matches!(error, HostError::Failed { .. }) || code == AbortCode::TIMEOUT {
                return job.failed(no_answer(slave));
            }
            if !download.may_fail_with(code) {
                return job.failed(Refusal { slave, ..download.refused(code) });
            }
        }
        self.download(job, slave, place + 1)
    }

    fn first_selected(&self, job: &Running) -> u8 {
        let Kind::Configure(config) = &job.kind else { return 1 };
        config.selected.iter().next().unwrap_or(1)
    }

    /// The entries of each FIFO with the present process data.
    fn entries(&self) -> u8 {
        let bytes = (self.network.rx_bytes + self.network.tx_bytes).max(1);
        (FIFO_MEMORY / bytes).clamp(1, ENTRIES) as u8
    }

    fn laid_out(&mut self, job: &mut Running) -> Todo {
        match self.check_layout(job) {
            Todo::Done(JobDone::Configure(Ok(_))) => job.ask(Stage::RxEntries, Ask::RxEntries(self.entries())),
            refused => refused,
        }
    }

    /// The configuration has ended, if the chip's layout has the lengths that were mapped.
    fn check_layout(&mut self, job: &mut Running) -> Todo {
        for slave in 1..=self.network.found {
            let place = self.network.places[usize::from(slave) - 1];
            let Some(data) = &self.network.process_data[usize::from(slave) - 1] else { continue };
            if (place.output_bytes, place.input_bytes) != (data.output_bytes(), data.input_bytes()) {
                let AlStatus(al_status) = AlStatus::INVALID_OUTPUTS;
                return job.failed(Refusal { slave, al_status, abort: None });
            }
        }
        self.configured(job)
    }

    /// The packets hold the process data, or the chip is set to an n that does.
    fn choose_size(&mut self, job: &mut Running) -> Todo {
        self.network.entries = self.entries();
        let bytes = self.network.rx_bytes.max(self.network.tx_bytes);
        let size = self.host.size();
        if bytes <= size.bytes() {
            return self.configured(job);
        }
        let config = self.host.config();
        let budget = Budget {
            process_bytes: bytes,
            clock_hz: self.options.clock_hz.unwrap_or(u32::MAX),
            idle_ns: config.idle_ns,
            cycle_ns: self.network.cycle.ns(),
            exchanges: 1,
        };
        match budget.choose_size() {
            Ok(size) => {
                job.stage = Stage::Resize;
                Todo::Resize(size)
            }
            Err(error) => {
                self.refused_cycle = Some(error);
                let slave = self.first_selected(job);
                let AlStatus(al_status) = AlStatus::INVALID_OUTPUTS;
                job.failed(Refusal { slave, al_status, abort: None })
            }
        }
    }

    fn configured(&mut self, job: &mut Running) -> Todo {
        self.network.mapped = true;
        let Running { second_axes, disturbed, .. } = *job;
        Todo::Done(JobDone::Configure(Ok(Configured { second_axes, disturbed })))
    }

    /// The next step of a change of state, when the states are known.
    fn move_on(&mut self, job: &mut Running) -> Todo {
        let Kind::State { target, slaves } = job.kind else { return self.configured(job) };
        let found = SlaveSet::first(self.network.found);
        let slaves = slaves.intersection(found);
        (1..=self.network.found).for_each(|slave| self.stay_up(job, slave));
        for slave in slaves.iter().filter(|slave| job.state(*slave) == Some(target)) {
            self.network.commanded[usize::from(slave) - 1] = target;
            self.network.lost.remove(slave);
            self.network.lost_from[usize::from(slave) - 1] = None;
        }
        if self.network.in_op().is_empty() {
            self.leave_op();
        } else if !self.runs {
            return job.ask(Stage::EmptyTxFifo, Ask::Clear(Fifos::Tx));
        }
        let behind = slaves.iter().filter(|slave| job.state(*slave) != Some(target));
        let Some(lowest) = behind.filter_map(|slave| job.state(slave)).min() else {
            return match slaves.iter().find(|slave| job.state(*slave).is_none()) {
                Some(slave) => {
                    // It may come back until the deadline.
                    self.note_states(job);
                    job.ask(Stage::AlStatus(slave), Ask::Info(slave, SlaveInfoItem::AlStatus))
                }
                None => Todo::Done(JobDone::State(Ok(()))),
            };
        };
        let to = if lowest > target { target } else { above(lowest).min(target) };
        if to == AlState::Op && self.network.in_op().is_empty() {
            self.leave_op();
            return job.ask(Stage::StopFifo, Ask::Fifo { on: false });
        }
        self.enter(job, to)
    }

    /// The slaves that are behind go to a state. The chip moves one slave or all of them, and all together take no longer
    /// than one.
    fn enter(&mut self, job: &mut Running, to: AlState) -> Todo {
        let found = SlaveSet::first(self.network.found);
        let behind = self.behind(job, to);
        let stays = |slave: &u8| job.state(*slave).is_none_or(|state| state == to);
        if behind.len() < 2 || job.all_tried == Some(to) || !found.difference(behind).iter().all(|slave| stays(&slave))
        {
            return self.enter_from(job, to, 1);
        }
        job.all_tried = Some(to);
        self.note_commanded(behind, to, AlState::SafeOp);
        job.ask(Stage::EnterAll(to), Ask::Enter(None, to))
    }

    /// The slaves of a change of state that are not where they are to be, and go to this state now.
    fn behind(&self, job: &Running, to: AlState) -> SlaveSet {
        let Kind::State { target, slaves } = job.kind else { return SlaveSet::EMPTY };
        let mut behind = slaves.intersection(SlaveSet::first(self.network.found));
        let stays = |slave: &u8| job.state(*slave).is_none_or(|state| (to..=target.max(to)).contains(&state));
        behind.iter().filter(stays).for_each(|slave| behind.remove(slave));
        behind
    }

    /// Slaves are about to enter a state, if it is one up to `most`: a slave that leaves OP is no lost one.
    fn note_commanded(&mut self, slaves: SlaveSet, to: AlState, most: AlState) {
        if to <= most {
            slaves.iter().for_each(|slave| self.network.commanded[usize::from(slave) - 1] = to);
        }
    }

    fn enter_from(&mut self, job: &mut Running, to: AlState, from: u8) -> Todo {
        let behind = self.behind(job, to);
        match behind.iter().find(|slave| *slave >= from) {
            Some(slave) => {
                let mut one = SlaveSet::EMPTY;
                one.insert(slave);
                self.note_commanded(one, to, AlState::SafeOp);
                job.ask(Stage::Enter(to, slave), Ask::Enter(Some(slave), to))
            }
            None => self.read_states(job),
        }
    }

    fn entered(&mut self, job: &mut Running, to: AlState, slave: u8, reply: Reply) -> Todo {
        match reply {
            Ok(_) => {
                self.network.commanded[usize::from(slave) - 1] = to;
                self.enter_from(job, to, slave + 1)
            }
            Err(HostError::Failed { .. }) => {
                self.stay_up(job, slave);
                job.ask(Stage::AlStatus(slave), Ask::Info(slave, SlaveInfoItem::AlStatus))
            }
            Err(_) => job.failed(no_answer(slave)),
        }
    }

    /// If that has failed, the states tell who has moved all the same; the others are asked one by one.
    fn all_entered(&mut self, job: &mut Running, to: AlState, reply: Reply) -> Todo {
        if reply.is_ok() {
            self.note_commanded(SlaveSet::first(self.network.found), to, AlState::Op);
        }
        self.read_states(job)
    }

    /// A slave that has refused the way down is where it was.
    fn stay_up(&mut self, job: &Running, slave: u8) {
        let commanded = &mut self.network.commanded[usize::from(slave) - 1];
        *commanded = job.state(slave).map_or(*commanded, |state| state.max(*commanded));
    }

    fn note_states(&mut self, job: &Running) {
        let states = job.states;
        for slave in 1..=self.network.found {
            self.note_state(slave, states[usize::from(slave) - 1]);
        }
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

/// The next higher AL state.
const fn above(state: AlState) -> AlState {
    match state {
        AlState::Init => AlState::PreOp,
        AlState::PreOp => AlState::SafeOp,
        AlState::SafeOp | AlState::Op => AlState::Op,
    }
}
