//! The SDO downloads that map the process data of a slave and set its mode of operation.

use super::ProcessData;
use crate::ethercat::AlStatus;
use crate::ethercat::cia402::{MODES_OF_OPERATION, SECOND_AXIS_OFFSET};
use crate::ethercat::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::fieldbus::Refusal;
use crate::sk::DriveSync;

/// The object that assigns RxPDOs to sync manager 2 (outputs).
const RX_ASSIGNMENT: u16 = 0x1C12;
/// The object that assigns TxPDOs to sync manager 3 (inputs).
const TX_ASSIGNMENT: u16 = 0x1C13;
/// The mapping object of the first axis's TxPDO.
const TX_PDO: u16 = 0x1A00;
/// \[OURS] The RxPDO of the first axis in CSP. The RxPDO for CSV is 0x1601, that for CST 0x1602. The PDOs of a second
/// axis are 16 higher, as in ETG.6010.
const RX_PDO: u16 = 0x1600;
const SECOND_AXIS_PDO_OFFSET: u16 = 0x10;
/// The object that assigns PDOs to sync manager 0. The objects of the other sync managers follow it.
const ASSIGNMENTS: u16 = 0x1C10;
/// The objects with the synchronization types of outputs and inputs.
const SYNC_TYPES: [u16; 2] = [0x1C32, 0x1C33];

/// An SDO download of the configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Download {
    /// The object that is written.
    pub object: ObjectAddress,
    /// How many bytes are written.
    pub size: SdoSize,
    /// The value that is written.
    pub value: u32,
    /// Whether it is no error if the slave lacks the object or has it as a constant.
    optional: bool,
}

impl Download {
    const UNUSED: Self = Self::new(0, 0, SdoSize::One, 0);

    const fn new(index: u16, sub: u8, size: SdoSize, value: u32) -> Self {
        Self { object: ObjectAddress::new(index, sub), size, value, optional: false }
    }

    /// Whether the configuration goes on if the slave aborts this download with the abort code `code`: the synchronization type
    /// is an object that a slave may lack, or that may be read-only.
    pub const fn may_fail_with(&self, code: AbortCode) -> bool {
        self.optional && matches!(code, AbortCode::NO_OBJECT | AbortCode::NO_SUB_INDEX | AbortCode::READ_ONLY)
    }

    /// Whether this download belongs to the mapping or assignment of process data, which are fixed in some slaves.
    pub const fn is_mapping(&self) -> bool {
        matches!(self.object.index, 0x1600..=TX_ASSIGNMENT)
    }

    /// The direction of the process data that this download maps or assigns; `None`: it does neither.
    pub const fn direction(&self) -> Option<MappedDirection> {
        match self.object.index {
            0x1600..=0x17FF | RX_ASSIGNMENT => Some(MappedDirection::Outputs),
            0x1A00..=0x1BFF | TX_ASSIGNMENT => Some(MappedDirection::Inputs),
            _ => None,
        }
    }

    /// Whether this download assigns PDOs to a sync manager.
    pub const fn is_assignment(&self) -> bool {
        assigns_pdos(self.object.index)
    }

    /// The object to write in a slave. `outputs` and `inputs`: the numbers of its first sync managers for outputs and
    /// for inputs. Each sync manager has its own object for the PDO assignment. Nearly all slaves use sync managers 2
    /// and 3.
    pub const fn object_for(&self, [outputs, inputs]: [Option<u8>; 2]) -> ObjectAddress {
        let manager = match self.object.index {
            RX_ASSIGNMENT => outputs,
            TX_ASSIGNMENT => inputs,
            _ => None,
        };
        match manager {
            Some(manager) => ObjectAddress::new(ASSIGNMENTS + manager as u16, self.object.sub),
            None => self.object,
        }
    }

    /// Whether this download sets a synchronization type.
    pub const fn is_sync_type(&self) -> bool {
        self.object.index == SYNC_TYPES[0] || self.object.index == SYNC_TYPES[1]
    }

    /// Whether this download empties the mapping of a PDO, before the downloads that fill it.
    pub const fn empties_pdo(&self) -> bool {
        self.direction().is_some() && !self.is_assignment() && self.takes_away()
    }

    /// The downloads that map these entries into a PDO. An entry has index, sub-index and bits, as in the mapping object.
    pub fn mapping(pdo: u16, entries: &[u32]) -> Vec<Self> {
        let number = |count| Self::new(pdo, 0, SdoSize::One, count);
        let entry = |(sub, entry): (u8, &u32)| Self::new(pdo, sub, SdoSize::Four, *entry);
        let entries: Vec<Self> = (1..=u8::MAX).zip(entries).map(entry).collect();
        let count = entries.len() as u32;
        std::iter::once(number(0)).chain(entries).chain([number(count)]).collect()
    }

