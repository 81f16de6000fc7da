//! The configuration of the slaves in PreOP: their process data and mode of operation. Several slaves are configured at the
//! same time, each with its SDOs in the board's order.

use std::future::poll_fn;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use parking_lot::Mutex;

use super::answer_wait_ns;
use super::jobs::BUSY;
use crate::ethercat::cia402::CONTROLWORD;
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::sii::SiiSmType;
use crate::ethercat::{AlState, AlStatus, Ns, SlaveSet};
use crate::fieldbus::pdo::{self, Download, ProcessData};
use crate::fieldbus::{BusConfig, Configured, MAX_SLAVES, Refusal, Role, SlaveConfig};
use crate::master::place::{Place, place};
use crate::master::{Ending, Job, JobId, MailboxError, Master, ProcessManager, SdoError, SlaveInfo, SyncSignals};
use crate::sk::{CycleTime, DriveSync};

/// The maximum number of slaves that are configured at the same time. \[OURS]
const AT_ONCE: usize = 8;
/// The timeout for an SDO of a configuration, ns. \[OURS]
const SDO_TIMEOUT_NS: Ns = 1_000_000_000;
/// The maximum number of sync managers of a slave whose use (mailbox, outputs, inputs) is read from 0x1C00; any further
/// ones count as unused. \[OURS]
const MANAGERS_MAX: usize = 8;
/// The object with the types of the sync managers (mailbox, outputs, inputs).
const MANAGER_USES: u16 = 0x1C00;
/// How many times an SDO transfer is repeated while the slave's mailbox is busy with an answer to an earlier, abandoned
/// request. \[OURS]
const TRIES: u32 = 1000;

/// A preallocated, reusable slot for the future that configures one slave, see [`OneSlave`], so that a configuration
/// allocates no memory while cycles run. The result of the future is the mapped process data.
type Seat = Place<(u8, SlaveConfig, CycleTime), Result<Option<ProcessData>, Refusal>>;

/// A slave that is being configured.
struct UnderWay {
    slave: u8,
    seat: Seat,
    /// The SDO transfer that the future of this slave waits for.
    waits_for: JobId,
}

/// A configuration, with the slots for its futures. It is allocated once and reused.
pub(super) struct Configuring {
    config: BusConfig,
    found: u8,
    next: u8,
    /// The slots that no future uses.
    seats: Vec<Seat>,
    under_way: Vec<UnderWay>,
    second_axes: SlaveSet,
    refusal: Option<Refusal>,
}

impl Configuring {
    /// Allocates the slots. Only one configuration at a time can use them.
    pub(super) fn place(master: &Arc<Mutex<Master>>) -> Box<Self> {
        let unused = SlaveConfig { role: Role::Unused, sync: DriveSync::FreeRun };
        let slaves = [unused; MAX_SLAVES];
        let config = BusConfig { cycle: CycleTime::DEFAULT, selected: SlaveSet::EMPTY, slaves };
        let seat = |_| {
            let master = Arc::clone(master);
            place(move |(slave, config, cycle)| {
                OneSlave { master: Arc::clone(&master), slave, config, cycle }.configure()
            })
        };
        let seats = (0..AT_ONCE).map(seat).collect();
        let under_way = Vec::with_capacity(AT_ONCE);
        Box::new(Self { config, found: 0, next: 1, seats, under_way, second_axes: SlaveSet::EMPTY, refusal: None })
    }

    /// Begins a configuration. No other configuration may be running in these slots.
    pub(super) fn begin_all(&mut self, config: BusConfig, found: u8) {
        (self.config, self.found, self.next) = (config, found.min(MAX_SLAVES as u8), 1);
        (self.second_axes, self.refusal) = (SlaveSet::EMPTY, None);
    }

    pub(super) fn cancel(&mut self, master: &Mutex<Master>) {
        for UnderWay { mut seat, waits_for, .. } in self.under_way.drain(..) {
            master.lock().cancel(waits_for);
            seat.give_up();
            self.seats.push(seat);
        }
    }

