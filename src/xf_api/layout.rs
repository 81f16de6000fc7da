//! Where the slaves' objects are in the process data of the chip. The slaves follow one another, each beginning at a
//! byte boundary, with their objects in the order of their PDO mapping.

use super::{Xf, XfError};
use crate::ethercat::coe::ObjectAddress;
use crate::link::chip_link::ChipLink;
use crate::xf::request::{MappedObject, PdoAssignment, SlaveInfoItem};

/// A Rust type for an object or a field in process data, little-endian.
pub trait FieldType: Copy {
    /// Size of the type in bytes.
    const BYTES: usize;

    /// Decodes the value; `None` unless `bytes` has exactly [`Self::BYTES`] bytes.
    fn from_le(bytes: &[u8]) -> Option<Self>;

    /// Encodes the value into `bytes`, which has exactly [`Self::BYTES`] bytes.
    fn put_le(self, bytes: &mut [u8]);
}

macro_rules! fields {
    ($($int:ty)*) => {$(
        impl FieldType for $int {
            const BYTES: usize = size_of::<$int>();

            fn from_le(bytes: &[u8]) -> Option<Self> {
                Some(Self::from_le_bytes(bytes.try_into().ok()?))
            }

            fn put_le(self, bytes: &mut [u8]) {
                bytes.copy_from_slice(&self.to_le_bytes());
            }
        }
    )*};
}

fields! { u8 i8 u16 i16 u32 i32 u64 i64 }

/// A mapped object in the process data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MappedField {
    /// The object; an index of 0 is a gap in the mapping.
    pub object: ObjectAddress,
    /// Offset in bits from the beginning of the slave's process data.
    pub at: usize,
    /// Size of the object in bits.
    pub bits: u8,
}

/// The process data of one slave in one direction.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SlaveLayout {
    /// Offset in bytes from the beginning of the chip's PDO.
    pub at: usize,
    /// Size of the slave's process data in bytes.
    pub bytes: usize,
    /// The mapped objects of the slave, in the order of its PDO mapping.
    pub fields: Vec<MappedField>,
}

/// The layout of the chip's process data, with the slaves in network order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Layout {
    /// The RxPDO, which the host writes: the outputs of each slave.
    pub outputs: Vec<SlaveLayout>,
    /// The TxPDO, which the host reads: the inputs of each slave.
    pub inputs: Vec<SlaveLayout>,
}

/// Size of all slaves' process data together, in bytes.
pub(super) fn total(slaves: &[SlaveLayout]) -> usize {
    slaves.iter().map(|slave| slave.bytes).sum()
}

impl<L: ChipLink> Xf<L> {
    /// Reads each slave's mapping (0x1C12, 0x1C13 and the objects that they name), and from the chip the size of the
    /// slave's process data, which must agree with the mapping. Possible in PreOP after `Reconfig`, in SafeOP and in
    /// OP.
    ///
    /// # Errors
    /// [`XfError::OtherLayout`] if the mapping of a slave has another length than the chip has laid out for it,
    /// [`XfError::SdoAborted`] if a slave aborts the reading of its mapping; otherwise as with [`Xf::run`].
    pub fn layout(&mut self) -> Result<Layout, XfError> {
        let mut layout = Layout::default();
        let outputs = (PdoAssignment::Rx, SlaveInfoItem::OutputBytes, "outputs");
        let inputs = (PdoAssignment::Tx, SlaveInfoItem::InputBytes, "inputs");
        for ((assignment, item, direction), slaves) in [(outputs, &mut layout.outputs), (inputs, &mut layout.inputs)] {
            let mut at = 0;
            for slave in 0..self.slaves {
                let fields = self.mapped(slave, assignment)?;
                let mapped = fields.last().map_or(0, |field| (field.at + usize::from(field.bits)).div_ceil(8));
                let laid_out = self.item(slave, item)? as usize;
                if mapped != laid_out {
                    return Err(XfError::OtherLayout { slave, direction, mapped, laid_out });
                }
                slaves.push(SlaveLayout { at, bytes: laid_out, fields });
                at += laid_out;
            }
        }
        Ok(layout)
    }

    fn mapped(&mut self, slave: u8, assignment: PdoAssignment) -> Result<Vec<MappedField>, XfError> {
        let mut fields = Vec::new();
        let mut at = 0;
        let assignment = assignment.code();
        for pdo in 1..=self.sdo_read::<u8>(slave, ObjectAddress::new(assignment, 0))? {
            let pdo: u16 = self.sdo_read(slave, ObjectAddress::new(assignment, pdo))?;
            for entry in 1..=self.sdo_read::<u8>(slave, ObjectAddress::new(pdo, 0))? {
                let entry: u32 = self.sdo_read(slave, ObjectAddress::new(pdo, entry))?;
                let mapped = MappedObject::from_bytes(entry.to_le_bytes());
                fields.push(MappedField { object: mapped.object(), at, bits: mapped.bits });
                at += usize::from(mapped.bits);
            }
        }
        Ok(fields)
    }
}
