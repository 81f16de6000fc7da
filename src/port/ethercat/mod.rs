//! Simulated slaves for any EtherCAT master: they answer the frames that come to a network interface (Linux), on the real
//! clock.
//!
//! Files, in the order in which to read them:
//!
//! - `mod.rs`: [`Server`], its options and errors
//! - `network.rs`: the slaves with what a script does to them; time is an argument
//! - `service.rs`: the thread

mod network;
mod service;

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

pub use crate::io::ethernet::InterfaceError;
pub use network::Network;

use super::notes::{Notes, Teller};
use super::serving::{Serving, Shared};
use crate::engine::RealTime;
use crate::ethercat::ETHERTYPE;
use crate::io::ethernet::{self, DefaultRoute, Socket};
use crate::link::record::NetworkRecording;
use crate::link::simulated_slaves::{self, SimulatedSlavesError};
use crate::link::slaves::SlaveSpec;
use crate::slave::cable::Cable;
use crate::slave::esc::UndescribedError;
use service::Service;

/// How slaves are served.
#[derive(Clone)]
pub struct Options {
    /// The network interface.
    pub interface: String,
    /// The slaves in the order of the cable.
    pub slaves: Vec<SlaveSpec>,
    /// By how much the crystals of the slaves are too fast or too slow at most, parts per million: the first one is too fast by that
    /// much, the last one too slow, and the others lie evenly between them.
    pub drift_ppm: u16,
    /// A file of events that happen to the slaves.
    pub script: Option<PathBuf>,
    /// The file to which every frame and its answer are recorded.
    pub record: Option<PathBuf>,
    /// Whether the interface may be the one by which this machine reaches others.
    pub allow_default_route: bool,
    /// What the thread that answers asks of the system; what is refused is a line of the log.
    pub real_time: RealTime,
    /// Called with each line of the log, in a thread of its own for which no other thread waits. Lines that it does not
    /// take in time are dropped, and their number is reported to it.
    pub tell: Arc<dyn Fn(&str) + Send + Sync>,
}

/// Why slaves cannot be served.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of a variant explains its fields")]
pub enum ServeError {
    /// See [`InterfaceError`].
    #[error(transparent)]
    Interface(#[from] InterfaceError),
    /// See [`SimulatedSlavesError`].
    #[error(transparent)]
    Slaves(#[from] SimulatedSlavesError),
    /// There is no slave.
    #[error("no slave is to be served; name some with --slaves, e.g. 'drive*2,io'")]
    NoSlave,
    /// The EEPROM of a slave cannot be written.
    #[error(transparent)]
    Description(#[from] UndescribedError),
    /// The recording cannot be made.
    #[error("cannot record to {}: {source}; name another file with --record or leave it out", file.display())]
    Record { file: PathBuf, source: io::Error },
    /// The system did not provide a thread or another resource.
    #[error("{what}: {source}; free some memory, files or threads, then start it again")]
    System { what: &'static str, source: io::Error },
}

/// Slaves that are served until this value is stopped or dropped.
pub struct Server {
    cable: Cable,
    serving: Serving,
}

impl Server {
    /// Switches the slaves on and serves them.
    ///
    /// # Errors
    /// [`ServeError`].
    pub fn start(options: Options) -> Result<Self, ServeError> {
        let system = |what| move |source: io::Error| ServeError::System { what, source };
        if options.slaves.is_empty() {
            return Err(ServeError::NoSlave);
        }
        let script = options.script.as_deref();
        let script = script.map(|path| simulated_slaves::script(path, &options.slaves)).transpose()?;
        let network = Network::new(simulated_slaves::build(&options.slaves)?, script, options.drift_ppm)?;
        let cable = network.cable().clone();
        let default_route = match options.allow_default_route {
            true => DefaultRoute::Allowed,
            false => DefaultRoute::Refused { insist: Some("--force") },
        };
        let interface = ethernet::check(&options.interface, default_route)?;
        let socket = Socket::open(&interface, ETHERTYPE)?;
        let record = |file: PathBuf| {
            let name = format!("ethercat:{}", options.interface);
            NetworkRecording::begin(&file, name, 0).map_err(|source| ServeError::Record { file, source })
        };
        let begin = Instant::now();
        let recording = options.record.clone().map(record).transpose()?;
        let shared = Shared::new().map_err(system("make a waker"))?;
        let notes = Notes::default();
        let teller = Teller::of_lines(&notes, options.tell).map_err(system("start the thread of the log"))?;
        let service = Service::new(options.interface, network, socket, recording, begin, Arc::clone(&shared), notes);
        let real_time = options.real_time;
        let serving = Serving::start("ecmsk-ethercat", shared, teller, move || service.run(real_time));
        Ok(Self { cable, serving: serving.map_err(system("start the thread of the slaves"))? })
    }

    /// The cable of the slaves, for faults.
    pub const fn cable(&self) -> &Cable {
        &self.cable
    }

    /// Waits until [`Options::tell`] has been called for all lines so far, at most 1 s.
    pub fn flush(&self) {
        self.serving.flush();
    }

    /// Ends the server: the slaves answer no more, and the recording is complete.
    pub fn stop(self) {
        drop(self.serving);
    }
}
