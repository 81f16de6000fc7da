//! Results of commands that took time, kept for the commands with which the host reads them.

use super::jobs::DatagramJob;
use crate::ethercat::coe;
use crate::xf::request::EMERGENCIES_MAX;
use crate::xf::response::{Emergencies, Emergency};

/// The result of EEPROM_REQ, kept for EEPROM_GET.
#[derive(Clone, Copy, Debug)]
pub(super) struct EepromResult {
    /// The error code that EEPROM_GET returns: 0 success, 1 no answer, 2 timeout or busy, 3 command refused.
    pub error: u8,
    data: [u8; 8],
    len: usize,
}

impl EepromResult {
    /// The result of a successful read of up to 4 words.
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

/// Results that wait until the host reads them; `None` if there is none.
#[derive(Default)]
pub(super) struct Results {
    /// The result for EEPROM_GET.
    pub eeprom: Option<EepromResult>,
    /// The result for RAW_ECAT_FUNC_GET.
    pub datagram: Option<DatagramJob>,
    /// The result for RECV_MAILBOX: a mailbox message as it was read.
    pub mail: Option<Vec<u8>>,
    pub emergencies: EmergencyList,
}

/// The newest emergencies of slaves, kept for COE_EMERGENCY.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct EmergencyList {
    /// The emergencies, the newest one first.
    newest: [Option<Emergency>; EMERGENCIES_MAX],
    /// The running number of the newest emergency.
    running_number: u16,
}

impl EmergencyList {
    /// Adds an emergency of a slave. `[OURS]` Its running number, which COE_EMERGENCY shows, counts the emergencies since the
    /// start of the chip from 1 on and wraps.
    pub fn add(&mut self, slave: u8, emergency: coe::Emergency) {
        self.running_number = self.running_number.wrapping_add(1);
        let coe::Emergency { code, register, data } = emergency;
        self.newest.rotate_right(1);
        let running_number = self.running_number;
        self.newest[0] = Some(Emergency { number: 0, slave, running_number, code, register, data });
    }

    /// The `count` newest emergencies, the newest one first; `None` if `count` is more than [`EMERGENCIES_MAX`].
    /// `[OURS]` The number of each emergency is its position in the list, from 0. Reading does not remove emergencies.
    pub fn list(&self, count: usize) -> Option<Emergencies> {
        let mut places = self.newest;
        for (number, place) in (0..).zip(&mut places) {
            *place = place.map(|emergency| Emergency { number, ..emergency });
        }
        Emergencies::new(places.get(..count)?)
    }
}
