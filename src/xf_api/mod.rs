//! The native Rust API for a chip ECM-XF: its commands as calls that wait for their end, and process data with types.
//!
//! [`Xf`] owns a chip behind a [`ChipLink`] and drives it by [`Host`]. It has no thread: bytes move while one of its
//! functions runs. That is enough, since the chip runs the EtherCAT cycle by itself and takes RxPDOs out of its FIFO; a
//! program that comes late is covered by those it has written ahead ([`ProcessData::ahead`]).
//!
//! The usual start of an application, and an axis that moves:
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
//!     // Where the objects of the slave are in its process data is what it has mapped.
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
//! Any of the 91 functions of the chip is run by its type from [`request`](crate::xf::request):
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
//! - `any.rs`: a command that is known only while the program runs
//! - `network.rs`: the network: its start, states, slaves
//! - `objects.rs`: SDO
//! - `layout.rs`: where objects are in the process data
//! - `process.rs`: [`ProcessData`], a cycle
//! - `axes.rs`: the CiA 402 helper; `stop.rs`: what stops an axis when a program ends
//! - `error.rs`: [`XfError`]

mod any;
mod axes;
mod error;
mod layout;
mod network;
mod objects;
mod process;
mod stop;

use std::time::Duration;

pub use error::XfError;
pub use layout::{Field, Layout, MappedField, SlaveLayout};
pub use network::{NetworkConfig, SlaveDescription};
pub use process::{Input, Output, ProcessData};

use crate::ethercat::Ns;
use crate::link::chip_link::ChipLink;
use crate::open;
use crate::xf::AnswerHeader;
use crate::xf::host::{Host, HostConfig, HostError, HostState, Ticket};
use crate::xf::request::Call;
use axes::Axis;
use stop::Motors;

/// A chip ECM-XF behind its link, started.
///
/// If it has sent outputs or switched an axis on, it stops what moves when it is dropped: see [`Xf::close`].
pub struct Xf<L: ChipLink = Box<dyn ChipLink>> {
    host: Host,
    link: L,
    /// Slaves on the network, as the chip has counted them.
    slaves: u8,
    /// The cycle with which the network was started.
    cycle_ns: Option<Ns>,
    /// Axes that the helper leads.
    axes: Vec<Axis>,
    /// Those that may be on: the helper was asked to lead them out of Switch on disabled, and they were not seen there
    /// since.
    on: Motors,
    /// This program has sent outputs or switched an axis on: it is for it to stop what moves.
    moves: bool,
}

impl Xf {
    /// Opens the chip that a link names, for example `xf-sim:?slaves=drive*2`, and starts it: n and the beginning of
    /// packets are found, CRC-32 is switched on, the firmware's version is read.
    ///
    /// # Errors
    /// [`XfError::Link`], [`XfError::Chip`].
    pub fn open(uri: &str) -> Result<Self, XfError> {
        let (link, config) = open::chip::open(uri)?;
        Self::over(link, config)
    }
}

impl<L: ChipLink> Xf<L> {
    /// The chip behind a link, started.
    ///
    /// # Errors
    /// [`XfError::Link`], [`XfError::Chip`].
    pub fn over(link: L, config: HostConfig) -> Result<Self, XfError> {
        let host = Host::new(link.now(), config);
        let mut xf =
            Self { host, link, slaves: 0, cycle_ns: None, axes: Vec::new(), on: Motors::default(), moves: false };
        xf.start()?;
        Ok(xf)
    }

    /// Goes on until the chip is started.
    fn start(&mut self) -> Result<(), XfError> {
        while self.host.state() != HostState::Running {
            self.step(Ns::MAX)?;
        }
        if self.host.gave_crc_up() {
            log::warn!("{}", HostError::CRC_GIVEN_UP);
        }
        Ok(())
    }

    /// The driver: its counters, n, the version of the firmware.
    pub const fn host(&self) -> &Host {
        &self.host
    }

    /// The driver, to set what headers put out on GPIO and which interrupt flags they clear.
    pub const fn host_mut(&mut self) -> &mut Host {
        &mut self.host
    }

    /// The link.
    pub const fn link(&self) -> &L {
        &self.link
    }

    /// The link, to read INT1, and of a model to use its pins.
    pub const fn link_mut(&mut self) -> &mut L {
        &mut self.link
    }

    /// The header of the newest answer: errors, levels of the FIFOs, interrupt flags, GPIO.
    pub fn header(&self) -> AnswerHeader {
        // A chip that is started has answered.
        self.host.header().copied().unwrap_or_default()
    }

    /// Runs a command to its end and gives its result. What takes time in the chip, such as a change of state, is waited
    /// for, for the default of [`Deadlines::busy_ns`](crate::xf::host::Deadlines::busy_ns).
    ///
    /// # Errors
    /// [`XfError::Chip`], [`XfError::Link`].
    pub fn run<'d, C: Call<'d>>(&mut self, call: &C) -> Result<C::Answer<'_>, XfError> {
        self.note_axis(call);
        let ticket = self.host.submit(self.link.now(), call)?;
        self.result(ticket, call)
    }

    /// As [`Self::run`], with another time for the command to run in the chip.
    ///
    /// # Errors
    /// As with [`Self::run`].
    pub fn run_within<'d, C: Call<'d>>(&mut self, call: &C, limit: Duration) -> Result<C::Answer<'_>, XfError> {
        self.note_axis(call);
        let ticket = self.host.submit_within(self.link.now(), call, ns(limit))?;
        self.result(ticket, call)
    }

    /// Runs a command and then the one that reads its result, which is given: see [`Host::submit_pair`]. `limit` is for
    /// the first one.
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

    /// Lets time pass. Meanwhile the chip is asked for its header every
    /// [`poll_ns`](crate::xf::host::HostConfig::poll_ns).
    ///
    /// # Errors
    /// [`XfError::Chip`], [`XfError::Link`].
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

    /// An exchange, or a wait until the next one.
    fn step(&mut self, until: Ns) -> Result<(), XfError> {
        Ok(self.host.step(&mut self.link, until)?)
    }
}

fn ns(time: Duration) -> Ns {
    Ns::try_from(time.as_nanos()).unwrap_or(Ns::MAX)
}
