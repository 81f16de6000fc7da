//! The process data and the mode of operation of each slave, written in PreOP: several slaves at once, each in the order in
//! which the board does it.

use super::answer_wait_ns;
use super::jobs::{BUSY, Transfer};
use crate::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::sii::SiiSmType;
use crate::ethercat::{AlState, AlStatus, Ns, SlaveSet};
use crate::fieldbus::pdo::{self, Download, Downloads, ProcessData};
use crate::fieldbus::{BusConfig, Configured, MAX_SLAVES, Refusal, Role, SlaveConfig};
use crate::master::{JobId, MailboxError, Master, ProcessManager, SdoError, SlaveInfo, SyncSignals};
use crate::sk::{CycleTime, DriveSync};

/// How many slaves are configured at once. \[OURS]
const AT_ONCE: usize = 8;
/// How long a slave may take for one SDO of its configuration, ns. \[OURS]
const SDO_TIMEOUT_NS: Ns = 1_000_000_000;

/// How far a slave has come.
#[allow(
    clippy::large_enum_variant,
    reason = "there are as many as slaves are configured at once, and boxing it would allocate"
)]
enum Stage {
    /// What its sync managers are for is read (object 0x1C00), of which its EEPROM says nothing: the sub-index that is read, and what
    /// those before it are for. Sub-index 0 says how many there are.
    ManagerUses { sub: u8, count: u8, uses: [SiiSmType; MANAGERS_MAX] },
    /// Whether a pulse module has a second axis is read.
    SecondAxis,
    /// The downloads that are left, and the one under way. `refused`: the slave has aborted it so, and what the object holds is
    /// read instead.
    Writing { wanted: Wanted, left: Left, current: Download, refused: Option<AbortCode> },
}

impl Stage {
    /// The object that is read or written.
    fn object(&self, slave: u8, master: &Master) -> ObjectAddress {
        match self {
            Self::ManagerUses { sub, .. } => ObjectAddress::new(MANAGER_USES, *sub),
            Self::SecondAxis => pdo::SECOND_CONTROLWORD,
            Self::Writing { current, .. } => object_in(slave, current, master),
        }
    }
}

/// How many sync managers are asked for. \[OURS]
const MANAGERS_MAX: usize = 8;
/// The object that says what they are for.
const MANAGER_USES: u16 = 0x1C00;

/// Which process data a slave is to have.
#[derive(Clone, Copy)]
enum Wanted {
    /// Those that the board maps.
    Mapped(ProcessData),
    /// Those that its EEPROM describes, since it cannot map others.
    Described,
}

/// The downloads of a slave that are left.
#[allow(
    clippy::large_enum_variant,
    reason = "there are as many as slaves are configured at once, and boxing it would allocate"
)]
enum Left {
    Mapping(<Downloads as IntoIterator>::IntoIter),
    /// Those of [`Wanted::Described`], which are as many as its EEPROM says.
    Assigning(std::vec::IntoIter<Download>),
}

impl Left {
    fn next(&mut self) -> Option<Download> {
        match self {
            Self::Mapping(left) => left.next(),
            Self::Assigning(left) => left.next(),
        }
    }
}

/// A slave that is being configured.
struct OneSlave {
    slave: u8,
    transfer: Transfer,
    stage: Stage,
    /// How the transfer has ended that it waits for.
    ended: Option<Result<Option<u32>, SdoError>>,
    /// How often it was asked for.
    tries: u32,
}

/// How often a transfer is asked for whose mailbox is in use, as long as an answer is fetched that nobody waits for. \[OURS]
const TRIES: u32 = 1000;

/// The configuration of slaves under way, and a place for one.
pub(super) struct Configuring {
    config: BusConfig,
    found: u8,
    next: u8,
    under_way: Vec<OneSlave>,
    second_axes: SlaveSet,
    refusal: Option<Refusal>,
}

impl Configuring {
    /// A place for one.
    pub(super) fn place() -> Box<Self> {
        let unused = SlaveConfig { role: Role::Unused, sync: DriveSync::FreeRun };
        let slaves = [unused; MAX_SLAVES];
        let config = BusConfig { cycle: CycleTime::DEFAULT, selected: SlaveSet::EMPTY, slaves };
        let under_way = Vec::with_capacity(AT_ONCE);
        Box::new(Self { config, found: 0, next: 1, under_way, second_axes: SlaveSet::EMPTY, refusal: None })
    }

    /// Begins one. There is none under way here.
    pub(super) fn begin_all(&mut self, config: BusConfig, found: u8) {
        (self.config, self.found, self.next) = (config, found, 1);
        (self.second_axes, self.refusal) = (SlaveSet::EMPTY, None);
    }

