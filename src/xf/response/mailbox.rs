//! Emergencies that came through mailboxes, and sets of slaves.

use super::{Answer, Returned, answer_fields};
use crate::xf::fields::{AnswerFields, Kind};
use crate::xf::layout::{Forms, Layout, Reader, Writer, layout, tail};
use crate::xf::request::{EMERGENCIES_MAX, SlaveBits};
use crate::xf::{Malformed, segment};

layout! {
    /// An emergency of a slave (CoE).
    #[derive(Default)]
    pub struct Emergency {
        /// @0: its place in the list, 0..=7.
        pub number: u8 = at(0).kind(Kind::Named(&[("none", NO_EMERGENCY as u32)])),
        /// @1: the slave.
        pub slave: u8 = at(1),
        /// @2 u16: which one it is since the chip has started.
        pub running_number: u16 = at(2),
        /// @4 u16: the error code, as object 0x603F has it.
        pub code: u16 = at(4).hex(),
        /// @6: the error register, object 0x1001.
        pub register: u8 = at(6).hex(),
        /// @7..@11: what the slave's maker says more.
        pub data: [u8; 5] = at(7),
    }
}

const EMERGENCY: usize = Emergency::END;

/// The number of a place without an emergency.
const NO_EMERGENCY: u8 = 0xFF;

/// The answer to COE_EMERGENCY (XF EN 1490): 12 bytes for each emergency that was asked for, 1 to 8 of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Emergencies {
    count: u8,
    places: [Option<Emergency>; EMERGENCIES_MAX],
}

impl Emergencies {
    /// A list with these places, some of which may hold none; `None` if they are more than 8. An emergency has the
    /// number 0xFF of none only by mistake, and is none then.
    pub fn new(places: &[Option<Emergency>]) -> Option<Self> {
        let mut list = Self { count: u8::try_from(places.len()).ok()?, ..Self::default() };
        list.places.get_mut(..places.len())?.copy_from_slice(places);
        for place in &mut list.places {
            *place = place.filter(|emergency| emergency.number != NO_EMERGENCY);
        }
        Some(list)
    }

    /// The places in order.
    pub fn places(&self) -> &[Option<Emergency>] {
        &self.places[..self.count.into()]
    }

    /// The emergencies in order.
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
            place.unwrap_or(none).put(&mut Writer::new(&mut data[EMERGENCY * i..]))?;
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
            let emergency = Emergency::take(&Reader::of(returned, bytes))?;
            *place = Some(emergency).filter(|emergency| emergency.number != NO_EMERGENCY);
        }
        Ok(list)
    }
}

impl Forms for Emergencies {
    const FORMS: &'static [AnswerFields] =
        &[AnswerFields { every: Some(EMERGENCY as u16), ..answer_fields!(Emergency) }];
}

/// A bit for each slave (XF EN 1663); as many bytes as the length counts.
impl Answer<'_> for SlaveBits {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        let mut to = Writer::new(data);
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
