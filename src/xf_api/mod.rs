//! The native Rust API for an ECM-XF: its commands as calls that block until they end, and typed process data.
//!
//! [`Xf`] owns a chip behind a [`ChipLink`] and drives it with [`Host`]. It has no thread: bytes move only while one of
//! its functions runs. That is enough, since the chip runs the EtherCAT cycle by itself and takes RxPDOs out of its
//! FIFO. If the program is late, the chip still has RxPDOs to send that the program has written in advance
//! ([`ProcessData::ahead`]).
//!
//! A typical start of an application, with an axis that moves:
//!
//! ```
//! use ecmsk::coe::ObjectAddress;
//! use ecmsk::xf::EtherCatState;
//! use ecmsk::xf::request::{FifoEnable, Reconfig, Slaves};
//! use ecmsk::xf_api::{NetworkConfig, Xf, XfError};
//!
//! fn main() -> Result<(), XfError> {
//!     // A modelled chip with one servo drive, in virtual time.
//!     let mut xf = Xf::open("xf-sim:?slaves=drive&clock=virtual")?;
//!     assert_eq!(xf.start_network(&NetworkConfig::default())?, 1);
//!     xf.set_state(Slaves::All, EtherCatState::PreOp)?;
//!     xf.sdo_write(0, ObjectAddress::new(0x6060, 0), 8_i8)?; // CSP
//!     xf.run(&Reconfig)?;
//!     xf.set_state(Slaves::All, EtherCatState::SafeOp)?;
//!
//!     // The slave's mapping decides where its objects are in the process data.
//!     let mut data = xf.process_data()?;
//!     let target = data.output::<i32>(0, ObjectAddress::new(0x607A, 0))?;
//!     let position = data.input::<i32>(0, ObjectAddress::new(0x6064, 0))?;
//!     let start = data.get(position);
//!     data.set(target, start);
//!     xf.add_axis(0, 0, &data)?;
//!     xf.set_state(Slaves::All, EtherCatState::Op)?;
//!     xf.run(&FifoEnable { on: true })?;
//!     xf.cycle(&mut data)?;
//!     xf.enable(0)?;
//!
//!     for n in 1..=700 {
//!         data.set(target, start + 10 * n.min(500)); // counts: 10 per cycle of 1 ms, and then it comes to rest
//!         xf.cycle(&mut data)?;
//!     }
//!     xf.finish(&mut data)?;
//!     assert_eq!(data.get(position), start + 5000);
//!     xf.close()
//! }
//! ```
//!
//! Each function of the chip has a type in [`request`](crate::xf::request), with which to run it:
//!
//! ```
//! use ecmsk::xf::request::FirmwareVersionGet;
//! use ecmsk::xf_api::Xf;
//!
//! let mut xf = Xf::open("xf-sim:?clock=virtual")?;
//! assert_eq!(xf.run(&FirmwareVersionGet)?.version, 0x22);
//! # Ok::<(), ecmsk::xf_api::XfError>(())
//! ```
//!
//! - `mod.rs`: [`Xf`], which runs any command
//! - `run_request.rs`: commands that the program knows only at run time
//! - `network.rs`: the start of the network, its states and slaves
//! - `objects.rs`: SDO
//! - `layout.rs`: where objects are in the process data
//! - `process.rs`: [`ProcessData`], a cycle
//! - `axes.rs`: the CiA 402 helper; `stop.rs`: stopping the axes when a program ends
//! - `error.rs`: [`XfError`]

mod axes;
mod error;
mod layout;
mod network;
mod objects;
mod process;
mod run_request;
mod stop;

use std::time::Duration;

pub use error::XfError;
pub use layout::{FieldType, Layout, MappedField, SlaveLayout};
pub use network::{NetworkConfig, SlaveDescription};
pub use process::{Input, Output, ProcessData};

use crate::ethercat::Ns;
use crate::link::chip_link::ChipLink;
use crate::open;
use crate::xf::AnswerHeader;
use crate::xf::host::{Host, HostConfig, HostError, HostState, Ticket};
use crate::xf::request::Call;
use axes::HelperAxis;
use stop::Motors;

/// A started ECM-XF chip behind its link.
///
/// If the program has sent outputs or switched an axis on, dropping this value stops all moving axes: see
/// [`Xf::close`].
pub struct Xf<L: ChipLink = Box<dyn ChipLink>> {
    host: Host,
    link: L,
    /// Number of slaves on the network, as counted by the chip.
    slaves: u8,
    /// The cycle time with which the network was started.
    cycle_ns: Option<Ns>,
    /// Axes that were added, whose state machines the helper drives.
    axes: Vec<HelperAxis>,
    /// Axes that may be on: the helper was asked to take them out of Switch on disabled, and they were not seen in that
    /// state since.
    on: Motors,
    /// Whether this program has sent outputs or switched an axis on, and so has to stop the axes at its end.
    moves: bool,
}