    pub(super) fn cancel(&mut self, master: &mut Master) {
        self.under_way.drain(..).for_each(|one| master.cancel(one.transfer.id()));
    }

    /// A transfer has ended.
    pub(super) fn take(&mut self, id: JobId, master: &mut Master) {
        if let Some(one) = self.under_way.iter_mut().find(|one| one.transfer.id() == id) {
            one.ended = one.transfer.take(master);
        }
    }

    /// Goes on with all slaves; how it has ended. `mapped` is told what is mapped in a slave.
    pub(super) fn run(
        &mut self,
        master: &mut Master,
        mapped: &mut dyn FnMut(u8, Option<ProcessData>),
    ) -> Option<Result<Configured, Refusal>> {
        while self.refusal.is_none() && self.next <= self.found.min(MAX_SLAVES as u8) && self.under_way.len() < AT_ONCE
        {
            let slave = self.next;
            self.next += 1;
            if self.config.selected.contains(slave) {
                self.begin(slave, master, mapped);
            }
        }
        let mut n = 0;
        while n < self.under_way.len() {
            let one = &mut self.under_way[n];
            match one.ended.take() {
                None => n += 1,
                Some(ended) => {
                    let one = self.under_way.swap_remove(n);
                    self.go_on(one, ended, master, mapped);
                }
            }
        }
        let all_begun = self.refusal.is_some() || self.next > self.found.min(MAX_SLAVES as u8);
        if !self.under_way.is_empty() || !all_begun {
            return None;
        }
        Some(match self.refusal {
            Some(refusal) => Err(refusal),
            None => Ok(Configured { second_axes: self.second_axes, ..Configured::default() }),
        })
    }

    /// A slave has refused: of several the first one is told.
    fn refuse(&mut self, refusal: Refusal) {
        if self.refusal.is_none_or(|before| refusal.slave < before.slave) {
            self.refusal = Some(refusal);
        }
    }

    fn begin(&mut self, slave: u8, master: &mut Master, mapped: &mut dyn FnMut(u8, Option<ProcessData>)) {
        let SlaveConfig { role, .. } = self.config.slaves[usize::from(slave) - 1];
        // A slave that did not answer when the master looked last may answer now: its first SDO shows it.
        let present = master.status(slave).filter(|status| status.is_present);
        if present.is_some_and(|status| status.state() != Some(AlState::PreOp)) {
            let AlStatus(al_status) = AlStatus::INVALID_CHANGE;
            return self.refuse(Refusal { slave, al_status, abort: None });
        }
        // A slave that is not used does not have to answer (SK-4 [OURS]).
        if role == Role::Unused {
            mapped(slave, None);
            // Without process data none can be too long.
            let _ = master.configure(slave, 0, 0);
            return;
        }
        if master.slave(slave).is_some_and(SlaveInfo::assumes_managers) {
            return self.ask_for_manager_use(slave, 0, 0, [SiiSmType::Unused; MANAGERS_MAX], master);
        }
        self.begin_mapping(slave, master, mapped);
    }

    fn ask_for_manager_use(
        &mut self,
        slave: u8,
        sub: u8,
        count: u8,
        uses: [SiiSmType; MANAGERS_MAX],
        master: &mut Master,
    ) {
        let transfer = ask_for_manager_use(slave, sub, master);
        let stage = Stage::ManagerUses { sub, count, uses };
        self.under_way.push(OneSlave { slave, transfer, stage, ended: None, tries: 0 });
    }

    /// The slave has said what a sync manager is for, or how many there are.
    fn take_manager_use(
        &mut self,
        slave: u8,
        (sub, count, mut uses): (u8, u8, [SiiSmType; MANAGERS_MAX]),
        answer: Option<u32>,
        master: &mut Master,
        mapped: &mut dyn FnMut(u8, Option<ProcessData>),
    ) {
        let code = answer.map(|value| value as u8);
        let count = if sub == 0 { code.unwrap_or(0).min(MANAGERS_MAX as u8) } else { count };
        if let Some(place) = sub.checked_sub(1).and_then(|n| uses.get_mut(usize::from(n))) {
            *place = SiiSmType::from_code(code.unwrap_or(0));
        }
        if sub < count {
            return self.ask_for_manager_use(slave, sub + 1, count, uses, master);
        }
        if uses.iter().any(|one| matches!(one, SiiSmType::Outputs | SiiSmType::Inputs)) {
            // It is a slave, and its EEPROM says nothing: that was why it was asked.
            let _ = master.assume_managers(slave, &uses);
        }
        self.begin_mapping(slave, master, mapped);
    }

