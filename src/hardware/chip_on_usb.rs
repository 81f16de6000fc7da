//! `xf-usb:`: a real ECM-XFU on USB. An ECM-XFU is an ECM-XF with packets of 1024 bytes (XF EN 715).
//!
//! \[OURS] No source describes the chip's USB interface. The link assumes one OUT and one IN transfer for each packet;
//! the IN data are the answer to the previous packet, as on SPI. USB ids and endpoints are keys of the link that have
//! no default: `vid=`, `pid=`, `ep_out=`, `ep_in=`.

use std::time::Duration;

use crate::address::keys::{self, Scheme};
use crate::address::uri::{LinkUri, UriError};
use crate::ethercat::Ns;
use crate::io::hid::{Bus, PacketDevice, PacketPlace, PacketWires, UsbError, UsbPacketError};
use crate::link::chip_link::{ChipError, ChipInfo, ChipLink};
use crate::xf::DataSize;
use crate::xf::host::Wires;

/// Size of a packet of the chip in bytes.
const PACKET: usize = DataSize::XFU.packet_len();

/// A link to an ECM-XFU on USB.
pub struct UsbChip<W = PacketDevice> {
    info: ChipInfo,
    wires: W,
    /// Bytes of a received packet that the driver has not read yet. While the driver searches the received bytes for
    /// the beginning of a packet, it reads less than a packet at a time, but USB transfers whole packets.
    rest: [u8; PACKET],
    /// The number of unread bytes. They are at the end of `rest`.
    rest_len: usize,
}

impl UsbChip {
    /// Opens the chip that an `xf-usb:` link names.
    ///
    /// # Errors
    /// [`ChipError::Uri`]: a value of the link is missing or invalid. [`ChipError::Wires`]: the device cannot be used;
    /// the error says why and what to do.
    pub fn from_uri(uri: &LinkUri) -> Result<Self, ChipError> {
        let place = usb_place(uri)?;
        let name = uri.to_string();
        let device = Bus::open().map_err(UsbPacketError::from).and_then(|bus| PacketDevice::open(&bus, place));
        Ok(Self::over(&name, device.map_err(|error| chip_error(&name, &error))?))
    }
}

impl<W: PacketWires> UsbChip<W> {
    /// A link over these USB endpoints; `name` is the name of the link in messages.
    pub fn over(name: &str, wires: W) -> Self {
        let info = ChipInfo {
            name: name.to_owned(),
            size: Some(DataSize::XFU),
            clock_hz: None,
            has_int0: false,
            virtual_time: false,
        };
        Self { info, wires, rest: [0; PACKET], rest_len: 0 }
    }

    /// The wires to the chip, which are USB endpoints here, for tests and for direct access.
    pub const fn wires_mut(&mut self) -> &mut W {
        &mut self.wires
    }

    /// Fills `from_chip` with received bytes while the driver searches them for the beginning of a packet. Meanwhile
    /// the link sends zeros: the chip takes them for no packet, because they contain no start word.
    fn search(&mut self, from_chip: &mut [u8]) -> Result<(), UsbPacketError> {
        for byte in from_chip {
            if self.rest_len == 0 {
                self.wires.exchange(&[0; PACKET], &mut self.rest)?;
                self.rest_len = PACKET;
            }
            *byte = self.rest[PACKET - self.rest_len];
            self.rest_len -= 1;
        }
        Ok(())
    }
}

impl<W: PacketWires> Wires for UsbChip<W> {
    type Error = ChipError;

    fn now(&self) -> Ns {
        self.wires.now_ns()
    }

    fn exchange(&mut self, to_chip: &[u8], from_chip: &mut [u8]) -> Result<(), ChipError> {
        let done = if to_chip.len() == PACKET && self.rest_len == 0 {
            self.wires.exchange(to_chip, from_chip)
        } else {
            self.search(from_chip)
        };
        done.map_err(|error| chip_error(&self.info.name, &error))
    }

