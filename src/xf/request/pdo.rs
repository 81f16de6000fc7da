//! Requests for process data and their configuration.

use super::SlaveNumber;
use crate::ethercat::bits;
use crate::ethercat::coe::ObjectAddress;
use crate::xf::fields::FieldKind;
use crate::xf::layout::{FieldLayout, FieldList, FieldReader, FieldValue as _, FieldWriter, at, field_values, layout};
use crate::xf::value::choices;
use crate::xf::{Malformed, segment};

layout! {
    /// ECAT_PDO_CONFIG_GET, command code 9: returns the PDOs that [`PdoConfigRequest`] has read (XF EN 533).
    pub struct PdoConfigGet;
}

bits! {
    /// Bits of `i0` in [`PdoDataFifo`] and [`PdoData`], and of the return byte of their answers. The meaning of further
    /// bits in the vendor's header is unknown; they are kept.
    PdoOperation(u8) {
        /// Bit 0: write outputs; in an answer, outputs were written.
        WRITE = 1 << 0;
        /// Bit 1: read inputs; in an answer, inputs were read. In an answer of [`PdoDataFifo`] it is clear if the
        /// TxFIFO was empty (OBS).
        READ = 1 << 1;
        /// Bit 2, in [`PdoData`]: bits 0 and 1 are valid. Without it the chip writes and reads.
        VALID = 1 << 2;
        /// Bit 7, in an answer: the operation failed (OBS).
        FAILED = 1 << 7;
    }
}

field_values! {
    PdoOperation, 1, FieldKind::Bits(PdoOperation::NAMES), |bits| bits.0.into(), |bits| Ok(PdoOperation(bits as u8));
}

layout! {
    /// ECAT_PDO_DATA_FIFO_OP, command code 5: puts RxPDOs into the FIFO and takes TxPDOs out of it (XF EN 436).
    /// Parameter byte: number of PDOs; information byte `i0`: operation. The length field is the length of all RxPDOs
    /// together (OBS).
    pub struct PdoDataFifo<'d> {
        /// The number of PDOs to write, and the maximum number to read.
        pub count: u8 = par(),
        /// The operation: write, read or both.
        pub operation: PdoOperation = info(0),
        /// The RxPDOs, one after the other.
        pub data: &'d [u8] = tail(0),
    }

    /// ECAT_PDO_DATA_OP, command code 6: writes outputs and reads inputs directly, bypassing the FIFO (XF EN 452).
    /// Information bytes: `i0` operation; the data are one RxPDO.
    pub struct PdoData<'d> {
        /// The operation: write, read or both, with [`PdoOperation::VALID`].
        pub operation: PdoOperation = info(0),
        /// The RxPDO with the outputs of all slaves.
        pub data: &'d [u8] = tail(0),
    }

    /// ECAT_PDO_CONFIG_REQ, command code 8: reads the PDOs of a slave, which [`PdoConfigGet`] then returns (XF EN 517).
    /// Data, 4 bytes (@offset): @0 slave, @1 0, @2 u16 assignment.
    pub struct PdoConfigRequest {
        /// The slave whose PDOs are read.
        pub slave: SlaveNumber = at(0),
        /// Whether the outputs or the inputs are read.
        pub assignment: PdoAssignment = at(2),
    }
}

choices! {
    /// The object with the PDO assignment of a slave's sync manager: outputs or inputs.
    pub PdoAssignment(u16), "PDO assignment", "0x1C12 or 0x1C13" {
        /// 0x1C12: RxPDOs, the outputs.
        Rx = 0x1C12,
        /// 0x1C13: TxPDOs, the inputs.
        Tx = 0x1C13,
    }
}

/// An object in a PDO, as in the mapping object: `u32` with the length in bits in the low byte, then sub-index, then
/// index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MappedObject {
    /// Index of the object; 0 for a gap.
    pub index: u16,
    /// Sub-index of the object.
    pub sub: u8,
    /// Length of the object in bits.
    pub bits: u8,
}

impl MappedObject {
    /// A mapped object with a length of `bits`.
    pub const fn new(object: ObjectAddress, bits: u8) -> Self {
        Self { index: object.index, sub: object.sub, bits }
    }

    /// The object's address.
    pub const fn object(self) -> ObjectAddress {
        ObjectAddress::new(self.index, self.sub)
    }

