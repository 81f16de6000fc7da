//! Models of EtherCAT slaves. Whatever is their master drives them through [`Slave`]; they know of no board.
//!
//! A device is put together from parts: [`al`] its AL state, [`dictionary`] its objects, [`process_data`] what of them a cycle
//! moves, [`state_machine`] and
//! [`plant`] joined to an [`axis`], which does its [`homing`] by [`switches`]; [`device`] is what all of them do alike.
//! [`drive`] is a servo drive or a stepper made of them, [`hsp`] a pulse module, [`io`] a module of digital inputs and
//! outputs; both have digital [`lines`].

pub mod al;
pub mod axis;
pub mod device;
pub mod dictionary;
pub mod drive;
mod fault;
pub mod homing;
pub mod hsp;
pub mod io;
pub mod lines;
mod makers;
pub mod plant;
pub mod process_data;
pub mod state_machine;
pub mod switches;

pub use drive::{Drive, DriveConfig, DriveKind};
pub use fault::Fault;
pub use hsp::{Channels, Hsp, HspConfig};
pub use io::{Io, IoConfig};
pub use lines::InputPattern;
pub use makers::{FormatError, MAKERS_BYTES_MAX, MakersObject, MakersObjects, MakersType};
pub use state_machine::DeviceFault;
pub use switches::{HomeSwitch, Input, Travel};

pub use crate::ethercat::AlStatus;

use crate::coe::{AbortCode, ObjectAddress, SdoScope, SdoSize};
use plant::Following;

use crate::ethercat::{AlState, Ns};

/// Axes that a slave has at most: those of a pulse module of two channels.
pub const AXES_MAX: usize = 2;

/// A value of at most 4 bytes, or the first 4 of a longer one, read from an object dictionary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SdoValue {
    /// The object's size in bytes, at most 4.
    pub size: u8,
    /// The value, zero-extended.
    pub bits: u32,
}

impl SdoValue {
    /// What `read` puts into 4 bytes, and how long it says that the value is.
    fn of(read: impl FnOnce(&mut [u8]) -> Result<usize, AbortCode>) -> Result<Self, AbortCode> {
        let mut first = [0; 4];
        let len = read(&mut first)?;
        Ok(Self { size: len.min(4) as u8, bits: u32::from_le_bytes(first) })
    }
}

/// One simulated slave: state machine of the application layer, mailbox, process data and physics.
///
/// Time passes only in [`Slave::step`]. Arithmetic is integers or `+ - * /` and `sqrt` of `f64`, so that every target
/// computes the same bits.
pub trait Slave: Send {
    /// Its name for people, e.g. `drive`.
    fn name(&self) -> &str;

    /// The AL state it is in. It may fall back by itself, e.g. when its process data stay away.
    fn state(&self) -> AlState;

    /// Whether it can enter that state now; it has entered it if the answer is `Ok`.
    ///
    /// # Errors
    /// The AL status code of the refusal.
    fn enter(&mut self, target: AlState) -> Result<(), AlStatus>;

    /// SDO upload: the first bytes of the value go into `value`, as many as there is room for; what is behind them stays.
    /// How long the value is.
    ///
    /// # Errors
    /// The CoE abort code.
    fn read(&mut self, object: ObjectAddress, scope: SdoScope, value: &mut [u8]) -> Result<usize, AbortCode>;

    /// SDO download of a whole value.
    ///
    /// # Errors
    /// The CoE abort code.
    fn write(&mut self, object: ObjectAddress, scope: SdoScope, value: &[u8]) -> Result<(), AbortCode>;

    /// SDO upload of one sub-index; of more than 4 bytes the first 4, as the ECM-SK shows them (SK-6).
    ///
    /// # Errors
    /// The CoE abort code.
    fn upload(&mut self, object: ObjectAddress) -> Result<SdoValue, AbortCode> {
        SdoValue::of(|value| self.read(object, SdoScope::Entry, value))
    }

    /// SDO download of 1, 2 or 4 bytes to one sub-index.
    ///
    /// # Errors
    /// The CoE abort code.
    fn download(&mut self, object: ObjectAddress, size: SdoSize, value: u32) -> Result<(), AbortCode> {
        self.write(object, SdoScope::Entry, &value.to_le_bytes()[..size.bytes().into()])
    }

    /// The master sets the lengths of sync managers 2 (outputs) and 3 (inputs), bytes; 0: off. A device goes to SafeOP only if
    /// they are as long as what is mapped. Init sets both to 0.
    fn set_sync_managers(&mut self, outputs: u16, inputs: u16) {
        let _ = (outputs, inputs);
    }

    /// The process data frame passes: what the slave measured last goes into the image of its inputs, the image of its
    /// outputs comes out of it. `None`: the slave is in SafeOP and takes no outputs.
    fn exchange(&mut self, outputs: Option<&[u8]>, inputs: &mut [u8]);

    /// `dt_ns` pass.
    fn step(&mut self, dt_ns: Ns);

    /// The first half of [`Slave::step`]: `dt_ns` begin to pass. A motor that only has to follow a position is handed out,
    /// to be run for that time side by side with those of other slaves before [`Slave::end_step`] is called.
    fn begin_step(&mut self, dt_ns: Ns) -> Option<Following<'_>> {
        self.step(dt_ns);
        None
    }

    /// The second half.
    fn end_step(&mut self, dt_ns: Ns) {
        let _ = dt_ns;
    }

    /// Something goes wrong in the device, or is as it was. False: it has no such axis or channel.
    fn suffer(&mut self, fault: Fault) -> bool {
        let _ = fault;
        false
    }

    /// Gives it objects of its maker besides its own. They have no effect.
    fn give_makers_objects(&mut self, makers: MakersObjects) {
        let _ = makers;
    }

    /// Whether it has distributed clocks.
    fn has_dc(&self) -> bool {
        true
    }

    /// Where the shaft of an axis (from 0) really is, counts; `None`: it has no such axis.
    fn shaft(&self, axis: usize) -> Option<i64> {
        let _ = axis;
        None
    }

    /// Where the shafts of all its axes are.
    fn shafts(&self) -> [Option<i64>; AXES_MAX] {
        std::array::from_fn(|axis| self.shaft(axis))
    }
}