    fn begin_mapping(&mut self, slave: u8, master: &mut Master, mapped: &mut dyn FnMut(u8, Option<ProcessData>)) {
        let SlaveConfig { role, .. } = self.config.slaves[usize::from(slave) - 1];
        if role == Role::Io && master.slave(slave).is_some_and(|info| info.lacks_coe() && is_described(info)) {
            return self.take_as_described(slave, master, mapped);
        }
        if matches!(role, Role::Hsp(_)) {
            let transfer = ask_for_second_axis(slave, master);
            let stage = Stage::SecondAxis;
            self.under_way.push(OneSlave { slave, transfer, stage, ended: None, tries: 0 });
        } else {
            self.write_first(slave, false, master);
        }
    }

    /// A module that cannot map what the board maps has the process data that its EEPROM describes, whatever their length; see
    /// [`super::cycle`].
    fn take_as_described(&mut self, slave: u8, master: &mut Master, mapped: &mut dyn FnMut(u8, Option<ProcessData>)) {
        match master.configure_as_described(slave).and_then(|()| master.set_sync(slave, None)) {
            Ok(()) => mapped(slave, ProcessData::of(Role::Io, false)),
            Err(_) => self.refuse_outputs(slave),
        }
    }

    /// The master cannot exchange the process data of a slave.
    fn refuse_outputs(&mut self, slave: u8) {
        let AlStatus(al_status) = AlStatus::INVALID_OUTPUTS;
        self.refuse(Refusal { slave, al_status, abort: None });
    }

    fn write_first(&mut self, slave: u8, has_second_axis: bool, master: &mut Master) {
        let SlaveConfig { role, sync } = self.config.slaves[usize::from(slave) - 1];
        let Some(data) = ProcessData::of(role, has_second_axis) else {
            return self.refuse(Refusal { slave, ..pdo::NO_SUCH_MODE });
        };
        self.write_next(slave, Wanted::Mapped(data), Left::Mapping(data.downloads(sync).into_iter()), master);
    }

    /// Goes on with the next download. False: there is none.
    fn write_next(&mut self, slave: u8, wanted: Wanted, mut left: Left, master: &mut Master) -> bool {
        let Some(current) = left.next() else { return false };
        let transfer = download(slave, &current, master);
        let stage = Stage::Writing { wanted, left, current, refused: None };
        self.under_way.push(OneSlave { slave, transfer, stage, ended: None, tries: 0 });
        true
    }

    /// A slave has aborted a download, or what it holds is something else. An IO module has its own process data then, if its
    /// EEPROM describes some: the PDOs are assigned that are there from the start.
    fn cannot_map(
        &mut self,
        refusal: Refusal,
        (wanted, current, code): (Wanted, Download, AbortCode),
        master: &mut Master,
    ) {
        let slave = refusal.slave;
        let object = object_in(slave, &current, master);
        let refusal = Refusal { abort: Some((object, code)), ..refusal };
        let SlaveConfig { role, .. } = self.config.slaves[usize::from(slave) - 1];
        let may_have_own = role == Role::Io && matches!(wanted, Wanted::Mapped(_)) && current.is_mapping();
        let Some(info) = master.slave(slave).filter(|info| may_have_own && is_described(info)) else {
            return self.refuse(refusal);
        };
        let [outputs, inputs] = info.assigned_pdos();
        let downloads = Download::assigning(&outputs, &inputs).into_iter();
        self.write_next(slave, Wanted::Described, Left::Assigning(downloads), master);
    }

