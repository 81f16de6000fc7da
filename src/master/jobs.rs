//! Jobs: operations of more than one datagram that a user starts, such as scans, changes of state and SDOs. The jobs of a
//! mailbox protocol are in the file of that protocol.

use std::future::Future;
use std::task::{Context, Poll};

use super::bus::{Bus, Task};
use super::handle::{End, Ending, Job, JobId};
use super::lost_slaves::{self, Watch};
use super::mailbox::coe::NumberTransfer;
use super::mailbox::{Mailbox, Peer};
use super::place::{Place, place};
use super::shared::Shared;
use super::sii::Eeprom;
use super::states::{Plan, StateChange};
use super::{
    DatagramAnswer, DatagramError, MailboxError, Master, ScanError, SiiError, SlaveInfo, StateError, clocks, registers,
    scan,
};
use crate::ethercat::coe::{ObjectAddress, SdoScope};
use crate::ethercat::{AlState, Command, Ns, SlaveSet};

/// \[OURS] How many changes of state, and how many SDO transfers of up to 4 bytes, can run at once without allocating.
const CHANGES: usize = 1;
const TRANSFERS: usize = 8;
/// \[OURS] How many jobs of all kinds there can be without allocating, including those whose result was not taken.
pub(super) const JOBS: usize = 32;

/// The result of a job's sequence.
pub(super) enum Output {
    Scan(Result<Vec<SlaveInfo>, ScanError>),
    Done(End),
}

/// A running job: its id, and the future that does its work.
pub(super) struct Running {
    pub(super) id: JobId,
    pub(super) work: Work,
}

/// A preallocated slot for SDO transfers of up to 4 bytes. Each transfer is begun with these arguments: upload or
/// download, slave, object, and scope.
type NumberPlace = Place<(NumberTransfer, Peer, ObjectAddress, SdoScope), End>;

/// The future of a running job, or the slot that holds it.
pub(super) enum Work {
    /// The future of a job, in a box that was allocated for this job.
    Once(Task<Output>),
    /// A change of state, in a slot that is reused.
    State(StateChange),
    Number(NumberPlace),
}

impl Work {
    pub(super) fn poll(&mut self, bus: &Bus, context: &mut Context<'_>) -> Poll<Output> {
        match self {
            Self::Once(task) => task.as_mut().poll(context),
            Self::State(change) => change.poll(bus, context).map(|ended| Output::Done(ended.into_end())),
            Self::Number(transfer) => transfer.poll(context).map(Output::Done),
        }
    }
}

/// The unused slots, which new jobs take.
#[derive(Default)]
pub(super) struct Places {
    changes: Vec<StateChange>,
    numbers: Vec<NumberPlace>,
}

impl Places {
    /// Slots for a network with that many slaves.
    fn new(bus: &Bus, slaves: usize) -> Self {
        let mut places = Self::default();
        places.changes.extend((0..CHANGES).map(|_| StateChange::new(bus, slaves)));
        places.numbers.extend((0..TRANSFERS).map(|_| number_place(bus)));
        places
    }

    /// Takes back the slot of a job that has ended or was cancelled.
    pub(super) fn take_back(&mut self, work: Work) {
        match work {
            Work::Once(_) => {}
            Work::State(mut change) => {
                change.give_up();
                self.changes.push(change);
            }
            Work::Number(mut transfer) => {
                transfer.give_up();
                self.numbers.push(transfer);
            }
        }
    }
}

fn number_place(bus: &Bus) -> NumberPlace {
    let bus = bus.clone();
    place(move |(transfer, peer, object, scope): (NumberTransfer, _, _, _)| {
        transfer.run(bus.clone(), peer, object, scope)
    })
}

impl Master {
    /// Converts the result of a sequence into the result of its job. After a scan, the master takes over the slaves
    /// that the scan has found.
    pub(super) fn end(&mut self, output: Output) -> End {
        match output {
            Output::Done(done) => done,
            Output::Scan(Err(error)) => End::Scan(Err(error)),
            Output::Scan(Ok(slaves)) => {
                let found = slaves.len() as u8;
                self.process.reset(&slaves);
                self.places = Places::new(&self.bus, slaves.len());
                self.bus.with(|shared| clocks::make_room(shared, slaves.len()));
                self.watch = Some(Box::pin(Watch::new(self.bus.clone(), slaves.clone()).run()));
                self.slaves = slaves;
                End::Scan(Ok(found))
            }
        }
    }

