//! Emergencies that came through mailboxes, and sets of slaves.

use bytemuck::{Pod, Zeroable};

use super::{Answer, Returned};
use crate::ethercat::U16Le;
use crate::xf::request::{EMERGENCIES_MAX, SlaveBits};
use crate::xf::{Malformed, segment};

/// An emergency of a slave (CoE).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Emergency {
    /// @0: its place in the list, 0..=7.
    pub number: u8,
    /// @1: the slave.
    pub slave: u8,
    /// @2 u16: which one it is since the chip has started.
    pub running_number: u16,
    /// @4 u16: the error code, as object 0x603F has it.
    pub code: u16,
    /// @6: the error register, object 0x1001.
    pub register: u8,
    /// @7..@11: what the slave's maker says more.
    pub data: [u8; 5],
}

/// An emergency as bytes.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct EmergencyLayout {
    /// @0: 0xFF if there is none.
    number: u8,
    /// @1.
    slave: u8,
    /// @2.
    running_number: U16Le,
    /// @4.
    code: U16Le,
    /// @6.
    register: u8,
    /// @7.
    data: [u8; 5],
}

const EMERGENCY: usize = size_of::<EmergencyLayout>();
const _: () = assert!(EMERGENCY == 12 && align_of::<EmergencyLayout>() == 1);

/// The number of a place without an emergency.
const NO_EMERGENCY: u8 = 0xFF;

impl EmergencyLayout {
    fn of(emergency: Option<Emergency>) -> Self {
        let number = emergency.map_or(NO_EMERGENCY, |emergency| emergency.number);
        let Emergency { slave, running_number, code, register, data, .. } = emergency.unwrap_or_default();
        Self { number, slave, running_number: running_number.into(), code: code.into(), register, data }
    }

    fn emergency(self) -> Option<Emergency> {
        (self.number != NO_EMERGENCY).then_some(Emergency {
            number: self.number,
            slave: self.slave,
            running_number: self.running_number.get(),
            code: self.code.get(),
            register: self.register,
            data: self.data,
        })
    }
}

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
            len = segment::put_at(data, EMERGENCY * i, bytemuck::bytes_of(&EmergencyLayout::of(*place)))?;
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
            *place = segment::get::<EmergencyLayout>(bytes)?.emergency();
        }
        Ok(list)
    }
}

/// A bit for each slave (XF EN 1663); as many bytes as the length counts.
impl Answer<'_> for SlaveBits {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.write(data).map(Returned::data)
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        returned.valid(data).map(Self::read_valid)
    }
}
