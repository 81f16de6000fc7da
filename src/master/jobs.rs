//! What takes more than one datagram and is started by the user: scans, changes of state, SDOs.

use std::future::Future;
use std::task::{Context, Poll};

use super::bus::{Bus, Task};
use super::handle::{End, Ending, Job, JobId};
use super::mailbox::{Mailbox, Peer};
use super::place::{Place, place};
use super::sdo::NumberTransfer;
use super::shared::Shared;
use super::sii::Eeprom;
use super::states::{Plan, StateChange};
use super::watch::{self, Watch};
use super::{
    DatagramAnswer, DatagramError, FileError, MailboxError, Master, ScanError, SdoError, SiiError, SlaveInfo,
    StateError, clocks, foe, information, registers, scan, sdo,
};
use crate::ethercat::coe::{EntryRequest, ObjectAddress, ObjectListType, SdoScope};
use crate::ethercat::{AlState, Command, Ns, SlaveSet};

/// \[OURS] How many changes of state, and how many transfers of numbers, there is room for at once before more needs memory.
const CHANGES: usize = 1;
const TRANSFERS: usize = 8;
/// \[OURS] The same of jobs of all kinds, with such whose ends were not taken yet.
pub(super) const JOBS: usize = 32;

/// What a sequence gives when it has ended.
pub(super) enum Output {
    Scan(Result<Vec<SlaveInfo>, ScanError>),
    Done(End),
}

/// A sequence that was started.
pub(super) struct Running {
    pub(super) id: JobId,
    pub(super) work: Work,
}

/// The transfer of a number: of which slave and object.
type NumberPlace = Place<(NumberTransfer, Peer, ObjectAddress, SdoScope), End>;

/// Where a sequence runs.
pub(super) enum Work {
    /// In a box of its own.
    Once(Task<Output>),
    /// In places that are used again.
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

/// The places that nobody uses.
#[derive(Default)]
pub(super) struct Places {
    changes: Vec<StateChange>,
    numbers: Vec<NumberPlace>,
}

impl Places {
    /// Those for so many slaves.
    fn new(bus: &Bus, slaves: usize) -> Self {
        let mut places = Self::default();
        places.changes.extend((0..CHANGES).map(|_| StateChange::new(bus, slaves)));
        places.numbers.extend((0..TRANSFERS).map(|_| number_place(bus)));
        places
    }

    /// A sequence has ended, or is given up.
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
    /// Makes of a sequence's end what is told of it.
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

    /// Starts a sequence.
    fn start<T: Ending>(&mut self, task: impl Future<Output = T> + Send + 'static) -> Job<T> {
        self.begin(Work::Once(Box::pin(async move { Output::Done(task.await.into_end()) })))
    }

    fn begin<T>(&mut self, work: Work) -> Job<T> {
        self.next_job += 1;
        let id = JobId(self.next_job);
        self.jobs.push(Running { id, work });
        Job::new(id)
    }