    /// Begins to configure further slaves while slots are free, and polls the futures whose SDO transfer has ended.
    /// Returns the result once all futures have ended. `mapped` is called with the mapped process data of each slave.
    pub(super) fn run(
        &mut self,
        master: &Mutex<Master>,
        mapped: &mut dyn FnMut(u8, Option<ProcessData>),
    ) -> Option<Result<Configured, Refusal>> {
        while self.refusal.is_none() && self.next <= self.found && self.under_way.len() < AT_ONCE {
            let slave = self.next;
            self.next += 1;
            if self.config.selected.contains(slave)
                && let Some(mut seat) = self.seats.pop()
            {
                seat.begin((slave, self.config.slaves[usize::from(slave) - 1], self.config.cycle));
                self.go_on(slave, seat, master, mapped);
            }
        }
        let mut n = 0;
        while let Some(one) = self.under_way.get(n) {
            if master.lock().ended().any(|id| id == one.waits_for) {
                let UnderWay { slave, seat, .. } = self.under_way.swap_remove(n);
                self.go_on(slave, seat, master, mapped);
            } else {
                n += 1;
            }
        }
        let all_begun = self.refusal.is_some() || self.next > self.found;
        if !self.under_way.is_empty() || !all_begun {
            return None;
        }
        Some(match self.refusal {
            Some(refusal) => Err(refusal),
            None => Ok(Configured { second_axes: self.second_axes, ..Configured::default() }),
        })
    }

    fn go_on(
        &mut self,
        slave: u8,
        mut seat: Seat,
        master: &Mutex<Master>,
        mapped: &mut dyn FnMut(u8, Option<ProcessData>),
    ) {
        match seat.poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Pending => {
                let waits_for = master.lock().newest();
                return self.under_way.push(UnderWay { slave, seat, waits_for });
            }
            Poll::Ready(Ok(data)) => {
                if data.is_some_and(|data| data.axes() > 1) {
                    self.second_axes.insert(slave);
                }
                mapped(slave, data);
            }
            // If several slaves refuse, the refusal of the first one in network order is the result, so that it does
            // not depend on which slave answers first.
            Poll::Ready(Err(refusal)) if self.refusal.is_none_or(|before| slave < before.slave) => {
                self.refusal = Some(refusal);
            }
            Poll::Ready(Err(_)) => {}
        }
        self.seats.push(seat);
    }
}

/// The arguments of the future that configures one slave. The methods are the steps of that future.
struct OneSlave {
    master: Arc<Mutex<Master>>,
    slave: u8,
    config: SlaveConfig,
    cycle: CycleTime,
}

impl OneSlave {
    async fn configure(self) -> Result<Option<ProcessData>, Refusal> {
        let (slave, SlaveConfig { role, sync }) = (self.slave, self.config);
        // If the slave did not answer when the master read its AL state, this check is skipped. The first SDO transfer
        // then shows whether the slave answers now.
        let present = self.master.lock().status(slave).filter(|status| status.is_present);
        if present.is_some_and(|status| status.state() != Some(AlState::PreOp)) {
            return Err(Refusal::of(self.slave, AlStatus::INVALID_CHANGE));
        }
        // Nothing is written to an unused slave (SK-4 [OURS]), so it need not answer.
        if role == Role::Unused {
            // With 0 bytes `configure` fails only for a slave that was lost in SafeOP or OP and is still missing: its
            // previous process data then stay in the process image.
            let _ = self.master.lock().configure(slave, 0, 0);
            return Ok(None);
        }
        if self.is(SlaveInfo::assumes_managers) {
            self.ask_for_manager_uses().await?;
        }
        let may_keep_its_own = ProcessData::may_keep_its_own(role) && self.is(is_described);
        if may_keep_its_own && self.is(SlaveInfo::lacks_coe) {
            return self.take_as_described();
        }
        let is_there = match ProcessData::probe(role) {
            Some(object) => self.read(object).await?.is_ok(),
            None => false,
        };
        let data = ProcessData::of(role, is_there).ok_or(Refusal { slave, ..pdo::NO_SUCH_MODE })?;
        for download in data.downloads(sync) {
            let Err(code) = self.write(&download).await? else { continue };
            if may_keep_its_own && download.is_mapping() {
                // A drive that SET_AXIS has not declared also has the role IO, but it must not reach OP as an IO
                // module. So only the mapping of slaves that are no drives is restored.
                if !self.is(is_drive) {
                    self.restore_mapping(data.downloads(sync).up_to(&download)).await?;
                }
                return self.assign_its_own().await;
            }
            return Err(self.refused(&download, code));
        }
        self.exchange(data)
    }