    /// Starts a job. Its future gets a box of its own, which is an allocation.
    pub(super) fn start<T: Ending>(&mut self, task: impl Future<Output = T> + Send + 'static) -> Job<T> {
        self.begin(Work::Once(Box::pin(async move { Output::Done(task.await.into_end()) })))
    }

    fn begin<T>(&mut self, work: Work) -> Job<T> {
        self.next_job += 1;
        let id = JobId(self.next_job);
        self.jobs.push(Running { id, work });
        Job::new(id)
    }

    /// Starts the transfer of a value of up to 4 bytes, in a slot that is reused, so that nothing is allocated.
    pub(super) fn start_number<T>(
        &mut self,
        transfer: NumberTransfer,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        timeout_ns: Ns,
    ) -> Job<T> {
        let peer = self.peer(slave, timeout_ns);
        let mut place = self.places.numbers.pop().unwrap_or_else(|| number_place(&self.bus));
        place.begin((transfer, peer, object, scope));
        self.begin(Work::Number(place))
    }

    /// The result of a job, which can be taken once. `None`: the job has not ended, was cancelled, or its result was
    /// taken.
    pub fn take<T: Ending>(&mut self, job: Job<T>) -> Option<T> {
        let place = self.done.iter().position(|(id, _)| *id == job.id())?;
        self.done.remove(place).and_then(|(_, end)| T::of(end))
    }

    /// The jobs that have ended and whose results were not taken, oldest first. [`Self::cancel`] drops an unwanted
    /// result.
    pub fn ended(&self) -> impl Iterator<Item = JobId> {
        self.done.iter().map(|(id, _)| *id)
    }

    /// The id of the job that was started last.
    pub(crate) const fn newest(&self) -> JobId {
        JobId(self.next_job)
    }

    /// Cancels a job, whose result is dropped. Datagrams that were sent already take effect.
    pub fn cancel(&mut self, job: impl Into<JobId>) {
        let id = job.into();
        if let Some(n) = self.jobs.iter().position(|job| job.id == id) {
            self.places.take_back(self.jobs.remove(n).work);
        }
        self.done.retain(|(done, _)| *done != id);
    }

    /// Starts a scan, which finds the slaves and identifies them. It brings all slaves to Init, deletes their
    /// configuration, and cancels all other jobs.
    pub fn scan(&mut self) -> Job<Result<u8, ScanError>> {
        self.forget();
        let bus = self.bus.clone();
        self.begin(Work::Once(Box::pin(async move { Output::Scan(scan::scan(bus).await) })))
    }

