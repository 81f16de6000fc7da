//! A slave with one object of any length, for SDOs in segments.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::ethercat::{AlState, Ns};
use ecmsk::slave::esc::{EscSettings, EscSlave, eeprom_of};
use ecmsk::slave::{AlStatus, Drive, DriveConfig, Slave};

/// A device with one object, 0x2000:0, of any length.
#[derive(Default)]
pub struct Blob {
    pub value: Vec<u8>,
    pub state: AlState,
    /// How often the object was written.
    pub writes: Arc<AtomicUsize>,
}

/// The object.
pub const BLOB: ObjectAddress = ObjectAddress::new(0x2000, 0);

impl Blob {
    /// A slave with this device, in Init, with the EEPROM of a drive.
    pub fn slave(self) -> EscSlave {
        let settings = EscSettings::default();
        let eeprom = eeprom_of(&mut Drive::new(DriveConfig::default()), &settings).expect("it can be described");
        EscSlave::new(Box::new(self), settings, eeprom, 0)
    }

    /// A blob with that many bytes.
    pub fn of(len: usize) -> Self {
        Self { value: bytes(len), ..Self::default() }
    }
}

/// Bytes each of which differs from its neighbours.
pub fn bytes(len: usize) -> Vec<u8> {
    (0..len).map(|n| (n * 7 + 3) as u8).collect()
}

impl Slave for Blob {
    fn name(&self) -> &str {
        "blob"
    }

    fn state(&self) -> AlState {
        self.state
    }

    fn enter(&mut self, target: AlState) -> Result<(), AlStatus> {
        self.state = target;
        Ok(())
    }

    fn read(&mut self, object: ObjectAddress, _: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode> {
        if object != BLOB {
            return Err(AbortCode::NO_OBJECT);
        }
        let len = value.len().min(self.value.len());
        value[..len].copy_from_slice(&self.value[..len]);
        Ok(self.value.len())
    }

    fn write(&mut self, object: ObjectAddress, _: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        if object != BLOB {
            return Err(AbortCode::NO_OBJECT);
        }
        self.value = value.to_vec();
        self.writes.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    fn exchange(&mut self, _: Option<&[u8]>, _: &mut [u8]) {}

    fn step(&mut self, _: Ns) {}
}
