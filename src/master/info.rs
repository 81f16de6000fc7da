//! What a scan finds out about a slave.

use super::{SiiError, Upstream, sii_error};
use crate::ethercat::registers::{BufferMode, DlStatus, Features, SmControl, SmDirection, SyncManager};
use crate::ethercat::sii::{
    CategoryKind, CoeDetails, MailboxAreas, MailboxProtocols, Sii, SiiGeneralFlags, SiiIdentity, SiiPdo, SiiSmEnable,
    SiiSmType, SiiSyncManager,
};
use crate::ethercat::{DATA_LEN_MAX, WireError};

/// \[OURS] The shortest mailbox that the master uses: an SDO with its headers has room in it.
pub const MAILBOX_BYTES_MIN: u16 = 16;
/// The longest mailbox, which is what one datagram carries.
pub const MAILBOX_BYTES_MAX: u16 = DATA_LEN_MAX as u16;

/// \[OURS] Where the process data of a slave lie whose EEPROM has no sync managers for them: behind its mailboxes, at a multiple of
/// this, outputs first, each with room for three buffers of 128 bytes at least.
const AREA_ALIGN: u16 = 0x80;
const AREA_ROOM: u16 = 3 * 128;

/// What is said about a slave's mailbox.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MailboxInfo {
    /// Where both mailboxes lie.
    pub areas: MailboxAreas,
    /// Which protocols it speaks.
    pub protocols: MailboxProtocols,
    /// What its CANopen can do.
    pub coe: CoeDetails,
}

/// A sync manager for process data as the slave describes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProcessManager {
    /// Its number.
    pub number: u8,
    /// Its registers, with the length that the slave's own PDOs have.
    pub registers: SyncManager,
}

/// A slave as a scan has found it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SlaveInfo {
    /// The station address that the master has given it.
    pub station: u16,
    /// The station alias, 0: none.
    pub alias: u16,
    /// Who it is.
    pub identity: SiiIdentity,
    /// Its name, as [`SiiText`](crate::ethercat::sii::SiiText) shows it; empty if it says none.
    pub name: String,
    /// What its controller can do.
    pub features: Features,
    /// How many FMMUs it has.
    pub fmmus: u8,
    /// How many sync managers it has.
    pub sync_managers: u8,
    /// Its ports.
    pub ports: DlStatus,
    /// Where it is connected; `None`: it is the first one.
    pub upstream: Option<Upstream>,
    /// The port by which frames come to it, as its clock says: 0, unless its IN and OUT are swapped, or if it has none.
    pub entry_port: u8,
    /// Its mailbox; `None`: it has none, or none that can be used.
    pub mailbox: Option<MailboxInfo>,
    /// Its sync managers for outputs.
    pub outputs: Vec<ProcessManager>,
    /// Its sync managers for inputs.
    pub inputs: Vec<ProcessManager>,
    /// It takes no LRW, as its controller or its EEPROM says.
    pub lacks_lrw: bool,
    /// The content of its EEPROM, as far as it was read, or why it was not. Without it the master knows of no mailbox
    /// and of no process data.
    pub eeprom: Result<Vec<u8>, SiiError>,
}

impl SlaveInfo {
    /// A slave of which only registers are known.
    pub(super) fn new(station: u16, eeprom: Result<Vec<u8>, SiiError>) -> Self {
        let mut info = Self {
            station,
            alias: 0,
            identity: SiiIdentity::default(),
            name: String::new(),
            features: Features::NONE,
            fmmus: 0,
            sync_managers: 0,
            ports: DlStatus::default(),
            upstream: None,
            entry_port: 0,
            mailbox: None,
            outputs: Vec::new(),
            inputs: Vec::new(),
            lacks_lrw: false,
            eeprom,
        };
        let bytes = info.eeprom.clone();
        if let Ok(sii) = bytes.as_deref().map_err(|_| ()).and_then(|bytes| Sii::new(bytes).map_err(|_| ())) {
            info.take_sii(&sii);
        }
        info
    }

