//! Simulated slaves for any EtherCAT master: they answer the frames that arrive at a network interface (Linux), on the
//! real clock.
//!
//! Files, in the order in which to read them:
//!
//! - `mod.rs`: [`Server`], its options and errors
//! - `masters.rs`: detecting masters
//! - `network.rs`: the slaves, and the actions of a script on them; time is an argument
//! - `told.rs`: log lines about the slaves
//! - `service.rs`: the thread

mod masters;
mod network;
mod service;
mod told;

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

pub use crate::io::ethernet::InterfaceError;
pub use network::Network;

use super::log_limit::LogLimit;
use super::serving::{Serving, Shared};
use crate::address::slaves::SlaveSpec;
use crate::engine::RealTime;
use crate::ethercat::ETHERTYPE;
use crate::io::ethernet::{self, Claim, DefaultRoute, EthernetSocket};
use crate::link::machine_error::SimulatedSlavesError;
use crate::link::record::NetworkRecording;
use crate::notes::{NoteThread, Notes};
use crate::slave::cable::Cable;
use crate::slave::esc::UndescribedError;
use crate::testbed::simulated_slaves;
use masters::Masters;
use service::{Failure, Port, Service};

/// The settings of a server of simulated slaves: its network interfaces, the slaves, their faults, and the log.
#[derive(Clone)]
pub struct Options {
    /// The name of the network interface of this machine at which a master reaches the first slave.
    pub interface: String,
    /// The name of a second interface at the other end of the cable, which closes a ring while it has a link; `None`:
    /// the slaves are a line without a ring.
    pub second: Option<String>,
    /// The slaves in network order.
    pub slaves: Vec<SlaveSpec>,
    /// The largest drift of the slaves' clocks, parts per million: the first clock is too fast by this value, the last
    /// one too slow by it, and the others are evenly spread between them.
    pub drift_ppm: u16,
    /// A script with faults and other events of the slaves, and their times; `None`: there is no script.
    pub script: Option<PathBuf>,
    /// The file to which all frames and their answers are recorded; `None`: nothing is recorded.
    pub record: Option<PathBuf>,
    /// Whether an interface with the default route of this machine may be used. This is refused by default, since
    /// everybody on that network would get the EtherCAT frames.
    pub allow_default_route: bool,
    /// The real-time settings of the thread that answers frames; each setting that the system refuses is logged.
    pub real_time: RealTime,
    /// Called with each line of the log, in a thread of its own for which no other thread waits. If the function is too
    /// slow, lines are dropped, and a line reports their number.
    pub tell: Arc<dyn Fn(&str) + Send + Sync>,
    /// Called when the server has ended by itself, for example because an interface is gone, as the last action of the
    /// thread of the slaves. [`Server::stop`] returns the reason.
    pub failed: Arc<dyn Fn() + Send + Sync>,
}

/// Why slaves cannot be served.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ServeError {
    /// A network interface cannot be used, see [`InterfaceError`].
    #[error(transparent)]
    Interface(#[from] InterfaceError),
    /// The simulated slaves cannot be made, see [`SimulatedSlavesError`].
    #[error(transparent)]
    Slaves(#[from] SimulatedSlavesError),
    /// The list of slaves is empty.
    #[error("no slave is to be served; name some with --slaves, e.g. 'drive*2,io'")]
    NoSlave,
    /// No EEPROM content can be made for a slave, because its object dictionary does not describe its process data or
    /// does not fit.
    #[error(transparent)]
    Description(#[from] UndescribedError),
    /// The file for the recording cannot be created.
    #[error("cannot record to {}: {source}; name another file with --record or leave it out", file.display())]
    Record { file: PathBuf, source: io::Error },
    /// Both ends of the cable are the same interface.
    #[error(
        "{interface} is the interface at both ends; with --second name the one at the other end of the cable, or leave it out"
    )]
    SameInterface { interface: String },
    /// A network interface disappeared while it was served.
    #[error(
        "the network interface {interface} is gone, so the slaves cannot be reached any more; create it again, then \
         restart the server"
    )]
    Gone { interface: String },
    /// The operating system did not provide a thread or another resource.
    #[error("{what}: {source}; free some memory, files or threads, then start it again")]
    System { what: &'static str, source: io::Error },
}

