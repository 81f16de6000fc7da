//! Slave controllers, and a master that reaches them by frames, so that all effects on slaves come over the wire.

use std::collections::VecDeque;

use super::wire::ChainWire;
use super::{
    EepromFailure, EnterError, Entered, Operation, OperationAnswer, ProcessExchange, SdoData, SlaveIdentity,
    SlaveNetwork, SlaveSetup,
};
use crate::ethercat::coe::Emergency;
use crate::ethercat::registers::{AlStatusRegister, Features, SmActivate, SyncManager, sync_manager};
use crate::ethercat::{AlState, AlStatus, Command, Ns, SlaveSet};
use crate::master::{
    Ending, Event, FileError, Job, JobId, Master, ReferenceClock, SdoError, Settings, SiiError, SlaveInfo, StateError,
    SyncSignals,
};
use crate::slave::Slave;
use crate::slave::esc::{CabledChain, Chain, UndescribedError};
use crate::slave::handle::SimHandle;

/// The interval at which the chip polls its master while an operation is running. `[OURS]`
const WORK_NS: Ns = 50_000;
/// Timeout of a slave's change of state. `[OURS]`
const STATE_MAX_NS: Ns = 10_000_000_000;

/// After the host's last RAW_ECAT_FUNC_REQ that accesses the mailbox of a slave, the chip leaves the messages in that
/// mailbox for this time. So the host can read the answer to its own request. `[OURS]`
const HOST_MAIL_NS: Ns = 1_000_000_000;

/// A running operation, which consists of jobs of the master.
struct Pending {
    jobs: Vec<JobId>,
    /// Makes the answer once all jobs have ended; returns `None` before.
    answer: Answering,
}

type Answering = Box<dyn FnMut(&mut Master) -> Option<OperationAnswer> + Send>;

impl Pending {
    /// An operation that consists of these jobs of the master. When all have ended, `answer` makes the answer from the result
    /// of the last one and from the state of the master.
    fn new<T: Ending + 'static>(
        mut left: Vec<Job<T>>,
        answer: impl Fn(&Master, T) -> OperationAnswer + Send + 'static,
    ) -> Self {
        let jobs = left.iter().map(|job| job.id()).collect();
        let ended = move |master: &mut Master| {
            let mut last = None;
            left.retain(|job| {
                let end = master.take(*job);
                let is_left = end.is_none();
                last = end.or(last.take());
                is_left
            });
            last.filter(|_| left.is_empty()).map(|end| answer(master, end))
        };
        Self { jobs, answer: Box::new(ended) }
    }
}

/// Slaves with slave controllers, connected in a line, and the master of the network. At most 40 slaves, the master's
/// limit.
pub struct Controllers {
    master: Master,
    wire: ChainWire,
    handle: SimHandle,
    identities: Vec<SlaveIdentity>,
    pending: Option<Pending>,
    /// The time at which the master is polled next for the running operation.
    next_work: Ns,
    answer: Option<OperationAnswer>,
    emergencies: VecDeque<(u8, Emergency)>,
    is_first_slave_reference: bool,
    mail: Mail,
}

/// The slaves whose messages stay in the mailbox for the host.
#[derive(Default)]
struct Mail {
    /// The slaves whose messages the host fetches itself, since it has selected their mailboxes for polling by MBX_STAT.
    chosen: SlaveSet,
    /// The slaves whose mailboxes the host itself accesses by RAW_ECAT_FUNC_REQ, each with the time from which on the
    /// chip reads the mailbox again, ns.
    by_datagrams: Vec<(u8, Ns)>,
}

impl Mail {
    fn keeps(&self, slave: u8) -> bool {
        self.chosen.contains(slave) || self.by_datagrams.iter().any(|(of, _)| *of == slave)
    }
}

impl Controllers {
    /// A network of these slaves, switched on at time 0, controlled by `handle`, which counts slaves from 1.
    ///
    /// # Errors
    /// [`UndescribedError`] if a slave does not provide the content of its EEPROM.
    pub fn new(slaves: Vec<Box<dyn Slave>>, handle: SimHandle) -> Result<Self, UndescribedError> {
        let slaves = CabledChain::new(slaves, handle.cable().clone())?;
        Ok(Self {
            master: Master::new(Settings::default()),
            wire: ChainWire::new(slaves),
            handle,
            identities: Vec::new(),
            pending: None,
            next_work: 0,
            answer: None,
            emergencies: VecDeque::new(),
            is_first_slave_reference: true,
            mail: Mail::default(),
        })
    }

    /// The handle with which scripts and tests control the network while it runs. It counts slaves from 1.
    pub fn handle(&self) -> SimHandle {
        self.handle.clone()
    }

