//! Two drives behind a wrapper that records what reached them: SDO writes, SDO reads, and the serial number of each
//! cycle's RxPDO. Each cycle's TxPDO has a serial number of its own.

use ecmsk::coe::{AbortCode, ObjectAddress, SdoScope};
use ecmsk::ethercat::{AlState, Ns};
use ecmsk::xf::chip::{EnterError, IMAGE_MAX, ImageRanges, ImmediateNetwork, SlaveIdentity, SlaveModels};

use crate::network::drive;

/// SDO writes of a number go here.
pub const WRITTEN: ObjectAddress = ObjectAddress::new(0x2100, 0);
/// Objects from here on up to 0x5FFF are read: each has a number of its own.
const READ: u16 = 0x3000;
/// Sub-indices of each of them.
const SUBS: u32 = 200;

/// The object of a number.
pub fn read_object(n: u32) -> ObjectAddress {
    ObjectAddress::new(READ + (n / SUBS) as u16, (n % SUBS) as u8)
}

/// The value of that object.
pub fn read_value(n: u32) -> u32 {
    n.wrapping_mul(0x9E37_79B1)
}

/// Process data with their serial number in each byte; number 0 is all 0, as outputs are before the first ones.
pub fn pdo(serial: u32, bytes: usize) -> Vec<u8> {
    let byte = |at: usize| serial.rotate_left(8 * (at as u32 / 4)).to_le_bytes()[at % 4];
    (0..bytes).map(byte).collect()
}

/// What reached the slaves.
#[derive(Default)]
pub struct Log {
    pub writes: Vec<u32>,
    pub reads: Vec<u32>,
    /// Serial numbers of RxPDOs in OP, each with the number of cycles in a row that had it.
    pub cycles: Vec<(u32, u32)>,
    /// The serial number of the newest TxPDO.
    pub tx: u32,
}

pub struct Logged {
    models: SlaveModels,
    pub log: Log,
}

impl Logged {
    pub fn new() -> Self {
        Self { models: SlaveModels::new(vec![drive(), drive()]), log: Log::default() }
    }

    /// Makes a slave not answer SDOs, or answer again.
    pub fn silence(&mut self, slave: u8, silent: bool) {
        self.models.silence(slave, silent);
    }

    fn note_cycle(&mut self, outputs: &[u8]) {
        let serial = outputs.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes));
        assert_eq!(outputs, pdo(serial, outputs.len()), "an RxPDO is of one piece");
        match self.log.cycles.last_mut() {
            Some((last, cycles)) if *last == serial => *cycles += 1,
            _ => self.log.cycles.push((serial, 1)),
        }
    }
}

impl ImmediateNetwork for Logged {
    fn has_link(&self) -> bool {
        self.models.has_link()
    }

    fn scan(&mut self) -> u8 {
        self.models.scan()
    }

    fn identity(&self, slave: u8) -> Option<&SlaveIdentity> {
        self.models.identity(slave)
    }

    fn has_dc(&self, slave: u8) -> bool {
        self.models.has_dc(slave)
    }

    fn state(&self, slave: u8) -> Option<AlState> {
        self.models.state(slave)
    }

    fn enter(&mut self, slave: u8, state: AlState) -> Result<(), EnterError> {
        self.models.enter(slave, state)
    }

    fn set_sync_managers(&mut self, slave: u8, outputs: u16, inputs: u16) {
        self.models.set_sync_managers(slave, outputs, inputs);
    }

    fn set_sync_cycle(&mut self, slave: u8, cycle_ns: Option<Ns>) {
        self.models.set_sync_cycle(slave, cycle_ns);
    }

    fn read(
        &mut self,
        slave: u8,
        object: ObjectAddress,
        scope: SdoScope,
        value: &mut [u8],
    ) -> Result<usize, AbortCode> {
        if !(READ..0x6000).contains(&object.index) {
            return self.models.read(slave, object, scope, value);
        }
        self.models.state(slave).ok_or(AbortCode::TIMEOUT)?;
        let n = u32::from(object.index - READ) * SUBS + u32::from(object.sub);
        self.log.reads.push(n);
        value[..4].copy_from_slice(&read_value(n).to_le_bytes());
        Ok(4)
    }

    fn write(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode> {
        if object != WRITTEN {
            return self.models.write(slave, object, scope, value);
        }
        self.models.state(slave).ok_or(AbortCode::TIMEOUT)?;
        self.log.writes.push(u32::from_le_bytes(value.try_into().expect("a number")));
        Ok(())
    }

    fn exchange(&mut self, places: &[ImageRanges], outputs: &[u8], inputs: &mut [u8], lrw: bool) -> u16 {
        // The drives stay off: their outputs are numbers here.
        let working_counter = self.models.exchange(places, &[0; IMAGE_MAX], inputs, lrw);
        if places.iter().any(|place| place.commanded == AlState::Op) {
            self.note_cycle(&outputs[..places.iter().map(|place| usize::from(place.output_bytes)).sum()]);
        }
        self.log.tx += 1;
        let bytes = places.iter().map(|place| usize::from(place.input_bytes)).sum();
        inputs[..bytes].copy_from_slice(&pdo(self.log.tx, bytes));
        working_counter
    }

    fn pass(&mut self, dt_ns: Ns) {
        self.models.pass(dt_ns);
    }
}
