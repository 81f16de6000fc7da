//! Version and series of the chip, the limit of working counter errors, registers of PHYs, the size of packets.

use bytemuck::{Pod, Zeroable};

use super::{Answer, Returned};
use crate::ethercat::U16Le;
use crate::xf::request::{WkcErrorLimit, data_size};
use crate::xf::{DataSize, Malformed, segment};

/// The answer to FW_VERSION_GET (XF EN 1285): `ret` version; newer firmware adds 20 bytes, older has none (XF ZH 1208).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FirmwareVersion {
    /// The version, such as 0x22.
    pub version: u8,
    /// What newer firmware adds.
    pub identity: Option<FirmwareIdentity>,
}

/// What newer firmware says about itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FirmwareIdentity {
    /// @0 u16: the extended version.
    pub extended: u16,
    /// @3: which chip it is.
    pub series: Series,
    /// @4..@19: for the vendor's own use.
    pub identification: [u8; 16],
}

/// Which chip it is. The manual names ECM-XF, ECM-XFL, ECM-XFU and ECM-XM, and gives none a number (XF EN 1285).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Series(pub u8);

/// The data segment of [`FirmwareVersion`].
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct IdentityLayout {
    /// @0: the drawing has lost a column; that these two bytes are the extended version is our reading of it.
    extended: U16Le,
    /// @2.
    reserved: u8,
    /// @3.
    series: u8,
    /// @4.
    identification: [u8; 16],
}

const IDENTITY: usize = size_of::<IdentityLayout>();
const _: () = assert!(IDENTITY == 20 && align_of::<IdentityLayout>() == 1);

impl Answer<'_> for FirmwareVersion {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        let Some(FirmwareIdentity { extended, series, identification }) = self.identity else {
            return Ok(Returned::value(self.version));
        };
        let layout = IdentityLayout { extended: extended.into(), reserved: 0, series: series.0, identification };
        Ok(Returned { ret: self.version, len: segment::put(data, &layout)? })
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        let identity = match returned.valid(data)?.len() {
            0 => None,
            IDENTITY => {
                let layout: IdentityLayout = segment::get(data)?;
                Some(FirmwareIdentity {
                    extended: layout.extended.get(),
                    series: Series(layout.series),
                    identification: layout.identification,
                })
            }
            _ => return Err(Malformed::only("FW_VERSION_GET valid data length", returned.len.into(), "0 or 20")),
        };
        Ok(Self { version: returned.ret, identity })
    }
}

/// The answer to MDIO (XF EN 1455): @0 u16 what was read; nothing after a write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MdioAnswer(pub Option<u16>);

impl Answer<'_> for MdioAnswer {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.0.map_or(Ok(Returned::NONE), |value| value.encode(data))
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        match returned.len {
            0 => Ok(Self(None)),
            _ => u16::decode(returned, data).map(|value| Self(Some(value))),
        }
    }
}

/// The return byte.
impl Answer<'_> for WkcErrorLimit {
    fn encode(&self, _: &mut [u8]) -> Result<Returned, Malformed> {
        Ok(Returned::value(self.code()))
    }

    fn decode(returned: Returned, _: &[u8]) -> Result<Self, Malformed> {
        Ok(Self::from_code(returned.ret))
    }
}

/// @0 u16: n.
impl Answer<'_> for DataSize {
    fn encode(&self, data: &mut [u8]) -> Result<Returned, Malformed> {
        self.get().encode(data)
    }

    fn decode(returned: Returned, data: &[u8]) -> Result<Self, Malformed> {
        data_size("SPI_PACK_SIZE_GET size", u16::decode(returned, data)?)
    }
}
