//! What commands that took time have fetched for the commands that give it to the host.

use super::jobs::DatagramJob;
use crate::ethercat::coe;
use crate::xf::request::EMERGENCIES_MAX;
use crate::xf::response::{Emergencies, Emergency};

/// What EEPROM_REQ has come to.
#[derive(Clone, Copy, Debug)]
pub(super) struct EepromResult {
    /// 0: it has succeeded.
    pub error: u8,
    data: [u8; 8],
    len: usize,
}

impl EepromResult {
    /// Words that were read, 4 at most.
    pub fn of(words: &[u16]) -> Self {
        let mut data = [0; 8];
        for (place, word) in data.as_chunks_mut().0.iter_mut().zip(words) {
            *place = word.to_le_bytes();
        }
        Self { error: 0, data, len: (2 * words.len()).min(8) }
    }

    pub const fn failed(error: u8) -> Self {
        Self { error, data: [0; 8], len: 0 }
    }

    pub fn data(&self) -> &[u8] {
        &self.data[..self.len]
    }
}

/// What waits for the host; `None`: nothing was fetched.
#[derive(Default)]
pub(super) struct Results {
    /// For EEPROM_GET.
    pub eeprom: Option<EepromResult>,
    /// For RAW_ECAT_FUNC_GET.
    pub datagram: Option<DatagramJob>,
    /// For RECV_MAILBOX: a mailbox as it was read.
    pub mail: Option<Vec<u8>>,
    pub emergencies: EmergencyList,
}

/// The newest emergencies of slaves.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct EmergencyList {
    /// The newest one in front.
    newest: [Option<Emergency>; EMERGENCIES_MAX],
    /// The running number of the newest one.
    running_number: u16,
}

impl EmergencyList {
    /// A slave has sent one. `[OURS]` The first one since the start has the running number 1; it wraps.
    pub fn add(&mut self, slave: u8, emergency: coe::Emergency) {
        self.running_number = self.running_number.wrapping_add(1);
        let coe::Emergency { code, register, data } = emergency;
        self.newest.rotate_right(1);
        let running_number = self.running_number;
        self.newest[0] = Some(Emergency { number: 0, slave, running_number, code, register, data });
    }

    /// The newest ones. `[OURS]` The newest is number 0, and reading takes none away.
    pub fn list(&self, count: usize) -> Option<Emergencies> {
        let mut places = self.newest;
        for (number, place) in (0..).zip(&mut places) {
            *place = place.map(|emergency| Emergency { number, ..emergency });
        }
        Emergencies::new(places.get(..count)?)
    }
}