    /// The entry of the mapping object as bytes: bits, sub-index, index.
    pub(in crate::xf) const fn to_bytes(self) -> [u8; 4] {
        let [low, high] = self.index.to_le_bytes();
        [self.bits, self.sub, low, high]
    }

    /// Decodes an entry of a mapping object.
    pub(crate) const fn from_bytes([bits, sub, low, high]: [u8; 4]) -> Self {
        Self { index: u16::from_le_bytes([low, high]), sub, bits }
    }
}

/// A PDO: its mapping object, and up to 8 mapped objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PdoMap {
    index: u16,
    count: u8,
    objects: [MappedObject; Self::OBJECTS],
}

impl PdoMap {
    /// The maximum number of objects per PDO that the chip supports.
    pub const OBJECTS: usize = 8;

    /// The PDO with the mapping object `index`, such as 0x1600, and these objects; `None` if there are more than 8.
    pub fn new(index: u16, objects: &[MappedObject]) -> Option<Self> {
        let mut map = Self { index, count: u8::try_from(objects.len()).ok()?, ..Self::default() };
        map.objects.get_mut(..objects.len())?.copy_from_slice(objects);
        Some(map)
    }

    /// The mapping object, such as 0x1600.
    pub const fn index(&self) -> u16 {
        self.index
    }

    /// The mapped objects, in the order of the mapping.
    pub fn objects(&self) -> &[MappedObject] {
        &self.objects[..self.count.into()]
    }
}

/// The PDOs that are assigned to a sync manager of a slave, as set by [`PdoConfigSet`] and read by [`PdoConfigGet`].
///
/// Data of the form with 3 PDOs, 112 bytes (@offset): @0 slave, @1 number of PDOs, @2 u16 assignment, @4 three u16
/// mapping objects, @10 three u16 numbers of objects, @16 space for 8 objects of each PDO. Newer firmware has the form
/// with 4 PDOs, 148 bytes (OBS): @4 four mapping objects, @12 four numbers of objects, @20 the objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PdoConfig {
    /// The slave to which the PDOs belong.
    pub slave: SlaveNumber,
    /// Whether these are the outputs or the inputs.
    pub assignment: PdoAssignment,
    form: PdoConfigForm,
    count: u8,
    maps: [PdoMap; 4],
}

/// The layout of a [`PdoConfig`], which has room for 3 or 4 PDOs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum PdoConfigForm {
    /// 3 PDOs in 112 bytes.
    Three = 3,
    /// 4 PDOs in 148 bytes, in answers of newer firmware (OBS).
    Four = 4,
}

impl PdoConfigForm {
    /// The maximum number of PDOs: 3 or 4.
    pub const fn maps(self) -> usize {
        self as usize
    }

    /// The size of the layout in bytes: 112 or 148.
    pub const fn bytes(self) -> usize {
        self.objects_at() + self.maps() * PdoMap::OBJECTS * 4
    }

    const fn counts_at(self) -> usize {
        4 + 2 * self.maps()
    }

    const fn objects_at(self) -> usize {
        4 + 4 * self.maps()
    }

    /// The fields of the layout: each PDO with its objects.
    pub(in crate::xf) const fn fields(self) -> FieldList {
        const NAMES: [(&str, &str); 4] =
            [("pdo1", "objects1"), ("pdo2", "objects2"), ("pdo3", "objects3"), ("pdo4", "objects4")];
        let mut list = FieldList::of(at(0).of::<SlaveNumber>("slave"))
            .then(at(1).of::<u8>("count"))
            .then(at(2).of::<PdoAssignment>("assignment"));
        let mut n = 0;
        while n < self.maps() {
            let count_at = (self.counts_at() + 2 * n) as u16;
            let objects =
                at((self.objects_at() + 4 * PdoMap::OBJECTS * n) as u16).kind(FieldKind::Objects { count_at });
            list = list.then(at(4 + 2 * n as u16).hex().or(0).of::<u16>(NAMES[n].0));
            list = list.then(objects.or(0).of::<[u8; 4 * PdoMap::OBJECTS]>(NAMES[n].1));
            n += 1;
        }
        list
    }
}

const _: () = assert!(PdoConfigForm::Three.bytes() == 112 && PdoConfigForm::Four.bytes() == 148);