    /// Starts the transfer of a number.
    fn start_number<T>(
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

    /// How something that was started has ended, once; `None`: it has not, or was given up.
    pub fn take<T: Ending>(&mut self, job: Job<T>) -> Option<T> {
        let place = self.done.iter().position(|(id, _)| *id == job.id())?;
        self.done.remove(place).and_then(|(_, end)| T::of(end))
    }

    /// What has ended and was not taken, the first one first. [`Self::cancel`] forgets an end that nobody wants.
    pub fn ended(&self) -> impl Iterator<Item = JobId> {
        self.done.iter().map(|(id, _)| *id)
    }

    /// What was started last.
    pub(crate) const fn newest(&self) -> JobId {
        JobId(self.next_job)
    }

    /// Gives up something that was started. Its end is never told; what was sent takes effect.
    pub fn cancel(&mut self, job: impl Into<JobId>) {
        let id = job.into();
        if let Some(n) = self.jobs.iter().position(|job| job.id == id) {
            self.places.take_back(self.jobs.remove(n).work);
        }
        self.done.retain(|(done, _)| *done != id);
    }

    /// Starts a scan: which slaves there are, who they are. It brings all slaves to Init without a configuration, and gives up
    /// everything else that is under way.
    pub fn scan(&mut self) -> Job<Result<u8, ScanError>> {
        self.forget();
        let bus = self.bus.clone();
        self.begin(Work::Once(Box::pin(async move { Output::Scan(scan::scan(bus).await) })))
    }

    /// Takes slaves for found that another master has found and goes on to run: their station addresses, and the contents of their
    /// EEPROMs. Nothing is sent, nothing of them is changed, and nobody watches over them. Their mailboxes can be used where
    /// the other master leaves them alone; a request is not counted there, so that the other one's counters stay right.
    /// Everything else that is under way is given up.
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

    /// Gives up what is under way, and forgets all slaves.
    fn forget(&mut self) {
        self.jobs.clear();
        self.watch = None;
        self.slaves.clear();
        self.process.reset(&[]);
        self.bus.with(Shared::reset);
    }

    /// Starts to bring slaves to a state, step by step and each at its own pace, within `timeout_ns`. Errors are acknowledged on
    /// the way. Its end names the first slave that does not get there; the others do all the same. On the way to
    /// OP there have to be cycles.
    pub fn request_state(&mut self, slaves: SlaveSet, target: AlState, timeout_ns: Ns) -> Job<Result<(), StateError>> {
        let mut change = self.places.changes.pop().unwrap_or_else(|| StateChange::new(&self.bus, 0));
        change.begin(&self.bus, slaves.iter().map(|slave| self.plan(slave)), target, timeout_ns);
        self.begin(Work::State(change))
    }

    fn plan(&self, slave: u8) -> Plan {
        let (registers, sync) = (self.process.registers(slave), self.process.sync(slave));
        let info = self.slave(slave);
        // A station that nobody has does not answer.
        let station = info.map_or(0, |info| info.station);
        Plan { slave, station, mailbox: info.and_then(SlaveInfo::mailbox_managers), registers, sync }
    }

    /// The mailbox of a slave; of one that is not there it is none.
    fn peer(&self, slave: u8, timeout_ns: Ns) -> Peer {
        let info = self.slave(slave);
        let (station, mailbox) = info.map_or((0, None), |info| (info.station, info.mailbox));
        Peer { slave, station, mailbox, timeout_ns }
    }

    /// Starts to read an object of any length, at most [`VALUE_BYTES_MAX`](super::VALUE_BYTES_MAX). `timeout_ns`: how long the
    /// slave may take for each answer.
    pub fn upload(
        &mut self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        timeout_ns: Ns,
    ) -> Job<Result<Vec<u8>, SdoError>> {
        self.start(sdo::upload(self.bus.clone(), self.peer(slave, timeout_ns), object, scope))
    }

    /// Starts to read an object of any length, of which the first 4 bytes are told, as a number. As nothing else is kept, it
    /// allocates nothing. `timeout_ns`: as for [`Self::upload`].
    pub fn upload_number(
        &mut self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        timeout_ns: Ns,
    ) -> Job<Result<u32, SdoError>> {
        self.start_number(NumberTransfer::Upload, slave, object, scope, timeout_ns)
    }

    /// Starts to write an object; one of up to 4 bytes allocates nothing. `timeout_ns`: how long the slave may take for each answer.
    pub fn download(
        &mut self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        value: &[u8],
        timeout_ns: Ns,
    ) -> Job<Result<(), SdoError>> {
        if let Some(transfer) = NumberTransfer::download(value) {
            return self.start_number(transfer, slave, object, scope, timeout_ns);
        }
        let (bus, peer, value) = (self.bus.clone(), self.peer(slave, timeout_ns), value.to_vec());
        self.start(async move { sdo::download(bus, peer, object, scope, &value).await })
    }

    /// Starts to ask which objects a slave has. `timeout_ns`: how long the slave may take for each part of the answer.
    pub fn object_list(&mut self, slave: u8, list: ObjectListType, timeout_ns: Ns) -> Job<Result<Vec<u16>, SdoError>> {
        self.start(information::list(self.bus.clone(), self.peer(slave, timeout_ns), list))
    }

    /// Starts to ask what an object is. The answer is an [`ObjectDescription`](crate::ethercat::coe::ObjectDescription) to be decoded.
    pub fn describe_object(&mut self, slave: u8, index: u16, timeout_ns: Ns) -> Job<Result<Vec<u8>, SdoError>> {
        self.start(information::object(self.bus.clone(), self.peer(slave, timeout_ns), index))
    }

    /// Starts to ask what a sub-index is. The answer is an [`EntryDescription`](crate::ethercat::coe::EntryDescription) to be decoded.
    pub fn describe_entry(
        &mut self,
        slave: u8,
        request: EntryRequest,
        timeout_ns: Ns,
    ) -> Job<Result<Vec<u8>, SdoError>> {
        self.start(information::entry(self.bus.clone(), self.peer(slave, timeout_ns), request))
    }

    /// Starts to read a file, at most [`VALUE_BYTES_MAX`](super::VALUE_BYTES_MAX). `password`: 0, or what the slave wants to
    /// know. `timeout_ns`: how long the slave may take for each packet.
    pub fn read_file(
        &mut self,
        slave: u8,
        name: &[u8],
        password: u32,
        timeout_ns: Ns,
    ) -> Job<Result<Vec<u8>, FileError>> {
        let (bus, peer, name) = (self.bus.clone(), self.peer(slave, timeout_ns), name.to_vec());
        self.start(async move { foe::read(bus, peer, &name, password).await })
    }

    /// Starts to write a file. `password`: 0, or what the slave wants to know. `timeout_ns`: how long the slave may take for
    /// each packet.
    pub fn write_file(
        &mut self,
        slave: u8,
        name: &[u8],
        password: u32,
        content: &[u8],
        timeout_ns: Ns,
    ) -> Job<Result<(), FileError>> {
        let (bus, peer) = (self.bus.clone(), self.peer(slave, timeout_ns));
        let (name, content) = (name.to_vec(), content.to_vec());
        self.start(async move { foe::write(bus, peer, &name, password, &content).await })
    }

    /// The station address of a slave that the scan has found.
    fn station(&self, slave: u8) -> Option<u16> {
        self.slave(slave).map(|info| info.station)
    }

    fn station_to_ask(&self, slave: u8) -> Result<u16, DatagramError> {
        self.station(slave).ok_or(DatagramError::NoSlave(slave))
    }

    /// Starts to read `count` words of a slave's EEPROM from word `first` on; behind its end an EEPROM mostly reads as 0xFFFF.
    /// One sequence at a time has an EEPROM, and none while the slave's state is changed.
    pub fn read_eeprom(&mut self, slave: u8, first: u16, count: usize) -> Job<Result<Vec<u16>, SiiError>> {
        let eeprom = Eeprom::open(self.bus.clone(), slave, self.station(slave));
        self.start(async move { eeprom.await?.read(first, count).await })
    }

    /// Starts to write words of a slave's EEPROM from word `first` on, one after the other. A scan reads them; a slave loads the
    /// first ones when it is switched on. One sequence at a time has an EEPROM, and none while the slave's state is changed.
    pub fn write_eeprom(&mut self, slave: u8, first: u16, words: &[u16]) -> Job<Result<(), SiiError>> {
        let eeprom = Eeprom::open(self.bus.clone(), slave, self.station(slave));
        let words = words.to_vec();
        self.start(async move { eeprom.await?.write(first, &words).await })
    }

    /// Starts to read `len` bytes of a slave's registers, or of its memory, from `address` on. It is tried again if a frame is
    /// lost.
    pub fn read_registers(&mut self, slave: u8, address: u16, len: usize) -> Job<Result<Vec<u8>, DatagramError>> {
        let (bus, station) = (self.bus.clone(), self.station_to_ask(slave));
        self.start(async move { registers::read(bus, station?, address, len).await })
    }

    /// Starts to write a slave's registers, or its memory, from `address` on. It is tried again if a frame is lost, so that the
    /// slave may be written twice; [`Self::datagram`] writes it once at most.
    pub fn write_registers(&mut self, slave: u8, address: u16, data: &[u8]) -> Job<Result<(), DatagramError>> {
        let (bus, station, data) = (self.bus.clone(), self.station_to_ask(slave), data.to_vec());
        self.start(async move { registers::write(bus, station?, address, data).await })
    }

    /// Starts to read the AL states of all slaves, which [`Self::status`] then tells.
    pub fn read_states(&mut self) -> Job<()> {
        let (bus, stations) = (self.bus.clone(), self.slaves.iter().map(|info| info.station).collect::<Vec<_>>());
        self.start(async move {
            watch::read_states(&bus, &stations, &mut Vec::new()).await;
        })
    }

    /// Starts to read the message in a slave's mailbox as it lies there, header and all. Nothing is asked of the slave, so that
    /// it is what the slave has sent unasked; see [`Self::keep_mail`].
    pub fn receive_mail(&mut self, slave: u8) -> Job<Result<Option<Vec<u8>>, MailboxError>> {
        let (bus, peer) = (self.bus.clone(), self.peer(slave, 0));
        self.start(async move {
            let info = peer.mailbox.ok_or(MailboxError::NoMailbox)?;
            let mut mailbox = Mailbox::open(bus, peer.slave, peer.station, info).ok_or(MailboxError::Busy)?;
            mailbox.take().await
        })
    }

    /// Starts to send a datagram of any command. `address`: the position (0, then minus 1 for each slave) or the station address
    /// in the lower and the address in the slave in the upper 16 bits, or the logical address; see
    /// [`DatagramHeader::address`](crate::ethercat::DatagramHeader::address). It is sent once only, and whatever the working
    /// counter is, what came back is the answer. Nothing keeps it from what the master itself does with the slaves.
    pub fn datagram(
        &mut self,
        command: Command,
        address: u32,
        data: &[u8],
    ) -> Job<Result<DatagramAnswer, DatagramError>> {
        self.start(registers::datagram(self.bus.clone(), command, address, data.to_vec()))
    }
}
