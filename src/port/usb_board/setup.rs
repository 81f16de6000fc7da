//! The requests of a host on endpoint 0: the setup packets of USB 2.0 (9.3) and HID 1.11 (7.2). Numbers are
//! little-endian.

/// Descriptor types: USB 2.0 table 9-5 and HID 1.11 7.1.
pub mod descriptor {
    /// The device descriptor.
    pub const DEVICE: u8 = 1;
    /// The configuration descriptor with the interface, HID and endpoint descriptors.
    pub const CONFIGURATION: u8 = 2;
    /// A string descriptor.
    pub const STRING: u8 = 3;
    /// An interface descriptor.
    pub const INTERFACE: u8 = 4;
    /// An endpoint descriptor.
    pub const ENDPOINT: u8 = 5;
    /// The HID descriptor.
    pub const HID: u8 = 0x21;
    /// The report descriptor.
    pub const REPORT: u8 = 0x22;
}

/// Report types: HID 1.11 7.2.1.
pub mod report {
    /// A report to the host.
    pub const INPUT: u8 = 1;
    /// A report to the device.
    pub const OUTPUT: u8 = 2;
}

/// The feature ENDPOINT_HALT of CLEAR_FEATURE and SET_FEATURE (USB 2.0, table 9-6).
const ENDPOINT_HALT: u16 = 0;

/// Values of bmRequestType: the direction, type and recipient of a request.
const TO_DEVICE: u8 = 0x00;
const TO_INTERFACE: u8 = 0x01;
const TO_ENDPOINT: u8 = 0x02;
const FROM_DEVICE: u8 = 0x80;
const FROM_INTERFACE: u8 = 0x81;
const FROM_ENDPOINT: u8 = 0x82;
const CLASS_TO_INTERFACE: u8 = 0x21;
const CLASS_FROM_INTERFACE: u8 = 0xA1;

/// A request on endpoint 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// GET_STATUS of the device or the interface.
    GetStatus,
    /// GET_STATUS of the endpoint with this address.
    GetEndpointStatus(u8),
    /// CLEAR_FEATURE or SET_FEATURE of ENDPOINT_HALT.
    SetHalt {
        /// The address of the endpoint.
        endpoint: u8,
        /// Whether the endpoint is to be halted.
        halted: bool,
    },
    /// SET_ADDRESS.
    SetAddress,
    /// GET_DESCRIPTOR of the device or the interface.
    GetDescriptor {
        /// The descriptor type, see [`descriptor`].
        kind: u8,
        /// The index among the descriptors of that type.
        index: u8,
    },
    /// GET_CONFIGURATION.
    GetConfiguration,
    /// SET_CONFIGURATION, with bConfigurationValue; 0: none.
    SetConfiguration(u8),
    /// GET_INTERFACE: the host asks for the alternate setting.
    GetInterface,
    /// SET_INTERFACE: the host selects this alternate setting.
    SetInterface(u16),
    /// GET_REPORT: the host reads a report by a control transfer.
    GetReport {
        /// The report type, see [`report`].
        kind: u8,
        /// The report id that the host asks for. Only 0 exists, since the board's reports are not numbered (SK-9).
        id: u8,
    },
    /// SET_REPORT: the host sends a report in the data stage of a control transfer.
    SetReport {
        /// The report type, see [`report`].
        kind: u8,
        /// The report id that the host gives. Only 0 exists, since the board's reports are not numbered (SK-9).
        id: u8,
    },
    /// GET_IDLE: the host asks for the idle rate that SET_IDLE has set.
    GetIdle,
    /// SET_IDLE: the host sets the idle rate, the longest time between two reports, in steps of 4 ms.
    SetIdle(u8),
    /// Any other request, or one to an interface that does not exist.
    Unknown,
}

/// A decoded setup packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    /// The request that bmRequestType, bRequest, wValue and wIndex encode.
    pub request: Request,
    /// wLength: how many bytes the host sends, or accepts at most.
    pub length: u16,
    /// Whether the data stage goes to the host.
    pub to_host: bool,
}

impl Setup {
    /// Decodes the 8 bytes of a setup packet. A request that the board does not know becomes [`Request::Unknown`].
    pub const fn parse(bytes: [u8; 8]) -> Self {
        let [recipient, code, low, high, ..] = bytes;
        let value = u16::from_le_bytes([low, high]);
        let index = u16::from_le_bytes([bytes[4], bytes[5]]);
        let request = match (recipient, code) {
            (FROM_DEVICE, 0) => Request::GetStatus,
            (TO_DEVICE, 5) => Request::SetAddress,
            (FROM_DEVICE, 6) => Request::GetDescriptor { kind: high, index: low },
            (FROM_DEVICE, 8) => Request::GetConfiguration,
            (TO_DEVICE, 9) => Request::SetConfiguration(low),
            (FROM_ENDPOINT, 0) => Request::GetEndpointStatus(bytes[4]),
            (TO_ENDPOINT, 1 | 3) if value == ENDPOINT_HALT => {
                Request::SetHalt { endpoint: bytes[4], halted: code == 3 }
            }
            // The board has one interface, number 0. A request to another one is unknown.
            (FROM_INTERFACE | TO_INTERFACE | CLASS_FROM_INTERFACE | CLASS_TO_INTERFACE, _) if index != 0 => {
                Request::Unknown
            }
            (FROM_INTERFACE, 0) => Request::GetStatus,
            (FROM_INTERFACE, 6) => Request::GetDescriptor { kind: high, index: low },
            (FROM_INTERFACE, 10) => Request::GetInterface,
            (TO_INTERFACE, 11) => Request::SetInterface(value),
            (CLASS_FROM_INTERFACE, 1) => Request::GetReport { kind: high, id: low },
            (CLASS_FROM_INTERFACE, 2) => Request::GetIdle,
            (CLASS_TO_INTERFACE, 9) => Request::SetReport { kind: high, id: low },
            (CLASS_TO_INTERFACE, 10) => Request::SetIdle(high),
            _ => Request::Unknown,
        };
        let length = u16::from_le_bytes([bytes[6], bytes[7]]);
        Self { request, length, to_host: recipient & FROM_DEVICE != 0 }
    }
}
