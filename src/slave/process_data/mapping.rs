//! The objects for mapping process data (ETG.1000.6 5.6.7.4): PDO mapping 0x1600..=0x17FF (RxPDO: outputs) and
//! 0x1A00..=0x1BFF (TxPDO: inputs), and the assignment of PDOs to sync managers 2 (0x1C12) and 3 (0x1C13).
//!
//! Each of these objects is a list: sub-index 0 is the count, and the items follow. An item of a PDO mapping is
//! `index << 16 | sub-index << 8 | bits`, or padding, for which only the bits are given; an item of an assignment is the
//! index of a PDO. All are written in PreOP only, in the usual order: count 0, then the items, then the count. \[OURS] A
//! PDO may be changed while it is assigned, because a mapping takes effect only on the change to SafeOP. A count may be
//! changed to another value without writing 0 first.

use crate::ethercat::AlState;
use crate::ethercat::coe::{AbortCode, ObjectAddress, ObjectCode, SdoScope};
use crate::slave::dictionary::{
    DataType, DataTypeCode, EntryDescription, MAPPING_ACCESS, NUMBER_OF_ENTRIES, ObjectDescription, PdoDirection,
    number_of, put_first,
};

/// The maximum number of entries of a PDO of most kinds of device \[OURS], see [`MappingLimits`].
pub const ENTRIES_MAX: usize = 16;
/// The capacity of a list of entries or of assigned PDOs, items. It is the largest [`MappingLimits::entries`] of all
/// kinds of device: the DP3CL has 24.
const ITEMS_ROOM: usize = 24;
/// The maximum number of assigned PDOs per direction of most kinds of device \[OURS], see [`MappingLimits`].
pub const PDOS_MAX: usize = 8;
/// The maximum number of process data bytes per direction \[OURS].
pub const IMAGE_BYTES_MAX: usize = 64;

/// The limits of the PDO mapping of a kind of device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MappingLimits {
    /// The maximum number of entries of a PDO, at most 24, the capacity of a list.
    pub entries: usize,
    /// The maximum number of assigned PDOs per direction, at most 24, the capacity of a list.
    pub pdos: usize,
    /// The maximum number of process data bytes per direction, at most [`IMAGE_BYTES_MAX`].
    pub image_bytes: usize,
    /// Whether padding entries, which have no object, are allowed.
    pub padding: bool,
    /// Whether a PDO that is too long is refused when it is written, with [`AbortCode::PDO_LENGTH`]. Otherwise the change
    /// to SafeOP is refused.
    pub long_pdos_refused: bool,
}

impl MappingLimits {
    /// The limits of most kinds of device.
    pub const USUAL: Self = Self {
        entries: ENTRIES_MAX,
        pdos: PDOS_MAX,
        image_bytes: IMAGE_BYTES_MAX,
        padding: true,
        long_pdos_refused: true,
    };
}

const RX_ASSIGNMENT: u16 = 0x1C12;
const TX_ASSIGNMENT: u16 = 0x1C13;

/// A PDO of a device at power-on.
pub struct Pdo<D> {
    /// The index of the mapping object: 0x1600..=0x17FF or 0x1A00..=0x1BFF.
    pub index: u16,
    /// The mapping entries, at most [`ENTRIES_MAX`].
    pub entries: &'static [u32],
    /// Whether the PDO is assigned at power-on.
    pub assigned: bool,
    /// A function that copies the whole PDO, used while the PDO has these entries. If a master has mapped other entries, they
    /// are copied one by one.
    pub mover: Mover<D>,
}

impl<D> Pdo<D> {
    /// A PDO that is empty and not assigned.
    pub const fn empty(index: u16) -> Self {
        let mover = match direction_of(index) {
            PdoDirection::Rx => Mover::Outputs(|_, _| ()),
            PdoDirection::Tx => Mover::Inputs(|_, _| ()),
        };
        Self { index, entries: &[], assigned: false, mover }
    }
}

/// A function that copies a whole PDO between the device and the beginning of an image.
pub enum Mover<D> {
    /// Copies outputs from the image to the device.
    Outputs(fn(&mut D, &[u8])),
    /// Copies inputs from the device to the image.
    Inputs(fn(&D, &mut [u8])),
}