    fn take_sii(&mut self, sii: &Sii<'_>) {
        let fixed = sii.info();
        self.identity = fixed.identity;
        let general = sii.all_of(CategoryKind::General).find_map(|category| category.general().ok());
        let coe = general.map_or(CoeDetails::NONE, |general| general.coe);
        if let Some(general) = general {
            let name = sii.text(general.name).or_else(|| sii.text(general.order));
            self.name = name.map_or_else(String::new, |name| name.to_string());
        }
        self.lacks_lrw = general.is_some_and(|general| general.flags.contains(SiiGeneralFlags::NO_LRW));
        let areas = fixed.mailbox;
        if fixed.protocols.0 != 0 && is_mailbox_len(areas.receive.len) && is_mailbox_len(areas.send.len) {
            self.mailbox = Some(MailboxInfo { areas, protocols: fixed.protocols, coe });
        }
        for (number, described) in (0..16).zip(sii.sync_managers()) {
            let (list, kind) = match use_of(sii, &described) {
                SiiSmType::Outputs => (&mut self.outputs, CategoryKind::RxPdos),
                SiiSmType::Inputs => (&mut self.inputs, CategoryKind::TxPdos),
                _ => continue,
            };
            // What the PDOs say counts more than the default length, which some slaves leave at 0.
            let len = pdo_bytes(sii, kind, number).unwrap_or(described.len);
            let registers = SyncManager::enabled(described.start, len, described.control);
            list.push(ProcessManager { number, registers });
        }
        if self.assumes_managers() {
            self.assume_managers(&[SiiSmType::MailboxOut, SiiSmType::MailboxIn, SiiSmType::Outputs, SiiSmType::Inputs]);
        }
    }

    /// Whether its EEPROM says nothing of sync managers for process data, although it has CANopen and so may have some: object 0x1C00
    /// says which they are, see [`Master::assume_managers`](super::Master::assume_managers).
    pub fn assumes_managers(&self) -> bool {
        let sii = self.eeprom.as_deref().ok().and_then(|bytes| Sii::new(bytes).ok());
        let is_process_data =
            |sii: &Sii<'_>, one: &SiiSyncManager| matches!(use_of(sii, one), SiiSmType::Outputs | SiiSmType::Inputs);
        let is_described = |sii: Sii<'_>| sii.sync_managers().any(|one| is_process_data(&sii, &one));
        !self.lacks_coe() && sii.is_some_and(|sii| !is_described(sii))
    }

    /// The sync managers are for that, number 0 first. The EEPROM says nothing of those for process data.
    pub(super) fn assume_managers(&mut self, uses: &[SiiSmType]) {
        let areas = self.mailbox.map(|mailbox| mailbox.areas).unwrap_or_default();
        let ends = [areas.receive, areas.send].map(|area| area.start.saturating_add(area.len));
        let mut start = next_area(ends[0].max(ends[1]));
        let eeprom = std::mem::replace(&mut self.eeprom, Err(SiiError::NoAnswer));
        let sii = eeprom.as_deref().ok().and_then(|bytes| Sii::new(bytes).ok());
        self.outputs.clear();
        self.inputs.clear();
        for (number, manager_use) in (0..).zip(uses) {
            let (list, control, kind) = match manager_use {
                SiiSmType::Outputs => (&mut self.outputs, SmControl::OUTPUTS, CategoryKind::RxPdos),
                SiiSmType::Inputs => (&mut self.inputs, SmControl::INPUTS, CategoryKind::TxPdos),
                _ => continue,
            };
            let len = sii.and_then(|sii| pdo_bytes(&sii, kind, number)).unwrap_or(0);
            list.push(ProcessManager { number, registers: SyncManager::enabled(start, len, control) });
            start = next_area(start.saturating_add(AREA_ROOM.max(len.saturating_mul(3))));
        }
        self.eeprom = eeprom;
    }

    /// How many bytes of its own outputs and inputs a slave has, as its EEPROM says; `None`: it says nothing of them, and the slave has
    /// objects that say it.
    pub fn described_bytes(&self) -> [Option<u16>; 2] {
        let is_read = self.eeprom.is_ok();
        [&self.outputs, &self.inputs].map(|managers| {
            let bytes = managers.iter().fold(0_u16, |sum, manager| sum.saturating_add(manager.registers.len));
            let is_said = bytes > 0 || managers.is_empty() || self.lacks_coe();
            (is_read && is_said).then_some(bytes)
        })
    }

    /// What is wrong with its EEPROM: why it was not read, or what of its content is not right; `None`: nothing is.
    pub fn eeprom_fault(&self) -> Option<SiiError> {
        self.eeprom.as_deref().map_or_else(|error| Some(*error), sii_error::fault)
    }