impl PdoConfig {
    /// The configuration with these PDOs; `None` if `form` has no room for them.
    pub fn new(slave: SlaveNumber, assignment: PdoAssignment, form: PdoConfigForm, maps: &[PdoMap]) -> Option<Self> {
        if maps.len() > form.maps() {
            return None;
        }
        let mut config = Self { slave, assignment, form, count: maps.len() as u8, maps: [PdoMap::default(); 4] };
        config.maps[..maps.len()].copy_from_slice(maps);
        Some(config)
    }

    /// The layout of the configuration, which has room for 3 or 4 PDOs.
    pub const fn form(&self) -> PdoConfigForm {
        self.form
    }

    /// The PDOs, in the order of the assignment.
    pub fn maps(&self) -> &[PdoMap] {
        &self.maps[..self.count.into()]
    }

    /// Encodes the layout and returns its length.
    pub(in crate::xf) fn write(&self, data: &mut [u8]) -> Result<u16, Malformed> {
        let form = self.form;
        // The space of missing PDOs and objects stays 0.
        let len = segment::put_at(data, form.bytes(), &[])?;
        data[..4].copy_from_slice(&[self.slave.get(), self.count, 0, 0]);
        data[2..4].copy_from_slice(&self.assignment.code().to_le_bytes());
        for (i, map) in self.maps().iter().enumerate() {
            data[4 + 2 * i..][..2].copy_from_slice(&map.index.to_le_bytes());
            data[form.counts_at() + 2 * i..][..2].copy_from_slice(&u16::from(map.count).to_le_bytes());
            for (k, object) in map.objects().iter().enumerate() {
                let at = form.objects_at() + 4 * (PdoMap::OBJECTS * i + k);
                data[at..at + 4].copy_from_slice(&object.to_bytes());
            }
        }
        Ok(len)
    }

    /// Decodes the layout. Data beyond the counted PDOs and objects are ignored.
    pub(in crate::xf) fn read(data: &[u8], form: PdoConfigForm) -> Result<Self, Malformed> {
        let data = segment::get_at(data, 0, form.bytes())?;
        let word = |at: usize| u16::from_le_bytes([data[at], data[at + 1]]);
        let slave = SlaveNumber::of(data[0].into())?;
        let count = Malformed::at_most("PDO count", data[1].into(), form.maps())?;
        let assignment = PdoAssignment::of(word(2).into())?;
        let mut maps = [PdoMap::default(); 4];
        for (i, map) in maps[..count].iter_mut().enumerate() {
            let counted = word(form.counts_at() + 2 * i);
            let objects = Malformed::at_most("PDO object count", counted.into(), PdoMap::OBJECTS)?;
            *map = PdoMap { index: word(4 + 2 * i), count: objects as u8, ..PdoMap::default() };
            let area = &data[form.objects_at() + 4 * PdoMap::OBJECTS * i..];
            for (object, bytes) in map.objects[..objects].iter_mut().zip(area.as_chunks::<4>().0) {
                *object = MappedObject::from_bytes(*bytes);
            }
        }
        Ok(Self { slave, assignment, form, count: count as u8, maps })
    }
}

/// ECAT_PDO_CONFIG_SET, command code 7: sets the PDOs of a slave, at most 3 with at most 8 objects each (XF EN 468).
///
/// The layout is the one with 112 bytes in [`PdoConfig`]. For more PDOs or objects use SDOs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PdoConfigSet {
    config: PdoConfig,
}

impl PdoConfigSet {
    /// The request with these PDOs; `None` if there are more than 3.
    pub fn new(slave: SlaveNumber, assignment: PdoAssignment, maps: &[PdoMap]) -> Option<Self> {
        Some(Self { config: PdoConfig::new(slave, assignment, PdoConfigForm::Three, maps)? })
    }

    /// The configuration that the request sets.
    pub const fn config(&self) -> &PdoConfig {
        &self.config
    }
}

impl FieldLayout<'_> for PdoConfigSet {
    const FIELDS: FieldList = PdoConfigForm::Three.fields();

    fn put(&self, to: &mut FieldWriter<'_>) -> Result<(), Malformed> {
        to.arguments.len = self.config.write(to.data)?;
        Ok(())
    }

    fn take(from: &FieldReader<'_>) -> Result<Self, Malformed> {
        Ok(Self { config: PdoConfig::read(from.data, PdoConfigForm::Three)? })
    }
}