/// The direction of a PDO mapping or of an assignment object.
const fn direction_of(index: u16) -> PdoDirection {
    match index {
        0x1600..=0x17FF | RX_ASSIGNMENT => PdoDirection::Rx,
        _ => PdoDirection::Tx,
    }
}

/// One PDO mapping object or assignment object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::slave) struct MappingList {
    index: u16,
    count: u8,
    /// The maximum number of entries of the PDO, or of assigned PDOs.
    items_max: u8,
    items: [u32; ITEMS_ROOM],
}

impl MappingList {
    fn new(index: u16, items_max: usize, items: impl Iterator<Item = u32>) -> Self {
        let items_max = items_max.min(ITEMS_ROOM) as u8;
        let mut list = Self { index, count: 0, items_max, items: [0; ITEMS_ROOM] };
        for (place, item) in list.items.iter_mut().zip(items) {
            *place = item;
            list.count += 1;
        }
        list
    }

    const fn is_assignment(&self) -> bool {
        matches!(self.index, RX_ASSIGNMENT | TX_ASSIGNMENT)
    }

    const fn name(&self) -> &'static str {
        match (self.is_assignment(), direction_of(self.index)) {
            (true, PdoDirection::Rx) => "RxPDO assignment",
            (true, PdoDirection::Tx) => "TxPDO assignment",
            (false, PdoDirection::Rx) => "RxPDO mapping",
            (false, PdoDirection::Tx) => "TxPDO mapping",
        }
    }

    const fn items_max(&self) -> usize {
        self.items_max as usize
    }

    const fn item_bytes(&self) -> usize {
        if self.is_assignment() { 2 } else { 4 }
    }

    /// The active items of the list. Their number is the count, sub-index 0.
    fn items(&self) -> &[u32] {
        &self.items[..usize::from(self.count).min(ITEMS_ROOM)]
    }

    /// The value at a sub-index, and its size in bytes. `None`: the object has no such sub-index.
    fn value(&self, sub: u8) -> Option<(u32, usize)> {
        match sub {
            0 => Some((self.count.into(), 1)),
            sub if usize::from(sub) <= self.items_max() => Some((self.items[usize::from(sub) - 1], self.item_bytes())),
            _ => None,
        }
    }
}

/// The PDO mapping objects and assignment objects of a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mapping {
    lists: Box<[MappingList]>,
    limits: MappingLimits,
}

impl Mapping {
    /// The mapping of a device with these limits and these PDOs at power-on.
    pub fn new<D>(pdos: &[Pdo<D>], limits: MappingLimits) -> Self {
        let assignment = |index| {
            let assigned =
                pdos.iter().filter(move |pdo| pdo.assigned && direction_of(pdo.index) == direction_of(index));
            MappingList::new(index, limits.pdos, assigned.map(|pdo| pdo.index.into()))
        };
        let lists = pdos.iter().map(|pdo| MappingList::new(pdo.index, limits.entries, pdo.entries.iter().copied()));
        Self { lists: lists.chain([RX_ASSIGNMENT, TX_ASSIGNMENT].map(assignment)).collect(), limits }
    }

    /// The limits of the mapping.
    pub const fn limits(&self) -> &MappingLimits {
        &self.limits
    }

    /// The lowest index of a mapping or assignment object from `from` on; `None` if there is none.
    pub fn index_from(&self, from: u16) -> Option<u16> {
        self.lists.iter().map(|list| list.index).filter(|index| *index >= from).min()
    }