    fn wait_until(&mut self, time: Ns) -> Result<(), ChipError> {
        let left = time.saturating_sub(self.wires.now_ns());
        if left > 0 {
            self.wires.sleep(Duration::from_nanos(left));
        }
        Ok(())
    }

    fn wait_ready(&mut self, _until: Ns) -> Result<bool, ChipError> {
        Ok(false)
    }
}

impl<W: PacketWires> ChipLink for UsbChip<W> {
    fn info(&self) -> ChipInfo {
        self.info.clone()
    }

    fn int1(&mut self) -> Result<Option<bool>, ChipError> {
        Ok(None)
    }
}

/// The error of a link whose USB device cannot be used.
fn chip_error(name: &str, error: &UsbPacketError) -> ChipError {
    let next = match error {
        // The text of this error already says what to do.
        UsbPacketError::Bus(_) => None,
        UsbPacketError::Missing { .. } => Some("plug it in and switch it on, or correct vid= and pid= (`lsusb`)"),
        UsbPacketError::Several { .. } => Some("unplug the others"),
        UsbPacketError::NoEndpoints { .. } => Some("correct ep_out= and ep_in= (`lsusb -v`)"),
        UsbPacketError::Usb(UsbError::Access) => Some("be root, or give the device to this user by a udev rule"),
        UsbPacketError::Usb(UsbError::Busy) => Some("end the other program that uses it"),
        UsbPacketError::Usb(UsbError::NoDevice) => Some("it was unplugged: plug it in and open the link again"),
        UsbPacketError::Usb(_) => Some("pull it and plug it in again"),
        UsbPacketError::Late { .. } | UsbPacketError::Length { .. } => {
            Some("look whether vid=, pid=, ep_out= and ep_in= are those of an ECM-XFU")
        }
    };
    let message = match next {
        Some(next) => format!("{error}; {next}"),
        None => error.to_string(),
    };
    ChipError::Wires { name: name.to_owned(), message }
}

/// The USB device of an `xf-usb:` link, and its endpoints. \[OURS] No source gives the USB ids or the endpoints of an
/// ECM-XFU.
///
/// # Errors
/// [`UriError::OtherScheme`] if it is not an `xf-usb:` link; [`UriError::MissingKey`] without one of the ids or
/// endpoints.
fn usb_place(uri: &LinkUri) -> Result<PacketPlace, UriError> {
    uri.expect_scheme(Scheme::XfUsb)?;
    let id = |key| uri.given(key, keys::usb_id);
    let endpoint = |key| uri.given(key, |value| value.parse().ok());
    Ok(PacketPlace { vendor: id("vid")?, product: id("pid")?, output: endpoint("ep_out")?, input: endpoint("ep_in")? })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// XF-16.11 The error of a device that cannot be used ends with what to do.
    #[test]
    fn a_device_that_cannot_be_used_is_told_with_the_next_step() {
        let (vendor, product) = (0x1234, 0x00AB);
        for (error, expected) in [
            (UsbPacketError::Missing { vendor, product }, "1234:00ab; plug it in"),
            (UsbPacketError::Several { vendor, product, count: 2 }, "2 devices have the ids 1234:00ab; unplug"),
            (UsbPacketError::NoEndpoints { output: 1, input: 2, there: "none".into() }, "it has none; correct ep_out="),
            (UsbPacketError::Usb(UsbError::Access), "access denied; be root"),
            (UsbPacketError::Usb(UsbError::Busy), "busy; end the other program"),
            (UsbPacketError::Usb(UsbError::NoDevice), "no such device; it was unplugged"),
            (UsbPacketError::Usb(UsbError::Io), "input/output error; pull it"),
            (
                UsbPacketError::Length { what: "gives", found: 64, wanted: PACKET },
                "64 bytes and not 1024; look whether",
            ),
        ] {
            let said = chip_error("xf-usb:", &error).to_string();
            assert!(said.starts_with("xf-usb:: ") && said.contains(expected), "{said}: no {expected}");
        }
    }
}
