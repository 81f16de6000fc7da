//! Answers about emergencies received through mailboxes, and sets of slaves.

use super::{Answer, Returned, answer_fields};
use crate::xf::fields::{AnswerFields, FieldKind};
use crate::xf::layout::{FieldLayout, FieldReader, FieldWriter, Forms, layout, tail};
use crate::xf::request::{EMERGENCIES_MAX, SlaveBits};
use crate::xf::{Malformed, segment};

layout! {
    /// A CoE emergency of a slave.
    #[derive(Default)]
    pub struct Emergency {
        /// Byte 0: the position in the list of emergencies, 0..=7; in the modelled chip 0 is the newest.
        pub number: u8 = at(0).kind(FieldKind::Named(&[("none", NO_EMERGENCY as u32)])),
        /// Byte 1: the slave's number.
        pub slave: u8 = at(1),
        /// Bytes 2..3: running number of the emergency, counted since the start of the chip.
        pub running_number: u16 = at(2),
        /// Bytes 4..5: the error code, as in object 0x603F.
        pub code: u16 = at(4).hex(),
        /// Byte 6: the error register, object 0x1001.
        pub register: u8 = at(6).hex(),
        /// Bytes 7..11: additional manufacturer-specific data.
        pub data: [u8; 5] = at(7),
    }
}

const EMERGENCY: usize = Emergency::END;

/// The number 0xFF, which marks a position of the list without an emergency.
const NO_EMERGENCY: u8 = 0xFF;

/// The answer to COE_EMERGENCY (XF EN 1490): 12 bytes for each of the 1 to 8 requested emergencies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Emergencies {
    count: u8,
    places: [Option<Emergency>; EMERGENCIES_MAX],
}

impl Emergencies {
    /// A list of emergencies by position, where a position may be empty; `None` if there are more than 8. An emergency
    /// with the number 0xFF counts as empty.
    pub fn new(places: &[Option<Emergency>]) -> Option<Self> {
        let mut list = Self { count: u8::try_from(places.len()).ok()?, ..Self::default() };
        list.places.get_mut(..places.len())?.copy_from_slice(places);
        for place in &mut list.places {
            *place = place.filter(|emergency| emergency.number != NO_EMERGENCY);
        }
        Some(list)
    }

    /// The list by position: an emergency, or `None` for an empty position.
    pub fn places(&self) -> &[Option<Emergency>] {
        &self.places[..self.count.into()]
    }

    /// The emergencies in the order of the list, without empty positions.
    pub fn iter(&self) -> impl Iterator<Item = &Emergency> {
        self.places().iter().flatten()
    }
}

impl Answer<'_> for Emergencies {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        let mut len = 0;
        for (i, place) in self.places().iter().enumerate() {
            let none = Emergency { number: NO_EMERGENCY, ..Emergency::default() };
            len = segment::put_at(data, EMERGENCY * (i + 1), &[])?;
            place.unwrap_or(none).put(&mut FieldWriter::new(&mut data[EMERGENCY * i..]))?;
        }
        Ok(Returned::data(len))
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        let valid = returned.valid(data)?;
        let count = valid.len() / EMERGENCY;
        if !valid.len().is_multiple_of(EMERGENCY) || count > EMERGENCIES_MAX {
            let allowed = "a multiple of 12, at most 96";
            return Err(Malformed::only("COE_EMERGENCY valid data length", returned.len.into(), allowed));
        }
        let mut list = Self { count: count as u8, ..Self::default() };
        for (place, bytes) in list.places.iter_mut().zip(valid.chunks_exact(EMERGENCY)) {
            let emergency = Emergency::take(&FieldReader::of(returned, bytes))?;
            *place = Some(emergency).filter(|emergency| emergency.number != NO_EMERGENCY);
        }
        Ok(list)
    }
}

impl Forms for Emergencies {
    const FORMS: &'static [AnswerFields] =
        &[AnswerFields { every: Some(EMERGENCY as u16), ..answer_fields!(Emergency) }];
}

/// The answer to MBX_STAT (XF EN 1663): a set of slaves, with as many bytes as the length field says.
impl Answer<'_> for SlaveBits {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        let mut to = FieldWriter::new(data);
        tail(0).put(self, &mut to)?;
        Ok(to.returned())
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        returned.valid(data).map(Self::read_valid)
    }
}

impl Forms for SlaveBits {
    const FORMS: &'static [AnswerFields] = &[AnswerFields::of(&[tail(0).of::<SlaveBits>("slaves").field])];
}