    /// Reads the use of each sync manager from object 0x1C00, because the EEPROM does not contain it. Sub-index 0 is
    /// the number of sync managers.
    async fn ask_for_manager_uses(&self) -> Result<(), Refusal> {
        let mut uses = [SiiSmType::Unused; MANAGERS_MAX];
        let count = self.manager_use(0).await?;
        for (sub, place) in (1..=count).zip(&mut uses) {
            *place = SiiSmType::from_code(self.manager_use(sub).await?);
        }
        if uses.iter().any(|one| matches!(one, SiiSmType::Outputs | SiiSmType::Inputs)) {
            // This cannot fail: the slave exists, and its EEPROM does not contain the uses.
            let _ = self.master.lock().assume_managers(self.slave, &uses);
        }
        Ok(())
    }

    async fn manager_use(&self, sub: u8) -> Result<u8, Refusal> {
        Ok(self.read(ObjectAddress::new(MANAGER_USES, sub)).await?.unwrap_or(0) as u8)
    }

    /// Restores the mapping from the EEPROM in each PDO that the downloads in `tried` have emptied, because the slave
    /// has refused the last of these downloads. A PDO that cannot be emptied is fixed, so it still has its objects.
    /// Other aborts are ignored too: if the process data have wrong lengths, the slave refuses SafeOP.
    async fn restore_mapping(&self, tried: impl Iterator<Item = Download>) -> Result<(), Refusal> {
        for pdo in tried.filter(Download::empties_pdo).map(|download| download.object.index) {
            let Some(entries) = self.master.lock().slave(self.slave).and_then(|info| info.pdo_entries(pdo)) else {
                continue;
            };
            for download in Download::mapping(pdo, &entries) {
                if self.send(&download).await?.is_err() && download.empties_pdo() {
                    break;
                }
            }
        }
        Ok(())
    }

    /// Assigns the slave's default PDOs, which its EEPROM names, to the sync managers. Called when the slave has
    /// refused the board's mapping.
    async fn assign_its_own(&self) -> Result<Option<ProcessData>, Refusal> {
        let pdos = self.master.lock().slave(self.slave).map(SlaveInfo::assigned_pdos);
        let [outputs, inputs] = pdos.unwrap_or_default();
        for download in Download::assigning(&outputs, &inputs) {
            if let Err(code) = self.write(&download).await? {
                return Err(self.refused(&download, code));
            }
        }
        self.take_as_described()
    }

    /// For a module that cannot map the process data of the board: uses the process data that the EEPROM describes,
    /// whatever their length. [`super::cycle`] converts between this process image and the board's.
    fn take_as_described(&self) -> Result<Option<ProcessData>, Refusal> {
        let mut master = self.master.lock();
        match master.configure_as_described(self.slave).and_then(|()| master.set_sync(self.slave, None)) {
            Ok(()) => Ok(ProcessData::of(self.config.role, false)),
            Err(_) => Err(Refusal::of(self.slave, AlStatus::INVALID_OUTPUTS)),
        }
    }

    /// Configures the master to exchange these process data with the slave from SafeOP on, and to set its SYNC0.
    fn exchange(&self, data: ProcessData) -> Result<Option<ProcessData>, Refusal> {
        let cycle_ns = u32::try_from(self.cycle.ns()).unwrap_or(u32::MAX);
        // SYNC0 comes at the end of the wait for answers (`ANSWER_WAIT`). So an answer in time shows that the outputs
        // arrived before SYNC0, even if the frame was late.
        let shift_ns = u32::try_from(answer_wait_ns(self.cycle)).unwrap_or(u32::MAX);
        let signals = SyncSignals::sync0(cycle_ns, shift_ns.cast_signed());
        let sync = (self.config.sync == DriveSync::DcSync).then_some(signals);
        let mut master = self.master.lock();
        let configured = master
            .configure(self.slave, data.output_bytes() as u16, data.input_bytes() as u16)
            .and_then(|()| master.set_sync(self.slave, sync));
        // An error means that the master cannot exchange these process data with the slave. The refusal has the AL
        // status code of a slave with a wrong configuration of its outputs.
        configured.map_err(|_| Refusal::of(self.slave, AlStatus::INVALID_OUTPUTS)).map(|()| Some(data))
    }

    /// Writes an object. An abort is no error if the slave may lack the object, if the object already has the wanted
    /// value, or if the download only clears a list. Any other abort code is the inner error.
    ///
    /// \[OURS] An abort of a synchronization type is never an error: slaves use various abort codes for a type that
    /// they do not support, some support only other types, and not every master writes these objects. If SYNC0 does not
    /// fit, the slave refuses SafeOP or OP and its AL status code says why.
    async fn write(&self, download: &Download) -> Result<Result<(), AbortCode>, Refusal> {
        Ok(match self.send(download).await? {
            Err(code) if download.may_fail_with(code) || download.is_sync_type() => Ok(()),
            Err(code) if !download.may_be_fixed() => Err(code),
            Err(code) if !download.takes_away() && !self.holds(self.object(download), download).await? => Err(code),
            _ => Ok(()),
        })
    }

