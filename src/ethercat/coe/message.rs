//! CoE messages: the header with its service code, and the body of each service.

use super::{Emergency, InformationFragment, SdoRequest, SdoResponse};
use crate::ethercat::WireError;
use crate::ethercat::wire_error::{room_for, split};

/// Length of the CoE header in bytes.
pub const COE_HEADER_LEN: usize = 2;

/// The service of a CoE message (ETG.1000.6 5.6.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CoeService {
    /// 1: an emergency.
    Emergency,
    /// 2: an SDO request. SDO aborts use this service too, in both directions.
    SdoRequest,
    /// 3: an SDO response.
    SdoResponse,
    /// 8: an SDO information request or response.
    Information,
    /// Any other service, 0..=15; for example 4 and 5, PDOs in the mailbox.
    Unknown(u8),
}

impl CoeService {
    /// The service with this code on the wire. Only the lower 4 bits of the code are used.
    pub const fn from_code(code: u8) -> Self {
        match code & 0x0F {
            1 => Self::Emergency,
            2 => Self::SdoRequest,
            3 => Self::SdoResponse,
            8 => Self::Information,
            code => Self::Unknown(code),
        }
    }

    /// The code on the wire, 0..=15.
    pub const fn code(self) -> u8 {
        match self {
            Self::Emergency => 1,
            Self::SdoRequest => 2,
            Self::SdoResponse => 3,
            Self::Information => 8,
            Self::Unknown(code) => code & 0x0F,
        }
    }
}

/// A CoE message, decoded by its service.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CoeMessage<'a> {
    /// An emergency message.
    Emergency(Emergency),
    /// An SDO request or an SDO abort.
    SdoRequest(SdoRequest<'a>),
    /// An SDO response.
    SdoResponse(SdoResponse<'a>),
    /// An SDO information request or response.
    Information(InformationFragment<'a>),
    /// A service without a type in this crate: its code, 0..=15, and its data.
    Unknown(u8, &'a [u8]),
}

impl<'a> CoeMessage<'a> {
    /// The service of the message.
    pub const fn service(&self) -> CoeService {
        match self {
            Self::Emergency(_) => CoeService::Emergency,
            Self::SdoRequest(_) => CoeService::SdoRequest,
            Self::SdoResponse(_) => CoeService::SdoResponse,
            Self::Information(_) => CoeService::Information,
            Self::Unknown(service, _) => CoeService::Unknown(*service),
        }
    }

    /// Decodes the data of a mailbox message. The number field of the header, which is 0, and its reserved bits are
    /// ignored.
    ///
    /// # Errors
    /// [`WireError::Short`]: the data are shorter than the service needs.
    pub fn decode(data: &'a [u8]) -> Result<Self, WireError> {
        let ([_, high], body) = split::<COE_HEADER_LEN>(data, "CoE header")?;
        Ok(match CoeService::from_code(high >> 4) {
            CoeService::Emergency => Self::Emergency(Emergency::decode(body)?),
            CoeService::SdoRequest => Self::SdoRequest(SdoRequest::decode(body)?),
            CoeService::SdoResponse => Self::SdoResponse(SdoResponse::decode(body)?),
            CoeService::Information => Self::Information(InformationFragment::decode(body)?),
            CoeService::Unknown(service) => Self::Unknown(service, body),
        })
    }

    /// Writes the message and returns its length in bytes.
    ///
    /// # Errors
    /// [`WireError::NoRoom`]: the message does not fit. [`WireError::Field`]: expedited data are not 1 to 4 bytes long.
    pub fn encode(&self, room: &mut [u8]) -> Result<usize, WireError> {
        room_for(room, "CoE header", COE_HEADER_LEN)?.copy_from_slice(&[0, self.service().code() << 4]);
        let body = &mut room[COE_HEADER_LEN..];
        let len = match self {
            Self::Emergency(emergency) => put(body, &emergency.encode())?,
            Self::SdoRequest(request) => request.encode(body)?,
            Self::SdoResponse(response) => response.encode(body)?,
            Self::Information(fragment) => fragment.encode(body)?,
            Self::Unknown(_, data) => put(body, data)?,
        };
        Ok(COE_HEADER_LEN + len)
    }
}

fn put(room: &mut [u8], bytes: &[u8]) -> Result<usize, WireError> {
    room_for(room, "CoE message", bytes.len())?.copy_from_slice(bytes);
    Ok(bytes.len())
}
