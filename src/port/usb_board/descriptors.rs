//! The USB descriptors of the virtual board: USB 2.0 (9.6) and HID 1.11 (6). Numbers are little-endian.

use super::setup::descriptor::{CONFIGURATION, DEVICE, ENDPOINT, HID, INTERFACE, REPORT, STRING};
use crate::sk::BOARD_IDS;
use crate::sk::FRAME_LEN;

/// The address of the interrupt IN endpoint, for reports (SK-9).
pub const IN: u8 = 0x81;
/// The address of the interrupt OUT endpoint, for command frames (SK-9).
pub const OUT: u8 = 0x02;
/// bConfigurationValue of the only configuration.
pub const CONFIGURATION_VALUE: u8 = 1;
/// Class, subclass and protocol of the only interface: HID, not a boot device (SK-9).
pub const INTERFACE_CLASS: [u8; 3] = [3, 0, 0];

/// The identity of a virtual board in its descriptors. Vendor id, product id and the size of the reports are those of
/// the real board (SK-9). The defaults of the fields with \[OURS] are chosen by this project, because no manual or
/// capture shows the value of the real board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// idVendor; 0x16C0 on a real board (SK-9).
    pub vendor: u16,
    /// idProduct; 0x05DF on a real board (SK-9).
    pub product: u16,
    /// bcdDevice: the version of the firmware as the device reports it. \[OURS]
    pub release: u16,
    /// bInterval of both endpoints, 1..=16: 2^(n-1) microframes of 125 us. \[OURS]
    pub interval: u8,
    /// The largest current that the board takes from the bus, in mA: 0..=500. \[OURS]
    pub power_ma: u16,
    /// The HID usage page that the report descriptor gives to the reports. \[OURS]
    pub usage_page: u16,
    /// iManufacturer; empty for none. \[OURS]
    pub manufacturer: String,
    /// iProduct; empty for none. \[OURS]
    pub name: String,
    /// iSerialNumber; empty for none. \[OURS]
    pub serial: String,
}

impl Default for Identity {
    fn default() -> Self {
        Self {
            vendor: BOARD_IDS.0,
            product: BOARD_IDS.1,
            release: 0x0100,
            interval: 1,
            power_ma: 500,
            usage_page: 0xFF00,
            manufacturer: "ecmsk".into(),
            name: "ECM-SK, virtual".into(),
            serial: String::new(),
        }
    }
}

/// Why an [`Identity`] is not possible on USB.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum IdentityError {
    /// A text is too long for a string descriptor.
    #[error("`{text}` is too long for a text of a USB device; give it {TEXT_UNITS_MAX} characters at most")]
    Text { text: String },
    /// bInterval is not 1 to 16.
    #[error("an endpoint's interval is 1 to 16 (2^(n-1) times 125 us), not {found}; leave it at 1")]
    Interval { found: u8 },
    /// The current exceeds the limit of a USB 2.0 port.
    #[error("a USB 2.0 port gives 500 mA, not {found}; ask for less")]
    Power { found: u16 },
}

/// The most UTF-16 units in a string descriptor: its length is one byte, 255 at most, of which two bytes are the
/// header, and each unit takes two bytes.
const TEXT_UNITS_MAX: usize = 126;
/// The indices of the string descriptors, by which other descriptors refer to them.
const MANUFACTURER: u8 = 1;
const NAME: u8 = 2;
const SERIAL: u8 = 3;
/// The language of the strings: English (United States).
const LANGUAGE: [u8; 2] = [0x09, 0x04];
/// The length of the header of a string descriptor in bytes.
const TEXT_HEAD: usize = 2;

/// bcdUSB 2.00 and bcdHID 1.11, low byte first.
const USB_VERSION: [u8; 2] = [0x00, 0x02];
const HID_VERSION: [u8; 2] = [0x11, 0x01];
/// bMaxPacketSize0; at high speed always 64 bytes.
const CONTROL_PACKET: u8 = 64;
/// bmAttributes of the configuration: bus-powered, no remote wake-up. \[OURS]
const ATTRIBUTES: u8 = 0x80;
const INTERRUPT: u8 = 3;

const HID_LEN: usize = 9;
const CONFIGURATION_LEN: usize = 9 + 9 + HID_LEN + 7 + 7;
/// The offset of the HID descriptor in the configuration descriptor, bytes.
const HID_AT: usize = 18;

/// All descriptors of a virtual board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Descriptors {
    device: [u8; 18],
    configuration: [u8; CONFIGURATION_LEN],
    report: [u8; 26],
    texts: [Vec<u8>; 4],
}