/// A running server; it ends when this value is stopped or dropped.
pub struct Server {
    cable: Cable,
    serving: Serving,
    failure: Failure,
}

impl Server {
    /// Switches the simulated slaves on and lets them answer masters.
    ///
    /// # Errors
    /// [`ServeError::NoSlave`], [`ServeError::SameInterface`]; [`ServeError::Interface`] if an interface cannot be
    /// used; [`ServeError::Slaves`] and [`ServeError::Description`] if the slaves cannot be simulated;
    /// [`ServeError::Record`]; [`ServeError::System`].
    pub fn start(options: Options) -> Result<Self, ServeError> {
        let system = |what| move |source: io::Error| ServeError::System { what, source };
        if options.slaves.is_empty() {
            return Err(ServeError::NoSlave);
        }
        let script = options.script.as_deref();
        let script = script.map(|path| simulated_slaves::script(path, &options.slaves)).transpose()?;
        let network = Network::new(simulated_slaves::build(&options.slaves)?, script, options.drift_ppm)?;
        let cable = network.cable().clone();
        let ports = ports(&options)?;
        let record = |file: PathBuf| {
            let name = format!("ethercat:{}", options.interface);
            NetworkRecording::begin(&file, name, 0).map_err(|source| ServeError::Record { file, source })
        };
        let begin = Instant::now();
        let recording = options.record.clone().map(record).transpose()?;
        let shared = Shared::new().map_err(system("make a waker"))?;
        let notes = Notes::default();
        let teller = NoteThread::of_lines(&notes, options.tell).map_err(system("start the thread of the log"))?;
        let service = Service {
            network,
            ports,
            recording,
            begin,
            shared: Arc::clone(&shared),
            notes,
            log_limit: LogLimit::default(),
            masters: Masters::new(options.interface, begin),
            next_tick: begin,
            next_look: begin,
            told_ring: None,
            answered: 0,
            lost: 0,
        };
        let failure = Failure::default();
        let (real_time, failed, reason) = (options.real_time, options.failed, Arc::clone(&failure));
        let run = move || {
            service.run(real_time, &reason);
            if reason.lock().is_some() {
                failed();
            }
        };
        let serving = Serving::start("ecmsk-ethercat", shared, teller, run);
        Ok(Self { cable, serving: serving.map_err(system("start the thread of the slaves"))?, failure })
    }

    /// The simulated cable. Tests and scripts cause faults with it.
    pub const fn cable(&self) -> &Cable {
        &self.cable
    }

    /// Waits until [`Options::tell`] has been called for all lines so far, at most 1 s.
    pub fn flush(&self) {
        self.serving.flush();
    }

    /// Ends the server: the slaves no longer answer, and the recording is complete.
    ///
    /// # Errors
    /// [`ServeError::Gone`]: the server had already ended by itself.
    pub fn stop(self) -> Result<(), ServeError> {
        drop(self.serving);
        self.failure.lock().take().map_or(Ok(()), Err)
    }
}

/// Opens the interfaces at the ends of the cable, and claims them.
fn ports(options: &Options) -> Result<Vec<Port>, ServeError> {
    let default_route = match options.allow_default_route {
        true => DefaultRoute::Allowed,
        false => DefaultRoute::Refused { override_option: Some("--force") },
    };
    if options.second.as_ref() == Some(&options.interface) {
        return Err(ServeError::SameInterface { interface: options.interface.clone() });
    }
    let port = |(name, is_connected): (&String, bool)| {
        let interface = ethernet::check(name, default_route)?;
        let claim = Claim::new(&interface)?;
        let socket = EthernetSocket::open(&interface, ETHERTYPE)?;
        Ok(Port { interface: name.clone(), socket, _claim: claim, is_connected, last_frame: None })
    };
    // The cable at the first interface counts as connected from the start. Whether the second interface has a link is
    // read before the first frame.
    let second = options.second.as_ref().map(|name| (name, false));
    std::iter::once((&options.interface, true)).chain(second).map(port).collect()
}
