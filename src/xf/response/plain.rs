//! Answers that are a number, bytes, or a word that other parts of the crate have a type for.

use super::{Answer, Returned};
use crate::ethercat::cia402::Statusword;
use crate::ethercat::coe::AbortCode;
use crate::xf::request::{Analog, HelperControl};
use crate::xf::{Malformed, NetworkState, segment};

/// No result: length 0; what the return byte holds means nothing.
impl Answer<'_> for () {
    fn encode(&self, _: &mut [u8]) -> Result<Returned, Malformed> {
        Ok(Returned::NONE)
    }

    fn decode(_: Returned, _: &[u8]) -> Result<Self, Malformed> {
        Ok(())
    }
}

/// The return byte.
impl Answer<'_> for u8 {
    fn encode(&self, _: &mut [u8]) -> Result<Returned, Malformed> {
        Ok(Returned::value(*self))
    }

    fn decode(returned: Returned, _: &[u8]) -> Result<Self, Malformed> {
        Ok(returned.ret)
    }
}

/// The return byte as the state of the network or of a slave.
impl Answer<'_> for NetworkState {
    fn encode(&self, _: &mut [u8]) -> Result<Returned, Malformed> {
        Ok(Returned::value(self.0))
    }

    fn decode(returned: Returned, _: &[u8]) -> Result<Self, Malformed> {
        Ok(Self(returned.ret))
    }
}

/// The return byte as the helper's control byte.
impl Answer<'_> for HelperControl {
    fn encode(&self, _: &mut [u8]) -> Result<Returned, Malformed> {
        Ok(Returned::value(self.0))
    }

    fn decode(returned: Returned, _: &[u8]) -> Result<Self, Malformed> {
        Ok(Self(returned.ret))
    }
}

/// @0 u16.
impl Answer<'_> for u16 {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        segment::put(data, &self.to_le_bytes()).map(Returned::data)
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        segment::get(returned.first(data, 2)?).map(Self::from_le_bytes)
    }
}

/// @0 u32.
impl Answer<'_> for u32 {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        segment::put(data, &self.to_le_bytes()).map(Returned::data)
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        segment::get(returned.first(data, 4)?).map(Self::from_le_bytes)
    }
}

/// @0 u16, a statusword.
impl Answer<'_> for Statusword {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.0.encode(data)
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        u16::decode(returned, data).map(Self)
    }
}

/// @0 u32, why an SDO transfer failed; 0 if it did not.
impl Answer<'_> for AbortCode {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.0.encode(data)
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        u32::decode(returned, data).map(Self)
    }
}

/// @0 u32, 0..=4095.
impl Answer<'_> for Analog {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.get().encode(data)
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        Self::decode(u32::decode(returned, data)?)
    }
}

/// The valid bytes of the data segment.
impl<'a> Answer<'a> for &'a [u8] {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        segment::put_at(data, 0, self).map(Returned::data)
    }

    fn decode(returned: Returned, data: &'a [u8]) -> Result<Self, Malformed> {
        returned.valid(data)
    }
}