    /// The downloads that assign these PDOs for outputs and for inputs, without changing their entries. A slave may lack
    /// the assignment objects, or have them as constants.
    pub fn assigning(outputs: &[u16], inputs: &[u16]) -> Vec<Self> {
        let mut downloads = Vec::new();
        for (assignment, pdos) in [(RX_ASSIGNMENT, outputs), (TX_ASSIGNMENT, inputs)] {
            let number = |count| Self::new(assignment, 0, SdoSize::One, count);
            let entry = |(sub, pdo): (u8, &u16)| Self::new(assignment, sub, SdoSize::Two, (*pdo).into());
            let entries: Vec<Self> = (1..=u8::MAX).zip(pdos).map(entry).collect();
            let count = entries.len() as u32;
            downloads.extend(std::iter::once(number(0)).chain(entries).chain([number(count)]));
        }
        downloads.iter_mut().for_each(|download| download.optional = true);
        downloads
    }

    /// Whether a slave may abort this download because its process data or its synchronization type are fixed. Then a
    /// read of the object shows whether the fixed value is the wanted one. Manufacturers use various abort codes for
    /// this case.
    pub const fn may_be_fixed(&self) -> bool {
        self.is_mapping() || self.optional
    }

    /// Whether a slave with these assigned PDOs (outputs, inputs) already has the value that this download writes.
    pub fn is_assigned_in(&self, [outputs, inputs]: &[Vec<u16>; 2]) -> bool {
        let assigned = match self.object.index {
            RX_ASSIGNMENT => outputs,
            TX_ASSIGNMENT => inputs,
            _ => return false,
        };
        let value = match self.object.sub.checked_sub(1) {
            None => Some(assigned.len() as u32),
            Some(n) => assigned.get(usize::from(n)).map(|pdo| u32::from(*pdo)),
        };
        value == Some(self.value)
    }

    /// Whether this download empties a list of mapping entries or PDOs, before the downloads that fill it.
    pub const fn takes_away(&self) -> bool {
        self.object.sub == 0 && self.value == 0
    }

    /// The refusal by a slave that has aborted this download. Its slave number is 0; the caller replaces it. \[OURS] If
    /// the slave cannot map what its role needs, or has no modes of operation, the refusal has the AL status code
    /// `AlStatus::INVALID_OUTPUTS`.
    pub const fn refused(&self, code: AbortCode) -> Refusal {
        let is_mode = self.object.index & !SECOND_AXIS_OFFSET == MODES_OF_OPERATION;
        if is_mode && !matches!(code, AbortCode::NO_OBJECT) {
            return Refusal { slave: 0, al_status: 0, abort: Some((self.object, code)) };
        }
        Refusal::of(0, AlStatus::INVALID_OUTPUTS)
    }
}

/// Which process data an object maps or assigns: outputs or inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MappedDirection {
    /// The process data from the master to the slave.
    Outputs,
    /// The process data from the slave to the master.
    Inputs,
}

impl MappedDirection {
    /// The object that assigns PDOs to the sync manager of this direction.
    pub const fn assignment(self, sub: u8) -> ObjectAddress {
        let index = match self {
            Self::Outputs => RX_ASSIGNMENT,
            Self::Inputs => TX_ASSIGNMENT,
        };
        ObjectAddress::new(index, sub)
    }
}

/// Whether the object with this index assigns PDOs to a sync manager.
const fn assigns_pdos(index: u16) -> bool {
    matches!(index, RX_ASSIGNMENT | TX_ASSIGNMENT)
}

/// The maximum length of a [`MappingImage`]: a count with its padding, and four entries of 4 bytes, as the TxPDO of a
/// drive has.
const MAPPING_IMAGE_MAX: usize = 2 + 4 * 4;

/// The content of a mapping or assignment object after a configuration, as an upload with complete access returns it:
/// the count and that many entries. An upload may continue with further, unused entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MappingImage {
    index: u16,
    direction: MappedDirection,
    bytes: [u8; MAPPING_IMAGE_MAX],
    len: usize,
}

impl MappingImage {
    /// The object, from sub-index 0 on.
    pub const fn object(&self) -> ObjectAddress {
        ObjectAddress::new(self.index, 0)
    }

    /// The direction of the process data that the object maps or assigns.
    pub const fn direction(&self) -> MappedDirection {
        self.direction
    }

    /// Whether the object assigns PDOs to a sync manager; otherwise it is the mapping of a PDO.
    pub const fn is_assignment(&self) -> bool {
        assigns_pdos(self.index)
    }

    /// Whether an upload with complete access shows this content. Entries beyond the count are not compared, because
    /// the slave does not use them.
    pub fn is_shown_by(&self, upload: &[u8]) -> bool {
        upload.starts_with(&self.bytes[..self.len])
    }
}

/// The refusal for a role that has no process data in its mode of operation. Its slave number is 0; the caller replaces
/// it.
pub const NO_SUCH_MODE: Refusal = Refusal {
    slave: 0,
    al_status: 0,
    abort: Some((ObjectAddress::new(MODES_OF_OPERATION, 0), AbortCode::VALUE_RANGE)),
};

/// The maximum number of downloads for one slave. A pulse module with two channels needs all 32: 2 that clear the
/// assignments, 13 for each direction, 2 modes, 2 synchronization types.
const DOWNLOADS_MAX: usize = 32;