impl Descriptors {
    /// Builds the descriptors of a board with this identity.
    ///
    /// # Errors
    /// [`IdentityError`]: the interval is not 1 to 16, the current exceeds 500 mA, or a text has more than 126 UTF-16
    /// units.
    pub fn new(identity: &Identity) -> Result<Self, IdentityError> {
        if !(1..=16).contains(&identity.interval) {
            return Err(IdentityError::Interval { found: identity.interval });
        }
        if identity.power_ma > 500 {
            return Err(IdentityError::Power { found: identity.power_ma });
        }
        let languages = [&[(TEXT_HEAD + LANGUAGE.len()) as u8, STRING][..], &LANGUAGE].concat();
        let texts = [languages, text(&identity.manufacturer)?, text(&identity.name)?, text(&identity.serial)?];
        let report = report(identity.usage_page);
        Ok(Self { device: device(identity), configuration: configuration(identity, report.len() as u8), report, texts })
    }

    /// The descriptor of that type and index, if it exists.
    pub fn get(&self, kind: u8, index: u8) -> Option<&[u8]> {
        match (kind, index) {
            (DEVICE, 0) => Some(&self.device),
            (CONFIGURATION, 0) => Some(&self.configuration),
            (HID, 0) => Some(&self.configuration[HID_AT..HID_AT + HID_LEN]),
            (REPORT, 0) => Some(&self.report),
            (STRING, _) => {
                let text = self.texts.get(usize::from(index))?;
                (text.len() > TEXT_HEAD).then_some(&text[..])
            }
            _ => None,
        }
    }
}

fn device(identity: &Identity) -> [u8; 18] {
    let [vendor, product, release] = [identity.vendor, identity.product, identity.release].map(u16::to_le_bytes);
    let named = |index, text: &str| if text.is_empty() { 0 } else { index };
    [
        18,
        DEVICE,
        USB_VERSION[0],
        USB_VERSION[1],
        // bDeviceClass, bDeviceSubClass and bDeviceProtocol 0: the interface descriptor has the class (HID).
        0,
        0,
        0,
        CONTROL_PACKET,
        vendor[0],
        vendor[1],
        product[0],
        product[1],
        release[0],
        release[1],
        named(MANUFACTURER, &identity.manufacturer),
        named(NAME, &identity.name),
        named(SERIAL, &identity.serial),
        1,
    ]
}

fn configuration(identity: &Identity, report_len: u8) -> [u8; CONFIGURATION_LEN] {
    let total = (CONFIGURATION_LEN as u16).to_le_bytes();
    let packet = (FRAME_LEN as u16).to_le_bytes();
    let [class, subclass, protocol] = INTERFACE_CLASS;
    let interval = identity.interval;
    // bMaxPower is in units of 2 mA, so it is half of the current.
    let power = (identity.power_ma / 2) as u8;
    let parts: [&[u8]; 5] = [
        &[9, CONFIGURATION, total[0], total[1], 1, CONFIGURATION_VALUE, 0, ATTRIBUTES, power],
        &[9, INTERFACE, 0, 0, 2, class, subclass, protocol, 0],
        &[HID_LEN as u8, HID, HID_VERSION[0], HID_VERSION[1], 0, 1, REPORT, report_len, 0],
        &[7, ENDPOINT, IN, INTERRUPT, packet[0], packet[1], interval],
        &[7, ENDPOINT, OUT, INTERRUPT, packet[0], packet[1], interval],
    ];
    let mut all = [0; CONFIGURATION_LEN];
    let mut at = 0;
    for part in parts {
        all[at..at + part.len()].copy_from_slice(part);
        at += part.len();
    }
    all
}

/// The report descriptor: one input and one output report of 512 bytes without report id (SK-9); the usages are
/// \[OURS].
#[rustfmt::skip]
fn report(usage_page: u16) -> [u8; 26] {
    let page = usage_page.to_le_bytes();
    let count = (FRAME_LEN as u16).to_le_bytes();
    [
        0x06, page[0], page[1],   // Usage Page
        0x09, 0x01,               // Usage 1
        0xA1, 0x01,               // Collection (Application)
        0x15, 0x00,               //   Logical Minimum 0
        0x26, 0xFF, 0x00,         //   Logical Maximum 255
        0x75, 0x08,               //   Report Size 8 bits
        0x96, count[0], count[1], //   Report Count 512
        0x09, 0x02,               //   Usage 2
        0x81, 0x02,               //   Input (Data, Variable, Absolute)
        0x09, 0x03,               //   Usage 3
        0x91, 0x02,               //   Output (Data, Variable, Absolute)
        0xC0,                     // End Collection
    ]
}

fn text(text: &str) -> Result<Vec<u8>, IdentityError> {
    let units: Vec<u16> = text.encode_utf16().collect();
    if units.len() > TEXT_UNITS_MAX {
        return Err(IdentityError::Text { text: text.to_owned() });
    }
    let mut bytes = vec![(TEXT_HEAD + 2 * units.len()) as u8, STRING];
    bytes.extend(units.iter().flat_map(|unit| unit.to_le_bytes()));
    Ok(bytes)
}