    /// The chain of slave controllers with their slaves.
    pub const fn chain(&self) -> &Chain {
        self.wire.slaves.chain()
    }

    /// The chain of slave controllers with their slaves, to cause faults in it.
    pub const fn chain_mut(&mut self) -> &mut Chain {
        self.wire.slaves.chain_mut()
    }

    /// The device of a slave, to inspect it; `None` if there is no such slave.
    pub fn slave(&self, slave: u8) -> Option<&dyn Slave> {
        (usize::from(slave) < self.chain().len()).then(|| self.chain().slave(slave.into()).device())
    }

    /// The device of a slave, to cause a fault in it; `None` if there is no such slave.
    pub fn slave_mut(&mut self, slave: u8) -> Option<&mut dyn Slave> {
        let is_there = usize::from(slave) < self.chain().len();
        is_there.then(|| self.chain_mut().slave_mut(slave.into()).device_mut())
    }

    /// The master, to inspect it.
    pub const fn master(&self) -> &Master {
        &self.master
    }

    /// Continues the running operation as far as the received frames allow.
    fn poll_master(&mut self, now: Ns) {
        self.master.poll(now, &mut self.wire);
        while let Some(event) = self.master.take_event() {
            if let Event::Emergency { slave, emergency } = event {
                self.emergencies.push_back((slave - 1, emergency));
            }
        }
        let Some(answer) = self.pending.as_mut().and_then(|pending| (pending.answer)(&mut self.master)) else { return };
        self.pending = None;
        if matches!(answer, OperationAnswer::Scanned(_)) {
            self.identities = self.master.slaves().iter().map(identity).collect();
        }
        self.answer = Some(answer);
    }

    /// Starts the master's jobs for an operation; `None` if it needs no job, and its answer is there already.
    fn begin(&mut self, operation: Operation) -> Option<Pending> {
        let master = &mut self.master;
        Some(match operation {
            Operation::Scan => {
                Pending::new(vec![master.scan()], |_, found| OperationAnswer::Scanned(found.unwrap_or(0)))
            }
            Operation::ReadStates => Pending::new(vec![master.read_states()], |_, ()| OperationAnswer::StatesRead),
            Operation::Enter(slaves) => {
                let changes = request_states(master, &slaves);
                let answer = move |master: &Master, _| OperationAnswer::Entered(entered(master, &slaves));
                if changes.is_empty() {
                    self.answer = Some(OperationAnswer::Entered(Entered::empty((0, AlState::Init, Ok(())))));
                    return None;
                }
                Pending::new(changes, answer)
            }
            Operation::Read { slave, object, scope, room, timeout_ns } => {
                Pending::new(vec![master.upload(slave + 1, object, scope, timeout_ns)], move |_, value| {
                    let first = |value: Vec<u8>| (SdoData::of(0, &value[..value.len().min(room)]), value.len());
                    OperationAnswer::Value(value.map(first).map_err(SdoError::abort_code))
                })
            }
            Operation::Write { slave, object, scope, value, timeout_ns } => {
                let written = master.download(slave + 1, object, scope, &value, timeout_ns);
                Pending::new(vec![written], |_, written| {
                    OperationAnswer::Written(written.map_err(SdoError::abort_code))
                })
            }
            Operation::Datagram { command, address, data } => {
                let answer = master.datagram(command, address, &data);
                self.note_host_mail(command, address);
                Pending::new(vec![answer], |_, answer| {
                    OperationAnswer::Datagram(answer.ok().map(|answer| (answer.data, answer.working_counter)))
                })
            }
            Operation::ReadEeprom { slave, word, count } => {
                let read = master.read_eeprom(slave + 1, word, count);
                Pending::new(vec![read], |_, words| OperationAnswer::Eeprom(words.map_err(eeprom_failure)))
            }
            Operation::WriteEeprom { slave, word, value } => {
                let written = master.write_eeprom(slave + 1, word, &[value]);
                Pending::new(vec![written], |_, written| {
                    OperationAnswer::Eeprom(written.map(|()| Vec::new()).map_err(eeprom_failure))
                })
            }
            Operation::SetManager { slave, number, registers } => {
                if master.set_manager(slave + 1, number, registers).is_err() {
                    self.answer = Some(OperationAnswer::ManagerSet(false));
                    return None;
                }
                // The controller accepts start and length only while the sync manager is off, so it is switched off first.
                let mut off = registers;
                off.activate = SmActivate::NONE;
                let mut write = |registers: SyncManager| {
                    master.write_registers(slave + 1, sync_manager(number), &registers.encode())
                };
                Pending::new(vec![write(off), write(registers)], |_, written| {
                    OperationAnswer::ManagerSet(written.is_ok())
                })
            }
            Operation::ReadFile { slave, name, password, timeout_ns } => {
                let read = master.read_file(slave + 1, &name, password, timeout_ns);
                Pending::new(vec![read], |_, content| OperationAnswer::File(content.map_err(file_error)))
            }
            Operation::WriteFile { slave, name, password, content, timeout_ns } => {
                let written = master.write_file(slave + 1, &name, password, &content, timeout_ns);
                Pending::new(vec![written], |_, written| {
                    OperationAnswer::File(written.map(|()| Vec::new()).map_err(file_error))
                })
            }
            Operation::ReceiveMail { slave } => {
                Pending::new(vec![master.receive_mail(slave + 1)], |_, mail| OperationAnswer::Mail(mail.ok().flatten()))
            }
        })
    }