    fn go_on(
        &mut self,
        one: OneSlave,
        ended: Result<Option<u32>, SdoError>,
        master: &mut Master,
        mapped: &mut dyn FnMut(u8, Option<ProcessData>),
    ) {
        let OneSlave { slave, tries, stage, .. } = one;
        let ended = match ended {
            Ok(read) => Ok(read),
            Err(SdoError::Abort(code)) => Err(code),
            Err(BUSY) if tries < TRIES => {
                let transfer = match &stage {
                    Stage::ManagerUses { sub, .. } => ask_for_manager_use(slave, *sub, master),
                    Stage::SecondAxis => ask_for_second_axis(slave, master),
                    Stage::Writing { current, refused: None, .. } => download(slave, current, master),
                    Stage::Writing { current, .. } => upload(slave, current, master),
                };
                return self.under_way.push(OneSlave { slave, transfer, stage, ended: None, tries: tries + 1 });
            }
            Err(SdoError::Mailbox(MailboxError::NoAnswer)) => {
                return self.refuse(Refusal { slave, al_status: 0, abort: None });
            }
            // The slave answers, but not in time, or wrongly.
            Err(error) => {
                let abort = Some((stage.object(slave, master), error.abort_code()));
                return self.refuse(Refusal { slave, al_status: 0, abort });
            }
        };
        match stage {
            Stage::ManagerUses { sub, count, uses } => {
                self.take_manager_use(slave, (sub, count, uses), ended.ok().flatten(), master, mapped);
            }
            Stage::SecondAxis => {
                if ended.is_ok() {
                    self.second_axes.insert(slave);
                }
                self.write_first(slave, ended.is_ok(), master);
            }
            // What is fixed and as it is wanted need not be written.
            Stage::Writing { wanted, current, refused: Some(code), .. }
                if !is_as_wanted(slave, &current, ended, master) =>
            {
                self.cannot_map(Refusal { slave, ..current.refused(code) }, (wanted, current, code), master);
            }
            Stage::Writing { wanted, left, current, refused } => {
                if let Err(code) = ended
                    && refused.is_none()
                    && !current.may_fail_with(code)
                {
                    if !current.may_be_fixed() {
                        let refusal = Refusal { slave, ..current.refused(code) };
                        return self.cannot_map(refusal, (wanted, current, code), master);
                    }
                    if !current.takes_away() {
                        let transfer = upload(slave, &current, master);
                        let stage = Stage::Writing { wanted, left, current, refused: Some(code) };
                        return self.under_way.push(OneSlave { slave, transfer, stage, ended: None, tries: 0 });
                    }
                }
                if self.write_next(slave, wanted, left, master) {
                    return;
                }
                let Wanted::Mapped(data) = wanted else { return self.take_as_described(slave, master, mapped) };
                let SlaveConfig { sync, .. } = self.config.slaves[usize::from(slave) - 1];
                let cycle_ns = u32::try_from(self.config.cycle.ns()).unwrap_or(u32::MAX);
                // Outputs have arrived then if the answer has come in time, however late the frame was.
                let shift_ns = u32::try_from(answer_wait_ns(self.config.cycle)).unwrap_or(u32::MAX);
                let sync = (sync == DriveSync::DcSync).then(|| SyncSignals::sync0(cycle_ns, shift_ns.cast_signed()));
                let configured = master
                    .configure(slave, data.output_bytes() as u16, data.input_bytes() as u16)
                    .and_then(|()| master.set_sync(slave, sync));
                match configured {
                    Ok(()) => mapped(slave, Some(data)),
                    Err(_) => self.refuse_outputs(slave),
                }
            }
        }
    }
}

/// Whether an object that a slave does not let be written holds what is wanted, or is one that it may lack. The EEPROM says what is
/// assigned in a slave whose objects do not say it.
fn is_as_wanted(slave: u8, wanted: &Download, held: Result<Option<u32>, AbortCode>, master: &Master) -> bool {
    match held {
        Ok(value) => value == Some(wanted.value),
        Err(code) if wanted.may_fail_with(code) => true,
        Err(_) => master.slave(slave).is_some_and(|info| wanted.is_assigned_in(&info.assigned_pdos())),
    }
}

/// Whether an EEPROM describes process data.
fn is_described(info: &SlaveInfo) -> bool {
    info.outputs.iter().chain(&info.inputs).any(|one| one.registers.len > 0)
}

fn read(slave: u8, object: ObjectAddress, master: &mut Master) -> Transfer {
    Transfer::Upload(master.upload_number(slave, object, SdoScope::Entry, SDO_TIMEOUT_NS))
}

fn ask_for_second_axis(slave: u8, master: &mut Master) -> Transfer {
    read(slave, pdo::SECOND_CONTROLWORD, master)
}

fn ask_for_manager_use(slave: u8, sub: u8, master: &mut Master) -> Transfer {
    read(slave, ObjectAddress::new(MANAGER_USES, sub), master)
}

/// The object of a slave that a download is for.
fn object_in(slave: u8, download: &Download, master: &Master) -> ObjectAddress {
    let first = |managers: &[ProcessManager]| managers.first().map(|one| one.number);
    let managers = master.slave(slave).map_or([None; 2], |info| [first(&info.outputs), first(&info.inputs)]);
    download.object_for(managers)
}

fn download(slave: u8, download: &Download, master: &mut Master) -> Transfer {
    let object = object_in(slave, download, master);
    let bytes = &download.value.to_le_bytes()[..usize::from(download.size.bytes())];
    Transfer::Download(master.download(slave, object, SdoScope::Entry, bytes, SDO_TIMEOUT_NS))
}

fn upload(slave: u8, download: &Download, master: &mut Master) -> Transfer {
    read(slave, object_in(slave, download, master), master)
}