/// The downloads of one slave, in their order: they map the inputs, write the mode of operation, and map the outputs for
/// that mode. In this order a slave that lacks the mode aborts the download to 0x6060 and not a download of the mapping
/// \[OURS].
#[derive(Clone, Copy, Debug)]
pub struct Downloads {
    list: [Download; DOWNLOADS_MAX],
    len: usize,
}

impl Downloads {
    pub(super) fn of(data: &ProcessData, sync: DriveSync) -> Self {
        let mut downloads = Self { list: [Download::UNUSED; DOWNLOADS_MAX], len: 0 };
        downloads.put(RX_ASSIGNMENT, 0, SdoSize::One, 0);
        downloads.put(TX_ASSIGNMENT, 0, SdoSize::One, 0);
        downloads.map(TX_ASSIGNMENT, TX_PDO, data.axes(), |axis| data.input_entries(axis));
        for (axis, mode) in (0..data.axes() as u16).zip(data.mode.into_iter().cycle()) {
            downloads.put(MODES_OF_OPERATION + SECOND_AXIS_OFFSET * axis, 0, SdoSize::One, mode.code().into());
        }
        let rx_pdo = RX_PDO + data.mode.map_or(0, |mode| u16::from(mode.code()) - 8);
        downloads.map(RX_ASSIGNMENT, rx_pdo, data.axes(), |axis| data.output_entries(axis));
        let sync_type = match sync {
            DriveSync::FreeRun => 0,
            DriveSync::DcSync => 2,
        };
        for index in SYNC_TYPES {
            downloads.push(Download { optional: true, ..Download::new(index, 1, SdoSize::Two, sync_type) });
        }
        downloads
    }

    /// The downloads in their order.
    pub fn iter(&self) -> impl Iterator<Item = &Download> {
        self.list[..self.len].iter()
    }

    /// The downloads from the first one to `last`.
    pub fn up_to(self, last: &Download) -> impl Iterator<Item = Download> + use<> {
        let count = self.list[..self.len].iter().position(|download| download == last).map_or(self.len, |at| at + 1);
        self.into_iter().take(count)
    }

    /// The contents of the mapping and assignment objects after these downloads.
    pub fn mapping_images(&self) -> impl Iterator<Item = MappingImage> {
        let list = &self.list[..self.len];
        let is_first = |n: usize| list[..n].iter().all(|before| before.object.index != list[n].object.index);
        let objects = (0..list.len()).filter(move |n| is_first(*n));
        objects.filter_map(|n| Some(self.mapping_image(list[n].object.index, list[n].direction()?)))
    }

    /// The downloads that write the entries of the object with this image, without the downloads of its count.
    pub fn entries(&self, image: &MappingImage) -> impl Iterator<Item = Download> {
        let index = image.index;
        let is_entry = move |download: &&Download| download.object.index == index && download.object.sub > 0;
        self.list[..self.len].iter().filter(is_entry).copied()
    }

    /// The content of the object with that index: the last written count, and the entries in the order of the downloads.
    fn mapping_image(&self, index: u16, direction: MappedDirection) -> MappingImage {
        let mut image = MappingImage { index, direction, bytes: [0; MAPPING_IMAGE_MAX], len: 2 };
        for download in self.list[..self.len].iter().filter(|download| download.object.index == index) {
            let size = usize::from(download.size.bytes());
            if download.object.sub == 0 {
                image.bytes[0] = download.value as u8;
            } else {
                image.bytes[image.len..][..size].copy_from_slice(&download.value.to_le_bytes()[..size]);
                image.len += size;
            }
        }
        image
    }

    /// Maps the entries of each axis into a PDO, and assigns the PDOs to their sync manager.
    fn map<E: ExactSizeIterator<Item = u32>>(
        &mut self,
        assignment: u16,
        pdo: u16,
        axes: usize,
        entries_of: impl Fn(usize) -> E,
    ) {
        let pdos = (0..axes).map(|axis| pdo + SECOND_AXIS_PDO_OFFSET * axis as u16);
        for (axis, pdo) in pdos.clone().enumerate() {
            let entries = entries_of(axis);
            let count = entries.len() as u32;
            self.put(pdo, 0, SdoSize::One, 0);
            for (sub, entry) in (1..).zip(entries) {
                self.put(pdo, sub, SdoSize::Four, entry);
            }
            self.put(pdo, 0, SdoSize::One, count);
        }
        for (sub, pdo) in (1..).zip(pdos) {
            self.put(assignment, sub, SdoSize::Two, pdo.into());
        }
        self.put(assignment, 0, SdoSize::One, axes as u32);
    }

    fn put(&mut self, index: u16, sub: u8, size: SdoSize, value: u32) {
        self.push(Download::new(index, sub, size, value));
    }

    fn push(&mut self, download: Download) {
        self.list[self.len] = download;
        self.len += 1;
    }
}

impl IntoIterator for Downloads {
    type Item = Download;
    type IntoIter = std::iter::Take<std::array::IntoIter<Download, DOWNLOADS_MAX>>;

    fn into_iter(self) -> Self::IntoIter {
        self.list.into_iter().take(self.len)
    }
}
