//! The wire format of the ECM-XF: golden packets, every function byte by byte, finding packets in a stream; the
//! model of the chip and the driver of a host.
//!
//! Files:
//!
//! - `golden.rs`, `packets.rs`: golden packets; invalid packets, and the check word
//! - `header.rs`: the place of every field in the headers, and the meaning of its bits
//! - `codes.rs`: the 67 codes and 91 functions, against a list of its own
//! - `fields.rs`: the table of fields that goes with them
//! - `requests.rs`, `answers.rs`: every request and every answer byte by byte, as the manuals print them; which of them
//!   has which rule is in their folders
//! - `values.rs`: values that the manuals do not allow
//! - `roundtrip.rs`: encoding and decoding of anything
//! - `resync.rs`: packets in a stream of bytes
//! - `questions.rs`: `docs/HARDWARE.md` asks about every decision of this project
//! - `host.rs`, `host/`: the driver of a host, against a chip that is scripted there
//! - `pair.rs`, `pair/`: the driver and the model together, every function of them, with the feature `sim`
//! - `schedules.rs`, `schedules/`: the same two with random faults, by seeds, with the feature `sim`
//! - `chip.rs`, `chip/`: the model of the chip, with the feature `sim`; `network.rs`: its network
//! - `drivers.rs`, `drivers/`: hosts in the spirit of others' drivers against it, which share no line with this project's,
//!   and the list of what is known of those drivers, with its tests

mod answers;
#[cfg(feature = "sim")]
mod chip;
mod codes;
#[cfg(feature = "sim")]
mod drivers;
mod fields;
mod golden;
mod header;
mod host;
#[cfg(feature = "sim")]
mod network;
mod packets;
#[cfg(feature = "sim")]
mod pair;
mod questions;
mod requests;
mod resync;
mod roundtrip;
#[cfg(feature = "sim")]
mod schedules;
mod values;

use ecmsk::xf::request::{MotorNumber, SlaveNumber};
use ecmsk::xf::{
    CheckRule, CommandCode, CommandHeader, CommandPacket, DataSize, MAX_PACKET, Malformed, Request, Reserve,
    write_request,
};

fn slave(n: u8) -> SlaveNumber {
    SlaveNumber::new(n).expect("0 to 127")
}

fn motor(n: u8) -> MotorNumber {
    MotorNumber::new(n).expect("0 to 127")
}

/// A command as the manuals print it. Fields that are not named are 0.
#[derive(Clone, Debug, Default)]
struct Printed {
    code: u8,
    par: u8,
    info: [u8; 4],
    reserve: u16,
    len: u16,
    /// The beginning of the data segment; the rest of it is 0.
    data: Vec<u8>,
}

impl Printed {
    /// The whole packet with index 9 and a data segment of that size, its check word a CRC-32 made here.
    fn packet(&self, size: DataSize) -> Vec<u8> {
        let mut bytes = vec![0xA4, 0xA3, 0xA2, 0xA1];
        bytes.extend(self.info);
        bytes.extend(self.reserve.to_le_bytes());
        bytes.extend([0, 9, self.code, self.par]);
        bytes.extend(self.len.to_le_bytes());
        bytes.extend([0; 8]);
        bytes.extend(&self.data);
        bytes.resize(24 + size.bytes(), 0);
        let check = if self.code == 23 { 0x1234_5678 } else { crc32(&bytes) };
        bytes.extend(check.to_le_bytes());
        bytes.extend([0x59, 0x58, 0x57, 0x56]);
        bytes
    }

    /// Decodes the packet with the library.
    fn read<T>(&self, use_it: impl FnOnce(Result<Request<'_>, Malformed>) -> T) -> T {
        let bytes = self.packet(DataSize::NEWER);
        let packet = CommandPacket::parse(&bytes, DataSize::NEWER, CheckRule::CRC32).expect("a right packet");
        assert_eq!((packet.header.index, packet.header.code), (9, CommandCode::from_code(self.code)));
        assert_eq!(packet.header.reserve, Reserve(self.reserve));
        use_it(packet.request())
    }
}

/// Checks that the request is encoded to the printed bytes, and that these are decoded to it.
fn check<'d>(request: impl Into<Request<'d>>, printed: &Printed) {
    let request = request.into();
    let mut buffer = [0xA5; MAX_PACKET];
    let header = CommandHeader::with_index(9);
    let packet = write_request(&mut buffer, DataSize::NEWER, CheckRule::CRC32, header, &request).expect("it fits");
    assert_eq!(packet, printed.packet(DataSize::NEWER), "{request:?}");
    printed.read(|read| assert_eq!(read, Ok(request)));
    assert_eq!(request.code().code(), printed.code);
}

/// A CRC-32 bit by bit, as the manual defines it (XF EN 741).
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
    })
}

/// Bytes from numbers, each with its width.
macro_rules! bytes {
    ($($number:expr),* $(,)?) => {{
        let mut bytes: Vec<u8> = Vec::new();
        $(bytes.extend(($number).to_le_bytes());)*
        bytes
    }};
}

use bytes;
