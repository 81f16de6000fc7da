//! The information that a scan collects about each slave.

use super::{SiiError, Upstream, sii_error};
use crate::ethercat::registers::{BufferMode, DlStatus, Features, SmControl, SmDirection, SyncManager};
use crate::ethercat::sii::{
    CategoryKind, CoeDetails, MailboxAreas, MailboxProtocols, Sii, SiiGeneralFlags, SiiIdentity, SiiPdo, SiiSmEnable,
    SiiSmType, SiiSyncManager,
};
use crate::ethercat::{DATA_LEN_MAX, WireError};

/// \[OURS] The shortest mailbox that the master uses, bytes: an SDO with its headers fits.
pub const MAILBOX_BYTES_MIN: u16 = 16;
/// The longest mailbox, bytes: the data of one datagram.
pub const MAILBOX_BYTES_MAX: u16 = DATA_LEN_MAX as u16;

/// \[OURS] The alignment, bytes, of the process data areas of a slave whose EEPROM describes no sync managers for
/// process data. These areas follow the mailboxes in the order of their sync managers, each with room for three buffers
/// of at least 128 bytes.
const AREA_ALIGN: u16 = 0x80;
const AREA_ROOM: u16 = 3 * 128;

/// The mailbox of a slave, as its EEPROM describes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MailboxInfo {
    /// Addresses and lengths of both mailboxes in the slave's memory.
    pub areas: MailboxAreas,
    /// The mailbox protocols that the slave supports.
    pub protocols: MailboxProtocols,
    /// The CoE services that the slave supports.
    pub coe: CoeDetails,
}

/// A sync manager for process data, as the slave describes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProcessManager {
    /// The number of the sync manager.
    pub number: u8,
    /// The registers of the sync manager. The length is the sum of the PDOs that the EEPROM assigns to the sync
    /// manager. If the EEPROM assigns none, the length is the one that it gives for the sync manager itself.
    pub registers: SyncManager,
}

/// A slave as a scan has found it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SlaveInfo {
    /// The station address that the master has assigned to the slave.
    pub station: u16,
    /// The station alias; 0: the slave has none.
    pub alias: u16,
    /// Vendor, product, revision and serial number.
    pub identity: SiiIdentity,
    /// The name of the slave, or else its order number, as [`SiiText`](crate::ethercat::sii::SiiText) shows it; empty
    /// if the EEPROM has neither.
    pub name: String,
    /// The features of the slave controller, register 0x0008, such as distributed clocks and LRW. [`Features::CLOCK`] is
    /// left out if the controller has no system time (0x0910).
    pub features: Features,
    /// The number of FMMUs of the slave controller.
    pub fmmus: u8,
    /// The number of sync managers of the slave controller.
    pub sync_managers: u8,
    /// The DL status of the slave: which ports have a link, and which are closed.
    pub ports: DlStatus,
    /// The slave and port to which this slave is connected; `None`: it is the first one.
    pub upstream: Option<Upstream>,
    /// The port by which frames enter the slave, from the receive times of its clock. It is 0 unless IN and OUT are
    /// swapped, and for a slave without a clock.
    pub entry_port: u8,
    /// The mailbox; `None`: the slave has no mailbox, or none that the master can use.
    pub mailbox: Option<MailboxInfo>,
    /// The sync managers for outputs.
    pub outputs: Vec<ProcessManager>,
    /// The sync managers for inputs.
    pub inputs: Vec<ProcessManager>,
    /// Whether the slave does not support LRW, by its controller or its EEPROM.
    pub lacks_lrw: bool,
    /// The content of the EEPROM, as far as it was read, or why it was not. Without it the master knows neither a
    /// mailbox nor process data of the slave.
    pub eeprom: Result<Vec<u8>, SiiError>,
}