    /// Notes a datagram of the host. If it accesses the mailbox of a slave, the chip leaves messages in that mailbox for the
    /// host, for [`HOST_MAIL_NS`].
    fn note_host_mail(&mut self, command: Command, address: u32) {
        if !matches!(command, Command::Fprd | Command::Fpwr) {
            return;
        }
        let [station, place] = [address as u16, (address >> 16) as u16];
        let has_it = |info: &SlaveInfo| {
            let areas = info.mailbox.map(|mailbox| mailbox.areas).filter(|_| info.station == station);
            areas.is_some_and(|areas| [areas.receive.start, areas.send.start].contains(&place))
        };
        let Some((slave, _)) = (1..).zip(self.master.slaves()).find(|(_, info)| has_it(info)) else { return };
        let until = self.wire.now.saturating_add(HOST_MAIL_NS);
        match self.mail.by_datagrams.iter_mut().find(|(of, _)| *of == slave) {
            Some((_, ends)) => *ends = until,
            None => self.mail.by_datagrams.push((slave, until)),
        }
        self.master.keep_mail(slave, true);
    }

    /// Ends the host's access to mailboxes whose time has passed, so that the chip reads them again.
    fn end_host_mail(&mut self) {
        let now = self.wire.now;
        while let Some(n) = self.mail.by_datagrams.iter().position(|(_, until)| now >= *until) {
            let (slave, _) = self.mail.by_datagrams.swap_remove(n);
            self.master.keep_mail(slave, self.mail.keeps(slave));
        }
    }

    fn info(&self, slave: u8) -> Option<&SlaveInfo> {
        self.master.slaves().get(usize::from(slave))
    }

    fn publish_shafts(&self) {
        let chain = self.chain();
        let shafts = (0..chain.len()).map(|n| chain.slave(n).device().shafts());
        self.handle.publish(self.wire.now, shafts);
    }
}

fn identity(info: &SlaveInfo) -> SlaveIdentity {
    SlaveIdentity {
        vendor: info.identity.vendor,
        product: info.identity.product,
        revision: info.identity.revision,
        name: info.name.clone(),
        alias: info.alias,
    }
}

/// Requests the states that slaves have to enter, with one job for all slaves with the same target.
fn request_states(master: &mut Master, slaves: &[(u8, AlState)]) -> Vec<Job<Result<(), StateError>>> {
    let groups = [AlState::Init, AlState::PreOp, AlState::SafeOp, AlState::Op].map(|target| {
        let chosen = slaves.iter().filter(|(_, state)| *state == target).map(|(slave, _)| slave + 1);
        (target, chosen.collect::<SlaveSet>())
    });
    let groups = groups.into_iter().filter(|(_, slaves)| !slaves.is_empty());
    groups.map(|(target, slaves)| master.request_state(slaves, target, STATE_MAX_NS)).collect()
}

/// The result for each slave that had to enter a state, from the AL status that the master has read.
fn entered(master: &Master, slaves: &[(u8, AlState)]) -> Entered {
    let mut entered = Entered::empty((0, AlState::Init, Ok(())));
    slaves.iter().for_each(|(slave, state)| entered.push((*slave, *state, has_entered(master, *slave, *state))));
    entered
}

fn has_entered(master: &Master, slave: u8, state: AlState) -> Result<(), EnterError> {
    let status = master.status(slave + 1).filter(|status| status.is_present).ok_or(EnterError::NoAnswer)?;
    let is_there = status.state() == Some(state) && !status.status.contains(AlStatusRegister::ERROR);
    if is_there { Ok(()) } else { Err(EnterError::CommandRefused(status.code)) }
}

const fn eeprom_failure(error: SiiError) -> EepromFailure {
    match error {
        SiiError::NoAnswer | SiiError::NoSlave(_) => EepromFailure::NoAnswer,
        SiiError::Busy | SiiError::InUse(_) => EepromFailure::Busy,
        SiiError::Command(_)
        | SiiError::Empty(_)
        | SiiError::Checksum { .. }
        | SiiError::NoEnd { .. }
        | SiiError::TooLong => EepromFailure::CommandRefused,
    }
}