    /// The description of a mapping or assignment object for SDO information. `None`: none of them has
    /// this index.
    pub fn describe_object(&self, index: u16) -> Option<ObjectDescription<'static>> {
        let list = self.list(index)?;
        let (code, data_type) = if list.is_assignment() {
            (ObjectCode::Array, DataTypeCode::of(DataType::U16))
        } else {
            (ObjectCode::Record, DataTypeCode::PDO_MAPPING)
        };
        Some(ObjectDescription { index, data_type, max_sub: list.items_max, code, name: list.name() })
    }

    /// The description of a sub-index of a mapping or assignment object for SDO information. `None`: the device has no
    /// such object or sub-index.
    pub fn describe_entry(&self, at: ObjectAddress) -> Option<EntryDescription<'static>> {
        let list = self.list(at.index)?;
        let (_, bytes) = list.value(at.sub)?;
        let (data, name) = match bytes {
            1 => (DataType::U8, NUMBER_OF_ENTRIES),
            2 => (DataType::U16, "PDO"),
            _ => (DataType::U32, "Mapped object"),
        };
        Some(EntryDescription {
            at,
            data_type: DataTypeCode::of(data),
            bits: bytes as u16 * 8,
            access: MAPPING_ACCESS,
            values: None,
            name,
        })
    }

    fn list(&self, index: u16) -> Option<&MappingList> {
        self.lists.iter().find(|list| list.index == index)
    }

    /// Whether `index` is a mapping or an assignment object.
    pub fn has(&self, index: u16) -> bool {
        self.list(index).is_some()
    }

    /// The assigned PDOs of one direction in the order of their assignment: index and entries.
    pub(super) fn assigned(&self, direction: PdoDirection) -> impl Iterator<Item = (u16, &[u32])> {
        let assignment = match direction {
            PdoDirection::Rx => RX_ASSIGNMENT,
            PdoDirection::Tx => TX_ASSIGNMENT,
        };
        let assigned = self.list(assignment).into_iter().flat_map(MappingList::items);
        let pdos = assigned.filter_map(|index| self.list(u16::try_from(*index).ok()?));
        pdos.map(|pdo| (pdo.index, pdo.items()))
    }

    /// SDO upload of a mapping or assignment object, with the parameters and the result of
    /// [`dictionary::read`](crate::slave::dictionary::read).
    pub(in crate::slave) fn read(
        &self,
        at: ObjectAddress,
        scope: SdoScope,
        value: &mut [u8],
    ) -> Result<usize, AbortCode> {
        let list = self.list(at.index).ok_or(AbortCode::NO_OBJECT)?;
        match scope {
            SdoScope::Entry => {
                let (number, bytes) = list.value(at.sub).ok_or(AbortCode::NO_SUB_INDEX)?;
                Ok(put_first(&number.to_le_bytes()[..bytes], value))
            }
            SdoScope::Complete => {
                let mut len = match at.sub {
                    0 => put_first(&[list.count, 0], value),
                    1 => 0,
                    _ => return Err(AbortCode::UNSUPPORTED_ACCESS),
                };
                for item in list.items() {
                    let room = value.get_mut(len..).unwrap_or_default();
                    len += put_first(&item.to_le_bytes()[..list.item_bytes()], room);
                }
                Ok(len)
            }
        }
    }

    /// SDO download: returns the changed list without storing it; [`Self::put`] stores it. `may_map` checks whether an
    /// entry may be mapped into a PDO of a direction.
    ///
    /// # Errors
    /// [`AbortCode::NO_SUB_INDEX`]; [`AbortCode::TOO_LONG`], [`AbortCode::TOO_SHORT`] or [`AbortCode::LENGTH`] for a
    /// transfer of the wrong length; [`AbortCode::DEVICE_STATE`] outside PreOP; [`AbortCode::SUB_INDEX_READ_ONLY`] for
    /// an item while the count is not 0; [`AbortCode::VALUE_HIGH`] for a count that is too high;
    /// [`AbortCode::NOT_MAPPABLE`] and the codes of `may_map` for items; [`AbortCode::PDO_LENGTH`] for a PDO longer
    /// than [`MappingLimits::image_bytes`] (at most [`IMAGE_BYTES_MAX`]), if [`MappingLimits::long_pdos_refused`] is
    /// set; [`AbortCode::PARAMETER_INCOMPATIBLE`] for a PDO that is assigned twice.
    pub(in crate::slave) fn written(
        &self,
        at: ObjectAddress,
        scope: SdoScope,
        value: &[u8],
        state: AlState,
        may_map: impl Fn(PdoDirection, u32) -> Result<(), AbortCode>,
    ) -> Result<MappingList, AbortCode> {
        let mut list = *self.list(at.index).ok_or(AbortCode::NO_OBJECT)?;
        let in_preop = || if state == AlState::PreOp { Ok(()) } else { Err(AbortCode::DEVICE_STATE) };
        match scope {
            SdoScope::Entry => {
                let (_, bytes) = list.value(at.sub).ok_or(AbortCode::NO_SUB_INDEX)?;
                match value.len() {
                    len if len > bytes => return Err(AbortCode::TOO_LONG),
                    len if len < bytes => return Err(AbortCode::TOO_SHORT),
                    _ => in_preop()?,
                }
                let number = number_of(value) as u32;
                match at.sub {
                    0 => list.count = count_of(&list, number)?,
                    _ if list.count != 0 => return Err(AbortCode::SUB_INDEX_READ_ONLY),
                    sub => {
                        if number != 0 {
                            self.check_item(&list, number, &may_map)?;
                        }
                        list.items[usize::from(sub) - 1] = number;
                    }
                }
            }
            SdoScope::Complete => {
                if at.sub != 0 {
                    // [OURS] Complete access from sub-index 1 on is refused, because it does not write the count, sub-index 0.
                    return Err(AbortCode::UNSUPPORTED_ACCESS);
                }
                let (count, items) = value.split_at_checked(2).ok_or(AbortCode::LENGTH)?;
                let count = count_of(&list, count[0].into())?;
                if items.len() != usize::from(count) * list.item_bytes() {
                    return Err(AbortCode::LENGTH);
                }
                in_preop()?;
                let items = items.chunks_exact(list.item_bytes()).map(|item| number_of(item) as u32);
                list = MappingList::new(list.index, list.items_max(), items);
            }
        }
        self.check(&list, &may_map)?;
        Ok(list)
    }

    /// Replaces the list that has the same index as `list`.
    pub(in crate::slave) fn put(&mut self, list: MappingList) {
        if let Some(place) = self.lists.iter_mut().find(|old| old.index == list.index) {
            *place = list;
        }
    }

    /// Checks each item of a list, and that the items together are not too long and name no PDO twice.
    fn check(
        &self,
        list: &MappingList,
        may_map: &impl Fn(PdoDirection, u32) -> Result<(), AbortCode>,
    ) -> Result<(), AbortCode> {
        let items = list.items();
        items.iter().try_for_each(|item| self.check_item(list, *item, may_map))?;
        let bits: usize = items.iter().map(|item| (item & 0xFF) as usize).sum();
        if !list.is_assignment() {
            let is_refused = self.limits.long_pdos_refused && bits > self.limits.image_bytes * 8;
            return if is_refused { Err(AbortCode::PDO_LENGTH) } else { Ok(()) };
        }
        let twice = items.iter().enumerate().any(|(n, item)| items[..n].contains(item));
        if twice { Err(AbortCode::PARAMETER_INCOMPATIBLE) } else { Ok(()) }
    }

    fn check_item(
        &self,
        list: &MappingList,
        item: u32,
        may_map: &impl Fn(PdoDirection, u32) -> Result<(), AbortCode>,
    ) -> Result<(), AbortCode> {
        let direction = direction_of(list.index);
        if !list.is_assignment() {
            let is_padding = item >> 8 == 0;
            return if is_padding && !self.limits.padding {
                Err(AbortCode::NOT_MAPPABLE)
            } else {
                may_map(direction, item)
            };
        }
        let pdo = u16::try_from(item).ok().and_then(|index| self.list(index));
        let fits = pdo.is_some_and(|pdo| !pdo.is_assignment() && direction_of(pdo.index) == direction);
        if fits { Ok(()) } else { Err(AbortCode::NOT_MAPPABLE) }
    }
}

fn count_of(list: &MappingList, number: u32) -> Result<u8, AbortCode> {
    let count = u8::try_from(number).ok().filter(|count| usize::from(*count) <= list.items_max());
    count.ok_or(AbortCode::VALUE_HIGH)
}