impl SlaveInfo {
    /// A slave with this station address and EEPROM. All values that a scan reads from registers are 0 or empty.
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
            // The sum of the PDOs takes precedence over the default length, which some slaves leave at 0.
            let len = pdo_bytes(sii, kind, number).unwrap_or(described.len);
            let registers = SyncManager::enabled(described.start, len, described.control);
            list.push(ProcessManager { number, registers });
        }
        if self.assumes_managers() {
            self.assume_managers(&[SiiSmType::MailboxOut, SiiSmType::MailboxIn, SiiSmType::Outputs, SiiSmType::Inputs]);
        }
    }

    /// Whether the slave has CoE and its EEPROM describes no sync managers for process data. Its object 0x1C00 then
    /// gives their purposes, for [`Master::assume_managers`](super::Master::assume_managers).
    pub fn assumes_managers(&self) -> bool {
        let sii = self.eeprom.as_deref().ok().and_then(|bytes| Sii::new(bytes).ok());
        let is_process_data =
            |sii: &Sii<'_>, one: &SiiSyncManager| matches!(use_of(sii, one), SiiSmType::Outputs | SiiSmType::Inputs);
        let is_described = |sii: Sii<'_>| sii.sync_managers().any(|one| is_process_data(&sii, &one));
        !self.lacks_coe() && sii.is_some_and(|sii| !is_described(sii))
    }

    /// Sets the purposes of the sync managers, number 0 first, for a slave whose EEPROM describes none for process
    /// data.
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

    /// The lengths of the slave's default outputs and inputs, bytes, as its EEPROM gives them. `None`: the EEPROM was
    /// not read, or it gives no lengths and the slave has CoE, whose objects give them.
    pub fn described_bytes(&self) -> [Option<u16>; 2] {
        let is_read = self.eeprom.is_ok();
        [&self.outputs, &self.inputs].map(|managers| {
            let bytes = managers.iter().fold(0_u16, |sum, manager| sum.saturating_add(manager.registers.len));
            let is_said = bytes > 0 || managers.is_empty() || self.lacks_coe();
            (is_read && is_said).then_some(bytes)
        })
    }

    /// Why the EEPROM was not read, or what is wrong with its content; `None`: it is in order.
    pub fn eeprom_fault(&self) -> Option<SiiError> {
        self.eeprom.as_deref().map_or_else(|error| Some(*error), sii_error::fault)
    }

    /// Replaces what the EEPROM says about a sync manager. Returns false if it belongs to a mailbox that the slave does
    /// not have, or for which the length is not allowed.
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

    /// Whether the slave has no CoE, according to its EEPROM. False if the EEPROM was not read.
    pub fn lacks_coe(&self) -> bool {
        let has_coe = self.mailbox.is_some_and(|mailbox| mailbox.protocols.contains(MailboxProtocols::COE));
        self.eeprom.is_ok() && !has_coe
    }

    /// The indices of the PDOs that the EEPROM assigns to sync managers for outputs, and for inputs.
    pub fn assigned_pdos(&self) -> [Vec<u16>; 2] {
        let sii = self.eeprom.as_deref().ok().and_then(|bytes| Sii::new(bytes).ok());
        let of = |kind, managers: &[ProcessManager]| {
            let is_in = |pdo: &SiiPdo<'_>| managers.iter().any(|manager| manager.number == pdo.sync_manager);
            sii.iter().flat_map(|sii| pdos(sii, kind)).filter(is_in).map(|pdo| pdo.index).collect()
        };
        [of(CategoryKind::RxPdos, &self.outputs), of(CategoryKind::TxPdos, &self.inputs)]
    }

    /// The entries that the EEPROM gives for a PDO, as its mapping object has them: index, sub-index and bits. `None`: the
    /// EEPROM does not describe this PDO.
    pub fn pdo_entries(&self, pdo: u16) -> Option<Vec<u32>> {
        let sii = Sii::new(self.eeprom.as_deref().ok()?).ok()?;
        let mut described = [CategoryKind::RxPdos, CategoryKind::TxPdos].into_iter().flat_map(|kind| pdos(&sii, kind));
        let entries = described.find(|one| one.index == pdo)?.entries;
        Some(
            entries
                .iter()
                .map(|one| u32::from(one.index) << 16 | u32::from(one.sub) << 8 | u32::from(one.bits))
                .collect(),
        )
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

/// Whether a mailbox may have that length, bytes.
const fn is_mailbox_len(len: u16) -> bool {
    MAILBOX_BYTES_MIN <= len && len <= MAILBOX_BYTES_MAX
}

/// The first aligned address for a process data area from `from` on.
fn next_area(from: u16) -> u16 {
    from.checked_next_multiple_of(AREA_ALIGN).unwrap_or(u16::MAX)
}

/// The purpose of a sync manager. \[OURS] Some EEPROMs give a sync manager an address and no type. If it is enabled, or
/// no sync manager of the EEPROM has a type, the control byte gives the purpose: a single buffer is a mailbox.
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

/// The PDOs of all categories of a kind. In each category the list ends before the first invalid PDO.
fn pdos<'s>(sii: &Sii<'s>, kind: CategoryKind) -> impl Iterator<Item = SiiPdo<'s>> + use<'s> {
    sii.all_of(kind).flat_map(|category| category.pdos().map_while(Result::<_, WireError>::ok))
}

/// The sum of the PDOs that an EEPROM assigns to a sync manager, bytes; `None`: it assigns no PDO to it.
fn pdo_bytes(sii: &Sii<'_>, kind: CategoryKind, manager: u8) -> Option<u16> {
    let mut bits = None;
    for pdo in pdos(sii, kind).filter(|pdo| pdo.sync_manager == manager) {
        let more: u32 = pdo.entries.iter().map(|entry| u32::from(entry.bits)).sum();
        bits = Some(bits.unwrap_or(0u32).saturating_add(more));
    }
    bits.map(|bits| u16::try_from(bits.div_ceil(8)).unwrap_or(u16::MAX))
}