const fn file_error(error: FileError) -> u32 {
    match error {
        FileError::File(code) => code.0,
        FileError::Mailbox(error) => SdoError::Mailbox(error).abort_code().0,
    }
}

impl SlaveNetwork for Controllers {
    fn takes_time(&self) -> bool {
        true
    }

    fn knows_registers(&self) -> bool {
        true
    }

    /// With sync manager 2 enabled, a slave controller adds to the working counter for outputs from SafeOP on.
    fn outputs_count_from(&self) -> AlState {
        AlState::SafeOp
    }

    fn has_link(&self) -> bool {
        !self.chain().is_empty() && self.handle.reach() > 0
    }

    fn identity(&self, slave: u8) -> Option<&SlaveIdentity> {
        self.identities.get(usize::from(slave))
    }

    fn has_dc(&self, slave: u8) -> bool {
        self.info(slave).is_some_and(|info| info.features.contains(Features::CLOCK))
    }

    fn state(&self, slave: u8) -> Option<AlState> {
        self.master.status(slave.checked_add(1)?).filter(|status| status.is_present)?.state()
    }

    fn al_status(&self, slave: u8) -> Option<AlStatus> {
        Some(self.master.status(slave.checked_add(1)?)?.code)
    }

    fn set_up(&mut self, slave: u8, setup: &SlaveSetup) -> bool {
        let sync = setup.sync.map(|sync| SyncSignals {
            assign_activate: sync.assign_activate,
            cycle_ns: sync.sync0_ns,
            shift_ns: sync.shift_ns,
            sync1_ns: sync.sync1_ns,
        });
        self.master.set_sync(slave + 1, sync).is_ok()
            && self.master.configure(slave + 1, setup.output_bytes, setup.input_bytes).is_ok()
    }

    fn set_reference(&mut self, is_first_slave: bool) {
        self.is_first_slave_reference = is_first_slave;
        let reference = if is_first_slave { ReferenceClock::FirstSlave } else { ReferenceClock::Master };
        self.master.set_reference(reference);
    }

    fn start(&mut self, operation: Operation) -> Option<OperationAnswer> {
        self.give_up();
        (self.pending, self.next_work) = (self.begin(operation), self.wire.now);
        self.answer.take()
    }

    fn poll(&mut self) -> Option<OperationAnswer> {
        self.answer.take()
    }

    fn give_up(&mut self) {
        self.answer = None;
        if let Some(pending) = self.pending.take() {
            pending.jobs.into_iter().for_each(|job| self.master.cancel(job));
        }
    }

    fn next_work(&self) -> Option<Ns> {
        self.pending.as_ref().map(|_| self.next_work)
    }

    fn work(&mut self, now: Ns) {
        self.next_work = now + WORK_NS;
        self.wire.advance(now);
        self.poll_master(now);
    }

    fn exchange(&mut self, ProcessExchange { places, outputs, inputs, lrw }: ProcessExchange<'_>) -> u16 {
        self.master.set_lrw(lrw);
        for (slave, place) in (1..).zip(places) {
            if let Some(image) = self.master.outputs_mut(slave).filter(|image| image.len() == place.outputs().len()) {
                image.copy_from_slice(&outputs[place.outputs()]);
            }
        }
        let now = self.wire.now;
        self.master.cycle(now, &mut self.wire);
        self.poll_master(now);
        for (slave, place) in (1..).zip(places).filter(|(_, place)| place.commanded >= AlState::SafeOp) {
            if let Some(image) = self.master.inputs(slave).filter(|image| image.len() == place.inputs().len()) {
                inputs[place.inputs()].copy_from_slice(image);
            }
        }
        self.master.take_cycle().map_or(0, |cycle| cycle.working_counter.saturating_add(cycle.written))
    }

    fn pass(&mut self, now: Ns, _dt_ns: Ns) {
        self.wire.advance(now);
        self.end_host_mail();
        self.poll_master(now);
        self.publish_shafts();
    }

    fn take_emergency(&mut self) -> Option<(u8, Emergency)> {
        self.emergencies.pop_front()
    }

    fn keep_mail(&mut self, slave: u8, keeps: bool) {
        let slave = slave + 1;
        if keeps {
            self.mail.chosen.insert(slave);
        } else {
            self.mail.chosen.remove(slave);
        }
        self.master.keep_mail(slave, self.mail.keeps(slave));
    }

    fn has_mail(&self, slave: u8) -> bool {
        self.master.has_mail(slave + 1)
    }

    fn reset(&mut self) {
        (self.pending, self.answer) = (None, None);
        self.master = Master::new(Settings::default());
        self.identities.clear();
        self.emergencies.clear();
        self.mail = Mail::default();
        self.set_reference(true);
    }
}