    /// Uses a network that another master has scanned and continues to run: takes the station addresses of its slaves
    /// and the contents of their EEPROMs. The call sends nothing and changes nothing in the slaves, and no watch
    /// starts. Mailboxes can be used while the other master does not use them. Requests to them have counter 0, so that
    /// they do not disturb the counters of the other master. All running jobs are cancelled.
    pub fn join<'s>(&mut self, slaves: impl IntoIterator<Item = (u16, &'s [u8])>) {
        self.forget();
        let slaves = slaves.into_iter().map(|(station, eeprom)| SlaveInfo::new(station, Ok(eeprom.to_vec())));
        self.slaves = slaves.collect();
        self.process.reset(&self.slaves);
        self.bus.with(|shared| {
            shared.begin(&self.slaves);
            shared.live.iter_mut().for_each(|live| live.mailbox.is_shared = true);
        });
    }

    /// Cancels all jobs, and forgets all slaves.
    fn forget(&mut self) {
        self.jobs.clear();
        self.watch = None;
        self.slaves.clear();
        self.process.reset(&[]);
        self.bus.with(Shared::reset);
    }

    /// Starts to bring slaves to a state, step by step and each at its own pace, within `timeout_ns`. Errors of slaves
    /// are acknowledged on the way. The result names the first slave that does not reach the state; all others still go
    /// there. A change to OP needs running cycles.
    pub fn request_state(&mut self, slaves: SlaveSet, target: AlState, timeout_ns: Ns) -> Job<Result<(), StateError>> {
        let mut change = self.places.changes.pop().unwrap_or_else(|| StateChange::new(&self.bus, 0));
        change.begin(&self.bus, slaves.iter().map(|slave| self.plan(slave)), target, timeout_ns);
        self.begin(Work::State(change))
    }

    fn plan(&self, slave: u8) -> Plan {
        let (registers, sync) = (self.process.registers(slave), self.process.sync(slave));
        let info = self.slave(slave);
        // A slave that was not found gets station address 0, which no slave answers: its change of state fails with
        // that reason.
        let station = info.map_or(0, |info| info.station);
        Plan { slave, station, mailbox: info.and_then(SlaveInfo::mailbox_managers), registers, sync }
    }

    /// The slave and mailbox for a transfer; the mailbox is `None` if the slave was not found or has none.
    pub(super) fn peer(&self, slave: u8, timeout_ns: Ns) -> Peer {
        let info = self.slave(slave);
        let (station, mailbox) = info.map_or((0, None), |info| (info.station, info.mailbox));
        Peer { slave, station, mailbox, timeout_ns }
    }

    /// The station address of a slave that the scan has found.
    fn station(&self, slave: u8) -> Option<u16> {
        self.slave(slave).map(|info| info.station)
    }

    fn station_to_ask(&self, slave: u8) -> Result<u16, DatagramError> {
        self.station(slave).ok_or(DatagramError::NoSlave(slave))
    }

    /// Starts to read `count` words of a slave's EEPROM from word `first` on; beyond the end an EEPROM mostly reads as
    /// 0xFFFF. Only one job at a time may use an EEPROM, and none while the slave changes its state.
    pub fn read_eeprom(&mut self, slave: u8, first: u16, count: usize) -> Job<Result<Vec<u16>, SiiError>> {
        let eeprom = Eeprom::open(self.bus.clone(), slave, self.station(slave));
        self.start(async move { eeprom.await?.read(first, count).await })
    }

    /// Starts to write words of a slave's EEPROM from word `first` on, one after the other. A scan reads the new words;
    /// the slave itself loads the first ones when it is switched on. Only one job at a time may use an EEPROM, and none
    /// while the slave changes its state.
    pub fn write_eeprom(&mut self, slave: u8, first: u16, words: &[u16]) -> Job<Result<(), SiiError>> {
        let eeprom = Eeprom::open(self.bus.clone(), slave, self.station(slave));
        let words = words.to_vec();
        self.start(async move { eeprom.await?.write(first, &words).await })
    }

    /// Starts to read `len` bytes of a slave's registers or memory from `address` on. A lost frame is repeated.
    pub fn read_registers(&mut self, slave: u8, address: u16, len: usize) -> Job<Result<Vec<u8>, DatagramError>> {
        let (bus, station) = (self.bus.clone(), self.station_to_ask(slave));
        self.start(async move { registers::read(bus, station?, address, len).await })
    }

    /// Starts to write a slave's registers or memory from `address` on. A lost frame is repeated, so that the slave may
    /// be written twice; [`Self::datagram`] writes at most once.
    pub fn write_registers(&mut self, slave: u8, address: u16, data: &[u8]) -> Job<Result<(), DatagramError>> {
        let (bus, station, data) = (self.bus.clone(), self.station_to_ask(slave), data.to_vec());
        self.start(async move { registers::write(bus, station?, address, data).await })
    }

    /// Starts to read the AL states of all slaves. [`Self::status`] then returns them.
    pub fn read_states(&mut self) -> Job<()> {
        let (bus, stations) = (self.bus.clone(), self.slaves.iter().map(|info| info.station).collect::<Vec<_>>());
        self.start(async move {
            lost_slaves::read_states(&bus, &stations, &mut Vec::new()).await;
        })
    }

    /// Starts to read the message in a slave's mailbox, undecoded and with its header. The master sends no request
    /// before it, so the message is an unsolicited one; see [`Self::keep_mail`].
    pub fn receive_mail(&mut self, slave: u8) -> Job<Result<Option<Vec<u8>>, MailboxError>> {
        let (bus, peer) = (self.bus.clone(), self.peer(slave, 0));
        self.start(async move {
            let info = peer.mailbox.ok_or(MailboxError::NoMailbox)?;
            let mut mailbox = Mailbox::open(bus, peer.slave, peer.station, info).ok_or(MailboxError::Busy)?;
            mailbox.take().await
        })
    }

    /// Starts to send a datagram of any command. `address`: in the lower 16 bits the position (0, then minus 1 for each
    /// slave) or the station address, in the upper 16 bits the address in the slave; or the logical address; see
    /// [`DatagramHeader::address`](crate::ethercat::DatagramHeader::address). The datagram is sent once only, and its
    /// answer counts with any working counter. It may interfere with what the master itself does with the slaves.
    pub fn datagram(
        &mut self,
        command: Command,
        address: u32,
        data: &[u8],
    ) -> Job<Result<DatagramAnswer, DatagramError>> {
        self.start(registers::datagram(self.bus.clone(), command, address, data.to_vec()))
    }
}
