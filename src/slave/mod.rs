//! Models of EtherCAT slaves. The simulated bus ([`crate::fieldbus::sim`]) drives them through [`Slave`].

use crate::coe::{AbortCode, ObjectAddress, SdoSize};
use crate::fieldbus::{AlState, Ns, Refusal, SlaveConfig, SlaveIn, SlaveOut};

/// A value read from an object dictionary.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SdoValue {
    /// The object's size in bytes; text and records are cut to 4.
    pub size: u8,
    /// The value, zero-extended.
    pub bits: u32,
}

/// A change of AL state that a slave refuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AlStatus(pub u16);

/// One simulated slave: state machine of the application layer, mailbox, process data and physics.
///
/// Time passes only in [`Slave::step`]. Arithmetic is integers or `+ - * /` and `sqrt` of `f64`, so that every target
/// computes the same bits.
pub trait Slave: Send {
    /// Its name for people, e.g. `drive`.
    fn name(&self) -> &str;

    /// Whether it can enter that state now; it has entered it if the answer is `Ok`.
    ///
    /// # Errors
    /// The AL status code of the refusal.
    fn enter(&mut self, target: AlState) -> Result<(), AlStatus>;

    /// Maps process data for a role and writes the mode, in PreOP.
    ///
    /// # Errors
    /// A [`Refusal`] if the slave does not have the role's objects; its slave number is filled in by the bus.
    fn configure(&mut self, config: &SlaveConfig) -> Result<(), Refusal>;

    /// SDO upload.
    ///
    /// # Errors
    /// The CoE abort code.
    fn upload(&mut self, object: ObjectAddress) -> Result<SdoValue, AbortCode>;

    /// SDO download.
    ///
    /// # Errors
    /// The CoE abort code.
    fn download(&mut self, object: ObjectAddress, size: SdoSize, value: u32) -> Result<(), AbortCode>;

    /// The process data frame passes: what the slave measured last goes in, `outputs` come out of it. `None`: the slave
    /// is in SafeOP and takes no outputs.
    fn exchange(&mut self, outputs: Option<&SlaveOut>, inputs: &mut SlaveIn);

    /// `dt_ns` pass.
    fn step(&mut self, dt_ns: Ns);
}