impl Xf {
    /// Opens the chip that a link names, for example `xf-sim:?slaves=drive*2`, and starts it: finds n (the size of the
    /// data segment) and the beginning of packets, switches CRC-32 on, and reads the firmware's version.
    ///
    /// # Errors
    /// [`XfError::Link`] if the link is wrong or cannot be opened or used. [`XfError::Chip`] if no packets are found,
    /// if the chip does not answer, or if its start takes too long.
    pub fn open(uri: &str) -> Result<Self, XfError> {
        let (link, config) = open::chip::open(uri)?;
        Self::over(link, config)
    }
}

impl<L: ChipLink> Xf<L> {
    /// Starts the chip behind an open link, as [`Xf::open`] does.
    ///
    /// # Errors
    /// [`XfError::Link`] if the link fails. [`XfError::Chip`] if no packets are found, if the chip does not answer, or
    /// if its start takes too long.
    pub fn over(link: L, config: HostConfig) -> Result<Self, XfError> {
        let host = Host::new(link.now(), config);
        let mut xf =
            Self { host, link, slaves: 0, cycle_ns: None, axes: Vec::new(), on: Motors::default(), moves: false };
        xf.start()?;
        Ok(xf)
    }

    /// Steps the driver until the chip is started.
    fn start(&mut self) -> Result<(), XfError> {
        while self.host.state() != HostState::Running {
            self.step(Ns::MAX)?;
        }
        if self.host.gave_crc_up() {
            log::warn!("{}", HostError::CRC_GIVEN_UP);
        }
        Ok(())
    }

    /// The driver, with its counters, n (the size of the data segment) and the firmware's version.
    pub const fn host(&self) -> &Host {
        &self.host
    }

    /// The driver, with which a program sets what the headers of all packets carry: the GPIO outputs, and the interrupt
    /// flags to clear.
    pub const fn host_mut(&mut self) -> &mut Host {
        &mut self.host
    }

    /// The link to the chip, for example to read its properties.
    pub const fn link(&self) -> &L {
        &self.link
    }

    /// The link, to read INT1 and, for a modelled chip, to use its pins.
    pub const fn link_mut(&mut self) -> &mut L {
        &mut self.link
    }

    /// The header of the newest answer, with errors, FIFO levels, interrupt flags and GPIO.
    pub fn header(&self) -> AnswerHeader {
        // A started chip has answered, so there is a header.
        self.host.header().copied().unwrap_or_default()
    }

    /// Runs a command to its end and returns its result. Commands that take time in the chip, such as a change of
    /// state, may run for the default of [`Timeouts::busy_ns`](crate::xf::host::Timeouts::busy_ns).
    ///
    /// # Errors
    /// [`XfError::Chip`] if the chip refuses the command, if the command fails or does not end in time, if its answer
    /// is lost, or if the driver has stopped. [`XfError::Link`] if the link fails.
    pub fn run<'d, C: Call<'d>>(&mut self, call: &C) -> Result<C::Answer<'_>, XfError> {
        self.note_axis(call);
        let ticket = self.host.submit(self.link.now(), call)?;
        self.result(ticket, call)
    }

    /// Like [`Self::run`], with another time limit for the command in the chip.
    ///
    /// # Errors
    /// As with [`Self::run`].
    pub fn run_within<'d, C: Call<'d>>(&mut self, call: &C, limit: Duration) -> Result<C::Answer<'_>, XfError> {
        self.note_axis(call);
        let ticket = self.host.submit_within(self.link.now(), call, ns(limit))?;
        self.result(ticket, call)
    }

    /// Runs a command and then the command that reads its result, and returns that result: see [`Host::submit_pair`].
    /// `limit` is the time limit of the first command.
    ///
    /// # Errors
    /// As with [`Self::run`].
    pub fn run_pair<'d, 'e, C: Call<'d>, R: Call<'e>>(
        &mut self,
        call: &C,
        read: &R,
        limit: Duration,
    ) -> Result<R::Answer<'_>, XfError> {
        self.note_axis(call);
        let ticket = self.host.submit_pair(self.link.now(), call, read, ns(limit))?;
        self.result(ticket, read)
    }

    /// Lets time pass. Meanwhile the driver asks the chip for its header every
    /// [`poll_ns`](crate::xf::host::HostConfig::poll_ns).
    ///
    /// # Errors
    /// [`XfError::Chip`] if the driver has stopped. [`XfError::Link`] if the link fails.
    pub fn pass(&mut self, time: Duration) -> Result<(), XfError> {
        let end = self.link.now().saturating_add(ns(time));
        while self.link.now() < end {
            self.step(end)?;
        }
        Ok(())
    }

    fn result<'d, C: Call<'d>>(&mut self, ticket: Ticket, call: &C) -> Result<C::Answer<'_>, XfError> {
        while !self.host.is_done(ticket) {
            if let Err(error) = self.step(Ns::MAX) {
                self.host.abandon(ticket);
                return Err(error);
            }
        }
        match self.host.take(ticket, call) {
            Some(result) => Ok(result?),
            None => unreachable!("the command is done"),
        }
    }

    /// Makes one exchange, or waits until the next one is due.
    fn step(&mut self, until: Ns) -> Result<(), XfError> {
        Ok(self.host.step(&mut self.link, until)?)
    }
}

fn ns(time: Duration) -> Ns {
    Ns::try_from(time.as_nanos()).unwrap_or(Ns::MAX)
}
