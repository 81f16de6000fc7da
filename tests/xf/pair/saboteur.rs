//! A wire on which one function has no effect: its packets come to the chip as INFO_UPDATE, and the answers go back as
//! if the chip had run it. A test that still passes then does not depend on the function.

use std::cell::Cell;

use ecmsk::xf::CommandCode;

use crate::crc32;

/// A function: its code and, with codes 31 to 35, its parameter.
pub type Function = (CommandCode, Option<u8>);

thread_local! {
    static IGNORED: Cell<Option<Function>> = const { Cell::new(None) };
}

/// From now on that function has no effect in pairs of this thread.
pub fn ignore(function: Option<Function>) {
    IGNORED.set(function);
}

const FIXED: [u8; 4] = [0x78, 0x56, 0x34, 0x12];
const INDEX: usize = 0x0B;
const CODE: usize = 0x0C;
const PARAMETER: usize = 0x0D;

#[derive(Debug, Default)]
pub struct Saboteur {
    function: Option<Function>,
    /// The index of the last packet that was replaced.
    index: Option<u8>,
    /// The first answer to INFO_UPDATE, whose header all later ones get.
    stale: Option<[u8; 24]>,
}

impl Saboteur {
    /// A saboteur that acts from power-on, for commands that are reserved for the driver.
    pub fn of_the_start() -> Self {
        let is_of_driver = |(code, _): &Function| matches!(code, CommandCode::CrcTypeSet | CommandCode::SpiReconfig);
        Self { function: IGNORED.get().filter(is_of_driver), ..Self::default() }
    }

    /// A saboteur that acts once the chip is started.
    pub fn of_this_thread() -> Self {
        Self { function: IGNORED.get(), ..Self::default() }
    }

    /// A packet to the chip.
    pub fn outgoing(&mut self, packet: &mut [u8]) {
        let Some((code, parameter)) = self.function.filter(|(code, _)| *code != CommandCode::InfoUpdate) else {
            return;
        };
        if packet[..4] == [0xA4, 0xA3, 0xA2, 0xA1]
            && packet[CODE] == code.code()
            && parameter.is_none_or(|parameter| packet[PARAMETER] == parameter)
        {
            self.index = Some(packet[INDEX]);
            packet[CODE] = 0;
            seal(packet);
        }
    }

    /// An answer of the chip.
    pub fn incoming(&mut self, packet: &mut [u8]) {
        let Some((code, _)) = self.function.filter(|_| packet[..4] == [0xA4, 0xA3, 0xA2, 0xA1]) else { return };
        if code == CommandCode::InfoUpdate {
            if packet[CODE] == 0 {
                let stale = *self.stale.get_or_insert_with(|| packet[..24].try_into().expect("24 bytes"));
                packet[4..INDEX].copy_from_slice(&stale[4..INDEX]);
                packet[0x10..24].copy_from_slice(&stale[0x10..]);
                seal(packet);
            }
        } else if packet[CODE] == 0 && self.index == Some(packet[INDEX]) {
            packet[CODE] = code.code();
            seal(packet);
        } else {
            self.index = self.index.filter(|index| packet[INDEX] == index.wrapping_sub(1));
        }
    }
}

/// Recomputes the check word.
fn seal(packet: &mut [u8]) {
    let end = packet.len() - 8;
    if packet[end..end + 4] != FIXED {
        let check = crc32(&packet[..end]).to_le_bytes();
        packet[end..end + 4].copy_from_slice(&check);
    }
}