    /// Writes an object. Any abort code is the inner error.
    async fn send(&self, download: &Download) -> Result<Result<(), AbortCode>, Refusal> {
        let object = self.object(download);
        let bytes = &download.value.to_le_bytes()[..usize::from(download.size.bytes())];
        let start = |master: &mut Master| master.download(self.slave, object, SdoScope::Entry, bytes, SDO_TIMEOUT_NS);
        self.transfer(object, start).await
    }

    /// Whether an abort of the download `wanted` is no error: the object already has the wanted value, or the slave may
    /// lack the object. If an object of the PDO assignment (0x1C12, 0x1C13) cannot be read, the EEPROM shows which PDOs
    /// are assigned.
    async fn holds(&self, object: ObjectAddress, wanted: &Download) -> Result<bool, Refusal> {
        Ok(match self.read(object).await? {
            Ok(value) => value == wanted.value,
            Err(code) if wanted.may_fail_with(code) => true,
            Err(_) => self.is(|info| wanted.is_assigned_in(&info.assigned_pdos())),
        })
    }

    async fn read(&self, object: ObjectAddress) -> Result<Result<u32, AbortCode>, Refusal> {
        let start = |master: &mut Master| master.upload_number(self.slave, object, SdoScope::Entry, SDO_TIMEOUT_NS);
        self.transfer(object, start).await
    }

    /// Runs an SDO transfer, and repeats it while the mailbox is busy. The inner error is the code with which the slave
    /// has aborted the transfer; the outer error means that the slave gave no valid answer in time.
    async fn transfer<T>(
        &self,
        object: ObjectAddress,
        start: impl Fn(&mut Master) -> Job<Result<T, SdoError>>,
    ) -> Result<Result<T, AbortCode>, Refusal>
    where
        Result<T, SdoError>: Ending,
    {
        let mut tries = 0;
        loop {
            let job = start(&mut self.master.lock());
            let ended = poll_fn(|_| self.master.lock().take(job).map_or(Poll::Pending, Poll::Ready)).await;
            return match ended {
                Ok(value) => Ok(Ok(value)),
                Err(SdoError::Abort(code)) => Ok(Err(code)),
                Err(BUSY) if tries < TRIES => {
                    tries += 1;
                    continue;
                }
                Err(SdoError::Mailbox(MailboxError::NoAnswer)) => Err(Refusal::no_answer(self.slave)),
                // The slave answers, but its answer comes too late or is invalid. The refusal names the SDO transfer;
                // the AL status code is unknown, so it stays 0.
                Err(error) => {
                    Err(Refusal { abort: Some((object, error.abort_code())), ..Refusal::no_answer(self.slave) })
                }
            };
        }
    }

    /// The object that a download writes in this slave: the assignment object depends on the slave's sync managers.
    fn object(&self, download: &Download) -> ObjectAddress {
        let first = |managers: &[ProcessManager]| managers.first().map(|one| one.number);
        let master = self.master.lock();
        let managers = master.slave(self.slave).map_or([None; 2], |info| [first(&info.outputs), first(&info.inputs)]);
        download.object_for(managers)
    }

    fn is(&self, what: impl FnOnce(&SlaveInfo) -> bool) -> bool {
        self.master.lock().slave(self.slave).is_some_and(what)
    }

    fn refused(&self, download: &Download, code: AbortCode) -> Refusal {
        Refusal { slave: self.slave, abort: Some((self.object(download), code)), ..download.refused(code) }
    }
}

/// Whether the slave is a drive: one of the PDOs that its EEPROM assigns contains the controlword.
fn is_drive(info: &SlaveInfo) -> bool {
    let pdos = info.assigned_pdos().concat();
    pdos.into_iter()
        .filter_map(|pdo| info.pdo_entries(pdo))
        .flatten()
        .any(|entry| entry >> 16 == u32::from(CONTROLWORD))
}

/// Whether the EEPROM describes process data: a sync manager for outputs or inputs has a length above 0.
fn is_described(info: &SlaveInfo) -> bool {
    info.outputs.iter().chain(&info.inputs).any(|one| one.registers.len > 0)
}