    /// Takes a sync manager for what the EEPROM should have said. False: it is one of a mailbox that there is not.
    pub(super) fn set_manager(&mut self, number: u8, registers: SyncManager) -> bool {
        if number < 2 {
            let areas = self.mailbox.as_mut().map(|mailbox| &mut mailbox.areas);
            let Some(areas) = areas.filter(|_| is_mailbox_len(registers.len)) else { return false };
            let area = if number == 0 { &mut areas.receive } else { &mut areas.send };
            (area.start, area.len) = (registers.start, registers.len);
            return true;
        }
        let is_written = registers.control.direction() == SmDirection::Write;
        let is_output = self.outputs.iter().any(|one| one.number == number);
        let is_input = self.inputs.iter().any(|one| one.number == number);
        let list = if is_output || is_written && !is_input { &mut self.outputs } else { &mut self.inputs };
        match list.iter_mut().find(|one| one.number == number) {
            Some(one) => one.registers = registers,
            None => list.push(ProcessManager { number, registers }),
        }
        true
    }

    /// Whether the slave has no CANopen: its EEPROM was read, and says so.
    pub fn lacks_coe(&self) -> bool {
        let has_coe = self.mailbox.is_some_and(|mailbox| mailbox.protocols.contains(MailboxProtocols::COE));
        self.eeprom.is_ok() && !has_coe
    }

    /// The indices of the PDOs that the EEPROM assigns to the sync managers of outputs, and of inputs.
    pub fn assigned_pdos(&self) -> [Vec<u16>; 2] {
        let sii = self.eeprom.as_deref().ok().and_then(|bytes| Sii::new(bytes).ok());
        let of = |kind, managers: &[ProcessManager]| {
            let is_in = |pdo: &SiiPdo<'_>| managers.iter().any(|manager| manager.number == pdo.sync_manager);
            sii.iter().flat_map(|sii| pdos(sii, kind)).filter(is_in).map(|pdo| pdo.index).collect()
        };
        [of(CategoryKind::RxPdos, &self.outputs), of(CategoryKind::TxPdos, &self.inputs)]
    }

    /// The registers of the two sync managers of the mailbox; `None`: the slave has none.
    pub(super) fn mailbox_managers(&self) -> Option<[SyncManager; 2]> {
        let MailboxAreas { receive, send } = self.mailbox?.areas;
        Some([
            SyncManager::enabled(receive.start, receive.len, SmControl::MAILBOX_OUT),
            SyncManager::enabled(send.start, send.len, SmControl::MAILBOX_IN),
        ])
    }
}

/// Whether a mailbox can be that long.
const fn is_mailbox_len(len: u16) -> bool {
    MAILBOX_BYTES_MIN <= len && len <= MAILBOX_BYTES_MAX
}

/// Where an area may begin that is not before this.
fn next_area(from: u16) -> u16 {
    from.checked_next_multiple_of(AREA_ALIGN).unwrap_or(u16::MAX)
}

/// What a sync manager is for. \[OURS] Of one that has a place and no type the control byte tells, if it is switched on or no one there
/// has a type: a single buffer is a mailbox.
fn use_of(sii: &Sii<'_>, manager: &SiiSyncManager) -> SiiSmType {
    let may_be_used =
        || manager.enable.contains(SiiSmEnable::ENABLE) || sii.sync_managers().all(|one| one.kind == SiiSmType::Unused);
    if manager.kind != SiiSmType::Unused || manager.start == 0 || !may_be_used() {
        return manager.kind;
    }
    match (manager.control.mode(), manager.control.direction()) {
        (BufferMode::Buffered, SmDirection::Write) => SiiSmType::Outputs,
        (BufferMode::Buffered, SmDirection::Read) => SiiSmType::Inputs,
        (BufferMode::Mailbox, SmDirection::Write) => SiiSmType::MailboxOut,
        (BufferMode::Mailbox, SmDirection::Read) => SiiSmType::MailboxIn,
        _ => SiiSmType::Unused,
    }
}

/// The PDOs of all categories of a kind; of each up to the first one that is none.
fn pdos<'s>(sii: &Sii<'s>, kind: CategoryKind) -> impl Iterator<Item = SiiPdo<'s>> + use<'s> {
    sii.all_of(kind).flat_map(|category| category.pdos().map_while(Result::<_, WireError>::ok))
}

/// How many bytes the PDOs have together that an EEPROM assigns to a sync manager; `None`: it assigns none.
fn pdo_bytes(sii: &Sii<'_>, kind: CategoryKind, manager: u8) -> Option<u16> {
    let mut bits = None;
    for pdo in pdos(sii, kind).filter(|pdo| pdo.sync_manager == manager) {
        let more: u32 = pdo.entries.iter().map(|entry| u32::from(entry.bits)).sum();
        bits = Some(bits.unwrap_or(0u32).saturating_add(more));
    }
    bits.map(|bits| u16::try_from(bits.div_ceil(8)).unwrap_or(u16::MAX))
}
