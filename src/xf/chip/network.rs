//! The seam between the chip and its network. The slave models are behind it in [`slaves`]; a master with real
//! controllers can be.

pub mod slaves;

pub use slaves::SlaveModels;

use crate::coe::{AbortCode, ObjectAddress, SdoScope};
use crate::ethercat::{AlState, AlStatus, Ns};
use crate::xf::request::{MappedObject, PdoAssignment};

/// The most slaves that the chip numbers.
pub const SLAVES_MAX: usize = 128;
/// The most bytes of process data in each direction. `[OURS]` The largest data segment.
pub const IMAGE_MAX: usize = crate::xf::DataSize::MAX.bytes();

/// What the EEPROM of a slave says about it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Vendor id.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Revision.
    pub revision: u32,
    /// The device's name.
    pub name: String,
}

/// Where the process data of a slave are in the images, and to which state the chip has brought it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// First byte of its outputs in the RxPDO.
    pub outputs_at: u16,
    /// Bytes of its outputs.
    pub output_bytes: u16,
    /// First byte of its inputs in the TxPDO.
    pub inputs_at: u16,
    /// Bytes of its inputs.
    pub input_bytes: u16,
    /// The state to which the chip has brought it; the slave may have left it by itself.
    pub commanded: AlState,
}

impl Place {
    /// Its bytes in the image of outputs.
    pub const fn outputs(&self) -> std::ops::Range<usize> {
        self.outputs_at as usize..self.outputs_at as usize + self.output_bytes as usize
    }

    /// Its bytes in the image of inputs.
    pub const fn inputs(&self) -> std::ops::Range<usize> {
        self.inputs_at as usize..self.inputs_at as usize + self.input_bytes as usize
    }

    /// What the slave adds to the working counter in that state: 1 for inputs that are read, 2 for outputs that are
    /// written by LRW and 1 by LWR (ETG.1000.4 5.4). `[OURS]` Outputs count in OP alone.
    pub fn counts(&self, state: AlState, lrw: bool) -> u16 {
        let read = state >= AlState::SafeOp && self.input_bytes > 0;
        let written = state == AlState::Op && self.output_bytes > 0;
        u16::from(read) + if lrw { 2 * u16::from(written) } else { u16::from(written) }
    }
}

/// Why a slave does not enter a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EnterError {
    /// It does not answer.
    NoAnswer,
    /// It refuses, with that AL status code.
    Refused(AlStatus),
}

/// A network as the chip needs it. Slaves are numbered from 0; a number that no slave has is one that does not answer.
pub trait Network: Send {
    /// Whether the network port has a link.
    fn has_link(&self) -> bool;

    /// Counts the slaves, [`SLAVES_MAX`] at most, brings those that answer to Init and reads their EEPROMs.
    fn scan(&mut self) -> u8;

    /// What the last scan has read of a slave's EEPROM; `None` if there is no such slave.
    fn identity(&self, slave: u8) -> Option<&Identity>;

    /// Whether the slave has distributed clocks.
    fn has_dc(&self, slave: u8) -> bool;

    /// The AL state; `None`: the slave does not answer.
    fn state(&self, slave: u8) -> Option<AlState>;

    /// Requests an AL state.
    ///
    /// # Errors
    /// The slave does not answer, or refuses.
    fn enter(&mut self, slave: u8, state: AlState) -> Result<(), EnterError>;

    /// Sets the lengths of sync managers 2 (outputs) and 3 (inputs), bytes.
    fn set_sync_managers(&mut self, slave: u8, outputs: u16, inputs: u16);

    /// Sets the cycle of SYNC0; `None`: the slave runs without distributed clocks.
    fn set_sync_cycle(&mut self, slave: u8, cycle_ns: Option<Ns>);

    /// SDO upload of as much of the value as `value` has room for. The length of the whole value.
    ///
    /// # Errors
    /// The abort code; [`AbortCode::TIMEOUT`] if the slave does not answer.
    fn read(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, value: &mut [u8])
    -> Result<usize, AbortCode>;

    /// SDO download of a whole value.
    ///
    /// # Errors
    /// As [`Self::read`].
    fn write(&mut self, slave: u8, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode>;

    /// How much longer than others SDO transfers with a slave take.
    fn sdo_delay_ns(&self, _slave: u8) -> Ns {
        0
    }

    /// The abort code with which a slave aborts a transfer of SDO_REQ whatever its dictionary says; `None`: it does not.
    fn sdo_abort(&self, _slave: u8, _object: ObjectAddress) -> Option<AbortCode> {
        None
    }

    /// The process data of a cycle: `places` says what belongs to whom, the first one to slave 0. The inputs of slaves
    /// that do not answer keep their values. The working counter.
    fn exchange(&mut self, places: &[Place], outputs: &[u8], inputs: &mut [u8], lrw: bool) -> u16;

    /// `dt_ns` pass.
    fn pass(&mut self, dt_ns: Ns);
}

/// One object of a slave, up to 4 bytes; a longer one is a wrong length.
pub(super) fn read_number(network: &mut impl Network, slave: u8, index: u16, sub: u8) -> Result<u32, AbortCode> {
    let mut value = [0; 4];
    match network.read(slave, ObjectAddress::new(index, sub), SdoScope::Entry, &mut value)? {
        1..=4 => Ok(u32::from_le_bytes(value)),
        _ => Err(AbortCode::LENGTH),
    }
}

/// An entry of a mapping object.
pub(super) fn read_entry(
    network: &mut impl Network,
    slave: u8,
    index: u16,
    sub: u8,
) -> Result<MappedObject, AbortCode> {
    Ok(MappedObject::from_bytes(read_number(network, slave, index, sub)?.to_le_bytes()))
}

/// Calls `each` with every PDO that is assigned, and how many objects it has.
///
/// # Errors
/// The abort code with which the slave aborts, or of `each`.
pub(super) fn each_pdo<N: Network>(
    network: &mut N,
    slave: u8,
    assignment: PdoAssignment,
    mut each: impl FnMut(&mut N, u16, u8) -> Result<(), AbortCode>,
) -> Result<(), AbortCode> {
    let count = match read_number(network, slave, assignment.code(), 0) {
        // A slave without process data in this direction.
        Err(AbortCode::NO_OBJECT) => 0,
        count => count?,
    };
    for sub in 1..=count.min(u8::MAX.into()) as u8 {
        let index = read_number(network, slave, assignment.code(), sub)? as u16;
        let objects = read_number(network, slave, index, 0)? as u8;
        each(network, index, objects)?;
    }
    Ok(())
}

/// How many bytes are mapped in a direction, as the slave's own mapping objects say.
///
/// # Errors
/// The abort code with which the slave aborts, or [`AbortCode::PDO_LENGTH`]: more than [`IMAGE_MAX`].
pub(super) fn mapped_bytes(network: &mut impl Network, slave: u8, assignment: PdoAssignment) -> Result<u16, AbortCode> {
    let mut bits = 0_usize;
    each_pdo(network, slave, assignment, |network, index, objects| {
        for sub in 1..=objects {
            bits += usize::from(read_entry(network, slave, index, sub)?.bits);
        }
        Ok(())
    })?;
    let bytes = bits.div_ceil(8);
    if bytes > IMAGE_MAX { Err(AbortCode::PDO_LENGTH) } else { Ok(bytes as u16) }
}
